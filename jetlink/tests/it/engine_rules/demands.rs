//! A demand that takes over rises at the rate.

use super::*;

/// "After a ... take-over ... the demand rises at a set rate": from an rpm to a throttle, of an ECU that has not given its
/// throttle.
#[test]
fn a_throttle_that_takes_over_from_an_rpm_rises_at_the_rate() {
    let mut scenario = Scenario::started(Ecu::Zk, rpm(20_000));
    let low = Command::Run(rpm(20_000));
    scenario.fly(low, Origin::Rc, SECOND);
    // RC is lost; MAVLink asks for 100 %.
    scenario.bench.frames();
    let mut first = None;
    for _ in 0..100 {
        scenario.fly(run(100), Origin::Mavlink, PERIOD);
        if let Some(tenths) = runs_in(&scenario.sent()).first() {
            first = Some(*tenths);
            break;
        }
    }
    assert!(first.is_some_and(|tenths| tenths < 200), "the first throttle that went out: {first:?}");
}

/// The same, where the throttle that the ECU gave is minutes old.
#[test]
fn a_throttle_that_takes_over_from_an_rpm_does_not_trust_an_old_report() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.bench.receive(&zk_frames::status(3, 0, [100, 0, 0]));
    scenario.command(run(0)).unwrap();
    for says in [Says::Starting, Says::Running] {
        scenario.says(says);
        scenario.command(Command::Run(rpm(20_000))).unwrap();
    }
    scenario.fly(Command::Run(rpm(20_000)), Origin::Rc, 300 * SECOND);
    scenario.bench.frames();
    let mut first = None;
    for _ in 0..100 {
        scenario.fly(run(100), Origin::Mavlink, PERIOD);
        if let Some(tenths) = runs_in(&scenario.sent()).first() {
            first = Some(*tenths);
            break;
        }
    }
    assert!(first.is_some_and(|tenths| tenths < 200), "the first throttle that went out: {first:?}");
}
