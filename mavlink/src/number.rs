//! Whole numbers in floating-point fields.

/// A whole number that a 32-bit floating-point field carries exactly; `None` for fractions, NaN and larger numbers.
#[inline(never)]
pub(crate) fn whole(value: f32) -> Option<i32> {
    // A cast saturates, and NaN becomes 0, which is not equal to it.
    let number = value as i32;
    (number as f32 == value && number.unsigned_abs() <= 1 << 24).then_some(number)
}

#[cfg(test)]
mod tests {
    use super::whole;

    #[test]
    fn only_what_is_exact_is_a_number() {
        let good = [0.0, -0.0, -1.0, 16_777_216.0];
        assert_eq!(good.map(whole), [Some(0), Some(0), Some(-1), Some(16_777_216)]);
        for value in [0.5, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 16_777_218.0, -3e9, f32::MIN_POSITIVE]
        {
            assert_eq!(whole(value), None, "{value}");
        }
    }
}
