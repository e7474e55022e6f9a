//! ZK-Protocol V1.2: bytes and typed frames, with scale and offset. Knows no time.
//!
//! ```text
//! control, host to ECU:  0xFF | ID·4 … payload | payload | CRC          4 bytes, CRC over bytes 1..=2
//! status,  ECU to host:  0xF0+ID | rpm/10 LSB | rpm/10 MSB | 3 bytes | CRC   7 bytes, CRC over bytes 0..=5
//! ```

use crate::ecu::decoder::feed;
use crate::line::Line;
use crate::open_enum::open_enum;
use crate::units::{
    Celsius, Grams, Hectopascals, Milliamps, Millilitres, MillilitresPerMinute, Millivolts, OutOfRange,
    Pascals, Rpm, Throttle, within,
};
use core::ops::RangeInclusive;
use crc::{CRC_8_MAXIM_DOW, Crc, NoTable};
use embassy_time::Duration;

/// Bytes of a control frame.
pub const CONTROL_LEN: usize = 4;
/// Bytes of a status frame.
pub const STATUS_LEN: usize = 7;
/// First byte of every control frame.
pub const CONTROL_HEAD: u8 = 0xFF;
/// The status IDs that the document names (ZK-15).
const STATUS_IDS: RangeInclusive<u8> = 1..=9;

/// CRC-8/MAXIM-DOW: polynomial 0x31 reflected (0x8C), start 0, no final xor (ZK-1). Without a table, which would be larger
/// than the frames are long.
const CRC: Crc<u8, NoTable> = Crc::<u8, NoTable>::new(&CRC_8_MAXIM_DOW);

/// The CRC of a frame's bytes (ZK-1).
pub const fn crc8(bytes: &[u8]) -> u8 {
    CRC.checksum(bytes)
}

/// Protocol version of an ECU, from status ID 6 (0..=63).
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Version(u8);

impl Version {
    /// The lowest. What it knows every ECU knows, also one whose version is not known.
    pub const FIRST: Self = Self(1);

    /// From its number; six bits on the wire.
    ///
    /// # Errors
    /// [`OutOfRange`] above 63.
    pub const fn new(version: u8) -> Result<Self, OutOfRange> {
        match within(version as u32, 0, 63) {
            Ok(()) => Ok(Self(version)),
            Err(error) => Err(error),
        }
    }

    /// Its number.
    pub const fn get(self) -> u8 {
        self.0
    }

    /// Whether an ECU has what came with version `since`, by the version that is known of it; `None` where none is known.
    pub const fn knows(known: Option<Self>, since: Self) -> Option<bool> {
        match known {
            Some(version) => Some(version.0 >= since.0),
            None => None,
        }
    }
}

/// How often an ECU gives its status (ZK-11).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Rate {
    /// 20 frames a second; needs 2400 baud.
    Hz20,
    /// 50 frames a second; needs 4800 baud.
    Hz50,
    /// 100 frames a second; needs 9600 baud.
    Hz100,
}

impl Rate {
    /// Frames a second.
    pub const fn hz(self) -> u32 {
        match self {
            Self::Hz20 => 20,
            Self::Hz50 => 50,
            Self::Hz100 => 100,
        }
    }

    /// Time between two frames.
    pub const fn interval(self) -> Duration {
        Duration::from_millis(1000 / self.hz() as u64)
    }

    /// From the code in status ID 6; code 3 has no meaning printed.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            0 => Some(Self::Hz20),
            1 => Some(Self::Hz50),
            2 => Some(Self::Hz100),
            _ => None,
        }
    }

    /// The command that sets it.
    pub const fn action(self) -> Action {
        match self {
            Self::Hz20 => Action::Rate20Hz,
            Self::Hz50 => Action::Rate50Hz,
            Self::Hz100 => Action::Rate100Hz,
        }
    }

    /// Whether a line carries status frames at this rate: 70 bits each at 8N1, 77 at 8N2 (ZK-11).
    pub const fn fits(self, line: Line) -> bool {
        self.hz() * STATUS_LEN as u32 * line.bits_per_byte() <= line.baud
    }
}

