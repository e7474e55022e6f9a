//! Ids and the rate of the telemetry port over a reset in flight: those in force before it stay, whatever was set since, as the autopilot still has
//! them.

use crate::settings::Identity;
use jetlink::units::BaudRate;

impl Identity {
    /// All of it in one number, for RAM that survives a reset.
    pub const fn packed(&self) -> u32 {
        // Ports are 0 to 8, and there are 7 rates: each has half a byte.
        let last = self.autopilot_port & 0xF | self.telemetry_baud.place() << 4;
        u32::from_le_bytes([self.system, self.learnt, self.base, last])
    }

    /// From such a number; `None`: it is invalid.
    pub fn unpacked(number: u32) -> Option<Self> {
        let [system, learnt, base, last] = number.to_le_bytes();
        let telemetry_baud = BaudRate::at(last >> 4)?;
        let identity = Self { system, learnt, base, autopilot_port: last & 0xF, telemetry_baud };
        identity.check_own().is_ok().then_some(identity)
    }

    /// What is in force from a start on: what is stored; in flight what was in force before the reset, if RAM has it.
    pub fn at_start(stored: Self, retained: Option<u32>, in_flight: bool) -> Self {
        retained.filter(|_| in_flight).and_then(Self::unpacked).unwrap_or(stored)
    }
}
