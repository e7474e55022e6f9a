//! Random worlds, judged by the truth: the pilots' commands, the frames on the wires, the power of the ECUs, and the
//! simulated turbines.
//!
//! ```sh
//! cargo test --test truth                                          # some engine-hours
//! JETLINK_SEED=58 cargo test --test truth replay -- --ignored --nocapture    # one world, with its log
//! JETLINK_HOURS=100 cargo truth                                    # a hundred; continues after findings, and counts them
//! ```

mod acts;
mod cases;
mod context;
mod drills;
mod ecus;
mod fate;
mod faults;
mod frames;
mod history;
mod judge;
mod judge_tests;
mod kind;
mod line;
mod log;
mod pilots;
mod radio;
mod settings;
mod valve;
mod vehicle;
mod wire;
mod worlds;

use history::SECOND;
use judge::{Rule, Share, Verdict};
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Virtual time of one world, s.
const WORLD: u64 = 1200;
/// Largest exempt share of the time for which a rule applies, per mille.
const EXEMPT: u64 = 20;

/// Result of many worlds.
#[derive(Default)]
struct Tally {
    seconds: u64,
    healthy: Share,
    at_rest: Share,
    seen: BTreeMap<&'static str, u64>,
    /// Findings of each rule, and the engines that had any; the first seeds.
    findings: BTreeMap<Rule, (u64, u64, Vec<u64>)>,
}

impl Tally {
    fn add(&mut self, seed: u64, verdict: &Verdict) {
        self.healthy.add(&verdict.healthy);
        self.at_rest.add(&verdict.at_rest);
        for (what, count) in &verdict.seen {
            *self.seen.entry(what).or_default() += count;
        }
        for rule in verdict.rules() {
            let count = verdict.findings.iter().filter(|found| found.rule == rule).count() as u64;
            let (all, engines, seeds) = self.findings.entry(rule).or_default();
            (*all, *engines) = (*all + count, *engines + 1);
            if seeds.len() < 5 {
                seeds.push(seed);
            }
        }
    }

    const fn shares(&self) -> [(&'static str, &Share); 2] {
        [
            ("the rules for a healthy engine", &self.healthy),
            ("the rule for an engine at rest that is sent run", &self.at_rest),
        ]
    }

    fn print(&self) {
        println!("{:.1} engine-hours", self.seconds as f64 / 3600.0);
        println!("how often, or for how long, each rule has judged:");
        for (what, count) in &self.seen {
            println!("  {count:>9} {what}");
        }
        for (what, Share { applied, exempt }) in self.shares() {
            println!("{what} applied for {} s; exempt of it:", applied / SECOND);
            for (name, time) in exempt {
                println!("  {:>6.2} per mille {name}", *time as f64 * 1000.0 / (*applied).max(1) as f64);
            }
        }
        for (what, share) in self.shares() {
            println!("  {:>6.2} per mille together: {what}", share.per_mille());
        }
        for rule in Rule::ALL {
            if let Some((all, engines, seeds)) = self.findings.get(&rule) {
                println!(
                    "  {rule:<14?} {all:>6} findings, {engines:>5} engines, for example seeds {seeds:?}"
                );
            }
        }
    }
}

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok()?.parse().ok()
}

/// Reports each tenth of a long campaign.
fn progress(before: u64, now: u64, engine_seconds: u64) {
    let tenth = |seconds: u64| seconds * 10 / engine_seconds;
    if engine_seconds >= LONG && tenth(now) > tenth(before) {
        eprintln!("{} of {} engine-hours", now / 3600, engine_seconds / 3600);
    }
}

/// From this number of engine-seconds on, a campaign prints its progress.
const LONG: u64 = 10 * 3600;

/// Plays worlds from this seed on for this number of engine-seconds, or until this number of worlds had findings.
fn play(first: u64, engine_seconds: u64, threads: u64, enough: u64) -> (Tally, Option<String>) {
    let (seed, done, failed) = (AtomicU64::new(first), AtomicU64::new(0), AtomicU64::new(0));
    let (total, text) = (Mutex::new(Tally::default()), Mutex::new(None));
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while done.load(Ordering::Relaxed) < engine_seconds && failed.load(Ordering::Relaxed) < enough
                {
                    let seed = seed.fetch_add(1, Ordering::Relaxed);
                    let world = std::panic::catch_unwind(|| worlds::run(seed, WORLD));
                    let Ok(world) = world else {
                        failed.fetch_add(enough, Ordering::Relaxed);
                        *text.lock().unwrap() = Some(format!("seed {seed}: a panic"));
                        return;
                    };
                    let seconds = WORLD * world.engines.len() as u64;
                    let before = done.fetch_add(seconds, Ordering::Relaxed);
                    progress(before, before + seconds, engine_seconds);
                    let mut total = total.lock().unwrap();
                    for engine in &world.engines {
                        total.seconds += WORLD;
                        total.add(seed, &engine.verdict);
                        // At once: a long campaign may be interrupted.
                        for finding in &engine.verdict.findings {
                            let (rule, at) = (finding.rule, finding.at as f64 / SECOND as f64);
                            eprintln!("seed {seed}: {rule:?} at {at:.3} s: {}", finding.text);
                        }
                    }
                    if world.engines.iter().any(|engine| !engine.verdict.findings.is_empty()) {
                        failed.fetch_add(1, Ordering::Relaxed);
                        text.lock().unwrap().get_or_insert_with(|| world.report(false));
                    }
                }
            });
        }
    });
    (total.into_inner().unwrap(), text.into_inner().unwrap())
}

