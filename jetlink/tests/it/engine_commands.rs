//! Service commands, the hand-over to PWM, reports, and random schedules of all of them. For both ECUs.

use embassy_time::Duration;
use jetlink::command::{Accepted, Command, Demand, Interlock, Order, Origin, Rejected};
use jetlink::ecu::zk::codec::{AccelerationCurve, Action};
use jetlink::ecu::{Service, amt, zk};
use jetlink::engine::Loss;
use jetlink::event::{Event, LossStage};
use jetlink::report::{LinkState, Phase};
use jetlink::units::{Celsius, Throttle};
use proptest::prelude::*;

use crate::support::frames::zk as zk_frames;
use crate::support::scenario::{
    ALL, BOTH, Ecu, FRAME_PERIOD_US, Reports, SECOND, Scenario, Wire, ZK_IDLE, percent, rpm, run,
};
use bench::by_hand::micros;

/// Actions that move fuel or heat: all but the rates, and those that end an action.
const MOVE_FUEL: [Action; 6] = [
    Action::Drain,
    Action::TestGlowPlug,
    Action::TestMainValve,
    Action::TestIgnitionValve,
    Action::TestPump,
    Action::OpenPump,
];

fn action(action: Action) -> Command {
    Command::Service(Service::Zk(zk::config::Service::Action(action)))
}

// ---------------------------------------------------------------------------------------------
// CTF and PWM
// ---------------------------------------------------------------------------------------------

/// AMT-13: CTF is a deliberate act: neither the source's further demands nor its loss cancel it.
#[test]
fn amt_13_a_lost_source_does_not_cancel_ctf() {
    let mut scenario = Scenario::started(Ecu::Amt, percent(50));
    scenario.command(Command::Service(Service::Amt(amt::config::Service::Ctf))).unwrap();
    assert_eq!(scenario.wire(), Wire::Ctf);
    scenario.command(run(60)).unwrap();
    assert_eq!(scenario.wire(), Wire::Ctf);
    scenario.pass_us(5 * SECOND); // the source is silent
    assert_eq!((scenario.telemetry().loss, scenario.wire()), (LossStage::FailSafe, Wire::Ctf));
    scenario.reports(Reports::Cooling);
    assert_eq!((scenario.order(), scenario.wire()), (Order::Standby, Wire::Standby));
}

/// ZK-8: a hand-over to the PWM input counts as a start, and lasts for the engine's life: no stage of loss takes the engine
/// back from the source in control.
#[test]
fn zk_8_a_hand_over_lasts_for_the_engines_life() {
    let mut scenario = Scenario::started(Ecu::Zk, percent(80));
    assert_eq!(
        scenario.command(Command::HandOverToPwm),
        Err(Rejected::StandbyFirst),
        "it is none of an engine that runs"
    );
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    assert_eq!(scenario.command(Command::HandOverToPwm), Ok(Accepted::InForce));
    assert_eq!(scenario.wire(), Wire::Pwm);
    assert_eq!(scenario.command(Command::HandOverToPwm), Err(Rejected::StandbyFirst), "once");
    scenario.reports(Reports::Starting).reports(Reports::Running).pass_us(60 * SECOND);
    assert_eq!((scenario.order(), scenario.wire()), (Order::Pwm, Wire::Pwm));
    assert_eq!(scenario.telemetry().loss, LossStage::None);
    // A stream of run does not take it back; standby does.
    scenario.fly_us(run(50), Origin::Rc, 3 * SECOND);
    assert_eq!(scenario.command(run(50)), Err(Rejected::StandbyFirst));
    assert_eq!(scenario.wire(), Wire::Pwm);
    scenario.shut_down().unwrap();
    assert_eq!(scenario.wire(), Wire::Standby);
    // It ends with the life of the engine.
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.command(Command::HandOverToPwm).unwrap();
    scenario.reports(Reports::Starting).reports(Reports::Running).reports(Reports::Cooling);
    assert_eq!((scenario.order(), scenario.wire()), (Order::Standby, Wire::Standby));
    // An AMT ECU has no hand-over, and a refusal changes nothing.
    for (mut amt, why) in [
        (Scenario::started(Ecu::Amt, percent(50)), Rejected::StandbyFirst),
        (Scenario::ready(Ecu::Amt, Ecu::Amt.config()), Rejected::NotSupported),
    ] {
        let before = amt.order();
        assert_eq!(amt.command(Command::HandOverToPwm), Err(why));
        assert_eq!(amt.order(), before);
    }
}

