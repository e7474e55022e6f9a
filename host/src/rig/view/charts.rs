//! The last two minutes of each engine as a chart: shaft speed, demand and EGT.

use super::super::quantity::seconds;
use super::super::record::{Band, Point, thinned};
use super::model::Model;
use super::theme::{Theme, Tone};
use embassy_time::Instant;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::text::Span;
use ratatui::widgets::{Axis, Block, Chart, Dataset, GraphType};

/// What is shown, in seconds.
const SPAN: f64 = 120.0;
/// Charts beside one another.
const BESIDE: usize = 4;

/// Draws one for each engine.
pub fn draw(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let count = model.subjects.len();
    let beside = count.clamp(1, BESIDE);
    let lines = count.div_ceil(beside).max(1);
    for (line, place) in Layout::vertical(vec![Constraint::Fill(1); lines]).split(area).iter().enumerate() {
        for (i, place) in
            Layout::horizontal(vec![Constraint::Fill(1); beside]).split(*place).iter().enumerate()
        {
            let engine = line * beside + i;
            if engine < count {
                chart(model, theme, frame, *place, engine);
            }
        }
    }
}

fn chart(model: &Model, theme: Theme, frame: &mut Frame<'_>, area: Rect, engine: usize) {
    let Some(subject) = model.subjects.get(engine) else { return };
    let now = seconds(model.at - Instant::MIN);
    let begin = (now - SPAN).max(0.0);
    let points = thinned(model.record.since(engine, begin), usize::from(area.width) * 2);
    let percent = |band: Band, full: f64| [band.least / full * 100.0, band.most / full * 100.0];
    let curve = |value: &dyn Fn(&Point) -> Option<[f64; 2]>| -> Vec<(f64, f64)> {
        let of_point = |point: &Point| value(point).map(|both| both.map(|value| (point.t - now, value)));
        points.iter().filter_map(of_point).flatten().collect()
    };
    let rpm = curve(&|point| point.rpm.map(|band| percent(band, subject.max_rpm)));
    let egt_full = subject.egt_limit.unwrap_or(800.0);
    let egt = curve(&|point| point.egt.map(|band| percent(band, egt_full)));
    let demand = curve(&|point| {
        let throttle = point.throttle.map(|band| [band.least, band.most]);
        throttle.or(point.demand_rpm.map(|band| percent(band, subject.max_rpm)))
    });
    let style = |tone| theme.style(tone);
    let marker = theme.marker();
    let dataset = |name: &'static str, tone: Tone| {
        Dataset::default().name(name).marker(marker).graph_type(GraphType::Scatter).style(style(tone))
    };
    let sets = vec![
        dataset("demand", Tone::Warn).data(&demand),
        dataset("EGT", Tone::Bad).data(&egt),
        dataset("rpm", Tone::Good).data(&rpm),
    ];
    let title = format!(
        " {}: rpm, demand (100 % = {:.0} rpm), EGT (100 % = {egt_full:.0} °C) ",
        model.name(engine),
        subject.max_rpm
    );
    let block = Block::bordered()
        .border_set(theme.border())
        .border_style(style(Tone::Quiet))
        .title(Span::styled(theme.text(&title), style(Tone::Head)));
    let labels = |texts: [&'static str; 3]| texts.map(|text| Span::styled(text, style(Tone::Quiet)));
    let chart = Chart::new(sets)
        .block(block)
        .x_axis(
            Axis::default()
                .style(style(Tone::Quiet))
                .bounds([-SPAN, 0.0])
                .labels(labels(["-120 s", "-60 s", "now"])),
        )
        .y_axis(
            Axis::default()
                .style(style(Tone::Quiet))
                .bounds([0.0, 115.0])
                .labels(labels(["0", "58", "115 %"])),
        );
    frame.render_widget(chart, area);
}
