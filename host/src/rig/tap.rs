//! Every byte on the wires, as the simulation records it, for views and files.

use sim::wire::{Direction, Entry, Fate};

/// The bytes of one engine's line since they were last taken, if they are wanted.
#[derive(Debug, Default)]
pub struct Tap(Option<Vec<Entry>>);

impl Tap {
    /// Somebody wants them.
    pub fn open(&mut self) {
        self.0.get_or_insert_default();
    }

    /// More of them.
    pub fn add(&mut self, entries: &[Entry]) {
        if let Some(recorded) = &mut self.0 {
            recorded.extend_from_slice(entries);
        }
    }

    /// Bytes since the last call.
    pub fn take(&mut self) -> Vec<Entry> {
        self.0.as_mut().map(core::mem::take).unwrap_or_default()
    }
}

/// The byte that the receiver got; `None` if it got none.
pub const fn received(entry: &Entry) -> Option<u8> {
    match (entry.fate, entry.direction) {
        (Fate::Delivered | Fate::Added, _) => Some(entry.byte),
        (Fate::Lost, _) => None,
        // The node's UART accepts a broken byte; the ECU detects it.
        (Fate::Flipped(byte), _) | (Fate::Framing(byte), Direction::ToNode) => Some(byte),
        (Fate::Framing(_), Direction::ToEcu) => None,
    }
}
