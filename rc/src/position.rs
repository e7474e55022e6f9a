//! Positions of a switch, from its pulse width, debounced.

use crate::channels::Pulse;
use crate::settings::EngineSettings;
use embassy_time::{Duration, Instant};

/// Distance between two positions, in µs.
const BETWEEN: u16 = 100;

/// Position of the arm/stop switch.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Position {
    Stop,
    Standby,
    Run,
}

impl Position {
    /// `None` between two positions: the switch is moving or broken.
    pub const fn of(pulse: Pulse, settings: &EngineSettings) -> Option<Self> {
        // A pulse is 2200 µs at most.
        let us = if settings.switch_reversed { 3000 - pulse.us() } else { pulse.us() };
        let (stop, run) = (settings.switch_stop, settings.switch_run);
        if us <= stop {
            Some(Self::Stop)
        } else if us >= run {
            Some(Self::Run)
        } else if us >= stop.saturating_add(BETWEEN) && us <= run.saturating_sub(BETWEEN) {
            Some(Self::Standby)
        } else {
            None
        }
    }
}

/// Whether a switch with two positions is on; `None` between the two.
pub(crate) fn is_on(pulse: Pulse) -> Option<bool> {
    match pulse.us() {
        ..=1300 => Some(false),
        1700.. => Some(true),
        _ => None,
    }
}

/// A position that is accepted once it has been seen for a while.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Settled<T> {
    value: Option<T>,
    candidate: Option<(T, Instant)>,
}

impl<T: Copy + PartialEq> Settled<T> {
    pub const fn new() -> Self {
        Self { value: None, candidate: None }
    }

    /// Forgets a position that has not settled yet.
    pub const fn interrupt(&mut self) {
        self.candidate = None;
    }

    /// Takes a position, and accepts it once it has been seen for `hold`. True if accepted.
    pub fn see(&mut self, now: Instant, seen: T, hold: Duration) -> bool {
        if self.value == Some(seen) {
            self.candidate = None;
            return true;
        }
        let since = match self.candidate {
            Some((candidate, since)) if candidate == seen => since,
            _ => now,
        };
        self.candidate = Some((seen, since));
        let settled = now.saturating_duration_since(since) >= hold;
        if settled {
            (self.value, self.candidate) = (Some(seen), None);
        }
        settled
    }

    pub const fn get(&self) -> Option<T> {
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_have_gaps_between_them() {
        let settings = EngineSettings::DEFAULT;
        let reversed = EngineSettings { switch_reversed: true, ..settings };
        for us in 800..=2200 {
            let pulse = Pulse::new(us).unwrap();
            let expected = match us {
                ..=1300 => Some(Position::Stop),
                1400..=1600 => Some(Position::Standby),
                1700.. => Some(Position::Run),
                _ => None,
            };
            assert_eq!(Position::of(pulse, &settings), expected, "{us} µs");
            let mirrored = Pulse::new(3000 - us).unwrap();
            assert_eq!(Position::of(mirrored, &reversed), expected, "{us} µs, reversed");
        }
        // Other widths: a switch whose positions are at 1000, 1350 and 1600 µs.
        let near = EngineSettings { switch_stop: 1150, switch_run: 1500, ..settings };
        let of = |us| Position::of(Pulse::new(us).unwrap(), &near);
        assert_eq!([1150, 1500].map(of), [Some(Position::Stop), Some(Position::Run)]);
        assert_eq!([1250, 1400].map(of), [Some(Position::Standby); 2]);
        assert_eq!([1151, 1249, 1401, 1499].map(of), [None; 4]);
        let on = [1300, 1301, 1699, 1700].map(|us| is_on(Pulse::new(us).unwrap()));
        assert_eq!(on, [Some(false), None, None, Some(true)]);
    }

    #[test]
    fn position_counts_when_it_was_held() {
        let mut settled = Settled::new();
        let mut see = |ms, seen| settled.see(Instant::from_millis(ms), seen, Duration::from_millis(60));
        assert_eq!([(0, 1), (59, 1), (60, 1)].map(|(ms, seen)| see(ms, seen)), [false, false, true]);
        // Another one for a moment, and back; then another one that stays.
        let seen = [(70, 2), (80, 1), (90, 2), (140, 2), (150, 2)];
        assert_eq!(seen.map(|(ms, seen)| see(ms, seen)), [false, true, false, false, true]);
        assert_eq!(settled.get(), Some(2));
    }
}
