//! The power of starter and ignition: on from arming until the ECU has reported a cold engine at rest, also after an emergency
//! stop, and not without a reason.

use super::case::{Case, Rule, seconds};
use crate::history::{Cause, Commanded, Frame, MS, PilotCommand, SECOND, Sent, Spans, Switch};
use sim::turbine::Phase;

/// Time from a reason until the output follows: the node checks its engine at each event of the world, 50 ms apart or
/// less.
const LATE: u64 = 60 * MS;
/// Time of reports of a cold engine until the power is turned off.
const COLD_FOR: u64 = 3 * SECOND;
/// Temperature below which an engine is cold, °C, with the resolution of an AMT report.
const COLD: f64 = 100.0;
const RESOLUTION: f64 = 8.0;
/// Speed from which a shaft counts as turning, rpm, with the resolution of a report.
const TURNS: f64 = 1000.0;
const TURNS_FOR_SURE: f64 = 1600.0;
/// Longest time from the end of a run (by a stop, a limit or a silence), or of a service, until the ECU reports rest.
const LATELY: u64 = 60 * SECOND;

impl Case<'_> {
    pub(super) fn power(&mut self) {
        if self.h.power.is_empty() {
            return;
        }
        self.power_is_on_while_armed_or_run();
        self.power_survives_a_reset();
        self.power_ends_with_a_cold_engine_only();
        self.power_ends_with_a_cold_engine();
        self.power_has_a_reason();
    }

    /// It is off neither at an arming nor during two consecutive run frames.
    fn power_is_on_while_armed_or_run(&mut self) {
        let h = self.h;
        let off = h.power_is(Some(false));
        let all_off = |from: u64, to: u64| off.within(from, to) == to - from;
        for commanded in h.commanded.iter().filter(|c| c.command == PilotCommand::Arm) {
            let (from, to) = (commanded.at, commanded.at + LATE);
            let holds = self.surely_armed(from) && self.surely_armed(to);
            if holds && !self.down.touches(from, to) && to < h.end && all_off(from, to) {
                let text = format!("armed at {}, and starter and ignition have no power", seconds(from));
                self.verdict.finding(Rule::Power, to, text);
            }
        }
        // One frame may have been decided before its stop: two in a row are a run, from the first to the last.
        let switches: Vec<_> = h.frames.iter().filter(|frame| frame.sent.switch().is_some()).collect();
        let pairs = switches.windows(2).map(|pair| (pair[0], pair[1]));
        let run = |frame: &Frame| frame.sent.switch() == Some(Switch::Run);
        let together = pairs
            .filter(|(one, next)| run(one) && run(next) && next.at - one.at <= 2 * h.rules.period + LATE);
        let runs = Spans::from(&together.map(|(one, next)| (one.at, next.at)).collect::<Vec<_>>());
        for (from, to) in runs.iter() {
            let dark = off.iter().map(|(begin, end)| (begin.max(from), end.min(to)));
            let long = dark.filter(|(begin, end)| *end >= begin + LATE);
            for (begin, end) in long {
                if !self.down.touches(begin.saturating_sub(LATE), end) {
                    let text =
                        format!("run is on the wire since {}, and the starter has no power", seconds(from));
                    self.verdict.finding(Rule::Power, end, text);
                }
            }
        }
    }

    /// Certainly armed. Where a start needs no arming, arming is not tracked.
    fn surely_armed(&self, at: u64) -> bool {
        self.h.rules.arming && self.command_log.surely_armed(at)
    }

    /// A reset is no report of a cold engine: what had power has it before anything is received. Of another engine's memory a stop is left.
    fn power_survives_a_reset(&mut self) {
        let h = self.h;
        let [on, off] = [true, false].map(|power| h.power_is(Some(power)));
        for reset in h.resets.iter().filter(|reset| reset.cause != Cause::PowerOn) {
            let before = reset.down.saturating_sub(LATE);
            let had = on.within(before, reset.down) == LATE;
            let stopped = self.stopped.within(before, reset.up) >= LATE;
            let known = stopped || !h.renamed.contains(&reset.up);
            if had && known && off.contains(reset.up + 1) {
                let text = "the node begins, and the starter has lost its power";
                self.verdict.finding(Rule::Power, reset.up, text);
            }
        }
    }

    /// Only what the node certainly received counts against it.
    fn is_disturbed(&self, from: u64, to: u64) -> bool {
        let h = self.h;
        let spans = [&h.noise, &h.garbled, &h.ruined, &h.framing, &h.sensor, &h.pwm, &self.down];
        spans.iter().any(|spans| spans.touches(from, to))
            || h.forged.iter().any(|at| (from..to).contains(at))
            || h.versions.iter().any(|(at, _)| (from..to).contains(at))
            || h.samples(from, to).iter().any(|sample| sample.hidden)
    }

    /// It is turned off by the reports of a cold, disarmed engine at rest.
    fn power_ends_with_a_cold_engine_only(&mut self) {
        let h = self.h;
        let ends = h.power.windows(2).filter(|pair| pair[0].1 == Some(true) && pair[1].1 == Some(false));
        for at in ends.map(|pair| pair[1].0).collect::<Vec<_>>() {
            self.verdict.count("starters without power again", 1);
            if self.surely_armed(at) && self.surely_armed(at.saturating_sub(LATE)) {
                self.verdict.finding(Rule::Power, at, "an armed engine's starter loses its power");
            }
            let from = at.saturating_sub(COLD_FOR);
            if self.is_disturbed(from.saturating_sub(SECOND), at) {
                continue;
            }
            // What ended before the first of these reports was made is in none of them.
            let from = from + self.one_state();
            // A report of what was before may still count.
            let until = at.saturating_sub(self.one_state());
            let busy = h.samples(from, until).iter().find(|sample| {
                sample.phase.is_live() || sample.rpm >= TURNS_FOR_SURE || sample.egt > COLD + RESOLUTION
            });
            if let Some(busy) = busy {
                let text = format!(
                    "the starter of an engine loses its power that was {} with {:.0} rpm and {:.0} °C at {}",
                    busy.phase.name(),
                    busy.rpm,
                    busy.egt,
                    seconds(busy.at)
                );
                self.verdict.finding(Rule::Power, at, text);
            }
        }
    }

    /// Not armed, sent standby or stop, cold and at rest, and all of this reported: the power is off by then.
    fn power_ends_with_a_cold_engine(&mut self) {
        let h = self.h;
        let cold = h.times(|sample| {
            let at_rest = matches!(sample.phase, Phase::Standby | Phase::Stopped);
            at_rest && sample.egt < COLD - RESOLUTION && sample.egt > -30.0 && sample.rpm < TURNS / 2.0
        });
        let on = h.power_is(Some(true));
        let within = COLD_FOR + 2 * self.two_states() + SECOND;
        for (from, to) in cold.iter() {
            let mut at = from + within;
            while at < to {
                let since = at - within;
                let frames = h.frames_within(since, at);
                let quiet = frames.iter().all(|frame| frame.sent.ends_a_run() && frame.arrived)
                    && frames.len() as u64 > within / h.rules.period / 2;
                let known = ![&self.blind, &self.faults, &self.hidden, &h.deaf]
                    .iter()
                    .any(|spans| spans.touches(since, at));
                let armed = self.command_log.armed_within(since, at);
                // A service moves no shaft here, but the ECU reports it in place of standby.
                let serves = h
                    .frames_within(at.saturating_sub(LATELY), at)
                    .iter()
                    .any(|frame| matches!(frame.sent, Sent::Action(_)));
                if quiet
                    && known
                    && !serves
                    && !armed
                    && !self.is_disturbed(since, at)
                    && on.within(since, at) == within
                {
                    let text =
                        format!("cold and at rest since {}, and the starter has power", seconds(since));
                    self.verdict.finding(Rule::Power, at, text);
                    break;
                }
                at += SECOND;
            }
        }
    }

    /// It is turned on by an arming, an order to run, a running engine that the ECU reports, or a record of
    /// one of these.
    fn power_has_a_reason(&mut self) {
        let h = self.h;
        let mut before = Some(false);
        let live = h.times(|sample| sample.phase.is_live() || sample.phase == Phase::Cooling);
        let run = |from: u64, to: u64| {
            let doubt = |sent: Sent| matches!(sent, Sent::Nothing | Sent::Rpm(_));
            let frames = h.frames_within(from, to);
            frames.iter().any(|frame| frame.sent.switch() == Some(Switch::Run) || doubt(frame.sent))
        };
        for (at, power) in h.power.clone() {
            let Some(on) = power else { continue };
            let was = before.replace(on);
            let reset = h.resets.iter().rfind(|reset| reset.up <= at && at < reset.up + MS);
            // Nothing armed it before it began; a command may come in the same instant.
            let arms = |commanded: &Commanded| commanded.command == PilotCommand::Arm;
            let armed_again = self.command_log.armed(at)
                && (h.rules.arming || h.commanded(at.saturating_sub(MS), at).iter().any(arms));
            let lost = reset.is_some_and(|reset| reset.cause == Cause::PowerOn) && !armed_again;
            if !on || was == Some(true) && !lost {
                continue;
            }
            self.verdict.count("starters with power", 1);
            let since = at.saturating_sub(self.two_states() + LATE);
            let armed = self.command_log.armed_within(since, at);
            let stopped = reset.is_some() && self.stopped.touches(at.saturating_sub(LATELY), at);
            let next = at + LATE + 2 * h.rules.period;
            let recent = Spans::from(&[(at.saturating_sub(LATELY), at + 1)]).common(&live) > 0;
            let reason = armed || stopped || recent || run(since, next) || h.pwm.touches(since, next);
            if lost || !reason && !self.is_disturbed(since, at) {
                let text = if lost {
                    "after a loss of power the starter has power before anything is received"
                } else {
                    "the starter gets power, and nobody has armed its engine"
                };
                self.verdict.finding(Rule::Power, at, text);
            }
        }
    }
}
