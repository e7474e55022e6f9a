//! `cargo image` from outside, with a `cargo` that only writes down how it was called.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder of its own, empty, with a `cargo` in `bin` that fails and leaves its folder and arguments in `called`.
fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder); // of an earlier test
    fs::create_dir_all(folder.join("bin")).expect("a folder");
    let cargo = folder.join("bin/cargo");
    let script =
        format!("#!/bin/sh\necho \"$(pwd -P) $*\" > '{}'\nexit 1\n", folder.join("called").display());
    fs::write(&cargo, script).expect("a script");
    fs::set_permissions(&cargo, fs::Permissions::from_mode(0o755)).expect("a script");
    folder
}

fn image(folder: &Path, out: &str) -> Output {
    let path = format!("{}:{}", folder.join("bin").display(), std::env::var("PATH").expect("a path"));
    Command::new(env!("CARGO_BIN_EXE_image"))
        .args(["matek-h743", "--out", out])
        .current_dir(folder)
        .env("PATH", path)
        .output()
        .expect("it runs")
}

#[test]
fn a_folder_that_takes_no_file_is_reported_before_the_build() {
    let folder = folder("image-out");
    let output = image(&folder, "/dev/null/images");
    assert_eq!(output.status.code(), Some(1));
    let error = String::from_utf8(output.stderr).expect("UTF-8");
    assert!(error.starts_with("cannot write into /dev/null/images: "), "{error}");
    assert!(!folder.join("called").exists(), "the build began");
}

#[test]
fn the_firmware_is_built_in_the_repository_wherever_the_program_is_called() {
    let folder = folder("image-elsewhere");
    let output = image(&folder, "images");
    assert_eq!(output.status.code(), Some(1), "the build fails");
    let called = fs::read_to_string(folder.join("called")).expect("cargo was called");
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().expect("the repository");
    let expected =
        format!("{} fw board-matek-h743 --message-format json-render-diagnostics\n", root.display());
    assert_eq!(called, expected);
    let error = String::from_utf8(output.stderr).expect("UTF-8");
    assert!(error.starts_with("building the firmware for the Matek"), "{error}");
    assert!(folder.join("images").is_dir(), "the folder is where the program was called");
}
