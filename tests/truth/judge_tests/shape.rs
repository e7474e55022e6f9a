//! Histories by hand for the judge's rules: the shape of a demand, and orders that last.

use super::*;
use crate::faults::{Fault, write_down};
use sim::turbine::EgtSensor;

fn run(tenths: u32) -> PilotCommand {
    PilotCommand::Run(Demanded::Throttle(tenths))
}

fn sent(tenths: u32) -> Sent {
    Sent::Full(Switch::Run, tenths)
}

fn runs(story: Story, until: f64) -> Story {
    story.turbine(40.0, until, Phase::Running, 100_000.0, 500.0)
}

#[test]
fn a_starting_engine_gets_the_throttle_of_a_start() {
    let story = |tenths| {
        ready(ZK5)
            .streams(PILOT, 4.0, 10.0, run(0))
            .streams(PILOT, 10.0, 20.0, run(600))
            .wire(4.0, 12.0, IDLE)
            .wire(12.0, 20.0, sent(tenths))
            .mark(5.0, Mark::Ignition)
            .turbine(5.0, 20.0, Phase::FuelRamp, 20_000.0, 400.0)
    };
    story(0).passes();
    story(600).breaks_beside(&[], &[Rule::Rate]);
}

/// An ECU that begins again right after a flame-out has the previous demand, even if damaged frames hid the flame-out.
#[test]
fn a_start_that_nobody_could_see_beginning_has_the_demand_of_before() {
    let throttled = |noise: [u64; 2]| {
        let story = runs(flight(ZK5, 40.0), 41.0)
            .streams(PILOT, 40.0, 52.0, run(500))
            .wire(40.0, 52.0, HALF)
            .turbine(41.0, 48.5, Phase::Cooling, 30_000.0, 400.0)
            .mark(48.5, Mark::Ignition)
            .turbine(48.5, 52.0, Phase::FuelRamp, 20_000.0, 400.0)
            .with(move |h| h.noise = Spans::from(&[(noise[0] * SECOND, noise[1] * SECOND)]));
        !story.finds(Rule::Rate)
    };
    assert!(throttled([42, 44]));
    assert!(!throttled([41, 42]), "it was seen for 6 s");
    assert!(!throttled([20, 22]));
}

#[test]
fn after_a_gap_a_demand_does_not_jump() {
    let story = |jumps: bool| {
        let story = runs(flight(ZK5, 40.0), 50.0)
            .streams(PILOT, 40.0, 40.5, run(500))
            .streams(PILOT, 40.5, 50.0, run(1000))
            .wire(40.0, 40.2, HALF)
            .with(|h| h.mute = Spans::from(&[(40 * SECOND, 41 * SECOND)]));
        match jumps {
            true => story.wire(41.5, 50.0, sent(1000)),
            false => story.ramp(41.5, 500, 1000).wire(42.6, 50.0, sent(1000)),
        }
    };
    story(false).passes();
    story(true).breaks(&[Rule::Rate]);
}

#[test]
fn a_demand_falls_at_its_rate_where_one_is_set() {
    let story = |slew| {
        runs(flight(ZK5, 40.0), 50.0)
            .streams(PILOT, 40.0, 50.0, run(200))
            .wire(40.0, 50.0, sent(200))
            .with(move |h| h.rules.slew_down = slew)
    };
    story(None).passes();
    story(Some(200)).breaks(&[Rule::Rate]);
    // A limit may lower it while the thermocouple is broken: also before it broke a second time, until both are over.
    let broken = |from: f64| {
        story(Some(200)).with(|h| {
            h.rules.limit_egt = Some((600.0, false));
            write_down(h, Fault::Sensor(EgtSensor::Open), micros(40.5), micros(41.5));
            write_down(h, Fault::Sensor(EgtSensor::Open), micros(from), micros(45.0));
            assert_eq!(h.sensor, Spans::from(&[(micros(from), micros(45.0))]));
        })
    };
    broken(39.5).passes();
    broken(40.4).breaks(&[Rule::Rate]);
}

