//! State of a ZK ECU from a power-up to the next loss of power: the last commands received, and the input in control (ZK-9).

use super::command::{Action, Receiver, Sw};
use super::config::{Pwm, ZkConfig};
use crate::ecu::Nanos;
use crate::turbine::{Demand, STEP, Switch};

/// Input that controls the switch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControlledBy {
    /// The UART.
    Uart,
    /// The PWM input.
    Pwm,
}

/// A service test, or the pump held open.
#[derive(Clone, Copy, Debug)]
pub(super) struct Service {
    pub(super) action: Action,
    pub(super) until: Nanos,
}

/// State that is reset by each power-up.
#[derive(Clone, Debug)]
pub(super) struct Session {
    pub(super) ready_at: Nanos,
    pub(super) next_tick: Nanos,
    /// From version 5.
    pub(super) next_status: Nanos,
    /// Up to version 4: the answer that is waiting.
    pub(super) answer_at: Option<Nanos>,
    pub(super) last_status: Option<Nanos>,
    pub(super) line_free: Nanos,
    pub(super) turn: usize,
    pub(super) receiver: Receiver,
    pub(super) last_command: Option<Nanos>,
    pub(super) unlocked: bool,

    pub(super) id1_sw: Sw,
    pub(super) throttle: u16,
    pub(super) id6_sw: Sw,
    pub(super) factor: u8,
    pub(super) rpm_code: u16,
    /// The last switch from the UART, for rpm mode without one.
    pub(super) held_sw: Sw,

    /// Time of the last command that prevents a loss of the control signal.
    pub(super) last_control: Option<Nanos>,
    /// No start until the switch has left run.
    pub(super) held_off: bool,
    pub(super) waits_for_throttle: bool,
    /// The start under way is a relight: state 13.
    pub(super) restarting: bool,
    /// The engine was starting or running when the ECU lost power: the next start is a relight.
    pub(super) resumes: bool,
    /// Number of automatic relights left in this run.
    pub(super) relights_left: u8,
    /// Number of ID 1 status frames that still show the state and switch from before the loss of power.
    pub(super) stale: Option<(u8, LastState)>,
    pub(super) error: u8,
    pub(super) service: Option<Service>,
    pub(super) pressure: Option<u16>,
}

/// Last report before the loss of power.
#[derive(Clone, Copy, Debug)]
pub(super) struct LastState {
    pub(super) state: u8,
    pub(super) switch: u8,
    pub(super) live: bool,
}

impl Session {
    pub(super) fn begin(config: &ZkConfig, now: Nanos, last: Option<LastState>) -> Self {
        let temper = &config.temper;
        let ready_at = now + config.boot;
        Self {
            ready_at,
            next_tick: now + STEP,
            next_status: ready_at,
            answer_at: None,
            last_status: None,
            line_free: now,
            turn: 0,
            receiver: Receiver::default(),
            last_command: None,
            unlocked: false,
            id1_sw: Sw::None,
            throttle: 0,
            id6_sw: Sw::None,
            factor: 0,
            rpm_code: 0,
            held_sw: Sw::None,
            last_control: None,
            held_off: temper.wants_standby_first,
            waits_for_throttle: false,
            restarting: false,
            resumes: temper.relights > 0 && last.is_some_and(|last| last.live),
            relights_left: temper.relights,
            stale: last.map(|last| (temper.last_state_first, last)),
            error: 0,
            service: None,
            pressure: None,
        }
    }

    /// The report from before the loss of power that the status still shows.
    pub(super) fn stale(&self) -> Option<LastState> {
        self.stale.filter(|&(frames, _)| frames > 0).map(|(_, last)| last)
    }

    /// The switch from the UART, in any of the three modes (ZK-9).
    pub(super) fn sw(&self) -> Sw {
        match (self.id6_sw, self.factor) {
            (Sw::None, 0) => self.id1_sw,
            (Sw::None, _) => self.held_sw,
            (sw, _) => sw,
        }
    }

    pub(super) fn controlled_by(&self) -> ControlledBy {
        if self.sw() == Sw::None { ControlledBy::Pwm } else { ControlledBy::Uart }
    }

    /// The command in force: from the UART, otherwise from the PWM input, otherwise none.
    pub(super) fn switch(&self, pwm: Option<Pwm>) -> Option<Switch> {
        match self.sw() {
            Sw::None => pwm.map(|pwm| pwm.switch),
            Sw::Stop => Some(Switch::Stop),
            Sw::Standby => Some(Switch::Standby),
            Sw::Run => Some(Switch::Run),
        }
    }

    pub(super) fn demand(&self, pwm: Option<Pwm>) -> Demand {
        if self.factor != 0 {
            // Target rpm = code x RPM_X x 10
            return Demand::Rpm(u32::from(self.rpm_code) * u32::from(self.factor) * 10);
        }
        Demand::Throttle(match self.controlled_by() {
            ControlledBy::Uart => self.throttle,
            ControlledBy::Pwm => pwm.map_or(0, |pwm| pwm.throttle.min(1000)),
        })
    }
}
