//! One line for the spectator: the present events and their reasons.

use super::context::Stage;
use super::play::action::Fault;
use super::sample::Sample;
use jetlink::command::{Order, Origin};
use jetlink::engine::state::EngineState;
use jetlink::event::LossStage;
use jetlink::report::LinkState;

/// The line for this moment; `faults`: those of each engine that were set by hand and last. In a scenario no key breaks or
/// starts anything. Keys act on the selected engine: for another one its number comes first.
pub fn line(
    names: &[&str],
    samples: &[Sample],
    faults: &[&[Fault]],
    complete: Option<bool>,
    scenario: bool,
    selected: usize,
) -> String {
    let text = most_urgent(names, samples, faults, complete, selected);
    match text.split_once("; press f") {
        Some((first, _)) if scenario && complete.is_some() => format!("{first}; q ends"),
        Some((first, _)) if scenario => first.to_owned(),
        _ => text,
    }
}

/// The same with all keys. The most urgent comes first.
fn most_urgent(
    names: &[&str],
    samples: &[Sample],
    faults: &[&[Fault]],
    complete: Option<bool>,
    selected: usize,
) -> String {
    let all = || names.iter().zip(samples);
    let key = |engine: usize| if engine == selected { String::new() } else { format!("{}, ", engine + 1) };
    // The selected one, if it is such a one.
    let rather = |found: &dyn Fn(&Sample) -> bool| {
        let is = |engine: &usize| samples.get(*engine).is_some_and(found);
        let engine = Some(selected).filter(is).or_else(|| (0..samples.len()).find(is))?;
        Some((*names.get(engine)?, samples.get(engine)?, key(engine)))
    };
    let first =
        |found: &dyn Fn(&Sample) -> bool| all().find(|(_, sample)| found(sample)).map(|(name, _)| *name);
    match complete {
        Some(true) => {
            let selected = names.get(selected).zip(samples.get(selected));
            return match selected.map(|(name, sample)| (name, sample.order, sample.armed)) {
                Some((name, Order::EmergencyStop, _)) => {
                    format!("PASS; {name}: emergency stop is latched; r and y release it, q ends")
                }
                Some((name, _, false)) => format!("PASS; {name} is disarmed: d, a and s start it; q ends"),
                _ => "PASS; press f to break something, s to start an engine again, q to end".to_owned(),
            };
        }
        Some(false) => return "FAILED; q ends and prints why".to_owned(),
        None => {}
    }
    if let Some((name, _, key)) = rather(&|sample| sample.order == Order::EmergencyStop) {
        return format!("{name}: emergency stop is latched; {key}r and y release it");
    }
    if samples.iter().any(|sample| !sample.node_up) {
        return "the node restarts: nothing is received or sent until it is up".to_owned();
    }
    // What a silent source leads to is written below.
    let by_hand = names.iter().zip(faults).enumerate().filter_map(|(engine, (name, faults))| {
        let fault = faults.iter().find(|fault| **fault != Fault::Silence)?;
        Some((*name, format!("{}, set by you; press {}f to end it", fault.name(), key(engine))))
    });
    let by_hand: Vec<(&str, String)> = by_hand.collect();
    if let Some((name, sample)) = all().find(|(_, sample)| sample.link == LinkState::Lost) {
        let why = by_hand.iter().find(|(other, _)| other == name).map(|(_, why)| why.clone());
        let why = why.unwrap_or_else(|| sample.does_text());
        return format!("{name}: nothing is received from its ECU: {why}");
    }
    if let Some((name, why)) = by_hand.first() {
        return format!("{name}: {why}");
    }
    if let Some((name, sample)) = all().find(|(_, sample)| sample.loss != LossStage::None) {
        if !sample.silent && sample.link == LinkState::Up {
            return format!("{name}'s source commands again: it is in control within 3 s");
        }
        return match sample.loss {
            LossStage::Hold => format!("{name}'s source is silent: its last demand is held for 1 s"),
            LossStage::FailSafe => {
                format!("{name}'s source is silent: the demand falls to idle; the engine keeps running")
            }
            LossStage::Standby | LossStage::None => format!("{name}'s source is silent: standby"),
        };
    }
    if let Some(name) = first(&|sample| matches!(sample.order, Order::Doubt(_))) {
        return format!("{name}: in doubt whether it runs; the demand may be withheld");
    }
    if let Some(name) = first(&|sample| sample.silent) {
        return format!("{name}'s source has fallen silent");
    }
    if let Some(Stage::Scenario(name)) = samples.first().map(|sample| sample.stage) {
        return format!("the scenario {name} is played, and judged at its end");
    }
    if let Some(name) = first(&|sample| sample.stage == Stage::SourceLost) {
        return format!("{name}'s source is back: the demand rises to what it commands");
    }
    let starting = first(&|sample| sample.stage == Stage::Start);
    let waiting = first(&|sample| sample.stage == Stage::Standby);
    match (starting, waiting) {
        (Some(starting), Some(waiting)) => format!("{starting} starts; {waiting} waits: one start at a time"),
        (Some(starting), None) => format!("{starting} starts, the last one"),
        (None, Some(waiting)) => format!("{waiting} is in standby: cold, armed, ready for its start"),
        (None, None) => {
            if samples.iter().any(|sample| sample.stage == Stage::Commanded) {
                commanded(names, samples)
            } else if samples.iter().all(|sample| sample.stage == Stage::Done) {
                "all engines are shut down and cool; press f to break something".to_owned()
            } else if samples.iter().all(|sample| matches!(sample.stage, Stage::Cooling | Stage::Done)) {
                "all engines are shut down; they cool to 100 °C, turned by their starters".to_owned()
            } else if let Some((name, sample, key)) = rather(&|sample| sample.stage == Stage::Played) {
                played(name, sample, &key)
            } else if let Some(name) = first(&|sample| sample.stage == Stage::Cooling) {
                format!("{name} cools: its starter turns it until the exhaust is below 100 °C")
            } else {
                "all engines run: steps of throttle and rpm; press f to break something".to_owned()
            }
        }
    }
}

/// The line for an engine that was taken from its script.
fn played(name: &str, sample: &Sample, key: &str) -> String {
    match (sample.does.is_stopped() && sample.order == Order::Standby, sample.armed) {
        (true, false) => format!("{name} is disarmed; {key}d, a and s start it, b restarts its script"),
        (true, true) => format!("{name} is armed, in standby; {key}s starts it, b restarts its script"),
        (false, _) => format!("{name}: {}, played by you; {key}b gives it back", sample.does_text()),
    }
}

/// The line for engines that MAVLink or radio control commands: the first one that starts or runs.
fn commanded(names: &[&str], samples: &[Sample]) -> String {
    for (name, sample) in names.iter().zip(samples) {
        let source = sample.in_control.name();
        match sample.does {
            EngineState::Starting(_) | EngineState::StartRequested => {
                return format!("{name} starts, commanded by {source}");
            }
            EngineState::Running => {
                return format!("{name} runs, commanded by {source}; press f to break something");
            }
            _ => {}
        }
    }
    match samples.iter().map(|sample| sample.in_control).find(|&source| source != Origin::Node) {
        Some(source) => format!("no engine runs; {} is in control", source.name()),
        None => "no engine runs, and no source has commanded yet".to_owned(),
    }
}
