//! Histories by hand for the judge's rules: a healthy engine in flight.

use super::*;

#[test]
fn an_ordinary_flight_breaks_no_rule() {
    for kind in [AMT, ZK5, Kind::Zk(3)] {
        flight(kind, 60.0)
            .streams(PILOT, 60.0, 70.0, PilotCommand::Standby)
            .wire(60.1, 70.0, STANDBY)
            .turbine(60.0, 70.0, Phase::Cooling, 5000.0, 300.0)
            .passes();
    }
}

/// What was commanded before a reset, and never sent, is not in force after it: the demand rises.
#[test]
fn a_demand_rises_from_the_one_that_was_sent_before_a_reset() {
    let story = |cause, jumps: bool| {
        let full = Sent::Full(Switch::Run, 1000);
        let story = flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 50.0, PilotCommand::Run(Demanded::Throttle(1000)))
            .with(|h| h.resets.push(Reset { down: 40_020 * MS, up: 40_040 * MS, cause }))
            .turbine(40.0, 50.0, Phase::Running, 100_000.0, 500.0);
        match jumps {
            true => story.wire(40.6, 50.0, full),
            false => story.ramp(40.6, 500, 1000).wire(41.7, 50.0, full),
        }
    };
    story(Cause::Watchdog, false).passes();
    story(Cause::Watchdog, true).breaks(&[Rule::Rate]);
    // The memory has no demand.
    story(Cause::BrownOut, true).passes();
}

/// No ECU reports which speed it was demanded: a node that has lost its memory continues with that of the shaft, which may be on its way to a
/// lower one (879001274).
#[test]
fn a_speed_continues_from_that_of_the_shaft_after_a_loss_of_power() {
    let rises = |cause, shaft: f64| {
        let run = |rpm| PilotCommand::Run(Demanded::Rpm(rpm));
        let mode = Sent::Mode(Some(Switch::Run), 4);
        started(ZK5)
            .streams(PILOT, 31.0, 39.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(31.0, 39.0, IDLE)
            .turbine(RUNS as f64, 39.0, Phase::Running, 50_000.0, 500.0)
            .streams(PILOT, 39.0, 40.0, run(60_000))
            .streams(PILOT, 40.0, 42.0, run(140_000))
            .wire(39.0, 39.01, mode)
            .wire(39.05, 40.0, Sent::Rpm(60_000))
            .wire(40.5, 40.51, mode)
            .wire(40.6, 42.0, Sent::Rpm(100_000))
            .turbine(39.0, 42.0, Phase::Running, shaft, 500.0)
            .with(|h| h.rules.slew_up = Some(100))
            .with(|h| h.resets.push(Reset { down: 40_020 * MS, up: 40_040 * MS, cause }))
            .finds(Rule::Rate)
    };
    assert!(!rises(Cause::BrownOut, 105_000.0));
    assert!(rises(Cause::BrownOut, 60_000.0) && rises(Cause::Watchdog, 105_000.0));
}

/// After a gap the demand rises, unless the stick moves when the engine is confirmed already (760003942).
#[test]
fn a_stick_that_moves_in_the_last_slot_of_a_gap_moves_the_demand() {
    let run = |tenths| PilotCommand::Run(Demanded::Throttle(tenths));
    let jumps = |moves: f64, split: bool| {
        let ends = if split { 41.15 } else { 41.2 };
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, moves, run(500))
            .streams(PILOT, moves, 49.0, run(1000))
            .wire(40.0, ends, Sent::Nothing)
            .wire(ends, 41.2, Sent::Mode(Some(Switch::Run), 0))
            .wire(41.2, 50.0, Sent::Full(Switch::Run, 1000))
            .turbine(40.0, 50.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| h.mute = Spans::from(&[(40 * SECOND, 41 * SECOND)]))
            .finds(Rule::Rate)
    };
    assert!(!jumps(41.18, false) && jumps(41.1, false));
    // ID 6 goes first (835000014).
    assert!(!jumps(41.1, true) && jumps(41.0, true));
}

