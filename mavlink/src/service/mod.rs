//! The service: bytes of each port and the time in, frames out. It does no IO and reads no clock.
//!
//! Its methods call one way, a file only those behind it: `poll.rs`; `incoming.rs`; `commands.rs` and `signing.rs`; `outgoing.rs` and
//! `storage.rs`; `parameters.rs`; this one.

mod commands;
mod incoming;
mod outgoing;
pub mod parameters;
mod poll;
#[cfg(feature = "signing")]
mod signing;
mod storage;

use crate::attached::{Attached, Nothing, sealed::Streams};
#[cfg(feature = "signing")]
use crate::cover::Cover;
pub use crate::engine::EngineParts;
use crate::engine::{Engine, Situation};
use crate::frame::Address;
use crate::ids::Severity;
use crate::kind::Kind;
use crate::port::{Class, Port, PortConfig, PortCounters};
use crate::record::NotUsed;
use crate::refusal::Refusal;
use crate::report::Fleet;
use crate::request::RateRequest;
use crate::retained_settings::Defaults;
use crate::sent::{Payload, Sent};
use crate::servo::FrameClock;
use crate::settings::{EngineSettings, Identity, NodeSettings};
use crate::signing::{Signing, SigningCounters, SigningState};
use crate::text::{Limiter, pieces, text};
use crate::vehicle::Vehicle;
use embassy_time::{Duration, Instant};
use heapless::{Deque, Vec};
#[cfg(feature = "record")]
use jetlink::command::Command;
use jetlink::command::Order;
use jetlink::config::EngineConfig;
use jetlink::units::Verbatim;
use jetlink::wiring::{Wiring, WiringError};

/// Time within which an autopilot is received, if there is one.
const LISTEN: Duration = Duration::from_secs(3);
/// Parameters that may wait to be stored.
const PENDING: usize = 8;
/// Systems whose heartbeats are remembered: those that may command.
const STATIONS: usize = 4;

/// Counters of the service. All wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counters {
    /// Commands that were addressed to a component of the node.
    pub commands: u32,
    /// Those that were refused or unknown.
    pub commands_refused: u32,
    /// Parameters that were set.
    pub parameters_set: u32,
    /// Valid frames of our autopilot's outputs.
    pub demands: u32,
    /// Frames of outputs that were repeated or late.
    pub demands_late: u32,
    /// Pulse widths that are not accepted.
    pub demands_odd: u32,
    /// Texts that were dropped: there were too many.
    pub texts_lost: u32,
    /// Events of engines that were lost before they became texts.
    pub events_lost: u32,
    /// Frames ignored because of their signature.
    pub signing: SigningCounters,
}

/// Other requests to the node.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Request {
    /// Restart: no engine turns.
    Reboot,
}

