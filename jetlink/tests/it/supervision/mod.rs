//! The supervision of engines as a whole, judged by what is on the wire: random schedules of sources, faults of the
//! line, ECU states and resets, against the invariants of docs/invariants.md. That page also has the list of
//! mutations, one for each invariant, that this test finds.
//!
//! A failure prints its seed and what happened before it. `JETLINK_SEED=<seed> cargo test -p jetlink --test it supervision::replay --
//! --ignored` plays it again. The campaign: `JETLINK_HOURS=1000 cargo campaign`.

mod ecus;
mod judge_tests;
mod oracle;
mod reader;
mod regressions;
mod rng;
mod wire;
mod world;

use embassy_time::Duration;
use oracle::Tally;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Virtual time of one world.
const WORLD: Duration = Duration::from_secs(1200);

/// From this number of engine-seconds on, a campaign prints its progress.
const LONG: u64 = 10 * 3600;

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok()?.parse().ok()
}

/// Prints each tenth of a long campaign.
fn progress(before: u64, now: u64, engine_seconds: u64) {
    let tenth = |seconds: u64| seconds * 10 / engine_seconds;
    if engine_seconds >= LONG && tenth(now) > tenth(before) {
        eprintln!("{} of {} engine-hours", now / 3600, engine_seconds / 3600);
    }
}

/// Plays worlds from this seed on for `engine_seconds`, on `threads` threads. Panics at the first failure, or after
/// JETLINK_FINDINGS of them.
fn worlds(first: u64, engine_seconds: u64, threads: u64) -> Tally {
    let (seed, done) = (AtomicU64::new(first), AtomicU64::new(0));
    let (total, failures) = (Mutex::new(Tally::default()), Mutex::new(Vec::new()));
    let enough = usize::try_from(number("JETLINK_FINDINGS").unwrap_or(1)).unwrap();
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while done.load(Ordering::Relaxed) < engine_seconds && failures.lock().unwrap().len() < enough
                {
                    let seed = seed.fetch_add(1, Ordering::Relaxed);
                    let world = std::panic::catch_unwind(|| world::run(seed, WORLD));
                    match world.unwrap_or_else(|_| Err(world::Failure { seed, text: "a panic".into() })) {
                        Ok((seconds, tally)) => {
                            let before = done.fetch_add(seconds, Ordering::Relaxed);
                            progress(before, before + seconds, engine_seconds);
                            total.lock().unwrap().add(&tally);
                        }
                        Err(found) => {
                            eprintln!("{}", found.text.lines().next().unwrap_or_default());
                            failures.lock().unwrap().push(found);
                        }
                    }
                }
            });
        }
    });
    let failures = failures.into_inner().unwrap();
    if let Some(last) = failures.last() {
        let seeds: Vec<u64> = failures.iter().map(|found| found.seed).collect();
        let played = done.into_inner() / 3600;
        panic!("{}\nseed {}; in {played} engine-hours these failed: {seeds:?}", last.text, last.seed);
    }
    total.into_inner().unwrap()
}

#[test]
fn the_invariants_hold_in_random_worlds() {
    let seconds = number("JETLINK_SECONDS").unwrap_or(6 * 3600);
    let tally = worlds(number("JETLINK_SEED").unwrap_or(1), seconds, 2);
    println!("{tally:?}");
    // The events that the invariants concern did happen.
    for (what, count) in [
        ("starts", tally.starts),
        ("frames of a run", tally.run_frames),
        ("frames of a stop", tally.stop_frames),
        ("frames at the fail-safe", tally.fail_safe_frames),
        ("resets in flight", tally.resets_running),
        ("frames with an exact demand", tally.exact_frames),
        ("rpm frames", tally.rpm_frames),
        ("takeovers", tally.takeovers),
        ("frames of a rising demand", tally.rising_frames),
        ("runs of a healthy engine that ended", tally.healthy_ends),
        ("runs whose ECU lost its power", tally.dark_runs),
        ("runs that resumed after a reset", tally.resumed_runs),
    ] {
        assert!(count >= 5, "only {count} {what}: {tally:?}");
    }
}

#[test]
#[ignore = "one seed, given by JETLINK_SEED"]
fn replay() {
    worlds(number("JETLINK_SEED").unwrap_or(1), 1, 1);
}

#[test]
#[ignore = "hours; JETLINK_HOURS sets how many"]
fn campaign() {
    let hours = number("JETLINK_HOURS").unwrap_or(1000);
    let (first, threads) =
        (number("JETLINK_SEED").unwrap_or(1_000_000), number("JETLINK_THREADS").unwrap_or(2));
    let began = Instant::now();
    let tally = worlds(first, hours * 3600, threads);
    println!("{hours} engine-hours in {:.0} s of real time: {tally:?}", began.elapsed().as_secs_f64());
}
