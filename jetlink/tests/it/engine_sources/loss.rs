//! The stages of loss.

use super::*;

fn loss(hold_us: u64, safe_percent: u8, ramp_tenths_per_s: u16, standby_after_us: Option<u64>) -> Loss {
    Loss {
        hold: micros(hold_us),
        throttle: Throttle::from_percent(safe_percent).unwrap(),
        ramp: ramp_tenths_per_s,
        standby_after: standby_after_us.map(micros),
        ..Loss::DEFAULT
    }
}

/// Hold, a ramp to the fail-safe throttle, standby: each to the tick, and reported in this order.
#[test]
fn each_stage_of_loss_begins_exactly_to_the_tick() {
    for ecu in BOTH {
        // 50 % to 20 % at 60 % a second: 0.5 s.
        let config = ecu.with(|s| s.loss = loss(700_000, 20, 600, Some(900_000)));
        let mut scenario = Scenario::started_with(ecu, config, percent(50));
        let last = scenario.now_us();
        let lost = last + SOURCE_TIMEOUT_US;
        for (at, stage, throttle) in [
            (lost - 1, LossStage::None, 500),
            (lost, LossStage::Hold, 500),
            (lost + 699_999, LossStage::Hold, 500),
            (lost + 700_000, LossStage::FailSafe, 500),
            (lost + 800_000, LossStage::FailSafe, 440),
            (lost + 1_100_000, LossStage::FailSafe, 260),
            (lost + 1_199_999, LossStage::FailSafe, 201),
            (lost + 1_200_000, LossStage::FailSafe, 200),
            (lost + 1_599_999, LossStage::FailSafe, 200),
        ] {
            scenario.run_to_us(at);
            let telemetry = scenario.telemetry();
            assert_eq!(telemetry.loss, stage, "{ecu:?} at {}", at - lost);
            // The ramp moves every 20 ms.
            assert!(scenario.tenths().abs_diff(throttle) <= 12, "{} at {}", scenario.tenths(), at - lost);
            assert_eq!(telemetry.source_last_rx, Some(at_us(last)));
        }
        scenario.run_to_us(lost + 1_600_000);
        let ordered = scenario.telemetry().ordered;
        assert_eq!((ordered.order, ordered.origin), (Order::Standby, Origin::Node));
        assert_eq!(
            stages(&mut scenario),
            [
                (lost, LossStage::Hold),
                (lost + 700_000, LossStage::FailSafe),
                (lost + 1_600_000, LossStage::Standby)
            ],
            "{ecu:?}"
        );
        assert_eq!(scenario.wire(), Wire::Standby);
        scenario.fly_us(run(0), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst));
    }
}

/// A hold in progress keeps its length: a new one, longer or shorter, applies from the next loss on. The fail-safe throttle applies
/// at once.
#[test]
fn a_hold_that_is_changed_while_it_lasts_keeps_its_length() {
    for ecu in BOTH {
        for hold in [5 * SECOND, 200_000] {
            let mut config = ecu.with(|s| s.loss = loss(SECOND, 20, 60_000, None));
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            let lost = scenario.now_us() + SOURCE_TIMEOUT_US;
            scenario.run_to_us(lost + SECOND / 2);
            config.supervision.loss = loss(hold, 30, 60_000, None);
            let now = scenario.now_us();
            scenario.bench.act(|engine, _| engine.configure(at_us(now), &config.supervision)).unwrap();
            scenario.run_to_us(lost + 2 * SECOND);
            let first = [(lost, LossStage::Hold), (lost + SECOND, LossStage::FailSafe)];
            assert_eq!(stages(&mut scenario), first, "{ecu:?} {hold}");
            assert_eq!(scenario.tenths(), 300, "{ecu:?} {hold}");

            scenario.fly_us(run(50), Origin::Rc, 4 * SECOND);
            assert_eq!(scenario.telemetry().loss, LossStage::None, "{ecu:?} {hold}");
            let _ = stages(&mut scenario);
            let lost = scenario.telemetry().source_last_rx.unwrap().as_micros() + SOURCE_TIMEOUT_US;
            scenario.run_to_us(lost + hold + SECOND);
            let second = [(lost, LossStage::Hold), (lost + hold, LossStage::FailSafe)];
            assert_eq!(stages(&mut scenario), second, "{ecu:?} {hold}");
        }
    }
}

