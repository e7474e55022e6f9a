//! Radio control of a whole engine: what starts it, what stops it, and what does neither.

use super::world::*;
use crate::outputs::Valve;
use crate::pilot::Outcome;
use crate::settings::EngineSettings;
use embassy_time::{Duration, Instant};
use jetlink::command::{Accepted, Command, Interlock, Order, Ordered, Origin, Rejected};
use jetlink::engine::retained::Reset;
use jetlink::engine::state::EngineState;
use jetlink::event::LossStage;
use std::vec::Vec;

#[test]
fn switch_arms_starts_throttles_and_shuts_down() {
    each(async |world| {
        world.start().await;
        assert_eq!((world.ordered(), world.ignitions()), (Some(0), 1));
        world.radio.stick.set(1500);
        world.until("half throttle", 5, || world.ordered() == Some(500)).await;
        world.radio.stick.set(1900);
        world.until("full throttle", 5, || world.ordered() == Some(1000)).await;
        world.radio.stick.set(IDLE);
        world.until("idle", 5, || world.ordered() == Some(0)).await;
        world.radio.switch.set(STANDBY);
        world.until("standby", 2, || world.telemetry().ordered.order == Order::Standby).await;
        assert_eq!(world.telemetry().ordered.origin, Origin::Rc);
        assert!(world.telemetry().armed, "a shut-down does not disarm");
    });
}

/// Every position of the switch at power-up, with every stick: nothing starts, whatever the stick does then.
#[test]
fn position_at_power_up_starts_nothing() {
    for kind in Kind::ALL {
        for switch in [STOP, STANDBY, RUN] {
            for stick in [IDLE, 1500, 1900] {
                run(kind, async |world| {
                    world.radio.switch.set(switch);
                    world.radio.stick.set(stick);
                    world.pass_s(20.0).await;
                    world.radio.stick.set(IDLE);
                    world.pass_s(5.0).await;
                    world.radio.stick.set(1900);
                    world.pass_s(5.0).await;
                    assert_eq!(world.ignitions(), 0);
                    assert!(!world.telemetry().armed && world.ordered().is_none());
                    assert_eq!(world.telemetry().stop_latched, switch == STOP);
                });
            }
        }
    }
}

/// Control of the next two tests: the same moves with frames received throughout do start.
#[test]
fn move_from_standby_to_run_starts_only_with_the_stick_at_idle_and_steady() {
    each(async |world| {
        world.arm().await;
        for stick in [1500, 1900, 1140] {
            world.radio.stick.set(stick);
            world.pass_s(2.0).await;
            world.switch(RUN).await;
            assert!(world.outcomes.borrow().iter().any(|(_, o)| *o == Outcome::NotSteady), "{stick}");
            world.pass_s(3.0).await;
            // Bringing the stick to idle afterwards is no start.
            world.radio.stick.set(IDLE);
            world.pass_s(3.0).await;
            assert_eq!((world.ignitions(), world.ordered()), (0, None), "{stick}");
            world.switch(STANDBY).await;
            world.outcomes.borrow_mut().clear();
        }
        // Moved down 0.2 s before the switch: not steady.
        world.radio.stick.set(1500);
        world.pass_s(1.0).await;
        world.radio.stick.set(IDLE);
        world.pass_s(0.2).await;
        world.switch(RUN).await;
        world.pass_s(3.0).await;
        assert_eq!(world.ordered(), None);
        assert!(world.pilot.borrow().counters().starts_refused >= 4);
        world.switch(STANDBY).await;
        world.switch(RUN).await;
        assert_eq!(world.ordered(), Some(0));
    });
}

