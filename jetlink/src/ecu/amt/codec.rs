//! AMT serial control (version 20140617): bytes and typed frames, with scale and offset. Knows no time.
//!
//! ```text
//! telemetry, ECU to host:  0xFF | Data1 | Data2 | Data3 | Data4 | Data5          6 bytes
//! set-up,    ECU to host:  0xFF | 0x05 | PWTH | PWTL | PWDIFF | 12 or 13 bytes of text
//! control,   host to ECU:  0xFF | OPS | THR | OPS | THR                          5 bytes
//! ```
//!
//! There is no checksum. No data byte is ever 0xFF, so 0xFF always starts a frame (AMT-1).

use crate::codes::{closed_enum, open_enum};
use crate::ecu::decoder::feed;
use crate::ecu::vendor::VendorFaults;
use crate::sentence::sentences;
use crate::units::{Celsius, Millivolts, Throttle};

/// First byte of every frame in both directions.
pub const LEADER: u8 = 0xFF;
/// Bytes of a control message.
pub const CONTROL_LEN: usize = 5;
/// Bytes of every telemetry frame but the set-up set.
pub const FRAME_LEN: usize = 6;
/// Bytes of the longest frame: the set-up set with the new text.
pub const MAX_FRAME_LEN: usize = 18;

const SETUP: u8 = 0x05;
const TEXT: usize = 5;

// ---------------------------------------------------------------------------------------------
// Engines and their scales
// ---------------------------------------------------------------------------------------------

closed_enum! {
    /// An AMT engine. It gives telemetry its scale.
    #[non_exhaustive]
    pub enum EngineModel {
        /// Mercury.
        Mercury => "mercury",
        /// Pegasus.
        Pegasus => "pegasus",
        /// Olympus.
        Olympus => "olympus",
        /// Titan.
        Titan => "titan",
        /// Nike.
        Nike => "nike",
        /// Lynx.
        Lynx => "lynx",
        /// Orion (field fact: its ID is not in the document, AMT-4).
        Orion => "orion",
    }
}

/// Scale of a voltage byte: `offset + raw × full scale / 255`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct VoltageScale {
    /// Added to every value, in mV.
    pub offset_mv: u16,
    /// Added by a raw 255, in mV.
    pub full_scale_mv: u16,
}

impl VoltageScale {
    const fn new(offset_mv: u16, full_scale_mv: u16) -> Self {
        Self { offset_mv, full_scale_mv }
    }

    /// The voltage of a byte, rounded to the nearest mV.
    pub const fn millivolts(self, raw: u8) -> Millivolts {
        let scaled = (raw as u32 * self.full_scale_mv as u32 + 127) / 255;
        Millivolts::new(self.offset_mv as u32 + scaled)
    }
}

impl EngineModel {
    /// From the engine ID of an alternate set, old and new numbers (AMT-4).
    pub const fn from_id(id: u8) -> Option<Self> {
        match id {
            0x07 | 0x08 => Some(Self::Mercury),
            0x03 | 0x10 => Some(Self::Pegasus),
            0x06 | 0x18 => Some(Self::Olympus),
            0x20 => Some(Self::Titan),
            0x28 => Some(Self::Nike),
            0x30 => Some(Self::Lynx),
            0x38 => Some(Self::Orion),
            _ => None,
        }
    }

    /// From the first number of the software version in the set-up set (AMT-9).
    pub const fn from_version(major: u8) -> Option<Self> {
        match major {
            1 | 2 | 4 | 7 => Some(Self::Pegasus),
            3 | 6 | 9 => Some(Self::Olympus),
            5 | 8 => Some(Self::Mercury),
            10 => Some(Self::Titan),
            12 => Some(Self::Nike),
            14 => Some(Self::Lynx),
            _ => None,
        }
    }

    /// Revolutions per minute for one step of the rpm byte. `None` if the document gives none: the value
    /// then stays raw (AMT-5).
    pub const fn rpm_step(self) -> Option<u32> {
        match self {
            Self::Pegasus | Self::Olympus | Self::Titan => Some(500),
            Self::Mercury => Some(700),
            Self::Nike | Self::Lynx | Self::Orion => None,
        }
    }

    /// Scale of Vout and of the idle and maximum rpm voltages (AMT-6).
    pub const fn vout_scale(self) -> Option<VoltageScale> {
        match self {
            Self::Mercury | Self::Pegasus => Some(VoltageScale::new(0, 6250)),
            Self::Olympus | Self::Titan | Self::Nike => Some(VoltageScale::new(0, 8300)),
            Self::Lynx | Self::Orion => None,
        }
    }

