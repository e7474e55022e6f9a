//! MAVLink of a turbine node. Draft.
#![no_std]
#![forbid(unsafe_code)]
#![deny(missing_docs, missing_debug_implementations)]
#![allow(dead_code)]

#[cfg(test)]
extern crate std;

mod dialect;
pub mod frame;
pub mod ids;
mod servo;
pub mod settings;
mod vehicle;
