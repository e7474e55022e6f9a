//! What a reply commands.

use super::*;

/// AMT-10: each order on the wire.
#[test]
fn amt_10_each_order_has_its_switch_on_the_wire() {
    let mut bench = running();
    let frame = normal(FULL_OPERATION, RUN, 100);
    for (order, ops, half_percents) in [
        (throttle_tenths(0), RUN_OPS, 0),
        (throttle_tenths(1000), RUN_OPS, 200),
        (throttle_tenths(499), RUN_OPS, 99), // never rounded up
        (Order::Standby, AUTO_OPS, 0),
        (throttle_tenths(5), RUN_OPS, 1),
        (Order::EmergencyStop, STOP_OPS, 0),
    ] {
        bench.order_at_us(bench.now_us(), order).unwrap();
        assert_eq!(ops_thr(&mut bench, &frame), (ops, half_percents), "{order:?}");
    }
}

/// While nothing is in force, and while the life of the engine is in doubt, no frame of any kind gets a reply: an ECU
/// without replies does not start. It does not count as a missed reply.
#[test]
fn without_an_order_and_in_doubt_no_frame_is_answered() {
    let demand = Demand::Throttle(Throttle::FULL);
    for order in [Order::Listen, Order::Doubt(demand)] {
        for released in [false, true] {
            let mut bench = default();
            bench.act(|link, _| link.release(released));
            bench.order_at_us(0, order).unwrap();
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
            let counters = bench.machine.status().counters;
            assert_eq!((counters.frames, counters.sent, counters.replies_missed), (256, 0, 0));
            // The control: orders that are answered.
            for (order, expected) in
                [(Order::EmergencyStop, STOP_OPS), (Order::Standby, AUTO_OPS), (throttle_tenths(0), RUN_OPS)]
            {
                bench.order_at_us(bench.now_us(), order).unwrap();
                assert_eq!(answer(&mut bench, &normal(FULL_OPERATION, RUN, 100)), Some((expected, 0)));
            }
        }
    }
}