/// Situations that occur within six hours.
const IN_HOURS: [&str; 28] = [
    "doubts",
    "error sets in a start",
    "frames of radio control",
    "frames that fall at slew.down",
    "frames that rise at the rate after a gap",
    "frames that rise at the rate after a reduction",
    "frames that rise at the rate after a reset",
    "frames that rise at the rate after a start",
    "frames that rise at the rate after a take-over",
    "gaps in a start",
    "ignitions",
    "limits that hold a demand low",
    "lost demands that may not rise",
    "reductions",
    "replies in their window",
    "resets",
    "resets in a start",
    "seconds in which a demand has to be obeyed",
    "shutdowns",
    "silences",
    "starters with power",
    "starters without power again",
    "starts",
    "starts that came near their time",
    "starts that have to be granted",
    "starts that waited",
    "stops",
    "valves closed",
];
/// Situations that take a hundred hours.
const IN_A_HUNDRED_HOURS: [&str; 16] = [
    "CTF that has to be sent",
    "frames that rise at the rate after a loss of the source",
    "hand-overs to the PWM input",
    "pumps open for more than 1 s",
    "replies in doubt that may not rise",
    "seconds of damage in flight that is no gap",
    "slow shafts that raise doubt",
    "speeds in doubt",
    "speeds that no turbine makes",
    "standbys in doubt",
    "starts after another engine's",
    "starts that a disarm ends",
    "starts that have to go when they may",
    "take-overs",
    "third resets without a source",
    "transmitters that hang",
];

/// A rule that judged nothing would find nothing.
fn each_rule_judged(tally: &Tally, what: &[&str]) {
    let none = |what: &&&str| tally.seen.get(**what).is_none_or(|count| *count == 0);
    let none: Vec<_> = what.iter().filter(none).collect();
    assert!(none.is_empty(), "there were none of these, and their rules judged nothing: {none:?}");
}

#[test]
fn random_worlds_break_no_rule() {
    let seconds = number("JETLINK_SECONDS").unwrap_or(6 * 3600);
    let (tally, text) = play(number("JETLINK_SEED").unwrap_or(1), seconds, 2, 1);
    tally.print();
    if let Some(text) = text {
        panic!("{text}");
    }
    if seconds >= 6 * 3600 {
        each_rule_judged(&tally, &IN_HOURS);
    }
}

#[test]
fn random_worlds_with_mavlink_break_no_rule() {
    let (tally, text) = play(vehicle::SEEDS.start, 12 * 3600, 2, 1);
    tally.print();
    if let Some(text) = text {
        panic!("{text}");
    }
    let rules = ["messages of MAVLink", "starts of MAVLink", "frames of a stream that had to be followed"];
    each_rule_judged(&tally, &rules);
}

#[test]
#[ignore = "one seed, given by JETLINK_SEED"]
fn replay() {
    let seed = number("JETLINK_SEED").unwrap_or(1);
    let world = worlds::run(seed, number("JETLINK_SECONDS").unwrap_or(WORLD));
    println!("{}", world.report(true));
    assert!(
        world.engines.iter().all(|engine| engine.verdict.findings.is_empty()),
        "seed {seed} has findings"
    );
}

#[test]
#[ignore = "hours; JETLINK_HOURS sets how many"]
fn campaign() {
    let hours = number("JETLINK_HOURS").unwrap_or(100);
    let (first, threads) =
        (number("JETLINK_SEED").unwrap_or(1_000_000), number("JETLINK_THREADS").unwrap_or(2));
    let began = Instant::now();
    let (tally, text) = play(first, hours * 3600, threads, number("JETLINK_FINDINGS").unwrap_or(1));
    tally.print();
    println!("in {:.0} s of real time", began.elapsed().as_secs_f64());
    if let Some(text) = text {
        panic!("{text}");
    }
    // Worlds with MAVLink have no drills.
    let drilled = !vehicle::SEEDS.contains(&first);
    if hours >= 6 && drilled {
        each_rule_judged(&tally, &IN_HOURS);
    }
    if hours >= 100 && drilled {
        each_rule_judged(&tally, &IN_A_HUNDRED_HOURS);
    }
    for (what, share) in tally.shares() {
        assert!(share.per_mille() <= EXEMPT as f64, "of {what} more than {EXEMPT} per mille is exempt");
    }
}
