//! What has to survive a reset: the order in force, its demand and its source, in memory that start-up does not
//! clear. Two copies with a checksum and a sequence number, so that a reset in the middle of a write leaves the
//! one before.

use crate::command::{Demand, Order, Origin};
use crate::telemetry::LossStage;
use crate::units::{Rpm, Throttle};
use core::sync::atomic::{AtomicU32, Ordering};
use crc::{CRC_32_ISO_HDLC, Crc};

const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);
/// Changes with the layout, so that an older firmware's memory is not believed.
const LAYOUT: u32 = 0x4A4C_0003;
const WORDS: usize = 5;

/// What is kept of one engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub struct Record {
    /// The order in force. A latched emergency stop is one.
    pub order: Order,
    /// Whose it was.
    pub origin: Origin,
    /// Whether the engine was armed.
    pub armed: bool,
    /// A limit was passed whose action is the fail-safe throttle: it stays there until standby is commanded.
    pub limited: bool,
    /// How far the loss of the source had gone: one that was lost has to speak for a while before it rules again.
    pub loss: LossStage,
    /// The engine ran, and stopped or fell silent without a command: the other engines are told.
    pub failed: bool,
}

impl Record {
    /// An order of somebody, and nothing else.
    pub const fn new(order: Order, origin: Origin) -> Self {
        Self { order, origin, armed: false, limited: false, loss: LossStage::None, failed: false }
    }
}

/// Memory for one engine's record. Place it where start-up does not clear it; what it holds after a power-up is
/// then arbitrary, and not believed.
#[derive(Debug)]
pub struct Memory {
    copies: [[AtomicU32; WORDS]; 2],
}

impl Default for Memory {
    fn default() -> Self {
        Self::new()
    }
}

impl Memory {
    /// Empty.
    pub const fn new() -> Self {
        Self { copies: [const { [const { AtomicU32::new(0) }; WORDS] }; 2] }
    }

    /// The newer of the two copies that are whole.
    pub fn load(&self) -> Option<Record> {
        let (_, words) = self.newest()?;
        unpack(words)
    }

    /// Keeps a record, over the older copy.
    pub fn store(&self, record: &Record) {
        let (place, sequence) = match self.newest() {
            Some((place, words)) => (1 - place, words[1].wrapping_add(1)),
            None => (0, 0),
        };
        let words = pack(record, sequence);
        if let Some(copy) = self.copies.get(place) {
            for (slot, word) in copy.iter().zip(words) {
                // Release keeps the order of writes for whoever looks after a reset in between.
                slot.store(word, Ordering::Release);
            }
        }
        // An H7 keeps the last half of a 64-bit word, the unit of its RAM's checksum, in a buffer until the next
        // write elsewhere; a reset before that loses it. So the other copy is written with what it holds.
        if let Some(word) = self.copies.get(1 - place).and_then(|copy| copy.first()) {
            word.store(word.load(Ordering::Acquire), Ordering::Release);
        }
    }

    /// Forgets: the next start begins from nothing.
    pub fn clear(&self) {
        for word in self.copies.iter().flatten() {
            word.store(0, Ordering::Release);
        }
    }

    fn newest(&self) -> Option<(usize, [u32; WORDS])> {
        let whole = |place: usize| {
            let words = self.copies.get(place)?.each_ref().map(|word| word.load(Ordering::Acquire));
            (words[0] == LAYOUT && words[WORDS - 1] == checksum(&words)).then_some((place, words))
        };
        match (whole(0), whole(1)) {
            (Some(a), Some(b)) => {
                // The sequence wraps: the newer is ahead by less than half the range.
                let b_is_newer = b.1[1].wrapping_sub(a.1[1]) < u32::MAX / 2;
                Some(if b_is_newer { b } else { a })
            }
            (a, b) => a.or(b),
        }
    }
}

fn checksum(words: &[u32; WORDS]) -> u32 {
    let mut digest = CRC.digest();
    for word in words.iter().take(WORDS - 1) {
        digest.update(&word.to_le_bytes());
    }
    digest.finalize()
}

