//! What the demand may be during a start, how fast it may fall, and how long such orders last.

use super::case::{Case, Rule, seconds, spins_up};
use crate::history::{Cause, Demanded, MS, Mark, PilotCommand, Reset, SECOND, Sample, Sent, Switch};
use sim::turbine::Phase;
use std::collections::BTreeSet;

/// Resolution of the wire, 0.1 %.
const STEP: f64 = 8.0;

/// ZK's version from which its ECU reports how long its last start took.
const REPORTS_STARTS: u8 = 4;

impl Case<'_> {
    /// Until the ECU reports a running engine, the demand is idle, or the start throttle.
    pub(super) fn start_throttle(&mut self) {
        let h = self.h;
        let most = f64::from(h.rules.start_throttle.max(h.rules.idle_band)) + STEP;
        // Time in which the end of a run was hidden counts as part of it.
        let flight = self.runs.union(&h.noise).longer(6 * SECOND);
        let mut reported = 0;
        for frame in &h.frames {
            let (at, Sent::Full(Switch::Run, tenths)) = (frame.at, frame.sent) else { continue };
            if at < reported || f64::from(tenths) <= most || h.pwm.contains(at) {
                continue;
            }
            let since = at.saturating_sub(h.rules.period + 150 * MS);
            let Some((lit, out)) = self.live.last_before(since) else { continue };
            // A start by the ECU itself, or right after another start, continues at the demand that it had.
            let again =
                h.marks.iter().any(|(when, mark)| *mark == Mark::Relight && (lit..=at).contains(when));
            let samples = h.samples(lit, at);
            let before =
                flight.last_before(at).is_some_and(|(from, to)| to > lit && self.runs.touches(from, at));
            let forged = h.forged.iter().any(|forged| (lit..at).contains(forged));
            if at >= out
                || again
                || before
                || forged
                || self.faults.touches(lit, at)
                || h.noise.touches(lit, at)
                || !samples.iter().all(|sample| spins_up(sample.phase) && !sample.hidden)
            {
                continue;
            }
            let text = format!("{} for an engine that starts", frame.sent);
            self.verdict.finding(Rule::Rate, at, text);
            reported = at + 10 * SECOND;
        }
    }

    /// A demand falls at the configured rate, if there is one, for a source that is in control and stays so.
    pub(super) fn fall(&mut self) {
        let h = self.h;
        let Some(rate) = h.rules.slew_down.filter(|_| !h.rules.governor) else { return };
        let hidden = self.blind.union(&h.noise).union(&self.down).union(&h.deaf);
        let falls_in = |time: u64| f64::from(rate) * time as f64 / SECOND as f64;
        // A frame's content was computed up to a slot before it began. This counts once, however long the
        // demand falls.
        let slack = falls_in(h.rules.period + 20 * MS) + STEP;
        // How far the demand may have fallen by now from the highest one that was on the wire.
        let mut before: Option<(u64, f64)> = None;
        let mut falling = 0;
        for frame in &h.frames {
            let (at, Sent::Full(Switch::Run, tenths)) = (frame.at, frame.sent) else {
                before = before.filter(|_| frame.sent.switch().is_none_or(|switch| switch == Switch::Run));
                continue;
            };
            let share = f64::from(tenths);
            let near = before.filter(|(when, _)| at - when <= 3 * h.rules.period);
            let least = near.map_or(share, |(when, least)| least - falls_in(at - when));
            let fast = share + slack < least;
            falling += u64::from(near.is_some_and(|(_, before)| share < before));
            before = Some((at, if fast { share } else { least.max(share) }));
            if !fast {
                continue;
            }
            let since = at.saturating_sub(6 * SECOND);
            let commands = h.commanded(since, at);
            let first = commands.first().map(|commanded| commanded.source);
            // One source, and nothing but throttles.
            let alone = commands.iter().all(|commanded| {
                let throttle = matches!(commanded.command, PilotCommand::Run(Demanded::Throttle(_)));
                Some(commanded.source) == first && (throttle || commanded.command == PilotCommand::Arm)
            });
            let fresh = |source| self.command_log.commands_throughout(source, since, at);
            if alone
                && first.is_some_and(fresh)
                && self.known_to_run(since)
                && self.runs.contains(at)
                && !self.reduced(at)
                && !hidden.touches(since, at)
            {
                let [low, least] = [tenths, least as u32].map(Demanded::Throttle);
                let text = format!("the demand falls to {low}, and is to be {least} at least");
                self.verdict.finding(Rule::Rate, at, text);
            }
        }
        self.verdict.count("frames that fall at slew.down", falling);
    }

    /// A governor stays within its authority.
    pub(super) fn authority(&mut self) {
        let h = self.h;
        for frame in h.frames.iter().filter(|_| h.rules.governor) {
            let Sent::Full(Switch::Run, tenths) = frame.sent else { continue };
            // A node that has forgotten its demand continues with the throttle that it finds, until a source takes over.
            let taken = frame.at.saturating_sub(8 * SECOND + h.rules.recover_after + h.rules.takeover);
            let forgets =
                |reset: &Reset| reset.cause != Cause::Watchdog && (taken..=frame.at).contains(&reset.up);
            if tenths > h.rules.authority + STEP as u32
                && self.governed(frame.at)
                && !self.refuses_rpm(frame.at)
                && !h.resets.iter().any(forgets)
                && self.known_to_run(frame.at)
            {
                let text = format!(
                    "{} of a governor that may give {}",
                    frame.sent,
                    Demanded::Throttle(h.rules.authority)
                );
                return self.verdict.finding(Rule::HeldUp, frame.at, text);
            }
        }
    }

    /// CTF is sent until standby or a stop, whatever demand is commanded, and a reset does not take it back.
    pub(super) fn ctf(&mut self) {
        let h = self.h;
        let mut since = None;
        for frame in &h.frames {
            match frame.sent {
                Sent::Ctf => since = Some(frame.at),
                Sent::Full(Switch::Standby | Switch::Stop, _) => since = None,
                Sent::Full(Switch::Run, _) => {
                    let Some(from) = since.take() else { continue };
                    let ended = h.commanded(from.saturating_sub(SECOND), frame.at).iter().any(|commanded| {
                        matches!(
                            commanded.command,
                            PilotCommand::Standby | PilotCommand::ShutDown | PilotCommand::Stop
                        )
                    });
                    let lost = h
                        .resets
                        .iter()
                        .any(|reset| reset.cause != Cause::Watchdog && (from..frame.at).contains(&reset.up));
                    if !ended && !lost && self.blind.within(from, frame.at) < self.gap() {
                        let text = format!("run, and CTF was on the wire at {}", seconds(from));
                        self.verdict.finding(Rule::Obeyed, frame.at, text);
                    }
                }
                _ => {}
            }
        }
    }

    /// A start that does not reach running ends at its timeout. A ZK ECU reports the duration of its last start, and the timeout
    /// is twice that. Its own restart (13) has the timeout of a start, too.
    pub(super) fn start_ends(&mut self) {
        let h = self.h;
        let runs = |sample: &Sample| matches!(sample.phase, Phase::Running | Phase::LearningIdle);
        let hidden = self.down.union(&self.blind).union(&h.noise).union(&h.pwm);
        let (mut began, mut last, mut longest, mut sample) = (None::<u64>, None, 0, 0);
        // When it last ran, and since when it starts.
        let (mut ran, mut lit) = (0, None);
        let mut ends = BTreeSet::new();
        for frame in &h.frames {
            let Some(switch) = frame.sent.switch() else { continue };
            let before = last.replace((switch, frame.at));
            let stopped = before.is_some_and(|(before, at)| match before {
                Switch::Standby | Switch::Stop => true,
                // A source may take its start back and start again in one slot.
                Switch::Run => h.commanded(at, frame.at).windows(2).any(|pair| {
                    pair[0].source == pair[1].source
                        && pair[0].command == PilotCommand::Standby
                        && matches!(pair[1].command, PilotCommand::Run(_))
                }),
                Switch::Pwm => false,
            });
            if switch == Switch::Run && stopped {
                began = Some(frame.at);
            }
            let Some(from) = began.filter(|_| switch == Switch::Run) else {
                began = None;
                continue;
            };
            while let Some(next) = h.samples.get(sample).filter(|sample| sample.at <= frame.at) {
                sample += 1;
                if runs(next) {
                    longest = longest.max(lit.take().map_or(0, |lit| next.at - lit));
                    ran = next.at;
                } else if next.phase.is_starting() {
                    lit = lit.or(Some(next.at));
                } else {
                    lit = None;
                }
            }
            // In flight only the ECU's own restart begins a new start.
            let relit = |at: u64| {
                h.marks.iter().any(|(when, mark)| *mark == Mark::Relight && (ran..at).contains(when))
            };
            let since = from.max(ran);
            if ran >= from && (!self.traits().reports_stages || !relit(frame.at)) {
                continue;
            }
            // Twice the reported duration, between 5 s and 600 s.
            let own =
                if !self.traits().reports_start_time || longest == 0 { 0 } else { 2 * longest + 2 * SECOND };
            let most = h.rules.start_timeout.max(own).max(if own > 0 { 5 * SECOND } else { 0 });
            let late = since + most + 2 * SECOND;
            let hidden = if self.traits().replies_only { &self.down } else { &hidden };
            if frame.at > late && !hidden.touches(since, frame.at) {
                let text =
                    format!("run, and the start at {} has not come to a running engine", seconds(since));
                self.verdict.finding(Rule::RunAtRest, frame.at, text);
                began = None;
            } else if frame.at + 5 * SECOND > late {
                ends.insert(since);
            }
        }
        self.verdict.count("starts that came near their time", ends.len() as u64);
        self.restarts_end();
    }

    /// An ECU that lights its engine again and again is sent standby after the same time: what goes out meanwhile, in doubt, need not be
    /// run.
    fn restarts_end(&mut self) {
        let h = self.h;
        if !self.traits().reports_stages {
            return;
        }
        let begins = h.times(|sample| sample.phase.is_starting());
        let hidden = self.down.union(&self.blind).union(&h.noise).union(&h.pwm).union(&h.deaf);
        let mut judged = 0;
        for (from, to) in begins.iter() {
            let relit = |(at, mark): &(u64, Mark)| *mark == Mark::Relight && at.abs_diff(from) < 100 * MS;
            // Twice the duration of the last start, if its ECU has reported it: none of those of before was longer.
            let longest = begins.iter().filter(|(_, end)| *end < from).map(|(begin, end)| end - begin).max();
            let Some(longest) = longest else { continue };
            let reports = h.version(from) >= REPORTS_STARTS;
            let most =
                if reports { (2 * longest).max(5 * SECOND) + 3 * SECOND } else { h.rules.start_timeout };
            let due = from + most + 4 * SECOND;
            let hidden = hidden.touches(from.saturating_sub(10 * SECOND), due);
            if !h.marks.iter().any(relit) || to + 8 * SECOND < due || hidden {
                continue;
            }
            judged += 1;
            if to >= due {
                let text = format!("no standby, and the ECU lights its engine again since {}", seconds(from));
                self.verdict.finding(Rule::RunAtRest, due, text);
            }
        }
        self.verdict.count("restarts that came near their time", judged);
    }
}
