//! Histories by hand for the judge's rules: the fuel valve.

use super::*;
use crate::history::Pin;

/// The pin of the valve: open from the start on, and these changes afterwards, in seconds.
fn pin(story: Story, changes: &[(f64, Pin)]) -> Story {
    let changes: Vec<_> = changes.iter().map(|(at, pin)| (micros(*at), *pin)).collect();
    story.with(|h| {
        h.pin = vec![(0, Pin::Closed), (micros(4.01), Pin::Open)];
        h.pin.extend(changes);
    })
}

/// A flight with a stop at 40 s, and the turbine out with it.
fn stopped() -> Story {
    flight(ZK5, 40.0).once(PILOT, 40.0, PilotCommand::Stop).wire(40.0, 50.0, STOP).turbine(
        40.0,
        50.0,
        Phase::Cooling,
        5000.0,
        300.0,
    )
}

#[test]
fn a_latched_stop_closes_the_valve_until_its_release() {
    pin(stopped(), &[(40.005, Pin::Closed)]).passes();
    pin(stopped(), &[(40.1, Pin::Closed)]).breaks(&[Rule::Valve]);
    pin(stopped(), &[]).breaks(&[Rule::Valve]);
    pin(stopped(), &[(40.005, Pin::Closed), (45.0, Pin::Open)]).breaks(&[Rule::Valve]);
    // After a reset, and while there is no node.
    let reset = |cause| {
        let again = move |h: &mut History| {
            h.resets.push(Reset { down: 43 * SECOND, up: 44 * SECOND, cause });
            h.frames.retain(|f| !(43 * SECOND..micros(44.2)).contains(&f.at));
        };
        stopped().with(again)
    };
    let after = |pin| [(40.005, Pin::Closed), (43.0, Pin::Floats), (44.0, pin)];
    pin(reset(Cause::Watchdog), &after(Pin::Closed)).passes();
    pin(reset(Cause::Watchdog), &after(Pin::Open)).breaks(&[Rule::Valve]);
    pin(reset(Cause::BrownOut), &after(Pin::Open)).breaks(&[Rule::Valve]);
}

#[test]
fn nothing_burns_behind_a_valve_that_is_shut() {
    let shut = |from: f64| {
        let story = stopped().turbine(40.0, 41.0, Phase::Running, 100_000.0, 500.0);
        let shut = move |h: &mut History| {
            h.samples.retain(|s| s.phase == Phase::Running || s.at >= 41 * SECOND || s.at < 40 * SECOND);
            h.shut = Spans::from(&[(0, micros(4.01)), (micros(from), 50 * SECOND)]);
        };
        pin(story, &[(40.005, Pin::Closed)]).with(shut)
    };
    shut(40.9).passes();
    shut(40.005).breaks(&[Rule::ShutValve]);
}

#[test]
fn a_start_finds_the_valve_open() {
    let late = |open: f64| {
        flight(ZK5, 40.0).with(move |h| h.pin = vec![(0, Pin::Closed), (micros(open), Pin::Open)])
    };
    late(4.01).passes();
    late(5.5).breaks(&[Rule::ShutValve]);
    // After 10 s of failed starts of the firmware, an ECU that lights its engine again by itself finds it closed; a pilot does not.
    let again = |failed: u64, by: Option<f64>| {
        let relit = move |h: &mut History| {
            let downs = (40_000 - failed..40_000).step_by(500);
            let reset = |down: u64| Reset { down: down * MS, up: (down + 10) * MS, cause: Cause::Watchdog };
            h.resets.extend(downs.map(reset));
            h.marks.push((46 * SECOND, Mark::Ignition));
        };
        let story = flight(ZK5, 50.0).with(relit);
        let story = match by {
            None => story,
            Some(at) => story.streams(PILOT + 1, at - 1.0, at, PilotCommand::Standby).once(
                PILOT + 1,
                at,
                PilotCommand::Run(Demanded::Throttle(0)),
            ),
        };
        pin(story, &[(39.52, Pin::Closed)]).finds(Rule::ShutValve)
    };
    assert_eq!(
        [(15_000, None), (8_000, None), (15_000, Some(45.5))].map(|(failed, by)| again(failed, by)),
        [false, true, true]
    );
}

/// A limit shut the engine down, and the wires were cut before a reply said so: after the reset the first reply does (814002034).
#[test]
fn standby_that_no_reply_could_carry_closes_the_valve_after_a_reset() {
    let story = |first: Sent| {
        let cut = |h: &mut History| {
            h.mute = Spans::from(&[(40 * SECOND, 43 * SECOND)]);
            h.resets.push(Reset { down: micros(42.0), up: micros(42.1), cause: Cause::Watchdog });
        };
        let story = flight(AMT, 40.0).streams(PILOT, 40.0, 43.0, PilotCommand::Run(Demanded::Throttle(500)));
        let story = story.turbine(40.0, 43.2, Phase::Running, 100_000.0, 500.0).wire(43.15, 43.3, first);
        pin(story, &[(42.0, Pin::Floats), (42.1, Pin::Closed)]).with(cut).finds(Rule::CutOff)
    };
    assert_eq!([STANDBY, HALF].map(story), [false, true]);
}

