//! In doubt a demand is retained, and no healthy engine is shut down.

use super::*;

/// "in mode 3 the demand as ID 7 alternating with it ... While a source is fresh this continues".
#[test]
fn in_doubt_an_rpm_demand_is_sent_for_as_long_as_its_source_is_fresh() {
    let mut scenario = Scenario::started(Ecu::Zk, rpm(100_000));
    let fly = Command::Run(rpm(100_000));
    scenario.fly_us(fly, Origin::Rc, SECOND);
    // The wire from the ECU is cut, and the pilot lowers the demand.
    scenario.silent();
    for second in 1..=20 {
        scenario.bench.frames();
        scenario.fly_us(Command::Run(rpm(60_000)), Origin::Rc, SECOND);
        let out = scenario.bench.bytes().iter().filter(|frame| frame[1] >> 4 == 7).count();
        assert!(out > 0, "second {second}: no ID 7; order {:?}", scenario.order());
    }
}

/// "telemetry and an event say that the demand does not reach the engine": for as long as it does not.
#[test]
fn in_doubt_telemetry_reports_that_the_demand_does_not_reach_the_engine() {
    let mut scenario = flying(Ecu::Zk, 60);
    scenario.silent().fly_us(run(30), Origin::Rc, 30 * SECOND);
    let Telemetry { in_doubt, ordered, .. } = scenario.telemetry();
    assert!(in_doubt.is_some(), "30 s without a frame of the ECU, the source is fresh: {ordered:?}");
}

/// "only a source's standby or stop ends it": while a source is fresh, doubt does not end in an order that is gone, so that
/// the pilot's demand is refused.
#[test]
fn in_doubt_a_fresh_source_keeps_its_demand() {
    let mut scenario = flying(Ecu::Zk, 60);
    scenario.silent().fly_us(run(60), Origin::Rc, 30 * SECOND);
    assert_eq!(scenario.order(), Order::Doubt(percent(60)));
}

/// "when all sources are silent and the stages of loss have run out": a lower source that streams standby is not silent. It ends the run
/// after its own time.
#[test]
fn in_doubt_a_lower_source_that_streams_standby_is_not_silent() {
    let config = Ecu::Zk.with(|s| s.loss.lower_standby_after = micros(60 * SECOND));
    let mut scenario = Scenario::started_with(Ecu::Zk, config, percent(60));
    scenario.silent().fly_us(Command::Standby, Origin::Bench, 55 * SECOND);
    assert!(matches!(scenario.order(), Order::Doubt(_)), "{:?}", scenario.order());
    scenario.fly_us(Command::Standby, Origin::Bench, 8 * SECOND);
    let ordered = scenario.telemetry().ordered;
    assert_eq!((ordered.order, ordered.origin), (Order::Standby, Origin::Bench));
}

/// "A healthy engine in flight is not shut down because jetlink is in doubt": after a reset without a record a ZK ECU reports a
/// running engine on a good link, and its throttle (status ID 3) does not come.
#[test]
fn zk_a_running_engine_that_does_not_report_its_throttle_is_not_shut_down() {
    let mut scenario = Scenario::after_reset(Ecu::Zk, Ecu::Zk.config(), None);
    scenario.reports = Some(Reports::Running);
    scenario.introduce();
    scenario.pass_us(30 * SECOND);
    assert_ne!(scenario.order(), Order::Standby, "600 reports of a running engine");
}

/// The same with an AMT ECU, whose throttle differs by half a percent from set to set.
#[test]
fn amt_a_running_engine_whose_throttle_dithers_is_not_shut_down() {
    let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), None);
    scenario.bench.frames();
    for n in 0..300_u16 {
        scenario.silent().pass_us(FRAME_PERIOD_US);
        let mut set = amt_frames::normal(amt_frames::FULL_OPERATION, amt_frames::RUN, 60);
        set[4] = 120 + (n % 2) as u8;
        scenario.bench.receive(&set);
    }
    let sent = scenario.sent();
    assert!(
        sent.iter().any(|wire| matches!(wire, Wire::Run(_))) && !sent.contains(&Wire::Standby),
        "15 s of sets of a running engine: {sent:?}"
    );
}

/// "A healthy engine in flight is not shut down because jetlink is in doubt", "Doubt acts at once, the verdict needs agreement":
/// all sources have been silent for a minute, the engine idles at the fail-safe throttle, where `standby_after` is never.
fn idles_at_the_fail_safe(ecu: Ecu) -> Scenario {
    let mut scenario = flying(ecu, 60);
    scenario.reports = Some(Reports::Running);
    scenario.pass_us(60 * SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(0)), "{ecu:?}");
    scenario
}

#[test]
fn one_odd_amt_set_at_the_fail_safe_stage_shuts_nothing_down() {
    let mut scenario = idles_at_the_fail_safe(Ecu::Amt);
    // AMT frames have no checksum: one set with a flipped bit.
    scenario.bench.receive(&amt_frames::normal(amt_frames::NO_CLEARANCE, amt_frames::RUN, 24));
    scenario.pass_us(2 * SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(0)));
}

#[test]
fn a_gap_of_three_zk_frames_at_the_fail_safe_stage_shuts_nothing_down() {
    let mut scenario = idles_at_the_fail_safe(Ecu::Zk);
    scenario.silent().pass_us(160_000);
    scenario.reports = Some(Reports::Running);
    scenario.pass_us(2 * SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(0)));
}

#[test]
fn a_watchdog_reset_at_the_fail_safe_stage_shuts_nothing_down() {
    for ecu in BOTH {
        let mut scenario = idles_at_the_fail_safe(ecu).reset(ecu.config());
        scenario.pass_us(2 * SECOND);
        assert_eq!(scenario.order(), Order::Run(percent(0)), "{ecu:?}");
    }
}
