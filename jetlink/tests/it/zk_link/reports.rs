//! Link state, and reports of the ECU.

use super::*;

/// Up after one frame, because it has a CRC; lost by the timer, exact to the tick, once; the send slots continue (ZK-10).
#[test]
fn zk_10_silence_is_one_loss_and_every_send_slot_is_used() {
    let mut bench = link(Config::DEFAULT, LINE);
    assert_eq!(bench.machine.status().state, LinkState::Silent);
    bench.rx_at_us(123_456, &zk::state(STATE_STANDBY));
    assert_eq!(
        (bench.machine.status().state, bench.machine.status().last_rx),
        (LinkState::Up, Some(at_us(123_456)))
    );
    bench.events();
    bench.run_to_us(623_455);
    assert_eq!((bench.machine.status().state, bench.event_kinds()), (LinkState::Up, vec![]));
    bench.run_to_us(623_456);
    assert_eq!((bench.machine.status().state, bench.event_kinds()), (LinkState::Lost, vec![Event::LinkLost]));
    bench.frames();
    bench.run_to_us(10_623_456);
    assert_eq!((bench.frames().len(), bench.event_kinds()), (200, vec![]));
    bench.receive(&zk::state(STATE_STANDBY));
    assert_eq!((bench.machine.status().state, bench.event_kinds()), (LinkState::Up, vec![Event::LinkUp]));
    bench.receive(&zk::state(STATE_STANDBY));
    assert_eq!(bench.event_kinds(), [Event::Phase(Phase::Standby)], "two agree");
}

/// ZK-15: an unknown ID is a frame: it is counted, keeps the link up, and its bytes are stored.
#[test]
fn zk_15_unknown_ids_are_frames() {
    for id in [0, 10, 11, 12, 13, 14] {
        let mut bench = link(Config::DEFAULT, LINE);
        let frame = zk::status(id, 55_550, [1, 2, 3]);
        bench.receive(&frame);
        assert_eq!(bench.machine.status().state, LinkState::Up);
        let counters = bench.machine.status().counters;
        assert_eq!((counters.frames, counters.unknown_frames, counters.bytes_skipped), (1, 1, 0));
        let report = &bench.machine.status().report;
        assert_eq!(report.unknown.unwrap().value.as_bytes(), frame);
        assert_eq!(report.rpm.unwrap().value.get(), 55_550, "every status carries the rpm");
    }
}

/// ZK-15: unknown states, errors and switches keep their number.
#[test]
fn zk_15_unknown_numbers_are_preserved() {
    let mut bench = link(Config::DEFAULT, LINE);
    // state 25, error 29, switch 3
    for _ in 0..2 {
        bench.receive(&zk::status(1, 0, [25 | (29 << 5 & 0xE0), 29 >> 3 | 3 << 5, 76]));
    }
    let report = &bench.machine.status().report;
    assert_eq!((report.state.unwrap().value.code, report.phase.unwrap().value), (25, Phase::Unknown));
    assert_eq!(report.switch.unwrap().value, ReportedSwitch::Unknown(3));
    let Faults::Zk(error) = report.faults.unwrap().value else { panic!("ZK") };
    assert_eq!((error.code(), error.name()), (29, "unknown"));
}

/// ZK-8, ZK-5: the phase and the switch that the ECU reports.
#[test]
fn zk_8_each_state_has_its_phase_and_reported_switch() {
    for (states, phase) in [
        (0..=0, Phase::Stopped),
        (1..=1, Phase::Standby),
        (2..=5, Phase::Starting),
        (6..=11, Phase::Running),
        (12..=12, Phase::Cooling),
        (13..=13, Phase::Starting),
        (14..=19, Phase::Service),
        (20..=31, Phase::Unknown),
    ] {
        for state in states {
            for (code, switch) in
                [(0, ReportedSwitch::Stop), (1, ReportedSwitch::Standby), (2, ReportedSwitch::Run)]
            {
                let mut bench = link(Config::DEFAULT, LINE);
                bench.receive(&zk::status(1, 0, [state, code << 5, 0]));
                bench.receive(&zk::status(1, 0, [state, code << 5, 0]));
                let report = &bench.machine.status().report;
                assert_eq!(
                    (report.phase.unwrap().value, report.switch.unwrap().value),
                    (phase, switch),
                    "{state}"
                );
            }
        }
    }
}

