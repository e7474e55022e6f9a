//! The compile error for a wrong table of engines, composed in a constant, where `format!` is not available.

/// Largest length of a sentence in bytes. Longer ones are cut off.
const LENGTH: usize = 256;

/// A sentence about an engine of a table.
#[derive(Clone, Copy, Debug)]
pub struct Sentence {
    bytes: [u8; LENGTH],
    length: usize,
}

impl Sentence {
    /// Begins with the engine. `row` of the table counts from 0; the sentence counts from 1.
    pub const fn of_engine(row: usize, name: &str) -> Self {
        let begin = Self { bytes: [0; LENGTH], length: 0 };
        begin.text("row ").number(row + 1).text(" of the table of engines, `").text(name).text("`: ")
    }

    /// Appends this text.
    pub const fn text(mut self, text: &str) -> Self {
        let text = text.as_bytes();
        let mut i = 0;
        while i < text.len() && self.length < LENGTH {
            self.bytes[self.length] = text[i];
            self.length += 1;
            i += 1;
        }
        self
    }

    /// Appends this number.
    pub const fn number(self, number: usize) -> Self {
        let before = if number < 10 { self } else { self.number(number / 10) };
        let digit = [b'0' + (number % 10) as u8];
        match str::from_utf8(&digit) {
            Ok(digit) => before.text(digit),
            Err(_) => before,
        }
    }

    /// The text, cut off at the largest length.
    pub const fn as_str(&self) -> &str {
        let (text, _) = self.bytes.split_at(self.length);
        match str::from_utf8(text) {
            Ok(text) => text,
            Err(cut) => match str::from_utf8(text.split_at(cut.valid_up_to()).0) {
                Ok(text) => text,
                Err(_) => "the table of engines is wrong",
            },
        }
    }
}