#[test]
fn a_demand_rises_at_a_rate_unless_a_pilot_moves_the_stick() {
    // The stick was up during the start.
    let up = |jumps: bool| {
        let story = started(ZK5)
            .streams(PILOT, 15.0, 40.0, PilotCommand::Run(Demanded::Throttle(800)))
            .turbine(RUNS as f64, 40.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| {
                h.commanded.retain(|commanded| {
                    commanded.at < 15 * SECOND
                        || commanded.command != PilotCommand::Run(Demanded::Throttle(0))
                })
            });
        match jumps {
            true => story.wire(31.0, 40.0, Sent::Full(Switch::Run, 800)),
            false => story.ramp(31.0, 0, 800).wire(32.8, 40.0, Sent::Full(Switch::Run, 800)),
        }
    };
    up(false).passes();
    up(true).breaks(&[Rule::Rate]);
    // A pilot that moves it, with and without a slew.
    let moved = || {
        started(ZK5)
            .streams(PILOT, 31.0, 40.0, PilotCommand::Run(Demanded::Throttle(800)))
            .streams(PILOT, 30.5, 31.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(31.0, 40.0, Sent::Full(Switch::Run, 800))
            .turbine(RUNS as f64, 40.0, Phase::Running, 100_000.0, 500.0)
    };
    moved().passes();
    moved().with(|h| h.rules.slew_up = Some(500)).breaks(&[Rule::Rate]);
}

#[test]
fn a_running_engine_is_shut_down_by_two_commands_or_by_one_of_a_person() {
    let story = |commands: &[(f64, PilotCommand)]| {
        let mut story = flight(ZK5, 40.0)
            .wire(40.3, 45.0, STANDBY)
            .turbine(40.0, 40.5, Phase::Running, 100_000.0, 500.0)
            .turbine(40.5, 45.0, Phase::Cooling, 5000.0, 300.0)
            .wire(40.0, 40.3, HALF);
        for &(at, command) in commands {
            story = story.once(0, at, command);
        }
        story.streams(PILOT, 40.0, 45.0, PilotCommand::Run(Demanded::Throttle(500)))
    };
    story(&[(40.0, PilotCommand::Standby), (40.2, PilotCommand::Standby)]).passes();
    story(&[(40.2, PilotCommand::ShutDown)]).passes();
    // Decided a slot before another command came.
    story(&[
        (40.05, PilotCommand::Standby),
        (40.25, PilotCommand::Standby),
        (40.29, PilotCommand::Run(Demanded::Throttle(0))),
    ])
    .passes();
    story(&[(40.2, PilotCommand::Standby)]).breaks(&[Rule::ShutDown]);
    // One command of a higher source that has yet to take over, and is silent again.
    let command = |at, until| {
        let story = flight(ZK5, 40.0).streams(0, 20.0, at, PilotCommand::Nothing);
        story
            .streams(0, at, until, PilotCommand::Run(Demanded::Throttle(500)))
            .streams(PILOT, 40.0, 45.0, PilotCommand::Standby)
            .wire(40.0, 40.6, HALF)
            .wire(40.6, 45.0, STANDBY)
            .turbine(40.0, 45.0, Phase::Running, 100_000.0, 500.0)
    };
    command(40.0, 40.01).passes();
    command(37.0, 40.01).breaks(&[Rule::ShutDown]);
    story(&[(37.0, PilotCommand::Standby), (40.2, PilotCommand::Standby)]).breaks(&[Rule::ShutDown]);
    story(&[]).breaks(&[Rule::ShutDown]);
}

/// With AMT, standby is the reply to a set: while none arrives, it is in force and waits, whatever is commanded after
/// it.
#[test]
fn a_standby_goes_out_with_the_first_set_after_a_gap() {
    let story = |first: f64| {
        let gap = (39_500 * MS, 40_300 * MS);
        flight(AMT, 40.0)
            .with(|h| {
                h.mute = Spans::from(&[gap]);
                h.frames.retain(|frame| frame.at < gap.0 || frame.at > gap.1);
            })
            .once(0, first, PilotCommand::Standby)
            .once(0, first + 0.2, PilotCommand::Standby)
            .once(0, first + 0.25, PilotCommand::Run(Demanded::Throttle(500)))
            .streams(PILOT, 40.0, 45.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.4, 45.0, STANDBY)
            .turbine(40.0, 40.5, Phase::Running, 100_000.0, 500.0)
            .turbine(40.5, 45.0, Phase::Cooling, 5000.0, 300.0)
    };
    story(39.7).passes();
    // The sets before the gap were answered, and not with standby.
    story(38.5).breaks(&[Rule::ShutDown]);
}

/// A node that is reset repeatedly, each time before two consistent reports, learns nothing new about a start: a disarm
/// ends it.
#[test]
fn a_node_in_a_reset_loop_cannot_know_that_a_start_has_reached_running() {
    let story = |resets_from: u64| {
        let resets = (resets_from * 2..80).map(|half| Reset {
            down: half * SECOND / 2,
            up: half * SECOND / 2 + 20 * MS,
            cause: Cause::Watchdog,
        });
        flight(ZK5, 40.0)
            .once(PILOT, 40.0, PilotCommand::Disarm)
            .wire(40.0, 45.0, STANDBY)
            .turbine(40.0, 45.0, Phase::Running, 60_000.0, 480.0)
            .streams(PILOT, 40.0, 45.0, PilotCommand::Run(Demanded::Throttle(500)))
            .with(|h| h.resets = resets.collect())
    };
    story(29).breaks_beside(&[Rule::Doubt, Rule::Rate], &[]);
    // It ran before the loop for long enough.
    story(34).breaks_beside(&[Rule::Doubt], &[Rule::ShutDown]);
}

#[test]
fn a_lower_sources_standby_waits_for_the_stages_of_loss() {
    let story = |standby: f64| {
        flight(ZK5, 40.0)
            .streams(2, 20.0, 60.0, PilotCommand::Standby)
            .wire(40.0, 41.5, HALF)
            .ramp(41.5, 500, 0)
            .wire(42.6, standby, IDLE)
            .wire(standby, 60.0, STANDBY)
            .turbine(40.0, standby + 0.1, Phase::Running, 60_000.0, 480.0)
            .turbine(standby + 0.1, 60.0, Phase::Cooling, 5000.0, 300.0)
    };
    story(48.0).passes();
    story(43.0).breaks(&[Rule::ShutDown]);
    // A source that has only now commanded for long enough was not in control when the frame was decided.
    let back = |from| story(47.9).streams(PILOT, from, 59.9, PilotCommand::Run(Demanded::Throttle(0)));
    back(44.88).passes();
    back(43.0).breaks(&[Rule::ShutDown]);
}

/// After a loss of power, nothing shows whose demand was in force: the stages of loss begin at the hold with the engine that is
/// found. A watchdog reset does not restart them.
#[test]
fn a_lower_sources_standby_waits_for_the_stages_of_an_engine_that_was_found() {
    let story = |cause: Cause, standby: f64| {
        flight(ZK5, 40.0)
            .streams(2, 20.0, 60.0, PilotCommand::Standby)
            .with(|h| {
                h.rules.ages[PILOT] = 3 * SECOND;
                h.resets.push(Reset { down: 40_100 * MS, up: 40_150 * MS, cause });
                h.rules.hold = 300 * MS;
            })
            .wire(40.0, 40.1, HALF)
            .wire(40.3, 40.8, Sent::Nothing)
            .ramp(40.8, 500, 0)
            .wire(42.0, standby, IDLE)
            .wire(standby, 60.0, STANDBY)
            .turbine(40.0, standby + 0.1, Phase::Running, 60_000.0, 480.0)
            .turbine(standby + 0.1, 60.0, Phase::Cooling, 5000.0, 300.0)
    };
    story(Cause::PowerOn, 45.6).passes();
    story(Cause::PowerOn, 43.5).breaks(&[Rule::ShutDown]);
    story(Cause::Watchdog, 45.6).breaks(&[Rule::ShutDown]);
    story(Cause::Watchdog, 48.4).passes();
}

#[test]
fn an_ecu_does_not_put_out_an_engine_for_want_of_commands() {
    let story = |kind| {
        flight(kind, 40.0)
            .streams(PILOT, 40.0, 45.0, PilotCommand::Run(Demanded::Throttle(500)))
            .mark(40.0, Mark::GivenUp)
            .turbine(40.0, 45.0, Phase::Cooling, 50_000.0, 400.0)
            .wire(40.0, 45.0, STANDBY)
    };
    for kind in [AMT, Kind::Zk(3)] {
        story(kind).breaks(&[Rule::GivenUp]);
        // A wire that is cut is exempt.
        let cut = |h: &mut History| {
            h.deaf = Spans::from(&[(37_500 * MS, 41 * SECOND)]);
            h.frames.retain(|frame| !(37_700 * MS..40 * SECOND).contains(&frame.at));
        };
        story(kind).with(cut).passes();
    }
    // The wire from the ECU alone: up to a set before, the one in which it ends, and a set without a state. The other way a set at
    // either end.
    let cut = |length_ms: u64, mute: bool| {
        story(AMT).with(|h: &mut History| {
            let cut = Spans::from(&[(39_800 * MS - length_ms * MS, 39_800 * MS)]);
            *(if mute { &mut h.mute } else { &mut h.deaf }) = cut;
            h.frames.retain(|frame| !(39_800 * MS - length_ms * MS..40 * SECOND).contains(&frame.at));
        })
    };
    cut(1650, true).breaks_beside(&[Rule::Doubt], &[]);
    cut(1500, true).breaks_beside(&[Rule::Doubt], &[Rule::GivenUp]);
    cut(1650, false).breaks(&[Rule::GivenUp]);
    // Damage on the way to it for as long as it waits is a cut by its effect, and what tolerates a cut tolerates it.
    let damaged = |kind, from: u64| {
        story(kind).with(move |h: &mut History| {
            h.noise_to_ecu = Spans::from(&[(from * MS, 39_900 * MS)]);
            h.noise = h.noise_to_ecu.clone();
        })
    };
    for kind in [AMT, Kind::Zk(3)] {
        damaged(kind, 37_900).breaks_beside(&[Rule::Doubt], &[]);
        damaged(kind, 38_900).breaks_beside(&[Rule::Doubt], &[Rule::GivenUp]);
    }
    damaged(ZK5, 36_900).breaks_beside(&[Rule::Doubt], &[Rule::GivenUp]);
    // It was handed over, and its PWM input is gone.
    let handed_over = |until: u64| move |h: &mut History| h.pwm.push(35 * SECOND, until * MS);
    story(Kind::Zk(3)).with(handed_over(40_100)).passes();
    story(Kind::Zk(3)).with(handed_over(38_900)).breaks(&[Rule::GivenUp]);
    // CTF was commanded, and a node that has lost its memory replies no more (879000114).
    let last = |sent| {
        story(AMT).once(PILOT, 37.8, PilotCommand::Ctf).with(move |h| {
            h.frames.retain(|frame| frame.at < 37_900 * MS || frame.at >= 40 * SECOND);
            let after = h.frames.partition_point(|frame| frame.at < 37_900 * MS);
            h.frames.insert(after, Frame { at: 37_900 * MS, arrived: true, sent });
            h.resets.push(Reset { down: 38 * SECOND, up: 38_040 * MS, cause: Cause::PowerOn });
        })
    };
    assert!(!last(Sent::Ctf).finds(Rule::GivenUp));
    assert!(last(HALF).finds(Rule::GivenUp));
    // A gap of the node that the ECU has to tolerate does not count.
    let reset = |length_ms: u64| {
        let down = 38 * SECOND;
        move |h: &mut History| {
            h.resets.push(Reset { down, up: down + length_ms * MS, cause: Cause::Watchdog })
        }
    };
    [800, 950].into_iter().for_each(|length| story(AMT).with(reset(length)).breaks(&[Rule::GivenUp]));
    [1000, 2100].into_iter().for_each(|length| story(AMT).with(reset(length)).passes());
    // Neither the reset nor the cut that begins in it is as long as the ECU waits; together they are.
    let cut = |from: u64| {
        move |h: &mut History| {
            h.resets.push(Reset { down: 38 * SECOND, up: 38_500 * MS, cause: Cause::Watchdog });
            h.mute = Spans::from(&[(from * MS, 40_100 * MS)]);
            h.deaf = h.mute.clone();
        }
    };
    story(AMT).with(cut(38_300)).breaks_beside(&[Rule::Doubt], &[]);
    story(AMT).with(cut(39_300)).breaks_beside(&[Rule::Doubt], &[Rule::GivenUp]);
    // Damage just before a reset (860000589).
    let damaged = |from: u64| {
        move |h: &mut History| {
            h.resets.push(Reset { down: 39_600 * MS, up: 39_900 * MS, cause: Cause::Watchdog });
            h.noise_to_ecu = Spans::from(&[(from * MS, 39_590 * MS)]);
        }
    };
    story(Kind::Zk(3)).with(damaged(38_100)).breaks_beside(&[Rule::Doubt], &[]);
    story(Kind::Zk(3)).with(damaged(39_580)).breaks_beside(&[Rule::Doubt], &[Rule::GivenUp]);
    // After a loss of power, with error sets only, it is unknown whether it runs. Another reset is no excuse, whatever the
    // exhaust temperature.
    let faults = |h: &mut History| {
        for sample in h.samples.iter_mut().filter(|sample| sample.at >= 37 * SECOND) {
            sample.fault = true;
        }
    };
    let early = |cause| {
        move |h: &mut History| {
            let down = 37_200 * MS;
            h.frames.retain(|frame| frame.at < down);
            h.resets.push(Reset { down, up: down + 50 * MS, cause });
        }
    };
    story(AMT).with(faults).with(early(Cause::PowerOn)).passes();
    // After a gap, error sets get no reply, also where another gap begins just before the ECU gives up (834001021).
    let gaps = |cuts: &'static [(u64, u64)]| {
        move |h: &mut History| {
            h.mute = Spans::from(&cuts.iter().map(|(from, to)| (from * MS, to * MS)).collect::<Vec<_>>());
            h.frames.retain(|frame| frame.at < 37_200 * MS || frame.at >= 40 * SECOND);
        }
    };
    story(AMT).with(faults).with(gaps(&[(37_200, 38_000)])).passes();
    story(AMT).with(faults).with(gaps(&[(37_200, 38_000), (39_700, 41_000)])).passes();
    story(AMT).with(faults).with(gaps(&[(39_700, 41_000)])).breaks(&[Rule::GivenUp]);
    // It takes three of them to see that (845001348).
    story(AMT).with(faults).with(gaps(&[(38_300, 39_900)])).passes();
    story(AMT).with(gaps(&[(38_300, 39_700)])).breaks_beside(&[Rule::Doubt], &[Rule::GivenUp]);
    story(AMT).with(early(Cause::PowerOn)).breaks(&[Rule::GivenUp]);
    // Nor do they where the thermocouple breaks (839000261, 842001709), or the exhaust falls (840000038).
    let unclear = |broken: bool, falls: f64| {
        let faults = move |h: &mut History| {
            let faults = 35_200 * MS..40 * SECOND;
            for sample in h.samples.iter_mut().filter(|s| faults.contains(&s.at)) {
                sample.fault = true;
                sample.egt -= falls * (sample.at - faults.start) as f64 / SECOND as f64;
            }
            h.mute = Spans::from(&[(35_400 * MS, 35_800 * MS)]);
            h.sensor = Spans::from(if broken { &[(37_200 * MS, 41 * SECOND)] } else { &[] });
            h.frames.retain(|frame| frame.at < 37_300 * MS || frame.at >= 40 * SECOND);
        };
        !story(AMT).with(faults).finds(Rule::GivenUp)
    };
    assert!(unclear(true, 0.0) && unclear(false, 3.0));
    assert!(!unclear(false, 0.0));
    // Or from the first set on, which may have been begun before them.
    let begun_before = |h: &mut History| {
        let first = 37_250 * MS..37_260 * MS;
        h.samples
            .iter_mut()
            .filter(|sample| first.contains(&sample.at))
            .for_each(|sample| sample.fault = false);
    };
    story(AMT).with(faults).with(begun_before).with(early(Cause::PowerOn)).passes();
    story(AMT).with(faults).with(early(Cause::Watchdog)).breaks(&[Rule::GivenUp]);
    // The order is given up before the exhaust can be read again (859000193).
    let unread = |until: u64| {
        story(AMT).with(faults).with(early(Cause::BrownOut)).with(move |h| {
            h.rules.serial_delay = 2 * SECOND;
            h.sensor = Spans::from(&[(37 * SECOND, until * MS)]);
        })
    };
    unread(39_400).passes();
    unread(38_200).breaks(&[Rule::GivenUp]);
    // In doubt since the reset, which only error sets followed: damaged ones are not replied to.
    let noise = |h: &mut History| h.noise = Spans::from(&[(37_950 * MS, 40_200 * MS)]);
    story(AMT).with(faults).with(early(Cause::Watchdog)).with(noise).passes();
    story(AMT).with(early(Cause::Watchdog)).with(noise).breaks(&[Rule::GivenUp]);
    story(AMT).with(faults).breaks(&[Rule::GivenUp]);
    // After a fault only a set that reports running gets a reply; in flight any state does.
    let hides = |fault: bool, from: u64| {
        story(AMT).with(move |h| {
            h.frames.retain(|frame| frame.at < micros(37.9) || frame.sent == STANDBY);
            for sample in h.samples.iter_mut().filter(|sample| sample.at < 40 * SECOND) {
                sample.fault = fault && (36 * SECOND..37_900 * MS).contains(&sample.at);
                sample.hidden = sample.at >= from * MS;
            }
        })
    };
    hides(true, 37_900).passes();
    // One that reports running in between confirms nothing yet (53000081).
    hides(true, 38_050).passes();
    hides(true, 38_300).breaks(&[Rule::GivenUp]);
    hides(true, 39_000).breaks(&[Rule::GivenUp]);
    hides(false, 37_900).breaks(&[Rule::GivenUp]);
    // Nor does it beside an alternate set, which reports nothing; two that report running do, whatever is between them (901000572).
    let beside = |alternate: &'static [u64], from: u64| {
        let sets = move |h: &mut History| {
            h.sets = (0..20).map(|n| 37_720 * MS + n * 125 * MS).collect();
            h.alternate = alternate.iter().map(|at| at * MS).collect();
        };
        hides(true, from).with(sets).finds(Rule::GivenUp)
    };
    assert!(!beside(&[37_970], 38_200) && !beside(&[38_095], 38_200));
    assert!(beside(&[], 38_200) && beside(&[37_720], 38_200) && beside(&[38_220], 38_200));
    assert!(beside(&[37_970], 38_250) && beside(&[38_095], 38_250));
    story(AMT).with(early(Cause::Watchdog)).breaks(&[Rule::GivenUp]);
    // ID 0 in doubt is no command to some ZK ECUs. The doubt ends with two reports of the state, 1.3 s after the reset.
    let empty = |down: u64, given_up: bool| {
        story(Kind::Zk(3)).with(move |h: &mut History| {
            h.rules.gives_up_on_empty = given_up;
            h.resets.push(Reset { down: down * MS, up: down * MS + 50 * MS, cause: Cause::Watchdog });
        })
    };
    empty(36_500, true).breaks_beside(&[Rule::Doubt], &[]);
    empty(36_500, false).breaks_beside(&[Rule::Doubt], &[Rule::GivenUp]);
    empty(35_500, true).breaks_beside(&[Rule::Doubt], &[Rule::GivenUp]);
}

