//! Random worlds: one to three engines, with simulated ECUs of every behaviour, on a node that is reset now and
//! then, and pilots that command them well and badly. Everything comes from one seed.

use crate::acts::{Act, Blow};
use crate::context::{EngineContext, Judged, LOOK, now};
use crate::fate::Fate;
use crate::faults::Weather;
use crate::history::{Cause, MS, Reset, SECOND, Spans};
use crate::judge::{self, failed_for_sure, may_have_failed};
use crate::pilots::Rng;
use crate::radio::Receiver;
use crate::settings::{self, Setup};
use crate::vehicle::{self, Receiver as Service, Vehicle};
use embassy_time::{Duration, Ticker};
use jetlink::channel::Owner;
use jetlink::config::EngineConfig;
use jetlink::engine::retained::{self, RetainedMemory};
use jetlink::line::LineError;
use jetlink::node::Node;
use jetlink::runner::LineErrors;
use jetlink_rc::starts::{Ended, FailedStarts, LIVED};
use sim::clock;
use sim::wire::{WireRx, WireTx};
use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::rc::Rc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::task::Poll;

/// In half of the resets, one bit is another one afterwards: nothing that the other copy of the record does not make good. Not
/// by the world's random numbers, whose order seeds rely on.
fn damage(memory: &RetainedMemory, down_at: u64) {
    let words = words(memory);
    let chance = down_at.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32;
    let (word, bit) = (chance as usize % words.len(), chance >> 8 & 31);
    if chance >> 31 == 1 {
        words[word].fetch_xor(1 << bit, Ordering::Relaxed);
    }
}

/// A world that was played.
pub struct World {
    pub seed: u64,
    pub engines: Vec<Judged>,
}

/// The words behind a record, to write them as a loss of power would leave them.
fn words(memory: &RetainedMemory) -> &[AtomicU32] {
    const {
        assert!(
            size_of::<RetainedMemory>().is_multiple_of(4) && align_of::<RetainedMemory>().is_multiple_of(4)
        )
    };
    // SAFETY: a `RetainedMemory` is atomic words and nothing else, and those may be shared and take any value.
    unsafe { core::slice::from_raw_parts(std::ptr::from_ref(memory).cast(), size_of::<RetainedMemory>() / 4) }
}

/// Plays one world of this duration, s.
pub fn run(seed: u64, seconds: u64) -> World {
    let mut rng = Rng(seed);
    if is_drilled(seed) {
        return match rng.below(10) {
            0..8 => drilled::<1>(seed, &mut rng, seconds),
            _ => drilled::<2>(seed, &mut rng, seconds),
        };
    }
    match rng.below(10) {
        0..7 => random::<1>(seed, &mut rng, seconds),
        7..9 => random::<2>(seed, &mut rng, seconds),
        _ => random::<3>(seed, &mut rng, seconds),
    }
}

fn random<const N: usize>(seed: u64, rng: &mut Rng, seconds: u64) -> World {
    clock::reset();
    let weather = rng.pick(&[Weather::Calm, Weather::Fair, Weather::Fair, Weather::Rough]);
    let mut setups = settings::setups(rng, N);
    let contexts = setups.drain(..).map(|setup| EngineContext::random(rng, setup, weather)).collect();
    let fate = Fate::random(rng, weather);
    let together = if N > 1 && rng.percent(60) { rng.wait(150 * SECOND) } else { u64::MAX };
    let mut contexts: Vec<Wired> = contexts;
    let vehicle = vehicle::SEEDS.contains(&seed);
    let vehicle = vehicle.then(|| Vehicle::random(seed, contexts.iter_mut().map(|(context, _)| context)));
    play::<N>(seed, rng, contexts, vehicle, fate, together, seconds * SECOND)
}

/// Half of the worlds are drills: one fault at a time.
fn is_drilled(seed: u64) -> bool {
    !vehicle::SEEDS.contains(&seed) && Rng(seed).next() & 1 == 0
}

fn drilled<const N: usize>(seed: u64, rng: &mut Rng, seconds: u64) -> World {
    clock::reset();
    let mut setups = settings::setups(rng, N);
    if N > 1 && rng.percent(8) {
        // Longer than a start waits.
        setups.iter_mut().for_each(|setup| setup.config.supervision.start.gap = Duration::from_secs(200));
    }
    let contexts = setups.drain(..).map(|setup| {
        let setup = setup.drilled(rng, N);
        EngineContext::drilled(rng, setup, N > 1)
    });
    let contexts = contexts.collect();
    play::<N>(seed, rng, contexts, None, Fate::Drills, u64::MAX, seconds * SECOND)
}

/// Plays a case: the acts on each engine, and on the node.
pub fn case<const N: usize>(engines: [(Setup, Vec<(u64, Act)>); N], blows: Vec<Blow>, seconds: u64) -> World {
    clock::reset();
    let contexts = engines.into_iter().map(|(setup, acts)| EngineContext::scripted(setup, acts)).collect();
    play::<N>(0, &mut Rng(1), contexts, None, Fate::Script(blows.into()), u64::MAX, seconds * SECOND)
}

