//! A demand that takes over rises at the rate.

use super::*;
use crate::support::scenario::ZK_IDLE;

/// MAVLink commands 100 %, and the first throttle sent is below 20 %.
fn mavlink_takes_over_from_a_low_throttle(scenario: &mut Scenario) {
    scenario.bench.frames();
    let first = (0..100).find_map(|_| {
        scenario.fly_us(run(100), Origin::Mavlink, COMMAND_PERIOD_US);
        runs_in(&scenario.sent()).first().copied()
    });
    assert!(first.is_some_and(|tenths| tenths < 200), "the first throttle that went out: {first:?}");
}

/// "After a ... take-over ... the demand rises at a set rate": from an rpm to a throttle, with an ECU that has not
/// reported its throttle.
#[test]
fn a_throttle_that_takes_over_from_an_rpm_rises_at_the_rate() {
    let mut scenario = Scenario::started(Ecu::Zk, rpm(20_000));
    let low = Command::Run(rpm(20_000));
    scenario.fly_us(low, Origin::Rc, SECOND);
    // RC is lost.
    mavlink_takes_over_from_a_low_throttle(&mut scenario);
}

/// The same, with a reported throttle that is minutes old.
#[test]
fn a_throttle_that_takes_over_from_an_rpm_does_not_trust_an_old_report() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.bench.receive(&zk_frames::status(3, 0, [100, 0, 0]));
    scenario.command(run(0)).unwrap();
    for reports in [Reports::Starting, Reports::Running] {
        scenario.reports(reports);
        scenario.command(Command::Run(rpm(20_000))).unwrap();
    }
    scenario.fly_us(Command::Run(rpm(20_000)), Origin::Rc, 300 * SECOND);
    mavlink_takes_over_from_a_low_throttle(&mut scenario);
}

/// Streams a command until `end_us`, while the transmitter sends or hangs.
fn command_until(scenario: &mut Scenario, command: Command, end_us: u64, sends: bool) {
    while scenario.now_us() < end_us {
        let _ = scenario.command(command);
        scenario.pass_us(FRAME_PERIOD_US);
        let now = scenario.now_us();
        match sends {
            _ if !scenario.bench.busy() => {}
            true => scenario.bench.sent_at_us(now),
            false => scenario.bench.not_sent_at_us(now, NotSent::TimedOut),
        }
    }
}

/// "After a gap the demand rises at a set rate": a hung transmitter also leaves a gap on the wire.
#[test]
fn a_demand_does_not_jump_after_a_transmitter_that_hung() {
    for ecu in BOTH {
        let mut scenario = flying(ecu, 25);
        scenario.values.half_percents = 50;
        scenario.bench = scenario.bench.clone().by_hand();
        let hangs = scenario.now_us();
        command_until(&mut scenario, run(75), hangs + 2 * SECOND, false);
        scenario.sent();
        command_until(&mut scenario, run(75), hangs + 2_200_000, true);
        let sent = runs_in(&scenario.sent());
        // 50 % a second, from the 25 % that were sent last.
        assert!(sent.iter().all(|tenths| *tenths <= 360) && !sent.is_empty(), "{ecu:?}: {sent:?}");
        command_until(&mut scenario, run(75), hangs + 4 * SECOND, true);
        assert_eq!(runs_in(&scenario.sent()).last(), Some(&750), "{ecu:?}");
    }
}

/// The same when the other kind of demand was sent last: it continues from the ECU's report, not from where it would be by now.
#[test]
fn a_demand_of_another_kind_does_not_jump_after_a_transmitter_that_hung() {
    for (before, after) in [(rpm(100_000), percent(75)), (percent(25), rpm(120_000))] {
        let mut scenario = Scenario::started(Ecu::Zk, before);
        scenario.values.rpm = Some(40_000);
        scenario.fly_us(Command::Run(before), Origin::Rc, 8 * SECOND);
        assert_eq!(scenario.order(), Order::Run(before));
        scenario.bench = scenario.bench.clone().by_hand();
        let hangs = scenario.now_us();
        command_until(&mut scenario, Command::Run(after), hangs + 2 * SECOND, false);
        command_until(&mut scenario, Command::Run(after), hangs + 2_200_000, true);
        match scenario.order() {
            // 50 % a second; the ECU reports no throttle, and 40 000 of 160 000 rpm.
            Order::Run(Demand::Throttle(throttle)) => assert!(throttle.tenths() <= 130, "{throttle:?}"),
            Order::Run(Demand::Rpm(rpm)) => assert!(rpm.get() <= 61_000, "{rpm:?}"),
            order => panic!("{order:?}"),
        }
        command_until(&mut scenario, Command::Run(after), hangs + 5 * SECOND, true);
        assert_eq!(scenario.order(), Order::Run(after));
    }
}

