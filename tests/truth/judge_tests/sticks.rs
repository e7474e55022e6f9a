//! Histories by hand for the judge's rules: stick and switch of radio control.

use super::*;
use crate::history::{Position, Sticks};

/// Stick and switch from these times on, in seconds.
fn sticks(story: Story, moves: &[(f64, Position, u32, bool)]) -> Story {
    let sticks: Vec<_> = moves
        .iter()
        .map(|&(at, position, tenths, on)| Sticks { at: micros(at), position, tenths, on })
        .collect();
    story.with(|h| h.sticks = sticks)
}

/// What goes with [`flight`].
const FLIGHT: [(f64, Position, u32, bool); 4] = [
    (0.0, Position::Stop, 0, true),
    (0.9, Position::Standby, 0, true),
    (3.95, Position::Run, 0, true),
    (30.95, Position::Run, 500, true),
];

/// The first stop is none of what these are about.
fn flies(moves: &[(f64, Position, u32, bool)]) -> Story {
    let stop = |h: &mut History| {
        h.commanded.retain(|each| each.command != PilotCommand::Arm || each.at > SECOND);
    };
    sticks(flight(ZK5, 40.0), moves).with(stop)
}

#[test]
fn commands_of_radio_control_are_those_of_its_sticks() {
    flies(&FLIGHT).passes();
    let with = |place: usize, each: (f64, Position, u32, bool)| {
        let mut moves = FLIGHT;
        moves[place] = each;
        flies(&moves)
    };
    // Another demand, another position, and a transmitter that is off.
    with(3, (30.95, Position::Run, 520, true)).breaks(&[Rule::Sticks]);
    with(3, (30.95, Position::Standby, 500, true)).breaks(&[Rule::Sticks]);
    with(3, (30.95, Position::Run, 500, false)).breaks(&[Rule::Sticks]);
    with(1, (0.9, Position::Stop, 0, true)).breaks(&[Rule::Sticks]);
}

/// SBUS has no checksum, and a throttle counts when it is the median of three frames.
#[test]
fn two_damaged_frames_of_three_may_agree_on_a_throttle() {
    let story = |damaged: &[f64]| {
        flies(&FLIGHT).with(|h| {
            let command = PilotCommand::Run(Demanded::Throttle(450));
            h.commanded.push(Commanded { at: micros(33.03), source: PILOT, command });
            h.commanded.sort_by_key(|each| each.at);
            h.damaged_sticks = damaged.iter().copied().map(micros).collect();
        })
    };
    story(&[33.016, 33.03]).passes();
    story(&[33.016]).breaks(&[Rule::Sticks]);
    story(&[32.95, 33.03]).breaks(&[Rule::Sticks]);
    story(&[33.03, 33.044]).breaks(&[Rule::Sticks]);
}

#[test]
fn a_start_is_a_move_of_the_switch_with_the_stick_at_idle() {
    let with = |place: usize, each: (f64, Position, u32, bool)| {
        let mut moves = FLIGHT.to_vec();
        moves[place] = each;
        moves
    };
    flies(&FLIGHT).passes();
    // At run allowed since long before.
    flies(&with(2, (2.0, Position::Run, 0, true))).breaks(&[Rule::Sticks]);
    // The stick came to idle just before.
    let mut up = with(1, (0.9, Position::Standby, 0, true));
    up.insert(2, (3.0, Position::Standby, 300, true));
    up.insert(3, (3.7, Position::Standby, 0, true));
    flies(&up).breaks(&[Rule::Sticks]);
    up[3].0 = 3.3;
    flies(&up).passes();
}

#[test]
fn a_switch_at_stop_stops() {
    let story = |stop: f64| {
        let mut moves = FLIGHT.to_vec();
        moves.push((40.0, Position::Stop, 500, true));
        sticks(flight(ZK5, 40.0), &moves)
            .streams(PILOT, stop, 50.0, PilotCommand::Stop)
            .wire(stop, 50.0, STOP)
            .wire(40.0, stop, HALF)
            .turbine(40.0, 50.0, Phase::Cooling, 5000.0, 300.0)
    };
    story(40.03).passes();
    story(40.4).breaks(&[Rule::Sticks]);
}
