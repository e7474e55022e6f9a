//! Frames built independently from the protocol documents, not with the library's codecs: the same mistake
//! must not be on both sides of a test.

/// The CRC of the ZK document's "non-table look-up method", word for word. Its seed is 0 (ZK-1).
pub fn printed_crc8(message: &[u8]) -> u8 {
    let mut crc8 = 0u8;
    for &byte in message {
        let k = byte ^ crc8;
        crc8 = 0;
        if k & 0x01 != 0 {
            crc8 ^= 0x5e;
        }
        if k & 0x02 != 0 {
            crc8 ^= 0xbc;
        }
        if k & 0x04 != 0 {
            crc8 ^= 0x61;
        }
        if k & 0x08 != 0 {
            crc8 ^= 0xc2;
        }
        if k & 0x10 != 0 {
            crc8 ^= 0x9d;
        }
        if k & 0x20 != 0 {
            crc8 ^= 0x23;
        }
        if k & 0x40 != 0 {
            crc8 ^= 0x46;
        }
        if k & 0x80 != 0 {
            crc8 ^= 0x8c;
        }
    }
    crc8
}

/// Status frames of a ZK ECU.
pub mod zk {
    use super::printed_crc8;

    /// Head, rpm / 10 with its low byte first, three bytes, CRC over all of that.
    pub fn status(id: u8, rpm: u32, rest: [u8; 3]) -> [u8; 7] {
        let rpm = u16::try_from(rpm / 10).expect("rpm fits").to_le_bytes();
        let body = [0xF0 | id, rpm[0], rpm[1], rest[0], rest[1], rest[2]];
        let mut frame = [0; 7];
        frame[..6].copy_from_slice(&body);
        frame[6] = printed_crc8(&body);
        frame
    }

    /// ID 1 with a state, no error, 26 °C, and the switch that goes with the state.
    pub fn state(state: u8) -> [u8; 7] {
        let switch = match state {
            0 => 0,
            1 | 12 => 1,
            _ => 2,
        };
        status(1, 0, [state, switch << 5, 76])
    }

    /// ID 5.
    pub fn settings(ignition_pump: u8, increase: u8) -> [u8; 7] {
        status(5, 0, [ignition_pump, increase, 30])
    }

    /// ID 6: maximum rpm / 1000, protocol version, rate code (0, 1, 2: 20, 50, 100 Hz).
    pub fn identity(max_rpm_thousands: u8, version: u8, rate_code: u8) -> [u8; 7] {
        status(6, 0, [max_rpm_thousands, 0, version << 2 | rate_code])
    }

    /// ID 8: idle rpm / 1000, and whether it requests pressure.
    pub fn idle(idle_rpm_thousands: u8, asks_for_pressure: bool) -> [u8; 7] {
        status(8, 0, [idle_rpm_thousands, if asks_for_pressure { 0x20 } else { 0 }, 0])
    }

    /// A control frame from its two middle bytes.
    pub fn control(byte1: u8, byte2: u8) -> [u8; 4] {
        [0xFF, byte1, byte2, printed_crc8(&[byte1, byte2])]
    }

    /// ID 0.
    pub fn keep_alive() -> [u8; 4] {
        control(0x00, 0)
    }

    /// ID 1: SW and throttle in 0.1 %.
    pub fn throttle_tenths(sw: u8, tenths: u16) -> [u8; 4] {
        let [high, low] = tenths.to_be_bytes();
        control(0x10 | sw << 2 | high, low)
    }

    /// ID 2.
    pub fn action(parameter: u8) -> [u8; 4] {
        control(0x20, parameter)
    }

    /// ID 3.
    pub fn unlock() -> [u8; 4] {
        control(0x30, 0)
    }

    /// ID 4.
    pub fn ignition_pump(steps: u8) -> [u8; 4] {
        control(0x40, steps)
    }

    /// ID 5.
    pub fn curve(curve: u8) -> [u8; 4] {
        control(0x50, curve)
    }

    /// ID 6.
    pub fn mode(rpm_x: u8, sw: u8) -> [u8; 4] {
        control(0x60, rpm_x << 2 | sw)
    }

    /// ID 7.
    pub fn rpm(code: u16) -> [u8; 4] {
        let [high, low] = code.to_be_bytes();
        control(0x70 | high, low)
    }

    /// ID 8.
    pub fn pressure(hectopascals: u16) -> [u8; 4] {
        let [high, low] = hectopascals.to_be_bytes();
        control(0x80 | high, low)
    }
}

/// Frames of an AMT ECU.
pub mod amt {
    /// Data1 bits 2..0.
    pub const EMERGENCY: u8 = 0b001;
    /// Data1 bits 2..0.
    pub const AUTO_STOP: u8 = 0b010;
    /// Data1 bits 2..0.
    pub const RUN: u8 = 0b100;

    /// Data1 bits 7..3.
    pub const NO_CLEARANCE: u8 = 0b00000;
    /// Data1 bits 7..3.
    pub const CLEARANCE: u8 = 0b00001;
    /// Data1 bits 7..3.
    pub const STARTING: u8 = 0b00010;
    /// Data1 bits 7..3.
    pub const STARTED_UP: u8 = 0b00100;
    /// Data1 bits 7..3.
    pub const IDLE_CALIBRATION: u8 = 0b01000;
    /// Data1 bits 7..3.
    pub const FULL_OPERATION: u8 = 0b01100;

    /// A normal set: state and switch, then rpm, EGT, throttle, Vout.
    pub fn normal(state: u8, switch: u8, rpm: u8) -> [u8; 6] {
        [0xFF, state << 3 | switch, rpm, 20, 0, 0]
    }

    /// An error set.
    pub fn error(bits: u8) -> [u8; 6] {
        [0xFF, 0x00, bits, 20, 0, 0]
    }

    /// An alternate set.
    pub fn alternate(engine_id: u8) -> [u8; 6] {
        [0xFF, engine_id, 51, 102, 204, 153]
    }

    /// A set-up set with its text of 12 or 13 bytes.
    pub fn setup(text: &str) -> Vec<u8> {
        let mut frame = vec![0xFF, 0x05, 0xF8, 0x00, 0x40];
        frame.extend_from_slice(text.as_bytes());
        frame
    }

    /// A control message: 0xFF OPS THR OPS THR with THR = 2 × % + 32, for half percents.
    pub fn control(ops: u8, half_percents: u8) -> [u8; 5] {
        let thr = half_percents + 32;
        [0xFF, ops, thr, ops, thr]
    }
}
