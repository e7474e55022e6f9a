//! Destination of text for people: the standard output, unless a file of the run uses it.

use super::fit::ascii;
use std::io::{self, ErrorKind, Write};

/// Destination and character set.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Out {
    /// Where.
    pub to: Stream,
    /// ASCII only.
    pub ascii: bool,
}

/// One of the two.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Stream {
    /// The standard output.
    Stdout,
    /// The standard error.
    Stderr,
}

impl Out {
    /// Writes it all.
    pub fn write(self, text: &str) -> io::Result<()> {
        let converted;
        let text = if self.ascii {
            converted = ascii(text);
            &converted
        } else {
            text
        };
        match self.to {
            Stream::Stdout => {
                let mut out = io::stdout().lock();
                out.write_all(text.as_bytes())?;
                out.flush()
            }
            Stream::Stderr => io::stderr().lock().write_all(text.as_bytes()),
        }
    }

    /// Error message for a failed write.
    pub fn cannot_write(self, error: &io::Error) -> String {
        let name = match self.to {
            Stream::Stdout => "standard output",
            Stream::Stderr => "standard error",
        };
        format!("cannot write to the {name}: {error}")
    }
}

/// Whether the reader has closed the output, as `head` does: not a failure.
pub fn reader_left(error: &io::Error) -> bool {
    error.kind() == ErrorKind::BrokenPipe
}
