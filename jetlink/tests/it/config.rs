//! The table of engines: mistakes that are refused before a flight.

use crate::support::frames::zk as zk_frames;
use crate::support::scenario::{Ecu, Reports, SECOND, Scenario, Wire, percent, run};
use bench::by_hand::at_us;
use embassy_time::Duration;
use jetlink::command::Origin;
use jetlink::config::{
    ConfigError, EngineConfig, LinkSettings, LinkSettingsError, check, check_ports, validate,
};
use jetlink::ecu::amt::config::{Config as AmtConfig, Mistake as AmtMistake};
use jetlink::ecu::zk::codec::Rate;
use jetlink::ecu::zk::config::Mistake as ZkMistake;
use jetlink::ecu::{EcuConfig, Mistake};
use jetlink::engine::config::Supervision;
use jetlink::event::LossStage;
use jetlink::line::{Line, StopBits};
use jetlink::node::Node;
use jetlink::report::LinkState;
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

/// The number of the row of `timing.lost_after`: errors carry the number of the second row of its table.
fn lost_after() -> SettingId {
    let mut engine = amt(0, Line::new(2400));
    engine.timing.lost_after = Duration::from_ticks(0);
    match validate(&[engine]) {
        Err(error @ ConfigError::Timing(0, id)) => {
            assert_eq!(error.message(), "timing.lost_after: 200 to 60000 ms");
            id
        }
        other => panic!("{other:?}"),
    }
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
        let expected = if fits {
            None
        } else if half_idle == 20 {
            Some("ecu.serial_delay: 500 to 60000 ms")
        } else {
            Some("ecu.half_idle: 1 to 254 as the ECU sends it")
        };
        let found = validate(&[amt(0, Line::new(2400)), engine]).err();
        assert_eq!(found.map(ConfigError::message), expected, "{delay_ms} ms, {half_idle}");
        assert!(
            found.is_none_or(|found| matches!(
                found,
                ConfigError::Ecu(1, Mistake::Amt(AmtMistake::Setting(_)))
            ))
        );
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

/// The compiler's message when `check` is in a constant (`.ci/tables` reads it there).
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
    // The twelfth, with a name that leaves no room for the reason and is cut in the middle of a letter.
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
    for (engine, text) in [
        (never_up, "row 1 of the table of engines: timing.up_after: 1 to 255 frames"),
        (lost_at_once, "row 1 of the table of engines: timing.lost_after: 200 to 60000 ms"),
    ] {
        assert_eq!(validate(&[engine]).unwrap_err().to_string(), text);
    }
}

