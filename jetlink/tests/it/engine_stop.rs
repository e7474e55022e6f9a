//! The emergency stop, and what happens after a reset. For both ECUs, to the tick.

use jetlink::command::{Accepted, Command, Demand, Interlock, Order, Origin, Rejected};
use jetlink::ecu::zk::codec::Action;
use jetlink::ecu::{Service, amt, zk};
use jetlink::engine::Engine;
use jetlink::engine::retained::RetainedState;
use jetlink::event::{Event, LossStage};
use jetlink::link::LinkRecord;
use jetlink::report::LinkState;

use crate::support::frames::{amt as amt_frames, zk as zk_frames};
use crate::support::scenario::{
    ALL, BOTH, Ecu, FRAME_PERIOD_US, Reports, SECOND, Scenario, TURNING, Values, Wire, percent, rpm, run,
};
use bench::by_hand::{at_us, micros};

fn drain() -> Command {
    Command::Service(Service::Zk(zk::config::Service::Action(Action::Drain)))
}

// ---------------------------------------------------------------------------------------------
// Emergency stop
// ---------------------------------------------------------------------------------------------

/// AMT: in the reply to the very next frame. ZK: out of slot, at once, and again in every slot.
#[test]
fn a_stop_is_sent_at_once() {
    for after in [0, 1, 7_000, 20_000, 49_999] {
        let mut amt = Scenario::started(Ecu::Amt, percent(50));
        amt.pass_us(after);
        amt.sent();
        amt.command(Command::EmergencyStop).unwrap();
        amt.pass_us(FRAME_PERIOD_US);
        assert_eq!(amt.sent(), [Wire::Stop], "{after}");

        let mut zk = Scenario::started(Ecu::Zk, percent(50));
        zk.pass_us(after);
        let busy = zk.bench.busy();
        zk.bench.frames();
        zk.command(Command::EmergencyStop).unwrap();
        let at = zk.now_us();
        zk.pass_us(20 * FRAME_PERIOD_US);
        let frames = zk.bench.frames();
        // A frame takes 4.2 ms.
        assert!(frames[0].0 - at <= if busy { 4_200 } else { 0 }, "{after}: {frames:?}");
        assert!(frames.len() >= 20);
        for (at, bytes) in frames {
            let stops = bytes == zk_frames::throttle_tenths(1, 0) || bytes == zk_frames::mode(0, 1);
            assert!(stops, "{bytes:02x?} at {at}");
        }
    }
}

/// Nothing delays a stop: neither a flood of commands nor events that nobody takes.
#[test]
fn a_stop_waits_for_nothing() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.pass_us(FRAME_PERIOD_US - 1);
        let now = at_us(scenario.now_us());
        // Nobody takes frames or events meanwhile.
        let machine = &mut scenario.bench.machine;
        for percent in (0..=100).cycle().take(10_000) {
            machine.command(now, run(percent), Origin::Rc, true).unwrap();
            let refused = machine.command(now, drain(), Origin::Bench, true);
            assert!(refused.is_err() || refused == Ok(Accepted::Behind(Origin::Rc)));
            machine
                .command(now, if percent % 2 == 0 { Command::Arm } else { Command::Disarm }, Origin::Rc, true)
                .unwrap();
        }
        machine.command(now, Command::EmergencyStop, Origin::Bench, true).unwrap();
        for percent in (0..=100).cycle().take(10_000) {
            assert_eq!(machine.command(now, run(percent), Origin::Rc, true), Err(Rejected::StopLatched));
        }
        scenario.pass_us(20 * FRAME_PERIOD_US);
        let sent = scenario.sent();
        assert!(sent.len() >= 10 && sent.iter().all(|wire| *wire == Wire::Stop), "{ecu:?} {sent:?}");
    }
}

/// AMT-10, ZK-8: latched: it stays on the wire whatever is commanded, reported or lost, until it is released.
#[test]
fn a_stop_is_latched() {
    for ecu in BOTH {
        for reports in ALL {
            let config = ecu.with(|s| s.loss.standby_after = Some(micros(500_000)));
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            scenario.reports(reports);
            assert_eq!(scenario.command(Command::EmergencyStop), Ok(Accepted::InForce));
            for command in [Command::Standby, run(0), run(50), Command::HandOverToPwm, drain()] {
                for origin in Origin::SOURCES {
                    let answer = scenario.command_from(command, origin);
                    assert_eq!(answer, Err(Rejected::StopLatched), "{ecu:?} {command:?} {origin:?}");
                }
            }
            assert_eq!(scenario.command(Command::Arm), Err(Rejected::StopLatched));
            assert!(!scenario.telemetry().armed);
            scenario.pass_us(20 * SECOND).silent().pass_us(5 * SECOND).reports(reports);
            let telemetry = scenario.telemetry();
            assert!(telemetry.stop_latched);
            assert_eq!((telemetry.ordered.order, telemetry.loss), (Order::EmergencyStop, LossStage::None));
            assert_eq!(scenario.wire(), Wire::Stop, "{ecu:?} {reports:?}");
        }
    }
}