#[test]
fn a_demand_is_not_held_below_the_commanded_one() {
    let story = |tenths| {
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 60.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.0, 60.0, Sent::Full(Switch::Run, tenths))
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
    };
    story(500).passes();
    story(480).breaks(&[Rule::HeldDown]);
    // A speed that no turbine makes has lowered it (53000117).
    let jumped =
        |at: u64| story(0).with(move |h| (h.rules.limit_jump, h.jumps) = (Some(false), vec![at * SECOND]));
    jumped(40).breaks_beside(&[Rule::Limit], &[]);
    jumped(10).breaks_beside(&[Rule::Limit], &[Rule::HeldDown]);
    // Two such speeds are also below the lowest one (500001782).
    let slow = |at: u64| story(0).with(move |h| (h.rules.jump_lowers, h.jumps) = (true, vec![at * SECOND]));
    slow(40).passes();
    slow(10).breaks(&[Rule::HeldDown]);
    // A source whose commands are exactly as far apart as its timeout is lost each time, and a lower one stays in control.
    let seldom = |every: u64| {
        flight(ZK5, 40.0)
            .streams(2, 31.0, 60.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.0, 60.0, HALF)
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
            .with(|h| {
                let command = PilotCommand::Run(Demanded::Throttle(800));
                let times = (80..120).map(|n| n * every * MS);
                h.commanded.extend(times.map(|at| Commanded { at, source: PILOT, command }));
            })
    };
    seldom(500).passes();
    seldom(490).breaks(&[Rule::HeldDown]);
    // A source that returns after a short gap continues without a take-over.
    let comes_back = |low: f64| {
        flight(ZK5, 50.0)
            .streams(PILOT, 50.9, 65.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(50.0, 50.9, HALF)
            .wire(50.9, 50.9 + low, Sent::Full(Switch::Run, 300))
            .ramp(50.9 + low, 300, 500)
            .wire(51.35 + low, 65.0, HALF)
            .turbine(50.0, 65.0, Phase::Running, 80_000.0, 500.0)
    };
    comes_back(0.1).passes();
    comes_back(4.0).breaks(&[Rule::HeldDown]);
    // A lower source that had commanded standby during the stages of loss was not in control.
    let standby = |h: &mut History| {
        let below = h.commanded.iter_mut().filter(|c| c.at > 42 * SECOND && c.at < 46 * SECOND);
        below.for_each(|commanded| commanded.command = PilotCommand::Standby);
    };
    comes_back(4.0).with(standby).breaks_beside(&[Rule::Obeyed], &[]);
    // Nothing of it on the wire.
    flight(ZK5, 40.0)
        .streams(PILOT, 40.0, 60.0, PilotCommand::Run(Demanded::Throttle(500)))
        .wire(40.0, 60.0, Sent::Nothing)
        .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
        .breaks(&[Rule::HeldDown]);
    // A transmitter that hangs for less than the ECU waits.
    let stalls = |from_us: u64, to_us: u64| {
        let stalls = move |h: &mut History| {
            h.frames.retain(|frame| !(from_us..to_us).contains(&frame.at));
            h.deaf = Spans::from(&[(from_us, to_us)]);
        };
        story(500).with(stalls)
    };
    stalls(50 * SECOND, 51_900 * MS).passes();
    let silent = |h: &mut History| h.deaf = Spans::default();
    stalls(50 * SECOND, 51_900 * MS).with(silent).breaks(&[Rule::HeldDown]);
}

