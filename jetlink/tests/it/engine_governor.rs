//! Speed control over the throttle: when it is refused, and its limits. `tests/wire_governor.rs` tests how it
//! holds a speed.

use embassy_time::Duration;
use jetlink::command::{Accepted, Command, Demand, Interlock, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::EcuConfig;
use jetlink::engine::config::Governor;
use jetlink::engine::retained::RetainedState;
use jetlink::event::{Event, LossStage};
use jetlink::limit::{Action, Limit};
use jetlink::line::{Line, LineError};
use jetlink::link::LinkRecord;
use jetlink::units::{Celsius, Rpm, Throttle};

use bench::by_hand::at_us;

use crate::support::frames::{amt as amt_frames, zk as zk_frames};
use crate::support::scenario::{
    Ecu, FRAME_PERIOD_US, Reports, SECOND, Scenario, Values, Wire, percent, rpm, run,
};

fn governed(change: impl FnOnce(&mut Governor)) -> EngineConfig {
    let mut governor = Governor::DEFAULT;
    change(&mut governor);
    Ecu::Amt.with(|s| s.governor = Some(governor))
}

/// An engine at a throttle, whose shaft is reported at `rpm`, whose exhaust burns, and that the ECU reports as obeyed.
fn at(config: EngineConfig, throttle_percent: u8, rpm: u32) -> Scenario {
    let mut scenario = Scenario::started_with(Ecu::Amt, config, percent(throttle_percent));
    scenario.values.rpm = Some(rpm);
    scenario.values.half_percents = throttle_percent * 2;
    scenario.values.egt_celsius = 500;
    scenario.fly_us(run(throttle_percent), Origin::Rc, SECOND);
    scenario.bench.events();
    scenario
}

/// The throttle that goes out where anything does, in tenths of a percent: also while the life of the engine is in doubt.
fn throttle_tenths(scenario: &Scenario) -> u16 {
    match scenario.order() {
        Order::Run(Demand::Throttle(throttle)) | Order::Doubt(Demand::Throttle(throttle)) => {
            throttle.tenths()
        }
        other => panic!("a throttle, not {other:?}"),
    }
}

/// Throttles of frames that all carry run, in tenths of a percent.
fn throttles(sent: &[Wire]) -> Vec<u16> {
    let tenths = |wire: &Wire| match *wire {
        Wire::Run(tenths) => tenths,
        other => panic!("a throttle, not {other:?}"),
    };
    sent.iter().map(tenths).collect()
}

/// Exhaust as an AMT ECU with a fault reports it.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Exhaust {
    Burns,
    /// The sensor is broken.
    Broken,
}

impl Exhaust {
    /// AMT-8: the error bits.
    fn fault(self) -> u8 {
        match self {
            Self::Burns => 0x01,
            Self::Broken => 1 << 3,
        }
    }
}

fn target(target: u32) -> Command {
    Command::Run(rpm(target))
}

/// Off by default; refused if the byte has no rpm scale, or is old. The control: it is accepted.
#[test]
fn an_rpm_is_refused_while_no_speed_is_known() {
    let mut scenario = at(Ecu::Amt.config(), 30, 50_000);
    assert_eq!(scenario.command(target(50_000)), Err(Rejected::NoSpeedControl), "off by default");
    assert_eq!(scenario.wire(), Wire::Run(300));

    let mut unknown = EngineConfig::amt("a", 0, Line::new(9600), None);
    unknown.supervision.governor = Some(Governor::DEFAULT);
    let mut scenario = at(unknown, 30, 50_000);
    assert_eq!(scenario.command(target(50_000)), Err(Rejected::RpmNotKnown), "no scale");
    assert_eq!(scenario.wire(), Wire::Run(300));

    let mut scenario = at(governed(|_| {}), 30, 50_000);
    scenario.values.fault = 1; // an error set gives no rpm
    scenario.fly_us(run(30), Origin::Rc, 2 * SECOND);
    assert_eq!(scenario.command(target(50_000)), Err(Rejected::RpmNotKnown), "old");
    scenario.values.fault = 0;
    scenario.fly_us(run(30), Origin::Rc, 3 * FRAME_PERIOD_US);
    scenario.fly_us(target(50_000), Origin::Rc, 3 * SECOND);
    assert_eq!(scenario.telemetry().commanded, Some(rpm(50_000)));
    assert!(matches!(scenario.order(), Order::Run(Demand::Throttle(_))), "the ECU gets a throttle");
}

