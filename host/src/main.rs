//! The program `jetlink`: the library on a computer.
#![forbid(unsafe_code)]

mod decode;
mod decode_hint;
mod json;
mod rig;
mod signals;
mod telemetry;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Small turbines over the AMT and ZK serial protocols, on a computer.
#[derive(Parser, Debug)]
#[command(name = "jetlink", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Debug)]
enum Command {
    Decode(decode::Args),
    /// Run the firmware's own code against simulated ECUs.
    Rig(Box<rig::Args>),
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() => return usage(&error),
        // --help and --version.
        Err(error) => error.exit(),
    };
    match cli.command {
        Command::Decode(args) => decode::run(args),
        Command::Rig(args) => rig::run(&args),
    }
}

/// A bad argument: one sentence, and status 2.
fn usage(error: &clap::Error) -> ExitCode {
    let text = error.to_string();
    // The parser lists missing options in lines of their own, up to an empty one.
    let lines = text.lines().map(str::trim).take_while(|line| !line.is_empty());
    eprintln!("{}; --help explains all.", lines.collect::<Vec<_>>().join(" "));
    ExitCode::from(2)
}
