//! One counter for every rule that waits for consecutive frames or values that agree.

/// Consecutive reports, or values beyond a limit, that have to agree.
pub(crate) const AGREEING: u8 = 2;

/// Number of consecutive values that agree, up to 255.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(crate) struct Consecutive(u8);

impl Consecutive {
    /// No value yet.
    pub const NONE: Self = Self(0);
    /// As many as have to agree.
    pub const AGREE: Self = Self(AGREEING);

    /// Counts a value that agrees; any other resets the counter to 0.
    pub const fn count(&mut self, agrees: bool) {
        self.0 = if agrees { self.0.saturating_add(1) } else { 0 };
    }

    /// Counts a value that agrees with the previous one; any other resets the counter to 1.
    pub const fn count_with_last(&mut self, agrees: bool) {
        self.0 = if agrees { self.0.saturating_add(1) } else { 1 };
    }

    /// Resets the counter to 0.
    pub const fn reset(&mut self) {
        self.0 = 0;
    }

    /// Whether exactly this many agree: true once in a sequence.
    pub const fn is(self, number: u8) -> bool {
        self.0 == number
    }

    /// Whether at least this many agree.
    pub const fn reached(self, number: u8) -> bool {
        self.0 >= number
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_consecutive_values_count() {
        let mut values = Consecutive::NONE;
        for (agrees, reached) in [(true, false), (true, true), (false, false), (true, false), (true, true)] {
            values.count(agrees);
            assert_eq!(values.reached(2), reached);
        }
    }

    #[test]
    fn a_value_that_differs_is_the_first_of_its_own() {
        let mut values = Consecutive::NONE;
        values.count_with_last(false);
        assert!(values.reached(1) && !values.reached(2));
        values.count_with_last(true);
        assert!(values.reached(2));
        values.count_with_last(false);
        assert!(values.reached(1) && !values.reached(2));
    }

    #[test]
    fn the_count_does_not_begin_again_at_255() {
        let mut values = Consecutive::NONE;
        for _ in 0..300 {
            values.count(true);
        }
        assert!(values.reached(u8::MAX));
    }
}
