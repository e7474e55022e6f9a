//! Bench image only (feature `selftest`): what the board can measure itself, as one block of log lines to paste into a report.
//!
//! The oscillators are measured with the watchdog, which has one of its own (LSI). The first round lets it run out while
//! the core counts time by the crystal: that gives the LSI. The second does so on the chip's own oscillator (HSI): the
//! ratio of the two is its error. How far each came is stored in the RAM that survives a reset, so both also show
//! that the watchdog resets, that the reset is recognised, and that this RAM is retained. Then the firmware runs as usual, and
//! reports after 5 s and every 30 s. Each reset after the two rounds is counted, a loss of power begins anew.
//!
//! It resets the board twice and so is for a bench. No image writes option bytes, and neither does this one.
#![expect(clippy::disallowed_methods, reason = "it measures time")]

use super::retained::RetainedWord;
use super::state::{Oscillator, ResetCause};
use super::{chip, watchdog};
use core::sync::atomic::{AtomicU32, Ordering};
use cortex_m::peripheral::{DWT, MPU, SCB};
use embassy_stm32::pac::{gpio::Gpio, iwdg::vals::Pr};
use embassy_time::{Duration, Instant, Timer};
use jetlink::engine::retained::Reset;

/// Periods of the LSI in a round: 4 for each count, from the reload value to 0.
const PERIODS: u64 = 4 * (RELOAD as u64 + 1);
const RELOAD: u16 = 3999;

/// "Self", and a version of the layout; the round in its lowest digit.
const MAGIC: u32 = 0x5E1F_0020;

/// What is retained over the resets of the two rounds.
struct Record {
    /// [`MAGIC`], and 1 or 2: this round has begun. 3: both are done.
    round: RetainedWord,
    /// Resets since then.
    resets: RetainedWord,
    /// 1 if the first start came out of a loss of power.
    cold: RetainedWord,
    /// How far each round came, in µs by the oscillator it ran on.
    reached: [RetainedWord; 2],
}

// SAFETY: RAM that start-up leaves as it is. Every bit pattern is valid, and none is used without a round.
#[unsafe(link_section = ".retained.selftest")]
static RECORD: Record = Record {
    round: RetainedWord::new(),
    resets: RetainedWord::new(),
    cold: RetainedWord::new(),
    reached: [const { RetainedWord::new() }; 2],
};

/// Each TX pin that rested high at the start is a one.
static TX_HIGH: AtomicU32 = AtomicU32::new(0);
/// How many there are.
static TX: AtomicU32 = AtomicU32::new(0);

/// The round that has begun, if the record is one.
fn round() -> Option<u32> {
    RECORD.round.get()?.checked_sub(MAGIC).filter(|round| (1..=3).contains(round))
}

/// Whether this start is to run on the chip's own oscillator: the second round is due. To be called before the clocks run.
pub fn wants_internal_oscillator() -> bool {
    round() == Some(1)
}

/// Looks at the TX pins, which have just been pulled up. To be called before anything drives them.
pub fn look_at_tx(tx: &[(Gpio, usize)]) {
    cortex_m::asm::delay(10_000); // 0.16 ms and more, for 40 kΩ and a long wire
    let high = tx.iter().enumerate().filter(|(_, (port, pin))| port.idr().read().0 >> pin & 1 == 1);
    TX_HIGH.store(high.fold(0, |bits, (nth, _)| bits | 1 << nth), Ordering::Relaxed);
    TX.store(tx.len() as u32, Ordering::Relaxed);
}

/// Begins the round that is due, and does not return from it; returns when both are done. To be called when the clocks run,
/// before the tasks.
pub fn measure(cause: ResetCause) {
    let warm = cause.retained() == Reset::Warm || cause == ResetCause::Unknown;
    match round() {
        Some(1) if warm => run_out(2),
        Some(2) if warm => RECORD.round.set(MAGIC + 3),
        Some(_) if warm => RECORD.resets.set(RECORD.resets.get().unwrap_or(0) + 1),
        _ => {
            RECORD.cold.set(u32::from(!warm));
            RECORD.resets.set(0);
            run_out(1)
        }
    }
}

