//! Connects an engine's runner with its users: commands in, telemetry and events out.
//!
//! Each engine has its own [`Channel`]: two engines share nothing. There is no queue of commands. A [`Source`] changes the
//! engine's state directly, under a lock held for microseconds, and returns its answer at once. So an old throttle never
//! follows a new one, and nothing delays a stop.

use crate::command::{Accepted, Command, Demand, Origin, Rejected};
use crate::config::{EngineConfig, LinkSettings, LinkSettingsError};
use crate::engine::Engine;
use crate::engine::config::{Supervision, SupervisionError};
use crate::engine::retained::{Reset, RetainedMemory};
use crate::event::Event;
use crate::sentence::sentences;
use crate::telemetry::Telemetry;
use crate::units::{Hectopascals, Millivolts};
use core::cell::RefCell;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pubsub::{PubSubChannel, Subscriber};
use embassy_sync::signal::Signal;
use embassy_sync::watch::{self, Watch};
use embassy_time::Instant;
use heapless::Vec;

/// Capacity of the queue of events. A slow subscriber loses the oldest ones and receives their number.
pub const EVENT_CAPACITY: usize = 32;
/// Subscribers to one engine's events, and receivers of its telemetry.
pub const LISTENERS: usize = 4;
/// More than a start can be refused for at once.
const REFUSALS: usize = 32;

/// Subscription to one engine's events.
pub type Events<'a> = Subscriber<'a, CriticalSectionRawMutex, Event, EVENT_CAPACITY, LISTENERS, 0>;
/// Receiver of one engine's telemetry. It waits for news; the snapshot is of the instant in which they are received.
pub struct TelemetryReceiver<'a> {
    handle: Handle<'a>,
    news: watch::Receiver<'a, CriticalSectionRawMutex, (), LISTENERS>,
}

impl core::fmt::Debug for TelemetryReceiver<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("TelemetryReceiver").field("handle", &self.handle).finish_non_exhaustive()
    }
}

impl TelemetryReceiver<'_> {
    /// Waits for a frame of the ECU or a change of the order since the last call.
    pub async fn changed(&mut self) -> Telemetry {
        self.news.changed().await;
        self.handle.telemetry()
    }

    /// The same without waiting.
    pub fn try_changed(&mut self) -> Option<Telemetry> {
        self.news.try_changed().map(|()| self.handle.telemetry())
    }
}

/// One engine, shared by its runner and its handles.
pub struct Channel {
    name: &'static str,
    engine: Mutex<CriticalSectionRawMutex, RefCell<Engine>>,
    /// Wakes the runner: the engine may have an output.
    pub(crate) wake: Signal<CriticalSectionRawMutex, ()>,
    pub(crate) events: PubSubChannel<CriticalSectionRawMutex, Event, EVENT_CAPACITY, LISTENERS, 0>,
    /// Wakes the receivers of telemetry. It has no snapshot: each would be a kilobyte, copied with interrupts off at every frame.
    pub(crate) news: Watch<CriticalSectionRawMutex, (), LISTENERS>,
    progress: AtomicU32,
    /// Claimed sources, a bit for each priority.
    claimed: AtomicU8,
    /// Memory for the state that survives a reset.
    memory: Option<Retained>,
}

/// Memory that survives a reset, and the fingerprint of its engine.
struct Retained {
    memory: &'static RetainedMemory,
    fingerprint: u32,
}

