//! The rules of docs/failsafe.md, tested with unusual sequences of commands, reports, gaps and resets. Each test cites its rule.

mod any_sequence;
mod demands;
mod doubt;
mod gaps;
mod lives;
mod losses_over_resets;
mod pump;
mod pwm;
mod sources;
mod starts;

use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::ecu::{Service, amt, zk};
use jetlink::engine::Engine;
use jetlink::event::{End, Event};
use jetlink::report::NotSent;
use jetlink::telemetry::Telemetry;
use jetlink::units::Throttle;

use crate::support::frames::{amt as amt_frames, zk as zk_frames};
use crate::support::scenario::{
    BOTH, COMMAND_PERIOD_US, Ecu, FRAME_PERIOD_US, Reports, SECOND, Scenario, TURNING, Wire, percent, rpm,
    run,
};
use bench::by_hand::{at_us, micros};

/// Runs at this throttle under RC; nothing is left from before.
fn flying(ecu: Ecu, percents: u8) -> Scenario {
    let mut scenario = Scenario::started(ecu, percent(percents));
    scenario.values.half_percents = percents * 2;
    let _ = scenario.command(run(percents));
    scenario.pass_us(2 * FRAME_PERIOD_US);
    let _ = scenario.command(run(percents));
    scenario.sent();
    scenario.bench.events();
    scenario
}

fn receive(scenario: &mut Scenario, frame: &[u8]) {
    scenario.silent().pass_us(FRAME_PERIOD_US);
    scenario.bench.receive(frame);
}

/// Two sources send their commands every 0.1 s.
fn both(scenario: &mut Scenario, commands: &[(Command, Origin)], micros: u64) {
    let end = scenario.now_us() + micros;
    while scenario.now_us() < end {
        for (command, origin) in commands {
            let _ = scenario.command_from(*command, *origin);
        }
        let next = (scenario.now_us() + COMMAND_PERIOD_US).min(end);
        scenario.run_to_us(next);
    }
}

/// A ZK ECU that sends the whole cycle of its IDs.
fn zk_cycle(scenario: &mut Scenario, state: u8, shaft: u32, throttle_percent: u8, micros: u64) {
    scenario.silent();
    let end = scenario.now_us() + micros;
    let mut n = 0;
    while scenario.now_us() < end {
        scenario.pass_us(FRAME_PERIOD_US);
        let frame = match n % 5 {
            0 | 2 => zk_frames::status(1, shaft, [state, 2 << 5, 76]),
            1 => zk_frames::status(6, shaft, [160, 0, 5 << 2]),
            3 => zk_frames::status(3, shaft, [throttle_percent, 0, 0]),
            _ => zk_frames::status(8, shaft, [5, 0, 0]),
        };
        scenario.bench.receive(&frame);
        n += 1;
    }
}

fn runs_in(sent: &[Wire]) -> Vec<u16> {
    sent.iter().filter_map(|wire| if let Wire::Run(tenths) = wire { Some(*tenths) } else { None }).collect()
}

fn action(action: zk::codec::Action) -> Command {
    Command::Service(Service::Zk(zk::config::Service::Action(action)))
}
