//! MAVLink of the images against pymavlink, an independent implementation: in real time, with a script of `host/tests/mavlink` at the
//! telemetry UART's TCP port. `board.py` flies the release image by `cargo emu-run`, and `efi.py` compares its EFI_STATUS with what the
//! ECU sent; `board_signing.py` flies an image with signing, whose key is in its F-RAM.
#![cfg(unix)]

#[path = "../../host/tests/support/port.rs"]
mod port;
#[path = "../../host/tests/support/process.rs"]
mod process;
#[path = "../../host/tests/support/python.rs"]
mod python;

use emulation::{Fram, Image, PIXRACER, Run};
use port::free_port;
use process::Running;
use python::{check, check_pilot, interpreter, script};
use rigless::chip::uart::TcpPeer;
use sim::ecu::SECOND;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

/// Plays a script of a pilot to its successful end.
fn play(script: &mut Command, port: u16) {
    let output = script.arg(port.to_string()).output().expect("python starts");
    check_pilot(&output);
}

#[test]
#[ignore = "1.5 minutes in real time, and installs pymavlink with pip: cargo emu -- --ignored"]
fn another_implementation_flies_an_emulated_board() {
    let Some(python) = interpreter("the emulated board") else { return };
    let port = free_port();
    let capture = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pymavlink-capture");
    let efi_log = capture.with_extension("efi");
    let mut board = Command::new(env!("CARGO_BIN_EXE_emu"))
        .args(["emu-run", "matek-h743", "--tcp", &port.to_string(), "--capture"])
        .arg(&capture)
        .stdout(Stdio::piped())
        .spawn()
        .expect("it starts");
    let mut log = BufReader::new(board.stdout.take().expect("piped")).lines().map_while(Result::ok);
    let board = Running(board);
    log.find(|line| line.contains("the telemetry UART: 127.0.0.1:")).expect("it listens");
    // Unread output would block it.
    std::thread::spawn(move || log.for_each(drop));
    play(script(&python, "board.py").env("EFI_LOG", &efi_log), port);
    drop(board);
    let mut judge = script(&python, "efi.py");
    let judged = judge.args([&capture, &efi_log]).arg("left").output().expect("python starts");
    check(&judged, "as the ECU sent");
}

/// The F-RAM of a board whose key was set over USB, as the store keeps it: a test of mavlink/ writes it.
fn fram_with_key() -> Fram {
    let digits: Vec<_> = include_str!("signing-key.hex").bytes().filter(u8::is_ascii_hexdigit).collect();
    let byte = |pair: &[u8]| {
        let digit = |at: usize| char::from(pair[at]).to_digit(16).expect("a digit") as u8;
        digit(0) << 4 | digit(1)
    };
    Fram::fm25v01a().holding(&digits.chunks(2).map(byte).collect::<Vec<_>>())
}

/// No emulator has a USB controller, over which a key is set: this does not test setting a key.
#[test]
#[ignore = "1 minute in real time, and installs pymavlink with pip: cargo emu -- --ignored"]
fn an_emulated_board_with_a_key_obeys_what_is_signed_with_it_once_and_nothing_else() {
    let Some(python) = interpreter("the emulated board") else { return };
    let port = free_port();
    let peer = TcpPeer::listen(port).expect("it listens");
    let run = Run::new(&PIXRACER, Image::Usb).engines().fram(Some(fram_with_key()));
    std::thread::spawn(move || run.tcp(PIXRACER.telemetry.name, peer).live_until(300 * SECOND));
    play(&mut script(&python, "board_signing.py"), port);
}
