//! Histories by hand for the judge's rules: AMT engines that go out while their ECU reports a fault.

use super::*;

/// An AMT engine goes out, and its ECU clears its fault while the exhaust is hot, and starts on the run that it was sent. A node
/// has to see the exhaust fall within 4 s, unless it is reset before.
#[test]
fn a_trip_that_clears_while_the_exhaust_is_hot_cannot_be_seen() {
    let story = |clears: f64, resets: bool| {
        let up =
            |half: u64| Reset { down: half * SECOND / 2, up: half * SECOND / 2 + MS, cause: Cause::Watchdog };
        flight(AMT, 40.0)
            .streams(PILOT, 40.0, clears + 1.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.0, clears, HALF)
            .turbine(40.0, clears, Phase::Cooling, 30_000.0, 400.0)
            .turbine(clears, clears + 1.0, Phase::Ignition, 8000.0, 390.0)
            .mark(clears, Mark::Ignition)
            .with(|h| {
                for sample in h.samples.iter_mut().filter(|sample| sample.phase == Phase::Cooling) {
                    sample.fault = true;
                    sample.egt = 700.0 - 25.0 * (sample.at - 40 * SECOND) as f64 / SECOND as f64;
                }
                h.resets = (80..92).filter(|_| resets).map(up).collect();
            })
    };
    story(43.5, false).passes();
    story(46.0, true).passes();
    let ignites = |story: Story| story.finds(Rule::Ignition);
    assert!(ignites(story(46.0, false)));
    // A slow fall may be that of an engine that burns.
    let slow =
        |h: &mut History| h.samples.iter_mut().filter(|s| s.fault).for_each(|s| s.egt = 0.7 * s.egt + 210.0);
    story(46.0, false).with(slow).passes();
    // Two sets have to agree that it is too cold for combustion.
    let cold_from = |at: f64| {
        story(46.0, false).with(move |h| {
            let coldest = h.rules.burning - 10.0;
            let falling = |s: &mut Sample| s.egt = coldest + 5.0 * (at - s.at as f64 / SECOND as f64);
            h.samples.iter_mut().filter(|s| s.fault).for_each(falling);
        })
    };
    cold_from(45.75).passes();
    cold_from(45.6).breaks(&[Rule::Ignition]);
    // A lower demand explains that it is cold, however small its last step is (873001919).
    let lowered_until = |until: f64| {
        cold_from(40.0).with(move |h| {
            let mut tenths = 500;
            for frame in h.frames.iter_mut().filter(|frame| frame.at >= 40 * SECOND) {
                tenths -= if frame.at < micros(until) { 4 } else { 0 };
                frame.sent = Sent::Full(Switch::Run, tenths);
            }
        })
    };
    lowered_until(41.2).passes();
    assert!(ignites(lowered_until(40.3)));
    // Nor can one in a start whose node has lost its memory: its shaft turns as one of a running engine (800000857).
    let in_a_start = |forgets: bool| {
        let cause = if forgets { Cause::PowerOn } else { Cause::Watchdog };
        let phase = |s: &mut Sample| s.phase = Phase::FuelRamp;
        ignites(story(43.5, false).with(move |h| {
            h.samples.iter_mut().filter(|s| s.phase == Phase::Running).for_each(phase);
            h.resets.push(Reset { down: 38_000 * MS, up: 38_050 * MS, cause });
        }))
    };
    assert!(!in_a_start(true) && in_a_start(false));
    // A broken thermocouple hides that it falls (730000080), and that it is cold (710001091).
    let hidden_until =
        |over: f64| story(46.0, false).with(move |h| h.sensor = Spans::from(&[(39 * SECOND, micros(over))]));
    hidden_until(44.0).passes();
    assert!(ignites(hidden_until(40.5)));
    let broken =
        |from: f64| cold_from(45.6).with(move |h| h.sensor = Spans::from(&[(micros(from), 60 * SECOND)]));
    broken(45.5).passes();
    assert!(ignites(broken(45.8)));
    // And after it a cold exhaust does not count, except after a hot one (730000080).
    let failed = |hot: f64| {
        cold_from(40.0).with(move |h| {
            h.sensor = Spans::from(&[(38 * SECOND, 40 * SECOND)]);
            let hot = h.samples.iter_mut().filter(|s| s.fault && s.at < micros(hot));
            hot.for_each(|sample| sample.egt = 500.0);
        })
    };
    failed(40.0).passes();
    assert!(ignites(failed(40.5)));
    // It acts on what it was sent before the fault cleared, also for a moment after that.
    let cleared = |last_run: u64| {
        story(43.5, false).with(move |h| {
            let after = h.samples.iter_mut().filter(|s| (micros(42.6)..micros(43.5)).contains(&s.at));
            after.for_each(|sample| sample.fault = false);
            h.frames.retain(|frame| frame.at < last_run);
        })
    };
    // It reports the fault a moment after the flame went out; run that is sent to an ECU that has reported no fault is
    // not such a case.
    let shows = |after: u64| {
        story(43.5, false).with(move |h| {
            let before =
                h.samples.iter_mut().filter(|s| (0..after).contains(&s.at.saturating_sub(40 * SECOND)));
            before.for_each(|sample| sample.fault = false);
        })
    };
    let runs_on = |h: &mut History| {
        let first = h.samples.iter_mut().filter(|s| (40 * SECOND..41 * SECOND).contains(&s.at));
        first.for_each(|s| (s.phase, s.fault, s.lit) = (Phase::Running, false, false));
    };
    story(43.5, false).with(runs_on).passes();
    // Nor may it show until then that it learns its idle speed (840000346).
    let learns = |h: &mut History| {
        runs_on(h);
        let first = h.samples.iter_mut().filter(|s| (40 * SECOND..41 * SECOND).contains(&s.at));
        first.for_each(|s| s.phase = Phase::LearningIdle);
    };
    story(43.5, false).with(learns).passes();
    // What it shows after the last set that was answered comes too late, too.
    let cold_after = |from: f64| {
        story(43.5, false).with(move |h| {
            let after = h.samples.iter_mut().filter(|s| (micros(from)..micros(43.5)).contains(&s.at));
            after.for_each(|s| (s.fault, s.egt) = (false, 100.0));
            h.frames.retain(|frame| frame.at < micros(42.6));
        })
    };
    cold_after(42.8).passes();
    assert!(ignites(cold_after(42.0)));
    shows(50 * MS).passes();
    shows(200 * MS).breaks(&[Rule::Ignition]);
    cleared(micros(42.6)).passes();
    cleared(micros(43.5)).breaks(&[Rule::Ignition]);
    // Nor is it the node's fault that the fall has shown since the last run, or that a standby arrives just
    // then.
    let unanswered = |last_run: f64, standby: f64| {
        story(46.0, false).wire(standby, standby + 0.01, STANDBY).with(move |h| {
            h.frames.retain(|frame| frame.sent == STANDBY || frame.at < micros(last_run));
        })
    };
    assert!(!ignites(unanswered(44.5, 45.98)));
    assert!(ignites(unanswered(45.5, 45.98)));
    // Within 5 s after the demand was lowered a fall proves nothing, and after them a slow one does not.
    let lowered = |clears, degrees_per_s: f64| {
        story(clears, false).with(|h| {
            for frame in h.frames.iter_mut().filter(|frame| (42 * SECOND..43_500 * MS).contains(&frame.at)) {
                frame.sent = IDLE;
            }
            for sample in h.samples.iter_mut().filter(|sample| sample.phase == Phase::Cooling) {
                sample.egt = 700.0 - degrees_per_s * (sample.at - 40 * SECOND) as f64 / SECOND as f64;
            }
        })
    };
    let breaks = |clears, degrees_per_s| lowered(clears, degrees_per_s).finds(Rule::Ignition);
    assert!(!breaks(46.0, 20.0));
    assert!(!breaks(56.0, 12.0));
    assert!(breaks(56.0, 20.0));
}

/// 881000114: noise hides that a start has failed, or that the flame is out, and the ECU acts on the last run that it was sent.
#[test]
fn noise_hides_that_an_engine_is_out() {
    let ignites = |until: f64, at: f64| {
        flight(AMT, 40.0)
            .streams(PILOT, 40.0, 46.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.0, 43.0, HALF)
            .turbine(40.0, at, Phase::Standby, 0.0, 90.0)
            .turbine(at, 46.0, Phase::Ignition, 5000.0, 90.0)
            .mark(at, Mark::Ignition)
            .with(|h| h.noise = Spans::from(&[(39 * SECOND, micros(until))]))
            .finds(Rule::Ignition)
    };
    assert!(!ignites(43.2, 45.0));
    assert!(ignites(40.3, 45.0) && ignites(43.2, 45.99));
}
