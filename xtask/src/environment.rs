//! Checks of the installed tools, and the environment of the `cargo` that runs a task.

use crate::pin;
use std::io::ErrorKind;
use std::process::{Command, Output, Stdio};

/// Variables that would make the pinned `cargo` use another compiler.
const OTHER_COMPILERS: [&str; 4] = ["RUSTC", "RUSTDOC", "CARGO_BUILD_RUSTC", "CARGO_BUILD_RUSTDOC"];

/// Variables that `cargo run` sets for this process: a build script that watches one would run again in each build.
const OF_THIS_PACKAGE: [&str; 6] = [
    "CARGO",
    "CARGO_MANIFEST_DIR",
    "CARGO_MANIFEST_PATH",
    "CARGO_PRIMARY_PACKAGE",
    "CARGO_CRATE_NAME",
    "CARGO_BIN_NAME",
];

/// `cargo` with the pinned toolchain, by name, because `$CARGO` is the caller's.
pub fn cargo() -> Command {
    let mut cargo = Command::new("cargo");
    for (name, _) in std::env::vars_os() {
        let of_this_package = name.to_str().is_some_and(|name| name.starts_with("CARGO_PKG_"));
        if of_this_package || OTHER_COMPILERS.iter().chain(&OF_THIS_PACKAGE).any(|other| name == *other) {
            cargo.env_remove(name);
        }
    }
    cargo.env("RUSTUP_TOOLCHAIN", pin::version());
    cargo
}

/// Checks that the pinned toolchain and the firmware's target are installed.
pub fn check_toolchain() -> Result<(), String> {
    let (version, target) = (pin::version(), pin::target());
    let toolchains = rustup(&["toolchain", "list"])?;
    let has_toolchain = toolchains.lines().filter_map(|line| line.split_whitespace().next()).any(|name| {
        // For example 1.98.0-x86_64-unknown-linux-gnu.
        name.strip_prefix(version).is_some_and(|host| host.is_empty() || host.starts_with('-'))
    });
    if !has_toolchain {
        return Err(format!(
            "the firmware is built with Rust {version}, which is not installed; install it with: \
             rustup toolchain install --no-self-update --profile minimal --target {target} {version}"
        ));
    }
    let targets = rustup(&["target", "list", "--installed", "--toolchain", version])?;
    if !targets.lines().any(|line| line.trim() == target) {
        return Err(format!(
            "Rust {version} is installed without the firmware's target; install it with: \
             rustup target add --toolchain {version} {target}"
        ));
    }
    let named = run(cargo().arg("--version")).map_err(|error| format!("cannot start cargo: {error}"))?;
    let named = String::from_utf8_lossy(&named.stdout).into_owned();
    if named.split_whitespace().nth(1) != Some(version) {
        return Err(format!(
            "the firmware is built with Rust {version}, but the first cargo in PATH is not rustup's ({}); \
             put rustup's folder first, usually with: export PATH=\"$HOME/.cargo/bin:$PATH\"",
            named.trim()
        ));
    }
    Ok(())
}

/// A program that a task needs besides Rust.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Program {
    /// Name of its file.
    pub name: &'static str,
    /// Command that installs it.
    pub install: &'static str,
}

/// Checks that a program is installed.
pub fn check_program(program: Program) -> Result<(), String> {
    match run(Command::new(program.name).arg("--version")) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            Err(format!("{} is not installed; install it with: {}", program.name, program.install))
        }
        // The task itself reports other errors.
        Ok(_) | Err(_) => Ok(()),
    }
}

/// Runs rustup and returns its output.
fn rustup(arguments: &[&str]) -> Result<String, String> {
    let command = format!("rustup {}", arguments.join(" "));
    // The output must not depend on the caller's toolchain.
    let output = run(Command::new("rustup").args(arguments).env_remove("RUSTUP_TOOLCHAIN"));
    let output = output.map_err(|error| match error.kind() {
        ErrorKind::NotFound => format!(
            "the firmware is built with Rust {} by rustup, which is not installed; install it from \
             https://rustup.rs",
            pin::version()
        ),
        _ => format!("cannot start `{command}`: {error}"),
    })?;
    if !output.status.success() {
        let why = String::from_utf8_lossy(&output.stderr);
        return Err(format!("`{command}` failed: {}", why.trim()));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

fn run(command: &mut Command) -> std::io::Result<Output> {
    command.stdin(Stdio::null()).output()
}