fn pack(record: &Record, sequence: u32) -> [u32; WORDS] {
    let (order, value) = match record.order {
        Order::EmergencyStop => (1, 0),
        Order::Standby => (2, 0),
        Order::Run(Demand::Throttle(throttle)) => (3, u32::from(throttle.tenths())),
        Order::Run(Demand::Rpm(rpm)) => (4, rpm.get()),
        Order::Pwm => (5, 0),
        Order::Listen => (6, 0),
    };
    let flags = order
        | u32::from(record.origin.priority()) << 8
        | u32::from(record.armed) << 16
        | u32::from(record.limited) << 17
        | u32::from(record.failed) << 18
        | (record.loss as u32) << 20;
    let mut words = [LAYOUT, sequence, flags, value, 0];
    words[WORDS - 1] = checksum(&words);
    words
}

fn unpack([_, _, flags, value, _]: [u32; WORDS]) -> Option<Record> {
    let order = match flags & 0xFF {
        1 => Order::EmergencyStop,
        2 => Order::Standby,
        3 => Order::Run(Demand::Throttle(Throttle::from_tenths(u16::try_from(value).ok()?).ok()?)),
        4 => Order::Run(Demand::Rpm(Rpm::new(value))),
        5 => Order::Pwm,
        6 => Order::Listen,
        _ => return None,
    };
    let priority = flags >> 8 & 0xFF;
    let origin = Origin::ALL.into_iter().find(|origin| u32::from(origin.priority()) == priority)?;
    let loss = match flags >> 20 {
        0 => LossStage::None,
        1 => LossStage::Hold,
        2 => LossStage::FailSafe,
        3 => LossStage::Standby,
        _ => return None,
    };
    let flag = |bit: u32| flags >> bit & 1 == 1;
    Some(Record { order, origin, armed: flag(16), limited: flag(17), failed: flag(18), loss })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(tenths: u16) -> Record {
        let order = Order::Run(Demand::Throttle(Throttle::from_tenths(tenths).unwrap()));
        Record { armed: true, ..Record::new(order, Origin::Rc) }
    }

    #[test]
    fn every_order_and_source_comes_back() {
        let memory = Memory::new();
        assert_eq!(memory.load(), None, "empty");
        let orders = [Order::EmergencyStop, Order::Standby, run(637).order, Order::Pwm, Order::Listen];
        for order in orders.into_iter().chain([Order::Run(Demand::Rpm(Rpm::new(123_450)))]) {
            for origin in Origin::ALL {
                let stages = [LossStage::None, LossStage::Hold, LossStage::FailSafe, LossStage::Standby];
                for (flags, loss) in (0..8).flat_map(|flags| stages.map(|loss| (flags, loss))) {
                    let [armed, limited, failed] = [flags & 1, flags & 2, flags & 4].map(|flag| flag != 0);
                    let record = Record { order, origin, armed, limited, loss, failed };
                    memory.store(&record);
                    assert_eq!(memory.load(), Some(record));
                }
            }
        }
    }

    #[test]
    fn a_write_that_was_cut_short_leaves_the_record_before() {
        // After each number of words written, in each of the two places.
        for before in [run(100), run(200)] {
            for words in 0..WORDS {
                let memory = Memory::new();
                memory.store(&run(50));
                memory.store(&before);
                let (place, newest) = memory.newest().unwrap();
                let next = pack(&run(900), newest[1].wrapping_add(1));
                for (slot, word) in memory.copies[1 - place].iter().zip(next).take(words) {
                    slot.store(word, Ordering::Relaxed);
                }
                assert_eq!(memory.load(), Some(before), "{words} words");
            }
        }
    }

    #[test]
    fn one_flipped_bit_is_not_believed() {
        for bit in 0..WORDS * 32 {
            let memory = Memory::new();
            memory.store(&run(500));
            let (place, _) = memory.newest().unwrap();
            memory.copies[place][bit / 32].fetch_xor(1 << (bit % 32), Ordering::Relaxed);
            assert_eq!(memory.load(), None, "bit {bit}");
        }
    }

    #[test]
    fn the_sequence_wraps() {
        let memory = Memory::new();
        for (copy, sequence, tenths) in [(0, u32::MAX, 1), (1, 0, 2)] {
            for (slot, word) in memory.copies[copy].iter().zip(pack(&run(tenths), sequence)) {
                slot.store(word, Ordering::Relaxed);
            }
        }
        assert_eq!(memory.load(), Some(run(2)));
    }
}
