//! What the conversation with an ECU is to everybody above it, and the parts every link is made of.
//!
//! A link is a state machine without IO and without a clock. Inputs carry the time; after each input
//! [`Link::poll`] is called until it says [`Output::Wait`]. One frame per input keeps what is pending
//! bounded, so nothing allocates and nothing is forgotten.

use crate::command::{Order, Rejected};
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
    /// The first start bit may not come later than this; if it would, do not send.
    pub start_by: Option<Instant>,
}

impl Transmission {
    /// From the bytes of a frame; what is longer than [`MAX_TRANSMISSION`] does not compile.
    pub fn new<const N: usize>(frame: [u8; N], start_by: Option<Instant>) -> Self {
        const { assert!(N <= MAX_TRANSMISSION) };
        let mut bytes = [0; MAX_TRANSMISSION];
        for (slot, byte) in bytes.iter_mut().zip(frame) {
            *slot = byte;
        }
        Self { bytes, len: N as u8, start_by }
    }

    /// The bytes.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.len.into()).unwrap_or_default()
    }
}

/// What a link wants done.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Output {
    /// Send this now, then call [`Link::sent`] or [`Link::not_sent`]. Nothing else is handed out to send
    /// before that.
    Transmit(Transmission),
    /// Publish an event.
    Event(Event),
    /// Nothing more until the next input; call [`Link::timeout`] at this instant.
    Wait(Option<Instant>),
}

/// How far an engine is, as one frame of its ECU reports it. The order is that of a start.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Stage {
    /// At rest: stopped, standby, cooling, a test of the ECU (ZK 0, 1, 12, 14 to 19; AMT 00000).
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
    /// A state without a name in the document.
    Unknown,
}

/// What one frame of an ECU says about the life of its engine. Raw: each frame as it came, nothing debounced.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sign {
    /// The ECU was just powered up (AMT set-up set).
    PowerUp,
    /// A state of the engine (ZK status ID 1, AMT normal set).
    State {
        /// How far it is.
        stage: Stage,
        /// The shaft turns at half of idle or faster; `None` where nothing says.
        turning: Option<bool>,
        /// The throttle that the ECU obeys, where the frame carries it (AMT).
        throttle: Option<Throttle>,
    },
    /// The shaft speed alone (the other ZK statuses).
    Shaft {
        /// The shaft turns at half of idle or faster.
        turning: bool,
    },
    /// Faults in place of a state (AMT error set).
    Faulted {
        /// The throttle that the ECU obeys.
        throttle: Option<Throttle>,
        /// The exhaust temperature, unless the ECU calls its sensor faulty.
        egt: Option<Celsius>,
    },
    /// Nothing about the engine (AMT alternate set, a frame without a name).
    Stateless,
    /// A frame whose values are not used, because the UART saw a fault in it (AMT).
    Damaged,
}

