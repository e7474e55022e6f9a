//! What lowers a demand has to lower it: limits, another engine that has failed, a source that has yet to take over.

use super::{Case, Rule, Voices, seconds};
use crate::history::{Ask, MS, SECOND, Said, Sample, Spans, Switch, Word};

/// Beyond a limit by so much, for so long, an ECU has reported it twice: °C, rpm.
const BEYOND: f64 = 12.0;
const BEYOND_RPM: f64 = 2500.0;
const REPORTED: u64 = 3 * SECOND;
/// Resolution of the wire, 0.1 %.
const STEP: f64 = 8.0;

impl Case<'_> {
    /// The demand on the wire, and whether it is told run, at an instant.
    fn told_at(&self, at: u64) -> (Option<Ask>, Option<Switch>) {
        let frames = &self.h.frames[..self.h.frames.partition_point(|frame| frame.at <= at)];
        let recent = || frames.iter().rev().take(64).take_while(|frame| frame.at + 2 * SECOND > at);
        (recent().find_map(|frame| frame.told.demand()), recent().find_map(|frame| frame.told.switch()))
    }

    pub(super) fn limits(&mut self) {
        let rules = self.h.rules;
        if let Some((egt, standby)) = rules.limit_egt {
            self.limit(standby, "the exhaust", |sample| sample.egt > egt + BEYOND);
        }
        if let Some((rpm, standby)) = rules.limit_rpm {
            self.limit(standby, "the shaft speed", |sample| sample.rpm > rpm + BEYOND_RPM);
        }
        if let Some(standby) = rules.limit_fault {
            self.limit(standby, "the ECU's fault", |sample| sample.fault);
        }
    }

    /// A limit that was passed for long enough has its action on the wire.
    fn limit(&mut self, standby: bool, what: &str, beyond: impl Fn(&Sample) -> bool) {
        let rules = self.h.rules;
        let fall = 1000 * SECOND / u64::from(rules.ramp.min(rules.slew_down.unwrap_or(rules.ramp)).max(1));
        let acts = REPORTED + if standby { SECOND } else { fall + SECOND };
        let hidden =
            self.blind.union(&self.h.noise).union(&self.down).union(&self.h.sensor).longer(2 * SECOND);
        let passed = self.h.times(|sample| sample.runs() && beyond(sample));
        for (from, to) in passed.at_least(acts).iter() {
            let at = from + acts;
            if hidden.touches(from.saturating_sub(SECOND), at + 1)
                || self.h.pwm.contains(at)
                || !self.runs.contains(at)
            {
                continue;
            }
            let (demand, switch) = self.told_at(at);
            let high = match demand {
                Some(Ask::Throttle(tenths)) => f64::from(tenths) > f64::from(rules.fail_safe) + STEP,
                Some(Ask::Rpm(rpm)) => f64::from(rpm) > rules.idle_rpm + 0.006 * rules.max_rpm,
                None => false,
            };
            let wrong = switch == Some(Switch::Run) && (standby || high);
            if wrong {
                let text = format!(
                    "{what} is beyond its limit since {} until {}, and {demand:?} is on the wire",
                    seconds(from),
                    seconds(to)
                );
                self.verdict.finding(Rule::Limit, at, text);
            }
        }
    }

    /// While another engine has failed, the demand is reduced, where that is configured.
    pub(super) fn reduction(&mut self) {
        let h = self.h;
        let Some(part) = h.rules.when_other_fails else { return };
        let rules = &h.rules;
        let fall = 1000 * SECOND / u64::from(rules.ramp.min(rules.slew_down.unwrap_or(rules.ramp)).max(1));
        let (mut reported, mut judged) = (0, 0);
        for frame in &h.frames {
            let at = frame.at;
            let Some(ask) = frame.told.demand() else { continue };
            let failed =
                h.other_down.last_before(at).filter(|(from, to)| at < *to && at > from + fall + SECOND);
            if failed.is_none()
                || at < reported
                || self.down.touches(at.saturating_sub(fall + 3 * SECOND), at)
            {
                continue;
            }
            // Nobody asked for more within the time that the stages of loss last.
            let lately =
                h.said(at.saturating_sub(8 * SECOND), at).iter().filter_map(|said| match said.word {
                    Word::Run(asked) if core::mem::discriminant(&asked) == core::mem::discriminant(&ask) => {
                        Some(self.share(asked))
                    }
                    _ => None,
                });
            let most = lately.fold(0.0, f64::max) * f64::from(part) / 1000.0;
            let idle = match ask {
                Ask::Throttle(_) => 0.0,
                Ask::Rpm(_) => rules.idle_rpm / rules.max_rpm * 1000.0,
            };
            if most == 0.0 || !self.known_to_run(at) {
                continue;
            }
            if let Some((from, _)) = failed
                && core::mem::replace(&mut judged, from) != from
            {
                self.verdict.count("reductions", 1);
            }
            if self.share(ask) > most.max(idle) + STEP {
                let text = format!(
                    "{ask} on the wire while another engine has failed, {:.1} % at most",
                    most / 10.0
                );
                self.verdict.finding(Rule::Reduction, at, text);
                reported = at + 10 * SECOND;
            }
        }
    }

    /// A source that takes over is held off until its demand is close to the one in force, or it has waited.
    pub(super) fn take_over(&mut self) {
        let h = self.h;
        let rules = &h.rules;
        if rules.takeover < SECOND || rules.governor {
            return;
        }
        let hidden = self.blind.union(&h.noise).union(&self.down).longer(3 * SECOND);
        for said in &h.said {
            let (Word::Run(Ask::Throttle(wanted)), at) = (said.word, said.at) else { continue };
            // Its first word for long, with a lower source in control, well away from its demand.
            let first = self.voices.until(said.source, at.saturating_sub(1)).last();
            let long = first.is_none_or(|(when, _)| at > when + self.voices.age(said.source) + 12 * SECOND);
            if !long || !self.known_to_run(at) {
                continue;
            }
            let until = at + rules.takeover - 150 * MS;
            let Some((lower, Ask::Throttle(held))) = self.voices.run_in_control(at - 1) else { continue };
            let since = self.voices.speaks_since(lower, at - 1);
            let settled = 1000 * SECOND / u64::from(rules.rise.min(rules.slew_up.unwrap_or(rules.rise)));
            let settled = rules.recover_after + rules.takeover + settled + 4 * SECOND;
            // Both say the same until the wait is over.
            let same = |source: usize, tenths: u32, from: u64| {
                let words = self.voices.until(source, until);
                let words = &words[words.partition_point(|(when, _)| *when < from)..];
                !words.is_empty() && words.iter().all(|(_, word)| *word == Word::Run(Ask::Throttle(tenths)))
            };
            // The one that is taken over from is not lost meanwhile: its demand would fall.
            let steady = since.is_some_and(|since| since + settled < at)
                && self.voices.speaks_since(lower, until) == since
                && same(lower, held, at.saturating_sub(settled))
                && same(said.source, wanted, at)
                && lower > said.source
                && self.voices.run_in_control(until).is_some_and(|(source, _)| source == said.source)
                && wanted.abs_diff(held) > 120
                && h.said(at.saturating_sub(settled), until).iter().all(|other| {
                    other.source == lower || other.source == said.source || !other.word.is_heard()
                });
            if !steady
                || hidden.touches(at.saturating_sub(SECOND), until)
                || h.other_failed.touches(at, until)
            {
                continue;
            }
            self.verdict.count("take-overs", 1);
            let (Some(Ask::Throttle(told)), Some(Switch::Run)) = self.told_at(until) else { continue };
            let (Some(Ask::Throttle(before)), _) = self.told_at(at - 1) else { continue };
            if told.abs_diff(before) > 8 && before.abs_diff(held) <= 8 {
                let text = format!(
                    "source {} takes over at {} with {wanted}, and {told} is on the wire after {before}",
                    said.source,
                    seconds(at)
                );
                self.verdict.finding(Rule::TakeOver, until, text);
            }
        }
    }
}