/// One permission gives one hand-over, or one start, also where the hand-over ended before its engine turned.
#[test]
fn zk_8_a_hand_over_uses_its_permission_up() {
    for handed_over in [false, true] {
        let mut config = Ecu::Zk.config();
        config.supervision.timeouts.rc = Duration::from_secs(5);
        let mut scenario = Scenario::ready(Ecu::Zk, config);
        if handed_over {
            scenario.command(Command::HandOverToPwm).unwrap();
        }
        // A gap in a start ends it.
        scenario.silent().pass_us(200_000).reports(Reports::Standby);
        assert_eq!(scenario.wire(), Wire::Standby);
        scenario.pass_us(2 * SECOND);
        let again = if handed_over { Err(Rejected::StandbyFirst) } else { Ok(Accepted::InForce) };
        assert_eq!(scenario.would_answer(Command::HandOverToPwm), again);
        assert_eq!(scenario.would_answer(run(0)), again);
    }
}

/// The source that handed the engine over takes it back, even if a higher source streams run.
#[test]
fn zk_8_a_hand_over_is_taken_back_by_its_own_source() {
    for reached in [false, true] {
        let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
        assert_eq!(scenario.command_from(Command::Standby, Origin::Bench), Ok(Accepted::Behind(Origin::Rc)));
        scenario.fly_us(Command::Standby, Origin::Bench, SECOND);
        assert_eq!(scenario.command_from(Command::HandOverToPwm, Origin::Bench), Ok(Accepted::InForce));
        if reached {
            scenario.reports(Reports::Starting).reports(Reports::Running);
        }
        scenario.fly_us(run(50), Origin::Rc, SECOND);
        for origin in [Origin::Mavlink, Origin::Bench] {
            for _ in 0..2 {
                scenario.command(run(50)).unwrap_err();
                scenario.command_from(Command::Standby, origin).unwrap();
            }
            assert_eq!(scenario.wire() == Wire::Standby, origin == Origin::Bench, "{origin:?}");
        }
    }
}

/// Another source's standby ends a hand-over whose engine does not run yet, if its source is silent. Of an engine that runs only a higher
/// source's does.
#[test]
fn zk_8_a_hand_over_is_ended_by_another_source_as_a_run_is() {
    for (runs, origin, ended) in [
        (false, Origin::Mavlink, true),
        (false, Origin::Emergency, true),
        (true, Origin::Mavlink, false),
        (true, Origin::Emergency, true),
    ] {
        let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
        scenario.command(Command::HandOverToPwm).unwrap();
        scenario.reports(Reports::Starting);
        if runs {
            scenario.reports(Reports::Running);
        }
        scenario.pass_us(SECOND); // RC is silent
        scenario.fly_us(Command::Standby, origin, SECOND);
        let order = if ended { Order::Standby } else { Order::Pwm };
        assert_eq!(scenario.order(), order, "{runs} {origin:?}");
    }
}

/// Each interlock of a start also applies to a hand-over, and a refusal uses up the permission.
#[test]
fn zk_8_a_hand_over_counts_as_a_start() {
    for (change, why) in [
        (Command::Disarm, Interlock::NotArmed),
        (Command::Standby, Interlock::TooHot(Celsius::from_tenths(1200))),
    ] {
        let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
        if change == Command::Standby {
            scenario.values.egt_celsius = 120;
            scenario.pass_us(2 * FRAME_PERIOD_US);
        }
        scenario.command(change).unwrap();
        scenario.command(Command::Standby).unwrap();
        assert_eq!(scenario.command(Command::HandOverToPwm), Err(Rejected::Start(why)));
        assert_eq!(scenario.command(Command::HandOverToPwm), Err(Rejected::StandbyFirst), "{why:?}");
        assert_eq!(scenario.wire(), Wire::Standby);
    }
}

