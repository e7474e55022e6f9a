//! Settings of the supervision of an engine: each with its unit, range and default, checked together.

use crate::command::Origin;
use crate::limit::{Action, Limit};
use crate::sentence::sentences;
use crate::setting::{
    self, Effect, Row, Setting, SettingError, SettingId, by_place, column, kind, rows, settings, symbol,
};
use embassy_time::Duration;

settings! {
    /// Timeout of each source, in the order of their priority.
    pub struct SourceTimeouts, "timeouts.", AtOnce {
        emergency: ms "SRC_EMERG_TOUT" = 500 in 50..=60_000, ConfigOnly, "Timeout of a local emergency input.";
        rc: ms "SRC_RC_TOUT" = 500 in 50..=60_000, ConfigOnly, "Timeout of radio control.";
        mavlink: ms "SRC_MAV_TOUT" = 1000 in 50..=60_000, "Timeout of MAVLink, whose streams slow down during transfers.";
        bench: ms "SRC_BENCH_TOUT" = 500 in 50..=60_000, ConfigOnly, "Timeout of a test rig or bench program.";
    }
}

impl SourceTimeouts {
    /// The timeout of a source. The node itself never falls silent.
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
    #[inline(never)]
    pub fn longest(&self) -> Duration {
        self.emergency.max(self.rc).max(self.mavlink).max(self.bench)
    }
}

settings! {
    /// A source that takes over waits until its demand is close to the one in force, or until its wait is over.
    pub struct Takeover, "takeover.", AtOnce {
        throttle_band: throttle "TKO_THR_BAND" = 50 in 0..=1000, ConfigOnly, "Largest difference of two throttles for a take-over.";
        rpm_band: rpm "TKO_RPM_BAND" = 5000 in 0..=16_000_000, ConfigOnly, "Largest difference of two rpm demands for a take-over. A throttle and an rpm are never close.";
        within: ms "TKO_WAIT" = 2000 in 0..=60_000, ConfigOnly, "Longest wait of a source that takes over.";
    }
}

settings! {
    /// The stages of loss of the source in control.
    pub struct Loss, "loss.", AtOnce {
        /// A hold that is under way keeps its length: a new value applies from the next loss on.
        hold: ms "LOSS_HOLD" = 1000 in 0..=60_000, "Time for which the last demand is held, counted from the source's timeout.";
        throttle: throttle "LOSS_THR" = 0 in 0..=1000, "Fail-safe throttle. It only ever lowers: a lower demand stays. An rpm demand goes to the engine's idle rpm instead.";
        ramp: rate "LOSS_RAMP" = 500 in 10..=65_535, "Rate at which the demand goes to the fail-safe throttle.";
        standby_after: ms_or_off "LOSS_STANDBY" = -1 in 0..=3_600_000, "Standby, counted from the end of the hold. Off: never while the ECU reports a running engine, otherwise after 10 s.";
        lower_standby_after: ms "LOSS_LOW_STBY" = 5000 in 0..=3_600_000, ConfigOnly, "A lower source that streams standby ends a run that another began only when the fail-safe stage has lasted this long.";
    }
}

settings! {
    /// Interlocks of a start. A refusal names the first that is not satisfied.
    pub struct StartRules, "start.", AtOnce {
        arming: yes_no "START_ARMING" = 1 in 0..=1, "The engine has to be armed.";
        link_stable: ms "START_LINK" = 1000 in 0..=60_000, ConfigOnly, "Time for which the link has to be up without a gap.";
        idle_band: throttle "START_IDLE" = 20 in 0..=1000, "Highest throttle of a demand that starts the engine.";
        egt_max: celsius "START_EGT" = 1000 in -32_768..=32_767, "Highest exhaust temperature; a hot engine has to cool first. Below −40 °C or above 1100 °C the thermocouple counts as broken and the temperature as unknown.";
        supply_min: millivolts_or_off "START_SUPPLY" = -1 in 0..=1_000_000, "Lowest supply voltage, as last reported by the ECU, or measured by the board where the ECU reports none. Off: not checked.";
        timeout: ms "START_TIMEOUT" = 120_000 in 5000..=600_000, "Time from the start to a running engine, unless the ECU reports its own start-up time: then twice that, within the same range.";
        gap: ms "START_GAP" = 10_000 in 0..=600_000, "Time between the starts of two engines of a group.";
    }
}

