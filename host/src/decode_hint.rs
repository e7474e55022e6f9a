//! What the other protocol would find in the same bytes, for anyone who named the wrong one.

use crate::telemetry::decoder::Decoder;
use std::fmt;

/// What the other protocol would find shows in the beginning: a long input is not decoded twice.
const READS_ALONG: u64 = 1024 * 1024;

/// Another protocol, reading along.
#[derive(Debug)]
pub struct Other {
    decoder: Box<dyn Decoder>,
    frames: u64,
    bytes: u64,
    in_frames: u64,
}

impl Other {
    /// This decoder reads along.
    pub fn new(decoder: Box<dyn Decoder>) -> Self {
        Self { decoder, frames: 0, bytes: 0, in_frames: 0 }
    }

    /// Takes what was read.
    pub fn feed(&mut self, bytes: &[u8]) {
        let left = usize::try_from(READS_ALONG - self.bytes).unwrap_or(usize::MAX);
        let mut bytes = &bytes[..bytes.len().min(left)];
        self.bytes += bytes.len() as u64;
        while !bytes.is_empty() {
            let (taken, length) = self.decoder.next_length(bytes);
            bytes = &bytes[taken..];
            if let Some(length) = length {
                self.frames += 1;
                self.in_frames += length as u64;
            }
        }
    }
}

/// Most of the bytes belonged to no frame.
#[derive(Debug)]
pub struct Hint {
    tried: &'static str,
    bytes: u64,
    outside: u64,
    other: &'static str,
    other_frames: u64,
    other_bytes: u64,
    other_outside: u64,
}

impl Hint {
    /// Where over half of all bytes lie outside of every frame. It names the protocol that would find most.
    pub fn of(bytes: u64, outside: u64, tried: &'static str, others: Vec<Other>) -> Option<Self> {
        let other = others.into_iter().max_by_key(|other| other.in_frames)?;
        (outside * 2 > bytes).then(|| Self {
            tried,
            bytes,
            outside,
            other: other.decoder.name(),
            other_frames: other.frames,
            other_bytes: other.bytes,
            other_outside: other.bytes - other.in_frames - other.decoder.pending() as u64,
        })
    }
}

/// A share in %: 0 and 100 are exact, others have a tenth.
fn percent(part: u64, of: u64) -> String {
    match part {
        0 => "0".to_owned(),
        _ if part == of => "100".to_owned(),
        _ => format!("{:.1}", (part as f64 * 100.0 / of as f64).clamp(0.1, 99.9)),
    }
}

impl fmt::Display for Hint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "hint: {} % of the bytes are in no {} frame; --protocol {} would find {} frames and leave {} %",
            percent(self.outside, self.bytes),
            self.tried,
            self.other,
            self.other_frames,
            percent(self.other_outside, self.other_bytes)
        )?;
        if self.other_bytes < self.bytes {
            write!(f, " of the first {} bytes", self.other_bytes)?;
        }
        if self.other_outside * 2 > self.other_bytes {
            write!(f, ": check the baud rate, the stop bits and the levels of the line")?;
        }
        Ok(())
    }
}
