//! Moves bytes and time from a UART into a service. Only this file reads the clock, and only this one waits.

use crate::pilot::Outcome;
use crate::service::Service;
use core::cell::RefCell;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::Read;
use jetlink::runner::LineErrors;

/// Bytes that are read at once: two frames of SBUS, one of CRSF.
const READ: usize = 64;
/// Pause after a port error, so that a port that fails at once does not occupy the processor.
const PAUSE: Duration = Duration::from_millis(10);

/// A pulse that a timer has measured.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct MeasuredPulse {
    /// Channel, from 1.
    pub number: u8,
    /// Its width in µs.
    pub width: u32,
    /// Time since the beginning of the previous pulse, in µs.
    pub period: u32,
}

/// Serves the timer of a receiver with servo pulses: `next` waits for the end of a pulse on any channel. `after` is as in [`run`].
#[expect(clippy::disallowed_methods, reason = "the runner is where the clock is read")]
pub async fn run_pulses<const N: usize>(
    service: &RefCell<Service<'_, N>>,
    mut next: impl AsyncFnMut() -> MeasuredPulse,
    mut after: impl FnMut(Instant, usize, Outcome),
) -> ! {
    loop {
        let MeasuredPulse { number, width, period } = next().await;
        let now = Instant::now();
        service.borrow_mut().pulse(now, number, width, period, |engine, outcome| after(now, engine, outcome));
    }
}

/// Serves the UART of a receiver. The service is borrowed only during a call, so that others can configure it. `errors` are counted by the
/// UART's interrupt. `after` gets the outcome of each valid frame, for each engine by its place.
///
/// The reader has to wake at each byte, not when its buffer is half full: the pause before an SBUS frame identifies it. No
/// engine's link waits for this task, but a stop of the transmitter passes through it.
#[expect(clippy::disallowed_methods, reason = "the runner is where the clock is read, and what waits")]
pub async fn run<const N: usize>(
    service: &RefCell<Service<'_, N>>,
    mut rx: impl Read,
    errors: &LineErrors,
    mut after: impl FnMut(Instant, usize, Outcome),
) -> ! {
    let mut bytes = [0; READ];
    // A port that failed has lost bytes.
    let mut failed = false;
    loop {
        let result = rx.read(&mut bytes).await;
        let mut fault = failed;
        errors.drain(|_| fault = true);
        let Ok(count @ 1..) = result else {
            failed = true;
            Timer::after(PAUSE).await;
            continue;
        };
        failed = false;
        let now = Instant::now();
        let bytes = bytes.get(..count).unwrap_or_default();
        service.borrow_mut().receive(now, bytes, fault, |engine, outcome| after(now, engine, outcome));
    }
}
