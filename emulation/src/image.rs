//! The firmware images: their list, their files, and the message for a missing one.

use crate::board::{Board, NUCLEO_H743ZI2};
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
    /// With a task that hangs after 5 s (feature `wedge`).
    Wedge,
    /// With an ECU simulated on the last port (feature `play-ecu`); for the Nucleo only.
    PlayEcu,
    /// Linked behind an ArduPilot bootloader (feature `ardupilot-bootloader`).
    Ardupilot,
    /// Measures its oscillators and reports on the board (feature `selftest`).
    SelfTest,
    /// With a CRSF receiver and outputs for valves and power (feature `radio-crsf`).
    RadioCrsf,
    /// With an SBUS receiver on the board's socket for one, and outputs (feature `radio-socket`).
    RadioSocket,
    /// The same with a CRSF receiver (feature `radio-socket-crsf`).
    RadioSocketCrsf,
    /// With servo pulses on the board's inputs for them, and outputs on the remaining pins (feature `radio-pwm`).
    RadioPwm,
    /// With an SBUS receiver and outputs for valves and power (feature `outputs`).
    Outputs,
    /// The same, linked behind an ArduPilot bootloader (feature `outputs-ardupilot`).
    OutputsArdupilot,
    /// With MAVLink on USB (feature `usb`).
    Usb,
    /// With the supply voltage measured by the board's divider (feature `supply`).
    Supply,
}

impl Image {
    /// All of them.
    pub const ALL: [Self; 15] = [
        Self::Release,
        Self::Demo,
        Self::AllPorts,
        Self::Wedge,
        Self::PlayEcu,
        Self::Ardupilot,
        Self::SelfTest,
        Self::RadioCrsf,
        Self::RadioSocket,
        Self::RadioSocketCrsf,
        Self::RadioPwm,
        Self::Outputs,
        Self::OutputsArdupilot,
        Self::Usb,
        Self::Supply,
    ];

    /// The feature that selects it, besides the board's.
    pub const fn feature(self) -> Option<&'static str> {
        match self {
            Self::Release => None,
            Self::Demo => Some("demo"),
            Self::AllPorts => Some("all-ports"),
            Self::Wedge => Some("wedge"),
            Self::PlayEcu => Some("play-ecu"),
            Self::Ardupilot => Some("ardupilot-bootloader"),
            Self::SelfTest => Some("selftest"),
            Self::RadioCrsf => Some("radio-crsf"),
            Self::RadioSocket => Some("radio-socket"),
            Self::RadioSocketCrsf => Some("radio-socket-crsf"),
            Self::RadioPwm => Some("radio-pwm"),
            Self::Outputs => Some("outputs"),
            Self::OutputsArdupilot => Some("outputs-ardupilot"),
            Self::Usb => Some("usb"),
            Self::Supply => Some("supply"),
        }
    }

    /// Whether it has a receiver, and drives outputs: see [`Image::outputs`].
    pub const fn has_outputs(self) -> bool {
        let others =
            matches!(self, Self::RadioCrsf | Self::RadioPwm | Self::Outputs | Self::OutputsArdupilot);
        others || self.is_on_socket()
    }

    /// Whether its receiver is on the board's socket for one.
    pub const fn is_on_socket(self) -> bool {
        matches!(self, Self::RadioSocket | Self::RadioSocketCrsf)
    }

    /// Name of the port of its receiver, if it has one.
    pub fn radio(self, board: &Board) -> &'static str {
        let socket = board.socket.filter(|_| self.is_on_socket());
        socket.map_or(board.radio, |socket| socket.port.name)
    }

    /// The outputs of a board that it may drive, by number: engine i has its fuel valve on the i-th of them, and after all valves come the
    /// powers of starter and ignition, as far as there are outputs. [`crate::pins::Level::energising`] has their levels.
    pub fn outputs(self, board: &Board) -> Vec<usize> {
        let inputs = board.inputs.iter().filter(|_| self == Self::RadioPwm).flat_map(|inputs| inputs.pins);
        let inputs: Vec<_> = inputs.map(|pin| (pin.port, pin.number)).collect();
        let free = |number: &usize| !inputs.contains(&board.outputs[*number].pin);
        (0..board.outputs.len()).filter(|_| self.has_outputs()).filter(free).collect()
    }

    /// The images of a board: all of them for the first board of a part, the release image for the others, and that with an SBUS receiver
    /// where it moves an engine of the release image to another port.
    pub fn of(board: &Board) -> impl Iterator<Item = Self> {
        let every = board.is_first_of_its_part();
        let has_bootloader = board.behind_bootloader.is_some();
        Self::ALL.into_iter().filter(move |image| match image {
            Self::Release => true,
            Self::Ardupilot => has_bootloader,
            Self::OutputsArdupilot => every && has_bootloader,
            Self::PlayEcu => board.name == NUCLEO_H743ZI2.name,
            Self::Supply => board.divider.is_some(),
            Self::RadioSocket | Self::RadioSocketCrsf => board.socket.is_some(),
            Self::Outputs => every || board.ports[..4].iter().any(|port| port.name == board.radio),
            _ => every,
        })
    }

    /// Its start address in the flash.
    ///
    /// # Panics
    /// If it needs a bootloader that the board does not have.
    pub fn start(self, board: &Board) -> u64 {
        match self {
            Self::Ardupilot | Self::OutputsArdupilot => board.behind_bootloader.expect("a bootloader"),
            _ => board.flash.start,
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
    /// A sentence for people.
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

    /// Its bytes. Without them the whole program ends with one sentence, because no test can run.
    pub(crate) fn read_or_exit(self, board: &Board) -> Vec<u8> {
        self.read(board).unwrap_or_else(|sentence| {
            // Not `eprintln`, which the test harness captures.
            let _ = writeln!(std::io::stderr(), "\n{sentence}");
            std::process::exit(2);
        })
    }
}

/// Folder of the images: `JETLINK_IMAGES`, otherwise the output of `cargo emu`.
pub fn folder() -> PathBuf {
    std::env::var_os("JETLINK_IMAGES")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("target").join("images"), PathBuf::from)
}

