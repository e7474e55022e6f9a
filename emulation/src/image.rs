//! Which firmware images there are, where they lie, and what a missing one says.

use crate::board::Board;
use std::io::Write;
use std::path::{Path, PathBuf};

/// An image of the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Image {
    /// What is flashed: `cargo fw board-<name>`, nothing else.
    Release,
    /// With the demonstration, which commands the engines (feature `demo`).
    Demo,
    /// With an engine on every port (feature `all-ports`).
    AllPorts,
    /// With a task that stands still after 5 s (feature `wedge`).
    Wedge,
}

impl Image {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Release, Self::Demo, Self::AllPorts, Self::Wedge];

    /// The feature that makes it, besides the board's.
    pub const fn feature(self) -> Option<&'static str> {
        match self {
            Self::Release => None,
            Self::Demo => Some("demo"),
            Self::AllPorts => Some("all-ports"),
            Self::Wedge => Some("wedge"),
        }
    }

    /// Its file, whether it is there or not.
    pub fn path(self, board: &Board) -> PathBuf {
        let name = match self.feature() {
            None => format!("{}.elf", board.name),
            Some(feature) => format!("{}-{feature}.elf", board.name),
        };
        folder().join(name)
    }

    /// Its bytes.
    ///
    /// # Errors
    /// A sentence.
    pub fn read(self, board: &Board) -> Result<Vec<u8>, String> {
        let path = self.path(board);
        std::fs::read(&path).map_err(|error| {
            format!(
                "There is no firmware image {} ({error}). `cargo emu`, from the project's root, builds all images \
                 and runs the tests.",
                path.display()
            )
        })
    }

    /// Its bytes; without them the whole program ends with one sentence, since no test can do anything.
    pub(crate) fn read_or_exit(self, board: &Board) -> Vec<u8> {
        self.read(board).unwrap_or_else(|sentence| {
            // Not `eprintln`, which a test keeps to itself.
            let _ = writeln!(std::io::stderr(), "\n{sentence}");
            std::process::exit(2);
        })
    }
}

/// Where the images are: `JETLINK_IMAGES`, else where `cargo emu` puts them.
pub fn folder() -> PathBuf {
    std::env::var_os("JETLINK_IMAGES")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("target").join("images"), PathBuf::from)
}

/// The address of a symbol of an image.
pub fn symbol(image: &[u8], name: &str) -> Option<u64> {
    rigless::symbols::Symbols::read(image, |value| value & !1).ok()?.get(name).ok()
}
