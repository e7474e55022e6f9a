//! `jetlink rig --rc`: a simulated transmitter in script files, and real frames over TCP.

#[path = "support/process.rs"]
mod process;

use process::Running;
use sim::receiver::{CHANNELS, Protocol, steps};
use std::cell::Cell;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

fn rig(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_jetlink")).arg("rig").args(args).output().expect("it runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A file of this name, with this text.
fn file(name: &str, text: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::write(&path, text).expect("written");
    path
}

const FLOWN: &str = "\
5.0 all throttle 30
6.0 all standby
9.0 all emergency-stop
10.0 all throttle 0
11.0 all standby
15.0 all throttle 30
17.0 all start
20.0 all throttle 0
22.0 all standby
24.0 all start
90.0 all throttle 60
100.0 all silent
110.0 all speak
120.0 all throttle 20
130.0 all node-reset
140.0 all emergency-stop
150.0 end
";

/// The CSV's values of an engine at a time: engine state, source in control, stage of loss, order, throttle on the wire.
fn at(rows: &str, engine: &str, seconds: f64) -> [String; 5] {
    let mut csv = csv::Reader::from_reader(rows.as_bytes());
    let heads = csv.headers().expect("heads").clone();
    let place = |head: &str| heads.iter().position(|other| other == head).expect("a column");
    let columns = ["engine_state", "in_control", "loss", "order", "wire_throttle_pct"].map(place);
    let (time, name) = (place("t_s"), place("engine"));
    let rows: Vec<csv::StringRecord> = csv.records().map(|row| row.expect("a row")).collect();
    let is_it = |row: &&csv::StringRecord| {
        row[name] == *engine && (row[time].parse::<f64>().expect("seconds") - seconds).abs() < 0.05
    };
    let row = rows.iter().find(is_it).expect("a row at this time");
    columns.map(|column| row[column].to_owned())
}

#[test]
fn script_with_a_transmitter_starts_throttles_loses_and_stops() {
    for kind in ["sbus", "crsf", "pwm", "sbus,throttle=1,switch=6"] {
        let head = "jetlink rig script, version 0.1.0\nseed 1\nengine name=left\nengine name=right,ecu=zk,baud=115200\n";
        let script = file(&format!("rc-{kind}.txt"), &format!("{head}rc {kind}\n{FLOWN}"));
        let rows = script.with_extension("csv");
        let output = rig(&["--script", script.to_str().unwrap(), "--fast", "--csv", rows.to_str().unwrap()]);
        let (out, rows) = (text(&output.stdout), std::fs::read_to_string(rows).expect("written"));
        assert!(output.status.success(), "{out}{}", text(&output.stderr));
        // The summary shows the received frames; only SBUS has frames that say that the transmitter is off.
        let line = out.lines().find_map(|line| line.strip_prefix("  radio control: ")).expect("its line");
        let (good, rest) = line.split_once(" good, ").expect("good frames");
        let good: u32 = good.parse().expect("a number");
        assert!(good > 7000, "{kind}: {line}");
        assert_eq!(rest.starts_with("0 of them without a link"), !kind.starts_with("sbus"), "{kind}: {line}");
        assert!(rest.ends_with("0 lost; 0 damaged, 0 implausible"), "{kind}: {line}");
        for engine in ["left", "right"] {
            let at = |seconds| at(&rows, engine, seconds);
            let is = |seconds: f64, column: usize, expected: &str| {
                assert_eq!(
                    at(seconds)[column],
                    expected,
                    "{kind}, {engine} at {seconds} s: {:?}",
                    at(seconds)
                );
            };
            is(4.0, 3, "stop");
            // Released with the stick at idle only, and no start with the stick up or by bringing it down.
            is(8.0, 3, "stop");
            for seconds in [14.0, 19.0, 21.0, 23.0] {
                is(seconds, 3, "standby");
            }
            for seconds in [23.0, 89.0, 95.0, 99.0] {
                is(seconds, 1, "rc");
            }
            is(89.0, 0, "running");
            is(89.0, 4, "0.0");
            is(99.0, 4, "60.0");
            is(100.4, 2, "none");
            is(101.0, 2, "hold");
            is(101.0, 4, "60.0");
            is(109.0, 2, "fail-safe");
            is(109.0, 4, "0.0");
            is(109.0, 0, "running");
            is(119.0, 2, "none");
            is(119.0, 4, "60.0");
            is(139.0, 4, "20.0");
            is(139.0, 1, "rc");
            is(141.0, 3, "stop");
        }
    }
}

/// Handed over to nobody: radio control is present and commands nothing, so the stages of loss begin; it takes the engine back without a
/// jump, and stops it while it is handed over. Without a channel for it nothing happens.
#[test]
fn engine_that_is_handed_over_goes_to_idle_comes_back_without_a_jump_and_can_be_stopped() {
    const HANDED: &str = "\
2.0 all standby
6.0 all start
80.0 all throttle 60
90.0 all hand-over
100.0 all take-back
115.0 all hand-over
120.0 all emergency-stop
125.0 end
";
    for kind in ["sbus,hand=7", "crsf,hand=16", "pwm,hand=3", "sbus"] {
        let head = "jetlink rig script, version 0.1.0\nseed 1\nengine name=left\nengine name=right,ecu=zk,baud=115200\n";
        let script = file(&format!("rc-hand-{kind}.txt"), &format!("{head}rc {kind}\n{HANDED}"));
        let rows = script.with_extension("csv");
        let output = rig(&["--script", script.to_str().unwrap(), "--fast", "--csv", rows.to_str().unwrap()]);
        let (out, rows) = (text(&output.stdout), std::fs::read_to_string(rows).expect("written"));
        assert!(output.status.success(), "{kind}: {out}{}", text(&output.stderr));
        let has_channel = kind.contains("hand");
        for engine in ["left", "right"] {
            let of = |seconds: f64| at(&rows, engine, seconds);
            assert_eq!(of(89.0)[4], "60.0", "{kind}, {engine}");
            let expected = if has_channel { ("fail-safe", "0.0") } else { ("none", "60.0") };
            assert_eq!((of(99.0)[2].as_str(), of(99.0)[4].as_str()), expected, "{kind}, {engine}");
            assert_eq!(of(99.0)[0], "running", "{kind}, {engine}");
            assert_eq!((of(112.0)[1].as_str(), of(112.0)[4].as_str()), ("rc", "60.0"), "{kind}, {engine}");
            assert_eq!(of(122.0)[3], "stop", "{kind}, {engine}");
            // No step of more than 5.5 % in 0.1 s: the rate is 50 % a second.
            let wires = changes(&rows, engine, "wire_throttle_pct");
            let back: Vec<(f64, f64)> = wires
                .iter()
                .filter(|(at, _)| (99.0..112.0).contains(at))
                .filter_map(|(at, value)| Some((*at, value.parse().ok()?)))
                .collect();
            let steps = back.windows(2).all(|pair| pair[1].1 - pair[0].1 <= 6.5);
            assert!(steps && (!has_channel || back.len() > 5), "{kind}, {engine}: {back:?}");
        }
        assert_eq!(out.contains("there is no hand-over switch"), !has_channel, "{kind}: {out}");
    }
}

/// Values in a CSV column of an engine, from its first row on: each value once, with the time of its first row.
fn changes(rows: &str, engine: &str, column: &str) -> Vec<(f64, String)> {
    let mut csv = csv::Reader::from_reader(rows.as_bytes());
    let heads = csv.headers().expect("heads").clone();
    let place = |head: &str| heads.iter().position(|other| other == head).expect("a column");
    let (time, name, column) = (place("t_s"), place("engine"), place(column));
    let mut changes: Vec<(f64, String)> = Vec::new();
    for row in csv.records().map(|row| row.expect("a row")).filter(|row| row[name] == *engine) {
        if changes.last().is_none_or(|(_, last)| *last != row[column]) {
            changes.push((row[time].parse().expect("seconds"), row[column].to_owned()));
        }
    }
    changes
}

#[test]
fn valves_follow_their_engines_and_each_change_has_its_reason() {
    let head =
        "jetlink rig script, version 0.1.0\nseed 1\nengine name=left\nengine name=right,ecu=zk,baud=115200\n";
    for (valves, with) in [(true, "valves\n"), (false, "")] {
        let script = file(&format!("rc-valves-{valves}.txt"), &format!("{head}rc sbus\n{with}{FLOWN}"));
        let rows = script.with_extension("csv");
        let output = rig(&["--script", script.to_str().unwrap(), "--fast", "--csv", rows.to_str().unwrap()]);
        assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
        let rows = std::fs::read_to_string(rows).expect("written");
        assert_eq!(rows.contains("fuel valve"), valves);
        let begins = text(&output.stdout).matches("fuel valve closed: no record of a running engine").count();
        // Two engines, and each once for each start of the node.
        assert_eq!(begins, if valves { 2 } else { 0 });
        for engine in ["left", "right"] {
            let of = |column| changes(&rows, engine, column);
            if !valves {
                let nothing = |column| of(column).iter().all(|(_, state)| state.is_empty());
                assert!(nothing("fuel_valve") && nothing("starter_power"));
                continue;
            }
            let valve = of("fuel_valve");
            let states: Vec<&str> = valve.iter().map(|(_, state)| state.as_str()).collect();
            assert_eq!(states, ["closed", "open", "closed"], "{engine}: {valve:?}");
            // The second engine waits for the first.
            let opened = if engine == "left" { 23.0..26.0 } else { 26.0..89.0 };
            assert!(opened.contains(&valve[1].0) && (valve[2].0 - 140.0).abs() < 0.3, "{engine}: {valve:?}");
            assert_eq!(of("starter_power").last().map(|(_, state)| state.as_str()), Some("on"), "it cools");
        }
        for reason in [
            "fuel valve open: the engine is ordered to run",
            "fuel valve closed: emergency stop",
            "starter and ignition on: ",
        ] {
            assert_eq!(rows.contains(reason), valves, "{reason}");
        }
    }
}

/// It is unknown when the person at the stick starts an engine.
#[test]
fn faults_act_while_radio_control_commands() {
    for (faults, text_of_it) in [
        ("hot-start=left", "every start will be hot"),
        ("cut=left@11s+1s", "the line is cut"),
        ("heavy,until=12s", "faults on all lines end"),
    ] {
        let arguments = ["--rc", "sbus", "--speed", "20", "--duration", "14s", "--faults", faults];
        let output = rig(&arguments);
        let (out, errors) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(0), "{faults}: {errors}{out}");
        assert!(out.contains(text_of_it), "{faults}: {out}");
    }
}

