//! Texts for people: `STATUSTEXT` of an engine or the node, with a limited rate.

use crate::dialect::STATUSTEXT_DATA;
use crate::ids::Severity;
use core::fmt::Write;
use embassy_time::{Duration, Instant};
use heapless::String;
use jetlink::command::Origin;
use jetlink::event::{Event, LossStage};
use mavlink_core::types::CharArray;

/// Longest text: three pieces.
const LONGEST: usize = 3 * PIECE;
/// Length of a piece, which is a frame.
pub(crate) const PIECE: usize = 50;
/// Texts that may be sent at once, and the time after which another one may.
const BURST: u32 = 16;
/// Those of them that answers leave to events.
const EVENTS: u32 = 4;
const EVERY: Duration = Duration::from_millis(500);

/// A text; it is cut after three pieces.
pub(crate) type Text = String<LONGEST>;

/// Writes a text.
pub(crate) fn text(of: core::fmt::Arguments<'_>) -> Text {
    struct Cut(Text);
    impl Write for Cut {
        fn write_str(&mut self, part: &str) -> core::fmt::Result {
            for letter in part.chars() {
                // Receivers show bytes: non-ASCII characters are replaced.
                let done = match letter {
                    '°' => self.0.push_str("deg "),
                    '−' => self.0.push('-'),
                    'µ' => self.0.push('u'),
                    letter if letter.is_ascii() => self.0.push(letter),
                    _ => self.0.push('?'),
                };
                if done.is_err() {
                    break;
                }
            }
            Ok(())
        }
    }
    let mut cut = Cut(Text::new());
    // It never fails.
    let _ = cut.write_fmt(of);
    cut.0
}

/// The pieces of a text. `id` is not 0, so that a receiver puts them together again.
pub(crate) fn pieces(severity: Severity, text: &Text, id: u16) -> impl Iterator<Item = STATUSTEXT_DATA> + '_ {
    let several = text.len() > PIECE;
    // A text whose last piece is full ends with an empty one.
    let full = several && text.len().is_multiple_of(PIECE) && text.len() < LONGEST;
    let end = full.then_some(&[][..]);
    text.as_bytes().chunks(PIECE).chain(end).enumerate().map(move |(i, piece)| {
        let mut bytes = [0; PIECE];
        bytes.iter_mut().zip(piece).for_each(|(slot, byte)| *slot = *byte);
        STATUSTEXT_DATA {
            severity: severity as u8,
            text: CharArray::new(bytes),
            id: if several { id } else { 0 },
            chunk_seq: i as u8, // 3 at most
        }
    })
}

/// Limits the rate of texts.
#[derive(Debug)]
pub(crate) struct Limiter {
    left: u32,
    since: Instant,
    lost: u32,
}

impl Limiter {
    pub const fn new(now: Instant) -> Self {
        Self { left: BURST, since: now, lost: 0 }
    }

    /// Whether a text may be sent now; otherwise it is counted. The answer to a frame leaves some to events: frames come as often as their sender
    /// likes.
    pub fn allows(&mut self, now: Instant, answers: bool) -> bool {
        self.refill(now);
        if self.left <= if answers { EVENTS } else { 0 } {
            self.lost = self.lost.wrapping_add(1);
            return false;
        }
        self.left = self.left.saturating_sub(1);
        true
    }

    /// Number of lost texts, once it is worth a text of its own.
    pub fn take_lost(&mut self, now: Instant) -> Option<u32> {
        self.refill(now);
        if self.lost == 0 || self.left < BURST / 2 {
            return None;
        }
        Some(core::mem::take(&mut self.lost))
    }

    fn refill(&mut self, now: Instant) {
        let passed = now.saturating_duration_since(self.since).as_ticks() / EVERY.as_ticks();
        if passed > 0 {
            self.left = self.left.saturating_add(passed.min(u64::from(BURST)) as u32).min(BURST);
            self.since = now;
        }
    }
}

/// How severe an event is; `None`: it is not worth a text.
pub(crate) fn severity(event: &Event) -> Option<Severity> {
    Some(match event {
        // Its sender gets the reason at once.
        Event::CommandRejected(_, Origin::Mavlink) => return None,
        Event::VersionKnown(_) | Event::RateConfirmed(_) | Event::ActiveSource(_) | Event::OtherFailed(_) => {
            return None;
        }
        Event::Faults(faults) if faults.is_empty() => Severity::Info,
        Event::SourceLoss(LossStage::None) => Severity::Notice,
        Event::Faults(_) | Event::Limit(_) | Event::RunCancelled(_) | Event::TransmitterFailed => {
            Severity::Critical
        }
        Event::LinkLost | Event::NotObeyed | Event::SourceLoss(_) | Event::ServiceFailed(_) => {
            Severity::Error
        }
        Event::LifeInDoubt
        | Event::EngineUnknown
        | Event::RateNotConfirmed(_)
        | Event::NotSent(_)
        | Event::Clamped(_)
        | Event::CommandRejected(..) => Severity::Warning,
        Event::Resumed(_) | Event::Armed(..) | Event::Ordered(_) | Event::EcuStarted => Severity::Notice,
        _ => Severity::Info,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::String as StdString;
    use std::vec::Vec;

    fn joined(length: usize) -> (Vec<u8>, StdString) {
        let long: StdString = (0..length).map(|i| char::from(b'a' + (i % 26) as u8)).collect();
        let text = text(format_args!("{long}"));
        let pieces: Vec<_> = pieces(Severity::Info, &text, 7).collect();
        let whole = pieces.iter().map(|piece| piece.text.to_str().unwrap()).collect();
        let ids: Vec<u16> = pieces.iter().map(|piece| piece.id).collect();
        assert!(ids.iter().all(|&id| id == if length > PIECE { 7 } else { 0 }));
        (pieces.iter().map(|piece| piece.chunk_seq).collect(), whole)
    }

    #[test]
    fn a_text_comes_in_pieces_that_a_receiver_can_join() {
        assert_eq!(joined(50).0, [0]);
        assert_eq!(joined(51).0, [0, 1]);
        // A piece that is not full ends the text, so one of 100 letters needs an empty one.
        assert_eq!(joined(100).0, [0, 1, 2]);
        assert_eq!(joined(150).0, [0, 1, 2]);
        let (pieces, whole) = joined(200);
        assert_eq!((pieces.len(), whole.len()), (3, 150));
        assert_eq!(&text(format_args!("100 °C, −4 ü"))[..], "100 deg C, -4 ?");
    }

    #[test]
    fn a_flood_is_limited_and_counted() {
        let mut limiter = Limiter::new(Instant::from_secs(1));
        let sent = (0..1000).filter(|i| limiter.allows(Instant::from_millis(1000 + i), false)).count();
        assert_eq!(sent, 17);
        assert_eq!(limiter.take_lost(Instant::from_secs(2)), None);
        assert_eq!(limiter.take_lost(Instant::from_secs(10)), Some(983));
        assert_eq!(limiter.take_lost(Instant::from_secs(20)), None);
        // Of answers, and then of events.
        let now = Instant::from_secs(30);
        let sent = [true, false].map(|answers| (0..20).filter(|_| limiter.allows(now, answers)).count());
        assert_eq!(sent, [12, 4]);
    }
}
