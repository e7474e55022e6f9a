//! pymavlink: a virtual environment with the pinned one, made once, and the scripts of `host/tests/mavlink` that it plays.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// The package and its version.
const PYMAVLINK: &str = "pymavlink==2.4.50";

/// The interpreter with pymavlink, or why there is none. Tests run side by side: the first that asks makes the environment, the
/// others wait for it.
pub fn python() -> Result<PathBuf, String> {
    static PYTHON: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    PYTHON.get_or_init(environment).clone()
}

/// The same. `None`: the test does not run, which fails in CI.
pub fn interpreter(test: &str) -> Option<PathBuf> {
    python()
        .map_err(|why| {
            assert!(std::env::var_os("CI").is_none(), "{why}");
            eprintln!("NOT RUN: {test} against {PYMAVLINK}: {why}");
        })
        .ok()
}

/// A script, to be played.
pub fn script(python: &Path, name: &str) -> Command {
    let mut command = Command::new(python);
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("../host/tests/mavlink").join(name));
    command
}

/// Panics unless a pilot's script came to its successful end, and no thread of it failed.
pub fn check_pilot(output: &Output) {
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(!errors.contains("Exception"), "{errors}");
    check(output, "all as the documents have it");
}

/// Panics unless a script came to its end, which it says in these words. Prints what it has printed.
pub fn check(output: &Output, end: &str) {
    let text = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && text.contains(end), "{text}{errors}");
    println!("{text}");
}

/// Makes the virtual environment, or finds the whole one of an earlier run. One that was cut short is made again.
fn environment() -> Result<PathBuf, String> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(PYMAVLINK.replace("==", "-"));
    let python = folder.join("bin/python");
    if folder.join("complete").exists() {
        return Ok(python);
    }
    let run = |command: &mut Command| {
        let output = command.output().map_err(|error| format!("{command:?}: {error}"))?;
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        if output.status.success() { Ok(()) } else { Err(format!("{command:?}: {text}")) }
    };
    run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&folder))?;
    run(Command::new(&python).args(["-m", "pip", "install", "--quiet", PYMAVLINK]))?;
    std::fs::write(folder.join("complete"), PYMAVLINK).map_err(|error| error.to_string())?;
    Ok(python)
}
