//! The control frames in the record of a wire, in the judge's terms. The simulation's decoder interprets the bytes.

use crate::ecus;
use crate::history::Frame;
use sim::any::Protocol;
use sim::control;
use sim::wire::{Direction, Entry};

/// A pause between two bytes of an ECU that ends a frame of it, ns.
const PAUSE: u64 = 2_000_000;
/// Head of an AMT set, and the bytes of a whole one.
const SET: (u8, usize) = (0xFF, 6);
/// Data 1 of alternate sets, beside those with three low bits of 0 (AMT-2).
const OLD_ENGINES: [u8; 3] = [0x03, 0x06, 0x07];

#[derive(Debug)]
pub struct Reader {
    frames: control::Reader,
    /// End of the last byte of the ECU.
    last: u64,
    /// Bytes since the head of a set that came after a pause; `None`: what came was no head, or a whole set ended.
    set: Option<usize>,
    /// Its Data 1.
    data_1: u8,
    /// End of each alternate set so far, in µs.
    pub alternate: Vec<u64>,
}

impl Reader {
    pub const fn new(protocol: Protocol) -> Self {
        let frames = control::Reader::new(protocol);
        Self { frames, last: 0, set: None, data_1: 0, alternate: Vec::new() }
    }

    /// When each set of an AMT ECU ended after which another byte begins in this part of the record, in µs. Bytes that follow the
    /// head of a set without a pause are that set's, whatever they were meant to be: nobody can distinguish them.
    pub fn ends_of_sets(&mut self, record: &[Entry]) -> Vec<u64> {
        let mut ends = Vec::new();
        for entry in record.iter().filter(|entry| entry.direction == Direction::ToNode) {
            let before = core::mem::replace(&mut self.last, entry.end);
            let pause = entry.start > before + PAUSE;
            if before > 0 && (pause || self.set == Some(SET.1)) {
                ends.push(before / 1000);
                if self.set == Some(SET.1) && is_alternate(self.data_1) {
                    self.alternate.push(before / 1000);
                }
            }
            self.set = match self.set {
                _ if pause || before == 0 => (entry.byte == SET.0).then_some(1),
                Some(bytes) if bytes < SET.1 => Some(bytes + 1),
                _ => None,
            };
            if self.set == Some(2) {
                self.data_1 = entry.byte;
            }
        }
        ends
    }

    /// End of the last one, or of its bytes up to now.
    pub fn last_report(&self) -> Option<u64> {
        Some(self.last / 1000).filter(|last| *last > 0)
    }

    /// The frames with their last byte in this part of the record.
    pub fn read(&mut self, record: &[Entry]) -> Vec<Frame> {
        let frame = |frame: control::Frame| Frame {
            at: frame.start / 1000,
            arrived: frame.delivered,
            sent: ecus::sent(&frame),
        };
        self.frames.read(record).map(frame).collect()
    }
}

/// Whether a set with this Data 1 is an alternate one (AMT-2).
fn is_alternate(data_1: u8) -> bool {
    data_1 != 0 && data_1 & 7 == 0 || OLD_ENGINES.contains(&data_1)
}

#[test]
fn an_alternate_set_is_known_by_its_second_byte() {
    // Error, alternate, running, alternate of an older ECU.
    let sets = [0u8, 0x18, 0x64, 0x06].into_iter().enumerate().flat_map(|(n, data_1)| {
        let at = n as u64 * 125_000_000;
        Entry::delivered(Direction::ToNode, at, 4_000_000, &[0xFF, data_1, 0x28, 0xBE, 0xBD, 0x89])
    });
    // The last one ends with the next byte.
    let next = Entry::delivered(Direction::ToNode, 500_000_000, 4_000_000, &[0xFF]);
    let mut reader = Reader::new(Protocol::Amt);
    reader.ends_of_sets(&sets.chain(next).collect::<Vec<_>>());
    assert_eq!(reader.alternate, [149_000, 399_000]);
}

#[test]
fn what_follows_the_head_of_a_set_without_a_pause_completes_it() {
    const BYTE: u64 = 4_166_667;
    let bytes = |at: u64, bytes: &[u8]| Entry::delivered(Direction::ToNode, at, BYTE, bytes);
    let ends = |record: &[Entry]| Reader::new(Protocol::Amt).ends_of_sets(record);
    let set = bytes(0, &[0xFF, 4, 0, 0, 0, 0]);
    let whole = 6 * BYTE / 1000;
    // A set, and its head with 12 other bytes after it, 125 ms later.
    let others = |head: u8| [&[head], [0x55, 0x10, 0].repeat(4).as_slice()].concat();
    let broken = |head: u8| [set.clone(), bytes(125_000_000, &others(head))].concat();
    assert_eq!(ends(&broken(0xFF)), [whole, 125_000 + whole]);
    // Without the head they are no set.
    assert_eq!(ends(&broken(0x55)), [whole]);
}
