//! Throttle from an autopilot: when a frame of `SERVO_OUTPUT_RAW` counts, and what a pulse width means.

use crate::settings::EngineSettings;
use embassy_time::{Duration, Instant};
use jetlink::units::Throttle;

/// Largest delay of a frame behind the quickest one.
const LATE: Duration = Duration::from_millis(300);
/// Frames of an autopilot's new clock that agree before it counts.
const AGREE: u8 = 3;
/// Difference in delay at which frames of a new clock agree.
const AGREE_WITHIN: i32 = 100_000; // µs
/// Drift of the two clocks that is followed, µs per second.
const DRIFT: u64 = 1000;

/// Pulse widths that are accepted, in µs. All else is silence: 0 is "no output".
const ACCEPTED: core::ops::RangeInclusive<u16> = 800..=2200;

/// Clock of the frames of one port of outputs: `time_usec`, which wraps after 71 minutes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FrameClock {
    /// Last `time_usec` that counted, the smallest delay, and when that was updated.
    base: Option<(u32, u32, Instant)>,
    /// A clock that went back: last time, delay of its first frame, and number of frames.
    candidate: Option<(u32, u32, u8)>,
}

impl FrameClock {
    /// Whether a frame counts: its time has advanced, and it is not late. When the autopilot restarts, its time goes back;
    /// three frames that agree make a new beginning.
    pub fn counts(&mut self, now: Instant, time: u32) -> bool {
        // Both wrap; only differences matter.
        let delay = (now.as_micros() as u32).wrapping_sub(time);
        let Some((last, smallest, at)) = self.base else {
            self.base = Some((time, delay, now));
            return true;
        };
        let advanced = time.wrapping_sub(last) as i32;
        if advanced > 0 {
            self.candidate = None;
            let elapsed = now.saturating_duration_since(at).as_micros();
            let drift = (elapsed.saturating_mul(DRIFT) / 1_000_000).min(1_000_000) as u32;
            let smallest = smallest.wrapping_add(drift);
            let late = delay.wrapping_sub(smallest) as i32;
            let smallest = if late < 0 { delay } else { smallest };
            self.base = Some((time, smallest, now));
            return late <= LATE.as_micros() as i32;
        }
        if advanced == 0 {
            return false;
        }
        let agreeing = match self.candidate {
            Some((before, first, count)) => {
                let advanced = time.wrapping_sub(before) as i32;
                let differs = (delay.wrapping_sub(first) as i32).abs();
                if advanced == 0 {
                    return false;
                }
                if advanced > 0 && differs <= AGREE_WITHIN { Some((first, count + 1)) } else { None }
            }
            None => None,
        };
        let (first, count) = agreeing.unwrap_or((delay, 1));
        if count >= AGREE {
            (self.base, self.candidate) = (Some((time, delay, now)), None);
            return true;
        }
        self.candidate = Some((time, first, count));
        false
    }
}

/// The throttle of a pulse width; `None` for one that is not accepted.
pub(crate) fn throttle(settings: &EngineSettings, pulse: u16) -> Option<Throttle> {
    if !ACCEPTED.contains(&pulse) || settings.low >= settings.high {
        return None;
    }
    let range = u32::from(settings.high - settings.low);
    let above = u32::from(pulse.saturating_sub(settings.low)).min(range);
    let above = if settings.reversed { range - above } else { above };
    let tenths = (above * 1000 + range / 2) / range;
    u16::try_from(tenths).ok().and_then(|tenths| Throttle::from_tenths(tenths).ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tenths(settings: &EngineSettings, pulse: u16) -> Option<u16> {
        throttle(settings, pulse).map(Throttle::tenths)
    }

    #[test]
    fn end_points_and_pulses_that_are_not_accepted() {
        let settings = EngineSettings::DEFAULT;
        for (pulse, expected) in [
            (0, None),
            (799, None),
            (800, Some(0)),
            (1100, Some(0)),
            (1500, Some(500)),
            (1501, Some(501)),
            (1900, Some(1000)),
            (2200, Some(1000)),
            (2201, None),
            (u16::MAX, None),
        ] {
            assert_eq!(tenths(&settings, pulse), expected, "{pulse} µs");
        }
        let reversed = EngineSettings { reversed: true, ..settings };
        assert_eq!(
            [1100, 1300, 1900].map(|pulse| tenths(&reversed, pulse)),
            [Some(1000), Some(750), Some(0)]
        );
        let narrow = EngineSettings { low: 1500, high: 1500, ..settings };
        assert_eq!(tenths(&narrow, 1500), None);
    }

    /// Frames every 25 ms from `first` on, each `delay` ms behind; which count.
    fn stream(clock: &mut FrameClock, begin: u64, first: u32, delays: &[u64]) -> std::vec::Vec<bool> {
        let frame = |(i, delay): (usize, &u64)| {
            let now = Instant::from_micros(begin + i as u64 * 25_000 + delay * 1000);
            clock.counts(now, first.wrapping_add(i as u32 * 25_000))
        };
        delays.iter().enumerate().map(frame).collect()
    }

    #[test]
    fn repeated_and_late_frames_do_not_count() {
        let mut clock = FrameClock::default();
        assert_eq!(stream(&mut clock, 1_000_000, 5_000_000, &[10, 0, 299, 10]), [true; 4]);
        let now = Instant::from_micros(1_080_000);
        assert!(!clock.counts(now, 5_075_000), "repeated");
        assert!(!clock.counts(now, 5_050_000), "older");
        assert_eq!(stream(&mut clock, 1_100_000, 5_100_000, &[0, 310, 310, 0]), [true, false, false, true]);
    }

    #[test]
    fn the_time_may_wrap_and_drift() {
        let mut clock = FrameClock::default();
        assert!(stream(&mut clock, 1_000_000, u32::MAX - 40_000, &[0; 8]).into_iter().all(|counts| counts));
        // A clock that is slow by 0.05 % for an hour, which is 1.8 s.
        let mut clock = FrameClock::default();
        for second in 0..3600_u64 {
            assert!(
                clock.counts(Instant::from_micros(second * 1_000_500), second as u32 * 1_000_000),
                "{second} s"
            );
        }
    }

    #[test]
    fn an_autopilot_that_restarts_begins_anew_after_three_frames() {
        let mut clock = FrameClock::default();
        stream(&mut clock, 1_000_000, 900_000_000, &[0; 10]);
        assert_eq!(stream(&mut clock, 9_000_000, 2_000_000, &[0; 5]), [false, false, true, true, true]);
        // A burst of old frames is none: they do not come as they were sent.
        let now = Instant::from_micros(20_000_000);
        assert!(clock.counts(now, 13_000_000));
        for i in 0..40 {
            assert!(!clock.counts(now, 3_000_000 + i * 200_000));
        }
        assert!(clock.counts(now, 13_025_000));
    }
}
