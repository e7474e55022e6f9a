//! The chip family of the board.

#[cfg(feature = "stm32f4")]
pub use super::stm32f4::*;
#[cfg(feature = "stm32h7")]
pub use super::stm32h7::*;
