//! Fields of the messages that are obeyed: the place of each one in a payload. One reader serves all messages; generated
//! parsers would take several kilobytes. A test compares it with them.

/// Largest payload.
const MAX_PAYLOAD: usize = 255;

/// A payload, padded with zeros: those at its end are not sent.
#[derive(Clone, PartialEq, Eq)]
pub(crate) struct Fields([u8; MAX_PAYLOAD]);

impl Fields {
    /// Bytes beyond the largest payload are cut.
    pub fn new(payload: &[u8]) -> Self {
        let mut bytes = [0; MAX_PAYLOAD];
        bytes.iter_mut().zip(payload).for_each(|(to, byte)| *to = *byte);
        Self(bytes)
    }

    /// The bytes from offset `at` on; zeros beyond the end.
    #[inline(never)]
    pub fn bytes<const N: usize>(&self, at: usize) -> [u8; N] {
        self.0.get(at..).and_then(<[u8]>::first_chunk).copied().unwrap_or([0; N])
    }

    pub fn u8(&self, at: usize) -> u8 {
        self.0.get(at).copied().unwrap_or(0)
    }

    pub fn u16(&self, at: usize) -> u16 {
        u16::from_le_bytes(self.bytes(at))
    }

    pub fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.bytes(at))
    }

    pub fn f32(&self, at: usize) -> f32 {
        f32::from_le_bytes(self.bytes(at))
    }

    /// All of the payload.
    #[cfg(test)]
    pub fn all(&self) -> &[u8] {
        &self.0
    }
}

/// `HEARTBEAT`.
pub(crate) mod heartbeat {
    pub const TYPE: usize = 4;
    pub const AUTOPILOT: usize = 5;
    pub const BASE_MODE: usize = 6;
}

/// `PARAM_REQUEST_READ`.
pub(crate) mod param_request_read {
    pub const INDEX: usize = 0;
    pub const TARGET: usize = 2;
    pub const NAME: usize = 4;
}

/// `PARAM_REQUEST_LIST`.
pub(crate) mod param_request_list {
    pub const TARGET: usize = 0;
}

/// `PARAM_SET`.
pub(crate) mod param_set {
    pub const VALUE: usize = 0;
    pub const TARGET: usize = 4;
    pub const NAME: usize = 6;
}

/// `SERVO_OUTPUT_RAW`.
pub(crate) mod servo_output_raw {
    pub const TIME_USEC: usize = 0;
    pub const PORT: usize = 20;

    /// An output, from 0 to 15; the later ones came with MAVLink 2.
    pub fn output(number: usize) -> Option<usize> {
        match number {
            0..8 => Some(4 + 2 * number),
            8..16 => Some(21 + 2 * (number - 8)),
            _ => None,
        }
    }
}

/// `RC_CHANNELS_OVERRIDE`.
pub(crate) mod rc_channels_override {
    pub const TARGET: usize = 16;

    /// A channel, from 0 to 17; the later ones came with MAVLink 2.
    pub fn channel(number: usize) -> Option<usize> {
        match number {
            0..8 => Some(2 * number),
            8..18 => Some(18 + 2 * (number - 8)),
            _ => None,
        }
    }
}

/// `COMMAND_LONG` and, except for the last field, `COMMAND_INT`, which has two parameters as whole numbers.
pub(crate) mod command {
    pub const PARAMS: usize = 0;
    pub const COMMAND: usize = 28;
    pub const TARGET: usize = 30;
    pub const CONFIRMATION: usize = 32;
    /// The parameters of `COMMAND_INT` that are whole numbers.
    pub const WHOLE: core::ops::Range<usize> = 4..6;
}

/// `COMMAND_ACK`.
pub(crate) mod command_ack {
    pub const COMMAND: usize = 0;
    pub const RESULT: usize = 2;
    pub const TARGET: usize = 8;
}

/// `COMMAND_CANCEL`.
pub(crate) mod command_cancel {
    pub const COMMAND: usize = 0;
    pub const TARGET: usize = 2;
}

/// `SETUP_SIGNING`.
#[cfg_attr(not(feature = "signing"), allow(dead_code, reason = "it is answered with a text"))]
pub(crate) mod setup_signing {
    pub const TIMESTAMP: usize = 0;
    pub const TARGET: usize = 8;
    pub const KEY: usize = 10;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialect::*;
    use mavlink_core::{MavlinkVersion, MessageData};

    /// A payload in which no two bytes are the same, as the generated parser and this file read it.
    fn both<M: MessageData>() -> (M, Fields) {
        let payload: [u8; MAX_PAYLOAD] = core::array::from_fn(|i| i as u8 + 1);
        let Ok(message) = M::deser(MavlinkVersion::V2, &payload) else { panic!("{}", M::NAME) };
        (message, Fields::new(&payload))
    }

