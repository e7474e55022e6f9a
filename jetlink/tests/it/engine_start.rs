//! The reported state of an engine, and the conditions for a start. For both ECUs, exact to the tick.

use embassy_time::Duration;
use jetlink::command::{Accepted, Command, Interlock, Order, Origin, Rejected};
use jetlink::engine::state::EngineState;
use jetlink::event::{End, Event};
use jetlink::limit::LimitKind;
use jetlink::report::{EcuState, LinkState};
use jetlink::units::{Celsius, Millivolts, Rpm, Throttle};

use crate::support::frames::{amt as amt_frames, zk as zk_frames};
use crate::support::scenario::{
    ALL, BOTH, COMMAND_PERIOD_US, Ecu, FRAME_PERIOD_US, Reports, SECOND, Scenario, TURNING, Values, Wire,
    ZK_IDLE, ZK_MAX, percent, rpm, run,
};
use bench::by_hand::at_us;

// ---------------------------------------------------------------------------------------------
// States
// ---------------------------------------------------------------------------------------------

/// Below half of the idle speed of either engine.
const SLOW: u32 = 2_000;

fn starting(code: u8, name: &'static str) -> EngineState {
    EngineState::Starting(EcuState { code, name })
}

/// AMT-3: each state with each switch and a shaft that turns or not. The phase does not come from a command: there was none.
#[test]
fn amt_3_each_state_is_reported_as_its_phase() {
    use EngineState::*;
    use amt_frames::{AUTO_STOP, EMERGENCY, RUN};
    let table = [
        (0b00000, EMERGENCY, 0, Stopped),
        (0b00000, EMERGENCY, 9, Cooling),
        (0b00000, AUTO_STOP, 0, Standby),
        (0b00000, AUTO_STOP, 9, Cooling),
        (0b00000, RUN, 0, StartRequested),
        (0b00001, AUTO_STOP, 0, Standby),
        (0b00001, AUTO_STOP, 9, Cooling),
        (0b00001, RUN, 0, StartRequested),
        (0b00001, RUN, 9, StartRequested),
        (0b00010, RUN, 9, starting(2, "starting")),
        (0b00010, AUTO_STOP, 9, ShuttingDown),
        (0b00100, RUN, 9, starting(4, "started up")),
        (0b01000, RUN, 9, starting(8, "idle calibration")),
        (0b01100, RUN, 99, Running),
        (0b01100, AUTO_STOP, 99, ShuttingDown),
        (0b01100, EMERGENCY, 99, ShuttingDown),
        (0b11111, RUN, 99, NotKnown),
        (0b10101, AUTO_STOP, 0, NotKnown),
    ];
    for (state, switch, raw_rpm, expected) in table {
        let mut scenario = Scenario::nothing_received(Ecu::Amt, Ecu::Amt.config());
        assert_eq!(scenario.telemetry().state, Offline);
        for i in 1..=3 {
            scenario.bench.rx_at_us(i * FRAME_PERIOD_US, &amt_frames::normal(state, switch, raw_rpm));
        }
        let shown = scenario.telemetry().state;
        match (shown, expected) {
            // The codec's own tests check the names of the steps.
            (Starting(shown), Starting(expected)) => assert_eq!(shown.code, expected.code),
            _ => assert_eq!(shown, expected, "{state:#07b} {switch:#05b} {raw_rpm}"),
        }
    }
    // AMT-8: an error set carries no state. The previous state counts for 3 s, then only the fault is known.
    let mut scenario = Scenario::started(Ecu::Amt, percent(0));
    scenario.values.fault = 0x01;
    scenario.pass_us(2_900_000);
    assert_eq!(scenario.telemetry().state, Running);
    scenario.pass_us(200_000);
    assert_eq!(scenario.telemetry().state, Fault);
}