// ---------------------------------------------------------------------------------------------
// Control: host to ECU
// ---------------------------------------------------------------------------------------------

/// The switch SW of control IDs 1 and 6. Its numbers differ from the ones the ECU reports (ZK-8).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Switch {
    /// 0: in ID 1 the ECU's PWM input takes the engine over; in ID 6 no effect.
    Pwm,
    /// 1: stop without cooling, for emergencies.
    Stop,
    /// 2: standby with automatic cooling, the normal way to shut down.
    Standby,
    /// 3: run; from standby, start.
    Run,
}

impl Switch {
    const fn code(self) -> u8 {
        match self {
            Self::Pwm => 0,
            Self::Stop => 1,
            Self::Standby => 2,
            Self::Run => 3,
        }
    }

    const fn from_low_bits(bits: u8) -> Self {
        match bits & 3 {
            0 => Self::Pwm,
            1 => Self::Stop,
            2 => Self::Standby,
            _ => Self::Run,
        }
    }
}

/// The parameters of control ID 2.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Action {
    /// 1: drain ("drain oil"): the pump runs, fuel flows.
    Drain,
    /// 2: test the glow plug.
    TestGlowPlug,
    /// 3: test the main valve.
    TestMainValve,
    /// 4: test the ignition valve.
    TestIgnitionValve,
    /// 5: test the fuel pump.
    TestPump,
    /// 6: test the starter.
    TestStarter,
    /// 7: status rate 20 Hz.
    Rate20Hz,
    /// 8: status rate 50 Hz.
    Rate50Hz,
    /// 9: status rate 100 Hz.
    Rate100Hz,
    /// 10: reset the fuel statistics. From version 2.
    ResetFuel,
    /// 11: set the thrust sensor to zero. From version 2.
    ZeroThrust,
    /// 12: open the fuel pump for a long time. From version 5.
    OpenPump,
    /// 13: close the pump. From version 5.
    ClosePump,
}

impl Action {
    /// All of them, in the order of their parameter.
    pub const ALL: [Self; 13] = [
        Self::Drain,
        Self::TestGlowPlug,
        Self::TestMainValve,
        Self::TestIgnitionValve,
        Self::TestPump,
        Self::TestStarter,
        Self::Rate20Hz,
        Self::Rate50Hz,
        Self::Rate100Hz,
        Self::ResetFuel,
        Self::ZeroThrust,
        Self::OpenPump,
        Self::ClosePump,
    ];

    /// The parameter byte, 1..=13.
    pub const fn parameter(self) -> u8 {
        match self {
            Self::Drain => 1,
            Self::TestGlowPlug => 2,
            Self::TestMainValve => 3,
            Self::TestIgnitionValve => 4,
            Self::TestPump => 5,
            Self::TestStarter => 6,
            Self::Rate20Hz => 7,
            Self::Rate50Hz => 8,
            Self::Rate100Hz => 9,
            Self::ResetFuel => 10,
            Self::ZeroThrust => 11,
            Self::OpenPump => 12,
            Self::ClosePump => 13,
        }
    }

    /// The lowest protocol version that knows it (ZK-7).
    pub const fn min_version(self) -> Version {
        Version(match self {
            Self::ResetFuel | Self::ZeroThrust => 2,
            Self::OpenPump | Self::ClosePump => 5,
            _ => Version::FIRST.0,
        })
    }

    fn from_parameter(parameter: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|action| action.parameter() == parameter)
    }
}

/// Ignition pump voltage for control ID 4: 0 to 5.1 V in steps of 0.02 V.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct IgnitionPumpVoltage(u8);

