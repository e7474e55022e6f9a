//! The documents' own examples, and frames computed from the documents by hand: every control ID, every status
//! ID field by field, every AMT set and scale.

use embassy_time::Duration;
use jetlink::ecu::amt::codec as amt;
use jetlink::ecu::zk::codec::{
    AccelerationCurve, Action, Control, ControlError, ErrorCode, IgnitionPumpVoltage, Rate, RpmCode,
    RpmFactor, State, Status, StatusFrame, Switch, SwitchStatus, Version, VoltageByte, crc8,
};
use jetlink::line::Line;
use jetlink::units::{Celsius, Hectopascals, Millivolts, Rpm, Throttle};

use crate::support::frames::{amt as amt_frames, printed_crc8, zk};

// ---------------------------------------------------------------------------------------------
// ZK: CRC and control
// ---------------------------------------------------------------------------------------------

/// `crc_array` of the document.
#[rustfmt::skip]
const PRINTED_TABLE: [u8; 256] = [
    0x00, 0x5e, 0xbc, 0xe2, 0x61, 0x3f, 0xdd, 0x83,
    0xc2, 0x9c, 0x7e, 0x20, 0xa3, 0xfd, 0x1f, 0x41,
    0x9d, 0xc3, 0x21, 0x7f, 0xfc, 0xa2, 0x40, 0x1e,
    0x5f, 0x01, 0xe3, 0xbd, 0x3e, 0x60, 0x82, 0xdc,
    0x23, 0x7d, 0x9f, 0xc1, 0x42, 0x1c, 0xfe, 0xa0,
    0xe1, 0xbf, 0x5d, 0x03, 0x80, 0xde, 0x3c, 0x62,
    0xbe, 0xe0, 0x02, 0x5c, 0xdf, 0x81, 0x63, 0x3d,
    0x7c, 0x22, 0xc0, 0x9e, 0x1d, 0x43, 0xa1, 0xff,
    0x46, 0x18, 0xfa, 0xa4, 0x27, 0x79, 0x9b, 0xc5,
    0x84, 0xda, 0x38, 0x66, 0xe5, 0xbb, 0x59, 0x07,
    0xdb, 0x85, 0x67, 0x39, 0xba, 0xe4, 0x06, 0x58,
    0x19, 0x47, 0xa5, 0xfb, 0x78, 0x26, 0xc4, 0x9a,
    0x65, 0x3b, 0xd9, 0x87, 0x04, 0x5a, 0xb8, 0xe6,
    0xa7, 0xf9, 0x1b, 0x45, 0xc6, 0x98, 0x7a, 0x24,
    0xf8, 0xa6, 0x44, 0x1a, 0x99, 0xc7, 0x25, 0x7b,
    0x3a, 0x64, 0x86, 0xd8, 0x5b, 0x05, 0xe7, 0xb9,
    0x8c, 0xd2, 0x30, 0x6e, 0xed, 0xb3, 0x51, 0x0f,
    0x4e, 0x10, 0xf2, 0xac, 0x2f, 0x71, 0x93, 0xcd,
    0x11, 0x4f, 0xad, 0xf3, 0x70, 0x2e, 0xcc, 0x92,
    0xd3, 0x8d, 0x6f, 0x31, 0xb2, 0xec, 0x0e, 0x50,
    0xaf, 0xf1, 0x13, 0x4d, 0xce, 0x90, 0x72, 0x2c,
    0x6d, 0x33, 0xd1, 0x8f, 0x0c, 0x52, 0xb0, 0xee,
    0x32, 0x6c, 0x8e, 0xd0, 0x53, 0x0d, 0xef, 0xb1,
    0xf0, 0xae, 0x4c, 0x12, 0x91, 0xcf, 0x2d, 0x73,
    0xca, 0x94, 0x76, 0x28, 0xab, 0xf5, 0x17, 0x49,
    0x08, 0x56, 0xb4, 0xea, 0x69, 0x37, 0xd5, 0x8b,
    0x57, 0x09, 0xeb, 0xb5, 0x36, 0x68, 0x8a, 0xd4,
    0x95, 0xcb, 0x29, 0x77, 0xf4, 0xaa, 0x48, 0x16,
    0xe9, 0xb7, 0x55, 0x0b, 0x88, 0xd6, 0x34, 0x6a,
    0x2b, 0x75, 0x97, 0xc9, 0x4a, 0x14, 0xf6, 0xa8,
    0x74, 0x2a, 0xc8, 0x96, 0x15, 0x4b, 0xa9, 0xf7,
    0xb6, 0xe8, 0x0a, 0x54, 0xd7, 0x89, 0x6b, 0x35,
];