/// Lets the watchdog run out, and stores how far that is.
fn run_out(round: u32) -> ! {
    defmt::info!("selftest: round {=u32}, the watchdog is left to run out", round);
    RECORD.round.set(MAGIC + round);
    watchdog::watch(Pr::from_bits(0), RELOAD);
    let begun = Instant::now();
    let reached = &RECORD.reached[usize::from(round == 2)];
    loop {
        reached.set(begun.elapsed().as_micros() as u32);
    }
}

/// Reports, 5 s after the start and then every 30 s.
pub async fn report(starting: u32, oscillator: Oscillator) -> ! {
    Timer::after_secs(5).await;
    loop {
        block(starting, oscillator).await;
        Timer::after_secs(30).await;
    }
}

/// The block to paste.
async fn block(starting: u32, oscillator: Oscillator) {
    defmt::info!("selftest: begin, jetlink {=str} on {=str}", env!("CARGO_PKG_VERSION"), super::table::NAME);
    chip::facts::chip();
    oscillators(oscillator);
    let before = (DWT::cycle_count(), Instant::now());
    Timer::after(Duration::from_millis(100)).await;
    let (cycles, time) = (DWT::cycle_count().wrapping_sub(before.0), before.1.elapsed().as_micros());
    let khz = u64::from(cycles) * 1000 / time.max(1);
    defmt::info!("selftest: core {=u64} kHz by its cycle counter and the time driver", khz);
    defmt::info!(
        "selftest: retained RAM survived the 2 resets of this test and {=u32} more; it began {=str}",
        RECORD.resets.get().unwrap_or(0),
        if RECORD.cold.get() == Some(1) { "after a loss of power" } else { "warm" }
    );
    let (tx, high) = (TX.load(Ordering::Relaxed), TX_HIGH.load(Ordering::Relaxed));
    defmt::info!(
        "selftest: TX at the start, pulled up: {=u32} of {=u32} high ({=u32:#b})",
        high.count_ones(),
        tx,
        high
    );
    chip::facts::memory();
    core();
    defmt::info!(
        "selftest: stack {=u32} bytes deep since the start, {=u32} while it started",
        super::stack::deepest(),
        starting
    );
    defmt::info!("selftest: end");
}

/// What the two rounds have shown.
fn oscillators(running_on: Oscillator) {
    let [first, second] = [0, 1].map(|nth| u64::from(RECORD.reached[nth].get().unwrap_or(0)));
    defmt::info!(
        "selftest: the watchdog bit after {=u64} us in round 1, {=u64} us in round 2",
        first,
        second
    );
    let lsi = PERIODS * 1_000_000 / first.max(1);
    let hsi = (second as i64 - first as i64) * 1_000_000 / first.max(1) as i64;
    match running_on {
        Oscillator::Crystal => {
            defmt::info!("selftest: LSI {=u64} Hz, HSI {=i64} ppm against the crystal", lsi, hsi)
        }
        Oscillator::Internal => defmt::warn!("selftest: no crystal; LSI {=u64} Hz against the HSI", lsi),
    }
}

/// The core's own registers.
fn core() {
    // SAFETY: reads of registers of the core; the choice of region 0 is the guard's own, and nobody else uses the MPU.
    let (control, base, vectors, cache) = unsafe {
        let (mpu, scb) = (&*MPU::PTR, &*SCB::PTR);
        mpu.rnr.write(0);
        (mpu.ctrl.read(), mpu.rbar.read(), scb.vtor.read(), scb.ccr.read())
    };
    defmt::info!(
        "selftest: MPU {=u32:#x}, guard at {=u32:#010x}; vectors at {=u32:#010x}; instruction cache {=bool}, data cache \
         {=bool}",
        control,
        base & !0x1F,
        vectors,
        cache >> 17 & 1 == 1,
        cache >> 16 & 1 == 1
    );
}

/// Turns the core's cycle counter on. To be called once.
pub fn count_cycles() {
    // SAFETY: the debug unit's cycle counter, which nothing else in this firmware uses.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    core.DCB.enable_trace();
    DWT::unlock(); // the Cortex-M7 wants it
    core.DWT.enable_cycle_counter();
}
