//! Random worlds: one to three engines with simulated ECUs of every temper on a node that is reset now and then, and
//! pilots that command them well and badly. Everything comes from one seed.

use crate::faults::{Disturber, Weather};
use crate::history::{Cause, History, Kind, MS, Mark, Reset, SECOND, Said, Sample, Spans, Word};
use crate::judge::{Verdict, judge};
use crate::log;
use crate::pilots::{Habit, Pilot, Rng, View};
use crate::settings::{self, Setup};
use crate::wire::Reader;
use embassy_time::{Duration, Ticker};
use jetlink::channels::Handle;
use jetlink::command::Origin;
use jetlink::engine::keep::Memory;
use jetlink::node::Node;
use jetlink::runner::LineErrors;
use sim::any::AnyEcu;
use sim::clock;
use sim::turbine::Phase;
use sim::wire::{Plug, Settings, WireRx, WireTx, connect_with};
use sim::zk::{Ruler, state};
use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::sync::atomic::{AtomicU32, Ordering};
use std::task::Poll;

/// From look to look at the turbines.
const LOOK: u64 = 50 * MS;

/// One engine of a world, judged.
pub struct Judged {
    pub name: String,
    pub history: History,
    pub verdict: Verdict,
    pub notes: Vec<(u64, String)>,
}

/// A world that was played.
pub struct World {
    pub seed: u64,
    pub engines: Vec<Judged>,
}

impl World {
    /// What happened, for a reader; around the findings only, unless the whole is wanted.
    pub fn report(&self, whole: bool) -> String {
        log::report(self, whole)
    }
}

/// One engine, its ECU, its pilots.
struct Seat {
    setup: Setup,
    plug: Plug<AnyEcu>,
    reader: Reader,
    history: History,
    pilots: Vec<Pilot>,
    disturber: Disturber,
    notes: Vec<(u64, String)>,
    /// Ignitions and losses of control that are in the history already.
    ignitions: usize,
    given_up: u64,
    /// It ran or was started since its ECU was powered up.
    lived: bool,
    pwm_since: Option<u64>,
    next_swap: u64,
}

/// How long this thread's clock has run, µs.
fn now() -> u64 {
    clock::now_ns() / 1000
}

impl Seat {
    fn new(rng: &mut Rng, setup: Setup, weather: Weather) -> (Self, (WireRx, WireTx)) {
        let (rx, tx, plug) = connect_with(setup.ecu(), Settings::new(setup.line, rng.next()));
        plug.record(true);
        let mut sources = [0, 1, 2, 3];
        for last in (1..4).rev() {
            sources.swap(last, rng.below(last as u64 + 1) as usize);
        }
        let count = rng.pick(&[1, 1, 2, 2, 3]);
        let habit = |index: usize, rng: &mut Rng| match index {
            0 => Habit::Flies,
            _ => rng.pick(&[Habit::Below, Habit::Restless, Habit::Flies]),
        };
        let pilots = (0..count).map(|index| {
            let habit = habit(index, rng);
            Pilot::new(rng, sources[index], habit)
        });
        let pilots = pilots.collect();
        let mut disturber = Disturber::new(rng, weather);
        disturber.signals = rng.percent(15);
        let seat = Self {
            reader: Reader::new(setup.rules.kind == Kind::Amt),
            history: History::new(setup.rules),
            plug,
            pilots,
            disturber,
            notes: Vec::new(),
            ignitions: 0,
            given_up: 0,
            lived: false,
            pwm_since: None,
            next_swap: rng.wait(3000 * SECOND),
            setup,
        };
        (seat, (rx, tx))
    }

    fn note(&mut self, text: String) {
        self.notes.push((now(), text));
    }

