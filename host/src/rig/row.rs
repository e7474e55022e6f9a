//! One engine as a row of text: for the lines and for the table.

use super::sample::Sample;
use embassy_time::Duration;

/// Heads of the columns, with their widths.
pub const COLUMNS: [(&str, usize); 11] = [
    ("engine", 12),
    ("progress", 8),
    ("state", 25),
    ("rules", 18),
    ("armed", 5),
    ("rpm", 7),
    ("EGT", 7),
    ("demand", 11),
    ("link", 12),
    ("errors", 6),
    ("worst timing", 16),
];

/// The heads of the columns in one line.
pub fn heads() -> String {
    align(&COLUMNS.map(|(head, _)| head.to_owned()))
}

/// One engine in one line. `frames_per_second` is what came from the ECU lately.
pub fn row(name: &str, sample: &Sample, frames_per_second: f64) -> String {
    let dash = || "-".to_owned();
    let counters = &sample.counters;
    let timing = match (counters.worst_reply_margin, counters.worst_turn_delay) {
        (Some(margin), _) => format!("margin {}", millis(margin)),
        (None, Some(delay)) => format!("delay {}", millis(delay)),
        (None, None) => dash(),
    };
    let missed = sample.missed();
    align(&[
        name.to_owned(),
        sample.stage.name().to_owned(),
        sample.does_text(),
        sample.rules_text(),
        if sample.armed { "yes" } else { "no" }.to_owned(),
        sample.rpm.map_or_else(dash, |rpm| rpm.to_string()),
        sample.egt.map_or_else(dash, |egt| format!("{egt:.0} °C")),
        if sample.silent { "silent".to_owned() } else { sample.lever.to_string() },
        format!("{} {frames_per_second:.0}/s", sample.link_name()),
        sample.decode_errors().to_string(),
        if missed == 0 { timing } else { format!("{missed} MISSED, {timing}") },
    ])
}

/// A time in milliseconds.
pub fn millis(time: Duration) -> String {
    format!("{:.3} ms", time.as_micros() as f64 / 1000.0)
}

fn align(cells: &[String; COLUMNS.len()]) -> String {
    let mut line = String::new();
    for (cell, (head, width)) in cells.iter().zip(COLUMNS) {
        let right = matches!(head, "rpm" | "EGT" | "demand" | "errors");
        let width = width.max(head.len());
        line += &if right { format!("{cell:>width$}  ") } else { format!("{cell:<width$}  ") };
    }
    line.truncate(line.trim_end().len());
    line
}
