//! The raw bytes of each line, a file for each engine and direction: what `jetlink decode` reads.

use super::output::cannot_write;
use super::sample::Detail;
use super::tap::received;
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

impl Capture {
    /// New files in this folder: what the node receives in `NAME-from-ecu.bin`, what it sends in `NAME-to-ecu.bin`.
    pub fn create(folder: &str, names: &[&str]) -> Result<Self, String> {
        std::fs::create_dir_all(folder).map_err(|error| cannot_write(folder, &error))?;
        let file = |name: String| {
            let path = Path::new(folder).join(name).display().to_string();
            let file = File::create(&path).map_err(|error| cannot_write(&path, &error))?;
            Ok::<_, String>((path, BufWriter::new(file)))
        };
        let pair = |name: &&str| -> Result<Pair, String> {
            Ok(Pair {
                from_ecu: file(format!("{name}-from-ecu.bin"))?,
                to_ecu: file(format!("{name}-to-ecu.bin"))?,
            })
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
