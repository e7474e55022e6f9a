//! Arbitration between the sources of commands, each with a fixed priority and a timeout.
//!
//! The highest fresh source that commands standby or a run is in control. A source that was lost has to be received without
//! a gap for a while before it is in control again, so that a flapping source neither resets the stages of loss nor makes
//! the engine hunt. A short gap in a steady stream is not a loss.

use super::config::{SourceTimeouts, Supervision};
use crate::command::{Demand, Origin};
use embassy_time::{Duration, Instant};

/// Longest time between two commands of standby that count together, however slow a source is.
const TWO_STANDBYS_MAX: Duration = Duration::from_secs(10);

/// Intent of a source.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Intent {
    /// Present without a command: not in control.
    Nothing,
    Standby,
    Run(Demand),
}

/// Effect of one command of standby.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct StandbyOutcome {
    /// The source commanded something else before, or was silent.
    pub changed: bool,
    /// It takes effect.
    pub counts: bool,
}

#[derive(Clone, Copy, Debug)]
struct Source {
    intent: Intent,
    last_rx: Instant,
    /// Time from which it is silent, unless it is received again.
    silent_from: Instant,
    /// Time since which it has been received without a gap, and for how long before the last reset.
    since: Instant,
    steady_before: Duration,
    /// It was lost before.
    was_lost: bool,
    /// Intervals between its last two commands, and between the two before.
    period: Duration,
    period_before: Duration,
    /// Time of its last command, if that was standby, and no run was forgotten since.
    standby_at: Option<Instant>,
    /// It was received since the node started; otherwise it was restored.
    received: bool,
    /// Time of its last standby or run since the node started.
    last_commanded: Option<Instant>,
    /// Its last run could not be followed yet.
    deferred: bool,
}

/// What a record holds of the source that was in control.
#[derive(Clone, Copy, Debug)]
pub(super) struct Restored {
    pub demand: Demand,
    /// It was lost, and has to be received without a gap.
    pub was_lost: bool,
    /// Its silence by then.
    pub silent: Duration,
    /// For how long it had been received without a gap since.
    pub steady: Duration,
}

/// All sources of one engine.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sources {
    timeouts: SourceTimeouts,
    recover_after: Duration,
    return_within: Duration,
    /// In the order of [`Origin::SOURCES`]: highest priority first.
    sources: [Option<Source>; Origin::SOURCES.len()],
}

impl Sources {
    pub const fn new(config: &Supervision) -> Self {
        Self {
            timeouts: config.timeouts,
            recover_after: config.recover_after,
            return_within: config.return_within,
            sources: [None; Origin::SOURCES.len()],
        }
    }

    /// Changes the settings. A timeout applies from the next command of its source on, and a longer time to get back in control does not take
    /// control from a source that is.
    pub fn configure(&mut self, config: &Supervision) {
        for source in self.sources.iter_mut().flatten() {
            if recovered(source, self.recover_after) {
                source.steady_before = source.steady_before.max(config.recover_after);
            }
        }
        (self.timeouts, self.recover_after, self.return_within) =
            (config.timeouts, config.recover_after, config.return_within);
    }

    /// Takes a command of a source.
    pub fn command(&mut self, now: Instant, origin: Origin, intent: Intent) {
        self.record(now, origin, intent);
        if let Some(source) = self.slot(origin) {
            source.standby_at = None;
        }
    }

    /// Takes a run that the ECU cannot follow yet: the source is received, and its previous run stays.
    pub fn defer_run(&mut self, now: Instant, origin: Origin, demand: Demand) {
        let before = self.source(origin).filter(|source| now < source.silent_from);
        let before = before.map(|source| source.intent).filter(|intent| matches!(intent, Intent::Run(_)));
        self.command(now, origin, before.unwrap_or(Intent::Run(demand)));
        if let Some(source) = self.slot(origin) {
            source.deferred = true;
        }
    }

    /// Whether the last run of a source could not be followed yet: the next one must not jump.
    pub fn was_deferred(&self, origin: Origin) -> bool {
        self.source(origin).is_some_and(|source| source.deferred)
    }

    /// Takes a standby. With `needs_two` the first of two commands changes nothing.
    pub fn standby(&mut self, now: Instant, origin: Origin, needs_two: bool) -> StandbyOutcome {
        let timeout = self.timeouts.of(origin);
        let before = self.slot(origin).copied();
        let fresh = before.is_some_and(|source| now < source.silent_from);
        // A run that was forgotten is standby in intent, but was not commanded to be.
        let standby = |source: Source| source.intent == Intent::Standby && source.standby_at.is_some();
        let changed = !fresh || !before.is_some_and(standby);
        // Two of its own periods, if that is longer. Use the shorter of its last two, because the other may be an outage.
        let period = |source: Source| source.period.min(source.period_before);
        let within = before.map_or(timeout, |source| timeout.max((period(source) * 2).min(TWO_STANDBYS_MAX)));
        let second = before.and_then(|source| source.standby_at).is_some_and(|at| now <= at + within);
        let counts = second || !needs_two;
        let intent = match before {
            _ if counts => Intent::Standby,
            Some(source) if fresh => source.intent,
            _ => Intent::Nothing,
        };
        self.record(now, origin, intent);
        if let Some(source) = self.slot(origin) {
            source.standby_at = Some(now);
        }
        StandbyOutcome { changed, counts }
    }