/// It takes over at the throttle in force, and falls back to a throttle without a jump to idle.
#[test]
fn the_governor_takes_over_without_a_bump() {
    let mut scenario = at(governed(|_| {}), 60, 80_000);
    scenario.sent();
    scenario.fly_us(target(80_000), Origin::Rc, SECOND);
    let sent = scenario.sent();
    assert!(sent.iter().all(|wire| matches!(wire, Wire::Run(590..=610))), "{sent:?}");
    scenario.fly_us(run(60), Origin::Rc, SECOND);
    assert!(scenario.sent().iter().all(|wire| matches!(wire, Wire::Run(590..=610))));
}

/// The throttle in force is the one that was sent last, not the one that the ECU has last reported: a ZK ECU reports it once in 0.9
/// s.
#[test]
fn the_governor_takes_over_from_the_throttle_that_was_sent() {
    let mut scenario = at(governed(|_| {}), 60, 80_000);
    scenario.fly_us(run(20), Origin::Rc, SECOND);
    scenario.sent();
    scenario.fly_us(target(80_000), Origin::Rc, SECOND);
    let sent = scenario.sent();
    assert!(sent.iter().all(|wire| matches!(wire, Wire::Run(200..=210))), "{sent:?}");
}

/// After a line error has cost it some speeds, it does not catch up in one step. The control: it rises.
#[test]
fn the_governor_rises_at_its_rate_from_frame_to_frame_where_speeds_are_missing() {
    let mut scenario = at(governed(|g| g.slew = 300), 30, 60_000);
    scenario.fly_us(target(60_000), Origin::Rc, SECOND);
    let frame = scenario.ecu.frame(Reports::Running, scenario.values);
    scenario.silent().sent();
    let mut sent = Vec::new();
    for n in 0..50 {
        let _ = scenario.command(target(70_000));
        scenario.pass_us(FRAME_PERIOD_US);
        if n % 8 != 0 {
            scenario.bench.machine.line_error(LineError::Framing);
        }
        scenario.bench.receive(&frame);
        sent.extend(scenario.sent());
    }
    let tenths = throttles(&sent);
    // 30 % a second, in the steps of 0.5 % that AMT has.
    let most = tenths.windows(2).map(|pair| pair[1].saturating_sub(pair[0])).max();
    assert!(most.is_some_and(|most| (10..=20).contains(&most)), "{tenths:?}");
    assert!(tenths.last() > Some(&500), "{tenths:?}");
}

/// Its output rises no faster than its slew and no higher than its authority, and returns from there at once.
#[test]
fn the_governor_is_limited_in_slew_and_authority() {
    let authority = Throttle::from_percent(70).unwrap();
    let mut scenario = at(governed(|g| (g.slew, g.authority) = (100, authority)), 30, 40_000);
    let mut before = 300;
    for i in 0..100 {
        scenario.fly_us(target(100_000), Origin::Rc, 100_000);
        let now = scenario.tenths();
        assert!(now <= before + 11, "10 % a second: {now} after {before}");
        assert!(now <= 700, "authority: {now}");
        assert!(i < 50 || now == 700);
        before = now;
    }
    // 1 minute at its limit: the integral did not wind up.
    scenario.fly_us(target(100_000), Origin::Rc, 60 * SECOND);
    scenario.values.rpm = Some(104_000);
    scenario.fly_us(target(100_000), Origin::Rc, 300_000);
    assert!(scenario.tenths() < 690, "{}", scenario.tenths());
}

/// Its settings take effect at once, also while it controls.
#[test]
fn settings_of_the_governor_take_effect_at_once() {
    let config = governed(|_| {});
    let mut scenario = at(config, 30, 40_000);
    scenario.fly_us(target(100_000), Origin::Rc, 5 * SECOND);
    assert_eq!(scenario.tenths(), 1000, "the shaft is too slow all the time");
    let mut settings = config.supervision;
    settings.governor = settings
        .governor
        .map(|governor| Governor { authority: Throttle::from_percent(60).unwrap(), ..governor });
    let now = at_us(scenario.now_us());
    scenario.bench.act(|engine, _| engine.configure(now, &settings)).unwrap();
    scenario.fly_us(target(100_000), Origin::Rc, SECOND);
    assert_eq!(scenario.tenths(), 600);
}

/// A rise of less than 0.1 % per reported speed also counts.
#[test]
fn a_governor_rises_slowly_where_its_slew_is_slow() {
    let mut scenario = at(governed(|g| g.slew = 10), 30, 40_000);
    scenario.fly_us(target(100_000), Origin::Rc, 10 * SECOND);
    assert!((390..=401).contains(&scenario.tenths()), "1 % a second for 10 s: {}", scenario.tenths());
}

