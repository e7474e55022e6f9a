//! All engines as a table, a row each.

use super::super::fit::first_that_fits;
use super::super::sample::Sample;
use super::model::Model;
use super::theme::{OLD, Theme, Tone};
use embassy_time::Instant;
use jetlink::command::{Order, Origin};
use jetlink::engine::state::EngineState;
use jetlink::event::LossStage;
use jetlink::report::LinkState;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};

/// The columns with their widths when there is room for all.
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
/// Shortest widths of `state`, `link` and `source`: with names of 12 characters the table has 80 columns.
const LEAST_STATE: usize = 8;
const LEAST_LINK: usize = 7;
const LEAST_SOURCE: usize = 11;

/// The widths of the columns on a screen of this width: the names take the width that they need, and the rest goes
/// to the state, then to the source.
fn widths(model: &Model, width: u16) -> Vec<usize> {
    let mut widths = COLUMNS.map(|(_, width)| width).to_vec();
    // The mark, and a space between two columns.
    let taken = |widths: &[usize]| 1 + widths.len() + widths.iter().sum::<usize>();
    let width = usize::from(width);
    if taken(&widths) <= width {
        return widths;
    }
    let names = model.subjects.iter().map(|subject| subject.engine.name().len());
    widths[0] = names.fold("engine".len(), usize::max).min(widths[0]);
    for (column, least) in [(1, LEAST_STATE), (6, LEAST_LINK), (7, LEAST_SOURCE)] {
        widths[column] = least;
    }
    while taken(&widths) > width && widths.len() > 1 {
        widths.pop();
    }
    for column in [1, 7] {
        let left = width.saturating_sub(taken(&widths));
        if let Some(wider) = widths.get_mut(column) {
            *wider = (*wider + left).min(COLUMNS[column].1);
        }
    }
    widths
}

/// Lines that the table takes.
pub fn height(model: &Model) -> u16 {
    1 + u16::try_from(model.subjects.len()).unwrap_or(8)
}

/// Draws it.
pub fn draw(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let widths = widths(model, area.width);
    let heads = COLUMNS.iter().zip(&widths).map(|(&(head, _), &width)| aligned(head, head, width, ' '));
    let heads = heads.collect::<String>();
    let line = Line::from(Span::styled(format!("  {}", heads.trim_end()), theme.style(Tone::Head)));
    let mut place = Rect { height: 1, ..area };
    frame.render_widget(line, place);
    for (i, sample) in model.samples.iter().enumerate() {
        place.y += 1;
        if place.y >= area.bottom() {
            return;
        }
        model.places.borrow_mut().push((place, i));
        frame.render_widget(row(model, theme, i, sample, &widths), place);
    }
}

fn is_number(head: &str) -> bool {
    matches!(head, "rpm" | "EGT" | "commanded" | "sent")
}

/// A cell, with a mark or a space after its text.
fn aligned(head: &str, text: &str, width: usize, mark: char) -> String {
    if is_number(head) {
        format!("{text:>width$}{mark}")
    } else {
        format!("{:<1$}", format!("{text}{mark}"), width + 1)
    }
}

