//! Other readings of the same bytes, for a user who named the wrong protocol or captured the wrong line: frames of the
//! other protocol, or commands to an ECU.

use crate::telemetry::decoder::Decoder;
use crate::telemetry::{Hints, Protocol};
use sim::control::Command;
use std::fmt;

/// Number of bytes that the other protocols also decode: the beginning of a long input suffices.
const READS_ALONG: u64 = 1024 * 1024;

/// The other decoders, and the readers of commands.
#[derive(Debug)]
pub struct Beside {
    others: Vec<Other>,
    commands: Vec<Commands>,
}

impl Beside {
    /// All decoders other than this one.
    pub fn new(tried: Protocol) -> Self {
        Self {
            others: tried.others().map(Other::new).collect(),
            commands: Protocol::all().map(Commands::new).collect(),
        }
    }

    /// Takes what was read.
    pub fn feed(&mut self, bytes: &[u8]) {
        self.others.iter_mut().for_each(|other| other.feed(bytes));
        self.commands.iter_mut().for_each(|commands| commands.feed(bytes));
    }
}

/// Commands to an ECU of one protocol, among the bytes that are read along.
#[derive(Debug)]
struct Commands {
    protocol: Protocol,
    /// The possible beginning of a command.
    pending: Vec<u8>,
    frames: u64,
    bytes: u64,
    in_frames: u64,
}

impl Commands {
    const fn new(protocol: Protocol) -> Self {
        Self { protocol, pending: Vec::new(), frames: 0, bytes: 0, in_frames: 0 }
    }

    fn feed(&mut self, bytes: &[u8]) {
        let left = usize::try_from(READS_ALONG - self.bytes).unwrap_or(usize::MAX);
        let protocol = self.protocol.on_wire();
        let length = protocol.control_length();
        for &byte in bytes.iter().take(left) {
            self.bytes += 1;
            self.pending.push(byte);
            if self.pending.len() < length {
                continue;
            }
            if Command::read(protocol, &self.pending).is_ok() {
                self.frames += 1;
                self.in_frames += length as u64;
                self.pending.clear();
            } else {
                self.pending.remove(0);
            }
        }
    }
}

/// Another protocol, reading along.
#[derive(Debug)]
struct Other {
    decoder: Box<dyn Decoder>,
    frames: u64,
    bytes: u64,
    in_frames: u64,
}

impl Other {
    /// This decoder reads along.
    fn new(decoder: Box<dyn Decoder>) -> Self {
        Self { decoder, frames: 0, bytes: 0, in_frames: 0 }
    }

    /// Takes what was read.
    fn feed(&mut self, bytes: &[u8]) {
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

const CHECK_THE_LINE: &str = "check the baud rate, the stop bits and the levels of the line";

/// Most of the bytes belonged to no frame.
#[derive(Debug)]
pub struct Hint {
    tried: &'static str,
    bytes: u64,
    outside: u64,
    found: Found,
}

/// What they are.
#[derive(Debug)]
enum Found {
    /// Frames of another protocol.
    Other { name: &'static str, frames: u64, bytes: u64, outside: u64 },
    /// No frames of this protocol either.
    Nothing { name: &'static str },
    /// Commands to an ECU of this protocol: the other line.
    Commands { name: &'static str, frames: u64, bytes: u64, inside: u64 },
}

impl Hint {
    /// A hint if over half of all bytes are outside any frame. It names the reading that finds most.
    pub fn of(bytes: u64, outside: u64, tried: &'static str, beside: Beside) -> Option<Self> {
        let Beside { others, commands } = beside;
        let other = others.into_iter().max_by_key(|other| other.in_frames)?;
        let commands = commands.into_iter().max_by_key(|commands| commands.in_frames)?;
        let found = if commands.in_frames * 2 > commands.bytes && commands.in_frames > other.in_frames {
            Found::Commands {
                name: commands.protocol.decoder(&Hints::default()).name(),
                frames: commands.frames,
                bytes: commands.bytes,
                inside: commands.in_frames,
            }
        } else {
            let outside = other.bytes - other.in_frames - other.decoder.pending() as u64;
            match (other.frames, other.decoder.name()) {
                // It may still be the beginning of a frame.
                (0, _) if outside * 2 <= other.bytes => return None,
                (0, name) => Found::Nothing { name },
                (frames, name) => Found::Other { name, frames, bytes: other.bytes, outside },
            }
        };
        (outside * 2 > bytes).then_some(Self { tried, bytes, outside, found })
    }
}

/// How many there are.
fn counted(count: u64, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
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
            "hint: {} % of the bytes are in no {} frame",
            percent(self.outside, self.bytes),
            self.tried
        )?;
        let of_the_first = |bytes: u64| match bytes {
            all if all == self.bytes => String::new(),
            bytes => format!(" of the first {bytes} bytes"),
        };
        match self.found {
            Found::Other { name, frames, bytes, outside } => {
                let (share, of) = (percent(outside, bytes), of_the_first(bytes));
                write!(
                    f,
                    "; --protocol {name} would find {} and leave {share} %{of}",
                    counted(frames, "frame")
                )?;
                if outside * 2 > bytes {
                    write!(f, ": {CHECK_THE_LINE}")?;
                }
            }
            Found::Nothing { name } => write!(f, ", nor in one of {name}: {CHECK_THE_LINE}")?,
            Found::Commands { name, frames, bytes, inside } => {
                let (share, of) = (percent(inside, bytes), of_the_first(bytes));
                write!(
                    f,
                    "; {} to an ECU ({name}) have {share} %{of}: decode reads the other line, from the ECU",
                    counted(frames, "command")
                )?;
            }
        }
        Ok(())
    }
}
