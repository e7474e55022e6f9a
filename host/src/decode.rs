//! `jetlink decode`: raw bytes from an ECU's TX line in, one JSON object a line out (JSON Lines).
//!
//! The codecs give the frames with their scale; this file gives names, units and order to what they say. It
//! holds one read buffer, one line and one frame begun, however long the input is.
//!
//! What the stream tells about itself is kept while it is read, and wins over the hints of the command line:
//!
//! - ZK: status ID 6 tells the protocol version (ZK-6).
//! - AMT: an alternate set tells the engine. An ID has one engine, so an ID without a name is another engine,
//!   and from there on the engine is not known: no scale is better than a wrong one.
//! - AMT: a set-up set tells the engine by its version, if an engine is printed for that version (AMT-9). A
//!   version without one tells nothing, since each engine had several and newer ones are to be expected: the
//!   set-up set itself gives no engine, and what was known before it (a hint is for just this case) stays.

use crate::decode_hint::{Hint, Other};
use clap::ValueEnum;
use clap::builder::{PossibleValuesParser, RangedI64ValueParser, TypedValueParser};
use jetlink::ecu::amt::codec as amt;
use jetlink::ecu::zk::codec as zk;
use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter, ErrorKind, Read, Write};
use std::path::PathBuf;
use std::process::ExitCode;

/// Exit status for an input that cannot be read (and an output that cannot be written).
const CANNOT_READ: u8 = 1;
/// Exit status for bad arguments, clap's own included.
const BAD_ARGUMENTS: u8 = 2;

/// Bytes of the read buffer and of the write buffer.
const BUFFER: usize = 64 * 1024;

/// Print what an ECU sent, from captured raw bytes, as JSON Lines.
///
/// Reads raw bytes as captured on the ECU's TX line and prints one JSON object a line to standard output for
/// every frame, in the order of the bytes. A summary for people goes to standard error.
#[derive(clap::Args, Debug)]
#[command(after_long_help = HELP)]
pub struct Args {
    /// Protocol that the ECU speaks.
    #[arg(long, value_enum)]
    protocol: Protocol,

    /// AMT: the engine until the stream names it.
    ///
    /// It gives rpm and voltages their scale. An AMT ECU names its engine once after power-up (set-up set) and
    /// after every ten normal sets (alternate set). What the stream tells wins.
    #[arg(
        long,
        value_name = "NAME",
        value_parser = PossibleValuesParser::new(amt::EngineModel::ALL.map(amt::EngineModel::name)).try_map(engine)
    )]
    engine: Option<amt::EngineModel>,

    /// ZK: the ECU's protocol version, 0 to 63, until the stream tells it.
    ///
    /// It gives voltages their scale. A ZK ECU tells its version in status-6. What the stream tells wins.
    #[arg(
        long,
        value_name = "N",
        value_parser = RangedI64ValueParser::<u8>::new().range(0..=63).try_map(zk::Version::new)
    )]
    zk_version: Option<zk::Version>,

    /// File with the raw bytes; `-` or nothing for standard input.
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
}

#[derive(ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
enum Protocol {
    /// AMT serial control: Mercury, Pegasus, Olympus, Titan, Nike, Lynx, Orion.
    Amt,
    /// ZK-Protocol.
    Zk,
}

const HELP: &str = "\
Output:
  Every object has offset (of the frame's first byte in the input), protocol, frame and raw (the frame's
  bytes in hex). The further fields by frame:

  zk
    every frame  rpm
    status-1     state_code state error_code error switch_code switch egt_c
    status-2     radio_v power_v pump_v
    status-3     throttle_pct pressure_pa
    status-4     current_a thrust_kg
    status-5     ignition_pump_v curve_increase curve_decrease
    status-6     max_rpm max_pump_v protocol_version rate_hz
    status-7     flow_l_min fuel_l
    status-8     idle_rpm pressure_requested closed_loop startup_s
    status-9     ecu_c
    unknown-N    none: another ID with a good CRC
  amt
    normal       engine switch state_code state rpm egt_c throttle_pct vout_v
    error        engine errors error_bits egt_c throttle_pct vout_v
    alternate    engine_code engine idle_v max_v battery_v external_v
    setup        pw_min_us pw_max_us version date engine
    unknown      none: a kind that the document does not name

  Values are in the unit of their name, exact to the protocol's own step. A value that cannot be known is
  null and never left out: a voltage while the engine or the ZK version is not known, a scale that the
  document does not give, a field of a ZK version newer than the one known. The bytes are always in raw.

  Bytes that belong to no frame are skipped and counted. A frame that the end of the input cuts off is not
  printed. AMT has no checksum: a 0xFF inside a frame drops it and starts a new one.

