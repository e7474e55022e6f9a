//! The rate of `SERVO_OUTPUT_RAW`: requested, measured, and requested again when the autopilot has forgotten it.

use crate::vehicle::COPY;
use embassy_time::{Duration, Instant};

/// Intervals to request: each when an autopilot denies the previous one. ArduPlane grants 25 ms at 50 Hz.
const INTERVALS: [Duration; 3] =
    [Duration::from_millis(25), Duration::from_millis(50), Duration::from_millis(100)];
/// Time between two requests, unless one is denied.
const AGAIN: Duration = Duration::from_secs(5);
/// Time over which the rate is measured.
const MEASURE: Duration = Duration::from_secs(2);

/// What was requested, and what was received.
#[derive(Debug)]
pub(crate) struct RateRequest {
    /// Place in [`INTERVALS`].
    place: usize,
    /// Time of the next request at the earliest.
    next: Instant,
    /// The last one has no answer.
    pending: bool,
    granted: bool,
    /// Frames since the measurement began.
    frames: u32,
    since: Instant,
    /// Too few arrived in the last measurement.
    slow: bool,
}

impl RateRequest {
    pub const fn new(now: Instant) -> Self {
        Self { place: 0, next: now, pending: false, granted: false, frames: 0, since: now, slow: true }
    }

    /// A frame has arrived.
    pub const fn frame(&mut self) {
        self.frames = self.frames.saturating_add(1);
    }

    /// The autopilot has answered a request.
    pub fn answered(&mut self, now: Instant, accepted: bool) {
        // An answer without a pending request is not for us.
        if !core::mem::take(&mut self.pending) || now >= self.next {
            return;
        }
        if accepted {
            (self.granted, self.frames, self.since, self.slow) = (true, 0, now, false);
        } else if self.place + 1 < INTERVALS.len() {
            self.place += 1;
            // A copy of the denial does not answer the next request.
            self.next = now + COPY;
        }
    }

    /// The interval to request now, if any. `received`: the autopilot's heartbeats are received.
    pub fn due(&mut self, now: Instant, received: bool) -> Option<Duration> {
        let interval = INTERVALS.get(self.place).copied()?;
        if now >= self.since + MEASURE {
            let expected = MEASURE.as_ticks() / interval.as_ticks();
            self.slow = u64::from(self.frames) * 2 < expected;
            (self.frames, self.since) = (0, now);
        }
        let wanted = !self.granted || self.slow;
        if !received || !wanted || now < self.next {
            return None;
        }
        if self.granted {
            // It may have restarted, and may now grant what it denied before.
            (self.granted, self.place) = (false, 0);
        }
        (self.pending, self.next) = (true, now + AGAIN);
        INTERVALS.get(self.place).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_millis(100_000 + ms)
    }

    const MS: fn(u64) -> Option<Duration> = |ms| Some(Duration::from_millis(ms));

    #[test]
    fn a_denied_rate_falls_back_and_a_granted_one_is_measured() {
        let mut request = RateRequest::new(at(0));
        assert_eq!(request.due(at(0), false), None, "no autopilot is there");
        assert_eq!(request.due(at(0), true), MS(25));
        assert_eq!(request.due(at(100), true), None);
        // It comes twice: one step.
        request.answered(at(200), false);
        assert_eq!(request.due(at(200), true), None);
        request.answered(at(250), false);
        assert_eq!(request.due(at(400), true), MS(50));
        request.answered(at(450), true);
        // 20 a second are granted. 11 a second are enough, 9 are not.
        for second in 0..20 {
            (0..11).for_each(|_| request.frame());
            assert_eq!(request.due(at(1300 + second * 1000), true), None, "second {second}");
        }
        let requested: std::vec::Vec<u64> = (20..40)
            .filter(|second| {
                (0..9).for_each(|_| request.frame());
                request.due(at(1300 + second * 1000), true) == MS(25)
            })
            .collect();
        assert!(
            requested.len() >= 3 && requested.windows(2).all(|two| two[1] - two[0] >= 5),
            "{requested:?}"
        );
    }

    #[test]
    fn an_autopilot_that_has_forgotten_gets_another_request() {
        let mut request = RateRequest::new(at(0));
        request.due(at(0), true);
        request.answered(at(10), true);
        assert_eq!(request.due(at(60_000), false), None, "no heartbeats: it is not there");
        assert_eq!(request.due(at(61_000), true), MS(25));
        // Without an answer, every 5 s.
        assert_eq!((0..12).filter(|s| request.due(at(61_500 + s * 1000), true).is_some()).count(), 2);
    }
}