impl core::fmt::Debug for Channel {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Channel").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Channel {
    /// A channel for one engine. `retained` is memory that survives a reset, with the kind of the last reset: a running engine
    /// resumes after a warm reset; after a loss of power nothing is restored that could start an engine or raise its demand.
    ///
    /// With `None` every reset clears the order, the arming and a latched emergency stop. It is for tests and for programs
    /// that never reset while an engine runs.
    pub fn new(config: &EngineConfig, retained: Option<(&'static RetainedMemory, Reset)>) -> Self {
        let mut engine = Engine::new(config);
        let memory = retained.map(|(memory, reset)| {
            let fingerprint = config.fingerprint();
            let record = memory.load(fingerprint, reset);
            engine.restore(record);
            memory.repair();
            // A warm reset before the first change must not bring back what a loss of power has taken.
            if let Some(record) = record {
                memory.store(&record, fingerprint);
            }
            Retained { memory, fingerprint }
        });
        Self {
            name: config.name,
            engine: Mutex::new(RefCell::new(engine)),
            wake: Signal::new(),
            events: PubSubChannel::new(),
            news: Watch::new(),
            progress: AtomicU32::new(0),
            claimed: AtomicU8::new(0),
            memory,
        }
    }

    /// A handle to the engine; any number.
    pub const fn handle(&self) -> Handle<'_> {
        self.owner().handle()
    }

    /// The owner of the engine.
    pub const fn owner(&self) -> Owner<'_> {
        self.owner_in(core::slice::from_ref(self))
    }

    /// The owner of the engine as one of a group, whose engines start one after the other and report failures to each other.
    /// [`crate::node::Node`] makes a group of a table of engines.
    pub const fn owner_in<'a>(&'a self, group: &'a [Channel]) -> Owner<'a> {
        Owner { handle: Handle { channel: self, group } }
    }

    /// Starts the engine.
    pub(crate) fn begin(&self, now: Instant) {
        self.with(|engine| engine.start(now));
    }

    /// Changes the engine. Interrupts wait meanwhile, so keep it short.
    pub(crate) fn with<T>(&self, act: impl FnOnce(&mut Engine) -> T) -> T {
        let result = self.engine.lock(|engine| act(&mut engine.borrow_mut()));
        // Interrupts may come in between: a byte waits for one of the two, and not for both.
        self.retain();
        result
    }

    /// Stores what survives a reset, if it has changed. Not a part of `with`, which is compiled once for each input.
    #[inline(never)]
    fn retain(&self) {
        let Some(retained) = &self.memory else { return };
        self.engine.lock(|engine| {
            if let Some(words) = engine.borrow_mut().take_retained() {
                retained.memory.store_packed(words, retained.fingerprint);
            }
        });
    }

    /// Inspects the engine. Interrupts wait meanwhile, so keep it short.
    pub(crate) fn inspect<T>(&self, look: impl FnOnce(&Engine) -> T) -> T {
        self.engine.lock(|engine| look(&engine.borrow()))
    }

    pub(crate) fn made_progress(&self) {
        // No atomic addition: only the runner writes.
        let count = self.progress.load(Ordering::Relaxed).wrapping_add(1);
        self.progress.store(count, Ordering::Relaxed);
    }
}

/// Telemetry and events of one engine, for code that only listens: it can neither command nor change anything. Copies may be used in several tasks.
///
/// Only the owner claims sources:
///
/// ```
/// # use jetlink::{channel::Channel, command::Origin, config::EngineConfig, ecu::zk::codec::Rate, line::Line};
/// # let config = EngineConfig::zk("a", 0, Line::new(9600), Rate::Hz100);
/// let channel = Channel::new(&config, None);
/// let source = channel.owner().source(Origin::Bench);
/// ```
///
/// ```compile_fail,E0599
/// # use jetlink::{channel::Channel, command::Origin, config::EngineConfig, ecu::zk::codec::Rate, line::Line};
/// # let config = EngineConfig::zk("a", 0, Line::new(9600), Rate::Hz100);
/// let channel = Channel::new(&config, None);
/// let source = channel.handle().source(Origin::Bench);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Handle<'a> {
    channel: &'a Channel,
    /// All engines of the group, this one among them.
    group: &'a [Channel],
}

/// Everything that may be done with one engine. It stays with the code that builds the node, which gives a [`Source`] to
/// code that commands, a [`Setup`] to code that changes settings, and a [`Handle`] to code that only listens.
#[derive(Clone, Copy, Debug)]
pub struct Owner<'a> {
    handle: Handle<'a>,
}

/// The right to change the settings of one engine, and to give it what the board measures.
#[derive(Clone, Copy, Debug)]
pub struct Setup<'a> {
    channel: &'a Channel,
}

