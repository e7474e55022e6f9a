//! The telemetry of an AMT ECU. The ECU reports its engine, which determines the scales of rpm and voltages:
//!
//! - An alternate set has the engine's ID. An ID belongs to one engine, so one that the document does not print is another
//!   engine, and from there on the engine is not known: no scale is better than a wrong one.
//! - A set-up set has a version. The document prints some versions with their engine (AMT-9); each engine has had
//!   several, and newer ones are to be expected. So another version changes nothing: what was known before it, from the stream or
//!   from a hint, still applies.

use super::decoder::Telemetry;
use crate::json::{Escaped, Record, tenths};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use jetlink::ecu::amt::codec as amt;

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

    fn len((frame, _): &Self::Frame) -> usize {
        frame.raw().len()
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

    fn write(&mut self, end: u64, &(frame, message): &Self::Frame, record: &mut Record) -> &'static str {
        let name = match message {
            amt::Message::Normal { .. } => "normal",
            amt::Message::Error { .. } => "error",
            amt::Message::Alternate { .. } => "alternate",
            amt::Message::Setup(_) => "setup",
            amt::Message::Unknown => "unknown",
        };
        record.begin(end, "amt", name, frame.raw());
        match message {
            amt::Message::Normal { switch, state, rpm, egt, throttle, vout } => {
                let step = self.engine.and_then(amt::EngineModel::rpm_step);
                record.field("engine", self.engine.map(amt::EngineModel::name));
                record.field("switch", switch.name());
                record.field("state_code", state.code());
                record.field("state", state.name());
                record.field("rpm", step.map(|step| u32::from(rpm) * step));
                record.field("egt_c", tenths(egt.celsius().tenths()));
                record.field("throttle_pct", tenths(throttle.tenths()));
                record.field("vout_v", amt_volts(vout, self.engine.and_then(amt::EngineModel::vout_scale)));
            }
            amt::Message::Error { errors, egt, throttle, vout } => {
                record.field("engine", self.engine.map(amt::EngineModel::name));
                record.texts("errors", errors.names());
                record.field("error_bits", errors.0);
                record.field("egt_c", tenths(egt.celsius().tenths()));
                record.field("throttle_pct", tenths(throttle.tenths()));
                record.field("vout_v", amt_volts(vout, self.engine.and_then(amt::EngineModel::vout_scale)));
            }
            amt::Message::Alternate { engine_id, idle, max, battery, external } => {
                let rpm_voltage = self.engine.and_then(amt::EngineModel::vout_scale);
                record.field("engine_code", engine_id);
                record.field("engine", self.engine.map(amt::EngineModel::name));
                record.field("idle_v", amt_volts(idle, rpm_voltage));
                record.field("max_v", amt_volts(max, rpm_voltage));
                record.field(
                    "battery_v",
                    amt_volts(battery, self.engine.and_then(amt::EngineModel::battery_scale)),
                );
                record.field(
                    "external_v",
                    amt_volts(external, self.engine.and_then(amt::EngineModel::external_scale)),
                );
            }
            amt::Message::Setup(setup) => {
                record.field("pw_min_us", setup.pw_min_us());
                record.field("pw_max_us", setup.pw_max_us());
                record.field("version", sent(setup.version()));
                record.field("date", sent(setup.date()));
                record.field("engine", setup.engine().map(amt::EngineModel::name));
            }
            amt::Message::Unknown => {}
        }
        name
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
fn amt_volts(raw: u8, scale: Option<amt::VoltageScale>) -> Option<f64> {
    let scale = scale?;
    let full_scale = f64::from(scale.full_scale_mv) / 1000.0;
    Some(f64::from(scale.offset_mv) / 1000.0 + f64::from(raw) * full_scale / 255.0)
}

/// A text of a set-up set; `None`: it is not ASCII, and the codec returns an empty one.
fn sent(text: &str) -> Option<Escaped<'_>> {
    (!text.is_empty()).then_some(Escaped(text))
}
