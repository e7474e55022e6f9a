//! In doubt nothing goes out that could start the engine; an open pump is closed.

use super::*;

/// In doubt nothing goes out that could start an engine: ID 0, and in mode 3 the rpm alternating with it, which an ECU that
/// restarted ignores (ZK-9).
#[test]
fn in_doubt_only_keep_alives_and_in_mode_3_the_rpm_are_sent() {
    let doubt = |order: Order| {
        let Order::Run(demand) = order else { panic!("a run") };
        Order::Doubt(demand)
    };
    for (split_switch, version, order, expected) in [
        (false, 3, throttle_tenths(600), vec![zk::keep_alive(); 4]),
        (false, 5, throttle_tenths(600), vec![zk::keep_alive(); 4]),
        (true, 5, throttle_tenths(600), vec![zk::keep_alive(); 4]),
        (false, 5, rpm(100_000), vec![zk::keep_alive(), zk::rpm(2500), zk::keep_alive(), zk::rpm(2500)]),
    ] {
        let mut bench = ecu_with(Config { split_switch, ..Config::DEFAULT }, version, 160);
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        runs(&mut bench);
        bench.order_at_us(bench.now_us(), order).unwrap();
        assert!(slots(&mut bench, 4).iter().any(|frame| frame[..] != zk::keep_alive()), "the control");
        bench.run_to_us(bench.now_us() + 20_000);
        bench.order_at_us(bench.now_us(), doubt(order)).unwrap();
        let mut frames = slots(&mut bench, 4);
        if frames[0] != expected[0] {
            frames.rotate_left(1);
        }
        assert_eq!(frames, expected, "{order:?} of version {version}");
        // When the link is lost the version is discarded; the engine is still in mode 3.
        bench.run_to_us(bench.now_us() + 600_000);
        bench.frames();
        let mut frames = slots(&mut bench, 4);
        if frames[0] != expected[0] {
            frames.rotate_left(1);
        }
        assert_eq!(frames, expected, "{order:?} of version {version}, lost");
        // A stop and a standby go out blind.
        for (order, sw) in [(Order::Standby, STANDBY), (Order::EmergencyStop, STOP)] {
            bench.order_at_us(bench.now_us(), order).unwrap();
            bench.run_to_us(bench.now_us() + 10 * SEND_SLOT_US);
            let frames = bench.bytes();
            assert!(
                frames.len() >= 10 && frames.iter().all(|frame| switch_of(frame) == Some(sw)),
                "{frames:02x?}"
            );
        }
    }
    // With no mode 3 in force an rpm in doubt is ID 0.
    let mut bench = ecu(5);
    bench.order_at_us(bench.now_us(), doubt(rpm(100_000))).unwrap();
    assert_eq!(slots(&mut bench, 10), vec![zk::keep_alive().to_vec(); 10]);
}

/// ZK-9: mode 3 is in force once its ID 6 was sent. In doubt before that, an rpm is ID 0, whether the version is known or not.
#[test]
fn zk_9_in_doubt_before_mode_3_is_in_force_no_rpm_is_sent() {
    for (slots_before, sent) in [(1, vec![0; 4]), (2, vec![0, 7, 0, 7])] {
        for lost in [false, true] {
            let mut bench = running(5);
            bench.order_at_us(bench.now_us(), rpm(100_000)).unwrap();
            assert_eq!(ids(&slots(&mut bench, slots_before)), [7, 6][..slots_before]);
            bench.order_at_us(bench.now_us(), Order::Doubt(Demand::Rpm(Rpm::new(100_000)))).unwrap();
            if lost {
                bench.run_to_us(bench.now_us() + 600_000);
                assert_eq!(bench.machine.status().report.version, None);
            }
            let mut frames = ids(&slots(&mut bench, 4));
            if frames[0] != sent[0] {
                frames.rotate_left(1);
            }
            assert_eq!(frames, sent, "after {slots_before} frames, lost: {lost}");
        }
    }
}

