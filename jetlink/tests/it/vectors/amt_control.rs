//! AMT: control.

use super::*;

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

/// AMT-10: the wire has steps of 0.5 %; values in between are rounded down, never up.
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

/// AMT-10: messages that an ECU ignores are not control messages.
#[test]
fn amt_10_damaged_messages_are_refused() {
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