Exit status:
  0  the input was read to its end, or nobody reads the output any more
  1  the input cannot be read, or the output not written
  2  bad arguments

Examples:
  jetlink decode --protocol zk docs/captures/zk-simulated.bin
  jetlink decode --protocol amt docs/captures/amt-simulated.bin | jq 'select(.frame == \"alternate\")'
  stty -F /dev/ttyUSB0 9600 cs8 -parenb -cstopb raw -echo    (the baud rate and stop bits of your ECU)
  cat /dev/ttyUSB0 | jetlink decode --protocol zk";

fn engine(name: String) -> Result<amt::EngineModel, String> {
    amt::EngineModel::ALL.into_iter().find(|engine| engine.name() == name).ok_or(name)
}

/// Runs it.
pub fn run(args: Args) -> ExitCode {
    let outcome = match (args.protocol, args.engine, args.zk_version) {
        (Protocol::Amt, _, Some(_)) => Err(Failure::Arguments("--zk-version is only for --protocol zk")),
        (Protocol::Zk, Some(_), _) => Err(Failure::Arguments("--engine is only for --protocol amt")),
        (Protocol::Amt, engine, None) => {
            decode_file(args.file, Amt { decoder: amt::Decoder::new(), engine }, Other::zk())
        }
        (Protocol::Zk, None, version) => {
            decode_file(args.file, Zk { decoder: zk::Decoder::new(), version }, Other::amt())
        }
    };
    // Nothing can be said any more once standard error is gone, so failing to say it is no failure.
    match outcome {
        Ok(summary) => {
            let _ = write!(io::stderr(), "{summary}");
            ExitCode::SUCCESS
        }
        // Whoever read the output has had enough of it, as `head` does: that is no failure of ours.
        Err(Failure::Output(error)) if error.kind() == ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(failure) => {
            let _ = writeln!(io::stderr(), "error: {failure}");
            ExitCode::from(if matches!(failure, Failure::Arguments(_)) { BAD_ARGUMENTS } else { CANNOT_READ })
        }
    }
}

/// Why it ended before the end of the input.
#[derive(Debug)]
enum Failure {
    Arguments(&'static str),
    Input { name: String, error: io::Error },
    Output(io::Error),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Arguments(what) => f.write_str(what),
            Self::Input { name, error } => write!(f, "cannot read {name}: {error}"),
            Self::Output(error) => write!(f, "cannot write to standard output: {error}"),
        }
    }
}

fn decode_file(file: Option<PathBuf>, source: impl Source, other: Other) -> Result<Summary, Failure> {
    let file = file.filter(|path| path.as_os_str() != "-");
    let name = file.as_ref().map_or_else(|| "standard input".into(), |path| path.display().to_string());
    let input: io::Result<Box<dyn Read>> = match file {
        Some(path) => File::open(path).map(|file| Box::new(file) as _),
        None => Ok(Box::new(io::stdin().lock())),
    };
    let unreadable = |error| Failure::Input { name: name.clone(), error };
    decode(
        &mut input.map_err(unreadable)?,
        &mut BufWriter::with_capacity(BUFFER, io::stdout().lock()),
        source,
        other,
        unreadable,
    )
}

