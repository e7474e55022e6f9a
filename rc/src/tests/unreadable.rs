//! The pilot with a whole engine, where a channel cannot be read: implausible values, outputs that nobody drives, two receivers on one
//! line, a broken wire. All of it is silence, but for a stop that is held.

use super::world::*;
use crate::pilot::{Ignored, Outcome};
use crate::settings::EngineSettings;
use embassy_time::{Instant, Timer};
use jetlink::command::Command;
use jetlink::engine::state::EngineState;
use jetlink::event::LossStage;

#[test]
fn implausible_values_are_silence() {
    for kind in Kind::ALL {
        for (stick, switch, why) in [
            (900, RUN, Ignored::Throttle),
            (2100, RUN, Ignored::Throttle),
            (1500, 1350, Ignored::BetweenPositions),
            (1500, 1650, Ignored::BetweenPositions),
        ] {
            run(kind, async |world| {
                world.start_to_half().await;
                world.radio.stick.set(stick);
                world.radio.switch.set(switch);
                world.until("the first stage", 2, || world.telemetry().loss == LossStage::Hold).await;
                assert_eq!(world.outcomes.borrow().last().map(|(_, o)| *o), Some(Outcome::Ignored(why)));
                assert_eq!(world.ordered(), Some(500));
                world.until("fail-safe throttle", 10, || world.ordered() == Some(0)).await;
                assert_eq!(world.state(), EngineState::Running);
                world.radio.stick.set(1500);
                world.radio.switch.set(RUN);
                world.rises_to(500).await;
            });
        }
    }
}

/// Stick beyond its end points, or hand-over channel between two positions: the switch at stop still stops, once held for 0.3 s.
#[test]
fn stop_counts_beside_a_channel_that_cannot_be_read() {
    for kind in Kind::ALL {
        for stick in [900, 2100] {
            run(kind, async |world| {
                world.start_to_half().await;
                world.radio.stick.set(stick);
                // But not an intermittent one.
                world.radio.switch.set(STOP);
                Timer::after_millis(250).await;
                world.radio.switch.set(RUN);
                Timer::after_millis(150).await;
                assert!(!world.telemetry().stop_latched, "{kind:?}, {stick}");
                world.radio.switch.set(STOP);
                world.until("a stop", 1, || world.telemetry().stop_latched).await;
            });
        }
    }
}

/// The throttle's wire is loose: frames in which it can be read alternate with those in which it cannot, for less than 0.3 s each. The switch
/// is at stop in all of them. The control: the switch at standby.
#[test]
fn stop_counts_beside_a_channel_that_can_be_read_now_and_then() {
    for kind in Kind::ALL {
        for (switch, stops) in [(STOP, true), (STANDBY, false)] {
            run(kind, async |world| {
                world.start_to_half().await;
                for readable in [false, true].repeat(4) {
                    world.radio.switch.set(switch);
                    world.radio.stick.set(if readable { 1500 } else { 900 });
                    Timer::after_millis(250).await;
                }
                assert_eq!(world.telemetry().stop_latched, stops, "{kind:?}, {switch}");
            });
        }
    }
}

/// A link at the end of its range: frames for less than 0.3 s, and none for longer than a gap. Stop in all that is received is obeyed after
/// 0.6 s of frames. The control: every second burst has the switch at run, which keeps the engine running.
#[test]
fn stop_counts_in_bursts_of_frames() {
    for kind in Kind::ALL {
        for (others, stops) in [(STOP, true), (RUN, false)] {
            run(kind, async |world| {
                world.start_to_half().await;
                for switch in [STOP, others].repeat(8) {
                    world.radio.on.set(false);
                    Timer::after_millis(400).await;
                    world.radio.switch.set(switch);
                    world.radio.on.set(true);
                    Timer::after_millis(250).await;
                }
                assert_eq!(world.telemetry().stop_latched, stops, "{kind:?}, {others}");
            });
        }
    }
}

/// A starting autopilot sends 881 µs on all outputs.
#[test]
fn outputs_that_nobody_drives_are_not_a_stop() {
    for kind in Kind::ALL {
        run(kind, async |world| {
            world.start().await;
            world.radio.stick.set(881);
            world.radio.switch.set(881);
            world.until("the first stage", 2, || world.telemetry().loss == LossStage::Hold).await;
            Timer::after_secs(2).await;
            assert!(!world.telemetry().stop_latched);
            assert_eq!(world.state(), EngineState::Running);
        });
    }
}

/// The same with end points so low that 881 µs is within the range of the throttle: the autopilot restarts in flight.
#[test]
fn outputs_that_nobody_drives_are_not_a_stop_with_end_points_of_1000_us_either() {
    for (kind, reversed) in [(Kind::Sbus, false), (Kind::Crsf, false), (Kind::Pwm, false), (Kind::Sbus, true)]
    {
        begin(kind, async |radio, plug, halves| {
            let settings = EngineSettings { low: 1000, high: 2000, reversed, ..kind.settings() };
            let (idle, half) = (if reversed { 2000 } else { 1000 }, 1500);
            life(&Life { radio, plug, memory: None, settings }, halves, async |world| {
                radio.stick.set(idle);
                world.pass_s(2.0).await;
                world.standby_by(STANDBY).await;
                world.run_by(RUN).await;
                world.radio.stick.set(half);
                world.until("half throttle", 10, || world.ordered() == Some(500)).await;
                autopilot_restarts(world).await;
                assert!(!world.telemetry().stop_latched, "{kind:?}, reversed {reversed}");
                assert!(world.ordered().is_some_and(|throttle| throttle <= 500));
                // A stop sent by a transmitter counts, also beside the lowest possible stick.
                world.radio.switch.set(STOP);
                world.until("a stop", 1, || world.telemetry().stop_latched).await;
            })
            .await;
        });
    }
}

