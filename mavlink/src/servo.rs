//! Throttle from an autopilot: the validity of a `SERVO_OUTPUT_RAW` frame, and the meaning of its pulse widths.

use crate::settings::EngineSettings;
use embassy_time::{Duration, Instant};
use jetlink::units::Throttle;

/// Largest delay of a frame relative to the quickest one.
const LATE: Duration = Duration::from_millis(300);
/// Number of frames of an autopilot's new clock that have to agree before it is accepted.
const AGREE: u8 = 3;
/// Difference in delay at which frames of a new clock agree.
const AGREE_WITHIN: i32 = 100_000; // µs
/// Largest drift between the two clocks that is followed, µs per second.
const DRIFT: u64 = 1000;

/// Accepted pulse widths, in µs. Anything else is silence: 0 means "no output".
const ACCEPTED: core::ops::RangeInclusive<u16> = 800..=2200;

/// Shortest gap that a restart leaves in a stream.
const GAP: Duration = Duration::from_secs(1);
/// Time for which the delay after a gap has to stay the same.
const SETTLED: Duration = Duration::from_secs(3);

/// Clock of the frames of one port of outputs: `time_usec`, which wraps after 71 minutes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FrameClock {
    /// Last `time_usec`, the smallest delay, and when that was updated.
    base: Option<(u32, u32, Instant)>,
    candidate: Option<Candidate>,
}

/// A possible new clock of an autopilot that has restarted.
#[derive(Clone, Copy, Debug)]
enum Candidate {
    /// It went back.
    Back { last: u32, first_delay: u32, frames: u8 },
    /// It is ahead of the old one, but late since a gap.
    Late { first_delay: u32, since: Instant },
}

impl FrameClock {
    /// Whether a frame is valid: its time has advanced, and it is not late. When the autopilot restarts, its time goes back;
    /// three frames that agree begin a new clock.
    ///
    /// If the old clock was younger than a restart takes, the new one is already past it, and all its frames are late. Frames
    /// that a radio holds back after a gap are also late: it is a new clock only if the delay stays the same and the vehicle
    /// shows `disarmed`, as after a restart.
    pub fn counts(&mut self, now: Instant, time: u32, disarmed: bool) -> bool {
        // Both wrap; only differences matter.
        let delay = (now.as_micros() as u32).wrapping_sub(time);
        let Some((last, smallest, at)) = self.base else {
            self.base = Some((time, delay, now));
            return true;
        };
        let advanced = time.wrapping_sub(last) as i32;
        if advanced > 0 {
            let gap = now.saturating_duration_since(at);
            let drift = (gap.as_micros().saturating_mul(DRIFT) / 1_000_000).min(1_000_000) as u32;
            let smallest = smallest.wrapping_add(drift);
            let late = delay.wrapping_sub(smallest) as i32;
            let smallest = if late < 0 { delay } else { smallest };
            self.base = Some((time, smallest, now));
            if late <= LATE.as_micros() as i32 {
                self.candidate = None;
                return true;
            }
            return self.restarted(now, delay, gap >= GAP, disarmed);
        }
        if advanced == 0 {
            return false;
        }
        let agreeing = match self.candidate {
            Some(Candidate::Back { last, first_delay, frames }) => {
                let advanced = time.wrapping_sub(last) as i32;
                let differs = (delay.wrapping_sub(first_delay) as i32).unsigned_abs();
                if advanced == 0 {
                    return false;
                }
                (advanced > 0 && differs <= AGREE_WITHIN.unsigned_abs())
                    .then(|| (first_delay, frames.saturating_add(1)))
            }
            _ => None,
        };
        let (first_delay, frames) = agreeing.unwrap_or((delay, 1));
        if frames >= AGREE {
            (self.base, self.candidate) = (Some((time, delay, now)), None);
            return true;
        }
        self.candidate = Some(Candidate::Back { last: time, first_delay, frames });
        false
    }

    /// Whether a late frame belongs to a new clock, which is used from now on.
    fn restarted(&mut self, now: Instant, delay: u32, gap: bool, disarmed: bool) -> bool {
        let (first_delay, since) = match self.candidate {
            Some(Candidate::Late { first_delay, since }) if !gap => (first_delay, since),
            _ if gap => (delay, now),
            _ => {
                self.candidate = None;
                return false;
            }
        };
        let differs = delay.wrapping_sub(first_delay) as i32;
        // Each frame that was held back arrives with less delay.
        let draining = differs < -AGREE_WITHIN;
        let (first_delay, since) = if draining { (delay, now) } else { (first_delay, since) };
        let settled = now.saturating_duration_since(since) >= SETTLED && differs <= AGREE_WITHIN;
        if settled && disarmed {
            self.base = self.base.map(|(time, _, _)| (time, first_delay, now));
            self.candidate = None;
            return true;
        }
        self.candidate = Some(Candidate::Late { first_delay, since });
        false
    }
}

