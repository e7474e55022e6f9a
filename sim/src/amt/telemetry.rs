//! The reports of an AMT ECU, and the bytes of the four kinds of set.

use core::fmt;

/// The engines of the document's tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EngineModel {
    /// Mercury.
    Mercury,
    /// Pegasus.
    Pegasus,
    /// Olympus.
    Olympus,
    /// Titan.
    Titan,
    /// Nike.
    Nike,
    /// Lynx.
    Lynx,
}

impl EngineModel {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Mercury, Self::Pegasus, Self::Olympus, Self::Titan, Self::Nike, Self::Lynx];

    /// Name in lower case.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mercury => "mercury",
            Self::Pegasus => "pegasus",
            Self::Olympus => "olympus",
            Self::Titan => "titan",
            Self::Nike => "nike",
            Self::Lynx => "lynx",
        }
    }

    /// The engine with this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|engine| engine.name() == name)
    }

    /// Data 1 of the alternate set (AMT-4).
    pub const fn id(self) -> u8 {
        match self {
            Self::Mercury => 0x08,
            Self::Pegasus => 0x10,
            Self::Olympus => 0x18,
            Self::Titan => 0x20,
            Self::Nike => 0x28,
            Self::Lynx => 0x30,
        }
    }

    /// Data 1 of the alternate set with "older versions".
    pub const fn old_id(self) -> Option<u8> {
        match self {
            Self::Pegasus => Some(0x03),
            Self::Olympus => Some(0x06),
            Self::Mercury => Some(0x07),
            Self::Titan | Self::Nike | Self::Lynx => None,
        }
    }

    /// A first number of the software version that identifies this engine (AMT-9).
    pub const fn version(self) -> u8 {
        match self {
            Self::Mercury => 8,
            Self::Pegasus => 7,
            Self::Olympus => 9,
            Self::Titan => 10,
            Self::Nike => 12,
            Self::Lynx => 14,
        }
    }

    /// Rpm of one unit (AMT-5). Open for Nike and Lynx: this ECU uses 500 there.
    const fn rpm_unit(self) -> f64 {
        match self {
            Self::Mercury => 700.0,
            _ => 500.0,
        }
    }

    /// Volts of 255 units of pump voltage (AMT-6). Open for Lynx: 8.30 here.
    const fn pump_scale(self) -> f64 {
        match self {
            Self::Mercury | Self::Pegasus => 6.25,
            _ => 8.30,
        }
    }

    /// Volts of 255 units of external battery voltage above 7 V (AMT-6). Open for Lynx: 9.30 here.
    const fn external_scale(self) -> f64 {
        match self {
            Self::Mercury | Self::Pegasus => 6.25,
            _ => 9.30,
        }
    }
}

/// The name with a capital letter, as AMT prints it.
impl fmt::Display for EngineModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first, rest) = self.name().split_at(1);
        write!(f, "{}{rest}", first.to_ascii_uppercase())
    }
}

/// Bits 7 to 3 of Data 1 in a normal set (AMT-3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// None of the states below.
    NoClearance,
    /// Cleared for a commanded start.
    StartClearance,
    /// Starter, igniter, first ignition.
    Starting,
    /// It accelerates without the starter.
    StartedUp,
    /// Idle is being measured.
    IdleCalibration,
    /// It follows the throttle.
    FullOperation,
    /// At its maximum speed.
    MaximumRpm,
    /// An unnamed number, 0 to 31.
    Unnamed(u8),
}

impl Status {
    /// The five bits, in their place in the byte.
    pub const fn bits(self) -> u8 {
        match self {
            Self::NoClearance => 0,
            Self::StartClearance => 0b00001 << 3,
            Self::Starting => 0b00010 << 3,
            Self::StartedUp => 0b00100 << 3,
            Self::IdleCalibration => 0b01000 << 3,
            Self::FullOperation => 0b01100 << 3,
            Self::MaximumRpm => 0b10000 << 3,
            Self::Unnamed(number) => number << 3,
        }
    }
}

/// A value as the ECU sends it: rounded, and never 0xFF, which is the head (AMT-1).
fn unit(value: f64) -> u8 {
    value.round().clamp(0.0, 254.0) as u8
}

/// Content of normal and error sets.
#[derive(Clone, Copy, Debug)]
pub(super) struct Values {
    pub(super) engine: EngineModel,
    pub(super) rpm: f64,
    pub(super) egt: f64,
    pub(super) throttle_half_percent: u8,
    pub(super) pump_v: f64,
}

