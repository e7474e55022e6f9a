//! Findings 1 and 6: an ECU that lost its power and returns is sent nothing that could start its engine, whatever was
//! commanded before. A new start by a pilot is obeyed.

use crate::wire::Frame;
use crate::world::*;
use sim::amt::{AmtTemper, InFlight, Status};
use sim::ecu::{MILLIS, Nanos, SECOND};
use sim::turbine::Phase;
use sim::wire::{Faults, FramingAs};
use sim::zk::ZkTemper;

/// What the previous pilot does while the ECU is without power.
#[derive(Clone, Copy, PartialEq)]
enum Pilot {
    /// Continues to command 80 %.
    Fresh,
    /// Fell silent with the ECU.
    Silent,
}

/// Shortest outage that can be detected: three expected frames, and the reply to the next one.
const GAP: Nanos = 600 * MILLIS;

/// An engine at 80 % whose ECU loses its power for this time. It has to stay at rest for 5 minutes after that, and a new
/// start has to light it.
fn power_returns(mut world: World, off: f64, pilot: Pilot) {
    world.fly(Rc, 80);
    let lost_at = world.now();
    if pilot == Pilot::Silent {
        world.silent(Rc);
    }
    world.dip_s(off);
    world.pass_s(300.0);
    world.assert_ignitions(1);
    // An ECU that starts on run alone is started by the frames on the wire when it boots.
    world.assert_not_sent_run(lost_at + GAP);
    world.starts_again(Rc);
}

fn zk_power_returns(version: u8, off: f64, pilot: Pilot) {
    power_returns(World::one(zk(version, |_, _| {})), off, pilot);
}

/// An ECU that begins a start with the first message that commands a start.
fn amt_power_returns(off: f64, pilot: Pilot) {
    power_returns(World::one(amt(|_, ecu| ecu.temper.clearance = 0)), off, pilot);
}

#[test]
fn engine_stays_stopped_when_zk_3_ecu_power_returns_after_180_s() {
    zk_power_returns(3, 180.0, Pilot::Fresh);
}

#[test]
fn engine_stays_stopped_when_zk_4_ecu_power_returns_after_180_s() {
    zk_power_returns(4, 180.0, Pilot::Fresh);
}

#[test]
fn engine_stays_stopped_when_zk_5_ecu_power_returns_after_180_s() {
    zk_power_returns(5, 180.0, Pilot::Fresh);
}

#[test]
fn engine_stays_stopped_when_zk_5_ecu_power_returns_after_600_s() {
    zk_power_returns(5, 600.0, Pilot::Fresh);
}

#[test]
fn engine_stays_stopped_when_zk_3_ecu_power_returns_after_600_s_with_all_sources_silent() {
    zk_power_returns(3, 600.0, Pilot::Silent);
}

#[test]
fn engine_stays_stopped_when_zk_5_ecu_power_returns_after_180_s_with_all_sources_silent() {
    zk_power_returns(5, 180.0, Pilot::Silent);
}

#[test]
fn engine_stays_stopped_when_zk_5_ecu_power_returns_after_3_s() {
    zk_power_returns(5, 3.0, Pilot::Fresh);
}

#[test]
fn engine_stays_stopped_when_amt_ecu_power_returns_after_3_s() {
    amt_power_returns(3.0, Pilot::Fresh);
}

#[test]
fn engine_stays_stopped_when_amt_ecu_power_returns_after_180_s() {
    amt_power_returns(180.0, Pilot::Fresh);
}

#[test]
fn engine_stays_stopped_when_amt_ecu_power_returns_after_600_s_with_all_sources_silent() {
    amt_power_returns(600.0, Pilot::Silent);
}

/// ECUs that light a hot engine on run alone, 50 ms after their power is back.
#[test]
fn hot_engine_stays_stopped_when_a_quick_zk_ecu_has_power_again_after_3_s() {
    for version in [3, 5] {
        let engine = zk(version, |_, ecu| {
            ecu.boot = 50 * MILLIS;
            ecu.temper = ZkTemper { starts_hot: true, ..ZkTemper::DEFAULT };
        });
        power_returns(World::one(engine), 3.0, Pilot::Fresh);
    }
}

#[test]
fn hot_engine_stays_stopped_when_a_quick_amt_ecu_has_power_again_after_3_s() {
    let engine = amt(|_, ecu| {
        ecu.boot = 50 * MILLIS;
        ecu.temper = AmtTemper { starts_hot: true, clearance: 0, ..AmtTemper::DEFAULT };
    });
    power_returns(World::one(engine), 3.0, Pilot::Fresh);
}

