//! Modes 1, 2 and 3, and the hand-over to PWM.

use super::*;

/// ZK-9, mode 1: switch and throttle in ID 1. ZK-8: standby is SW 2, an emergency stop SW 1, run SW 3.
#[test]
fn zk_9_mode_1_has_switch_and_throttle_in_id_1() {
    let mut bench = running(3);
    for (order, sw, tenths) in [
        (Order::Standby, STANDBY, 0),
        (throttle_tenths(0), RUN, 0),
        (throttle_tenths(1), RUN, 1),
        (throttle_tenths(1000), RUN, 1000),
        (Order::Standby, STANDBY, 0),
        (Order::EmergencyStop, STOP, 0),
    ] {
        bench.order_at_us(bench.now_us(), order).unwrap();
        for frame in slots(&mut bench, 3) {
            assert_eq!(frame, zk::throttle_tenths(sw, tenths), "{order:?}");
        }
    }
}

/// ZK-9, mode 2: ID 6 carries the switch with RPM_X = 0 and ID 1 the throttle, alternately.
#[test]
fn zk_9_mode_2_has_the_switch_in_id_6() {
    let config = Config { split_switch: true, ..Config::DEFAULT };
    let mut bench = ecu_with(config, 4, 160);
    runs(&mut bench);
    for (order, sw, tenths) in
        [(Order::Standby, STANDBY, 0), (throttle_tenths(425), RUN, 425), (Order::EmergencyStop, STOP, 0)]
    {
        bench.order_at_us(bench.now_us(), order).unwrap();
        let (mode, demand) = (zk::mode(0, sw).to_vec(), zk::throttle_tenths(sw, tenths).to_vec());
        // To run, the throttle goes first: the switch must not come into force with an old one.
        let (first, second) = if sw == RUN { (demand, mode) } else { (mode, demand) };
        assert_eq!(slots(&mut bench, 4), [first.clone(), second.clone(), first, second], "{order:?}");
    }
}

/// ZK-7: mode 2 needs version 4. Before two reports agree on the version, and below 4, ID 1 carries both.
#[test]
fn zk_7_mode_2_waits_for_version_4() {
    let config = Config { split_switch: true, ..Config::DEFAULT };
    let mut bench = link(config, LINE);
    bench.order_at_us(0, Order::Standby).unwrap();
    assert_eq!(ids(&slots(&mut bench, 6)), [1; 6], "version not known");
    bench.receive(&zk::identity(160, 3, 0));
    assert_eq!(ids(&slots(&mut bench, 6)), [1; 6], "version 3");
    bench.receive(&zk::identity(160, 4, 0));
    assert_eq!(ids(&slots(&mut bench, 6)), [1; 6], "one report against another");
    bench.receive(&zk::identity(160, 4, 0));
    let ids = ids(&slots(&mut bench, 6));
    assert!(ids.contains(&6) && ids.contains(&1), "version 4: {ids:?}");
}

/// ZK-9, mode 3: ID 7 carries the rpm, ID 6 switch and RPM_X. The rpm goes first, so that the mode does not come
/// into force with an old one.
#[test]
fn zk_9_mode_3_has_the_rpm_in_id_7() {
    let mut bench = running(4);
    bench.order_at_us(bench.now_us(), rpm(100_000)).unwrap();
    // 160 000 rpm at most: RPM_X = 4, and 100 000 = 2500 × 4 × 10.
    let (demand, mode) = (zk::rpm(2500).to_vec(), zk::mode(4, RUN).to_vec());
    assert_eq!(slots(&mut bench, 4), [demand.clone(), mode.clone(), demand, mode]);
    // A new rpm is in force at the latest two slots later.
    bench.order_at_us(bench.now_us(), rpm(100_079)).unwrap();
    let two = slots(&mut bench, 2);
    assert!(two.contains(&zk::rpm(2501).to_vec()), "never rounded above the demand: {two:02x?}");
}

