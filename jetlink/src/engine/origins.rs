//! Sets of origins of commands.

use crate::command::Origin;

/// A set of origins. The bit of each is its priority.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Origins(u8);

impl Origins {
    /// None of them.
    pub const NONE: Self = Self(0);

    const fn only(origin: Origin) -> Self {
        Self(1 << origin.priority())
    }

    /// The set with these bits. Those of no origin are ignored.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & ((1 << Origin::ALL.len()) - 1))
    }

    /// Its bits.
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// Whether this origin is in it.
    pub const fn contains(self, origin: Origin) -> bool {
        self.0 & Self::only(origin).0 != 0
    }

    /// Adds an origin.
    pub const fn insert(&mut self, origin: Origin) {
        self.0 |= Self::only(origin).0;
    }

    /// Adds all of another set.
    pub const fn insert_all(&mut self, others: Self) {
        self.0 |= others.0;
    }

    /// Removes an origin.
    pub const fn remove(&mut self, origin: Origin) {
        self.0 &= !Self::only(origin).0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_origin_is_in_the_set_alone_and_by_its_bit() {
        for (place, origin) in Origin::ALL.into_iter().enumerate() {
            let mut set = Origins::NONE;
            set.insert(origin);
            assert_eq!(set.bits(), 1 << place);
            assert_eq!(Origins::from_bits(set.bits() | 0xE0), set, "bits of no origin are ignored");
            for other in Origin::ALL {
                assert_eq!(set.contains(other), other == origin, "{origin} {other}");
            }
            let mut all = Origins::from_bits(0xFF);
            all.remove(origin);
            assert!(!all.contains(origin) && all.bits().count_ones() == 4);
            all.insert_all(set);
            assert_eq!(all, Origins::from_bits(0xFF));
        }
    }
}
