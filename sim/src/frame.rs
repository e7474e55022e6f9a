//! A protocol's control frames, and the reader that finds them among the bytes of a line. Each protocol
//! implements [`ControlFrame`] for its command, in its own folder.

use crate::ecu::Nanos;
use crate::wire::{Direction, Entry, Fate};
use core::fmt;

/// Engine switch commanded by a control frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// ZK ID 1 with SW 0: the ECU obeys its PWM input (ZK-8).
    Pwm,
    /// Stop without cooling.
    Stop,
    /// Stop with cooling.
    Standby,
    /// Run.
    Run,
}

impl fmt::Display for Switch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pwm => "PWM input",
            Self::Stop => "emergency stop",
            Self::Standby => "standby",
            Self::Run => "run",
        })
    }
}

/// The command in a control frame of one protocol.
pub trait ControlFrame: Copy + fmt::Debug + fmt::Display {
    /// The bytes of a frame, an array: all frames have the same length.
    type Bytes: Copy + fmt::Debug + Default + AsRef<[u8]> + AsMut<[u8]>;

    /// Reason why bytes are not a valid frame.
    type Bad: Copy + fmt::Debug + fmt::Display;

    /// The byte that begins every frame, if it occurs nowhere else in one: a frame begins wherever it is received.
    const UNIQUE_HEAD: Option<u8>;

    /// Reads the bytes of one frame.
    ///
    /// # Errors
    /// They are not a valid frame.
    fn read(bytes: &Self::Bytes) -> Result<Self, Self::Bad>;

    /// Whether such bytes do not begin at the start of a frame, because they follow the rest of one that a reset cut short.
    /// The reader tries again one byte later.
    fn is_misaligned(bad: Self::Bad) -> bool;

    /// The switch, if there is one.
    fn switch(self) -> Option<Switch>;

    /// The throttle in 0.1 %, with any switch.
    fn throttle_tenths(self) -> Option<u16>;

    /// Whether it sets the scale of the speeds in later frames.
    fn sets_scale(self) -> bool;

    /// The speed that it commands. `scale`: the last command that set a scale.
    fn rpm(self, scale: Option<Self>) -> Option<u32>;
}

/// Number of bytes in a control frame.
pub const fn length<C: ControlFrame>() -> usize {
    size_of::<C::Bytes>()
}

/// A sequence of bytes with the length of a control frame.
#[derive(Clone, Copy, Debug)]
pub struct Frame<C: ControlFrame> {
    /// Start of the first start bit.
    pub start: Nanos,
    /// End of the last stop bit.
    pub end: Nanos,
    /// All bytes reached the ECU as they were sent.
    pub delivered: bool,
    /// The bytes.
    pub bytes: C::Bytes,
    /// Their command.
    pub command: Result<C, C::Bad>,
    /// The speed that it commands, if its scale is known.
    pub rpm: Option<u32>,
}

/// Result of a strict [`Reader`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Found<F> {
    /// Bytes with the length of a frame.
    Frame(F),
    /// Fewer bytes, followed by a pause.
    Fragment {
        /// Start of the first start bit.
        start: Nanos,
        /// The bytes.
        bytes: Vec<u8>,
    },
}

impl<F> Found<F> {
    /// The frame, if it is one.
    pub fn frame(self) -> Option<F> {
        match self {
            Self::Frame(frame) => Some(frame),
            Self::Fragment { .. } => None,
        }
    }

    /// The same with another kind of frame.
    pub fn map<G>(self, convert: impl FnOnce(F) -> G) -> Found<G> {
        match self {
            Self::Frame(frame) => Found::Frame(convert(frame)),
            Self::Fragment { start, bytes } => Found::Fragment { start, bytes },
        }
    }
}

/// How a [`Reader`] finds the start of a frame.
#[derive(Clone, Copy, Debug)]
enum Framing {
    Heads,
    Pauses(Nanos),
}

/// Finds control frames of one protocol in the recording of a line.
#[derive(Clone, Debug)]
pub struct Reader<C> {
    framing: Framing,
    bytes: Vec<Entry>,
    scale: Option<C>,
}

impl<C: ControlFrame> Reader<C> {
    /// Finds frames as an ECU does, and skips everything else.
    pub const fn new() -> Self {
        Self { framing: Framing::Heads, bytes: Vec::new(), scale: None }
    }