/// A conversation with an ECU.
pub trait Link {
    /// The conversation begins.
    fn start(&mut self, now: Instant);
    /// Bytes came. It takes them up to the end of one frame and says how many it took; call again with
    /// the rest, after draining [`Link::poll`].
    fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize;
    /// The UART saw a fault.
    fn line_error(&mut self, error: LineError);
    /// A read failed, and the byte is lost. All bytes before it have come.
    fn byte_lost(&mut self, error: LineError) {
        self.line_error(error);
    }
    /// Keep this on the wire from now on.
    ///
    /// # Errors
    /// [`Rejected`] if this ECU cannot do it; what was ordered before stays. An emergency stop and standby
    /// are never refused.
    fn order(&mut self, now: Instant, order: Order) -> Result<(), Rejected>;
    /// Whether the ECU holds an rpm by itself.
    ///
    /// # Errors
    /// [`Rejected`] with the reason if it does not.
    fn speed_control(&self) -> Result<(), Rejected>;
    /// Do this once.
    ///
    /// # Errors
    /// [`Rejected`] if this ECU cannot do it, or not now.
    fn service(&mut self, now: Instant, service: Service) -> Result<(), Rejected>;
    /// The atmospheric pressure, for an ECU that asks for it.
    fn pressure(&mut self, now: Instant, pressure: Hectopascals);
    /// The last stop bit of the transmission is out.
    fn sent(&mut self, now: Instant);
    /// The transmission did not happen, or not whole.
    fn not_sent(&mut self, now: Instant, why: NotSent);
    /// The instant given by [`Output::Wait`] has come. Early calls do nothing.
    fn timeout(&mut self, now: Instant);
    /// What to do now.
    fn poll(&mut self) -> Output;
    /// What the frame that [`Link::receive`] has just taken says about the engine. Once for each frame.
    fn take_sign(&mut self) -> Option<Sign>;
    /// The engine runs, for an ECU whose "run" carries the throttle of a start until then (AMT-14). That a demand stays at
    /// idle until then is the engine's rule, for every ECU.
    fn release(&mut self, _released: bool) {}
    /// When three expected frames will have failed to come; `None` before the first frame and after such a gap.
    fn gap_at(&self) -> Option<Instant>;
    /// The ECU waits for a reply to each of its frames and gets nothing otherwise (AMT).
    fn answers_frames(&self) -> bool;
    /// When a life that has been in doubt since then loses its order, should nothing confirm it. `None`: not before its
    /// sources are silent and the stages of loss have run out.
    fn doubt_ends(&self, since: Instant) -> Option<Instant>;
    /// The gap that [`Link::gap_at`] announced is there: nothing sent before it holds for what comes after it.
    fn gap(&mut self);
    /// The ECU was given its switch by ZK ID 6, so it ignores the one of ID 1 (ZK-9).
    fn switch_by_id6(&self) -> bool {
        false
    }
    /// After a reset: the ECU was given its switch by ZK ID 6 before it.
    fn resume_switch_by_id6(&mut self) {}
    /// Close a fuel pump that a service command may have opened (ZK ID 2, parameter 13).
    fn close_pump(&mut self) {}
    /// A service command has not gone out yet.
    fn service_pending(&self) -> bool {
        false
    }
    /// The fuel pump is being closed.
    fn closing_pump(&self) -> bool {
        false
    }
    /// What is known of the ECU and of the line.
    fn status(&self) -> &LinkStatus;
}

/// What the settings of a protocol speak by.
pub trait Speaks: Copy {
    /// The protocol's link.
    type Link: Link + Clone + core::fmt::Debug;

    /// A link with these settings.
    fn link(self, line: Line, timing: Timing) -> Self::Link;
}

/// What a link knows of its ECU and of the line. Every link keeps one; its parts write into it.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct LinkStatus {
    /// What the ECU has reported.
    pub report: Report,
    /// Whether frames of the ECU are received.
    pub state: LinkState,
    /// When the last good frame was complete.
    pub last_rx: Option<Instant>,
    /// Since when frames are received without a loss.
    pub up_since: Option<Instant>,
    /// A service command that is in force makes the ECU stop its engine.
    pub shutting_down: bool,
    /// What was counted.
    pub counters: Counters,
}

/// Whether frames of an ECU are received: silence is found by a timer, never at the next byte.
#[derive(Clone, Copy, Debug)]
pub struct LinkMonitor {
    timing: Timing,
    frames_in_a_row: u8,
    silent_at: Option<Instant>,
}

impl LinkMonitor {
    /// Nothing is received yet.
    pub const fn new(timing: Timing) -> Self {
        Self { timing, frames_in_a_row: 0, silent_at: None }
    }

    /// The conversation begins.
    pub fn start(&mut self, now: Instant) {
        self.silent_at = Some(now + self.timing.lost_after);
    }

    /// A good frame came. True if that brought the link up.
    pub fn frame(&mut self, now: Instant, status: &mut LinkStatus) -> bool {
        status.last_rx = Some(now);
        self.silent_at = Some(now + self.timing.lost_after);
        self.frames_in_a_row = self.frames_in_a_row.saturating_add(1);
        let up = status.state != LinkState::Up && self.frames_in_a_row >= self.timing.up_after;
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
        self.frames_in_a_row = 0;
        status.up_since = None;
        core::mem::replace(&mut status.state, LinkState::Lost) != LinkState::Lost
    }

    /// When [`LinkMonitor::timeout`] wants to be called.
    pub const fn deadline(&self) -> Option<Instant> {
        self.silent_at
    }
}