/// A stop of any source wins over any other, that source's own stream included.
#[test]
fn a_stop_of_any_source_wins_over_any_other() {
    for ecu in BOTH {
        for origin in Origin::ALL {
            let mut scenario = Scenario::started(ecu, percent(50));
            scenario.command_from(run(50), Origin::Emergency).unwrap();
            assert_eq!(scenario.command_from(Command::EmergencyStop, origin), Ok(Accepted::InForce));
            let ordered = scenario.telemetry().ordered;
            assert_eq!((ordered.order, ordered.origin), (Order::EmergencyStop, origin), "{ecu:?}");
            assert_eq!(scenario.wire(), Wire::Stop);
        }
    }
}

/// By the source that commanded it or a higher one; of several, the highest holds it.
#[test]
fn a_stop_is_released_by_its_source_or_a_higher_one() {
    for ecu in BOTH {
        for by in Origin::SOURCES {
            for releases in Origin::SOURCES {
                let mut scenario = Scenario::ready(ecu, ecu.config());
                scenario.command_from(Command::EmergencyStop, by).unwrap();
                let may = releases.priority() >= by.priority();
                let expected = if may { Ok(Accepted::InForce) } else { Err(Rejected::NotYours(by)) };
                assert_eq!(
                    scenario.command_from(Command::ReleaseStop, releases),
                    expected,
                    "{by:?} {releases:?}"
                );
                assert_eq!(scenario.wire(), if may { Wire::Standby } else { Wire::Stop }, "{ecu:?}");
            }
        }
        let mut scenario = Scenario::ready(ecu, ecu.config());
        for origin in [Origin::Rc, Origin::Emergency, Origin::Bench] {
            scenario.command_from(Command::EmergencyStop, origin).unwrap();
        }
        let held = Err(Rejected::NotYours(Origin::Emergency));
        assert_eq!(scenario.command_from(Command::ReleaseStop, Origin::Rc), held, "{ecu:?}");
        scenario.command_from(Command::ReleaseStop, Origin::Emergency).unwrap();
    }
}

/// Only if the ECU is received and reports an engine that does not run.
#[test]
fn a_stop_is_released_only_when_the_engine_has_stopped() {
    for ecu in BOTH {
        for reports in ALL {
            let mut scenario = Scenario::started(ecu, percent(0));
            scenario.command(Command::EmergencyStop).unwrap();
            scenario.reports(reports);
            let stopped = matches!(reports, Reports::Stopped | Reports::Standby | Reports::Cooling);
            let expected = if stopped { Ok(Accepted::InForce) } else { Err(Rejected::NotStopped) };
            assert_eq!(scenario.command(Command::ReleaseStop), expected, "{ecu:?} {reports:?}");
            assert_eq!(scenario.telemetry().stop_latched, !stopped);
        }
        // For 2 s and for 10 s: an ECU that is not received reports nothing of its engine.
        for seconds in [2, 10] {
            let mut scenario = Scenario::started(ecu, percent(0));
            scenario.command(Command::EmergencyStop).unwrap();
            scenario.reports(Reports::Stopped).silent().pass_us(seconds * SECOND);
            assert_eq!(scenario.command(Command::ReleaseStop), Err(Rejected::NoLink), "{ecu:?} {seconds}");
            assert_eq!(scenario.order(), Order::EmergencyStop);
            scenario.reports(Reports::Stopped);
            scenario.command(Command::ReleaseStop).expect("the control");
        }
    }
}

