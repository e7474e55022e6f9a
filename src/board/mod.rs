//! The boards: pins, clocks, interrupts, the watchdog. Nothing above this layer names a register or
//! a pin.
//!
//! One feature chooses one board. A board is one file (`matek_h743.rs`, `pixracer.rs`) that says
//! which of its UARTs are ECU ports. What all boards with an STM32 share is in `stm32.rs` and
//! `port.rs`, what a family of chips shares is in `stm32h7.rs` and `stm32f4.rs`. To add a board: that
//! file, its lines below, `memory/<board>.x` and the feature in `Cargo.toml`.
//!
//! Every board gives `NAME`, `PORTS`, `TELEMETRY_PORT`, `init`, `reset_cause`,
//! `start_engine_executor` and the types [`EcuPort`], [`Executor`], [`Led`] and [`Watchdog`]; a board
//! with another chip than an STM32 brings all of them (`qemu_mps2.rs`).

#[cfg(feature = "ardupilot-bootloader")]
mod ardupilot;
mod crash;

#[cfg(feature = "board-matek-h743")]
mod matek_h743;
#[cfg(feature = "board-pixracer")]
mod pixracer;
#[cfg(feature = "stm32")]
mod port;
#[cfg(feature = "board-qemu-mps2")]
mod qemu_mps2;
mod start;
#[cfg(feature = "stm32")]
mod stm32;
#[cfg(feature = "board-pixracer")]
mod stm32f4;
#[cfg(feature = "board-matek-h743")]
mod stm32h7;

#[cfg(feature = "board-qemu-mps2")]
pub use qemu_mps2::*;
#[cfg(feature = "stm32")]
pub use {
    chip::reset_cause,
    chosen::{NAME, PORTS, TELEMETRY_PORT, init},
    embassy_executor::Executor,
    port::EcuPort,
    stm32::{Led, Watchdog, start_engine_executor},
};
#[cfg(feature = "board-matek-h743")]
use {matek_h743 as chosen, stm32h7 as chip};
#[cfg(feature = "board-pixracer")]
use {pixracer as chosen, stm32f4 as chip};

use embassy_executor::InterruptExecutor;
use jetlink::engine::keep::Memory;

/// The board, ready for the firmware.
pub struct Board {
    /// The ECU ports that were asked for, open.
    pub ports: [Option<EcuPort>; PORTS.len()],
    /// The status LED, dark.
    pub led: Led,
    /// The watchdog, not yet running.
    pub watchdog: Watchdog,
}

/// What has to survive a reset, for the engine on each port.
// SAFETY: cortex-m-rt's section `.uninit` is RAM that start-up leaves as it is. Every bit pattern is a valid `Memory`
// (it is atomics throughout), and what it holds is only believed with a right checksum.
#[unsafe(link_section = ".uninit.kept")]
pub static KEPT: [Memory; PORTS.len()] = [const { Memory::new() }; PORTS.len()];

/// Polls the engines' tasks from an interrupt, above thread mode and below the UARTs and the timer.
static ENGINE_EXECUTOR: InterruptExecutor = InterruptExecutor::new();
