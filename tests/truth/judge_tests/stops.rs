//! Histories by hand for the judge's rules: stops, fuel, and frames that may be on the wire at all.

use super::*;

#[test]
fn an_engine_that_is_shut_down_goes_out() {
    let story = |out: f64| {
        flight(ZK5, 60.0)
            .wire(60.0, 90.0, STANDBY)
            .turbine(60.0, out, Phase::Running, 60_000.0, 480.0)
            .turbine(out, 90.0, Phase::Cooling, 5000.0, 300.0)
    };
    let by_command = |command, out| story(out).once(PILOT, 60.0, command);
    by_command(PilotCommand::ShutDown, 60.2).passes();
    by_command(PilotCommand::ShutDown, 66.0).breaks(&[Rule::Obeyed]);
    let second = |h: &mut History| h.frames.retain(|f| !(micros(60.0)..micros(60.15)).contains(&f.at));
    let by_stream = |out| story(out).streams(PILOT, 60.0, 90.0, PilotCommand::Standby).with(second);
    by_stream(60.3).passes();
    by_stream(80.0).breaks(&[Rule::Obeyed]);
    // A lower source's, when the stages of loss have run out.
    let by_lower = |out| story(out).streams(2, 60.0, 90.0, PilotCommand::Standby).wire(60.0, 67.0, IDLE);
    let waits = |story: Story| {
        story.with(|h| h.frames.retain(|f| f.sent != STANDBY || f.at < 60 * SECOND || f.at > 68 * SECOND))
    };
    waits(by_lower(68.1)).passes();
    waits(by_lower(85.0)).breaks(&[Rule::Obeyed]);
    // The time restarts for a source that commanded nothing meanwhile.
    let again = |until| {
        flight(ZK5, 60.0)
            .streams(2, 60.0, 62.0, PilotCommand::Standby)
            .streams(2, 62.0, 86.0, PilotCommand::Nothing)
            .streams(2, 86.0, until, PilotCommand::Standby)
            .wire(60.0, 110.0, IDLE)
            .turbine(60.0, 110.0, Phase::Running, 60_000.0, 480.0)
    };
    again(86.3).breaks_beside(&[Rule::SilentTurbine], &[]);
    again(110.0).breaks_beside(&[Rule::SilentTurbine], &[Rule::Obeyed]);
    let stopped =
        |h: &mut History| h.frames.iter_mut().filter(|f| f.at >= 60 * SECOND).for_each(|f| f.sent = STOP);
    by_command(PilotCommand::Stop, 60.2).with(stopped).passes();
    by_command(PilotCommand::Stop, 66.0).with(stopped).breaks(&[Rule::Obeyed]);
    // Of a node that had only just begun, too, and a moment later.
    let begun = |h: &mut History| {
        h.resets.push(Reset { down: 59_700 * MS, up: 59_800 * MS, cause: Cause::PowerOn });
        h.frames.retain(|frame| !(59_700 * MS..60_000 * MS).contains(&frame.at));
    };
    by_command(PilotCommand::Stop, 61.8).with(stopped).with(begun).passes();
    by_command(PilotCommand::Stop, 66.0).with(stopped).with(begun).breaks(&[Rule::Obeyed]);
    // The wire to it is cut.
    let cut = |h: &mut History| h.deaf = Spans::from(&[(59 * SECOND, 90 * SECOND)]);
    by_command(PilotCommand::ShutDown, 66.0).with(cut).passes();
}

/// 866001255: a transmitter that hangs sends no stop, until a reset frees it.
#[test]
fn a_stop_is_in_every_slot_but_of_a_transmitter_that_hangs() {
    let misses = |reset: bool| {
        let story = flight(ZK5, 40.0).once(PILOT, 40.0, PilotCommand::Stop).wire(40.02, 50.0, STOP);
        let story = story.turbine(40.0, 50.0, Phase::Stopped, 5000.0, 300.0).with(|h| {
            let (hangs, freed) = (44 * SECOND, 45_500 * MS);
            h.deaf = Spans::from(&[(hangs, freed)]);
            h.frames.retain(|frame| !(hangs..freed).contains(&frame.at));
            if reset {
                h.resets.push(Reset { down: freed - 30 * MS, up: freed, cause: Cause::Watchdog });
            }
        });
        story.finds(Rule::Stop)
    };
    assert_eq!([true, false].map(misses), [false, true]);
}

