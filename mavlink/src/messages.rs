//!MAVLink jetlink dialect.
//!
//!This file was automatically generated, do not edit.
#![allow(deprecated)]
#![allow(clippy::match_single_binding)]
#![allow(rustdoc::broken_intra_doc_links)]
#[allow(unused_imports)]
use num_derive::{FromPrimitive, ToPrimitive};
#[allow(unused_imports)]
use num_traits::{FromPrimitive, ToPrimitive};
#[allow(unused_imports)]
use bitflags::{bitflags, Flags};
#[allow(unused_imports)]
use mavlink_core::{
    MavlinkVersion, Message, MessageData, bytes::Bytes, bytes_mut::BytesMut,
    types::CharArray,
};
#[cfg(feature = "serde")]
use serde::{Serialize, Deserialize};
#[cfg(feature = "arbitrary")]
use arbitrary::Arbitrary;
#[cfg(feature = "ts-rs")]
use ts_rs::TS;
///Answer to a command.
///
///ID: 77
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct COMMAND_ACK_DATA {
    pub command: u16,
    pub result: u8,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub progress: u8,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub result_param2: i32,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub target_system: u8,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub target_component: u8,
}
impl COMMAND_ACK_DATA {
    pub const ENCODED_LEN: usize = 10usize;
    pub const DEFAULT: Self = Self {
        command: 0_u16,
        result: 0_u8,
        progress: 0_u8,
        result_param2: 0_i32,
        target_system: 0_u8,
        target_component: 0_u8,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for COMMAND_ACK_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for COMMAND_ACK_DATA {
    type Message = MavMessage;
    const ID: u32 = 77u32;
    const NAME: &'static str = "COMMAND_ACK";
    const EXTRA_CRC: u8 = 143u8;
    const ENCODED_LEN: usize = 10usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.command = buf.get_u16_le()?;
        __struct.result = buf.get_u8()?;
        __struct.progress = buf.get_u8()?;
        __struct.result_param2 = buf.get_i32_le()?;
        __struct.target_system = buf.get_u8()?;
        __struct.target_component = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u16_le(self.command);
        __tmp.put_u8(self.result);
        if matches!(version, MavlinkVersion::V2) {
            __tmp.put_u8(self.progress);
            __tmp.put_i32_le(self.result_param2);
            __tmp.put_u8(self.target_system);
            __tmp.put_u8(self.target_component);
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///Cancels a command in progress.
///
///ID: 80
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct COMMAND_CANCEL_DATA {
    pub command: u16,
    pub target_system: u8,
    pub target_component: u8,
}
impl COMMAND_CANCEL_DATA {
    pub const ENCODED_LEN: usize = 4usize;
    pub const DEFAULT: Self = Self {
        command: 0_u16,
        target_system: 0_u8,
        target_component: 0_u8,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for COMMAND_CANCEL_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for COMMAND_CANCEL_DATA {
    type Message = MavMessage;
    const ID: u32 = 80u32;
    const NAME: &'static str = "COMMAND_CANCEL";
    const EXTRA_CRC: u8 = 14u8;
    const ENCODED_LEN: usize = 4usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.command = buf.get_u16_le()?;
        __struct.target_system = buf.get_u8()?;
        __struct.target_component = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u16_le(self.command);
        __tmp.put_u8(self.target_system);
        __tmp.put_u8(self.target_component);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///Command with two whole numbers.
///
///ID: 75
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct COMMAND_INT_DATA {
    pub param1: f32,
    pub param2: f32,
    pub param3: f32,
    pub param4: f32,
    pub x: i32,
    pub y: i32,
    pub z: f32,
    pub command: u16,
    pub target_system: u8,
    pub target_component: u8,
    pub frame: u8,
    pub current: u8,
    pub autocontinue: u8,
}
impl COMMAND_INT_DATA {
    pub const ENCODED_LEN: usize = 35usize;
    pub const DEFAULT: Self = Self {
        param1: 0.0_f32,
        param2: 0.0_f32,
        param3: 0.0_f32,
        param4: 0.0_f32,
        x: 0_i32,
        y: 0_i32,
        z: 0.0_f32,
        command: 0_u16,
        target_system: 0_u8,
        target_component: 0_u8,
        frame: 0_u8,
        current: 0_u8,
        autocontinue: 0_u8,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for COMMAND_INT_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for COMMAND_INT_DATA {
    type Message = MavMessage;
    const ID: u32 = 75u32;
    const NAME: &'static str = "COMMAND_INT";
    const EXTRA_CRC: u8 = 158u8;
    const ENCODED_LEN: usize = 35usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.param1 = buf.get_f32_le()?;
        __struct.param2 = buf.get_f32_le()?;
        __struct.param3 = buf.get_f32_le()?;
        __struct.param4 = buf.get_f32_le()?;
        __struct.x = buf.get_i32_le()?;
        __struct.y = buf.get_i32_le()?;
        __struct.z = buf.get_f32_le()?;
        __struct.command = buf.get_u16_le()?;
        __struct.target_system = buf.get_u8()?;
        __struct.target_component = buf.get_u8()?;
        __struct.frame = buf.get_u8()?;
        __struct.current = buf.get_u8()?;
        __struct.autocontinue = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_f32_le(self.param1);
        __tmp.put_f32_le(self.param2);
        __tmp.put_f32_le(self.param3);
        __tmp.put_f32_le(self.param4);
        __tmp.put_i32_le(self.x);
        __tmp.put_i32_le(self.y);
        __tmp.put_f32_le(self.z);
        __tmp.put_u16_le(self.command);
        __tmp.put_u8(self.target_system);
        __tmp.put_u8(self.target_component);
        __tmp.put_u8(self.frame);
        __tmp.put_u8(self.current);
        __tmp.put_u8(self.autocontinue);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///Command.
///
///ID: 76
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct COMMAND_LONG_DATA {
    pub param1: f32,
    pub param2: f32,
    pub param3: f32,
    pub param4: f32,
    pub param5: f32,
    pub param6: f32,
    pub param7: f32,
    pub command: u16,
    pub target_system: u8,
    pub target_component: u8,
    pub confirmation: u8,
}
impl COMMAND_LONG_DATA {
    pub const ENCODED_LEN: usize = 33usize;
    pub const DEFAULT: Self = Self {
        param1: 0.0_f32,
        param2: 0.0_f32,
        param3: 0.0_f32,
        param4: 0.0_f32,
        param5: 0.0_f32,
        param6: 0.0_f32,
        param7: 0.0_f32,
        command: 0_u16,
        target_system: 0_u8,
        target_component: 0_u8,
        confirmation: 0_u8,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for COMMAND_LONG_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for COMMAND_LONG_DATA {
    type Message = MavMessage;
    const ID: u32 = 76u32;
    const NAME: &'static str = "COMMAND_LONG";
    const EXTRA_CRC: u8 = 152u8;
    const ENCODED_LEN: usize = 33usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.param1 = buf.get_f32_le()?;
        __struct.param2 = buf.get_f32_le()?;
        __struct.param3 = buf.get_f32_le()?;
        __struct.param4 = buf.get_f32_le()?;
        __struct.param5 = buf.get_f32_le()?;
        __struct.param6 = buf.get_f32_le()?;
        __struct.param7 = buf.get_f32_le()?;
        __struct.command = buf.get_u16_le()?;
        __struct.target_system = buf.get_u8()?;
        __struct.target_component = buf.get_u8()?;
        __struct.confirmation = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_f32_le(self.param1);
        __tmp.put_f32_le(self.param2);
        __tmp.put_f32_le(self.param3);
        __tmp.put_f32_le(self.param4);
        __tmp.put_f32_le(self.param5);
        __tmp.put_f32_le(self.param6);
        __tmp.put_f32_le(self.param7);
        __tmp.put_u16_le(self.command);
        __tmp.put_u8(self.target_system);
        __tmp.put_u8(self.target_component);
        __tmp.put_u8(self.confirmation);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///One engine.
///
///ID: 225
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct EFI_STATUS_DATA {
    pub ecu_index: f32,
    pub rpm: f32,
    pub fuel_consumed: f32,
    pub fuel_flow: f32,
    pub engine_load: f32,
    pub throttle_position: f32,
    pub spark_dwell_time: f32,
    pub barometric_pressure: f32,
    pub intake_manifold_pressure: f32,
    pub intake_manifold_temperature: f32,
    pub cylinder_head_temperature: f32,
    pub ignition_timing: f32,
    pub injection_time: f32,
    pub exhaust_gas_temperature: f32,
    pub throttle_out: f32,
    pub pt_compensation: f32,
    pub health: u8,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub ignition_voltage: f32,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub fuel_pressure: f32,
}
impl EFI_STATUS_DATA {
    pub const ENCODED_LEN: usize = 73usize;
    pub const DEFAULT: Self = Self {
        ecu_index: 0.0_f32,
        rpm: 0.0_f32,
        fuel_consumed: 0.0_f32,
        fuel_flow: 0.0_f32,
        engine_load: 0.0_f32,
        throttle_position: 0.0_f32,
        spark_dwell_time: 0.0_f32,
        barometric_pressure: 0.0_f32,
        intake_manifold_pressure: 0.0_f32,
        intake_manifold_temperature: 0.0_f32,
        cylinder_head_temperature: 0.0_f32,
        ignition_timing: 0.0_f32,
        injection_time: 0.0_f32,
        exhaust_gas_temperature: 0.0_f32,
        throttle_out: 0.0_f32,
        pt_compensation: 0.0_f32,
        health: 0_u8,
        ignition_voltage: 0.0_f32,
        fuel_pressure: 0.0_f32,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for EFI_STATUS_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for EFI_STATUS_DATA {
    type Message = MavMessage;
    const ID: u32 = 225u32;
    const NAME: &'static str = "EFI_STATUS";
    const EXTRA_CRC: u8 = 208u8;
    const ENCODED_LEN: usize = 73usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.ecu_index = buf.get_f32_le()?;
        __struct.rpm = buf.get_f32_le()?;
        __struct.fuel_consumed = buf.get_f32_le()?;
        __struct.fuel_flow = buf.get_f32_le()?;
        __struct.engine_load = buf.get_f32_le()?;
        __struct.throttle_position = buf.get_f32_le()?;
        __struct.spark_dwell_time = buf.get_f32_le()?;
        __struct.barometric_pressure = buf.get_f32_le()?;
        __struct.intake_manifold_pressure = buf.get_f32_le()?;
        __struct.intake_manifold_temperature = buf.get_f32_le()?;
        __struct.cylinder_head_temperature = buf.get_f32_le()?;
        __struct.ignition_timing = buf.get_f32_le()?;
        __struct.injection_time = buf.get_f32_le()?;
        __struct.exhaust_gas_temperature = buf.get_f32_le()?;
        __struct.throttle_out = buf.get_f32_le()?;
        __struct.pt_compensation = buf.get_f32_le()?;
        __struct.health = buf.get_u8()?;
        __struct.ignition_voltage = buf.get_f32_le()?;
        __struct.fuel_pressure = buf.get_f32_le()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_f32_le(self.ecu_index);
        __tmp.put_f32_le(self.rpm);
        __tmp.put_f32_le(self.fuel_consumed);
        __tmp.put_f32_le(self.fuel_flow);
        __tmp.put_f32_le(self.engine_load);
        __tmp.put_f32_le(self.throttle_position);
        __tmp.put_f32_le(self.spark_dwell_time);
        __tmp.put_f32_le(self.barometric_pressure);
        __tmp.put_f32_le(self.intake_manifold_pressure);
        __tmp.put_f32_le(self.intake_manifold_temperature);
        __tmp.put_f32_le(self.cylinder_head_temperature);
        __tmp.put_f32_le(self.ignition_timing);
        __tmp.put_f32_le(self.injection_time);
        __tmp.put_f32_le(self.exhaust_gas_temperature);
        __tmp.put_f32_le(self.throttle_out);
        __tmp.put_f32_le(self.pt_compensation);
        __tmp.put_u8(self.health);
        if matches!(version, MavlinkVersion::V2) {
            __tmp.put_f32_le(self.ignition_voltage);
            __tmp.put_f32_le(self.fuel_pressure);
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///Presence and state of a component, once a second.
///
///ID: 0
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct HEARTBEAT_DATA {
    pub custom_mode: u32,
    pub mavtype: u8,
    pub autopilot: u8,
    pub base_mode: u8,
    pub system_status: u8,
    pub mavlink_version: u8,
}
impl HEARTBEAT_DATA {
    pub const ENCODED_LEN: usize = 9usize;
    pub const DEFAULT: Self = Self {
        custom_mode: 0_u32,
        mavtype: 0_u8,
        autopilot: 0_u8,
        base_mode: 0_u8,
        system_status: 0_u8,
        mavlink_version: 0_u8,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for HEARTBEAT_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for HEARTBEAT_DATA {
    type Message = MavMessage;
    const ID: u32 = 0u32;
    const NAME: &'static str = "HEARTBEAT";
    const EXTRA_CRC: u8 = 50u8;
    const ENCODED_LEN: usize = 9usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.custom_mode = buf.get_u32_le()?;
        __struct.mavtype = buf.get_u8()?;
        __struct.autopilot = buf.get_u8()?;
        __struct.base_mode = buf.get_u8()?;
        __struct.system_status = buf.get_u8()?;
        __struct.mavlink_version = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u32_le(self.custom_mode);
        __tmp.put_u8(self.mavtype);
        __tmp.put_u8(self.autopilot);
        __tmp.put_u8(self.base_mode);
        __tmp.put_u8(self.system_status);
        __tmp.put_u8(self.mavlink_version);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///A named number.
///
///ID: 251
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct NAMED_VALUE_FLOAT_DATA {
    pub time_boot_ms: u32,
    pub value: f32,
    #[cfg_attr(feature = "ts-rs", ts(type = "string"))]
    pub name: CharArray<10>,
}
impl NAMED_VALUE_FLOAT_DATA {
    pub const ENCODED_LEN: usize = 18usize;
    pub const DEFAULT: Self = Self {
        time_boot_ms: 0_u32,
        value: 0.0_f32,
        name: CharArray::new([0_u8; 10usize]),
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for NAMED_VALUE_FLOAT_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for NAMED_VALUE_FLOAT_DATA {
    type Message = MavMessage;
    const ID: u32 = 251u32;
    const NAME: &'static str = "NAMED_VALUE_FLOAT";
    const EXTRA_CRC: u8 = 170u8;
    const ENCODED_LEN: usize = 18usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.time_boot_ms = buf.get_u32_le()?;
        __struct.value = buf.get_f32_le()?;
        let mut tmp = [0_u8; 10usize];
        for v in &mut tmp {
            *v = buf.get_u8()?;
        }
        __struct.name = CharArray::new(tmp);
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u32_le(self.time_boot_ms);
        __tmp.put_f32_le(self.value);
        for val in &self.name {
            __tmp.put_u8(*val);
        }
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///Asks for all parameters of a component.
///
///ID: 21
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct PARAM_REQUEST_LIST_DATA {
    pub target_system: u8,
    pub target_component: u8,
}
impl PARAM_REQUEST_LIST_DATA {
    pub const ENCODED_LEN: usize = 2usize;
    pub const DEFAULT: Self = Self {
        target_system: 0_u8,
        target_component: 0_u8,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for PARAM_REQUEST_LIST_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for PARAM_REQUEST_LIST_DATA {
    type Message = MavMessage;
    const ID: u32 = 21u32;
    const NAME: &'static str = "PARAM_REQUEST_LIST";
    const EXTRA_CRC: u8 = 159u8;
    const ENCODED_LEN: usize = 2usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.target_system = buf.get_u8()?;
        __struct.target_component = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u8(self.target_system);
        __tmp.put_u8(self.target_component);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///Asks for one parameter, by index, or by name where the index is -1.
///
///ID: 20
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct PARAM_REQUEST_READ_DATA {
    pub param_index: i16,
    pub target_system: u8,
    pub target_component: u8,
    #[cfg_attr(feature = "ts-rs", ts(type = "string"))]
    pub param_id: CharArray<16>,
}
impl PARAM_REQUEST_READ_DATA {
    pub const ENCODED_LEN: usize = 20usize;
    pub const DEFAULT: Self = Self {
        param_index: 0_i16,
        target_system: 0_u8,
        target_component: 0_u8,
        param_id: CharArray::new([0_u8; 16usize]),
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for PARAM_REQUEST_READ_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for PARAM_REQUEST_READ_DATA {
    type Message = MavMessage;
    const ID: u32 = 20u32;
    const NAME: &'static str = "PARAM_REQUEST_READ";
    const EXTRA_CRC: u8 = 214u8;
    const ENCODED_LEN: usize = 20usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.param_index = buf.get_i16_le()?;
        __struct.target_system = buf.get_u8()?;
        __struct.target_component = buf.get_u8()?;
        let mut tmp = [0_u8; 16usize];
        for v in &mut tmp {
            *v = buf.get_u8()?;
        }
        __struct.param_id = CharArray::new(tmp);
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_i16_le(self.param_index);
        __tmp.put_u8(self.target_system);
        __tmp.put_u8(self.target_component);
        for val in &self.param_id {
            __tmp.put_u8(*val);
        }
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///Sets a parameter; PARAM_VALUE with its value is the answer.
///
///ID: 23
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct PARAM_SET_DATA {
    pub param_value: f32,
    pub target_system: u8,
    pub target_component: u8,
    #[cfg_attr(feature = "ts-rs", ts(type = "string"))]
    pub param_id: CharArray<16>,
    pub param_type: u8,
}
impl PARAM_SET_DATA {
    pub const ENCODED_LEN: usize = 23usize;
    pub const DEFAULT: Self = Self {
        param_value: 0.0_f32,
        target_system: 0_u8,
        target_component: 0_u8,
        param_id: CharArray::new([0_u8; 16usize]),
        param_type: 0_u8,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for PARAM_SET_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for PARAM_SET_DATA {
    type Message = MavMessage;
    const ID: u32 = 23u32;
    const NAME: &'static str = "PARAM_SET";
    const EXTRA_CRC: u8 = 168u8;
    const ENCODED_LEN: usize = 23usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.param_value = buf.get_f32_le()?;
        __struct.target_system = buf.get_u8()?;
        __struct.target_component = buf.get_u8()?;
        let mut tmp = [0_u8; 16usize];
        for v in &mut tmp {
            *v = buf.get_u8()?;
        }
        __struct.param_id = CharArray::new(tmp);
        __struct.param_type = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_f32_le(self.param_value);
        __tmp.put_u8(self.target_system);
        __tmp.put_u8(self.target_component);
        for val in &self.param_id {
            __tmp.put_u8(*val);
        }
        __tmp.put_u8(self.param_type);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///One parameter of a component.
///
///ID: 22
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct PARAM_VALUE_DATA {
    pub param_value: f32,
    pub param_count: u16,
    pub param_index: u16,
    #[cfg_attr(feature = "ts-rs", ts(type = "string"))]
    pub param_id: CharArray<16>,
    pub param_type: u8,
}
impl PARAM_VALUE_DATA {
    pub const ENCODED_LEN: usize = 25usize;
    pub const DEFAULT: Self = Self {
        param_value: 0.0_f32,
        param_count: 0_u16,
        param_index: 0_u16,
        param_id: CharArray::new([0_u8; 16usize]),
        param_type: 0_u8,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for PARAM_VALUE_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for PARAM_VALUE_DATA {
    type Message = MavMessage;
    const ID: u32 = 22u32;
    const NAME: &'static str = "PARAM_VALUE";
    const EXTRA_CRC: u8 = 220u8;
    const ENCODED_LEN: usize = 25usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.param_value = buf.get_f32_le()?;
        __struct.param_count = buf.get_u16_le()?;
        __struct.param_index = buf.get_u16_le()?;
        let mut tmp = [0_u8; 16usize];
        for v in &mut tmp {
            *v = buf.get_u8()?;
        }
        __struct.param_id = CharArray::new(tmp);
        __struct.param_type = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_f32_le(self.param_value);
        __tmp.put_u16_le(self.param_count);
        __tmp.put_u16_le(self.param_index);
        for val in &self.param_id {
            __tmp.put_u8(*val);
        }
        __tmp.put_u8(self.param_type);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///Channels of a receiver in µs; 65535 is no value.
///
///ID: 65
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct RC_CHANNELS_DATA {
    pub time_boot_ms: u32,
    pub chan1_raw: u16,
    pub chan2_raw: u16,
    pub chan3_raw: u16,
    pub chan4_raw: u16,
    pub chan5_raw: u16,
    pub chan6_raw: u16,
    pub chan7_raw: u16,
    pub chan8_raw: u16,
    pub chan9_raw: u16,
    pub chan10_raw: u16,
    pub chan11_raw: u16,
    pub chan12_raw: u16,
    pub chan13_raw: u16,
    pub chan14_raw: u16,
    pub chan15_raw: u16,
    pub chan16_raw: u16,
    pub chan17_raw: u16,
    pub chan18_raw: u16,
    pub chancount: u8,
    pub rssi: u8,
}
impl RC_CHANNELS_DATA {
    pub const ENCODED_LEN: usize = 42usize;
    pub const DEFAULT: Self = Self {
        time_boot_ms: 0_u32,
        chan1_raw: 0_u16,
        chan2_raw: 0_u16,
        chan3_raw: 0_u16,
        chan4_raw: 0_u16,
        chan5_raw: 0_u16,
        chan6_raw: 0_u16,
        chan7_raw: 0_u16,
        chan8_raw: 0_u16,
        chan9_raw: 0_u16,
        chan10_raw: 0_u16,
        chan11_raw: 0_u16,
        chan12_raw: 0_u16,
        chan13_raw: 0_u16,
        chan14_raw: 0_u16,
        chan15_raw: 0_u16,
        chan16_raw: 0_u16,
        chan17_raw: 0_u16,
        chan18_raw: 0_u16,
        chancount: 0_u8,
        rssi: 0_u8,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for RC_CHANNELS_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for RC_CHANNELS_DATA {
    type Message = MavMessage;
    const ID: u32 = 65u32;
    const NAME: &'static str = "RC_CHANNELS";
    const EXTRA_CRC: u8 = 118u8;
    const ENCODED_LEN: usize = 42usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.time_boot_ms = buf.get_u32_le()?;
        __struct.chan1_raw = buf.get_u16_le()?;
        __struct.chan2_raw = buf.get_u16_le()?;
        __struct.chan3_raw = buf.get_u16_le()?;
        __struct.chan4_raw = buf.get_u16_le()?;
        __struct.chan5_raw = buf.get_u16_le()?;
        __struct.chan6_raw = buf.get_u16_le()?;
        __struct.chan7_raw = buf.get_u16_le()?;
        __struct.chan8_raw = buf.get_u16_le()?;
        __struct.chan9_raw = buf.get_u16_le()?;
        __struct.chan10_raw = buf.get_u16_le()?;
        __struct.chan11_raw = buf.get_u16_le()?;
        __struct.chan12_raw = buf.get_u16_le()?;
        __struct.chan13_raw = buf.get_u16_le()?;
        __struct.chan14_raw = buf.get_u16_le()?;
        __struct.chan15_raw = buf.get_u16_le()?;
        __struct.chan16_raw = buf.get_u16_le()?;
        __struct.chan17_raw = buf.get_u16_le()?;
        __struct.chan18_raw = buf.get_u16_le()?;
        __struct.chancount = buf.get_u8()?;
        __struct.rssi = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u32_le(self.time_boot_ms);
        __tmp.put_u16_le(self.chan1_raw);
        __tmp.put_u16_le(self.chan2_raw);
        __tmp.put_u16_le(self.chan3_raw);
        __tmp.put_u16_le(self.chan4_raw);
        __tmp.put_u16_le(self.chan5_raw);
        __tmp.put_u16_le(self.chan6_raw);
        __tmp.put_u16_le(self.chan7_raw);
        __tmp.put_u16_le(self.chan8_raw);
        __tmp.put_u16_le(self.chan9_raw);
        __tmp.put_u16_le(self.chan10_raw);
        __tmp.put_u16_le(self.chan11_raw);
        __tmp.put_u16_le(self.chan12_raw);
        __tmp.put_u16_le(self.chan13_raw);
        __tmp.put_u16_le(self.chan14_raw);
        __tmp.put_u16_le(self.chan15_raw);
        __tmp.put_u16_le(self.chan16_raw);
        __tmp.put_u16_le(self.chan17_raw);
        __tmp.put_u16_le(self.chan18_raw);
        __tmp.put_u8(self.chancount);
        __tmp.put_u8(self.rssi);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///RC channels in µs, for one component.
///
///ID: 70
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct RC_CHANNELS_OVERRIDE_DATA {
    pub chan1_raw: u16,
    pub chan2_raw: u16,
    pub chan3_raw: u16,
    pub chan4_raw: u16,
    pub chan5_raw: u16,
    pub chan6_raw: u16,
    pub chan7_raw: u16,
    pub chan8_raw: u16,
    pub target_system: u8,
    pub target_component: u8,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub chan9_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub chan10_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub chan11_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub chan12_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub chan13_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub chan14_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub chan15_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub chan16_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub chan17_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub chan18_raw: u16,
}
impl RC_CHANNELS_OVERRIDE_DATA {
    pub const ENCODED_LEN: usize = 38usize;
    pub const DEFAULT: Self = Self {
        chan1_raw: 0_u16,
        chan2_raw: 0_u16,
        chan3_raw: 0_u16,
        chan4_raw: 0_u16,
        chan5_raw: 0_u16,
        chan6_raw: 0_u16,
        chan7_raw: 0_u16,
        chan8_raw: 0_u16,
        target_system: 0_u8,
        target_component: 0_u8,
        chan9_raw: 0_u16,
        chan10_raw: 0_u16,
        chan11_raw: 0_u16,
        chan12_raw: 0_u16,
        chan13_raw: 0_u16,
        chan14_raw: 0_u16,
        chan15_raw: 0_u16,
        chan16_raw: 0_u16,
        chan17_raw: 0_u16,
        chan18_raw: 0_u16,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for RC_CHANNELS_OVERRIDE_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for RC_CHANNELS_OVERRIDE_DATA {
    type Message = MavMessage;
    const ID: u32 = 70u32;
    const NAME: &'static str = "RC_CHANNELS_OVERRIDE";
    const EXTRA_CRC: u8 = 124u8;
    const ENCODED_LEN: usize = 38usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.chan1_raw = buf.get_u16_le()?;
        __struct.chan2_raw = buf.get_u16_le()?;
        __struct.chan3_raw = buf.get_u16_le()?;
        __struct.chan4_raw = buf.get_u16_le()?;
        __struct.chan5_raw = buf.get_u16_le()?;
        __struct.chan6_raw = buf.get_u16_le()?;
        __struct.chan7_raw = buf.get_u16_le()?;
        __struct.chan8_raw = buf.get_u16_le()?;
        __struct.target_system = buf.get_u8()?;
        __struct.target_component = buf.get_u8()?;
        __struct.chan9_raw = buf.get_u16_le()?;
        __struct.chan10_raw = buf.get_u16_le()?;
        __struct.chan11_raw = buf.get_u16_le()?;
        __struct.chan12_raw = buf.get_u16_le()?;
        __struct.chan13_raw = buf.get_u16_le()?;
        __struct.chan14_raw = buf.get_u16_le()?;
        __struct.chan15_raw = buf.get_u16_le()?;
        __struct.chan16_raw = buf.get_u16_le()?;
        __struct.chan17_raw = buf.get_u16_le()?;
        __struct.chan18_raw = buf.get_u16_le()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u16_le(self.chan1_raw);
        __tmp.put_u16_le(self.chan2_raw);
        __tmp.put_u16_le(self.chan3_raw);
        __tmp.put_u16_le(self.chan4_raw);
        __tmp.put_u16_le(self.chan5_raw);
        __tmp.put_u16_le(self.chan6_raw);
        __tmp.put_u16_le(self.chan7_raw);
        __tmp.put_u16_le(self.chan8_raw);
        __tmp.put_u8(self.target_system);
        __tmp.put_u8(self.target_component);
        if matches!(version, MavlinkVersion::V2) {
            __tmp.put_u16_le(self.chan9_raw);
            __tmp.put_u16_le(self.chan10_raw);
            __tmp.put_u16_le(self.chan11_raw);
            __tmp.put_u16_le(self.chan12_raw);
            __tmp.put_u16_le(self.chan13_raw);
            __tmp.put_u16_le(self.chan14_raw);
            __tmp.put_u16_le(self.chan15_raw);
            __tmp.put_u16_le(self.chan16_raw);
            __tmp.put_u16_le(self.chan17_raw);
            __tmp.put_u16_le(self.chan18_raw);
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///Relays, a bit for each: which are on, and which are there.
///
///ID: 376
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct RELAY_STATUS_DATA {
    pub time_boot_ms: u32,
    pub on: u16,
    pub present: u16,
}
impl RELAY_STATUS_DATA {
    pub const ENCODED_LEN: usize = 8usize;
    pub const DEFAULT: Self = Self {
        time_boot_ms: 0_u32,
        on: 0_u16,
        present: 0_u16,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for RELAY_STATUS_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for RELAY_STATUS_DATA {
    type Message = MavMessage;
    const ID: u32 = 376u32;
    const NAME: &'static str = "RELAY_STATUS";
    const EXTRA_CRC: u8 = 199u8;
    const ENCODED_LEN: usize = 8usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.time_boot_ms = buf.get_u32_le()?;
        __struct.on = buf.get_u16_le()?;
        __struct.present = buf.get_u16_le()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u32_le(self.time_boot_ms);
        __tmp.put_u16_le(self.on);
        __tmp.put_u16_le(self.present);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///Outputs of an autopilot in µs; port 0 has 1 to 16, port 1 has 17 to 32; 0 is no output.
///
///ID: 36
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct SERVO_OUTPUT_RAW_DATA {
    pub time_usec: u32,
    pub servo1_raw: u16,
    pub servo2_raw: u16,
    pub servo3_raw: u16,
    pub servo4_raw: u16,
    pub servo5_raw: u16,
    pub servo6_raw: u16,
    pub servo7_raw: u16,
    pub servo8_raw: u16,
    pub port: u8,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub servo9_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub servo10_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub servo11_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub servo12_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub servo13_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub servo14_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub servo15_raw: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub servo16_raw: u16,
}
impl SERVO_OUTPUT_RAW_DATA {
    pub const ENCODED_LEN: usize = 37usize;
    pub const DEFAULT: Self = Self {
        time_usec: 0_u32,
        servo1_raw: 0_u16,
        servo2_raw: 0_u16,
        servo3_raw: 0_u16,
        servo4_raw: 0_u16,
        servo5_raw: 0_u16,
        servo6_raw: 0_u16,
        servo7_raw: 0_u16,
        servo8_raw: 0_u16,
        port: 0_u8,
        servo9_raw: 0_u16,
        servo10_raw: 0_u16,
        servo11_raw: 0_u16,
        servo12_raw: 0_u16,
        servo13_raw: 0_u16,
        servo14_raw: 0_u16,
        servo15_raw: 0_u16,
        servo16_raw: 0_u16,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for SERVO_OUTPUT_RAW_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for SERVO_OUTPUT_RAW_DATA {
    type Message = MavMessage;
    const ID: u32 = 36u32;
    const NAME: &'static str = "SERVO_OUTPUT_RAW";
    const EXTRA_CRC: u8 = 222u8;
    const ENCODED_LEN: usize = 37usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.time_usec = buf.get_u32_le()?;
        __struct.servo1_raw = buf.get_u16_le()?;
        __struct.servo2_raw = buf.get_u16_le()?;
        __struct.servo3_raw = buf.get_u16_le()?;
        __struct.servo4_raw = buf.get_u16_le()?;
        __struct.servo5_raw = buf.get_u16_le()?;
        __struct.servo6_raw = buf.get_u16_le()?;
        __struct.servo7_raw = buf.get_u16_le()?;
        __struct.servo8_raw = buf.get_u16_le()?;
        __struct.port = buf.get_u8()?;
        __struct.servo9_raw = buf.get_u16_le()?;
        __struct.servo10_raw = buf.get_u16_le()?;
        __struct.servo11_raw = buf.get_u16_le()?;
        __struct.servo12_raw = buf.get_u16_le()?;
        __struct.servo13_raw = buf.get_u16_le()?;
        __struct.servo14_raw = buf.get_u16_le()?;
        __struct.servo15_raw = buf.get_u16_le()?;
        __struct.servo16_raw = buf.get_u16_le()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u32_le(self.time_usec);
        __tmp.put_u16_le(self.servo1_raw);
        __tmp.put_u16_le(self.servo2_raw);
        __tmp.put_u16_le(self.servo3_raw);
        __tmp.put_u16_le(self.servo4_raw);
        __tmp.put_u16_le(self.servo5_raw);
        __tmp.put_u16_le(self.servo6_raw);
        __tmp.put_u16_le(self.servo7_raw);
        __tmp.put_u16_le(self.servo8_raw);
        __tmp.put_u8(self.port);
        if matches!(version, MavlinkVersion::V2) {
            __tmp.put_u16_le(self.servo9_raw);
            __tmp.put_u16_le(self.servo10_raw);
            __tmp.put_u16_le(self.servo11_raw);
            __tmp.put_u16_le(self.servo12_raw);
            __tmp.put_u16_le(self.servo13_raw);
            __tmp.put_u16_le(self.servo14_raw);
            __tmp.put_u16_le(self.servo15_raw);
            __tmp.put_u16_le(self.servo16_raw);
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///A key for signing; zeros clear it.
///
///ID: 256
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct SETUP_SIGNING_DATA {
    pub initial_timestamp: u64,
    pub target_system: u8,
    pub target_component: u8,
    #[cfg_attr(feature = "serde", serde(with = "serde_arrays"))]
    #[cfg_attr(feature = "ts-rs", ts(type = "Array<number>"))]
    pub secret_key: [u8; 32],
}
impl SETUP_SIGNING_DATA {
    pub const ENCODED_LEN: usize = 42usize;
    pub const DEFAULT: Self = Self {
        initial_timestamp: 0_u64,
        target_system: 0_u8,
        target_component: 0_u8,
        secret_key: [0_u8; 32usize],
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for SETUP_SIGNING_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for SETUP_SIGNING_DATA {
    type Message = MavMessage;
    const ID: u32 = 256u32;
    const NAME: &'static str = "SETUP_SIGNING";
    const EXTRA_CRC: u8 = 71u8;
    const ENCODED_LEN: usize = 42usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.initial_timestamp = buf.get_u64_le()?;
        __struct.target_system = buf.get_u8()?;
        __struct.target_component = buf.get_u8()?;
        for v in &mut __struct.secret_key {
            let val = buf.get_u8()?;
            *v = val;
        }
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u64_le(self.initial_timestamp);
        __tmp.put_u8(self.target_system);
        __tmp.put_u8(self.target_component);
        for val in &self.secret_key {
            __tmp.put_u8(*val);
        }
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
///A text for people; a longer one comes in pieces of 50 bytes with the same id.
///
///ID: 253
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
pub struct STATUSTEXT_DATA {
    pub severity: u8,
    #[cfg_attr(feature = "ts-rs", ts(type = "string"))]
    pub text: CharArray<50>,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub id: u16,
    #[cfg_attr(
        feature = "serde",
        serde(default = "crate::utils::RustDefault::rust_default")
    )]
    pub chunk_seq: u8,
}
impl STATUSTEXT_DATA {
    pub const ENCODED_LEN: usize = 54usize;
    pub const DEFAULT: Self = Self {
        severity: 0_u8,
        text: CharArray::new([0_u8; 50usize]),
        id: 0_u16,
        chunk_seq: 0_u8,
    };
    #[cfg(feature = "arbitrary")]
    pub fn random<R: rand::Rng>(rng: &mut R) -> Self {
        use arbitrary::{Unstructured, Arbitrary};
        let mut buf = [0u8; 1024];
        rng.fill_bytes(&mut buf);
        let mut unstructured = Unstructured::new(&buf);
        Self::arbitrary(&mut unstructured).unwrap_or_default()
    }
}
impl Default for STATUSTEXT_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for STATUSTEXT_DATA {
    type Message = MavMessage;
    const ID: u32 = 253u32;
    const NAME: &'static str = "STATUSTEXT";
    const EXTRA_CRC: u8 = 83u8;
    const ENCODED_LEN: usize = 54usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.severity = buf.get_u8()?;
        let mut tmp = [0_u8; 50usize];
        for v in &mut tmp {
            *v = buf.get_u8()?;
        }
        __struct.text = CharArray::new(tmp);
        __struct.id = buf.get_u16_le()?;
        __struct.chunk_seq = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})", Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u8(self.severity);
        for val in &self.text {
            __tmp.put_u8(*val);
        }
        if matches!(version, MavlinkVersion::V2) {
            __tmp.put_u16_le(self.id);
            __tmp.put_u8(self.chunk_seq);
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[derive(Clone, PartialEq, Debug)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "type"))]
#[cfg_attr(feature = "arbitrary", derive(Arbitrary))]
#[cfg_attr(feature = "ts-rs", derive(TS))]
#[cfg_attr(feature = "ts-rs", ts(export))]
#[repr(u32)]
pub enum MavMessage {
    ///Answer to a command.
    ///
    ///ID: 77
    COMMAND_ACK(COMMAND_ACK_DATA),
    ///Cancels a command in progress.
    ///
    ///ID: 80
    COMMAND_CANCEL(COMMAND_CANCEL_DATA),
    ///Command with two whole numbers.
    ///
    ///ID: 75
    COMMAND_INT(COMMAND_INT_DATA),
    ///Command.
    ///
    ///ID: 76
    COMMAND_LONG(COMMAND_LONG_DATA),
    ///One engine.
    ///
    ///ID: 225
    EFI_STATUS(EFI_STATUS_DATA),
    ///Presence and state of a component, once a second.
    ///
    ///ID: 0
    HEARTBEAT(HEARTBEAT_DATA),
    ///A named number.
    ///
    ///ID: 251
    NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA),
    ///Asks for all parameters of a component.
    ///
    ///ID: 21
    PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA),
    ///Asks for one parameter, by index, or by name where the index is -1.
    ///
    ///ID: 20
    PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA),
    ///Sets a parameter; PARAM_VALUE with its value is the answer.
    ///
    ///ID: 23
    PARAM_SET(PARAM_SET_DATA),
    ///One parameter of a component.
    ///
    ///ID: 22
    PARAM_VALUE(PARAM_VALUE_DATA),
    ///Channels of a receiver in µs; 65535 is no value.
    ///
    ///ID: 65
    RC_CHANNELS(RC_CHANNELS_DATA),
    ///RC channels in µs, for one component.
    ///
    ///ID: 70
    RC_CHANNELS_OVERRIDE(RC_CHANNELS_OVERRIDE_DATA),
    ///Relays, a bit for each: which are on, and which are there.
    ///
    ///ID: 376
    RELAY_STATUS(RELAY_STATUS_DATA),
    ///Outputs of an autopilot in µs; port 0 has 1 to 16, port 1 has 17 to 32; 0 is no output.
    ///
    ///ID: 36
    SERVO_OUTPUT_RAW(SERVO_OUTPUT_RAW_DATA),
    ///A key for signing; zeros clear it.
    ///
    ///ID: 256
    SETUP_SIGNING(SETUP_SIGNING_DATA),
    ///A text for people; a longer one comes in pieces of 50 bytes with the same id.
    ///
    ///ID: 253
    STATUSTEXT(STATUSTEXT_DATA),
}
impl MavMessage {
    pub const fn all_ids() -> &'static [u32] {
        &[
            0u32, 20u32, 21u32, 22u32, 23u32, 36u32, 65u32, 70u32, 75u32, 76u32, 77u32,
            80u32, 225u32, 251u32, 253u32, 256u32, 376u32,
        ]
    }
    pub const fn all_messages() -> &'static [(&'static str, u32)] {
        &[
            (HEARTBEAT_DATA::NAME, HEARTBEAT_DATA::ID),
            (PARAM_REQUEST_READ_DATA::NAME, PARAM_REQUEST_READ_DATA::ID),
            (PARAM_REQUEST_LIST_DATA::NAME, PARAM_REQUEST_LIST_DATA::ID),
            (PARAM_VALUE_DATA::NAME, PARAM_VALUE_DATA::ID),
            (PARAM_SET_DATA::NAME, PARAM_SET_DATA::ID),
            (SERVO_OUTPUT_RAW_DATA::NAME, SERVO_OUTPUT_RAW_DATA::ID),
            (RC_CHANNELS_DATA::NAME, RC_CHANNELS_DATA::ID),
            (RC_CHANNELS_OVERRIDE_DATA::NAME, RC_CHANNELS_OVERRIDE_DATA::ID),
            (COMMAND_INT_DATA::NAME, COMMAND_INT_DATA::ID),
            (COMMAND_LONG_DATA::NAME, COMMAND_LONG_DATA::ID),
            (COMMAND_ACK_DATA::NAME, COMMAND_ACK_DATA::ID),
            (COMMAND_CANCEL_DATA::NAME, COMMAND_CANCEL_DATA::ID),
            (EFI_STATUS_DATA::NAME, EFI_STATUS_DATA::ID),
            (NAMED_VALUE_FLOAT_DATA::NAME, NAMED_VALUE_FLOAT_DATA::ID),
            (STATUSTEXT_DATA::NAME, STATUSTEXT_DATA::ID),
            (SETUP_SIGNING_DATA::NAME, SETUP_SIGNING_DATA::ID),
            (RELAY_STATUS_DATA::NAME, RELAY_STATUS_DATA::ID),
        ]
    }
}
impl Message for MavMessage {
    fn parse(
        version: MavlinkVersion,
        id: u32,
        payload: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        match id {
            COMMAND_ACK_DATA::ID => {
                COMMAND_ACK_DATA::deser(version, payload).map(Self::COMMAND_ACK)
            }
            COMMAND_CANCEL_DATA::ID => {
                COMMAND_CANCEL_DATA::deser(version, payload).map(Self::COMMAND_CANCEL)
            }
            COMMAND_INT_DATA::ID => {
                COMMAND_INT_DATA::deser(version, payload).map(Self::COMMAND_INT)
            }
            COMMAND_LONG_DATA::ID => {
                COMMAND_LONG_DATA::deser(version, payload).map(Self::COMMAND_LONG)
            }
            EFI_STATUS_DATA::ID => {
                EFI_STATUS_DATA::deser(version, payload).map(Self::EFI_STATUS)
            }
            HEARTBEAT_DATA::ID => {
                HEARTBEAT_DATA::deser(version, payload).map(Self::HEARTBEAT)
            }
            NAMED_VALUE_FLOAT_DATA::ID => {
                NAMED_VALUE_FLOAT_DATA::deser(version, payload)
                    .map(Self::NAMED_VALUE_FLOAT)
            }
            PARAM_REQUEST_LIST_DATA::ID => {
                PARAM_REQUEST_LIST_DATA::deser(version, payload)
                    .map(Self::PARAM_REQUEST_LIST)
            }
            PARAM_REQUEST_READ_DATA::ID => {
                PARAM_REQUEST_READ_DATA::deser(version, payload)
                    .map(Self::PARAM_REQUEST_READ)
            }
            PARAM_SET_DATA::ID => {
                PARAM_SET_DATA::deser(version, payload).map(Self::PARAM_SET)
            }
            PARAM_VALUE_DATA::ID => {
                PARAM_VALUE_DATA::deser(version, payload).map(Self::PARAM_VALUE)
            }
            RC_CHANNELS_DATA::ID => {
                RC_CHANNELS_DATA::deser(version, payload).map(Self::RC_CHANNELS)
            }
            RC_CHANNELS_OVERRIDE_DATA::ID => {
                RC_CHANNELS_OVERRIDE_DATA::deser(version, payload)
                    .map(Self::RC_CHANNELS_OVERRIDE)
            }
            RELAY_STATUS_DATA::ID => {
                RELAY_STATUS_DATA::deser(version, payload).map(Self::RELAY_STATUS)
            }
            SERVO_OUTPUT_RAW_DATA::ID => {
                SERVO_OUTPUT_RAW_DATA::deser(version, payload)
                    .map(Self::SERVO_OUTPUT_RAW)
            }
            SETUP_SIGNING_DATA::ID => {
                SETUP_SIGNING_DATA::deser(version, payload).map(Self::SETUP_SIGNING)
            }
            STATUSTEXT_DATA::ID => {
                STATUSTEXT_DATA::deser(version, payload).map(Self::STATUSTEXT)
            }
            _ => {
                Err(::mavlink_core::error::ParserError::UnknownMessage {
                    id,
                })
            }
        }
    }
    fn message_name(&self) -> &'static str {
        match self {
            Self::COMMAND_ACK(..) => COMMAND_ACK_DATA::NAME,
            Self::COMMAND_CANCEL(..) => COMMAND_CANCEL_DATA::NAME,
            Self::COMMAND_INT(..) => COMMAND_INT_DATA::NAME,
            Self::COMMAND_LONG(..) => COMMAND_LONG_DATA::NAME,
            Self::EFI_STATUS(..) => EFI_STATUS_DATA::NAME,
            Self::HEARTBEAT(..) => HEARTBEAT_DATA::NAME,
            Self::NAMED_VALUE_FLOAT(..) => NAMED_VALUE_FLOAT_DATA::NAME,
            Self::PARAM_REQUEST_LIST(..) => PARAM_REQUEST_LIST_DATA::NAME,
            Self::PARAM_REQUEST_READ(..) => PARAM_REQUEST_READ_DATA::NAME,
            Self::PARAM_SET(..) => PARAM_SET_DATA::NAME,
            Self::PARAM_VALUE(..) => PARAM_VALUE_DATA::NAME,
            Self::RC_CHANNELS(..) => RC_CHANNELS_DATA::NAME,
            Self::RC_CHANNELS_OVERRIDE(..) => RC_CHANNELS_OVERRIDE_DATA::NAME,
            Self::RELAY_STATUS(..) => RELAY_STATUS_DATA::NAME,
            Self::SERVO_OUTPUT_RAW(..) => SERVO_OUTPUT_RAW_DATA::NAME,
            Self::SETUP_SIGNING(..) => SETUP_SIGNING_DATA::NAME,
            Self::STATUSTEXT(..) => STATUSTEXT_DATA::NAME,
        }
    }
    fn message_id(&self) -> u32 {
        match self {
            Self::COMMAND_ACK(..) => COMMAND_ACK_DATA::ID,
            Self::COMMAND_CANCEL(..) => COMMAND_CANCEL_DATA::ID,
            Self::COMMAND_INT(..) => COMMAND_INT_DATA::ID,
            Self::COMMAND_LONG(..) => COMMAND_LONG_DATA::ID,
            Self::EFI_STATUS(..) => EFI_STATUS_DATA::ID,
            Self::HEARTBEAT(..) => HEARTBEAT_DATA::ID,
            Self::NAMED_VALUE_FLOAT(..) => NAMED_VALUE_FLOAT_DATA::ID,
            Self::PARAM_REQUEST_LIST(..) => PARAM_REQUEST_LIST_DATA::ID,
            Self::PARAM_REQUEST_READ(..) => PARAM_REQUEST_READ_DATA::ID,
            Self::PARAM_SET(..) => PARAM_SET_DATA::ID,
            Self::PARAM_VALUE(..) => PARAM_VALUE_DATA::ID,
            Self::RC_CHANNELS(..) => RC_CHANNELS_DATA::ID,
            Self::RC_CHANNELS_OVERRIDE(..) => RC_CHANNELS_OVERRIDE_DATA::ID,
            Self::RELAY_STATUS(..) => RELAY_STATUS_DATA::ID,
            Self::SERVO_OUTPUT_RAW(..) => SERVO_OUTPUT_RAW_DATA::ID,
            Self::SETUP_SIGNING(..) => SETUP_SIGNING_DATA::ID,
            Self::STATUSTEXT(..) => STATUSTEXT_DATA::ID,
        }
    }
    fn message_id_from_name(name: &str) -> Option<u32> {
        match name {
            COMMAND_ACK_DATA::NAME => Some(COMMAND_ACK_DATA::ID),
            COMMAND_CANCEL_DATA::NAME => Some(COMMAND_CANCEL_DATA::ID),
            COMMAND_INT_DATA::NAME => Some(COMMAND_INT_DATA::ID),
            COMMAND_LONG_DATA::NAME => Some(COMMAND_LONG_DATA::ID),
            EFI_STATUS_DATA::NAME => Some(EFI_STATUS_DATA::ID),
            HEARTBEAT_DATA::NAME => Some(HEARTBEAT_DATA::ID),
            NAMED_VALUE_FLOAT_DATA::NAME => Some(NAMED_VALUE_FLOAT_DATA::ID),
            PARAM_REQUEST_LIST_DATA::NAME => Some(PARAM_REQUEST_LIST_DATA::ID),
            PARAM_REQUEST_READ_DATA::NAME => Some(PARAM_REQUEST_READ_DATA::ID),
            PARAM_SET_DATA::NAME => Some(PARAM_SET_DATA::ID),
            PARAM_VALUE_DATA::NAME => Some(PARAM_VALUE_DATA::ID),
            RC_CHANNELS_DATA::NAME => Some(RC_CHANNELS_DATA::ID),
            RC_CHANNELS_OVERRIDE_DATA::NAME => Some(RC_CHANNELS_OVERRIDE_DATA::ID),
            RELAY_STATUS_DATA::NAME => Some(RELAY_STATUS_DATA::ID),
            SERVO_OUTPUT_RAW_DATA::NAME => Some(SERVO_OUTPUT_RAW_DATA::ID),
            SETUP_SIGNING_DATA::NAME => Some(SETUP_SIGNING_DATA::ID),
            STATUSTEXT_DATA::NAME => Some(STATUSTEXT_DATA::ID),
            _ => None,
        }
    }
    fn default_message_from_id(id: u32) -> Option<Self> {
        match id {
            COMMAND_ACK_DATA::ID => Some(Self::COMMAND_ACK(COMMAND_ACK_DATA::default())),
            COMMAND_CANCEL_DATA::ID => {
                Some(Self::COMMAND_CANCEL(COMMAND_CANCEL_DATA::default()))
            }
            COMMAND_INT_DATA::ID => Some(Self::COMMAND_INT(COMMAND_INT_DATA::default())),
            COMMAND_LONG_DATA::ID => {
                Some(Self::COMMAND_LONG(COMMAND_LONG_DATA::default()))
            }
            EFI_STATUS_DATA::ID => Some(Self::EFI_STATUS(EFI_STATUS_DATA::default())),
            HEARTBEAT_DATA::ID => Some(Self::HEARTBEAT(HEARTBEAT_DATA::default())),
            NAMED_VALUE_FLOAT_DATA::ID => {
                Some(Self::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA::default()))
            }
            PARAM_REQUEST_LIST_DATA::ID => {
                Some(Self::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA::default()))
            }
            PARAM_REQUEST_READ_DATA::ID => {
                Some(Self::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA::default()))
            }
            PARAM_SET_DATA::ID => Some(Self::PARAM_SET(PARAM_SET_DATA::default())),
            PARAM_VALUE_DATA::ID => Some(Self::PARAM_VALUE(PARAM_VALUE_DATA::default())),
            RC_CHANNELS_DATA::ID => Some(Self::RC_CHANNELS(RC_CHANNELS_DATA::default())),
            RC_CHANNELS_OVERRIDE_DATA::ID => {
                Some(Self::RC_CHANNELS_OVERRIDE(RC_CHANNELS_OVERRIDE_DATA::default()))
            }
            RELAY_STATUS_DATA::ID => {
                Some(Self::RELAY_STATUS(RELAY_STATUS_DATA::default()))
            }
            SERVO_OUTPUT_RAW_DATA::ID => {
                Some(Self::SERVO_OUTPUT_RAW(SERVO_OUTPUT_RAW_DATA::default()))
            }
            SETUP_SIGNING_DATA::ID => {
                Some(Self::SETUP_SIGNING(SETUP_SIGNING_DATA::default()))
            }
            STATUSTEXT_DATA::ID => Some(Self::STATUSTEXT(STATUSTEXT_DATA::default())),
            _ => None,
        }
    }
    #[cfg(feature = "arbitrary")]
    fn random_message_from_id<R: rand::Rng>(id: u32, rng: &mut R) -> Option<Self> {
        match id {
            COMMAND_ACK_DATA::ID => {
                Some(Self::COMMAND_ACK(COMMAND_ACK_DATA::random(rng)))
            }
            COMMAND_CANCEL_DATA::ID => {
                Some(Self::COMMAND_CANCEL(COMMAND_CANCEL_DATA::random(rng)))
            }
            COMMAND_INT_DATA::ID => {
                Some(Self::COMMAND_INT(COMMAND_INT_DATA::random(rng)))
            }
            COMMAND_LONG_DATA::ID => {
                Some(Self::COMMAND_LONG(COMMAND_LONG_DATA::random(rng)))
            }
            EFI_STATUS_DATA::ID => Some(Self::EFI_STATUS(EFI_STATUS_DATA::random(rng))),
            HEARTBEAT_DATA::ID => Some(Self::HEARTBEAT(HEARTBEAT_DATA::random(rng))),
            NAMED_VALUE_FLOAT_DATA::ID => {
                Some(Self::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA::random(rng)))
            }
            PARAM_REQUEST_LIST_DATA::ID => {
                Some(Self::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA::random(rng)))
            }
            PARAM_REQUEST_READ_DATA::ID => {
                Some(Self::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA::random(rng)))
            }
            PARAM_SET_DATA::ID => Some(Self::PARAM_SET(PARAM_SET_DATA::random(rng))),
            PARAM_VALUE_DATA::ID => {
                Some(Self::PARAM_VALUE(PARAM_VALUE_DATA::random(rng)))
            }
            RC_CHANNELS_DATA::ID => {
                Some(Self::RC_CHANNELS(RC_CHANNELS_DATA::random(rng)))
            }
            RC_CHANNELS_OVERRIDE_DATA::ID => {
                Some(Self::RC_CHANNELS_OVERRIDE(RC_CHANNELS_OVERRIDE_DATA::random(rng)))
            }
            RELAY_STATUS_DATA::ID => {
                Some(Self::RELAY_STATUS(RELAY_STATUS_DATA::random(rng)))
            }
            SERVO_OUTPUT_RAW_DATA::ID => {
                Some(Self::SERVO_OUTPUT_RAW(SERVO_OUTPUT_RAW_DATA::random(rng)))
            }
            SETUP_SIGNING_DATA::ID => {
                Some(Self::SETUP_SIGNING(SETUP_SIGNING_DATA::random(rng)))
            }
            STATUSTEXT_DATA::ID => Some(Self::STATUSTEXT(STATUSTEXT_DATA::random(rng))),
            _ => None,
        }
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        match self {
            Self::COMMAND_ACK(body) => body.ser(version, bytes),
            Self::COMMAND_CANCEL(body) => body.ser(version, bytes),
            Self::COMMAND_INT(body) => body.ser(version, bytes),
            Self::COMMAND_LONG(body) => body.ser(version, bytes),
            Self::EFI_STATUS(body) => body.ser(version, bytes),
            Self::HEARTBEAT(body) => body.ser(version, bytes),
            Self::NAMED_VALUE_FLOAT(body) => body.ser(version, bytes),
            Self::PARAM_REQUEST_LIST(body) => body.ser(version, bytes),
            Self::PARAM_REQUEST_READ(body) => body.ser(version, bytes),
            Self::PARAM_SET(body) => body.ser(version, bytes),
            Self::PARAM_VALUE(body) => body.ser(version, bytes),
            Self::RC_CHANNELS(body) => body.ser(version, bytes),
            Self::RC_CHANNELS_OVERRIDE(body) => body.ser(version, bytes),
            Self::RELAY_STATUS(body) => body.ser(version, bytes),
            Self::SERVO_OUTPUT_RAW(body) => body.ser(version, bytes),
            Self::SETUP_SIGNING(body) => body.ser(version, bytes),
            Self::STATUSTEXT(body) => body.ser(version, bytes),
        }
    }
    fn extra_crc(id: u32) -> u8 {
        match id {
            COMMAND_ACK_DATA::ID => COMMAND_ACK_DATA::EXTRA_CRC,
            COMMAND_CANCEL_DATA::ID => COMMAND_CANCEL_DATA::EXTRA_CRC,
            COMMAND_INT_DATA::ID => COMMAND_INT_DATA::EXTRA_CRC,
            COMMAND_LONG_DATA::ID => COMMAND_LONG_DATA::EXTRA_CRC,
            EFI_STATUS_DATA::ID => EFI_STATUS_DATA::EXTRA_CRC,
            HEARTBEAT_DATA::ID => HEARTBEAT_DATA::EXTRA_CRC,
            NAMED_VALUE_FLOAT_DATA::ID => NAMED_VALUE_FLOAT_DATA::EXTRA_CRC,
            PARAM_REQUEST_LIST_DATA::ID => PARAM_REQUEST_LIST_DATA::EXTRA_CRC,
            PARAM_REQUEST_READ_DATA::ID => PARAM_REQUEST_READ_DATA::EXTRA_CRC,
            PARAM_SET_DATA::ID => PARAM_SET_DATA::EXTRA_CRC,
            PARAM_VALUE_DATA::ID => PARAM_VALUE_DATA::EXTRA_CRC,
            RC_CHANNELS_DATA::ID => RC_CHANNELS_DATA::EXTRA_CRC,
            RC_CHANNELS_OVERRIDE_DATA::ID => RC_CHANNELS_OVERRIDE_DATA::EXTRA_CRC,
            RELAY_STATUS_DATA::ID => RELAY_STATUS_DATA::EXTRA_CRC,
            SERVO_OUTPUT_RAW_DATA::ID => SERVO_OUTPUT_RAW_DATA::EXTRA_CRC,
            SETUP_SIGNING_DATA::ID => SETUP_SIGNING_DATA::EXTRA_CRC,
            STATUSTEXT_DATA::ID => STATUSTEXT_DATA::EXTRA_CRC,
            _ => 0,
        }
    }
    fn target_system_id(&self) -> Option<u8> {
        match self {
            Self::COMMAND_ACK(inner) => Some(inner.target_system),
            Self::COMMAND_CANCEL(inner) => Some(inner.target_system),
            Self::COMMAND_INT(inner) => Some(inner.target_system),
            Self::COMMAND_LONG(inner) => Some(inner.target_system),
            Self::PARAM_REQUEST_LIST(inner) => Some(inner.target_system),
            Self::PARAM_REQUEST_READ(inner) => Some(inner.target_system),
            Self::PARAM_SET(inner) => Some(inner.target_system),
            Self::RC_CHANNELS_OVERRIDE(inner) => Some(inner.target_system),
            Self::SETUP_SIGNING(inner) => Some(inner.target_system),
            _ => None,
        }
    }
    fn target_system_id_mut(&mut self) -> Option<&mut u8> {
        match self {
            Self::COMMAND_ACK(inner) => Some(&mut inner.target_system),
            Self::COMMAND_CANCEL(inner) => Some(&mut inner.target_system),
            Self::COMMAND_INT(inner) => Some(&mut inner.target_system),
            Self::COMMAND_LONG(inner) => Some(&mut inner.target_system),
            Self::PARAM_REQUEST_LIST(inner) => Some(&mut inner.target_system),
            Self::PARAM_REQUEST_READ(inner) => Some(&mut inner.target_system),
            Self::PARAM_SET(inner) => Some(&mut inner.target_system),
            Self::RC_CHANNELS_OVERRIDE(inner) => Some(&mut inner.target_system),
            Self::SETUP_SIGNING(inner) => Some(&mut inner.target_system),
            _ => None,
        }
    }
    fn target_component_id(&self) -> Option<u8> {
        match self {
            Self::COMMAND_ACK(inner) => Some(inner.target_component),
            Self::COMMAND_CANCEL(inner) => Some(inner.target_component),
            Self::COMMAND_INT(inner) => Some(inner.target_component),
            Self::COMMAND_LONG(inner) => Some(inner.target_component),
            Self::PARAM_REQUEST_LIST(inner) => Some(inner.target_component),
            Self::PARAM_REQUEST_READ(inner) => Some(inner.target_component),
            Self::PARAM_SET(inner) => Some(inner.target_component),
            Self::RC_CHANNELS_OVERRIDE(inner) => Some(inner.target_component),
            Self::SETUP_SIGNING(inner) => Some(inner.target_component),
            _ => None,
        }
    }
    fn target_component_id_mut(&mut self) -> Option<&mut u8> {
        match self {
            Self::COMMAND_ACK(inner) => Some(&mut inner.target_component),
            Self::COMMAND_CANCEL(inner) => Some(&mut inner.target_component),
            Self::COMMAND_INT(inner) => Some(&mut inner.target_component),
            Self::COMMAND_LONG(inner) => Some(&mut inner.target_component),
            Self::PARAM_REQUEST_LIST(inner) => Some(&mut inner.target_component),
            Self::PARAM_REQUEST_READ(inner) => Some(&mut inner.target_component),
            Self::PARAM_SET(inner) => Some(&mut inner.target_component),
            Self::RC_CHANNELS_OVERRIDE(inner) => Some(&mut inner.target_component),
            Self::SETUP_SIGNING(inner) => Some(&mut inner.target_component),
            _ => None,
        }
    }
}
