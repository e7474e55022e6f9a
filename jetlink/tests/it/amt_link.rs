//! The conversation with an AMT ECU as tables of time, input and output. Times are in microseconds; the time of
//! a frame is that of its last stop bit.

use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::{Engine, ErrorBits};
use jetlink::ecu::amt::config::{Config, REPLY_WINDOW, Service as AmtService};
use jetlink::ecu::amt::link::AmtLink;
use jetlink::ecu::zk::config::Service as ZkService;
use jetlink::ecu::{EcuConfig, Faults, Service, zk};
use jetlink::engine::retained::RetainedState;
use jetlink::event::Event;
use jetlink::line::{Line, LineError, Timing};
use jetlink::link::{Link, Output, Sign, Stage};
use jetlink::report::{LinkState, NotSent, Phase, ReportedSwitch};
use jetlink::units::{Celsius, Rpm, Throttle};
use proptest::prelude::*;

use crate::support::bench::{Bench, Machine, micros, us};
use crate::support::frames::amt::{
    AUTO_STOP, CLEARANCE, EMERGENCY, FULL_OPERATION, IDLE_CALIBRATION, NO_CLEARANCE, RUN, STARTED_UP,
    STARTING, alternate, control, error, normal, setup,
};

const STOP_OPS: u8 = 0x11;
const AUTO_OPS: u8 = 0x12;
const RUN_OPS: u8 = 0x14;
const CTF_OPS: u8 = 0x91;
/// Between two frames: 8 a second at 2400 baud.
const EVERY: u64 = 125_000;
const SLOW: Line = Line::new(2400);

/// Standby is ordered.
fn amt(config: Config, line: Line) -> Bench<AmtLink> {
    let mut bench = Bench::new(AmtLink::new(config, line, Config::TIMING), line);
    bench.order(0, Order::Standby).unwrap();
    bench
}

fn default() -> Bench<AmtLink> {
    amt(Config::DEFAULT, SLOW)
}

fn throttle(tenths: u16) -> Order {
    Order::Run(Demand::Throttle(Throttle::from_tenths(tenths).unwrap()))
}

fn ctf() -> Service {
    Service::Amt(AmtService::Ctf)
}

/// A frame now, and the bytes of its reply.
fn reply_to<M: Machine>(bench: &mut Bench<M>, frame: &[u8]) -> Vec<u8> {
    answer_to(bench, frame).unwrap_or_else(|| panic!("a reply at {}", bench.now()))
}

/// A frame now, and the bytes of its reply, if there is one.
fn answer_to<M: Machine>(bench: &mut Bench<M>, frame: &[u8]) -> Option<Vec<u8>> {
    let t = bench.now() + EVERY;
    bench.run_to(t);
    bench.frames();
    bench.receive(frame);
    let mut frames = bench.frames();
    assert!(frames.len() <= 1, "one reply at {t}: {frames:02x?}");
    let (at, bytes) = frames.pop()?;
    assert_eq!(at, t, "at once");
    Some(bytes)
}

/// The OPS and THR (in half percents) of the reply to a frame.
fn ops_thr<M: Machine>(bench: &mut Bench<M>, frame: &[u8]) -> (u8, u8) {
    read_control(&reply_to(bench, frame))
}

/// The same, if there is a reply.
fn answer<M: Machine>(bench: &mut Bench<M>, frame: &[u8]) -> Option<(u8, u8)> {
    answer_to(bench, frame).map(|bytes| read_control(&bytes))
}

fn read_control(bytes: &[u8]) -> (u8, u8) {
    let (ops, half_percents) = (bytes[1], bytes[2] - 32);
    assert_eq!(bytes, control(ops, half_percents));
    (ops, half_percents)
}

/// The demand is released, and the phase is known.
fn running() -> Bench<AmtLink> {
    let mut bench = default();
    bench.order(0, throttle(800)).unwrap();
    for _ in 0..2 {
        reply_to(&mut bench, &normal(FULL_OPERATION, RUN, 100));
    }
    bench.act(|link, _| link.release(true));
    bench.event_kinds();
    bench
}

/// The same frame with a hot exhaust: 140 × 4.6 − 50 = 594 °C (AMT-7).
fn hot<const N: usize>(mut frame: [u8; N]) -> [u8; N] {
    frame[3] = 140;
    frame
}

/// The supervision on top of the link, after a reset with what was retained.
fn engine_after(config: Config, record: Option<RetainedState>) -> Bench<jetlink::engine::Engine> {
    let mut engine = EngineConfig::amt("a", 0, SLOW, Some(Engine::Olympus));
    engine.ecu = EcuConfig::Amt(config);
    let mut bench = Bench::new(jetlink::engine::Engine::new(&engine), SLOW);
    if record.is_some() {
        bench.machine = jetlink::engine::Engine::new(&engine);
        bench.act(|machine, now| machine.start(now, record));
    }
    bench
}

fn command(bench: &mut Bench<jetlink::engine::Engine>, command: Command) -> Result<Accepted, Rejected> {
    bench.act(|engine, now| engine.command(now, command, Origin::Rc, true))
}

fn run_at(tenths: u16) -> Command {
    Command::Run(Demand::Throttle(Throttle::from_tenths(tenths).unwrap()))
}

/// Ordered to start by a person who asked for this throttle right behind it.
fn started(config: Config, tenths: u16) -> Bench<jetlink::engine::Engine> {
    let mut bench = engine_after(config, Some(RetainedState::new(Order::Standby, Origin::Rc)));
    for _ in 0..16 {
        assert_eq!(ops_thr(&mut bench, &normal(CLEARANCE, AUTO_STOP, 0)), (AUTO_OPS, 0));
    }
    command(&mut bench, Command::Arm).unwrap();
    command(&mut bench, Command::Standby).unwrap();
    assert_eq!(command(&mut bench, run_at(0)), Ok(Accepted::InForce));
    command(&mut bench, run_at(tenths)).unwrap();
    bench
}

/// A frame with its source still fresh, and what is answered.
fn flown(bench: &mut Bench<jetlink::engine::Engine>, tenths: u16, frame: &[u8]) -> Option<(u8, u8)> {
    let _ = command(bench, run_at(tenths));
    answer(bench, frame)
}

/// Running at 80 %, commanded.
fn flying() -> Bench<jetlink::engine::Engine> {
    let mut bench = started(Config::DEFAULT, 800);
    for (state, rpm) in [(STARTING, 10), (STARTED_UP, 30)] {
        for _ in 0..2 {
            assert_eq!(flown(&mut bench, 800, &hot(normal(state, RUN, rpm))), Some((RUN_OPS, 0)));
        }
    }
    for _ in 0..16 {
        flown(&mut bench, 800, &hot(normal(FULL_OPERATION, RUN, 100)));
    }
    assert_eq!(flown(&mut bench, 800, &hot(normal(FULL_OPERATION, RUN, 100))), Some((RUN_OPS, 160)));
    bench
}

// ---------------------------------------------------------------------------------------------
// The reply
// ---------------------------------------------------------------------------------------------

/// AMT-11: one reply to every frame of whatever kind, at once.
#[test]
fn amt_11_every_kind_of_frame_gets_one_reply_at_once() {
    let mut bench = default();
    for frame in [
        setup("9.35 140617 "),
        setup("10.35 200131 "),
        normal(NO_CLEARANCE, EMERGENCY, 0).to_vec(),
        normal(NO_CLEARANCE, AUTO_STOP, 0).to_vec(),
        normal(CLEARANCE, RUN, 0).to_vec(),
        error(0x01).to_vec(),
        alternate(0x18).to_vec(),
        alternate(0xF8).to_vec(),         // an engine that nobody knows
        vec![0xFF, 0x0B, 1, 2, 3, 4],     // low bits 011
        vec![0xFF, 0x0D, 1, 2, 3, 4],     // 101
        vec![0xFF, 0xFE, 1, 2, 3, 4],     // 110
        normal(0b11111, RUN, 0).to_vec(), // a state that nobody knows
    ] {
        assert_eq!(reply_to(&mut bench, &frame), control(AUTO_OPS, 0), "{frame:02x?}");
    }
    let counters = bench.machine.counters();
    bench.run_to(bench.now() + 30_000);
    assert_eq!((counters.frames, counters.replies_missed), (12, 0));
    assert_eq!(bench.machine.counters().sent, 12);
}