/// MAVLink of a node with up to `N` engines and `P` ports, and attached devices.
#[derive(Debug)]
pub struct Service<'a, const N: usize, const P: usize, A: Attached = Nothing> {
    attached: A,
    /// Streams of the attached devices, on each port.
    streams: [A::Streams; P],
    settings: NodeSettings,
    /// Wiring of each engine from the next start on, and in the image. None for an engine whose wiring is not a parameter.
    wiring: Vec<Wiring, N>,
    image: &'a [Wiring],
    /// The engine that cannot be wired as it is stored.
    contradiction: Option<WiringError>,
    /// Of each engine, a stored setting that is not used.
    not_used: [Option<NotUsed>; N],
    /// As it was at the start: a change takes effect at the next one.
    identity: Identity,
    /// It is from before a reset in flight, and not as the settings have it.
    identity_stays: bool,
    autopilot_port: Option<usize>,
    engines: Vec<Engine<'a>, N>,
    ports: Vec<Port<N>, P>,
    signing: Signing,
    #[cfg(feature = "signing")]
    cover: Cover,
    vehicle: Vehicle,
    request: RateRequest,
    /// Clocks of outputs 1 to 16 and 17 to 32.
    clocks: [FrameClock; 2],
    /// Systems that may command, with their last heartbeat.
    received: Vec<(u8, Instant), STATIONS>,
    /// Limiters of the node and of each engine.
    node_texts: Limiter,
    texts: Vec<Limiter, N>,
    text_id: u16,
    /// System id of a text that the node sends before it has one of its own.
    speaks_as: Option<u8>,
    started: Instant,
    next_tick: Instant,
    next_heartbeat: Instant,
    /// Engine that sends first: a slow port then does not always drop the same one.
    first: usize,
    /// The signing counter that was sent last.
    signing_sent: u8,
    reboot: bool,
    storage: ParameterStorage,
    /// Defaults of the image, with the RAM for what differs from them.
    room: Option<&'static Defaults<'static>>,
    /// The stored settings are damaged, and nobody has confirmed the present ones.
    damaged: bool,
    /// Heartbeats until a text reports the problem with the settings again.
    until_text: u8,
    /// The current settings were nevertheless retained over the reset.
    are_retained: bool,
    /// All records have to be stored again, because the settings were confirmed.
    #[cfg(feature = "signing")]
    rewrite: bool,
    /// All records are being stored.
    #[cfg(feature = "signing")]
    confirming: bool,
    /// Parameters that were set and are not stored yet.
    pending: Deque<Pending, PENDING>,
    /// How many of them were set when the record that is being saved was made.
    saving: usize,
    /// The learnt id could not be stored while an engine was not at rest.
    learnt_waits: bool,
    counters: Counters,
    /// What was handled, for a judge.
    #[cfg(test)]
    pub(crate) handled: std::vec::Vec<(u32, std::vec::Vec<u8>)>,
}

/// What happens to a parameter that was set.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ParameterStorage {
    /// The code that built the service looks after it ([`Service::settings`], [`Service::engine_settings`]).
    ByBuilder,
    /// It is stored: [`Service::next_save`].
    Stored,
    /// It is lost at the next start. A text reports this.
    Lost,
}

/// A parameter that was set and is not stored yet.
#[derive(Clone, Copy, Debug)]
struct Pending {
    port: usize,
    place: Place,
    index: usize,
    /// Its value before: that of an earlier change, if one waits.
    old: i32,
}

/// Component of the node that a message addresses.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Place {
    Node,
    Engine(usize),
}

impl Place {
    const fn engine(self) -> Option<usize> {
        match self {
            Self::Node => None,
            Self::Engine(place) => Some(place),
        }
    }
}

impl<'a, const N: usize, const P: usize> Service<'a, N, P> {
    /// A service for these engines and ports. What exceeds `N` or `P` is left out. `signing` is what was stored of
    /// [`Service::signing`].
    pub fn new(
        now: Instant,
        settings: NodeSettings,
        signing: SigningState,
        engines: impl IntoIterator<Item = EngineParts<'a>>,
        ports: impl IntoIterator<Item = PortConfig>,
    ) -> Self {
        Self::with(now, settings, signing, engines, ports, Nothing)
    }
}

