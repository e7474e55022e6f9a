//! Who rules, how another takes over, and what happens when nobody speaks. For both ECUs, to the tick.

use embassy_time::Duration;
use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::ecu::{Service, amt, zk};
use jetlink::engine::Loss;
use jetlink::event::{Event, LossStage};
use jetlink::limit::{Action, Limit};
use jetlink::report::LinkState;
use jetlink::units::{Celsius, Throttle};

use crate::support::bench::{micros, us};
use crate::support::frames::zk as zk_frames;
use crate::support::scenario::{
    BOTH, EVERY, Ecu, PERIOD, SECOND, Says, Scenario, TURNING, Wire, ZK_IDLE, ZK_MAX, percent, rpm, run,
    tenths,
};

/// RC's age limit.
const AGE: u64 = 500_000;

fn stages(scenario: &mut Scenario) -> Vec<(u64, LossStage)> {
    scenario
        .bench
        .events()
        .into_iter()
        .filter_map(|(at, event)| if let Event::SourceLoss(stage) = event { Some((at, stage)) } else { None })
        .collect()
}

fn rulers(scenario: &mut Scenario) -> Vec<(u64, Origin)> {
    scenario
        .bench
        .events()
        .into_iter()
        .filter_map(
            |(at, event)| if let Event::ActiveSource(origin) = event { Some((at, origin)) } else { None },
        )
        .collect()
}

// ---------------------------------------------------------------------------------------------
// Arbitration
// ---------------------------------------------------------------------------------------------

/// The highest source that is fresh rules; those below it are told who does, and change nothing.
#[test]
fn the_highest_fresh_source_rules() {
    for ecu in BOTH {
        for lower in [Origin::Mavlink, Origin::Bench] {
            let mut scenario = Scenario::started(ecu, percent(50));
            for (command, answer) in [
                (run(20), Accepted::Behind(Origin::Rc)),
                (Command::Standby, Accepted::OneMore),
                (Command::Standby, Accepted::Behind(Origin::Rc)),
            ] {
                assert_eq!(scenario.command_from(command, lower), Ok(answer), "{command:?}");
            }
            assert_eq!((scenario.order(), scenario.wire()), (Order::Run(percent(50)), Wire::Run(500)));
            assert_eq!(scenario.telemetry().active_source, Origin::Rc);
            assert_eq!(scenario.bench.event_kinds(), [], "{ecu:?}");
            // What is done once cannot wait.
            let service = match ecu {
                Ecu::Amt => Service::Amt(amt::config::Service::Ctf),
                Ecu::Zk => Service::Zk(zk::config::Service::Action(zk::codec::Action::Rate50Hz)),
            };
            for command in [Command::HandOverToPwm, Command::Service(service)] {
                assert_eq!(scenario.command_from(command, lower), Err(Rejected::Behind(Origin::Rc)));
            }
            scenario.pass(5 * SECOND);
            assert!(scenario.sent().iter().all(|wire| matches!(wire, Wire::Run(_))), "{ecu:?}");
        }
        // A higher one takes over.
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.command_from(run(52), Origin::Emergency).unwrap();
        assert_eq!(scenario.telemetry().active_source, Origin::Emergency);
        // 2 % at 50 % a second.
        scenario.pass(40_000);
        let telemetry = scenario.telemetry();
        assert_eq!(
            (telemetry.active_source, telemetry.ordered.order),
            (Origin::Emergency, Order::Run(percent(52)))
        );
        assert_eq!(scenario.command(run(50)), Ok(Accepted::Behind(Origin::Emergency)));
    }
}

/// Each source has its own age limit, to the tick.
#[test]
fn each_source_has_its_own_age() {
    let limits = [
        (Origin::Emergency, 300_000),
        (Origin::Rc, 450_000),
        (Origin::Mavlink, 1_200_000),
        (Origin::Bench, 700_001),
    ];
    for ecu in BOTH {
        for (origin, limit) in limits {
            let config = ecu.with(|s| {
                s.ages.emergency = micros(300_000);
                s.ages.rc = micros(450_000);
                s.ages.mavlink = micros(1_200_000);
                s.ages.bench = micros(700_001);
            });
            let mut scenario = Scenario::ready(ecu, config);
            scenario.pass(5 * SECOND);
            // One that was silent has to speak for a second first.
            scenario.fly(Command::Standby, origin, SECOND + PERIOD);
            assert_eq!(scenario.command_from(run(0), origin), Ok(Accepted::InForce));
            scenario.says(Says::Starting);
            scenario.command_from(run(0), origin).unwrap();
            scenario.says(Says::Running);
            scenario.command_from(run(40), origin).unwrap();
            let last = scenario.now();
            scenario.to(last + limit - 1);
            assert_eq!(scenario.telemetry().loss, LossStage::None, "{ecu:?} {origin:?}");
            scenario.to(last + limit);
            let telemetry = scenario.telemetry();
            assert_eq!(
                (telemetry.loss, telemetry.active_source),
                (LossStage::Hold, origin),
                "{ecu:?} {origin:?}"
            );
            assert_eq!(telemetry.source_last_rx, Some(us(last)));
        }
    }
}