/// The switch is at standby, steady and armed, and then it is another channel that is at run.
#[test]
fn another_channel_for_the_switch_is_not_a_move() {
    for kind in Kind::ALL {
        begin(kind, async |radio, plug, halves| {
            let other = kind.settings().hand_over;
            let settings = EngineSettings { hand_over: 0, ..kind.settings() };
            life(&Life { radio, plug, memory: None, settings }, halves, async |world| {
                world.radio.hand_over.set(RUN);
                world.arm().await;
                let settings = EngineSettings { switch: other, ..settings };
                world.pilot.borrow_mut().configure(settings).unwrap();
                world.pass_s(5.0).await;
                assert_eq!((world.ignitions(), world.ordered()), (0, None), "{kind:?}");
                // The control: the same channel does start when it moves.
                world.radio.hand_over.set(STANDBY);
                world.pass_s(2.0).await;
                world.radio.hand_over.set(RUN);
                world.until("a start", 2, || world.ordered() == Some(0)).await;
            })
            .await;
        });
    }
}

/// Before the end of a calibration it is not known where idle is.
#[test]
fn move_right_after_a_calibration_starts_nothing() {
    for (after, starts) in [(0.05, false), (1.1, true)] {
        each(async |world| {
            world.arm().await;
            world.pass_s(15.0).await;
            world.pilot.borrow_mut().begin_calibration().unwrap();
            for stick in [1000, 2000, 1000] {
                world.radio.stick.set(stick);
                world.pass_s(2.0).await;
            }
            world.pilot.borrow_mut().end_calibration().unwrap();
            world.pass_s(after).await;
            world.switch(RUN).await;
            world.pass_s(2.0).await;
            assert_eq!(world.ordered(), starts.then_some(0), "{after} s");
        });
    }
}

/// Within 1 s after a gap nothing counts as a move, however steady standby and stick were meanwhile.
#[test]
fn move_right_after_a_gap_starts_nothing() {
    for (after, starts) in [(0.55, false), (1.1, true)] {
        each(async |world| {
            world.arm().await;
            world.pass_s(15.0).await;
            world.radio.on.set(false);
            world.pass_s(1.0).await;
            world.radio.on.set(true);
            world.pass_s(after).await;
            world.switch(RUN).await;
            world.pass_s(2.0).await;
            assert_eq!(world.ordered(), starts.then_some(0), "{after} s");
        });
    }
}

#[test]
fn receiver_plugged_in_with_full_throttle_neither_starts_nor_jumps() {
    each(async |world| {
        world.radio.plugged.set(false);
        world.radio.switch.set(RUN);
        world.radio.stick.set(1900);
        world.pass_s(30.0).await;
        world.radio.plugged.set(true);
        world.pass_s(30.0).await;
        assert_eq!((world.ignitions(), world.ordered()), (0, None));
        // The same in flight.
        world.start().await;
        world.radio.stick.set(1300);
        world.until("25 %", 5, || world.ordered() == Some(250)).await;
        world.radio.plugged.set(false);
        world.pass_s(1.2).await;
        assert_eq!((world.telemetry().loss, world.ordered()), (LossStage::Hold, Some(250)));
        world.until("fail-safe throttle", 10, || world.ordered() == Some(0)).await;
        world.radio.stick.set(1900);
        world.pass_s(20.0).await;
        assert_eq!((world.telemetry().loss, world.state()), (LossStage::FailSafe, EngineState::Running));
        world.radio.plugged.set(true);
        world.rises_to(1000).await;
        assert_eq!((world.telemetry().loss, world.ignitions()), (LossStage::None, 1));
    });
}

#[test]
fn transmitter_that_is_off_is_silence() {
    each(async |world| {
        world.start().await;
        world.radio.stick.set(1900);
        world.until("full throttle", 5, || world.ordered() == Some(1000)).await;
        world.radio.on.set(false);
        let off = Instant::now();
        // The receiver's fail-safe frames also have other values.
        world.radio.switch.set(STOP);
        world.until("the first stage", 2, || world.telemetry().loss == LossStage::Hold).await;
        let after = Instant::now() - off;
        assert!(after >= Duration::from_millis(480) && after < Duration::from_millis(560), "{after:?}");
        world.until("fail-safe throttle", 10, || world.ordered() == Some(0)).await;
        world.pass_s(60.0).await;
        assert_eq!(world.state(), EngineState::Running, "at idle until its fuel is used up");
        world.radio.switch.set(RUN);
        world.radio.on.set(true);
        world.rises_to(1000).await;
    });
}

