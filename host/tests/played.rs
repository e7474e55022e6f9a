//! Script files of `jetlink rig`: a played run gives the same bytes on every wire whenever it is played again.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const PLAYED: &str = "\
jetlink rig script, version 0.1.0
seed 3
engine name=left,ecu=amt,engine=olympus,baud=115200
engine name=right,ecu=zk,version=5
# Left is started by hand while it is cold, and loses its line.
1.0 left arm
2.0 left standby
3.0 left start
33.0 left throttle 55.0
40.0 left cut
41.0 left mend
45.0 right noise
48.0 right quiet
50.0 all node-reset
55.0 all emergency-stop
58.0 left release
60.0 end
";

fn rig(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_jetlink")).arg("rig").args(args).output().expect("it runs")
}

fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder); // of an earlier test
    fs::create_dir_all(&folder).expect("a folder");
    folder
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("UTF-8")
}

/// The bytes of all lines, by the name of their file.
fn bytes(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = fs::read_dir(folder)
        .expect("a folder")
        .map(|entry| entry.expect("a file"))
        .map(|entry| (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap()))
        .collect();
    files.sort();
    files
}

#[test]
fn a_script_is_played_to_the_byte_at_any_speed() {
    let folder = folder("played-bytes");
    let (script, short) = (folder.join("run.txt"), folder.join("short.txt"));
    fs::write(&script, PLAYED).unwrap();
    let play = |script: &Path, name: &str, fast: bool| {
        let captured = folder.join(name);
        let args = ["--script", script.to_str().unwrap(), "--capture", captured.to_str().unwrap()];
        let output = rig(&[&args[..], if fast { &["--fast"] } else { &[] }].concat());
        let printed = text(&output.stdout);
        assert_eq!(output.status.code(), Some(0), "{printed}");
        (printed, bytes(&captured))
    };
    let (first, first_bytes) = play(&script, "first", true);
    let (second, second_bytes) = play(&script, "second", true);
    assert_eq!(first, second);
    assert!(first_bytes == second_bytes, "other bytes");
    let names: Vec<&str> = first_bytes.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["left-from-ecu.bin", "left-to-ecu.bin", "right-from-ecu.bin", "right-to-ecu.bin"]);
    assert!(first_bytes.iter().all(|(_, bytes)| bytes.len() > 1000));
    for what in ["played: cut", "ECU link lost", "emergency stop, from bench", "played: release"] {
        assert!(first.contains(what), "{what}: {first}");
    }
    let targets = first.lines().find(|line| line.contains("targets reached")).expect("a row");
    assert_eq!(targets.split_whitespace().skip(2).collect::<Vec<_>>(), ["played", "played"]);
    assert!(first.contains("PASS: no unsolicited command, no uncommanded ignition, no late stop"), "{first}");
    // Also in real time.
    fs::write(&short, PLAYED.split_once("33.0 left").unwrap().0.to_owned() + "5.0 end\n").unwrap();
    assert!(play(&short, "slow", false) == play(&short, "quick", true), "real time gives something else");
}

#[test]
fn what_is_saved_plays_the_same() {
    let folder = folder("played-saved");
    let (script, saved) = (folder.join("run.txt"), folder.join("saved.txt"));
    fs::write(&script, PLAYED).unwrap();
    let args = ["--fast", "--script", script.to_str().unwrap(), "--save-script", saved.to_str().unwrap()];
    let first = rig(&args);
    assert_eq!(first.status.code(), Some(0), "{}", text(&first.stdout));
    let without_comments: String =
        PLAYED.lines().filter(|line| !line.starts_with('#')).map(|line| format!("{line}\n")).collect();
    assert_eq!(fs::read_to_string(&saved).unwrap(), without_comments);
}

/// Of the same instant, in either order.
#[test]
fn an_emergency_stop_beside_a_reset_is_not_an_unsolicited_command() {
    let folder = folder("played-stop-and-reset");
    let script = folder.join("run.txt");
    let stop = "50.0 all node-reset\n50.0 all emergency-stop\n";
    let reset_first = PLAYED.replace("50.0 all node-reset\n55.0 all emergency-stop\n", stop);
    let stop_first = reset_first.replace(stop, "50.0 all emergency-stop\n50.0 all node-reset\n");
    for content in [reset_first, stop_first] {
        assert_ne!(content, PLAYED);
        fs::write(&script, &content).unwrap();
        let output = rig(&["--fast", "--script", script.to_str().unwrap()]);
        let printed = text(&output.stdout);
        assert!(output.status.success() && !printed.contains("FAILED"), "{printed}");
        assert!(printed.contains("EMERGENCY") || printed.contains("emergency stop"), "{printed}");
    }
}

