//! Interface of the conversation with an ECU, and the parts that every link is made of.
//!
//! A link is a state machine without IO and without a clock. Inputs carry the time; after each input
//! [`Link::compose`] and [`Link::poll`] are called until there is [`Output::Wait`]. One frame per input bounds the pending
//! outputs, so nothing allocates and nothing is lost.

use crate::command::{Order, Rejected};
use crate::consecutive::Consecutive;
use crate::ecu::Service;
use crate::event::Event;
use crate::line::{Line, LineError, Timing};
use crate::report::{Counters, LinkState, NotSent, Report, bump};
use crate::units::{Celsius, Hectopascals, Throttle};
use embassy_time::{Duration, Instant};
use heapless::Deque;

/// Bytes of the longest transmission.
pub const MAX_TRANSMISSION: usize = 5;

/// Bytes to send, all at once.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Transmission {
    bytes: [u8; MAX_TRANSMISSION],
    len: u8,
    /// It carries the demand of the order in force.
    has_demand: bool,
    /// Latest time of the first start bit; if it would be later, do not send.
    pub start_by: Option<Instant>,
}

impl Transmission {
    /// From the bytes of a frame; a frame longer than [`MAX_TRANSMISSION`] does not compile.
    pub fn new<const N: usize>(frame: [u8; N], start_by: Option<Instant>) -> Self {
        const { assert!(N <= MAX_TRANSMISSION) };
        let mut bytes = [0; MAX_TRANSMISSION];
        for (slot, byte) in bytes.iter_mut().zip(frame) {
            *slot = byte;
        }
        Self { bytes, len: N as u8, has_demand: true, start_by }
    }

    /// Sets whether it carries the demand of the order in force, as most do: a frame without one leaves the ECU's demand unchanged.
    pub const fn with_demand(self, has_demand: bool) -> Self {
        Self { has_demand, ..self }
    }

    /// Whether it carries the demand of the order in force.
    pub const fn has_demand(&self) -> bool {
        self.has_demand
    }

    /// The bytes.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.len.into()).unwrap_or_default()
    }
}

/// Output of a link.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Output {
    /// Send this now, then call [`Link::sent`] or [`Link::not_sent`]. No other transmission is handed out before
    /// that.
    Transmit(Transmission),
    /// Publish this event.
    Event(Event),
    /// No more output until the next input; call [`Link::timeout`] at this time.
    Wait(Option<Instant>),
}

/// Stage of an engine, as reported by one frame of its ECU. The order is that of a start.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Stage {
    /// At rest after a run, or after a start that failed: cooling (ZK 12).
    Cooling,
    /// At rest: stopped, standby, a test of the ECU (ZK 0, 1, 14 to 19; AMT 00000).
    Rest,
    /// Cleared for a start (AMT 00001).
    Clearance,
    /// Ignition and preheat (ZK 2 to 4).
    Ignition,
    /// Fuel ramp (ZK 5).
    FuelRamp,
    /// Starting (AMT 00010).
    Starting,
    /// Started up (AMT 00100).
    StartedUp,
    /// Idle calibration (AMT 01000).
    Calibrating,
    /// Running (ZK 6 to 11; AMT 01100, 10000, 11100).
    Running,
    /// Restart by the ECU itself (ZK 13).
    Restart,
    /// A state that the document does not name.
    Unknown,
}

/// What one frame of an ECU shows about the life of its engine: raw, not debounced.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Observation {
    /// The ECU was just powered up (AMT set-up set).
    PowerUp,
    /// A state of the engine (ZK status ID 1, AMT normal set).
    State {
        /// Its stage.
        stage: Stage,
        /// The shaft turns at half of idle or faster; `None` if unknown.
        turning: Option<bool>,
        /// The throttle that the ECU obeys, if the frame carries it (AMT).
        throttle: Option<Throttle>,
    },
    /// The shaft speed alone (the other ZK statuses).
    Shaft {
        /// The shaft turns at half of idle or faster.
        turning: bool,
    },
    /// Faults instead of a state (AMT error set).
    Faulted {
        /// The throttle that the ECU obeys.
        throttle: Option<Throttle>,
        /// The exhaust temperature, unless the ECU reports its sensor as faulty.
        egt: Option<Celsius>,
    },
    /// Nothing about the engine (AMT alternate set, an unnamed frame).
    Stateless,
    /// A frame whose values are discarded, because the UART reported a line error in it (AMT).
    Damaged,
}