/// Every code of a ZK ECU, the unknown ones included, with each switch that it can report.
#[test]
fn zk_each_state_is_reported_as_its_phase() {
    for code in 0..32u8 {
        for switch in 0..4u8 {
            let mut scenario = Scenario::with(Ecu::Zk, Ecu::Zk.config());
            scenario.bench.rx_at_us(FRAME_PERIOD_US, &zk_frames::status(1, 0, [code, switch << 5, 76]));
            scenario.bench.rx_at_us(2 * FRAME_PERIOD_US, &zk_frames::status(1, 0, [code, switch << 5, 76]));
            let running = switch == 2;
            let ending = switch < 2;
            let expected = match code {
                0 => EngineState::Stopped,
                1 if running => EngineState::StartRequested,
                1 => EngineState::Standby,
                2..=11 | 13 if ending => EngineState::ShuttingDown,
                // With an unnamed switch the state is enough.
                2..=5 | 13 => starting(code, ""),
                6..=11 => EngineState::Running,
                12 => EngineState::Cooling,
                14..=19 => EngineState::Service,
                _ => EngineState::NotKnown,
            };
            match (scenario.telemetry().state, expected) {
                (EngineState::Starting(shown), EngineState::Starting(_)) => assert_eq!(shown.code, code),
                (shown, expected) => assert_eq!(shown, expected, "code {code} switch {switch}"),
            }
        }
        // An engine that does not run, with a fault, is in fault.
        let mut scenario = Scenario::with(Ecu::Zk, Ecu::Zk.config());
        scenario.bench.rx_at_us(FRAME_PERIOD_US, &zk_frames::status(1, 0, [code | 3 << 5, 1 << 5, 76]));
        scenario.bench.rx_at_us(2 * FRAME_PERIOD_US, &zk_frames::status(1, 0, [code | 3 << 5, 1 << 5, 76]));
        let state = scenario.telemetry().state;
        let alive = matches!(code, 2..=11 | 13);
        assert_eq!(state == EngineState::Fault, !alive, "code {code}: {state:?}");
    }
}

/// A state ages: it is unknown if a received ECU no longer reports it, and offline if the ECU is silent.
#[test]
fn a_state_is_as_old_as_its_report() {
    let mut scenario = Scenario::started(Ecu::Zk, percent(50));
    let last = scenario.now_us();
    scenario.silent();
    // Another status keeps the link up.
    for i in 1..=100 {
        let t = last + i * 30_000;
        scenario.bench.rx_at_us(t, &zk_frames::status(8, TURNING, [5, 0, 0]));
        assert_eq!(scenario.telemetry().state, EngineState::Running, "{} µs", i * 30_000);
    }
    scenario.bench.rx_at_us(last + 3 * SECOND + 1, &zk_frames::status(8, TURNING, [5, 0, 0]));
    assert_eq!(scenario.telemetry().state, EngineState::NotKnown);
    assert_eq!(scenario.telemetry().link, LinkState::Up);
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.silent().pass_us(ecu.config().timing.lost_after.as_micros() - 1);
        assert_eq!(scenario.telemetry().state, EngineState::Running);
        scenario.pass_us(1);
        assert_eq!(scenario.telemetry().state, EngineState::Offline, "{ecu:?}");
    }
}

/// A command does not affect the reported state.
#[test]
fn a_state_is_never_taken_from_a_command() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.command(run(0)).unwrap();
        scenario.pass_us(SECOND);
        assert_eq!(scenario.telemetry().state, EngineState::Standby, "{ecu:?}: the ECU reports so");
        scenario.command(Command::EmergencyStop).unwrap();
        scenario.reports(Reports::Running);
        assert_eq!(scenario.telemetry().state, EngineState::Running);
    }
}

// ---------------------------------------------------------------------------------------------
// Interlocks
// ---------------------------------------------------------------------------------------------

fn refused(interlock: Interlock) -> Result<Accepted, Rejected> {
    Err(Rejected::Start(interlock))
}

/// The control for all following tests: a ready engine starts.
#[test]
fn an_engine_that_is_ready_starts() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        assert_eq!(scenario.wire(), Wire::Standby);
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{ecu:?}");
        assert_eq!((scenario.order(), scenario.wire()), (Order::Run(percent(0)), Wire::Run(0)));
        assert_eq!(scenario.telemetry().active_source, Origin::Rc);
    }
}

/// After power-up only standby is ordered, and a stream of run alone starts nothing.
#[test]
fn a_stream_of_run_alone_starts_nothing() {
    for ecu in BOTH {
        for reports in [Reports::Stopped, Reports::Standby, Reports::Cooling] {
            let mut scenario = Scenario::new(ecu);
            scenario.reports(reports).pass_us(2 * SECOND);
            scenario.command(Command::Arm).unwrap();
            let ordered = scenario.telemetry().ordered;
            assert_eq!((ordered.order, ordered.origin), (Order::Standby, Origin::Node));
            for _ in 0..50 {
                assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst));
                scenario.pass_us(100_000);
            }
            assert_eq!(scenario.wire(), Wire::Standby, "{ecu:?} {reports:?}");
        }
    }
}

