//! Radio control and outputs for MAVLink: their settings are parameters of each engine, and what they do is reported.

use crate::calibration::CalibrationError;
use crate::service::Service;
use crate::settings::{EngineSettings, OutputSettings, SettingsError};
use crate::shared::{Changes, Shared};
use core::cell::RefCell;
use embassy_sync::pubsub::WaitResult;
use embassy_time::Instant;
use jetlink::setting::Row;
use jetlink_mavlink::attached::{self, Attached, Channels, NodeStreams};
use jetlink_mavlink::record::read_attached;
use jetlink_mavlink::refusal::Refusal;

const RADIO: &[&[Row]] = &[EngineSettings::ROWS];
const OUTPUTS: &[&[Row]] = &[OutputSettings::ROWS];
const BOTH: &[&[Row]] = &[EngineSettings::ROWS, OutputSettings::ROWS];

/// The tables of settings of an engine, in a node with radio control or outputs. Their order is fixed.
pub const fn rows(radio: bool, outputs: bool) -> &'static [&'static [Row]] {
    match (radio, outputs) {
        (true, true) => BOTH,
        (true, false) => RADIO,
        (false, true) => OUTPUTS,
        (false, false) => &[],
    }
}

/// Takes the settings of an engine from a stored record. Settings that contradict each other stay unchanged.
pub fn apply(radio: Option<&mut EngineSettings>, outputs: Option<&mut OutputSettings>, record: &[u8]) {
    let rows = rows(radio.is_some(), outputs.is_some());
    let mut new_radio = radio.as_deref().copied();
    let mut new_outputs = outputs.as_deref().copied();
    for (name, number) in read_attached(rows, record) {
        // Each name belongs to one of them.
        let _ = new_radio.as_mut().is_some_and(|radio| radio.set(name, number))
            || new_outputs.as_mut().is_some_and(|outputs| outputs.set(name, number));
    }
    if let (Some(radio), Some(new)) = (radio, new_radio.filter(|new| new.check().is_ok())) {
        *radio = new;
    }
    if let (Some(outputs), Some(new)) = (outputs, new_outputs) {
        *outputs = new;
    }
}

/// Outputs of a node, with their stored settings, which take effect at its next start.
#[derive(Debug)]
struct NodeOutputs<'a, const N: usize> {
    shared: &'a Shared<N>,
    changes: Option<Changes<'a>>,
    settings: [OutputSettings; N],
}

/// Receiver and outputs of a node with up to `N` engines. The receiver commands all engines of the node, in their order.
pub struct Parameters<'a, 'b, const N: usize> {
    radio: Option<&'a RefCell<Service<'b, N>>>,
    outputs: Option<NodeOutputs<'a, N>>,
}

impl<const N: usize> core::fmt::Debug for Parameters<'_, '_, N> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Parameters").finish_non_exhaustive()
    }
}

impl<'a, 'b, const N: usize> Parameters<'a, 'b, N> {
    /// With what the node has of both.
    pub fn new(
        radio: Option<&'a RefCell<Service<'b, N>>>,
        outputs: Option<(&'a Shared<N>, [OutputSettings; N])>,
    ) -> Self {
        let outputs =
            outputs.map(|(shared, settings)| NodeOutputs { shared, changes: shared.changes(), settings });
        Self { radio, outputs }
    }

    /// Settings of the outputs of an engine, as they will be stored.
    pub fn output_settings(&self, engine: usize) -> Option<OutputSettings> {
        self.outputs.as_ref()?.settings.get(engine).copied()
    }

    /// Settings of radio control of an engine.
    pub fn engine_settings(&self, engine: usize) -> Option<EngineSettings> {
        self.radio?.borrow().pilots().get(engine).map(|pilot| *pilot.settings())
    }
}

impl<const N: usize> Attached for Parameters<'_, '_, N> {
    type Streams = NodeStreams;

    fn rows(&self) -> &'static [&'static [Row]] {
        rows(self.radio.is_some(), self.outputs.is_some())
    }

    fn number(&self, engine: usize, name: &str) -> Option<i32> {
        let radio = self.engine_settings(engine).and_then(|settings| settings.number(name));
        radio.or_else(|| self.output_settings(engine)?.number(name))
    }

    fn set(&mut self, engine: usize, name: &str, number: i32) -> Result<(), Refusal> {
        if let Some(mut settings) = self.engine_settings(engine)
            && settings.set(name, number)
        {
            let mut radio = self.radio.ok_or(Refusal::UnknownSetting)?.borrow_mut();
            let pilot = radio.pilot_mut(engine).ok_or(Refusal::UnknownSetting)?;
            return pilot.configure(settings).map_err(|error| match error {
                SettingsError::EngineTurns => Refusal::Turns,
                error => Refusal::Malformed(error.text()),
            });
        }
        let outputs = self.outputs.as_mut().and_then(|outputs| outputs.settings.get_mut(engine));
        let done = outputs.is_some_and(|outputs| outputs.set(name, number));
        if done { Ok(()) } else { Err(Refusal::UnknownSetting) }
    }

    fn calibrate(&mut self, engine: usize, begin: bool) -> Result<(), Refusal> {
        let mut radio = self.radio.ok_or(Refusal::NoReceiver)?.borrow_mut();
        radio.calibrate(engine, begin).ok_or(Refusal::NoReceiver)?.map_err(|error| match error {
            CalibrationError::EngineTurns => Refusal::Turns,
            error => Refusal::Malformed(error.text()),
        })
    }

    fn calibrated(&self) -> [&'static str; 2] {
        ["RC_THR_MIN", "RC_THR_MAX"]
    }

    fn set_damaged(&mut self, damaged: bool) {
        if let Some(radio) = self.radio {
            radio.borrow_mut().set_damaged(damaged);
        }
    }

    fn has_outputs(&self) -> bool {
        self.outputs.is_some()
    }

    fn outputs(&self, engine: usize) -> attached::Outputs {
        let Some(outputs) = &self.outputs else { return attached::Outputs::default() };
        attached::Outputs {
            valve: outputs.shared.valve_is_open(engine),
            power: outputs.shared.power_is_on(engine),
        }
    }

    fn next_change(&mut self) -> Option<attached::Change> {
        let changes = self.outputs.as_mut()?.changes.as_mut()?;
        loop {
            match changes.try_next_message()? {
                WaitResult::Message((engine, change)) => {
                    let (what, why) = (change.what(), change.why());
                    let alarming = why.is_alarming();
                    return Some(attached::Change { engine, what, why: why.text(), alarming });
                }
                // The state itself is sent in any case.
                WaitResult::Lagged(_) => {}
            }
        }
    }

    fn channels(&self, now: Instant) -> Option<Channels> {
        let radio = self.radio?.borrow();
        let channels = radio.channels(now);
        let pulse = |number| channels?.get(u8::try_from(number + 1).ok()?).map(|pulse| pulse.us());
        Some(core::array::from_fn(pulse))
    }

    fn link_quality(&self, now: Instant) -> Option<u8> {
        self.radio?.borrow().link_quality(now)
    }
}
