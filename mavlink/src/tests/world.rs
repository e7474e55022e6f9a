//! A node with two simulated engines, an autopilot on port 0 and a ground station on port 1, in virtual time.

use super::attached::{State, Toy};
use crate::dialect::*;
use crate::frame::{Address, Decoder, Frame, MAX_FRAME, encode, encode_to_sign};
use crate::ids::*;
use crate::port::PortConfig;
use crate::report::state_number;
use crate::retained_settings::Defaults;
use crate::service::{EngineParts, ParameterStorage, Request, Service};
use crate::settings::{EngineSettings, Identity, NodeSettings};
use crate::signing::{Key, Seal, Signature, SigningState, Stamp};
use bench::rows::{self, simulated, simulated_as};
use embassy_futures::join::{join, join3};
use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer};
use jetlink::command::{Command, Demand, Origin};
use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::engine::state::EngineState;
use jetlink::line::Line;
use jetlink::node::Node;
use jetlink::runner::LineErrors;
use jetlink::telemetry::Telemetry;
use jetlink::units::Throttle;
use mavlink_core::MessageData;
use sim::amt::AmtEcu;
use sim::clock;
use sim::wire::Plug;
use std::boxed::Box;
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::string::String;
use std::vec::Vec;

pub const SYSTEM: u8 = 3;
pub const AUTOPILOT: Address = Address { system: SYSTEM, component: 1 };
pub const GROUND: Address = Address { system: 255, component: 190 };
pub const NODE: u8 = 25;
/// Component of an engine, from 0.
pub const ENGINE: [u8; 2] = [26, 27];
pub const TO_AUTOPILOT: usize = 0;
pub const TO_GROUND: usize = 1;
pub const IDLE_US: u16 = 1100;
/// Results of a command (MAV_RESULT).
pub const ACCEPTED: Option<u8> = Some(0);
pub const NOT_NOW: Option<u8> = Some(1);
pub const DENIED: Option<u8> = Some(2);
/// Time stamp of the autopilot and the ground station at the start of the scenario.
pub const SENDERS_STAMP: u64 = 90_000_000_000_000;

static ERRORS: LineErrors = LineErrors::new();

pub type TestService<'a> = Service<'a, 2, 2, Toy>;

/// The simulated autopilot.
#[derive(Debug)]
pub struct Plane {
    /// It sends heartbeats and outputs.
    pub alive: Cell<bool>,
    pub armed: Cell<bool>,
    /// It sends heartbeats; off: its outputs only.
    pub heartbeats: Cell<bool>,
    pub system: Cell<u8>,
    /// Pulse widths of outputs 1 to 16; engines use 3 and 4.
    pub outputs: Cell<[u16; 16]>,
    /// Time between two frames of outputs; `None`: as granted.
    pub every: Cell<Option<Duration>>,
    granted: Cell<Option<Duration>>,
    /// It is PX4, with these pulse widths in the second instance of its outputs, ten times a second; `None` there: that instance is gone.
    pub px4: Cell<Option<Option<[u16; 16]>>>,
    /// Time at which its clock began.
    pub booted: Cell<Instant>,
    pub requests: RefCell<Vec<(Instant, f32)>>,
}

/// Everything that a test reads and changes.
pub struct World<'a> {
    pub service: RefCell<TestService<'a>>,
    /// Attached devices; off at first.
    pub toy: Rc<State>,
    pub node: &'a Node<2>,
    pub plane: Plane,
    /// The ground station sends heartbeats.
    pub ground: Cell<bool>,
    /// Key of the autopilot and the ground station, and their last time stamp.
    pub key: Cell<Option<Key>>,
    pub stamp: Cell<u64>,
    /// How far the autopilot's clock is behind, in 10 µs.
    pub autopilot_behind: Cell<u64>,
    /// The node also has that key, but not while a test sets it.
    pub key_is_everywhere: Cell<bool>,
    ports: [PortConfig; 2],
    /// The service restarted: the transmission in progress is cut off.
    restarted: Cell<bool>,
    pub frames: RefCell<Vec<(Instant, usize, Frame)>>,
    /// Bytes that were sent on each port.
    pub bytes: RefCell<[usize; 2]>,
    /// Line and ECU of the first engine.
    pub left: &'a Plug<AmtEcu>,
}

