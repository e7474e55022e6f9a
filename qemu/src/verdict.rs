//! Judges the trial by the firmware's log and by the ECUs' own counters.

use crate::ecu::{Attached, WIDE_WINDOW};
use crate::log::{Line, Lines};
use jetlink_fw::config::ENGINES;
use sim::ecu::{MILLIS, Nanos};
use sim::turbine::Phase;

/// Largest number of sets of an AMT ECU without a reply in time: QEMU's time is the host's, and a busy host may stop it for a
/// while. Three consecutive ones are far from the 2 s after which the ECU stops its engine.
const UNANSWERED: u64 = 3;

/// What is printed at the end: a line for each ECU, and the log only where something failed.
pub fn report(log: &Lines, ecus: &[Attached], faults: &[String], seconds: f64) -> String {
    let mut lines: Vec<String> = ecus.iter().map(summary).collect();
    if faults.is_empty() {
        lines.push(format!("PASS in {seconds:.1} s: {} log lines, {} engines", log.lines.len(), ecus.len()));
    } else {
        let of_log = |line: &Line| format!("{:>11} {:<5} {}", line.time, line.level, line.message);
        lines.extend(log.lines.iter().map(of_log));
        lines.extend(faults.iter().map(|fault| format!("- {fault}")));
    }
    lines.join("\n")
}

/// Faults in the log.
pub fn of_log(log: &Lines) -> Vec<String> {
    let mut faults = Vec::new();
    let mut check = |good: bool, what: String| {
        if !good {
            faults.push(format!("log: {what}"));
        }
    };
    check(log.malformed == 0, format!("{} malformed frames", log.malformed));
    let boots = log.lines.iter().filter(|line| line.message.starts_with("jetlink ")).count();
    check(boots == 1, format!("the firmware started {boots} times"));
    for line in log.lines.iter().filter(|line| matches!(line.level, "WARN" | "ERROR")) {
        check(false, format!("{} {}", line.level, line.message));
    }
    for engine in &ENGINES {
        let story = [
            "ECU link up",
            "ECU reports standby",
            "ECU reports starting",
            "ECU reports running",
            "ECU reports standby",
        ];
        let mut lines = log.lines.iter();
        for chapter in story {
            let wanted = format!("{}: {chapter}", engine.name);
            if !lines.any(|line| line.message == wanted) {
                check(false, format!("`{wanted}` is missing or out of order"));
                break;
            }
        }
        for unwanted in ["ECU link lost", "run cancelled"] {
            // The text may continue with a reason.
            let line = format!("{}: {unwanted}", engine.name);
            check(
                log.lines.iter().all(|other| !other.message.starts_with(&line)),
                format!("unexpected: `{line}`"),
            );
        }
    }
    check(
        log.lines.last().is_some_and(|line| line.message == "trial: passed"),
        "it does not end with `trial: passed`".into(),
    );
    faults
}

/// Faults in the observations of an ECU.
pub fn of_ecu(attached: &Attached) -> Vec<String> {
    let mut faults = Vec::new();
    let mut check = |good: bool, what: &str| {
        if !good {
            faults.push(format!("{}: {what}", attached.engine.name));
        }
    };
    check(attached.odd == 0, "it received bytes outside of commands");
    check(attached.phases.contains(&Phase::Running), "its turbine never ran");
    check(attached.phases.last() == Some(&Phase::Standby), "its turbine is not in standby at the end");
    attached.ecu.host_faults().into_iter().for_each(|fault| check(false, fault));
    let counts = attached.ecu.counts();
    check(counts.late + counts.unanswered <= UNANSWERED, "too many of its frames without a reply in time");
    check(counts.frames > 100, "it sent fewer than 100 frames");
    faults
}

/// Observations of an ECU in one line.
pub fn summary(attached: &Attached) -> String {
    let counts = attached.ecu.counts();
    let ms = |time: Nanos| time as f64 / MILLIS as f64;
    let mut text =
        format!("{}: {} frames, {} commands accepted", attached.engine.name, counts.frames, counts.accepted);
    if let Some(margin) = counts.worst_margin {
        let slowest = ms(WIDE_WINDOW.saturating_sub(margin));
        let (late, missing) = (counts.late, counts.unanswered);
        text += &format!(", {late} late, {missing} missing; the slowest ended after {slowest:.1} ms");
    }
    if let Some((shortest, longest)) = counts.intervals {
        text += &format!(", {:.1} to {:.1} ms apart", ms(shortest), ms(longest));
    }
    text + ", including delays of the host"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ecu::Turbine;

    fn good() -> Lines {
        let mut lines = vec!["jetlink 0.1.0 on QEMU".to_owned()];
        for chapter in [
            "ECU link up",
            "ECU reports standby",
            "ECU reports starting",
            "ECU reports running",
            "ECU reports standby",
        ] {
            lines.extend(ENGINES.iter().map(|engine| format!("{}: {chapter}", engine.name)));
        }
        lines.push("trial: passed".into());
        let line = |message| Line { time: String::new(), level: "INFO", message };
        Lines { lines: lines.into_iter().map(line).collect(), malformed: 0 }
    }

    #[test]
    fn a_pass_is_a_few_lines_and_a_failure_has_the_log() {
        let ecus: Vec<Attached> =
            ENGINES.iter().enumerate().map(|(i, engine)| Attached::new(i, engine, Turbine::Quick)).collect();
        let log = good();
        let passed = report(&log, &ecus, &[], 50.0);
        assert_eq!(passed.lines().count(), ENGINES.len() + 1, "{passed}");
        assert!(passed.ends_with(&format!("{} log lines, {} engines", log.lines.len(), ENGINES.len())));
        let failed = report(&log, &ecus, &["log: it is cold".to_owned()], 50.0);
        assert_eq!(failed.lines().count(), ENGINES.len() + log.lines.len() + 1, "{failed}");
        assert!(failed.ends_with("trial: passed\n- log: it is cold"), "{failed}");
    }

    #[test]
    fn a_good_log_passes() {
        assert_eq!(of_log(&good()), [""; 0]);
    }

    #[test]
    fn every_line_of_a_good_log_is_needed() {
        for i in 0..good().lines.len() {
            let mut log = good();
            log.lines.remove(i);
            assert!(!of_log(&log).is_empty(), "not missed: line {i}");
        }
    }

    #[test]
    fn what_must_not_be_there_is_found() {
        for (level, message) in [
            ("WARN", "left: 3 events lost"),
            ("ERROR", "panic"),
            ("INFO", "left: ECU link lost"),
            ("INFO", "left: run cancelled: the ECU reports an engine at rest"),
            ("INFO", "jetlink "),
        ] {
            let mut log = good();
            log.lines.insert(3, Line { time: String::new(), level, message: message.into() });
            assert_eq!(of_log(&log).len(), 1, "{message}");
        }
        assert_eq!(of_log(&Lines { malformed: 1, ..good() }).len(), 1);
    }
}