/// Range of [`StartRules::timeout`], as its row has it.
pub(super) const START_TIMEOUT: (Duration, Duration) = {
    let row = setting::row("START_TIMEOUT", StartRules::ROWS);
    (Duration::from_millis(row.min as u64), Duration::from_millis(row.max as u64))
};

settings! {
    /// Rates of change of the demand in normal flight; of an rpm demand, the same share of the engine's maximum rpm. They
    /// never delay a stop or a fail-safe.
    pub struct Slew, "slew.", AtOnce {
        up: rate_or_off "SLEW_UP" = -1 in 10..=65_535, "Highest rate upward. Off: at once.";
        down: rate_or_off "SLEW_DOWN" = -1 in 10..=65_535, "Highest rate downward. Off: at once.";
    }
}

/// Declares [`Limits`]: two settings for each limit, its value and its action.
macro_rules! limits {
    ( $( $field:ident: $inner:ident $kind:ident $name:literal = $default:literal in $min:literal..=$max:literal $(, $column:ident)*, $action:literal, $text:literal; )* ) => {
        /// Limits of an engine. A limit is violated when two consecutive values exceed it: AMT frames carry no checksum, and
        /// one odd frame is not a fault.
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub struct Limits {
            $(
                #[doc = $text]
                #[doc = ""]
                #[doc = concat!("Settings `", $name, "` (default ", $default, ", ", $min, " to ", $max, " ", symbol!($kind), ") and `", $action, "`.")]
                pub $field: Limit<kind::$inner::Type>,
            )*
            /// Action on a fault that the ECU reports.
            ///
            /// Setting `LIM_FAULT_ACT`.
            pub ecu_fault: Action,
        }

        impl Limits {
            /// The rows of the table of settings.
            pub const SETTINGS: &'static [Setting] = &[
                $(
                    Setting {
                        name: $name,
                        field: concat!("limits.", stringify!($field), ".at"),
                        unit: kind::$kind::UNIT,
                        min: $min,
                        max: $max,
                        default: $default,
                        may_be_off: true,
                        effect: column!(effect AtOnce $($column)*),
                        parameter: column!(parameter $($column)*),
                        text: $text,
                        message: concat!("limits.", stringify!($field), ": ", $min, " to ", $max, " ", symbol!($kind)),
                    },
                    Self::action($action, concat!("limits.", stringify!($field), ".action"), column!(parameter $($column)*)),
                )*
                Self::action("LIM_FAULT_ACT", "limits.ecu_fault", true),
            ];

            /// The same rows without their texts.
            pub const ROWS: &'static [Row] = &rows::<{ Self::SETTINGS.len() }>(Self::SETTINGS);

            const fn action(name: &'static str, field: &'static str, parameter: bool) -> Setting {
                Setting {
                    name,
                    field,
                    unit: crate::setting::Unit::Action,
                    min: 0,
                    max: 2,
                    default: 0,
                    may_be_off: false,
                    effect: Effect::AtOnce,
                    parameter,
                    text: "Action, in addition to the report.",
                    message: concat!("a limit's action: ", symbol!(action)),
                }
            }

            /// Defaults of the table.
            pub const DEFAULT: Self = Self {
                $( $field: Limit { at: kind::$kind::make($default), action: Action::Report }, )*
                ecu_fault: Action::Report,
            };

            const NAMES: &'static [&'static str] = &[$( $name, $action, )* "LIM_FAULT_ACT"];

            const fn number_at(&self, place: usize) -> i32 {
                by_place!(place, {
                    $(
                        true => kind::$kind::number(&self.$field.at);
                        true => kind::action::number(&self.$field.action);
                    )*
                    true => kind::action::number(&self.ecu_fault);
                }, crate::setting::OFF)
            }

            fn set_at<const ALL: bool>(&mut self, place: usize, value: i32) -> bool {
                by_place!(place, {
                    $(
                        ALL || column!(parameter $($column)*) => { self.$field.at = kind::$kind::make(value); true };
                        ALL || column!(parameter $($column)*) => { self.$field.action = kind::action::make(value); true };
                    )*
                    true => { self.ecu_fault = kind::action::make(value); true };
                }, false)
            }
        }

        settings!(@by_name Limits);
    };
}