/// AMT-8: an ECU that reports only errors gives no state: its last one must not keep the stop forever.
#[test]
fn amt_8_a_stop_can_be_released_while_the_ecu_reports_errors() {
    let mut scenario = Scenario::started(Ecu::Amt, percent(0));
    scenario.command(Command::EmergencyStop).unwrap();
    scenario.silent();
    for i in 0..40 {
        let t = scenario.now_us() + 125_000;
        scenario.bench.rx_at_us(t, &amt_frames::error(0x01));
        if i == 8 {
            // A second after it was seen running.
            assert_eq!(scenario.command(Command::ReleaseStop), Err(Rejected::NotStopped));
        }
    }
    assert_eq!(scenario.telemetry().link, LinkState::Up);
    assert_eq!(scenario.command(Command::ReleaseStop), Ok(Accepted::InForce));
}

/// At idle: a stick that is still at 80 % keeps the stop.
#[test]
fn a_stop_is_released_only_at_idle() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(80));
        scenario.command(Command::EmergencyStop).unwrap();
        scenario.reports(Reports::Stopped);
        let _ = scenario.command(run(80));
        let not_idle = Err(Rejected::Start(Interlock::NotIdle));
        assert_eq!(scenario.command(Command::ReleaseStop), not_idle, "{ecu:?}");
        for idle in [run(0), Command::Standby] {
            let mut scenario = Scenario::started(ecu, percent(80));
            scenario.command(Command::EmergencyStop).unwrap();
            scenario.reports(Reports::Stopped);
            assert_eq!(scenario.command(idle), Err(Rejected::StopLatched));
            assert_eq!(scenario.command(Command::ReleaseStop), Ok(Accepted::InForce), "{ecu:?}");
        }
    }
}

/// The demand of a run that ended before the stop does not prevent its release.
#[test]
fn the_demand_of_a_run_that_ended_does_not_keep_a_stop() {
    for ecu in BOTH {
        for ended in [true, false] {
            let mut scenario = Scenario::started(ecu, percent(80));
            if ended {
                scenario.command(Command::ShutDown).unwrap();
            }
            scenario.command(Command::EmergencyStop).unwrap();
            scenario.reports(Reports::Stopped);
            let answer = if ended { Ok(Accepted::InForce) } else { Err(Rejected::Start(Interlock::NotIdle)) };
            assert_eq!(scenario.command(Command::ReleaseStop), answer, "{ecu:?} {ended}");
        }
    }
}

/// A release is a standby but does not permit a start: a start needs its own standby, as always. Without a stop it changes
/// nothing.
#[test]
fn a_release_allows_no_start() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config()); // would allow one
        scenario.command(Command::EmergencyStop).unwrap();
        scenario.command(Command::ReleaseStop).unwrap();
        assert_eq!((scenario.order(), scenario.wire()), (Order::Standby, Wire::Standby));
        scenario.fly_us(run(0), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst), "{ecu:?}");
        // Nor does it arm. The refusal states what the source has to do, as its "arm" would be refused.
        scenario.command(Command::Standby).unwrap();
        assert_eq!(scenario.command(run(0)), Err(Rejected::DisarmFirst), "{ecu:?}");
        assert_eq!(scenario.command(Command::Arm), Err(Rejected::DisarmFirst), "{ecu:?}");
        scenario.command(Command::Standby).unwrap();
        scenario.command(Command::Disarm).unwrap();
        scenario.command(Command::Arm).unwrap();
        scenario.command(Command::Standby).unwrap();
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce));

        let mut scenario = Scenario::started(ecu, percent(50));
        let _ = scenario.command(Command::ReleaseStop);
        assert_eq!((scenario.order(), scenario.wire()), (Order::Run(percent(50)), Wire::Run(500)));
    }
}

/// A stop is also sent while the node listens.
#[test]
fn a_stop_is_sent_while_the_node_listens() {
    for ecu in BOTH {
        let mut scenario = Scenario::nothing_received(ecu, ecu.config());
        assert_eq!(scenario.command(Command::EmergencyStop), Ok(Accepted::InForce));
        scenario.reports(Reports::Running);
        assert_eq!((scenario.order(), scenario.wire()), (Order::EmergencyStop, Wire::Stop), "{ecu:?}");
    }
}

// ---------------------------------------------------------------------------------------------
// After a reset
// ---------------------------------------------------------------------------------------------

fn record(order: Order, origin: Origin) -> Option<RetainedState> {
    Some(RetainedState::new(order, origin).with(|state| state.armed = true))
}

/// Record of an engine that has reached running.
fn retained_run(demand: Demand) -> Option<RetainedState> {
    record(Order::Run(demand), Origin::Rc)
}