/// By default: hold 1 s, then idle at 50 % a second, never standby.
#[test]
fn loss_by_default_is_idle_and_never_standby() {
    assert_eq!(Loss::DEFAULT, loss(1_000_000, 0, 500, None));
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        let lost = scenario.now_us() + SOURCE_TIMEOUT_US;
        scenario.run_to_us(lost + SECOND);
        assert_eq!(scenario.tenths(), 500);
        scenario.run_to_us(lost + 2 * SECOND - 1);
        assert!(scenario.tenths() > 0);
        scenario.run_to_us(lost + 2 * SECOND);
        assert_eq!((scenario.tenths(), scenario.wire()), (0, Wire::Run(0)), "{ecu:?}");
        scenario.pass_us(600 * SECOND);
        assert_eq!((scenario.order(), scenario.wire()), (Order::Run(percent(0)), Wire::Run(0)));
    }
}

/// The fail-safe throttle only ever lowers.
#[test]
fn the_fail_safe_throttle_never_raises() {
    for ecu in BOTH {
        for (demand, safe, expected) in [(50, 20, 200), (10, 20, 100), (0, 100, 0), (100, 100, 1000)] {
            let config = ecu.with(|s| s.loss = loss(500_000, safe, 1000, None));
            let mut scenario = Scenario::started_with(ecu, config, percent(demand));
            for _ in 0..100 {
                scenario.pass_us(COMMAND_PERIOD_US / 2);
                assert!(scenario.tenths() <= u16::from(demand) * 10);
            }
            assert_eq!(scenario.tenths(), expected, "{ecu:?} {demand} {safe}");
        }
    }
}

/// A source that returns has to be received for 1 s without a gap; then it takes over like any other.
#[test]
fn a_source_that_returns_is_in_control_after_1_s() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.pass_us(10 * SECOND);
        assert_eq!((scenario.tenths(), scenario.telemetry().loss), (0, LossStage::FailSafe));
        scenario.bench.events();
        let back = scenario.now_us();
        assert_eq!(scenario.command(run(3)), Ok(Accepted::Held));
        scenario.fly_us(run(3), Origin::Rc, SECOND - 1);
        assert_eq!((scenario.tenths(), scenario.telemetry().loss), (0, LossStage::FailSafe));
        scenario.run_to_us(back + SECOND);
        assert_eq!(scenario.command(run(3)), Ok(Accepted::InForce));
        assert_eq!((scenario.tenths(), scenario.telemetry().loss), (0, LossStage::None), "{ecu:?}: close");
        // 3 % at 50 % a second.
        scenario.pass_us(60_000);
        assert_eq!(scenario.tenths(), 30);
        assert_eq!(stages(&mut scenario), [(back + SECOND, LossStage::None)]);

        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.pass_us(10 * SECOND);
        let back = scenario.now_us();
        scenario.fly_us(run(50), Origin::Rc, 3 * SECOND - 1);
        assert_eq!(scenario.tenths(), 0, "{ecu:?}: far, so held off for 2 s more");
        assert_eq!(scenario.telemetry().loss, LossStage::FailSafe);
        scenario.run_to_us(back + 3 * SECOND);
        assert_eq!((scenario.tenths(), scenario.telemetry().loss), (0, LossStage::None));
        scenario.fly_us(run(50), Origin::Rc, SECOND);
        assert_eq!(scenario.tenths(), 500);
    }
}

/// A source that disappears and returns every few 100 ms: the stages continue as if it had stayed away, and the
/// throttle never rises. Also if its first gap is too long to count as short, or if none is.
#[test]
fn a_flapping_source_neither_resets_the_stages_nor_makes_the_engine_hunt() {
    for ecu in BOTH {
        for ((on, off), return_within) in
            [(300_000, 600_000), (100_000, 550_000), (900_000, 501_000), (300_000, 800_000)]
                .into_iter()
                .flat_map(|times| [(times, 0), (times, SECOND)])
        {
            let config = ecu.with(|s| {
                s.loss.standby_after = Some(micros(20 * SECOND));
                s.return_within = micros(return_within);
            });
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            let lost = scenario.now_us() + SOURCE_TIMEOUT_US;
            scenario.pass_us(off.max(SOURCE_TIMEOUT_US + return_within));
            let mut before = 500;
            while scenario.now_us() < lost + 15 * SECOND {
                scenario.fly_us(run(50), Origin::Rc, on);
                // The last command came at most COMMAND_PERIOD_US before.
                scenario.pass_us(off);
                let now = scenario.tenths();
                assert!(now <= before, "{ecu:?} {on} {off}: {now} after {before}");
                before = now;
            }
            assert_eq!(before, 0, "{ecu:?} {on} {off}");
            scenario.run_to_us(lost + 21 * SECOND);
            assert_eq!(scenario.order(), Order::Standby);
            assert_eq!(
                stages(&mut scenario),
                [
                    (lost, LossStage::Hold),
                    (lost + SECOND, LossStage::FailSafe),
                    (lost + 21 * SECOND, LossStage::Standby)
                ],
                "{ecu:?} {on} {off}"
            );
        }
        // The control: gaps shorter than the timeout do not count.
        let mut scenario = Scenario::started(ecu, percent(50));
        for _ in 0..20 {
            scenario.fly_us(run(50), Origin::Rc, 300_000);
            scenario.pass_us(350_000);
        }
        assert_eq!((scenario.tenths(), stages(&mut scenario)), (500, vec![]), "{ecu:?}");
    }
}

