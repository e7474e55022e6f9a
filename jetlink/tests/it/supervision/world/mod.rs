//! Random worlds: one or two engines with simulated ECUs on a node that is reset now and then, and sources that
//! command them well and badly. Everything comes from one seed.

mod boots;
mod disturbances;
mod settings;
mod sources;

use super::oracle::{DARK, Input, Oracle, Retained, Tally, Truth};
use super::wire::Reader;
use core::fmt;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, ReadReady};
use jetlink::channel::Handle;
use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::ecu::{EcuConfig, amt::codec::EngineModel};
use jetlink::engine::config::{Governor, Slew, Supervision};
use jetlink::engine::retained::{Reset, RetainedMemory};
use jetlink::event::{Event, LossStage};
use jetlink::limit::Action;
use jetlink::line::{Line, StopBits};
use jetlink::node::Node;
use jetlink::runner::LineErrors;
use jetlink::units::{Celsius, Rpm, Throttle};
use sim::amt::Ops;
use sim::any::{AnyConfig, AnyEcu};
use sim::clock;
use sim::turbine::Phase;
use sim::wire::{Babble, Direction, Fate, Faults, Plug, Settings, WireRx, WireTx, connect_with};
use sim::zk::{Sw, ZkCommand, state};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::rc::Rc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::task::Poll;

const MS: u64 = 1_000;
const SECOND: u64 = 1_000_000;
/// Every frame has ended this long after its first bit.
const LONGEST_FRAME: u64 = 30 * MS;

/// SplitMix64.
#[derive(Debug)]
pub struct Rng(pub u64);

impl Rng {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    /// `0..n`
    fn below(&mut self, n: u64) -> u64 {
        self.next() % n.max(1)
    }

    fn between(&mut self, low: u64, high: u64) -> u64 {
        low + self.below(high - low)
    }

    fn percent(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }

    fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len() as u64) as usize]
    }

    /// Around this mean, never 0.
    fn wait(&mut self, mean: u64) -> u64 {
        self.between(mean / 10, mean * 2)
    }
}

/// What it really does and reports.
fn truth(ecu: &AnyEcu, odd: bool) -> Truth {
    let turbine = ecu.turbine();
    let live = turbine.phase().is_live();
    let truth = Truth {
        live,
        running: turbine.phase() == Phase::Running,
        egt: turbine.egt(),
        odd,
        ..Truth::default()
    };
    match ecu {
        AnyEcu::Amt(ecu) => {
            let last = ecu.commands.last().map(|(_, command)| *command);
            Truth {
                says_running: truth.running,
                // Its document has no state for cooling: a stopped shaft is all there is.
                standby: !live && turbine.rpm() < 1000.0,
                faulty: ecu.errors() != 0,
                // Bit 3: it calls its sensor faulty. 300 °C is the default, and one step of EGT is 4.6 °C.
                says_cold: ecu.errors() & 1 << 3 == 0 && turbine.egt() <= 310.0,
                obeyed: last.map_or(0, |command| u16::from(command.throttle_half_percent) * 5),
                obeys_run: last.is_some_and(|command| command.ops == Ops::Run),
                own_stops: ecu.stats.serial_delay_stops,
                ..truth
            }
        }
        AnyEcu::Zk(ecu) => {
            let commands = || ecu.commands.iter().rev().map(|(_, command)| *command);
            let throttle = commands().find_map(|command| match command {
                ZkCommand::Control { throttle, .. } => Some(throttle),
                _ => None,
            });
            let reported = (ecu.throttle_percent() * 10.0).clamp(0.0, 1000.0) as u16;
            let run = commands().find_map(|command| match command {
                ZkCommand::Control { sw, .. } | ZkCommand::Switch { sw, .. } => Some(sw == Sw::Run),
                _ => None,
            });
            Truth {
                // From 6 to 11 it learns or runs.
                says_running: (6..=state::RUNNING).contains(&ecu.state()),
                standby: ecu.state() == state::STANDBY,
                faulty: ecu.error() != 0,
                // It reports whole percents.
                obeyed: throttle.unwrap_or(0).max(reported) + 10,
                obeys_run: run == Some(true),
                own_stops: ecu.stats.control_losses,
                ..truth
            }
        }
    }
}

/// What a source is doing for a while.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Program {
    Silent,
    Standby,
    Run(Demand),
    /// Commands and falls silent, over and over, for these times.
    Flap(Demand, u64, u64),
    /// Present, without a command.
    Present,
    /// From anywhere to a running engine, the way it is documented.
    Fly(Demand),
    /// Anything.
    Nonsense,
}

#[derive(Debug)]
struct Source {
    origin: Origin,
    program: Program,
    period: u64,
    next: u64,
    changes: u64,
    on_since: u64,
    ready_since: Option<u64>,
}

