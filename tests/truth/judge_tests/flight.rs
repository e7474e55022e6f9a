//! Histories by hand for the judge's rules: a healthy engine in flight.

use super::*;

#[test]
fn an_ordinary_flight_keeps_every_rule() {
    for kind in [AMT, ZK5, Kind::Zk(3)] {
        flight(kind, 60.0)
            .says(PILOT, 60.0, 70.0, Word::Standby)
            .wire(60.1, 70.0, STANDBY)
            .turbine(60.0, 70.0, Phase::Cooling, 5000.0, 300.0)
            .passes();
    }
}

#[test]
fn a_demand_rises_at_a_rate_unless_a_pilot_moves_the_stick() {
    // The stick was up during the start.
    let up = |jumps: bool| {
        let story = started(ZK5)
            .says(PILOT, 15.0, 40.0, Word::Run(Ask::Throttle(800)))
            .turbine(RUNS as f64, 40.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| {
                h.said.retain(|said| said.at < 15 * SECOND || said.word != Word::Run(Ask::Throttle(0)))
            });
        match jumps {
            true => story.wire(31.0, 40.0, Told::Full(Switch::Run, 800)),
            false => story.ramp(31.0, 0, 800).wire(32.8, 40.0, Told::Full(Switch::Run, 800)),
        }
    };
    up(false).passes();
    up(true).breaks(&[Rule::Rate]);
    // A pilot who moves it, with and without a slew.
    let moved = || {
        started(ZK5)
            .says(PILOT, 31.0, 40.0, Word::Run(Ask::Throttle(800)))
            .says(PILOT, 30.5, 31.0, Word::Run(Ask::Throttle(0)))
            .wire(31.0, 40.0, Told::Full(Switch::Run, 800))
            .turbine(RUNS as f64, 40.0, Phase::Running, 100_000.0, 500.0)
    };
    moved().passes();
    moved().with(|h| h.rules.slew_up = Some(500)).breaks(&[Rule::Rate]);
}

#[test]
fn a_running_engine_is_shut_down_by_two_words_or_by_one_of_a_person() {
    let story = |words: &[(f64, Word)]| {
        let mut story = flight(ZK5, 40.0)
            .wire(40.3, 45.0, STANDBY)
            .turbine(40.0, 40.5, Phase::Running, 100_000.0, 500.0)
            .turbine(40.5, 45.0, Phase::Cooling, 5000.0, 300.0)
            .wire(40.0, 40.3, HALF);
        for &(at, word) in words {
            story = story.once(0, at, word);
        }
        story.says(PILOT, 40.0, 45.0, Word::Run(Ask::Throttle(500)))
    };
    story(&[(40.0, Word::Standby), (40.2, Word::Standby)]).passes();
    story(&[(40.2, Word::ShutDown)]).passes();
    // Decided a slot before another word came.
    story(&[(40.05, Word::Standby), (40.25, Word::Standby), (40.29, Word::Run(Ask::Throttle(0)))]).passes();
    story(&[(40.2, Word::Standby)]).breaks(&[Rule::ShutDown]);
    // One word of a higher source that has yet to take over, and is silent again.
    let word = |at, until| {
        let story = flight(ZK5, 40.0).says(0, 20.0, at, Word::Nothing);
        story
            .says(0, at, until, Word::Run(Ask::Throttle(500)))
            .says(PILOT, 40.0, 45.0, Word::Standby)
            .wire(40.0, 40.6, HALF)
            .wire(40.6, 45.0, STANDBY)
            .turbine(40.0, 45.0, Phase::Running, 100_000.0, 500.0)
    };
    word(40.0, 40.01).passes();
    word(37.0, 40.01).breaks(&[Rule::ShutDown]);
    story(&[(37.0, Word::Standby), (40.2, Word::Standby)]).breaks(&[Rule::ShutDown]);
    story(&[]).breaks(&[Rule::ShutDown]);
}

