//! The table of engines: what is refused before it can fly.

use crate::support::bench::at_us;
use crate::support::scenario::{Ecu, SECOND, Scenario, percent, run};
use embassy_time::Duration;
use jetlink::command::Origin;
use jetlink::config::{ConfigError, EngineConfig, check, check_ports, validate};
use jetlink::ecu::amt::config::Mistake as AmtMistake;
use jetlink::ecu::zk::codec::Rate;
use jetlink::ecu::zk::config::Mistake as ZkMistake;
use jetlink::ecu::{EcuConfig, Mistake};
use jetlink::engine::config::Supervision;
use jetlink::event::LossStage;
use jetlink::line::{Line, StopBits};
use jetlink::node::Node;
use jetlink::setting::{OFF, Setting, SettingError, SettingId, Unit};
use jetlink::units::{Celsius, Rpm};

fn amt(port: u8, line: Line) -> EngineConfig {
    EngineConfig::amt("amt", port, line, None)
}

fn zk(port: u8, line: Line, rate: Rate) -> EngineConfig {
    EngineConfig::zk("zk", port, line, rate)
}

/// The number of a setting's row, as errors carry it.
fn setting(name: &str) -> SettingId {
    Supervision::id(name).expect("a setting of the supervision")
}

#[test]
fn an_empty_table_is_valid() {
    assert_eq!(validate(&[]), Ok(()));
}

/// AMT-1, ZK-12: the printed baud rates, and no other (the field's 230 400 among them).
#[test]
fn amt_1_zk_12_only_the_printed_baud_rates_are_valid() {
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
fn amt_1_zk_12_only_a_zk_line_may_have_two_stop_bits() {
    let two = Line::with_two_stop_bits(9600);
    assert_eq!(two.stop_bits, StopBits::Two);
    assert_eq!(validate(&[amt(0, two)]), Err(ConfigError::Ecu(0, Mistake::Amt(AmtMistake::StopBits))));
    assert_eq!(validate(&[zk(0, two, Rate::Hz100)]), Ok(()));
}

/// ZK-11: a status rate that the line cannot carry.
#[test]
fn zk_11_a_rate_that_the_line_cannot_carry_is_refused() {
    for (baud, rate, fits) in [
        (2400, Rate::Hz20, true),
        (2400, Rate::Hz50, false),
        (2400, Rate::Hz100, false),
        (4800, Rate::Hz50, true),
        (4800, Rate::Hz100, false),
        (9600, Rate::Hz100, true),
    ] {
        let expected =
            if fits { Ok(()) } else { Err(ConfigError::Ecu(1, Mistake::Zk(ZkMistake::RateTooFast))) };
        let table = [amt(0, Line::new(2400)), zk(1, Line::new(baud), rate)];
        assert_eq!(validate(&table), expected, "{baud} {rate:?}");
    }
}

/// AMT-11: a guard that leaves no time for a reply.
#[test]
fn amt_11_a_guard_that_leaves_no_time_for_a_reply_is_refused() {
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
        let expected =
            if fits { Ok(()) } else { Err(ConfigError::Ecu(0, Mistake::Amt(AmtMistake::NoReplyFits))) };
        assert_eq!(validate(&[engine]), expected, "{guard}");
    }
}

/// AMT-12: the serial delay time, and the raw shaft speed below which an engine does not run.
#[test]
fn amt_12_serial_delay_and_half_idle_have_ranges() {
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
        let expected =
            if fits { Ok(()) } else { Err(ConfigError::Ecu(1, Mistake::Amt(AmtMistake::Settings))) };
        assert_eq!(validate(&[amt(0, Line::new(2400)), engine]), expected, "{delay_ms} ms, {half_idle}");
    }
}

