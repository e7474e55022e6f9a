//! Histories by hand for the judge's rules: doubt, and sources that fall silent.

use super::*;
use crate::faults::{Fault, write_down};

#[test]
fn in_doubt_nothing_goes_out_that_could_start_an_engine() {
    let story = |kind, again: f64| {
        flight(kind, 40.0)
            .streams(PILOT, 40.0, 70.0, PilotCommand::Run(Demanded::Throttle(500)))
            .turbine(40.0, 70.0, Phase::Running, 100_000.0, 500.0)
            .wire(40.0, 40.2, HALF)
            .wire(again, 70.0, HALF)
    };
    // Nothing is received from it.
    let cut = |h: &mut History| h.mute = Spans::from(&[(40 * SECOND, 41 * SECOND)]);
    story(ZK5, 41.5).with(cut).passes();
    story(ZK5, 41.1).with(cut).breaks(&[Rule::Doubt]);
    story(ZK5, 40.3).with(cut).breaks(&[Rule::Doubt]);
    // The node was reset.
    let reset = |h: &mut History| {
        h.resets.push(Reset { down: 40_200 * MS, up: 40_500 * MS, cause: Cause::Watchdog });
    };
    story(ZK5, 41.0).with(reset).passes();
    story(ZK5, 40.55).with(reset).breaks(&[Rule::Doubt]);
    // One of version 1 that was plugged in before sends its state more often.
    let other = |h: &mut History| h.versions = vec![(20 * SECOND, 1)];
    story(ZK5, 40.8).with(reset).breaks(&[Rule::Doubt]);
    story(ZK5, 40.8).with(reset).with(other).passes();
    story(ZK5, 40.55).with(reset).with(other).breaks(&[Rule::Doubt]);
    // An AMT ECU reports in one set that it runs.
    story(AMT, 40.55).with(reset).passes();
    // Damaged frames count as frames for 10 s.
    let damaged = |h: &mut History| damage(h, 40 * SECOND, 55 * SECOND);
    let nothing = |from: f64| {
        move |h: &mut History| {
            h.frames.retain(|frame| !(micros(from)..micros(55.6)).contains(&frame.at));
        }
    };
    story(ZK5, 40.2).with(damaged).with(nothing(50.1)).passes();
    story(ZK5, 40.2).with(damaged).with(nothing(52.0)).breaks(&[Rule::Doubt]);
}

/// Error sets without an exhaust that can be read confirm no engine after a gap, nor after a gap and a reset.
#[test]
fn error_sets_after_a_gap_get_no_reply_without_an_exhaust() {
    let story = |again: f64| {
        flight(AMT, 51.0)
            .wire(again, 51.0, HALF)
            .with(|h| {
                let faulty = micros(37.9)..micros(50.0);
                h.samples.iter_mut().for_each(|sample| sample.fault = faulty.contains(&sample.at));
                h.sensor = Spans::from(&[(38 * SECOND, 50 * SECOND)]);
                h.mute = Spans::from(&[(40 * SECOND, 41_500 * MS)]);
                h.frames.retain(|frame| frame.at < 40 * SECOND || frame.at >= micros(again));
            })
            .with(|h| {
                h.resets.push(Reset { down: 41 * SECOND, up: 41_020 * MS, cause: Cause::Watchdog });
            })
    };
    story(50.3).passes();
    story(42.0).breaks(&[Rule::Doubt]);
    // The exhaust shows that it burns.
    story(42.0).with(|h| h.sensor = Spans::default()).passes();
}

#[test]
fn in_doubt_a_speed_continues() {
    let story = |sent: Sent| {
        let mut story = started(ZK5)
            .streams(PILOT, 31.0, 60.0, PilotCommand::Run(Demanded::Rpm(100_000)))
            .turbine(RUNS as f64, 60.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| h.mute = Spans::from(&[(45 * SECOND, 55 * SECOND)]))
            .with(|h| h.frames.retain(|frame| frame.at < 31 * SECOND));
        for slot in 0..290_u64 {
            let at = 31.0 + slot as f64 * 0.1;
            let doubt = (45.2..56.0).contains(&at);
            let mode = if doubt { Sent::Nothing } else { Sent::Mode(Some(Switch::Run), 4) };
            story = story.wire(at, at + 0.01, if doubt { sent } else { Sent::Rpm(100_000) });
            story = story.wire(at + 0.05, at + 0.06, mode);
        }
        story
    };
    story(Sent::Rpm(100_000)).passes();
    story(Sent::Nothing).breaks(&[Rule::HeldDown]);
    // Not behind a standby, which is judged as one (846000649).
    story(STANDBY).breaks_beside(&[Rule::ShutDown, Rule::Doubt], &[]);
}

