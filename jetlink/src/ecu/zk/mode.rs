//! Which frames carry the switch and the demand to a ZK ECU: its three modes of control (ZK-9).
//!
//! Mode 1 carries both in ID 1. Mode 2 carries the switch in ID 6 and the throttle in ID 1. Mode 3 carries the switch and
//! RPM_X in ID 6 and the rpm in ID 7. An ECU that was given a switch by ID 6 ignores the one in ID 1. So the frames depend
//! on three things: the order ([`Mode`]), what the ECU was sent in ID 6 ([`Id6`]), and whether it may have received an ID 6
//! before this conversation ([`Inherited`]).

use super::codec::{Control, RpmCode, RpmFactor, Switch, Version};
use crate::command::{Demand, Order};
use crate::consecutive::{AGREEING, Consecutive};
use crate::link::LinkRecord;
use crate::report::ReportedSwitch;
use crate::units::{Rpm, Throttle};
use embassy_time::{Duration, Instant};

/// Time for the ECU to report the ordered switch: status ID 1 repeats within 0.5 s.
const FOLLOWS_WITHIN: Duration = Duration::from_millis(700);
/// Retained: the ECU was given its switch by ID 6. The three bits above it are RPM_X.
const SWITCH_BY_ID6: u8 = 1;
/// Retained: it was never given one by ID 6, and obeys the one in ID 1.
const SWITCH_BY_ID1: u8 = 2;

/// Knowledge about the ECU when a frame is composed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    /// The version that two reports agree on, which decides which commands the ECU is sent.
    pub version: Option<Version>,
    pub max_rpm: Option<Rpm>,
    /// It reports an engine at rest.
    pub at_rest: bool,
}

impl Known {
    /// Whether it supports ID 6 and ID 7 (ZK-7).
    fn knows_modes(&self) -> bool {
        Version::knows(self.version, Control::MODES_SINCE) == Some(true)
    }
}

/// The order in force, with the state that ends with it.
#[derive(Clone, Copy, Debug)]
enum Mode {
    /// Nothing is commanded: ID 0.
    Listen,
    /// Emergency stop.
    Stop {
        /// The ECU had been given a switch by ID 6 when it was ordered.
        by_id6: bool,
        next: Half,
    },
    /// Standby. From `follows_from` on the ECU has to report it.
    Standby { follows_from: Instant, next: Half },
    /// A throttle, in mode 1 or 2; not sent while the life of the engine is in doubt.
    Throttle { throttle: Throttle, doubted: bool, follows_from: Instant, next: Half },
    /// An rpm, in mode 3.
    Rpm {
        rpm: Rpm,
        doubted: bool,
        /// RPM_X, from the first frame on. A code for one factor must not be sent under another.
        factor: Option<RpmFactor>,
        follows_from: Instant,
        next: Half,
    },
    /// Handed over to the ECU's PWM input.
    Pwm { next: Half },
}

/// The next of the two frames that make up a command.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Half {
    First,
    Second,
}

impl Half {
    /// The next frame. They alternate.
    const fn flip(&mut self) -> Self {
        let next = *self;
        *self = match next {
            Self::First => Self::Second,
            Self::Second => Self::First,
        };
        next
    }

    const fn take(&mut self, first: Control, second: Control) -> Control {
        match self.flip() {
            Self::First => first,
            Self::Second => second,
        }
    }
}

/// Switch and RPM_X sent to the ECU in ID 6 during this conversation.
#[derive(Clone, Copy, Debug)]
enum Id6 {
    /// No switch, or SW 0 after one: the ECU obeys the switch of ID 1.
    Released,
    /// A switch, in a frame that is being sent. It may arrive even if the UART reports an error.
    Sending {
        /// RPM_X until then.
        before: RpmFactor,
        factor: RpmFactor,
        switch: Switch,
    },
    /// A switch, with this RPM_X.
    Given {
        factor: RpmFactor,
        /// RPM_X is new: the frame that depends on it comes next, before any other.
        partner_due: bool,
    },
}