fn row(model: &Model, theme: Theme, engine: usize, sample: &Sample, widths: &[usize]) -> Line<'static> {
    let dash = || "-".to_owned();
    let width = |column: usize| widths.get(column).copied().unwrap_or_default();
    let link = match model.rates.of(engine) {
        Some(rate) if sample.link == LinkState::Up => {
            let texts = [format!("up {rate:.0}/s"), format!("{rate:.0}/s")];
            first_that_fits(&texts, width(6), theme.mark())
        }
        _ => sample.link_name().to_owned(),
    };
    // A mark in place of a colour takes a letter.
    let room = width(7).saturating_sub(usize::from(theme.sign(source(sample)).is_some()));
    let source_text = first_that_fits(&[sample.in_control_text(), brief(sample)], room, theme.mark());
    // The word for all steps of a start, if that of the step has no room.
    let does = first_that_fits(&[sample.does_text(), sample.does.name().to_owned()], width(1), theme.mark());
    let cells = [
        (model.name(engine).to_owned(), if engine == model.selected { Tone::Selected } else { Tone::Plain }),
        (does, state(sample)),
        (sample.rpm.map_or_else(dash, |rpm| rpm.to_string()), unless_old(Tone::Plain, sample.rpm_old)),
        (sample.egt.map_or_else(dash, |egt| format!("{egt:.0} °C")), unless_old(Tone::Plain, sample.egt_old)),
        (commanded(sample), if sample.silent { Tone::Warn } else { Tone::Plain }),
        (sample.wire_text(), if sample.order == Order::EmergencyStop { Tone::Bad } else { Tone::Plain }),
        (link, self::link(sample)),
        (source_text, source(sample)),
    ];
    let mark = if engine == model.selected { "> " } else { "  " };
    let mut spans = vec![Span::styled(mark, theme.style(Tone::Head))];
    for (((text, tone), (head, _)), &width) in cells.into_iter().zip(COLUMNS).zip(widths) {
        let is_number = is_number(head);
        let is_old = is_number && text != "-";
        let mark = theme.sign(tone).filter(|sign| *sign != OLD || is_old).unwrap_or(' ');
        let text = theme.cut(&text, if is_number || mark == ' ' { width } else { width.saturating_sub(1) });
        spans.push(Span::styled(aligned(head, &text, width, mark), theme.style(tone)));
    }
    Line::from(spans)
}

/// The source in control and the reason for holding its demand, in few letters.
fn brief(sample: &Sample) -> String {
    let name = |origin: Origin| match origin {
        Origin::Mavlink => "mav",
        Origin::Emergency => "emerg",
        _ => origin.name(),
    };
    let source = name(sample.in_control);
    let holds = match (sample.order, sample.loss) {
        (Order::EmergencyStop, _) => "STOP",
        (_, LossStage::Hold) => "hold",
        (_, LossStage::FailSafe) => "fsafe",
        (_, LossStage::Standby) => "stby",
        (_, LossStage::None) => match (sample.limited, sample.waiting) {
            (true, _) => "limit",
            (false, Some(next)) => return format!("{source}>{}", name(next)),
            (false, None) => return source.to_owned(),
        },
    };
    format!("{source} {holds}")
}

/// The source's command.
pub fn commanded(sample: &Sample) -> String {
    if sample.silent { "silent".to_owned() } else { sample.input.to_string() }
}

/// The tone of an engine's state.
pub fn state(sample: &Sample) -> Tone {
    if sample.faults.is_some_and(|faults| !faults.is_empty()) {
        return Tone::Bad;
    }
    match sample.does {
        EngineState::Running => Tone::Good,
        EngineState::Starting(_) | EngineState::StartRequested | EngineState::Cooling => Tone::Busy,
        EngineState::ShuttingDown | EngineState::Service => Tone::Warn,
        EngineState::Fault => Tone::Bad,
        // Offline, not known, stopped, standby.
        _ => Tone::Quiet,
    }
}

/// The tone of a value while newer ones arrive.
pub fn unless_old(tone: Tone, old: Option<Instant>) -> Tone {
    if old.is_some() { Tone::Quiet } else { tone }
}

/// The tone of a link.
pub fn link(sample: &Sample) -> Tone {
    match sample.link {
        LinkState::Up => Tone::Good,
        LinkState::Silent => Tone::Quiet,
        LinkState::Lost => Tone::Bad,
    }
}

/// The tone of the source in control.
pub fn source(sample: &Sample) -> Tone {
    match (sample.order, sample.loss) {
        (Order::EmergencyStop, _) => Tone::Bad,
        (_, LossStage::None) if sample.limited => Tone::Warn,
        (_, LossStage::None) => Tone::Plain,
        _ => Tone::Warn,
    }
}
