//! `cargo emu-run` from outside: the messages for a wrong call. Nothing is built here.

use std::process::{Command, Output};

fn emu(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_emu")).args(arguments).output().expect("it runs")
}

#[test]
fn a_wrong_call_prints_the_reason_and_what_is_allowed() {
    for (arguments, why, allowed) in [
        (&["emu-run"][..], "<BOARD>", "cargo emu-run"),
        (&["emu-run", "matek"], "'matek'", "matek-h743, pixracer"),
        (&["emu-run", "pixracer", "--image", "blue"], "'blue'", "release, demo"),
        (&["emu-run", "pixracer", "--port", "1"], "'--port'", "cargo emu-run"),
        (&["emu-run", "pixracer", "--tcp"], "'--tcp <PORT>'", "--help"),
        (&["emu-run", "pixracer", "--tcp", "0"], "'--tcp <PORT>'", "1..=65535"),
    ] {
        let output = emu(arguments);
        let error = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(error.starts_with("error: ") && error.contains(why) && error.contains(allowed), "{error}");
    }
}

#[test]
fn help_exits_with_status_0() {
    for (arguments, text) in [
        (&["emu-run", "--help"][..], "5790"),
        (&["emu-run", "pixracer", "-h"], "nucleo-h743zi2"),
        (&["--help"], "emu-compare"),
    ] {
        let output = emu(arguments);
        assert_eq!(output.status.code(), Some(0), "{arguments:?}");
        let help = String::from_utf8(output.stdout).expect("UTF-8");
        assert!(help.contains(text) && help.contains("Usage: cargo"), "{help}");
    }
}
