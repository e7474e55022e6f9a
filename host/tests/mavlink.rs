//! `jetlink rig --mavlink` against pymavlink: a ground station and an autopilot that know MAVLink from elsewhere.
//!
//! The test makes a virtual environment with the pinned pymavlink, once. Where that is not possible (no python3, no package
//! index) it says what was not run, and fails only in CI.
#![cfg(unix)]

#[path = "support/process.rs"]
mod process;
#[path = "support/python.rs"]
mod python;

use process::Running;
use python::{PYMAVLINK, python};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// Engine time passes this many times as fast.
const SPEED: &str = "8";

/// A port that nobody uses at the moment.
fn free_port() -> u16 {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    listener.local_addr().expect("its number").port()
}

fn rig(arguments: &[String]) -> Running {
    let child = Command::new(env!("CARGO_BIN_EXE_jetlink"))
        .args(["rig", "--engine", "name=left", "--engine", "name=right,ecu=zk,baud=115200"])
        .args(arguments)
        .stdout(Stdio::null())
        .spawn()
        .expect("it starts");
    Running(child)
}

/// Runs a script of tests/mavlink, which prints the port that it listens on, and that of its SBUS output if it has one, and gets
/// that of the rig.
fn play(python: &Path, script: &str, variables: &[(&str, &str)]) -> Output {
    let mut pilot = Command::new(python)
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/mavlink").join(script))
        .env("SPEED", SPEED)
        .envs(variables.iter().copied())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("python starts");
    let mut out = BufReader::new(pilot.stdout.take().expect("piped"));
    let mut line = String::new();
    out.read_line(&mut line).expect("a line");
    let ports = line.trim().strip_prefix("listening ").unwrap_or_default();
    let (autopilot, sbus) = ports.split_once(' ').map_or((ports, None), |(port, sbus)| (port, Some(sbus)));
    let ground = free_port();
    let mut arguments = vec![
        "--mavlink".into(),
        format!("tcpout:127.0.0.1:{autopilot}"),
        "--mavlink".into(),
        format!("tcpin:127.0.0.1:{ground}"),
        "--speed".into(),
        variables.iter().find(|(name, _)| *name == "SPEED").map_or(SPEED, |(_, speed)| speed).into(),
    ];
    if let Some(port) = sbus {
        arguments.extend(["--rc".into(), format!("sbus=tcpout:127.0.0.1:{port}")]);
    }
    let _rig = rig(&arguments);
    writeln!(pilot.stdin.take().expect("piped"), "{ground}").expect("it reads");
    let mut rest = Vec::new();
    std::io::Read::read_to_end(&mut out, &mut rest).expect("its output");
    let output = pilot.wait_with_output().expect("its end");
    Output { stdout: rest, ..output }
}

#[test]
#[ignore = "in real time, and installs pymavlink with pip: .ci/mavlink"]
fn another_implementation_flies_the_rig() {
    let python = match python() {
        Ok(python) => python,
        Err(why) => {
            assert!(std::env::var_os("CI").is_none(), "{why}");
            eprintln!("NOT RUN: the rig against {PYMAVLINK}: {why}");
            return;
        }
    };
    let output = play(&python, "pilot.py", &[]);
    let text = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && text.contains("all as the documents have it"), "{text}{errors}");
    assert!(!errors.contains("Exception"), "{errors}");
    println!("{text}");
}

/// Path of an ArduPlane that was built for simulation (docs/mavlink.md).
const ARDUPLANE: &str = "JETLINK_ARDUPLANE";

#[test]
#[ignore = "in real time, and needs an ArduPlane: .ci/mavlink"]
fn a_real_arduplane_throttles_two_engines() {
    under_arduplane("arduplane.py", "4", "3", "flown with a real ArduPlane");
}

#[test]
#[ignore = "in real time, and needs an ArduPlane: .ci/mavlink"]
fn a_real_arduplane_flies_two_engines_by_its_sbus_output() {
    // A frame every 20 ms, of which a busy computer must not delay any by 200 ms.
    under_arduplane("arduplane_sbus.py", "2", "4", "flown by the SBUS output of a real ArduPlane");
}

/// Plays a script with a simulated ArduPlane of its own, if there is one.
fn under_arduplane(script: &str, usual_speed: &str, instance: &str, end: &str) {
    let Ok(arduplane) = std::env::var(ARDUPLANE) else {
        eprintln!("NOT RUN: the rig under a real ArduPlane, {script}: {ARDUPLANE} is not set");
        return;
    };
    let python = python().expect("pymavlink");
    let speed = std::env::var("JETLINK_ARDUPLANE_SPEED").unwrap_or_else(|_| usual_speed.to_owned());
    let variables =
        [("VEHICLE", "1"), ("SPEED", &speed), ("INSTANCE", instance), (ARDUPLANE, arduplane.as_str())];
    let output = play(&python, script, &variables);
    let text = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && text.contains(end), "{text}{errors}");
    println!("{text}");
}

#[test]
fn addresses_that_cannot_be_are_refused() {
    for (arguments, part) in [
        (&["--mavlink", "tcp:1"][..], "tcpin:HOST:PORT"),
        (&["--mavlink", "tcpin:256.0.0.1:1"], "cannot open tcpin:256.0.0.1:1: "),
        (&["--mavlink", "serial:/dev/nothing-there:57600"], "cannot open serial:/dev/nothing-there:57600: "),
        (&["--mavlink", "tcpin:127.0.0.1:1", "--fast"], "--fast"),
    ] {
        let output =
            Command::new(env!("CARGO_BIN_EXE_jetlink")).arg("rig").args(arguments).output().expect("it runs");
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{errors}");
        assert!(errors.contains(part), "{errors}");
    }
}
