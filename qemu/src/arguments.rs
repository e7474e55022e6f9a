//! The command line.

use crate::image::Image;
use clap::{Parser, Subcommand};

/// Arguments of the program.
#[derive(Parser)]
#[command(name = "cargo qemu", about = "Runs the firmware in QEMU, with simulated ECUs on its UARTs")]
pub struct Arguments {
    /// Program of QEMU.
    #[arg(long, default_value = "qemu-system-arm", global = true)]
    pub qemu: String,
    /// Further features of the firmware, for example `demo`, which commands the engines.
    #[arg(long, value_name = "FEATURES", global = true)]
    pub features: Option<String>,
    /// Device for the fifth UART, which is the port of MAVLink, as in QEMU's option -serial.
    #[arg(long, value_name = "DEVICE", default_value = "null", global = true)]
    pub telemetry: String,
    #[command(subcommand)]
    pub mode: Option<Mode>,
}

impl Arguments {
    /// The image with these features.
    pub fn build(&self, feature: &str) -> Result<Image, String> {
        let features: Vec<&str> = [feature].into_iter().chain(self.features.as_deref()).collect();
        Image::build(&features)
    }
}

/// Mode; by default it runs until Ctrl-C.
#[derive(Subcommand)]
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