/// AMT-11: no reply without a frame.
#[test]
fn amt_11_nothing_is_sent_without_a_frame() {
    let mut bench = default();
    bench.order(0, Order::EmergencyStop).unwrap();
    bench.run_to(10_000_000); // silence
    bench.rx(10_000_000, &[0x00, 0x7F, 0xFE]); // noise
    bench.rx(11_000_000, &normal(FULL_OPERATION, RUN, 100)[..5]); // a frame but for its last byte
    bench.rx(12_000_000, &[0xFF, 0xFF, 0xFF]); // leaders
    bench.run_to(20_000_000);
    assert_eq!(bench.frames(), []);
    assert_eq!(bench.machine.counters().replies_missed, 0);
    // And with the rest of a frame it comes.
    bench.rx(20_000_000, &normal(FULL_OPERATION, RUN, 100)[1..]);
    assert_eq!(bench.frames(), [(20_000_000, control(STOP_OPS, 0).to_vec())]);
}

/// AMT-11: the last stop bit is out within 30 ms, less the guard, at every baud rate. At 2400 baud the first
/// start bit has 9.1 ms.
#[test]
fn amt_11_first_start_bit_leaves_time_for_the_last_stop_bit() {
    assert_eq!(REPLY_WINDOW.as_micros(), 30_000);
    // baud, guard, five bytes on the line rounded up, slack
    for (baud, guard, five_bytes, slack) in [
        (2400, 0, 20_834, Some(9_166)),
        (2400, 500, 20_834, Some(8_666)),
        (2400, 9_165, 20_834, Some(1)),
        (2400, 9_166, 20_834, None), // nothing is left
        (2400, 9_167, 20_834, None),
        (2400, 40_000, 20_834, None),
        (4800, 500, 10_417, Some(19_083)),
        (9600, 500, 5_209, Some(24_291)),
        (19_200, 500, 2_605, Some(26_895)),
        (38_400, 500, 1_303, Some(28_197)),
        (57_600, 500, 869, Some(28_631)),
        (115_200, 500, 435, Some(29_065)),
        (1200, 500, 41_667, None),
    ] {
        let line = Line::new(baud);
        let config = Config { reply_guard: micros(guard), ..Config::DEFAULT };
        assert_eq!(line.time_of(5).as_micros(), five_bytes);
        assert_eq!(config.reply_slack(line), slack.map(micros), "{baud} {guard}");
        let mut bench = amt(config, line);
        bench.rx(700_000, &normal(CLEARANCE, AUTO_STOP, 0));
        let sent = bench.transmissions();
        let start_by: Vec<_> = sent.iter().map(|(_, frame)| frame.start_by).collect();
        let expected: Vec<_> = slack.map(|slack| Some(us(700_000 + slack))).into_iter().collect();
        assert_eq!(start_by, expected, "{baud} {guard}");
        assert_eq!(bench.machine.counters().replies_missed, u32::from(slack.is_none()));
    }
}

/// AMT-11: a frame that comes while a reply is still going out is answered behind it, if that is in time.
#[test]
fn amt_11_a_frame_during_a_transmission() {
    let frame = normal(CLEARANCE, AUTO_STOP, 0);
    // baud, second frame, its reply or None if missed, and the reply's `start_by`
    for (baud, second, reply) in [
        // The first reply takes 5209 µs.
        (9600, 3_000, Some((5_209, 3_000 + 24_291))),
        (9600, 5_208, Some((5_209, 5_208 + 24_291))),
        // It takes 20 834 µs, and the second reply would have to begin 8666 µs behind its frame.
        (2400, 12_167, None),
        (2400, 12_168, Some((20_834, 12_168 + 8_666))),
        (2400, 20_000, Some((20_834, 20_000 + 8_666))),
    ] {
        let line = Line::new(baud);
        let mut bench = amt(Config::DEFAULT, line);
        bench.receive(&frame);
        bench.rx(second, &frame);
        assert_eq!(bench.transmissions().len(), 1, "one at a time");
        bench.run_to(100_000);
        let second_reply: Vec<_> = bench
            .transmissions()
            .iter()
            .map(|(at, frame)| (*at, frame.start_by.unwrap().as_micros()))
            .collect();
        assert_eq!(second_reply, reply.into_iter().collect::<Vec<_>>(), "{baud} {second}");
        let counters = bench.machine.counters();
        assert_eq!(counters.replies_missed, u32::from(reply.is_none()), "{baud} {second}");
        assert_eq!(counters.sent + counters.replies_missed, counters.frames);
    }
}

/// AMT-11: of several frames during one transmission the last is answered, the others count as missed.
#[test]
fn amt_11_several_frames_during_a_transmission() {
    let frame = normal(CLEARANCE, AUTO_STOP, 0);
    let mut bench = amt(Config::DEFAULT, SLOW);
    for t in [0, 5_000, 10_000, 15_000] {
        bench.rx(t, &frame);
    }
    bench.event_kinds();
    bench.run_to(100_000);
    let at: Vec<u64> = bench.frames().into_iter().map(|(at, _)| at).collect();
    assert_eq!(at, [0, 20_834]);
    let counters = bench.machine.counters();
    assert_eq!((counters.frames, counters.sent, counters.replies_missed), (4, 2, 2));
}

/// AMT-11: what the UART did not send is counted, told, and the next frame is answered.
#[test]
fn amt_11_a_reply_that_was_not_sent_is_counted_and_not_made_up_for() {
    for (why, given_up, write_errors) in
        [(NotSent::TooLate, 0, 0), (NotSent::GaveUp, 1, 0), (NotSent::Failed, 0, 1)]
    {
        let mut bench = default().by_hand();
        bench.rx(100_000, &normal(CLEARANCE, AUTO_STOP, 0));
        assert_eq!(bench.frames().len(), 1);
        bench.not_sent_at(110_000, why);
        assert_eq!(bench.frames(), [], "not again");
        assert_eq!(bench.event_kinds(), [Event::NotSent(why)]);
        let counters = bench.machine.counters();
        assert_eq!((counters.sent, counters.replies_missed), (0, 1));
        assert_eq!((counters.given_up, counters.write_errors), (given_up, write_errors));
        bench.rx(225_000, &normal(CLEARANCE, AUTO_STOP, 0));
        assert_eq!(bench.frames(), [(225_000, control(AUTO_OPS, 0).to_vec())]);
        bench.sent_at(246_000);
        assert_eq!(bench.machine.counters().sent, 1);
    }
}

/// AMT-11: the smallest time left in the window is kept; a reply that ended late is counted.
#[test]
fn amt_11_margin_of_the_window() {
    let mut bench = default().by_hand();
    // frame, last stop bit of its reply; worst margin so far, late ones so far
    for (frame, sent, worst, late) in [
        (1_000_000, 1_020_834, Some(9_166), 0),
        (1_125_000, 1_150_000, Some(5_000), 0),
        (1_250_000, 1_270_900, Some(5_000), 0),
        (1_375_000, 1_405_000, Some(0), 0),
        (1_500_000, 1_530_001, Some(0), 1),
    ] {
        bench.rx(frame, &normal(CLEARANCE, AUTO_STOP, 0));
        bench.sent_at(sent);
        let counters = bench.machine.counters();
        assert_eq!(counters.worst_reply_margin, worst.map(micros), "{frame}");
        assert_eq!(counters.replies_late, late, "{frame}");
    }
}

/// AMT-12: a minute of the ECU's own stream at 2400 baud, one alternate set after ten normal ones: each frame has
/// its reply, and when the ECU falls silent so does the host, so that the ECU's own fail-safe works.
#[test]
fn amt_12_the_stream_is_answered_frame_by_frame() {
    let mut bench = default();
    bench.order(0, throttle(300)).unwrap();
    let frames = 8 * 60;
    for i in 1..=frames {
        let frame = if i % 11 == 0 { alternate(0x18) } else { normal(FULL_OPERATION, RUN, 90) };
        bench.rx(i * EVERY, &frame);
        assert_eq!(bench.frames().len(), 1);
    }
    bench.run_to(3_600_000_000);
    assert_eq!(bench.frames(), [], "silence answers silence");
    let counters = bench.machine.counters();
    assert_eq!((u64::from(counters.sent), counters.replies_missed, counters.replies_late), (frames, 0, 0));
}

// ---------------------------------------------------------------------------------------------
// What it says
// ---------------------------------------------------------------------------------------------

/// AMT-10: each order on the wire.
#[test]
fn amt_10_orders_and_their_switch() {
    let mut bench = running();
    let frame = normal(FULL_OPERATION, RUN, 100);
    for (order, ops, half_percents) in [
        (throttle(0), RUN_OPS, 0),
        (throttle(1000), RUN_OPS, 200),
        (throttle(499), RUN_OPS, 99), // never rounded up
        (Order::Standby, AUTO_OPS, 0),
        (throttle(5), RUN_OPS, 1),
        (Order::EmergencyStop, STOP_OPS, 0),
    ] {
        bench.order(bench.now(), order).unwrap();
        assert_eq!(ops_thr(&mut bench, &frame), (ops, half_percents), "{order:?}");
    }
}

