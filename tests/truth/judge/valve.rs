//! The fuel valve: every latched stop closes it, no fuel comes through it then, and it never shuts off a healthy
//! engine.

use super::case::{Case, Rule, seconds};
use super::starts::Start;
use crate::history::{Cause, MS, Mark, PilotCommand, Pin, SECOND, Switch};

/// Time from the reason until it is closed: the node checks its engine at each event of the world, 50 ms apart or less.
const LATE: u64 = 60 * MS;
/// Time by which a flame without fuel is out: samples of the turbine are 50 ms apart.
const BURNS_ON: u64 = 200 * MS;
/// A standby that is not obeyed closes the valve 5 s later, not before. Until it is in force and on the wire, run is.
const NOT_OBEYED: u64 = 4500 * MS;
/// A start that the firmware itself ends before has failed. Once they add up to 10 s in a row, the valve is closed; each may
/// count for up to this much more than it lived.
const LIVED: u64 = SECOND;
const COUNTS_MORE: u64 = 10 * MS;
const MAY_CLOSE: u64 = 9900 * MS;
const HAS_TO_CLOSE: u64 = 10 * SECOND;
/// Age of a standby command that can be the reason why the valve closes: the stages of loss, an unknown state and a take-over lie
/// between.
const REASON: u64 = 60 * SECOND;

