//! Properties of any sequence.

use super::*;

/// Every command at every stage in every mode of a random engine: nothing panics. Seeds are fixed.
#[test]
fn no_sequence_of_inputs_panics() {
    use jetlink::line::LineError;
    let mut state = 0x1234_5678_9ABC_DEF1_u64;
    let mut next = |n: u64| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state % n
    };
    for _ in 0..300 {
        let ecu = if next(2) == 0 { Ecu::Amt } else { Ecu::Zk };
        let config = ecu.with(|config| {
            if next(2) == 0 {
                config.governor = Some(jetlink::engine::config::Governor::DEFAULT);
            }
        });
        let mut scenario = Scenario::with(ecu, config);
        scenario.reports(Reports::Standby).pass_us(2 * SECOND);
        for _ in 0..200 {
            let origin = Origin::ALL[next(5) as usize];
            let command = match next(12) {
                0 => Command::Arm,
                1 => Command::Disarm,
                2 => Command::Present,
                3 | 4 => Command::Standby,
                5 => run(0),
                6 => run(next(101) as u8),
                7 => Command::Run(rpm([0, 1, 5000, 160_000, u32::MAX][next(5) as usize])),
                8 => Command::HandOverToPwm,
                9 => action(zk::codec::Action::ALL[next(13) as usize]),
                10 => [Command::EmergencyStop, Command::ReleaseStop][next(2) as usize],
                _ => Command::ShutDown,
            };
            if next(3) > 0 {
                let _ = scenario.command_from(command, origin);
            }
            match next(10) {
                0 => scenario.reports = Some(crate::support::scenario::ALL[next(6) as usize]),
                1 => scenario.reports = None,
                2 => scenario.introduce_version(next(64) as u8 & 63),
                3 => scenario.values.egt_celsius = next(1100) as i32 - 50,
                4 => scenario.values.rpm = Some((next(127) * 500) as u32),
                5 => scenario.bench.act(|engine, _| engine.line_error(LineError::Framing)),
                6 => {
                    let bytes: Vec<u8> = (0..next(20)).map(|_| next(256) as u8).collect();
                    if !bytes.is_empty() {
                        scenario.bench.receive(&bytes);
                    }
                }
                7 => {
                    let record = scenario.bench.machine.record();
                    let record = if next(2) == 0 { record } else { record.without_start() };
                    scenario = Scenario::after_reset(ecu, config, Some(record));
                    scenario.reports = Some(crate::support::scenario::ALL[next(6) as usize]);
                }
                _ => {}
            }
            scenario.pass_us([1, 20_000, 100_000, 500_000, SECOND, 12 * SECOND][next(6) as usize]);
        }
    }
}

/// Nothing is due without a wake that the engine has set: an engine woken at its wakes does the same as one polled
/// every 5 ms.
#[test]
fn nothing_is_due_before_the_next_wake() {
    let mut state = 0x0DDB_1A5E_5BAD_5EED_u64;
    let mut next = move |n: u64| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state % n
    };
    let mut wrong = Vec::new();
    for round in 0..150 {
        let ecu = if next(2) == 0 { Ecu::Amt } else { Ecu::Zk };
        let standby_after = next(3) == 0;
        let config = ecu.with(|config| {
            if standby_after {
                config.loss.standby_after = Some(embassy_time::Duration::from_secs(3));
            }
            config.slew.down = [None, Some(300)][next(2) as usize];
        });
        let mut scenario = Scenario::started_with(ecu, config, percent(60));
        let mut log = Vec::new();
        for _ in 0..60 {
            let origin = Origin::SOURCES[next(4) as usize];
            let command = match next(9) {
                0 => Command::Present,
                1 => Command::Standby,
                2 => run(0),
                3 | 4 => run(next(101) as u8),
                5 => Command::Arm,
                6 => Command::Run(rpm(next(100_000) as u32)),
                7 if next(4) == 0 => Command::Disarm,
                _ => Command::Standby,
            };
            match next(8) {
                0 => scenario.reports = None,
                1 => scenario.reports = Some(Reports::Running),
                2 => scenario.reports = Some(Reports::Starting),
                3 => scenario.reports = Some(crate::support::scenario::ALL[next(6) as usize]),
                _ => {}
            }
            let count = next(4);
            for _ in 0..count {
                let _ = scenario.command_from(command, origin);
                scenario.pass_us(next(300) * 1000);
            }
            let mut often = scenario.clone();
            let time = next(6_000) * 1000;
            let end = scenario.now_us() + time;
            log.push(format!(
                "{} {origin:?} {command:?} x{count}, ECU {:?} for {time}",
                scenario.now_us(),
                scenario.reports
            ));
            scenario.run_to_us(end);
            while often.now_us() < end {
                let at = (often.now_us() + 5000).min(end);
                often.run_to_us(at);
                often.bench.act(|engine, now| engine.timeout(now));
            }
            let of = |scenario: &Scenario| {
                let telemetry = scenario.telemetry();
                let order = core::mem::discriminant(&telemetry.ordered.order);
                (
                    order,
                    telemetry.loss,
                    telemetry.active_source,
                    telemetry.waiting,
                    telemetry.in_doubt,
                    telemetry.start_waits_until,
                )
            };
            if of(&scenario) != of(&often) {
                wrong.push(format!(
                    "round {round}: {:?} / {:?}\n{:?}\n{:?}\n{}",
                    of(&scenario),
                    of(&often),
                    scenario.order(),
                    often.order(),
                    log[log.len().saturating_sub(3)..].join("\n")
                ));
                break;
            }
            let (a, b) = (scenario.order(), often.order());
            if let (Order::Run(Demand::Throttle(a)), Order::Run(Demand::Throttle(b))) = (a, b)
                && a.tenths().abs_diff(b.tenths()) > 30
            {
                wrong.push(format!(
                    "round {round}: {a:?} / {b:?}\n{}",
                    log[log.len().saturating_sub(3)..].join("\n")
                ));
                break;
            }
        }
    }
    assert!(wrong.is_empty(), "{} differ:\n{}", wrong.len(), wrong[..wrong.len().min(4)].join("\n\n"));
}
