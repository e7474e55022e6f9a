//! Settings: name, unit, range, default and text of each are in one place, where its field is declared.
//!
//! The macro `settings!` declares a struct of settings. From the same line come the field and its documentation, the
//! default, the check of the range, the error text, and the row of the table that `docs/failsafe.md` and the parameters of
//! MAVLink are made from. Every setting has a value as a whole number in its unit, so that one number can express any of them.

use crate::sentence::sentences;
use crate::units::{BaudRate, Whole};

/// Unit of a setting's number.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Unit {
    /// Milliseconds.
    Milliseconds,
    /// Microseconds.
    Microseconds,
    /// Tenths of a percent.
    PerMille,
    /// Tenths of a percent per second.
    PerMillePerSecond,
    /// Percent.
    Percent,
    /// Tenths of a degree Celsius.
    TenthsCelsius,
    /// Degrees Celsius per second.
    CelsiusPerSecond,
    /// Revolutions per minute.
    Rpm,
    /// Revolutions per minute, per second.
    RpmPerSecond,
    /// Millivolts.
    Millivolts,
    /// A gain, in tenths of a percent for 1000 rpm.
    Gain,
    /// Frames.
    Frames,
    /// A number as the ECU sends it.
    Raw,
    /// Bits per second, one of [`BaudRate::ALL`].
    Baud,
    /// Status frames of a ZK ECU per second, one of [`Unit::STATUS_RATES`].
    StatusRate,
    /// A plain number: an identifier or a choice.
    Number,
    /// 0 is no, 1 is yes.
    YesNo,
    /// 0 reports, 1 is the fail-safe throttle, 2 is standby.
    Action,
}

impl Unit {
    /// The status rates of a ZK ECU (ZK-11).
    pub const STATUS_RATES: [i32; 3] = [20, 50, 100];

    /// Symbol, or its meaning where it has none.
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Milliseconds => symbol!(ms),
            Self::Microseconds => symbol!(us),
            Self::PerMille => symbol!(throttle),
            Self::PerMillePerSecond => symbol!(rate),
            Self::Percent => symbol!(percent_or_off),
            Self::TenthsCelsius => symbol!(celsius),
            Self::CelsiusPerSecond => symbol!(celsius_rate_or_off),
            Self::Rpm => symbol!(rpm),
            Self::RpmPerSecond => symbol!(rpm_rate_or_off),
            Self::Millivolts => symbol!(millivolts_or_off),
            Self::Gain => symbol!(gain),
            Self::Frames => symbol!(frames),
            Self::Raw => symbol!(raw),
            Self::Baud => symbol!(baud),
            Self::StatusRate => symbol!(status_rate),
            Self::Number => symbol!(number),
            Self::YesNo => symbol!(yes_no),
            Self::Action => symbol!(action),
        }
    }

    /// The valid values in words, where not every number within the range is valid.
    pub const fn choices(self) -> Option<&'static str> {
        match self {
            Self::Baud => Some(BaudRate::CHOICES),
            Self::StatusRate => Some("use 20, 50 or 100"),
            _ => None,
        }
    }

    /// Whether a number within the range is valid.
    const fn has(self, number: i32) -> bool {
        let [low, middle, high] = Self::STATUS_RATES;
        match self {
            Self::Baud => BaudRate::up_to(number as u32).get() == number as u32,
            Self::StatusRate => number == low || number == middle || number == high,
            _ => true,
        }
    }
}

/// The symbol of a kind's unit as a literal, for `concat!`: that of [`Unit::symbol`].
#[doc(hidden)]
#[macro_export]
macro_rules! symbol {
    (ms) => {
        "ms"
    };
    (ms_or_off) => {
        $crate::symbol!(ms)
    };
    (us) => {
        "µs"
    };
    (throttle) => {
        "× 0.1 %"
    };
    (share_or_off) => {
        $crate::symbol!(throttle)
    };
    (rate) => {
        "× 0.1 %/s"
    };
    (rate_or_off) => {
        $crate::symbol!(rate)
    };
    (gain) => {
        "× 0.1 % for 1000 rpm"
    };
    (percent_or_off) => {
        "%"
    };
    (celsius) => {
        "× 0.1 °C"
    };
    (celsius_or_off) => {
        $crate::symbol!(celsius)
    };
    (celsius_rate_or_off) => {
        "°C/s"
    };
    (rpm) => {
        "rpm"
    };
    (rpm_or_off) => {
        $crate::symbol!(rpm)
    };
    (rpm_rate_or_off) => {
        "rpm/s"
    };
    (millivolts_or_off) => {
        "mV"
    };
    (frames) => {
        "frames"
    };
    (raw) => {
        "as the ECU sends it"
    };
    (pulse) => {
        $crate::symbol!(us)
    };
    (baud) => {
        "baud"
    };
    (status_rate) => {
        "Hz"
    };
    (number) => {
        "as a number"
    };
    (yes_no) => {
        "0 no, 1 yes"
    };
    (action) => {
        "0 reports, 1 fail-safe throttle, 2 standby"
    };
}

