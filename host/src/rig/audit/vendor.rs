//! What the audit requires of a protocol. Each has a file beside this one, with a [`Judge`] of its commands.

use super::super::engines::Engine;
use jetlink::command::Order;
use sim::ecu::{MILLIS, Nanos, SECOND};
use sim::wire::Entry;

/// Default rate at which a demand rises, in per mille of the maximum per second.
const RISE: u64 = 500;
/// Longest time from the computation of a demand to its frame on the wire.
const COMPUTED_BEFORE: Nanos = 25 * MILLIS;

/// The command in a frame of the node, in the terms of any protocol.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum WireCommand {
    /// Emergency stop.
    Stop,
    /// Standby.
    Standby,
    /// Run at this throttle, in tenths of a percent.
    Run(u16),
    /// Run at this speed.
    RunRpm(u32),
    /// Nothing that concerns the switch or the demand.
    Nothing,
}

impl core::fmt::Display for WireCommand {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Stop => f.write_str("emergency stop"),
            Self::Standby => f.write_str("standby"),
            Self::Run(tenths) => write!(f, "run, throttle {:.1} %", f64::from(*tenths) / 10.0),
            Self::RunRpm(rpm) => write!(f, "run, {rpm} rpm"),
            Self::Nothing => f.write_str("no order"),
        }
    }
}

/// A demand on the wire, in tenths of a percent or in rpm.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Level {
    /// When its frame began.
    pub at: Nanos,
    /// The demand.
    pub value: u32,
    /// It is a speed.
    pub by_rpm: bool,
}

/// How far a demand may have risen towards the commanded one.
#[derive(Clone, Copy, Debug)]
pub struct Rise {
    /// The first bit of the frame with the demand.
    pub at: Nanos,
    /// The last demand on the wire.
    pub last: Option<Level>,
    /// It may still be on its way up, until then.
    pub until: Option<Nanos>,
    /// The ECU was not received since: the rise begins at the demand that it obeys, which may be lower.
    pub from_less: bool,
    /// The last one is of the other kind: the rise begins at what the ECU makes of it.
    pub of_other_kind: bool,
}

impl Rise {
    /// Whether this demand is on its way from the last one on the wire up to the one that is given, no faster than it may.
    /// `full` is its maximum, `grain` the step of the wire.
    pub fn allows(&self, value: u32, given: u32, full: u32, grain: u32) -> bool {
        let Some(last) = self.last else { return false };
        let rises = self.until.is_some_and(|until| self.at <= until);
        let passed = self.at.saturating_sub(last.at) + COMPUTED_BEFORE;
        let most = u64::from(full) * RISE * passed / (1000 * SECOND);
        let most = u64::from(last.value) + most + u64::from(grain);
        if self.of_other_kind {
            return rises && value <= given;
        }
        let least = if self.from_less { 0 } else { last.value };
        rises && (least..=given).contains(&value) && u64::from(value) <= most
    }
}

/// A judge of the commands of one protocol.
pub trait Judge {
    /// A command of the protocol.
    type Command;

    /// A judge of the commands to this engine.
    fn new(engine: &Engine) -> Self;

    /// The command in the terms of any protocol.
    fn wire(&self, command: Self::Command) -> WireCommand;

    /// Whether this order allows it.
    fn allows(&self, command: Self::Command, order: Order, rise: &Rise) -> bool;

    /// Takes a byte from the ECU, as the node receives it. `at_rest`: the simulated engine neither starts nor runs.
    fn received(&mut self, _entry: &Entry, _at_rest: bool) {}

    /// Whether the next frame may follow directly after it, before its own send slot.
    fn shares_slot(&self, command: Self::Command) -> bool;

    /// Whether it is the switch alone, at run, without a demand.
    fn switches_to_run(&self, _command: Self::Command) -> bool {
        false
    }

    /// Step of the speeds that the protocol can command, in rpm.
    fn rpm_step(&self) -> u32;
}