/// A source that commanded armed before an emergency stop has to command disarmed first. If another source has armed meanwhile, this
/// does not prevent a start.
#[test]
fn disarm_first_is_announced_only_while_nobody_else_has_armed() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.reports(Reports::Standby);
        scenario.command(Command::EmergencyStop).unwrap();
        scenario.pass_us(SECOND);
        scenario.command(Command::ReleaseStop).unwrap();
        assert_eq!(scenario.command(Command::Arm), Err(Rejected::DisarmFirst), "{ecu:?}");
        scenario.fly_us(Command::Standby, Origin::Rc, 2 * SECOND);
        assert!(scenario.start_refusals(run(0), Origin::Rc).contains(&Rejected::DisarmFirst), "{ecu:?}");
        scenario.command_from(Command::Arm, Origin::Bench).unwrap();
        assert_eq!(scenario.start_refusals(run(0), Origin::Rc), [], "{ecu:?}");
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{ecu:?}");
    }
}

/// `Scenario` compares each answer to a run with what was announced; here all reasons have to be announced at once.
#[test]
fn everything_that_keeps_an_engine_from_a_start_is_announced_in_the_order_of_refusals() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        assert_eq!(scenario.start_refusals(run(0), Origin::Rc), [], "{ecu:?}");
        assert_eq!(
            scenario.start_refusals(run(0), Origin::Bench),
            [Rejected::Behind(Origin::Rc), Rejected::StandbyFirst]
        );
        scenario.command(Command::EmergencyStop).unwrap();
        assert_eq!(scenario.command(Command::Arm), Err(Rejected::StopLatched));
        scenario.reports(Reports::Starting).pass_us(SECOND);
        scenario.others_allow_start = false;
        let all = scenario.start_refusals(run(50), Origin::Rc);
        let interlocks = [Interlock::NotIdle, Interlock::NotStandby, Interlock::OtherStarting];
        let before = [Rejected::StopLatched, Rejected::StandbyFirst, Rejected::DisarmFirst];
        let expected: Vec<Rejected> = before.into_iter().chain(interlocks.map(Rejected::Start)).collect();
        assert_eq!(all, expected, "{ecu:?}");
        assert_eq!(scenario.command(run(50)), Err(Rejected::StopLatched));
    }
}

#[test]
fn a_start_needs_arming() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.command(Command::Disarm).unwrap();
        assert!(!scenario.telemetry().armed);
        scenario.command(Command::Standby).unwrap();
        assert_eq!(scenario.command(run(0)), refused(Interlock::NotArmed), "{ecu:?}");
        scenario.command(Command::Arm).unwrap();
        assert!(scenario.telemetry().armed);
        scenario.command(Command::Standby).unwrap();
        scenario.command(run(0)).unwrap();
        // Disarming stops no engine that runs.
        scenario.reports(Reports::Starting).reports(Reports::Running);
        scenario.command(Command::Disarm).unwrap();
        scenario.fly_us(run(50), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.wire(), Wire::Run(500));

        let mut scenario = Scenario::ready(ecu, ecu.with(|s| s.start.arming = false));
        scenario.command(Command::Disarm).unwrap();
        scenario.command(Command::Standby).unwrap();
        scenario.command(run(0)).expect("arming is not required");
    }
}

/// From standby only, as the ECU reports it.
#[test]
fn a_start_needs_standby() {
    for ecu in BOTH {
        for reports in ALL {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            scenario.reports(reports);
            scenario.command(Command::Standby).unwrap();
            let answer = scenario.command(run(0));
            if reports == Reports::Standby {
                assert_eq!(answer, Ok(Accepted::InForce));
            } else {
                assert_eq!(answer, refused(Interlock::NotStandby), "{ecu:?} {reports:?}");
                assert_eq!(scenario.order(), Order::Standby);
            }
        }
    }
}

/// The idle band, to its edge; an rpm up to the idle rpm that the ECU reports.
#[test]
fn a_start_needs_a_demand_at_idle() {
    for ecu in BOTH {
        let config = ecu.with(|s| s.start.idle_band = Throttle::from_tenths(35).unwrap());
        for (tenths, starts) in [(0, true), (35, true), (36, false), (1000, false)] {
            let mut scenario = Scenario::ready(ecu, config);
            let answer = scenario.command(Command::Run(crate::support::scenario::tenths(tenths)));
            let expected = if starts { Ok(Accepted::InForce) } else { refused(Interlock::NotIdle) };
            assert_eq!(answer, expected, "{ecu:?} {tenths}");
        }
    }
    for (demand, starts) in [(0, true), (ZK_IDLE, true), (ZK_IDLE + 1, false)] {
        let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
        let answer = scenario.command(Command::Run(rpm(demand)));
        assert_eq!(answer.is_ok(), starts, "{demand}: {answer:?}");
    }
}