impl IgnitionPumpVoltage {
    /// From mV, 0..=5100; rounded down to the step of 20 mV.
    ///
    /// # Errors
    /// [`OutOfRange`] above 5100 mV.
    pub const fn from_millivolts(voltage: Millivolts) -> Result<Self, OutOfRange> {
        match within(voltage.get(), 0, 5100) {
            Ok(()) => Ok(Self((voltage.get() / 20) as u8)),
            Err(error) => Err(error),
        }
    }

    /// The voltage.
    pub const fn millivolts(self) -> Millivolts {
        Millivolts::new(self.0 as u32 * 20)
    }
}

/// Acceleration curve for control ID 5, 10..=70: the larger, the faster the engine accelerates.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AccelerationCurve(u8);

impl AccelerationCurve {
    /// From the number of the document.
    ///
    /// # Errors
    /// [`OutOfRange`] outside 10..=70.
    pub const fn new(curve: u8) -> Result<Self, OutOfRange> {
        match within(curve as u32, 10, 70) {
            Ok(()) => Ok(Self(curve)),
            Err(error) => Err(error),
        }
    }

    /// The number of the document.
    pub const fn get(self) -> u8 {
        self.0
    }
}

/// RPM_X of control ID 6: 0 turns rpm control off, 1..=6 scale the rpm of ID 7.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RpmFactor(u8);

impl RpmFactor {
    /// 0: the throttle of ID 1 rules.
    pub const OFF: Self = Self(0);

    /// From the number of the document.
    ///
    /// # Errors
    /// [`OutOfRange`] above 6.
    pub const fn new(factor: u8) -> Result<Self, OutOfRange> {
        match within(factor as u32, 0, 6) {
            Ok(()) => Ok(Self(factor)),
            Err(error) => Err(error),
        }
    }

    /// The number of the document.
    pub const fn get(self) -> u8 {
        self.0
    }

    /// The largest rpm that it reaches: 40 950 for 1 up to 245 700 for 6.
    pub const fn range(self) -> Rpm {
        Rpm::new(RpmCode::MAX as u32 * 10 * self.0 as u32)
    }

    /// The smallest factor whose range covers `max`: it gives the finest step (ZK-9).
    /// 6 for an engine faster than every range.
    pub const fn covering(max: Rpm) -> Self {
        let mut factor = 1;
        while factor < 6 && Self(factor).range().get() < max.get() {
            factor += 1;
        }
        Self(factor)
    }
}

/// The twelve bits of control ID 7: target rpm divided by 10 × RPM_X.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RpmCode(u16);

impl RpmCode {
    /// The largest code.
    pub const MAX: u16 = 4095;

    /// From the number on the wire.
    ///
    /// # Errors
    /// [`OutOfRange`] above 4095.
    pub const fn new(code: u16) -> Result<Self, OutOfRange> {
        match within(code as u32, 0, Self::MAX as u32) {
            Ok(()) => Ok(Self(code)),
            Err(error) => Err(error),
        }
    }

    /// The code for a target, rounded down and never above the range: the engine is never asked for
    /// more than was demanded. 0 with a factor of 0.
    pub const fn for_target(target: Rpm, factor: RpmFactor) -> Self {
        if factor.0 == 0 {
            return Self(0);
        }
        let code = target.get() / (factor.0 as u32 * 10);
        Self(if code > Self::MAX as u32 { Self::MAX } else { code as u16 })
    }

    /// The target that it means with a factor.
    pub const fn target(self, factor: RpmFactor) -> Rpm {
        Rpm::new(self.0 as u32 * 10 * factor.0 as u32)
    }

    /// The number on the wire.
    pub const fn get(self) -> u16 {
        self.0
    }
}

