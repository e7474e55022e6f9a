//! Histories by hand for the judge's rules: limits and their actions.

use super::*;

#[test]
fn a_limit_with_standby_is_exempt_and_counted() {
    let story = flight(ZK5, 40.0)
        .streams(PILOT, 40.0, 45.0, PilotCommand::Run(Demanded::Throttle(500)))
        .wire(40.0, 45.0, STANDBY)
        .turbine(40.0, 41.0, Phase::Running, 100_000.0, 900.0)
        .turbine(41.0, 45.0, Phase::Cooling, 5000.0, 300.0)
        .with(|h| h.rules.limit_egt = Some((800.0, true)));
    let verdict = story.judged();
    assert_eq!(verdict.rules(), []);
    let exempt = verdict.healthy.exempt["a limit whose action is standby"];
    assert!((900 * MS..=1100 * MS).contains(&exempt), "{exempt}");
    assert!((10 * SECOND..12 * SECOND).contains(&verdict.healthy.applied), "{}", verdict.healthy.applied);
}

/// A flame-out exceeds a limit of how values change. The ECU relights the engine in the same life, and the limit holds until
/// standby.
#[test]
fn a_limit_holds_the_demand_of_an_engine_that_was_lit_again() {
    let lit_again = |runs: f64| {
        let end = runs + 30.0;
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, end, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.0, 41.0, HALF)
            .ramp(41.0, 500, 0)
            .wire(42.1, end, IDLE)
            .turbine(40.0, 42.0, Phase::Running, 60_000.0, 450.0)
            .with(|h| {
                h.samples.iter_mut().filter(|sample| sample.at >= 40 * SECOND).for_each(|s| s.lit = false)
            })
            .mark(42.0, Mark::Relight)
            .turbine(42.0, runs, Phase::FuelRamp, 30_000.0, 450.0)
            .turbine(runs, end, Phase::Running, 50_000.0, 450.0)
    };
    let story = || lit_again(60.0);
    story().with(|h| h.rules.limit_changes = [Some(false); 4]).passes();
    // Idle calibration may be reported as running.
    let learning = |h: &mut History| {
        let out = h.samples.iter_mut().filter(|s| s.at >= 40 * SECOND && s.at < 42 * SECOND);
        out.for_each(|s| s.phase = Phase::LearningIdle);
    };
    story().with(|h| h.rules.limit_changes = [Some(false); 4]).with(learning).passes();
    story().breaks(&[Rule::HeldDown]);
    // Its ECU was without power for too short a time to be seen, and starts the engine again (843000478).
    let held_down = |off: bool| {
        let stops = move |h: &mut History| {
            h.rules.limit_changes = [Some(false); 4];
            let out = h.samples.iter_mut().filter(|s| s.at >= 40 * SECOND && s.at < 42 * SECOND);
            out.for_each(|s| s.phase = Phase::Ignition);
            if off {
                h.unpowered = Spans::from(&[(40_000 * MS - 30 * MS, 40_000 * MS)]);
            }
        };
        story().with(stops).finds(Rule::HeldDown)
    };
    assert_eq!([held_down(true), held_down(false)], [false, true]);
    // The order is the previous one, however long the start lasts.
    let held = |limit| {
        let story = lit_again(120.0).with(move |h| h.rules.limit_rpm = Some((limit, false)));
        story.finds(Rule::HeldDown)
    };
    assert!(!held(90_000.0) && held(110_000.0));
}

#[test]
fn a_limit_that_is_exceeded_has_its_action() {
    let story = |tenths, egt, standby| {
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 60.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.0, 41.0, HALF)
            .ramp(41.0, 500, tenths)
            .wire(if tenths == 500 { 41.05 } else { 42.1 }, 60.0, Sent::Full(Switch::Run, tenths))
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
    // An AMT ECU with a fault reports no speed; one of ZK does.
    let fault = |h: &mut History| {
        h.samples.iter_mut().filter(|sample| sample.at >= 39 * SECOND).for_each(|s| s.fault = true)
    };
    story(500, 500.0, false).with(rpm).with(fault).breaks(&[Rule::Limit]);
    story(500, 500.0, false).with(rpm).with(fault).with(|h| h.rules.kind = AMT).passes();
    story(0, 500.0, false).with(rpm).passes();
}

