//! The wire of the selected engine: the last frames both ways, and the reply window of an AMT ECU.

use super::super::fit::wrapped;
use super::super::frames::{Arrival, Frame as WireFrame, last_window};
use super::super::quantity::seconds;
use super::model::Model;
use super::theme::{Theme, Tone};
use embassy_time::Instant;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph};
use sim::ecu::{MILLIS, Nanos};
use sim::wire::Direction;

/// Where the bytes begin: text without room in a line continues below them.
const INDENT: usize = 24;
/// Reply window of an AMT ECU.
const WINDOW: Nanos = 30 * MILLIS;

/// Text for a frame of which no byte arrived.
const NOT_DELIVERED: &str = "not delivered: the wire is cut";

/// Timeout after which an ECU is silent, in seconds since its last frame.
const SILENT: f64 = 0.5;

/// Draws it.
pub fn draw(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let name = model.name(model.selected);
    let title = Span::styled(format!(" wire: {name} "), theme.style(Tone::Head));
    let block =
        Block::bordered().border_set(theme.border()).border_style(theme.style(Tone::Quiet)).title(title);
    let inside = block.inner(area);
    frame.render_widget(block, area);
    let (Some(subject), Some(frames)) =
        (model.subjects.get(model.selected), model.frames.get(model.selected))
    else {
        return;
    };
    let has_window = subject.engine.ecu.protocol().has_reply_window();
    let [window, list] =
        Layout::vertical([Constraint::Length(if has_window { 3 } else { 0 }), Constraint::Min(0)])
            .areas(inside);
    let last: Vec<&WireFrame> = frames.last(usize::from(list.height).saturating_sub(1).max(8)).collect();
    if has_window {
        let lines = window_lines(theme, &last, model.at, usize::from(window.width));
        frame.render_widget(Paragraph::new(lines), window);
    }
    let head = format!("{:>15}  {:<5}  {:<24}  content", "time in µs", "from", "bytes");
    let mut lines = vec![Line::from(Span::styled(theme.text(&head), theme.style(Tone::Head)))];
    // From the last one on back, as long as there is room for all lines of one.
    let mut shown: Vec<Vec<Line<'static>>> = Vec::new();
    let mut room = usize::from(list.height).saturating_sub(1);
    for one in last.iter().rev() {
        let of_one = of_frame(theme, one, list.width.into());
        if of_one.len() > room {
            break;
        }
        room -= of_one.len();
        shown.push(of_one);
    }
    lines.extend(shown.into_iter().rev().flatten());
    frame.render_widget(Paragraph::new(lines), list);
}

fn of_frame(theme: Theme, frame: &WireFrame, width: usize) -> Vec<Line<'static>> {
    let bytes: Vec<String> = frame.bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    let from = match frame.direction {
        Direction::ToNode => "ECU",
        Direction::ToEcu => "node",
    };
    let (what, tone) = match &frame.text {
        None => ("SKIPPED: no frame".to_owned(), Tone::Bad),
        Some(text) if frame.arrival == Arrival::Nothing => (format!("{text} ({NOT_DELIVERED})"), Tone::Bad),
        Some(text) if frame.arrival == Arrival::Damaged => {
            (format!("{text} (damaged on the way)"), Tone::Warn)
        }
        Some(text) if frame.direction == Direction::ToEcu => (text.clone(), Tone::Busy),
        Some(text) => (text.clone(), Tone::Plain),
    };
    let text = format!("{:>15}  {from:<5}  {:<24}  {what}", grouped(frame.from / 1000), bytes.join(" "));
    let lines = wrapped(&theme.text(&text), width, INDENT, theme.mark());
    lines.into_iter().map(|line| Line::from(Span::styled(line, theme.style(tone)))).collect()
}

/// The window as a bar of 30 ms with the reply in it, as long as the ECU is received.
fn window_lines(theme: Theme, frames: &[&WireFrame], now: Instant, width: usize) -> Vec<Line<'static>> {
    let styled = |text: String, tone| Line::from(Span::styled(theme.text(&text), theme.style(tone)));
    let window = last_window(frames);
    let last = frames.iter().rfind(|frame| frame.direction == Direction::ToNode && frame.text.is_some());
    let silent = last
        .map(|frame| seconds(now - Instant::MIN) - frame.to as f64 / 1e9)
        .filter(|silent| *silent > SILENT);
    let bar = width.saturating_sub(2).min(60);
    let (text, tone, cells) = match (window, silent) {
        (_, Some(silent)) => (format!("nothing received for {silent:.1} s"), Tone::Bad, None),
        (None, _) => ("no frame of the ECU yet".to_owned(), Tone::Quiet, None),
        (Some(None), _) => ("no reply to the last frame".to_owned(), Tone::Bad, None),
        (Some(Some(reply)), _) if reply.arrival == Arrival::Nothing => {
            (NOT_DELIVERED.to_owned(), Tone::Bad, Some((reply.from, reply.to)))
        }
        (Some(Some(reply)), _) => {
            let (from, to) = (reply.from, reply.to);
            let ms = |at: Nanos| at as f64 / 1e6;
            let left = ms(WINDOW) - ms(to);
            let tone = if to > WINDOW { Tone::Bad } else { Tone::Good };
            (
                format!("{:.3} to {:.3} ms of 30 ms, {left:.3} ms left", ms(from), ms(to)),
                tone,
                Some((from, to)),
            )
        }
    };
    let cell = |i: usize| (i as f64 + 0.5) / bar.max(1) as f64 * WINDOW as f64;
    let (full, empty) = if theme.ascii { ('#', '.') } else { ('█', '░') };
    let drawn: String = (0..bar)
        .map(|i| match cells {
            Some((from, to)) if (from as f64..to as f64).contains(&cell(i)) => full,
            _ => empty,
        })
        .collect();
    vec![
        styled(format!("reply window: {text}"), tone),
        Line::from(Span::styled(format!("[{drawn}]"), theme.style(tone))),
        styled(format!("0 ms{:>width$}", "30 ms", width = bar.saturating_sub(2)), Tone::Quiet),
    ]
}

/// `12 345 678`.
fn grouped(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}
