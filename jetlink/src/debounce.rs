//! One odd frame changes nothing: what an ECU reports of its engine counts when two frames in a row agree, for every
//! protocol alike. AMT frames have no checksum, and a ZK one lets one in 256 damaged frames through.
//!
//! This is what is reported to people and what interlocks ask. What decides about the life of a running engine is raw
//! ([`Sign`](crate::link::Sign)), and debounced where it is judged (`engine/life.rs`).

use crate::ecu::Faults;
use crate::event::Event;
use crate::link::Outbox;
use crate::report::{EcuState, Phase, Report, ReportedSwitch, Timed};
use embassy_time::Instant;

/// A value that changes only when two frames in a row agree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Debounced<T> {
    value: Option<T>,
    candidate: Option<T>,
}

impl<T: Copy + PartialEq> Debounced<T> {
    pub const fn new(value: Option<T>) -> Self {
        Self { value, candidate: None }
    }

    pub const fn get(&self) -> Option<T> {
        self.value
    }

    /// One frame reports this. True if it is the value now.
    pub fn see(&mut self, seen: T) -> bool {
        if self.value == Some(seen) {
            self.candidate = None;
        } else if self.candidate == Some(seen) {
            self.set(seen);
        } else {
            self.candidate = Some(seen);
        }
        self.value == Some(seen)
    }

    /// It is certain.
    pub const fn set(&mut self, value: T) {
        *self = Self::new(Some(value));
    }
}

/// The engine's state, the switch and the faults, as they get into the report.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DebouncedState {
    phase: Debounced<Phase>,
    switch: Debounced<ReportedSwitch>,
    /// Whether the ECU reports faults, whichever: one that reports others in every frame is faulty all the same.
    faulty: Debounced<bool>,
    faults: Debounced<Faults>,
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

    /// What the engine does.
    pub const fn phase(&self) -> Option<Phase> {
        self.phase.get()
    }

    /// One frame with the ECU's own state. What a frame contradicts becomes no newer by it.
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

    /// One frame with the faults, or with none.
    pub fn faults(&mut self, now: Instant, faults: Faults, report: &mut Report, outbox: &mut Outbox) {
        let faulty = !faults.is_empty();
        if !self.faulty.see(faulty) {
            return;
        }
        if self.faults.get().is_none_or(|before| before.is_empty() == faulty) {
            // The second frame in a row with faults, or without: these are the faults.
            self.faults.set(faults);
        } else if !self.faults.see(faults) {
            return;
        }
        let before = report.faults.replace(Timed::new(faults, now));
        if before.map_or(faulty, |before| before.value != faults) {
            outbox.event(Event::Faults(faults));
        }
    }
}