/// While nothing is in force, and while the life of the engine is in doubt, no frame of whatever kind gets a reply: what is
/// not answered is not started. It counts as no missed reply.
#[test]
fn without_an_order_and_in_doubt_no_frame_is_answered() {
    let demand = Demand::Throttle(Throttle::FULL);
    for order in [Order::Listen, Order::Doubt(demand)] {
        for released in [false, true] {
            let mut bench = default();
            bench.act(|link, _| link.release(released));
            bench.order(0, order).unwrap();
            for data1 in 0..0xFF {
                if data1 != 0x05 {
                    assert_eq!(
                        answer(&mut bench, &[0xFF, data1, 100, 140, 200, 1]),
                        None,
                        "{order:?} {data1:#04x}"
                    );
                }
            }
            assert_eq!(answer(&mut bench, &setup("9.35 140617 ")), None);
            bench.machine.line_error(LineError::Framing);
            assert_eq!(answer(&mut bench, &normal(FULL_OPERATION, RUN, 100)), None);
            let counters = bench.machine.counters();
            assert_eq!((counters.frames, counters.sent, counters.replies_missed), (256, 0, 0));
            // Beside the orders that are answered.
            for (order, expected) in
                [(Order::EmergencyStop, STOP_OPS), (Order::Standby, AUTO_OPS), (throttle(0), RUN_OPS)]
            {
                bench.order(bench.now(), order).unwrap();
                assert_eq!(answer(&mut bench, &normal(FULL_OPERATION, RUN, 100)), Some((expected, 0)));
            }
        }
    }
}

/// With no order in force an engine that two sets report running, with its shaft turning, goes on at the throttle on which
/// they agree. The switch that the ECU says it obeys starts nothing.
#[test]
fn an_engine_found_running_goes_on_at_its_own_throttle() {
    let at = |frame: [u8; 6], half_percents: u8| {
        let mut frame = hot(frame);
        frame[4] = half_percents;
        frame
    };
    for half_percents in [131, 1, 200] {
        let mut bench = engine_after(Config::DEFAULT, None);
        let running = at(normal(FULL_OPERATION, RUN, 100), half_percents);
        assert_eq!(answer(&mut bench, &running), None, "one set alone may be odd");
        assert_eq!(answer(&mut bench, &at(running, 60)), None, "they have to agree on the throttle");
        assert_eq!(answer(&mut bench, &running), None);
        assert_eq!(answer(&mut bench, &running), Some((RUN_OPS, half_percents)));
    }
    // Sets in a row, and what goes out behind each of them.
    let standby = Some((AUTO_OPS, 0));
    for (frames, replies) in [
        // Damaged, it says nothing.
        (vec![(true, at(normal(FULL_OPERATION, RUN, 100), 80)); 4], vec![None; 4]),
        // An engine at rest is put to standby, whatever the switch says.
        (vec![(false, at(normal(CLEARANCE, RUN, 0), 80)); 2], vec![None, standby]),
        (vec![(false, at(normal(NO_CLEARANCE, RUN, 0), 80)); 2], vec![None, standby]),
        (vec![(false, at(normal(STARTING, RUN, 10), 80)); 2], vec![None, standby]),
        // A shaft below half of idle is no running engine.
        (vec![(false, at(normal(FULL_OPERATION, RUN, 19), 80)); 4], vec![None; 4]),
        (vec![(false, at(normal(FULL_OPERATION, RUN, 20), 80)); 2], vec![None, Some((RUN_OPS, 80))]),
        // Faults alone say nothing of an engine of which nothing is known.
        (vec![(false, at(hot(error(0x01)), 80)); 4], vec![None; 4]),
        (vec![(false, alternate(0x06)); 4], vec![None; 4]),
    ] {
        let mut bench = engine_after(Config::DEFAULT, None);
        for ((damaged, frame), reply) in frames.iter().zip(replies) {
            bench.run_to(bench.now() + EVERY / 2);
            if *damaged {
                bench.machine.line_error(LineError::Framing);
            }
            assert_eq!(answer(&mut bench, frame), reply, "{frame:02x?}");
        }
    }
    // An ECU that has just been powered up has an engine at rest.
    let mut bench = engine_after(Config::DEFAULT, None);
    assert_eq!(answer(&mut bench, &setup("9.35 140617 ")), standby);
}

/// There is no checksum: one odd set that says at rest is not answered, and neither ends a run nor keeps the next good set
/// from its reply.
#[test]
fn one_odd_set_withholds_one_reply() {
    let odd = hot(normal(NO_CLEARANCE, EMERGENCY, 0));
    let good = hot(normal(FULL_OPERATION, RUN, 100));
    let mut bench = flying();
    for _ in 0..5 {
        assert_eq!(flown(&mut bench, 800, &odd), None);
        assert_eq!(flown(&mut bench, 800, &good), Some((RUN_OPS, 160)));
        assert_eq!(flown(&mut bench, 800, &good), Some((RUN_OPS, 160)));
    }
    // Beside two in a row, which end it.
    assert_eq!(flown(&mut bench, 800, &odd), None);
    assert_eq!(flown(&mut bench, 800, &odd), Some((AUTO_OPS, 0)));
    for _ in 0..20 {
        assert_eq!(
            flown(&mut bench, 800, &good),
            Some((AUTO_OPS, 0)),
            "and its source does not start it again"
        );
    }
}

/// An AMT ECU has no speed control.
#[test]
fn it_has_no_speed_control() {
    assert_eq!(default().machine.speed_control(), Err(Rejected::NoSpeedControl));
}

/// An emergency stop is in the very next reply, also in one that waits behind a transmission.
#[test]
fn an_emergency_stop_is_in_the_next_reply() {
    let frame = normal(FULL_OPERATION, RUN, 100);
    let mut bench = running();
    assert_eq!(ops_thr(&mut bench, &frame), (RUN_OPS, 160));
    let t = bench.now();
    bench.rx(t + 15_000, &frame); // the reply to the first is still going out
    bench.order(t + 16_000, Order::EmergencyStop).unwrap();
    bench.run_to(t + 40_000);
    assert_eq!(bench.bytes(), [control(STOP_OPS, 0)]);
    for _ in 0..100 {
        assert_eq!(ops_thr(&mut bench, &frame), (STOP_OPS, 0), "and in every other");
    }
}

/// The latest order wins even when it comes between a frame and the hand-out of its reply: a command may come from
/// an interrupt.
#[test]
fn an_emergency_stop_replaces_a_reply_that_was_not_handed_out() {
    let mut bench = running();
    bench.run_to(bench.now() + EVERY); // the reply before is out
    let now = us(bench.now());
    let link = &mut bench.machine;
    // At once, without the drain that the bench does between two inputs.
    Link::receive(link, now, &normal(FULL_OPERATION, RUN, 100));
    link.order(now, Order::EmergencyStop).unwrap();
    let reply = loop {
        match Link::poll(link) {
            Output::Transmit(reply) => break reply,
            Output::Event(_) => {}
            Output::Wait(_) => panic!("a reply is due"),
        }
    };
    assert_eq!(reply.as_bytes(), control(STOP_OPS, 0));
}

/// AMT-13: CTF goes out when asked for by name, told once, until standby or a stop; where nothing is ordered to run it is
/// refused.
#[test]
fn amt_13_ctf_only_by_its_name() {
    let frame = normal(FULL_OPERATION, RUN, 100);
    let mut bench = running();
    assert_eq!(ops_thr(&mut bench, &frame).0, RUN_OPS);
    bench.act(|link, now| link.service(now, ctf())).unwrap();
    bench.events();
    for _ in 0..20 {
        assert_eq!(ops_thr(&mut bench, &frame).0, CTF_OPS);
    }
    assert_eq!(bench.event_kinds(), [Event::ServiceSent(ctf())]);
    bench.order(bench.now(), throttle(300)).unwrap();
    assert_eq!(ops_thr(&mut bench, &frame).0, CTF_OPS, "a source that streams demands does not call it off");
    bench.order(bench.now(), Order::Standby).unwrap();
    assert_eq!(ops_thr(&mut bench, &frame), (AUTO_OPS, 0), "a normal stop is never CTF");
    for (order, ops) in [(Order::EmergencyStop, STOP_OPS), (Order::Standby, AUTO_OPS)] {
        bench.order(bench.now(), order).unwrap();
        assert_eq!(bench.act(|link, now| link.service(now, ctf())), Err(Rejected::NotOrderedToRun));
        assert_eq!(ops_thr(&mut bench, &frame), (ops, 0));
    }
    bench.order(bench.now(), throttle(300)).unwrap();
    assert_eq!(ops_thr(&mut bench, &frame).0, RUN_OPS, "nothing of it is left for the next start");
}