/// The pump is closed by ten frames of ID 2, parameter 13, in every second slot after the first frame of a stop, whatever version is
/// reported: two forged reports of an older one must not leave it open. It ends sooner if the ECU reports a pump without voltage.
#[test]
fn the_pump_is_closed_by_ten_frames_beside_every_stop() {
    for (order, sw) in [(Order::EmergencyStop, STOP), (Order::Standby, STANDBY)] {
        for version in [None, Some(3), Some(5)] {
            for voltage in [None, Some(12), Some(0)] {
                let mut bench = version.map_or_else(|| link(Config::DEFAULT, LINE), ecu);
                bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
                bench.run_to_us(bench.now_us() + 60_000);
                bench.frames();
                bench.act(|link, _| link.close_pump());
                assert!(bench.machine.service_frames().closing_pump);
                bench.order_at_us(bench.now_us(), order).unwrap();
                let mut frames = Vec::new();
                for _ in 0..40 {
                    bench.run_to_us(bench.now_us() + SEND_SLOT_US);
                    frames.extend(bench.bytes());
                    if let Some(voltage) = voltage {
                        bench.receive(&zk::status(2, 0, [60, 120, voltage]));
                    }
                }
                let closes = |frame: &Vec<u8>| frame[..] == zk::action(13);
                let count = frames.iter().filter(|frame| closes(frame)).count();
                assert_eq!(
                    count,
                    // A voltage measured less than 0.1 s after the first frame may be from before it.
                    if voltage == Some(0) { 2 } else { 10 },
                    "{order:?} {version:?} {voltage:?}"
                );
                assert!(!closes(&frames[0]), "a stop first");
                assert!(frames.windows(2).all(|pair| !pair.iter().all(closes)), "every second slot at most");
                assert!(
                    frames.iter().all(|frame| closes(frame) || switch_of(frame) == Some(sw)),
                    "{frames:02x?}"
                );
                assert!(!bench.machine.service_frames().closing_pump);
            }
        }
    }
    // The control: a link without an open pump.
    let mut bench = ecu(5);
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    assert!(slots(&mut bench, 40).iter().all(|frame| id(frame) == 1));
}

/// ZK-13: a frame that closes the pump does not come between an unlock and its command.
#[test]
fn zk_13_closing_the_pump_does_not_separate_an_unlock_from_its_command() {
    for slots_before in 0..4 {
        let mut bench = ecu(5);
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        bench.run_to_us(bench.now_us() + 60_000);
        bench.act(|link, _| link.close_pump());
        slots(&mut bench, slots_before + 1);
        service(&mut bench, curve(40)).unwrap();
        bench.frames();
        bench.run_to_us(bench.now_us() + 10 * SEND_SLOT_US);
        let frames = bench.bytes();
        let unlock = frames.iter().position(|frame| id(frame) == 3).expect("an unlock");
        assert_eq!(frames[unlock + 1], zk::curve(40), "{:?}", ids(&frames));
        assert!(frames.iter().any(|frame| frame[..] == zk::action(13)), "beside the frames that close it");
    }
}

