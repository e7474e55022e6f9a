//! Report of an ECU: each value with its time of reception, `None` until received; and the counters of its link.

use crate::ecu::{Faults, amt, zk};
use crate::line::LineError;
use crate::sentence::{names, sentences};
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
    /// Time at which its frame was complete.
    pub at: Instant,
}

impl<T> Timed<T> {
    /// A value received at an instant.
    pub const fn new(value: T, at: Instant) -> Self {
        Self { value, at }
    }

    /// Its age; zero if `now` is earlier.
    pub fn age(&self, now: Instant) -> Duration {
        now.saturating_duration_since(self.at)
    }
}

/// A byte whose scale depends on the ECU's version or engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Reading {
    /// As received.
    pub raw: u8,
    /// Voltage, `None` while the scale is unknown.
    pub voltage: Option<Millivolts>,
}

/// Phase of an engine as reported by its ECU, never as commanded.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum Phase {
    /// Off.
    Stopped,
    /// Standby: ready for a start, or not yet cleared for one.
    Standby,
    /// Shut down and still turning or hot.
    Cooling,
    /// On the way from standby to running.
    Starting,
    /// Running: it follows the demand.
    Running,
    /// Test of the ECU, with the engine stopped.
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
}

/// The ECU's own state: its number and its name in the protocol document.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct EcuState {
    /// Number on the wire.
    pub code: u8,
    /// Name, `"unknown"` if the document has none.
    pub name: &'static str,
}

/// Switch position that the ECU reports.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ReportedSwitch {
    /// Stop.
    Stop,
    /// Standby (AMT: auto stop).
    Standby,
    /// Run.
    Run,
    /// A number that the document does not name.
    Unknown(u8),
}

impl ReportedSwitch {
    /// Whether an ECU with this position shuts its engine down.
    pub const fn ends_a_run(self) -> bool {
        matches!(self, Self::Standby | Self::Stop)
    }
}

/// A frame of a kind that the document does not name, as received.
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

/// Report of an ECU. `None`: not received yet, or never sent by this ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Report {
    /// Phase of the engine.
    pub phase: Option<Timed<Phase>>,
    /// The ECU's own state.
    pub state: Option<Timed<EcuState>>,
    /// Switch position that it obeys.
    pub switch: Option<Timed<ReportedSwitch>>,
    /// Faults; present and empty when it reports none.
    pub faults: Option<Timed<Faults>>,
    /// Shaft speed.
    pub rpm: Option<Timed<Rpm>>,
    /// AMT: rpm byte, also while its scale is unknown (AMT-5).
    pub rpm_raw: Option<Timed<u8>>,
    /// Exhaust gas temperature.
    pub egt: Option<Timed<Celsius>>,
    /// Throttle that the ECU obeys. A number above 100 % is ignored.
    pub throttle: Option<Timed<Throttle>>,
    /// The one reported before it, unless it was too old then.
    pub(crate) throttle_before: Option<Throttle>,
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
    /// ZK: the ECU requests atmospheric pressure.
    pub pressure_requested: Option<Timed<bool>>,
    /// ZK acceleration curve.
    pub curve_increase: Option<Timed<u8>>,
    /// ZK deceleration curve.
    pub curve_decrease: Option<Timed<u8>>,
    /// ZK protocol version.
    pub version: Option<Timed<zk::codec::Version>>,
    /// ZK status rate.
    pub rate: Option<Timed<zk::codec::Rate>>,
    /// Last report of a power-up (AMT set-up set).
    pub powered_up: Option<Instant>,
    /// AMT engine.
    pub amt_engine: Option<Timed<amt::codec::EngineModel>>,
    /// AMT set-up set.
    pub amt_setup: Option<Timed<amt::codec::Setup>>,
    /// Last frame of an unknown kind.
    pub unknown: Option<Timed<RawFrame>>,
}

/// Largest age of a reported value that is still current.
pub const REPORT_MAX_AGE: Duration = Duration::from_secs(3);