impl World<'_> {
    pub fn say<M: MessageData>(&self, port: usize, from: Address, message: &M) {
        self.say_bytes(port, &self.frame(port, from, message));
    }

    pub fn say_bytes(&self, port: usize, bytes: &[u8]) {
        self.service.borrow_mut().receive(Instant::now(), port, bytes);
    }

    /// A frame, signed if there is a key.
    pub fn frame<M: MessageData>(
        &self,
        port: usize,
        from: Address,
        message: &M,
    ) -> heapless::Vec<u8, MAX_FRAME> {
        let Some(key) = self.key.get() else { return encode(from, 0, message) };
        let clock = SENDERS_STAMP + Instant::now().as_micros() / 10;
        self.stamp.set(clock.max(self.stamp.get() + 1));
        let mut frame = encode_to_sign(from, 0, message);
        let behind = if port == TO_AUTOPILOT { self.autopilot_behind.get() } else { 0 };
        let stamp = Stamp::new(self.stamp.get() - behind).unwrap();
        Seal { key: &key, link: port as u8, stamp }.sign(&mut frame);
        frame
    }

    /// Requests to the node.
    pub fn request(&self) -> Option<Request> {
        self.service.borrow_mut().request(Instant::now())
    }

    pub fn telemetry(&self, engine: usize) -> Telemetry {
        self.node.handles()[engine].telemetry()
    }

    pub fn state(&self, engine: usize) -> u8 {
        state_number(self.telemetry(engine).state)
    }

    pub async fn pass_s(&self, seconds: f64) {
        Timer::after(Duration::from_micros((seconds * 1e6) as u64)).await;
    }

    /// Waits until the condition holds.
    #[track_caller]
    pub fn until(
        &self,
        what: &'static str,
        seconds: u64,
        done: impl Fn() -> bool,
    ) -> impl Future<Output = ()> {
        let caller = core::panic::Location::caller();
        async move {
            let so = clock::until(Duration::from_secs(seconds), Duration::from_millis(20), done).await;
            assert!(so, "not within {seconds} s: {what} ({caller})");
        }
    }

    /// Sends a command and returns its answer, which arrives within 0.5 s, with the accompanying texts.
    pub async fn command_from(
        &self,
        port: usize,
        from: Address,
        (system, component): (u8, u8),
        command: u16,
        confirmation: u8,
        params: &[f32],
    ) -> (Option<u8>, String) {
        let param = |i: usize| params.get(i).copied().unwrap_or(0.0);
        let message = COMMAND_LONG_DATA {
            param1: param(0),
            param2: param(1),
            param3: param(2),
            param4: param(3),
            param5: param(4),
            param6: param(5),
            param7: param(6),
            command,
            target_system: system,
            target_component: component,
            confirmation,
        };
        let frame = self.frame(port, from, &message);
        self.answer_to(port, &frame, from, (system, component), command).await
    }

    /// Sends the frame of a command and returns its answer.
    pub async fn answer_to(
        &self,
        port: usize,
        frame: &[u8],
        from: Address,
        (system, component): (u8, u8),
        command: u16,
    ) -> (Option<u8>, String) {
        let at = self.frames.borrow().len();
        self.say_bytes(port, frame);
        self.pass_s(0.2).await;
        let frames = self.frames.borrow();
        let mut texts = String::new();
        let mut result = None;
        for (_, on, frame) in frames.iter().skip(at).filter(|(_, on, _)| *on == port) {
            assert_eq!(*on, port);
            match &frame.message() {
                MavMessage::COMMAND_ACK(ack) if ack.command == command => {
                    assert_eq!((ack.target_system, ack.target_component), (from.system, from.component));
                    assert_eq!((frame.from.system, frame.from.component), (system, component));
                    assert_eq!(result.replace(ack.result), None, "answered twice");
                }
                MavMessage::STATUSTEXT(text) => texts += text.text.to_str().unwrap(),
                _ => {}
            }
        }
        (result, texts)
    }

    pub async fn command(&self, component: u8, command: u16, params: &[f32]) -> (Option<u8>, String) {
        self.command_from(TO_GROUND, GROUND, (SYSTEM, component), command, 0, params).await
    }

    /// `DO_ENGINE_CONTROL`.
    pub async fn control(&self, engine: usize, params: &[f32]) -> (Option<u8>, String) {
        self.command(ENGINE[engine], CMD_DO_ENGINE_CONTROL, params).await
    }

    /// Sets a parameter and returns the answer, with the texts.
    pub async fn set(&self, component: u8, name: &str, value: f32) -> (Option<f32>, String) {
        let at = self.frames.borrow().len();
        let message = PARAM_SET_DATA {
            param_value: value,
            target_system: SYSTEM,
            target_component: component,
            param_id: name.into(),
            param_type: PARAM_REAL32,
        };
        self.say(TO_GROUND, GROUND, &message);
        self.pass_s(0.2).await;
        self.answers(at)
    }

    /// The last value of a parameter and all texts since frame `at`.
    pub fn answers(&self, at: usize) -> (Option<f32>, String) {
        let (mut echo, mut texts) = (None, String::new());
        for (_, _, frame) in self.frames.borrow().iter().skip(at).filter(|(_, port, _)| *port == TO_GROUND) {
            match &frame.message() {
                MavMessage::PARAM_VALUE(value) => echo = Some(value.param_value),
                MavMessage::STATUSTEXT(text) => texts += text.text.to_str().unwrap(),
                _ => {}
            }
        }
        (echo, texts)
    }

    /// The node's service restarts, as after a reset: it retains only the settings.
    pub fn restart_service(&self) {
        let settings = *self.service.borrow().settings();
        self.restart_with(settings);
    }

    /// The same, with damaged stored settings: the defaults apply.
    pub fn lose_settings(&self) {
        self.restart_with(NodeSettings::DEFAULT);
        self.service.borrow_mut().set_damaged(true);
    }

    fn restart_with(&self, settings: NodeSettings) {
        let now = Instant::now();
        let (signing, engines): (_, Vec<_>) = {
            let service = self.service.borrow();
            let engines = service.engine_settings().map(|(config, of)| (*config, *of)).collect();
            (retained(service.signing(now)), engines)
        };
        let ports = self.ports;
        // Returns the sources first.
        self.service.replace(Service::with(
            now,
            settings,
            SigningState::NONE,
            [],
            ports,
            Toy(self.toy.clone()),
        ));
        let parts = self.node.owners().into_iter().zip(engines);
        let parts = parts.map(|(owner, (config, settings))| EngineParts {
            source: owner.source(Origin::Mavlink).unwrap(),
            setup: owner.setup(),
            config,
            settings,
        });
        let toy = Toy(self.toy.clone());
        self.service.replace(Service::with(now, settings, signing, parts, ports, toy));
        self.restarted.set(true);
    }

    /// RAM has space for the settings that differ from these defaults, and this many bytes more.
    pub fn leave_room(&self, storage: ParameterStorage, defaults: Defaults<'static>, bytes: usize) {
        let mut service = self.service.borrow_mut();
        service.set_parameter_storage(storage);
        let now: usize = service.changes(&defaults).map(|(_, record)| 2 + record.len()).sum();
        service.set_room(Box::leak(Box::new(Defaults { room: 4 + now + bytes, ..defaults })));
    }

    /// Outputs 3 and 4, which engines 0 and 1 follow.
    pub fn throttle(&self, pulse: u16) {
        let mut outputs = self.plane.outputs.get();
        (outputs[2], outputs[3]) = (pulse, pulse);
        self.plane.outputs.set(outputs);
    }

    /// Waits until the vehicle is armed and learnt, and the engines are in standby, with the throttle at idle.
    pub async fn ready(&self) {
        self.plane.armed.set(true);
        self.until("the engines are in standby", 30, || {
            (0..2).all(|engine| self.telemetry(engine).state == EngineState::Standby)
        })
        .await;
        self.until("armed", 30, || (0..2).all(|engine| self.telemetry(engine).armed)).await;
        self.pass_s(2.0).await;
    }

    /// Starts an engine and waits until it runs.
    pub async fn start(&self, engine: usize) {
        let (answer, texts) = self.control(engine, &[1.0]).await;
        assert_eq!(answer, Some(0), "start of {engine}: {texts}");
        assert!(!texts.contains("refused"), "{texts}");
        self.until("the engine runs", 120, || self.telemetry(engine).state == EngineState::Running).await;
    }

    /// Waits until an engine that was stopped is cold and in standby.
    pub async fn cold(&self, engine: usize) {
        let (begin, mut since) = (Instant::now(), Instant::now());
        // An ECU may briefly report standby in between.
        while Instant::now() < since + Duration::from_secs(15) {
            let telemetry = self.telemetry(engine);
            let egt = telemetry.current(telemetry.report.egt).is_some_and(|egt| egt.tenths() < 900);
            if telemetry.state != EngineState::Standby || !egt {
                since = Instant::now();
            }
            assert!(Instant::now() < begin + Duration::from_secs(600), "never cold");
            self.pass_s(0.1).await;
        }
    }

    /// All texts on the ground station's port so far.
    pub fn texts(&self) -> String {
        let mut texts = String::new();
        for (_, port, frame) in &*self.frames.borrow() {
            if let (TO_GROUND, MavMessage::STATUSTEXT(text)) = (*port, &frame.message()) {
                texts += text.text.to_str().unwrap();
                texts += "\n";
            }
        }
        texts
    }

    /// Waits until an engine is ordered to a throttle that is above, and looks that it rises at its rate, 50 % a second.
    pub async fn rises_to(&self, engine: usize, tenths: u16) {
        let mut before = self.ordered(engine).unwrap();
        let end = Instant::now() + Duration::from_secs(15);
        while before != tenths {
            self.pass_s(0.02).await;
            let ordered = self.ordered(engine).unwrap();
            assert!(ordered <= before + 30, "from {before} to {ordered} in 20 ms");
            assert!(Instant::now() < end, "{before} and not {tenths}");
            before = ordered;
        }
    }

    /// Throttle of an engine's order, in 0.1 %.
    pub fn ordered(&self, engine: usize) -> Option<u16> {
        use jetlink::command::{Demand, Order};
        match self.telemetry(engine).ordered.order {
            Order::Run(Demand::Throttle(throttle)) | Order::Doubt(Demand::Throttle(throttle)) => {
                Some(throttle.tenths())
            }
            _ => None,
        }
    }

    async fn fly_plane(&self) {
        let mut next_heartbeat = Instant::now();
        let mut next_outputs = Instant::now();
        let mut next_instance = Instant::now();
        loop {
            Timer::after(Duration::from_millis(5)).await;
            let now = Instant::now();
            if !self.plane.alive.get() {
                self.plane.granted.set(None);
                continue;
            }
            let from = Address { system: self.plane.system.get(), component: 1 };
            if now >= next_heartbeat {
                next_heartbeat = now + Duration::from_secs(1);
            }
            if now + Duration::from_secs(1) == next_heartbeat && self.plane.heartbeats.get() {
                self.say(
                    TO_AUTOPILOT,
                    from,
                    &HEARTBEAT_DATA {
                        custom_mode: 0,
                        mavtype: 1,
                        autopilot: if self.plane.px4.get().is_some() { 12 } else { 3 },
                        base_mode: 1 | if self.plane.armed.get() { MODE_ARMED } else { 0 },
                        system_status: 4,
                        mavlink_version: 3,
                    },
                );
            }
            let every = self.plane.every.get().or(self.plane.granted.get());
            if let Some(every) = every
                && now >= next_outputs
            {
                next_outputs = now + every;
                let time_usec = (now - self.plane.booted.get()).as_micros() as u32;
                self.say(TO_AUTOPILOT, from, &outputs(time_usec, self.plane.outputs.get()));
            }
            if let Some(Some(servo)) = self.plane.px4.get()
                && now >= next_instance
            {
                next_instance = now + Duration::from_millis(100);
                let time_usec = (now - self.plane.booted.get()).as_micros() as u32;
                self.say(TO_AUTOPILOT, from, &SERVO_OUTPUT_RAW_DATA { port: 1, ..outputs(time_usec, servo) });
            }
        }
    }

    async fn watch_ground(&self) {
        loop {
            Timer::after(Duration::from_secs(1)).await;
            if self.ground.get() {
                let beat = HEARTBEAT_DATA {
                    custom_mode: 0,
                    mavtype: TYPE_GCS,
                    autopilot: AUTOPILOT_INVALID,
                    base_mode: 0,
                    system_status: 4,
                    mavlink_version: 3,
                };
                self.say(TO_GROUND, GROUND, &beat);
            }
        }
    }

    /// Passes time and bytes, as a runner does: every 5 ms, and at 57 600 baud on the autopilot's port.
    async fn serve(&self) {
        let mut decoders = [Decoder::new(), Decoder::new()];
        loop {
            let now = Instant::now();
            self.service.borrow_mut().poll(now);
            if self.restarted.take() {
                decoders = [Decoder::new(), Decoder::new()];
            }
            for (port, decoder) in decoders.iter_mut().enumerate() {
                let mut bytes = [0; 500];
                let most = if port == TO_AUTOPILOT { 28 } else { 500 };
                let count = self.service.borrow_mut().transmit(port, &mut bytes[..most]);
                self.bytes.borrow_mut()[port] += count;
                let mut bytes = &bytes[..count];
                let key = self.key.get();
                while let (taken, Some(frame)) = decoder.receive(key.as_ref(), bytes) {
                    bytes = &bytes[taken..];
                    // With a key everything is signed; without one, nothing.
                    let right = matches!(frame.signature, Signature::Right { .. });
                    assert!(right == key.is_some() || !self.key_is_everywhere.get(), "{frame:?}");
                    self.answer(port, &frame);
                    self.frames.borrow_mut().push((now, port, frame));
                }
                assert_eq!((decoder.counters().bad_checksums, decoder.counters().skipped), (0, 0));
            }
            Timer::after(Duration::from_millis(5)).await;
        }
    }

    /// The autopilot's answer to a request for a rate: 25 ms, as ArduPlane grants.
    fn answer(&self, port: usize, frame: &Frame) {
        let MavMessage::COMMAND_LONG(command) = &frame.message() else { return };
        if port != TO_AUTOPILOT || !self.plane.alive.get() {
            return;
        }
        assert_eq!((command.command, command.param1), (511, 36.0));
        self.plane.requests.borrow_mut().push((Instant::now(), command.param2));
        let granted = command.param2 >= 25_000.0;
        if granted {
            self.plane.granted.set(Some(Duration::from_micros(command.param2 as u64)));
        }
        let ack = COMMAND_ACK_DATA {
            command: 511,
            result: if granted { 0 } else { 2 },
            target_system: frame.from.system,
            target_component: frame.from.component,
            ..Default::default()
        };
        let from = Address { system: self.plane.system.get(), component: 1 };
        self.say(TO_AUTOPILOT, from, &ack);
    }
}

