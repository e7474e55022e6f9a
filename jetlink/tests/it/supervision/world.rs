//! Random worlds: one or two engines with simulated ECUs on a node that is reset now and then, and sources that
//! command them well and badly. Everything comes from one seed.

use super::oracle::{DARK, Input, Kept, Oracle, Tally, Truth};
use super::wire::Reader;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, ReadReady};
use jetlink::channel::Handle;
use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::ecu::{EcuConfig, amt::codec::Engine};
use jetlink::engine::config::{Governor, Slew, Supervision};
use jetlink::engine::retained::{Reset, RetainedMemory};
use jetlink::event::{Event, LossStage};
use jetlink::limit::Action;
use jetlink::line::{Line, StopBits};
use jetlink::node::Node;
use jetlink::runner::LineErrors;
use jetlink::units::{Celsius, Rpm, Throttle};
use sim::amt::{AmtConfig, AmtEcu, Ops};
use sim::any::AnyEcu;
use sim::clock;
use sim::turbine::Phase;
use sim::wire::{Babble, Direction, Fate, Faults, Plug, Settings, WireRx, WireTx, connect_with};
use sim::zk::{Sw, ZkCommand, ZkConfig, ZkEcu, state};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::rc::Rc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::task::Poll;

const MS: u64 = 1_000;
const SECOND: u64 = 1_000_000;
/// Every frame is over so long after its first bit.
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