/// Speeds missing for 0.4 s do not cause a large step: the slew limits the rise from one frame to the next.
#[test]
fn the_governors_throttle_does_not_jump_after_missing_speeds() {
    let mut scenario = at(governed(|_| {}), 30, 50_000);
    scenario.fly_us(target(50_000), Origin::Rc, 2 * SECOND);
    scenario.sent();
    // Sets without a speed, and a higher demand meanwhile.
    scenario.silent();
    for _ in 0..8 {
        scenario.command(target(80_000)).expect("the speed is not too old");
        scenario.pass_us(FRAME_PERIOD_US);
        scenario.bench.receive(&amt_frames::alternate(3));
    }
    scenario.reports = Some(Reports::Running);
    scenario.fly_us(target(80_000), Origin::Rc, SECOND);
    let sent = throttles(&scenario.sent());
    // 30 % a second, and sets 50 ms apart; AMT has steps of 0.5 %.
    assert!(sent.windows(2).all(|pair| pair[1] <= pair[0] + 20), "{sent:?}");
    assert!(sent[0] <= 310 && sent.last() >= Some(&500), "it rises: {sent:?}");
}

/// Old telemetry is not used: the throttle goes to idle, to the tick, and does not return unless speeds are reported. While
/// faults replace the state, the life of the engine is in doubt even if its exhaust is hot; it is still answered.
#[test]
fn the_governor_never_holds_a_throttle_on_old_telemetry() {
    for exhaust in [Exhaust::Burns, Exhaust::Broken] {
        let mut scenario = at(governed(|_| {}), 60, 80_000);
        scenario.fly_us(target(85_000), Origin::Rc, 2 * SECOND);
        assert!(throttle_tenths(&scenario) > 500);
        // Error sets: received, without an rpm.
        let last = scenario.telemetry().report.rpm.expect("reported").at.as_micros();
        let error = Ecu::Amt.frame(Reports::Running, Values { fault: exhaust.fault(), ..scenario.values });
        scenario.silent();
        let mut now = last;
        while now + FRAME_PERIOD_US < last + 600_000 {
            now += FRAME_PERIOD_US;
            scenario.bench.rx_at_us(now, &error);
            let _ = scenario.command(target(85_000));
            assert!(throttle_tenths(&scenario) > 500, "{exhaust:?} {} µs", now - last);
        }
        scenario.run_to_us(last + 599_999);
        assert!(throttle_tenths(&scenario) > 500);
        scenario.run_to_us(last + 600_000);
        assert_eq!(throttle_tenths(&scenario), 0, "{exhaust:?}");
        scenario.sent();
        for _ in 0..40 {
            now = scenario.now_us() + FRAME_PERIOD_US;
            scenario.bench.rx_at_us(now, &error);
            let _ = scenario.command(target(85_000));
            assert_eq!(throttle_tenths(&scenario), 0);
        }
        assert_eq!(scenario.sent(), [Wire::Run(0); 40], "{exhaust:?}");
        // It reports its speed again: up from idle, by the slew.
        scenario.values.rpm = Some(40_000);
        scenario.values.half_percents = 0;
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(target(85_000), Origin::Rc, 500_000);
        assert!(scenario.tenths() <= 160, "30 % a second: {}", scenario.tenths());
    }
}

/// An AMT ECU reports its speed in steps of 500 rpm, so that a shaft that falls by 7700 rpm/s seems to fall by 4000 rpm/s from one set to
/// another now and then. It gets no more fuel there. The control: one that falls by 3500 rpm/s does.
#[test]
fn a_falling_shaft_gets_no_more_fuel_where_its_speed_has_steps() {
    let rises = |falls: u32| {
        let mut scenario = at(governed(|_| {}), 30, 50_000);
        scenario.fly_us(target(50_000), Origin::Rc, SECOND);
        scenario.silent().sent();
        let period = 125_000;
        for set in 1..=20 {
            scenario.values.rpm = Some(50_000 - falls * set / 8);
            let frame = scenario.ecu.frame(Reports::Running, scenario.values);
            let _ = scenario.command(target(50_000));
            let at = scenario.now_us() + period;
            scenario.bench.rx_at_us(at, &frame);
        }
        // The first set shows that the shaft falls.
        let sent = throttles(&scenario.sent());
        sent[1..].windows(2).any(|pair| pair[1] > pair[0])
    };
    assert_eq!([7700, 3500].map(rises), [false, true]);
}