/// A source far from the throttle in force is held off until it comes within the band, or has waited.
#[test]
fn taking_over_is_bumpless() {
    for ecu in BOTH {
        // Close at once: at once.
        for close in [45, 50, 55] {
            let mut scenario = Scenario::started(ecu, percent(50));
            let answer = scenario.command_from(run(close), Origin::Emergency);
            assert_eq!(answer, Ok(Accepted::InForce), "{close}");
            assert_eq!(rulers(&mut scenario), [(scenario.now(), Origin::Emergency)]);
            // Down at once, up at 50 % a second.
            assert_eq!(scenario.tenths(), 500.min(u16::from(close) * 10), "{ecu:?}");
            scenario.pass(PERIOD);
            assert_eq!(scenario.order(), Order::Run(percent(close)), "{ecu:?}");
        }
        // Far: held, and the throttle in force with it, until it has come close.
        for (far, close) in [(90, 55), (10, 45)] {
            let mut scenario = Scenario::started(ecu, percent(50));
            assert_eq!(scenario.command_from(run(far), Origin::Emergency), Ok(Accepted::Held));
            scenario.fly(run(far), Origin::Emergency, SECOND);
            assert_eq!((scenario.order(), scenario.wire()), (Order::Run(percent(50)), Wire::Run(500)));
            let telemetry = scenario.telemetry();
            assert_eq!(
                (telemetry.active_source, telemetry.waiting),
                (Origin::Rc, Some(Origin::Emergency)),
                "{ecu:?}"
            );
            scenario.command_from(run(close), Origin::Emergency).unwrap();
            assert_eq!(scenario.telemetry().waiting, None);
            assert_eq!(rulers(&mut scenario), [(scenario.now(), Origin::Emergency)]);
            scenario.pass(PERIOD);
            assert_eq!(scenario.order(), Order::Run(percent(close)));
            scenario.command_from(run(far), Origin::Emergency).unwrap();
            assert_eq!(scenario.order(), Order::Run(percent(far)), "it rules now");
        }
        // Far, and it stays there: after the time, to the tick.
        let mut scenario = Scenario::started(ecu, percent(50));
        let from = scenario.now();
        scenario.fly(run(90), Origin::Emergency, 2 * SECOND - 1);
        assert_eq!(scenario.tenths(), 500);
        scenario.to(from + 2 * SECOND);
        assert_eq!((scenario.tenths(), scenario.telemetry().active_source), (500, Origin::Emergency));
        assert_eq!(rulers(&mut scenario), [(from + 2 * SECOND, Origin::Emergency)]);
        // 40 % at 50 % a second.
        scenario.fly(run(90), Origin::Emergency, 800_000 - 1);
        assert!((880..900).contains(&scenario.tenths()), "{}", scenario.tenths());
        scenario.to(from + 2_800_000);
        assert_eq!((scenario.tenths(), scenario.wire()), (900, Wire::Run(900)));
        // The band to its edge, in tenths.
        for (demand, takes) in [(550, true), (551, false), (450, true), (449, false)] {
            let mut scenario = Scenario::started(ecu, percent(50));
            scenario.command_from(Command::Run(tenths(demand)), Origin::Emergency).unwrap();
            assert_eq!(scenario.telemetry().active_source == Origin::Emergency, takes, "{ecu:?} {demand}");
        }
    }
    // A throttle and an rpm are never close.
    let mut scenario = Scenario::started(Ecu::Zk, percent(50));
    assert_eq!(scenario.command_from(Command::Run(rpm(80_000)), Origin::Emergency), Ok(Accepted::Held));
    scenario.fly(Command::Run(rpm(80_000)), Origin::Emergency, 2 * SECOND - EVERY);
    assert_eq!(scenario.order(), Order::Run(percent(50)));
    // From the 12 000 rpm that the ECU reports, at 50 % of 160 000 rpm a second.
    scenario.fly(Command::Run(rpm(80_000)), Origin::Emergency, EVERY + 850_000);
    assert_eq!(scenario.order(), Order::Run(rpm(80_000)));
}

/// When the source that rules falls silent, the next one that speaks takes over in the same way: no stage of loss.
#[test]
fn the_next_source_takes_over_from_one_that_is_lost() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        let last = scenario.now();
        scenario.fly(run(30), Origin::Mavlink, AGE + 2 * SECOND - 1);
        assert_eq!((scenario.tenths(), scenario.telemetry().active_source), (500, Origin::Rc), "{ecu:?}");
        scenario.to(last + AGE + 2 * SECOND);
        assert_eq!(
            (scenario.tenths(), scenario.telemetry().active_source),
            (300, Origin::Mavlink),
            "{ecu:?}"
        );
        assert_eq!(stages(&mut scenario), []);
    }
}

