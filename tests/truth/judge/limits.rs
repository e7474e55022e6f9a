//! Whatever lowers a demand has to do so: limits, another engine that has failed, a source that has yet to take
//! over.

use super::case::{Case, Rule, gap, is_above_fail_safe, seconds, two_states};
use super::control::{CommandLog, silences};
use crate::history::{
    Cause, Commanded, Demanded, Frame, History, MS, Mark, PilotCommand, SECOND, Sample, Spans, Switch,
};
use sim::turbine::Phase;

/// Excess over a limit from which a value is reported as beyond it: °C, rpm.
const BEYOND: f64 = 12.0;
const BEYOND_RPM: f64 = 2500.0;
/// A speed below this fraction of the one 1.4 s ago is a loss of 25 % within 2 s, whichever values the node
/// receives.
const LOST: f64 = 0.7;
const LOST_WITHIN: u64 = 1400 * MS;
/// Time by which a failure has shown.
const FAILED: u64 = 8 * SECOND;
/// Time for which a lower demand explains a shaft that runs down.
const SPOOLS_DOWN: u64 = 8 * SECOND;
/// Rise in this time, in °C, that is faster than 200 °C/s.
const RISE: f64 = 165.0;
const RISES_WITHIN: u64 = 750 * MS;
/// A shaft that turns faster than this, and is then reported at rest, changes by more than the limit of 150
/// 000 rpm/s.
const JUMPS: f64 = 60_000.0;
/// Resolution of the wire, 0.1 %.
const STEP: f64 = 8.0;

/// A source that commands for the first time in a long while, and the one in control: their throttles, 0.1 %.
pub(super) struct Arrival {
    pub wanted: u32,
    /// The source in control.
    pub lower: usize,
    pub held: u32,
}

