//! ZK: status.

use super::*;

/// A field of a status frame: its bits in bytes 3, 4 and 5, and its value.
struct Field {
    name: &'static str,
    /// Bits of bytes 3, 4, 5, from the least significant bit of the value up.
    bits: Vec<(usize, u8)>,
    /// Size of one step, and the value of raw 0.
    step: i64,
    zero: i64,
    get: fn(Status) -> i64,
}

/// Bits `high` down to `low` of a byte, least significant first.
fn bits(byte: usize, high: u8, low: u8) -> Vec<(usize, u8)> {
    (low..=high).map(|bit| (byte - 3, bit)).collect()
}

/// In the document's notation: `{high part, low part}`.
fn concat(high: Vec<(usize, u8)>, low: Vec<(usize, u8)>) -> Vec<(usize, u8)> {
    low.into_iter().chain(high).collect()
}

/// A value, whatever the version.
fn all<T: Copy>(value: Since<T>) -> T {
    value.unless_older(None).expect("no version is known")
}

/// ZK-7: thrust from version 2 on, all of ID 8 but the idle rpm from version 4 on. Without a version both readings are given.
#[test]
fn zk_7_fields_of_later_versions_are_read_from_their_version_on() {
    let (Status::Load { thrust, .. }, Status::Idle { details, .. }) = (status(4, [0; 3]), status(8, [0; 3]))
    else {
        panic!("IDs 4 and 8");
    };
    for (number, has_thrust, has_details) in
        [(1, false, false), (2, true, false), (3, true, false), (4, true, true)]
    {
        let version = Some(Version::new(number).expect("0..=63"));
        assert_eq!(
            (thrust.known(version).is_some(), thrust.unless_older(version).is_some()),
            (has_thrust, has_thrust)
        );
        assert_eq!(
            (details.known(version).is_some(), details.unless_older(version).is_some()),
            (has_details, has_details)
        );
    }
    assert_eq!((thrust.known(None), details.known(None)), (None, None));
    assert!(thrust.unless_older(None).is_some() && details.unless_older(None).is_some());
}

macro_rules! field {
    ($name:literal, $bits:expr, $step:literal, $zero:literal, $variant:ident { $from:ident } => $get:expr) => {
        Field {
            name: $name,
            bits: $bits,
            step: $step,
            zero: $zero,
            get: |status| match status {
                Status::$variant { $from, .. } => i64::from($get),
                other => panic!("{other:?}"),
            },
        }
    };
}

/// The tables of chapter 6 of the document, with their `{BYTEn[h:l]}`.
fn status_fields(id: u8) -> Vec<Field> {
    match id {
        1 => vec![
            field!("state", bits(3, 4, 0), 1, 0, Engine { state } => state.code()),
            field!("error", concat(bits(4, 1, 0), bits(3, 7, 5)), 1, 0, Engine { error } => error.code()),
            field!("egt", concat(bits(4, 4, 2), bits(5, 7, 0)), 10, -500, Engine { egt } => egt.tenths()),
            field!("switch", bits(4, 6, 5), 1, 0, Engine { switch } => switch.code()),
        ],
        2 => vec![
            field!("radio", bits(3, 7, 0), 1, 0, Voltages { radio } => radio.0),
            field!("power", bits(4, 7, 0), 1, 0, Voltages { power } => power.0),
            field!("pump", bits(5, 7, 0), 1, 0, Voltages { pump } => pump.0),
        ],
        3 => vec![
            field!("throttle", bits(3, 7, 0), 1, 0, Throttle { percent } => percent),
            field!("pressure", concat(bits(5, 7, 0), bits(4, 7, 0)), 2, 0, Throttle { pressure } => pressure.get()),
        ],
        4 => vec![
            field!("current", concat(bits(4, 0, 0), bits(3, 7, 0)), 100, 0, Load { current } => current.get()),
            field!("thrust", concat(bits(4, 7, 1), bits(5, 7, 0)), 100, 0, Load { thrust } => all(thrust).get()),
        ],
        5 => vec![
            field!("ignition pump", bits(3, 7, 0), 20, 0, Settings { ignition_pump } => ignition_pump.get()),
            field!("increase", bits(4, 7, 0), 1, 0, Settings { increase } => increase),
            field!("decrease", bits(5, 7, 0), 1, 0, Settings { decrease } => decrease),
        ],
        6 => vec![
            field!("max rpm", bits(3, 7, 0), 1000, 0, Identity { max_rpm } => max_rpm.get()),
            field!("max pump", bits(4, 7, 0), 1, 0, Identity { max_pump } => max_pump.0),
            field!("version", bits(5, 7, 2), 1, 0, Identity { version } => version.get()),
        ],
        7 => vec![
            field!("flow", concat(bits(4, 1, 0), bits(3, 7, 0)), 10, 0, Fuel { flow } => flow.get()),
            field!("total", concat(bits(5, 7, 0), bits(4, 7, 2)), 100, 0, Fuel { total } => total.get()),
        ],
        8 => vec![
            field!("idle rpm", bits(3, 7, 0), 1000, 0, Idle { idle_rpm } => idle_rpm.get()),
            field!("ESR", bits(4, 5, 5), 1, 0, Idle { details } => all(details).pressure_requested),
            field!("SCL", bits(4, 4, 4), 1, 0, Idle { details } => all(details).closed_loop),
            field!("startup", concat(bits(4, 3, 0), bits(5, 7, 0)), 100, 0,
                Idle { details } => u32::try_from(all(details).startup.as_millis()).unwrap()),
        ],
        9 => vec![field!("ECU", bits(3, 7, 0), 10, -500, Temperature { ecu } => ecu.tenths())],
        _ => vec![],
    }
}

