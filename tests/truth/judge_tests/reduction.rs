//! Histories by hand for the judge's rules: an engine whose demand is reduced because another one has failed.

use super::*;

/// Another engine has failed in this time, and demands are halved for it.
fn another_fails(h: &mut History, from_us: u64, to_us: u64) {
    h.rules.when_other_fails = Some(500);
    h.other_down = Spans::from(&[(from_us, to_us)]);
    h.other_failed = h.other_down.clone();
}

#[test]
fn a_share_that_is_changed_counts_from_then_on() {
    let story = |changed: u64| {
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 60.0, PilotCommand::Run(Demanded::Throttle(500)))
            .ramp(40.0, 500, 250)
            .wire(41.0, 50.0, Sent::Full(Switch::Run, 250))
            .ramp(50.0, 250, 400)
            .wire(50.5, 60.0, Sent::Full(Switch::Run, 400))
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
            .with(|h| {
                h.shares.push((changed * SECOND, 800));
                another_fails(h, 40 * SECOND, 70 * SECOND);
            })
    };
    story(50).passes();
    story(59).breaks(&[Rule::Reduction]);
}

/// 866001114: the stick moves just after a reset has taken back a share that was set in flight.
#[test]
fn a_share_that_a_reset_takes_back_counts_from_then_on() {
    let run = |tenths| PilotCommand::Run(Demanded::Throttle(tenths));
    let rises = |taken_back: u64| {
        let story =
            flight(ZK5, 40.0).streams(PILOT, 40.0, 50.6, run(500)).streams(PILOT, 50.6, 60.0, run(1000));
        let story = story.ramp(40.0, 500, 400).wire(40.3, 50.0, Sent::Full(Switch::Run, 400));
        let story = story.wire(50.2, 50.6, Sent::Full(Switch::Run, 250)).wire(50.6, 60.0, HALF);
        let story = story.turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0).with(|h| {
            let reset = Reset { down: 50 * SECOND, up: 50_050 * MS, cause: Cause::Watchdog };
            (h.resets, h.shares) = (vec![reset], vec![(30 * SECOND, 800), (taken_back * MS, 500)]);
            another_fails(h, 40 * SECOND, 70 * SECOND);
        });
        story.finds(Rule::Rate)
    };
    assert_eq!([50_050, 55_000].map(rises), [false, true]);
}

#[test]
fn a_demand_is_reduced_while_another_engine_has_failed() {
    let story = |tenths| {
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 60.0, PilotCommand::Run(Demanded::Throttle(500)))
            .ramp(40.0, 500, tenths)
            .wire(41.0, 60.0, Sent::Full(Switch::Run, tenths))
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
            .with(|h| {
                another_fails(h, 40 * SECOND, 70 * SECOND);
            })
    };
    story(250).passes();
    story(500).breaks(&[Rule::Reduction]);
    // Also when its source is lost, and the fail-safe throttle is higher.
    let lost = |tenths| {
        flight(ZK5, 40.0)
            .wire(40.0, 41.5, HALF)
            .ramp(41.5, 500, 400)
            .wire(41.7, 50.0, Sent::Full(Switch::Run, 400))
            .wire(50.0, 60.0, Sent::Full(Switch::Run, tenths))
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
            .with(|h| {
                h.rules.fail_safe = 400;
                another_fails(h, 50 * SECOND, 70 * SECOND);
            })
    };
    lost(250).passes();
    lost(400).breaks(&[Rule::Reduction]);
    // Until the source that returns is in control (832000166).
    let returns = |at| lost(250).streams(PILOT, at, 60.0, PilotCommand::Run(Demanded::Throttle(200)));
    returns(59.4).passes();
    returns(54.0).breaks(&[Rule::Reduction]);
    // One that commands now and then never is (847000883).
    let now_and_then = [53.0, 55.5, 58.0].into_iter();
    let low = PilotCommand::Run(Demanded::Throttle(200));
    now_and_then.fold(lost(250), |story, at| story.once(2, at, low)).passes();
}

