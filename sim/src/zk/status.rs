//! The reports of a ZK ECU: the nine status frames of 7 bytes (ZK-5) and the numbers in them.

use super::command::crc8;

/// Engine status codes of the document's appendix.
pub mod state {
    /// Stop.
    pub const STOP: u8 = 0;
    /// Standby, or cooling by itself.
    pub const STANDBY: u8 = 1;
    /// Ignition, waiting for minimum throttle.
    pub const IGNITION_WAITS: u8 = 2;
    /// Ignition.
    pub const IGNITION: u8 = 3;
    /// Preheat.
    pub const PREHEAT: u8 = 4;
    /// Fuel ramp.
    pub const FUEL_RAMP: u8 = 5;
    /// Running, learning idle.
    pub const LEARNING_IDLE: u8 = 8;
    /// Running at minimum throttle.
    pub const MINIMUM: u8 = 9;
    /// Running, the pump at its limit.
    pub const PUMP_LIMIT: u8 = 10;
    /// Running.
    pub const RUNNING: u8 = 11;
    /// Cooling.
    pub const COOLING: u8 = 12;
    /// Restart.
    pub const RESTART: u8 = 13;
    /// Glow plug test.
    pub const TEST_GLOW_PLUG: u8 = 14;
    /// Main valve test.
    pub const TEST_MAIN_VALVE: u8 = 15;
    /// Ignition valve test.
    pub const TEST_IGNITION_VALVE: u8 = 16;
    /// Pump test.
    pub const TEST_PUMP: u8 = 17;
    /// Starter test.
    pub const TEST_STARTER: u8 = 18;
    /// The fuel line is being bled.
    pub const EXHAUST_AIR: u8 = 19;
}

/// Engine error codes of the document's appendix, as far as this ECU detects them itself.
pub mod error {
    /// Time out.
    pub const TIME_OUT: u8 = 1;
    /// Rpm low.
    pub const RPM_LOW: u8 = 6;
    /// Exhaust temperature is high.
    pub const EGT_HIGH: u8 = 8;
    /// Exhaust temperature is low.
    pub const EGT_LOW: u8 = 9;
    /// Loss of control signal.
    pub const CONTROL_LOST: u8 = 13;
}

/// The highest status ID (ZK-7).
pub const LAST_ID: u8 = 9;

/// The first protocol version that sends this status ID (ZK-7).
pub const fn since_version(id: u8) -> u8 {
    match id {
        ..=6 => 1,
        7 => 2,
        8 => 3,
        9 => 5,
        _ => 6,
    }
}

/// All reported values, in physical units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Values {
    pub(super) version: u8,
    pub(super) rpm: f64,
    pub(super) state: u8,
    pub(super) error: u8,
    pub(super) egt: f64,
    pub(super) switch: u8,
    pub(super) radio_v: f64,
    pub(super) supply_v: f64,
    pub(super) pump_v: f64,
    pub(super) throttle_percent: f64,
    pub(super) pressure_pa: f64,
    pub(super) current_a: f64,
    pub(super) thrust_kg: f64,
    pub(super) ignition_voltage: u8,
    pub(super) curve_up: u8,
    pub(super) curve_down: u8,
    pub(super) max_rpm: f64,
    pub(super) max_pump_v: f64,
    pub(super) rate: u8,
    pub(super) flow_l_min: f64,
    pub(super) total_l: f64,
    pub(super) idle_rpm: f64,
    pub(super) wants_pressure: bool,
    pub(super) closed_loop: bool,
    pub(super) start_time_s: f64,
    pub(super) ecu_temperature: f64,
}

/// A value in this number of bits, clamped to the largest that fits.
fn bits(value: f64, bits: u32) -> u16 {
    let most = (1_u32 << bits) - 1;
    value.round().clamp(0.0, f64::from(most)) as u16
}

fn low(value: u16) -> u8 {
    value.to_le_bytes()[0]
}

