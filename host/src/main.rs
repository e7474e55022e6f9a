//! The program `jetlink`: what the library does, on a computer.

mod decode;
mod rig;

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
    Rig(rig::Args),
}

fn main() -> ExitCode {
    match Cli::parse().command {
        Command::Decode(args) => decode::run(args),
        Command::Rig(args) => rig::run(args),
    }
}
