//! What lies above the screen: the keys, the faults, the question whether to release a stop.

use super::keys::{FAULTS, KEYS, Key, RELEASE};
use super::model::Model;
use super::theme::{Theme, Tone};
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Clear, Paragraph};

fn rows(theme: Theme, keys: &[Key]) -> Vec<Line<'static>> {
    let row = |key: &Key| {
        Line::from(vec![
            Span::styled(format!(" {:<7}", key.name), theme.style(Tone::Head)),
            Span::raw(theme.text(key.text)),
        ])
    };
    keys.iter().map(row).collect()
}

fn draw(theme: Theme, frame: &mut Frame<'_>, area: Rect, title: &str, lines: Vec<Line<'static>>) {
    let wide = lines.iter().map(Line::width).max().unwrap_or(0).max(title.len() + 2);
    let width = u16::try_from(wide + 3).unwrap_or(area.width).min(area.width);
    let height = u16::try_from(lines.len() + 2).unwrap_or(area.height).min(area.height);
    let place =
        Rect { x: area.x + (area.width - width) / 2, y: area.y + (area.height - height) / 2, width, height };
    let title = Span::styled(format!(" {title} "), theme.style(Tone::Head));
    let block = Block::bordered().border_set(theme.border()).title(title);
    frame.render_widget(Clear, place);
    frame.render_widget(Paragraph::new(lines).block(block), place);
}

/// The keys. Where they do not fit below one another they stand in two columns.
pub fn help(theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let mut lines = rows(theme, &KEYS);
    if lines.len() + 2 > usize::from(area.height) {
        let wide = lines.iter().map(Line::width).max().unwrap_or(0) + 1;
        let right = lines.split_off(lines.len().div_ceil(2));
        for (left, right) in lines.iter_mut().zip(right) {
            let room = wide.saturating_sub(left.width());
            left.spans.push(Span::raw(" ".repeat(room)));
            left.spans.extend(right.spans);
        }
    }
    draw(theme, frame, area, "keys", lines);
}

/// The faults of the selected engine.
pub fn faults(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let name = model.name(model.selected);
    let mut lines = rows(theme, &FAULTS);
    let lasting =
        model.details.get(model.selected).map(|detail| detail.faults.as_slice()).unwrap_or_default();
    lines.push(Line::default());
    if lasting.is_empty() {
        lines.push(Line::from(" no fault is set; Esc closes"));
    } else {
        let names: Vec<String> = lasting.iter().map(|fault| format!("{fault:?}").to_lowercase()).collect();
        let text = format!(" set now: {}; the same key ends it", names.join(", "));
        lines.push(Line::from(Span::styled(text, theme.style(Tone::Warn))));
    }
    draw(theme, frame, area, &format!("break {name}"), lines);
}

/// The second key of a release.
pub fn release(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let name = model.name(model.selected);
    let mut lines = rows(theme, &RELEASE);
    lines.push(Line::from(" Esc leaves it latched"));
    draw(theme, frame, area, &format!("release the emergency stop of {name}?"), lines);
}
