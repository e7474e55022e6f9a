//! The command line.

use crate::image::Image;
use clap::{Parser, Subcommand};

/// What the program is called with.
#[derive(Parser)]
#[command(name = "cargo qemu", about = "Runs the firmware in QEMU, with simulated ECUs on its UARTs")]
pub struct Arguments {
    /// QEMU's program.
    #[arg(long, default_value = "qemu-system-arm", global = true)]
    pub qemu: String,
    /// More features of the firmware, for example `demo`: it then commands its engines by itself.
    #[arg(long, value_name = "FEATURES", global = true)]
    pub features: Option<String>,
    /// What QEMU connects the fifth UART with, which is kept for MAVLink, in the words of QEMU's -serial.
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

/// What to do in place of running until somebody ends it.
#[derive(Subcommand)]
pub enum Mode {
    /// Starts every engine, runs it, shuts it down and ends, with exit status 0 if all went well.
    Test {
        /// The most it may take, in seconds.
        #[arg(long, default_value_t = 180)]
        limit: u64,
    },
    /// Counts instructions: for a received byte, a frame and a reply.
    Count,
}
