//! Status rate of a ZK ECU (ZK-11).

use super::control::Action;
use super::frame::STATUS_LEN;
use crate::codes::closed_enum;
use crate::line::Line;
use crate::setting::Unit;
use embassy_time::Duration;

closed_enum! {
    /// Status rate of an ECU, by its code in status ID 6 (ZK-11); the document prints no meaning for code 3.
    pub enum Rate {
        /// 20 frames per second; needs 2400 baud.
        Hz20 = 0,
        /// 50 frames per second; needs 4800 baud.
        Hz50 = 1,
        /// 100 frames per second; needs 9600 baud.
        Hz100 = 2,
    }
}

// The module of settings, which does not import codecs, repeats the numbers.
const _: () = {
    assert!(Unit::STATUS_RATES.len() == Rate::ALL.len());
    let mut place = 0;
    while place < Rate::ALL.len() {
        assert!(Unit::STATUS_RATES[place] as u32 == Rate::ALL[place].hz());
        place += 1;
    }
};

impl Rate {
    /// Frames per second.
    pub const fn hz(self) -> u32 {
        match self {
            Self::Hz20 => 20,
            Self::Hz50 => 50,
            Self::Hz100 => 100,
        }
    }

    /// Time between two frames.
    pub const fn interval(self) -> Duration {
        Duration::from_millis(1000 / self.hz() as u64)
    }

    /// The command that sets it.
    pub const fn action(self) -> Action {
        match self {
            Self::Hz20 => Action::Rate20Hz,
            Self::Hz50 => Action::Rate50Hz,
            Self::Hz100 => Action::Rate100Hz,
        }
    }

    /// Whether a line carries status frames at this rate: 70 bits each at 8N1, 77 at 8N2 (ZK-11).
    pub const fn fits(self, line: Line) -> bool {
        self.hz() * STATUS_LEN as u32 * line.bits_per_byte() <= line.baud
    }
}
