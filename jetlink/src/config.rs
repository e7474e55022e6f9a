//! The table of engines: which sits on which port, and how it is supervised.
//!
//! [`check`] checks it while it is compiled: a status rate that the line cannot carry, two engines on one
//! port, a baud rate that no document prints or a reply that cannot fit its window do not build.

use crate::ecu::EcuConfig;
use crate::ecu::amt::{self, codec::Engine as AmtEngine};
use crate::ecu::zk::{self, codec::Rate};
use crate::engine::config::Supervision;
use crate::line::{Line, StopBits, Timing};
use crate::setting::{Setting, SettingError, SettingId};

/// One engine and the port it sits on.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct EngineConfig {
    /// Name in logs.
    pub name: &'static str,
    /// ECU port of the board, from 0.
    pub port: u8,
    /// Baud rate and stop bits.
    pub line: Line,
    /// The ECU and how it is spoken to.
    pub ecu: EcuConfig,
    /// When the ECU counts as heard and as lost.
    pub timing: Timing,
    /// How it is supervised.
    pub supervision: Supervision,
}

impl EngineConfig {
    /// An engine with an AMT ECU and default settings.
    pub const fn amt(name: &'static str, port: u8, line: Line, engine: Option<AmtEngine>) -> Self {
        let config = amt::config::Config { engine, ..amt::config::Config::DEFAULT };
        Self {
            name,
            port,
            line,
            ecu: EcuConfig::Amt(config),
            timing: amt::config::Config::TIMING,
            supervision: Supervision::DEFAULT,
        }
    }

    /// An engine with a ZK ECU and default settings.
    pub const fn zk(name: &'static str, port: u8, line: Line, rate: Rate) -> Self {
        let config = zk::config::Config { rate, ..zk::config::Config::DEFAULT };
        Self {
            name,
            port,
            line,
            ecu: EcuConfig::Zk(config),
            timing: zk::config::Config::TIMING,
            supervision: Supervision::DEFAULT,
        }
    }
}

impl EngineConfig {
    /// Changes with the protocol, the port and the engine, and not with limits or other settings: what was retained of
    /// another engine is not believed, and a changed setting must not cost an engine.
    pub fn fingerprint(&self) -> u32 {
        let mut digest = FINGERPRINT.digest();
        let [protocol, engine] = self.ecu.identity();
        digest.update(&[protocol, engine, self.port]);
        digest.update(self.name.as_bytes());
        digest.finalize()
    }
}

impl EngineConfig {
    /// The table of settings of this engine, in an order that is fixed for each protocol.
    pub fn settings(&self) -> impl Iterator<Item = &'static Setting> {
        Supervision::TABLE.into_iter().chain([Timing::SETTINGS, self.ecu.settings()]).flatten()
    }

    /// The number of a setting; [`crate::setting::OFF`] where it is off.
    pub fn number(&self, name: &str) -> Option<i32> {
        self.supervision.number(name).or_else(|| self.timing.own(name)).or_else(|| self.ecu.number(name))
    }

    /// Changes a setting. What it takes to make that effective stands in its row ([`Setting::effect`]).
    ///
    /// # Errors
    /// [`SettingError`], with nothing changed.
    pub fn set(&mut self, name: &str, number: i32) -> Result<(), SettingError> {
        let setting = self.settings().find(|setting| setting.name == name).ok_or(SettingError::Unknown)?;
        if !setting.allows(number) {
            return Err(SettingError::OutOfRange(setting));
        }
        let done = self.timing.set_own(name, number) || self.ecu.set(name, number);
        if done { Ok(()) } else { self.supervision.set(name, number) }
    }
}

const FINGERPRINT: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);

/// What is wrong with a table of engines, and in which of its rows (from 0).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ConfigError {
    /// The baud rate is none of 2400, 4800, 9600, 19200, 38400, 57600, 115200.
    BaudRate(usize),
    /// Two rows name one port.
    SamePort(usize, usize),
    /// The status rate does not fit the line (ZK-11).
    RateTooFast(usize),
    /// An AMT line has one stop bit (AMT-1).
    AmtStopBits(usize),
    /// No reply fits the window: the guard is too long (AMT-11).
    NoReplyFits(usize),
    /// The serial delay time is not 0.5 s to 60 s, or half of idle not 1 to 254 (AMT-12).
    AmtEngine(usize),
    /// A link would never be up, or would be lost at once or never.
    Timing(usize),
    /// A setting of the supervision is out of its range.
    Supervision(usize, SettingId),
}