/// An ECU whose first report after its boot is still of the engine that ran.
#[test]
fn one_report_of_the_state_before_the_outage_confirms_nothing() {
    let engine = zk(5, |_, ecu| ecu.temper = ZkTemper { last_state_first: 1, ..ZkTemper::DEFAULT });
    power_returns(World::one(engine), 3.0, Pilot::Fresh);
    let engine = amt(|_, ecu| ecu.temper.last_state_first = 1);
    power_returns(World::one(engine), 3.0, Pilot::Fresh);
}

/// In rpm mode, where an ECU that restarted has forgotten the mode.
#[test]
fn engine_in_rpm_mode_stays_stopped_when_ecu_power_returns_after_180_s() {
    let mut world = World::one(zk(5, |_, _| {}));
    world.start(Rc);
    world.streams(Rc, run_rpm(110_000));
    world.pass_s(8.0);
    assert!((world.rpm() - 110_000.0).abs() < 2000.0, "{}", world.rpm());
    let lost_at = world.now();
    world.dip_s(180.0);
    world.pass_s(300.0);
    world.assert_ignitions(1);
    world.assert_not_sent_run(lost_at + GAP);
    world.starts_again(Rc);
}

/// The supply dips for 0.3 s while the engine is cranked, six times: one start command, one ignition.
fn dips_while_cranking(mut world: World) {
    world.ready(Rc);
    world.streams(Rc, run(0));
    for _ in 0..6 {
        world.pass_s(3.0);
        world.dip_s(0.3);
    }
    world.pass_s(100.0);
    world.assert_ignitions(1);
    assert!(!world.phase().is_live());
    world.starts_again(Rc);
}

#[test]
fn supply_dips_while_cranking_give_one_ignition_on_a_zk_ecu() {
    dips_while_cranking(World::one(zk(5, |_, _| {})));
}

#[test]
fn supply_dips_while_cranking_give_one_ignition_on_an_amt_ecu() {
    dips_while_cranking(World::one(amt(|_, ecu| {
        ecu.boot = 50 * MILLIS;
        ecu.temper = AmtTemper { starts_hot: true, clearance: 0, ..AmtTemper::DEFAULT };
    })));
}

/// An outage that is shorter than the gap of three frames, with a boot within 50 ms, is not detected as such. The first
/// report after it is inconsistent with a living engine: nothing more is sent that could start one, and the run ends.
#[test]
fn engine_after_an_outage_too_short_to_see_is_brought_to_standby() {
    let mut world = World::one(zk(5, |_, ecu| {
        ecu.boot = 20 * MILLIS;
        ecu.temper = ZkTemper { starts_hot: true, ..ZkTemper::DEFAULT };
    }));
    world.fly(Rc, 60);
    world.dip_s(0.02);
    let from = world.now() + 500 * MILLIS;
    world.pass_s(60.0);
    assert!(!world.phase().is_live(), "{:?}", world.phase());
    world.assert_ignitions(1);
    world.assert_not_sent_run(from);
    world.starts_again(Rc);
}

/// The set-up set reports that the ECU comes from a power-up. Neither it nor anything after it is answered with run.
#[test]
fn freshly_powered_amt_ecu_is_not_sent_run_at_the_earlier_throttle() {
    for (off, boot) in [(0.1, 50), (0.3, 50), (0.3, 500), (0.8, 100)] {
        let mut world = World::one(amt(|_, ecu| ecu.boot = boot * MILLIS));
        world.fly(Rc, 60);
        world.dip_s(off);
        let powered = world.now();
        world.pass_s(20.0);
        assert!(world.sent(powered).count() > 100, "each of its sets was answered");
        world.assert_not_sent_run(powered);
        world.assert_ignitions(1);
        world.starts_again(Rc);
    }
}

/// A pilot who shuts the engine down while its ECU has no power may start it again afterwards.
#[test]
fn new_start_after_an_outage_lights_the_engine() {
    for engine in [zk(3, |_, _| {}), zk(5, |_, _| {}), amt(|_, _| {})] {
        let mut world = World::one(engine);
        world.fly(Rc, 60);
        world.streams(Rc, Standby);
        world.dip_s(3.0);
        world.pass_s(10.0);
        world.assert_ignitions(1);
        world.starts_again(Rc);
    }
}

/// Only the line was lost, and not the power: the engine continued and is sent run again.
#[test]
fn engine_that_ran_through_a_cut_line_continues_at_its_demand() {
    // An AMT ECU gives its engine up after 2 s.
    for (engine, cut) in [(zk(5, |_, _| {}), 5.0), (amt(|_, _| {}), 0.8)] {
        let mut world = World::one(engine);
        world.fly(Rc, 60);
        let from = world.now();
        world.plugs[0].cut(true);
        world.pass_s(cut);
        world.plugs[0].cut(false);
        world.pass_s(20.0);
        world.assert_not_shut_down(from);
        world.assert_ignitions(1);
        assert_eq!(world.throttle_sent(0), Some(600));
        assert_eq!(world.phase(), Phase::Running);
    }
}

