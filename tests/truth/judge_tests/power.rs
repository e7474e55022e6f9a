//! Histories by hand for the judge's rules: the power of starter and ignition.

use super::*;

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
fn reset_keeps_the_power_with_a_record_and_a_loss_of_power_does_not() {
    let reset = |cause, after: bool, later: &[(f64, Option<bool>)]| {
        let resets = move |h: &mut History| {
            h.resets.push(Reset { down: 43 * SECOND, up: 44 * SECOND, cause });
            h.frames.retain(|frame| !(43 * SECOND..micros(44.2)).contains(&frame.at));
        };
        let changes = [&[(43.0, None), (44.0, Some(after))], later, &[(65.0, Some(false))]].concat();
        let verdict = power(stopped(ZK5), &changes).with(resets).judged();
        verdict.rules().contains(&Rule::Power)
    };
    assert_eq!([Cause::Watchdog, Cause::BrownOut].map(|cause| reset(cause, true, &[])), [false; 2]);
    // The ECU reports that it cools: then it is on again.
    let again = [(44.9, Some(true))];
    assert!(!reset(Cause::PowerOn, false, &again));
    assert!(reset(Cause::PowerOn, true, &[]));
}