/// On a cut line nothing is sent. When it is mended, the governor continues from the throttle that the ECU reports.
#[test]
fn the_governor_resumes_where_it_was_when_a_cut_line_is_reconnected() {
    let mut scenario = at(governed(|_| {}), 60, 80_000);
    scenario.fly_us(target(80_000), Origin::Rc, 2 * SECOND);
    scenario.silent().fly_us(target(80_000), Origin::Rc, FRAME_PERIOD_US);
    scenario.sent();
    scenario.fly_us(target(80_000), Origin::Rc, 2 * SECOND);
    assert_eq!(scenario.sent(), []);
    scenario.reports = Some(Reports::Running);
    scenario.fly_us(target(80_000), Origin::Rc, SECOND);
    let sent = scenario.sent();
    assert!(sent.len() >= 19 && sent.iter().all(|wire| matches!(wire, Wire::Run(590..=610))), "{sent:?}");
}

/// A lost source: the throttle set by the governor is held, then lowered, never raised.
#[test]
fn a_lost_source_lowers_the_governors_throttle() {
    let mut scenario = at(governed(|_| {}), 60, 80_000);
    scenario.fly_us(target(80_000), Origin::Rc, 2 * SECOND);
    let held = scenario.tenths();
    scenario.pass_us(500_000 - 100_000 + SECOND);
    assert_eq!(scenario.telemetry().loss, LossStage::FailSafe);
    // The shaft slows down, and nothing accelerates it.
    scenario.values.rpm = Some(60_000);
    let mut before = scenario.tenths();
    assert!(before <= held + 5);
    for _ in 0..40 {
        scenario.pass_us(FRAME_PERIOD_US);
        assert!(scenario.tenths() <= before);
        before = scenario.tenths();
    }
    assert_eq!((before, scenario.wire()), (0, Wire::Run(0)));
    // The ECU is received again, far from there: held off, then by the governor from there on.
    scenario.fly_us(target(80_000), Origin::Rc, SECOND);
    assert_eq!(scenario.tenths(), 0);
    assert_eq!(scenario.command(target(80_000)), Ok(Accepted::Held));
}

/// A source that wanted nothing commands its speed again while the throttle falls: the governor continues from the throttle that is being sent,
/// not from the one before it (848000116).
#[test]
fn the_governor_continues_from_the_throttle_that_is_being_sent() {
    let mut config = governed(|_| {});
    config.supervision.loss.ramp = 2000;
    let mut scenario = at(config, 60, 80_000);
    scenario.fly_us(target(80_000), Origin::Rc, 2 * SECOND);
    let mut sent = throttles(&scenario.sent());
    // Until a throttle of less than half of the highest one begins.
    while sent.last().is_none_or(|last| *last >= 300) {
        scenario.command(Command::Present).unwrap();
        scenario.pass_us(1000);
        sent.extend(throttles(&scenario.sent()));
        assert!(sent.len() < 200, "{sent:?}");
    }
    assert!(matches!(sent[..], [.., before, last] if before >= last + 90), "it falls: {sent:?}");
    scenario.command(target(80_000)).unwrap();
    scenario.pass_us(FRAME_PERIOD_US);
    let (last, next) = (sent[sent.len() - 1], throttles(&scenario.sent()));
    // 30 % a second.
    assert!(next[0] <= last + 20, "{last}, then {next:?}");
    // It rises again.
    scenario.fly_us(target(100_000), Origin::Rc, SECOND);
    assert!(throttles(&scenario.sent()).last().is_some_and(|after| *after > last + 100));
}

/// After a reset it continues at the throttle that the ECU obeys.
#[test]
fn the_governor_resumes_after_a_reset() {
    let retained = RetainedState::new(Order::Run(rpm(80_000)), Origin::Rc).with(|state| state.armed = true);
    let mut scenario = Scenario::after_reset(Ecu::Amt, governed(|_| {}), Some(retained));
    scenario.values.rpm = Some(80_000);
    scenario.values.half_percents = 120;
    scenario.reports = Some(Reports::Running);
    scenario.fly_us(target(80_000), Origin::Rc, 2 * SECOND);
    let sent = scenario.sent();
    assert!(!sent.is_empty() && sent.iter().all(|wire| matches!(wire, Wire::Run(590..=610))), "{sent:?}");
}

