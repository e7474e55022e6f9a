//! The reply, and its window.

use super::*;

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
    let counters = bench.machine.status().counters;
    bench.run_to_us(bench.now_us() + 30_000);
    assert_eq!((counters.frames, counters.replies_missed), (12, 0));
    assert_eq!(bench.machine.status().counters.sent, 12);
}

/// AMT-11: no reply without a frame.
#[test]
fn amt_11_nothing_is_sent_without_a_frame() {
    let mut bench = default();
    bench.order_at_us(0, Order::EmergencyStop).unwrap();
    bench.run_to_us(10_000_000); // silence
    bench.rx_at_us(10_000_000, &[0x00, 0x7F, 0xFE]); // noise
    bench.rx_at_us(11_000_000, &normal(FULL_OPERATION, RUN, 100)[..5]); // a frame but for its last byte
    bench.rx_at_us(12_000_000, &[0xFF, 0xFF, 0xFF]); // leaders
    bench.rx_at_us(19_990_000, &[0xFF]);
    bench.run_to_us(20_000_000);
    assert_eq!(bench.frames(), []);
    assert_eq!(bench.machine.status().counters.replies_missed, 0);
    // The rest of a frame completes it, and the reply follows.
    bench.rx_at_us(20_000_000, &normal(FULL_OPERATION, RUN, 100)[1..]);
    assert_eq!(bench.frames(), [(20_000_000, control(STOP_OPS, 0).to_vec())]);
}

/// AMT-11: the last stop bit is sent within 30 ms, less the guard, at every baud rate. At 2400 baud the first
/// start bit has 9.1 ms.
#[test]
fn amt_11_the_first_start_bit_leaves_time_for_the_last_stop_bit() {
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
        bench.rx_at_us(700_000, &normal(CLEARANCE, AUTO_STOP, 0));
        let sent = bench.transmissions();
        let start_by: Vec<_> = sent.iter().map(|(_, frame)| frame.start_by).collect();
        let expected: Vec<_> = slack.map(|slack| Some(at_us(700_000 + slack))).into_iter().collect();
        assert_eq!(start_by, expected, "{baud} {guard}");
        assert_eq!(bench.machine.status().counters.replies_missed, u32::from(slack.is_none()));
    }
}

/// AMT-11: a frame that comes while a reply is still going out is answered after it, if that is in time.
#[test]
fn amt_11_a_frame_during_a_transmission_is_answered_after_it() {
    let frame = normal(CLEARANCE, AUTO_STOP, 0);
    // baud, second frame, its reply or None if missed, and the reply's `start_by`
    for (baud, second, reply) in [
        // The first reply takes 5209 µs.
        (9600, 3_000, Some((5_209, 3_000 + 24_291))),
        (9600, 5_208, Some((5_209, 5_208 + 24_291))),
        // It takes 20 834 µs, and the second reply would have to begin 8666 µs after its frame.
        (2400, 12_167, None),
        (2400, 12_168, Some((20_834, 12_168 + 8_666))),
        (2400, 20_000, Some((20_834, 20_000 + 8_666))),
    ] {
        let line = Line::new(baud);
        let mut bench = amt(Config::DEFAULT, line);
        bench.receive(&frame);
        bench.rx_at_us(second, &frame);
        assert_eq!(bench.transmissions().len(), 1, "one at a time");
        bench.run_to_us(100_000);
        let second_reply: Vec<_> = bench
            .transmissions()
            .iter()
            .map(|(at, frame)| (*at, frame.start_by.unwrap().as_micros()))
            .collect();
        assert_eq!(second_reply, reply.into_iter().collect::<Vec<_>>(), "{baud} {second}");
        let counters = bench.machine.status().counters;
        assert_eq!(counters.replies_missed, u32::from(reply.is_none()), "{baud} {second}");
        assert_eq!(counters.sent + counters.replies_missed, counters.frames);
    }
}