impl<'a, const N: usize, const P: usize, A: Attached> Service<'a, N, P, A> {
    /// The same as [`Service::new`], with attached devices.
    pub fn with(
        now: Instant,
        settings: NodeSettings,
        signing: SigningState,
        engines: impl IntoIterator<Item = EngineParts<'a>>,
        ports: impl IntoIterator<Item = PortConfig>,
        attached: A,
    ) -> Self {
        let engines: Vec<Engine<'a>, N> = engines.into_iter().take(N).map(Engine::new).collect();
        let count = engines.len();
        Self {
            attached,
            streams: core::array::from_fn(|_| A::Streams::new(now)),
            settings,
            wiring: Vec::new(),
            image: &[],
            contradiction: None,
            not_used: [None; N],
            identity: settings.identity,
            identity_stays: false,
            autopilot_port: port_of_autopilot(&settings.identity),
            texts: engines.iter().map(|_| Limiter::new(now)).collect(),
            ports: ports.into_iter().take(P).map(|config| Port::new(now, config, count)).collect(),
            engines,
            signing: Signing::new(now, signing),
            #[cfg(feature = "signing")]
            cover: Cover::new(now),
            vehicle: vehicle(now, &settings.identity),
            request: RateRequest::new(now),
            clocks: [FrameClock::default(); 2],
            received: Vec::new(),
            node_texts: Limiter::new(now),
            text_id: 0,
            speaks_as: None,
            started: now,
            next_tick: now,
            next_heartbeat: now,
            first: 0,
            signing_sent: 0,
            reboot: false,
            storage: ParameterStorage::ByBuilder,
            room: None,
            damaged: false,
            until_text: 0,
            are_retained: false,
            #[cfg(feature = "signing")]
            rewrite: false,
            #[cfg(feature = "signing")]
            confirming: false,
            pending: Deque::new(),
            saving: 0,
            learnt_waits: false,
            counters: Counters::default(),
            #[cfg(test)]
            handled: std::vec::Vec::new(),
        }
    }

    /// Sets ids that are not those of the settings ([`Identity::at_start`]). Call it before anything is received.
    pub fn set_identity(&mut self, now: Instant, identity: Identity) {
        self.identity_stays = identity.packed() != self.settings.identity.packed();
        self.identity = identity;
        self.autopilot_port = port_of_autopilot(&identity);
        self.vehicle = vehicle(now, &identity);
    }

    /// The ids in force, also one that has been learnt since: what a reset in flight must not change.
    pub fn identity(&self) -> Identity {
        let learnt = self.vehicle.id().filter(|_| self.identity.system == 0);
        Identity { learnt: learnt.unwrap_or(self.identity.learnt), ..self.identity }
    }

    /// Opens a port for a new peer, or closes it: until it is opened again, nothing is sent or obeyed there. Ports are open at first.
    pub fn set_open(&mut self, now: Instant, port: usize, is_open: bool) {
        let Some(this) = self.ports.get_mut(port) else { return };
        this.set_open(now, is_open);
        if let Some(streams) = self.streams.get_mut(port) {
            *streams = A::Streams::new(now);
        }
        // Whoever waited there for the end of a start is gone.
        for engine in &mut self.engines {
            engine.progress = engine.progress.filter(|&(waits, _)| usize::from(waits) != port);
        }
    }

    /// Takes bytes to be sent on a port; 0: there are none.
    pub fn transmit(&mut self, port: usize, bytes: &mut [u8]) -> usize {
        self.ports.get_mut(port).map_or(0, |port| port.transmit(bytes))
    }

    /// Whether bytes wait for this port.
    pub fn is_waiting(&self, port: usize) -> bool {
        self.ports.get(port).is_some_and(Port::is_waiting)
    }

    /// Another request to the node. Let the answer go out first. If it is no longer returned, it is cancelled: an
    /// engine has begun to turn.
    pub fn request(&mut self, now: Instant) -> Option<Request> {
        if self.reboot && self.any_turns() {
            self.reboot = false;
            let why = Refusal::Turns;
            self.say(now, Place::Node, Severity::Warning, None, format_args!("no restart: {why}"));
        }
        self.reboot.then_some(Request::Reboot)
    }

    /// The attached devices.
    pub const fn attached(&self) -> &A {
        &self.attached
    }

    /// Counters.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Commands to an engine, by its place from 0, since the last call.
    #[cfg(feature = "record")]
    pub fn take_commands(&mut self, place: usize) -> impl Iterator<Item = Command> + use<N, P, A> {
        let engine = self.engines.get_mut(place);
        engine.map(|engine| core::mem::take(&mut engine.commanded)).into_iter().flatten()
    }

    /// Counters of a port.
    pub fn port_counters(&self, port: usize) -> Option<PortCounters> {
        self.ports.get(port).map(Port::counters)
    }