#[test]
fn a_lost_demand_does_not_rise() {
    let story = |again| {
        runs(flight(ZK5, 40.0), 50.0)
            .streams(PILOT, 48.0, 50.0, run(1000))
            .ramp(41.5, 500, 0)
            .wire(40.0, 41.5, HALF)
            .wire(42.6, again, IDLE)
            .ramp(again, 0, 300)
    };
    // It has to be received for 1 s before it is in control again.
    story(49.2).passes();
    story(48.2).breaks(&[Rule::SilentWire]);
    story(46.0).breaks(&[Rule::SilentWire]);
    // A source that is present is not lost.
    story(48.2).streams(PILOT, 40.0, 48.0, PilotCommand::Nothing).passes();
}

#[test]
fn an_engine_that_is_not_received_gets_standby_in_silence() {
    let story = |from: f64| {
        runs(flight(ZK5, 40.0), 70.0)
            .wire(40.0, from, Sent::Nothing)
            .wire(from, 70.0, STANDBY)
            .with(|h| h.mute = Spans::from(&[(40 * SECOND, 70 * SECOND)]))
    };
    let beside = [Rule::SilentTurbine, Rule::ShutDown, Rule::Obeyed];
    story(52.0).breaks_beside(&beside, &[]);
    story(69.0).breaks_beside(&beside, &[Rule::SilentWire]);
}

#[test]
fn a_stop_does_not_wait_for_a_slot() {
    let story = |from: f64| {
        flight(ZK5, 40.0)
            .once(2, 40.0, PilotCommand::Stop)
            .wire(40.0 + from, 45.0, STOP)
            .turbine(40.0, 45.0, Phase::Stopped, 0.0, 400.0)
            .with(|h| h.rules.frame = 10 * MS)
    };
    story(0.01).passes();
    story(0.04).breaks(&[Rule::Stop]);
    // Not where a stop is in every slot already.
    story(0.04)
        .with(|h| h.frames.retain(|frame| frame.at < 39 * SECOND || frame.sent == STOP))
        .wire(39.0, 39.04, STOP)
        .breaks_beside(&[Rule::ShutDown], &[]);
}

#[test]
fn a_stop_is_not_released_in_flight_or_with_the_stick_up() {
    let story = |phase, stick: Option<u32>| {
        let story = flight(ZK5, 40.0)
            .once(PILOT, 40.0, PilotCommand::Stop)
            .wire(40.05, 45.0, STOP)
            .once(PILOT, 45.0, PilotCommand::Release)
            .wire(45.05, 50.0, STANDBY)
            .turbine(40.0, 50.0, phase, 100_000.0, 400.0);
        match stick {
            Some(tenths) => story.streams(PILOT, 44.0, 45.0, run(tenths)),
            None => story,
        }
    };
    story(Phase::Stopped, None).passes();
    story(Phase::Stopped, Some(0)).passes();
    story(Phase::Stopped, Some(500)).breaks(&[Rule::Stop]);
    story(Phase::Running, None).breaks_beside(&[Rule::Obeyed], &[Rule::Stop]);
    let lost = |h: &mut History| h.mute = Spans::from(&[(41 * SECOND, 47 * SECOND)]);
    story(Phase::Stopped, None).with(lost).breaks(&[Rule::Stop]);
}

#[test]
fn service_needs_the_active_source_and_a_settled_line() {
    let story = || {
        ready(ZK5)
            .once(3, 11.0, PilotCommand::Service(5))
            .wire(4.0, 12.0, STANDBY)
            .wire(11.05, 11.06, Sent::Action(5))
            .turbine(5.0, 12.0, Phase::Standby, 0.0, 15.0)
    };
    story().passes();
    story().streams(PILOT, 4.0, 12.0, PilotCommand::Standby).breaks(&[Rule::Service]);
    let gap = |until: u64| move |h: &mut History| h.mute = Spans::from(&[(9 * SECOND, until * MS)]);
    story().with(gap(10_200)).passes();
    story().with(gap(10_800)).breaks(&[Rule::Service]);
    story().with(gap(11_800)).breaks(&[Rule::Service]);
}

