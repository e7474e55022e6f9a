//! Service commands.

use super::*;

/// ZK-13: ID 3 immediately before ID 4 or 5, and status ID 5 confirms.
#[test]
fn zk_13_an_unlock_is_sent_immediately_before_its_command() {
    for (command, frame, before, shown) in [
        (curve(40), zk::curve(40), zk::settings(7, 39), zk::settings(7, 40)),
        (ignition(2000), zk::ignition_pump(100), zk::settings(99, 39), zk::settings(100, 39)),
    ] {
        let mut bench = ecu(3);
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        service(&mut bench, command).unwrap();
        bench.run_to_us(90_000);
        // In the slot, and right after the unlock's last stop bit: 4167 µs at 9600 baud.
        assert_eq!(bench.frames(), [(50_000, zk::unlock().to_vec()), (54_167, frame.to_vec())]);
        // When its last stop bit is sent.
        assert_eq!(bench.events(), [(58_334, Event::ServiceSent(command))]);
        bench.receive(&before);
        assert_eq!(bench.event_kinds(), [], "the old value confirms nothing");
        bench.receive(&shown);
        assert_eq!(bench.event_kinds(), [Event::ServiceConfirmed(command)]);
        let rest = slots(&mut bench, 100);
        assert!(rest.iter().all(|frame| id(frame) == 1), "once: {rest:02x?}");
        // The next one is taken.
        service(&mut bench, command).unwrap();
    }
}

/// ZK-13: without a confirmation three attempts, each with its own unlock, two seconds apart; then it failed.
#[test]
fn zk_13_a_command_fails_after_three_attempts() {
    let mut bench = ecu(3);
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    service(&mut bench, curve(40)).unwrap();
    bench.run_to_us(1_000_000);
    assert_eq!(service(&mut bench, curve(50)), Err(Rejected::Busy));
    assert_eq!(service(&mut bench, action(Action::TestPump)), Err(Rejected::Busy));
    for t in 1_000..12_000 {
        if t % 40 == 0 {
            bench.rx_at_us(t * 1000, &zk::settings(7, 39));
        }
    }
    let frames = bench.frames();
    let ours: Vec<_> = frames.iter().filter(|(_, frame)| id(frame) != 1).collect();
    let sent: Vec<_> = ours.iter().map(|(_, frame)| frame.clone()).collect();
    let pair = [zk::unlock().to_vec(), zk::curve(40).to_vec()];
    assert_eq!(sent, [&pair[..], &pair, &pair].concat());
    let unlocks: Vec<u64> = ours.iter().step_by(2).map(|(at, _)| *at).collect();
    for pair in unlocks.windows(2) {
        assert!((2_000_000..=2_200_000).contains(&(pair[1] - pair[0])), "{unlocks:?}");
    }
    let events = bench.events();
    let sent = events.iter().filter(|(_, event)| *event == Event::ServiceSent(curve(40))).count();
    let failed: Vec<_> = events
        .iter()
        .filter(|(_, event)| *event == Event::ServiceFailed(curve(40)))
        .map(|(at, _)| *at)
        .collect();
    assert_eq!((sent, failed.len()), (3, 1));
    assert!(failed[0] >= unlocks[2] + 2_000_000, "the last attempt has its time, too");
    service(&mut bench, curve(50)).unwrap();
}

/// ZK-13: an emergency stop between the unlock and its command goes first; the command does not follow a stop.
#[test]
fn zk_13_a_stop_between_unlock_and_command_is_sent_first() {
    let mut bench = ecu(3);
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    service(&mut bench, curve(40)).unwrap();
    bench.run_to_us(52_000);
    assert_eq!(bench.frames(), [(50_000, zk::unlock().to_vec())]);
    bench.order_at_us(52_000, Order::EmergencyStop).unwrap();
    received_to(&mut bench, 1_000_000);
    let frames = bench.frames();
    assert_eq!(frames[0], (54_167, zk::throttle_tenths(STOP, 0).to_vec()));
    assert!(
        frames.iter().all(|(_, frame)| frame[..] == zk::throttle_tenths(STOP, 0)),
        "nothing but the stop"
    );
    let at: Vec<u64> = frames.iter().skip(1).map(|(at, _)| *at).collect();
    assert_eq!(
        at,
        (2..=20).map(|slot| slot * SEND_SLOT_US).collect::<Vec<_>>(),
        "in every slot, in no burst"
    );
}