/// The number of a setting that is off: "never", "not checked", "at once".
pub const OFF: i32 = -1;

/// When a new value of a setting takes effect.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Effect {
    /// With the next frame, command or deadline.
    AtOnce,
    /// As [`Effect::AtOnce`], but while the engine turns, or is ordered to, a change is refused.
    UnlessTurning,
    /// When the engine is at rest: standby or an emergency stop is in force, and the ECU reports a stopped engine. So it is in
    /// effect before the engine's next start, and never changes in flight.
    AtRest,
    /// At the next start of the node.
    AtNextStart,
}

/// One row of the table of settings.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Setting {
    /// Name, 16 characters at most: fit for a MAVLink parameter.
    pub name: &'static str,
    /// Field of the configuration, as written in Rust.
    pub field: &'static str,
    /// Unit of its number.
    pub unit: Unit,
    /// Least value.
    pub min: i32,
    /// Greatest value.
    pub max: i32,
    /// Default, [`OFF`] if it is off. Of a link, each protocol has its own.
    pub default: i32,
    /// It may also be [`OFF`].
    pub may_be_off: bool,
    /// When a new value takes effect.
    pub effect: Effect,
    /// It is offered as a parameter. Any other is set in the table of engines alone: it is for sources that few boards have, for a
    /// governor, which takes rpm demands that MAVLink does not carry, or a number that follows from the protocol.
    pub parameter: bool,
    /// Description, in a sentence.
    pub text: &'static str,
    /// The field and its range, as the text of an error.
    pub message: &'static str,
}

impl Setting {
    /// For the macro. `texts`: field, text and message.
    #[doc(hidden)]
    pub const fn new(row: Row, name: &'static str, default: i32, texts: [&'static str; 3]) -> Self {
        let Row { unit, min, max, may_be_off, effect, .. } = row;
        let [field, text, message] = texts;
        let parameter = row.is_parameter();
        Self { name, field, unit, min, max, default, may_be_off, effect, parameter, text, message }
    }

    /// Whether this number is within the range.
    pub const fn allows(&self, value: i32) -> bool {
        allows(value, self.min, self.max, self.may_be_off) && self.unit.has(value)
    }
}

/// What a firmware needs of a row to offer it as a parameter. An image that uses these and no [`Setting`] does not hold the
/// texts of the table.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Row {
    /// Name, as of its [`Setting`]; empty: it is not a parameter ([`Setting::parameter`]).
    pub name: &'static str,
    /// Unit of its number.
    pub unit: Unit,
    /// Least value.
    pub min: i32,
    /// Greatest value.
    pub max: i32,
    /// It may also be [`OFF`].
    pub may_be_off: bool,
    /// When a new value takes effect.
    pub effect: Effect,
}

impl Row {
    /// A row; an empty name is not a parameter. The macro `settings!` writes these.
    pub const fn new(
        name: &'static str,
        unit: Unit,
        [min, max]: [i32; 2],
        may_be_off: bool,
        effect: Effect,
    ) -> Self {
        Self { name, unit, min, max, may_be_off, effect }
    }

    /// Whether it is offered as a parameter.
    pub const fn is_parameter(&self) -> bool {
        !self.name.is_empty()
    }

    /// Whether this number is within the range.
    pub const fn allows(&self, value: i32) -> bool {
        allows(value, self.min, self.max, self.may_be_off) && self.unit.has(value)
    }
}

