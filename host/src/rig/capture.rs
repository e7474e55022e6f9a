//! The raw bytes of each line, a file for each engine and direction: what `jetlink decode` reads.

use super::ending::EndRequest;
use super::output::cannot_write;
use super::sample::Detail;
use super::tap::received;
use super::waiting;
use sim::wire::Direction;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// The two files of an engine.
#[derive(Debug)]
struct Pair {
    from_ecu: (String, BufWriter<File>),
    to_ecu: (String, BufWriter<File>),
}

/// The files of all engines.
#[derive(Debug)]
pub struct Capture(Vec<Pair>);

/// What the node receives from an engine's ECU, and what it sends to it.
fn paths(folder: &str, name: &str) -> [String; 2] {
    ["from-ecu", "to-ecu"]
        .map(|end| Path::new(folder).join(format!("{name}-{end}.bin")).display().to_string())
}

impl Capture {
    /// The files that are written for these engines.
    pub fn paths(folder: &str, names: &[&str]) -> Vec<String> {
        names.iter().flat_map(|name| paths(folder, name)).collect()
    }

    /// New files in this folder: what the node receives in `NAME-from-ecu.bin`, what it sends in `NAME-to-ecu.bin`.
    pub fn create(folder: &str, names: &[&str], end: &EndRequest) -> Result<Self, String> {
        std::fs::create_dir_all(folder).map_err(|error| cannot_write(folder, &error))?;
        let file = |path: String| {
            let file = waiting::create(&path, end).map_err(|error| cannot_write(&path, &error))?;
            Ok::<_, String>((path, BufWriter::new(file)))
        };
        let pair = |name: &&str| -> Result<Pair, String> {
            let [from_ecu, to_ecu] = paths(folder, name);
            Ok(Pair { from_ecu: file(from_ecu)?, to_ecu: file(to_ecu)? })
        };
        names.iter().map(pair).collect::<Result<Vec<_>, String>>().map(Self)
    }

    /// The bytes since the sample before.
    pub fn samples(&mut self, details: &[Detail]) -> Result<(), String> {
        for (pair, detail) in self.0.iter_mut().zip(details) {
            for entry in &detail.entries {
                let (file, byte) = match entry.direction {
                    Direction::ToNode => (&mut pair.from_ecu, received(entry)),
                    Direction::ToEcu => (&mut pair.to_ecu, Some(entry.byte)),
                };
                if let Some(byte) = byte {
                    file.1.write_all(&[byte]).map_err(|error| cannot_write(&file.0, &error))?;
                }
            }
        }
        Ok(())
    }

    /// The last bytes.
    pub fn finish(self) -> Result<(), String> {
        for pair in self.0 {
            for (path, mut file) in [pair.from_ecu, pair.to_ecu] {
                file.flush().map_err(|error| cannot_write(&path, &error))?;
            }
        }
        Ok(())
    }
}
