//! The ambient pressure.

use super::*;

/// ZK-14: once a second, while the ECU requests it and a fresh pressure is known; never an invented one.
#[test]
fn zk_14_pressure_is_sent_once_a_second_when_requested_known_and_fresh() {
    let sent = |bench: &mut Bench<ZkLink>| -> Vec<(u64, Vec<u8>)> {
        bench.frames().into_iter().filter(|(_, frame)| id(frame) == 8).collect()
    };
    let requests = |bench: &mut Bench<ZkLink>, to_us: u64, requests: bool| {
        while bench.now_us() < to_us {
            let t = bench.now_us() + 100_000;
            bench.rx_at_us(t, &zk::idle(30, requests));
        }
    };
    let mut bench = ecu(4);
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    requests(&mut bench, 3_000_000, true);
    assert_eq!(sent(&mut bench), [], "none known");
    pressure(&mut bench, 1013);
    requests(&mut bench, 6_000_000, true);
    let first = sent(&mut bench);
    assert_eq!(first.len(), 3);
    assert!(first.iter().all(|(_, frame)| frame[..] == zk::pressure(1013)));
    assert!(
        first.windows(2).all(|pair| (1_000_000..=1_050_000).contains(&(pair[1].0 - pair[0].0))),
        "{first:?}"
    );
    requests(&mut bench, 20_000_000, true);
    let stale = sent(&mut bench);
    assert!(stale.last().is_none_or(|(at, _)| *at <= 8_010_000), "5 s old: {stale:?}");
    requests(&mut bench, 20_100_000, false);
    pressure(&mut bench, 990);
    requests(&mut bench, 22_000_000, false);
    assert_eq!(sent(&mut bench), [], "not requested");
    requests(&mut bench, 23_000_000, true);
    assert_eq!(sent(&mut bench)[0].1, zk::pressure(990));
}

/// ZK-14, ZK-7: an ECU below version 4 has no ESR and no ID 8, whatever its bits say.
#[test]
fn zk_14_no_pressure_is_sent_below_version_4() {
    for (version, expected) in [(3, false), (4, true)] {
        let mut bench = ecu(version);
        pressure(&mut bench, 1013);
        bench.receive(&zk::idle(30, true));
        bench.run_to_us(3_000_000);
        assert_eq!(bench.bytes().iter().any(|frame| id(frame) == 8), expected, "version {version}");
    }
}