/// Up for the configured time without a gap, to the tick.
#[test]
fn a_start_needs_a_link_that_is_up_for_long_enough() {
    for ecu in BOTH {
        let config = ecu.with(|s| s.start.link_stable = Duration::from_millis(1500));
        let mut scenario = Scenario::with(ecu, config);
        scenario.reports(Reports::Standby).silent().pass_us(2 * SECOND);
        assert_eq!(scenario.telemetry().link, LinkState::Lost);
        scenario.command(Command::Arm).unwrap();
        scenario.bench.events();
        scenario.reports(Reports::Standby);
        let up = scenario.bench.events().iter().find(|(_, event)| *event == Event::LinkUp).expect("up").0;
        let left = up + 1_499_999 - scenario.now_us();
        scenario.fly_us(Command::Standby, Origin::Rc, left);
        assert_eq!(scenario.command(run(0)), refused(Interlock::Link), "{ecu:?}");
        scenario.run_to_us(up + 1_500_000);
        scenario.command(Command::Standby).unwrap();
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{ecu:?}");

        let mut scenario = Scenario::ready(ecu, config);
        scenario.silent().fly_us(Command::Standby, Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.command(run(0)), refused(Interlock::Link), "{ecu:?}: lost");

        // After a gap without a loss of the link, the time begins with the first frame.
        for (millis, answer) in [(1400, refused(Interlock::Link)), (1600, Ok(Accepted::InForce))] {
            let mut scenario = Scenario::ready(ecu, config);
            let gap = if ecu == Ecu::Amt { 900_000 } else { 400_000 };
            scenario.silent().fly_us(Command::Standby, Origin::Rc, gap);
            assert_eq!(scenario.telemetry().link, LinkState::Up);
            scenario.reports = Some(Reports::Standby);
            scenario.fly_us(Command::Standby, Origin::Rc, millis * 1000);
            assert_eq!(scenario.command(run(0)), answer, "{ecu:?} {millis}");
        }
    }
}

#[test]
fn a_start_needs_an_ecu_without_a_fault() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.values.fault = 1;
        scenario.pass_us(2 * FRAME_PERIOD_US);
        assert_eq!(scenario.command(run(0)), refused(Interlock::Fault), "{ecu:?}");
        scenario.values.fault = 0;
        scenario.pass_us(2 * FRAME_PERIOD_US);
        scenario.command(Command::Standby).unwrap();
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{ecu:?}");
    }
}

/// To the degree on ZK; AMT counts in steps of 4.6 °C.
#[test]
fn a_start_needs_a_cool_exhaust() {
    for (ecu, cool, hot, shown) in [(Ecu::Zk, 100, 101, 1010), (Ecu::Amt, 97, 101, 1018)] {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.values.egt_celsius = if ecu == Ecu::Amt { 102 } else { hot };
        scenario.pass_us(2 * FRAME_PERIOD_US);
        let too_hot = Interlock::TooHot(Celsius::from_tenths(shown));
        assert_eq!(scenario.command(run(0)), refused(too_hot), "{ecu:?}");
        scenario.values.egt_celsius = cool;
        scenario.pass_us(2 * FRAME_PERIOD_US);
        scenario.command(Command::Standby).unwrap();
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{ecu:?}");
    }
    // An old temperature does not count.
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.silent();
    // Without a gap.
    for _ in 0..24 {
        let t = scenario.now_us() + FRAME_PERIOD_US;
        scenario.bench.rx_at_us(t, &zk_frames::idle(5, false));
        scenario.command(Command::Standby).unwrap();
    }
    assert_eq!(scenario.command(run(0)), refused(Interlock::EgtUnknown));
}

/// Where it is known: an AMT ECU reports it in its alternate set, a ZK ECU in status ID 2.
#[test]
fn a_start_needs_a_sufficient_supply_where_it_is_known() {
    for ecu in BOTH {
        let mut scenario =
            Scenario::ready(ecu, ecu.with(|s| s.start.supply_min = Some(Millivolts::new(u32::MAX >> 8))));
        scenario.command(run(0)).expect("not known, so not checked");

        let mut scenario = Scenario::ready(ecu, ecu.config());
        let supply = |scenario: &mut Scenario| {
            let frame = match ecu {
                Ecu::Amt => amt_frames::alternate(0x06).to_vec(),
                Ecu::Zk => zk_frames::status(2, 0, [0, 100, 0]).to_vec(),
            };
            scenario.bench.receive(&frame);
            scenario.telemetry().report.supply.and_then(|supply| supply.value.voltage).expect("a scale")
        };
        let shown = supply(&mut scenario).get();
        for (least, starts) in [(shown, true), (shown + 1, false)] {
            let mut scenario =
                Scenario::ready(ecu, ecu.with(|s| s.start.supply_min = Some(Millivolts::new(least))));
            let is = supply(&mut scenario);
            let expected = if starts { Ok(Accepted::InForce) } else { refused(Interlock::SupplyLow(is)) };
            assert_eq!(scenario.command(run(0)), expected, "{ecu:?} {least}");
        }
    }
}