/// Without an engine in its settings a node knows no scale of the shaft speed before the first alternate set, every eleventh one. Until then
/// it holds the throttle that the ECU reports, and never for long.
#[test]
fn the_governor_holds_the_reported_throttle_until_a_speed_can_be_known() {
    let mut config = governed(|_| {});
    if let EcuConfig::Amt(amt) = &mut config.ecu {
        amt.engine = None;
    }
    let retained = RetainedState::new(Order::Run(rpm(80_000)), Origin::Rc).with(|state| state.armed = true);
    let resumed = |identified: bool, half_percents: u8| {
        let mut scenario = Scenario::after_reset(Ecu::Amt, config, Some(retained));
        scenario.values.rpm = Some(80_000);
        scenario.values.half_percents = 120;
        // One damaged set in the beginning raises no demand.
        scenario.odd(Reports::Running, Values { half_percents, ..scenario.values });
        scenario.pass_us(FRAME_PERIOD_US);
        scenario.reports = Some(Reports::Running);
        scenario.sent();
        scenario.fly_us(target(80_000), Origin::Rc, 1_400_000);
        if identified {
            scenario.bench.receive(&amt_frames::alternate(0x06));
        }
        let first = throttles(&scenario.sent());
        scenario.fly_us(target(80_000), Origin::Rc, 2 * SECOND);
        (first, throttles(&scenario.sent()))
    };
    let near = |throttles: &[u16]| throttles.iter().all(|tenths| (590..=610).contains(tenths));
    for half_percents in [120, 200] {
        let (before, after) = resumed(true, half_percents);
        assert!(!before.is_empty() && near(&before), "{before:?}");
        assert!(near(&after), "{after:?}");
    }
    let (before, after) = resumed(false, 120);
    assert!(near(&before), "{before:?}");
    assert_eq!(after.last(), Some(&0), "{after:?}");
}

/// A governed ZK engine of RC's that runs at 80 000 rpm, right after a reset. `by_id6`: its switch may have been given by ID 6.
fn governed_zk_after_reset(by_id6: bool) -> Scenario {
    governed_zk_after_reset_of(rpm(80_000), by_id6.then_some(0))
}

/// The same with this demand. `rpm_x`: its switch was given by ID 6, with this RPM_X.
fn governed_zk_after_reset_of(demand: Demand, rpm_x: Option<u8>) -> Scenario {
    let mut governor = Governor::DEFAULT;
    governor.max_rpm = Rpm::new(160_000);
    let config = Ecu::Zk.with(|s| s.governor = Some(governor));
    let retained = RetainedState::new(Order::Run(demand), Origin::Rc);
    let link = LinkRecord::new(rpm_x.map_or(0, |rpm_x| rpm_x << 1 | 1));
    let retained = retained.with(|state| (state.armed, state.link) = (true, link));
    let mut scenario = Scenario::after_reset(Ecu::Zk, config, Some(retained));
    scenario.values.rpm = Some(80_000);
    scenario
}

/// Its throttle, twice: ID 3, 60 %.
fn report_60_percent(scenario: &mut Scenario) {
    for _ in 0..2 {
        scenario.bench.receive(&zk_frames::status(3, 80_000, [60, 0, 0]));
    }
}

/// A ZK ECU reports its throttle once in a round of reports. Until then the governor's is not known, and ID 0 is sent, but not for ever.
#[test]
fn the_governor_waits_for_the_reported_throttle() {
    // The switch may have been given by ID 6 while the version was not known: that does not show an ECU that holds a speed itself.
    for (reported, by_id6) in [(true, false), (true, true), (false, false)] {
        let mut scenario = governed_zk_after_reset(by_id6);
        scenario.introduce_version(3);
        scenario.reports = Some(Reports::Running);
        scenario.fly_us(target(80_000), Origin::Rc, 450_000);
        let first = scenario.sent();
        assert!(scenario.telemetry().in_doubt.is_none());
        assert_eq!(first, [], "{reported} {by_id6}");
        if reported {
            report_60_percent(&mut scenario);
        }
        scenario.fly_us(target(80_000), Origin::Rc, 300_000);
        let then = throttles(&scenario.sent());
        if reported {
            assert!(!then.is_empty() && then.iter().all(|tenths| (590..=610).contains(tenths)), "{then:?}");
        } else {
            assert_eq!(then, []);
            scenario.fly_us(target(80_000), Origin::Rc, 2 * SECOND);
            let then = throttles(&scenario.sent());
            assert!(then.first() == Some(&0), "{then:?}");
        }
    }
}

/// What the ECU of another version would have been sent meanwhile, idle, is not where the governor continues: the ECU's throttle may be known
/// before its version is (849001094).
#[test]
fn the_governor_resumes_at_the_reported_throttle_although_the_version_follows_later() {
    // RPM_X was given, so that the ECU may hold the speed itself until its version is known.
    let mut scenario = governed_zk_after_reset_of(rpm(80_000), Some(4));
    scenario.reports = Some(Reports::Running);
    report_60_percent(&mut scenario);
    scenario.fly_us(target(80_000), Origin::Rc, 150_000);
    assert!(scenario.telemetry().in_doubt.is_none());
    assert!(!scenario.sent().iter().any(|wire| matches!(wire, Wire::Run(_))));
    scenario.introduce_version(3);
    scenario.fly_us(target(80_000), Origin::Rc, SECOND);
    let sent = throttles(&scenario.sent());
    assert!(!sent.is_empty() && sent.iter().all(|tenths| (590..=610).contains(tenths)), "{sent:?}");
}