/// ZK-5: each bit of a status frame belongs to one field, with one weight, and affects no other.
#[test]
fn zk_5_every_bit_of_a_status_belongs_to_its_field() {
    for id in 1..=9 {
        let fields = status_fields(id);
        assert!(!fields.is_empty());
        for field in &fields {
            let mut all_ones = [0u8; 3];
            for (weight, &(byte, bit)) in field.bits.iter().enumerate() {
                let mut one_bit = [0u8; 3];
                one_bit[byte] = 1 << bit;
                all_ones[byte] |= 1 << bit;
                assert_eq!(
                    (field.get)(status(id, one_bit)),
                    field.zero + (field.step << weight),
                    "ID {id} {}: bit {bit} of byte {}",
                    field.name,
                    byte + 3
                );
            }
            let largest = field.zero + field.step * ((1 << field.bits.len()) - 1);
            assert_eq!((field.get)(status(id, [0; 3])), field.zero, "ID {id} {} of zeros", field.name);
            assert_eq!((field.get)(status(id, all_ones)), largest, "ID {id} {} alone", field.name);
            assert_eq!((field.get)(status(id, [0xFF; 3])), largest, "ID {id} {} of ones", field.name);
            let others = all_ones.map(|byte| !byte);
            assert_eq!((field.get)(status(id, others)), field.zero, "ID {id} {} beside ones", field.name);
        }
    }
}

/// ZK-5: rpm / 10 is in bytes 1 and 2 of every ID, the low byte first.
#[test]
fn zk_5_rpm_is_in_every_status() {
    for id in 0..=14 {
        for (low, high, rpm) in [(0, 0, 0), (1, 0, 10), (0xFF, 0, 2550), (0, 1, 2560), (0xFF, 0xFF, 655_350)]
        {
            let body = [0xF0 | id, low, high, 0, 0, 0];
            let [a, b, c, d, e, f] = body;
            let frame = StatusFrame::new([a, b, c, d, e, f, printed_crc8(&body)]).expect("CRC is right");
            assert_eq!(frame.rpm().get(), rpm, "ID {id}");
        }
    }
}

/// ZK-5: the examples that the document prints.
#[test]
fn zk_5_the_printed_status_examples_are_read_as_printed() {
    //           head  rpm   rpm   state temp  temp  CRC
    let first = [0xF1, 0x00, 0x00, 0x00, 0x00, 0x4C, 0xA0];
    let frame = StatusFrame::new(first).expect("CRC is right");
    assert_eq!(frame.rpm(), Rpm::new(0));
    assert_eq!(
        frame.status(),
        Status::Engine {
            state: State::Stop,
            error: ErrorCode::None,
            egt: Celsius::from_tenths(260),
            switch: SwitchStatus::Stop,
        }
    );
    //            head  rpm   rpm   max   pump  vers  CRC
    let second = [0xF6, 0x00, 0x00, 0xA0, 0x00, 0x10, 0xAB];
    let frame = StatusFrame::new(second).expect("CRC is right");
    assert_eq!(
        frame.status(),
        Status::Identity {
            max_rpm: Rpm::new(160_000),
            max_pump: VoltageByte(0),
            version: Version::new(4).unwrap(),
            rate: Some(Rate::Hz20),
        }
    );
}