/// Whether a stop at 40 s is over at 45 s, when standby follows it on the wire: its release is streamed from 43 s to `until`.
fn is_released(until: f64, change: impl FnOnce(&mut History)) -> bool {
    let story = flight(ZK5, 40.0)
        .once(2, 40.0, PilotCommand::Stop)
        .streams(2, 43.0, until, PilotCommand::Release)
        .wire(40.02, 45.0, STOP)
        .wire(45.0, 50.0, STANDBY)
        .turbine(40.0, 50.0, Phase::Cooling, 5000.0, 400.0)
        .with(change);
    !story.finds(Rule::Stop)
}

/// While the ECU is silent a release does not count. A frame that no ECU sent is one to the node.
#[test]
fn a_release_counts_after_a_frame_that_nobody_sent() {
    let released = |forged: bool| {
        is_released(46.0, |h| {
            h.mute = Spans::from(&[(40 * SECOND, 50 * SECOND)]);
            h.forged.extend(forged.then_some(44_990 * MS));
        })
    };
    assert!(released(true) && !released(false));
}

/// 11700047: it counts from the first report on, which comes with the end of what an ECU takes at most to begin.
#[test]
fn a_release_counts_right_after_the_first_report() {
    let released = |booted: f64| {
        is_released(45.0, |h| {
            h.unpowered = Spans::from(&[(40 * SECOND, micros(booted) - h.rules.boot)]);
        })
    };
    assert!(released(44.901) && !released(44.903) && !released(46.0));
}

#[test]
fn a_stop_is_in_every_frame_until_its_release() {
    let story = |kind, sent: Sent| {
        flight(kind, 40.0)
            .once(2, 40.0, PilotCommand::Stop)
            .wire(40.1, 45.0, STOP)
            .wire(45.0, 45.2, sent)
            .wire(45.2, 50.0, STOP)
            .turbine(40.0, 50.0, Phase::Stopped, 0.0, 400.0)
    };
    for kind in [AMT, ZK5] {
        story(kind, STOP).passes();
        story(kind, STANDBY).breaks(&[Rule::Stop]);
    }
    // One frame to close the pump counts as a stop, two consecutive ones do not.
    let close = |times: f64| {
        let gone = move |h: &mut History| {
            let closes = 45 * SECOND..micros(45.0 + times * 0.05);
            h.frames.retain(|f| f.sent == Sent::Action(13) || !closes.contains(&f.at));
        };
        story(ZK5, STOP).wire(45.0, 45.0 + times * 0.05, Sent::Action(13)).with(gone)
    };
    close(1.0).passes();
    close(3.0).breaks(&[Rule::Stop]);
    // And not before the first stop.
    let first = |from: f64| {
        let shift = move |h: &mut History| h.frames.retain(|f| f.sent != STOP || f.at > micros(from));
        story(ZK5, STOP).wire(40.05, 40.06, Sent::Action(13)).with(shift)
    };
    first(40.0).with(|h| h.frames.retain(|f| f.sent != Sent::Action(13))).passes();
    first(40.1).breaks(&[Rule::Stop]);
    // Nor before the first frame of another stop, if a stop was not the last frame before it.
    let again = |between| {
        flight(ZK5, 40.0)
            .once(2, 40.0, PilotCommand::Stop)
            .wire(40.1, 44.0, STOP)
            .turbine(40.0, 50.0, Phase::Stopped, 0.0, 400.0)
            .once(2, 44.0, PilotCommand::Release)
            .wire(44.0, 45.0, between)
            .once(2, 45.02, PilotCommand::Stop)
            .wire(45.04, 45.05, Sent::Action(13))
            .wire(45.05, 50.0, STOP)
    };
    again(STOP).passes();
    again(STANDBY).breaks(&[Rule::Stop]);
}

