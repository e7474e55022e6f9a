//! Between an engine's runner and everybody else: commands in, telemetry and events out.
//!
//! A [`Channel`] is one engine and belongs to it alone: two engines share nothing. There is no queue of
//! commands. A [`Handle`] puts a command straight into the engine's state, under a lock that is held for
//! microseconds, and gets its answer at once. So an old throttle can never follow a new one, and a stop
//! cannot stand behind anything.

use crate::command::{Accepted, Command, Origin, Rejected};
use crate::config::EngineConfig;
use crate::engine::Engine;
use crate::engine::config::Supervision;
use crate::engine::retained::{Reset, RetainedMemory};
use crate::event::Event;
use crate::setting::SettingId;
use crate::telemetry::Telemetry;
use crate::units::Hectopascals;
use core::cell::RefCell;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pubsub::{PubSubChannel, Subscriber};
use embassy_sync::signal::Signal;
use embassy_sync::watch::{self, Watch};
use embassy_time::Instant;

/// Events kept for a listener that is slow; older ones are lost to it, and it is told how many.
pub const EVENTS_KEPT: usize = 32;
/// Tasks that can listen to one engine's events, and as many again to its telemetry.
pub const LISTENERS: usize = 4;

/// Listens to one engine's events.
pub type Events<'a> = Subscriber<'a, CriticalSectionRawMutex, Event, EVENTS_KEPT, LISTENERS, 0>;
/// Waits for one engine's telemetry.
pub type TelemetryReceiver<'a> = watch::Receiver<'a, CriticalSectionRawMutex, Telemetry, LISTENERS>;

/// One engine, and what its runner and its handles share.
pub struct Channel {
    name: &'static str,
    engine: Mutex<CriticalSectionRawMutex, RefCell<Engine>>,
    /// The engine has something to say or to send that its runner has not seen.
    pub(crate) wake: Signal<CriticalSectionRawMutex, ()>,
    pub(crate) events: PubSubChannel<CriticalSectionRawMutex, Event, EVENTS_KEPT, LISTENERS, 0>,
    pub(crate) telemetry: Watch<CriticalSectionRawMutex, Telemetry, LISTENERS>,
    progress: AtomicU32,
    /// The sources that somebody holds, a bit for each priority.
    claimed: AtomicU8,
    /// Where what must survive a reset is retained.
    memory: Option<Retained>,
}

/// RetainedMemory that survives a reset, and what it holds may be believed.
struct Retained {
    memory: &'static RetainedMemory,
    fingerprint: u32,
    reset: Reset,
    /// The number of the next write.
    sequence: AtomicU32,
}

impl core::fmt::Debug for Channel {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Channel").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Channel {
    /// For one engine. `retained` is memory that a reset leaves alone, with what the node comes out of: an engine that runs
    /// goes on after a warm reset, and after a loss of power nothing is believed that could start or raise one.
    ///
    /// `None` forgets the order, the arming and a latched emergency stop at every reset. It is for tests and for programs
    /// that never reset while an engine runs.
    pub fn new(config: &EngineConfig, retained: Option<(&'static RetainedMemory, Reset)>) -> Self {
        let mut engine = Engine::new(config);
        let memory = retained.map(|(memory, reset)| {
            let fingerprint = config.fingerprint();
            engine.restore(memory.load(fingerprint, reset));
            Retained { memory, fingerprint, reset, sequence: AtomicU32::new(memory.next_sequence()) }
        });
        Self {
            name: config.name,
            engine: Mutex::new(RefCell::new(engine)),
            wake: Signal::new(),
            events: PubSubChannel::new(),
            telemetry: Watch::new(),
            progress: AtomicU32::new(0),
            claimed: AtomicU8::new(0),
            memory,
        }
    }

    /// For whoever listens or holds a [`Source`]; as many as wanted.
    pub const fn handle(&self) -> Handle<'_> {
        Handle { channel: self, group: core::slice::from_ref(self) }
    }