/// 800 to 2200 µs are accepted, so an end point may be anywhere in between, also where a starting autopilot has its outputs: then those are a
/// stick at idle and a switch at stop, and stop the engine. docs/rc.md states from which end point on they do not.
#[test]
fn outputs_that_nobody_drives_are_not_a_stop_from_an_end_point_of_892_us_on() {
    for (low, stops) in [(800, true), (888, true), (891, true), (892, false), (900, false)] {
        begin(Kind::Pwm, async |radio, plug, halves| {
            let settings = EngineSettings { low, ..Kind::Pwm.settings() };
            life(&Life { radio, plug, memory: None, settings }, halves, async |world| {
                radio.stick.set(low);
                world.pass_s(2.0).await;
                world.standby_by(STANDBY).await;
                world.run_by(RUN).await;
                world.radio.stick.set(low.midpoint(1900));
                world.until("half throttle", 10, || world.ordered().is_some_and(|order| order >= 495)).await;
                autopilot_restarts(world).await;
                assert_eq!(world.telemetry().stop_latched, stops, "{low} µs");
            })
            .await;
        });
    }
}

/// Two receivers alternate on one line, one at full throttle: this is no signal, and the stages of loss follow. A stop from
/// either one counts.
#[test]
fn two_receivers_on_one_line_are_silence_and_either_one_stops() {
    each(async |world| {
        world.start().await;
        world.radio.stick.set(1300);
        world.until("a quarter", 5, || world.ordered() == Some(250)).await;
        world.radio.second.set(Some((1900, RUN)));
        world.pass_s(0.2).await;
        let from = Instant::now();
        world.outcomes.borrow_mut().clear();
        world.until("lost", 2, || world.telemetry().loss == LossStage::Hold).await;
        world.until("idle", 10, || world.ordered() == Some(0)).await;
        let moved =
            |(_, outcome): &(Instant, Outcome)| matches!(outcome, Outcome::Commanded(Command::Run(_), _));
        assert!(!world.outcomes.borrow().iter().any(moved), "since {from}");
        // One of them is unplugged: the stick takes over from the present demand.
        world.radio.second.set(None);
        world.pass_s(2.0).await;
        assert_eq!(world.ordered(), Some(0));
        world.radio.stick.set(IDLE);
        world.pass_s(1.0).await;
        world.radio.stick.set(1500);
        world.until("half throttle", 5, || world.ordered() == Some(500)).await;
        world.radio.second.set(Some((1900, STOP)));
        world.until("stop", 1, || world.telemetry().stop_latched).await;
    });
}

/// They have alternated for a while when one of the two moves to stop. Servo pulses are left out: each channel has a wire of its own.
#[test]
fn a_stop_counts_beside_another_receiver_that_was_there_before() {
    for (kind, of_the_second) in
        [(Kind::Sbus, false), (Kind::Sbus, true), (Kind::Crsf, false), (Kind::Crsf, true)]
    {
        run(kind, async |world| {
            world.start().await;
            world.radio.stick.set(1300);
            world.radio.second.set(Some((1900, RUN)));
            world.pass_s(3.0).await;
            // A moment is not enough.
            let to_stop = |stop: bool| {
                let position = if stop { STOP } else { RUN };
                if of_the_second {
                    world.radio.second.set(Some((1900, position)));
                } else {
                    world.radio.switch.set(position);
                }
            };
            to_stop(true);
            world.pass_s(0.2).await;
            to_stop(false);
            world.pass_s(1.0).await;
            assert!(!world.telemetry().stop_latched);
            to_stop(true);
            world.until("a stop", 1, || world.telemetry().stop_latched).await;
        });
    }
}

#[test]
fn a_wire_of_pulses_that_breaks_is_silence() {
    for wire in [1, 2, 3] {
        run(Kind::Pwm, async |world| {
            world.start_to_half().await;
            world.radio.cut.set(wire);
            world.until("fail-safe throttle", 10, || world.ordered() == Some(0)).await;
            assert_eq!(world.telemetry().loss, LossStage::FailSafe);
            assert!(world.pilot.borrow().counters().silent > 10);
            world.radio.cut.set(0);
            world.rises_to(500).await;
        });
    }
}

/// An autopilot restarts in flight: 2 s without frames, then 2 s with outputs that nobody drives.
async fn autopilot_restarts(world: &World<'_>) {
    world.radio.plugged.set(false);
    world.pass_s(2.0).await;
    world.radio.plugged.set(true);
    for output in [&world.radio.stick, &world.radio.switch, &world.radio.hand_over] {
        output.set(881);
    }
    world.pass_s(2.0).await;
}
