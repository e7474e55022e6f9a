//! Histories by hand for the judge's rules: which source may start an engine, and what an engine at rest may
//! be sent.

use super::*;

#[test]
fn an_ignition_follows_one_sources_own_standby_and_run_while_armed() {
    let ends = |story: Story| story.turbine(5.0, 8.0, Phase::Ignition, 5000.0, 20.0).wire(4.0, 8.0, IDLE);
    let run = PilotCommand::Run(Demanded::Throttle(0));
    let streams = |story: Story| ends(story.streams(PILOT, 4.0, 8.0, run).mark(5.0, Mark::Ignition));
    streams(ready(ZK5)).passes();
    // Not armed: the command is on the wire nevertheless.
    streams(ready(ZK5).with(|h| h.commanded.retain(|commanded| commanded.command != PilotCommand::Arm)))
        .breaks(&[Rule::Ignition, Rule::RunAtRest]);
    // Another source's standby.
    let other = |h: &mut History| {
        for commanded in h.commanded.iter_mut().filter(|commanded| commanded.command == PilotCommand::Standby)
        {
            commanded.source = 2;
        }
    };
    streams(ready(ZK5)).with(other).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    // Above idle.
    let high = ready(ZK5)
        .streams(PILOT, 4.0, 8.0, PilotCommand::Run(Demanded::Throttle(300)))
        .mark(5.0, Mark::Ignition);
    ends(high).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    // Refused once is refused: it is armed later.
    streams(
        ready(ZK5).with(|h| h.commanded.retain(|commanded| commanded.command != PilotCommand::Arm)).once(
            PILOT,
            4.5,
            PilotCommand::Arm,
        ),
    )
    .breaks(&[Rule::Ignition, Rule::RunAtRest]);
    // Its ECU has just lost its power, or lost it long enough ago to be seen.
    let off = |from| {
        move |h: &mut History| {
            h.unpowered = Spans::from(&[(from, 4050 * MS)]);
            h.rules.boot = 50 * MS;
        }
    };
    streams(ready(ZK5)).with(off(3995 * MS)).passes();
    streams(ready(ZK5))
        .with(off(3500 * MS))
        .breaks_beside(&[Rule::Doubt], &[Rule::Ignition, Rule::RunAtRest]);
    // With its boot that outage was shorter than a gap (873001041).
    let dipped = |from, to| {
        streams(ready(ZK5)).with(move |h| {
            h.unpowered = Spans::from(&[(from * MS, to * MS)]);
            h.rules.boot = 50 * MS;
        })
    };
    dipped(3600, 3750).passes();
    dipped(3500, 3750).breaks_beside(&[Rule::Doubt], &[Rule::Ignition, Rule::RunAtRest]);
    // A hot exhaust.
    let hot = |h: &mut History| h.samples.iter_mut().for_each(|sample| sample.egt = 180.0);
    streams(ready(ZK5)).with(hot).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    // A low supply, where that counts, and a pump that was opened and not closed.
    let supply = |counts: bool| {
        move |h: &mut History| {
            h.rules.supply_counts = counts;
            h.low_supply = Spans::from(&[(0, 8 * SECOND)]);
        }
    };
    streams(ready(ZK5)).with(supply(false)).passes();
    streams(ready(ZK5)).with(supply(true)).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    // An AMT ECU reports it less often.
    let since = |at: u64| {
        let low = Spans::from(&[(at * MS, 8 * SECOND)]);
        streams(ready(AMT)).with(supply(true)).with(move |h| h.low_supply = low)
    };
    since(2000).passes();
    since(500).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    let pump = |last: u8| {
        let service = PilotCommand::Service(12);
        let opened = ready(ZK5).once(PILOT, 3.0, service).wire(3.0, 3.01, Sent::Action(12));
        streams(opened.wire(3.2, 3.21, Sent::Action(last)))
    };
    pump(13).passes();
    pump(12).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    // An exhaust temperature that is not measured.
    let broken = |h: &mut History| h.sensor = Spans::from(&[(0, 8 * SECOND)]);
    streams(ready(ZK5)).with(broken).breaks(&[Rule::Ignition, Rule::RunAtRest]);
}

#[test]
fn a_pair_of_words_gives_one_ignition() {
    let story = || {
        flight(ZK5, 40.0)
            .turbine(40.0, 42.0, Phase::Stopped, 30_000.0, 90.0)
            .turbine(42.0, 44.0, Phase::Ignition, 8000.0, 90.0)
            .streams(PILOT, 40.0, 44.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.0, 40.5, HALF)
            .wire(40.5, 44.0, STANDBY)
    };
    story().mark(42.0, Mark::Ignition).breaks(&[Rule::Ignition]);
    // An ignition that the ECU begins on its own is not the node's.
    story().mark(42.0, Mark::Relight).passes();
}

