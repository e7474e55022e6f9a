//! Hand-over to the PWM input.

use super::*;
use jetlink::limit::LimitKind;

/// "A hand-over ... counts as a start", "ends when its source is lost or no longer in control": the permission of a source
/// that has been lost for 10 min.
#[test]
fn a_source_that_was_lost_has_no_permission_to_hand_over() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.fly_us(Command::Standby, Origin::Rc, 2 * SECOND);
    scenario.pass_us(600 * SECOND);
    let run_answer = scenario.would_answer(run(0));
    assert_ne!(run_answer, Ok(Accepted::InForce), "a run is not obeyed");
    assert_ne!(scenario.command(Command::HandOverToPwm), Ok(Accepted::InForce), "run: {run_answer:?}");
}

/// "After a reset with a whole record it becomes ID 0, which leaves PWM in charge, until two reports say at rest".
#[test]
fn a_hand_over_becomes_id_0_after_a_reset() {
    let config = Ecu::Zk.config();
    let mut scenario = Scenario::ready(Ecu::Zk, config);
    scenario.fly_us(Command::Standby, Origin::Rc, 2 * SECOND);
    scenario.command(Command::HandOverToPwm).unwrap();
    for reports in [Reports::Starting, Reports::Running] {
        scenario.reports(reports);
    }
    scenario.pass_us(2 * SECOND);
    let mut scenario = scenario.reset(config);
    scenario.bench.frames();
    scenario.pass_us(5 * SECOND);
    let sent = scenario.sent();
    assert!(!sent.contains(&Wire::Pwm), "{} frames of SW 0", sent.len());
}

/// In doubt nothing is sent that could start an engine: SW 0 would give an ECU that restarted to a PWM input that commands run.
#[test]
fn zk_8_in_a_gap_nothing_hands_over() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.fly_us(Command::Standby, Origin::Rc, 2 * SECOND);
    scenario.command(Command::HandOverToPwm).unwrap();
    for reports in [Reports::Starting, Reports::Running] {
        scenario.reports(reports);
    }
    scenario.pass_us(2 * SECOND);
    assert!(scenario.sent().contains(&Wire::Pwm));
    scenario.reports = None;
    scenario.pass_us(SECOND / 2);
    scenario.bench.frames();
    scenario.pass_us(2 * SECOND);
    assert_eq!(scenario.sent(), [], "anything but ID 0");
    // It continues if the engine does.
    scenario.reports(Reports::Running).pass_us(2 * SECOND);
    assert!(scenario.sent().contains(&Wire::Pwm));
}

/// A brown-out under PWM: the engine was not commanded over the wire, so jetlink must not take it and bring it to idle.
#[test]
fn after_a_brown_out_no_run_overrules_the_pilots_pwm() {
    let config = Ecu::Zk.config();
    let mut scenario = Scenario::ready(Ecu::Zk, config);
    scenario.fly_us(Command::Standby, Origin::Rc, 2 * SECOND);
    scenario.command(Command::HandOverToPwm).unwrap();
    for reports in [Reports::Starting, Reports::Running] {
        scenario.reports(reports);
    }
    let retained = scenario.bench.machine.record().without_start();
    let mut scenario = Scenario::after_reset(Ecu::Zk, config, Some(retained));
    scenario.reports = Some(Reports::Running);
    scenario.introduce();
    scenario.bench.receive(&zk_frames::status(3, TURNING, [70, 0, 0]));
    scenario.bench.frames();
    scenario.pass_us(6 * SECOND);
    assert_eq!(runs_in(&scenario.sent()), [] as [u16; 0], "the pilot's PWM is overruled");
}

/// "A lower source's streamed standby ends a run that another began only when the stages of loss have reached fail-safe and
/// a set time (default 5 s) has passed": an engine that RC handed over to PWM, a minute into its flight.
#[test]
fn a_lower_sources_standby_ends_a_hand_over_only_after_5_s() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.fly_us(Command::Standby, Origin::Rc, 2 * SECOND);
    scenario.command(Command::HandOverToPwm).unwrap();
    for reports in [Reports::Starting, Reports::Running] {
        scenario.reports = Some(reports);
        scenario.fly_us(Command::Present, Origin::Rc, 10 * SECOND);
    }
    scenario.fly_us(Command::Present, Origin::Rc, 60 * SECOND);
    assert_eq!(scenario.order(), Order::Pwm);
    let commands = [(Command::Present, Origin::Rc), (Command::Standby, Origin::Mavlink)];
    let from = scenario.now_us();
    while scenario.order() != Order::Standby && scenario.now_us() < from + 10 * SECOND {
        both(&mut scenario, &commands, COMMAND_PERIOD_US);
    }
    let after = scenario.now_us() - from;
    assert!(after > 5 * SECOND, "shut down {} ms after MAVLink began to stream standby", after / 1000);
}

/// A hand-over counts as a start: until its engine runs, the others of its group wait.
#[test]
fn a_hand_over_keeps_other_engines_from_a_start_until_its_own_runs() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    let blocks = |scenario: &Scenario| scenario.bench.machine.blocks_other_starts(at_us(scenario.now_us()));
    scenario.fly_us(Command::Standby, Origin::Rc, 2 * SECOND);
    assert!(!blocks(&scenario));
    scenario.command(Command::HandOverToPwm).unwrap();
    for (reports, expected) in [(Reports::Starting, true), (Reports::Running, false)] {
        scenario.reports(reports);
        for _ in 0..100 {
            let _ = scenario.command(Command::HandOverToPwm);
            scenario.pass_us(SECOND / 10);
        }
        assert_eq!(blocks(&scenario), expected, "{reports:?}");
    }
}

/// A hand-over counts as a start, and has its time: at its end standby is sent, to the tick, between two send slots. One whose engine
/// runs in time continues.
#[test]
fn a_hand_over_whose_engine_does_not_run_in_time_ends_to_the_tick() {
    use Reports::{Running, Standby, Starting};
    for (reports, ends) in [(&[Standby][..], true), (&[Starting], true), (&[Starting, Running], false)] {
        let config = Ecu::Zk.with(|s| s.start.timeout = micros(20 * SECOND));
        let mut scenario = Scenario::ready(Ecu::Zk, config);
        scenario.fly_us(Command::Standby, Origin::Rc, 2 * SECOND);
        scenario.pass_us(FRAME_PERIOD_US / 4);
        let start = scenario.now_us();
        assert_eq!(scenario.command(Command::HandOverToPwm), Ok(Accepted::InForce));
        for reports in reports {
            scenario.reports(*reports);
        }
        scenario.run_to_us(start + 20 * SECOND - 1);
        scenario.bench.events();
        assert_eq!(scenario.order(), Order::Pwm, "{reports:?}");
        scenario.pass_us(1);
        assert_eq!(scenario.order() == Order::Standby, ends, "{reports:?}");
        assert_eq!(scenario.limits(), [LimitKind::StartTimeout][usize::from(!ends)..], "{reports:?}");
    }
}
