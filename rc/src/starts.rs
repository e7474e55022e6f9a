//! A bound on the time for which a firmware that fails at each start holds a fuel valve open: no stop reaches such a node.
//!
//! After a reset the retained record may show a running engine, and its valve is opened before anything else. If the firmware then crashes or hangs
//! again and again, nothing else closes the valve. So the times of failed starts are summed up in memory that survives a reset. A start that has
//! lived for [`LIVED`] clears the sum; a closed valve stays closed. From [`LIMIT`] on, the valve is closed until the engine is at rest or is started
//! again.
//!
//! The limit is a time and not a number of starts, because a crash right after the start takes only milliseconds: any number that ends a
//! row of hangs within half a minute would end a row of crashes within a fraction of a second, and stop a healthy engine. Resets that the
//! firmware did not cause, by the supply or a button, neither add to the sum nor clear it: a chattering supply stops no engine.

use embassy_time::Duration;

/// Total time of consecutive failed starts from which the valve is closed.
pub const LIMIT: Duration = Duration::from_secs(10);
/// Time after which a start has succeeded: the node has received its ECUs and takes commands, so a stop reaches it.
pub const LIVED: Duration = Duration::from_secs(1);
/// Shortest time that a crash adds: the start-up before the clock runs.
const START: Duration = Duration::from_millis(5);
/// Shortest time of a hang: the shortest period of the watchdog.
const HANG: Duration = Duration::from_secs(1);

/// How the previous start ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Ended {
    /// By a panic or a fault, at this time of the clock.
    Crashed(Duration),
    /// By the watchdog.
    Hung,
    /// By something else: the supply, the crystal, a button, a command.
    Otherwise,
}

/// Total time of consecutive failed starts, and the engines whose valves they have closed.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FailedStarts {
    ms: u32,
    /// A bit for each engine.
    cut: u8,
}

/// Bits of the time in the retained number: up to 4.6 h.
const TIME: u32 = 0x00FF_FFFF;

impl FailedStarts {
    /// From the retained number; `None`: it was lost.
    pub fn retained(number: Option<u32>) -> Self {
        let number = number.unwrap_or(0);
        Self { ms: number & TIME, cut: (number >> 24) as u8 }
    }

    /// The number to retain: the time in ms, and the engines in the upper eight bits.
    pub fn number(self) -> u32 {
        self.ms.min(TIME) | u32::from(self.cut) << 24
    }

    /// After a start that has lived: only closed valves stay closed over a further reset. `cut`: for each engine, whether its valve
    /// is closed because of failed starts.
    #[must_use]
    pub fn lived(cut: impl IntoIterator<Item = bool>) -> Self {
        let bits = cut.into_iter().take(8).enumerate();
        Self { ms: 0, cut: bits.fold(0, |bits, (engine, cut)| bits | u8::from(cut) << engine) }
    }

    /// After a start that ended like this.
    #[must_use]
    pub fn after(self, ended: Ended) -> Self {
        let took = match ended {
            // It has lived, so it is not a failed start.
            Ended::Crashed(at) if at >= LIVED => return self,
            Ended::Crashed(at) => at + START,
            Ended::Hung => HANG,
            Ended::Otherwise => return self,
        };
        let took = u32::try_from(took.as_millis()).unwrap_or(u32::MAX);
        Self { ms: self.ms.saturating_add(took).min(TIME), ..self }
    }

    /// Whether too many starts have failed in a row.
    pub fn are_too_many(self) -> bool {
        Duration::from_millis(self.ms.into()) >= LIMIT
    }

    /// Whether the valve of this engine, counted from 0, is to be closed.
    pub fn close(self, engine: usize) -> bool {
        let cut =
            u32::try_from(engine).ok().and_then(|engine| self.cut.checked_shr(engine)).unwrap_or(0) & 1 == 1;
        cut || self.are_too_many()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of starts that end like this until the valve is closed.
    fn starts(ended: Ended) -> Option<u32> {
        let mut failed = FailedStarts::retained(None);
        (1..=100_000).find(|_| {
            failed = FailedStarts::retained(Some(failed.number())).after(ended);
            failed.are_too_many()
        })
    }

    #[test]
    fn ten_seconds_of_failed_starts_are_too_many_however_they_fail() {
        let crash = |ms| starts(Ended::Crashed(Duration::from_millis(ms)));
        // Immediate crashes: it takes thousands to fill 10 s. Hangs: as many as 10 s have periods of the watchdog.
        assert_eq!([crash(0), crash(5), crash(95), crash(995)], [2000, 1000, 100, 10].map(Some));
        // A start that lives for long enough to take commands never counts, however often it crashes.
        assert_eq!(crash(1050), None);
        assert_eq!(starts(Ended::Hung), Some(10));
    }

    #[test]
    fn supply_and_long_lives_never_close_it() {
        assert_eq!([starts(Ended::Otherwise), starts(Ended::Crashed(LIVED))], [None; 2]);
        let almost = (0..9).fold(FailedStarts::default(), |sum, _| sum.after(Ended::Hung));
        assert!(!almost.are_too_many() && almost.after(Ended::Hung).are_too_many());
        // A brown-out in between does not count, and does not clear what the firmware did.
        assert!(almost.after(Ended::Otherwise).after(Ended::Hung).are_too_many());
        // A long life clears the sum in `lived`.
        assert_eq!(almost.after(Ended::Crashed(LIVED)), almost);
        assert!(FailedStarts::retained(Some(u32::MAX)).after(Ended::Hung).are_too_many());
    }

    /// A long life clears the sum for the engines that run, and keeps the closed valve of another one closed.
    #[test]
    fn a_long_life_clears_the_sum_of_every_engine_but_the_one_that_was_cut() {
        let failed = (0..10).fold(FailedStarts::default(), |sum, _| sum.after(Ended::Hung));
        assert_eq!([0, 1, 7, 8].map(|engine| failed.close(engine)), [true; 4]);
        let lived = FailedStarts::lived([false, true]);
        let lived = FailedStarts::retained(Some(lived.number())).after(Ended::Hung);
        assert_eq!([0, 1, 2, 9, 40].map(|engine| lived.close(engine)), [false, true, false, false, false]);
        assert!(!FailedStarts::lived([false, false]).close(1), "it is at rest");
        let longest =
            FailedStarts::retained(Some(FailedStarts::lived([true]).number() | TIME)).after(Ended::Hung);
        assert!(longest.close(1) && longest.number() == TIME | 1 << 24);
    }
}
