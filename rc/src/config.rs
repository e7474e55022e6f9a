//! Receiver of a node: its protocol, its port, and what its channels do for each engine.

use crate::crsf::{self, Crsf};
use crate::input::Input;
use crate::pwm::{PWM_CHANNELS, Pwm};
use crate::sbus::{self, Sbus};
use crate::settings::{EngineSettings, SettingsError};

/// Protocol of a receiver.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Protocol {
    /// SBUS: 100 000 baud, 8E2.
    Sbus,
    /// CRSF: 420 000 baud, 8N1.
    Crsf,
    /// Servo pulses, each channel on a pin of a timer.
    Pwm,
}

/// Line of a receiver on a UART.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct RadioLine {
    /// Bits per second.
    pub baud: u32,
    /// Even parity and two stop bits, instead of none and one.
    pub is_8e2: bool,
}

impl Protocol {
    /// Line of the protocol; `None`: it uses no UART.
    pub const fn line(self) -> Option<RadioLine> {
        match self {
            Self::Sbus => Some(RadioLine { baud: sbus::BAUD, is_8e2: true }),
            Self::Crsf => Some(RadioLine { baud: crsf::BAUD, is_8e2: false }),
            Self::Pwm => None,
        }
    }

    /// An input that has received nothing.
    pub const fn input(self) -> Input {
        match self {
            Self::Sbus => Input::Sbus(Sbus::new()),
            Self::Crsf => Input::Crsf(Crsf::new()),
            Self::Pwm => Input::Pwm(Pwm::new()),
        }
    }
}

/// A receiver and its engines.
///
/// ```
/// # use jetlink_rc::{config::RadioConfig, settings::EngineSettings};
/// const ENGINE: EngineSettings = EngineSettings { switch: 6, ..EngineSettings::DEFAULT };
/// const RADIO: RadioConfig<1> = RadioConfig::sbus(5, [ENGINE]);
/// const _: () = RADIO.check();
/// ```
///
/// Settings that contradict each other do not build. Here the switch has the throttle's channel:
///
/// ```compile_fail,E0080
/// # use jetlink_rc::{config::RadioConfig, settings::EngineSettings};
/// const ENGINE: EngineSettings = EngineSettings { switch: 3, ..EngineSettings::DEFAULT };
/// const RADIO: RadioConfig<1> = RadioConfig::sbus(5, [ENGINE]);
/// const _: () = RADIO.check();
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct RadioConfig<const N: usize> {
    /// ECU port of the board that the receiver uses, from 0, or the number behind them for the board's socket for a receiver, if it has
    /// one. No engine uses it. Servo pulses need no port.
    pub port: u8,
    /// Protocol.
    pub protocol: Protocol,
    /// The line is inverted, and the board's UART, or the inverter at its socket, inverts it back. Not every chip's UART can.
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

    /// Servo pulses on the board's pulse inputs. Channel numbers are those of the inputs, from 1: see [`EngineSettings::PULSES`].
    pub const fn pwm(engines: [EngineSettings; N]) -> Self {
        Self { port: 0, protocol: Protocol::Pwm, inverted: false, engines }
    }

    /// The port that the receiver uses, if any.
    pub const fn uart(&self) -> Option<u8> {
        if self.protocol.line().is_some() { Some(self.port) } else { None }
    }

    /// Checks the settings of each engine, at compile time.
    ///
    /// # Panics
    /// With what is wrong. In a `const` this stops the build.
    pub const fn check(&self) {
        let mut engine = 0;
        while engine < N {
            match self.engines[engine].check() {
                Ok(()) => {}
                Err(SettingsError::OutOfRange(setting)) => panic!("{}", setting.message),
                Err(error) => panic!("{}", error.text()),
            }
            let EngineSettings { rpm_low, rpm_high, .. } = self.engines[engine];
            assert!(
                !matches!(self.protocol, Protocol::Pwm)
                    || self.engines[engine].highest_channel() <= PWM_CHANNELS as u8,
                "servo pulses have four channels: see EngineSettings::PULSES"
            );
            assert!(
                rpm_low.is_some() == rpm_high.is_some(),
                "rc.rpm_low and rc.rpm_high: set both or none, the second above the first"
            );
            engine += 1;
        }
    }
}