/// Each engine makes the others wait while it starts, and for the gap after it. A waiting engine starts at its source's next
/// command.
#[test]
fn one_engine_of_a_group_starts_at_a_time() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.others_allow_start = false;
        assert_eq!(scenario.command(run(0)), Ok(Accepted::StartWaits), "{ecu:?}");
        assert_eq!((scenario.order(), scenario.wire()), (Order::Standby, Wire::Standby));
        assert!(!scenario.bench.machine.blocks_other_starts(at_us(scenario.now_us())));
        scenario.others_allow_start = true;
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce));
        let started = scenario.now_us();
        let keeps = |scenario: &Scenario, t| scenario.bench.machine.blocks_other_starts(at_us(t));
        assert!(keeps(&scenario, started));
        // Longer than the gap of 10 s, and still starting.
        scenario.reports(Reports::Starting).fly_us(run(0), Origin::Rc, 12 * SECOND);
        assert!(keeps(&scenario, scenario.now_us()));
        scenario.reports(Reports::Running);
        assert!(!keeps(&scenario, scenario.now_us()), "{ecu:?}");

        // A quick start: the gap decides.
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.command(run(0)).unwrap();
        let started = scenario.now_us();
        scenario.reports(Reports::Starting).reports(Reports::Running);
        assert!(keeps(&scenario, started + 10 * SECOND - 1));
        assert!(!keeps(&scenario, started + 10 * SECOND));
    }
}

/// A refusal is reported once with its reason, and changes nothing but the start permission, which it uses up.
#[test]
fn a_refusal_is_typed_counted_and_reported_once() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.bench.events();
        assert_eq!(scenario.command(run(50)), refused(Interlock::NotIdle));
        for _ in 1..10 {
            assert_eq!(scenario.command(run(50)), Err(Rejected::StandbyFirst));
            scenario.pass_us(COMMAND_PERIOD_US);
        }
        let reported = [Rejected::Start(Interlock::NotIdle), Rejected::StandbyFirst];
        let reported = reported.map(|why| Event::CommandRejected(why, Origin::Rc));
        assert_eq!(scenario.bench.event_kinds(), reported, "{ecu:?}");
        assert_eq!(scenario.telemetry().counters.commands_rejected, 10);
        assert_eq!(scenario.wire(), Wire::Standby);
    }
}
// ---------------------------------------------------------------------------------------------
// The start
// ---------------------------------------------------------------------------------------------

/// One standby allows one start, and an engine after an uncommanded shutdown is not restarted by a stream of run.
#[test]
fn an_engine_that_stopped_is_not_restarted_by_a_stream_of_run() {
    for ecu in BOTH {
        for reports in [Reports::Stopped, Reports::Standby, Reports::Cooling] {
            let mut scenario = Scenario::started(ecu, percent(50));
            scenario.reports(reports);
            let ordered = scenario.telemetry().ordered;
            assert_eq!(
                (ordered.order, ordered.origin),
                (Order::Standby, Origin::Node),
                "{ecu:?} {reports:?}"
            );
            let events = scenario.bench.event_kinds();
            assert_eq!(events.iter().filter(|event| matches!(event, Event::RunCancelled(_))).count(), 1);
            for _ in 0..50 {
                assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst));
                scenario.pass_us(COMMAND_PERIOD_US);
            }
            assert_eq!(scenario.wire(), Wire::Standby);
            // The control: standby first.
            scenario.reports(Reports::Standby);
            scenario.command(Command::Standby).unwrap();
            scenario.command(run(0)).unwrap();
        }
    }
}

/// Two reports in a row, not one: on a noisy line a damaged frame can report this for a running engine.
#[test]
fn one_odd_report_does_not_cancel_a_run() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        for _ in 0..10 {
            scenario.command(run(50)).unwrap();
            scenario.pass_us(10_000);
            scenario.odd(Reports::Stopped, scenario.values);
            assert_eq!(scenario.order(), Order::Doubt(percent(50)), "{ecu:?}");
            scenario.pass_us(2 * FRAME_PERIOD_US);
            assert_eq!(scenario.order(), Order::Run(percent(50)), "{ecu:?}: two reports show that it runs");
            let reported = scenario.bench.event_kinds();
            let reported: Vec<_> =
                reported.iter().filter(|event| !matches!(event, Event::Ordered(_))).collect();
            assert_eq!(reported, [&Event::LifeInDoubt, &Event::LifeConfirmed], "{ecu:?}");
        }
        // The control: two.
        for _ in 0..2 {
            scenario.pass_us(10_000);
            scenario.odd(Reports::Stopped, scenario.values);
        }
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}");
        assert!(scenario.bench.event_kinds().contains(&Event::RunCancelled(End::AtRest)));
    }
}