impl Id6 {
    /// RPM_X as last sent completely.
    const fn factor(self) -> RpmFactor {
        match self {
            Self::Released => RpmFactor::OFF,
            Self::Sending { before, .. } => before,
            Self::Given { factor, .. } => factor,
        }
    }
}

/// Whether the ECU may have been given its switch by ID 6 before this conversation.
#[derive(Clone, Copy, Debug)]
enum Inherited {
    /// No evidence, unless consecutive reports show that it obeys a different switch than ordered.
    No { not_followed: Consecutive },
    /// Possibly: it ran when the first order was given, or it does not follow ID 1.
    Perhaps,
}

/// The frames of the order in force.
#[derive(Clone, Debug)]
pub(super) struct Modes {
    /// Mode 2 instead of mode 1 on ECUs that support it.
    split_switch: bool,
    mode: Mode,
    id6: Id6,
    inherited: Inherited,
    /// The ECU was at rest when it was given an order, and was sent orders since; or the record of a reset says so.
    began_by_id1: bool,
}

impl Modes {
    /// Nothing is commanded, and the ECU was sent nothing.
    pub const fn new(split_switch: bool) -> Self {
        Self {
            split_switch,
            mode: Mode::Listen,
            id6: Id6::Released,
            inherited: Inherited::No { not_followed: Consecutive::NONE },
            began_by_id1: false,
        }
    }

    /// Changes whether mode 2 is used, from the next frame on.
    pub const fn split_switch(&mut self, split: bool) {
        self.split_switch = split;
    }

    /// Takes an order. `alive`: whether the ECU reports an engine that starts or runs. True if the order is of a different kind
    /// than the previous one; a new number alone is not.
    pub fn order(&mut self, now: Instant, order: Order, alive: Option<bool>) -> bool {
        let demanded = match order {
            Order::Run(demand) => Some((demand, false)),
            Order::Doubt(demand) => Some((demand, true)),
            _ => None,
        };
        let (follows_from, next) = (now + FOLLOWS_WITHIN, Half::First);
        let mode = match (&mut self.mode, order, demanded) {
            (Mode::Listen, Order::Listen, _)
            | (Mode::Stop { .. }, Order::EmergencyStop, _)
            | (Mode::Standby { .. }, Order::Standby, _)
            | (Mode::Pwm { .. }, Order::Pwm, _) => return false,
            (Mode::Throttle { throttle, doubted, .. }, _, Some((Demand::Throttle(new), doubt))) => {
                (*throttle, *doubted) = (new, doubt);
                return false;
            }
            (Mode::Rpm { rpm, doubted, .. }, _, Some((Demand::Rpm(new), doubt))) => {
                (*rpm, *doubted) = (new, doubt);
                return false;
            }
            (_, _, Some((Demand::Throttle(throttle), doubted))) => {
                Mode::Throttle { throttle, doubted, follows_from, next }
            }
            (_, _, Some((Demand::Rpm(rpm), doubted))) => {
                Mode::Rpm { rpm, doubted, factor: None, follows_from, next }
            }
            (_, Order::EmergencyStop, _) => Mode::Stop { by_id6: self.switch_by_id6(), next },
            (_, Order::Standby, _) => Mode::Standby { follows_from, next },
            (_, Order::Pwm, _) => Mode::Pwm { next },
            (_, Order::Listen | Order::Run(_) | Order::Doubt(_), _) => Mode::Listen,
        };
        // An ECU whose engine already runs may have been given its switch by ID 6 before.
        match (&self.mode, &mode, alive) {
            (_, Mode::Listen, _) => self.began_by_id1 = false,
            (Mode::Listen, _, Some(true)) if !self.began_by_id1 => self.inherited = Inherited::Perhaps,
            (_, _, Some(false)) => self.began_by_id1 = true,
            _ => {}
        }
        if let Id6::Given { partner_due, .. } = &mut self.id6 {
            *partner_due = false;
        }
        self.mode = mode;
        true
    }

    /// Whether an emergency stop is ordered.
    pub const fn stops(&self) -> bool {
        matches!(self.mode, Mode::Stop { .. })
    }

    /// Whether standby is ordered.
    pub const fn is_standby(&self) -> bool {
        matches!(self.mode, Mode::Standby { .. })
    }