/// A conversation with an ECU.
pub trait Link {
    /// Begins the conversation.
    fn start(&mut self, now: Instant);
    /// Takes received bytes up to the end of one frame and returns how many it took; call it again with
    /// the rest, after draining [`Link::poll`].
    fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize;
    /// The UART reported a line error in the bytes that are received next.
    fn line_error(&mut self, error: LineError);
    /// A read failed, and the byte is lost. All earlier bytes were received.
    fn byte_lost(&mut self, error: LineError) {
        self.line_error(error);
    }
    /// Sends this order from now on.
    ///
    /// # Errors
    /// [`Rejected`] if this ECU cannot follow it; the previous order stays in force. An emergency stop and
    /// standby are never refused.
    fn order(&mut self, now: Instant, order: Order) -> Result<(), Rejected>;
    /// Whether the ECU has its own speed control.
    ///
    /// # Errors
    /// [`Rejected`] with the reason if it does not.
    fn speed_control(&self) -> Result<(), Rejected>;
    /// Performs a service once.
    ///
    /// # Errors
    /// [`Rejected`] if this ECU cannot do it, or not now.
    fn service(&mut self, now: Instant, service: Service) -> Result<(), Rejected>;
    /// Sets the atmospheric pressure, for an ECU that requests it.
    fn pressure(&mut self, now: Instant, pressure: Hectopascals);
    /// The last stop bit of the transmission has been sent.
    fn sent(&mut self, now: Instant);
    /// The transmission was not sent, or only in part.
    fn not_sent(&mut self, now: Instant, why: NotSent);
    /// The time given by [`Output::Wait`] has been reached. Early calls have no effect.
    fn timeout(&mut self, now: Instant);
    /// Composes the reply that is due, if the UART is free. Called before [`Link::poll`], so that a reply carries the order of the
    /// moment in which it is handed out.
    fn compose(&mut self) {}
    /// The next output. It decides nothing: the inputs and [`Link::compose`] do.
    fn poll(&mut self) -> Output;
    /// What the frame that [`Link::receive`] has just taken shows about the engine. Returned once for each frame.
    fn take_observation(&mut self) -> Option<Observation>;
    /// Sets whether the engine runs. Until it does, "run" to an AMT ECU carries the throttle of a start (AMT-14), the engine keeps
    /// the demand at idle for every ECU, and damaged frames prevent a gap for a shorter time ([`GapDetector::bridge`]).
    fn release(&mut self, released: bool);
    /// The throttle that goes out with "run" in place of the demand; `None`: the demand does.
    fn start_throttle(&self) -> Option<Throttle> {
        None
    }
    /// Time at which three expected frames will be missing; `None` before the first frame and after such a gap.
    fn gap_at(&self) -> Option<Instant>;
    /// Whether the ECU expects a reply to each of its frames and is sent nothing else (AMT).
    fn answers_frames(&self) -> bool;
    /// Longest time without a reply after which the ECU stops its engine uncommanded (AMT): a life in doubt for that long loses
    /// its order. `None`: not until its sources are silent and the stages of loss have run out.
    fn reply_timeout(&self) -> Option<Duration>;
    /// Time of the last frame that was replied to, since the node began; `None` without replies.
    fn last_reply(&self) -> Option<Instant> {
        None
    }
    /// The gap announced by [`Link::gap_at`] has begun: nothing sent before it is valid after it.
    fn gap(&mut self);
    /// What the node has to retain for this link.
    fn record(&self) -> LinkRecord {
        LinkRecord::EMPTY
    }
    /// Restores what was retained before a reset. Called before [`Link::start`].
    fn restore(&mut self, _record: LinkRecord) {}
    /// Whether the ECU may hold an rpm by its own speed control, because this conversation, or the one that was restored, has
    /// sent it what that needs.
    fn may_hold_rpm(&self) -> bool {
        false
    }
    /// Closes a fuel pump that a service command may have opened, and cancels a service command that was not sent.
    fn close_pump(&mut self) {}
    /// Service frames that still have to be sent beside the order.
    fn service_frames(&self) -> ServiceFrames {
        ServiceFrames::default()
    }
    /// State of the ECU and of the line, as far as it is known.
    fn status(&self) -> &LinkStatus;
}

/// What a link cannot learn from its ECU again after a reset of the node: a few bits that only the link of the same protocol
/// reads.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LinkRecord(u8);

impl LinkRecord {
    /// Number of bits.
    pub const BITS: u32 = 4;
    /// Nothing to remember: the conversation is new.
    pub const EMPTY: Self = Self(0);

    /// From the lower [`LinkRecord::BITS`] bits.
    pub const fn new(bits: u8) -> Self {
        Self(bits & ((1 << Self::BITS) - 1))
    }

    /// The bits.
    pub const fn bits(self) -> u8 {
        self.0
    }
}

/// Service frames that a link still has to send.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct ServiceFrames {
    /// A service command was not sent, or is not confirmed yet.
    pub command: bool,
    /// The fuel pump is being closed.
    pub closing_pump: bool,
    /// The fuel pump was closed, and the ECU still reports its voltage.
    pub pump_is_open: bool,
}

