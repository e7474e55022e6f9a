//! The aliases, and the `cargo` command that each stands for.

use crate::environment::Program;
use crate::pin;
use boards::{BOARDS, Board};
use std::io::IsTerminal;

const QEMU: Program = Program {
    name: "qemu-system-arm",
    install: "sudo apt install qemu-system-arm (Debian, Ubuntu), sudo dnf install qemu-system-arm (Fedora) or \
              brew install qemu (macOS); or name it with --qemu <path>",
};
const PROBE_RS: Program =
    Program { name: "probe-rs", install: "cargo install probe-rs-tools --locked (see https://probe.rs)" };

/// The manifest of the emulator's workspace.
const EMULATION: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../emulation/Cargo.toml");

/// A task, with its further arguments.
#[derive(Debug)]
pub enum Task<'a> {
    /// `cargo fw FEATURES`: build for a board.
    Fw(&'a str, &'a [String]),
    /// `cargo image BOARD`: write the files to flash.
    Image(&'a [String]),
    /// `cargo flash-BOARD`: build, flash and run with a debug probe.
    Flash(&'static Board, &'a [String]),
    /// `cargo emu`: the tests on emulated boards.
    Emu(&'a [String]),
    /// `cargo emu-run`: one image on an emulated board.
    EmuRun(&'a [String]),
    /// `cargo emu-record`, or with true `cargo emu-compare`: the bytes of four runs.
    EmuRecord(bool, &'a [String]),
    /// `cargo qemu`, or with true `cargo qemu-test`.
    Qemu(bool, &'a [String]),
}

impl<'a> Task<'a> {
    /// The task of these arguments.
    pub fn parse(arguments: &'a [String]) -> Result<Self, String> {
        let [task, rest @ ..] = arguments else { return Err(usage()) };
        Ok(match task.as_str() {
            "fw" => match rest {
                [features, more @ ..] if !features.starts_with('-') => Self::Fw(features, more),
                _ => {
                    let boards = BOARDS.map(|board| format!("cargo fw board-{}", board.name)).join(", ");
                    return Err(format!("name a board: {boards}; add further features after a comma"));
                }
            },
            "image" => Self::Image(rest),
            "emu" => Self::Emu(rest),
            "emu-run" => Self::EmuRun(rest),
            "emu-record" => Self::EmuRecord(false, rest),
            "emu-compare" => Self::EmuRecord(true, rest),
            "qemu" => Self::Qemu(false, rest),
            "qemu-test" => Self::Qemu(true, rest),
            other => {
                let board = other.strip_prefix("flash-").and_then(Board::by_name);
                Self::Flash(board.ok_or_else(usage)?, rest)
            }
        })
    }

    /// Programs that it needs besides Rust.
    pub fn programs(&self) -> Vec<Program> {
        match self {
            Self::Flash(..) => vec![PROBE_RS],
            Self::Qemu(_, more) if !more.iter().any(|more| more.starts_with("--qemu")) => vec![QEMU],
            _ => Vec::new(),
        }
    }

    /// The arguments of `cargo`.
    pub fn cargo_arguments(&self) -> Vec<String> {
        let firmware =
            ["--release", "--target", pin::target(), "--package", "jetlink-fw", "--bin", "jetlink-fw"];
        // A person sees how far a first build is; a log does not have a line for each package.
        let run: &[&str] = if std::io::stderr().is_terminal() { &["run"] } else { &["run", "--quiet"] };
        let emu = [run, &["--manifest-path", EMULATION, "--bin", "emu", "--"]].concat();
        match self {
            Self::Fw(features, more) => {
                strings(&[&["build"], &firmware[..], &["--features", features]].concat(), more)
            }
            Self::Image(more) => {
                strings(&["run", "--package", "host", "--bin", "jetlink", "--", "image"], more)
            }
            Self::Flash(board, more) => {
                let features = format!("board-{}", board.name);
                let chip = board.chip.probe_rs;
                let runner = format!("target.{}.runner = 'probe-rs run --chip {chip}'", pin::target());
                let these = ["--features", &features, "--config", &runner];
                strings(&[&["run"], &firmware[..], &these].concat(), more)
            }
            Self::Emu(more) => strings(&[&emu[..], &["emu"]].concat(), more),
            Self::EmuRun(more) => strings(&[&emu[..], &["emu-run"]].concat(), more),
            Self::EmuRecord(compare, more) => {
                let what = if *compare { "emu-compare" } else { "emu-record" };
                strings(&[&emu[..], &[what]].concat(), more)
            }
            Self::Qemu(test, more) => {
                let qemu = [run, &["--package", "qemu", "--", "test"]].concat();
                strings(&qemu[..qemu.len() - usize::from(!test)], more)
            }
        }
    }
}

fn strings(first: &[&str], more: &[String]) -> Vec<String> {
    first.iter().map(|&argument| argument.to_owned()).chain(more.iter().cloned()).collect()
}

/// Output of `boards`, one name a line: all boards, or those with this option.
pub fn list(arguments: &[String]) -> Result<String, String> {
    let wanted: fn(&Board) -> bool = match arguments {
        [] => |_| true,
        [option] if option == "--with-bootloader" => |board| board.bootloader.is_some(),
        [option] if option == "--first-of-each-chip" => Board::is_first_of_its_chip,
        _ => return Err("invalid option: use none, --with-bootloader or --first-of-each-chip".into()),
    };
    Ok(BOARDS.into_iter().filter(|board| wanted(board)).map(|board| format!("{}\n", board.name)).collect())
}

fn usage() -> String {
    let flash = BOARDS.map(|board| format!("flash-{}", board.name)).join(", ");
    format!(
        "use one of the aliases cargo fw, image, {flash}, emu, emu-run, emu-record, emu-compare, qemu and \
         qemu-test, or `boards` to list the boards"
    )
}