    /// The settings of the node, as the parameters have them.
    pub fn settings(&self) -> &NodeSettings {
        &self.settings
    }

    /// Wiring of each engine from the next start on, as the parameters have it.
    pub fn wiring(&self) -> &[Wiring] {
        &self.wiring
    }

    /// The key and the other state of signing that has to survive a restart.
    pub fn signing(&self, now: Instant) -> SigningState {
        self.signing.state(now)
    }

    /// The settings of each engine, as the parameters have them.
    pub fn engine_settings(&self) -> impl Iterator<Item = (&EngineConfig, &EngineSettings)> {
        self.engines.iter().map(|engine| (&engine.config, &engine.settings))
    }

    /// The system id of the vehicle, once it is set or learnt.
    pub fn system_id(&self) -> Option<u8> {
        self.vehicle.id()
    }

    /// Whether the settings are lost and nobody has confirmed the present ones.
    pub const fn is_damaged(&self) -> bool {
        self.damaged && !self.are_retained
    }

    /// Whether a person has to confirm the present settings, because the stored ones are damaged.
    pub const fn has_to_be_confirmed(&self) -> bool {
        self.damaged
    }

    /// The system id on a port. There is none on the autopilot's port until it is known, nor while one is being learnt; elsewhere it is 1 until
    /// one is known.
    fn system(&self, now: Instant, port: usize) -> Option<u8> {
        match self.vehicle.id().or(self.speaks_as) {
            Some(id) => Some(id),
            None if self.autopilot_port == Some(port) => None,
            // While an engine is ordered to run, none is learnt, and whoever commands it continues to use the id it knows.
            None if self.vehicle.is_learning(now) && !self.any_is_ordered() => None,
            None if self.autopilot_port.is_some() && now < self.started + LISTEN => None,
            None => Some(1),
        }
    }

    fn component(&self, place: Place) -> u8 {
        let offset = place.engine().map_or(0, |engine| engine + 1);
        u8::try_from(offset).unwrap_or(u8::MAX).saturating_add(self.identity.base)
    }

    /// The component with this id.
    fn place(&self, component: u8) -> Option<Place> {
        match component.checked_sub(self.identity.base)? {
            0 => Some(Place::Node),
            engine => {
                let engine = usize::from(engine) - 1;
                (engine < self.engines.len()).then_some(Place::Engine(engine))
            }
        }
    }

    /// Whether a system may command and set.
    fn may_command(&self, system: u8) -> bool {
        let settings = &self.settings;
        system != 0
            && (system == settings.ground_1
                || system == settings.ground_2
                || settings.own_vehicle && self.vehicle.id() == Some(system))
    }

    /// Whether a system may do this through this port. If the settings are lost, it is unknown who may: anybody may stop, and only a
    /// person at the board may do more.
    fn check(&self, port: usize, system: u8, kind: Kind) -> Result<(), Refusal> {
        #[cfg(feature = "signing")]
        if kind == Kind::Acts
            && let Some(why) = self.cover.refusing
        {
            return Err(why);
        }
        match kind {
            Kind::Stops if self.is_damaged() => Ok(()),
            Kind::Acts if self.is_damaged() && !self.is_usb(port) => Err(Refusal::Damaged),
            _ if self.may_command(system) => Ok(()),
            _ => Err(Refusal::NotAllowed(system)),
        }
    }

    fn situation<'b>(now: Instant, vehicle: &'b Vehicle, received: &'b [(u8, Instant)]) -> Situation<'b> {
        Situation { now, vehicle, received }
    }

    /// Whether whoever uses this port is a person at the board. An image without signing has no USB.
    fn is_usb(&self, port: usize) -> bool {
        cfg!(feature = "signing") && self.ports.get(port).is_some_and(|port| port.config.usb)
    }