    /// Scale of the battery voltage; the document omits Nike (AMT-6).
    pub const fn battery_scale(self) -> Option<VoltageScale> {
        match self {
            Self::Mercury | Self::Pegasus | Self::Olympus | Self::Titan => Some(VoltageScale::new(0, 10_000)),
            Self::Nike | Self::Lynx | Self::Orion => None,
        }
    }

    /// Scale of the external battery voltage (AMT-6).
    pub const fn external_scale(self) -> Option<VoltageScale> {
        match self {
            Self::Mercury | Self::Pegasus => Some(VoltageScale::new(7000, 6250)),
            Self::Olympus | Self::Titan | Self::Nike => Some(VoltageScale::new(7000, 9300)),
            Self::Lynx | Self::Orion => None,
        }
    }
}

// ---------------------------------------------------------------------------------------------
// Control: host to ECU
// ---------------------------------------------------------------------------------------------

closed_enum! {
    /// The operator switch OPS (AMT-10).
    pub enum Ops {
        /// 0x11: emergency stop.
        EmergencyStop = 0x11,
        /// 0x12: auto stop, the normal way to shut down.
        AutoStop = 0x12,
        /// 0x14: run; from auto stop it commands a start (AMT-14).
        Run = 0x14,
        /// 0x91: CTF, a special function: while running it stops the engine after the ECU's serial delay
        /// time (AMT-13).
        Ctf = 0x91,
    }
}

/// A control message. Its switch and throttle are sent twice; an ECU ignores copies that differ (AMT-10).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Control {
    /// Operator switch.
    pub ops: Ops,
    /// Throttle. The wire carries steps of 0.5 %; it is rounded down, never up.
    pub throttle: Throttle,
}

/// Reason why five bytes are not a control message.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum ControlError {
    /// The first byte is not 0xFF.
    Leader(u8),
    /// The two copies differ.
    CopiesDiffer,
    /// Not one of the four switch positions.
    Ops(u8),
    /// Outside 32..=232.
    Throttle(u8),
}

sentences!(ControlError {
    Self::CopiesDiffer => "the two copies of switch and throttle differ";
} {
    Self::Leader(byte) => "a control message starts with 0xFF, not {:#04x}", byte;
    Self::Ops(ops) => "switch {:#04x} is none of 0x11, 0x12, 0x14, 0x91", ops;
    Self::Throttle(thr) => "throttle byte {} is outside 32..=232", thr;
});

impl core::error::Error for ControlError {}

impl Control {
    /// The bytes for the wire: THR = 2 × percent + 32, so 32..=232 and never 0xFF (AMT-10).
    pub const fn encode(self) -> [u8; CONTROL_LEN] {
        let ops = self.ops.code();
        // At most 1000 / 5 + 32 = 232.
        let thr = (self.throttle.tenths() / 5 + 32) as u8;
        [LEADER, ops, thr, ops, thr]
    }

    /// From the bytes on the wire, for programs that read a host's commands.
    ///
    /// # Errors
    /// [`ControlError`] with the reason.
    pub fn decode(bytes: [u8; CONTROL_LEN]) -> Result<Self, ControlError> {
        let [leader, ops, thr, ops_copy, thr_copy] = bytes;
        if leader != LEADER {
            return Err(ControlError::Leader(leader));
        }
        if ops != ops_copy || thr != thr_copy {
            return Err(ControlError::CopiesDiffer);
        }
        let throttle = thr
            .checked_sub(32)
            .and_then(|half_percent| Throttle::from_tenths(u16::from(half_percent) * 5).ok());
        Ok(Self {
            ops: Ops::from_code(ops).ok_or(ControlError::Ops(ops))?,
            throttle: throttle.ok_or(ControlError::Throttle(thr))?,
        })
    }
}

// ---------------------------------------------------------------------------------------------
// Telemetry: ECU to host
// ---------------------------------------------------------------------------------------------