/// AMT-13: no order, no frame and no silence makes a CTF of itself.
#[test]
fn amt_13_no_order_sends_ctf() {
    for order in [Order::Standby, Order::EmergencyStop, throttle(700)] {
        let mut bench = running();
        bench.order(bench.now(), order).unwrap();
        for data1 in (0..0xFF).filter(|data1| *data1 != 0x05) {
            assert_ne!(ops_thr(&mut bench, &[0xFF, data1, 1, 1, 1, 1]).0, CTF_OPS, "{order:?} {data1:#04x}");
        }
    }
}

/// AMT-14: the link sends "run" with the start throttle until the engine is released, then the demand.
#[test]
fn amt_14_the_demand_waits_for_its_release() {
    for start_percent in [0, 100] {
        let start_throttle = Throttle::from_percent(start_percent).unwrap();
        let mut bench = amt(Config { start_throttle, ..Config::DEFAULT }, SLOW);
        bench.order(bench.now(), throttle(250)).unwrap();
        for state in [CLEARANCE, STARTING, FULL_OPERATION, FULL_OPERATION, 0b10101] {
            assert_eq!(ops_thr(&mut bench, &normal(state, RUN, 100)), (RUN_OPS, start_percent * 2));
        }
        bench.act(|link, _| link.release(true));
        for state in [FULL_OPERATION, 0b10101, IDLE_CALIBRATION] {
            assert_eq!(ops_thr(&mut bench, &normal(state, RUN, 100)), (RUN_OPS, 50));
        }
        bench.act(|link, _| link.release(false));
        assert_eq!(ops_thr(&mut bench, &normal(FULL_OPERATION, RUN, 100)), (RUN_OPS, start_percent * 2));
    }
}

/// AMT-14: "run" with the start throttle until two sets of full operation, then the demand, at its rate.
#[test]
fn amt_14_start_throttle_until_full_operation() {
    for start_percent in [0, 100] {
        let start_throttle = Throttle::from_percent(start_percent).unwrap();
        let mut bench = started(Config { start_throttle, ..Config::DEFAULT }, 250);
        let start = start_percent * 2;
        // state, raw rpm, frames of it, half percents in the reply to the last of them
        for (state, rpm, frames, half_percents) in [
            (CLEARANCE, 0, 3, start),
            (STARTING, 10, 5, start),
            (STARTED_UP, 30, 5, start),
            (IDLE_CALIBRATION, 60, 5, start),
            (FULL_OPERATION, 70, 1, start), // AMT frames have no checksum: one is not believed
            (FULL_OPERATION, 70, 6, 50),    // 25 % at 50 %/s takes 0.5 s, four frames
            (0b10000, 200, 5, 50),          // maximum rpm
            (0b11100, 200, 5, 50),          // the same, as the field has it
        ] {
            let mut last = None;
            for _ in 0..frames {
                last = flown(&mut bench, 250, &hot(normal(state, RUN, rpm)));
            }
            assert_eq!(last, Some((RUN_OPS, half_percents)), "state {state:#07b}, start {start_percent} %");
        }
        // The engine is out: that needs a new start.
        assert_eq!(flown(&mut bench, 250, &hot(normal(NO_CLEARANCE, RUN, 0))), None);
        assert_eq!(flown(&mut bench, 250, &hot(normal(NO_CLEARANCE, RUN, 0))), Some((AUTO_OPS, 0)));
    }
}

/// After a start the demand rises at 50 %/s, and never jumps to where the stick is.
#[test]
fn the_demand_rises_at_its_rate_after_a_start() {
    let mut bench = started(Config::DEFAULT, 800);
    for (state, rpm) in [(STARTING, 10), (FULL_OPERATION, 70)] {
        for _ in 0..2 {
            flown(&mut bench, 800, &hot(normal(state, RUN, rpm)));
        }
    }
    let began = bench.now();
    let mut before = 0;
    for _ in 0..20 {
        let (ops, half_percents) = flown(&mut bench, 800, &hot(normal(FULL_OPERATION, RUN, 70))).unwrap();
        // 50 %/s is a half percent every 10 ms.
        let most = ((bench.now() - began) / 10_000).min(160);
        assert_eq!(ops, RUN_OPS);
        assert!(u64::from(half_percents) <= most && half_percents >= before, "{half_percents} of {most}");
        assert!(u64::from(half_percents) + 4 >= most, "no slower either: {half_percents} of {most}");
        before = half_percents;
    }
    assert_eq!(before, 160);
}

/// AMT-14: one odd set does not drop the throttle of a running engine. Where it says at rest or starting again its reply is
/// withheld, and two in a row end the run; idle calibration and "started up" in flight are neither.
#[test]
fn amt_14_one_odd_frame_does_not_drop_the_throttle() {
    let good = hot(normal(FULL_OPERATION, RUN, 100));
    for odd in [NO_CLEARANCE, CLEARANCE, STARTING] {
        let mut bench = flying();
        let odd = hot(normal(odd, RUN, 0));
        for _ in 0..5 {
            assert_eq!(flown(&mut bench, 800, &odd), None, "{odd:02x?}");
            assert_eq!(flown(&mut bench, 800, &good), Some((RUN_OPS, 160)));
        }
        assert_eq!(flown(&mut bench, 800, &odd), None);
        assert_eq!(flown(&mut bench, 800, &odd), Some((AUTO_OPS, 0)), "two in a row");
    }
    for neither in [STARTED_UP, IDLE_CALIBRATION] {
        let mut bench = flying();
        for _ in 0..40 {
            assert_eq!(
                flown(&mut bench, 800, &hot(normal(neither, RUN, 60))),
                Some((RUN_OPS, 160)),
                "{neither}"
            );
        }
    }
}

/// AMT-3: a state without a name is kept, and does not drop the throttle of a running engine.
#[test]
fn amt_3_an_unknown_state_does_not_drop_the_throttle() {
    let unknown = hot(normal(0b10101, RUN, 100));
    let mut bench = flying();
    for _ in 0..10 {
        assert_eq!(flown(&mut bench, 800, &unknown), Some((RUN_OPS, 160)));
    }
    let report = bench.machine.telemetry(us(bench.now())).report;
    assert_eq!(report.phase.unwrap().value, Phase::Unknown);
    let state = report.state.unwrap().value;
    assert_eq!((state.code, state.name), (0b10101, "unknown"));
    // But an engine that was never in full operation is not released by one.
    let mut bench = started(Config::DEFAULT, 800);
    for _ in 0..10 {
        assert_eq!(flown(&mut bench, 800, &unknown), Some((RUN_OPS, 0)));
    }
}

/// AMT-2: error and alternate sets and unknown kinds say nothing about the state, and drop no throttle of an engine whose
/// exhaust burns. Faults with a cold exhaust end the run.
#[test]
fn amt_2_other_sets_do_not_drop_the_throttle() {
    let mut bench = flying();
    for frame in [
        hot(error(0x20)),
        hot(error(0x20)),
        hot(error(0x20)),
        alternate(0x20),
        alternate(0x20),
        [0xFF, 0x0F, 1, 2, 3, 4],
        hot(error(0x20)),
        error(0x08), // EGT error: its value says nothing
        error(0x08),
        hot(normal(FULL_OPERATION, RUN, 100)),
    ] {
        assert_eq!(flown(&mut bench, 800, &frame), Some((RUN_OPS, 160)), "{frame:02x?}");
    }
    // It falls by 9.2 °C a set, 74 °C/s.
    let mut bench = flying();
    let mut egt = 140;
    let ended = (0..60).find(|_| {
        egt -= 2;
        let mut frame = error(0x20);
        frame[3] = egt;
        flown(&mut bench, 800, &frame) == Some((AUTO_OPS, 0))
    });
    assert!(ended.is_some_and(|sets| (16..=40).contains(&sets)), "{ended:?}: a fall of 3 s, 8 sets a second");
}

