//! Frames sent until the engine runs.

use super::*;

/// A state with the shaft turning at 50 000 rpm, well above half of idle.
fn turning(state: u8) -> [u8; 7] {
    let switch = if matches!(state, 0 | 1 | 12) { 1 } else { 2 };
    zk::status(1, 50_000, [state, switch << 5, 76])
}

/// The supervision on top of the link: ordered to start, then with the stick at 60 %.
fn started() -> Bench<BenchEngine> {
    started_with(3)
}

/// The same with an ECU of a version.
fn started_with(version: u8) -> Bench<BenchEngine> {
    let config = EngineConfig::zk("z", 0, LINE, Rate::Hz20);
    let mut bench = Bench::engine(&config);
    *bench.machine = Engine::new(&config);
    bench.act(|engine, now| {
        engine.restore(Some(RetainedState::new(Order::Standby, Origin::Rc)));
        engine.start(now);
    });
    for _ in 0..30 {
        engine_slot(&mut bench, &zk::identity(160, version, 0));
        engine_slot(&mut bench, &zk::state(STATE_STANDBY));
    }
    for command in [Command::Arm, Command::Standby, Command::Run(Demand::Throttle(Throttle::IDLE))] {
        bench.act(|engine, now| engine.command(now, command, Origin::Rc, true)).unwrap();
    }
    bench
}

/// Feeds a status of the ECU, and returns the frame of the next slot while the source commands 60 %.
fn engine_slot(bench: &mut Bench<BenchEngine>, frame: &[u8]) -> Vec<u8> {
    let mut frames = engine_slot_with(bench, frame, Demand::Throttle(Throttle::from_percent(60).unwrap()));
    assert_eq!(frames.len(), 1, "{frames:02x?}");
    frames.remove(0)
}

/// The same with another demand, and all frames sent.
fn engine_slot_with(bench: &mut Bench<BenchEngine>, frame: &[u8], demand: Demand) -> Vec<Vec<u8>> {
    let t = (bench.now_us() / SEND_SLOT_US + 1) * SEND_SLOT_US;
    bench.rx_at_us(t - 10_000, frame);
    // Refused while it is not yet a start.
    let _ = bench.act(|engine, now| engine.command(now, Command::Run(demand), Origin::Rc, true));
    bench.frames();
    bench.run_to_us(t + 5_000);
    bench.bytes()
}

/// The demand goes out when two reports show that the engine runs and its shaft turns. Until then, whatever is reported of a
/// start, it stays at idle.
#[test]
fn the_demand_waits_for_a_running_engine() {
    for running in 6..=11 {
        let mut bench = started();
        for state in [1, 2, 3, 4, 5, STATE_UNKNOWN, running] {
            let frame = if state < 6 { zk::state(state) } else { turning(state) };
            assert_eq!(engine_slot(&mut bench, &frame), zk::throttle_tenths(RUN, 0), "state {state}");
        }
        // From here it rises at 50 %/s: 2.5 % per slot.
        for slot in 0..40u16 {
            let frame = engine_slot(&mut bench, &turning(running));
            let tenths = u16::from(frame[1] & 3) << 8 | u16::from(frame[2]);
            assert_eq!(frame, zk::throttle_tenths(RUN, tenths));
            assert!(tenths.abs_diff((slot * 25).min(600)) <= 25, "{tenths} at slot {slot}");
        }
        assert_eq!(engine_slot(&mut bench, &turning(running)), zk::throttle_tenths(RUN, 600));
        // ZK-15: a state without a name ends nothing.
        for _ in 0..10 {
            assert_eq!(engine_slot(&mut bench, &turning(STATE_UNKNOWN)), zk::throttle_tenths(RUN, 600));
        }
    }
    // Running with a shaft at rest releases nothing.
    let mut bench = started();
    for state in [3, 5, 11, 11, 11, 11] {
        assert_eq!(engine_slot(&mut bench, &zk::state(state)), zk::throttle_tenths(RUN, 0), "state {state}");
    }
}

/// One report that does not fit a running engine takes the run off the wire, and nothing else; two that agree end it.
#[test]
fn one_odd_report_withholds_the_run_and_two_end_it() {
    for odd in [zk::state(0), zk::state(1), zk::state(12), zk::state(3), zk::state(5), turning(12)] {
        let mut bench = started();
        for state in [3, 5, 11, 11, 11] {
            engine_slot(&mut bench, &if state < 6 { zk::state(state) } else { turning(state) });
        }
        for _ in 0..40 {
            engine_slot(&mut bench, &turning(11));
        }
        for _ in 0..3 {
            assert_eq!(engine_slot(&mut bench, &odd), zk::keep_alive(), "{odd:02x?}");
            assert_eq!(engine_slot(&mut bench, &turning(11)), zk::keep_alive(), "one does not confirm it");
            assert_eq!(engine_slot(&mut bench, &turning(11)), zk::throttle_tenths(RUN, 600), "two do");
        }
        assert_eq!(engine_slot(&mut bench, &odd), zk::keep_alive());
        for _ in 0..10 {
            assert_eq!(engine_slot(&mut bench, &odd), zk::throttle_tenths(STANDBY, 0), "{odd:02x?}");
        }
    }
}

