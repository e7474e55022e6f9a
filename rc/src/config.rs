//! Receiver of a node: its protocol, its port, and what its channels do for each engine.

use crate::crsf::{self, Crsf};
use crate::input::Input;
use crate::sbus::{self, Sbus};
use crate::settings::{EngineSettings, SettingsError};

/// Protocol of a receiver on a UART.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Protocol {
    /// SBUS: 100 000 baud, 8E2.
    Sbus,
    /// CRSF: 420 000 baud, 8N1.
    Crsf,
}

impl Protocol {
    /// Baud rate.
    pub const fn baud(self) -> u32 {
        match self {
            Self::Sbus => sbus::BAUD,
            Self::Crsf => crsf::BAUD,
        }
    }

    /// Whether its line has even parity and two stop bits, instead of none and one.
    pub const fn is_8e2(self) -> bool {
        matches!(self, Self::Sbus)
    }

    /// An input that has received nothing.
    pub const fn input(self) -> Input {
        match self {
            Self::Sbus => Input::Sbus(Sbus::new()),
            Self::Crsf => Input::Crsf(Crsf::new()),
        }
    }
}

/// A receiver and its engines.
///
/// ```
/// # use jetlink_rc::{config::RadioConfig, settings::EngineSettings};
/// const RADIO: RadioConfig<2> = RadioConfig::sbus(5, [EngineSettings::DEFAULT; 2]);
/// const _: () = RADIO.check();
/// ```
///
/// Settings that contradict each other do not build:
///
/// ```compile_fail
/// # use jetlink_rc::{config::RadioConfig, settings::EngineSettings};
/// const ONE_CHANNEL: EngineSettings = EngineSettings { switch: 3, ..EngineSettings::DEFAULT };
/// const RADIO: RadioConfig<1> = RadioConfig::sbus(5, [ONE_CHANNEL]);
/// const _: () = RADIO.check();
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct RadioConfig<const N: usize> {
    /// ECU port of the board that it is on, from 0. No engine is there.
    pub port: u8,
    /// Protocol.
    pub protocol: Protocol,
    /// The line is inverted, and the board's UART inverts it back. Not every chip's can.
    pub inverted: bool,
    /// What its channels do for each engine, in the order of the table of engines.
    pub engines: [EngineSettings; N],
}

impl<const N: usize> RadioConfig<N> {
    /// An SBUS receiver, whose line is inverted.
    pub const fn sbus(port: u8, engines: [EngineSettings; N]) -> Self {
        Self { port, protocol: Protocol::Sbus, inverted: true, engines }
    }

    /// A CRSF receiver.
    pub const fn crsf(port: u8, engines: [EngineSettings; N]) -> Self {
        Self { port, protocol: Protocol::Crsf, inverted: false, engines }
    }

    /// Checks the settings of each engine, at compile time.
    ///
    /// # Panics
    /// With what is wrong. In a `const` that stops the build.
    pub const fn check(&self) {
        let mut engine = 0;
        while engine < N {
            match self.engines[engine].check() {
                Ok(()) => {}
                Err(SettingsError::OutOfRange(setting)) => panic!("{}", setting.message),
                Err(SettingsError::EndPoints) => panic!("rc.high has to be 300 µs above rc.low or more"),
                Err(SettingsError::ShaftSpeeds) => {
                    panic!("rc.rpm_low and rc.rpm_high: set both, the second above the first")
                }
                Err(SettingsError::SameChannel) => {
                    panic!("rc.throttle, rc.switch and rc.hand_over need a channel each")
                }
                Err(SettingsError::EngineTurns) => unreachable!(),
            }
            engine += 1;
        }
    }
}
