//! MAVLink at the telemetry port of `cargo qemu` against pymavlink, an independent implementation: `board.py` of `host/tests/mavlink`,
//! in real time.
#![cfg(unix)]

#[path = "../../host/tests/support/port.rs"]
mod port;
#[path = "../../host/tests/support/python.rs"]
mod python;

use port::free_port;
use python::{check_pilot, interpreter, script};
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

#[test]
#[ignore = "1.5 minutes in real time, needs QEMU, and installs pymavlink with pip: .ci/qemu"]
fn another_implementation_flies_an_engine_in_qemu() {
    let Some(python) = interpreter("QEMU") else { return };
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
    let efi_log = Path::new(env!("CARGO_TARGET_TMPDIR")).join("qemu.efi");
    let mut pilot = script(&python, "board.py");
    let output = pilot.arg(port.to_string()).env("EFI_LOG", efi_log).output().expect("python starts");
    check_pilot(&output);
}
