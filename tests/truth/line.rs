//! A line between pilots behind MAVLink and the node: frames arrive late, damaged, twice, or not at all, but never out of
//! order.

use crate::history::{MS, SECOND};
use crate::pilots::Rng;
use std::collections::VecDeque;

/// How good a line is.
#[derive(Clone, Copy, Debug)]
pub struct Quality {
    /// Frames that are lost, damaged, and duplicated; per mille.
    pub lost: u64,
    pub damaged: u64,
    pub twice: u64,
    /// Chance that a frame is delayed, with all frames after it; per mille.
    pub held: u64,
}

/// A frame in transit, and its meaning.
#[derive(Clone, Debug)]
pub struct InFlight<T> {
    pub sent: u64,
    pub due: u64,
    pub bytes: Vec<u8>,
    /// `None`: it is damaged.
    pub meaning: Option<T>,
    /// It is the same frame as the one before.
    pub copy: bool,
}

#[derive(Debug)]
pub struct Line<T> {
    quality: Quality,
    /// No frame arrives before.
    held_until: u64,
    frames: VecDeque<InFlight<T>>,
}

impl<T: Clone> Line<T> {
    pub const fn new(quality: Quality) -> Self {
        Self { quality, held_until: 0, frames: VecDeque::new() }
    }

    /// Time of the next arrival.
    pub fn next(&self) -> u64 {
        self.frames.front().map_or(u64::MAX, |frame| frame.due)
    }

    /// The next frame that has arrived.
    pub fn arrived(&mut self, now: u64) -> Option<InFlight<T>> {
        self.frames.pop_front_if(|frame| frame.due <= now)
    }

    /// Frames in transit are lost: the sender went down.
    pub fn clear(&mut self) {
        self.frames.clear();
    }

    pub fn send(&mut self, rng: &mut Rng, now: u64, mut bytes: Vec<u8>, meaning: T) {
        let Quality { lost, damaged, twice, held } = self.quality;
        if rng.below(1000) < held {
            self.held_until = now + rng.spread(50 * MS, 3 * SECOND);
        }
        let due = (now + rng.between(2 * MS, 25 * MS)).max(self.held_until);
        let due = self.frames.back().map_or(due, |last| last.due.max(due));
        if rng.below(1000) < lost {
            return;
        }
        let is_damaged = rng.below(1000) < damaged;
        if is_damaged {
            match rng.below(3) {
                // Bytes at its end are lost.
                0 => bytes.truncate(rng.between(1, bytes.len() as u64) as usize),
                // Or some in its middle.
                1 => {
                    let from = rng.below(bytes.len() as u64) as usize;
                    let to = (from + rng.between(1, 9) as usize).min(bytes.len());
                    drop(bytes.drain(from..to));
                }
                _ => {
                    let at = rng.below(bytes.len() as u64) as usize;
                    bytes[at] ^= rng.between(1, 256) as u8;
                }
            }
        }
        let meaning = (!is_damaged).then_some(meaning);
        let frame = InFlight { sent: now, due, bytes, meaning, copy: false };
        let copy = !is_damaged && rng.below(1000) < twice;
        let copy = copy.then(|| InFlight { copy: true, ..frame.clone() });
        self.frames.push_back(frame);
        self.frames.extend(copy);
    }
}