#[test]
fn what_was_shut_down_stays_so_over_a_reset() {
    let story = |cause, after: Sent| {
        runs(flight(ZK5, 40.0), 60.0)
            .once(PILOT, 40.0, PilotCommand::ShutDown)
            .wire(40.05, 45.0, STANDBY)
            .wire(46.0, 60.0, after)
            .with(move |h| {
                h.deaf = Spans::from(&[(39 * SECOND, 60 * SECOND)]);
                h.resets.push(Reset { down: 45 * SECOND, up: 45_100 * MS, cause });
            })
    };
    story(Cause::Watchdog, STANDBY).passes();
    story(Cause::Watchdog, IDLE).breaks_beside(&[Rule::Doubt], &[Rule::Obeyed]);
    story(Cause::PowerOn, IDLE).breaks_beside(&[Rule::Doubt], &[]);
}

#[test]
fn ctf_is_not_taken_back_by_a_demand() {
    let story = |last: Sent| {
        runs(flight(AMT, 40.0), 43.0)
            .once(PILOT, 40.0, PilotCommand::Ctf)
            .streams(PILOT, 40.0, 43.0, run(500))
            .wire(40.0, 41.0, Sent::Ctf)
            .wire(41.0, 43.0, last)
    };
    story(Sent::Ctf).passes();
    story(HALF).breaks(&[Rule::Obeyed]);
}

#[test]
fn a_start_of_an_amt_engine_ends_after_its_time() {
    let story = |time| {
        started(AMT)
            .turbine(RUNS as f64, 32.0, Phase::Running, 36_000.0, 500.0)
            .with(move |h| h.rules.start_timeout = time * SECOND)
    };
    story(30).passes();
    story(10).breaks_beside(&[Rule::Ignition], &[Rule::RunAtRest]);
}

/// A source that takes its start back and starts again in one slot has another one, with a time of its own (897001242). One word alone is none.
#[test]
fn a_start_that_is_renewed_in_one_slot_has_its_time_anew() {
    let story = |words: &'static [(f64, PilotCommand)]| {
        let story = started(AMT)
            .turbine(RUNS as f64, 32.0, Phase::Running, 36_000.0, 500.0)
            .with(|h| h.rules.start_timeout = 20 * SECOND);
        let story = words.iter().fold(story, |story, (at, command)| story.once(PILOT, *at, *command));
        story.finds(Rule::RunAtRest)
    };
    const RENEWED: [(f64, PilotCommand); 2] =
        [(13.03, PilotCommand::Standby), (13.04, PilotCommand::Run(Demanded::Throttle(0)))];
    assert!(story(&[]) && story(&RENEWED[1..]));
    assert!(!story(&RENEWED));
}

/// The slew applies to the commanded rpm; a governor's throttle has a rate of its own.
#[test]
fn a_governors_throttle_has_no_slew() {
    let story = |command| {
        runs(started(AMT), 60.0)
            .turbine(RUNS as f64, 40.0, Phase::Running, 100_000.0, 500.0)
            .streams(PILOT, 31.0, 60.0, command)
            .ramp(31.0, 0, 300)
            .wire(33.0, 60.0, sent(300))
            .with(|h| (h.rules.governor, h.rules.slew_up) = (true, Some(100)))
    };
    story(PilotCommand::Run(Demanded::Rpm(100_000))).passes();
    story(run(300)).breaks(&[Rule::Rate]);
}