/// A stop of an engine, from a ground station.
pub fn stop_command(engine: usize) -> COMMAND_LONG_DATA {
    COMMAND_LONG_DATA {
        command: CMD_DO_ENGINE_CONTROL,
        target_system: SYSTEM,
        target_component: ENGINE[engine],
        ..Default::default()
    }
}

pub fn outputs(time_usec: u32, servo: [u16; 16]) -> SERVO_OUTPUT_RAW_DATA {
    SERVO_OUTPUT_RAW_DATA {
        time_usec,
        port: 0,
        servo1_raw: servo[0],
        servo2_raw: servo[1],
        servo3_raw: servo[2],
        servo4_raw: servo[3],
        servo5_raw: servo[4],
        servo6_raw: servo[5],
        servo7_raw: servo[6],
        servo8_raw: servo[7],
        servo9_raw: servo[8],
        servo10_raw: servo[9],
        servo11_raw: servo[10],
        servo12_raw: servo[11],
        servo13_raw: servo[12],
        servo14_raw: servo[13],
        servo15_raw: servo[14],
        servo16_raw: servo[15],
    }
}

/// As a board retains it over a reset.
#[cfg(feature = "signing")]
fn retained(signing: SigningState) -> SigningState {
    let memory = crate::retained::KeyMemory::new();
    memory.store(&signing);
    SigningState::at_start(memory.load(), None)
}

