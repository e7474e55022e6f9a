//! Resets and groups over the wire: the firmware's node on one end, simulated ECUs on the other, in virtual time.
#![allow(clippy::disallowed_methods, reason = "a scenario keeps its own time")]

use bench::rows::{simulated_as, wire};
use bench::wired::{LONG, command_as, received, throttle_percent};
use embassy_futures::join::join;
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};
use jetlink::channel::{Channel, LISTENERS, Owner};
use jetlink::command::{Accepted, Command, Demand, Order, Origin};
use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::engine::retained::{Reset, RetainedMemory, RetainedState};
use jetlink::engine::state::EngineState;
use jetlink::event::{End, Event};
use jetlink::line::Line;
use jetlink::node::Node;
use jetlink::report::Phase;
use jetlink::runner::LineErrors;
use jetlink::units::Throttle;
use sim::amt::AmtEcu;
use sim::clock;
use sim::ecu::{Ecu, MILLIS};
use sim::wire::{Direction, Plug, WireRx, WireTx};
use sim::zk::ZkEcu;
use std::cell::Cell;

static ERRORS: LineErrors = LineErrors::new();

fn amt(baud: u32) -> (EngineConfig, AmtEcu) {
    let config = EngineConfig::amt("amt", 0, Line::new(baud), None);
    (config, AmtEcu::new(simulated_as(&config)))
}

fn zk() -> (EngineConfig, ZkEcu) {
    let config = EngineConfig::zk("zk", 0, Line::new(9600), Rate::Hz20);
    (config, ZkEcu::new(simulated_as(&config)))
}

fn in_phase(owner: &Owner<'_>, phase: Phase) -> bool {
    owner.handle().telemetry().report.phase.is_some_and(|now| now.value == phase)
}

/// Repeats a command, as a source does, until `done`.
async fn fly(owner: &Owner<'_>, command: Command, mut done: impl FnMut(&Owner<'_>) -> bool) {
    loop {
        let _ = command_as(owner, command, Origin::Rc);
        if done(owner) {
            return;
        }
        Timer::after(Duration::from_millis(100)).await;
    }
}

async fn fly_for(owner: &Owner<'_>, command: Command, time: Duration) {
    let end = Instant::now() + time;
    fly(owner, command, |_| Instant::now() >= end).await;
}

async fn start(owner: &Owner<'_>) {
    command_as(owner, Command::Arm, Origin::Rc).expect("always accepted");
    loop {
        fly(owner, Command::Standby, |owner| in_phase(owner, Phase::Standby)).await;
        // A refusal uses up the permission, so standby comes again.
        if command_as(owner, throttle_percent(0), Origin::Rc) == Ok(Accepted::InForce) {
            break;
        }
        Timer::after(Duration::from_millis(100)).await;
    }
    fly(owner, throttle_percent(0), |owner| in_phase(owner, Phase::Running)).await;
}