/// When another engine has failed for sure: it ran, nobody told it to stop, and it went out.
pub fn failed_for_sure(other: &crate::history::History) -> Spans {
    let mut spans = Spans::default();
    let voices = Voices::new(other);
    let runs = other.times(|sample| sample.runs());
    for (_, out) in runs.iter() {
        // Standby below somebody who says otherwise changes nothing.
        let stops = |said: &&Said| match said.word {
            Word::Standby => voices.in_control(said.at).is_none_or(|(source, _)| source >= said.source),
            word => matches!(word, Word::ShutDown | Word::Stop | Word::Ctf | Word::Disarm),
        };
        let said = other.said(out.saturating_sub(10 * SECOND), other.end);
        let ends = said.iter().find(stops).map_or(other.end, |said| said.at);
        let reset = other.resets.iter().find(|reset| reset.up > out.saturating_sub(5 * SECOND));
        let ends = ends.min(reset.map_or(u64::MAX, |reset| reset.down));
        let again = other.marks.iter().find(|(at, _)| *at > out).map_or(u64::MAX, |(at, _)| *at);
        let silent = other.said(0, out).iter().rev().find(|said| said.word.is_heard());
        let commanded =
            silent.is_some_and(|said| matches!(said.word, Word::Run(_)) && out < said.at + SECOND);
        // Nor did the stages of loss, or a limit.
        let frames = &other.frames[..other.frames.partition_point(|frame| frame.at < out)];
        let told = frames.iter().rev().find_map(|frame| frame.told.switch().map(|switch| (frame.at, switch)));
        let commanded = commanded && told.is_some_and(|(at, told)| told == Switch::Run && out < at + SECOND);
        let from = out + 8 * SECOND;
        // Nor do they shut it down before a failure has shown.
        let mut silences = super::control::silences(other, SECOND).into_iter();
        let commanded = commanded && !silences.any(|(silent, until)| silent < from && until > out);
        let hidden = other.mute.union(&other.noise).union(&other.unpowered);
        if commanded && from < ends.min(again) && !hidden.touches(out.saturating_sub(SECOND), from) {
            spans.push(from, ends.min(again));
        }
    }
    spans
}