/// Record of an engine that has not.
fn start_cut_short() -> Option<RetainedState> {
    retained_run(percent(0)).map(|retained| retained.with(|state| state.ran = false))
}

/// It listens first: as long as nothing is received, ZK sends only ID 0, and AMT nothing. Only a standby that was in force
/// continues at once, because it can start nothing.
#[test]
fn after_a_reset_the_node_listens_first() {
    for (retained, order) in [
        (None, Order::Listen),
        (retained_run(percent(60)), Order::Doubt(percent(60))),
        (start_cut_short(), Order::Listen),
    ] {
        let mut zk = Scenario::after_reset(Ecu::Zk, Ecu::Zk.config(), retained);
        zk.pass_us(20 * FRAME_PERIOD_US);
        let sent = zk.bench.bytes();
        assert!(
            sent.len() >= 20 && sent.iter().all(|bytes| *bytes == zk_frames::keep_alive()),
            "{sent:02x?}"
        );
        let mut amt = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), retained);
        amt.pass_us(20 * FRAME_PERIOD_US);
        assert_eq!(amt.bench.bytes(), Vec::<Vec<u8>>::new());
        for scenario in [&zk, &amt] {
            assert_eq!(scenario.order(), order);
            assert_eq!(scenario.telemetry().armed, retained.is_some());
        }
    }
    let mut zk = Scenario::after_reset(Ecu::Zk, Ecu::Zk.config(), record(Order::Standby, Origin::Rc));
    zk.pass_us(20 * FRAME_PERIOD_US);
    let sent = zk.sent();
    assert!(sent.len() >= 20 && sent.iter().all(|wire| *wire == Wire::Standby), "{sent:?}");
}

/// A running engine continues with its retained order, without a change on the wire, under the source that was in control: from the
/// second report that shows it. One is not enough.
#[test]
fn a_running_engine_resumes_with_its_retained_order() {
    for ecu in BOTH {
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), retained_run(percent(60)));
        scenario.introduce();
        scenario.values.half_percents = 120;
        scenario.reports = Some(Reports::Running);
        scenario.run_to_us(2 * FRAME_PERIOD_US - 1);
        assert_eq!(scenario.order(), Order::Doubt(percent(60)), "{ecu:?}");
        assert!(scenario.telemetry().in_doubt.is_some());
        scenario.run_to_us(2 * FRAME_PERIOD_US);
        let telemetry = scenario.telemetry();
        assert_eq!((telemetry.ordered.order, telemetry.active_source), (Order::Run(percent(60)), Origin::Rc));
        assert_eq!(telemetry.in_doubt, None);
        assert!(scenario.bench.event_kinds().contains(&Event::Resumed(percent(60))), "{ecu:?}");
        scenario.run_to_us(4 * FRAME_PERIOD_US);
        let sent = scenario.sent();
        assert!(!sent.is_empty() && sent.iter().all(|wire| *wire == Wire::Run(600)), "{sent:?}");
        // Its source continues to command: no bump and no stage of loss.
        assert_eq!(scenario.command(run(65)), Ok(Accepted::InForce));
        assert_eq!(scenario.telemetry().loss, LossStage::None);

        // An unnamed state confirms nothing. An AMT ECU whose shaft turns is answered all the same, a ZK ECU receives ID 0,
        // until the doubt has lasted too long.
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), retained_run(percent(60)));
        scenario.introduce();
        scenario.values.half_percents = 120;
        scenario.reports = Some(Reports::Unknown);
        scenario.fly_us(run(60), Origin::Rc, 3 * SECOND);
        assert_eq!(scenario.order(), Order::Doubt(percent(60)), "{ecu:?}");
        let sent = scenario.sent();
        match ecu {
            Ecu::Amt => {
                assert!(sent.len() >= 59 && sent.iter().all(|wire| *wire == Wire::Run(600)), "{sent:?}")
            }
            Ecu::Zk => assert_eq!(sent, []),
        }
        assert!(!scenario.bench.event_kinds().iter().any(|event| matches!(event, Event::Resumed(_))));

        // No source commands: the stages of loss, counted from here on.
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), retained_run(percent(60)));
        scenario.introduce();
        scenario.reports(Reports::Running).pass_us(5 * SECOND);
        assert_eq!((scenario.tenths(), scenario.telemetry().loss), (0, LossStage::FailSafe), "{ecu:?}");
    }
}

