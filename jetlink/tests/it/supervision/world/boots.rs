//! The node from one reset to the next, and what each reset leaves in memory.

use super::super::oracle::{Input, Retained};
use super::super::rng::Rng;
use super::rig::{MS, Rig, SECOND, command_as, now, throttle_tenths};
use crate::support::memory::{WORDS, words};
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, ReadReady};
use jetlink::channel::Owner;
use jetlink::command::{Command, Origin};
use jetlink::config::EngineConfig;
use jetlink::engine::retained::{Reset, RetainedMemory};
use jetlink::node::Node;
use jetlink::runner::LineErrors;
use sim::clock;
use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::sync::atomic::Ordering;
use std::task::Poll;

/// Why a boot ended.
pub(super) enum End {
    Time,
    /// Reset, with this left of each engine's memory.
    Reset(Retained),
}

/// The ECUs, while there is no node.
#[expect(clippy::disallowed_methods, reason = "time passes")]
pub(super) fn down_for<const N: usize>(rigs: &mut [Rig; N], down: u64) {
    let mut plugs: Vec<Pin<Box<dyn Future<Output = ()>>>> = Vec::new();
    for rig in rigs.iter() {
        let plug = rig.plug.clone();
        plugs.push(Box::pin(async move { match plug.run().await {} }));
    }
    // An ECU without power never wakes, and time has to pass.
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

#[expect(clippy::disallowed_methods, reason = "a listener stamps what it receives")]
pub(super) fn boot<const N: usize>(
    rng: &mut Rng,
    rigs: &mut [Rig; N],
    configs: &[EngineConfig; N],
    (memory, how): (&'static [RetainedMemory; N], Reset),
    end: u64,
) -> Result<End, (usize, String)> {
    static ERRORS: LineErrors = LineErrors::new();
    let node = Node::new(configs, Some((memory, how))).expect("valid");
    let owners = node.owners();
    // Commands may come before the engines' tasks have begun.
    if rng.percent(30) {
        let port = rng.below(N as u64) as usize;
        let command =
            rng.pick(&[Command::Arm, Command::Disarm, Command::Run(throttle_tenths(0)), Command::Standby]);
        let origin = rng.pick(&Origin::SOURCES);
        let _ = rigs[port].command(&owners[port], origin, command);
    }
    let mut tasks: Vec<Pin<Box<dyn Future<Output = ()> + '_>>> = Vec::new();
    for (port, runner) in node.runners().into_iter().enumerate() {
        let plug = rigs[port].plug.clone();
        tasks.push(Box::pin(async move { match plug.run().await {} }));
        let mut events = owners[port].handle().events().expect("a place is free");
        let published = rigs[port].published.clone();
        tasks.push(Box::pin(async move {
            loop {
                let event = events.next_message_pure().await;
                published.borrow_mut().push((Instant::now().as_micros(), event));
            }
        }));
        // The halves are returned when the node ends.
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
            return Ok(End::Reset(reset(rng, rigs, &owners, memory)));
        }
        for (port, rig) in rigs.iter_mut().enumerate() {
            rig.disturb(rng);
            rig.command_all(rng, &owners[port]);
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
            if let Some(at) = started {
                for other in (0..N).filter(|other| *other != port) {
                    rigs[other].input(Input::OtherStarted(at));
                }
            }
        }
    }
}

/// The node is reset, sometimes in the middle of a write caused by a command.
pub(super) fn reset<const N: usize>(
    rng: &mut Rng,
    rigs: &mut [Rig; N],
    owners: &[Owner<'_>; N],
    memory: &'static [RetainedMemory; N],
) -> Retained {
    match rng.below(10) {
        0 => {
            memory.iter().for_each(RetainedMemory::clear);
            Retained::Lost
        }
        1 => {
            // Brown-out: a bit or two of each copy.
            for words in memory.iter().map(words) {
                for copy in 0..2 {
                    let intent = &words[copy * WORDS + rng.below(WORDS as u64) as usize];
                    intent.fetch_xor(1 << rng.below(32), Ordering::Relaxed);
                }
            }
            Retained::Lost
        }
        // The power of the node was lost for a moment, and its memory survived that, at times with damage to one copy.
        2 => {
            for words in memory.iter().map(words) {
                if rng.percent(50) {
                    words[rng.below(2 * WORDS as u64) as usize]
                        .fetch_xor(1 << rng.below(32), Ordering::Relaxed);
                }
            }
            Retained::PowerLost
        }
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
            let read = || words(&memory[port]).each_ref().map(|intent| intent.load(Ordering::Relaxed));
            let before = read();
            let answer = command_as(&owners[port], command, origin);
            let after = read();
            // The first copy is written whole before the second one: then the command counts, although its answer got lost.
            let written = rng.below(2 * WORDS as u64 + 1) as usize;
            for (intent, old) in words(&memory[port]).iter().zip(before).skip(written) {
                intent.store(old, Ordering::Relaxed);
            }
            if before == after || written >= WORDS {
                rigs[port].input(Input::Commanded(origin, command, answer));
            }
            Retained::Whole(None)
        }
        _ => Retained::Whole(None),
    }
}