// ---------------------------------------------------------------------------------------------
// Service commands and refusals
// ---------------------------------------------------------------------------------------------

/// An ECU that was silent for three frames may be another one when it returns.
#[test]
fn zk_13_services_that_move_fuel_are_refused_in_a_gap() {
    for service in MOVE_FUEL {
        let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
        scenario.silent().pass_us(140_000);
        assert!(scenario.would_answer(action(service)).is_ok(), "{service:?} before the gap");
        scenario.pass_us(20_000);
        assert_eq!(scenario.telemetry().link, LinkState::Up);
        let refused = Err(Rejected::Start(Interlock::Link));
        assert_eq!(scenario.command(action(service)), refused, "{service:?} in the gap");
        // The first reports of an ECU that comes back may still be the previous ones.
        scenario.reports(Reports::Standby);
        assert_eq!(scenario.would_answer(action(service)), refused, "{service:?} after it");
        scenario.pass_us(SECOND);
        assert_eq!(scenario.would_answer(action(service)), Ok(Accepted::InForce), "{service:?} 1 s later");
    }
}

/// A service command needs an engine that is received and stopped; a rate does not. One that moves fuel or heats needs one that
/// is cold, armed, and no longer cooling as well.
#[test]
fn service_commands_need_a_stopped_engine() {
    for reports in ALL {
        // In standby, which the node has ordered for an engine that does not run.
        let ready = || {
            let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
            scenario.reports(reports);
            scenario
        };
        let stopped = matches!(reports, Reports::Stopped | Reports::Standby | Reports::Cooling);
        let answer = if stopped { Ok(Accepted::InForce) } else { Err(Rejected::NotStopped) };
        for each in Action::ALL {
            let is_rate = (7..=9).contains(&each.code());
            let moves_fuel = MOVE_FUEL.contains(&each);
            let expected = match reports {
                _ if is_rate => Ok(Accepted::InForce),
                Reports::Stopped | Reports::Cooling if moves_fuel => {
                    Err(Rejected::Start(Interlock::NotStandby))
                }
                _ => answer,
            };
            assert_eq!(ready().command(action(each)), expected, "{reports:?} {each:?}");
            // Hot, or not armed.
            for (hot, why) in
                [(true, Interlock::TooHot(Celsius::from_tenths(1010))), (false, Interlock::NotArmed)]
            {
                let mut scenario = ready();
                if hot {
                    scenario.values.egt_celsius = 101;
                    scenario.pass_us(2 * FRAME_PERIOD_US);
                } else {
                    scenario.command(Command::Disarm).unwrap();
                }
                let standby = reports == Reports::Standby;
                let why = if !standby && hot { Interlock::NotStandby } else { why };
                let expected = if moves_fuel && stopped { Err(Rejected::Start(why)) } else { expected };
                assert_eq!(scenario.command(action(each)), expected, "{reports:?} {each:?} {hot}");
            }
        }
        let curve = zk::config::Service::Curve(AccelerationCurve::new(40).unwrap());
        assert_eq!(ready().command(Command::Service(Service::Zk(curve))), answer, "{reports:?}");
    }
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.silent().pass_us(2 * SECOND);
    assert_eq!(scenario.command(action(Action::Drain)), Err(Rejected::NoLink));
}

/// While no order is in force, the refusal of a service says whether anything is received.
#[test]
fn a_service_is_refused_while_the_node_listens() {
    for ecu in BOTH {
        let mut scenario = Scenario::nothing_received(ecu, ecu.config());
        for (link, why) in [(LinkState::Silent, Rejected::Listening), (LinkState::Lost, Rejected::NoLink)] {
            assert_eq!(scenario.telemetry().link, link, "{ecu:?}");
            assert_eq!(scenario.command(action(Action::Drain)), Err(why), "{ecu:?} {link:?}");
            scenario.pass_us(5 * SECOND);
        }
    }
}

/// A pump that was opened "for a long time" can be closed, although the ECU then reports one of its tests.
#[test]
fn an_open_pump_can_be_closed() {
    for state in 14..=19 {
        let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
        scenario.command(action(Action::OpenPump)).unwrap();
        scenario.silent();
        for _ in 0..4 {
            let t = scenario.now_us() + FRAME_PERIOD_US;
            scenario.bench.rx_at_us(t, &zk_frames::state(state));
        }
        assert_eq!(scenario.telemetry().report.phase.unwrap().value, Phase::Service);
        assert_eq!(scenario.command(action(Action::ClosePump)), Ok(Accepted::InForce), "state {state}");
    }
}