/// A reset in the middle of a start ends it: it is unknown how far it was, and whether the ECU restarted meanwhile. AMT:
/// with a shaft below half of idle; above it the set is answered.
#[test]
fn a_reset_ends_a_start() {
    for (ecu, rpm) in [(Ecu::Amt, 2_000), (Ecu::Zk, 2_000), (Ecu::Zk, TURNING)] {
        let mut before = Scenario::ready(ecu, ecu.config());
        before.command(run(0)).unwrap();
        before.values.rpm = Some(rpm);
        before.reports(Reports::Starting);
        before.fly_us(run(0), Origin::Rc, SECOND);
        assert!(!before.bench.machine.record().ran);
        let mut scenario = before.reset(ecu.config());
        scenario.run_to_us(2 * FRAME_PERIOD_US - 1);
        assert_eq!((scenario.order(), scenario.sent()), (Order::Listen, vec![]), "{ecu:?}");
        scenario.run_to_us(2 * FRAME_PERIOD_US);
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}: two reports show that it starts");
        scenario.fly_us(run(60), Origin::Rc, SECOND);
        let sent = scenario.sent();
        assert!(sent.iter().all(|wire| *wire == Wire::Standby), "{ecu:?} {sent:?}");
        // The control: an engine that has reached running continues.
        before.values.rpm = Some(TURNING);
        before.reports(Reports::Running);
        before.fly_us(run(60), Origin::Rc, 2 * SECOND);
        let mut scenario = before.reset(ecu.config());
        scenario.fly_us(run(60), Origin::Rc, SECOND);
        assert_eq!(scenario.wire(), Wire::Run(600), "{ecu:?}");
    }
}

/// Nothing was retained, as after a power-up: the engine continues with the demand that its ECU reports, under the stages of loss
/// until a source commands. Two reports have to agree, on an AMT ECU's throttle too.
#[test]
fn a_running_engine_resumes_with_what_its_ecu_reports() {
    for ecu in BOTH {
        for retained in [None, record(Order::Listen, Origin::Node)] {
            let mut scenario = Scenario::after_reset(ecu, ecu.config(), retained);
            scenario.introduce();
            scenario.values.half_percents = 130;
            scenario.reports = Some(Reports::Running);
            if ecu == Ecu::Zk {
                // Its throttle comes in a frame of its own, after the state.
                scenario.pass_us(6 * FRAME_PERIOD_US);
                for _ in 0..2 {
                    assert_eq!(scenario.order(), Order::Listen, "the throttle is not known yet");
                    scenario.bench.receive(&zk_frames::status(3, 12_000, [65, 0, 0]));
                    assert_eq!(scenario.order(), Order::Listen);
                }
                scenario.pass_us(FRAME_PERIOD_US);
            } else {
                scenario.pass_us(2 * FRAME_PERIOD_US - 1);
                assert_eq!((scenario.order(), scenario.sent()), (Order::Listen, vec![]));
                scenario.pass_us(1);
            }
            let telemetry = scenario.telemetry();
            assert_eq!(telemetry.ordered.order, Order::Run(percent(65)), "{ecu:?} {retained:?}");
            assert_eq!((telemetry.active_source, telemetry.loss), (Origin::Node, LossStage::Hold));
            let from = scenario.now_us();
            scenario.run_to_us(from + SECOND);
            assert_eq!((scenario.tenths(), scenario.telemetry().loss), (650, LossStage::FailSafe));
            assert!(scenario.sent().iter().all(|wire| *wire == Wire::Run(650)), "{ecu:?}");
            scenario.pass_us(5 * SECOND);
            assert_eq!(scenario.tenths(), 0);
        }
        // Whichever source commands takes over without a bump, the lowest source too.
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), None);
        scenario.introduce();
        scenario.bench.receive(&match ecu {
            Ecu::Zk => [zk_frames::status(3, 12_000, [65, 0, 0]); 2].concat(),
            Ecu::Amt => vec![],
        });
        scenario.values.half_percents = 130;
        scenario.reports(Reports::Running);
        assert_eq!(scenario.command_from(run(20), Origin::Bench), Ok(Accepted::Held), "{ecu:?}");
        assert_eq!(scenario.tenths(), 650);
        assert_eq!(scenario.command_from(run(66), Origin::Bench), Ok(Accepted::InForce));
        assert_eq!((scenario.tenths(), scenario.telemetry().loss), (650, LossStage::None));
        // It rises by 1 %, at 50 % a second.
        scenario.run_to_us(scenario.now_us() + 20_000);
        assert_eq!(scenario.tenths(), 660);
    }
    // Two sets of an AMT ECU that do not agree on the throttle: no answer yet.
    let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), None);
    for half_percents in [130, 60, 130, 60] {
        scenario.pass_us(FRAME_PERIOD_US);
        scenario.odd(Reports::Running, Values { half_percents, ..scenario.values });
        assert_eq!((scenario.order(), scenario.sent()), (Order::Listen, vec![]));
    }
    // A throttle that never comes: 3 s after the first frame it continues at idle.
    let mut scenario = Scenario::after_reset(Ecu::Zk, Ecu::Zk.config(), None);
    scenario.reports = Some(Reports::Running);
    scenario.pass_us(3 * SECOND + FRAME_PERIOD_US - 1);
    assert_eq!((scenario.order(), scenario.sent()), (Order::Listen, vec![]));
    scenario.pass_us(FRAME_PERIOD_US);
    assert_eq!(scenario.order(), Order::Run(percent(0)));
    scenario.pass_us(60 * SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(0)), "it reports a running engine");
}

