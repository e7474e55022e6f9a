//! `jetlink rig` as a process: in real time on a busy computer, and ended before its time.
#![cfg(unix)]

mod busy;
mod ending;

use std::path::PathBuf;
use std::process::{Child, Command};

fn file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name)
}

fn signal(child: &Child, name: &str) {
    let status = Command::new("kill").arg(format!("-{name}")).arg(child.id().to_string()).status();
    assert!(status.expect("kill").success(), "kill -{name}");
}