/// With no order in force an engine that two sets report running, with its shaft turning, continues at the throttle on which
/// they agree. The switch that the ECU reports does not start anything.
#[test]
fn an_engine_found_running_resumes_at_its_own_throttle() {
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
    // Consecutive sets, and the reply to each.
    let standby = Some((AUTO_OPS, 0));
    for (frames, replies) in [
        // A damaged set reports nothing.
        (vec![(true, at(normal(FULL_OPERATION, RUN, 100), 80)); 4], vec![None; 4]),
        // An engine at rest is put to standby, whatever its switch is.
        (vec![(false, at(normal(CLEARANCE, RUN, 0), 80)); 2], vec![None, standby]),
        (vec![(false, at(normal(NO_CLEARANCE, RUN, 0), 80)); 2], vec![None, standby]),
        (vec![(false, at(normal(STARTING, RUN, 10), 80)); 2], vec![None, standby]),
        // With a shaft below half of idle the engine does not run.
        (vec![(false, at(normal(FULL_OPERATION, RUN, 19), 80)); 4], vec![None; 4]),
        (vec![(false, at(normal(FULL_OPERATION, RUN, 20), 80)); 2], vec![None, Some((RUN_OPS, 80))]),
        // Faults alone report nothing about an unknown engine.
        (vec![(false, at(hot(error(0x01)), 80)); 4], vec![None; 4]),
        (vec![(false, alternate(0x06)); 4], vec![None; 4]),
    ] {
        let mut bench = engine_after(Config::DEFAULT, None);
        for ((damaged, frame), reply) in frames.iter().zip(replies) {
            bench.run_to_us(bench.now_us() + FRAME_PERIOD_US / 2);
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

/// There is no checksum: one odd set that reports at rest is not answered, and neither ends a run nor keeps the next good set
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
    // The control: two in a row end it.
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
fn an_amt_ecu_refuses_an_rpm() {
    assert_eq!(default().machine.speed_control(), Err(Rejected::NoSpeedControl));
}

/// An emergency stop is in the very next reply, also in one that waits for a transmission to end.
#[test]
fn an_emergency_stop_is_in_the_next_reply() {
    let frame = normal(FULL_OPERATION, RUN, 100);
    let mut bench = running();
    assert_eq!(ops_thr(&mut bench, &frame), (RUN_OPS, 160));
    let t = bench.now_us();
    bench.rx_at_us(t + 15_000, &frame); // the reply to the first is still going out
    bench.order_at_us(t + 16_000, Order::EmergencyStop).unwrap();
    bench.run_to_us(t + 40_000);
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
    bench.run_to_us(bench.now_us() + FRAME_PERIOD_US); // the reply before is out
    let now = at_us(bench.now_us());
    let link = &mut bench.machine;
    // At once, without the drain that the bench does between two inputs.
    Link::receive(link, now, &normal(FULL_OPERATION, RUN, 100));
    link.order(now, Order::EmergencyStop).unwrap();
    Link::compose(link);
    let reply = loop {
        match Link::poll(link) {
            Output::Transmit(reply) => break reply,
            Output::Event(_) => {}
            Output::Wait(_) => panic!("a reply is due"),
        }
    };
    assert_eq!(reply.as_bytes(), control(STOP_OPS, 0));
}

/// AMT-13: CTF goes out when commanded by name, reported once, until standby or a stop; where nothing is ordered to run it is
/// refused.
#[test]
fn amt_13_only_the_service_command_sends_ctf() {
    let frame = normal(FULL_OPERATION, RUN, 100);
    let mut bench = running();
    assert_eq!(ops_thr(&mut bench, &frame).0, RUN_OPS);
    bench.act(|link, now| link.service(now, ctf())).unwrap();
    bench.events();
    for _ in 0..20 {
        assert_eq!(ops_thr(&mut bench, &frame).0, CTF_OPS);
    }
    assert_eq!(bench.event_kinds(), [Event::ServiceSent(ctf())]);
    bench.order_at_us(bench.now_us(), throttle_tenths(300)).unwrap();
    assert_eq!(ops_thr(&mut bench, &frame).0, CTF_OPS, "a source that streams demands does not call it off");
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    assert_eq!(ops_thr(&mut bench, &frame), (AUTO_OPS, 0), "a normal stop is never CTF");
    for (order, ops) in [(Order::EmergencyStop, STOP_OPS), (Order::Standby, AUTO_OPS)] {
        bench.order_at_us(bench.now_us(), order).unwrap();
        assert_eq!(bench.act(|link, now| link.service(now, ctf())), Err(Rejected::NotOrderedToRun));
        assert_eq!(ops_thr(&mut bench, &frame), (ops, 0));
    }
    bench.order_at_us(bench.now_us(), throttle_tenths(300)).unwrap();
    assert_eq!(ops_thr(&mut bench, &frame).0, RUN_OPS, "nothing of it is left for the next start");
}

/// AMT-13: no order, frame or silence causes a CTF.
#[test]
fn amt_13_no_order_sends_ctf() {
    for order in [Order::Standby, Order::EmergencyStop, throttle_tenths(700)] {
        let mut bench = running();
        bench.order_at_us(bench.now_us(), order).unwrap();
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
        bench.order_at_us(bench.now_us(), throttle_tenths(250)).unwrap();
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
fn amt_14_the_start_throttle_is_sent_until_full_operation() {
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
            (FULL_OPERATION, 70, 1, start), // AMT frames have no checksum: one is not taken
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

/// After a start the demand rises at 50 %/s, and never jumps to the stick.
#[test]
fn the_demand_rises_at_its_rate_after_a_start() {
    let mut bench = started(Config::DEFAULT, 800);
    for (state, rpm) in [(STARTING, 10), (FULL_OPERATION, 70)] {
        for _ in 0..2 {
            flown(&mut bench, 800, &hot(normal(state, RUN, rpm)));
        }
    }
    let began = bench.now_us();
    let mut before = 0;
    for _ in 0..20 {
        let (ops, half_percents) = flown(&mut bench, 800, &hot(normal(FULL_OPERATION, RUN, 70))).unwrap();
        // 50 %/s is a half percent every 10 ms.
        let most = ((bench.now_us() - began) / 10_000).min(160);
        assert_eq!(ops, RUN_OPS);
        assert!(u64::from(half_percents) <= most && half_percents >= before, "{half_percents} of {most}");
        assert!(u64::from(half_percents) + 4 >= most, "no slower either: {half_percents} of {most}");
        before = half_percents;
    }
    assert_eq!(before, 160);
}

/// AMT-14: one odd set does not drop the throttle of a running engine. If it reports at rest or starting again, its reply is
/// withheld, and two in a row end the run; idle calibration and "started up" in flight count as neither.
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

/// AMT-3: an unnamed state is stored, and does not drop the throttle of a running engine.
#[test]
fn amt_3_an_unknown_state_does_not_drop_the_throttle() {
    let unknown = hot(normal(0b10101, RUN, 100));
    let mut bench = flying();
    for _ in 0..10 {
        assert_eq!(flown(&mut bench, 800, &unknown), Some((RUN_OPS, 160)));
    }
    let report = bench.machine.telemetry(at_us(bench.now_us())).report;
    assert_eq!(report.phase.unwrap().value, Phase::Unknown);
    let state = report.state.unwrap().value;
    assert_eq!((state.code, state.name), (0b10101, "unknown"));
    // But an engine that was never in full operation is not released by one.
    let mut bench = started(Config::DEFAULT, 800);
    for _ in 0..10 {
        assert_eq!(flown(&mut bench, 800, &unknown), Some((RUN_OPS, 0)));
    }
}

/// AMT-2: error and alternate sets and unknown kinds report nothing about the state, and do not drop the throttle of an
/// engine with a hot exhaust. Faults with a cold exhaust end the run.
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
        error(0x08), // EGT error: its value means nothing
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

/// AMT-12: an engine whose ECU falls silent for three sets is in doubt. One that is received again, running, is answered at
/// once, with the throttle where it was; after more than its serial delay time it needs two sets.
#[test]
fn amt_12_a_gap_puts_the_life_in_doubt() {
    let good = hot(normal(FULL_OPERATION, RUN, 100));
    let starting = hot(normal(STARTING, RUN, 10));
    let silence = |bench: &mut Bench<BenchEngine>, micros: u64| {
        let end = bench.now_us() + micros - FRAME_PERIOD_US;
        bench.run_to_us(bench.now_us() + 50_000); // the reply before is out
        bench.frames();
        while bench.now_us() + 100_000 < end {
            let _ = command(bench, run_at_tenths(800));
            bench.run_to_us(bench.now_us() + 100_000);
        }
        bench.run_to_us(end);
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

/// The wire is cut in the middle of a set and mended in the middle of another one. With its state from before, a set joined from
/// both would report running, whatever the ECU has done meanwhile, and be answered with run.
#[test]
fn bytes_from_before_a_pause_are_not_part_of_a_set_after_it() {
    let good = hot(normal(FULL_OPERATION, RUN, 100));
    for (pause, answered) in [(20_000, true), (100_000, false), (1_000_000, false)] {
        let mut bench = flying();
        bench.run_to_us(bench.now_us() + FRAME_PERIOD_US);
        bench.frames();
        bench.receive(&good[..4]);
        let end = bench.now_us() + pause;
        while bench.now_us() < end {
            let _ = command(&mut bench, run_at_tenths(800));
            bench.run_to_us(end.min(bench.now_us() + 100_000));
        }
        bench.receive(&good[4..]);
        assert_eq!(!bench.frames().is_empty(), answered, "after {pause} us");
        // The next whole set is answered.
        assert_eq!(answer(&mut bench, &good), Some((RUN_OPS, 160)), "after {pause} us");
    }
}

/// AMT-3: the observation from each kind of set about the life of the engine.
#[test]
fn each_set_gives_the_observation_of_its_state() {
    let state = |stage, rpm: u8| Observation::State {
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
        cases.push((with_throttle(hot(error(bits))), Observation::Faulted { throttle, egt }));
    }
    cases.push((alternate(0x18).to_vec(), Observation::Stateless));
    cases.push((vec![0xFF, 0x0B, 1, 2, 3, 4], Observation::Stateless));
    cases.push((setup("9.35 140617 "), Observation::PowerUp));
    for (frame, observation) in cases {
        let mut bench = default();
        assert_eq!(bench.machine.take_observation(), None);
        reply_to(&mut bench, &frame);
        assert_eq!(bench.machine.take_observation(), Some(observation), "{frame:02x?}");
        assert_eq!(bench.machine.take_observation(), None, "once");
        bench.machine.line_error(LineError::Noise);
        reply_to(&mut bench, &frame);
        assert_eq!(bench.machine.take_observation(), Some(Observation::Damaged), "{frame:02x?}");
    }
}

/// A gap begins 375 ms after the last set, three of its intervals. Damaged sets prevent it, for 10 s; single bytes and a
/// steady babble do not.
#[test]
fn three_missing_sets_are_a_gap() {
    let frame = normal(FULL_OPERATION, RUN, 100);
    let gap = |bench: &Bench<AmtLink>| bench.machine.gap_at().map(|at| at.as_micros());
    let mut bench = default();
    assert_eq!(gap(&bench), Some(375_000), "it counts from the start of the node");
    bench.rx_at_us(1_000_000, &frame);
    assert_eq!(gap(&bench), Some(1_375_000));
    bench.machine.line_error(LineError::Framing);
    bench.rx_at_us(1_125_000, &frame);
    assert_eq!(gap(&bench), Some(1_500_000), "a damaged set prevents the gap");
    bench.rx_at_us(1_250_000, &[0x12, 0x34, 0x56]);
    assert_eq!(gap(&bench), Some(1_500_000), "three bytes are no set");
    for step in 3..200u64 {
        let t = 1_000_000 + step * FRAME_PERIOD_US;
        bench.machine.line_error(LineError::Framing);
        bench.rx_at_us(t, &frame);
        let beats = if t < 11_000_000 { t } else { 1_000_000 + 79 * FRAME_PERIOD_US };
        assert_eq!(gap(&bench), Some(beats + 375_000), "{t}");
    }
    bench.act(|link, _| link.gap());
    assert_eq!(gap(&bench), None, "it is announced once");
    let t = bench.now_us() + FRAME_PERIOD_US;
    bench.rx_at_us(t, &frame);
    assert_eq!(gap(&bench), Some(t + 375_000));
    // A steady babble prevents no gap beyond its first burst.
    for byte in 1..=1000u64 {
        bench.rx_at_us(t + 40_000 + byte * 4_167, &[0x55]);
    }
    assert!(gap(&bench).unwrap() < t + 500_000);
}

/// An order that an AMT ECU cannot follow is refused, and the previous one stays on the wire.
#[test]
fn refused_orders_change_nothing() {
    let frame = normal(FULL_OPERATION, RUN, 100);
    let mut bench = running();
    let rpm = Order::Run(Demand::Rpm(Rpm::new(30_000)));
    assert_eq!(bench.order_at_us(bench.now_us(), rpm), Err(Rejected::NoSpeedControl));
    assert_eq!(bench.order_at_us(bench.now_us(), Order::Pwm), Err(Rejected::NotSupported));
    let zk = Service::Zk(ZkService::Action(zk::codec::Action::Drain));
    assert_eq!(bench.act(|link, now| link.service(now, zk)), Err(Rejected::NotSupported));
    assert_eq!(ops_thr(&mut bench, &frame), (RUN_OPS, 160));
}