fn decode(
    input: &mut dyn Read,
    output: &mut dyn Write,
    mut source: impl Source,
    mut other: Other,
    unreadable: impl Fn(io::Error) -> Failure,
) -> Result<Summary, Failure> {
    let mut summary = Summary::default();
    let mut record = Record::default();
    let mut buffer = vec![0; BUFFER];
    loop {
        let count = match input.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => count,
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(error) => return Err(unreadable(error)),
        };
        other.feed(&buffer[..count]);
        let before = source.counters();
        let mut rest = &buffer[..count];
        while !rest.is_empty() {
            let (taken, frame) = source.feed(rest);
            rest = &rest[taken..];
            summary.bytes += taken as u64;
            let Some(frame) = frame else { continue };
            summary.in_frames += source.len(&frame) as u64;
            let kind = source.write(summary.bytes, &frame, &mut record);
            output.write_all(record.line()).map_err(Failure::Output)?;
            add(&mut summary.kinds, kind, 1);
        }
        // The decoder's counts wrap at 32 bits; what one buffer adds to them does not.
        for ((what, before), (_, now)) in before.into_iter().zip(source.counters()) {
            add(&mut summary.counters, what, now.wrapping_sub(before).into());
        }
        // So that frames of a live line come out when they come in, and not a buffer later.
        output.flush().map_err(Failure::Output)?;
    }
    summary.pending = source.pending();
    let outside = summary.bytes - summary.in_frames - summary.pending as u64;
    summary.hint = Hint::of(summary.bytes, outside, source.name(), other);
    Ok(summary)
}

