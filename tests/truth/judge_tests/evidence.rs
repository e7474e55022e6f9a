//! Histories by hand for the judge's rules: what confirms an engine of which not every report shows that it runs.

use super::*;

/// An AMT ECU that reports a fault from 38 s until `clears`, in flight until 60 s, s.
fn faulty(clears: f64) -> Story {
    flight(AMT, 60.0).with(move |h| {
        h.rules.frame = 20_800;
        let faulty = 38 * SECOND..micros(clears);
        h.samples.iter_mut().for_each(|sample| sample.fault = faulty.contains(&sample.at));
    })
}

#[test]
fn one_error_set_does_not_show_combustion() {
    // Sets end every 125 ms from 41.05 s on, and the node can receive again from 41 s on.
    let story = |first_reply: f64, change: &dyn Fn(&mut History)| {
        let story = faulty(60.0).with(|h| {
            h.frames.retain(|frame| !(40 * SECOND..42 * SECOND).contains(&frame.at));
            h.sets = (0..160).map(|n| 30_050 * MS + n * 125 * MS).collect();
        });
        story.wire(first_reply, 42.0, HALF).with(|h| change(h)).finds(Rule::Doubt)
    };
    let cut = |h: &mut History| h.mute = Spans::from(&[(40 * SECOND, 41 * SECOND)]);
    let reset = |h: &mut History| {
        h.resets.push(Reset { down: 40_500 * MS, up: 41 * SECOND, cause: Cause::Watchdog });
    };
    for missed in [&cut as &dyn Fn(&mut History), &reset] {
        assert!(story(41.06, missed) && !story(41.185, missed));
        // One that does not show the temperature is none of this rule's business.
        let unreadable = |h: &mut History| {
            missed(h);
            h.sensor = Spans::from(&[(38 * SECOND, 41 * SECOND)]);
        };
        assert!(!story(41.06, &unreadable));
    }
    // A set that was received in part is none (133); one whose first byte has just begun counts (171, 899000933).
    let from = |at: u64| move |h: &mut History| h.mute = Spans::from(&[(40 * SECOND, at * MS)]);
    assert!(story(41.185, &from(41_040)) && !story(41.31, &from(41_040)));
    for at in [41_024, 41_026, 41_029] {
        assert!(story(41.06, &from(at)) && !story(41.185, &from(at)), "{at}");
    }
}

#[test]
fn damaged_frames_behind_a_gap_confirm_nothing() {
    let story = |again: f64| {
        flight(AMT, 60.0).with(move |h| {
            h.mute = Spans::from(&[(40 * SECOND, 41 * SECOND)]);
            damage(h, 41 * SECOND, 42 * SECOND);
            h.frames.retain(|frame| !(40 * SECOND..micros(again)).contains(&frame.at));
        })
    };
    assert!(story(41.2).finds(Rule::Doubt) && !story(42.1).finds(Rule::Doubt));
}

#[test]
fn a_shaft_at_rest_confirms_nothing_in_a_gap() {
    let story = |slow: bool| {
        flight(AMT, 60.0).with(move |h| {
            h.mute = Spans::from(&[(40 * SECOND, 42 * SECOND)]);
            h.frames.retain(|frame| !(40 * SECOND..41_500 * MS).contains(&frame.at));
            h.forged = vec![41_300 * MS, 41_400 * MS];
            h.slow = if slow { h.forged.clone() } else { Vec::new() };
        })
    };
    // A set that no ECU sent may have said that it runs.
    assert!(story(true).finds(Rule::Doubt) && !story(false).finds(Rule::Doubt));
    // Nor right after it, before the first set of the ECU.
    let behind = |reply: u64, cause: Option<Cause>| {
        let story = flight(AMT, 60.0).with(move |h| {
            h.rules.frame = 20_800;
            match cause {
                None => h.mute = Spans::from(&[(40 * SECOND, 41 * SECOND)]),
                Some(cause) => h.resets = vec![Reset { down: 40 * SECOND, up: 41 * SECOND, cause }],
            }
            h.frames.retain(|frame| !(40 * SECOND..reply * MS).contains(&frame.at));
            h.sets = (0..160).map(|n| 30_090 * MS + n * 125 * MS).chain([41_025 * MS]).collect();
            h.sets.sort_unstable();
            (h.forged, h.slow) = (vec![41 * SECOND], vec![41 * SECOND]);
        });
        story.finds(Rule::Doubt)
    };
    assert!(behind(41_000, None) && !behind(41_100, None));
    // Without a memory two have to agree.
    assert!(behind(41_100, Some(Cause::PowerOn)) && !behind(41_250, Some(Cause::PowerOn)));
    assert!(!behind(41_100, Some(Cause::Watchdog)));
}