/// After a gap only a held stop counts as a position.
#[test]
fn positions_found_after_a_gap_shut_nothing_down_but_stop_does() {
    each(async |world| {
        world.start().await;
        world.radio.on.set(false);
        world.pass_s(3.0).await;
        world.radio.switch.set(STANDBY);
        world.radio.on.set(true);
        world.pass_s(5.0).await;
        assert_eq!(world.commanded(), Some(Command::Present));
        assert_eq!((world.state(), world.ordered()), (EngineState::Running, Some(0)));
        // The pilot moves it, and it is accepted.
        world.switch(RUN).await;
        world.radio.stick.set(1500);
        world.until("half throttle", 5, || world.ordered() == Some(500)).await;
        // Stop for 0.2 s after a gap, as a starting receiver may send it: no stop.
        world.radio.on.set(false);
        world.pass_s(1.0).await;
        world.radio.switch.set(STOP);
        world.radio.on.set(true);
        world.pass_s(0.25).await;
        world.radio.switch.set(RUN);
        world.pass_s(5.0).await;
        assert_eq!((world.state(), world.ordered()), (EngineState::Running, Some(500)));
        // Nor twice, with a gap between.
        for _ in 0..2 {
            world.radio.on.set(false);
            world.pass_s(1.0).await;
            world.radio.switch.set(STOP);
            world.radio.on.set(true);
            world.pass_s(0.25).await;
        }
        world.radio.switch.set(RUN);
        world.pass_s(2.0).await;
        assert!(!world.telemetry().stop_latched);
        // Held, it is a stop.
        world.radio.on.set(false);
        world.pass_s(1.0).await;
        world.radio.switch.set(STOP);
        world.radio.on.set(true);
        world.until("stop", 1, || world.telemetry().stop_latched).await;
    });
}

/// In contrast to a stop, which counts at once: see the next test.
#[test]
fn standby_counts_once_it_has_been_held_for_60_ms() {
    each(async |world| {
        world.start_to_half().await;
        // The median of three adds a frame at the beginning, and one at the end.
        world.radio.switch.set(STANDBY);
        world.pass_s(0.05).await;
        world.radio.switch.set(RUN);
        world.pass_s(1.0).await;
        assert_eq!((world.state(), world.ordered()), (EngineState::Running, Some(500)));
        world.radio.switch.set(STANDBY);
        world.pass_s(0.15).await;
        assert_eq!(world.telemetry().ordered.order, Order::Standby);
    });
}

/// A stop is latched, and the receiver pauses: a standby found after the pause is not a move from stop, however long it is held.
#[test]
fn standby_found_after_a_gap_releases_and_arms_nothing() {
    each(async |world| {
        world.arm().await;
        world.switch(STOP).await;
        assert!(world.telemetry().stop_latched && !world.telemetry().armed);
        world.radio.on.set(false);
        world.pass_s(1.0).await;
        world.radio.switch.set(STANDBY);
        world.radio.on.set(true);
        world.pass_s(10.0).await;
        assert!(world.telemetry().stop_latched && !world.telemetry().armed);
        // Control: a received move does both.
        world.switch(STOP).await;
        world.pass_s(1.0).await;
        world.radio.switch.set(STANDBY);
        world.until("released", 30, || !world.telemetry().stop_latched && world.telemetry().armed).await;
    });
}

