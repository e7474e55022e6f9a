//! The aliases of `.cargo/config.toml` that build a firmware image: `cargo fw`, `image`, `flash-*`, `emu`,
//! `emu-run`, `emu-record`, `emu-compare`, `qemu` and `qemu-test`. And, for scripts, the list of boards: `cargo run --package xtask -- boards`.
//!
//! Every image is built with one pinned Rust; everything else builds with the installed one. This program checks the tools,
//! reports how to install those that are missing, and starts `cargo` with the pinned toolchain instead of the caller's.
#![forbid(unsafe_code)]

mod environment;
mod pin;
mod task;

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use task::{Answer, Task};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [first, rest @ ..] = arguments.as_slice()
        && first == "boards"
    {
        return match task::list(rest) {
            Ok(names) => {
                print!("{names}");
                ExitCode::SUCCESS
            }
            Err(why) => {
                eprintln!("error: {why}");
                ExitCode::FAILURE
            }
        };
    }
    match prepare(&arguments) {
        Ok(command) => start(command),
        Err(Answer::Help(text)) => {
            println!("{}", text.trim_end());
            ExitCode::SUCCESS
        }
        Err(Answer::Wrong(why)) => {
            eprintln!("error: {why}");
            ExitCode::FAILURE
        }
        Err(Answer::Program(answer)) => answer.exit(),
    }
}

/// The command for these arguments, after checking them and its tools.
fn prepare(arguments: &[String]) -> Result<Command, Answer> {
    let task = Task::parse(arguments)?;
    environment::check_toolchain()?;
    for program in task.programs() {
        environment::check_program(program)?;
    }
    let target = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).with_file_name("target"), PathBuf::from);
    if let Some((folder, text)) = task.first_build(&target)
        && !folder.exists()
    {
        eprintln!("{text}");
    }
    let mut cargo = environment::cargo();
    cargo.args(task.cargo_arguments());
    Ok(cargo)
}

/// Replaces this process by the command, so that signals reach it.
#[cfg(unix)]
fn start(mut command: Command) -> ExitCode {
    use std::os::unix::process::CommandExt;
    not_started(&command.exec())
}

#[cfg(not(unix))]
fn start(mut command: Command) -> ExitCode {
    match command.status() {
        Ok(status) => ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1)),
        Err(error) => not_started(&error),
    }
}

fn not_started(error: &std::io::Error) -> ExitCode {
    eprintln!("error: cannot start cargo: {error}");
    ExitCode::FAILURE
}
