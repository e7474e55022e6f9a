//! A demand that is held low after the end of what excuses it is found, and before that end it is not.

use super::*;

/// Low from 45 s until then, in 0.1 %.
const LOW: Sent = Sent::Full(Switch::Run, 200);
const RULE: Rule = Rule::HeldDown;

/// At half throttle until 45 s, low until `until`, and at half throttle again until 70 s.
fn low_until(kind: Kind, until: f64) -> Story {
    flight(kind, 45.0)
        .streams(PILOT, 45.0, 70.0, PilotCommand::Run(Demanded::Throttle(500)))
        .wire(45.0, until, LOW)
        .wire(until, 70.0, HALF)
        .turbine(45.0, 70.0, Phase::Running, 80_000.0, 500.0)
}

/// In the time to `excused` a low demand is no finding, and 1.5 s later it is one.
#[track_caller]
fn excused_until(kind: Kind, excused: f64, change: impl Fn(&mut History)) {
    assert!(!low_until(kind, excused).with(&change).finds(RULE), "low until {excused} s");
    assert!(low_until(kind, excused + 1.5).with(&change).finds(RULE), "low for 1.5 s longer");
}

fn resets(cause: Cause) -> impl Fn(&mut History) {
    move |h| h.resets.push(Reset { down: 45 * SECOND, up: 45 * SECOND + 50 * MS, cause })
}

#[test]
fn without_an_excuse_a_second_is_too_long() {
    excused_until(ZK5, 45.9, |_| {});
}

/// It listens for 1 s, two reports confirm the engine within 1.3 s, and the demand rises by 30 % within 1.3 s.
#[test]
fn a_reset_excuses_its_doubt_and_the_rise_after_it() {
    excused_until(ZK5, 49.3, resets(Cause::Watchdog));
    // A longer listening time excuses more.
    let listens = |h: &mut History| {
        resets(Cause::Watchdog)(h);
        h.rules.listen = 3 * SECOND;
    };
    excused_until(ZK5, 51.3, listens);
    // So does a demand that has to rise further, from idle: within 1.7 s.
    let idles = |h: &mut History| {
        resets(Cause::Watchdog)(h);
        let low = h.frames.iter_mut().filter(|frame| frame.sent == LOW);
        low.for_each(|frame| frame.sent = IDLE);
    };
    excused_until(ZK5, 49.7, idles);
    // Without its source in the memory that one has to take over.
    excused_until(ZK5, 54.9, resets(Cause::PowerOn));
    excused_until(ZK5, 54.9, resets(Cause::BrownOut));
}

#[test]
fn a_gap_excuses_its_doubt_and_the_rise_after_it() {
    let mute = |ms: u64| move |h: &mut History| h.mute = Spans::from(&[(45 * SECOND, 45 * SECOND + ms * MS)]);
    excused_until(ZK5, 49.3, mute(1000));
    // Two frames are no gap.
    excused_until(ZK5, 45.9, mute(90));
}

/// 905001026: after a reset the source that was in control has its demand again at once. Another one, which commands for the first time
/// in the doubt after it, takes over first.
#[test]
fn a_source_that_takes_over_after_a_reset_has_its_time() {
    let full = PilotCommand::Run(Demanded::Throttle(900));
    let story = |from: f64, until: f64| {
        flight(ZK5, 45.0)
            .streams(PILOT, 45.0, 70.0, PilotCommand::Run(Demanded::Throttle(500)))
            .streams(0, from, 70.0, full)
            .wire(45.0, until, HALF)
            .wire(until, 70.0, Sent::Full(Switch::Run, 900))
            .turbine(45.0, 70.0, Phase::Running, 80_000.0, 500.0)
            .with(resets(Cause::Watchdog))
    };
    // 7 s for it and the rise, after the first second of its stream.
    assert!(!story(46.0, 53.9).finds(RULE));
    assert!(story(46.0, 55.4).finds(RULE));
}

