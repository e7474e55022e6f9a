//! The conversation with a ZK ECU as tables of time, input and output. Times are in microseconds.

use jetlink::command::{Command, Demand, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::config::Service as AmtService;
use jetlink::ecu::zk::codec::{AccelerationCurve, Action, IgnitionPumpVoltage, Rate, Version};
use jetlink::ecu::zk::config::{Config, Service as ZkService};
use jetlink::ecu::zk::link::ZkLink;
use jetlink::ecu::{Faults, Service};
use jetlink::engine::Engine;
use jetlink::engine::retained::RetainedState;
use jetlink::event::Event;
use jetlink::line::Line;
use jetlink::link::{Link, Sign, Stage};
use jetlink::report::{LinkState, NotSent, Phase, ReportedSwitch};
use jetlink::units::{Hectopascals, Millivolts, Rpm, Throttle};
use proptest::prelude::*;

use crate::support::bench::{Bench, us};
use crate::support::frames::zk;

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
/// One turn at 20 Hz.
const TURN: u64 = 50_000;
const LINE: Line = Line::new(9600);

fn link(config: Config, line: Line) -> Bench<ZkLink> {
    Bench::new(ZkLink::new(config, line, Config::TIMING), line)
}

/// An ECU of a version with a maximum of 160 000 rpm, at the rate that is wanted, in standby.
fn ecu(version: u8) -> Bench<ZkLink> {
    ecu_with(Config::DEFAULT, version, 160)
}

fn ecu_with(config: Config, version: u8, max_rpm_thousands: u8) -> Bench<ZkLink> {
    let mut bench = link(config, LINE);
    for _ in 0..2 {
        bench.receive(&zk::identity(max_rpm_thousands, version, rate_code(config.rate)));
    }
    bench.receive(&zk::state(STATE_STANDBY));
    bench.run_to(10_000);
    bench.frames();
    bench.events();
    bench
}

/// The same with an engine that runs, and was ordered to standby before.
fn running(version: u8) -> Bench<ZkLink> {
    let mut bench = ecu(version);
    bench.order(bench.now(), Order::Standby).unwrap();
    runs(&mut bench);
    bench
}

/// The ECU reports a running engine, twice, and the demand is released.
fn runs(bench: &mut Bench<ZkLink>) {
    for _ in 0..2 {
        bench.receive(&zk::state(STATE_RUNNING));
    }
    bench.act(|link, _| link.release(true));
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

fn throttle(tenths: u16) -> Order {
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

/// The bytes that go out in the next turns, while the ECU is heard and reports nothing of its engine.
fn turns(bench: &mut Bench<ZkLink>, count: usize) -> Vec<Vec<u8>> {
    bench.frames();
    while bench.waiting_frames() < count {
        heard_to(bench, bench.now() + 5_000);
    }
    let mut bytes = bench.bytes();
    bytes.truncate(count);
    bytes
}

/// Time passes, and the ECU is heard: it reports its temperature.
fn heard_to(bench: &mut Bench<ZkLink>, t: u64) {
    while bench.now() < t {
        let next = (bench.now() / TURN + 1) * TURN;
        if next > t {
            break;
        }
        bench.rx(next, &zk::status(9, 0, [76, 0, 0]));
    }
    bench.run_to(t);
}

fn id(frame: &[u8]) -> u8 {
    frame[1] >> 4
}

fn ids(frames: &[Vec<u8>]) -> Vec<u8> {
    frames.iter().map(|frame| id(frame)).collect()
}

// ---------------------------------------------------------------------------------------------
// Turns
// ---------------------------------------------------------------------------------------------

/// ZK-10: something is sent at every turn, ID 0 when nothing is ordered, also into silence. ZK-11: the turns keep
/// the status rate to the tick.
#[test]
fn zk_10_zk_11_something_goes_out_at_every_turn() {
    for (rate, every) in [(Rate::Hz20, 50_000), (Rate::Hz50, 20_000), (Rate::Hz100, 10_000)] {
        let mut bench = link(Config { rate, ..Config::DEFAULT }, LINE);
        bench.run_to(10_000_000);
        let expected: Vec<_> =
            (0..=10_000_000 / every).map(|turn| (turn * every, zk::keep_alive().to_vec())).collect();
        assert_eq!(bench.frames(), expected, "{rate:?}");
        let counters = bench.machine.counters();
        assert_eq!(counters.send_slots_missed, 0);
        assert_eq!(counters.worst_slot_delay.map(|delay| delay.as_micros()), Some(0));
    }
}

/// ZK-10: a turn that comes late is not made up for, and the beat stays.
#[test]
fn zk_10_a_late_turn_makes_no_burst() {
    // Woken so late; the next two turns are then due.
    for (late, next) in [(1, [100_000, 150_000]), (30_000, [100_000, 150_000]), (49_000, [100_000, 150_000])]
    {
        let mut bench = link(Config::DEFAULT, Line::new(115_200));
        bench.run_to(40_000);
        bench.frames();
        bench.timeout_at(TURN + late);
        bench.run_to(160_000);
        let at: Vec<u64> = bench.frames().into_iter().map(|(at, _)| at).collect();
        assert_eq!(at, [&[TURN + late][..], &next].concat(), "{late}");
        let worst = bench.machine.counters().worst_slot_delay.map(|delay| delay.as_micros());
        assert_eq!(worst, Some(late));
    }
    // After turns that are over altogether: one now, the next within one interval, none in between.
    for late in [50_000, 75_000, 1_000_000, 3_333_333] {
        let mut bench = link(Config::DEFAULT, LINE);
        bench.run_to(40_000);
        bench.frames();
        let woken = TURN + late;
        bench.timeout_at(woken);
        bench.run_to(woken + 500_000);
        let at: Vec<u64> = bench.frames().into_iter().map(|(at, _)| at).collect();
        assert_eq!(at[0], woken);
        assert!(at[1] > woken && at[1] <= woken + TURN, "{late}: {at:?}");
        assert!(at[1..].iter().all(|at| at % TURN == 0), "the beat stays: {late}: {at:?}");
        assert!(at.windows(2).skip(1).all(|pair| pair[1] - pair[0] == TURN), "{late}: {at:?}");
        assert!((10..=11).contains(&at.len()), "{late}: {at:?}");
        // Of the turns from 50 ms to the one at or before the waking, all but one are over.
        assert_eq!(u64::from(bench.machine.counters().send_slots_missed), late / TURN, "{late}");
    }
}

/// A turn while the UART is still sending is skipped and counted; the one behind it goes out.
#[test]
fn a_turn_while_the_uart_is_busy_is_skipped() {
    let mut bench = link(Config::DEFAULT, LINE).by_hand();
    bench.run_to(120_000); // the frame of turn 0 hangs
    assert_eq!(bench.frames().len(), 1);
    assert_eq!(bench.machine.counters().send_slots_missed, 2);
    bench.not_sent_at(125_000, NotSent::GaveUp);
    assert_eq!(bench.frames(), [], "not out of turn");
    bench.run_to(150_000);
    assert_eq!(bench.frames(), [(150_000, zk::keep_alive().to_vec())]);
    assert_eq!(bench.machine.counters().given_up, 1);
}

/// ZK-12: at the slowest line a frame is over before the next turn.
#[test]
fn zk_12_the_slowest_line_carries_every_turn() {
    for line in [Line::new(2400), Line::with_two_stop_bits(2400)] {
        let mut bench = link(Config::DEFAULT, line);
        bench.order(0, Order::Standby).unwrap();
        bench.run_to(10_000_000);
        assert_eq!((bench.frames().len(), bench.machine.counters().send_slots_missed), (201, 0));
    }
}

// ---------------------------------------------------------------------------------------------
// Modes
// ---------------------------------------------------------------------------------------------

/// ZK-9, mode 1: switch and throttle in ID 1. ZK-8: standby is SW 2, an emergency stop SW 1, run SW 3.
#[test]
fn zk_9_mode_1_switch_and_throttle_in_id_1() {
    let mut bench = running(3);
    for (order, sw, tenths) in [
        (Order::Standby, STANDBY, 0),
        (throttle(0), RUN, 0),
        (throttle(1), RUN, 1),
        (throttle(1000), RUN, 1000),
        (Order::Standby, STANDBY, 0),
        (Order::EmergencyStop, STOP, 0),
    ] {
        bench.order(bench.now(), order).unwrap();
        for frame in turns(&mut bench, 3) {
            assert_eq!(frame, zk::throttle(sw, tenths), "{order:?}");
        }
    }
}

/// ZK-9, mode 2: ID 6 carries the switch with RPM_X = 0 and ID 1 the throttle, in turns.
#[test]
fn zk_9_mode_2_switch_in_id_6() {
    let config = Config { split_switch: true, ..Config::DEFAULT };
    let mut bench = ecu_with(config, 4, 160);
    runs(&mut bench);
    for (order, sw, tenths) in
        [(Order::Standby, STANDBY, 0), (throttle(425), RUN, 425), (Order::EmergencyStop, STOP, 0)]
    {
        bench.order(bench.now(), order).unwrap();
        let (mode, demand) = (zk::mode(0, sw).to_vec(), zk::throttle(sw, tenths).to_vec());
        // To run, the throttle goes first: the switch must not come into force with an old one.
        let (first, second) = if sw == RUN { (demand, mode) } else { (mode, demand) };
        assert_eq!(turns(&mut bench, 4), [first.clone(), second.clone(), first, second], "{order:?}");
    }
}

/// ZK-7: mode 2 is of version 4. Before two reports agree on the version, and below 4, ID 1 carries both.
#[test]
fn zk_7_mode_2_waits_for_version_4() {
    let config = Config { split_switch: true, ..Config::DEFAULT };
    let mut bench = link(config, LINE);
    bench.order(0, Order::Standby).unwrap();
    assert_eq!(ids(&turns(&mut bench, 6)), [1; 6], "version not known");
    bench.receive(&zk::identity(160, 3, 0));
    assert_eq!(ids(&turns(&mut bench, 6)), [1; 6], "version 3");
    bench.receive(&zk::identity(160, 4, 0));
    assert_eq!(ids(&turns(&mut bench, 6)), [1; 6], "one report against another");
    bench.receive(&zk::identity(160, 4, 0));
    let ids = ids(&turns(&mut bench, 6));
    assert!(ids.contains(&6) && ids.contains(&1), "version 4: {ids:?}");
}

/// ZK-9, mode 3: ID 7 carries the rpm, ID 6 switch and RPM_X. The rpm goes first, so that the mode does not come
/// into force with an old one.
#[test]
fn zk_9_mode_3_rpm_in_id_7() {
    let mut bench = running(4);
    bench.order(bench.now(), rpm(100_000)).unwrap();
    // 160 000 rpm at most: RPM_X = 4, and 100 000 = 2500 × 4 × 10.
    let (demand, mode) = (zk::rpm(2500).to_vec(), zk::mode(4, RUN).to_vec());
    assert_eq!(turns(&mut bench, 4), [demand.clone(), mode.clone(), demand, mode]);
    // A new rpm is in force at the latest two turns later.
    bench.order(bench.now(), rpm(100_079)).unwrap();
    let two = turns(&mut bench, 2);
    assert!(two.contains(&zk::rpm(2501).to_vec()), "never rounded above the demand: {two:02x?}");
}

/// ZK-9: RPM_X for every maximum that an ECU can report, and an rpm never above the demand.
#[test]
fn zk_9_rpm_x_for_every_maximum() {
    for max in 1..=255u8 {
        let mut bench = ecu_with(Config::DEFAULT, 5, max);
        runs(&mut bench);
        let max_rpm = u32::from(max) * 1000;
        // The printed ranges: 40950 × RPM_X. Above the last of them 6 reaches furthest.
        let x = (1..=6).find(|x| 40_950 * x >= max_rpm).unwrap_or(6);
        for demand in [0, 1, 33_333.min(max_rpm), max_rpm / 2 + 7, max_rpm - 1, max_rpm] {
            if demand > max_rpm {
                continue;
            }
            bench.order(bench.now(), rpm(demand)).unwrap();
            let frames = turns(&mut bench, 2);
            let mode = frames.iter().find(|frame| id(frame) == 6).expect("mode");
            assert_eq!(mode[..], zk::mode(x as u8, RUN), "{max}");
            let code = frames.iter().find(|frame| id(frame) == 7).expect("rpm");
            let code = u32::from(code[1] & 0x0F) << 8 | u32::from(code[2]);
            assert!(code * x * 10 <= demand, "{demand} of {max_rpm}");
            assert!(demand - code * x * 10 < x * 10 || code == 4095, "{demand} of {max_rpm}");
        }
        assert_eq!(
            bench.order(bench.now(), rpm(max_rpm + 1)),
            Err(Rejected::AboveMaxRpm { max: Rpm::new(max_rpm) })
        );
    }
}

/// Any way from one order to another, by mode: (order before, order after, SW that the ECU must end up with).
/// ZK-8: SW 0 is never sent on the way.
#[test]
fn zk_8_no_transition_hands_over_to_pwm() {
    let orders =
        [Order::Standby, throttle(0), throttle(700), rpm(0), rpm(80_000), rpm(160_000), Order::EmergencyStop];
    for split_switch in [false, true] {
        for before in orders {
            for after in orders {
                for turns_before in 1..=3 {
                    let mut bench = ecu_with(Config { split_switch, ..Config::DEFAULT }, 4, 160);
                    runs(&mut bench);
                    let mut ecu = SimpleEcu::default();
                    bench.order(bench.now(), before).unwrap();
                    for frame in turns(&mut bench, turns_before) {
                        ecu.obey(&frame);
                    }
                    bench.order(bench.now(), after).unwrap();
                    for frame in turns(&mut bench, 4) {
                        let switch = match id(&frame) {
                            1 => Some(frame[1] >> 2 & 3),
                            6 => Some(frame[2] & 3),
                            _ => None,
                        };
                        assert_ne!(switch, Some(PWM), "{before:?} to {after:?}: {frame:02x?}");
                        ecu.obey(&frame);
                        assert!(ecu.target_rpm <= 160_000, "{before:?} to {after:?}: {ecu:?}");
                    }
                    assert_eq!(ecu.obeyed(), expected(after), "{before:?} to {after:?} after {turns_before}");
                }
            }
        }
    }
}

/// ZK-8: SW 0 goes out when the hand-over is ordered by name, and takes ID 6 out of the way first.
#[test]
fn zk_8_hand_over_to_pwm_by_its_name() {
    for before in [Order::Standby, throttle(500), rpm(80_000)] {
        let mut bench = running(4);
        let mut ecu = SimpleEcu::default();
        bench.order(bench.now(), before).unwrap();
        turns(&mut bench, 2).iter().for_each(|frame| ecu.obey(frame));
        bench.order(bench.now(), Order::Pwm).unwrap();
        turns(&mut bench, 3).iter().for_each(|frame| ecu.obey(frame));
        assert_eq!(ecu.obeyed(), (PWM, None, Some(0)), "{before:?}");
        // And back again.
        bench.order(bench.now(), Order::Standby).unwrap();
        turns(&mut bench, 3).iter().for_each(|frame| ecu.obey(frame));
        assert_eq!(ecu.obeyed(), (STANDBY, None, Some(0)), "{before:?}");
    }
}

/// What an ECU makes of the frames it gets, by chapter 3 and the notes to IDs 1, 6 and 7 of the document.
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

/// ZK-9: an ECU that another host, or this one before its reset, left in mode 2 or 3 ignores the switch of ID 1.
/// A stop and a standby reach it all the same.
#[test]
fn zk_9_a_stop_reaches_an_ecu_that_was_left_in_mode_3() {
    for left_in in [(0, RUN), (4, RUN)] {
        let left = || SimpleEcu { id1: (RUN, 0), id6: left_in, code: 2500, ..SimpleEcu::default() };
        let mut bench = met_running(4);
        let mut ecu = left();
        bench.order(bench.now(), Order::EmergencyStop).unwrap();
        turns(&mut bench, 6).iter().for_each(|frame| ecu.obey(frame));
        assert_eq!(ecu.obeyed(), expected(Order::EmergencyStop), "left in {left_in:?}");
        // Where nothing is known of ID 6, standby goes by ID 1, and by both when the ECU does not follow.
        let mut bench = met_running(4);
        let mut ecu = left();
        bench.order(bench.now(), Order::Standby).unwrap();
        for _ in 0..20 {
            turns(&mut bench, 1).iter().for_each(|frame| ecu.obey(frame));
            bench.receive(&zk::state(STATE_RUNNING));
        }
        assert_eq!(ecu.obeyed(), expected(Order::Standby), "left in {left_in:?}");
    }
}

/// ZK-9: while the ECU's maximum changes, and with it RPM_X, the target is never above the demand.
#[test]
fn zk_9_a_change_of_the_maximum_never_raises_the_target() {
    for (before, after) in [(160, 40), (40, 160), (255, 1), (100, 200)] {
        for turns_before in 2..=5 {
            let mut bench = ecu_with(Config::DEFAULT, 4, before);
            runs(&mut bench);
            let demand = 30_000;
            bench.order(bench.now(), rpm(demand)).unwrap();
            let mut ecu = SimpleEcu::default();
            turns(&mut bench, turns_before).iter().for_each(|frame| ecu.obey(frame));
            for _ in 0..2 {
                bench.receive(&zk::identity(after, 4, 0));
                for frame in turns(&mut bench, 4) {
                    ecu.obey(&frame);
                    assert!(ecu.target_rpm <= demand, "{before} to {after} after {turns_before}: {ecu:?}");
                }
            }
            assert_eq!(bench.machine.report().max_rpm.unwrap().value.get(), u32::from(after) * 1000);
        }
    }
}

/// ZK-9: a status ID 6 that gives another version (one corrupted frame in 256 passes the CRC) does not make a stop
/// go where an ECU in mode 3 does not look.
#[test]
fn zk_9_a_stop_in_mode_3_reaches_an_ecu_whose_version_changed() {
    for version in [1, 3, 5] {
        for (frames, order) in [
            (1, Order::EmergencyStop),
            (2, Order::EmergencyStop),
            (1, Order::Standby),
            (2, Order::Standby),
            (1, throttle(100)),
            (2, throttle(100)),
        ] {
            let mut bench = running(4);
            let mut ecu = SimpleEcu::default();
            bench.order(bench.now(), rpm(100_000)).unwrap();
            turns(&mut bench, 4).iter().for_each(|frame| ecu.obey(frame));
            for _ in 0..frames {
                bench.receive(&zk::identity(160, version, 0));
            }
            bench.order(bench.now(), order).unwrap();
            let sent = turns(&mut bench, 6);
            if version < 4 && frames == 2 && matches!(order, Order::Run(_)) {
                // Two reports agree on another ECU, which does not know ID 6: to run it is ID 1 alone (ZK-7).
                assert!(sent.iter().all(|frame| frame[..] == zk::throttle(RUN, 100)), "{sent:02x?}");
                continue;
            }
            sent.iter().for_each(|frame| ecu.obey(frame));
            assert_eq!(ecu.obeyed(), expected(order), "version {version}, {frames} frames");
        }
    }
}

/// ZK-9: leaving mode 3 for a throttle, the throttle of long ago never comes into force again.
#[test]
fn zk_9_leaving_mode_3_uses_no_old_throttle() {
    for turns_in_mode_3 in 2..=5 {
        let mut bench = running(4);
        let mut ecu = SimpleEcu::default();
        bench.order(bench.now(), throttle(1000)).unwrap();
        turns(&mut bench, 3).iter().for_each(|frame| ecu.obey(frame));
        bench.order(bench.now(), rpm(40_000)).unwrap();
        turns(&mut bench, turns_in_mode_3).iter().for_each(|frame| ecu.obey(frame));
        bench.order(bench.now(), throttle(100)).unwrap();
        for frame in turns(&mut bench, 4) {
            ecu.obey(&frame);
            let (switch, _, throttle) = ecu.obeyed();
            assert_eq!(switch, RUN);
            assert!(throttle.is_none_or(|throttle| throttle <= 100), "{ecu:?} after {turns_in_mode_3}");
        }
    }
}

/// ZK-8, ZK-9: a hand-over from mode 3 leads from run to PWM, and not through the switch that ID 1 carried before
/// the start.
#[test]
fn zk_8_a_hand_over_from_mode_3_stops_nothing_on_its_way() {
    let mut bench = running(4);
    let mut ecu = SimpleEcu::default();
    bench.order(bench.now(), Order::Standby).unwrap();
    turns(&mut bench, 3).iter().for_each(|frame| ecu.obey(frame));
    bench.order(bench.now(), rpm(80_000)).unwrap();
    turns(&mut bench, 4).iter().for_each(|frame| ecu.obey(frame));
    bench.order(bench.now(), Order::Pwm).unwrap();
    for frame in turns(&mut bench, 4) {
        ecu.obey(&frame);
        assert!([RUN, PWM].contains(&ecu.obeyed().0), "{ecu:?}");
    }
    assert_eq!(ecu.obeyed().0, PWM);
}

/// ZK-8: ID 6 lets go when it said so on the wire, and not before: a transmission that failed is made up for.
#[test]
fn zk_8_a_hand_over_that_was_not_sent_is_sent_again() {
    let mut bench = running(4);
    let mut ecu = SimpleEcu::default();
    bench.order(bench.now(), rpm(80_000)).unwrap();
    turns(&mut bench, 4).iter().for_each(|frame| ecu.obey(frame));
    bench.run_to(bench.now() + 20_000);
    let mut bench = bench.by_hand();
    bench.frames();
    bench.order(bench.now(), Order::Pwm).unwrap();
    let mut failed = false;
    for _ in 0..100 {
        bench.run_to(bench.now() + 10_000);
        let frames = bench.bytes();
        if !failed && frames.iter().any(|frame| id(frame) == 6) {
            failed = true;
            bench.not_sent_at(bench.now(), NotSent::Failed);
            continue;
        }
        frames.iter().for_each(|frame| ecu.obey(frame));
        if bench.busy() {
            bench.sent_at(bench.now());
        }
    }
    assert!(failed);
    assert_eq!(ecu.obeyed(), expected(Order::Pwm));
}

/// ZK-9: "When RPM_X is 0, the RPM of ID 7 is invalid": an ECU may forget what came before the mode, or keep the rpm
/// of the last time. No more than one frame's time may pass until the new one is in force.
#[test]
fn zk_9_entering_mode_3_again_uses_no_old_rpm() {
    let mut bench = running(4);
    let mut ecu = SimpleEcu { ignores_early_rpm: true, ..SimpleEcu::default() };
    bench.order(bench.now(), rpm(100_000)).unwrap();
    turns(&mut bench, 4).iter().for_each(|frame| ecu.obey(frame));
    bench.order(bench.now(), throttle(0)).unwrap();
    turns(&mut bench, 4).iter().for_each(|frame| ecu.obey(frame));
    bench.order(bench.now(), rpm(40_000)).unwrap();
    bench.frames();
    bench.run_to(bench.now() + 4 * TURN);
    let mut wrong_since: Option<u64> = None;
    for (at, frame) in bench.frames() {
        let wrong_for = wrong_since.map_or(0, |since| at - since);
        assert!(wrong_for < 10_000, "{:?} for {wrong_for} µs", ecu.obeyed());
        ecu.obey(&frame);
        let wrong = ecu.obeyed().1.is_some_and(|target| target > 40_000);
        wrong_since = wrong.then(|| wrong_since.unwrap_or(at));
    }
    assert_eq!(ecu.obeyed(), expected(rpm(40_000)));
}

// ---------------------------------------------------------------------------------------------
// Emergency stop
// ---------------------------------------------------------------------------------------------

/// ZK-8: an emergency stop goes out at once, out of turn, and again at every turn.
#[test]
fn zk_8_an_emergency_stop_goes_out_of_turn() {
    let mut bench = running(3);
    bench.order(60_000, throttle(900)).unwrap();
    bench.run_to(120_000);
    bench.frames();
    bench.order(123_456, Order::EmergencyStop).unwrap();
    bench.run_to(250_000);
    let stop = zk::throttle(STOP, 0).to_vec();
    let expected: Vec<_> = [123_456, 150_000, 200_000, 250_000].map(|at| (at, stop.clone())).into();
    assert_eq!(bench.frames(), expected);
}

/// While a transmission is under way the stop goes out directly behind it.
#[test]
fn an_emergency_stop_follows_a_running_transmission_at_once() {
    let mut bench = running(3);
    bench.order(60_000, throttle(900)).unwrap();
    bench.run_to(100_000); // the frame of this turn takes 4167 µs
    bench.frames();
    bench.order(101_000, Order::EmergencyStop).unwrap();
    bench.run_to(140_000);
    assert_eq!(bench.frames(), [(104_167, zk::throttle(STOP, 0).to_vec())]);
}

/// The same when that transmission fails.
#[test]
fn an_emergency_stop_follows_a_failed_transmission_at_once() {
    let mut bench = running(3).by_hand();
    bench.order(60_000, throttle(900)).unwrap();
    bench.run_to(100_000);
    bench.frames();
    bench.order(101_000, Order::EmergencyStop).unwrap();
    bench.not_sent_at(102_000, NotSent::Failed);
    assert_eq!(bench.frames(), [(102_000, zk::throttle(STOP, 0).to_vec())]);
}

/// ZK-9: in mode 3 the first frame of a stop is the one that the ECU obeys: ID 6 with RPM_X = 0.
#[test]
fn zk_9_an_emergency_stop_in_mode_3_begins_with_id_6() {
    for turns_before in 2..=5 {
        let mut bench = running(4);
        bench.order(bench.now(), rpm(100_000)).unwrap();
        turns(&mut bench, turns_before);
        let t = bench.now() + 17_000;
        bench.run_to(t); // the frame behind a new RPM_X is out, too
        bench.frames();
        bench.order(t, Order::EmergencyStop).unwrap();
        assert_eq!(bench.frames(), [(t, zk::mode(0, STOP).to_vec())], "{turns_before}");
    }
}

/// Nothing takes the turn of a stop: no rate, no service, no pressure, no unlock.
#[test]
fn an_emergency_stop_pre_empts_everything() {
    let mut bench = link(Config { rate: Rate::Hz50, ..Config::DEFAULT }, LINE);
    bench.receive(&zk::identity(160, 5, 0)); // at 20 Hz: the rate is not as wanted
    bench.receive(&zk::idle(30, true)); // asks for pressure
    pressure(&mut bench, 1013);
    bench.order(bench.now(), Order::Standby).unwrap();
    service(&mut bench, curve(30)).unwrap();
    bench.order(bench.now(), Order::EmergencyStop).unwrap();
    // By ID 1, and in case that another host used it by ID 6.
    let stops = [zk::throttle(STOP, 0), zk::mode(0, STOP)];
    let frames = turns(&mut bench, 200);
    assert_eq!(frames[..2], stops);
    for frame in &frames {
        assert!(stops.iter().any(|stop| frame[..] == stop[..]), "{frame:02x?}");
    }
    for both in frames.windows(3) {
        assert!(ids(both).contains(&1) && ids(both).contains(&6), "{both:02x?}");
    }
}

/// ZK-8, ZK-9: from version 4 on a stop goes by ID 1 and ID 6 in turns: ID 6 first if the switch went there, else
/// ID 1.
#[test]
fn zk_9_an_emergency_stop_alternates_id_1_and_id_6() {
    for (before, first) in [(throttle(500), [1, 6]), (Order::Standby, [1, 6]), (rpm(80_000), [6, 1])] {
        for version in [4, 5] {
            let mut bench = running(version);
            bench.order(bench.now(), before).unwrap();
            turns(&mut bench, 4);
            bench.run_to(bench.now() + 20_000);
            bench.frames();
            bench.order(bench.now(), Order::EmergencyStop).unwrap();
            // Also when the ECU falls silent, and its version with it is forgotten.
            bench.run_to(bench.now() + 20 * TURN);
            let frames = bench.bytes();
            for (at, frame) in frames.iter().enumerate() {
                let expected = if first[at % 2] == 1 { zk::throttle(STOP, 0) } else { zk::mode(0, STOP) };
                assert_eq!(frame[..], expected, "version {version}, {before:?}: {:?}", ids(&frames));
            }
        }
    }
}

/// ZK-7, ZK-9: below version 4 a stop is ID 1 alone. Where two reports have not agreed on the version, it goes by ID 6 as
/// well, which lower versions ignore.
#[test]
fn zk_9_an_emergency_stop_below_version_4_is_id_1() {
    for version in [1, 3] {
        let mut bench = met_running(version);
        bench.order(bench.now(), Order::EmergencyStop).unwrap();
        for frame in turns(&mut bench, 10) {
            assert_eq!(frame, zk::throttle(STOP, 0), "{version:?}");
        }
    }
    for version in [None, Some(3), Some(4)] {
        let mut bench = link(Config::DEFAULT, LINE);
        bench.run_to(10_000); // the keep-alive of the first turn is out
        if let Some(version) = version {
            bench.receive(&zk::identity(160, version, 0));
        }
        bench.frames();
        bench.order(bench.now(), Order::EmergencyStop).unwrap();
        bench.run_to(1_000_000);
        let frames = bench.bytes();
        for (at, frame) in frames.iter().enumerate() {
            let expected = if at % 2 == 0 { zk::throttle(STOP, 0) } else { zk::mode(0, STOP) };
            assert_eq!(frame[..], expected, "{version:?}: {:?}", ids(&frames));
        }
    }
}

/// ZK-9: where ID 6 was used before a reset, as the record says, a standby and a stop go by ID 1 and ID 6 in turns, with
/// nothing heard as well. A run waits for the version (ZK-7).
#[test]
fn zk_9_after_a_reset_a_stop_and_a_standby_go_by_both() {
    for (order, sw) in [(Order::Standby, STANDBY), (Order::EmergencyStop, STOP)] {
        let mut bench = link(Config::DEFAULT, LINE);
        bench.act(|link, _| link.resume_switch_by_id6());
        bench.run_to(10_000);
        bench.frames();
        bench.order(bench.now(), order).unwrap();
        bench.run_to(1_000_000);
        let frames = bench.bytes();
        assert_eq!(frames[..2], [zk::mode(0, sw), zk::throttle(sw, 0)], "{order:?}");
        for both in frames.windows(2) {
            assert_ne!(id(&both[0]), id(&both[1]), "{order:?}: {:?}", ids(&frames));
        }
        assert!(frames.iter().all(|frame| matches!(id(frame), 1 | 6)), "{order:?}: {:?}", ids(&frames));
    }
    let mut bench = link(Config::DEFAULT, LINE);
    bench.act(|link, _| link.resume_switch_by_id6());
    bench.order(bench.now(), throttle(300)).unwrap();
    assert_eq!(ids(&turns(&mut bench, 10))[1..], [1; 9], "version not known");
    // Without the record a standby is ID 1.
    let mut bench = link(Config::DEFAULT, LINE);
    bench.order(bench.now(), Order::Standby).unwrap();
    assert_eq!(ids(&turns(&mut bench, 10))[1..], [1; 9]);
}

/// ZK-9: which of two frames goes first, and that the one that a new RPM_X gives a meaning to follows it directly,
/// out of turn. ZK-8: a hand-over is said in ID 1 before ID 6 lets go.
#[test]
fn zk_9_which_frame_goes_first() {
    let (run, demand) = (throttle(300), rpm(80_000));
    for (split_switch, before, after, first) in [
        (true, Order::Standby, run, vec![zk::throttle(RUN, 300), zk::mode(0, RUN)]),
        (true, run, Order::Standby, vec![zk::mode(0, STANDBY), zk::throttle(STANDBY, 0)]),
        (true, run, Order::EmergencyStop, vec![zk::mode(0, STOP), zk::throttle(STOP, 0)]),
        (true, run, Order::Pwm, vec![zk::throttle(PWM, 0), zk::mode(0, PWM), zk::throttle(PWM, 0)]),
        (false, demand, Order::Pwm, vec![zk::throttle(PWM, 0), zk::mode(0, PWM), zk::throttle(PWM, 0)]),
        (false, run, Order::Pwm, vec![zk::throttle(PWM, 0), zk::throttle(PWM, 0)]),
        (false, run, demand, vec![zk::rpm(2000), zk::mode(4, RUN), zk::rpm(2000), zk::mode(4, RUN)]),
        (false, demand, run, vec![zk::throttle(RUN, 300), zk::mode(0, RUN), zk::throttle(RUN, 300)]),
        (
            false,
            demand,
            Order::Standby,
            vec![zk::mode(0, STANDBY), zk::throttle(STANDBY, 0), zk::mode(0, STANDBY)],
        ),
        (
            false,
            demand,
            Order::EmergencyStop,
            vec![zk::mode(0, STOP), zk::throttle(STOP, 0), zk::mode(0, STOP)],
        ),
    ] {
        let mut bench = ecu_with(Config { split_switch, ..Config::DEFAULT }, 4, 160);
        bench.order(bench.now(), Order::Standby).unwrap();
        runs(&mut bench);
        bench.order(bench.now(), before).unwrap();
        turns(&mut bench, 5);
        bench.run_to(bench.now() + 20_000);
        bench.frames();
        bench.order(bench.now(), after).unwrap();
        bench.run_to(bench.now() + 5 * TURN);
        let frames = bench.frames();
        let sent: Vec<_> = frames.iter().take(first.len()).map(|(_, frame)| &frame[..]).collect();
        assert_eq!(sent, first, "{before:?} to {after:?}");
        // An emergency stop begins at once.
        let mut turns = frames.iter().skip(usize::from(after == Order::EmergencyStop));
        let mut factor = if before == demand { 4 } else { 0 };
        let mut directly = None;
        if after == Order::EmergencyStop && before == demand {
            directly = Some(frames[0].0 + 4_167);
            factor = 0;
        }
        assert!(
            turns.all(|(at, frame)| {
                let expected = directly.take();
                if id(frame) == 6 && frame[2] >> 2 != factor {
                    factor = frame[2] >> 2;
                    // To SW 0 there is none: ID 1 has said it before.
                    directly = (frame[2] & 3 != PWM).then_some(at + 4_167);
                }
                expected.map_or(at % TURN == 0, |expected| *at == expected)
            }),
            "{before:?} to {after:?}: {frames:02x?}"
        );
    }
}

/// ZK-9: nothing comes between an ID 6 with a new RPM_X and its partner, whatever is due.
#[test]
fn zk_9_nothing_comes_between_a_new_rpm_x_and_its_partner() {
    let mut bench = running(4);
    bench.receive(&zk::idle(30, true)); // asks for pressure
    bench.order(bench.now(), rpm(100_000)).unwrap();
    bench.run_to(101_000); // the ID 6 of 100 ms is going out
    pressure(&mut bench, 1013);
    bench.run_to(140_000);
    let sent = [(50_000, zk::rpm(2500)), (100_000, zk::mode(4, RUN)), (104_167, zk::rpm(2500))];
    assert_eq!(bench.frames(), sent.map(|(at, frame)| (at, frame.to_vec())));
}

/// ZK-9: RPM_X is chosen when an rpm order begins, and stays until the order changes in kind.
#[test]
fn zk_9_rpm_x_stays_with_the_order() {
    let mut bench = running(4);
    let modes = |bench: &mut Bench<ZkLink>| -> Vec<u8> {
        turns(bench, 6).iter().filter(|frame| id(frame) == 6).map(|frame| frame[2] >> 2).collect()
    };
    bench.order(bench.now(), rpm(40_000)).unwrap();
    assert!(modes(&mut bench).iter().all(|x| *x == 4));
    for _ in 0..2 {
        bench.receive(&zk::identity(80, 4, 0));
    }
    assert_eq!(bench.machine.report().max_rpm.unwrap().value.get(), 80_000);
    assert!(modes(&mut bench).iter().all(|x| *x == 4));
    bench.order(bench.now(), rpm(50_000)).unwrap(); // a new number is no new order
    assert!(modes(&mut bench).iter().all(|x| *x == 4));
    bench.order(bench.now(), throttle(0)).unwrap();
    assert!(modes(&mut bench).iter().all(|x| *x == 0));
    bench.order(bench.now(), rpm(50_000)).unwrap();
    let modes = modes(&mut bench);
    assert!(!modes.is_empty() && modes.iter().all(|x| *x == 2), "{modes:?}");
}

/// ZK-9: an ECU that ran before the first order may have been given its switch by ID 6, so its first run goes there, too.
/// Version 3 does not know ID 6 (ZK-7).
#[test]
fn zk_9_an_ecu_that_ran_already_gets_its_switch_by_id_6() {
    let order = throttle(200);
    let mut bench = met_running(4);
    bench.order(bench.now(), order).unwrap();
    let frames = turns(&mut bench, 2);
    for frame in [zk::mode(0, RUN), zk::throttle(RUN, 200)] {
        assert!(frames.contains(&frame.to_vec()), "{frames:02x?}");
    }
    let mut old = met_running(3);
    old.order(old.now(), order).unwrap();
    assert_eq!(ids(&turns(&mut old, 10)), [1; 10], "version 3");
    let mut standing = ecu(4);
    standing.order(standing.now(), order).unwrap();
    assert_eq!(ids(&turns(&mut standing, 10)), [1; 10], "it stood");
    // A version that one report alone gives is not used.
    let mut once = link(Config::DEFAULT, LINE);
    once.receive(&zk::identity(160, 4, 0));
    runs(&mut once);
    once.order(once.now(), order).unwrap();
    assert_eq!(ids(&turns(&mut once, 10))[1..], [1; 9], "one report");
}

/// ZK-9: an ECU whose switch is another than the one ordered, in two reports in a row later than 0.7 s after the
/// order, gets it by ID 6, too.
#[test]
fn zk_9_an_ecu_that_does_not_follow_gets_its_switch_by_id_6() {
    // SwSt: 0 stop, 1 standby, 2 run.
    for (order, follows, others) in [(Order::Standby, 1, [0, 2, 3]), (throttle(0), 2, [0, 1, 3])] {
        let says = |switch: u8| zk::status(1, 0, [STATE_STANDBY, switch << 5, 76]);
        let uses_id6 = |version: u8, reports: &[(u64, u8)]| {
            let mut bench = ecu(version);
            bench.order(100_000, order).unwrap();
            for (after, switch) in reports {
                heard_to(&mut bench, 100_000 + after);
                bench.receive(&says(*switch));
            }
            ids(&turns(&mut bench, 6)).contains(&6)
        };
        for other in others {
            for (version, reports, expected) in [
                (4, &[(700_000, other), (750_000, other)][..], true),
                (5, &[(900_000, other), (5_000_000, other)], true),
                (3, &[(700_000, other), (750_000, other), (800_000, other)], false),
                (4, &[(900_000, other)], false),
                (4, &[(699_999, other), (750_000, other)], false),
                (4, &[(100_000, other), (300_000, other), (699_999, other)], false),
                (4, &[(800_000, other), (850_000, follows), (900_000, other)], false),
                (4, &[(800_000, other), (850_000, follows), (900_000, other), (950_000, other)], true),
            ] {
                assert_eq!(uses_id6(version, reports), expected, "{order:?} {version} {reports:?}");
            }
        }
        assert!(!uses_id6(4, &[(800_000, follows), (850_000, follows), (900_000, follows)]));
    }
}

/// ZK-9: an order that was given before the ECU was heard, as an engine does, and an ECU that was left in mode 2 or 3:
/// a standby is obeyed within about a second, a stop from the first ID 6 on.
#[test]
fn zk_9_an_ecu_met_in_mode_3_is_reached_in_time() {
    for left_in in [(0, RUN), (4, RUN)] {
        for (order, within) in [(Order::Standby, 1_000_000), (Order::EmergencyStop, 2 * TURN + 5_000)] {
            let mut bench = link(Config::DEFAULT, LINE);
            let mut ecu = SimpleEcu { id1: (RUN, 0), id6: left_in, code: 2500, ..SimpleEcu::default() };
            for _ in 0..2 {
                bench.receive(&zk::identity(160, 4, 0));
            }
            bench.order(0, order).unwrap();
            let mut obeyed_at = None;
            for step in 1..=40u64 {
                bench.rx(step * 50_000 + 20_000, &zk::state(STATE_RUNNING));
                for (at, frame) in bench.frames() {
                    ecu.obey(&frame);
                    if obeyed_at.is_none() && ecu.obeyed() == expected(order) {
                        obeyed_at = Some(at);
                    }
                }
            }
            assert_eq!(ecu.obeyed(), expected(order), "left in {left_in:?}");
            assert!(obeyed_at.is_some_and(|at| at <= within), "{order:?} left in {left_in:?}: {obeyed_at:?}");
        }
    }
}

/// ZK-6, ZK-9: what a frame says of version, maximum and idle rpm is believed at once if it is the first, and a
/// change only when two in a row say the same: one damaged frame in 256 passes the CRC.
#[test]
fn zk_16_one_odd_frame_changes_no_identity() {
    let known = |bench: &Bench<ZkLink>| {
        let report = bench.machine.report();
        (report.version.unwrap().value.get(), report.max_rpm.unwrap().value.get())
    };
    let mut bench = link(Config::DEFAULT, LINE);
    bench.receive(&zk::identity(160, 4, 0));
    assert_eq!(known(&bench), (4, 160_000), "the first");
    bench.event_kinds();
    for (max, version) in [(40, 4), (160, 1), (40, 1), (160, 4), (40, 1), (160, 4), (40, 1), (40, 2), (41, 1)]
    {
        bench.receive(&zk::identity(max, version, 0));
        assert_eq!(known(&bench), (4, 160_000), "{max} {version}");
    }
    assert_eq!(bench.event_kinds(), []);
    bench.receive(&zk::identity(41, 1, 0));
    assert_eq!(known(&bench), (1, 41_000), "the second in a row");
    assert_eq!(bench.event_kinds(), [Event::VersionKnown(Version::new(1).unwrap())]);

    for (frame, idle) in [(30, 30), (60, 30), (30, 30), (60, 30), (50, 30), (60, 30), (60, 60)] {
        bench.receive(&zk::idle(frame, false));
        assert_eq!(bench.machine.report().idle_rpm.unwrap().value.get(), idle * 1000, "{frame}");
    }
}

/// The control: without the stop all of them go out.
#[test]
fn without_an_emergency_stop_everything_goes_out() {
    let mut bench = link(Config { rate: Rate::Hz50, ..Config::DEFAULT }, LINE);
    for _ in 0..2 {
        bench.receive(&zk::identity(160, 5, 0));
    }
    bench.receive(&zk::idle(30, true));
    pressure(&mut bench, 1013);
    bench.order(bench.now(), Order::Standby).unwrap();
    service(&mut bench, curve(30)).unwrap();
    bench.run_to(240_000);
    let frames = bench.bytes();
    for expected in [zk::action(8), zk::unlock(), zk::curve(30), zk::pressure(1013), zk::throttle(STANDBY, 0)]
    {
        assert!(frames.contains(&expected.to_vec()), "{expected:02x?} in {frames:02x?}");
    }
    // The demand never waits for two turns.
    let gaps: Vec<_> = ids(&frames).split(|id| *id == 1).map(<[u8]>::len).collect();
    assert!(gaps.iter().all(|gap| *gap <= 2), "an unlocked command is two frames in one turn: {gaps:?}");
}

// ---------------------------------------------------------------------------------------------
// In doubt, and what closes the pump
// ---------------------------------------------------------------------------------------------

/// In doubt nothing goes out that could start an engine: ID 0, and in mode 3 the rpm in turn with it, which an ECU that
/// restarted ignores (ZK-9).
#[test]
fn in_doubt_only_keep_alives_and_in_mode_3_the_rpm_go_out() {
    let doubt = |order: Order| {
        let Order::Run(demand) = order else { panic!("a run") };
        Order::Doubt(demand)
    };
    for (split_switch, version, order, expected) in [
        (false, 3, throttle(600), vec![zk::keep_alive(); 4]),
        (false, 5, throttle(600), vec![zk::keep_alive(); 4]),
        (true, 5, throttle(600), vec![zk::keep_alive(); 4]),
        (false, 5, rpm(100_000), vec![zk::keep_alive(), zk::rpm(2500), zk::keep_alive(), zk::rpm(2500)]),
    ] {
        let mut bench = ecu_with(Config { split_switch, ..Config::DEFAULT }, version, 160);
        bench.order(bench.now(), Order::Standby).unwrap();
        runs(&mut bench);
        bench.order(bench.now(), order).unwrap();
        assert!(turns(&mut bench, 4).iter().any(|frame| frame[..] != zk::keep_alive()), "the control");
        bench.run_to(bench.now() + 20_000);
        bench.order(bench.now(), doubt(order)).unwrap();
        let mut frames = turns(&mut bench, 4);
        if frames[0] != expected[0] {
            frames.rotate_left(1);
        }
        assert_eq!(frames, expected, "{order:?} of version {version}");
        // When the link is lost the version is forgotten; the engine is in mode 3 all the same.
        bench.run_to(bench.now() + 600_000);
        bench.frames();
        let mut frames = turns(&mut bench, 4);
        if frames[0] != expected[0] {
            frames.rotate_left(1);
        }
        assert_eq!(frames, expected, "{order:?} of version {version}, lost");
        // A stop and a standby go out blind.
        for (order, sw) in [(Order::Standby, STANDBY), (Order::EmergencyStop, STOP)] {
            bench.order(bench.now(), order).unwrap();
            bench.run_to(bench.now() + 10 * TURN);
            let frames = bench.bytes();
            assert!(
                frames.len() >= 10 && frames.iter().all(|frame| switch_of(frame) == Some(sw)),
                "{frames:02x?}"
            );
        }
    }
    // With no mode 3 in force an rpm in doubt is ID 0.
    let mut bench = ecu(5);
    bench.order(bench.now(), doubt(rpm(100_000))).unwrap();
    assert_eq!(turns(&mut bench, 10), vec![zk::keep_alive().to_vec(); 10]);
}

/// The pump is closed by ten frames of ID 2, parameter 13, at every second turn, behind the first frame of a stop, whatever
/// the version and whatever is heard. It ends sooner where the ECU reports a pump without voltage.
#[test]
fn the_pump_is_closed_by_ten_frames_beside_every_stop() {
    for (order, sw) in [(Order::EmergencyStop, STOP), (Order::Standby, STANDBY)] {
        for version in [None, Some(3), Some(5)] {
            for voltage in [None, Some(12), Some(0)] {
                let mut bench = version.map_or_else(|| link(Config::DEFAULT, LINE), ecu);
                bench.order(bench.now(), Order::Standby).unwrap();
                bench.run_to(bench.now() + 60_000);
                bench.frames();
                bench.act(|link, _| link.close_pump());
                assert!(bench.machine.closing_pump());
                bench.order(bench.now(), order).unwrap();
                let mut frames = Vec::new();
                for _ in 0..40 {
                    bench.run_to(bench.now() + TURN);
                    frames.extend(bench.bytes());
                    if let Some(voltage) = voltage {
                        bench.receive(&zk::status(2, 0, [60, 120, voltage]));
                    }
                }
                let closes = |frame: &Vec<u8>| frame[..] == zk::action(13);
                let count = frames.iter().filter(|frame| closes(frame)).count();
                assert_eq!(
                    count,
                    // One that was measured less than 0.1 s after the first frame may be from before it.
                    if voltage == Some(0) { 2 } else { 10 },
                    "{order:?} {version:?} {voltage:?}"
                );
                assert!(!closes(&frames[0]), "a stop first");
                assert!(frames.windows(2).all(|pair| !pair.iter().all(closes)), "every second turn at most");
                assert!(
                    frames.iter().all(|frame| closes(frame) || switch_of(frame) == Some(sw)),
                    "{frames:02x?}"
                );
                assert!(!bench.machine.closing_pump());
            }
        }
    }
    // Beside the link that has none to close.
    let mut bench = ecu(5);
    bench.order(bench.now(), Order::Standby).unwrap();
    assert!(turns(&mut bench, 40).iter().all(|frame| id(frame) == 1));
}

/// ZK-13: what closes the pump does not come between an unlock and its command.
#[test]
fn zk_13_closing_the_pump_does_not_part_an_unlock_from_its_command() {
    for turns_before in 0..4 {
        let mut bench = ecu(5);
        bench.order(bench.now(), Order::Standby).unwrap();
        bench.run_to(bench.now() + 60_000);
        bench.act(|link, _| link.close_pump());
        turns(&mut bench, turns_before + 1);
        service(&mut bench, curve(40)).unwrap();
        bench.frames();
        bench.run_to(bench.now() + 10 * TURN);
        let frames = bench.bytes();
        let unlock = frames.iter().position(|frame| id(frame) == 3).expect("an unlock");
        assert_eq!(frames[unlock + 1], zk::curve(40), "{:?}", ids(&frames));
        assert!(frames.iter().any(|frame| frame[..] == zk::action(13)), "beside the frames that close it");
    }
}

/// What each status says about the life of the engine: ID 1 its state and its shaft, the others the shaft alone.
#[test]
fn every_status_is_a_sign() {
    // Idle speed in 1000 rpm, maximum, and half of idle or what stands for it.
    for (idle, max, half) in [
        (None, None, 10_000),
        (None, Some(160), 16_000),
        (Some(30), Some(160), 15_000),
        (Some(30), None, 15_000),
    ] {
        let mut bench = link(Config::DEFAULT, LINE);
        if let Some(max) = max {
            bench.receive(&zk::identity(max, 4, 0));
        }
        if let Some(idle) = idle {
            bench.receive(&zk::idle(idle, false));
        }
        for (rpm, turns) in [(0, false), (half - 10, false), (half, true), (160_000, true)] {
            for state in 0..=31 {
                bench.receive(&zk::status(1, rpm, [state, 2 << 5, 76]));
                let stage = match state {
                    0 | 1 | 12 | 14..=19 => Stage::Rest,
                    2..=4 => Stage::Ignition,
                    5 => Stage::FuelRamp,
                    6..=11 => Stage::Running,
                    13 => Stage::Restart,
                    _ => Stage::Unknown,
                };
                let sign = Sign::State { stage, turning: Some(turns), throttle: None };
                assert_eq!(bench.machine.take_sign(), Some(sign), "state {state} at {rpm} rpm");
                assert_eq!(bench.machine.take_sign(), None, "once");
            }
            for id in [2, 3, 4, 5, 7, 9, 10] {
                bench.receive(&zk::status(id, rpm, [1, 2, 3]));
                assert_eq!(bench.machine.take_sign(), Some(Sign::Shaft { turning: turns }), "{id} at {rpm}");
            }
        }
    }
}

/// A gap begins three of the ECU's intervals behind its last frame, the slower one of what it says and what it was asked for.
/// Damaged frames keep the beat; half a frame does not.
#[test]
fn three_frames_that_fail_are_a_gap() {
    let gap = |bench: &Bench<ZkLink>| bench.machine.gap_at().map(|at| at.as_micros());
    for (asked, rate, three) in [
        (Rate::Hz20, 0, 150_000),
        (Rate::Hz20, 1, 150_000),
        (Rate::Hz20, 2, 150_000),
        (Rate::Hz50, 0, 150_000),
        (Rate::Hz50, 1, 60_000),
        (Rate::Hz100, 2, 30_000),
    ] {
        let mut bench = link(Config { rate: asked, ..Config::DEFAULT }, LINE);
        assert_eq!(gap(&bench), None, "nothing was heard yet");
        bench.rx(100_000, &zk::identity(160, 4, rate));
        assert_eq!(gap(&bench), Some(100_000 + three), "rate {rate}");
        let mut damaged = zk::state(STATE_RUNNING);
        damaged[5] ^= 0x10;
        bench.rx(125_000, &damaged);
        assert_eq!(gap(&bench), Some(125_000 + three), "rate {rate}");
        bench.rx(140_000, &damaged[..4]);
        assert_eq!(gap(&bench), Some(125_000 + three), "rate {rate}");
        bench.act(|link, _| link.gap());
        assert_eq!(gap(&bench), None, "it is announced once");
    }
}

// ---------------------------------------------------------------------------------------------
// Until the engine runs
// ---------------------------------------------------------------------------------------------

/// The demand is kept at its minimum until the engine is released, whatever the ECU reports: ignition demands it.
#[test]
fn the_demand_waits_for_its_release() {
    let mut bench = ecu(3); // throttle and switch in ID 1, whatever switch it reports
    bench.order(bench.now(), throttle(600)).unwrap();
    for (released, tenths) in [(false, 0), (true, 600), (false, 0)] {
        bench.act(|link, _| link.release(released));
        for state in 0..=31 {
            bench.receive(&zk::state(state));
            for frame in turns(&mut bench, 2) {
                assert_eq!(frame, zk::throttle(RUN, tenths), "state {state}");
            }
        }
    }
}

/// A state with the shaft turning at 50 000 rpm, well above half of idle.
fn turning(state: u8) -> [u8; 7] {
    let switch = if matches!(state, 0 | 1 | 12) { 1 } else { 2 };
    zk::status(1, 50_000, [state, switch << 5, 76])
}

/// The supervision on top of the link: ordered to start, with the stick at 60 % behind it.
fn started() -> Bench<Engine> {
    let config = EngineConfig::zk("z", 0, LINE, Rate::Hz20);
    let mut bench = Bench::new(Engine::new(&config), LINE);
    bench.machine = Engine::new(&config);
    bench.act(|engine, now| engine.start(now, Some(RetainedState::new(Order::Standby, Origin::Rc))));
    for _ in 0..30 {
        engine_turn(&mut bench, &zk::identity(160, 3, 0));
        engine_turn(&mut bench, &zk::state(STATE_STANDBY));
    }
    for command in [Command::Arm, Command::Standby, Command::Run(Demand::Throttle(Throttle::IDLE))] {
        bench.act(|engine, now| engine.command(now, command, Origin::Rc, true)).unwrap();
    }
    bench
}

/// A status of the ECU, and what goes out up to the next turn while the source asks for 60 %.
fn engine_turn(bench: &mut Bench<Engine>, frame: &[u8]) -> Vec<u8> {
    let t = (bench.now() / TURN + 1) * TURN;
    bench.rx(t - 10_000, frame);
    let demand = Command::Run(Demand::Throttle(Throttle::from_percent(60).unwrap()));
    // Refused while it is no start yet.
    let _ = bench.act(|engine, now| engine.command(now, demand, Origin::Rc, true));
    bench.frames();
    bench.run_to(t + 5_000);
    let mut frames = bench.bytes();
    assert_eq!(frames.len(), 1, "{frames:02x?}");
    frames.remove(0)
}

/// The demand goes out when two reports say that the engine runs and its shaft turns. Until then, whatever is reported of a
/// start, it stays at idle.
#[test]
fn the_demand_waits_for_a_running_engine() {
    for running in 6..=11 {
        let mut bench = started();
        for state in [1, 2, 3, 4, 5, STATE_UNKNOWN, running] {
            let frame = if state < 6 { zk::state(state) } else { turning(state) };
            assert_eq!(engine_turn(&mut bench, &frame), zk::throttle(RUN, 0), "state {state}");
        }
        // From here it rises at 50 %/s: 2.5 % a turn.
        for turn in 0..40u16 {
            let frame = engine_turn(&mut bench, &turning(running));
            let tenths = u16::from(frame[1] & 3) << 8 | u16::from(frame[2]);
            assert_eq!(frame, zk::throttle(RUN, tenths));
            assert!(tenths.abs_diff((turn * 25).min(600)) <= 25, "{tenths} at turn {turn}");
        }
        assert_eq!(engine_turn(&mut bench, &turning(running)), zk::throttle(RUN, 600));
        // ZK-15: a state without a name ends nothing.
        for _ in 0..10 {
            assert_eq!(engine_turn(&mut bench, &turning(STATE_UNKNOWN)), zk::throttle(RUN, 600));
        }
    }
    // Running with a shaft that stands releases nothing.
    let mut bench = started();
    for state in [3, 5, 11, 11, 11, 11] {
        assert_eq!(engine_turn(&mut bench, &zk::state(state)), zk::throttle(RUN, 0), "state {state}");
    }
}

/// One report that does not fit a running engine takes the run off the wire, and nothing else; two that agree end it.
#[test]
fn one_odd_report_withholds_the_run_and_two_end_it() {
    for odd in [zk::state(0), zk::state(1), zk::state(12), zk::state(3), zk::state(5), turning(12)] {
        let mut bench = started();
        for state in [3, 5, 11, 11, 11] {
            engine_turn(&mut bench, &if state < 6 { zk::state(state) } else { turning(state) });
        }
        for _ in 0..40 {
            engine_turn(&mut bench, &turning(11));
        }
        for _ in 0..3 {
            assert_eq!(engine_turn(&mut bench, &odd), zk::keep_alive(), "{odd:02x?}");
            assert_eq!(engine_turn(&mut bench, &turning(11)), zk::keep_alive(), "one does not confirm it");
            assert_eq!(engine_turn(&mut bench, &turning(11)), zk::throttle(RUN, 600), "two do");
        }
        assert_eq!(engine_turn(&mut bench, &odd), zk::keep_alive());
        for _ in 0..10 {
            assert_eq!(engine_turn(&mut bench, &odd), zk::throttle(STANDBY, 0), "{odd:02x?}");
        }
    }
}

/// What the report says of phase, faults and switch is debounced: the first counts at once, a change when two agree.
#[test]
fn one_odd_report_changes_neither_phase_nor_faults_nor_switch() {
    let mut bench = link(Config::DEFAULT, LINE);
    let says = |state: u8, error: u8, switch: u8| {
        zk::status(1, 0, [state | error << 5, error >> 3 | switch << 5, 76])
    };
    let known = |bench: &Bench<ZkLink>| {
        let report = bench.machine.report();
        let Faults::Zk(error) = report.faults.unwrap().value else { panic!("ZK") };
        (report.phase.unwrap().value, error.code(), report.switch.unwrap().value)
    };
    let running = (Phase::Running, 0, ReportedSwitch::Run);
    bench.receive(&says(11, 0, 2));
    assert_eq!(known(&bench), running, "the first counts");
    for (state, error, switch) in [(0, 0, 2), (11, 12, 2), (11, 0, 1), (0, 12, 0)] {
        let changed = (
            phase_of(state),
            error,
            [ReportedSwitch::Stop, ReportedSwitch::Standby, ReportedSwitch::Run][usize::from(switch)],
        );
        for _ in 0..3 {
            let t = bench.now() + 10_000;
            bench.rx(t, &says(state, error, switch));
            assert_eq!(known(&bench), running, "{state} {error} {switch}");
            bench.receive(&says(11, 0, 2));
            assert_eq!((known(&bench), bench.machine.report().phase.unwrap().at), (running, us(t)));
        }
        bench.receive(&says(state, error, switch));
        bench.receive(&says(state, error, switch));
        assert_eq!(known(&bench), changed, "two in a row");
        bench.receive(&says(11, 0, 2));
        bench.receive(&says(11, 0, 2));
    }
}

fn phase_of(state: u8) -> Phase {
    match state {
        0 => Phase::Stopped,
        1 => Phase::Standby,
        2..=5 | 13 => Phase::Starting,
        6..=11 => Phase::Running,
        12 => Phase::Cooling,
        14..=19 => Phase::Service,
        _ => Phase::Unknown,
    }
}

/// In mode 3 the minimum is the engine's idle rpm, 0 while that is not known.
#[test]
fn the_rpm_waits_for_its_release() {
    for (idle, demand, target) in
        [(None, 100_000, 0), (Some(30), 100_000, 30_000), (Some(30), 20_000, 20_000)]
    {
        let mut bench = ecu(4);
        if let Some(idle) = idle {
            bench.receive(&zk::idle(idle, false));
        }
        bench.receive(&zk::state(STATE_IGNITION));
        bench.order(bench.now(), rpm(demand)).unwrap();
        let mut ecu = SimpleEcu::default();
        turns(&mut bench, 4).iter().for_each(|frame| ecu.obey(frame));
        assert_eq!(ecu.obeyed(), (RUN, Some(target), None), "{idle:?}");
        runs(&mut bench);
        turns(&mut bench, 4).iter().for_each(|frame| ecu.obey(frame));
        assert_eq!(ecu.obeyed(), (RUN, Some(demand), None), "{idle:?}");
    }
}

// ---------------------------------------------------------------------------------------------
// Versions
// ---------------------------------------------------------------------------------------------

/// ZK-7: a command that the ECU's version does not know is refused with both versions; while no two reports agree on the
/// version only version 1 commands are taken.
#[test]
fn zk_7_every_command_by_version() {
    let services = Action::ALL
        .into_iter()
        .map(|one| {
            let needed = match one.parameter() {
                10 | 11 => 2,
                12 | 13 => 5,
                _ => 1,
            };
            (action(one), needed)
        })
        .chain([(curve(40), 1), (ignition(2000), 1)]);
    for (command, needed) in services {
        for known in [None, Some(1), Some(2), Some(3), Some(4), Some(5), Some(6), Some(63)] {
            let mut bench = link(Config::DEFAULT, LINE);
            bench.order(bench.now(), Order::Standby).unwrap();
            if let Some(known) = known {
                bench.receive(&zk::identity(160, known, 0));
                if needed > 1 {
                    let once = Err(Rejected::NeedsVersion { needed, known: None });
                    assert_eq!(service(&mut bench, command), once, "{command:?} after one report");
                }
                bench.receive(&zk::identity(160, known, 0));
            }
            let expected = if needed <= known.unwrap_or(1) {
                Ok(())
            } else {
                Err(Rejected::NeedsVersion { needed, known })
            };
            assert_eq!(service(&mut bench, command), expected, "{command:?} with {known:?}");
        }
    }
    for known in [None, Some(1), Some(3), Some(4), Some(5)] {
        let mut bench = known.map_or_else(|| link(Config::DEFAULT, LINE), ecu);
        let expected =
            if known >= Some(4) { Ok(()) } else { Err(Rejected::NeedsVersion { needed: 4, known }) };
        assert_eq!(bench.order(bench.now(), rpm(50_000)), expected, "{known:?}");
    }
}

/// ZK-7: version, maximum and idle speed are forgotten with the link: the ECU that comes back may be another one.
#[test]
fn zk_7_the_version_does_not_outlive_the_link() {
    let known = |bench: &Bench<ZkLink>| {
        let report = bench.machine.report();
        (report.version.is_some(), report.max_rpm.is_some(), report.idle_rpm.is_some())
    };
    let refused = Err(Rejected::NeedsVersion { needed: 4, known: None });
    let mut bench = ecu(5);
    bench.receive(&zk::idle(30, false));
    // 0.5 s without a frame is a loss; less is none.
    bench.run_to(bench.now() + 499_999);
    assert_eq!((known(&bench), bench.machine.speed_control()), ((true, true, true), Ok(())));
    bench.run_to(bench.now() + 1);
    assert_eq!((known(&bench), bench.machine.speed_control()), ((false, false, false), refused));
    // Another ECU: its voltages have its own scale at once, its commands need two reports.
    bench.receive(&zk::identity(160, 3, 0));
    bench.receive(&zk::status(2, 0, [60, 120, 255]));
    let supply = bench.machine.report().supply.unwrap().value.voltage;
    assert_eq!(supply.map(Millivolts::get), Some(12_000), "0.1 V a step");
    bench.receive(&zk::identity(160, 3, 0));
    let known = Some(3);
    assert_eq!(bench.machine.speed_control(), Err(Rejected::NeedsVersion { needed: 4, known }));
}

/// ZK-7: a refused rpm leaves the throttle on the wire.
#[test]
fn zk_7_a_refused_order_changes_nothing() {
    let mut bench = running(3);
    bench.order(bench.now(), throttle(333)).unwrap();
    assert!(bench.order(bench.now(), rpm(50_000)).is_err());
    assert_eq!(turns(&mut bench, 2), [zk::throttle(RUN, 333), zk::throttle(RUN, 333)]);
    let mut bench = running(4);
    bench.order(bench.now(), throttle(333)).unwrap();
    assert!(bench.order(bench.now(), rpm(160_001)).is_err());
    assert_eq!(turns(&mut bench, 2), [zk::throttle(RUN, 333), zk::throttle(RUN, 333)]);
    let of_amt = Service::Amt(AmtService::Ctf);
    assert_eq!(service(&mut bench, of_amt), Err(Rejected::NotSupported));
}

/// ZK-7: thrust counts from version 2, and ESR, SCL and the start-up time from version 4.
#[test]
fn zk_7_status_fields_by_version() {
    for version in [None, Some(1), Some(2), Some(3), Some(4), Some(5)] {
        let mut bench = link(Config::DEFAULT, LINE);
        if let Some(version) = version {
            bench.receive(&zk::identity(160, version, 0));
        }
        bench.receive(&zk::status(4, 0, [1, 2, 3]));
        bench.receive(&zk::status(8, 0, [30, 0x30, 25]));
        let report = bench.machine.report();
        assert!(report.current.is_some() && report.idle_rpm.is_some());
        assert_eq!(report.thrust.is_some(), version >= Some(2), "{version:?}");
        assert_eq!(report.pressure_requested.is_some(), version >= Some(4), "{version:?}");
        assert_eq!(report.closed_loop.is_some(), version >= Some(4), "{version:?}");
        assert_eq!(report.startup.is_some(), version >= Some(4), "{version:?}");
    }
}

/// ZK-6: until status ID 6 has been seen a voltage is its raw byte alone.
#[test]
fn zk_6_voltages_wait_for_the_version() {
    for (version, radio, power, pump) in [
        (None, None, None, None),
        (Some(3), Some(6000), Some(12_000), Some(25_500)),
        (Some(4), Some(12_000), Some(24_000), Some(51_000)),
    ] {
        let mut bench = link(Config::DEFAULT, LINE);
        if let Some(version) = version {
            bench.receive(&zk::status(6, 0, [160, 100, version << 2]));
        }
        bench.receive(&zk::status(2, 0, [60, 120, 255]));
        let report = bench.machine.report();
        for (reading, raw, voltage) in
            [(report.radio, 60, radio), (report.supply, 120, power), (report.pump, 255, pump)]
        {
            let reading = reading.unwrap().value;
            assert_eq!((reading.raw, reading.voltage.map(Millivolts::get)), (raw, voltage), "{version:?}");
        }
        // The maximum pump voltage stands in the same frame as the version.
        let max = report.pump_max.map(|max| max.value.voltage.unwrap().get());
        assert_eq!(max, version.map(|version| if version <= 3 { 10_000 } else { 20_000 }));
    }
}

// ---------------------------------------------------------------------------------------------
// Service commands
// ---------------------------------------------------------------------------------------------

/// ZK-13: ID 3 immediately before ID 4 or 5, with nothing in between, and status ID 5 confirms.
#[test]
fn zk_13_unlock_goes_immediately_before() {
    for (command, frame, before, shown) in [
        (curve(40), zk::curve(40), zk::settings(7, 39), zk::settings(7, 40)),
        (ignition(2000), zk::ignition_pump(100), zk::settings(99, 39), zk::settings(100, 39)),
    ] {
        let mut bench = ecu(3);
        bench.order(bench.now(), Order::Standby).unwrap();
        service(&mut bench, command).unwrap();
        bench.run_to(90_000);
        // At the turn, and right behind the unlock's last stop bit: 4167 µs at 9600 baud.
        assert_eq!(bench.frames(), [(50_000, zk::unlock().to_vec()), (54_167, frame.to_vec())]);
        // When its last stop bit is out.
        assert_eq!(bench.events(), [(58_334, Event::ServiceSent(command))]);
        bench.receive(&before);
        assert_eq!(bench.event_kinds(), [], "the old value confirms nothing");
        bench.receive(&shown);
        assert_eq!(bench.event_kinds(), [Event::ServiceConfirmed(command)]);
        let rest = turns(&mut bench, 100);
        assert!(rest.iter().all(|frame| id(frame) == 1), "once: {rest:02x?}");
        // The next one is taken.
        service(&mut bench, command).unwrap();
    }
}

/// ZK-13: without a confirmation three attempts, each with its own unlock, two seconds apart; then it failed.
#[test]
fn zk_13_retries_and_failure() {
    let mut bench = ecu(3);
    bench.order(bench.now(), Order::Standby).unwrap();
    service(&mut bench, curve(40)).unwrap();
    bench.run_to(1_000_000);
    assert_eq!(service(&mut bench, curve(50)), Err(Rejected::Busy));
    assert_eq!(service(&mut bench, action(Action::TestPump)), Err(Rejected::Busy));
    for t in 1_000..12_000 {
        if t % 40 == 0 {
            bench.rx(t * 1000, &zk::settings(7, 39));
        }
    }
    let frames = bench.frames();
    let ours: Vec<_> = frames.iter().filter(|(_, frame)| id(frame) != 1).collect();
    let sent: Vec<_> = ours.iter().map(|(_, frame)| frame.clone()).collect();
    let pair = [zk::unlock().to_vec(), zk::curve(40).to_vec()];
    assert_eq!(sent, [&pair[..], &pair, &pair].concat());
    let unlocks: Vec<u64> = ours.iter().step_by(2).map(|(at, _)| *at).collect();
    for pair in unlocks.windows(2) {
        assert!((2_000_000..=2_200_000).contains(&(pair[1] - pair[0])), "{unlocks:?}");
    }
    let events = bench.events();
    let sent = events.iter().filter(|(_, event)| *event == Event::ServiceSent(curve(40))).count();
    let failed: Vec<_> = events
        .iter()
        .filter(|(_, event)| *event == Event::ServiceFailed(curve(40)))
        .map(|(at, _)| *at)
        .collect();
    assert_eq!((sent, failed.len()), (3, 1));
    assert!(failed[0] >= unlocks[2] + 2_000_000, "the last attempt has its time, too");
    service(&mut bench, curve(50)).unwrap();
}

/// ZK-13: an emergency stop between the unlock and its command goes first; the command does not follow a stop.
#[test]
fn zk_13_a_stop_between_unlock_and_command() {
    let mut bench = ecu(3);
    bench.order(bench.now(), Order::Standby).unwrap();
    service(&mut bench, curve(40)).unwrap();
    bench.run_to(52_000);
    assert_eq!(bench.frames(), [(50_000, zk::unlock().to_vec())]);
    bench.order(52_000, Order::EmergencyStop).unwrap();
    heard_to(&mut bench, 1_000_000);
    let frames = bench.frames();
    assert_eq!(frames[0], (54_167, zk::throttle(STOP, 0).to_vec()));
    assert!(frames.iter().all(|(_, frame)| frame[..] == zk::throttle(STOP, 0)), "nothing but the stop");
    let at: Vec<u64> = frames.iter().skip(1).map(|(at, _)| *at).collect();
    assert_eq!(at, (2..=20).map(|turn| turn * TURN).collect::<Vec<_>>(), "at every turn, in no burst");
}

/// A service command that a stop pre-empted is over: nobody wants a drain or a new curve minutes later, when the
/// stop is released.
#[test]
fn a_stop_ends_a_waiting_service_command() {
    for command in [action(Action::Drain), curve(40)] {
        let mut bench = ecu(3);
        bench.order(bench.now(), Order::Standby).unwrap();
        service(&mut bench, command).unwrap();
        bench.order(bench.now(), Order::EmergencyStop).unwrap();
        bench.run_to(600_000_000);
        bench.frames();
        bench.order(bench.now(), Order::Standby).unwrap();
        let frames = turns(&mut bench, 20);
        // With the ECU silent for so long the stop went by ID 6 as well.
        assert!(frames.iter().all(|frame| matches!(id(frame), 1 | 6)), "{command:?}: {frames:02x?}");
        let told = bench.event_kinds();
        assert_eq!(told.iter().filter(|event| **event == Event::ServiceFailed(command)).count(), 1);
        assert!(!told.contains(&Event::ServiceSent(command)));
        service(&mut bench, command).unwrap();
    }
}

/// An order other than standby ends a service command at every stage, and says so; standby ends none.
#[test]
fn an_order_ends_a_service_command_at_every_stage() {
    let orders = [throttle(0), rpm(50_000), Order::EmergencyStop, Order::Pwm];
    for order in orders {
        // Waiting; the unlock going out; the command going out; waiting for status ID 5.
        for (at, out, was_sent) in
            [(40_000, 0, false), (52_000, 1, false), (56_000, 2, false), (70_000, 2, true)]
        {
            let mut bench = ecu(4);
            bench.order(bench.now(), Order::Standby).unwrap();
            service(&mut bench, curve(40)).unwrap();
            bench.order(at, order).unwrap();
            let out_before = bench.frames().into_iter().filter(|(sent, _)| *sent < at).count();
            assert_eq!(out_before, out);
            bench.run_to(10_000_000);
            let behind = bench.bytes();
            assert!(behind.iter().all(|frame| !(2..=5).contains(&id(frame))), "{order:?} at {at}");
            let told = bench.event_kinds();
            let count = |event| told.iter().filter(|told| **told == event).count();
            assert_eq!(count(Event::ServiceFailed(curve(40))), 1, "{order:?} at {at}");
            assert_eq!(count(Event::ServiceSent(curve(40))), usize::from(was_sent), "{order:?} at {at}");
        }
    }
    let mut bench = ecu(4);
    for _ in 0..2 {
        bench.order(bench.now(), Order::Standby).unwrap();
        let _ = service(&mut bench, curve(40));
    }
    bench.run_to(100_000);
    assert_eq!(bench.event_kinds(), [Event::ServiceSent(curve(40))]);
}

/// A service command that needs a stopped engine does not go out once the engine is ordered to run.
#[test]
fn an_order_to_run_ends_a_waiting_service_command() {
    for command in [action(Action::Drain), action(Action::OpenPump), curve(40)] {
        let mut bench = ecu(5);
        bench.order(bench.now(), Order::Standby).unwrap();
        turns(&mut bench, 1);
        // The rate has the next turn, so the command waits until the order to run is out.
        service(&mut bench, action(Action::Rate20Hz)).unwrap();
        service(&mut bench, command).unwrap();
        bench.order(bench.now(), throttle(0)).unwrap();
        let frames = turns(&mut bench, 200);
        let run = frames.iter().position(|frame| frame[..] == zk::throttle(RUN, 0)).expect("runs");
        let behind = &frames[run..];
        // The rate is asked for again until the ECU confirms it.
        let rate = zk::action(7);
        assert!(
            behind.iter().all(|frame| id(frame) == 1 || frame[..] == rate),
            "{command:?}: {:?}",
            ids(behind)
        );
        let told = bench.event_kinds();
        assert!(
            told.contains(&Event::ServiceFailed(command)) && !told.contains(&Event::ServiceSent(command))
        );
    }
}

/// ZK-13: an unlock that was not sent unlocks nothing, so it is sent again before the command.
#[test]
fn zk_13_an_unlock_that_failed_is_sent_again() {
    let mut bench = ecu(3).by_hand();
    bench.order(bench.now(), Order::Standby).unwrap();
    service(&mut bench, curve(40)).unwrap();
    bench.run_to(50_000);
    assert_eq!(bench.bytes(), [zk::unlock()]);
    bench.not_sent_at(51_000, NotSent::Failed);
    assert_eq!(bench.frames(), []);
    let mut sent = Vec::new();
    for _ in 0..20 {
        let t = bench.now() + 10_000;
        bench.run_to(t);
        if bench.busy() {
            bench.sent_at(t);
        }
        sent.extend(bench.bytes());
    }
    let at = sent.iter().position(|frame| id(frame) == 5).expect("the command");
    assert_eq!(sent[at - 1], zk::unlock());
    assert_eq!(sent.iter().filter(|frame| id(frame) == 5).count(), 1);
}

/// A plain action goes out once, between two frames of the demand.
#[test]
fn an_action_goes_out_once() {
    for one in Action::ALL.into_iter().filter(|one| !(7..=9).contains(&one.parameter())) {
        let mut bench = ecu(5);
        bench.order(bench.now(), Order::Standby).unwrap();
        service(&mut bench, action(one)).unwrap();
        let frames = turns(&mut bench, 60);
        let sent: Vec<_> = frames.iter().filter(|frame| id(frame) != 1).cloned().collect();
        assert_eq!(sent, [zk::action(one.parameter())]);
        let told = bench.event_kinds();
        assert_eq!(told.iter().filter(|event| **event == Event::ServiceSent(action(one))).count(), 1);
    }
}

/// An action is told as sent when its last stop bit is out.
#[test]
fn an_action_is_told_when_it_is_out() {
    let mut bench = ecu(5);
    bench.order(bench.now(), Order::Standby).unwrap();
    service(&mut bench, action(Action::Drain)).unwrap();
    bench.run_to(54_166);
    assert_eq!((bench.bytes().len(), bench.events()), (1, vec![]));
    bench.run_to(54_167);
    assert_eq!(bench.events(), [(54_167, Event::ServiceSent(action(Action::Drain)))]);
}

/// A service command that never gets through is tried three times, and has then failed.
#[test]
fn a_service_command_that_never_gets_through_has_failed() {
    for command in [action(Action::Drain), curve(40)] {
        let mut bench = ecu(5).by_hand();
        let tried = match command {
            Service::Zk(ZkService::Action(one)) => zk::action(one.parameter()),
            _ => zk::unlock(),
        };
        bench.order(bench.now(), Order::Standby).unwrap();
        service(&mut bench, command).unwrap();
        let mut attempts = 0;
        for _ in 0..1_000 {
            bench.run_to(bench.now() + 10_000);
            attempts += bench.bytes().into_iter().filter(|frame| frame[..] == tried).count();
            if bench.busy() {
                bench.not_sent_at(bench.now(), NotSent::Failed);
            }
        }
        let told = bench.event_kinds();
        let count = |event| told.iter().filter(|told| **told == event).count();
        assert_eq!((attempts, count(Event::ServiceFailed(command))), (3, 1), "{command:?}");
        assert_eq!(count(Event::ServiceSent(command)), 0);
    }
}

/// An action that the UART did not send is sent again, and is told when it went out.
#[test]
fn an_action_that_was_not_sent_is_sent_again() {
    let mut bench = ecu(5).by_hand();
    bench.order(bench.now(), Order::Standby).unwrap();
    service(&mut bench, action(Action::ClosePump)).unwrap();
    bench.run_to(50_000);
    assert_eq!(bench.bytes(), [zk::action(13)]);
    bench.not_sent_at(51_000, NotSent::Failed);
    assert!(!bench.event_kinds().contains(&Event::ServiceSent(action(Action::ClosePump))));
    let mut sent_again = 0;
    for _ in 0..100 {
        let t = bench.now() + 10_000;
        bench.run_to(t);
        sent_again += bench.bytes().into_iter().filter(|frame| frame[..] == zk::action(13)).count();
        if bench.busy() {
            bench.sent_at(t);
        }
    }
    let told = bench.event_kinds();
    let count = |event| told.iter().filter(|told| **told == event).count();
    assert_eq!((sent_again, count(Event::ServiceSent(action(Action::ClosePump)))), (1, 1));
    assert_eq!(count(Event::ServiceFailed(action(Action::ClosePump))), 0);
}

// ---------------------------------------------------------------------------------------------
// Rate
// ---------------------------------------------------------------------------------------------

/// ZK-11: when status ID 6 shows another rate it is set by ID 2, and confirmed by ID 6.
#[test]
fn zk_11_rate_is_set_and_confirmed() {
    for (wanted, parameter) in [(Rate::Hz20, 7), (Rate::Hz50, 8), (Rate::Hz100, 9)] {
        for reported in 0..=3u8 {
            let mut bench = link(Config { rate: wanted, ..Config::DEFAULT }, LINE);
            bench.order(0, Order::Standby).unwrap();
            bench.run_to(300_000);
            assert!(bench.bytes().iter().all(|frame| id(frame) != 2), "not before ID 6 has said it");
            bench.receive(&zk::identity(160, 1, reported));
            bench.run_to(500_000);
            let asked: Vec<_> = bench.bytes().into_iter().filter(|frame| id(frame) == 2).collect();
            if reported == rate_code(wanted) {
                assert_eq!(asked, Vec::<Vec<u8>>::new());
            } else {
                assert_eq!(asked, [zk::action(parameter)]);
                assert!(!bench.event_kinds().contains(&Event::RateConfirmed(wanted)));
                bench.receive(&zk::identity(160, 1, rate_code(wanted)));
            }
            assert!(bench.event_kinds().contains(&Event::RateConfirmed(wanted)), "{wanted:?} {reported}");
            bench.run_to(5_000_000);
            assert!(bench.bytes().iter().all(|frame| id(frame) != 2), "confirmed");
        }
    }
}

/// ZK-11: asked again every second, five times, then given up; an ECU that was lost is asked anew.
#[test]
fn zk_11_rate_is_retried_and_given_up() {
    let mut bench = link(Config { rate: Rate::Hz50, ..Config::DEFAULT }, LINE);
    bench.order(0, Order::Standby).unwrap();
    for turn in 0..500 {
        bench.rx(turn * 20_000 + 5_000, &zk::identity(160, 4, 0));
    }
    let asked: Vec<u64> =
        bench.frames().into_iter().filter(|(_, frame)| id(frame) == 2).map(|(at, _)| at).collect();
    assert_eq!(asked.len(), 5);
    assert!(asked.windows(2).all(|pair| (1_000_000..=1_040_000).contains(&(pair[1] - pair[0]))), "{asked:?}");
    let given_up =
        bench.event_kinds().into_iter().filter(|event| *event == Event::RateNotConfirmed(Rate::Hz50));
    assert_eq!(given_up.count(), 1);
    let t = bench.now() + 2_000_000; // silence
    bench.rx(t, &zk::identity(160, 4, 0));
    bench.run_to(t + 100_000);
    assert!(bench.bytes().contains(&zk::action(8).to_vec()));
}

/// ZK-11: an ECU that falls back to another rate while it is heard is set again.
#[test]
fn zk_11_rate_is_watched() {
    let mut bench = ecu(4);
    bench.receive(&zk::identity(160, 4, 2));
    bench.run_to(200_000);
    assert!(bench.bytes().contains(&zk::action(7).to_vec()));
}

/// ZK-11: a rate by service command: refused where the line cannot carry it; the turns follow it.
#[test]
fn zk_11_rate_by_service_command() {
    for (baud, rate, fits) in [
        (2400, Action::Rate20Hz, true),
        (2400, Action::Rate50Hz, false),
        (4800, Action::Rate50Hz, true),
        (4800, Action::Rate100Hz, false),
        (9600, Action::Rate100Hz, true),
    ] {
        let mut bench = link(Config::DEFAULT, Line::new(baud));
        bench.receive(&zk::identity(160, 4, 0));
        let expected = if fits { Ok(()) } else { Err(Rejected::RateTooFast) };
        assert_eq!(service(&mut bench, action(rate)), expected, "{baud} {rate:?}");
    }
    let mut bench = ecu(4);
    bench.order(bench.now(), Order::Standby).unwrap();
    service(&mut bench, action(Action::Rate100Hz)).unwrap();
    bench.rx(205_000, &zk::identity(160, 4, 2));
    assert!(bench.bytes().contains(&zk::action(9).to_vec()));
    assert_eq!(bench.event_kinds(), [Event::RateConfirmed(Rate::Hz100)]);
    bench.run_to(1_205_000);
    assert_eq!(bench.frames().len(), 100);
}

// ---------------------------------------------------------------------------------------------
// Pressure
// ---------------------------------------------------------------------------------------------

/// ZK-14: once a second, while the ECU asks and a fresh pressure is known; never one made up.
#[test]
fn zk_14_pressure_once_a_second_when_asked_known_and_fresh() {
    let sent = |bench: &mut Bench<ZkLink>| -> Vec<(u64, Vec<u8>)> {
        bench.frames().into_iter().filter(|(_, frame)| id(frame) == 8).collect()
    };
    let asks = |bench: &mut Bench<ZkLink>, to: u64, asks: bool| {
        while bench.now() < to {
            let t = bench.now() + 100_000;
            bench.rx(t, &zk::idle(30, asks));
        }
    };
    let mut bench = ecu(4);
    bench.order(bench.now(), Order::Standby).unwrap();
    asks(&mut bench, 3_000_000, true);
    assert_eq!(sent(&mut bench), [], "none known");
    pressure(&mut bench, 1013);
    asks(&mut bench, 6_000_000, true);
    let first = sent(&mut bench);
    assert_eq!(first.len(), 3);
    assert!(first.iter().all(|(_, frame)| frame[..] == zk::pressure(1013)));
    assert!(
        first.windows(2).all(|pair| (1_000_000..=1_050_000).contains(&(pair[1].0 - pair[0].0))),
        "{first:?}"
    );
    asks(&mut bench, 20_000_000, true);
    let stale = sent(&mut bench);
    assert!(stale.last().is_none_or(|(at, _)| *at <= 8_010_000), "5 s old: {stale:?}");
    asks(&mut bench, 20_100_000, false);
    pressure(&mut bench, 990);
    asks(&mut bench, 22_000_000, false);
    assert_eq!(sent(&mut bench), [], "not asked");
    asks(&mut bench, 23_000_000, true);
    assert_eq!(sent(&mut bench)[0].1, zk::pressure(990));
}

/// ZK-14, ZK-7: an ECU below version 4 has no ESR and no ID 8, whatever its bits say.
#[test]
fn zk_14_no_pressure_below_version_4() {
    for (version, expected) in [(3, false), (4, true)] {
        let mut bench = ecu(version);
        pressure(&mut bench, 1013);
        bench.receive(&zk::idle(30, true));
        bench.run_to(3_000_000);
        assert_eq!(bench.bytes().iter().any(|frame| id(frame) == 8), expected, "version {version}");
    }
}

// ---------------------------------------------------------------------------------------------
// Whether it is heard, and what is known
// ---------------------------------------------------------------------------------------------

/// Up after one frame, because it has a CRC; lost by the timer to the tick, once; the turns go on (ZK-10).
#[test]
fn zk_10_silence_is_lost_once_and_the_turns_go_on() {
    let mut bench = link(Config::DEFAULT, LINE);
    assert_eq!(bench.machine.state(), LinkState::Silent);
    bench.rx(123_456, &zk::state(STATE_STANDBY));
    assert_eq!((bench.machine.state(), bench.machine.last_rx()), (LinkState::Up, Some(us(123_456))));
    bench.events();
    bench.run_to(623_455);
    assert_eq!((bench.machine.state(), bench.event_kinds()), (LinkState::Up, vec![]));
    bench.run_to(623_456);
    assert_eq!((bench.machine.state(), bench.event_kinds()), (LinkState::Lost, vec![Event::LinkLost]));
    bench.frames();
    bench.run_to(10_623_456);
    assert_eq!((bench.frames().len(), bench.event_kinds()), (200, vec![]));
    bench.receive(&zk::state(STATE_STANDBY));
    assert_eq!(
        (bench.machine.state(), bench.event_kinds()),
        (LinkState::Up, vec![Event::LinkUp, Event::Phase(Phase::Standby)])
    );
}

/// ZK-15: an unknown ID is a frame: it counts, it keeps the link up, and its bytes are kept.
#[test]
fn zk_15_unknown_ids_are_frames() {
    for id in [0, 10, 11, 12, 13, 14] {
        let mut bench = link(Config::DEFAULT, LINE);
        let frame = zk::status(id, 55_550, [1, 2, 3]);
        bench.receive(&frame);
        assert_eq!(bench.machine.state(), LinkState::Up);
        let counters = bench.machine.counters();
        assert_eq!((counters.frames, counters.unknown_frames, counters.bytes_skipped), (1, 1, 0));
        let report = bench.machine.report();
        assert_eq!(report.unknown.unwrap().value.as_bytes(), frame);
        assert_eq!(report.rpm.unwrap().value.get(), 55_550, "every status carries the rpm");
    }
}

/// ZK-15: unknown states, errors and switches keep their number.
#[test]
fn zk_15_unknown_numbers_are_kept() {
    let mut bench = link(Config::DEFAULT, LINE);
    // state 25, error 29, switch 3
    bench.receive(&zk::status(1, 0, [25 | (29 << 5 & 0xE0), 29 >> 3 | 3 << 5, 76]));
    let report = bench.machine.report();
    assert_eq!((report.state.unwrap().value.code, report.phase.unwrap().value), (25, Phase::Unknown));
    assert_eq!(report.switch.unwrap().value, ReportedSwitch::Unknown(3));
    let Faults::Zk(error) = report.faults.unwrap().value else { panic!("ZK") };
    assert_eq!((error.code(), error.name()), (29, "unknown"));
}

/// ZK-8, ZK-5: the state in plain words and the switch that the ECU says it obeys.
#[test]
fn zk_8_phases_and_reported_switch() {
    for (states, phase) in [
        (0..=0, Phase::Stopped),
        (1..=1, Phase::Standby),
        (2..=5, Phase::Starting),
        (6..=11, Phase::Running),
        (12..=12, Phase::Cooling),
        (13..=13, Phase::Starting),
        (14..=19, Phase::Service),
        (20..=31, Phase::Unknown),
    ] {
        for state in states {
            for (code, switch) in
                [(0, ReportedSwitch::Stop), (1, ReportedSwitch::Standby), (2, ReportedSwitch::Run)]
            {
                let mut bench = link(Config::DEFAULT, LINE);
                bench.receive(&zk::status(1, 0, [state, code << 5, 0]));
                let report = bench.machine.report();
                assert_eq!(
                    (report.phase.unwrap().value, report.switch.unwrap().value),
                    (phase, switch),
                    "{state}"
                );
            }
        }
    }
}

/// Every status ID lands in the report, with the time that it came.
#[test]
fn zk_5_values_carry_their_time() {
    let mut bench = link(Config::DEFAULT, LINE);
    bench.rx(1_000, &zk::identity(160, 5, 0));
    for (t, frame) in [
        (2_000, zk::status(1, 12_340, [11, 0b10 << 5 | 0b010 << 2, 38])),
        (3_000, zk::status(3, 12_350, [45, 0x34, 0x12])),
        (4_000, zk::status(4, 12_360, [0x2C, 0x01 | 2 << 1, 10])),
        (5_000, zk::status(5, 12_370, [100, 40, 30])),
        (6_000, zk::status(7, 12_380, [0x10, 0x01 | 5 << 2, 1])),
        (7_000, zk::status(8, 12_390, [33, 0x12, 0x34])),
        (8_000, zk::status(9, 12_400, [95, 0, 0])),
    ] {
        bench.rx(t, &frame);
    }
    let report = *bench.machine.report();
    macro_rules! check {
        ($($field:ident.$get:ident = $value:expr, at $at:expr;)+) => {
            $(
                let value = report.$field.unwrap();
                assert_eq!((value.value.$get(), value.at), ($value, us($at)), stringify!($field));
            )+
        };
    }
    check! {
        max_rpm.get = 160_000, at 1_000;
        version.get = 5, at 1_000;
        rate.hz = 20, at 1_000;
        egt.tenths = (512 + 38 - 50) * 10, at 2_000;
        throttle.tenths = 450, at 3_000;
        pressure.get = 0x1234 * 2, at 3_000;
        current.get = 30_000, at 4_000;           // 0x12C = 300 × 0.1 A
        thrust.get = (2 * 256 + 10) * 100, at 4_000;
        ignition_pump.get = 2_000, at 5_000;
        fuel_flow.get = 0x110 * 10, at 6_000;
        fuel_total.get = (64 + 5) * 100, at 6_000;
        idle_rpm.get = 33_000, at 7_000;
        startup.as_millis = 0x234 * 100, at 7_000;
        ecu_temperature.tenths = 450, at 8_000;
        rpm.get = 12_400, at 8_000;
    }
    assert_eq!((report.curve_increase.unwrap().value, report.curve_decrease.unwrap().value), (40, 30));
    assert_eq!((report.closed_loop.unwrap().value, report.pressure_requested.unwrap().value), (true, false));
    assert_eq!(report.state.unwrap().value.name, "running");
}

/// ZK-5: a throttle above 100 % has no meaning and is not taken over.
#[test]
fn zk_5_a_throttle_above_100_percent_is_not_taken_over() {
    let mut bench = link(Config::DEFAULT, LINE);
    bench.receive(&zk::status(3, 0, [101, 0, 0]));
    assert_eq!(bench.machine.report().throttle, None);
    bench.receive(&zk::status(3, 0, [100, 0, 0]));
    assert_eq!(bench.machine.report().throttle.unwrap().value, Throttle::FULL);
}

/// Events when something changes, and only then.
#[test]
fn events_of_a_start() {
    let mut bench = link(Config::DEFAULT, LINE);
    let version = Version::new(4).unwrap();
    for (frame, events) in [
        (zk::state(STATE_STOP), vec![Event::LinkUp, Event::Phase(Phase::Stopped)]),
        (zk::state(STATE_STOP), vec![]),
        (zk::identity(160, 4, 0), vec![Event::VersionKnown(version), Event::RateConfirmed(Rate::Hz20)]),
        (zk::identity(160, 4, 0), vec![]),
        (zk::state(STATE_IGNITION), vec![]),
        (zk::state(4), vec![Event::Phase(Phase::Starting)]),
        (zk::state(STATE_RUNNING), vec![]),
        (zk::state(STATE_RUNNING), vec![Event::Phase(Phase::Running)]),
    ] {
        bench.receive(&frame);
        assert_eq!(bench.event_kinds(), events, "{frame:02x?}");
    }
    let faulty = zk::status(1, 0, [STATE_RUNNING | 4 << 5, 1, 76]); // error 0b01100: main valve
    bench.receive(&faulty);
    assert_eq!(bench.event_kinds(), [], "one report is no fault");
    bench.receive(&faulty);
    let events = bench.event_kinds();
    let [Event::Faults(Faults::Zk(error))] = events[..] else { panic!("{events:?}") };
    assert_eq!(error.name(), "main-valve");
}

/// ZK-16: a corrupted frame costs itself; the link counts it.
#[test]
fn zk_16_a_corrupted_frame_is_counted() {
    let mut bench = link(Config::DEFAULT, LINE);
    let mut bad = zk::status(1, 0, [STATE_RUNNING, 0, 76]); // none of its bytes looks like a head
    bad[5] ^= 0x10;
    bench.receive(&[&bad[..], &zk::state(STATE_STOP)].concat());
    let counters = bench.machine.counters();
    assert_eq!((counters.crc_failures, counters.frames, counters.bytes_skipped), (1, 1, 7));
    assert_eq!(bench.machine.report().phase.unwrap().value, Phase::Stopped);
}

// ---------------------------------------------------------------------------------------------
// Any schedule
// ---------------------------------------------------------------------------------------------

#[derive(Clone, Debug)]
enum Step {
    Status([u8; 7]),
    Noise(Vec<u8>),
    Order(Order),
    Service(Service),
    Pressure(u16),
    /// A wake-up so much behind or before the deadline.
    Timeout,
    /// Nobody looks for so long.
    Asleep(u64),
}

fn any_order() -> impl Strategy<Value = Order> {
    prop_oneof![
        Just(Order::Standby),
        Just(Order::EmergencyStop),
        (0..=1000u16).prop_map(throttle),
        (0..=260_000u32).prop_map(rpm),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        3 => (0..=14u8, 0..600_000u32, any::<[u8; 3]>())
            .prop_map(|(id, rpm, rest)| Step::Status(zk::status(id, rpm, rest))),
        3 => (0..=24u8).prop_map(|state| Step::Status(zk::state(state))),
        2 => (1..=255u8, 0..=6u8, 0..=3u8).prop_map(|(max, version, rate)| Step::Status(zk::identity(max, version, rate))),
        1 => (0..=60u8, any::<bool>()).prop_map(|(idle, asks)| Step::Status(zk::idle(idle, asks))),
        1 => prop::collection::vec(any::<u8>(), 1..9).prop_map(Step::Noise),
        3 => any_order().prop_map(Step::Order),
        2 => prop_oneof![
            (0..13usize).prop_map(|one| action(Action::ALL[one])),
            (10..=70u8).prop_map(curve),
            (0..=5100u32).prop_map(ignition),
        ].prop_map(Step::Service),
        1 => (0..=1023u16).prop_map(Step::Pressure),
        1 => Just(Step::Timeout),
        1 => (0..700_000u64).prop_map(Step::Asleep),
    ]
}

proptest! {
    /// Whatever comes whenever: never two transmissions at once and no deadline that is over (the bench checks
    /// both); every frame is one of the document; SW 0 never goes out (ZK-8); an unlock is followed by its command
    /// or by an order that calls it off (ZK-13); behind an emergency stop there is nothing but stops; silence yields "lost" once.
    #[test]
    fn zk_8_zk_13_any_schedule(
        split_switch in any::<bool>(),
        baud in prop::sample::select(&[9600u32, 19_200, 115_200][..]),
        rate in prop::sample::select(&[Rate::Hz20, Rate::Hz50, Rate::Hz100][..]),
        steps in prop::collection::vec((0..120_000u64, step()), 1..60),
    ) {
        let line = Line::new(baud);
        let mut bench = link(Config { rate, split_switch }, line);
        let mut frames = Vec::new();
        let mut stopped_from = None;
        // Before these frames an order came that ends a service command.
        let mut called_off = Vec::new();
        for (wait, step) in steps {
            bench.run_to(bench.now() + wait);
            frames.extend(bench.bytes());
            match step {
                Step::Status(frame) => bench.receive(&frame),
                Step::Noise(bytes) => bench.receive(&bytes),
                Step::Order(order) => {
                    if bench.order(bench.now(), order).is_ok() {
                        if order != Order::Standby {
                            called_off.push(frames.len());
                        }
                        match order {
                            // From the very next frame on.
                            Order::EmergencyStop => stopped_from = stopped_from.or(Some(frames.len())),
                            _ => {
                                check_stops(&frames, stopped_from.take())?;
                            }
                        }
                    }
                }
                Step::Service(command) => drop(service(&mut bench, command)),
                Step::Pressure(hectopascals) => pressure(&mut bench, hectopascals),
                Step::Timeout => {
                    let now = bench.now();
                    bench.timeout_at(now);
                }
                Step::Asleep(long) => {
                    let t = bench.now() + long;
                    if !bench.busy() {
                        bench.timeout_at(t);
                        prop_assert!(bench.deadline().is_none_or(|deadline| deadline > t));
                    }
                }
            }
            frames.extend(bench.bytes());
        }
        check_stops(&frames, stopped_from)?;
        for (at, pair) in frames.windows(2).enumerate() {
            let over = called_off.contains(&(at + 1)) && matches!(id(&pair[1]), 1 | 6 | 7);
            prop_assert!(id(&pair[0]) != 3 || matches!(id(&pair[1]), 4 | 5) || over, "{:02x?}", pair);
            prop_assert!(!matches!(id(&pair[1]), 4 | 5) || id(&pair[0]) == 3, "{:02x?}", pair);
        }
        for frame in &frames {
            let bytes: [u8; 4] = frame[..].try_into().expect("four bytes");
            prop_assert!(jetlink::ecu::zk::codec::Control::decode(bytes).is_ok(), "{:02x?}", bytes);
            prop_assert_ne!(switch_of(frame), Some(PWM), "{:02x?}", bytes);
        }
        bench.events();
        let was_lost = bench.machine.state() == LinkState::Lost;
        bench.run_to(bench.now() + 5_000_000);
        let lost = bench.event_kinds().into_iter().filter(|event| *event == Event::LinkLost).count();
        prop_assert_eq!(lost, usize::from(!was_lost));
        prop_assert_eq!(bench.machine.state(), LinkState::Lost);
    }
}

fn switch_of(frame: &[u8]) -> Option<u8> {
    match id(frame) {
        1 => Some(frame[1] >> 2 & 3),
        6 => Some(frame[2] & 3),
        _ => None,
    }
}

/// The frames behind a stop are stops.
fn check_stops(frames: &[Vec<u8>], from: Option<usize>) -> Result<(), TestCaseError> {
    for frame in from.map_or(&[][..], |from| &frames[from..]) {
        prop_assert_eq!(switch_of(frame), Some(STOP), "{:02x?} behind an emergency stop", frame);
    }
    Ok(())
}