/// A service command pre-empted by a stop is cancelled: a drain or a new curve minutes later, when the stop is
/// released, would be a surprise.
#[test]
fn a_stop_ends_a_waiting_service_command() {
    for command in [action(Action::Drain), curve(40)] {
        let mut bench = ecu(3);
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        service(&mut bench, command).unwrap();
        bench.order_at_us(bench.now_us(), Order::EmergencyStop).unwrap();
        bench.run_to_us(600_000_000);
        bench.frames();
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        let frames = slots(&mut bench, 20);
        // With the ECU silent for this long, the stop was also sent as ID 6.
        assert!(frames.iter().all(|frame| matches!(id(frame), 1 | 6)), "{command:?}: {frames:02x?}");
        let reported = bench.event_kinds();
        assert_eq!(reported.iter().filter(|event| **event == Event::ServiceFailed(command)).count(), 1);
        assert!(!reported.contains(&Event::ServiceSent(command)));
        service(&mut bench, command).unwrap();
    }
}

/// An order other than standby ends a service command at every stage and reports it; standby ends none.
#[test]
fn an_order_ends_a_service_command_at_every_stage() {
    let orders = [throttle_tenths(0), rpm(50_000), Order::EmergencyStop, Order::Pwm];
    for order in orders {
        // Waiting; the unlock going out; the command going out; waiting for status ID 5.
        for (at, out, was_sent) in
            [(40_000, 0, false), (52_000, 1, false), (56_000, 2, false), (70_000, 2, true)]
        {
            let mut bench = ecu(4);
            bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
            service(&mut bench, curve(40)).unwrap();
            bench.order_at_us(at, order).unwrap();
            let out_before = bench.frames().into_iter().filter(|(sent, _)| *sent < at).count();
            assert_eq!(out_before, out);
            bench.run_to_us(10_000_000);
            let behind = bench.bytes();
            assert!(behind.iter().all(|frame| !(2..=5).contains(&id(frame))), "{order:?} at {at}");
            let reported = bench.event_kinds();
            let count = |event| reported.iter().filter(|reported| **reported == event).count();
            assert_eq!(count(Event::ServiceFailed(curve(40))), 1, "{order:?} at {at}");
            assert_eq!(count(Event::ServiceSent(curve(40))), usize::from(was_sent), "{order:?} at {at}");
        }
    }
    let mut bench = ecu(4);
    for _ in 0..2 {
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        let _ = service(&mut bench, curve(40));
    }
    bench.run_to_us(100_000);
    assert_eq!(bench.event_kinds(), [Event::ServiceSent(curve(40))]);
}

/// A service command that needs a stopped engine does not go out once the engine is ordered to run.
#[test]
fn an_order_to_run_ends_a_waiting_service_command() {
    for command in [action(Action::Drain), action(Action::OpenPump), curve(40)] {
        let mut bench = ecu(5);
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        slots(&mut bench, 1);
        // The rate has the next slot, so the command waits until the order to run has been sent.
        service(&mut bench, action(Action::Rate20Hz)).unwrap();
        service(&mut bench, command).unwrap();
        bench.order_at_us(bench.now_us(), throttle_tenths(0)).unwrap();
        let frames = slots(&mut bench, 200);
        let run = frames.iter().position(|frame| frame[..] == zk::throttle_tenths(RUN, 0)).expect("runs");
        let behind = &frames[run..];
        // The rate is requested again until the ECU confirms it.
        let rate = zk::action(7);
        assert!(
            behind.iter().all(|frame| id(frame) == 1 || frame[..] == rate),
            "{command:?}: {:?}",
            ids(behind)
        );
        let reported = bench.event_kinds();
        assert!(
            reported.contains(&Event::ServiceFailed(command))
                && !reported.contains(&Event::ServiceSent(command))
        );
    }
}

