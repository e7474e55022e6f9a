//! A panel for an engine: gauges with their limits, the commanded and the sent demand, the link.

use super::super::context::Stage;
use super::super::fit::{first_that_fits, listed};
use super::super::row::millis;
use super::super::sample::Sample;
use super::model::{Model, Subject};
use super::rows;
use super::theme::{Theme, Tone};
use jetlink::report::LinkState;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph};

/// Lines of a panel, its border included.
pub const HEIGHT: u16 = 10;
/// Lines of text in a panel.
const TEXTS: u16 = HEIGHT - 2;
/// The fewest lines of one in which all texts have room beside one another, its border included.
pub const LEAST_HEIGHT: u16 = 2 + TEXTS / 2;
/// A column of text is no narrower than this.
const LEAST_COLUMN: u16 = 28;
/// Panels beside one another.
const BESIDE: u16 = 4;
/// Beside a gauge: its name and its value.
const BESIDE_GAUGE: usize = 16;
/// The shortest gauge that is worth its room.
const LEAST_GAUGE: usize = 4;

/// Lines of panels.
pub fn lines(model: &Model, _width: u16) -> u16 {
    u16::try_from(model.subjects.len()).unwrap_or(BESIDE).div_ceil(BESIDE)
}

/// Draws one for each engine.
pub fn draw_all(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let count = model.subjects.len();
    let beside = count.min(BESIDE.into()).max(1);
    let lines = lines(model, area.width).max(1);
    for (line, place) in
        Layout::vertical(vec![Constraint::Fill(1); lines.into()]).split(area).iter().enumerate()
    {
        let places = Layout::horizontal(vec![Constraint::Fill(1); beside]).split(*place);
        for (i, place) in places.iter().enumerate() {
            let engine = line * beside + i;
            if engine < count {
                draw(model, theme, frame, *place, engine);
            }
        }
    }
}

/// Draws that of one engine.
pub fn draw(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect, engine: usize) {
    let (Some(subject), Some(sample)) = (model.subjects.get(engine), model.samples.get(engine)) else {
        return;
    };
    model.places.borrow_mut().push((area, engine));
    let selected = engine == model.selected;
    let tone = if selected { Tone::Head } else { Tone::Quiet };
    let title = theme.text(&subject.engine.caption());
    let short = title.replace(" AMT ", " ").replace(" version ", " ");
    let ecu = short.rsplit_once(", ").map_or(short.as_str(), |(ecu, _)| ecu).to_owned();
    let titles = [title, short, ecu];
    let title = first_that_fits(&titles, usize::from(area.width.saturating_sub(4)), theme.mark());
    let title =
        Span::styled(format!(" {title} "), theme.style(if selected { Tone::Selected } else { Tone::Head }));
    let block = Block::bordered().border_set(theme.border()).border_style(theme.style(tone)).title(title);
    let inside = block.inner(area);
    frame.render_widget(block, area);
    // Texts without room below go into a second column.
    if inside.height < TEXTS && inside.width >= 2 * LEAST_COLUMN {
        let [left, right] = Layout::horizontal([Constraint::Fill(1); 2]).spacing(1).areas(inside);
        let mut texts = texts(model, theme, engine, subject, sample, right.width.into());
        let beside = texts.split_off(texts.len() / 2);
        frame.render_widget(Paragraph::new(texts), left);
        frame.render_widget(Paragraph::new(beside), right);
        return;
    }
    let texts = texts(model, theme, engine, subject, sample, inside.width.into());
    frame.render_widget(Paragraph::new(texts), inside);
}

/// Who flies the engine, and the stage of its script.
fn stage(stage: Stage) -> String {
    match stage {
        Stage::Commanded => "no script".to_owned(),
        Stage::Played => "played by you".to_owned(),
        script => format!("script: {}", script.name()),
    }
}

