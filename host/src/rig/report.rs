//! The report of a run: one page for a browser, with its data, style and script inside. It works offline.

use super::audit::WireCommand;
use super::chronicle::{Chronicle, Subject};
use super::ending::{EndRequest, EndedBy};
use super::outcome::{End, Outcomes};
use super::output::Whole;
use super::quantity::seconds;
use super::record::{Band, Point, thinned};
use super::summary;
use embassy_time::Instant;
use serde_json::{Value, json};

const PAGE: &str = include_str!("report/page.html");
const STYLE: &str = include_str!("report/page.css");
const SCRIPT: &str = include_str!("report/page.js");

/// Points of an engine: eight engines and six hours stay below 5 MB.
const MOST_POINTS: usize = 8000;
/// Room above the highest value.
const HEADROOM: f64 = 1.08;

/// A report that is to be written at the end of the run.
#[derive(Debug)]
pub struct Report {
    file: Whole,
    /// Version and seed.
    about: String,
}

impl Report {
    /// To be written here.
    pub fn new(path: &str, about: String, end: &EndRequest) -> Self {
        Self { file: Whole::new(path, end), about }
    }

    /// Writes it.
    pub fn finish(
        self,
        chronicle: &Chronicle,
        outcomes: &Outcomes,
        problems: &[String],
        ended_by: Option<EndedBy>,
    ) -> Result<(), String> {
        let page = page(&run(&self.about, chronicle, outcomes, problems, ended_by));
        self.file.finish(&page)
    }
}

/// The page around its data, in which no `</script>` ends anything.
fn page(run: &Value) -> String {
    let run = run.to_string().replace('<', "\\u003c");
    // The data last: its contents are not searched.
    PAGE.replace("/*STYLE*/", STYLE).replace("/*SCRIPT*/", SCRIPT).replace("/*RUN*/", &run)
}

fn run(
    about: &str,
    chronicle: &Chronicle,
    outcomes: &Outcomes,
    problems: &[String],
    ended_by: Option<EndedBy>,
) -> Value {
    let Chronicle { title, subjects, record, happened, notes, dropped, .. } = chronicle;
    let counted = summary::rows(outcomes);
    let name = |engine: Option<usize>| engine.and_then(|engine| subjects.get(engine)).map(|s| s.name);
    let mut each = 1;
    let engines: Vec<Value> = subjects
        .iter()
        .enumerate()
        .map(|(i, subject)| {
            let all = record.points(i);
            let points = thinned(all, MOST_POINTS);
            each = each.max(record.samples_a_point() as usize * all.len().div_ceil(points.len().max(1)));
            let mut engine = engine(subject, &points);
            let cells = counted.iter().skip(1); // the first row has the names
            engine["counted"] =
                cells.filter_map(|(head, cells)| Some(json!([head, cells.get(i)?]))).collect();
            engine["verdict"] = of_engine(subject.name, outcomes, problems);
            engine
        })
        .collect();
    json!({
        "title": title.to_string(),
        "about": about,
        "from": 0,
        "to": chronicle.end(),
        "bands": (each > 1).then(|| {
            format!("A long run: each point covers {:.1} s, drawn as a band from least to most.", each as f64 / 10.0)
        }),
        "verdict": of_run(subjects, outcomes, problems, ended_by),
        "engines": engines,
        "happened": happened.iter().map(|h| json!([tenths(h.t), name(h.engine), h.text])).collect::<Vec<_>>(),
        "events": notes
            .iter()
            .map(|note| json!([tenths(seconds(note.at - Instant::MIN)), name(note.engine), note.text]))
            .collect::<Vec<_>>(),
        "dropped": dropped,
    })
}

/// Outcome of one engine.
fn of_engine(name: &str, outcomes: &Outcomes, problems: &[String]) -> Value {
    let own: Vec<&str> =
        problems.iter().filter_map(|problem| problem.strip_prefix(name)?.strip_prefix(": ")).collect();
    let played = outcomes.engines.iter().any(|outcome| outcome.name == name && outcome.played.is_some());
    let text = match (own.is_empty(), &outcomes.end) {
        (false, _) => "FAILED",
        (true, End::Complete) if played && outcomes.is_scenario => "stopped by hand",
        (true, End::Complete) if played => "PASS: played, and nothing happened that no pilot can cause",
        (true, End::Complete) if outcomes.is_scenario => "PASS: nothing that must not happen did",
        (true, End::Complete) => "PASS: reached its targets, and is shut down",
        (true, _) => "ended early; nothing had gone wrong until then",
    };
    json!({ "text": text, "failed": !own.is_empty(), "problems": own })
}

