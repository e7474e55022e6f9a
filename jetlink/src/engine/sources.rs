//! Who is in control: any number of sources with a fixed priority, each with its own age limit.
//!
//! The highest source that is fresh and wants something is in control. A source that was lost has to speak for a while
//! without a gap before it is again, so that one that flaps neither resets the stages of loss nor makes the engine hunt. A
//! short gap in a steady stream is no loss.

use super::config::{SourceAges, Supervision};
use crate::command::{Demand, Origin};
use embassy_time::{Duration, Instant};

/// Two words of standby count as one order within this at most, however slow a source is.
const TWO_WORDS_MAX: Duration = Duration::from_secs(10);

/// What a source wants.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Intent {
    /// It is present and wants nothing: not in control.
    Nothing,
    Standby,
    Run(Demand),
}

/// What one word of standby is.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct StandbyWord {
    /// The source wanted something else before, or was silent.
    pub changed: bool,
    /// It counts.
    pub counts: bool,
}

#[derive(Clone, Copy, Debug)]
struct Source {
    intent: Intent,
    heard: Instant,
    /// It counts as silent from then on, unless it speaks.
    silent_from: Instant,
    /// Without a gap since then.
    since: Instant,
    /// It was lost before.
    was_lost: bool,
    /// Between its last two words, and between the two before.
    period: Duration,
    period_before: Duration,
    /// Its last word was standby, given then.
    standby_at: Option<Instant>,
    /// It has spoken since the node started; otherwise it was resumed.
    received: bool,
    /// When it last wanted something, since the node started.
    wanted: Option<Instant>,
}

/// All sources of one engine.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sources {
    ages: SourceAges,
    recover_after: Duration,
    return_within: Duration,
    /// In the order of [`Origin::SOURCES`]: highest priority first.
    sources: [Option<Source>; Origin::SOURCES.len()],
}

impl Sources {
    pub const fn new(config: &Supervision) -> Self {
        Self {
            ages: config.ages,
            recover_after: config.recover_after,
            return_within: config.return_within,
            sources: [None; Origin::SOURCES.len()],
        }
    }

    /// New settings. A timeout counts from the next command of its source on.
    pub const fn configure(&mut self, config: &Supervision) {
        (self.ages, self.recover_after, self.return_within) =
            (config.ages, config.recover_after, config.return_within);
    }

    /// A source says what it wants.
    pub fn heard(&mut self, now: Instant, origin: Origin, intent: Intent) {
        self.speak(now, origin, intent);
        if let Some(source) = self.slot(origin) {
            source.standby_at = None;
        }
    }

    /// A source asks for a run that cannot be done just now: it is there, and its run of before goes on.
    pub fn stays(&mut self, now: Instant, origin: Origin, demand: Demand) {
        let before = self.source(origin).filter(|source| now < source.silent_from);
        let before = before.map(|source| source.intent).filter(|intent| matches!(intent, Intent::Run(_)));
        self.heard(now, origin, before.unwrap_or(Intent::Run(demand)));
    }

    /// A source says standby. To an engine that has reached running the first of two words changes nothing.
    pub fn standby(&mut self, now: Instant, origin: Origin, two_words: bool) -> StandbyWord {
        let age = self.ages.of(origin);
        let before = self.slot(origin).copied();
        let fresh = before.is_some_and(|source| now < source.silent_from);
        let changed = !fresh || before.is_some_and(|source| source.intent != Intent::Standby);
        // Two of its own periods, if that is longer.
        // An outage is no period: two that follow one another are.
        let period = |source: Source| source.period.min(source.period_before);
        let within = before.map_or(age, |source| age.max((period(source) * 2).min(TWO_WORDS_MAX)));
        let second = before.and_then(|source| source.standby_at).is_some_and(|at| now <= at + within);
        let counts = second || !two_words;
        let intent = match before {
            _ if counts => Intent::Standby,
            Some(source) if fresh => source.intent,
            _ => Intent::Nothing,
        };
        self.speak(now, origin, intent);
        if let Some(source) = self.slot(origin) {
            source.standby_at = Some(now);
        }
        StandbyWord { changed, counts }
    }

    fn speak(&mut self, now: Instant, origin: Origin, intent: Intent) {
        let (age, recover_after, return_within) =
            (self.ages.of(origin), self.recover_after, self.return_within);
        for (place, slot) in Origin::SOURCES.into_iter().zip(&mut self.sources) {
            if place != origin {
                continue;
            }
            let before = *slot;
            // One that is present and wants nothing speaks without a gap; one that was resumed has not spoken yet.
            let (since, was_lost) = match before {
                Some(source) if now < source.lost_at(age) => (source.since, source.was_lost),
                // The first word after a reset, within a short gap: what was lost before it stays lost, and nothing else is.
                Some(source) if !source.received && now < source.lost_at(age) + return_within => {
                    (now, source.was_lost)
                }
                // A steady stream with one short gap goes on.
                Some(source) => {
                    let steady = recovered(&source, recover_after);
                    (now, !steady || now >= source.lost_at(age) + return_within)
                }
                None => (now, false),
            };
            let silent_from = match (intent, before) {
                // Wanting nothing counts as silence from the first such word on.
                (Intent::Nothing, Some(Source { intent: Intent::Nothing, silent_from, .. })) => silent_from,
                (Intent::Nothing, Some(source)) => source.silent_from.min(now),
                (Intent::Nothing, None) => now,
                _ => now.checked_add(age).unwrap_or(Instant::MAX),
            };
            let period =
                before.map_or(Duration::from_ticks(0), |source| now.saturating_duration_since(source.heard));
            let period_before = before.map_or(Duration::from_ticks(0), |source| source.period);
            let standby_at = before.and_then(|source| source.standby_at);
            let wanted = match intent {
                Intent::Nothing => before.and_then(|source| source.wanted),
                _ => Some(now),
            };
            *slot = Some(Source {
                intent,
                heard: now,
                silent_from,
                since,
                was_lost,
                period,
                period_before,
                standby_at,
                received: true,
                wanted,
            });
        }
    }

