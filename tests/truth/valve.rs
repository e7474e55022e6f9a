//! The outputs of an engine as the firmware drives them: its fuel valve, with the relay before it, and the power of its starter.

use crate::history::{History, Pin, SECOND};
use jetlink::engine::retained::RetainedState;
use jetlink::telemetry::Telemetry;
use jetlink_rc::outputs::{Before, Outputs, Valve as Wanted};
use jetlink_rc::settings::OutputSettings;

/// Delay of the relay at switch-off: it holds the valve while its pin floats. Shorter than the 7 s that docs/rc.md asks for behind a
/// bootloader, so that a firmware that is slow to drive its pin shows.
const DELAY: u64 = 5 * SECOND;

/// A valve, and what drives it.
#[derive(Debug)]
pub struct Valve {
    /// `None` without a node.
    outputs: Option<Outputs>,
    /// The number that was retained of its power, with the fingerprint of its engine.
    power: Option<u32>,
    fingerprint: u32,
    /// When it was energised last; `None`: never.
    energised: Option<u64>,
    /// Time since which it has been shut.
    shut_since: Option<u64>,
}

impl Valve {
    pub const fn new() -> Self {
        Self { outputs: None, power: None, fingerprint: 0, energised: None, shut_since: Some(0) }
    }

    /// The node begins with this engine's record; `has_failed`: its starts have failed for too long.
    pub fn begin(
        &mut self,
        history: &mut History,
        at: u64,
        fingerprint: u32,
        record: Option<RetainedState>,
        has_failed: bool,
    ) {
        let power = Before::power(fingerprint, self.power);
        self.outputs = Some(Outputs::new(OutputSettings::DEFAULT, Before { record, power, has_failed }));
        self.fingerprint = fingerprint;
        self.drive(history, at);
    }

    /// Nothing is left of the memory.
    pub const fn forget(&mut self) {
        self.power = None;
    }

    /// There is no node.
    pub fn release(&mut self, history: &mut History, at: u64) {
        self.outputs = None;
        self.drive(history, at);
    }

    /// The node follows its engine.
    pub fn follow(&mut self, history: &mut History, at: u64, telemetry: &Telemetry) {
        if let Some(outputs) = &mut self.outputs {
            outputs.update(telemetry);
        }
        self.drive(history, at);
    }

    /// Whether it is closed because the node's starts have failed for too long.
    pub fn is_cut(&self) -> bool {
        self.outputs.as_ref().is_some_and(Outputs::is_cut)
    }

    /// Whether no fuel comes through.
    pub const fn is_shut(&self) -> bool {
        self.shut_since.is_some()
    }

    fn drive(&mut self, history: &mut History, at: u64) {
        let pin = match self.outputs.as_ref().map(Outputs::valve) {
            None => Pin::Floats,
            Some(Wanted::Closed) => Pin::Closed,
            Some(Wanted::Open) => Pin::Open,
        };
        let power = self.outputs.as_ref().map(Outputs::power);
        self.power = power.map(|power| Before::number(self.fingerprint, power)).or(self.power);
        if history.power.last().is_none_or(|(_, before)| *before != power) {
            history.power.push((at, power));
        }
        let before = history.pin.last().map_or(Pin::Floats, |(_, pin)| *pin);
        if before == Pin::Open {
            self.energised = Some(at);
        }
        if pin != before || history.pin.is_empty() {
            history.pin.push((at, pin));
        }
        let shut = pin != Pin::Open && self.energised.is_none_or(|last| at >= last + DELAY);
        match (shut, self.shut_since) {
            (true, None) => self.shut_since = Some(at),
            (false, Some(since)) => {
                history.shut.push(since, at);
                self.shut_since = None;
            }
            _ => {}
        }
    }

    /// The history ends.
    pub fn end(&mut self, history: &mut History, at: u64) {
        if let Some(since) = self.shut_since.take() {
            history.shut.push(since, at);
        }
    }
}