limits! {
    over_speed: rpm rpm_or_off "LIM_RPM" = -1 in 0..=16_000_000, "LIM_RPM_ACT", "Highest shaft speed. Off: 105 % of the maximum that the ECU reports; the action applies to either.";
    over_temperature: celsius celsius_or_off "LIM_EGT" = 8000 in 0..=32_767, "LIM_EGT_ACT", "Highest exhaust temperature.";
    low_rpm: rpm rpm_or_off "LIM_LOW_RPM" = -1 in 0..=16_000_000, "LIM_LOW_RPM_ACT", "Lowest shaft speed while running. Off: 80 % of the idle rpm that the ECU reports; the action applies to either.";
    hot_start: celsius_rate celsius_rate_or_off "LIM_HOT" = 200 in 10..=65_535, "LIM_HOT_ACT", "Fastest rise of the exhaust temperature during a start. The simulated turbines rise by 125 °C/s in a good start and by 270 °C/s in a hot one.";
    flame_out: percent percent_or_off "LIM_FLAME" = 25 in 5..=95, "LIM_FLAME_ACT", "Largest share of its speed that the shaft may lose within 2 s without a lower demand.";
    supply_low: millivolts millivolts_or_off "LIM_SUPPLY" = -1 in 0..=1_000_000, "LIM_SUPPLY_ACT", "Lowest supply voltage.";
    implausible: rpm_rate rpm_rate_or_off "LIM_JUMP" = 150_000 in 1000..=16_000_000, ConfigOnly, "LIM_JUMP_ACT", "Fastest change of shaft speed that a turbine can make.";
}

settings! {
    /// Speed control over the throttle (integer PI), for AMT and for ZK before version 4.
    ///
    /// The defaults are tuned on the simulated Olympus and Titan, in steps of 10 % to 50 % between 40 % and 90 % of their
    /// maximum speed (`tests/wire_governor.rs`): overshoot at most 3.1 % of the step, within 1.5 % of the target after at most
    /// 14.2 s, then within 0.6 %. Twice the integral gain is a limit cycle: the engines accelerate at a limited rate.
    pub struct Governor, "governor.", AtOnce {
        proportional: gain "GOV_P" = 8 in 1..=100, ConfigOnly, "Throttle for 1000 rpm of error.";
        integral: gain "GOV_I" = 6 in 0..=100, ConfigOnly, "Throttle per second for 1000 rpm of error.";
        authority: throttle "GOV_THR_MAX" = 1000 in 0..=1000, ConfigOnly, "Highest throttle that the governor may set.";
        slew: rate "GOV_SLEW" = 300 in 10..=1000, ConfigOnly, "Rate at which its output may rise.";
        max_rpm: rpm "GOV_RPM_MAX" = 110_000 in 10_000..=250_000, ConfigOnly, "Highest shaft speed that may be commanded; higher demands are clamped.";
        max_age: ms "GOV_RPM_AGE" = 600 in 200..=5000, ConfigOnly, "Older rpm telemetry is not used: the throttle then goes to idle.";
    }
}