/// The order was given up meanwhile (AMT's serial delay): the first reply has the throttle that the ECU has.
#[test]
fn a_reduction_begins_when_an_engine_is_found_again() {
    let found = |silent: f64, falls: f64| {
        flight(AMT, 40.0)
            .streams(PILOT, 40.0, 60.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.0 + silent, 40.0 + silent + falls, HALF)
            .ramp(40.0 + silent + falls, 500, 250)
            .wire(40.5 + silent + falls, 60.0, Sent::Full(Switch::Run, 250))
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
            .with(|h| another_fails(h, 40 * SECOND, 70 * SECOND))
            .finds(Rule::Reduction)
    };
    assert!(!found(5.0, 0.5));
    assert!(found(5.0, 4.0), "it never falls");
    assert!(found(1.0, 3.0), "the order was not given up");
}

/// A reset in a silence keeps what was on the wire, and a governor's throttle is no share of a commanded one.
#[test]
fn a_reduction_is_of_what_the_wire_had_before_a_reset_and_never_of_an_rpm() {
    let reduces = |reset: bool, tenths: u32| {
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 42.0, PilotCommand::Run(Demanded::Throttle(200)))
            .wire(40.0, 42.0, HALF)
            .wire(43.0, 60.0, Sent::Full(Switch::Run, tenths))
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
            .with(|h| {
                if reset {
                    let (down, up) = (42 * SECOND, 42_050 * MS);
                    h.resets.push(Reset { down, up, cause: Cause::Watchdog });
                }
                another_fails(h, 45 * SECOND, 70 * SECOND);
            })
            .finds(Rule::Reduction)
    };
    assert_eq!(
        [(true, 250), (true, 350), (false, 250)].map(|(reset, tenths)| reduces(reset, tenths)),
        [false, true, true]
    );
    let governed = |then: Demanded| {
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 52.0, PilotCommand::Run(Demanded::Throttle(50)))
            .streams(PILOT, 52.0, 60.0, PilotCommand::Run(then))
            .wire(40.0, 52.0, Sent::Full(Switch::Run, 20))
            .wire(52.5, 60.0, Sent::Full(Switch::Run, 300))
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
            .with(|h| {
                another_fails(h, 45 * SECOND, 70 * SECOND);
            })
            .finds(Rule::Reduction)
    };
    assert_eq!([Demanded::Rpm(80_000), Demanded::Throttle(50)].map(governed), [false, true]);
}

/// It counts as failed as soon as its node shuts it down without a command, before its turbine is out.
#[test]
fn an_engine_may_have_failed_from_its_standby_on() {
    let story =
        |sent| flight(ZK5, 40.0).wire(40.0, 41.0, sent).turbine(40.0, 40.1, Phase::Running, 100_000.0, 500.0);
    let failed = |sent, seconds: f64| may_have_failed(&story(sent).0).contains(micros(seconds));
    assert!(failed(STANDBY, 40.0));
    assert!(!failed(STANDBY, 39.8));
    assert!(!failed(HALF, 40.0));
}

/// The stick moves just before another engine's failure ends: the new demand is sent reduced at once, and rises from there.
#[test]
fn a_stick_that_moves_before_a_reduction_ends_does_not_hide_a_jump() {
    let story = |tenths| {
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 49.97, PilotCommand::Run(Demanded::Throttle(500)))
            .streams(PILOT, 49.97, 59.5, PilotCommand::Run(Demanded::Throttle(900)))
            .ramp(40.0, 500, 250)
            .wire(41.0, 50.0, Sent::Full(Switch::Run, 250))
            .ramp(50.0, tenths, 900)
            .wire(51.0, 60.0, Sent::Full(Switch::Run, 900))
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
            .with(|h| {
                another_fails(h, 40 * SECOND, 49_980 * MS);
            })
    };
    story(475).passes();
    story(560).breaks(&[Rule::Rate]);
}