/// A node that is reset again and again, each time before two reports agree, knows of a start only what it knew before: a
/// disarm ends it.
#[test]
fn a_node_in_a_reset_loop_cannot_know_that_a_start_has_reached_running() {
    let story = |resets_from: u64| {
        let resets = (resets_from * 2..80).map(|half| Reset {
            down: half * SECOND / 2,
            up: half * SECOND / 2 + 20 * MS,
            cause: Cause::Watchdog,
        });
        flight(ZK5, 40.0)
            .once(PILOT, 40.0, Word::Disarm)
            .wire(40.0, 45.0, STANDBY)
            .turbine(40.0, 45.0, Phase::Running, 60_000.0, 480.0)
            .says(PILOT, 40.0, 45.0, Word::Run(Ask::Throttle(500)))
            .with(|h| h.resets = resets.collect())
    };
    story(29).breaks_beside(&[Rule::Doubt], &[]);
    // It ran before the loop for long enough.
    story(34).breaks_beside(&[Rule::Doubt], &[Rule::ShutDown]);
}

#[test]
fn a_lower_sources_standby_waits_for_the_stages_of_loss() {
    let story = |standby: f64| {
        flight(ZK5, 40.0)
            .says(2, 20.0, 60.0, Word::Standby)
            .wire(40.0, 41.5, HALF)
            .ramp(41.5, 500, 0)
            .wire(42.6, standby, IDLE)
            .wire(standby, 60.0, STANDBY)
            .turbine(40.0, standby + 0.1, Phase::Running, 60_000.0, 480.0)
            .turbine(standby + 0.1, 60.0, Phase::Cooling, 5000.0, 300.0)
    };
    story(48.0).passes();
    story(43.0).breaks(&[Rule::ShutDown]);
    // One that has spoken again for as long as it takes until just now was not in control when it was decided.
    let back = |from| story(47.9).says(PILOT, from, 59.9, Word::Run(Ask::Throttle(0)));
    back(44.88).passes();
    back(43.0).breaks(&[Rule::ShutDown]);
}

#[test]
fn a_limit_with_standby_is_exempt_and_counted() {
    let story = flight(ZK5, 40.0)
        .says(PILOT, 40.0, 45.0, Word::Run(Ask::Throttle(500)))
        .wire(40.0, 45.0, STANDBY)
        .turbine(40.0, 41.0, Phase::Running, 100_000.0, 900.0)
        .turbine(41.0, 45.0, Phase::Cooling, 5000.0, 300.0)
        .with(|h| h.rules.limit_egt = Some((800.0, true)));
    let verdict = story.judged();
    assert_eq!(verdict.rules(), []);
    let exempt = verdict.exempt["a limit whose action is standby"];
    assert!((900 * MS..=1100 * MS).contains(&exempt), "{exempt}");
    assert!((10 * SECOND..12 * SECOND).contains(&verdict.applied), "{}", verdict.applied);
}

