//! Random script files: a played run passes whatever a pilot does and whatever breaks, because only the node could fail it.
//!
//! A failure prints its seed and its script. `JETLINK_SEED=58 cargo test --package host random_scripts -- --ignored` plays from
//! that seed on, `JETLINK_RUNS` of them.

use super::judged_tests::run;
use std::fmt::Write as _;

/// Seeds that every test run plays.
const SEED: u64 = 1;
const RUNS: u64 = 200;
/// Threads that play.
const THREADS: u64 = 2;

const ENGINES: [&str; 11] = [
    "ecu=amt,engine=olympus",
    "ecu=amt,engine=mercury,baud=115200",
    "ecu=amt,engine=nike",
    "ecu=zk,version=1,baud=2400,stop=1",
    "ecu=zk,version=3,baud=115200",
    "ecu=zk,version=4,mode=split",
    "ecu=zk,version=4,mode=rpm",
    "ecu=zk,mode=split,rate=100",
    "ecu=zk,mode=rpm,rate=100,baud=38400",
    "ecu=zk",
    "ecu=zk,mode=rpm",
];
const FAULTS: [(&str, &str); 8] = [
    ("cut", "mend"),
    ("cut-to-ecu", "mend-to-ecu"),
    ("cut-to-node", "mend-to-node"),
    ("noise", "quiet"),
    ("power-off", "power-on"),
    ("silent", "speak"),
    ("flame-out", ""),
    ("node-reset", ""),
];

/// A script file, without its head.
fn script(seed: u64) -> String {
    let mut rng = fastrand::Rng::with_seed(seed);
    let mut text = format!("seed {seed}\n");
    let engines: Vec<&str> = (0..rng.usize(1..=3)).map(|_| ENGINES[rng.usize(..ENGINES.len())]).collect();
    for (i, engine) in engines.iter().enumerate() {
        let _ = writeln!(text, "engine name=e{i},{engine}");
    }
    let rc = rng.u8(..10) < 2;
    if rc {
        let _ = writeln!(text, "rc {}", ["sbus", "crsf", "pwm"][rng.usize(..3)]);
    } else {
        match rng.u8(..20) {
            0..=2 => text += "silence\n",
            3 => text += "faults light\n",
            4 => text += "faults heavy\n",
            5 => text += "faults cut=e0@40s+3s\n",
            _ => {}
        }
    }
    if rng.u8(..10) < 2 {
        text += "valves\n";
    }
    let (mut tenths, mut lasting) = (rng.u64(..50), Vec::new());
    // By hand from the beginning on: otherwise a script has to begin it before much can break.
    if rng.bool() {
        let _ = writeln!(text, "3.0 all arm\n3.1 all {}", if rc { "standby" } else { "start" });
        tenths = 31 + rng.u64(..400);
    }
    for _ in 0..rng.u8(3..=14) {
        tenths += match rng.u8(..6) {
            0 => 0,
            1 => 1,
            2 => 3,
            3 => 10,
            4 => 30,
            _ => rng.u64(..200),
        };
        let engine = rng.usize(..=engines.len());
        let all = engine == engines.len();
        let name = |all| if all { "all".to_owned() } else { format!("e{}", engine % engines.len()) };
        let (name, act) = match rng.u8(..20) {
            0..=9 => {
                let act = match rng.u8(..11) {
                    0 => "arm".to_owned(),
                    1 => "disarm".to_owned(),
                    2 | 3 => "start".to_owned(),
                    4 => "standby".to_owned(),
                    5 | 6 => format!("throttle {}", rng.u8(..=100)),
                    7 => "emergency-stop".to_owned(),
                    8 | 9 => "release".to_owned(),
                    _ => "script".to_owned(),
                };
                (name(all), act)
            }
            10 if !all && engines[engine].contains("mode=rpm") => {
                (name(false), format!("rpm {}", rng.u32(..=120_000)))
            }
            10 => ("all".to_owned(), "arm".to_owned()),
            _ => match FAULTS[rng.usize(..FAULTS.len())] {
                ("node-reset", _) => ("all".to_owned(), "node-reset".to_owned()),
                (begin, "") => (name(false), begin.to_owned()),
                (begin, end) => {
                    // One transmitter is the source of all engines.
                    let of = if rc && begin == "silent" { 0 } else { engine % engines.len() };
                    let place = lasting.iter().position(|&lasts| lasts == (of, begin));
                    match place {
                        Some(place) => drop(lasting.remove(place)),
                        None => lasting.push((of, begin)),
                    }
                    (format!("e{of}"), if place.is_some() { end } else { begin }.to_owned())
                }
            },
        };
        let _ = writeln!(text, "{}.{} {name} {act}", tenths / 10, tenths % 10);
    }
    tenths += [1, 20, 100, 200][rng.usize(..4)];
    let _ = writeln!(text, "{}.{} end", tenths / 10, tenths % 10);
    text
}

/// Plays these seeds, and returns the failures.
fn failures(from: u64, runs: u64) -> Vec<String> {
    let of_thread = |thread: u64| {
        (from + thread..from + runs).step_by(THREADS as usize).filter_map(|seed| {
            let script = script(seed);
            let run =
                run(&format!("random-{seed}"), &script).unwrap_or_else(|error| panic!("{error}\n{script}"));
            let problems = run.problems();
            (!problems.is_empty()).then(|| format!("seed {seed}:\n{script}{}\n", problems.join("\n")))
        })
    };
    std::thread::scope(|scope| {
        let threads: Vec<_> =
            (0..THREADS).map(|thread| scope.spawn(move || of_thread(thread).collect::<Vec<_>>())).collect();
        threads.into_iter().flat_map(|thread| thread.join().expect("it plays")).collect()
    })
}

#[test]
fn no_random_script_fails() {
    let failures = failures(SEED, RUNS);
    assert!(failures.is_empty(), "{} of {RUNS}\n{}", failures.len(), failures.join("\n"));
}

#[test]
#[ignore = "from a seed, given by JETLINK_SEED"]
fn random_scripts_from_a_seed() {
    let number = |name| std::env::var(name).ok().and_then(|text| text.parse().ok());
    let runs = number("JETLINK_RUNS").unwrap_or(1);
    let failures = failures(number("JETLINK_SEED").unwrap_or(SEED), runs);
    assert!(failures.is_empty(), "{} of {runs}\n{}", failures.len(), failures.join("\n"));
}
