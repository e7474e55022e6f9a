//! Why the selected engine does what it does: the conditions of a start, and what holds the demand below the command.

use super::super::conditions;
use super::model::Model;
use super::theme::{Theme, Tone};
use jetlink::engine::state::EngineState;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph, Wrap};

/// Draws it.
pub fn draw(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let name = model.name(model.selected);
    let title = Span::styled(format!(" why: {name} "), theme.style(Tone::Head));
    let block =
        Block::bordered().border_set(theme.border()).border_style(theme.style(Tone::Quiet)).title(title);
    let inside = block.inner(area);
    frame.render_widget(block, area);
    frame.render_widget(Paragraph::new(lines(model, theme)).wrap(Wrap { trim: false }), inside);
}

fn lines(model: &Model, theme: Theme) -> Vec<Line<'static>> {
    let line = |text: String, tone| Line::from(Span::styled(theme.text(&text), theme.style(tone)));
    let (Some(subject), Some(detail), Some(sample)) = (
        model.subjects.get(model.selected),
        model.details.get(model.selected),
        model.samples.get(model.selected),
    ) else {
        return vec![line("nothing is known yet".to_owned(), Tone::Quiet)];
    };
    let others_start = model.samples.iter().enumerate().any(|(i, other)| {
        i != model.selected && matches!(other.does, EngineState::Starting(_) | EngineState::StartRequested)
    });
    let mut lines = vec![
        line(format!("{} is {}", model.name(model.selected), sample.does_text()), Tone::Plain),
        line(String::new(), Tone::Plain),
        line("Start".to_owned(), Tone::Head),
    ];
    for condition in conditions::of_start(&detail.telemetry, &subject.engine.config, others_start) {
        let (mark, tone) = if condition.met { ("✓", Tone::Good) } else { ("✗", Tone::Warn) };
        lines.push(line(format!(" {mark} {:<15} {}", condition.what, condition.text), tone));
    }
    lines.push(line(String::new(), Tone::Plain));
    lines.push(line(
        format!("Demand: commanded {}, sent {}", super::rows::commanded(sample), sample.wire_text()),
        Tone::Head,
    ));
    let held = conditions::of_demand(&detail.telemetry, &subject.engine.config);
    if held.is_empty() {
        lines.push(line("   nothing holds it: what is commanded is sent".to_owned(), Tone::Good));
    }
    lines.extend(held.into_iter().map(|text| line(format!("   {text}"), Tone::Warn)));
    lines
}