/// The throttle of a pulse width; `None` if it is not accepted.
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
    fn only_pulses_from_800_to_2200_us_are_a_throttle() {
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

    /// Sends frames every 25 ms from `first` on, each `delay` ms late. Returns which are valid.
    fn stream(clock: &mut FrameClock, begin: u64, first: u32, delays: &[u64]) -> std::vec::Vec<bool> {
        let frame = |(i, delay): (usize, &u64)| {
            let now = Instant::from_micros(begin + i as u64 * 25_000 + delay * 1000);
            clock.counts(now, first.wrapping_add(i as u32 * 25_000), true)
        };
        delays.iter().enumerate().map(frame).collect()
    }

    #[test]
    fn repeated_and_late_frames_do_not_count() {
        let mut clock = FrameClock::default();
        assert_eq!(stream(&mut clock, 1_000_000, 5_000_000, &[10, 0, 299, 10]), [true; 4]);
        let now = Instant::from_micros(1_080_000);
        assert!(!clock.counts(now, 5_075_000, true), "repeated");
        assert!(!clock.counts(now, 5_050_000, true), "older");
        assert_eq!(stream(&mut clock, 1_100_000, 5_100_000, &[0, 310, 310, 0]), [true, false, false, true]);
    }

    /// A frame that is older than the last one, and two that are half a wrap before: such a difference has no absolute value in 32 bits. The
    /// control: the two are not.
    #[test]
    fn frames_that_are_half_a_wrap_apart_do_not_agree() {
        let counted = |back: u32| {
            let mut clock = FrameClock::default();
            assert!(clock.counts(Instant::from_micros(10_000_000), 5_000_000, false));
            [(100, 0), (200, back), (300, back)].map(|(after, back)| {
                let time = 4_999_899_u32.wrapping_add(after).wrapping_sub(back);
                clock.counts(Instant::from_micros(10_000_000 + u64::from(after)), time, false)
            })
        };
        assert_eq!(counted(0), [false, true, true]);
        assert_eq!(counted(1 << 31), [false; 3]);
    }

    #[test]
    fn the_time_may_wrap_and_drift() {
        let mut clock = FrameClock::default();
        assert!(stream(&mut clock, 1_000_000, u32::MAX - 40_000, &[0; 8]).into_iter().all(|counts| counts));
        // A clock that is slow by 0.05 % for an hour, which is 1.8 s.
        let mut clock = FrameClock::default();
        for second in 0..3600_u64 {
            assert!(
                clock.counts(Instant::from_micros(second * 1_000_500), second as u32 * 1_000_000, true),
                "{second} s"
            );
        }
    }

    #[test]
    fn an_autopilot_that_restarts_begins_again_after_three_frames() {
        let mut clock = FrameClock::default();
        stream(&mut clock, 1_000_000, 900_000_000, &[0; 10]);
        assert_eq!(stream(&mut clock, 9_000_000, 2_000_000, &[0; 5]), [false, false, true, true, true]);
        // A burst of old frames is not a new clock: they do not arrive as they were sent.
        let now = Instant::from_micros(20_000_000);
        assert!(clock.counts(now, 13_000_000, true));
        for i in 0..40 {
            assert!(!clock.counts(now, 3_000_000 + i * 200_000, true));
        }
        assert!(clock.counts(now, 13_025_000, true));
    }

    /// A clock of 2 s, then a gap, then a clock that is 5 s behind, plus these delays in ms.
    fn after_a_gap(clock: &mut FrameClock, delays: &[u64]) -> std::vec::Vec<bool> {
        assert!(stream(clock, 1_000_000, 0, &[0; 80]).into_iter().all(|counts| counts));
        stream(clock, 14_000_000, 8_000_000, delays)
    }

    #[test]
    fn a_clock_that_is_past_the_old_one_begins_again_when_its_delay_has_settled() {
        let counted = after_a_gap(&mut FrameClock::default(), &[20; 400]);
        let first = counted.iter().position(|&counts| counts).expect("a new clock");
        assert!((118..=122).contains(&first) && counted[first..].iter().all(|&counts| counts), "{first}");
        // Delays of a busy line on top of it make no difference.
        let busy: std::vec::Vec<u64> = (0..400).map(|i| 20 + [0, 60, 90][i % 3]).collect();
        assert!(after_a_gap(&mut FrameClock::default(), &busy)[130..].iter().all(|&counts| counts));
    }

    #[test]
    fn frames_that_were_held_back_do_not_count() {
        // They drain: each has 15 ms less, until they are on time. The clock before the gap had a delay of 0.
        let mut clock = FrameClock::default();
        assert!(stream(&mut clock, 1_000_000, 1_000_000, &[0; 80]).into_iter().all(|counts| counts));
        let drains: std::vec::Vec<u64> = (0..400).map(|i: u64| 5000_u64.saturating_sub(15 * i)).collect();
        let counted = stream(&mut clock, 3_000_000, 3_000_000, &drains);
        let on_time = drains.iter().position(|&delay| delay <= 310).expect("on time");
        assert!(counted[..on_time].iter().all(|&counts| !counts) && counted[on_time..].iter().all(|&c| c));
        // They are held back longer and longer, without a gap.
        let held: std::vec::Vec<u64> = (0..800).map(|i: u64| (20 * i).min(5000)).collect();
        assert!(!stream(&mut clock, 20_000_000, 20_000_000, &held)[20..].iter().any(|&counts| counts));
    }

    #[test]
    fn an_armed_vehicle_has_not_restarted() {
        let mut clock = FrameClock::default();
        stream(&mut clock, 1_000_000, 0, &[0; 80]);
        for i in 0..400 {
            let now = Instant::from_micros(14_000_000 + i * 25_000);
            assert!(!clock.counts(now, 8_000_000 + i as u32 * 25_000, false), "{i}");
        }
    }
}