/// The address of a symbol of an image.
pub fn symbol(image: &[u8], name: &str) -> Option<u64> {
    rigless::symbols::Symbols::read(image, |value| value & !1).ok()?.get(name).ok()
}

/// The address of the symbol with this ending; the beginning of a mangled name changes at every build.
pub fn symbol_ending(image: &[u8], end: &str) -> Option<u64> {
    let word =
        |at: usize| u32::from_le_bytes([image[at], image[at + 1], image[at + 2], image[at + 3]]) as usize;
    let half = |at: usize| usize::from(u16::from_le_bytes([image[at], image[at + 1]]));
    // ELF32: offset, size and count of the section headers; in each, kind, offset, length and the section of its names.
    let header = |i: usize| word(32) + i * half(46);
    let table = (0..half(48)).map(header).find(|&at| word(at + 4) == 2)?;
    let names = word(header(word(table + 24)) + 16);
    let symbols = (0..word(table + 20) / 16).map(|i| word(table + 16) + i * 16);
    let named = |at: usize| image[names + word(at)..].split(|&byte| byte == 0).next();
    symbols
        .into_iter()
        .find(|&at| named(at).is_some_and(|name| name.ends_with(end.as_bytes())))
        .map(|at| word(at + 4) as u64)
}

/// Replaces the instructions at an address of an image's flash.
///
/// # Panics
/// If nothing of the image lies there.
pub(crate) fn patch(elf: &mut [u8], address: u64, halfwords: &[u16]) {
    let at = offset(elf, address);
    for (i, halfword) in halfwords.iter().enumerate() {
        elf[at + 2 * i..at + 2 * i + 2].copy_from_slice(&halfword.to_le_bytes());
    }
}

/// The first two words of a vector table: initial stack and start address of the firmware.
///
/// # Panics
/// If nothing of the image lies there.
pub(crate) fn vectors(elf: &[u8], table: u64) -> [u32; 2] {
    let at = offset(elf, table);
    [at, at + 4].map(|at| u32::from_le_bytes([elf[at], elf[at + 1], elf[at + 2], elf[at + 3]]))
}

/// Offset in the file of the bytes for an address of the flash.
fn offset(elf: &[u8], address: u64) -> usize {
    let word = |at: usize| u32::from_le_bytes([elf[at], elf[at + 1], elf[at + 2], elf[at + 3]]) as u64;
    let half = |at: usize| usize::from(u16::from_le_bytes([elf[at], elf[at + 1]]));
    // ELF32: offset, size and count of the program headers; in each, the offset and the target address of its bytes.
    let headers = (0..half(44)).map(|i| word(28) as usize + i * half(42));
    let mut segments = headers.map(|at| (word(at + 4), word(at + 12), word(at + 16)));
    let (file, physical, _) =
        segments.find(|(_, from, length)| (*from..from + length).contains(&address)).expect("in the image");
    (file + address - physical) as usize
}