    fn record(&mut self, now: Instant, origin: Origin, intent: Intent) {
        let (timeout, recover_after, return_within) =
            (self.timeouts.of(origin), self.recover_after, self.return_within);
        if let Some(slot) = self.slot_mut(origin) {
            let before = *slot;
            // A source that is present without a command has no gap; a restored one was not received yet.
            let never = Duration::from_ticks(0);
            let (since, steady_before, was_lost) = match before {
                Some(source) if source.received && now < source.lost_at(timeout) => {
                    (source.since, source.steady_before, source.was_lost)
                }
                // The first command after a reset, within a short gap, changes nothing about an earlier loss. One that comes
                // within the timeout continues its earlier stream.
                Some(source) if !source.received && now < source.lost_at(timeout) + return_within => {
                    let steady = now <= source.last_rx.checked_add(timeout).unwrap_or(Instant::MAX)
                        && source.steady_before > never;
                    // It was resumed at `last_rx`.
                    let meanwhile = now.saturating_duration_since(source.last_rx);
                    let before = if steady { source.steady_before + meanwhile } else { never };
                    (now, before, source.was_lost)
                }
                // A steady stream survives one short gap.
                Some(source) => {
                    let steady = recovered(&source, recover_after);
                    (now, never, !steady || now >= source.lost_at(timeout) + return_within)
                }
                None => (now, never, false),
            };
            let silent_from = match (intent, before) {
                // "Present" is treated as silence from the first such command on.
                (Intent::Nothing, Some(Source { intent: Intent::Nothing, silent_from, .. })) => silent_from,
                (Intent::Nothing, Some(source)) => source.silent_from.min(now),
                (Intent::Nothing, None) => Instant::MIN,
                _ => now.checked_add(timeout).unwrap_or(Instant::MAX),
            };
            let period = before
                .map_or(Duration::from_ticks(0), |source| now.saturating_duration_since(source.last_rx));
            let period_before = before.map_or(Duration::from_ticks(0), |source| source.period);
            let standby_at = before.and_then(|source| source.standby_at);
            let last_commanded = match intent {
                Intent::Nothing => before.and_then(|source| source.last_commanded),
                _ => Some(now),
            };
            *slot = Some(Source {
                intent,
                last_rx: now,
                silent_from,
                since,
                steady_before,
                was_lost,
                period,
                period_before,
                standby_at,
                received: true,
                last_commanded,
                deferred: false,
            });
        }
    }

    /// Restores the source that was in control before a reset. A command since the reset is newer than the retained one.
    pub fn resume(&mut self, now: Instant, origin: Origin, restored: Restored) {
        let Restored { demand, was_lost, silent, steady } = restored;
        let left = self.timeouts.of(origin);
        let left = Duration::from_ticks(left.as_ticks().saturating_sub(silent.as_ticks()));
        match self.slot_mut(origin) {
            Some(Some(source)) => {
                source.was_lost |= was_lost;
                source.steady_before = steady;
            }
            Some(slot) => {
                *slot = Some(Source {
                    intent: Intent::Run(demand),
                    last_rx: now,
                    silent_from: now.checked_add(left).unwrap_or(Instant::MAX),
                    since: now,
                    steady_before: steady,
                    was_lost,
                    period: Duration::from_ticks(0),
                    period_before: Duration::from_ticks(0),
                    standby_at: None,
                    received: false,
                    last_commanded: None,
                    deferred: false,
                });
            }
            None => {}
        }
    }

    /// Turns every intent to run into standby, because the run has ended. The next standby of such a source is still a change.
    #[inline(never)]
    pub fn forget_runs(&mut self) {
        for source in self.sources.iter_mut().flatten() {
            if matches!(source.intent, Intent::Run(_)) {
                (source.intent, source.standby_at) = (Intent::Standby, None);
            }
        }
    }

    /// The source in control, and its intent.
    pub fn active(&self, now: Instant) -> Option<(Origin, Intent)> {
        let sources = Origin::SOURCES.into_iter().zip(&self.sources);
        let mut sources = sources.filter_map(|(origin, slot)| Some((origin, slot.as_ref()?)));
        sources.find(|(_, source)| self.may_control(now, source)).map(|(o, s)| (o, s.intent))
    }

    /// Whether this source is in control.
    pub fn in_control(&self, now: Instant, origin: Origin) -> bool {
        self.active(now).is_some_and(|(active_source, _)| active_source == origin)
    }

    /// A source of higher priority than this one that is in control.
    #[inline(never)]
    pub fn above(&self, now: Instant, origin: Origin) -> Option<Origin> {
        let (active_source, _) = self.active(now)?;
        (active_source.priority() > origin.priority()).then_some(active_source)
    }

