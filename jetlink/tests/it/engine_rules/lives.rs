//! When a life is in doubt, and when it has ended.

use super::*;

/// "Doubt acts at once ... one report that does not fit a living engine puts the life in doubt", "The shaft speed in every
/// ZK status and AMT normal set may raise doubt": an engine whose shaft is at rest is not sent run forever.
#[test]
fn amt_a_shaft_at_rest_raises_doubt_in_any_state() {
    for state in [0b00100, 0b01000, 0b11111] {
        let mut scenario = flying(Ecu::Amt, 50);
        let end = scenario.now_us() + 60 * SECOND;
        while scenario.now_us() < end {
            let _ = scenario.command(run(50));
            receive(&mut scenario, &amt_frames::normal(state, amt_frames::RUN, 0));
        }
        scenario.sent();
        let _ = scenario.command(run(50));
        receive(&mut scenario, &amt_frames::normal(state, amt_frames::RUN, 0));
        assert_eq!(
            scenario.sent(),
            [],
            "{state:#07b}: the shaft is at rest for 60 s; in doubt since {:?}",
            scenario.telemetry().in_doubt
        );
    }
}

/// "When the fault clears, the reply to the first normal sets is not run unless they report running."
#[test]
fn amt_when_a_fault_clears_run_waits_for_sets_that_report_running() {
    for state in [0b00001, 0b00010, 0b00100, 0b01000, 0b11111] {
        let mut scenario = flying(Ecu::Amt, 90);
        // The exhaust is hot.
        scenario.values.egt_celsius = 600;
        scenario.fly_us(run(90), Origin::Rc, 2 * SECOND);
        scenario.values.fault = 0x08;
        scenario.fly_us(run(90), Origin::Rc, SECOND);
        scenario.values.fault = 0;
        scenario.sent();
        let _ = scenario.command(run(90));
        // The shaft still coasts, at 15 000 rpm.
        let mut set = amt_frames::normal(state, amt_frames::AUTO_STOP, 30);
        set[3] = 140;
        receive(&mut scenario, &set);
        assert_eq!(scenario.sent(), [], "{state:#07b}");
    }
}

/// "One report that does not fit a living engine puts the life in doubt, already in the reply to that very frame": a
/// flame-out to start clearance while the shaft coasts.
#[test]
fn amt_start_clearance_in_flight_puts_the_life_in_doubt_in_the_reply_to_that_frame() {
    let mut scenario = flying(Ecu::Amt, 90);
    scenario.sent();
    for _ in 0..20 {
        let _ = scenario.command(run(90));
        receive(&mut scenario, &amt_frames::normal(amt_frames::CLEARANCE, amt_frames::AUTO_STOP, 30));
    }
    let sent = scenario.sent();
    assert!(!sent.contains(&Wire::Run(900)), "{} replies of run at 90 %", runs_in(&sent).len());
}

/// "A life that is not confirmed within a stated bound loses permission and order": AMT, whose ECU continues sending.
#[test]
fn amt_a_life_in_doubt_ends_within_a_bound() {
    let mut scenario = flying(Ecu::Amt, 90);
    let end = scenario.now_us() + 600 * SECOND;
    while scenario.now_us() < end {
        let _ = scenario.command(run(90));
        // Running, with the shaft at rest.
        receive(&mut scenario, &amt_frames::normal(amt_frames::FULL_OPERATION, amt_frames::RUN, 0));
    }
    assert!(
        !matches!(scenario.order(), Order::Doubt(_) | Order::Run(_)),
        "after 10 min in doubt: {:?}",
        scenario.order()
    );
}