/// A source that has long been in control, without a loss, does not have to wait when it moves its stick.
#[test]
fn a_stick_that_moves_in_flight_is_followed_at_the_rate() {
    let moved = |low: f64, long: bool| {
        flight(ZK5, 60.0)
            .streams(PILOT, 60.0, 75.0, PilotCommand::Run(Demanded::Throttle(800)))
            .wire(60.0, 60.0 + low, HALF)
            .ramp(60.0 + low, 500, 800)
            .wire(60.7 + low, 75.0, Sent::Full(Switch::Run, 800))
            .turbine(60.0, 75.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| {
                if !long {
                    h.commanded.retain(|c| !(55 * SECOND..58 * SECOND).contains(&c.at));
                    h.rules.hold = 8 * SECOND;
                    h.rules.return_within = 0;
                }
            })
    };
    moved(0.1, true).passes();
    moved(4.5, true).breaks(&[Rule::HeldDown]);
    moved(4.5, false).breaks_beside(&[Rule::SilentWire, Rule::HeldDown], &[]);
}

/// A demand that a limit, or noise in its place, holds low must have been low since then. A burst of noise before a flight does
/// not excuse the flight.
#[test]
fn noise_before_a_flight_explains_no_demand_that_is_held_low_later() {
    let story = |noise: u64, low: f64| {
        flight(ZK5, low)
            .streams(PILOT, low, 75.0, PilotCommand::Run(Demanded::Throttle(500)))
            .ramp(low, 500, 0)
            .wire(low + 1.1, 75.0, IDLE)
            .turbine(low, 75.0, Phase::Running, 60_000.0, 500.0)
            .with(move |h| {
                h.rules.limit_egt = Some((700.0, false));
                h.noise = Spans::from(&[(noise * SECOND, noise * SECOND + 300 * MS)]);
            })
    };
    story(49, 50.0).passes();
    story(2, 50.0).breaks(&[Rule::HeldDown]);
    story(40, 50.0).breaks(&[Rule::HeldDown]);
}

