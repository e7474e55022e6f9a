//! All engines as a table, a row each.

use super::super::sample::Sample;
use super::model::Model;
use super::theme::{Theme, Tone, cut};
use jetlink::command::Order;
use jetlink::engine::state::EngineState;
use jetlink::event::LossStage;
use jetlink::report::LinkState;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};

/// The columns with their widths: with the mark and the spaces between them 79.
const COLUMNS: [(&str, usize); 8] = [
    ("engine", 12),
    ("state", 18),
    ("rpm", 6),
    ("EGT", 7),
    ("commanded", 10),
    ("sent", 10),
    ("link", 8),
    ("source", 24),
];

/// Lines that the table takes.
pub fn height(model: &Model) -> u16 {
    1 + u16::try_from(model.subjects.len()).unwrap_or(8)
}

/// Draws it.
pub fn draw(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let heads = COLUMNS.iter().map(|&(head, width)| aligned(head, head, width)).collect::<String>();
    let line = Line::from(Span::styled(format!("  {}", heads.trim_end()), theme.style(Tone::Head)));
    let mut place = Rect { height: 1, ..area };
    frame.render_widget(line, place);
    for (i, sample) in model.samples.iter().enumerate() {
        place.y += 1;
        if place.y >= area.bottom() {
            return;
        }
        model.places.borrow_mut().push((place, i));
        frame.render_widget(row(model, theme, i, sample), place);
    }
}

fn aligned(head: &str, text: &str, width: usize) -> String {
    if matches!(head, "rpm" | "EGT" | "commanded" | "sent") {
        format!("{text:>width$} ")
    } else {
        format!("{text:<width$} ")
    }
}

fn row(model: &Model, theme: Theme, engine: usize, sample: &Sample) -> Line<'static> {
    let dash = || "-".to_owned();
    let rate = model.rates.get(engine).copied().unwrap_or_default();
    let link =
        if sample.link == LinkState::Up { format!("up {rate:.0}/s") } else { sample.link_name().to_owned() };
    let cells = [
        (model.name(engine).to_owned(), if engine == model.selected { Tone::Selected } else { Tone::Plain }),
        (sample.does_text(), state(sample)),
        (sample.rpm.map_or_else(dash, |rpm| rpm.to_string()), Tone::Plain),
        (sample.egt.map_or_else(dash, |egt| format!("{egt:.0} °C")), Tone::Plain),
        (commanded(sample), if sample.silent { Tone::Warn } else { Tone::Plain }),
        (sample.wire_text(), if sample.order == Order::EmergencyStop { Tone::Bad } else { Tone::Plain }),
        (link, self::link(sample)),
        (sample.rules_text(), source(sample)),
    ];
    let mark = if engine == model.selected { "> " } else { "  " };
    let mut spans = vec![Span::styled(mark, theme.style(Tone::Head))];
    for ((text, tone), (head, width)) in cells.into_iter().zip(COLUMNS) {
        let text = cut(&theme.text(&text), width, theme);
        spans.push(Span::styled(aligned(head, &text, width), theme.style(tone)));
    }
    Line::from(spans)
}

/// What the source commands.
pub fn commanded(sample: &Sample) -> String {
    if sample.silent { "silent".to_owned() } else { sample.input.to_string() }
}

/// The tone of what an engine does.
pub fn state(sample: &Sample) -> Tone {
    if sample.faults.is_some_and(|faults| !faults.is_empty()) {
        return Tone::Bad;
    }
    match sample.does {
        EngineState::Running => Tone::Good,
        EngineState::Starting(_) | EngineState::StartRequested | EngineState::Cooling => Tone::Busy,
        EngineState::ShuttingDown | EngineState::Service => Tone::Warn,
        EngineState::Fault => Tone::Bad,
        EngineState::Offline | EngineState::NotKnown | EngineState::Stopped | EngineState::Standby => {
            Tone::Quiet
        }
    }
}

/// The tone of a link.
pub fn link(sample: &Sample) -> Tone {
    match sample.link {
        LinkState::Up => Tone::Good,
        LinkState::Silent => Tone::Quiet,
        LinkState::Lost => Tone::Bad,
    }
}

/// The tone of who is in control.
pub fn source(sample: &Sample) -> Tone {
    match (sample.order, sample.loss) {
        (Order::EmergencyStop, _) => Tone::Bad,
        (_, LossStage::None) if sample.limited => Tone::Warn,
        (_, LossStage::None) => Tone::Plain,
        _ => Tone::Warn,
    }
}
