//! `cargo emu`, `emu-run`, `emu-record` and `emu-compare`.

use boards::BOARDS;
use clap::Parser;
use clap::builder::PossibleValuesParser;
use std::path::PathBuf;

/// The image that is flashed.
pub const RELEASE: &str = "release";

/// The images of `cargo emu-run`: that one, and the others by their features. A test of the emulator compares them.
pub const IMAGES: [&str; 15] = [
    RELEASE,
    "demo",
    "all-ports",
    "wedge",
    "play-ecu",
    "ardupilot-bootloader",
    "selftest",
    "radio-crsf",
    "radio-socket",
    "radio-socket-crsf",
    "radio-pwm",
    "outputs",
    "outputs-ardupilot",
    "usb",
    "supply",
];

/// The firmware's images on emulated boards.
#[derive(Parser, Debug)]
#[command(name = "emu", bin_name = "cargo", disable_help_subcommand = true)]
pub enum Call {
    /// Builds all images and runs the tests on them.
    #[command(name = "emu")]
    Test {
        /// Only the tests whose names contain one of these.
        #[arg(value_name = "TEST", trailing_var_arg = true)]
        filters: Vec<String>,
    },
    /// Builds an image and runs it in real time, until Ctrl-C, with an ECU on every port that has an engine, and the log on
    /// the terminal.
    #[command(name = "emu-run")]
    Run {
        /// The board.
        #[arg(value_parser = PossibleValuesParser::new(BOARDS.map(|board| board.name)))]
        board: String,
        /// The image: demo commands the engines, ardupilot-bootloader is linked behind a bootloader, selftest reports on the
        /// board after 7 s.
        #[arg(long, default_value = RELEASE, value_parser = PossibleValuesParser::new(IMAGES))]
        image: String,
        /// TCP port of the telemetry UART on this machine. Not 5760: ArduPilot's simulator listens there.
        #[arg(long, value_name = "PORT", default_value_t = 5790, value_parser = clap::value_parser!(u16).range(1..))]
        tcp: u16,
        /// Folder for the raw bytes of each engine's line: NAME-from-ecu.bin for `jetlink decode`, and the board's commands in
        /// NAME-to-ecu.bin. It is created if it does not exist, and files of these names are overwritten.
        #[arg(long, value_name = "DIR")]
        capture: Option<PathBuf>,
    },
    /// Records what four named runs send on each port, as a text file for each run in a folder.
    #[command(name = "emu-record")]
    Record {
        /// The folder. It is created if it does not exist.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
    /// Replays the four runs and compares them with a folder. Fails if a byte or the order differs, or at a shift above 100 µs.
    #[command(name = "emu-compare")]
    Compare {
        /// The folder of `cargo emu-record`.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
    /// Builds all images, and nothing else.
    #[command(name = "build", hide = true)]
    Build,
}
