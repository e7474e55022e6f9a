//! `jetlink rig` in real time, on a busy computer: the simulation is the same as with `--fast`, however late
//! the host is.

use super::process::Running;
use super::{file, signal};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// A rig in real time takes no longer than this beyond its engine time and its stop.
const PATIENCE: Duration = Duration::from_secs(60);
/// Rigs beside one another, and busy processes beside them.
const RIGS: usize = 4;
/// Effect of closing a laptop's lid on a process.
const STOPPED_FOR: Duration = Duration::from_secs(3);

fn rig(args: &[&str], csv: &PathBuf) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_jetlink"));
    command.arg("rig").args(args).arg("--csv").arg(csv);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

/// Runs `jetlink rig` with these arguments four times at once, beside four busy processes, stops each for 3 s in
/// the middle, and compares it with `--fast`.
fn busy_and_stopped(name: &str, args: &[&str], engine_time: Duration) {
    let fast_csv = file(&format!("{name}-fast.csv"));
    let fast = rig(&[&["--fast"], args].concat(), &fast_csv).output().expect("it runs");
    let fast_text = String::from_utf8(fast.stdout).expect("UTF-8");
    assert_eq!(fast.status.code(), Some(0), "{fast_text}");
    assert!(fast_text.contains("\nSummary after ") && !fast_text.contains("FAILED"), "{fast_text}");
    let fast_rows = std::fs::read_to_string(fast_csv).expect("the CSV file");
    assert!(fast_rows.lines().count() > 100, "{fast_rows}");

    let _busy: Vec<Running> = (0..RIGS)
        .map(|_| Command::new("sh").args(["-c", "while :; do :; done"]).spawn().expect("sh"))
        .map(Running)
        .collect();
    let began = Instant::now();
    thread::scope(|scope| {
        for i in 0..RIGS {
            let csv = file(&format!("{name}-{i}.csv"));
            let (fast_text, fast_rows) = (&fast_text, &fast_rows);
            scope.spawn(move || {
                let mut live = Running(rig(args, &csv).spawn().expect("it runs"));
                // Not all at the same moment of their flights.
                thread::sleep(engine_time / 3 + Duration::from_millis(300) * i as u32);
                signal(&live.0, "STOP");
                thread::sleep(STOPPED_FOR);
                signal(&live.0, "CONT");
                let mut stdout = live.0.stdout.take().expect("piped");
                let mut text = String::new();
                std::io::Read::read_to_string(&mut stdout, &mut text).expect("UTF-8");
                let status = live.0.wait().expect("it ends");
                let took = began.elapsed();
                assert_eq!(status.code(), Some(0), "{text}");
                assert_eq!(&text, fast_text, "the output of a live run differs from that of --fast");
                assert!(
                    std::fs::read_to_string(csv).expect("the CSV file") == *fast_rows,
                    "the CSV files differ"
                );
                // It was in real time, and the stop delayed it.
                let least = engine_time + STOPPED_FOR - Duration::from_millis(500);
                assert!(took >= least && took < engine_time + STOPPED_FOR + PATIENCE, "{took:?}");
            });
        }
    });
}

#[test]
fn a_busy_and_stopped_host_changes_nothing() {
    busy_and_stopped("standby", &["--standby", "--duration", "4s"], Duration::from_secs(4));
}

/// The command of the README, in full: 208 s.
#[test]
#[ignore = "takes 208 s of real time; CI runs it"]
fn a_busy_and_stopped_host_changes_nothing_in_a_whole_flight() {
    busy_and_stopped("flight", &[], Duration::from_secs(204));
}