    /// Skips nothing: each run of bytes with the length of a frame is one, and a pause longer than this ends it.
    pub const fn strict(longest_pause: Nanos) -> Self {
        Self { framing: Framing::Pauses(longest_pause), bytes: Vec::new(), scale: None }
    }

    /// The frames whose last byte is in this part of a recording.
    pub fn read(&mut self, record: &[Entry]) -> impl Iterator<Item = Frame<C>> {
        record.iter().filter_map(|entry| self.entry(entry).and_then(Found::frame))
    }

    /// Takes one entry of a recording. Skips bytes from the ECU and bytes created by noise.
    pub fn entry(&mut self, entry: &Entry) -> Option<Found<Frame<C>>> {
        if entry.direction != Direction::ToEcu || entry.fate == Fate::Added {
            return None;
        }
        let fragment = match self.framing {
            Framing::Heads if C::UNIQUE_HEAD == Some(entry.byte) => {
                self.bytes.clear();
                None
            }
            Framing::Pauses(longest)
                if self.bytes.last().is_some_and(|last| entry.start > last.end + longest) =>
            {
                self.fragment()
            }
            _ => None,
        };
        self.bytes.push(*entry);
        fragment.or_else(|| self.frame().map(Found::Frame))
    }

    /// Discards the partial frame: its sender was reset.
    pub fn restart(&mut self) {
        self.bytes.clear();
    }

    fn fragment(&mut self) -> Option<Found<Frame<C>>> {
        let start = self.bytes.first()?.start;
        let bytes = self.bytes.drain(..).map(|entry| entry.byte).collect();
        Some(Found::Fragment { start, bytes })
    }

    fn frame(&mut self) -> Option<Frame<C>> {
        let entries = self.bytes.get(..length::<C>())?;
        let (first, last) = (entries.first()?, entries.last()?);
        let mut bytes = C::Bytes::default();
        for (to, entry) in bytes.as_mut().iter_mut().zip(entries) {
            *to = entry.byte;
        }
        let command = C::read(&bytes);
        if matches!(self.framing, Framing::Heads) && command.is_err_and(C::is_misaligned) {
            self.bytes.remove(0);
            return None;
        }
        self.scale = command.ok().filter(|command| command.sets_scale()).or(self.scale);
        let frame = Frame {
            start: first.start,
            end: last.end,
            delivered: entries.iter().all(|entry| entry.fate == Fate::Delivered),
            bytes,
            command,
            rpm: command.ok().and_then(|command| command.rpm(self.scale)),
        };
        self.bytes.drain(..length::<C>());
        Some(frame)
    }
}

impl<C: ControlFrame> Default for Reader<C> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Longer than the frames of any protocol here; its last byte is the number of a switch.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    struct Long(u8);

    impl fmt::Display for Long {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "{}", self.0)
        }
    }

    impl ControlFrame for Long {
        type Bytes = [u8; 12];
        type Bad = &'static str;

        const UNIQUE_HEAD: Option<u8> = None;

        fn read(bytes: &[u8; 12]) -> Result<Self, Self::Bad> {
            if bytes[0] == 0xAA { Ok(Self(bytes[11])) } else { Err("no head") }
        }

        fn is_misaligned(_: Self::Bad) -> bool {
            true
        }

        fn switch(self) -> Option<Switch> {
            (self.0 == 1).then_some(Switch::Run)
        }

        fn throttle_tenths(self) -> Option<u16> {
            None
        }

        fn sets_scale(self) -> bool {
            false
        }

        fn rpm(self, _: Option<Self>) -> Option<u32> {
            None
        }
    }

    #[test]
    fn a_frame_may_have_any_length() {
        let bytes = [&[0xAA, 7, 7][..], &[0xAA, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1][..]].concat();
        let record = Entry::delivered(Direction::ToEcu, 0, 1, &bytes);
        // The first twelve bytes begin with a head, and would be a frame of their own.
        let mut strict = Reader::<Long>::strict(1);
        let found: Vec<_> = strict.read(&record).map(|frame| (frame.start, frame.command)).collect();
        assert_eq!(found, [(0, Ok(Long(0)))]);
        let mut reader = Reader::<Long>::new();
        let found: Vec<_> = reader.read(&record[1..]).map(|frame| (frame.start, frame.command)).collect();
        assert_eq!(found, [(3, Ok(Long(1)))]);
        assert_eq!(found[0].1.unwrap().switch(), Some(Switch::Run));
    }
}
