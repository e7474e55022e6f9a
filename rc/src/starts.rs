//! A bound on a firmware that fails at each start and holds a fuel valve open meanwhile: no stop reaches such a node.
//!
//! After a reset the retained record may say that an engine runs, and its valve is opened before anything else. Where the firmware then
//! crashes or hangs, again and again, nothing else ever closes it. So the time of starts that failed is summed up in memory that survives a
//! reset. A start that has lived for [`LIVED`] clears the sum, unless the valve is closed for it. From [`LIMIT`] on the valve is closed, until the engine is at
//! rest or started anew.
//!
//! It is a time and not a number, because a crash right after the start is over in milliseconds: any number that ends a row of hangs within
//! half a minute would end a row of crashes within a fraction of a second, and cut an engine that is in order. Resets that are not the
//! firmware's doing, by the supply or a button, neither count nor clear: a supply that chatters costs no engine.

use embassy_time::Duration;

/// Time of failed starts in a row from which the valve is closed.
pub const LIMIT: Duration = Duration::from_secs(10);
/// Time after which a start has not failed: it has received its ECUs and takes commands, so that a stop reaches it.
pub const LIVED: Duration = Duration::from_secs(1);
/// Time that a crash takes besides, at least: the start up to where the clock runs.
const START: Duration = Duration::from_millis(5);
/// Time that a hang takes, at least: the shortest round of the watchdog.
const HANG: Duration = Duration::from_secs(1);

/// How the start before this one ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Ended {
    /// By a panic or a fault, when the clock had this time.
    Crashed(Duration),
    /// By the watchdog.
    Hung,
    /// By something else: the supply, a button, a command.
    Otherwise,
}

/// Time of failed starts in a row.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FailedStarts {
    ms: u32,
}

impl FailedStarts {
    /// From the number that was retained; `None`: it was lost.
    pub fn retained(ms: Option<u32>) -> Self {
        Self { ms: ms.unwrap_or(0) }
    }

    /// The number to retain, in ms.
    pub const fn ms(self) -> u32 {
        self.ms
    }

    /// After a start that ended like this.
    #[must_use]
    pub fn after(self, ended: Ended) -> Self {
        let took = match ended {
            // It has lived: nothing of it is a failed start.
            Ended::Crashed(at) if at >= LIVED => return self,
            Ended::Crashed(at) => at + START,
            Ended::Hung => HANG,
            Ended::Otherwise => return self,
        };
        Self { ms: self.ms.saturating_add(u32::try_from(took.as_millis()).unwrap_or(u32::MAX)) }
    }

    /// Whether the valve is to be closed.
    pub fn are_too_many(self) -> bool {
        Duration::from_millis(self.ms.into()) >= LIMIT
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Number of starts that end like this until the valve is closed.
    fn starts(ended: Ended) -> Option<u32> {
        let mut failed = FailedStarts::retained(None);
        (1..=100_000).find(|_| {
            failed = FailedStarts::retained(Some(failed.ms())).after(ended);
            failed.are_too_many()
        })
    }

    #[test]
    fn ten_seconds_of_failed_starts_are_too_many_however_they_fail() {
        let crash = |ms| starts(Ended::Crashed(Duration::from_millis(ms)));
        // Crashes at once: 10 s of them are thousands. Hangs: as many as 10 s have rounds of the watchdog.
        assert_eq!([crash(0), crash(5), crash(95), crash(995)], [2000, 1000, 100, 10].map(Some));
        // One that lives for long enough to take commands is none, however often.
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
        // Nor does a long life of a node whose valve stays closed: it clears the sum itself, once the engine is at rest.
        assert_eq!(almost.after(Ended::Crashed(LIVED)), almost);
        assert!(FailedStarts::retained(Some(u32::MAX)).after(Ended::Hung).are_too_many());
    }
}
