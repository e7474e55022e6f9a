//! AMT: telemetry.

use super::*;

/// The only frame in these bytes.
fn amt_frame(bytes: &[u8]) -> amt::Frame {
    let mut decoder = amt::Decoder::new();
    let (taken, frame) = decoder.feed(bytes);
    assert_eq!(taken, bytes.len(), "{bytes:02x?}");
    let frame = frame.unwrap_or_else(|| panic!("no frame in {bytes:02x?}"));
    assert_eq!(frame.raw(), bytes);
    frame
}

fn amt_message(bytes: &[u8]) -> amt::Message {
    amt_frame(bytes).message()
}

/// AMT-2: every Data1, sorted as the document does.
#[test]
fn amt_2_data1_determines_the_kind_of_a_frame() {
    use amt::{EgtByte, ErrorBits, Message, State, SwitchPosition, ThrottleByte};
    for data1 in (0..0xFF).filter(|data1| *data1 != 0x05) {
        let bytes = [0xFF, data1, 2, 3, 4, 5];
        let message = amt_message(&bytes);
        let (egt, throttle, vout) = (EgtByte(3), ThrottleByte(4), 5);
        let normal = |switch| Message::Normal {
            switch,
            state: State::from_code(data1 >> 3),
            rpm: 2,
            egt,
            throttle,
            vout,
        };
        let alternate = Message::Alternate { engine_id: data1, idle: 2, max: 3, battery: 4, external: 5 };
        let expected = match data1 {
            0x00 => Message::Error { errors: ErrorBits(2), egt, throttle, vout },
            0x03 | 0x06 | 0x07 => alternate,
            _ => match data1 & 7 {
                0b001 => normal(SwitchPosition::EmergencyStop),
                0b010 => normal(SwitchPosition::AutoStop),
                0b100 => normal(SwitchPosition::Run),
                0b000 => alternate,
                _ => Message::Unknown,
            },
        };
        assert_eq!(message, expected, "Data1 {data1:#04x}");
    }
    assert!(matches!(amt_message(&amt_frames::setup("9.35 140617 ")), Message::Setup(_)));
}

/// AMT-3: the printed states, the two field facts, and all others with their number.
#[test]
fn amt_3_each_state_has_its_number() {
    for (bits, name) in [
        (0b00000, "no-start-clearance"),
        (0b00001, "start-clearance"),
        (0b00010, "starting"),
        (0b00100, "started-up"),
        (0b01000, "idle-calibration"),
        (0b01100, "full-operation"),
        (0b10000, "max-rpm"),
        (0b11100, "max-rpm"),
    ] {
        for switch in [amt_frames::EMERGENCY, amt_frames::AUTO_STOP, amt_frames::RUN] {
            let message = amt_message(&amt_frames::normal(bits, switch, 0));
            let amt::Message::Normal { state, .. } = message else { panic!("{message:?}") };
            assert_eq!((state.name(), state.code()), (name, bits));
        }
    }
    let named = [0b00000, 0b00001, 0b00010, 0b00100, 0b01000, 0b01100, 0b10000, 0b11100];
    for bits in (0..32).filter(|bits| !named.contains(bits)) {
        let amt::Message::Normal { state, .. } =
            amt_message(&amt_frames::normal(bits, amt_frames::AUTO_STOP, 0))
        else {
            panic!("normal")
        };
        assert_eq!((state, state.name()), (amt::State::Unknown(bits), "unknown"));
    }
}

/// AMT-4: old and new engine numbers.
#[test]
fn amt_4_each_engine_has_its_id() {
    use amt::EngineModel::{Lynx, Mercury, Nike, Olympus, Orion, Pegasus, Titan};
    let printed = [
        (0x03, Pegasus),
        (0x06, Olympus),
        (0x07, Mercury),
        (0x08, Mercury),
        (0x10, Pegasus),
        (0x18, Olympus),
        (0x20, Titan),
        (0x28, Nike),
        (0x30, Lynx),
        (0x38, Orion),
    ];
    for id in 0..=255 {
        let expected = printed.iter().find(|(printed, _)| *printed == id).map(|(_, engine)| *engine);
        assert_eq!(amt::EngineModel::from_id(id), expected, "{id:#04x}");
    }
}