#[test]
fn the_valve_cuts_no_engine_that_is_ordered_to_run() {
    let closed = [(35.0, Pin::Closed), (35.2, Pin::Open)];
    pin(flight(ZK5, 40.0), &[]).passes();
    pin(flight(ZK5, 40.0), &closed).breaks(&[Rule::CutOff]);
    // A node of which nothing is left does.
    let lost = |cause| {
        let again =
            move |h: &mut History| h.resets.push(Reset { down: micros(34.99), up: 35 * SECOND, cause });
        pin(flight(ZK5, 40.0), &closed).with(again)
    };
    lost(Cause::PowerOn).breaks_beside(&[Rule::Doubt], &[]);
    lost(Cause::Watchdog).breaks_beside(&[Rule::Doubt], &[Rule::CutOff]);
    // Nor can a node know that the engine runs if it has been reset five times a second since before that.
    let in_a_loop = |from: u64, cause, pins: &[(f64, Pin)]| {
        let resets = move |h: &mut History| {
            let downs = (from..=34_990).rev().step_by(200).collect::<Vec<_>>();
            let reset = |down: u64| Reset { down: down * 1000, up: down * 1000 + 10_000, cause };
            h.resets.extend(downs.into_iter().rev().map(reset));
        };
        pin(flight(ZK5, 40.0), pins).with(resets)
    };
    // Other rules that such a loop breaks are not tested here.
    let found = |story: Story| {
        let rules = story.judged().rules().into_iter();
        rules.filter(|rule| [Rule::Valve, Rule::CutOff].contains(rule)).collect::<Vec<_>>()
    };
    assert_eq!(found(in_a_loop(3_000, Cause::BrownOut, &closed)), []);
    assert_eq!(found(in_a_loop(33_000, Cause::BrownOut, &closed)), [Rule::CutOff]);
    // Nor one that has just lost its whole memory.
    let erased = |up: f64| {
        let resets = move |h: &mut History| {
            let cause = Cause::PowerOn;
            h.resets.push(Reset { down: micros(up - 0.1), up: micros(up), cause });
            h.resets.push(Reset { down: micros(34.99), up: 35 * SECOND, cause: Cause::Watchdog });
        };
        pin(flight(ZK5, 40.0), &closed).with(resets)
    };
    erased(34.9).breaks_beside(&[Rule::Doubt], &[]);
    erased(33.0).breaks_beside(&[Rule::Doubt], &[Rule::CutOff]);
    // Nor one whose wire was cut since before the engine ran.
    let cut = |from: u64| {
        let cut = move |h: &mut History| {
            h.mute = Spans::from(&[(from * SECOND, 40 * SECOND)]);
            let cause = Cause::Watchdog;
            h.resets.push(Reset { down: micros(34.99), up: 35 * SECOND, cause });
        };
        pin(flight(ZK5, 40.0), &closed).with(cut).finds(Rule::CutOff)
    };
    assert_eq!([cut(29), cut(33)], [false, true]);
    // Nor one whose ECU reports another state in flight.
    let other = |from: u64| {
        let other = move |h: &mut History| {
            let since = |sample: &&mut Sample| sample.at >= from * SECOND;
            h.samples.iter_mut().filter(since).for_each(|sample| sample.hidden = true);
            let cause = Cause::Watchdog;
            h.resets.push(Reset { down: micros(34.99), up: 35 * SECOND, cause });
        };
        pin(flight(ZK5, 40.0), &closed).with(other).finds(Rule::CutOff)
    };
    assert_eq!([other(30), other(33)], [false, true]);
    // A loop of resets without any command ends in standby.
    let alone = |silent: f64| {
        let quiet = move |h: &mut History| h.commanded.retain(|c| c.at < micros(35.0 - silent));
        in_a_loop(33_000, Cause::BrownOut, &closed).with(quiet)
    };
    for (silent, rules) in [(5.0, &[Rule::CutOff][..]), (10.5, &[])] {
        let verdict = alone(silent).judged();
        let found: Vec<Rule> = verdict.rules().into_iter().filter(|rule| *rule == Rule::CutOff).collect();
        assert_eq!(found, rules, "{:#?}", verdict.findings);
    }
    // CTF ends it, whatever its source streams afterwards.
    let ctf = |at: f64| {
        let again = |h: &mut History| {
            h.resets.push(Reset { down: micros(34.99), up: 35 * SECOND, cause: Cause::Watchdog });
        };
        pin(flight(AMT, 40.0), &closed).once(PILOT, at, PilotCommand::Ctf).with(again).finds(Rule::CutOff)
    };
    assert_eq!([ctf(34.5), ctf(39.0)], [false, true]);
    // 10 s of starts that the firmware itself ends close it, and nothing less.
    let fails_each = |every: usize, from: u64, cause, pins: &[(f64, Pin)]| {
        let resets = move |h: &mut History| {
            let downs = (from..=54_990).rev().step_by(every).collect::<Vec<_>>();
            let reset = |down: u64| Reset { down: down * 1000, up: down * 1000 + 10_000, cause };
            h.resets.extend(downs.into_iter().rev().map(reset));
        };
        found(pin(flight(ZK5, 60.0), pins).with(resets))
    };
    let fails = |from, cause, pins: &[(f64, Pin)]| fails_each(200, from, cause, pins);
    let shut = [(52.6, Pin::Closed)];
    // It stays closed over a later reset of a node that lived, and does not close again.
    let later = |pins: &[(f64, Pin)]| {
        let resets = |h: &mut History| {
            h.resets.push(Reset { down: micros(52.55), up: micros(52.6), cause: Cause::Watchdog });
        };
        let story = pin(flight(ZK5, 60.0), pins).with(resets);
        story
            .judged()
            .findings
            .iter()
            .filter(|found| found.rule == Rule::CutOff)
            .map(|found| found.at)
            .collect::<Vec<_>>()
    };
    assert_eq!(later(&[(45.0, Pin::Closed), (52.55, Pin::Floats), (52.6, Pin::Closed)]), [45 * SECOND]);
    assert_eq!(later(&[(52.55, Pin::Floats), (52.6, Pin::Closed)]), [52_600 * MS]);
    // Each counts for a little more than it lived: of 35 ms, 8.75 s may be enough.
    assert_eq!(fails_each(45, 41_500, Cause::Watchdog, &shut), []);
    assert_eq!(fails_each(45, 44_000, Cause::Watchdog, &shut), [Rule::CutOff]);
    assert_eq!(fails(42_000, Cause::Watchdog, &shut), []);
    assert_eq!(fails(42_000, Cause::Watchdog, &[]), [Rule::Valve]);
    assert_eq!(fails(44_000, Cause::Watchdog, &shut), [Rule::CutOff]);
    assert_eq!(fails(42_000, Cause::BrownOut, &shut), [Rule::CutOff]);
    // Standby that is not obeyed: after 5 s, and not before.
    let standby = |closed: f64| {
        let story = flight(ZK5, 40.0)
            .once(PILOT, 40.0, PilotCommand::ShutDown)
            .wire(40.0, 50.0, STANDBY)
            .turbine(40.0, 50.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| h.deaf = Spans::from(&[(39 * SECOND, 50 * SECOND)]));
        pin(story, &[(closed, Pin::Closed)])
    };
    standby(46.0).passes();
    standby(43.0).breaks(&[Rule::CutOff]);
}

