//! Orders that were given up.

use super::*;
use jetlink::engine::config::Governor;

/// Flies at 80 % under RC, which commands for this long after the ECU fell silent. Returns when it last commanded.
fn given_up(ecu: Ecu, rc_for: u64, lower: Option<Command>) -> (Scenario, u64) {
    let mut scenario = Scenario::started(ecu, percent(80));
    scenario.silent();
    let end = scenario.now_us() + rc_for;
    while scenario.now_us() < end {
        scenario.command(run(80)).ok();
        if let Some(command) = lower {
            scenario.command_from(command, Origin::Mavlink).ok();
        }
        scenario.pass_us(COMMAND_PERIOD_US);
    }
    (scenario, end - COMMAND_PERIOD_US)
}

/// When the order is given up in doubt, the run was still RC's: a lower source's stream of standby waits for the loss of RC
/// and its time, as it does while the order is in force. RC's own counts at once.
#[test]
fn standby_of_a_lower_source_waits_after_an_order_was_abandoned() {
    for ecu in [Ecu::Amt] {
        let (mut scenario, last) = given_up(ecu, 11 * SECOND, Some(Command::Standby));
        assert_eq!(scenario.order(), Order::Listen, "{ecu:?}");
        // Default: 5 s after the fail-safe stage began.
        let due = last + SOURCE_TIMEOUT_US + HOLD_US + 5 * SECOND;
        while scenario.now_us() < due - COMMAND_PERIOD_US {
            scenario.fly_us(Command::Standby, Origin::Mavlink, COMMAND_PERIOD_US);
            assert_eq!(scenario.order(), Order::Listen, "{ecu:?} {} µs before", due - scenario.now_us());
        }
        scenario.fly_us(Command::Standby, Origin::Mavlink, 2 * COMMAND_PERIOD_US);
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}");

        let (mut scenario, _) = given_up(ecu, 11 * SECOND, None);
        scenario.fly_us(Command::Standby, Origin::Rc, 2 * COMMAND_PERIOD_US);
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}: RC's own");
    }
}

/// An engine that returns after its order was given up continues where the stages of loss are by then. If its source is
/// present, it continues at the throttle that the ECU reports.
#[test]
fn an_engine_that_returns_resumes_where_the_stages_of_loss_have_come() {
    // RC is lost at 0.5 s, the hold ends at 1.5 s, and 80 % have fallen by 3.1 s.
    for (later, expected) in [(SECOND, 80), (2_500_000, 30), (4 * SECOND, 0)] {
        let (mut scenario, last) = given_up(Ecu::Amt, 5 * SECOND, None);
        assert_eq!(scenario.order(), Order::Listen);
        scenario.run_to_us(last + later - 2 * FRAME_PERIOD_US);
        scenario.values.half_percents = 160;
        scenario.reports = Some(Reports::Running);
        while !matches!(scenario.order(), Order::Run(_)) {
            scenario.pass_us(FRAME_PERIOD_US);
        }
        let tenths = scenario.tenths();
        assert!(tenths.abs_diff(expected * 10) <= 30, "{tenths} after {later} µs");
    }
    let (mut scenario, _) = given_up(Ecu::Amt, 9 * SECOND, None);
    scenario.values.half_percents = 160;
    scenario.reports = Some(Reports::Running);
    scenario.fly_us(run(80), Origin::Rc, 4 * FRAME_PERIOD_US);
    assert_eq!(scenario.tenths(), 800, "RC is there");
}

