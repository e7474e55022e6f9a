//! What the tests of links and engines share.

pub mod bench;
pub mod frames;
pub mod scenario;
