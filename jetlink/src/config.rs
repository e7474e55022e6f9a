//! The table of engines: port, line, ECU and supervision of each.
//!
//! [`check`] checks it at compile time: a status rate that the line cannot carry, two engines on one port, a baud rate that
//! no document lists or a reply that cannot fit its window do not build.

use crate::checksum::Checksum;
use crate::ecu::amt::{self, codec::EngineModel};
use crate::ecu::zk::{self, codec::Rate};
use crate::ecu::{EcuConfig, Mistake};
use crate::engine::config::Supervision;
use crate::line::{Line, Timing};
use crate::mistake::Sentence;
use crate::sentence::sentences;
use crate::setting::{Row, Setting, SettingError, SettingId, find_parameter};
use crate::units::BaudRate;

/// One engine and its port.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct EngineConfig {
    /// Name in logs.
    pub name: &'static str,
    /// ECU port of the board, from 0.
    pub port: u8,
    /// Baud rate and stop bits.
    pub line: Line,
    /// ECU and its settings.
    pub ecu: EcuConfig,
    /// Conditions for a link that is up or lost.
    pub timing: Timing,
    /// Supervision.
    pub supervision: Supervision,
}

impl EngineConfig {
    /// An engine with this ECU. Timing and supervision have their defaults.
    pub const fn new(name: &'static str, port: u8, line: Line, ecu: EcuConfig) -> Self {
        Self { name, port, line, ecu, timing: ecu.timing(), supervision: Supervision::DEFAULT }
    }

    /// An engine with an AMT ECU and default settings.
    pub const fn amt(name: &'static str, port: u8, line: Line, engine: Option<EngineModel>) -> Self {
        let config = amt::config::Config { engine, ..amt::config::Config::DEFAULT };
        Self::new(name, port, line, EcuConfig::Amt(config))
    }

    /// An engine with a ZK ECU and default settings.
    pub const fn zk(name: &'static str, port: u8, line: Line, rate: Rate) -> Self {
        let config = zk::config::Config { rate, ..zk::config::Config::DEFAULT };
        Self::new(name, port, line, EcuConfig::Zk(config))
    }
}

impl EngineConfig {
    /// Identifies protocol, port and engine for the retained state: that of another engine is discarded. Settings do not
    /// change it, because a changed setting must not cost a running engine.
    pub fn fingerprint(&self) -> u32 {
        let [protocol, engine] = self.ecu.identity();
        Checksum::new().bytes(&[protocol, engine, self.port]).bytes(self.name.as_bytes()).value()
    }
}

impl EngineConfig {
    /// The table of settings of this engine, in an order that is fixed for each protocol.
    pub fn settings(&self) -> impl Iterator<Item = &'static Setting> {
        Supervision::TABLE.into_iter().chain(self.ecu.settings()).flatten()
    }

    /// The same table without its texts, as a firmware offers it as parameters ([`Row::is_parameter`]).
    pub fn rows(&self) -> impl Iterator<Item = &'static Row> + use<> {
        Supervision::TABLE_ROWS.into_iter().chain(self.ecu.rows()).flatten()
    }

    /// The first parameter for which `is_it` is true, in the order of [`EngineConfig::rows`].
    pub fn find_parameter(&self, is_it: &mut dyn FnMut(&'static Row) -> bool) -> Option<&'static Row> {
        let found = find_parameter(&Supervision::TABLE_ROWS, is_it);
        if found.is_some() { found } else { find_parameter(&self.ecu.rows(), is_it) }
    }

    /// The value of a setting; [`crate::setting::OFF`] where it is off.
    pub fn number(&self, name: &str) -> Option<i32> {
        let of_link = || self.timing.own::<true>(name).or_else(|| self.ecu.number::<true>(name));
        self.supervision.number(name).or_else(of_link)
    }

    /// The value of a parameter, as [`EngineConfig::number`]. An image that uses only parameters does not contain the other settings.
    pub fn parameter(&self, name: &str) -> Option<i32> {
        let of_link = || self.timing.own::<false>(name).or_else(|| self.ecu.number::<false>(name));
        self.supervision.parameter(name).or_else(of_link)
    }

    /// Changes a setting. Its row says when it takes effect ([`Setting::effect`]).
    ///
    /// # Errors
    /// [`SettingError`], with nothing changed.
    pub fn set(&mut self, name: &str, number: i32) -> Result<(), SettingError> {
        let setting = self.settings().find(|setting| setting.name == name).ok_or(SettingError::Unknown)?;
        if !setting.allows(number) {
            return Err(SettingError::OutOfRange(setting));
        }
        if self.change(name, number) { Ok(()) } else { Err(SettingError::Off(setting)) }
    }

    /// Changes a setting without checking its range, for a number that its row ([`EngineConfig::rows`]) allows. One that its type
    /// cannot hold becomes the closest one. False: no setting has this name, or it belongs to a function that is off.
    pub fn change(&mut self, name: &str, number: i32) -> bool {
        self.timing.set_own::<true>(name, number)
            || self.ecu.set::<true>(name, number)
            || self.supervision.change(name, number)
    }

    /// Changes a parameter whose row ([`EngineConfig::rows`]) allows this number. False: no parameter has this name.
    pub fn change_parameter(&mut self, name: &str, number: i32) -> bool {
        self.timing.set_own::<false>(name, number)
            || self.ecu.set::<false>(name, number)
            || self.supervision.change_parameter(name, number)
    }
}

/// Settings of a link, which a running node may be given ([`crate::channel::Setup::configure_link`]).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LinkSettings {
    /// Settings of the protocol.
    pub ecu: EcuConfig,
    /// Conditions for a link that is up or lost.
    pub timing: Timing,
}

