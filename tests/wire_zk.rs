//! The runner and a ZK link against a simulated ZK ECU over the wire. The ECU's counts and behaviour are the
//! judge, and the simulation decodes the wire, not our codec.
#![allow(clippy::disallowed_methods, reason = "a scenario keeps its own time")]

use bench::rows::simulated_as;
use bench::wired::{Bench, LONG, control_frames, received, rpm, throttle_percent};
use embassy_time::{Duration, Timer};
use jetlink::command::{Command, Interlock, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::{AccelerationCurve, Action, IgnitionPumpVoltage, Rate};
use jetlink::ecu::{EcuConfig, Service, zk};
use jetlink::event::{Event, LossStage};
use jetlink::line::Line;
use jetlink::report::{LinkState, NotSent, Phase};
use jetlink::units::{Hectopascals, Millivolts};
use sim::any::Protocol;
use sim::control;
use sim::vendor::VendorConfig as _;
use sim::wire::{Babble, Entry, Faults as Noise};
use sim::zk::{Action as SimAction, Rate as SimRate, Stats, Sw, ZkCommand, ZkConfig, ZkEcu};

/// An engine whose ECU still has another rate than the one configured.
fn bench_on(line: Line, rate: Rate, version: u8, change: impl FnOnce(&mut ZkConfig)) -> Bench<ZkEcu> {
    let config = EngineConfig::zk("zk", 0, line, rate);
    let mut ecu = simulated_as::<ZkConfig>(&config).with_version(version);
    change(&mut ecu);
    Bench::new(&config, ZkEcu::new(ecu), u64::from(version))
}

fn bench(version: u8) -> Bench<ZkEcu> {
    bench_on(Line::new(9600), Rate::Hz50, version, |_| {})
}

fn stats(bench: &Bench<ZkEcu>) -> Stats {
    bench.plug.ecu(|ecu| ecu.stats)
}

/// The commands that the node put on the wire.
fn commands(record: &[Entry]) -> Vec<(u64, ZkCommand)> {
    let zk = |(at, command)| {
        let control::Command::Zk(command) = command else { unreachable!("read as ZK") };
        (at, command)
    };
    control_frames(Protocol::Zk, record).into_iter().map(zk).collect()
}

/// ZK-10, ZK-11, ZK-12: a command in every slot and a status for it, at every baud rate, with one stop bit and
/// with two, at every rate that the line carries, for every protocol version.
#[test]
fn zk_10_the_cadence_holds_on_every_line_rate_and_version() {
    let rates = [(Rate::Hz20, 50), (Rate::Hz50, 20), (Rate::Hz100, 10)];
    let mut lines = 0;
    for baud in Line::BAUD_RATES {
        for line in [Line::new(baud), Line::with_two_stop_bits(baud)] {
            for (rate, period_ms) in rates.into_iter().filter(|(rate, _)| rate.fits(line)) {
                for version in [1, 3, 4, 5] {
                    lines += 1;
                    let bench = bench_on(line, rate, version, |_| {});
                    bench.play(LONG, async {
                        Timer::after(Duration::from_secs(3)).await;
                        bench.plug.record(true);
                        let before = stats(&bench);
                        Timer::after(Duration::from_secs(10)).await;
                        let after = stats(&bench);
                        let what = format!("{line:?} {rate:?} version {version}");
                        let turns = 10_000 / period_ms;
                        assert!((after.accepted - before.accepted).abs_diff(turns) <= 1, "{what}");
                        let frames = after.frames_sent() - before.frames_sent();
                        assert!(frames.abs_diff(turns) <= 1, "{what}: {frames}");
                        assert_eq!((after.bad.total(), after.ignored.version), (0, 0), "{what}");
                        let starts: Vec<_> =
                            commands(&bench.plug.take_log()).into_iter().map(|(at, _)| at).collect();
                        for pair in starts.windows(2) {
                            assert_eq!(pair[1] - pair[0], period_ms * 1_000_000, "{what}");
                        }
                        let telemetry = bench.handle().telemetry();
                        assert_eq!(telemetry.counters.crc_failures, 0, "{what}");
                        assert_eq!(
                            telemetry.counters.worst_slot_delay,
                            Some(Duration::from_ticks(0)),
                            "{what}"
                        );
                        assert_eq!(telemetry.report.rate.expect("by status ID 6").value, rate, "{what}");
                    });
                }
            }
        }
    }
    // 20 Hz on all seven, 50 Hz on six, 100 Hz on five; two stop-bit settings, four versions.
    assert_eq!(lines, (7 + 6 + 5) * 2 * 4);
}

/// ZK-11: the rate that the ECU has is changed to the configured one, once, and confirmed by status ID 6.
#[test]
fn zk_11_the_rate_is_set_and_confirmed() {
    let bench = bench_on(Line::new(9600), Rate::Hz100, 5, |ecu| ecu.rate = SimRate::Hz20);
    let mut events = bench.handle().events().expect("a free place");
    bench.plug.record(true);
    bench.play(LONG, async { Timer::after(Duration::from_secs(5)).await });
    let sent: Vec<_> =
        commands(&bench.plug.log()).into_iter().filter(|(_, c)| matches!(c, ZkCommand::Action(_))).collect();
    assert_eq!(sent.len(), 1, "{sent:?}");
    assert_eq!(sent[0].1, ZkCommand::Action(SimAction::Rate100));
    assert_eq!(bench.plug.ecu(|ecu| ecu.rate()), SimRate::Hz100);
    assert!(received(&mut events).contains(&Event::RateConfirmed(Rate::Hz100)));
}

/// ZK-7, ZK-6: while the version is unknown, only version 1 commands are sent and there is no voltage; a
/// known version that is too low is named in the refusal.
#[test]
fn zk_7_versions_gate_commands() {
    let three = bench(3);
    three.play(LONG, async {
        assert_eq!(
            three.command(
                Command::Service(Service::Zk(zk::config::Service::Action(Action::ResetFuel))),
                Origin::Bench
            ),
            Err(Rejected::Listening),
            "nothing is known yet"
        );
        three.start().await;
        assert_eq!(
            three.command(rpm(100_000), Origin::Bench),
            Err(Rejected::NeedsVersion { needed: 4, known: Some(3) })
        );
        let report = three.handle().telemetry().report;
        let supply = report.supply.expect("status ID 2").value;
        assert_eq!(supply.voltage, Some(Millivolts::new(u32::from(supply.raw) * 100)));
        assert!(report.pressure_requested.is_none(), "from version 4");
    });
    assert_eq!(stats(&three).ignored.version, 0);

    let five = bench(5);
    five.play(LONG, async {
        five.start().await;
        five.command(rpm(100_000), Origin::Bench).expect("version 5 has speed control");
        let supply = five.handle().telemetry().report.supply.expect("status ID 2").value;
        assert_eq!(supply.voltage, Some(Millivolts::new(u32::from(supply.raw) * 200)));
    });
}

/// ZK-9 mode 1: switch and throttle in ID 1; the whole sequence from standby to standby.
#[test]
fn zk_9_in_mode_1_an_engine_starts_runs_and_shuts_down() {
    for version in 1..=5 {
        let bench = bench(version);
        bench.plug.record(true);
        bench.play(LONG, async {
            bench.start().await;
            bench.command_for(throttle_percent(60), Duration::from_secs(20)).await;
            let report = bench.handle().telemetry().report;
            let true_rpm = bench.plug.ecu(|ecu| ecu.turbine().rpm());
            let shown = f64::from(report.rpm.expect("in every status").value.get());
            assert!((shown - true_rpm).abs() < true_rpm / 50.0, "{shown} shown, {true_rpm} true");
            assert_eq!(report.throttle.expect("status ID 3").value.tenths(), 600);
            bench
                .command_until(Command::Standby, |bench| bench.plug.ecu(|ecu| ecu.turbine().rpm() < 1.0))
                .await;
        });
        let sent = commands(&bench.plug.log());
        assert!(sent.len() > 1000);
        for (_, command) in sent {
            match command {
                // ZK-8: SW 0 would hand the engine over.
                // While it listens at first.
                ZkCommand::Empty => {}
                ZkCommand::Control { sw: Sw::Standby, throttle: 0 } => {}
                ZkCommand::Control { sw: Sw::Run, throttle: 0 | 600 } => {}
                ZkCommand::Action(SimAction::Rate50) => {}
                other => panic!("version {version}: {other:?}"),
            }
        }
        assert_eq!(stats(&bench).control_losses, 0);
    }
}

/// ZK-9 mode 2: the switch in ID 6, the throttle in ID 1, which carries the same switch.
#[test]
fn zk_9_mode_2_the_switch_goes_by_id_6() {
    let mut config = EngineConfig::zk("zk", 0, Line::new(9600), Rate::Hz50);
    config.ecu = EcuConfig::Zk(zk::config::Config { split_switch: true, rate: Rate::Hz50 });
    let ecu = simulated_as::<ZkConfig>(&config).with_version(4);
    let bench = Bench::new(&config, ZkEcu::new(ecu), 2);
    bench.play(LONG, async {
        bench.start().await;
        bench.command_for(throttle_percent(50), Duration::from_secs(10)).await;
        bench.plug.record(true);
        bench.command_for(throttle_percent(50), Duration::from_secs(5)).await;
        let sent: Vec<_> = commands(&bench.plug.take_log()).into_iter().map(|(_, command)| command).collect();
        assert!(sent.len() > 200);
        let id6 = ZkCommand::Switch { sw: Sw::Run, factor: 0 };
        let id1 = ZkCommand::Control { sw: Sw::Run, throttle: 500 };
        assert!(sent.windows(2).all(|two| two == [id6, id1] || two == [id1, id6]), "{sent:?}");
        assert!((bench.plug.ecu(|ecu| ecu.turbine().load()) - 0.5).abs() < 0.02);
        bench.command_until(Command::Standby, |bench| bench.plug.ecu(|ecu| ecu.turbine().rpm() < 1.0)).await;
    });
}

/// ZK-9 mode 3: ID 6 carries switch and RPM_X, ID 7 the rpm. The engine reaches the commanded speed, the finest step
/// is chosen, a throttle takes over again without a stop, and an emergency stop gets through.
#[test]
fn zk_9_mode_3_the_engine_reaches_the_rpm() {
    for version in [4, 5] {
        let bench = bench(version);
        bench.plug.record(true);
        bench.play(LONG, async {
            bench.start().await;
            for target in [90_000, 123_450, 60_000] {
                bench.command_for(rpm(target), Duration::from_secs(20)).await;
                let true_rpm = bench.plug.ecu(|ecu| ecu.turbine().rpm());
                assert!((true_rpm - f64::from(target)).abs() < 1_500.0, "{target}: {true_rpm}");
                bench.plug.take_log();
                bench.command_for(rpm(target), Duration::from_secs(1)).await;
                for (_, command) in commands(&bench.plug.take_log()) {
                    match command {
                        // A 160 000 rpm engine needs RPM_X 4.
                        ZkCommand::Switch { sw: Sw::Run, factor: 4 } => {}
                        ZkCommand::Rpm(code) => {
                            let wanted = u32::from(code) * 40;
                            assert!(wanted <= target && wanted > target - 40, "{wanted} for {target}");
                        }
                        other => panic!("{other:?}"),
                    }
                }
            }
            // A demand beyond the maximum is clamped to it, reported once, and counts as received.
            let mut events = bench.handle().events().expect("a free place");
            bench.plug.take_log();
            bench.command_for(rpm(160_100), Duration::from_secs(15)).await;
            let clamped = Event::Clamped(jetlink::units::Rpm::new(160_000));
            assert_eq!(received(&mut events).iter().filter(|event| **event == clamped).count(), 1);
            let codes: Vec<_> = commands(&bench.plug.take_log())
                .into_iter()
                .filter_map(|(_, command)| if let ZkCommand::Rpm(code) = command { Some(code) } else { None })
                .collect();
            assert!(codes.iter().all(|code| *code <= 4000) && codes.last() == Some(&4000), "{codes:?}");
            assert_eq!(bench.handle().telemetry().loss, LossStage::None);
            bench.command_for(throttle_percent(30), Duration::from_secs(15)).await;
            assert!(bench.in_phase(Phase::Running));
            assert!((bench.plug.ecu(|ecu| ecu.turbine().load()) - 0.3).abs() < 0.02);
            bench.command_for(rpm(80_000), Duration::from_secs(5)).await;
            bench.command(Command::EmergencyStop, Origin::Emergency).expect("never refused");
            Timer::after(Duration::from_millis(300)).await;
            assert!(!bench.plug.ecu(|ecu| ecu.turbine().phase().is_live()));
        });
    }
}

/// An emergency stop is sent outside the slots: at once, also at 20 Hz.
#[test]
fn an_emergency_stop_does_not_wait_for_its_slot() {
    for after_turn_ms in [1, 5, 10, 20, 30, 49] {
        let bench = bench_on(Line::new(9600), Rate::Hz20, 4, |_| {});
        bench.play(LONG, async {
            bench.start().await;
            // From one slot to a chosen place before the next: a command of 4 bytes takes 4.2 ms.
            bench.plug.record(true);
            bench.until(|bench| !bench.plug.log().is_empty()).await;
            let turn = bench.plug.take_log()[0].start;
            let place = turn + 500_000_000 + after_turn_ms * 1_000_000;
            let place = embassy_time::Instant::from_micros(place / 1000);
            while embassy_time::Instant::now() + Duration::from_millis(100) < place {
                let _ = bench.command(throttle_percent(0), Origin::Bench);
                Timer::after(Duration::from_millis(10)).await;
            }
            Timer::at(place).await;
            let wanted = sim::clock::now_ns();
            bench.command(Command::EmergencyStop, Origin::Emergency).expect("never refused");
            Timer::after(Duration::from_millis(20)).await;
            let stop = commands(&bench.plug.take_log())
                .into_iter()
                .find(|(_, command)| *command == ZkCommand::Control { sw: Sw::Stop, throttle: 0 })
                .expect("on the wire within 20 ms");
            // At once, or after the command that was being sent.
            assert!(stop.0 - wanted <= 4_200_000, "{} µs after it was commanded", (stop.0 - wanted) / 1000);
        });
    }
}

/// ZK-13: IDs 4 and 5 directly after ID 3, and confirmed by status ID 5.
#[test]
fn zk_13_settings_are_unlocked_set_and_confirmed() {
    let bench = bench(4);
    let mut events = bench.handle().events().expect("a free place");
    bench.plug.record(true);
    bench.play(LONG, async {
        bench.command_until(Command::Standby, |bench| bench.in_phase(Phase::Standby)).await;
        let curve = zk::config::Service::Curve(AccelerationCurve::new(55).expect("10..=70"));
        let voltage = IgnitionPumpVoltage::from_millivolts(Millivolts::new(2400)).expect("0..=5100");
        let pump = zk::config::Service::IgnitionPump(voltage);
        for service in [curve, pump] {
            let service = Service::Zk(service);
            bench
                .until(|bench| bench.command(Command::Service(service), Origin::Bench) != Err(Rejected::Busy))
                .await;
            bench.until(|_| received(&mut events).contains(&Event::ServiceConfirmed(service))).await;
        }
        assert_eq!(bench.plug.ecu(|ecu| (ecu.curve(), ecu.ignition_voltage())), (55, 120));
    });
    let sent: Vec<_> = commands(&bench.plug.log()).into_iter().map(|(_, command)| command).collect();
    for (i, command) in sent.iter().enumerate() {
        if matches!(command, ZkCommand::IgnitionVoltage(_) | ZkCommand::AccelerationCurve(_)) {
            assert_eq!(sent[i - 1], ZkCommand::Unlock);
        }
    }
    assert_eq!(sent.iter().filter(|command| **command == ZkCommand::Unlock).count(), 2);
    assert_eq!(stats(&bench).ignored.locked, 0);
}

/// Service commands are refused while the engine runs. The control for it: at rest they go out.
#[test]
fn service_needs_a_stopped_engine() {
    let test = Command::Service(Service::Zk(zk::config::Service::Action(Action::TestStarter)));
    let bench = bench(4);
    let mut events = bench.handle().events().expect("a free place");
    bench.play(LONG, async {
        bench.start().await;
        assert_eq!(bench.command(test, Origin::Bench), Err(Rejected::NotStopped));
        bench.command_until(Command::Standby, |bench| bench.in_phase(Phase::Standby)).await;
        bench.command(test, Origin::Bench).expect("it hangs");
        bench.until(|_| received(&mut events).contains(&Event::Phase(Phase::Service))).await;
    });
}

/// ZK-14: pressure once a second while the ECU requests it, and only a fresh one.
#[test]
fn zk_14_pressure_goes_out_once_a_second_while_it_is_fresh() {
    let bench = bench_on(Line::new(9600), Rate::Hz50, 4, |ecu| ecu.esr = true);
    bench.play(LONG, async {
        Timer::after(Duration::from_secs(5)).await;
        assert_eq!(stats(&bench).pressures, 0, "none is known");
        for _ in 0..20 {
            bench.channel.owner().setup().pressure(Hectopascals::new(987).expect("0..=1023"));
            Timer::after(Duration::from_millis(500)).await;
        }
        let fresh = stats(&bench).pressures;
        assert!((9..=11).contains(&fresh), "{fresh} in 10 s");
        assert_eq!(bench.plug.ecu(|ecu| ecu.pressure()), Some(987));
        // It becomes stale: it is sent for 5 s more, and then no longer.
        Timer::after(Duration::from_secs(6)).await;
        let stale = stats(&bench).pressures;
        Timer::after(Duration::from_secs(10)).await;
        assert_eq!(stats(&bench).pressures, stale);
    });

    let never_asks = bench_on(Line::new(9600), Rate::Hz50, 4, |_| {});
    never_asks.play(LONG, async {
        for _ in 0..20 {
            never_asks.channel.owner().setup().pressure(Hectopascals::new(987).expect("0..=1023"));
            Timer::after(Duration::from_millis(500)).await;
        }
    });
    assert_eq!(stats(&never_asks).pressures, 0);
}

/// ZK-8: SW 0 is sent only when the hand-over is commanded by name. It counts as a start: it needs the source's own standby
/// right before it.
#[test]
fn zk_8_the_hand_over_to_pwm_goes_out_by_its_name() {
    let bench = bench(4);
    bench.plug.record(true);
    bench.play(LONG, async {
        let hand_over = || bench.command(Command::HandOverToPwm, Origin::Bench);
        bench.start().await;
        assert_eq!(hand_over(), Err(Rejected::StandbyFirst), "it runs");
        bench.command_for(Command::Standby, Duration::from_secs(60)).await;
        bench.command_until(Command::Standby, |bench| bench.in_phase(Phase::Standby)).await;
        bench.command(Command::Disarm, Origin::Bench).expect("always accepted");
        bench.command_for(Command::Standby, Duration::from_millis(200)).await;
        assert_eq!(hand_over(), Err(Rejected::Start(Interlock::NotArmed)));
        bench.command(Command::Arm, Origin::Bench).expect("no stop is latched");
        assert_eq!(hand_over(), Err(Rejected::StandbyFirst), "the refusal used up the permission");
        bench.command(Command::Standby, Origin::Bench).expect("no other source holds it");
        hand_over().expect("a ZK ECU has it");
        Timer::after(Duration::from_secs(1)).await;
    });
    let sent = commands(&bench.plug.log());
    let handed = |command: &ZkCommand| matches!(command, ZkCommand::Control { sw: Sw::None, .. });
    let first = sent.iter().position(|(_, command)| handed(command)).expect("it was commanded");
    assert!(sent[first..].iter().all(|(_, command)| handed(command)));
    assert_eq!(bench.plug.ecu(|ecu| ecu.controlled_by()), sim::zk::ControlledBy::Pwm);
}

/// ZK-10: an ECU of version 5 keeps the engine running without us; the node therefore has to handle a silent
/// source, and lowers the throttle on the wire.
#[test]
fn zk_10_a_silent_source_brings_a_version_5_engine_to_idle() {
    let bench = bench(5);
    bench.play(LONG, async {
        bench.start().await;
        bench.command_for(throttle_percent(90), Duration::from_secs(20)).await;
        assert!(bench.plug.ecu(|ecu| ecu.turbine().load()) > 0.85);
        Timer::after(Duration::from_secs(20)).await;
        assert!(bench.plug.ecu(|ecu| ecu.turbine().load()) < 0.05);
        assert!(bench.in_phase(Phase::Running));
        // The control: with the line cut nothing can, and the ECU keeps its demand.
        bench.command_for(throttle_percent(90), Duration::from_secs(20)).await;
        bench.plug.cut(true);
        let cut_at = sim::clock::now_ns();
        bench.plug.record(true);
        Timer::after(Duration::from_secs(25)).await;
        assert!(bench.plug.ecu(|ecu| ecu.turbine().load()) > 0.85);
        // In doubt no run goes out. When the stages of loss have run out, standby does: 0.5 s timeout, 1 s hold, 10 s.
        let sent = commands(&bench.plug.take_log());
        let standby = sent
            .iter()
            .position(|(_, command)| matches!(command, ZkCommand::Control { sw: Sw::Standby, .. }));
        let standby = standby.expect("standby goes out blind");
        let after = sent[standby].0 - cut_at;
        assert!((11_300_000_000..=11_600_000_000).contains(&after), "{after} ns");
        for (at, command) in &sent[..standby] {
            let runs = matches!(command, ZkCommand::Control { sw: Sw::Run, .. });
            assert!(*command == ZkCommand::Empty || runs && at - cut_at < 100_000_000, "{command:?}");
        }
    });
}

/// The timer detects loss after 0.5 s, it is reported once, and the link recovers without help; up to version 4 the
/// ECU sends only when it receives, so the slots have to continue.
#[test]
fn a_cut_line_is_reported_once_and_comes_back() {
    for version in [1, 4, 5] {
        let bench = bench(version);
        let mut events = bench.handle().events().expect("a free place");
        bench.play(LONG, async {
            bench.until(|bench| bench.handle().telemetry().link == LinkState::Up).await;
            received(&mut events);
            bench.plug.cut(true);
            Timer::after(Duration::from_millis(450)).await;
            assert_eq!(bench.handle().telemetry().link, LinkState::Up);
            Timer::after(Duration::from_millis(100)).await;
            assert_eq!(bench.handle().telemetry().link, LinkState::Lost);
            Timer::after(Duration::from_secs(5)).await;
            bench.plug.cut(false);
            Timer::after(Duration::from_millis(100)).await;
            assert_eq!(bench.handle().telemetry().link, LinkState::Up);
        });
        let events = received(&mut events);
        assert_eq!(events.iter().filter(|event| **event == Event::LinkLost).count(), 1, "{events:?}");
        assert_eq!(events.iter().filter(|event| **event == Event::LinkUp).count(), 1, "{events:?}");
    }
}

/// ZK-16 and ZK-1 under noise both ways: nothing unsolicited on the wire, and recovery.
#[test]
fn zk_16_noise_never_causes_an_unsolicited_command() {
    for seed in 0..8 {
        let config = EngineConfig::zk("zk", 0, Line::new(9600), Rate::Hz50);
        let ecu = simulated_as::<ZkConfig>(&config).with_version(4);
        let bench = Bench::new(&config, ZkEcu::new(ecu), seed);
        let noise = Noise {
            flip_per_million: 2_000,
            lose_per_million: 10_000,
            add_per_million: 10_000,
            framing_per_million: 10_000,
            delay_ns: 0,
            jitter_ns: 500_000,
        };
        bench.play(LONG, async {
            bench.start().await;
            bench.command_for(throttle_percent(40), Duration::from_secs(5)).await;
            bench.plug.record(true);
            bench.plug.set_faults(noise, noise);
            bench.command_for(throttle_percent(40), Duration::from_secs(60)).await;
            let (mut runs, mut doubts) = (0, 0);
            for (_, command) in commands(&bench.plug.take_log()) {
                match command {
                    ZkCommand::Control { sw: Sw::Run, throttle: 0..=400 } => runs += 1,
                    // In doubt, after a gap or one odd report.
                    ZkCommand::Empty => doubts += 1,
                    // A false status ID 6, one in 256 damaged frames, can name another rate.
                    ZkCommand::Action(SimAction::Rate50) => {}
                    other => panic!("seed {seed}: {other:?}"),
                }
            }
            // 7 % to 15 % of the slots; the engine keeps running.
            assert!(doubts * 4 < runs, "seed {seed}: {runs} run, {doubts} in doubt");
            assert!(bench.plug.ecu(|ecu| ecu.turbine().phase().is_live()), "seed {seed}");
            bench.plug.set_faults(Noise::default(), Noise::default());
            Timer::after(Duration::from_secs(1)).await;
            let before = (bench.handle().telemetry(), stats(&bench));
            assert_eq!(before.0.link, LinkState::Up, "seed {seed}");
            Timer::after(Duration::from_secs(10)).await;
            let after = (bench.handle().telemetry(), stats(&bench));
            assert_eq!(after.0.counters.crc_failures, before.0.counters.crc_failures);
            assert!(after.1.accepted - before.1.accepted >= 499);
            assert_eq!(after.1.bad, before.1.bad);
        });
    }
}

/// Bytes without end: the slots continue on time to the tick, the loss of the link is detected, and the link
/// recovers.
#[test]
fn a_babbling_ecu_does_not_put_off_the_keep_alive() {
    let bench = bench_on(Line::new(115_200), Rate::Hz100, 5, |_| {});
    bench.play(LONG, async {
        bench.until(|bench| bench.handle().telemetry().link == LinkState::Up).await;
        Timer::after(Duration::from_secs(2)).await;
        // A status head without end.
        bench.plug.babble(Some(Babble::Repeat(vec![0xF1])));
        bench.plug.record(true);
        Timer::after(Duration::from_secs(5)).await;
        let sent = commands(&bench.plug.take_log());
        assert!(sent.len() >= 499);
        assert!(sent.windows(2).all(|two| two[1].0 - two[0].0 == 10_000_000));
        assert_eq!(bench.handle().telemetry().link, LinkState::Lost);
        bench.plug.babble(None);
        Timer::after(Duration::from_millis(200)).await;
        assert_eq!(bench.handle().telemetry().link, LinkState::Up);
    });
}

/// A transmitter that hangs costs slots, which are counted; reception continues.
#[test]
fn a_hanging_transmitter_does_not_stall_reception() {
    let bench = bench(5);
    let mut events = bench.handle().events().expect("a free place");
    bench.play(LONG, async {
        bench.until(|bench| bench.handle().telemetry().link == LinkState::Up).await;
        bench.plug.stall_tx(true);
        for _ in 0..50 {
            Timer::after(Duration::from_millis(100)).await;
            let age = bench.handle().telemetry().last_rx.expect("received").elapsed();
            assert!(age <= Duration::from_millis(25), "the last frame is {} ms old", age.as_millis());
        }
        let counters = bench.handle().telemetry().counters;
        assert!(counters.write_timeouts >= 50 && counters.send_slots_missed > 0, "{counters:?}");
        assert!(received(&mut events).contains(&Event::NotSent(NotSent::TimedOut)));
        bench.plug.stall_tx(false);
        Timer::after(Duration::from_millis(500)).await;
        let healed = stats(&bench).accepted;
        Timer::after(Duration::from_secs(1)).await;
        assert!((stats(&bench).accepted - healed).abs_diff(50) <= 1);
    });
}

/// ZK-15: an unknown status ID is a frame; its bytes are kept and the link continues.
#[test]
fn zk_15_an_unknown_status_id_is_preserved() {
    let bench = bench_on(Line::new(9600), Rate::Hz50, 5, |ecu| ecu.ids.push(10));
    bench.play(LONG, async { Timer::after(Duration::from_secs(3)).await });
    let telemetry = bench.handle().telemetry();
    assert!(telemetry.counters.unknown_frames >= 10);
    assert_eq!(telemetry.report.unknown.expect("kept").value.as_bytes()[0], 0xFA);
    assert_eq!(telemetry.counters.crc_failures, 0);
}
