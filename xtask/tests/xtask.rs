//! What `xtask` decides, with a `rustup`, a `cargo` and other programs of the test's own in PATH.
#![cfg(unix)]

use boards::BOARDS;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::sync::Mutex;

/// The version in `pinned-toolchain.toml`.
fn pin() -> &'static str {
    let mut lines = include_str!("../pinned-toolchain.toml").lines();
    lines.find_map(|line| line.strip_prefix("channel = ")).expect("a channel").trim_matches('"')
}

const TARGET: &str = "thumbv7em-none-eabihf";

/// Held while a script is written and while a process starts: a process that starts meanwhile has the script open
/// for a moment, and it cannot be run then.
static STARTING: Mutex<()> = Mutex::new(());

/// A computer: what is in PATH, and nothing else.
struct Computer {
    folder: PathBuf,
    target: PathBuf,
}

impl Computer {
    /// With rustup, which has these toolchains and these targets for the pinned one, and with its `cargo`.
    fn new(name: &str, toolchains: &[String], targets: &[&str]) -> Self {
        let computer = Self::without_rustup(name);
        let targets: Vec<String> = targets.iter().map(|&target| target.to_owned()).collect();
        let list =
            |names: &[String]| names.iter().map(|name| format!("    echo '{name}'\n")).collect::<String>();
        computer.program(
            "rustup",
            &format!(
                "[ -z \"$RUSTUP_TOOLCHAIN\" ] || exit 9\n\
                 case \"$*\" in\n  'toolchain list')\n{}    ;;\n  'target list --installed --toolchain {PIN}')\n{}    \
                 ;;\n  *) exit 9 ;;\nesac\n",
                list(toolchains),
                list(&targets),
                PIN = pin(),
            ),
        );
        // Like rustup's own: the toolchain is what RUSTUP_TOOLCHAIN says.
        computer.program("cargo", CARGO);
        computer
    }

    fn without_rustup(name: &str) -> Self {
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
        let _ = fs::remove_dir_all(&folder); // it may be the first time
        fs::create_dir_all(&folder).expect("a folder");
        Self { folder, target: "/somewhere/target".into() }
    }

    fn program(&self, name: &str, script: &str) {
        let path = self.folder.join(name);
        let _starting = STARTING.lock();
        fs::write(&path, format!("#!/bin/sh\n{script}")).expect("a script");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("a script");
    }

    /// `xtask` with these arguments, as `cargo run` of Rust 1.95 starts it.
    fn xtask(&self, arguments: &[&str]) -> Output {
        let starting = STARTING.lock();
        let child = Command::new(env!("CARGO_BIN_EXE_xtask"))
            .args(arguments)
            .env_clear()
            .env("PATH", &self.folder)
            .env("RUSTUP_TOOLCHAIN", "1.95.0")
            .env("CARGO", "/toolchains/1.95.0/bin/cargo")
            .env("CARGO_PKG_NAME", "xtask")
            .env("CARGO_MANIFEST_DIR", "/somewhere/xtask")
            .env("RUSTC", "/toolchains/1.95.0/bin/rustc")
            .env("CARGO_TARGET_DIR", &self.target)
            .env("CARGO_HOME", "/somewhere/cargo")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("it runs");
        drop(starting);
        child.wait_with_output().expect("it ends")
    }

    /// The one sentence that it ends with.
    #[track_caller]
    fn refuses(&self, arguments: &[&str]) -> String {
        let output = self.xtask(arguments);
        let text = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert_eq!(String::from_utf8_lossy(&output.stdout), "", "cargo was started");
        assert!(text.starts_with("error: ") && text.lines().count() == 1, "{text}");
        text
    }

    /// What `cargo` is started with: its arguments, then its environment.
    #[track_caller]
    fn starts(&self, arguments: &[&str]) -> (String, Vec<String>) {
        let output = self.xtask(arguments);
        let text = String::from_utf8(output.stdout).expect("UTF-8");
        assert_eq!(output.status.code(), Some(7), "{text}{}", String::from_utf8_lossy(&output.stderr));
        let (cargo, environment) = text.split_once('\n').expect("lines");
        (cargo.to_owned(), environment.lines().map(str::to_owned).collect())
    }
}