type Wired = (EngineContext, (WireRx, WireTx));

/// `together`: when all engines are flown from standby on, the first time; `u64::MAX`: each when its pilot likes.
fn play<const N: usize>(
    seed: u64,
    rng: &mut Rng,
    wired: Vec<Wired>,
    mut vehicle: Option<Vehicle>,
    mut fate: Fate,
    mut together: u64,
    end: u64,
) -> World {
    let (mut contexts, mut halves): (Vec<EngineContext>, Vec<_>) = wired.into_iter().unzip();
    let configs: [_; N] = std::array::from_fn(|port| contexts[port].setup.config);
    let others: [_; N] = std::array::from_fn(|port| contexts[port].setup.other_settings());
    let (mut other_settings, mut other_engine, mut before) = (false, false, Cause::PowerOn);
    // It outlives every node, as memory does; a few bytes for each world.
    let memory: &'static [RetainedMemory; N] =
        Box::leak(Box::new(std::array::from_fn(|_| RetainedMemory::new())));
    // In memory, too: the time of starts that failed.
    let mut failed = FailedStarts::default();
    loop {
        let began_at = now();
        let mut configs = if other_settings { others } else { configs };
        if other_engine {
            configs.iter_mut().for_each(|config| config.name = "other");
        }
        let ended = boot(
            rng,
            &mut contexts,
            &mut vehicle,
            &mut halves,
            &configs,
            memory,
            before,
            failed,
            &mut fate,
            &mut together,
            end,
        );
        let Some(Blow { down, mut cause, with_ecu, other_engine: other, .. }) = ended else { break };
        before = cause;
        other_engine ^= other;
        if other && cause == Cause::Watchdog {
            // Another engine's memory retains as much as one after a loss of power.
            cause = Cause::BrownOut;
        }
        let life = Duration::from_micros(now() - began_at);
        if life >= LIVED {
            failed = FailedStarts::lived(contexts.iter().map(EngineContext::is_cut));
        }
        failed = match cause {
            Cause::Watchdog => failed.after(Ended::Crashed(life)),
            Cause::BrownOut => failed.after(Ended::Otherwise),
            Cause::PowerOn => FailedStarts::default(),
        };
        let changed = ended.is_some_and(|blow| blow.other_settings);
        other_settings ^= changed;
        let down_at = now();
        for context in &mut contexts {
            context.release();
            if with_ecu {
                context.power_off(rng, down_at + down);
            }
            let with = if with_ecu { ", and the ECU loses its power, too" } else { "" };
            context.note(format!("the node is reset ({cause}), {} ms without it{with}", down / MS));
        }
        if cause == Cause::PowerOn {
            for word in memory.iter().flat_map(words) {
                word.store(rng.next() as u32, Ordering::Relaxed);
            }
            contexts.iter_mut().for_each(EngineContext::forget);
        } else {
            memory.iter().for_each(|memory| damage(memory, down_at));
        }
        halves = down_for(rng, &mut contexts, &mut vehicle, down_at + down, end);
        for context in &mut contexts {
            context.history.resets.push(Reset { down: down_at, up: now(), cause });
            context.history.renamed.extend(other.then(now));
            context.history.other_settings.extend(changed.then(now));
        }
    }
    contexts.iter_mut().for_each(EngineContext::end);
    let ends: Vec<Spans> = contexts.iter().map(|context| may_have_failed(&context.history)).collect();
    let sure: Vec<Spans> = contexts.iter().map(|context| failed_for_sure(&context.history)).collect();
    let busy: Vec<Spans> = contexts.iter().map(|context| judge::busy(&context.history)).collect();
    let started: Vec<Vec<u64>> = contexts.iter().map(|context| context.history.starts_on_wire()).collect();
    let engines = (0..N).map(|port| {
        let others = |of: &[Spans]| {
            let others = (0..N).filter(|other| *other != port).map(|other| &of[other]);
            others.fold(Spans::default(), |all, spans| all.union(spans))
        };
        let started = (0..N).filter(|other| *other != port).flat_map(|other| &started[other]);
        let mut started: Vec<u64> = started.copied().collect();
        started.sort_unstable();
        contexts[port].judged(others(&ends), others(&sure), others(&busy), started)
    });
    World { seed, engines: engines.collect() }
}

type Tasks<'a> = Vec<Pin<Box<dyn Future<Output = ()> + 'a>>>;

/// The parts that always run: the wires and the ECUs.
#[expect(clippy::disallowed_methods, reason = "time passes, whether or not anybody waits")]
fn nature(contexts: &[EngineContext]) -> Tasks<'static> {
    let mut tasks: Tasks<'static> = Vec::new();
    for context in contexts {
        let plug = context.plug.clone();
        tasks.push(Box::pin(clock::task(async move { match plug.run().await {} })));
    }
    // An ECU without power has no next wake.
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