impl From<&EngineConfig> for LinkSettings {
    fn from(config: &EngineConfig) -> Self {
        Self { ecu: config.ecu, timing: config.timing }
    }
}

impl LinkSettings {
    /// Checks every range, that the line can carry the protocol, and that protocol and engine are the same as `before`.
    pub(crate) fn check(&self, line: Line, before: &EcuConfig) -> Result<(), LinkSettingsError> {
        if self.ecu.identity() != before.identity() {
            return Err(LinkSettingsError::OtherEcu);
        }
        self.timing.check().map_err(LinkSettingsError::Timing)?;
        self.ecu.check(line).map_err(LinkSettingsError::Ecu)
    }
}

/// Reason why settings of a link were not taken. Nothing has changed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum LinkSettingsError {
    /// The protocol, or the engine that an AMT ECU is set to, is another one: that needs a new node.
    OtherEcu,
    /// A setting of the link's timing is out of its range.
    Timing(SettingId),
    /// A mistake that the protocol knows.
    Ecu(Mistake),
}

sentences!(LinkSettingsError {
    Self::OtherEcu => "another protocol or engine: build a new node for it";
} {
    Self::Timing(id) => "{}", Timing::message(id);
    Self::Ecu(mistake) => "{}", mistake;
});

impl core::error::Error for LinkSettingsError {}

/// Mistake in a table of engines, with its row (from 0).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum ConfigError {
    /// The baud rate is not in [`Line::BAUD_RATES`].
    BaudRate(usize),
    /// Two rows have the same port.
    SamePort(usize, usize),
    /// A mistake that the protocol knows.
    Ecu(usize, Mistake),
    /// A setting of the link's timing is out of its range.
    Timing(usize, SettingId),
    /// A setting of the supervision is out of its range.
    Supervision(usize, SettingId),
    /// There is retained memory, but none for the port of this engine.
    RetainedMemory(usize),
}

impl ConfigError {
    /// A sentence without the row, for use in a constant.
    pub const fn message(self) -> &'static str {
        match self {
            Self::BaudRate(_) => BaudRate::INVALID,
            Self::SamePort(..) => "two engines on one port: give each its own",
            Self::Ecu(_, mistake) => mistake.message(),
            Self::Supervision(_, id) => Supervision::row(id).message,
            Self::Timing(_, id) => Timing::message(id),
            Self::RetainedMemory(_) => {
                "no retained memory for its port: give the node one for each port, by its number"
            }
        }
    }

    /// The row of the mistake.
    pub const fn row(self) -> usize {
        match self {
            Self::BaudRate(row)
            | Self::SamePort(_, row)
            | Self::Ecu(row, _)
            | Self::Timing(row, _)
            | Self::Supervision(row, _)
            | Self::RetainedMemory(row) => row,
        }
    }
}

// An image that prints it contains the texts of the table of settings.
sentences!(ConfigError {
} {
    error => "row {} of the table of engines: {}", error.row() + 1, error.message();
});

impl core::error::Error for ConfigError {}