/// One life of a node on a line: from its start-up to whatever ends `scenario`.
async fn life<T>(
    channel: &Channel,
    (rx, tx): (WireRx, WireTx),
    scenario: impl AsyncFnOnce(Owner<'_>) -> T,
) -> T {
    match select(channel.runner().run(rx, tx, &ERRORS), scenario(channel.owner())).await {
        Either::First(never) => never,
        Either::Second(output) => output,
    }
}

/// Both engines of a node on their lines, forever.
async fn live_two<A: Ecu, B: Ecu>(
    node: &Node<2>,
    left: (WireRx, WireTx, &Plug<A>),
    right: (WireRx, WireTx, &Plug<B>),
) {
    let [run_left, run_right] = node.runners();
    let engines = join(run_left.run(left.0, left.1, &ERRORS), run_right.run(right.0, right.1, &ERRORS));
    join(engines, join(left.2.run(), right.2.run())).await;
}

/// A reset in flight, with its memory and without, at every phase of the ECU's period: the engine continues, and the throttle
/// does not move. With its order in the record the first whole frame is answered, without it the second consistent one.
#[test]
fn an_engine_resumes_after_a_reset_in_flight() {
    // A frame every 125 ms at any baud rate.
    const PERIOD: u64 = 125;
    for baud in [2400, 9600] {
        for (with_memory, frames) in [(true, 1), (false, 2)] {
            let mut slowest = Duration::from_ticks(0);
            for phase in 0..10 {
                clock::reset();
                let memory: &'static RetainedMemory = Box::leak(Box::new(RetainedMemory::new()));
                let (config, ecu) = amt(baud);
                let (rx, tx, plug) = wire(&config, ecu, phase);
                let channel = |memory| match memory {
                    Some(memory) => Channel::new(&config, Some((memory, Reset::Warm))),
                    None => Channel::new(&config, None),
                };
                let memory = with_memory.then_some(memory);
                let scenario = async {
                    let before = channel(memory);
                    life(&before, (rx, tx), async |owner| {
                        start(&owner).await;
                        fly_for(&owner, throttle_percent(60), Duration::from_secs(8)).await;
                        Timer::after(Duration::from_millis(phase * 13)).await;
                    })
                    .await;
                    // Start-up of the firmware: nobody reads or writes for 20 ms.
                    Timer::after(Duration::from_millis(20)).await;
                    plug.record(true);
                    let begin = clock::now_ns();
                    let after = channel(memory);
                    life(&after, plug.reset_node(), async |owner| {
                        let demand = Demand::Throttle(Throttle::from_percent(60).expect("0..=100"));
                        let expected = if with_memory { Order::Doubt(demand) } else { Order::Listen };
                        assert_eq!(owner.handle().telemetry().ordered.order, expected);
                        fly_for(&owner, throttle_percent(60), Duration::from_secs(3)).await;
                        let telemetry = owner.handle().telemetry();
                        assert_eq!(telemetry.state, EngineState::Running, "{baud} {phase}");
                        assert!(matches!(telemetry.ordered.order, Order::Run(_)));
                        assert_eq!(telemetry.ordered.origin, Origin::Rc);
                    })
                    .await;
                    begin
                };
                let begin = match clock::run_for(select(plug.run(), scenario), LONG) {
                    Some(Either::Second(begin)) => begin,
                    _ => panic!("the scenario did not end"),
                };
                let log = plug.take_log();
                let sent: Vec<_> = log.iter().filter(|entry| entry.direction == Direction::ToEcu).collect();
                let first = sent.iter().find(|entry| entry.start >= begin).expect("a reply").start - begin;
                slowest = slowest.max(Duration::from_nanos(first));
                // Every third byte of a message is the throttle: 2 × 60 + 32.
                let late: Vec<_> = sent.iter().filter(|entry| entry.start >= begin).collect();
                for message in late.as_chunks::<5>().0 {
                    let bytes: Vec<u8> = message.iter().map(|entry| entry.byte).collect();
                    assert_eq!(bytes, [0xFF, 0x14, 152, 0x14, 152], "{baud} {with_memory} {phase}");
                }
            }
            println!("{baud} baud, {with_memory}: first reply within {} ms of start-up", slowest.as_millis());
            // A frame in transmission at start-up is lost, 25 ms of it at 2400 baud.
            assert!(slowest <= Duration::from_millis(frames * PERIOD + 25), "{} ms", slowest.as_millis());
        }
    }
}

/// A reset while the emergency stop is latched: still latched, and on the wire in the first reply.
#[test]
fn a_latched_stop_survives_a_reset_in_flight() {
    clock::reset();
    let memory: &'static RetainedMemory = Box::leak(Box::new(RetainedMemory::new()));
    let (config, ecu) = amt(2400);
    let (rx, tx, plug) = wire(&config, ecu, 1);
    let scenario = async {
        let before = Channel::new(&config, Some((memory, Reset::Warm)));
        life(&before, (rx, tx), async |owner| {
            start(&owner).await;
            command_as(&owner, Command::EmergencyStop, Origin::Rc).expect("never refused");
        })
        .await;
        // The byte in transmission is cut short.
        let halves = plug.reset_node();
        Timer::after(Duration::from_millis(20)).await;
        plug.record(true);
        let after = Channel::new(&config, Some((memory, Reset::Warm)));
        life(&after, halves, async |owner| {
            fly_for(&owner, throttle_percent(60), Duration::from_secs(3)).await;
            assert!(owner.handle().telemetry().stop_latched);
        })
        .await;
    };
    clock::run_for(select(plug.run(), scenario), LONG).expect("it ends");
    let sent: Vec<u8> = plug
        .take_log()
        .iter()
        .filter(|entry| entry.direction == Direction::ToEcu)
        .map(|entry| entry.byte)
        .collect();
    assert!(sent.len() > 50);
    for message in sent.as_chunks::<5>().0 {
        assert_eq!(*message, [0xFF, 0x11, 32, 0x11, 32]);
    }
}

/// One command to all engines: they start one after the other. One of two is lost: the other is informed, and left alone
/// or reduced; its timing is not affected.
#[test]
fn a_lost_engine_reduces_the_other_of_its_group() {
    for (option, expected) in [(None, 600), (Some(500), 300)] {
        clock::reset();
        let (mut left, left_ecu) = amt(2400);
        let (mut right, right_ecu) = zk();
        (left.port, right.port) = (0, 1);
        right.supervision.when_other_fails = option;
        let (rx_left, tx_left, plug_left) = wire(&left, left_ecu, 1);
        let (rx_right, tx_right, plug_right) = wire(&right, right_ecu, 2);
        let node = Node::new(&[left, right], None).expect("a good table");
        let world = live_two(&node, (rx_left, tx_left, &plug_left), (rx_right, tx_right, &plug_right));
        let scenario = async {
            let [l, r] = node.owners();
            let all = |command| node.owners().map(|owner| command_as(&owner, command, Origin::Rc));
            let say = |command| {
                let _ = all(command);
            };
            assert_eq!(all(Command::Arm), [Ok(Accepted::InForce); 2]);
            let both = |phase| in_phase(&l, phase) && in_phase(&r, phase);
            while !both(Phase::Standby) {
                say(Command::Standby);
                Timer::after(Duration::from_millis(100)).await;
            }
            for _ in 0..15 {
                say(Command::Standby);
                Timer::after(Duration::from_millis(100)).await;
            }
            let began = Instant::now();
            let waits = Ok(Accepted::StartWaits);
            assert_eq!(all(throttle_percent(0)), [Ok(Accepted::InForce), waits]);
            let mut second = None;
            while !both(Phase::Running) {
                let answers = all(throttle_percent(0));
                if second.is_none() && answers[1] != waits {
                    assert_eq!(answers[1], Ok(Accepted::InForce));
                    assert!(in_phase(&l, Phase::Running), "one at a time");
                    second = Some(began.elapsed());
                }
                Timer::after(Duration::from_millis(100)).await;
            }
            assert!(second.is_some_and(|after| after >= Duration::from_secs(10)), "the gap");
            for _ in 0..100 {
                say(throttle_percent(60));
                Timer::after(Duration::from_millis(100)).await;
            }
            assert_eq!(r.handle().telemetry().report.throttle.expect("reported").value.tenths(), 600);
            // The left one is lost.
            let mut of_left = l.handle().events().expect("a free place");
            let mut events = r.handle().events().expect("a free place");
            let before = r.handle().telemetry().counters;
            plug_left.ecu(|ecu| ecu.turbine_mut().flame_out());
            for _ in 0..100 {
                say(throttle_percent(60));
                Timer::after(Duration::from_millis(100)).await;
            }
            let events = received(&mut events);
            let (l, r) = (l.handle().telemetry(), r.handle().telemetry());
            // Its ECU reports only its error; the exhaust shows that the engine is out, and its source does not start it
            // again.
            let of_left = received(&mut of_left);
            assert!(of_left.contains(&Event::RunCancelled(End::NotBurning)), "{of_left:?}");
            assert_eq!((l.failed, l.ordered.order), (true, Order::Standby));
            assert!(events.contains(&Event::OtherFailed(1)), "{events:?}");
            assert_eq!(r.state, EngineState::Running);
            assert_eq!(r.report.throttle.expect("reported").value.tenths(), expected, "{option:?}");
            // 20 slots a second, none missed, each on its beat.
            let counters = r.counters;
            assert_eq!((counters.send_slots_missed, counters.write_timeouts), (before.send_slots_missed, 0));
            assert!(counters.sent - before.sent >= 199);
            assert_eq!(l.counters.replies_missed, 0);
        };
        match clock::run_for(select(world, scenario), LONG) {
            Some(Either::Second(())) => {}
            _ => panic!("the scenario did not end"),
        }
    }
}

/// An emergency stop gets through: with listeners that read nothing, a source that floods, another that hangs in the
/// middle of its stream, and the transmitter of the other engine stuck.
#[test]
fn an_emergency_stop_gets_through() {
    for flooded in [false, true] {
        clock::reset();
        let (mut left, left_ecu) = amt(2400);
        let (mut right, right_ecu) = zk();
        (left.port, right.port) = (0, 1);
        let (rx_left, tx_left, plug_left) = wire(&left, left_ecu, 1);
        let (rx_right, tx_right, plug_right) = wire(&right, right_ecu, 2);
        let node = Node::new(&[left, right], None).expect("a good table");
        let world = live_two(&node, (rx_left, tx_left, &plug_left), (rx_right, tx_right, &plug_right));
        let [l, r] = node.owners();
        let deaf: Vec<_> =
            (0..LISTENERS).map(|_| (l.handle().events(), l.handle().telemetry_receiver())).collect();
        assert!(deaf.iter().all(|(events, telemetry)| events.is_some() && telemetry.is_some()));
        let stopped = Cell::new(None);
        let flood = async {
            loop {
                // Bad commands as well as good ones.
                for command in
                    [throttle_percent(60), Command::HandOverToPwm, Command::Disarm, throttle_percent(61)]
                {
                    let _ = command_as(&l, command, Origin::Rc);
                }
                Timer::after(if flooded { Duration::from_micros(200) } else { Duration::from_millis(100) })
                    .await;
            }
        };
        let scenario = async {
            start(&l).await;
            // The emergency input takes over, and hangs.
            for _ in 0..30 {
                let _ = command_as(&l, throttle_percent(20), Origin::Emergency);
                Timer::after(Duration::from_millis(100)).await;
            }
            plug_right.stall_tx(true);
            plug_left.record(true);
            let ends = Instant::now() + Duration::from_secs(5);
            let pulling = async {
                Timer::after(Duration::from_millis(2_013)).await;
                assert_eq!(command_as(&l, Command::EmergencyStop, Origin::Mavlink), Ok(Accepted::InForce));
                stopped.set(Some(clock::now_ns()));
                Timer::at(ends).await;
            };
            select(flood, pulling).await;
            assert!(r.handle().telemetry().counters.write_timeouts > 10, "the other one is stuck");
            let counters = l.handle().telemetry().counters;
            assert_eq!((counters.replies_missed, counters.replies_late), (0, 0));
            assert!(!flooded || counters.commands_rejected > 10_000);
        };
        clock::run_for(select(world, scenario), LONG).expect("it ends");
        let stopped = stopped.get().expect("it was commanded");
        let (mut before, mut after) = (Vec::new(), Vec::new());
        let log = plug_left.take_log();
        let sent: Vec<_> = log.iter().filter(|entry| entry.direction == Direction::ToEcu).collect();
        for message in sent.as_chunks::<5>().0 {
            let list = if message[0].start < stopped { &mut before } else { &mut after };
            list.push((message[0].start, message[1].byte));
        }
        assert!(before.len() >= 10 && before.iter().all(|(_, ops)| *ops == 0x14), "{before:?}");
        assert!(after.len() >= 20 && after.iter().all(|(_, ops)| *ops == 0x11), "{after:?}");
        // In the reply to the very next frame.
        assert!(after[0].0 - stopped <= 125_100_000, "{} ns", after[0].0 - stopped);
    }
}

/// The failure of an engine is still known after a reset: the others of its group are informed again.
#[test]
fn a_failure_is_reported_again_after_a_reset() {
    for failed in [false, true] {
        clock::reset();
        let (left, left_ecu) = amt(2400);
        let (mut right, right_ecu) = zk();
        right.port = 1;
        let memory: &'static [RetainedMemory] = Box::leak(Box::new([const { RetainedMemory::new() }; 2]));
        let record = RetainedState::new(Order::Standby, Origin::Node).with(|state| state.failed = failed);
        memory[0].store(&record, left.fingerprint());
        let (rx_left, tx_left, plug_left) = wire(&left, left_ecu, 1);
        let (rx_right, tx_right, plug_right) = wire(&right, right_ecu, 2);
        let node = Node::new(&[left, right], Some((memory, Reset::Warm))).expect("a good table");
        let world = live_two(&node, (rx_left, tx_left, &plug_left), (rx_right, tx_right, &plug_right));
        let [l, r] = node.owners();
        let scenario = async {
            Timer::after(Duration::from_secs(3)).await;
            assert_eq!(
                (l.handle().telemetry().failed, r.handle().telemetry().others_failed),
                (failed, u8::from(failed))
            );
            // Until it is commanded to standby.
            command_as(&l, Command::Standby, Origin::Rc).expect("no other source holds it");
            Timer::after(Duration::from_secs(1)).await;
            assert_eq!((l.handle().telemetry().failed, r.handle().telemetry().others_failed), (false, 0));
        };
        clock::run_for(select(world, scenario), LONG).expect("it ends");
    }
}

/// A transmitter that hangs: before a frame in the driver is 0.2 s old, the runner gives the port back to be reopened, so that it is not
/// sent, and the engine continues at its demand. One that hangs for less is left alone.
#[test]
fn a_stuck_transmitter_is_given_back_to_be_reopened() {
    for (pause, reopened) in [(100, false), (300, true), (900, true), (3000, true)] {
        let pause = Duration::from_millis(pause);
        clock::reset();
        let (config, ecu) = zk();
        let (rx, tx, plug) = wire(&config, ecu, 1);
        plug.record(true);
        let node = Node::<1>::new(&[config], None).expect("a good table");
        let [runner] = node.runners();
        let [owner] = node.owners();
        let (opened, hung_at) = (Cell::new(0), Cell::new(0));
        let port = async {
            let mut halves = (rx, tx);
            loop {
                runner.run_until_stuck(halves.0, halves.1, &ERRORS).await;
                let after = clock::now_ns() - hung_at.get();
                // A frame is due every 50 ms.
                assert!((190 * MILLIS..=250 * MILLIS).contains(&after), "after {after} ns");
                opened.set(opened.get() + 1);
                let stuck = opened.get() == 1;
                halves = plug.reset_node();
                assert!(stuck, "it works again");
            }
        };
        let pilot = async {
            start(&owner).await;
            fly_for(&owner, throttle_percent(60), Duration::from_secs(5)).await;
            plug.stall_tx(true);
            hung_at.set(clock::now_ns());
            // Commands given meanwhile are old when the transmitter continues.
            fly_for(&owner, throttle_percent(80), pause).await;
            plug.take_log();
            if !reopened {
                plug.stall_tx(false);
            }
            fly_for(&owner, throttle_percent(40), Duration::from_secs(3)).await;
            assert_eq!(
                owner.handle().telemetry().ordered.order,
                Order::Run(Demand::Throttle(Throttle::from_percent(40).unwrap()))
            );
            assert!(!owner.handle().telemetry().transmitter_failed);
        };
        let all = select(join(plug.run(), port), pilot);
        clock::run(all);
        assert_eq!(opened.get(), usize::from(reopened), "{pause:?}");
    }
}
