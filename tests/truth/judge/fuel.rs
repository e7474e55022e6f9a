//! Fuel into an engine at rest.

use super::case::{Case, Rule, seconds};
use crate::history::{Commanded, Frame, MS, PilotCommand, SECOND, Sent, Spans};
use sim::turbine::Phase;

/// Services that move fuel or heat: drain, glow plug, valves, pump, pump held open. The starter does neither.
const MOVES: [u8; 6] = [1, 2, 3, 4, 5, 12];
pub(super) const OPEN_PUMP: u8 = 12;
/// ZK's ClosePump.
pub(super) const CLOSE_PUMP: u8 = 13;
/// Frames with which a pump is closed.
pub(super) const CLOSING: usize = 10;

impl Case<'_> {
    pub(super) fn fuel(&mut self) {
        self.hot_fuel();
        self.services();
        self.pump();
    }

    fn hot_fuel(&mut self) {
        let hot = self.h.rules.egt_max + 10.0;
        let flows = self.h.times(|sample| !sample.phase.is_live() && sample.flow > 0.0 && sample.egt > hot);
        for (from, to) in flows.iter().take(1) {
            let egt = self.h.sample(from).map_or(0.0, |sample| sample.egt);
            let text =
                format!("fuel flows for {} into an engine at rest with {egt:.0} °C", seconds(to - from));
            self.verdict.finding(Rule::HotFuel, from, text);
        }
    }

    fn services(&mut self) {
        let h = self.h;
        let mut reported = 0;
        for frame in &h.frames {
            let Sent::Action(number) = frame.sent else { continue };
            let at = frame.at;
            if !MOVES.contains(&number) || at < reported {
                continue;
            }
            let commands = h.commanded(at.saturating_sub(10 * SECOND), at).iter().rev();
            let mut commands = commands.filter(|other| other.command == PilotCommand::Service(number));
            let last = commands.clone().next();
            // Of two sources that command it in one slot, it is that of the one that may.
            let together = |other: &&Commanded| last.is_some_and(|last| other.at + h.rules.period >= last.at);
            let may = |other: &&Commanded| together(other) && !self.is_behind(other.source, other.at);
            let command = commands.find(may).or(last);
            let lately = |time: u64| h.samples(at.saturating_sub(time), at);
            let why = match command {
                None => Some("no pilot commanded it lately".to_string()),
                Some(commanded)
                    if !self.command_log.armed_within(commanded.at.saturating_sub(200 * MS), at) =>
                {
                    Some("the engine is not armed".into())
                }
                Some(commanded) if self.is_behind(commanded.source, commanded.at) => {
                    Some("its source is behind another one".into())
                }
                Some(commanded) if self.is_new(commanded.at) => {
                    Some("nothing was received of the ECU until just now".into())
                }
                _ if self.is_in_gap(at) => Some("nothing is received of the ECU".into()),
                _ if lately(1200 * MS).iter().all(|sample| sample.phase != Phase::Standby) => {
                    Some("it is not in standby".into())
                }
                _ => {
                    let coolest = lately(1200 * MS).iter().map(|sample| sample.egt).fold(f64::MAX, f64::min);
                    let hot = coolest > h.rules.egt_max + 6.0;
                    hot.then(|| format!("the exhaust has {coolest:.0} °C"))
                }
            };
            if let Some(why) = why {
                self.verdict.finding(Rule::Service, at, format!("service {number} on the wire, and {why}"));
                reported = at + 10 * SECOND;
            }
        }
    }

    /// A higher source has been commanding for a long time.
    fn is_behind(&self, source: usize, at: u64) -> bool {
        let rules = &self.h.rules;
        let long = rules.recover_after + rules.takeover + SECOND;
        let commands = |higher| {
            // Before it commands again it has to command for a while.
            let lately = self.command_log.until(higher, at).iter().rev();
            let mut lately = lately.take_while(|(when, _)| when + long > at);
            let nothing = lately.any(|(_, command)| *command == PilotCommand::Nothing);
            // A single order to shut down is not a stream, nor is a hand-over.
            let streamed = self.command_log.until(higher, at).iter().rev();
            let streamed = streamed
                .clone()
                .find(|(_, command)| !matches!(command, PilotCommand::ShutDown | PilotCommand::Pwm));
            let steady = |since| {
                streamed.is_some_and(|(last, _)| {
                    *last >= since + rules.recover_after
                        && at >= since + long
                        && at < last + self.command_log.age(higher)
                })
            };
            !nothing && self.command_log.commands_since(higher, at).is_some_and(steady)
        };
        (0..source).any(commands) && !self.down.touches(at.saturating_sub(long), at)
    }

    /// The line has not been up for long enough.
    fn is_new(&self, at: u64) -> bool {
        let stable = self.h.rules.link_stable.saturating_sub(300 * MS);
        self.blind.iter().any(|(from, to)| to - from >= self.gap() && to <= at && at < to + stable)
    }

    /// Nothing has been received for long enough to detect it.
    fn is_in_gap(&self, at: u64) -> bool {
        let period = self.h.rules.period;
        self.blind.iter().any(|(from, to)| at > from + self.gap() + 2 * period && at < to)
    }

    /// When the tenth ClosePump frame after the end of a service was sent, if none of the ten reached the ECU.
    fn lost_closing(&self, from_us: u64, to_us: u64) -> Option<u64> {
        let closing = self.h.frames_within(from_us, to_us).iter();
        let closing: Vec<&Frame> =
            closing.filter(|frame| frame.sent == Sent::Action(CLOSE_PUMP)).take(CLOSING).collect();
        let lost = closing.len() == CLOSING && closing.iter().all(|frame| !frame.arrived);
        closing.last().filter(|_| lost).map(|frame| frame.at + 1)
    }

    /// A pump that was opened is closed at its end, at any stop and disarm, and when its source falls silent.
    fn pump(&mut self) {
        let h = self.h;
        let flows = h.times(|sample| !sample.phase.is_live() && sample.flow > 0.0);
        let hidden = h.noise.union(&h.deaf).union(&self.down.longer(h.rules.listen + SECOND));
        let opened: Vec<u64> = h
            .frames
            .iter()
            .filter(|frame| frame.sent == Sent::Action(OPEN_PUMP) && frame.arrived)
            .map(|frame| frame.at)
            .collect();
        for (from, to) in flows.iter() {
            let Some(&open) = opened.iter().rev().find(|open| **open <= from + SECOND) else { continue };
            if open + 2 * SECOND < from {
                continue;
            }
            self.verdict.count("pumps open for more than 1 s", u64::from(to > open + SECOND));
            let command = h
                .commanded(0, open)
                .iter()
                .rev()
                .find(|commanded| commanded.command == PilotCommand::Service(OPEN_PUMP));
            let Some(command) = command else { continue };
            let mut ends = open + h.rules.pump_bound;
            let ended = h
                .commanded(open, to)
                .iter()
                .find(|commanded| matches!(commanded.command, PilotCommand::Stop | PilotCommand::Disarm));
            ends = ends.min(ended.map_or(u64::MAX, |commanded| commanded.at));
            // The source's own commands, one after the other.
            let mut received = command.at;
            for commanded in h
                .commanded(command.at, to)
                .iter()
                .filter(|commanded| commanded.source == command.source && commanded.command.is_received())
            {
                if commanded.at > received + self.command_log.age(command.source) {
                    break;
                }
                received = commanded.at;
            }
            ends = ends.min(received + self.command_log.age(command.source) + h.rules.hold + SECOND);
            // Ten frames that were all lost close nothing, also those of its source's standby; the next disarm, stop or reset sends ten
            // more.
            let mut since = open;
            while let Some(last) = self.lost_closing(since, to) {
                let again = h.commanded(last, to).iter().filter(|commanded| {
                    matches!(commanded.command, PilotCommand::Stop | PilotCommand::Disarm)
                });
                let reset = h.resets.iter().map(|reset| reset.up).filter(|up| *up > last);
                ends = again.map(|commanded| commanded.at).chain(reset).min().unwrap_or(u64::MAX);
                since = ends;
            }
            // A test in between has its own limit, in the ECU.
            let tests =
                h.frames.iter().filter(|frame| matches!(frame.sent, Sent::Action(1..=5)) && frame.arrived);
            let tests = tests.map(|frame| frame.at).filter(|at| (open..to).contains(at)).max();
            ends = ends.max(tests.map_or(0, |at| at + 3500 * MS));
            // Ten frames in every second slot, and the time in which none gets through.
            let late = 1500 * MS + 20 * h.rules.period;
            let clear = Spans::from(&[(ends, to)]);
            if to > ends.saturating_add(late) && clear.total() - clear.common(&hidden) > late {
                let text = format!("the pump, opened at {}, is open until {}", seconds(open), seconds(to));
                self.verdict.finding(Rule::Pump, ends + late, text);
                return;
            }
        }
    }
}
