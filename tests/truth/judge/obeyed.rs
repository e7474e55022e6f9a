//! Switch commands of pilots take effect: an engine that is shut down goes out, and a start that is commanded as
//! documented begins.

use super::case::{Case, Rule, seconds, spins_up};
use crate::history::{Cause, MS, Mark, PilotCommand, Reset, SECOND, Sample, Spans};
use sim::turbine::Phase;

/// Time from a command until the turbine is out, with every wire intact.
const OBEYS: u64 = 1500 * MS;
/// Time by which a commanded start is on the wire.
const GRANTED: u64 = SECOND;
/// A start that waits for another engine for longer is not judged.
const LONGEST_WAIT: u64 = 100 * SECOND;
/// Time before a start for which nothing may prevent it.
const READY: u64 = 4 * SECOND;
const STOP: &str = "an emergency stop";

impl Case<'_> {
    /// Times in which nothing that the node sends can be relied on to reach the ECU.
    fn unreachable(&self) -> Spans {
        let h = self.h;
        let cut = h.deaf.union(&h.noise_to_ecu).union(&h.unpowered.longer(h.rules.boot));
        // How the ECU is given its switch has to be found out again.
        let cut = cut.union(&self.down.longer(2 * self.two_states()));
        // An AMT ECU gets replies only, and a node that restarts has to find out what is on its line.
        let cut = if self.traits().replies_only { cut.union(&h.mute).union(&h.noise) } else { cut };
        cut.longer(h.rules.listen + SECOND)
    }

    /// The same for an emergency stop, which is sent in every possible way.
    fn unreachable_for_stops(&self) -> Spans {
        let h = self.h;
        if self.traits().replies_only {
            return self.unreachable();
        }
        let cut = h.deaf.union(&h.noise_to_ecu).union(&h.unpowered.longer(h.rules.boot));
        cut.union(&self.down.longer(500 * MS))
    }

    pub(super) fn goes_out(&mut self) {
        let h = self.h;
        let cut = self.unreachable();
        let cut_for_stops = self.unreachable_for_stops();
        let mut ends: Vec<(u64, &str)> = Vec::new();
        for (from, to) in self.stopped.iter() {
            // The second one is for a node that had only just begun at the first.
            let ends_by = [from + OBEYS, from + 2 * OBEYS];
            ends.extend(ends_by.into_iter().filter(|by| to > *by).map(|by| (by, STOP)));
        }
        for commanded in h.commanded.iter().filter(|commanded| commanded.command == PilotCommand::ShutDown) {
            ends.push((commanded.at + OBEYS, "the order to shut down"));
        }
        for at in self.standbys() {
            ends.push((at, "standby"));
        }
        for at in self.slow_standbys() {
            ends.push((at, "two standbys within two periods of their source"));
        }
        ends.sort_unstable();
        let mut reported = 0;
        for (at, what) in ends {
            // What was begun since is another matter.
            let lit = self.live.last_before(at).filter(|(from, to)| at < *to && *from + OBEYS <= at);
            let ignited = h.marks.iter().any(|(when, _)| (at - OBEYS..=at).contains(when));
            let pwm = h.pwm.touches(at.saturating_sub(2 * SECOND), at);
            let cut = if what == STOP { &cut_for_stops } else { &cut };
            if at < reported || lit.is_none() || ignited || pwm || cut.touches(at - OBEYS, at) || at >= h.end
            {
                continue;
            }
            self.verdict.finding(
                Rule::Obeyed,
                at,
                format!("the engine burns {} after {what}", seconds(OBEYS)),
            );
            reported = at + 10 * SECOND;
        }
        self.verdict.count(
            "shutdowns",
            h.commanded.iter().filter(|commanded| commanded.command == PilotCommand::ShutDown).count() as u64,
        );
    }

    /// A disarm ends a start that has not reached running, also one in which the node was reset.
    pub(super) fn disarm_ends_a_start(&mut self) {
        let h = self.h;
        let starts = self.pairs();
        let mut judged = 0;
        for disarm in h.commanded.iter().filter(|commanded| commanded.command == PilotCommand::Disarm) {
            let at = disarm.at;
            let begun = h.marks.iter().rfind(|(when, _)| *when <= at);
            let Some((lit, _)) = begun.filter(|(_, mark)| *mark == Mark::Ignition) else { continue };
            let Some(start) = starts.iter().rfind(|start| start.at <= *lit) else { continue };
            let begins = |sample: &Sample| spins_up(sample.phase) && !sample.fault;
            // What is being sent, and the report that follows.
            let from = at + 3 * h.rules.period + 100 * MS;
            let next = starts.iter().map(|start| start.at).find(|next| *next > at).unwrap_or(h.end);
            let ends = h.resets.iter().map(|reset| reset.down).find(|down| *down > at).unwrap_or(h.end);
            let until = next.min(ends).min(from + 3 * SECOND);
            let lost = |reset: &Reset| reset.cause != Cause::Watchdog && (start.at..at).contains(&reset.down);
            if !h.samples(*lit, at).iter().all(begins)
                || h.resets.iter().any(lost)
                || self.down.touches(at, from)
                || h.pwm.touches(start.at, until)
                || from >= until
            {
                continue;
            }
            judged += 1;
            if let Some(frame) = h.first_run(from, until) {
                let text = format!("run, and the disarm at {} has ended the start", seconds(at));
                self.verdict.finding(Rule::Obeyed, frame.at, text);
            }
        }
        self.verdict.count("starts that a disarm ends", judged);
    }

    /// An engine that was shut down is not sent run again before a source commands it, also across resets, as long as the state
    /// is retained.
    pub(super) fn stays_out(&mut self) {
        let h = self.h;
        let mut shut: Vec<u64> = self.standbys();
        let orders = h.commanded.iter().filter(|commanded| commanded.command == PilotCommand::ShutDown);
        shut.extend(orders.map(|commanded| commanded.at));
        shut.sort_unstable();
        let mut done = 0;
        for at in shut.into_iter().map(|at| at + 2 * h.rules.period + 300 * MS) {
            if at < done || self.down.touches(at.saturating_sub(2 * SECOND), at) {
                continue;
            }
            let again = |command| matches!(command, PilotCommand::Run(_) | PilotCommand::Pwm);
            let since = at.saturating_sub(2 * h.rules.period + 300 * MS);
            let next = h.commanded(since, h.end).iter().find(|commanded| again(commanded.command));
            let lost = h.resets.iter().find(|reset| reset.up > at && reset.cause == Cause::PowerOn);
            let until = next.map_or(h.end, |next| next.at).min(lost.map_or(h.end, |lost| lost.down));
            done = until;
            if let Some(frame) = h.first_run(at, until) {
                let text = format!("run, which was not commanded since standby at {}", seconds(since));
                self.verdict.finding(Rule::Obeyed, frame.at, text);
            }
        }
    }

    /// Instants by which an engine has to be out, because the commanding source has commanded nothing but standby for long
    /// enough, whichever source was in control before.
    fn standbys(&self) -> Vec<u64> {
        let h = self.h;
        let rules = &h.rules;
        let age = rules.ages.into_iter().max().unwrap_or_default();
        let long =
            age + rules.recover_after + rules.takeover + rules.hold + rules.lower_standby_after + OBEYS;
        let mut ends = Vec::new();
        // Since when nothing else was commanded.
        let mut since = None;
        let mut streams = [false; 4];
        for commanded in &h.commanded {
            let (at, source) = (commanded.at, commanded.source);
            // A source that commands nothing does not command standby.
            let wants_nothing = commanded.command == PilotCommand::Nothing && streams[source];
            if commanded.command != PilotCommand::Standby {
                if commanded.command.is_received() || wants_nothing {
                    (since, streams) = (None, [false; 4]);
                }
                continue;
            }
            streams[source] = true;
            let from = *since.get_or_insert(at);
            let Some(commands_for_long) = self.command_log.commands_since(source, at) else { continue };
            // A source that has been alone for a long time is in control.
            let alone = h.commanded(from.saturating_sub(long), at).iter().all(|other| other.source == source)
                && !self.down.touches(from.saturating_sub(60 * SECOND), at);
            let waits = if alone {
                from.max(commands_for_long + rules.recover_after) + OBEYS
            } else {
                from.max(commands_for_long) + long
            };
            if at > waits && !self.down.touches(from, at) {
                ends.push(at);
                since = Some(at);
            }
        }
        ends
    }

    /// The same, where a source that commands seldom, and is alone, commands standby twice within two of its own periods.
    fn slow_standbys(&self) -> Vec<u64> {
        let h = self.h;
        let mut ends = Vec::new();
        for commands in h.commanded.windows(3) {
            let (third, first, second) = (&commands[0], &commands[1], &commands[2]);
            let (at, source) = (second.at, second.source);
            let (period, apart) = (first.at - third.at, at - first.at);
            let standbys = [third, first, second].map(|it| it.command == PilotCommand::Standby);
            // Its run was in force until then, and it was not lost for longer than a short gap.
            let age = self.command_log.age(source);
            let seldom = period < age * 95 / 100
                && apart <= 2 * period
                && apart < age + h.rules.return_within - 50 * MS;
            if standbys != [false, true, true]
                || !seldom
                || self.down.touches(at.saturating_sub(60 * SECOND), at)
            {
                continue;
            }
            let lately = h.commanded(at.saturating_sub(25 * SECOND), at);
            let alone = lately.iter().all(|other| other.source == source && other.command.is_received());
            if alone && lately.len() > 4 {
                ends.push(at + OBEYS);
            }
        }
        ends
    }

    /// A start that is commanded as documented begins.
    pub(super) fn granted(&mut self) {
        let h = self.h;
        let rules = &h.rules;
        // A limit may be exceeded.
        let [hot, out, low, jump] = rules.limit_changes;
        let limited = [rules.limit_fault, hot, out, low, jump, rules.limit_supply];
        if limited.iter().any(Option::is_some) {
            return;
        }
        let hidden = self.blind.union(&h.noise).union(&self.down).union(&h.sensor).union(&h.deaf);
        let hidden = hidden.union(&self.stopped).union(&self.faults);
        let hidden =
            if rules.supply_counts { hidden.union(&h.low_supply.longer(3 * SECOND)) } else { hidden };
        let mut before = [None; 4];
        for commanded in h
            .commanded
            .iter()
            .filter(|commanded| commanded.command.is_received() || commanded.command == PilotCommand::Nothing)
        {
            let first = before[commanded.source].replace(commanded.command) == Some(PilotCommand::Standby);
            let PilotCommand::Run(demanded) = commanded.command else { continue };
            let at = commanded.at;
            // It waits for another engine that starts, and begins as soon as it may.
            let mut due = at + GRANTED;
            while let Some((_, free)) = h.other_busy.last_before(due).filter(|(_, free)| free + GRANTED > due)
            {
                due = free + GRANTED;
            }
            let waits = due > at + GRANTED;
            if !first
                || !self.is_idle(demanded)
                || at < READY + rules.link_stable
                || due > h.end.min(at + LONGEST_WAIT)
            {
                continue;
            }
            let since = at - READY;
            let settled = self
                .command_log
                .commands_since(commanded.source, at)
                .is_some_and(|from| at >= from + rules.recover_after + rules.takeover + SECOND);
            let lately = h.commanded(since, due);
            // It commands standby, then run at idle. No other source commands anything but standby, and only below it
            // and all the time.
            let mut received = lately.iter().filter(|command| command.command.is_received());
            let clear = received.all(|command| match command.command {
                PilotCommand::Standby if command.source == commanded.source => command.at < at,
                PilotCommand::Standby => {
                    command.source > commanded.source && self.streams_standby_since(command.source, since, at)
                }
                PilotCommand::Run(demanded) => {
                    command.source == commanded.source && command.at >= at && self.is_idle(demanded)
                }
                _ => false,
            });
            let quiet = !lately
                .iter()
                .any(|command| matches!(command.command, PilotCommand::Disarm | PilotCommand::Release));
            let armed = self.command_log.surely_armed(since) && self.command_log.surely_armed(due);
            // A start that waits ends with its source, and goes with the next run that it commands.
            let mut again = h.commanded(due - GRANTED, due).iter();
            let fresh = !waits
                || again.any(|again| {
                    again.source == commanded.source && matches!(again.command, PilotCommand::Run(_))
                }) && self.command_log.commands_since(commanded.source, due).is_some_and(|from| from < at);
            let samples = h.samples(since, at);
            let cold = samples.iter().all(|sample| {
                sample.phase == Phase::Standby && sample.egt < rules.egt_max - 10.0 && sample.flow == 0.0
            });
            let services = h.commanded(at.saturating_sub(60 * SECOND), at).iter();
            let services = services.clone().any(|commanded| {
                matches!(commanded.command, PilotCommand::Service(_) | PilotCommand::Pwm | PilotCommand::Ctf)
            });
            // An AMT ECU has no state for cooling: the shaft has to be at rest.
            let most = if self.traits().reports_stages { 10_000.0 } else { 200.0 };
            let still = h.samples(at.saturating_sub(SECOND), at).iter().all(|sample| sample.rpm < most);
            if !(settled && clear && quiet && armed && fresh && cold && still)
                || services
                || samples.is_empty()
                || self.live.touches(since, at)
                || hidden.touches(since, due)
                || h.pwm.touches(since, due)
            {
                continue;
            }
            self.verdict.count("starts that have to be granted", 1);
            self.verdict.count("starts that have to go when they may", u64::from(waits));
            if h.first_run(at, due).is_none() {
                let text = format!(
                    "source {} commands standby and then run at idle, and no run is on the wire",
                    commanded.source
                );
                self.verdict.finding(Rule::Granted, due, text);
            }
        }
    }

    /// Whether a source has commanded standby since then, and nothing else, and was received before.
    fn streams_standby_since(&self, source: usize, since: u64, at: u64) -> bool {
        let commands = self.command_log.until(source, at);
        let commands =
            &commands[commands.partition_point(|(when, _)| when + self.command_log.age(source) < since)..];
        commands.first().is_some_and(|(when, _)| *when <= since)
            && commands.iter().all(|(_, command)| *command == PilotCommand::Standby)
            && self.command_log.commands_throughout(source, since, at)
    }
}
