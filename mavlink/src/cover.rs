//! The part of signing that has to be stored before a frame is obeyed, so that it is not obeyed again after a loss of power.
//!
//! The store has a time stamp up to which everything is *covered*: after a loss of power no frame signed with it or an earlier one acts. A
//! frame that acts and is not covered waits some ms for a save. The saved stamp is 10 s ahead, so that setting 50 parameters causes one
//! save, not 50.

use crate::frame::Frame;
use crate::refusal::Refusal;
use crate::signing::Stamp;
use crate::store::NotSaved;
use embassy_time::{Duration, Instant};
use heapless::Vec;

/// Number of frames that may wait. A start is one frame.
const WAITING: usize = 4;
/// Longest wait, so that an answer comes within 0.5 s and nothing is obeyed late.
const LONGEST: Duration = Duration::from_millis(300);
/// Lead of the saved stamp over the obeyed one.
const AHEAD: Duration = Duration::from_secs(10);
/// Time between two saves while all engines are at rest.
const EVERY: Duration = Duration::from_secs(600);

/// A frame that waits until it is covered.
#[derive(Debug)]
struct Waiting {
    port: usize,
    frame: Frame,
    /// Component that it addresses.
    component: u8,
    stamp: Stamp,
    since: Instant,
    /// Why it is refused before it is obeyed.
    refused: Option<Refusal>,
}

/// Fate of a frame that has waited.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Fate {
    /// It is obeyed: the store covers it.
    Covered,
    /// It is obeyed although the store does not cover it, because an engine turns.
    Uncovered(Refusal),
    /// It is refused.
    Refused(Refusal),
}

/// Stored stamps of signing, and the frames that wait for them.
#[derive(Debug)]
pub(crate) struct Cover {
    /// The stamp saved in the store since the start.
    stored: Stamp,
    /// The stamp that has to be saved, and the one that is being saved.
    wanted: Option<Stamp>,
    saving: Option<Stamp>,
    waiting: Vec<Waiting, WAITING>,
    /// Why a save failed, for the waiting frames.
    failed: Option<NotSaved>,
    /// The failure that the last text reported.
    reported: Option<NotSaved>,
    /// An engine turned.
    turned: bool,
    /// Time of the next save at rest.
    next: Instant,
    /// Why the frame being carried out is refused.
    pub refusing: Option<Refusal>,
}

impl Cover {
    /// Nothing is known to be stored.
    pub const fn new(now: Instant) -> Self {
        Self {
            stored: Stamp::ZERO,
            wanted: None,
            saving: None,
            waiting: Vec::new(),
            failed: None,
            reported: None,
            turned: false,
            next: now,
            refusing: None,
        }
    }

    /// Whether a frame signed with this stamp may be obeyed.
    pub fn covers(&self, stamp: Stamp) -> bool {
        stamp <= self.stored
    }

    /// Requests a save of a stamp ahead of this one.
    pub fn want(&mut self, stamp: Stamp) {
        self.wanted = self.wanted.max(Some(stamp.later(AHEAD)));
    }

    /// Holds a frame until it is covered. False: too many wait.
    pub fn hold(&mut self, now: Instant, port: usize, frame: &Frame, component: u8, stamp: Stamp) -> bool {
        if self.waiting.is_empty() {
            self.failed = None;
        }
        let waiting = Waiting { port, frame: frame.clone(), component, stamp, since: now, refused: None };
        let held = self.waiting.push(waiting).is_ok();
        if held && self.saving.is_none_or(|saving| saving < stamp) {
            self.want(stamp);
        }
        held
    }

    /// Whether frames wait.
    pub fn has_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// The frame that was being carried out is done.
    pub fn carried_out(&mut self) {
        self.refusing = None;
    }

    /// A component, or all of them, received a stop: frames that wait for it are older, and are refused.
    pub fn stopped(&mut self, component: Option<u8>) {
        for waiting in &mut self.waiting {
            if component.is_some_and(|component| component != waiting.component) {
                continue;
            }
            waiting.refused = Some(Refusal::Stopped);
        }
    }

    /// Whether a save is due without a frame: an engine has stopped, or all have been at rest for long.
    pub fn is_due(&mut self, now: Instant, turns: bool, at_rest: bool) -> bool {
        let stopped = core::mem::replace(&mut self.turned, turns) && !turns;
        let due = stopped || at_rest && now >= self.next;
        if due {
            self.next = now + EVERY;
        }
        due
    }

    /// There is another key: nothing is stored for it, and what waits was signed with the old one. A save in progress still has a result.
    pub fn forget(&mut self) {
        (self.stored, self.wanted, self.saving) = (Stamp::ZERO, None, self.saving.map(|_| Stamp::ZERO));
        self.waiting.clear();
    }

    /// The stamp to save now. [`Cover::saved`] has to follow.
    pub fn next_save(&mut self) -> Option<Stamp> {
        let stamp = self.wanted.take()?;
        self.saving = Some(stamp);
        Some(stamp)
    }

    /// The stamp of a record that is saved with all others.
    pub fn latest(&self) -> Stamp {
        self.stored.max(self.saving.max(self.wanted).unwrap_or_default())
    }

    /// Whether a stamp waits to be saved, or is being saved.
    pub fn is_saving(&self) -> bool {
        self.wanted.is_some() || self.saving.is_some()
    }

    /// Takes the result of a save. False: it was the result of something else.
    pub fn saved(&mut self, result: Result<(), NotSaved>) -> bool {
        let Some(saving) = self.saving.take() else { return false };
        match result {
            Ok(()) => {
                self.stored = self.stored.max(saving);
                self.reported = None;
            }
            Err(why) => self.failed = Some(why),
        }
        true
    }

    /// Whether a text has to report that a save failed: not once for each attempt.
    pub fn reports(&mut self, why: NotSaved) -> bool {
        self.reported.replace(why) != Some(why)
    }

    /// The next frame that no longer waits, with its port.
    pub fn take(&mut self, now: Instant, turns: bool) -> Option<(usize, Frame, Fate)> {
        let first = self.waiting.first()?;
        let failed = self.failed.map(|why| match why {
            NotSaved::Full => Refusal::StoreFull,
            NotSaved::Failed => Refusal::StoreFails,
        });
        let fate = match (first.refused, failed) {
            (Some(why), _) => Fate::Refused(why),
            _ if self.covers(first.stamp) => Fate::Covered,
            // A relight must not fail because a memory does.
            (None, Some(why)) if turns => Fate::Uncovered(why),
            (None, Some(why)) => Fate::Refused(why),
            _ if now >= first.since + LONGEST => Fate::Refused(Refusal::StoreBusy),
            _ => return None,
        };
        let Waiting { port, frame, .. } = self.waiting.remove(0);
        Some((port, frame, fate))
    }
}
