//! Radio control and outputs for MAVLink, where this node has them: their settings, as they are stored, and what the service is given. Without
//! them nothing of it is in the image.

use crate::outputs::SHARED;
use crate::radio::Radio;
use core::array::from_fn;
use jetlink_fw::config::{ENGINES, OUTPUTS, RADIO};
use jetlink_mavlink::attached::{Attached, Nothing};
use jetlink_mavlink::retained_settings::AttachedDefaults;
use jetlink_rc::parameters::{Parameters, apply, rows};
use jetlink_rc::settings::{EngineSettings, OutputSettings};

/// Number of engines of this node.
const N: usize = ENGINES.len();

/// Whether this node has any of them.
pub const ANY: bool = RADIO.is_some() || OUTPUTS.is_some();

/// Engines with settings of radio control, and with settings of outputs.
const WITH_RADIO: usize = if RADIO.is_some() { N } else { 0 };
const WITH_OUTPUTS: usize = if OUTPUTS.is_some() { N } else { 0 };

/// The settings of each engine.
pub struct Settings {
    /// Of radio control.
    pub radio: [EngineSettings; WITH_RADIO],
    /// Of the outputs.
    pub outputs: [OutputSettings; WITH_OUTPUTS],
}

impl Settings {
    /// As in `src/config.rs`.
    pub const fn new() -> Self {
        let mut radio = [EngineSettings::DEFAULT; WITH_RADIO];
        let mut outputs = [OutputSettings::DEFAULT; WITH_OUTPUTS];
        let mut engine = 0;
        while engine < N {
            if let Some(config) = RADIO {
                radio[engine] = config.engines[engine];
            }
            if let Some(config) = OUTPUTS {
                outputs[engine] = config[engine].settings;
            }
            engine += 1;
        }
        Self { radio, outputs }
    }

    /// Takes what is stored of an engine.
    pub fn apply(&mut self, engine: usize, record: &[u8]) {
        apply(self.radio.get_mut(engine), self.outputs.get_mut(engine), record);
    }
}

/// Those of this image.
pub const DEFAULTS: AttachedDefaults =
    AttachedDefaults { rows: rows(RADIO.is_some(), OUTPUTS.is_some()), number: default };

/// The value of one of them in this image.
fn default(engine: usize, name: &str) -> Option<i32> {
    static IMAGE: Settings = Settings::new();
    let radio = IMAGE.radio.get(engine).and_then(|settings| settings.number(name));
    radio.or_else(|| IMAGE.outputs.get(engine)?.number(name))
}

/// What the service is given.
pub trait Choice {
    /// Its type.
    type Attached: Attached;

    /// Gives it.
    fn attach(radio: Option<&'static Radio>, settings: &Settings) -> Self::Attached;
}

/// A node with one of them, or with none.
pub struct With<const ANY: bool>;

impl Choice for With<false> {
    type Attached = Nothing;

    fn attach(_: Option<&'static Radio>, _: &Settings) -> Nothing {
        Nothing
    }
}

impl Choice for With<true> {
    type Attached = Parameters<'static, 'static, N>;

    fn attach(radio: Option<&'static Radio>, settings: &Settings) -> Self::Attached {
        let outputs =
            from_fn(|engine| settings.outputs.get(engine).copied().unwrap_or(OutputSettings::DEFAULT));
        Parameters::new(radio, OUTPUTS.is_some().then_some((&SHARED, outputs)))
    }
}

/// What this node's service is given.
pub type Chosen = <With<ANY> as Choice>::Attached;