/// A control frame, host to ECU (ZK-2).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Control {
    /// ID 0: commands nothing, keeps the conversation going.
    KeepAlive,
    /// ID 1: switch and throttle.
    Throttle {
        /// SW.
        switch: Switch,
        /// Throttle.
        throttle: Throttle,
    },
    /// ID 2: an action.
    Action(Action),
    /// ID 3: unlock; only the very next ID 4 or 5 is then obeyed (ZK-13).
    Unlock,
    /// ID 4: ignition pump voltage.
    IgnitionPump(IgnitionPumpVoltage),
    /// ID 5: acceleration curve.
    Curve(AccelerationCurve),
    /// ID 6: switch and rpm factor. From version 4; layout by ZK-3.
    Mode {
        /// RPM_X.
        factor: RpmFactor,
        /// SW.
        switch: Switch,
    },
    /// ID 7: target rpm. From version 4.
    Rpm(RpmCode),
    /// ID 8: atmospheric pressure (printed as a second "Cmd ID: 7", ZK-4). From version 4.
    Pressure(Hectopascals),
}

/// Why four bytes are no control frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ControlError {
    /// The first byte is not 0xFF.
    Head(u8),
    /// The CRC should have been `expected`.
    Crc {
        /// What the bytes give.
        expected: u8,
        /// What came.
        found: u8,
    },
    /// IDs 9 to 15 are not defined.
    Id(u8),
    /// A reserved bit is set (ZK-2).
    Reserved,
    /// The parameter is outside the document's range.
    Parameter(u16),
}

impl core::fmt::Display for ControlError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Head(byte) => write!(f, "a control frame starts with 0xFF, not {byte:#04x}"),
            Self::Crc { expected, found } => {
                write!(f, "CRC is {found:#04x}, the bytes give {expected:#04x}")
            }
            Self::Id(id) => write!(f, "control ID {id} is not defined"),
            Self::Reserved => f.write_str("a reserved bit is set"),
            Self::Parameter(value) => write!(f, "parameter {value} is outside its range"),
        }
    }
}

impl core::error::Error for ControlError {}

impl Control {
    /// The version that brought the modes 2 and 3: IDs 6 and 7 (ZK-7).
    pub const MODES_SINCE: Version = Version(4);

    /// The command ID, 0..=8.
    pub const fn id(self) -> u8 {
        match self {
            Self::KeepAlive => 0,
            Self::Throttle { .. } => 1,
            Self::Action(_) => 2,
            Self::Unlock => 3,
            Self::IgnitionPump(_) => 4,
            Self::Curve(_) => 5,
            Self::Mode { .. } => 6,
            Self::Rpm(_) => 7,
            Self::Pressure(_) => 8,
        }
    }

    /// The lowest protocol version that knows it (ZK-7).
    pub const fn min_version(self) -> Version {
        match self {
            Self::Action(action) => action.min_version(),
            Self::Mode { .. } | Self::Rpm(_) => Self::MODES_SINCE,
            Self::Pressure(_) => Version(4),
            _ => Version::FIRST,
        }
    }

    /// The bytes for the wire (ZK-2, ZK-3, ZK-4). Reserved bits are 0.
    pub const fn encode(self) -> [u8; CONTROL_LEN] {
        let (low_nibble, byte2) = match self {
            Self::KeepAlive | Self::Unlock => (0, 0),
            Self::Throttle { switch, throttle } => {
                let throttle = throttle.tenths();
                (switch.code() << 2 | (throttle >> 8) as u8, throttle as u8)
            }
            Self::Action(action) => (0, action.parameter()),
            Self::IgnitionPump(voltage) => (0, voltage.0),
            Self::Curve(curve) => (0, curve.0),
            // ZK-3: RPM_X in bits 4..2, SW in bits 1..0.
            Self::Mode { factor, switch } => (0, factor.0 << 2 | switch.code()),
            Self::Rpm(code) => ((code.0 >> 8) as u8, code.0 as u8),
            Self::Pressure(pressure) => ((pressure.get() >> 8) as u8, pressure.get() as u8),
        };
        let byte1 = self.id() << 4 | low_nibble;
        [CONTROL_HEAD, byte1, byte2, crc8(&[byte1, byte2])]
    }

