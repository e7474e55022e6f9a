//! An emergency stop on the wire.

use super::*;
use jetlink::link::LinkRecord;

/// ZK-8: an emergency stop goes out at once, out of slot, and again in every slot.
#[test]
fn zk_8_an_emergency_stop_does_not_wait_for_its_slot() {
    let mut bench = running(3);
    bench.order_at_us(60_000, throttle_tenths(900)).unwrap();
    bench.run_to_us(120_000);
    bench.frames();
    bench.order_at_us(123_456, Order::EmergencyStop).unwrap();
    bench.run_to_us(250_000);
    let stop = zk::throttle_tenths(STOP, 0).to_vec();
    let expected: Vec<_> = [123_456, 150_000, 200_000, 250_000].map(|at| (at, stop.clone())).into();
    assert_eq!(bench.frames(), expected);
}

/// While a transmission is under way the stop goes out directly after it.
#[test]
fn an_emergency_stop_follows_a_running_transmission_at_once() {
    let mut bench = running(3);
    bench.order_at_us(60_000, throttle_tenths(900)).unwrap();
    bench.run_to_us(100_000); // the frame of this slot takes 4167 µs
    bench.frames();
    bench.order_at_us(101_000, Order::EmergencyStop).unwrap();
    bench.run_to_us(140_000);
    assert_eq!(bench.frames(), [(104_167, zk::throttle_tenths(STOP, 0).to_vec())]);
}

/// The same when that transmission fails.
#[test]
fn an_emergency_stop_follows_a_failed_transmission_at_once() {
    let mut bench = running(3).by_hand();
    bench.order_at_us(60_000, throttle_tenths(900)).unwrap();
    bench.run_to_us(100_000);
    bench.frames();
    bench.order_at_us(101_000, Order::EmergencyStop).unwrap();
    bench.not_sent_at_us(102_000, NotSent::Failed);
    assert_eq!(bench.frames(), [(102_000, zk::throttle_tenths(STOP, 0).to_vec())]);
}

/// ZK-9: in mode 3 the first frame of a stop is the one that the ECU obeys: ID 6 with RPM_X = 0.
#[test]
fn zk_9_an_emergency_stop_in_mode_3_begins_with_id_6() {
    for slots_before in 2..=5 {
        let mut bench = running(4);
        bench.order_at_us(bench.now_us(), rpm(100_000)).unwrap();
        slots(&mut bench, slots_before);
        let t = bench.now_us() + 17_000;
        bench.run_to_us(t); // the frame after a new RPM_X is also out
        bench.frames();
        bench.order_at_us(t, Order::EmergencyStop).unwrap();
        assert_eq!(bench.frames(), [(t, zk::mode(0, STOP).to_vec())], "{slots_before}");
    }
}

/// No rate, service, pressure or unlock takes the slot of a stop.
#[test]
fn an_emergency_stop_pre_empts_everything() {
    let mut bench = link(Config { rate: Rate::Hz50, ..Config::DEFAULT }, LINE);
    bench.receive(&zk::identity(160, 5, 0)); // at 20 Hz: the rate is not as wanted
    bench.receive(&zk::idle(30, true)); // requests pressure
    pressure(&mut bench, 1013);
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    service(&mut bench, curve(30)).unwrap();
    bench.order_at_us(bench.now_us(), Order::EmergencyStop).unwrap();
    // By ID 1, and in case that another host used it by ID 6.
    let stops = [zk::throttle_tenths(STOP, 0), zk::mode(0, STOP)];
    let frames = slots(&mut bench, 200);
    assert_eq!(frames[..2], stops);
    for frame in &frames {
        assert!(stops.iter().any(|stop| frame[..] == stop[..]), "{frame:02x?}");
    }
    for both in frames.windows(3) {
        assert!(ids(both).contains(&1) && ids(both).contains(&6), "{both:02x?}");
    }
}

