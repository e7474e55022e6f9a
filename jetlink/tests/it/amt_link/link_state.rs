//! Link state.

use super::*;

/// Up after two frames, lost by the timer at exactly `lost_after` after the last one, up again after two.
#[test]
fn link_is_up_after_two_frames_and_lost_exactly_to_the_tick() {
    let frame = normal(CLEARANCE, AUTO_STOP, 0);
    let mut bench = default();
    assert_eq!((bench.machine.status().state, bench.deadline_us()), (LinkState::Silent, Some(1_000_000)));
    bench.rx_at_us(100_000, &frame);
    assert_eq!((bench.machine.status().state, bench.event_kinds()), (LinkState::Silent, vec![]));
    bench.rx_at_us(225_000, &frame);
    assert_eq!(bench.machine.status().state, LinkState::Up);
    assert_eq!(bench.events()[0], (225_000, Event::LinkUp));
    bench.run_to_us(300_000);
    assert_eq!(bench.deadline_us(), Some(1_225_000));
    bench.timeout_at_us(1_224_999);
    assert_eq!(
        (bench.machine.status().state, bench.event_kinds()),
        (LinkState::Up, vec![]),
        "early calls do nothing"
    );
    bench.timeout_at_us(1_225_000);
    assert_eq!((bench.machine.status().state, bench.event_kinds()), (LinkState::Lost, vec![Event::LinkLost]));
    assert_eq!(bench.machine.status().last_rx, Some(at_us(225_000)));
    bench.run_to_us(60_000_000);
    assert_eq!(bench.event_kinds(), [], "once");
    bench.rx_at_us(60_000_000, &frame);
    assert_eq!(bench.machine.status().state, LinkState::Lost);
    bench.rx_at_us(60_125_000, &frame);
    assert_eq!((bench.machine.status().state, bench.event_kinds()), (LinkState::Up, vec![Event::LinkUp]));
}

/// Two frames that are more than `lost_after` apart do not bring the link up.
#[test]
fn two_frames_far_apart_are_not_consecutive() {
    let frame = normal(CLEARANCE, AUTO_STOP, 0);
    let mut bench = default();
    for t in [900_000, 2_900_000, 4_900_000, 6_900_000] {
        bench.rx_at_us(t, &frame);
        assert_ne!(bench.machine.status().state, LinkState::Up, "{t}");
    }
    bench.rx_at_us(7_899_999, &frame);
    assert_eq!(bench.machine.status().state, LinkState::Up);
}

/// AMT-1: a frame with a line error is answered, but does not prove an ECU: it neither brings the link up nor
/// keeps it up.
#[test]
fn amt_1_damaged_frames_do_not_keep_the_link_up() {
    let frame = normal(CLEARANCE, AUTO_STOP, 0);
    let mut bench = default();
    for _ in 0..6 {
        bench.machine.line_error(LineError::Framing);
        reply_to(&mut bench, &frame);
    }
    assert_eq!((bench.machine.status().state, bench.machine.status().last_rx), (LinkState::Silent, None));
    reply_to(&mut bench, &frame);
    let t = bench.now_us();
    assert_eq!(
        (bench.machine.status().state, bench.machine.status().last_rx),
        (LinkState::Silent, Some(at_us(t)))
    );
    reply_to(&mut bench, &frame);
    let received = bench.now_us();
    assert_eq!(bench.machine.status().state, LinkState::Up);
    bench.event_kinds();
    for _ in 0..7 {
        bench.machine.line_error(LineError::Noise);
        reply_to(&mut bench, &frame);
    }
    assert_eq!(
        (bench.machine.status().state, bench.machine.status().last_rx),
        (LinkState::Up, Some(at_us(received)))
    );
    bench.machine.line_error(LineError::Noise);
    reply_to(&mut bench, &frame); // this one comes with the timer, a second after the last good one
    assert_eq!((bench.machine.status().state, bench.event_kinds()), (LinkState::Lost, vec![Event::LinkLost]));
    for _ in 0..2 {
        assert_eq!(bench.machine.status().state, LinkState::Lost);
        reply_to(&mut bench, &frame);
    }
    assert_eq!(bench.machine.status().state, LinkState::Up);
}

/// An ECU that was never received is also reported lost once.
#[test]
fn an_ecu_that_was_never_received_is_lost_once() {
    let mut bench = default();
    bench.run_to_us(100_000_000);
    assert_eq!(bench.events(), [(1_000_000, Event::LinkLost)]);
    assert_eq!(bench.machine.status().last_rx, None);
}

/// AMT-9: the set-up set reports that the ECU came out of its power-up.
#[test]
fn amt_9_a_restart_of_the_ecu_is_reported() {
    let mut bench = running();
    reply_to(&mut bench, &setup("9.35 140617 "));
    let events = bench.event_kinds();
    assert_eq!(events, [Event::EngineIdentified(EngineModel::Olympus), Event::EcuStarted]);
    let report = &bench.machine.status().report;
    assert_eq!(report.amt_setup.unwrap().value.version(), "9.35");
    assert_eq!(report.amt_setup.unwrap().at, at_us(bench.now_us()));
}
