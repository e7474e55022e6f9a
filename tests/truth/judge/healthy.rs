//! The converse: an engine that runs, and is sent run, is not shut down, not given up, and not held low.

use super::case::{Case, Rule};
use crate::history::{Cause, MS, Mark, PilotCommand, Reset, SECOND, Sample, Sent, Spans, Switch};
use sim::turbine::Phase;

/// Time for which an engine has to run, and be received, before the node has to know it.
const KNOWN: u64 = 3 * SECOND;
/// Time after the end of a disturbance until everything is normal again.
const SETTLES: u64 = 1500 * MS;
/// Fall of an exhaust over 2 s, °C, that may show two steps of an AMT report, of 4.6 °C each.
pub(super) const FALLS: f64 = 4.0;

impl Case<'_> {
    /// Times in which the rules of this file do not bind, each with its name.
    pub(super) fn exemptions(&self) -> Vec<(&'static str, Spans)> {
        let h = self.h;
        let patience = h.rules.gives_up_after;
        // A node that is up repeatedly for less than it takes to find out counts as down.
        let down = self.down.longer(4 * h.rules.period + 100 * MS);
        // After a reset an AMT engine is in doubt, and damaged sets are not replied to.
        let silent = match self.traits().replies_only {
            true => down.union(&h.noise).union(&h.mute),
            // A command after damage comes in the slot after the next.
            false => down.union(&h.noise_to_ecu.longer(2 * h.rules.period)),
        };
        // A cut may begin while the node is down.
        let silent = silent.union(&h.deaf);
        // A cut also costs up to a set before it, the one in which it ends, and an AMT set without a state after it, which is not
        // answered after a gap.
        let costs = if self.traits().replies_only { 3 * h.rules.period + 50 * MS } else { 300 * MS };
        // The wire to the ECU costs no more than a set at either end.
        let cut = h.mute.union(&h.deaf).at_least(patience.saturating_sub(300 * MS));
        let cut = cut.union(&h.mute.at_least(patience.saturating_sub(costs))).longer(SETTLES);
        let silent = silent.at_least(patience.saturating_sub(costs));
        let silent: Vec<_> = silent.iter().filter(|(from, to)| down.touches(*from, *to)).collect();
        let gap = Spans::from(&silent).longer(SETTLES);
        // Damage towards the ECU for longer than it waits counts as a cut. Damage towards the node costs a ZK ECU nothing, and
        // an AMT ECU its replies where no set can be distinguished from garbage.
        let damage = if self.traits().replies_only {
            h.noise_to_ecu.union(&h.garbled)
        } else {
            h.noise_to_ecu.clone()
        };
        let damage = damage.at_least(patience.saturating_sub(costs)).longer(SETTLES);
        let versions = self.traits().versions;
        // Which ECU it is at that time.
        let of = |spans: Spans, version: core::ops::Range<u8>| {
            let chosen = spans.iter().filter(|(from, _)| version.contains(&h.version(*from)));
            Spans::from(&chosen.collect::<Vec<_>>())
        };
        let mut all = match versions {
            false => vec![
                ("AMT, a wire cut", cut),
                ("AMT, a gap beyond the serial delay", gap),
                ("AMT, damage beyond the serial delay", damage),
            ],
            true => vec![
                ("ZK up to 4, a wire cut", of(cut, 1..5)),
                ("ZK up to 4, a gap beyond the loss time", of(gap, 1..5)),
                ("ZK up to 4, damage beyond the loss time", of(damage, 1..5)),
            ],
        };
        if versions && h.rules.gives_up_on_empty {
            // This ECU does not tolerate what is prescribed in doubt.
            let doubt = self.blind.union(&h.noise).union(&h.deaf).union(&self.down).longer(self.two_states());
            all.push(("ZK up to 4 that gives up on ID 0, in doubt", of(doubt, 1..5)));
        }
        if let Some((egt, true)) = h.rules.limit_egt {
            let over = h.times(|sample| sample.runs() && sample.egt > egt - 5.0);
            // A broken thermocouple reads far above it.
            let over = over.union(&h.sensor);
            all.push(("a limit whose action is standby", over.longer(SETTLES)));
        }
        if let Some((rpm, true)) = h.rules.limit_rpm {
            let over = h.times(|sample| sample.runs() && sample.rpm > rpm - 1500.0);
            all.push(("a limit whose action is standby", over.longer(SETTLES)));
        }
        if h.rules.limit_supply == Some(true) {
            all.push(("a limit whose action is standby", h.low_supply.longer(SETTLES)));
        }
        if h.rules.limit_jump == Some(true) {
            // Two consecutive frames that show it.
            let jumps = h.jumps.iter().map(|jump| (*jump, jump + SECOND)).collect::<Vec<_>>();
            all.push(("a limit whose action is standby", Spans::from(&jumps).longer(SETTLES)));
        }
        if h.rules.limit_changes.contains(&Some(true)) {
            // Implausible changes are seen where values are damaged, or a thermocouple breaks.
            all.push(("a limit whose action is standby", h.noise.union(&h.sensor).longer(SETTLES)));
        }
        all.push(("AMT, sets that no ECU sent among error sets", self.forged_among_faults().longer(SETTLES)));
        if h.rules.limit_fault == Some(true) {
            let fault = h.times(|sample| sample.runs() && sample.fault);
            // What is decided within a gap goes into the first reply after it.
            let gaps: Vec<_> = self.blind.iter().filter(|(from, to)| fault.touches(*from, *to)).collect();
            all.push(("a limit whose action is standby", fault.union(&Spans::from(&gaps)).longer(SETTLES)));
        }
        all
    }

    /// From the second of two sets that no ECU sent, where all others are error sets, which have no state: what the two report agrees.
    pub(super) fn forged_among_faults(&self) -> Spans {
        let h = self.h;
        let pairs = h.forged.windows(2).filter(|pair| {
            self.traits().faults_hide_state && self.faults.within(pair[0], pair[1]) == pair[1] - pair[0]
        });
        Spans::from(&pairs.map(|pair| (pair[1], pair[1] + h.rules.period)).collect::<Vec<_>>())
    }

    fn exempt_at(&self, from_us: u64, to_us: u64) -> bool {
        self.exemptions().iter().any(|(_, spans)| spans.touches(from_us, to_us + 1))
    }

    /// How long the rules applied, and how much of it was exempt.
    pub(super) fn shares(&mut self) {
        let command_log = &self.command_log;
        let applies = self.h.times(|sample| sample.runs() && command_log.run_in_control(sample.at).is_some());
        self.verdict.healthy.applied = applies.total();
        let mut taken = Spans::default();
        for (name, spans) in self.exemptions() {
            // Each instant counts once.
            let both = taken.union(&spans);
            let time = both.common(&applies) - taken.common(&applies);
            taken = both;
            if time > 0 {
                self.verdict.exempt(name, time);
            }
        }
    }

    /// When the engine began to run, if it runs at this instant and nothing has kept the node from knowing it.
    pub(super) fn known_to_run(&self, at: u64) -> bool {
        let Some((from, to)) = self.runs.last_before(at) else { return false };
        at < to
            && at > from + KNOWN
            && at - from > KNOWN + self.hidden.within(from, at)
            && self.longest_up(from, at) >= self.two_states()
    }

    /// The longest time without a reset: a node that is reset before two consistent reports cannot know what it is
    /// sent.
    pub(super) fn longest_up(&self, from_us: u64, at_us: u64) -> u64 {
        longest_outside(&self.down, from_us, at_us)
    }

    /// The longest time in which the node was up and received the engine's state in every report.
    pub(super) fn longest_received(&self, from_us: u64, at_us: u64) -> u64 {
        let other_state = self.h.times(|sample| sample.hidden);
        let unknown = self.down.union(&self.blind).union(&self.h.noise).union(&other_state);
        longest_outside(&unknown, from_us, at_us)
    }

    pub(super) fn shut_down(&mut self) {
        let h = self.h;
        let mut before = None;
        for frame in &h.frames {
            let Some(switch) = frame.sent.switch() else { continue };
            let previous = before.replace(switch);
            let stops = matches!(switch, Switch::Stop | Switch::Standby);
            // What shut it down was commanded before.
            let began = previous.is_none_or(|previous| matches!(previous, Switch::Run | Switch::Pwm));
            if !stops
                || !began
                || !self.known_to_run(frame.at)
                || h.pwm.touches(frame.at.saturating_sub(SECOND), frame.at)
            {
                continue;
            }
            // What goes out now may have been decided a slot ago, whatever was commanded since.
            let decided = self.sent_after(frame.at);
            let mut commands = h.commanded(decided, frame.at).iter().map(|commanded| commanded.at);
            let reason = self.reason_to_stop(frame.at)
                || self.reason_to_stop(decided)
                || commands.any(|at| self.reason_to_stop(at));
            if reason || self.exempt_at(frame.at, frame.at) {
                continue;
            }
            let who = match self.command_log.in_control(frame.at) {
                Some((source, PilotCommand::Run(demanded))) => {
                    format!("source {source} commands run at {demanded}")
                }
                Some((source, command)) => format!("source {source} commands {command}, once"),
                None => "all sources are silent".into(),
            };
            self.verdict.finding(
                Rule::ShutDown,
                frame.at,
                format!("{switch} for an engine that runs, and {who}"),
            );
        }
    }

    /// The earliest instant at which a frame on the wire may have been decided: a slot before it. A reply waits until a set has
    /// come.
    fn sent_after(&self, at: u64) -> u64 {
        let slot = at.saturating_sub(self.h.rules.period);
        if !self.traits().replies_only {
            return slot;
        }
        let hidden = self.blind.union(&self.h.noise);
        // The set at its end is not whole.
        let lately = |(from, to): &(u64, u64)| *from < at && *to + self.h.rules.period >= slot;
        let from = hidden.iter().filter(lately).map(|(from, _)| from).min();
        from.map_or(slot, |from| slot.min(from.saturating_sub(self.h.rules.period)))
    }

    /// When a source that was certainly in control last commanded run: it had commanded for a while, with no source above
    /// it.
    fn last_run_in_control(&self, source: usize, at: u64, commanding: u64, above_for: u64) -> Option<u64> {
        let rules = &self.h.rules;
        self.command_log.in_control_for_sure(source, at, commanding).filter(|when| {
            // While it waits to take over from a higher source that was lost, that source's stages of loss continue. It does not
            // wait for one that comes and goes.
            let lost = |above| {
                let last = self.command_log.in_control_for_sure(above, *when, above_for)?;
                Some(last + self.command_log.age(above) + rules.takeover)
            };
            let commands = self.command_log.until(source, *when).iter().rev();
            let runs = commands.take_while(|(_, command)| matches!(command, PilotCommand::Run(_)));
            let since = runs.last().map_or(*when, |(since, _)| *since);
            // Nor is it in control before it has taken over, not even from a lower one; a source that starts
            // an engine is.
            let starts = self.start_sent(since);
            (starts || *when >= since + rules.takeover)
                && (0..source).filter_map(lost).all(|lost| *when >= lost)
        })
    }

    /// When the source that started the engine last commanded run without a gap, and with none above it: it was in control from its start on.
    fn last_run_of_start(&self, source: usize, at: u64) -> Option<u64> {
        let commands = self.command_log.until(source, at);
        let is_run = |(_, command): &(u64, PilotCommand)| matches!(command, PilotCommand::Run(_));
        let first = (0..commands.len()).rev().find(|index| {
            let before = index.checked_sub(1).is_some_and(|before| is_run(&commands[before]));
            is_run(&commands[*index]) && !before && self.start_sent(commands[*index].0)
        })?;
        // A higher source may take over, and it would have to take over again.
        let in_control = |at| self.command_log.run_in_control(at).is_some_and(|(active, _)| active == source);
        let stream = commands[first..].windows(2).take_while(|pair| {
            is_run(&pair[1]) && pair[1].0 < pair[0].0 + self.command_log.age(source) && in_control(pair[1].0)
        });
        Some(stream.last().map_or(commands[first].0, |pair| pair[1].0))
    }

    /// Whether run is sent, after something else, right after a command.
    fn start_sent(&self, command: u64) -> bool {
        let frames = &self.h.frames;
        let first = frames.partition_point(|frame| frame.at < command);
        let soon = frames[first.saturating_sub(1)..].iter().take_while(|frame| frame.at < command + SECOND);
        let switches: Vec<_> = soon.filter_map(|frame| frame.sent.switch()).collect();
        switches.windows(2).any(|pair| pair[0] != Switch::Run && pair[1] == Switch::Run)
    }

    /// When a source was present without a command, right after this one: it is silent from then on.
    fn nothing_after(&self, source: usize, command: u64, at: u64) -> Option<u64> {
        let later = self.command_log.until(source, at).iter().find(|(when, _)| *when > command);
        later.filter(|(_, command)| *command == PilotCommand::Nothing).map(|(when, _)| *when)
    }

    /// Whether a higher source, which commands run, keeps this one's standby from taking effect.
    fn holds_against(&self, higher: usize, at: u64, slack: u64) -> bool {
        let rules = &self.h.rules;
        // It was certainly in control at this command. What goes out now was found a slot ago.
        let long = rules.recover_after + rules.takeover + slack;
        let Some(sure) = self.last_run_in_control(higher, at, long, rules.recover_after) else {
            return false;
        };
        let nothing = self.nothing_after(higher, sure, at);
        let lost = nothing.unwrap_or(u64::MAX).min(sure + self.command_log.age(higher));
        // Or another one has taken over since, with a run of its own.
        let took_over = (0..4).filter(|other| *other != higher).any(|other| {
            let commands = self.command_log.until(other, at).iter().rev();
            let mut commands = commands.take_while(|(when, _)| when + self.command_log.age(other) > lost);
            commands.any(|(_, command)| matches!(command, PilotCommand::Run(_)))
        });
        // From the third reset without a source on it resumes at the fail-safe.
        let resets = self.h.resets.iter().map(|reset| reset.up).filter(|up| (sure..=at).contains(up));
        let fail_safe = resets.skip(2).fold(lost + rules.hold, u64::min);
        // After a loss of power nothing says who was in control: the stages begin with the engine that is found, at the hold.
        let forgets = |reset: &&Reset| reset.cause != Cause::Watchdog && (sure..=at).contains(&reset.up);
        let begun = self.h.resets.iter().filter(forgets).map(|reset| reset.up + rules.hold);
        let fail_safe = begun.fold(fail_safe, u64::min);
        at + slack < fail_safe + rules.lower_standby_after && !took_over
    }

    /// Whether a pilot, or the end of the stages of loss, is a reason for standby or stop at this instant.
    fn reason_to_stop(&self, at: u64) -> bool {
        let h = self.h;
        let rules = &h.rules;
        if self.stopped.touches(at.saturating_sub(2 * SECOND), at + 1) {
            return true;
        }
        let recent = h.commanded(at.saturating_sub(3 * SECOND), at);
        let ctf = h
            .commanded(at.saturating_sub(20 * SECOND), at)
            .iter()
            .any(|commanded| commanded.command == PilotCommand::Ctf);
        if ctf
            || recent.iter().any(|commanded| {
                matches!(commanded.command, PilotCommand::Stop | PilotCommand::ShutDown | PilotCommand::Pwm)
            })
        {
            return true;
        }
        let slack = 400 * MS + 2 * rules.period;
        // Two commands of one source within its timeout or two of its periods, with nobody above it who commands otherwise.
        let requested = (0..4).any(|source| {
            let commands = self.command_log.orders(source, at);
            let [.., (first, PilotCommand::Standby), (second, PilotCommand::Standby)] = commands[..] else {
                return false;
            };
            let period = commands.len().checked_sub(3).map_or(0, |third| first - commands[third].0);
            let near = second - first <= self.command_log.age(source).max(2 * period) + MS;
            let fresh = at <= second + self.command_log.age(source) + rules.takeover + slack;
            near && fresh && (0..source).all(|higher| !self.holds_against(higher, at, slack))
        });
        requested || self.silent_for_good(at)
    }

    /// Whether no source commands run, and the stages of loss have run out.
    fn silent_for_good(&self, at: u64) -> bool {
        let h = self.h;
        let rules = &h.rules;
        let slack = 400 * MS + 2 * rules.period;
        // One that was lost has to command for a while before it is in control again.
        let commanding = |source| {
            let commands = self.command_log.last(source, at).zip(self.command_log.commands_since(source, at));
            // The silence after its last command does not count.
            commands.is_some_and(|((last, _), since)| {
                last >= since + rules.recover_after && at >= since + rules.recover_after + slack
            })
        };
        let run = self.command_log.run_in_control(at).filter(|(source, _)| commanding(*source));
        if run.is_some() && self.command_log.run_in_control(at.saturating_sub(30 * MS)).is_some() {
            return false;
        }
        // A source that commands now and then is not in control, and the stages continue.
        let long = rules.recover_after + rules.takeover;
        let sure = |above_for| {
            let sure =
                (0..4).filter_map(|source| self.last_run_in_control(source, at, long + slack, above_for));
            let started = (0..4).filter_map(|source| self.last_run_of_start(source, at));
            sure.chain(started).max()
        };
        let last = self.command_log.last_run(at).unwrap_or(0);
        // One whose demand is close takes over at once, another one only after its wait, for which it may never be there.
        let received = [sure(rules.recover_after), sure(long)].into_iter().flatten().min();
        let received = received.unwrap_or(last).min(last);
        // Silence is retained wherever the memory is.
        let power = |reset: &&Reset| reset.up <= at && reset.cause == Cause::PowerOn;
        let up = h.resets.iter().filter(power).map(|reset| reset.up).max();
        let youngest = rules.ages.into_iter().min().unwrap_or_default();
        let silent_since = match up {
            Some(up) if received < up => up,
            _ => {
                let commanded = (0..4).filter(|source| {
                    self.command_log.last(*source, received).is_some_and(|(when, _)| when == received)
                });
                let nothing = commanded.filter_map(|source| self.nothing_after(source, received, at)).min();
                nothing.unwrap_or(u64::MAX).min(received + youngest)
            }
        };
        // From the third reset without a source on it resumes at the fail-safe.
        let resets: Vec<u64> =
            h.resets.iter().map(|reset| reset.up).filter(|up| (received..=at).contains(up)).collect();
        if resets.len() >= 3 && rules.standby_after.is_some() {
            return true;
        }
        // With faults and a broken thermocouple, nothing shows whether an AMT engine runs.
        let unreadable = self.traits().faults_hide_state
            && h.sensor.touches(at.saturating_sub(SECOND), at)
            && self.faults.touches(at.saturating_sub(SECOND), at);
        // After a reset or a gap, an AMT engine is in doubt until a set reports that it runs, which no error set
        // does.
        let ups = h.resets.iter().map(|reset| reset.up);
        let gaps = self.blind.iter().filter(|(from, to)| to - from > rules.period).map(|(_, to)| to);
        let last_up = ups.chain(gaps).filter(|up| *up <= at).max();
        let no_state = self.traits().faults_hide_state
            && last_up.is_some_and(|up| self.faults.within(up, at) + 200 * MS >= at - up);
        // So it is after error sets.
        let other_state = self.traits().faults_hide_state
            && self.faults.last_before(at).is_some_and(|(_, to)| {
                // Of two sets that report running, the second one ends the doubt.
                let reported = at.saturating_sub(2 * rules.period + 100 * MS);
                to > silent_since && h.samples(to, reported.max(to + 1)).iter().all(|sample| sample.hidden)
            });
        let hidden = unreadable
            || no_state
            || other_state
            || self.blind.union(&h.noise).union(&self.down).touches(silent_since, at);
        // A loop of resets that is too short to listen ends in standby after 10 s without a source. So it does after its end, where
        // nothing shows that the engine runs: from the third reset on, the silence before them counts as that of the fail-safe stage.
        let in_a_loop = resets.last().is_some_and(|up| at < up + 3 * SECOND);
        let unseen = self.blind.union(&h.noise).touches(at.saturating_sub(SECOND), at);
        if (in_a_loop || resets.len() >= 3 && unseen)
            && at + slack + resets.len() as u64 * 200 * MS >= received + 10 * SECOND
        {
            return true;
        }
        // Where no standby is configured, it takes the silence of all sources, in doubt too: one that commands standby below is not silent.
        let fresh = |source, at| self.command_log.fresh(source, at).is_some_and(PilotCommand::is_received);
        let silent = !(0..4).any(|source| fresh(source, at) && fresh(source, at.saturating_sub(slack)));
        let last_stage = match rules.standby_after {
            Some(after) if hidden => Some(after.min(10 * SECOND)),
            None if hidden && silent => Some(10 * SECOND),
            after => after,
        };
        last_stage.is_some_and(|after| at + slack >= silent_since + rules.hold.min(after) + after)
    }

    pub(super) fn given_up(&mut self) {
        let h = self.h;
        for &(at, mark) in h.marks.iter().filter(|(_, mark)| *mark == Mark::GivenUp) {
            let ran = h.sample(at.saturating_sub(200 * MS)).is_some_and(|sample| sample.runs());
            let since = at.saturating_sub(h.rules.gives_up_after + 500 * MS);
            let run = |at| self.command_log.run_in_control(at).is_some();
            let exempt = self.exempt_at(since, at);
            // With nothing retained, and error sets only, nobody knows that it ran. After them two sets have
            // to be consistent before there is a reply.
            let sets = at.saturating_sub(3 * h.rules.period);
            // From the first set on: that of the beginning may have been sent before.
            let first = 2 * h.rules.period;
            let faults = |up| h.samples(up + first, sets).iter().all(|sample| sample.fault);
            let power = h.resets.iter().rev().find(|reset| reset.up <= at && reset.cause == Cause::PowerOn);
            // After a brown-out it is known that the engine ran, but it continues only if the exhaust
            // temperature can be read.
            let brown_out =
                h.resets.iter().rev().find(|reset| reset.up <= at && reset.cause == Cause::BrownOut);
            // What is read once the order has been given up comes too late.
            let unreadable = |up| {
                let given_up = sets.min(up + h.rules.serial_delay.saturating_sub(4 * h.rules.period));
                faults(up) && h.sensor.within(up, given_up) == given_up.saturating_sub(up)
            };
            // In doubt since a reset, after which only error sets arrived, damaged sets get no reply.
            let reset = h.last_reset(at);
            let damaged = h.noise.last_before(at).filter(|(from, to)| {
                at <= *to + h.rules.period
                    && at >= from + h.rules.gives_up_after.saturating_sub(h.rules.period)
            });
            let doubted = reset.zip(damaged).is_some_and(|(reset, (from, _))| {
                h.samples(reset.up + first, from).iter().all(|sample| sample.fault)
            });
            // After a gap error sets do not say whether it is the same engine, and get no reply: none where they come first, nor while the
            // exhaust falls or cannot be read.
            // It takes three sets to find that out.
            let mut gaps = self.blind.iter().filter(|(from, to)| {
                to - from > 2 * h.rules.period && (*to < sets || *to <= at && self.faults.contains(*to))
            });
            let lately = since.saturating_sub(2 * SECOND);
            let falls = |sample: &Sample| {
                let before = h.sample(sample.at.saturating_sub(2 * SECOND));
                before.is_some_and(|before| before.egt >= sample.egt + FALLS)
            };
            let unclear = h.sensor.touches(lately, at) || h.samples(lately, at - 100 * MS).iter().any(falls);
            let behind_gap = gaps.any(|(_, to)| (to >= since || unclear) && faults(to));
            // After a fault only a set that reports running does.
            let fault = self.faults.last_before(at).filter(|(_, to)| *to < sets);
            let after_fault = fault.is_some_and(|(_, to)| {
                // One set before it may report running: two are needed. An alternate set beside that one reports nothing.
                let beside = h.alternate.iter().any(|set| (to..to + first).contains(set));
                let longer = beside && self.sets_of_running(to, sets) <= 1;
                let first = first + if longer { h.rules.period } else { 0 };
                h.samples(to + first, sets).iter().all(|sample| sample.hidden)
                    && at < to + h.rules.gives_up_after + first
            });
            let unknown = [
                (doubted, "AMT, damaged sets after a reset with error sets"),
                (behind_gap, "AMT, error sets after a gap"),
                (after_fault, "AMT, another state than running after error sets"),
                (power.is_some_and(|reset| faults(reset.up)), "AMT, error sets and nothing retained"),
                (brown_out.is_some_and(|reset| unreadable(reset.up)), "AMT, error sets without an exhaust"),
            ];
            let unknown =
                unknown.into_iter().find(|(unknown, _)| self.traits().faults_hide_state && *unknown);
            // An engine that was handed over stops when its PWM input is lost, which is not the node's doing.
            let handed_over = h.pwm.contains(at.saturating_sub(h.rules.period));
            // CTF ends it after the same time, and that was the pilot's command.
            let last_sent = h.frames[..h.frames.partition_point(|frame| frame.at < at)].last();
            let by_ctf = last_sent.is_some_and(|frame| frame.sent == Sent::Ctf && frame.arrived);
            if mark == Mark::GivenUp
                && !handed_over
                && !by_ctf
                && ran
                && run(at)
                && run(since)
                && !exempt
                && self.known_to_run(since)
            {
                if let Some((_, name)) = unknown {
                    self.verdict.exempt(name, at - since);
                    continue;
                }
                // The only exemption is a gap that the ECU tolerates.
                let hidden = self.down.within(since, at) + h.noise.within(since, at);
                let text = format!(
                    "the ECU put out a running engine for want of commands ({} ms of the last {} ms disturbed)",
                    hidden / MS,
                    (at - since) / MS
                );
                self.verdict.finding(Rule::GivenUp, at, text);
            }
        }
    }

    /// Number of sets between two instants that certainly report a running engine.
    fn sets_of_running(&self, from_us: u64, to_us: u64) -> usize {
        let h = self.h;
        // Six bytes, where a reply has five; its content is that of its first bit, between two samples.
        let first_bit = |set: u64| set.saturating_sub(h.rules.frame / 5 * 6);
        let sample = 50 * MS;
        let runs = |at: u64| {
            let samples = h.samples(at.saturating_sub(sample), at + sample);
            samples.iter().all(|sample| sample.runs() && !sample.fault && !sample.hidden)
        };
        let sets = h.sets.iter().filter(|set| (from_us..to_us).contains(*set));
        sets.filter(|set| !h.alternate.contains(set) && runs(first_bit(**set))).count()
    }

    /// Since when the engine has run on one order: a relight by the ECU does not begin another one.
    fn ran_since(&self, at: u64) -> u64 {
        let mut since = self.runs.last_before(at).map_or(0, |(from, _)| from);
        let relit = |from, to| {
            self.h.marks.iter().any(|(when, mark)| *mark == Mark::Relight && (from..to).contains(when))
        };
        while let Some((from, to)) = self.runs.last_before(since)
            && relit(to, since)
        {
            since = from;
        }
        since
    }

    /// Whether a limit, or another engine, may hold the demand down at this instant.
    pub(super) fn reduced(&self, at: u64) -> bool {
        let h = self.h;
        let since = self.ran_since(at);
        // The fail-safe of a limit holds until standby: a limit that was exceeded before the demand was last above the fail-safe
        // has had no such action.
        let rules = &h.rules;
        let fall = 1000 * SECOND / u64::from(rules.ramp.min(rules.slew_down.unwrap_or(rules.ramp)).max(1));
        let start = since.saturating_sub(60 * SECOND);
        let high = self.high[..self.high.partition_point(|high| *high <= at)].last();
        // Of a demand that the node could not lower meanwhile, the fall comes later.
        let hidden = |high: u64| self.blind.within(high.saturating_sub(60 * SECOND), high);
        let start =
            high.map_or(start, |high| start.max(high.saturating_sub(fall + 3 * SECOND + hidden(*high))));
        let ran = h.samples(start, at);
        // Noise may forge two consistent values.
        let noise = h.noise.touches(start, at);
        let over =
            |egt| noise || ran.iter().any(|sample| sample.egt > egt - 10.0) || h.sensor.touches(start, at);
        let fast = |rpm| noise || ran.iter().any(|sample| sample.rpm > rpm - 1500.0);
        let limit_egt = matches!(h.rules.limit_egt, Some((egt, false)) if over(egt));
        let limit_rpm = matches!(h.rules.limit_rpm, Some((rpm, false)) if fast(rpm));
        let limit_fault =
            h.rules.limit_fault == Some(false) && (noise || ran.iter().any(|sample| sample.fault));
        let other =
            h.rules.when_other_fails.is_some() && h.other_failed.touches(at.saturating_sub(8 * SECOND), at);
        let ctf = h.commanded(since, at).iter().any(|commanded| commanded.command == PilotCommand::Ctf);
        // A turbine that goes out, or whose values are damaged, exceeds it. It may be relit in the same life. Idle calibration
        // may be reported as running.
        let out =
            |sample: &Sample| matches!(sample.phase, Phase::Running | Phase::LearningIdle) && !sample.lit;
        let slow = |rpm| noise || ran.iter().any(|sample| sample.lit && sample.rpm < rpm + 1500.0);
        let limit_low = matches!(h.rules.limit_low_rpm, Some((rpm, false)) if slow(rpm));
        let limit_supply = h.rules.limit_supply == Some(false) && h.low_supply.touches(start, at + 1);
        let off = h.unpowered.iter().any(|(from, _)| (start..at).contains(&from) && self.runs.contains(from));
        let limit_change = h.rules.limit_changes.contains(&Some(false))
            && (noise
                || h.sensor.touches(start, at)
                || ran.iter().any(out)
                || off
                || !self.live.contains(at));
        let limit_jump = (h.rules.limit_jump == Some(false) || h.rules.jump_lowers)
            && h.jumps.iter().any(|jump| (start..at).contains(jump));
        limit_jump
            || limit_low
            || limit_supply
            || limit_change
            || limit_egt
            || limit_rpm
            || limit_fault
            || other
            || ctf
    }
}

/// The longest time between two instants that none of these touches.
fn longest_outside(spans: &Spans, from_us: u64, at_us: u64) -> u64 {
    let (mut since, mut longest) = (from_us, 0);
    for (begins, ends) in spans.iter().filter(|(begins, ends)| *ends > from_us && *begins < at_us) {
        longest = longest.max(begins.saturating_sub(since));
        since = ends;
    }
    longest.max(at_us.saturating_sub(since))
}