/// ZK-8, ZK-9: from version 4 on a stop goes by ID 1 and ID 6 alternately: ID 6 first if the switch went there, else
/// ID 1.
#[test]
fn zk_9_an_emergency_stop_alternates_id_1_and_id_6() {
    for (before, first) in [(throttle_tenths(500), [1, 6]), (Order::Standby, [1, 6]), (rpm(80_000), [6, 1])] {
        for version in [4, 5] {
            let mut bench = running(version);
            bench.order_at_us(bench.now_us(), before).unwrap();
            slots(&mut bench, 4);
            bench.run_to_us(bench.now_us() + 20_000);
            bench.frames();
            bench.order_at_us(bench.now_us(), Order::EmergencyStop).unwrap();
            // Also when the ECU falls silent, and its version with it is forgotten.
            bench.run_to_us(bench.now_us() + 20 * SEND_SLOT_US);
            let frames = bench.bytes();
            for (at, frame) in frames.iter().enumerate() {
                let expected =
                    if first[at % 2] == 1 { zk::throttle_tenths(STOP, 0) } else { zk::mode(0, STOP) };
                assert_eq!(frame[..], expected, "version {version}, {before:?}: {:?}", ids(&frames));
            }
        }
    }
}

/// ZK-7, ZK-9: below version 4 a stop is ID 1 alone. Until two reports have confirmed the version, it is also sent as ID
/// 6, which lower versions ignore.
#[test]
fn zk_9_an_emergency_stop_below_version_4_is_id_1() {
    for version in [1, 3] {
        let mut bench = met_running(version);
        bench.order_at_us(bench.now_us(), Order::EmergencyStop).unwrap();
        for frame in slots(&mut bench, 10) {
            assert_eq!(frame, zk::throttle_tenths(STOP, 0), "{version:?}");
        }
    }
    for version in [None, Some(3), Some(4)] {
        let mut bench = link(Config::DEFAULT, LINE);
        bench.run_to_us(10_000); // the keep-alive of the first slot is out
        if let Some(version) = version {
            bench.receive(&zk::identity(160, version, 0));
        }
        bench.frames();
        bench.order_at_us(bench.now_us(), Order::EmergencyStop).unwrap();
        bench.run_to_us(1_000_000);
        let frames = bench.bytes();
        for (at, frame) in frames.iter().enumerate() {
            let expected = if at % 2 == 0 { zk::throttle_tenths(STOP, 0) } else { zk::mode(0, STOP) };
            assert_eq!(frame[..], expected, "{version:?}: {:?}", ids(&frames));
        }
    }
}

/// ZK-9: where ID 6 was used before a reset, as the record says, a standby and a stop are sent as ID 1 and ID 6
/// alternately, even if nothing is received. A run waits for the version (ZK-7).
#[test]
fn zk_9_after_a_reset_a_stop_and_a_standby_are_sent_in_id_1_and_id_6() {
    for (order, sw) in [(Order::Standby, STANDBY), (Order::EmergencyStop, STOP)] {
        let mut bench = link(Config::DEFAULT, LINE);
        bench.act(|link, _| link.restore(LinkRecord::new(1)));
        bench.run_to_us(10_000);
        bench.frames();
        bench.order_at_us(bench.now_us(), order).unwrap();
        bench.run_to_us(1_000_000);
        let frames = bench.bytes();
        assert_eq!(frames[..2], [zk::mode(0, sw), zk::throttle_tenths(sw, 0)], "{order:?}");
        for both in frames.windows(2) {
            assert_ne!(id(&both[0]), id(&both[1]), "{order:?}: {:?}", ids(&frames));
        }
        assert!(frames.iter().all(|frame| matches!(id(frame), 1 | 6)), "{order:?}: {:?}", ids(&frames));
    }
    let mut bench = link(Config::DEFAULT, LINE);
    bench.act(|link, _| link.restore(LinkRecord::new(1)));
    bench.order_at_us(bench.now_us(), throttle_tenths(300)).unwrap();
    assert_eq!(ids(&slots(&mut bench, 10))[1..], [1; 9], "version not known");
    // Without the record a standby is ID 1, and there is nothing to record.
    let mut bench = link(Config::DEFAULT, LINE);
    assert_eq!(bench.machine.record(), LinkRecord::EMPTY);
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    assert_eq!(ids(&slots(&mut bench, 10))[1..], [1; 9]);
}

