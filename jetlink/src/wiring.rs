//! Port, line and ECU of an engine as numbers: what a firmware may store, so that other wires need no compiler.

use crate::config::{ConfigError, EngineConfig, validate};
use crate::ecu::vendor::LineMistake;
use crate::ecu::{EcuConfig, protocols};
use crate::line::{Line, StopBits};
use crate::sentence::sentences;
use crate::setting::settings;
use crate::units::{BaudRate, Verbatim, Whole};

/// The last of several literals.
macro_rules! last {
    ($last:literal) => {
        $last
    };
    ($first:literal $($rest:literal)+) => {
        last!($($rest)+)
    };
}

/// Bits of each part in [`Wiring::packed`], in this order. Those of the protocols follow.
mod bits {
    pub const PORT: u32 = 4;
    pub const PROTOCOL: u32 = 8;
    pub const BAUD: u32 = 3;
    pub const STOP: u32 = 2;
}

macro_rules! wiring {
    ($($(#[$doc:meta])* $name:ident = $number:literal $label:literal ($config:ty, $mistake:ty, $service:ty, $faults:ty) {
        $($field:ident: $kind:ident $row:literal in $min:literal..=$max:literal, $bits:literal bits, $text:literal;)*
    };)+) => {
        settings! {
            /// Wiring of an engine. [`check`] checks whether the wirings of all engines are possible together. The names are those of engine 1:
            /// those of another engine have its number in place of the 1.
            pub struct Wiring, "wiring.", AtNextStart, defaults elsewhere {
                port: number "E1_PORT" in 0..=15, "ECU port of the board, from 0.";
                protocol: number "E1_PROTO" in 1..=last!($($number)+), "Protocol of the ECU." $(" " $number ": " $label ".")+;
                baud: baud "E1_BAUD" in 2400..=115_200, "Baud rate: 2400, 4800, 9600, 19 200, 38 400, 57 600 or 115 200.";
                stop_bits: number "E1_STOP" in 1..=2, "Stop bits.";
                $($($field: $kind $row in $min..=$max, $text;)*)+
            }
        }

        const _: () = {
            let numbers = [$($number),+];
            let mut place = 0;
            while place < numbers.len() {
                assert!(numbers[place] == place + 1, "the numbers of protocols are 1, 2, 3 and so on, in this order");
                place += 1;
            }
            assert!(
                bits::PORT + bits::PROTOCOL + bits::BAUD + bits::STOP $($(+ $bits)*)+ <= u32::BITS,
                "the wiring of all protocols has to fit in 32 bits"
            );
            $($(assert!($bits <= u8::BITS && $max < 1_u32 << $bits, concat!($row, " has too few bits"));)*)+
        };

        impl Wiring {
            /// Wiring of an engine. Parts that only other protocols have are their defaults.
            pub const fn of(engine: &EngineConfig) -> Self {
                $(let [$($field),*] = match engine.ecu {
                    EcuConfig::$name(config) => config,
                    _ => <$config>::DEFAULT,
                }.wired();)+
                Self {
                    port: engine.port,
                    protocol: engine.ecu.protocol_number(),
                    baud: BaudRate::up_to(engine.line.baud),
                    stop_bits: match engine.line.stop_bits {
                        StopBits::One => 1,
                        StopBits::Two => 2,
                    },
                    $($($field,)*)+
                }
            }

            /// Applies the parts that only the ECU's protocol has.
            fn wire(&self, ecu: &mut EcuConfig) {
                match ecu {
                    $(EcuConfig::$name(config) => config.wire([$(self.$field),*]),)+
                }
            }

            /// The wiring in one number.
            pub const fn packed(&self) -> u32 {
                let common = Packed { number: 0, bits: 0 }
                    .with(self.port, bits::PORT)
                    .with(self.protocol, bits::PROTOCOL)
                    .with(self.baud.place(), bits::BAUD)
                    .with(self.stop_bits, bits::STOP);
                common$($(.with(self.$field, $bits))*)+.number
            }

            /// From such a number; `None`: it is invalid.
            pub fn unpacked(number: u32) -> Option<Self> {
                let mut rest = number;
                let mut next = |bits: u32| {
                    let part = rest as u8 & (u8::MAX >> (u8::BITS - bits));
                    rest >>= bits;
                    part
                };
                let wiring = Self {
                    port: next(bits::PORT),
                    protocol: next(bits::PROTOCOL),
                    baud: BaudRate::at(next(bits::BAUD))?,
                    stop_bits: next(bits::STOP),
                    $($($field: next($bits),)*)+
                };
                (rest == 0 && wiring.check_own().is_ok()).then_some(wiring)
            }
        }
    };
}
protocols!(wiring);