impl Case<'_> {
    /// The demand on the wire, and whether it is sent run, at an instant.
    fn sent_at(&self, at: u64) -> (Option<Demanded>, Option<Switch>) {
        let frames = &self.h.frames[..self.h.frames.partition_point(|frame| frame.at <= at)];
        let recent = || frames.iter().rev().take(64).take_while(|frame| frame.at + 2 * SECOND > at);
        (recent().find_map(|frame| frame.sent.demand()), recent().find_map(|frame| frame.sent.switch()))
    }

    pub(super) fn limits(&mut self) {
        let rules = self.h.rules;
        if let Some((egt, standby)) = rules.limit_egt {
            self.limit(standby, "the exhaust", |sample| sample.egt > egt + BEYOND);
        }
        if let Some((rpm, standby)) = rules.limit_rpm {
            // With a fault the speed may not be reported.
            let hides = self.traits().faults_hide_state;
            let reported = move |sample: &Sample| !hides || !sample.fault;
            self.limit(standby, "the shaft speed", |sample| {
                sample.rpm > rpm + BEYOND_RPM && reported(sample)
            });
        }
        if let Some((rpm, standby)) = rules.limit_low_rpm {
            let hides = self.traits().faults_hide_state;
            let reported = move |sample: &Sample| !sample.hidden && (!hides || !sample.fault);
            self.limit(standby, "the shaft speed, which is low,", |sample| {
                sample.rpm < rpm - BEYOND_RPM && reported(sample)
            });
        }
        if let Some(standby) = rules.limit_supply {
            // While it runs.
            let low = self.h.times(|sample| sample.runs() && self.h.low_supply.contains(sample.at));
            self.acts(standby, "the supply", &low, self.two_supplies());
        }
        if let Some(standby) = rules.limit_jump {
            self.jumps(standby);
        }
        if let Some(standby) = rules.limit_fault {
            self.limit(standby, "the ECU's fault", |sample| sample.fault);
        }
        if let Some(standby) = rules.limit_flame {
            self.acts(standby, "a shaft that runs down", &self.flame_outs(), self.two_values());
        }
        if let Some(standby) = rules.limit_hot {
            let hot = self.hot_starts();
            self.acts(standby, "the rise of the exhaust in a start", &hot, self.two_values());
        }
    }

    /// A limit that two values exceed has its action on the wire, also when the value is within it again.
    fn limit(&mut self, standby: bool, what: &str, beyond: impl Fn(&Sample) -> bool) {
        let exceeded = self.h.times(|sample| sample.runs() && beyond(sample));
        self.acts(standby, what, &exceeded, self.two_values());
    }

    /// `reports`: the time in which two values of it arrive.
    fn acts(&mut self, standby: bool, what: &str, passed: &Spans, reports: u64) {
        let h = self.h;
        let rules = &h.rules;
        let fall = 1000 * SECOND / u64::from(rules.ramp.min(rules.slew_down.unwrap_or(rules.ramp)).max(1));
        let acts = reports + if standby { SECOND } else { fall + SECOND };
        let hidden = self.blind.union(&h.noise).union(&self.down).union(&h.sensor).longer(2 * SECOND);
        let live = self.live.clone();
        let mut judged = 0;
        for (from, to) in passed.at_least(reports).iter() {
            let at = from + acts;
            let out = live.last_before(from + 1).map_or(0, |(_, out)| out);
            if hidden.touches(from.saturating_sub(SECOND), at + 1)
                || h.pwm.touches(from, at + 1)
                || at >= out
                || from < judged
            {
                continue;
            }
            let text = format!("{what} is beyond its limit since {} until {}", seconds(from), seconds(to));
            if !standby {
                judged = self.stays_at_fail_safe(from, at, out, &text);
                continue;
            }
            let (demand, switch) = self.sent_at(at);
            self.verdict.count("limits that shut down", 1);
            if switch == Some(Switch::Run) {
                let demand = demand.map_or("run".into(), |demand| demand.to_string());
                self.verdict.finding(Rule::Limit, at, format!("{text}, and {demand} is on the wire"));
            }
        }
    }

    /// The end of the time for which a demand that a limit has lowered stays low: until standby is commanded, also across resets.
    fn stays_at_fail_safe(&mut self, passed: u64, at: u64, out: u64, text: &str) -> u64 {
        let h = self.h;
        let ends =
            |command| matches!(command, PilotCommand::Standby | PilotCommand::ShutDown | PilotCommand::Stop);
        let ended =
            h.commanded(passed.saturating_sub(2 * SECOND), out).iter().find(|other| ends(other.command));
        let lost = h.resets.iter().find(|reset| reset.up > at && reset.cause != Cause::Watchdog);
        // It does not outlast the order, which is given up when no set was answered in that time.
        let long = self.order_outlasts();
        let pairs = h.frames_within(passed.saturating_sub(long), out).windows(2);
        let gone = pairs.map(|pair| (pair[0].at, pair[1].at)).find(|(from, to)| to - from > long);
        let until = ended.map_or(out, |ended| ended.at).min(lost.map_or(out, |lost| lost.down));
        let until = until.min(gone.filter(|_| self.traits().serial_delay).map_or(out, |(from, _)| from));
        if until <= at {
            return passed;
        }
        self.verdict.count("limits that hold a demand low", 1);
        self.verdict.count("seconds for which a limit holds a demand low", (until - at) / SECOND);
        let high = |frame: &&Frame| {
            // Until the ECU reports a running engine, the start throttle is sent, whatever is demanded.
            let starts = |tenths| {
                let known = frame.at.saturating_sub(self.two_states());
                tenths <= h.rules.start_throttle && !h.samples(passed, known).iter().any(Sample::runs)
            };
            frame.sent.demand().is_some_and(|demanded| {
                is_above_fail_safe(h, demanded)
                    && !matches!(demanded, Demanded::Throttle(tenths) if starts(tenths))
            })
        };
        let frame = h.frames_within(at, until).iter().find(high);
        if let Some(frame) = frame {
            self.verdict.finding(Rule::Limit, frame.at, format!("{text}, and {} is on the wire", frame.sent));
        }
        until
    }

    /// Two consecutive frames that report the shaft of a running engine at rest: no turbine stops in that
    /// time.
    fn jumps(&mut self, standby: bool) {
        let h = self.h;
        let rules = &h.rules;
        let fall = 1000 * SECOND / u64::from(rules.ramp.min(rules.slew_down.unwrap_or(rules.ramp)).max(1));
        let acts = self.two_values() + if standby { SECOND } else { fall + SECOND };
        let hidden = self
            .blind
            .union(&self.down)
            .union(&h.deaf)
            .union(&h.garbled)
            .union(&h.framing)
            .longer(2 * SECOND);
        for &jump in &h.jumps {
            let at = jump + acts;
            let since = jump.saturating_sub(2 * SECOND);
            let (Some((_, out)), false) = (self.live.last_before(jump), h.pwm.touches(since, at)) else {
                continue;
            };
            // An AMT ECU that reports faults reports no speed.
            let faults = self.traits().faults_hide_state && self.faults.touches(since, at);
            // Slower ones change by less than the limit, where a set without a speed lies between.
            let fast = h.sample(jump).is_some_and(|sample| sample.rpm > JUMPS && !sample.hidden);
            if !fast || !self.known_to_run(jump) || faults || at >= out || hidden.touches(since, at + 1) {
                continue;
            }
            self.verdict.count("speeds that no turbine makes", 1);
            let text = format!("the shaft speed changes at {} as no turbine does", seconds(jump));
            if !standby {
                self.stays_at_fail_safe(jump, at, out, &text);
            } else if let (demand, Some(Switch::Run)) = self.sent_at(at) {
                let demand = demand.map_or("run".into(), |demand| demand.to_string());
                self.verdict.finding(Rule::Limit, at, format!("{text}, and {demand} is on the wire"));
            }
        }
    }

    /// When an engine without a flame, reported as running, has lost more of its speed than a limit allows, and no lower demand explains
    /// it.
    fn flame_outs(&self) -> Spans {
        let h = self.h;
        let reported = |sample: &Sample| sample.phase == Phase::Running && !sample.fault && !sample.hidden;
        let lost = |sample: &Sample| {
            let before = h.sample(sample.at.saturating_sub(LOST_WITHIN));
            before.is_some_and(|before| reported(before) && sample.rpm < LOST * before.rpm)
        };
        let lost = h.times(|sample| reported(sample) && !sample.lit && lost(sample));
        let unexplained = lost.iter().filter(|(from, to)| {
            // What was found before a reset does not count after it, and other settings have another limit.
            let since = from.saturating_sub(LOST_WITHIN + 4 * SECOND);
            let reset = h.resets.iter().any(|reset| reset.up > since && reset.down < *to)
                || h.other_settings.iter().any(|at| at < to);
            let before = from.saturating_sub(SPOOLS_DOWN);
            // Also in steps too small to count by themselves, and if it has risen again since.
            let demands = h.frames_within(before, *to).iter().filter_map(|frame| frame.sent.demand());
            let mut highest = 0.0_f64;
            let sank = demands.map(|demanded| self.share(demanded)).any(|share| {
                highest = highest.max(share);
                share + STEP < highest
            });
            !reset && !sank && self.last_lowered(before, *to).is_none()
        });
        Spans::from(&unexplained.collect::<Vec<_>>())
    }

    /// When the exhaust temperature rises faster in a start than a limit allows.
    fn hot_starts(&self) -> Spans {
        let h = self.h;
        let starts = |sample: &Sample| matches!(sample.phase, Phase::Preheat | Phase::FuelRamp);
        let rises = |sample: &Sample| {
            let before = h.sample(sample.at.saturating_sub(RISES_WITHIN));
            before.is_some_and(|before| starts(before) && sample.egt - before.egt > RISE)
        };
        h.times(|sample| starts(sample) && !sample.fault && rises(sample))
    }

    /// While another engine has failed, the demand is reduced, where that is configured.
    pub(super) fn reduction(&mut self) {
        let h = self.h;
        if h.rules.when_other_fails.is_none() {
            return;
        }
        let rules = &h.rules;
        // Never slower than a loss.
        let fall = 1000 * SECOND / u64::from(rules.ramp.max(1));
        // An order that was given up leaves the engine at the demand that its ECU has. It falls from there.
        let long = self.order_outlasts();
        let found = h.frames.windows(2).filter(|pair| pair[1].at - pair[0].at > long);
        let found: Vec<(u64, u64)> = found.map(|pair| (pair[1].at, pair[1].at + fall + SECOND)).collect();
        let found = if self.traits().serial_delay { Spans::from(&found) } else { Spans::default() };
        let (mut reported, mut judged) = (0, 0);
        for frame in &h.frames {
            let at = frame.at;
            let Some(demanded) = frame.sent.demand() else { continue };
            if found.contains(at) {
                continue;
            }
            let failed =
                h.other_down.last_before(at).filter(|(from, to)| at < *to && at > from + fall + SECOND);
            if failed.is_none()
                || at < reported
                || self.down.touches(at.saturating_sub(fall + 3 * SECOND), at)
            {
                continue;
            }
            // No source commanded more for the duration of the stages of loss, or of the wait of another source to take over.
            let age = rules.ages.into_iter().max().unwrap_or_default();
            let held = (8 * SECOND).max(age + rules.hold + rules.recover_after + rules.takeover + SECOND);
            let kind = core::mem::discriminant(&demanded);
            let share = |command| match command {
                PilotCommand::Run(requested) if core::mem::discriminant(&requested) == kind => {
                    Some(self.share(requested))
                }
                _ => None,
            };
            let lately = h.commanded(at.saturating_sub(held), at);
            // The throttle of a governor is no share of a commanded one.
            let rpm = |commanded: &Commanded| commanded.command.is_rpm();
            if matches!(demanded, Demanded::Throttle(_)) && lately.iter().any(rpm) {
                continue;
            }
            // A demand that is lost is the last of one of them, until a source that returns is in control.
            let back = at.saturating_sub(rules.recover_after + rules.takeover + SECOND);
            let received = |source| {
                let last = self.command_log.in_control_for_sure(source, back, rules.recover_after);
                last.is_some_and(|last| {
                    // It has commanded run for long enough to take over.
                    let before = self.command_log.last(source, last.saturating_sub(rules.takeover));
                    last + held >= at && matches!(before, Some((_, PilotCommand::Run(_))))
                })
            };
            let silent = !(0..rules.ages.len()).any(received);
            let lost = (0..rules.ages.len())
                .filter(|_| silent)
                .filter_map(|source| h.last_command(source, back, |command| share(command).is_some()));
            let wanted = lately.iter().copied().chain(lost).filter_map(|commanded| share(commanded.command));
            let wanted = wanted.chain(self.held_over_a_reset(at, kind));
            // One that was changed falls, or rises, at its rate.
            let part = h.largest_share(at.saturating_sub(fall + 3 * SECOND), at).unwrap_or(1000);
            let most = wanted.fold(0.0, f64::max) * f64::from(part) / 1000.0;
            let idle = match demanded {
                Demanded::Throttle(_) => 0.0,
                Demanded::Rpm(_) => rules.idle_rpm / rules.max_rpm * 1000.0,
            };
            if most == 0.0 || !self.known_to_run(at) {
                continue;
            }
            if let Some((from, _)) = failed
                && core::mem::replace(&mut judged, from) != from
            {
                self.verdict.count("reductions", 1);
            }
            if self.share(demanded) > most.max(idle) + STEP {
                let text = format!(
                    "{demanded} on the wire while another engine has failed, {:.1} % at most",
                    most / 10.0
                );
                self.verdict.finding(Rule::Reduction, at, text);
                reported = at + 10 * SECOND;
            }
        }
    }

    /// A reset in a silence keeps the demand of the wire, which may still have been on its way to the one that was commanded.
    fn held_over_a_reset(&self, at: u64, kind: core::mem::Discriminant<Demanded>) -> Option<f64> {
        let reset = self.h.last_reset(at)?;
        if self
            .h
            .commanded(reset.down, at.saturating_sub(3 * SECOND))
            .iter()
            .any(|commanded| commanded.command.is_received())
        {
            return None;
        }
        let demanded =
            self.h.frames_within(0, reset.down).iter().rev().find_map(|frame| frame.sent.demand())?;
        (core::mem::discriminant(&demanded) == kind).then(|| self.share(demanded))
    }

    /// A source commands a throttle, its first command in a long while, while another one commands a throttle and is in control
    /// of a running engine.
    pub(super) fn arrival(&self, commanded: &Commanded) -> Option<Arrival> {
        let Commanded { at, source, command: PilotCommand::Run(Demanded::Throttle(wanted)) } = *commanded
        else {
            return None;
        };
        let before = self.command_log.last(source, at.saturating_sub(1));
        let long = before.is_none_or(|(when, _)| at > when + self.command_log.age(source) + 12 * SECOND);
        if !long || !self.known_to_run(at) {
            return None;
        }
        match self.command_log.run_in_control(at - 1)? {
            (lower, Demanded::Throttle(held)) => Some(Arrival { wanted, lower, held }),
            (_, Demanded::Rpm(_)) => None,
        }
    }

    /// A source takes over only when its demand is close to the one in force, or after its wait.
    pub(super) fn take_over(&mut self) {
        let h = self.h;
        let rules = &h.rules;
        if rules.takeover < SECOND || rules.governor {
            return;
        }
        let hidden = self.blind.union(&h.noise).union(&self.down).longer(3 * SECOND);
        for commanded in &h.commanded {
            // Well away from its demand.
            let Some(Arrival { wanted, lower, held }) = self.arrival(commanded) else { continue };
            let at = commanded.at;
            let until = at + rules.takeover - 150 * MS;
            let since = self.command_log.commands_since(lower, at - 1);
            let settled = 1000 * SECOND / u64::from(rules.rise.min(rules.slew_up.unwrap_or(rules.rise)));
            let settled = rules.recover_after + rules.takeover + settled + 4 * SECOND;
            // Both command the same until the wait is over.
            let same = |source: usize, tenths: u32, from: u64| {
                let commands = self.command_log.until(source, until);
                let commands = &commands[commands.partition_point(|(when, _)| *when < from)..];
                !commands.is_empty()
                    && commands
                        .iter()
                        .all(|(_, command)| *command == PilotCommand::Run(Demanded::Throttle(tenths)))
            };
            // The previous source is not lost meanwhile: its demand would fall.
            let steady = since.is_some_and(|since| since + settled < at)
                && self.command_log.commands_since(lower, until) == since
                && same(lower, held, at.saturating_sub(settled))
                && same(commanded.source, wanted, at)
                && lower > commanded.source
                && self
                    .command_log
                    .run_in_control(until)
                    .is_some_and(|(source, _)| source == commanded.source)
                && wanted.abs_diff(held) > 120
                && h.commanded(at.saturating_sub(settled), until).iter().all(|other| {
                    other.source == lower || other.source == commanded.source || !other.command.is_received()
                });
            if !steady
                || hidden.touches(at.saturating_sub(SECOND), until)
                || h.other_failed.touches(at, until)
            {
                continue;
            }
            self.verdict.count("take-overs", 1);
            let (Some(Demanded::Throttle(sent)), Some(Switch::Run)) = self.sent_at(until) else { continue };
            let (Some(Demanded::Throttle(before)), _) = self.sent_at(at - 1) else { continue };
            if sent.abs_diff(before) > 8 && before.abs_diff(held) <= 8 {
                let [wanted, sent, before] = [wanted, sent, before].map(Demanded::Throttle);
                let text = format!(
                    "source {} takes over at {} with {wanted}, and {sent} is on the wire after {before}",
                    commanded.source,
                    seconds(at)
                );
                self.verdict.finding(Rule::TakeOver, until, text);
            }
        }
    }
}

