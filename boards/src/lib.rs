//! The boards as data: one file each, one list.
//!
//! This is the only description of a board in the project. The firmware's build script expands it into typed code and a
//! memory map (`build.rs`, `src/board/table.rs`), `cargo image` and `cargo flash-…` read it, CI gets its list from it, and
//! the tables in the README and in `docs/boards.md` are compared with it. Only the emulator has a copy of its own, as the
//! check of this one.
#![no_std]
#![forbid(unsafe_code)]
#![deny(missing_docs)]

mod board;
mod cube_orange;
mod matek_h743;
mod nucleo_h743zi2;
mod pixhawk_6c;
mod pixracer;

pub use board::*;

/// Every board with an STM32. The first of each chip is built and emulated in every variant.
pub static BOARDS: [&Board; 5] =
    [&matek_h743::BOARD, &pixracer::BOARD, &pixhawk_6c::BOARD, &cube_orange::BOARD, &nucleo_h743zi2::BOARD];

impl Board {
    /// The board of this name.
    pub fn by_name(name: &str) -> Option<&'static Board> {
        BOARDS.into_iter().find(|board| board.name == name)
    }

    /// Whether it is the first of its chip, which is built and emulated in every variant.
    pub fn is_first_of_its_chip(&self) -> bool {
        let first = BOARDS.into_iter().find(|board| board.chip.name == self.chip.name);
        first.is_some_and(|first| first.name == self.name)
    }
}