/// A fault whose limit lowers the demand counts, however long the wire from the ECU is cut after it (836001383).
#[test]
fn a_gap_after_a_fault_delays_the_fall_of_the_demand() {
    let story = |cut: bool| {
        flight(ZK5, 52.0)
            .streams(PILOT, 52.0, 75.0, PilotCommand::Run(Demanded::Throttle(500)))
            .ramp(52.0, 500, 0)
            .wire(53.1, 75.0, IDLE)
            .turbine(52.0, 75.0, Phase::Running, 60_000.0, 500.0)
            .with(|h| {
                h.rules.limit_fault = Some(false);
                let fault = 44 * SECOND..45 * SECOND;
                h.samples.iter_mut().filter(|sample| fault.contains(&sample.at)).for_each(|s| s.fault = true);
                if cut {
                    h.mute = Spans::from(&[(45 * SECOND, 52 * SECOND)]);
                    h.frames.retain(|frame| !(45 * SECOND..52 * SECOND).contains(&frame.at));
                }
            })
            .finds(Rule::HeldDown)
    };
    assert_eq!([story(true), story(false)], [false, true]);
}

/// Sets at rest that no ECU sent agree where all others are error sets (712200004).
#[test]
fn error_sets_do_not_contradict_sets_that_no_ecu_sent() {
    let story = |forged: &'static [u64], faults: bool| {
        shut_down_uncommanded()
            .with(move |h| {
                h.forged = forged.iter().map(|at| at * MS).collect();
                h.samples.iter_mut().filter(|s| faults && s.at > 39 * SECOND).for_each(|s| s.fault = true);
            })
            .finds(Rule::ShutDown)
    };
    assert!(!story(&[39_700, 40_000], true));
    assert!(story(&[39_700, 40_000], false) && story(&[40_000], true));
}

