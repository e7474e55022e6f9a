//! The log of a world.

use crate::context::Judged;
use crate::history::{Cause, PilotCommand, Pin, SECOND, Sent, Switch};
use crate::judge::seconds;
use crate::worlds::World;
use sim::turbine::Phase;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Time before the first finding at which the log begins.
const BEFORE: u64 = 60 * SECOND;

impl World {
    /// The log; around the findings only, unless all of it is wanted.
    pub fn report(&self, whole: bool) -> String {
        let mut text = String::new();
        for (port, engine) in self.engines.iter().enumerate() {
            if !whole && engine.verdict.findings.is_empty() {
                continue;
            }
            let _ = writeln!(text, "seed {}, engine {port}: {}", self.seed, engine.name);
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
            let _ = writeln!(text, "seed {}: no findings", self.seed);
        }
        text
    }
}

fn lines(engine: &Judged) -> Vec<(u64, String)> {
    let history = &engine.history;
    let mut lines: Vec<(u64, String)> = engine.notes.clone();
    let names = ["emergency", "rc", "mavlink", "bench"];
    let mut last: [Option<(u64, PilotCommand)>; 4] = [None; 4];
    let mut armed: [Option<PilotCommand>; 4] = [None; 4];
    for commanded in &history.commanded {
        if matches!(commanded.command, PilotCommand::Arm | PilotCommand::Disarm) {
            if armed[commanded.source].replace(commanded.command) != Some(commanded.command) {
                lines.push((commanded.at, format!("  {}: {}", names[commanded.source], commanded.command)));
            }
            continue;
        }
        let before = last[commanded.source].replace((commanded.at, commanded.command));
        let age = history.rules.ages[commanded.source];
        let new =
            before.is_none_or(|(when, command)| command != commanded.command || commanded.at > when + age);
        if new {
            if let Some((when, command)) = before.filter(|(when, _)| commanded.at > when + age) {
                lines.push((when, format!("  {}: {command}, and then silence", names[commanded.source])));
            }
            lines.push((commanded.at, format!("  {}: {}", names[commanded.source], commanded.command)));
        }
    }
    // Each kind of frame separately: some alternate.
    let mut sent: BTreeMap<u8, (u64, Option<Switch>, Sent)> = BTreeMap::new();
    for frame in &history.frames {
        let kind = |sent: Sent| match sent {
            Sent::Full(switch, tenths) => Sent::Full(switch, tenths / 50),
            Sent::Rpm(rpm) => Sent::Rpm(rpm / 5000),
            other => other,
        };
        let number = match frame.sent {
            Sent::Full(..) | Sent::Ctf => 1,
            Sent::Nothing => 0,
            Sent::Action(_) => 2,
            Sent::Mode(..) => 6,
            Sent::Rpm(_) => 7,
            Sent::Other(id) => id,
            Sent::Bad(_) => 99,
        };
        let now = (frame.at, frame.sent.switch(), kind(frame.sent));
        let before = sent.insert(number, now);
        if before.is_none_or(|before| (before.1, before.2) != (now.1, now.2) || now.0 > before.0 + SECOND) {
            let lost = if frame.arrived { "" } else { ", lost" };
            lines.push((frame.at, format!("      wire: {}{lost}", frame.sent)));
        }
    }
    for (at, mark) in &history.marks {
        lines.push((*at, format!("    {mark}")));
    }
    let mut phase = Phase::Stopped;
    for sample in &history.samples {
        if core::mem::replace(&mut phase, sample.phase) != sample.phase {
            lines.push((
                sample.at,
                format!("    turbine: {}, {:.0} rpm, {:.0} °C", sample.phase.name(), sample.rpm, sample.egt),
            ));
        }
    }
    for (at, pin) in &history.pin {
        let pin = match pin {
            Pin::Floats => "floats",
            Pin::Closed => "closed",
            Pin::Open => "open",
        };
        lines.push((*at, format!("    valve: {pin}")));
    }
    for (at, power) in &history.power {
        let power = power.map_or("floats", |on| if on { "on" } else { "off" });
        lines.push((*at, format!("    power: {power}")));
    }
    for reset in &history.resets {
        let retained = if reset.cause == Cause::PowerOn { "nothing retained" } else { "memory whole" };
        lines.push((reset.up, format!("the node begins, {retained}")));
    }
    lines.sort_by_key(|(at, _)| *at);
    lines
}