/// What was read, for people.
#[derive(Default, Debug)]
struct Summary {
    bytes: u64,
    kinds: Vec<(&'static str, u64)>,
    counters: Vec<(&'static str, u64)>,
    /// Bytes that belong to frames.
    in_frames: u64,
    pending: usize,
    hint: Option<Hint>,
}

/// At most as many entries as there are names: sixteen.
fn add(counts: &mut Vec<(&'static str, u64)>, name: &'static str, more: u64) {
    match counts.iter_mut().find(|(known, _)| *known == name) {
        Some((_, count)) => *count += more,
        None => counts.push((name, more)),
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let frames: u64 = self.kinds.iter().map(|(_, count)| count).sum();
        writeln!(f, "{} bytes read", self.bytes)?;
        writeln!(f, "{frames} frames")?;
        let mut kinds = self.kinds.clone();
        kinds.sort_unstable();
        for (kind, count) in kinds {
            writeln!(f, "  {count} {kind}")?;
        }
        for (what, count) in &self.counters {
            writeln!(f, "{count} {what}")?;
        }
        writeln!(f, "{} bytes pending at the end", self.pending)?;
        self.hint.iter().try_for_each(|hint| writeln!(f, "{hint}"))
    }
}

/// A protocol's decoder, with what the stream has told so far.
trait Source {
    type Frame;

    /// The protocol, as the command line names it.
    fn name(&self) -> &'static str;

    /// Bytes of a frame.
    fn len(&self, frame: &Self::Frame) -> usize;

    /// Takes bytes up to the end of the first frame, as the codecs' decoders do.
    fn feed(&mut self, bytes: &[u8]) -> (usize, Option<Self::Frame>);

    /// Learns from a frame that ends at `end` and writes what it says. Gives its name.
    fn write(&mut self, end: u64, frame: &Self::Frame, record: &mut Record) -> &'static str;

    /// What the decoder counts, with words for people. The counts wrap.
    fn counters(&self) -> Vec<(&'static str, u32)>;

    /// Bytes of a frame begun.
    fn pending(&self) -> usize;
}

// ---------------------------------------------------------------------------------------------
// ZK
// ---------------------------------------------------------------------------------------------

#[derive(Debug)]
struct Zk {
    decoder: zk::Decoder,
    version: Option<zk::Version>,
}

impl Zk {
    /// A field that ECUs carry from a version on (ZK-7): nothing if the version is known to be lower. While
    /// it is not known the field is given as it came, since its scale does not depend on the version.
    fn since<T>(&self, since: zk::Version, value: T) -> Option<T> {
        (zk::Version::knows(self.version, since) != Some(false)).then_some(value)
    }
}

impl Source for Zk {
    type Frame = zk::StatusFrame;

    fn name(&self) -> &'static str {
        "zk"
    }

    fn len(&self, frame: &Self::Frame) -> usize {
        frame.raw().len()
    }

    fn feed(&mut self, bytes: &[u8]) -> (usize, Option<Self::Frame>) {
        self.decoder.feed(bytes)
    }

    fn write(&mut self, end: u64, frame: &Self::Frame, record: &mut Record) -> &'static str {
        let name = zk_name(frame.id());
        record.begin(end, "zk", name, frame.raw());
        record.field("rpm", frame.rpm().get());
        match frame.status() {
            zk::Status::Engine { state, error, egt, switch } => {
                record.field("state_code", state.code());
                record.field("state", state.name());
                record.field("error_code", error.code());
                record.field("error", error.name());
                record.field("switch_code", switch.code());
                record.field("switch", switch.name());
                record.field("egt_c", tenths(egt.tenths()));
            }
            zk::Status::Voltages { radio, power, pump } => {
                for (key, byte) in [("radio_v", radio), ("power_v", power), ("pump_v", pump)] {
                    record.field(key, zk_volts(byte, self.version));
                }
            }
            zk::Status::Throttle { percent, pressure } => {
                record.field("throttle_pct", percent);
                record.field("pressure_pa", pressure.get());
            }
            zk::Status::Load { current, thrust } => {
                record.field("current_a", thousandths(current.get()));
                record.field("thrust_kg", self.since(zk::Status::THRUST_SINCE, thousandths(thrust.get())));
            }
            zk::Status::Settings { ignition_pump, increase, decrease } => {
                record.field("ignition_pump_v", thousandths(ignition_pump.get()));
                record.field("curve_increase", increase);
                record.field("curve_decrease", decrease);
            }
            zk::Status::Identity { max_rpm, max_pump, version, rate } => {
                self.version = Some(version);
                record.field("max_rpm", max_rpm.get());
                record.field("max_pump_v", zk_volts(max_pump, Some(version)));
                record.field("protocol_version", version.get());
                record.field("rate_hz", rate.map(zk::Rate::hz));
            }
            zk::Status::Fuel { flow, total } => {
                record.field("flow_l_min", thousandths(flow.get()));
                record.field("fuel_l", thousandths(total.get()));
            }
            zk::Status::Idle { idle_rpm, pressure_requested, closed_loop, startup } => {
                record.field("idle_rpm", idle_rpm.get());
                record
                    .field("pressure_requested", self.since(zk::Status::IDLE_REST_SINCE, pressure_requested));
                record.field("closed_loop", self.since(zk::Status::IDLE_REST_SINCE, closed_loop));
                // Twelve bits of 0.1 s.
                record.field(
                    "startup_s",
                    self.since(zk::Status::IDLE_REST_SINCE, thousandths(startup.as_millis() as u32)),
                );
            }
            zk::Status::Temperature { ecu } => record.field("ecu_c", tenths(ecu.tenths())),
            zk::Status::Unknown => {}
        }
        name
    }

    fn counters(&self) -> Vec<(&'static str, u32)> {
        let counters = self.decoder.counters();
        vec![
            ("unknown frames", counters.unknown_frames),
            ("CRC failures", counters.crc_failures),
            ("bytes skipped", counters.bytes_skipped),
        ]
    }

    fn pending(&self) -> usize {
        self.decoder.pending()
    }
}

/// Name of a frame by its ID, four bits. 15 does not come: 0xFF is the control head (ZK-16).
fn zk_name(id: u8) -> &'static str {
    match id {
        0 => "unknown-0",
        1 => "status-1",
        2 => "status-2",
        3 => "status-3",
        4 => "status-4",
        5 => "status-5",
        6 => "status-6",
        7 => "status-7",
        8 => "status-8",
        9 => "status-9",
        10 => "unknown-10",
        11 => "unknown-11",
        12 => "unknown-12",
        13 => "unknown-13",
        14 => "unknown-14",
        _ => "unknown-15",
    }
}

fn zk_volts(byte: zk::VoltageByte, version: Option<zk::Version>) -> Option<f64> {
    byte.millivolts(version).map(|voltage| thousandths(voltage.get()))
}

// ---------------------------------------------------------------------------------------------
// AMT
// ---------------------------------------------------------------------------------------------

#[derive(Debug)]
struct Amt {
    decoder: amt::Decoder,
    engine: Option<amt::EngineModel>,
}

impl Source for Amt {
    type Frame = amt::Frame;

