//! What is on the wire of the selected engine: the last frames both ways, and the reply window of an AMT ECU.

use super::super::engines::Ecu;
use super::super::frames::{Frame as WireFrame, last_window};
use super::model::Model;
use super::theme::{Theme, Tone, cut};
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph};
use sim::ecu::{MILLIS, Nanos};
use sim::wire::Direction;

/// An AMT ECU waits so long for a reply.
const WINDOW: Nanos = 30 * MILLIS;

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
    let is_amt = matches!(subject.engine.ecu, Ecu::Amt(_));
    let [window, list] =
        Layout::vertical([Constraint::Length(if is_amt { 3 } else { 0 }), Constraint::Min(0)]).areas(inside);
    let last: Vec<&WireFrame> = frames.last(usize::from(list.height).saturating_sub(1).max(8)).collect();
    if is_amt {
        frame.render_widget(Paragraph::new(window_lines(theme, &last, usize::from(window.width))), window);
    }
    let head = format!("{:>15}  {:<5}  {:<24}  what it says", "time in µs", "from", "bytes");
    let mut lines = vec![Line::from(Span::styled(theme.text(&head), theme.style(Tone::Head)))];
    let first = last.len().saturating_sub(usize::from(list.height).saturating_sub(1));
    for one in last.iter().skip(first) {
        lines.push(line(theme, one, usize::from(list.width)));
    }
    frame.render_widget(Paragraph::new(lines), list);
}

fn line(theme: Theme, frame: &WireFrame, width: usize) -> Line<'static> {
    let bytes: Vec<String> = frame.bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    let from = match frame.direction {
        Direction::ToNode => "ECU",
        Direction::ToEcu => "node",
    };
    let (what, tone) = match &frame.text {
        None => ("SKIPPED: no frame".to_owned(), Tone::Bad),
        Some(text) if frame.damaged => (format!("{text} (damaged on the way)"), Tone::Warn),
        Some(text) if frame.direction == Direction::ToEcu => (text.clone(), Tone::Busy),
        Some(text) => (text.clone(), Tone::Plain),
    };
    let text = format!("{:>15}  {from:<5}  {:<24}  {what}", grouped(frame.from / 1000), bytes.join(" "));
    Line::from(Span::styled(cut(&theme.text(&text), width, theme), theme.style(tone)))
}

/// The window as a bar of 30 ms with the reply in it.
fn window_lines(theme: Theme, frames: &[&WireFrame], width: usize) -> Vec<Line<'static>> {
    let styled = |text: String, tone| Line::from(Span::styled(theme.text(&text), theme.style(tone)));
    let window = last_window(frames);
    let bar = width.saturating_sub(2).min(60);
    let (text, tone, cells) = match window {
        None => ("no frame of the ECU yet".to_owned(), Tone::Quiet, None),
        Some(None) => ("no reply to the last frame".to_owned(), Tone::Bad, None),
        Some(Some((from, to))) => {
            let ms = |at: Nanos| at as f64 / 1e6;
            let left = ms(WINDOW) - ms(to);
            let tone = if to > WINDOW { Tone::Bad } else { Tone::Good };
            (
                format!("reply from {:.3} ms to {:.3} ms of 30 ms, {left:.3} ms left", ms(from), ms(to)),
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