#[test]
fn stop_is_latched_closes_the_valve_and_is_released_by_the_move_to_standby() {
    each(async |world| {
        world.start_to_half().await;
        world.radio.switch.set(STOP);
        let stop = Instant::now();
        world.until("stop", 1, || world.telemetry().stop_latched).await;
        let (at, valve) = *world.valve.borrow().last().unwrap();
        assert_eq!(valve, Valve::Closed);
        // With the second such frame it is the median of three.
        assert!(at - stop <= Duration::from_millis(45), "{:?}", at - stop);
        assert!(!world.telemetry().armed && world.outputs.borrow().power(), "the starter cools it");
        // Standby with the stick up releases nothing; nor does run.
        world.switch(STANDBY).await;
        world.pass_s(5.0).await;
        assert!(world.telemetry().stop_latched);
        world.switch(STOP).await;
        world.pass_s(60.0).await;
        world.switch(RUN).await;
        world.radio.stick.set(IDLE);
        world.pass_s(5.0).await;
        assert!(world.telemetry().stop_latched);
        // Run to standby does not release.
        world.switch(STANDBY).await;
        world.pass_s(5.0).await;
        assert!(world.telemetry().stop_latched);
        world.switch(STOP).await;
        world.radio.switch.set(STANDBY);
        world
            .until("released and armed", 60, || !world.telemetry().stop_latched && world.telemetry().armed)
            .await;
        world.pass_s(60.0).await;
        assert_eq!((world.ignitions(), world.ordered()), (1, None));
        // And it can be started again.
        world
            .until("cold", 400, || {
                let telemetry = world.telemetry();
                let egt = telemetry.current(telemetry.report.egt).is_some_and(|egt| egt.tenths() < 900);
                telemetry.state == EngineState::Standby && egt
            })
            .await;
        world.pass_s(15.0).await;
        world.switch(RUN).await;
        world.until("running", 120, || world.state() == EngineState::Running).await;
        assert_eq!(world.ignitions(), 2);
    });
}

/// Also for an engine at rest, where nothing else prevents the release.
#[test]
fn stop_is_released_only_with_the_stick_at_idle() {
    each(async |world| {
        world.arm().await;
        world.switch(STOP).await;
        assert!(world.telemetry().stop_latched);
        world.radio.stick.set(1500);
        world.pass_s(1.0).await;
        world.switch(STANDBY).await;
        world.pass_s(5.0).await;
        assert!(world.telemetry().stop_latched, "the stick is up");
        world.radio.stick.set(IDLE);
        world.until("released", 3, || !world.telemetry().stop_latched).await;
    });
}

#[test]
fn stop_of_another_source_stays_until_the_switch_was_at_stop() {
    each(async |world| {
        world.start().await;
        world.lower.set(Some(Command::EmergencyStop));
        world.pass_s(0.2).await;
        world.lower.set(None);
        world.pass_s(60.0).await;
        world.switch(STANDBY).await;
        world.pass_s(5.0).await;
        world.switch(RUN).await;
        assert!(world.telemetry().stop_latched);
        world.arm().await;
        assert!(!world.telemetry().stop_latched);
    });
}

#[test]
fn start_without_arming_is_refused_and_never_follows_later() {
    each(async |world| {
        world.radio.switch.set(STANDBY);
        world.until("standby", 60, || world.state() == EngineState::Standby).await;
        world.pass_s(5.0).await;
        world.radio.switch.set(RUN);
        world.pass_s(1.0).await;
        let refused = Outcome::Commanded(run_at_tenths(0), Err(Rejected::Start(Interlock::NotArmed)));
        assert!(world.outcomes.borrow().iter().any(|(_, outcome)| *outcome == refused));
        // Another source arms: what was refused stays refused.
        world.lower.set(Some(Command::Arm));
        world.pass_s(20.0).await;
        assert!(world.telemetry().armed);
        assert_eq!((world.ignitions(), world.ordered()), (0, None));
        world.switch(STANDBY).await;
        world.switch(RUN).await;
        assert_eq!(world.ordered(), Some(0));
    });
}

