//! The speed of a run that a person watches: fast where little happens, in real time where much does.

use super::context::Stage;

/// While the engines start, one after the other.
const STARTING: u32 = 4;
/// While they fly.
const FLYING: u32 = 1;
/// While they cool.
const COOLING: u32 = 10;

/// Chooses the speed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tour {
    all_ran: bool,
}

impl Tour {
    /// The speed for the present stages of the engines' pilots.
    pub fn speed(&mut self, stages: &[Stage]) -> u32 {
        let all = |of: &[Stage]| stages.iter().all(|stage| of.contains(stage));
        if stages.contains(&Stage::Played) {
            return FLYING;
        }
        self.all_ran |= !stages.iter().any(|stage| matches!(stage, Stage::Standby | Stage::Start));
        if all(&[Stage::Cooling, Stage::Done, Stage::Failed]) {
            COOLING
        } else if self.all_ran {
            FLYING
        } else {
            STARTING
        }
    }
}