/// ZK-11: the rate of status ID 6 is byte 5 bits 1 and 0; code 3 has no meaning.
#[test]
fn zk_11_the_reported_rate_has_its_code() {
    for (code, expected) in [(0, Some(Rate::Hz20)), (1, Some(Rate::Hz50)), (2, Some(Rate::Hz100)), (3, None)]
    {
        for other_bits in [0x00, 0xFC] {
            let Status::Identity { rate, .. } = status(6, [0, 0, other_bits | code]) else { panic!("ID 6") };
            assert_eq!(rate, expected);
        }
    }
}

/// ZK-6: 0.1 V up to version 3, 0.2 V from version 4, and no value while the version is unknown.
#[test]
fn zk_6_voltage_scale_follows_the_version() {
    for raw in [0, 1, 127, 255] {
        let byte = VoltageByte(raw);
        assert_eq!(byte.millivolts(None), None);
        for version in 0..=63 {
            let step = if version <= 3 { 100 } else { 200 };
            let expected = Millivolts::new(u32::from(raw) * step);
            assert_eq!(
                byte.millivolts(Some(Version::new(version).unwrap())),
                Some(expected),
                "version {version}"
            );
        }
    }
}

/// ZK-15: an ID that the document does not name is a frame, and keeps its bytes.
#[test]
fn zk_15_unknown_ids_keep_their_bytes() {
    for id in [0, 10, 11, 12, 13, 14] {
        let bytes = zk::status(id, 12_340, [1, 2, 3]);
        let frame = StatusFrame::new(bytes).expect("a frame");
        assert_eq!(frame.status(), Status::Unknown);
        assert_eq!((frame.id(), frame.raw()), (id, &bytes));
    }
    // ID 15 would be the head of a control frame.
    assert_eq!(StatusFrame::new(zk::status(15, 0, [0; 3])), None);
}

/// ZK-15: states and errors of the appendix have a name, all others keep their number.
#[test]
fn zk_15_each_state_and_error_has_its_number() {
    let states = [
        "stop",
        "standby",
        "ignition-min-throttle",
        "ignition",
        "preheat",
        "fuel-ramp",
        "learning-max",
        "learning-min",
        "learning-idle",
        "running-min",
        "running-pump-limit",
        "running",
        "cooling",
        "restart",
        "test-glow-plug",
        "test-main-valve",
        "test-ignition-valve",
        "test-pump",
        "test-starter",
        "fuel-exhaust-air",
    ];
    let errors = [
        "none",
        "timeout",
        "low-voltage",
        "glow-plug",
        "pump",
        "starter",
        "rpm-low",
        "rpm-unstable",
        "egt-high",
        "egt-low",
        "egt-sensor",
        "ignition-valve",
        "main-valve",
        "signal-lost",
        "starter-hot",
        "pump-hot",
        "clutch",
        "over-current",
        "engine-offline",
    ];
    for code in 0..32u8 {
        let Status::Engine { state, error, .. } = status(1, [code | code << 5, code >> 3, 0]) else {
            panic!("ID 1")
        };
        assert_eq!((state.code(), error.code()), (code, code));
        assert_eq!(state.name(), states.get(usize::from(code)).copied().unwrap_or("unknown"));
        assert_eq!(error.name(), errors.get(usize::from(code)).copied().unwrap_or("unknown"));
        assert_eq!(matches!(state, State::Unknown(_)), code > 19);
        assert_eq!(matches!(error, ErrorCode::Unknown(_)), code > 18);
    }
}

/// ZK-16: a head is 0xF0 to 0xFE.
#[test]
fn zk_16_a_status_begins_with_its_head() {
    for head in 0..=255u8 {
        let body = [head, 0, 0, 0, 0, 0];
        let frame = StatusFrame::new([head, 0, 0, 0, 0, 0, printed_crc8(&body)]);
        assert_eq!(frame.is_some(), (0xF0..=0xFE).contains(&head), "{head:#04x}");
    }
}
