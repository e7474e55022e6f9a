//! How an engine is supervised: every number, with its unit, range and default. Checked as a whole.

use crate::command::Origin;
use crate::units::{Celsius, Millivolts, Rpm, Throttle};
use embassy_time::Duration;

/// Everything about the supervision of one engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Supervision {
    /// How long each source may be silent.
    pub ages: SourceAges,
    /// A source that was lost has to speak for so long without a gap before it rules again. Default 1 s, 0.1 s to 60 s.
    pub recover_after: Duration,
    /// A source that has spoken without a gap for `recover_after` and returns within this after its age limit goes on at
    /// `rise`, without a take-over. Default 1 s, at most 10 s.
    pub return_within: Duration,
    /// What happens to the demand when another source takes over.
    pub takeover: Takeover,
    /// What happens when the ruling source falls silent while the engine is ordered to run.
    pub loss: Loss,
    /// What has to be true for a start.
    pub start: StartRules,
    /// How fast the demand may change. Off by default.
    pub slew: Slew,
    /// How fast the demand rises after a start, a take-over, a reduction, a gap or a reset, in tenths of a percent a
    /// second; until it has reached what is commanded. Default 500 (50 % a second), at least 10.
    pub rise: u16,
    /// What is watched, and what is done about it.
    pub limits: Limits,
    /// Speed control over the throttle, for ECUs without one. Off by default.
    pub governor: Option<Governor>,
    /// The demand is reduced to so many thousandths while another engine of the group has failed. Default `None`: that is
    /// told, and this engine left alone. At most 1000.
    pub when_other_fails: Option<u16>,
    /// An exhaust hotter than this burns, where an ECU reports faults in place of a state (AMT-8). Default 300 °C.
    pub burning_egt: Celsius,
    /// A service that opens the fuel is closed after this. Default 30 s, 1 s to 300 s.
    pub service_time: Duration,
}

/// How long each source may be silent, in the order of their priority. 0.05 s to 60 s.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SourceAges {
    /// A local emergency input. Default 0.5 s.
    pub emergency: Duration,
    /// Radio control. Default 0.5 s.
    pub rc: Duration,
    /// MAVLink, whose streams slow down during transfers. Default 1 s.
    pub mavlink: Duration,
    /// A test rig or bench program. Default 0.5 s.
    pub bench: Duration,
}

impl SourceAges {
    /// The age limit of a source. The node itself never falls silent.
    pub const fn of(&self, origin: Origin) -> Duration {
        match origin {
            Origin::Node => Duration::MAX,
            Origin::Emergency => self.emergency,
            Origin::Rc => self.rc,
            Origin::Mavlink => self.mavlink,
            Origin::Bench => self.bench,
        }
    }

    /// The longest of them.
    pub fn longest(&self) -> Duration {
        self.emergency.max(self.rc).max(self.mavlink).max(self.bench)
    }
}

/// A source that takes over is held off until its demand is close to the one in force, or until it has waited.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Takeover {
    /// Close enough, for throttles. Default 5 %.
    pub throttle_band: Throttle,
    /// Close enough, for rpm demands. Default 5000 rpm. A throttle and an rpm are never close.
    pub rpm_band: Rpm,
    /// The longest wait. Default 2 s, at most 60 s.
    pub within: Duration,
}

/// The stages of loss of the ruling source.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Loss {
    /// The last demand is held for so long, counted from the source's age limit. Default 1 s, at most 60 s.
    pub hold: Duration,
    /// Then the demand goes to this throttle. It only ever lowers: a lower demand stays. An rpm demand goes
    /// to the engine's idle rpm instead. Default 0 %.
    pub throttle: Throttle,
    /// It goes there at so many tenths of a percent a second. Default 500 (50 % a second), at least 10.
    pub ramp: u16,
    /// Then, so long after `hold` has passed, standby. Default `None`: never, as long as the ECU reports a running engine.
    /// Where it does not, standby after 10 s.
    pub standby_after: Option<Duration>,
    /// A lower source that streams standby ends a run that another began only when the fail-safe stage has lasted this
    /// long. Default 5 s, at most 3600 s.
    pub lower_standby_after: Duration,
}

/// What has to be true for a start. A refusal names the first that is not.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StartRules {
    /// The engine has to be armed. Default `true`.
    pub arming: bool,
    /// The link has to be up for so long. Default 1 s, at most 60 s.
    pub link_stable: Duration,
    /// The demand that asks for the start is at most this throttle. Default 2 %.
    pub idle_band: Throttle,
    /// The exhaust is at most so hot; a hot engine is cooled first. Default 100 °C. Below −40 °C or above 1100 °C the
    /// thermocouple is broken and the temperature not known.
    pub egt_max: Celsius,
    /// The supply had at least so much when the ECU last gave it, if it has. Default `None`: not checked.
    pub supply_min: Option<Millivolts>,
    /// The engine has to run so long after the start was asked for, unless the ECU gives a start-up time of its
    /// own, which then counts twice, within the same range. Default 120 s, 5 s to 600 s.
    pub timeout: Duration,
    /// Between the starts of two engines of a group. Default 10 s, at most 600 s.
    pub gap: Duration,
}