impl Case<'_> {
    pub(super) fn valve(&mut self) {
        if self.h.pin.is_empty() {
            return;
        }
        self.stop_closes_it();
        self.no_fuel_through_it();
        self.cuts_nothing_healthy();
        self.closes_in_standby_only();
        self.starts_find_it_open();
        self.failed_starts_close_it();
        let closes = self.h.pin.iter().filter(|(_, pin)| *pin == Pin::Closed).count();
        self.verdict.count("valves closed", closes as u64);
    }

    fn stop_closes_it(&mut self) {
        let open = self.h.pin_is(Pin::Open);
        for (from, to) in self.stopped.clone().iter() {
            let late = from + LATE;
            if to > late && open.touches(late, to) {
                let text = format!("stopped at {}, and the valve is open", seconds(from));
                self.verdict.finding(Rule::Valve, late, text);
            }
        }
    }

    fn no_fuel_through_it(&mut self) {
        let runs = self.h.times(|sample| sample.runs());
        for (from, to) in self.h.shut.iter() {
            let late = from + BURNS_ON;
            if to > late && runs.touches(late, to) {
                self.verdict.finding(Rule::ShutValve, late, "an engine burns behind a valve that is shut");
            }
        }
    }

    /// A running engine loses its fuel by a stop, by standby, or because its record is lost.
    fn cuts_nothing_healthy(&mut self) {
        let h = self.h;
        let new: Vec<u64> = h.pin.iter().filter(|(_, pin)| *pin == Pin::Closed).map(|(at, _)| *at).collect();
        for at in new {
            // Long enough for the node to know it. A reset ends a start.
            let mut begins = h.resets.iter().filter(|reset| (reset.up..reset.up + LATE).contains(&at));
            let begins = begins.next_back();
            // A valve that was closed before a reset stays closed: whether that was right was judged then.
            let before = |down: u64| h.pin.iter().rev().find(|(at, _)| *at < down).map(|(_, pin)| *pin);
            if begins.is_some_and(|reset| before(reset.down) == Some(Pin::Closed)) {
                continue;
            }
            let known = begins.map_or(at, |reset| reset.down);
            let lately = known.saturating_sub(self.two_states() + LATE);
            let before = h.samples(lately, at);
            let runs = !before.is_empty() && before.iter().all(|sample| sample.runs());
            let forged = self.forged_among_faults().touches(at.saturating_sub(LATE), at + 1);
            if !runs
                || !self.could_know(known)
                || forged
                || self.stopped.touches(at.saturating_sub(LATE), at + 1)
            {
                continue;
            }
            let lost = begins.is_some_and(|reset| reset.cause == Cause::PowerOn);
            // A node that begins closes it at once if standby was in force.
            let run = begins.is_none() && h.first_run(at.saturating_sub(NOT_OBEYED), at).is_some();
            // The last command of each source counts, except arming and presence.
            let commanded = h.commanded(at.saturating_sub(REASON), at);
            let wanted = (0..4).any(|source| {
                let mut own = commanded.iter().rev().filter(|commanded| commanded.source == source);
                let last = own.find(|own| !matches!(own.command, PilotCommand::Arm | PilotCommand::Nothing));
                last.is_some_and(|last| last.command.ends_a_run())
            });
            // No later run command reverses the end of a run: that needs a start.
            let for_good = |of: &crate::history::Commanded| {
                matches!(of.command, PilotCommand::ShutDown | PilotCommand::Stop | PilotCommand::Ctf)
            };
            let wanted = wanted || h.commanded(at.saturating_sub(20 * SECOND), at).iter().any(for_good);
            // A node in standby continues with it over a reset; a run that a loss or a limit ended shows on
            // the wire.
            let and_next = h.frames_within(at.saturating_sub(NOT_OBEYED), at + LATE + 2 * h.rules.period);
            let ended = and_next.iter().any(|frame| frame.sent.switch() == Some(Switch::Standby));
            // While a wire is cut, an AMT ECU gets no reply: the order in force shows when it does again.
            let later = &h.frames[h.frames.partition_point(|frame| frame.at < at)..];
            let ended = ended || later.iter().find_map(|frame| frame.sent.switch()) == Some(Switch::Standby);
            if begins.is_some_and(|reset| self.failed_before(reset.up, COUNTS_MORE) >= MAY_CLOSE) {
                self.verdict.exempt("the firmware failed in repeated starts", at - known);
                continue;
            }
            // The stages of loss end in standby. In a loop of short resets, the valve closes before a frame is
            // due.
            let run_out = h.rules.standby_after.unwrap_or(10 * SECOND);
            let silent =
                at > run_out && !h.commanded(at - run_out, at).iter().any(|c| c.command.is_received());
            let given_up = begins.is_some() && silent;
            if !lost && !given_up && (run || !wanted && !ended) {
                let why = if run { "run is on the wire" } else { "standby was not commanded" };
                self.verdict.finding(
                    Rule::CutOff,
                    at,
                    format!("the valve cuts an engine that runs, and {why}"),
                );
            }
        }
    }

    /// Whatever the engine does: what closes the valve is an order of standby or stop, and an ECU that does not follow run is no reason.
    fn closes_in_standby_only(&mut self) {
        let h = self.h;
        let closes = h.pin.windows(2).filter(|pair| pair[0].1 == Pin::Open && pair[1].1 == Pin::Closed);
        for at in closes.map(|pair| pair[1].0).collect::<Vec<_>>() {
            let begins = h.resets.iter().rfind(|reset| reset.up <= at).map_or(0, |reset| reset.up);
            let switch = |frame: &crate::history::Frame| frame.sent.switch();
            let before = h.frames_within(begins, at).iter().rev().find_map(switch);
            let after = h.frames_within(self.decided_after(at), at + SECOND).iter().find_map(switch);
            // Standby and run again within one send slot: the standby is never on the wire.
            let lately = h.commanded(at.saturating_sub(2 * h.rules.period + LATE), at);
            let commanded = lately.iter().any(|commanded| {
                let above = |other: &&crate::history::Commanded| {
                    other.source < commanded.source && matches!(other.command, PilotCommand::Run(_))
                };
                let streamed = commanded.command == PilotCommand::Standby;
                commanded.command.ends_a_run() && !(streamed && lately.iter().any(|other| above(&other)))
            });
            let is_known = |found: &super::case::Finding| found.rule == Rule::CutOff && found.at == at;
            if before == Some(Switch::Run)
                && after == Some(Switch::Run)
                && !commanded
                && !self.verdict.findings.iter().any(is_known)
            {
                self.verdict.finding(Rule::CutOff, at, "the valve closes, and run is ordered");
            }
        }
    }

    /// The earliest instant at which a frame can carry what was decided then. A limit is judged once the reply to the set that exceeds
    /// it has been handed out: the next one carries its action.
    fn decided_after(&self, at: u64) -> u64 {
        let set = self.h.sets[..self.h.sets.partition_point(|set| *set <= at)].last();
        if set.is_some_and(|set| set + MS > at) { at + MS } else { at }
    }

    /// Time of consecutive failed starts, when the node begins at this time; each counts for this much more.
    fn failed_before(&self, begins: u64, besides: u64) -> u64 {
        let (mut since, mut failed) = (0, 0);
        for reset in self.h.resets.iter().filter(|reset| reset.up <= begins) {
            let life = reset.down.saturating_sub(since);
            failed = match reset.cause {
                Cause::PowerOn => 0,
                _ if life >= LIVED => 0,
                Cause::Watchdog => failed + life + besides,
                Cause::BrownOut => failed,
            };
            since = reset.up;
        }
        failed
    }

    /// A firmware that fails at each start does not hold a valve open forever.
    fn failed_starts_close_it(&mut self) {
        let open = self.h.pin_is(Pin::Open);
        for reset in self.h.resets.clone() {
            if self.failed_before(reset.up, 0) > HAS_TO_CLOSE && open.touches(reset.up, reset.up + LATE) {
                let text = format!(
                    "the node begins at {} after 10 s of failed starts, and opens the valve",
                    seconds(reset.up)
                );
                self.verdict.finding(Rule::Valve, reset.up, text);
            }
        }
    }

    /// Whether the node received reports without interruption for long enough to know of the run that lasts until then: not in a
    /// loop of shorter resets, nor while the wire is cut.
    pub(super) fn could_know(&self, until: u64) -> bool {
        let runs = self.h.times(|sample| sample.runs());
        let Some(began) = runs.iter().find(|(from, to)| *from < until && until <= *to).map(|(from, _)| from)
        else {
            return false;
        };
        // A loss of power erases what it knew.
        let erased = self.h.resets.iter().filter(|reset| reset.cause == Cause::PowerOn && reset.up < until);
        let began = erased.map(|reset| reset.up).max().map_or(began, |up| began.max(up));
        self.longest_received(began, until) >= self.two_states() + LATE
    }

    /// An engine that run on the wire lights has its valve open. After failed starts of the firmware, one that nobody starts has it
    /// closed, whatever its ECU does on the run that it is sent.
    fn starts_find_it_open(&mut self) {
        let h = self.h;
        let closed = h.pin_is(Pin::Closed);
        let starts = self.pairs();
        for (at, mark) in &h.marks {
            let since = at.saturating_sub(SECOND);
            let frames = h.frames_within(since, *at);
            let run = frames.iter().rev().find_map(|frame| frame.sent.switch()) == Some(Switch::Run);
            let is_closed = run && closed.within(since, at + LATE) == SECOND + LATE;
            if *mark == Mark::Ignition && is_closed && !self.is_cut(*at, &starts) {
                self.verdict.finding(Rule::ShutValve, *at, "a start, and the valve is closed");
            }
        }
    }

    /// Whether the firmware has failed in repeated starts, and nobody has started the engine since.
    fn is_cut(&self, at: u64, starts: &[Start]) -> bool {
        let begins = self.h.resets.iter().map(|reset| reset.up).filter(|up| *up <= at);
        let failed = begins.filter(|up| self.failed_before(*up, COUNTS_MORE) >= MAY_CLOSE).max();
        failed.is_some_and(|up| !starts.iter().any(|start| (up..=at).contains(&start.at)))
    }
}
