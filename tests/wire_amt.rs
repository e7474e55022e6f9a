//! The runner and an AMT link against a simulated AMT ECU over the wire. The ECU itself measures the reply
//! window and is the judge: `in_window`, `late`, `none` and `unsolicited` are its counts, not ours.
#![allow(clippy::disallowed_methods, reason = "a scenario keeps its own time")]

use bench::rows::simulated_as;
use bench::wired::{Bench, LONG, control_frames, received, throttle_percent};
use embassy_futures::join::join;
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Timer};
use jetlink::command::{Command, Order, Ordered, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::ecu::{Faults, Service, amt};
use jetlink::event::Event;
use jetlink::line::Line;
use jetlink::report::{LinkState, NotSent, Phase};
use sim::amt::{AmtEcu, Ops, Stats, error};
use sim::any::Protocol;
use sim::control;
use sim::wire::{Babble, Direction, Entry, Faults as Noise, FramingAs};

fn bench(baud: u32, seed: u64) -> Bench<AmtEcu> {
    let config = EngineConfig::amt("amt", 0, Line::new(baud), None);
    Bench::new(&config, AmtEcu::new(simulated_as(&config)), seed)
}

fn stats(bench: &Bench<AmtEcu>) -> Stats {
    bench.plug.ecu(|ecu| ecu.stats)
}

/// The messages that the node put on the wire.
fn messages(record: &[Entry]) -> Vec<(u64, sim::amt::AmtCommand)> {
    let amt = |(at, command)| {
        let control::Command::Amt(message) = command else { unreachable!("read as AMT") };
        (at, message)
    };
    control_frames(Protocol::Amt, record).into_iter().map(amt).collect()
}

/// AMT-11: one reply to every frame, in its window, at every baud rate; the ECU's own measure of the margin.
#[test]
fn amt_11_every_frame_is_answered_in_its_window_at_every_baud_rate() {
    for baud in Line::BAUD_RATES {
        let bench = bench(baud, 1);
        bench.play(LONG, async {
            bench.start().await;
            bench.command_for(throttle_percent(60), Duration::from_secs(20)).await;
            bench.command_for(Command::Standby, Duration::from_secs(20)).await;
        });
        let stats = stats(&bench);
        // The last frame and its reply may still be in transmission.
        assert!(stats.frames.total() >= 400, "{baud}: {stats:?}");
        assert!(stats.frames.total() - stats.in_window <= 1, "{baud}: {stats:?}");
        assert_eq!((stats.late, stats.none, stats.unsolicited, stats.bad.total()), (0, 0, 0, 0), "{baud}");
        // The window is 30 ms. Five bytes take 50 bits; the node may waste no more than 2 ticks of 1 µs.
        let best = 30_000_000 - 50 * 1_000_000_000 / u64::from(baud);
        let margin = stats.worst_margin.expect("replies were measured");
        assert!(best - margin <= 2_000, "{baud}: margin {margin} ns of {best} ns");
        let counters = bench.handle().telemetry().counters;
        assert_eq!(
            (counters.replies_missed, counters.replies_late, counters.write_timeouts),
            (0, 0, 0),
            "{baud}"
        );
    }
}

/// AMT-11: a node that starts later than its port opened, at each phase of the ECU's frames: bytes that have waited have an
/// unknown age, so they are not answered. Later frames are.
#[test]
fn amt_11_a_frame_that_waited_in_the_port_is_not_answered_late() {
    let mut unanswered = 0;
    // Its first frame comes after 0.4 s.
    for start in (300..900).step_by(7) {
        let bench = bench(2400, 1);
        let live = async {
            let before = select(bench.plug.run(), Timer::after(Duration::from_millis(start))).await;
            assert!(matches!(before, Either::Second(())));
            bench.live().await
        };
        let end = Timer::after(Duration::from_millis(start + 2000));
        assert!(matches!(sim::clock::run_for(select(live, end), LONG), Some(Either::Second(()))));
        let stats = stats(&bench);
        assert_eq!((stats.late, stats.unsolicited, stats.bad.total()), (0, 0, 0), "{start} ms: {stats:?}");
        // Each frame from then on, except one in transmission, and the first two, which have to be
        // consistent.
        assert!(stats.in_window >= 12, "{start} ms: {stats:?}");
        unanswered = unanswered.max(stats.none);
    }
    assert!(unanswered >= 2, "{unanswered}");
}

/// AMT-11: all four kinds of frame are answered, the set-up set after power-up too.
#[test]
fn amt_11_each_kind_of_frame_is_answered() {
    let bench = bench(2400, 2);
    bench.play(LONG, async {
        Timer::after(Duration::from_secs(5)).await;
        bench.plug.ecu(|ecu| ecu.set_errors(error::SUPPLY_LOW | error::EGT));
        Timer::after(Duration::from_secs(5)).await;
    });
    let stats = stats(&bench);
    assert_eq!(stats.frames.setup, 1);
    assert!(stats.frames.normal > 20 && stats.frames.error > 20 && stats.frames.alternate > 3, "{stats:?}");
    assert!(stats.frames.total() - stats.in_window <= 1, "{stats:?}");
    assert_eq!((stats.late, stats.none, stats.unsolicited), (0, 0, 0));
}

/// A frame of an unknown kind is answered like every other, and its bytes are kept (AMT-2).
#[test]
fn amt_2_a_frame_of_unknown_kind_is_answered() {
    let bench = bench(2400, 3);
    bench.plug.record(true);
    bench.play(LONG, async {
        bench.until(|bench| bench.handle().telemetry().link == LinkState::Up).await;
        // Between two frames of the ECU's own, which come every 125 ms.
        let frames = stats(&bench).frames.total();
        bench.until(|bench| stats(bench).frames.total() > frames).await;
        Timer::after(Duration::from_millis(60)).await;
        bench.plug.take_log();
        bench.plug.inject_to_node(&[0xFF, 0b0110_1011, 1, 2, 3, 4]);
        Timer::after(Duration::from_millis(50)).await;
    });
    assert_eq!(messages(&bench.plug.log()).len(), 1);
    let telemetry = bench.handle().telemetry();
    let unknown = telemetry.report.unknown.expect("kept").value;
    assert_eq!(unknown.as_bytes(), [0xFF, 0b0110_1011, 1, 2, 3, 4]);
    assert_eq!(telemetry.counters.unknown_frames, 1);
}

/// AMT-11: nothing is sent without a frame to answer. The control for it: a frame, and a reply.
#[test]
fn amt_11_a_silent_ecu_is_sent_nothing() {
    let bench = bench(2400, 4);
    bench.plug.power(false);
    bench.plug.record(true);
    bench.play(LONG, async {
        bench.command_for(Command::Standby, Duration::from_secs(10)).await;
        bench.command_for(Command::EmergencyStop, Duration::from_secs(10)).await;
        assert_eq!(bench.plug.log().len(), 0, "bytes to an ECU that sent nothing");
        bench.plug.power(true);
        Timer::after(Duration::from_secs(2)).await;
    });
    let messages = messages(&bench.plug.log());
    assert!(!messages.is_empty());
    assert!(messages.iter().all(|(_, message)| message.ops == Ops::EmergencyStop));
}

/// AMT-14, and the whole sequence: standby, start, throttle, standby. The values in telemetry are the
/// turbine's.
#[test]
fn amt_14_the_start_throttle_is_sent_until_full_operation() {
    let bench = bench(2400, 5);
    bench.plug.record(true);
    bench.play(LONG, async {
        bench.start().await;
        let running_from = sim::clock::now_ns();
        // AMT-14: until full operation the start throttle went out, which is 0 %.
        let sent = messages(&bench.plug.log());
        assert!(sent.iter().any(|(_, message)| message.ops == Ops::Run));
        assert!(sent.iter().all(|(_, message)| message.throttle_half_percent == 0));

        bench.command_for(throttle_percent(50), Duration::from_secs(15)).await;
        let report = bench.handle().telemetry().report;
        let rpm = bench.plug.ecu(|ecu| ecu.turbine().rpm());
        let shown = report.rpm.expect("an Olympus has a scale").value.get();
        assert!((f64::from(shown) - rpm).abs() <= 500.0, "{shown} shown, {rpm} true");
        assert_eq!(report.throttle.expect("reported").value.tenths(), 500);
        assert_eq!(report.amt_engine.expect("reported by the set-up set").value, EngineModel::Olympus);
        let after: Vec<_> = messages(&bench.plug.log())
            .into_iter()
            .filter(|(at, _)| *at > running_from + 200_000_000)
            .collect();
        assert!(after.len() > 100);
        assert!(after.iter().all(|(_, m)| m.ops == Ops::Run && m.throttle_half_percent == 100));

        bench.command_until(Command::Standby, |bench| bench.plug.ecu(|ecu| ecu.turbine().rpm() < 1.0)).await;
    });
    assert!(!bench.in_phase(Phase::Running));
    assert_eq!(stats(&bench).serial_delay_stops, 0);
}

/// AMT-12: an ECU that receives nothing stops the engine. The node reports that the link is lost, cancels the
/// order to run, and a source that keeps sending `Run` does not start the engine again.
#[test]
fn amt_12_a_cut_line_stops_the_engine_and_nobody_restarts_it() {
    let bench = bench(2400, 6);
    let mut events = bench.handle().events().expect("a free place");
    bench.play(LONG, async {
        bench.start().await;
        bench.command_for(throttle_percent(30), Duration::from_secs(5)).await;
        received(&mut events);

        bench.plug.cut(true);
        // The last frame came up to two periods of 125 ms before the cut.
        bench.command_for(throttle_percent(30), Duration::from_millis(700)).await;
        assert_eq!(bench.handle().telemetry().link, LinkState::Up);
        bench.command_for(throttle_percent(30), Duration::from_secs(9)).await;
        assert_eq!(bench.handle().telemetry().link, LinkState::Lost);
        assert_eq!(received(&mut events).iter().filter(|event| **event == Event::LinkLost).count(), 1);
        assert_eq!(stats(&bench).serial_delay_stops, 1);

        bench.plug.cut(false);
        bench.command_for(throttle_percent(30), Duration::from_secs(60)).await;
        let events = received(&mut events);
        let standby = Event::Ordered(Ordered { order: Order::Standby, origin: Origin::Node });
        assert!(events.contains(&Event::LinkUp) && events.contains(&standby), "{events:?}");
        assert!(events.contains(&Event::CommandRejected(Rejected::StandbyFirst, Origin::Bench)));
        assert!(!bench.in_phase(Phase::Running) && !bench.in_phase(Phase::Starting));

        // The control: standby first, and it starts.
        bench.start().await;
    });
}

/// The demand never goes out after its source has fallen silent for longer than it is held.
#[test]
fn a_silent_source_brings_the_throttle_to_idle_on_the_wire() {
    let bench = bench(2400, 7);
    bench.plug.record(true);
    bench.play(LONG, async {
        bench.start().await;
        bench.command_for(throttle_percent(80), Duration::from_secs(10)).await;
        let last = bench.handle().telemetry().source_last_rx.expect("it commands");
        let silent_from = last.as_micros() * 1000;
        Timer::after(Duration::from_millis(100)).await;
        bench.plug.take_log();
        Timer::after(Duration::from_secs(5)).await;
        let messages = messages(&bench.plug.log());
        // The timeout of 0.5 s, held for 1 s, then to idle at 50 % a second; never a stop.
        for (at, message) in messages {
            let ms = (at - silent_from) / 1_000_000;
            let lowered = ms.saturating_sub(1_500) / 20;
            let half_percent = 160_u64.saturating_sub(lowered * 2);
            let shown = u64::from(message.throttle_half_percent);
            assert!(shown.abs_diff(half_percent) <= 2, "{shown} for {half_percent} at {ms} ms");
            assert_eq!(message.ops, Ops::Run);
        }
        assert!(bench.in_phase(Phase::Running));
    });
}

/// An emergency stop is in the very next reply, stays, and is released only with the engine stopped.
#[test]
fn an_emergency_stop_is_in_the_next_reply_and_stays() {
    let bench = bench(2400, 8);
    bench.plug.record(true);
    bench.play(LONG, async {
        bench.start().await;
        bench.plug.take_log();
        let stop_at = sim::clock::now_ns();
        bench.command(Command::EmergencyStop, Origin::Emergency).expect("never refused");
        for _ in 0..20 {
            assert_eq!(bench.command(throttle_percent(50), Origin::Bench), Err(Rejected::StopLatched));
            assert_eq!(bench.command(Command::Standby, Origin::Bench), Err(Rejected::StopLatched));
            Timer::after(Duration::from_millis(100)).await;
        }
        let after: Vec<_> =
            messages(&bench.plug.log()).into_iter().filter(|(at, _)| *at >= stop_at).collect();
        assert!(after[0].0 - stop_at < 200_000_000, "the next frame comes within 125 ms");
        assert!(after.iter().all(|(_, message)| message.ops == Ops::EmergencyStop));

        let not_yours = Err(Rejected::NotYours(Origin::Emergency));
        assert_eq!(bench.command(Command::ReleaseStop, Origin::Bench), not_yours);
        bench.until(|bench| bench.command(Command::ReleaseStop, Origin::Emergency).is_ok()).await;
        assert!(!bench.plug.ecu(|ecu| ecu.turbine().phase().is_live()));
        bench.start().await;
    });
}

/// AMT-13: CTF is sent only when commanded by name, and the ECU then stops the engine after its serial delay.
#[test]
fn amt_13_ctf_goes_out_only_by_its_name() {
    let bench = bench(2400, 9);
    bench.plug.record(true);
    bench.play(LONG, async {
        bench.start().await;
        assert!(messages(&bench.plug.log()).iter().all(|(_, message)| message.ops != Ops::Ctf));
        let ctf = Command::Service(Service::Amt(amt::config::Service::Ctf));
        bench.command(ctf, Origin::Bench).expect("an AMT ECU has it");
        Timer::after(Duration::from_secs(4)).await;
        assert_eq!(stats(&bench).ctf_stops, 1);
    });
}

/// Bytes without end and without a frame: no reply, the link is lost by the timer, and the link recovers.
#[test]
fn a_babbling_ecu_does_not_hide_the_loss_of_the_link() {
    let bench = bench(115_200, 10);
    let mut events = bench.handle().events().expect("a free place");
    bench.play(LONG, async {
        bench.until(|bench| bench.handle().telemetry().link == LinkState::Up).await;
        bench.plug.record(true);
        // No leader in it, so no frame.
        bench.plug.babble(Some(Babble::Repeat(vec![0x55, 0x10, 0x00])));
        Timer::after(Duration::from_millis(1200)).await;
        assert_eq!(bench.handle().telemetry().link, LinkState::Lost);
        Timer::after(Duration::from_secs(3)).await;
        let log = bench.plug.take_log();
        assert!(log.iter().filter(|entry| entry.direction == Direction::ToNode).count() > 30_000);
        // At most the reply to a frame that was complete when the babble began.
        assert!(messages(&log).len() <= 1);
        bench.plug.babble(None);
        Timer::after(Duration::from_secs(2)).await;
        assert_eq!(bench.handle().telemetry().link, LinkState::Up);
    });
    let lost = received(&mut events).iter().filter(|event| **event == Event::LinkLost).count();
    assert_eq!(lost, 1);
}

/// A transmitter that hangs costs replies, which are counted; reception continues undisturbed.
#[test]
fn a_hanging_transmitter_does_not_stall_reception() {
    let bench = bench(2400, 11);
    let mut events = bench.handle().events().expect("a free place");
    bench.play(LONG, async {
        bench.until(|bench| bench.handle().telemetry().link == LinkState::Up).await;
        let before = bench.handle().telemetry().counters;
        bench.plug.stall_tx(true);
        for _ in 0..50 {
            Timer::after(Duration::from_millis(100)).await;
            let telemetry = bench.handle().telemetry();
            let age = telemetry.last_rx.expect("received").elapsed();
            assert!(age <= Duration::from_millis(150), "the last frame is {} ms old", age.as_millis());
        }
        let counters = bench.handle().telemetry().counters;
        assert!(counters.write_timeouts - before.write_timeouts >= 30, "{counters:?}");
        assert_eq!(counters.sent, before.sent);
        assert!(received(&mut events).contains(&Event::NotSent(NotSent::TimedOut)));

        // The transmitter works again: at most the bytes stuck in the UART are sent late, and from then on
        // every frame is answered.
        bench.plug.stall_tx(false);
        Timer::after(Duration::from_secs(1)).await;
        let healed = stats(&bench);
        Timer::after(Duration::from_secs(5)).await;
        let after = stats(&bench);
        assert!(after.in_window - healed.in_window >= 38, "{healed:?} {after:?}");
        assert_eq!(after.late, healed.late);
        assert_eq!(after.unsolicited, healed.unsolicited);
    });
}

/// AMT-11: a reply that waits for bytes stuck in the transmitter is sent in its window or not at all. The transmitter works again
/// at any time between two frames.
#[test]
fn amt_11_a_reply_after_a_transmitter_that_hung_does_not_go_out_after_its_window() {
    let mut too_late = 0;
    for offset in (0..125).step_by(5) {
        let bench = bench(2400, 13);
        let mut events = bench.handle().events().expect("a free place");
        bench.play(LONG, async {
            bench.until(|bench| bench.handle().telemetry().link == LinkState::Up).await;
            bench.plug.stall_tx(true);
            Timer::after(Duration::from_millis(1000 + offset)).await;
            let (before, _) = (stats(&bench), received(&mut events));
            bench.plug.stall_tx(false);
            Timer::after(Duration::from_secs(2)).await;
            let after = stats(&bench);
            // The stuck bytes are sent whenever that is.
            let outside = after.late + after.unsolicited - before.late - before.unsolicited;
            assert!(outside <= 1, "{offset} ms: {before:?} {after:?}");
            assert!(after.in_window - before.in_window >= 13, "{offset} ms: {before:?} {after:?}");
        });
        too_late += usize::from(received(&mut events).contains(&Event::NotSent(NotSent::TooLate)));
    }
    assert!(too_late > 0, "no reply was withheld");
}

/// Errors that reading returns are counted and survived.
#[test]
fn read_errors_are_counted_and_survived() {
    let bench = bench(2400, 12);
    bench.plug.framing(FramingAs::Error);
    bench.plug.set_faults(Noise { framing_per_million: 20_000, ..Noise::default() }, Noise::default());
    bench.play(LONG, async {
        Timer::after(Duration::from_secs(60)).await;
        let counters = bench.handle().telemetry().counters;
        assert!(counters.framing_errors + counters.read_errors >= 30, "{counters:?}");
        assert!(counters.truncated > 10 && counters.frames > 350, "{counters:?}");
        bench.plug.set_faults(Noise::default(), Noise::default());
        Timer::after(Duration::from_secs(2)).await;
        let clean = bench.handle().telemetry().counters;
        Timer::after(Duration::from_secs(10)).await;
        let later = bench.handle().telemetry().counters;
        assert_eq!(later.truncated, clean.truncated);
        assert!(later.frames - clean.frames >= 79);
    });
}

/// AMT-1 and AMT-10 under noise both ways: every message on the wire was commanded, the engine recovers when
/// the noise stops, and the ECU has to refuse a damaged reply.
#[test]
fn amt_10_noise_never_causes_an_unsolicited_command() {
    for seed in 0..8 {
        let bench = bench(2400, seed);
        bench.plug.record(true);
        let noise = Noise {
            flip_per_million: 2_000,
            lose_per_million: 10_000,
            add_per_million: 10_000,
            framing_per_million: 10_000,
            delay_ns: 0,
            jitter_ns: 2_000_000,
        };
        bench.play(LONG, async {
            bench.start().await;
            bench.command_for(throttle_percent(40), Duration::from_secs(5)).await;
            bench.plug.take_log();
            bench.plug.set_faults(noise, noise);
            bench.command_for(throttle_percent(40), Duration::from_secs(60)).await;
            let log = bench.plug.take_log();
            for (_, message) in messages(&log) {
                // A healthy engine continues at the commanded demand.
                let expected = (Ops::Run, 80);
                assert_eq!((message.ops, message.throttle_half_percent), expected, "seed {seed}");
            }
            assert!(bench.plug.ecu(|ecu| ecu.turbine().phase().is_live()), "seed {seed}");
            bench.plug.set_faults(Noise::default(), Noise::default());
            Timer::after(Duration::from_secs(2)).await;
            let (node, ecu) = (bench.handle().telemetry(), stats(&bench));
            assert_eq!(node.link, LinkState::Up, "seed {seed}");
            Timer::after(Duration::from_secs(20)).await;
            let (node_after, ecu_after) = (bench.handle().telemetry(), stats(&bench));
            assert_eq!(node_after.counters.truncated, node.counters.truncated);
            assert_eq!(ecu_after.none, ecu.none);
            assert!(ecu_after.in_window - ecu.in_window >= 158);
        });
    }
}

/// A node that receives its own bytes (half-duplex wiring) does not answer itself.
#[test]
fn an_echo_is_not_answered() {
    let bench = bench(2400, 13);
    bench.plug.echo(true);
    bench.plug.record(true);
    bench.play(LONG, async { Timer::after(Duration::from_secs(30)).await });
    let frames = stats(&bench).frames.total();
    let replies = messages(&bench.plug.log()).len() as u64;
    assert!(frames > 200 && replies <= frames, "{replies} replies to {frames} frames");
}

/// AMT-9: an ECU that restarts reports it by its set-up set.
#[test]
fn amt_9_a_restart_of_the_ecu_is_an_event() {
    let bench = bench(2400, 14);
    let mut events = bench.handle().events().expect("a free place");
    bench.play(LONG, async {
        Timer::after(Duration::from_secs(3)).await;
        let first = received(&mut events);
        assert_eq!(first.iter().filter(|event| **event == Event::EcuStarted).count(), 1);
        bench.plug.power(false);
        Timer::after(Duration::from_millis(300)).await;
        bench.plug.power(true);
        Timer::after(Duration::from_secs(3)).await;
        let second = received(&mut events);
        assert_eq!(second.iter().filter(|event| **event == Event::EcuStarted).count(), 1);
    });
}

/// AMT-8: errors are reported, several at once, and reported again when they are gone.
#[test]
fn amt_8_errors_are_reported_and_cleared() {
    let bench = bench(2400, 15);
    let mut events = bench.handle().events().expect("a free place");
    bench.play(LONG, async {
        Timer::after(Duration::from_secs(2)).await;
        bench.plug.ecu(|ecu| ecu.set_errors(error::EGT | error::SUPPLY_LOW));
        Timer::after(Duration::from_secs(2)).await;
        bench.plug.ecu(|ecu| ecu.set_errors(0));
        Timer::after(Duration::from_secs(2)).await;
    });
    let faults: Vec<_> = received(&mut events)
        .into_iter()
        .filter_map(|event| match event {
            Event::Faults(Faults::Amt(bits)) => Some(bits.0),
            _ => None,
        })
        .collect();
    assert_eq!(faults, [0b0010_1000, 0]);
}

/// A fault of one engine never affects another's timing.
#[test]
fn a_babbling_neighbour_costs_no_reply() {
    let good = bench(2400, 16);
    let bad = bench(115_200, 17);
    let scenario = async {
        good.until(|bench| bench.handle().telemetry().link == LinkState::Up).await;
        bad.plug.babble(Some(Babble::Random));
        bad.plug.stall_tx(true);
        Timer::after(Duration::from_secs(30)).await;
    };
    let world = embassy_futures::select::select(join(good.live(), bad.live()), scenario);
    sim::clock::run_for(world, LONG).expect("the scenario ends");
    let stats = stats(&good);
    assert!(stats.frames.total() > 230);
    assert!(stats.frames.total() - stats.in_window <= 1, "{stats:?}");
    assert_eq!((stats.late, stats.none, stats.unsolicited), (0, 0, 0));
    assert!(bad.handle().telemetry().counters.bytes_skipped > 100_000);
}
