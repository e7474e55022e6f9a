//! Reports of the ECU.

use super::*;

/// AMT-5, AMT-6: values with a scale for engines that have one, raw bytes for all others.
#[test]
fn amt_5_amt_6_the_engine_sets_the_scales_of_rpm_and_voltages() {
    // engine, rpm of 100, mV of 51 idle, 102 maximum, 204 battery, 153 external, 255-step Vout of 51
    for (engine, rpm, idle, max, battery, external) in [
        (EngineModel::Mercury, Some(70_000), Some(1250), Some(2500), Some(8000), Some(10_750)),
        (EngineModel::Pegasus, Some(50_000), Some(1250), Some(2500), Some(8000), Some(10_750)),
        (EngineModel::Olympus, Some(50_000), Some(1660), Some(3320), Some(8000), Some(12_580)),
        (EngineModel::Titan, Some(50_000), Some(1660), Some(3320), Some(8000), Some(12_580)),
        (EngineModel::Nike, None, Some(1660), Some(3320), None, Some(12_580)),
        (EngineModel::Lynx, None, None, None, None, None),
        (EngineModel::Orion, None, None, None, None, None),
    ] {
        let mut bench = amt(Config { engine: Some(engine), ..Config::DEFAULT }, SLOW);
        bench.rx_at_us(100_000, &alternate(0xF8)); // its engine ID is unnamed
        bench.rx_at_us(225_000, &[0xFF, FULL_OPERATION << 3 | RUN, 100, 100, 150, 51]);
        let report = &bench.machine.status().report;
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

/// AMT-5: while the engine is unknown there is no rpm, and when it changes to one without a scale the old rpm is dropped.
#[test]
fn amt_5_no_rpm_without_a_scale() {
    let frame = normal(FULL_OPERATION, RUN, 100);
    let mut bench = default();
    reply_to(&mut bench, &frame);
    assert_eq!((bench.machine.status().report.rpm, bench.machine.status().report.amt_engine), (None, None));
    assert_eq!(bench.machine.status().report.rpm_raw.unwrap().value, 100);
    reply_to(&mut bench, &alternate(0x18));
    reply_to(&mut bench, &frame);
    assert_eq!(bench.machine.status().report.rpm.unwrap().value.get(), 50_000);
    reply_to(&mut bench, &setup("14.35 200131 ")); // Lynx
    reply_to(&mut bench, &frame);
    assert_eq!(bench.machine.status().report.rpm, None);
}

/// AMT-4, AMT-9: who names the engine. An ID without a checksum changes a known engine only when it comes twice.
#[test]
fn amt_4_a_known_engine_changes_only_after_two_reports_of_another() {
    let named = |bench: &mut Bench<AmtLink>, frame: &[u8]| {
        reply_to(bench, frame);
        let reported: Vec<_> = bench
            .event_kinds()
            .into_iter()
            .filter_map(|event| match event {
                Event::EngineIdentified(engine) => Some(engine),
                _ => None,
            })
            .collect();
        (reported, bench.machine.status().report.amt_engine.map(|engine| engine.value))
    };
    use EngineModel::{Mercury, Olympus, Pegasus, Titan};
    let configured = || {
        let mut bench = amt(Config { engine: Some(Olympus), ..Config::DEFAULT }, SLOW);
        bench.order_at_us(0, Order::Standby).unwrap();
        bench
    };

    let mut bench = default();
    assert_eq!(named(&mut bench, &alternate(0x06)), (vec![Olympus], Some(Olympus)), "the first is taken");
    assert_eq!(named(&mut bench, &alternate(0x18)), (vec![], Some(Olympus)), "the same, new number");
    assert_eq!(named(&mut bench, &alternate(0x20)), (vec![], Some(Olympus)), "one odd frame");
    assert_eq!(named(&mut bench, &alternate(0x18)), (vec![], Some(Olympus)));
    assert_eq!(named(&mut bench, &alternate(0x20)), (vec![], Some(Olympus)));
    assert_eq!(named(&mut bench, &alternate(0x20)), (vec![Titan], Some(Titan)), "two in a row");
    assert_eq!(named(&mut bench, &setup("8.35 140617 ")), (vec![Mercury], Some(Mercury)), "a text is taken");
    assert_eq!(
        named(&mut bench, &setup("11.35 200131 ")),
        (vec![], Some(Mercury)),
        "no engine has this version"
    );

    // An ID that is in no table is another engine: it must not inherit a scale.
    let mut bench = configured();
    reply_to(&mut bench, &alternate(0xF8));
    reply_to(&mut bench, &normal(FULL_OPERATION, RUN, 100));
    assert_eq!(bench.machine.status().report.rpm.map(|rpm| rpm.value.get()), Some(50_000), "one odd frame");
    reply_to(&mut bench, &alternate(0xF8));
    reply_to(&mut bench, &normal(FULL_OPERATION, RUN, 100));
    assert!(bench.event_kinds().contains(&Event::EngineUnknown));
    assert_eq!((bench.machine.status().report.rpm, bench.machine.status().report.amt_engine), (None, None));

    // The configured engine is reported when the ECU confirms it; the ECU's own report takes precedence.
    let mut bench = configured();
    assert_eq!(bench.machine.status().report.amt_engine, None, "the ECU has not reported it");
    assert_eq!(named(&mut bench, &alternate(0x18)), (vec![Olympus], Some(Olympus)));
    let mut bench = configured();
    assert_eq!(named(&mut bench, &alternate(0x03)).0, []);
    assert_eq!(named(&mut bench, &alternate(0x10)), (vec![Pegasus], Some(Pegasus)));
}

/// AMT-3: the phase for the ECU's state.
#[test]
fn amt_3_each_state_has_its_phase() {
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
        assert_eq!(bench.machine.status().report.phase, None, "one frame is not taken");
        reply_to(&mut bench, &normal(state, switch, rpm));
        assert_eq!(bench.machine.status().report.phase.map(|phase| phase.value), Some(phase), "{state:#07b}");
        let switch_reported = match switch {
            EMERGENCY => ReportedSwitch::Stop,
            AUTO_STOP => ReportedSwitch::Standby,
            _ => ReportedSwitch::Run,
        };
        assert_eq!(bench.machine.status().report.switch.unwrap().value, switch_reported);
    }
}

/// The phase is as old as the last frame that confirmed it: neither an odd frame nor another set renews it.
#[test]
fn amt_3_only_frames_that_agree_renew_the_phase() {
    let mut bench = running();
    let running = normal(FULL_OPERATION, RUN, 100);
    reply_to(&mut bench, &running);
    let confirmed = bench.now_us();
    for other in [
        normal(STARTING, RUN, 1),
        normal(NO_CLEARANCE, EMERGENCY, 0),
        normal(0b11111, RUN, 100),
        error(0x01),
        alternate(0x18),
        normal(STARTED_UP, RUN, 50),
    ] {
        reply_to(&mut bench, &other);
        let phase = bench.machine.status().report.phase.unwrap();
        assert_eq!((phase.value, phase.at), (Phase::Running, at_us(confirmed)), "{other:02x?}");
    }
    reply_to(&mut bench, &running);
    let t = bench.now_us();
    assert_eq!(bench.machine.status().report.phase.unwrap().at, at_us(t));
    // Two that agree with each other are the new phase, as old as the second.
    for _ in 0..2 {
        reply_to(&mut bench, &normal(NO_CLEARANCE, EMERGENCY, 0));
    }
    let t = bench.now_us();
    let phase = bench.machine.status().report.phase.unwrap();
    assert_eq!((phase.value, phase.at), (Phase::Stopped, at_us(t)));
}

/// AMT-8: the faults are reported when they change, bit 7 included; one odd set neither causes, changes nor
/// ends a fault.
#[test]
fn amt_8_faults_are_reported_when_they_change() {
    let mut bench = default();
    for (frame, reported) in [
        (normal(CLEARANCE, AUTO_STOP, 0), None),
        (error(0x01), None),
        (normal(CLEARANCE, AUTO_STOP, 0), None),
        (error(0x01), None),
        (error(0x01), Some(0x01)),
        (error(0x01), None),
        (error(0xC1), None),
        (error(0x01), None),
        (error(0xC1), None),
        (error(0xC1), Some(0xC1)),
        (alternate(0x18), None), // reports nothing of faults
        (normal(CLEARANCE, AUTO_STOP, 0), None),
        (error(0xC1), None),
        (normal(CLEARANCE, AUTO_STOP, 0), None),
        (normal(CLEARANCE, AUTO_STOP, 0), Some(0)),
        (error(0x01), None),
        (error(0x02), Some(0x02)), // others in every set are faults all the same
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
        assert_eq!(faults, reported.into_iter().collect::<Vec<_>>(), "{frame:02x?}");
    }
    assert_eq!(bench.machine.status().report.faults.unwrap().value, Faults::Amt(ErrorBits(0)));
}

/// AMT-8: Data2 of an error set is no rpm.
#[test]
fn amt_8_an_error_set_gives_no_rpm() {
    let mut bench = amt(Config { engine: Some(EngineModel::Titan), ..Config::DEFAULT }, SLOW);
    bench.order_at_us(0, Order::Standby).unwrap();
    reply_to(&mut bench, &error(0x20));
    let report = &bench.machine.status().report;
    assert_eq!((report.rpm, report.rpm_raw), (None, None));
    assert_eq!(report.egt.unwrap().value.tenths(), 420); // Data3..5 as in the normal set: 20 × 4.6 − 50
}

/// AMT-2: a frame of an unknown kind is counted, and its bytes are stored.
#[test]
fn amt_2_sets_of_unknown_kinds_are_preserved_raw() {
    let mut bench = default();
    let unknown = [0xFF, 0b0101_1101, 1, 2, 3, 4];
    reply_to(&mut bench, &unknown);
    let counters = bench.machine.status().counters;
    assert_eq!((counters.frames, counters.unknown_frames), (1, 1));
    assert_eq!(bench.machine.status().report.unknown.unwrap().value.as_bytes(), unknown);
}

/// AMT-7: a throttle byte above 200 is invalid.
#[test]
fn amt_7_a_throttle_above_100_percent_is_ignored() {
    let mut bench = default();
    reply_to(&mut bench, &[0xFF, FULL_OPERATION << 3 | RUN, 1, 1, 201, 1]);
    assert_eq!(bench.machine.status().report.throttle, None);
    reply_to(&mut bench, &[0xFF, FULL_OPERATION << 3 | RUN, 1, 1, 200, 1]);
    assert_eq!(bench.machine.status().report.throttle.unwrap().value, Throttle::FULL);
}

/// AMT-1: there is no checksum, so a fault reported by the UART discards the values of a frame, but never its reply.
#[test]
fn amt_1_a_line_error_discards_the_values_but_not_the_reply() {
    let mut bench = running();
    let report = bench.machine.status().report;
    bench.machine.line_error(LineError::Framing);
    assert_eq!(ops_thr(&mut bench, &normal(STARTING, AUTO_STOP, 1)), (RUN_OPS, 160));
    assert_eq!(bench.machine.status().report, report);
    assert_eq!(bench.machine.status().counters.damaged_frames, 1);
    // The next one is used again.
    assert_eq!(ops_thr(&mut bench, &normal(FULL_OPERATION, RUN, 101)), (RUN_OPS, 160));
    assert_eq!(bench.machine.status().report.rpm_raw.unwrap().value, 101);
}

/// A fault between two frames (a line that floats while the ECU powers up) damages none of them: the set-up set is
/// the first frame after it.
#[test]
fn amt_9_a_line_error_before_the_setup_set_does_not_lose_it() {
    let mut bench = default();
    bench.machine.line_error(LineError::Framing);
    bench.receive(&[0x00]); // what the floating line left
    reply_to(&mut bench, &setup("9.35 140617 "));
    assert!(bench.event_kinds().contains(&Event::EcuStarted));
}

/// A lost byte with its fault damages only the frame that contained it: after noise the first set is accepted.
#[test]
fn amt_1_a_lost_byte_does_not_lose_the_next_set() {
    let mut bench = running();
    for begun in [&[][..], &[0xFF, 0x21, 1]] {
        bench.receive(begun);
        for _ in 0..20 {
            bench.machine.byte_lost(LineError::Framing);
        }
        let rpm = 101 + begun.len() as u8;
        assert_eq!(ops_thr(&mut bench, &normal(FULL_OPERATION, RUN, rpm)), (RUN_OPS, 160));
        assert_eq!(bench.machine.status().report.rpm_raw.unwrap().value, rpm);
    }
    let counters = bench.machine.status().counters;
    assert_eq!((counters.damaged_frames, counters.framing_errors), (0, 40));
    // A line error in the same set is lost with it.
    bench.machine.line_error(LineError::Framing);
    bench.receive(&[0xFF, 0x21]);
    bench.machine.byte_lost(LineError::Framing);
    assert_eq!(ops_thr(&mut bench, &normal(FULL_OPERATION, RUN, 105)), (RUN_OPS, 160));
    assert_eq!(bench.machine.status().report.rpm_raw.unwrap().value, 105);
}

/// A fault in a set that is cut off damages only that set.
#[test]
fn amt_1_a_line_error_in_a_truncated_set_does_not_lose_the_next() {
    let mut bench = running();
    bench.receive(&[0xFF, 0x21]);
    bench.machine.line_error(LineError::Framing);
    bench.receive(&[7]);
    assert_eq!(ops_thr(&mut bench, &normal(FULL_OPERATION, RUN, 101)), (RUN_OPS, 160));
    assert_eq!(bench.machine.status().report.rpm_raw.unwrap().value, 101);
    // A fault noticed since may be in the next set.
    bench.receive(&[0xFF, 0x21]);
    bench.machine.line_error(LineError::Framing);
    assert_eq!(ops_thr(&mut bench, &normal(FULL_OPERATION, RUN, 102)), (RUN_OPS, 160));
    assert_eq!(bench.machine.status().report.rpm_raw.unwrap().value, 101);
}

/// Sets with an error in one byte, however the bytes were read; the others count, and each is answered.
#[test]
fn amt_1_a_line_error_discards_each_set_that_its_bytes_may_be_in() {
    let normal = normal(FULL_OPERATION, RUN, 100);
    let setup = setup("9.35 140617 ");
    let damaged = |reads: &[(bool, &[u8])]| {
        let mut bench = running();
        let before = bench.machine.status().counters;
        for (error, bytes) in reads {
            if *error {
                bench.machine.line_error(LineError::Framing);
            }
            bench.receive(bytes);
        }
        let counters = bench.machine.status().counters;
        (counters.frames - before.frames, counters.damaged_frames)
    };
    for set in [&normal[..], &setup] {
        let (first, last) = set.split_at(2);
        assert_eq!(damaged(&[(true, first), (false, last), (false, set)]), (2, 1), "in its first bytes");
        assert_eq!(damaged(&[(false, first), (true, last), (false, set)]), (2, 1), "in its last bytes");
        let two = [set, set].concat();
        assert_eq!(damaged(&[(true, &two), (false, set)]), (3, 2), "in one of two of a read");
        assert_eq!(damaged(&[(true, &[0x00]), (false, set)]), (1, 0), "in a byte between two sets");
        let across = [set, first].concat();
        assert_eq!(damaged(&[(true, &across), (false, last), (false, set)]), (3, 2), "in one and a half");
    }
}

/// AMT-1: truncated frames, texts without an end, noise and UART faults are counted.
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
    let counters = bench.machine.status().counters;
    assert_eq!((counters.truncated, counters.frames, counters.bytes_skipped), (2, 0, 3 + 3 + 17));
    assert_eq!((counters.framing_errors, counters.noise_errors, counters.overruns), (1, 2, 1));
    assert_eq!((counters.read_errors, counters.parity_errors), (1, 1));
}