/// Every status ID is stored in the report, with its time.
#[test]
fn zk_5_values_carry_their_time() {
    let mut bench = link(Config::DEFAULT, LINE);
    bench.rx_at_us(500, &zk::identity(160, 5, 0));
    bench.rx_at_us(1_000, &zk::identity(160, 5, 0));
    for (t, frame) in [
        (2_000, zk::status(1, 12_340, [11, 0b10 << 5 | 0b010 << 2, 38])),
        (3_000, zk::status(3, 12_350, [45, 0x34, 0x12])),
        (4_000, zk::status(4, 12_360, [0x2C, 0x01 | 2 << 1, 10])),
        (5_000, zk::status(5, 12_370, [100, 40, 30])),
        (6_000, zk::status(7, 12_380, [0x10, 0x01 | 5 << 2, 1])),
        (6_500, zk::status(8, 12_390, [33, 0x12, 0x34])),
        (7_000, zk::status(8, 12_390, [33, 0x12, 0x34])),
        (8_000, zk::status(9, 12_400, [95, 0, 0])),
    ] {
        bench.rx_at_us(t, &frame);
    }
    let report = bench.machine.status().report;
    macro_rules! check {
        ($($field:ident.$get:ident = $value:expr, at $at:expr;)+) => {
            $(
                let value = report.$field.unwrap();
                assert_eq!((value.value.$get(), value.at), ($value, at_us($at)), stringify!($field));
            )+
        };
    }
    check! {
        max_rpm.get = 160_000, at 1_000;
        version.get = 5, at 1_000;
        rate.hz = 20, at 1_000;
        egt.tenths = (512 + 38 - 50) * 10, at 2_000;
        throttle.tenths = 450, at 3_000;
        pressure.get = 0x1234 * 2, at 3_000;
        current.get = 30_000, at 4_000;           // 0x12C = 300 × 0.1 A
        thrust.get = (2 * 256 + 10) * 100, at 4_000;
        ignition_pump.get = 2_000, at 5_000;
        fuel_flow.get = 0x110 * 10, at 6_000;
        fuel_total.get = (64 + 5) * 100, at 6_000;
        idle_rpm.get = 33_000, at 7_000;
        startup.as_millis = 0x234 * 100, at 7_000;
        ecu_temperature.tenths = 450, at 8_000;
        rpm.get = 12_400, at 8_000;
    }
    assert_eq!((report.curve_increase.unwrap().value, report.curve_decrease.unwrap().value), (40, 30));
    assert_eq!((report.closed_loop.unwrap().value, report.pressure_requested.unwrap().value), (true, false));
    assert_eq!(report.state.unwrap().value.name, "running");
}

/// ZK-5: a throttle above 100 % has no meaning and is not taken over.
#[test]
fn zk_5_a_throttle_above_100_percent_is_ignored() {
    let mut bench = link(Config::DEFAULT, LINE);
    bench.receive(&zk::status(3, 0, [101, 0, 0]));
    assert_eq!(bench.machine.status().report.throttle, None);
    bench.receive(&zk::status(3, 0, [100, 0, 0]));
    assert_eq!(bench.machine.status().report.throttle.unwrap().value, Throttle::FULL);
}

