//! The options of [`ZkTemper`], each beside its default.

use super::*;

fn bench(version: u8, temper: ZkTemper) -> Bench {
    let mut bench = Bench::new(ZkConfig { temper, ..ZkConfig::new(version) });
    bench.wait_ms(1000);
    bench
}

fn running(version: u8, temper: ZkTemper) -> Bench {
    let mut bench = bench(version, temper);
    bench.host(&[control(2, 0)]).wait_ms(1000);
    bench.host(&[control(3, 0)]).until(|ecu| ecu.turbine().phase() == Phase::Running);
    bench
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
fn run_alone_starts_unless_standby_is_wanted_first() {
    for wants_standby_first in [false, true] {
        let mut bench = bench(5, ZkTemper { wants_standby_first, ..ZkTemper::DEFAULT });
        bench.host(&[control(3, 0)]).wait_ms(10_000);
        assert_eq!(ignitions(&bench), usize::from(!wants_standby_first));
        bench.host(&[control(2, 0)]).wait_ms(1000);
        let before = ignitions(&bench);
        bench.host(&[control(3, 0)]).wait_ms(200_000);
        assert_eq!(ignitions(&bench), before + 1);
    }
}

#[test]
fn the_last_state_is_shown_in_so_many_frames_after_power_up() {
    for frames in [0, 2] {
        let mut bench = running(5, ZkTemper { last_state_first: frames, ..ZkTemper::DEFAULT });
        bench.host(&[EMPTY]);
        dip_ms(&mut bench, 1000);
        bench.seen.clear();
        bench.wait_ms(3000);
        let shown: Vec<_> =
            bench.seen.iter().filter(|seen| seen.1[0] == 0xF1).map(|seen| seen.1[3] & 31).collect();
        assert!(shown.len() > 4);
        assert_eq!(shown.iter().take_while(|&&shown| shown == state::MINIMUM).count(), usize::from(frames));
        assert!(!shown[usize::from(frames)..].contains(&state::MINIMUM));
    }
}

#[test]
fn a_hot_engine_is_started_at_once_or_cooled_first() {
    for starts_hot in [false, true] {
        let mut bench = running(5, ZkTemper { starts_hot, ..ZkTemper::DEFAULT });
        dip_ms(&mut bench, 1000);
        bench.wait_ms(2000);
        assert!(bench.ecu.turbine().egt() > 300.0);
        assert_eq!(bench.ecu.turbine().phase().is_starting(), starts_hot);
        assert_eq!(ignitions(&bench), 1 + usize::from(starts_hot));
    }
}

#[test]
fn a_flame_out_is_an_error_or_a_restart() {
    for relights in [0, 1] {
        let mut bench = running(5, ZkTemper { relights, ..ZkTemper::DEFAULT });
        bench.host(&[control(3, 500)]).wait_ms(5000);
        bench.ecu.turbine_mut().flame_out();
        bench.wait_ms(5000);
        if relights == 0 {
            assert_eq!(bench.error_and_switch(), (error::RPM_LOW, 1));
            continue;
        }
        assert_eq!((bench.ecu.state(), bench.ecu.error()), (state::RESTART, 0));
        bench.until(|ecu| ecu.turbine().phase() == Phase::Running);
        assert_eq!((bench.ecu.state(), ignitions(&bench)), (state::RUNNING, 2));
        let history = bench.ecu.turbine().history();
        assert_eq!(history.relights, history.ignitions[1..]);
        // Once only.
        bench.ecu.turbine_mut().flame_out();
        bench.until(|ecu| ecu.error() == error::RPM_LOW);
        assert_eq!(ignitions(&bench), 2);
    }
}

#[test]
fn a_start_after_power_was_lost_in_flight_is_shown_as_a_restart() {
    let mut bench = running(5, ZkTemper { relights: 1, starts_hot: true, ..ZkTemper::DEFAULT });
    dip_ms(&mut bench, 1000);
    bench.wait_ms(2000);
    assert_eq!(bench.ecu.state(), state::RESTART);
    // Standby ends that, and the next start is one like any other.
    bench.host(&[control(2, 0)]).wait_ms(1000);
    bench.host(&[control(3, 0)]).wait_ms(1000);
    assert_eq!(bench.ecu.state(), state::IGNITION);
}

#[test]
fn services_in_a_hot_engine_are_refused_or_put_fuel_into_it() {
    for obeys in [false, true] {
        let temper = ZkTemper { services_while_cooling: obeys, valves_pass_fuel: obeys, ..ZkTemper::DEFAULT };
        // Drain, main valve, pump test.
        for number in [1, 3, 5] {
            let mut bench = running(5, temper);
            bench.host(&[control(2, 0)]).wait_ms(3000);
            assert_eq!(bench.ecu.state(), state::COOLING);
            bench.host(&[]).once(action(number)).wait_ms(8000);
            let hot = bench.ecu.turbine().history().hot_fuel_time();
            if obeys {
                assert!(hot.abs_diff(3 * SECOND) <= 2 * STEP, "{hot}");
                assert_eq!(bench.ecu.turbine().history().hot_fuel.len(), 1);
            } else {
                assert_eq!(hot, 0);
                assert_eq!(bench.ecu.stats.ignored.busy, 1);
            }
        }
    }
}

#[test]
fn fuel_into_a_cold_engine_is_not_hot_fuel() {
    let mut bench = bench(5, ZkTemper::DEFAULT);
    bench.host(&[control(2, 0)]).wait_ms(1000).once(action(1)).wait_ms(5000);
    assert!(bench.ecu.turbine().fuel_total() > 0.0);
    assert_eq!(bench.ecu.turbine().history().hot_fuel_time(), 0);
}

#[test]
fn id_0_keeps_the_control_signal_or_does_not() {
    for empty_keeps_control in [true, false] {
        for version in [3, 4, 5] {
            let mut bench = running(version, ZkTemper { empty_keeps_control, ..ZkTemper::DEFAULT });
            bench.host(&[EMPTY]).wait_ms(5000);
            let lost = !empty_keeps_control && version < 5;
            assert_eq!(bench.ecu.error() == error::CONTROL_LOST, lost, "version {version}");
            assert_eq!(bench.ecu.turbine().phase() == Phase::Running, !lost);
        }
    }
    // In rpm mode, ID 7 in turn with it is enough.
    let mut bench = bench(4, ZkTemper { empty_keeps_control: false, ..ZkTemper::DEFAULT });
    bench.host(&[switch(3, 4), rpm(2000)]).until(|ecu| ecu.turbine().phase() == Phase::Running);
    bench.host(&[EMPTY, rpm(2500)]).wait_ms(5000);
    assert_eq!((bench.ecu.error(), bench.ecu.turbine().phase()), (0, Phase::Running));
}

#[test]
fn version_6_has_the_shaft_speed_in_id_9_and_sends_id_10() {
    let mut bench = running(6, ZkTemper::DEFAULT);
    bench.wait_ms(1000);
    let nine = bench.last(9);
    assert_eq!([nine[4], nine[5]], [nine[1], nine[2]]);
    assert!(u16::from_le_bytes([nine[1], nine[2]]) > 4000);
    assert_eq!(bench.last(10)[0], 0xFA);
}

#[test]
fn a_broken_sensor_reads_the_ends_of_its_range() {
    let mut bench = running(5, ZkTemper::DEFAULT);
    for (sensor, raw) in [(EgtSensor::Open, 0x7FF), (EgtSensor::Short, 0)] {
        bench.ecu.turbine_mut().set_egt_sensor(sensor);
        bench.wait_ms(1000);
        let one = bench.last(1);
        assert_eq!(u16::from(one[4] & 0x1C) << 6 | u16::from(one[5]), raw);
    }
    assert!(bench.ecu.turbine().egt() > 300.0);
}