/// A fault whose limit shuts the engine down, and then nothing is received: standby goes into the reply to the first set after it (843000396).
#[test]
fn a_gap_after_a_fault_delays_a_standby() {
    let story = |cut: bool, limit| {
        shut_down_uncommanded()
            .with(move |h| {
                (h.rules.limit_fault, h.rules.gives_up_after) = (limit, 20 * SECOND);
                let fault = micros(36.6)..micros(37.0);
                h.samples.iter_mut().filter(|sample| fault.contains(&sample.at)).for_each(|s| s.fault = true);
                if cut {
                    h.mute = Spans::from(&[(micros(36.9), micros(39.9))]);
                }
            })
            .finds(Rule::ShutDown)
    };
    assert!(!story(true, Some(true)));
    assert!(story(false, Some(true)) && story(true, None));
}

#[test]
fn a_shaft_at_rest_raises_doubt_in_any_frame() {
    let story = |doubt: Sent| {
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 45.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.0, 40.1, HALF)
            .wire(40.1, 40.9, doubt)
            .wire(40.9, 45.0, HALF)
            .turbine(40.0, 45.0, Phase::Running, 100_000.0, 500.0)
            .with(|h| h.slow.push(40 * SECOND))
    };
    story(Sent::Nothing).passes();
    story(HALF).breaks(&[Rule::Doubt]);
    // On AMT a set reports the engine's state, and the second one is answered.
    story(HALF).with(|h| h.rules.kind = AMT).passes();
}

