//! MAVLink at the telemetry port of `cargo qemu` against pymavlink, an independent implementation: `board.py` of `host/tests/mavlink`,
//! in real time.
#![cfg(unix)]

#[path = "../../host/tests/support/python.rs"]
mod python;

use python::{PYMAVLINK, python};
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// A process that leads a group: the group, QEMU in it, ends with the test, as it does at Ctrl-C.
struct Leader(Child);

impl Drop for Leader {
    fn drop(&mut self) {
        let _ = Command::new("kill").args(["-KILL", "--"]).arg(format!("-{}", self.0.id())).status();
        let _ = self.0.wait();
    }
}

/// A port that is not in use.
fn free_port() -> u16 {
    let port = std::net::TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
    port.expect("a port").port()
}

#[test]
#[ignore = "1.5 minutes in real time, needs QEMU, and installs pymavlink with pip: .ci/qemu"]
fn another_implementation_flies_an_engine_in_qemu() {
    let python = match python() {
        Ok(python) => python,
        Err(why) => {
            assert!(std::env::var_os("CI").is_none(), "{why}");
            eprintln!("NOT RUN: QEMU against {PYMAVLINK}: {why}");
            return;
        }
    };
    let port = free_port();
    let mut qemu = Command::new(env!("CARGO_BIN_EXE_qemu"))
        .args(["--telemetry", &format!("tcp:127.0.0.1:{port},server=on,wait=off")])
        .process_group(0)
        .stdout(Stdio::piped())
        .spawn()
        .expect("it starts");
    let mut log = BufReader::new(qemu.stdout.take().expect("piped")).lines().map_while(Result::ok);
    let _qemu = Leader(qemu);
    log.find(|line| line.ends_with("stop with Ctrl-C")).expect("the image is built");
    // Unread output would block it.
    std::thread::spawn(move || log.for_each(drop));
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../host/tests/mavlink/board.py");
    let efi_log = Path::new(env!("CARGO_TARGET_TMPDIR")).join("qemu.efi");
    let mut pilot = Command::new(python);
    let output =
        pilot.arg(script).arg(port.to_string()).env("EFI_LOG", efi_log).output().expect("python starts");
    let text = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && text.contains("all as the documents have it"), "{text}{errors}");
    assert!(!errors.contains("Exception"), "{errors}");
    println!("{text}");
}
