//! How `jetlink decode` writes numbers and bytes in JSON.

use serde::{Serialize, Serializer};
use std::fmt;

/// A number of tenths.
pub fn tenths(value: impl Into<i64>) -> Decimal {
    Decimal { units: value.into(), places: 1 }
}

/// A number of thousandths.
pub fn thousandths(value: u32) -> Decimal {
    Decimal { units: value.into(), places: 3 }
}

/// A decimal number, exact.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Decimal {
    /// The number in units of its last place.
    units: i64,
    /// Places after the point.
    places: i32,
}

/// Without zeros at its end, and as a whole number without a point.
impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let one = 10_u64.pow(self.places.unsigned_abs());
        let (whole, mut rest) = (self.units.unsigned_abs() / one, self.units.unsigned_abs() % one);
        write!(f, "{}{whole}", if self.units < 0 { "-" } else { "" })?;
        if rest == 0 {
            return Ok(());
        }
        let mut places = self.places as usize;
        while rest.is_multiple_of(10) {
            (rest, places) = (rest / 10, places - 1);
        }
        write!(f, ".{rest:0places$}")
    }
}

impl Serialize for Decimal {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        // The number next to an exact quotient of up to 15 digits is written with its digits.
        Float(self.units as f64 / 10_f64.powi(self.places)).serialize(serializer)
    }
}

/// A floating-point number: the shortest decimals that read back the same, and whole numbers without a point.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Float(pub f64);

impl Serialize for Float {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.0.fract() == 0.0 {
            serializer.serialize_i64(self.0 as i64)
        } else {
            serializer.serialize_f64(self.0)
        }
    }
}

/// Bytes as hexadecimal digits.
pub struct Hex<'a>(pub &'a [u8]);

impl fmt::Display for Hex<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl Serialize for Hex<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_as_people_write_them() {
        let json = |value: &dyn Fn() -> serde_json::Result<String>| value().unwrap();
        let floats = [0.0, -50.0, 51.0, 131_070.0, 6.25 / 255.0].map(Float);
        let numbers = [
            json(&|| serde_json::to_string(&floats)),
            json(&|| serde_json::to_string(&[-500, -3, 0, 123, 510].map(tenths))),
            json(&|| serde_json::to_string(&[0, 7, 20, 1001, 12_340, 1_638_300].map(thousandths))),
        ];
        assert_eq!(
            numbers.join(" "),
            "[0,-50,51,131070,0.024509803921568627] [-50,-0.3,0,12.3,51] [0,0.007,0.02,1.001,12.34,1638.3]"
        );
    }
}