    /// The turbine and the wire, as they are now.
    fn look(&mut self) {
        let at = now();
        let frames = self.reader.read(&self.plug.take_log());
        self.history.frames.extend(frames);
        let powered = !self.history.unpowered.contains(at);
        let (seen, lived, before) = (self.ignitions, self.lived, self.given_up);
        let (sample, ignitions, restart, given_up, pwm) = self.plug.ecu(|ecu| {
            let ecu = &*ecu;
            let turbine = ecu.turbine();
            let (fault, restart, given_up, pwm) = match ecu {
                AnyEcu::Amt(ecu) => (ecu.errors() != 0, false, ecu.stats.serial_delay_stops, false),
                AnyEcu::Zk(ecu) => {
                    let pwm = ecu.ruler() == Ruler::Pwm && turbine.phase().is_live();
                    (ecu.error() != 0, ecu.state() == state::RESTART, ecu.stats.control_losses, pwm)
                }
            };
            let phase = turbine.phase();
            let lit = turbine.thrust() > 0.0;
            let sample = Sample {
                at,
                phase,
                lit,
                rpm: turbine.rpm(),
                egt: turbine.egt(),
                flow: turbine.fuel_flow(),
                fault,
            };
            let ignitions: Vec<u64> =
                turbine.history().ignitions.iter().skip(seen).map(|at| at / 1000).collect();
            (sample, ignitions, restart, given_up, pwm)
        });
        self.ignitions += ignitions.len();
        for when in ignitions {
            let mark = if restart && lived { Mark::Relight } else { Mark::Ignition };
            self.history.marks.push((when.min(at), mark));
            self.lived = true;
        }
        if given_up > before {
            self.given_up = given_up;
            self.history.marks.push((at, Mark::GivenUp));
        }
        self.lived &= powered;
        match (pwm, self.pwm_since) {
            (true, None) => self.pwm_since = Some(at.saturating_sub(LOOK)),
            (false, Some(since)) => {
                self.history.pwm.push(since, at + SECOND);
                self.pwm_since = None;
            }
            _ => {}
        }
        self.history.samples.push(sample);
    }

    fn view(&self) -> View {
        let at = now();
        let (phase, egt) = self.plug.ecu(|ecu| (ecu.turbine().phase(), ecu.turbine().egt()));
        let takes_rpm = self.history.version(at) >= 4;
        let rules = &self.history.rules;
        View { now: at, phase, egt, cool: rules.egt_max, max_rpm: takes_rpm.then_some(rules.max_rpm as u32) }
    }

    /// What the pilots say now reaches the node, if there is one.
    fn speak(&mut self, rng: &mut Rng, handle: Option<&Handle<'_>>) {
        let at = now();
        if self.pilots.iter().all(|pilot| pilot.next > at) {
            return;
        }
        let view = self.view();
        for index in 0..self.pilots.len() {
            let words = self.pilots[index].speak(rng, &view);
            let source = self.pilots[index].source;
            for word in words {
                self.say(handle, source, word);
            }
        }
    }

    fn say(&mut self, handle: Option<&Handle<'_>>, source: usize, word: Word) {
        let (Some(handle), Some(command)) = (handle, settings::command(word, self.setup.is_amt())) else {
            return;
        };
        // What is answered is not looked at.
        let _ = handle.command(command, Origin::SOURCES[source]);
        self.history.said.push(Said { at: now(), source, word });
    }

    /// Another ECU of the kind is plugged in, while it has no power.
    fn swap(&mut self, rng: &mut Rng) {
        let at = now();
        let Kind::Zk(_) = self.setup.rules.kind else { return };
        if at < self.next_swap {
            return;
        }
        self.next_swap = at + rng.wait(3000 * SECOND);
        let version = rng.between(1, 7) as u8;
        self.look();
        let ecu = self.setup.another(version);
        drop(self.plug.replace_ecu(ecu));
        (self.ignitions, self.given_up, self.lived) = (0, 0, false);
        let off = rng.spread(50 * MS, 60 * SECOND);
        let (plug, history) = (self.plug.clone(), &mut self.history);
        self.disturber.power_off(&plug, history, at, at + off, rng);
        self.history.versions.push((at, version));
        self.note(format!("another ECU, of version {version}, without power for {} ms", off / MS));
    }

    fn finish(&mut self, others: &Spans) -> Judged {
        let at = now();
        self.look();
        self.disturber.finish(&mut self.history, at);
        if let Some(since) = self.pwm_since.take() {
            self.history.pwm.push(since, at);
        }
        self.history.end = at;
        self.history.other_failed = others.clone();
        let verdict = judge(&self.history);
        Judged {
            name: self.setup.name(),
            history: core::mem::replace(&mut self.history, History::new(self.setup.rules)),
            verdict,
            notes: core::mem::take(&mut self.notes),
        }
    }
}

/// The words behind a record, to write them as a loss of power would leave them.
fn words(memory: &Memory) -> &[AtomicU32] {
    const { assert!(size_of::<Memory>() % 4 == 0 && align_of::<Memory>() == 4) };
    // SAFETY: a `Memory` is atomic words and nothing else, and those may be shared and take any value.
    unsafe { core::slice::from_raw_parts(std::ptr::from_ref(memory).cast(), size_of::<Memory>() / 4) }
}

