//! Pilots, a node, and simulated ECUs on its wires, in virtual time. A pilot is a stream of one command. A test sets
//! which source commands what, lets time pass, and checks the wire and the turbines.

use crate::wire::{self, Frame};
use bench::rows::{self, simulated_as};
use embassy_time::{Duration, Timer};
use jetlink::channel::{Handle, Owner};
use jetlink::command::{Accepted, Command, Demand, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::ecu::zk::codec::Rate;
use jetlink::engine::retained::{Reset, RetainedMemory};
use jetlink::line::Line;
use jetlink::node::Node;
use jetlink::runner::LineErrors;
use jetlink::units::{Rpm, Throttle};
use sim::amt::{AmtConfig, AmtEcu};
use sim::any::{AnyConfig, AnyEcu};
use sim::clock;
use sim::control::Reader;
use sim::ecu::{MILLIS, Nanos};
use sim::turbine::{Phase, Turbine};
use sim::vendor::VendorConfig as _;
use sim::wire::{Plug, WireRx, WireTx};
use sim::zk::{ZkConfig, ZkEcu};
use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::task::Poll;

pub use jetlink::command::Command::{Arm, Disarm, EmergencyStop, ReleaseStop, Standby};
pub use jetlink::command::Origin::{Mavlink, Rc};

/// Interval at which every source sends its command.
const PERIOD: Nanos = 100 * MILLIS;
/// Start-up of the firmware: nobody reads or writes.
pub const START_UP: f64 = 0.02;

/// Run, in percent.
pub fn run(percent: u8) -> Command {
    Command::Run(Demand::Throttle(Throttle::from_percent(percent).expect("0..=100")))
}

pub fn run_rpm(rpm: u32) -> Command {
    Command::Run(Demand::Rpm(Rpm::new(rpm)))
}

pub fn seconds(time: Nanos) -> f64 {
    time as f64 / 1e9
}

/// An Olympus with an AMT ECU at 2400 baud.
pub fn amt(change: impl FnOnce(&mut EngineConfig, &mut AmtConfig)) -> (EngineConfig, AnyEcu) {
    let mut config = EngineConfig::amt("amt", 0, Line::new(2400), Some(EngineModel::Olympus));
    let mut ecu = simulated_as(&config);
    change(&mut config, &mut ecu);
    (config, AnyConfig::Amt(ecu).ecu())
}

/// An engine with a ZK ECU of this protocol version at 9600 baud.
pub fn zk(version: u8, change: impl FnOnce(&mut EngineConfig, &mut ZkConfig)) -> (EngineConfig, AnyEcu) {
    let mut config = EngineConfig::zk("zk", 0, Line::new(9600), Rate::Hz20);
    let mut ecu = simulated_as::<ZkConfig>(&config).with_version(version);
    change(&mut config, &mut ecu);
    (config, AnyConfig::Zk(ecu).ecu())
}

struct Pilot {
    engine: usize,
    origin: Origin,
    command: Command,
    next: Nanos,
}

pub struct World<const N: usize = 1> {
    pub configs: [EngineConfig; N],
    pub plugs: [Plug<AnyEcu>; N],
    memory: &'static [RetainedMemory; N],
    node: Option<&'static Node<N>>,
    halves: Vec<(WireRx, WireTx)>,
    tasks: Vec<Pin<Box<dyn Future<Output = ()>>>>,
    pilots: Vec<Pilot>,
    readers: [Reader; N],
    sent: [Vec<Frame>; N],
    /// Cause of the reset from which the node starts.
    cause: Reset,
}

impl World {
    pub fn one(engine: (EngineConfig, AnyEcu)) -> Self {
        Self::new([engine])
    }
}

impl<const N: usize> World<N> {
    pub fn new(engines: [(EngineConfig, AnyEcu); N]) -> Self {
        clock::reset();
        // It outlives every node, as memory does; a few bytes for each test.
        let memory = Box::leak(Box::new(std::array::from_fn(|_| RetainedMemory::new())));
        let mut world = Self::with_memory(engines, memory);
        world.boot();
        world
    }

    /// A node that is held in reset.
    fn with_memory(engines: [(EngineConfig, AnyEcu); N], memory: &'static [RetainedMemory; N]) -> Self {
        let configs = std::array::from_fn(|n| engines[n].0);
        let readers = std::array::from_fn(|n| Reader::new(engines[n].1.protocol()));
        let mut halves = Vec::new();
        let plugs = engines.map(|(config, ecu)| {
            let (rx, tx, plug) = rows::wire(&config, ecu, u64::from(config.port));
            plug.record(true);
            halves.push((rx, tx));
            plug
        });
        Self {
            configs,
            plugs,
            memory,
            node: None,
            halves,
            tasks: Vec::new(),
            pilots: Vec::new(),
            readers,
            sent: std::array::from_fn(|_| Vec::new()),
            cause: Reset::Warm,
        }
    }

    // ---------------------------------------------------------------------------------------
    // The node
    // ---------------------------------------------------------------------------------------

    /// The node starts after a loss of power that its memory survived.
    pub fn boot_after_power_loss(&mut self) {
        self.cause = Reset::PowerLost;
        self.boot();
        self.cause = Reset::Warm;
    }

    /// The node starts, with what its memory has retained.
    pub fn boot(&mut self) {
        static ERRORS: LineErrors = LineErrors::new();
        self.halt();
        // Bytes that arrived while it was held in reset are lost with its UART.
        self.halves = self.plugs.iter().map(Plug::reset_node).collect();
        let node: &'static Node<N> = Box::leak(Box::new(
            Node::new(&self.configs, Some((self.memory, self.cause))).expect("a good table"),
        ));
        for (runner, (rx, tx)) in node.runners().into_iter().zip(self.halves.drain(..)) {
            self.tasks.push(Box::pin(async move { runner.run(rx, tx, &ERRORS).await }));
        }
        self.node = Some(node);
    }

    /// The node is held in reset from now on: nobody reads, writes or obeys.
    pub fn halt(&mut self) {
        self.tasks.clear();
        if self.node.take().is_some() {
            self.halves = self.plugs.iter().map(Plug::reset_node).collect();
        }
        for plug in &self.plugs {
            let plug = plug.clone();
            self.tasks.push(Box::pin(async move { match plug.run().await {} }));
        }
        // An ECU without power has no next wake, and time has to pass.
        self.tasks.push(Box::pin(async {
            loop {
                Timer::after_millis(100).await;
            }
        }));
    }

    /// The watchdog resets the node.
    pub fn reset(&mut self) {
        self.halt();
        self.pass_s(START_UP);
        self.boot();
    }

    /// No memory survives.
    pub fn forget(&mut self) {
        self.memory.iter().for_each(RetainedMemory::clear);
    }

    pub fn handle(&self, engine: usize) -> Handle<'static> {
        self.owner(engine).handle()
    }

    fn owner(&self, engine: usize) -> Owner<'static> {
        self.node.expect("the node works").owners()[engine]
    }

    /// The same node, held in reset, gets other settings and another ECU; its memory stays.
    pub fn reconfigured(self, config: EngineConfig, ecu: AnyEcu) -> World
    where
        Self: Sized,
    {
        let memory: &'static [RetainedMemory; 1] = std::array::from_ref(&self.memory[0]);
        drop(self);
        World::with_memory([(config, ecu)], memory)
    }

    // ---------------------------------------------------------------------------------------
    // Pilots
    // ---------------------------------------------------------------------------------------

    /// From now on this source repeats this command to every engine.
    pub fn streams(&mut self, origin: Origin, command: Command) {
        for engine in 0..N {
            self.streams_to(engine, origin, command);
        }
    }

    /// The same, to one engine.
    pub fn streams_to(&mut self, engine: usize, origin: Origin, command: Command) {
        self.pilots.retain(|pilot| (pilot.engine, pilot.origin) != (engine, origin));
        self.pilots.push(Pilot { engine, origin, command, next: clock::now_ns() });
    }

    /// From now on this source commands nothing.
    pub fn silent(&mut self, origin: Origin) {
        self.pilots.retain(|pilot| pilot.origin != origin);
    }

    /// From now on it commands nothing to this engine.
    pub fn silence(&mut self, engine: usize, origin: Origin) {
        self.pilots.retain(|pilot| (pilot.engine, pilot.origin) != (engine, origin));
    }

    /// One command to one engine.
    pub fn command_to(
        &mut self,
        engine: usize,
        origin: Origin,
        command: Command,
    ) -> Result<Accepted, Rejected> {
        let owner = self.owner(engine);
        let source = match origin {
            Origin::Emergency => owner.emergency_source(),
            origin => owner.source(origin),
        };
        source.expect("nobody else holds it").command(command)
    }

    /// One command to the first engine.
    pub fn command(&mut self, origin: Origin, command: Command) -> Result<Accepted, Rejected> {
        self.command_to(0, origin, command)
    }

    // ---------------------------------------------------------------------------------------
    // Time
    // ---------------------------------------------------------------------------------------

    /// Lets time pass.
    pub fn pass_s(&mut self, seconds: f64) {
        let end = clock::now_ns() + (seconds * 1e9) as Nanos;
        loop {
            let now = clock::now_ns();
            for n in 0..self.pilots.len() {
                let Pilot { engine, origin, command, next } = self.pilots[n];
                if next <= now {
                    self.pilots[n].next = now + PERIOD;
                    if self.node.is_some() {
                        let _ = self.command_to(engine, origin, command);
                    }
                }
            }
            if now >= end {
                break;
            }
            let next = self.pilots.iter().map(|pilot| pilot.next).chain([end, now + PERIOD]).min();
            let step = (next.unwrap_or(end) - now).div_ceil(1000);
            let tasks = &mut self.tasks;
            let all = poll_fn(|cx| {
                for task in tasks.iter_mut() {
                    let _ = task.as_mut().poll(cx);
                }
                Poll::<()>::Pending
            });
            clock::run_for(all, Duration::from_micros(step));
            for ((plug, reader), sent) in self.plugs.iter().zip(&mut self.readers).zip(&mut self.sent) {
                wire::read(reader, &plug.take_log(), sent);
            }
        }
    }

    /// Time passes until this condition holds, within a limit.
    pub fn until(&mut self, what: &str, within_seconds: f64, mut done: impl FnMut(&Self) -> bool) {
        let from = self.now();
        while !done(self) {
            let passed = seconds(self.now() - from);
            assert!(passed < within_seconds, "{what}: not within {within_seconds} s");
            self.pass_s(0.01);
        }
    }

    pub fn now(&self) -> Nanos {
        clock::now_ns()
    }

    // ---------------------------------------------------------------------------------------
    // Engines
    // ---------------------------------------------------------------------------------------

    pub fn turbine_of<T>(&self, engine: usize, look: impl FnOnce(&mut Turbine) -> T) -> T {
        self.plugs[engine].ecu(|ecu| look(ecu.turbine_mut()))
    }

    pub fn turbine<T>(&self, look: impl FnOnce(&mut Turbine) -> T) -> T {
        self.turbine_of(0, look)
    }

    pub fn phase(&self) -> Phase {
        self.turbine(|turbine| turbine.phase())
    }

    pub fn rpm(&self) -> f64 {
        self.turbine(|turbine| turbine.rpm())
    }

    pub fn egt(&self) -> f64 {
        self.turbine(|turbine| turbine.egt())
    }

    pub fn ignitions(&self) -> usize {
        self.turbine(|turbine| turbine.history().ignitions.len())
    }

    pub fn zk(&self, act: impl FnOnce(&mut ZkEcu)) {
        self.plugs[0].ecu(|ecu| {
            let AnyEcu::Zk(ecu) = ecu else { panic!("no ZK ECU") };
            act(ecu);
        });
    }

    pub fn amt(&self, act: impl FnOnce(&mut AmtEcu)) {
        self.plugs[0].ecu(|ecu| {
            let AnyEcu::Amt(ecu) = ecu else { panic!("no AMT ECU") };
            act(ecu);
        });
    }

    /// Cuts the supply of the first ECU for this time.
    pub fn dip_s(&mut self, seconds: f64) {
        self.plugs[0].power(false);
        self.pass_s(seconds);
        self.plugs[0].power(true);
    }

    /// The first ECU loses power for good.
    pub fn power(&mut self, on: bool) {
        self.plugs[0].power(on);
    }

    // --------------------------------------------------------------------------------------- Steps of every
    // pilot ---------------------------------------------------------------------------------------

    /// Armed, and in standby for long enough to be started by this source.
    pub fn ready(&mut self, origin: Origin) {
        for engine in 0..N {
            self.command_to(engine, origin, Arm).expect("arming is never refused");
        }
        self.streams(origin, Standby);
        self.until("standby", 900.0, |world| (0..N).all(|engine| world.is_in_standby(engine)));
        self.pass_s(2.0);
    }

    fn is_in_standby(&self, engine: usize) -> bool {
        self.turbine_of(engine, |turbine| turbine.phase() == Phase::Standby && turbine.rpm() < 1.0)
    }

    /// All steps of one source to running engines at idle.
    pub fn start(&mut self, origin: Origin) {
        self.ready(origin);
        self.streams(origin, run(0));
        self.until("running", 150.0, |world| {
            (0..N).all(|engine| world.turbine_of(engine, |turbine| turbine.phase() == Phase::Running))
        });
        self.pass_s(2.0);
    }

    /// Running at this throttle.
    pub fn fly(&mut self, origin: Origin, percent: u8) {
        self.start(origin);
        self.streams(origin, run(percent));
        self.pass_s(8.0);
        assert_eq!(self.throttle_sent(0), Some(u16::from(percent) * 10));
    }

    /// A proper new start lights the engine again, exactly once more. It shows that only the rule prevented the engine
    /// from starting before.
    pub fn starts_again(&mut self, origin: Origin) {
        let before = self.ignitions();
        self.start(origin);
        assert_eq!(self.ignitions(), before + 1, "one start, one ignition");
    }

    // ---------------------------------------------------------------------------------------
    // The wire
    // ---------------------------------------------------------------------------------------

    /// The frames to an engine since then.
    pub fn sent_to(&self, engine: usize, since: Nanos) -> impl DoubleEndedIterator<Item = &Frame> {
        self.sent[engine].iter().filter(move |frame| frame.at >= since)
    }

    /// The frames to the first engine since then.
    pub fn sent(&self, since: Nanos) -> impl DoubleEndedIterator<Item = &Frame> {
        self.sent_to(0, since)
    }

    /// The throttle last sent, in tenths of a percent, if the last switch sent is run.
    pub fn throttle_sent(&self, engine: usize) -> Option<u16> {
        let last = self.sent_to(engine, 0).rfind(|frame| frame.is_run() || frame.is_stop())?;
        last.is_run().then(|| self.sent_to(engine, 0).rev().find_map(Frame::throttle)).flatten()
    }

    /// No frame was run since then.
    #[track_caller]
    pub fn assert_not_sent_run(&self, since: Nanos) {
        if let Some(frame) = self.sent(since).find(|frame| frame.is_run()) {
            let count = self.sent(since).filter(|frame| frame.is_run()).count();
            let after = seconds(frame.at - since);
            panic!("sent run {count} times, the first {after:.2} s later: {:?}", frame.sent);
        }
    }

    /// Nothing shut the engine down since then.
    #[track_caller]
    pub fn assert_not_shut_down(&self, since: Nanos) {
        if let Some(frame) = self.sent(since).find(|frame| frame.is_stop()) {
            panic!("shut down {:.2} s later: {:?}", seconds(frame.at - since), frame.sent);
        }
        assert_eq!(self.phase(), Phase::Running);
    }

    /// Number of ignitions since the turbine was created.
    #[track_caller]
    pub fn assert_ignitions(&self, count: usize) {
        let at = self.turbine(|turbine| turbine.history().ignitions.clone());
        let at: Vec<f64> = at.into_iter().map(seconds).collect();
        assert_eq!(at.len(), count, "ignitions at {at:.1?} s, now it is {:.1} s", seconds(self.now()));
    }
}
