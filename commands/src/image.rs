//! `cargo image`.

use boards::{BOARDS, Board};
use clap::Parser;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use std::path::PathBuf;

/// Build the firmware of a board and write the files that flash it.
///
/// Writes NAME.elf (for probe-rs), NAME.bin (for dfu-util) and NAME.hex. With --ardupilot-bootloader the image is
/// linked behind the board's ArduPilot bootloader, and NAME.apj is written as well: upload it with ArduPilot's
/// uploader.py or as custom firmware with a ground station.
#[derive(Parser, Debug)]
#[command(name = "cargo image", bin_name = "cargo image")]
pub struct Args {
    /// The board.
    #[arg(value_parser = PossibleValuesParser::new(BOARDS.map(|board| board.name)).try_map(board))]
    pub board: &'static Board,
    /// For a board that keeps its ArduPilot bootloader.
    #[arg(long)]
    pub ardupilot_bootloader: bool,
    /// The demo that commands the engines on its own. For a bench only!
    #[arg(long)]
    pub demo: bool,
    /// The folder for the files.
    #[arg(long, default_value = "target/images")]
    pub out: PathBuf,
}

fn board(name: String) -> Result<&'static Board, String> {
    Board::by_name(&name).ok_or(name)
}