    /// From the bytes of the wire: for whoever reads what a host sent.
    ///
    /// # Errors
    /// [`ControlError`], with what is wrong.
    pub fn decode(bytes: [u8; CONTROL_LEN]) -> Result<Self, ControlError> {
        let [head, byte1, byte2, found] = bytes;
        if head != CONTROL_HEAD {
            return Err(ControlError::Head(head));
        }
        let expected = crc8(&[byte1, byte2]);
        if found != expected {
            return Err(ControlError::Crc { expected, found });
        }
        let low_nibble = byte1 & 0x0F;
        let ten_bits = u16::from_be_bytes([low_nibble & 3, byte2]);
        let reserved = |bits: u8| if bits == 0 { Ok(()) } else { Err(ControlError::Reserved) };
        let parameter = |value: u16| move |_: OutOfRange| ControlError::Parameter(value);
        match byte1 >> 4 {
            0 => reserved(low_nibble | byte2).map(|()| Self::KeepAlive),
            1 => Ok(Self::Throttle {
                switch: Switch::from_low_bits(low_nibble >> 2),
                throttle: Throttle::from_tenths(ten_bits).map_err(parameter(ten_bits))?,
            }),
            2 => {
                reserved(low_nibble)?;
                Action::from_parameter(byte2).map(Self::Action).ok_or(ControlError::Parameter(byte2.into()))
            }
            3 => reserved(low_nibble | byte2).map(|()| Self::Unlock),
            4 => reserved(low_nibble).map(|()| Self::IgnitionPump(IgnitionPumpVoltage(byte2))),
            5 => {
                reserved(low_nibble)?;
                AccelerationCurve::new(byte2).map(Self::Curve).map_err(parameter(byte2.into()))
            }
            6 => {
                reserved(low_nibble | byte2 >> 5)?;
                let factor = byte2 >> 2;
                Ok(Self::Mode {
                    factor: RpmFactor::new(factor).map_err(parameter(factor.into()))?,
                    switch: Switch::from_low_bits(byte2),
                })
            }
            7 => Ok(Self::Rpm(RpmCode(u16::from_be_bytes([low_nibble, byte2])))),
            8 => {
                reserved(low_nibble >> 2)?;
                Hectopascals::new(ten_bits).map(Self::Pressure).map_err(parameter(ten_bits))
            }
            id => Err(ControlError::Id(id)),
        }
    }
}

// ---------------------------------------------------------------------------------------------
// Status: ECU to host
// ---------------------------------------------------------------------------------------------

open_enum! {
    /// Engine state of status ID 1, five bits.
    pub enum State {
        /// 0.
        Stop = 0 => "stop",
        /// 1: standby, automatic cooling.
        Standby = 1 => "standby",
        /// 2: ignition, demands minimum throttle.
        IgnitionMinThrottle = 2 => "ignition-min-throttle",
        /// 3.
        Ignition = 3 => "ignition",
        /// 4.
        Preheat = 4 => "preheat",
        /// 5.
        FuelRamp = 5 => "fuel-ramp",
        /// 6: running, learning, demands maximum throttle.
        LearningMax = 6 => "learning-max",
        /// 7: running, learning, demands minimum throttle.
        LearningMin = 7 => "learning-min",
        /// 8: running, learning idle.
        LearningIdle = 8 => "learning-idle",
        /// 9: running, minimum throttle.
        RunningMin = 9 => "running-min",
        /// 10: running, fuel pump at its limit.
        RunningPumpLimit = 10 => "running-pump-limit",
        /// 11.
        Running = 11 => "running",
        /// 12.
        Cooling = 12 => "cooling",
        /// 13.
        Restart = 13 => "restart",
        /// 14.
        TestGlowPlug = 14 => "test-glow-plug",
        /// 15.
        TestMainValve = 15 => "test-main-valve",
        /// 16.
        TestIgnitionValve = 16 => "test-ignition-valve",
        /// 17.
        TestPump = 17 => "test-pump",
        /// 18.
        TestStarter = 18 => "test-starter",
        /// 19: fuel exhaust air (the line is bled).
        FuelExhaustAir = 19 => "fuel-exhaust-air",
    }
}

