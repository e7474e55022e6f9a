//! Histories by hand for the judge's rules: what has to be on the wire at once.

use super::*;

fn run(tenths: u32) -> PilotCommand {
    PilotCommand::Run(Demanded::Throttle(tenths))
}

fn sent(tenths: u32) -> Sent {
    Sent::Full(Switch::Run, tenths)
}

#[test]
fn ctf_is_on_the_wire_at_once() {
    let story = |last: Sent| {
        flight(AMT, 45.0)
            .with(|h| h.frames.retain(|frame| frame.at < 42 * SECOND))
            .once(PILOT, 42.0, PilotCommand::Ctf)
            .wire(42.0, 45.0, last)
    };
    story(Sent::Ctf).passes();
    story(HALF).breaks(&[Rule::Obeyed]);
    // With another source in control, or in noise, it need not be.
    story(HALF).with(|h| h.noise = Spans::from(&[(41 * SECOND, 42_100 * MS)])).passes();
    assert!(!story(HALF).streams(0, 38.0, 45.0, run(500)).finds(Rule::Obeyed));
    // Nor while another one may still be in control (833000047).
    let another = |age: u64| {
        let soon = |h: &mut History| {
            (h.rules.recover_after, h.rules.takeover, h.rules.ages[0]) = (500 * MS, 0, age);
        };
        story(HALF).with(soon).streams(0, 30.0, 38.4, run(500))
    };
    assert!(!another(3 * SECOND).finds(Rule::Obeyed));
    assert!(another(500 * MS).finds(Rule::Obeyed));
}

#[test]
fn a_reply_ends_within_30_ms_of_its_set() {
    let story = |after: u64| {
        flight(AMT, 40.0).with(|h| {
            h.rules.frame = 20_800;
            h.sets = h.frames.iter().map(|frame| frame.at - after).collect();
        })
    };
    story(9 * MS).passes();
    story(10 * MS).breaks(&[Rule::Frame]);
    story(10 * MS).with(|h| h.noise = Spans::from(&[(0, 40 * SECOND)])).passes();
}

#[test]
fn a_demand_does_not_rise_before_a_set_has_confirmed_the_engine() {
    let story = |tenths: u32, shows: u64| {
        flight(AMT, 40.0)
            .streams(PILOT, 40.0, 50.0, run(800))
            .turbine(40.0, 50.0, Phase::Running, 100_000.0, 500.0)
            .wire(41.0, 43.0, sent(tenths))
            .with(move |h| {
                h.mute = Spans::from(&[(40 * SECOND, 41 * SECOND)]);
                let hidden = h.samples.iter_mut().filter(|s| s.at >= 40 * SECOND && s.at < shows * SECOND);
                hidden.for_each(|sample| sample.hidden = true);
            })
    };
    let rate = |story: Story| story.finds(Rule::Rate);
    assert!(!rate(story(500, 43)) && rate(story(520, 43)));
    // The first reply is unchanged; with a second set that confirms the engine, the demand rises.
    let confirmed = |h: &mut History| h.frames.retain(|f| !(41 * SECOND..41_200 * MS).contains(&f.at));
    assert!(rate(story(520, 40)) && !rate(story(520, 40).with(confirmed)));
    // Bytes without a pause may form a set that puts the engine in doubt a moment after a reply (500000402).
    assert!(!rate(story(520, 43).with(|h| h.garbled = Spans::from(&[(40 * SECOND, 41 * SECOND)]))));
    // The engine went out in the gap, and a start follows (700000460).
    let ends = |at: u64| {
        let second = at * SECOND..(at + 1) * SECOND;
        story(520, 43).with(move |h| {
            let frames = h.frames.iter_mut().filter(|frame| second.contains(&frame.at));
            frames.for_each(|frame| frame.sent = STANDBY);
        })
    };
    let in_doubt = |story: Story| story.says("no set has confirmed");
    assert!(!in_doubt(ends(41)) && in_doubt(ends(42)));
}

#[test]
fn damaged_frames_that_keep_the_beat_are_not_a_gap_in_flight() {
    let story = |last: Sent, framing: bool| {
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 50.0, run(500))
            .turbine(40.0, 50.0, Phase::Running, 100_000.0, 500.0)
            .wire(40.0, 44.0, HALF)
            .wire(44.0, 44.5, last)
            .wire(44.5, 50.0, HALF)
            .with(move |h| {
                h.noise = Spans::from(&[(42 * SECOND, 48 * SECOND)]);
                h.framing = if framing { h.noise.clone() } else { Spans::default() };
            })
    };
    story(HALF, true).passes();
    story(Sent::Nothing, true).breaks(&[Rule::HeldDown]);
    story(Sent::Nothing, false).passes();
    // An rpm that is commanded among them waits for the ECU's version (600000579).
    let rpm = |at: f64| {
        let story = story(Sent::Nothing, true).once(PILOT, at, PilotCommand::Run(Demanded::Rpm(90_000)));
        story.finds(Rule::HeldDown)
    };
    assert_eq!([43.9, 49.9].map(rpm), [false, true]);
}

