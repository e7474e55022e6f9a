//! Bytes and typed frames of the toy protocol.

use core::fmt;
use jetlink::ecu::vendor::VendorFaults;

const FROM_ECU: u8 = 0xA5;
const TO_ECU: u8 = 0x5A;
const OVERHEATED: u8 = 0x80;

/// Bytes of a frame, in either direction.
pub const FRAME_LEN: usize = 2;

/// Command to the ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Control {
    Nothing,
    Standby,
    Run,
    EmergencyStop,
    Prime,
}

impl Control {
    pub const fn encode(self) -> [u8; FRAME_LEN] {
        [TO_ECU, self as u8]
    }
}

/// State of the engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum State {
    Rest,
    Running,
    /// A number that the document does not name.
    Unknown(u8),
}

/// Frame of the ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Frame {
    pub state: State,
    pub faults: Faults,
}

/// Faults of the ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Faults {
    pub overheated: bool,
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.overheated { "overheated" } else { "none" })
    }
}

impl VendorFaults for Faults {
    fn number(self) -> u8 {
        self.overheated.into()
    }
}

/// Finds frames in received bytes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Decoder {
    /// The last byte was the first one of a frame.
    begun: bool,
}

impl Decoder {
    /// Takes bytes up to the end of the first frame. Returns how many it took, and the frame.
    pub fn feed(&mut self, bytes: &[u8]) -> (usize, Option<Frame>) {
        for (taken, &byte) in (1..).zip(bytes) {
            if core::mem::replace(&mut self.begun, byte == FROM_ECU) {
                self.begun = false;
                let state = match byte & !OVERHEATED {
                    0 => State::Rest,
                    1 => State::Running,
                    other => State::Unknown(other),
                };
                let faults = Faults { overheated: byte & OVERHEATED != 0 };
                return (taken, Some(Frame { state, faults }));
            }
        }
        (bytes.len(), None)
    }
}