impl ConfigError {
    /// A sentence without the row, for where nothing can be formatted.
    pub const fn message(self) -> &'static str {
        match self {
            Self::BaudRate(_) => {
                "an engine's baud rate is none of 2400, 4800, 9600, 19200, 38400, 57600, 115200"
            }
            Self::SamePort(..) => "two engines sit on one port",
            Self::RateTooFast(_) => {
                "an engine's status rate does not fit its line: 20 Hz needs 2400 baud, 50 Hz 4800, 100 Hz 9600"
            }
            Self::AmtStopBits(_) => "an AMT line has one stop bit",
            Self::NoReplyFits(_) => "an engine's reply guard leaves no time for a reply",
            Self::AmtEngine(_) => {
                "an AMT engine has a serial delay of 0.5 s to 60 s, and half of idle of 1 to 254"
            }
            Self::Supervision(_, id) => Supervision::row(id).message,
            Self::Timing(_) => {
                "an engine's link needs at least one frame to be up, and 0.2 s to 60 s of silence to be lost"
            }
        }
    }

    /// The row it was found in.
    pub const fn row(self) -> usize {
        match self {
            Self::BaudRate(row)
            | Self::SamePort(_, row)
            | Self::RateTooFast(row)
            | Self::AmtStopBits(row)
            | Self::NoReplyFits(row)
            | Self::AmtEngine(row)
            | Self::Timing(row)
            | Self::Supervision(row, _) => row,
        }
    }
}

impl core::fmt::Display for ConfigError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "engine {}: {}", self.row(), self.message())
    }
}

impl core::error::Error for ConfigError {}

/// Checks a table of engines.
///
/// # Errors
/// The first thing that is wrong.
pub const fn validate(engines: &[EngineConfig]) -> Result<(), ConfigError> {
    let mut row = 0;
    while row < engines.len() {
        let engine = &engines[row];
        if !engine.line.is_printed_rate() {
            return Err(ConfigError::BaudRate(row));
        }
        if engine.timing.check_own().is_err() {
            return Err(ConfigError::Timing(row));
        }
        if let Err(setting) = engine.supervision.validate() {
            return Err(ConfigError::Supervision(row, setting));
        }
        match &engine.ecu {
            EcuConfig::Zk(config) => {
                if !config.rate.fits(engine.line) {
                    return Err(ConfigError::RateTooFast(row));
                }
            }
            EcuConfig::Amt(config) => {
                if matches!(engine.line.stop_bits, StopBits::Two) {
                    return Err(ConfigError::AmtStopBits(row));
                }
                if config.reply_slack(engine.line).is_none() {
                    return Err(ConfigError::NoReplyFits(row));
                }
                if config.check_own().is_err() {
                    return Err(ConfigError::AmtEngine(row));
                }
            }
        }
        let mut other = 0;
        while other < row {
            if engines[other].port == engine.port {
                return Err(ConfigError::SamePort(other, row));
            }
            other += 1;
        }
        row += 1;
    }
    Ok(())
}

/// Checks a table of engines while it is compiled.
///
/// ```
/// # use jetlink::{config::{check, EngineConfig}, ecu::zk::codec::Rate, line::Line};
/// const GOOD: [EngineConfig; 1] = [EngineConfig::zk("a", 0, Line::new(9600), Rate::Hz100)];
/// const _: () = check(&GOOD);
/// ```
///
/// A status rate that the line cannot carry does not build (ZK-11):
///
/// ```compile_fail
/// # use jetlink::{config::{check, EngineConfig}, ecu::zk::codec::Rate, line::Line};
/// const FAST: [EngineConfig; 1] = [EngineConfig::zk("a", 0, Line::new(4800), Rate::Hz100)];
/// const _: () = check(&FAST);
/// ```
///
/// Nor do two engines on one port:
///
/// ```compile_fail
/// # use jetlink::{config::{check, EngineConfig}, ecu::zk::codec::Rate, line::Line};
/// const TWICE: [EngineConfig; 2] = [
///     EngineConfig::zk("a", 3, Line::new(9600), Rate::Hz20),
///     EngineConfig::amt("b", 3, Line::new(2400), None),
/// ];
/// const _: () = check(&TWICE);
/// ```
///
/// # Panics
/// With what is wrong. In a `const` that stops the build.
pub const fn check(engines: &[EngineConfig]) {
    if let Err(error) = validate(engines) {
        panic!("{}", error.message());
    }
}
