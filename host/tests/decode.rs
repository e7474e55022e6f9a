//! `jetlink decode` from outside: the built program against golden files and its interface.
//!
//! A golden file is three files: `NAME.hex` (the input as annotated hex; `#` starts a comment), `NAME.args`
//! (the arguments) and `NAME.jsonl` (standard output, to the letter). They are written by hand from the
//! protocol documents, not by the program.

#[path = "support/signals.rs"]
mod signals;

use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

const ZK_EXAMPLE: [u8; 7] = [0xF1, 0x00, 0x00, 0x00, 0x00, 0x4C, 0xA0];
const AMT_NORMAL: [u8; 6] = [0xFF, 0x64, 0x84, 0x7B, 0x65, 0x99];

// ---------------------------------------------------------------------------------------------
// Running the program
// ---------------------------------------------------------------------------------------------

#[derive(Debug)]
struct Outcome {
    status: i32,
    stdout: String,
    stderr: String,
}

fn spawn(args: &[&str]) -> Child {
    signals::with_default_signals(env!("CARGO_BIN_EXE_jetlink"))
        .arg("decode")
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Runs it with standard input in pieces of this size.
fn decode_in_pieces(args: &[&str], input: &[u8], piece: usize) -> Outcome {
    let mut child = spawn(args);
    let mut stdin = child.stdin.take().unwrap();
    let input = input.to_vec();
    // A program that refuses its arguments does not read: a failed write does not matter.
    let writer = thread::spawn(move || input.chunks(piece).try_for_each(|piece| stdin.write_all(piece)));
    let output = child.wait_with_output().unwrap();
    let _ = writer.join().unwrap();
    Outcome {
        status: output.status.code().expect("it ended by a signal"),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

fn decode(args: &[&str], input: &[u8]) -> Outcome {
    decode_in_pieces(args, input, usize::MAX)
}

fn objects(outcome: &Outcome) -> Vec<Value> {
    assert_eq!(outcome.status, 0, "{outcome:?}");
    outcome.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn temporary(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
}

// ---------------------------------------------------------------------------------------------
// Golden files
// ---------------------------------------------------------------------------------------------

#[derive(Debug)]
struct Golden {
    name: String,
    args: Vec<String>,
    input: Vec<u8>,
    expected: String,
}

impl Golden {
    fn args(&self) -> Vec<&str> {
        self.args.iter().map(String::as_str).collect()
    }
}

fn golden_files() -> Vec<Golden> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    let mut names = std::collections::BTreeSet::new();
    for entry in fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        let kind = path.extension().and_then(|kind| kind.to_str());
        if matches!(kind, Some("hex" | "args" | "jsonl")) {
            names.insert(path.file_stem().unwrap().to_str().unwrap().to_owned());
        }
    }
    assert!(names.iter().any(|name| name.starts_with("zk-")), "no golden file for ZK in {folder:?}");
    assert!(names.iter().any(|name| name.starts_with("amt-")), "no golden file for AMT in {folder:?}");
    let read = |name: &str, kind| {
        let path = folder.join(format!("{name}.{kind}"));
        fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path:?}: {error}"))
    };
    names
        .into_iter()
        .map(|name| Golden {
            args: read(&name, "args").split_whitespace().map(str::to_owned).collect(),
            input: annotated_hex(&name, &read(&name, "hex")),
            expected: read(&name, "jsonl"),
            name,
        })
        .collect()
}

fn annotated_hex(name: &str, text: &str) -> Vec<u8> {
    let digits: Vec<u8> = text
        .lines()
        .flat_map(|line| line.split('#').next().unwrap_or_default().chars())
        .filter(|char| !char.is_whitespace())
        .map(|char| char.to_digit(16).unwrap_or_else(|| panic!("{name}.hex: {char:?} is no hex digit")) as u8)
        .collect();
    assert!(digits.len().is_multiple_of(2), "{name}.hex: half a byte");
    digits.chunks(2).map(|pair| pair[0] << 4 | pair[1]).collect()
}

/// Same values, numbers as numbers: `51` is `51.0`.
fn same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => a.as_f64() == b.as_f64(),
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b)),
        (Value::Object(a), Value::Object(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|((ka, va), (kb, vb))| ka == kb && same(va, vb))
        }
        _ => a == b,
    }
}