/// Another ECU was plugged in, which holds a speed itself: the governor that is configured for the first one has no part in it.
#[test]
fn a_speed_that_the_ecu_holds_is_not_from_a_governor() {
    let rpm = |rpm| PilotCommand::Run(Demanded::Rpm(rpm));
    let story = |moves: f64| {
        runs(started(ZK5), 60.0)
            .turbine(RUNS as f64, 40.0, Phase::Running, 100_000.0, 500.0)
            .streams(PILOT, 31.0, moves, rpm(60_000))
            .streams(PILOT, moves, 60.0, rpm(120_000))
            .wire(31.0, 50.0, Sent::Rpm(60_000))
            .wire(50.0, 60.0, Sent::Rpm(120_000))
            .with(|h| h.rules.governor = true)
    };
    // The stick moves, and the demand with it; without the stick it does not.
    story(50.0).passes();
    story(48.0).breaks_beside(&[Rule::HeldDown], &[Rule::Rate]);
    story(50.0).with(|h| h.rules.slew_up = Some(100)).breaks(&[Rule::Rate]);
    // A governor's throttle does not jump with the stick.
    runs(started(AMT), 60.0)
        .turbine(RUNS as f64, 40.0, Phase::Running, 100_000.0, 500.0)
        .streams(PILOT, 31.0, 50.0, rpm(60_000))
        .streams(PILOT, 50.0, 60.0, rpm(120_000))
        .wire(31.0, 50.0, IDLE)
        .wire(50.0, 60.0, HALF)
        .with(|h| h.rules.governor = true)
        .breaks(&[Rule::Rate]);
}

/// 1000036: a forged set delays the ECU's own one on the wire, and the reply to that is late. What it lowered was never in force.
#[test]
fn a_reply_after_a_forged_set_lowers_nothing() {
    let story = |forged: bool| {
        runs(flight(AMT, 40.0), 50.0)
            .streams(PILOT, 40.0, 50.0, run(500))
            .wire(40.0, 45.0, HALF)
            .wire(45.0, 45.1, IDLE)
            .wire(45.125, 50.0, HALF)
            .with(move |h| h.forged.extend(forged.then_some(44_990 * MS)))
    };
    story(true).breaks_beside(&[Rule::HeldDown], &[]);
    story(false).breaks_beside(&[Rule::HeldDown], &[Rule::Rate]);
    // A governor begins with the throttle that the ECU reports in the second set, the one sent before the
    // doubt.
    let governed = |rpm: u32, forged: u64| {
        runs(started(AMT), 60.0)
            .turbine(RUNS as f64, 40.0, Phase::Running, 100_000.0, 500.0)
            .streams(PILOT, 31.0, 60.0, PilotCommand::Run(Demanded::Rpm(rpm)))
            .ramp(31.0, 0, 300)
            .wire(32.0, 50.0, sent(300))
            .wire(50.0, 50.2, IDLE)
            .wire(50.25, 60.0, sent(300))
            .with(move |h| h.forged.push(forged * MS))
            .with(|h| h.rules.governor = true)
    };
    governed(100_000, 49_950).passes();
    governed(100_000, 49_750).breaks(&[Rule::Rate]);
}

/// 760001859: the wire to the ECU is cut, and the node is reset. The replies until then did not reach the ECU, which reports its throttle.
#[test]
fn after_a_reset_a_governor_begins_with_the_throttle_that_reached_the_ecu() {
    let story = |reset: bool, lost: bool, then| {
        runs(started(AMT), 50.0)
            .turbine(RUNS as f64, 40.0, Phase::Running, 100_000.0, 500.0)
            .streams(PILOT, 31.0, 50.0, PilotCommand::Run(Demanded::Rpm(100_000)))
            .ramp(31.0, 0, 300)
            .wire(32.0, 44.0, sent(300))
            .wire(44.0, 45.0, IDLE)
            .wire(45.2, 50.0, sent(then))
            .with(move |h| {
                h.rules.governor = true;
                let unheard = h.frames.iter_mut().filter(|frame| lost && frame.at >= 44 * SECOND);
                unheard.for_each(|frame| frame.arrived = false);
                let (down, up) = (45_050 * MS, 45_070 * MS);
                h.resets.extend(reset.then_some(Reset { down, up, cause: Cause::Watchdog }));
            })
            .finds(Rule::Rate)
    };
    assert!(!story(true, true, 300));
    assert!(story(true, true, 500), "more than the ECU has");
    assert!(story(true, false, 300), "the ECU was sent idle");
    assert!(story(false, true, 300), "nothing forgot it");
}

