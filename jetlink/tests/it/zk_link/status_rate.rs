//! The status rate.

use super::*;

/// ZK-11: when status ID 6 shows another rate it is set by ID 2, and confirmed by ID 6.
#[test]
fn zk_11_rate_is_set_and_confirmed() {
    for (wanted, parameter) in [(Rate::Hz20, 7), (Rate::Hz50, 8), (Rate::Hz100, 9)] {
        for reported in 0..=3u8 {
            let mut bench = link(Config { rate: wanted, ..Config::DEFAULT }, LINE);
            bench.order_at_us(0, Order::Standby).unwrap();
            bench.run_to_us(300_000);
            assert!(bench.bytes().iter().all(|frame| id(frame) != 2), "not before ID 6 has carried it");
            bench.receive(&zk::identity(160, 1, reported));
            bench.run_to_us(500_000);
            let ordered: Vec<_> = bench.bytes().into_iter().filter(|frame| id(frame) == 2).collect();
            if reported == rate_code(wanted) {
                assert_eq!(ordered, Vec::<Vec<u8>>::new());
            } else {
                assert_eq!(ordered, [zk::action(parameter)]);
                assert!(!bench.event_kinds().contains(&Event::RateConfirmed(wanted)));
                bench.receive(&zk::identity(160, 1, rate_code(wanted)));
            }
            assert!(bench.event_kinds().contains(&Event::RateConfirmed(wanted)), "{wanted:?} {reported}");
            bench.run_to_us(5_000_000);
            assert!(bench.bytes().iter().all(|frame| id(frame) != 2), "confirmed");
        }
    }
}

/// ZK-11: ordered again every second, five times, then given up; after a loss the ECU gets the order again.
#[test]
fn zk_11_rate_is_retried_and_given_up() {
    let mut bench = link(Config { rate: Rate::Hz50, ..Config::DEFAULT }, LINE);
    bench.order_at_us(0, Order::Standby).unwrap();
    for frame in 0..500 {
        bench.rx_at_us(frame * 20_000 + 5_000, &zk::identity(160, 4, 0));
    }
    let ordered: Vec<u64> =
        bench.frames().into_iter().filter(|(_, frame)| id(frame) == 2).map(|(at, _)| at).collect();
    assert_eq!(ordered.len(), 5);
    assert!(
        ordered.windows(2).all(|pair| (1_000_000..=1_040_000).contains(&(pair[1] - pair[0]))),
        "{ordered:?}"
    );
    let given_up =
        bench.event_kinds().into_iter().filter(|event| *event == Event::RateNotConfirmed(Rate::Hz50));
    assert_eq!(given_up.count(), 1);
    let t = bench.now_us() + 2_000_000; // silence
    bench.rx_at_us(t, &zk::identity(160, 4, 0));
    bench.run_to_us(t + 100_000);
    assert!(bench.bytes().contains(&zk::action(8).to_vec()));
}

/// ZK-11: an ECU that falls back to another rate while it is received is set again.
#[test]
fn zk_11_an_ecu_that_falls_back_to_another_rate_is_set_again() {
    let mut bench = ecu(4);
    bench.receive(&zk::identity(160, 4, 2));
    bench.run_to_us(200_000);
    assert!(bench.bytes().contains(&zk::action(7).to_vec()));
}

/// ZK-11: a rate by service command: refused where the line cannot carry it; the slots follow it.
#[test]
fn zk_11_a_service_command_changes_the_rate() {
    for (baud, rate, fits) in [
        (2400, Action::Rate20Hz, true),
        (2400, Action::Rate50Hz, false),
        (4800, Action::Rate50Hz, true),
        (4800, Action::Rate100Hz, false),
        (9600, Action::Rate100Hz, true),
    ] {
        let mut bench = link(Config::DEFAULT, Line::new(baud));
        bench.receive(&zk::identity(160, 4, 0));
        let expected = if fits { Ok(()) } else { Err(Rejected::RateTooFast) };
        assert_eq!(service(&mut bench, action(rate)), expected, "{baud} {rate:?}");
    }
    let mut bench = ecu(4);
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    service(&mut bench, action(Action::Rate100Hz)).unwrap();
    bench.rx_at_us(205_000, &zk::identity(160, 4, 2));
    assert!(bench.bytes().contains(&zk::action(9).to_vec()));
    assert_eq!(bench.event_kinds(), [Event::RateConfirmed(Rate::Hz100)]);
    bench.run_to_us(1_205_000);
    assert_eq!(bench.frames().len(), 100);
}

/// ZK-11: an ECU that was given another rate sends at the one before until it reports the new one. Until then three missing frames
/// are those of the slower rate: a rate that changes twice puts no engine in doubt.
#[test]
fn zk_11_frames_are_expected_at_the_slower_rate_until_the_ecu_reports_the_new_one() {
    let config = Config { rate: Rate::Hz100, ..Config::DEFAULT };
    let mut bench = ecu_with(config, 5, 160);
    let gap_us = |bench: &mut Bench<ZkLink>, frame: &[u8]| {
        bench.receive(frame);
        bench.machine.gap_at().expect("frames are expected").as_micros() - bench.now_us()
    };
    let state = zk::state(STATE_STANDBY);
    assert_eq!(gap_us(&mut bench, &state), 30_000);
    service(&mut bench, action(Action::Rate20Hz)).unwrap();
    bench.run_to_us(30_000);
    service(&mut bench, action(Action::Rate100Hz)).unwrap();
    assert_eq!(gap_us(&mut bench, &state), 150_000);
    // One report of the new rate is enough to expect it, and of a slower one as well.
    assert_eq!(gap_us(&mut bench, &zk::identity(160, 5, 2)), 30_000);
    assert_eq!(gap_us(&mut bench, &zk::identity(160, 5, 0)), 150_000);
}

/// ZK-11: the slower rate of the ECU stays known when the link is lost: one report of a faster one, which may be a damaged frame, does
/// not shorten the time to a gap. Two do.
#[test]
fn zk_11_after_a_loss_one_report_of_a_faster_rate_is_not_expected() {
    let mut bench = link(Config { rate: Rate::Hz100, ..Config::DEFAULT }, LINE);
    let gap_us = |bench: &mut Bench<ZkLink>, rate_code: u8| {
        bench.receive(&zk::identity(160, 5, rate_code));
        bench.machine.gap_at().expect("frames are expected").as_micros() - bench.now_us()
    };
    assert_eq!(gap_us(&mut bench, 0), 150_000);
    assert_eq!(gap_us(&mut bench, 0), 150_000);
    bench.run_to_us(bench.now_us() + 600_000);
    assert_eq!(bench.machine.status().state, LinkState::Lost);
    assert_eq!(gap_us(&mut bench, 2), 150_000);
    assert_eq!(gap_us(&mut bench, 2), 30_000);
}
