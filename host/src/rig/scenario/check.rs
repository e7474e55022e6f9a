//! Checks of the scenarios on the wires, and their allowed times.

use super::super::audit::{TransmittedFrame, WireCommand};
use sim::ecu::{MILLIS, Nanos, SECOND};

/// Longest time from a decision of the node to its frame on the wire: an AMT ECU is answered every 125 ms, and
/// the answer takes 20.8 ms.
pub const ON_WIRE: Nanos = 175 * MILLIS;
/// Time for a node to detect that an engine stopped: two reports that agree. A ZK ECU at 20 Hz reports its state every
/// 0.4 s.
pub const SEES_STOP: Nanos = 1500 * MILLIS;
/// Between two commands of the pilot.
pub const WORDS: Nanos = 100 * MILLIS;
/// Steps of the wire in the throttle, in tenths of a percent.
pub const GRAIN: u16 = 10;

/// All frames with a switch or demand have this command, and there are some.
pub fn all(frames: &[TransmittedFrame], wire: WireCommand) -> bool {
    frames.iter().any(|frame| frame.command == wire)
        && frames.iter().all(|frame| frame.command == wire || frame.command == WireCommand::Nothing)
}

/// At least this number of frames, all with this command.
pub fn only(frames: &[TransmittedFrame], least: usize, allowed: impl Fn(WireCommand) -> bool) -> bool {
    frames.len() >= least && frames.iter().all(|frame| allowed(frame.command))
}

pub const fn is_run(wire: WireCommand) -> bool {
    matches!(wire, WireCommand::Run(_) | WireCommand::RunRpm(_))
}

/// Standby, or a frame without switch and demand.
pub const fn is_standby(wire: WireCommand) -> bool {
    matches!(wire, WireCommand::Standby | WireCommand::Nothing)
}

/// No throttle on the wire rises by more than 50 % a second.
pub fn rises_slowly(frames: &[TransmittedFrame]) -> bool {
    let mut runs = frames.iter().filter_map(|frame| match frame.command {
        WireCommand::Run(tenths) => Some((frame.from, tenths)),
        _ => None,
    });
    let Some(mut last) = runs.next() else { return false };
    runs.all(|now| {
        let before = core::mem::replace(&mut last, now);
        // The demand moves every 20 ms, and a step of the wire is up to half a percent.
        let most = (now.0 - before.0 + 20 * MILLIS) * 500 / SECOND + 5;
        u64::from(now.1.saturating_sub(before.1)) <= most
    })
}

pub fn seconds(nanos: Nanos) -> f64 {
    nanos as f64 / 1e9
}
