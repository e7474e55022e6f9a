//! `jetlink rig --mavlink` against pymavlink: a ground station and an autopilot with an independent implementation.
//!
//! The test makes a virtual environment with the pinned pymavlink, once. If that is not possible (no python3, no package
//! index), it prints which tests did not run, and fails only in CI.
#![cfg(unix)]

#[path = "support/frame.rs"]
mod frame;
#[path = "support/port.rs"]
mod port;
#[path = "support/process.rs"]
mod process;
#[path = "support/python.rs"]
mod python;

use frame::frame;
use port::free_port;
use process::Running;
use python::{check, check_pilot, interpreter, python, script};
use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

/// Engine time passes this many times as fast.
const SPEED: &str = "8";

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
fn play(python: &Path, name: &str, variables: &[(&str, &str)], of_rig: &[String]) -> Output {
    let mut pilot = script(python, name)
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
    let mut arguments = of_rig.to_vec();
    arguments.extend([
        "--mavlink".into(),
        format!("tcpout:127.0.0.1:{autopilot}"),
        "--mavlink".into(),
        format!("tcpin:127.0.0.1:{ground}"),
        "--speed".into(),
        variables.iter().find(|(name, _)| *name == "SPEED").map_or(SPEED, |(_, speed)| speed).into(),
    ]);
    if let Some(port) = sbus {
        arguments.extend(["--rc".into(), format!("sbus=tcpout:127.0.0.1:{port},hand=7")]);
    }
    let mut rig = rig(&arguments);
    writeln!(pilot.stdin.take().expect("piped"), "{ground}").expect("it reads");
    let mut rest = Vec::new();
    std::io::Read::read_to_end(&mut out, &mut rest).expect("its output");
    let output = pilot.wait_with_output().expect("its end");
    // Its files are complete then.
    let ended = Command::new("kill").arg(rig.0.id().to_string()).status();
    assert!(ended.expect("kill").success() && rig.0.wait().is_ok());
    Output { stdout: rest, ..output }
}

#[test]
#[ignore = "in real time, and installs pymavlink with pip: .ci/mavlink"]
fn another_implementation_flies_the_rig() {
    let Some(python) = interpreter("the rig") else { return };
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mavlink-capture");
    let (capture, log) = (folder.display().to_string(), folder.with_extension("efi").display().to_string());
    let output = play(&python, "pilot.py", &[("EFI_LOG", &log)], &["--capture".to_owned(), capture.clone()]);
    check_pilot(&output);
    // Each EFI_STATUS is what the simulated ECU had sent.
    let judged = script(&python, "efi.py").args([&capture, &log, "left", "right"]).output();
    check(&judged.expect("python starts"), "as the ECU sent");
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

#[test]
#[ignore = "in real time, and needs an ArduPlane: .ci/mavlink"]
fn a_real_arduplane_on_a_slow_link_and_one_with_a_key_make_no_engine_jump_or_start() {
    under_arduplane("arduplane_slow.py", "4", "5", "flown by a real ArduPlane on a slow link");
}

#[test]
#[ignore = "in real time, and needs an ArduPlane: .ci/mavlink"]
fn a_real_arduplane_beside_another_vehicle_is_learnt_only_once_it_is_alone() {
    under_arduplane("arduplane_two.py", "4", "6", "flown beside another vehicle");
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
    let output = play(&python, script, &variables, &[]);
    check(&output, end);
}

/// A station on a UDP port of its own.
struct Station(UdpSocket);

impl Station {
    fn new() -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a port");
        socket.set_read_timeout(Some(Duration::from_millis(250))).expect("a timeout");
        Self(socket)
    }

    fn port(&self) -> u16 {
        self.0.local_addr().expect("its number").port()
    }

    /// The number of the message that comes from the node next, and from where.
    fn next(&self) -> Option<(u8, SocketAddr)> {
        let mut buffer = [0; 2048];
        let (count, from) = self.0.recv_from(&mut buffer).ok()?;
        (count > 12 && buffer[0] == 0xFD && buffer[6] >= 25).then_some((buffer[7], from))
    }

    /// Sends this to a port repeatedly until the node answers.
    fn is_answered(&self, to: u16, bytes: &[u8], tries: usize) -> bool {
        (0..tries).any(|_| {
            self.0.send_to(bytes, ("127.0.0.1", to)).expect("it is sent");
            self.next().is_some()
        })
    }
}

#[test]
fn by_udp_the_last_peer_that_sent_a_frame_is_answered_and_udpout_sends_to_its_own() {
    let ground = Station::new().port();
    // The first one is the autopilot's, and nothing is sent there before it is learnt.
    let (autopilot, own) = (Station::new(), Station::new());
    let addresses = [
        format!("udpout:127.0.0.1:{}", autopilot.port()),
        format!("udpout:127.0.0.1:{}", own.port()),
        format!("udpin:127.0.0.1:{ground}"),
    ];
    let ports = addresses.into_iter().flat_map(|address| ["--mavlink".to_owned(), address]);
    let _rig = rig(&ports.chain(["--speed".into(), SPEED.into()]).collect::<Vec<_>>());
    let beat = frame(0, 50, &[0, 0, 0, 0, 6, 8, 0, 4, 3]);
    let (first, second, stray) = (Station::new(), Station::new(), Station::new());
    assert!(first.is_answered(ground, &beat, 100), "the first peer");
    assert!(!stray.is_answered(ground, b"no frame", 8), "who sends no frame takes nothing over");
    assert!(second.is_answered(ground, &beat, 20), "another one");
    assert!(first.is_answered(ground, &beat, 20), "and the first one again");
    let (_, from) = (0..100).find_map(|_| own.next()).expect("something on its own port");
    own.0.send_to(&frame(21, 159, &[1, 0]), from).expect("a request for all parameters is sent");
    assert!((0..2000).any(|_| own.next().is_some_and(|(id, _)| id == 22)), "a parameter");
    assert!(autopilot.next().is_none());
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
