//! Draws the screen: which parts there are, by its size.

use super::super::quantity::seconds;
use super::super::story;
use super::model::{Model, Page, Popup, Verdict};
use super::theme::{Theme, Tone, cut};
use super::{charts, panels, popup, rows, why, wire};
use embassy_time::Instant;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Paragraph, Wrap};

/// Smaller than this nothing can be shown.
const LEAST: (u16, u16) = (60, 16);
/// From this on there is a panel for each engine.
const PANELS: (u16, u16) = (120, 30);
/// From this on there are charts, too.
const CHARTS: (u16, u16) = (200, 50);
/// Events below the engines, with their heading.
const EVENTS: u16 = 6;

/// Draws all of it.
pub fn draw(model: &Model, theme: Theme, frame: &mut Frame<'_>) {
    let area = frame.area();
    model.places.borrow_mut().clear();
    if area.width < LEAST.0 || area.height < LEAST.1 {
        let text = format!(
            "This terminal has {} columns and {} lines, the rig needs {} and {}. The keys still work: Space stops all \
             engines, q ends.",
            area.width, area.height, LEAST.0, LEAST.1
        );
        frame.render_widget(Paragraph::new(theme.text(&text)).wrap(Wrap { trim: true }), area);
        return;
    }
    let [head, story, body, foot] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(1),
        Constraint::Min(0),
        Constraint::Length(1),
    ])
    .areas(area);
    frame.render_widget(header(model, theme, head.width), head);
    frame.render_widget(story_line(model, theme), story);
    frame.render_widget(footer(model, theme, foot.width), foot);
    match model.page {
        Page::Engines => engines(model, theme, frame, body),
        Page::Why => why::draw(model, theme, frame, body),
        Page::Wire => wire::draw(model, theme, frame, body),
    }
    match model.popup {
        Some(Popup::Help) => popup::help(theme, frame, body),
        Some(Popup::Faults) => popup::faults(model, theme, frame, body),
        Some(Popup::Release) => popup::release(model, theme, frame, body),
        None => {}
    }
    // The charts bring characters of their own.
    if theme.ascii {
        for cell in &mut frame.buffer_mut().content {
            if !cell.symbol().is_ascii() {
                let text = theme.text(cell.symbol());
                cell.set_symbol(if text.is_empty() { " " } else { &text });
            }
        }
    }
}

fn engines(model: &Model, theme: Theme, frame: &mut Frame<'_>, body: Rect) {
    let area = frame.area();
    let fits = |size: (u16, u16)| area.width >= size.0 && area.height >= size.1;
    if !fits(PANELS) {
        let table = rows::height(model);
        let [top, panel, bottom] =
            Layout::vertical([Constraint::Length(table), Constraint::Fill(1), Constraint::Length(EVENTS)])
                .areas(body);
        rows::draw(model, theme, frame, top);
        panels::draw(model, theme, frame, panel, model.selected);
        events(model, theme, frame, bottom);
        return;
    }
    let lines = panels::lines(model, body.width);
    let height = (panels::HEIGHT * lines).min(body.height.saturating_sub(EVENTS));
    let [top, middle, bottom] = if fits(CHARTS) {
        Layout::vertical([Constraint::Length(height), Constraint::Fill(1), Constraint::Length(EVENTS + 2)])
    } else {
        Layout::vertical([Constraint::Length(height), Constraint::Length(0), Constraint::Fill(1)])
    }
    .areas(body);
    panels::draw_all(model, theme, frame, top);
    if middle.height > 0 {
        charts::draw(model, theme, frame, middle);
    }
    events(model, theme, frame, bottom);
}

fn header(model: &Model, theme: Theme, width: u16) -> Line<'static> {
    let (at, length) = (seconds(model.at - Instant::MIN), seconds(model.length).max(0.1));
    let passing = model.passing;
    let speed = if passing.paused {
        "PAUSED".to_owned()
    } else {
        format!("×{}{}", passing.speed, if passing.auto { " auto" } else { "" })
    };
    let bar = theme.gauge(20.min(usize::from(width / 4)), at / length, None);
    let text = format!("jetlink rig   {at:.1} s of {length:.0} s  {bar}  {speed}");
    let mut line = vec![Span::styled(theme.text(&text), theme.style(Tone::Head))];
    if model.mouse {
        line.push(Span::styled("  mouse", theme.style(Tone::Quiet)));
    }
    Line::from(line)
}

fn story_line(model: &Model, theme: Theme) -> Line<'static> {
    let pass = model.verdict.as_ref().map(|verdict| verdict.pass);
    let text = story::line(&model.names(), &model.samples, pass);
    let tone = match pass {
        Some(true) => Tone::Good,
        Some(false) => Tone::Bad,
        None => Tone::Busy,
    };
    Line::from(Span::styled(theme.text(&text), theme.style(tone)))
}

fn footer(model: &Model, theme: Theme, width: u16) -> Line<'static> {
    let mut line: Vec<Span<'static>> = Vec::new();
    let mut used = 0;
    for key in model.footer() {
        let text = format!("{} {}", key.name, key.short);
        let length = text.len() + 2;
        if used + length > usize::from(width) {
            continue;
        }
        used += length;
        line.push(Span::styled(key.name, theme.style(Tone::Head)));
        line.push(Span::raw(format!(" {}  ", key.short)));
    }
    Line::from(line)
}

/// The verdict, if there is one, and the latest events; the latest is the last.
fn events(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let [head, list] = Layout::vertical([Constraint::Length(1), Constraint::Min(0)]).areas(area);
    let (title, tone) = match &model.verdict {
        Some(Verdict { pass: true, .. }) => ("verdict: PASS", Tone::Good),
        Some(Verdict { pass: false, .. }) => ("verdict: FAILED", Tone::Bad),
        None => ("events", Tone::Head),
    };
    frame.render_widget(Line::from(Span::styled(title, theme.style(tone))), head);
    let height = usize::from(list.height);
    let mut lines: Vec<Line<'static>> = Vec::new();
    for text in model.verdict.iter().flat_map(|verdict| &verdict.lines).take(height) {
        lines.push(Line::from(Span::styled(theme.text(text), theme.style(tone))));
    }
    let room = height - lines.len();
    let first = model.events.len().saturating_sub(room);
    for event in model.events.iter().skip(first) {
        let tone = tone_of(&event.text);
        let line = cut(&theme.text(&event.line()), usize::from(list.width), theme);
        lines.push(Line::from(Span::styled(line, theme.style(tone))));
    }
    frame.render_widget(Paragraph::new(lines), list);
}

/// What is written in capitals is wrong.
fn tone_of(text: &str) -> Tone {
    let loud =
        text.split_whitespace().find(|word| word.len() > 3 && word.chars().all(|c| c.is_ascii_uppercase()));
    match loud {
        Some(_) => Tone::Bad,
        None if text.starts_with("played") => Tone::Busy,
        None => Tone::Plain,
    }
}