/// Events when something changes, and only then.
#[test]
fn events_are_published_on_changes_only() {
    let mut bench = link(Config::DEFAULT, LINE);
    let version = Version::new(4).unwrap();
    for (frame, events) in [
        (zk::state(STATE_STOP), vec![Event::LinkUp]),
        (zk::state(STATE_STOP), vec![Event::Phase(Phase::Stopped)]),
        (zk::state(STATE_STOP), vec![]),
        (zk::identity(160, 4, 0), vec![Event::RateConfirmed(Rate::Hz20)]),
        (zk::identity(160, 4, 0), vec![Event::VersionKnown(version)]),
        (zk::identity(160, 4, 0), vec![]),
        (zk::state(STATE_IGNITION), vec![]),
        (zk::state(4), vec![Event::Phase(Phase::Starting)]),
        (zk::state(STATE_RUNNING), vec![]),
        (zk::state(STATE_RUNNING), vec![Event::Phase(Phase::Running)]),
    ] {
        bench.receive(&frame);
        assert_eq!(bench.event_kinds(), events, "{frame:02x?}");
    }
    let faulty = zk::status(1, 0, [STATE_RUNNING | 4 << 5, 1, 76]); // error 0b01100: main valve
    bench.receive(&faulty);
    assert_eq!(bench.event_kinds(), [], "one report is no fault");
    bench.receive(&faulty);
    let events = bench.event_kinds();
    let [Event::Faults(Faults::Zk(error))] = events[..] else { panic!("{events:?}") };
    assert_eq!(error.name(), "main-valve");
}

/// ZK-16: a corrupted frame costs itself; the link counts it.
#[test]
fn zk_16_a_corrupted_frame_is_counted() {
    let mut bench = link(Config::DEFAULT, LINE);
    let mut bad = zk::status(1, 0, [STATE_RUNNING, 0, 76]); // none of its bytes looks like a head
    bad[5] ^= 0x10;
    bench.receive(&[&bad[..], &zk::state(STATE_STOP)].concat());
    let counters = bench.machine.status().counters;
    assert_eq!((counters.crc_failures, counters.frames, counters.bytes_skipped), (1, 1, 7));
    bench.receive(&zk::state(STATE_STOP));
    assert_eq!(bench.machine.status().report.phase.unwrap().value, Phase::Stopped);
}

/// A byte lost by a failed read is counted with its error.
#[test]
fn line_errors_and_lost_bytes_are_counted() {
    let mut bench = link(Config::DEFAULT, LINE);
    bench.machine.line_error(LineError::Noise);
    bench.machine.byte_lost(LineError::Overrun);
    bench.machine.byte_lost(LineError::Read);
    let counters = bench.machine.status().counters;
    assert_eq!((counters.noise_errors, counters.overruns, counters.read_errors), (1, 1, 1));
}

/// One damaged frame in 256 has a right CRC. The UART does not report which byte of a read had the error.
#[test]
fn values_of_frames_with_a_line_error_are_discarded_and_the_next_ones_count() {
    let (wrong, right) = (zk::state(STATE_STANDBY), zk::state(STATE_RUNNING));
    for error in [LineError::Framing, LineError::Overrun, LineError::Parity, LineError::Read] {
        let mut bench = link(Config::DEFAULT, LINE);
        for _ in 0..2 {
            bench.machine.line_error(error);
            bench.receive(&wrong);
        }
        let status = bench.machine.status();
        assert_eq!((status.state, status.report.phase), (LinkState::Silent, None), "{error:?}");
        assert_eq!((status.counters.frames, status.counters.damaged_frames), (2, 2), "{error:?}");
        assert_eq!(bench.machine.take_observation(), None, "{error:?}");

        for _ in 0..2 {
            bench.receive(&right);
        }
        let status = bench.machine.status();
        assert_eq!(status.report.phase.unwrap().value, Phase::Running, "{error:?}");
        assert_eq!(status.counters.damaged_frames, 2, "{error:?}");
    }
}

/// The samples of a bit differed, and the majority decided: the CRC handles this, because an edge that is always a little late
/// would cost every frame.
#[test]
fn a_noise_error_alone_discards_nothing() {
    let mut bench = link(Config::DEFAULT, LINE);
    for _ in 0..2 {
        bench.machine.line_error(LineError::Noise);
        bench.receive(&zk::state(STATE_STANDBY));
    }
    let status = bench.machine.status();
    assert_eq!(status.report.phase.unwrap().value, Phase::Standby);
    assert_eq!((status.counters.damaged_frames, status.counters.noise_errors), (0, 2));
}

