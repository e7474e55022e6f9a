//! What a key demands of frames that come in, and how it is set.

use super::{Place, Service};
use crate::attached::Attached;
use crate::fields::{Fields, setup_signing};
use crate::frame::{Address, Frame};
use crate::ids::Severity;
use crate::refusal::Refusal;
use crate::request::RateRequest;
use crate::servo::FrameClock;
use crate::signing::{Key, Stamp};
use embassy_time::Instant;

impl<const N: usize, const P: usize, A: Attached> Service<'_, N, P, A> {
    /// Whether whoever uses this port is a person at the board.
    pub(super) fn is_usb(&self, port: usize) -> bool {
        self.ports.get(port).is_some_and(|port| port.config.usb)
    }

    /// Whether a frame may do anything. With a key, only what is signed and new; by USB everything may.
    pub(super) fn admits(&mut self, now: Instant, port: usize, frame: &Frame) -> bool {
        if self.signing.key().is_none() {
            return true;
        }
        let judged = self.signing.judge(now, port, frame.from, frame.signature);
        match judged {
            _ if self.is_usb(port) => true,
            Ok(()) => true,
            Err(why) => {
                self.counters.signing.count(why);
                false
            }
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
        if self.addressed(now, port, target) != Some(Place::Node) {
            return;
        }
        let result = self.set_key(now, port, from, setup);
        match result {
            Ok(true) => self.say(
                now,
                Place::Node,
                Severity::Notice,
                Some(port),
                format_args!("signing key set: what does not come by USB has to be signed"),
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
        let stamp = Stamp::new(u64::from_le_bytes(setup.bytes(setup_signing::TIMESTAMP)))
            .ok_or(Refusal::Malformed("SETUP_SIGNING: initial_timestamp has 48 bits"))?;
        let key = Key::new(setup.bytes(setup_signing::KEY));
        self.signing.set_key(now, key, stamp);
        // What was received before may have come from anybody. The id stays: it changes at a start only.
        self.vehicle = self.vehicle.anew();
        self.request = RateRequest::new(now);
        self.clocks = [FrameClock::default(); 2];
        self.received.clear();
        Ok(key.is_some())
    }
}
