//! Which source may start an engine, and for how long an engine at rest may be sent run.

use super::case::{Case, Rule, seconds};
use super::fuel::{CLOSE_PUMP, OPEN_PUMP};
use crate::history::{
    Cause, Commanded, Frame, MS, Mark, PilotCommand, SECOND, START_WAIT_MAX, Sample, Sent, Spans, Switch,
};
use sim::turbine::Phase;
use std::collections::BTreeMap;

/// Time after a lower demand for which a falling exhaust temperature proves nothing.
const LOWERED: u64 = 5 * SECOND;
/// Time for which lower demands, one after the other, excuse a cold exhaust.
const EXCUSED: u64 = 15 * SECOND;
/// Time without a state after which an ECU is not known to be in standby.
const STATE_IS_OLD: u64 = 3 * SECOND + 500 * MS;
/// Time without a gap after which a lost source may be in control: other settings after a reset.
const RECOVERS: u64 = 300 * MS;
/// Difference by which an exhaust has to be colder than that of a burning engine, °C: an AMT report has steps of
/// 4.6 °C.
const BURNS: f64 = 10.0;
/// Fall in °C/s, and duration in s, with which values in steps of 4.6 °C show an exhaust that falls by 15 °C/s for 3 s.
const FALL: f64 = 19.0;
const FALLS_FOR: u64 = 5;

/// One source's own standby and then its own run at idle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Start {
    pub source: usize,
    pub at: u64,
    /// Time of its cancellation: by a stop, a disarm, a person, its own standby or a higher source's change
    /// to standby.
    pub until: u64,
    /// Time of its cancellation if it still waits: by any fresh source's change to standby.
    pub waits_until: u64,
    used: bool,
}