/// AMT-11: of several frames during one transmission the last is answered, the others count as missed.
#[test]
fn amt_11_of_several_frames_during_a_transmission_the_last_is_answered() {
    let frame = normal(CLEARANCE, AUTO_STOP, 0);
    let mut bench = amt(Config::DEFAULT, SLOW);
    for t in [0, 5_000, 10_000, 15_000] {
        bench.rx_at_us(t, &frame);
    }
    bench.event_kinds();
    bench.run_to_us(100_000);
    let at: Vec<u64> = bench.frames().into_iter().map(|(at, _)| at).collect();
    assert_eq!(at, [0, 20_834]);
    let counters = bench.machine.status().counters;
    assert_eq!((counters.frames, counters.sent, counters.replies_missed), (4, 2, 2));
}

/// AMT-11: an unsent reply is counted and reported, and the next frame is answered.
#[test]
fn amt_11_a_reply_that_was_not_sent_is_counted_and_not_repeated() {
    for (why, write_timeouts, write_errors) in
        [(NotSent::TooLate, 0, 0), (NotSent::TimedOut, 1, 0), (NotSent::Failed, 0, 1)]
    {
        let mut bench = default().by_hand();
        bench.rx_at_us(100_000, &normal(CLEARANCE, AUTO_STOP, 0));
        assert_eq!(bench.frames().len(), 1);
        bench.not_sent_at_us(110_000, why);
        assert_eq!(bench.frames(), [], "not again");
        assert_eq!(bench.event_kinds(), [Event::NotSent(why)]);
        let counters = bench.machine.status().counters;
        assert_eq!((counters.sent, counters.replies_missed), (0, 1));
        assert_eq!((counters.write_timeouts, counters.write_errors), (write_timeouts, write_errors));
        bench.rx_at_us(225_000, &normal(CLEARANCE, AUTO_STOP, 0));
        assert_eq!(bench.frames(), [(225_000, control(AUTO_OPS, 0).to_vec())]);
        bench.sent_at_us(246_000);
        assert_eq!(bench.machine.status().counters.sent, 1);
    }
}

/// AMT-11: the smallest margin in the window is recorded; a reply that ended late is counted.
#[test]
fn amt_11_the_smallest_margin_of_the_window_is_counted() {
    let mut bench = default().by_hand();
    // frame, last stop bit of its reply; worst margin so far, late ones so far
    for (frame, sent, worst, late) in [
        (1_000_000, 1_020_834, Some(9_166), 0),
        (1_125_000, 1_150_000, Some(5_000), 0),
        (1_250_000, 1_270_900, Some(5_000), 0),
        (1_375_000, 1_405_000, Some(0), 0),
        (1_500_000, 1_530_001, Some(0), 1),
    ] {
        bench.rx_at_us(frame, &normal(CLEARANCE, AUTO_STOP, 0));
        bench.sent_at_us(sent);
        let counters = bench.machine.status().counters;
        assert_eq!(counters.worst_reply_margin, worst.map(micros), "{frame}");
        assert_eq!(counters.replies_late, late, "{frame}");
    }
}

/// AMT-12: a minute of the ECU's own stream at 2400 baud, one alternate set after ten normal ones: each frame has
/// its reply, and when the ECU falls silent so does the host, so that the ECU's own fail-safe works.
#[test]
fn amt_12_the_stream_is_answered_frame_by_frame() {
    let mut bench = default();
    bench.order_at_us(0, throttle_tenths(300)).unwrap();
    let frames = 8 * 60;
    for i in 1..=frames {
        let frame = if i % 11 == 0 { alternate(0x18) } else { normal(FULL_OPERATION, RUN, 90) };
        bench.rx_at_us(i * FRAME_PERIOD_US, &frame);
        assert_eq!(bench.frames().len(), 1);
    }
    bench.run_to_us(3_600_000_000);
    assert_eq!(bench.frames(), [], "silence answers silence");
    let counters = bench.machine.status().counters;
    assert_eq!((u64::from(counters.sent), counters.replies_missed, counters.replies_late), (frames, 0, 0));
}