/// A source that waits to take over while the stages of loss run leaves no deadline behind it: the bench panics if
/// the engine wants to be woken in the past.
#[test]
fn a_source_that_waits_while_another_is_lost() {
    for ecu in BOTH {
        for standby_after in [None, Some(micros(SECOND))] {
            let config = ecu.with(|s| s.loss.standby_after = standby_after);
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            let last = scenario.now();
            scenario.pass(AGE + 300_000);
            assert_eq!(scenario.telemetry().loss, LossStage::Hold);
            let speaks = scenario.now();
            scenario.fly(run(10), Origin::Mavlink, 3 * SECOND);
            assert_eq!(scenario.tenths(), 100, "{ecu:?}");
            let stages = stages(&mut scenario);
            assert_eq!(stages, [(last + AGE, LossStage::Hold), (speaks + 2 * SECOND, LossStage::None)]);
        }
    }
}

/// What the ruling source, or a higher one, is refused does not change the throttle, nor keep it fresh.
#[test]
fn a_refused_demand_changes_nothing() {
    for ecu in BOTH {
        let impossible = Command::Run(rpm(100_000));
        let why = match ecu {
            Ecu::Amt => Rejected::NoSpeedControl,
            Ecu::Zk => Rejected::NeedsVersion { needed: 4, known: Some(3) },
        };
        for origin in [Origin::Rc, Origin::Emergency, Origin::Bench] {
            let mut scenario = Scenario::started(ecu, percent(50));
            scenario.introduce_version(3);
            let last = scenario.now();
            for _ in 0..4 {
                assert_eq!(scenario.command_from(impossible, origin), Err(why), "{ecu:?} {origin:?}");
                assert_eq!(scenario.order(), Order::Run(percent(50)), "{ecu:?} {origin:?}");
                scenario.pass(PERIOD);
            }
            assert_eq!(scenario.wire(), Wire::Run(500));
            assert_eq!(stages(&mut scenario), [(last + AGE, LossStage::Hold)], "{ecu:?} {origin:?}");
        }
    }
}

/// Standby of the source that rules is obeyed at its second word within the age limit, to the tick. A single word changes
/// nothing, and does not become standby later.
#[test]
fn standby_is_obeyed_at_the_second_word() {
    for ecu in BOTH {
        for (between, obeyed) in [(0, true), (PERIOD, true), (AGE, true), (AGE + 1, false)] {
            let mut scenario = Scenario::started(ecu, percent(50));
            assert_eq!(scenario.command(Command::Standby), Ok(Accepted::OneMore));
            assert_eq!(scenario.order(), Order::Run(percent(50)));
            scenario.pass(between);
            assert_eq!(scenario.order(), Order::Run(percent(50)), "{ecu:?} {between}");
            let expected = if obeyed { Accepted::InForce } else { Accepted::OneMore };
            assert_eq!(scenario.command(Command::Standby), Ok(expected), "{between}");
            let ordered = scenario.telemetry().ordered;
            if obeyed {
                assert_eq!((ordered.order, ordered.origin), (Order::Standby, Origin::Rc));
                assert_eq!(scenario.wire(), Wire::Standby, "{ecu:?}");
            } else {
                assert_eq!((ordered.order, scenario.wire()), (Order::Run(percent(50)), Wire::Run(500)));
            }
        }
        // Another word between the two takes the first back.
        let mut scenario = Scenario::started(ecu, percent(50));
        for _ in 0..20 {
            assert_eq!(scenario.command(Command::Standby), Ok(Accepted::OneMore));
            scenario.command(run(50)).unwrap();
            scenario.pass(PERIOD);
        }
        assert_eq!(scenario.wire(), Wire::Run(500), "{ecu:?}");
    }
}

/// So is the standby of a source above the one that rules, whether it spoke before or not.
#[test]
fn two_words_of_standby_of_a_source_above_shut_down() {
    for ecu in BOTH {
        for before in [None, Some(run(50))] {
            // At its age limit it is lost.
            for between in [0, PERIOD, AGE - 1] {
                let mut scenario = Scenario::started(ecu, percent(50));
                if let Some(command) = before {
                    scenario.command_from(command, Origin::Emergency).unwrap();
                }
                let ruler = scenario.telemetry().active_source;
                assert_eq!(scenario.command_from(Command::Standby, Origin::Emergency), Ok(Accepted::OneMore));
                assert_eq!(
                    (scenario.order(), scenario.telemetry().active_source),
                    (Order::Run(percent(50)), ruler)
                );
                scenario.pass(between);
                let answer = scenario.command_from(Command::Standby, Origin::Emergency);
                assert_eq!(answer, Ok(Accepted::InForce), "{ecu:?} {before:?} {between}");
                let ordered = scenario.telemetry().ordered;
                assert_eq!((ordered.order, ordered.origin), (Order::Standby, Origin::Emergency));
                assert_eq!(scenario.wire(), Wire::Standby, "{ecu:?}");
            }
        }
    }
}

// ---------------------------------------------------------------------------------------------
// Loss of the source
// ---------------------------------------------------------------------------------------------

fn loss(hold: u64, safe: u8, ramp: u16, standby_after: Option<u64>) -> Loss {
    Loss {
        hold: micros(hold),
        throttle: Throttle::from_percent(safe).unwrap(),
        ramp,
        standby_after: standby_after.map(micros),
        ..Loss::DEFAULT
    }
}