/// "After a ... gap the demand rises at a set rate": also one commanded before the gap began that no frame has carried. Without a
/// gap it is sent at once.
#[test]
fn amt_a_demand_that_no_reply_carried_before_a_gap_does_not_jump_after_it() {
    for (pause, highest) in [(200_000, 900), (400_000, 260)] {
        let mut scenario = flying(Ecu::Amt, 20);
        scenario.silent().fly_us(run(90), Origin::Rc, pause);
        assert_eq!(runs_in(&scenario.sent()), [], "nothing was received that could be answered");
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(run(90), Origin::Rc, 2 * FRAME_PERIOD_US);
        let sent = runs_in(&scenario.sent());
        let max = sent.iter().max();
        assert!(max.is_some_and(|max| *max <= highest), "{pause} µs: {sent:?}");
        assert_eq!(max == Some(&900), highest == 900, "{pause} µs: {sent:?}");
        scenario.fly_us(run(90), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.wire(), Wire::Run(900), "{pause} µs");
    }
}

/// After a take-over that changes the kind of the demand the throttle rises at its rate even if the stick moved before any
/// throttle was sent. The control: once one was sent, the source in control moves it freely.
#[test]
fn a_demand_of_another_kind_does_not_jump_before_it_was_sent() {
    let mut unsent = 0;
    for phase_us in (0..4 * FRAME_PERIOD_US).step_by(5_000) {
        let mut scenario = Scenario::started(Ecu::Zk, rpm(90_000));
        scenario.fly_us(Command::Run(rpm(90_000)), Origin::Bench, 10 * SECOND + phase_us);
        assert_eq!(scenario.telemetry().active_source, Origin::Bench);
        // It reports a throttle of 60 %.
        scenario.bench.receive(&zk_frames::status(3, TURNING, [60, 0, 0]));
        while !matches!(scenario.order(), Order::Run(Demand::Throttle(_))) {
            let _ = scenario.command_from(Command::Run(rpm(90_000)), Origin::Bench);
            let _ = scenario.command(run(40));
            scenario.pass_us(1_000);
        }
        let before = runs_in(&scenario.sent());
        unsent += usize::from(before.is_empty());
        scenario.command(run(90)).unwrap();
        scenario.pass_us(2 * FRAME_PERIOD_US);
        let sent = runs_in(&scenario.sent());
        let rises = !sent.is_empty() && sent.iter().all(|tenths| *tenths <= 500);
        // A frame being sent counts when it is complete.
        assert!(rises || (!before.is_empty() && sent.contains(&900)), "{before:?} {sent:?}");
    }
    assert!((1..40).contains(&unsent), "{unsent}");
}

/// "After a ... gap the demand rises at a set rate": frames sent since the ECU was last received may not have reached it. The
/// control: without a gap the stick moves it at once.
#[test]
fn zk_a_demand_sent_before_a_gap_was_found_does_not_jump_after_it() {
    for (pause, highest) in [(100_000, 900), (400_000, 300)] {
        let mut scenario = flying(Ecu::Zk, 20);
        scenario.sent();
        scenario.silent().fly_us(run(90), Origin::Rc, pause);
        assert!(runs_in(&scenario.sent()).contains(&900), "{pause} µs: it was sent");
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(run(90), Origin::Rc, 4 * FRAME_PERIOD_US);
        let sent = runs_in(&scenario.sent());
        assert!(sent.iter().all(|tenths| *tenths <= highest) && !sent.is_empty(), "{pause} µs: {sent:?}");
        scenario.fly_us(run(90), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.wire(), Wire::Run(900), "{pause} µs");
    }
}

