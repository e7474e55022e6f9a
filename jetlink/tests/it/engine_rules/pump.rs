//! An opened pump is closed.

use super::*;
use jetlink::command::Interlock;

fn closes(frames: &[Vec<u8>]) -> usize {
    frames.iter().filter(|frame| frame[..] == zk_frames::action(13)).count()
}

/// A pump that was opened, and a start: fuel into the engine before the ignition, and ClosePump into the run.
#[test]
fn a_start_closes_an_open_pump_before_the_engine_runs() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.command(action(zk::codec::Action::OpenPump)).unwrap();
    scenario.pass_us(4 * FRAME_PERIOD_US);
    let frames = scenario.bench.bytes();
    assert!(frames.contains(&zk_frames::action(12).to_vec()), "it is open");
    let answer = scenario.command(run(0));
    scenario.fly_us(run(0), Origin::Rc, 2 * SECOND);
    let at_start = closes(&scenario.bench.bytes());
    scenario.reports(Reports::Starting);
    scenario.fly_us(run(0), Origin::Rc, 10 * SECOND);
    scenario.reports(Reports::Running);
    scenario.fly_us(run(50), Origin::Rc, 10 * SECOND);
    scenario.bench.frames();
    scenario.fly_us(run(50), Origin::Rc, 20 * SECOND);
    let in_run = closes(&scenario.bench.bytes());
    assert!(
        answer != Ok(Accepted::InForce) || at_start > 0 && in_run == 0,
        "{answer:?}; ClosePump at the start {at_start}, to the running engine {in_run}"
    );
}

/// "ClosePump goes out ... until the pump voltage reads zero or ten were sent": a voltage from before the opening proves
/// nothing.
#[test]
fn a_pump_voltage_from_before_the_opening_does_not_confirm_the_closing() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    // ID 2: no pump voltage.
    scenario.bench.receive(&zk_frames::status(2, 0, [50, 60, 0]));
    scenario.command(action(zk::codec::Action::OpenPump)).unwrap();
    scenario.pass_us(3 * FRAME_PERIOD_US);
    let frames = scenario.bench.bytes();
    assert!(frames.contains(&zk_frames::action(12).to_vec()), "it is open");
    scenario.command(Command::Disarm).unwrap();
    scenario.pass_us(2 * SECOND);
    assert_eq!(closes(&scenario.bench.bytes()), 10);
}

/// "A pump that was opened is closed at ... silence of its source"; "a source that commands nothing counts as silent".
#[test]
fn a_pump_is_closed_when_its_source_is_only_present() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.command(action(zk::codec::Action::OpenPump)).unwrap();
    scenario.pass_us(4 * FRAME_PERIOD_US);
    scenario.bench.frames();
    scenario.fly_us(Command::Present, Origin::Rc, 5 * SECOND);
    assert!(closes(&scenario.bench.bytes()) > 0, "a source that commands nothing counts as silent");
}

/// An open pump; earlier frames and events are dropped.
fn pump_open() -> Scenario {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.command(action(zk::codec::Action::OpenPump)).unwrap();
    scenario.pass_us(3 * FRAME_PERIOD_US);
    assert!(scenario.bench.bytes().contains(&zk_frames::action(12).to_vec()), "it is open");
    scenario
}

/// "Fuel never flows into a hot engine at rest": the conditions that made the service safe have to last. The control: without a
/// change it stays open.
#[test]
fn a_pump_is_closed_when_the_engine_is_no_longer_cold_or_in_standby() {
    for (reports, egt, open) in [
        (Reports::Standby, 26, true),
        (Reports::Standby, 150, false),
        (Reports::Cooling, 26, false),
        (Reports::Starting, 26, false),
    ] {
        let mut scenario = pump_open();
        scenario.values.egt_celsius = egt;
        scenario.reports = Some(reports);
        // Before its source counts as silent.
        scenario.pass_us(6 * FRAME_PERIOD_US);
        assert_eq!(closes(&scenario.bench.bytes()) == 0, open, "{reports:?} at {egt} °C");
    }
}

