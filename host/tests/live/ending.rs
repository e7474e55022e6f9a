//! `jetlink rig` that is ended before its time: by a key, by a signal, by a panic. The terminal is as it was, the
//! files are complete, the summary so far is printed.

use super::{file, signal};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, Winsize, tcgetattr, tcsetwinsize};
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

/// The most that anything here may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(20);
const HEAD: &str = "jetlink rig   ";
const LEAVE_ALTERNATE_SCREEN: &str = "\u{1b}[?1049l";
const SHOW_CURSOR: &str = "\u{1b}[?25h";

/// With the signals that a terminal's shell would give it: whoever runs the tests may ignore some, as `nohup` does and a
/// shell for what it starts in the background.
fn jetlink(args: &[&str]) -> Command {
    let program = env!("CARGO_BIN_EXE_jetlink");
    let defaults = ["--default-signal=HUP,INT,TERM"];
    let can_reset =
        Command::new("env").args(defaults).arg("true").output().is_ok_and(|run| run.status.success());
    let mut command = if can_reset {
        let mut command = Command::new("env");
        command.args(defaults).arg(program);
        command
    } else {
        Command::new(program)
    };
    command.arg("rig").args(args).env("TERM", "xterm-256color").env("RUST_BACKTRACE", "0");
    command
}

#[track_caller]
fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let began = Instant::now();
    while !done() {
        assert!(began.elapsed() < PATIENCE, "not within {PATIENCE:?}: {what}");
        thread::sleep(Duration::from_millis(10));
    }
}

#[track_caller]
fn ended(child: &mut Child) -> ExitStatus {
    let mut status = None;
    wait_until("the rig ends", || {
        status = child.try_wait().expect("a status");
        status.is_some()
    });
    status.expect("a status")
}

/// A rig on a terminal of its own.
struct Terminal {
    child: Child,
    /// What a person types goes in here.
    keyboard: Option<File>,
    /// The program's side, to look at its modes.
    side: Option<File>,
    output: Arc<Mutex<String>>,
    /// Copies what is shown, until the last one who has the terminal open is gone.
    reader: Option<thread::JoinHandle<()>>,
}

impl Terminal {
    fn start(args: &[&str]) -> Self {
        Self::start_as("xterm-256color", args)
    }

    /// On a terminal that says of itself what it is.
    fn start_as(term: &str, args: &[&str]) -> Self {
        let master =
            openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).expect("a terminal");
        grantpt(&master).expect("a terminal");
        unlockpt(&master).expect("a terminal");
        let name = ptsname(&master, Vec::new()).expect("a terminal").into_string().expect("UTF-8");
        let side = OpenOptions::new().read(true).write(true).open(name).expect("a terminal");
        tcsetwinsize(&side, Winsize { ws_row: 30, ws_col: 140, ws_xpixel: 0, ws_ypixel: 0 }).expect("a size");
        let program = || Stdio::from(side.try_clone().expect("a copy"));
        let child =
            jetlink(args).env("TERM", term).stdin(program()).stdout(program()).stderr(program()).spawn();
        let child = child.expect("it runs");
        let keyboard = File::from(master);
        let output = Arc::new(Mutex::new(String::new()));
        let (mut screen, copy) = (keyboard.try_clone().expect("a copy"), output.clone());
        let reader = thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = screen.read(&mut bytes) {
                copy.lock().unwrap().push_str(&String::from_utf8_lossy(&bytes[..count]));
            }
        });
        Self { child, keyboard: Some(keyboard), side: Some(side), output, reader: Some(reader) }
    }

    fn output(&self) -> String {
        self.output.lock().unwrap().clone()
    }

    /// Until the table is shown and at work.
    #[track_caller]
    fn is_live(&self) {
        wait_until("the screen is shown", || self.output().contains(HEAD) && self.output().contains("left"));
        wait_until("the run goes on", || self.output().contains("link up"));
        assert!(self.is_raw(), "the screen needs single keys");
    }

    fn is_raw(&self) -> bool {
        let side = self.side.as_ref().expect("open");
        !tcgetattr(side).expect("modes").local_modes.contains(LocalModes::ICANON | LocalModes::ECHO)
    }

    fn types(&mut self, keys: &[u8]) {
        self.keyboard.as_mut().expect("open").write_all(keys).expect("typed");
    }

    /// The status, and what is on the normal screen afterwards.
    #[track_caller]
    fn end(mut self) -> (ExitStatus, String) {
        let status = ended(&mut self.child);
        assert!(!self.is_raw(), "the terminal is still in raw mode");
        // With nobody left who has it open, the reader comes to the end of what was shown.
        drop(self.side.take());
        self.reader.take().expect("it reads").join().expect("it reads");
        let output = self.output();
        let (_, normal) = output.rsplit_once(LEAVE_ALTERNATE_SCREEN).expect("the alternate screen is left");
        assert!(normal.contains(SHOW_CURSOR), "the cursor is shown: {normal:?}");
        (status, normal.replace('\r', ""))
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        let _ = self.child.kill(); // it may have ended already
        let _ = self.child.wait();
    }
}

