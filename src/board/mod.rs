//! The boards: pins, clocks, interrupts, the watchdog. No layer above this one names a register or a pin.
//!
//! One feature chooses one board. A board with an STM32 is data, in the package `boards`; `table.rs` turns that into code.
//! Code for all of them is in `stm32.rs`, `early.rs` and `port.rs`, code for a chip family in `stm32h7.rs` and `stm32f4.rs`.
//! `docs/porting.md` describes how to add one.
//!
//! Every board provides `NAME`, `PORTS`, `TELEMETRY_PORT`, `INVERTS_RX`, `TWO_STOP_BITS`, `OUTPUTS`, `OUTPUTS_LOW_BEFORE`, `drive_output`, `init`,
//! `open`, `leave`, `storage`, `start_engine_executor` and the types [`EcuPort`], [`Executor`], [`Led`] and [`Watchdog`]; a board
//! with a chip other than an STM32 implements all of them (`qemu_mps2.rs`).

#[cfg(feature = "stm32")]
mod alarms;
#[cfg(feature = "ardupilot-bootloader")]
mod ardupilot;
#[cfg(feature = "stm32")]
mod chip;
mod crash;
#[cfg(feature = "stm32")]
mod early;
pub mod engines;
#[cfg(all(feature = "selftest", feature = "stm32"))]
mod facts;
mod first;
mod format;
#[cfg(feature = "fram")]
mod fram;
pub mod guard;
#[cfg(feature = "usb")]
pub mod key;
mod memory;
#[cfg(all(not(feature = "fram"), any(not(feature = "stm32h7"), feature = "ardupilot-bootloader")))]
mod no_storage;
#[cfg(feature = "stm32")]
mod outputs;
#[cfg(feature = "stm32")]
mod port;
pub mod pulses;
#[cfg(feature = "board-qemu-mps2")]
mod qemu_mps2;
pub mod receiver;
mod retained;
#[cfg(all(feature = "selftest", feature = "stm32"))]
pub mod selftest;
pub mod settings;
#[cfg(board_socket)]
mod socket;
pub mod stack;
mod start;
#[cfg(feature = "stm32")]
pub mod starts;
mod state;
#[cfg(feature = "stm32")]
mod stm32;
#[cfg(feature = "stm32f4")]
mod stm32f4;
#[cfg(feature = "stm32h7")]
mod stm32h7;
pub mod supply;
#[cfg(feature = "stm32")]
mod table;
#[cfg(feature = "usb")]
pub mod usb;
#[cfg(feature = "stm32")]
mod wait;
#[cfg(feature = "stm32")]
mod watchdog;

pub use crash::leave;
pub use format::Format;
#[cfg(feature = "fram")]
pub use fram::Storage;
#[cfg(all(not(feature = "fram"), any(not(feature = "stm32h7"), feature = "ardupilot-bootloader")))]
pub use no_storage::{Storage, storage};
#[cfg(feature = "board-qemu-mps2")]
pub use qemu_mps2::*;
pub use state::{Oscillator, ResetCause};
#[cfg(all(feature = "stm32h7", not(feature = "fram"), not(feature = "ardupilot-bootloader")))]
pub use stm32h7::storage::{Storage, storage};
#[cfg(feature = "stm32")]
use table::FIRST;
#[cfg(feature = "fram")]
pub use table::storage;
#[cfg(feature = "stm32")]
pub use {
    embassy_executor::Executor,
    outputs::drive_output,
    port::EcuPort,
    stm32::{Led, Watchdog, start_engine_executor},
    table::{
        INVERTS_RX, NAME, OUTPUTS, OUTPUTS_LOW_BEFORE, PORTS, TELEMETRY_PORT, TWO_STOP_BITS, init, open,
    },
};