    /// The same, as one of a group of engines that start one after the other and tell each other of failures;
    /// [`crate::node::Node`] makes one of a table.
    pub const fn handle_in<'a>(&'a self, group: &'a [Channel]) -> Handle<'a> {
        Handle { channel: self, group }
    }

    /// The engine begins, with what was kept over the reset.
    pub(crate) fn begin(&self, now: Instant) {
        let kept = self.memory.as_ref().and_then(|kept| kept.memory.load(kept.fingerprint, kept.reset));
        self.with(|engine| engine.start(now, kept));
    }

    /// Does something with the engine. Short: interrupts wait meanwhile.
    pub(crate) fn with<T>(&self, act: impl FnOnce(&mut Engine) -> T) -> T {
        self.engine.lock(|engine| {
            let engine = &mut *engine.borrow_mut();
            let result = act(engine);
            if let Some(kept) = &self.memory
                && let Some(record) = engine.take_retained()
            {
                // Not an add-and-fetch: whoever is here holds the lock.
                let sequence = kept.sequence.load(Ordering::Relaxed);
                kept.sequence.store(sequence.wrapping_add(1), Ordering::Relaxed);
                kept.memory.store_next(&record, kept.fingerprint, sequence);
            }
            result
        })
    }

    /// Looks at the engine. As short.
    pub(crate) fn see<T>(&self, look: impl FnOnce(&Engine) -> T) -> T {
        self.engine.lock(|engine| look(&engine.borrow()))
    }

    pub(crate) fn made_progress(&self) {
        // Not an add-and-fetch: only the runner writes.
        let count = self.progress.load(Ordering::Relaxed).wrapping_add(1);
        self.progress.store(count, Ordering::Relaxed);
    }
}

/// Listens to one engine, and claims sources of commands. Copies may be used from several tasks.
#[derive(Clone, Copy, Debug)]
pub struct Handle<'a> {
    channel: &'a Channel,
    /// All engines of the group, this one among them.
    group: &'a [Channel],
}

/// The right to command one engine as one source. There is one for each origin at a time, so nobody can speak for another:
/// [`Handle::source`] hands it out, and dropping it gives it back.
#[derive(Debug)]
pub struct Source<'a> {
    handle: Handle<'a>,
    origin: Origin,
}

/// Why a source cannot be claimed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ClaimError {
    /// Somebody holds it.
    Taken(Origin),
    /// Nobody commands as the node itself.
    Node,
    /// The highest source is claimed by [`Handle::emergency_source`] alone.
    Emergency,
}

impl core::fmt::Display for ClaimError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Taken(origin) => {
                write!(f, "{} is held already: share that source, or drop it first", origin.name())
            }
            Self::Node => f.write_str("the node is no source: claim bench, mavlink or rc"),
            Self::Emergency => f.write_str("claim the emergency source with emergency_source()"),
        }
    }
}

impl core::error::Error for ClaimError {}

impl<'a> Source<'a> {
    /// Which source it is.
    pub const fn origin(&self) -> Origin {
        self.origin
    }

    /// Of the engine that it commands.
    pub const fn handle(&self) -> Handle<'a> {
        self.handle
    }

    /// Commands the engine. The latest command of a source wins, the highest fresh source is in control, and a stop
    /// pre-empts whatever is going on. A source has to repeat `Run` within its age limit
    /// ([`crate::engine::config::SourceTimeouts`]).
    ///
    /// # Errors
    /// [`Rejected`] with the reason; what was commanded before stays in force.
    pub fn command(&self, command: Command) -> Result<Accepted, Rejected> {
        self.handle.command(command, self.origin)
    }
}

impl Drop for Source<'_> {
    fn drop(&mut self) {
        let claimed = &self.handle.channel.claimed;
        // Not a fetch-and-and: not every core has one.
        critical_section::with(|_| {
            let left = claimed.load(Ordering::Relaxed) & !(1 << self.origin.priority());
            claimed.store(left, Ordering::Relaxed);
        });
    }
}