open_enum! {
    /// Error code of status ID 1, five bits.
    pub enum ErrorCode {
        /// 0.
        None = 0 => "none",
        /// 1.
        Timeout = 1 => "timeout",
        /// 2.
        LowVoltage = 2 => "low-voltage",
        /// 3.
        GlowPlug = 3 => "glow-plug",
        /// 4.
        Pump = 4 => "pump",
        /// 5.
        Starter = 5 => "starter",
        /// 6.
        RpmLow = 6 => "rpm-low",
        /// 7.
        RpmUnstable = 7 => "rpm-unstable",
        /// 8.
        EgtHigh = 8 => "egt-high",
        /// 9.
        EgtLow = 9 => "egt-low",
        /// 10: failure of the exhaust temperature sensor.
        EgtSensor = 10 => "egt-sensor",
        /// 11.
        IgnitionValve = 11 => "ignition-valve",
        /// 12.
        MainValve = 12 => "main-valve",
        /// 13: loss of the control signal.
        SignalLost = 13 => "signal-lost",
        /// 14: starter controller too hot.
        StarterHot = 14 => "starter-hot",
        /// 15: pump controller too hot.
        PumpHot = 15 => "pump-hot",
        /// 16.
        Clutch = 16 => "clutch",
        /// 17.
        OverCurrent = 17 => "over-current",
        /// 18.
        EngineOffline = 18 => "engine-offline",
    }
}

open_enum! {
    /// Switch that the ECU reports, SwSt of status ID 1. Its numbers differ from the ones sent (ZK-8).
    pub enum SwitchStatus {
        /// 0.
        Stop = 0 => "stop",
        /// 1.
        Standby = 1 => "standby",
        /// 2: start or run.
        Run = 2 => "run",
    }
}

/// A voltage byte whose scale depends on the ECU's protocol version (ZK-6).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct VoltageByte(pub u8);

impl VoltageByte {
    /// The voltage: steps of 0.1 V up to version 3, of 0.2 V from version 4, `None` while the
    /// version is not known (ZK-6).
    pub const fn millivolts(self, version: Option<Version>) -> Option<Millivolts> {
        match version {
            None => None,
            Some(Version(..=3)) => Some(Millivolts::new(self.0 as u32 * 100)),
            Some(_) => Some(Millivolts::new(self.0 as u32 * 200)),
        }
    }
}

/// What a status frame says besides the rpm, which every one carries (ZK-5).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Status {
    /// ID 1.
    Engine {
        /// Engine state.
        state: State,
        /// Error.
        error: ErrorCode,
        /// Exhaust gas temperature.
        egt: Celsius,
        /// Switch that the ECU obeys.
        switch: SwitchStatus,
    },
    /// ID 2.
    Voltages {
        /// Control (radio) voltage.
        radio: VoltageByte,
        /// Power supply.
        power: VoltageByte,
        /// Fuel pump.
        pump: VoltageByte,
    },
    /// ID 3.
    Throttle {
        /// Throttle in whole percent, as sent; 101..=255 has no meaning printed.
        percent: u8,
        /// Pressure, in steps of 2 Pa.
        pressure: Pascals,
    },
    /// ID 4.
    Load {
        /// Current, in steps of 0.1 A.
        current: Milliamps,
        /// Thrust, in steps of 0.1 kg. From version 2.
        thrust: Grams,
    },
    /// ID 5.
    Settings {
        /// Ignition pump voltage, in steps of 0.02 V.
        ignition_pump: Millivolts,
        /// Acceleration curve.
        increase: u8,
        /// Deceleration curve.
        decrease: u8,
    },
    /// ID 6.
    Identity {
        /// The engine's maximum rpm, in steps of 1000.
        max_rpm: Rpm,
        /// Maximum pump voltage.
        max_pump: VoltageByte,
        /// Protocol version.
        version: Version,
        /// Status rate; `None` for code 3.
        rate: Option<Rate>,
    },
    /// ID 7, from version 2.
    Fuel {
        /// Flow, in steps of 0.01 L/min.
        flow: MillilitresPerMinute,
        /// Total used, in steps of 0.1 L.
        total: Millilitres,
    },
    /// ID 8, from version 3.
    Idle {
        /// The engine's idle rpm, in steps of 1000.
        idle_rpm: Rpm,
        /// ESR: the ECU asks for atmospheric pressure. From version 4.
        pressure_requested: bool,
        /// SCL: rpm closed loop. From version 4.
        closed_loop: bool,
        /// Start-up time, in steps of 0.1 s. From version 4.
        startup: Duration,
    },
    /// ID 9, from version 5.
    Temperature {
        /// Temperature of the ECU.
        ecu: Celsius,
    },
    /// Another ID with a good CRC: a frame, not noise (ZK-15). Its bytes are in the frame.
    Unknown,
}

