//! Payloads of the messages that are sent: one writer serves all of them. A test compares it with the generated code.

use crate::dialect::*;
use mavlink_core::MessageData;

/// Largest payload that is sent here: `EFI_STATUS`.
pub(crate) const SENT_PAYLOAD: usize = 73;

/// A message as bytes. From here on, the code is the same for every message.
#[derive(Debug)]
pub(crate) struct Payload {
    pub id: u32,
    pub extra_crc: u8,
    bytes: [u8; SENT_PAYLOAD],
}

impl Payload {
    pub fn of<M: Sent>(message: &M) -> Self {
        const { assert!(M::ENCODED_LEN <= SENT_PAYLOAD) };
        let mut payload = Self { id: M::ID, extra_crc: M::EXTRA_CRC, bytes: [0; _] };
        message.write(&mut payload);
        payload
    }

    /// Writes bytes from offset `at` on.
    #[inline(never)]
    pub fn put(&mut self, at: usize, bytes: &[u8]) {
        self.bytes.iter_mut().skip(at).zip(bytes).for_each(|(to, byte)| *to = *byte);
    }

    pub fn put_f32(&mut self, at: usize, value: f32) {
        self.put(at, &value.to_le_bytes());
    }

    /// The bytes to send: all but the zeros at the end, and at least one byte.
    pub fn bytes(&self) -> &[u8] {
        let length = self.bytes.iter().rposition(|&byte| byte != 0).map_or(1, |last| last + 1);
        self.bytes.get(..length).unwrap_or_default()
    }
}

/// Any message, as the generated code writes it.
#[cfg(test)]
pub(crate) fn generated<M: MessageData>(message: &M) -> Payload {
    let mut payload = Payload { id: M::ID, extra_crc: M::EXTRA_CRC, bytes: [0; _] };
    message.ser(mavlink_core::MavlinkVersion::V2, &mut payload.bytes);
    payload
}

/// A message that is sent.
pub(crate) trait Sent: MessageData {
    /// Writes its fields, where the definitions have them.
    fn write(&self, to: &mut Payload);
}

impl Sent for HEARTBEAT_DATA {
    fn write(&self, to: &mut Payload) {
        to.put(0, &self.custom_mode.to_le_bytes());
        let Self { mavtype, autopilot, base_mode, system_status, mavlink_version, .. } = *self;
        to.put(4, &[mavtype, autopilot, base_mode, system_status, mavlink_version]);
    }
}

impl Sent for PARAM_VALUE_DATA {
    fn write(&self, to: &mut Payload) {
        to.put_f32(0, self.param_value);
        to.put(4, &self.param_count.to_le_bytes());
        to.put(6, &self.param_index.to_le_bytes());
        to.put(8, &*self.param_id);
        to.put(24, &[self.param_type]);
    }
}

impl Sent for COMMAND_LONG_DATA {
    fn write(&self, to: &mut Payload) {
        let Self { param1, param2, param3, param4, param5, param6, param7, .. } = *self;
        for (i, param) in [param1, param2, param3, param4, param5, param6, param7].into_iter().enumerate() {
            to.put_f32(4 * i, param);
        }
        to.put(28, &self.command.to_le_bytes());
        to.put(30, &[self.target_system, self.target_component, self.confirmation]);
    }
}

impl Sent for COMMAND_ACK_DATA {
    fn write(&self, to: &mut Payload) {
        to.put(0, &self.command.to_le_bytes());
        to.put(2, &[self.result, self.progress]);
        to.put(4, &self.result_param2.to_le_bytes());
        to.put(8, &[self.target_system, self.target_component]);
    }
}

impl Sent for EFI_STATUS_DATA {
    fn write(&self, to: &mut Payload) {
        let floats = [
            self.ecu_index,
            self.rpm,
            self.fuel_consumed,
            self.fuel_flow,
            self.engine_load,
            self.throttle_position,
            self.spark_dwell_time,
            self.barometric_pressure,
            self.intake_manifold_pressure,
            self.intake_manifold_temperature,
            self.cylinder_head_temperature,
            self.ignition_timing,
            self.injection_time,
            self.exhaust_gas_temperature,
            self.throttle_out,
            self.pt_compensation,
        ];
        for (i, float) in floats.into_iter().enumerate() {
            to.put_f32(4 * i, float);
        }
        to.put(64, &[self.health]);
        to.put_f32(65, self.ignition_voltage);
        to.put_f32(69, self.fuel_pressure);
    }
}

impl Sent for NAMED_VALUE_FLOAT_DATA {
    fn write(&self, to: &mut Payload) {
        to.put(0, &self.time_boot_ms.to_le_bytes());
        to.put_f32(4, self.value);
        to.put(8, &*self.name);
    }
}

impl Sent for STATUSTEXT_DATA {
    fn write(&self, to: &mut Payload) {
        to.put(0, &[self.severity]);
        to.put(1, &*self.text);
        to.put(51, &self.id.to_le_bytes());
        to.put(53, &[self.chunk_seq]);
    }
}

impl Sent for RELAY_STATUS_DATA {
    fn write(&self, to: &mut Payload) {
        to.put(0, &self.time_boot_ms.to_le_bytes());
        to.put(4, &self.on.to_le_bytes());
        to.put(6, &self.present.to_le_bytes());
    }
}

impl Sent for RC_CHANNELS_DATA {
    fn write(&self, to: &mut Payload) {
        to.put(0, &self.time_boot_ms.to_le_bytes());
        let channels = [
            self.chan1_raw,
            self.chan2_raw,
            self.chan3_raw,
            self.chan4_raw,
            self.chan5_raw,
            self.chan6_raw,
            self.chan7_raw,
            self.chan8_raw,
            self.chan9_raw,
            self.chan10_raw,
            self.chan11_raw,
            self.chan12_raw,
            self.chan13_raw,
            self.chan14_raw,
            self.chan15_raw,
            self.chan16_raw,
            self.chan17_raw,
            self.chan18_raw,
        ];
        for (i, channel) in channels.into_iter().enumerate() {
            to.put(4 + 2 * i, &channel.to_le_bytes());
        }
        to.put(40, &[self.chancount, self.rssi]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink_core::MavlinkVersion;

    /// Compares with the generated code for a message in which no two bytes are the same, one of zeros only, and one that ends with
    /// zeros.
    fn is_as_generated<M: Sent>() {
        for bytes in
            [[0; 255], core::array::from_fn(|i| i as u8 + 1), core::array::from_fn(|i| (i < 9).into())]
        {
            let Ok(message) = M::deser(MavlinkVersion::V2, &bytes) else { panic!("{}", M::NAME) };
            let mut expected = [0; 255];
            let length = message.ser(MavlinkVersion::V2, &mut expected);
            assert_eq!(Payload::of(&message).bytes(), &expected[..length], "{}", M::NAME);
        }
    }

    #[test]
    fn every_message_is_as_the_generated_code_writes_it() {
        is_as_generated::<HEARTBEAT_DATA>();
        is_as_generated::<PARAM_VALUE_DATA>();
        is_as_generated::<COMMAND_LONG_DATA>();
        is_as_generated::<COMMAND_ACK_DATA>();
        is_as_generated::<EFI_STATUS_DATA>();
        is_as_generated::<NAMED_VALUE_FLOAT_DATA>();
        is_as_generated::<STATUSTEXT_DATA>();
        is_as_generated::<RELAY_STATUS_DATA>();
        is_as_generated::<RC_CHANNELS_DATA>();
    }
}
