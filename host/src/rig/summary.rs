//! The summary of a run: counters of the node, the ECUs and the lines, and whether all is well.

use super::ending::EndedBy;
use super::fit::wrapped;
use super::outcome::{End, Outcome, Outcomes};
use super::quantity::seconds;
use super::row::millis;
use super::sample::decode_errors;
use embassy_time::Duration;
use jetlink::report::LinkState;

/// Columns of the heads, and of an engine: with names of 12 letters four engines fill 80 columns.
const HEAD: usize = 28;
const ENGINE: usize = 13;
/// Columns before an expected event.
const CHECK: usize = 9;
/// Engines beside one another, however wide the screen is.
const MOST_BESIDE: usize = 4;

/// Everything that makes a run a failure, a sentence each. An early end is not a failure: missing events are then
/// not judged, but faults up to then are.
pub fn problems(outcomes: &Outcomes) -> Vec<String> {
    let mut problems = Vec::new();
    if let End::Panicked(message) = &outcomes.end {
        problems.push(format!("the rig has panicked: {message}"));
    }
    let played = outcomes.is_played();
    // A scenario that was stopped by hand did not run as expected.
    for check in outcomes.checks.iter().filter(|check| !check.held && !played) {
        problems.push(format!("expected, and did not occur: {}", check.what));
    }
    for outcome in &outcomes.engines {
        let mut problem = |what: String| problems.push(format!("{}: {what}", outcome.name));
        let Outcome { node, ecu, audit, .. } = outcome;
        if let (Some(Err(why)), None) = (&outcome.flown, outcome.played) {
            problem(why.clone());
        }
        if let Some(played) = outcome.played {
            for (count, what) in [
                (played.ignitions, "uncommanded ignitions"),
                (played.late_stops, "emergency stops that were late on the wire"),
                (played.missed, "reply windows missed outside of the faults"),
            ] {
                if count > 0 {
                    problem(format!("{count} {what}"));
                }
            }
        }
        for finding in &audit.findings {
            let bytes: String = finding.bytes.iter().map(|byte| format!("{byte:02X} ")).collect();
            problem(format!(
                "an unsolicited command at {:.6} s: {bytes}({})",
                finding.at as f64 / 1e9,
                finding.what
            ));
        }
        let more = audit.not_given.saturating_sub(audit.findings.len() as u64);
        if more > 0 {
            problem(format!("and {more} more unsolicited commands"));
        }
        if outcomes.end == End::Complete && !played && outcome.flown.is_some() && outcome.is_live {
            problem("the engine is not shut down".to_owned());
        }
        if outcomes.end == End::Complete && !played && outcome.link != LinkState::Up {
            problem("the link is not up at the end".to_owned());
        }
        if outcomes.is_scenario && !played && (ecu.late > 0 || ecu.bad > outcomes.bad_commands) {
            problem(format!("the ECU received {} late and {} bad commands", ecu.late, ecu.bad));
        }
        if outcome.line_was_clean && outcome.played.is_none() {
            if missed(outcome) > 0 {
                problem(format!("{} reply windows were missed on a clean line", missed(outcome)));
            }
            let by_node = node.replies_missed + node.replies_late;
            if by_node > 0 && missed(outcome) == 0 {
                problem(format!("the node counts {by_node} missed replies, the ECU counts none"));
            }
            if decode_errors(node) > 0 {
                problem(format!("{} decode errors on a clean line", decode_errors(node)));
            }
            if ecu.bad > 0 {
                problem(format!("the ECU received {} bad commands on a clean line", ecu.bad));
            }
            // One frame each way may be in transit at the end.
            if ecu.frames.abs_diff(node.frames.into()) > 1 {
                problem(format!("the ECU sent {} frames, the node received {}", ecu.frames, node.frames));
            }
            // A starting ECU may or may not have received what was sent before its first frame.
            let lost = audit.frames.saturating_sub(ecu.accepted + audit.frames_before_ecu + 1);
            if lost > missed(outcome) {
                problem(format!("{} commands went to the ECU, it accepted {}", audit.frames, ecu.accepted));
            }
        }
    }
    problems
}