impl Status {
    /// The version that brought the thrust of ID 4 (ZK-7).
    pub const THRUST_SINCE: Version = Version(2);
    /// The version that brought all of ID 8 but the idle rpm (ZK-7).
    pub const IDLE_REST_SINCE: Version = Version(4);
}

/// A status frame whose CRC is right.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StatusFrame([u8; STATUS_LEN]);

impl StatusFrame {
    /// From seven bytes, if they are a status frame: head 0xF0..=0xFE (0xFF is the control head,
    /// ZK-16) and a right CRC (ZK-1).
    pub fn new(bytes: [u8; STATUS_LEN]) -> Option<Self> {
        let [body @ .., crc] = &bytes;
        (is_status_head(bytes[0]) && crc8(body) == *crc).then_some(Self(bytes))
    }

    /// The bytes as they came.
    pub const fn raw(&self) -> &[u8; STATUS_LEN] {
        &self.0
    }

    /// The status ID, 0..=14.
    pub const fn id(&self) -> u8 {
        self.0[0] & 0x0F
    }

    /// Shaft speed, in steps of 10 rpm: in every status frame.
    pub const fn rpm(&self) -> Rpm {
        Rpm::new(u16::from_le_bytes([self.0[1], self.0[2]]) as u32 * 10)
    }

    /// The rest, by ID (ZK-5).
    pub const fn status(&self) -> Status {
        let [head, _, _, byte3, byte4, byte5, _] = self.0;
        match head & 0x0F {
            1 => Status::Engine {
                state: State::from_code(byte3 & 0x1F),
                error: ErrorCode::from_code((byte4 & 3) << 3 | byte3 >> 5),
                egt: offset_50(u16::from_be_bytes([byte4 >> 2 & 7, byte5])),
                switch: SwitchStatus::from_code(byte4 >> 5 & 3),
            },
            2 => Status::Voltages {
                radio: VoltageByte(byte3),
                power: VoltageByte(byte4),
                pump: VoltageByte(byte5),
            },
            3 => Status::Throttle {
                percent: byte3,
                pressure: Pascals::new(u16::from_le_bytes([byte4, byte5]) as u32 * 2),
            },
            4 => Status::Load {
                current: Milliamps::new(u16::from_be_bytes([byte4 & 1, byte3]) as u32 * 100),
                thrust: Grams::new(u16::from_be_bytes([byte4 >> 1, byte5]) as u32 * 100),
            },
            5 => Status::Settings {
                ignition_pump: Millivolts::new(byte3 as u32 * 20),
                increase: byte4,
                decrease: byte5,
            },
            6 => Status::Identity {
                max_rpm: Rpm::new(byte3 as u32 * 1000),
                max_pump: VoltageByte(byte4),
                version: Version(byte5 >> 2),
                rate: Rate::from_code(byte5 & 3),
            },
            7 => Status::Fuel {
                flow: MillilitresPerMinute::new(u16::from_be_bytes([byte4 & 3, byte3]) as u32 * 10),
                total: Millilitres::new(((byte5 as u32) << 6 | (byte4 >> 2) as u32) * 100),
            },
            8 => Status::Idle {
                idle_rpm: Rpm::new(byte3 as u32 * 1000),
                pressure_requested: byte4 & 0x20 != 0,
                closed_loop: byte4 & 0x10 != 0,
                startup: Duration::from_millis(u16::from_be_bytes([byte4 & 0x0F, byte5]) as u64 * 100),
            },
            9 => Status::Temperature { ecu: offset_50(byte3 as u16) },
            _ => Status::Unknown,
        }
    }
}

