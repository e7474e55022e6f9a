//! A transmitter that fails or hangs for 1 s is reported, once, and so is its first frame afterwards.

use jetlink::command::Origin;
use jetlink::event::Event;
use jetlink::report::NotSent;

use crate::support::bench::at_us;
use crate::support::scenario::{BOTH, Ecu, FRAME_PERIOD_US, Reports, SECOND, Scenario, percent, run};

/// What is reported of the transmitter of a running engine none of whose frames are sent, for `why`, for this long.
fn reported(ecu: Ecu, why: NotSent, millis: u64) -> (Vec<Event>, bool) {
    let mut scenario = Scenario::started_with(ecu, ecu.config(), percent(50));
    scenario.reports(Reports::Running).fly_us(run(50), Origin::Rc, 2 * SECOND);
    scenario.bench.events();
    scenario.bench = scenario.bench.by_hand();
    // The first frame that fails begins the time.
    let (mut first, mut failed) = (None, false);
    loop {
        let _ = scenario.command(run(50));
        scenario.pass_us(FRAME_PERIOD_US / 2);
        let now = scenario.now_us();
        failed |= scenario.bench.machine.telemetry(at_us(now)).transmitter_failed;
        if first.is_some_and(|first| now > first + millis * 1000) {
            break;
        }
        if scenario.bench.busy() {
            first.get_or_insert(now);
            scenario.bench.not_sent_at_us(now, why);
        }
    }
    if scenario.bench.busy() {
        let now = scenario.now_us();
        scenario.bench.sent_at_us(now);
    }
    scenario.fly_us(run(50), Origin::Rc, SECOND / 2);
    let events = scenario.bench.event_kinds().into_iter();
    let events = events.filter(|event| matches!(event, Event::TransmitterFailed | Event::TransmitterWorks));
    (events.collect(), failed)
}

#[test]
fn a_transmitter_that_fails_for_a_second_is_reported_once() {
    for ecu in BOTH {
        for why in [NotSent::Failed, NotSent::TimedOut] {
            let failed = vec![Event::TransmitterFailed, Event::TransmitterWorks];
            assert_eq!(reported(ecu, why, 2500), (failed, true), "{ecu:?} {why:?}");
            assert_eq!(reported(ecu, why, 800), (vec![], false), "{ecu:?} {why:?}");
        }
        // A reply that is too late says nothing about the transmitter.
        assert_eq!(reported(ecu, NotSent::TooLate, 2500), (vec![], false), "{ecu:?}");
    }
}