#[test]
fn with_all_sources_silent_the_demand_goes_to_the_fail_safe() {
    let silent = |falls: bool| {
        let story = flight(ZK5, 40.0).turbine(46.0, 60.0, Phase::Running, 52_000.0, 480.0);
        let story = story.turbine(40.0, 46.0, Phase::Running, 80_000.0, 480.0);
        match falls {
            true => story.wire(40.0, 41.5, HALF).ramp(41.5, 500, 0).wire(42.6, 60.0, IDLE),
            false => story.wire(40.0, 60.0, HALF),
        }
    };
    silent(true).passes();
    silent(false).breaks(&[Rule::SilentWire]);
    // A turbine that comes up in the silence, with the throttle of its start, has a time to obey.
    let starting = |fast_until: f64| {
        silent(true)
            .turbine(40.0, 50.0, Phase::FuelRamp, 20_000.0, 480.0)
            .turbine(50.0, fast_until, Phase::Running, 80_000.0, 480.0)
            .turbine(fast_until, 60.0, Phase::Running, 52_000.0, 480.0)
    };
    starting(56.0).passes();
    starting(59.0).breaks(&[Rule::SilentTurbine]);
}

/// After three resets without a source the fail-safe stage counts from the silence on, also where they are over (814001700).
#[test]
fn after_three_resets_in_a_silence_an_engine_that_is_not_received_is_shut_down_after_10_s() {
    let story = |resets: u64, cut: bool, ends: f64| {
        let story = flight(ZK5, 40.0).turbine(40.0, 65.0, Phase::Running, 100_000.0, 500.0);
        let story = story.with(|h| {
            h.rules.hold = 8 * SECOND;
            let reset = |i: u64| 40_200 * MS + i * 700 * MS;
            let reset = |i| Reset { down: reset(i), up: reset(i) + 20 * MS, cause: Cause::Watchdog };
            h.resets.extend((0..resets).map(reset));
            if cut {
                h.mute = Spans::from(&[(41 * SECOND, 65 * SECOND)]);
            }
        });
        story.wire(40.0, ends, HALF).wire(ends, 60.0, STANDBY).finds(Rule::ShutDown)
    };
    assert_eq!([story(3, true, 50.3), story(3, true, 48.0)], [false, true]);
    assert_eq!([story(2, true, 50.3), story(3, false, 50.3)], [true, true]);
}

