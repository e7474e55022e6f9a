//! Radio control hands its engine to the lower source, and takes it back.

use super::world::*;
use crate::pilot::Outcome;
use jetlink::command::{Command, Order, Origin};
use jetlink::engine::state::EngineState;

#[test]
fn hand_over_goes_to_the_lower_source_and_back_without_a_jump_and_keeps_the_stop() {
    each(async |world| {
        world.start().await;
        world.radio.stick.set(1900);
        world.until("full throttle", 5, || world.ordered() == Some(1000)).await;
        world.lower.set(Some(run_at_tenths(300)));
        world.pass_s(2.0).await;
        assert_eq!((world.telemetry().active_source, world.ordered()), (Origin::Rc, Some(1000)));
        world.radio.hand_over.set(2000);
        world.until("MAVLink in control", 5, || world.telemetry().active_source == Origin::Mavlink).await;
        world.until("its throttle", 10, || world.ordered() == Some(300)).await;
        assert_eq!(world.commanded(), Some(Command::Present));
        // The stick, and the switch from run to standby, are ignored while it is handed over.
        world.radio.stick.set(IDLE);
        world.switch(STANDBY).await;
        world.pass_s(5.0).await;
        assert_eq!((world.state(), world.ordered()), (EngineState::Running, Some(300)));
        world.switch(RUN).await;
        world.radio.stick.set(1900);
        world.pass_s(1.0).await;
        world.radio.hand_over.set(1000);
        world.rises_to(1000).await;
        assert_eq!(world.telemetry().active_source, Origin::Rc);
        world.radio.hand_over.set(2000);
        world.until("MAVLink in control", 5, || world.telemetry().active_source == Origin::Mavlink).await;
        world.radio.switch.set(STOP);
        world.until("stop", 1, || world.telemetry().stop_latched).await;
        assert_eq!(world.telemetry().ordered.origin, Origin::Rc);
    });
}

#[test]
fn engine_that_was_handed_over_can_be_started_by_the_lower_source_only() {
    each(async |world| {
        world.arm().await;
        world.lower.set(Some(Command::Standby));
        world.pass_s(1.0).await;
        world.lower.set(Some(run_at_tenths(0)));
        world.pass_s(3.0).await;
        assert_eq!(world.ordered(), None, "radio control is in control");
        world.radio.hand_over.set(2000);
        world.switch(RUN).await;
        world.pass_s(3.0).await;
        assert_eq!(world.ordered(), None, "no start of radio control");
        world.lower.set(Some(Command::Standby));
        world.pass_s(2.0).await;
        world.lower.set(Some(run_at_tenths(0)));
        world.until("running", 120, || world.state() == EngineState::Running).await;
        assert_eq!(world.telemetry().active_source, Origin::Mavlink);
    });
}

/// Switch moves made while MAVLink had the engine are ignored when radio control has it again.
#[test]
fn switch_that_moved_while_it_was_handed_over_neither_shuts_down_nor_arms_afterwards() {
    each(async |world| {
        world.start().await;
        world.lower.set(Some(run_at_tenths(300)));
        world.radio.hand_over.set(2000);
        world.until("MAVLink in control", 5, || world.telemetry().active_source == Origin::Mavlink).await;
        world.switch(STANDBY).await;
        world.radio.hand_over.set(1000);
        world.pass_s(5.0).await;
        assert_eq!(world.commanded(), Some(Command::Present));
        assert_eq!((world.state(), world.ordered()), (EngineState::Running, Some(300)));
        // Control: a move that it receives.
        world.switch(RUN).await;
        world.switch(STANDBY).await;
        world.until("standby", 2, || world.telemetry().ordered.order == Order::Standby).await;
        // Released while it was handed over; not armed then, nor later.
        world.lower.set(None);
        world.switch(STOP).await;
        world.pass_s(60.0).await;
        world.radio.hand_over.set(2000);
        world.pass_s(1.0).await;
        world.switch(STANDBY).await;
        world.until("released", 60, || !world.telemetry().stop_latched).await;
        world.radio.hand_over.set(1000);
        world.pass_s(5.0).await;
        assert!(!world.telemetry().armed);
    });
}

/// The hand-over channel is a failing potentiometer, or a loose wire: whoever has the throttle, it does not jump, and the stop
/// stays.
#[test]
fn hand_over_that_comes_and_goes_moves_the_throttle_slowly_and_keeps_the_stop() {
    each(async |world| {
        world.start().await;
        world.radio.stick.set(1900);
        world.until("full throttle", 5, || world.ordered() == Some(1000)).await;
        world.lower.set(Some(run_at_tenths(100)));
        world.pass_s(2.0).await;
        let mut before = 1000;
        for n in 0..1500_u32 {
            let on = match n / 300 {
                0 => n % 2 == 0,
                1 => n % 7 < 3,
                2 => n % 20 < 10,
                3 => n % 100 < 50,
                _ => n % 300 < 150,
            };
            world.radio.hand_over.set(if on { 2000 } else { 1000 });
            world.pass_s(0.02).await;
            let ordered = world.ordered().unwrap();
            assert!(ordered <= before + 30, "{n}: from {before} to {ordered} in 20 ms");
            before = ordered;
        }
        assert_eq!((world.state(), world.ignitions()), (EngineState::Running, 1));
        world.radio.switch.set(STOP);
        world.until("stop", 1, || world.telemetry().stop_latched).await;
    });
}

/// Hand-over channel and switch are moved at once, or the hand-over channel is intermittent: the move to standby is not lost.
#[test]
fn shut_down_counts_beside_a_hand_over_channel_that_has_not_settled() {
    each(async |world| {
        for off in [0.0, 0.02, 0.05] {
            if world.telemetry().ordered.order == Order::Standby {
                world
                    .until("cold", 400, || {
                        let telemetry = world.telemetry();
                        let egt =
                            telemetry.current(telemetry.report.egt).is_some_and(|egt| egt.tenths() < 900);
                        telemetry.state == EngineState::Standby && egt
                    })
                    .await;
            }
            world.start().await;
            world.radio.switch.set(STANDBY);
            world.pass_s(off).await;
            // It is at on for 0.04 s in every 0.1 s.
            for _ in 0..10 {
                world.radio.hand_over.set(2000);
                world.pass_s(0.04).await;
                world.radio.hand_over.set(1000);
                world.pass_s(0.06).await;
            }
            world.until("standby", 2, || world.telemetry().ordered.order == Order::Standby).await;
        }
    });
}

/// It goes to on right before a gap. After the gap it has to be held like any other position.
#[test]
fn hand_over_that_begins_before_a_gap_counts_once_it_has_been_held_after_it() {
    for kind in [Kind::Sbus, Kind::Crsf] {
        run(kind, async |world| {
            world.start().await;
            let handed_over = || {
                let outcomes = world.outcomes.borrow();
                outcomes.iter().any(|(_, o)| matches!(o, Outcome::Commanded(Command::Present, _)))
            };
            world.outcomes.borrow_mut().clear();
            world.radio.hand_over.set(2000);
            world.pass_s(0.045).await;
            world.radio.plugged.set(false);
            world.pass_s(0.4).await;
            world.radio.plugged.set(true);
            world.pass_s(0.25).await;
            assert!(!handed_over(), "{kind:?}");
            world.pass_s(0.2).await;
            assert!(handed_over(), "{kind:?}");
        });
    }
}