open_enum! {
    /// Engine state, Data1 bits 7..3 of a normal set (AMT-3).
    pub enum State {
        /// 00000 with a switch position (field fact).
        NoStartClearance = 0b00000 => "no-start-clearance",
        /// 00001.
        StartClearance = 0b00001 => "start-clearance",
        /// 00010.
        Starting = 0b00010 => "starting",
        /// 00100.
        StartedUp = 0b00100 => "started-up",
        /// 01000.
        IdleCalibration = 0b01000 => "idle-calibration",
        /// 01100: full operation, the turbine runs.
        FullOperation = 0b01100 => "full-operation",
        /// 10000: maximum rpm reached.
        MaxRpm = 0b10000 => "max-rpm",
        /// 11100: maximum rpm reached, as some ECUs send it (field fact).
        MaxRpmField = 0b11100 => "max-rpm",
    }
}

closed_enum! {
    /// Operator switch as the ECU reports it, Data1 bits 2..0 of a normal set.
    pub enum SwitchPosition {
        /// 001.
        EmergencyStop = 0b001 => "emergency-stop",
        /// 010.
        AutoStop = 0b010 => "auto-stop",
        /// 100.
        Run = 0b100 => "run",
    }
}

/// Error bits, Data2 of an error set: several can be on at once (AMT-8).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ErrorBits(pub u8);

impl ErrorBits {
    /// Names in bit order; the document prints no meaning for bit 7.
    pub const NAMES: [&'static str; 8] = [
        "rpm-low",
        "switch-channel-missing",
        "throttle-channel-missing",
        "egt",
        "rpm-high",
        "supply-low",
        "autostart-supply-low",
        "bit7",
    ];

    /// The ECU reports its exhaust temperature as faulty.
    pub const fn egt(self) -> bool {
        self.0 & 1 << 3 != 0
    }

    /// Names of the bits that are set, in bit order.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        (0..).zip(Self::NAMES).filter(move |(bit, _)| self.0 >> bit & 1 == 1).map(|(_, name)| name)
    }
}

impl VendorFaults for ErrorBits {
    fn number(self) -> u8 {
        self.0
    }
}

impl core::fmt::Display for ErrorBits {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        if self.0 == 0 {
            return f.write_str("none");
        }
        for (i, name) in self.names().enumerate() {
            if i > 0 {
                f.write_str(", ")?;
            }
            f.write_str(name)?;
        }
        Ok(())
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for ErrorBits {
    fn format(&self, f: defmt::Formatter<'_>) {
        if self.0 == 0 {
            return defmt::write!(f, "none");
        }
        for (i, name) in self.names().enumerate() {
            defmt::write!(f, "{=str}{=str}", if i > 0 { ", " } else { "" }, name);
        }
    }
}

/// EGT byte: °C = value × 4.6 − 50 (AMT-7).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct EgtByte(pub u8);

impl EgtByte {
    /// The temperature, exact in its steps of 4.6 °C.
    pub const fn celsius(self) -> Celsius {
        Celsius::from_tenths(self.0 as i16 * 46 - 500)
    }
}

/// Throttle byte: percent = value / 2 (AMT-7).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ThrottleByte(pub u8);

impl ThrottleByte {
    /// Tenths of a percent, exact; 0..=1275, because the document sets no limit.
    pub const fn tenths(self) -> u16 {
        self.0 as u16 * 5
    }

    /// The throttle; `None` above 100 %.
    pub const fn throttle(self) -> Option<Throttle> {
        match Throttle::from_tenths(self.tenths()) {
            Ok(throttle) => Some(throttle),
            Err(_) => None,
        }
    }
}

/// Content of a frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Message {
    /// Normal information.
    Normal {
        /// Operator switch that the ECU obeys.
        switch: SwitchPosition,
        /// Engine state.
        state: State,
        /// Raw rpm; its scale is [`EngineModel::rpm_step`].
        rpm: u8,
        /// Exhaust gas temperature.
        egt: EgtByte,
        /// Throttle.
        throttle: ThrottleByte,
        /// Raw Vout; its scale is [`EngineModel::vout_scale`].
        vout: u8,
    },
    /// Error information (AMT-8).
    Error {
        /// Errors.
        errors: ErrorBits,
        /// Exhaust gas temperature.
        egt: EgtByte,
        /// Throttle.
        throttle: ThrottleByte,
        /// Raw Vout; its scale is [`EngineModel::vout_scale`].
        vout: u8,
    },
    /// Alternate information: one after ten normal sets.
    Alternate {
        /// Engine ID as received; [`EngineModel::from_id`] identifies it.
        engine_id: u8,
        /// Raw idle voltage; its scale is [`EngineModel::vout_scale`].
        idle: u8,
        /// Raw maximum rpm voltage; its scale is [`EngineModel::vout_scale`].
        max: u8,
        /// Raw battery voltage; its scale is [`EngineModel::battery_scale`].
        battery: u8,
        /// Raw external battery voltage; its scale is [`EngineModel::external_scale`].
        external: u8,
    },
    /// ECU set-up, once after power-up (AMT-9).
    Setup(Setup),
    /// A kind the document does not name; its bytes are in the frame (AMT-2).
    Unknown,
}