/// The same over resets: the silence before them counts, whether the order is given up before a reset or after it (853000865). The control: the engine
/// returns before the hold ends.
#[test]
fn the_stages_of_loss_continue_over_resets_and_an_order_that_is_given_up() {
    let resumes_at = |resets: &[u64], back: u64, hold: u64| {
        let config = Ecu::Amt.with(|rules| rules.loss.hold = Duration::from_secs(hold));
        let mut scenario = Scenario::started_with(Ecu::Amt, config, percent(80));
        scenario.silent();
        let mut before = 0;
        for &reset in resets {
            scenario.pass_us(reset - before);
            scenario = scenario.reset(config);
            before = reset;
        }
        scenario.pass_us(back - before);
        scenario.values.half_percents = 160;
        scenario.reports = Some(Reports::Running);
        while !matches!(scenario.order(), Order::Run(_)) {
            scenario.pass_us(FRAME_PERIOD_US);
        }
        scenario.tenths()
    };
    let late = 8 * SECOND;
    for (resets, back) in [
        (&[][..], late),
        (&[3 * SECOND], late),
        (&[3 * SECOND, 5 * SECOND], late),
        (&[6 * SECOND], late),
        (&[3_500_000, 4_300_000], 4_800_000),
    ] {
        assert_eq!([1, 20].map(|hold| resumes_at(resets, back, hold)), [0, 800], "{resets:?}");
    }
}

/// Two commands of standby from the source in control shut an engine down at once, also where its order was given up meanwhile and
/// the engine was found again: the source is the same.
#[test]
fn standby_of_its_source_counts_at_once_after_an_abandoned_order_resumed() {
    for gap in [false, true] {
        let config = Ecu::Amt.with(|rules| rules.loss.hold = Duration::from_secs(8));
        let mut scenario = Scenario::started_with(Ecu::Amt, config, percent(80));
        scenario.reports = Some(Reports::Running);
        scenario.values.half_percents = 160;
        scenario.fly_us(run(80), Origin::Rc, 2 * SECOND);
        if gap {
            scenario.silent();
        }
        // RC is lost, too, and returns.
        scenario.pass_us(4_500_000);
        assert_eq!(scenario.order() == Order::Listen, gap);
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(run(0), Origin::Rc, 1_500_000);
        let since = scenario.now_us();
        while scenario.order() != Order::Standby && scenario.now_us() < since + 20 * SECOND {
            scenario.fly_us(Command::Standby, Origin::Rc, COMMAND_PERIOD_US);
        }
        let took = scenario.now_us() - since;
        assert!(took < SECOND, "gap {gap}: {took} µs");
    }
}

/// Without a record a ZK engine is seen running before its throttle is known. A stream of standby is that of a lower source then, too.
#[test]
fn an_engine_that_is_seen_running_without_a_record_is_not_shut_down_at_once() {
    for (reports, soon) in [(Reports::Running, false), (Reports::Standby, true)] {
        let mut scenario = Scenario::nothing_received(Ecu::Zk, Ecu::Zk.config());
        scenario.reports = Some(reports);
        scenario.introduce();
        scenario.fly_us(Command::Standby, Origin::Bench, 2 * SECOND);
        assert_eq!(scenario.order() == Order::Standby, soon, "{reports:?}");
        scenario.fly_us(Command::Standby, Origin::Bench, 10 * SECOND);
        assert_eq!(scenario.order(), Order::Standby, "{reports:?}");
    }
}