/// The counters, a row each: its head, and a cell for each engine.
pub fn rows(outcomes: &Outcomes) -> Vec<(&'static str, Vec<String>)> {
    let engines = &outcomes.engines;
    let mut rows: Vec<(&str, Vec<String>)> = Vec::new();
    let mut row = |head: &'static str, cell: &dyn Fn(&Outcome) -> String| {
        rows.push((head, engines.iter().map(cell).collect()));
    };
    let dash = || "-".to_owned();
    let of_window = |outcome: &Outcome, count: u64| match outcome.has_reply_window {
        true => count.to_string(),
        false => dash(),
    };

    row("", &|o| o.name.to_owned());
    row("targets reached", &|o| {
        match (&o.flown, o.played) {
            (_, Some(_)) => "played",
            (Some(Ok(())), None) => "yes",
            (Some(Err(_)), None) => "NO",
            (None, None) if !o.has_pilot => "-",
            (None, None) => "cut short",
        }
        .to_owned()
    });
    row("frames sent by the ECU", &|o| o.ecu.frames.to_string());
    row("frames received by node", &|o| o.node.frames.to_string());
    row("commands sent by the node", &|o| o.audit.frames.to_string());
    row("commands accepted by ECU", &|o| o.ecu.accepted.to_string());
    row("unsolicited commands", &|o| if o.audit.judged { o.audit.not_given.to_string() } else { dash() });
    row("replies inside the window", &|o| of_window(o, o.ecu.in_window));
    row("replies outside the window", &|o| of_window(o, o.ecu.late));
    row("windows without a reply", &|o| of_window(o, o.ecu.unanswered));
    row("worst reply margin", &|o| o.ecu.worst_margin.map(Duration::from_nanos).map_or_else(dash, millis));
    row("worst cadence error", &|o| {
        o.audit.worst_cadence_error.map_or_else(dash, |error| millis(Duration::from_nanos(error)))
    });
    row("missed send slots", &|o| {
        if o.has_reply_window { dash() } else { o.node.send_slots_missed.to_string() }
    });
    row("decode errors of the node", &|o| decode_errors(&o.node).to_string());
    row("bad commands at the ECU", &|o| o.ecu.bad.to_string());
    row("commands rejected", &|o| o.commands_rejected.to_string());
    row("uncommanded shutdowns", &|o| o.stops.to_string());
    if !outcomes.is_scenario && engines.iter().any(|outcome| !outcome.line_was_clean) {
        row("link up after the faults", &|o| {
            o.recovered_after.map_or_else(dash, |after| format!("{:.2} s", seconds(after)))
        });
    }
    rows
}

/// Writes it all. `ended_by` is who ended it before its time; `width` is that of the screen.
pub fn text(outcomes: &Outcomes, problems: &[String], ended_by: Option<EndedBy>, width: usize) -> String {
    let beside = (width.saturating_sub(HEAD) / ENGINE).clamp(1, MOST_BESIDE);
    let engines = &outcomes.engines;
    let rows = rows(outcomes);
    let mut text = format!("\nSummary after {:.1} s of engine time\n", seconds(outcomes.length));
    for first in (0..engines.len()).step_by(beside) {
        for (head, cells) in &rows {
            let mut line = format!("{:<HEAD$}", format!("  {head}"));
            for cell in cells.iter().skip(first).take(beside) {
                line += &format!("{cell:>ENGINE$}");
            }
            text += line.trim_end();
            text.push('\n');
        }
    }

    if let Some(reception) = outcomes.reception {
        text += &format!("  radio control: {reception}\n");
    }
    if !outcomes.checks.is_empty() {
        text += "\nExpected events, by what was on the wires and what the simulated engines did\n";
        for check in &outcomes.checks {
            let check = format!("  {:<6} {}", if check.held { "yes" } else { "NO" }, check.what);
            for line in wrapped(&check, width, CHECK, '…') {
                text += &line;
                text.push('\n');
            }
        }
    }

    text.push('\n');
    if engines.iter().any(|outcome| outcome.has_reply_window) {
        let windows: u64 = engines.iter().map(|outcome| outcome.ecu.in_window).sum();
        let missed: u64 = engines.iter().map(missed).sum();
        let worst =
            engines.iter().filter_map(|outcome| outcome.ecu.worst_margin).min().map(Duration::from_nanos);
        let worst = worst.map_or_else(String::new, |worst| format!(", worst margin {}", millis(worst)));
        text += &format!("{windows} replies in time, {missed} missed{worst}\n");
    }
    if let Some(by) = ended_by {
        text += &format!("The run was ended by {} before it was complete.\n", by.name());
    }
    for problem in problems {
        text += &format!("FAILED  {problem}\n");
    }
    if problems.is_empty() && matches!(outcomes.end, End::Complete | End::Over) {
        text += pass(outcomes);
        text.push('\n');
    }
    text
}