/// A retained rpm waits for a report that the ECU knows speed control; otherwise it would become a throttle.
#[test]
fn a_retained_rpm_resumes_as_an_rpm() {
    let mut scenario = Scenario::after_reset(Ecu::Zk, Ecu::Zk.config(), retained_run(rpm(90_000)));
    scenario.reports(Reports::Running);
    assert_eq!(scenario.order(), Order::Doubt(rpm(90_000)), "the version is not known");
    assert_eq!(scenario.sent(), []);
    scenario.introduce();
    scenario.pass_us(FRAME_PERIOD_US);
    assert_eq!(scenario.order(), Order::Run(rpm(90_000)));
    scenario.fly_us(Command::Run(rpm(90_000)), Origin::Rc, SECOND);
    let sent = scenario.sent();
    assert!(sent.len() >= 19 && sent.iter().all(|wire| *wire == Wire::RpmControl), "{sent:?}");
}

/// If no engine runs, standby follows, whatever was retained; a stream of run does not start it.
#[test]
fn after_a_reset_an_engine_that_does_not_run_is_in_standby() {
    for ecu in BOTH {
        for reports in [Reports::Stopped, Reports::Standby, Reports::Cooling] {
            for retained in [None, retained_run(percent(60)), record(Order::Standby, Origin::Rc)] {
                let mut scenario = Scenario::after_reset(ecu, ecu.config(), retained);
                scenario.introduce();
                scenario.reports(reports);
                let ordered = scenario.telemetry().ordered;
                assert_eq!(
                    (ordered.order, ordered.origin),
                    (Order::Standby, Origin::Node),
                    "{ecu:?} {reports:?}"
                );
                scenario.fly_us(run(0), Origin::Rc, 3 * SECOND);
                assert_eq!(scenario.wire(), Wire::Standby);
            }
        }
    }
    // AMT-9: also an ECU that has just been powered up, in its first frame.
    let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), retained_run(percent(60)));
    scenario.bench.rx_at_us(FRAME_PERIOD_US, &amt_frames::setup("9.35 140617 "));
    assert_eq!(scenario.order(), Order::Standby);
    scenario.pass_us(FRAME_PERIOD_US);
    assert_eq!(scenario.sent(), [Wire::Standby]);
}

/// A standby in progress is resumed, not undone.
#[test]
fn a_shutdown_resumes_after_a_reset() {
    for ecu in BOTH {
        let retained = record(Order::Standby, Origin::Rc);
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), retained);
        scenario.introduce();
        scenario.reports(Reports::Running);
        assert_eq!((scenario.order(), scenario.wire()), (Order::Standby, Wire::Standby), "{ecu:?}");
    }
}

/// A latched stop survives, does not wait, and can still be released by its source.
#[test]
fn a_latched_stop_survives_a_reset() {
    for ecu in BOTH {
        for reports in ALL {
            let retained = record(Order::EmergencyStop, Origin::Emergency);
            let mut scenario = Scenario::after_reset(ecu, ecu.config(), retained);
            assert!(scenario.telemetry().stop_latched);
            scenario.reports = Some(reports);
            scenario.pass_us(2 * FRAME_PERIOD_US);
            let sent = scenario.sent();
            assert!(!sent.is_empty() && sent.iter().all(|wire| *wire == Wire::Stop), "{ecu:?} {sent:?}");
            scenario.reports(reports);
            let not_yours = Err(Rejected::NotYours(Origin::Emergency));
            assert_eq!(scenario.command(Command::ReleaseStop), not_yours);
        }
        // Its retained state is the same again, except for arming, which a stop ends, and one more reset.
        let retained = record(Order::EmergencyStop, Origin::Emergency);
        let scenario = Scenario::after_reset(ecu, ecu.config(), retained);
        let again = retained.map(|retained| {
            retained.with(|state| {
                state.armed = false;
                state.resets = 1;
            })
        });
        assert_eq!(Some(scenario.bench.machine.record()), again);
    }
}

