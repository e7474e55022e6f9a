//! CRSF: frames with a CRC-8, at 420 000 baud, 8N1, not inverted. A Crossfire receiver sends at 416 666 baud, which a UART at
//! 420 000 baud receives.
//!
//! | byte | contents |
//! |---|---|
//! | 0 | 0xC8, or 0xEE |
//! | 1 | number of bytes that follow, 2 to 62 |
//! | 2 | type: 0x16 channels (22 bytes: 16 with 11 bits each, lowest bit first), 0x14 link statistics (10 bytes) |
//! | last | CRC-8 with the polynomial 0xD5, of type and payload |
//!
//! There is no fail-safe flag: without a link the receiver sends no channels. A receiver that continues sending them, but reports
//! an uplink quality of 0 %, has no link either.

use crate::channels::{Channels, PACKED, Pulse, unpack};
use crate::confirm::Confirm;
use crate::count::count;
use crc::{CRC_8_DVB_S2, Crc};
use embassy_time::{Duration, Instant};
use heapless::Vec;

/// Baud rate; 8N1.
pub const BAUD: u32 = 420_000;
/// Longest frame in bytes.
pub const MAX_FRAME_LEN: usize = 64;

const CRC: Crc<u8> = Crc::<u8>::new(&CRC_8_DVB_S2);
const START: [u8; 2] = [0xC8, 0xEE];
const CHANNELS_PACKED: u8 = 0x16;
const LINK_STATISTICS: u8 = 0x14;
/// Time of a byte on the line in µs, rounded up: 10 bits.
const BYTE: u64 = 24;
/// Pause that ends an unfinished frame.
const PAUSE: Duration = Duration::from_millis(2);
/// A frame of channels takes 0.62 ms.
const LEAST: Duration = Duration::from_micros(600);
/// Longest time between two frames of a row.
const MOST: Duration = Duration::from_millis(100);

/// Counters of a CRSF input. All wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CrsfCounters {
    /// Good frames of channels.
    pub frames: u32,
    /// Those received while the receiver reported no uplink.
    pub no_link: u32,
    /// Those that came faster than the line can carry.
    pub too_fast: u32,
    /// Good frames of link statistics.
    pub statistics: u32,
    /// Good frames of other types, or of another length.
    pub others: u32,
    /// Wrong checksums. A start byte in noise also looks like one.
    pub bad_checksums: u32,
    /// Frames that a pause cut short.
    pub truncated: u32,
    /// Bytes that belonged to no frame.
    pub bytes_skipped: u32,
}

/// Quality of the radio link, as the receiver reports it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LinkStatistics {
    /// Time at which it was received.
    pub at: Instant,
    /// Signal strength of the uplink at each antenna, in −dBm.
    pub uplink_rssi: [u8; 2],
    /// Frames of the uplink that arrive, in percent. 0: no link.
    pub uplink_quality: u8,
    /// Signal to noise ratio of the uplink, in dB.
    pub uplink_snr: i8,
    /// Antenna in use, 0 or 1.
    pub antenna: u8,
    /// Radio mode, numbered by its manufacturer.
    pub rf_mode: u8,
    /// Transmitter power, as a code of the specification.
    pub uplink_power: u8,
    /// Signal strength of the downlink, in −dBm.
    pub downlink_rssi: u8,
    /// Frames of the downlink that arrive, in percent.
    pub downlink_quality: u8,
    /// Signal to noise ratio of the downlink, in dB.
    pub downlink_snr: i8,
}

/// A CRSF input.
#[derive(Clone, Debug)]
pub struct Crsf {
    buffer: Vec<u8, MAX_FRAME_LEN>,
    /// Time of the last byte.
    last: Option<Instant>,
    link: Option<LinkStatistics>,
    confirm: Confirm<16>,
    counters: CrsfCounters,
}

enum Found {
    Incomplete,
    Nothing,
    BadChecksum,
    Frame(usize),
}

impl Default for Crsf {
    fn default() -> Self {
        Self::new()
    }
}

impl Crsf {
    /// An input that has received nothing.
    pub const fn new() -> Self {
        Self {
            buffer: Vec::new(),
            last: None,
            link: None,
            confirm: Confirm::new(LEAST, MOST),
            counters: CrsfCounters {
                frames: 0,
                no_link: 0,
                too_fast: 0,
                statistics: 0,
                others: 0,
                bad_checksums: 0,
                truncated: 0,
                bytes_skipped: 0,
            },
        }
    }

    /// Its counters.
    pub const fn counters(&self) -> &CrsfCounters {
        &self.counters
    }

    /// The last link statistics.
    pub const fn link(&self) -> Option<&LinkStatistics> {
        self.link.as_ref()
    }

