//! The table of engines: what is refused before it can fly.

use embassy_time::Duration;
use jetlink::config::{ConfigError, EngineConfig, validate};
use jetlink::ecu::EcuConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::{Line, StopBits};
use jetlink::node::Node;
use jetlink::units::{Celsius, Rpm};

fn amt(port: u8, line: Line) -> EngineConfig {
    EngineConfig::amt("amt", port, line, None)
}

fn zk(port: u8, line: Line, rate: Rate) -> EngineConfig {
    EngineConfig::zk("zk", port, line, rate)
}

#[test]
fn an_empty_table_is_valid() {
    assert_eq!(validate(&[]), Ok(()));
}

/// AMT-1, ZK-12: the printed baud rates, and no other (the field's 230 400 among them).
#[test]
fn amt_1_zk_12_baud_rates() {
    for baud in Line::BAUD_RATES {
        assert_eq!(
            validate(&[amt(0, Line::new(baud)), zk(1, Line::new(baud), Rate::Hz20)]),
            Ok(()),
            "{baud}"
        );
    }
    for baud in [0, 1, 1200, 2401, 14_400, 230_400, u32::MAX] {
        assert_eq!(validate(&[amt(0, Line::new(baud))]), Err(ConfigError::BaudRate(0)), "{baud}");
        assert_eq!(validate(&[zk(0, Line::new(baud), Rate::Hz20)]), Err(ConfigError::BaudRate(0)), "{baud}");
    }
}

/// AMT-1: an AMT line has one stop bit. ZK-12: a ZK line has one or two.
#[test]
fn amt_1_zk_12_stop_bits() {
    let two = Line::with_two_stop_bits(9600);
    assert_eq!(two.stop_bits, StopBits::Two);
    assert_eq!(validate(&[amt(0, two)]), Err(ConfigError::AmtStopBits(0)));
    assert_eq!(validate(&[zk(0, two, Rate::Hz100)]), Ok(()));
}

/// ZK-11: a status rate that the line cannot carry.
#[test]
fn zk_11_rate_and_line() {
    for (baud, rate, fits) in [
        (2400, Rate::Hz20, true),
        (2400, Rate::Hz50, false),
        (2400, Rate::Hz100, false),
        (4800, Rate::Hz50, true),
        (4800, Rate::Hz100, false),
        (9600, Rate::Hz100, true),
    ] {
        let expected = if fits { Ok(()) } else { Err(ConfigError::RateTooFast(1)) };
        let table = [amt(0, Line::new(2400)), zk(1, Line::new(baud), rate)];
        assert_eq!(validate(&table), expected, "{baud} {rate:?}");
    }
}

/// AMT-11: a guard that leaves no time for a reply.
#[test]
fn amt_11_guard_and_window() {
    // At 2400 baud five bytes take 20.834 ms of the 30.
    for (guard, fits) in [
        (0, true),
        (500, true),
        (9_165, true),
        (9_166, false),
        (30_000, false),
        (1_000_000, false),
        (1_000_000_000_000, false),
    ] {
        let mut engine = amt(0, Line::new(2400));
        let EcuConfig::Amt(config) = &mut engine.ecu else { panic!("AMT") };
        config.reply_guard = Duration::from_micros(guard);
        let expected = if fits { Ok(()) } else { Err(ConfigError::NoReplyFits(0)) };
        assert_eq!(validate(&[engine]), expected, "{guard}");
    }
}

/// AMT-12: the serial delay time, and the raw shaft speed below which an engine does not run.
#[test]
fn amt_12_serial_delay_and_half_idle() {
    for (delay_ms, half_idle, fits) in [
        (499, 20, false),
        (500, 20, true),
        (60_000, 20, true),
        (60_001, 20, false),
        (4_000, 0, false),
        (4_000, 1, true),
        (4_000, 254, true),
        (4_000, 255, false),
    ] {
        let mut engine = amt(1, Line::new(2400));
        let EcuConfig::Amt(config) = &mut engine.ecu else { panic!("AMT") };
        (config.serial_delay, config.half_idle) = (Duration::from_millis(delay_ms), half_idle);
        let expected = if fits { Ok(()) } else { Err(ConfigError::AmtEngine(1)) };
        assert_eq!(validate(&[amt(0, Line::new(2400)), engine]), expected, "{delay_ms} ms, {half_idle}");
    }
}