/// A record belongs to one engine: its protocol, port, name and kind. Every other setting may change without losing it.
#[test]
fn the_fingerprint_identifies_the_engine_and_not_its_settings() {
    use jetlink::ecu::amt::codec::EngineModel;
    let line = Line::new(9600);
    let others = [
        amt(0, line),
        amt(1, line),
        zk(0, line, Rate::Hz20),
        EngineConfig::amt("other", 0, line, None),
        EngineConfig::amt("amt", 0, line, Some(EngineModel::Olympus)),
        EngineConfig::amt("amt", 0, line, Some(EngineModel::Titan)),
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

/// What the compiler prints where `check` stands in a constant (`.ci/tables` reads it there).
#[test]
fn a_mistake_that_does_not_build_names_its_row() {
    let text = |run: &(dyn Fn() + std::panic::RefUnwindSafe)| {
        let panic = std::panic::catch_unwind(run).err()?;
        panic.downcast_ref::<String>().cloned()
    };
    let line = Line::new(9600);
    let table = [amt(0, line), EngineConfig::zk("centre", 4, Line::new(4800), Rate::Hz100)];
    assert_eq!(
        text(&|| check(&table)).as_deref(),
        Some(
            "row 2 of the table of engines, `centre`: the line is too slow for the status rate: 20 Hz needs 2400 \
             baud, 50 Hz 4800, 100 Hz 9600"
        )
    );
    assert_eq!(text(&|| check(&table[..1])), None);
    assert_eq!(
        text(&|| check_ports(&table, 4)).as_deref(),
        Some(
            "row 2 of the table of engines, `centre`: there is no port 4 for an engine: this board has 4, counted \
             from 0"
        )
    );
    assert_eq!(text(&|| check_ports(&table, 5)), None);
    // The twelfth, with a name that leaves no room for what is wrong, cut in the middle of a letter.
    let mut many: Vec<EngineConfig> = (0..12).map(|port| amt(port, line)).collect();
    many[11].name = Box::leak("ü".repeat(200).into_boxed_str());
    many[11].line = Line::new(9601);
    let cut = text(&|| check(&many)).expect("a mistake");
    assert!(cut.starts_with("row 12 of the table of engines, `üü") && cut.ends_with('ü'), "{cut}");
}

#[test]
fn two_engines_on_one_port_are_refused() {
    let line = Line::new(9600);
    let table = [amt(0, line), zk(1, line, Rate::Hz20), zk(2, line, Rate::Hz20), amt(1, line)];
    assert_eq!(validate(&table), Err(ConfigError::SamePort(1, 3)));
    assert_eq!(validate(&table[..3]), Ok(()));
    assert_eq!(Node::new(&table, None).err(), Some(ConfigError::SamePort(1, 3)));
}

#[test]
fn a_link_that_could_never_be_up_is_refused() {
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
    use jetlink::engine::config::Governor;
    use jetlink::limit::Limit;
    type Change = fn(&mut EngineConfig, u64);
    // What is changed, how it is refused, the least and the most of it.
    let changes: [(Change, ConfigError, u64, u64); 29] = {
        let of = |name| ConfigError::Supervision(1, setting(name));
        [
            (|e, t| e.timing.lost_after = Duration::from_millis(t), ConfigError::Timing(1), 200, 60_000),
            (
                |e, t| e.supervision.timeouts.emergency = Duration::from_millis(t),
                of("SRC_EMERG_TOUT"),
                50,
                60_000,
            ),
            (|e, t| e.supervision.timeouts.rc = Duration::from_millis(t), of("SRC_RC_TOUT"), 50, 60_000),
            (
                |e, t| e.supervision.timeouts.mavlink = Duration::from_millis(t),
                of("SRC_MAV_TOUT"),
                50,
                60_000,
            ),
            (
                |e, t| e.supervision.timeouts.bench = Duration::from_millis(t),
                of("SRC_BENCH_TOUT"),
                50,
                60_000,
            ),
            (|e, t| e.supervision.recover_after = Duration::from_millis(t), of("SRC_RECOVER"), 100, 60_000),
            (|e, t| e.supervision.takeover.within = Duration::from_millis(t), of("TKO_WAIT"), 0, 60_000),
            (|e, t| e.supervision.loss.hold = Duration::from_millis(t), of("LOSS_HOLD"), 0, 60_000),
            (
                |e, t| e.supervision.loss.standby_after = Some(Duration::from_millis(t)),
                of("LOSS_STANDBY"),
                0,
                3_600_000,
            ),
            (|e, n| e.supervision.loss.ramp = n as u16, of("LOSS_RAMP"), 10, 65_535),
            (|e, t| e.supervision.start.link_stable = Duration::from_millis(t), of("START_LINK"), 0, 60_000),
            (
                |e, t| e.supervision.start.timeout = Duration::from_millis(t),
                of("START_TIMEOUT"),
                5_000,
                600_000,
            ),
            (|e, t| e.supervision.start.gap = Duration::from_millis(t), of("START_GAP"), 0, 600_000),
            (|e, n| e.supervision.slew.up = Some(n as u16), of("SLEW_UP"), 10, 65_535),
            (|e, n| e.supervision.slew.down = Some(n as u16), of("SLEW_DOWN"), 10, 65_535),
            (|e, n| e.supervision.limits.hot_start = Limit::report(n as u16), of("LIM_HOT"), 10, 65_535),
            (|e, n| e.supervision.limits.implausible = Limit::report(n as u32), of("LIM_JUMP"), 1000, 65_535),
            (
                |e, n| {
                    let proportional = n as u16;
                    e.supervision.governor = Some(Governor { proportional, ..Governor::DEFAULT });
                },
                of("GOV_P"),
                1,
                100,
            ),
            (
                |e, n| e.supervision.governor = Some(Governor { integral: n as u16, ..Governor::DEFAULT }),
                of("GOV_I"),
                0,
                100,
            ),
            (|e, n| e.supervision.limits.flame_out = Limit::report(n as u8), of("LIM_FLAME"), 5, 95),
            (
                |e, n| e.supervision.governor = Some(Governor { slew: n as u16, ..Governor::DEFAULT }),
                of("GOV_SLEW"),
                10,
                1000,
            ),
            (
                |e, t| {
                    let max_age = Duration::from_millis(t);
                    e.supervision.governor = Some(Governor { max_age, ..Governor::DEFAULT });
                },
                of("GOV_RPM_AGE"),
                200,
                5_000,
            ),
            (|e, n| e.supervision.when_other_fails = Some(n as u16), of("OTHER_FAILS"), 0, 1000),
            (|e, t| e.supervision.return_within = Duration::from_millis(t), of("SRC_RETURN"), 0, 10_000),
            (
                |e, t| e.supervision.loss.lower_standby_after = Duration::from_millis(t),
                of("LOSS_LOW_STBY"),
                0,
                3_600_000,
            ),
            (|e, n| e.supervision.rise = n as u16, of("RISE"), 10, 65_535),
            (
                |e, t| e.supervision.burning_egt = Celsius::from_tenths(t as i16),
                of("BURNING_EGT"),
                1000,
                6000,
            ),
            (|e, t| e.supervision.service_time = Duration::from_millis(t), of("SERVICE_TIME"), 1000, 300_000),
            (
                |e, n| {
                    let max_rpm = Rpm::new(n as u32);
                    e.supervision.governor = Some(Governor { max_rpm, ..Governor::DEFAULT });
                },
                of("GOV_RPM_MAX"),
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
        (|e| e.supervision.loss.hold = Duration::MAX, ConfigError::Supervision(0, setting("LOSS_HOLD"))),
        (|e| e.supervision.timeouts.rc = Duration::MAX, ConfigError::Supervision(0, setting("SRC_RC_TOUT"))),
        (
            |e| e.supervision.service_time = Duration::MAX,
            ConfigError::Supervision(0, setting("SERVICE_TIME")),
        ),
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
        (ConfigError::BaudRate(2), "row 3 of the table of engines: invalid baud rate: use 2400, 4800"),
        (ConfigError::SamePort(0, 3), "row 4 of the table of engines: two engines on one port"),
        (
            ConfigError::Ecu(1, Mistake::Zk(ZkMistake::RateTooFast)),
            "row 2 of the table of engines: the line is too slow for the status rate",
        ),
        (
            ConfigError::Ecu(0, Mistake::Amt(AmtMistake::StopBits)),
            "row 1 of the table of engines: invalid stop bits",
        ),
        (
            ConfigError::Ecu(1, Mistake::Amt(AmtMistake::NoReplyFits)),
            "row 2 of the table of engines: the reply guard",
        ),
        (
            ConfigError::Ecu(3, Mistake::Amt(AmtMistake::Settings)),
            "row 4 of the table of engines: invalid AMT settings: use a serial delay of",
        ),
        (ConfigError::Timing(4), "row 5 of the table of engines: invalid link settings"),
        (
            ConfigError::Supervision(5, setting("LOSS_HOLD")),
            "row 6 of the table of engines: loss.hold: 0 to 60000",
        ),
    ] {
        assert!(error.to_string().starts_with(text), "{error}");
    }
}

// -----------------------------------------------------------------------------------------------
// The table of settings
// -----------------------------------------------------------------------------------------------

fn both() -> [EngineConfig; 2] {
    [amt(0, Line::new(9600)), zk(1, Line::new(9600), Rate::Hz20)]
}

/// A default that its table names is the default of the configuration. What a protocol has other defaults of is excepted.
#[test]
fn settings_have_the_defaults_that_the_table_names() {
    for config in both() {
        for setting in config.settings() {
            let of_protocol = config.number("AMT_GUARD").is_some() && setting.name.starts_with("LINK_");
            if !of_protocol {
                assert_eq!(config.number(setting.name), Some(setting.default), "{}", setting.name);
            }
            assert!(setting.allows(setting.default), "{}", setting.name);
        }
    }
}

#[test]
fn names_of_settings_are_unique_and_fit_a_parameter() {
    for config in both() {
        let mut names: Vec<&str> = config.settings().map(|setting| setting.name).collect();
        let count = names.len();
        assert!(count > 50);
        for name in &names {
            assert!(
                name.len() <= 16
                    && name.bytes().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit() || b == b'_'),
                "{name}"
            );
        }
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
    }
}

/// Each setting changes by its name, to both ends of its range and to off, and to nothing outside.
#[test]
fn settings_change_within_their_range() {
    for config in both() {
        let mut config = config;
        config.set("GOV_ENABLE", 1).unwrap();
        for setting in config.settings().collect::<Vec<_>>() {
            let before = config;
            for number in [setting.min, setting.max] {
                config.set(setting.name, number).unwrap();
                assert_eq!(config.number(setting.name), Some(number), "{}", setting.name);
            }
            for wrong in [setting.min.checked_sub(2), setting.max.checked_add(1)].into_iter().flatten() {
                let now = config;
                assert_eq!(
                    config.set(setting.name, wrong),
                    Err(SettingError::OutOfRange(setting)),
                    "{}",
                    setting.name
                );
                assert_eq!(config, now);
            }
            let off = config.set(setting.name, OFF);
            assert_eq!(off.is_ok(), setting.allows(OFF), "{}", setting.name);
            config = before;
        }
    }
    let mut config = both()[0];
    assert_eq!(config.set("NO_SUCH", 1), Err(SettingError::Unknown));
    assert_eq!(config.set("ZK_SPLIT_SWITCH", 1), Err(SettingError::Unknown), "of the other protocol");
    let off = config.set("GOV_P", 1);
    assert!(matches!(off, Err(SettingError::Off(setting)) if setting.name == "GOV_P"), "{off:?}");
}

/// Settings given to a running engine hold from then on, and a wrong one changes nothing.
#[test]
fn settings_of_a_running_engine_can_be_changed() {
    let mut scenario = Scenario::started(Ecu::Zk, percent(50));
    scenario.fly_us(run(50), Origin::Rc, SECOND);
    let mut settings = Ecu::Zk.config().supervision;
    // Of 0.5 s: silence longer than that is no loss any more.
    settings.timeouts.rc = Duration::from_secs(10);
    let now = scenario.now_us();
    scenario.bench.act(|engine, _| engine.configure(at_us(now), &settings)).unwrap();
    scenario.fly_us(run(50), Origin::Rc, SECOND);
    scenario.pass_us(5 * SECOND);
    assert_eq!(scenario.telemetry().loss, LossStage::None);
    settings.timeouts.rc = Duration::from_secs(61);
    let refused = scenario.bench.act(|engine, _| engine.configure(at_us(now), &settings));
    assert_eq!(refused, Err(setting("SRC_RC_TOUT")));
    assert_eq!(Supervision::row(setting("SRC_RC_TOUT")).field, "timeouts.rc");
    scenario.pass_us(4 * SECOND);
    assert_eq!(scenario.telemetry().loss, LossStage::None);
    scenario.pass_us(3 * SECOND);
    assert_ne!(scenario.telemetry().loss, LossStage::None);
}

/// The tables of docs/failsafe.md are made from the table of settings. `JETLINK_WRITE=1` writes them.
#[test]
fn docs_have_the_table_of_settings() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/failsafe.md");
    let text = std::fs::read_to_string(path).unwrap();
    let (begin, end) = (
        "<!-- settings: made from the library, JETLINK_WRITE=1 cargo test -p jetlink docs_have -->\n",
        "<!-- settings end -->\n",
    );
    let (before, rest) = text.split_once(begin).expect("the page marks its table");
    let (found, after) = rest.split_once(end).expect("the page marks the table's end");
    let mut rows: Vec<&Setting> = Vec::new();
    for config in both() {
        for setting in config.settings() {
            if !rows.iter().any(|row| row.name == setting.name) {
                rows.push(setting);
            }
        }
    }
    let mut table = String::from("| setting | field | default | range | what |\n|---|---|---|---|---|\n");
    for row in rows {
        let number = |number: i32| {
            if number == OFF && row.may_be_off { "off".to_string() } else { number.to_string() }
        };
        let off = if row.may_be_off { ", or off" } else { "" };
        let (default, range) = match row.unit {
            Unit::YesNo | Unit::Action => (number(row.default), row.symbol.to_string()),
            _ => {
                let default = number(row.default);
                let default = if default == "off" { default } else { format!("{default} {}", row.symbol) };
                (default, format!("{} to {} {}{off}", row.min, row.max, row.symbol))
            }
        };
        table += &format!("| `{}` | `{}` | {default} | {range} | {} |\n", row.name, row.field, row.text);
    }
    if std::env::var_os("JETLINK_WRITE").is_some() {
        std::fs::write(path, format!("{before}{begin}{table}{end}{after}")).unwrap();
    } else {
        assert_eq!(found, table, "write it anew with JETLINK_WRITE=1");
    }
}