/// Why a boot ended.
enum End {
    Time,
    Reset(Cause),
}

/// What the node itself goes through.
struct Fate {
    weather: Weather,
    next: u64,
    /// Resets that still follow, and how long the node runs between them.
    loop_left: u64,
    loop_period: u64,
    /// A power-on leaves nothing of the memory.
    with_ecu: bool,
}

/// Plays one world of so many seconds.
pub fn run(seed: u64, seconds: u64) -> World {
    let mut rng = Rng(seed);
    match rng.below(10) {
        0..7 => play::<1>(seed, &mut rng, seconds),
        7..9 => play::<2>(seed, &mut rng, seconds),
        _ => play::<3>(seed, &mut rng, seconds),
    }
}

fn play<const N: usize>(seed: u64, rng: &mut Rng, seconds: u64) -> World {
    clock::reset();
    let weather = rng.pick(&[Weather::Calm, Weather::Fair, Weather::Fair, Weather::Rough]);
    let setups = settings::setups(rng, N);
    let configs: [_; N] = std::array::from_fn(|port| setups[port].config);
    let (mut seats, mut halves) = (Vec::new(), Vec::new());
    for setup in setups {
        let (seat, pair) = Seat::new(rng, setup, weather);
        seats.push(seat);
        halves.push(pair);
    }
    // It outlives every node, as memory does; a few bytes for each world.
    let memory: &'static [Memory; N] = Box::leak(Box::new(std::array::from_fn(|_| Memory::new())));
    let mut fate = Fate {
        weather,
        next: rng.wait(weather.between_faults()),
        loop_left: 0,
        loop_period: 0,
        with_ecu: false,
    };
    let end = seconds * SECOND;
    loop {
        let ended = boot(rng, &mut seats, &mut halves, &configs, memory, &mut fate, end);
        let End::Reset(cause) = ended else { break };
        let down_at = now();
        let down = match cause {
            Cause::Watchdog if rng.percent(50) => rng.spread(5 * MS, 100 * MS),
            Cause::Watchdog => rng.spread(5 * MS, 1200 * MS),
            _ if rng.percent(10) => rng.spread(20 * MS, 100 * SECOND),
            _ => rng.spread(20 * MS, 3 * SECOND),
        };
        if fate.with_ecu {
            for seat in &mut seats {
                let plug = seat.plug.clone();
                let until = down_at + down;
                seat.disturber.power_off(&plug, &mut seat.history, down_at, until, rng);
            }
        }
        for seat in &mut seats {
            let with = if fate.with_ecu { ", and the ECU loses its power, too" } else { "" };
            seat.note(format!("the node is reset ({cause:?}), {} ms without it{with}", down / MS));
        }
        if cause == Cause::PowerOn {
            for word in memory.iter().flat_map(words) {
                word.store(rng.next() as u32, Ordering::Relaxed);
            }
        }
        halves = down_for(rng, &mut seats, down_at + down, end);
        for seat in &mut seats {
            seat.history.resets.push(Reset { down: down_at, up: now(), cause });
        }
    }
    let ends: Vec<Spans> = seats.iter().map(|seat| at_rest_after_running(&seat.history)).collect();
    let engines = (0..N).map(|port| {
        let others = (0..N).filter(|other| *other != port).map(|other| &ends[other]);
        let failed = others.fold(Spans::default(), |all, spans| all.union(spans));
        seats[port].finish(&failed)
    });
    World { seed, engines: engines.collect() }
}

fn at_rest_after_running(history: &History) -> Spans {
    let mut ran = false;
    let mut spans = Spans::default();
    for pair in history.samples.windows(2) {
        ran |= pair[0].phase == Phase::Running;
        if ran && !pair[0].runs() {
            spans.push(pair[0].at, pair[1].at);
        }
    }
    spans
}

type Tasks<'a> = Vec<Pin<Box<dyn Future<Output = ()> + 'a>>>;