    /// Last intent of a source, fresh or not.
    pub fn intent(&self, origin: Origin) -> Option<Intent> {
        self.source(origin).map(|source| source.intent)
    }

    /// Time of the last command of a source, of any kind.
    pub fn last_rx(&self, origin: Origin) -> Option<Instant> {
        self.source(origin).map(|source| source.last_rx)
    }

    /// Time from which a source is silent.
    pub fn silent_from(&self, origin: Origin) -> Option<Instant> {
        self.source(origin).map(|source| source.silent_from)
    }

    /// Time since which all sources have been silent, if they are: `Some(None)` if none was ever received.
    pub fn all_silent_from(&self, now: Instant) -> Option<Option<Instant>> {
        let latest = self.each().map(|source| source.silent_from).max();
        match latest {
            Some(latest) if latest > now => None,
            latest => Some(latest),
        }
    }

    /// Time of the last standby or run of any source since the node started.
    pub fn last_command(&self) -> Option<Instant> {
        self.each().filter_map(|source| source.last_commanded).max()
    }

    /// Time of the last standby or run of a source since the node started.
    #[inline(never)]
    pub fn last_commanded(&self, origin: Origin) -> Option<Instant> {
        self.source(origin).and_then(|source| source.last_commanded)
    }

    /// Its stream of commands without a gap, identified by its begin.
    pub fn stream(&self, origin: Origin) -> Option<Instant> {
        self.source(origin).map(|source| source.since)
    }

    /// Whether its last gap was a loss: it returns by a take-over.
    pub fn was_lost(&self, origin: Origin) -> bool {
        self.source(origin).is_some_and(|source| source.was_lost)
    }

    /// For how long a source that was lost has been received without a gap, resets included: zero if it is silent, and more than
    /// that from its first command on. `silent`: time without a command of any source, resets included; one that was not received
    /// since the node started keeps what it had for its timeout.
    pub fn steady_for(&self, now: Instant, origin: Origin, silent: Duration) -> Duration {
        let never = Duration::from_ticks(0);
        match self.source(origin).filter(|source| source.was_lost) {
            Some(source) if source.received && now < source.silent_from => {
                let received = source.steady_before + source.last_rx.saturating_duration_since(source.since);
                received.max(Duration::from_ticks(1))
            }
            // It was resumed at `last_rx`, and others may have been received since.
            Some(source)
                if !source.received
                    && silent.max(now.saturating_duration_since(source.last_rx))
                        < self.timeouts.of(origin) =>
            {
                source.steady_before
            }
            _ => never,
        }
    }

    /// Whether a source has commanded standby or a run since the node started.
    pub fn has_commanded(&self, origin: Origin) -> bool {
        self.last_commanded(origin).is_some()
    }

    /// The next timeout of a source. The source in control changes only then or with a command.
    pub fn deadline(&self, now: Instant) -> Option<Instant> {
        self.each().map(|source| source.silent_from).filter(|at| *at > now).min()
    }

    // By reference: it runs with interrupts off, at every frame.
    fn each(&self) -> impl Iterator<Item = &Source> {
        self.sources.iter().flatten()
    }

    #[inline(never)]
    fn source(&self, origin: Origin) -> Option<&Source> {
        self.sources.get(place(origin))?.as_ref()
    }

    fn slot_mut(&mut self, origin: Origin) -> Option<&mut Option<Source>> {
        self.sources.get_mut(place(origin))
    }

    fn slot(&mut self, origin: Origin) -> Option<&mut Source> {
        self.slot_mut(origin)?.as_mut()
    }

    fn may_control(&self, now: Instant, source: &Source) -> bool {
        let fresh = now < source.silent_from && source.intent != Intent::Nothing;
        fresh && (!source.was_lost || recovered(source, self.recover_after))
    }
}

impl Source {
    /// Time from which its next command follows a gap.
    fn lost_at(&self, timeout: Duration) -> Instant {
        match self.intent {
            // The second of two commands of standby may come exactly at the timeout.
            Intent::Nothing => {
                self.last_rx.checked_add(timeout + Duration::from_ticks(1)).unwrap_or(Instant::MAX)
            }
            _ => self.silent_from,
        }
    }
}

/// Place of an origin in [`Origin::SOURCES`]; the node has none there.
const fn place(origin: Origin) -> usize {
    Origin::SOURCES.len() - origin.priority() as usize
}

/// Whether it was received without a gap for `after`. The silence since does not count.
fn recovered(source: &Source, after: Duration) -> bool {
    source.last_rx.saturating_duration_since(source.since) + source.steady_before >= after
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_source_has_a_place_and_it_is_its_own() {
        for origin in Origin::ALL {
            assert_eq!(Origin::SOURCES.iter().position(|source| *source == origin), {
                let place = place(origin);
                (place < Origin::SOURCES.len()).then_some(place)
            });
        }
    }
}