#[test]
fn after_a_transmitter_that_hung_a_demand_may_still_rise() {
    let story = |hung: bool| {
        runs(flight(ZK5, 40.0), 52.0)
            .streams(PILOT, 40.0, 52.0, run(1000))
            .wire(40.0, 49.0, HALF)
            .ramp(50.0, 500, 1000)
            .wire(51.1, 52.0, sent(1000))
            .with(move |h| {
                h.deaf = Spans::from(&[(40 * SECOND, 50 * SECOND)]);
                if hung {
                    h.frames.retain(|frame| !(40 * SECOND..50 * SECOND).contains(&frame.at));
                    h.stalls = vec![50 * SECOND];
                }
            })
    };
    story(true).passes();
    story(false).breaks(&[Rule::HeldDown]);
}

#[test]
fn a_governor_gives_no_more_than_it_may() {
    let story = |tenths| {
        runs(started(AMT), 60.0)
            .turbine(RUNS as f64, 40.0, Phase::Running, 100_000.0, 500.0)
            .streams(PILOT, 31.0, 60.0, PilotCommand::Run(Demanded::Rpm(100_000)))
            .ramp(31.0, 0, tenths)
            .wire(34.0, 60.0, sent(tenths))
            .with(|h| (h.rules.governor, h.rules.authority) = (true, 600))
    };
    story(600).passes();
    story(700).breaks(&[Rule::HeldUp]);
    let over = |story: Story| story.finds(Rule::HeldUp);
    assert!(over(story(700)));
    // A node that forgets its command continues with the throttle that it finds.
    for (cause, passes) in [(Cause::BrownOut, true), (Cause::Watchdog, false)] {
        let reset = move |at: u64| Reset { down: at, up: at + 100 * MS, cause };
        // Before the frames above the authority, and again and again.
        let resets =
            move |h: &mut History| h.resets = (31..60).step_by(5).map(|s| reset(s * SECOND)).collect();
        assert_eq!(over(story(700).with(resets)), !passes, "{cause:?}");
    }
    // An rpm is refused while no speed is reported, and the throttle before it stays in force (841001943).
    let refused = |from: u64| {
        move |h: &mut History| {
            let before = h.commanded.iter_mut().filter(|c| c.at < 45 * SECOND && c.command.is_rpm());
            before.for_each(|c| c.command = PilotCommand::Run(Demanded::Throttle(700)));
            h.samples.iter_mut().filter(|s| s.at >= from * SECOND).for_each(|s| s.fault = true);
        }
    };
    assert!(!over(story(700).with(refused(44))));
    assert!(over(story(700).with(refused(46))));
    // The previous throttle of a source that has left does not count either, while an rpm waits to take over.
    let waits = |h: &mut History| {
        let before = |commanded: &mut Commanded| {
            if commanded.at < 51_800 * MS && commanded.command.is_rpm() {
                commanded.command = PilotCommand::Run(Demanded::Throttle(700));
            }
        };
        h.commanded.iter_mut().for_each(before);
        h.commanded.retain(|commanded| !(51_800 * MS..54 * SECOND).contains(&commanded.at));
    };
    assert!(!over(story(700).with(waits)));
}

#[test]
fn what_a_limit_lowered_stays_low_over_a_reset() {
    let story = |after| {
        flight(ZK5, 40.0)
            .streams(PILOT, 40.0, 60.0, run(500))
            .turbine(40.0, 50.0, Phase::Running, 100_000.0, 700.0)
            .turbine(50.0, 60.0, Phase::Running, 60_000.0, 500.0)
            .wire(40.0, 43.0, HALF)
            .ramp(43.0, 500, 0)
            .wire(44.1, 52.0, IDLE)
            .wire(53.0, 60.0, after)
            .with(|h| {
                h.rules.limit_egt = Some((620.0, false));
                h.resets.push(Reset { down: 52 * SECOND, up: 52_100 * MS, cause: Cause::Watchdog });
            })
    };
    story(IDLE).passes();
    story(HALF).breaks_beside(&[Rule::Rate], &[Rule::Limit]);
}

