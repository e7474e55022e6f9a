//! Commands sent to each protocol version.

use super::*;

/// ZK-7: a command that the ECU's version does not know is refused with both versions; until two reports agree on the
/// version, only version 1 commands are accepted.
#[test]
fn zk_7_each_version_is_sent_only_its_commands() {
    let services = Action::ALL
        .into_iter()
        .map(|one| {
            let needed = match one.code() {
                10 | 11 => 2,
                12 | 13 => 5,
                _ => 1,
            };
            (action(one), needed)
        })
        .chain([(curve(40), 1), (ignition(2000), 1)]);
    for (command, needed) in services {
        for known in [None, Some(1), Some(2), Some(3), Some(4), Some(5), Some(6), Some(63)] {
            let mut bench = link(Config::DEFAULT, LINE);
            bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
            if let Some(known) = known {
                bench.receive(&zk::identity(160, known, 0));
                if needed > 1 {
                    let once = Err(Rejected::NeedsVersion { needed, known: None });
                    assert_eq!(service(&mut bench, command), once, "{command:?} after one report");
                }
                bench.receive(&zk::identity(160, known, 0));
            }
            let expected = if needed <= known.unwrap_or(1) {
                Ok(())
            } else {
                Err(Rejected::NeedsVersion { needed, known })
            };
            assert_eq!(service(&mut bench, command), expected, "{command:?} with {known:?}");
        }
    }
    for known in [None, Some(1), Some(3), Some(4), Some(5)] {
        let mut bench = known.map_or_else(|| link(Config::DEFAULT, LINE), ecu);
        let expected =
            if known >= Some(4) { Ok(()) } else { Err(Rejected::NeedsVersion { needed: 4, known }) };
        assert_eq!(bench.order_at_us(bench.now_us(), rpm(50_000)), expected, "{known:?}");
    }
}

/// ZK-7: version, maximum and idle speed are forgotten with the link: the ECU that comes back may be another one.
#[test]
fn zk_7_the_version_does_not_outlive_the_link() {
    let known = |bench: &Bench<ZkLink>| {
        let report = &bench.machine.status().report;
        (report.version.is_some(), report.max_rpm.is_some(), report.idle_rpm.is_some())
    };
    let refused = Err(Rejected::NeedsVersion { needed: 4, known: None });
    let mut bench = ecu(5);
    bench.receive(&zk::idle(30, false));
    bench.receive(&zk::idle(30, false));
    // 0.5 s without a frame is a loss; less is not.
    bench.run_to_us(bench.now_us() + 499_999);
    assert_eq!((known(&bench), bench.machine.speed_control()), ((true, true, true), Ok(())));
    bench.run_to_us(bench.now_us() + 1);
    assert_eq!((known(&bench), bench.machine.speed_control()), ((false, false, false), refused));
    // Another ECU: the scale of its voltages and its commands need two reports.
    for supply in [None, Some(12_000)] {
        bench.receive(&zk::identity(160, 3, 0));
        bench.receive(&zk::status(2, 0, [60, 120, 255]));
        let voltage = bench.machine.status().report.supply.unwrap().value.voltage;
        assert_eq!(voltage.map(Millivolts::get), supply, "0.1 V a step");
    }
    let known = Some(3);
    assert_eq!(bench.machine.speed_control(), Err(Rejected::NeedsVersion { needed: 4, known }));
}

/// ZK-7: a refused rpm leaves the throttle on the wire.
#[test]
fn zk_7_a_refused_order_changes_nothing() {
    let mut bench = running(3);
    bench.order_at_us(bench.now_us(), throttle_tenths(333)).unwrap();
    assert!(bench.order_at_us(bench.now_us(), rpm(50_000)).is_err());
    assert_eq!(slots(&mut bench, 2), [zk::throttle_tenths(RUN, 333), zk::throttle_tenths(RUN, 333)]);
    let mut bench = running(4);
    bench.order_at_us(bench.now_us(), throttle_tenths(333)).unwrap();
    assert!(bench.order_at_us(bench.now_us(), rpm(160_001)).is_err());
    assert_eq!(slots(&mut bench, 2), [zk::throttle_tenths(RUN, 333), zk::throttle_tenths(RUN, 333)]);
    let of_amt = Service::Amt(AmtService::Ctf);
    assert_eq!(service(&mut bench, of_amt), Err(Rejected::NotSupported));
}

/// ZK-7: thrust is valid from version 2, and ESR, SCL and the start-up time from version 4.
#[test]
fn zk_7_each_version_has_its_status_fields() {
    for version in [None, Some(1), Some(2), Some(3), Some(4), Some(5)] {
        let mut bench = link(Config::DEFAULT, LINE);
        if let Some(version) = version {
            bench.receive(&zk::identity(160, version, 0));
            bench.receive(&zk::identity(160, version, 0));
        }
        bench.receive(&zk::status(4, 0, [1, 2, 3]));
        bench.receive(&zk::status(8, 0, [30, 0x30, 25]));
        bench.receive(&zk::status(8, 0, [30, 0x30, 25]));
        let report = &bench.machine.status().report;
        assert!(report.current.is_some() && report.idle_rpm.is_some());
        assert_eq!(report.thrust.is_some(), version >= Some(2), "{version:?}");
        assert_eq!(report.pressure_requested.is_some(), version >= Some(4), "{version:?}");
        assert_eq!(report.closed_loop.is_some(), version >= Some(4), "{version:?}");
        assert_eq!(report.startup.is_some(), version >= Some(4), "{version:?}");
    }
}

/// ZK-6: until two status IDs 6 agree a voltage is its raw byte alone.
#[test]
fn zk_6_voltages_wait_for_the_version() {
    for (version, radio, power, pump) in [
        (None, None, None, None),
        (Some(3), Some(6000), Some(12_000), Some(25_500)),
        (Some(4), Some(12_000), Some(24_000), Some(51_000)),
    ] {
        let mut bench = link(Config::DEFAULT, LINE);
        if let Some(version) = version {
            bench.receive(&zk::status(6, 0, [160, 100, version << 2]));
            bench.receive(&zk::status(6, 0, [160, 100, version << 2]));
        }
        bench.receive(&zk::status(2, 0, [60, 120, 255]));
        let report = &bench.machine.status().report;
        for (reading, raw, voltage) in
            [(report.radio, 60, radio), (report.supply, 120, power), (report.pump, 255, pump)]
        {
            let reading = reading.unwrap().value;
            assert_eq!((reading.raw, reading.voltage.map(Millivolts::get)), (raw, voltage), "{version:?}");
        }
        // The maximum pump voltage is in the same frame as the version.
        let max = report.pump_max.map(|max| max.value.voltage.unwrap().get());
        assert_eq!(max, version.map(|version| if version <= 3 { 10_000 } else { 20_000 }));
    }
}