impl Report {
    /// Takes a throttle that the ECU reports.
    pub(crate) fn set_throttle(&mut self, now: Instant, throttle: Throttle) {
        let before = self.throttle.replace(Timed::new(throttle, now));
        self.throttle_before =
            before.filter(|before| before.age(now) <= REPORT_MAX_AGE).map(|before| before.value);
    }

    /// The throttle that decisions use: the lower of the last two, so that one odd report raises no demand.
    pub(crate) fn settled_throttle(&self, now: Instant) -> Option<Throttle> {
        let last = self.throttle.filter(|throttle| throttle.age(now) <= REPORT_MAX_AGE)?.value;
        Some(self.throttle_before.map_or(last, |before| before.min(last)))
    }

    /// Whether the ECU reports any faults.
    pub fn is_faulty(&self) -> bool {
        self.faults.is_some_and(|faults| !faults.value.is_empty())
    }
}

/// State of the link to an ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum LinkState {
    /// Nothing received yet.
    #[default]
    Silent,
    /// Frames are received.
    Up,
    /// Nothing received for the configured time.
    Lost,
}

/// Reason why a transmission was not sent.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum NotSent {
    /// It would have ended after the reply window (AMT-11).
    TooLate,
    /// The UART did not accept or finish it in time.
    TimedOut,
    /// The UART returned an error.
    Failed,
}

/// Counters since the node started. All wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counters {
    /// Good frames, the unknown ones included.
    pub frames: u32,
    /// Good frames of a kind the document does not name.
    pub unknown_frames: u32,
    /// Wrong CRCs (ZK).
    pub crc_failures: u32,
    /// Unfinished frames (AMT), including set-up sets without an end.
    pub truncated: u32,
    /// Frames whose values were discarded, because the UART reported an error while they were received.
    pub damaged_frames: u32,
    /// Bytes that belonged to no frame.
    pub bytes_skipped: u32,
    /// Framing errors of the UART.
    pub framing_errors: u32,
    /// Noise errors of the UART.
    pub noise_errors: u32,
    /// Overruns of the UART.
    pub overruns: u32,
    /// Parity errors of the UART.
    pub parity_errors: u32,
    /// Other errors returned by reading.
    pub read_errors: u32,
    /// Transmissions sent, up to the last stop bit.
    pub sent: u32,
    /// Frames without a reply, because it would have ended too late (AMT-11).
    pub replies_missed: u32,
    /// Replies that ended too late, because the UART was slower than its line.
    pub replies_late: u32,
    /// Send slots skipped, because the UART was still sending (ZK).
    pub send_slots_missed: u32,
    /// Transmissions that the UART did not finish in time.
    pub write_timeouts: u32,
    /// Transmissions for which the UART returned an error.
    pub write_errors: u32,
    /// Commands refused.
    pub commands_rejected: u32,
    /// Events dropped, because the queue was full.
    pub events_dropped: u32,
    /// Smallest margin between the end of a reply and the end of its window (AMT). Never negative: a late reply is counted in
    /// `replies_late`.
    pub worst_reply_margin: Option<Duration>,
    /// Largest delay of a send slot (ZK).
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
            NotSent::TimedOut => bump(&mut self.write_timeouts),
            NotSent::Failed => bump(&mut self.write_errors),
        }
    }
}

/// Counts one, wrapping.
pub(crate) fn bump(count: &mut u32) {
    *count = count.wrapping_add(1);
}

names!(Phase, "Name in lower case." {
    Stopped => "stopped";
    Standby => "standby";
    Cooling => "run-down or cooling";
    Starting => "starting";
    Running => "running";
    Service => "service";
    Unknown => "unknown";
});

sentences!(LinkState {
    Self::Silent => "silent";
    Self::Up => "up";
    Self::Lost => "lost";
});

sentences!(NotSent {
    Self::TooLate => "too late for the reply window";
    Self::TimedOut => "the UART did not finish in time";
    Self::Failed => "the UART returned an error";
});