/// Its source is lost, too, while nothing is received of the ECU: the throttle to which the demand falls is never sent, and the governor continues
/// from the one that the ECU reports.
#[test]
fn a_throttle_that_a_doubt_withholds_is_not_where_the_governor_continues() {
    for source_is_lost in [false, true] {
        let mut scenario = governed_zk_after_reset(true);
        scenario.introduce_version(3);
        scenario.reports = Some(Reports::Running);
        report_60_percent(&mut scenario);
        scenario.fly_us(target(80_000), Origin::Rc, 2 * SECOND);
        scenario.silent();
        scenario.fly_us(target(80_000), Origin::Rc, 300_000);
        if source_is_lost {
            scenario.pass_us(4 * SECOND);
            assert_eq!(scenario.telemetry().loss, LossStage::FailSafe);
        }
        scenario.fly_us(target(80_000), Origin::Rc, 6 * SECOND);
        assert!(scenario.telemetry().in_doubt.is_some() && scenario.telemetry().loss == LossStage::None);
        scenario.sent();
        scenario.reports = Some(Reports::Running);
        let mut sent = Vec::new();
        for _ in 0..10 {
            scenario.bench.receive(&zk_frames::status(3, 80_000, [60, 0, 0]));
            scenario.fly_us(target(80_000), Origin::Rc, 100_000);
            sent.extend(throttles(&scenario.sent()));
        }
        assert!(sent.len() > 5 && sent.iter().all(|tenths| (590..=610).contains(tenths)), "{sent:?}");
    }
}

/// A lost line, or an ECU that reports only faults, is not a lost source: nothing or idle is sent, and nothing shuts the
/// engine down.
#[test]
fn a_lost_line_is_not_a_lost_source() {
    for fault in [false, true] {
        let mut config = governed(|_| {});
        config.supervision.loss.standby_after = Some(Duration::from_secs(2));
        let mut scenario = at(config, 60, 80_000);
        scenario.fly_us(target(80_000), Origin::Rc, 2 * SECOND);
        if fault {
            scenario.values.fault = 1;
        } else {
            scenario.silent();
        }
        // Below the serial delay time of the ECU, 4 s.
        scenario.fly_us(target(80_000), Origin::Rc, 3_500_000);
        scenario.sent();
        scenario.fly_us(target(80_000), Origin::Rc, 400_000);
        let telemetry = scenario.telemetry();
        assert_eq!(telemetry.loss, LossStage::None, "{fault}");
        assert!(matches!(telemetry.ordered.order, Order::Doubt(_)), "{fault}");
        let sent = if fault { vec![Wire::Run(0); 8] } else { vec![] };
        assert_eq!(scenario.sent(), sent, "{fault}: old speeds hold nothing up");
        assert_eq!(telemetry.counters.commands_rejected, 0);
        // The control: the source is lost.
        scenario.pass_us(10 * SECOND);
        assert_eq!(scenario.order(), Order::Standby, "{fault}");
    }
}

/// The governor has its own setting for the largest age of a speed.
#[test]
fn a_speed_expires_after_its_own_setting() {
    for (link_stable, age, answer) in [
        (Duration::from_ticks(0), 10_000, Ok(Accepted::InForce)),
        (Duration::from_millis(1500), 601_000, Err(Rejected::RpmNotKnown)),
    ] {
        let mut config = governed(|_| {});
        config.supervision.start.link_stable = link_stable;
        let mut scenario = at(config, 60, 80_000);
        scenario.silent().pass_us(age);
        assert_eq!(scenario.command(target(80_000)), answer, "{age}");
    }
}

/// At the fail-safe of a limit it goes to idle: any other throttle might be above the commanded speed.
#[test]
fn a_limit_brings_a_governed_engine_to_idle() {
    let mut config = governed(|_| {});
    config.supervision.loss.throttle = Throttle::from_percent(50).unwrap();
    config.supervision.limits.over_temperature =
        Limit { at: Some(Celsius::from_tenths(7000)), action: Action::FailSafe };
    let mut scenario = at(config, 60, 80_000);
    scenario.fly_us(target(80_000), Origin::Rc, 2 * SECOND);
    scenario.values.egt_celsius = 720;
    scenario.fly_us(target(30_000), Origin::Rc, 5 * SECOND);
    assert_eq!(scenario.tenths(), 0);
    // The control: a throttle goes to the configured one.
    let mut scenario = at(config, 60, 80_000);
    scenario.values.egt_celsius = 720;
    scenario.fly_us(run(60), Origin::Rc, 5 * SECOND);
    assert_eq!(scenario.tenths(), 500);
}