fn compare(golden: &Golden, outcome: &Outcome) {
    let name = &golden.name;
    assert_eq!(outcome.status, 0, "{name}: {outcome:?}");
    // First as values, to distinguish a wrong value from a wrong format.
    for (i, (found, expected)) in outcome.stdout.lines().zip(golden.expected.lines()).enumerate() {
        let parse =
            |line| -> Value { serde_json::from_str(line).unwrap_or_else(|e| panic!("{name}: {e}: {line}")) };
        assert!(
            same(&parse(found), &parse(expected)),
            "{name}.jsonl line {}:\n   found {found}\nexpected {expected}",
            i + 1
        );
    }
    assert_eq!(outcome.stdout, golden.expected, "{name}: same values, other text, or more or fewer lines");
}

#[test]
fn golden_files_from_standard_input() {
    for golden in golden_files() {
        compare(&golden, &decode(&golden.args(), &golden.input));
    }
}

#[test]
fn golden_files_from_a_file_and_from_a_dash() {
    for golden in golden_files() {
        let path = temporary(&format!("{}.bin", golden.name));
        fs::write(&path, &golden.input).unwrap();
        let mut args = golden.args();
        args.push(path.to_str().unwrap());
        compare(&golden, &decode(&args, &[]));
        *args.last_mut().unwrap() = "-";
        compare(&golden, &decode(&args, &golden.input));
    }
}

#[test]
fn golden_files_one_byte_at_a_time_and_in_odd_pieces() {
    for golden in golden_files() {
        for piece in [1, 5, 11] {
            let outcome = decode_in_pieces(&golden.args(), &golden.input, piece);
            compare(&golden, &outcome);
            assert_eq!(outcome.stderr, decode(&golden.args(), &golden.input).stderr, "{}", golden.name);
        }
    }
}

/// The golden files must also agree with themselves: every frame's bytes are at its offset.
#[test]
fn golden_files_hold_what_they_print() {
    for Golden { name, input, expected, .. } in golden_files() {
        for line in expected.lines() {
            let object: Value = serde_json::from_str(line).unwrap();
            let offset = object["offset"].as_u64().unwrap() as usize;
            let raw = annotated_hex(&name, object["raw"].as_str().unwrap());
            assert_eq!(input.get(offset..offset + raw.len()), Some(&*raw), "{name}: {line}");
        }
    }
}

// ---------------------------------------------------------------------------------------------
// Every raw value that a field can have
// ---------------------------------------------------------------------------------------------

/// An integer in units of the last of its decimal places, as a number of the output: text in, text out.
fn decimal(units: i64, places: usize) -> String {
    let digits = format!("{:0>width$}", units.unsigned_abs(), width = places + 1);
    let (whole, rest) = digits.split_at(digits.len() - places);
    let rest = rest.trim_end_matches('0');
    let point = if rest.is_empty() { "" } else { "." };
    format!("{}{whole}{point}{rest}", if units < 0 { "-" } else { "" })
}

fn zk_status(id: u8, bytes: [u8; 3]) -> [u8; 7] {
    let [a, b, c] = bytes;
    let body = [0xF0 | id, 0, 0, a, b, c];
    let crc = jetlink::ecu::zk::codec::crc8(&body);
    [body[0], 0, 0, a, b, c, crc]
}

/// Decodes these frames, each of which ends in one of these texts.
fn ends_of(args: &[&str], frames: &[(Vec<u8>, String)]) {
    let input: Vec<u8> = frames.iter().flat_map(|(bytes, _)| bytes.clone()).collect();
    let outcome = decode(args, &input);
    assert_eq!(outcome.stdout.lines().count(), frames.len(), "{args:?}");
    for (line, (bytes, end)) in outcome.stdout.lines().zip(frames) {
        assert!(line.ends_with(&format!("{end}}}")), "{args:?}, {bytes:02x?}: {line}, and not {end}");
    }
}

