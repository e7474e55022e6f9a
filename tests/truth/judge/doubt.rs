//! What is sent while it is unknown whether an engine lives: nothing that could start one, and everything that
//! may be sent.

use super::case::{Case, Rule, seconds, spins_up};
use crate::history::{Cause, Demanded, Frame, MS, Mark, PilotCommand, SECOND, Sent, Spans, Switch};

/// Time for which damaged frames count as frames.
const DAMAGED_MAX: u64 = 10 * SECOND;
/// A speed goes out alternating with ID 0, and anything else in every second slot: in this number of slots one of them is a speed.
const SPEED_SLOTS: u64 = 8;

impl Case<'_> {
    /// Where the node must be in doubt: no frame of the ECU for longer than a gap, or damaged ones for too long. It ends with
    /// the first frame that may show it again.
    fn doubts(&self) -> Spans {
        let h = self.h;
        let damaged = h.ruined.iter().filter(|(from, to)| to - from > DAMAGED_MAX + self.gap());
        let damaged = damaged.map(|(from, to)| (from + DAMAGED_MAX + self.gap(), to));
        // Two reports of the state have to arrive. On ZK each round has one.
        let round = ((h.rounds().0 - 1) * h.rules.period).saturating_sub(20 * MS);
        let confirms = if self.traits().rounds { round } else { 0 };
        let given_up = |from_us: u64, to_us: u64| {
            let waits = h.rules.serial_delay + 3 * h.rules.period + 300 * MS;
            let noticed = to_us - from_us - self.down.within(from_us, to_us);
            // The order is gone: two sets have to be consistent before the next reply.
            if self.traits().serial_delay && noticed > waits { h.rules.period - 20 * MS } else { 0 }
        };
        let gaps = self.gaps();
        // Damaged frames do not confirm anything either.
        let readable = |to| h.ruined.last_before(to + MS).map_or(to, |(_, end)| end.max(to));
        let lost =
            gaps.iter().map(|(from, to)| (from + self.gap_from(from), readable(to) + given_up(from, to)));
        let lost = lost.chain(damaged).map(|(from, to)| (from, to + confirms));
        // After a reset, too.
        let resets = h.resets.iter().map(|reset| (reset.up, reset.up + confirms));
        let ups = h.resets.iter().map(|reset| reset.up);
        let errors = gaps.iter().map(|(_, to)| to).chain(ups);
        let errors = errors.filter_map(|from| Some((from, self.second_error_set(from)?)));
        // Without a memory two sets have to agree.
        let forgets = h.resets.iter().filter(|reset| reset.cause == Cause::PowerOn).map(|reset| reset.up);
        let receives = |up: u64| self.blind.last_before(up + MS).map_or(up, |(_, to)| to.max(up));
        let sets = gaps.iter().map(|(_, to)| (to, 0)).chain(forgets.map(|up| (receives(up), 1)));
        let sets = sets.filter_map(|(from, more)| Some((from, self.set_after(from, more)?)));
        let all: [Vec<(u64, u64)>; 4] = [lost.collect(), resets.collect(), errors.collect(), sets.collect()];
        all.iter().fold(Spans::default(), |all, spans| all.union(&Spans::from(spans)))
    }

    /// The first set since then that an AMT ECU sent as a whole, or one of those after it. Which other bytes form a set is up to the
    /// node.
    fn set_after(&self, from: u64, more: usize) -> Option<u64> {
        let h = self.h;
        if !self.traits().replies_only {
            return None;
        }
        // It has six bytes, and a reply five. One whose first byte is on its way counts as whole.
        let byte = h.rules.frame / 5;
        let long = 6 * byte;
        let first = h.sets.partition_point(|set| *set + byte + MS < from + long);
        // Those that no ECU sent are on the line first, where it was idle.
        let mut forged = h.forged.iter().filter(|forged| (from..from + h.rules.period).contains(*forged));
        let begins = h.sets.get(first).map(|set| set.saturating_sub(long));
        if forged.clone().any(|forged| begins.is_none_or(|begins| begins.abs_diff(*forged) > MS)) {
            return None;
        }
        let count = forged.clone().count() as u64;
        let first = forged.next().map_or(first, |forged| {
            let over = forged + count * long + MS;
            h.sets.partition_point(|set| *set < over)
        });
        let set = *h.sets.get(first + more)?;
        let odd =
            [&h.garbled, &h.framing].iter().any(|spans| spans.touches(from.saturating_sub(SECOND), set));
        (!odd && set < from + 4 * h.rules.period).then_some(set)
    }

    /// The second set since, if all of them are error sets with a temperature: one does not show whether there is combustion.
    fn second_error_set(&self, from: u64) -> Option<u64> {
        let h = self.h;
        if !self.traits().faults_hide_state {
            return None;
        }
        let second = self.set_after(from, 1)?;
        let since = from.saturating_sub(h.rules.period + 100 * MS);
        let whole = !h.sensor.touches(since, second) && !h.noise.touches(since, second);
        let errors = self.faults.within(since, second) == second - since;
        (whole && errors).then_some(second)
    }

    /// In doubt nothing is sent that could start an engine.
    pub(super) fn doubt(&mut self) {
        let h = self.h;
        let doubts = self.doubts();
        self.verdict.count("doubts", doubts.iter().count() as u64);
        let mut reported = 0;
        for frame in &h.frames {
            let at = frame.at;
            if frame.sent.switch() != Some(Switch::Run) || at < reported || !doubts.contains(at) {
                continue;
            }
            let from = doubts.last_before(at).map_or(at, |(from, _)| from);
            // A frame that no ECU sent, or a start that was granted since. One with a shaft at rest confirms nothing.
            let lately = from.saturating_sub(2 * self.gap())..at;
            let forged = h.forged.iter().any(|forged| lately.contains(forged) && !h.slow.contains(forged));
            let started = h
                .commanded(from, at)
                .iter()
                .any(|commanded| matches!(commanded.command, PilotCommand::Standby));
            let started = started && h.rules.link_stable < at - from;
            if !forged && !started {
                let text = format!("run, and nothing has confirmed the engine since {}", seconds(from));
                self.verdict.finding(Rule::Doubt, at, text);
                reported = at + 10 * SECOND;
            }
        }
        self.speed_in_doubt();
        self.slow_shaft();
        if self.traits().faults_hide_state {
            self.unreadable_after_a_gap();
            self.another_state_after_faults();
            self.started_after_faults();
        }
    }

    /// Something other than an ECU's faults may decide what goes out: sets that are not received, a reset, a stop, PWM.
    fn may_be_decided_otherwise(&self, from_us: u64, to_us: u64) -> bool {
        let h = self.h;
        let all = [&self.blind, &self.down, &h.noise, &h.garbled, &self.stopped, &h.pwm];
        all.iter().any(|spans| spans.touches(from_us, to_us))
    }

    /// When the faults of an AMT ECU clear, it gets no run before a set says that the engine runs.
    fn another_state_after_faults(&mut self) {
        let h = self.h;
        let period = h.rules.period;
        let faults: Vec<(u64, u64)> = self.faults.at_least(4 * period).iter().collect();
        for (from, to) in faults {
            let since = from.saturating_sub(2 * SECOND);
            // Error sets are answered as long as the exhaust burns.
            let shown = h.samples(to, h.end).iter().find(|sample| !sample.hidden || sample.fault);
            let (first, last) =
                (to + period + 60 * MS, shown.map_or(h.end, |sample| sample.at).saturating_sub(60 * MS));
            if first >= last
                || !self.known_to_run(since)
                || h.samples(from.saturating_sub(SECOND), from).iter().any(|sample| sample.hidden)
                || self.may_be_decided_otherwise(since, last)
            {
                continue;
            }
            self.verdict.count("other states after error sets", 1);
            if let Some(frame) = h.first_run(first, last) {
                let text = format!(
                    "run, and no set says that the engine runs since its faults at {}",
                    seconds(from)
                );
                self.verdict.finding(Rule::Doubt, frame.at, text);
            }
        }
    }

    /// Nor does it get one while it lights the engine again by itself.
    fn started_after_faults(&mut self) {
        let h = self.h;
        let period = h.rules.period;
        let starts = self.pairs();
        for &(lit, mark) in &h.marks {
            let Some((from, to)) = self.faults.last_before(lit).filter(|(from, to)| to - from >= 4 * period)
            else {
                continue;
            };
            let since = from.saturating_sub(2 * SECOND);
            // Until it may be reported to run, or is out.
            let first = lit.max(to) + period + 60 * MS;
            let ends = h.samples(first, h.end).iter().find(|sample| !spins_up(sample.phase) || sample.fault);
            let last = ends.map_or(h.end, |sample| sample.at).saturating_sub(60 * MS);
            if mark == Mark::GivenUp
                || lit > to + 10 * SECOND
                || first >= last
                || !self.known_to_run(since)
                || starts.iter().any(|start| (since..last).contains(&start.at))
                || self.may_be_decided_otherwise(since, last)
            {
                continue;
            }
            self.verdict.count("starts by an ECU after its faults", 1);
            if let Some(frame) = h.first_run(first, last) {
                let text = format!(
                    "run, and the ECU starts its engine by itself since {}, after its faults",
                    seconds(lit)
                );
                self.verdict.finding(Rule::Doubt, frame.at, text);
            }
        }
    }

    /// After a gap, an AMT ECU with faults in place of a state gets no run as long as the exhaust cannot be read, also where the node
    /// was reset in the gap.
    fn unreadable_after_a_gap(&mut self) {
        let h = self.h;
        let gaps: Vec<(u64, u64)> = self.blind.at_least(self.gap() + h.rules.period).iter().collect();
        for (from, to) in gaps {
            let since = from.saturating_sub(2 * SECOND);
            let noticed = from + self.gap() + h.rules.period;
            let lasting = |spans: &Spans| spans.last_before(from).filter(|(_, end)| *end > to);
            let (Some((_, clears)), Some((_, whole))) = (lasting(&self.faults), lasting(&h.sensor)) else {
                continue;
            };
            // What is on its way at either end.
            let until = clears.min(whole).saturating_sub(100 * MS);
            let disturbed = self.down.touches(since, noticed)
                || [&h.noise, &h.garbled, &self.stopped].iter().any(|spans| spans.touches(since, until));
            if disturbed || self.blind.touches(to, until) || !self.known_to_run(since) || to >= until {
                continue;
            }
            self.verdict.count("gaps among error sets without an exhaust", 1);
            if let Some(frame) = h.first_run(to, until) {
                let text = format!(
                    "run, and since the gap at {} neither a state nor an exhaust confirms the engine",
                    seconds(from)
                );
                self.verdict.finding(Rule::Doubt, frame.at, text);
            }
        }
    }

    /// A frame of a ZK ECU whose shaft does not turn raises doubt, whatever else it reports, until two reports of the state have
    /// arrived.
    fn slow_shaft(&mut self) {
        let h = self.h;
        if !self.traits().rounds {
            return;
        }
        let period = h.rules.period;
        let hidden = self.blind.union(&self.down).union(&h.deaf).union(&h.framing).union(&h.garbled);
        for &slow in &h.slow {
            // It waits for what is being sent, and so does the next frame.
            let (from, to) = (slow + 2 * period + 60 * MS, slow + (h.rounds().0 - 1) * period);
            let since = slow.saturating_sub(2 * SECOND);
            if from >= to
                || !self.known_to_run(slow)
                || hidden.touches(since, to)
                || h.pwm.touches(since, to)
                || self.stopped.touches(since, to)
            {
                continue;
            }
            self.verdict.count("slow shafts that raise doubt", 1);
            if let Some(frame) = h.first_run(from, to) {
                let text = format!(
                    "{}, and a frame reported at {} that the shaft is at rest",
                    frame.sent,
                    seconds(slow)
                );
                self.verdict.finding(Rule::Doubt, frame.at, text);
            }
        }
    }

    /// A ZK ECU in rpm mode continues to get the speed, as long as somebody commands run.
    fn speed_in_doubt(&mut self) {
        let h = self.h;
        let slots = SPEED_SLOTS * h.rules.period + 100 * MS;
        let gaps: Vec<_> = h.mute.at_least(self.gap() + slots + SECOND).iter().collect();
        for (from, to) in gaps {
            let rpm = |at| matches!(self.command_log.run_in_control(at), Some((_, Demanded::Rpm(_))));
            // In rpm mode for a while before, with an engine that lives.
            let frames = h.frames_within(from.saturating_sub(3 * SECOND), from);
            let by_rpm = frames.iter().any(|frame| matches!(frame.sent, Sent::Rpm(_)))
                && frames.iter().any(|frame| matches!(frame.sent, Sent::Mode(Some(Switch::Run), 1..)))
                && !frames.iter().any(|frame| matches!(frame.sent, Sent::Full(..)));
            if h.version(from) < 4 || !by_rpm || !self.known_to_run(from) {
                continue;
            }
            let mut at = from + self.gap() + slots + SECOND;
            while at < to {
                let since = from.saturating_sub(3 * SECOND);
                let disturbed = self.down.touches(since, at)
                    || h.noise.touches(since, at)
                    || h.unpowered.touches(since, at)
                    || h.versions.iter().any(|(when, _)| (since..at).contains(when))
                    || self.stopped.touches(since, at);
                let commanded = h.commanded(since, at).iter();
                let other = commanded.clone().any(|commanded| {
                    !matches!(commanded.command, PilotCommand::Run(Demanded::Rpm(_)) | PilotCommand::Arm)
                });
                // Another rule judges what has shut it down.
                let ends = |frame: &Frame| frame.sent.switch().is_some_and(|switch| switch != Switch::Run);
                let ended = h.frames_within(from, at).iter().any(ends);
                if disturbed || other || ended || !rpm(at) {
                    break;
                }
                self.verdict.count("speeds in doubt", 1);
                if !h.frames_within(at - slots, at).iter().any(|frame| matches!(frame.sent, Sent::Rpm(_))) {
                    let text =
                        format!("nothing is received since {}, and no speed is on the wire", seconds(from));
                    self.verdict.finding(Rule::HeldDown, at, text);
                    break;
                }
                at += SECOND;
            }
        }
    }
}