/// Checks a table of engines.
///
/// # Errors
/// The first mistake.
pub const fn validate(engines: &[EngineConfig]) -> Result<(), ConfigError> {
    let mut row = 0;
    while row < engines.len() {
        let engine = &engines[row];
        if !engine.line.is_printed_rate() {
            return Err(ConfigError::BaudRate(row));
        }
        if let Err(setting) = engine.timing.check() {
            return Err(ConfigError::Timing(row, setting));
        }
        if let Err(error) = engine.supervision.validate() {
            return Err(ConfigError::Supervision(row, error.setting));
        }
        if let Err(mistake) = engine.ecu.check(engine.line) {
            return Err(ConfigError::Ecu(row, mistake));
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

/// Checks a table of engines at compile time.
///
/// ```
/// # use jetlink::{config::{check, EngineConfig}, ecu::zk::codec::Rate, line::Line};
/// const ENGINES: [EngineConfig; 1] = [EngineConfig::zk("a", 0, Line::new(9600), Rate::Hz100)];
/// const _: () = check(&ENGINES);
/// ```
///
/// A status rate that the line cannot carry does not build (ZK-11):
///
/// ```compile_fail,E0080
/// # use jetlink::{config::{check, EngineConfig}, ecu::zk::codec::Rate, line::Line};
/// const ENGINES: [EngineConfig; 1] = [EngineConfig::zk("a", 0, Line::new(4800), Rate::Hz100)];
/// const _: () = check(&ENGINES);
/// ```
///
/// Two engines have two ports:
///
/// ```
/// # use jetlink::{config::{check, EngineConfig}, ecu::zk::codec::Rate, line::Line};
/// const ENGINES: [EngineConfig; 2] = [
///     EngineConfig::zk("a", 3, Line::new(9600), Rate::Hz20),
///     EngineConfig::amt("b", 4, Line::new(2400), None),
/// ];
/// const _: () = check(&ENGINES);
/// ```
///
/// On one port they do not build:
///
/// ```compile_fail,E0080
/// # use jetlink::{config::{check, EngineConfig}, ecu::zk::codec::Rate, line::Line};
/// const ENGINES: [EngineConfig; 2] = [
///     EngineConfig::zk("a", 3, Line::new(9600), Rate::Hz20),
///     EngineConfig::amt("b", 3, Line::new(2400), None),
/// ];
/// const _: () = check(&ENGINES);
/// ```
///
/// # Panics
/// With the mistake. In a `const` that stops the build.
pub const fn check(engines: &[EngineConfig]) {
    if let Err(error) = validate(engines) {
        let row = error.row();
        panic!("{}", Sentence::of_engine(row, engines[row].name).text(error.message()).as_str());
    }
}

/// Checks at compile time that no engine uses a port that the board does not have.
///
/// ```
/// # use jetlink::{config::{check_ports, EngineConfig}, line::Line};
/// const ENGINES: [EngineConfig; 1] = [EngineConfig::amt("a", 4, Line::new(2400), None)];
/// const _: () = check_ports(&ENGINES, 5);
/// ```
///
/// ```compile_fail,E0080
/// # use jetlink::{config::{check_ports, EngineConfig}, line::Line};
/// const ENGINES: [EngineConfig; 1] = [EngineConfig::amt("a", 5, Line::new(2400), None)];
/// const _: () = check_ports(&ENGINES, 5);
/// ```
///
/// # Panics
/// With the first engine that does. In a `const` that stops the build.
pub const fn check_ports(engines: &[EngineConfig], ports: usize) {
    let mut row = 0;
    while row < engines.len() {
        let port = engines[row].port as usize;
        if port >= ports {
            let sentence = Sentence::of_engine(row, engines[row].name)
                .text("there is no port ")
                .number(port)
                .text(" for an engine: this board has ")
                .number(ports)
                .text(", counted from 0");
            panic!("{}", sentence.as_str());
        }
        row += 1;
    }
}

/// Checks at compile time that no engine uses a port that something else uses.
///
/// ```
/// # use jetlink::{config::{check_port_is_free, EngineConfig}, line::Line};
/// const ENGINES: [EngineConfig; 1] = [EngineConfig::amt("a", 4, Line::new(2400), None)];
/// const _: () = check_port_is_free(&ENGINES, 5, "a receiver");
/// ```
///
/// ```compile_fail,E0080
/// # use jetlink::{config::{check_port_is_free, EngineConfig}, line::Line};
/// const ENGINES: [EngineConfig; 1] = [EngineConfig::amt("a", 4, Line::new(2400), None)];
/// const _: () = check_port_is_free(&ENGINES, 4, "a receiver");
/// ```
///
/// # Panics
/// With the first engine that does. In a `const` that stops the build.
pub const fn check_port_is_free(engines: &[EngineConfig], port: u8, user: &str) {
    let mut row = 0;
    while row < engines.len() {
        if engines[row].port == port {
            let sentence = Sentence::of_engine(row, engines[row].name)
                .text("port ")
                .number(port as usize)
                .text(" is used by ")
                .text(user);
            panic!("{}", sentence.as_str());
        }
        row += 1;
    }
}
