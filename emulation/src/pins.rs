//! Levels of pins over a run, from what the firmware writes to the registers of their ports. A reset makes every pin an input.

use crate::board::Board;
use crate::report::Report;
use sim::ecu::Nanos;

/// Level of a pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// It is an input: the connected circuit decides.
    Floats,
    /// Driven low.
    Low,
    /// Driven high.
    High,
}

impl Level {
    /// The level that energises the outputs of an image's engine: of the last one the low level, unless the bootloader drives them low.
    pub fn energising(board: &Board, last: bool) -> Self {
        let low_before = board.outputs.iter().any(|output| output.low_before);
        if last && !low_before { Self::Low } else { Self::High }
    }
}

/// Mode, output data, set and reset (MODER, ODR, BSRR).
const REGISTERS: [u64; 3] = [0x00, 0x14, 0x18];

/// The registers of a board's ports with outputs, and of those of its socket for a receiver, to be recorded.
pub(crate) fn registers(board: &Board) -> Vec<u64> {
    let socket = board.socket.iter().flat_map(|socket| [socket.inverter.0, socket.port.tx.port]);
    let names = board.outputs.iter().map(|output| output.pin.0).chain(socket);
    let mut ports: Vec<u64> = names.map(|name| port(board, name)).collect();
    ports.sort_unstable();
    ports.dedup();
    ports.into_iter().flat_map(|port| REGISTERS.map(|register| port + register)).collect()
}

/// Address of the registers of a GPIO port.
fn port(board: &Board, name: char) -> u64 {
    board.gpio + 0x400 * u64::from(name as u8 - b'A')
}

/// When the firmware first made a pin an output, or gave it to a peripheral (MODER).
pub(crate) fn taken(report: &Report, (name, bit): (char, u8)) -> Option<Nanos> {
    let mode = port(report.board, name);
    let mut writes = report.pins_written.iter().filter(|write| write.register == mode);
    writes.find(|write| matches!(write.value >> (2 * bit) & 0b11, 0b01 | 0b10)).map(|write| write.at)
}

/// The history of a pin: its level from each of these times on.
#[derive(Clone, Debug)]
pub struct Pin(Vec<(Nanos, Level)>);

impl Pin {
    /// An output of the board, by number.
    pub fn output(report: &Report, number: usize) -> Self {
        Self::of(report, report.board.outputs[number].pin)
    }

    /// A pin of a port whose registers every run records.
    pub(crate) fn of(report: &Report, (name, bit): (char, u8)) -> Self {
        let port = port(report.board, name);
        let [mode, data, set] = REGISTERS.map(|register| port + register);
        let (mut is_output, mut high) = (false, false);
        let mut history = vec![(0, Level::Floats)];
        let mut resets = report.resets.iter().map(|reset| reset.0).peekable();
        let mut change = |at, is_output, high| {
            let level = match (is_output, high) {
                (false, _) => Level::Floats,
                (true, false) => Level::Low,
                (true, true) => Level::High,
            };
            if history.last().is_none_or(|last| last.1 != level) {
                history.push((at, level));
            }
        };
        for write in &report.pins_written {
            while let Some(at) = resets.next_if(|at| *at <= write.at) {
                (is_output, high) = (false, false);
                change(at, is_output, high);
            }
            if write.register == mode {
                is_output = write.value >> (2 * bit) & 0b11 == 0b01;
            } else if write.register == data {
                high = write.value >> bit & 1 == 1;
            } else if write.register == set {
                // The lower half sets, and wins over the upper half.
                high = write.value >> bit & 1 == 1 || (high && write.value >> (bit + 16) & 1 == 0);
            } else {
                continue;
            }
            change(write.at, is_output, high);
        }
        resets.for_each(|at| change(at, false, false));
        Self(history)
    }

    /// A history with these changes of level.
    #[cfg(test)]
    pub(crate) const fn from_levels(levels: Vec<(Nanos, Level)>) -> Self {
        Self(levels)
    }

    /// Time at which it was first driven.
    pub fn driven(&self) -> Option<Nanos> {
        self.0.iter().find(|(_, level)| *level != Level::Floats).map(|(at, _)| *at)
    }

    /// Its level at a time.
    pub fn at(&self, at: Nanos) -> Level {
        self.0.iter().rfind(|(since, _)| *since <= at).map_or(Level::Floats, |(_, level)| *level)
    }

    /// Its changes within this time.
    pub fn changes(&self, within: core::ops::Range<Nanos>) -> Vec<(Nanos, Level)> {
        self.0.iter().filter(|(at, _)| within.contains(at)).copied().collect()
    }
}