/// The right to command one engine as one source. There is one for each origin at a time, and it gives access to no other, so
/// that no task can command as another source. [`Owner::source`] claims it, and dropping it releases it.
#[derive(Debug)]
pub struct Source<'a> {
    handle: Handle<'a>,
    origin: Origin,
}

/// Why a source cannot be claimed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum ClaimError {
    /// It is claimed already.
    Taken(Origin),
    /// The node itself is not a source.
    Node,
    /// Only [`Owner::emergency_source`] claims the highest source.
    Emergency,
}

sentences!(ClaimError {
    Self::Node => "the node is not a source: claim bench, mavlink or rc";
    Self::Emergency => "claim the emergency source with emergency_source()";
} {
    Self::Taken(origin) => "the source {} is claimed already: share it, or drop it first", origin;
});

impl core::error::Error for ClaimError {}

impl<'a> Source<'a> {
    /// The origin of its commands.
    pub const fn origin(&self) -> Origin {
        self.origin
    }

    /// A handle to the engine that it commands.
    pub const fn handle(&self) -> Handle<'a> {
        self.handle
    }

    /// Commands the engine. The latest command of a source replaces its earlier one, the highest fresh source is in control,
    /// and a stop pre-empts everything. A source has to repeat `Run` within its timeout
    /// ([`crate::engine::config::SourceTimeouts`]).
    ///
    /// # Errors
    /// [`Rejected`] with the reason. The order does not change.
    pub fn command(&self, command: Command) -> Result<Accepted, Rejected> {
        self.handle.command(command, self.origin)
    }

    /// Whether the engine is armed and this source has armed it: its last command of both was "arm", also before a reset.
    pub fn has_armed(&self) -> bool {
        self.handle.channel.inspect(|engine| engine.is_armed_by(self.origin))
    }
}

impl Drop for Source<'_> {
    fn drop(&mut self) {
        let claimed = &self.handle.channel.claimed;
        // A critical section, because not every core has atomic read-modify-write.
        critical_section::with(|_| {
            let left = claimed.load(Ordering::Relaxed) & !(1 << self.origin.priority());
            claimed.store(left, Ordering::Relaxed);
        });
    }
}

impl<'a> Owner<'a> {
    /// A handle to the engine; any number.
    pub const fn handle(&self) -> Handle<'a> {
        self.handle
    }

    /// The right to set the engine up.
    pub const fn setup(&self) -> Setup<'a> {
        Setup { channel: self.handle.channel }
    }

    /// Claims the source `Bench`, `Mavlink` or `Rc` until the result is dropped.
    ///
    /// # Errors
    /// [`ClaimError`] if it is claimed already, or is not one of these.
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
    /// [`ClaimError::Taken`] if it is claimed already.
    pub fn emergency_source(&self) -> Result<Source<'a>, ClaimError> {
        self.claim(Origin::Emergency)
    }

    fn claim(&self, origin: Origin) -> Result<Source<'a>, ClaimError> {
        let claimed = &self.handle.channel.claimed;
        let bit = 1 << origin.priority();
        let free = critical_section::with(|_| {
            let before = claimed.load(Ordering::Relaxed);
            claimed.store(before | bit, Ordering::Relaxed);
            before & bit == 0
        });
        if free { Ok(Source { handle: self.handle, origin }) } else { Err(ClaimError::Taken(origin)) }
    }
}

