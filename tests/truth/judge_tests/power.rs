//! Histories by hand for the judge's rules: the power of starter and ignition.

use super::*;
use std::cell::Cell;

/// The power of the starter: on with the arming, and these changes afterwards, in seconds.
fn power(story: Story, changes: &[(f64, Option<bool>)]) -> Story {
    let changes: Vec<_> = changes.iter().map(|(at, power)| (micros(*at), *power)).collect();
    story.with(|h| {
        h.power = vec![(0, Some(false)), (micros(1.52), Some(true))];
        h.power.extend(changes);
    })
}

/// A flight with a stop at 40 s, cooling until 60 s, and cold until 80 s.
fn stopped(kind: Kind) -> Story {
    flight(kind, 40.0)
        .once(PILOT, 40.0, PilotCommand::Stop)
        .wire(40.0, 80.0, STOP)
        .turbine(40.0, 60.0, Phase::Cooling, 5000.0, 300.0)
        .turbine(60.0, 80.0, Phase::Standby, 0.0, 60.0)
}

#[test]
fn starter_has_power_from_armed_until_the_engine_is_cold_and_at_rest_also_after_a_stop() {
    for kind in [AMT, ZK5] {
        power(stopped(kind), &[(65.0, Some(false))]).passes();
        // Off in flight, while it cools, or by a single report of a cold engine.
        for at in [35.0, 50.0, 60.5] {
            power(stopped(kind), &[(at, Some(false))]).breaks(&[Rule::Power]);
        }
        // Never off.
        power(stopped(kind), &[]).breaks(&[Rule::Power]);
    }
}

/// An ECU that is plugged in reports a cold engine at rest, whatever the one before did.
#[test]
fn another_ecu_may_report_a_cold_engine() {
    for (kind, version) in [(AMT, 0), (ZK5, 4)] {
        let plugged = |second: u64| {
            let story = stopped(kind).with(move |h| h.versions = vec![(second * SECOND, version)]);
            power(story, &[(50.0, Some(false))])
        };
        plugged(49).passes();
        plugged(40).breaks(&[Rule::Power]);
    }
}

#[test]
fn starter_has_power_when_its_engine_is_armed_and_not_before() {
    let on = |at: f64| ready(ZK5).with(move |h| h.power = vec![(0, Some(false)), (micros(at), Some(true))]);
    on(1.55).passes();
    on(0.5).breaks(&[Rule::Power]);
    on(1.7).breaks(&[Rule::Power]);
    ready(ZK5).with(|h| h.power = vec![(0, Some(false))]).breaks(&[Rule::Power]);
    // An armed engine is cold and at rest, and keeps it.
    power(ready(ZK5).turbine(5.0, 20.0, Phase::Standby, 0.0, 15.0).wire(4.0, 20.0, STANDBY), &[]).passes();
    power(
        ready(ZK5).turbine(5.0, 20.0, Phase::Standby, 0.0, 15.0).wire(4.0, 20.0, STANDBY),
        &[(15.0, Some(false))],
    )
    .breaks(&[Rule::Power]);
    // Disarmed, it loses it.
    let disarmed = |changes: &[(f64, Option<bool>)]| {
        let story = ready(ZK5).once(PILOT, 10.0, PilotCommand::Disarm);
        power(story.turbine(5.0, 20.0, Phase::Standby, 0.0, 15.0).wire(4.0, 20.0, STANDBY), changes)
    };
    disarmed(&[(10.05, Some(false))]).passes();
    disarmed(&[]).breaks(&[Rule::Power]);
    // So it does after a loss of the node's power, where no commands follow.
    let takes_an_armed_ones = |cause| {
        let story = ready(ZK5).with(|h| {
            h.commanded.retain(|commanded| commanded.at < 3 * SECOND);
            h.resets.push(Reset { down: 10 * SECOND, up: 11 * SECOND, cause });
            h.frames.retain(|frame| frame.at < 10 * SECOND);
        });
        let story = story.turbine(5.0, 20.0, Phase::Standby, 0.0, 15.0).wire(11.2, 20.0, STANDBY);
        let story = power(story, &[(10.0, None), (11.0, Some(true)), (15.0, Some(false))]);
        story.judged().findings.iter().any(|finding| finding.text.starts_with("an armed engine's"))
    };
    assert_eq!([Cause::Watchdog, Cause::PowerOn].map(takes_an_armed_ones), [true, false]);
    // The test of a starter that was begun before is reported in place of standby.
    disarmed(&[]).wire(9.0, 9.01, Sent::Action(6)).passes();
}