/// One engine, its ECU, its sources, its judge.
struct Rig {
    config: EngineConfig,
    version: u8,
    max_rpm: u32,
    plug: Plug<AnyEcu>,
    halves: (WireRx, WireTx),
    reader: Reader,
    oracle: Oracle,
    sources: [Source; 4],
    inputs: VecDeque<(u64, Input)>,
    frames: VecDeque<(u64, super::wire::Frame)>,
    published: Rc<RefCell<Vec<(u64, Event)>>>,
    /// A disturbance of the line, and of the ECU, until then.
    line_until: Option<u64>,
    hung_from: Option<u64>,
    next_line: u64,
    ecu_until: Option<u64>,
    next_ecu: u64,
    next_stop: u64,
    next_arm: u64,
    /// Every source is silent then, and until then.
    next_silence: u64,
    silent_until: u64,
    odd_until: u64,
    truth: Truth,
    trace: VecDeque<(u64, Trace)>,
    /// When a byte of the ECU came last.
    byte_at: u64,
    /// That it is silent was noted.
    not_received: bool,
}

/// An entry of the log that a failure prints.
#[derive(Clone, Copy, Debug)]
enum Trace {
    Input(Input),
    Frame(super::wire::Frame),
    Reported(Event),
    Line(&'static str),
    Ecu(&'static str),
}

impl fmt::Display for Trace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(input) => input.fmt(f),
            Self::Frame(frame) => write!(f, "wire: {frame}"),
            Self::Reported(event) => write!(f, "event: {event}"),
            Self::Line(what) => write!(f, "line: {what}"),
            Self::Ecu(what) => write!(f, "ECU: {what}"),
        }
    }
}

/// What went wrong, for a reader.
#[derive(Debug)]
pub struct Failure {
    pub seed: u64,
    pub text: String,
}

/// How long this thread's clock has run.
fn now() -> u64 {
    clock::now_ns() / 1000
}

fn throttle(tenths: u64) -> Demand {
    Demand::Throttle(Throttle::from_tenths(tenths as u16).expect("0..=1000"))
}

fn sim_line(line: Line) -> sim::line::Line {
    match line.stop_bits {
        StopBits::One => sim::line::Line::n1(line.baud),
        StopBits::Two => sim::line::Line::n2(line.baud),
    }
}

impl Rig {
    fn note(&mut self, what: Trace) {
        self.note_at(now(), what);
    }

    fn note_at(&mut self, at: u64, what: Trace) {
        if self.trace.len() == 160 {
            self.trace.pop_front();
        }
        self.trace.push_back((at, what));
    }

    fn input(&mut self, input: Input) {
        if !matches!(input, Input::Truth(_)) {
            self.note(Trace::Input(input));
        }
        self.inputs.push_back((now(), input));
    }

    /// In the order of time.
    fn insert(&mut self, at: u64, input: Input) {
        let place = self.inputs.partition_point(|(before, _)| *before <= at);
        self.inputs.insert(place, (at, input));
    }

    fn command(
        &mut self,
        handle: &Handle<'_>,
        origin: Origin,
        command: Command,
    ) -> Result<Accepted, Rejected> {
        let mut command = command;
        if let Command::Run(Demand::Rpm(_)) = command {
            // Whether the ECU can do it is not reported then, and decides whether the source counts as received.
            let telemetry = handle.telemetry();
            if telemetry.stop_latched || telemetry.ordered.order == Order::Listen {
                command = Command::Run(throttle(0));
            }
        }
        let may_start = matches!(command, Command::Run(_)) && !self.truth.running;
        if may_start || command == Command::ReleaseStop && self.truth.live {
            // What the ECU is like at this instant decides.
            self.look_at_ecu();
        }
        let answer = command_as(handle, command, origin);
        self.input(Input::Commanded(origin, command, answer));
        answer
    }

    /// What the wire and the engine have reported since the last look goes to the judge, in the order of time.
    /// When a start went out, if one did.
    fn judge(&mut self, all: bool) -> Result<Option<u64>, String> {
        let frames = &mut self.frames;
        let seen = frames.len();
        let log = self.plug.take_log();
        self.reader.read(&log, |at, frame| frames.push_back((at, frame)));
        let lost_after = self.config.timing.lost_after.as_micros();
        for byte in
            log.iter().filter(|byte| byte.direction == Direction::ToNode && byte.fate == Fate::Delivered)
        {
            let at = byte.end / 1000;
            let before = core::mem::replace(&mut self.byte_at, at);
            if at > before + lost_after {
                self.insert(at, Input::LinkBack);
            }
            if at > before + DARK {
                if !core::mem::take(&mut self.not_received) {
                    self.insert(before + DARK, Input::NotReceived);
                }
                self.insert(at, Input::Received);
            }
        }
        if !self.not_received && now() > self.byte_at + DARK + LONGEST_FRAME {
            self.not_received = true;
            self.insert(self.byte_at + DARK, Input::NotReceived);
        }
        for index in seen..self.frames.len() {
            let (at, frame) = self.frames[index];
            self.note_at(at, Trace::Frame(frame));
        }
        let published = self.published.take();
        for (at, event) in published {
            self.note_at(at, Trace::Reported(event));
        }
        let until = if all { u64::MAX } else { now().saturating_sub(LONGEST_FRAME) };
        let mut started = None;
        loop {
            let input = self.inputs.front().map_or(u64::MAX, |(at, _)| *at);
            let frame = self.frames.front().map_or(u64::MAX, |(at, _)| *at);
            if input.min(frame) > until || input.min(frame) == u64::MAX {
                return Ok(started);
            }
            if input <= frame {
                if let Some((at, input)) = self.inputs.pop_front() {
                    self.oracle.input(at, input).map_err(|why| format!("at {at} µs: {why}"))?;
                }
            } else if let Some((at, frame)) = self.frames.pop_front()
                && self.oracle.frame(at, frame).map_err(|why| format!("at {at} µs: {why}"))?
            {
                started = Some(at);
            }
        }
    }

