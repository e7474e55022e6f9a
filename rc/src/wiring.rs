//! Pins of the board that drive the outputs of an engine. They are compiled in: after a reset they are driven before any setting can
//! be read from the flash.

use crate::outputs::{Outputs, Valve};
use crate::settings::OutputSettings;

/// A pin of the board, and the level that energises what it drives.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct OutputPin {
    /// Number of the board's output, from 0.
    pub number: u8,
    /// The low level energises, instead of the high one.
    pub low: bool,
}

impl OutputPin {
    /// The high level energises.
    pub const fn high(number: u8) -> Self {
        Self { number, low: false }
    }

    /// The low level energises.
    pub const fn low(number: u8) -> Self {
        Self { number, low: true }
    }
}

/// Level of a pin.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct PinLevel {
    /// Number of the board's output.
    pub number: u8,
    /// It is high.
    pub high: bool,
}

/// Outputs of an engine. An output without a pin is not driven.
///
/// ```
/// # use jetlink_rc::wiring::{OutputConfig, OutputPin, check_outputs};
/// const LEFT: OutputConfig = OutputConfig::valve(OutputPin::high(0)).with_power(OutputPin::low(1));
/// const RIGHT: OutputConfig = OutputConfig::valve(OutputPin::high(2));
/// const _: () = check_outputs(&[LEFT, RIGHT, OutputConfig::NONE]);
/// ```
///
/// One pin for two outputs does not build:
///
/// ```compile_fail,E0080
/// # use jetlink_rc::wiring::{OutputConfig, OutputPin, check_outputs};
/// const LEFT: OutputConfig = OutputConfig::valve(OutputPin::high(0)).with_power(OutputPin::low(1));
/// const RIGHT: OutputConfig = OutputConfig::valve(OutputPin::high(1));
/// const _: () = check_outputs(&[LEFT, RIGHT, OutputConfig::NONE]);
/// ```
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct OutputConfig {
    /// Fuel valve. Only if the wiring holds the valve while the pin floats: see `docs/rc.md` in the repository.
    pub valve: Option<OutputPin>,
    /// Power of starter and ignition.
    pub power: Option<OutputPin>,
    /// Settings.
    pub settings: OutputSettings,
}

impl OutputConfig {
    /// No output.
    pub const NONE: Self = Self { valve: None, power: None, settings: OutputSettings::DEFAULT };

    /// A fuel valve.
    pub const fn valve(pin: OutputPin) -> Self {
        Self { valve: Some(pin), ..Self::NONE }
    }

    /// The same, with the power of starter and ignition.
    pub const fn with_power(self, pin: OutputPin) -> Self {
        Self { power: Some(pin), ..self }
    }

    /// Pins that are driven, with the levels for this state.
    pub fn levels(&self, outputs: &Outputs) -> impl Iterator<Item = PinLevel> + use<> {
        let level = |pin: OutputPin, on: bool| PinLevel { number: pin.number, high: on != pin.low };
        let valve = self.valve.map(|pin| level(pin, outputs.valve() == Valve::Open));
        let power = self.power.map(|pin| level(pin, outputs.power()));
        valve.into_iter().chain(power)
    }
}

/// Checks the outputs of all engines, at compile time.
///
/// # Panics
/// With what is wrong. In a `const` this stops the build.
pub const fn check_outputs(engines: &[OutputConfig]) {
    let mut engine = 0;
    while engine < engines.len() {
        if engines[engine].settings.check().is_err() {
            panic!("outputs.not_obeyed is outside of its range");
        }
        engine += 1;
    }
    let mut a = 0;
    while a < 2 * engines.len() {
        let mut b = 0;
        while b < a {
            if let (Some(a), Some(b)) = (nth(engines, a), nth(engines, b)) {
                assert!(a.number != b.number, "two outputs have the same pin");
            }
            b += 1;
        }
        a += 1;
    }
}

/// Checks that no output is on one of these pins, at compile time.
///
/// # Panics
/// If one is, with the purpose of the pins. In a `const` this stops the build.
pub const fn check_free(engines: &[OutputConfig], pins: &[u8], what: &str) {
    let mut n = 0;
    while n < 2 * engines.len() {
        let mut i = 0;
        while i < pins.len() {
            if let Some(pin) = nth(engines, n) {
                assert!(pin.number != pins[i], "{}", what);
            }
            i += 1;
        }
        n += 1;
    }
}

/// The nth pin, counted over valve and power of all engines.
const fn nth(engines: &[OutputConfig], n: usize) -> Option<OutputPin> {
    let engine = &engines[n / 2];
    if n.is_multiple_of(2) { engine.valve } else { engine.power }
}

/// Checks the outputs of all engines against those of a board, at compile time: for each, whether its bootloader drives it low.
///
/// # Panics
/// With what is wrong. In a `const` this stops the build.
pub const fn check_board(engines: &[OutputConfig], low_before: &[bool]) {
    let mut n = 0;
    while n < 2 * engines.len() {
        if let Some(pin) = nth(engines, n) {
            assert!((pin.number as usize) < low_before.len(), "this board has no such output");
            assert!(
                !(pin.low && low_before[pin.number as usize]),
                "the board's bootloader drives this output low: what hangs on it has to be energised by the high level"
            );
        }
        n += 1;
    }
}
