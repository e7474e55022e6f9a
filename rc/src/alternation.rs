//! A throttle that moves up and down faster than a hand can move it: two receivers share a line, or damage escapes the checksum. The median
//! of three frames removes one odd frame, but not every second one.

use embassy_time::{Duration, Instant};

/// Smallest step between two frames that counts as a stroke, in µs.
const STROKE: u16 = 200;
/// Longest time between two consecutive strokes.
const FAST: Duration = Duration::from_millis(100);
/// Number of consecutive strokes in alternating directions that no hand makes.
const MOST: u8 = 3;
/// Time after the last stroke for which the throttle counts as silent: the source timeout expires, and a throttle that returns takes
/// over without a jump.
const SILENT: Duration = Duration::from_secs(1);

/// Strokes of a throttle.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Alternation {
    /// The last pulse in µs.
    last: Option<u16>,
    /// The last stroke, and whether it went up.
    stroke: Option<(Instant, bool)>,
    row: u8,
    until: Option<Instant>,
}

impl Alternation {
    pub const NEW: Self = Self { last: None, stroke: None, row: 0, until: None };

    /// Takes the throttle of a frame. Returns whether it alternates.
    pub fn see(&mut self, now: Instant, us: u16) -> bool {
        let before = self.last.replace(us).unwrap_or(us);
        if us.abs_diff(before) >= STROKE {
            let up = us > before;
            let alternates = self
                .stroke
                .is_some_and(|(at, was_up)| up != was_up && now.saturating_duration_since(at) <= FAST);
            self.row = if alternates { self.row.saturating_add(1) } else { 1 };
            self.stroke = Some((now, up));
            if self.row >= MOST {
                self.until = Some(now + SILENT);
            }
        }
        self.until.is_some_and(|until| now < until)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    /// Whether the throttle alternates at each of these pulses, one every `every` ms.
    fn play(every: u64, pulses: &[u16]) -> Vec<bool> {
        let mut alternation = Alternation::NEW;
        let times = (0..).map(|i| Instant::from_millis(i * every));
        times.zip(pulses).map(|(now, us)| alternation.see(now, *us)).collect()
    }

    #[test]
    fn every_second_frame_of_another_sender_is_found_at_the_third_stroke() {
        for every in [5, 14, 50, 100] {
            assert_eq!(
                play(every, &[1100, 1900, 1100, 1900, 1100]),
                [false, false, false, true, true],
                "{every}"
            );
        }
        // Two frames from each sender.
        let pairs = play(14, &[1100, 1100, 1500, 1500, 1100, 1100, 1500, 1500]);
        assert_eq!(pairs, [false, false, false, false, false, false, true, true]);
    }

    #[test]
    fn moves_by_hand_are_not_an_alternation() {
        // From end to end in one frame and back, slow strokes, small ones, and a stick that goes up and down as fast as a hand can.
        assert!(!play(14, &[1100, 1900, 1900, 1100, 1100, 1100]).contains(&true));
        assert!(!play(110, &[1100, 1900, 1100, 1900, 1100, 1900]).contains(&true));
        assert!(!play(14, &[1100, 1290, 1100, 1290, 1100, 1290]).contains(&true));
        let hand: Vec<u16> = (0..200).map(|i| 1100 + [0, 160, 320, 480, 320, 160][i % 6]).collect();
        assert!(!play(20, &hand).contains(&true));
    }

    #[test]
    fn it_counts_again_1_s_after_the_last_stroke() {
        let mut pulses = std::vec![1100, 1900, 1100, 1900];
        pulses.extend([1900; 60]);
        let alternates = play(20, &pulses);
        let silent = alternates.iter().filter(|alternates| **alternates).count();
        assert_eq!((silent, alternates.last()), (50, Some(&false)));
    }
}