/// A record belongs to one engine: its protocol, port, name and kind. Every other setting may change without losing it.
#[test]
fn the_fingerprint_is_of_the_engine_and_not_of_its_settings() {
    use jetlink::ecu::amt::codec::Engine;
    let line = Line::new(9600);
    let others = [
        amt(0, line),
        amt(1, line),
        zk(0, line, Rate::Hz20),
        EngineConfig::amt("other", 0, line, None),
        EngineConfig::amt("amt", 0, line, Some(Engine::Olympus)),
        EngineConfig::amt("amt", 0, line, Some(Engine::Titan)),
    ];
    for (i, one) in others.iter().enumerate() {
        for (j, other) in others.iter().enumerate() {
            assert_eq!(one.fingerprint() == other.fingerprint(), i == j, "{one:?} and {other:?}");
        }
    }
    type Change = fn(&mut EngineConfig);
    for change in [
        (|e| e.line = Line::new(2400)) as Change,
        |e| e.timing.lost_after = Duration::from_secs(2),
        |e| e.supervision.loss.hold = Duration::from_secs(5),
        |e| e.supervision.start.arming = false,
        |e| e.supervision.rise = 100,
    ] {
        for engine in [amt(0, line), zk(0, line, Rate::Hz20)] {
            let mut changed = engine;
            change(&mut changed);
            assert_ne!(changed, engine);
            assert_eq!(changed.fingerprint(), engine.fingerprint());
        }
    }
}

#[test]
fn two_engines_on_one_port() {
    let line = Line::new(9600);
    let table = [amt(0, line), zk(1, line, Rate::Hz20), zk(2, line, Rate::Hz20), amt(1, line)];
    assert_eq!(validate(&table), Err(ConfigError::SamePort(1, 3)));
    assert_eq!(validate(&table[..3]), Ok(()));
    assert_eq!(Node::new(&table, None).err(), Some(ConfigError::SamePort(1, 3)));
}

#[test]
fn a_link_that_could_never_be_up() {
    let mut never_up = amt(0, Line::new(2400));
    never_up.timing.up_after = 0;
    let mut lost_at_once = amt(0, Line::new(2400));
    lost_at_once.timing.lost_after = Duration::from_ticks(0);
    for engine in [never_up, lost_at_once] {
        assert_eq!(validate(&[engine]), Err(ConfigError::Timing(0)));
    }
}

