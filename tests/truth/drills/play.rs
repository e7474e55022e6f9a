//! Plays one drill after the other.

use super::{Director, Step};
use crate::acts::{Act, Blow};
use crate::history::{Cause, MS};
use crate::pilots::{Rng, View};
use sim::turbine::Phase;

/// A reset by the watchdog that takes this time.
const fn of(down: u64) -> Blow {
    Blow { at: 0, down, cause: Cause::Watchdog, with_ecu: false, other_settings: false, other_engine: false }
}

impl Director {
    /// What happens now, and notes for the log.
    pub fn play(&mut self, rng: &mut Rng, view: &View) -> (Vec<Act>, Vec<String>) {
        let (mut acts, mut notes) = (Vec::new(), Vec::new());
        loop {
            if view.now < self.until && !self.waits.is_some_and(|condition| condition.holds(view)) {
                break;
            }
            (self.waits, self.until) = (None, 0);
            let Some(step) = self.steps.pop_front() else {
                let (name, steps) = self.drill(rng, view);
                notes.push(format!("drill: {name}"));
                self.steps.extend(steps);
                continue;
            };
            match step {
                Step::Act(act) => acts.push(act),
                Step::Wait(time) => self.until = view.now + time,
                Step::Until(condition, time) => {
                    (self.waits, self.until) = (Some(condition), view.now + time);
                }
                Step::Next(time) => self.until = (view.now / time + 1) * time,
                Step::Reset(cause, down) => self.reset(view.now, Blow { cause, ..of(down) }),
                Step::AnotherEngine(down) => {
                    self.reset(view.now, Blow { other_engine: true, ..of(down) });
                }
                Step::OtherSettings(down) => {
                    self.reset(view.now, Blow { other_settings: true, ..of(down) });
                }
            }
        }
        self.next = if self.waits.is_some() { self.until.min(view.now + 50 * MS) } else { self.until };
        (acts, notes)
    }

    fn reset(&mut self, now: u64, blow: Blow) {
        self.blow = Some(Blow { at: now, ..blow });
        // Until the next sample, with the node down.
        self.until = now + 60 * MS + blow.down;
    }

    /// The next drill, by the state of the engine.
    fn drill(&mut self, rng: &mut Rng, view: &View) -> (&'static str, Vec<Step>) {
        if view.phase == Phase::Running && self.left > 0 {
            self.left -= 1;
            self.stick = self.demand(rng, view);
            let (name, steps) = self.in_flight(rng);
            return (name, [self.fly(rng), steps, self.recover()].concat());
        }
        let (name, steps) = match view.phase {
            // It runs, but no source flies it.
            phase if phase.is_live() => ("shutdown", Vec::new()),
            _ if rng.percent(35) => self.at_rest(rng),
            _ => ("", Vec::new()),
        };
        self.main = if rng.percent(20) { rng.below(4) as usize } else { self.main };
        self.left = rng.between(2, 8);
        let down = self.shut_down(rng);
        let (start, begin) = self.start(rng);
        (if name.is_empty() { start } else { name }, [down, steps, begin, self.recover()].concat())
    }
}
