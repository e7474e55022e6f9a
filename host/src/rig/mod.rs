//! `jetlink rig`.

use std::process::ExitCode;

/// Arguments of `jetlink rig`.
#[derive(clap::Args, Debug)]
pub struct Args {}

/// Runs it.
pub fn run(_args: Args) -> ExitCode {
    ExitCode::FAILURE
}