/// A frame without a demand does not send it: an earlier demand rises after a hung transmitter. The control: a demand that was sent
/// continues.
#[test]
fn zk_a_frame_without_a_demand_does_not_send_it() {
    let (mut without, mut with) = (0, 0);
    for before in 0..4 {
        let mut scenario = flying(Ecu::Zk, 25);
        scenario.bench = scenario.bench.clone().by_hand();
        let next = |scenario: &mut Scenario| {
            scenario.sent();
            while !scenario.bench.busy() {
                scenario.pass_us(1_000);
            }
            let now = scenario.now_us();
            scenario.bench.sent_at_us(now);
            runs_in(&scenario.sent()).contains(&750)
        };
        scenario
            .command(Command::Service(Service::Zk(zk::config::Service::Action(zk::codec::Action::Rate50Hz))))
            .unwrap();
        (0..before).for_each(|_| assert!(!next(&mut scenario)));
        scenario.command(run(75)).unwrap();
        let carried = next(&mut scenario);
        let hangs = scenario.now_us();
        command_until(&mut scenario, run(75), hangs + 2 * SECOND, false);
        scenario.sent();
        command_until(&mut scenario, run(75), hangs + 2_200_000, true);
        let sent = runs_in(&scenario.sent());
        assert!(!sent.is_empty(), "{before}");
        if carried {
            with += 1;
        } else {
            without += 1;
            assert!(sent.iter().all(|tenths| *tenths <= 360), "{before}: {sent:?}");
        }
    }
    assert!(with > 0 && without > 0, "{with} {without}");
}

/// "after a gap ... the demand rises at `rise`": also to an rpm that was refused until the ECU had reported its version again. The
/// control: an rpm that is commanded once the version is known is in force at once.
#[test]
fn an_rpm_that_waited_for_the_version_does_not_jump() {
    for waits in [true, false] {
        let mut scenario = flying(Ecu::Zk, 10);
        scenario.silent();
        scenario.fly_us(run(10), Origin::Rc, SECOND);
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(run(10), Origin::Rc, SECOND);
        let full = Command::Run(rpm(150_000));
        if waits {
            let refused = Err(Rejected::NeedsVersion { needed: 4, known: None });
            assert_eq!(scenario.command(full), refused);
            scenario.fly_us(full, Origin::Rc, SECOND);
            assert_eq!(scenario.order(), Order::Run(percent(10)));
        }
        scenario.introduce();
        if !waits {
            scenario.fly_us(run(10), Origin::Rc, SECOND);
        }
        scenario.fly_us(full, Origin::Rc, 100_000);
        let Order::Run(Demand::Rpm(in_force)) = scenario.order() else { panic!("{:?}", scenario.order()) };
        // 50 % of 160 000 rpm a second, from a shaft at 12 000 rpm.
        assert_eq!(in_force.get() == 150_000, !waits, "{in_force:?}");
        assert!(!waits || in_force.get() < TURNING + 10_000, "{in_force:?}");
        scenario.fly_us(full, Origin::Rc, 3 * SECOND);
        assert_eq!(scenario.order(), Order::Run(rpm(150_000)));
    }
}

/// In doubt, an rpm in force falls to the idle rpm where a throttle is commanded in its place, and does not rise.
#[test]
fn zk_a_throttle_in_doubt_lowers_an_rpm_to_idle() {
    for commanded in [0, 80] {
        let mut scenario = Scenario::started(Ecu::Zk, rpm(100_000));
        scenario.fly_us(Command::Run(rpm(100_000)), Origin::Rc, SECOND);
        scenario.silent().fly_us(Command::Run(rpm(100_000)), Origin::Rc, SECOND);
        assert_eq!(scenario.order(), Order::Doubt(rpm(100_000)));
        scenario.fly_us(run(commanded), Origin::Rc, SECOND / 2);
        assert_eq!(scenario.order(), Order::Doubt(rpm(ZK_IDLE)), "{commanded} %");
    }
}