/// "until the pump voltage reads zero or ten were sent": a failing transmitter has sent none.
#[test]
fn close_pump_frames_that_were_not_sent_do_not_count() {
    for why in [NotSent::TimedOut, NotSent::Failed] {
        let mut scenario = pump_open();
        scenario.bench = scenario.bench.clone().by_hand();
        scenario.command(Command::Disarm).unwrap();
        let fails_until = scenario.now_us() + 3 * SECOND;
        while scenario.now_us() < fails_until {
            scenario.pass_us(10_000);
            let now = scenario.now_us();
            if scenario.bench.busy() {
                scenario.bench.not_sent_at_us(now, why);
            }
        }
        scenario.bench.frames();
        while scenario.now_us() < fails_until + 3 * SECOND {
            scenario.pass_us(10_000);
            let now = scenario.now_us();
            if scenario.bench.busy() {
                scenario.bench.sent_at_us(now);
            }
        }
        let count = closes(&scenario.bench.bytes());
        assert!(
            (10..=11).contains(&count),
            "{why:?}: {count} frames of ClosePump after the transmitter works"
        );
    }
}

/// "ClosePump goes out after the first stop frame", even if it was being sent before the stop.
#[test]
fn a_stop_is_sent_before_the_next_close_pump_frame() {
    for wait in 0..40 {
        let mut scenario = pump_open();
        scenario.command(Command::Disarm).unwrap();
        scenario.pass_us(wait * 10_000);
        while scenario.bench.busy() {
            scenario.pass_us(1000);
        }
        scenario.bench.frames();
        scenario.command(Command::EmergencyStop).unwrap();
        let frames = scenario.bench.frames();
        assert_eq!(frames.len(), 1, "at once");
        assert_ne!(frames[0].1, zk_frames::action(13), "{wait}: ClosePump before the stop");
    }
}

/// "Every service that moves fuel or heats ... has a bound in time", whatever its source repeats and streams beside it.
#[test]
fn a_service_that_is_repeated_ends_after_its_time() {
    let open = action(zk::codec::Action::OpenPump);
    let opened = |scenario: &mut Scenario| {
        scenario.bench.bytes().iter().any(|frame| frame[..] == zk_frames::action(12))
    };
    for beside in [None, Some(Command::Standby)] {
        let mut scenario = pump_open();
        scenario.values.rpm = Some(0);
        let commands: Vec<_> =
            [Some(open), beside].into_iter().flatten().map(|command| (command, Origin::Rc)).collect();
        both(&mut scenario, &commands, 29 * SECOND);
        assert!(opened(&mut scenario), "{beside:?}: it is kept open");
        both(&mut scenario, &commands, 2 * SECOND);
        assert!(closes(&scenario.bench.bytes()) > 0, "{beside:?}");
        both(&mut scenario, &commands, 60 * SECOND);
        assert!(!opened(&mut scenario), "{beside:?}: it opens again by itself");
        assert_eq!(scenario.command(open), Err(Rejected::ServiceTime));
        // A source that pauses and commands again intends it.
        scenario.pass_us(SECOND);
        scenario.command(open).unwrap();
        scenario.pass_us(4 * FRAME_PERIOD_US);
        assert!(opened(&mut scenario), "{beside:?}");
    }
}

/// The time limit of an open pump is not extended, even if its service is repeated with pauses longer than the timeout of its source,
/// while other commands of that source keep it open.
#[test]
fn a_service_that_pauses_does_not_prolong_an_open_pump() {
    let open = action(zk::codec::Action::OpenPump);
    let mut scenario = pump_open();
    scenario.values.rpm = Some(0);
    // Refused: this uses up the permission, and from then on run has no effect.
    assert!(scenario.command(run(0)).is_err());
    let mut fly = |tenths: core::ops::Range<u64>| {
        scenario.bench.bytes();
        for tenth in tenths {
            if tenth % 8 == 0 {
                let _ = scenario.command(open);
            }
            assert!(scenario.command(run(0)).is_err());
            scenario.pass_us(SECOND / 10);
        }
        closes(&scenario.bench.bytes())
    };
    // The refused start closed it.
    fly(1..40);
    assert_eq!(fly(40..280), 0, "it is kept open");
    assert!(fly(280..340) > 0, "for service_time");
}