/// ZK-9: which of two frames goes first, and that the frame affected by a new RPM_X follows it directly, out of
/// slot. ZK-8: a hand-over is sent in ID 1 before ID 6 releases the switch.
#[test]
fn zk_9_the_two_frames_of_an_order_are_sent_in_a_safe_sequence() {
    let (run, demand) = (throttle_tenths(300), rpm(80_000));
    for (split_switch, before, after, first) in [
        (true, Order::Standby, run, vec![zk::throttle_tenths(RUN, 300), zk::mode(0, RUN)]),
        (true, run, Order::Standby, vec![zk::mode(0, STANDBY), zk::throttle_tenths(STANDBY, 0)]),
        (true, run, Order::EmergencyStop, vec![zk::mode(0, STOP), zk::throttle_tenths(STOP, 0)]),
        (
            true,
            run,
            Order::Pwm,
            vec![zk::throttle_tenths(PWM, 0), zk::mode(0, PWM), zk::throttle_tenths(PWM, 0)],
        ),
        (
            false,
            demand,
            Order::Pwm,
            vec![zk::throttle_tenths(PWM, 0), zk::mode(0, PWM), zk::throttle_tenths(PWM, 0)],
        ),
        (false, run, Order::Pwm, vec![zk::throttle_tenths(PWM, 0), zk::throttle_tenths(PWM, 0)]),
        (false, run, demand, vec![zk::rpm(2000), zk::mode(4, RUN), zk::rpm(2000), zk::mode(4, RUN)]),
        (
            false,
            demand,
            run,
            vec![zk::throttle_tenths(RUN, 300), zk::mode(0, RUN), zk::throttle_tenths(RUN, 300)],
        ),
        (
            false,
            demand,
            Order::Standby,
            vec![zk::mode(0, STANDBY), zk::throttle_tenths(STANDBY, 0), zk::mode(0, STANDBY)],
        ),
        (
            false,
            demand,
            Order::EmergencyStop,
            vec![zk::mode(0, STOP), zk::throttle_tenths(STOP, 0), zk::mode(0, STOP)],
        ),
    ] {
        let mut bench = ecu_with(Config { split_switch, ..Config::DEFAULT }, 4, 160);
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        runs(&mut bench);
        bench.order_at_us(bench.now_us(), before).unwrap();
        slots(&mut bench, 5);
        bench.run_to_us(bench.now_us() + 20_000);
        bench.frames();
        bench.order_at_us(bench.now_us(), after).unwrap();
        bench.run_to_us(bench.now_us() + 5 * SEND_SLOT_US);
        let frames = bench.frames();
        let sent: Vec<_> = frames.iter().take(first.len()).map(|(_, frame)| &frame[..]).collect();
        assert_eq!(sent, first, "{before:?} to {after:?}");
        // An emergency stop begins at once.
        let mut slots = frames.iter().skip(usize::from(after == Order::EmergencyStop));
        let mut factor = if before == demand { 4 } else { 0 };
        let mut directly = None;
        if after == Order::EmergencyStop && before == demand {
            directly = Some(frames[0].0 + 4_167);
            factor = 0;
        }
        assert!(
            slots.all(|(at, frame)| {
                let expected = directly.take();
                if id(frame) == 6 && frame[2] >> 2 != factor {
                    factor = frame[2] >> 2;
                    // None for SW 0: ID 1 has carried it before.
                    directly = (frame[2] & 3 != PWM).then_some(at + 4_167);
                }
                expected.map_or(at % SEND_SLOT_US == 0, |expected| *at == expected)
            }),
            "{before:?} to {after:?}: {frames:02x?}"
        );
    }
}

/// ZK-9: nothing comes between an ID 6 with a new RPM_X and its partner, whatever is due.
#[test]
fn zk_9_nothing_comes_between_a_new_rpm_x_and_its_partner() {
    let mut bench = running(4);
    bench.receive(&zk::idle(30, true)); // requests pressure
    bench.order_at_us(bench.now_us(), rpm(100_000)).unwrap();
    bench.run_to_us(101_000); // the ID 6 of 100 ms is going out
    pressure(&mut bench, 1013);
    bench.run_to_us(140_000);
    let sent = [(50_000, zk::rpm(2500)), (100_000, zk::mode(4, RUN)), (104_167, zk::rpm(2500))];
    assert_eq!(bench.frames(), sent.map(|(at, frame)| (at, frame.to_vec())));
}