/// Retained state of an rpm under the governor: the rpm while its source is in control, otherwise the throttle of the stage of
/// loss, so that a reset does not restore a speed that is no longer commanded.
#[test]
fn a_governed_rpm_is_retained_until_its_source_is_lost() {
    let mut scenario = at(governed(|_| {}), 50, 80_000);
    scenario.fly_us(target(80_000), Origin::Rc, 2 * SECOND);
    assert!(matches!(scenario.order(), Order::Run(Demand::Throttle(_))), "{:?}", scenario.order());
    assert_eq!(scenario.bench.machine.record().order, Order::Run(rpm(80_000)));
    scenario.reports = Some(Reports::Running);
    scenario.pass_us(20 * SECOND);
    assert_eq!(scenario.telemetry().loss, LossStage::FailSafe);
    assert_eq!(scenario.bench.machine.record().order, Order::Run(percent(0)));
}

/// An engine found by its exhaust after a brown-out, from error sets without a speed. A source that keeps commanding an rpm is not
/// silent.
#[test]
fn an_rpm_that_is_commanded_before_any_speed_is_known_does_not_count_as_silence() {
    for commands in [true, false] {
        let mut flight = at(governed(|_| {}), 60, 80_000);
        flight.fly_us(target(80_000), Origin::Rc, 2 * SECOND);
        let record = flight.bench.machine.record().without_start();
        let mut scenario = Scenario::after_reset(Ecu::Amt, governed(|_| {}), Some(record));
        scenario.reports = Some(Reports::Running);
        (scenario.values.fault, scenario.values.egt_celsius) = (Exhaust::Burns.fault(), 500);
        if commands {
            scenario.fly_us(target(80_000), Origin::Rc, 30 * SECOND);
        } else {
            scenario.pass_us(30 * SECOND);
        }
        let sent = scenario.sent();
        assert_eq!(sent.contains(&Wire::Standby), !commands, "{commands}: {:?}", sent.last());
        // When the fault clears, the governor has the speed.
        if commands {
            (scenario.values.fault, scenario.values.rpm) = (0, Some(80_000));
            scenario.values.half_percents = 120;
            scenario.fly_us(target(80_000), Origin::Rc, 2 * SECOND);
            let sent = scenario.sent();
            assert!(!sent.is_empty() && sent.iter().all(|wire| matches!(wire, Wire::Run(_))), "{sent:?}");
            assert_eq!(scenario.telemetry().commanded, Some(rpm(80_000)));
        }
    }
}

/// A clamped demand is still the pilot's demand: a stick that is up starts no engine, however low its highest speed is set. The
/// control: a demand at idle does.
#[test]
fn a_start_needs_the_commanded_rpm_at_idle_not_the_clamped_one() {
    let governor = Governor { max_rpm: Rpm::new(10_000), ..Governor::DEFAULT };
    let config = Ecu::Zk.with(|s| s.governor = Some(governor));
    for (commanded, answer) in
        [(60_000, Err(Rejected::Start(Interlock::NotIdle))), (20_000, Ok(Accepted::InForce))]
    {
        let mut scenario = Scenario::nothing_received(Ecu::Zk, config);
        for _ in 0..2 {
            // Version 3 has no speed control, and this engine idles at 30 000 rpm.
            scenario.bench.receive(&zk_frames::status(8, 0, [30, 0, 0]));
            scenario.bench.receive(&zk_frames::status(6, 0, [160, 0, 3 << 2]));
        }
        scenario.reports(Reports::Standby).pass_us(2 * SECOND);
        scenario.command(Command::Arm).unwrap();
        scenario.command(Command::Standby).unwrap();
        assert_eq!(scenario.command(Command::Run(rpm(commanded))), answer, "{commanded}");
    }
}

/// An rpm above the governor's maximum is clamped to it, and reported once. One at the maximum is neither.
#[test]
fn an_rpm_above_the_governors_maximum_is_clamped() {
    for (commanded, clamped) in [(60_001, true), (60_000, false)] {
        let mut scenario = at(governed(|governor| governor.max_rpm = Rpm::new(60_000)), 60, 60_000);
        scenario.fly_us(Command::Run(rpm(commanded)), Origin::Rc, SECOND);
        assert_eq!(scenario.telemetry().commanded, Some(rpm(60_000)), "{commanded}");
        let mut events = scenario.bench.event_kinds();
        events.retain(|event| matches!(event, Event::Clamped(_)));
        let expected = if clamped { vec![Event::Clamped(Rpm::new(60_000))] } else { vec![] };
        assert_eq!(events, expected, "{commanded}");
    }
}