/// When the start of one engine delays those of the others: until it is known to run, or its order ends, plus the time between
/// two starts.
pub fn busy(other: &History) -> Spans {
    let switches: Vec<(u64, Switch)> =
        other.frames.iter().filter_map(|frame| Some((frame.at, frame.sent.switch()?))).collect();
    let orders = |switch| matches!(switch, Switch::Run | Switch::Pwm);
    let down = other.down();
    let hidden = other.mute.union(&other.deaf).union(&other.noise).union(&other.unpowered).union(&down);
    let runs = other.times(|sample| sample.runs() && !sample.hidden && !sample.fault);
    let mut spans = Vec::new();
    let begins = switches.windows(2).filter(|pair| !orders(pair[0].1) && orders(pair[1].1));
    let begins = begins.map(|pair| (pair[1].0, other.rules.start_gap));
    // An engine that its ECU lights again is starting, too.
    let ordered = |at: u64| switches[..switches.partition_point(|(when, _)| *when <= at)].last();
    let relit = other.marks.iter().filter(|(at, mark)| {
        matches!(mark, Mark::Ignition | Mark::Relight)
            && ordered(*at).is_some_and(|(_, switch)| orders(*switch))
    });
    for (at, gap) in begins.chain(relit.map(|(at, _)| (*at, 0))) {
        let ends = switches.iter().find(|(when, switch)| *when > at && !orders(*switch));
        let ends = ends.map_or(other.end, |(when, _)| *when);
        let known = two_states(other) + SECOND;
        let known = runs.iter().find_map(|(from, to)| {
            let from = from.max(at);
            // It is seen once the wire to the node is whole.
            let seen = hidden.last_before(from + 1).map_or(from, |(_, over)| over.max(from));
            let by = seen + known + hidden.within(seen, seen + known) * 4;
            (from > at && by < to).then_some(by)
        });
        let free = known.unwrap_or(u64::MAX).min(ends + SECOND).max(at + gap);
        // Its command came a moment before.
        spans.push((at.saturating_sub(SECOND), free + other.rules.period));
    }
    for at in unsent_starts(other) {
        spans.push((at.saturating_sub(SECOND), at + other.rules.start_gap + other.rules.period));
    }
    Spans::from(&spans)
}

