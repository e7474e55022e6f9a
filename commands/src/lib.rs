//! The command lines of the aliases that build a firmware image. `xtask` reads them before it starts a build that takes
//! minutes, and the program that was built reads them again.

#![forbid(unsafe_code)]

pub mod emu;
pub mod fw;
pub mod image;
pub mod qemu;
