//! With all sources silent, an engine is at its fail-safe or stopped by a defined instant.

use super::case::{Case, Rule, is_above_fail_safe, seconds};
use super::control::{silences, to_fail_safe};
use crate::history::{Cause, Demanded, MS, PilotCommand, Reset, SECOND, Sent};
use sim::turbine::Phase;

/// Time from a new demand to the turbine's speed.
const SPIN_DOWN: u64 = 7 * SECOND;
/// Time from the fail-safe to standby, where no engine is known to run, and nothing else is configured.
const RUN_OUT: u64 = 10 * SECOND;
/// Longest time in which a node that was reset finds out what its engine does, besides `listen`.
const FINDS_OUT: u64 = 1500 * MS;
/// Resolution of the wire, 0.1 %.
const STEP: f64 = 8.0;

impl Case<'_> {
    pub(super) fn silence(&mut self) {
        let h = self.h;
        let rules = &h.rules;
        let stages = to_fail_safe(h) + 300 * MS;
        // A demand is lost long before the stages are over.
        for (from, to) in silences(h, rules.ages.into_iter().min().unwrap_or_default()) {
            self.no_rise_in_silence(from, to);
        }
        self.quick_resets();
        for (from, to) in silences(h, stages) {
            self.a_late_doubt_has_time(from, to);
            self.no_start_in_silence(from, to);
            self.standby_in_doubt(from, to);
            let wire = self.fail_safe_by(from, to, stages);
            // In doubt a demand does not reach the engine (ZK): standby does, when the stages have run out.
            let hidden = self.blind.union(&h.noise).union(&self.down);
            let doubt = hidden.touches(from.saturating_sub(2 * SECOND), wire.min(to));
            let doubtful = rules.standby_after.unwrap_or(10 * SECOND) + 2 * SECOND;
            let turbine = wire + SPIN_DOWN + if doubt { doubtful } else { 0 };
            // Until the ECU reports a running engine, it is the start throttle.
            let starts = h.samples(from, to).iter().any(|sample| !sample.runs() || sample.hidden);
            let safe = if starts { rules.fail_safe.max(rules.start_throttle) } else { rules.fail_safe };
            let lowest = |demanded| match demanded {
                Demanded::Throttle(tenths) => tenths <= safe + 6,
                Demanded::Rpm(rpm) => f64::from(rpm) <= rules.idle_rpm + 0.006 * rules.max_rpm,
            };
            if wire >= to {
                continue;
            }
            self.verdict.count("silences", 1);
            let first = h.frames.partition_point(|frame| frame.at < wire);
            let frames = h.frames[first..].iter().take_while(|frame| frame.at < to);
            let mut high =
                frames.filter(|frame| frame.sent.demand().is_some_and(|demanded| !lowest(demanded)));
            if let Some(frame) = high.next() {
                let demanded = frame.sent.demand().unwrap_or(Demanded::Throttle(0));
                let text = format!("{demanded} on the wire, all sources silent since {}", seconds(from));
                self.verdict.finding(Rule::SilentWire, frame.at, text);
            }
            // A ZK ECU from version 5 continues unchanged when the wire to it is cut, so only the wire is
            // judged.
            let deaf = h.deaf.union(&h.noise).touches(from.saturating_sub(2 * SECOND), turbine.min(to));
            if turbine >= to || deaf && rules.kind.continues_without_commands() || h.pwm.touches(from, to) {
                continue;
            }
            let share = f64::from(rules.fail_safe) / 1000.0;
            let most = rules.idle_rpm + (share + 0.04) * (rules.max_rpm - rules.idle_rpm);
            let fast = h.samples(turbine, to.min(turbine + 900 * SECOND)).iter().find(|sample| {
                sample.runs()
                    && sample.rpm > most
                    && !self.ecu_is_blind_to_us(sample.at)
                    && !self.just_started(sample.at)
            });
            if let Some(sample) = fast {
                let text = format!(
                    "the turbine has {:.0} rpm, all sources silent since {}",
                    sample.rpm,
                    seconds(from)
                );
                self.verdict.finding(Rule::SilentTurbine, sample.at, text);
            }
        }
    }

    /// An order to run whose engine has not reached running ends when the stages of loss have run out.
    fn no_start_in_silence(&mut self, from_us: u64, to_us: u64) {
        let h = self.h;
        let rules = &h.rules;
        let age = rules.ages.into_iter().max().unwrap_or_default();
        let ends = from_us + age + rules.hold + rules.standby_after.unwrap_or(RUN_OUT) + SECOND;
        let Some(frame) = h.first_run(ends, to_us) else { return };
        let ran = h
            .samples(from_us, frame.at)
            .iter()
            .any(|sample| matches!(sample.phase, Phase::Running | Phase::LearningIdle) || sample.hidden);
        if !ran && !self.down.touches(from_us, frame.at) && !h.pwm.touches(from_us, frame.at) {
            let text =
                format!("run for an engine that does not run, all sources silent since {}", seconds(from_us));
            self.verdict.finding(Rule::SilentWire, frame.at, text);
        }
    }

    /// A lost demand never rises, not even when its source is back, until the source has been received for long enough.
    fn no_rise_in_silence(&mut self, from_us: u64, to_us: u64) {
        let h = self.h;
        let rules = &h.rules;
        let Some(last) = h.commanded(from_us, from_us).iter().rev().find(|last| last.command.is_received())
        else {
            return;
        };
        let short = from_us + self.command_log.age(last.source) + rules.return_within + 300 * MS;
        let again = h.commanded(to_us, to_us).iter().all(|again| again.source == last.source);
        let changed = h.other_settings.first().is_some_and(|first| *first <= to_us);
        let recovers = if changed { rules.recover_after.min(300 * MS) } else { rules.recover_after };
        let alone = h
            .commanded(from_us.saturating_sub(30 * SECOND), from_us)
            .iter()
            .all(|other| other.source == last.source);
        // A source that was not alone may have taken over.
        let age = rules.ages.into_iter().max().unwrap_or_default();
        let age = if alone { self.command_log.age(last.source) } else { age };
        let lost = from_us + age + 2 * rules.period + 200 * MS;
        // After a reset a source that was lost stays lost, and the time for which it was received is retained in steps.
        let since = from_us.saturating_sub(2 * SECOND);
        let lost_at = |reset: &&Reset| reset.up > since && reset.down < to_us + recovers;
        let resets: Vec<&Reset> = h.resets.iter().filter(lost_at).collect();
        let steps = 2 * rules.period + 100 * MS + 300 * MS * resets.len() as u64;
        let until =
            if again && alone && to_us > short { to_us + recovers.saturating_sub(steps) } else { to_us };
        // Another source that comes meanwhile was not lost.
        let other = h.commanded(to_us, until).iter().find(|other| other.source != last.source);
        let until = other.map_or(until, |other| other.at);
        let retained =
            |reset: &&&Reset| reset.cause == Cause::Watchdog && reset.down > lost + rules.hold + 300 * MS;
        let retained = resets.iter().filter(retained).count();
        let hidden = self.blind.union(&h.noise).union(&h.deaf);
        let hidden = if retained == resets.len() { hidden } else { hidden.union(&self.down) };
        self.verdict.count("lost demands over a reset", u64::from(retained > 0 && until > to_us));
        // A source that is present but commands nothing is not lost.
        let present = h.commanded(from_us, to_us).iter().any(|other| other.command == PilotCommand::Nothing);
        // A reset in a start forgets whose run it was: whoever comes back is a new source.
        let starting = |reset: &&Reset| {
            let reported = reset.down.saturating_sub(self.two_states());
            h.samples(reported, reset.down).iter().any(|sample| !sample.runs())
        };
        let until = if resets.iter().any(starting) { to_us } else { until };
        if until <= lost || present || rules.governor || h.pwm.touches(since, until) {
            return;
        }
        let spared = rules.when_other_fails.is_some()
            && h.other_failed.touches(from_us.saturating_sub(8 * SECOND), until);
        let kind = |demanded: Demanded| core::mem::discriminant(&demanded);
        // The lowest since it was lost.
        let mut lowest: Option<(Demanded, f64)> = None;
        for frame in h.frames_within(lost, until) {
            let Some(demanded) = frame.sent.demand() else { continue };
            if spared || hidden.touches(since, frame.at) {
                return;
            }
            let share = self.share(demanded);
            let low = lowest.filter(|(last, _)| kind(*last) == kind(demanded)).map_or(share, |(_, low)| low);
            if lowest.replace((demanded, low.min(share))).is_none() {
                self.verdict.count("lost demands that may not rise", 1);
            }
            if share > low + STEP {
                let text =
                    format!("the demand rises to {demanded}, all sources silent since {}", seconds(from_us));
                return self.verdict.finding(Rule::SilentWire, frame.at, text);
            }
        }
    }

    /// From the third reset without a source on, the demand is at its fail-safe at once. The first one of the four may have been
    /// preceded by a command.
    fn quick_resets(&mut self) {
        let h = self.h;
        let rules = &h.rules;
        for resets in h.resets.windows(4) {
            let (first, last) = (resets[0], resets[3]);
            let since = first.down.saturating_sub(2 * SECOND);
            let ends = h.resets.iter().map(|reset| reset.down).find(|down| *down > last.up);
            let until = ends.unwrap_or(h.end).min(last.up + 2 * SECOND);
            let whole = resets.iter().all(|reset| reset.cause == Cause::Watchdog);
            if !whole
                || !h.commanded(first.down, until).is_empty()
                || rules.governor
                || !self.known_to_run(since)
                || !self.known_to_run(first.down)
                || h.pwm.touches(since, until)
            {
                continue;
            }
            self.verdict.count("third resets without a source", 1);
            let mut sent = h.frames_within(last.up, until).iter();
            let found = sent.find_map(|frame| {
                Some((frame.at, frame.sent.demand().filter(|sent| is_above_fail_safe(h, *sent))?))
            });
            if let Some((at, sent)) = found {
                let text =
                    format!("{sent} after the fourth reset since {} without a source", seconds(first.down));
                self.verdict.finding(Rule::SilentWire, at, text);
            }
        }
    }

    /// Where no standby is configured, a doubt that begins when the stages have long run out has 2 s to be confirmed.
    fn a_late_doubt_has_time(&mut self, from_us: u64, to_us: u64) {
        let h = self.h;
        if h.rules.standby_after.is_some() {
            return;
        }
        let late = from_us + to_fail_safe(h) + RUN_OUT + SECOND;
        let gaps = self.blind.iter().map(|(from, _)| from);
        let resets = h.resets.iter().map(|reset| reset.down);
        let begins =
            gaps.chain(resets).chain(h.forged.iter().copied()).filter(|at| (late..to_us).contains(at)).min();
        let hidden =
            [&self.blind, &self.down, &h.noise, &h.garbled, &self.faults, &self.stopped, &h.pwm, &h.deaf];
        let Some(at) = begins.filter(|at| self.known_to_run(*at)) else { return };
        let since = from_us.saturating_sub(4 * SECOND);
        let until = at + 1700 * MS;
        let other_state = h.samples(since, until).iter().any(|sample| sample.hidden);
        // After the third reset without a source it has none, nor without an order in memory.
        let resets = h.resets.iter().filter(|reset| (from_us..until).contains(&reset.down));
        let forgets = resets.clone().any(|reset| reset.cause != Cause::Watchdog);
        let resets = resets.count();
        if other_state
            || until > to_us
            || resets > 2
            || forgets
            || hidden.iter().any(|spans| spans.touches(since, at))
            || self.reduced(at)
        {
            return;
        }
        self.verdict.count("late doubts", 1);
        // An ECU without power put its engine out, and reports that once it is powered up.
        let powered = h.unpowered.iter().map(|(_, to)| to).find(|to| (at..until).contains(to));
        let until = powered.unwrap_or(until);
        if let Some(frame) = h.frames_within(at, until).iter().find(|frame| frame.sent.ends_a_run()) {
            let text =
                format!("{} at once, and the engine is in doubt since {} only", frame.sent, seconds(at));
            self.verdict.finding(Rule::ShutDown, frame.at, text);
        }
    }

    /// A ZK ECU that is not received gets standby when the stages of loss have run out.
    fn standby_in_doubt(&mut self, from_us: u64, to_us: u64) {
        let h = self.h;
        let rules = &h.rules;
        if self.traits().replies_only || h.pwm.touches(from_us.saturating_sub(60 * SECOND), to_us) {
            return;
        }
        let age = rules.ages.into_iter().max().unwrap_or_default();
        let stages = age + rules.hold + rules.standby_after.unwrap_or(RUN_OUT);
        for (begins, ends) in h.mute.iter().filter(|(begins, ends)| *ends > from_us && *begins < to_us) {
            let mut due = (from_us + stages).max(begins + self.gap()) + 3 * SECOND;
            let mut resets = 0;
            for reset in h.resets.iter().filter(|reset| reset.up > from_us) {
                if reset.down >= due {
                    break;
                }
                resets += 1;
                due += reset.up - reset.down + 400 * MS;
                // How long all have been silent is retained wherever the memory is.
                if reset.cause == Cause::PowerOn {
                    due = due.max(reset.up + rules.listen + stages + 3 * SECOND);
                }
            }
            let until = due + SECOND;
            let handed_over = h.commanded(0, from_us).iter().rev().take(2000);
            let handed_over = handed_over.clone().any(|commanded| commanded.command == PilotCommand::Pwm);
            if until > ends.min(to_us) || resets > 3 || handed_over || self.down.touches(due, until) {
                continue;
            }
            self.verdict.count("standbys in doubt", 1);
            let frames = h.frames_within(due, until);
            if !frames.iter().any(|frame| frame.sent.ends_a_run()) {
                let text = format!(
                    "no standby, nothing received of the engine since {}, all sources silent since {}",
                    seconds(begins),
                    seconds(from_us)
                );
                return self.verdict.finding(Rule::SilentWire, due, text);
            }
        }
    }

    /// It has just come up, perhaps with the start throttle.
    fn just_started(&self, at: u64) -> bool {
        self.h.samples(at.saturating_sub(SPIN_DOWN), at).iter().any(|sample| !sample.runs())
    }

    /// The wire to the ECU has just been cut or damaged: the ECU cannot have obeyed yet.
    fn ecu_is_blind_to_us(&self, at: u64) -> bool {
        let h = self.h;
        let hidden = h.deaf.touches(at.saturating_sub(SPIN_DOWN), at)
            || h.noise.touches(at.saturating_sub(SPIN_DOWN), at);
        hidden || self.down.touches(at.saturating_sub(SPIN_DOWN), at)
    }

    /// The last demand that reached the ECU is above the fail-safe.
    fn obeys_more(&self, at: u64) -> bool {
        let h = self.h;
        let before = h.frames[..h.frames.partition_point(|frame| frame.at < at)].iter().rev();
        let last = before.filter(|frame| frame.arrived).map(|frame| frame.sent);
        let last =
            last.filter(|sent| sent.demand().is_some() || sent.ends_a_run()).take(1).find_map(Sent::demand);
        match last {
            Some(Demanded::Throttle(tenths)) => tenths > h.rules.fail_safe + 6,
            Some(Demanded::Rpm(rpm)) => f64::from(rpm) > h.rules.idle_rpm + 0.006 * h.rules.max_rpm,
            None => false,
        }
    }

    /// The instant by which the demand is at the fail-safe. Up to three resets each add the time without a node and
    /// the time to find out; from the third on the node resumes there.
    fn fail_safe_by(&self, from_us: u64, to_us: u64, stages: u64) -> u64 {
        let rules = &self.h.rules;
        let finds_out = rules.listen + FINDS_OUT;
        let mut by = from_us + stages;
        let mut resets = 0;
        for reset in self.h.resets.iter().filter(|reset| reset.up > from_us && reset.down < to_us) {
            // A demand at the fail-safe stays there. A lower demand that did not reach the ECU, because the life is in doubt,
            // lowers nothing: a node without memory finds the old one and begins with it.
            if reset.down >= by && !(reset.cause == Cause::PowerOn && self.obeys_more(reset.down)) {
                break;
            }
            // Without memory the earlier resets do not count.
            resets = if reset.cause == Cause::PowerOn { 0 } else { resets + 1 };
            if resets > 3 {
                // It resumes at the fail-safe.
                by = by.min(reset.up + finds_out + 300 * MS);
                continue;
            }
            by += reset.up - reset.down.max(from_us) + finds_out;
            if reset.cause != Cause::Watchdog {
                // The retained state of a source is gone: the stages begin with a demand that belongs to no
                // source.
                by = by.max(reset.up + finds_out + stages);
            }
        }
        by
    }
}
