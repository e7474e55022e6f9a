//! A record of the commands that an ECU has accepted, with the times at which they were complete.

use std::collections::VecDeque;

use crate::ecu::Nanos;

/// The last accepted commands. Bounded, so that long runs do not exhaust the memory.
#[derive(Clone, Debug)]
pub struct CommandLog<C> {
    entries: VecDeque<(Nanos, C)>,
    capacity: usize,
    total: u64,
}

impl<C> CommandLog<C> {
    /// Stores the last `capacity` commands; none with 0.
    pub fn new(capacity: usize) -> Self {
        Self { entries: VecDeque::new(), capacity, total: 0 }
    }

    /// Stores a command.
    pub fn push(&mut self, at: Nanos, command: C) {
        self.total += 1;
        if self.capacity == 0 {
            return;
        }
        if self.entries.len() == self.capacity {
            self.entries.pop_front();
        }
        self.entries.push_back((at, command));
    }

    /// Number of all commands so far, including those no longer stored.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// The stored commands, oldest first.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &(Nanos, C)> {
        self.entries.iter()
    }

    /// The latest.
    pub fn last(&self) -> Option<&(Nanos, C)> {
        self.entries.back()
    }

    /// Clears the stored commands; the total continues.
    pub fn clear(&mut self) {
        self.entries.clear();
    }
}

impl<C: Copy> CommandLog<C> {
    /// The commands without their times, oldest first.
    pub fn commands(&self) -> Vec<C> {
        self.entries.iter().map(|&(_, command)| command).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_keeps_the_last_ones_and_counts_all() {
        let mut log = CommandLog::new(2);
        for i in 0..5 {
            log.push(i, i * 10);
        }
        assert_eq!(log.commands(), [30, 40]);
        assert_eq!(log.last(), Some(&(4, 40)));
        assert_eq!(log.total(), 5);

        let mut none = CommandLog::new(0);
        none.push(1, 1);
        assert_eq!((none.total(), none.last()), (1, None));
    }
}