/// ZK-5, ZK-6: the scales as the document gives them, in integers.
#[test]
fn each_raw_value_of_zk_is_printed_exactly() {
    let mut frames = Vec::new();
    let mut add = |id, bytes, end: String| frames.push((zk_status(id, bytes).to_vec(), end));
    for raw in 0..=2047_u16 {
        let [high, low] = raw.to_be_bytes();
        add(1, [0, high << 2, low], format!(r#""egt_c":{}"#, i64::from(raw) - 50));
    }
    for raw in 0..=u16::MAX {
        let [low, high] = raw.to_le_bytes();
        add(3, [low, low, high], format!(r#""throttle_pct":{low},"pressure_pa":{}"#, u32::from(raw) * 2));
    }
    // Nine bits of 0.1 A, fifteen of 0.1 kg.
    for raw in 0..=0x7FFF_u16 {
        let ([high, low], current) = (raw.to_be_bytes(), raw & 0x1FF);
        let [carry, amps] = current.to_be_bytes();
        let current = decimal(current.into(), 1);
        let end = format!(r#""current_a":{current},"thrust_kg":{}"#, decimal(raw.into(), 1));
        add(4, [amps, high << 1 | carry, low], end);
    }
    for raw in 0..=255_u8 {
        let pump = decimal(i64::from(raw) * 2, 2);
        let end = format!(r#""ignition_pump_v":{pump},"curve_increase":{raw},"curve_decrease":{raw}"#);
        add(5, [raw, raw, raw], end);
        add(9, [raw, 0, 0], format!(r#""ecu_c":{}"#, i64::from(raw) - 50));
    }
    // Ten bits of 0.01 L/min, fourteen of 0.1 L.
    for raw in 0..=0x3FFF_u16 {
        let flow = raw & 0x3FF;
        let [flow_high, flow_low] = flow.to_be_bytes();
        let (flow, total) = (decimal(flow.into(), 2), decimal(raw.into(), 1));
        let bytes = [flow_low, (raw << 2) as u8 | flow_high, (raw >> 6) as u8];
        add(7, bytes, format!(r#""flow_l_min":{flow},"fuel_l":{total}"#));
    }
    for raw in 0..=0xFFF_u16 {
        let ([high, low], startup) = (raw.to_be_bytes(), decimal(raw.into(), 1));
        let end = format!(r#""pressure_requested":false,"closed_loop":false,"startup_s":{startup}"#);
        add(8, [0, high, low], end);
    }
    ends_of(&["--protocol", "zk"], &frames);

    // The version of a status-6 holds for the frame itself and for those after it.
    for (version, tenths) in [(0_u8, 1), (3, 1), (4, 2), (63, 2)] {
        let frames: Vec<_> = (0..=255_u8)
            .flat_map(|raw| {
                let volts = decimal(i64::from(raw) * tenths, 1);
                let max = format!(r#""max_pump_v":{volts},"protocol_version":{version},"rate_hz":20"#);
                let three = format!(r#""radio_v":{volts},"power_v":{volts},"pump_v":{volts}"#);
                [(6, [0, raw, version << 2], max), (2, [raw; 3], three)]
            })
            .map(|(id, bytes, end)| (zk_status(id, bytes).to_vec(), end))
            .collect();
        ends_of(&["--protocol", "zk"], &frames);
    }
}

/// AMT-6: offset in V and V at a raw 255, of Vout, the battery and the external battery.
type AmtScales = [Option<(f64, f64)>; 3];

/// AMT-6, AMT-7: the scales as the document gives them. A voltage is its formula in 64-bit numbers.
#[test]
fn each_raw_value_of_amt_is_printed_as_the_formula_gives_it() {
    let small: AmtScales = [Some((0.0, 6.25)), Some((0.0, 10.0)), Some((7.0, 6.25))];
    let large: AmtScales = [Some((0.0, 8.30)), Some((0.0, 10.0)), Some((7.0, 9.30))];
    for (engine, id, scales) in [
        ("mercury", 0x08, small),
        ("pegasus", 0x10, small),
        ("olympus", 0x18, large),
        ("titan", 0x20, large),
        ("nike", 0x28, [large[0], None, large[2]]),
        ("lynx", 0x30, [None; 3]),
        ("orion", 0x38, [None; 3]),
    ] {
        let volts = |raw: u8, scale: Option<(f64, f64)>| {
            let Some((offset, full)) = scale else { return "null".to_owned() };
            let volts = offset + f64::from(raw) * full / 255.0;
            // In units of 1/255 mV, which holds each exactly.
            let exact = (offset * 1000.0) as u32 * 255 + u32::from(raw) * (full * 1000.0).round() as u32;
            assert!((volts - f64::from(exact) / 255_000.0).abs() < 4e-15, "{engine}, {raw}: {volts}");
            volts.to_string()
        };
        let [vout, battery, external] = scales;
        let frames: Vec<_> = (0..=254_u8)
            .flat_map(|raw| {
                let egt = decimal(i64::from(raw) * 46 - 500, 1);
                let throttle = decimal(i64::from(raw) * 5, 1);
                let rest =
                    format!(r#""egt_c":{egt},"throttle_pct":{throttle},"vout_v":{}"#, volts(raw, vout));
                let [vout, battery, external] = [vout, battery, external].map(|scale| volts(raw, scale));
                let four = format!(
                    r#""engine":"{engine}","idle_v":{vout},"max_v":{vout},"battery_v":{battery},"external_v":{external}"#
                );
                [
                    (vec![0xFF, id, raw, raw, raw, raw], four),
                    (vec![0xFF, 0x64, raw, raw, raw, raw], rest.clone()),
                    (vec![0xFF, 0x00, raw, raw, raw, raw], rest),
                ]
            })
            .collect();
        ends_of(&["--protocol", "amt"], &frames);
    }
}

// ---------------------------------------------------------------------------------------------
// Interface
// ---------------------------------------------------------------------------------------------

#[test]
fn the_first_example_of_the_interface_is_printed() {
    let outcome = decode(&["--protocol", "zk"], &ZK_EXAMPLE);
    assert_eq!(
        outcome.stdout,
        concat!(
            r#"{"offset":0,"protocol":"zk","frame":"status-1","raw":"f1000000004ca0","rpm":0,"state_code":0,"#,
            r#""state":"stop","error_code":0,"error":"none","switch_code":0,"switch":"stop","egt_c":26}"#,
            "\n"
        )
    );
    assert_eq!(outcome.status, 0);
}

#[test]
fn the_second_example_of_the_interface_is_printed() {
    let outcome = decode(&["--protocol", "zk"], &[0xF6, 0x00, 0x00, 0xA0, 0x00, 0x10, 0xAB]);
    assert_eq!(
        outcome.stdout,
        concat!(
            r#"{"offset":0,"protocol":"zk","frame":"status-6","raw":"f60000a00010ab","rpm":0,"#,
            r#""max_rpm":160000,"max_pump_v":0,"protocol_version":4,"rate_hz":20}"#,
            "\n"
        )
    );
    assert_eq!(outcome.status, 0);
}

fn setup(text: &[u8]) -> Vec<u8> {
    [&[0xFF, 0x05, 0xF7, 0xE8, 0x3E], text].concat()
}

/// A version without an engine gives no engine, so a hint and an earlier frame still hold.
#[test]
fn a_set_up_set_with_an_unnumbered_version_names_no_engine() {
    let input = [&setup(b"15.35 140617 "), &AMT_NORMAL[..]].concat();
    let found = objects(&decode(&["--protocol", "amt", "--engine", "olympus"], &input));
    assert_eq!(found[0]["engine"], Value::Null);
    assert_eq!((&found[1]["engine"], &found[1]["rpm"]), (&"olympus".into(), &66_000.into()));

    let found = objects(&decode(&["--protocol", "amt"], &input));
    assert_eq!((&found[1]["engine"], &found[1]["rpm"]), (&Value::Null, &Value::Null));

    let input = [&[0xFF, 0x08, 1, 2, 3, 4][..], &input].concat();
    let found = objects(&decode(&["--protocol", "amt"], &input));
    assert_eq!((&found[2]["engine"], &found[2]["rpm"]), (&"mercury".into(), &92_400.into()));
}

/// The text of a set-up set is not checked by anything on the wire: the output stays JSON whatever it holds.
#[test]
fn a_set_up_set_with_any_text_is_printed_as_json() {
    let found = objects(&decode(&["--protocol", "amt"], &setup(b"\".3\n 14\\\x00\x1F7 ")));
    assert_eq!(found[0]["version"], "\".3\n");
    assert_eq!(found[0]["date"], "14\\\0\u{1F}7");
    assert_eq!(found[0]["engine"], Value::Null);

    let found = objects(&decode(&["--protocol", "amt"], &setup(b"9.\xB15 140617 ")));
    assert_eq!(found[0]["version"], Value::Null);
    assert_eq!(found[0]["date"], "140617");
    assert_eq!(found[0]["raw"], "ff05f7e83e392eb13520313430363137".to_owned() + "20");
}

/// The captures of the documentation, made by the rig.
#[test]
fn the_captures_of_the_documentation_hold_frames_and_nothing_else() {
    for (protocol, name) in [("amt", "amt-simulated.bin"), ("zk", "zk-simulated.bin")] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/captures").join(name);
        let found = decode(&["--protocol", protocol, path.to_str().unwrap()], &[]);
        assert_eq!(found.status, 0);
        assert!(found.stderr.contains("\n0 bytes skipped\n"), "{}", found.stderr);
        let running = if protocol == "amt" { "full-operation" } else { "running" };
        assert!(objects(&found).iter().any(|object| object["state"] == running), "{name}");
    }
}

/// Status and standard output stay the same; the last line of standard error states what the other protocol would find.
#[test]
fn the_wrong_protocol_is_hinted_at() {
    let zk = ZK_EXAMPLE.repeat(20);
    let outcome = decode(&["--protocol", "amt"], &zk);
    assert_eq!((outcome.status, outcome.stdout.as_str()), (0, ""));
    assert_eq!(
        outcome.stderr.lines().last(),
        Some(
            "hint: 100 % of the bytes are in no amt frame; --protocol zk would find 20 frames and leave 0 %"
        )
    );
    let amt = AMT_NORMAL.repeat(20);
    assert_eq!(
        decode(&["--protocol", "zk"], &amt).stderr.lines().last(),
        Some(
            "hint: 100 % of the bytes are in no zk frame; --protocol amt would find 20 frames and leave 0 %"
        )
    );
    // A share below 100 % is not printed as 100 %.
    let almost = [&zk[..], &AMT_NORMAL[..]].concat().repeat(20);
    let outcome = decode(&["--protocol", "amt"], &almost);
    let hint = outcome.stderr.lines().last().unwrap();
    let share = hint.strip_prefix("hint: ").and_then(|hint| hint.split_once(" %")).unwrap().0;
    let share: f64 = share.parse().unwrap();
    assert!(share > 50.0 && share < 100.0, "{hint}");
    // Neither: something else is wrong.
    let garbage: Vec<u8> = (0..200_u32).map(|i| (i * 37 % 251) as u8).collect();
    let outcome = decode(&["--protocol", "zk"], &garbage);
    let hint = outcome.stderr.lines().last().unwrap();
    assert_eq!(
        hint,
        "hint: 100 % of the bytes are in no zk frame, nor in one of amt: check the baud rate, the stop bits and the levels of \
         the line"
    );
    // One frame is singular.
    let outcome = decode(&["--protocol", "amt"], &ZK_EXAMPLE);
    assert!(outcome.stderr.contains("would find 1 frame and leave 0 %"), "{}", outcome.stderr);
    // Half of the bytes is not over half, and no bytes give no hint.
    for input in [[&ZK_EXAMPLE[..], &[0; 7]].concat(), Vec::new(), zk] {
        let outcome = decode(&["--protocol", "zk"], &input);
        assert!(!outcome.stderr.contains("hint"), "{outcome:?}");
    }
    // Nor is the beginning of a frame of the other one, which finds nothing.
    let outcome = decode(&["--protocol", "amt"], &ZK_EXAMPLE[..3]);
    assert!(!outcome.stderr.contains("hint"), "{outcome:?}");
}

/// The most that may be the beginning of an AMT frame, and as many bytes that belong to none.
#[test]
fn the_documentation_has_the_bytes_that_a_hint_needs() {
    let enough = 2 * (jetlink::ecu::amt::codec::MAX_FRAME_LEN - 1) + 1;
    let page = include_str!("../../docs/decode.md");
    assert!(page.contains(&format!("fewer than {enough} bytes")), "{enough}");
    let beginning = b"\xff\x05\xf7\xe8>10.36 150203";
    for (bytes, hinted) in [(enough - 1, false), (enough, true)] {
        let input = [&vec![0; bytes - beginning.len()][..], beginning].concat();
        let outcome = decode(&["--protocol", "zk"], &input);
        assert_eq!(outcome.stderr.contains("hint: "), hinted, "{bytes}: {outcome:?}");
    }
}

/// Ctrl-C ends both sides of `cat /dev/ttyUSB0 | jetlink decode`: what was read is still summed up.
#[test]
#[cfg(unix)]
fn an_interrupt_reads_the_pipe_to_its_end_and_a_second_one_ends_at_once() {
    use std::os::unix::process::ExitStatusExt;
    let interrupt = |child: &Child| {
        let status = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
        assert!(status.expect("kill").success());
    };
    let one_line = |child: &mut Child| {
        let mut line = String::new();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        stdout.read_line(&mut line).unwrap();
        assert!(line.contains("status-1"), "{line}");
        stdout
    };
    let mut child = spawn(&["--protocol", "zk"]);
    let mut stdin = child.stdin.take().unwrap();
    stdin.write_all(&ZK_EXAMPLE).unwrap();
    let mut stdout = one_line(&mut child);
    interrupt(&child);
    stdin.write_all(&ZK_EXAMPLE.repeat(2)).unwrap();
    drop(stdin);
    let mut rest = String::new();
    stdout.read_to_string(&mut rest).unwrap();
    let output = child.wait_with_output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!((output.status.code(), rest.lines().count()), (Some(0), 2), "{error}");
    assert!(error.contains("21 bytes read\n3 frames\n"), "{error}");

    let mut child = spawn(&["--protocol", "zk"]);
    let mut stdin = child.stdin.take().unwrap();
    stdin.write_all(&ZK_EXAMPLE).unwrap();
    let mut stdout = one_line(&mut child);
    interrupt(&child);
    // The first one has been taken when it still reads.
    stdin.write_all(&ZK_EXAMPLE).unwrap();
    stdout.read_line(&mut String::new()).unwrap();
    interrupt(&child);
    let status = child.wait().unwrap();
    assert_eq!(status.signal(), Some(2), "{status}");
}

/// A capture of the rig has a file for each direction, and anyone may tap the wrong wire.
#[test]
fn commands_to_an_ecu_are_hinted_at() {
    let hint = |args: &[&str], input: &[u8]| {
        let outcome = decode(args, input);
        assert_eq!((outcome.status, outcome.stdout.lines().count()), (0, 0), "{outcome:?}");
        outcome.stderr.lines().last().unwrap().to_owned()
    };
    let amt = [0xFF, 0x12, 0x20, 0x12, 0x20].repeat(20);
    // ID 1 with standby and the throttle at idle.
    let zk = [0xFF, 0x12, 0x00, sim::zk::crc8(&[0x12, 0x00])].repeat(20);
    for protocol in ["amt", "zk"] {
        for (name, input) in [("amt", &amt), ("zk", &zk)] {
            let hint = hint(&["--protocol", protocol], input);
            let end = format!(
                " % of the bytes are in no {protocol} frame; 20 commands to an ECU ({name}) have 100 %: decode reads the other line, \
                 from the ECU"
            );
            assert!(hint.starts_with("hint: ") && hint.ends_with(&end), "{hint}");
        }
    }
    // A few of them among other bytes do not make it that line.
    let few = [&amt[..20], &[0x55; 200]].concat();
    assert!(hint(&["--protocol", "zk"], &few).ends_with("the levels of the line"));
}

#[test]
fn summary_counts_what_zk_lost() {
    let mut broken = ZK_EXAMPLE;
    broken[5] ^= 1;
    let unknown = [0xFA, 0x01, 0x00, 0x00, 0x00, 0x00];
    let unknown = [&unknown[..], &[jetlink::ecu::zk::codec::crc8(&unknown)]].concat();
    let input = [&[0x00, 0x12][..], &ZK_EXAMPLE, &broken, &unknown, &ZK_EXAMPLE, &ZK_EXAMPLE[..4]].concat();
    let outcome = decode(&["--protocol", "zk"], &input);
    assert_eq!(
        outcome.stderr,
        "34 bytes read\n\
         3 frames\n  \
           2 status-1\n  \
           1 unknown-10\n\
         1 unknown frames\n\
         1 CRC failures\n\
         9 bytes skipped\n\
         4 bytes pending at the end\n"
    );
    let found = objects(&outcome);
    assert_eq!(found.len(), 3);
    assert_eq!((&found[1]["frame"], &found[1]["rpm"]), (&"unknown-10".into(), &10.into()));
}

#[test]
fn summary_counts_what_amt_lost() {
    let unknown = [0xFF, 0x0D, 1, 2, 3, 4];
    let malformed = setup(b"100.35");
    let input =
        [&[0x11][..], &AMT_NORMAL, &AMT_NORMAL[..4], &unknown, &malformed, &AMT_NORMAL, &AMT_NORMAL[..5]]
            .concat();
    let outcome = decode(&["--protocol", "amt"], &input);
    // The malformed set-up set is dropped at its third byte of text, and the rest of it skipped.
    assert_eq!(
        outcome.stderr,
        "39 bytes read\n\
         3 frames\n  \
           2 normal\n  \
           1 unknown\n\
         1 unknown frames\n\
         1 truncated frames\n\
         1 malformed set-up sets\n\
         16 bytes skipped\n\
         5 bytes pending at the end\n"
    );
    assert_eq!(objects(&outcome).len(), 3);
}

#[test]
fn an_empty_input_is_read_to_its_end() {
    for protocol in ["amt", "zk"] {
        let outcome = decode(&["--protocol", protocol], &[]);
        assert_eq!((outcome.status, outcome.stdout.as_str()), (0, ""));
        assert!(outcome.stderr.starts_with("0 bytes read\n0 frames\n"), "{}", outcome.stderr);
    }
}

#[test]
fn bad_arguments_end_with_2() {
    for (args, reported) in [
        (&["--protocol", "amt", "--engine", "saturn"][..], "saturn"),
        (&["--protocol", "amt", "--engine", "Olympus"], "Olympus"),
        (&["--protocol", "amt", "--engine"], "--engine"),
        (&["--protocol", "zk", "--engine", "olympus"], "--engine is only for --protocol amt"),
        (&["--protocol", "zk", "--zk-version", "64"], "64"),
        (&["--protocol", "zk", "--zk-version", "300"], "300"),
        (&["--protocol", "zk", "--zk-version=-1"], "-1"),
        (&["--protocol", "zk", "--zk-version", "four"], "four"),
        (&["--protocol", "zk", "--zk-version", ""], "--zk-version"),
        (&["--protocol", "amt", "--zk-version", "4"], "--zk-version is only for --protocol zk"),
        (&["--protocol", "amt", "--zk-version", "4", "--engine", "titan"], "--zk-version is only"),
        (&["--protocol", "mavlink"], "mavlink"),
        (&["--protocol"], "--protocol"),
        (&[], "--protocol"),
        (&["--protocol", "zk", "one", "two"], "two"),
        (&["--protocol", "zk", "--follow"], "--follow"),
    ] {
        let outcome = decode(args, &ZK_EXAMPLE);
        assert_eq!(outcome.status, 2, "{args:?}: {outcome:?}");
        assert_eq!(outcome.stdout, "", "{args:?}");
        assert!(
            outcome.stderr.starts_with("error: ") && outcome.stderr.contains(reported),
            "{args:?}: {outcome:?}"
        );
    }
}

/// Bad arguments are reported before the input is touched.
#[test]
fn bad_arguments_go_before_a_missing_file() {
    assert_eq!(decode(&["--protocol", "zk", "--engine", "nike", "no-such-file"], &[]).status, 2);
}

#[test]
fn good_hints_are_taken() {
    for engine in ["mercury", "pegasus", "olympus", "titan", "nike", "lynx", "orion"] {
        let found = objects(&decode(&["--protocol", "amt", "--engine", engine], &AMT_NORMAL));
        assert_eq!(found[0]["engine"], engine);
    }
    for version in ["0", "63"] {
        assert_eq!(decode(&["--protocol", "zk", "--zk-version", version], &ZK_EXAMPLE).status, 0);
    }
}

#[test]
fn an_input_that_cannot_be_read_ends_with_1() {
    let missing = temporary("there-is-no-such-file");
    // A folder opens, but does not read.
    for path in [missing.as_path(), Path::new(env!("CARGO_TARGET_TMPDIR"))] {
        let path = path.to_str().unwrap();
        let outcome = decode(&["--protocol", "zk", path], &[]);
        assert_eq!((outcome.status, outcome.stdout.as_str()), (1, ""), "{outcome:?}");
        assert!(outcome.stderr.starts_with(&format!("error: cannot read {path}: ")), "{}", outcome.stderr);
        assert_eq!(outcome.stderr.lines().count(), 1, "{}", outcome.stderr);
    }
}

#[test]
fn help_lists_every_frame_and_option() {
    let outcome = decode(&["--help"], &[]);
    assert_eq!(outcome.status, 0);
    for word in
        ["--protocol", "--engine", "--zk-version", "FILE", "offset", "status-9", "alternate", "null", "Exit"]
    {
        assert!(outcome.stdout.contains(word), "{word} is not in\n{}", outcome.stdout);
    }
}

// ---------------------------------------------------------------------------------------------
// Pipes and long inputs
// ---------------------------------------------------------------------------------------------

#[test]
fn a_reader_who_leaves_is_not_a_failure() {
    let mut child = spawn(&["--protocol", "zk"]);
    let mut stdin = child.stdin.take().unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    stdin.write_all(&ZK_EXAMPLE.repeat(1000)).unwrap();
    let mut line = String::new();
    stdout.read_line(&mut line).unwrap();
    drop(stdout);
    // It exits at its next write, so ours fails sooner or later.
    for _ in 0..100 {
        if stdin.write_all(&ZK_EXAMPLE.repeat(1000)).is_err() {
            break;
        }
    }
    drop(stdin);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(output.stderr, b"");
}

/// A frame of a live line is printed when it has come, not when a buffer is full.
#[test]
fn a_live_line_is_printed_at_once() {
    let mut child = spawn(&["--protocol", "zk"]);
    let mut stdin = child.stdin.take().unwrap();
    let mut stdout = BufReader::new(child.stdout.take().unwrap());
    let (sender, lines) = mpsc::channel();
    let reader = thread::spawn(move || {
        let mut line = String::new();
        while stdout.read_line(&mut line).is_ok_and(|count| count > 0) {
            let _ = sender.send(std::mem::take(&mut line));
        }
    });
    for _ in 0..3 {
        stdin.write_all(&ZK_EXAMPLE).unwrap();
        let line =
            lines.recv_timeout(Duration::from_secs(20)).expect("nothing came while the input was open");
        assert!(line.ends_with("}\n"), "{line:?}");
    }
    drop(stdin);
    reader.join().unwrap();
    assert!(child.wait().unwrap().success());
}

/// Streams this many bytes through, and returns the number of lines and the peak resident memory.
#[cfg(target_os = "linux")]
fn stream(args: &[&str], piece: &[u8], bytes: usize) -> (usize, usize) {
    let mut child = spawn(args);
    let mut stdin = child.stdin.take().unwrap();
    let mut stdout = child.stdout.take().unwrap();
    let reader = thread::spawn(move || {
        let mut buffer = vec![0; 1 << 16];
        let mut lines = 0;
        loop {
            match stdout.read(&mut buffer).unwrap() {
                0 => break lines,
                count => lines += buffer[..count].iter().filter(|&&byte| byte == b'\n').count(),
            }
        }
    });
    for _ in 0..bytes / piece.len() {
        stdin.write_all(piece).unwrap();
    }
    // Its input is still open, so it is still there.
    let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap();
    drop(stdin);
    let lines = reader.join().unwrap();
    assert!(child.wait().unwrap().success());
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    (lines, peak.split_whitespace().next().unwrap().parse().unwrap())
}

#[cfg(target_os = "linux")]
#[test]
fn memory_does_not_grow_with_the_input() {
    const LIMIT_KB: usize = 16 * 1024;

    let piece = ZK_EXAMPLE.repeat(8192);
    let (lines, peak_kb) = stream(&["--protocol", "zk"], &piece, 20_000_000);
    assert_eq!(lines, 20_000_000 / piece.len() * 8192);
    assert!(peak_kb < LIMIT_KB, "{peak_kb} kB");

    let piece = AMT_NORMAL.repeat(8192);
    let (lines, peak_kb) = stream(&["--protocol", "amt", "--engine", "titan"], &piece, 20_000_000);
    assert_eq!(lines, 20_000_000 / piece.len() * 8192);
    assert!(peak_kb < LIMIT_KB, "{peak_kb} kB");

    // No line break and no frame ever.
    let (lines, peak_kb) = stream(&["--protocol", "zk"], &[0xF1; 1 << 16], 20_000_000);
    assert_eq!(lines, 0);
    assert!(peak_kb < LIMIT_KB, "{peak_kb} kB");
}
