//! Numbers and addresses of MAVLink that jetlink uses, as in the MAVLink documents. Received numbers stay numbers: an unknown one is
//! answered, not dropped.

/// Largest frame: header, payload, checksum and signature.
pub const MAX_FRAME: usize = 10 + 255 + 2 + 13;

/// Component of a system on the network.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Address {
    /// System: a vehicle or a ground station.
    pub system: u8,
    /// Component of the system.
    pub component: u8,
}

/// `COMMAND_*`: `MAV_CMD_DO_FLIGHTTERMINATION`.
pub const CMD_DO_FLIGHTTERMINATION: u16 = 185;
/// `MAV_CMD_DO_ENGINE_CONTROL`.
pub const CMD_DO_ENGINE_CONTROL: u16 = 223;
/// `MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN`.
pub const CMD_PREFLIGHT_REBOOT_SHUTDOWN: u16 = 246;
/// `MAV_CMD_SET_MESSAGE_INTERVAL`.
pub const CMD_SET_MESSAGE_INTERVAL: u16 = 511;
/// `MAV_CMD_REQUEST_MESSAGE`.
pub const CMD_REQUEST_MESSAGE: u16 = 512;
/// `MAV_CMD_USER_1`: the services of jetlink.
pub const CMD_USER_1: u16 = 31010;

/// `MAV_COMP_ID_AUTOPILOT1`.
pub const COMPONENT_AUTOPILOT: u8 = 1;

/// Message `HEARTBEAT`.
pub const MESSAGE_HEARTBEAT: u32 = 0;
/// Message `SERVO_OUTPUT_RAW`.
pub const MESSAGE_SERVO_OUTPUT_RAW: u32 = 36;
/// Message `RC_CHANNELS`.
pub const MESSAGE_RC_CHANNELS: u32 = 65;
/// Message `EFI_STATUS`.
pub const MESSAGE_EFI_STATUS: u32 = 225;
/// Message `NAMED_VALUE_FLOAT`.
pub const MESSAGE_NAMED_VALUE_FLOAT: u32 = 251;

/// Message `RELAY_STATUS`.
pub const MESSAGE_RELAY_STATUS: u32 = 376;

/// `MAV_TYPE_GENERIC`.
pub const TYPE_GENERIC: u8 = 0;
/// `MAV_TYPE_GCS`.
pub const TYPE_GCS: u8 = 6;
/// `MAV_AUTOPILOT_INVALID`: no autopilot.
pub const AUTOPILOT_INVALID: u8 = 8;
/// `MAV_MODE_FLAG_CUSTOM_MODE_ENABLED`: `custom_mode` means something.
pub const MODE_CUSTOM: u8 = 1;
/// `MAV_MODE_FLAG_SAFETY_ARMED`.
pub const MODE_ARMED: u8 = 128;

/// `MAV_PARAM_TYPE_REAL32`.
pub const PARAM_REAL32: u8 = 9;

/// `MAV_RESULT`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Ack {
    /// Carried out, or begun.
    Accepted = 0,
    /// Not now.
    TemporarilyRejected = 1,
    /// Never with these values, or not from this system.
    Denied = 2,
    /// Unknown here.
    Unsupported = 3,
    /// It began, and failed.
    Failed = 4,
    /// It has begun: another answer follows.
    InProgress = 5,
    /// Cancelled by `COMMAND_CANCEL`.
    Cancelled = 6,
}

/// `MAV_SEVERITY`.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Severity {
    /// The engine or the vehicle is in danger.
    Critical = 2,
    /// Something failed.
    Error = 3,
    /// Something may fail, or was refused.
    Warning = 4,
    /// Worth a look.
    Notice = 5,
    /// Normal.
    Info = 6,
}

/// `MAV_STATE`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SystemStatus {
    /// Not known.
    Uninit = 0,
    /// Ready.
    Standby = 3,
    /// At work.
    Active = 4,
    /// Something is wrong.
    Critical = 5,
    /// An emergency stop is latched.
    FlightTermination = 8,
}
