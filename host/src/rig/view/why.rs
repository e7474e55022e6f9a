//! Reasons for the selected engine's state: the conditions of a start, what holds the demand below the command, and the outputs.

use super::super::conditions;
use super::super::fit::wrapped;
use super::super::sample::Sample;
use super::model::Model;
use super::theme::{Theme, Tone};
use jetlink_rc::outputs::Valve;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph};

/// Where the text of a condition begins.
const INDENT: usize = 19;

/// Draws it.
pub fn draw(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let does = model.samples.get(model.selected).map_or_else(|| "not known".to_owned(), Sample::does_text);
    let title = format!(" why: {} ({does}) ", model.name(model.selected));
    let title = Span::styled(theme.text(&title), theme.style(Tone::Head));
    let block =
        Block::bordered().border_set(theme.border()).border_style(theme.style(Tone::Quiet)).title(title);
    let inside = block.inner(area);
    frame.render_widget(block, area);
    let (width, height) = (usize::from(inside.width), usize::from(inside.height));
    let mut lines = lines(model, theme, width, Met::Listed);
    // On a low screen, complete text takes precedence over empty lines and conditions that are met.
    if lines.len() > height {
        lines.retain(|line| line.width() > 0);
    }
    for met in [Met::Named, Met::Counted] {
        if lines.len() > height {
            lines = self::lines(model, theme, width, met);
        }
    }
    if let Some(hidden) = lines.len().checked_sub(height).filter(|hidden| *hidden > 0) {
        lines.truncate(height.saturating_sub(1));
        let text = format!("{} more lines: they need a taller screen", hidden + 1);
        lines.push(Line::from(Span::styled(text, theme.style(Tone::Warn))));
    }
    frame.render_widget(Paragraph::new(lines), inside);
}

/// How conditions that are met are shown.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Met {
    /// A line each.
    Listed,
    /// By their names alone.
    Named,
    /// By their number.
    Counted,
}

fn lines(model: &Model, theme: Theme, width: usize, shown: Met) -> Vec<Line<'static>> {
    let line = |text: String, tone| Line::from(Span::styled(theme.text(&text), theme.style(tone)));
    let wrapped = |text: String, indent, tone| -> Vec<Line<'static>> {
        let lines = wrapped(&theme.text(&text), width, indent, theme.mark());
        lines.into_iter().map(|line| Line::from(Span::styled(line, theme.style(tone)))).collect()
    };
    let (Some(detail), Some(sample)) = (model.details.get(model.selected), model.samples.get(model.selected))
    else {
        return vec![line("nothing is known yet".to_owned(), Tone::Quiet)];
    };
    let conditions = conditions::of_start(detail);
    let met: Vec<&str> = conditions.iter().filter(|condition| condition.met).map(|c| c.what).collect();
    let head = "Conditions of a start now";
    let mut lines = match shown {
        Met::Named if !met.is_empty() => wrapped(format!("{head}; met: {}", met.join(", ")), 1, Tone::Head),
        Met::Counted if !met.is_empty() => vec![line(format!("{head}; {} are met", met.len()), Tone::Head)],
        _ => vec![line(head.to_owned(), Tone::Head)],
    };
    for condition in conditions.iter().filter(|condition| shown == Met::Listed || !condition.met) {
        let (mark, tone) = if condition.met { ("✓", Tone::Good) } else { ("✗", Tone::Warn) };
        let (text, indent) = if shown == Met::Listed {
            (format!(" {mark} {:<15} {}", condition.what, condition.text), INDENT)
        } else {
            (format!(" {mark} {}: {}", condition.what, condition.text), 3)
        };
        lines.extend(wrapped(text, indent, tone));
    }
    let space = || (shown == Met::Listed).then(|| line(String::new(), Tone::Plain));
    lines.extend(space());
    lines.push(line(
        format!("Demand: commanded {}, sent {}", super::rows::commanded(sample), sample.wire_text()),
        Tone::Head,
    ));
    let held = conditions::of_demand(sample, detail);
    if held.is_empty() {
        lines.push(if conditions::is_sent(sample) {
            line("   nothing limits it: the commanded demand is sent".to_owned(), Tone::Good)
        } else {
            line("   nothing limits it: the next frames carry it".to_owned(), Tone::Warn)
        });
    }
    lines.extend(held.into_iter().flat_map(|text| wrapped(format!("   {text}"), 3, Tone::Warn)));
    let valve = if detail.outputs.valve() == Valve::Open { "open" } else { "closed" };
    let power = if detail.outputs.power() { "on" } else { "off" };
    lines.extend(space());
    lines.push(line(
        format!("A board's outputs: fuel valve {valve}, starter and ignition {power}"),
        Tone::Head,
    ));
    lines
}
