//! The conversation with a ZK ECU as tables of time, input and output. Times are in microseconds.

mod doubt;
mod emergency_stop;
mod modes;
mod pressure;
mod random_schedules;
mod reports;
mod send_slots;
mod services;
mod starting;
mod status_rate;
mod versions;

use jetlink::command::{Command, Demand, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::config::Service as AmtService;
use jetlink::ecu::zk::codec::{AccelerationCurve, Action, IgnitionPumpVoltage, Rate, StatusFrame, Version};
use jetlink::ecu::zk::config::{Config, Service as ZkService};
use jetlink::ecu::zk::link::ZkLink;
use jetlink::ecu::{Faults, Service};
use jetlink::engine::Engine;
use jetlink::engine::retained::RetainedState;
use jetlink::event::Event;
use jetlink::line::{Line, LineError};
use jetlink::link::{Link, Observation, Stage};
use jetlink::report::{LinkState, NotSent, Phase, ReportedSwitch};
use jetlink::units::{Hectopascals, Millivolts, Rpm, Throttle};
use proptest::prelude::*;

use crate::support::frames::zk;
use bench::by_hand::{Bench, BenchEngine, at_us};

/// SW of control IDs 1 and 6.
const PWM: u8 = 0;

const STOP: u8 = 1;
const STANDBY: u8 = 2;
const RUN: u8 = 3;

/// Engine states of the document's appendix.
const STATE_STOP: u8 = 0;

const STATE_STANDBY: u8 = 1;
const STATE_IGNITION: u8 = 3;
const STATE_RUNNING: u8 = 11;
const STATE_UNKNOWN: u8 = 25;

/// One send slot at 20 Hz.
const SEND_SLOT_US: u64 = 50_000;

const LINE: Line = Line::new(9600);

fn link(config: Config, line: Line) -> Bench<ZkLink> {
    Bench::new(ZkLink::new(config, line, Config::TIMING), line)
}

/// An ECU of a version with a maximum of 160 000 rpm, at the wanted rate, in standby.
fn ecu(version: u8) -> Bench<ZkLink> {
    ecu_with(Config::DEFAULT, version, 160)
}

fn ecu_with(config: Config, version: u8, max_rpm_thousands: u8) -> Bench<ZkLink> {
    let mut bench = link(config, LINE);
    for _ in 0..2 {
        bench.receive(&zk::identity(max_rpm_thousands, version, rate_code(config.rate)));
    }
    bench.receive(&zk::state(STATE_STANDBY));
    bench.run_to_us(10_000);
    bench.frames();
    bench.events();
    bench
}

/// The same with an engine that runs, and was ordered to standby before.
fn running(version: u8) -> Bench<ZkLink> {
    let mut bench = ecu(version);
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    runs(&mut bench);
    bench
}

/// The ECU reports a running engine, twice.
fn runs(bench: &mut Bench<ZkLink>) {
    for _ in 0..2 {
        bench.receive(&zk::state(STATE_RUNNING));
    }
}

/// A fresh link that meets an engine that runs: it knows the version, and nothing of ID 6.
fn met_running(version: u8) -> Bench<ZkLink> {
    let mut bench = ecu(version);
    runs(&mut bench);
    bench
}

fn rate_code(rate: Rate) -> u8 {
    match rate {
        Rate::Hz20 => 0,
        Rate::Hz50 => 1,
        Rate::Hz100 => 2,
    }
}

fn throttle_tenths(tenths: u16) -> Order {
    Order::Run(Demand::Throttle(Throttle::from_tenths(tenths).unwrap()))
}

fn rpm(rpm: u32) -> Order {
    Order::Run(Demand::Rpm(Rpm::new(rpm)))
}

fn action(action: Action) -> Service {
    Service::Zk(ZkService::Action(action))
}

fn curve(curve: u8) -> Service {
    Service::Zk(ZkService::Curve(AccelerationCurve::new(curve).unwrap()))
}

fn ignition(millivolts: u32) -> Service {
    let voltage = IgnitionPumpVoltage::from_millivolts(Millivolts::new(millivolts)).unwrap();
    Service::Zk(ZkService::IgnitionPump(voltage))
}

fn service(bench: &mut Bench<ZkLink>, service: Service) -> Result<(), Rejected> {
    bench.act(|link, now| link.service(now, service))
}

fn pressure(bench: &mut Bench<ZkLink>, hectopascals: u16) {
    bench.act(|link, now| link.pressure(now, Hectopascals::new(hectopascals).unwrap()));
}

/// The bytes sent in the next slots, while the ECU is received and reports nothing about its engine.
fn slots(bench: &mut Bench<ZkLink>, count: usize) -> Vec<Vec<u8>> {
    bench.frames();
    while bench.waiting_frames() < count {
        received_to(bench, bench.now_us() + 5_000);
    }
    let mut bytes = bench.bytes();
    bytes.truncate(count);
    bytes
}

/// Time passes, and the ECU is received: it reports its temperature.
fn received_to(bench: &mut Bench<ZkLink>, to_us: u64) {
    while bench.now_us() < to_us {
        let next = (bench.now_us() / SEND_SLOT_US + 1) * SEND_SLOT_US;
        if next > to_us {
            break;
        }
        bench.rx_at_us(next, &zk::status(9, 0, [76, 0, 0]));
    }
    bench.run_to_us(to_us);
}

fn id(frame: &[u8]) -> u8 {
    frame[1] >> 4
}

fn ids(frames: &[Vec<u8>]) -> Vec<u8> {
    frames.iter().map(|frame| id(frame)).collect()
}

/// How an ECU handles frames, by chapter 3 and the notes to IDs 1, 6 and 7 of the document.
#[derive(Clone, Debug, Default)]
struct SimpleEcu {
    id1: (u8, u16),
    id6: (u8, u8),
    code: u32,
    target_rpm: u32,
    /// It takes an rpm only while RPM_X is in force.
    ignores_early_rpm: bool,
}

impl SimpleEcu {
    fn obey(&mut self, frame: &[u8]) {
        match id(frame) {
            1 => self.id1 = (frame[1] >> 2 & 3, u16::from(frame[1] & 3) << 8 | u16::from(frame[2])),
            6 => self.id6 = (frame[2] >> 2, frame[2] & 3),
            7 if self.ignores_early_rpm && self.id6.0 == 0 => {}
            7 => self.code = u32::from(frame[1] & 0x0F) << 8 | u32::from(frame[2]),
            _ => {}
        }
        self.target_rpm = self.code * u32::from(self.id6.0) * 10;
    }

    /// Switch, target rpm in mode 3, throttle in modes 1 and 2.
    fn obeyed(&self) -> (u8, Option<u32>, Option<u16>) {
        match self.id6 {
            (0, 0) => (self.id1.0, None, Some(self.id1.1)),
            (0, switch) => (switch, None, Some(self.id1.1)),
            (_, switch) => (switch, Some(self.target_rpm), None),
        }
    }
}

fn expected(order: Order) -> (u8, Option<u32>, Option<u16>) {
    match order {
        Order::EmergencyStop => (STOP, None, Some(0)),
        Order::Standby => (STANDBY, None, Some(0)),
        Order::Pwm => (PWM, None, Some(0)),
        Order::Run(Demand::Throttle(throttle)) => (RUN, None, Some(throttle.tenths())),
        Order::Run(Demand::Rpm(rpm)) => (RUN, Some(rpm.get() / 40 * 40), None),
        Order::Listen | Order::Doubt(_) => panic!("nothing ordered, nothing expected"),
    }
}

#[derive(Clone, Debug)]
enum Step {
    Status([u8; 7]),
    Noise(Vec<u8>),
    Order(Order),
    Service(Service),
    Pressure(u16),
    /// A wake-up before or after the deadline.
    Timeout,
    /// No wake-up for this time.
    Asleep(u64),
}

fn switch_of(frame: &[u8]) -> Option<u8> {
    match id(frame) {
        1 => Some(frame[1] >> 2 & 3),
        6 => Some(frame[2] & 3),
        _ => None,
    }
}