/// A correct engine does not stay beyond its limit: it exceeds the limit only for the time of two values, and the demand is
/// lowered with it.
#[test]
fn what_a_limit_lowered_stays_low_when_the_value_is_within_it_again() {
    let story = |passed: f64, rises: f64| {
        let story = runs(flight(ZK5, 40.0), 60.0)
            .streams(PILOT, 40.0, 60.0, run(500))
            .turbine(41.0, 41.0 + passed, Phase::Running, 100_000.0, 640.0)
            .wire(40.0, 41.5, HALF)
            .ramp(41.5, 500, 0)
            .wire(42.6, rises, IDLE)
            .with(|h| h.rules.limit_egt = Some((620.0, false)));
        if rises < 60.0 { story.ramp(rises, 0, 500).wire(rises + 1.1, 60.0, HALF) } else { story }
    };
    story(1.2, 60.0).passes();
    story(1.2, 50.0).breaks(&[Rule::Limit]);
    // One value does not count.
    story(0.3, 50.0).passes();
    // A source's standby ends it.
    story(1.2, 50.0).once(2, 49.0, PilotCommand::Standby).passes();
    // An order that is given up takes it along: no set was answered, for whatever reason (710001951).
    let unanswered = |kind, seconds: core::ops::Range<u64>| {
        story(1.2, 50.0).with(move |h| {
            h.rules.kind = kind;
            h.frames.retain(|frame| !seconds.contains(&(frame.at / SECOND)));
        })
    };
    let finds = |kind, seconds| unanswered(kind, seconds).finds(Rule::Limit);
    assert_eq!(
        [42..44, 43..46, 46..49, 46..47].map(|seconds| finds(AMT, seconds)),
        [false, false, false, true]
    );
    assert!(finds(ZK5, 46..49));
    // The last reply was sent just before the limit was exceeded (852000775).
    let last_reply = |until: u64| {
        story(1.2, 50.0).with(move |h| {
            h.rules.kind = AMT;
            h.frames.retain(|frame| !(40_900 * MS..until * MS).contains(&frame.at));
        })
    };
    assert!(!last_reply(43_400).finds(Rule::Limit) && last_reply(41_500).finds(Rule::Limit));
}

