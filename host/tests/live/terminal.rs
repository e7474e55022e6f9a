//! `jetlink rig` on a terminal: behaviour that only a terminal shows. Keys, signals, a new size, Ctrl-Z, a panic, a closed
//! terminal.

use super::{ended, file, is_no_failure, jetlink, signal, wait_until};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{InputModes, LocalModes, OutputModes, Winsize, tcgetattr, tcsetwinsize};
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;

const HEAD: &str = "jetlink rig   ";
const LEAVE_ALTERNATE_SCREEN: &str = "\u{1b}[?1049l";
const MOUSE_ON: &str = "\u{1b}[?1000h";
const MOUSE_OFF: &str = "\u{1b}[?1000l";
const SHOW_CURSOR: &str = "\u{1b}[?25h";

/// A rig on a terminal of its own.
pub struct Terminal {
    child: Child,
    /// Input for a person's keys.
    keyboard: Option<File>,
    /// The program's side, to look at its modes.
    side: Option<File>,
    output: Arc<Mutex<String>>,
    /// The reader gives up its copy of the terminal.
    closed: Arc<AtomicBool>,
    /// Copies the output until nobody has the terminal open.
    reader: Option<thread::JoinHandle<()>>,
}

impl Terminal {
    pub fn start(args: &[&str]) -> Self {
        Self::start_as("xterm-256color", jetlink(args))
    }

    /// On a terminal that reports what it is.
    fn start_as(term: &str, command: Command) -> Self {
        Self::start_sized(term, command, size(140, 30))
    }

    fn start_sized(term: &str, mut command: Command, size: Winsize) -> Self {
        let master =
            openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).expect("a terminal");
        grantpt(&master).expect("a terminal");
        unlockpt(&master).expect("a terminal");
        let name = ptsname(&master, Vec::new()).expect("a terminal").into_string().expect("UTF-8");
        let side = OpenOptions::new().read(true).write(true).open(name).expect("a terminal");
        tcsetwinsize(&side, size).expect("a size");
        let program = || Stdio::from(side.try_clone().expect("a copy"));
        command.env("TERM", term).stdin(program()).stdout(program()).stderr(program());
        let child = command.spawn().expect("it runs");
        let keyboard = File::from(master);
        let output = Arc::new(Mutex::new(String::new()));
        let closed = Arc::new(AtomicBool::new(false));
        let (mut screen, copy, ends) =
            (keyboard.try_clone().expect("a copy"), output.clone(), closed.clone());
        let reader = thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let (false, Ok(count @ 1..)) = (ends.load(Ordering::Relaxed), screen.read(&mut bytes)) {
                copy.lock().unwrap().push_str(&String::from_utf8_lossy(&bytes[..count]));
            }
        });
        Self { child, keyboard: Some(keyboard), side: Some(side), output, closed, reader: Some(reader) }
    }

    fn output(&self) -> String {
        self.output.lock().unwrap().clone()
    }

    /// Until the table is shown and at work.
    #[track_caller]
    pub fn is_live(&self) {
        wait_until("the screen is shown", || self.output().contains(HEAD) && self.output().contains("left"));
        wait_until("the run continues", || self.output().contains("link up"));
        assert!(self.is_raw(), "the screen needs single keys");
    }

    fn modes(&self) -> (InputModes, OutputModes, LocalModes) {
        let modes = tcgetattr(self.side.as_ref().expect("open")).expect("modes");
        (modes.input_modes, modes.output_modes, modes.local_modes)
    }

    fn is_raw(&self) -> bool {
        !self.modes().2.contains(LocalModes::ICANON | LocalModes::ECHO)
    }

    pub fn types(&mut self, keys: &[u8]) {
        self.keyboard.as_mut().expect("open").write_all(keys).expect("typed");
    }

    fn resize(&self, columns: u16, rows: u16) {
        tcsetwinsize(self.side.as_ref().expect("open"), size(columns, rows)).expect("a size");
        signal(&self.child, "WINCH");
    }

    /// Closes the window: nobody reads any more.
    fn close(&mut self) {
        self.closed.store(true, Ordering::Relaxed);
        drop(self.side.take());
        self.reader.take().expect("it reads").join().expect("it reads");
        drop(self.keyboard.take());
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

fn size(columns: u16, rows: u16) -> Winsize {
    Winsize { ws_row: rows, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 }
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

#[test]
fn keys_and_signals_restore_the_terminal_and_print_events_and_the_summary_so_far() {
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
                let events = text.split_once("\nEvents\n").expect("events").1;
                let events = events.split_once("\nSummary after ").expect("a summary").0;
                assert!(
                    events.contains("  left          ECU link up") && events.contains("the node has started"),
                    "{name}: {text}"
                );
            });
        }
    });
}

