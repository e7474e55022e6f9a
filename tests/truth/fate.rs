//! When and why the node is reset.

use crate::acts::Blow;
use crate::context::{EngineContext, now};
use crate::faults::Weather;
use crate::history::{Cause, MS, SECOND};
use crate::pilots::Rng;
use std::collections::VecDeque;

/// Resets and other events of the node itself.
#[derive(Debug)]
pub enum Fate {
    Random(Random),
    Script(VecDeque<Blow>),
    /// What the engines' drills require of the node.
    Drills,
}

#[derive(Debug)]
pub struct Random {
    weather: Weather,
    next: u64,
    /// Resets that still follow, and the time for which the node runs between them.
    loop_left: u64,
    loop_period: u64,
    /// All pilots of an engine are silent, or its ECU reports a fault, and this has been considered.
    in_trouble: bool,
}

impl Fate {
    pub fn random(rng: &mut Rng, weather: Weather) -> Self {
        let next = rng.wait(weather.between_faults());
        Self::Random(Random { weather, next, loop_left: 0, loop_period: 0, in_trouble: false })
    }

    /// The next reset; `None` if there is none.
    pub fn next(&mut self, rng: &mut Rng) -> Option<Blow> {
        match self {
            Self::Random(random) => Some(random.next(rng)),
            Self::Script(blows) => blows.pop_front(),
            Self::Drills => None,
        }
    }

    /// An earlier reset, because of an event at an engine.
    pub fn sooner(&mut self, rng: &mut Rng, contexts: &mut [EngineContext], than: u64) -> Option<Blow> {
        match self {
            Self::Random(random) => random.in_trouble(rng, contexts, than),
            Self::Script(_) => None,
            Self::Drills => contexts.iter_mut().find_map(EngineContext::blow),
        }
    }
}

fn down(rng: &mut Rng, cause: Cause) -> u64 {
    match cause {
        Cause::Watchdog if rng.percent(50) => rng.spread(5 * MS, 100 * MS),
        Cause::Watchdog => rng.spread(5 * MS, 1200 * MS),
        _ if rng.percent(10) => rng.spread(20 * MS, 100 * SECOND),
        _ => rng.spread(20 * MS, 3 * SECOND),
    }
}

impl Random {
    fn blow(&self, rng: &mut Rng, at: u64, cause: Cause) -> Blow {
        let with_ecu = cause != Cause::Watchdog && rng.percent(40);
        Blow {
            at,
            down: down(rng, cause),
            cause,
            with_ecu,
            other_settings: rng.percent(10),
            other_engine: rng.percent(3),
        }
    }

    /// Resets come often when all pilots of a running engine are silent, or its ECU reports a fault: the one causes the
    /// other.
    fn in_trouble(&mut self, rng: &mut Rng, contexts: &[EngineContext], than: u64) -> Option<Blow> {
        let at = now();
        let silent =
            contexts.iter().any(|context| context.is_live() && context.silent_until() > at + 2 * SECOND);
        let faulty = contexts.iter().any(EngineContext::runs_with_a_fault);
        let trouble = silent || faulty;
        if core::mem::replace(&mut self.in_trouble, trouble) || !trouble || !rng.percent(30) {
            return None;
        }
        if faulty && rng.percent(70) {
            // The supply is low: the node goes down, too, but not the ECU.
            let at = at + rng.spread(500 * MS, 10 * SECOND);
            let down = rng.spread(20 * MS, SECOND);
            let blow = Blow { with_ecu: false, down, ..self.blow(rng, at, Cause::BrownOut) };
            return (at < than).then_some(blow);
        }
        let first = at + rng.spread(20 * MS, 6 * SECOND);
        if first >= than {
            return None;
        }
        self.loop_period = rng.spread(30 * MS, 8 * SECOND);
        self.loop_left = if rng.percent(50) { rng.between(0, 20) } else { 100 * SECOND / self.loop_period };
        let cause = if rng.percent(80) { Cause::Watchdog } else { Cause::BrownOut };
        Some(self.blow(rng, first, cause))
    }

    fn next(&mut self, rng: &mut Rng) -> Blow {
        if self.loop_left > 0 {
            self.loop_left -= 1;
            let at = now() + self.loop_period;
            return Blow {
                other_settings: false,
                other_engine: false,
                ..self.blow(rng, at, Cause::Watchdog)
            };
        }
        while self.next <= now() {
            self.next += rng.wait(self.weather.between_faults());
        }
        let cause = match rng.below(100) {
            0..60 => Cause::Watchdog,
            60..80 => Cause::BrownOut,
            _ => Cause::PowerOn,
        };
        if cause == Cause::Watchdog && rng.percent(25) {
            self.loop_left = rng.between(2, 40);
            self.loop_period = rng.spread(50 * MS, 8 * SECOND);
        }
        self.blow(rng, self.next, cause)
    }
}