/// Hold, a ramp to the fail-safe throttle, standby: each to the tick, and told in this order.
#[test]
fn loss_in_stages_to_the_tick() {
    for ecu in BOTH {
        // 50 % to 20 % at 60 % a second: 0.5 s.
        let config = ecu.with(|s| s.loss = loss(700_000, 20, 600, Some(900_000)));
        let mut scenario = Scenario::started_with(ecu, config, percent(50));
        let last = scenario.now();
        let lost = last + AGE;
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
            scenario.to(at);
            let telemetry = scenario.telemetry();
            assert_eq!(telemetry.loss, stage, "{ecu:?} at {}", at - lost);
            // The ramp moves every 20 ms.
            assert!(scenario.tenths().abs_diff(throttle) <= 12, "{} at {}", scenario.tenths(), at - lost);
            assert_eq!(telemetry.source_last_rx, Some(us(last)));
        }
        scenario.to(lost + 1_600_000);
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
        scenario.fly(run(0), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst));
    }
}

/// By default: hold 1 s, then idle at 50 % a second, never standby.
#[test]
fn loss_by_default_is_idle_and_never_standby() {
    assert_eq!(Loss::DEFAULT, loss(1_000_000, 0, 500, None));
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        let lost = scenario.now() + AGE;
        scenario.to(lost + SECOND);
        assert_eq!(scenario.tenths(), 500);
        scenario.to(lost + 2 * SECOND - 1);
        assert!(scenario.tenths() > 0);
        scenario.to(lost + 2 * SECOND);
        assert_eq!((scenario.tenths(), scenario.wire()), (0, Wire::Run(0)), "{ecu:?}");
        scenario.pass(600 * SECOND);
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
                scenario.pass(PERIOD / 2);
                assert!(scenario.tenths() <= u16::from(demand) * 10);
            }
            assert_eq!(scenario.tenths(), expected, "{ecu:?} {demand} {safe}");
        }
    }
}

/// A source that comes back has to speak for a second without a gap; then it takes over like any other.
#[test]
fn a_source_that_comes_back_rules_after_a_second() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.pass(10 * SECOND);
        assert_eq!((scenario.tenths(), scenario.telemetry().loss), (0, LossStage::FailSafe));
        scenario.bench.events();
        let back = scenario.now();
        assert_eq!(scenario.command(run(3)), Ok(Accepted::Held));
        scenario.fly(run(3), Origin::Rc, SECOND - 1);
        assert_eq!((scenario.tenths(), scenario.telemetry().loss), (0, LossStage::FailSafe));
        scenario.to(back + SECOND);
        assert_eq!(scenario.command(run(3)), Ok(Accepted::InForce));
        assert_eq!((scenario.tenths(), scenario.telemetry().loss), (0, LossStage::None), "{ecu:?}: close");
        // 3 % at 50 % a second.
        scenario.pass(60_000);
        assert_eq!(scenario.tenths(), 30);
        assert_eq!(stages(&mut scenario), [(back + SECOND, LossStage::None)]);

        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.pass(10 * SECOND);
        let back = scenario.now();
        scenario.fly(run(50), Origin::Rc, 3 * SECOND - 1);
        assert_eq!(scenario.tenths(), 0, "{ecu:?}: far, so held off for 2 s more");
        assert_eq!(scenario.telemetry().loss, LossStage::FailSafe);
        scenario.to(back + 3 * SECOND);
        assert_eq!((scenario.tenths(), scenario.telemetry().loss), (0, LossStage::None));
        scenario.fly(run(50), Origin::Rc, SECOND);
        assert_eq!(scenario.tenths(), 500);
    }
}

/// A source that is gone and back every few 100 ms: the stages go on as if it had stayed away, and the throttle
/// never rises. Also where its first gap is too long for a short one, or where none is.
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
            let lost = scenario.now() + AGE;
            scenario.pass(off.max(AGE + return_within));
            let mut before = 500;
            while scenario.now() < lost + 15 * SECOND {
                scenario.fly(run(50), Origin::Rc, on);
                // The last command came at most PERIOD before.
                scenario.pass(off);
                let now = scenario.tenths();
                assert!(now <= before, "{ecu:?} {on} {off}: {now} after {before}");
                before = now;
            }
            assert_eq!(before, 0, "{ecu:?} {on} {off}");
            scenario.to(lost + 21 * SECOND);
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
        // The control: shorter gaps than the age limit are none.
        let mut scenario = Scenario::started(ecu, percent(50));
        for _ in 0..20 {
            scenario.fly(run(50), Origin::Rc, 300_000);
            scenario.pass(350_000);
        }
        assert_eq!((scenario.tenths(), stages(&mut scenario)), (500, vec![]), "{ecu:?}");
    }
}