/// Until the CSV file has more than a second of each engine.
#[track_caller]
fn has_rows(csv: &Path, engines: usize) {
    let rows = || std::fs::read_to_string(csv).unwrap_or_default().lines().count();
    wait_until("rows in the CSV file", || rows() > 10 * engines);
}

/// Both files are what a run that ends by itself leaves: whole rows for all engines, and a picture.
#[track_caller]
fn files_are_complete(csv: &Path, plot: &Path, engines: usize) {
    let text = std::fs::read_to_string(csv).expect("the CSV file");
    assert!(text.ends_with('\n'));
    let mut rows = text.lines();
    let columns = rows.next().expect("a head").split(',').count();
    let count = rows.clone().count();
    assert!(count >= 10 * engines && count.is_multiple_of(engines), "{count} rows");
    assert!(rows.all(|row| row.split(',').count() == columns), "{text}");
    let picture = std::fs::read_to_string(plot).expect("the plot");
    let xml = roxmltree::Document::parse(&picture).expect("well-formed XML");
    assert!(xml.descendants().any(|node| node.text().is_some_and(|text| text.contains("left: "))));
}

/// An ended run without a problem.
#[track_caller]
fn is_no_failure(text: &str, by: &str) {
    assert!(text.contains(&format!("The run was ended by {by} before it was complete.")), "{text}");
    assert!(text.contains("unsolicited commands") && text.contains("replies in time"), "{text}");
    assert!(
        !text.contains("FAILED") && !text.contains("are shut down") && !text.contains("panicked"),
        "{text}"
    );
}

#[test]
fn keys_and_signals_on_a_terminal_restore_it_and_print_the_summary_so_far() {
    type End = fn(&mut Terminal);
    let ends: [(&str, End, i32, &str); 6] = [
        ("q", |terminal| terminal.types(b"q"), 0, "a key"),
        ("Ctrl-C", |terminal| terminal.types(&[3]), 130, "Ctrl-C"),
        ("SIGINT", |terminal| signal(&terminal.child, "INT"), 130, "Ctrl-C"),
        ("SIGTERM", |terminal| signal(&terminal.child, "TERM"), 143, "SIGTERM"),
        // As `timeout` does: to the process, and to its group.
        (
            "SIGTERM twice",
            |terminal| {
                signal(&terminal.child, "TERM");
                let _ = Command::new("kill").arg("-TERM").arg(terminal.child.id().to_string()).output();
            },
            143,
            "SIGTERM",
        ),
        ("SIGHUP", |terminal| signal(&terminal.child, "HUP"), 129, "SIGHUP"),
    ];
    thread::scope(|scope| {
        for (name, end, status, by) in ends {
            scope.spawn(move || {
                let name = name.replace(' ', "-");
                let (csv, plot) = (file(&format!("end-{name}.csv")), file(&format!("end-{name}.svg")));
                let mut terminal =
                    Terminal::start(&["--csv", csv.to_str().unwrap(), "--plot", plot.to_str().unwrap()]);
                terminal.is_live();
                has_rows(&csv, 4);
                end(&mut terminal);
                let (ended, text) = terminal.end();
                assert_eq!(ended.code(), Some(status), "{name}: {text}");
                is_no_failure(&text, by);
                files_are_complete(&csv, &plot, 4);
            });
        }
    });
}