/// ZK-1: the printed table, the printed bit masks and the library's CRC are one and the same.
#[test]
fn zk_1_crc_is_the_one_of_the_printed_table() {
    for byte in 0..=255u8 {
        assert_eq!(printed_crc8(&[byte]), PRINTED_TABLE[usize::from(byte)], "bit masks, byte {byte:#04x}");
        assert_eq!(crc8(&[byte]), PRINTED_TABLE[usize::from(byte)], "library, byte {byte:#04x}");
    }
    // The "check value" of CRC-8/MAXIM-DOW.
    assert_eq!(crc8(b"123456789"), 0xA1);
    assert_eq!(crc8(&[]), 0);
}

/// ZK-1: a control frame's CRC covers bytes 1 and 2, a status frame's covers bytes 0 to 5.
#[test]
fn zk_1_crc_covers_what_the_printed_examples_say() {
    for example in [[0xFF, 0x14, 0x64, 0xD3], [0xFF, 0x1D, 0xF4, 0x70], [0xFF, 0x00, 0x00, 0x00]] {
        assert_eq!(crc8(&example[1..3]), example[3]);
    }
    for example in [[0xF1, 0, 0, 0, 0, 0x4C, 0xA0], [0xF6, 0, 0, 0xA0, 0, 0x10, 0xAB]] {
        assert_eq!(crc8(&example[..6]), example[6]);
    }
}

fn throttle(switch: Switch, tenths: u16) -> Control {
    Control::Throttle { switch, throttle: Throttle::from_tenths(tenths).unwrap() }
}

fn ignition(millivolts: u32) -> Control {
    Control::IgnitionPump(IgnitionPumpVoltage::from_millivolts(Millivolts::new(millivolts)).unwrap())
}

fn curve(curve: u8) -> Control {
    Control::Curve(AccelerationCurve::new(curve).unwrap())
}

fn mode(factor: u8, switch: Switch) -> Control {
    Control::Mode { factor: RpmFactor::new(factor).unwrap(), switch }
}

fn rpm_code(code: u16) -> Control {
    Control::Rpm(RpmCode::new(code).unwrap())
}

fn pressure(hectopascals: u16) -> Control {
    Control::Pressure(Hectopascals::new(hectopascals).unwrap())
}