#[test]
fn a_flame_that_goes_out_and_a_hot_start_have_the_action_of_their_limit() {
    let flame_out = |standby: f64, limit| {
        runs(flight(ZK5, 40.0), 41.0)
            .streams(PILOT, 40.0, 46.0, run(500))
            .wire(40.0, standby, HALF)
            .wire(standby, 46.0, STANDBY)
            .turbine(41.0, 43.0, Phase::Running, 60_000.0, 400.0)
            .turbine(43.0, 46.0, Phase::Running, 38_000.0, 300.0)
            .with(move |h| {
                h.rules.limit_flame = limit;
                h.samples.iter_mut().filter(|s| s.at >= 41 * SECOND).for_each(|s| s.lit = false);
            })
    };
    let beside = [Rule::RunAtRest, Rule::ShutDown, Rule::Obeyed];
    flame_out(42.9, Some(true)).breaks_beside(&beside, &[]);
    flame_out(45.5, Some(true)).breaks_beside(&beside, &[Rule::Limit]);
    flame_out(45.5, None).breaks_beside(&beside, &[]);
    // A demand that sinks in steps of 0.2 % explains the fall.
    let sinks = |h: &mut History| {
        let frames =
            h.frames.iter_mut().filter(|frame| frame.at > 36 * SECOND && frame.sent == HALF).enumerate();
        for (at, frame) in frames {
            frame.sent = Sent::Full(Switch::Run, 500_u32.saturating_sub(2 * at as u32).max(400));
        }
    };
    let limits = |story: Story| story.finds(Rule::Limit);
    assert!(!limits(flame_out(45.5, Some(true)).with(sinks)));
    // A reset counts if it is recent, or if other settings came with it.
    let reset = |at: u64, other: bool| {
        limits(flame_out(45.5, Some(true)).with(move |h| {
            h.resets.push(Reset { down: at * SECOND, up: at * SECOND + 20 * MS, cause: Cause::Watchdog });
            h.other_settings.extend(other.then_some(at * SECOND + 20 * MS));
        }))
    };
    assert!(reset(33, false) && !reset(39, false) && !reset(33, true));
    assert!(limits(flame_out(45.5, Some(true))));
    // So does one that sank in such steps and has risen again since (710000398); one that rises explains nothing.
    let moves = |tenths: fn(u32) -> u32| {
        let moved = move |h: &mut History| {
            let frames = h.frames.iter_mut().filter(|frame| frame.at > 40 * SECOND && frame.sent == HALF);
            (0..).zip(frames).for_each(|(at, frame)| frame.sent = Sent::Full(Switch::Run, tenths(at)));
        };
        flame_out(45.5, Some(true)).with(moved)
    };
    assert!(!limits(moves(|at| 500 - 2 * at.min(20_u32.saturating_sub(at)))));
    assert!(limits(moves(|at| 500 + 2 * at.min(20))));
    let hot = |standby: f64, limit| {
        ready(AMT)
            .streams(PILOT, 4.0, 12.0, run(0))
            .wire(4.0, standby, IDLE)
            .wire(standby, 12.0, STANDBY)
            .mark(5.0, Mark::Ignition)
            .turbine(5.0, 12.0, Phase::FuelRamp, 20_000.0, 100.0)
            .with(move |h| {
                h.rules.limit_hot = limit;
                for sample in h.samples.iter_mut().filter(|s| s.at >= 8 * SECOND) {
                    sample.egt = 100.0 + 270.0 * ((sample.at - 8 * SECOND) as f64 / SECOND as f64).min(2.5);
                }
            })
    };
    hot(9.5, Some(true)).breaks_beside(&beside, &[]);
    hot(11.5, Some(true)).breaks_beside(&beside, &[Rule::Limit]);
    hot(11.5, None).breaks_beside(&beside, &[]);
}

#[test]
fn a_demand_moves_at_its_rate_in_all_and_not_from_frame_to_frame() {
    // Frames of a fifth of the time that one may have been reckoned before it began.
    let rises = |rate: u32| {
        let mut story = runs(started(ZK5), 50.0)
            .turbine(RUNS as f64, 40.0, Phase::Running, 100_000.0, 500.0)
            .streams(PILOT, 20.0, 50.0, run(800))
            .with(|h| {
                h.rules.period = 10 * MS;
                h.commanded.retain(|commanded| commanded.at < 20 * SECOND || commanded.command != run(0));
            });
        for step in 0..1900_u32 {
            let at = 31.0 + f64::from(step) / 100.0;
            story = story.wire(at, at + 0.005, sent((rate * step / 100).min(800)));
        }
        story
    };
    rises(500).passes();
    rises(1000).breaks(&[Rule::Rate]);
    let falls = |rate: u32| {
        let mut story = runs(flight(ZK5, 40.0), 50.0)
            .streams(PILOT, 40.0, 50.0, run(0))
            .with(|h| (h.rules.slew_down, h.rules.period) = (Some(200), 10 * MS));
        for step in 0..1000_u32 {
            let at = 40.0 + f64::from(step) / 100.0;
            story = story.wire(at, at + 0.005, sent(500_u32.saturating_sub(rate * step / 100)));
        }
        story
    };
    falls(200).passes();
    assert!(falls(400).finds(Rule::Rate));
    // A lost demand that creeps up.
    let creeps = |per_second: u32| {
        let mut story = runs(flight(ZK5, 40.0), 41.9).with(|h| h.rules.hold = 8 * SECOND);
        for step in 0..90_u32 {
            let at = 40.0 + f64::from(step) / 50.0;
            story = story.wire(at, at + 0.005, sent(500 + per_second * step / 50));
        }
        story
    };
    creeps(0).passes();
    // In a silence that is shorter than the stages of loss, too.
    creeps(40).breaks(&[Rule::SilentWire]);
}