/// 905000637, 905000829, 906000299, 906000317: reports of an engine at rest that no ECU sent, with true ones between them.
#[test]
fn a_report_that_does_not_fit_excuses_its_doubt_and_the_rise_after_it() {
    let forged = |fits: bool, count: u64| {
        move |h: &mut History| {
            h.forged = (0..count).map(|report| 45 * SECOND + report * 500 * MS).collect();
            h.noise = Spans::from(&h.forged.iter().map(|at| (*at, at + MS)).collect::<Vec<_>>());
            h.unfit = if fits { Vec::new() } else { h.forged.clone() };
        }
    };
    // Two reports after the last one confirm the engine: 1.3 s on ZK, 0.8 s on AMT.
    excused_until(ZK5, 48.4, forged(false, 1));
    excused_until(ZK5, 49.9, forged(false, 4));
    excused_until(AMT, 48.4, forged(false, 2));
    // What fits, and is wrong otherwise, is no doubt.
    excused_until(ZK5, 45.9, forged(true, 4));
}

#[test]
fn a_transmitter_that_hangs_excuses_the_rise_after_it() {
    let hangs = |h: &mut History| {
        h.deaf = Spans::from(&[(45 * SECOND, 46 * SECOND)]);
        h.stalls = vec![46 * SECOND];
    };
    excused_until(ZK5, 48.0, hangs);
}

/// Error sets with a steady, hot exhaust show an engine that burns: they are answered with the demand.
#[test]
fn error_sets_excuse_nothing_while_the_exhaust_burns() {
    let faults = |egt: f64, falls: f64| {
        move |h: &mut History| {
            let sets = h.samples.iter_mut().filter(|sample| (45 * SECOND..55 * SECOND).contains(&sample.at));
            sets.for_each(|sample| {
                sample.fault = true;
                sample.egt = egt - falls * (sample.at - 45 * SECOND) as f64 / SECOND as f64;
            });
        }
    };
    excused_until(AMT, 45.9, faults(500.0, 0.0));
    // One that is cold, or falls, excuses all of them, two reports and the rise: 0.8 s and 1.3 s.
    excused_until(AMT, 57.8, faults(290.0, 0.0));
    excused_until(AMT, 57.8, faults(500.0, 5.0));
    // So does one that is not known, or a gap in them.
    let with = |change: fn(&mut History)| {
        move |h: &mut History| {
            faults(500.0, 0.0)(h);
            change(h);
        }
    };
    excused_until(AMT, 57.8, with(|h| h.sensor = Spans::from(&[(45 * SECOND, 46 * SECOND)])));
    excused_until(AMT, 57.8, with(|h| h.mute = Spans::from(&[(45 * SECOND, 45_500 * MS)])));
}

