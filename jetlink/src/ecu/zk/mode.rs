//! Which frames carry the switch and the demand to a ZK ECU: its three modes of control (ZK-9).
//!
//! Mode 1 carries both in ID 1. Mode 2 carries the switch in ID 6 and the throttle in ID 1. Mode 3 carries the switch and
//! RPM_X in ID 6 and the rpm in ID 7. An ECU that was given a switch by ID 6 ignores the one of ID 1. So what goes out
//! depends on three things: the order ([`Mode`]), what the ECU was given by ID 6 ([`Id6`]), and whether it may have been
//! given that before this conversation ([`Inherited`]).

use super::codec::{Control, RpmCode, RpmFactor, Switch, Version};
use crate::command::{Demand, Order};
use crate::report::ReportedSwitch;
use crate::units::{Rpm, Throttle};
use embassy_time::{Duration, Instant};

/// For the ECU to show the switch that was ordered: status ID 1 comes round within 0.5 s.
const FOLLOWS_WITHIN: Duration = Duration::from_millis(700);
/// Consecutive reports of another switch that say that the ECU does not follow. One alone can be a damaged frame's.
const NOT_FOLLOWED: u8 = 2;

/// What is known of the ECU when a frame is composed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    /// The version that two reports agree on: what decides which commands the ECU gets.
    pub version: Option<Version>,
    pub max_rpm: Option<Rpm>,
    /// It reports an engine at rest.
    pub at_rest: bool,
}

impl Known {
    /// ID 6 and ID 7 (ZK-7).
    fn knows_modes(&self) -> bool {
        Version::knows(self.version, Control::MODES_SINCE) == Some(true)
    }
}

/// The order in force, with what belongs to it and ends with it.
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
    /// A throttle, in mode 1 or 2; nothing goes out while the life of the engine is doubted.
    Throttle { throttle: Throttle, doubted: bool, follows_from: Instant, next: Half },
    /// An rpm, in mode 3.
    Rpm {
        rpm: Rpm,
        doubted: bool,
        /// RPM_X, from the first frame on. A code for one factor must not come under another.
        factor: Option<RpmFactor>,
        follows_from: Instant,
        next: Half,
    },
    /// Handed over to the ECU's PWM input.
    Pwm { next: Half },
}

/// Which of the two frames that make up a command is next.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Half {
    First,
    Second,
}

impl Half {
    /// The one that is next. They take turns.
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

/// What this conversation gave the ECU by ID 6.
#[derive(Clone, Copy, Debug)]
enum Id6 {
    /// No switch, or SW 0 after one: the switch of ID 1 counts.
    Released,
    /// A switch, in a frame that is going out. It may get there even if the UART says otherwise.
    Sending {
        /// RPM_X until then.
        before: RpmFactor,
        factor: RpmFactor,
        switch: Switch,
    },
    /// A switch, with this RPM_X.
    Given {
        factor: RpmFactor,
        /// RPM_X is new: the frame that it gives a meaning to comes next, before anything else.
        partner_due: bool,
    },
}

impl Id6 {
    /// RPM_X as it last went out whole.
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
    /// Nothing says so, but for consecutive reports that it obeys another switch than the one ordered.
    No { not_followed: u8 },
    /// Perhaps: it ran when the first order was given, or it does not follow ID 1.
    Perhaps,
}

/// The frames of the order in force.
#[derive(Clone, Debug)]
pub(super) struct Modes {
    /// Mode 2 in place of mode 1 on ECUs that know it.
    split_switch: bool,
    mode: Mode,
    id6: Id6,
    inherited: Inherited,
}

impl Modes {
    /// Nothing is commanded, and the ECU was given nothing.
    pub const fn new(split_switch: bool) -> Self {
        Self {
            split_switch,
            mode: Mode::Listen,
            id6: Id6::Released,
            inherited: Inherited::No { not_followed: 0 },
        }
    }

    /// An order. `alive`: the ECU reports an engine that starts or runs. True if the order is of another kind than the one
    /// before: its numbers make none.
    pub fn order(&mut self, now: Instant, order: Order, alive: bool) -> bool {
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
        // An ECU that runs already may have been given its switch by ID 6 before.
        if alive && matches!(self.mode, Mode::Listen) {
            self.inherited = Inherited::Perhaps;
        }
        if let Id6::Given { partner_due, .. } = &mut self.id6 {
            *partner_due = false;
        }
        self.mode = mode;
        true
    }

    /// An emergency stop is ordered.
    pub const fn stops(&self) -> bool {
        matches!(self.mode, Mode::Stop { .. })
    }

    /// Standby is ordered.
    pub const fn stands_by(&self) -> bool {
        matches!(self.mode, Mode::Standby { .. })
    }

    /// The ECU was given its switch by ID 6, so it ignores the one of ID 1.
    pub const fn switch_by_id6(&self) -> bool {
        !matches!(self.id6, Id6::Released)
    }

    /// The same, before a reset of the node.
    pub const fn resume_switch_by_id6(&mut self) {
        if matches!(self.id6, Id6::Released) {
            self.id6 = Id6::Given { factor: RpmFactor::OFF, partner_due: false };
        }
    }