settings! {
    /// Supervision of one engine.
    pub struct Supervision, "", AtOnce {
        recover_after: ms "SRC_RECOVER" = 1000 in 100..=60_000, ConfigOnly, "Time without a gap for which a source that was lost has to be received before it is in control again.";
        return_within: ms "SRC_RETURN" = 1000 in 0..=10_000, ConfigOnly, "A source that was received without a gap for `recover_after` and returns within this time after its timeout resumes at `rise`, without a take-over.";
        rise: rate "RISE" = 500 in 10..=65_535, "Rate at which the demand rises after a start, a take-over, a reduction, a gap or a reset, until it has reached the commanded demand.";
        when_other_fails: share_or_off "OTHER_FAILS" = -1 in 0..=1000, "Share to which the demand is reduced while another engine of the group has failed. Off: the failure is only reported.";
        burning_egt: celsius "BURNING_EGT" = 3000 in 1000..=6000, ConfigOnly, "Exhaust temperature above which the engine counts as burning while its ECU reports faults instead of a state (AMT-8).";
        service_time: ms "SERVICE_TIME" = 30_000 in 1000..=300_000, ConfigOnly, "Longest time for which a service keeps the fuel pump open.";
    }
    groups {
        /// Timeout of each source.
        timeouts: SourceTimeouts = SourceTimeouts::DEFAULT;
        /// Take-over by another source.
        takeover: Takeover = Takeover::DEFAULT;
        /// Stages of loss when the source in control falls silent during a run.
        loss: Loss = Loss::DEFAULT;
        /// Interlocks of a start.
        start: StartRules = StartRules::DEFAULT;
        /// Rates of change of the demand. Off by default.
        slew: Slew = Slew::DEFAULT;
        /// Limits and their actions.
        limits: Limits = Limits::DEFAULT;
        /// Speed control over the throttle, for ECUs without one. Off by default (setting `GOV_ENABLE`).
        governor: Option<Governor> = None;
    }
}

/// Name of [`Supervision::governor`].
const GOVERNOR_NAME: &str = "GOV_ENABLE";
/// Row of [`Supervision::governor`], which is optional.
const GOVERNOR: Setting = Setting {
    name: GOVERNOR_NAME,
    field: "governor",
    unit: kind::yes_no::UNIT,
    min: 0,
    max: 1,
    default: 0,
    may_be_off: false,
    effect: Effect::AtOnce,
    parameter: false,
    text: "Speed control over the throttle, for ECUs without one (`Some(Governor::DEFAULT)`).",
    message: concat!("governor: ", symbol!(yes_no)),
};

