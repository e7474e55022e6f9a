//! Control frames, host to ECU (ZK-2 to ZK-4).

use super::frame::{CONTROL_HEAD, CONTROL_LEN, crc8};
use super::version::Version;
use crate::codes::closed_enum;
use crate::sentence::sentences;
use crate::units::{Hectopascals, Millivolts, OutOfRange, Rpm, Throttle, ranged, within};

closed_enum! {
    /// The switch SW of control IDs 1 and 6. Its numbers differ from the ones the ECU reports (ZK-8).
    pub enum Switch {
        /// 0: in ID 1 the ECU's PWM input takes the engine over; in ID 6 no effect.
        Pwm = 0,
        /// 1: stop without cooling, for emergencies.
        Stop = 1,
        /// 2: standby with automatic cooling, the normal way to shut down.
        Standby = 2,
        /// 3: run; from standby, start.
        Run = 3,
    }
}

closed_enum! {
    /// The parameters of control ID 2.
    #[non_exhaustive]
    pub enum Action {
        /// 1: drain ("drain oil"): the pump runs, fuel flows.
        Drain = 1,
        /// 2: test the glow plug.
        TestGlowPlug = 2,
        /// 3: test the main valve.
        TestMainValve = 3,
        /// 4: test the ignition valve.
        TestIgnitionValve = 4,
        /// 5: test the fuel pump.
        TestPump = 5,
        /// 6: test the starter.
        TestStarter = 6,
        /// 7: status rate 20 Hz.
        Rate20Hz = 7,
        /// 8: status rate 50 Hz.
        Rate50Hz = 8,
        /// 9: status rate 100 Hz.
        Rate100Hz = 9,
        /// 10: reset the fuel statistics. From version 2.
        ResetFuel = 10,
        /// 11: set the thrust sensor to zero. From version 2.
        ZeroThrust = 11,
        /// 12: open the fuel pump for a long time. From version 5.
        OpenPump = 12,
        /// 13: close the pump. From version 5.
        ClosePump = 13,
    }
}

impl Action {
    /// The lowest protocol version that supports it (ZK-7).
    pub const fn min_version(self) -> Version {
        match self {
            Self::ResetFuel | Self::ZeroThrust => Version::V2,
            Self::OpenPump | Self::ClosePump => Version::V5,
            _ => Version::FIRST,
        }
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

ranged!(
    /// Acceleration curve for control ID 5: the larger, the faster the engine accelerates.
    AccelerationCurve(u8), new, get, "the document", 10..=70
);

ranged!(
    /// RPM_X of control ID 6: 0 turns rpm control off, 1 to 6 scale the rpm of ID 7.
    RpmFactor(u8), new, get, "the document", 0..=6
);

impl RpmFactor {
    /// 0: the throttle of ID 1 is in control.
    pub const OFF: Self = Self(0);

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

ranged!(
    /// The twelve bits of control ID 7: target rpm divided by 10 × RPM_X.
    RpmCode(u16), new, get, "the wire", 0..=4095
);

impl RpmCode {
    /// The largest code.
    pub const MAX: u16 = 4095;

    /// The code for a target, rounded down and never above the range: the target on the wire is never
    /// above the demand. 0 with a factor of 0.
    pub const fn for_target(target: Rpm, factor: RpmFactor) -> Self {
        if factor.0 == 0 {
            return Self(0);
        }
        let code = target.get() / (factor.0 as u32 * 10);
        Self(if code > Self::MAX as u32 { Self::MAX } else { code as u16 })
    }

    /// The target for this code with a factor.
    pub const fn target(self, factor: RpmFactor) -> Rpm {
        Rpm::new(self.0 as u32 * 10 * factor.0 as u32)
    }
}

/// A control frame, host to ECU (ZK-2).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Control {
    /// ID 0: commands nothing, keeps the connection alive.
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

/// Reason why four bytes are not a control frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum ControlError {
    /// The first byte is not 0xFF.
    Head(u8),
    /// The CRC should have been `expected`.
    Crc {
        /// Calculated CRC.
        expected: u8,
        /// Received CRC.
        found: u8,
    },
    /// IDs 9 to 15 are not defined.
    Id(u8),
    /// A reserved bit is set (ZK-2).
    Reserved,
    /// The parameter is outside the document's range.
    Parameter(u16),
}

sentences!(ControlError {
    Self::Reserved => "a reserved bit is set";
} {
    Self::Head(byte) => "a control frame starts with 0xFF, not {:#04x}", byte;
    Self::Crc { expected, found } => "CRC is {:#04x}, the bytes give {:#04x}", found, expected;
    Self::Id(id) => "control ID {} is not defined", id;
    Self::Parameter(value) => "parameter {} is outside its range", value;
});

impl core::error::Error for ControlError {}

impl Control {
    /// The version that introduced modes 2 and 3: IDs 6 and 7 (ZK-7).
    pub const MODES_SINCE: Version = Version::V4;

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

    /// The lowest protocol version that supports it (ZK-7).
    pub const fn min_version(self) -> Version {
        match self {
            Self::Action(action) => action.min_version(),
            Self::Mode { .. } | Self::Rpm(_) => Self::MODES_SINCE,
            Self::Pressure(_) => Version::V4,
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
            Self::Action(action) => (0, action.code()),
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

    /// From the bytes on the wire, for programs that read a host's commands.
    ///
    /// # Errors
    /// [`ControlError`] with the reason.
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
                switch: switch(low_nibble >> 2),
                throttle: Throttle::from_tenths(ten_bits).map_err(parameter(ten_bits))?,
            }),
            2 => {
                reserved(low_nibble)?;
                Action::from_code(byte2).map(Self::Action).ok_or(ControlError::Parameter(byte2.into()))
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
                    switch: switch(byte2),
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

/// SW, in the two lowest bits.
fn switch(bits: u8) -> Switch {
    match bits & 3 {
        0 => Switch::Pwm,
        1 => Switch::Stop,
        2 => Switch::Standby,
        _ => Switch::Run,
    }
}