    fn look_at_ecu(&mut self) {
        let odd = now() < self.odd_until;
        self.truth = self.plug.ecu(|ecu| truth(ecu, odd));
        let truth = self.truth;
        self.input(Input::Truth(truth));
        if odd {
            self.input(Input::Fault);
        }
    }
}

/// Why a boot ended.
enum End {
    Time,
    /// Reset, with this of each engine's memory.
    Reset(Retained),
}

/// Runs a world for this time.
pub fn run(seed: u64, length: Duration) -> Result<(u64, Tally), Failure> {
    let mut rng = Rng(seed);
    if rng.percent(25) { play::<2>(seed, &mut rng, length) } else { play::<1>(seed, &mut rng, length) }
}

fn play<const N: usize>(seed: u64, rng: &mut Rng, length: Duration) -> Result<(u64, Tally), Failure> {
    clock::reset();
    let gap = Duration::from_millis(rng.pick(&[0, 3000, 10_000]));
    let mut rigs: [Rig; N] = std::array::from_fn(|port| settings::rig(rng, port as u8, gap));
    let configs = rigs.each_ref().map(|rig| rig.config);
    // It outlives every node, as memory does; a few bytes for each world.
    let memory: &'static [RetainedMemory; N] =
        Box::leak(Box::new(std::array::from_fn(|_| RetainedMemory::new())));
    let end = now() + length.as_micros();
    let fail = |rigs: &[Rig; N], port: usize, why: String| {
        use std::fmt::Write;
        let rig = &rigs[port];
        let mut text = format!("seed {seed}, engine {port}: {why}\n{:?}\n", rig.config);
        for (at, what) in &rig.trace {
            let _ = writeln!(text, "{at:>12} µs  {what}");
        }
        Failure { seed, text }
    };
    let mut how = Reset::PowerLost;
    loop {
        match boots::boot(rng, &mut rigs, &configs, (memory, how), end) {
            Ok(End::Time) => break,
            Ok(End::Reset(retained)) => {
                let down = if rng.percent(70) { rng.below(300 * MS) } else { rng.below(1_500 * MS) };
                boots::down_for(&mut rigs, down);
                for (rig, memory) in rigs.iter_mut().zip(memory) {
                    rig.look_at_ecu();
                    let record = memory.load(rig.config.fingerprint(), Reset::Warm);
                    let demand = record.and_then(|record| match record.order {
                        Order::Run(demand) if record.ran => {
                            Some((record.origin, demand, record.loss >= LossStage::FailSafe))
                        }
                        _ => None,
                    });
                    let retained =
                        if let Retained::Whole(_) = retained { Retained::Whole(demand) } else { retained };
                    how = if retained == Retained::PowerLost { Reset::PowerLost } else { Reset::Warm };
                    rig.input(Input::Boot { retained, down });
                }
            }
            Err((port, why)) => return Err(fail(&rigs, port, why)),
        }
    }
    let mut tally = Tally::default();
    for port in 0..N {
        if let Err(why) = rigs[port].judge(true) {
            return Err(fail(&rigs, port, why));
        }
        tally.add(&rigs[port].oracle.tally);
    }
    Ok((length.as_secs() * N as u64, tally))
}

impl Tally {
    pub fn add(&mut self, other: &Self) {
        self.frames += other.frames;
        self.run_frames += other.run_frames;
        self.stop_frames += other.stop_frames;
        self.starts += other.starts;
        self.silent_frames += other.silent_frames;
        self.fail_safe_frames += other.fail_safe_frames;
        self.resets_running += other.resets_running;
        self.resumed_runs += other.resumed_runs;
        self.exact_frames += other.exact_frames;
        self.rpm_frames += other.rpm_frames;
        self.takeovers += other.takeovers;
        self.rising_frames += other.rising_frames;
        self.healthy_ends += other.healthy_ends;
        self.dark_runs += other.dark_runs;
    }
}

fn command_as(handle: &Handle<'_>, command: Command, origin: Origin) -> Result<Accepted, Rejected> {
    let source = match origin {
        Origin::Emergency => handle.emergency_source(),
        origin => handle.source(origin),
    };
    source.expect("nobody else holds it").command(command)
}