/// When a start may have been ordered of which no frame was sent: it was ended before the next slot or reply, or the ECU had just fallen
/// silent, and the gap ended it. The time between two starts counts from the order.
fn unsent_starts(h: &History) -> Vec<u64> {
    let slot = h.rules.period + 50 * MS;
    let silent = h.mute.union(&h.deaf).union(&h.noise).union(&h.unpowered);
    let undetected = |at: u64| {
        let within = |spans: &Spans, detected: u64| {
            let last = spans.last_before(at + slot);
            last.is_some_and(|(from, to)| at < to && at < from + detected)
        };
        // Damaged frames count as frames for 3 s.
        within(&silent, gap(h)) || within(&h.noise, 3 * SECOND + gap(h))
    };
    let ended = |at: u64, source: usize| {
        h.commanded(at, at + slot).iter().any(|end| match end.command {
            PilotCommand::Stop | PilotCommand::Disarm | PilotCommand::ShutDown => true,
            PilotCommand::Standby => end.source == source,
            _ => false,
        })
    };
    let run = |frame: &Frame| frame.sent.switch() == Some(Switch::Run);
    let mut unsent = Vec::new();
    for source in 0..4 {
        // Its own standby, and then its run: it starts the engine, or waits until one of those that follow may.
        let (mut ready, mut first) = (false, None);
        for commanded in h.commanded.iter().filter(|commanded| commanded.source == source) {
            let at = commanded.at;
            match commanded.command {
                PilotCommand::Standby => (ready, first) = (true, None),
                PilotCommand::Run(demanded) if h.rules.is_idle(demanded) => {
                    first = if core::mem::take(&mut ready) { Some(at) } else { first };
                    let lost = ended(at, source) || undetected(at);
                    if let Some(first) = first.filter(|_| lost)
                        && !h.frames_within(first, at + slot).iter().any(run)
                    {
                        unsent.push(at);
                    }
                }
                _ => {}
            }
        }
    }
    unsent
}