/// The document's two examples and `FF 60 13 25` are among them.
#[rustfmt::skip]
fn control_vectors() -> Vec<(Control, [u8; 4])> {
    vec![
        (Control::KeepAlive, [0xFF, 0x00, 0x00, 0x00]),
        (throttle(Switch::Pwm, 0), [0xFF, 0x10, 0x00, 0xEC]),
        (throttle(Switch::Pwm, 100), [0xFF, 0x10, 0x64, 0xE8]),
        (throttle(Switch::Pwm, 255), [0xFF, 0x10, 0xFF, 0xD9]),
        (throttle(Switch::Pwm, 256), [0xFF, 0x11, 0x00, 0x28]),
        (throttle(Switch::Pwm, 500), [0xFF, 0x11, 0xF4, 0x3D]),
        (throttle(Switch::Pwm, 1000), [0xFF, 0x13, 0xE8, 0x92]),
        (throttle(Switch::Stop, 0), [0xFF, 0x14, 0x00, 0xD7]),
        (throttle(Switch::Stop, 100), [0xFF, 0x14, 0x64, 0xD3]),
        (throttle(Switch::Stop, 255), [0xFF, 0x14, 0xFF, 0xE2]),
        (throttle(Switch::Stop, 256), [0xFF, 0x15, 0x00, 0x13]),
        (throttle(Switch::Stop, 500), [0xFF, 0x15, 0xF4, 0x06]),
        (throttle(Switch::Stop, 1000), [0xFF, 0x17, 0xE8, 0xA9]),
        (throttle(Switch::Standby, 0), [0xFF, 0x18, 0x00, 0x9A]),
        (throttle(Switch::Standby, 100), [0xFF, 0x18, 0x64, 0x9E]),
        (throttle(Switch::Standby, 255), [0xFF, 0x18, 0xFF, 0xAF]),
        (throttle(Switch::Standby, 256), [0xFF, 0x19, 0x00, 0x5E]),
        (throttle(Switch::Standby, 500), [0xFF, 0x19, 0xF4, 0x4B]),
        (throttle(Switch::Standby, 1000), [0xFF, 0x1B, 0xE8, 0xE4]),
        (throttle(Switch::Run, 0), [0xFF, 0x1C, 0x00, 0xA1]),
        (throttle(Switch::Run, 100), [0xFF, 0x1C, 0x64, 0xA5]),
        (throttle(Switch::Run, 255), [0xFF, 0x1C, 0xFF, 0x94]),
        (throttle(Switch::Run, 256), [0xFF, 0x1D, 0x00, 0x65]),
        (throttle(Switch::Run, 500), [0xFF, 0x1D, 0xF4, 0x70]),
        (throttle(Switch::Run, 1000), [0xFF, 0x1F, 0xE8, 0xDF]),
        (Control::Action(Action::Drain), [0xFF, 0x20, 0x01, 0x9F]),
        (Control::Action(Action::TestGlowPlug), [0xFF, 0x20, 0x02, 0x7D]),
        (Control::Action(Action::TestMainValve), [0xFF, 0x20, 0x03, 0x23]),
        (Control::Action(Action::TestIgnitionValve), [0xFF, 0x20, 0x04, 0xA0]),
        (Control::Action(Action::TestPump), [0xFF, 0x20, 0x05, 0xFE]),
        (Control::Action(Action::TestStarter), [0xFF, 0x20, 0x06, 0x1C]),
        (Control::Action(Action::Rate20Hz), [0xFF, 0x20, 0x07, 0x42]),
        (Control::Action(Action::Rate50Hz), [0xFF, 0x20, 0x08, 0x03]),
        (Control::Action(Action::Rate100Hz), [0xFF, 0x20, 0x09, 0x5D]),
        (Control::Action(Action::ResetFuel), [0xFF, 0x20, 0x0A, 0xBF]),
        (Control::Action(Action::ZeroThrust), [0xFF, 0x20, 0x0B, 0xE1]),
        (Control::Action(Action::OpenPump), [0xFF, 0x20, 0x0C, 0x62]),
        (Control::Action(Action::ClosePump), [0xFF, 0x20, 0x0D, 0x3C]),
        (Control::Unlock, [0xFF, 0x30, 0x00, 0x2D]),
        (ignition(0), [0xFF, 0x40, 0x00, 0x9B]),
        (ignition(20), [0xFF, 0x40, 0x01, 0xC5]),
        (ignition(2540), [0xFF, 0x40, 0x7F, 0x22]),
        (ignition(2560), [0xFF, 0x40, 0x80, 0x17]),
        (ignition(5100), [0xFF, 0x40, 0xFF, 0xAE]),
        (curve(10), [0xFF, 0x50, 0x0A, 0x09]),
        (curve(40), [0xFF, 0x50, 0x28, 0x96]),
        (curve(70), [0xFF, 0x50, 0x46, 0xEC]),
        (mode(0, Switch::Pwm), [0xFF, 0x60, 0x00, 0x5A]),
        (mode(1, Switch::Stop), [0xFF, 0x60, 0x05, 0x65]),
        (mode(2, Switch::Standby), [0xFF, 0x60, 0x0A, 0x24]),
        (mode(3, Switch::Run), [0xFF, 0x60, 0x0F, 0x1B]),
        (mode(4, Switch::Pwm), [0xFF, 0x60, 0x10, 0xC7]),
        (mode(5, Switch::Stop), [0xFF, 0x60, 0x15, 0xF8]),
        (mode(6, Switch::Standby), [0xFF, 0x60, 0x1A, 0xB9]),
        (mode(4, Switch::Run), [0xFF, 0x60, 0x13, 0x25]),
        (mode(0, Switch::Run), [0xFF, 0x60, 0x03, 0xB8]),
        (rpm_code(0), [0xFF, 0x70, 0x00, 0xB6]),
        (rpm_code(1), [0xFF, 0x70, 0x01, 0xE8]),
        (rpm_code(255), [0xFF, 0x70, 0xFF, 0x83]),
        (rpm_code(256), [0xFF, 0x71, 0x00, 0x72]),
        (rpm_code(2500), [0xFF, 0x79, 0xC4, 0xAF]),
        (rpm_code(4095), [0xFF, 0x7F, 0xFF, 0x9B]),
        (pressure(0), [0xFF, 0x80, 0x00, 0x2F]),
        (pressure(1), [0xFF, 0x80, 0x01, 0x71]),
        (pressure(255), [0xFF, 0x80, 0xFF, 0x1A]),
        (pressure(256), [0xFF, 0x81, 0x00, 0xEB]),
        (pressure(1013), [0xFF, 0x83, 0xF5, 0x31]),
        (pressure(1023), [0xFF, 0x83, 0xFF, 0x4F]),
    ]
}