#[test]
fn an_ecu_does_not_put_out_an_engine_for_want_of_commands() {
    let story = |kind| {
        flight(kind, 40.0)
            .says(PILOT, 40.0, 45.0, Word::Run(Ask::Throttle(500)))
            .mark(40.0, Mark::GivenUp)
            .turbine(40.0, 45.0, Phase::Cooling, 50_000.0, 400.0)
            .wire(40.0, 45.0, STANDBY)
    };
    for kind in [AMT, Kind::Zk(3)] {
        story(kind).breaks(&[Rule::GivenUp]);
        // A wire that is cut is exempt.
        let cut = |h: &mut History| {
            h.deaf = Spans::from(&[(37_500 * MS, 41 * SECOND)]);
            h.frames.retain(|frame| !(37_700 * MS..40 * SECOND).contains(&frame.at));
        };
        story(kind).with(cut).passes();
    }
    // A gap of the node that the ECU has to put up with is none.
    let reset = |length: u64| {
        let down = 38 * SECOND;
        move |h: &mut History| h.resets.push(Reset { down, up: down + length * MS, cause: Cause::Watchdog })
    };
    story(AMT).with(reset(800)).breaks(&[Rule::GivenUp]);
    story(AMT).with(reset(950)).breaks(&[Rule::GivenUp]);
    story(AMT).with(reset(1000)).passes();
    story(AMT).with(reset(2100)).passes();
    // After a loss of power, with error sets only, nobody knows whether it runs. Another reset is no excuse, whatever the exhaust.
    let faults = |h: &mut History| {
        for sample in h.samples.iter_mut().filter(|sample| sample.at >= 37 * SECOND) {
            sample.fault = true;
        }
    };
    let early = |cause| {
        move |h: &mut History| {
            let down = 37_200 * MS;
            h.frames.retain(|frame| frame.at < down);
            h.resets.push(Reset { down, up: down + 50 * MS, cause });
        }
    };
    story(AMT).with(faults).with(early(Cause::PowerOn)).passes();
    story(AMT).with(early(Cause::PowerOn)).breaks(&[Rule::GivenUp]);
    story(AMT).with(faults).with(early(Cause::Watchdog)).breaks(&[Rule::GivenUp]);
    story(AMT).with(faults).breaks(&[Rule::GivenUp]);
    story(AMT).with(early(Cause::Watchdog)).breaks(&[Rule::GivenUp]);
}

#[test]
fn a_demand_is_not_held_below_what_is_asked_for() {
    let story = |tenths| {
        flight(ZK5, 40.0)
            .says(PILOT, 40.0, 60.0, Word::Run(Ask::Throttle(500)))
            .wire(40.0, 60.0, Told::Full(Switch::Run, tenths))
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
    };
    story(500).passes();
    story(480).breaks(&[Rule::HeldDown]);
    // A source that comes back after a short gap goes on without a take-over.
    let comes_back = |low: f64| {
        flight(ZK5, 50.0)
            .says(PILOT, 50.9, 65.0, Word::Run(Ask::Throttle(500)))
            .wire(50.0, 50.9, HALF)
            .wire(50.9, 50.9 + low, Told::Full(Switch::Run, 300))
            .ramp(50.9 + low, 300, 500)
            .wire(51.35 + low, 65.0, HALF)
            .turbine(50.0, 65.0, Phase::Running, 80_000.0, 500.0)
    };
    comes_back(0.1).passes();
    comes_back(4.0).breaks(&[Rule::HeldDown]);
    // Nothing of it on the wire.
    flight(ZK5, 40.0)
        .says(PILOT, 40.0, 60.0, Word::Run(Ask::Throttle(500)))
        .wire(40.0, 60.0, Told::Nothing)
        .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
        .breaks(&[Rule::HeldDown]);
    // A transmitter that stands still for less than the ECU waits.
    let stalls = |from: u64, to: u64| {
        let stalls = move |h: &mut History| {
            h.frames.retain(|frame| !(from..to).contains(&frame.at));
            h.deaf = Spans::from(&[(from, to)]);
        };
        story(500).with(stalls)
    };
    stalls(50 * SECOND, 51_900 * MS).passes();
    let silent = |h: &mut History| h.deaf = Spans::default();
    stalls(50 * SECOND, 51_900 * MS).with(silent).breaks(&[Rule::HeldDown]);
}

