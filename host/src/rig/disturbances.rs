//! Deliberate faults on an engine's line: by hand, by `--faults`, in a scenario. A wire cut by one of them stays cut until all
//! have joined it again; and a fault excuses its effects when a played run is judged.

use super::faults::Faults;
use super::play::action::Fault;
use embassy_time::{Duration, Instant};
use sim::wire::{Direction, Faults as LineFaults};

/// Longest time after the end of a fault for which the node may be in doubt, and withhold replies.
pub const DOUBT: Duration = Duration::from_secs(12);

/// Who causes a fault.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum By {
    /// A key, or a script file.
    Hand,
    /// `--faults`.
    Plan,
    /// A scenario.
    Scenario,
    /// The node itself is away.
    Node,
}

/// The faults of one engine's line.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Disturbances {
    /// The present faults.
    lasting: Vec<(By, Fault)>,
    /// Time until which earlier faults may explain effects.
    explained_until: Option<Instant>,
    /// Effect of `--faults` on a line.
    planned: LineFaults,
}

impl Disturbances {
    /// A fault begins or ends. False: it is already present, or not present.
    pub fn set(&mut self, at: Instant, by: By, fault: Fault, begins: bool) -> bool {
        let place = self.lasting.iter().position(|&other| other == (by, fault));
        match (place, begins) {
            (None, true) => self.lasting.push((by, fault)),
            (Some(place), false) => {
                self.lasting.remove(place);
                self.happens(at);
            }
            (Some(_), true) | (None, false) => return false,
        }
        true
    }

    /// Effect of `--faults` on a line, from now on.
    pub fn plan(&mut self, at: Instant, line: LineFaults) {
        self.planned = line;
        self.set(at, By::Plan, Fault::Noise, line != LineFaults::default());
    }

    /// Something goes wrong once.
    pub fn happens(&mut self, at: Instant) {
        self.explained_until = self.explained_until.max(Some(at + DOUBT));
    }

    /// Whether a fault explains a miss now.
    pub fn explain(&self, at: Instant) -> bool {
        !self.lasting.is_empty() || self.explained_until.is_some_and(|until| at <= until)
    }

    /// Whether somebody has cut this wire.
    pub fn is_cut(&self, direction: Direction) -> bool {
        let one = match direction {
            Direction::ToEcu => Fault::CutToEcu,
            Direction::ToNode => Fault::CutToNode,
        };
        self.lasting.iter().any(|&(_, fault)| fault == Fault::Cut || fault == one)
    }

    /// Random faults: those by hand exceed any plan.
    pub fn line(&self) -> LineFaults {
        if self.lasting.contains(&(By::Hand, Fault::Noise)) { Faults::heavy() } else { self.planned }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: u64) -> Instant {
        Instant::MIN + Duration::from_secs(seconds)
    }

    #[test]
    fn a_fault_explains_while_it_lasts_and_for_as_long_as_the_node_may_be_in_doubt() {
        let mut all = Disturbances::default();
        assert!(!all.explain(at(1)));
        all.set(at(1), By::Hand, Fault::Cut, true);
        // Begun twice, and ended once: it has ended.
        all.set(at(2), By::Hand, Fault::Cut, true);
        assert!(all.explain(at(100)));
        all.set(at(100), By::Hand, Fault::Cut, false);
        assert!(all.explain(at(112)) && !all.explain(at(113)));
        // A fault that is not present cannot end.
        all.set(at(200), By::Hand, Fault::Noise, false);
        all.set(at(200), By::Scenario, Fault::Cut, false);
        assert!(!all.explain(at(200)));
        all.happens(at(300));
        assert!(all.explain(at(301)) && !all.explain(at(313)));
    }

    #[test]
    fn a_wire_is_joined_when_nobody_cuts_it_any_more() {
        let mut all = Disturbances::default();
        let cut = |all: &Disturbances| (all.is_cut(Direction::ToEcu), all.is_cut(Direction::ToNode));
        all.set(at(1), By::Plan, Fault::Cut, true);
        all.set(at(2), By::Hand, Fault::CutToEcu, true);
        assert_eq!(cut(&all), (true, true));
        all.set(at(3), By::Plan, Fault::Cut, false);
        assert_eq!(cut(&all), (true, false));
        all.set(at(4), By::Hand, Fault::CutToEcu, false);
        assert_eq!(cut(&all), (false, false));
    }

    #[test]
    fn noise_by_hand_leaves_what_was_planned() {
        let mut all = Disturbances::default();
        let planned = LineFaults { lose_per_million: 5, ..LineFaults::default() };
        all.plan(at(1), planned);
        all.set(at(2), By::Hand, Fault::Noise, true);
        assert_eq!(all.line(), Faults::heavy());
        all.set(at(3), By::Hand, Fault::Noise, false);
        assert_eq!(all.line(), planned);
        all.plan(at(4), LineFaults::default());
        assert_eq!(all.line(), LineFaults::default());
        assert!(all.explain(at(16)) && !all.explain(at(17)));
    }
}
