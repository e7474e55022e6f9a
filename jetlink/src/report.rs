//! What an ECU has said: every value with the time it came, `None` where the ECU has not said; and what was counted on
//! the line.

use crate::ecu::{Faults, amt, zk};
use crate::line::LineError;
use crate::units::{
    Celsius, Grams, Milliamps, Millilitres, MillilitresPerMinute, Millivolts, Pascals, Rpm, Throttle,
};
use embassy_time::{Duration, Instant};

/// A value and when it was received.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Timed<T> {
    /// The value.
    pub value: T,
    /// When its frame was complete.
    pub at: Instant,
}

impl<T> Timed<T> {
    /// A value received at an instant.
    pub const fn new(value: T, at: Instant) -> Self {
        Self { value, at }
    }

    /// How old it is; zero if `now` is earlier.
    pub fn age(&self, now: Instant) -> Duration {
        now.saturating_duration_since(self.at)
    }
}

/// A byte whose scale depends on what else is known of the ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Reading {
    /// As it came.
    pub raw: u8,
    /// The voltage, `None` while the scale is not known.
    pub voltage: Option<Millivolts>,
}

/// What an engine does, in plain words, as its ECU reports it. Never what was commanded.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Phase {
    /// Off.
    Stopped,
    /// Standby: ready, or not yet cleared, for a start.
    Standby,
    /// Shut down and still turning or hot.
    Cooling,
    /// On the way from standby to running.
    Starting,
    /// Running: it follows the demand.
    Running,
    /// A test of the ECU's, with the engine stopped.
    Service,
    /// A state without a name in the document.
    Unknown,
}

impl Phase {
    /// Whether the ECU reports an engine that burns no fuel.
    pub const fn is_stopped(self) -> bool {
        matches!(self, Self::Stopped | Self::Standby | Self::Cooling | Self::Service)
    }

    /// Whether the ECU reports an engine on its way up or running.
    pub const fn is_alive(self) -> bool {
        matches!(self, Self::Starting | Self::Running)
    }

    /// Name in lower case.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stopped => "stopped",
            Self::Standby => "standby",
            Self::Cooling => "cooling",
            Self::Starting => "starting",
            Self::Running => "running",
            Self::Service => "service",
            Self::Unknown => "unknown",
        }
    }
}

/// The ECU's own state: its number and the name the document gives it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct EcuState {
    /// Number on the wire.
    pub code: u8,
    /// Name, `"unknown"` if the document has none.
    pub name: &'static str,
}

/// The switch position that the ECU says it obeys.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ReportedSwitch {
    /// Stop.
    Stop,
    /// Standby (AMT: auto stop).
    Standby,
    /// Run.
    Run,
    /// A number without a name.
    Unknown(u8),
}

/// A frame of a kind the document does not name, as it came.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RawFrame {
    bytes: [u8; amt::codec::MAX_FRAME_LEN],
    len: u8,
}

impl RawFrame {
    pub(crate) fn new(frame: &[u8]) -> Self {
        let mut bytes = [0; amt::codec::MAX_FRAME_LEN];
        let mut len = 0;
        for (slot, &byte) in bytes.iter_mut().zip(frame) {
            *slot = byte;
            len += 1;
        }
        Self { bytes, len }
    }

    /// The bytes.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.len.into()).unwrap_or_default()
    }
}