impl<'a> Handle<'a> {
    /// The engine's name.
    pub const fn name(&self) -> &'static str {
        self.channel.name
    }

    /// Claims one of the sources `Bench`, `Mavlink` and `Rc`, as long as the result lives.
    ///
    /// # Errors
    /// [`ClaimError`] if somebody holds it, or it is none of these.
    pub fn source(&self, origin: Origin) -> Result<Source<'a>, ClaimError> {
        match origin {
            Origin::Node => Err(ClaimError::Node),
            Origin::Emergency => Err(ClaimError::Emergency),
            Origin::Bench | Origin::Mavlink | Origin::Rc => self.claim(origin),
        }
    }

    /// Claims the highest source: a local emergency input, which overrides every other one.
    ///
    /// # Errors
    /// [`ClaimError::Taken`] if somebody holds it.
    pub fn emergency_source(&self) -> Result<Source<'a>, ClaimError> {
        self.claim(Origin::Emergency)
    }

    fn claim(&self, origin: Origin) -> Result<Source<'a>, ClaimError> {
        let claimed = &self.channel.claimed;
        let bit = 1 << origin.priority();
        let free = critical_section::with(|_| {
            let before = claimed.load(Ordering::Relaxed);
            claimed.store(before | bit, Ordering::Relaxed);
            before & bit == 0
        });
        if free { Ok(Source { handle: *self, origin }) } else { Err(ClaimError::Taken(origin)) }
    }

    fn command(&self, command: Command, origin: Origin) -> Result<Accepted, Rejected> {
        let now = self.now();
        // One source at a time, so that two engines cannot both find the other one standing.
        let answer = critical_section::with(|_| {
            let mut others = self.group.iter().filter(|other| !core::ptr::eq(*other, self.channel));
            let free = matches!(command, Command::Run(_) | Command::HandOverToPwm)
                && others.all(|other| !other.see(|engine| engine.blocks_other_starts(now)));
            self.channel.with(|engine| engine.command(now, command, origin, free))
        });
        self.channel.wake.signal(());
        answer
    }

    /// Gives new settings of the supervision to the running engine. They hold from the next frame, command or deadline on; the
    /// settings of a link ([`crate::setting::Effect::AtNextStart`]) are given to [`Channel::new`] at the next start.
    ///
    /// # Errors
    /// The first setting that is out of its range ([`Supervision::row`]); nothing is changed then.
    pub fn configure(&self, supervision: &Supervision) -> Result<(), SettingId> {
        let now = self.now();
        let done = self.channel.with(|engine| engine.configure(now, supervision));
        self.channel.wake.signal(());
        done
    }

    /// Tells the atmospheric pressure, for an ECU that asks for it (ZK-14). It is sent for 5 s at most.
    pub fn pressure(&self, pressure: Hectopascals) {
        let now = self.now();
        self.channel.with(|engine| engine.pressure(now, pressure));
    }

    /// What is known of the engine now.
    pub fn telemetry(&self) -> Telemetry {
        let now = self.now();
        self.channel.see(|engine| engine.telemetry(now))
    }

    /// Waits for telemetry, one snapshot for each frame of the ECU or change of order.
    /// `None` when [`LISTENERS`] tasks do so already.
    pub fn telemetry_receiver(&self) -> Option<TelemetryReceiver<'a>> {
        self.channel.telemetry.receiver()
    }

    /// Listens to events from now on. `None` when [`LISTENERS`] tasks do so already.
    pub fn events(&self) -> Option<Events<'a>> {
        self.channel.events.subscriber().ok()
    }

    /// A number that changes at least every 0.1 s while the engine's runner works: for a watchdog.
    pub fn progress(&self) -> u32 {
        self.channel.progress.load(Ordering::Relaxed)
    }

    #[expect(clippy::disallowed_methods, reason = "a command is stamped where it enters")]
    fn now(&self) -> Instant {
        Instant::now()
    }
}
