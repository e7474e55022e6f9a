//! A node with one simulated engine, a receiver on any input, and MAVLink as the lower source, in virtual time.

use crate::channels::Channels;
use crate::crsf::Crsf;
use crate::input::Input;
use crate::outputs::{Before, Outputs, Valve};
use crate::pilot::{Outcome, Pilot};
use crate::pwm::Pwm;
use crate::sbus::Sbus;
use crate::settings::{EngineSettings, OutputSettings};
use bench::rows::{self, simulated_as};
use embassy_futures::join::join;
use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer};
use jetlink::channel::{Channel, Handle, Source};
use jetlink::command::{Command, Demand, Order, Origin};
use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::engine::retained::{Reset, RetainedMemory};
use jetlink::engine::state::EngineState;
use jetlink::line::Line;
use jetlink::report::LinkState;
use jetlink::runner::LineErrors;
use jetlink::telemetry::Telemetry;
use jetlink::units::Throttle;
use sim::clock;
use sim::receiver::{crsf, sbus, steps};
use sim::wire::{Plug, WireRx, WireTx};
use sim::zk::ZkEcu;
use std::boxed::Box;
use std::cell::{Cell, RefCell};
use std::vec::Vec;

pub const ENGINE: EngineConfig = EngineConfig::zk("left", 0, Line::new(9600), Rate::Hz20);
pub const STOP: u16 = 1000;
pub const STANDBY: u16 = 1500;
pub const RUN: u16 = 2000;
pub const IDLE: u16 = 1100;

static ERRORS: LineErrors = LineErrors::new();

/// Kind of a receiver.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kind {
    Sbus,
    Crsf,
    Pwm,
}

impl Kind {
    pub const ALL: [Self; 3] = [Self::Sbus, Self::Crsf, Self::Pwm];

    fn input(self) -> Input {
        match self {
            Self::Sbus => Input::Sbus(Sbus::new()),
            Self::Crsf => Input::Crsf(Crsf::new()),
            Self::Pwm => Input::Pwm(Pwm::new()),
        }
    }

    /// Channels of throttle, switch and hand-over.
    pub fn settings(self) -> EngineSettings {
        let (throttle, switch, hand_over) = if self == Self::Pwm { (1, 2, 3) } else { (3, 5, 6) };
        EngineSettings { throttle, switch, hand_over, ..EngineSettings::DEFAULT }
    }

    const fn every(self) -> Duration {
        Duration::from_millis(match self {
            Self::Sbus => 14,
            Self::Crsf => 7,
            Self::Pwm => 20,
        })
    }
}

/// The transmitter and the receiver.
#[derive(Debug)]
pub struct Radio {
    pub kind: Kind,
    pub stick: Cell<u16>,
    pub switch: Cell<u16>,
    pub hand_over: Cell<u16>,
    /// The transmitter is on; without it the receiver sends its fail-safe.
    pub on: Cell<bool>,
    /// The receiver is plugged in.
    pub plugged: Cell<bool>,
    /// A channel of pulses that has no wire, from 1.
    pub cut: Cell<u8>,
    /// Stick and switch of a second receiver on the line, which sends every second frame.
    pub second: Cell<Option<(u16, u16)>>,
}

/// Everything that a test reads and moves.
pub struct World<'a> {
    pub radio: &'a Radio,
    pub handle: Handle<'a>,
    pub plug: &'a Plug<ZkEcu>,
    pub pilot: RefCell<Pilot<'a>>,
    pub outputs: RefCell<Outputs>,
    input: RefCell<Input>,
    /// Command that MAVLink streams.
    pub lower: Cell<Option<Command>>,
    lower_source: Source<'a>,
    pub outcomes: RefCell<Vec<(Instant, Outcome)>>,
    /// Changes of the valve.
    pub valve: RefCell<Vec<(Instant, Valve)>>,
}

