//! What happened in a world, for a reader.

use crate::history::{Cause, SECOND, Switch, Told, Word};
use crate::judge::seconds;
use crate::worlds::{Judged, World};
use sim::turbine::Phase;
use std::collections::BTreeMap;
use std::fmt::Write;

/// So long before the first finding the log begins.
const BEFORE: u64 = 60 * SECOND;

pub fn report(world: &World, whole: bool) -> String {
    let mut text = String::new();
    for (port, engine) in world.engines.iter().enumerate() {
        if !whole && engine.verdict.findings.is_empty() {
            continue;
        }
        let _ = writeln!(text, "seed {}, engine {port}: {}", world.seed, engine.name);
        let first = engine.verdict.findings.first().map_or(u64::MAX, |found| found.at);
        for (at, line) in lines(engine) {
            if whole || (first.saturating_sub(BEFORE)..first + 3 * SECOND).contains(&at) {
                let _ = writeln!(text, "{:>13}  {line}", seconds(at));
            }
        }
        for found in &engine.verdict.findings {
            let _ = writeln!(text, "FINDING {:?} at {}: {}", found.rule, seconds(found.at), found.text);
        }
    }
    if text.is_empty() {
        let _ = writeln!(text, "seed {}: no findings", world.seed);
    }
    text
}

fn lines(engine: &Judged) -> Vec<(u64, String)> {
    let history = &engine.history;
    let mut lines: Vec<(u64, String)> = engine.notes.clone();
    let names = ["emergency", "rc", "mavlink", "bench"];
    let mut last: [Option<(u64, Word)>; 4] = [None; 4];
    let mut armed: [Option<Word>; 4] = [None; 4];
    for said in &history.said {
        if matches!(said.word, Word::Arm | Word::Disarm) {
            if armed[said.source].replace(said.word) != Some(said.word) {
                lines.push((said.at, format!("  {}: {:?}", names[said.source], said.word)));
            }
            continue;
        }
        let before = last[said.source].replace((said.at, said.word));
        let age = history.rules.ages[said.source];
        let new = before.is_none_or(|(when, word)| word != said.word || said.at > when + age);
        if new {
            if let Some((when, word)) = before.filter(|(when, _)| said.at > when + age) {
                lines.push((when, format!("  {}: {word:?}, and then silence", names[said.source])));
            }
            lines.push((said.at, format!("  {}: {:?}", names[said.source], said.word)));
        }
    }
    // Of each kind of frame by itself: some take turns.
    let mut told: BTreeMap<u8, (u64, Option<Switch>, Told)> = BTreeMap::new();
    for frame in &history.frames {
        let kind = |told: Told| match told {
            Told::Full(switch, tenths) => Told::Full(switch, tenths / 50),
            Told::Rpm(rpm) => Told::Rpm(rpm / 5000),
            other => other,
        };
        let number = match frame.told {
            Told::Full(..) | Told::Ctf => 1,
            Told::Nothing => 0,
            Told::Action(_) => 2,
            Told::Mode(..) => 6,
            Told::Rpm(_) => 7,
            Told::Other(id) => id,
            Told::Bad(_) => 99,
        };
        let now = (frame.at, frame.told.switch(), kind(frame.told));
        let before = told.insert(number, now);
        if before.is_none_or(|before| (before.1, before.2) != (now.1, now.2) || now.0 > before.0 + SECOND) {
            let lost = if frame.arrived { "" } else { ", lost" };
            lines.push((frame.at, format!("      wire: {:?}{lost}", frame.told)));
        }
    }
    for (at, mark) in &history.marks {
        lines.push((*at, format!("    {mark:?}")));
    }
    let mut phase = Phase::Stopped;
    for sample in &history.samples {
        if core::mem::replace(&mut phase, sample.phase) != sample.phase {
            lines.push((
                sample.at,
                format!("    turbine: {:?}, {:.0} rpm, {:.0} °C", sample.phase, sample.rpm, sample.egt),
            ));
        }
    }
    for reset in &history.resets {
        let kept = if reset.cause == Cause::PowerOn { "nothing kept" } else { "memory whole" };
        lines.push((reset.up, format!("the node begins, {kept}")));
    }
    lines.sort_by_key(|(at, _)| *at);
    lines
}
