//! External ports of the rig: TCP, UDP and serial ones.

mod address;
mod link;

pub use self::address::{Address, AddressError};
pub use self::link::{Format, Link, OpenError};