#[test]
fn a_wrong_script_is_one_sentence_with_its_line() {
    let folder = folder("played-wrong");
    let script = folder.join("run.txt");
    for (content, part) in [
        (
            PLAYED.replace("left throttle 55.0", "left jump"),
            "line 9, `left jump`: `jump` is not a valid action",
        ),
        (PLAYED.replace("50.0 all node-reset", "1.0 all node-reset"), "line 14"),
        ("seed 1\n".to_owned(), "line 1 has to be"),
        (PLAYED.replace("ecu=zk", "ecu=jetcat"), "ecu=`jetcat` is not known"),
        (PLAYED.replace("seed 3", "seed 3\nseed 4"), "line 3, `seed 4`: `seed` is given twice"),
        (PLAYED.replace("seed 3", "standby\nstandby"), "line 3, `standby`: `standby` is given twice"),
        // Left is never given back to its script.
        (PLAYED.replace("60.0 end\n", ""), "left is played until the run ends: add `end`"),
    ] {
        fs::write(&script, content).unwrap();
        let output = rig(&["--fast", "--script", script.to_str().unwrap()]);
        let error = text(&output.stderr);
        assert_eq!((output.status.code(), text(&output.stdout)), (Some(2), String::new()), "{error}");
        assert!(error.contains(part) && error.lines().count() == 1, "{part}: {error}");
    }
    let output = rig(&["--fast", "--script", "/nonexistent"]);
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(rig(&["--script", "x", "--seed", "1"]).status.code(), Some(2));
}

#[test]
fn a_script_without_an_end_ends_when_all_engines_have_flown() {
    let script = folder("played-no-end").join("run.txt");
    let head = "jetlink rig script, version 0.1.0\nengine ecu=zk,version=5,baud=115200\n";
    // Faults do not take an engine from its script, and `script` gives it back.
    for actions in ["60.0 all noise\n61.0 all quiet\n", "1.0 all disarm\n2.0 all script\n"] {
        fs::write(&script, format!("{head}{actions}")).unwrap();
        let output = rig(&["--fast", "--script", script.to_str().unwrap()]);
        let printed = text(&output.stdout);
        assert_eq!(output.status.code(), Some(0), "{printed}{}", text(&output.stderr));
        assert!(printed.contains("Summary after 1") || printed.contains("Summary after 2"), "{printed}");
    }
}

#[test]
fn a_script_without_a_seed_has_that_of_the_command_line() {
    let script = folder("played-seed").join("run.txt");
    let run = |seed: &str| {
        fs::write(&script, format!("jetlink rig script, version 0.1.0\n{seed}faults heavy\nstandby\n"))
            .unwrap();
        text(&rig(&["--fast", "--script", script.to_str().unwrap()]).stdout)
    };
    let alone = text(&rig(&["--fast", "--standby", "--faults", "heavy"]).stdout);
    let (alone, _) = alone.split_once("Summary").expect("a summary");
    let without = run("");
    assert!(without.starts_with(alone), "{without}{alone}");
    assert!(!run("seed 0\n").starts_with(alone));
}

/// The node's event that standby is in force comes in the same moment as the stop, and is read after it.
#[test]
fn a_stop_in_the_first_second_is_not_an_unsolicited_command() {
    let script = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("early-stop.txt");
    for at in ["0.2", "0.4", "0.5", "0.6", "0.7", "0.8", "0.9", "1.2"] {
        let text = format!(
            "jetlink rig script, version 0.1.0\nstandby\nduration 5s\n{at} all emergency-stop\n3.0 end\n"
        );
        std::fs::write(&script, text).expect("a file");
        let args = ["rig", "--fast", "--script", script.to_str().expect("UTF-8")];
        let output =
            std::process::Command::new(env!("CARGO_BIN_EXE_jetlink")).args(args).output().expect("it runs");
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stdout));
    }
}
