//! The firmware's log: taken from its RTT buffer as by a debug probe, and decoded to text.

use defmt_decoder::Table;
use rigless::emulator::Host;
use rigless::soc::Width;

/// A line of the firmware's log.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Log {
    /// When its last byte was in the buffer.
    pub at: u64,
    /// `error`, `warn`, `info`.
    pub level: String,
    /// The text.
    pub text: String,
}

/// Offset of RTT's up-channel 0 in its control block, after 16 bytes of name and two counts. It has name,
/// buffer, size, write offset and read offset.
const UP: u64 = 24;

/// Address of the write offset of RTT's up-channel 0: a store there is a log line, or part of one.
pub const fn write_offset(block: u64) -> u64 {
    UP + 12 + block
}

/// Takes the bytes in the buffer, through the emulated memory.
pub fn drain(block: u64, host: &mut dyn Host) -> Vec<u8> {
    let mut word = |offset: u64| host.read(block + UP + offset, Width::W32).unwrap_or(0);
    let (buffer, size, write, mut read) = (word(4), word(8), word(12), word(16));
    let mut bytes = Vec::new();
    if size == 0 || write >= size {
        return bytes; // not yet set up
    }
    while read != write {
        bytes.push(host.read(buffer + read, Width::W8).expect("the buffer is RAM") as u8);
        read = (read + 1) % size;
    }
    host.write(block + UP + 16, Width::W32, read).expect("the block is RAM");
    bytes
}

/// Decodes bytes to lines. Skips frames that a reset has cut off.
pub fn decode(table: &Table, chunks: &[(u64, Vec<u8>)]) -> Vec<Log> {
    let mut logs = Vec::new();
    let mut decoder = table.new_stream_decoder();
    for (at, bytes) in chunks {
        decoder.received(bytes);
        while let Ok(frame) = decoder.decode() {
            logs.push(line(*at, &frame));
        }
    }
    logs
}

/// One line.
pub fn line(at: u64, frame: &defmt_decoder::Frame<'_>) -> Log {
    let level = frame.level().map_or("", |level| level.as_str()).to_string();
    Log { at, level, text: frame.display_message().to_string() }
}
