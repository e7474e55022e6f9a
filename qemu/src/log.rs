//! The firmware's log: decoded, printed, and collected.

use crate::image::Image;
use defmt_decoder::{DecodeError, Table};
use std::io::Read;
use std::process::ChildStdout;
use std::thread::JoinHandle;

/// One line.
pub struct Line {
    /// When, as the firmware gives it.
    pub time: String,
    /// "INFO", "WARN", ...
    pub level: &'static str,
    /// Text.
    pub message: String,
}

impl Line {
    /// What two runs of the same have in common.
    pub fn is_same(&self, other: &Self) -> bool {
        (self.level, &self.message) == (other.level, &other.message)
    }
}

/// What came.
#[derive(Default)]
pub struct Lines {
    /// Lines, in order.
    pub lines: Vec<Line>,
    /// Frames that could not be decoded.
    pub malformed: usize,
}

/// A log that a thread decodes.
pub struct Log(JoinHandle<Lines>);

impl Log {
    /// Decodes the log in a thread, and prints the lines that `show` selects.
    pub fn follow(
        image: &Image,
        source: Option<ChildStdout>,
        show: fn(&Line) -> bool,
    ) -> Result<Self, String> {
        let table = Table::parse(&image.elf)
            .map_err(|why| format!("cannot read the image's log table: {why}"))?
            .ok_or("the image has no log table")?;
        let source = source.ok_or("QEMU's output is in use already")?;
        Ok(Self(std::thread::spawn(move || follow(&table, source, show))))
    }

    /// Waits for the end of the log, which is the end of QEMU.
    ///
    /// # Panics
    /// If the decoder panicked.
    pub fn finish(self) -> Lines {
        self.0.join().expect("the log's decoder panicked")
    }
}

fn follow(table: &Table, mut source: ChildStdout, show: fn(&Line) -> bool) -> Lines {
    let mut decoder = table.new_stream_decoder();
    let mut log = Lines::default();
    let mut buffer = [0; 4096];
    while let Ok(count @ 1..) = source.read(&mut buffer) {
        decoder.received(&buffer[..count]);
        loop {
            match decoder.decode() {
                Ok(frame) => {
                    let level = frame.level().map_or("", |level| match level.as_str() {
                        "trace" => "TRACE",
                        "debug" => "DEBUG",
                        "info" => "INFO",
                        "warn" => "WARN",
                        _ => "ERROR",
                    });
                    let time = frame.display_timestamp().map_or_else(String::new, |time| time.to_string());
                    let line = Line { time, level, message: frame.display_message().to_string() };
                    if show(&line) {
                        println!("{:>11} {level:<5} {}", line.time, line.message);
                    }
                    log.lines.push(line);
                }
                Err(DecodeError::UnexpectedEof) => break,
                Err(DecodeError::Malformed) => {
                    println!("{:>11} malformed log frame", "");
                    log.malformed += 1;
                }
            }
        }
    }
    log
}