/// ZK-2, ZK-3, ZK-4: the bytes of every control ID.
#[test]
fn zk_2_control_frames_have_these_bytes() {
    for (control, bytes) in control_vectors() {
        assert_eq!(control.encode(), bytes, "{control:?}");
        assert_eq!(Control::decode(bytes), Ok(control), "{bytes:02x?}");
        assert_eq!(control.id(), bytes[1] >> 4, "{control:?}");
    }
}

/// ZK-2: the examples that the document prints.
#[test]
fn zk_2_printed_control_examples() {
    assert_eq!(throttle(Switch::Stop, 100).encode(), [0xFF, 0x14, 0x64, 0xD3]);
    assert_eq!(throttle(Switch::Run, 500).encode(), [0xFF, 0x1D, 0xF4, 0x70]);
}

/// ZK-2: reserved bits are sent as 0, and one that is set is no frame of a host of ours.
#[test]
fn zk_2_reserved_bits_are_zero() {
    // ID, bits of byte 1 and of byte 2 that carry something.
    for (id, used1, used2) in [
        (0, 0x0, 0x00),
        (2, 0x0, 0xFF),
        (3, 0x0, 0x00),
        (4, 0x0, 0xFF),
        (5, 0x0, 0xFF),
        (6, 0x0, 0x1F),
        (8, 0x3, 0xFF),
    ] {
        for (control, bytes) in control_vectors().into_iter().filter(|(control, _)| control.id() == id) {
            assert_eq!(bytes[1] & 0x0F & !used1, 0, "{control:?}");
            assert_eq!(bytes[2] & !used2, 0, "{control:?}");
            for bit in (0..12).filter(|bit| (u16::from(used1) << 8 | u16::from(used2)) >> bit & 1 == 0) {
                let [high, low] = (1u16 << bit).to_be_bytes();
                let spoilt = zk::control(bytes[1] | high, bytes[2] | low);
                assert_eq!(Control::decode(spoilt), Err(ControlError::Reserved), "{spoilt:02x?}");
            }
        }
    }
}

/// ZK-3: seven reserved bits, RPM_X in byte 2 bits 4 to 2, SW in bits 1 and 0.
#[test]
fn zk_3_mode_layout() {
    assert_eq!(mode(4, Switch::Run).encode(), [0xFF, 0x60, 0x13, 0x25]);
    assert_eq!(mode(6, Switch::Pwm).encode()[1..3], [0x60, 0b0001_1000]);
    assert_eq!(mode(0, Switch::Run).encode()[1..3], [0x60, 0b0000_0011]);
    // RPM_X = 7 has three bits and no meaning.
    assert_eq!(Control::decode(zk::mode(7, 3)), Err(ControlError::Parameter(7)));
    assert!(RpmFactor::new(7).is_err());
}

/// ZK-4: the second "Cmd ID: 7" of the document is ID 8, and its range ends at 1023.
#[test]
fn zk_4_pressure_is_id_8_and_ends_at_1023() {
    assert_eq!(pressure(1013).encode()[1..3], [0x83, 0xF5]);
    assert_eq!(pressure(1023).encode()[1..3], [0x83, 0xFF]);
    assert!(Hectopascals::new(1024).is_err(), "1024 does not fit ten bits");
}

