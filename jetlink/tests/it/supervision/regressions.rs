//! Faults found by random worlds, each as the shortest schedule that shows it.

use crate::runner_watch::Silent;
use crate::support::scenario::{
    BOTH, COMMAND_PERIOD_US, Ecu, Reports, SECOND, Scenario, Values, Wire, percent, run, tenths,
};
use core::pin::pin;
use embassy_time::Duration;
use jetlink::channel::Channel;
use jetlink::command::{Accepted, Command, Interlock, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::engine::retained::{Reset, RetainedMemory, RetainedState};
use jetlink::event::LossStage;
use jetlink::limit::{Action, Limit};
use jetlink::line::Line;
use jetlink::runner::LineErrors;
use jetlink::units::{Celsius, Throttle};
use sim::clock;

/// The demand of a source that is gone is held for 2 s at most, however many others come and go in turn meanwhile.
#[test]
fn alternating_sources_do_not_hold_a_lost_demand() {
    for ecu in BOTH {
        let mut scenario = Scenario::started_with(
            ecu,
            ecu.with(|s| s.timeouts.mavlink = Duration::from_millis(500)),
            percent(80),
        );
        scenario.fly_us(run(80), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.tenths(), 800);
        // RC is silent from here on; its timeout of 0.5 s, then 2 s. First MAVLink waits, then the bench.
        scenario.fly_us(run(10), Origin::Mavlink, 1_500_000);
        assert_eq!(scenario.tenths(), 800);
        scenario.fly_us(run(10), Origin::Bench, 1_200_000);
        assert_eq!(scenario.tenths(), 100, "{ecu:?}");
    }
}

/// A source that was lost and commands again is not in control yet, so its new demand is not the one that is held when
/// the source in control falls silent.
#[test]
fn a_demand_of_a_source_not_yet_in_control_is_not_held() {
    for ecu in BOTH {
        let mut scenario =
            Scenario::started_with(ecu, ecu.with(|s| s.recover_after = Duration::from_secs(3)), percent(30));
        scenario.fly_us(run(30), Origin::Rc, SECOND);
        // RC is lost for longer than a short gap; the bench waits to take over.
        scenario.fly_us(run(10), Origin::Bench, 1_600_000);
        assert_eq!(scenario.tenths(), 300, "{ecu:?}");
        // RC commands again, with another demand, and both fall silent.
        assert_eq!(scenario.command_from(run(90), Origin::Rc), Ok(Accepted::Held));
        for _ in 0..30 {
            scenario.pass_us(COMMAND_PERIOD_US);
            assert!(scenario.tenths() <= 300, "{ecu:?}: {}", scenario.tenths());
        }
    }
}

/// A source that flaps may not start an engine against a steady one below it.
#[test]
fn a_source_not_yet_in_control_starts_no_engine() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.fly_us(Command::Standby, Origin::Bench, 2 * SECOND);
        assert_eq!(scenario.command_from(run(0), Origin::Rc), Ok(Accepted::Held), "{ecu:?}");
        scenario.fly_us(Command::Standby, Origin::Bench, SECOND);
        assert_eq!(scenario.order(), Order::Standby);
        // For comparison: it has commanded standby for a second, and starts the engine.
        scenario.reports(Reports::Standby);
        scenario.fly_us(Command::Standby, Origin::Rc, 1_200_000);
        assert_eq!(scenario.command_from(run(0), Origin::Rc), Ok(Accepted::InForce), "{ecu:?}");
        assert_eq!(scenario.order(), Order::Run(percent(0)), "{ecu:?}");
    }
}

/// At the fail-safe throttle of a limit a source may still command less.
#[test]
fn at_the_fail_safe_of_a_limit_a_lower_demand_counts() {
    for ecu in BOTH {
        let config = ecu.with(|s| {
            s.limits.over_temperature =
                Limit { at: Some(Celsius::from_tenths(7000)), action: Action::FailSafe };
            s.loss.throttle = Throttle::from_percent(20).unwrap();
        });
        let mut scenario = Scenario::started_with(ecu, config, percent(80));
        scenario.fly_us(run(80), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.tenths(), 800);
        scenario.values.egt_celsius = 720;
        scenario.fly_us(run(80), Origin::Rc, 3 * SECOND);
        assert_eq!(scenario.tenths(), 200);
        scenario.command(run(5)).unwrap();
        assert_eq!(scenario.tenths(), 50, "{ecu:?}");
        scenario.fly_us(run(80), Origin::Rc, 3 * SECOND);
        assert_eq!(scenario.tenths(), 50, "it only lowers");
    }
}

