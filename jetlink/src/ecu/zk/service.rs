//! Frames that replace the demand in a send slot of a ZK ECU: the status rate, a service command, the atmospheric pressure,
//! and the end of a service that opened the pump. Each is a state that contains its own end.

use super::codec::{Action, Control, Rate};
use super::config::Service;
use crate::command::Order;
use crate::ecu::Service as AnyService;
use crate::event::Event;
use crate::link::Outbox;
use crate::report::{Reading, Report, Timed};
use crate::units::Hectopascals;
use embassy_time::{Duration, Instant};

/// Interval between attempts to set the status rate.
const RATE_RETRY: Duration = Duration::from_secs(1);
/// Largest number of attempts to set the status rate.
const RATE_ATTEMPTS: u8 = 5;
/// Time for the ECU to report the value that a service command set: every status ID repeats well within this.
const CONFIRM_WITHIN: Duration = Duration::from_secs(2);
/// Attempts of a service command that the ECU confirms.
const SERVICE_ATTEMPTS: u8 = 3;
/// Number of frames to close the pump; fewer if the ECU reports a pump without voltage.
const CLOSE_PUMP_FRAMES: u8 = 10;
/// Time from the frame that closes the pump to a voltage that confirms it.
const PUMP_CLOSES_WITHIN: Duration = Duration::from_millis(100);
/// Interval between pressures (ZK-14).
const PRESSURE_EVERY: Duration = Duration::from_secs(1);
/// Largest age of a pressure to be sent: none is better than an old one (ZK-14).
const PRESSURE_MAX_AGE: Duration = Duration::from_secs(5);

/// Progress of a service command.
#[derive(Clone, Copy, Debug)]
pub(super) enum ServiceCommand {
    None,
    /// To be sent in the next free slot.
    Waiting {
        service: Service,
        attempts_left: u8,
    },
    /// The unlock is being sent; the command follows at once.
    Unlocking {
        service: Service,
        attempts_left: u8,
    },
    /// The command is being sent.
    Sending {
        service: Service,
        attempts_left: u8,
    },
    /// Waiting for confirmation by status ID 5.
    Confirming {
        service: Service,
        attempts_left: u8,
        until: Instant,
    },
}

impl ServiceCommand {
    pub const fn waiting(service: Service) -> Self {
        Self::Waiting { service, attempts_left: SERVICE_ATTEMPTS }
    }

    pub const fn is_pending(&self) -> bool {
        !matches!(self, Self::None)
    }

    /// Whether an unlock is being sent or was sent: the command follows at once.
    pub const fn unlocks(&self) -> bool {
        matches!(self, Self::Unlocking { .. })
    }

    pub fn cancel(&mut self, outbox: &mut Outbox) {
        let (Self::Waiting { service, .. }
        | Self::Unlocking { service, .. }
        | Self::Sending { service, .. }
        | Self::Confirming { service, .. }) = *self
        else {
            return;
        };
        *self = Self::None;
        outbox.event(Event::ServiceFailed(AnyService::Zk(service)));
    }

    /// The command that an unlock was sent for, right after it (ZK-13).
    pub const fn unlocked(&mut self) -> Option<Control> {
        let Self::Unlocking { service, attempts_left } = *self else { return None };
        *self = Self::Sending { service, attempts_left };
        Some(service.control())
    }

    /// Its next frame, if it is due.
    pub fn frame(&mut self, now: Instant, outbox: &mut Outbox) -> Option<Control> {
        if let Self::Confirming { service, attempts_left, until } = *self
            && now >= until
        {
            *self = Self::Waiting { service, attempts_left };
        }
        let Self::Waiting { service, attempts_left } = *self else { return None };
        let Some(attempts_left) = attempts_left.checked_sub(1) else {
            self.cancel(outbox);
            return None;
        };
        if service.needs_unlock() {
            *self = Self::Unlocking { service, attempts_left };
            return Some(Control::Unlock);
        }
        *self = Self::Sending { service, attempts_left };
        Some(service.control())
    }

    pub fn sent(&mut self, now: Instant, outbox: &mut Outbox) {
        let Self::Sending { service, attempts_left } = *self else { return };
        outbox.event(Event::ServiceSent(AnyService::Zk(service)));
        // No status confirms an action.
        *self = if service.needs_unlock() {
            Self::Confirming { service, attempts_left, until: now + CONFIRM_WITHIN }
        } else {
            Self::None
        };
    }