/// ZK-9: RPM_X is chosen when an rpm order begins, and stays until the order changes in kind.
#[test]
fn zk_9_rpm_x_stays_with_the_order() {
    let mut bench = running(4);
    let modes = |bench: &mut Bench<ZkLink>| -> Vec<u8> {
        slots(bench, 6).iter().filter(|frame| id(frame) == 6).map(|frame| frame[2] >> 2).collect()
    };
    bench.order_at_us(bench.now_us(), rpm(40_000)).unwrap();
    assert!(modes(&mut bench).iter().all(|x| *x == 4));
    for _ in 0..2 {
        bench.receive(&zk::identity(80, 4, 0));
    }
    assert_eq!(bench.machine.status().report.max_rpm.unwrap().value.get(), 80_000);
    assert!(modes(&mut bench).iter().all(|x| *x == 4));
    bench.order_at_us(bench.now_us(), rpm(50_000)).unwrap(); // a new number is no new order
    assert!(modes(&mut bench).iter().all(|x| *x == 4));
    bench.order_at_us(bench.now_us(), throttle_tenths(0)).unwrap();
    assert!(modes(&mut bench).iter().all(|x| *x == 0));
    bench.order_at_us(bench.now_us(), rpm(50_000)).unwrap();
    let modes = modes(&mut bench);
    assert!(!modes.is_empty() && modes.iter().all(|x| *x == 2), "{modes:?}");
}

/// ZK-9: an ECU that ran before the first order may have been given its switch by ID 6, so its first run also goes there.
/// Version 3 does not know ID 6 (ZK-7).
#[test]
fn zk_9_an_ecu_that_ran_already_gets_its_switch_by_id_6() {
    let order = throttle_tenths(200);
    let mut bench = met_running(4);
    bench.order_at_us(bench.now_us(), order).unwrap();
    let frames = slots(&mut bench, 2);
    for frame in [zk::mode(0, RUN), zk::throttle_tenths(RUN, 200)] {
        assert!(frames.contains(&frame.to_vec()), "{frames:02x?}");
    }
    let mut old = met_running(3);
    old.order_at_us(old.now_us(), order).unwrap();
    assert_eq!(ids(&slots(&mut old, 10)), [1; 10], "version 3");
    let mut at_rest = ecu(4);
    at_rest.order_at_us(at_rest.now_us(), order).unwrap();
    assert_eq!(ids(&slots(&mut at_rest, 10)), [1; 10], "it was at rest");
    // A version from a single report is not used.
    let mut once = link(Config::DEFAULT, LINE);
    once.receive(&zk::identity(160, 4, 0));
    runs(&mut once);
    once.order_at_us(once.now_us(), order).unwrap();
    assert_eq!(ids(&slots(&mut once, 10))[1..], [1; 9], "one report");
}

/// ZK-9: an ECU that obeyed the switch in ID 1 before a reset, as the record says, continues to get it there, also after another reset.
#[test]
fn zk_9_after_a_reset_a_switch_of_id_1_stays_there() {
    let order = throttle_tenths(200);
    let mut before = ecu(4);
    before.receive(&zk::status(1, 0, [STATE_STANDBY, 1 << 5, 76]));
    before.order_at_us(before.now_us(), order).unwrap();
    let mut record = before.machine.record();
    for _ in 0..2 {
        let mut bench = met_running(4);
        bench.act(|link, _| link.restore(record));
        bench.order_at_us(bench.now_us(), order).unwrap();
        assert_eq!(ids(&slots(&mut bench, 10)), [1; 10]);
        record = bench.machine.record();
        // The order ends, and the engine is found running once more: nothing is known of it.
        bench.order_at_us(bench.now_us(), Order::Listen).unwrap();
        bench.order_at_us(bench.now_us(), order).unwrap();
        assert!(ids(&slots(&mut bench, 10)).contains(&6));
    }
    // Nothing is known of a switch where the state was not known at the order, or the engine was found running.
    let mut unknown = ecu(4);
    unknown.order_at_us(unknown.now_us(), order).unwrap();
    assert_eq!(unknown.machine.record(), LinkRecord::EMPTY);
    let mut listening = met_running(4);
    assert_eq!(listening.machine.record(), LinkRecord::EMPTY);
    listening.order_at_us(listening.now_us(), order).unwrap();
    assert_eq!(listening.machine.record(), LinkRecord::EMPTY, "not sent yet");
    slots(&mut listening, 2);
    assert_eq!(listening.machine.record(), LinkRecord::new(1));
}