/// When another engine may count as failed: at rest after it ran, with a fault, not received, or shut down by its node.
pub fn may_have_failed(history: &History) -> Spans {
    let mut ran = false;
    let mut spans = Spans::default();
    for pair in history.samples.windows(2) {
        // On ZK idle calibration is a state of a running engine, and to a node that restarts, an engine that it finds started up
        // has run.
        let started_up = pair[0].phase == Phase::FuelRamp && pair[0].rpm > history.rules.idle_rpm / 4.0;
        ran |= started_up || matches!(pair[0].phase, Phase::Running | Phase::LearningIdle);
        if ran && !pair[0].runs() || pair[0].fault {
            spans.push(pair[0].at, pair[1].at);
        }
    }
    // Its node decides a slot before its standby begins.
    let run = |switch| switch == Switch::Run;
    let switches: Vec<(u64, Switch)> =
        history.frames.iter().filter_map(|frame| Some((frame.at, frame.sent.switch()?))).collect();
    let ends = switches.windows(2).filter(|pair| run(pair[0].1) && !run(pair[1].1));
    let shut_down: Vec<(u64, u64)> =
        ends.map(|pair| (pair[1].0.saturating_sub(history.rules.period + 20 * MS), pair[1].0)).collect();
    let spans = spans.union(&Spans::from(&shut_down));
    let not_received = history.mute.union(&history.deaf).union(&history.unpowered).union(&history.noise);
    spans.union(&not_received).longer(5 * SECOND)
}