/// Range of [`StartRules::timeout`].
pub(super) const START_TIMEOUT_MIN: Duration = Duration::from_secs(5);
pub(super) const START_TIMEOUT_MAX: Duration = Duration::from_secs(600);

/// How fast the demand may change, in tenths of a percent of throttle a second; an rpm demand in the same share of
/// the engine's maximum rpm. At least 10 where given. A stop and a fail-safe are never delayed by it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Slew {
    /// Upward. Default `None`: at once.
    pub up: Option<u16>,
    /// Downward. Default `None`: at once.
    pub down: Option<u16>,
}

/// What is done when a limit is passed.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Action {
    /// Only told.
    #[default]
    None,
    /// The demand goes to the fail-safe throttle and stays there until standby is commanded.
    FailSafe,
    /// Standby.
    Standby,
}

/// A limit and what is done when it is passed. `None` as the limit: not watched; of the shaft speed: the ECU's own figure.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limit<T> {
    /// The limit.
    pub at: Option<T>,
    /// What is done.
    pub action: Action,
}

impl<T> Limit<T> {
    /// Watched, and only reported.
    pub const fn tell(at: T) -> Self {
        Self { at: Some(at), action: Action::None }
    }

    /// Not watched. Of the shaft speed: told at the ECU's own figure.
    pub const NONE: Self = Self { at: None, action: Action::None };
}

/// What is watched. A limit counts as passed when two values in a row are beyond it: AMT frames carry no checksum,
/// and one odd frame is no fault.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Limits {
    /// Shaft speed. Default: told at 105 % of the maximum that the ECU gives. A limit here replaces that; the action
    /// holds for either.
    pub over_speed: Limit<Rpm>,
    /// Exhaust temperature. Default: told at 800 °C.
    pub over_temperature: Limit<Celsius>,
    /// Shaft speed while running. Default: told at 80 % of the idle rpm that the ECU gives. A limit here replaces that; the
    /// action holds for either.
    pub low_rpm: Limit<Rpm>,
    /// Rise of the exhaust temperature during a start, in °C a second. Default: told at 200 °C/s; the simulated
    /// turbines rise by 125 °C/s in a good start and by 270 °C/s in a hot one. At least 10.
    pub hot_start: Limit<u16>,
    /// The shaft loses this share of its speed, in percent, within 2 s and without a lower demand. Default: told at
    /// 25 %. 5 to 95.
    pub flame_out: Limit<u8>,
    /// Supply voltage. Default: not watched.
    pub supply_low: Limit<Millivolts>,
    /// A change of shaft speed that no turbine can make, in rpm a second. Default: told at 150 000 rpm/s. At least
    /// 1000.
    pub implausible: Limit<u32>,
    /// Faults that the ECU reports.
    pub ecu_fault: Action,
}

/// Speed control over the throttle (integer PI), for AMT and for ZK before version 4.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Governor {
    /// Tenths of a percent of throttle for 1000 rpm of error. 1 to 100.
    pub proportional: u16,
    /// Tenths of a percent of throttle a second for 1000 rpm of error. 0 to 100.
    pub integral: u16,
    /// The highest throttle that it may set.
    pub authority: Throttle,
    /// Tenths of a percent a second that its output may rise. 10 to 1000.
    pub slew: u16,
    /// The highest shaft speed that may be asked for; higher ones are clamped. 10 000 rpm to 250 000 rpm.
    pub max_rpm: Rpm,
    /// Older rpm telemetry is not believed: the throttle then goes to idle. 0.2 s to 5 s.
    pub max_age: Duration,
}

impl Governor {
    /// Tuned on the simulated Olympus and Titan, in steps of 10 % to 50 % between 40 % and 90 % of their maximum speed
    /// (`tests/wire_governor.rs`): overshoot at most 3.1 % of the step, within 1.5 % of the target after at most 14.2 s,
    /// then within 0.6 %. Twice the integral gain is a limit cycle: the engines accelerate at a limited rate.
    pub const DEFAULT: Self = Self {
        proportional: 8,
        integral: 6,
        authority: Throttle::FULL,
        slew: 300,
        max_rpm: Rpm::new(110_000),
        max_age: Duration::from_millis(600),
    };
}

