//! The options of [`AmtTemper`], each beside its default.

use super::*;

fn config(temper: AmtTemper) -> AmtConfig {
    AmtConfig { temper, ..AmtConfig::new(EngineModel::Olympus) }
}

fn dip_ms(bench: &mut Bench, ms: u64) {
    bench.ecu.power(bench.now, false);
    bench.wait_ms(ms);
    bench.ecu.power(bench.now, true);
}

fn ignitions(bench: &Bench) -> usize {
    bench.ecu.turbine().history().ignitions.len()
}

#[test]
fn run_alone_starts_unless_auto_stop_is_wanted_first() {
    for wants_auto_stop_first in [false, true] {
        let mut bench = Bench::new(config(AmtTemper { wants_auto_stop_first, ..AmtTemper::DEFAULT }));
        bench.reply(&run(0)).wait_ms(10_000);
        assert_eq!(ignitions(&bench), usize::from(!wants_auto_stop_first));
        bench.reply(&AUTO).wait_ms(1000);
        let before = ignitions(&bench);
        bench.reply(&run(0)).wait_ms(200_000);
        assert_eq!(ignitions(&bench), before + 1);
    }
}

#[test]
fn the_last_state_is_shown_in_so_many_sets_after_power_up() {
    for frames in [0, 2] {
        let mut bench = Bench::running(config(AmtTemper { last_state_first: frames, ..AmtTemper::DEFAULT }));
        dip_ms(&mut bench, 1000);
        bench.sets.clear();
        bench.wait_ms(3000);
        let shown: Vec<_> = bench.sets.iter().map(|(_, _, bytes)| bytes[1]).collect();
        assert_eq!(shown[0], 5, "the set-up set comes first all the same");
        let running = shown[1..].iter().take_while(|&&shown| shown == 0b0110_0100).count();
        assert_eq!(running, usize::from(frames));
        assert!(!shown[1 + running..].contains(&0b0110_0100));
    }
}

#[test]
fn a_hot_engine_is_started_at_once_or_cooled_first() {
    for starts_hot in [false, true] {
        let mut bench = Bench::running(config(AmtTemper { starts_hot, ..AmtTemper::DEFAULT }));
        dip_ms(&mut bench, 1000);
        bench.wait_ms(3000);
        assert!(bench.ecu.turbine().egt() > 300.0);
        assert_eq!(ignitions(&bench), 1 + usize::from(starts_hot));
    }
}

#[test]
fn clearance_lasts_as_long_as_it_is_set() {
    for clearance in [0, 1, 4] {
        let clearance = clearance * SECOND;
        let mut bench = Bench::new(config(AmtTemper { clearance, ..AmtTemper::DEFAULT }));
        bench.reply(&AUTO).wait_ms(2000);
        bench.reply(&run(0));
        let ms = bench.until(|ecu| ecu.turbine().phase() == Phase::Ignition) * MILLIS;
        assert!((clearance..clearance + 300 * MILLIS).contains(&ms), "{ms}");
    }
}

#[test]
fn a_running_engine_shows_full_operation_or_something_else_now_and_then() {
    for shows in [Status::IdleCalibration, Status::StartedUp, Status::Unnamed(31)] {
        let in_flight = Some(InFlight { shows, every: 2 * SECOND, lasts: SECOND });
        let mut bench = Bench::running(config(AmtTemper { in_flight, ..AmtTemper::DEFAULT }));
        bench.reply(&run(50)).wait_ms(5000);
        bench.sets.clear();
        bench.wait_ms(10_000);
        let count = |byte| bench.sets.iter().filter(|(_, _, bytes)| bytes[1] == byte).count();
        let (shown, full) = (count(shows.bits() | 4), count(0b0110_0100));
        assert!(shown > 30 && full > 30 && shown.abs_diff(full) < 10, "{shown} {full}");
        assert_eq!(bench.ecu.turbine().phase(), Phase::Running);
        // An engine that does not run is not reported as one that does.
        bench.reply(&AUTO).wait_ms(1000);
        assert_eq!(bench.ecu.status(), Status::NoClearance);
    }
}

#[test]
fn an_engine_that_was_stopped_for_want_of_commands_starts_again_on_run_or_only_after_a_stop() {
    for starts_after_silence in [false, true] {
        let temper = AmtTemper { starts_after_silence, starts_hot: true, ..AmtTemper::DEFAULT };
        let mut bench = Bench::running(config(temper));
        bench.reply = None;
        bench.wait_ms(10_000);
        assert!(!bench.ecu.turbine().phase().is_live() && ignitions(&bench) == 1);
        bench.reply(&run(0)).wait_ms(10_000);
        assert_eq!(ignitions(&bench), if starts_after_silence { 2 } else { 1 });
    }
}

#[test]
fn a_flame_out_keeps_the_engine_from_a_start_or_only_for_a_while() {
    for trips_clear_after in [None, Some(20 * SECOND)] {
        let temper = AmtTemper { trips_clear_after, starts_hot: true, ..AmtTemper::DEFAULT };
        let mut bench = Bench::running(config(temper));
        bench.ecu.turbine_mut().flame_out();
        bench.until(|ecu| ecu.errors() == error::RPM_LOW);
        bench.wait_ms(10_000);
        assert_eq!((bench.last()[1], ignitions(&bench)), (0, 1), "error sets");
        bench.wait_ms(20_000);
        assert_eq!(ignitions(&bench), if trips_clear_after.is_some() { 2 } else { 1 });
    }
}

#[test]
fn a_broken_sensor_reads_the_ends_of_its_range() {
    let mut bench = Bench::running(config(AmtTemper::DEFAULT));
    for (sensor, raw) in [(EgtSensor::Open, 254), (EgtSensor::Short, 0)] {
        bench.ecu.turbine_mut().set_egt_sensor(sensor);
        bench.wait_ms(1000);
        let sets = bench.sets.iter().rev().map(|(_, _, bytes)| bytes).find(|bytes| bytes[1] == 0b0110_0100);
        assert_eq!(sets.expect("a normal set")[3], raw);
    }
}