fn high(value: u16) -> u8 {
    value.to_le_bytes()[1]
}

impl Values {
    /// Volts in a byte: 0.1 V up to version 3, 0.2 V from version 4 (ZK-6).
    fn volts(&self, volts: f64) -> u8 {
        let unit = if self.version <= 3 { 0.1 } else { 0.2 };
        low(bits(volts / unit, 8))
    }

    /// The status frame with this ID.
    pub(super) fn frame(&self, id: u8) -> [u8; 7] {
        let data = match id {
            1 => {
                let egt = bits(self.egt + 50.0, 11);
                [
                    self.state & 0x1F | (self.error & 7) << 5,
                    (self.error >> 3) & 3 | high(egt) << 2 | (self.switch & 3) << 5,
                    low(egt),
                ]
            }
            2 => [self.volts(self.radio_v), self.volts(self.supply_v), self.volts(self.pump_v)],
            3 => {
                let pressure = bits(self.pressure_pa / 2.0, 16);
                [low(bits(self.throttle_percent, 8)), low(pressure), high(pressure)]
            }
            4 => {
                let current = bits(self.current_a / 0.1, 9);
                let thrust = if self.version < 2 { 0 } else { bits(self.thrust_kg / 0.1, 15) };
                [low(current), high(current) | high(thrust) << 1, low(thrust)]
            }
            5 => [self.ignition_voltage, self.curve_up, self.curve_down],
            6 => [
                low(bits(self.max_rpm / 1000.0, 8)),
                self.volts(self.max_pump_v),
                (self.version & 0x3F) << 2 | self.rate & 3,
            ],
            7 => {
                let flow = bits(self.flow_l_min / 0.01, 10);
                let total = bits(self.total_l / 0.1, 14);
                [low(flow), high(flow) | low(total << 2), low(total >> 6)]
            }
            8 => {
                let idle = low(bits(self.idle_rpm / 1000.0, 8));
                if self.version < 4 {
                    [idle, 0, 0]
                } else {
                    let start = bits(self.start_time_s / 0.1, 12);
                    let flags = u8::from(self.wants_pressure) << 5 | u8::from(self.closed_loop) << 4;
                    [idle, flags | high(start), low(start)]
                }
            }
            // ZK-15: from version 6 with the shaft speed again.
            9 if self.version >= 6 => {
                let rpm = bits(self.rpm / 10.0, 16);
                [low(bits(self.ecu_temperature + 50.0, 8)), low(rpm), high(rpm)]
            }
            9 => [low(bits(self.ecu_temperature + 50.0, 8)), 0, 0],
            _ => [0; 3],
        };
        let rpm = bits(self.rpm / 10.0, 16);
        seal(0xF0 | id & 15, [low(rpm), high(rpm), data[0], data[1], data[2]])
    }
}

/// Head, data and CRC.
pub(super) fn seal(head: u8, data: [u8; 5]) -> [u8; 7] {
    let [a, b, c, d, e] = data;
    [head, a, b, c, d, e, crc8(&[head, a, b, c, d, e])]
}

#[cfg(test)]
mod tests {
    use super::*;

    const REST: Values = Values {
        version: 4,
        rpm: 0.0,
        state: 0,
        error: 0,
        egt: 26.0,
        switch: 0,
        radio_v: 0.0,
        supply_v: 0.0,
        pump_v: 0.0,
        throttle_percent: 0.0,
        pressure_pa: 0.0,
        current_a: 0.0,
        thrust_kg: 0.0,
        ignition_voltage: 0,
        curve_up: 0,
        curve_down: 0,
        max_rpm: 160_000.0,
        max_pump_v: 0.0,
        rate: 0,
        flow_l_min: 0.0,
        total_l: 0.0,
        idle_rpm: 0.0,
        wants_pressure: false,
        closed_loop: false,
        start_time_s: 0.0,
        ecu_temperature: 0.0,
    };