/// While the wire to the node is cut an AMT ECU gets no reply: until its serial delay is over it may start again on the last one.
#[test]
fn behind_a_cut_wire_an_amt_ecu_acts_on_its_last_command() {
    let story = |again: f64, cut: bool| {
        flight(AMT, 40.0)
            .streams(PILOT, 40.0, again + 1.0, PilotCommand::Run(Demanded::Throttle(500)))
            .turbine(40.0, again, Phase::Cooling, 30_000.0, 400.0)
            .turbine(again, again + 1.0, Phase::Ignition, 8000.0, 390.0)
            .mark(again, Mark::Ignition)
            .with(|h| h.rules.gives_up_after = 4 * SECOND)
            .with(|h| {
                h.mute = Spans::from(&[(39_900 * MS, if cut { 60 } else { 40 } * SECOND)]);
            })
    };
    story(42.0, true).passes();
    story(42.0, false).breaks(&[Rule::Ignition]);
    story(46.0, true).breaks(&[Rule::Ignition]);
    // The flame went out before the last command; with error sets that does not show for 4 s.
    let out = |from: u64, faults: bool| {
        let story = story(42.0, true).with(move |h| {
            for sample in h.samples.iter_mut().filter(|sample| (from..42_000).contains(&(sample.at / MS))) {
                (sample.phase, sample.fault) = (Phase::Cooling, faults);
            }
        });
        story.finds(Rule::Ignition)
    };
    assert!(!out(38_000, true) && out(38_000, false));
    // The cut is over, and error sets get no reply after it.
    let behind = |faults: bool| {
        let story = story(44.7, true).with(move |h| {
            h.mute = Spans::from(&[(39_900 * MS, 40_900 * MS)]);
            for sample in h.samples.iter_mut().filter(|sample| (39_000..44_700).contains(&(sample.at / MS))) {
                sample.fault = faults;
                // The exhaust falls as one without a flame.
                sample.egt -= 40.0 * sample.at.saturating_sub(40 * SECOND) as f64 / SECOND as f64;
            }
        });
        story.finds(Rule::Ignition)
    };
    assert!(!behind(true) && behind(false));
    // It clears its fault in the gap, and may be coasting: nothing is sent then (760000894).
    let cleared = |run: bool| {
        let story = story(42.7, true).with(move |h| {
            h.mute = Spans::from(&[(39_900 * MS, 41_900 * MS)]);
            let tripped = |s: &&mut Sample| (40 * SECOND..41_500 * MS).contains(&s.at);
            h.samples.iter_mut().filter(tripped).for_each(|sample| sample.fault = true);
        });
        let story = if run { story.wire(42.0, 42.3, HALF) } else { story };
        story.finds(Rule::Ignition)
    };
    assert!(!cleared(false) && cleared(true));
}

