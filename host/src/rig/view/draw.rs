//! Draws the screen: its size determines the parts.

use super::super::fit::{first_that_fits, wrapped};
use super::super::play::action::Fault;
use super::super::quantity::seconds;
use super::super::story;
use super::keys::Key;
use super::model::{Event, Model, Page, Popup, Verdict};
use super::theme::{Theme, Tone};
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
/// From this height on there are also charts.
const CHARTS: (u16, u16) = (200, 50);
/// Events below the engines, with their heading.
const EVENTS: u16 = 6;
/// The fewest of them beside a panel.
const LEAST_EVENTS: u16 = 2;

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
    frame.render_widget(story_line(model, theme, story.width), story);
    frame.render_widget(footer(model, theme, foot.width), foot);
    match model.page {
        Page::Engines => engines(model, theme, frame, body),
        Page::Why => why::draw(model, theme, frame, body),
        Page::Wire => wire::draw(model, theme, frame, body),
    }
    match model.popup {
        Some(Popup::Help) => popup::help(model, theme, frame, body),
        Some(Popup::Faults) => popup::faults(model, theme, frame, body),
        Some(Popup::Release) => popup::release(model, theme, frame, body),
        None => {}
    }
    // The charts use characters of their own.
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
        // A panel needs room for its texts.
        let below = body.height.saturating_sub(table);
        let events_height = match below.checked_sub(panels::LEAST_HEIGHT) {
            Some(left) if left >= LEAST_EVENTS => left.min(EVENTS),
            _ => below,
        };
        let heights = [table, below - events_height, events_height].map(Constraint::Length);
        let [top, panel, bottom] = Layout::vertical(heights).areas(body);
        rows::draw(model, theme, frame, top);
        if panel.height > 0 {
            panels::draw(model, theme, frame, panel, model.selected);
        }
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
    let at = seconds(model.at - Instant::MIN);
    let passing = model.passing;
    let speed = if passing.paused {
        "PAUSED".to_owned()
    } else {
        format!("×{}{}", passing.speed, if passing.auto { " auto" } else { "" })
    };
    // A run that is played further has no length of its own.
    let length = model.length.map(|length| seconds(length).max(0.1)).filter(|length| at <= *length);
    let of = length.map_or_else(String::new, |length| {
        let bar = theme.gauge(20.min(usize::from(width / 4)), at / length, None);
        format!(" of {length:.0} s  {bar}")
    });
    let text = format!("jetlink rig   {at:.1} s{of}  {speed}");
    let mut line = vec![Span::styled(theme.text(&text), theme.style(Tone::Head))];
    if model.mouse {
        line.push(Span::styled("  mouse", theme.style(Tone::Quiet)));
    }
    Line::from(line)
}

fn story_line(model: &Model, theme: Theme, width: u16) -> Line<'static> {
    let pass = model.verdict.as_ref().map(|verdict| verdict.pass);
    // The last clause is what can be left out.
    let faults: Vec<&[Fault]> = model.details.iter().map(|detail| detail.faults.as_slice()).collect();
    let whole = story::line(&model.names(), &model.samples, &faults, pass, model.scenario, model.selected);
    let first = whole.split_once("; ").map_or(whole.as_str(), |(first, _)| first).to_owned();
    let text = first_that_fits(&[theme.text(&whole), theme.text(&first)], width.into(), theme.mark());
    let tone = match pass {
        Some(true) => Tone::Good,
        Some(false) => Tone::Bad,
        None => Tone::Busy,
    };
    Line::from(Span::styled(text, theme.style(tone)))
}

fn footer(model: &Model, theme: Theme, width: u16) -> Line<'static> {
    let mut line: Vec<Span<'static>> = Vec::new();
    let mut used = 0;
    let acts = |key: &&Key| !(key.short.is_empty() || model.transmitter && key.is_without_transmitter());
    for key in model.keys().filter(acts) {
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
        // A scenario that was stopped by hand.
        Some(Verdict { pass: true, lines }) if !lines.iter().any(|line| line.starts_with("PASS")) => {
            ("verdict", Tone::Warn)
        }
        Some(Verdict { pass: true, .. }) => ("verdict: PASS", Tone::Good),
        Some(Verdict { pass: false, .. }) => ("verdict: FAILED", Tone::Bad),
        None => ("events", Tone::Head),
    };
    frame.render_widget(Line::from(Span::styled(title, theme.style(tone))), head);
    let height = usize::from(list.height);
    let mut lines: Vec<Line<'static>> = Vec::new();
    let wrapped = |text: &str, indent, tone| {
        let lines = wrapped(&theme.text(text), list.width.into(), indent, theme.mark());
        lines.into_iter().map(move |line| Line::from(Span::styled(line, theme.style(tone))))
    };
    for text in model.verdict.iter().flat_map(|verdict| &verdict.lines) {
        lines.extend(wrapped(text, 0, tone));
    }
    lines.truncate(height);
    // From the latest on back, as long as there is room for all lines of one.
    let mut events: Vec<Vec<Line<'static>>> = Vec::new();
    let mut room = height - lines.len();
    for event in model.events.iter().rev() {
        let mut of_event: Vec<_> = wrapped(&event.line(), Event::INDENT, tone_of(&event.text)).collect();
        if of_event.len() > room && events.is_empty() {
            of_event.truncate(room);
        }
        if of_event.len() > room || of_event.is_empty() {
            break;
        }
        room -= of_event.len();
        events.push(of_event);
    }
    lines.extend(events.into_iter().rev().flatten());
    frame.render_widget(Paragraph::new(lines), list);
}

/// Text in capitals marks a fault.
fn tone_of(text: &str) -> Tone {
    let loud =
        text.split_whitespace().find(|word| word.len() > 3 && word.chars().all(|c| c.is_ascii_uppercase()));
    match loud {
        Some(_) => Tone::Bad,
        None if text.starts_with("played") => Tone::Busy,
        None => Tone::Plain,
    }
}