impl World<'_> {
    pub fn telemetry(&self) -> Telemetry {
        self.handle.telemetry()
    }

    pub fn state(&self) -> EngineState {
        self.telemetry().state
    }

    /// Throttle of the order, in 0.1 %.
    pub fn ordered(&self) -> Option<u16> {
        match self.telemetry().ordered.order {
            Order::Run(Demand::Throttle(throttle)) | Order::Doubt(Demand::Throttle(throttle)) => {
                Some(throttle.tenths())
            }
            _ => None,
        }
    }

    /// Ignitions of the turbine so far.
    pub fn ignitions(&self) -> usize {
        self.plug.ecu(|ecu| ecu.turbine().history().ignitions.len())
    }

    pub async fn pass_s(&self, seconds: f64) {
        Timer::after(Duration::from_micros((seconds * 1e6) as u64)).await;
    }

    #[track_caller]
    pub fn until(
        &self,
        what: &'static str,
        seconds: u64,
        done: impl Fn() -> bool,
    ) -> impl Future<Output = ()> {
        let caller = core::panic::Location::caller();
        async move {
            let so = clock::until(Duration::from_secs(seconds), Duration::from_millis(5), done).await;
            let last = self.outcomes.borrow().last().copied();
            assert!(so, "not within {seconds} s: {what} ({caller}), {last:?}");
        }
    }

    /// Moves the switch, and waits until it has settled.
    pub async fn switch(&self, position: u16) {
        self.radio.switch.set(position);
        self.pass_s(0.7).await;
    }

    /// Moves from stop to standby: releases and arms.
    pub async fn arm(&self) {
        self.radio.stick.set(IDLE);
        self.switch(STOP).await;
        self.pass_s(1.0).await;
        self.standby_by(STANDBY).await;
    }

    /// Moves the switch to this standby position, and waits until the engine is armed and ready.
    pub async fn standby_by(&self, position: u16) {
        self.radio.switch.set(position);
        self.until("armed", 30, || self.telemetry().armed).await;
        self.until("standby", 60, || self.state() == EngineState::Standby).await;
        self.pass_s(2.0).await;
    }

    /// Moves the switch to this run position, and waits until the engine runs.
    pub async fn run_by(&self, position: u16) {
        self.radio.switch.set(position);
        self.until("running", 120, || self.state() == EngineState::Running).await;
    }

    /// Arms and starts the engine, and waits until it runs.
    pub async fn start(&self) {
        self.arm().await;
        self.run_by(RUN).await;
        self.pass_s(5.0).await;
    }

    /// The same, and then half throttle.
    pub async fn start_to_half(&self) {
        self.start().await;
        self.radio.stick.set(1500);
        self.until("half throttle", 5, || self.ordered() == Some(500)).await;
    }

    /// Waits until the throttle is ordered, and looks that it never rises faster than 50 % a second.
    pub async fn rises_to(&self, tenths: u16) {
        let mut before = self.ordered().unwrap();
        let end = Instant::now() + Duration::from_secs(15);
        while before != tenths {
            self.pass_s(0.02).await;
            let ordered = self.ordered().unwrap();
            assert!(ordered <= before + 30, "from {before} to {ordered} in 20 ms");
            assert!(Instant::now() < end, "{before} and not {tenths}");
            before = ordered;
        }
    }

    /// The last command of radio control within the last 0.1 s.
    pub fn commanded(&self) -> Option<Command> {
        let since = Instant::now() - Duration::from_millis(100);
        match self.outcomes.borrow().last() {
            Some(&(at, Outcome::Commanded(command, _))) if at >= since => Some(command),
            _ => None,
        }
    }

    /// Sends the receiver's frames, as its line carries them.
    async fn receive(&self) {
        loop {
            Timer::after(self.radio.kind.every()).await;
            let now = Instant::now();
            if !self.radio.plugged.get() {
                continue;
            }
            let own = (self.radio.stick.get(), self.radio.switch.get());
            let every = self.radio.kind.every().as_ticks();
            let is_second = now.as_ticks() / every % 2 == 1;
            let (stick, switch) = self.radio.second.get().filter(|_| is_second).unwrap_or(own);
            let hand = self.radio.hand_over.get();
            let mut channels = [992; 16];
            (channels[2], channels[4], channels[5]) = (steps(stick), steps(switch), steps(hand));
            let on = self.radio.on.get();
            let bytes = match self.radio.kind {
                Kind::Sbus => sbus(channels, if on { 0 } else { 0x0C }),
                Kind::Crsf if on => crsf(channels),
                Kind::Crsf => continue,
                Kind::Pwm => {
                    for (number, width) in [(1, stick), (2, switch), (3, hand)] {
                        if on && self.radio.cut.get() != number {
                            let counts = self.input.borrow_mut().pulse(now, number, width.into(), 20_000);
                            self.count(now, counts);
                        }
                    }
                    continue;
                }
            };
            self.bytes(now, &bytes);
        }
    }

    /// Takes bytes of the receiver.
    pub fn bytes(&self, now: Instant, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            let (taken, counts) = self.input.borrow_mut().receive(now, bytes);
            bytes = &bytes[taken..];
            self.count(now, counts);
        }
    }

    fn count(&self, now: Instant, channels: Option<Channels>) {
        let Some(channels) = channels else { return };
        let outcome = self.pilot.borrow_mut().frame(now, &channels);
        self.outcomes.borrow_mut().push((now, outcome));
        self.follow();
    }

    /// Moves the valve after the engine.
    fn follow(&self) {
        let telemetry = self.telemetry();
        let mut outputs = self.outputs.borrow_mut();
        let before = outputs.valve();
        outputs.update(&telemetry);
        if outputs.valve() != before {
            self.valve.borrow_mut().push((telemetry.at, outputs.valve()));
        }
    }

    async fn serve(&self) {
        loop {
            Timer::after(Duration::from_millis(50)).await;
            if let Some(command) = self.lower.get() {
                let _ = self.lower_source.command(command);
            }
            self.follow();
            // An engine burns only fuel from an open valve.
            let burns =
                self.plug.ecu(|ecu| ecu.turbine().fuel_flow() > 0.0 && !self.telemetry().stop_latched);
            let closed = self.outputs.borrow().valve() == Valve::Closed;
            let Telemetry { obeyed, link, ordered, .. } = self.telemetry();
            // A person wants it to stop, and nothing is received.
            let given_up =
                ordered.order == Order::Standby && ordered.origin != Origin::Node && link != LinkState::Up;
            let healthy = obeyed && burns && !given_up;
            assert!(!healthy || !closed, "a closed valve at a healthy engine: {:?}", self.telemetry());
        }
    }
}