const fn offset_50(value: u16) -> Celsius {
    // At most eleven bits come in, so nothing overflows.
    Celsius::from_tenths((value as i16 - 50) * 10)
}

const fn is_status_head(byte: u8) -> bool {
    byte >= 0xF0 && byte != CONTROL_HEAD
}

// ---------------------------------------------------------------------------------------------
// Decoder
// ---------------------------------------------------------------------------------------------

/// What a decoder has seen. All counts wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DecoderCounters {
    /// Frames, the unknown ones included.
    pub frames: u32,
    /// Frames with an ID the document does not name (ZK-15).
    pub unknown_frames: u32,
    /// Heads whose seven bytes had a wrong CRC.
    pub crc_failures: u32,
    /// Bytes that belonged to no frame.
    pub bytes_skipped: u32,
}

/// Finds status frames in a stream of bytes, in chunks of any size (ZK-16).
///
/// A window of seven bytes slides over the stream. After a CRC failure the search goes on at the next
/// byte of the same window, so a frame behind a false head is not lost.
#[derive(Clone, Copy, Debug, Default)]
pub struct Decoder {
    window: [u8; STATUS_LEN],
    len: usize,
    counters: DecoderCounters,
}

impl Decoder {
    /// An empty one.
    pub const fn new() -> Self {
        Self {
            window: [0; STATUS_LEN],
            len: 0,
            counters: DecoderCounters { frames: 0, unknown_frames: 0, crc_failures: 0, bytes_skipped: 0 },
        }
    }

    /// Takes bytes up to the end of the first frame. Gives how many it took, and the frame.
    /// Call again with the rest while any is left.
    pub fn feed(&mut self, bytes: &[u8]) -> (usize, Option<StatusFrame>) {
        feed(bytes, |byte| self.push(byte))
    }

    /// What it has seen.
    pub const fn counters(&self) -> DecoderCounters {
        self.counters
    }

    /// Bytes held that may yet become a frame.
    pub const fn pending(&self) -> usize {
        self.len
    }

    fn push(&mut self, byte: u8) -> Option<StatusFrame> {
        if self.len == 0 && !is_status_head(byte) {
            self.counters.bytes_skipped = self.counters.bytes_skipped.wrapping_add(1);
            return None;
        }
        if let Some(slot) = self.window.get_mut(self.len) {
            *slot = byte;
            self.len += 1;
        }
        if self.len < STATUS_LEN {
            return None;
        }
        if let Some(frame) = StatusFrame::new(self.window) {
            self.len = 0;
            self.counters.frames = self.counters.frames.wrapping_add(1);
            if !STATUS_IDS.contains(&frame.id()) {
                self.counters.unknown_frames = self.counters.unknown_frames.wrapping_add(1);
            }
            return Some(frame);
        }
        self.counters.crc_failures = self.counters.crc_failures.wrapping_add(1);
        let next_head = (1..STATUS_LEN)
            .find(|&i| self.window.get(i).is_some_and(|&byte| is_status_head(byte)))
            .unwrap_or(STATUS_LEN);
        self.window.copy_within(next_head.., 0);
        self.len = STATUS_LEN - next_head;
        self.counters.bytes_skipped = self.counters.bytes_skipped.wrapping_add(next_head as u32);
        None
    }
}