/// Exhaust as the evidence: a flame-out under an autothrottle whose demand falls by 3 % every 4 s. "An order to run without a
/// living engine ends".
#[test]
fn a_flame_out_ends_the_run_although_the_demand_dithers() {
    let mut scenario = flying(Ecu::Amt, 75);
    scenario.values.egt_celsius = 600;
    scenario.fly_us(run(75), Origin::Rc, 2 * SECOND);
    scenario.values.fault = 0x01;
    scenario.fly_us(run(75), Origin::Rc, SECOND);
    for n in 0..40 {
        for (whole, seconds) in [(75, 2), (72, 2)] {
            for _ in 0..10 * seconds {
                // 30 degrees a second, down to 20.
                scenario.values.egt_celsius = (scenario.values.egt_celsius - 3).max(20);
                scenario.fly_us(run(whole), Origin::Rc, COMMAND_PERIOD_US);
            }
        }
        if scenario.order() == Order::Standby {
            return;
        }
        let _ = n;
    }
    scenario.sent();
    scenario.fly_us(run(75), Origin::Rc, SECOND);
    panic!("the exhaust has had 20 degrees for over 2 min: {:?}", scenario.sent());
}

/// "After it, ... any starting state after a gap counts as starting again."
#[test]
fn amt_a_starting_state_after_a_gap_is_a_new_start() {
    for shaft in [0] {
        let mut scenario = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
        scenario.command(run(0)).unwrap();
        for _ in 0..4 {
            let _ = scenario.command(run(0));
            receive(&mut scenario, &amt_frames::normal(amt_frames::STARTED_UP, amt_frames::RUN, shaft));
        }
        scenario.silent().fly_us(run(0), Origin::Rc, SECOND);
        scenario.sent();
        for _ in 0..20 {
            let _ = scenario.command(run(0));
            receive(&mut scenario, &amt_frames::normal(amt_frames::STARTED_UP, amt_frames::RUN, shaft));
        }
        assert_eq!(scenario.order(), Order::Standby, "shaft {shaft}: {:?}", scenario.sent());
    }
}

/// The same after a gap longer than the serial delay time, in which the ECU itself had to stop its turbine (AMT-12): it
/// coasts in start clearance, while its source commands run.
#[test]
fn an_engine_that_its_ecu_stopped_in_a_gap_of_1_s_gets_no_run_while_it_coasts() {
    stopped_in_a_gap(SECOND);
}

#[test]
fn an_engine_that_its_ecu_stopped_in_a_gap_of_5_s_gets_no_run_while_it_coasts() {
    stopped_in_a_gap(5 * SECOND);
}

fn stopped_in_a_gap(gap_us: u64) {
    {
        let mut scenario = flying(Ecu::Amt, 90);
        scenario.silent().fly_us(run(90), Origin::Rc, gap_us);
        scenario.sent();
        for n in 0..100 {
            let _ = scenario.command(run(90));
            receive(
                &mut scenario,
                &amt_frames::normal(amt_frames::CLEARANCE, amt_frames::AUTO_STOP, 140 - n),
            );
        }
        let sent = runs_in(&scenario.sent());
        let first = sent.first().copied();
        let last = sent.last().copied();
        assert_eq!(sent.len(), 0, "gap {} s: run, first {first:?}, last {last:?}", gap_us / SECOND);
    }
}

/// "When no set was answered for the ECU's serial delay time the order is given up": a reply that the transmitter did not send
/// answers nothing.
#[test]
fn amt_replies_that_were_not_sent_do_not_keep_an_order() {
    for (sends, given_up) in [(true, false), (false, true)] {
        let mut scenario = flying(Ecu::Amt, 50);
        scenario.silent().pass_us(600_000);
        scenario.bench = scenario.bench.clone().by_hand();
        scenario.bench.events();
        let calibrates = amt_frames::normal(amt_frames::IDLE_CALIBRATION, amt_frames::RUN, 70);
        let from = scenario.now_us();
        while scenario.now_us() < from + 6 * SECOND {
            let _ = scenario.command(run(50));
            receive(&mut scenario, &calibrates);
            let now = scenario.now_us();
            assert!(scenario.bench.busy() || !sends, "it is answered");
            match sends {
                true => scenario.bench.sent_at_us(now),
                false if scenario.bench.busy() => scenario.bench.not_sent_at_us(now, NotSent::TimedOut),
                false => {}
            }
        }
        let cancelled = Event::RunCancelled(End::Unconfirmed);
        assert_eq!(scenario.bench.event_kinds().contains(&cancelled), given_up, "sends: {sends}");
    }
}
