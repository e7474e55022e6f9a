//! What has to be on the wire at once, and what must not be on it meanwhile.

use super::case::{Case, Rule, seconds};
use super::limits::Arrival;
use crate::history::{Cause, Commanded, Demanded, MS, PilotCommand, SECOND, Sample, Sent, Spans, Switch};
use sim::turbine::Phase;

/// Resolution of the wire, 0.1 %.
const STEP: f64 = 8.0;
/// An AMT reply ends within this time of its set.
const REPLIES: u64 = 30 * MS;
/// Time after which the port of a transmitter that hangs has been opened again: 0.2 s, from the first frame that did not go out.
const REOPENS_WITHIN: u64 = 500 * MS;
/// Time for which damaged frames at the expected times are not a gap, in flight.
pub(super) const KEEPS_THE_BEAT: u64 = 10 * SECOND;
/// Default of `governor.max_age`.
pub(super) const SPEED_IS_OLD: u64 = 600 * MS;
/// Well within the band for a take-over, 5 %; and well away from what is in force, 0.1 %.
const CLOSE: core::ops::Range<u32> = 15..40;

impl Case<'_> {
    pub(super) fn prompt(&mut self) {
        let traits = self.traits();
        if traits.ctf {
            self.ctf_is_sent();
        }
        if traits.faults_hide_state {
            self.rises_while_it_burns();
        }
        if traits.replies_only {
            self.replies_in_time();
            self.rises_when_confirmed();
        } else {
            self.damage_is_not_a_gap();
        }
        self.reopens_in_time();
        self.governs_by_speeds();
        self.governor_resumes();
        self.takes_over_when_close();
        self.starts_apart();
    }

    /// A transmitter that hangs is opened again, where the driver can.
    fn reopens_in_time(&mut self) {
        let h = self.h;
        if h.reopened.is_none() {
            return;
        }
        let mut judged = 0;
        for (from, to) in self.stalled().iter() {
            // It is noticed by a frame that does not go out. An AMT ECU gets one for each of its sets.
            let due = from + REOPENS_WITHIN;
            let hidden = [&self.blind, &h.noise, &h.garbled, &self.faults, &self.down];
            let silent = hidden.iter().any(|spans| spans.touches(from.saturating_sub(SECOND), due));
            let sends = !self.traits().replies_only || self.known_to_run(from) && !silent;
            if !sends || self.down.touches(from, due) || due > h.end {
                continue;
            }
            judged += 1;
            if to > due {
                let text = format!("the transmitter hangs since {}, and is not opened again", seconds(from));
                self.verdict.finding(Rule::GivenUp, due, text);
            }
        }
        self.verdict.count("transmitters that hang", judged);
    }

    /// CTF that the source in control commands for an engine that runs is on the wire within three periods.
    fn ctf_is_sent(&mut self) {
        let h = self.h;
        let within = 3 * h.rules.period + 50 * MS;
        let hidden = [&self.blind, &h.noise, &h.deaf, &self.down, &self.faults, &self.stopped, &h.pwm];
        let mut judged = 0;
        let mut found = Vec::new();
        for ctf in h.commanded.iter().filter(|commanded| commanded.command == PilotCommand::Ctf) {
            let (at, due) = (ctf.at, ctf.at + within);
            let long = h.rules.recover_after + h.rules.takeover + 2 * SECOND;
            let since = at.saturating_sub(long);
            // It commanded run until now, and no other source commands anything, or did so recently enough to be in control still.
            let age = h.rules.ages.into_iter().max().unwrap_or_default();
            let alone = h.commanded(since.saturating_sub(age), due).iter().all(|other| {
                let runs =
                    matches!(other.command, PilotCommand::Run(_) | PilotCommand::Arm | PilotCommand::Ctf);
                other.source == ctf.source && runs
            });
            let steady = self.command_log.commands_since(ctf.source, at).is_some_and(|from| from <= since);
            let runs = self.known_to_run(since) && self.known_to_run(due) && due < h.end;
            let seen = hidden.iter().all(|spans| !spans.touches(since, due));
            let shown = h.samples(since, due).iter().all(|sample| !sample.hidden);
            if !(alone && steady && runs && seen && shown) {
                continue;
            }
            judged += 1;
            if !h.frames_within(since, due).iter().any(|frame| frame.sent == Sent::Ctf) {
                found.push((due, format!("CTF was commanded at {}, and is not on the wire", seconds(at))));
            }
        }
        self.verdict.count("CTF that has to be sent", judged);
        for (at, text) in found {
            self.verdict.finding(Rule::Obeyed, at, text);
        }
    }

    /// Every AMT reply ends within 30 ms of its set.
    fn replies_in_time(&mut self) {
        let h = self.h;
        let noise = h.noise.longer(h.rules.period);
        let mut judged = 0;
        for frame in &h.frames {
            let set = h.sets[..h.sets.partition_point(|set| *set <= frame.at)].last();
            // Which bytes form a set is up to the node where some are damaged, or no ECU sent them.
            let Some(set) = set.filter(|set| !noise.touches(**set, frame.at + 5 * MS)) else { continue };
            judged += 1;
            if frame.at + h.rules.frame > set + REPLIES {
                let text = format!("a reply {} ms after the end of its set", (frame.at - set) / MS);
                self.verdict.finding(Rule::Frame, frame.at, text);
                break;
            }
        }
        self.verdict.count("replies in their window", judged);
    }

    /// In doubt since a gap, a demand does not rise before a set reports that the engine runs. A standby ends the run, and what follows
    /// belongs to another start.
    fn rises_when_confirmed(&mut self) {
        let h = self.h;
        let long = self.order_outlasts();
        let gaps = self.blind.iter().filter(|(from, to)| (self.gap()..long).contains(&(to - from)));
        let gaps: Vec<(u64, u64)> = gaps.collect();
        for (from, to) in gaps {
            let since = from.saturating_sub(3 * SECOND);
            let runs = |sample: &&Sample| sample.runs() && !sample.hidden && !sample.fault;
            let confirmed = h.samples(to, to + 30 * SECOND).iter().find(runs).map_or(to, |sample| sample.at);
            // Which of its bytes form a set is up to the node.
            let disturbed = [&h.noise, &h.garbled, &self.down, &h.pwm, &self.faults];
            if !self.known_to_run(from)
                || disturbed.iter().any(|spans| spans.touches(since, confirmed + h.rules.period))
                || self.blind.touches(to, confirmed)
            {
                continue;
            }
            let before = h.frames_within(since, from).iter().rev().find_map(|frame| frame.sent.demand());
            let Some(before) = before else { continue };
            let same = |sent: &Demanded| core::mem::discriminant(sent) == core::mem::discriminant(&before);
            let frames = h.frames_within(from + self.gap(), confirmed + h.rules.period);
            let runs = frames.iter().take_while(|frame| frame.sent.switch() != Some(Switch::Standby));
            let sent = runs.filter_map(|frame| Some((frame.at, frame.sent.demand().filter(same)?)));
            self.verdict.count("replies in doubt that may not rise", sent.clone().count() as u64);
            let high = sent.clone().find(|(_, sent)| self.share(*sent) > self.share(before) + STEP);
            if let Some((at, sent)) = high {
                let text = format!(
                    "{sent} after {before}, and no set has confirmed the engine since {}",
                    seconds(from)
                );
                self.verdict.finding(Rule::Rate, at, text);
            }
        }
    }

    /// With error sets only, a demand does not rise while the exhaust cools, faster than a report's steps of 4.6 °C hide.
    fn rises_while_it_burns(&mut self) {
        let h = self.h;
        let egt = |at: u64| h.sample(at).map_or(0.0, |sample| sample.egt);
        let cools = |at: u64| {
            let [last, middle, first] = [200, 1400, 2600].map(|before| egt(at - before * MS));
            first - middle > 12.0 && middle - last > 12.0
        };
        let hidden = [&self.blind, &self.down, &h.noise, &h.garbled, &h.sensor];
        let faults: Vec<(u64, u64)> = self.faults.at_least(4 * SECOND).iter().collect();
        let mut found = None;
        let mut judged = 0;
        for (from, to) in faults {
            for pair in h.frames_within(from + 3 * SECOND, to).windows(2) {
                let (before, frame) = (pair[0], pair[1]);
                let (Some(was), Some(is)) = (before.sent.demand(), frame.sent.demand()) else { continue };
                let since = frame.at - 3 * SECOND;
                // Within 5 s after a lower demand, a colder exhaust proves nothing.
                if frame.at > before.at + SECOND
                    || !cools(frame.at)
                    || self.last_lowered(frame.at.saturating_sub(8 * SECOND), frame.at).is_some()
                    || hidden.iter().any(|spans| spans.touches(since, frame.at))
                {
                    continue;
                }
                judged += 1;
                if self.share(is) > self.share(was) + STEP {
                    let text = format!("{is} after {was}, with error sets and an exhaust that cools");
                    found = found.or(Some((frame.at, text)));
                }
            }
        }
        self.verdict.count("replies while the exhaust cools", judged);
        if let Some((at, text)) = found {
            self.verdict.finding(Rule::Rate, at, text);
        }
    }

    /// In flight, damaged frames at the expected times are not a gap for 10 s: the demand stays on the wire.
    fn damage_is_not_a_gap(&mut self) {
        let h = self.h;
        let hidden = self.blind.union(&self.down).union(&h.noise_to_ecu).union(&h.deaf).union(&h.pwm);
        for (from, to) in h.framing.iter() {
            let since = from.saturating_sub(4 * SECOND);
            let until = to.min(from + KEEPS_THE_BEAT - 300 * MS);
            let before = h.noise.last_before(from).is_some_and(|(_, over)| over + 4 * SECOND > from);
            // A speed continues as ID 7. Once the link and with it the ECU's version are lost, it alternates with ID
            // 0.
            let rpm = |commanded: &Commanded| commanded.command.is_rpm();
            let by_rpm = h.frames_within(since, from).iter().any(|frame| matches!(frame.sent, Sent::Rpm(_)))
                || h.commanded(from, until).iter().any(rpm);
            if before
                || by_rpm
                || hidden.touches(since, until)
                || !self.known_to_run(since)
                || !self.known_to_run(from)
                || self.stopped.touches(since, until)
            {
                continue;
            }
            self.verdict.count("seconds of damage in flight that is no gap", (until - from) / SECOND);
            let empty = h.frames_within(from, until).iter().find(|frame| frame.sent == Sent::Nothing);
            if let Some(frame) = empty {
                let text = format!("ID 0, and the ECU sends damaged frames since {}", seconds(from));
                self.verdict.finding(Rule::HeldDown, frame.at, text);
            }
        }
    }

    /// A governor commands idle without speeds, and no more throttle to a shaft that falls.
    fn governs_by_speeds(&mut self) {
        let h = self.h;
        let rules = &h.rules;
        let limited = rules.limit_egt.is_some()
            || rules.limit_rpm.is_some()
            || rules.limit_fault.is_some()
            || rules.limit_low_rpm.is_some()
            || rules.limit_supply.is_some()
            || rules.limit_changes != [None; 4];
        if !rules.governor || limited {
            return;
        }
        let hidden = self.blind.union(&h.noise).union(&self.down).union(&h.deaf);
        let steady = |at: u64| {
            let since = at.saturating_sub(8 * SECOND);
            self.governed(at) && self.command_log.runs_throughout(since, at) && !hidden.touches(since, at)
        };
        let throttle = |sent: Sent| match sent {
            Sent::Full(Switch::Run, tenths) => Some(f64::from(tenths)),
            _ => None,
        };
        // Error sets have no speed.
        let faults = if self.traits().faults_hide_state { self.faults.clone() } else { Spans::default() };
        let mut old = 0;
        let mut found = Vec::new();
        for (from, to) in faults.iter() {
            let since = from + SPEED_IS_OLD + 3 * rules.period + 100 * MS;
            // Without a speed an rpm is refused, and the earlier run stays in force: it has to have been commanded before.
            if !self.known_to_run(from.saturating_sub(SECOND)) || since >= to || !self.governed(from) {
                continue;
            }
            let throttles = |it: &&Commanded| matches!(it.command, PilotCommand::Run(Demanded::Throttle(_)));
            let until = h.commanded(from, to).iter().find(throttles).map_or(to, |first| first.at);
            for frame in h.frames_within(since, until).iter().filter(|frame| steady(frame.at)) {
                old += 1;
                if throttle(frame.sent).is_some_and(|tenths| tenths > STEP) {
                    let text =
                        format!("{} of a governor without a speed since {}", frame.sent, seconds(from));
                    found.push((frame.at, text));
                    break;
                }
            }
        }
        // A flame-out: faster than 5000 rpm a second, measured over 0.5 s.
        let falls = |sample: &Sample| {
            let before = h.sample(sample.at.saturating_sub(500 * MS));
            sample.phase == Phase::Running
                && !sample.lit
                && !sample.fault
                && !sample.hidden
                && before.is_some_and(|before| before.rpm - sample.rpm > 3000.0)
        };
        let mut falling = 0;
        for (from, to) in h.times(falls).iter() {
            let mut lowest = f64::MAX;
            // The second speed that shows it has arrived.
            for frame in h.frames_within(from + self.one_state(), to).iter().filter(|frame| steady(frame.at))
            {
                let Some(tenths) = throttle(frame.sent) else { continue };
                falling += 1;
                lowest = lowest.min(tenths);
                if tenths > lowest + STEP {
                    let text =
                        format!("{} of a governor, and the shaft falls since {}", frame.sent, seconds(from));
                    found.push((frame.at, text));
                    break;
                }
            }
        }
        self.verdict.count("throttles of a governor without speeds", old);
        self.verdict.count("throttles of a governor whose shaft falls", falling);
        for (at, text) in found {
            self.verdict.finding(Rule::HeldUp, at, text);
        }
    }

    /// A reset in steady flight costs a governed engine no throttle: until the node can measure again, it holds the one that the ECU reports.
    fn governor_resumes(&mut self) {
        let h = self.h;
        let hidden = h.times(|sample| sample.hidden);
        let hidden = [&hidden, &self.blind, &h.noise, &h.deaf, &self.faults, &h.other_failed, &h.framing];
        for (index, reset) in h.resets.iter().enumerate() {
            let (since, until) = (reset.down.saturating_sub(3 * SECOND), reset.up + 3 * SECOND);
            let before = index.checked_sub(1).and_then(|before| h.resets.get(before));
            let alone = before.is_none_or(|before| before.up + 10 * SECOND < reset.down)
                && h.resets.get(index + 1).is_none_or(|next| next.down > until)
                && reset.up - reset.down < SECOND / 2;
            if reset.cause != Cause::Watchdog || !alone || !self.governed(reset.down) || !self.governed(until)
            {
                continue;
            }
            let seen = hidden.iter().all(|spans| !spans.touches(since, until));
            let mut commands =
                h.commanded(since, until).iter().filter(|commanded| commanded.command.is_received());
            let first = commands.next();
            let same = commands.all(|other| first.is_some_and(|first| first.command == other.command));
            let throttles = |from, to| {
                h.frames_within(from, to).iter().filter_map(|frame| match frame.sent {
                    Sent::Full(Switch::Run, tenths) => Some((frame.at, tenths)),
                    _ => None,
                })
            };
            // It did not fall before; afterwards its fall is what is judged.
            let lately = throttles(reset.down.saturating_sub(SECOND), reset.down);
            let Some(held) = lately.map(|(_, tenths)| tenths).min() else { continue };
            let fell = throttles(since, reset.down).any(|(_, tenths)| tenths > held + 50);
            let fresh = self.command_log.runs_throughout(since, until);
            let flies = self.known_to_run(reset.down) && h.samples(since, until).iter().all(Sample::runs);
            if !seen || !same || !fresh || !flies || fell {
                continue;
            }
            self.verdict.count("governed engines over a reset", 1);
            // A limit may lower it.
            if let Some((at, tenths)) = throttles(reset.up, until)
                .find(|(_, tenths)| 2 * tenths + 50 < held)
                .filter(|(at, _)| !self.reduced(*at))
            {
                let text = format!("a governor gives {}.{} % after a reset", tenths / 10, tenths % 10);
                self.verdict.finding(Rule::HeldDown, at, text);
            }
        }
    }

    /// A source whose demand is close to the one in force takes over without a wait.
    fn takes_over_when_close(&mut self) {
        let h = self.h;
        let rules = &h.rules;
        if rules.takeover < 2 * SECOND || rules.governor {
            return;
        }
        let hidden = self.blind.union(&h.noise).union(&self.down).union(&h.deaf).longer(3 * SECOND);
        let rate = rules.rise.min(rules.slew_up.unwrap_or(1000)).min(rules.slew_down.unwrap_or(1000)).max(1);
        let moves = u64::from(CLOSE.end) * SECOND / u64::from(rate);
        for commanded in &h.commanded {
            let Some(Arrival { wanted, lower, held }) = self.arrival(commanded) else { continue };
            let at = commanded.at;
            // One that was lost has to be received for a while.
            let due = at + rules.recover_after + 3 * rules.period + 100 * MS + moves;
            let settled = rules.recover_after + rules.takeover + 4 * SECOND;
            let since = at.saturating_sub(settled);
            let only = |other: &Commanded| match other.command {
                PilotCommand::Run(Demanded::Throttle(tenths)) if other.source == lower => tenths == held,
                PilotCommand::Run(Demanded::Throttle(tenths)) if other.source == commanded.source => {
                    tenths == wanted
                }
                PilotCommand::Arm => true,
                _ => false,
            };
            let fresh = |source, at| self.command_log.commands_since(source, at);
            let in_force = |at: u64| {
                let sent = h.frames_within(at.saturating_sub(SECOND), at).iter().rev();
                sent.clone().find_map(|frame| frame.sent.demand())
            };
            let steady = lower > commanded.source
                && CLOSE.contains(&wanted.abs_diff(held))
                && fresh(lower, at - 1).is_some_and(|from| from <= since)
                && fresh(commanded.source, due).is_some_and(|from| from >= at)
                && h.commanded(since, due).iter().all(only)
                && in_force(at).is_some_and(|sent| {
                    self.share(sent).max(f64::from(held)) - self.share(sent).min(f64::from(held)) <= STEP
                })
                && due < at + rules.takeover - 300 * MS
                && self.known_to_run(due);
            if !steady
                || hidden.touches(since, due)
                || h.other_failed.touches(since, due)
                || self.reduced(due)
            {
                continue;
            }
            self.verdict.count("close take-overs", 1);
            let sent = in_force(due);
            if sent.is_none_or(|sent| (self.share(sent) - f64::from(wanted)).abs() > STEP) {
                let [wanted, held] = [wanted, held].map(Demanded::Throttle);
                let text = format!(
                    "source {} takes over at {} with {wanted}, close to {held}, and it is not in force",
                    commanded.source,
                    seconds(at)
                );
                self.verdict.finding(Rule::TakeOver, due, text);
            }
        }
    }

    /// The starts of two engines of a node are apart.
    fn starts_apart(&mut self) {
        let h = self.h;
        let gap = h.rules.start_gap;
        if gap < SECOND {
            return;
        }
        // Each is on the wire up to a slot late.
        let slack = h.rules.period + 250 * MS;
        for at in h.starts_on_wire() {
            let since = at.saturating_sub(gap);
            let others = &h.other_starts[..h.other_starts.partition_point(|other| *other <= at)];
            let Some(&other) = others.last() else { continue };
            if self.down.touches(since, at) || h.pwm.touches(since, at) {
                continue;
            }
            self.verdict.count("starts after another engine's", u64::from(other + 3 * gap > at));
            if other + gap > at + slack {
                let text = format!("a start, and another engine was started at {}", seconds(other));
                self.verdict.finding(Rule::Ignition, at, text);
            }
        }
    }
}
