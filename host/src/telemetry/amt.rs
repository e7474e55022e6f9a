//! The telemetry of an AMT ECU. The ECU reports its engine, which determines the scales of rpm and voltages:
//!
//! - An alternate set has the engine's ID. An ID belongs to one engine, so one that the document does not print is another
//!   engine, and from there on the engine is not known: no scale is better than a wrong one.
//! - A set-up set has a version. The document prints some versions with their engine (AMT-9); each engine has had
//!   several, and newer ones are to be expected. So another version changes nothing: what was known before it, from the stream or
//!   from a hint, still applies.

use super::decoder::Telemetry;
use crate::json::{Float, tenths};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use jetlink::ecu::amt::codec as amt;
use serde::ser::SerializeMap;

/// Settings of `jetlink decode`, until the stream reports them.
#[derive(clap::Args, Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct AmtHint {
    /// AMT: the engine until the stream names it.
    ///
    /// It gives rpm and voltages their scale. An AMT ECU names its engine once after power-up (set-up set) and
    /// after every ten normal sets (alternate set). What the stream reports wins.
    #[arg(
        long,
        value_name = "NAME",
        value_parser = PossibleValuesParser::new(amt::EngineModel::ALL.map(amt::EngineModel::name)).try_map(engine)
    )]
    pub engine: Option<amt::EngineModel>,
}

fn engine(name: String) -> Result<amt::EngineModel, String> {
    amt::EngineModel::ALL.into_iter().find(|engine| engine.name() == name).ok_or(name)
}

/// The telemetry of an AMT ECU.
#[derive(Debug)]
pub struct Amt {
    decoder: amt::Decoder,
    engine: Option<amt::EngineModel>,
}

impl Amt {
    /// What normal and error sets end with.
    fn measured<M: SerializeMap>(
        &self,
        egt: amt::EgtByte,
        throttle: amt::ThrottleByte,
        vout: u8,
        map: &mut M,
    ) -> Result<(), M::Error> {
        map.serialize_entry("egt_c", &tenths(egt.celsius().tenths()))?;
        map.serialize_entry("throttle_pct", &tenths(throttle.tenths()))?;
        map.serialize_entry("vout_v", &amt_volts(vout, self.engine.and_then(amt::EngineModel::vout_scale)))
    }
}

impl Telemetry for Amt {
    type Frame = (amt::Frame, amt::Message);
    type Hint = AmtHint;

    const HINT_OF_ANOTHER: &'static str = "--engine is only for --protocol amt";

    const FIELDS: &'static str = "    \
    normal       engine switch state_code state rpm egt_c throttle_pct vout_v
    error        engine errors error_bits egt_c throttle_pct vout_v
    alternate    engine_code engine idle_v max_v battery_v external_v
    setup        pw_min_us pw_max_us version date engine
    unknown      none: a kind that the document does not name
";

    fn new(hint: AmtHint) -> Self {
        Self { decoder: amt::Decoder::new(), engine: hint.engine }
    }

