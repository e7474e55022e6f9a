//! The run of somebody who looks on: fast where little happens, in real time where much does.

use super::desk::Stage;
use super::sample::Sample;

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
    /// The speed for what happens now.
    pub fn speed(&mut self, samples: &[Sample]) -> u32 {
        let all = |stages: &[Stage]| samples.iter().all(|sample| stages.contains(&sample.stage));
        if samples.iter().any(|sample| sample.stage == Stage::Played) {
            return FLYING;
        }
        self.all_ran |= !samples.iter().any(|sample| matches!(sample.stage, Stage::Standby | Stage::Start));
        if all(&[Stage::Cooling, Stage::Done, Stage::Failed]) {
            COOLING
        } else if self.all_ran {
            FLYING
        } else {
            STARTING
        }
    }
}