    fn name(&self) -> &'static str {
        "amt"
    }

    fn len(&self, frame: &Self::Frame) -> usize {
        frame.raw().len()
    }

    fn feed(&mut self, bytes: &[u8]) -> (usize, Option<Self::Frame>) {
        self.decoder.feed(bytes)
    }

    fn write(&mut self, end: u64, frame: &Self::Frame, record: &mut Record) -> &'static str {
        let message = frame.message();
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
                self.engine = amt::EngineModel::from_id(engine_id);
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
                let engine = setup.engine();
                self.engine = engine.or(self.engine);
                record.field("pw_min_us", setup.pw_min_us());
                record.field("pw_max_us", setup.pw_max_us());
                record.field("version", sent(setup.version()));
                record.field("date", sent(setup.date()));
                record.field("engine", engine.map(amt::EngineModel::name));
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

/// The document's own formula in the document's own numbers, so that both give the same: the codec's
/// [`amt::VoltageScale::millivolts`] rounds, and one step is not a whole number of mV.
fn amt_volts(raw: u8, scale: Option<amt::VoltageScale>) -> Option<f64> {
    let scale = scale?;
    let full_scale = f64::from(scale.full_scale_mv) / 1000.0;
    Some(f64::from(scale.offset_mv) / 1000.0 + f64::from(raw) * full_scale / 255.0)
}

/// A text of a set-up set. The codec gives an empty one if it is not ASCII.
fn sent(text: &str) -> Option<Escaped<'_>> {
    (!text.is_empty()).then_some(Escaped(text))
}

// ---------------------------------------------------------------------------------------------
// JSON
// ---------------------------------------------------------------------------------------------

/// The number nearest to so many tenths, as one would write it.
fn tenths(value: impl Into<f64>) -> f64 {
    value.into() / 10.0
}

/// The number nearest to so many thousandths, as one would write it.
fn thousandths(value: u32) -> f64 {
    f64::from(value) / 1000.0
}

/// One line of output, with room that is used again for the next.
///
/// Written by hand and not through `serde_json::Value`: that would allocate some twenty times a frame, and
/// print whole numbers among the decimals as `51.0`. Writing to a `Vec` does not fail.
#[derive(Default, Debug)]
struct Record(Vec<u8>);

impl Record {
    fn begin(&mut self, end: u64, protocol: &'static str, frame: &'static str, raw: &[u8]) {
        self.0.clear();
        self.field("offset", end - raw.len() as u64);
        self.field("protocol", protocol);
        self.field("frame", frame);
        self.key("raw");
        self.0.push(b'"');
        for byte in raw {
            for digit in [byte >> 4, byte & 0x0F] {
                self.0.push(b"0123456789abcdef"[usize::from(digit)]);
            }
        }
        self.0.push(b'"');
    }

    /// `key` must need no escapes; all of ours are literals without any.
    fn key(&mut self, key: &str) {
        self.0.push(if self.0.is_empty() { b'{' } else { b',' });
        self.0.push(b'"');
        self.0.extend_from_slice(key.as_bytes());
        self.0.extend_from_slice(b"\":");
    }

    fn field(&mut self, key: &str, value: impl Json) {
        self.key(key);
        value.append_to(&mut self.0);
    }

    fn texts(&mut self, key: &str, values: impl Iterator<Item = &'static str>) {
        self.key(key);
        self.0.push(b'[');
        for (i, value) in values.enumerate() {
            if i > 0 {
                self.0.push(b',');
            }
            value.append_to(&mut self.0);
        }
        self.0.push(b']');
    }

    fn line(&mut self) -> &[u8] {
        self.0.extend_from_slice(b"}\n");
        &self.0
    }
}

/// A value of a field.
trait Json {
    fn append_to(&self, json: &mut Vec<u8>);
}

macro_rules! json_as_displayed {
    ($($type:ty),+) => {
        $(impl Json for $type {
            fn append_to(&self, json: &mut Vec<u8>) {
                let _ = write!(json, "{self}");
            }
        })+
    };
}
// What Rust displays is JSON: for f64 the shortest decimals that read back the same, without exponent, whole
// numbers without point. All of ours are finite, and none is -0.
json_as_displayed!(bool, u8, u32, u64, i32, f64);

