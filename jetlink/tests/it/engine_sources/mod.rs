//! Arbitration, take-overs, and the stages of loss without a source. For both ECUs, exact to the tick.

mod arbitration;
mod loss;
mod silence;
mod slew;

use embassy_time::Duration;
use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::ecu::{Service, amt, zk};
use jetlink::engine::Loss;
use jetlink::event::{Event, LossStage};
use jetlink::limit::{Action, Limit};
use jetlink::report::LinkState;
use jetlink::units::{Celsius, Throttle};

use crate::support::frames::zk as zk_frames;
use crate::support::scenario::{
    BOTH, COMMAND_PERIOD_US, Ecu, FRAME_PERIOD_US, Reports, SECOND, Scenario, TURNING, Wire, ZK_IDLE, ZK_MAX,
    percent, rpm, run, tenths,
};
use bench::by_hand::{at_us, micros};

/// RC's timeout.
const SOURCE_TIMEOUT_US: u64 = 500_000;

fn stages(scenario: &mut Scenario) -> Vec<(u64, LossStage)> {
    scenario
        .bench
        .events()
        .into_iter()
        .filter_map(|(at, event)| if let Event::SourceLoss(stage) = event { Some((at, stage)) } else { None })
        .collect()
}

fn active_sources(scenario: &mut Scenario) -> Vec<(u64, Origin)> {
    scenario
        .bench
        .events()
        .into_iter()
        .filter_map(
            |(at, event)| if let Event::ActiveSource(origin) = event { Some((at, origin)) } else { None },
        )
        .collect()
}