/// The screen is left, the shell gets its terminal, `fg` brings it back, and after a change of size it is drawn as a whole.
#[test]
fn a_suspended_rig_comes_back_and_a_resized_one_is_drawn_again() {
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
        // The contents of the smaller screen disappear when it grows.
        for (columns, rows, what) in [(30, 10, "columns"), (150, 40, "Titan")] {
            let before = terminal.output().len();
            terminal.resize(columns, rows);
            wait_until(what, || terminal.output().get(before..).is_some_and(|new| new.contains(what)));
            let output = terminal.output();
            assert!(output.get(before..).is_some_and(|new| new.contains("\u{1b}[2J")), "it is redrawn");
        }
        terminal.types(b"q");
        let (ended, text) = terminal.end();
        assert_eq!(ended.code(), Some(0), "{text}");
    }
}

/// The shell has the terminal then: a program that changes its modes is stopped again.
#[test]
fn a_suspended_rig_can_be_ended() {
    for (signal, status) in [("TERM", 143), ("HUP", 129)] {
        // A shell with job control, on a terminal that controls it.
        let mut shell = crate::signals::with_default_signals("setsid");
        shell.args(["--ctty", "bash", "--norc", "--noprofile", "--noediting", "-i"]).env("PS1", "");
        let mut terminal = Terminal::start_as("xterm-256color", shell);
        let before = terminal.modes();
        let rig = format!("{} rig --standby --duration 600s\n", env!("CARGO_BIN_EXE_jetlink"));
        terminal.types(rig.as_bytes());
        terminal.is_live();
        terminal.types(&[26]);
        wait_until("it stops", || terminal.output().contains("Stopped"));
        // The shell also sends SIGCONT to a job that is stopped.
        // Under load `wait` may return before the shell has seen it continue: 147, stopped.
        let wait = "while wait -f %1; s=$?; [ $s = 147 ]; do :; done";
        terminal.types(format!("kill -{signal} %1; {wait}; echo \"status: $s\"\n").as_bytes());
        // What is typed is echoed, with `$s`.
        let reported = |output: &str| {
            output.split("status: ").any(|rest| rest.starts_with(|c: char| c.is_ascii_digit()))
        };
        wait_until("the shell reports how it ended", || reported(&terminal.output()));
        let shown = terminal.output();
        assert!(shown.contains(&format!("status: {status}")), "{signal}: {shown:?}");
        let output = terminal.output();
        let (_, normal) = output.split_once(LEAVE_ALTERNATE_SCREEN).expect("the alternate screen is left");
        assert!(!normal.contains("\u{1b}[?1049h"), "nothing is drawn over the shell: {normal:?}");
        assert!(signal == "HUP" || normal.contains("The run was ended by SIGTERM"), "{normal}");
        assert_eq!(terminal.modes(), before);
        terminal.types(b"exit\n");
        ended(&mut terminal.child);
    }
}

