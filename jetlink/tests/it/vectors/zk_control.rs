//! ZK: CRC and control.

use super::*;

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

fn throttle_tenths(switch: Switch, tenths: u16) -> Control {
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
        (throttle_tenths(Switch::Pwm, 0), [0xFF, 0x10, 0x00, 0xEC]),
        (throttle_tenths(Switch::Pwm, 100), [0xFF, 0x10, 0x64, 0xE8]),
        (throttle_tenths(Switch::Pwm, 255), [0xFF, 0x10, 0xFF, 0xD9]),
        (throttle_tenths(Switch::Pwm, 256), [0xFF, 0x11, 0x00, 0x28]),
        (throttle_tenths(Switch::Pwm, 500), [0xFF, 0x11, 0xF4, 0x3D]),
        (throttle_tenths(Switch::Pwm, 1000), [0xFF, 0x13, 0xE8, 0x92]),
        (throttle_tenths(Switch::Stop, 0), [0xFF, 0x14, 0x00, 0xD7]),
        (throttle_tenths(Switch::Stop, 100), [0xFF, 0x14, 0x64, 0xD3]),
        (throttle_tenths(Switch::Stop, 255), [0xFF, 0x14, 0xFF, 0xE2]),
        (throttle_tenths(Switch::Stop, 256), [0xFF, 0x15, 0x00, 0x13]),
        (throttle_tenths(Switch::Stop, 500), [0xFF, 0x15, 0xF4, 0x06]),
        (throttle_tenths(Switch::Stop, 1000), [0xFF, 0x17, 0xE8, 0xA9]),
        (throttle_tenths(Switch::Standby, 0), [0xFF, 0x18, 0x00, 0x9A]),
        (throttle_tenths(Switch::Standby, 100), [0xFF, 0x18, 0x64, 0x9E]),
        (throttle_tenths(Switch::Standby, 255), [0xFF, 0x18, 0xFF, 0xAF]),
        (throttle_tenths(Switch::Standby, 256), [0xFF, 0x19, 0x00, 0x5E]),
        (throttle_tenths(Switch::Standby, 500), [0xFF, 0x19, 0xF4, 0x4B]),
        (throttle_tenths(Switch::Standby, 1000), [0xFF, 0x1B, 0xE8, 0xE4]),
        (throttle_tenths(Switch::Run, 0), [0xFF, 0x1C, 0x00, 0xA1]),
        (throttle_tenths(Switch::Run, 100), [0xFF, 0x1C, 0x64, 0xA5]),
        (throttle_tenths(Switch::Run, 255), [0xFF, 0x1C, 0xFF, 0x94]),
        (throttle_tenths(Switch::Run, 256), [0xFF, 0x1D, 0x00, 0x65]),
        (throttle_tenths(Switch::Run, 500), [0xFF, 0x1D, 0xF4, 0x70]),
        (throttle_tenths(Switch::Run, 1000), [0xFF, 0x1F, 0xE8, 0xDF]),
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
fn zk_2_the_printed_control_examples_are_what_is_sent() {
    assert_eq!(throttle_tenths(Switch::Stop, 100).encode(), [0xFF, 0x14, 0x64, 0xD3]);
    assert_eq!(throttle_tenths(Switch::Run, 500).encode(), [0xFF, 0x1D, 0xF4, 0x70]);
}

/// ZK-2: reserved bits are sent as 0; a frame with one set is not from our host.
#[test]
fn zk_2_reserved_bits_are_zero() {
    // ID, and the used bits of byte 1 and byte 2.
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
fn zk_3_the_mode_frame_has_the_documented_layout() {
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
    // bytes 1 and 2, refused value
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
    for (wanted, gives, byte) in
        [(0, 0, 0), (19, 0, 0), (20, 20, 1), (39, 20, 1), (5099, 5080, 254), (5100, 5100, 255)]
    {
        let voltage = IgnitionPumpVoltage::from_millivolts(Millivolts::new(wanted)).unwrap();
        assert_eq!(voltage.millivolts().get(), gives);
        assert_eq!(Control::IgnitionPump(voltage).encode()[2], byte);
    }
}

/// ZK-7: which version knows which command.
#[test]
fn zk_7_each_command_needs_its_version() {
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

/// ZK-8: sent numbers and reported numbers differ.
#[test]
fn zk_8_switches_are_numbered_apart_as_sent_and_as_reported() {
    // sent: SW in byte 1 bits 3 and 2
    for (switch, sent) in [(Switch::Pwm, 0), (Switch::Stop, 1), (Switch::Standby, 2), (Switch::Run, 3)] {
        assert_eq!(throttle_tenths(switch, 0).encode()[1], 0x10 | sent << 2);
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
fn zk_11_a_rate_fits_a_line_that_can_carry_it() {
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
        assert_eq!(rate.action().code(), parameter);
    }
    assert_eq!(Rate::from_code(3), None);
}

/// ZK-12, AMT-1: the printed baud rates; 10 bits a byte with one stop bit and 11 with two.
#[test]
fn zk_12_amt_1_a_byte_takes_its_bits_at_every_baud_rate() {
    assert_eq!(Line::BAUD_RATES, [2400, 4800, 9600, 19_200, 38_400, 57_600, 115_200]);
    for baud in Line::BAUD_RATES {
        assert!(Line::new(baud).is_printed_rate());
        // The time of the bits, rounded up by less than 1 µs.
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
