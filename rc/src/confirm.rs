//! A valid value is the median of three consecutive good frames, received at a plausible rate.
//!
//! SBUS has no checksum, the CRC-8 of CRSF lets one damaged frame in 256 through, and a pulse may be a spike. The median of
//! three discards any single odd frame, and costs one frame of delay.

use crate::channels::{Channels, Pulse};
use crate::count::count;
use embassy_time::{Duration, Instant};

/// Frames that may arrive at once because the task was late.
const BURST: u32 = 4;

/// Why a good frame has no valid value yet.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum NotYet {
    /// It is the first or second of a row.
    Row,
    /// It came faster than its sender can send.
    TooFast,
}

/// Consecutive frames of `N` channels.
#[derive(Clone, Debug)]
pub(crate) struct Confirm<const N: usize> {
    /// Shortest time between two frames of the sender.
    least: Duration,
    /// Longest time between two frames of a row.
    most: Duration,
    /// The last two frames of the row, the newer one last.
    row: [Option<[Pulse; N]>; 2],
    last: Option<Instant>,
    /// Time when the next frame would be due if all so far had come at the shortest interval.
    due: Option<Instant>,
}

impl<const N: usize> Confirm<N> {
    pub const fn new(least: Duration, most: Duration) -> Self {
        Self { least, most, row: [None; 2], last: None, due: None }
    }

    /// Ends the row: a frame was damaged, or marks its values as invalid.
    pub const fn end(&mut self) {
        self.row = [None; 2];
    }

    /// Takes a good frame.
    pub fn frame(&mut self, now: Instant, pulses: [Pulse; N]) -> Result<[Pulse; N], NotYet> {
        let due = self.due.map_or(now, |due| due.max(now));
        if due > now + self.least * BURST {
            return Err(NotYet::TooFast);
        }
        self.due = Some(due + self.least);
        if self.last.is_none_or(|last| now.saturating_duration_since(last) > self.most) {
            self.end();
        }
        self.last = Some(now);
        let [first, second] = self.row;
        self.row = [second, Some(pulses)];
        let (Some(first), Some(second)) = (first, second) else { return Err(NotYet::Row) };
        let mut result = pulses;
        for ((value, a), b) in result.iter_mut().zip(first).zip(second) {
            *value = median(a, b, *value);
        }
        Ok(result)
    }

    /// Takes a good frame of all channels, and returns the valid ones. Counts a frame that came too early.
    pub fn channels(&mut self, now: Instant, pulses: [Pulse; N], too_fast: &mut u32) -> Option<Channels> {
        match self.frame(now, pulses) {
            Ok(pulses) => Some(Channels::new(pulses.map(Some))),
            Err(NotYet::Row) => None,
            Err(NotYet::TooFast) => {
                count(too_fast);
                None
            }
        }
    }
}

fn median(a: Pulse, b: Pulse, c: Pulse) -> Pulse {
    a.min(b).max(a.max(b).min(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEAST: Duration = Duration::from_millis(3);
    const MOST: Duration = Duration::from_millis(50);

    fn pulse(us: u16) -> Pulse {
        Pulse::new(us).unwrap()
    }

    /// Feeds frames at these times in ms, and returns the valid values.
    fn play(confirm: &mut Confirm<1>, frames: &[(u64, u16)]) -> std::vec::Vec<Result<u16, NotYet>> {
        let play = |&(at, us): &(u64, u16)| {
            confirm.frame(Instant::from_millis(at), [pulse(us)]).map(|[value]| value.us())
        };
        frames.iter().map(play).collect()
    }

    #[test]
    fn the_median_of_any_three_is_the_middle_one() {
        for a in 0..3 {
            for b in 0..3 {
                for c in 0..3 {
                    let mut sorted = [a, b, c];
                    sorted.sort_unstable();
                    let [a, b, c] = [a, b, c].map(|n| pulse(1000 + n));
                    assert_eq!(median(a, b, c).us(), 1000 + sorted[1]);
                }
            }
        }
    }

    #[test]
    fn third_frame_counts_and_one_odd_frame_does_not() {
        let mut confirm = Confirm::new(LEAST, MOST);
        let frames = [(0, 1100), (14, 1100), (28, 1100), (42, 2200), (56, 1100), (70, 1500), (84, 1500)];
        let counts = play(&mut confirm, &frames);
        let row = Err(NotYet::Row);
        assert_eq!(counts, [row, row, Ok(1100), Ok(1100), Ok(1100), Ok(1500), Ok(1500)]);
    }

    #[test]
    fn pause_begins_a_new_row() {
        let row = Err(NotYet::Row);
        let mut confirm = Confirm::new(LEAST, MOST);
        assert_eq!(play(&mut confirm, &[(0, 1100), (50, 1100), (100, 1100)]), [row, row, Ok(1100)]);
        assert_eq!(play(&mut confirm, &[(151, 1900), (165, 1900), (179, 1900)]), [row, row, Ok(1900)]);
        confirm.end();
        assert_eq!(play(&mut confirm, &[(190, 1900), (204, 1900), (218, 1900)]), [row, row, Ok(1900)]);
    }

    #[test]
    fn flood_does_not_count_and_a_late_task_does() {
        let mut confirm = Confirm::new(LEAST, MOST);
        let flood: std::vec::Vec<_> = (0..100).map(|i| (i / 10, 1100)).collect();
        let counts = play(&mut confirm, &flood);
        // 10 ms have time for three frames, besides the first one and a burst.
        assert_eq!(counts.iter().filter(|result| **result != Err(NotYet::TooFast)).count(), 8);
        let mut confirm = Confirm::new(LEAST, MOST);
        let late =
            play(&mut confirm, &[(0, 1100), (7, 1100), (14, 1100), (35, 1100), (35, 1100), (35, 1100)]);
        assert!(late[2..].iter().all(|result| *result == Ok(1100)), "{late:?}");
    }
}