/// A command may come before the engine's task has begun: it neither overwrites nor releases retained state.
#[test]
fn a_command_before_the_engine_begins_does_not_release_a_retained_stop() {
    let memory: &'static RetainedMemory = Box::leak(Box::new(RetainedMemory::new()));
    let config = EngineConfig::amt("a", 0, Line::new(2400), None);
    let stored = RetainedState::new(Order::EmergencyStop, Origin::Rc).with(|state| state.armed = true);
    memory.store(&stored, config.fingerprint());
    let channel = Channel::new(&config, Some((memory, Reset::Warm)));
    let owner = channel.owner();
    assert_eq!(owner.source(Origin::Bench).unwrap().command(Command::Disarm), Ok(Accepted::InForce));
    assert_eq!(owner.emergency_source().unwrap().command(Command::ReleaseStop), Err(Rejected::NoLink));
    // It counts as one more reset without a source.
    let retained = RetainedState::new(Order::EmergencyStop, Origin::Rc).with(|state| state.resets = 1);
    assert_eq!(memory.load(config.fingerprint(), Reset::Warm), Some(retained));
}

/// What is commanded after a loss of power, before the engine's task has begun, is in force: only what is left from before the loss
/// has lost what could start an engine.
#[test]
fn an_arm_after_a_loss_of_power_before_the_engine_begins_stays() {
    let config = Ecu::Zk.config();
    for commanded in [true, false] {
        clock::reset();
        let memory: &'static RetainedMemory = Box::leak(Box::new(RetainedMemory::new()));
        if !commanded {
            let armed = RetainedState::new(Order::Standby, Origin::Rc).with(|state| state.armed = true);
            memory.store(&armed, config.fingerprint());
        }
        let channel = Channel::new(&config, Some((memory, Reset::PowerLost)));
        if commanded {
            let rc = channel.owner().source(Origin::Rc).unwrap();
            assert_eq!(rc.command(Command::Arm), Ok(Accepted::InForce));
        }
        let errors = LineErrors::new();
        let mut runner = pin!(channel.runner().run(Silent, Silent, &errors));
        clock::run_for(runner.as_mut(), Duration::from_millis(10));
        assert_eq!(channel.handle().telemetry().armed, commanded);
    }
}

/// A reset retains the demand on the wire, not one that a slew has not reached yet.
#[test]
fn the_retained_demand_is_no_higher_than_the_one_on_the_wire() {
    for ecu in BOTH {
        let config = ecu.with(|s| s.slew.up = Some(100));
        let mut scenario = Scenario::started_with(ecu, config, percent(0));
        scenario.fly_us(run(80), Origin::Rc, SECOND);
        let (retained, now) = (scenario.bench.machine.record(), scenario.tenths());
        assert!(now < 150, "{ecu:?}: {now}");
        // 10 % a second, and a frame every 50 ms (ZK) or set (AMT).
        let sent = (now - 10..=now).map(|value| Order::Run(tenths(value)));
        assert!(
            sent.clone().any(|order| order == retained.order),
            "{ecu:?}: {:?}, {now} in force",
            retained.order
        );
    }
}

/// A start interrupted by a reset has ended, and its source's throttle was never sent.
#[test]
fn a_start_that_a_reset_cut_short_does_not_resume() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.command(run(0)).unwrap();
        // Below half of idle.
        scenario.values.rpm = Some(2000);
        scenario.reports(Reports::Starting);
        scenario.fly_us(run(72), Origin::Rc, SECOND);
        assert_eq!(scenario.bench.machine.record().order, Order::Run(percent(0)), "{ecu:?}");
        let mut after = scenario.reset(ecu.config());
        assert_eq!(after.order(), Order::Listen, "{ecu:?}");
        after.fly_us(run(72), Origin::Rc, SECOND);
        assert!(!after.sent().into_iter().any(|sent| matches!(sent, Wire::Run(_))), "{ecu:?}");
        // For comparison: an engine that has reached running resumes.
        scenario.values.rpm = None;
        scenario.reports(Reports::Running);
        let mut after = scenario.reset(ecu.config());
        after.pass_us(SECOND);
        assert!(after.sent().into_iter().any(|sent| matches!(sent, Wire::Run(_))), "{ecu:?}");
    }
}