/// A life of the node, and another one after each of these resets.
fn lives(
    kind: Kind,
    resets: &[Reset],
    first: impl AsyncFnOnce(&World<'_>),
    between: impl Fn(&Radio),
    later: impl AsyncFn(&World<'_>),
) {
    begin(kind, async |radio, plug, halves| {
        let memory = memory();
        let with = |reset| Life { radio, plug, memory: Some((memory, reset)), settings: kind.settings() };
        life(&with(Reset::PowerLost), halves, first).await;
        for &reset in resets {
            between(radio);
            life(&with(reset), plug.reset_node(), async |world| later(world).await).await;
        }
    });
}

/// A reset of the node in flight cuts off a frame of the receiver; then the engine continues, whatever the switch was.
#[test]
fn engine_resumes_after_a_reset_in_flight_and_the_valve_stays_open() {
    let flies = async |world: &World<'_>| {
        world.start_to_half().await;
        world.pass_s(5.0).await;
    };
    let resumes = async |world: &World<'_>| {
        assert_eq!(world.outputs.borrow().valve(), Valve::Open, "before anything else");
        // The rest of a frame that began before the reset.
        world.bytes(Instant::now(), &[0xFF, 0x0F, 0x00, 0xC8, 0x18, 0x16, 0x0F]);
        world.until("found running", 10, || world.ordered().is_some()).await;
        world.until("its throttle", 10, || world.ordered() == Some(500)).await;
        world.pass_s(5.0).await;
        assert_eq!((world.state(), world.ignitions()), (EngineState::Running, 1));
        assert!(world.valve.borrow().is_empty(), "{:?}", world.valve.borrow());
    };
    for kind in Kind::ALL {
        for reset in [Reset::Warm, Reset::PowerLost] {
            lives(kind, &[reset], flies, |_| (), resumes);
        }
    }
}

/// The stick went up while the node was reset, or the receiver returns with full throttle some time later.
#[test]
fn engine_that_is_found_after_a_reset_is_taken_over_without_a_jump() {
    let flies = async |world: &World<'_>| {
        world.start().await;
        world.radio.stick.set(1300);
        world.until("a quarter", 5, || world.ordered() == Some(250)).await;
        world.pass_s(5.0).await;
    };
    for kind in Kind::ALL {
        for (reset, later) in
            [(Reset::Warm, 0.0), (Reset::PowerLost, 0.0), (Reset::Warm, 8.0), (Reset::PowerLost, 8.0)]
        {
            let goes_up = |radio: &Radio| {
                radio.stick.set(1900);
                radio.plugged.set(later == 0.0);
            };
            lives(kind, &[reset], flies, goes_up, async |world| {
                world.until("found running", 10, || world.ordered().is_some()).await;
                assert!(world.ordered() <= Some(250), "{:?}", world.ordered());
                world.pass_s(later).await;
                world.radio.plugged.set(true);
                world.rises_to(1000).await;
                assert_eq!((world.state(), world.ignitions()), (EngineState::Running, 1));
            });
        }
    }
}

#[test]
fn reset_while_stopped_keeps_the_valve_closed() {
    let stops = async |world: &World<'_>| {
        world.start().await;
        world.switch(STOP).await;
        world.pass_s(1.0).await;
    };
    let unplugged = |radio: &Radio| radio.plugged.set(false);
    lives(Kind::Sbus, &[Reset::Warm, Reset::PowerLost], stops, unplugged, async |world| {
        assert_eq!(world.outputs.borrow().valve(), Valve::Closed);
        assert!(world.outputs.borrow().power(), "its starter cools the turbine");
        world.pass_s(20.0).await;
        assert!(world.telemetry().stop_latched && world.valve.borrow().is_empty());
    });
}

/// ZK version 5 with a broken wire keeps running whatever is sent: only the valve stops it.
#[test]
fn valve_closes_when_standby_is_not_obeyed_and_never_before() {
    each(async |world| {
        world.start().await;
        world.plug.cut_one(sim::wire::Direction::ToEcu, true);
        world.radio.stick.set(1500);
        world.pass_s(30.0).await;
        assert!(!world.telemetry().obeyed, "a demand is not obeyed");
        assert_eq!(world.outputs.borrow().valve(), Valve::Open, "which closes nothing");
        world.radio.stick.set(IDLE);
        let ordered = Instant::now();
        world.radio.switch.set(STANDBY);
        world.until("closed", 20, || world.outputs.borrow().valve() == Valve::Closed).await;
        let after = Instant::now() - ordered;
        assert!(after >= Duration::from_secs(5) && after <= Duration::from_secs(9), "{after:?}");
        assert_eq!(world.state(), EngineState::Running, "the ECU received nothing");
    });
}