/// Generates what every group of settings needs, in the order of the table. The last one is optional, and its switch comes before it.
macro_rules! groups {
    ($this:ident, { $( $group:ident: $place:expr; )* } optional $switch:ident $optional:ident: $option:expr) => {
        impl Supervision {
            const TABLES: usize = [$( stringify!($group) ),*].len() + 2;

            /// Table of settings, group by group. The order is fixed.
            pub const TABLE: [&'static [Setting]; Self::TABLES] =
                [$( $group::SETTINGS, )* &[$switch], $optional::SETTINGS];

            /// The same table without its texts.
            pub const TABLE_ROWS: [&'static [Row]; Self::TABLES] =
                [$( $group::ROWS, )* &rows::<1>(&[$switch]), $optional::ROWS];

            /// The check of each group.
            const fn checks(&$this) -> [Result<(), u8>; Self::TABLES] {
                let optional = match &$option {
                    Some(group) => group.check_own(),
                    None => Ok(()),
                };
                [$( $place.check_own(), )* Ok(()), optional]
            }

            /// The value of a setting; [`crate::setting::OFF`] where it is off. For a governor that is off: its default.
            pub fn number(&$this, name: &str) -> Option<i32> {
                if name == GOVERNOR_NAME {
                    return Some(i32::from($option.is_some()));
                }
                let optional = $option.unwrap_or($optional::DEFAULT);
                $this.of_groups::<true>(name).or_else(|| optional.own::<true>(name))
            }

            /// The value of a parameter. A governor has none.
            pub(crate) fn parameter(&$this, name: &str) -> Option<i32> {
                $this.of_groups::<false>(name)
            }

            fn of_groups<const ALL: bool>(&$this, name: &str) -> Option<i32> {
                None$( .or_else(|| $place.own::<ALL>(name)) )*
            }

            /// Changes a setting whose range has been checked. False: no setting has this name, or it belongs to a governor
            /// that is off.
            pub(crate) fn change(&mut $this, name: &str, number: i32) -> bool {
                if name == GOVERNOR_NAME {
                    let on = $option.unwrap_or($optional::DEFAULT);
                    $option = (number != 0).then_some(on);
                    return true;
                }
                $this.change_in_groups::<true>(name, number)
                    || $option.as_mut().is_some_and(|optional| optional.set_own::<true>(name, number))
            }

            /// Changes a parameter whose range has been checked. False: no parameter has this name.
            pub(crate) fn change_parameter(&mut $this, name: &str, number: i32) -> bool {
                $this.change_in_groups::<false>(name, number)
            }

            fn change_in_groups<const ALL: bool>(&mut $this, name: &str, number: i32) -> bool {
                false $( || $place.set_own::<ALL>(name, number) )*
            }
        }

        // The list has `Supervision`, which is not a group of itself; the optional group is listed separately.
        const _: () = assert!(
            Supervision::GROUPS == [$( stringify!($group) ),*].len(),
            "a group of `Supervision` is not in `groups!`"
        );
    };
}

groups! {
    self, {
        SourceTimeouts: self.timeouts;
        Takeover: self.takeover;
        Loss: self.loss;
        StartRules: self.start;
        Slew: self.slew;
        Supervision: self;
        Limits: self.limits;
    }
    optional GOVERNOR Governor: self.governor
}

impl Supervision {
    /// Checks every range.
    ///
    /// # Errors
    /// The first setting that is out of its range.
    pub const fn validate(&self) -> Result<(), SupervisionError> {
        let checks = self.checks();
        const LENGTHS: [u8; Supervision::TABLES] = {
            let mut lengths = [0; Supervision::TABLES];
            let mut group = 0;
            while group < lengths.len() {
                lengths[group] = Supervision::TABLE[group].len() as u8;
                group += 1;
            }
            lengths
        };
        let (mut group, mut before) = (0, 0);
        while group < checks.len() {
            if let Err(row) = checks[group] {
                return Err(SupervisionError { setting: SettingId(before + row) });
            }
            before += LENGTHS[group];
            group += 1;
        }
        Ok(())
    }

    /// The row that an error names.
    pub const fn row(id: SettingId) -> &'static Setting {
        let (mut group, mut row) = (0, id.0 as usize);
        while group < Self::TABLE.len() {
            if row < Self::TABLE[group].len() {
                return &Self::TABLE[group][row];
            }
            row -= Self::TABLE[group].len();
            group += 1;
        }
        &GOVERNOR
    }

    /// The number of a setting's row.
    pub fn id(name: &str) -> Option<SettingId> {
        let row = Self::TABLE.into_iter().flatten().position(|setting| setting.name == name)?;
        u8::try_from(row).ok().map(SettingId)
    }

    /// The row of a setting.
    pub fn setting(name: &str) -> Option<&'static Setting> {
        Self::TABLE.into_iter().flatten().find(|setting| setting.name == name)
    }

    /// Changes a setting.
    ///
    /// # Errors
    /// [`SettingError`], with nothing changed, if no setting has this name, the value is out of range, or it belongs to a
    /// governor that is off.
    pub fn set(&mut self, name: &str, number: i32) -> Result<(), SettingError> {
        let setting = Self::setting(name).ok_or(SettingError::Unknown)?;
        if !setting.allows(number) {
            return Err(SettingError::OutOfRange(setting));
        }
        if self.change(name, number) { Ok(()) } else { Err(SettingError::Off(setting)) }
    }
}

/// A setting of the supervision is out of its range.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub struct SupervisionError {
    /// The setting; [`Supervision::row`] has its name and range.
    pub setting: SettingId,
}

sentences!(SupervisionError {
} {
    error => "{}", Supervision::row(error.setting).message;
});

impl core::error::Error for SupervisionError {}

const _: () = assert!(Supervision::DEFAULT.validate().is_ok(), "a default is out of its range");