/// AMT-12: an engine whose ECU falls silent for three sets is in doubt. One that is heard again, running, is answered at
/// once, with the throttle where it was; after more than its serial delay time it needs two sets.
#[test]
fn amt_12_a_gap_is_doubt() {
    let good = hot(normal(FULL_OPERATION, RUN, 100));
    let starting = hot(normal(STARTING, RUN, 10));
    let silence = |bench: &mut Bench<jetlink::engine::Engine>, micros: u64| {
        let end = bench.now() + micros - EVERY;
        bench.run_to(bench.now() + 50_000); // the reply before is out
        bench.frames();
        while bench.now() + 100_000 < end {
            let _ = command(bench, run_at(800));
            bench.run_to(bench.now() + 100_000);
        }
        bench.run_to(end);
        assert_eq!(bench.frames(), [], "silence is answered with silence");
    };
    let doubts = |bench: &mut Bench<_>| bench.event_kinds().contains(&Event::LifeInDoubt);
    let mut bench = flying();
    silence(&mut bench, 374_000);
    assert_eq!(answer(&mut bench, &good), Some((RUN_OPS, 160)));
    assert!(!doubts(&mut bench));
    for gap in [376_000, 3_700_000] {
        let mut bench = flying();
        silence(&mut bench, gap);
        assert_eq!(answer(&mut bench, &good), Some((RUN_OPS, 160)), "{gap}");
        assert!(doubts(&mut bench), "{gap}");
        // After a gap an engine that starts again is not answered, and the second report ends the life.
        let mut bench = flying();
        silence(&mut bench, gap);
        assert_eq!(answer(&mut bench, &starting), None, "{gap}");
        assert_eq!(answer(&mut bench, &starting), Some((AUTO_OPS, 0)), "{gap}");
    }
    // Beyond the serial delay the order is gone: two sets, and their own throttle.
    let mut bench = flying();
    silence(&mut bench, 4_200_000);
    let mut own = good;
    own[4] = 90;
    assert_eq!(answer(&mut bench, &own), None);
    assert_eq!(answer(&mut bench, &own), Some((RUN_OPS, 90)));
}

/// AMT-3: what each kind of set says about the life of the engine.
#[test]
fn every_set_is_a_sign() {
    let state = |stage, rpm: u8| Sign::State {
        stage,
        turning: Some(rpm >= 20),
        throttle: Some(Throttle::from_tenths(405).unwrap()),
    };
    let throttle = Some(Throttle::from_tenths(405).unwrap());
    let with_throttle = |mut frame: [u8; 6]| {
        frame[4] = 81;
        frame.to_vec()
    };
    let mut cases = Vec::new();
    for (code, stage) in [
        (NO_CLEARANCE, Stage::Rest),
        (CLEARANCE, Stage::Clearance),
        (STARTING, Stage::Starting),
        (STARTED_UP, Stage::StartedUp),
        (IDLE_CALIBRATION, Stage::Calibrating),
        (FULL_OPERATION, Stage::Running),
        (0b10000, Stage::Running),
        (0b11100, Stage::Running),
        (0b01111, Stage::Unknown),
    ] {
        for rpm in [0, 19, 20, 254] {
            cases.push((with_throttle(normal(code, RUN, rpm)), state(stage, rpm)));
        }
    }
    let egt = Some(Celsius::from_tenths(5940));
    for bits in 1..=0xFEu8 {
        // B3: EGT error.
        let egt = egt.filter(|_| bits & 0b1000 == 0);
        cases.push((with_throttle(hot(error(bits))), Sign::Faulted { throttle, egt }));
    }
    cases.push((alternate(0x18).to_vec(), Sign::Stateless));
    cases.push((vec![0xFF, 0x0B, 1, 2, 3, 4], Sign::Stateless));
    cases.push((setup("9.35 140617 "), Sign::PowerUp));
    for (frame, sign) in cases {
        let mut bench = default();
        assert_eq!(bench.machine.take_sign(), None);
        reply_to(&mut bench, &frame);
        assert_eq!(bench.machine.take_sign(), Some(sign), "{frame:02x?}");
        assert_eq!(bench.machine.take_sign(), None, "once");
        bench.machine.line_error(LineError::Noise);
        reply_to(&mut bench, &frame);
        assert_eq!(bench.machine.take_sign(), Some(Sign::Damaged), "{frame:02x?}");
    }
}

/// A gap begins 375 ms behind the last set, three of its intervals. Damaged sets keep the beat, for 10 s; single bytes and a
/// steady babble do not.
#[test]
fn three_sets_that_fail_are_a_gap() {
    let frame = normal(FULL_OPERATION, RUN, 100);
    let gap = |bench: &Bench<AmtLink>| bench.machine.gap_at().map(|at| at.as_micros());
    let mut bench = default();
    assert_eq!(gap(&bench), None, "nothing was heard yet");
    bench.rx(1_000_000, &frame);
    assert_eq!(gap(&bench), Some(1_375_000));
    bench.machine.line_error(LineError::Framing);
    bench.rx(1_125_000, &frame);
    assert_eq!(gap(&bench), Some(1_500_000), "damaged, it keeps the beat");
    bench.rx(1_250_000, &[0x12, 0x34, 0x56]);
    assert_eq!(gap(&bench), Some(1_500_000), "three bytes are no set");
    for step in 3..200u64 {
        let t = 1_000_000 + step * EVERY;
        bench.machine.line_error(LineError::Framing);
        bench.rx(t, &frame);
        let beats = if t < 11_000_000 { t } else { 1_000_000 + 79 * EVERY };
        assert_eq!(gap(&bench), Some(beats + 375_000), "{t}");
    }
    bench.act(|link, _| link.gap());
    assert_eq!(gap(&bench), None, "it is announced once");
    let t = bench.now() + EVERY;
    bench.rx(t, &frame);
    assert_eq!(gap(&bench), Some(t + 375_000));
    // A steady babble keeps no beat beyond its first burst.
    for byte in 1..=1000u64 {
        bench.rx(t + 40_000 + byte * 4_167, &[0x55]);
    }
    assert!(gap(&bench).unwrap() < t + 500_000);
}

/// What an AMT ECU cannot do is refused, and what was ordered before stays on the wire.
#[test]
fn refused_orders_change_nothing() {
    let frame = normal(FULL_OPERATION, RUN, 100);
    let mut bench = running();
    let rpm = Order::Run(Demand::Rpm(Rpm::new(30_000)));
    assert_eq!(bench.order(bench.now(), rpm), Err(Rejected::NoSpeedControl));
    assert_eq!(bench.order(bench.now(), Order::Pwm), Err(Rejected::NotSupported));
    let zk = Service::Zk(ZkService::Action(zk::codec::Action::Drain));
    assert_eq!(bench.act(|link, now| link.service(now, zk)), Err(Rejected::NotSupported));
    assert_eq!(ops_thr(&mut bench, &frame), (RUN_OPS, 160));
}

// ---------------------------------------------------------------------------------------------
// Whether it is heard
// ---------------------------------------------------------------------------------------------

/// Up after two frames, lost by the timer at exactly `lost_after` behind the last one, up again after two.
#[test]
fn link_up_after_two_frames_and_lost_to_the_tick() {
    let frame = normal(CLEARANCE, AUTO_STOP, 0);
    let mut bench = default();
    assert_eq!((bench.machine.state(), bench.deadline()), (LinkState::Silent, Some(1_000_000)));
    bench.rx(100_000, &frame);
    assert_eq!((bench.machine.state(), bench.event_kinds()), (LinkState::Silent, vec![]));
    bench.rx(225_000, &frame);
    assert_eq!(bench.machine.state(), LinkState::Up);
    assert_eq!(bench.events()[0], (225_000, Event::LinkUp));
    bench.run_to(300_000);
    assert_eq!(bench.deadline(), Some(1_225_000));
    bench.timeout_at(1_224_999);
    assert_eq!(
        (bench.machine.state(), bench.event_kinds()),
        (LinkState::Up, vec![]),
        "early calls do nothing"
    );
    bench.timeout_at(1_225_000);
    assert_eq!((bench.machine.state(), bench.event_kinds()), (LinkState::Lost, vec![Event::LinkLost]));
    assert_eq!(bench.machine.last_rx(), Some(us(225_000)));
    bench.run_to(60_000_000);
    assert_eq!(bench.event_kinds(), [], "once");
    bench.rx(60_000_000, &frame);
    assert_eq!(bench.machine.state(), LinkState::Lost);
    bench.rx(60_125_000, &frame);
    assert_eq!((bench.machine.state(), bench.event_kinds()), (LinkState::Up, vec![Event::LinkUp]));
}

/// Two frames that are more than `lost_after` apart do not bring the link up.
#[test]
fn two_frames_far_apart_are_not_two_in_a_row() {
    let frame = normal(CLEARANCE, AUTO_STOP, 0);
    let mut bench = default();
    for t in [900_000, 2_900_000, 4_900_000, 6_900_000] {
        bench.rx(t, &frame);
        assert_ne!(bench.machine.state(), LinkState::Up, "{t}");
    }
    bench.rx(7_899_999, &frame);
    assert_eq!(bench.machine.state(), LinkState::Up);
}

