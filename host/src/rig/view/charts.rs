//! The last two minutes of each engine: shaft speed with EGT above, the throttle in a strip of its own below. A demand in rpm
//! belongs to the shaft speed.

use super::super::chronicle::shown;
use super::super::engines::ALL;
use super::super::quantity::seconds;
use super::super::record::{Band, Point, thinned};
use super::model::{Event, Model, Subject};
use super::theme::{Theme, Tone};
use embassy_time::Instant;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Axis, Block, Chart, Dataset, GraphType};

/// Time shown, in seconds.
const SPAN: f64 = 120.0;
/// Charts beside one another.
const BESIDE: usize = 4;
/// Lines of the strip of the throttle.
const STRIP: u16 = 6;
/// A chart that begins within this time of the run, in seconds, has its beginning.
const FIRST_FRAME_WITHIN: f64 = 1.0;
/// A chart of fewer lines shows nothing.
const LEAST_HEIGHT: u16 = 16;
/// Least room above the highest speed and above the limit of the EGT.
const HEADROOM: f64 = 1.08;
/// An axis ends at a multiple of this, so that its label needs no rounding.
const RPM_STEP: f64 = 10_000.0;
/// The same of the EGT, in °C.
const EGT_STEP: f64 = 50.0;
/// The upper end of the throttle's axis, in percent: there is nothing above.
const THROTTLE_TOP: f64 = 100.0;

/// Where the axis ends above this value.
fn top(most: f64, step: f64) -> f64 {
    (most * HEADROOM / step).ceil() * step
}

/// Draws one for each engine; where they have no room below one another, those of the selected engine and of its neighbours.
pub fn draw(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let count = model.subjects.len();
    let beside = count.clamp(1, BESIDE);
    let all = count.div_ceil(beside).max(1);
    let room = usize::from(area.height / LEAST_HEIGHT).max(1);
    let (first, lines) = if room < all { (model.selected / beside, 1) } else { (0, all) };
    let places = Layout::vertical(vec![Constraint::Fill(1); lines]).split(area);
    for (line, place) in places.iter().enumerate() {
        let line = first + line;
        let places = Layout::horizontal(vec![Constraint::Fill(1); beside]).split(*place);
        for (i, place) in places.iter().enumerate() {
            if let Some(subject) = model.subjects.get(line * beside + i) {
                engine(model, theme, frame, *place, line * beside + i, subject);
            }
        }
    }
}

/// A curve in pieces where it is known: a point at each end of each band.
type Curve = Vec<Vec<(f64, f64)>>;

fn engine(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect, engine: usize, subject: &Subject) {
    let now = seconds(model.at - Instant::MIN);
    let points = thinned(model.record.recent(engine, now - SPAN), usize::from(area.width) * 2);
    let curve = |value: &dyn Fn(&Point) -> Option<Band>, scale: f64| -> Curve {
        let known = points.chunk_by(|a, b| value(a).is_some() == value(b).is_some());
        let piece = |points: &[Point]| {
            let both = |point: &Point, band: Band| {
                [band.least, band.most].map(|value| (point.t - now, value * scale))
            };
            let of_point = |point: &Point| value(point).map(|band| both(point, band));
            points.iter().filter_map(of_point).flatten().collect::<Vec<_>>()
        };
        known.map(piece).filter(|piece| !piece.is_empty()).collect()
    };
    let (top_rpm, top_egt) =
        (top(subject.max_rpm, RPM_STEP), top(subject.egt_limit.unwrap_or(800.0), EGT_STEP));
    // Both have one axis, which ends at `top_rpm` and at `top_egt`.
    let to_rpm = top_rpm / top_egt;
    let by_rpm = subject.engine.by_rpm();
    let mut speeds = vec![
        ("EGT", Tone::Bad, curve(&|point| point.egt.filter(|_| !point.egt_old), to_rpm)),
        ("rpm", Tone::Good, curve(&|point| point.rpm.filter(|_| !point.rpm_old), 1.0)),
    ];
    if by_rpm {
        // The sent demand is drawn above the commanded one where both are equal, as in the strip of a throttle.
        speeds.insert(0, ("sent", Tone::Busy, curve(&|point| point.sent_rpm, 1.0)));
        speeds.insert(1, ("commanded", Tone::Warn, curve(&|point| point.demand_rpm, 1.0)));
    }
    // Behind the curves: events, and at the bottom the times without reception.
    let marks = marks(model, engine);
    let through = |top: f64| -> Curve { marks.iter().map(|(t, _)| vec![(*t, 0.0), (*t, top)]).collect() };
    // Before the first frame nothing could be received.
    let first = match (points.first(), points.iter().position(|point| point.link)) {
        (Some(point), Some(place)) if point.t < FIRST_FRAME_WITHIN => points.get(place).map(|point| point.t),
        _ => None,
    };
    let is_gap = |point: &Point| !point.link && first.is_none_or(|first| point.t > first);
    let gaps = curve(&|point| is_gap(point).then_some(Band::of(0.0)), 1.0);
    let has_gap = !gaps.is_empty();
    speeds.insert(0, ("marks", Tone::Quiet, through(top_rpm)));
    speeds.push(("gaps", Tone::Bad, gaps));
    let mut title = vec![
        Span::styled(format!(" {}: ", model.name(engine)), theme.style(Tone::Head)),
        Span::styled("rpm", theme.style(Tone::Good)),
        Span::styled(theme.text(&format!(", EGT (top: {top_egt:.0} °C)")), theme.style(Tone::Bad)),
    ];
    let of_demand = [
        Span::styled(", commanded", theme.style(Tone::Warn)),
        Span::raw(" and "),
        Span::styled("sent ", theme.style(Tone::Busy)),
    ];
    title.extend(if by_rpm { of_demand.to_vec() } else { vec![Span::raw(" ")] });
    let name = format!("{:.0}k", top_rpm / 1000.0);
    let strip = if by_rpm { 0 } else { STRIP.min(area.height / 3) };
    let [upper, lower] = Layout::vertical([Constraint::Fill(1), Constraint::Length(strip)]).areas(area);
    let room = usize::from(upper.width.saturating_sub(2));
    let below = Line::from(Span::styled(named(&marks, has_gap, room, theme), theme.style(Tone::Quiet)));
    chart(theme, frame, upper, [title.into(), below], &speeds, top_rpm, &name);
    if strip > 0 {
        let throttles = [
            ("marks", Tone::Quiet, through(THROTTLE_TOP)),
            ("sent", Tone::Busy, curve(&|point| point.sent_throttle, 1.0)),
            ("commanded", Tone::Warn, curve(&|point| point.throttle, 1.0)),
        ];
        let title = vec![
            Span::raw(" throttle "),
            Span::styled("commanded", theme.style(Tone::Warn)),
            Span::raw(" and "),
            Span::styled("sent ", theme.style(Tone::Busy)),
        ];
        chart(
            theme,
            frame,
            lower,
            [title.into(), Line::default()],
            &throttles,
            THROTTLE_TOP,
            &format!("{THROTTLE_TOP:.0} %"),
        );
    }
}