#[test]
fn a_parameter_outside_its_range_is_refused() {
    // bytes 1 and 2, what is refused
    for (byte1, byte2, value) in [
        (0x13, 0xE9, 1001), // throttle
        (0x1F, 0xFF, 1023),
        (0x20, 0, 0), // action
        (0x20, 14, 14),
        (0x20, 255, 255),
        (0x50, 9, 9), // curve
        (0x50, 71, 71),
    ] {
        assert_eq!(
            Control::decode(zk::control(byte1, byte2)),
            Err(ControlError::Parameter(value)),
            "{byte1:#04x} {byte2:#04x}"
        );
    }
    assert!(Throttle::from_tenths(1001).is_err() && Throttle::from_tenths(1000).is_ok());
    assert!(Throttle::from_percent(101).is_err() && Throttle::from_percent(100).is_ok());
    assert!(AccelerationCurve::new(9).is_err() && AccelerationCurve::new(10).is_ok());
    assert!(AccelerationCurve::new(71).is_err() && AccelerationCurve::new(70).is_ok());
    assert!(IgnitionPumpVoltage::from_millivolts(Millivolts::new(5101)).is_err());
    assert!(RpmCode::new(4096).is_err() && RpmCode::new(4095).is_ok());
    for id in 9..=15 {
        assert_eq!(Control::decode(zk::control(id << 4, 0)), Err(ControlError::Id(id)));
    }
    assert_eq!(Control::decode([0xFE, 0, 0, 0]), Err(ControlError::Head(0xFE)));
    assert_eq!(Control::decode([0xFF, 0, 0, 1]), Err(ControlError::Crc { expected: 0, found: 1 }));
}

/// An ignition voltage is never rounded up.
#[test]
fn ignition_pump_steps_are_20_mv_downwards() {
    for (asked, gives, byte) in
        [(0, 0, 0), (19, 0, 0), (20, 20, 1), (39, 20, 1), (5099, 5080, 254), (5100, 5100, 255)]
    {
        let voltage = IgnitionPumpVoltage::from_millivolts(Millivolts::new(asked)).unwrap();
        assert_eq!(voltage.millivolts().get(), gives);
        assert_eq!(Control::IgnitionPump(voltage).encode()[2], byte);
    }
}

/// ZK-7: which version knows which command.
#[test]
fn zk_7_commands_and_their_versions() {
    for (control, bytes) in control_vectors() {
        let expected = match (bytes[1] >> 4, bytes[2]) {
            (2, 10 | 11) => 2,
            (2, 12 | 13) => 5,
            (6..=8, _) => 4,
            _ => 1,
        };
        assert_eq!(control.min_version().get(), expected, "{control:?}");
    }
}

/// ZK-8: the numbers that are sent and those that are reported differ.
#[test]
fn zk_8_switch_numbers_sent_and_reported() {
    // sent: SW in byte 1 bits 3 and 2
    for (switch, sent) in [(Switch::Pwm, 0), (Switch::Stop, 1), (Switch::Standby, 2), (Switch::Run, 3)] {
        assert_eq!(throttle(switch, 0).encode()[1], 0x10 | sent << 2);
    }
    // reported: SwSt in byte 4 bits 6 and 5
    for (reported, name, code) in [
        (SwitchStatus::Stop, "stop", 0),
        (SwitchStatus::Standby, "standby", 1),
        (SwitchStatus::Run, "run", 2),
        (SwitchStatus::Unknown(3), "unknown", 3),
    ] {
        let Status::Engine { switch, .. } = status(1, [0, code << 5, 0]) else { panic!("ID 1") };
        assert_eq!(switch, reported);
        assert_eq!((switch.name(), switch.code()), (name, code));
    }
}

/// ZK-9: the smallest RPM_X whose range covers the maximum rpm.
#[test]
fn zk_9_rpm_factor_is_the_smallest_that_covers() {
    for (max, factor) in [
        (0, 1),
        (1_000, 1),
        (40_000, 1),
        (40_950, 1),
        (40_951, 2),
        (41_000, 2),
        (81_900, 2),
        (81_901, 3),
        (122_850, 3),
        (122_851, 4),
        (160_000, 4),
        (163_800, 4),
        (163_801, 5),
        (204_750, 5),
        (204_751, 6),
        (245_700, 6),
        (255_000, 6), // the largest that status ID 6 can give
    ] {
        assert_eq!(RpmFactor::covering(Rpm::new(max)).get(), factor, "{max}");
    }
    for (factor, range) in
        [(0, 0), (1, 40_950), (2, 81_900), (3, 122_850), (4, 163_800), (5, 204_750), (6, 245_700)]
    {
        assert_eq!(RpmFactor::new(factor).unwrap().range().get(), range);
    }
}