/// How many bytes ago the UART last reported a line error: frames that overlap a line error are discarded.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Damage {
    /// In the bytes of the next read, or in those that are left of this one. The UART does not report in which.
    in_read: bool,
    /// Bytes since then.
    intact: u8,
}

impl Damage {
    /// It is in the bytes that are received next.
    pub const fn line_error(&mut self) {
        self.in_read = true;
    }

    /// All bytes before it have been received.
    pub const fn byte_lost(&mut self) {
        self.intact = 0;
    }

    /// Counts the bytes that were taken of those that are left of a read. Not inlined: both links have it.
    #[inline(never)]
    pub fn received(&mut self, taken: usize, left: usize) {
        self.intact =
            if self.in_read { 0 } else { self.intact.saturating_add(u8::try_from(taken).unwrap_or(u8::MAX)) };
        self.in_read &= taken < left;
    }

    /// Whether one of the last bytes may be damaged.
    pub const fn reaches_back(self, bytes: usize) -> bool {
        (self.intact as usize) < bytes
    }
}

/// Settings of a protocol, with its link.
pub trait Speaks: Copy {
    /// The protocol's link.
    type Link: Link + Clone + core::fmt::Debug;

    /// A link with these settings.
    fn link(self, line: Line, timing: Timing) -> Self::Link;

    /// Changes the settings of a link that is in use, while the engine is at rest. What the ECU has reported stays known.
    fn configure(self, link: &mut Self::Link, now: Instant, line: Line, timing: Timing);
}

/// State of an ECU and its line, as known to the link. Every link has one, which its parts update.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct LinkStatus {
    /// Report of the ECU.
    pub report: Report,
    /// Whether frames from the ECU are received.
    pub state: LinkState,
    /// Time at which the last good frame was complete.
    pub last_rx: Option<Instant>,
    /// Time since which frames have been received without a loss.
    pub up_since: Option<Instant>,
    /// A service command that is in force makes the ECU stop its engine.
    pub shutting_down: bool,
    /// Counters.
    pub counters: Counters,
}

/// Monitors whether frames from an ECU are received. A timer detects silence, not the next byte.
#[derive(Clone, Copy, Debug)]
pub struct LinkMonitor {
    timing: Timing,
    frames: Consecutive,
    silent_at: Option<Instant>,
}

impl LinkMonitor {
    /// Nothing received yet.
    pub const fn new(timing: Timing) -> Self {
        Self { timing, frames: Consecutive::NONE, silent_at: None }
    }

    /// Begins the conversation.
    pub fn start(&mut self, now: Instant) {
        self.silent_at = Some(now + self.timing.lost_after);
    }

    /// Changes the conditions from the next frame on.
    pub const fn configure(&mut self, timing: Timing) {
        self.timing = timing;
    }

    /// Takes a good frame. True if it brought the link up.
    pub fn frame(&mut self, now: Instant, status: &mut LinkStatus) -> bool {
        status.last_rx = Some(now);
        self.silent_at = Some(now + self.timing.lost_after);
        self.frames.count(true);
        let up = status.state != LinkState::Up && self.frames.reached(self.timing.up_after);
        if up {
            status.state = LinkState::Up;
            status.up_since = Some(now);
        }
        up
    }

    /// True if the link is lost as of now.
    pub fn timeout(&mut self, now: Instant, status: &mut LinkStatus) -> bool {
        if self.silent_at.is_none_or(|at| now < at) {
            return false;
        }
        self.silent_at = None;
        self.frames.reset();
        status.up_since = None;
        core::mem::replace(&mut status.state, LinkState::Lost) != LinkState::Lost
    }

    /// Time of the next [`LinkMonitor::timeout`].
    pub const fn deadline(&self) -> Option<Instant> {
        self.silent_at
    }
}

/// Detects gaps in the frames of an ECU. Damaged frames do not count as a gap, for a time after the last good one:
/// bursts of about a frame's length with a pause before each. Continuous babble or a break does.
#[derive(Clone, Copy, Debug)]
pub struct GapDetector {
    /// Bytes of a frame.
    frame_len: u8,
    line: Line,
    /// Time without a frame after which there is a gap.
    gap_after: Duration,
    /// A longer pause separates two bursts.
    pause: Duration,
    /// Time after the last good frame for which damaged frames prevent a gap.
    bridged: Duration,
    last: Option<Instant>,
    good: Option<Instant>,
    last_byte: Option<Instant>,
    burst: u8,
    gap: bool,
}

/// Time for which damaged frames prevent a gap of an engine that has reached running.
const DAMAGED_MAX: Duration = Duration::from_secs(10);
/// The same before that: a start that fails after them must not begin again on the order to run.
const DAMAGED_MAX_IN_START: Duration = Duration::from_secs(3);
/// Number of expected frames that have to be missing for a gap.
const GAP_FRAMES: u32 = 3;