    /// After a reset: who was in control before, silent for `silent` by then. What it has said since, while the node
    /// listened, is newer than what was retained.
    pub fn resume(&mut self, now: Instant, origin: Origin, demand: Demand, was_lost: bool, silent: Duration) {
        let left = self.ages.of(origin);
        let left = Duration::from_ticks(left.as_ticks().saturating_sub(silent.as_ticks()));
        match self.slot_mut(origin) {
            Some(Some(source)) => source.was_lost |= was_lost,
            Some(slot) => {
                *slot = Some(Source {
                    intent: Intent::Run(demand),
                    heard: now,
                    silent_from: now.checked_add(left).unwrap_or(Instant::MAX),
                    since: now,
                    was_lost,
                    period: Duration::from_ticks(0),
                    period_before: Duration::from_ticks(0),
                    standby_at: None,
                    received: false,
                    wanted: None,
                });
            }
            None => {}
        }
    }

    /// Forgets what a source wanted, because it did not come to pass.
    pub fn forget_runs(&mut self) {
        for source in self.sources.iter_mut().flatten() {
            source.intent = match source.intent {
                Intent::Run(_) => Intent::Standby,
                intent => intent,
            };
        }
    }

    /// The source in control, and what it wants.
    pub fn active(&self, now: Instant) -> Option<(Origin, Intent)> {
        self.each().find(|(_, source)| self.may_rule(now, source)).map(|(o, s)| (o, s.intent))
    }

    /// Whether this source is in control.
    pub fn in_control(&self, now: Instant, origin: Origin) -> bool {
        self.active(now).is_some_and(|(ruler, _)| ruler == origin)
    }

    /// A source of higher priority than this one that is in control.
    pub fn above(&self, now: Instant, origin: Origin) -> Option<Origin> {
        let (ruler, _) = self.active(now)?;
        (ruler.priority() > origin.priority()).then_some(ruler)
    }

    /// What a source wanted last, fresh or not.
    pub fn intent(&self, origin: Origin) -> Option<Intent> {
        self.source(origin).map(|source| source.intent)
    }

    /// When a source last spoke.
    pub fn last_rx(&self, origin: Origin) -> Option<Instant> {
        self.source(origin).map(|source| source.heard)
    }

    /// From when on a source counts as silent.
    pub fn silent_from(&self, origin: Origin) -> Option<Instant> {
        self.source(origin).map(|source| source.silent_from)
    }

    /// Since when every source has been silent, if they are.
    pub fn all_silent_from(&self, now: Instant) -> Option<Option<Instant>> {
        let latest = self.each().map(|(_, source)| source.silent_from).max();
        match latest {
            Some(latest) if latest > now => None,
            latest => Some(latest),
        }
    }

    /// When any source last wanted something, since the node started.
    pub fn last_word(&self) -> Option<Instant> {
        self.each().filter_map(|(_, source)| source.wanted).max()
    }

    /// When a source last wanted something, since the node started.
    pub fn last_wanted(&self, origin: Origin) -> Option<Instant> {
        self.source(origin).and_then(|source| source.wanted)
    }

    /// Its last gap was a loss: it comes back by a take-over.
    pub fn was_lost(&self, origin: Origin) -> bool {
        self.source(origin).is_some_and(|source| source.was_lost)
    }

    /// Whether any source has spoken since the node started.
    pub fn any_received(&self) -> bool {
        self.each().any(|(_, source)| source.received)
    }

    /// Whether a source has wanted something since the node started.
    pub fn has_wanted(&self, origin: Origin) -> bool {
        self.last_wanted(origin).is_some()
    }

    /// The next instant at which a source is lost. One comes to be in control only when it speaks, or when that happens.
    pub fn deadline(&self, now: Instant) -> Option<Instant> {
        self.each().map(|(_, source)| source.silent_from).filter(|at| *at > now).min()
    }

    fn each(&self) -> impl Iterator<Item = (Origin, Source)> {
        Origin::SOURCES.into_iter().zip(self.sources).filter_map(|(origin, slot)| Some((origin, slot?)))
    }

    fn source(&self, origin: Origin) -> Option<Source> {
        self.each().find(|(place, _)| *place == origin).map(|(_, source)| source)
    }

    fn slot_mut(&mut self, origin: Origin) -> Option<&mut Option<Source>> {
        Origin::SOURCES
            .into_iter()
            .zip(&mut self.sources)
            .find(|(place, _)| *place == origin)
            .map(|(_, slot)| slot)
    }

    fn slot(&mut self, origin: Origin) -> Option<&mut Source> {
        self.slot_mut(origin)?.as_mut()
    }

    fn may_rule(&self, now: Instant, source: &Source) -> bool {
        let fresh = now < source.silent_from && source.intent != Intent::Nothing;
        fresh && (!source.was_lost || recovered(source, self.recover_after))
    }
}

impl Source {
    /// When its last word is too old for the next one to follow without a gap.
    fn lost_at(&self, age: Duration) -> Instant {
        match self.intent {
            // The second of two words of standby may come just within the age limit.
            Intent::Nothing => self.heard.checked_add(age + Duration::from_ticks(1)).unwrap_or(Instant::MAX),
            _ => self.silent_from,
        }
    }
}

/// It has spoken without a gap for so long: the silence since does not count.
fn recovered(source: &Source, after: Duration) -> bool {
    source.heard >= source.since + after
}
