//! Radio control: what it commands is what stick and switch say, and a stop of the switch is a stop.

use super::case::{Case, Rule, seconds};
use crate::history::{Demanded, MS, PilotCommand, Position, SECOND, Spans, Sticks};

const RC: usize = 1;
/// The frame with it, and two before: a value counts when it is the median of three.
const LATELY: u64 = 3 * 14 * MS + 20 * MS;
/// A switch and a stick that are to be steady have been so for 0.5 s.
const STEADY: u64 = 500 * MS;
/// After a pause all positions are held for longer until they count.
const RETURN: u64 = 1400 * MS;

impl Case<'_> {
    pub(super) fn sticks(&mut self) {
        if self.h.sticks.is_empty() {
            return;
        }
        self.commands_are_those_of_the_sticks();
        self.starts_are_moves();
        self.stop_of_the_switch_stops();
        self.verdict.count("moves of stick and switch", self.h.sticks.len() as u64);
    }

    /// What stick and switch were within this time.
    fn were(&self, from: u64, to: u64) -> &[Sticks] {
        let sticks = &self.h.sticks;
        let first = sticks.partition_point(|sticks| sticks.at <= from).saturating_sub(1);
        let last = sticks.partition_point(|sticks| sticks.at <= to).max(first);
        &sticks[first..last]
    }

    fn commands_are_those_of_the_sticks(&mut self) {
        let mut wrong = Vec::new();
        for commanded in self.h.commanded.iter().filter(|commanded| commanded.source == RC) {
            let at = commanded.at;
            let lately = self.were(at.saturating_sub(LATELY), at);
            let any = |holds: fn(&Sticks) -> bool| lately.iter().any(|sticks| sticks.on && holds(sticks));
            let right = match commanded.command {
                PilotCommand::Stop => any(|sticks| sticks.position == Position::Stop),
                // In standby radio control is in control in both positions.
                PilotCommand::Standby => any(|sticks| sticks.position != Position::Stop),
                PilotCommand::Run(Demanded::Throttle(tenths)) => {
                    // Two damaged frames of three may agree on a throttle, for one frame.
                    let damaged = &self.h.damaged_sticks;
                    let first = damaged.partition_point(|each| *each < at.saturating_sub(LATELY));
                    let overruled = damaged.iter().skip(first).take_while(|each| **each <= at).count() >= 2;
                    // A damaged frame in the middle of a move may be the median: a value between the two, or one beside it whose last
                    // bits are damaged.
                    let sticks = lately.iter().filter(|sticks| sticks.on).map(|sticks| sticks.tenths);
                    let (low, high) =
                        sticks.fold((u32::MAX, 0), |(low, high), tenths| (low.min(tenths), high.max(tenths)));
                    (overruled || (low.saturating_sub(8)..=high + 8).contains(&tenths))
                        && any(|sticks| sticks.position == Position::Run)
                }
                PilotCommand::Release | PilotCommand::Arm => {
                    any(|sticks| sticks.position == Position::Standby && sticks.tenths == 0)
                }
                PilotCommand::Disarm | PilotCommand::Nothing => true,
                _ => false,
            };
            if !right {
                wrong.push((at, format!("{:?}, and stick and switch are {lately:?}", commanded.command)));
            }
        }
        for (at, text) in wrong.into_iter().take(3) {
            self.verdict.finding(Rule::Sticks, at, text);
        }
    }

    /// Run after standby is a move of the switch with the stick at idle, unless something else had started the engine.
    fn starts_are_moves(&mut self) {
        let h = self.h;
        let own: Vec<_> = h
            .commanded
            .iter()
            .filter(|commanded| commanded.source == RC)
            .filter(|commanded| matches!(commanded.command, PilotCommand::Run(_) | PilotCommand::Standby))
            .collect();
        let mut wrong = Vec::new();
        for pair in own.windows(2) {
            let (PilotCommand::Standby, PilotCommand::Run(_)) = (pair[0].command, pair[1].command) else {
                continue;
            };
            let at = pair[1].at;
            let others = h.commanded(at.saturating_sub(60 * SECOND), at).iter();
            let by_another = others.clone().any(|other| {
                other.source != RC && matches!(other.command, PilotCommand::Run(_) | PilotCommand::Pwm)
            });
            let found = h.resets.iter().any(|reset| reset.up <= at && reset.up + 30 * SECOND > pair[0].at);
            if by_another || found || self.live.touches(at.saturating_sub(SECOND), at) {
                continue;
            }
            let before = self.were(at.saturating_sub(STEADY - 50 * MS), at);
            let idle = before.iter().all(|sticks| sticks.tenths == 0 && sticks.on);
            let moved = before.iter().any(|sticks| sticks.position == Position::Standby);
            if !idle || !moved {
                wrong.push((at, format!("a start, and stick and switch were {before:?}")));
            }
        }
        for (at, text) in wrong.into_iter().take(3) {
            self.verdict.finding(Rule::Sticks, at, text);
        }
    }

    fn stop_of_the_switch_stops(&mut self) {
        let h = self.h;
        let ends = h.sticks.iter().skip(1).map(|sticks| sticks.at).chain([h.end]);
        let off = h.sticks.iter().zip(ends.clone()).filter(|(sticks, _)| !sticks.on);
        let off = Spans::from(&off.map(|(sticks, end)| (sticks.at, end)).collect::<Vec<_>>());
        let deaf = off.longer(RETURN).union(&self.down.longer(RETURN)).union(&Spans::from(&[(0, RETURN)]));
        let mut wrong = Vec::new();
        let mut held: Option<u64> = None;
        for (sticks, end) in h.sticks.iter().zip(ends) {
            held = match sticks.position {
                Position::Stop if sticks.on => held.or(Some(sticks.at)),
                _ => None,
            };
            let Some(from) = held else { continue };
            let by = from + 250 * MS;
            if end > by && !deaf.touches(from, by) {
                let stopped = h.commanded(from, by).iter();
                let stopped =
                    stopped.clone().any(|each| each.source == RC && each.command == PilotCommand::Stop);
                if !stopped {
                    wrong.push((
                        by,
                        format!("the switch is at stop since {}, and nothing stops", seconds(from)),
                    ));
                }
            }
        }
        for (at, text) in wrong.into_iter().take(3) {
            self.verdict.finding(Rule::Sticks, at, text);
        }
    }
}
