//! USB of a node: MAVLink on a serial port (CDC-ACM), which computers know without a driver of ours.
//!
//! | module | contents |
//! |---|---|
//! | [`device`] | the device with its one port, and what the host does with it |
//! | [`careful`] | any driver of Embassy, with an end to its waits and no panic by what a host asks for |
//!
//! The service, its port and what a new opening of it means are in `jetlink_mavlink` ([`jetlink_mavlink::packets`]).
//!
//! **Nothing here has run on hardware, nor in an emulator of a USB controller**: only against the simulated host of its tests.
#![no_std]
#![forbid(unsafe_code)]
#![deny(missing_docs, missing_debug_implementations)]

pub mod careful;
pub mod device;