    /// Whether any engine is ordered to run, or may be.
    fn any_is_ordered(&self) -> bool {
        self.engines.iter().any(|engine| {
            matches!(engine.telemetry().ordered.order, Order::Run(_) | Order::Doubt(_) | Order::Pwm)
        })
    }

    /// Whether any engine turns or is ordered to.
    fn any_turns(&self) -> bool {
        self.engines.iter().any(Engine::turns)
    }

    /// Sends a message on a port.
    fn send<M: Sent>(&mut self, now: Instant, port: usize, place: Place, class: Class, message: &M) -> bool {
        self.send_payload(now, port, place, class, &Payload::of(message))
    }

    #[inline(never)]
    fn send_payload(
        &mut self,
        now: Instant,
        port: usize,
        place: Place,
        class: Class,
        message: &Payload,
    ) -> bool {
        if !self.ports.get(port).is_some_and(Port::is_open) {
            return false;
        }
        let Some(system) = self.system(now, port) else { return false };
        let from = Address { system, component: self.component(place) };
        // Each port is a separate link to its receivers.
        let seal = self.signing.seal(now, u8::try_from(port).unwrap_or(u8::MAX));
        self.ports
            .get_mut(port)
            .is_some_and(|port| port.send(now, from, place.engine(), class, message, seal))
    }

    /// The component of ours that a message addresses. Component 0, which addresses all of them, is not one of ours. If the node has no id, a stop
    /// addresses ours whatever its system; if the id is lost with the settings, every message does.
    fn addressed(&self, now: Instant, port: usize, target: Address, kind: Kind) -> Option<Place> {
        match self.system(now, port) {
            Some(system) if system == target.system => self.place(target.component),
            None if self.is_damaged() || kind == Kind::Stops => self.place(target.component),
            _ => None,
        }
    }

    /// Reports on all ports why an engine was not started.
    fn say_not_started(&mut self, now: Instant, engine: usize, why: Refusal) {
        self.say(now, Place::Engine(engine), Severity::Warning, None, format_args!("start refused: {why}"));
    }

    /// Sends a text, on all ports, or on one as an answer.
    fn say(
        &mut self,
        now: Instant,
        place: Place,
        severity: Severity,
        port: Option<usize>,
        what: core::fmt::Arguments<'_>,
    ) {
        let limiter = match place {
            Place::Node => Some(&mut self.node_texts),
            Place::Engine(engine) => self.texts.get_mut(engine),
        };
        if !limiter.is_some_and(|limiter| limiter.allows(now, port.is_some())) {
            self.counters.texts_lost = self.counters.texts_lost.wrapping_add(1);
            return;
        }
        self.say_unlimited(now, place, severity, port, what);
    }

    fn say_unlimited(
        &mut self,
        now: Instant,
        place: Place,
        severity: Severity,
        port: Option<usize>,
        what: core::fmt::Arguments<'_>,
    ) {
        let text = match place.engine().and_then(|engine| self.engines.get(engine)) {
            Some(engine) => text(format_args!("{}: {what}", Verbatim(engine.name()))),
            None => text(what),
        };
        self.text_id = self.text_id.checked_add(1).unwrap_or(1);
        let ports = match port {
            Some(port) => port..port + 1,
            None => 0..self.ports.len(),
        };
        for port in ports {
            for piece in pieces(severity, &text, self.text_id) {
                self.send(now, port, place, Class::Always, &piece);
            }
        }
    }

    /// Summary of the engines, for the heartbeat of the node.
    fn fleet(&self) -> Fleet {
        let mut fleet = Fleet::default();
        self.engines.iter().for_each(|engine| fleet.count(&engine.telemetry()));
        fleet
    }
}

/// Place of the autopilot's port.
fn port_of_autopilot(identity: &Identity) -> Option<usize> {
    usize::from(identity.autopilot_port).checked_sub(1)
}

/// The vehicle at a start.
fn vehicle(now: Instant, identity: &Identity) -> Vehicle {
    Vehicle::new(identity.system, identity.learnt).showing_by(now + LISTEN)
}