    #[test]
    fn status_frames_are_those_of_the_documents_two_examples() {
        assert_eq!(REST.frame(1), [0xF1, 0x00, 0x00, 0x00, 0x00, 0x4C, 0xA0]);
        assert_eq!(REST.frame(6), [0xF6, 0x00, 0x00, 0xA0, 0x00, 0x10, 0xAB]);
    }

    /// The five bytes between the ID and the CRC.
    fn data(values: Values, id: u8) -> [u8; 5] {
        let frame = values.frame(id);
        assert_eq!(frame[0], 0xF0 | id);
        frame[1..6].try_into().unwrap()
    }

    #[test]
    fn each_status_is_written_as_documented() {
        // rpm / 10 = 12345 = 0x3039; state 11; error 13 = 0b01_101; 700 + 50 = 0x2EE; switch 2
        let v = Values { rpm: 123_450.0, state: 11, error: 13, egt: 700.0, switch: 2, ..REST };
        assert_eq!(data(v, 1), [0x39, 0x30, 0b1010_1011, 0b0100_1001, 0xEE]);

        let v = Values { radio_v: 5.0, supply_v: 11.2, pump_v: 3.2, ..REST };
        assert_eq!(data(v, 2)[2..], [25, 56, 16]); // 0.2 V
        assert_eq!(data(Values { version: 3, ..v }, 2)[2..], [50, 112, 32]); // 0.1 V

        // 101 324 Pa / 2 = 50 662 = 0xC5E6
        let v = Values { throttle_percent: 75.0, pressure_pa: 101_324.0, ..REST };
        assert_eq!(data(v, 3)[2..], [75, 0xE6, 0xC5]);

        // 40.0 A = 400 = 0x190; 80.0 kg = 800 = 0x320
        let v = Values { current_a: 40.0, thrust_kg: 80.0, ..REST };
        assert_eq!(data(v, 4)[2..], [0x90, 0b0000_0111, 0x20]);
        assert_eq!(data(Values { version: 1, ..v }, 4)[2..], [0x90, 1, 0]);

        let v = Values { ignition_voltage: 75, curve_up: 30, curve_down: 25, ..REST };
        assert_eq!(data(v, 5)[2..], [75, 30, 25]);

        let v = Values { version: 5, max_pump_v: 4.8, rate: 2, ..REST };
        assert_eq!(data(v, 6)[2..], [160, 24, 0b0001_0110]);

        // 3.00 L/min = 300 = 0x12C; 123.4 L = 1234 = 0b0001_0011_010010
        let v = Values { flow_l_min: 3.0, total_l: 123.4, ..REST };
        assert_eq!(data(v, 7)[2..], [0x2C, 0b0100_1001, 0b0001_0011]);

        // 31.5 s = 315 = 0x13B
        let v = Values {
            idle_rpm: 50_000.0,
            wants_pressure: true,
            closed_loop: true,
            start_time_s: 31.5,
            ..REST
        };
        assert_eq!(data(v, 8)[2..], [50, 0b0011_0001, 0x3B]);
        assert_eq!(data(Values { version: 3, ..v }, 8)[2..], [50, 0, 0]);

        assert_eq!(data(Values { ecu_temperature: 35.0, ..REST }, 9)[2..], [85, 0, 0]);
    }

    #[test]
    fn what_does_not_fit_is_cut() {
        let huge = Values {
            rpm: 1e9,
            egt: 1e9,
            current_a: 1e9,
            thrust_kg: 1e9,
            total_l: 1e9,
            flow_l_min: 1e9,
            ..REST
        };
        assert_eq!(data(huge, 1), [0xFF, 0xFF, 0, 0b0001_1100, 0xFF]);
        assert_eq!(data(huge, 4)[2..], [0xFF, 0xFF, 0xFF]);
        assert_eq!(data(huge, 7)[2..], [0xFF, 0xFF, 0xFF]);
        assert_eq!(data(Values { egt: -80.0, ..REST }, 1)[2..], [0, 0, 0]);
    }
}