/// A flapping higher source does not take an engine back and forth from one below that is steady.
#[test]
fn a_flapping_source_leaves_the_steady_one_below_alone() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.fly(run(30), Origin::Mavlink, 4 * SECOND);
        assert_eq!((scenario.telemetry().active_source, scenario.tenths()), (Origin::Mavlink, 300));
        scenario.bench.events();
        for i in 0..200 {
            scenario.command_from(run(30), Origin::Mavlink).unwrap();
            if i % 8 < 2 {
                assert_eq!(scenario.command(run(80)), Ok(Accepted::Held));
            }
            scenario.pass(PERIOD);
            assert_eq!(scenario.tenths(), 300, "{ecu:?}");
        }
        assert_eq!(rulers(&mut scenario), []);
        // The control: steady for a second, and then close or 2 s more.
        for i in 0..41 {
            scenario.command_from(run(30), Origin::Mavlink).unwrap();
            scenario.command(run(80)).unwrap();
            scenario.pass(PERIOD);
            // Then 50 % a second.
            assert_eq!(scenario.telemetry().active_source == Origin::Rc, i >= 29, "{ecu:?} {i}");
            assert!(scenario.tenths() <= 300 + 50 * (i + 1_u16).saturating_sub(30) + 50, "{ecu:?} {i}");
        }
        assert_eq!((scenario.telemetry().active_source, scenario.tenths()), (Origin::Rc, 800), "{ecu:?}");
    }
}

/// Each engine has its own numbers.
#[test]
fn the_stages_are_each_engines_own() {
    let quick = Ecu::Zk.with(|s| s.loss = loss(0, 10, 10_000, None));
    let slow = Ecu::Zk.with(|s| s.loss = loss(5 * SECOND, 0, 10, None));
    let mut quick = Scenario::started_with(Ecu::Zk, quick, percent(50));
    let mut slow = Scenario::started_with(Ecu::Zk, slow, percent(50));
    quick.pass(SECOND);
    slow.pass(SECOND);
    assert_eq!((quick.tenths(), slow.tenths()), (100, 500));
    slow.pass(14_500_000);
    assert_eq!(slow.tenths(), 400, "1 % a second from 5.5 s on");
}

/// The ECU lost and the source lost are two things, each handled for itself.
#[test]
fn link_lost_and_source_lost_are_two_things() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.sent();
        scenario.silent().fly(run(60), Origin::Rc, 3 * SECOND);
        let telemetry = scenario.telemetry();
        assert_eq!((telemetry.link, telemetry.loss), (LinkState::Lost, LossStage::None));
        assert_eq!(telemetry.commanded, Some(percent(60)));
        let Order::Doubt(demand) = scenario.order() else { panic!("{ecu:?}: {:?}", scenario.order()) };
        scenario.sent();
        scenario.fly(run(60), Origin::Rc, SECOND / 2);
        assert_eq!(scenario.sent(), [], "{ecu:?}: nothing that could start an engine");
        assert_eq!(scenario.order(), Order::Doubt(demand), "{ecu:?}: it does not rise");
        scenario.says(Says::Running);
        assert_eq!(scenario.telemetry().link, LinkState::Up);
        scenario.fly(run(60), Origin::Rc, SECOND / 2);
        assert_eq!(scenario.order(), Order::Run(percent(60)), "{ecu:?}");

        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.pass(5 * SECOND);
        let telemetry = scenario.telemetry();
        assert_eq!((telemetry.link, telemetry.loss), (LinkState::Up, LossStage::FailSafe));

        // Both: the stages run all the same.
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.silent().pass(3 * SECOND);
        assert_eq!(scenario.order(), Order::Doubt(percent(0)), "{ecu:?}");
        assert_eq!(scenario.telemetry().loss, LossStage::FailSafe, "{ecu:?}");
    }
}

/// In standby and under a stop there is nothing to lose.
#[test]
fn no_loss_without_a_demand() {
    for ecu in BOTH {
        for command in [Command::Standby, Command::EmergencyStop] {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            scenario.command(command).unwrap();
            scenario.bench.events();
            scenario.pass(60 * SECOND);
            assert_eq!(scenario.telemetry().loss, LossStage::None);
            assert_eq!(scenario.bench.event_kinds(), []);
        }
    }
}

/// A demand is kept fresh by demands alone, not by whatever else the same source says.
#[test]
fn only_a_demand_keeps_a_demand_fresh() {
    for ecu in BOTH {
        for command in [Command::Arm, Command::ReleaseStop, Command::Disarm] {
            let mut scenario = Scenario::started(ecu, percent(50));
            for _ in 0..40 {
                scenario.pass(PERIOD);
                let _ = scenario.command(command);
            }
            assert_eq!(scenario.tenths(), 0, "{ecu:?} {command:?}");
        }
    }
}

