//! What a key requires of received frames, and how it is set.

use super::{ParameterStorage, Place, Service};
use crate::attached::Attached;
use crate::cover::Fate;
use crate::engine::Engine;
use crate::fields::{Fields, setup_signing};
use crate::frame::{Address, Frame};
use crate::ids::Severity;
use crate::kind::Kind;
use crate::refusal::Refusal;
use crate::request::RateRequest;
use crate::servo::FrameClock;
use crate::signing::{Ignored, Key, Signature, Stamp};
use embassy_time::Instant;

impl<const N: usize, const P: usize, A: Attached> Service<'_, N, P, A> {
    /// Whether a frame may do anything now. With a key, only signed and new frames may; over USB all may.
    pub(super) fn admits(&mut self, now: Instant, port: usize, frame: &Frame) -> bool {
        if self.signing.key().is_none() {
            return true;
        }
        let judged = self.signing.judge(now, port, frame.from, frame.signature);
        match judged {
            _ if self.is_usb(port) => true,
            Ok(()) => self.is_covered(now, port, frame),
            Err(why) => {
                self.counters.signing.count(why);
                false
            }
        }
    }

    /// Whether a signed and new frame may be carried out now: a frame that has acted must not act again after a loss of power.
    fn is_covered(&mut self, now: Instant, port: usize, frame: &Frame) -> bool {
        let (kind, target) = Kind::of_frame(frame);
        let Signature::Right { stamp, .. } = frame.signature else { return false };
        if kind != Kind::Acts || self.addressed(now, port, target, kind).is_none() {
            return true;
        }
        if !self.signing.is_new(stamp) {
            self.counters.signing.count(Ignored::Behind);
            return false;
        }
        if self.storage != ParameterStorage::Stored || self.cover.covers(stamp) {
            return true;
        }
        if self.cover.hold(now, port, frame, target.component, stamp) {
            return false;
        }
        self.cover.refusing = Some(Refusal::StoreBusy);
        true
    }

    /// Takes a frame that has waited until the store covers it.
    pub(super) fn take_waiting(&mut self, now: Instant) -> Option<(usize, Frame)> {
        if !self.cover.has_waiting() {
            return None;
        }
        let (port, frame, fate) = self.cover.take(now, self.any_turns())?;
        match fate {
            Fate::Covered => {}
            Fate::Uncovered(why) => {
                let text = format_args!("obeyed, but its time stamp is not stored: {why}");
                self.say(now, Place::Node, Severity::Warning, Some(port), text);
            }
            Fate::Refused(why) => self.cover.refusing = Some(why),
        }
        Some((port, frame))
    }

    /// Requests a save of key and time stamp when an engine has stopped, and from time to time at rest.
    pub(super) fn cover_from_time_to_time(&mut self, now: Instant) {
        if self.signing.key().is_some()
            && self.storage == ParameterStorage::Stored
            && self.cover.is_due(now, self.any_turns(), self.is_at_rest())
        {
            self.cover.want(self.signing.stamp(now));
        }
    }

    /// Sets or clears the key.
    pub(super) fn set_up_signing(
        &mut self,
        now: Instant,
        port: usize,
        from: Address,
        target: Address,
        setup: &Fields,
    ) {
        if self.addressed(now, port, target, Kind::Acts) != Some(Place::Node) {
            return;
        }
        let result = self.set_key(now, port, from, setup);
        match result {
            Ok(true) => self.say(
                now,
                Place::Node,
                Severity::Notice,
                Some(port),
                format_args!("signing key set: all but USB must be signed"),
            ),
            Ok(false) => self.say(
                now,
                Place::Node,
                Severity::Notice,
                Some(port),
                format_args!("signing key cleared: nothing has to be signed"),
            ),
            Err(why) => {
                let refused = &mut self.counters.signing.setups_refused;
                *refused = refused.wrapping_add(1);
                let text = format_args!("signing key not changed: {why}");
                self.say(now, Place::Node, Severity::Warning, Some(port), text);
            }
        }
    }

    /// Returns whether there is a key now.
    fn set_key(&mut self, now: Instant, port: usize, from: Address, setup: &Fields) -> Result<bool, Refusal> {
        if !self.is_usb(port) {
            return Err(Refusal::OnlyByUsb);
        }
        if !self.may_command(from.system) {
            return Err(Refusal::NotAllowed(from.system));
        }
        if self.any_turns() {
            return Err(Refusal::Turns);
        }
        if !self.is_at_rest() {
            return Err(Refusal::NotAtRest);
        }
        let stamp = Stamp::new(u64::from_le_bytes(setup.bytes(setup_signing::TIMESTAMP)))
            .ok_or(Refusal::Malformed("SETUP_SIGNING: initial_timestamp has 48 bits"))?;
        let key = Key::new(setup.bytes(setup_signing::KEY));
        self.signing.set_key(now, key, stamp);
        self.cover.forget();
        if self.storage == ParameterStorage::Stored {
            self.cover.want(self.signing.stamp(now));
        }
        // Anybody may have sent what was received before. The id stays: it changes only at a start.
        self.vehicle = self.vehicle.forgotten();
        self.request = RateRequest::new(now);
        self.clocks = [FrameClock::default(); 2];
        self.received.clear();
        self.engines.iter_mut().for_each(Engine::forget_demand);
        Ok(key.is_some())
    }
}