    /// A frame that was not sent is tried again, starting with the unlock.
    pub const fn not_sent(&mut self) {
        if let Self::Unlocking { service, attempts_left } | Self::Sending { service, attempts_left } = *self {
            *self = Self::Waiting { service, attempts_left };
        }
    }

    /// ZK-13: status ID 5 confirms the value that an unlocked command set.
    pub fn confirm(&mut self, report: &Report, outbox: &mut Outbox) {
        let Self::Confirming { service, .. } = *self else { return };
        let shown = match service {
            Service::IgnitionPump(voltage) => {
                report.ignition_pump.is_some_and(|shown| shown.value == voltage.millivolts())
            }
            Service::Curve(curve) => report.curve_increase.is_some_and(|shown| shown.value == curve.get()),
            Service::Action(_) => true,
        };
        if shown {
            *self = Self::None;
            outbox.event(Event::ServiceConfirmed(AnyService::Zk(service)));
        }
    }
}

/// Progress of setting the status rate (ZK-11).
#[derive(Clone, Copy, Debug)]
pub(super) enum RateSetting {
    /// Status ID 6 has not confirmed it yet.
    NotKnown,
    Confirmed,
    Commanding {
        attempts_left: u8,
        next_at: Instant,
    },
    GivenUp,
}

impl RateSetting {
    /// Begins to set it.
    pub const fn commanding(now: Instant) -> Self {
        Self::Commanding { attempts_left: RATE_ATTEMPTS, next_at: now }
    }

    /// Status ID 6 reports a rate.
    pub fn compare(&mut self, now: Instant, wanted: Rate, reported: Option<Rate>, outbox: &mut Outbox) {
        if reported == Some(wanted) {
            if !matches!(self, Self::Confirmed) {
                outbox.event(Event::RateConfirmed(wanted));
            }
            *self = Self::Confirmed;
        } else if matches!(self, Self::NotKnown | Self::Confirmed) {
            *self = Self::commanding(now);
        }
    }

    /// The command that sets it, if it is due.
    pub fn frame(&mut self, now: Instant, wanted: Rate, outbox: &mut Outbox) -> Option<Control> {
        let Self::Commanding { attempts_left, next_at } = *self else { return None };
        if now < next_at {
            return None;
        }
        let Some(attempts_left) = attempts_left.checked_sub(1) else {
            *self = Self::GivenUp;
            outbox.event(Event::RateNotConfirmed(wanted));
            return None;
        };
        *self = Self::Commanding { attempts_left, next_at: now + RATE_RETRY };
        Some(Control::Action(wanted.action()))
    }
}

/// The end of a service that opened the pump.
#[derive(Clone, Copy, Debug)]
pub(super) enum PumpClosing {
    None,
    /// Nothing was ordered since the node began: it may be open by a service of before, or be that of a running engine.
    NotKnown,
    /// As before, and a standby or a stop was ordered then.
    AtRest(Instant),
    /// The command is sent in the slot after this one, never before the first frame of a stop.
    Waiting(FramesLeft),
    /// The command is sent in this slot.
    Due(FramesLeft),
    /// The command is being sent.
    Sending(FramesLeft),
    /// All were sent, the last one then, and no voltage of zero has confirmed them.
    Unconfirmed(Instant),
}

/// Commands that still have to be sent to close the pump.
#[derive(Clone, Copy, Debug)]
pub(super) struct FramesLeft {
    count: u8,
    /// Time at which the first one was sent.
    since: Option<Instant>,
}

impl PumpClosing {
    pub const fn begin() -> Self {
        Self::Waiting(FramesLeft { count: CLOSE_PUMP_FRAMES, since: None })
    }

    pub const fn is_pending(&self) -> bool {
        matches!(self, Self::Waiting(_) | Self::Due(_) | Self::Sending(_))
    }

    /// After the first order, a voltage is that of a pump that was left open, or of a running engine.
    pub const fn ordered(&mut self, now: Instant, order: Order) {
        match (&self, order) {
            (Self::NotKnown, Order::Standby | Order::EmergencyStop) => *self = Self::AtRest(now),
            (Self::NotKnown | Self::AtRest(_), Order::Run(_) | Order::Pwm) => *self = Self::None,
            _ => {}
        }
    }

