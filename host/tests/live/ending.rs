//! `jetlink rig` without a terminal, ended before its time.

use super::{ended, file, is_no_failure, jetlink, signal, wait_until};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::process::{Command, Stdio};

/// Runs without a terminal until its CSV file has rows at this engine time, then sends a signal.
#[track_caller]
fn ended_by(name: &str, args: &[&str], engine_time: f64, signal_name: &str) -> (Option<i32>, String) {
    let csv = file(&format!("{name}.csv"));
    let _ = std::fs::remove_file(&csv); // of an earlier test
    let log = file(&format!("{name}.log"));
    let out = File::create(&log).expect("a file");
    let mut child = jetlink(args).arg("--csv").arg(&csv).stdout(out).spawn().expect("it runs");
    wait_until("rows in the CSV file", || {
        let rows = std::fs::read_to_string(&csv).unwrap_or_default();
        // The last row may not be whole yet.
        let row = rows.lines().rev().nth(1).and_then(|row| row.split(',').next()?.parse::<f64>().ok());
        row.is_some_and(|at| at >= engine_time)
    });
    signal(&child, signal_name);
    let status = ended(&mut child).code();
    (status, std::fs::read_to_string(log).expect("the output"))
}

#[test]
fn an_ended_run_is_reported_and_failed_by_an_earlier_fault() {
    let args = ["--fast", "--duration", "24h"];
    let (status, text) = ended_by("end-good", &args, 60.0, "TERM");
    assert_eq!(status, Some(143), "{text}");
    is_no_failure(&text, "SIGTERM");
    let bad = [&args[..], &["--faults", "hot-start=left"]].concat();
    let (status, text) = ended_by("end-bad", &bad, 60.0, "TERM");
    assert_eq!(status, Some(1), "{text}");
    assert!(text.contains("FAILED  left: the start failed: "), "{text}");
    assert!(text.contains("The run was ended by SIGTERM before it was complete."), "{text}");
    assert_eq!(text.lines().filter(|line| line.starts_with("FAILED")).count(), 1, "{text}");
    let (status, text) = ended_by("end-scenario", &["--scenario", "emergency-stop"], 2.0, "INT");
    assert_eq!(status, Some(130), "{text}");
    assert!(text.contains("The run was ended by Ctrl-C before") && !text.contains("FAILED"), "{text}");
}

/// `nohup` has SIGHUP ignored, and so it stays.
#[test]
#[cfg(target_os = "linux")]
fn nohup_is_respected() {
    let script = format!("trap '' HUP; exec '{}' rig --standby --duration 2s", env!("CARGO_BIN_EXE_jetlink"));
    let mut child = Command::new("sh").args(["-c", &script]).stdout(Stdio::piped()).spawn().expect("it runs");
    let mut output = BufReader::new(child.stdout.take().expect("piped"));
    let mut line = String::new();
    while !line.contains("link up") {
        line.clear();
        assert!(output.read_line(&mut line).expect("output") > 0, "it ended");
    }
    signal(&child, "HUP");
    let mut rest = String::new();
    output.read_to_string(&mut rest).expect("output");
    assert!(rest.contains("PASS: "), "{rest}");
    assert_eq!(ended(&mut child).code(), Some(0));
}