#[test]
fn events_are_printed_with_the_summary() {
    let csv = file("events.csv");
    let mut terminal = Terminal::start(&["--standby", "--csv", csv.to_str().unwrap()]);
    terminal.is_live();
    has_rows(&csv, 4);
    terminal.types(b"q");
    let (ended, text) = terminal.end();
    assert_eq!(ended.code(), Some(0), "{text}");
    let events = text.split_once("\nEvents\n").expect("events").1;
    let events = events.split_once("\nSummary after ").expect("a summary").0;
    assert!(
        events.contains("  left          ECU link up") && events.contains("the node has started"),
        "{text}"
    );
}

/// The screen is left, the shell gets its terminal, and `fg` brings it back.
#[test]
fn ctrl_z_suspends_and_goes_on() {
    for by_key in [true, false] {
        let mut terminal = Terminal::start(&["--standby", "--duration", "600s"]);
        terminal.is_live();
        if by_key {
            terminal.types(&[26]);
        } else {
            signal(&terminal.child, "TSTP");
        }
        let pid = terminal.child.id();
        let state = || {
            let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            stat.rsplit_once(") ").and_then(|(_, rest)| rest.chars().next())
        };
        wait_until("it stops", || state() == Some('T'));
        wait_until("the screen is left", || terminal.output().ends_with(SHOW_CURSOR));
        assert!(!terminal.is_raw(), "the shell needs its terminal");
        let before = terminal.output().len();
        signal(&terminal.child, "CONT");
        wait_until("the screen is back", || {
            terminal.output().get(before..).is_some_and(|new| new.contains(HEAD) && new.contains("left"))
        });
        assert!(terminal.is_raw());
        terminal.types(b"q");
        let (ended, text) = terminal.end();
        assert_eq!(ended.code(), Some(0), "{text}");
    }
}

#[test]
fn a_dumb_terminal_and_plain_get_lines() {
    for (term, args) in [
        ("dumb", &["--standby", "--duration", "2s"][..]),
        ("xterm", &["--plain", "--standby", "--duration", "2s"]),
    ] {
        let mut terminal = Terminal::start_as(term, args);
        let status = ended(&mut terminal.child);
        wait_until("the summary", || terminal.output().contains("\nSummary after "));
        let text = terminal.output();
        assert_eq!(status.code(), Some(0), "{text}");
        assert!(!text.contains('\u{1b}') && text.contains("  left          ECU link up"), "{text}");
    }
}

#[test]
fn a_played_run_is_saved_and_its_command_printed() {
    let script = file("played-live.txt");
    let mut terminal = Terminal::start(&["--standby", "--save-script", script.to_str().unwrap()]);
    terminal.is_live();
    terminal.types(b"d");
    wait_until("it is done", || terminal.output().contains("played: disarm"));
    terminal.types(b" ");
    wait_until("it is done", || terminal.output().contains("emergency-stop"));
    terminal.types(b"q");
    let (ended, text) = terminal.end();
    assert_eq!(ended.code(), Some(0), "{text}");
    assert!(
        text.contains(&format!("To play it again: cargo rig --script {} --fast", script.display())),
        "{text}"
    );
    let saved = std::fs::read_to_string(&script).expect("the script");
    assert!(saved.contains(" left disarm\n") && saved.contains(" all emergency-stop\n"), "{saved}");
    let again = jetlink(&["--fast", "--script", script.to_str().unwrap()]).output().expect("it runs");
    let again = String::from_utf8(again.stdout).expect("UTF-8");
    let summary = |text: &str| text.split_once("\nSummary after ").map(|(_, summary)| summary.to_owned());
    let live = summary(&text).expect("a summary");
    assert!(live.starts_with(&summary(&again).expect("a summary")), "{live}{again}");
}

/// What a smaller screen had is gone when it grows.
#[test]
fn a_terminal_can_change_its_size() {
    let mut terminal = Terminal::start(&["--standby", "--duration", "600s"]);
    terminal.is_live();
    for (columns, rows, what) in [(30, 10, "columns"), (150, 40, "Titan")] {
        let before = terminal.output().len();
        let size = Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 };
        tcsetwinsize(terminal.side.as_ref().expect("open"), size).expect("a size");
        signal(&terminal.child, "WINCH");
        wait_until(what, || terminal.output().get(before..).is_some_and(|new| new.contains(what)));
        let output = terminal.output();
        assert!(output.get(before..).is_some_and(|new| new.contains("\u{1b}[2J")), "it is drawn anew");
    }
    terminal.types(b"q");
    assert_eq!(terminal.end().0.code(), Some(0));
}