/// "A pump that was opened is closed at any stop, standby, disarm ... and after a reset": also one whose ten ClosePump frames did not
/// reach the ECU, which its voltage shows. Each of these events sends ten more, and no start is granted before.
#[test]
fn a_pump_that_still_has_a_voltage_is_closed_again_at_the_next_event() {
    // ID 2: the pump's voltage.
    let reports = |scenario: &mut Scenario, voltage: u8| {
        for _ in 0..2 {
            scenario.bench.receive(&zk_frames::status(2, 0, [50, 60, voltage]));
            scenario.pass_us(FRAME_PERIOD_US);
        }
    };
    for (voltage, again) in [(20, 10), (0, 0)] {
        for event in [Command::Disarm, Command::EmergencyStop, run(0)] {
            let mut scenario = pump_open();
            scenario.command(Command::Standby).unwrap();
            scenario.pass_us(2 * SECOND);
            assert_eq!(closes(&scenario.bench.bytes()), 10, "no voltage is reported");
            reports(&mut scenario, voltage);
            let refusals = scenario.start_refusals(run(0), Origin::Rc);
            assert_eq!(refusals.contains(&Rejected::Start(Interlock::PumpOpen)), again > 0, "{refusals:?}");
            assert_eq!(scenario.bench.machine.record().pump_open, again > 0);
            scenario.bench.frames();
            // A streamed standby is not a new event.
            scenario.fly_us(Command::Standby, Origin::Rc, 2 * SECOND);
            assert_eq!(closes(&scenario.bench.bytes()), 0);
            let answer = scenario.command(event);
            assert_eq!(answer.is_err(), event == run(0) && again > 0, "{answer:?}");
            scenario.pass_us(2 * SECOND);
            assert_eq!(closes(&scenario.bench.bytes()), again, "{event:?} with {voltage}");
            // A stream of stops or of refused starts is one event, whatever the voltage.
            if event != Command::Disarm {
                reports(&mut scenario, voltage);
                scenario.bench.frames();
                scenario.fly_us(event, Origin::Rc, 2 * SECOND);
                assert_eq!(closes(&scenario.bench.bytes()), 0, "{event:?} repeated");
            }
        }
    }
}

/// Ten frames to close the pump were sent while no voltage was received. A later voltage of zero shows that it is closed; the pump
/// voltage of an engine in flight is normal, and neither a disarm nor a reset closes the pump of a running engine.
#[test]
fn the_pump_of_a_running_engine_is_not_closed() {
    for zero_is_reported in [true, false] {
        let mut scenario = pump_open();
        scenario.command(Command::Standby).unwrap();
        scenario.pass_us(2 * SECOND);
        assert_eq!(closes(&scenario.bench.bytes()), 10);
        if zero_is_reported {
            scenario.bench.receive(&zk_frames::status(2, 0, [50, 60, 0]));
        }
        scenario.fly_us(Command::Standby, Origin::Rc, SECOND);
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce));
        scenario.reports(Reports::Starting);
        scenario.fly_us(run(0), Origin::Rc, 5 * SECOND);
        scenario.reports(Reports::Running);
        scenario.fly_us(run(50), Origin::Rc, 5 * SECOND);
        for _ in 0..3 {
            scenario.bench.receive(&zk_frames::status(2, TURNING, [50, 60, 30]));
            scenario.fly_us(run(50), Origin::Rc, FRAME_PERIOD_US);
        }
        assert!(!scenario.bench.machine.record().pump_open, "{zero_is_reported}");
        scenario.bench.frames();
        let mut reset = scenario.reset(Ecu::Zk.config());
        scenario.command(Command::Disarm).unwrap();
        scenario.fly_us(run(50), Origin::Rc, 2 * SECOND);
        reset.fly_us(run(50), Origin::Rc, 2 * SECOND);
        for flight in [&mut scenario, &mut reset] {
            assert_eq!(closes(&flight.bench.bytes()), 0, "{zero_is_reported}: {}", flight.order());
        }
    }
}

/// "A pump that was opened is closed ... after a reset": also after a loss of power, of which no record says that it is open. Its
/// voltage shows that, once the engine is known to be at rest.
#[test]
fn a_pump_that_is_found_open_is_closed() {
    for (voltage, frames) in [(20, 10), (0, 0)] {
        let mut scenario = Scenario::nothing_received(Ecu::Zk, Ecu::Zk.config());
        scenario.reports(Reports::Standby);
        for _ in 0..20 {
            scenario.bench.receive(&zk_frames::status(2, 0, [50, 60, voltage]));
            scenario.pass_us(5 * FRAME_PERIOD_US);
        }
        assert_eq!(scenario.order(), Order::Standby);
        assert_eq!(closes(&scenario.bench.bytes()), frames, "{voltage}");
    }
}

/// A service that opens the pump as soon as the engine is known to be at rest is not closed as one that was found open.
#[test]
fn a_pump_opened_soon_after_the_start_of_the_node_is_not_taken_for_one_that_was_open() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.command(action(zk::codec::Action::OpenPump)).unwrap();
    for _ in 0..10 {
        scenario.bench.receive(&zk_frames::status(2, 0, [50, 60, 20]));
        scenario.fly_us(action(zk::codec::Action::OpenPump), Origin::Rc, 2 * FRAME_PERIOD_US);
    }
    let frames = scenario.bench.bytes();
    assert!(frames.contains(&zk_frames::action(12).to_vec()), "it is open");
    assert_eq!(closes(&frames), 0);
}

