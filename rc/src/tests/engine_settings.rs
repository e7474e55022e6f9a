//! Settings and calibration of radio control, with a whole engine behind it.

use super::world::*;
use crate::calibration::CalibrationError;
use crate::pilot::Outcome;
use crate::settings::{EngineSettings, SettingsError};
use jetlink::command::{Command, Demand, Order, Ordered, Origin};
use jetlink::engine::state::EngineState;
use jetlink::units::Rpm;

#[test]
fn calibration_takes_the_end_points_and_is_refused_while_the_engine_turns() {
    each(async |world| {
        let calibrate = |pulses: &'static [u16]| async move {
            world.pilot.borrow_mut().begin_calibration().unwrap();
            for &pulse in pulses {
                world.radio.stick.set(pulse);
                world.pass_s(0.3).await;
            }
            let result = world.pilot.borrow_mut().end_calibration();
            world.radio.stick.set(IDLE);
            world.pass_s(1.0).await;
            result
        };
        assert_eq!(world.pilot.borrow_mut().end_calibration(), Err(CalibrationError::NotBegun));
        world.radio.switch.set(STANDBY);
        world.until("standby", 60, || world.state() == EngineState::Standby).await;
        assert_eq!(calibrate(&[IDLE, 1300]).await, Err(CalibrationError::TooShort));
        assert_eq!(world.pilot.borrow().settings().high, 1900);
        let (low, high) = calibrate(&[1050, 1500, 1950, 1050]).await.unwrap();
        // SBUS and CRSF have steps of 5/8 µs.
        assert!(low.abs_diff(1050) <= 1 && high.abs_diff(1950) <= 1, "{low} to {high}");
        // What an autopilot sends on outputs that it does not drive is not an end point.
        let (low, _) = calibrate(&[1100, 881, 1500, 1950, 1100]).await.unwrap();
        assert!(low.abs_diff(1100) <= 1, "{low}");
        let (low, high) = calibrate(&[1050, 1500, 1950, 1050]).await.unwrap();
        assert!(low.abs_diff(1050) <= 1 && high.abs_diff(1950) <= 1, "{low} to {high}");
        // A switch that moves meanwhile starts nothing, but stop stops.
        world.radio.stick.set(1050);
        world.pilot.borrow_mut().begin_calibration().unwrap();
        world.switch(RUN).await;
        assert_eq!(world.commanded(), Some(Command::Present));
        world.switch(STOP).await;
        assert!(world.telemetry().stop_latched);
        assert_eq!(world.pilot.borrow_mut().end_calibration(), Err(CalibrationError::TooShort));
        world.radio.switch.set(STANDBY);
        world.radio.stick.set(1050);
        world.until("armed", 30, || world.telemetry().armed).await;
        world.pass_s(2.0).await;
        world.radio.switch.set(RUN);
        world.until("ordered to run", 5, || world.ordered() == Some(0)).await;
        let mut pilot = world.pilot.borrow_mut();
        assert_eq!(pilot.begin_calibration(), Err(CalibrationError::EngineTurns));
        assert_eq!(pilot.configure(EngineSettings::DEFAULT), Err(SettingsError::EngineTurns));
    });
}

/// Both wires are cut, and the node has ordered standby: nothing is received of an engine that turned, and that has not obeyed.
#[test]
fn an_engine_that_is_not_received_counts_as_it_was_received_last() {
    each(async |world| {
        let both = || {
            let mut pilot = world.pilot.borrow_mut();
            let begun = pilot.begin_calibration();
            pilot.cancel_calibration();
            (begun, pilot.configure(world.radio.kind.settings()))
        };
        let turns = (Err(CalibrationError::EngineTurns), Err(SettingsError::EngineTurns));
        world.pass_s(5.0).await;
        world.plug.cut(true);
        world.pass_s(10.0).await;
        assert_eq!(both(), (Ok(()), Ok(())), "it was at rest");
        world.plug.cut(false);
        world.start().await;
        world.radio.on.set(false);
        world.plug.cut(true);
        let own = Ordered { order: Order::Standby, origin: Origin::Node };
        world.until("the node's own standby", 60, || world.telemetry().ordered == own).await;
        world.pass_s(20.0).await;
        assert_eq!(both(), turns);
        world.plug.cut(false);
        world.until("at rest", 400, || world.telemetry().shaft_turns() == Some(false)).await;
        world.until("cold", 400, || world.state() == EngineState::Standby).await;
        assert_eq!(both(), (Ok(()), Ok(())));
    });
}

/// A stick whose end point is as low as an output that nobody drives is at idle there.
#[test]
fn stick_whose_end_point_is_below_900_us_starts_and_throttles() {
    begin(Kind::Sbus, async |radio, plug, halves| {
        let settings = EngineSettings { low: 888, ..radio.kind.settings() };
        life(&Life { radio, plug, memory: None, settings }, halves, async |world| {
            radio.stick.set(882);
            world.pass_s(2.0).await;
            world.standby_by(STANDBY).await;
            world.run_by(RUN).await;
            world.radio.stick.set(1394);
            world.until("half throttle", 10, || world.ordered() == Some(500)).await;
        })
        .await;
    });
}