/// ZK-13: an unlock that was not sent unlocks nothing, so it is sent again before the command.
#[test]
fn zk_13_an_unlock_that_failed_is_sent_again() {
    let mut bench = ecu(3).by_hand();
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    service(&mut bench, curve(40)).unwrap();
    bench.run_to_us(50_000);
    assert_eq!(bench.bytes(), [zk::unlock()]);
    bench.not_sent_at_us(51_000, NotSent::Failed);
    assert_eq!(bench.frames(), []);
    let mut sent = Vec::new();
    for _ in 0..20 {
        let t = bench.now_us() + 10_000;
        bench.run_to_us(t);
        if bench.busy() {
            bench.sent_at_us(t);
        }
        sent.extend(bench.bytes());
    }
    let at = sent.iter().position(|frame| id(frame) == 5).expect("the command");
    assert_eq!(sent[at - 1], zk::unlock());
    assert_eq!(sent.iter().filter(|frame| id(frame) == 5).count(), 1);
}

/// A plain action goes out once, between two frames of the demand.
#[test]
fn an_action_is_sent_once() {
    for one in Action::ALL.into_iter().filter(|one| !(7..=9).contains(&one.code())) {
        let mut bench = ecu(5);
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        service(&mut bench, action(one)).unwrap();
        let frames = slots(&mut bench, 60);
        let sent: Vec<_> = frames.iter().filter(|frame| id(frame) != 1).cloned().collect();
        assert_eq!(sent, [zk::action(one.code())]);
        let reported = bench.event_kinds();
        assert_eq!(reported.iter().filter(|event| **event == Event::ServiceSent(action(one))).count(), 1);
    }
}

/// An action is reported as sent when its last stop bit has been sent.
#[test]
fn an_action_is_reported_when_it_was_sent() {
    let mut bench = ecu(5);
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    service(&mut bench, action(Action::Drain)).unwrap();
    bench.run_to_us(54_166);
    assert_eq!((bench.bytes().len(), bench.events()), (1, vec![]));
    bench.run_to_us(54_167);
    assert_eq!(bench.events(), [(54_167, Event::ServiceSent(action(Action::Drain)))]);
}

/// A service command that never gets through is tried three times, then fails.
#[test]
fn a_service_command_that_never_gets_through_has_failed() {
    for command in [action(Action::Drain), curve(40)] {
        let mut bench = ecu(5).by_hand();
        let tried = match command {
            Service::Zk(ZkService::Action(one)) => zk::action(one.code()),
            _ => zk::unlock(),
        };
        bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
        service(&mut bench, command).unwrap();
        let mut attempts = 0;
        for _ in 0..1_000 {
            bench.run_to_us(bench.now_us() + 10_000);
            attempts += bench.bytes().into_iter().filter(|frame| frame[..] == tried).count();
            if bench.busy() {
                bench.not_sent_at_us(bench.now_us(), NotSent::Failed);
            }
        }
        let reported = bench.event_kinds();
        let count = |event| reported.iter().filter(|reported| **reported == event).count();
        assert_eq!((attempts, count(Event::ServiceFailed(command))), (3, 1), "{command:?}");
        assert_eq!(count(Event::ServiceSent(command)), 0);
    }
}

/// An action that the UART did not send is sent again, and reported when it was sent.
#[test]
fn an_action_that_was_not_sent_is_sent_again() {
    let mut bench = ecu(5).by_hand();
    bench.order_at_us(bench.now_us(), Order::Standby).unwrap();
    service(&mut bench, action(Action::ClosePump)).unwrap();
    bench.run_to_us(50_000);
    assert_eq!(bench.bytes(), [zk::action(13)]);
    bench.not_sent_at_us(51_000, NotSent::Failed);
    assert!(!bench.event_kinds().contains(&Event::ServiceSent(action(Action::ClosePump))));
    let mut sent_again = 0;
    for _ in 0..100 {
        let t = bench.now_us() + 10_000;
        bench.run_to_us(t);
        sent_again += bench.bytes().into_iter().filter(|frame| frame[..] == zk::action(13)).count();
        if bench.busy() {
            bench.sent_at_us(t);
        }
    }
    let reported = bench.event_kinds();
    let count = |event| reported.iter().filter(|reported| **reported == event).count();
    assert_eq!((sent_again, count(Event::ServiceSent(action(Action::ClosePump)))), (1, 1));
    assert_eq!(count(Event::ServiceFailed(action(Action::ClosePump))), 0);
}
