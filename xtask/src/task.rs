//! The aliases, and the `cargo` command of each.

use crate::environment::Program;
use crate::pin;
use boards::{BOARDS, Board};
use clap::Parser;
use commands::fw;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};

const QEMU: Program = Program {
    name: "qemu-system-arm",
    install: "sudo apt install qemu-system-arm (Debian, Ubuntu), sudo dnf install qemu-system-arm (Fedora) or \
              brew install qemu (macOS); or name it with --qemu <path>",
};
const PROBE_RS: Program =
    Program { name: "probe-rs", install: "cargo install probe-rs-tools --locked (see https://probe.rs)" };

/// Time of the first image, for an STM32H743, in s, and size of the target folder with it, in MB; AMD EPYC, 23 November 2026.
const IMAGE_SECONDS: u32 = 61;
const IMAGE_MB: u32 = 744;
/// Size of the emulator's target folder with its tests, in MB; 22 November 2026.
const EMULATION_MB: u32 = 760;

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

/// What is printed in place of a task.
#[derive(Debug)]
pub enum Answer {
    /// A text that was requested.
    Help(String),
    /// A sentence: it is no task, or something is missing for it.
    Wrong(String),
    /// The answer of a program's command line: its help, or what is wrong.
    Program(clap::Error),
}

impl From<String> for Answer {
    fn from(why: String) -> Self {
        Self::Wrong(why)
    }
}

impl<'a> Task<'a> {
    /// The task of these arguments, which are read as its program will read them.
    pub fn parse(arguments: &'a [String]) -> Result<Self, Answer> {
        let task = Self::named(arguments)?;
        let checked = match &task {
            Self::Fw(..) | Self::Flash(..) => Ok(()),
            Self::Image(more) => accepts::<commands::image::Args>(&["cargo image"], more),
            Self::Emu(more) => accepts::<commands::emu::Call>(&["cargo", "emu"], more),
            Self::EmuRun(more) => accepts::<commands::emu::Call>(&["cargo", "emu-run"], more),
            Self::EmuRecord(false, more) => accepts::<commands::emu::Call>(&["cargo", "emu-record"], more),
            Self::EmuRecord(true, more) => accepts::<commands::emu::Call>(&["cargo", "emu-compare"], more),
            Self::Qemu(false, more) => accepts::<commands::qemu::Arguments>(&["cargo qemu"], more),
            Self::Qemu(true, more) => accepts::<commands::qemu::Arguments>(&["cargo qemu", "test"], more),
        };
        checked.map_err(Answer::Program)?;
        Ok(task)
    }