/// Every set or status is damaged, and the UART detects it: the line is faulty, but not the engine.
#[test]
fn engine_continues_at_its_demand_through_2_s_of_framing_noise() {
    for engine in [zk(3, |_, _| {}), zk(5, |_, _| {}), amt(|_, _| {})] {
        let mut world = World::one(engine);
        world.fly(Rc, 60);
        let from = world.now();
        world.plugs[0].framing(FramingAs::Error);
        let noise = Faults { framing_per_million: 250_000, ..Faults::default() };
        world.plugs[0].set_faults(noise, Faults::default());
        world.pass_s(2.0);
        world.plugs[0].set_faults(Faults::default(), Faults::default());
        world.pass_s(20.0);
        world.assert_not_shut_down(from);
        world.assert_ignitions(1);
        assert_eq!(world.throttle_sent(0), Some(600));
    }
}

/// An ECU that reports idle calibration, or that it has started up, in flight.
#[test]
fn amt_engine_that_reports_idle_calibration_in_flight_continues_at_its_demand() {
    for shows in [Status::IdleCalibration, Status::StartedUp, Status::Unnamed(0b11111)] {
        let in_flight = Some(InFlight { shows, every: 5 * SECOND, lasts: 2 * SECOND });
        let mut world = World::one(amt(|_, ecu| ecu.temper = AmtTemper { in_flight, ..AmtTemper::DEFAULT }));
        world.fly(Rc, 60);
        world.pass_s(5.0);
        let from = world.now();
        world.pass_s(30.0);
        world.assert_not_shut_down(from);
        let lowest = world.sent(from).filter_map(Frame::throttle).min();
        assert_eq!(lowest, Some(600), "{shows:?}");
    }
}

/// The supply dips for less than a gap each time the engine is lit: one start, one ignition, as soon as the ECU has reported the start
/// once. The control: before that report nothing shows such a dip, and the start's time is the limit.
#[test]
fn a_supply_that_dips_at_each_ignition_gives_one_ignition() {
    for (dip, after, is_seen) in
        [(0.08, 0.3, true), (0.08, 2.0, true), (0.3, 0.02, true), (0.08, 0.02, false)]
    {
        let mut world = World::one(zk(5, |_, ecu| {
            ecu.boot = 20 * MILLIS;
            ecu.temper = ZkTemper { starts_hot: true, ..ZkTemper::DEFAULT };
        }));
        world.ready(Rc);
        world.streams(Rc, run(0));
        let from = world.now();
        // For longer than a start may take.
        while world.now() < from + 130 * SECOND {
            let before = world.ignitions();
            let lit = (0..500).any(|_| {
                world.pass_s(0.01);
                world.ignitions() > before
            });
            if !lit {
                break;
            }
            world.pass_s(after);
            world.dip_s(dip);
        }
        world.pass_s(10.0);
        let ignitions = world.ignitions();
        assert_eq!(ignitions == 1, is_seen, "{dip} s, {after} s after each of {ignitions} ignitions");
        world.assert_not_sent_run(from + 125 * SECOND);
    }
}

/// A start in damaged frames, in which the supply dips, so that the ECU cools its engine: cooling ends the start, also if nothing of it
/// was received. Without the noise its reports do.
#[test]
fn a_start_that_ends_in_damaged_frames_gives_one_ignition() {
    for noise in [false, true] {
        let mut world = World::one(zk(5, |_, ecu| {
            ecu.boot = 20 * MILLIS;
            ecu.turbine = ecu.turbine.starting_in(1.6);
        }));
        world.ready(Rc);
        world.streams(Rc, run(0));
        world.pass_s(0.12);
        if noise {
            let damaged = Faults { framing_per_million: 1_000_000, ..Faults::default() };
            world.plugs[0].set_faults(damaged, Faults::default());
        }
        let burns = (0..400).any(|_| {
            world.pass_s(0.01);
            world.ignitions() == 1 && world.egt() >= 115.0
        });
        assert!(burns, "{} ignitions, {} °C", world.ignitions(), world.egt());
        world.dip_s(0.08);
        world.pass_s(0.1);
        world.plugs[0].set_faults(Faults::default(), Faults::default());
        world.pass_s(115.0);
        world.assert_ignitions(1);
    }
}