/// What always goes on: the wires and the ECUs.
#[expect(clippy::disallowed_methods, reason = "time passes, whether or not anybody waits")]
fn nature(seats: &[Seat]) -> Tasks<'static> {
    let mut tasks: Tasks<'static> = Vec::new();
    for seat in seats {
        let plug = seat.plug.clone();
        tasks.push(Box::pin(async move { match plug.run().await {} }));
    }
    // An ECU without power wants nothing.
    tasks.push(Box::pin(async {
        let mut ticker = Ticker::every(Duration::from_secs(1));
        loop {
            ticker.next().await;
        }
    }));
    tasks
}

async fn poll_all(tasks: &mut Tasks<'_>) {
    poll_fn(|cx| {
        for task in tasks.iter_mut() {
            let _ = task.as_mut().poll(cx);
        }
        Poll::<()>::Pending
    })
    .await;
}

/// Everything but the node does what it does, once.
fn everybody(rng: &mut Rng, seats: &mut [Seat], handles: &[Handle<'_>], look: bool) {
    let at = now();
    for (port, seat) in seats.iter_mut().enumerate() {
        let notes = seat.disturber.disturb(rng, &seat.plug, &mut seat.history, at);
        for text in notes {
            seat.note(text);
        }
        seat.swap(rng);
        seat.speak(rng, handles.get(port));
        if look {
            seat.look();
        }
    }
}

/// When anybody wants something next.
fn next(seats: &[Seat], look_at: u64) -> u64 {
    let at = now();
    let all = seats.iter().flat_map(|seat| {
        seat.pilots
            .iter()
            .map(|pilot| pilot.next)
            .chain([seat.disturber.next()])
            .map(|next| next.max(at + MS))
    });
    all.chain([look_at]).min().unwrap_or(look_at)
}

/// The rest of the world, while there is no node.
fn down_for(rng: &mut Rng, seats: &mut [Seat], until: u64, end: u64) -> Vec<(WireRx, WireTx)> {
    let mut tasks = nature(seats);
    let mut all = pin!(poll_all(&mut tasks));
    let mut look_at = now();
    while now() < until.min(end) {
        let look = now() >= look_at;
        everybody(rng, seats, &[], look);
        if look {
            look_at = now() + LOOK;
        }
        let next = next(seats, look_at).min(until);
        clock::run_for(all.as_mut(), Duration::from_micros(next - now()));
    }
    seats.iter().map(|seat| seat.plug.reset_node()).collect()
}

fn boot<const N: usize>(
    rng: &mut Rng,
    seats: &mut [Seat],
    halves: &mut Vec<(WireRx, WireTx)>,
    configs: &[jetlink::config::EngineConfig; N],
    memory: &'static [Memory; N],
    fate: &mut Fate,
    end: u64,
) -> End {
    static ERRORS: LineErrors = LineErrors::new();
    let node = Node::with_memory(configs, memory).expect("valid");
    let handles = node.handles();
    let mut tasks: Tasks<'_> = nature(seats);
    for (runner, (rx, tx)) in node.runners().into_iter().zip(halves.drain(..)) {
        tasks.push(Box::pin(async move { runner.run(rx, tx, &ERRORS).await }));
    }
    let mut all = pin!(poll_all(&mut tasks));
    let (reset_at, cause) = fate.next_reset(rng);
    let mut look_at = now();
    loop {
        let at = now();
        if at >= end {
            return End::Time;
        }
        if at >= reset_at {
            return End::Reset(cause);
        }
        let look = at >= look_at;
        everybody(rng, seats, &handles, look);
        if look {
            look_at = at + LOOK;
        }
        let next = next(seats, look_at).min(reset_at).max(at + 1);
        clock::run_for(all.as_mut(), Duration::from_micros(next - at));
    }
}

impl Fate {
    /// When the node is reset next, and why.
    fn next_reset(&mut self, rng: &mut Rng) -> (u64, Cause) {
        self.with_ecu = false;
        if self.loop_left > 0 {
            self.loop_left -= 1;
            return (now() + self.loop_period, Cause::Watchdog);
        }
        while self.next <= now() {
            self.next += rng.wait(self.weather.between_faults());
        }
        let cause = match rng.below(100) {
            0..60 => Cause::Watchdog,
            60..80 => Cause::BrownOut,
            _ => Cause::PowerOn,
        };
        self.with_ecu = cause != Cause::Watchdog && rng.percent(40);
        if cause == Cause::Watchdog && rng.percent(25) {
            self.loop_left = rng.between(2, 40);
            self.loop_period = rng.spread(50 * MS, 8 * SECOND);
        }
        (self.next, cause)
    }
}
