//! A run belongs to one life of an engine: an engine that burns again on the earlier order is no longer sent
//! run.

use super::case::{Case, Rule, seconds, spins_up};
use crate::history::{Cause, MS, Mark, SECOND, Sample, Spans};
use sim::turbine::Phase;

/// An instant from which a burning engine is in another life than that of its order, and the time by which a node knows it, if
/// the engine still burns then.
struct End {
    at: u64,
    known: Option<u64>,
    why: &'static str,
}

impl Case<'_> {
    /// A life has ended, and the engine burns: no run without a new start.
    pub(super) fn second_life(&mut self) {
        let h = self.h;
        let starts = self.pairs();
        let starts: Vec<u64> = starts.iter().map(|start| start.at).collect();
        let mut ends = self.restarts(&starts);
        ends.extend(self.gaps_in_starts());
        ends.extend(self.resets_in_starts());
        ends.extend(self.faults_in_starts(&starts));
        ends.sort_by_key(|end| end.at);
        let mut reported = 0;
        for End { at, known, why } in ends {
            // A run that ends early is correct.
            self.verdict.count(why, 1);
            let Some(known) = known.map(|known| known + 2 * h.rules.period + 50 * MS) else { continue };
            let next = starts.iter().copied().find(|start| *start > at).unwrap_or(u64::MAX);
            let burns = self.live.last_before(known).filter(|(_, out)| known < (*out).min(next));
            let Some((_, out)) = burns.filter(|_| known > reported && !h.pwm.touches(at, known)) else {
                continue;
            };
            if let Some(frame) = h.first_run(known, out.min(next)) {
                let text = format!("run, and the engine burns again: {why}, since {}", seconds(at));
                self.verdict.finding(Rule::SecondLife, frame.at, text);
                reported = known + 10 * SECOND;
            }
        }
    }

    /// The ECU reports that the engine starts, so that it can be in no other state.
    fn is_starting(&self, sample: &Sample) -> bool {
        spins_up(sample.phase) && !sample.fault && (self.traits().reports_stages || self.turns_slowly(sample))
    }

    /// As slowly as in a start.
    fn turns_slowly(&self, sample: &Sample) -> bool {
        sample.rpm < self.traits().slow * self.h.rules.idle_rpm
    }

    /// Time by which two reports have arrived of a state that holds from an instant on, if it still holds then; `None` if it does
    /// not hold, or something hides it.
    fn two_reports_of(&self, from: u64, holds: impl Fn(&Sample) -> bool) -> Option<Option<u64>> {
        let known = from + self.two_states();
        let samples = self.h.samples(from, known);
        let hidden = [&self.blind, &self.h.noise, &self.down];
        let begins = samples.first().is_some_and(&holds);
        let seen = begins && hidden.iter().all(|spans| !spans.touches(from, known));
        seen.then(|| samples.iter().all(&holds).then_some(known))
    }

    /// The engine was lit a second time, at an earlier stage of a start than the one reported before.
    fn restarts(&self, starts: &[u64]) -> Vec<End> {
        let h = self.h;
        let mut ends = Vec::new();
        for (index, (at, mark)) in h.marks.iter().enumerate() {
            let first = h.marks[..index].iter().rev().find(|(_, mark)| *mark != Mark::GivenUp);
            let Some((lit, _)) = first.filter(|_| *mark == Mark::Ignition) else { continue };
            // On the order of the first one.
            if starts.iter().any(|start| (lit..=at).contains(&start)) {
                continue;
            }
            // It was reported for long enough to be known.
            let later = |sample: &Sample| {
                matches!(sample.phase, Phase::FuelRamp | Phase::LearningIdle | Phase::Running)
                    && sample.lit
                    && !sample.fault
                    && !sample.hidden
            };
            let later = h.times(later).at_least(self.two_states() + SECOND);
            let reported = later.iter().filter(|(from, to)| from >= lit && to <= at).any(|(from, to)| {
                let hidden = [&self.blind, &h.noise, &self.down];
                // All AMT starts are one state until the engine has started up.
                let ran = self.traits().reports_stages
                    || h.samples(from, to).iter().all(|sample| sample.phase == Phase::Running);
                ran && hidden.iter().all(|spans| !spans.touches(from, to))
            });
            // From when its shaft speed is that of a start.
            let slow = h.samples(*at, at + 20 * SECOND).iter().find(|sample| self.turns_slowly(sample));
            let early = |sample: &Sample| {
                matches!(sample.phase, Phase::Ignition | Phase::Preheat)
                    && !sample.fault
                    && self.turns_slowly(sample)
            };
            // Earlier reports come first.
            let stale = h.rules.boot + h.rules.stale * self.one_state();
            let known = slow.and_then(|slow| self.two_reports_of(slow.at.max(at + stale), early));
            if let Some(known) = known.filter(|_| reported) {
                ends.push(End { at: *at, known, why: "engines that were lit again on one order" });
            }
        }
        ends
    }

    /// Nothing was received for longer than a gap, and after it the engine starts, or its ECU starts it
    /// again.
    fn gaps_in_starts(&self) -> Vec<End> {
        let gaps = self.blind.at_least(self.gap());
        let gaps: Vec<(u64, u64)> = gaps.iter().filter(|(from, _)| *from > 0).collect();
        let running = self.h.times(|sample| sample.phase == Phase::Running);
        let sets = if self.traits().rounds { self.h.rounds().0 } else { 1 };
        let end = |(from, to): (u64, u64)| {
            let stale = self.h.rules.stale * self.one_state();
            // Two reports that it runs may have come before the ECU lit it again.
            if running.within(to, to + stale) >= sets * self.h.rules.period {
                return None;
            }
            let known = self.two_reports_of(to + stale, |sample| self.is_starting(sample))?;
            let noise = self.h.noise.union(&self.down);
            let seen = !noise.touches(from.saturating_sub(SECOND), to);
            seen.then_some(End { at: from, known, why: "gaps in a start" })
        };
        gaps.into_iter().filter_map(end).collect()
    }

    /// The node was reset in a start.
    fn resets_in_starts(&self) -> Vec<End> {
        let end = |reset: &crate::history::Reset| {
            let known = self.two_reports_of(reset.up, |sample| self.is_starting(sample))?;
            (reset.cause == Cause::Watchdog).then_some(End {
                at: reset.down,
                known,
                why: "resets in a start",
            })
        };
        self.h.resets.iter().filter_map(end).collect()
    }

    /// Two error sets in a start that has not reached running.
    fn faults_in_starts(&self, starts: &[u64]) -> Vec<End> {
        let h = self.h;
        let faults = if self.traits().faults_hide_state { self.faults.clone() } else { Spans::default() };
        let end = |(from, to): (u64, u64)| {
            let start = *starts.iter().rev().find(|start| **start <= from)?;
            let known = from + 3 * h.rules.period + 50 * MS;
            let hidden = [&self.blind, &h.noise, &self.down];
            let seen = hidden.iter().all(|spans| !spans.touches(from.saturating_sub(SECOND), known));
            let ran = |sample: &Sample| matches!(sample.phase, Phase::Running | Phase::LearningIdle);
            let begun = self.live.contains(from) && !h.samples(start, known).iter().any(ran);
            // A node without memory takes a start whose shaft turns for a running engine.
            (seen && begun && !h.forgets(start, from)).then_some(End {
                at: from,
                known: (known <= to).then_some(known),
                why: "error sets in a start",
            })
        };
        faults.iter().filter_map(end).collect()
    }
}
