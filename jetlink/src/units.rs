//! Physical quantities as types, so that a throttle cannot be passed for an rpm. All are integers.

use crate::sentence::sentences;

/// A value outside the range of its quantity.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct OutOfRange {
    /// The given value.
    pub given: u32,
    /// The smallest value allowed.
    pub min: u32,
    /// The largest value allowed.
    pub max: u32,
}

sentences!(OutOfRange {
} {
    Self { given, min, max } => "{} is outside {}..={}", given, min, max;
});

impl core::error::Error for OutOfRange {}

/// Checks `given` against an inclusive range.
pub(crate) const fn within(given: u32, min: u32, max: u32) -> Result<(), OutOfRange> {
    if given < min || given > max { Err(OutOfRange { given, min, max }) } else { Ok(()) }
}

macro_rules! quantity {
    ($(#[$meta:meta])* $name:ident($int:ty), $new:ident, $get:ident, $unit:literal) => {
        $(#[$meta])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug, Default)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub struct $name($int);

        impl $name {
            #[doc = concat!("From a number of ", $unit, ".")]
            pub const fn $new(value: $int) -> Self {
                Self(value)
            }

            #[doc = concat!("The number of ", $unit, ".")]
            pub const fn $get(self) -> $int {
                self.0
            }
        }
    };
}

/// A whole number in a sentence: the `Display` of an integer can also pad, align and show a sign, which is 0.8 kB of an image.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Whole(pub u32);

#[cfg(feature = "defmt")]
impl defmt::Format for Whole {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{=u32}", self.0);
    }
}

impl core::fmt::Display for Whole {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        use core::fmt::Write;
        if self.0 >= 10 {
            Self(self.0 / 10).fmt(f)?;
        }
        f.write_char(char::from(b'0' + (self.0 % 10) as u8))
    }
}

/// A text in a sentence, for the same reason.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Verbatim<'a>(pub &'a str);

#[cfg(feature = "defmt")]
impl defmt::Format for Verbatim<'_> {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{=str}", self.0);
    }
}

impl core::fmt::Display for Verbatim<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.0)
    }
}

/// A whole number with a sign.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Signed(pub i32);

#[cfg(feature = "defmt")]
impl defmt::Format for Signed {
    fn format(&self, f: defmt::Formatter<'_>) {
        defmt::write!(f, "{=i32}", self.0);
    }
}

impl core::fmt::Display for Signed {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        if self.0 < 0 {
            f.write_str("-")?;
        }
        Whole(self.0.unsigned_abs()).fmt(f)
    }
}

/// Declares the rates, and the error text for any other rate.
macro_rules! baud_rates {
    ($first:literal $(, $rate:literal)* or $last:literal) => {
        impl BaudRate {
            /// The rates that both documents print (ZK-12, AMT-1).
            pub const ALL: [u32; 7] = [$first $(, $rate)*, $last];

            /// The rates in words.
            pub const CHOICES: &str = concat!("use ", $first $(, ", ", $rate)*, " or ", $last);

            /// The text of an error for any other rate.
            pub(crate) const INVALID: &str =
                concat!("invalid baud rate: use ", $first $(, ", ", $rate)*, " or ", $last);
        }
    };
}

/// One of the baud rates that both documents print, stored as its index in [`BaudRate::ALL`].
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BaudRate(u8);

baud_rates!(2400, 4800, 9600, 19_200, 38_400, 57_600 or 115_200);

impl BaudRate {
    /// The highest one that is not above this number; the lowest one where all are.
    pub const fn up_to(baud: u32) -> Self {
        let mut place = Self::ALL.len() - 1;
        while place > 0 && Self::ALL[place] > baud {
            place -= 1;
        }
        Self(place as u8)
    }

    /// From its index in [`BaudRate::ALL`].
    pub const fn at(place: u8) -> Option<Self> {
        if (place as usize) < Self::ALL.len() { Some(Self(place)) } else { None }
    }

    /// Its index in [`BaudRate::ALL`].
    pub const fn place(self) -> u8 {
        self.0
    }

    /// Bits per second.
    pub const fn get(self) -> u32 {
        Self::ALL[self.0 as usize]
    }
}

quantity!(
    /// Shaft speed in revolutions per minute.
    Rpm(u32), new, get, "revolutions a minute"
);
quantity!(
    /// Temperature, in steps of 0.1 °C.
    Celsius(i16), from_tenths, tenths, "tenths of a degree Celsius"
);
quantity!(
    /// Voltage in mV.
    Millivolts(u32), new, get, "millivolts"
);
quantity!(
    /// Electric current in mA.
    Milliamps(u32), new, get, "milliamperes"
);
quantity!(
    /// Thrust in grams-force: the kilograms of the ECUs, times 1000.
    Grams(u32), new, get, "grams"
);
quantity!(
    /// Fuel volume in mL.
    Millilitres(u32), new, get, "millilitres"
);
quantity!(
    /// Fuel flow in mL per minute.
    MillilitresPerMinute(u32), new, get, "millilitres a minute"
);
quantity!(
    /// Pressure in Pa.
    Pascals(u32), new, get, "pascals"
);

/// Declares a number with a range that its values cannot leave.
macro_rules! ranged {
    ($(#[$meta:meta])* $name:ident($int:ty), $new:ident, $get:ident, $of:literal, $min:literal..=$max:literal) => {
        $(#[$meta])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub struct $name($int);

        impl $name {
            #[doc = concat!("From the number of ", $of, ", ", $min, "..=", $max, ".")]
            ///
            /// # Errors
            /// [`OutOfRange`](crate::units::OutOfRange) outside this range.
            pub const fn $new(number: $int) -> Result<Self, $crate::units::OutOfRange> {
                match $crate::units::within(number as u32, $min, $max) {
                    Ok(()) => Ok(Self(number)),
                    Err(error) => Err(error),
                }
            }

            #[doc = concat!("The number of ", $of, ", ", $min, "..=", $max, ".")]
            pub const fn $get(self) -> $int {
                self.0
            }
        }
    };
}
pub(crate) use ranged;

ranged!(
    /// Throttle in steps of 0.1 %, from 0 to 100 %.
    #[derive(Default)]
    Throttle(u16), from_tenths, tenths, "tenths of a percent", 0..=1000
);

impl Throttle {
    /// 0 %: the turbine idles.
    pub const IDLE: Self = Self(0);
    /// 100 %.
    pub const FULL: Self = Self(1000);

    /// From whole percent, 0..=100.
    ///
    /// # Errors
    /// [`OutOfRange`] above 100.
    pub const fn from_percent(percent: u8) -> Result<Self, OutOfRange> {
        match within(percent as u32, 0, 100) {
            Ok(()) => Ok(Self(percent as u16 * 10)),
            Err(error) => Err(error),
        }
    }
}

ranged!(
    /// Atmospheric pressure as the ZK-Protocol carries it, in ten bits (ZK-4).
    Hectopascals(u16), new, get, "hectopascals", 0..=1023
);