/// A command to the wrong kind of ECU.
#[test]
fn a_service_command_of_the_other_ecu_is_refused() {
    let mut zk = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    let ctf = Command::Service(Service::Amt(amt::config::Service::Ctf));
    assert_eq!(zk.command(ctf), Err(Rejected::NotSupported));
    let mut amt = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
    assert_eq!(amt.command(action(Action::Drain)), Err(Rejected::NotSupported));
}

/// A refused command is typed, counted, reported once, and changes nothing.
#[test]
fn refusals_change_nothing() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.introduce_version(3);
        scenario.bench.events();
        let before = scenario.telemetry().ordered;
        let no_speed = match ecu {
            Ecu::Amt => Rejected::NoSpeedControl,
            Ecu::Zk => Rejected::NeedsVersion { needed: 4, known: Some(3) },
        };
        for _ in 0..10 {
            assert_eq!(scenario.command(Command::Run(rpm(100_000))), Err(no_speed));
        }
        assert_eq!(scenario.command(action(Action::Drain)), Err(Rejected::NotStopped));
        let telemetry = scenario.telemetry();
        assert_eq!(telemetry.ordered, before);
        assert_eq!(telemetry.counters.commands_rejected, 11);
        assert_eq!(
            scenario.bench.event_kinds(),
            [
                Event::CommandRejected(no_speed, Origin::Rc),
                Event::CommandRejected(Rejected::NotStopped, Origin::Rc)
            ],
            "{ecu:?}"
        );
        assert_eq!(scenario.wire(), Wire::Run(500));
    }
}

/// The order is reported when it changes in kind or origin, not at every new throttle.
#[test]
fn orders_are_reported_when_they_change_in_kind() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(5));
        for percent in 0..10 {
            scenario.command(run(percent)).unwrap();
        }
        assert_eq!(scenario.bench.event_kinds(), []);
        scenario.command_from(run(9), Origin::Emergency).unwrap();
        scenario.shut_down_from(Origin::Emergency).unwrap();
        let reported: Vec<_> = scenario
            .bench
            .event_kinds()
            .into_iter()
            .filter_map(|event| match event {
                Event::Ordered(ordered) => Some((ordered.order, ordered.origin)),
                _ => None,
            })
            .collect();
        let expected = [(Order::Run(percent(9)), Origin::Emergency), (Order::Standby, Origin::Emergency)];
        assert_eq!(reported, expected, "{ecu:?}");
    }
}

// ---------------------------------------------------------------------------------------------
// Any schedule
// ---------------------------------------------------------------------------------------------

#[derive(Clone, Debug)]
enum Step {
    Reports(Reports),
    Silent,
    Command(Command, Origin),
    /// Streams the command, for tenths of a second.
    Fly(Command, Origin, u64),
}

fn step() -> impl Strategy<Value = Step> {
    let origin = || prop::sample::select(vec![Origin::Rc, Origin::Mavlink, Origin::Bench]);
    let command = || {
        prop_oneof![
            2 => Just(run(0)),
            4 => (0..=100u8).prop_map(run),
            1 => (0..=200_000u32).prop_map(|value| Command::Run(rpm(value))),
            4 => Just(Command::Standby),
            1 => Just(Command::ShutDown),
            1 => Just(Command::Present),
            1 => Just(Command::EmergencyStop),
            2 => Just(Command::ReleaseStop),
            2 => Just(Command::Arm),
            1 => Just(Command::Disarm),
            1 => Just(action(Action::Drain)),
        ]
    };
    prop_oneof![
        3 => prop::sample::select(ALL.to_vec()).prop_map(Step::Reports),
        3 => Just(Step::Reports(Reports::Standby)),
        3 => Just(Step::Reports(Reports::Running)),
        1 => Just(Step::Silent),
        3 => (command(), origin()).prop_map(|(command, origin)| Step::Command(command, origin)),
        4 => (command(), origin(), 0..40u64).prop_map(|(command, origin, tenths)| Step::Fly(command, origin, tenths)),
    ]
}

