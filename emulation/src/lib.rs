//! The firmware image, unmodified, on an emulated board, with the simulated ECUs of `sim` on its UARTs.
//!
//! A test says which board and image, what hangs on which port, what happens when, and for how long:
//!
//! ```no_run
//! use emulation::{Image, MATEK_H743, Run};
//! use sim::ecu::SECOND;
//!
//! let report = Run::new(&MATEK_H743, Image::Release)
//!     .engines()
//!     .at(2 * SECOND, |bench| bench.cut("SERIAL2", true))
//!     .until(4 * SECOND)
//!     .go();
//! assert!(report.logged("left: LinkLost"));
//! ```
//!
//! The image runs instruction by instruction, in virtual time, and the same at every run. [`Run::go`] panics
//! unless the run passes every check of [`audit`], which no test has to ask for.
//!
//! - [`board`]: the boards, their ports, pins and clocks.
//! - [`bootloader`]: what stands before an image that keeps its board's bootloader.
//! - [`image`]: which images there are, and where.
//! - [`run`]: one run, from what it is made of to how it goes.
//! - [`report`]: what it leaves behind.
//! - [`audit`]: what is checked at every run.
//! - [`recording`]: what is sent in four named runs, to compare two states of the firmware.
//! - [`turnaround`]: how long a reply takes.
//! - `wire`, `chip`, `quirks`, `log`: the far end of a UART, the emulated part, what the emulator needs help
//!   with, and the firmware's log.

#![deny(missing_docs, unsafe_code)]

pub mod audit;
pub mod board;
pub mod bootloader;
mod chip;
pub mod engines;
pub mod image;
mod log;
mod quirks;
pub mod recording;
pub mod report;
pub mod run;
pub mod turnaround;
mod wire;

pub use board::{BOARDS, Board, MATEK_H743, NUCLEO_H743ZI2, PIXRACER};
pub use bootloader::{Bootloader, Jump, Leftover};
pub use image::Image;
pub use log::Log;
pub use quirks::Stuck;
pub use report::{Report, Tap, Written};
pub use run::{Bench, Run};
pub use wire::{Far, Fate, Rx, Tx, Wire};