#[test]
fn a_state_other_than_running_gets_no_run_when_faults_clear() {
    let story = |hidden: f64, again: f64| {
        faulty(40.0).with(move |h| {
            let other = 40 * SECOND..micros(hidden);
            h.samples.iter_mut().for_each(|sample| sample.hidden = other.contains(&sample.at));
            h.frames.retain(|frame| !(40 * SECOND..micros(again)).contains(&frame.at));
        })
    };
    assert!(story(41.0, 40.2).finds(Rule::Doubt) && !story(41.0, 41.0).finds(Rule::Doubt));
    assert!(!story(40.0, 40.0).finds(Rule::Doubt));
    // Nor do error sets that follow: the exhaust burns (1000194).
    let again = story(42.0, 41.0).with(|h| {
        let faulty = 40_900 * MS..42 * SECOND;
        h.samples.iter_mut().for_each(|sample| sample.fault |= faulty.contains(&sample.at));
    });
    assert!(!again.finds(Rule::Doubt) && story(42.0, 41.0).finds(Rule::Doubt));
    // With a single fault the engine was in no doubt.
    let moment = story(41.0, 40.2).with(|h| {
        h.samples.iter_mut().for_each(|sample| sample.fault &= sample.at >= 39_800 * MS);
    });
    assert!(!moment.finds(Rule::Doubt));
}

#[test]
fn a_demand_does_not_rise_while_the_exhaust_cools() {
    let story = |degrees_per_s: f64, rises: bool| {
        faulty(60.0).with(move |h| {
            for sample in h.samples.iter_mut().filter(|sample| sample.at >= 42 * SECOND) {
                sample.egt = 500.0 - degrees_per_s * (sample.at - 42 * SECOND) as f64 / SECOND as f64;
            }
            for frame in h.frames.iter_mut().filter(|frame| rises && frame.at >= 46 * SECOND) {
                frame.sent = Sent::Full(Switch::Run, 600);
            }
        })
    };
    let rises = |story: Story| story.says("an exhaust that cools");
    assert!(rises(story(12.0, true)) && !rises(story(12.0, false)) && !rises(story(0.0, true)));
    // A lower demand explains it for 5 s.
    let lowered = |at: u64| {
        story(12.0, true).with(move |h| {
            let high = h.frames.iter_mut().filter(|frame| frame.at > 31 * SECOND && frame.at < at * SECOND);
            high.for_each(|frame| frame.sent = Sent::Full(Switch::Run, 700));
        })
    };
    assert!(!rises(lowered(43)) && rises(lowered(36)));
}

#[test]
fn lower_demands_excuse_a_cold_exhaust_for_15_s() {
    // It is out and cold at 40 s, and the demand is lowered every 4 s.
    let story = |until: f64| {
        let story = flight(AMT, 40.0)
            .turbine(40.0, 80.0, Phase::Cooling, 5000.0, 100.0)
            .streams(PILOT, 40.0, 80.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(until, 80.0, STANDBY)
            .with(|h| h.samples.iter_mut().filter(|s| s.at >= 40 * SECOND).for_each(|s| s.fault = true));
        let steps = (0..10).map(|n| (40.0 + 4.0 * f64::from(n), 500 - 40 * n as u32));
        let steps = steps.take_while(|(at, _)| *at < until);
        steps
            .fold(story, |story, (at, tenths)| {
                story.wire(at, (at + 4.0).min(until), Sent::Full(Switch::Run, tenths))
            })
            .finds(Rule::RunAtRest)
    };
    assert!(!story(58.0) && story(72.0));
}

#[test]
fn the_third_reset_without_a_source_brings_the_fail_safe() {
    let story = |last: Sent, apart: u64| {
        flight(ZK5, 40.0).turbine(40.0, 45.0, Phase::Running, 100_000.0, 500.0).wire(41.3, 45.0, last).with(
            move |h| {
                let at = |n: u64| 40 * SECOND + n * apart * MS;
                let reset = |n| Reset { down: at(n), up: at(n) + 20 * MS, cause: Cause::Watchdog };
                h.resets = (0..4).map(reset).collect();
                h.frames.retain(|frame| frame.at < 40 * SECOND || frame.at > 41_300 * MS);
            },
        )
    };
    let high = |story: Story| story.says("fourth reset");
    assert!(high(story(HALF, 300)) && !high(story(IDLE, 300)));
    // A source was received in between.
    assert!(!high(story(HALF, 300).once(PILOT, 40.5, PilotCommand::Run(Demanded::Throttle(500)))));
}

#[test]
fn an_ecu_that_starts_by_itself_after_its_faults_gets_no_run() {
    // The flame goes out at 40 s, faults until 41 s, and the ECU lights it again at 42 s while the shaft turns.
    let story = |faults: u64, run: bool| {
        let again = if run { HALF } else { STANDBY };
        flight(AMT, 40.0)
            .streams(PILOT, 40.0, 44.9, PilotCommand::Run(Demanded::Throttle(500)))
            .turbine(40.0, 42.0, Phase::Stopped, 40_000.0, 400.0)
            .turbine(42.0, 45.0, Phase::FuelRamp, 40_000.0, 400.0)
            .mark(42.0, Mark::Ignition)
            .wire(40.0, 40.3, HALF)
            .wire(43.0, 43.2, again)
            .with(move |h| {
                let faulty = 40 * SECOND..40 * SECOND + faults * MS;
                h.samples.iter_mut().for_each(|sample| sample.fault = faulty.contains(&sample.at));
            })
            .says("starts its engine by itself")
    };
    assert!(story(1000, true) && !story(1000, false));
    // One set is no fault yet.
    assert!(!story(100, true));
}