/// Every duration and rate of the table has a range, and its ends are inside. Durations without end ("hold for ever")
/// would overflow in flight.
#[test]
fn every_field_has_a_range() {
    use jetlink::engine::config::{Field, Governor, Limit};
    type Change = fn(&mut EngineConfig, u64);
    // What is changed, how it is refused, the least and the most of it.
    let changes: [(Change, ConfigError, u64, u64); 29] = {
        let of = |field| ConfigError::Supervision(1, field);
        [
            (|e, t| e.timing.lost_after = Duration::from_millis(t), ConfigError::Timing(1), 200, 60_000),
            (
                |e, t| e.supervision.ages.emergency = Duration::from_millis(t),
                of(Field::AgeEmergency),
                50,
                60_000,
            ),
            (|e, t| e.supervision.ages.rc = Duration::from_millis(t), of(Field::AgeRc), 50, 60_000),
            (|e, t| e.supervision.ages.mavlink = Duration::from_millis(t), of(Field::AgeMavlink), 50, 60_000),
            (|e, t| e.supervision.ages.bench = Duration::from_millis(t), of(Field::AgeBench), 50, 60_000),
            (
                |e, t| e.supervision.recover_after = Duration::from_millis(t),
                of(Field::RecoverAfter),
                100,
                60_000,
            ),
            (
                |e, t| e.supervision.takeover.within = Duration::from_millis(t),
                of(Field::TakeoverWithin),
                0,
                60_000,
            ),
            (|e, t| e.supervision.loss.hold = Duration::from_millis(t), of(Field::LossHold), 0, 60_000),
            (
                |e, t| e.supervision.loss.standby_after = Some(Duration::from_millis(t)),
                of(Field::LossStandby),
                0,
                3_600_000,
            ),
            (|e, n| e.supervision.loss.ramp = n as u16, of(Field::LossRamp), 10, 65_535),
            (
                |e, t| e.supervision.start.link_stable = Duration::from_millis(t),
                of(Field::LinkStable),
                0,
                60_000,
            ),
            (
                |e, t| e.supervision.start.timeout = Duration::from_millis(t),
                of(Field::StartTimeout),
                5_000,
                600_000,
            ),
            (|e, t| e.supervision.start.gap = Duration::from_millis(t), of(Field::StartGap), 0, 600_000),
            (|e, n| e.supervision.slew.up = Some(n as u16), of(Field::SlewUp), 10, 65_535),
            (|e, n| e.supervision.slew.down = Some(n as u16), of(Field::SlewDown), 10, 65_535),
            (|e, n| e.supervision.limits.hot_start = Limit::tell(n as u16), of(Field::HotStart), 10, 65_535),
            (
                |e, n| e.supervision.limits.implausible = Limit::tell(n as u32),
                of(Field::Implausible),
                1000,
                65_535,
            ),
            (
                |e, n| {
                    let proportional = n as u16;
                    e.supervision.governor = Some(Governor { proportional, ..Governor::DEFAULT });
                },
                of(Field::GovernorProportional),
                1,
                100,
            ),
            (
                |e, n| e.supervision.governor = Some(Governor { integral: n as u16, ..Governor::DEFAULT }),
                of(Field::GovernorIntegral),
                0,
                100,
            ),
            (|e, n| e.supervision.limits.flame_out = Limit::tell(n as u8), of(Field::FlameOut), 5, 95),
            (
                |e, n| e.supervision.governor = Some(Governor { slew: n as u16, ..Governor::DEFAULT }),
                of(Field::GovernorSlew),
                10,
                1000,
            ),
            (
                |e, t| {
                    let max_age = Duration::from_millis(t);
                    e.supervision.governor = Some(Governor { max_age, ..Governor::DEFAULT });
                },
                of(Field::GovernorMaxAge),
                200,
                5_000,
            ),
            (|e, n| e.supervision.when_other_fails = Some(n as u16), of(Field::WhenOtherFails), 0, 1000),
            (
                |e, t| e.supervision.return_within = Duration::from_millis(t),
                of(Field::ReturnWithin),
                0,
                10_000,
            ),
            (
                |e, t| e.supervision.loss.lower_standby_after = Duration::from_millis(t),
                of(Field::LossLowerStandby),
                0,
                3_600_000,
            ),
            (|e, n| e.supervision.rise = n as u16, of(Field::Rise), 10, 65_535),
            (
                |e, t| e.supervision.burning_egt = Celsius::from_tenths(t as i16),
                of(Field::BurningEgt),
                1000,
                6000,
            ),
            (
                |e, t| e.supervision.service_time = Duration::from_millis(t),
                of(Field::ServiceTime),
                1000,
                300_000,
            ),
            (
                |e, n| {
                    let max_rpm = Rpm::new(n as u32);
                    e.supervision.governor = Some(Governor { max_rpm, ..Governor::DEFAULT });
                },
                of(Field::GovernorMaxRpm),
                10_000,
                250_000,
            ),
        ]
    };
    for (i, (change, error, least, most)) in changes.into_iter().enumerate() {
        let check = |value: u64, expected: Result<(), ConfigError>| {
            for engine in [amt(1, Line::new(9600)), zk(1, Line::new(9600), Rate::Hz20)] {
                let mut table = [amt(0, Line::new(9600)), engine];
                change(&mut table[1], value);
                assert_eq!(validate(&table), expected, "change {i}: {value}");
                assert_eq!(Node::new(&table, None).err(), expected.err());
            }
        };
        check(least, Ok(()));
        check(most, Ok(()));
        if least > 0 {
            check(least - 1, Err(error));
        }
        if most != 65_535 {
            check(most + 1, Err(error));
        }
    }
    for (change, error) in [
        ((|e| e.timing.lost_after = Duration::MAX) as fn(&mut EngineConfig), ConfigError::Timing(0)),
        (|e| e.supervision.loss.hold = Duration::MAX, ConfigError::Supervision(0, Field::LossHold)),
        (|e| e.supervision.ages.rc = Duration::MAX, ConfigError::Supervision(0, Field::AgeRc)),
        (|e| e.supervision.service_time = Duration::MAX, ConfigError::Supervision(0, Field::ServiceTime)),
    ] {
        let mut engine = amt(0, Line::new(9600));
        change(&mut engine);
        assert_eq!(validate(&[engine]), Err(error));
    }
}

/// Whoever reads the message knows which row, and what to do.
#[test]
fn errors_name_their_row() {
    for (error, text) in [
        (ConfigError::BaudRate(2), "engine 2: an engine's baud rate is none of"),
        (ConfigError::SamePort(0, 3), "engine 3: two engines sit on one port"),
        (ConfigError::RateTooFast(1), "engine 1: an engine's status rate does not fit"),
        (ConfigError::AmtStopBits(0), "engine 0: an AMT line has one stop bit"),
        (ConfigError::NoReplyFits(1), "engine 1: an engine's reply guard"),
        (ConfigError::AmtEngine(3), "engine 3: an AMT engine has a serial delay of"),
        (ConfigError::Timing(4), "engine 4: an engine's link needs"),
        (
            ConfigError::Supervision(5, jetlink::engine::config::Field::LossHold),
            "engine 5: loss.hold: at most",
        ),
    ] {
        assert!(error.to_string().starts_with(text), "{error}");
    }
}