proptest! {
    /// Whatever is commanded and reported: a latched stop stays ordered, a run begins only in answer to its command, armed
    /// and from standby; a refused command changes nothing, though a demand may already be moving; no demand outlives its
    /// hold; and the bench finds no deadline in the past. Begins with an engine in standby, or one that runs.
    #[test]
    fn in_any_schedule_a_run_only_begins_by_its_command(
        is_zk in any::<bool>(),
        runs in any::<bool>(),
        steps in prop::collection::vec((0..1_500_000u64, step()), 1..60),
    ) {
        let ecu = if is_zk { Ecu::Zk } else { Ecu::Amt };
        let safe = Throttle::from_percent(10).unwrap();
        let config = ecu.with(|s| {
            s.loss = Loss { hold: micros(400_000), throttle: safe, ramp: 5000, standby_after: Some(micros(600_000)), ..Loss::DEFAULT };
        });
        let mut scenario =
            if runs { Scenario::started_with(ecu, config, percent(60)) } else { Scenario::with(ecu, config) };
        let mut latched = false;
        for (wait, step) in steps {
            scenario.pass_us(wait);
            let commands = match step {
                Step::Reports(reports) => { scenario.reports(reports); vec![] }
                Step::Silent => { scenario.silent(); vec![] }
                Step::Command(command, origin) => vec![(command, origin)],
                Step::Fly(command, origin, tenths) => vec![(command, origin); tenths as usize],
            };
            for (command, origin) in commands {
                scenario.pass_us(crate::support::scenario::COMMAND_PERIOD_US);
                // A demand on its way moves with the time, not with the command.
                scenario.bench.act(|engine, now| engine.timeout(now));
                let before = scenario.telemetry();
                let ran = matches!(before.ordered.order, Order::Run(_) | Order::Doubt(_));
                let answer = scenario.command_from(command, origin);
                let after = scenario.telemetry();
                let runs_now = matches!(after.ordered.order, Order::Run(_) | Order::Doubt(_));
                match (command, answer) {
                    (Command::EmergencyStop, answer) => {
                        prop_assert_eq!(answer, Ok(Accepted::InForce));
                        latched = true;
                    }
                    (Command::ReleaseStop, Ok(_)) => latched = false,
                    (Command::Run(_), Ok(Accepted::InForce)) => {
                        prop_assert!(runs_now);
                        prop_assert_eq!(after.active_source, origin);
                        if !ran {
                            prop_assert!(after.armed && before.link == LinkState::Up);
                            prop_assert_eq!(before.ordered.order, Order::Standby);
                        }
                    }
                    // Its source still counts as received: it commands run.
                    (_, Err(Rejected::NeedsVersion { known: None, .. })) => {
                        prop_assert_eq!(after.ordered.order, before.ordered.order);
                    }
                    (_, Err(_)) => prop_assert_eq!(after.ordered, before.ordered),
                    _ => {}
                }
                prop_assert!(ran || !runs_now || answer == Ok(Accepted::InForce), "{:?} {:?}", command, answer);
                let free = matches!(
                    command,
                    Command::EmergencyStop | Command::ReleaseStop | Command::Disarm | Command::Present
                );
                prop_assert!(!before.stop_latched || free || answer == Err(Rejected::StopLatched));
            }
            let now = scenario.telemetry();
            prop_assert_eq!(now.stop_latched, latched);
            prop_assert_eq!(now.ordered.order == Order::EmergencyStop, latched);
            if let (Order::Run(demand) | Order::Doubt(demand), Some(received)) = (now.ordered.order, now.source_last_rx) {
                let age = now.at.duration_since(received).as_micros();
                let low = match demand {
                    Demand::Throttle(throttle) => throttle <= safe,
                    Demand::Rpm(rpm) => rpm.get() <= ZK_IDLE,
                };
                // 0.5 s, 0.4 s, 2 s of a take-over that did not complete, and the ramp.
                prop_assert!(age < 4_000_000 || low, "{:?} is {} µs old", demand, age);
            }
        }
    }
}