/// The set-up set (AMT-9).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Setup {
    pw: [u8; 3],
    text: [u8; 13],
    new_text: bool,
}

impl Setup {
    /// Shortest pulse of the radio's switch channel in µs: 256 × PWTH + PWTL − 62464.
    pub const fn pw_min_us(&self) -> i32 {
        u16::from_be_bytes([self.pw[0], self.pw[1]]) as i32 - 62_464
    }

    /// Longest pulse in µs: shortest + 16 × PWDIFF.
    pub const fn pw_max_us(&self) -> i32 {
        self.pw_min_us() + self.pw[2] as i32 * 16
    }

    /// Software version as sent, for example `9.35` or `10.35`. Empty if it is not ASCII.
    pub fn version(&self) -> &str {
        self.ascii(0, self.version_len())
    }

    /// Software date as sent, YYMMDD. Empty if it is not ASCII.
    pub fn date(&self) -> &str {
        let start = self.version_len() + 1;
        self.ascii(start, start + 6)
    }

    /// The engine, identified by the version's first number.
    pub fn engine(&self) -> Option<EngineModel> {
        // Parsed as bytes: splitting and parsing text takes 0.6 kB of an image.
        let version = self.text.get(..self.version_len())?;
        let end = version.iter().position(|byte| *byte == b'.').filter(|_| version.is_ascii())?;
        let number = version.iter().take(end).try_fold(0_u8, |number, byte| {
            let digit = byte.checked_sub(b'0').filter(|digit| *digit <= 9)?;
            // No ECU sends a leading zero.
            number.checked_mul(10)?.checked_add(digit).filter(|number| *number > 0)
        });
        EngineModel::from_version(number?)
    }

    const fn version_len(&self) -> usize {
        if self.new_text { 5 } else { 4 }
    }

    fn ascii(&self, start: usize, end: usize) -> &str {
        let bytes = self.text.get(start..end).unwrap_or_default();
        if bytes.is_ascii() { core::str::from_utf8(bytes).unwrap_or_default() } else { "" }
    }
}

/// The kind of a frame, by its Data1 (AMT-2).
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Normal(SwitchPosition),
    Error,
    Alternate,
    Setup,
    Unknown,
}

impl Kind {
    const fn of(data1: u8) -> Self {
        match (data1, SwitchPosition::from_code(data1 & 7)) {
            (0x00, _) => Self::Error,
            (SETUP, _) => Self::Setup,
            (0x03 | 0x06 | 0x07, _) => Self::Alternate,
            (_, Some(switch)) => Self::Normal(switch),
            (_, None) if data1 & 7 == 0 => Self::Alternate,
            _ => Self::Unknown,
        }
    }
}

/// A complete frame from the ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Frame {
    bytes: [u8; MAX_FRAME_LEN],
    len: u8,
}

impl Frame {
    /// The bytes as received.
    pub fn raw(&self) -> &[u8] {
        self.bytes.get(..self.len.into()).unwrap_or_default()
    }

    fn kind(&self) -> Kind {
        Kind::of(self.bytes[1])
    }

    /// Its content.
    pub fn message(&self) -> Message {
        let [_, data1, data2, data3, data4, data5, ..] = self.bytes;
        match self.kind() {
            Kind::Normal(switch) => Message::Normal {
                switch,
                state: State::from_code(data1 >> 3),
                rpm: data2,
                egt: EgtByte(data3),
                throttle: ThrottleByte(data4),
                vout: data5,
            },
            Kind::Error => Message::Error {
                errors: ErrorBits(data2),
                egt: EgtByte(data3),
                throttle: ThrottleByte(data4),
                vout: data5,
            },
            Kind::Alternate => Message::Alternate {
                engine_id: data1,
                idle: data2,
                max: data3,
                battery: data4,
                external: data5,
            },
            Kind::Setup => Message::Setup(self.setup()),
            Kind::Unknown => Message::Unknown,
        }
    }