#[test]
fn wrong_options_are_refused() {
    let script = |name: &str, text: &str| {
        file(name, &format!("jetlink rig script, version 0.1.0\n{text}")).display().to_string()
    };
    let endless = script("rc-endless.txt", "rc sbus\n1.0 all start\n");
    let outside = script("rc-outside.txt", "rc sbus=tcpin:127.0.0.1:1\n1.0 end\n");
    for (arguments, part) in [
        (&["--rc", "ppm"][..], "`ppm` is not a receiver"),
        (&["--rc", "pwm=tcpin:127.0.0.1:1"], "pwm has no address"),
        (&["--rc", "pwm,switch=5"], "`switch=5` is not a channel"),
        (&["--rc", "sbus,throttle=5"], "a channel each"),
        (&["--rc", "sbus=here"], "`here` is not an address"),
        (&["--rc", "crsf=udpout:127.0.0.1:1"], "udpout only sends"),
        (&["--rc", "sbus=tcpin:256.0.0.1:1"], "cannot open tcpin:256.0.0.1:1: "),
        (
            &["--rc", "sbus=serial:/dev/nothing-there:100000"],
            "cannot open serial:/dev/nothing-there:100000: ",
        ),
        (&["--rc", "sbus=tcpout:127.0.0.1:1", "--save-script", "x.txt"], "--save-script exclude each other"),
        (&["--rc", "sbus", "--fast"], "--fast"),
        (&["--rc", "sbus", "--scenario", "source-loss"], "--scenario"),
        (&["--script", &endless, "--fast"], "needs `end`"),
        (&["--script", &outside, "--fast"], "a script file exclude each other"),
    ] {
        let output = rig(arguments);
        let errors = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {errors}");
        assert!(errors.contains(part), "{arguments:?}: {errors}");
    }
}