    /// A service that was accepted may open it: a voltage from now on is not one of before.
    pub const fn may_open(&mut self) {
        if matches!(self, Self::NotKnown | Self::AtRest(_)) {
            *self = Self::None;
        }
    }

    /// A voltage of zero since then shows that the pump is closed: a later one is that of a running engine. A pump that has a voltage
    /// although nothing was opened since the node began is closed, once the ECU reports that its engine is at rest: it may run on without
    /// having received the standby. `may_be_left_open`: the engine is at rest, and its ECU may have the command that opens the pump.
    pub fn confirm(&mut self, pump: Option<Timed<Reading>>, may_be_left_open: bool) {
        let (Self::Unconfirmed(since) | Self::AtRest(since)) = *self else { return };
        match (has_voltage(pump, since), &self) {
            (Some(false), _) => *self = Self::None,
            (Some(true), Self::AtRest(_)) if may_be_left_open => *self = Self::begin(),
            _ => {}
        }
    }

    /// Everything was sent, and the ECU reports a voltage since.
    pub fn has_failed(&self, pump: Option<Timed<Reading>>) -> bool {
        let Self::Unconfirmed(last) = *self else { return false };
        has_voltage(pump, last) == Some(true)
    }

    /// Another order is in force: its first frame is sent before the next command.
    pub const fn let_order_pass(&mut self) {
        if let Self::Due(left) = *self {
            *self = Self::Waiting(left);
        }
    }

    /// The command, in every second slot at most.
    pub fn frame(&mut self, pump: Option<Timed<Reading>>) -> Option<Control> {
        let (Self::Waiting(left) | Self::Due(left) | Self::Sending(left)) = *self else { return None };
        if left.since.and_then(|since| has_voltage(pump, since)) == Some(false) {
            *self = Self::None;
            return None;
        }
        if matches!(self, Self::Due(_)) {
            *self = Self::Sending(left);
            return Some(Control::Action(Action::ClosePump));
        }
        *self = Self::Due(left);
        None
    }

    /// The last frame was sent. Only a command that was sent is counted: a failing transmitter must not leave a pump open.
    pub fn sent(&mut self, now: Instant) {
        let Self::Sending(FramesLeft { count, since }) = *self else { return };
        *self = match count.saturating_sub(1) {
            0 => Self::Unconfirmed(now),
            count => Self::Waiting(FramesLeft { count, since: since.or(Some(now)) }),
        };
    }

    /// The last frame was not sent, or not completely.
    pub const fn not_sent(&mut self) {
        if let Self::Sending(left) = *self {
            *self = Self::Waiting(left);
        }
    }
}

/// Whether the pump has a voltage. One measured before the pump could have closed since then says nothing.
fn has_voltage(pump: Option<Timed<Reading>>, since: Instant) -> Option<bool> {
    pump.filter(|pump| pump.at >= since + PUMP_CLOSES_WITHIN).map(|pump| pump.value.raw > 0)
}

/// The atmospheric pressure, for an ECU that requests it (ZK-14).
#[derive(Clone, Copy, Debug)]
pub(super) enum Pressure {
    NotKnown,
    Known {
        pressure: Timed<Hectopascals>,
        /// Earliest time of the next one.
        next_at: Instant,
    },
}

impl Pressure {
    pub const fn set(&mut self, now: Instant, pressure: Hectopascals) {
        let next_at = match *self {
            Self::NotKnown => now,
            Self::Known { next_at, .. } => next_at,
        };
        *self = Self::Known { pressure: Timed::new(pressure, now), next_at };
    }

    /// The command, if it is due: once per second while the ECU requests it and a fresh pressure is known.
    pub fn frame(&self, now: Instant, report: &Report) -> Option<Control> {
        let Self::Known { pressure, next_at } = *self else { return None };
        let requested = report.pressure_requested.is_some_and(|requested| requested.value);
        (requested && now >= next_at && pressure.age(now) <= PRESSURE_MAX_AGE)
            .then_some(Control::Pressure(pressure.value))
    }

    /// The command is handed out.
    pub fn taken(&mut self, now: Instant) {
        if let Self::Known { next_at, .. } = self {
            *next_at = now + PRESSURE_EVERY;
        }
    }
}