    fn setup(&self) -> Setup {
        let [_, _, pwth, pwtl, pwdiff, text @ ..] = self.bytes;
        Setup { pw: [pwth, pwtl, pwdiff], text, new_text: usize::from(self.len) == MAX_FRAME_LEN }
    }
}

// ---------------------------------------------------------------------------------------------
// Decoder
// ---------------------------------------------------------------------------------------------

/// Counters of a decoder. All wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct DecoderCounters {
    /// Frames, the unknown ones included.
    pub frames: u32,
    /// Frames of a kind the document does not name (AMT-2).
    pub unknown_frames: u32,
    /// Unfinished frames, because a 0xFF was received inside (AMT-1).
    pub truncated: u32,
    /// Set-up sets whose text has its full stop at neither place, so that their end is unknown (AMT-9).
    pub malformed: u32,
    /// Bytes that belonged to no frame, including those of truncated and malformed frames.
    pub bytes_skipped: u32,
}

/// Finds frames in a stream of bytes, in chunks of any size: 0xFF always starts one (AMT-1).
#[derive(Clone, Copy, Debug)]
pub struct Decoder {
    frame: Frame,
    counters: DecoderCounters,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// An empty one.
    pub const fn new() -> Self {
        Self {
            frame: Frame { bytes: [0; MAX_FRAME_LEN], len: 0 },
            counters: DecoderCounters {
                frames: 0,
                unknown_frames: 0,
                truncated: 0,
                malformed: 0,
                bytes_skipped: 0,
            },
        }
    }

    /// Takes bytes up to the end of the first frame. Returns how many it took, and the frame.
    /// Call it again while bytes are left.
    pub fn feed(&mut self, bytes: &[u8]) -> (usize, Option<Frame>) {
        feed(bytes, |byte| self.push(byte))
    }

    /// Its counters.
    pub const fn counters(&self) -> DecoderCounters {
        self.counters
    }

    /// Number of bytes of an unfinished frame.
    pub const fn pending(&self) -> usize {
        self.frame.len as usize
    }

    /// A byte was lost: the unfinished frame is discarded.
    pub fn byte_lost(&mut self) {
        if self.frame.len > 0 {
            self.counters.truncated = self.counters.truncated.wrapping_add(1);
            self.drop_frame();
        }
    }

    fn push(&mut self, byte: u8) -> Option<Frame> {
        if byte == LEADER {
            self.byte_lost();
        } else if self.frame.len == 0 {
            self.counters.bytes_skipped = self.counters.bytes_skipped.wrapping_add(1);
            return None;
        }
        let len = self.pending();
        if let Some(slot) = self.frame.bytes.get_mut(len) {
            *slot = byte;
            self.frame.len += 1;
        }
        match frame_len(self.frame.raw()) {
            Some(len) if self.pending() < len => None,
            Some(_) => {
                let frame = self.frame;
                self.frame = Frame { bytes: [0; MAX_FRAME_LEN], len: 0 };
                self.counters.frames = self.counters.frames.wrapping_add(1);
                if frame.kind() == Kind::Unknown {
                    self.counters.unknown_frames = self.counters.unknown_frames.wrapping_add(1);
                }
                Some(frame)
            }
            None => {
                self.counters.malformed = self.counters.malformed.wrapping_add(1);
                self.drop_frame();
                None
            }
        }
    }

    fn drop_frame(&mut self) {
        let dropped = u32::from(self.frame.len);
        self.counters.bytes_skipped = self.counters.bytes_skipped.wrapping_add(dropped);
        self.frame = Frame { bytes: [0; MAX_FRAME_LEN], len: 0 };
    }
}

/// Length of the frame that begins with these bytes, as far as it is known. `None`: it has no end,
/// because the full stop of a set-up text is at neither place (AMT-9).
fn frame_len(bytes: &[u8]) -> Option<usize> {
    if bytes.get(1) != Some(&SETUP) {
        return Some(FRAME_LEN);
    }
    match (bytes.get(TEXT + 1), bytes.get(TEXT + 2)) {
        (Some(b'.'), _) => Some(MAX_FRAME_LEN - 1),
        (_, Some(b'.')) => Some(MAX_FRAME_LEN),
        (_, Some(_)) => None,
        // The full stop is still to come.
        (_, None) => Some(MAX_FRAME_LEN),
    }
}
