//! `cargo emu-run` from outside: what a wrong call says. Nothing is built here.

use std::process::{Command, Output};

fn emu(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_emu")).args(arguments).output().expect("it runs")
}

#[test]
fn a_wrong_call_says_why_in_its_last_line() {
    for (arguments, why) in [
        (&["run"][..], "Name the board."),
        (&["run", "matek"], "There is no board \"matek\"."),
        (&["run", "pixracer", "--image", "blue"], "There is no image \"blue\"."),
        (&["run", "pixracer", "--port", "1"], "There is no option \"--port\", or its value is missing."),
        (&["run", "pixracer", "--tcp"], "There is no option \"--tcp\", or its value is missing."),
    ] {
        let output = emu(arguments);
        let error = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(1), "{arguments:?}");
        assert_eq!(error.lines().last(), Some(why), "{arguments:?}");
    }
}

#[test]
fn help_is_no_failure() {
    for arguments in [&["run", "--help"][..], &["--help"], &["run", "pixracer", "-h"]] {
        let output = emu(arguments);
        assert_eq!(output.status.code(), Some(0), "{arguments:?}");
        let text = String::from_utf8(output.stdout).expect("UTF-8");
        assert!(text.starts_with("cargo emu ") && text.contains("5790"), "{text}");
    }
}
