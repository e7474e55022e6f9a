//! Properties of any schedule.

use super::*;

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        6 => (0..=0xFEu8, prop::collection::vec(0..=0xFEu8, 4))
            .prop_filter("set-up sets are longer", |(data1, _)| *data1 != 0x05)
            .prop_map(|(data1, rest)| Step::Frame([vec![0xFF, data1], rest].concat())),
        1 => Just(Step::Frame(setup("10.35 200131 "))),
        1 => prop::collection::vec(any::<u8>(), 1..8).prop_map(Step::Noise),
        1 => (0..=1000u16).prop_map(|tenths| Step::Order(throttle_tenths(tenths))),
        1 => prop_oneof![Just(Order::Standby), Just(Order::EmergencyStop)].prop_map(Step::Order),
        1 => Just(Step::Ctf),
        1 => Just(Step::Timeout),
    ]
}

proptest! {
    /// AMT-11: in any schedule: never two replies at once (the bench checks it), each frame has a reply or counts
    /// as missed, a reply is handed out in time to end within its window, an emergency stop precedes all later
    /// replies, and silence yields "lost" exactly once.
    #[test]
    fn amt_11_in_any_schedule_each_frame_gets_at_most_one_reply_in_time(
        baud in prop::sample::select(&Line::BAUD_RATES[..]),
        steps in prop::collection::vec((0..60_000u64, step()), 1..60),
    ) {
        let line = Line::new(baud);
        let mut bench = Bench::new(AmtLink::new(Config::DEFAULT, line, Config::TIMING), line);
        // While nothing is ordered some frames get no answer.
        bench.order_at_us(0, Order::Standby).unwrap();
        let (mut stopped, mut runs) = (false, false);
        for (wait, step) in steps {
            let t = bench.now_us() + wait;
            bench.run_to_us(t);
            // Replies that became due on the way were composed under the order so far.
            check_replies(&mut bench, line, stopped)?;
            match step {
                Step::Frame(bytes) | Step::Noise(bytes) => bench.receive(&bytes),
                Step::Order(order) => {
                    bench.order_at_us(t, order).unwrap();
                    stopped = order == Order::EmergencyStop;
                    runs = matches!(order, Order::Run(_));
                }
                Step::Ctf => {
                    let answer = bench.act(|link, now| link.service(now, ctf()));
                    prop_assert_eq!(answer.is_ok(), runs);
                }
                Step::Timeout => bench.timeout_at_us(t),
            }
            check_replies(&mut bench, line, stopped)?;
        }
        bench.run_to_us(bench.now_us() + 100_000);
        check_replies(&mut bench, line, stopped)?;
        let counters = bench.machine.status().counters;
        prop_assert_eq!(counters.sent + counters.replies_missed, counters.frames);
        prop_assert_eq!(counters.replies_late, 0);
        bench.events();
        let was_lost = bench.machine.status().state == LinkState::Lost;
        bench.run_to_us(bench.now_us() + 10_000_000);
        let lost = bench.event_kinds().into_iter().filter(|event| *event == Event::LinkLost).count();
        prop_assert_eq!(bench.machine.status().state, LinkState::Lost);
        prop_assert_eq!(lost, usize::from(!was_lost));
        prop_assert_eq!(bench.frames(), vec![], "nothing is sent into silence");
    }

    /// Any timing of a link: up after exactly the set number of frames, lost to the tick.
    #[test]
    fn any_link_timing_is_exact_to_the_tick(up_after in 1..=20u8, lost_after in 1_000..5_000_000u64) {
        let timing = Timing { up_after, lost_after: micros(lost_after) };
        let mut bench = Bench::new(AmtLink::new(Config::DEFAULT, Line::new(115_200), timing), Line::new(115_200));
        for i in 1..=u64::from(up_after) {
            prop_assert_eq!(bench.machine.status().state, LinkState::Silent);
            bench.rx_at_us(i * (lost_after - 1), &normal(CLEARANCE, AUTO_STOP, 0));
        }
        prop_assert_eq!(bench.machine.status().state, LinkState::Up);
        bench.events();
        let last = u64::from(up_after) * (lost_after - 1);
        bench.run_to_us(last + lost_after - 1);
        prop_assert_eq!(bench.event_kinds(), vec![]);
        bench.run_to_us(last + lost_after);
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

/// AMT-14, AMT-8: after a reset, with an ECU that sends only error sets, the throttle does not dip as long as the exhaust
/// is hot. The control: with a cold one nothing is sent.
#[test]
fn amt_14_a_run_resumed_among_error_sets_keeps_the_throttle() {
    let reset = || engine_after(Config::DEFAULT, Some(RetainedState::new(throttle_tenths(640), Origin::Rc)));
    let mut bench = reset();
    assert_eq!(answer(&mut bench, &hot(error(0x20))), None, "one hot set is not taken");
    for _ in 0..2 {
        assert_eq!(answer(&mut bench, &hot(error(0x20))), Some((RUN_OPS, 128)));
    }
    let mut bench = reset();
    let cold = [answer(&mut bench, &error(0x20)), answer(&mut bench, &error(0x20))];
    assert!(cold.iter().flatten().all(|(ops, _)| *ops != RUN_OPS), "{cold:?}");
    // An unnamed state resumes at once if the shaft turns, and not otherwise.
    assert_eq!(answer(&mut reset(), &hot(normal(0b11111, RUN, 100))), Some((RUN_OPS, 128)));
    assert_eq!(answer(&mut reset(), &hot(normal(0b11111, RUN, 19))), None);
}

/// One odd set causes neither a fault nor another switch; two in a row do.
#[test]
fn one_odd_set_changes_nothing() {
    for odd in [error(0x04), normal(FULL_OPERATION, AUTO_STOP, 100)] {
        let mut bench = running();
        let before = bench.machine.status().report;
        reply_to(&mut bench, &odd);
        let after = bench.machine.status().report;
        assert_eq!(after.faults.map(|f| f.value), before.faults.map(|f| f.value));
        assert_eq!(after.switch.map(|s| s.value), before.switch.map(|s| s.value));
        reply_to(&mut bench, &odd);
        let after = bench.machine.status().report;
        let changed = after.faults.map(|f| f.value) != before.faults.map(|f| f.value)
            || after.switch.map(|s| s.value) != before.switch.map(|s| s.value);
        assert!(changed, "{odd:02x?}");
    }
}