/// A `cargo` that prints what it was started with, and ends with status 7.
const CARGO: &str = "\
[ \"$1\" = --version ] && { echo \"cargo $RUSTUP_TOOLCHAIN (0123abcd 2026-08-18)\"; exit 0; }
echo \"$*\"
for name in RUSTUP_TOOLCHAIN CARGO CARGO_PKG_NAME CARGO_MANIFEST_DIR RUSTC CARGO_TARGET_DIR; do
    eval \"value=\\${$name-unset}\"
    echo \"$name=$value\"
done
exit 7
";

/// All that is needed beside programs.
fn toolchains() -> [String; 2] {
    [
        "stable-x86_64-unknown-linux-gnu (active, default)".into(),
        format!("{}-x86_64-unknown-linux-gnu", pin()),
    ]
}
const TARGETS: [&str; 2] = [TARGET, "x86_64-unknown-linux-gnu"];

#[test]
fn before_a_first_build_it_prints_what_that_takes() {
    let computer = Computer::new("first", &toolchains(), &TARGETS);
    let printed = |computer: &Computer, arguments: &[&str]| {
        String::from_utf8(computer.xtask(arguments).stderr).expect("UTF-8")
    };
    // Its target folder is not there.
    let text = printed(&computer, &["fw", "board-pixracer"]);
    assert!(text.contains("took 61 s on two idle cores, and 744 MB in /somewhere/target"), "{text}");
    let page = include_str!("../../README.md").replace('\n', " ");
    assert!(
        page.contains("took 61 s on two idle cores with its downloads, and 744 MB in `target`"),
        "{page}"
    );
    assert_eq!(text.lines().count(), 1, "{text}");
    // This one starts `cargo fw`.
    assert_eq!(printed(&computer, &["image", "pixracer"]), "");
    let target = computer.folder.join("target");
    fs::create_dir_all(target.join(TARGET).join("release")).expect("a folder");
    let second = Computer { folder: computer.folder.clone(), target };
    assert_eq!(printed(&second, &["fw", "board-pixracer"]), "");
}

#[test]
fn every_image_is_built_with_the_pin_whatever_the_caller_has_set() {
    let computer = Computer::new("complete", &toolchains(), &TARGETS);
    computer.program("probe-rs", "exit 0\n");
    computer.program("qemu-system-arm", "exit 0\n");
    let firmware = format!("--release --target {TARGET} --package jetlink-fw --bin jetlink-fw --features");
    let registry = "/somewhere/cargo/registry/src";
    let flags = format!(
        "--config target.{TARGET}.rustflags = ['--remap-path-scope=macro', '--remap-path-prefix={registry}=', \
         '--remap-path-prefix={registry}/index.crates.io-1949cf8c6b5b557f=', \
         '--remap-path-prefix=jetlink/src=jetlink', '--remap-path-prefix=mavlink/src=mavlink', \
         '--cfg=sha2_backend_soft=\"compact\"', '-Clink-arg=--icf=all', '-Clink-arg=--sort-section=alignment', '-Cllvm-args=-inline-threshold=20 -available-load-scan-limit=50 -enable-gvn-memdep=false -split-spill-mode=size -tail-merge-size=2']"
    );
    let emu = concat!(env!("CARGO_MANIFEST_DIR"), "/../emulation/Cargo.toml --bin emu --");
    for (arguments, expected) in [
        (
            &["fw", "board-pixracer", "--quiet"][..],
            format!("build {firmware} board-pixracer {flags} --quiet"),
        ),
        (&["image", "pixracer", "--demo"], "run --package image -- pixracer --demo".into()),
        (
            &["flash-matek-h743"],
            format!(
                "run {firmware} board-matek-h743 --config target.{TARGET}.runner = 'probe-rs run --chip STM32H743VITx' {flags}"
            ),
        ),
        (
            &["flash-pixracer"],
            format!(
                "run {firmware} board-pixracer --config target.{TARGET}.runner = 'probe-rs run --chip STM32F427VITx' {flags}"
            ),
        ),
        (&["emu", "babble"], format!("run --quiet --manifest-path {emu} emu babble")),
        (
            &["emu", "repeat", "--nocapture"],
            format!("run --quiet --manifest-path {emu} emu repeat --nocapture"),
        ),
        (&["emu", "--", "--ignored"], format!("run --quiet --manifest-path {emu} emu -- --ignored")),
        (&["emu-run", "pixracer"], format!("run --quiet --manifest-path {emu} emu-run pixracer")),
        (&["emu-record", "before"], format!("run --quiet --manifest-path {emu} emu-record before")),
        (&["emu-compare", "before"], format!("run --quiet --manifest-path {emu} emu-compare before")),
        (&["qemu", "count"], "run --quiet --package qemu -- count".into()),
        (&["qemu-test"], "run --quiet --package qemu -- test".into()),
    ] {
        let (cargo, environment) = computer.starts(arguments);
        assert_eq!(cargo, expected);
        assert_eq!(
            environment,
            [
                format!("RUSTUP_TOOLCHAIN={}", pin()).as_str(),
                "CARGO=unset",
                "CARGO_PKG_NAME=unset",
                "CARGO_MANIFEST_DIR=unset",
                "RUSTC=unset",
                "CARGO_TARGET_DIR=/somewhere/target"
            ]
        );
    }
}

