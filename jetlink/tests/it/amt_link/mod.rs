//! The conversation with an AMT ECU as tables of time, input and output. Times are in microseconds; the time of
//! a frame is that of its last stop bit.

mod link_state;
mod orders;
mod random_schedules;
mod reply;
mod reports;

use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::{EngineModel, ErrorBits};
use jetlink::ecu::amt::config::{Config, REPLY_WINDOW, Service as AmtService};
use jetlink::ecu::amt::link::AmtLink;
use jetlink::ecu::zk::config::Service as ZkService;
use jetlink::ecu::{EcuConfig, Faults, Service, zk};
use jetlink::engine::Engine;
use jetlink::engine::retained::RetainedState;
use jetlink::event::Event;
use jetlink::line::{Line, LineError, Timing};
use jetlink::link::{Link, Observation, Output, Stage};
use jetlink::report::{LinkState, NotSent, Phase, ReportedSwitch};
use jetlink::units::{Celsius, Rpm, Throttle};
use proptest::prelude::*;

use crate::support::frames::amt::{
    AUTO_STOP, CLEARANCE, EMERGENCY, FULL_OPERATION, IDLE_CALIBRATION, NO_CLEARANCE, RUN, STARTED_UP,
    STARTING, alternate, control, error, normal, setup,
};
use bench::by_hand::{Bench, BenchEngine, Machine, at_us, micros};

const STOP_OPS: u8 = 0x11;
const AUTO_OPS: u8 = 0x12;
const RUN_OPS: u8 = 0x14;
const CTF_OPS: u8 = 0x91;

/// Between two frames: 8 a second at 2400 baud.
const FRAME_PERIOD_US: u64 = 125_000;

const SLOW: Line = Line::new(2400);

/// Standby is ordered.
fn amt(config: Config, line: Line) -> Bench<AmtLink> {
    let mut bench = Bench::new(AmtLink::new(config, line, Config::TIMING), line);
    bench.order_at_us(0, Order::Standby).unwrap();
    bench
}

fn default() -> Bench<AmtLink> {
    amt(Config::DEFAULT, SLOW)
}

fn throttle_tenths(tenths: u16) -> Order {
    Order::Run(Demand::Throttle(Throttle::from_tenths(tenths).unwrap()))
}

fn ctf() -> Service {
    Service::Amt(AmtService::Ctf)
}

/// A frame now, and the bytes of its reply.
fn reply_to<M: Machine>(bench: &mut Bench<M>, frame: &[u8]) -> Vec<u8> {
    answer_to(bench, frame).unwrap_or_else(|| panic!("a reply at {}", bench.now_us()))
}

/// A frame now, and the bytes of its reply, if there is one.
fn answer_to<M: Machine>(bench: &mut Bench<M>, frame: &[u8]) -> Option<Vec<u8>> {
    let t = bench.now_us() + FRAME_PERIOD_US;
    bench.run_to_us(t);
    bench.frames();
    bench.receive(frame);
    let mut frames = bench.frames();
    assert!(frames.len() <= 1, "one reply at {t}: {frames:02x?}");
    let (at, bytes) = frames.pop()?;
    assert_eq!(at, t, "at once");
    Some(bytes)
}

/// The OPS and THR (in half percents) of the reply to a frame.
fn ops_thr<M: Machine>(bench: &mut Bench<M>, frame: &[u8]) -> (u8, u8) {
    read_control(&reply_to(bench, frame))
}

/// The same, if there is a reply.
fn answer<M: Machine>(bench: &mut Bench<M>, frame: &[u8]) -> Option<(u8, u8)> {
    answer_to(bench, frame).map(|bytes| read_control(&bytes))
}

fn read_control(bytes: &[u8]) -> (u8, u8) {
    let (ops, half_percents) = (bytes[1], bytes[2] - 32);
    assert_eq!(bytes, control(ops, half_percents));
    (ops, half_percents)
}

/// The demand is released, and the phase is known.
fn running() -> Bench<AmtLink> {
    let mut bench = default();
    bench.order_at_us(0, throttle_tenths(800)).unwrap();
    for _ in 0..2 {
        reply_to(&mut bench, &normal(FULL_OPERATION, RUN, 100));
    }
    bench.act(|link, _| link.release(true));
    bench.event_kinds();
    bench
}

/// The same frame with a hot exhaust: 140 × 4.6 − 50 = 594 °C (AMT-7).
fn hot<const N: usize>(mut frame: [u8; N]) -> [u8; N] {
    frame[3] = 140;
    frame
}

/// The supervision on top of the link, after a reset with what was retained.
fn engine_after(config: Config, record: Option<RetainedState>) -> Bench<BenchEngine> {
    let mut engine = EngineConfig::amt("a", 0, SLOW, Some(EngineModel::Olympus));
    engine.ecu = EcuConfig::Amt(config);
    let mut bench = Bench::engine(&engine);
    if record.is_some() {
        *bench.machine = Engine::new(&engine);
        bench.act(|engine, now| {
            engine.restore(record);
            Engine::start(engine, now);
        });
    }
    bench
}

fn command(bench: &mut Bench<BenchEngine>, command: Command) -> Result<Accepted, Rejected> {
    bench.act(|engine, now| engine.command(now, command, Origin::Rc, true))
}

fn run_at_tenths(tenths: u16) -> Command {
    Command::Run(Demand::Throttle(Throttle::from_tenths(tenths).unwrap()))
}

/// Ordered to start by a person who commanded this throttle right after it.
fn started(config: Config, tenths: u16) -> Bench<BenchEngine> {
    let mut bench = engine_after(config, Some(RetainedState::new(Order::Standby, Origin::Rc)));
    for _ in 0..16 {
        assert_eq!(ops_thr(&mut bench, &normal(CLEARANCE, AUTO_STOP, 0)), (AUTO_OPS, 0));
    }
    command(&mut bench, Command::Arm).unwrap();
    command(&mut bench, Command::Standby).unwrap();
    assert_eq!(command(&mut bench, run_at_tenths(0)), Ok(Accepted::InForce));
    command(&mut bench, run_at_tenths(tenths)).unwrap();
    bench
}

/// A frame while its source is fresh, and its reply.
fn flown(bench: &mut Bench<BenchEngine>, tenths: u16, frame: &[u8]) -> Option<(u8, u8)> {
    let _ = command(bench, run_at_tenths(tenths));
    answer(bench, frame)
}

/// Running at 80 %, commanded.
fn flying() -> Bench<BenchEngine> {
    let mut bench = started(Config::DEFAULT, 800);
    for (state, rpm) in [(STARTING, 10), (STARTED_UP, 30)] {
        for _ in 0..2 {
            assert_eq!(flown(&mut bench, 800, &hot(normal(state, RUN, rpm))), Some((RUN_OPS, 0)));
        }
    }
    for _ in 0..16 {
        flown(&mut bench, 800, &hot(normal(FULL_OPERATION, RUN, 100)));
    }
    assert_eq!(flown(&mut bench, 800, &hot(normal(FULL_OPERATION, RUN, 100))), Some((RUN_OPS, 160)));
    bench
}

#[derive(Clone, Debug)]
enum Step {
    Frame(Vec<u8>),
    Noise(Vec<u8>),
    Order(Order),
    Ctf,
    Timeout,
}