/// The first parameter of these tables for which `is_it` is true. Tables of parameters are searched only here: each further loop takes flash.
#[inline(never)]
pub fn find_parameter(
    tables: &[&'static [Row]],
    is_it: &mut dyn FnMut(&'static Row) -> bool,
) -> Option<&'static Row> {
    for rows in tables {
        for row in *rows {
            if row.is_parameter() && is_it(row) {
                return Some(row);
            }
        }
    }
    None
}

/// The rows of a table.
#[doc(hidden)]
pub const fn rows<const N: usize>(settings: &[Setting]) -> [Row; N] {
    let empty =
        Row { name: "", unit: Unit::Number, min: 0, max: 0, may_be_off: false, effect: Effect::AtOnce };
    let mut rows = [empty; N];
    let mut i = 0;
    while i < N {
        let Setting { name, unit, min, max, may_be_off, effect, parameter, .. } = settings[i];
        let name = if parameter { name } else { "" };
        rows[i] = Row { name, unit, min, max, may_be_off, effect };
        i += 1;
    }
    rows
}

/// The index of a parameter by its name. Names are compared only here: a match arm for each name takes more code.
#[doc(hidden)]
#[inline(never)]
pub fn place_of(name: &str, rows: &[Row]) -> Option<usize> {
    rows.iter().position(|row| row.name == name && row.is_parameter())
}

/// The index of any name.
#[doc(hidden)]
pub fn place_in(name: &str, names: &[&str]) -> Option<usize> {
    names.iter().position(|other| *other == name)
}

/// The row of a name, for use in a constant.
///
/// # Panics
/// If there is none.
pub(crate) const fn row(name: &str, rows: &[Row]) -> Row {
    let mut place = 0;
    while place < rows.len() {
        let (mut letter, of) = (0, rows[place].name.as_bytes());
        while letter < of.len() && of.len() == name.len() && of[letter] == name.as_bytes()[letter] {
            letter += 1;
        }
        if letter == name.len() {
            return rows[place];
        }
        place += 1;
    }
    panic!("no setting of this name")
}

/// A column of a row: that of its group, or the row's own.
#[doc(hidden)]
#[macro_export]
macro_rules! column {
    (effect $effect:ident) => {
        $crate::setting::Effect::$effect
    };
    (effect $effect:ident UnlessTurning $($more:ident)*) => {
        $crate::column!(effect UnlessTurning $($more)*)
    };
    (effect $effect:ident ConfigOnly $($more:ident)*) => {
        $crate::column!(effect $effect $($more)*)
    };
    (parameter) => {
        true
    };
    (parameter UnlessTurning $($more:ident)*) => {
        $crate::column!(parameter $($more)*)
    };
    (parameter ConfigOnly $($more:ident)*) => {
        false
    };
}

/// Returns the expression at an index, if its condition is met. An image does not contain expressions whose condition is never met.
#[doc(hidden)]
#[macro_export]
macro_rules! by_place {
    ($place:ident, { $( $if:expr => $value:expr; )* }, $none:expr) => {{
        let mut of = 0;
        $(
            if $if && $place == of {
                return $value;
            }
            of += 1;
        )*
        let _ = of;
        $none
    }};
}

#[doc(hidden)]
pub const fn allows(value: i32, min: i32, max: i32, may_be_off: bool) -> bool {
    value >= min && value <= max || may_be_off && value == OFF
}

/// A row of a table of settings, by its number. Errors carry this, so that a firmware that never prints them does not contain
/// the texts of the table. Only the error knows which table it belongs to, and has its text.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SettingId(pub(crate) u8);

impl SettingId {
    /// The field and its range, from the table that the number belongs to.
    pub(crate) const fn message(self, table: &'static [Setting]) -> &'static str {
        let row = self.0 as usize;
        if row < table.len() { table[row].message } else { "" }
    }
}

/// Its number, from 0. The error that carries it prints the text of the setting.
impl core::fmt::Display for SettingId {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "setting {}", Whole(self.0.into()))
    }
}

impl core::fmt::Display for Setting {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.message)
    }
}