/// AMT-1: a frame with a line error is answered, but is no sign of an ECU: it neither brings the link up nor keeps
/// it up.
#[test]
fn amt_1_damaged_frames_are_no_sign_of_life() {
    let frame = normal(CLEARANCE, AUTO_STOP, 0);
    let mut bench = default();
    for _ in 0..6 {
        bench.machine.line_error(LineError::Framing);
        reply_to(&mut bench, &frame);
    }
    assert_eq!((bench.machine.state(), bench.machine.last_rx()), (LinkState::Silent, None));
    reply_to(&mut bench, &frame);
    let t = bench.now();
    assert_eq!((bench.machine.state(), bench.machine.last_rx()), (LinkState::Silent, Some(us(t))));
    reply_to(&mut bench, &frame);
    let heard = bench.now();
    assert_eq!(bench.machine.state(), LinkState::Up);
    bench.event_kinds();
    for _ in 0..7 {
        bench.machine.line_error(LineError::Noise);
        reply_to(&mut bench, &frame);
    }
    assert_eq!((bench.machine.state(), bench.machine.last_rx()), (LinkState::Up, Some(us(heard))));
    bench.machine.line_error(LineError::Noise);
    reply_to(&mut bench, &frame); // this one comes with the timer, a second behind the last good one
    assert_eq!((bench.machine.state(), bench.event_kinds()), (LinkState::Lost, vec![Event::LinkLost]));
    for _ in 0..2 {
        assert_eq!(bench.machine.state(), LinkState::Lost);
        reply_to(&mut bench, &frame);
    }
    assert_eq!(bench.machine.state(), LinkState::Up);
}

/// An ECU that is never heard is lost once, too.
#[test]
fn an_ecu_never_heard_is_lost_once() {
    let mut bench = default();
    bench.run_to(100_000_000);
    assert_eq!(bench.events(), [(1_000_000, Event::LinkLost)]);
    assert_eq!(bench.machine.last_rx(), None);
}

/// AMT-9: the set-up set says that the ECU came out of its power-up.
#[test]
fn amt_9_a_restart_of_the_ecu_is_told() {
    let mut bench = running();
    reply_to(&mut bench, &setup("9.35 140617 "));
    let events = bench.event_kinds();
    assert_eq!(events, [Event::EngineIdentified(Engine::Olympus), Event::EcuStarted]);
    let report = bench.machine.report();
    assert_eq!(report.amt_setup.unwrap().value.version(), "9.35");
    assert_eq!(report.amt_setup.unwrap().at, us(bench.now()));
}

// ---------------------------------------------------------------------------------------------
// What is known
// ---------------------------------------------------------------------------------------------

/// AMT-5, AMT-6: values with a scale for engines that have one, raw bytes for all others.
#[test]
fn amt_5_amt_6_rpm_and_voltages_by_engine() {
    // engine, rpm of 100, mV of 51 idle, 102 maximum, 204 battery, 153 external, 255-step Vout of 51
    for (engine, rpm, idle, max, battery, external) in [
        (Engine::Mercury, Some(70_000), Some(1250), Some(2500), Some(8000), Some(10_750)),
        (Engine::Pegasus, Some(50_000), Some(1250), Some(2500), Some(8000), Some(10_750)),
        (Engine::Olympus, Some(50_000), Some(1660), Some(3320), Some(8000), Some(12_580)),
        (Engine::Titan, Some(50_000), Some(1660), Some(3320), Some(8000), Some(12_580)),
        (Engine::Nike, None, Some(1660), Some(3320), None, Some(12_580)),
        (Engine::Lynx, None, None, None, None, None),
        (Engine::Orion, None, None, None, None, None),
    ] {
        let mut bench = amt(Config { engine: Some(engine), ..Config::DEFAULT }, SLOW);
        bench.rx(100_000, &alternate(0xF8)); // its engine ID says nothing
        bench.rx(225_000, &[0xFF, FULL_OPERATION << 3 | RUN, 100, 100, 150, 51]);
        let report = bench.machine.report();
        assert_eq!(report.rpm.map(|rpm| rpm.value.get()), rpm, "{engine:?}");
        assert_eq!(report.rpm_raw.unwrap().value, 100);
        for (name, reading, raw, expected) in [
            ("idle", report.pump_idle, 51, idle),
            ("maximum", report.pump_max, 102, max),
            ("battery", report.supply, 204, battery),
            ("external", report.external_battery, 153, external),
            ("Vout", report.pump, 51, idle),
        ] {
            let reading = reading.unwrap().value;
            assert_eq!(reading.raw, raw, "{engine:?} {name}");
            assert_eq!(reading.voltage.map(|voltage| voltage.get()), expected, "{engine:?} {name}");
        }
        assert_eq!(report.egt.unwrap().value.tenths(), 4100); // AMT-7: 100 × 4.6 − 50
        assert_eq!(report.throttle.unwrap().value.tenths(), 750); // AMT-7: 150 / 2
    }
}

/// AMT-5: while the engine is not known there is no rpm, and when it changes to an open one the old rpm goes.
#[test]
fn amt_5_no_rpm_without_a_scale() {
    let frame = normal(FULL_OPERATION, RUN, 100);
    let mut bench = default();
    reply_to(&mut bench, &frame);
    assert_eq!((bench.machine.report().rpm, bench.machine.report().amt_engine), (None, None));
    assert_eq!(bench.machine.report().rpm_raw.unwrap().value, 100);
    reply_to(&mut bench, &alternate(0x18));
    reply_to(&mut bench, &frame);
    assert_eq!(bench.machine.report().rpm.unwrap().value.get(), 50_000);
    reply_to(&mut bench, &setup("14.35 200131 ")); // Lynx
    reply_to(&mut bench, &frame);
    assert_eq!(bench.machine.report().rpm, None);
}

/// AMT-4, AMT-9: who names the engine. An ID without a checksum changes a known engine only when it comes twice.
#[test]
fn amt_4_identity_rules() {
    let named = |bench: &mut Bench<AmtLink>, frame: &[u8]| {
        reply_to(bench, frame);
        let told: Vec<_> = bench
            .event_kinds()
            .into_iter()
            .filter_map(|event| match event {
                Event::EngineIdentified(engine) => Some(engine),
                _ => None,
            })
            .collect();
        (told, bench.machine.report().amt_engine.map(|engine| engine.value))
    };
    use Engine::{Mercury, Olympus, Pegasus, Titan};
    let configured = || {
        let mut bench = amt(Config { engine: Some(Olympus), ..Config::DEFAULT }, SLOW);
        bench.order(0, Order::Standby).unwrap();
        bench
    };

    let mut bench = default();
    assert_eq!(named(&mut bench, &alternate(0x06)), (vec![Olympus], Some(Olympus)), "the first is believed");
    assert_eq!(named(&mut bench, &alternate(0x18)), (vec![], Some(Olympus)), "the same, new number");
    assert_eq!(named(&mut bench, &alternate(0x20)), (vec![], Some(Olympus)), "one odd frame");
    assert_eq!(named(&mut bench, &alternate(0x18)), (vec![], Some(Olympus)));
    assert_eq!(named(&mut bench, &alternate(0x20)), (vec![], Some(Olympus)));
    assert_eq!(named(&mut bench, &alternate(0x20)), (vec![Titan], Some(Titan)), "two in a row");
    assert_eq!(
        named(&mut bench, &setup("8.35 140617 ")),
        (vec![Mercury], Some(Mercury)),
        "a text is believed"
    );
    assert_eq!(
        named(&mut bench, &setup("11.35 200131 ")),
        (vec![], Some(Mercury)),
        "no engine has this version"
    );

    // An ID that no table has is another engine: what was known must not lend it a scale.
    let mut bench = configured();
    reply_to(&mut bench, &alternate(0xF8));
    reply_to(&mut bench, &normal(FULL_OPERATION, RUN, 100));
    assert_eq!(bench.machine.report().rpm.map(|rpm| rpm.value.get()), Some(50_000), "one odd frame");
    reply_to(&mut bench, &alternate(0xF8));
    reply_to(&mut bench, &normal(FULL_OPERATION, RUN, 100));
    assert!(bench.event_kinds().contains(&Event::EngineUnknown));
    assert_eq!((bench.machine.report().rpm, bench.machine.report().amt_engine), (None, None));

    // What was configured is told when the ECU says so itself; what the ECU says wins.
    let mut bench = configured();
    assert_eq!(bench.machine.report().amt_engine, None, "the ECU has not said it");
    assert_eq!(named(&mut bench, &alternate(0x18)), (vec![Olympus], Some(Olympus)));
    let mut bench = configured();
    assert_eq!(named(&mut bench, &alternate(0x03)).0, []);
    assert_eq!(named(&mut bench, &alternate(0x10)), (vec![Pegasus], Some(Pegasus)));
}

