//! Test image only (feature `count`, `cargo qemu count`): counts the instructions for a received byte, a frame and a
//! reply.
//!
//! QEMU runs this image with `-icount`: its time advances only with the instructions, so a timer counts them. Sockets
//! would introduce the host's time. So the UARTs' registers are memory here, and this task writes the ECU's bytes to
//! them and triggers the receiver's interrupt. From there on, the firmware is the same to the last instruction.

use super::hardware::Register;
use super::memory_uart::{FIRST_SENT, TIMER_VALUE, now};
use super::semihosting::exit;
use super::uart::Port;
use core::mem::discriminant;
use core::sync::atomic::Ordering;
use embassy_time::{Duration, Ticker};
use jetlink::config::EngineConfig;
use jetlink::ecu::EcuConfig;
use jetlink_fw::config::ENGINES;

/// A timer that counts down at 25 MHz, which nothing else uses.
const TIMER_CONTROL: Register = Register::at(0x4000_0000);
const TIMER_RELOAD: Register = Register::at(0x4000_0008);

/// `-icount shift=7`: an instruction takes 128 ns, a tick of the timer 40 ns.
const INSTRUCTION_NS: u32 = 128;
const TICK_NS: u32 = 40;

/// Frames of each kind. The lowest count is printed, because a timer may interrupt some of them.
const FRAMES: usize = 50;
/// Pause between two frames, shorter than the time after which an ECU is lost.
const PERIOD: Duration = Duration::from_millis(125);

/// Bytes of the longest frame.
const LONGEST: usize = 7;
/// An AMT set of an engine in standby.
const AMT: [u8; 6] = [0xFF, 0x02, 0x00, 0x0E, 0x00, 0x00];
/// The first status example of the ZK document.
const ZK: [u8; 7] = [0xF1, 0x00, 0x00, 0x00, 0x00, 0x4C, 0xA0];

fn instructions(from: u32, to: u32) -> u32 {
    (to.wrapping_sub(from) * TICK_NS + INSTRUCTION_NS / 2) / INSTRUCTION_NS
}

/// Counts for the first engine of each kind, prints, and ends the program.
#[expect(clippy::disallowed_methods, reason = "it is the ECU here, which keeps its own time")]
pub async fn run() -> ! {
    TIMER_RELOAD.write(u32::MAX);
    TIMER_VALUE.write(u32::MAX);
    TIMER_CONTROL.write(1);
    let itself = instructions(now(), now());

    let mut period = Ticker::every(PERIOD);
    for (row, engine) in ENGINES.iter().enumerate() {
        let same = |other: &EngineConfig| discriminant(&other.ecu) == discriminant(&engine.ecu);
        if ENGINES[..row].iter().any(same) {
            continue;
        }
        let (frame, answered): (&[u8], bool) = match engine.ecu {
            EcuConfig::Amt(_) => (&AMT, true),
            // Only the keep-alive is sent in the meantime.
            EcuConfig::Zk(_) => (&ZK, false),
        };
        let (mut bytes, mut reply) = ([u32::MAX; LONGEST], u32::MAX);
        for _ in 0..FRAMES {
            period.next().await;
            for (byte, least) in frame.iter().zip(&mut bytes) {
                Port::put(engine.port.into(), *byte);
                let before = now();
                // Behind `before`: what another engine's timer sends just here must not be earlier than it.
                FIRST_SENT.store(0, Ordering::Relaxed);
                // The interrupts of the UART and of the engines' executor are over when this returns.
                Port::interrupt(engine.port.into());
                let after = now();
                *least = instructions(before, after).saturating_sub(itself).min(*least);
                let first_sent = FIRST_SENT.load(Ordering::Relaxed);
                if first_sent != 0 {
                    reply = instructions(before, first_sent).min(reply);
                }
            }
        }
        let bytes = &bytes[..frame.len()];
        let all: u32 = bytes.iter().sum();
        defmt::info!("count: {=str}, {=[u8]:02x}, on {}", engine.name, frame, engine.line);
        defmt::info!("count: its bytes, interrupt to sleep: {=[?]} instructions", bytes);
        defmt::info!("count: the frame, all of its bytes: {=u32} instructions", all);
        if answered {
            defmt::info!(
                "count: last byte's interrupt to the reply's first byte: {=u32} instructions",
                reply
            );
        }
    }
    exit(0)
}