#[cfg(not(feature = "signing"))]
fn retained(_: SigningState) -> SigningState {
    SigningState::NONE
}

/// Starts the second engine of a node, and brings it to 30 %.
async fn fly(node: &Node<2>) {
    let source = node.owners()[1].source(Origin::Bench).unwrap();
    let mut state = EngineState::Standby;
    let mut ready = 0;
    while state != EngineState::Running || ready < 200 {
        let demand = Throttle::from_tenths(if state == EngineState::Running { 300 } else { 0 }).unwrap();
        ready = if state == EngineState::Running || ready < 100 { ready + 1 } else { ready };
        let _ = source.command(Command::Arm);
        let command = if ready < 100 { Command::Standby } else { Command::Run(Demand::Throttle(demand)) };
        let _ = source.command(command);
        Timer::after(Duration::from_millis(100)).await;
        state = node.handles()[1].telemetry().state;
    }
}

/// RAM that was retained over a reset has no key: there was none.
pub fn no_key() -> SigningState {
    SigningState::new(None, Stamp::new(1000).unwrap())
}

/// Runs a scenario.
pub fn run(scenario: impl AsyncFnOnce(&World<'_>)) {
    run_with(NodeSettings::DEFAULT, scenario);
}

pub fn run_with(settings: NodeSettings, scenario: impl AsyncFnOnce(&World<'_>)) {
    run_signed(settings, SigningState::NONE, PortConfig::usb(), scenario);
}

/// With what was stored of the node's signing, and the ground station's port. Its sender has the key.
pub fn run_signed(
    settings: NodeSettings,
    signing: SigningState,
    ground: PortConfig,
    scenario: impl AsyncFnOnce(&World<'_>),
) {
    run_after(settings, signing, ground, false, scenario);
}

/// The second engine runs already, and the node knows nothing of it.
pub fn run_beside_a_running_engine(scenario: impl AsyncFnOnce(&World<'_>)) {
    // While an engine is ordered no vehicle is learnt.
    let identity = Identity { system: SYSTEM, ..Identity::DEFAULT };
    let settings = NodeSettings { identity, ..NodeSettings::DEFAULT };
    run_after(settings, SigningState::NONE, PortConfig::usb(), true, scenario);
}

fn run_after(
    settings: NodeSettings,
    signing: SigningState,
    ground: PortConfig,
    right_runs: bool,
    scenario: impl AsyncFnOnce(&World<'_>),
) {
    clock::reset();
    let engines = [
        EngineConfig::amt("left", 0, Line::new(9600), None),
        EngineConfig::zk("right", 1, Line::new(9600), Rate::Hz20),
    ];
    let node: Node<2> = Node::new(&engines, None).unwrap();
    let amt = AmtEcu::new(simulated_as(&engines[0]));
    let (left_rx, left_tx, left) = rows::wire(&engines[0], amt, 1);
    let (mut right_rx, mut right_tx, right) = rows::wire(&engines[1], simulated(&engines[1]).ecu(), 2);
    if right_runs {
        let before = Node::<2>::new(&engines, None).unwrap();
        let [_, runner] = before.runners();
        clock::run(select(join(runner.run(right_rx, right_tx, &ERRORS), right.run()), fly(&before)));
        (right_rx, right_tx) = right.reset_node();
    }
    let parts = node.owners().into_iter().zip(engines).zip([3, 4]);
    let parts = parts.map(|((owner, config), output)| EngineParts {
        source: owner.source(Origin::Mavlink).unwrap(),
        setup: owner.setup(),
        config,
        settings: EngineSettings { output, ..EngineSettings::DEFAULT },
    });
    let ports = [PortConfig::uart(57_600), ground];
    let key = Cell::new(signing.key().copied());
    let toy = Toy::default();
    let service = Service::with(Instant::now(), settings, signing, parts, ports, toy.clone());
    let service = RefCell::new(service);
    let plane = Plane {
        alive: Cell::new(true),
        armed: Cell::new(false),
        heartbeats: Cell::new(true),
        system: Cell::new(SYSTEM),
        outputs: Cell::new([IDLE_US; 16]),
        every: Cell::new(None),
        granted: Cell::new(None),
        px4: Cell::new(None),
        booted: Cell::new(Instant::now()),
        requests: RefCell::default(),
    };
    let world = World {
        service,
        toy: toy.0,
        node: &node,
        plane,
        ground: Cell::new(true),
        key,
        stamp: Cell::new(0),
        autopilot_behind: Cell::new(0),
        ports,
        restarted: Cell::new(false),
        key_is_everywhere: Cell::new(true),
        frames: RefCell::default(),
        bytes: RefCell::default(),
        left: &left,
    };
    let [run_left, run_right] = node.runners();
    let engines = join(run_left.run(left_rx, left_tx, &ERRORS), run_right.run(right_rx, right_tx, &ERRORS));
    let lines = join(left.run(), right.run());
    let traffic = join3(world.serve(), world.fly_plane(), world.watch_ground());
    clock::run(select(join3(engines, lines, traffic), scenario(&world)));
}
