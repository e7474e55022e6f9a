//! Table of engines of this aircraft, for the firmware and its tests.
//!
//! The library that does the work is `jetlink`; the tasks, boards and images are in the binary (`src/main.rs`).
#![no_std]
#![forbid(unsafe_code)]
#![deny(missing_docs)]

pub mod config;