/// AMT-3: the ECU's state in plain words.
#[test]
fn amt_3_phases() {
    for (state, switch, rpm, phase) in [
        (NO_CLEARANCE, EMERGENCY, 0, Phase::Stopped),
        (NO_CLEARANCE, AUTO_STOP, 0, Phase::Standby),
        (NO_CLEARANCE, RUN, 0, Phase::Standby),
        (CLEARANCE, AUTO_STOP, 0, Phase::Standby),
        (CLEARANCE, RUN, 0, Phase::Standby),
        (NO_CLEARANCE, AUTO_STOP, 20, Phase::Cooling), // shut down, and the shaft still turns
        (STARTING, RUN, 10, Phase::Starting),
        (STARTED_UP, RUN, 30, Phase::Starting),
        (IDLE_CALIBRATION, RUN, 60, Phase::Starting),
        (FULL_OPERATION, RUN, 70, Phase::Running),
        (0b10000, RUN, 200, Phase::Running),
        (0b11100, RUN, 200, Phase::Running),
        (0b01111, RUN, 200, Phase::Unknown),
    ] {
        let mut bench = default();
        reply_to(&mut bench, &normal(state, switch, rpm));
        assert_eq!(bench.machine.report().phase, None, "one frame is not believed");
        reply_to(&mut bench, &normal(state, switch, rpm));
        assert_eq!(bench.machine.report().phase.map(|phase| phase.value), Some(phase), "{state:#07b}");
        let switch_reported = match switch {
            EMERGENCY => ReportedSwitch::Stop,
            AUTO_STOP => ReportedSwitch::Standby,
            _ => ReportedSwitch::Run,
        };
        assert_eq!(bench.machine.report().switch.unwrap().value, switch_reported);
    }
}

/// The phase is as old as the last frame that agreed with it: neither an odd frame nor another set renews it.
#[test]
fn amt_3_only_frames_that_agree_renew_the_phase() {
    let mut bench = running();
    let running = normal(FULL_OPERATION, RUN, 100);
    reply_to(&mut bench, &running);
    let agreed = bench.now();
    for other in [
        normal(STARTING, RUN, 1),
        normal(NO_CLEARANCE, EMERGENCY, 0),
        normal(0b11111, RUN, 100),
        error(0x01),
        alternate(0x18),
        normal(STARTED_UP, RUN, 50),
    ] {
        reply_to(&mut bench, &other);
        let phase = bench.machine.report().phase.unwrap();
        assert_eq!((phase.value, phase.at), (Phase::Running, us(agreed)), "{other:02x?}");
    }
    reply_to(&mut bench, &running);
    let t = bench.now();
    assert_eq!(bench.machine.report().phase.unwrap().at, us(t));
    // Two that agree with each other are the new phase, as old as the second.
    for _ in 0..2 {
        reply_to(&mut bench, &normal(NO_CLEARANCE, EMERGENCY, 0));
    }
    let t = bench.now();
    let phase = bench.machine.report().phase.unwrap();
    assert_eq!((phase.value, phase.at), (Phase::Stopped, us(t)));
}

/// AMT-8: the faults are told when they change, bit 7 included; one odd set is no fault and does not end one.
#[test]
fn amt_8_faults_are_told_when_they_change() {
    let mut bench = default();
    for (frame, told) in [
        (normal(CLEARANCE, AUTO_STOP, 0), None),
        (error(0x01), None),
        (normal(CLEARANCE, AUTO_STOP, 0), None),
        (error(0x01), None),
        (error(0x01), Some(0x01)),
        (error(0x01), None),
        (error(0xC1), Some(0xC1)),
        (alternate(0x18), None), // says nothing of faults
        (normal(CLEARANCE, AUTO_STOP, 0), None),
        (error(0xC1), None),
        (normal(CLEARANCE, AUTO_STOP, 0), None),
        (normal(CLEARANCE, AUTO_STOP, 0), Some(0)),
    ] {
        reply_to(&mut bench, &frame);
        let faults: Vec<_> = bench
            .event_kinds()
            .into_iter()
            .filter_map(|event| match event {
                Event::Faults(Faults::Amt(bits)) => Some(bits.0),
                _ => None,
            })
            .collect();
        assert_eq!(faults, told.into_iter().collect::<Vec<_>>(), "{frame:02x?}");
    }
    assert_eq!(bench.machine.report().faults.unwrap().value, Faults::Amt(ErrorBits(0)));
}

/// AMT-8: Data2 of an error set is no rpm.
#[test]
fn amt_8_an_error_set_gives_no_rpm() {
    let mut bench = amt(Config { engine: Some(Engine::Titan), ..Config::DEFAULT }, SLOW);
    bench.order(0, Order::Standby).unwrap();
    reply_to(&mut bench, &error(0x20));
    let report = bench.machine.report();
    assert_eq!((report.rpm, report.rpm_raw), (None, None));
    assert_eq!(report.egt.unwrap().value.tenths(), 420); // Data3..5 as in the normal set: 20 × 4.6 − 50
}

/// AMT-2: a frame of an unknown kind is counted, and its bytes are kept.
#[test]
fn amt_2_unknown_kinds_are_kept() {
    let mut bench = default();
    let unknown = [0xFF, 0b0101_1101, 1, 2, 3, 4];
    reply_to(&mut bench, &unknown);
    let counters = bench.machine.counters();
    assert_eq!((counters.frames, counters.unknown_frames), (1, 1));
    assert_eq!(bench.machine.report().unknown.unwrap().value.as_bytes(), unknown);
}

/// AMT-7: a throttle byte above 200 is no throttle.
#[test]
fn amt_7_a_throttle_above_100_percent_is_not_taken_over() {
    let mut bench = default();
    reply_to(&mut bench, &[0xFF, FULL_OPERATION << 3 | RUN, 1, 1, 201, 1]);
    assert_eq!(bench.machine.report().throttle, None);
    reply_to(&mut bench, &[0xFF, FULL_OPERATION << 3 | RUN, 1, 1, 200, 1]);
    assert_eq!(bench.machine.report().throttle.unwrap().value, Throttle::FULL);
}

/// AMT-1: there is no checksum, so a fault that the UART saw costs a frame its values, and never its reply.
#[test]
fn amt_1_a_line_error_costs_the_values_and_not_the_reply() {
    let mut bench = running();
    let report = *bench.machine.report();
    bench.machine.line_error(LineError::Framing);
    assert_eq!(ops_thr(&mut bench, &normal(STARTING, AUTO_STOP, 1)), (RUN_OPS, 160));
    assert_eq!(*bench.machine.report(), report);
    assert_eq!(bench.machine.counters().damaged_frames, 1);
    // The next is believed again.
    assert_eq!(ops_thr(&mut bench, &normal(FULL_OPERATION, RUN, 101)), (RUN_OPS, 160));
    assert_eq!(bench.machine.report().rpm_raw.unwrap().value, 101);
}

/// A fault between two frames (a line that floats while the ECU powers up) damages none of them: the set-up set is
/// the first frame behind it.
#[test]
fn amt_9_a_line_error_before_the_setup_set_does_not_cost_it() {
    let mut bench = default();
    bench.machine.line_error(LineError::Framing);
    bench.receive(&[0x00]); // what the floating line left
    reply_to(&mut bench, &setup("9.35 140617 "));
    assert!(bench.event_kinds().contains(&Event::EcuStarted));
}

/// A byte that is lost with its fault damages the frame that it was in, and not the next: after noise the first set is believed.
#[test]
fn amt_1_a_lost_byte_does_not_cost_the_next_set() {
    let mut bench = running();
    for begun in [&[][..], &[0xFF, 0x21, 1]] {
        bench.receive(begun);
        for _ in 0..20 {
            bench.machine.byte_lost(LineError::Framing);
        }
        let rpm = 101 + begun.len() as u8;
        assert_eq!(ops_thr(&mut bench, &normal(FULL_OPERATION, RUN, rpm)), (RUN_OPS, 160));
        assert_eq!(bench.machine.report().rpm_raw.unwrap().value, rpm);
    }
    assert_eq!(bench.machine.counters().damaged_frames, 0);
}

/// A fault in a set that is cut off damages that one, and not the next.
#[test]
fn amt_1_a_fault_in_a_set_that_is_cut_off_does_not_cost_the_next() {
    let mut bench = running();
    bench.receive(&[0xFF, 0x21]);
    bench.machine.line_error(LineError::Framing);
    bench.receive(&[7]);
    assert_eq!(ops_thr(&mut bench, &normal(FULL_OPERATION, RUN, 101)), (RUN_OPS, 160));
    assert_eq!(bench.machine.report().rpm_raw.unwrap().value, 101);
    // One that was seen since may be in the next.
    bench.receive(&[0xFF, 0x21]);
    bench.machine.line_error(LineError::Framing);
    assert_eq!(ops_thr(&mut bench, &normal(FULL_OPERATION, RUN, 102)), (RUN_OPS, 160));
    assert_eq!(bench.machine.report().rpm_raw.unwrap().value, 101);
}