#[test]
fn a_missing_toolchain_is_one_sentence_with_the_command_that_installs_it() {
    let pin = pin();
    let install =
        format!("rustup toolchain install --no-self-update --profile minimal --target {TARGET} {pin}");
    // Neither a longer number nor the name of another toolchain is the pin.
    let longer = format!("{pin}1-x86_64-unknown-linux-gnu");
    for others in [vec![], vec![longer], vec![format!("stable-{pin}"), format!("1{pin}")]] {
        let computer = Computer::new("no-toolchain", &others, &TARGETS);
        for task in [&["fw", "board-pixracer"][..], &["image", "pixracer"], &["emu"], &["qemu"]] {
            let text = computer.refuses(task);
            assert!(
                text.contains(&format!("Rust {pin}, which is not installed")) && text.contains(&install),
                "{text}"
            );
        }
    }
}

#[test]
fn a_missing_target_is_one_sentence_with_the_command_that_installs_it() {
    let computer = Computer::new("no-target", &toolchains(), &["x86_64-unknown-linux-gnu"]);
    let text = computer.refuses(&["fw", "board-pixracer"]);
    assert!(text.contains(&format!("rustup target add --toolchain {} {TARGET}", pin())), "{text}");
}

#[test]
fn without_rustup_it_is_one_sentence() {
    let computer = Computer::without_rustup("no-rustup");
    computer.program("cargo", CARGO);
    let text = computer.refuses(&["fw", "board-pixracer"]);
    assert!(text.contains("rustup, which is not installed") && text.contains("https://rustup.rs"), "{text}");
}

#[test]
fn a_rustup_that_fails_is_quoted() {
    let computer = Computer::without_rustup("broken-rustup");
    computer.program("rustup", "echo 'error: no home' >&2\nexit 1\n");
    let text = computer.refuses(&["emu"]);
    assert!(text.contains("`rustup toolchain list` failed: error: no home"), "{text}");
}

#[test]
fn a_cargo_that_is_not_rustups_is_reported() {
    let computer = Computer::new("other-cargo", &toolchains(), &TARGETS);
    computer.program("cargo", "echo 'cargo 1.95.0 (f2d3ce0bd 2026-03-21)'\n");
    let text = computer.refuses(&["fw", "board-pixracer"]);
    assert!(text.contains("not rustup's (cargo 1.95.0"), "{text}");
}

#[test]
fn a_missing_program_is_one_sentence_where_it_is_needed() {
    let computer = Computer::new("no-programs", &toolchains(), &TARGETS);
    for task in ["qemu", "qemu-test"] {
        let text = computer.refuses(&[task]);
        assert!(text.contains("qemu-system-arm is not installed") && text.contains("apt install"), "{text}");
    }
    let text = computer.refuses(&["flash-pixracer"]);
    assert!(
        text.contains("probe-rs is not installed") && text.contains("cargo install probe-rs-tools"),
        "{text}"
    );
    // Another QEMU is looked at by its user; the rest needs none.
    for task in [&["qemu", "--qemu", "/opt/qemu"][..], &["qemu-test", "--qemu=/opt/qemu"], &["emu"]] {
        computer.starts(task);
    }
}

#[test]
fn unknown_tasks_are_reported() {
    let computer = Computer::new("no-task", &toolchains(), &TARGETS);
    for arguments in [&[][..], &["flash-cube"], &["fly"]] {
        assert!(computer.refuses(arguments).contains("cargo fw"), "{arguments:?}");
    }
    for arguments in [&["fw"][..], &["fw", "--quiet"]] {
        assert!(computer.refuses(arguments).contains("cargo fw board-pixracer"), "{arguments:?}");
    }
}

