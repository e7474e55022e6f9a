//! What the firmware and those who test it share: the table of engines of this aircraft.
//!
//! The library that does the work is `jetlink`; the tasks, boards and images are in the binary (`src/main.rs`).
#![no_std]
#![forbid(unsafe_code)]
#![deny(missing_docs)]

pub mod config;