/// A demand that was not yet in force when its source fell silent never comes into force: neither when the engine
/// begins to run, nor by a slew.
#[test]
fn a_lost_demand_never_rises() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.command(run(0)).unwrap();
        scenario.reports(Reports::Starting);
        scenario.fly_us(run(56), Origin::Rc, SECOND);
        scenario.pass_us(SECOND);
        assert_eq!(scenario.telemetry().loss, LossStage::Hold);
        scenario.reports(Reports::Running);
        assert_eq!(scenario.tenths(), 0, "{ecu:?}");

        let config = ecu.with(|s| s.slew.up = Some(100));
        let mut scenario = Scenario::started_with(ecu, config, percent(0));
        scenario.fly_us(run(80), Origin::Rc, SECOND);
        scenario.pass_us(500_000);
        let lost_at = scenario.tenths();
        assert!((100..200).contains(&lost_at), "{ecu:?}: {lost_at}");
        scenario.pass_us(900_000);
        assert_eq!(scenario.tenths(), lost_at, "{ecu:?}");
    }
}

/// A command after a reset, before the engine is confirmed, is newer than the retained demand.
#[test]
fn a_command_in_doubt_after_a_reset_overrides_the_retained_demand() {
    for ecu in BOTH {
        let retained = || {
            let retained =
                RetainedState::new(Order::Run(percent(33)), Origin::Mavlink).with(|state| state.armed = true);
            let mut scenario = Scenario::after_reset(ecu, ecu.config(), Some(retained));
            scenario.introduce();
            assert_eq!(scenario.order(), Order::Doubt(percent(33)), "{ecu:?}: nothing is confirmed yet");
            scenario
        };
        for (commanded, count, then) in
            [(run(8), 1, Order::Run(percent(8))), (Command::Standby, 2, Order::Standby)]
        {
            let mut scenario = retained();
            for _ in 0..count {
                scenario.command_from(commanded, Origin::Mavlink).unwrap();
            }
            scenario.reports(Reports::Running);
            assert_eq!(scenario.order(), then, "{ecu:?}");
        }
        // For comparison: without a command the retained demand resumes.
        let mut scenario = retained();
        scenario.reports(Reports::Running);
        assert_eq!(scenario.order(), Order::Run(percent(33)), "{ecu:?}");
    }
}

/// The exhaust counts as cool after two values in a row: an AMT frame has no checksum.
#[test]
fn one_odd_frame_does_not_make_a_hot_exhaust_cool() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.values.egt_celsius = 300;
        scenario.fly_us(Command::Standby, Origin::Rc, SECOND);
        let odd = Values { egt_celsius: 26, ..scenario.values };
        scenario.odd(Reports::Standby, odd);
        let answer = scenario.command(run(0));
        assert!(matches!(answer, Err(Rejected::Start(Interlock::TooHot(_)))), "{ecu:?}: {answer:?}");
        // The control: two of them do.
        scenario.values.egt_celsius = 26;
        scenario.fly_us(Command::Standby, Origin::Rc, SECOND);
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{ecu:?}");
    }
}

/// A start whose source died ends 10 s after the fail-safe stage, also when a gap raises doubt just before: the doubt cannot
/// concern a running engine.
#[test]
fn a_gap_does_not_prolong_a_start_whose_source_is_silent() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.command(run(0)).unwrap();
        let last = scenario.now_us();
        scenario.reports(Reports::Starting);
        // Timeout, hold and run-out: 0.5 s, 1 s and 10 s.
        scenario.run_to_us(last + 11 * SECOND);
        scenario.silent().run_to_us(last + 11_450_000);
        assert_eq!(scenario.order(), Order::Doubt(percent(0)), "{ecu:?}");
        scenario.run_to_us(last + 11_550_000);
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}");
    }
}
