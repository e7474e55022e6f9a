//! The raw bytes of an engine's line in two files, as `jetlink rig --capture` writes them: what `jetlink decode` reads.

use std::fs::File;
use std::io::{Error, Write};
use std::path::Path;

/// The two files of an engine. What has been written is complete also when the program is killed.
#[derive(Debug)]
pub(crate) struct Capture {
    from_ecu: File,
    to_ecu: File,
}

impl Capture {
    /// New files in this folder: what the board receives in `NAME-from-ecu.bin`, what it sends in `NAME-to-ecu.bin`.
    pub(crate) fn create(folder: &Path, name: &str) -> Result<Self, Error> {
        std::fs::create_dir_all(folder)?;
        let file = |end: &str| File::create(folder.join(format!("{name}-{end}.bin")));
        Ok(Self { from_ecu: file("from-ecu")?, to_ecu: file("to-ecu")? })
    }

    pub(crate) fn received(&mut self, byte: u8) {
        write(&mut self.from_ecu, byte);
    }

    pub(crate) fn sent(&mut self, byte: u8) {
        write(&mut self.to_ecu, byte);
    }
}

/// # Panics
/// If the byte cannot be written: a capture with a hole is worse than none.
fn write(file: &mut File, byte: u8) {
    file.write_all(&[byte]).expect("the capture cannot be written");
}
