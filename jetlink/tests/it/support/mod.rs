//! Support shared by the tests of links and engines.

pub mod frames;
pub mod memory;
pub mod scenario;
