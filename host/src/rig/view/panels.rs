//! A panel for an engine: gauges with their limits, what is commanded and sent, the link.

use super::super::row::millis;
use super::super::sample::Sample;
use super::model::{Model, Subject};
use super::rows;
use super::theme::{Theme, Tone, cut};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph};

/// Lines of a panel, its border included.
pub const HEIGHT: u16 = 10;
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
    let title = cut(&theme.text(&subject.engine.caption()), usize::from(area.width.saturating_sub(4)), theme);
    let title =
        Span::styled(format!(" {title} "), theme.style(if selected { Tone::Selected } else { Tone::Head }));
    let block = Block::bordered().border_set(theme.border()).border_style(theme.style(tone)).title(title);
    let inside = block.inner(area);
    frame.render_widget(block, area);
    let texts = texts(model, theme, engine, subject, sample, usize::from(inside.width));
    frame.render_widget(Paragraph::new(texts), inside);
}

fn texts(
    model: &Model,
    theme: Theme,
    engine: usize,
    subject: &Subject,
    sample: &Sample,
    width: usize,
) -> Vec<Line<'static>> {
    let styled = |text: String, tone| Span::styled(cut(&theme.text(&text), width, theme), theme.style(tone));
    let line = |text: String, tone| Line::from(styled(text, tone));
    let bar = width.saturating_sub(BESIDE_GAUGE);
    let gauge = |name: &str, value: Option<f64>, unit: &str, full: f64, limit: Option<f64>, tone| {
        let shown = value.map_or_else(|| "-".to_owned(), |value| format!("{value:.0}{unit}"));
        let bar = if bar < LEAST_GAUGE {
            String::new()
        } else {
            theme.gauge(bar, value.unwrap_or(0.0) / full, limit.map(|limit| limit / full))
        };
        let text = format!("{name:<4} {:>9} ", theme.text(&shown));
        Line::from(vec![Span::raw(text), Span::styled(bar, theme.style(tone))])
    };
    let hot = subject.egt_limit.zip(sample.egt).is_some_and(|(limit, egt)| egt > limit);
    let egt_full = subject.egt_limit.map_or(900.0, |limit| limit * 1.1);
    let counters = &sample.counters;
    let rate = model.rates.get(engine).copied().unwrap_or_default();
    let timing = match (counters.worst_reply_margin, counters.worst_slot_delay) {
        (Some(margin), _) => format!("worst reply margin {}", millis(margin)),
        (None, Some(delay)) => format!("worst slot delay {}", millis(delay)),
        (None, None) => "nothing sent yet".to_owned(),
    };
    let missed = sample.missed();
    let errors = sample.decode_errors();
    let faults = sample.faults.filter(|faults| !faults.is_empty()).map(|faults| faults.to_string());
    let by_hand = model.details.get(engine).filter(|detail| !detail.faults.is_empty());
    let last = match (faults, by_hand) {
        (Some(faults), _) => (format!("FAULT: {faults}"), Tone::Bad),
        (None, Some(detail)) => {
            let names: Vec<String> =
                detail.faults.iter().map(|fault| format!("{fault:?}").to_lowercase()).collect();
            (format!("set by you: {}", names.join(", ")), Tone::Warn)
        }
        (None, None) => (
            format!("{}, {}", sample.stage.name(), if sample.armed { "armed" } else { "not armed" }),
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
            rows::state(sample),
        ),
        gauge(
            "EGT",
            sample.egt,
            " °C",
            egt_full,
            subject.egt_limit,
            if hot { Tone::Bad } else { Tone::Busy },
        ),
        line(
            format!("commanded {}, sent {}", rows::commanded(sample), sample.wire_text()),
            if sample.silent { Tone::Warn } else { Tone::Plain },
        ),
        line(format!("source {}", sample.rules_text()), rows::source(sample)),
        line(
            format!("link {} {rate:.0}/s, {errors} errors, {missed} missed", sample.link_name()),
            if missed > 0 { Tone::Bad } else { rows::link(sample) },
        ),
        line(timing, Tone::Plain),
        line(last.0, last.1),
    ]
}
