//! Bench image only (feature `selftest`): the board's own measurements, as one block of log lines to paste into a report.
//!
//! The oscillators are measured with the watchdog, which has its own oscillator (LSI). In the first round the watchdog runs
//! out while the core counts time by the crystal: this gives the LSI. The second round does the same on the internal
//! oscillator (HSI): the ratio of the two results is its error. The progress of each round is stored in the RAM that
//! survives a reset, so the rounds also show that the watchdog resets, that the reset is recognised, and that this RAM is
//! retained. Then the firmware runs as usual, and reports after 5 s and every 30 s. Each reset after the two rounds is
//! counted; a loss of power starts the rounds again.
//!
//! It resets the board twice and is therefore for a bench only. Like every image, it does not write option bytes.
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

/// State retained across the resets of the two rounds.
struct Record {
    /// [`MAGIC`] plus 1 or 2: this round has begun; 3: both are done.
    round: RetainedWord,
    /// Resets since then.
    resets: RetainedWord,
    /// 1 if the first start followed a loss of power.
    cold: RetainedWord,
    /// Duration of each round, in µs by the oscillator that it ran on.
    reached: [Reached; 2],
}

/// A time that is written until the watchdog resets the board: two words in turn, because the reset may come between the
/// stores of one, which is then not valid.
struct Reached([RetainedWord; 2]);

impl Reached {
    const fn new() -> Self {
        Self([const { RetainedWord::new() }; 2])
    }

    /// The later of the two words, in µs; `None` if neither is intact.
    fn get(&self) -> Option<u32> {
        self.0.iter().filter_map(RetainedWord::get).max()
    }
}

// SAFETY: RAM that start-up does not touch. Every bit pattern is valid, and none is used without a round.
#[unsafe(link_section = ".retained.selftest")]
static RECORD: Record = Record {
    round: RetainedWord::new(),
    resets: RetainedWord::new(),
    cold: RetainedWord::new(),
    reached: [const { Reached::new() }; 2],
};

/// One bit for each TX pin, set if the pin was high at the start.
static TX_HIGH: AtomicU32 = AtomicU32::new(0);
/// Number of TX pins.
static TX: AtomicU32 = AtomicU32::new(0);

/// The round that has begun, if the record is valid.
fn round() -> Option<u32> {
    RECORD.round.get()?.checked_sub(MAGIC).filter(|round| (1..=3).contains(round))
}

/// Whether this start has to run on the internal oscillator, because the second round is due. Call it before the clocks run.
pub fn wants_internal_oscillator() -> bool {
    round() == Some(1)
}

/// Reads the TX pins, which have just been pulled up. Call it before anything drives them.
pub fn look_at_tx(tx: &[(Gpio, usize)]) {
    cortex_m::asm::delay(10_000); // 0.16 ms and more, for 40 kΩ and a long wire
    let high = tx.iter().enumerate().filter(|(_, (port, pin))| port.idr().read().0 >> pin & 1 == 1);
    TX_HIGH.store(high.fold(0, |bits, (nth, _)| bits | 1 << nth), Ordering::Relaxed);
    TX.store(tx.len() as u32, Ordering::Relaxed);
}

/// Begins the round that is due and does not return from it; returns if both are done. Call it when the clocks run, before the
/// tasks.
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

/// Lets the watchdog run out, and stores the time that has passed.
fn run_out(round: u32) -> ! {
    defmt::info!("selftest: round {=u32}, waiting for the watchdog to expire", round);
    RECORD.round.set(MAGIC + round);
    watchdog::watch(Pr::from_bits(0), RELOAD);
    let begun = Instant::now();
    // One may be left from an earlier test, and be later.
    let Reached([even, odd]) = &RECORD.reached[usize::from(round == 2)];
    even.set(0);
    loop {
        for word in [odd, even] {
            word.set(begun.elapsed().as_micros() as u32);
        }
    }
}

/// Reports, 5 s after the start and then every 30 s.
pub async fn report(board: &str, starting: u32, oscillator: Oscillator) -> ! {
    Timer::after_secs(5).await;
    loop {
        block(board, starting, oscillator).await;
        Timer::after_secs(30).await;
    }
}

/// The block to paste.
async fn block(board: &str, starting: u32, oscillator: Oscillator) {
    defmt::info!("selftest: begin, jetlink {=str} on {=str}", env!("CARGO_PKG_VERSION"), board);
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
        "selftest: stack {=u32} bytes deep since the start, {=u32} bytes while it started",
        super::stack::deepest(),
        starting
    );
    defmt::info!("selftest: end");
}

/// Results of the two rounds.
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
    // SAFETY: reads of registers of the core; region 0 is the guard's, and nothing else uses the MPU.
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

/// Enables the core's cycle counter. Call it once.
pub fn count_cycles() {
    // SAFETY: the debug unit's cycle counter, which nothing else in this firmware uses.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    core.DCB.enable_trace();
    DWT::unlock(); // required on a Cortex-M7
    core.DWT.enable_cycle_counter();
}
