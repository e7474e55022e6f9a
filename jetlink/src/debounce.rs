//! The reported phase, switch and faults of an engine change when two consecutive frames agree, in every protocol: AMT frames have no
//! checksum, and that of ZK lets one in 256 damaged frames through. Measured values are not debounced.
//!
//! The results are reported to people and used by interlocks. The values that decide about the life of a running engine
//! are raw ([`Observation`](crate::link::Observation)) and debounced where they are judged (`engine/life.rs`).

use crate::consecutive::{AGREEING, Consecutive};
use crate::ecu::Faults;
use crate::event::Event;
use crate::link::Outbox;
use crate::report::{EcuState, Phase, Report, ReportedSwitch, Timed};
use embassy_time::Instant;

/// A value that only changes when two consecutive frames agree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Debounced<T> {
    value: Option<T>,
    candidate: Option<T>,
    /// Consecutive frames with the candidate.
    agreeing: Consecutive,
}

impl<T: Copy + PartialEq> Debounced<T> {
    pub const fn new(value: Option<T>) -> Self {
        Self { value, candidate: None, agreeing: Consecutive::NONE }
    }

    pub const fn get(&self) -> Option<T> {
        self.value
    }

    /// Takes the value from one frame. True if it is the debounced value now.
    pub fn see(&mut self, seen: T) -> bool {
        self.see_frames(seen, AGREEING)
    }

    /// The same, if this many consecutive frames have to agree.
    pub fn see_frames(&mut self, seen: T, frames: u8) -> bool {
        if self.value == Some(seen) {
            self.candidate = None;
        } else {
            self.agreeing.count_with_last(self.candidate == Some(seen));
            self.candidate = Some(seen);
            if self.agreeing.reached(frames) {
                self.set(seen);
            }
        }
        self.value == Some(seen)
    }

    /// Sets the value without debouncing.
    pub const fn set(&mut self, value: T) {
        *self = Self::new(Some(value));
    }
}

/// The engine's state, switch and faults, debounced for the report.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DebouncedState {
    phase: Debounced<Phase>,
    switch: Debounced<ReportedSwitch>,
    /// Whether the ECU reports any faults: one that reports different faults in every frame is faulty too.
    faulty: Debounced<bool>,
    /// Their number on the wire.
    faults: Debounced<u8>,
}

impl DebouncedState {
    /// Nothing yet, and no faults: a first frame with faults has to be confirmed.
    pub const fn new() -> Self {
        Self {
            phase: Debounced::new(None),
            switch: Debounced::new(None),
            faulty: Debounced::new(Some(false)),
            faults: Debounced::new(None),
        }
    }

    /// Phase of the engine.
    pub const fn phase(&self) -> Option<Phase> {
        self.phase.get()
    }

    /// Takes one frame with the ECU's own state. A frame that contradicts a value does not renew it.
    pub fn state(
        &mut self,
        now: Instant,
        (ecu, phase, switch): (EcuState, Phase, ReportedSwitch),
        report: &mut Report,
        outbox: &mut Outbox,
    ) {
        report.state = Some(Timed::new(ecu, now));
        if self.switch.see(switch) {
            report.switch = Some(Timed::new(switch, now));
        }
        let before = self.phase.get();
        if self.phase.see(phase) {
            report.phase = Some(Timed::new(phase, now));
            if before != Some(phase) {
                outbox.event(Event::Phase(phase));
            }
        }
    }

    /// Takes one frame with faults, or with none.
    pub fn faults(&mut self, now: Instant, faults: Faults, report: &mut Report, outbox: &mut Outbox) {
        let (faulty, number) = (!faults.is_empty(), faults.number());
        if !self.faulty.see(faulty) {
            return;
        }
        if self.faults.get().is_none_or(|before| (before != 0) != faulty) {
            // The second consecutive frame with faults, or without: these are the faults.
            self.faults.set(number);
        } else if !self.faults.see(number) {
            return;
        }
        let before = report.faults.replace(Timed::new(faults, now));
        if before.map_or(0, |before| before.value.number()) != number {
            outbox.event(Event::Faults(faults));
        }
    }
}