/// When another engine has failed for sure: it ran, no stop was commanded, and it went out.
pub fn failed_for_sure(other: &crate::history::History) -> Spans {
    let mut all = Vec::new();
    let command_log = CommandLog::new(other);
    let runs = other.times(|sample| sample.runs());
    // It takes two reports to know that an engine runs, and only one that ran can fail.
    let dark = other.unpowered.longer(other.rules.boot).union(&other.down()).longer(two_states(other));
    let unknown = other.mute.union(&other.noise).union(&dark).union(&other.times(|sample| sample.hidden));
    let known = |from: u64, out: u64| out > from + two_states(other) + SECOND + unknown.within(from, out);
    let hidden = other.mute.union(&other.noise).union(&other.unpowered);
    // When it went out, and when that was visible; or when it was not received, or an AMT ECU reported a fault, and until
    // when.
    let mut events: Vec<(u64, u64, u64)> = Vec::new();
    for (from, out) in runs.iter().filter(|(from, out)| known(*from, *out)) {
        if !hidden.touches(out.saturating_sub(SECOND), out + FAILED) {
            events.push((out, out + FAILED, other.end));
        }
        let faults = other.times(|sample| sample.fault);
        let faults = if other.traits().faults_hide_state { faults } else { Spans::default() };
        let clear = |at: u64| {
            let since = at.saturating_sub(5 * SECOND);
            from < since && at < out && !other.noise.union(&dark).touches(since, at + FAILED)
        };
        let lost = other.mute.iter().filter(|(at, _)| clear(*at));
        let lost = lost.filter(|(at, _)| !other.deaf.touches(*at, *at + FAILED));
        let faulty = faults.iter().filter(|(at, _)| clear(*at) && !hidden.touches(*at, at + FAILED));
        events.extend(lost.chain(faulty).map(|(at, until)| (at, at + FAILED, until.min(out))));
    }
    for (out, from, until) in events {
        // Standby from a source below one that commands otherwise changes nothing. A speed may be refused, and a source that was
        // lost has to command for a while first, and so has one of which a node that was reset has not received anything yet: then no
        // source commands otherwise.
        let commands_for_long = |source, at: u64| {
            let up = other.resets.iter().rfind(|reset| reset.up <= at).map_or(0, |reset| reset.up);
            let since = command_log.commands_since(source, at);
            since.is_some_and(|since| at > since.max(up) + other.rules.recover_after + SECOND)
        };
        let stops = |commanded: &&Commanded| match commanded.command {
            PilotCommand::Standby => command_log.in_control(commanded.at).is_none_or(|(source, command)| {
                source >= commanded.source || command.is_rpm() || !commands_for_long(source, commanded.at)
            }),
            command => matches!(
                command,
                PilotCommand::ShutDown
                    | PilotCommand::Stop
                    | PilotCommand::Ctf
                    | PilotCommand::Disarm
                    | PilotCommand::Pwm
            ),
        };
        let commanded = other.commanded(out.saturating_sub(10 * SECOND), other.end);
        let ends = commanded.iter().find(stops).map_or(other.end, |commanded| commanded.at);
        // A failure that has shown is retained over resets, if the memory is intact.
        let reset = other.resets.iter().find(|reset| {
            reset.up > out.saturating_sub(5 * SECOND) && (reset.cause != Cause::Watchdog || reset.down < from)
        });
        let ends = ends.min(reset.map_or(u64::MAX, |reset| reset.down)).min(until);
        let again = other.marks.iter().find(|(at, _)| *at > out).map_or(u64::MAX, |(at, _)| *at);
        let silent = other.commanded(0, out).iter().rev().find(|commanded| commanded.command.is_received());
        let ran = silent.is_some_and(|commanded| {
            matches!(commanded.command, PilotCommand::Run(_)) && out < commanded.at + SECOND
        });
        // Nor did the stages of loss, or a limit.
        let frames = &other.frames[..other.frames.partition_point(|frame| frame.at < out)];
        let sent = frames.iter().rev().find_map(|frame| frame.sent.switch().map(|switch| (frame.at, switch)));
        let ran = ran && sent.is_some_and(|(at, sent)| sent == Switch::Run && out < at + SECOND);
        // Nor do they shut it down before a failure has shown.
        let mut silences = silences(other, SECOND).into_iter();
        let ran = ran && !silences.any(|(silent, until)| silent < from && until > out);
        if ran && from < ends.min(again) {
            all.push((from, ends.min(again)));
        }
    }
    Spans::from(&all)
}