/// An rpm demand falls to the idle rpm that the ECU gave, or to the throttle at idle if it gave none; it only lowers,
/// and rules although the ECU has lowered its maximum since.
#[test]
fn loss_of_an_rpm_demand() {
    for (demand, safe) in [(100_000, ZK_IDLE), (ZK_IDLE - 1_000, ZK_IDLE - 1_000)] {
        let mut scenario = Scenario::started(Ecu::Zk, rpm(demand));
        scenario.pass(AGE + SECOND);
        assert_eq!(scenario.order(), Order::Run(rpm(demand)));
        scenario.pass(5 * SECOND);
        assert_eq!(scenario.order(), Order::Run(rpm(safe)), "{demand}");
        assert_eq!(scenario.telemetry().loss, LossStage::FailSafe);
    }
    // 50 % of 160 000 rpm a second: 40 000 after half a second.
    let mut scenario = Scenario::started(Ecu::Zk, rpm(100_000));
    scenario.pass(AGE + SECOND + 500_000);
    let Order::Run(Demand::Rpm(half_way)) = scenario.order() else { panic!("{:?}", scenario.order()) };
    assert!(half_way.get().abs_diff(60_000) <= 1_600, "{half_way:?}");

    let config = Ecu::Zk.config();
    let mut scenario = Scenario::nothing_heard(Ecu::Zk, config);
    for _ in 0..2 {
        scenario.bench.receive(&zk_frames::identity(160, 5, 0));
    }
    scenario.says(Says::Standby).pass(2 * SECOND);
    scenario.command(Command::Arm).unwrap();
    scenario.command(Command::Standby).unwrap();
    scenario.command(run(0)).unwrap();
    // Where no idle speed is known a tenth of the maximum has to do.
    scenario.values.rpm = Some(ZK_MAX / 10);
    scenario.says(Says::Starting).says(Says::Running);
    scenario.fly(Command::Run(rpm(100_000)), Origin::Rc, 2 * SECOND);
    assert_eq!(scenario.order(), Order::Run(rpm(100_000)));
    scenario.pass(5 * SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(0)), "no idle rpm is known");

    let mut scenario = Scenario::started(Ecu::Zk, rpm(100_000));
    for _ in 0..2 {
        scenario.bench.receive(&zk_frames::status(6, TURNING, [4, 0, 5 << 2]));
    }
    scenario.pass(5 * SECOND);
    let low = match scenario.order() {
        Order::Run(Demand::Rpm(rpm)) => rpm.get() <= ZK_IDLE,
        Order::Run(Demand::Throttle(throttle)) => throttle == Throttle::IDLE,
        _ => false,
    };
    assert!(low, "{:?}", scenario.order());
}

// ---------------------------------------------------------------------------------------------
// Slew, and reductions
// ---------------------------------------------------------------------------------------------

/// Off by default; up and down each with its own rate, to the tick.
#[test]
fn slew_limits() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(20));
        scenario.command(run(80)).unwrap();
        assert_eq!(scenario.tenths(), 800, "off by default");

        let config = ecu.with(|s| {
            s.slew.up = Some(200);
            s.slew.down = Some(400);
            s.ages.rc = Duration::from_secs(60);
        });
        let mut scenario = Scenario::started_with(ecu, config, percent(20));
        scenario.pass(5 * SECOND);
        let from = scenario.now();
        scenario.command(run(80)).unwrap();
        assert_eq!(scenario.tenths(), 200);
        scenario.to(from + 1_500_000);
        assert!(scenario.tenths().abs_diff(500) <= 4, "{}", scenario.tenths());
        scenario.to(from + 3 * SECOND - 1);
        assert!(scenario.tenths() < 800);
        scenario.to(from + 3 * SECOND);
        assert_eq!(scenario.tenths(), 800, "{ecu:?}");
        assert_eq!(scenario.telemetry().commanded, Some(percent(80)));
        scenario.command(run(0)).unwrap();
        scenario.to(from + 5 * SECOND - 1);
        assert!(scenario.tenths() > 0);
        scenario.to(from + 5 * SECOND);
        assert_eq!((scenario.tenths(), scenario.wire()), (0, Wire::Run(0)), "{ecu:?}");
    }
    // An rpm in the same share of the maximum: 20 % of 160 000 rpm a second.
    let config = Ecu::Zk.with(|s| {
        s.slew.up = Some(200);
        s.ages.rc = Duration::from_secs(60);
    });
    let mut scenario = Scenario::started_with(Ecu::Zk, config, rpm(ZK_IDLE));
    let from = scenario.now();
    scenario.command(Command::Run(rpm(ZK_IDLE + 64_000))).unwrap();
    scenario.to(from + 2 * SECOND - 1);
    assert_ne!(scenario.order(), Order::Run(rpm(ZK_IDLE + 64_000)));
    scenario.to(from + 2 * SECOND);
    assert_eq!(scenario.order(), Order::Run(rpm(ZK_IDLE + 64_000)));
}

/// A slow slew delays neither a stop, nor standby, nor the fail-safe beyond its own ramp.
#[test]
fn slew_delays_no_stop_and_no_fail_safe() {
    for ecu in BOTH {
        let config = ecu.with(|s| {
            s.slew.up = Some(1000);
            s.slew.down = Some(10);
        });
        for (command, wire) in [(Command::EmergencyStop, Wire::Stop), (Command::Standby, Wire::Standby)] {
            let mut scenario = Scenario::started_with(ecu, config, percent(80));
            scenario.fly(run(80), Origin::Rc, 2 * SECOND);
            match command {
                Command::Standby => scenario.shut_down().unwrap(),
                command => scenario.command(command).unwrap(),
            };
            scenario.pass(2 * EVERY);
            assert_eq!(scenario.sent().last(), Some(&wire), "{ecu:?}");
        }
        let mut scenario = Scenario::started_with(ecu, config, percent(80));
        scenario.fly(run(80), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.tenths(), 800);
        // The last command came 100 ms ago. 50 % a second.
        scenario.pass(AGE - PERIOD + SECOND + 1_600_000);
        assert_eq!(scenario.tenths(), 0, "{ecu:?}");
    }
}