/// Frames with an error in one byte, however the bytes were read; the others count.
#[test]
fn a_line_error_discards_each_frame_that_its_bytes_may_be_in() {
    let frame = zk::state(STATE_RUNNING);
    let damaged = |reads: &[(bool, &[u8])]| {
        let mut bench = link(Config::DEFAULT, LINE);
        for (error, bytes) in reads {
            if *error {
                bench.machine.line_error(LineError::Framing);
            }
            bench.receive(bytes);
        }
        let counters = bench.machine.status().counters;
        (counters.frames, counters.damaged_frames)
    };
    let (first, last) = frame.split_at(3);
    assert_eq!(damaged(&[(true, first), (false, last), (false, &frame)]), (2, 1), "in its first bytes");
    assert_eq!(damaged(&[(false, first), (true, last), (false, &frame)]), (2, 1), "in its last bytes");
    assert_eq!(
        damaged(&[(true, &[frame, frame].concat()), (false, &frame)]),
        (3, 2),
        "in one of two of a read"
    );
    assert_eq!(damaged(&[(true, &[0x00]), (false, &frame)]), (1, 0), "in a byte between two frames");
    let across = [&frame[..], first].concat();
    assert_eq!(damaged(&[(true, &across), (false, last), (false, &frame)]), (3, 2), "in one and a half");
}

/// A byte lost by a failed read damages the frame that contained it, whatever the CRC of the rest.
#[test]
fn a_lost_byte_damages_the_frame_that_it_was_in_only() {
    let frame = zk::state(STATE_RUNNING);
    let mut bench = link(Config::DEFAULT, LINE);
    bench.receive(&frame[..4]);
    bench.machine.byte_lost(LineError::Read);
    bench.receive(&frame[4..]);
    assert_eq!(bench.machine.status().counters.damaged_frames, 1, "an added byte was lost, perhaps");
    bench.machine.byte_lost(LineError::Read);
    bench.receive(&frame);
    let counters = bench.machine.status().counters;
    assert_eq!((counters.frames, counters.damaged_frames, counters.read_errors), (2, 1, 2));
}

/// A node that begins in the middle of a frame gets its rest, and takes it for the beginning of one. After a pause nothing completes it.
#[test]
fn the_rest_of_a_frame_before_a_pause_does_not_become_a_frame() {
    let next = zk::state(STATE_RUNNING);
    // It has a right CRC with the first bytes of the next frame.
    let with = |last: u8| [0xF1, 0x30, last, next[0], next[1], next[2], next[3]];
    let rest = (0..=u8::MAX).map(with).find(|&bytes| StatusFrame::new(bytes).is_some()).expect("one in 256");
    let phase = |pause_us: u64| {
        let mut bench = link(Config::DEFAULT, LINE);
        bench.rx_at_us(10_000, &rest[..3]);
        bench.rx_at_us(10_000 + pause_us, &next);
        bench.rx_at_us(60_000 + pause_us, &next);
        let status = bench.machine.status();
        assert_eq!((status.counters.frames, status.counters.bytes_skipped), (2, 3));
        status.report.phase.map(|phase| phase.value)
    };
    assert_eq!(phase(5_000), None, "a false frame, which is not known for one, and a true one do not agree");
    assert_eq!(phase(40_000), Some(Phase::Running), "two true frames");
}

/// Where no frame is expected, bytes before a pause of more than half of the ECU's interval are the rest of a frame that broke off:
/// the bytes after it do not complete it.
#[test]
fn a_frame_that_pauses_for_more_than_half_of_an_interval_is_not_completed() {
    for (pause, frames) in [(22_500, 1), (25_000, 1), (25_001, 0), (27_500, 0)] {
        let mut bench = link(Config::DEFAULT, LINE);
        let frame = zk::state(STATE_STANDBY);
        bench.rx_at_us(10_000, &frame[..4]);
        bench.rx_at_us(10_000 + pause, &frame[4..]);
        assert_eq!(bench.machine.status().counters.frames, frames, "{pause} µs");
    }
}