/// Neither the toolchain nor `cargo` is started: a build takes minutes.
#[test]
fn a_wrong_call_and_help_are_answered_before_any_build() {
    let computer = Computer::without_rustup("calls");
    let call = |arguments: &[&str]| {
        let output = computer.xtask(arguments);
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
        (output.status.code(), text(output.stdout), text(output.stderr))
    };
    for (arguments, why) in [
        (&["fw", "board-pixracr"][..], "cargo fw board-pixracer"),
        (&["fw", "board-pixracer,dmo"], "`dmo`"),
        (&["image"], "<BOARD>"),
        (&["image", "matek"], "matek-h743, pixracer"),
        (&["image", "pixracer", "--outt", "x"], "'--out'"),
        (&["emu-run", "matek"], "matek-h743, pixracer"),
        (&["emu-run", "pixracer", "--image", "blue"], "release, demo"),
        (&["emu-run", "pixracer", "--tcp", "0"], "1..=65535"),
        (&["emu-record"], "<DIR>"),
        (&["emu", "--nocapture"], "'--nocapture'"),
        (&["qemu", "cuont"], "'cuont'"),
        (&["qemu", "--features", "dmo"], "`dmo`"),
        (&["qemu-test", "--limit", "long"], "'long'"),
        (&["flash-cube"], "flash-cube-orange"),
    ] {
        let (status, out, error) = call(arguments);
        assert!(matches!(status, Some(1 | 2)) && out.is_empty(), "{arguments:?}: {status:?}, {out}");
        assert!(error.starts_with("error: ") && error.contains(why), "{arguments:?}: {error}");
    }
    for (arguments, text) in [
        (&["--help"][..], "emu-compare"),
        (&["fw", "--help"], "Usage: cargo fw"),
        (&["image", "--help"], "Usage: cargo image"),
        (&["image", "pixracer", "-h"], "--ardupilot-bootloader"),
        (&["flash-pixracer", "--help"], "probe-rs"),
        (&["emu", "--help"], "Usage: cargo emu"),
        (&["emu-run", "--help"], "Usage: cargo emu-run"),
        (&["emu-compare", "--help"], "Usage: cargo emu-compare"),
        (&["qemu", "--help"], "--telemetry"),
        (&["qemu-test", "--help"], "--limit"),
    ] {
        let (status, out, error) = call(arguments);
        assert_eq!((status, error.as_str()), (Some(0), ""), "{arguments:?}");
        assert!(out.contains(text), "{arguments:?}: {out}");
    }
}

#[test]
fn the_boards_are_listed_for_scripts_whatever_is_installed() {
    let computer = Computer::without_rustup("boards");
    let list = |arguments: &[&str]| {
        let output = computer.xtask(arguments);
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stdout).expect("UTF-8").lines().map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(list(&["boards"]), BOARDS.map(|board| board.name));
    assert_eq!(list(&["boards", "--first-of-each-chip"]), ["matek-h743", "pixracer"]);
    let with_bootloader = list(&["boards", "--with-bootloader"]);
    assert!(
        with_bootloader.contains(&"pixhawk-6c".into()) && !with_bootloader.contains(&"nucleo-h743zi2".into())
    );
    assert!(computer.refuses(&["boards", "--all"]).contains("--with-bootloader"));
}

#[test]
fn each_alias_of_cargo_reaches_its_task() {
    let config = include_str!("../../.cargo/config.toml");
    let aliases: Vec<(&str, &str)> =
        config.lines().filter_map(|line| line.split_once(" = \"run --quiet --package xtask -- ")).collect();
    let flash = BOARDS.map(|board| format!("flash-{}", board.name));
    let others = ["fw", "image", "emu", "emu-run", "emu-record", "emu-compare", "qemu", "qemu-test"];
    let mut names: Vec<&str> = flash.iter().map(String::as_str).chain(others).collect();
    names.sort_unstable();
    let mut found: Vec<&str> = aliases.iter().map(|(alias, _)| *alias).collect();
    found.sort_unstable();
    assert_eq!(found, names);
    for (alias, task) in aliases {
        assert_eq!(task, format!("{alias}\""));
    }
    // And nothing else in that file names the firmware's target or its toolchain.
    assert!(!config.contains("thumbv7em") && !config.contains("manifest-path"), "{config}");
}
