//! A transmitter that fails or hangs for 1 s is reported, once, and so is its first frame afterwards. The next demand does not begin
//! from one that was not sent.

use jetlink::command::Origin;
use jetlink::event::Event;
use jetlink::report::NotSent;

use crate::support::scenario::{BOTH, Ecu, FRAME_PERIOD_US, Reports, SECOND, Scenario, Wire, percent, run};
use bench::by_hand::at_us;

/// Reports about the transmitter of a running engine while no frame is sent for `millis` ms, because of `why`.
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
        // A reply that is too late shows nothing about the transmitter.
        assert_eq!(reported(ecu, NotSent::TooLate, 2500), (vec![], false), "{ecu:?}");
    }
}

/// The next frames fail for `why`, this many of them.
fn fails(scenario: &mut Scenario, why: NotSent, times: usize) {
    for _ in 0..times {
        next_frame(scenario);
        let failed_at = scenario.now_us() + 2 * FRAME_PERIOD_US / 5;
        scenario.run_to_us(failed_at);
        scenario.bench.not_sent_at_us(failed_at, why);
    }
}

/// Lets time pass until a frame is handed out.
fn next_frame(scenario: &mut Scenario) -> Wire {
    scenario.sent();
    while !scenario.bench.busy() {
        scenario.pass_us(FRAME_PERIOD_US / 50);
    }
    scenario.sent().pop().expect("a switch and a demand")
}

/// The first throttle handed out after this number of unsent frames at idle, and then at 100 %, because of `why`.
fn first_throttle_after(ecu: Ecu, why: NotSent, at_idle: usize, at_full: usize) -> Wire {
    let mut scenario = Scenario::started_with(ecu, ecu.config(), percent(0));
    scenario.reports(Reports::Running).fly_us(run(0), Origin::Rc, 2 * SECOND);
    while scenario.bench.busy() {
        scenario.pass_us(FRAME_PERIOD_US / 50);
    }
    scenario.bench = scenario.bench.by_hand();
    fails(&mut scenario, why, at_idle);
    scenario.command(run(0)).unwrap();
    scenario.command(run(100)).unwrap();
    fails(&mut scenario, why, at_full);
    next_frame(&mut scenario)
}

/// Whether the unsent frames came before or after the stick moved. The control: if all were sent, it jumps.
#[test]
fn a_demand_after_frames_that_were_not_sent_rises_from_the_one_that_was_sent() {
    for ecu in BOTH {
        for why in [NotSent::Failed, NotSent::TimedOut] {
            for (at_idle, at_full) in [(0, 1), (1, 0), (1, 1), (3, 3), (0, 8)] {
                let Wire::Run(tenths) = first_throttle_after(ecu, why, at_idle, at_full) else {
                    panic!("{ecu:?} runs")
                };
                // 50 % a second, for two frames at most.
                assert!(tenths <= 50, "{ecu:?} {why:?} {at_idle} {at_full}: {tenths}");
            }
            assert_eq!(first_throttle_after(ecu, why, 0, 0), Wire::Run(1000), "{ecu:?}");
        }
    }
}
