//! One life, one start: what a report means for a run, who may start, what takes two commands, what continues over a reset. As
//! tables, for both ECUs, to the tick where the rule has a time.

mod abandoned_orders;
mod error_sets;
mod forgotten;
mod lives;
mod memory;
mod power_lost;
mod records;
mod resets;
mod sources;
mod start_faults;
mod start_permission;

use embassy_time::Duration;
use jetlink::command::{Accepted, Command, Demand, Interlock, Order, Origin, Rejected};
use jetlink::ecu::EcuConfig;
use jetlink::engine::Engine;
use jetlink::engine::retained::{Reset, RetainedMemory, RetainedState};
use jetlink::event::{End, Event, LossStage};
use jetlink::limit::LimitKind;
use jetlink::limit::{Action, Limit};
use jetlink::line::LineError;
use jetlink::units::{Celsius, Rpm};

use crate::support::frames::{amt as amt_frames, zk as zk_frames};
use crate::support::scenario::{
    BOTH, COMMAND_PERIOD_US, Ecu, FRAME_PERIOD_US, Reports, SECOND, Scenario, TURNING, Values, Wire, percent,
    rpm, run,
};
use bench::by_hand::{at_us, micros};

/// RC's timeout, and for how long a demand is held after it.
const SOURCE_TIMEOUT_US: u64 = 500_000;

const HOLD_US: u64 = SECOND;

/// Time from the beginning of the fail-safe stage to the end of an order to run without a living engine.
const RUN_OUT_US: u64 = 10 * SECOND;

/// Below half of the idle speed of either engine.
const SLOW: u32 = 2_000;

/// Three expected frames: 20 Hz, and about eight sets a second.
fn gap(ecu: Ecu) -> u64 {
    match ecu {
        Ecu::Amt => 375_000,
        Ecu::Zk => 150_000,
    }
}

/// A report of a state, as the ECU numbers it, with the switch at run.
fn report(ecu: Ecu, state: u8, rpm: u32) -> Vec<u8> {
    match ecu {
        Ecu::Amt => amt_frames::normal(state, amt_frames::RUN, u8::try_from(rpm / 500).unwrap()).to_vec(),
        Ecu::Zk => zk_frames::status(1, rpm, [state, 2 << 5, 76]).to_vec(),
    }
}

/// The next frame is this one.
fn receive(scenario: &mut Scenario, frame: &[u8]) {
    scenario.silent().pass_us(FRAME_PERIOD_US);
    scenario.bench.receive(frame);
}

/// Runs at 50 % under RC; earlier frames and events are dropped.
fn flying(ecu: Ecu) -> Scenario {
    let mut scenario = Scenario::started(ecu, percent(50));
    scenario.sent();
    scenario.bench.events();
    scenario
}

fn ends(scenario: &mut Scenario) -> Vec<End> {
    let events = scenario.bench.event_kinds().into_iter();
    events.filter_map(|event| if let Event::RunCancelled(end) = event { Some(end) } else { None }).collect()
}

fn stages(scenario: &mut Scenario) -> Vec<(u64, LossStage)> {
    let events = scenario.bench.events().into_iter();
    events
        .filter_map(|(at, event)| if let Event::SourceLoss(stage) = event { Some((at, stage)) } else { None })
        .collect()
}

type Step = fn(&mut Scenario);

/// The exhaust at a time in µs, in °C.
type Egt = fn(u64) -> i32;

/// Flies with error sets; the exhaust is at `egt` of the time in µs since they began.
fn with_faults(micros: u64, fault: u8, demand: Command, egt: impl Fn(u64) -> i32) -> Scenario {
    let mut scenario = flying(Ecu::Amt);
    // It warms up as an exhaust does.
    for i in 1..=40 {
        scenario.values.egt_celsius = 26 + (egt(0) - 26) * i / 40;
        let _ = scenario.command(run(50));
        scenario.pass_us(FRAME_PERIOD_US);
    }
    scenario.values.fault = fault;
    scenario.command(demand).unwrap();
    let from = scenario.now_us();
    while scenario.now_us() < from + micros {
        scenario.values.egt_celsius = egt(scenario.now_us() - from);
        let _ = scenario.command(demand);
        scenario.pass_us(FRAME_PERIOD_US);
    }
    scenario
}

/// The states that a start and a flight have in common, and one that no document names.
const COMMON_STATES: [u8; 4] = [0b00010, 0b00100, 0b01000, 0b11111];

fn receive_faults(scenario: &mut Scenario, egt_celsius: i32) {
    scenario.values = Values { fault: 0b110, half_percents: 100, egt_celsius, rpm: None };
    let frame = scenario.ecu.frame(Reports::Running, scenario.values);
    receive(scenario, &frame);
}

fn runs(scenario: &mut Scenario) -> usize {
    scenario.sent().iter().filter(|wire| matches!(wire, Wire::Run(_))).count()
}

/// Receives sets with this state and a throttle, under a source that commands run, and returns the highest run that was answered, in 0.1 %.
fn highest(scenario: &mut Scenario, state: u8, half_percents: u8) -> Option<u16> {
    scenario.sent();
    for _ in 0..200 {
        let _ = scenario.command(run(90));
        let mut frame = report(Ecu::Amt, state, TURNING);
        frame[4] = half_percents;
        receive(scenario, &frame);
    }
    let runs = scenario.sent().into_iter();
    runs.filter_map(|wire| if let Wire::Run(tenths) = wire { Some(tenths) } else { None }).max()
}

/// The same engine after a reset, with what such a reset leaves of its record.
fn after(scenario: &Scenario, reset: Reset) -> Scenario {
    let record = scenario.bench.machine.record();
    let record = if reset == Reset::Warm { record } else { record.without_start() };
    let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), Some(record));
    scenario.silent();
    scenario
}