impl GapDetector {
    /// For frames of this number of bytes, expected at this interval.
    pub fn new(frame_len: u8, line: Line, interval: Duration) -> Self {
        let mut detector = Self {
            frame_len,
            line,
            gap_after: Duration::MIN,
            pause: Duration::MIN,
            bridged: DAMAGED_MAX,
            last: None,
            good: None,
            last_byte: None,
            burst: 0,
            gap: false,
        };
        detector.expect(interval);
        detector
    }

    /// Sets for how long damaged frames prevent a gap: less until the engine has reached running.
    pub const fn bridge(&mut self, reached: bool) {
        self.bridged = if reached { DAMAGED_MAX } else { DAMAGED_MAX_IN_START };
    }

    /// Changes the interval of frames from now on.
    pub fn expect(&mut self, interval: Duration) {
        let gap_after = interval * GAP_FRAMES;
        if self.gap_after != gap_after {
            self.gap_after = gap_after;
            // At a high rate the pause between two frames is short.
            let rest =
                interval.as_ticks().saturating_sub(self.line.time_of(self.frame_len.into()).as_ticks());
            let pause = self.line.time_of(2) + Duration::from_millis(2);
            self.pause = pause.min(Duration::from_ticks(rest * 2 / 3));
        }
    }

    /// The same, but the interval does not become shorter.
    pub fn expect_no_sooner(&mut self, interval: Duration) {
        self.expect(interval.max(self.gap_after / GAP_FRAMES));
    }

    /// Whether no byte was received for longer than half of the time between two frames: what was begun before is never complete.
    pub fn broke_off(&self, now: Instant) -> bool {
        let longest = self.gap_after / (2 * GAP_FRAMES);
        self.last_byte.is_some_and(|last| now.saturating_duration_since(last) > longest)
    }

    /// Takes received bytes of any kind.
    pub fn bytes(&mut self, now: Instant, count: usize) {
        let paused = self.last_byte.is_none_or(|last| now.saturating_duration_since(last) > self.pause);
        self.last_byte = Some(now);
        let before = if paused { 0 } else { self.burst };
        self.burst = before.saturating_add(u8::try_from(count).unwrap_or(u8::MAX));
        // One byte may have been lost in the noise.
        let enough = self.frame_len.saturating_sub(1);
        let lately = self.good.is_some_and(|good| now < good + self.bridged);
        if before < enough && self.burst >= enough && lately {
            self.last = Some(now);
            self.gap = false;
        }
    }

    /// A frame is expected from now on: a silence after a reset of the node is a gap, too.
    pub fn start(&mut self, now: Instant) {
        (self.last, self.good) = (Some(now), Some(now));
    }

    /// Takes a good frame.
    pub fn frame(&mut self, now: Instant) {
        self.last = Some(now);
        self.good = Some(now);
        self.gap = false;
    }

    /// Time at which the gap begins.
    pub fn gap_at(&self) -> Option<Instant> {
        self.last.filter(|_| !self.gap)?.checked_add(self.gap_after)
    }

    /// The gap has been handled.
    pub fn gap(&mut self) {
        self.gap = true;
    }
}

/// Outputs that wait to be handed out, and whether the UART is busy with a transmission.
#[derive(Clone, Debug, Default)]
pub struct Outbox {
    waiting: Option<Transmission>,
    busy: bool,
    events: Deque<Event, 16>,
    events_dropped: u32,
}

impl Outbox {
    /// Replaces the waiting transmission: the latest wins.
    pub fn put(&mut self, transmission: Transmission) {
        self.waiting = Some(transmission);
    }

    /// Queues an event, or counts it as dropped if the queue is full.
    #[inline(never)]
    pub fn event(&mut self, event: Event) {
        if self.events.push_back(event).is_err() {
            bump(&mut self.events_dropped);
        }
    }

    /// The UART is free again.
    pub fn done(&mut self) {
        self.busy = false;
    }

    /// Whether the UART is busy with a transmission.
    pub const fn busy(&self) -> bool {
        self.busy
    }

    /// Whether no transmission waits and the UART is free.
    pub const fn idle(&self) -> bool {
        !self.busy && self.waiting.is_none()
    }

    /// The next output, if any.
    pub fn poll(&mut self, status: &mut LinkStatus) -> Option<Output> {
        // A reply is more urgent than an event.
        if !self.busy
            && let Some(transmission) = self.waiting.take()
        {
            self.busy = true;
            return Some(Output::Transmit(transmission));
        }
        status.counters.events_dropped = self.events_dropped;
        self.events.pop_front().map(Output::Event)
    }
}

/// The earlier of two optional instants.
#[inline(never)]
pub fn earlier(a: Option<Instant>, b: Option<Instant>) -> Option<Instant> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (a, b) => a.or(b),
    }
}