impl Loss {
    /// Hold 1 s, then to idle at 50 % a second, never standby.
    pub const DEFAULT: Self = Self {
        hold: Duration::from_secs(1),
        throttle: Throttle::IDLE,
        ramp: 500,
        standby_after: None,
        lower_standby_after: Duration::from_secs(5),
    };
}

impl Supervision {
    /// The defaults named at each field.
    pub const DEFAULT: Self = Self {
        ages: SourceAges {
            emergency: Duration::from_millis(500),
            rc: Duration::from_millis(500),
            mavlink: Duration::from_secs(1),
            bench: Duration::from_millis(500),
        },
        recover_after: Duration::from_secs(1),
        return_within: Duration::from_secs(1),
        takeover: Takeover {
            throttle_band: percent(5),
            rpm_band: Rpm::new(5000),
            within: Duration::from_secs(2),
        },
        loss: Loss::DEFAULT,
        start: StartRules {
            arming: true,
            link_stable: Duration::from_secs(1),
            idle_band: percent(2),
            egt_max: Celsius::from_tenths(1000),
            supply_min: None,
            timeout: Duration::from_secs(120),
            gap: Duration::from_secs(10),
        },
        slew: Slew { up: None, down: None },
        rise: 500,
        limits: Limits {
            over_speed: Limit::NONE,
            over_temperature: Limit::tell(Celsius::from_tenths(8000)),
            low_rpm: Limit::NONE,
            hot_start: Limit::tell(200),
            flame_out: Limit::tell(25),
            supply_low: Limit::NONE,
            implausible: Limit::tell(150_000),
            ecu_fault: Action::None,
        },
        governor: None,
        when_other_fails: None,
        burning_egt: Celsius::from_tenths(3000),
        service_time: Duration::from_secs(30),
    };

    /// Checks every range.
    ///
    /// # Errors
    /// The first field that is out of its range.
    pub const fn validate(&self) -> Result<(), Field> {
        let ages = &self.ages;
        if !source_age(ages.emergency) {
            return Err(Field::AgeEmergency);
        }
        if !source_age(ages.rc) {
            return Err(Field::AgeRc);
        }
        if !source_age(ages.mavlink) {
            return Err(Field::AgeMavlink);
        }
        if !source_age(ages.bench) {
            return Err(Field::AgeBench);
        }
        if below(self.recover_after, 100) || above(self.recover_after, 60_000) {
            return Err(Field::RecoverAfter);
        }
        if above(self.takeover.within, 60_000) {
            return Err(Field::TakeoverWithin);
        }
        if above(self.loss.hold, 60_000) {
            return Err(Field::LossHold);
        }
        if matches!(self.loss.standby_after, Some(after) if above(after, 3_600_000)) {
            return Err(Field::LossStandby);
        }
        if self.loss.ramp < 10 {
            return Err(Field::LossRamp);
        }
        if above(self.start.link_stable, 60_000) {
            return Err(Field::LinkStable);
        }
        if above(self.start.timeout, START_TIMEOUT_MAX.as_millis())
            || below(self.start.timeout, START_TIMEOUT_MIN.as_millis())
        {
            return Err(Field::StartTimeout);
        }
        if above(self.start.gap, 600_000) {
            return Err(Field::StartGap);
        }
        if matches!(self.slew.up, Some(..=9)) {
            return Err(Field::SlewUp);
        }
        if matches!(self.slew.down, Some(..=9)) {
            return Err(Field::SlewDown);
        }
        if matches!(self.limits.hot_start.at, Some(..=9)) {
            return Err(Field::HotStart);
        }
        if matches!(self.limits.implausible.at, Some(..=999)) {
            return Err(Field::Implausible);
        }
        if matches!(self.limits.flame_out.at, Some(..=4 | 96..)) {
            return Err(Field::FlameOut);
        }
        if let Some(governor) = &self.governor {
            if governor.proportional == 0 || governor.proportional > 100 {
                return Err(Field::GovernorProportional);
            }
            if governor.integral > 100 {
                return Err(Field::GovernorIntegral);
            }
            if governor.slew < 10 || governor.slew > 1000 {
                return Err(Field::GovernorSlew);
            }
            if governor.max_rpm.get() < 10_000 || governor.max_rpm.get() > 250_000 {
                return Err(Field::GovernorMaxRpm);
            }
            if below(governor.max_age, 200) || above(governor.max_age, 5_000) {
                return Err(Field::GovernorMaxAge);
            }
        }
        if matches!(self.when_other_fails, Some(1001..)) {
            return Err(Field::WhenOtherFails);
        }
        if above(self.return_within, 10_000) {
            return Err(Field::ReturnWithin);
        }
        if above(self.loss.lower_standby_after, 3_600_000) {
            return Err(Field::LossLowerStandby);
        }
        if self.rise < 10 {
            return Err(Field::Rise);
        }
        if self.burning_egt.tenths() < 1000 || self.burning_egt.tenths() > 6000 {
            return Err(Field::BurningEgt);
        }
        if below(self.service_time, 1000) || above(self.service_time, 300_000) {
            return Err(Field::ServiceTime);
        }
        Ok(())
    }
}