/// A start that the ECU has not begun is not cancelled by the standby that it still reports, only when it is lost.
#[test]
fn a_start_waits_for_the_ecu_to_report_it() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.fly_us(run(0), Origin::Rc, 4 * SECOND);
        assert_eq!(scenario.order(), Order::Run(percent(0)), "{ecu:?}");
        scenario.silent().fly_us(run(0), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}: lost before it came alive");
        assert!(scenario.bench.event_kinds().iter().any(|event| matches!(event, Event::RunCancelled(_))));
    }
}

/// Until the ECU reports a running engine the throttle on the wire stays at idle, whatever the source commands.
#[test]
fn the_throttle_stays_at_idle_until_the_engine_runs() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.command(run(0)).unwrap();
        scenario.bench.frames();
        for reports in [Reports::Standby, Reports::Starting, Reports::Unknown] {
            scenario.reports = Some(reports);
            scenario.fly_us(run(80), Origin::Rc, SECOND);
            let sent = scenario.sent();
            assert!(sent.iter().all(|wire| *wire == Wire::Run(0)), "{ecu:?} {reports:?}: {sent:?}");
        }
        assert_eq!(scenario.telemetry().commanded, Some(percent(80)));
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(run(80), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.wire(), Wire::Run(800), "{ecu:?}");
    }
}

/// AMT-14, ZK: one odd report does not bring a running engine to idle, neither on the wire nor for a moment. Whatever it
/// reports, only the demand is sent, and ID 0 or no reply while the life of the engine is in doubt.
#[test]
fn one_odd_report_does_not_drop_the_throttle() {
    for ecu in BOTH {
        // With a slew limit it would take long to come back.
        for up in [None, Some(10)] {
            let config = ecu.with(|s| s.slew.up = up);
            let mut scenario = Scenario::started_with(ecu, config, percent(80));
            scenario.fly_us(run(80), Origin::Rc, 100 * SECOND);
            scenario.sent();
            for reports in
                [Reports::Starting, Reports::Standby, Reports::Cooling, Reports::Stopped, Reports::Unknown]
            {
                scenario.command(run(80)).unwrap();
                let values = Values { rpm: Some(SLOW), ..scenario.values };
                scenario.pass_us(10_000);
                scenario.odd(reports, values);
                assert_eq!(scenario.order(), Order::Doubt(percent(80)), "{ecu:?} {reports:?}");
                scenario.fly_us(run(80), Origin::Rc, COMMAND_PERIOD_US);
                assert_eq!(scenario.order(), Order::Run(percent(80)), "{ecu:?} {reports:?}");
                scenario.fly_us(run(80), Origin::Rc, 2 * COMMAND_PERIOD_US);
                let sent = scenario.sent();
                assert!(sent.len() >= 4, "{ecu:?} {reports:?}: {sent:?}");
                assert!(sent.iter().all(|wire| *wire == Wire::Run(800)), "{ecu:?} {reports:?}: {sent:?}");
            }
            // The control: it goes back to starting and stays there, with a shaft that no longer turns.
            scenario.reports = Some(Reports::Starting);
            scenario.values.rpm = Some(SLOW);
            scenario.fly_us(run(80), Origin::Rc, SECOND);
            assert_eq!(scenario.wire(), Wire::Standby, "{ecu:?}");
        }
    }
}