/// A flapping higher source does not repeatedly take an engine from a steady lower one.
#[test]
fn a_flapping_source_leaves_the_steady_one_below_alone() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.fly_us(run(30), Origin::Mavlink, 4 * SECOND);
        assert_eq!((scenario.telemetry().active_source, scenario.tenths()), (Origin::Mavlink, 300));
        scenario.bench.events();
        for i in 0..200 {
            scenario.command_from(run(30), Origin::Mavlink).unwrap();
            if i % 8 < 2 {
                assert_eq!(scenario.command(run(80)), Ok(Accepted::Held));
            }
            scenario.pass_us(COMMAND_PERIOD_US);
            assert_eq!(scenario.tenths(), 300, "{ecu:?}");
        }
        assert_eq!(active_sources(&mut scenario), []);
        // The control: steady for 1 s, and then close, or for 2 s more.
        for i in 0..41 {
            scenario.command_from(run(30), Origin::Mavlink).unwrap();
            scenario.command(run(80)).unwrap();
            scenario.pass_us(COMMAND_PERIOD_US);
            // Then 50 % a second.
            assert_eq!(scenario.telemetry().active_source == Origin::Rc, i >= 29, "{ecu:?} {i}");
            assert!(scenario.tenths() <= 300 + 50 * (i + 1_u16).saturating_sub(30) + 50, "{ecu:?} {i}");
        }
        assert_eq!((scenario.telemetry().active_source, scenario.tenths()), (Origin::Rc, 800), "{ecu:?}");
    }
}

/// Each engine has its own numbers.
#[test]
fn each_engine_has_its_own_stages_of_loss() {
    let quick = Ecu::Zk.with(|s| s.loss = loss(0, 10, 10_000, None));
    let slow = Ecu::Zk.with(|s| s.loss = loss(5 * SECOND, 0, 10, None));
    let mut quick = Scenario::started_with(Ecu::Zk, quick, percent(50));
    let mut slow = Scenario::started_with(Ecu::Zk, slow, percent(50));
    quick.pass_us(SECOND);
    slow.pass_us(SECOND);
    assert_eq!((quick.tenths(), slow.tenths()), (100, 500));
    slow.pass_us(14_500_000);
    assert_eq!(slow.tenths(), 400, "1 % a second from 5.5 s on");
}

/// Loss of the ECU and loss of the source are handled separately.
#[test]
fn a_lost_link_and_a_lost_source_are_handled_separately() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.sent();
        scenario.silent().fly_us(run(60), Origin::Rc, 3 * SECOND);
        let telemetry = scenario.telemetry();
        assert_eq!((telemetry.link, telemetry.loss), (LinkState::Lost, LossStage::None));
        assert_eq!(telemetry.commanded, Some(percent(60)));
        let Order::Doubt(demand) = scenario.order() else { panic!("{ecu:?}: {:?}", scenario.order()) };
        scenario.sent();
        scenario.fly_us(run(60), Origin::Rc, SECOND / 2);
        assert_eq!(scenario.sent(), [], "{ecu:?}: nothing that could start an engine");
        assert_eq!(scenario.order(), Order::Doubt(demand), "{ecu:?}: it does not rise");
        scenario.reports(Reports::Running);
        assert_eq!(scenario.telemetry().link, LinkState::Up);
        scenario.fly_us(run(60), Origin::Rc, SECOND / 2);
        assert_eq!(scenario.order(), Order::Run(percent(60)), "{ecu:?}");

        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.pass_us(5 * SECOND);
        let telemetry = scenario.telemetry();
        assert_eq!((telemetry.link, telemetry.loss), (LinkState::Up, LossStage::FailSafe));

        // Both: the stages run in the same way.
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.silent().pass_us(3 * SECOND);
        assert_eq!(scenario.order(), Order::Doubt(percent(0)), "{ecu:?}");
        assert_eq!(scenario.telemetry().loss, LossStage::FailSafe, "{ecu:?}");
    }
}