#[test]
fn nothing_old_goes_out_after_a_transmitter_stood_still() {
    let story = |frames: u64| {
        let story = flight(ZK5, 40.0).streams(PILOT, 40.0, 41.0, PilotCommand::Run(Demanded::Throttle(500)));
        story.wire(40.0, 41.0, HALF).turbine(40.0, 41.5, Phase::Running, 100_000.0, 500.0).with(|h| {
            h.deaf = Spans::from(&[(39_500 * MS, 40_001 * MS)]);
            h.stalls = vec![40_001 * MS];
            let frame = h.frames[0];
            h.frames.extend((0..frames).map(|n| Frame { at: 40_002 * MS + n * 4 * MS, sent: HALF, ..frame }));
        })
    };
    story(1).passes();
    story(8).breaks(&[Rule::Frame]);
}

#[test]
fn a_stop_is_on_the_wire_at_once_and_at_every_slot() {
    let story = |kind, from: f64, gap: f64| {
        flight(kind, 40.0)
            .once(2, 40.0, PilotCommand::Stop)
            .wire(40.0 + from, 42.0, STOP)
            .wire(42.0 + gap, 50.0, STOP)
            .turbine(40.0, 50.0, Phase::Stopped, 0.0, 400.0)
    };
    story(ZK5, 0.05, 0.0).passes();
    story(ZK5, 0.4, 0.0).breaks(&[Rule::Stop]);
    story(ZK5, 0.05, 1.0).breaks(&[Rule::Stop]);
    story(AMT, 0.1, 1.0).breaks(&[Rule::Stop]);
    // A ZK ECU that is not received is sent all the same; an AMT ECU that reports nothing cannot be answered.
    let mute = |h: &mut History| h.mute = Spans::from(&[(41 * SECOND, 44 * SECOND)]);
    story(ZK5, 0.05, 1.0).with(mute).breaks(&[Rule::Stop]);
    story(AMT, 0.1, 1.0).with(mute).passes();
    // After a reset, too.
    let reset = |h: &mut History| {
        h.resets.push(Reset { down: 42 * SECOND, up: 42_500 * MS, cause: Cause::Watchdog });
    };
    story(ZK5, 0.05, 0.6).with(reset).passes();
    story(ZK5, 0.05, 6.0).with(reset).breaks(&[Rule::Stop]);
    // Nothing leaves a transmitter that hangs. With a cut wire, the frames are sent nevertheless.
    let deaf = |h: &mut History| h.deaf = Spans::from(&[(42 * SECOND, 43 * SECOND)]);
    let stall = |h: &mut History| h.stalls = vec![43 * SECOND];
    story(ZK5, 0.05, 1.0).with(deaf).with(stall).passes();
    story(ZK5, 0.05, 1.0).with(deaf).breaks(&[Rule::Stop]);
    story(ZK5, 0.05, 1.5).with(deaf).with(stall).breaks(&[Rule::Stop]);
}

#[test]
fn no_fuel_flows_into_a_hot_engine_at_rest() {
    let story = |egt| Story::new(ZK5).turbine(0.0, 10.0, Phase::Cooling, 5000.0, egt).fuel(4.0, 6.0);
    story(60.0).passes();
    story(300.0).breaks(&[Rule::HotFuel]);
}