/// Events of an engine, in seconds before now, the latest last.
fn marks(model: &Model, engine: usize) -> Vec<(f64, String)> {
    let name = model.name(engine);
    let of_engine = model.events.iter().filter(|event| event.name == name || event.name == ALL);
    let mark = |event: &Event| {
        let t = seconds(event.at - Instant::MIN) - seconds(model.at - Instant::MIN);
        (t >= -SPAN).then(|| shown(&event.text)).flatten().map(|text| (t, text))
    };
    of_engine.filter_map(mark).collect()
}

/// The names of the lines in a chart, the latest last: as many as there is room for, and how many more there are.
fn named(marks: &[(f64, String)], has_gap: bool, room: usize, theme: Theme) -> String {
    let gap = has_gap.then(|| "bottom line: nothing received".to_owned());
    let latest = marks.iter().rev().map(|(t, text)| format!("{text} {t:.0} s"));
    // Events come first.
    let all: Vec<String> = latest.chain(gap).map(|text| theme.text(&text)).collect();
    let text = |shown: usize| {
        let names: Vec<&str> = all.iter().take(shown).rev().map(String::as_str).collect();
        let more = all.len() - shown;
        let more = if more > 0 { format!("{more} more, ") } else { String::new() };
        format!(" {more}{} ", names.join(", "))
    };
    let fits = (1..=all.len()).rev().map(text).find(|text| text.chars().count() <= room);
    fits.unwrap_or_default()
}

fn chart(
    theme: Theme,
    frame: &mut Frame<'_>,
    area: Rect,
    [title, below]: [Line<'static>; 2],
    curves: &[(&'static str, Tone, Curve)],
    top: f64,
    top_name: &str,
) {
    let quiet = theme.style(Tone::Quiet);
    let sets = curves.iter().flat_map(|(name, tone, pieces)| {
        let set = Dataset::default().name(*name).marker(theme.marker()).graph_type(GraphType::Line);
        let set = set.style(theme.style(*tone));
        pieces.iter().map(move |piece| set.clone().data(piece))
    });
    let label = |text: &str| Span::styled(text.to_owned(), quiet);
    let block =
        Block::bordered().border_set(theme.border()).border_style(quiet).title(title).title_bottom(below);
    let x = Axis::default().style(quiet).bounds([-SPAN, 0.0]);
    let y = Axis::default().style(quiet).bounds([0.0, top]);
    let chart = Chart::new(sets.collect())
        .block(block)
        .legend_position(None)
        .x_axis(x.labels(["-120 s", "-60 s", "now"].map(label)))
        .y_axis(y.labels([label("0"), label(top_name)]));
    frame.render_widget(chart, area);
}