/// A shaft speed below its limit, a supply below its limit, and an implausible change, each with its required
/// action.
#[test]
fn a_slow_shaft_a_low_supply_and_a_jump_have_the_action_of_their_limit() {
    let story = |tenths| {
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 60.0, PilotCommand::Run(Demanded::Throttle(500)))
            .ramp(41.0, 500, tenths)
            .wire(42.1, 60.0, Sent::Full(Switch::Run, tenths))
            .turbine(40.0, 60.0, Phase::Running, 100_000.0, 500.0)
    };
    let slow = |h: &mut History| {
        h.rules.limit_low_rpm = Some((60_000.0, false));
        h.samples.iter_mut().filter(|sample| sample.at >= 40 * SECOND).for_each(|s| s.rpm = 55_000.0);
    };
    story(500).with(slow).breaks(&[Rule::Limit]);
    story(0).with(slow).passes();
    // Near the limit it is not known on which side the reports are.
    let near = |h: &mut History| h.samples.iter_mut().for_each(|s| s.rpm = s.rpm.max(58_000.0));
    story(500).with(slow).with(near).passes();
    let supply = |h: &mut History| {
        h.rules.limit_supply = Some(false);
        h.low_supply = Spans::from(&[(40 * SECOND, 45 * SECOND)]);
    };
    story(500).with(supply).breaks(&[Rule::Limit]);
    story(0).with(supply).passes();
    // An AMT ECU reports it in every eleventh set: two of them come within 3.05 s.
    let amt = |tenths, length: u64| {
        flight(AMT, 40.0)
            .streams(PILOT, 40.0, 60.0, PilotCommand::Run(Demanded::Throttle(500)))
            .ramp(43.1, 500, tenths)
            .wire(44.2, 60.0, Sent::Full(Switch::Run, tenths))
            .wire(40.0, 43.1, HALF)
            .turbine(40.0, 60.0, Phase::Running, 100_000.0, 500.0)
            .with(supply)
            .with(move |h| h.low_supply = Spans::from(&[(40 * SECOND, 40 * SECOND + length * MS)]))
    };
    amt(500, 3100).breaks(&[Rule::Limit]);
    amt(500, 3000).passes();
    amt(0, 3100).passes();
    let jump = |standby: bool| {
        move |h: &mut History| {
            h.rules.limit_jump = Some(standby);
            h.rules.limit_changes = [Some(standby); 4];
            h.jumps.push(40 * SECOND);
        }
    };
    story(500).with(jump(false)).breaks(&[Rule::Limit]);
    story(500).with(jump(true)).breaks(&[Rule::Limit]);
    story(500).passes();
}

/// Odd values, while another limit of how values change has another action (710000115).
#[test]
fn each_limit_of_how_values_change_has_an_action_of_its_own() {
    let story = |actions: [Option<bool>; 2]| {
        shut_down_uncommanded()
            .with(move |h| {
                h.noise = Spans::from(&[(40 * SECOND - 30 * MS, 40 * SECOND)]);
                // That of a hot start, and of an implausible change.
                h.rules.limit_changes = [actions[0], None, None, actions[1]];
            })
            .finds(Rule::ShutDown)
    };
    let [lowers, stops] = [Some(false), Some(true)];
    assert!(!story([None, stops]) && !story([lowers, stops]));
    assert!(story([None, lowers]) && story([None, None]));
}

/// A limit that is exceeded in a start lowers the demand, but until the ECU reports a running engine the start throttle is on the wire, and no
/// more; afterwards the limit holds it (1000228).
#[test]
fn a_limit_that_is_exceeded_in_a_start_leaves_the_start_throttle() {
    let story = |runs: f64, tenths: u32| {
        let starts = move |h: &mut History| {
            h.rules.start_throttle = 200;
            h.rules.limit_hot = Some(false);
            for sample in h.samples.iter_mut().filter(|sample| sample.at >= 40 * SECOND) {
                sample.lit = sample.at >= 42 * SECOND;
                let in_start = sample.at.saturating_sub(42 * SECOND).min(2 * SECOND);
                sample.egt = 50.0 + 300.0 * in_start as f64 / SECOND as f64;
            }
        };
        flight(AMT, 40.0)
            .streams(PILOT, 40.0, 70.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(40.0, 70.0, Sent::Full(Switch::Run, tenths))
            .turbine(40.0, 42.0, Phase::Running, 30_000.0, 450.0)
            .turbine(42.0, runs, Phase::FuelRamp, 20_000.0, 450.0)
            .turbine(runs, 70.0, Phase::Running, 36_000.0, 450.0)
            .with(starts)
            .finds(Rule::Limit)
    };
    assert!(!story(70.0, 200), "the start throttle in a start");
    assert!(story(70.0, 250), "more than that");
    assert!(story(50.0, 200), "after it");
}