/// Damage is an exemption with a share, only where frames can be missing: not on the way to the ECU, and not where it keeps the beat.
#[test]
fn damage_is_an_exemption_where_frames_may_be_missing() {
    const NAME: &str = "HeldDown: noise, and the rise after it";
    let damage = |garbled: bool, framing: bool| {
        move |h: &mut History| {
            h.noise = Spans::from(&[(45 * SECOND, 47 * SECOND)]);
            h.garbled = if garbled { h.noise.clone() } else { Spans::default() };
            h.framing = if framing { h.noise.clone() } else { Spans::default() };
        }
    };
    excused_until(ZK5, 50.3, damage(true, false));
    excused_until(ZK5, 45.9, damage(false, false));
    excused_until(ZK5, 45.9, damage(false, true));
    excused_until(ZK5, 45.9, damage(true, true));
    let share = |change: &dyn Fn(&mut History)| {
        let verdict = low_until(ZK5, 45.0).with(change).judged();
        verdict.healthy.exempt.get(NAME).map_or(0, |time| time / (100 * MS))
    };
    // 2 s, 1.3 s for two reports, and 0.7 s, because nothing has to rise.
    assert_eq!(share(&damage(true, false)), 40);
    assert_eq!(share(&damage(true, true)), 0);
    assert_eq!(share(&resets(Cause::Watchdog)), 0);
    // Where no byte is whole three frames are missing, and that is a gap.
    let ruined = |h: &mut History| {
        damage(true, false)(h);
        h.ruined = h.noise.clone();
    };
    excused_until(ZK5, 50.3, ruined);
    assert_eq!(share(&ruined), 0);
    // What keeps the beat is none for 10 s: the demand may be low from then on.
    let long = |low: f64| {
        flight(ZK5, low)
            .streams(PILOT, low, 70.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(low, 59.0, LOW)
            .wire(59.0, 70.0, HALF)
            .turbine(low, 70.0, Phase::Running, 80_000.0, 500.0)
            .with(|h| {
                h.framing = Spans::from(&[(45 * SECOND, 57 * SECOND)]);
                h.noise = h.framing.clone();
            })
    };
    assert!(!long(54.8).finds(RULE));
    assert!(long(53.0).finds(RULE));
}

/// A governor brings the shaft to the commanded speed, or gives all the throttle that it may.
#[test]
fn a_governor_does_not_hold_the_shaft_below_its_speed() {
    let story = |shaft: f64, authority: u32| {
        flight(Kind::Zk(3), 31.1)
            .streams(PILOT, 31.1, 70.0, PilotCommand::Run(Demanded::Rpm(120_000)))
            .wire(31.1, 70.0, HALF)
            .turbine(31.1, 70.0, Phase::Running, shaft, 500.0)
            .with(move |h| (h.rules.governor, h.rules.authority) = (true, authority))
    };
    assert!(story(100_000.0, 1000).finds(RULE));
    assert!(!story(115_000.0, 1000).finds(RULE));
    assert!(!story(100_000.0, 510).finds(RULE));
}

/// 905000626, 905001007: a governor gives idle without a speed, and has 8 s for its shaft from the next ones on.
#[test]
fn a_governor_without_speeds_has_its_time_after_them() {
    let story = |kind: Kind, until: f64, change: &dyn Fn(&mut History)| {
        flight(kind, 31.1)
            .streams(PILOT, 31.1, 70.0, PilotCommand::Run(Demanded::Rpm(120_000)))
            .wire(31.1, 70.0, HALF)
            .turbine(31.1, 45.0, Phase::Running, 115_000.0, 500.0)
            .turbine(45.0, until, Phase::Running, 100_000.0, 500.0)
            .turbine(until, 70.0, Phase::Running, 115_000.0, 500.0)
            .with(|h| h.rules.governor = true)
            .with(change)
            .finds(RULE)
    };
    let excused_until = |kind: Kind, excused: f64, change: &dyn Fn(&mut History)| {
        assert!(!story(kind, excused, change), "low until {excused} s");
        assert!(story(kind, excused + 1.5, change), "low for 1.5 s longer");
    };
    let framing = |ms: u64| {
        move |h: &mut History| {
            h.framing = Spans::from(&[(45 * SECOND, 45 * SECOND + ms * MS)]);
            h.noise = h.framing.clone();
        }
    };
    let errors = |ms: u64| {
        move |h: &mut History| {
            let sets = h
                .samples
                .iter_mut()
                .filter(|sample| (45 * SECOND..45 * SECOND + ms * MS).contains(&sample.at));
            sets.for_each(|sample| sample.fault = true);
        }
    };
    excused_until(Kind::Zk(3), 52.9, &|_| {});
    // 1.3 s until two reports have come, 0.8 s on AMT.
    excused_until(Kind::Zk(3), 56.2, &framing(2000));
    excused_until(AMT, 54.7, &errors(1000));
    // Too short for a speed to become old.
    excused_until(Kind::Zk(3), 52.9, &framing(400));
    excused_until(AMT, 52.9, &errors(200));
    // It excuses nothing where the ECU holds a throttle.
    assert!(low_until(Kind::Zk(3), 47.0).with(framing(2000)).finds(RULE));
}