#[test]
fn a_dumb_terminal_and_plain_get_lines() {
    for (term, args) in [
        ("dumb", &["--standby", "--duration", "2s"][..]),
        ("", &["--standby", "--duration", "2s"]),
        ("xterm", &["--standby", "--duration", "2s", "--csv", "/dev/stderr"]),
        ("xterm", &["--plain", "--standby", "--duration", "2s"]),
    ] {
        let mut terminal = Terminal::start_as(term, jetlink(args));
        let status = ended(&mut terminal.child);
        wait_until("the summary", || terminal.output().contains("\nSummary after "));
        let text = terminal.output();
        assert_eq!(status.code(), Some(0), "{text}");
        assert!(!text.contains('\u{1b}') && text.contains("  left          ECU link up"), "{text}");
    }
}

/// Serial consoles, `ssh -tt` and `expect` report no size.
#[test]
fn a_terminal_without_a_size_gets_80_columns() {
    let mut plain =
        Terminal::start_sized("xterm", jetlink(&["--plain", "--standby", "--duration", "2s"]), size(0, 0));
    let status = ended(&mut plain.child);
    wait_until("the summary", || plain.output().contains("\nSummary after "));
    let text = plain.output().replace('\r', "");
    assert_eq!(status.code(), Some(0), "{text}");
    assert!(text.contains("PASS: all engines") && text.contains("  left          ECU link up"), "{text}");
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    let mut screen =
        Terminal::start_sized("xterm", jetlink(&["--standby", "--duration", "600s"]), size(0, 0));
    screen.is_live();
    screen.types(b"q");
    let (status, text) = screen.end();
    assert_eq!(status.code(), Some(0), "{text}");
    assert!(text.contains("  left          ECU link up"), "{text}");
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
    // Keys of the terminal and of time.
    assert!(!terminal.output().contains(MOUSE_ON), "the mouse is off until a key turns it on");
    terminal.types(b"m");
    wait_until("the mouse is on", || terminal.output().contains(MOUSE_ON));
    terminal.types(b"mp");
    wait_until("it is paused", || terminal.output().contains("PAUSED"));
    let mouse_off = terminal.output().rfind(MOUSE_OFF);
    assert!(mouse_off > terminal.output().rfind(MOUSE_ON), "the mouse is off again");
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

/// Actions of keys during a script file are stored with it, and the file replays the run.
#[test]
fn keys_beside_a_script_are_saved_with_it() {
    let script = file("beside.txt");
    let actions = "standby\n0.5 left disarm\n5.0 left silent\n600.0 end\n";
    std::fs::write(&script, format!("jetlink rig script, version 0.1.0\n{actions}")).unwrap();
    let csv = file("beside.csv");
    let mut terminal =
        Terminal::start(&["--script", script.to_str().unwrap(), "--csv", csv.to_str().unwrap()]);
    terminal.is_live();
    wait_until("the script acts", || terminal.output().contains("played: disarm"));
    // Before the script does it.
    terminal.types(b"fs");
    wait_until("the key acts", || terminal.output().contains("played: silent"));
    let rows = || std::fs::read_to_string(&csv).unwrap_or_default();
    wait_until("the script does it again", || rows().contains("that lasts already"));
    terminal.types(b" ");
    wait_until("the key acts", || terminal.output().contains("emergency-stop"));
    terminal.types(b"q");
    let (ended, text) = terminal.end();
    assert_eq!(ended.code(), Some(0), "{text}");
    let again = text.lines().find_map(|line| line.strip_prefix("To play it again: cargo rig --script "));
    let path = again.and_then(|command| command.strip_suffix(" --fast")).expect("a command").to_owned();
    let saved = std::fs::read_to_string(&path).expect("the script");
    assert!(saved.contains("0.5 left disarm\n") && saved.contains(" all emergency-stop\n"), "{saved}");
    assert_eq!(saved.matches(" left silent\n").count(), 1, "{saved}");
    let again = jetlink(&["--fast", "--script", &path]).output().expect("it runs");
    assert_eq!(again.status.code(), Some(0), "{}", String::from_utf8_lossy(&again.stderr));
    let again = String::from_utf8(again.stdout).expect("UTF-8");
    let summary = |text: &str| text.split_once("\nSummary after ").map(|(_, summary)| summary.to_owned());
    let live = summary(&text).expect("a summary");
    assert!(live.starts_with(&summary(&again).expect("a summary")), "{live}{again}");
}

/// There is no folder for it.
#[test]
fn a_played_run_that_cannot_be_saved_is_printed() {
    let mut command = jetlink(&["--standby", "--duration", "600s"]);
    command.env("TMPDIR", "/nonexistent");
    let mut terminal = Terminal::start_as("xterm-256color", command);
    terminal.is_live();
    terminal.types(b" ");
    wait_until("the key acts", || terminal.output().contains("emergency-stop"));
    terminal.types(b"q");
    let (ended, text) = terminal.end();
    assert_eq!(ended.code(), Some(1), "{text}");
    let (_, script) = text.split_once("The script file of this run:\n").expect("the script");
    assert!(
        script.starts_with("jetlink rig script, version ") && script.contains(" all emergency-stop\n"),
        "{text}"
    );
    assert!(text.contains("cannot write /nonexistent/"), "{text}");
}

/// A run without pilots ends by its script file alone.
#[test]
fn a_run_by_radio_control_that_nobody_played_is_saved_with_its_end() {
    let script = file("untouched.txt");
    let mut terminal = Terminal::start(&["--rc", "sbus", "--save-script", script.to_str().unwrap()]);
    terminal.is_live();
    terminal.types(b"q");
    let (ended, text) = terminal.end();
    assert_eq!(ended.code(), Some(0), "{text}");
    let again = jetlink(&["--fast", "--script", script.to_str().unwrap()]).output().expect("it runs");
    assert_eq!(again.status.code(), Some(0), "{}", String::from_utf8_lossy(&again.stderr));
}

#[test]
fn a_run_that_is_complete_stays_until_it_is_ended() {
    let csv = file("complete.csv");
    let args = ["--standby", "--duration", "2s", "--csv", csv.to_str().unwrap()];
    let mut terminal = Terminal::start(&args);
    wait_until("the verdict", || terminal.output().contains("verdict: PASS"));
    // Sixteen colours, by the codes that every terminal with colours knows.
    assert!(
        terminal.output().contains("\u{1b}[90") && !terminal.output().contains("38;5;"),
        "{}",
        terminal.output()
    );
    assert!(terminal.child.try_wait().expect("a status").is_none());
    // Nothing comes any more, and the file has it all.
    wait_until("the last rows", || {
        let rows = std::fs::read_to_string(&csv).unwrap_or_default();
        let last = rows.lines().last().and_then(|row| row.split(',').next()?.parse::<f64>().ok());
        rows.ends_with('\n') && last.is_some_and(|last| last >= 2.4)
    });
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

/// A window that is closed sends SIGHUP. Where a terminal's server is killed, or SIGHUP is ignored, the program sees it by itself.
#[test]
fn a_terminal_that_is_gone_ends_the_run_with_complete_files() {
    for (name, hangs_up) in [("closed", true), ("gone", false)] {
        let (csv, plot) = (file(&format!("{name}.csv")), file(&format!("{name}.svg")));
        let files = ["--csv", csv.to_str().unwrap(), "--plot", plot.to_str().unwrap()];
        let args = [&["--standby", "--duration", "600s"], &files[..]].concat();
        let mut ignoring = Command::new("sh");
        ignoring
            .args(["-c", "trap '' HUP; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_jetlink"), "rig"])
            .args(&args);
        let command = if hangs_up { jetlink(&args) } else { ignoring };
        let mut terminal = Terminal::start_as("xterm-256color", command);
        terminal.is_live();
        has_rows(&csv, 4);
        if hangs_up {
            signal(&terminal.child, "HUP");
        }
        terminal.close();
        assert_eq!(ended(&mut terminal.child).code(), Some(129), "{name}");
        files_are_complete(&csv, &plot, 4);
    }
}