/// The observation from each status about the life of the engine: ID 1 its state and shaft, the others only the shaft.
#[test]
fn each_status_gives_the_observation_of_its_state() {
    // Idle speed in 1000 rpm, maximum, and half of idle or its substitute.
    for (idle, max, half) in [
        (None, None, 10_000),
        (None, Some(160), 16_000),
        (Some(30), Some(160), 15_000),
        (Some(30), None, 15_000),
        // A speed of 0 counts as unknown: otherwise every shaft would turn.
        (Some(0), Some(160), 16_000),
        (Some(0), Some(0), 10_000),
        (None, Some(0), 10_000),
    ] {
        let mut bench = link(Config::DEFAULT, LINE);
        for _ in 0..2 {
            if let Some(max) = max {
                bench.receive(&zk::identity(max, 4, 0));
            }
            if let Some(idle) = idle {
                bench.receive(&zk::idle(idle, false));
            }
        }
        for (rpm, turns) in [(0, false), (half - 10, false), (half, true), (160_000, true)] {
            for state in 0..=31 {
                bench.receive(&zk::status(1, rpm, [state, 2 << 5, 76]));
                let stage = match state {
                    12 => Stage::Cooling,
                    0 | 1 | 14..=19 => Stage::Rest,
                    2..=4 => Stage::Ignition,
                    5 => Stage::FuelRamp,
                    6..=11 => Stage::Running,
                    13 => Stage::Restart,
                    _ => Stage::Unknown,
                };
                let observation = Observation::State { stage, turning: Some(turns), throttle: None };
                assert_eq!(bench.machine.take_observation(), Some(observation), "state {state} at {rpm} rpm");
                assert_eq!(bench.machine.take_observation(), None, "once");
            }
            for id in [2, 3, 4, 5, 7, 9, 10] {
                bench.receive(&zk::status(id, rpm, [1, 2, 3]));
                assert_eq!(
                    bench.machine.take_observation(),
                    Some(Observation::Shaft { turning: turns }),
                    "{id} at {rpm}"
                );
            }
        }
    }
}

/// A gap begins three of the ECU's intervals after its last frame, at the slower of the reported and the commanded rate. Damaged
/// frames prevent a gap; half a frame does not.
#[test]
fn three_missing_frames_are_a_gap() {
    let gap = |bench: &Bench<ZkLink>| bench.machine.gap_at().map(|at| at.as_micros());
    for (wanted, rate, three) in [
        (Rate::Hz20, 0, 150_000),
        (Rate::Hz20, 1, 150_000),
        (Rate::Hz20, 2, 150_000),
        (Rate::Hz50, 0, 150_000),
        (Rate::Hz50, 1, 60_000),
        (Rate::Hz100, 2, 30_000),
    ] {
        let mut bench = link(Config { rate: wanted, ..Config::DEFAULT }, LINE);
        assert_eq!(gap(&bench), None, "nothing was received yet");
        bench.rx_at_us(100_000, &zk::identity(160, 4, rate));
        assert_eq!(gap(&bench), Some(100_000 + three), "rate {rate}");
        let mut damaged = zk::state(STATE_RUNNING);
        damaged[5] ^= 0x10;
        bench.rx_at_us(125_000, &damaged);
        assert_eq!(gap(&bench), Some(125_000 + three), "rate {rate}");
        bench.rx_at_us(140_000, &damaged[..4]);
        assert_eq!(gap(&bench), Some(125_000 + three), "rate {rate}");
        bench.act(|link, _| link.gap());
        assert_eq!(gap(&bench), None, "it is announced once");
    }
}

/// Damaged frames count each, also where a late one shortens the pause before the next: at 100 Hz and 9600 baud a pause is 2.7 ms, and
/// two thirds of it separate two bursts. After less than that, the bytes belong to one burst.
#[test]
fn a_damaged_frame_counts_after_two_thirds_of_the_pause_at_a_high_rate() {
    const BYTE_US: u64 = 1042;
    for (pause, counts) in [(2_200, true), (1_700, false)] {
        let mut bench = link(Config { rate: Rate::Hz100, ..Config::DEFAULT }, LINE);
        bench.rx_at_us(10_000, &zk::identity(160, 4, 2));
        let mut damaged = zk::state(STATE_RUNNING);
        damaged[5] ^= 0x10;
        // Six of seven bytes are enough: one may have been lost.
        let mut sixth = Vec::new();
        for begin in [20_000, 20_000 + 6 * BYTE_US + pause] {
            for (n, byte) in (0..).zip(damaged) {
                bench.rx_at_us(begin + n * BYTE_US, &[byte]);
            }
            sixth.push(begin + 5 * BYTE_US);
        }
        let last = if counts { sixth[1] } else { sixth[0] };
        assert_eq!(bench.machine.gap_at(), Some(at_us(last + 30_000)), "{pause} µs");
    }
}