/// ZK-9: target rpm = code × RPM_X × 10, and never above what was demanded.
#[test]
fn zk_9_rpm_code_never_rounds_up() {
    for factor in 1..=6 {
        let x = RpmFactor::new(factor).unwrap();
        let step = u32::from(factor) * 10;
        for rpm in (0..=260_000).step_by(7) {
            let code = RpmCode::for_target(Rpm::new(rpm), x);
            let target = u32::from(code.get()) * step;
            assert_eq!(code.target(x).get(), target);
            assert!(target <= rpm, "{rpm} with {factor} gives {target}");
            assert!(rpm - target < step || code.get() == 4095, "{rpm} with {factor} gives {target}");
        }
    }
    assert_eq!(RpmCode::for_target(Rpm::new(100_000), RpmFactor::OFF).get(), 0);
}

/// ZK-11: 20 Hz needs 2400 baud, 50 Hz 4800, 100 Hz 9600; with two stop bits as well.
#[test]
fn zk_11_rates_that_fit_a_line() {
    for line in [Line::new as fn(u32) -> Line, Line::with_two_stop_bits] {
        for baud in Line::BAUD_RATES {
            for (rate, needs) in [(Rate::Hz20, 2400), (Rate::Hz50, 4800), (Rate::Hz100, 9600)] {
                assert_eq!(rate.fits(line(baud)), baud >= needs, "{rate:?} at {baud}");
            }
        }
    }
    for (rate, hz, code, parameter) in
        [(Rate::Hz20, 20, 0, 7), (Rate::Hz50, 50, 1, 8), (Rate::Hz100, 100, 2, 9)]
    {
        assert_eq!(rate.hz(), hz);
        assert_eq!(rate.interval(), Duration::from_micros(1_000_000 / u64::from(hz)));
        assert_eq!(Rate::from_code(code), Some(rate));
        assert_eq!(rate.action().parameter(), parameter);
    }
    assert_eq!(Rate::from_code(3), None);
}

/// ZK-12, AMT-1: the printed baud rates; 10 bits a byte with one stop bit and 11 with two.
#[test]
fn zk_12_amt_1_line_rates_and_byte_times() {
    assert_eq!(Line::BAUD_RATES, [2400, 4800, 9600, 19_200, 38_400, 57_600, 115_200]);
    for baud in Line::BAUD_RATES {
        assert!(Line::new(baud).is_printed_rate());
        // The time is that of the bits, rounded up by less than a microsecond.
        for (line, bits) in [(Line::new(baud), 10), (Line::with_two_stop_bits(baud), 11)] {
            assert_eq!(line.bits_per_byte(), bits);
            for bytes in [1, 4, 5, 6, 7, 18] {
                let exact = u64::from(bytes * bits) * 1_000_000;
                let time = line.time_of(bytes).as_micros();
                assert!(time * u64::from(baud) >= exact && (time - 1) * u64::from(baud) < exact);
            }
        }
    }
    for other in [0, 1200, 2399, 14_400, 230_400] {
        assert!(!Line::new(other).is_printed_rate(), "{other}");
    }
    assert_eq!(Line::new(2400).time_of(5).as_micros(), 20_834); // 20.8 ms in the AMT document
}

// ---------------------------------------------------------------------------------------------
// ZK: status
// ---------------------------------------------------------------------------------------------

fn status(id: u8, rest: [u8; 3]) -> Status {
    let frame = StatusFrame::new(zk::status(id, 0, rest)).expect("CRC is right");
    assert_eq!(frame.id(), id);
    frame.status()
}

/// A field of a status frame: where its bits are in bytes 3, 4 and 5, and how it comes out.
struct Field {
    name: &'static str,
    /// Bits of bytes 3, 4, 5, from the least significant bit of the value up.
    bits: Vec<(usize, u8)>,
    /// One step of the value, and the value of 0.
    step: i64,
    zero: i64,
    get: fn(Status) -> i64,
}

/// Bits `high` down to `low` of a byte, least significant first.
fn bits(byte: usize, high: u8, low: u8) -> Vec<(usize, u8)> {
    (low..=high).map(|bit| (byte - 3, bit)).collect()
}