#[test]
fn services_that_move_fuel_are_commanded_in_standby_cold_and_armed() {
    let pump = Sent::Action(5);
    let story = |command| ready(ZK5).once(PILOT, 2.0, command).wire(2.05, 2.06, pump).wire(4.0, 5.0, STANDBY);
    story(PilotCommand::Service(5)).passes();
    story(PilotCommand::Service(4)).breaks(&[Rule::Service]);
    let disarmed = |h: &mut History| h.commanded.retain(|commanded| commanded.command != PilotCommand::Arm);
    story(PilotCommand::Service(5)).with(disarmed).breaks(&[Rule::Service]);
    let cooling = |h: &mut History| h.samples.iter_mut().for_each(|sample| sample.phase = Phase::Cooling);
    story(PilotCommand::Service(5)).with(cooling).breaks(&[Rule::Service]);
    let hot = |h: &mut History| h.samples.iter_mut().for_each(|sample| sample.egt = 130.0);
    story(PilotCommand::Service(5)).with(hot).breaks(&[Rule::Service]);
    // With a higher source that streams commands; a single order to shut down is not a stream.
    let behind = |streams: f64| {
        let long = |h: &mut History| h.rules.ages = [10 * SECOND; 4];
        ready(ZK5)
            .streams(PILOT, 3.0, 11.0, PilotCommand::Standby)
            .streams(0, 4.0, streams, PilotCommand::Standby)
            .once(0, 9.0, PilotCommand::ShutDown)
            .once(PILOT, 10.0, PilotCommand::Service(5))
            .wire(4.0, 10.0, STANDBY)
            .wire(10.05, 10.06, pump)
            .wire(10.1, 12.0, STANDBY)
            .turbine(3.0, 12.0, Phase::Standby, 0.0, 15.0)
            .with(long)
    };
    behind(4.3).passes();
    behind(8.0).breaks(&[Rule::Service]);
    // That one commanded the same in the same slot, or long before (853000234).
    let too = |at| behind(8.0).once(0, at, PilotCommand::Service(5));
    too(9.98).passes();
    too(9.5).breaks(&[Rule::Service]);
    // Its hand-over does not keep a source in control that streams no more (853001882).
    let after = |command| {
        let age = |h: &mut History| {
            h.rules.ages[0] = SECOND;
            h.commanded.retain(|it| it.source != 0 || it.command != PilotCommand::ShutDown);
        };
        behind(8.8).with(age).once(0, 9.5, command)
    };
    after(PilotCommand::Pwm).passes();
    after(PilotCommand::Standby).breaks(&[Rule::Service]);
}

#[test]
fn an_open_pump_is_closed_when_its_source_falls_silent_and_at_a_disarm() {
    let story = |commanding: f64, flows: f64| {
        Story::new(ZK5)
            .once(PILOT, 0.5, PilotCommand::Arm)
            .streams(PILOT, 0.0, commanding, PilotCommand::Standby)
            .once(PILOT, 2.0, PilotCommand::Service(12))
            .wire(0.0, 2.0, STANDBY)
            .wire(2.05, 2.06, Sent::Action(12))
            .wire(2.1, 40.0, STANDBY)
            .turbine(0.0, 60.0, Phase::Standby, 0.0, 15.0)
            .fuel(2.1, flows)
    };
    story(20.0, 21.0).passes();
    story(5.0, 20.0).breaks(&[Rule::Pump]);
    story(20.0, 12.0).once(PILOT, 10.0, PilotCommand::Disarm).passes();
    story(20.0, 16.0).once(PILOT, 10.0, PilotCommand::Disarm).breaks(&[Rule::Pump]);
    // Also where nothing is received of the ECU; not where nothing reaches it.
    let cut = |wire: fn(&mut History) -> &mut Spans, flows: f64| {
        story(20.0, flows)
            .once(PILOT, 10.0, PilotCommand::Disarm)
            .with(move |h| *wire(h) = Spans::from(&[(9 * SECOND, 30 * SECOND)]))
    };
    cut(|h| &mut h.mute, 12.0).passes();
    assert!(cut(|h| &mut h.mute, 16.0).finds(Rule::Pump) && !cut(|h| &mut h.deaf, 16.0).finds(Rule::Pump));
    // Its bound in time.
    story(50.0, 50.0).breaks(&[Rule::Pump]);
    // Ten frames that are all lost close nothing; the next disarm does.
    let lost_by = |by: PilotCommand, frames: u64, again: f64, flows: f64| {
        let closing = 10.05 + 0.1 * frames as f64;
        story(35.0, flows).once(PILOT, 10.0, by).once(PILOT, again, PilotCommand::Disarm).with(move |h| {
            h.frames.retain(|frame| !(micros(10.05)..micros(closing)).contains(&frame.at));
            h.deaf = Spans::from(&[(micros(10.04), micros(closing))]);
            let sent = Sent::Action(13);
            let at = (0..frames).map(|each| micros(10.05) + each * 100 * MS);
            h.frames.extend(at.map(|at| Frame { at, arrived: false, sent }));
        })
    };
    let lost = |frames, again, flows| lost_by(PilotCommand::Disarm, frames, again, flows);
    lost(10, 25.0, 26.0).passes();
    lost(10, 25.0, 30.0).breaks(&[Rule::Pump]);
    lost(9, 25.0, 26.0).breaks(&[Rule::Pump]);
    lost(10, 25.0, 26.0)
        .with(|h| h.frames.iter_mut().for_each(|frame| frame.arrived = true))
        .breaks(&[Rule::Pump]);
    // They may have been those of a standby (881001287), after which the bound in time sends none.
    let standby = |frames, flows| lost_by(PilotCommand::Standby, frames, 45.0, flows);
    standby(10, 44.0).passes();
    standby(9, 44.0).breaks(&[Rule::Pump]);
}