impl Values {
    fn rest(&self) -> [u8; 3] {
        // EGT = v x 4.6 - 50, throttle = v / 2 (AMT-7)
        [
            unit((self.egt + 50.0) / 4.6),
            self.throttle_half_percent.min(254),
            unit(self.pump_v * 255.0 / self.engine.pump_scale()),
        ]
    }

    pub(super) fn normal(&self, status: Status, switch_bits: u8) -> [u8; 6] {
        let [egt, throttle, pump] = self.rest();
        [0xFF, status.bits() | switch_bits & 7, unit(self.rpm / self.engine.rpm_unit()), egt, throttle, pump]
    }

    pub(super) fn error(&self, errors: u8) -> [u8; 6] {
        let [egt, throttle, pump] = self.rest();
        [0xFF, 0, errors.min(254), egt, throttle, pump]
    }
}

/// The voltages of the alternate set.
#[derive(Clone, Copy, Debug)]
pub(super) struct Voltages {
    pub(super) idle: f64,
    pub(super) maximum: f64,
    pub(super) battery: f64,
    pub(super) external: f64,
}

pub(super) fn alternate(engine: EngineModel, id: u8, voltages: Voltages) -> [u8; 6] {
    let pump = |volts: f64| unit(volts * 255.0 / engine.pump_scale());
    [
        0xFF,
        id.min(254),
        pump(voltages.idle),
        pump(voltages.maximum),
        unit(voltages.battery * 255.0 / 10.0),
        unit((voltages.external - 7.0) * 255.0 / engine.external_scale()),
    ]
}

/// The set-up set (AMT-9): 17 bytes in the old form, 18 in the new one.
pub(super) fn setup(pulse: [u8; 3], text: &str) -> Vec<u8> {
    let mut bytes = vec![0xFF, 0x05];
    bytes.extend(pulse);
    bytes.extend(text.bytes());
    for byte in &mut bytes[2..] {
        *byte = (*byte).min(254);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_normal_set_has_the_bytes_computed_by_hand() {
        let values = Values {
            engine: EngineModel::Olympus,
            rpm: 108_500.0,
            egt: 700.0,
            throttle_half_percent: 100,
            pump_v: 6.2,
        };
        // 01100 + 100; 108500 / 500; (700 + 50) / 4.6 = 163.04; 50 %; 6.2 x 255 / 8.3 = 190.5
        assert_eq!(values.normal(Status::FullOperation, 0x14), [0xFF, 0x64, 217, 163, 100, 190]);
        assert_eq!(values.normal(Status::NoClearance, 0x12), [0xFF, 0x02, 217, 163, 100, 190]);
        assert_eq!(values.normal(Status::MaximumRpm, 0x11)[1], 0x81);
        assert_eq!(values.error(0b0010_1001), [0xFF, 0, 0x29, 163, 100, 190]);

        let mercury = Values { engine: EngineModel::Mercury, rpm: 151_200.0, ..values };
        assert_eq!(mercury.normal(Status::Starting, 0x14), [0xFF, 0x14, 216, 163, 100, 253]);
    }

    #[test]
    fn no_data_byte_is_ever_the_head() {
        let values = Values {
            engine: EngineModel::Pegasus,
            rpm: 1e9,
            egt: 1e9,
            throttle_half_percent: 255,
            pump_v: 1e9,
        };
        assert_eq!(values.normal(Status::MaximumRpm, 4)[1..], [0x84, 254, 254, 254, 254]);
        assert_eq!(values.error(255)[1..], [0, 254, 254, 254, 254]);
        let cold = Values { rpm: -1.0, egt: -100.0, pump_v: f64::NAN, ..values };
        assert_eq!(cold.normal(Status::NoClearance, 1)[1..4], [1, 0, 0]);
    }

    #[test]
    fn an_alternate_set_has_the_bytes_computed_by_hand() {
        let voltages = Voltages { idle: 1.3, maximum: 6.2, battery: 7.4, external: 12.0 };
        // 1.3 x 255 / 8.3 = 39.9; 190.5; 7.4 x 25.5 = 188.7; 5 x 255 / 9.3 = 137.1
        assert_eq!(alternate(EngineModel::Titan, 0x20, voltages), [0xFF, 0x20, 40, 190, 189, 137]);
    }

    #[test]
    fn a_set_up_set_is_as_long_as_its_version() {
        let old = setup([0xF8, 0x00, 62], "9.35 140617 ");
        assert_eq!(old, b"\xFF\x05\xF8\x00\x3E9.35 140617 ");
        assert_eq!(old.len(), 17);
        let new = setup([0xF8, 0x00, 62], "10.35 140617 ");
        assert_eq!(new.len(), 18);
    }
}