/// Gaps in the beat of an ECU. Damaged frames keep the beat, for 10 s at most after the last good one: bursts of about a
/// frame's length with a pause before each. A steady babble and a break do not.
#[derive(Clone, Copy, Debug)]
pub struct Beat {
    /// Bytes of a frame.
    frame_len: u8,
    line: Line,
    /// After this without a frame there is a gap.
    gap_after: Duration,
    /// A longer pause separates two bursts.
    pause: Duration,
    last: Option<Instant>,
    good: Option<Instant>,
    last_byte: Option<Instant>,
    burst: u8,
    gap: bool,
}

/// Damaged frames keep the beat for so long after the last good one.
const DAMAGED_BEAT_MAX: Duration = Duration::from_secs(10);
/// Expected frames that have to fail for a gap.
const GAP_FRAMES: u32 = 3;

impl Beat {
    /// Of frames of so many bytes, expected at this interval.
    pub fn new(frame_len: u8, line: Line, interval: Duration) -> Self {
        let mut beat = Self {
            frame_len,
            line,
            gap_after: Duration::MIN,
            pause: Duration::MIN,
            last: None,
            good: None,
            last_byte: None,
            burst: 0,
            gap: false,
        };
        beat.expect(interval);
        beat
    }

    /// Frames come at another interval from now on.
    pub fn expect(&mut self, interval: Duration) {
        let gap_after = interval * GAP_FRAMES;
        if self.gap_after != gap_after {
            self.gap_after = gap_after;
            // At a high rate there is little between two frames.
            let rest =
                interval.as_ticks().saturating_sub(self.line.time_of(self.frame_len.into()).as_ticks());
            let pause = self.line.time_of(2) + Duration::from_millis(2);
            self.pause = pause.min(Duration::from_ticks(rest * 2 / 3));
        }
    }

    /// Bytes came, of whatever kind.
    pub fn bytes(&mut self, now: Instant, count: usize) {
        let paused = self.last_byte.is_none_or(|last| now.saturating_duration_since(last) > self.pause);
        self.last_byte = Some(now);
        let before = if paused { 0 } else { self.burst };
        self.burst = before.saturating_add(u8::try_from(count).unwrap_or(u8::MAX));
        // One byte may be lost in the noise.
        let enough = self.frame_len.saturating_sub(1);
        let lately = self.good.is_some_and(|good| now < good + DAMAGED_BEAT_MAX);
        if before < enough && self.burst >= enough && lately {
            self.last = Some(now);
            self.gap = false;
        }
    }

    /// A good frame came.
    pub fn frame(&mut self, now: Instant) {
        self.last = Some(now);
        self.good = Some(now);
        self.gap = false;
    }

    /// When the gap begins.
    pub fn gap_at(&self) -> Option<Instant> {
        self.last.filter(|_| !self.gap)?.checked_add(self.gap_after)
    }

    /// The gap was seen.
    pub fn gap(&mut self) {
        self.gap = true;
    }
}

/// What waits to be handed out, and whether the UART is busy with what was.
#[derive(Clone, Debug, Default)]
pub struct Outbox {
    waiting: Option<Transmission>,
    busy: bool,
    events: Deque<Event, 16>,
    events_dropped: u32,
}

impl Outbox {
    /// Replaces what waits: the latest wins.
    pub fn put(&mut self, transmission: Transmission) {
        self.waiting = Some(transmission);
    }

    /// Reports an event, or counts it as lost where too many wait.
    pub fn event(&mut self, event: Event) {
        if self.events.push_back(event).is_err() {
            bump(&mut self.events_dropped);
        }
    }

    /// The UART is free again.
    pub fn done(&mut self) {
        self.busy = false;
    }

    /// The UART is busy with what was handed out.
    pub const fn busy(&self) -> bool {
        self.busy
    }

    /// Nothing waits and the UART is free.
    pub const fn idle(&self) -> bool {
        !self.busy && self.waiting.is_none()
    }

    /// The next thing to do, if any.
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

/// The earlier of two instants, where there are any.
pub fn earlier(a: Option<Instant>, b: Option<Instant>) -> Option<Instant> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (a, b) => a.or(b),
    }
}