impl Case<'_> {
    /// Every pair of commands for a start.
    pub(super) fn pairs(&self) -> Vec<Start> {
        self.permissions().0
    }

    /// Every pair of commands for a start, and for a hand-over to the PWM input the time of its second one.
    fn permissions(&self) -> (Vec<Start>, Vec<u64>) {
        let mut starts: Vec<Start> = Vec::new();
        let mut hand_overs = Vec::new();
        let (mut ready, mut last) = ([false; 4], [None; 4]);
        let recovered = self.h.rules.recover_after + self.h.rules.takeover;
        let mut lost = self.h.resets.iter().filter(|reset| reset.cause != Cause::Watchdog).peekable();
        for commanded in &self.h.commanded {
            let (at, source) = (commanded.at, commanded.source);
            while lost.next_if(|reset| reset.down <= at).is_some() {
                // No permission outlives a loss of the node's power.
                ready = [false; 4];
            }
            // Of whom.
            let cancel = |starts: &mut Vec<Start>, of: &dyn Fn(usize) -> bool| {
                for start in starts.iter_mut().filter(|start| of(start.source)) {
                    start.until = start.until.min(at);
                }
            };
            match commanded.command {
                PilotCommand::Standby => {
                    let changed = matches!(last[source], Some((when, PilotCommand::Run(_))) if at <= when + self.command_log.age(source));
                    if changed {
                        ready = [false; 4];
                    }
                    ready[source] = true;
                    // A stray command of a source that was away changes nothing; one from a higher source has to take
                    // effect.
                    let commanding = self
                        .command_log
                        .commands_since(source, at)
                        .is_some_and(|since| at >= since + recovered);
                    // Below a source that has been in control for a while and commands run it does not take effect.
                    // One whose demand is close takes over as soon as it counts.
                    let behind = (0..source).any(|higher| {
                        matches!(self.command_log.fresh(higher, at), Some(PilotCommand::Run(_)))
                            && self.command_log.commands_since(higher, at).is_some_and(|since| {
                                at >= since + self.h.rules.recover_after.min(RECOVERS)
                                    || self.new_to_the_node(higher, since)
                            })
                    });
                    cancel(&mut starts, &|of| {
                        of == source && !behind || changed && commanding && source < of
                    });
                    for start in starts.iter_mut().filter(|_| changed) {
                        start.waits_until = start.waits_until.min(at);
                    }
                }
                PilotCommand::Run(demanded) => {
                    if core::mem::take(&mut ready[source]) && self.is_idle(demanded) {
                        starts.push(Start {
                            source,
                            at,
                            until: u64::MAX,
                            waits_until: u64::MAX,
                            used: false,
                        });
                    }
                }
                // One that is refused uses it, too.
                PilotCommand::Pwm => {
                    if core::mem::take(&mut ready[source]) {
                        hand_overs.push(at);
                    }
                }
                PilotCommand::Stop | PilotCommand::Disarm | PilotCommand::ShutDown => {
                    ready = [false; 4];
                    cancel(&mut starts, &|_| true);
                }
                _ => {}
            }
            if commanded.command.is_received() {
                last[source] = Some((at, commanded.command));
            }
        }
        (starts, hand_overs)
    }

    /// Time after its run for which a start may still light the engine.
    fn start_time(&self) -> u64 {
        let rules = &self.h.rules;
        // A ZK ECU reports the duration of its last start; twice that counts, within 5 s to 600 s.
        let own = if self.traits().reports_start_time { 120 * SECOND } else { 0 };
        rules.start_timeout.max(own) + rules.start_wait + 2 * SECOND
    }

    /// What really prevents a start at this instant.
    fn interlock(&self, at: u64) -> Option<String> {
        let h = self.h;
        if !self.command_log.armed(at) {
            return Some("it is not armed".into());
        }
        let stable = h.rules.link_stable.saturating_sub(300 * MS);
        // An outage that has only just begun, or is shorter than a gap with the boot after it, cannot be detected. An AMT ECU reports
        // that it was powered up.
        let seen_at = |(from, to): (u64, u64)| {
            let gap = (to + h.rules.boot - from >= self.gap()).then_some(from + self.gap());
            let reported = self.traits().reports_power_up.then_some(to + h.rules.boot);
            gap.into_iter().chain(reported).min()
        };
        let outage = |(from, to): (u64, u64)| {
            to > at.saturating_sub(stable) && seen_at((from, to)).is_some_and(|seen| at >= seen)
        };
        if h.unpowered.iter().any(outage) {
            return Some("its ECU was powered up just now".into());
        }
        let back = |(from, to): (u64, u64)| {
            to > at.saturating_sub(stable) && at >= from + self.gap() && to - from >= self.gap()
        };
        if h.mute.iter().any(back) {
            return Some("nothing was received of it until just now".into());
        }
        let last = |time: u64| h.samples(at.saturating_sub(time), at + 100 * MS);
        let coolest = last(1200 * MS).iter().map(|sample| sample.egt).fold(f64::MAX, f64::min);
        if at > 3 * SECOND && h.sensor.within(at - 3 * SECOND, at) == 3 * SECOND {
            return Some("the exhaust is not measured".into());
        }
        if at > STATE_IS_OLD && h.ruined.within(at - STATE_IS_OLD, at) == STATE_IS_OLD {
            return Some("nothing intact was received of it for 3.5 s".into());
        }
        // A ZK report has whole degrees, an AMT one steps of 4.6.
        if coolest > h.rules.egt_max + 6.0 && coolest < f64::MAX {
            return Some(format!("the exhaust has {coolest:.0} °C"));
        }
        let at_rest = |phase| match self.traits().reports_stages {
            // Cooling is reported as rest.
            false => matches!(phase, Phase::Stopped | Phase::Standby | Phase::Cooling),
            true => phase == Phase::Standby,
        };
        if !last(1000 * MS).is_empty() && !last(1000 * MS).iter().any(|sample| at_rest(sample.phase)) {
            return Some("the engine is not in standby".into());
        }
        let supply = h.rules.supply_counts || h.rules.limit_supply.is_some();
        // A node that has just begun starts an engine whose supply was not reported.
        let seldom = self.traits().supply_every > 0;
        let low_for = if seldom { self.two_supplies() } else { 2 * SECOND };
        let known = at > low_for && !(seldom && self.down.touches(at - low_for, at));
        if supply && known && h.low_supply.within(at - low_for, at) == low_for {
            return Some("the supply is low".into());
        }
        // A pump that its node has opened and not closed again.
        let pump = |sent| matches!(sent, Sent::Action(OPEN_PUMP | CLOSE_PUMP));
        let pump =
            h.frames_within(at.saturating_sub(2 * SECOND), at).iter().rev().find(|frame| pump(frame.sent));
        if pump.is_some_and(|frame| frame.sent == Sent::Action(OPEN_PUMP) && !self.down.touches(frame.at, at))
        {
            return Some("its pump is open".into());
        }
        // A test lasts for 3 s, and its ECU reports it.
        let tests = h.frames_within(at.saturating_sub(2500 * MS), at.saturating_sub(SECOND)).iter();
        if tests.clone().any(|frame| matches!(frame.sent, Sent::Action(2..=5)) && frame.arrived) {
            return Some("its ECU tests something".into());
        }
        if last(1600 * MS).iter().all(|sample| sample.fault) && !last(1600 * MS).is_empty() {
            return Some("the ECU reports a fault".into());
        }
        None
    }

    /// Why this start does not explain a running order at an instant; `None` if it does.
    fn not_by(&self, start: &Start, at: u64) -> Option<String> {
        let who =
            |why: &str| Some(format!("the start of source {} at {} {why}", start.source, seconds(start.at)));
        // A cancelled order is off the wire within the next two frames.
        if at > start.until.saturating_add(3 * self.h.rules.period + 50 * MS) {
            return who("was cancelled");
        }
        if at > start.at + self.start_time() {
            return who("is too long ago");
        }
        // Where no run is sent at once, it waits for another engine, for as long as its source is fresh.
        let began = self.began(start.at, at);
        let longest = |until| self.longest_gap(start.source, start.at, until);
        // Whether it waited is visible at the next slot at the earliest.
        let hung = self.stalled().within(start.at, began);
        let waited = began > start.at + hung + self.h.rules.period + 100 * MS;
        if waited && began > start.waits_until.saturating_add(self.h.rules.period + 100 * MS) {
            return who("waited, and was cancelled");
        }
        if began > start.at + SECOND && longest(began) > self.command_log.age(start.source) + 200 * MS {
            return who("waited, and its source was lost");
        }
        let slot = self.h.rules.period + 100 * MS;
        if waited && self.behind(start.source, start.at, began.saturating_sub(slot)) {
            return who("waited, and a higher source was in control meanwhile");
        }
        if began > start.at + START_WAIT_MAX + slot {
            return who("waited for longer than 180 s");
        }
        let stages = super::control::to_fail_safe(self.h)
            + self.h.rules.standby_after.unwrap_or(10 * SECOND)
            + 2 * SECOND;
        if longest(at) > stages {
            return who("is of a source that was silent for too long");
        }
        if waited {
            // Everything is checked again when it begins. It begins at an instant between two slots.
            let before = began.saturating_sub(self.h.rules.period + 50 * MS);
            let commands = self.command_log.until(start.source, began);
            let last = commands.partition_point(|(at, _)| *at <= before).saturating_sub(1);
            let mut demanded = commands[last..].iter().map(|(_, command)| command);
            if !demanded
                .any(|command| matches!(command, PilotCommand::Run(demanded) if self.is_idle(*demanded)))
            {
                return who("waited, and its source did not command run at idle any more");
            }
            if let Some(why) = self.interlock(began).filter(|_| self.interlock(before).is_some()) {
                return who(&format!("waited, and was not to be granted when it went: {why}"));
            }
        }
        // Every interlock counts at that instant; only for another engine's start does it wait.
        self.interlock(start.at).and_then(|why| who(&format!("was not to be granted: {why}")))
    }

    /// Whether a source above this one has commanded run, and was in control, within these times.
    fn behind(&self, source: usize, from_us: u64, to_us: u64) -> bool {
        let settled = self.h.rules.recover_after + self.h.rules.takeover + 200 * MS;
        self.h.commanded(from_us, to_us).iter().any(|higher| {
            higher.source < source
                && matches!(higher.command, PilotCommand::Run(_))
                && self
                    .command_log
                    .commands_since(higher.source, higher.at)
                    .is_some_and(|since| higher.at >= since + settled)
        })
    }

    /// Whether this source was never received before, or the node was reset since: to the node it is a new one, which may be in
    /// control at once.
    fn new_to_the_node(&self, source: usize, since: u64) -> bool {
        let Some((before, _)) = self.command_log.last(source, since.saturating_sub(1)) else { return true };
        self.h.resets.iter().any(|reset| (before..=since).contains(&reset.up))
    }

    /// When run is sent after a commanded start, within this time.
    fn began(&self, requested: u64, at: u64) -> u64 {
        self.h.first_run(requested, at).map_or(at, |frame| frame.at)
    }

    /// When the ECU has reported a start in progress: a state after it began; damaged frames until `at` report nothing.
    fn reported_by(&self, start: u64, at: u64) -> u64 {
        let begun = self.live.last_before(at).map_or(start, |(lit, _)| lit.max(start));
        begun + self.one_state() + self.h.noise.within(begun, at)
    }

    /// Whether an AMT ECU that was powered up then may still report the state of before, with its shaft turning: a running engine.
    fn shows_the_run_before(&self, powered_up: u64, at: u64) -> bool {
        let rules = &self.h.rules;
        let reports = rules.boot + (1 + rules.stale) * rules.period + 100 * MS;
        // By the setting: 20 in the raw unit in which idle is 60 to 74.
        let turns = self.h.sample(at).is_some_and(|sample| sample.rpm > rules.idle_rpm / 4.0);
        rules.stale > 0 && self.traits().reports_power_up && at < powered_up + reports && turns
    }

    /// The longest time without a command of a source, from one of its commands on.
    fn longest_gap(&self, source: usize, from_us: u64, to_us: u64) -> u64 {
        let commands = self.command_log.until(source, to_us);
        let commands = &commands[commands.partition_point(|(at, _)| *at < from_us)..];
        let ends = commands.iter().skip(1).map(|(at, _)| *at).chain([to_us]);
        commands.iter().zip(ends).map(|((at, _), end)| end - at).max().unwrap_or(to_us - from_us)
    }

    pub(super) fn starts(&mut self) {
        let mut starts = self.pairs();
        let h = self.h;
        for &(at, mark) in &h.marks {
            if mark != Mark::Ignition || h.pwm.contains(at) {
                continue;
            }
            // An ECU that no longer receives anything acts on the last intact command that reached it.
            let frames = &h.frames[..h.frames.partition_point(|frame| frame.at + h.rules.frame <= at)];
            let received = frames.iter().rev().find(|frame| frame.arrived && frame.sent.switch().is_some());
            let sent = received
                .filter(|frame| frame.sent.switch() == Some(Switch::Run))
                .map_or(at, |frame| frame.at);
            let mut why = "no source commanded standby and then run at idle".to_string();
            let mut by = None;
            for (index, start) in starts.iter().enumerate().rev().filter(|(_, start)| start.at <= at).take(8)
            {
                match self.not_by(start, sent.max(start.at)) {
                    None if start.used => {
                        let used = format!("the start of source {} was used before", start.source);
                        why = used;
                    }
                    None => by = by.or(Some(index)),
                    Some(not) => {
                        if by.is_none() && why.starts_with("no source") {
                            why = not;
                        }
                    }
                }
            }
            if let Some(index) = by {
                starts[index].used = true;
                let waited = self.began(starts[index].at, at) > starts[index].at + SECOND;
                self.verdict.count("starts that waited", u64::from(waited));
                continue;
            }
            // An outage and boot shorter than a gap cannot be detected, and in a start that was not reported yet, a report of
            // rest is still consistent.
            let unseen = h.unpowered.last_before(at).filter(|(from, to)| {
                let start = starts.iter().rev().find(|start| start.at <= *from).map_or(0, |start| start.at);
                let shows = if *from < self.reported_by(start, *from) { self.start_time() } else { SECOND };
                // The set-up set that shows it may be lost in a cut, and one more of before may come after it.
                let lost = h.rules.stale > 0 && h.mute.contains(to + h.rules.boot);
                at < to + h.rules.boot + shows
                    && to + h.rules.boot - from < self.gap()
                    && (!self.traits().reports_power_up || lost)
            });
            if let Some((from, to)) = unseen {
                self.verdict.exempt("outage of the ECU that is shorter than a gap", to + h.rules.boot - from);
                continue;
            }
            // After a cut that is shorter than the serial delay, the first set is answered if it shows a running engine.
            let hidden = h.unpowered.last_before(at).and_then(|(_, on)| {
                let set_up = on + h.rules.boot;
                let (from, to) = h.mute.iter().find(|(from, to)| (*from..*to).contains(&set_up))?;
                let answered = to - from < h.rules.serial_delay && at < to + 2 * SECOND;
                (self.shows_the_run_before(on, to) && answered).then_some(at - to)
            });
            if let Some(time) = hidden {
                self.verdict.exempt("AMT, a set of before the loss of power, after a cut that hid it", time);
                continue;
            }
            // The order was correct when it was given, and none can reach the ECU since: AMT transmits only replies.
            // Until its serial delay is over the ECU acts on that command.
            let cut = h.mute.last_before(at).filter(|(from, to)| {
                // After the cut, error sets get no reply either, nor does an engine that has cleared its fault and may be coasting.
                let faults = self.faults.within(*to, at) + 2 * h.rules.period >= at.saturating_sub(*to);
                let coasts = self.faults.touches(at.saturating_sub(5 * SECOND), at);
                let nothing_sent = coasts && h.frames_within(*to, at).is_empty();
                let unanswered = at < to + h.rules.period + 50 * MS || faults || nothing_sent;
                let silent = sent + 2 * h.rules.period + 50 * MS >= *from && unanswered;
                // With error sets the order continues until the exhaust shows that the engine is out.
                let faulted = self.faults.contains(sent) && self.live.longer(4 * SECOND).contains(sent);
                self.traits().replies_only
                    && silent
                    && at < sent + h.rules.gives_up_after + SECOND
                    && (self.live.contains(sent) || faulted)
            });
            if let Some((from, _)) = cut {
                self.verdict.exempt("AMT, a relight by the ECU while the wire to the node is cut", at - from);
                continue;
            }
            // An ECU that boots with run on its PWM input starts without a command, until the first frame on
            // the line.
            let booted = h
                .unpowered
                .last_before(at)
                .is_some_and(|(_, on)| at >= on && at < on + h.rules.boot + 2 * h.rules.period + 50 * MS);
            let ordered = frames.iter().rev().find_map(|frame| frame.sent.switch()) == Some(Switch::Run);
            if booted && !ordered && h.pwm_signal.contains(at) {
                continue;
            }
            // No run was sent: with any checksum, noise on the line forms a command now and then.
            let sent_run = frames.iter().rev().find_map(|frame| frame.sent.switch()) == Some(Switch::Run);
            let lately = at.saturating_sub(h.rules.period + 50 * MS);
            if !sent_run && h.noise_to_ecu.touches(lately, at) {
                self.verdict.exempt("a command that noise has made", at - lately);
                continue;
            }
            // Nothing sent since the flame went out has reached the ECU: it acts on an earlier command.
            let out = self.live.iter().map(|(_, to)| to).take_while(|to| *to <= at).last();
            let last = received.map_or(0, |frame| frame.at);
            let deaf = out.filter(|out| {
                last <= *out && self.live.contains(last) && h.deaf.within(last + h.rules.period, at) > 0
            });
            if let Some(out) = deaf {
                self.verdict.exempt("a relight by the ECU while the wire to it is cut", at - out);
                continue;
            }
            // Nor has a node that was reset sent anything: to one report that does not show a running engine it replies nothing.
            let reset = h.resets.iter().any(|reset| (last..at).contains(&reset.down));
            // As far as its ECU reports.
            let ran = h.sample(last).is_some_and(|sample| sample.phase == Phase::Running);
            let unsent = frames.last().is_some_and(|frame| frame.at <= last);
            let acts = at < last + h.rules.gives_up_after;
            if self.traits().replies_only && reset && ran && unsent && acts {
                self.verdict.exempt(
                    "AMT, a relight by the ECU that a reset of the node leaves without a reply",
                    at - last,
                );
                continue;
            }
            // Noise hid that the flame had gone out, or that a start had failed: it acts on the last run that it was sent.
            let hidden = out.filter(|out| {
                let noise = h.noise.within(*out, at).min(10 * SECOND);
                self.traits().replies_only
                    && !self.live.contains(at.saturating_sub(1))
                    && noise > 0
                    && sent <= out + self.one_state() + noise
                    && at < sent + h.rules.gives_up_after + SECOND
            });
            if let Some(out) = hidden {
                self.verdict.exempt(
                    "AMT, an ignition by the ECU after noise that hid the end of the last one",
                    at - out,
                );
                continue;
            }
            // With error sets only, the order continues until the exhaust shows that the engine is out, within 4 s: an ECU that
            // clears its fault before that, and starts again on the run that it was sent, cannot be detected. Nor can one whose
            // exhaust is still hot and falls slowly, because a lower demand explained its fast fall.
            let tripped = out.is_some_and(|out| {
                // A visible fall, or a lowered demand, after the last set that was answered with run comes too late.
                let answered = at.min(sent + h.rules.period + 50 * MS);
                // A fall proves nothing within 5 s after the demand was lowered, also by the stages of loss.
                let lowered = self.last_lowered(out.saturating_sub(LOWERED), answered);
                let counts = lowered.map_or(out, |lowered| out.max(lowered + LOWERED));
                // Two sets have to agree that it is too cold for combustion, and nothing is sent after the last one that was answered.
                let since = h.samples(out, at.saturating_sub(2 * h.rules.period + 50 * MS));
                let up =
                    h.resets.iter().map(|reset| reset.up).filter(|up| *up <= at).max().unwrap_or_default();
                // What is not measured shows neither a cold exhaust nor a fall.
                let measured = h.sensor.last_before(at).map_or(0, |(_, over)| over);
                // Without a flame the shaft keeps turning for a while, and the engine may be reported as
                // running. So may one in a start: a node that has lost its memory takes it for a running one.
                let lit = self.live.last_before(out.saturating_sub(1)).map_or(out, |(lit, _)| lit);
                let forgot = h.forgets(lit, out);
                let burnt = h.samples(out.saturating_sub(10 * SECOND), out);
                let burnt = burnt.iter().any(|sample| match sample.phase {
                    Phase::LearningIdle | Phase::Running => sample.lit,
                    Phase::FuelRamp => sample.lit && forgot,
                    _ => false,
                });
                // The ECU acts on what was sent before the fault cleared, also for a moment after that. It
                // reports the fault a moment after the flame went out, or that it runs until then.
                let ran = |sample: &Sample| {
                    let before = h.sample(sample.at.saturating_sub(60 * MS));
                    before.is_some_and(|before| matches!(before.phase, Phase::LearningIdle | Phase::Running))
                };
                let before = h.samples(out + 60 * MS, sent.saturating_sub(h.rules.period + 50 * MS));
                self.traits().faults_hide_state
                    && burnt
                    && !since.is_empty()
                    && since.iter().any(|sample| sample.fault)
                    && before.iter().all(|sample| sample.fault || ran(sample))
                    && since.iter().all(|sample| {
                        sample.egt > h.rules.burning - BURNS
                            || sample.at < counts
                            || sample.at > answered
                            || !self.trusts_exhaust(sample.at)
                    })
                    // Nor does a node that is reset again too soon see the exhaust temperature fall.
                    && (self.longest_up(counts, at.saturating_sub(100 * MS)) < 4 * SECOND
                        || self.fallen(counts.max(up).max(measured), answered).is_none())
            });
            if let Some(out) = out.filter(|_| tripped) {
                self.verdict.exempt("AMT, a trip that clears while the exhaust is hot", at - out);
                continue;
            }
            self.verdict.finding(Rule::Ignition, at, format!("ignition, and {why}"));
        }
        self.verdict.count("starts", starts.iter().filter(|start| start.used).count() as u64);
    }

    pub(super) fn run_at_rest(&mut self) {
        let h = self.h;
        let starts = self.pairs();
        let lives = self.starts_of_life();
        let gaps = self.gaps();
        let mut reported = 0;
        let mut exempt: BTreeMap<&'static str, Spans> = BTreeMap::new();
        for frame in h.frames.iter().filter(|frame| frame.sent.switch() == Some(Switch::Run)) {
            let at = frame.at;
            if at < reported || self.live.contains(at) || h.pwm.contains(at) {
                continue;
            }
            let mut is_exempt = |name| exempt.entry(name).or_default().push(at, at + h.rules.period);
            // AMT sets have no checksum: a set that no ECU sent, and that reports running, gets a reply.
            let forged = h.forged[..h.forged.partition_point(|forged| *forged <= at)].last();
            if !self.traits().checksum && forged.is_some_and(|forged| at <= forged + h.rules.period + 50 * MS)
            {
                is_exempt("the reply to an AMT set that no ECU sent");
                continue;
            }
            let went_out = self.live.last_before(at).map(|(_, to)| to);
            // A gap that is not over, and long enough to be detected.
            let in_gap =
                gaps.last_before(at).filter(|(from, to)| at < *to && at > from + self.gap_from(*from));
            let anew = lives[..lives.partition_point(|life| *life <= at)].last().copied();
            if in_gap.is_none() {
                // A start that has not lit the engine yet.
                let next = latest(&starts, at).find(|start| {
                    went_out.is_none_or(|out| out < start.at)
                        && anew.is_none_or(|anew| anew < start.at)
                        && (start.at + 100 * MS > at || self.not_by(start, at).is_none())
                });
                if next.is_some() {
                    continue;
                }
                // A start that the ECU has not reported yet, and an outage that cannot be detected: a report of rest is still
                // consistent. A gap that has just begun cannot be detected yet.
                let unreported = latest(&starts, at).any(|start| {
                    let reported = self.reported_by(start.at, at);
                    went_out.is_some_and(|out| out >= start.at && out < reported)
                        && anew.is_none_or(|anew| anew < reported + self.gap())
                        && !gaps.touches(start.at, at.saturating_sub(self.gap()).max(start.at))
                        // An AMT ECU reports it in each set: only noise can hide it.
                        && (self.traits().rounds || h.noise.touches(start.at, reported))
                        && !self.shows_cooling(at)
                        && self.not_by(start, at).is_none()
                });
                if unreported {
                    is_exempt("a start that was not reported yet, and an outage that cannot be seen");
                    continue;
                }
                // With error sets in a start, nothing shows that it failed if the exhaust temperature is not used: the
                // start timeout applies.
                let failed_start = latest(&starts, at).any(|start| {
                    self.traits().faults_hide_state
                        && went_out.is_some_and(|out| {
                            out >= start.at
                                && !self.runs.touches(start.at, at)
                                && h.samples(out + 100 * MS, at).iter().all(|sample| sample.fault)
                        })
                        && anew.is_none_or(|anew| anew < start.at)
                        && self.not_by(start, at).is_none()
                });
                if failed_start {
                    is_exempt("AMT, error sets since a start failed");
                    continue;
                }
                // An AMT ECU reports that it was powered up.
                let not_received = h.noise.union(&h.mute).union(&self.down);
                let powered = h.unpowered.last_before(at).map(|(_, powered)| powered);
                let announced = powered.is_some_and(|powered| {
                    let set_up = powered + h.rules.boot;
                    self.traits().reports_power_up
                        && went_out.is_some_and(|out| out <= powered)
                        && at > set_up
                        && !not_received.touches(powered, set_up + 200 * MS)
                });
                // The engine went out: the first report that shows it is enough.
                let unseen = |from: u64| {
                    anew.is_none_or(|anew| anew < from || anew < from + self.gap() + h.rules.boot)
                };
                let seen = went_out.map(|out| {
                    let noise = h.noise.within(out, at);
                    let down = self.down.within(out, at);
                    let fault = h.samples(out, at).iter().any(|sample| sample.fault);
                    // With faults in place of a state, the exhaust has to be cold, or to be cooling.
                    let hot = if self.traits().faults_hide_state && fault {
                        self.put_out_by_exhaust(out, at) - out
                    } else {
                        0
                    };
                    let report = out + self.one_state();
                    let name = match () {
                        () if at <= report => "the report of an engine that went out is on its way",
                        () if hot > 0 => "AMT, error sets until the exhaust shows that the engine is out",
                        () => "noise or a reset hides the report of an engine that went out",
                    };
                    (out, report + hot + noise.min(10 * SECOND) + down, name)
                });
                // With error sets only the exhaust shows it.
                let by_exhaust = |out| {
                    self.traits().faults_hide_state
                        && h.samples(out, at).iter().all(|sample| sample.fault || sample.phase.is_live())
                };
                let seen = seen
                    .filter(|(out, until, _)| at <= *until && (unseen(*out) || by_exhaust(out + 100 * MS)));
                if let Some((_, _, name)) = seen.filter(|_| !announced) {
                    is_exempt(name);
                    continue;
                }
                // A reset of the node or a wire that was cut hid the power-up, and the first reports still show that the engine runs,
                // with its shaft turning: a running engine.
                let is_hidden = |from| self.down.touches(from, at) || h.mute.touches(from, at);
                let stale = anew.is_some_and(|anew| {
                    self.shows_the_run_before(anew, at) && powered.is_some_and(is_hidden)
                });
                if stale {
                    is_exempt(
                        "AMT, the first reports after a power-up that was not received are those of before",
                    );
                    continue;
                }
                // The order of a start is cancelled: frames in progress are over with the next frames.
                let taken = starts.iter().any(|start| {
                    start.at < at
                        && at <= start.until.saturating_add(3 * h.rules.period + 50 * MS)
                        && start.until < at
                        && went_out.is_none_or(|out| out < start.at)
                        && anew.is_none_or(|anew| anew < start.at)
                });
                if taken {
                    is_exempt("a start was taken back, and its last frames are on their way");
                    continue;
                }
            }
            let since = |what: &str, at: Option<u64>| {
                at.map_or(String::new(), |at| format!(", {what} {}", seconds(at)))
            };
            self.verdict.finding(
                Rule::RunAtRest,
                at,
                format!(
                    "run for an engine at rest{}{}{}",
                    since("which went out at", went_out),
                    since("ECU or line back since", anew),
                    if in_gap.is_some() { ", and nothing is received of it" } else { "" },
                ),
            );
            reported = at + 10 * SECOND;
        }
        self.verdict.at_rest.applied = h.end - self.live.total().min(h.end);
        for (name, spans) in exempt {
            self.verdict.at_rest.exempt(name, spans.total());
        }
    }

    /// Whether a report of cooling, which no start has, was received lately.
    fn shows_cooling(&self, at: u64) -> bool {
        let h = self.h;
        let since = at.saturating_sub(self.one_state() + h.rules.period + 100 * MS);
        let samples = h.samples(since, at);
        let hidden = [&h.noise, &h.mute, &h.unpowered, &self.down];
        self.traits().reports_stages
            && !samples.is_empty()
            && samples.iter().all(|sample| sample.phase == Phase::Cooling)
            && !hidden.iter().any(|spans| spans.touches(since, at))
    }

    /// When the exhaust has shown that its engine went out: it is cold, or falls fast enough for long enough, and not
    /// because a lower demand was commanded.
    fn put_out_by_exhaust(&self, out: u64, at: u64) -> u64 {
        let h = self.h;
        if h.sensor.contains(out) {
            return at;
        }
        // A thermocouple that broke in the meantime counts again once it has been hot.
        let broke = h.sensor.iter().map(|(from, _)| from).filter(|from| (out..at).contains(from)).min();
        let whole = broke.unwrap_or(at);
        let samples = h.samples(out, whole);
        let seen = |sample: &&Sample| sample.egt < h.rules.burning - BURNS && self.trusts_exhaust(sample.at);
        let cold = samples.iter().find(seen).map_or(at, |cold| cold.at + LOWERED);
        if let Some(lowered) = self.last_lowered(out.saturating_sub(LOWERED), at) {
            // A cold exhaust that a lower demand explained until the thermocouple broke proves nothing after that, and a fall does.
            let over = h.sensor.last_before(at).map(|(_, over)| over);
            return match over.filter(|_| broke.is_some_and(|broke| broke <= lowered + LOWERED)) {
                Some(over) => self.fallen(over, at).map_or(at, |fallen| fallen.max(lowered + LOWERED)),
                None => cold.max(lowered + LOWERED).min(cold + EXCUSED),
            };
        }
        // A node that was reset has to see the fall again.
        let up = h.resets.iter().map(|reset| reset.up).filter(|up| *up <= at).max().unwrap_or_default();
        // Nor can the node see it while nothing is received.
        let dark =
            self.blind.iter().filter(|(from, to)| to - from > self.gap() && *to <= at).map(|(_, to)| to);
        let up = dark.max().unwrap_or_default().max(up);
        self.fallen(out.max(up), whole.max(out.max(up))).map_or(cold, |fallen| fallen.min(cold))
    }

    /// Whether a cold exhaust counts: it is measured, and after a thermocouple that failed it was hot before.
    fn trusts_exhaust(&self, at: u64) -> bool {
        let h = self.h;
        let over = h.sensor.iter().map(|(_, over)| over).take_while(|over| *over <= at).last();
        let hot = |sample: &Sample| sample.egt > h.rules.burning + BURNS;
        !h.sensor.contains(at) && over.is_none_or(|over| h.samples(over, at).iter().any(hot))
    }

    /// When the exhaust has fallen fast enough, and for long enough, to show it.
    fn fallen(&self, from_us: u64, to_us: u64) -> Option<u64> {
        let egt = |at| self.h.sample(at).map_or(0.0, |sample| sample.egt);
        let falls =
            |at: u64| (0..FALLS_FOR).all(|n| egt(at - (n + 1) * SECOND) - egt(at - n * SECOND) > FALL);
        let mut samples = self.h.samples(from_us, to_us).iter().map(|sample| sample.at);
        samples.find(|at| *at >= from_us + FALLS_FOR * SECOND && falls(*at))
    }

    /// The last frame in this time with a lower demand than the one before it.
    pub(super) fn last_lowered(&self, from_us: u64, to_us: u64) -> Option<u64> {
        let demand = |frame: &Frame| frame.sent.demand().map_or(0.0, |demanded| self.share(demanded));
        let mut pairs = self.h.frames_within(from_us, to_us).windows(2).rev();
        pairs.find(|pair| demand(&pair[1]) < demand(&pair[0])).map(|pair| pair[1].at)
    }

    pub(super) fn hand_over(&mut self) {
        let h = self.h;
        let pwm = |switch| switch == Some(Switch::Pwm);
        let begin =
            h.frames.windows(2).filter(|pair| pwm(pair[1].sent.switch()) && !pwm(pair[0].sent.switch()));
        self.verdict.count("hand-overs to the PWM input", begin.count() as u64);
        let lives = self.starts_of_life();
        let (_, permitted) = self.permissions();
        let commands: Vec<&Commanded> =
            h.commanded.iter().filter(|commanded| commanded.command == PilotCommand::Pwm).collect();
        let mut reported = 0;
        for frame in h.frames.iter().filter(|frame| frame.sent.switch() == Some(Switch::Pwm)) {
            let at = frame.at;
            if at < reported {
                continue;
            }
            // One that is refused takes nothing from an earlier one.
            let commands = &commands[..commands.partition_point(|commanded| commanded.at <= at)];
            let mut against =
                commands.iter().rev().take(8).map(|commanded| match permitted.binary_search(&commanded.at) {
                    Err(_) => Some("its source had used its standby, or somebody had taken it back"),
                    Ok(_) => self.against_hand_over(commanded, at, &lives),
                });
            let why = match against.next() {
                None => Some("no source commanded it"),
                Some(last) => last.filter(|_| against.all(|earlier| earlier.is_some())),
            };
            if let Some(why) = why {
                self.verdict.finding(Rule::Pwm, at, format!("the PWM input is given the engine, and {why}"));
                reported = at + 10 * SECOND;
            }
        }
    }

    /// Why this command does not explain a hand-over at an instant; `None` if it does.
    fn against_hand_over(&self, commanded: &Commanded, at: u64, lives: &[u64]) -> Option<&'static str> {
        let h = self.h;
        let own = h.last_command(commanded.source, commanded.at, |command| {
            matches!(command, PilotCommand::Standby | PilotCommand::Run(_))
        });
        // A command takes effect when its source is in control, and a second one has followed.
        let effect = h.rules.recover_after + h.rules.takeover + 700 * MS;
        let stop = h.commanded(commanded.at + 1, at.saturating_sub(200 * MS)).iter();
        let stop = stop.clone().any(|later| later.command == PilotCommand::Stop);
        let since = h.commanded(commanded.at + 1, at.saturating_sub(effect));
        let slack = self.gap() + h.rules.boot;
        let taken_back = |later: &Commanded| {
            let otherwise =
                |higher| matches!(self.command_log.fresh(higher, later.at), Some(PilotCommand::Run(_)));
            later.command == PilotCommand::Standby
                && later.source <= commanded.source
                && !(0..later.source).any(otherwise)
        };
        if own.is_none_or(|own| own.command != PilotCommand::Standby) {
            Some("its source had not commanded standby")
        } else if !self.command_log.armed_within(commanded.at.saturating_sub(MS), commanded.at) {
            Some("the engine was not armed")
        } else if stop || since.iter().any(taken_back) {
            Some("it was taken back")
        } else if h.resets.iter().any(|reset| (commanded.at..at).contains(&reset.up)) {
            Some("the node was reset since")
        } else if lives.iter().any(|anew| *anew > commanded.at && at > anew + slack) {
            Some("the ECU was powered up, or the line lost, since")
        } else {
            None
        }
    }
}

/// The most recent starts up to an instant, the latest first.
fn latest(starts: &[Start], at: u64) -> impl Iterator<Item = &Start> {
    starts.iter().rev().filter(move |start| start.at <= at).take(4)
}