/// As the document writes `{high part, low part}`.
fn concat(high: Vec<(usize, u8)>, low: Vec<(usize, u8)>) -> Vec<(usize, u8)> {
    low.into_iter().chain(high).collect()
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
            field!("thrust", concat(bits(4, 7, 1), bits(5, 7, 0)), 100, 0, Load { thrust } => thrust.get()),
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
            field!("ESR", bits(4, 5, 5), 1, 0, Idle { pressure_requested } => pressure_requested),
            field!("SCL", bits(4, 4, 4), 1, 0, Idle { closed_loop } => closed_loop),
            field!("startup", concat(bits(4, 3, 0), bits(5, 7, 0)), 100, 0,
                Idle { startup } => u32::try_from(startup.as_millis()).unwrap()),
        ],
        9 => vec![field!("ECU", bits(3, 7, 0), 10, -500, Temperature { ecu } => ecu.tenths())],
        _ => vec![],
    }
}

/// ZK-5: each bit of a status frame belongs to one field, with one weight, and leaks into no other.
#[test]
fn zk_5_every_bit_of_every_status_field() {
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
fn zk_5_printed_status_examples() {
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
fn zk_11_reported_rate() {
    for (code, expected) in [(0, Some(Rate::Hz20)), (1, Some(Rate::Hz50)), (2, Some(Rate::Hz100)), (3, None)]
    {
        for other_bits in [0x00, 0xFC] {
            let Status::Identity { rate, .. } = status(6, [0, 0, other_bits | code]) else { panic!("ID 6") };
            assert_eq!(rate, expected);
        }
    }
}

/// ZK-6: 0.1 V up to version 3, 0.2 V from version 4, and nothing while the version is not known.
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
fn zk_15_states_and_errors() {
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
fn zk_16_heads() {
    for head in 0..=255u8 {
        let body = [head, 0, 0, 0, 0, 0];
        let frame = StatusFrame::new([head, 0, 0, 0, 0, 0, printed_crc8(&body)]);
        assert_eq!(frame.is_some(), (0xF0..=0xFE).contains(&head), "{head:#04x}");
    }
}

// ---------------------------------------------------------------------------------------------
// AMT: telemetry
// ---------------------------------------------------------------------------------------------

/// The one frame of some bytes.
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
fn amt_2_what_a_frame_is_by_data1() {
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
fn amt_3_states() {
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
fn amt_4_engine_ids() {
    use amt::Engine::{Lynx, Mercury, Nike, Olympus, Orion, Pegasus, Titan};
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
        assert_eq!(amt::Engine::from_id(id), expected, "{id:#04x}");
    }
}

/// AMT-5: rpm in steps of 500 or 700, and no scale where the document has none.
#[test]
fn amt_5_rpm_steps() {
    use amt::Engine::{Lynx, Mercury, Nike, Olympus, Orion, Pegasus, Titan};
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
    assert_eq!(amt::Engine::ALL.len(), 7);
}

/// AMT-6: the scales of the three kinds of voltage, for every engine.
#[test]
fn amt_6_voltage_scales() {
    use amt::Engine::{Lynx, Mercury, Nike, Olympus, Orion, Pegasus, Titan};
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
                // Nearest mV to raw × full scale / 255, without the library's way to round.
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
fn amt_7_temperature_and_throttle() {
    for (raw, tenths) in [(0, -500), (1, -454), (10, -40), (11, 6), (100, 4100), (254, 11_184)] {
        assert_eq!(amt::EgtByte(raw).celsius().tenths(), tenths, "{raw}");
    }
    for (raw, tenths) in [(0, 0), (1, 5), (100, 500), (200, 1000), (254, 1270)] {
        assert_eq!(amt::ThrottleByte(raw).tenths(), tenths, "{raw}");
    }
}

/// AMT-8: Data2 of an error set is a set of bits, several at once; bit 7 is kept.
#[test]
fn amt_8_error_bits() {
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

/// AMT-9: pulse widths, and both forms of the text, told apart by their full stop.
#[test]
fn amt_9_setup_sets() {
    // 0xFF  set-up PWTH  PWTL  PWDIFF X     .     N     N     ␣     Y     Y     M     M     D     D     ␣
    let old = [
        0xFF, 0x05, 0xF8, 0x00, 0x40, b'9', b'.', b'3', b'5', b' ', b'1', b'4', b'0', b'6', b'1', b'7', b' ',
    ];
    let setup = amt_setup(&old);
    assert_eq!((setup.version(), setup.date()), ("9.35", "140617"));
    // 256 × 248 + 0 − 62464 = 1024; 1024 + 64 × 16 = 2048
    assert_eq!((setup.pw_min_us(), setup.pw_max_us()), (1024, 2048));
    assert_eq!(setup.engine(), Some(amt::Engine::Olympus));

    let new = [
        0xFF, 0x05, 0xF7, 0xA1, 0x3F, b'1', b'0', b'.', b'3', b'5', b' ', b'2', b'0', b'0', b'1', b'3', b'1',
        b' ',
    ];
    let setup = amt_setup(&new);
    assert_eq!((setup.version(), setup.date()), ("10.35", "200131"));
    // 256 × 247 + 161 − 62464 = 929; 929 + 63 × 16 = 1937
    assert_eq!((setup.pw_min_us(), setup.pw_max_us()), (929, 1937));
    assert_eq!(setup.engine(), Some(amt::Engine::Titan));

    // The extremes: 256 × 0 + 0 − 62464, and 256 × 254 + 254 − 62464 + 254 × 16.
    let least = amt_setup(&[&[0xFF, 0x05, 0, 0, 0][..], b"9.35 140617 "].concat());
    assert_eq!((least.pw_min_us(), least.pw_max_us()), (-62_464, -62_464));
    let most = amt_setup(&[&[0xFF, 0x05, 254, 254, 254][..], b"9.35 140617 "].concat());
    assert_eq!((most.pw_min_us(), most.pw_max_us()), (2814, 6878));
}

/// AMT-9: the version's first number names the engine.
#[test]
fn amt_9_version_names_the_engine() {
    use amt::Engine::{Lynx, Mercury, Nike, Olympus, Pegasus, Titan};
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

// ---------------------------------------------------------------------------------------------
// AMT: control
// ---------------------------------------------------------------------------------------------

/// AMT-10: 0xFF OPS THR OPS THR; THR = 2 × % + 32.
#[test]
fn amt_10_control_messages_have_these_bytes() {
    use amt::{Control, Ops};
    for (ops, tenths, bytes) in [
        //                                  head  OPS   THR  OPS   THR
        (Ops::EmergencyStop, 0, [0xFF, 0x11, 32, 0x11, 32]),
        (Ops::AutoStop, 0, [0xFF, 0x12, 32, 0x12, 32]),
        (Ops::Run, 0, [0xFF, 0x14, 32, 0x14, 32]),
        (Ops::Run, 5, [0xFF, 0x14, 33, 0x14, 33]),
        (Ops::Run, 500, [0xFF, 0x14, 132, 0x14, 132]), // the document's example
        (Ops::Run, 1000, [0xFF, 0x14, 232, 0x14, 232]),
        (Ops::Ctf, 0, [0xFF, 0x91, 32, 0x91, 32]),
        (Ops::Ctf, 250, [0xFF, 0x91, 82, 0x91, 82]),
    ] {
        let control = Control { ops, throttle: Throttle::from_tenths(tenths).unwrap() };
        assert_eq!(control.encode(), bytes);
        assert_eq!(Control::decode(bytes), Ok(control));
    }
}

/// AMT-10: the wire has steps of 0.5 %; what lies between goes down, never up.
#[test]
fn amt_10_throttle_is_rounded_down() {
    for tenths in 0..=1000u16 {
        let throttle = Throttle::from_tenths(tenths).unwrap();
        let [_, _, thr, _, copy] = amt::Control { ops: amt::Ops::Run, throttle }.encode();
        assert_eq!(thr, copy);
        let sent = (u16::from(thr) - 32) * 5;
        assert!(sent <= tenths && tenths - sent < 5, "{tenths} is sent as {sent}");
    }
}

/// AMT-10: what an ECU ignores is no control message.
#[test]
fn amt_10_spoilt_messages_are_refused() {
    use amt::{Control, ControlError};
    for (bytes, error) in [
        ([0xFE, 0x14, 32, 0x14, 32], ControlError::Leader(0xFE)),
        ([0xFF, 0x14, 32, 0x12, 32], ControlError::CopiesDiffer),
        ([0xFF, 0x14, 33, 0x14, 32], ControlError::CopiesDiffer),
        ([0xFF, 0x13, 32, 0x13, 32], ControlError::Ops(0x13)),
        ([0xFF, 0x14, 31, 0x14, 31], ControlError::Throttle(31)),
        ([0xFF, 0x14, 233, 0x14, 233], ControlError::Throttle(233)),
    ] {
        assert_eq!(Control::decode(bytes), Err(error));
    }
}