/// Nor is it where a third, still lower source commands the demand that was found, and takes over at once: whose run it is, is not known
/// before a higher source had 5 s to be received (877002124). A run of a known source is the control, and so is a source's own standby.
#[test]
fn a_lower_source_that_takes_over_a_found_engine_does_not_let_another_one_shut_it_down() {
    let both = |scenario: &mut Scenario, origin, standby_us: u64| {
        let since = scenario.now_us();
        while scenario.now_us() < since + standby_us && scenario.order() != Order::Standby {
            let _ = scenario.command_from(run(50), Origin::Bench);
            scenario.fly_us(Command::Standby, origin, COMMAND_PERIOD_US);
        }
        scenario.now_us() - since
    };
    for ecu in BOTH {
        let found = || {
            let mut scenario = Scenario::nothing_received(ecu, ecu.config());
            scenario.values.half_percents = 100;
            scenario.reports = Some(Reports::Running);
            scenario.introduce();
            // A ZK engine that reports no throttle is looked at for 3 s, and is at idle until Bench has waited for 2 s.
            for _ in 0..120 {
                if scenario.order() != Order::Run(percent(50)) {
                    scenario.fly_us(run(50), Origin::Bench, COMMAND_PERIOD_US);
                }
            }
            assert_eq!(scenario.order(), Order::Run(percent(50)), "{ecu:?}");
            scenario
        };
        let took = both(&mut found(), Origin::Mavlink, 20 * SECOND);
        assert!((2 * SECOND..6 * SECOND).contains(&took), "{ecu:?}: {took} µs");
        // Where the source whose run it is commands in time, the run continues.
        let mut scenario = found();
        both(&mut scenario, Origin::Mavlink, SECOND);
        for _ in 0..200 {
            let _ = scenario.command_from(Command::Standby, Origin::Mavlink);
            scenario.fly_us(run(50), Origin::Rc, COMMAND_PERIOD_US);
            assert_eq!(scenario.order(), Order::Run(percent(50)), "{ecu:?}");
        }
        let mut own = found();
        own.fly_us(Command::Standby, Origin::Bench, SECOND);
        assert_eq!(own.order(), Order::Standby, "{ecu:?}");
        let mut known = flying(ecu);
        known.fly_us(run(50), Origin::Bench, 3 * SECOND);
        let took = both(&mut known, Origin::Mavlink, 20 * SECOND);
        assert!(took < SECOND, "{ecu:?}: {took} µs");
    }
}

/// Without a record, an ECU that is not received may have a running engine. Whoever commands standby meanwhile may not be the one whose run it
/// is: only the emergency input, which no source is above, and `ShutDown` count at once.
#[test]
fn standby_before_the_first_report_without_a_record_is_that_of_a_lower_source() {
    for ecu in BOTH {
        let standby_from = |origin, seconds: u64| {
            let mut scenario = Scenario::nothing_received(ecu, ecu.config());
            scenario.fly_us(Command::Standby, origin, seconds * SECOND);
            scenario
        };
        let mut scenario = standby_from(Origin::Rc, 2);
        assert_eq!(scenario.order(), Order::Listen, "{ecu:?}");
        scenario.values.half_percents = 160;
        scenario.reports = Some(Reports::Running);
        scenario.introduce();
        // A ZK engine that reports no throttle is looked at for 3 s.
        scenario.fly_us(Command::Standby, Origin::Rc, 3_200_000);
        assert!(matches!(scenario.order(), Order::Run(_)), "{ecu:?}: {:?}", scenario.order());
        // Also after another reset before the first report.
        let record = standby_from(Origin::Rc, 2).bench.machine.record();
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), Some(record));
        scenario.fly_us(Command::Standby, Origin::Rc, 3 * SECOND);
        assert_eq!(scenario.order(), Order::Listen, "{ecu:?}");
        scenario.command_from(Command::ShutDown, Origin::Mavlink).ok();
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}");
        // Of a source that none is above, at once; of another one after the hold and 5 s; a report at rest ends the wait.
        assert_eq!(standby_from(Origin::Emergency, 2).order(), Order::Standby, "{ecu:?}");
        assert_eq!(standby_from(Origin::Rc, 7).order(), Order::Standby, "{ecu:?}");
        let mut scenario = standby_from(Origin::Rc, 2);
        scenario.reports = Some(Reports::Standby);
        scenario.introduce();
        scenario.fly_us(Command::Standby, Origin::Rc, SECOND);
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}");
    }
}