/// ZK-9: an ECU whose switch is another than the one ordered, in two reports in a row later than 0.7 s after the
/// order, also gets it by ID 6.
#[test]
fn zk_9_an_ecu_that_does_not_follow_gets_its_switch_by_id_6() {
    // SwSt: 0 stop, 1 standby, 2 run.
    for (order, follows, others) in [(Order::Standby, 1, [0, 2, 3]), (throttle_tenths(0), 2, [0, 1, 3])] {
        let engine_status = |switch: u8| zk::status(1, 0, [STATE_STANDBY, switch << 5, 76]);
        let uses_id6 = |version: u8, reports: &[(u64, u8)]| {
            let mut bench = ecu(version);
            bench.order_at_us(100_000, order).unwrap();
            for (after, switch) in reports {
                received_to(&mut bench, 100_000 + after);
                bench.receive(&engine_status(*switch));
            }
            ids(&slots(&mut bench, 6)).contains(&6)
        };
        for other in others {
            for (version, reports, expected) in [
                (4, &[(700_000, other), (750_000, other)][..], true),
                (5, &[(900_000, other), (5_000_000, other)], true),
                (3, &[(700_000, other), (750_000, other), (800_000, other)], false),
                (4, &[(900_000, other)], false),
                (4, &[(699_999, other), (750_000, other)], false),
                (4, &[(100_000, other), (300_000, other), (699_999, other)], false),
                (4, &[(800_000, other), (850_000, follows), (900_000, other)], false),
                (4, &[(800_000, other), (850_000, follows), (900_000, other), (950_000, other)], true),
            ] {
                assert_eq!(uses_id6(version, reports), expected, "{order:?} {version} {reports:?}");
            }
        }
        assert!(!uses_id6(4, &[(800_000, follows), (850_000, follows), (900_000, follows)]));
    }
}

/// ZK-9: an order that was given before the ECU was received, as an engine does, and an ECU that was left in mode 2 or 3:
/// a standby is obeyed within about a second, a stop from the first ID 6 on.
#[test]
fn zk_9_an_ecu_found_in_mode_3_is_reached_in_time() {
    for left_in in [(0, RUN), (4, RUN)] {
        for (order, within) in [(Order::Standby, 1_000_000), (Order::EmergencyStop, 2 * SEND_SLOT_US + 5_000)]
        {
            let mut bench = link(Config::DEFAULT, LINE);
            let mut ecu = SimpleEcu { id1: (RUN, 0), id6: left_in, code: 2500, ..SimpleEcu::default() };
            for _ in 0..2 {
                bench.receive(&zk::identity(160, 4, 0));
            }
            bench.order_at_us(0, order).unwrap();
            let mut obeyed_at = None;
            for step in 1..=40u64 {
                bench.rx_at_us(step * 50_000 + 20_000, &zk::state(STATE_RUNNING));
                for (at, frame) in bench.frames() {
                    ecu.obey(&frame);
                    if obeyed_at.is_none() && ecu.obeyed() == expected(order) {
                        obeyed_at = Some(at);
                    }
                }
            }
            assert_eq!(ecu.obeyed(), expected(order), "left in {left_in:?}");
            assert!(obeyed_at.is_some_and(|at| at <= within), "{order:?} left in {left_in:?}: {obeyed_at:?}");
        }
    }
}

