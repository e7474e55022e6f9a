//! The table of engines: what is refused before it can fly.

use embassy_time::Duration;
use jetlink::config::{ConfigError, ENGINES, EngineConfig, validate};
use jetlink::ecu::EcuConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::{Line, StopBits};
use jetlink::node::Node;
use jetlink::units::Throttle;

fn amt(port: u8, line: Line) -> EngineConfig {
    EngineConfig::amt("amt", port, line, None)
}

fn zk(port: u8, line: Line, rate: Rate) -> EngineConfig {
    EngineConfig::zk("zk", port, line, rate)
}

#[test]
fn the_table_of_this_aircraft_is_valid() {
    assert_eq!(validate(&ENGINES), Ok(()));
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

#[test]
fn two_engines_on_one_port() {
    let line = Line::new(9600);
    let table = [amt(0, line), zk(1, line, Rate::Hz20), zk(2, line, Rate::Hz20), amt(1, line)];
    assert_eq!(validate(&table), Err(ConfigError::SamePort(1, 3)));
    assert_eq!(validate(&table[..3]), Ok(()));
    assert_eq!(Node::new(&table).err(), Some(ConfigError::SamePort(1, 3)));
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

/// Nothing in the table lasts longer than 60 s.
#[test]
fn times_above_a_minute_are_refused() {
    const MINUTE: Duration = Duration::from_secs(60);
    type Change = fn(&mut EngineConfig, Duration);
    let changes: [(Change, ConfigError); 3] = [
        (|engine, time| engine.timing.lost_after = time, ConfigError::Timing(1)),
        (|engine, time| engine.loss.hold = time, ConfigError::Loss(1)),
        (|engine, time| engine.loss.standby_after = Some(time), ConfigError::Loss(1)),
    ];
    for (change, error) in changes {
        for (time, expected) in [
            (Duration::from_secs(59), Ok(())),
            (MINUTE, Ok(())),
            (Duration::from_ticks(MINUTE.as_ticks() + 1), Err(error)),
            (Duration::MAX, Err(error)),
        ] {
            for engine in [amt(1, Line::new(9600)), zk(1, Line::new(9600), Rate::Hz20)] {
                let mut table = [amt(0, Line::new(9600)), engine];
                change(&mut table[1], time);
                assert_eq!(validate(&table), expected, "{time:?}");
                assert_eq!(Node::new(&table).err(), expected.err());
            }
        }
    }
}

/// Durations without end ("hold for ever") are either refused here or work: they must not panic in flight.
#[test]
fn endless_durations_are_refused_or_work() {
    use embassy_time::Instant;
    use jetlink::engine::Engine;
    let changes: [fn(&mut EngineConfig); 2] =
        [|engine| engine.timing.lost_after = Duration::MAX, |engine| engine.loss.hold = Duration::MAX];
    for change in changes {
        let mut config = zk(0, Line::new(9600), Rate::Hz20);
        change(&mut config);
        if validate(&[config]).is_err() {
            continue;
        }
        let mut engine = Engine::new(&config);
        engine.start(Instant::from_millis(1));
        let standing = [0xF1, 0x00, 0x00, 0x00, 0x00, 0x4C, 0xA0];
        engine.receive(Instant::from_millis(2), &standing);
        for command in [
            jetlink::command::Command::Standby,
            jetlink::command::Command::Run(jetlink::command::Demand::Throttle(Throttle::IDLE)),
        ] {
            engine.command(Instant::from_millis(3), command, jetlink::command::Origin::Rc).unwrap();
            while !matches!(engine.poll(), jetlink::link::Output::Wait(_)) {}
        }
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
        (ConfigError::Timing(4), "engine 4: an engine's link timing"),
        (ConfigError::Loss(5), "engine 5: a stage of an engine's loss"),
    ] {
        assert!(error.to_string().starts_with(text), "{error}");
    }
}
