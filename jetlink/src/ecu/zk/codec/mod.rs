//! ZK-Protocol V1.2: bytes and typed frames, with scale and offset. Knows no time.
//!
//! ```text
//! control, host to ECU:  0xFF | ID·4 … payload | payload | CRC          4 bytes, CRC over bytes 1..=2
//! status,  ECU to host:  0xF0+ID | rpm/10 LSB | rpm/10 MSB | 3 bytes | CRC   7 bytes, CRC over bytes 0..=5
//! ```

mod control;
mod decoder;
mod frame;
mod rate;
mod status;
mod version;

pub use control::{
    AccelerationCurve, Action, Control, ControlError, IgnitionPumpVoltage, RpmCode, RpmFactor, Switch,
};
pub use decoder::{Decoder, DecoderCounters};
pub use frame::{CONTROL_HEAD, CONTROL_LEN, STATUS_LEN, crc8};
pub use rate::Rate;
pub use status::{ErrorCode, IdleDetails, State, Status, StatusFrame, SwitchStatus, VoltageByte};
pub use version::{Since, Version};