#[test]
fn with_all_sources_silent_a_start_ends() {
    let story = |ends: f64| {
        ready(ZK5)
            .streams(PILOT, 4.0, 6.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(4.0, ends, IDLE)
            .wire(ends, 40.0, STANDBY)
            .mark(5.0, Mark::Ignition)
            .turbine(5.0, ends + 0.1, Phase::FuelRamp, 20_000.0, 400.0)
            .turbine(ends + 0.1, 40.0, Phase::Cooling, 5000.0, 300.0)
    };
    story(17.5).passes();
    story(25.0).breaks(&[Rule::SilentWire]);
}

#[test]
fn resets_do_not_keep_a_lost_demand_alive() {
    // Every 1.5 s a reset, and half throttle between them.
    let story = |until: u64, power_on_at: u64| {
        let mut story = flight(ZK5, 40.0);
        let mut at = 40_000;
        while at < 58_000 {
            let from = at as f64 / 1000.0;
            let sent = if at < until * 1000 { HALF } else { IDLE };
            story = story.wire(from + 0.75, from + 1.5, sent).with(|h| {
                let cause = if at == power_on_at { Cause::PowerOn } else { Cause::Watchdog };
                let reset = Reset { down: at * MS, up: (at + 300) * MS, cause };
                h.resets.push(reset);
            });
            at += 1500;
        }
        story.turbine(40.0, 50.0, Phase::Running, 100_000.0, 480.0).turbine(
            50.0,
            60.0,
            Phase::Running,
            52_000.0,
            480.0,
        )
    };
    story(44, 0).passes();
    story(60, 0).breaks(&[Rule::SilentWire]);
    // Without memory the earlier resets do not count.
    let is_silent = |until, power_on_at| {
        // That the third of them brings the fail-safe at once is another rule.
        let findings = story(until, power_on_at).judged().findings;
        findings.iter().any(|it| it.rule == Rule::SilentWire && !it.text.contains("fourth reset"))
    };
    assert!(is_silent(51, 0) && !is_silent(51, 44_500) && is_silent(58, 44_500));
    // Nor where the demand was at the fail-safe by then (858000417).
    assert!(!is_silent(51, 46_000) && is_silent(58, 46_000));
}

/// A node without memory begins with the demand that its ECU obeys, the last one that reached it.
#[test]
fn a_node_that_loses_its_memory_late_begins_the_stages_with_what_it_finds() {
    let story = |arrived: bool, cause| {
        flight(ZK5, 40.0)
            .with(|h| h.mute = Spans::from(&[(39 * SECOND, 50 * SECOND)]))
            .wire(40.0, 41.5, if arrived { IDLE } else { Sent::Nothing })
            .wire(41.5, 51.0, Sent::Nothing)
            .with(|h| h.resets.push(Reset { down: 51 * SECOND, up: 51_500 * MS, cause }))
            .wire(52.5, 54.0, HALF)
            .ramp(54.0, 500, 0)
            .wire(55.1, 70.0, IDLE)
            .turbine(40.0, 55.0, Phase::Running, 100_000.0, 500.0)
            .turbine(55.0, 70.0, Phase::Running, 50_000.0, 500.0)
    };
    story(false, Cause::PowerOn).breaks_beside(&[Rule::Doubt], &[]);
    story(false, Cause::Watchdog).breaks_beside(&[Rule::Doubt], &[Rule::SilentWire]);
    story(true, Cause::PowerOn).breaks_beside(&[Rule::Doubt], &[Rule::SilentWire]);
}

#[test]
fn with_all_sources_silent_a_demand_that_does_not_reach_the_engine_ends_in_standby() {
    let story = |standby: bool| {
        let story = flight(ZK5, 40.0)
            .with(|h| h.mute = Spans::from(&[(39_800 * MS, 90 * SECOND)]))
            .wire(40.0, 52.0, Sent::Nothing)
            .wire(52.0, 90.0, if standby { STANDBY } else { Sent::Nothing })
            .turbine(40.0, 52.0, Phase::Running, 100_000.0, 500.0);
        match standby {
            true => story.turbine(52.0, 90.0, Phase::Cooling, 5000.0, 200.0),
            false => story.turbine(52.0, 90.0, Phase::Running, 100_000.0, 500.0),
        }
    };
    story(true).passes();
    story(false).breaks(&[Rule::SilentWire, Rule::SilentTurbine]);
}

/// How long all have been silent is retained over a brown-out, but not over a power-on.
#[test]
fn silence_before_a_brown_out_counts() {
    let story = |cause, standby: f64| {
        flight(ZK5, 40.0)
            .with(|h| h.mute = Spans::from(&[(39_800 * MS, 90 * SECOND)]))
            .with(|h| h.resets.push(Reset { down: 46 * SECOND, up: 46_030 * MS, cause }))
            .wire(40.0, standby, Sent::Nothing)
            .wire(standby, 90.0, STANDBY)
            .turbine(40.0, standby, Phase::Running, 100_000.0, 500.0)
            .turbine(standby, 90.0, Phase::Cooling, 5000.0, 200.0)
    };
    story(Cause::BrownOut, 52.0).passes();
    story(Cause::PowerOn, 58.0).passes();
    story(Cause::BrownOut, 58.0).breaks(&[Rule::SilentWire]);
}

/// A source that was lost stays lost after a reset: it has to be received for a while before the demand rises.
#[test]
fn a_lost_source_stays_lost_over_a_reset() {
    let story = |cause, rises: f64| {
        flight(ZK5, 40.0)
            .wire(40.0, 41.5, HALF)
            .ramp(41.5, 500, 0)
            .wire(42.6, 43.0, IDLE)
            .with(|h| h.resets.push(Reset { down: 43 * SECOND, up: 43_020 * MS, cause }))
            .streams(PILOT, 43.3, 50.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(43.45, rises, IDLE)
            .ramp(rises, 0, 500)
            .wire(rises + 1.1, 50.0, HALF)
            .turbine(40.0, 50.0, Phase::Running, 60_000.0, 480.0)
    };
    story(Cause::Watchdog, 44.4).passes();
    story(Cause::Watchdog, 43.5).breaks(&[Rule::SilentWire]);
    // Nothing says who was lost.
    story(Cause::BrownOut, 43.5).passes();
    // With other settings it may be received for a shorter time.
    story(Cause::Watchdog, 43.5).with(|h| h.other_settings.push(43_020 * MS)).passes();
}

/// With the wire to the ECU cut, standby is not obeyed. A node that has lost its memory continues with the throttle that it finds.
#[test]
fn a_node_without_memory_resumes_with_the_throttle_that_it_finds() {
    let story = |cause, tenths, arrived| {
        flight(ZK5, 40.0)
            .once(PILOT, 40.0, PilotCommand::ShutDown)
            .wire(40.05, 42.0, STANDBY)
            .wire(42.6, 46.0, Sent::Full(Switch::Run, tenths))
            .turbine(40.0, 46.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| {
                h.resets.push(Reset { down: 42 * SECOND, up: 42_500 * MS, cause });
                h.deaf = Spans::from(&[(40 * SECOND, 50 * SECOND)]);
                for frame in h.frames.iter_mut().filter(|frame| frame.at > 40_050 * MS) {
                    frame.arrived = arrived;
                }
            })
    };
    story(Cause::PowerOn, 500, false).breaks_beside(&[Rule::Doubt], &[]);
    story(Cause::PowerOn, 800, false).breaks_beside(&[Rule::Doubt], &[Rule::Rate]);
    story(Cause::Watchdog, 500, false).breaks_beside(&[Rule::Doubt], &[Rule::Obeyed, Rule::Rate]);
    story(Cause::PowerOn, 500, true).breaks_beside(&[Rule::Doubt], &[Rule::Rate]);
    // A throttle that has come to an ECU which holds a speed is not obeyed before the ID 6 that ends that. The throttle that it
    // reports is that of the speed.
    let speed = |mode: bool| {
        flight(ZK5, 40.0)
            .with(|h| h.frames.retain(|frame| frame.at < 39 * SECOND))
            .streams(PILOT, 39.0, 40.0, PilotCommand::Run(Demanded::Rpm(140_000)))
            .wire(39.0, 39.01, Sent::Mode(Some(Switch::Run), 4))
            .wire(39.05, 40.0, Sent::Rpm(140_000))
            .streams(PILOT, 40.0, 45.0, PilotCommand::Run(Demanded::Throttle(200)))
            .wire(40.0, 40.04, Sent::Full(Switch::Run, 200))
            .wire(40.05, 40.06, if mode { Sent::Mode(Some(Switch::Run), 0) } else { Sent::Nothing })
            .wire(40.1, 40.14, if mode { Sent::Full(Switch::Run, 200) } else { Sent::Nothing })
            .wire(40.7, 41.0, Sent::Full(Switch::Run, 700))
            .wire(41.0, 45.0, Sent::Full(Switch::Run, 200))
            .turbine(40.0, 45.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| h.resets.push(Reset { down: 40_150 * MS, up: 40_250 * MS, cause: Cause::PowerOn }))
    };
    speed(false).breaks_beside(&[Rule::Doubt], &[]);
    speed(true).breaks_beside(&[Rule::Doubt], &[Rule::Rate]);
}

#[test]
fn silence_shuts_an_engine_down_only_where_that_is_configured() {
    let story = || {
        flight(ZK5, 40.0)
            .wire(40.0, 41.5, HALF)
            .ramp(41.5, 500, 0)
            .wire(42.6, 46.0, IDLE)
            .wire(46.0, 60.0, STANDBY)
            .turbine(40.0, 46.1, Phase::Running, 60_000.0, 480.0)
            .turbine(46.1, 60.0, Phase::Cooling, 5000.0, 300.0)
    };
    story().breaks(&[Rule::ShutDown]);
    story().with(|h| h.rules.standby_after = Some(4 * SECOND)).passes();
    // A source that is present and commands nothing is silent from then on, and not from a timeout later.
    let late = |h: &mut History| {
        h.rules.standby_after = Some(5 * SECOND);
        h.rules.ages = [SECOND; 4];
    };
    story().with(late).breaks(&[Rule::ShutDown]);
    story().with(late).streams(PILOT, 40.0, 60.0, PilotCommand::Nothing).passes();
}

/// A gap of exactly its timeout is one, also in the stream of the source that started the engine (876000077).
#[test]
fn a_source_that_commands_once_in_its_timeout_is_lost() {
    let story = |every: u64| {
        let mut story = started(ZK5)
            .wire(31.0, 36.05, IDLE)
            .wire(36.05, 45.0, STANDBY)
            .turbine(RUNS as f64, 36.1, Phase::Running, 50_000.0, 480.0)
            .turbine(36.1, 45.0, Phase::Cooling, 5000.0, 300.0)
            .with(|h| h.rules.standby_after = Some(3 * SECOND));
        for at in (30_900..45_000).step_by(every as usize).skip(1) {
            story = story.once(PILOT, at as f64 / 1000.0, PilotCommand::Run(Demanded::Throttle(0)));
        }
        story
    };
    story(500).passes();
    story(490).breaks(&[Rule::ShutDown]);
}

/// A source that starts an engine is in control at once: its silence counts from its last command, however soon
/// that was.
#[test]
fn who_starts_an_engine_is_in_control_at_once() {
    let story = |silent, standby_after| {
        ready(ZK5)
            .streams(PILOT, 4.0, silent, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(4.0, 26.0, IDLE)
            .mark(5.0, Mark::Ignition)
            .turbine(5.0, 20.0, Phase::FuelRamp, 20_000.0, 400.0)
            .turbine(20.0, 26.1, Phase::Running, 50_000.0, 500.0)
            // Back, but not yet received for long enough.
            .streams(PILOT, 25.5, 40.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(26.0, 40.0, STANDBY)
            .turbine(26.1, 40.0, Phase::Cooling, 5000.0, 300.0)
            .with(move |h| (h.rules.standby_after, h.rules.takeover) = (standby_after, 4 * SECOND))
    };
    // Silent as soon as it had started (811000831).
    for silent in [7.0, 4.6] {
        story(silent, Some(17_500 * MS)).passes();
        story(silent, Some(30 * SECOND)).breaks(&[Rule::ShutDown]);
    }
}

/// The source that started the engine waits to take over from a higher one that was lost, and is silent before it has: the stages of loss are the
/// higher one's (834001076).
#[test]
fn the_source_of_the_start_is_not_in_control_once_a_higher_one_has_been() {
    let story = |higher: bool, standby: f64| {
        let mut story = flight(ZK5, 43.0)
            .wire(43.0, standby, HALF)
            .wire(standby, 60.0, STANDBY)
            .turbine(43.0, 60.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| (h.rules.standby_after, h.rules.takeover) = (Some(10 * SECOND), 5 * SECOND));
        if higher {
            story = story.streams(0, 32.0, 40.0, PilotCommand::Run(Demanded::Throttle(500)));
        }
        story.finds(Rule::ShutDown)
    };
    assert_eq!([story(true, 51.6), story(true, 49.0)], [false, true]);
    assert_eq!([story(false, 54.6), story(false, 51.6)], [false, true]);
}

/// With error sets only, and a broken thermocouple, nothing shows that an AMT engine runs: in silence its order ends.
#[test]
fn in_silence_an_engine_that_nothing_shows_is_shut_down() {
    let since = |from: u64, broken: bool| {
        flight(AMT, 40.0)
            .wire(40.0, 41.5, HALF)
            .ramp(41.5, 500, 0)
            .wire(42.6, 60.0, IDLE)
            .wire(60.0, 70.0, STANDBY)
            .turbine(40.0, 60.1, Phase::Running, 52_000.0, 480.0)
            .turbine(60.1, 70.0, Phase::Cooling, 5000.0, 300.0)
            .with(move |h| {
                h.samples
                    .iter_mut()
                    .filter(|sample| sample.at >= from * SECOND)
                    .for_each(|sample| sample.fault = true);
                if broken {
                    h.sensor = Spans::from(&[(57 * SECOND, 70 * SECOND)]);
                }
            })
    };
    let story = |broken| since(57, broken);
    story(true).passes();
    story(false).breaks(&[Rule::ShutDown]);
    // After a reset it is in doubt until a set reports that it runs: an error set does not.
    let reset = |from: u64| {
        let again = |h: &mut History| {
            h.resets.push(Reset { down: 38_990 * MS, up: 39 * SECOND, cause: Cause::Watchdog });
        };
        since(from, false).with(again)
    };
    reset(38).breaks_beside(&[Rule::Doubt], &[]);
    reset(45).breaks_beside(&[Rule::Doubt], &[Rule::ShutDown]);
    // So it is after a gap.
    let shut_down = |from: u64| {
        let gap = |h: &mut History| h.mute = Spans::from(&[(39 * SECOND, 39_400 * MS)]);
        since(from, false).with(gap).finds(Rule::ShutDown)
    };
    assert!(!shut_down(38) && shut_down(45));
}

/// A transmitter hangs until it continues; a reset of the chip frees it, and the bytes in transit then are lost.
#[test]
fn a_reset_frees_a_transmitter_that_hangs() {
    let written = |up: f64| {
        let mut history = History::new(rules(ZK5));
        history.resets.push(Reset { down: micros(up - 0.1), up: micros(up), cause: Cause::Watchdog });
        write_down(&mut history, Fault::Stall, micros(40.0), micros(41.0));
        (history.deaf.iter().collect::<Vec<_>>(), history.stalls)
    };
    assert_eq!(written(40.4), (vec![(micros(40.0), micros(40.4))], vec![]));
    // Also one that ends in the instant in which it begins to hang.
    for before_or_after in [39.9, 40.0, 41.2] {
        assert_eq!(written(before_or_after), (vec![(micros(40.0), micros(41.0))], vec![micros(41.0)]));
    }
}

/// A lost demand does not rise while its source has to recover. Another source is another matter (840000888), and after a reset in a start whoever
/// comes back is a new one (839000865).
#[test]
fn a_lost_demand_does_not_rise_before_its_source_has_recovered() {
    let run = PilotCommand::Run(Demanded::Throttle(500));
    let lost = || {
        flight(ZK5, 40.0)
            .with(|h| (h.rules.recover_after, h.rules.takeover) = (3 * SECOND, 0))
            .wire(40.0, 41.5, HALF)
            .ramp(41.5, 500, 0)
            .wire(42.6, 45.0, IDLE)
            .streams(PILOT, 44.0, 50.0, run)
            .ramp(45.5, 0, 500)
            .wire(46.6, 50.0, HALF)
    };
    let rises = |other: bool| {
        let story = lost().turbine(40.0, 50.0, Phase::Running, 60_000.0, 500.0);
        let story = if other { story.streams(2, 45.3, 50.0, run) } else { story };
        story.finds(Rule::SilentWire)
    };
    assert_eq!([rises(true), rises(false)], [false, true]);
    let reset_in = |phase: Phase| {
        let reset = Reset { down: micros(43.8), up: micros(43.85), cause: Cause::Watchdog };
        lost()
            .turbine(40.0, 43.7, phase, 60_000.0, 500.0)
            .turbine(43.7, 50.0, Phase::Running, 60_000.0, 500.0)
            .with(|h| h.resets.push(reset))
            .finds(Rule::SilentWire)
    };
    assert_eq!([reset_in(Phase::FuelRamp), reset_in(Phase::Running)], [false, true]);
}

/// With all sources silent, an AMT engine in doubt gets standby when the stages of loss have run out. Error sets raise a doubt that another state than
/// running does not end (845000650).
#[test]
fn after_error_sets_only_running_ends_the_doubt_of_an_engine_without_a_source() {
    let story = |hidden: bool| {
        flight(AMT, 40.0)
            .wire(40.0, 41.5, HALF)
            .ramp(41.5, 500, 0)
            .wire(42.6, 52.5, IDLE)
            .wire(52.5, 54.0, STANDBY)
            .turbine(40.0, 54.0, Phase::Running, 50_000.0, 500.0)
            .with(|h| {
                for sample in h.samples.iter_mut() {
                    sample.fault = (45 * SECOND..50 * SECOND).contains(&sample.at);
                    sample.hidden = hidden && (50 * SECOND..53 * SECOND).contains(&sample.at);
                }
            })
            .finds(Rule::ShutDown)
    };
    assert_eq!([story(true), story(false)], [false, true]);
}

/// Where no standby is configured, a doubt that begins long after the last stage has 2 s.
#[test]
fn a_late_doubt_has_time_to_be_confirmed() {
    let story = |doubt: f64, ends: f64, more_resets: bool| {
        flight(ZK5, 40.0)
            .wire(40.0, ends, IDLE)
            .wire(ends, 70.0, STANDBY)
            .turbine(40.0, 70.0, Phase::Running, 55_000.0, 400.0)
            .with(move |h| {
                let reset =
                    |at: f64| Reset { down: micros(at), up: micros(at + 0.1), cause: Cause::Watchdog };
                h.resets = vec![reset(doubt)];
                if more_resets {
                    h.resets.extend([reset(doubt + 0.4), reset(doubt + 0.8)]);
                }
            })
    };
    let at_once = |story: Story| story.says("at once, and");
    assert!(at_once(story(60.0, 60.5, false)) && !at_once(story(60.0, 62.0, false)));
    assert!(!at_once(story(60.0, 60.95, true)) && !at_once(story(48.0, 48.5, false)));
    // Nor does a node that has lost its order with its power wait (899002338).
    let forgets = |h: &mut History| h.resets[0].cause = Cause::BrownOut;
    assert!(!at_once(story(60.0, 60.5, false).with(forgets)));
    // A configured standby does not wait.
    let configured = story(60.0, 60.5, false).with(|h| h.rules.standby_after = Some(3 * SECOND));
    assert!(!at_once(configured));
}

/// An ECU whose power is back within those 2 s reports that its engine is out, and gets standby then, not before (905000991).
#[test]
fn a_late_doubt_ends_with_the_power_of_the_ecu() {
    let story = |standby: f64, powered: f64, cut: bool| {
        let story = flight(AMT, 40.0)
            .wire(40.0, 60.0, IDLE)
            .turbine(40.0, 60.05, Phase::Running, 55_000.0, 400.0)
            .turbine(60.05, 70.0, Phase::Cooling, 30_000.0, 300.0)
            .wire(standby, 70.0, STANDBY);
        let story = story.with(|h| {
            let out = Spans::from(&[(60 * SECOND, micros(powered))]);
            (h.rules.boot, h.rules.serial_delay) = (30 * MS, 4 * SECOND);
            *if cut { &mut h.mute } else { &mut h.unpowered } = out;
        });
        story.says("at once, and")
    };
    assert!(!story(61.14, 61.1, false) && story(61.0, 61.1, false));
    assert!(story(61.14, 61.1, true) && story(61.14, 62.0, false));
}

/// Where no standby is configured, a source that commands standby below is not silent, in doubt either: it waits for its own time.
#[test]
fn in_doubt_a_lower_source_is_not_silent() {
    let story = |lower: bool, standby: f64| {
        let story = flight(ZK5, 40.0)
            .turbine(40.0, 80.0, Phase::Running, 100_000.0, 500.0)
            .wire(40.0, 40.2, HALF)
            .wire(40.2, standby, Sent::Nothing)
            .wire(standby, 80.0, STANDBY)
            .with(|h| {
                h.rules.lower_standby_after = 25 * SECOND;
                h.mute = Spans::from(&[(40 * SECOND, 80 * SECOND)]);
            });
        let story = if lower { story.streams(3, 38.0, 80.0, PilotCommand::Standby) } else { story };
        story.finds(Rule::ShutDown)
    };
    assert!(story(true, 55.0) && !story(true, 68.0));
    assert!(!story(false, 55.0) && story(false, 45.0));
}
