//! `cargo qemu` and `cargo qemu-test`.

use crate::fw;
use clap::{Parser, Subcommand};

/// Arguments of the program.
#[derive(Parser, Debug)]
#[command(
    name = "cargo qemu",
    bin_name = "cargo qemu",
    about = "Runs the firmware in QEMU, with simulated ECUs on its UARTs"
)]
pub struct Arguments {
    /// Program of QEMU.
    #[arg(long, default_value = "qemu-system-arm", global = true)]
    pub qemu: String,
    /// Further features of the firmware, for example `demo`, which commands the engines.
    #[arg(long, value_name = "FEATURES", global = true, value_parser = features)]
    pub features: Option<String>,
    /// Device for the fifth UART, which is the port of MAVLink, as in QEMU's option -serial.
    #[arg(long, value_name = "DEVICE", default_value = "null", global = true)]
    pub telemetry: String,
    #[command(subcommand)]
    pub mode: Option<Mode>,
}

/// Mode; by default it runs until Ctrl-C.
#[derive(Subcommand, Debug)]
pub enum Mode {
    /// Start, run and shut down every engine, then end; exit status 0 if the test passed.
    Test {
        /// Timeout in seconds.
        #[arg(long, default_value_t = 180)]
        limit: u64,
    },
    /// Count the instructions for a received byte, a frame and a reply.
    Count,
}

fn features(text: &str) -> Result<String, String> {
    fw::check(text).map(|()| text.to_owned())
}
