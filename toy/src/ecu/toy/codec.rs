//! Bytes and typed frames of the toy protocol.

use crate::ecu::vendor::VendorFaults;
use crate::sentence::sentences;
use crate::units::Celsius;

const FROM_ECU: u8 = 0xA5;
const TO_ECU: u8 = 0x5A;
const OVERHEATED: u8 = 0x80;
/// Tenths of a degree.
const EGT_STEP: i16 = 50;

/// Bytes of a frame of the ECU.
pub const FRAME_LEN: usize = 3;
/// Bytes of a command.
pub const CONTROL_LEN: usize = 2;

/// Command to the ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Control {
    /// No order: the engine stays as it is.
    Nothing,
    /// Shut down.
    Standby,
    /// Run.
    Run,
    /// Stop at once.
    EmergencyStop,
    /// Prime the fuel line.
    Prime,
}

impl Control {
    /// Its bytes.
    pub const fn encode(self) -> [u8; CONTROL_LEN] {
        [TO_ECU, self as u8]
    }
}

/// State of the engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum State {
    /// At rest.
    Rest,
    /// Running.
    Running,
    /// A number that the document does not name.
    Unknown(u8),
}

impl State {
    const fn new(code: u8) -> Self {
        match code {
            0 => Self::Rest,
            1 => Self::Running,
            other => Self::Unknown(other),
        }
    }

    /// The number on the wire.
    pub const fn code(self) -> u8 {
        match self {
            Self::Rest => 0,
            Self::Running => 1,
            Self::Unknown(code) => code,
        }
    }

    /// Its name, for people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rest => "rest",
            Self::Running => "running",
            Self::Unknown(_) => "unknown",
        }
    }
}

/// Frame of the ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Frame {
    /// State of the engine.
    pub state: State,
    /// What it reports to be wrong.
    pub faults: Faults,
    /// Exhaust gas temperature, in steps of 5 °C.
    pub egt: Celsius,
}

/// Faults of the ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Faults {
    /// The engine is too hot.
    pub overheated: bool,
}

sentences!(Faults {
    Self { overheated: true } => "overheated";
    Self { overheated: false } => "none";
});

impl VendorFaults for Faults {
    fn number(self) -> u8 {
        self.overheated.into()
    }
}

/// Finds frames in received bytes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Decoder(Part);

/// What the decoder expects.
#[derive(Clone, Copy, Debug, Default)]
enum Part {
    #[default]
    Begin,
    State,
    Egt(u8),
}

impl Decoder {
    /// Takes bytes up to the end of the first frame. Returns how many it took, and the frame.
    pub fn feed(&mut self, bytes: &[u8]) -> (usize, Option<Frame>) {
        for (taken, &byte) in (1..).zip(bytes) {
            self.0 = match self.0 {
                Part::Begin if byte == FROM_ECU => Part::State,
                Part::Begin => Part::Begin,
                Part::State => Part::Egt(byte),
                Part::Egt(state) => {
                    self.0 = Part::Begin;
                    let faults = Faults { overheated: state & OVERHEATED != 0 };
                    let egt = Celsius::from_tenths(i16::from(byte) * EGT_STEP);
                    return (taken, Some(Frame { state: State::new(state & !OVERHEATED), faults, egt }));
                }
            };
        }
        (bytes.len(), None)
    }
}