#[test]
fn nothing_is_sent_that_the_ecus_version_does_not_know() {
    let story = |kind, sent| ready(kind).wire(4.0, 5.0, sent);
    let by_id6 = |switch| Sent::Mode(Some(switch), 0);
    story(Kind::Zk(4), by_id6(Switch::Standby)).passes();
    story(Kind::Zk(3), by_id6(Switch::Standby)).passes();
    for sent in [Sent::Rpm(60_000), Sent::Mode(None, 3)] {
        story(Kind::Zk(4), sent).passes();
        story(Kind::Zk(3), sent).breaks(&[Rule::Version]);
    }
    // Another ECU was plugged in while the line was dead.
    let story =
        ready(Kind::Zk(5)).wire(4.0, 20.0, Sent::Mode(None, 3)).turbine(5.0, 20.0, Phase::Standby, 0.0, 15.0);
    let swapped = |h: &mut History| {
        h.unpowered = Spans::from(&[(6 * SECOND, 9 * SECOND)]);
        h.versions = vec![(6 * SECOND, 3)];
    };
    story.with(swapped).breaks(&[Rule::Version]);
}

#[test]
fn every_frame_is_one_of_the_document() {
    ready(AMT).wire(4.0, 4.1, Sent::Bad([0xFF, 0x14, 0x20, 0x14, 0x21])).breaks(&[Rule::Frame]);
}

/// A source that commands every 0.4 s, with a timeout of 0.5 s, and is the only one.
#[test]
fn two_standbys_within_two_periods_of_a_slow_source_shut_down() {
    let story = |apart: f64, other: bool, returns_within: u64| {
        let mut story =
            started(ZK5).turbine(RUNS as f64, 70.0, Phase::Running, 60_000.0, 400.0).wire(31.0, 70.0, IDLE);
        for n in 0..78 {
            story = story.once(PILOT, 31.0 + 0.4 * f64::from(n), PilotCommand::Run(Demanded::Throttle(0)));
        }
        let story =
            story.once(PILOT, 62.2, PilotCommand::Standby).once(PILOT, 62.2 + apart, PilotCommand::Standby);
        let story = if other {
            story.streams(0, 50.0, 70.0, PilotCommand::Run(Demanded::Throttle(0)))
        } else {
            story
        };
        let story = story.with(|h| h.rules.return_within = returns_within);
        story.says("within two periods")
    };
    assert!(story(0.75, false, SECOND) && !story(0.9, false, SECOND) && !story(0.75, true, SECOND));
    // It was lost in between (208).
    assert!(!story(0.75, false, 200 * MS));
}