/// ZK-9: RPM_X for every maximum that an ECU can report, and an rpm never above the demand.
#[test]
fn zk_9_rpm_x_covers_every_maximum() {
    for max in 1..=255u8 {
        let mut bench = ecu_with(Config::DEFAULT, 5, max);
        runs(&mut bench);
        let max_rpm = u32::from(max) * 1000;
        // The printed ranges: 40950 × RPM_X. Above the last of them 6 reaches furthest.
        let x = (1..=6).find(|x| 40_950 * x >= max_rpm).unwrap_or(6);
        for demand in [0, 1, 33_333.min(max_rpm), max_rpm / 2 + 7, max_rpm - 1, max_rpm] {
            if demand > max_rpm {
                continue;
            }
            bench.order_at_us(bench.now_us(), rpm(demand)).unwrap();
            let frames = slots(&mut bench, 2);
            let mode = frames.iter().find(|frame| id(frame) == 6).expect("mode");
            assert_eq!(mode[..], zk::mode(x as u8, RUN), "{max}");
            let code = frames.iter().find(|frame| id(frame) == 7).expect("rpm");
            let code = u32::from(code[1] & 0x0F) << 8 | u32::from(code[2]);
            assert!(code * x * 10 <= demand, "{demand} of {max_rpm}");
            assert!(demand - code * x * 10 < x * 10 || code == 4095, "{demand} of {max_rpm}");
        }
        assert_eq!(
            bench.order_at_us(bench.now_us(), rpm(max_rpm + 1)),
            Err(Rejected::AboveMaxRpm { max: Rpm::new(max_rpm) })
        );
    }
}

/// Any transition from one order to another, by mode: (order before, order after, SW that the ECU must end up
/// with). ZK-8: SW 0 is never sent on the way.
#[test]
fn zk_8_no_transition_hands_over_to_pwm() {
    let orders = [
        Order::Standby,
        throttle_tenths(0),
        throttle_tenths(700),
        rpm(0),
        rpm(80_000),
        rpm(160_000),
        Order::EmergencyStop,
    ];
    for split_switch in [false, true] {
        for before in orders {
            for after in orders {
                for slots_before in 1..=3 {
                    let mut bench = ecu_with(Config { split_switch, ..Config::DEFAULT }, 4, 160);
                    runs(&mut bench);
                    let mut ecu = SimpleEcu::default();
                    bench.order_at_us(bench.now_us(), before).unwrap();
                    for frame in slots(&mut bench, slots_before) {
                        ecu.obey(&frame);
                    }
                    bench.order_at_us(bench.now_us(), after).unwrap();
                    for frame in slots(&mut bench, 4) {
                        let switch = match id(&frame) {
                            1 => Some(frame[1] >> 2 & 3),
                            6 => Some(frame[2] & 3),
                            _ => None,
                        };
                        assert_ne!(switch, Some(PWM), "{before:?} to {after:?}: {frame:02x?}");
                        ecu.obey(&frame);
                        assert!(ecu.target_rpm <= 160_000, "{before:?} to {after:?}: {ecu:?}");
                    }
                    assert_eq!(ecu.obeyed(), expected(after), "{before:?} to {after:?} after {slots_before}");
                }
            }
        }
    }
}

/// ZK-8: SW 0 is sent only when the hand-over is ordered by name, after ID 6 has released the switch.
#[test]
fn zk_8_only_its_own_command_hands_over_to_pwm() {
    for before in [Order::Standby, throttle_tenths(500), rpm(80_000)] {
        let mut bench = running(4);
        let mut ecu = SimpleEcu::default();
        bench.order_at_us(bench.now_us(), before).unwrap();
        slots(&mut bench, 2).iter().for_each(|frame| ecu.obey(frame));
        bench.order_at_us(bench.now_us(), Order::Pwm).unwrap();
        slots(&mut bench, 3).iter().for_each(|frame| ecu.obey(frame));
        assert_eq!(ecu.obeyed(), (PWM, None, Some(0)), "{before:?}");
        // And back again.
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        slots(&mut bench, 3).iter().for_each(|frame| ecu.obey(frame));
        assert_eq!(ecu.obeyed(), (STANDBY, None, Some(0)), "{before:?}");
    }
}

/// ZK-9: an ECU that another host, or this one before its reset, left in mode 2 or 3 ignores the switch of ID 1.
/// A stop and a standby still reach it.
#[test]
fn zk_9_a_stop_reaches_an_ecu_that_was_left_in_mode_3() {
    for left_in in [(0, RUN), (4, RUN)] {
        let left = || SimpleEcu { id1: (RUN, 0), id6: left_in, code: 2500, ..SimpleEcu::default() };
        let mut bench = met_running(4);
        let mut ecu = left();
        bench.order_at_us(bench.now_us(), Order::EmergencyStop).unwrap();
        slots(&mut bench, 6).iter().for_each(|frame| ecu.obey(frame));
        assert_eq!(ecu.obeyed(), expected(Order::EmergencyStop), "left in {left_in:?}");
        // If nothing is known about ID 6, standby is sent as ID 1, and as both when the ECU does not follow.
        let mut bench = met_running(4);
        let mut ecu = left();
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        for _ in 0..20 {
            slots(&mut bench, 1).iter().for_each(|frame| ecu.obey(frame));
            bench.receive(&zk::state(STATE_RUNNING));
        }
        assert_eq!(ecu.obeyed(), expected(Order::Standby), "left in {left_in:?}");
    }
}