#[test]
fn a_run_that_is_complete_stays_until_it_is_ended() {
    let mut terminal = Terminal::start(&["--standby", "--duration", "2s"]);
    wait_until("the verdict", || terminal.output().contains("verdict: PASS"));
    assert!(terminal.child.try_wait().expect("a status").is_none());
    terminal.types(b"q");
    let (ended, text) = terminal.end();
    assert_eq!(ended.code(), Some(0), "{text}");
    assert!(
        text.contains("PASS: all engines reached their targets") && !text.contains("was ended by"),
        "{text}"
    );
}

#[test]
fn a_panic_restores_the_terminal_and_fails() {
    let (csv, plot) = (file("panic.csv"), file("panic.svg"));
    let terminal = Terminal::start(&[
        "--panic-at",
        "20s", // at ×4
        "--csv",
        csv.to_str().unwrap(),
        "--plot",
        plot.to_str().unwrap(),
    ]);
    terminal.is_live();
    let (ended, text) = terminal.end();
    assert_eq!(ended.code(), Some(1), "{text}");
    // The message itself is on the normal screen, and nothing is drawn over it.
    assert!(text.contains("panicked at") && text.contains("the moment of --panic-at"), "{text}");
    assert!(!text.contains(HEAD), "{text}");
    assert!(text.contains("FAILED  the rig has panicked: the moment of --panic-at"), "{text}");
    files_are_complete(&csv, &plot, 4);
}

#[test]
fn a_closed_terminal_ends_the_run_with_complete_files() {
    let (csv, plot) = (file("closed.csv"), file("closed.svg"));
    let mut terminal = Terminal::start(&["--csv", csv.to_str().unwrap(), "--plot", plot.to_str().unwrap()]);
    terminal.is_live();
    has_rows(&csv, 4);
    // First the signal, then nothing can be written any more.
    signal(&terminal.child, "HUP");
    drop(terminal.keyboard.take());
    assert_eq!(ended(&mut terminal.child).code(), Some(129));
    files_are_complete(&csv, &plot, 4);
}

/// No signal comes, as where a terminal's server is killed, and SIGHUP is ignored: the program sees it by itself.
#[test]
fn a_terminal_that_is_gone_ends_the_run() {
    let (csv, plot) = (file("gone.csv"), file("gone.svg"));
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).expect("a terminal");
    grantpt(&master).expect("a terminal");
    unlockpt(&master).expect("a terminal");
    let name = ptsname(&master, Vec::new()).expect("a terminal").into_string().expect("UTF-8");
    let side = || OpenOptions::new().read(true).write(true).open(&name).expect("a terminal");
    tcsetwinsize(side(), Winsize { ws_row: 24, ws_col: 80, ws_xpixel: 0, ws_ypixel: 0 }).expect("a size");
    let script = format!(
        "trap '' HUP; exec '{}' rig --standby --duration 600s --csv '{}' --plot '{}'",
        env!("CARGO_BIN_EXE_jetlink"),
        csv.display(),
        plot.display()
    );
    let mut rig = Command::new("sh");
    rig.args(["-c", &script]).env("TERM", "xterm-256color");
    let mut child = rig.stdin(side()).stdout(side()).stderr(Stdio::null()).spawn().expect("it runs");
    drop(rig); // it holds the terminal open
    let mut terminal = File::from(master);
    let mut screen = terminal.try_clone().expect("a copy");
    let reader = thread::spawn(move || {
        let (mut output, mut bytes) = (String::new(), [0; 4096]);
        while !(output.contains(HEAD) && output.contains("link up")) {
            let count = screen.read(&mut bytes).expect("output");
            output.push_str(&String::from_utf8_lossy(&bytes[..count]));
        }
    });
    reader.join().expect("the screen is shown");
    has_rows(&csv, 4);
    terminal.write_all(b"?").expect("typed");
    drop(terminal);
    assert_eq!(ended(&mut child).code(), Some(129));
    files_are_complete(&csv, &plot, 4);
}

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
fn what_went_wrong_before_the_end_still_fails_the_run() {
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
}

#[test]
fn a_scenario_can_be_ended() {
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
