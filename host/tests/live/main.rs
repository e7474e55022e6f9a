//! `jetlink rig` as a process: in real time on a busy computer, on a terminal, and ended before its time.
#![cfg(unix)]

mod busy;
mod ending;
#[path = "../support/frame.rs"]
mod frame;
mod mavlink;
#[path = "../support/port.rs"]
mod port;
#[path = "../support/process.rs"]
mod process;
#[path = "../support/signals.rs"]
mod signals;
mod terminal;
#[path = "../support/wait.rs"]
mod wait;

use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus};
use std::time::Duration;

/// Longest time that anything here may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(20);

fn file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name)
}

fn signal(child: &Child, name: &str) {
    let status = Command::new("kill").arg(format!("-{name}")).arg(child.id().to_string()).status();
    assert!(status.expect("kill").success(), "kill -{name}");
}

fn jetlink(args: &[&str]) -> Command {
    let mut command = signals::with_default_signals(env!("CARGO_BIN_EXE_jetlink"));
    command.arg("rig").args(args).env("TERM", "xterm-256color").env("RUST_BACKTRACE", "0");
    command
}

#[track_caller]
fn wait_until(what: &str, done: impl FnMut() -> bool) {
    wait::wait_until(what, PATIENCE, done);
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