/// An AMT ECU with a fault sends, and does not report the state of its engine: the exhaust decides whether the retained state
/// counts. Without a record nothing is in force, until the stages of loss have run out.
#[test]
fn amt_8_after_a_reset_the_exhaust_decides_if_the_ecu_has_a_fault() {
    let run = retained_run(percent(60));
    for (retained, egt, order, sent) in [
        (run, 500, Order::Doubt(percent(60)), vec![Wire::Run(600); 3]),
        (run, 26, Order::Standby, vec![Wire::Standby; 3]),
        (None, 500, Order::Listen, vec![]),
        (None, 26, Order::Listen, vec![]),
    ] {
        let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), retained);
        (scenario.values.fault, scenario.values.egt_celsius) = (1, egt);
        scenario.reports = Some(Reports::Running);
        scenario.pass_us(2 * FRAME_PERIOD_US - 1);
        assert_eq!(scenario.sent(), [], "no answer is better than a wrong one: {egt}");
        scenario.pass_us(2 * FRAME_PERIOD_US + 1);
        assert_eq!((scenario.order(), scenario.sent()), (order, sent), "{egt}");
        if retained.is_none() {
            scenario.run_to_us(11 * SECOND - 1);
            assert_eq!((scenario.order(), scenario.sent()), (Order::Listen, vec![]), "{egt}");
            scenario.run_to_us(11 * SECOND);
            assert_eq!(scenario.order(), Order::Standby, "{egt}");
        }
    }
}

/// Without an order, silence from before a reset counts as it would without the reset: from the end of a source's timeout on. A
/// healthy engine whose ECU is not received is not shut down before the stages of loss have run out.
#[test]
fn silence_before_a_reset_counts_beyond_the_timeout_of_a_source() {
    for ecu in BOTH {
        for before in [0, 5 * SECOND] {
            let config = ecu.with(|s| s.timeouts.mavlink = micros(3 * SECOND));
            let found = RetainedState::new(Order::Listen, Origin::Node).with(|state| {
                state.ran = true;
                state.all_silent = micros(before);
            });
            let mut scenario = Scenario::after_reset(ecu, config, Some(found));
            let hold = config.supervision.loss.hold.as_micros();
            let counted = before.saturating_sub(3 * SECOND);
            let due = scenario.now_us() + hold + 10 * SECOND - counted;
            // The reset itself counts as 20 ms.
            scenario.run_to_us(due - 40_000);
            assert_eq!(scenario.order(), Order::Listen, "{ecu:?} {before}");
            scenario.run_to_us(due + 1);
            assert_eq!(scenario.order(), Order::Standby, "{ecu:?} {before}");
        }
    }
}

/// The order in force is retained: a reset does not raise a throttle that a stage of loss has lowered.
#[test]
fn the_retained_order_is_the_one_in_force() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(60));
        scenario.fly_us(run(60), Origin::Rc, 4 * FRAME_PERIOD_US);
        let retained = scenario.bench.machine.record();
        let order = retained.with(|state| {
            state.arm_commanded = 0;
            state.link = LinkRecord::EMPTY;
        });
        assert_eq!(Some(order), retained_run(percent(60)));
        assert_eq!(retained.arm_commanded, 1 << 3, "RC, the fourth of all origins");
        scenario.pass_us(10 * SECOND);
        assert_eq!(scenario.bench.machine.record().order, Order::Run(percent(0)), "{ecu:?}");
        scenario.fly_us(run(60), Origin::Rc, 5 * SECOND);
        assert_eq!(scenario.bench.machine.record().order, Order::Run(percent(60)));
        scenario.command(Command::Disarm).unwrap();
        assert!(!scenario.bench.machine.record().armed);
        scenario.shut_down().unwrap();
        assert_eq!(scenario.bench.machine.record().order, Order::Standby);

        // In doubt, the retained state is kept, the reset is counted, and arming counts.
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), retained_run(percent(60)));
        let again = scenario.bench.machine.record();
        assert_eq!(
            Some(again.with(|state| {
                state.silent = micros(0);
                state.all_silent = micros(0);
                state.unconfirmed = micros(0);
            })),
            retained_run(percent(60)).map(|retained| retained.with(|state| state.resets = 1))
        );
        scenario.command(Command::Disarm).unwrap();
        let record = scenario.bench.machine.record();
        assert_eq!((record.order, record.armed), (Order::Run(percent(60)), false));
    }
}