/// A field of [`Supervision`] that is out of its range.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Field {
    /// `ages.emergency`.
    AgeEmergency,
    /// `ages.rc`.
    AgeRc,
    /// `ages.mavlink`.
    AgeMavlink,
    /// `ages.bench`.
    AgeBench,
    /// `recover_after`.
    RecoverAfter,
    /// `takeover.within`.
    TakeoverWithin,
    /// `loss.hold`.
    LossHold,
    /// `loss.standby_after`.
    LossStandby,
    /// `loss.ramp`.
    LossRamp,
    /// `start.link_stable`.
    LinkStable,
    /// `start.timeout`.
    StartTimeout,
    /// `start.gap`.
    StartGap,
    /// `slew.up`.
    SlewUp,
    /// `slew.down`.
    SlewDown,
    /// `limits.hot_start`.
    HotStart,
    /// `limits.implausible`.
    Implausible,
    /// `limits.flame_out`.
    FlameOut,
    /// `governor.proportional`.
    GovernorProportional,
    /// `governor.integral`.
    GovernorIntegral,
    /// `governor.slew`.
    GovernorSlew,
    /// `governor.max_age`.
    GovernorMaxAge,
    /// `when_other_fails`.
    WhenOtherFails,
    /// `return_within`.
    ReturnWithin,
    /// `loss.lower_standby_after`.
    LossLowerStandby,
    /// `rise`.
    Rise,
    /// `burning_egt`.
    BurningEgt,
    /// `service_time`.
    ServiceTime,
    /// `governor.max_rpm`.
    GovernorMaxRpm,
}

impl Field {
    /// The field's name and its range.
    pub const fn message(self) -> &'static str {
        match self {
            Self::AgeEmergency => "ages.emergency: 0.05 s to 60 s",
            Self::AgeRc => "ages.rc: 0.05 s to 60 s",
            Self::AgeMavlink => "ages.mavlink: 0.05 s to 60 s",
            Self::AgeBench => "ages.bench: 0.05 s to 60 s",
            Self::RecoverAfter => "recover_after: 0.1 s to 60 s",
            Self::TakeoverWithin => "takeover.within: at most 60 s",
            Self::LossHold => "loss.hold: at most 60 s",
            Self::LossStandby => "loss.standby_after: at most 3600 s",
            Self::LossRamp => "loss.ramp: at least 10 tenths of a percent a second",
            Self::LinkStable => "start.link_stable: at most 60 s",
            Self::StartTimeout => "start.timeout: 5 s to 600 s",
            Self::StartGap => "start.gap: at most 600 s",
            Self::SlewUp => "slew.up: at least 10 tenths of a percent a second",
            Self::SlewDown => "slew.down: at least 10 tenths of a percent a second",
            Self::HotStart => "limits.hot_start: at least 10 °C a second",
            Self::Implausible => "limits.implausible: at least 1000 rpm a second",
            Self::FlameOut => "limits.flame_out: 5 % to 95 %",
            Self::GovernorProportional => "governor.proportional: 1 to 100 tenths of a percent for 1000 rpm",
            Self::GovernorIntegral => {
                "governor.integral: at most 100 tenths of a percent a second for 1000 rpm"
            }
            Self::GovernorSlew => "governor.slew: 10 to 1000 tenths of a percent a second",
            Self::GovernorMaxAge => "governor.max_age: 0.2 s to 5 s",
            Self::WhenOtherFails => "when_other_fails: at most 1000 thousandths",
            Self::ReturnWithin => "return_within: at most 10 s",
            Self::LossLowerStandby => "loss.lower_standby_after: at most 3600 s",
            Self::Rise => "rise: at least 10 tenths of a percent a second",
            Self::BurningEgt => "burning_egt: 100 °C to 600 °C",
            Self::ServiceTime => "service_time: 1 s to 300 s",
            Self::GovernorMaxRpm => "governor.max_rpm: 10 000 rpm to 250 000 rpm",
        }
    }
}

const fn percent(percent: u8) -> Throttle {
    match Throttle::from_percent(percent) {
        Ok(throttle) => throttle,
        Err(_) => Throttle::FULL,
    }
}

const fn source_age(age: Duration) -> bool {
    !below(age, 50) && !above(age, 60_000)
}

const fn above(time: Duration, ms: u64) -> bool {
    time.as_ticks() > Duration::from_millis(ms).as_ticks()
}

const fn below(time: Duration, ms: u64) -> bool {
    time.as_ticks() < Duration::from_millis(ms).as_ticks()
}