/// A literal of this program or of the codecs: none needs an escape.
impl Json for &'static str {
    fn append_to(&self, json: &mut Vec<u8>) {
        json.push(b'"');
        json.extend_from_slice(self.as_bytes());
        json.push(b'"');
    }
}

/// A text from the wire, which may hold anything.
struct Escaped<'a>(&'a str);

impl Json for Escaped<'_> {
    fn append_to(&self, json: &mut Vec<u8>) {
        let _ = serde_json::to_writer(json, self.0);
    }
}

impl<T: Json> Json for Option<T> {
    fn append_to(&self, json: &mut Vec<u8>) {
        match self {
            Some(value) => value.append_to(json),
            None => json.extend_from_slice(b"null"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::VecDeque;

    /// Gives what it was told to give, piece by piece.
    struct Script(VecDeque<io::Result<&'static [u8]>>);

    impl Read for Script {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let piece = self.0.pop_front().unwrap_or(Ok(&[]))?;
            buffer[..piece.len()].copy_from_slice(piece);
            Ok(piece.len())
        }
    }

    fn run_zk(
        script: impl IntoIterator<Item = io::Result<&'static [u8]>>,
    ) -> (String, Result<Summary, Failure>) {
        let mut output = Vec::new();
        let mut input = Script(script.into_iter().collect());
        let source = Zk { decoder: zk::Decoder::new(), version: None };
        let unreadable = |error| Failure::Input { name: "the script".into(), error };
        let result = decode(&mut input, &mut output, source, Other::zk(), unreadable);
        (String::from_utf8(output).unwrap(), result)
    }

    /// Two frames with a broken one and noise between.
    const STREAM: &[u8] = b"\xF1\0\0\0\0\x4C\xA0\xF1\0\0\0\0\x4D\xA0\x12\xF6\0\0\xA0\0\x10\xAB";

    #[test]
    fn pieces_and_interruptions_change_nothing() {
        let (whole, summary) = run_zk([Ok(STREAM)]);
        assert_eq!(whole.lines().count(), 2);
        let summary = summary.unwrap().to_string();
        assert_eq!(
            summary,
            "22 bytes read\n2 frames\n  1 status-1\n  1 status-6\n0 unknown frames\n1 CRC failures\n8 bytes skipped\n\
             0 bytes pending at the end\n"
        );
        for size in 1..STREAM.len() {
            let pieces =
                STREAM.chunks(size).flat_map(|piece| [Err(ErrorKind::Interrupted.into()), Ok(piece)]);
            let (output, result) = run_zk(pieces);
            assert_eq!(
                (output, result.unwrap().to_string()),
                (whole.clone(), summary.clone()),
                "pieces of {size}"
            );
        }
    }

    #[test]
    fn frames_before_a_read_error_are_printed() {
        let (output, result) = run_zk([Ok(STREAM), Err(io::Error::other("the medium broke")), Ok(STREAM)]);
        assert_eq!(output.lines().count(), 2);
        assert_eq!(result.unwrap_err().to_string(), "cannot read the script: the medium broke");
    }

    #[test]
    fn numbers_are_written_as_people_write_them() {
        let mut json = Vec::new();
        for value in [0.0, -50.0, 51.0, 12.3, tenths(-3), thousandths(1_638_300), 131_070.0, 6.25 / 255.0] {
            value.append_to(&mut json);
            json.push(b' ');
        }
        assert_eq!(
            String::from_utf8(json).unwrap(),
            "0 -50 51 12.3 -0.3 1638.3 131070 0.024509803921568627 "
        );
    }

    /// Every step of a ZK value is printed with no more digits than the step has.
    #[test]
    fn no_step_shows_binary_dust() {
        for thousand in (0..=3_276_700).step_by(10) {
            let text = thousandths(thousand).to_string();
            assert!(
                text.split_once('.').is_none_or(|(_, decimals)| decimals.len() <= 2),
                "{thousand}: {text}"
            );
        }
    }
}