/// ZK-9: while the ECU's maximum changes, and with it RPM_X, the target is never above the demand.
#[test]
fn zk_9_a_change_of_the_maximum_never_raises_the_target() {
    for (before, after) in [(160, 40), (40, 160), (255, 1), (100, 200)] {
        for slots_before in 2..=5 {
            let mut bench = ecu_with(Config::DEFAULT, 4, before);
            runs(&mut bench);
            let demand = 30_000;
            bench.order_at_us(bench.now_us(), rpm(demand)).unwrap();
            let mut ecu = SimpleEcu::default();
            slots(&mut bench, slots_before).iter().for_each(|frame| ecu.obey(frame));
            for _ in 0..2 {
                bench.receive(&zk::identity(after, 4, 0));
                for frame in slots(&mut bench, 4) {
                    ecu.obey(&frame);
                    assert!(ecu.target_rpm <= demand, "{before} to {after} after {slots_before}: {ecu:?}");
                }
            }
            assert_eq!(bench.machine.status().report.max_rpm.unwrap().value.get(), u32::from(after) * 1000);
        }
    }
}

/// ZK-9: a status ID 6 that gives another version (one corrupted frame in 256 passes the CRC) does not make a stop
/// go where an ECU in mode 3 does not look.
#[test]
fn zk_9_a_stop_in_mode_3_reaches_an_ecu_whose_version_changed() {
    for version in [1, 3, 5] {
        for (frames, order) in [
            (1, Order::EmergencyStop),
            (2, Order::EmergencyStop),
            (1, Order::Standby),
            (2, Order::Standby),
            (1, throttle_tenths(100)),
            (2, throttle_tenths(100)),
        ] {
            let mut bench = running(4);
            let mut ecu = SimpleEcu::default();
            bench.order_at_us(bench.now_us(), rpm(100_000)).unwrap();
            slots(&mut bench, 4).iter().for_each(|frame| ecu.obey(frame));
            for _ in 0..frames {
                bench.receive(&zk::identity(160, version, 0));
            }
            bench.order_at_us(bench.now_us(), order).unwrap();
            let sent = slots(&mut bench, 6);
            if version < 4 && frames == 2 && matches!(order, Order::Run(_)) {
                // Two reports agree on another ECU, which does not know ID 6: to run it is ID 1 alone (ZK-7).
                assert!(sent.iter().all(|frame| frame[..] == zk::throttle_tenths(RUN, 100)), "{sent:02x?}");
                continue;
            }
            sent.iter().for_each(|frame| ecu.obey(frame));
            assert_eq!(ecu.obeyed(), expected(order), "version {version}, {frames} frames");
        }
    }
}

/// ZK-9: when mode 3 is left for a throttle, an old throttle never comes into force again.
#[test]
fn zk_9_leaving_mode_3_uses_no_old_throttle() {
    for slots_in_mode_3 in 2..=5 {
        let mut bench = running(4);
        let mut ecu = SimpleEcu::default();
        bench.order_at_us(bench.now_us(), throttle_tenths(1000)).unwrap();
        slots(&mut bench, 3).iter().for_each(|frame| ecu.obey(frame));
        bench.order_at_us(bench.now_us(), rpm(40_000)).unwrap();
        slots(&mut bench, slots_in_mode_3).iter().for_each(|frame| ecu.obey(frame));
        bench.order_at_us(bench.now_us(), throttle_tenths(100)).unwrap();
        for frame in slots(&mut bench, 4) {
            ecu.obey(&frame);
            let (switch, _, throttle) = ecu.obeyed();
            assert_eq!(switch, RUN);
            assert!(throttle.is_none_or(|throttle| throttle <= 100), "{ecu:?} after {slots_in_mode_3}");
        }
    }
}