/// The same text on a screen of this width: the sentences at its end are broken between words. A command stays whole.
pub fn on_screen(text: &str, width: usize, mark: char) -> String {
    let broken = |line: &str| -> Vec<String> {
        match ["PASS: ", "FAILED  "].into_iter().find(|head| line.starts_with(head)) {
            Some(head) => wrapped(line, width, head.len(), mark),
            None => vec![line.to_owned()],
        }
    };
    text.lines().flat_map(broken).map(|line| line + "\n").collect()
}

/// Results of a run without a problem.
pub fn pass(outcomes: &Outcomes) -> &'static str {
    if outcomes.is_played() && outcomes.is_scenario {
        "STOPPED by hand: no unsolicited command; what was expected is not judged."
    } else if outcomes.is_played() {
        "PASS: no unsolicited command, no uncommanded ignition, no late stop, no window missed outside of the \
         faults."
    } else if outcomes.end == End::Over {
        over(outcomes)
    } else if !outcomes.is_scenario {
        "PASS: all engines reached their targets and are shut down."
    } else {
        "PASS: all expected events occurred, and all engines are shut down."
    }
}

/// The same if the time was over before anything was complete: the results up to then.
fn over(outcomes: &Outcomes) -> &'static str {
    let commands = outcomes.engines.iter().any(|outcome| outcome.audit.judged);
    let lines = outcomes.engines.iter().any(|outcome| outcome.line_was_clean);
    match (commands, lines) {
        (true, true) => {
            "PASS: no unsolicited command, and no reply window missed on a clean line; targets are not judged."
        }
        (true, false) => "PASS: no unsolicited command; targets are not judged.",
        (false, true) => {
            "PASS: no reply window missed on a clean line; commands from outside and targets are not judged."
        }
        (false, false) => "NOT JUDGED: commands came from outside, and faults were on the lines.",
    }
}

fn missed(outcome: &Outcome) -> u64 {
    outcome.ecu.late + outcome.ecu.unanswered
}

#[cfg(test)]
mod tests {
    use super::super::outcome::Check;
    use super::*;

    #[test]
    fn what_did_not_happen_fails_the_run() {
        let check = |held| Check { what: "it stops".to_owned(), held };
        let outcomes = |checks| Outcomes {
            engines: Vec::new(),
            length: Duration::MIN,
            end: End::Complete,
            checks,
            bad_commands: 0,
            actions: Vec::new(),
            by_key: false,
            reception: None,
            is_scenario: true,
        };
        let good = outcomes(vec![check(true)]);
        assert_eq!(problems(&good), Vec::<String>::new());
        let bad = outcomes(vec![check(true), check(false)]);
        let found = problems(&bad);
        assert_eq!(found, ["expected, and did not occur: it stops"]);
        let text = text(&bad, &found, None, 80);
        assert!(
            text.contains("  NO     it stops") && text.contains("FAILED  expected, and did not"),
            "{text}"
        );
    }

    #[test]
    fn sentences_are_broken_for_a_screen_and_commands_are_not() {
        let command = "To play it again: cargo rig --script /tmp/jetlink-rig-1.txt --fast\n";
        let text = format!("FAILED  left: the start failed: the ECU reports no state\n{command}");
        let broken = "FAILED  left: the start failed: the ECU\n        reports no state\n";
        assert_eq!(on_screen(&text, 40, '…'), format!("{broken}{command}"));
        assert_eq!(on_screen(&text, 80, '…'), text);
    }
}