/// ZK-6, ZK-9: version, maximum and idle rpm are accepted when two consecutive frames agree, also at first: one damaged
/// frame in 256 passes the CRC.
#[test]
fn zk_16_one_odd_frame_changes_no_identity() {
    let known = |bench: &Bench<ZkLink>| {
        let report = &bench.machine.status().report;
        (report.version.unwrap().value.get(), report.max_rpm.unwrap().value.get())
    };
    let mut bench = link(Config::DEFAULT, LINE);
    for odd in [zk::identity(160, 4, 0), zk::identity(40, 4, 0), zk::identity(160, 4, 0)] {
        bench.receive(&odd);
        let report = &bench.machine.status().report;
        assert_eq!((report.version, report.max_rpm), (None, None), "one alone");
    }
    bench.receive(&zk::identity(160, 4, 0));
    assert_eq!(known(&bench), (4, 160_000), "the first two");
    bench.event_kinds();
    for (max, version) in [(40, 4), (160, 1), (40, 1), (160, 4), (40, 1), (160, 4), (40, 1), (40, 2), (41, 1)]
    {
        bench.receive(&zk::identity(max, version, 0));
        assert_eq!(known(&bench), (4, 160_000), "{max} {version}");
    }
    assert_eq!(bench.event_kinds(), []);
    bench.receive(&zk::identity(41, 1, 0));
    assert_eq!(known(&bench), (1, 41_000), "the second in a row");
    assert_eq!(bench.event_kinds(), [Event::VersionKnown(Version::new(1).unwrap())]);

    bench.receive(&zk::idle(30, false));
    assert_eq!(bench.machine.status().report.idle_rpm, None, "one alone");
    for (frame, idle) in [(30, 30), (60, 30), (30, 30), (60, 30), (50, 30), (60, 30), (60, 60)] {
        bench.receive(&zk::idle(frame, false));
        assert_eq!(bench.machine.status().report.idle_rpm.unwrap().value.get(), idle * 1000, "{frame}");
    }
}

/// ZK-7: a later version than the known one would allow commands that the ECU may not know: it is accepted when four in a row report
/// the same, while the link is up.
#[test]
fn zk_7_a_later_version_needs_four_reports() {
    let mut bench = link(Config::DEFAULT, LINE);
    let version =
        |bench: &Bench<ZkLink>| bench.machine.status().report.version.map(|version| version.value.get());
    for known in [None, Some(1)] {
        bench.receive(&zk::identity(160, 1, 0));
        assert_eq!(version(&bench).filter(|_| known.is_none()), None, "one alone");
        bench.receive(&zk::identity(160, 1, 0));
        assert_eq!(version(&bench), Some(1));
        // Three, then one that differs: in the version, the maximum, or as the known one.
        for other in [zk::identity(160, 5, 0), zk::identity(159, 4, 0), zk::identity(160, 1, 0)] {
            for _ in 0..3 {
                bench.receive(&zk::identity(160, 4, 0));
            }
            bench.receive(&other);
            assert_eq!(version(&bench), Some(1), "after {other:02x?}");
        }
        for reports in 1..=4 {
            bench.receive(&zk::identity(160, 4, 0));
            assert_eq!(version(&bench), Some(if reports < 4 { 1 } else { 4 }), "{reports} reports");
        }
    }
}

/// The control: without the stop all of them are sent.
#[test]
fn without_an_emergency_stop_all_frames_are_sent() {
    let mut bench = link(Config { rate: Rate::Hz50, ..Config::DEFAULT }, LINE);
    for _ in 0..2 {
        bench.receive(&zk::identity(160, 5, 0));
    }
    bench.receive(&zk::idle(30, true));
    pressure(&mut bench, 1013);
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    service(&mut bench, curve(30)).unwrap();
    bench.run_to_us(240_000);
    let frames = bench.bytes();
    for expected in
        [zk::action(8), zk::unlock(), zk::curve(30), zk::pressure(1013), zk::throttle_tenths(STANDBY, 0)]
    {
        assert!(frames.contains(&expected.to_vec()), "{expected:02x?} in {frames:02x?}");
    }
    // The demand never waits for two slots.
    let gaps: Vec<_> = ids(&frames).split(|id| *id == 1).map(<[u8]>::len).collect();
    assert!(gaps.iter().all(|gap| *gap <= 2), "an unlocked command is two frames in one slot: {gaps:?}");
}