    /// Takes bytes up to the end of one frame of channels. Returns how many it took, and the channels that are valid with this
    /// frame. `now` is the time at which the last of `bytes` was received, or later.
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) -> (usize, Option<Channels>) {
        if bytes.is_empty() {
            return (0, None);
        }
        let first = now.checked_sub(Duration::from_micros(BYTE * bytes.len() as u64));
        let paused = |last| first.is_some_and(|first| first.saturating_duration_since(last) >= PAUSE);
        if self.last.is_some_and(paused) && !self.buffer.is_empty() {
            // Its contents would be old by the time it is complete.
            count(&mut self.counters.truncated);
            self.drop_first(self.buffer.len());
        }
        self.last = Some(now);
        for (i, &byte) in bytes.iter().enumerate() {
            // There is room: a full buffer holds a frame, or none begins at its first byte.
            let _ = self.buffer.push(byte);
            if let Some(channels) = self.search(now) {
                return (i + 1, Some(channels));
            }
        }
        (bytes.len(), None)
    }

    /// Takes frames and drops bytes until the buffer holds the beginning of a frame or nothing.
    fn search(&mut self, now: Instant) -> Option<Channels> {
        let mut result = None;
        loop {
            match self.look() {
                Found::Incomplete => return result,
                Found::Nothing => self.skip(),
                Found::BadChecksum => {
                    count(&mut self.counters.bad_checksums);
                    self.skip();
                }
                Found::Frame(len) => {
                    let taken = self.take(now);
                    self.drop_first(len);
                    // Of two frames in the buffer, the later one counts.
                    result = taken.or(result);
                }
            }
        }
    }

    fn look(&self) -> Found {
        let Some(start) = self.buffer.first() else { return Found::Incomplete };
        if !START.contains(start) {
            return Found::Nothing;
        }
        let Some(&len) = self.buffer.get(1) else { return Found::Incomplete };
        let whole = usize::from(len) + 2;
        if len < 2 || whole > MAX_FRAME_LEN {
            return Found::Nothing;
        }
        let Some(frame) = self.buffer.get(..whole) else { return Found::Incomplete };
        match frame {
            [_, _, checked @ .., sum] if CRC.checksum(checked) == *sum => Found::Frame(whole),
            _ => Found::BadChecksum,
        }
    }

    /// Takes the frame at the beginning of the buffer, whose checksum is right.
    fn take(&mut self, now: Instant) -> Option<Channels> {
        let len = usize::from(self.buffer.get(1).copied().unwrap_or(0)) + 2;
        match self.buffer.get(2..len - 1) {
            Some([CHANNELS_PACKED, payload @ ..]) => {
                if let Ok(packed) = <&[u8; PACKED]>::try_from(payload) {
                    let pulses = unpack(packed);
                    return self.channels(now, pulses);
                }
            }
            Some(
                &[
                    LINK_STATISTICS,
                    rssi_1,
                    rssi_2,
                    uplink_quality,
                    snr,
                    antenna,
                    rf_mode,
                    uplink_power,
                    downlink_rssi,
                    downlink_quality,
                    downlink_snr,
                ],
            ) => {
                count(&mut self.counters.statistics);
                self.link = Some(LinkStatistics {
                    at: now,
                    uplink_rssi: [rssi_1, rssi_2],
                    uplink_quality,
                    uplink_snr: snr.cast_signed(),
                    antenna,
                    rf_mode,
                    uplink_power,
                    downlink_rssi,
                    downlink_quality,
                    downlink_snr: downlink_snr.cast_signed(),
                });
                return None;
            }
            _ => {}
        }
        count(&mut self.counters.others);
        None
    }

    fn channels(&mut self, now: Instant, pulses: [Pulse; 16]) -> Option<Channels> {
        count(&mut self.counters.frames);
        if self.link.is_some_and(|link| link.uplink_quality == 0) {
            count(&mut self.counters.no_link);
            self.confirm.end();
            return None;
        }
        self.confirm.channels(now, pulses, &mut self.counters.too_fast)
    }

    /// Drops the first byte, and all bytes up to the next one that may begin a frame.
    fn skip(&mut self) {
        self.confirm.end();
        let next = self.buffer.iter().skip(1).position(|byte| START.contains(byte));
        let gone = next.map_or(self.buffer.len(), |at| at + 1);
        self.counters.bytes_skipped = self.counters.bytes_skipped.wrapping_add(gone as u32);
        self.drop_first(gone);
    }

    fn drop_first(&mut self, count: usize) {
        let count = count.min(self.buffer.len());
        let left = self.buffer.len() - count;
        self.buffer.rotate_left(count);
        self.buffer.truncate(left);
    }
}