impl Setup<'_> {
    /// Changes the settings of the supervision while the engine runs, from the next frame, command or deadline on
    /// ([`crate::setting::Effect::AtOnce`]).
    ///
    /// # Errors
    /// The first setting that is out of its range, with nothing changed.
    pub fn configure(&self, supervision: &Supervision) -> Result<(), SupervisionError> {
        let now = now();
        let done = self.channel.with(|engine| engine.configure(now, supervision));
        self.channel.wake.signal(());
        done
    }

    /// Changes the settings of the link ([`crate::setting::Effect::AtRest`]): as soon as the engine is at rest, that is with
    /// standby or an emergency stop in force and an ECU that reports a stopped engine. Until then they wait
    /// ([`Handle::link_settings_wait`]), and later ones replace them. They are lost at a reset: keep them in the
    /// [`EngineConfig`] that [`Channel::new`] is given.
    ///
    /// # Errors
    /// [`LinkSettingsError`], with nothing changed: a value is out of its range, the line cannot carry the protocol, or it is
    /// another protocol or engine.
    pub fn configure_link(&self, settings: &LinkSettings) -> Result<(), LinkSettingsError> {
        let now = now();
        let done = self.channel.with(|engine| engine.configure_link(now, settings));
        self.channel.wake.signal(());
        done
    }

    /// Sets the atmospheric pressure, for an ECU that requests it (ZK-14). It is sent for 5 s at most.
    pub fn pressure(&self, pressure: Hectopascals) {
        let now = now();
        self.channel.with(|engine| engine.pressure(now, pressure));
    }

    /// Sets the supply voltage that the board measures, several times a second. It is used where the ECU reports none.
    pub fn board_supply(&self, voltage: Millivolts) {
        let now = now();
        self.channel.with(|engine| engine.board_supply(now, voltage));
        self.channel.wake.signal(());
    }
}

impl<'a> Handle<'a> {
    /// The engine's name.
    pub const fn name(&self) -> &'static str {
        self.channel.name
    }

    fn command(&self, command: Command, origin: Origin) -> Result<Accepted, Rejected> {
        let now = now();
        // One command at a time, so that two engines cannot both find the other at rest.
        let answer = critical_section::with(|_| {
            let free =
                matches!(command, Command::Run(_) | Command::HandOverToPwm) && self.others_allow_start(now);
            self.channel.with(|engine| engine.command(now, command, origin, free))
        });
        self.channel.wake.signal(());
        answer
    }

    fn others_allow_start(&self, now: Instant) -> bool {
        let mut others = self.group.iter().filter(|other| !core::ptr::eq(*other, self.channel));
        others.all(|other| !other.inspect(|engine| engine.blocks_other_starts(now)))
    }

    /// Everything that keeps a `Run` of this source from starting the engine now ([`Engine::start_refusals`]). Nothing changes.
    /// `found` is called afterwards and may use the engine.
    pub fn start_refusals(&self, demand: Demand, origin: Origin, found: impl FnMut(Rejected)) {
        let now = now();
        let free = self.others_allow_start(now);
        let mut refusals = Vec::<Rejected, REFUSALS>::new();
        self.channel.inspect(|engine| {
            engine.start_refusals(now, demand, origin, free, |why| {
                // There is space for each of them.
                let _ = refusals.push(why);
            });
        });
        refusals.into_iter().for_each(found);
    }

    /// Whether settings of the link wait until the engine is at rest.
    pub fn link_settings_wait(&self) -> bool {
        self.channel.inspect(|engine| engine.link_settings_wait())
    }

    /// A snapshot of the engine.
    pub fn telemetry(&self) -> Telemetry {
        let now = now();
        self.channel.inspect(|engine| engine.telemetry(now))
    }

    /// Receives telemetry: a snapshot for each frame of the ECU or change of the order.
    /// `None` if there are [`LISTENERS`] receivers already.
    pub fn telemetry_receiver(&self) -> Option<TelemetryReceiver<'a>> {
        Some(TelemetryReceiver { handle: *self, news: self.channel.news.receiver()? })
    }

    /// Subscribes to events from now on. `None` if there are [`LISTENERS`] subscribers already.
    pub fn events(&self) -> Option<Events<'a>> {
        self.channel.events.subscriber().ok()
    }

    /// A counter that changes at least every 0.1 s while the engine's runner works, for a watchdog.
    pub(crate) fn progress(&self) -> u32 {
        self.channel.progress.load(Ordering::Relaxed)
    }
}

#[expect(clippy::disallowed_methods, reason = "a command is stamped where it enters")]
fn now() -> Instant {
    Instant::now()
}