/// Every duration and rate of the table has a range, and its ends are inside. Durations without end ("hold forever")
/// would overflow in flight.
#[test]
fn every_field_has_a_range() {
    use jetlink::engine::config::Governor;
    use jetlink::limit::Limit;
    type Change = fn(&mut EngineConfig, u64);
    // The change, its error, its lowest and its highest value.
    let changes: [(Change, ConfigError, u64, u64); 29] = {
        let of = |name| ConfigError::Supervision(1, setting(name));
        [
            (
                |e, t| e.timing.lost_after = Duration::from_millis(t),
                ConfigError::Timing(1, lost_after()),
                200,
                60_000,
            ),
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
        (
            (|e| e.timing.lost_after = Duration::MAX) as fn(&mut EngineConfig),
            ConfigError::Timing(0, lost_after()),
        ),
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

/// The message names the row, and what to do.
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
            ConfigError::Timing(4, lost_after()),
            "row 5 of the table of engines: timing.lost_after: 200 to 60000 ms",
        ),
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

/// A default that its table names is the default of the configuration.
#[test]
fn settings_have_the_defaults_that_the_table_names() {
    for config in both() {
        for setting in config.settings() {
            assert_eq!(config.number(setting.name), Some(setting.default), "{}", setting.name);
            assert!(setting.allows(setting.default), "{}", setting.name);
            // The message has the unit's symbol from a macro, because `concat!` takes literals only.
            assert!(setting.message.ends_with(setting.unit.symbol()), "{}", setting.message);
        }
        for (setting, row) in config.settings().zip(config.rows()) {
            let of_setting = (setting.name, setting.min, setting.max, setting.may_be_off, setting.effect);
            let name = if setting.parameter { row.name } else { setting.name };
            assert_eq!(of_setting, (name, row.min, row.max, row.may_be_off, row.effect));
            assert_eq!(setting.parameter, row.is_parameter(), "{}", setting.name);
            // A setting that is not a parameter has no value and cannot be changed as one.
            let value = setting.parameter.then_some(setting.default);
            assert_eq!(config.parameter(setting.name), value, "{}", setting.name);
            let mut changed = config;
            assert_eq!(changed.change_parameter(setting.name, setting.max), setting.parameter);
            let expected = if setting.parameter { setting.max } else { setting.default };
            assert_eq!(changed.number(setting.name), Some(expected), "{}", setting.name);
        }
    }
    let [amt, zk] =
        both().map(|config| ["LINK_UP_AFTER", "LINK_LOST"].map(|name| config.number(name).unwrap()));
    assert_eq!((amt, zk), ([2, 1000], [1, 500]), "each protocol has its own");
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

/// −0.1 °C has the number of "off", and is not a valid limit.
#[test]
fn a_value_with_the_number_of_off_is_out_of_range() {
    for (tenths, good) in [(-1, false), (0, true), (8000, true)] {
        let mut rules = Supervision::DEFAULT;
        rules.limits.over_temperature.at = Some(Celsius::from_tenths(tenths));
        assert_eq!(rules.validate().is_ok(), good, "{tenths}");
    }
}

/// A change without a range check does not overflow: it takes the closest value that the type can hold.
#[test]
fn an_unchecked_change_takes_the_closest_value() {
    for (name, number, closest) in [
        ("LOSS_HOLD", -5, 0),
        ("LOSS_RAMP", 70_000, 65_535),
        ("LOSS_THR", 2000, 1000),
        ("START_EGT", -40_000, -32_768),
    ] {
        let mut config = Ecu::Zk.config();
        assert!(config.change(name, number));
        assert_eq!(config.number(name), Some(closest), "{name}");
    }
}

/// Each setting can be changed by its name to both ends of its range and to off, but not beyond.
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
    // It was 0.5 s: longer silence is no longer a loss.
    settings.timeouts.rc = Duration::from_secs(10);
    let now = scenario.now_us();
    scenario.bench.act(|engine, _| engine.configure(at_us(now), &settings)).unwrap();
    scenario.fly_us(run(50), Origin::Rc, SECOND);
    scenario.pass_us(5 * SECOND);
    assert_eq!(scenario.telemetry().loss, LossStage::None);
    settings.timeouts.rc = Duration::from_secs(61);
    let refused = scenario.bench.act(|engine, _| engine.configure(at_us(now), &settings));
    let refused = refused.unwrap_err();
    assert_eq!(refused.setting, setting("SRC_RC_TOUT"));
    assert_eq!(refused.to_string(), Supervision::row(refused.setting).message);
    assert_eq!(Supervision::row(setting("SRC_RC_TOUT")).field, "timeouts.rc");
    scenario.pass_us(4 * SECOND);
    assert_eq!(scenario.telemetry().loss, LossStage::None);
    scenario.pass_us(3 * SECOND);
    assert_ne!(scenario.telemetry().loss, LossStage::None);
}

fn give(scenario: &mut Scenario, config: &EngineConfig) -> Result<(), LinkSettingsError> {
    let (now, settings) = (at_us(scenario.now_us()), LinkSettings::from(config));
    scenario.bench.act(|engine, _| engine.configure_link(now, &settings))
}

/// State of the link after this silence of the ECU.
fn link_after_silence(scenario: &Scenario, millis: u64) -> LinkState {
    let mut scenario = scenario.clone();
    scenario.silent().pass_us(millis * 1000);
    scenario.telemetry().link
}

/// Settings of a link wait while the engine runs and cools, and take effect when it is at rest, before its next start.
#[test]
fn settings_of_a_link_take_effect_when_the_engine_is_at_rest() {
    for (ecu, lost_after_ms) in [(Ecu::Amt, 1000), (Ecu::Zk, 500)] {
        let mut scenario = Scenario::started(ecu, percent(50));
        let mut config = ecu.config();
        config.timing.lost_after = Duration::from_secs(3);
        give(&mut scenario, &config).unwrap();
        for reports in [Reports::Running, Reports::Cooling] {
            if reports == Reports::Cooling {
                scenario.shut_down().unwrap();
            } else {
                scenario.fly_us(run(50), Origin::Rc, SECOND);
            }
            scenario.reports(reports);
            assert!(scenario.bench.machine.link_settings_wait(), "{ecu:?} {reports:?}");
            assert_eq!(
                link_after_silence(&scenario, lost_after_ms + 100),
                LinkState::Lost,
                "{ecu:?} {reports:?}"
            );
        }
        scenario.reports(Reports::Standby);
        assert!(!scenario.bench.machine.link_settings_wait(), "{ecu:?}");
        // The link is the same one: it stays up, and what the ECU has reported stays known.
        assert_eq!(scenario.telemetry().link, LinkState::Up);
        assert_eq!(link_after_silence(&scenario, 2900), LinkState::Up, "{ecu:?}");
        assert_eq!(link_after_silence(&scenario, 3100), LinkState::Lost, "{ecu:?}");
    }
}

/// AMT-14: a start throttle set at rest is sent at the next start.
#[test]
fn settings_of_a_protocol_count_for_the_next_start() {
    let mut scenario = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
    let mut config = Ecu::Amt.config();
    config.set("AMT_START_THR", 120).unwrap();
    give(&mut scenario, &config).unwrap();
    assert!(!scenario.bench.machine.link_settings_wait(), "at rest: at once");
    scenario.command(run(0)).unwrap();
    assert_eq!(scenario.reports(Reports::Starting).wire(), Wire::Run(120));
}

/// ZK-11: another status rate is ordered when the engine is at rest. A rate set by a service command stays if the setting does
/// not change.
#[test]
fn zk_11_a_rate_of_settings_is_ordered_at_rest() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    let rate = zk_frames::action;
    let ordered = |scenario: &mut Scenario, frame: [u8; 4]| {
        scenario.bench.frames();
        scenario.pass_us(SECOND);
        scenario.bench.bytes().contains(&frame.to_vec())
    };
    let mut config = Ecu::Zk.config();
    config.set("ZK_SPLIT_SWITCH", 1).unwrap();
    give(&mut scenario, &config).unwrap();
    assert!(!ordered(&mut scenario, rate(7)), "20 Hz as before");
    let EcuConfig::Zk(zk) = &mut config.ecu else { panic!("ZK") };
    zk.rate = Rate::Hz50;
    give(&mut scenario, &config).unwrap();
    assert!(ordered(&mut scenario, rate(8)), "50 Hz");
}

/// ZK-9: settings given at rest switch mode 2 on: from then on standby is also sent in ID 6.
#[test]
fn zk_9_mode_2_of_settings_is_used_at_rest() {
    for (split, by_id6) in [(0, false), (1, true)] {
        let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
        let mut config = Ecu::Zk.config();
        config.set("ZK_SPLIT_SWITCH", split).unwrap();
        give(&mut scenario, &config).unwrap();
        scenario.bench.frames();
        scenario.pass_us(SECOND);
        let frames = scenario.bench.bytes();
        assert_eq!(frames.contains(&zk_frames::mode(0, 2).to_vec()), by_id6, "{split}: {frames:02x?}");
    }
}

#[test]
fn wrong_settings_of_a_link_change_nothing() {
    let mut scenario = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
    let right = Ecu::Amt.config();
    type Change = fn(&mut EngineConfig);
    for (change, text) in [
        (
            (|e| e.timing.lost_after = Duration::from_millis(199)) as Change,
            "timing.lost_after: 200 to 60000 ms",
        ),
        (|e| assert!(e.change("AMT_HALF_IDLE", 0)), "ecu.half_idle: 1 to 254 as the ECU sends it"),
        // Allowed by its range, but not on every line.
        (|e| e.set("AMT_GUARD", 30_000).unwrap(), "the reply guard leaves no time"),
        (|e| e.ecu = Ecu::Zk.config().ecu, "another protocol or engine"),
        (|e| e.ecu = EcuConfig::Amt(AmtConfig::DEFAULT), "another protocol or engine"),
    ] {
        let mut wrong = right;
        change(&mut wrong);
        let refused = give(&mut scenario, &wrong).unwrap_err().to_string();
        assert!(refused.starts_with(text), "{refused}");
        assert!(!scenario.bench.machine.link_settings_wait());
    }
    assert_eq!(give(&mut scenario, &right), Ok(()));
}

/// The tables of docs/failsafe.md are made from the table of settings. `JETLINK_WRITE=1` writes them.
#[test]
fn docs_have_the_table_of_settings() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/failsafe.md");
    let (begin, end) = (
        "<!-- settings: made from the library, JETLINK_WRITE=1 cargo test -p jetlink docs_have -->\n",
        "<!-- settings end -->\n",
    );
    // Rows of one name, in each protocol that has it.
    let mut rows: Vec<Vec<(&str, &Setting)>> = Vec::new();
    for (protocol, config) in ["AMT", "ZK"].into_iter().zip(both()) {
        for setting in config.settings() {
            match rows.iter_mut().find(|row| row[0].1.name == setting.name) {
                Some(row) => row.push((protocol, setting)),
                None => rows.push(vec![(protocol, setting)]),
            }
        }
    }
    let mut table = String::from("| setting | field | default | range | what |\n|---|---|---|---|---|\n");
    for of_protocols in rows {
        let row = of_protocols[0].1;
        let off = if row.may_be_off { ", or off" } else { "" };
        let plain = matches!(row.unit, Unit::YesNo | Unit::Action);
        let range = if plain {
            row.unit.symbol().to_string()
        } else {
            format!("{} to {} {}{off}", row.min, row.max, row.unit.symbol())
        };
        let default = |number: i32| match number {
            OFF if row.may_be_off => "off".to_string(),
            number if plain => number.to_string(),
            1 if row.unit == Unit::Frames => "1 frame".to_string(),
            number => format!("{number} {}", row.unit.symbol()),
        };
        let default = if of_protocols.iter().all(|(_, other)| other.default == row.default) {
            default(row.default)
        } else {
            let each =
                of_protocols.iter().map(|(protocol, row)| format!("{protocol} {}", default(row.default)));
            each.collect::<Vec<_>>().join(", ")
        };
        table += &format!("| `{}` | `{}` | {default} | {range} | {} |\n", row.name, row.field, row.text);
    }
    pages::compare(path, begin, end, &table);
}

/// An error of a setting can be passed on with `?`, and its text says what to do.
#[test]
fn every_error_of_settings_is_an_error_with_a_sentence() {
    let mut supervision = Supervision::DEFAULT;
    supervision.loss.hold = Duration::MAX;
    let errors: [&dyn core::error::Error; 4] = [
        &supervision.validate().unwrap_err(),
        &Mistake::Zk(ZkMistake::RateTooFast),
        &ZkMistake::RateTooFast,
        &jetlink::line::LineError::Framing,
    ];
    let texts = errors.map(|error| error.to_string());
    assert_eq!(texts[0], "loss.hold: 0 to 60000 ms");
    assert_eq!(texts[1], ZkMistake::RateTooFast.message());
    assert_eq!(texts[2], texts[1]);
    assert_eq!(texts[3], "framing error: check the baud rate and the wiring");
}