/// What the ECU has said. `None`: not yet, or not at all.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Report {
    /// What the engine does.
    pub phase: Option<Timed<Phase>>,
    /// The ECU's own state.
    pub state: Option<Timed<EcuState>>,
    /// The switch position it obeys.
    pub switch: Option<Timed<ReportedSwitch>>,
    /// Its faults; present and empty when it reports none.
    pub faults: Option<Timed<Faults>>,
    /// Shaft speed.
    pub rpm: Option<Timed<Rpm>>,
    /// AMT: the rpm byte, also where its scale is not known (AMT-5).
    pub rpm_raw: Option<Timed<u8>>,
    /// Exhaust gas temperature.
    pub egt: Option<Timed<Celsius>>,
    /// Throttle that the ECU obeys. A number above 100 % is not taken over.
    pub throttle: Option<Timed<Throttle>>,
    /// Supply (ZK power voltage, AMT battery voltage).
    pub supply: Option<Timed<Reading>>,
    /// AMT external battery.
    pub external_battery: Option<Timed<Reading>>,
    /// Fuel pump (ZK pump voltage, AMT Vout).
    pub pump: Option<Timed<Reading>>,
    /// ZK maximum pump voltage, AMT maximum rpm voltage.
    pub pump_max: Option<Timed<Reading>>,
    /// AMT idle voltage.
    pub pump_idle: Option<Timed<Reading>>,
    /// ZK control (radio) voltage.
    pub radio: Option<Timed<Reading>>,
    /// ZK ignition pump voltage.
    pub ignition_pump: Option<Timed<Millivolts>>,
    /// ZK current.
    pub current: Option<Timed<Milliamps>>,
    /// ZK thrust.
    pub thrust: Option<Timed<Grams>>,
    /// ZK fuel flow.
    pub fuel_flow: Option<Timed<MillilitresPerMinute>>,
    /// ZK fuel used.
    pub fuel_total: Option<Timed<Millilitres>>,
    /// ZK pressure.
    pub pressure: Option<Timed<Pascals>>,
    /// ZK temperature of the ECU.
    pub ecu_temperature: Option<Timed<Celsius>>,
    /// ZK idle rpm of the engine.
    pub idle_rpm: Option<Timed<Rpm>>,
    /// ZK maximum rpm of the engine.
    pub max_rpm: Option<Timed<Rpm>>,
    /// ZK start-up time.
    pub startup: Option<Timed<Duration>>,
    /// ZK: the rpm loop is closed.
    pub closed_loop: Option<Timed<bool>>,
    /// ZK: the ECU asks for atmospheric pressure.
    pub pressure_requested: Option<Timed<bool>>,
    /// ZK acceleration curve.
    pub curve_increase: Option<Timed<u8>>,
    /// ZK deceleration curve.
    pub curve_decrease: Option<Timed<u8>>,
    /// ZK protocol version.
    pub version: Option<Timed<zk::codec::Version>>,
    /// ZK status rate.
    pub rate: Option<Timed<zk::codec::Rate>>,
    /// When the ECU last told that it had just been powered up (AMT set-up set).
    pub powered_up: Option<Instant>,
    /// AMT engine.
    pub amt_engine: Option<Timed<amt::codec::Engine>>,
    /// AMT set-up set.
    pub amt_setup: Option<Timed<amt::codec::Setup>>,
    /// The last frame of an unknown kind.
    pub unknown: Option<Timed<RawFrame>>,
}

/// Whether the ECU is heard.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LinkState {
    /// Not yet.
    #[default]
    Silent,
    /// Yes.
    Up,
    /// Not for the configured time.
    Lost,
}

/// Why a transmission did not happen.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum NotSent {
    /// It would have ended after the reply window (AMT-11).
    TooLate,
    /// The UART did not take it or finish it in time.
    GaveUp,
    /// The UART returned an error.
    Failed,
}

/// What was counted since the node started. All counts wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counters {
    /// Good frames, the unknown ones included.
    pub frames: u32,
    /// Good frames of a kind the document does not name.
    pub unknown_frames: u32,
    /// Wrong CRCs (ZK).
    pub crc_failures: u32,
    /// Frames begun and not finished (AMT), set-up sets without an end among them.
    pub truncated: u32,
    /// Frames whose values were not believed, because the UART saw a fault while they came (AMT: no checksum).
    pub damaged_frames: u32,
    /// Bytes that belonged to no frame.
    pub bytes_skipped: u32,
    /// Framing errors that the UART saw.
    pub framing_errors: u32,
    /// Noise errors that the UART saw.
    pub noise_errors: u32,
    /// Overruns that the UART saw.
    pub overruns: u32,
    /// Parity errors that the UART saw.
    pub parity_errors: u32,
    /// Other errors that reading returned.
    pub read_errors: u32,
    /// Transmissions whose last stop bit is out.
    pub sent: u32,
    /// Frames of the ECU that got no reply, because it would have ended late (AMT-11).
    pub replies_missed: u32,
    /// Replies that ended late all the same, because the UART was slower than it should be.
    pub replies_late: u32,
    /// Turns of the keep-alive that were skipped, because the UART was still sending (ZK).
    pub send_slots_missed: u32,
    /// Transmissions given up.
    pub given_up: u32,
    /// Transmissions that the UART refused.
    pub write_errors: u32,
    /// Commands refused.
    pub commands_rejected: u32,
    /// Events that were not told, because too many came at once.
    pub events_lost: u32,
    /// Smallest time left between the end of a reply and the end of its window (AMT). Never negative: a
    /// late one counts in `replies_late`.
    pub worst_reply_margin: Option<Duration>,
    /// Largest delay of a turn of the keep-alive (ZK).
    pub worst_slot_delay: Option<Duration>,
}

impl Counters {
    pub(crate) fn line_error(&mut self, error: LineError) {
        let count = match error {
            LineError::Framing => &mut self.framing_errors,
            LineError::Noise => &mut self.noise_errors,
            LineError::Overrun => &mut self.overruns,
            LineError::Parity => &mut self.parity_errors,
            LineError::Read => &mut self.read_errors,
        };
        bump(count);
    }

    pub(crate) fn not_sent(&mut self, why: NotSent) {
        match why {
            NotSent::TooLate => {}
            NotSent::GaveUp => bump(&mut self.given_up),
            NotSent::Failed => bump(&mut self.write_errors),
        }
    }
}

/// Counts one, wrapping.
pub(crate) fn bump(count: &mut u32) {
    *count = count.wrapping_add(1);
}
