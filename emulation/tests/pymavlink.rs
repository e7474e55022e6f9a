//! MAVLink of the release image against pymavlink, an implementation from elsewhere: `cargo emu-run` in real time, and
//! `host/tests/mavlink/board.py` at the telemetry UART's TCP port.
#![cfg(unix)]

#[path = "../../host/tests/support/process.rs"]
mod process;
#[path = "../../host/tests/support/python.rs"]
mod python;

use process::Running;
use python::{PYMAVLINK, python};
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../host/tests/mavlink/board.py");

#[test]
#[ignore = "1.5 minutes in real time, and installs pymavlink with pip: cargo emu -- --ignored"]
fn another_implementation_flies_an_emulated_board() {
    let python = match python() {
        Ok(python) => python,
        Err(why) => {
            assert!(std::env::var_os("CI").is_none(), "{why}");
            eprintln!("NOT RUN: the emulated board against {PYMAVLINK}: {why}");
            return;
        }
    };
    // A port that nobody uses at the moment.
    let port = std::net::TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
    let port = port.expect("a port").port().to_string();
    let mut board = Command::new(env!("CARGO_BIN_EXE_emu"))
        .args(["emu-run", "matek-h743", "--tcp", &port])
        .stdout(Stdio::piped())
        .spawn()
        .expect("it starts");
    let mut log = BufReader::new(board.stdout.take().expect("piped")).lines().map_while(Result::ok);
    let _board = Running(board);
    log.find(|line| line.contains("the telemetry UART: 127.0.0.1:")).expect("it listens");
    // What nobody reads would stop it.
    std::thread::spawn(move || log.for_each(drop));
    let output = Command::new(python).arg(SCRIPT).arg(&port).output().expect("python starts");
    let text = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && text.contains("all as the documents have it"), "{text}{errors}");
    assert!(!errors.contains("Exception"), "{errors}");
    println!("{text}");
}
