//! What happens to the line and to the ECU.

use super::super::ecus;
use super::super::oracle::Input;
use super::super::rng::Rng;
use super::rig::{Rig, SECOND, Trace, now};
use sim::wire::{Babble, Faults};

impl Rig {
    /// All that happens to the line and to the ECU.
    pub(super) fn disturb(&mut self, rng: &mut Rng) {
        let now = now();
        if self.line_until.is_some_and(|until| now >= until) {
            self.line_until = None;
            self.plug.set_faults(Faults::default(), Faults::default());
            self.plug.cut(false);
            self.plug.babble(None);
            self.plug.stall_tx(false);
            if let Some(from) = self.hung_from.take() {
                let _ = from;
                // At most 64 bytes were in its ring.
                let ring = sim::line_of!(self.config.line).byte_ns(70) / 1000;
                self.input(Input::HungUntil(now + ring));
            }
            self.note(Trace::Line("healed"));
        } else if self.line_until.is_some() {
            self.input(Input::LineFault);
        } else if now >= self.next_line {
            self.next_line = now + rng.wait(60 * SECOND);
            let what = match rng.below(6) {
                0 => {
                    self.plug.set_faults(Faults::default(), Faults::NOISY);
                    "noise towards the ECU"
                }
                1 => {
                    let lossy = Faults { lose_per_million: 10_000, ..Faults::default() };
                    self.plug.set_faults(lossy, lossy);
                    "loss"
                }
                2 => {
                    self.plug.cut(true);
                    "cut"
                }
                3 => {
                    self.plug.babble(Some(Babble::Repeat(vec![0x55, 0x10, 0x00])));
                    "babble"
                }
                4 => {
                    self.plug.stall_tx(true);
                    self.hung_from = Some(now);
                    // Frames of a hung transmitter are judged by when they should have begun.
                    self.input(Input::HungUntil(now + 60 * SECOND));
                    "hung transmitter"
                }
                _ => {
                    let late = Faults { delay_ns: 3_000_000, jitter_ns: 15_000_000, ..Faults::default() };
                    self.plug.set_faults(late, late);
                    "delay"
                }
            };
            self.note(Trace::Line(what));
            self.line_until = Some(now + rng.wait(SECOND));
            self.input(Input::LineFault);
        }

        if self.ecu_until.is_some_and(|until| now >= until) {
            self.ecu_until = None;
            self.plug.power(true);
            self.plug.ecu(|ecu| ecus::ecu_mut(ecu).report_truth());
            self.odd_until = now + SECOND;
            self.note(Trace::Ecu("as it should be"));
        } else if now >= self.next_ecu && self.ecu_until.is_none() {
            self.next_ecu = now + rng.wait(200 * SECOND);
            let mut until = now + rng.wait(3 * SECOND);
            let odd_for = until + SECOND;
            let what = match rng.below(6) {
                0 => {
                    self.plug.power(false);
                    self.odd_until = odd_for;
                    self.input(Input::Dark);
                    "no power"
                }
                1 => {
                    self.plug.ecu(|ecu| ecu.turbine_mut().flame_out());
                    self.odd_until = now + SECOND;
                    "flame out"
                }
                2 => {
                    let hot = rng.percent(50);
                    self.plug.ecu(|ecu| ecu.turbine_mut().hot_start(hot));
                    until = now;
                    "hot starts, or none"
                }
                3 => {
                    let dark = rng.percent(30);
                    self.plug.ecu(|ecu| ecu.turbine_mut().no_light(dark));
                    until = now;
                    "no light, or light"
                }
                4 => {
                    let error = rng.between(1, 18) as u8;
                    self.plug.ecu(|ecu| ecus::ecu_mut(ecu).report_fault(error));
                    until = now + rng.wait(10 * SECOND);
                    "errors"
                }
                _ => {
                    let which = rng.below(6) as usize;
                    self.plug.ecu(|ecu| ecus::ecu_mut(ecu).report_state(which));
                    self.odd_until = odd_for;
                    "another state"
                }
            };
            self.note(Trace::Ecu(what));
            self.ecu_until = Some(until);
        }
    }
}
