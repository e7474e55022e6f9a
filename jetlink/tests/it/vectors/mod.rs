//! The documents' own examples, and frames computed from the documents by hand: every control ID, every status
//! ID field by field, every AMT set and scale.

mod amt_control;
mod amt_telemetry;
mod zk_control;
mod zk_status;

use embassy_time::Duration;
use jetlink::ecu::amt::codec as amt;
use jetlink::ecu::zk::codec::{
    AccelerationCurve, Action, Control, ControlError, ErrorCode, IgnitionPumpVoltage, Rate, RpmCode,
    RpmFactor, Since, State, Status, StatusFrame, Switch, SwitchStatus, Version, VoltageByte, crc8,
};
use jetlink::line::Line;
use jetlink::units::{Celsius, Hectopascals, Millivolts, Rpm, Throttle};

use crate::support::frames::{amt as amt_frames, printed_crc8, zk};

fn status(id: u8, rest: [u8; 3]) -> Status {
    let frame = StatusFrame::new(zk::status(id, 0, rest)).expect("CRC is right");
    assert_eq!(frame.id(), id);
    frame.status()
}