/// The engine is out, and its ECU does not follow the order: this closes the valve in standby, but not while run is ordered.
#[test]
fn valve_of_an_engine_that_is_out_closes_in_standby_only() {
    let out = |ordered: Sent, command: PilotCommand| {
        let story = flight(ZK5, 40.0).streams(PILOT, 40.0, 50.0, command).wire(40.0, 50.0, ordered);
        let story = story.turbine(40.0, 50.0, Phase::Cooling, 5000.0, 300.0);
        let verdict = pin(story, &[(46.0, Pin::Closed)]).judged();
        verdict.findings.iter().filter(|found| found.rule == Rule::CutOff).count()
    };
    assert_eq!(out(HALF, PilotCommand::Run(Demanded::Throttle(500))), 1);
    assert_eq!(out(STANDBY, PilotCommand::Standby), 0);
    // A lower source that streams standby is not a reason; the one in control is.
    let below = |source: usize| {
        let story = flight(ZK5, 50.0).streams(source, 45.0, 50.0, PilotCommand::Standby);
        let story = story.with(|h| h.samples.retain(|sample| sample.at < 40 * SECOND));
        let story = story.turbine(40.0, 50.0, Phase::Cooling, 5000.0, 300.0);
        let verdict = pin(story, &[(46.0, Pin::Closed)]).judged();
        verdict.findings.iter().filter(|found| found.rule == Rule::CutOff).count()
    };
    assert_eq!([PILOT + 1, PILOT - 1].map(below), [1, 0]);
}

/// In a start the thermocouple breaks, and the limit of the exhaust temperature orders standby: the reply to the set that shows it has been
/// handed out, and the next one carries the standby (901000873).
#[test]
fn valve_closes_with_the_set_that_exceeds_a_limit() {
    let closes = |sets: &'static [u64], next: Sent| {
        let story = ready(AMT)
            .streams(PILOT, 4.0, 6.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(4.0, 5.01, IDLE)
            .wire(5.125, 6.0, next)
            .turbine(5.0, 6.0, Phase::Standby, 0.0, 15.0)
            .with(|h| h.sets = sets.iter().map(|at| at * MS).collect());
        pin(story, &[(5.001, Pin::Closed)]).finds(Rule::CutOff)
    };
    let sets = &[4751, 4876, 5001, 5126];
    assert!(!closes(sets, STANDBY));
    // Run stays on the wire; the set came long before; the ECU sends none.
    assert!(closes(sets, IDLE));
    assert!(closes(&[4751, 4876, 4991, 5126], STANDBY));
    assert!(closes(&[], STANDBY));
}