/// The switch may have been given by ID 6, but only with an RPM_X does the ECU hold an rpm itself, whatever the order was: without it, one that
/// is commanded before the version is known is the governor's.
#[test]
fn zk_9_after_a_reset_an_rpm_is_the_governors_where_no_rpm_x_was_given() {
    for (retained, rpm_x) in [(percent(60), 0), (percent(60), 4), (rpm(80_000), 0), (rpm(80_000), 4)] {
        let mut scenario = governed_zk_after_reset_of(retained, Some(rpm_x));
        scenario.reports = Some(Reports::Running);
        report_60_percent(&mut scenario);
        scenario.fly_us(target(80_000), Origin::Rc, SECOND);
        assert!(scenario.telemetry().in_doubt.is_none());
        let is_throttle = matches!(scenario.order(), Order::Run(Demand::Throttle(_)));
        assert_eq!(is_throttle, rpm_x == 0, "{retained:?}, {rpm_x}: {}", scenario.order());
    }
}

/// A set that ends a doubt has a speed: it is not answered with the idle throttle of a governor without one, from which the next
/// answer would jump back.
#[test]
fn the_set_that_ends_a_doubt_is_answered_by_the_governor() {
    let mut scenario = at(governed(|_| {}), 60, 60_000);
    let command = Command::Run(rpm(60_000));
    scenario.fly_us(command, Origin::Rc, SECOND);
    let before = scenario.tenths();
    assert!(before > 500, "{before}");
    scenario.odd(Reports::Stopped, Values { rpm: Some(0), ..scenario.values });
    scenario.pass_us(FRAME_PERIOD_US);
    scenario.silent().sent();
    // Noise without a head of a set is no gap, and brings no speed for more than 0.6 s.
    for _ in 0..13 {
        let _ = scenario.command(command);
        scenario.pass_us(FRAME_PERIOD_US);
        scenario.bench.receive(&[0; 6]);
    }
    assert!(scenario.telemetry().in_doubt.is_some());
    scenario.pass_us(FRAME_PERIOD_US);
    scenario.odd(Reports::Running, scenario.values);
    assert!(scenario.telemetry().in_doubt.is_none());
    scenario.pass_us(FRAME_PERIOD_US);
    scenario.odd(Reports::Running, scenario.values);
    scenario.pass_us(FRAME_PERIOD_US);
    let sent = throttles(&scenario.sent());
    assert!(sent.iter().all(|tenths| tenths.abs_diff(before) < 50), "{sent:?}, before {before}");
    assert_eq!(sent.len(), 2);
}

/// The integral is held at a limit: however long it lasts, the throttle follows the next target at once.
#[test]
fn the_governors_throttle_leaves_a_limit_at_once() {
    let config = governed(|g| (g.proportional, g.integral) = (40, 10));
    // 5000 rpm of error are 20 % of throttle.
    for (beyond, limit, back) in [(55_000, 1000, 800), (45_000, 0, 200)] {
        let mut scenario = at(config, 50, 50_000);
        scenario.fly_us(target(beyond), Origin::Rc, 30 * SECOND);
        assert_eq!(scenario.tenths(), limit, "{beyond}");
        // It rises at 30 % a second.
        scenario.fly_us(target(50_000), Origin::Rc, SECOND);
        assert!(scenario.tenths().abs_diff(back) <= 5, "{beyond}: {}", scenario.tenths());
        scenario.fly_us(target(50_000), Origin::Rc, 10 * SECOND);
        assert!(scenario.tenths().abs_diff(back) <= 5, "{beyond}: {}", scenario.tenths());
    }
}

/// Its gains are for 1000 rpm: so much throttle at once, and so much per second.
#[test]
fn the_gains_of_the_governor_are_for_1000_rpm() {
    for (proportional, integral) in [(40, 0), (1, 10), (40, 10)] {
        let mut scenario =
            at(governed(|g| (g.proportional, g.integral) = (proportional, integral)), 30, 50_000);
        scenario.fly_us(target(50_000), Origin::Rc, SECOND);
        assert_eq!(scenario.tenths(), 300);
        for seconds in 1..=5 {
            scenario.fly_us(target(51_000), Origin::Rc, SECOND);
            let expected = 300 + proportional + seconds * integral;
            let tenths = scenario.tenths();
            assert!(tenths.abs_diff(expected) <= 2, "{proportional} {integral}: {tenths} after {seconds} s");
        }
    }
}
