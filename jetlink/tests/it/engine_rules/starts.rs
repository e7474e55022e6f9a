//! Events that a start survives, and events that end it.

use super::*;

/// "Disarm ends a start that has not reached running, in doubt or not": also one that a reset has cut short.
#[test]
fn disarm_ends_a_start_that_a_reset_has_cut_short() {
    let config = Ecu::Amt.config();
    let mut scenario = Scenario::ready(Ecu::Amt, config);
    scenario.command(run(0)).unwrap();
    scenario.reports(Reports::Starting);
    scenario.fly_us(run(0), Origin::Rc, SECOND);
    let mut scenario = scenario.reset(config);
    scenario.silent();
    scenario.command(Command::Disarm).unwrap();
    scenario.bench.frames();
    for _ in 0..20 {
        let _ = scenario.command(Command::Present);
        receive(&mut scenario, &amt_frames::normal(amt_frames::STARTED_UP, amt_frames::RUN, 30));
    }
    let sent = scenario.sent();
    assert_eq!(runs_in(&sent).len(), 0, "disarmed, and the start continues: {sent:?}");
}

/// "An order to run without a living engine ends: ... or the start's time": also over resets.
#[test]
fn the_time_limit_of_a_start_continues_across_resets() {
    let config = Ecu::Amt.config();
    let mut scenario = Scenario::ready(Ecu::Amt, config);
    scenario.command(run(0)).unwrap();
    scenario.reports(Reports::Starting);
    // "An order to run without a living engine ends: ... or the start's time": 10 resets, 60 s apart, source fresh.
    let mut orders = Vec::new();
    for _ in 0..10 {
        scenario = scenario.reset(config);
        scenario.reports = None;
        scenario.bench.frames();
        let end = scenario.now_us() + 60 * SECOND;
        while scenario.now_us() < end {
            let _ = scenario.command(run(0));
            receive(&mut scenario, &amt_frames::normal(amt_frames::STARTING, amt_frames::RUN, 30));
        }
        orders.push(scenario.order());
    }
    assert_eq!(orders.last(), Some(&Order::Standby), "10 min in a start: {orders:?}");
}

/// An AMT start over which the node browns out: not armed, no permission, and the ECU has never reported running. AMT-14: until
/// full operation the start throttle.
#[test]
fn amt_14_after_a_brown_out_in_a_start_the_throttle_does_not_rise() {
    for state in [amt_frames::CLEARANCE, amt_frames::STARTING, amt_frames::STARTED_UP] {
        let mut scenario = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
        scenario.command(run(0)).unwrap();
        scenario.reports(Reports::Starting);
        let retained = scenario.bench.machine.record().without_start();
        let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), Some(retained));
        scenario.bench.frames();
        for _ in 0..200 {
            let _ = scenario.command(run(100));
            receive(&mut scenario, &amt_frames::normal(state, amt_frames::RUN, 30));
        }
        let most = runs_in(&scenario.sent()).into_iter().max();
        assert!(
            most.unwrap_or(0) == 0,
            "{state:#07b}: run at {most:?}, armed {}",
            scenario.telemetry().armed
        );
    }
}

/// The same with nothing in memory: the engine may run, and be reported in idle calibration, but it may as well be in a start. It is sent
/// the throttle that its ECU reports, and no more until the ECU reports running. The control: then it rises to the commanded throttle.
#[test]
fn amt_14_without_memory_the_throttle_does_not_rise_before_the_ecu_reports_running() {
    for state in [amt_frames::STARTED_UP, amt_frames::IDLE_CALIBRATION, 0b11110] {
        for throttle in [0, 500] {
            let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), None);
            scenario.values.half_percents = (throttle / 5) as u8;
            scenario.bench.frames();
            let mut frame = scenario.ecu.frame(Reports::Running, scenario.values);
            let running = frame.clone();
            frame[1] = state << 3 | amt_frames::RUN;
            for (frame, expected) in [(frame, throttle), (running, 1000)] {
                for _ in 0..100 {
                    let _ = scenario.command(run(100));
                    receive(&mut scenario, &frame);
                }
                let sent = runs_in(&scenario.sent());
                assert_eq!(sent.iter().max(), Some(&expected), "{state:#07b}: {sent:?}");
                assert_eq!(sent.iter().min(), Some(&throttle), "{state:#07b}: {sent:?}");
                assert!(sent.len() > 90, "answered: {}", sent.len());
            }
        }
    }
}

/// "No engine starts by itself": a node that begins with nothing in memory, no source that has ever commanded, and an AMT
/// engine in start clearance whose shaft turns at 15 000 rpm, because it coasts, windmills or is cooled.
#[test]
fn a_cold_boot_starts_no_engine_that_coasts_in_start_clearance() {
    let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), None);
    scenario.bench.frames();
    for _ in 0..40 {
        receive(&mut scenario, &amt_frames::normal(amt_frames::CLEARANCE, amt_frames::AUTO_STOP, 30));
    }
    let sent = scenario.sent();
    assert_eq!(runs_in(&sent), [] as [u16; 0], "no source has ever commanded");
}
