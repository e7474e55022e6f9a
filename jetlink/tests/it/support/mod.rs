//! What the tests of links and engines share.

pub mod frames;
pub mod scenario;