    fn name(&self) -> &'static str {
        "amt"
    }

    fn feed(&mut self, bytes: &[u8]) -> (usize, Option<Self::Frame>) {
        let (taken, frame) = self.decoder.feed(bytes);
        let frame = frame.map(|frame| (frame, frame.message()));
        match frame {
            Some((_, amt::Message::Alternate { engine_id, .. })) => {
                self.engine = amt::EngineModel::from_id(engine_id);
            }
            Some((_, amt::Message::Setup(setup))) => self.engine = setup.engine().or(self.engine),
            _ => {}
        }
        (taken, frame)
    }

    fn text(&self, &(_, message): &Self::Frame) -> String {
        match message {
            amt::Message::Normal { switch, state, rpm, egt, throttle, .. } => {
                let step = self.engine.and_then(amt::EngineModel::rpm_step);
                let rpm = step.map_or_else(
                    || format!("rpm byte {rpm}"),
                    |step| format!("{} rpm", u32::from(rpm) * step),
                );
                format!(
                    "{}, {}, {rpm}, EGT {} °C, throttle {:.1} %",
                    switch.name(),
                    state.name(),
                    egt.celsius().tenths() / 10,
                    f64::from(throttle.tenths()) / 10.0
                )
            }
            amt::Message::Error { errors, egt, .. } => {
                let names: Vec<&str> = errors.names().collect();
                format!("faults: {}; EGT {} °C; no rpm", names.join(", "), egt.celsius().tenths() / 10)
            }
            amt::Message::Alternate { engine_id, .. } => {
                format!(
                    "alternate: {}",
                    amt::EngineModel::from_id(engine_id).map_or("unknown engine", amt::EngineModel::name)
                )
            }
            amt::Message::Setup(_) => "set-up".to_owned(),
            amt::Message::Unknown => "unknown kind".to_owned(),
        }
    }

    fn raw((frame, _): &Self::Frame) -> &[u8] {
        frame.raw()
    }

    fn frame_name((_, message): &Self::Frame) -> &'static str {
        match message {
            amt::Message::Normal { .. } => "normal",
            amt::Message::Error { .. } => "error",
            amt::Message::Alternate { .. } => "alternate",
            amt::Message::Setup(_) => "setup",
            amt::Message::Unknown => "unknown",
        }
    }

    fn fields<M: SerializeMap>(&self, &(_, message): &Self::Frame, map: &mut M) -> Result<(), M::Error> {
        match message {
            amt::Message::Normal { switch, state, rpm, egt, throttle, vout } => {
                let step = self.engine.and_then(amt::EngineModel::rpm_step);
                map.serialize_entry("engine", &self.engine.map(amt::EngineModel::name))?;
                map.serialize_entry("switch", &switch.name())?;
                map.serialize_entry("state_code", &state.code())?;
                map.serialize_entry("state", &state.name())?;
                map.serialize_entry("rpm", &step.map(|step| u32::from(rpm) * step))?;
                self.measured(egt, throttle, vout, map)?;
            }
            amt::Message::Error { errors, egt, throttle, vout } => {
                map.serialize_entry("engine", &self.engine.map(amt::EngineModel::name))?;
                map.serialize_entry("errors", &errors.names().collect::<Vec<_>>())?;
                map.serialize_entry("error_bits", &errors.0)?;
                self.measured(egt, throttle, vout, map)?;
            }
            amt::Message::Alternate { engine_id, idle, max, battery, external } => {
                let rpm_voltage = self.engine.and_then(amt::EngineModel::vout_scale);
                map.serialize_entry("engine_code", &engine_id)?;
                map.serialize_entry("engine", &self.engine.map(amt::EngineModel::name))?;
                map.serialize_entry("idle_v", &amt_volts(idle, rpm_voltage))?;
                map.serialize_entry("max_v", &amt_volts(max, rpm_voltage))?;
                map.serialize_entry(
                    "battery_v",
                    &amt_volts(battery, self.engine.and_then(amt::EngineModel::battery_scale)),
                )?;
                map.serialize_entry(
                    "external_v",
                    &amt_volts(external, self.engine.and_then(amt::EngineModel::external_scale)),
                )?;
            }
            amt::Message::Setup(setup) => {
                map.serialize_entry("pw_min_us", &setup.pw_min_us())?;
                map.serialize_entry("pw_max_us", &setup.pw_max_us())?;
                map.serialize_entry("version", &sent(setup.version()))?;
                map.serialize_entry("date", &sent(setup.date()))?;
                map.serialize_entry("engine", &setup.engine().map(amt::EngineModel::name))?;
            }
            amt::Message::Unknown => {}
        }
        Ok(())
    }

    fn counters(&self) -> Vec<(&'static str, u32)> {
        let counters = self.decoder.counters();
        vec![
            ("unknown frames", counters.unknown_frames),
            ("truncated frames", counters.truncated),
            ("malformed set-up sets", counters.malformed),
            ("bytes skipped", counters.bytes_skipped),
        ]
    }

    fn pending(&self) -> usize {
        self.decoder.pending()
    }
}

/// Voltage by the document's formula. One step is not a whole number of any decimal unit: [`amt::VoltageScale::millivolts`] rounds, and
/// this has the decimals of a 64-bit floating-point number.
fn amt_volts(raw: u8, scale: Option<amt::VoltageScale>) -> Option<Float> {
    let scale = scale?;
    let full_scale = f64::from(scale.full_scale_mv) / 1000.0;
    Some(Float(f64::from(scale.offset_mv) / 1000.0 + f64::from(raw) * full_scale / 255.0))
}

/// A text of a set-up set; `None`: it is not ASCII, and the codec returns an empty one.
fn sent(text: &str) -> Option<&str> {
    (!text.is_empty()).then_some(text)
}