#[test]
fn starter_of_an_engine_that_is_sent_run_has_power() {
    let late = |on: f64| {
        flight(ZK5, 40.0).with(move |h| {
            // Whoever armed it before the history begins.
            h.commanded.retain(|commanded| commanded.command != PilotCommand::Arm);
            h.rules.arming = false;
            h.power = vec![(0, Some(false)), (micros(on), Some(true))];
        })
    };
    late(4.01).passes();
    late(4.5).breaks(&[Rule::Power]);
}

#[test]
fn reset_keeps_the_power_that_was_and_a_loss_of_power_does_not() {
    let (armed_at, arming) = (Cell::new(None), Cell::new(true));
    let reset_at = |down: u64, cause, after: bool, later: &[(f64, Option<bool>)], renamed: bool| {
        let arming = arming.get();
        let resets = move |h: &mut History| {
            h.rules.arming = arming;
            let (down, up) = (down * SECOND, (down + 1) * SECOND);
            h.resets.push(Reset { down, up, cause });
            h.renamed.extend(renamed.then_some(up));
            h.frames.retain(|frame| !(down..up + micros(0.2)).contains(&frame.at));
        };
        let [down, up] = [down as f64, (down + 1) as f64];
        let changes = [&[(down, None), (up, Some(after))], later, &[(65.0, Some(false))]].concat();
        let story = power(stopped(ZK5), &changes).with(resets);
        let story = match armed_at.get() {
            Some(at) => story.once(PILOT, at, PilotCommand::Arm).once(PILOT, 50.0, PilotCommand::Disarm),
            None => story,
        };
        story.finds(Rule::Power)
    };
    let reset = |cause, after, later: &[_]| reset_at(43, cause, after, later, false);
    // The ECU reports that it cools: then it is on again.
    let again = [(44.9, Some(true))];
    for cause in [Cause::Watchdog, Cause::BrownOut] {
        assert!(!reset(cause, true, &[]));
        assert!(reset(cause, false, &again), "{cause}: hot, and a stop is latched");
    }
    assert!(!reset(Cause::PowerOn, false, &again));
    assert!(reset(Cause::PowerOn, true, &[]));
    // Armed again by a command in the instant in which the node begins, and one second later.
    for needed in [true, false] {
        arming.set(needed);
        let armed = [44.0, 45.0].map(|at| {
            armed_at.set(Some(at));
            reset(Cause::PowerOn, true, &[])
        });
        assert_eq!(armed, [false, true], "{needed}");
    }
    arming.set(true);
    armed_at.set(None);
    // In flight nothing but the power itself says so where the memory is another engine's.
    let again = [(31.02, Some(true))];
    assert!(reset_at(30, Cause::BrownOut, false, &again, false));
    assert!(!reset_at(30, Cause::BrownOut, false, &again, true));
}

/// Of releases that are repeated, the first may have come while the ECU was silent: who armed before the last of them is not armed.
#[test]
fn an_arming_before_the_release_that_took_effect_powers_no_starter() {
    let armed_at = |at: f64| {
        let story = Story::new(AMT).once(PILOT, 1.0, PilotCommand::Stop);
        let story = story.streams(PILOT, 1.55, 2.0, PilotCommand::Release).once(2, at, PilotCommand::Arm);
        let story = story.wire(1.0, 1.95, STOP).wire(2.0, 20.0, STANDBY);
        story
            .turbine(0.0, 20.0, Phase::Standby, 0.0, 15.0)
            .with(|h| h.power = vec![(0, Some(false))])
            .judged()
            .rules()
    };
    // The last stop is on the wire at 1.876 s, the last release comes at 1.95 s.
    for before in [1.7, 1.92] {
        assert_eq!(armed_at(before), [], "{before} s");
    }
    assert_eq!(armed_at(2.1), [Rule::Power]);
    // Or it was another source's release (812001803).
    let released = || {
        Story::new(AMT)
            .once(PILOT, 1.0, PilotCommand::Stop)
            .once(0, 1.9, PilotCommand::Release)
            .once(0, 1.91, PilotCommand::Arm)
            .wire(1.0, 1.85, STOP)
            .wire(2.0, 20.0, STANDBY)
            .turbine(0.0, 20.0, Phase::Standby, 0.0, 15.0)
            .with(|h| h.power = vec![(0, Some(false))])
    };
    let released_at = |second| released().once(PILOT, second, PilotCommand::Release).finds(Rule::Power);
    assert!(!released_at(1.93) && released_at(2.5));
    // Standby of a node that lost its memory does not show that the stop was released (858001575).
    let released_before = |cause| {
        let reset = Reset { down: 1_980 * MS, up: 1_990 * MS, cause };
        released().with(|h| h.resets.push(reset)).finds(Rule::Power)
    };
    assert_eq!([Cause::Watchdog, Cause::PowerOn].map(released_before), [true, false]);
}
