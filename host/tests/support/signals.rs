//! The signals of a program that a test starts.

use std::process::Command;

/// A program with the signals that a terminal's shell would give it: whoever runs the tests may ignore some, as `nohup` does and a
/// shell for what it starts in the background.
pub fn with_default_signals(program: &str) -> Command {
    let defaults = ["--default-signal=HUP,INT,TERM"];
    let can_reset =
        Command::new("env").args(defaults).arg("true").output().is_ok_and(|run| run.status.success());
    if can_reset {
        let mut command = Command::new("env");
        command.args(defaults).arg(program);
        command
    } else {
        Command::new(program)
    }
}