/// The scenario with each kind of receiver.
pub fn each(scenario: impl AsyncFn(&World<'_>)) {
    for kind in Kind::ALL {
        run(kind, async |world| scenario(world).await);
    }
}

/// Runs a scenario with one life of a node, from power-up.
pub fn run(kind: Kind, scenario: impl AsyncFnOnce(&World<'_>)) {
    begin(kind, async |radio, plug, halves| {
        life(&Life { radio, plug, memory: None, settings: kind.settings() }, halves, scenario).await;
    });
}

/// One life of a node, from its start to its reset.
pub struct Life<'a> {
    pub radio: &'a Radio,
    pub plug: &'a Plug<ZkEcu>,
    pub memory: Option<(&'static RetainedMemory, Reset)>,
    pub settings: EngineSettings,
}

pub async fn life(life: &Life<'_>, (rx, tx): (WireRx, WireTx), scenario: impl AsyncFnOnce(&World<'_>)) {
    let channel = Channel::new(&ENGINE, life.memory);
    let owner = channel.owner();
    let retained = life.memory.and_then(|(memory, reset)| memory.load(ENGINE.fingerprint(), reset));
    let pilot = Pilot::new(owner.source(Origin::Rc).unwrap(), &ENGINE, life.settings).unwrap();
    let world = World {
        radio: life.radio,
        handle: owner.handle(),
        plug: life.plug,
        pilot: RefCell::new(pilot),
        outputs: RefCell::new(Outputs::new(
            OutputSettings::DEFAULT,
            Before { record: retained, ..Before::default() },
        )),
        input: RefCell::new(life.radio.kind.input()),
        lower: Cell::new(None),
        lower_source: owner.source(Origin::Mavlink).unwrap(),
        outcomes: RefCell::default(),
        valve: RefCell::default(),
    };
    let work = join(channel.runner().run(rx, tx, &ERRORS), join(world.receive(), world.serve()));
    select(work, scenario(&world)).await;
}

/// A world without a node: radio, ECU and wire.
pub fn begin(kind: Kind, scenario: impl AsyncFnOnce(&Radio, &Plug<ZkEcu>, (WireRx, WireTx))) {
    clock::reset();
    let (rx, tx, plug) = rows::wire(&ENGINE, ZkEcu::new(simulated_as(&ENGINE)), 1);
    let radio = Radio {
        kind,
        stick: Cell::new(IDLE),
        switch: Cell::new(STOP),
        hand_over: Cell::new(1000),
        on: Cell::new(true),
        plugged: Cell::new(true),
        cut: Cell::new(0),
        second: Cell::new(None),
    };
    clock::run(select(plug.run(), scenario(&radio, &plug, (rx, tx))));
}

/// Memory that survives a reset.
pub fn memory() -> &'static RetainedMemory {
    Box::leak(Box::new(RetainedMemory::new()))
}

pub fn run_at_tenths(tenths: u16) -> Command {
    Command::Run(Demand::Throttle(Throttle::from_tenths(tenths).unwrap()))
}
