//! Who rules: any number of sources with a fixed priority, each with its own age limit.
//!
//! The highest source that is fresh rules. A source that was lost has to speak for a while without a gap before it
//! rules again, so that one that flaps neither resets the stages of loss nor makes the engine hunt.

use super::config::{SourceAges, Supervision};
use crate::command::{Demand, Origin};
use embassy_time::{Duration, Instant};

/// What a source wants.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Intent {
    Standby,
    Run(Demand),
}

#[derive(Clone, Copy, Debug)]
struct Source {
    intent: Intent,
    heard: Instant,
    /// Without a gap since then.
    since: Instant,
    /// It was lost before.
    was_lost: bool,
}

/// All sources of one engine.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sources {
    ages: SourceAges,
    recover_after: Duration,
    /// In the order of [`Origin::SOURCES`]: highest priority first.
    sources: [Option<Source>; Origin::SOURCES.len()],
}

impl Sources {
    pub const fn new(config: &Supervision) -> Self {
        Self {
            ages: config.ages,
            recover_after: config.recover_after,
            sources: [None; Origin::SOURCES.len()],
        }
    }

    /// A source speaks.
    pub fn heard(&mut self, now: Instant, origin: Origin, intent: Intent) {
        let age = self.ages.of(origin);
        for (place, slot) in Origin::SOURCES.into_iter().zip(&mut self.sources) {
            if place == origin {
                let gap = slot.is_none_or(|source| now >= source.heard + age);
                let (since, was_lost) = match *slot {
                    Some(source) if !gap => (source.since, source.was_lost),
                    Some(_) => (now, true),
                    None => (now, false),
                };
                *slot = Some(Source { intent, heard: now, since, was_lost });
            }
        }
    }

    /// After a reset: who ruled before, as if it had just spoken. What it has said since, while the node listened, is newer
    /// than what was kept. It has to speak again within its age limit, and if it was lost, for as long as any that was.
    pub fn resume(&mut self, now: Instant, origin: Origin, demand: Demand, was_lost: bool) {
        for (place, slot) in Origin::SOURCES.into_iter().zip(&mut self.sources) {
            if place == origin {
                let intent = slot.map_or(Intent::Run(demand), |source| source.intent);
                *slot = Some(Source { intent, heard: now, since: now, was_lost });
            }
        }
    }

    /// Forgets what a source wanted, because it did not come to pass.
    pub fn forget_runs(&mut self) {
        for source in self.sources.iter_mut().flatten() {
            source.intent = Intent::Standby;
        }
    }

    /// The highest fresh source that may rule, and what it wants.
    pub fn ruler(&self, now: Instant) -> Option<(Origin, Intent)> {
        self.each().find(|(origin, source)| self.may_rule(now, *origin, source)).map(|(o, s)| (o, s.intent))
    }

    /// A source of higher priority than this one that rules.
    pub fn above(&self, now: Instant, origin: Origin) -> Option<Origin> {
        let (ruler, _) = self.ruler(now)?;
        (ruler.priority() > origin.priority()).then_some(ruler)
    }

    /// What a source wanted last, fresh or not.
    pub fn intent(&self, origin: Origin) -> Option<Intent> {
        self.each().find(|(place, _)| *place == origin).map(|(_, source)| source.intent)
    }

    /// When a source last spoke.
    pub fn last_heard(&self, origin: Origin) -> Option<Instant> {
        self.each().find(|(place, _)| *place == origin).map(|(_, source)| source.heard)
    }

    /// The next instant at which a source is lost. One comes to rule only when it speaks, or when that happens.
    pub fn deadline(&self, now: Instant) -> Option<Instant> {
        self.each()
            .filter_map(|(origin, source)| source.heard.checked_add(self.ages.of(origin)))
            .filter(|at| *at > now)
            .min()
    }

    fn each(&self) -> impl Iterator<Item = (Origin, Source)> {
        Origin::SOURCES.into_iter().zip(self.sources).filter_map(|(origin, slot)| Some((origin, slot?)))
    }

    fn may_rule(&self, now: Instant, origin: Origin, source: &Source) -> bool {
        let fresh = now < source.heard + self.ages.of(origin);
        // It has spoken for so long: the silence since does not count.
        let steady = !source.was_lost || source.heard >= source.since + self.recover_after;
        fresh && steady
    }
}