/// Both wires are broken, and the node itself has ordered standby, because radio control was silent. If it returns with the switch at run,
/// or at a standby without a received move, that does not become a person's order.
#[test]
fn radio_control_that_returns_at_run_leaves_the_nodes_own_standby_in_doubt_as_it_is() {
    for (kind, found) in [(Kind::Sbus, RUN), (Kind::Crsf, STANDBY), (Kind::Pwm, RUN)] {
        run(kind, async |world| {
            world.start().await;
            world.radio.on.set(false);
            world.plug.cut(true);
            let own = Ordered { order: Order::Standby, origin: Origin::Node };
            world.until("the node's own standby", 60, || world.telemetry().ordered == own).await;
            world.radio.switch.set(found);
            world.radio.on.set(true);
            world.pass_s(60.0).await;
            assert_eq!(world.commanded(), Some(Command::Present));
            assert_eq!(world.outputs.borrow().valve(), Valve::Open);
            // Run orders nothing here either; a move to standby is a person's order.
            world.switch(RUN).await;
            world.pass_s(30.0).await;
            assert_eq!(world.outputs.borrow().valve(), Valve::Open);
            world.switch(STANDBY).await;
            world.until("closed", 6, || world.outputs.borrow().valve() == Valve::Closed).await;
        });
    }
}

#[test]
fn shut_down_closes_the_valve_at_rest_and_power_ends_when_it_is_cold() {
    run(Kind::Crsf, async |world| {
        world.start().await;
        world.radio.switch.set(STANDBY);
        world.until("closed", 60, || world.outputs.borrow().valve() == Valve::Closed).await;
        assert!(world.plug.ecu(|ecu| ecu.turbine().fuel_flow()) == 0.0);
        assert_eq!(world.telemetry().shaft_turns(), Some(false));
        assert!(world.outputs.borrow().power(), "armed");
        world
            .until("cold", 400, || {
                let telemetry = world.telemetry();
                let egt = telemetry.current(telemetry.report.egt).is_some_and(|egt| egt.tenths() < 900);
                telemetry.state == EngineState::Standby && egt
            })
            .await;
        assert!(world.outputs.borrow().power());
        world.switch(STOP).await;
        world.until("power off", 5, || !world.outputs.borrow().power()).await;
    });
}

/// Sticks, switches and gaps at random for 15 minutes each: only the move from standby with the stick at idle
/// starts.
#[test]
fn random_pilots_never_start_but_by_the_move() {
    for seed in 0..6 {
        let kind = Kind::ALL[seed as usize % 3];
        run(kind, async |world| {
            let mut random = fastrand::Rng::with_seed(seed);
            let mut starts = 0;
            let mut before = (world.radio.switch.get(), None);
            for _ in 0..300 {
                match random.u8(0..10) {
                    0..4 => {
                        world.radio.switch.set([STOP, STANDBY, RUN, 1350, STANDBY, RUN][random.usize(0..6)])
                    }
                    4..7 => world.radio.stick.set([IDLE, IDLE, 1500, 1900, 900][random.usize(0..5)]),
                    7 => world.radio.on.set(!world.radio.on.get() || random.bool()),
                    8 => world.radio.plugged.set(!world.radio.plugged.get() || random.bool()),
                    _ => world.radio.hand_over.set(if random.u8(0..4) == 0 { 2000 } else { 1000 }),
                }
                world.pass_s(random.f64() * 6.0).await;
                let ordered = world.ordered();
                if ordered.is_some() && before.1.is_none() {
                    starts += 1;
                    // Only a frame accepted as a start orders it: with the stick at idle.
                    let accepted: Vec<_> = world
                        .outcomes
                        .borrow()
                        .iter()
                        .filter(|(_, o)| {
                            matches!(o, Outcome::Commanded(Command::Run(_), Ok(Accepted::InForce)))
                        })
                        .map(|(_, outcome)| *outcome)
                        .take(1)
                        .collect();
                    assert_eq!(
                        accepted,
                        [Outcome::Commanded(run_at_tenths(0), Ok(Accepted::InForce))],
                        "seed {seed}"
                    );
                    assert_eq!(before.0, STANDBY, "seed {seed}");
                }
                before = (world.radio.switch.get(), ordered);
                world.outcomes.borrow_mut().clear();
            }
            assert!(world.ignitions() <= starts, "seed {seed}: {starts} starts");
        });
    }
}