    /// Whether the ECU was given its switch by ID 6, so that it ignores the one in ID 1.
    pub const fn switch_by_id6(&self) -> bool {
        !matches!(self.id6, Id6::Released)
    }

    /// Whether the ECU was given an RPM_X, so that it holds an rpm.
    pub fn given_rpm_x(&self) -> bool {
        self.id6.factor() != RpmFactor::OFF
    }

    /// What is retained over a reset of the node: how the ECU is given its switch, and with which RPM_X.
    pub fn record(&self) -> LinkRecord {
        LinkRecord::new(match (self.id6, self.inherited) {
            // Of two that the ECU may have, with the larger one no code of ID 7 is too high.
            (Id6::Sending { before, factor, .. }, _) => SWITCH_BY_ID6 | before.max(factor).get() << 1,
            (Id6::Given { factor, .. }, _) => SWITCH_BY_ID6 | factor.get() << 1,
            (Id6::Released, Inherited::No { .. }) if self.began_by_id1 => SWITCH_BY_ID1,
            (Id6::Released, _) => 0,
        })
    }

    /// Takes what was retained.
    pub fn restore(&mut self, record: LinkRecord) {
        if record.bits() & SWITCH_BY_ID6 != 0 {
            let factor = RpmFactor::new(record.bits() >> 1).unwrap_or(RpmFactor::OFF);
            self.id6 = Id6::Given { factor, partner_due: false };
        } else {
            self.began_by_id1 = record.bits() == SWITCH_BY_ID1;
        }
    }

    /// Takes the reported switch. An ECU that does not follow the switch in ID 1 was given another by ID 6 before.
    pub fn reported(&mut self, now: Instant, reported: ReportedSwitch) {
        let (expected, follows_from) = match self.mode {
            Mode::Standby { follows_from, .. } => (ReportedSwitch::Standby, follows_from),
            Mode::Throttle { doubted: false, follows_from, .. }
            | Mode::Rpm { doubted: false, follows_from, .. } => (ReportedSwitch::Run, follows_from),
            _ => return,
        };
        let Inherited::No { not_followed } = &mut self.inherited else { return };
        // A single report may be a damaged frame.
        not_followed.count(reported != expected && now >= follows_from);
        if not_followed.reached(AGREEING) {
            self.inherited = Inherited::Perhaps;
        }
    }

    /// Whether the frame that depends on a new RPM_X comes next. Call it once for each slot.
    pub const fn take_partner_due(&mut self) -> bool {
        match &mut self.id6 {
            Id6::Given { partner_due, .. } => core::mem::replace(partner_due, false),
            _ => false,
        }
    }

    /// The next frame.
    pub fn frame(&mut self, known: &Known) -> Control {
        let control = self.compose(known);
        if let Control::Mode { factor, switch } = control {
            self.id6 = match self.id6 {
                Id6::Released if switch == Switch::Pwm => Id6::Released,
                id6 => Id6::Sending { before: id6.factor(), factor, switch },
            };
        }
        control
    }

    /// The last frame has been sent. True if its RPM_X is new: the frame that depends on it follows at once, because ECUs may
    /// ignore ID 7, or ID 1, until then.
    pub fn sent(&mut self) -> bool {
        let Id6::Sending { before, factor, switch } = self.id6 else { return false };
        let partner_due = switch != Switch::Pwm && before != factor;
        self.id6 = match switch {
            Switch::Pwm => Id6::Released,
            _ => Id6::Given { factor, partner_due },
        };
        partner_due
    }

    /// The last frame was not sent, or not completely.
    pub const fn not_sent(&mut self) {
        if let Id6::Sending { before, .. } = self.id6 {
            self.id6 = Id6::Given { factor: before, partner_due: false };
        }
    }

