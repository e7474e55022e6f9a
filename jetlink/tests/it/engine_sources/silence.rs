//! A source after a silence: what its first commands mean, and what is retained of it.

use super::*;
use jetlink::ecu::EcuConfig;
use jetlink::engine::Engine;

/// The first of two commands of standby does not bring back the run of a source that was silent. The control: a run does, after a short gap.
#[test]
fn one_standby_of_a_silent_source_does_not_bring_its_run_back() {
    for ecu in BOTH {
        for (command, answer, runs) in
            [(Command::Standby, Accepted::RepeatStandby, false), (run(50), Accepted::InForce, true)]
        {
            let config = ecu.with(|s| s.return_within = micros(3 * SECOND));
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            scenario.fly_us(run(50), Origin::Rc, 2 * SECOND).pass_us(2 * SECOND);
            let before = scenario.tenths();
            assert!((1..500).contains(&before), "{ecu:?} {before}");
            assert_eq!(scenario.command(command), Ok(answer), "{ecu:?}");
            assert_eq!(scenario.telemetry().loss == LossStage::None, runs, "{ecu:?} {command:?}");
            scenario.pass_us(SOURCE_TIMEOUT_US - 1);
            assert_eq!(scenario.tenths() > before, runs, "{ecu:?} {command:?}: {}", scenario.tenths());
        }
    }
}

/// A source that was lost before a reset has to be steady first, also if it commands before the engine begins. The control: one that
/// was not lost.
#[test]
fn a_lost_source_that_commands_before_the_engine_begins_has_to_be_steady_first() {
    for ecu in BOTH {
        for (silent, lost) in [(10 * SECOND, true), (0, false)] {
            let config = ecu.config();
            // Close to idle, so that it does not wait to take over.
            let mut before = Scenario::started(ecu, percent(3));
            before.reports = Some(Reports::Running);
            before.pass_us(silent);
            let mut machine = Engine::new(&config);
            machine.restore(Some(before.bench.machine.record()));
            assert_eq!(machine.command(at_us(0), run(3), Origin::Rc, true), Err(Rejected::Listening));
            let mut scenario = Scenario::nothing_received(ecu, config);
            machine.start(at_us(0));
            *scenario.bench.machine = machine;
            scenario.bench.drain();
            scenario.introduce();
            scenario.reports = Some(Reports::Running);
            scenario.fly_us(run(3), Origin::Rc, SECOND - 1);
            assert_eq!(scenario.telemetry().loss != LossStage::None, lost, "{ecu:?}");
            scenario.fly_us(run(3), Origin::Rc, SECOND / 2);
            assert_eq!(scenario.telemetry().loss, LossStage::None, "{ecu:?}");
        }
    }
}

/// A stream that began before a reset continues with a command within the timeout of its source, and begins again with a later one.
#[test]
fn a_stream_of_a_lost_source_continues_over_a_reset_only_within_its_timeout() {
    for ecu in BOTH {
        for (first, continues) in [(300_000, true), (700_000, false)] {
            let config = ecu.config();
            let mut scenario = Scenario::started(ecu, percent(3));
            scenario.reports = Some(Reports::Running);
            scenario.pass_us(10 * SECOND).fly_us(run(3), Origin::Rc, 600_000);
            assert_eq!(scenario.telemetry().loss, LossStage::FailSafe, "{ecu:?}");
            let mut scenario = scenario.reset(config);
            scenario.pass_us(first).fly_us(run(3), Origin::Rc, 700_000);
            assert_eq!(scenario.telemetry().loss == LossStage::None, continues, "{ecu:?} {first}");
            scenario.fly_us(run(3), Origin::Rc, SECOND / 2);
            assert_eq!(scenario.telemetry().loss, LossStage::None, "{ecu:?} {first}");
        }
    }
}

/// A source that was lost, comes back and falls silent again has to begin again: after its timeout nothing is retained of its stream, also
/// if a reset comes before.
#[test]
fn the_stream_of_a_lost_source_is_retained_until_its_timeout() {
    for ecu in BOTH {
        for reset in [false, true] {
            let config = ecu.config();
            let mut scenario = Scenario::started(ecu, percent(50));
            scenario.reports = Some(Reports::Running);
            scenario.pass_us(10 * SECOND).fly_us(run(50), Origin::Rc, 600_000);
            if reset {
                scenario = scenario.reset(config);
            }
            for (passes, steady) in [(200_000, 600), (600_000, 0)] {
                scenario.pass_us(passes);
                let record = scenario.bench.machine.record();
                assert_eq!(record.steady.as_millis(), steady, "{ecu:?}, reset: {reset}");
            }
        }
    }
}

/// A source that was never received, and then is present without a command, was silent all along: the last stage of loss comes when it would without it.
/// The control: one that commands a run.
#[test]
fn a_source_that_is_present_for_the_first_time_does_not_delay_the_last_stage_of_loss() {
    const LOST_FOR_US: u64 = SOURCE_TIMEOUT_US + SECOND + 10 * SECOND;
    for ecu in BOTH {
        for (command, ends) in [(Command::Present, true), (run(50), false)] {
            let mut config = ecu.config();
            if let EcuConfig::Amt(amt) = &mut config.ecu {
                // Longer than the stages of loss: otherwise its order is given up.
                amt.serial_delay = Duration::from_secs(60);
            }
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            let end = scenario.now_us() + LOST_FOR_US;
            scenario.silent().run_to_us(end - 100_000);
            let _ = scenario.command_from(command, Origin::Mavlink);
            scenario.run_to_us(end - 1);
            assert!(matches!(scenario.order(), Order::Doubt(_)), "{ecu:?}: {}", scenario.order());
            scenario.run_to_us(end);
            assert_eq!(scenario.order() == Order::Standby, ends, "{ecu:?}: {}", scenario.order());
        }
    }
}