    #[test]
    fn every_field_is_where_the_generated_parsers_have_it() {
        let (it, fields) = both::<HEARTBEAT_DATA>();
        let read = [heartbeat::TYPE, heartbeat::AUTOPILOT, heartbeat::BASE_MODE].map(|at| fields.u8(at));
        assert_eq!(read, [it.mavtype, it.autopilot, it.base_mode]);

        let target = |fields: &Fields, at| (fields.u8(at), fields.u8(at + 1));
        let (it, fields) = both::<PARAM_REQUEST_READ_DATA>();
        assert_eq!(fields.u16(param_request_read::INDEX) as i16, it.param_index);
        assert_eq!(target(&fields, param_request_read::TARGET), (it.target_system, it.target_component));
        assert_eq!(fields.bytes(param_request_read::NAME), *it.param_id);

        let (it, fields) = both::<PARAM_REQUEST_LIST_DATA>();
        assert_eq!(target(&fields, param_request_list::TARGET), (it.target_system, it.target_component));

        let (it, fields) = both::<PARAM_SET_DATA>();
        assert_eq!(fields.f32(param_set::VALUE).to_bits(), it.param_value.to_bits());
        assert_eq!(target(&fields, param_set::TARGET), (it.target_system, it.target_component));
        assert_eq!(fields.bytes(param_set::NAME), *it.param_id);

        let (it, fields) = both::<SERVO_OUTPUT_RAW_DATA>();
        assert_eq!(fields.u32(servo_output_raw::TIME_USEC), it.time_usec);
        assert_eq!(fields.u8(servo_output_raw::PORT), it.port);
        let outputs = [
            it.servo1_raw,
            it.servo2_raw,
            it.servo3_raw,
            it.servo4_raw,
            it.servo5_raw,
            it.servo6_raw,
            it.servo7_raw,
            it.servo8_raw,
            it.servo9_raw,
            it.servo10_raw,
            it.servo11_raw,
            it.servo12_raw,
            it.servo13_raw,
            it.servo14_raw,
            it.servo15_raw,
            it.servo16_raw,
        ];
        for (number, output) in outputs.into_iter().enumerate() {
            assert_eq!(fields.u16(servo_output_raw::output(number).unwrap()), output, "{number}");
        }
        assert_eq!(servo_output_raw::output(16), None);

        let (it, fields) = both::<RC_CHANNELS_OVERRIDE_DATA>();
        assert_eq!(target(&fields, rc_channels_override::TARGET), (it.target_system, it.target_component));
        let channels = [
            it.chan1_raw,
            it.chan2_raw,
            it.chan3_raw,
            it.chan4_raw,
            it.chan5_raw,
            it.chan6_raw,
            it.chan7_raw,
            it.chan8_raw,
            it.chan9_raw,
            it.chan10_raw,
            it.chan11_raw,
            it.chan12_raw,
            it.chan13_raw,
            it.chan14_raw,
            it.chan15_raw,
            it.chan16_raw,
            it.chan17_raw,
            it.chan18_raw,
        ];
        for (number, channel) in channels.into_iter().enumerate() {
            assert_eq!(fields.u16(rc_channels_override::channel(number).unwrap()), channel, "{number}");
        }
        assert_eq!(rc_channels_override::channel(18), None);

        let (it, fields) = both::<COMMAND_LONG_DATA>();
        let params = [it.param1, it.param2, it.param3, it.param4, it.param5, it.param6, it.param7];
        for (i, param) in params.into_iter().enumerate() {
            assert_eq!(fields.f32(command::PARAMS + 4 * i).to_bits(), param.to_bits(), "{i}");
        }
        assert_eq!(fields.u16(command::COMMAND), it.command);
        assert_eq!(target(&fields, command::TARGET), (it.target_system, it.target_component));
        assert_eq!(fields.u8(command::CONFIRMATION), it.confirmation);

        let (it, fields) = both::<COMMAND_INT_DATA>();
        let floats = [(0, it.param1), (1, it.param2), (2, it.param3), (3, it.param4), (6, it.z)];
        for (i, param) in floats {
            assert_eq!(fields.f32(command::PARAMS + 4 * i).to_bits(), param.to_bits(), "{i}");
        }
        for (i, whole) in command::WHOLE.zip([it.x, it.y]) {
            assert_eq!(fields.u32(command::PARAMS + 4 * i) as i32, whole);
        }
        assert_eq!(fields.u16(command::COMMAND), it.command);
        assert_eq!(target(&fields, command::TARGET), (it.target_system, it.target_component));

        let (it, fields) = both::<COMMAND_ACK_DATA>();
        assert_eq!(fields.u16(command_ack::COMMAND), it.command);
        assert_eq!(fields.u8(command_ack::RESULT), it.result);
        assert_eq!(target(&fields, command_ack::TARGET), (it.target_system, it.target_component));

        let (it, fields) = both::<COMMAND_CANCEL_DATA>();
        assert_eq!(fields.u16(command_cancel::COMMAND), it.command);
        assert_eq!(target(&fields, command_cancel::TARGET), (it.target_system, it.target_component));

        let (it, fields) = both::<SETUP_SIGNING_DATA>();
        assert_eq!(u64::from_le_bytes(fields.bytes(setup_signing::TIMESTAMP)), it.initial_timestamp);
        assert_eq!(target(&fields, setup_signing::TARGET), (it.target_system, it.target_component));
        assert_eq!(fields.bytes(setup_signing::KEY), it.secret_key);
    }

    #[test]
    fn behind_a_payload_there_are_zeros() {
        let fields = Fields::new(&[1, 2, 3]);
        assert_eq!((fields.u16(1), fields.u16(2), fields.u32(0)), (0x0302, 3, 0x0003_0201));
        assert_eq!((fields.u8(255), fields.u32(252), fields.f32(usize::MAX)), (0, 0, 0.0));
    }
}
