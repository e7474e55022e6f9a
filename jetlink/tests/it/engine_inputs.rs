//! What an engine gets from its runner and its board, and what it answers them: frames, lost bytes, the pressure, and who has armed.

use jetlink::command::{Command, Origin};
use jetlink::line::LineError;
use jetlink::units::Hectopascals;

use crate::support::frames::zk as zk_frames;
use crate::support::scenario::{BOTH, Ecu, FRAME_PERIOD_US, Reports, SECOND, Scenario, TURNING, percent};
use bench::by_hand::at_us;

/// A frame waits for the supervision from its last byte on, once.
#[test]
fn a_good_frame_waits_for_the_supervision_once() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        let frame = ecu.frame(Reports::Running, scenario.values);
        let (most, last) = frame.split_at(frame.len() - 1);
        let now = at_us(scenario.now_us() + FRAME_PERIOD_US);
        let engine = &mut scenario.bench.machine;
        assert!(!engine.has_frame_to_supervise(), "{ecu:?}: before it");
        assert_eq!(engine.receive(now, most), most.len());
        assert!(!engine.has_frame_to_supervise(), "{ecu:?}: in the middle of it");
        assert_eq!(engine.receive(now, last), 1);
        assert!(engine.has_frame_to_supervise(), "{ecu:?}: after it");
        engine.supervise();
        assert!(!engine.has_frame_to_supervise(), "{ecu:?}: it was supervised");
    }
}

/// A byte that is lost with its fault is counted, and damages the frame that it was part of. A line error beside it would damage the next.
#[test]
fn amt_1_a_lost_byte_is_counted_and_damages_no_later_set() {
    let mut scenario = Scenario::started(Ecu::Amt, percent(50));
    let set = Ecu::Amt.frame(Reports::Running, scenario.values);
    for (lost, damaged) in [(true, 0), (false, 1)] {
        let before = scenario.telemetry().counters;
        scenario.silent().pass_us(FRAME_PERIOD_US);
        if lost {
            scenario.bench.machine.byte_lost(LineError::Framing);
        } else {
            scenario.bench.machine.line_error(LineError::Framing);
        }
        scenario.bench.receive(&set);
        let after = scenario.telemetry().counters;
        assert_eq!(after.framing_errors - before.framing_errors, 1, "{lost}");
        assert_eq!(after.damaged_frames - before.damaged_frames, damaged, "{lost}");
    }
}

/// ZK-14: the pressure of the board goes to an ECU that requests it.
#[test]
fn zk_14_the_pressure_goes_to_an_ecu_that_requests_it() {
    for requested in [true, false] {
        let mut scenario = Scenario::started(Ecu::Zk, percent(50));
        scenario.reports = Some(Reports::Running);
        scenario.bench.act(|engine, now| engine.pressure(now, Hectopascals::new(1013).unwrap()));
        let esr = if requested { 0x20 } else { 0 };
        scenario.bench.receive(&zk_frames::status(8, TURNING, [5, esr, 0]));
        scenario.pass_us(2 * SECOND);
        let frames = scenario.bench.bytes();
        let sent = frames.iter().any(|frame| frame[..] == zk_frames::pressure(1013));
        assert_eq!(sent, requested, "{frames:x?}");
    }
}

/// A source is shown as one that has armed only while the engine is armed and its own last word was "arm".
#[test]
fn only_a_source_that_commanded_it_has_armed() {
    for ecu in BOTH {
        let mut scenario = Scenario::with(ecu, ecu.config());
        let armed = |scenario: &Scenario| {
            [Origin::Rc, Origin::Bench].map(|origin| scenario.bench.machine.is_armed_by(origin))
        };
        assert_eq!(armed(&scenario), [false, false], "{ecu:?}");
        scenario.command(Command::Arm).unwrap();
        assert_eq!(armed(&scenario), [true, false], "{ecu:?}: RC has");
        scenario.command_from(Command::Arm, Origin::Bench).unwrap();
        assert_eq!(armed(&scenario), [true, true], "{ecu:?}: both have");
        scenario.command(Command::EmergencyStop).unwrap();
        assert_eq!(armed(&scenario), [false, false], "{ecu:?}: a stop disarms");
        scenario.reports(Reports::Standby);
        scenario.command(Command::ReleaseStop).unwrap();
        for command in [Command::Disarm, Command::Arm] {
            scenario.command(command).unwrap();
        }
        assert_eq!(armed(&scenario), [true, true], "{ecu:?}: RC has, and the other's last word was \"arm\"");
        scenario.command(Command::Disarm).unwrap();
        assert_eq!(armed(&scenario), [false, false], "{ecu:?}: it has disarmed");
    }
}