/// An engine has certainly failed if it went out and no source commanded standby: below a source in control that commands run,
/// standby changes nothing. A speed may be refused, and then its source is not in control.
#[test]
fn an_engine_has_failed_for_sure_until_a_source_may_have_commanded_standby() {
    let failed_with = |demanded: Option<Demanded>, since: f64, resets: &[f64]| {
        let story = flight(ZK5, 50.0).turbine(50.0, 80.0, Phase::Stopped, 0.0, 200.0).streams(
            PILOT,
            50.0,
            62.0,
            PilotCommand::Run(Demanded::Throttle(500)),
        );
        let story = match demanded {
            Some(demanded) => story.streams(PILOT, since, 80.0, PilotCommand::Run(demanded)).streams(
                2,
                70.0,
                80.0,
                PilotCommand::Standby,
            ),
            None => story.streams(PILOT, since, 80.0, PilotCommand::Standby),
        };
        let mut history = story.wire(50.0, 50.5, HALF).wire(50.5, 80.0, STANDBY).0;
        history.commanded.sort_by_key(|commanded| commanded.at);
        history.samples.sort_by_key(|sample| sample.at);
        history.frames.sort_by_key(|frame| frame.at);
        history.end = 80 * SECOND;
        let reset = |up: &f64| Reset { down: micros(up - 0.01), up: micros(*up), cause: Cause::Watchdog };
        history.resets = resets.iter().map(reset).collect();
        crate::judge::failed_for_sure(&history)
    };
    let failed = |demanded, since| failed_with(demanded, since, &[]);
    let below_throttle = failed(Some(Demanded::Throttle(500)), 62.0);
    assert!(below_throttle.contains(60 * SECOND) && below_throttle.contains(75 * SECOND));
    // A source that was lost has to command for a while before it is in control.
    let below_one_that_returns = failed(Some(Demanded::Throttle(500)), 69.5);
    assert!(below_one_that_returns.contains(60 * SECOND) && !below_one_that_returns.contains(75 * SECOND));
    // 790001270: a node that was just reset has not received it yet.
    let in_a_loop: Vec<f64> = (140..160).map(|half| f64::from(half) / 2.0).collect();
    let below_throttle = failed_with(Some(Demanded::Throttle(500)), 62.0, &in_a_loop);
    assert!(below_throttle.contains(60 * SECOND) && !below_throttle.contains(75 * SECOND));
    let below_speed = failed(Some(Demanded::Rpm(100_000)), 62.0);
    assert!(below_speed.contains(60 * SECOND) && !below_speed.contains(75 * SECOND));
    let alone = failed(None, 65.0);
    assert!(alone.contains(60 * SECOND) && !alone.contains(66 * SECOND));
}

/// An engine that went out before two reports can have shown that it ran has not certainly failed.
#[test]
fn an_engine_has_failed_for_sure_only_if_it_was_known_to_run() {
    let failed = |ran: f64, hidden: bool| {
        let out = RUNS as f64 + ran;
        let story = started(ZK5)
            .turbine(RUNS as f64, out, Phase::Running, 50_000.0, 500.0)
            .turbine(out, 80.0, Phase::Stopped, 0.0, 200.0)
            .streams(PILOT, 31.0, 80.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(31.0, out + 0.5, IDLE);
        let mut history = story.wire(out + 0.5, 80.0, STANDBY).0;
        for sample in history.samples.iter_mut().filter(|sample| sample.runs()) {
            sample.hidden = hidden;
        }
        history.commanded.sort_by_key(|commanded| commanded.at);
        history.samples.sort_by_key(|sample| sample.at);
        history.frames.sort_by_key(|frame| frame.at);
        history.end = 80 * SECOND;
        crate::judge::failed_for_sure(&history).contains(60 * SECOND)
    };
    assert!(failed(5.0, false));
    assert!(!failed(0.1, false) && !failed(1.0, false));
    assert!(!failed(5.0, true), "it was never reported as running");
}