/// Lets everything except the node act once.
fn act_all<const N: usize>(
    rng: &mut Rng,
    contexts: &mut [EngineContext],
    vehicle: &mut Option<Vehicle>,
    owners: &[Owner<'_>],
    receivers: &mut [Option<Receiver<'_>>],
    service: Option<&mut Service<'_, N>>,
    look: bool,
) {
    if let Some(vehicle) = vehicle {
        vehicle.act(now(), contexts, service);
    }
    for (port, context) in contexts.iter_mut().enumerate() {
        context.act(rng, owners.get(port), receivers.get_mut(port).and_then(Option::as_mut));
        if look {
            context.look();
        }
    }
}

/// Time of the next event.
fn next(contexts: &[EngineContext], vehicle: Option<&Vehicle>, look_at: u64) -> u64 {
    let at = now();
    let vehicle = vehicle.map_or(u64::MAX, Vehicle::next);
    let contexts = contexts.iter().map(EngineContext::next);
    contexts.chain([vehicle]).map(|next| next.max(at + MS)).chain([look_at]).min().unwrap_or(look_at)
}

/// The rest of the world, while there is no node.
fn down_for(
    rng: &mut Rng,
    contexts: &mut [EngineContext],
    vehicle: &mut Option<Vehicle>,
    until: u64,
    end: u64,
) -> Vec<(WireRx, WireTx)> {
    let mut tasks = nature(contexts);
    let mut all = pin!(poll_all(&mut tasks));
    let mut look_at = now();
    while now() < until.min(end) {
        let look = now() >= look_at;
        act_all::<0>(rng, contexts, vehicle, &[], &mut [], None, look);
        if look {
            look_at = now() + LOOK;
        }
        let next = next(contexts, vehicle.as_ref(), look_at).min(until);
        clock::run_for(all.as_mut(), Duration::from_micros(next - now()));
    }
    contexts.iter().map(|context| context.plug.reset_node()).collect()
}

/// The node runs until it is reset; `None`: until the end.
#[expect(clippy::too_many_arguments, reason = "all that a node consists of")]
fn boot<const N: usize>(
    rng: &mut Rng,
    contexts: &mut [EngineContext],
    vehicle: &mut Option<Vehicle>,
    halves: &mut Vec<(WireRx, WireTx)>,
    configs: &[EngineConfig; N],
    memory: &'static [RetainedMemory; N],
    cause: Cause,
    failed: FailedStarts,
    fate: &mut Fate,
    together: &mut u64,
    end: u64,
) -> Option<Blow> {
    let reset = match cause {
        Cause::Watchdog => retained::Reset::Warm,
        Cause::BrownOut | Cause::PowerOn => retained::Reset::PowerLost,
    };
    let node = Node::new(configs, Some((memory, reset))).expect("valid");
    let owners = node.owners();
    // From what was retained, before anything else.
    let mut receivers = Vec::new();
    let places = contexts.iter_mut().zip(configs).zip(memory).zip(&owners).enumerate();
    for (engine, (((context, config), memory), owner)) in places {
        let fingerprint = config.fingerprint();
        let record = memory.load(fingerprint, reset);
        receivers.push(context.begin(fingerprint, record, failed.close(engine), owner));
    }
    let mut service = vehicle.as_mut().map(|vehicle| vehicle.begin::<N>(now(), &owners, configs));
    let mut tasks: Tasks<'_> = nature(contexts);
    for ((runner, (rx, tx)), context) in node.runners().into_iter().zip(halves.drain(..)).zip(contexts.iter())
    {
        // As the firmware's interrupt does it.
        let errors = Rc::new(LineErrors::new());
        let counted = Rc::clone(&errors);
        context.plug.on_framing_error(move || counted.count(LineError::Framing));
        if context.history.reopened.is_none() {
            tasks.push(Box::pin(clock::task(async move { runner.run(rx, tx, &errors).await })));
            continue;
        }
        let (plug, reopened) = (context.plug.clone(), Rc::clone(&context.reopened));
        tasks.push(Box::pin(clock::task(async move {
            let mut halves = (rx, tx);
            loop {
                runner.run_until_stuck(halves.0, halves.1, &errors).await;
                reopened.borrow_mut().push(now());
                halves = plug.reset_node();
            }
        })));
    }
    let mut all = pin!(poll_all(&mut tasks));
    let mut blow = fate.next(rng);
    let mut look_at = now();
    loop {
        let at = now();
        if at >= end {
            return None;
        }
        let reset_at = blow.map_or(u64::MAX, |blow| blow.at);
        if at >= reset_at {
            return blow;
        }
        if at >= *together {
            *together = at + rng.wait(300 * SECOND);
            contexts.iter_mut().for_each(|context| context.fly(rng));
        }
        let look = at >= look_at;
        act_all(rng, contexts, vehicle, &owners, &mut receivers, service.as_mut(), look);
        if look {
            look_at = at + LOOK;
            blow = fate.sooner(rng, contexts, reset_at).or(blow);
        }
        let next = next(contexts, vehicle.as_ref(), look_at).min(reset_at).max(at + 1);
        clock::run_for(all.as_mut(), Duration::from_micros(next - at));
    }
}
