//! From values to places, and the values at which an axis has its marks.

use core::ops::Range;

/// An axis.
#[derive(Clone, Debug)]
pub struct Scale {
    values: Range<f64>,
    places: Range<f64>,
}

impl Scale {
    /// These values lie at these places; the places may run backwards.
    pub const fn new(values: Range<f64>, places: Range<f64>) -> Self {
        Self { values, places }
    }

    /// Where a value lies.
    pub fn at(&self, value: f64) -> f64 {
        let share = (value - self.values.start) / (self.values.end - self.values.start);
        self.places.start + share * (self.places.end - self.places.start)
    }

    /// Round values, about this number.
    pub fn marks(&self, about: usize) -> Vec<f64> {
        let span = self.values.end - self.values.start;
        let rough = span / about.max(1) as f64;
        let power = 10_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|times| times * power);
        let step = step.into_iter().find(|step| *step >= rough).unwrap_or(power * 10.0);
        let first = (self.values.start / step).ceil() as i64;
        let last = (self.values.end / step + 1e-9).floor() as i64;
        (first..=last).map(|i| i as f64 * step).collect()
    }
}

/// `108 500`, with spaces that do not break.
pub fn thousands(value: f64) -> String {
    let digits = format!("{value:.0}");
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push('\u{a0}');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_round_and_within() {
        let scale = Scale::new(0.0..117_180.0, 200.0..0.0);
        assert_eq!(scale.marks(5), [0.0, 50_000.0, 100_000.0]);
        assert_eq!((scale.at(0.0), scale.at(58_590.0)), (200.0, 100.0));
        assert_eq!(Scale::new(71.0..204.0, 0.0..1.0).marks(8).first(), Some(&80.0));
    }

    #[test]
    fn digits_are_grouped_in_threes() {
        for (value, text) in
            [(0.0, "0"), (950.4, "950"), (96_000.0, "96\u{a0}000"), (1e6, "1\u{a0}000\u{a0}000")]
        {
            assert_eq!(thousands(value), text);
        }
    }
}