/// A start that takes too long goes to standby, with an event that names the limit in force; a stream of run starts nothing.
#[test]
fn a_start_times_out_exactly_to_the_tick() {
    for ecu in BOTH {
        for reports in [Reports::Standby, Reports::Starting] {
            let config = ecu.with(|s| s.start.timeout = Duration::from_secs(20));
            let mut scenario = Scenario::ready(ecu, config);
            let start = scenario.now_us();
            scenario.command(run(0)).unwrap();
            scenario.reports = Some(reports);
            scenario.fly_us(run(0), Origin::Rc, 20 * SECOND - 1);
            assert!(matches!(scenario.order(), Order::Run(_)), "{ecu:?} {reports:?}");
            scenario.bench.events();
            scenario.pass_us(1);
            let ordered = scenario.telemetry().ordered;
            assert_eq!((ordered.order, ordered.origin), (Order::Standby, Origin::Node));
            let violations = scenario.violations_at();
            assert_eq!(violations.len(), 1, "{ecu:?}");
            let (at, violation) = violations[0];
            assert_eq!(
                (violation.kind, violation.value, violation.limit),
                (LimitKind::StartTimeout, 20_000, 20_000)
            );
            assert_eq!(at, start + 20 * SECOND);
            assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst));
        }
        // The control: it runs in time.
        let config = ecu.with(|s| s.start.timeout = Duration::from_secs(20));
        let mut scenario = Scenario::started_with(ecu, config, percent(0));
        scenario.fly_us(run(0), Origin::Rc, 30 * SECOND);
        assert!(matches!(scenario.order(), Order::Run(_)));
        assert_eq!(scenario.limits(), []);
    }
}

/// If the ECU reports its own start-up time, twice that time applies, and the event shows it.
#[test]
fn a_start_times_out_after_twice_the_ecus_own_start_up_time() {
    let mut scenario = Scenario::with(Ecu::Zk, Ecu::Zk.config());
    scenario.bench.receive(&zk_frames::status(8, 0, [5, 0, 40]));
    let startup = scenario.telemetry().report.startup.expect("version 5 gives it").value;
    assert!(startup > Duration::from_secs(1), "{startup}");
    scenario.reports(Reports::Standby).pass_us(2 * SECOND);
    scenario.command(Command::Arm).unwrap();
    scenario.command(Command::Standby).unwrap();
    let start = scenario.now_us();
    scenario.command(run(0)).unwrap();
    scenario.reports = Some(Reports::Starting);
    let twice = startup.as_micros() * 2;
    scenario.fly_us(run(0), Origin::Rc, twice - 1);
    assert!(matches!(scenario.order(), Order::Run(_)));
    scenario.bench.events();
    scenario.pass_us(1);
    assert_eq!(scenario.order(), Order::Standby);
    let (at, violation) = scenario.violations_at()[0];
    let limit = i32::try_from(twice / 1000).unwrap();
    assert_eq!((violation.kind, violation.value, violation.limit), (LimitKind::StartTimeout, limit, limit));
    assert_eq!(at, start + twice);
}

/// The range of the configured time applies: not shorter than an engine needs to start, and not endless. A time of 0 is none: the
/// configured one applies.
#[test]
fn the_ecus_own_start_up_time_has_bounds() {
    let config = Ecu::Zk.with(|rules| rules.start.timeout = Duration::from_secs(20));
    for (tenths_of_a_second, seconds) in [(0u16, 20), (5, 5), (40, 8), (0xFFF, 600)] {
        let mut scenario = Scenario::with(Ecu::Zk, config);
        let [high, low] = tenths_of_a_second.to_be_bytes();
        scenario.bench.receive(&zk_frames::status(8, 0, [5, high, low]));
        assert!(scenario.telemetry().report.startup.is_some());
        scenario.reports(Reports::Standby).pass_us(2 * SECOND);
        scenario.command(Command::Arm).unwrap();
        scenario.command(Command::Standby).unwrap();
        scenario.command(run(0)).unwrap();
        scenario.reports = Some(Reports::Starting);
        scenario.fly_us(run(0), Origin::Rc, seconds * SECOND - 1);
        assert!(matches!(scenario.order(), Order::Run(_)), "{tenths_of_a_second}");
        scenario.pass_us(1);
        assert_eq!(scenario.order(), Order::Standby, "{tenths_of_a_second}");
    }
}

/// A source that commands a start while the node still listens is answered accordingly, or that nothing is received. A stream
/// of standby is obeyed after 1 s in which a higher source could have commanded; while nothing shows whether the engine runs, and
/// whose run it is, after the time that a lower source's takes.
#[test]
fn no_source_starts_an_engine_while_the_node_listens() {
    for ecu in BOTH {
        let mut scenario = Scenario::nothing_received(ecu, ecu.config());
        assert_eq!(scenario.command(run(0)), Err(Rejected::Listening), "{ecu:?}");
        scenario.pass_us(5 * SECOND);
        assert_eq!(scenario.command(run(0)), Err(Rejected::NoLink), "{ecu:?}");
        assert_eq!(scenario.command(Command::Standby), Ok(Accepted::RepeatStandby));
        assert_eq!(scenario.sent(), [], "nothing but ID 0");
        scenario.introduce();
        scenario.reports(Reports::Standby);
        assert_eq!(scenario.order(), Order::Standby);
        scenario.command(Command::Standby).unwrap();

        for (origin, after) in [(Origin::Emergency, SECOND), (Origin::Rc, 6 * SECOND)] {
            let mut scenario = Scenario::nothing_received(ecu, ecu.config());
            let standby = |scenario: &mut Scenario| scenario.command_from(Command::Standby, origin);
            assert_eq!(standby(&mut scenario), Ok(Accepted::RepeatStandby));
            scenario.fly_us(Command::Standby, origin, after - 1);
            assert_eq!(standby(&mut scenario), Ok(Accepted::Held), "{ecu:?} {origin:?}");
            assert_eq!((scenario.order(), scenario.sent()), (Order::Listen, vec![]));
            scenario.pass_us(1);
            assert_eq!(standby(&mut scenario), Ok(Accepted::InForce), "{ecu:?} {origin:?}");
            assert_eq!(scenario.order(), Order::Standby);
        }
    }
}