    fn named(arguments: &'a [String]) -> Result<Self, Answer> {
        let [task, rest @ ..] = arguments else { return Err(usage().into()) };
        let asks = rest.iter().take_while(|argument| *argument != "--").any(|argument| is_help(argument));
        Ok(match task.as_str() {
            help if is_help(help) => return Err(Answer::Help(usage())),
            "fw" if asks => return Err(Answer::Help(fw::help())),
            "fw" => match rest {
                [features, more @ ..] if !features.starts_with('-') => {
                    fw::check(features)?;
                    Self::Fw(features, more)
                }
                _ => return Err(fw::boards().into()),
            },
            "image" => Self::Image(rest),
            "emu" => Self::Emu(rest),
            "emu-run" => Self::EmuRun(rest),
            "emu-record" => Self::EmuRecord(false, rest),
            "emu-compare" => Self::EmuRecord(true, rest),
            "qemu" => Self::Qemu(false, rest),
            "qemu-test" => Self::Qemu(true, rest),
            other => {
                let board = other.strip_prefix("flash-").and_then(Board::by_name).ok_or_else(usage)?;
                if asks {
                    return Err(Answer::Help(flash_help(board)));
                }
                Self::Flash(board, rest)
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

    /// The folder that its first build makes, in the target folder named `target` or in that of the emulator, and what is printed
    /// before it, as it takes minutes. `None`: it starts `cargo fw`, which prints it.
    pub fn first_build(&self, target: &Path) -> Option<(PathBuf, String)> {
        let image = target.join(pin::target()).join("release");
        Some(match self {
            Self::Image(_) | Self::Qemu(..) => return None,
            Self::Emu(_) | Self::EmuRun(_) | Self::EmuRecord(..) => {
                let folder = Path::new(EMULATION).with_file_name("target");
                let text = format!(
                    "the first time, the emulator and the images are built, which takes minutes and {EMULATION_MB} MB \
                     in emulation/target, beside the images"
                );
                (folder, text)
            }
            _ => {
                let text = format!(
                    "the first time, all that an image is made of is built, which took {IMAGE_SECONDS} s on two idle cores, and \
                     {IMAGE_MB} MB in {}",
                    target.display()
                );
                (image, text)
            }
        })
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
                let flags = flags();
                strings(
                    &[&["build"], &firmware[..], &["--features", features, "--config", &flags]].concat(),
                    more,
                )
            }
            Self::Image(more) => strings(&["run", "--package", "image", "--"], more),
            Self::Flash(board, more) => {
                let features = format!("board-{}", board.name);
                let chip = board.chip.probe_rs;
                let runner = format!("target.{}.runner = 'probe-rs run --chip {chip}'", pin::target());
                let these = ["--features", &features, "--config", &runner, "--config", &flags()];
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

/// Whether a program takes these arguments.
fn accepts<P: Parser>(first: &[&str], more: &[String]) -> Result<(), clap::Error> {
    P::try_parse_from(strings(first, more)).map(|_| ())
}

fn is_help(argument: &str) -> bool {
    matches!(argument, "-h" | "--help")
}

fn flash_help(board: &Board) -> String {
    format!(
        "Builds the firmware for the {}, writes it with a debug probe and probe-rs, and shows its log\n\n\
         Usage: cargo flash-{} [OPTIONS OF CARGO RUN]...\n\nIt replaces the board's own bootloader.",
        board.title, board.name
    )
}

/// Where cargo unpacks what comes from crates.io, in its home.
const REGISTRY: &str = "registry/src";
/// The folder of crates.io in it, which is the same everywhere.
const CRATES_IO: &str = "index.crates.io-1949cf8c6b5b557f";

/// Flags of the compiler. They are here and not in `.cargo/config.toml`, because some depend on this machine.
fn flags() -> String {
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| std::env::home_dir().map(|home| home.join(".cargo"))).unwrap_or_default();
    let registry = home.join(REGISTRY);
    let flags = [
        // A panic names its file from the name of its package on: an image holds 40 of these names, and is the same for every person who builds
        // it. The names for a debugger stay whole. The last one that fits counts.
        "--remap-path-scope=macro".to_owned(),
        format!("--remap-path-prefix={}=", registry.display()),
        format!("--remap-path-prefix={}=", registry.join(CRATES_IO).display()),
        "--remap-path-prefix=jetlink/src=jetlink".to_owned(),
        "--remap-path-prefix=mavlink/src=mavlink".to_owned(),
        // 0.9 kB in place of 7.4 kB: what is hashed is a signed frame now and then, and no stream.
        "--cfg=sha2_backend_soft=\"compact\"".to_owned(),
        // Functions and constants that are the same to the byte are linked once.
        "-Clink-arg=--icf=all".to_owned(),
        // What has the same alignment is linked together, with less padding.
        "-Clink-arg=--sort-section=alignment".to_owned(),
        // At "s" a function of up to 50 of LLVM's units is inlined wherever it is called, at "z" one of 5: docs/size.md has what others gave. A load
        // is looked for in the 50 instructions before, in place of 6.
        "-Cllvm-args=-inline-threshold=20 -available-load-scan-limit=50 -enable-gvn-memdep=false -split-spill-mode=size -tail-merge-size=2".to_owned(),
    ];
    // Literal strings of TOML: the name of a folder may have a backslash.
    format!("target.{}.rustflags = [{}]", pin::target(), flags.map(|flag| format!("'{flag}'")).join(", "))
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