/// What it really does and says.
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
                // Its document has no state for cooling: a shaft that stands is all there is.
                standby: !live && turbine.rpm() < 1000.0,
                faulty: ecu.errors() != 0,
                // Bit 3: it calls its sensor faulty. 300 °C is the default, and one step of EGT is 4.6 °C.
                says_burning: ecu.errors() & 1 << 3 == 0 && turbine.egt() > 310.0,
                obeyed: last.map_or(0, |command| u16::from(command.throttle_half_percent) * 5),
                obeys_run: last.is_some_and(|command| command.ops == Ops::Run),
                gave_up: ecu.stats.serial_delay_stops,
                ..truth
            }
        }
        AnyEcu::Zk(ecu) => {
            let commands = || ecu.commands.iter().rev().map(|(_, command)| *command);
            let throttle = commands().find_map(|command| match command {
                ZkCommand::Control { throttle, .. } => Some(throttle),
                _ => None,
            });
            let told = (ecu.throttle_percent() * 10.0).clamp(0.0, 1000.0) as u16;
            let run = commands().find_map(|command| match command {
                ZkCommand::Control { sw, .. } | ZkCommand::Switch { sw, .. } => Some(sw == Sw::Run),
                _ => None,
            });
            Truth {
                // From 6 to 11 it learns or runs.
                says_running: (6..=state::RUNNING).contains(&ecu.state()),
                standby: ecu.state() == state::STANDBY,
                faulty: ecu.error() != 0,
                // It tells whole percents.
                obeyed: throttle.unwrap_or(0).max(told) + 10,
                obeys_run: run == Some(true),
                gave_up: ecu.stats.control_losses,
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
    /// Speaks and falls silent, over and over: so long each.
    Flap(Demand, u64, u64),
    /// Present, and wants nothing.
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
    told: Rc<RefCell<Vec<(u64, Event)>>>,
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
    unheard: bool,
}

#[derive(Clone, Copy, Debug)]
#[expect(dead_code, reason = "only ever shown")]
enum Trace {
    Input(Input),
    Frame(super::wire::Frame),
    Told(Event),
    Line(&'static str),
    Ecu(&'static str),
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

fn supervision(rng: &mut Rng) -> Supervision {
    let mut all = Supervision::DEFAULT;
    let ms = Duration::from_millis;
    if rng.percent(60) {
        all.ages.emergency = ms(rng.pick(&[200, 500, 2000]));
        all.ages.rc = ms(rng.pick(&[200, 500, 1000]));
        all.ages.mavlink = ms(rng.pick(&[500, 1000, 3000]));
        all.ages.bench = ms(rng.pick(&[300, 500, 1500]));
        all.recover_after = ms(rng.pick(&[100, 500, 1000, 2000]));
        all.return_within = ms(rng.pick(&[0, 300, 1000, 3000]));
        all.rise = rng.pick(&[100, 500, 1000]);
        all.loss.lower_standby_after = ms(rng.pick(&[0, 1000, 5000]));
        all.takeover.within = ms(rng.pick(&[0, 500, 2000, 5000]));
        all.loss.hold = ms(rng.pick(&[0, 300, 1000, 4000]));
        all.loss.throttle = Throttle::from_tenths(rng.pick(&[0, 0, 100, 250])).expect("in range");
        all.loss.ramp = rng.pick(&[100, 250, 500, 2000]);
        all.loss.standby_after = rng.pick(&[None, None, Some(ms(3000)), Some(ms(20_000))]);
        all.start.egt_max = Celsius::from_tenths(rng.pick(&[500, 1000]));
        all.start.arming = rng.percent(85);
    }
    if rng.percent(15) {
        all.slew = Slew { up: Some(rng.pick(&[100, 500])), down: rng.pick(&[None, Some(200), Some(500)]) };
    }
    if rng.percent(15) {
        all.limits.ecu_fault = Action::FailSafe;
    }
    if rng.percent(10) {
        all.when_other_fails = Some(500);
    }
    if rng.percent(10) {
        all.governor = Some(Governor::DEFAULT);
    }
    all
}

fn rig(rng: &mut Rng, port: u8, gap: Duration) -> Rig {
    let mut supervision = supervision(rng);
    supervision.start.gap = gap;
    let (mut config, version) = if rng.percent(55) {
        let engine = rng.pick(&[None, Some(Engine::Olympus)]);
        let line = Line::new(rng.pick(&[2400, 2400, 9600, 115_200]));
        (EngineConfig::amt("amt", port, line, engine), 0)
    } else {
        let baud = rng.pick(&[4800, 9600, 38_400, 115_200]);
        let line = if rng.percent(20) { Line::with_two_stop_bits(baud) } else { Line::new(baud) };
        let rate = if rng.percent(80) { Rate::Hz20 } else { Rate::Hz50 };
        (EngineConfig::zk("zk", port, line, rate), rng.between(3, 6) as u8)
    };
    if let EcuConfig::Zk(zk) = &mut config.ecu {
        zk.split_switch = rng.percent(30);
    }
    config.supervision = supervision;
    let line = sim_line(config.line);
    let (ecu, parameters) = if version == 0 {
        let ecu = AmtConfig { log: 8, ..AmtConfig::new(sim::amt::Engine::Olympus).on(line) };
        let parameters = ecu.turbine;
        (AmtEcu::new(ecu).into(), parameters)
    } else {
        let ecu = ZkConfig { log: 16, ..ZkConfig::new(version).on(line) };
        let parameters = ecu.turbine;
        (ZkEcu::new(ecu).into(), parameters)
    };
    let (rx, tx, plug) = connect_with(ecu, Settings::new(line, rng.next()));
    plug.record(true);
    let (idle, max) = (parameters.idle_rpm as u32, parameters.max_rpm as u32);
    let source = |origin| Source {
        origin,
        program: Program::Silent,
        period: 100 * MS,
        next: 0,
        changes: 0,
        on_since: 0,
        ready_since: None,
    };
    Rig {
        config,
        version,
        max_rpm: max,
        plug,
        halves: (rx, tx),
        reader: Reader::new(version == 0),
        oracle: Oracle::new(config, version >= 4, idle, max),
        sources: Origin::SOURCES.map(source),
        inputs: VecDeque::new(),
        frames: VecDeque::new(),
        told: Rc::default(),
        line_until: None,
        hung_from: None,
        next_line: rng.wait(60 * SECOND),
        ecu_until: None,
        next_ecu: rng.wait(200 * SECOND),
        next_stop: rng.wait(300 * SECOND),
        next_arm: SECOND,
        next_silence: rng.wait(120 * SECOND),
        silent_until: 0,
        odd_until: 0,
        truth: Truth::default(),
        trace: VecDeque::new(),
        byte_at: 0,
        unheard: false,
    }
}

impl Rig {
    fn note(&mut self, what: Trace) {
        if self.trace.len() == 160 {
            self.trace.pop_front();
        }
        self.trace.push_back((now(), what));
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
            // Whether the ECU can do it is not told then, and decides whether the source counts as heard.
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
        self.input(Input::Said(origin, command, answer));
        answer
    }

    /// What the wire and the engine have told since the last look goes to the judge, in the order of time.
    /// True if a start was seen.
    fn judge(&mut self, all: bool) -> Result<bool, String> {
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
                if !core::mem::take(&mut self.unheard) {
                    self.insert(before + DARK, Input::Unheard);
                }
                self.insert(at, Input::Heard);
            }
        }
        if !self.unheard && now() > self.byte_at + DARK + LONGEST_FRAME {
            self.unheard = true;
            self.insert(self.byte_at + DARK, Input::Unheard);
        }
        for index in seen..self.frames.len() {
            let (at, frame) = self.frames[index];
            if self.trace.len() == 160 {
                self.trace.pop_front();
            }
            self.trace.push_back((at, Trace::Frame(frame)));
        }
        let told = self.told.take();
        for (at, event) in told {
            if self.trace.len() == 160 {
                self.trace.pop_front();
            }
            self.trace.push_back((at, Trace::Told(event)));
        }
        let until = if all { u64::MAX } else { now().saturating_sub(LONGEST_FRAME) };
        let mut started = false;
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
            } else if let Some((at, frame)) = self.frames.pop_front() {
                started |= self.oracle.frame(at, frame).map_err(|why| format!("at {at} µs: {why}"))?;
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

    /// All that happens to the line and to the ECU.
    fn disturb(&mut self, rng: &mut Rng) {
        let now = now();
        if self.line_until.is_some_and(|until| now >= until) {
            self.line_until = None;
            self.plug.set_faults(Faults::default(), Faults::default());
            self.plug.cut(false);
            self.plug.babble(None);
            self.plug.stall_tx(false);
            if let Some(from) = self.hung_from.take() {
                let _ = from;
                // 64 bytes lay in its ring at most.
                let ring = sim_line(self.config.line).byte_ns(70) / 1000;
                self.input(Input::HungUntil(now + ring));
            }
            self.note(Trace::Line("healed"));
        } else if self.line_until.is_some() {
            self.input(Input::LineFault);
        } else if now >= self.next_line {
            self.next_line = now + rng.wait(60 * SECOND);
            let what = match rng.below(6) {
                0 => {
                    self.plug.set_faults(Faults::default(), Faults::NOISY);
                    "noise towards the ECU"
                }
                1 => {
                    let lossy = Faults { lose_per_million: 10_000, ..Faults::default() };
                    self.plug.set_faults(lossy, lossy);
                    "loss"
                }
                2 => {
                    self.plug.cut(true);
                    "cut"
                }
                3 => {
                    self.plug.babble(Some(Babble::Repeat(vec![0x55, 0x10, 0x00])));
                    "babble"
                }
                4 => {
                    self.plug.stall_tx(true);
                    self.hung_from = Some(now);
                    // Frames of a transmitter that hangs are judged by when they should have begun.
                    self.input(Input::HungUntil(now + 60 * SECOND));
                    "hung transmitter"
                }
                _ => {
                    let late = Faults { delay_ns: 3_000_000, jitter_ns: 15_000_000, ..Faults::default() };
                    self.plug.set_faults(late, late);
                    "delay"
                }
            };
            self.note(Trace::Line(what));
            self.line_until = Some(now + rng.wait(SECOND));
            self.input(Input::LineFault);
        }

        if self.ecu_until.is_some_and(|until| now >= until) {
            self.ecu_until = None;
            self.plug.power(true);
            self.plug.ecu(|ecu| match ecu {
                AnyEcu::Amt(ecu) => ecu.set_errors(0),
                AnyEcu::Zk(ecu) => {
                    ecu.set_error(None);
                    ecu.set_state(None);
                }
            });
            self.odd_until = now + SECOND;
            self.note(Trace::Ecu("as it should be"));
        } else if now >= self.next_ecu && self.ecu_until.is_none() {
            self.next_ecu = now + rng.wait(200 * SECOND);
            let mut until = now + rng.wait(3 * SECOND);
            let odd_for = until + SECOND;
            let what = match rng.below(6) {
                0 => {
                    self.plug.power(false);
                    self.odd_until = odd_for;
                    self.input(Input::Dark);
                    "no power"
                }
                1 => {
                    self.plug.ecu(|ecu| ecu.turbine_mut().flame_out());
                    self.odd_until = now + SECOND;
                    "flame out"
                }
                2 => {
                    let hot = rng.percent(50);
                    self.plug.ecu(|ecu| ecu.turbine_mut().hot_start(hot));
                    until = now;
                    "hot starts, or none"
                }
                3 => {
                    let dark = rng.percent(30);
                    self.plug.ecu(|ecu| ecu.turbine_mut().no_light(dark));
                    until = now;
                    "no light, or light"
                }
                4 => {
                    let error = rng.between(1, 18) as u8;
                    self.plug.ecu(|ecu| match ecu {
                        AnyEcu::Amt(ecu) => ecu.set_errors(1 << (error % 7)),
                        AnyEcu::Zk(ecu) => ecu.set_error(Some(error)),
                    });
                    until = now + rng.wait(10 * SECOND);
                    "errors"
                }
                _ => {
                    let state =
                        rng.pick(&[state::STOP, state::STANDBY, state::RUNNING, state::COOLING, 7, 25]);
                    self.plug.ecu(|ecu| {
                        if let AnyEcu::Zk(ecu) = ecu {
                            ecu.set_state(Some(state));
                        }
                    });
                    self.odd_until = odd_for;
                    "another state"
                }
            };
            self.note(Trace::Ecu(what));
            self.ecu_until = Some(until);
        }
    }

    /// A demand, at times one that makes no sense.
    fn demand(&self, rng: &mut Rng) -> Demand {
        let rpm = self.version >= 4 && rng.percent(40) || rng.percent(5);
        if rpm {
            let most = if rng.percent(10) { self.max_rpm * 2 } else { self.max_rpm };
            return Demand::Rpm(Rpm::new(rng.below(most.into()) as u32 / 10 * 10));
        }
        throttle(if rng.percent(15) { 0 } else { rng.below(1001) })
    }

    fn command_all(&mut self, rng: &mut Rng, handle: &Handle<'_>) {
        let now = now();
        if now >= self.next_stop {
            self.next_stop = now + rng.wait(400 * SECOND);
            let origin = rng.pick(&Origin::SOURCES);
            let _ = self.command(handle, origin, Command::EmergencyStop);
            if rng.percent(30) {
                let _ = self.command(handle, origin, Command::ReleaseStop);
            }
        }
        if now >= self.next_arm {
            self.next_arm = now + rng.wait(5 * SECOND);
            let origin = rng.pick(&Origin::SOURCES);
            let command = if rng.percent(90) { Command::Arm } else { Command::Disarm };
            let answer = self.command(handle, origin, command);
            if answer == Err(Rejected::DisarmFirst) && rng.percent(70) {
                let _ = self.command(handle, origin, Command::Disarm);
                let _ = self.command(handle, origin, Command::Arm);
            }
            if rng.percent(50) {
                let origin = rng.pick(&Origin::SOURCES);
                let _ = self.command(handle, origin, Command::ReleaseStop);
            }
        }
        if now >= self.next_silence {
            self.silent_until = now + rng.wait(12 * SECOND);
            self.next_silence = self.silent_until + rng.wait(120 * SECOND);
        }
        for index in 0..self.sources.len() {
            if now >= self.sources[index].changes {
                let program = self.program(rng, index);
                let source = &mut self.sources[index];
                let long = matches!(program, Program::Fly(_)) || program == Program::Run(throttle(0));
                let mean = if long { 60 } else { 12 };
                source.changes = now + rng.wait(mean * SECOND);
                source.program = program;
                source.period = rng.pick(&[50, 100, 100, 200]) * MS;
                source.next = now + rng.below(100 * MS);
                source.on_since = now;
            }
            if now >= self.sources[index].next {
                if now >= self.silent_until {
                    self.speak(rng, handle, index, now);
                }
                let source = &mut self.sources[index];
                source.next = now + source.period + rng.below(source.period / 5);
            }
        }
    }

    fn program(&self, rng: &mut Rng, index: usize) -> Program {
        let demand = self.demand(rng);
        // The higher a source, the more often it is silent.
        let silent = [88, 60, 45, 25][index];
        if rng.percent(silent) {
            return Program::Silent;
        }
        match rng.below(100) {
            0..8 => Program::Run(throttle(0)),
            8..55 => Program::Fly(demand),
            55..75 => Program::Run(demand),
            75..87 => Program::Flap(demand, rng.between(100, 3000) * MS, rng.between(200, 3000) * MS),
            87..95 => Program::Nonsense,
            95..97 => Program::Present,
            _ => Program::Standby,
        }
    }

    fn speak(&mut self, rng: &mut Rng, handle: &Handle<'_>, index: usize, now: u64) {
        let truth = self.truth;
        let source = &mut self.sources[index];
        let command = match source.program {
            Program::Silent => return,
            Program::Standby => Command::Standby,
            Program::Present => Command::Present,
            Program::Run(demand) => Command::Run(demand),
            Program::Flap(demand, on, off) => {
                if (now - source.on_since) % (on + off) >= on {
                    return;
                }
                Command::Run(demand)
            }
            Program::Fly(demand) => {
                if truth.running && rng.percent(2) {
                    // Another throttle now and then.
                    let demand = self.demand(rng);
                    self.sources[index].program = Program::Fly(demand);
                    Command::Run(demand)
                } else if truth.running {
                    Command::Run(demand)
                } else if truth.live || source.ready_since.is_some_and(|since| now > since + 1_500 * MS) {
                    if !truth.live && !truth.standby {
                        source.ready_since = None;
                    }
                    // Not for ever, if nothing comes of it.
                    if source.ready_since.is_some_and(|since| now > since + 4 * SECOND) && !truth.live {
                        source.ready_since = None;
                    }
                    Command::Run(throttle(0))
                } else {
                    if truth.standby {
                        source.ready_since.get_or_insert(now);
                    }
                    Command::Standby
                }
            }
            Program::Nonsense => match rng.below(13) {
                0 => Command::ReleaseStop,
                1 => Command::Arm,
                4 => Command::Present,
                5 if rng.percent(5) => Command::ShutDown,
                2 if rng.percent(5) => Command::EmergencyStop,
                3 if rng.percent(20) => Command::Standby,
                _ => {
                    source.period = rng.between(20, 900) * MS;
                    Command::Run(self.demand(rng))
                }
            },
        };
        let origin = self.sources[index].origin;
        let _ = self.command(handle, origin, command);
    }
}

/// Words of one copy of a record.
const WORDS: usize = 8;

/// The words behind a record, to write them as a reset in the middle of a write would leave them.
fn words(memory: &RetainedMemory) -> &[AtomicU32; 2 * WORDS] {
    const { assert!(size_of::<RetainedMemory>() == size_of::<[AtomicU32; 2 * WORDS]>()) };
    // SAFETY: a `RetainedMemory` is two copies of eight atomic words and nothing else, as the assertion on its size says, and
    // atomic words may be shared and take any value.
    unsafe { &*std::ptr::from_ref(memory).cast() }
}

/// Why a boot ended.
enum End {
    Time,
    /// Reset, with this of each engine's memory.
    Reset(Kept),
}

/// Runs a world for so long.
pub fn run(seed: u64, length: Duration) -> Result<(u64, Tally), Failure> {
    let mut rng = Rng(seed);
    if rng.percent(25) { play::<2>(seed, &mut rng, length) } else { play::<1>(seed, &mut rng, length) }
}

fn play<const N: usize>(seed: u64, rng: &mut Rng, length: Duration) -> Result<(u64, Tally), Failure> {
    clock::reset();
    let gap = Duration::from_millis(rng.pick(&[0, 3000, 10_000]));
    let mut rigs: [Rig; N] = std::array::from_fn(|port| rig(rng, port as u8, gap));
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
            let _ = writeln!(text, "{at:>12} {what:?}");
        }
        Failure { seed, text }
    };
    let mut how = Reset::PowerLost;
    loop {
        match boot(rng, &mut rigs, &configs, (memory, how), end) {
            Ok(End::Time) => break,
            Ok(End::Reset(kept)) => {
                let down = if rng.percent(70) { rng.below(300 * MS) } else { rng.below(1_500 * MS) };
                down_for(&mut rigs, down);
                for (rig, memory) in rigs.iter_mut().zip(memory) {
                    rig.look_at_ecu();
                    let record = memory.load(rig.config.fingerprint(), Reset::Warm);
                    let demand = record.and_then(|record| match record.order {
                        Order::Run(demand) if record.ran => {
                            Some((record.origin, demand, record.loss >= LossStage::FailSafe))
                        }
                        _ => None,
                    });
                    let kept = if let Kept::Whole(_) = kept { Kept::Whole(demand) } else { kept };
                    how = if kept == Kept::PowerLost { Reset::PowerLost } else { Reset::Warm };
                    rig.input(Input::Boot { kept, down });
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

/// The ECUs, while there is no node.
#[expect(clippy::disallowed_methods, reason = "time passes")]
fn down_for<const N: usize>(rigs: &mut [Rig; N], down: u64) {
    let mut plugs: Vec<Pin<Box<dyn Future<Output = ()>>>> = Vec::new();
    for rig in rigs.iter() {
        let plug = rig.plug.clone();
        plugs.push(Box::pin(async move { match plug.run().await {} }));
    }
    // An ECU without power wants nothing, and time has to go on.
    plugs.push(Box::pin(Timer::after(Duration::from_micros(down + SECOND))));
    let all = pin!(poll_fn(|cx| {
        for plug in &mut plugs {
            let _ = plug.as_mut().poll(cx);
        }
        Poll::<()>::Pending
    }));
    clock::run_for(all, Duration::from_micros(down));
    drop(plugs);
    // A UART that was reset holds nothing.
    for rig in rigs {
        let rx = &mut rig.halves.0;
        clock::run(async {
            let mut buffer = [0; 64];
            while rx.read_ready().unwrap_or(false) {
                let _ = rx.read(&mut buffer).await;
            }
        });
    }
}

#[expect(clippy::disallowed_methods, reason = "a listener stamps what it hears")]
fn boot<const N: usize>(
    rng: &mut Rng,
    rigs: &mut [Rig; N],
    configs: &[EngineConfig; N],
    (memory, how): (&'static [RetainedMemory; N], Reset),
    end: u64,
) -> Result<End, (usize, String)> {
    static ERRORS: LineErrors = LineErrors::new();
    let node = Node::new(configs, Some((memory, how))).expect("valid");
    let handles = node.handles();
    // Commands may come before the engines' tasks have begun.
    if rng.percent(30) {
        let port = rng.below(N as u64) as usize;
        let command = rng.pick(&[Command::Arm, Command::Disarm, Command::Run(throttle(0)), Command::Standby]);
        let origin = rng.pick(&Origin::SOURCES);
        let _ = rigs[port].command(&handles[port], origin, command);
    }
    let mut tasks: Vec<Pin<Box<dyn Future<Output = ()> + '_>>> = Vec::new();
    for (port, runner) in node.runners().into_iter().enumerate() {
        let plug = rigs[port].plug.clone();
        tasks.push(Box::pin(async move { match plug.run().await {} }));
        let mut events = handles[port].events().expect("a place is free");
        let told = rigs[port].told.clone();
        tasks.push(Box::pin(async move {
            loop {
                let event = events.next_message_pure().await;
                told.borrow_mut().push((Instant::now().as_micros(), event));
            }
        }));
        // The halves come back when the node is gone.
        let halves = &raw mut rigs[port].halves;
        // SAFETY: nobody else touches the halves until the tasks are dropped at the end of this function.
        let (rx, tx) = unsafe { &mut *halves };
        tasks.push(Box::pin(async move { runner.run(rx, tx, &ERRORS).await }));
    }
    let mut all = pin!(poll_fn(|cx| {
        for task in &mut tasks {
            let _ = task.as_mut().poll(cx);
        }
        Poll::<()>::Pending
    }));
    let reset_at = now() + rng.wait(150 * SECOND);
    let mut look_at = now();
    loop {
        let at = now();
        if at >= end {
            return Ok(End::Time);
        }
        if at >= reset_at {
            return Ok(End::Reset(reset(rng, rigs, &handles, memory)));
        }
        for (port, rig) in rigs.iter_mut().enumerate() {
            rig.disturb(rng);
            rig.command_all(rng, &handles[port]);
            if at >= look_at {
                rig.look_at_ecu();
            }
        }
        if at >= look_at {
            look_at = at + 100 * MS;
        }
        let next = rigs
            .iter()
            .flat_map(|rig| rig.sources.iter().map(|source| source.next.max(at + MS)))
            .chain([look_at])
            .min()
            .unwrap_or(look_at);
        clock::run_for(all.as_mut(), Duration::from_micros(next - at));
        for port in 0..N {
            let started = rigs[port].judge(false).map_err(|why| (port, why))?;
            if started {
                for other in (0..N).filter(|other| *other != port) {
                    rigs[other].input(Input::OtherStarted);
                }
            }
        }
    }
}

/// The node is reset, at times in the middle of what a command makes it write.
fn reset<const N: usize>(
    rng: &mut Rng,
    rigs: &mut [Rig; N],
    handles: &[Handle<'_>; N],
    memory: &'static [RetainedMemory; N],
) -> Kept {
    match rng.below(10) {
        0 => {
            memory.iter().for_each(RetainedMemory::clear);
            Kept::Lost
        }
        1 => {
            // Brown-out: a bit or two of each copy.
            for words in memory.iter().map(words) {
                for copy in 0..2 {
                    let word = &words[copy * WORDS + rng.below(WORDS as u64) as usize];
                    word.fetch_xor(1 << rng.below(32), Ordering::Relaxed);
                }
            }
            Kept::Lost
        }
        // The power of the node was lost for a moment, and its memory survived that.
        2 => Kept::PowerLost,
        3..6 => {
            let port = rng.below(N as u64) as usize;
            let demand = rigs[port].demand(rng);
            let command = rng.pick(&[
                Command::EmergencyStop,
                Command::Standby,
                Command::Arm,
                Command::Disarm,
                Command::Run(demand),
            ]);
            let origin = rng.pick(&Origin::SOURCES);
            let read = || words(&memory[port]).each_ref().map(|word| word.load(Ordering::Relaxed));
            let before = read();
            let answer = command_as(&handles[port], command, origin);
            let after = read();
            let written = rng.below(WORDS as u64 + 1) as usize;
            let copy = (0..2).find(|copy| before[copy * WORDS..][..WORDS] != after[copy * WORDS..][..WORDS]);
            match copy {
                Some(copy) if written < WORDS => {
                    // The reset came before the command was answered: it was never given.
                    let kept = words(&memory[port]).iter().zip(before);
                    for (word, old) in kept.skip(copy * WORDS + written).take(WORDS - written) {
                        word.store(old, Ordering::Relaxed);
                    }
                }
                _ => rigs[port].input(Input::Said(origin, command, answer)),
            }
            Kept::Whole(None)
        }
        _ => Kept::Whole(None),
    }
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
        self.went_on += other.went_on;
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
