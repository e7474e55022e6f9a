//! A virtual environment with the pinned pymavlink, made once.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

/// The package and its version.
pub const PYMAVLINK: &str = "pymavlink==2.4.50";

/// The interpreter with pymavlink, or why there is none. Tests run side by side: the first that asks makes the environment, the
/// others wait for it.
pub fn python() -> Result<PathBuf, String> {
    static PYTHON: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    PYTHON.get_or_init(environment).clone()
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