/// An engine found running has a pump voltage. It is not closed in flight, nor by the standby that ends the run before the pump stops.
#[test]
fn the_pump_of_an_engine_that_is_found_running_is_not_closed() {
    let mut scenario = Scenario::nothing_received(Ecu::Zk, Ecu::Zk.config());
    scenario.reports(Reports::Running);
    for _ in 0..30 {
        scenario.bench.receive(&zk_frames::status(2, TURNING, [50, 60, 30]));
        scenario.fly_us(run(50), Origin::Rc, 5 * FRAME_PERIOD_US);
    }
    assert!(matches!(scenario.order(), Order::Run(_)), "{:?}", scenario.order());
    scenario.fly_us(Command::Standby, Origin::Rc, FRAME_PERIOD_US);
    scenario.bench.receive(&zk_frames::status(2, TURNING, [50, 60, 30]));
    scenario.fly_us(Command::Standby, Origin::Rc, SECOND);
    assert_eq!(closes(&scenario.bench.bytes()), 0);
}

/// An engine runs on because the wire to its ECU is cut: its standby was retained, and its pump is not closed before it is at rest.
#[test]
fn the_pump_of_an_engine_that_does_not_receive_its_standby_is_not_closed() {
    for (reports, closed) in [(Reports::Running, 0), (Reports::Standby, 10)] {
        let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
        scenario.command(Command::Standby).unwrap();
        let mut scenario = scenario.reset(Ecu::Zk.config());
        scenario.reports(reports);
        for _ in 0..20 {
            scenario.bench.receive(&zk_frames::status(2, 0, [50, 60, 30]));
            scenario.pass_us(5 * FRAME_PERIOD_US);
        }
        assert_eq!(scenario.order(), Order::Standby);
        assert_eq!(closes(&scenario.bench.bytes()), closed, "{reports:?}");
    }
}

/// A start opens the pump: the first voltage is normal, also while the engine is still reported at rest. Without the start, it is
/// that of a pump that was left open.
#[test]
fn the_pump_of_a_start_is_not_closed_while_its_engine_is_still_reported_at_rest() {
    for (command, closed) in [(run(0), 0), (Command::Standby, 10)] {
        let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config()).reset(Ecu::Zk.config());
        scenario.reports(Reports::Standby).pass_us(2 * SECOND);
        scenario.command(Command::Arm).unwrap();
        scenario.command(Command::Standby).unwrap();
        scenario.pass_us(COMMAND_PERIOD_US);
        scenario.command(command).unwrap();
        for _ in 0..20 {
            scenario.fly_us(command, Origin::Rc, COMMAND_PERIOD_US);
            scenario.bench.receive(&zk_frames::status(2, 0, [50, 60, 30]));
        }
        assert_eq!(matches!(scenario.order(), Order::Run(_)), closed == 0, "{}", scenario.order());
        assert_eq!(closes(&scenario.bench.bytes()), closed, "{command:?}");
    }
}

/// A voltage of zero confirmed that the pump was closed: after a flight, a voltage is that of the engine that stops. A pump whose
/// closing was never confirmed is closed again.
#[test]
fn the_pump_that_was_confirmed_closed_before_a_flight_is_not_closed_after_it() {
    for (voltage, closed) in [(Some(0), 0), (None, 10)] {
        let mut scenario = pump_open();
        scenario.command(Command::Standby).unwrap();
        scenario.pass_us(2 * SECOND);
        if let Some(voltage) = voltage {
            scenario.bench.receive(&zk_frames::status(2, 0, [50, 60, voltage]));
        }
        scenario.fly_us(Command::Standby, Origin::Rc, SECOND);
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce));
        for reports in [Reports::Starting, Reports::Running] {
            scenario.reports(reports);
            scenario.fly_us(run(0), Origin::Rc, SECOND);
        }
        scenario.bench.receive(&zk_frames::status(2, TURNING, [50, 60, 30]));
        scenario.bench.frames();
        scenario.shut_down().unwrap();
        assert_eq!(scenario.order(), Order::Standby);
        assert_eq!(scenario.bench.machine.record().pump_open, closed > 0, "{voltage:?}");
        scenario.command(Command::Disarm).unwrap();
        scenario.pass_us(2 * SECOND);
        assert_eq!(closes(&scenario.bench.bytes()), closed, "{voltage:?}");
    }
}
