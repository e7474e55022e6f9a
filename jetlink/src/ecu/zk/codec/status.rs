//! Status frames, ECU to host (ZK-5).

use super::frame::{STATUS_LEN, crc8, is_status_head};
use super::rate::Rate;
use super::version::{Since, Version};
use crate::codes::open_enum;
use crate::ecu::vendor::VendorFaults;
use crate::units::{Celsius, Grams, Milliamps, Millilitres, MillilitresPerMinute, Millivolts, Pascals, Rpm};
use embassy_time::Duration;

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

impl VendorFaults for ErrorCode {
    fn number(self) -> u8 {
        self.code()
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
            Some(version) if version.get() < Version::V4.get() => Some(Millivolts::new(self.0 as u32 * 100)),
            Some(_) => Some(Millivolts::new(self.0 as u32 * 200)),
        }
    }
}

/// Content of a status frame besides the rpm, which every one carries (ZK-5).
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
        /// Throttle in whole percent, as sent; the document prints no meaning for 101..=255.
        percent: u8,
        /// Pressure, in steps of 2 Pa.
        pressure: Pascals,
    },
    /// ID 4.
    Load {
        /// Current, in steps of 0.1 A.
        current: Milliamps,
        /// Thrust, in steps of 0.1 kg. From version 2.
        thrust: Since<Grams>,
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
        /// The rest. From version 4.
        details: Since<IdleDetails>,
    },
    /// ID 9, from version 5.
    Temperature {
        /// Temperature of the ECU.
        ecu: Celsius,
    },
    /// Another ID with a good CRC: a frame, not noise (ZK-15). Its bytes are in the frame.
    Unknown,
}

/// All of ID 8 but the idle rpm.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct IdleDetails {
    /// ESR: the ECU requests the atmospheric pressure.
    pub pressure_requested: bool,
    /// SCL: rpm closed loop.
    pub closed_loop: bool,
    /// Start-up time, in steps of 0.1 s.
    pub startup: Duration,
}

/// A status frame with the right CRC.
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

    /// The bytes as received.
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
                thrust: Since::new(
                    Version::V2,
                    Grams::new(u16::from_be_bytes([byte4 >> 1, byte5]) as u32 * 100),
                ),
            },
            5 => Status::Settings {
                ignition_pump: Millivolts::new(byte3 as u32 * 20),
                increase: byte4,
                decrease: byte5,
            },
            6 => Status::Identity {
                max_rpm: Rpm::new(byte3 as u32 * 1000),
                max_pump: VoltageByte(byte4),
                version: Version::from_bits(byte5 >> 2),
                rate: Rate::from_code(byte5 & 3),
            },
            7 => Status::Fuel {
                flow: MillilitresPerMinute::new(u16::from_be_bytes([byte4 & 3, byte3]) as u32 * 10),
                total: Millilitres::new(((byte5 as u32) << 6 | (byte4 >> 2) as u32) * 100),
            },
            8 => Status::Idle {
                idle_rpm: Rpm::new(byte3 as u32 * 1000),
                details: Since::new(
                    Version::V4,
                    IdleDetails {
                        pressure_requested: byte4 & 0x20 != 0,
                        closed_loop: byte4 & 0x10 != 0,
                        startup: Duration::from_millis(
                            u16::from_be_bytes([byte4 & 0x0F, byte5]) as u64 * 100,
                        ),
                    },
                ),
            },
            9 => Status::Temperature { ecu: offset_50(byte3 as u16) },
            _ => Status::Unknown,
        }
    }
}

const fn offset_50(value: u16) -> Celsius {
    // The input has at most eleven bits, so nothing overflows.
    Celsius::from_tenths((value as i16 - 50) * 10)
}