/// In standby and under a stop there is no demand to lose.
#[test]
fn there_is_no_loss_without_a_demand() {
    for ecu in BOTH {
        for command in [Command::Standby, Command::EmergencyStop] {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            scenario.command(command).unwrap();
            scenario.bench.events();
            scenario.pass_us(60 * SECOND);
            assert_eq!(scenario.telemetry().loss, LossStage::None);
            assert_eq!(scenario.bench.event_kinds(), []);
        }
    }
}

/// Only demands keep a demand fresh, not other commands of the same source.
#[test]
fn only_a_demand_keeps_a_demand_fresh() {
    for ecu in BOTH {
        for command in [Command::Arm, Command::ReleaseStop, Command::Disarm] {
            let mut scenario = Scenario::started(ecu, percent(50));
            for _ in 0..40 {
                scenario.pass_us(COMMAND_PERIOD_US);
                let _ = scenario.command(command);
            }
            assert_eq!(scenario.tenths(), 0, "{ecu:?} {command:?}");
        }
    }
}

/// An rpm demand falls to the idle rpm that the ECU reported, or to idle throttle if it reported none; it only falls,
/// even if the ECU has lowered its maximum since.
#[test]
fn an_rpm_demand_falls_to_idle_when_its_source_is_lost() {
    for (demand, safe) in [(100_000, ZK_IDLE), (ZK_IDLE - 1_000, ZK_IDLE - 1_000)] {
        let mut scenario = Scenario::started(Ecu::Zk, rpm(demand));
        scenario.pass_us(SOURCE_TIMEOUT_US + SECOND);
        assert_eq!(scenario.order(), Order::Run(rpm(demand)));
        scenario.pass_us(5 * SECOND);
        assert_eq!(scenario.order(), Order::Run(rpm(safe)), "{demand}");
        assert_eq!(scenario.telemetry().loss, LossStage::FailSafe);
    }
    // 50 % of 160 000 rpm a second: 40 000 after half a second.
    let mut scenario = Scenario::started(Ecu::Zk, rpm(100_000));
    scenario.pass_us(SOURCE_TIMEOUT_US + SECOND + 500_000);
    let Order::Run(Demand::Rpm(half_way)) = scenario.order() else { panic!("{:?}", scenario.order()) };
    assert!(half_way.get().abs_diff(60_000) <= 1_600, "{half_way:?}");

    let config = Ecu::Zk.config();
    let mut scenario = Scenario::nothing_received(Ecu::Zk, config);
    for _ in 0..2 {
        scenario.bench.receive(&zk_frames::identity(160, 5, 0));
    }
    scenario.reports(Reports::Standby).pass_us(2 * SECOND);
    scenario.command(Command::Arm).unwrap();
    scenario.command(Command::Standby).unwrap();
    scenario.command(run(0)).unwrap();
    // If no idle speed is known, a tenth of the maximum is used.
    scenario.values.rpm = Some(ZK_MAX / 10);
    scenario.reports(Reports::Starting).reports(Reports::Running);
    scenario.fly_us(Command::Run(rpm(100_000)), Origin::Rc, 2 * SECOND);
    assert_eq!(scenario.order(), Order::Run(rpm(100_000)));
    scenario.pass_us(5 * SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(0)), "no idle rpm is known");

    let mut scenario = Scenario::started(Ecu::Zk, rpm(100_000));
    for _ in 0..2 {
        scenario.bench.receive(&zk_frames::status(6, TURNING, [4, 0, 5 << 2]));
    }
    scenario.pass_us(5 * SECOND);
    let low = match scenario.order() {
        Order::Run(Demand::Rpm(rpm)) => rpm.get() <= ZK_IDLE,
        Order::Run(Demand::Throttle(throttle)) => throttle == Throttle::IDLE,
        _ => false,
    };
    assert!(low, "{:?}", scenario.order());
}