/// The outcome of the run, with findings that concern no single engine.
fn of_run(
    subjects: &[Subject],
    outcomes: &Outcomes,
    problems: &[String],
    ended_by: Option<EndedBy>,
) -> Value {
    let of_an_engine = |problem: &&String| {
        subjects.iter().any(|s| problem.strip_prefix(s.name).is_some_and(|rest| rest.starts_with(": ")))
    };
    let own: Vec<&String> = problems.iter().filter(|problem| !of_an_engine(problem)).collect();
    let text = match (problems.is_empty(), &outcomes.end, ended_by) {
        (false, ..) => format!("FAILED after {:.1} s of engine time", seconds(outcomes.length)),
        (true, End::Complete | End::Over, _) => summary::pass(outcomes).to_owned(),
        (true, _, Some(by)) => format!("The run was ended by {} before it was complete.", by.name()),
        (true, _, None) => "The run was not complete.".to_owned(),
    };
    json!({ "text": text, "failed": !problems.is_empty(), "problems": own })
}

/// Curves of one engine, a column for each value.
fn engine(subject: &Subject, points: &[Point]) -> Value {
    let most = |value: fn(&Point) -> Option<Band>, least: f64| {
        points.iter().filter_map(value).map(|band| band.most).fold(least, f64::max) * HEADROOM
    };
    let t: Vec<Value> = points.iter().map(|point| tenths(point.t)).collect();
    let flags: Vec<u8> = points
        .iter()
        .map(|point| {
            let all = [point.rpm_old, point.egt_old, point.silent, point.link, point.fault];
            all.into_iter().rev().fold(0, |flags, flag| flags << 1 | u8::from(flag))
        })
        .collect();
    json!({
        "name": subject.name,
        "caption": subject.caption,
        "by_rpm": subject.by_rpm,
        "egt_limit": subject.egt_limit,
        "most_rpm": most(|point| point.rpm, subject.max_rpm),
        "most_egt": most(|point| point.egt, subject.egt_limit.unwrap_or(100.0)),
        "t": t,
        "flags": flags,
        "stages": changes(points, |point| point.stage.name()),
        "wire": changes(points, |point| match point.on_wire {
            None => "nothing",
            Some(WireCommand::Nothing) => "no command",
            Some(WireCommand::Stop) => "emergency stop",
            Some(WireCommand::Standby) => "standby",
            Some(WireCommand::Run(_) | WireCommand::RunRpm(_)) => "run",
        }),
        "rpm": column(points, |point| point.rpm),
        "egt": column(points, |point| point.egt),
        "commanded": column(points, |point| point.throttle),
        "commanded_rpm": column(points, |point| point.demand_rpm),
        "sent": column(points, |point| point.sent_throttle),
        "sent_rpm": column(points, |point| point.sent_rpm),
    })
}

/// A value of all points: the lowest of each, and the distance of the highest above it.
fn column(points: &[Point], value: impl Fn(&Point) -> Option<Band>) -> [Vec<Value>; 2] {
    let least = points.iter().map(|point| value(point).map_or(Value::Null, |band| tenths(band.least)));
    let above = points.iter().map(|point| tenths(value(point).map_or(0.0, |band| band.most - band.least)));
    [least.collect(), above.collect()]
}

/// Points at which a name changes, with the new name.
fn changes(points: &[Point], name: impl Fn(&Point) -> &'static str) -> Vec<(usize, &'static str)> {
    let mut changes: Vec<(usize, &'static str)> = Vec::new();
    for (i, point) in points.iter().enumerate() {
        let name = name(point);
        if changes.last().is_none_or(|(_, last)| *last != name) {
            changes.push((i, name));
        }
    }
    changes
}

/// A number with one decimal, as short as possible.
fn tenths(value: f64) -> Value {
    let tenths = (value * 10.0).round() as i64;
    if tenths % 10 == 0 { json!(tenths / 10) } else { json!(tenths as f64 / 10.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_of_the_run_ends_the_data() {
        let page = page(&json!({ "title": "</script><script>alert(1)</script>/*STYLE*/" }));
        assert_eq!(page.matches("<script").count(), 2);
        assert_eq!(page.matches("</script>").count(), 2);
        assert_eq!(page.matches(STYLE).count(), 1);
        let (_, data) = page.split_once("type=\"application/json\">\n").expect("the data");
        let (data, _) = data.split_once("\n</script>").expect("its end");
        let read: Value = serde_json::from_str(data).expect("JSON");
        assert_eq!(read["title"], "</script><script>alert(1)</script>/*STYLE*/");
    }

    #[test]
    fn numbers_are_short() {
        let text = |value| tenths(value).to_string();
        assert_eq!([text(0.0), text(66_000.0), text(12.34), text(-0.25)], ["0", "66000", "12.3", "-0.3"]);
    }
}