/// ZK-8, ZK-9: a hand-over from mode 3 goes from run to PWM, not through the switch that ID 1 had before the
/// start.
#[test]
fn zk_8_a_hand_over_from_mode_3_never_stops_the_engine() {
    let mut bench = running(4);
    let mut ecu = SimpleEcu::default();
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    slots(&mut bench, 3).iter().for_each(|frame| ecu.obey(frame));
    bench.order_at_us(bench.now_us(), rpm(80_000)).unwrap();
    slots(&mut bench, 4).iter().for_each(|frame| ecu.obey(frame));
    bench.order_at_us(bench.now_us(), Order::Pwm).unwrap();
    for frame in slots(&mut bench, 4) {
        ecu.obey(&frame);
        assert!([RUN, PWM].contains(&ecu.obeyed().0), "{ecu:?}");
    }
    assert_eq!(ecu.obeyed().0, PWM);
}

/// ZK-8: ID 6 releases the switch only once the frame was sent: a failed transmission is repeated.
#[test]
fn zk_8_a_hand_over_that_was_not_sent_is_sent_again() {
    let mut bench = running(4);
    let mut ecu = SimpleEcu::default();
    bench.order_at_us(bench.now_us(), rpm(80_000)).unwrap();
    slots(&mut bench, 4).iter().for_each(|frame| ecu.obey(frame));
    bench.run_to_us(bench.now_us() + 20_000);
    let mut bench = bench.by_hand();
    bench.frames();
    bench.order_at_us(bench.now_us(), Order::Pwm).unwrap();
    let mut failed = false;
    for _ in 0..100 {
        bench.run_to_us(bench.now_us() + 10_000);
        let frames = bench.bytes();
        if !failed && frames.iter().any(|frame| id(frame) == 6) {
            failed = true;
            bench.not_sent_at_us(bench.now_us(), NotSent::Failed);
            continue;
        }
        frames.iter().for_each(|frame| ecu.obey(frame));
        if bench.busy() {
            bench.sent_at_us(bench.now_us());
        }
    }
    assert!(failed);
    assert_eq!(ecu.obeyed(), expected(Order::Pwm));
}

/// ZK-9: "When RPM_X is 0, the RPM of ID 7 is invalid": an ECU may forget what came before the mode, or keep the rpm
/// of the last time. No more than one frame's time may pass until the new one is in force.
#[test]
fn zk_9_entering_mode_3_again_uses_no_old_rpm() {
    let mut bench = running(4);
    let mut ecu = SimpleEcu { ignores_early_rpm: true, ..SimpleEcu::default() };
    bench.order_at_us(bench.now_us(), rpm(100_000)).unwrap();
    slots(&mut bench, 4).iter().for_each(|frame| ecu.obey(frame));
    bench.order_at_us(bench.now_us(), throttle_tenths(0)).unwrap();
    slots(&mut bench, 4).iter().for_each(|frame| ecu.obey(frame));
    bench.order_at_us(bench.now_us(), rpm(40_000)).unwrap();
    bench.frames();
    bench.run_to_us(bench.now_us() + 4 * SEND_SLOT_US);
    let mut wrong_since: Option<u64> = None;
    for (at, frame) in bench.frames() {
        let wrong_for = wrong_since.map_or(0, |since| at - since);
        assert!(wrong_for < 10_000, "{:?} for {wrong_for} µs", ecu.obeyed());
        ecu.obey(&frame);
        let wrong = ecu.obeyed().1.is_some_and(|target| target > 40_000);
        wrong_since = wrong.then(|| wrong_since.unwrap_or(at));
    }
    assert_eq!(ecu.obeyed(), expected(rpm(40_000)));
}

/// ZK-7: an ECU at rest that reports an older version in two frames was never sent an ID 6, so another one was plugged in: standby is
/// sent to it by ID 1 alone. If it still runs, or the version has ID 6, both alternate.
#[test]
fn zk_7_standby_is_not_sent_by_id_6_to_an_older_ecu_at_rest() {
    for (version, state, by_id6) in
        [(3, STATE_STANDBY, false), (3, STATE_RUNNING, true), (4, STATE_STANDBY, true)]
    {
        let mut bench = running(4);
        bench.order_at_us(bench.now_us(), rpm(80_000)).unwrap();
        slots(&mut bench, 4);
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        for _ in 0..2 {
            bench.receive(&zk::identity(160, version, 0));
            bench.receive(&zk::state(state));
        }
        bench.frames();
        let sent = slots(&mut bench, 6);
        assert_eq!(sent.iter().any(|frame| id(frame) == 6), by_id6, "{version}, state {state}: {sent:02x?}");
        assert!(sent.iter().any(|frame| id(frame) == 1), "{version}, state {state}");
    }
}