/// AMT-5: rpm in steps of 500 or 700, and no scale if the document has none.
#[test]
fn amt_5_each_engine_has_its_rpm_step() {
    use amt::EngineModel::{Lynx, Mercury, Nike, Olympus, Orion, Pegasus, Titan};
    for (engine, step) in [
        (Pegasus, Some(500)),
        (Olympus, Some(500)),
        (Titan, Some(500)),
        (Mercury, Some(700)),
        (Nike, None),
        (Lynx, None),
        (Orion, None),
    ] {
        assert_eq!(engine.rpm_step(), step, "{engine:?}");
    }
    assert_eq!(amt::EngineModel::ALL.len(), 7);
}

/// AMT-6: the scales of the three kinds of voltage, for every engine.
#[test]
fn amt_6_each_engine_has_its_voltage_scale() {
    use amt::EngineModel::{Lynx, Mercury, Nike, Olympus, Orion, Pegasus, Titan};
    // mV that a raw 255 would add: Vout and idle and maximum, battery, external battery above 7 V
    for (engine, vout, battery, external) in [
        (Mercury, Some(6250), Some(10_000), Some(6250)),
        (Pegasus, Some(6250), Some(10_000), Some(6250)),
        (Olympus, Some(8300), Some(10_000), Some(9300)),
        (Titan, Some(8300), Some(10_000), Some(9300)),
        (Nike, Some(8300), None, Some(9300)),
        (Lynx, None, None, None),
        (Orion, None, None, None),
    ] {
        for (kind, scale, full_scale, offset) in [
            ("Vout", engine.vout_scale(), vout, 0),
            ("battery", engine.battery_scale(), battery, 0),
            ("external", engine.external_scale(), external, 7000),
        ] {
            assert_eq!(scale.is_some(), full_scale.is_some(), "{engine:?} {kind}");
            let (Some(scale), Some(full_scale)) = (scale, full_scale) else { continue };
            for raw in 0..=254u8 {
                // Nearest mV to raw × full scale / 255, rounded independently of the library.
                let exact = f64::from(raw) * f64::from(full_scale) / 255.0;
                let expected = offset + exact.round() as u32;
                assert_eq!(scale.millivolts(raw).get(), expected, "{engine:?} {kind} {raw}");
            }
        }
    }
    // By hand: 102 × 6.25 / 255 = 2.5 V; 51 × 10 / 255 = 2 V; 7 + 85 × 9.3 / 255 = 10.1 V.
    assert_eq!(Mercury.vout_scale().unwrap().millivolts(102).get(), 2500);
    assert_eq!(Titan.battery_scale().unwrap().millivolts(51).get(), 2000);
    assert_eq!(Nike.external_scale().unwrap().millivolts(85).get(), 10_100);
}

/// AMT-7: °C = value × 4.6 − 50, throttle % = value / 2.
#[test]
fn amt_7_temperature_and_throttle_have_their_scales() {
    for (raw, tenths) in [(0, -500), (1, -454), (10, -40), (11, 6), (100, 4100), (254, 11_184)] {
        assert_eq!(amt::EgtByte(raw).celsius().tenths(), tenths, "{raw}");
    }
    for (raw, tenths) in [(0, 0), (1, 5), (100, 500), (200, 1000), (254, 1270)] {
        assert_eq!(amt::ThrottleByte(raw).tenths(), tenths, "{raw}");
    }
}

/// AMT-8: Data2 of an error set is a set of bits, several at once; bit 7 is kept.
#[test]
fn amt_8_each_error_has_its_bit() {
    let printed = [
        "rpm-low",
        "switch-channel-missing",
        "throttle-channel-missing",
        "egt",
        "rpm-high",
        "supply-low",
        "autostart-supply-low",
        "bit7",
    ];
    for bits in 0..=254u8 {
        let amt::Message::Error { errors, egt, throttle, vout } = amt_message(&[0xFF, 0, bits, 11, 200, 7])
        else {
            panic!("error set")
        };
        let expected: Vec<&str> = (0..8).filter(|bit| bits >> bit & 1 == 1).map(|bit| printed[bit]).collect();
        assert_eq!(errors.names().collect::<Vec<_>>(), expected);
        // Data3..5 as in the normal set.
        assert_eq!((errors.0, egt.0, throttle.0, vout), (bits, 11, 200, 7));
    }
}

fn amt_setup(bytes: &[u8]) -> amt::Setup {
    match amt_message(bytes) {
        amt::Message::Setup(setup) => setup,
        other => panic!("{other:?}"),
    }
}

