//! The firmware image, unmodified, on an emulated board, with the simulated ECUs of `sim` on its UARTs.
//!
//! A test states the board and the image, what is connected to each port, what happens when, and for how long:
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
//! assert!(report.logged("left: ECU link lost"));
//! ```
//!
//! The image runs instruction by instruction, in virtual time, and every run is the same. [`Run::go`] panics
//! unless the run passes every check of [`audit`].
//!
//! - [`board`]: the boards, their ports, pins and clocks.
//! - [`bootloader`]: a substitute for the board's bootloader, for images that are linked behind one.
//! - [`image`]: the images and their files.
//! - [`run`]: a run: its setup, and its course.
//! - [`pins`]: the levels of pins over a run.
//! - [`report`]: the record of a run.
//! - [`audit`]: the checks of every run.
//! - [`fram`]: the memory of settings of the boards that have one.
//! - [`receiver`]: a receiver of radio control, in place of an ECU.
//! - [`pulses`]: one with servo pulses, on the board's inputs for them.
//! - [`recording`]: the bytes sent in four named runs, to compare two states of the firmware.
//! - [`turnaround`]: how long a reply takes.
//! - `wire`, `capture`, `chip`, `quirks`, `log`, `valves`: the far end of a UART, its bytes in files, the emulated part, workarounds
//!   for the emulator, the firmware's log, and the audit of fuel valves.

#![deny(missing_docs, unsafe_code)]

pub mod audit;
pub mod board;
pub mod bootloader;
mod capture;
mod chip;
mod cpu;
pub mod engines;
pub mod fram;
pub mod image;
mod log;
pub mod pins;
pub mod pulses;
mod quirks;
pub mod receiver;
pub mod recording;
pub mod report;
pub mod run;
pub mod turnaround;
mod valves;
mod wire;

pub use board::{BOARDS, Board, MATEK_H743, NUCLEO_H743ZI2, PIXRACER};
pub use bootloader::{Bootloader, Jump, Leftover};
pub use fram::Fram;
pub use image::Image;
pub use log::Log;
pub use pulses::PulseReceiver;
pub use quirks::Stuck;
pub use receiver::Receiver;
pub use report::{Report, Tap, Written};
pub use run::{Bench, Run};
pub use wire::{Far, Fate, Rx, Tx, Wire};
