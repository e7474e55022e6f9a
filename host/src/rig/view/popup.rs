//! Popups above the screen: the keys, the faults, the question whether to release a stop.

use super::keys::{FAULTS, Key, RELEASE, by_transmitter, restart_text};
use super::model::Model;
use super::theme::{Theme, Tone};
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Clear, Paragraph};

fn rows(model: &Model, theme: Theme, keys: impl Iterator<Item = &'static Key>) -> Vec<Line<'static>> {
    let row = |key: &Key| {
        Line::from(vec![
            Span::styled(format!(" {:<7}", key.name), theme.style(Tone::Head)),
            Span::raw(theme.text(if model.transmitter { by_transmitter(key) } else { key.text })),
        ])
    };
    keys.map(row).collect()
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

/// The keys: in one column if they fit, otherwise in two columns or on several pages.
pub fn help(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let mut lines = rows(model, theme, model.keys());
    let wide = lines.iter().map(Line::width).max().unwrap_or(0) + 1;
    // A scenario plays by itself.
    let restart = (!model.scenario).then(|| Line::from(format!(" {}", restart_text(model.transmitter))));
    let height = usize::from(area.height.saturating_sub(2)).max(1);
    let half = lines.len().div_ceil(2);
    let room = height - restart.iter().len();
    model.help_pages.set(1);
    if lines.len() > room && half <= room && 2 * wide + 2 <= area.width.into() {
        let right = lines.split_off(half);
        for (left, right) in lines.iter_mut().zip(right) {
            let between = wide.saturating_sub(left.width());
            left.spans.push(Span::raw(" ".repeat(between)));
            left.spans.extend(right.spans);
        }
        lines.extend(restart);
        draw(theme, frame, area, "keys", lines);
        return;
    }
    lines.extend(restart);
    if lines.len() > height {
        let pages = lines.len().div_ceil(height);
        let page = model.help_page.min(pages - 1);
        model.help_pages.set(pages);
        let lines = lines.into_iter().skip(page * height).take(height).collect();
        draw(theme, frame, area, &format!("keys, page {} of {pages}: ? for the next", page + 1), lines);
        return;
    }
    draw(theme, frame, area, "keys", lines);
}

/// The faults of the selected engine.
pub fn faults(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let name = model.name(model.selected);
    let mut lines = rows(model, theme, FAULTS.iter());
    let lasting =
        model.details.get(model.selected).map(|detail| detail.faults.as_slice()).unwrap_or_default();
    lines.push(Line::default());
    if lasting.is_empty() {
        lines.push(Line::from(" no fault is set; Esc closes"));
    } else {
        let names: Vec<String> = lasting.iter().map(|fault| fault.name().to_owned()).collect();
        let text = format!(" set now: {}; the same key ends it", names.join(", "));
        lines.push(Line::from(Span::styled(text, theme.style(Tone::Warn))));
    }
    draw(theme, frame, area, &format!("break {name}"), lines);
}

/// The second key of a release.
pub fn release(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let name = model.name(model.selected);
    let mut lines = rows(model, theme, RELEASE.iter());
    lines.push(Line::from(" Esc leaves it latched"));
    draw(theme, frame, area, &format!("release the emergency stop of {name}?"), lines);
}