/// A source that commands an rpm returns in a loop of resets that are too close together for the ECU's version. After the loop the demand
/// rises from the fail-safe: the rpm was not sent since. Nor in it, where the ECU reports a running engine, and a governor is configured, which
/// is not for an ECU that holds a speed itself.
#[test]
fn an_rpm_that_no_reset_let_pass_does_not_jump_after_them() {
    for (governed, reports) in [(false, None), (true, None), (true, Some(Reports::Running))] {
        let config = Ecu::Zk.with(|rules| {
            rules.takeover.within = Duration::from_ticks(0);
            rules.governor = governed.then_some(Governor::DEFAULT);
        });
        let mut scenario = Scenario::started_with(Ecu::Zk, config, rpm(100_000));
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(Command::Run(rpm(100_000)), Origin::Rc, 5 * SECOND);
        assert_eq!(scenario.order(), Order::Run(rpm(100_000)));
        // Silent until the fail-safe.
        scenario.pass_us(5 * SECOND);
        for reset in 0..20 {
            let record = scenario.bench.machine.record();
            scenario = Scenario::after_reset(Ecu::Zk, config, Some(record));
            scenario.reports = reports;
            scenario.fly_us(Command::Run(rpm(100_000)), Origin::Rc, 480_000);
            let high = |order| matches!(order, Order::Run(Demand::Rpm(rpm)) | Order::Doubt(Demand::Rpm(rpm)) if rpm.get() > 40_000);
            assert!(!high(scenario.order()), "{governed}, reset {reset}: {}", scenario.order());
        }
        scenario.reports = Some(Reports::Running);
        scenario.introduce();
        let mut first = None;
        for _ in 0..40 {
            scenario.fly_us(Command::Run(rpm(100_000)), Origin::Rc, COMMAND_PERIOD_US);
            if let (Order::Run(Demand::Rpm(rpm)), None) = (scenario.order(), first) {
                first = Some(rpm.get());
            }
        }
        assert!(first.is_some_and(|rpm| rpm < 40_000), "{governed}: {first:?}");
        assert_eq!(scenario.order(), Order::Run(rpm(100_000)));
    }
}

/// The stages of loss continue from where they were when the order was given up: stray commands of the source that was lost by then bring no demand back.
/// The control: it commands all along.
#[test]
fn amt_stray_commands_of_a_lost_source_do_not_restart_the_stages_of_loss() {
    for (commands, tenths) in [(false, 0), (true, 900)] {
        let mut scenario = Scenario::started(Ecu::Amt, percent(90));
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(run(90), Origin::Rc, 2 * SECOND).silent();
        if commands {
            scenario.fly_us(run(90), Origin::Rc, 9 * SECOND);
        } else {
            scenario.pass_us(9 * SECOND);
        }
        assert_eq!(scenario.order(), Order::Listen);
        let _ = scenario.command(run(90));
        scenario.values.half_percents = 180;
        scenario.reports(Reports::Running);
        assert_eq!(scenario.tenths(), tenths, "{commands}");
    }
}

/// After an order was given up the stages of loss continue, and standby is sent when they have run out: a lower source that was silent by
/// then does not restart them, and the silence before a reset counts once. A source that was received since restarts them.
#[test]
fn the_stages_of_loss_run_out_at_their_time_after_an_order_was_given_up() {
    // In ms after RC's last command: a reset, the last command of a lower source, and standby. After a reset the longest timeout counts.
    for (reset, lower, due) in [
        (None, None, 11_500),
        (None, Some(2900), 11_500),
        (None, Some(4300), 4300 + 12_000),
        (Some(2000), None, 12_000),
    ] {
        let mut scenario = Scenario::started_with(Ecu::Amt, Ecu::Amt.config(), percent(80));
        scenario.silent();
        let (mut after, mut given_up) = (0, false);
        while scenario.order() != Order::Standby && after < 30_000 {
            if reset == Some(after) {
                scenario = scenario.reset(Ecu::Amt.config());
            }
            if lower.is_some_and(|last| after <= last) {
                let _ = scenario.command_from(Command::Standby, Origin::Mavlink);
            }
            scenario.pass_us(COMMAND_PERIOD_US);
            after += COMMAND_PERIOD_US / 1000;
            given_up |= scenario.order() == Order::Listen;
        }
        assert!(given_up && after.abs_diff(due) <= 100, "{reset:?} {lower:?}: {after} ms");
    }
}
