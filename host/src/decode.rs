//! `jetlink decode`: raw bytes from an ECU's TX line in, one JSON object a line out (JSON Lines).
//!
//! Holds one read buffer, one line of output and one incomplete frame, however long the input is. The stream's own reports take
//! precedence over the hints of the command line.

use crate::decode_hint::{Beside, Hint};
use crate::signals::read_pipe_to_its_end;
use crate::telemetry::decoder::Decoder;
use crate::telemetry::{self, Protocol};
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
#[command(after_long_help = help())]
pub struct Args {
    /// Protocol of the ECU.
    #[arg(long, value_enum)]
    protocol: Protocol,

    #[command(flatten)]
    hints: telemetry::Hints,

    /// File with the raw bytes; `-` or nothing for standard input.
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
}

/// Text before and after the fields of all protocols.
const HELP: [&str; 2] = [
    "\
Output:
  Every object has offset (of the frame's first byte in the input), protocol, frame and raw (the frame's
  bytes in hex). The further fields by frame:

",
    "
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
  cat /dev/ttyUSB0 | jetlink decode --protocol zk            (Ctrl-C ends both, with the summary)",
];

fn help() -> String {
    HELP.join(&Protocol::all().map(Protocol::fields).collect::<String>())
}

/// Runs it.
pub fn run(args: Args) -> ExitCode {
    let decoder = args.protocol.decoder(&args.hints);
    let beside = Beside::new(args.protocol);
    let outcome = args
        .hints
        .check(args.protocol)
        .map_err(Failure::Arguments)
        .and_then(|()| decode_file(args.file, decoder, beside));
    // If standard error is closed nothing can be printed, so a failed print is not a failure.
    match outcome {
        Ok(summary) => {
            let _ = write!(io::stderr(), "{summary}");
            ExitCode::SUCCESS
        }
        // The reader has closed the output, as `head` does: not a failure.
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

fn decode_file(file: Option<PathBuf>, decoder: Box<dyn Decoder>, beside: Beside) -> Result<Summary, Failure> {
    let file = file.filter(|path| path.as_os_str() != "-");
    let name = file.as_ref().map_or_else(|| "standard input".into(), |path| path.display().to_string());
    let input: io::Result<Box<dyn Read>> = match file {
        Some(path) => File::open(path).map(|file| Box::new(file) as _),
        None => read_pipe_to_its_end().map(|()| Box::new(io::stdin().lock()) as _),
    };
    let unreadable = |error| Failure::Input { name: name.clone(), error };
    decode(
        &mut input.map_err(unreadable)?,
        &mut BufWriter::with_capacity(BUFFER, io::stdout().lock()),
        decoder,
        beside,
        unreadable,
    )
}

fn decode(
    input: &mut dyn Read,
    output: &mut dyn Write,
    mut decoder: Box<dyn Decoder>,
    mut beside: Beside,
    unreadable: impl Fn(io::Error) -> Failure,
) -> Result<Summary, Failure> {
    let mut summary = Summary::default();
    let mut line = Vec::new();
    let mut buffer = vec![0; BUFFER];
    loop {
        let count = match input.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => count,
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(error) => return Err(unreadable(error)),
        };
        beside.feed(&buffer[..count]);
        let before = decoder.counters();
        let mut rest = &buffer[..count];
        while !rest.is_empty() {
            let (taken, frame) = decoder.next_record(summary.bytes, rest, &mut line);
            rest = &rest[taken..];
            summary.bytes += taken as u64;
            let Some((length, kind)) = frame else { continue };
            summary.in_frames += length as u64;
            output.write_all(&line).map_err(Failure::Output)?;
            add(&mut summary.kinds, kind, 1);
        }
        // The decoder's counts wrap at 32 bits; the increments of one buffer do not.
        for ((what, before), (_, now)) in before.into_iter().zip(decoder.counters()) {
            add(&mut summary.counters, what, now.wrapping_sub(before).into());
        }
        // Frames of a live line are then printed as they arrive, not a buffer later.
        output.flush().map_err(Failure::Output)?;
    }
    summary.pending = decoder.pending();
    let outside = summary.bytes - summary.in_frames - summary.pending as u64;
    summary.hint = Hint::of(summary.bytes, outside, decoder.name(), beside);
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

/// At most sixteen names, so a search in order suffices.
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::VecDeque;

    /// Returns these pieces, one by one.
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
        let decoder = Protocol::Zk.decoder(&telemetry::Hints::default());
        let unreadable = |error| Failure::Input { name: "the script".into(), error };
        let result = decode(&mut input, &mut output, decoder, Beside::new(Protocol::Zk), unreadable);
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
}