#[test]
fn a_source_that_takes_over_is_held_off() {
    let story = |wait: f64| {
        flight(ZK5, 60.0)
            .streams(PILOT, 60.0, 70.0, PilotCommand::Run(Demanded::Throttle(500)))
            .streams(0, 60.0, 70.0, PilotCommand::Run(Demanded::Throttle(200)))
            .wire(60.0, 60.0 + wait, HALF)
            .wire(60.0 + wait, 70.0, Sent::Full(Switch::Run, 200))
            .turbine(60.0, 70.0, Phase::Running, 80_000.0, 500.0)
    };
    story(2.0).passes();
    story(0.1).breaks(&[Rule::TakeOver]);
    // The demand of one that is lost meanwhile falls.
    let lost = flight(ZK5, 60.0)
        .streams(PILOT, 60.0, 60.3, PilotCommand::Run(Demanded::Throttle(500)))
        .streams(0, 60.0, 70.0, PilotCommand::Run(Demanded::Throttle(200)))
        .wire(60.0, 60.8, HALF)
        .ramp(60.8, 500, 400)
        .wire(61.0, 62.0, Sent::Full(Switch::Run, 400))
        .wire(62.0, 70.0, Sent::Full(Switch::Run, 200))
        .turbine(60.0, 70.0, Phase::Running, 80_000.0, 500.0);
    lost.with(|h| h.rules.hold = 0).passes();
}