fn texts(
    model: &Model,
    theme: Theme,
    engine: usize,
    subject: &Subject,
    sample: &Sample,
    width: usize,
) -> Vec<Line<'static>> {
    let styled = |text: String, tone| Span::styled(theme.cut(&text, width), theme.style(tone));
    // Without colours a mark shows a fault.
    let sign = |text: &str, tone| match theme.sign(tone) {
        Some(sign) if tone != Tone::Quiet => format!("{text}{sign}"),
        _ => text.to_owned(),
    };
    let line = |text: String, tone| Line::from(styled(sign(&text, tone), tone));
    let first = |texts: &[String], tone| {
        let texts: Vec<String> = texts.iter().map(|text| theme.text(&sign(text, tone))).collect();
        Line::from(Span::styled(first_that_fits(&texts, width, theme.mark()), theme.style(tone)))
    };
    let list = |head: &str, names: &[String]| listed(head, names, width, theme.mark());
    let bar = width.saturating_sub(BESIDE_GAUGE);
    let gauge = |name: &str, value: Option<f64>, unit: &str, full: f64, limit: Option<f64>, tone| {
        let shown = value.map_or_else(|| "-".to_owned(), |value| format!("{value:.0}{unit}"));
        let bar = if bar < LEAST_GAUGE {
            String::new()
        } else {
            theme.gauge(bar, value.unwrap_or(0.0) / full, limit.map(|limit| limit / full))
        };
        let mark = theme.sign(tone).filter(|_| value.is_some()).unwrap_or(' ');
        let text = format!("{name:<4} {:>9}{mark}", theme.text(&shown));
        let text_tone = if tone == Tone::Quiet { tone } else { Tone::Plain };
        Line::from(vec![Span::styled(text, theme.style(text_tone)), Span::styled(bar, theme.style(tone))])
    };
    let hot = subject.egt_limit.zip(sample.egt).is_some_and(|(limit, egt)| egt > limit);
    let egt_full = subject.egt_limit.map_or(900.0, |limit| limit * 1.1);
    let counters = &sample.counters;
    let rate = model.rates.of(engine).filter(|_| sample.link == LinkState::Up);
    let rate = rate.map_or_else(String::new, |rate| format!(" {rate:.0}/s"));
    let timing = match (counters.worst_reply_margin, counters.worst_slot_delay) {
        (Some(margin), _) => format!("worst reply margin {}", millis(margin)),
        (None, Some(delay)) => format!("worst slot delay {}", millis(delay)),
        (None, None) => "nothing sent yet".to_owned(),
    };
    let missed = sample.missed_by_either();
    let errors = sample.decode_errors();
    let faults = sample.faults.filter(|faults| !faults.is_empty()).map(|faults| faults.to_string());
    let (commanded, sent) = (rows::commanded(sample), sample.wire_text());
    let demand = [
        format!("commanded {commanded}, sent {sent}"),
        format!("cmd {commanded}, sent {sent}"),
        format!("cmd {}, sent {sent}", commanded.trim_end_matches(" rpm")),
    ];
    let name = sample.link_name();
    let few = if errors < 10_000 { errors.to_string() } else { format!("{}k", errors / 1000) };
    let link = [
        format!("link {name}{rate}, {errors} errors, {missed} missed"),
        format!("{name}{rate}, {few} err, {missed} missed"),
        format!("{name}{rate} {few} err {missed} miss"),
    ];
    let by_hand = model.details.get(engine).filter(|detail| !detail.faults.is_empty());
    let last = match (faults, by_hand) {
        (Some(faults), _) => {
            let names: Vec<String> = faults.split(", ").map(str::to_owned).collect();
            (list("FAULT: ", &names), Tone::Bad)
        }
        (None, Some(detail)) => {
            let names: Vec<String> = detail.faults.iter().map(|fault| fault.name().to_owned()).collect();
            (list("set by you: ", &names), Tone::Warn)
        }
        (None, None) => (
            format!("{}, {}", stage(sample.stage), if sample.armed { "armed" } else { "not armed" }),
            Tone::Quiet,
        ),
    };
    vec![
        line(sample.does_text(), rows::state(sample)),
        gauge(
            "rpm",
            sample.rpm.map(f64::from),
            "",
            subject.max_rpm * 1.05,
            Some(subject.max_rpm),
            rows::unless_old(rows::state(sample), sample.rpm_old),
        ),
        gauge(
            "EGT",
            sample.egt,
            " °C",
            egt_full,
            subject.egt_limit,
            rows::unless_old(if hot { Tone::Bad } else { Tone::Busy }, sample.egt_old),
        ),
        first(&demand, if sample.silent { Tone::Warn } else { Tone::Plain }),
        line(format!("source {}", sample.in_control_text()), rows::source(sample)),
        first(&link, if missed > 0 { Tone::Bad } else { rows::link(sample) }),
        line(timing, Tone::Plain),
        line(last.0, last.1),
    ]
}