/// AMT-1: frames cut off, texts without an end, noise and what the UART saw are counted.
#[test]
fn amt_1_line_faults_are_counted() {
    let mut bench = default();
    bench.receive(&[1, 2, 3]);
    bench.receive(&[0xFF, 1, 2]);
    bench.receive(&setup("9,35 140617 "));
    for error in [LineError::Framing, LineError::Noise, LineError::Noise, LineError::Overrun, LineError::Read]
    {
        bench.machine.line_error(error);
    }
    bench.machine.line_error(LineError::Parity);
    let counters = bench.machine.counters();
    assert_eq!((counters.truncated, counters.frames, counters.bytes_skipped), (2, 0, 3 + 3 + 17));
    assert_eq!((counters.framing_errors, counters.noise_errors, counters.overruns), (1, 2, 1));
    assert_eq!((counters.read_errors, counters.parity_errors), (1, 1));
}

// ---------------------------------------------------------------------------------------------
// Any schedule
// ---------------------------------------------------------------------------------------------

#[derive(Clone, Debug)]
enum Step {
    Frame(Vec<u8>),
    Noise(Vec<u8>),
    Order(Order),
    Ctf,
    Timeout,
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        6 => (0..=0xFEu8, prop::collection::vec(0..=0xFEu8, 4))
            .prop_filter("set-up sets are longer", |(data1, _)| *data1 != 0x05)
            .prop_map(|(data1, rest)| Step::Frame([vec![0xFF, data1], rest].concat())),
        1 => Just(Step::Frame(setup("10.35 200131 "))),
        1 => prop::collection::vec(any::<u8>(), 1..8).prop_map(Step::Noise),
        1 => (0..=1000u16).prop_map(|tenths| Step::Order(throttle(tenths))),
        1 => prop_oneof![Just(Order::Standby), Just(Order::EmergencyStop)].prop_map(Step::Order),
        1 => Just(Step::Ctf),
        1 => Just(Step::Timeout),
    ]
}

proptest! {
    /// AMT-11: whatever comes whenever: never two replies at once (the bench checks it), each frame has a reply or
    /// counts as missed, a reply is handed out in time to end within its window, an emergency stop rules all
    /// replies behind it, and silence yields "lost" exactly once.
    #[test]
    fn amt_11_any_schedule(
        baud in prop::sample::select(&Line::BAUD_RATES[..]),
        steps in prop::collection::vec((0..60_000u64, step()), 1..60),
    ) {
        let line = Line::new(baud);
        let mut bench = Bench::new(AmtLink::new(Config::DEFAULT, line, Config::TIMING), line);
        // While nothing is ordered some frames get no answer.
        bench.order(0, Order::Standby).unwrap();
        let (mut stopped, mut runs) = (false, false);
        for (wait, step) in steps {
            let t = bench.now() + wait;
            bench.run_to(t);
            // Replies that became due on the way were composed under the order so far.
            check_replies(&mut bench, line, stopped)?;
            match step {
                Step::Frame(bytes) | Step::Noise(bytes) => bench.receive(&bytes),
                Step::Order(order) => {
                    bench.order(t, order).unwrap();
                    stopped = order == Order::EmergencyStop;
                    runs = matches!(order, Order::Run(_));
                }
                Step::Ctf => {
                    let answer = bench.act(|link, now| link.service(now, ctf()));
                    prop_assert_eq!(answer.is_ok(), runs);
                }
                Step::Timeout => bench.timeout_at(t),
            }
            check_replies(&mut bench, line, stopped)?;
        }
        bench.run_to(bench.now() + 100_000);
        check_replies(&mut bench, line, stopped)?;
        let counters = bench.machine.counters();
        prop_assert_eq!(counters.sent + counters.replies_missed, counters.frames);
        prop_assert_eq!(counters.replies_late, 0);
        bench.events();
        let was_lost = bench.machine.state() == LinkState::Lost;
        bench.run_to(bench.now() + 10_000_000);
        let lost = bench.event_kinds().into_iter().filter(|event| *event == Event::LinkLost).count();
        prop_assert_eq!(bench.machine.state(), LinkState::Lost);
        prop_assert_eq!(lost, usize::from(!was_lost));
        prop_assert_eq!(bench.frames(), vec![], "nothing is sent into silence");
    }

    /// Any timing of a link: up after exactly so many frames, lost to the tick.
    #[test]
    fn any_presence_timing(up_after in 1..=20u8, lost_after in 1_000..5_000_000u64) {
        let timing = Timing { up_after, lost_after: micros(lost_after) };
        let mut bench = Bench::new(AmtLink::new(Config::DEFAULT, Line::new(115_200), timing), Line::new(115_200));
        for i in 1..=u64::from(up_after) {
            prop_assert_eq!(bench.machine.state(), LinkState::Silent);
            bench.rx(i * (lost_after - 1), &normal(CLEARANCE, AUTO_STOP, 0));
        }
        prop_assert_eq!(bench.machine.state(), LinkState::Up);
        bench.events();
        let last = u64::from(up_after) * (lost_after - 1);
        bench.run_to(last + lost_after - 1);
        prop_assert_eq!(bench.event_kinds(), vec![]);
        bench.run_to(last + lost_after);
        prop_assert_eq!(bench.event_kinds(), vec![Event::LinkLost]);
    }
}

fn check_replies(bench: &mut Bench<AmtLink>, line: Line, stopped: bool) -> Result<(), TestCaseError> {
    for (at, reply) in bench.transmissions() {
        let bytes = reply.as_bytes();
        prop_assert_eq!((bytes.len(), bytes[0]), (5, 0xFF));
        prop_assert_eq!(&bytes[1..3], &bytes[3..5]);
        prop_assert!(
            [STOP_OPS, AUTO_OPS, RUN_OPS, CTF_OPS].contains(&bytes[1]) && (32..=232).contains(&bytes[2])
        );
        prop_assert!(!stopped || bytes[1..3] == [STOP_OPS, 32], "{:02x?}", bytes);
        let start_by = reply.start_by.expect("a reply has a window").as_micros();
        prop_assert!(at <= start_by);
        prop_assert!(start_by + line.time_of(5).as_micros() <= at + 30_000);
    }
    Ok(())
}

/// AMT-14, AMT-8: going on after a reset with an ECU that sends nothing but error sets does not dip its throttle, as long
/// as its exhaust burns. The control: with a cold one nothing goes out.
#[test]
fn amt_14_going_on_among_error_sets_keeps_the_throttle() {
    let reset = || engine_after(Config::DEFAULT, Some(RetainedState::new(throttle(640), Origin::Rc)));
    let mut bench = reset();
    assert_eq!(answer(&mut bench, &hot(error(0x20))), None, "one hot set is not believed");
    for _ in 0..2 {
        assert_eq!(answer(&mut bench, &hot(error(0x20))), Some((RUN_OPS, 128)));
    }
    let mut bench = reset();
    let cold = [answer(&mut bench, &error(0x20)), answer(&mut bench, &error(0x20))];
    assert!(cold.iter().flatten().all(|(ops, _)| *ops != RUN_OPS), "{cold:?}");
    // A state without a name with the shaft turning goes on at once, and without it not.
    assert_eq!(answer(&mut reset(), &hot(normal(0b11111, RUN, 100))), Some((RUN_OPS, 128)));
    assert_eq!(answer(&mut reset(), &hot(normal(0b11111, RUN, 19))), None);
}

/// One odd set neither makes a fault of nothing nor another switch; two in a row do.
#[test]
fn one_odd_set_changes_nothing() {
    for odd in [error(0x04), normal(FULL_OPERATION, AUTO_STOP, 100)] {
        let mut bench = running();
        let before = *bench.machine.report();
        reply_to(&mut bench, &odd);
        let after = *bench.machine.report();
        assert_eq!(after.faults.map(|f| f.value), before.faults.map(|f| f.value));
        assert_eq!(after.switch.map(|s| s.value), before.switch.map(|s| s.value));
        reply_to(&mut bench, &odd);
        let after = *bench.machine.report();
        let changed = after.faults.map(|f| f.value) != before.faults.map(|f| f.value)
            || after.switch.map(|s| s.value) != before.switch.map(|s| s.value);
        assert!(changed, "{odd:02x?}");
    }
}