/// A speed that the ECU cannot hold, because its version is too old, commands nothing.
#[test]
fn a_speed_that_an_old_ecu_cannot_hold_commands_nothing() {
    let story = |kind| flight(kind, 60.0).streams(0, 40.0, 60.0, PilotCommand::Run(Demanded::Rpm(120_000)));
    story(Kind::Zk(3)).passes();
    story(ZK5).breaks(&[Rule::HeldDown]);
}

/// Whatever limits a demand, a lower one of the source in control is obeyed.
#[test]
fn a_demand_is_not_held_above_the_commanded_one() {
    let story = |tenths, limited: bool| {
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 60.0, PilotCommand::Run(Demanded::Throttle(200)))
            .wire(40.0, 60.0, Sent::Full(Switch::Run, tenths))
            .turbine(40.0, 60.0, Phase::Running, 80_000.0, 500.0)
            .with(|h| {
                if limited {
                    h.rules.limit_rpm = Some((70_000.0, false));
                    h.rules.fail_safe = 250;
                }
            })
    };
    story(200, false).passes();
    story(250, false).breaks(&[Rule::HeldUp]);
    // That it was still at half throttle then is another matter.
    story(200, true).breaks_beside(&[Rule::Limit], &[]);
    story(250, true).breaks_beside(&[Rule::Limit], &[Rule::HeldUp]);
}

/// A command that another one of the same source follows at the same instant has moved the demand, which falls at its rate.
#[test]
fn a_demand_that_a_stray_word_has_raised_comes_down_at_its_rate() {
    let throttle = |tenths| PilotCommand::Run(Demanded::Throttle(tenths));
    let story = |strays: bool| {
        let calm = flight(ZK5, 40.0).streams(PILOT, 40.0, 80.0, throttle(200));
        let calm = if strays { calm.once(PILOT, 65.0, throttle(500)) } else { calm };
        calm.once(PILOT, 65.0, throttle(200))
            .wire(40.0, 65.0, Sent::Full(Switch::Run, 200))
            .ramp(65.0, 500, 200)
            .wire(65.7, 67.5, Sent::Full(Switch::Run, 300))
            .wire(67.5, 80.0, Sent::Full(Switch::Run, 200))
            .turbine(40.0, 80.0, Phase::Running, 80_000.0, 500.0)
            .with(|h| h.rules.slew_down = Some(200))
    };
    story(true).breaks_beside(&[Rule::Rate], &[]);
    story(false).breaks_beside(&[Rule::Rate], &[Rule::HeldUp]);
}
