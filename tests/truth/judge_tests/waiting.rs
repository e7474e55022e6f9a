//! Histories by hand for the judge's rules: starts that wait for another engine's.

use super::*;
use std::cell::Cell;

#[test]
fn a_start_that_waited_is_checked_again_when_it_goes() {
    let story = || {
        ready(ZK5)
            .streams(PILOT, 4.0, 14.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(4.0, 10.0, STANDBY)
            .wire(10.0, 14.0, IDLE)
            .mark(11.0, Mark::Ignition)
            .turbine(5.0, 11.0, Phase::Standby, 0.0, 15.0)
            .turbine(11.0, 14.0, Phase::Ignition, 5000.0, 20.0)
            .with(|h| h.rules.start_wait = 60 * SECOND)
    };
    story().passes();
    let hot = |h: &mut History| {
        for sample in h.samples.iter_mut().filter(|sample| sample.at > 7 * SECOND) {
            sample.egt = 180.0;
        }
    };
    story().with(hot).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    let stick_up = |from: u64| {
        move |h: &mut History| {
            for commanded in h.commanded.iter_mut().filter(|commanded| commanded.at > from) {
                commanded.command = PilotCommand::Run(Demanded::Throttle(300));
            }
        }
    };
    story().with(stick_up(7 * SECOND)).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    // It begins between two frames, before the stick is up.
    story().with(stick_up(micros(9.97))).passes();
    // A disarm at the instant of its first frame cancels it with the next.
    let disarmed_as_it_goes = |h: &mut History| {
        h.frames.retain(|frame| frame.at < micros(10.02) || frame.at > micros(10.15));
        h.frames.iter_mut().filter(|frame| frame.at > micros(10.02)).for_each(|frame| frame.sent = STANDBY);
        h.marks = vec![(micros(10.01), Mark::Ignition)];
    };
    story().once(PILOT, 10.0, PilotCommand::Disarm).with(disarmed_as_it_goes).breaks(&[]);
    story()
        .once(PILOT, 7.0, PilotCommand::Disarm)
        .once(PILOT, 7.5, PilotCommand::Arm)
        .breaks(&[Rule::Ignition, Rule::RunAtRest]);
}

#[test]
fn a_wait_ends_behind_a_higher_source_after_its_time_and_without_a_state() {
    // It waits from 4 s until `goes`.
    let story = |goes: f64| {
        ready(ZK5)
            .streams(PILOT, 4.0, goes + 4.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(4.0, goes, STANDBY)
            .wire(goes, goes + 4.0, IDLE)
            .mark(goes + 1.0, Mark::Ignition)
            .turbine(5.0, goes + 1.0, Phase::Standby, 0.0, 15.0)
            .turbine(goes + 1.0, goes + 4.0, Phase::Ignition, 5000.0, 20.0)
            .with(|h| h.rules.start_wait = 300 * SECOND)
    };
    let lights = |story: Story| story.finds(Rule::Ignition);
    // Long enough to be in control, or a moment.
    let behind = |until: f64| story(14.0).streams(0, 5.0, until, PilotCommand::Run(Demanded::Throttle(0)));
    assert!(lights(behind(9.0)) && !lights(behind(6.0)));
    assert!(lights(story(185.0)) && !lights(story(183.0)));
    let damaged = |from: f64| story(14.0).with(move |h| damage(h, micros(from), 14_500 * MS));
    assert!(lights(damaged(10.0)) && !lights(damaged(11.5)));
    // A limit of the supply prevents a start, too.
    let low = |limit: bool| {
        story(14.0).with(move |h| {
            h.rules.limit_supply = limit.then_some(false);
            h.low_supply = Spans::from(&[(10 * SECOND, 20 * SECOND)]);
        })
    };
    assert!(lights(low(true)) && !lights(low(false)));
}

#[test]
fn a_start_that_waits_goes_when_it_may() {
    let run = PilotCommand::Run(Demanded::Throttle(0));
    let story = |goes: f64, busy: u64| {
        Story::new(ZK5)
            .once(PILOT, 1.5, PilotCommand::Arm)
            .streams(PILOT, 1.0, 12.0, PilotCommand::Standby)
            .streams(PILOT, 12.0, 30.0, run)
            .wire(1.0, goes, STANDBY)
            .wire(goes, 30.0, IDLE)
            .turbine(0.0, goes, Phase::Standby, 0.0, 15.0)
            .turbine(goes, 30.0, Phase::Ignition, 5000.0, 20.0)
            .mark(goes + 0.01, Mark::Ignition)
            .with(move |h| h.other_busy = Spans::from(&[(10 * SECOND, busy * SECOND)]))
    };
    let granted = |story: Story| !story.finds(Rule::Granted);
    assert!(granted(story(20.5, 20)) && !granted(story(22.0, 20)) && granted(story(22.0, 25)));
    // Nobody starts: at once.
    assert!(!granted(story(20.5, 11)) && granted(story(12.1, 11)));
    // It goes with the next command of its source (712201767).
    let silent_from = |at: f64| {
        story(25.0, 20).with(move |h| {
            h.rules.ages[PILOT] = 5 * SECOND;
            h.commanded.retain(|commanded| commanded.at < micros(at));
        })
    };
    assert!(granted(silent_from(19.8)) && !granted(silent_from(20.5)));
}

/// 850000180: another source's standby ends a start that waits. One whose frames a transmitter that hangs does not send has begun.
#[test]
fn a_start_whose_transmitter_hangs_does_not_wait() {
    let run = PilotCommand::Run(Demanded::Throttle(0));
    let story = |hangs: bool| {
        ready(ZK5)
            .streams(PILOT, 4.0, 8.0, run)
            .streams(2, 3.0, 4.5, run)
            .once(2, 4.6, PilotCommand::Standby)
            .wire(5.1, 8.0, IDLE)
            .mark(5.2, Mark::Ignition)
            .turbine(5.2, 8.0, Phase::Ignition, 5000.0, 20.0)
            .with(|h| {
                let hung = (3950 * MS, 5 * SECOND);
                h.frames.retain(|frame| frame.at < hung.0 || frame.at > hung.1);
                (h.deaf, h.stalls) = (Spans::from(&[hung]), if hangs { vec![hung.1] } else { vec![] });
            })
    };
    story(true).passes();
    story(false).breaks(&[Rule::Ignition, Rule::RunAtRest]);
}

/// 50600090: a start that was ordered and shut down between two AMT sets. The time until another engine's start counts from it.
#[test]
fn a_start_of_which_no_frame_was_sent_delays_other_engines() {
    let run = PilotCommand::Run(Demanded::Throttle(0));
    let delays = |at: f64, change: &dyn Fn(&mut History)| {
        let story = Story::new(AMT).once(PILOT, 1.5, PilotCommand::Arm);
        let story = story.streams(PILOT, 1.0, 12.0, PilotCommand::Standby).streams(PILOT, 12.0, 13.0, run);
        let Story(mut h) = story.wire(1.0, 30.0, STANDBY);
        (h.rules.start_gap, h.end) = (10 * SECOND, 30 * SECOND);
        change(&mut h);
        h.commanded.sort_by_key(|commanded| commanded.at);
        busy(&h).contains(micros(at))
    };
    let ends = |at: f64, command| {
        move |h: &mut History| h.commanded.push(Commanded { at: micros(at), source: 0, command })
    };
    for command in [PilotCommand::ShutDown, PilotCommand::Disarm, PilotCommand::Stop] {
        assert!(delays(21.0, &ends(12.5, command)) && !delays(23.0, &ends(12.5, command)), "{command}");
        // Before its run there was no start, and long after its last one no set came that was not answered.
        assert!(!delays(21.0, &ends(11.95, command)) && !delays(21.0, &ends(14.0, command)), "{command}");
    }
    // The standby of another source ends none that it does not start to command.
    assert!(!delays(21.0, &ends(12.5, PilotCommand::Standby)));
    // A gap ends it that began a moment before.
    let cut = |from: f64| move |h: &mut History| h.mute = Spans::from(&[(micros(from), 20 * SECOND)]);
    assert!(delays(21.0, &cut(11.9)) && !delays(21.0, &cut(10.0)));
    // 830001263: so does damage, which counts as frames for 3 s.
    let damage = |from: f64| move |h: &mut History| h.noise = Spans::from(&[(micros(from), 20 * SECOND)]);
    assert!(delays(21.0, &damage(10.0)) && !delays(21.0, &damage(8.0)));
    // Refused.
    assert!(!delays(21.0, &|_: &mut History| {}));
}

/// 51600130: an AMT ECU lights its engine again on the run that is on the wire.
#[test]
fn an_engine_that_is_lit_again_delays_other_engines() {
    let cut = Cell::new(Spans::default());
    let delays = |at: f64, relit: bool| {
        let story = flight(AMT, 70.0);
        let Story(mut h) = if relit { story.mark(45.0, Mark::Ignition) } else { story };
        for sample in h.samples.iter_mut().filter(|it| relit && (45 * SECOND..55 * SECOND).contains(&it.at)) {
            sample.phase = Phase::FuelRamp;
        }
        h.end = 70 * SECOND;
        h.mute = cut.take();
        h.samples.sort_by_key(|sample| sample.at);
        busy(&h).contains(micros(at))
    };
    assert!(delays(50.0, true) && !delays(50.0, false) && !delays(58.0, true));
    // Its node sees that it runs once the wire to the node is whole (400000156).
    let after_a_cut = [65.5, 69.0].map(|at| {
        cut.set(Spans::from(&[(50 * SECOND, 65 * SECOND)]));
        delays(at, true)
    });
    assert_eq!(after_a_cut, [true, false]);
}

#[test]
fn a_disarm_ends_a_start_also_over_a_reset() {
    let story = |ends: f64, reset: Option<Cause>| {
        ready(AMT)
            .streams(PILOT, 4.0, 12.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(4.0, ends, IDLE)
            .wire(ends, 14.0, STANDBY)
            .mark(5.0, Mark::Ignition)
            .turbine(5.0, ends, Phase::FuelRamp, 20_000.0, 400.0)
            .turbine(ends, 14.0, Phase::Stopped, 10_000.0, 200.0)
            .once(0, 10.0, PilotCommand::Disarm)
            .with(move |h| {
                let reset = reset.map(|cause| Reset { down: 9 * SECOND, up: 9_020 * MS, cause });
                h.resets.extend(reset);
            })
            .says("has ended the start")
    };
    for reset in [None, Some(Cause::Watchdog)] {
        assert!(story(12.0, reset) && !story(10.2, reset), "{reset:?}");
    }
    // A node without memory may take it for an engine that runs.
    assert!(!story(12.0, Some(Cause::PowerOn)));
}

#[test]
fn no_start_begins_while_its_ecu_tests_something() {
    let story = |tested: f64, arrived: bool| {
        ready(ZK5)
            .wire(tested, tested + 0.01, Sent::Action(2))
            .with(move |h| {
                let test = h.frames.iter_mut().filter(|frame| frame.sent == Sent::Action(2));
                test.for_each(|frame| frame.arrived = arrived);
            })
            .streams(PILOT, 4.0, 6.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(4.0, 6.0, IDLE)
            .turbine(5.0, 6.0, Phase::Ignition, 1000.0, 15.0)
            .mark(5.0, Mark::Ignition)
            .finds(Rule::Ignition)
    };
    assert!(story(2.5, true) && !story(2.5, false));
    // Its report is on its way, or it is over.
    assert!(!story(3.8, true) && !story(1.2, true));
}