/// ZK-8, ZK-9: an ID 6 with SW 0 releases the switch. From then on the ECU obeys ID 1: neither the hand-over nor the standby after it
/// uses ID 6 again, also after a reset.
#[test]
fn zk_8_after_a_hand_over_the_switch_is_given_by_id_1() {
    let lost = |bench: &Bench<ZkLink>| {
        let mut reset = link(Config::DEFAULT, LINE);
        reset.machine.restore(bench.machine.record());
        reset.order_at_us(0, Order::Standby).unwrap();
        ids(&slots(&mut reset, 4))
    };
    let mut bench = running(4);
    bench.order_at_us(bench.now_us(), rpm(80_000)).unwrap();
    assert_eq!(ids(&slots(&mut bench, 4)), [7, 6, 7, 6]);
    assert!(lost(&bench).contains(&6), "in mode 3");
    bench.order_at_us(bench.now_us(), Order::Pwm).unwrap();
    assert_eq!(ids(&slots(&mut bench, 6)), [1, 6, 1, 1, 1, 1]);
    assert_eq!(lost(&bench), [1; 4], "handed over");
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    assert_eq!(slots(&mut bench, 4), vec![zk::throttle_tenths(STANDBY, 0).to_vec(); 4]);
}

/// ZK-7, ZK-8: the hand-over of an ECU that was found running repeats ID 6 with SW 0. One that is not sent gives no switch: when the
/// version is no longer known, standby is sent by ID 1 alone. An ID 6 with a switch may have reached the ECU.
#[test]
fn zk_8_a_repeated_release_that_was_not_sent_gives_no_switch() {
    for (order, by_id6) in [(Order::Pwm, false), (throttle_tenths(0), true)] {
        let mut bench = met_running(4);
        bench.order_at_us(bench.now_us(), order).unwrap();
        assert!(ids(&slots(&mut bench, 4)).contains(&6), "{order:?}");
        bench.run_to_us(bench.now_us() + 20_000);
        let mut bench = bench.by_hand();
        while !bench.busy() || bench.bytes().iter().all(|frame| id(frame) != 6) {
            if bench.busy() {
                bench.sent_at_us(bench.now_us());
            }
            bench.frames();
            bench.run_to_us(bench.now_us() + 10_000);
        }
        // The UART reports it so late that the link is lost, and with it the version.
        bench.run_to_us(bench.now_us() + 600_000);
        assert_eq!(bench.machine.status().report.version, None);
        bench.not_sent_at_us(bench.now_us(), NotSent::TimedOut);
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        let mut sent = Vec::new();
        for _ in 0..20 {
            bench.run_to_us(bench.now_us() + 10_000);
            sent.extend(bench.bytes());
            if bench.busy() {
                bench.sent_at_us(bench.now_us());
            }
        }
        assert!(sent.iter().all(|frame| switch_of(frame) == Some(STANDBY)), "{order:?}: {sent:02x?}");
        assert_eq!(ids(&sent).contains(&6), by_id6, "{order:?}: {sent:02x?}");
    }
}

/// ZK-7: an rpm is in force, and two reports agree on a version without speed control: until another order, idle by ID 1.
#[test]
fn zk_7_an_rpm_in_force_becomes_idle_for_a_version_without_speed_control() {
    let mut bench = running(4);
    bench.order_at_us(bench.now_us(), rpm(80_000)).unwrap();
    bench.receive(&zk::identity(160, 3, 0));
    assert_eq!(ids(&slots(&mut bench, 4)), [7, 6, 7, 6], "one report");
    bench.receive(&zk::identity(160, 3, 0));
    assert_eq!(slots(&mut bench, 4), vec![zk::throttle_tenths(RUN, 0).to_vec(); 4]);
}

/// ZK-8, ZK-9: mode 2 begins with its first ID 6. An ECU that was sent none is handed over by ID 1 alone.
#[test]
fn zk_8_a_hand_over_before_any_id_6_is_sent_by_id_1_alone() {
    for (before, by_id6) in [(None, false), (Some(Order::Standby), true)] {
        let mut bench = ecu_with(Config { split_switch: true, ..Config::DEFAULT }, 4, 160);
        if let Some(order) = before {
            bench.order_at_us(bench.now_us(), order).unwrap();
            slots(&mut bench, 2);
        }
        bench.order_at_us(bench.now_us(), Order::Pwm).unwrap();
        let sent = slots(&mut bench, 4);
        assert!(sent.iter().all(|frame| switch_of(frame) == Some(PWM)), "{before:?}: {sent:02x?}");
        assert_eq!(ids(&sent).contains(&6), by_id6, "{before:?}: {sent:02x?}");
    }
}