/// A source that was lost stays lost after a reset: it is in control when it has commanded for a while. The stages of loss do not restart
/// either: a node that is reset repeatedly does not hold a demand that no source commands.
#[test]
fn a_lost_source_stays_lost() {
    for ecu in BOTH {
        let mut before = Scenario::started(ecu, percent(80));
        before.pass_us(10 * SECOND);
        assert_eq!((before.tenths(), before.telemetry().loss), (0, LossStage::FailSafe));
        let mut scenario = before.reset(ecu.config());
        scenario.pass_us(600_000);
        assert_eq!(scenario.telemetry().loss, LossStage::FailSafe, "{ecu:?}");
        assert_eq!(scenario.command(run(80)), Ok(Accepted::Held), "{ecu:?}");
        assert_eq!(scenario.tenths(), 0);
        // It commands for 1 s, and waits for 2 s to take over.
        scenario.fly_us(run(80), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.tenths(), 0);
        scenario.fly_us(run(80), Origin::Rc, 3 * SECOND);
        assert_eq!(scenario.tenths(), 800, "{ecu:?}: it has commanded for long enough");

        // A reset puts the life of the engine in doubt: when the stages of loss have run out, 11.5 s of silence of which
        // each reset takes 0.2 s at least, it ends there.
        let mut scenario = Scenario::started(ecu, percent(80));
        for reset in 0..8 {
            scenario.pass_us(1_300_000);
            assert!(reset < 3 || scenario.tenths() == 0, "{ecu:?} {reset}");
            scenario = scenario.reset(ecu.config());
        }
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}");
    }
}

/// One report that the engine is at rest, the first after the reset, does not stop one that runs; two do.
#[test]
fn one_odd_report_after_a_reset_stops_nothing() {
    for (odd, expected) in [(1, Order::Run(percent(60))), (2, Order::Standby)] {
        let mut scenario = Scenario::after_reset(Ecu::Zk, Ecu::Zk.config(), retained_run(percent(60)));
        for _ in 0..odd {
            scenario.pass_us(FRAME_PERIOD_US / 4);
            scenario.odd(Reports::Standby, scenario.values);
        }
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(run(60), Origin::Rc, SECOND);
        assert_eq!(scenario.order(), expected, "{odd}");
    }
}

/// The source that stopped the engine before a reset still holds the stop if a lower source stops it again before the node's
/// tasks have begun.
#[test]
fn a_retained_stop_stays_with_the_higher_source() {
    for (retained, again, holds) in [
        (Origin::Emergency, Origin::Bench, Origin::Emergency),
        (Origin::Bench, Origin::Emergency, Origin::Emergency),
    ] {
        let mut engine = Engine::new(&Ecu::Amt.config());
        engine.restore(record(Order::EmergencyStop, retained));
        engine.command(at_us(0), Command::EmergencyStop, again, true).unwrap();
        assert_eq!(engine.record().origin, holds);
        engine.start(at_us(0));
        assert_eq!((engine.record().order, engine.record().origin), (Order::EmergencyStop, holds));
    }
}

/// AMT-13: a reset while CTF is in force does not cancel the shutdown; it ends as a normal one.
#[test]
fn a_reset_does_not_cancel_ctf() {
    let mut before = Scenario::started(Ecu::Amt, percent(50));
    before.command(Command::Service(Service::Amt(amt::config::Service::Ctf))).unwrap();
    assert_eq!(before.wire(), Wire::Ctf);
    let mut scenario = before.reset(Ecu::Amt.config());
    scenario.fly_us(run(50), Origin::Rc, SECOND);
    assert_eq!((scenario.order(), scenario.wire()), (Order::Standby, Wire::Standby));
    // And the engine stopped by command.
    before.reports(Reports::Cooling);
    assert_eq!((before.order(), before.bench.machine.failed()), (Order::Standby, false));
}