/// Engine time relative to real time.
const SPEED: u32 = 2;

/// A receiver on a TCP port.
#[derive(Clone, Copy)]
struct Sticks {
    stick: u16,
    switch: u16,
    on: bool,
}

/// The rig with a listening receiver, and its output about the engines.
struct Flight {
    _rig: Running,
    sticks: Arc<Mutex<Sticks>>,
    /// Lines of its CSV, which come a second at once.
    rows: Arc<Mutex<Vec<String>>>,
    /// Number of lines that were checked.
    seen: Cell<usize>,
}

impl Flight {
    fn begin(kind: &'static str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("its number");
        let sticks = Arc::new(Mutex::new(Sticks { stick: 1100, switch: 1000, on: true }));
        let moved = sticks.clone();
        thread::spawn(move || {
            let (mut to, _) = listener.accept().expect("the rig");
            to.set_nodelay(true).expect("set");
            loop {
                let every = Duration::from_millis(if kind == "sbus" { 14 } else { 7 });
                thread::sleep(every / SPEED);
                let Sticks { stick, switch, on } = *moved.lock().unwrap();
                let mut channels = [992; CHANNELS];
                (channels[2], channels[4]) = (steps(stick), steps(switch));
                let protocol = if kind == "sbus" { Protocol::Sbus } else { Protocol::Crsf };
                let Some(frame) = protocol.frame(channels, on) else { continue };
                if to.write_all(&frame).is_err() {
                    return;
                }
            }
        });
        let mut rig = Command::new(env!("CARGO_BIN_EXE_jetlink"))
            .args(["rig", "--engine", "name=right,ecu=zk,baud=115200", "--csv", "/dev/stdout"])
            .args(["--rc", &format!("{kind}=tcpout:{address}"), "--speed", &SPEED.to_string()])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("it starts");
        let (out, rows) = (rig.stdout.take().expect("piped"), Arc::new(Mutex::new(Vec::new())));
        let read = rows.clone();
        thread::spawn(move || {
            for line in BufReader::new(out).lines().map_while(Result::ok) {
                read.lock().unwrap().push(line);
            }
        });
        Self { _rig: Running(rig), sticks, rows, seen: Cell::new(1) }
    }