/// A number that consists of parts.
struct Packed {
    number: u32,
    /// Bits of it in use.
    bits: u32,
}

impl Packed {
    const fn with(self, part: u8, bits: u32) -> Self {
        Self { number: self.number | (part as u32) << self.bits, bits: self.bits + bits }
    }
}

impl Wiring {
    /// Applies it to an engine. If the protocol changes, the settings of ECU and link become the defaults of the new protocol.
    pub fn apply(&self, engine: &mut EngineConfig) {
        engine.port = self.port;
        let baud = self.baud.get();
        engine.line = if self.stop_bits == 2 { Line::with_two_stop_bits(baud) } else { Line::new(baud) };
        if engine.ecu.protocol_number() != self.protocol
            && let Some(ecu) = EcuConfig::of_protocol(self.protocol)
        {
            engine.ecu = ecu;
            engine.timing = ecu.timing();
        }
        self.wire(&mut engine.ecu);
    }

    /// The value of a row of [`Wiring::ROWS`].
    pub fn number(&self, name: &str) -> Option<i32> {
        self.own::<false>(name)
    }

    /// Changes a value, within the range of its row. False: no row has this name.
    pub fn change(&mut self, name: &str, number: i32) -> bool {
        self.set_own::<false>(name, number)
    }
}

/// Ports of a board, as far as engines can use them.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Ports {
    /// Number of ports.
    pub count: u8,
    /// Port in other use, for example by a receiver of radio control.
    pub taken: Option<u8>,
    /// The ports can have two stop bits.
    pub two_stop_bits: bool,
}

/// Reason why engines cannot be wired in this way.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Contradiction {
    /// The board has no port of this number.
    NoSuchPort,
    /// Something else has the port.
    Taken,
    /// Another engine has the port.
    SamePort,
    /// The protocol, or the board, has one stop bit.
    StopBits,
    /// The line is too slow for the status rate.
    RateTooFast,
    /// Another setting does not fit the line, for example `AMT_GUARD`.
    Setting,
}

impl Contradiction {
    /// What is wrong, for people.
    pub const fn message(self) -> &'static str {
        match self {
            Self::NoSuchPort => "the board has no such port",
            Self::Taken => "its port is used by radio control",
            Self::SamePort => "two engines on one port",
            Self::StopBits => "use one stop bit",
            Self::RateTooFast => "the line is too slow for the status rate",
            Self::Setting => "a setting does not fit the line",
        }
    }

    /// Name of the setting to change, without its engine.
    const fn setting(self) -> &'static str {
        match self {
            Self::NoSuchPort | Self::Taken | Self::SamePort => "PORT",
            Self::StopBits => "STOP",
            Self::RateTooFast | Self::Setting => "BAUD",
        }
    }
}

/// An engine that cannot be wired in this way. Its text has what to change, and none of the table of settings.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct WiringError {
    /// Row of the engine, from 0.
    pub row: usize,
    /// Reason.
    pub why: Contradiction,
}

sentences!(WiringError {
} {
    Self { row, why } => "{}: change E{}_{}", Verbatim(why.message()), Whole(row as u32 + 1), Verbatim(why.setting());
});

impl core::error::Error for WiringError {}

/// Checks whether a board can have these engines.
///
/// # Errors
/// The first engine that it cannot have.
pub fn check(engines: &[EngineConfig], ports: Ports) -> Result<(), WiringError> {
    for (row, engine) in engines.iter().enumerate() {
        if engine.port >= ports.count {
            return Err(WiringError { row, why: Contradiction::NoSuchPort });
        }
        if ports.taken == Some(engine.port) {
            return Err(WiringError { row, why: Contradiction::Taken });
        }
        if !ports.two_stop_bits && engine.line.stop_bits == StopBits::Two {
            return Err(WiringError { row, why: Contradiction::StopBits });
        }
    }
    validate(engines).map_err(|error| {
        let why = match error {
            ConfigError::SamePort(..) => Contradiction::SamePort,
            ConfigError::Ecu(_, mistake) => match mistake.line() {
                Some(LineMistake::StopBits) => Contradiction::StopBits,
                Some(LineMistake::TooSlow) => Contradiction::RateTooFast,
                None => Contradiction::Setting,
            },
            _ => Contradiction::Setting,
        };
        WiringError { row: error.row(), why }
    })
}