/// Reason why a setting was not changed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum SettingError {
    /// No setting has this name.
    Unknown,
    /// The value is outside of the range.
    OutOfRange(&'static Setting),
    /// Its function is disabled: enable that first.
    Off(&'static Setting),
}

sentences!(SettingError {
    Self::Unknown => "no setting has this name: see the table of settings";
} {
    Self::OutOfRange(setting) => "{}: {}", setting.name, setting.message;
    Self::Off(setting) => "{}: its function is disabled: enable it first", setting.name;
});

impl core::error::Error for SettingError {}

/// Kinds of settings: the type of the field, its unit, and its value as a whole number. A number that does not fit the type
/// becomes the closest one.
#[doc(hidden)]
pub mod kind {
    #![allow(missing_docs, reason = "for the macro")]
    use super::OFF;
    use crate::units::Throttle;
    use embassy_time::Duration;

    /// A number that does not fit in 32 bits is out of every range.
    const fn clamp(value: u64) -> i32 {
        if value > i32::MAX as u64 { i32::MAX } else { value as i32 }
    }

    /// The closest number of a range.
    #[inline(never)]
    const fn within(value: i32, (least, most): (i32, i32)) -> i32 {
        if value < least {
            least
        } else if value > most {
            most
        } else {
            value
        }
    }

    const U8: (i32, i32) = (0, u8::MAX as i32);
    const U16: (i32, i32) = (0, u16::MAX as i32);
    const U31: (i32, i32) = (0, i32::MAX);
    const I16: (i32, i32) = (i16::MIN as i32, i16::MAX as i32);
    const PER_MILLE: (i32, i32) = (0, 1000);

    // Many fields have these, and where they are inlined each is 20 bytes.

    #[inline(never)]
    const fn milliseconds(of: &Duration) -> i32 {
        clamp(of.as_millis())
    }

    #[inline(never)]
    const fn from_milliseconds(number: i32) -> Duration {
        Duration::from_millis(within(number, U31) as u64)
    }

    #[inline(never)]
    const fn throttle_of(tenths: i32) -> Throttle {
        match Throttle::from_tenths(within(tenths, PER_MILLE) as u16) {
            Ok(throttle) => throttle,
            Err(_) => Throttle::IDLE,
        }
    }

    macro_rules! kind {
        ($name:ident, $type:ty, $unit:ident, |$of:ident| $number:expr, |$value:ident| $make:expr) => {
            #[allow(dead_code, reason = "some kinds occur only inside an optional one")]
            pub mod $name {
                #[allow(unused_imports, reason = "not every kind needs all of them")]
                use super::{
                    I16, OFF, U8, U16, U31, clamp, from_milliseconds, milliseconds, throttle_of, within,
                };
                #[allow(unused_imports, reason = "not every kind needs all of them")]
                use crate::units::{BaudRate, Celsius, Millivolts, Rpm, Throttle};
                #[allow(unused_imports, reason = "not every kind needs all of them")]
                use embassy_time::Duration;

                pub type Type = $type;
                pub const UNIT: crate::setting::Unit = crate::setting::Unit::$unit;
                pub const MAY_BE_OFF: bool = false;

                pub const fn number($of: &Type) -> i32 {
                    $number
                }

                pub const fn make($value: i32) -> Type {
                    $make
                }
            }
        };
    }

    macro_rules! optional_kind {
        ($name:ident, $inner:ident) => {
            #[allow(dead_code, reason = "limits may always be off, and do not need it")]
            pub mod $name {
                use super::{OFF, $inner};

                pub type Type = Option<$inner::Type>;
                pub const UNIT: crate::setting::Unit = $inner::UNIT;
                pub const MAY_BE_OFF: bool = true;

                pub const fn number(of: &Type) -> i32 {
                    match of {
                        // A value with the number of "off" is in no range.
                        Some(value) => match $inner::number(value) {
                            OFF => i32::MIN,
                            number => number,
                        },
                        None => OFF,
                    }
                }

                pub const fn make(value: i32) -> Type {
                    if value == OFF { None } else { Some($inner::make(value)) }
                }
            }
        };
    }

    kind!(ms, Duration, Milliseconds, |of| milliseconds(of), |v| from_milliseconds(v));
    kind!(us, Duration, Microseconds, |of| clamp(of.as_micros()), |v| Duration::from_micros(
        within(v, U31) as u64
    ));
    kind!(throttle, Throttle, PerMille, |of| of.tenths() as i32, |v| throttle_of(v));
    kind!(rate, u16, PerMillePerSecond, |of| *of as i32, |v| within(v, U16) as u16);
    kind!(share, u16, PerMille, |of| *of as i32, |v| within(v, U16) as u16);
    kind!(gain, u16, Gain, |of| *of as i32, |v| within(v, U16) as u16);
    kind!(percent, u8, Percent, |of| *of as i32, |v| within(v, U8) as u8);
    kind!(celsius, Celsius, TenthsCelsius, |of| of.tenths() as i32, |v| Celsius::from_tenths(
        within(v, I16) as i16
    ));
    kind!(celsius_rate, u16, CelsiusPerSecond, |of| *of as i32, |v| within(v, U16) as u16);
    kind!(rpm, Rpm, Rpm, |of| clamp(of.get() as u64), |v| Rpm::new(within(v, U31) as u32));
    kind!(rpm_rate, u32, RpmPerSecond, |of| clamp(*of as u64), |v| within(v, U31) as u32);
    kind!(millivolts, Millivolts, Millivolts, |of| clamp(of.get() as u64), |v| Millivolts::new(
        within(v, U31) as u32
    ));
    kind!(frames, u8, Frames, |of| *of as i32, |v| within(v, U8) as u8);
    kind!(raw, u8, Raw, |of| *of as i32, |v| within(v, U8) as u8);
    kind!(pulse, u16, Microseconds, |of| *of as i32, |v| within(v, U16) as u16);
    kind!(baud, BaudRate, Baud, |of| of.get() as i32, |v| BaudRate::up_to(within(v, U31) as u32));
    kind!(status_rate, u8, StatusRate, |of| *of as i32, |v| within(v, U8) as u8);
    kind!(number, u8, Number, |of| *of as i32, |v| within(v, U8) as u8);
    kind!(yes_no, bool, YesNo, |of| *of as i32, |v| v != 0);
    kind!(action, crate::limit::Action, Action, |of| *of as i32, |v| match v {
        1 => crate::limit::Action::FailSafe,
        2 => crate::limit::Action::Standby,
        _ => crate::limit::Action::Report,
    });
    optional_kind!(ms_or_off, ms);
    optional_kind!(rate_or_off, rate);
    optional_kind!(share_or_off, share);
    optional_kind!(millivolts_or_off, millivolts);
    optional_kind!(celsius_or_off, celsius);
    optional_kind!(celsius_rate_or_off, celsius_rate);
    optional_kind!(rpm_or_off, rpm);
    optional_kind!(rpm_rate_or_off, rpm_rate);
    optional_kind!(percent_or_off, percent);
}

/// Declares a struct of settings. See the head of `setting.rs`; in use in `engine/config.rs`. A package with settings of its
/// own may declare them with it, so that one table serves all; it needs a feature `defmt`, if only an empty one.
///
/// After its range a row may have `UnlessTurning`, where its effect differs from that of the struct ([`Effect::UnlessTurning`]), and
/// `ConfigOnly`, where it is not a parameter ([`Setting::parameter`]).
///
/// A struct whose defaults are stated elsewhere, as of the settings that every protocol has, is declared with `defaults elsewhere`
/// and without `= default`. It has no `DEFAULT`; its `table` makes the rows from given defaults. The end of a range may come from a macro there,
/// and the text may have several parts.
#[macro_export]
macro_rules! settings {
    (
        $(#[$meta:meta])*
        pub struct $group:ident, $prefix:literal, $effect:ident {
            $( $(#[$more:meta])* $field:ident: $kind:ident $name:literal = $default:literal in $min:literal..=$max:literal $(, $column:ident)*, $text:literal; )*
        }
        $( groups { $( $(#[$gmeta:meta])* $inner:ident: $itype:ty = $idefault:expr; )* } )?
    ) => {
        $crate::settings! {
            $(#[$meta])*
            pub struct $group, $prefix, $effect, defaults elsewhere {
                $( $(#[$more])* $field: $kind $name in $min..=$max $(, $column)*, $text, concat!("default ", $default, ", "); )*
            }
            $( groups { $( $(#[$gmeta])* $inner: $itype; )* } )?
        }

        impl $group {
            /// All as the table has them.
            pub const DEFAULT: Self = Self {
                $( $( $inner: $idefault, )* )?
                $( $field: $crate::setting::kind::$kind::make($default), )*
            };

            /// The rows of the table of settings.
            pub const SETTINGS: &'static [$crate::setting::Setting] = &Self::table(&Self::DEFAULT);
        }
    };
    (
        $(#[$meta:meta])*
        pub struct $group:ident, $prefix:literal, $effect:ident, defaults elsewhere {
            $( $(#[$more:meta])* $field:ident: $kind:ident $name:literal in $min:literal..=$max:expr $(, $column:ident)*, $($text:literal)+ $(, $shown:expr)?; )*
        }
        $( groups { $( $(#[$gmeta:meta])* $inner:ident: $itype:ty; )* } )?
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub struct $group {
            $( $( $(#[$gmeta])* pub $inner: $itype, )* )?
            $(
                #[doc = concat!($($text),+)]
                #[doc = ""]
                #[doc = concat!("Setting `", $name, "`: ", $($shown,)? $min, " to ", $max, " ", $crate::symbol!($kind), ".")]
                $(#[$more])*
                pub $field: $crate::setting::kind::$kind::Type,
            )*
        }

        impl $group {
            /// The rows of the table of settings with these defaults.
            #[doc(hidden)]
            pub const fn table(defaults: &Self) -> [$crate::setting::Setting; [$($name),*].len()] { [ $(
                $crate::setting::Setting::new(
                    $crate::setting::Row::new(
                        if $crate::column!(parameter $($column)*) { $name } else { "" },
                        $crate::setting::kind::$kind::UNIT,
                        [$min, $max],
                        $crate::setting::kind::$kind::MAY_BE_OFF,
                        $crate::column!(effect $effect $($column)*),
                    ),
                    {
                        const { assert!($name.len() <= 16, "a parameter's name has 16 characters at most") };
                        $name
                    },
                    $crate::setting::kind::$kind::number(&defaults.$field),
                    [
                        concat!($prefix, stringify!($field)),
                        concat!($($text),+),
                        concat!($prefix, stringify!($field), ": ", $min, " to ", $max, " ", $crate::symbol!($kind)),
                    ],
                ),
            )* ] }

            /// The rows of the table of settings without their texts.
            pub const ROWS: &'static [$crate::setting::Row] = &[ $(
                $crate::setting::Row::new(
                    if $crate::column!(parameter $($column)*) { $name } else { "" },
                    $crate::setting::kind::$kind::UNIT,
                    [$min, $max],
                    $crate::setting::kind::$kind::MAY_BE_OFF,
                    $crate::column!(effect $effect $($column)*),
                ),
            )* ];

            /// The names of all of them.
            #[allow(dead_code, reason = "some are looked up as parameters only")]
            const NAMES: &'static [&'static str] = &[$($name),*];

            /// Number of the structs of settings in this one.
            #[allow(dead_code, reason = "most have none")]
            const GROUPS: usize = {
                let groups: &[&str] = &[$( $( stringify!($inner) ),* )?];
                groups.len()
            };

            /// The number of the one in this place of the rows.
            const fn number_at(&self, place: usize) -> i32 {
                $crate::setting::by_place!(place, {
                    $( true => $crate::setting::kind::$kind::number(&self.$field); )*
                }, $crate::setting::OFF)
            }

            /// Changes the one in this place of the rows, of all or of parameters; the range has been checked.
            fn set_at<const ALL: bool>(&mut self, place: usize, value: i32) -> bool {
                $crate::setting::by_place!(place, {
                    $( ALL || $crate::column!(parameter $($column)*) => { self.$field = $crate::setting::kind::$kind::make(value); true }; )*
                }, false)
            }
        }

        $crate::settings!(@by_name $group);
    };
    // What follows from the rows of a struct, and from the numbers in their places.
    (@by_name $group:ident) => {
        impl $group {
            /// The index of the first of these that is out of its range, from 0.
            #[allow(dead_code, reason = "a yes or no has no range")]
            pub(crate) const fn check_own(&self) -> Result<(), u8> {
                let mut place = 0;
                while place < Self::ROWS.len() {
                    if !Self::ROWS[place].allows(self.number_at(place)) {
                        return Err(place as u8);
                    }
                    place += 1;
                }
                Ok(())
            }

            /// The place of the name of one of these, or of a parameter among them.
            fn place<const ALL: bool>(name: &str) -> Option<usize> {
                if ALL {
                    $crate::setting::place_in(name, Self::NAMES)
                } else {
                    $crate::setting::place_of(name, Self::ROWS)
                }
            }

            /// The number of one of these: of all, or of parameters.
            pub(crate) fn own<const ALL: bool>(&self, name: &str) -> Option<i32> {
                Self::place::<ALL>(name).map(|place| self.number_at(place))
            }

            /// Changes one of these, of all or of parameters; the range has been checked. False if it is not one of these.
            pub(crate) fn set_own<const ALL: bool>(&mut self, name: &str, value: i32) -> bool {
                Self::place::<ALL>(name).is_some_and(|place| self.set_at::<ALL>(place, value))
            }
        }
    };
}

#[doc(hidden)]
pub use crate::{by_place, column, symbol};
pub use settings;