    fn set(&self, change: impl FnOnce(&mut Sticks)) {
        change(&mut self.sticks.lock().unwrap());
    }

    /// The next row: engine state, stage of loss, order, throttle on the wire, whether it is armed.
    fn next(&self) -> Option<[String; 5]> {
        let rows = self.rows.lock().unwrap();
        let heads: Vec<&str> = rows.first()?.split(',').collect();
        let row: Vec<&str> = rows.get(self.seen.get())?.split(',').collect();
        self.seen.set(self.seen.get() + 1);
        Some(["engine_state", "loss", "order", "wire_throttle_pct", "armed"].map(|head| {
            let place = heads.iter().position(|other| *other == head).expect("a column");
            row[place].to_owned()
        }))
    }

    /// Looks at all rows from the last one on until one is so.
    #[track_caller]
    fn until(&self, what: &str, seconds: u32, is: impl Fn(&[String; 5]) -> bool) {
        let end = Instant::now() + Duration::from_secs(seconds.into()) / SPEED + Duration::from_secs(10);
        let mut last = None;
        loop {
            match self.next() {
                Some(row) if is(&row) => return,
                Some(row) => last = Some(row),
                None => thread::sleep(Duration::from_millis(20)),
            }
            assert!(Instant::now() < end, "not within {seconds} s: {what}, {last:?}");
        }
    }

    fn pass_ms(&self, ms: u64) {
        thread::sleep(Duration::from_millis(ms) / SPEED);
    }
}

#[test]
#[cfg(unix)]
#[ignore = "in real time: .ci/mavlink"]
fn real_frames_over_tcp_start_throttle_lose_and_stop() {
    for kind in ["sbus", "crsf"] {
        let flight = Flight::begin(kind);
        flight.until("stop", 20, |[.., order, _, _]| order == "stop");
        flight.pass_ms(2000);
        flight.set(|sticks| sticks.switch = 1500);
        flight.until("armed", 20, |[state, .., armed]| state == "standby" && armed == "yes");
        flight.pass_ms(2000);
        flight.set(|sticks| sticks.switch = 2000);
        flight.until("running", 120, |[state, ..]| state == "running");
        flight.pass_ms(8000);
        flight.set(|sticks| sticks.stick = 1500);
        flight.until("half throttle", 10, |[.., wire, _]| wire == "50.0");
        flight.set(|sticks| sticks.on = false);
        flight.until("the first stage", 3, |[_, loss, _, wire, _]| loss == "hold" && wire == "50.0");
        flight.until("the second stage", 5, |[_, loss, _, wire, _]| loss == "fail-safe" && wire == "0.0");
        flight.pass_ms(5000);
        flight.set(|sticks| sticks.on = true);
        flight.until("half throttle", 15, |[state, loss, _, wire, _]| {
            state == "running" && loss == "none" && wire == "50.0"
        });
        flight.set(|sticks| sticks.switch = 1000);
        flight.until("stop", 2, |[.., order, _, armed]| order == "stop" && armed == "no");
    }
}