/// Phase, faults and switch are debounced: they are accepted when two reports agree, also the first time.
#[test]
fn one_odd_report_changes_neither_phase_nor_faults_nor_switch() {
    let mut bench = link(Config::DEFAULT, LINE);
    let engine_status = |state: u8, error: u8, switch: u8| {
        zk::status(1, 0, [state | error << 5, error >> 3 | switch << 5, 76])
    };
    let known = |bench: &Bench<ZkLink>| {
        let report = &bench.machine.status().report;
        let Faults::Zk(error) = report.faults.unwrap().value else { panic!("ZK") };
        (report.phase.unwrap().value, error.code(), report.switch.unwrap().value)
    };
    let running = (Phase::Running, 0, ReportedSwitch::Run);
    for odd in [engine_status(0, 12, 0), engine_status(1, 0, 1), engine_status(11, 0, 2)] {
        bench.receive(&odd);
        let report = &bench.machine.status().report;
        assert_eq!((report.phase, report.switch), (None, None), "one alone");
        assert!(report.faults.is_none_or(|faults| faults.value.is_empty()), "one alone");
    }
    bench.receive(&engine_status(11, 0, 2));
    assert_eq!(known(&bench), running, "the first two");
    for (state, error, switch) in [(0, 0, 2), (11, 12, 2), (11, 0, 1), (0, 12, 0)] {
        let changed = (
            phase_of(state),
            error,
            [ReportedSwitch::Stop, ReportedSwitch::Standby, ReportedSwitch::Run][usize::from(switch)],
        );
        for _ in 0..3 {
            let t = bench.now_us() + 10_000;
            bench.rx_at_us(t, &engine_status(state, error, switch));
            assert_eq!(known(&bench), running, "{state} {error} {switch}");
            bench.receive(&engine_status(11, 0, 2));
            assert_eq!((known(&bench), bench.machine.status().report.phase.unwrap().at), (running, at_us(t)));
        }
        bench.receive(&engine_status(state, error, switch));
        bench.receive(&engine_status(state, error, switch));
        assert_eq!(known(&bench), changed, "two in a row");
        bench.receive(&engine_status(11, 0, 2));
        bench.receive(&engine_status(11, 0, 2));
    }
    // Faults that change in every frame still count as a fault.
    bench.receive(&engine_status(11, 12, 2));
    bench.receive(&engine_status(11, 13, 2));
    assert_eq!(known(&bench), (Phase::Running, 13, ReportedSwitch::Run));
    bench.receive(&engine_status(11, 12, 2));
    assert_eq!(known(&bench), (Phase::Running, 13, ReportedSwitch::Run), "one alone");
}

fn phase_of(state: u8) -> Phase {
    match state {
        0 => Phase::Stopped,
        1 => Phase::Standby,
        2..=5 | 13 => Phase::Starting,
        6..=11 => Phase::Running,
        12 => Phase::Cooling,
        14..=19 => Phase::Service,
        _ => Phase::Unknown,
    }
}

/// In mode 3 the demand stays at the engine's idle rpm until it runs, at 0 while that is unknown.
#[test]
fn the_rpm_waits_for_a_running_engine() {
    for (idle, demand, target) in
        [(None, 100_000, 0), (Some(30), 100_000, 30_000), (Some(30), 20_000, 20_000)]
    {
        let mut bench = started_with(4);
        let mut ecu = SimpleEcu::default();
        let mut report = |bench: &mut Bench<BenchEngine>, frame: &[u8]| {
            for sent in engine_slot_with(bench, frame, Demand::Rpm(Rpm::new(demand))) {
                ecu.obey(&sent);
            }
            ecu.obeyed()
        };
        let introduced = idle.map(|idle| zk::idle(idle, false));
        for state in [1, 2, 3, 4, 5, STATE_UNKNOWN] {
            for _ in 0..2 {
                report(&mut bench, &introduced.unwrap_or(zk::state(state)));
                report(&mut bench, &zk::state(state));
            }
            assert_eq!(report(&mut bench, &zk::state(state)), (RUN, Some(target), None), "{idle:?} {state}");
        }
        for _ in 0..200 {
            report(&mut bench, &turning(STATE_RUNNING));
        }
        assert_eq!(report(&mut bench, &turning(STATE_RUNNING)), (RUN, Some(demand), None), "{idle:?}");
    }
}