/// Likewise while the wire to the ECU is cut, whatever the node sends.
#[test]
fn what_does_not_reach_an_ecu_does_not_ignite() {
    let story = |cut: bool| {
        started(AMT)
            .turbine(RUNS as f64, 40.0, Phase::Running, 60_000.0, 480.0)
            .streams(PILOT, 31.0, 40.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(31.0, 40.0, IDLE)
            .wire(40.0, 43.0, STANDBY)
            .turbine(40.0, 41.0, Phase::Cooling, 30_000.0, 400.0)
            .turbine(41.0, 43.0, Phase::Ignition, 8000.0, 390.0)
            .mark(41.0, Mark::Ignition)
            .with(|h| {
                let out = 39_950 * MS..60 * SECOND;
                h.frames.iter_mut().filter(|f| cut && out.contains(&f.at)).for_each(|f| f.arrived = false);
                h.deaf = Spans::from(&[(out.start, if cut { out.end } else { out.start })]);
            })
    };
    let found = |cut| {
        let verdict = story(cut).judged();
        verdict.rules().into_iter().filter(|rule| *rule == Rule::Ignition).count()
    };
    assert_eq!([found(true), found(false)], [0, 1]);
}

/// An AMT ECU acts on the last command of before the node was reset, while its engine was still reported as running: a node that sends nothing
/// since has not lit it (897000536).
#[test]
fn what_was_sent_before_a_reset_does_not_ignite() {
    let story = |reset: bool, sent: Option<Sent>| {
        let story = started(AMT)
            .turbine(RUNS as f64, 40.0, Phase::Running, 60_000.0, 480.0)
            .streams(PILOT, 31.0, 40.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(31.0, 40.0, IDLE)
            .turbine(40.0, 40.7, Phase::Cooling, 30_000.0, 400.0)
            .turbine(40.7, 43.0, Phase::Ignition, 8000.0, 390.0)
            .mark(40.7, Mark::Ignition)
            .with(move |h| {
                let reset =
                    reset.then_some(Reset { down: 40_000 * MS, up: 40_040 * MS, cause: Cause::BrownOut });
                h.resets.extend(reset);
                h.rules.burning = 400.0;
                for sample in h.samples.iter_mut().filter(|sample| sample.at >= 33 * SECOND) {
                    // The flame went out, its exhaust is cold, and its ECU reports that later.
                    sample.lit = false;
                    sample.egt = 550.0 - 30.0 * (sample.at - 33 * SECOND) as f64 / SECOND as f64;
                    sample.fault = (40 * SECOND..40_600 * MS).contains(&sample.at);
                }
            });
        let story = sent.into_iter().fold(story, |story, sent| story.wire(40.3, 40.4, sent));
        story.finds(Rule::Ignition)
    };
    let found = [story(true, None), story(true, Some(IDLE)), story(false, None)];
    assert_eq!(found, [false, true, true]);
}

/// An ECU that is powered up with run on its PWM input lights its engine, which goes out with the first
/// frame.
#[test]
fn a_start_by_the_pwm_input_at_a_power_up_is_not_the_nodes() {
    let story = |sent, signal: bool| {
        ready(ZK5)
            .wire(4.0, 8.0, sent)
            .mark(7.05, Mark::Ignition)
            .turbine(5.0, 8.0, Phase::Standby, 0.0, 15.0)
            .with(move |h| {
                h.rules.boot = 30 * MS;
                h.unpowered = Spans::from(&[(6600 * MS, 7 * SECOND)]);
                h.pwm_signal = Spans::from(&[(6 * SECOND, if signal { 8 } else { 6 } * SECOND)]);
            })
    };
    story(STANDBY, true).passes();
    story(STANDBY, false).breaks(&[Rule::Ignition]);
    story(IDLE, true).breaks_beside(&[Rule::RunAtRest, Rule::Obeyed, Rule::Doubt], &[Rule::Ignition]);
}

/// Noise forms a command now and then. The frames sent have to be different.
#[test]
fn what_noise_commands_is_not_the_nodes() {
    let story = |sent, noise: bool| {
        ready(ZK5)
            .wire(4.0, 8.0, sent)
            .mark(7.0, Mark::Ignition)
            .turbine(5.0, 7.0, Phase::Standby, 0.0, 15.0)
            .turbine(7.0, 8.0, Phase::Ignition, 5000.0, 20.0)
            .with(move |h| h.noise_to_ecu = Spans::from(&[(6 * SECOND, if noise { 8 } else { 6 } * SECOND)]))
    };
    story(STANDBY, true).passes();
    story(STANDBY, false).breaks(&[Rule::Ignition]);
    story(IDLE, true).breaks_beside(&[Rule::RunAtRest, Rule::Obeyed], &[Rule::Ignition]);
}

#[test]
fn a_cancelled_start_does_not_ignite() {
    let story = |command| {
        ready(ZK5)
            .streams(PILOT, 4.0, 12.0, PilotCommand::Run(Demanded::Throttle(0)))
            .once(2, 5.0, command)
            .wire(4.0, 5.1, IDLE)
            .wire(5.1, 12.0, STANDBY)
            .mark(8.0, Mark::Ignition)
            .turbine(5.0, 8.0, Phase::Standby, 0.0, 15.0)
            .turbine(8.0, 12.0, Phase::Ignition, 5000.0, 20.0)
    };
    story(PilotCommand::Disarm).breaks(&[Rule::Ignition]);
    story(PilotCommand::ShutDown).breaks(&[Rule::Ignition]);
    story(PilotCommand::Arm).passes();
}

/// A standby from below a source that is in control and commands run takes no effect.
#[test]
fn a_start_is_cancelled_by_its_own_source_unless_a_higher_one_is_in_control() {
    let story = |higher: Option<f64>| {
        let story = match higher {
            Some(from) => ready(ZK5).once(0, 0.2, PilotCommand::Run(Demanded::Throttle(0))).streams(
                0,
                from,
                13.9,
                PilotCommand::Run(Demanded::Throttle(0)),
            ),
            None => ready(ZK5),
        };
        story
            .streams(PILOT, 4.0, 8.0, PilotCommand::Run(Demanded::Throttle(0)))
            .streams(PILOT, 8.0, 13.9, PilotCommand::Standby)
            .wire(4.0, 13.0, IDLE)
            .wire(13.0, 14.0, STANDBY)
            .mark(11.0, Mark::Ignition)
            .turbine(5.0, 11.0, Phase::Standby, 0.0, 15.0)
            .turbine(11.0, 14.0, Phase::Ignition, 5000.0, 20.0)
    };
    story(Some(4.2)).passes();
    // Its demand is close, so that it takes over as soon as it counts.
    story(Some(6.9)).passes();
    story(None).breaks_beside(&[Rule::Obeyed], &[Rule::Ignition, Rule::RunAtRest]);
    // A source that appears just before is not in control yet, unless the node was reset since it was last
    // received.
    story(Some(7.8)).breaks_beside(&[Rule::Obeyed], &[Rule::Ignition, Rule::RunAtRest]);
    let reset = |h: &mut History| {
        h.resets.push(Reset { down: 2 * SECOND, up: 2 * SECOND + 20 * MS, cause: Cause::Watchdog });
    };
    story(Some(7.8)).with(reset).passes();
    // Or unless it was never received before.
    story(Some(7.8)).with(|h| h.commanded.retain(|c| c.at > SECOND)).passes();
}

#[test]
fn an_emergency_stop_disarms_until_the_source_that_armed_disarms() {
    let story = |disarm: bool| {
        let story = ready(ZK5).once(PILOT, 2.0, PilotCommand::Stop).wire(2.0, 2.2, STOP).once(
            PILOT,
            2.2,
            PilotCommand::Release,
        );
        let story =
            story.with(|h| h.frames.retain(|f| f.sent == STOP || !(2_000_000..2_250_000).contains(&f.at)));
        let story = if disarm { story.once(PILOT, 2.4, PilotCommand::Disarm) } else { story };
        story
            .once(PILOT, 2.6, PilotCommand::Arm)
            .streams(PILOT, 4.0, 8.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(4.0, 8.0, IDLE)
            .mark(5.0, Mark::Ignition)
            .turbine(5.0, 8.0, Phase::Ignition, 5000.0, 20.0)
    };
    story(true).passes();
    story(false).breaks(&[Rule::Ignition, Rule::RunAtRest]);
}

#[test]
fn an_engine_that_went_out_is_not_sent_run_for_long() {
    let story = |sent_until: f64| {
        flight(ZK5, 40.0)
            .turbine(40.0, 50.0, Phase::Cooling, 5000.0, 400.0)
            .streams(PILOT, 40.0, 50.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.0, sent_until, HALF)
            .wire(sent_until, 50.0, STANDBY)
    };
    story(40.5).passes();
    story(45.0).breaks(&[Rule::RunAtRest]);
    // Until the report has come, each frame is exempt, and has a name.
    let exempt = story(40.2).judged().at_rest;
    assert_eq!(
        exempt.exempt.keys().copied().collect::<Vec<_>>(),
        ["the report of an engine that went out is on its way"]
    );
    assert!(exempt.per_mille() > 0.0);
}

#[test]
fn an_ecu_that_was_powered_up_is_not_sent_run() {
    let story = |sent: Sent| {
        flight(AMT, 40.0)
            .with(|h| h.unpowered = Spans::from(&[(40 * SECOND, 50 * SECOND)]))
            .turbine(40.0, 55.0, Phase::Stopped, 0.0, 200.0)
            .streams(PILOT, 40.0, 55.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(50.4, 50.5, sent)
            .wire(50.5, 55.0, STANDBY)
    };
    story(STANDBY).passes();
    story(HALF).breaks(&[Rule::RunAtRest, Rule::Doubt]);
}

/// Another ECU is plugged in, at rest: on AMT, too, it is not started by the run of the one before.
#[test]
fn another_ecu_is_not_started_by_the_run_of_the_one_before() {
    let story = |until: f64| {
        flight(AMT, 40.0)
            .with(|h| {
                h.unpowered = Spans::from(&[(40 * SECOND, 40_100 * MS)]);
                h.versions = vec![(40 * SECOND, 0)];
                assert_eq!((h.version(41 * SECOND), h.rounds()), (0, (1, 1)));
            })
            .turbine(40.0, 50.0, Phase::Standby, 0.0, 15.0)
            .streams(PILOT, 40.0, 50.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.5, until, HALF)
            .wire(until, 50.0, STANDBY)
    };
    story(40.5).passes();
    story(42.0).breaks(&[Rule::RunAtRest]);
    story(40.6).mark(41.0, Mark::Ignition).breaks_beside(&[Rule::RunAtRest], &[Rule::Ignition]);
}

#[test]
fn a_lost_line_ends_what_an_engine_at_rest_is_sent() {
    let story = |until: f64| {
        flight(ZK5, 40.0)
            .with(|h| h.mute = Spans::from(&[(39_800 * MS, 50 * SECOND)]))
            .turbine(40.0, 50.0, Phase::Standby, 0.0, 50.0)
            .streams(PILOT, 40.0, 50.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.0, until, HALF)
            .wire(until, 50.0, Sent::Nothing)
    };
    story(40.0).passes();
    story(45.0).breaks(&[Rule::RunAtRest, Rule::Doubt]);
}

#[test]
fn a_permission_does_not_outlive_a_disarm_a_shutdown_or_another_sources_change_to_standby() {
    let story = |between: &[(usize, PilotCommand)]| {
        let mut story = ready(ZK5)
            .streams(PILOT, 4.0, 8.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(4.0, 8.0, IDLE)
            .mark(5.0, Mark::Ignition)
            .turbine(5.0, 8.0, Phase::Ignition, 5000.0, 20.0);
        for (step, (source, command)) in between.iter().enumerate() {
            story = story.once(*source, 3.92 + 0.02 * step as f64, *command);
        }
        story
    };
    story(&[(2, PilotCommand::Arm)]).passes();
    story(&[(2, PilotCommand::Standby)]).passes();
    for between in [
        [(2, PilotCommand::Disarm), (2, PilotCommand::Arm)],
        [(2, PilotCommand::ShutDown), (2, PilotCommand::Arm)],
        [(2, PilotCommand::Run(Demanded::Throttle(0))), (2, PilotCommand::Standby)],
    ] {
        story(&between).breaks(&[Rule::Ignition, Rule::RunAtRest]);
    }
}

#[test]
fn an_exhaust_that_falls_ends_the_run_of_an_engine_with_error_sets() {
    let story = |sent_until: f64, lowered: bool| {
        let story = flight(AMT, 40.0)
            .turbine(40.0, 70.0, Phase::Cooling, 5000.0, 0.0)
            .streams(PILOT, 40.0, 70.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(40.0, sent_until, if lowered { IDLE } else { HALF })
            .wire(sent_until, 70.0, STANDBY);
        story.with(|h| {
            for sample in h.samples.iter_mut().filter(|sample| sample.at >= 40 * SECOND) {
                sample.fault = true;
                sample.egt = 700.0 - 20.5 * (sample.at - 40 * SECOND) as f64 / SECOND as f64;
            }
        })
    };
    story(44.0, false).passes();
    story(50.0, false).breaks(&[Rule::RunAtRest]);
    // A fall that was not received is seen from then on.
    let dark = |sent_until| {
        let dark = 39_900 * MS..44 * SECOND;
        let cut = |h: &mut History| {
            h.frames.retain(|frame| !dark.contains(&frame.at));
            h.mute = Spans::from(&[(dark.start, dark.end)]);
        };
        story(sent_until, false).with(cut).finds(Rule::RunAtRest)
    };
    assert_eq!([dark(48.5), dark(56.0)], [false, true]);
    // The lower demand may be the cause: then the exhaust has to be cold, and the thermocouple intact.
    story(60.0, true).passes();
    story(69.0, true).breaks(&[Rule::RunAtRest]);
    story(69.0, true).with(|h| h.sensor = Spans::from(&[(50 * SECOND, 70 * SECOND)])).passes();
    // It proves nothing either if the thermocouple was broken before.
    story(50.0, false).with(|h| h.sensor = Spans::from(&[(39 * SECOND, 70 * SECOND)])).passes();
    // Once it was broken, a cold value proves nothing before it has been hot.
    story(69.0, true).with(|h| h.sensor = Spans::from(&[(50 * SECOND, 52 * SECOND)])).passes();
    // Nor one that was cold before, as long as a lower demand explained that (813001762). A fall shows it after it.
    let explained = |sent_until: f64, broken: bool, degrees_per_s: f64| {
        let cold = move |h: &mut History| {
            for sample in h.samples.iter_mut().filter(|sample| sample.at >= 40 * SECOND) {
                sample.egt = 270.0 - degrees_per_s * (sample.at - 40 * SECOND) as f64 / SECOND as f64;
            }
            h.sensor = if broken { Spans::from(&[(43 * SECOND, 46 * SECOND)]) } else { Spans::default() };
        };
        story(sent_until, true).with(cold).finds(Rule::RunAtRest)
    };
    assert!(explained(50.0, false, 5.0) && !explained(50.0, true, 5.0));
    assert!(!explained(49.0, true, 20.0) && explained(56.0, true, 20.0));
    // A demand that is still being lowered explains it for as long, also the fall (897002120).
    let lowered = |until: f64, broken: bool| {
        let cold = move |h: &mut History| {
            for sample in h.samples.iter_mut().filter(|sample| sample.at >= 40 * SECOND) {
                sample.egt = 340.0 - 20.0 * (sample.at - 40 * SECOND) as f64 / SECOND as f64;
            }
            h.sensor = if broken { Spans::from(&[(40_500 * MS, 41 * SECOND)]) } else { Spans::default() };
        };
        let story = flight(AMT, 40.0)
            .turbine(40.0, 70.0, Phase::Cooling, 5000.0, 0.0)
            .streams(PILOT, 40.0, 70.0, PilotCommand::Run(Demanded::Throttle(0)))
            .ramp(40.0, 500, 200)
            .wire(43.1, until, Sent::Full(Switch::Run, 0))
            .wire(until, 70.0, STANDBY)
            .with(|h| h.samples.iter_mut().filter(|s| s.at >= 40 * SECOND).for_each(|s| s.fault = true))
            .with(cold);
        story.finds(Rule::RunAtRest)
    };
    assert!(!lowered(48.4, true) && lowered(60.0, true) && lowered(60.0, false));
}

#[test]
fn a_start_that_is_commanded_as_documented_begins() {
    let story = |sent: Sent| {
        Story::new(ZK5)
            .once(PILOT, 0.5, PilotCommand::Arm)
            .streams(PILOT, 1.0, 14.0, PilotCommand::Standby)
            .streams(PILOT, 14.0, 16.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(1.0, 14.1, STANDBY)
            .wire(14.1, 16.0, sent)
            .turbine(0.0, 16.0, Phase::Standby, 0.0, 15.0)
    };
    story(IDLE).passes();
    story(STANDBY).breaks(&[Rule::Granted]);
    // A lower source that repeats standby uses up its own permission only, one that changes to it every other.
    story(STANDBY).streams(2, 1.0, 16.0, PilotCommand::Standby).breaks(&[Rule::Granted]);
    story(STANDBY)
        .streams(2, 1.0, 13.5, PilotCommand::Run(Demanded::Throttle(0)))
        .streams(2, 13.5, 16.0, PilotCommand::Standby)
        .passes();
    story(STANDBY).once(2, 13.0, PilotCommand::Disarm).passes();
    // To an AMT ECU an engine is at rest when its shaft does not turn.
    let coasts = |rpm| {
        story(STANDBY).with(move |h| {
            (h.rules.kind, h.rules.period, h.rules.round) = (AMT, 125 * MS, 1);
            h.samples.iter_mut().for_each(|sample| sample.rpm = rpm);
        })
    };
    coasts(0.0).breaks(&[Rule::Granted]);
    coasts(1500.0).passes();
}

/// A brown-out disarms, but a source that had to disarm first may still have to: such a record can only stop
/// an engine.
#[test]
fn a_brown_out_need_not_forget_who_has_to_disarm_first() {
    let story = |disarms: bool, cause: Cause| {
        let story = Story::new(ZK5)
            .once(PILOT, 0.5, PilotCommand::Arm)
            .once(PILOT, 1.0, PilotCommand::Stop)
            .once(PILOT, 1.5, PilotCommand::Release)
            .with(|h| h.resets.push(Reset { down: 2 * SECOND, up: 2100 * MS, cause }))
            .once(PILOT, 4.0, PilotCommand::Arm);
        let story = if disarms { story.once(PILOT, 3.9, PilotCommand::Disarm) } else { story };
        story
            .streams(PILOT, 4.0, 17.0, PilotCommand::Standby)
            .streams(PILOT, 17.0, 19.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(1.0, 1.5, STOP)
            .wire(1.5, 19.0, STANDBY)
            .turbine(0.0, 19.0, Phase::Standby, 0.0, 15.0)
    };
    story(false, Cause::BrownOut).passes();
    story(true, Cause::BrownOut).breaks(&[Rule::Granted]);
    // After a longer time without power the memory is lost, and with it which source has to disarm.
    story(false, Cause::PowerOn).breaks(&[Rule::Granted]);
}

/// A reset of the node or a wire that was cut hid the power-up, and the first set still reports that the engine runs: with its shaft above
/// half of idle, as it is set, it is answered.
#[test]
fn a_first_set_that_is_stale_is_answered_while_the_shaft_turns() {
    let story = |rpm, hidden: &dyn Fn(&mut History)| {
        flight(AMT, 40.0)
            .with(|h| {
                h.unpowered = Spans::from(&[(40 * SECOND, 45 * SECOND)]);
                hidden(h);
                h.rules.stale = 1;
                h.rules.serial_delay = 10 * SECOND;
            })
            .turbine(40.0, 50.0, Phase::Cooling, rpm, 400.0)
            .streams(PILOT, 40.0, 50.0, PilotCommand::Run(Demanded::Throttle(500)))
            .wire(45.4, 45.5, HALF)
            .wire(45.6, 50.0, STANDBY)
    };
    let reset = |h: &mut History| {
        h.resets.push(Reset { down: 45_200 * MS, up: 45_350 * MS, cause: Cause::Watchdog });
    };
    let cut = |h: &mut History| h.mute = Spans::from(&[(40 * SECOND, 45_350 * MS)]);
    story(15_000.0, &reset).passes();
    story(10_000.0, &reset).breaks(&[Rule::RunAtRest]);
    story(15_000.0, &cut).passes();
    story(10_000.0, &cut).breaks(&[Rule::RunAtRest]);
    // One that was received counts.
    story(15_000.0, &|_| ()).breaks(&[Rule::RunAtRest]);
}

/// A start that its ECU has not reported yet, and an outage that is shorter than a gap: at rest still fits, until a gap can be
/// seen.
#[test]
fn an_unreported_start_continues_until_a_gap_can_be_seen() {
    let story = |until: f64| {
        ready(ZK5)
            .streams(PILOT, 4.0, 20.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(4.0, until, IDLE)
            .wire(until, 20.0, STANDBY)
            .mark(5.0, Mark::Ignition)
            .turbine(5.0, 5.15, Phase::Ignition, 1000.0, 20.0)
            .turbine(5.15, 20.0, Phase::Standby, 0.0, 20.0)
            .with(|h| {
                h.rules.boot = 50 * MS;
                h.unpowered = Spans::from(&[(5100 * MS, 5150 * MS)]);
                h.mute = Spans::from(&[(8 * SECOND, 12 * SECOND)]);
            })
    };
    story(8.2).passes();
    story(9.0).breaks_beside(&[Rule::Doubt], &[Rule::RunAtRest]);
}

/// 860001509: the set-up set of an AMT ECU is lost in a cut, and one set of before comes after it.
#[test]
fn an_outage_in_a_cut_is_not_seen_where_a_set_of_before_follows() {
    let ignites = |stale: u64, cut: u64| {
        let story = flight(AMT, 40.0).turbine(40.8, 45.0, Phase::Ignition, 30_000.0, 500.0);
        let story = story.wire(40.35, 45.0, IDLE).mark(40.8, Mark::Ignition).with(|h| {
            (h.rules.boot, h.rules.stale) = (50 * MS, stale);
            h.unpowered = Spans::from(&[(39_900 * MS, 39_950 * MS)]);
            h.mute = Spans::from(&[(38 * SECOND, cut * MS)]);
            h.frames.retain(|frame| !(38 * SECOND..40_340 * MS).contains(&frame.at));
        });
        story.finds(Rule::Ignition)
    };
    assert_eq!(
        [(1, 40_300), (0, 40_300), (1, 39_980)].map(|(stale, cut)| ignites(stale, cut)),
        [false, true, true]
    );
}

/// 906000845: the same after a longer outage, in a cut that is shorter than the serial delay.
#[test]
fn a_set_of_before_after_a_cut_is_answered_while_the_shaft_turns() {
    let ignites = |cut: u64, rpm: f64| {
        let story = flight(AMT, 40.0).turbine(38.0, 40.8, Phase::Cooling, rpm, 500.0);
        let story = story.wire(40.1, 45.0, IDLE).mark(40.8, Mark::Ignition).with(|h| {
            (h.rules.boot, h.rules.stale, h.rules.serial_delay) = (1900 * MS, 1, 4 * SECOND);
            h.unpowered = Spans::from(&[(38_000 * MS, 38_050 * MS)]);
            h.mute = Spans::from(&[(37_900 * MS, cut * MS)]);
            h.frames.retain(|frame| !(38 * SECOND..40_100 * MS).contains(&frame.at));
        });
        story.finds(Rule::Ignition)
    };
    assert_eq!(
        [(40_000, 30_000.0), (40_400, 30_000.0), (40_000, 2000.0)].map(|(cut, rpm)| ignites(cut, rpm)),
        [false, true, true]
    );
}

#[test]
fn the_pwm_input_is_given_the_engine_on_a_pilots_command() {
    let pwm = Sent::Full(Switch::Pwm, 0);
    let story = || ready(ZK5).wire(4.0, 10.0, pwm).turbine(5.0, 10.0, Phase::Standby, 0.0, 15.0);
    story().once(PILOT, 4.0, PilotCommand::Pwm).passes();
    story().breaks(&[Rule::Pwm]);
    story().once(2, 4.0, PilotCommand::Pwm).breaks(&[Rule::Pwm]);
    let disarmed = |h: &mut History| h.commanded.retain(|commanded| commanded.command != PilotCommand::Arm);
    story().once(PILOT, 4.0, PilotCommand::Pwm).with(disarmed).breaks(&[Rule::Pwm]);
    // A higher source's standby cancels it, unless a still higher one commands otherwise.
    let taken =
        |pilot: usize| story().once(pilot, 4.0, PilotCommand::Pwm).once(1, 5.0, PilotCommand::Standby);
    let by_third =
        |h: &mut History| h.commanded.iter_mut().filter(|c| c.at < 4 * SECOND).for_each(|c| c.source = 2);
    taken(2).with(by_third).breaks(&[Rule::Pwm]);
    let otherwise = PilotCommand::Run(Demanded::Throttle(400));
    taken(2).with(by_third).streams(0, 4.5, 10.0, otherwise).passes();
    // One that is refused changes nothing (843002133), and is none itself.
    story().once(PILOT, 4.0, PilotCommand::Pwm).once(2, 6.0, PilotCommand::Pwm).passes();
    story()
        .with(disarmed)
        .once(PILOT, 4.0, PilotCommand::Pwm)
        .once(2, 6.0, PilotCommand::Pwm)
        .breaks(&[Rule::Pwm]);
    // For one life of the ECU.
    let dip = |h: &mut History| h.unpowered = Spans::from(&[(6 * SECOND, 7 * SECOND)]);
    story().once(PILOT, 4.0, PilotCommand::Pwm).with(dip).breaks(&[Rule::Pwm]);
}

/// An engine that burns again on an earlier order is no longer sent run.
#[test]
fn an_engine_that_burns_again_is_not_sent_run() {
    let beside =
        [Rule::Ignition, Rule::RunAtRest, Rule::Doubt, Rule::GivenUp, Rule::HeldDown, Rule::ShutDown];
    let run = |tenths| PilotCommand::Run(Demanded::Throttle(tenths));
    // Its ECU lost its power for less than a gap, and starts it again from the beginning.
    let again = |ends: f64| {
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 50.0, run(500))
            .turbine(40.0, 50.0, Phase::Ignition, 6000.0, 300.0)
            .mark(40.1, Mark::Ignition)
            .wire(40.0, ends, HALF)
            .wire(ends, 50.0, STANDBY)
    };
    again(41.7).breaks_beside(&beside, &[]);
    again(44.0).breaks_beside(&beside, &[Rule::SecondLife]);
    // Not after a start of its own.
    let start = |h: &mut History| {
        let own = [(39_900 * MS, PilotCommand::Standby), (39_950 * MS, run(0))];
        h.commanded.extend(own.map(|(at, command)| Commanded { at, source: PILOT, command }));
    };
    again(44.0).with(start).breaks_beside(&beside, &[]);
    // A restart by the ECU without a gap is not another life either.
    let relit = |h: &mut History| {
        h.marks.iter_mut().filter(|(at, _)| *at > 40 * SECOND).for_each(|(_, m)| *m = Mark::Relight)
    };
    again(44.0).with(relit).breaks_beside(&beside, &[]);
    // After a gap it is.
    let cut = |h: &mut History| h.mute = Spans::from(&[(40 * SECOND, 41 * SECOND)]);
    again(44.0).with(relit).with(cut).breaks_beside(&beside, &[Rule::SecondLife]);
    again(42.0).with(relit).with(cut).breaks_beside(&beside, &[]);
    // In a start: a gap, a reset, two error sets.
    let start = |kind, ends: f64| {
        ready(kind)
            .streams(PILOT, 4.0, 20.0, run(0))
            .wire(4.0, ends, IDLE)
            .wire(ends, 20.0, STANDBY)
            .mark(5.0, Mark::Ignition)
            .turbine(5.0, 20.0, Phase::FuelRamp, 8000.0, 300.0)
    };
    let cut = |h: &mut History| h.mute = Spans::from(&[(10 * SECOND, 11 * SECOND)]);
    for kind in [AMT, ZK5] {
        start(kind, 12.0).with(cut).breaks_beside(&beside, &[]);
        start(kind, 15.0).with(cut).breaks_beside(&beside, &[Rule::SecondLife]);
        start(kind, 15.0).breaks_beside(&beside, &[]);
    }
    // Where stale reports come first, those after the gap may be of an engine that ran before its ECU lit it again (852001357).
    let ran = |lasts: u64| {
        start(ZK5, 15.0).with(cut).with(|h| h.rules.stale = 1).with(move |h| {
            let runs = 10_500 * MS..11 * SECOND + lasts * MS;
            for sample in h.samples.iter_mut().filter(|sample| runs.contains(&sample.at)) {
                (sample.phase, sample.rpm) = (Phase::Running, 50_000.0);
            }
        })
    };
    ran(600).breaks_beside(&beside, &[]);
    ran(100).breaks_beside(&beside, &[Rule::SecondLife]);
    let reset = |h: &mut History| {
        h.resets.push(Reset { down: 10_900 * MS, up: 11 * SECOND, cause: Cause::Watchdog });
    };
    start(ZK5, 12.2).with(reset).breaks_beside(&beside, &[]);
    start(ZK5, 15.0).with(reset).breaks_beside(&beside, &[Rule::SecondLife]);
    let faults = |h: &mut History| {
        h.samples
            .iter_mut()
            .filter(|s| s.at >= 10 * SECOND && s.at < 12 * SECOND)
            .for_each(|s| s.fault = true);
    };
    start(AMT, 10.6).with(faults).breaks_beside(&beside, &[]);
    start(AMT, 12.0).with(faults).breaks_beside(&beside, &[Rule::SecondLife]);
    start(ZK5, 12.0).with(faults).breaks_beside(&beside, &[]);
    // A node that has lost its memory takes a start for a running engine (842001636).
    let forgot =
        |cause| move |h: &mut History| h.resets.push(Reset { down: 8 * SECOND, up: 8_100 * MS, cause });
    start(AMT, 12.0).with(faults).with(forgot(Cause::PowerOn)).breaks_beside(&beside, &[]);
    start(AMT, 12.0).with(faults).with(forgot(Cause::Watchdog)).breaks_beside(&beside, &[Rule::SecondLife]);
}

/// An outage in a start, at 100 Hz. A frame that no ECU sent may report the slowest rate, with which no frame is missing yet (880001572).
#[test]
fn a_gap_begins_later_where_a_forged_frame_may_report_a_slower_rate() {
    let late = |rule: Rule, forged: Option<u64>, until: f64| {
        ready(ZK5)
            .with(|h| h.rules.period = 10 * MS)
            .streams(PILOT, 4.0, 8.0, PilotCommand::Run(Demanded::Throttle(0)))
            .wire(4.0, until, IDLE)
            .wire(until, 8.0, STANDBY)
            .mark(4.1, Mark::Ignition)
            .turbine(5.0, 8.0, Phase::Standby, 0.0, 15.0)
            .with(move |h| {
                let lit = h.samples.iter_mut().filter(|s| (4100 * MS..4200 * MS).contains(&s.at));
                lit.for_each(|sample| (sample.phase, sample.lit) = (Phase::Ignition, true));
                h.unpowered = Spans::from(&[(4200 * MS, 4280 * MS)]);
                h.rules.boot = 30 * MS;
                h.forged.extend(forged.map(|at| at * MS));
            })
            .finds(rule)
    };
    for rule in [Rule::RunAtRest, Rule::Doubt] {
        let cases = [(Some(3950), 4.36), (None, 4.36), (Some(3100), 4.36), (None, 4.25)];
        let found = cases.map(|(forged, until)| late(rule, forged, until));
        assert_eq!(found, [false, true, true, false], "{rule:?}");
    }
}

#[test]
fn a_start_of_a_zk_engine_ends_after_its_time() {
    let run = PilotCommand::Run(Demanded::Throttle(0));
    let story = |time: u64| {
        started(ZK5)
            .turbine(RUNS as f64, 32.0, Phase::Running, 60_000.0, 500.0)
            .with(move |h| h.rules.start_timeout = time * SECOND)
    };
    let late = |story: Story| story.finds(Rule::RunAtRest);
    assert!(!late(story(30)) && late(story(10)));
    // A restart by the ECU in flight has the same time; a flight has none.
    let relit = |time: u64, relight: bool| {
        let story = flight(Kind::Zk(3), 40.0)
            .streams(PILOT, 40.0, 120.0, run)
            .wire(40.0, 120.0, IDLE)
            .turbine(40.0, 120.0, Phase::FuelRamp, 40_000.0, 400.0)
            .with(move |h| h.rules.start_timeout = time * SECOND);
        if relight { story.mark(40.0, Mark::Relight) } else { story }
    };
    assert!(late(relit(60, true)) && !late(relit(60, false)) && !late(relit(100, true)));
    // Twice that of the start before, of 25 s, where it is reported: also if what goes out meanwhile is not run.
    let again = |version, relit: f64, until: f64| {
        flight(Kind::Zk(version), relit)
            .streams(PILOT, relit, until, run)
            .wire(relit, until, Sent::Nothing)
            .turbine(relit, until, Phase::Ignition, 8000.0, 100.0)
            .mark(relit, Mark::Relight)
            .turbine(until, until + 10.0, Phase::Stopped, 0.0, 20.0)
            .says("no standby")
    };
    assert!(again(5, 40.0, 110.0) && !again(5, 40.0, 95.0));
    assert!(!again(3, 40.0, 150.0) && again(3, 40.0, 180.0));
}