    /// The switch that the ECU reports. One that does not follow the switch of ID 1 was given another by ID 6 before.
    pub fn reported(&mut self, now: Instant, reported: ReportedSwitch) {
        let (expected, follows_from) = match self.mode {
            Mode::Standby { follows_from, .. } => (ReportedSwitch::Standby, follows_from),
            Mode::Throttle { doubted: false, follows_from, .. }
            | Mode::Rpm { doubted: false, follows_from, .. } => (ReportedSwitch::Run, follows_from),
            _ => return,
        };
        let Inherited::No { not_followed } = &mut self.inherited else { return };
        if reported == expected || now < follows_from {
            *not_followed = 0;
            return;
        }
        *not_followed += 1;
        if *not_followed >= NOT_FOLLOWED {
            self.inherited = Inherited::Perhaps;
        }
    }

    /// The frame that a new RPM_X gives a meaning to comes next. Asked once for each slot.
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

    /// The last frame is out. True if its RPM_X is new: what it gives a meaning to follows at once, because ECUs may ignore
    /// ID 7 before it, or ID 1.
    pub fn sent(&mut self) -> bool {
        let Id6::Sending { before, factor, switch } = self.id6 else { return false };
        let partner_due = switch != Switch::Pwm && before != factor;
        self.id6 = match switch {
            Switch::Pwm => Id6::Released,
            _ => Id6::Given { factor, partner_due },
        };
        partner_due
    }

    /// The last frame is not out, or not whole.
    pub const fn not_sent(&mut self) {
        if let Id6::Sending { before, .. } = self.id6 {
            self.id6 = Id6::Given { factor: before, partner_due: false };
        }
    }

    fn compose(&mut self, known: &Known) -> Control {
        let by_id6 = self.by_id6(known);
        let (id6_given, factor_given) = (self.switch_by_id6(), self.id6.factor());
        // The ECU ignores the switch of ID 1 in modes 2 and 3. It is sent all the same, and never as SW 0,
        // because an ECU that restarted has forgotten ID 6 and would take SW 0 for a hand-over to PWM (ZK-8).
        let id1 = |switch, throttle| Control::Throttle { switch, throttle };
        let id6 = |switch, factor| Control::Mode { factor, switch };
        match &mut self.mode {
            // Nothing that could start an engine.
            Mode::Listen | Mode::Throttle { doubted: true, .. } => Control::KeepAlive,
            Mode::Stop { by_id6: before, next } => {
                let (id1, id6) = (id1(Switch::Stop, Throttle::IDLE), id6(Switch::Stop, RpmFactor::OFF));
                match (by_id6, *before) {
                    (false, _) => id1,
                    // An ECU that was given a switch by ID 6 has to be given the next one there, too.
                    (true, true) => next.take(id6, id1),
                    // A stop by ID 1 alone is for ECUs that never got an ID 6.
                    (true, false) => next.take(id1, id6),
                }
            }
            Mode::Standby { next, .. } => {
                let id1 = id1(Switch::Standby, Throttle::IDLE);
                if by_id6 { next.take(id6(Switch::Standby, RpmFactor::OFF), id1) } else { id1 }
            }
            // A hand-over goes out in ID 1 before ID 6 lets go, or the switch that ID 1 had last would be in control for a slot.
            Mode::Pwm { next } => {
                let id1 = id1(Switch::Pwm, Throttle::IDLE);
                if by_id6 { next.take(id1, id6(Switch::Pwm, RpmFactor::OFF)) } else { id1 }
            }
            // Leaving mode 3, the throttle goes first: ID 6 must not bring an old one into force.
            Mode::Throttle { throttle, next, .. } => {
                let id1 = id1(Switch::Run, *throttle);
                if by_id6 { next.take(id1, id6(Switch::Run, RpmFactor::OFF)) } else { id1 }
            }
            // ID 0, and in mode 3 the rpm in turn with it. An ECU that restarted has forgotten ID 6 and ignores ID 7.
            Mode::Rpm { rpm, doubted: true, factor, next, .. } => {
                // Also when its version has been forgotten with the link: the engine is in mode 3 with this factor.
                let in_mode_3 =
                    factor.is_some_and(|factor| factor == factor_given && factor != RpmFactor::OFF);
                let takes_rpm = id6_given && known.knows_modes() && known.max_rpm.is_some();
                match next.flip() {
                    Half::Second if in_mode_3 || takes_rpm => {
                        let factor = *factor.get_or_insert_with(|| covering(known));
                        Control::Rpm(RpmCode::for_target(*rpm, factor))
                    }
                    _ => Control::KeepAlive,
                }
            }
            // An ECU of a version without speed control took the place of the one that got the demand.
            Mode::Rpm { .. } if !known.knows_modes() => id1(Switch::Run, Throttle::IDLE),
            // Mode 3. The rpm goes first: the mode must not come into force with an old one.
            Mode::Rpm { rpm, factor, next, .. } => {
                let factor = *factor.get_or_insert_with(|| covering(known));
                next.take(Control::Rpm(RpmCode::for_target(*rpm, factor)), id6(Switch::Run, factor))
            }
        }
    }

    /// Whether the switch goes by ID 6. Run needs a version that two reports agree on and that knows it (ZK-7). Standby
    /// goes by ID 6 as well wherever ID 6 was used, and a stop also where the version is not known: a version below 4
    /// ignores it.
    fn by_id6(&self, known: &Known) -> bool {
        let given = self.switch_by_id6();
        let perhaps = matches!(self.inherited, Inherited::Perhaps);
        let knows_it = known.knows_modes();
        match self.mode {
            Mode::Stop { .. } => given || knows_it || known.version.is_none(),
            // An ECU at rest that two reports say is older has never got an ID 6: another one was plugged in.
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