/// Another engine of the group has failed: told, and this one left alone; or reduced, if so configured.
#[test]
fn the_loss_of_another_engine() {
    for ecu in BOTH {
        for (option, expected) in [(None, 800), (Some(600), 480), (Some(0), 0), (Some(1000), 800)] {
            let config = ecu.with(|s| s.when_other_fails = option);
            let mut scenario = Scenario::started_with(ecu, config, percent(80));
            scenario.bench.act(|engine, now| engine.other_failed(now, true));
            assert_eq!(scenario.bench.event_kinds(), [Event::OtherFailed(1)], "{ecu:?} {option:?}");
            scenario.fly(run(80), Origin::Rc, SECOND);
            assert_eq!((scenario.tenths(), scenario.wire()), (expected, Wire::Run(expected)), "{option:?}");
            assert_eq!(scenario.telemetry().commanded, Some(percent(80)));
            scenario.bench.act(|engine, now| engine.other_failed(now, false));
            assert_eq!(scenario.bench.event_kinds(), [Event::OtherFailed(0)]);
            // Back at 50 % a second.
            scenario.fly(run(80), Origin::Rc, SECOND);
            assert_eq!(scenario.tenths(), 800.min(expected + 500), "{option:?}");
            scenario.fly(run(80), Origin::Rc, SECOND);
            assert_eq!(scenario.tenths(), 800);
        }
    }
}

/// An engine counts as failed when it ran and stopped, or fell silent, without a command; until standby is commanded.
#[test]
fn what_counts_as_failed() {
    for ecu in BOTH {
        let mut scenario = Scenario::started(ecu, percent(50));
        assert!(!scenario.bench.machine.failed());
        scenario.says(Says::Cooling);
        assert!(scenario.bench.machine.failed(), "{ecu:?}: it stopped");
        scenario.command(Command::Standby).unwrap();
        assert!(!scenario.bench.machine.failed());

        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.silent().fly(run(50), Origin::Rc, 3 * SECOND);
        assert!(scenario.bench.machine.failed(), "{ecu:?}: it fell silent");
        scenario.says(Says::Running);
        assert!(!scenario.bench.machine.failed(), "{ecu:?}: it is back");

        for command in [Command::Standby, Command::EmergencyStop] {
            let mut scenario = Scenario::started(ecu, percent(50));
            match command {
                Command::Standby => scenario.shut_down().unwrap(),
                command => scenario.command(command).unwrap(),
            };
            scenario.says(Says::Cooling).pass(5 * SECOND);
            assert!(!scenario.bench.machine.failed(), "{ecu:?}: it was commanded");
        }
    }
}

/// A limit whose action is the fail-safe throttle holds it there until standby, whatever the source asks.
#[test]
fn a_limit_can_lower_the_throttle() {
    for ecu in BOTH {
        let config = ecu.with(|s| {
            s.limits.over_temperature =
                Limit { at: Some(Celsius::from_tenths(7000)), action: Action::FailSafe };
            s.loss.throttle = Throttle::from_percent(20).unwrap();
        });
        let mut scenario = Scenario::started_with(ecu, config, percent(80));
        scenario.values.egt = 720;
        scenario.fly(run(80), Origin::Rc, 200_000);
        scenario.values.egt = 500;
        scenario.fly(run(80), Origin::Rc, 3 * SECOND);
        assert_eq!((scenario.tenths(), scenario.wire()), (200, Wire::Run(200)), "{ecu:?}");
        scenario.fly(run(90), Origin::Rc, 10 * SECOND);
        assert_eq!(scenario.tenths(), 200);
        assert!(scenario.telemetry().limited, "{ecu:?}");

        // A reset does not lift it.
        let kept = Some(scenario.bench.machine.record());
        let mut scenario = Scenario::after_reset(ecu, config, kept);
        scenario.introduce();
        scenario.says(Says::Running);
        scenario.fly(run(90), Origin::Rc, 10 * SECOND);
        assert_eq!(scenario.tenths(), 200, "{ecu:?}");
        assert!(scenario.telemetry().limited);

        // Standby does.
        scenario.shut_down().unwrap();
        assert_eq!(scenario.wire(), Wire::Standby);
        assert!(!scenario.telemetry().limited);
        assert!(!scenario.bench.machine.record().limited);
    }
}