#[test]
fn a_governor_gives_its_throttle_again_after_a_reset() {
    let limited = |then: Sent, resets: &[u64], limit_egt| {
        started(AMT)
            .streams(PILOT, 31.0, 60.0, PilotCommand::Run(Demanded::Rpm(100_000)))
            .turbine(RUNS as f64, 60.0, Phase::Running, 100_000.0, 500.0)
            .ramp(31.0, 0, 400)
            .wire(33.0, 50.0, sent(400))
            .wire(50.1, 51.0, then)
            .wire(51.0, 60.0, sent(400))
            .with(|h| {
                (h.rules.governor, h.rules.limit_egt) = (true, limit_egt);
                let reset = |up: &u64| Reset { down: (up - 50) * MS, up: up * MS, cause: Cause::Watchdog };
                h.resets = resets.iter().map(reset).collect();
            })
            .finds(Rule::HeldDown)
    };
    let story = |then: Sent, resets: &[u64]| limited(then, resets, None);
    assert!(!story(sent(380), &[50_050]));
    assert!(story(IDLE, &[50_050]));
    assert!(!story(IDLE, &[49_000, 50_050]), "it may not have known");
    // A limit lowers it (810001006).
    let limited = |egt: f64| limited(IDLE, &[50_050], Some((egt, false)));
    assert!(!limited(505.0) && limited(600.0));
}

#[test]
fn a_governor_gives_idle_without_speeds_and_no_more_to_a_shaft_that_falls() {
    let rpm = PilotCommand::Run(Demanded::Rpm(100_000));
    let governed = |last: Sent| {
        started(AMT)
            .streams(PILOT, 31.0, 60.0, rpm)
            .turbine(RUNS as f64, 60.0, Phase::Running, 100_000.0, 500.0)
            .ramp(31.0, 0, 400)
            .wire(33.0, 50.0, sent(400))
            .wire(50.0, 60.0, last)
            .with(|h| h.rules.governor = true)
    };
    let faults = |h: &mut History| {
        h.samples.iter_mut().filter(|s| s.at >= 49 * SECOND).for_each(|s| s.fault = true);
    };
    governed(IDLE).with(faults).passes();
    governed(sent(400)).passes();
    governed(sent(400)).with(faults).breaks(&[Rule::HeldUp]);
    // A throttle that was commanded meanwhile stays in force: without a speed the next rpm is refused (710001136).
    let meanwhile = |at: f64| governed(sent(400)).with(faults).once(PILOT, at, run(400)).finds(Rule::HeldUp);
    assert_eq!([49.5, 59.8].map(meanwhile), [false, true]);
    let falls = |h: &mut History| {
        for sample in h.samples.iter_mut().filter(|sample| sample.at >= 48 * SECOND) {
            sample.lit = false;
            sample.rpm = 100_000.0 - 8000.0 * (sample.at - 48 * SECOND) as f64 / SECOND as f64;
        }
    };
    let high = |story: Story| story.finds(Rule::HeldUp);
    assert!(!high(governed(sent(400)).with(falls)) && high(governed(sent(450)).with(falls)));
    assert!(!high(governed(sent(450))));
}

#[test]
fn a_source_that_is_close_takes_over_without_a_wait() {
    let story = |wanted: u32, taken: f64| {
        flight(ZK5, 50.0)
            .streams(PILOT, 50.0, 60.0, run(500))
            .streams(0, 50.0, 60.0, run(wanted))
            .wire(50.0, taken, HALF)
            .wire(taken, 60.0, sent(wanted))
            .turbine(50.0, 60.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| h.rules.takeover = 5 * SECOND)
    };
    let late = |story: Story| story.finds(Rule::TakeOver);
    assert!(!late(story(530, 51.1)) && late(story(530, 52.5)));
    // Another one has to wait.
    assert!(!late(story(580, 55.0)));
}

#[test]
fn two_engines_start_one_after_the_other() {
    let story = |other: u64, gap: u64| {
        flight(ZK5, 40.0).with(move |h| {
            h.rules.start_gap = gap * SECOND;
            h.other_starts = vec![other * MS];
        })
    };
    story(1000, 3).passes();
    story(1000, 10).breaks(&[Rule::Ignition]);
    // A later start waits for this one.
    story(5000, 10).passes();
}

#[test]
fn a_transmitter_that_hangs_is_opened_again() {
    let story = |hangs: f64, can: bool| {
        let (from, to) = (micros(40.0), micros(40.0 + hangs));
        flight(ZK5, 60.0).with(move |h| {
            h.frames.retain(|frame| !(from..to).contains(&frame.at));
            h.deaf = Spans::from(&[(from, to)]);
            match can {
                true => h.reopened = Some(vec![to]),
                false => h.stalls = vec![to],
            }
        })
    };
    story(0.4, true).passes();
    assert!(story(0.8, true).says("is not opened again"));
    assert!(!story(0.8, false).says("is not opened again"));
}