/// AMT-9: pulse widths, and both forms of the text, distinguished by their full stop.
#[test]
fn amt_9_a_setup_set_ends_at_its_full_stop() {
    // 0xFF  set-up PWTH  PWTL  PWDIFF X     .     N     N     ␣     Y     Y     M     M     D     D     ␣
    let old = [
        0xFF, 0x05, 0xF8, 0x00, 0x40, b'9', b'.', b'3', b'5', b' ', b'1', b'4', b'0', b'6', b'1', b'7', b' ',
    ];
    let setup = amt_setup(&old);
    assert_eq!((setup.version(), setup.date()), ("9.35", "140617"));
    // 256 × 248 + 0 − 62464 = 1024; 1024 + 64 × 16 = 2048
    assert_eq!((setup.pw_min_us(), setup.pw_max_us()), (1024, 2048));
    assert_eq!(setup.engine(), Some(amt::EngineModel::Olympus));

    let new = [
        0xFF, 0x05, 0xF7, 0xA1, 0x3F, b'1', b'0', b'.', b'3', b'5', b' ', b'2', b'0', b'0', b'1', b'3', b'1',
        b' ',
    ];
    let setup = amt_setup(&new);
    assert_eq!((setup.version(), setup.date()), ("10.35", "200131"));
    // 256 × 247 + 161 − 62464 = 929; 929 + 63 × 16 = 1937
    assert_eq!((setup.pw_min_us(), setup.pw_max_us()), (929, 1937));
    assert_eq!(setup.engine(), Some(amt::EngineModel::Titan));

    // The extremes: 256 × 0 + 0 − 62464, and 256 × 254 + 254 − 62464 + 254 × 16.
    let least = amt_setup(&[&[0xFF, 0x05, 0, 0, 0][..], b"9.35 140617 "].concat());
    assert_eq!((least.pw_min_us(), least.pw_max_us()), (-62_464, -62_464));
    let most = amt_setup(&[&[0xFF, 0x05, 254, 254, 254][..], b"9.35 140617 "].concat());
    assert_eq!((most.pw_min_us(), most.pw_max_us()), (2814, 6878));
}

/// AMT-9: the version's first number names the engine.
#[test]
fn amt_9_version_names_the_engine() {
    use amt::EngineModel::{Lynx, Mercury, Nike, Olympus, Pegasus, Titan};
    for major in 0..=99u8 {
        let expected = match major {
            1 | 2 | 4 | 7 => Some(Pegasus),
            3 | 6 | 9 => Some(Olympus),
            5 | 8 => Some(Mercury),
            10 => Some(Titan),
            12 => Some(Nike),
            14 => Some(Lynx),
            _ => None,
        };
        let setup = amt_setup(&amt_frames::setup(&format!("{major}.35 140617 ")));
        assert_eq!(setup.engine(), expected, "{major}");
        assert_eq!(setup.version(), format!("{major}.35"));
        assert_eq!(setup.date(), "140617");
    }
}

/// AMT-9: a text without its full stop has no end; the next frame is not lost.
#[test]
fn amt_9_a_text_without_full_stop_is_dropped_at_once() {
    let mut decoder = amt::Decoder::new();
    let (taken, frame) = decoder.feed(&amt_frames::setup("9,35 140617 "));
    assert_eq!((taken, frame), (17, None));
    assert_eq!((decoder.counters().malformed, decoder.pending()), (1, 0));
    let (_, frame) = decoder.feed(&amt_frames::normal(0b01100, 0b100, 100));
    assert_eq!(
        frame.map(|frame| frame.raw().to_vec()),
        Some(amt_frames::normal(0b01100, 0b100, 100).to_vec())
    );
}

/// AMT-1: a 0xFF inside a frame starts a new one.
#[test]
fn amt_1_leader_inside_a_frame_starts_a_new_one() {
    let good = amt_frames::normal(0b01100, 0b100, 100);
    for cut in 1..6 {
        let mut decoder = amt::Decoder::new();
        let (_, frame) = decoder.feed(&good[..cut]);
        assert_eq!(frame, None);
        let (taken, frame) = decoder.feed(&good);
        assert_eq!((taken, frame.map(|frame| frame.raw().to_vec())), (6, Some(good.to_vec())));
        assert_eq!(decoder.counters().truncated, 1);
        assert_eq!(decoder.counters().bytes_skipped, cut as u32);
    }
}
