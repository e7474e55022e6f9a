//! One JSON object a line, written without an allocation per field.

use std::fmt;
use std::io::Write;

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
    places: u32,
}

/// Without zeros at its end, and as a whole number without a point.
impl fmt::Display for Decimal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let one = 10_u64.pow(self.places);
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

/// One line of output; its buffer is reused for the next.
///
/// Written by hand, as `serde_json::Value` would allocate some twenty times per frame, and print whole
/// numbers among the decimals as `51.0`. Writing to a `Vec` does not fail.
#[derive(Default, Debug)]
pub struct Record(Vec<u8>);

impl Record {
    /// Begins the record of a frame that ends at this offset of the input.
    pub fn begin(&mut self, end: u64, protocol: &'static str, frame: &'static str, raw: &[u8]) {
        self.0.clear();
        self.field("offset", end - raw.len() as u64);
        self.field("protocol", protocol);
        self.field("frame", frame);
        self.key("raw");
        self.0.push(b'"');
        for byte in raw {
            for digit in [byte >> 4, byte & 0x0F] {
                self.0.push(b"0123456789abcdef"[usize::from(digit)]);
            }
        }
        self.0.push(b'"');
    }

    /// `key` must need no escapes; all of ours are literals without any.
    fn key(&mut self, key: &str) {
        self.0.push(if self.0.is_empty() { b'{' } else { b',' });
        self.0.push(b'"');
        self.0.extend_from_slice(key.as_bytes());
        self.0.extend_from_slice(b"\":");
    }

    /// Adds a field.
    pub fn field(&mut self, key: &str, value: impl Json) {
        self.key(key);
        value.append_to(&mut self.0);
    }

    /// Adds an array of texts.
    pub fn texts(&mut self, key: &str, values: impl Iterator<Item = &'static str>) {
        self.key(key);
        self.0.push(b'[');
        for (i, value) in values.enumerate() {
            if i > 0 {
                self.0.push(b',');
            }
            value.append_to(&mut self.0);
        }
        self.0.push(b']');
    }

    /// The line, with its end.
    pub fn line(&mut self) -> &[u8] {
        self.0.extend_from_slice(b"}\n");
        &self.0
    }
}

/// A value of a field.
pub trait Json {
    /// Appends it as JSON.
    fn append_to(&self, json: &mut Vec<u8>);
}

macro_rules! json_as_displayed {
    ($($type:ty),+) => {
        $(impl Json for $type {
            fn append_to(&self, json: &mut Vec<u8>) {
                let _ = write!(json, "{self}");
            }
        })+
    };
}
// Rust's display is valid JSON: for f64 the shortest decimals that read back the same, without exponent,
// whole numbers without a point. All of ours are finite, and none is -0.
json_as_displayed!(bool, u8, u32, u64, i32, f64, Decimal);

/// A literal of this program or of the codecs: none needs an escape.
impl Json for &'static str {
    fn append_to(&self, json: &mut Vec<u8>) {
        json.push(b'"');
        json.extend_from_slice(self.as_bytes());
        json.push(b'"');
    }
}

/// A text from the wire, which may contain anything.
pub struct Escaped<'a>(pub &'a str);

impl Json for Escaped<'_> {
    fn append_to(&self, json: &mut Vec<u8>) {
        let _ = serde_json::to_writer(json, self.0);
    }
}

impl<T: Json> Json for Option<T> {
    fn append_to(&self, json: &mut Vec<u8>) {
        match self {
            Some(value) => value.append_to(json),
            None => json.extend_from_slice(b"null"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_as_people_write_them() {
        let mut json = Vec::new();
        for value in [0.0, -50.0, 51.0, 131_070.0, 6.25 / 255.0] {
            value.append_to(&mut json);
            json.push(b' ');
        }
        for value in [-500, -3, 0, 123, 510].map(tenths) {
            value.append_to(&mut json);
            json.push(b' ');
        }
        for value in [0, 7, 20, 1001, 12_340, 1_638_300].map(thousandths) {
            value.append_to(&mut json);
            json.push(b' ');
        }
        assert_eq!(
            String::from_utf8(json).unwrap(),
            "0 -50 51 131070 0.024509803921568627 -50 -0.3 0 12.3 51 0 0.007 0.02 1.001 12.34 1638.3 "
        );
    }
}