/// An rpm demand needs an ECU with speed control. A demand above the engine's maximum is clamped to it, and reported once.
#[test]
fn an_rpm_demand_needs_speed_control() {
    let mut scenario = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
    assert_eq!(scenario.command(Command::Run(rpm(0))), Err(Rejected::NoSpeedControl));
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    assert_eq!(scenario.command(Command::Run(rpm(0))), Ok(Accepted::InForce));
    scenario.reports(Reports::Starting).reports(Reports::Running);
    scenario.bench.events();
    for demand in [ZK_MAX, ZK_MAX + 1, u32::MAX] {
        scenario.fly_us(Command::Run(rpm(demand)), Origin::Rc, 2 * SECOND + COMMAND_PERIOD_US);
        assert_eq!(scenario.order(), Order::Run(rpm(ZK_MAX)), "{demand}");
        assert_eq!(scenario.wire(), Wire::RpmControl);
    }
    let reported: Vec<_> =
        scenario.bench.event_kinds().into_iter().filter(|event| matches!(event, Event::Clamped(_))).collect();
    assert_eq!(reported, [Event::Clamped(Rpm::new(ZK_MAX))]);
}

/// One odd report of a running engine during a start, perhaps of a damaged frame, neither releases the demand nor ends the
/// time of the start. Two do.
#[test]
fn one_odd_report_does_not_end_a_start() {
    for (reports, ends) in [(1, false), (2, true)] {
        let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
        scenario.command(run(0)).unwrap();
        scenario.reports(Reports::Starting);
        scenario.fly_us(run(80), Origin::Rc, SECOND);
        for _ in 0..reports {
            scenario.pass_us(FRAME_PERIOD_US / 4);
            scenario.odd(Reports::Running, scenario.values);
        }
        assert_eq!(scenario.telemetry().start_by.is_none(), ends, "{reports}");
        if ends {
            scenario.reports = Some(Reports::Running);
        }
        scenario.fly_us(run(80), Origin::Rc, SECOND);
        // 50 % a second, in steps of 20 ms.
        let expected = if ends { 490..=500 } else { 0..=0 };
        assert!(expected.contains(&scenario.tenths()), "{reports}: {}", scenario.tenths());
    }
}

/// A loss that ends at the moment when it is detected still restarts the stable time of the link.
#[test]
fn a_link_loss_that_ends_at_once_restarts_the_stable_link_time() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.silent();
        scenario.bench.jump_to_us(scenario.now_us() + 2 * SECOND);
        scenario.command_from(Command::Standby, Origin::Bench).unwrap();
        for _ in 0..2 {
            scenario.odd(Reports::Standby, scenario.values);
        }
        assert_eq!(scenario.telemetry().link, LinkState::Up);
        let answer = scenario.command_from(run(0), Origin::Bench);
        assert_eq!(answer, Err(Rejected::Start(Interlock::Link)), "{ecu:?}");
        scenario.reports(Reports::Standby);
        scenario.fly_us(Command::Standby, Origin::Bench, SECOND);
        assert_eq!(scenario.command_from(run(0), Origin::Bench), Ok(Accepted::InForce), "{ecu:?}");
    }
}

/// Arming and disarming are reported, once for each change.
#[test]
fn arming_is_reported() {
    let mut scenario = Scenario::with(Ecu::Zk, Ecu::Zk.config());
    scenario.bench.events();
    for (command, armed) in [(Command::Arm, true), (Command::Disarm, false)] {
        scenario.command(command).unwrap();
        assert_eq!(scenario.bench.event_kinds(), [Event::Armed(armed, Origin::Rc)]);
        scenario.command(command).unwrap();
        assert_eq!(scenario.bench.event_kinds(), [], "the same again");
    }
}
