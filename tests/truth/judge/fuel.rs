//! Fuel into an engine at rest.

use super::{Case, Rule, seconds};
use crate::history::{MS, SECOND, Spans, Told, Word};
use sim::turbine::Phase;

/// Services that move fuel or heat: drain, glow plug, valves, pump, pump held open. The starter does neither.
const MOVES: [u8; 6] = [1, 2, 3, 4, 5, 12];
const OPEN_PUMP: u8 = 12;

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
            let Told::Action(number) = frame.told else { continue };
            let at = frame.at;
            if !MOVES.contains(&number) || at < reported {
                continue;
            }
            let word = h.said(at.saturating_sub(10 * SECOND), at).iter().rev();
            let word = word.clone().find(|said| said.word == Word::Service(number));
            let lately = |time: u64| h.samples(at.saturating_sub(time), at);
            let why = match word {
                None => Some("no pilot said so lately".to_string()),
                Some(said) if !self.voices.armed_within(said.at.saturating_sub(200 * MS), at) => {
                    Some("the engine is not armed".into())
                }
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

    /// A pump that was opened is closed at its end, at any stop and disarm, and when its source falls silent.
    fn pump(&mut self) {
        let h = self.h;
        let flows = h.times(|sample| !sample.phase.is_live() && sample.flow > 0.0);
        let hidden =
            self.blind.union(&h.noise).union(&h.deaf).union(&self.down.longer(h.rules.listen + SECOND));
        let opened: Vec<u64> = h
            .frames
            .iter()
            .filter(|frame| frame.told == Told::Action(OPEN_PUMP) && frame.arrived)
            .map(|frame| frame.at)
            .collect();
        for (from, to) in flows.iter() {
            let Some(&open) = opened.iter().rev().find(|open| **open <= from + SECOND) else { continue };
            if open + 2 * SECOND < from {
                continue;
            }
            let word = h.said(0, open).iter().rev().find(|said| said.word == Word::Service(OPEN_PUMP));
            let Some(word) = word else { continue };
            let mut ends = open + h.rules.pump_bound;
            let ended = h.said(open, to).iter().find(|said| matches!(said.word, Word::Stop | Word::Disarm));
            ends = ends.min(ended.map_or(u64::MAX, |said| said.at));
            // The source's own words, one after the other.
            let mut heard = word.at;
            for said in
                h.said(word.at, to).iter().filter(|said| said.source == word.source && said.word.is_heard())
            {
                if said.at > heard + self.voices.age(word.source) {
                    break;
                }
                heard = said.at;
            }
            ends = ends.min(heard + self.voices.age(word.source) + h.rules.hold + SECOND);
            // A test in between has its own bound, in the ECU.
            let tests =
                h.frames.iter().filter(|frame| matches!(frame.told, Told::Action(1..=5)) && frame.arrived);
            let tests = tests.map(|frame| frame.at).filter(|at| (open..to).contains(at)).max();
            ends = ends.max(tests.map_or(0, |at| at + 3500 * MS));
            // Ten frames at every second slot, and what does not get through.
            let late = 1500 * MS + 20 * h.rules.period;
            let clear = Spans::from(&[(ends, to)]);
            if to > ends + late && clear.total() - clear.common(&hidden) > late {
                let text = format!("the pump, opened at {}, is open until {}", seconds(open), seconds(to));
                self.verdict.finding(Rule::Pump, ends + late, text);
                return;
            }
        }
    }
}