/// The reduction for an engine that failed is no slower than a fail-safe, whatever the slew, and does not wait for a
/// take-over.
#[test]
fn a_reduction_does_not_wait() {
    for ecu in BOTH {
        for taking_over in [false, true] {
            let config = ecu.with(|s| {
                s.when_other_fails = Some(100);
                s.slew.down = Some(10);
                s.takeover.within = Duration::from_secs(10);
            });
            let mut scenario = Scenario::started_with(ecu, config, percent(80));
            if taking_over {
                assert_eq!(scenario.command_from(run(90), Origin::Emergency), Ok(Accepted::Held));
            }
            scenario.bench.act(|engine, now| engine.other_failed(now, true));
            assert_eq!(scenario.telemetry().others_failed, 1);
            for _ in 0..20 {
                scenario.command(run(80)).unwrap();
                if taking_over {
                    scenario.command_from(run(90), Origin::Emergency).unwrap();
                }
                scenario.pass(PERIOD);
            }
            // 72 % at 50 % a second.
            assert_eq!(scenario.tenths(), 80, "{ecu:?} {taking_over}");
        }
    }
}

/// A slew holds for a demand of the other kind, too: it rises from what the ECU reports.
#[test]
fn slew_limits_a_demand_of_the_other_kind() {
    let config = Ecu::Zk.with(|s| s.slew.up = Some(100));
    let mut scenario = Scenario::started_with(Ecu::Zk, config, percent(0));
    scenario.values.rpm = Some(50_000);
    scenario.fly(run(0), Origin::Rc, SECOND);
    let asked = Command::Run(rpm(ZK_MAX));
    scenario.command(asked).unwrap();
    assert_eq!(scenario.order(), Order::Run(rpm(50_000)));
    scenario.fly(asked, Origin::Rc, SECOND);
    // 10 % of 160 000 rpm.
    assert_eq!(scenario.order(), Order::Run(rpm(66_000)));
}

/// Who rules is told when it changes, also while the engine stands, and is who the others wait for.
#[test]
fn who_rules_is_told_in_standby() {
    for ecu in BOTH {
        let mut scenario = Scenario::with(ecu, ecu.config());
        scenario.says(Says::Standby);
        scenario.bench.events();
        scenario.fly(Command::Standby, Origin::Bench, SECOND);
        let rc_from = scenario.now();
        scenario.fly(run(50), Origin::Rc, SECOND);
        let answer = scenario.command_from(Command::Standby, Origin::Bench);
        assert_eq!(answer, Ok(Accepted::Behind(Origin::Rc)));
        assert_eq!(scenario.telemetry().active_source, Origin::Rc, "{ecu:?}");
        assert_eq!(rulers(&mut scenario).last(), Some(&(rc_from, Origin::Rc)));
    }
}

/// The end of a loss in standby shows until somebody commands.
#[test]
fn standby_by_loss_shows() {
    for ecu in BOTH {
        let config = ecu.with(|s| s.loss.standby_after = Some(Duration::from_secs(1)));
        let mut scenario = Scenario::started_with(ecu, config, percent(50));
        scenario.pass(10 * SECOND);
        let telemetry = scenario.telemetry();
        assert_eq!((telemetry.ordered.order, telemetry.loss), (Order::Standby, LossStage::Standby));
        scenario.fly(Command::Standby, Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.telemetry().loss, LossStage::None, "{ecu:?}");
    }
}

/// An ECU that does not do what is ordered is told after 3 s: a broken wire towards it. Neither a moment nor another state
/// of a standing engine is.
#[test]
fn an_ecu_that_does_not_obey_is_told() {
    let told = |scenario: &mut Scenario| -> Vec<Event> {
        let events = scenario.bench.event_kinds().into_iter();
        events.filter(|event| matches!(event, Event::NotObeyed | Event::ObeyedAgain)).collect()
    };
    for ecu in BOTH {
        for command in [Command::EmergencyStop, Command::Standby] {
            let mut scenario = Scenario::started(ecu, percent(0));
            match command {
                Command::Standby => scenario.shut_down().unwrap(),
                command => scenario.command(command).unwrap(),
            };
            scenario.pass(3 * SECOND - 2 * EVERY);
            assert_eq!((told(&mut scenario), scenario.telemetry().obeyed), (vec![], true));
            scenario.pass(3 * EVERY);
            assert_eq!((told(&mut scenario), scenario.telemetry().obeyed), (vec![Event::NotObeyed], false));
            scenario.says(Says::Cooling);
            assert_eq!(told(&mut scenario), [Event::ObeyedAgain], "{ecu:?} {command:?}");
        }
        // The control: it takes its time, but not that long.
        let mut scenario = Scenario::started(ecu, percent(50));
        scenario.shut_down().unwrap();
        scenario.pass(2 * SECOND);
        scenario.says(Says::Standby).pass(20 * SECOND);
        assert_eq!(told(&mut scenario), [], "{ecu:?}");
    }
    // The throttle of a running engine, within 10 %.
    for (half_percents, expected) in [(80, vec![]), (78, vec![Event::NotObeyed])] {
        let mut scenario = Scenario::started(Ecu::Amt, percent(50));
        scenario.values.half_percents = half_percents;
        scenario.fly(run(50), Origin::Rc, 5 * SECOND);
        assert_eq!(told(&mut scenario), expected, "{half_percents}");
    }
}