    fn compose(&mut self, known: &Known) -> Control {
        let by_id6 = self.by_id6(known);
        let factor_given = self.id6.factor();
        // The ECU ignores the switch in ID 1 in modes 2 and 3. It is sent anyway, and never as SW 0, because an ECU
        // that restarted has lost ID 6 and would read SW 0 as a hand-over to PWM (ZK-8).
        let id1 = |switch, throttle| Control::Throttle { switch, throttle };
        let id6 = |switch, factor| Control::Mode { factor, switch };
        match &mut self.mode {
            // Nothing that could start an engine.
            Mode::Listen | Mode::Throttle { doubted: true, .. } => Control::KeepAlive,
            Mode::Stop { by_id6: before, next } => {
                let (id1, id6) = (id1(Switch::Stop, Throttle::IDLE), id6(Switch::Stop, RpmFactor::OFF));
                match (by_id6, *before) {
                    (false, _) => id1,
                    // An ECU that was given a switch by ID 6 also has to be given the next one there.
                    (true, true) => next.take(id6, id1),
                    // A stop by ID 1 alone is for ECUs that were never sent an ID 6.
                    (true, false) => next.take(id1, id6),
                }
            }
            Mode::Standby { next, .. } => {
                let id1 = id1(Switch::Standby, Throttle::IDLE);
                if by_id6 { next.take(id6(Switch::Standby, RpmFactor::OFF), id1) } else { id1 }
            }
            // A hand-over is sent in ID 1 before ID 6 releases the switch, or the last switch in ID 1 would apply for a slot.
            Mode::Pwm { next } => {
                let id1 = id1(Switch::Pwm, Throttle::IDLE);
                if by_id6 { next.take(id1, id6(Switch::Pwm, RpmFactor::OFF)) } else { id1 }
            }
            // When leaving mode 3, the throttle is sent first: ID 6 must not put an old one into force.
            Mode::Throttle { throttle, next, .. } => {
                let id1 = id1(Switch::Run, *throttle);
                if by_id6 { next.take(id1, id6(Switch::Run, RpmFactor::OFF)) } else { id1 }
            }
            // ID 0, and in mode 3 alternating with the rpm. An ECU that restarted has lost ID 6 and ignores ID 7.
            // Even if its version was discarded with the link: the engine is in mode 3 with this RPM_X.
            Mode::Rpm { rpm, doubted: true, next, .. } => match next.flip() {
                Half::Second if factor_given != RpmFactor::OFF => {
                    Control::Rpm(RpmCode::for_target(*rpm, factor_given))
                }
                _ => Control::KeepAlive,
            },
            // The ECU that was sent the demand was replaced by one of a version without speed control.
            Mode::Rpm { .. } if !known.knows_modes() => id1(Switch::Run, Throttle::IDLE),
            // Mode 3. The rpm is sent first: the mode must not take effect with an old one. Under a larger RPM_X than its own it would be
            // too high until ID 6 follows, so RPM_X never gets smaller.
            Mode::Rpm { rpm, factor, next, .. } => {
                let factor = *factor.get_or_insert_with(|| covering(known).max(factor_given));
                next.take(Control::Rpm(RpmCode::for_target(*rpm, factor)), id6(Switch::Run, factor))
            }
        }
    }

    /// Whether the switch is sent in ID 6. Run needs a version that two reports agree on and that supports it (ZK-7). Standby
    /// is also sent in ID 6 wherever ID 6 was used, and a stop also while the version is unknown: a version below 4 ignores
    /// it.
    fn by_id6(&self, known: &Known) -> bool {
        let given = self.switch_by_id6();
        let perhaps = matches!(self.inherited, Inherited::Perhaps);
        let knows_it = known.knows_modes();
        match self.mode {
            Mode::Stop { .. } => given || knows_it || known.version.is_none(),
            // An ECU at rest with an older version in two reports was never sent an ID 6: another one was plugged in.
            Mode::Standby { .. } if known.version.is_some() && !knows_it && known.at_rest => false,
            Mode::Standby { .. } => given || ((self.split_switch || perhaps) && knows_it),
            Mode::Pwm { .. } => (given || perhaps) && knows_it,
            _ => (given || self.split_switch || perhaps) && knows_it,
        }
    }
}

/// RPM_X for an engine's maximum.
fn covering(known: &Known) -> RpmFactor {
    RpmFactor::covering(known.max_rpm.unwrap_or(Rpm::new(0)))
}