/// The whole range of accepted pulses.
#[test]
fn stick_with_end_points_of_800_and_2200_us_starts_and_reaches_full_throttle() {
    begin(Kind::Pwm, async |radio, plug, halves| {
        let settings = EngineSettings { low: 800, high: 2200, ..radio.kind.settings() };
        life(&Life { radio, plug, memory: None, settings }, halves, async |world| {
            radio.stick.set(800);
            world.pass_s(2.0).await;
            world.standby_by(STANDBY).await;
            world.run_by(RUN).await;
            for (stick, ordered) in [(1500, 500), (2200, 1000), (800, 0)] {
                world.radio.stick.set(stick);
                world.until("the throttle", 10, || world.ordered() == Some(ordered)).await;
            }
        })
        .await;
    });
}

#[test]
fn without_a_switch_radio_control_moves_the_throttle_and_neither_starts_nor_stops() {
    begin(Kind::Sbus, async |radio, plug, halves| {
        let settings = EngineSettings { switch: 0, hand_over: 0, ..radio.kind.settings() };
        life(&Life { radio, plug, memory: None, settings }, halves, async |world| {
            for switch in [STOP, STANDBY, RUN] {
                world.switch(switch).await;
                world.pass_s(10.0).await;
                assert!(world.ordered().is_none() && !world.telemetry().stop_latched);
            }
            world.lower.set(Some(Command::Arm));
            world.pass_s(0.2).await;
            world.lower.set(Some(Command::Standby));
            world.pass_s(2.0).await;
            world.lower.set(Some(run_at_tenths(0)));
            world.until("running", 120, || world.state() == EngineState::Running).await;
            world.radio.stick.set(1500);
            world.until("half throttle", 5, || world.ordered() == Some(500)).await;
            world.switch(STOP).await;
            assert_eq!((world.telemetry().active_source, world.ordered()), (Origin::Rc, Some(500)));
        })
        .await;
    });
}

#[test]
fn stick_may_command_a_shaft_speed() {
    begin(Kind::Crsf, async |radio, plug, halves| {
        let of = |rpm| Some(Rpm::new(rpm));
        let settings = EngineSettings { rpm_low: of(30_000), rpm_high: of(90_000), ..radio.kind.settings() };
        life(&Life { radio, plug, memory: None, settings }, halves, async |world| {
            world.arm().await;
            world.pass_s(20.0).await;
            world.run_by(RUN).await;
            world.radio.stick.set(1500);
            let half = Order::Run(Demand::Rpm(Rpm::new(60_000)));
            world
                .until("half", 15, || world.telemetry().commanded == Some(Demand::Rpm(Rpm::new(60_000))))
                .await;
            world.until("ordered", 15, || world.telemetry().ordered.order == half).await;
        })
        .await;
    });
}

/// The pulses of an autopilot are 5 or 6 µs longer than its outputs, and RC_RPM_MIN is a choice: neither prevents a start.
#[test]
fn start_by_a_stick_that_commands_a_shaft_speed_needs_the_stick_at_idle_and_no_more() {
    for (stick, low, above) in [(IDLE, 55_000, 0), (1106, 40_000, 400)] {
        begin(Kind::Sbus, async |radio, plug, halves| {
            let of = |rpm| Some(Rpm::new(rpm));
            let settings = EngineSettings { rpm_low: of(low), rpm_high: of(90_000), ..radio.kind.settings() };
            life(&Life { radio, plug, memory: None, settings }, halves, async |world| {
                world.arm().await;
                world.pass_s(20.0).await;
                world.radio.stick.set(stick);
                world.pass_s(1.0).await;
                world.run_by(RUN).await;
                let ordered = || match world.telemetry().ordered.order {
                    Order::Run(Demand::Rpm(rpm)) => rpm.get().checked_sub(low),
                    _ => None,
                };
                world.until("ordered", 30, || ordered().is_some_and(|over| over.abs_diff(above) < 100)).await;
                assert_eq!(world.ignitions(), 1);
            })
            .await;
        });
    }
}

#[test]
fn reversed_stick_and_switch_stop_start_and_throttle_the_engine() {
    begin(Kind::Sbus, async |radio, plug, halves| {
        let settings = EngineSettings { reversed: true, switch_reversed: true, ..radio.kind.settings() };
        radio.stick.set(1900);
        radio.switch.set(2000);
        life(&Life { radio, plug, memory: None, settings }, halves, async |world| {
            world.until("stop", 10, || world.telemetry().stop_latched).await;
            world.pass_s(2.0).await;
            world.standby_by(1500).await;
            world.run_by(1000).await;
            world.radio.stick.set(1300);
            world.until("75 %", 10, || world.ordered() == Some(750)).await;
        })
        .await;
    });
}

#[test]
fn damaged_settings_start_nothing_until_they_are_confirmed() {
    run(Kind::Sbus, async |world| {
        world.arm().await;
        world.pilot.borrow_mut().set_damaged(true);
        world.switch(RUN).await;
        world.pass_s(2.0).await;
        let refused = world.outcomes.borrow().iter().any(|(_, outcome)| *outcome == Outcome::SettingsDamaged);
        assert!(refused && world.ordered().is_none());
        world.pilot.borrow_mut().set_damaged(false);
        world.pass_s(5.0).await;
        assert_eq!(world.ordered(), None, "a start that was refused takes a new move");
        world.switch(STANDBY).await;
        world.pass_s(1.0).await;
        world.run_by(RUN).await;
        // A running engine keeps its throttle and its stop.
        world.pilot.borrow_mut().set_damaged(true);
        world.radio.stick.set(1500);
        world.until("half throttle", 10, || world.ordered() == Some(500)).await;
        world.switch(STOP).await;
        assert!(world.telemetry().stop_latched);
    });
}