/// A flame-out passes a limit of how values change. The ECU lights it again in the same life, and the limit holds until standby.
#[test]
fn a_limit_holds_the_demand_of_an_engine_that_was_lit_again() {
    let story = || {
        flight(ZK5, 40.0)
            .says(PILOT, 40.0, 90.0, Word::Run(Ask::Throttle(500)))
            .wire(40.0, 41.0, HALF)
            .ramp(41.0, 500, 0)
            .wire(42.1, 90.0, IDLE)
            .turbine(40.0, 42.0, Phase::Running, 60_000.0, 450.0)
            .with(|h| {
                h.samples.iter_mut().filter(|sample| sample.at >= 40 * SECOND).for_each(|s| s.lit = false)
            })
            .mark(42.0, Mark::Relight)
            .turbine(42.0, 60.0, Phase::FuelRamp, 30_000.0, 450.0)
            .turbine(60.0, 90.0, Phase::Running, 50_000.0, 450.0)
    };
    story().with(|h| h.rules.limit_change = Some(false)).passes();
    story().breaks(&[Rule::HeldDown]);
}

#[test]
fn a_limit_that_is_passed_has_its_action() {
    let story = |tenths, egt, standby| {
        flight(ZK5, 40.0)
            .says(PILOT, 40.0, 60.0, Word::Run(Ask::Throttle(500)))
            .wire(40.0, 41.0, HALF)
            .ramp(41.0, 500, tenths)
            .wire(if tenths == 500 { 41.05 } else { 42.1 }, 60.0, Told::Full(Switch::Run, tenths))
            .turbine(40.0, 60.0, Phase::Running, 100_000.0, egt)
            .with(move |h| h.rules.limit_egt = Some((600.0, standby)))
    };
    story(0, 640.0, false).passes();
    story(500, 560.0, false).passes();
    story(500, 640.0, false).breaks(&[Rule::Limit]);
    story(500, 640.0, true).breaks(&[Rule::Limit]);
    let rpm = |h: &mut History| {
        h.rules.limit_egt = None;
        h.rules.limit_rpm = Some((80_000.0, false));
        for sample in h.samples.iter_mut().filter(|sample| sample.at < 40 * SECOND) {
            sample.rpm = 70_000.0;
        }
    };
    story(500, 500.0, false).with(rpm).breaks(&[Rule::Limit]);
    story(0, 500.0, false).with(rpm).passes();
}

#[test]
fn a_demand_is_reduced_while_another_engine_has_failed() {
    let story = |tenths| {
        flight(ZK5, 40.0)
            .says(PILOT, 40.0, 60.0, Word::Run(Ask::Throttle(500)))
            .ramp(40.0, 500, tenths)
            .wire(41.0, 60.0, Told::Full(Switch::Run, tenths))
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
            .with(|h| {
                h.rules.when_other_fails = Some(500);
                h.other_down = Spans::from(&[(40 * SECOND, 70 * SECOND)]);
                h.other_failed = h.other_down.clone();
            })
    };
    story(250).passes();
    story(500).breaks(&[Rule::Reduction]);
}

#[test]
fn a_source_that_takes_over_is_held_off() {
    let story = |wait: f64| {
        flight(ZK5, 60.0)
            .says(PILOT, 60.0, 70.0, Word::Run(Ask::Throttle(500)))
            .says(0, 60.0, 70.0, Word::Run(Ask::Throttle(200)))
            .wire(60.0, 60.0 + wait, HALF)
            .wire(60.0 + wait, 70.0, Told::Full(Switch::Run, 200))
            .turbine(60.0, 70.0, Phase::Running, 80_000.0, 500.0)
    };
    story(2.0).passes();
    story(0.1).breaks(&[Rule::TakeOver]);
    // The demand of one that is lost meanwhile falls.
    let lost = flight(ZK5, 60.0)
        .says(PILOT, 60.0, 60.3, Word::Run(Ask::Throttle(500)))
        .says(0, 60.0, 70.0, Word::Run(Ask::Throttle(200)))
        .wire(60.0, 60.8, HALF)
        .ramp(60.8, 500, 400)
        .wire(61.0, 62.0, Told::Full(Switch::Run, 400))
        .wire(62.0, 70.0, Told::Full(Switch::Run, 200))
        .turbine(60.0, 70.0, Phase::Running, 80_000.0, 500.0);
    lost.with(|h| h.rules.hold = 0).passes();
}
