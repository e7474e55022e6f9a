//! Port, line and ECU of an engine as numbers: what a firmware may store, so that other wires need no compiler.

use crate::config::{ConfigError, EngineConfig, validate};
use crate::ecu::amt::codec::EngineModel;
use crate::ecu::zk::codec::Rate;
use crate::ecu::{EcuConfig, Mistake, amt, zk};
use crate::line::{Line, StopBits};
use crate::sentence::sentences;
use crate::setting::settings;
use crate::units::{BaudRate, Verbatim};

settings! {
    /// What an engine is wired to. Whether the wiring of all engines fits together, [`check`] finds out. The names are those of engine 1: another
    /// engine has its number in place of the 1.
    pub struct Wiring, "wiring.", AtNextStart, defaults elsewhere {
        port: number "E1_PORT" in 0..=15, "ECU port of the board, from 0.";
        protocol: number "E1_PROTO" in 1..=2, "Protocol of the ECU. 1: AMT. 2: ZK.";
        baud: baud "E1_BAUD" in 2400..=115_200, "Baud rate: 2400, 4800, 9600, 19 200, 38 400, 57 600 or 115 200.";
        stop_bits: number "E1_STOP" in 1..=2, "Stop bits.";
        amt_engine: number "E1_AMT_ENGINE" in 0..=7, "With AMT: the engine, if its scale shall be known before the ECU names it. 0: not known. 1 Mercury, 2 Pegasus, 3 Olympus, 4 Titan, 5 Nike, 6 Lynx, 7 Orion.";
        zk_rate: status_rate "E1_ZK_RATE" in 20..=100, "With ZK: status rate in Hz: 20, 50 or 100.";
    }
}

const _: () = assert!(EngineModel::ALL.len() == 7);

impl Wiring {
    /// Of an engine.
    pub const fn of(engine: &EngineConfig) -> Self {
        let [protocol, amt_engine] = engine.ecu.identity();
        let rate = if let EcuConfig::Zk(config) = engine.ecu { config.rate } else { Rate::Hz20 };
        Self {
            port: engine.port,
            protocol,
            baud: BaudRate::up_to(engine.line.baud),
            stop_bits: match engine.line.stop_bits {
                StopBits::One => 1,
                StopBits::Two => 2,
            },
            amt_engine,
            zk_rate: rate.hz() as u8,
        }
    }

    /// Gives it to an engine. With another protocol than before, the settings of its ECU and its link are the defaults of that protocol.
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
        if let EcuConfig::Amt(config) = &mut engine.ecu {
            let place = usize::from(self.amt_engine).checked_sub(1);
            config.engine = place.and_then(|place| EngineModel::ALL.get(place)).copied();
        }
        if let (EcuConfig::Zk(config), Some(rate)) = (&mut engine.ecu, self.rate()) {
            config.rate = rate;
        }
    }

    fn rate(&self) -> Option<Rate> {
        Rate::ALL.into_iter().find(|rate| rate.hz() == self.zk_rate.into())
    }

    /// The number of a row of [`Wiring::ROWS`].
    pub fn number(&self, name: &str) -> Option<i32> {
        self.own::<false>(name)
    }

    /// Changes a number, which its row allows. False: there is none of this name.
    pub fn change(&mut self, name: &str, number: i32) -> bool {
        self.set_own::<false>(name, number)
    }

    /// All of it in one number.
    pub const fn packed(&self) -> u32 {
        let Self { port, protocol, baud, stop_bits, amt_engine, zk_rate } = *self;
        port as u32
            | (protocol as u32) << 4
            | (baud.place() as u32) << 12
            | (stop_bits as u32) << 15
            | (amt_engine as u32) << 17
            | (zk_rate as u32) << 22
    }

    /// From such a number; `None`: it is none.
    pub fn unpacked(number: u32) -> Option<Self> {
        let bits = |from: u32, count: u32| (number >> from) as u8 & (u8::MAX >> (8 - count));
        let wiring = Self {
            port: bits(0, 4),
            protocol: bits(4, 8),
            baud: BaudRate::at(bits(12, 3))?,
            stop_bits: bits(15, 2),
            amt_engine: bits(17, 5),
            zk_rate: bits(22, 7),
        };
        (wiring.check_own().is_ok() && number == wiring.packed()).then_some(wiring)
    }
}

/// What a board leaves to engines.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Ports {
    /// Number of its ports.
    pub count: u8,
    /// The one that something else has, for example a receiver of radio control.
    pub taken: Option<u8>,
    /// They can have two stop bits.
    pub two_stop_bits: bool,
}

/// Why engines cannot be wired in this way.
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
    /// A sentence for a person, without the texts of the table of settings.
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
}

sentences!(Contradiction {
} {
    why => "{}", Verbatim(why.message());
});

impl core::error::Error for Contradiction {}

/// Checks whether a board can have these engines.
///
/// # Errors
/// The row of the first one that it cannot have, and why.
pub fn check(engines: &[EngineConfig], ports: Ports) -> Result<(), (usize, Contradiction)> {
    for (row, engine) in engines.iter().enumerate() {
        if engine.port >= ports.count {
            return Err((row, Contradiction::NoSuchPort));
        }
        if ports.taken == Some(engine.port) {
            return Err((row, Contradiction::Taken));
        }
        if !ports.two_stop_bits && engine.line.stop_bits == StopBits::Two {
            return Err((row, Contradiction::StopBits));
        }
    }
    validate(engines).map_err(|error| {
        let why = match error {
            ConfigError::SamePort(..) => Contradiction::SamePort,
            ConfigError::Ecu(_, Mistake::Amt(amt::config::Mistake::StopBits)) => Contradiction::StopBits,
            ConfigError::Ecu(_, Mistake::Zk(zk::config::Mistake::RateTooFast)) => Contradiction::RateTooFast,
            _ => Contradiction::Setting,
        };
        (error.row(), why)
    })
}
