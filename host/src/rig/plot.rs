//! The plot: one panel for each engine with speed and demand on the left, EGT on the right and the phases
//! of the run as bands behind them.

use super::audit::Said;
use super::desk::Stage;
use super::quantity::seconds;
use super::sample::Sample;
use core::ops::Range;
use embassy_time::Instant;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Points of a curve; a longer run keeps every second one, and so on.
const MOST_POINTS: usize = 4000;
const WIDTH: u32 = 1400;
/// What is shown before the first mark, in seconds.
const BEFORE_FIRST_MARK: f64 = 15.0;
const TITLE_HEIGHT: u32 = 80;
const PANEL_HEIGHT: u32 = 330;

const RPM: RGBColor = RGBColor(0x1f, 0x5f, 0xb4);
const DEMAND: RGBColor = RGBColor(0x90, 0x90, 0x90);
const WIRE: RGBColor = RGBColor(0x2c, 0x8c, 0x3c);
const MARK: RGBColor = RGBColor(0x7a, 0x1f, 0x7a);
const EGT: RGBColor = RGBColor(0xc8, 0x3c, 0x1e);
/// Below zero, as a part of the height: what was said of the switch.
const RIBBON: f64 = 0.09;
const INK: RGBColor = RGBColor(0x33, 0x33, 0x33);

/// One engine at one moment.
#[derive(Clone, Copy, Debug)]
struct Point {
    t: f64,
    stage: Stage,
    rpm: Option<f64>,
    egt: Option<f64>,
    silent: bool,
    throttle: Option<f64>,
    demand_rpm: Option<f64>,
    on_wire: Option<Said>,
}

/// What is needed to draw, gathered while the run goes on.
#[derive(Debug)]
pub struct Plot {
    path: String,
    captions: Vec<String>,
    title: String,
    points: Vec<Vec<Point>>,
    marks: Vec<(f64, String)>,
    every: u32,
    skipped: u32,
}

impl Plot {
    /// For engines with these captions. The file is created now, so that a wrong path is told before the run.
    pub fn create(path: &str, captions: Vec<String>, title: String) -> Result<Self, String> {
        std::fs::write(path, "").map_err(|error| format!("cannot write {path}: {error}"))?;
        let points = vec![Vec::new(); captions.len()];
        Ok(Self { path: path.to_owned(), captions, title, points, marks: Vec::new(), every: 1, skipped: 0 })
    }

    /// Keeps a sample of all engines.
    pub fn samples(&mut self, at: Instant, samples: &[Sample]) {
        self.skipped += 1;
        if self.skipped < self.every {
            return;
        }
        self.skipped = 0;
        let t = seconds(at - Instant::MIN);
        for (points, sample) in self.points.iter_mut().zip(samples) {
            points.push(Point {
                t,
                stage: sample.stage,
                rpm: sample.rpm.map(f64::from),
                egt: sample.egt,
                silent: sample.silent,
                throttle: sample.asked_percent(),
                demand_rpm: sample.asked_rpm().map(f64::from),
                on_wire: sample.on_wire,
            });
        }
        if self.points.iter().any(|points| points.len() > MOST_POINTS) {
            for points in &mut self.points {
                let mut keep = false;
                points.retain(|_| {
                    keep = !keep;
                    keep
                });
            }
            self.every *= 2;
        }
    }

    /// Marks this moment.
    pub fn mark(&mut self, at: Instant, label: &str) {
        self.marks.push((seconds(at - Instant::MIN), label.to_owned()));
    }

    /// Draws it.
    pub fn finish(self) -> Result<(), String> {
        let mut svg = String::new();
        self.draw(&mut svg).map_err(|error| format!("cannot draw {}: {error}", self.path))?;
        std::fs::write(&self.path, svg).map_err(|error| format!("cannot write {}: {error}", self.path))
    }

    fn draw(&self, svg: &mut String) -> Result<(), String> {
        let panels = u32::try_from(self.captions.len()).unwrap_or(1);
        let size = (WIDTH, TITLE_HEIGHT + PANEL_HEIGHT * panels);
        let root = SVGBackend::with_string(svg, size).into_drawing_area();
        root.fill(&WHITE).map_err(text)?;
        let (head, body) = root.split_vertically(TITLE_HEIGHT);
        self.head(&head)?;
        let end = self.points.iter().flatten().map(|point| point.t).fold(1.0, f64::max);
        // A scenario's way to its first event is not what it is about.
        let begin = self.marks.first().map_or(0.0, |(t, _)| (t - BEFORE_FIRST_MARK).max(0.0));
        let time = begin..end;
        for ((area, caption), points) in
            body.split_evenly((self.captions.len(), 1)).iter().zip(&self.captions).zip(&self.points)
        {
            let first = points.partition_point(|point| point.t < begin);
            panel(area, caption, points.get(first..).unwrap_or_default(), &self.marks, time.clone())?;
        }
        root.present().map_err(text)
    }

    /// The title and the legend, which holds for all panels.
    fn head(&self, area: &DrawingArea<SVGBackend<'_>, Shift>) -> Result<(), String> {
        area.draw(&Text::new(self.title.clone(), (20, 12), ("sans-serif", 26).into_font().color(&INK)))
            .map_err(text)?;
        let style = ("sans-serif", 18).into_font().color(&INK);
        let mut x = 22;
        for (label, color) in
            [("rpm", RPM), ("demand of the source", DEMAND), ("demand on the wire", WIRE), ("EGT", EGT)]
        {
            let line = vec![(x, 60), (x + 40, 60)];
            area.draw(&PathElement::new(line, color.stroke_width(3))).map_err(text)?;
            area.draw(&Text::new(label, (x + 50, 50), style.clone())).map_err(text)?;
            x += 70 + 9 * i32::try_from(label.len()).unwrap_or(0);
        }
        Ok(())
    }
}

/// Only a writer can fail here, and a string does not.
fn text(error: impl core::fmt::Display) -> String {
    error.to_string()
}

fn panel(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    caption: &str,
    points: &[Point],
    marks: &[(f64, String)],
    time: Range<f64>,
) -> Result<(), String> {
    // The labels of the marks stand above the curves.
    let headroom = if marks.is_empty() { 1.15 } else { 1.5 };
    let highest = |value: fn(&Point) -> Option<f64>, least: f64| {
        points.iter().filter_map(value).fold(least, f64::max) * headroom
    };
    // Engines whose scale is not known report no rpm (AMT-5): the axis is there all the same.
    let top_rpm = highest(|point| point.rpm, 1000.0).max(highest(|point| point.demand_rpm, 0.0));
    let top_egt = highest(|point| point.egt, 100.0);
    let by_rpm = points.iter().any(|point| point.demand_rpm.is_some());
    // A demand in percent is drawn against the same height: 100 % is the highest rpm that was seen.
    let per_percent = top_rpm / headroom / 100.0;

    let mut chart = ChartBuilder::on(area)
        .margin_left(10)
        .margin_right(10)
        .margin_top(6)
        .caption(caption, ("sans-serif", 22).into_font().color(&INK))
        .x_label_area_size(44)
        .y_label_area_size(90)
        .right_y_label_area_size(80)
        .build_cartesian_2d(time.clone(), -RIBBON * top_rpm..top_rpm)
        .map_err(text)?
        .set_secondary_coord(time.clone(), -RIBBON * top_egt..top_egt);

    bands(&mut chart, points, top_rpm, &time)?;
    ribbon(&mut chart, points, top_rpm, &time)?;
    let labels = ("sans-serif", 16).into_font().color(&INK);
    chart
        .configure_mesh()
        .disable_x_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .axis_style(INK)
        .x_desc("time in s")
        .x_labels(12)
        .x_label_formatter(&|t| format!("{t:.0}"))
        .y_desc(if by_rpm { "rpm and demand" } else { "rpm; demand: 100 % at the top rpm" })
        .y_labels(6)
        .y_label_formatter(&|rpm| not_below_zero(*rpm))
        .label_style(labels.clone())
        .axis_desc_style(labels.clone())
        .draw()
        .map_err(text)?;
    chart
        .configure_secondary_axes()
        .axis_style(EGT)
        .y_desc("EGT in °C")
        .y_labels(6)
        .y_label_formatter(&|egt| not_below_zero(*egt))
        .label_style(("sans-serif", 16).into_font().color(&EGT))
        .axis_desc_style(("sans-serif", 16).into_font().color(&EGT))
        .draw()
        .map_err(text)?;

    let asked = |point: &Point| {
        let asked = point.demand_rpm.or(point.throttle.map(|percent| percent * per_percent));
        (!point.silent).then(|| asked.unwrap_or(0.0))
    };
    let wire = |point: &Point| {
        Some(match point.on_wire? {
            Said::Run(tenths) => f64::from(tenths) / 10.0 * per_percent,
            Said::RunRpm(rpm) => f64::from(rpm),
            Said::Stop | Said::Standby | Said::Nothing => 0.0,
        })
    };
    for curve in steps(points, asked) {
        chart.draw_series(LineSeries::new(curve, DEMAND.stroke_width(5))).map_err(text)?;
    }
    for curve in steps(points, wire) {
        chart.draw_series(LineSeries::new(curve, WIRE.stroke_width(2))).map_err(text)?;
    }
    for curve in curves(points, |point| point.rpm) {
        chart.draw_series(LineSeries::new(curve, RPM.stroke_width(2))).map_err(text)?;
    }
    for curve in curves(points, |point| point.egt) {
        chart.draw_secondary_series(LineSeries::new(curve, EGT.stroke_width(2))).map_err(text)?;
    }
    draw_marks(&mut chart, marks, top_rpm, &time)
}

fn not_below_zero(value: f64) -> String {
    if value < 0.0 { String::new() } else { format!("{value:.0}") }
}

/// What was on the wire: stop, standby or run.
fn ribbon(chart: &mut Chart<'_, '_>, points: &[Point], top: f64, time: &Range<f64>) -> Result<(), String> {
    let name = |point: &Point| match point.on_wire {
        None | Some(Said::Nothing) => None,
        Some(Said::Stop) => Some(("emergency stop", RGBColor(0xf0, 0x80, 0x70))),
        Some(Said::Standby) => Some(("standby", RGBColor(0xd4, 0xd4, 0xd4))),
        Some(Said::Run(_) | Said::RunRpm(_)) => Some(("run", RGBColor(0xa8, 0xdc, 0xa8))),
    };
    let pieces: Vec<&[Point]> = points.chunk_by(|a, b| name(a) == name(b)).collect();
    for (i, piece) in pieces.iter().enumerate() {
        let (Some(first), Some(last)) = (piece.first(), piece.last()) else { continue };
        let until = pieces.get(i + 1).and_then(|next| next.first()).map_or(last.t, |next| next.t);
        let Some((name, color)) = name(first) else { continue };
        let area = Rectangle::new([(first.t, -RIBBON * top), (until, -0.02 * top)], color.filled());
        chart.draw_series([area]).map_err(text)?;
        if (until - first.t) / (time.end - time.start) > 0.008 * (name.len() + 14) as f64 {
            let style = ("sans-serif", 13).into_font().color(&INK).pos(Pos::new(HPos::Left, VPos::Center));
            let at = (first.t, -0.055 * top);
            chart.draw_series([Text::new(format!(" on the wire: {name}"), at, style)]).map_err(text)?;
        }
    }
    Ok(())
}

/// A line at each marked moment, with its name beside it; the names stand below each other.
fn draw_marks(
    chart: &mut Chart<'_, '_>,
    marks: &[(f64, String)],
    top: f64,
    time: &Range<f64>,
) -> Result<(), String> {
    let length = time.end - time.start;
    for (i, (t, label)) in marks.iter().enumerate() {
        let line = PathElement::new(vec![(*t, 0.0), (*t, top)], MARK.stroke_width(2));
        chart.draw_series([line]).map_err(text)?;
        let right = t + 0.0068 * length * label.chars().count() as f64 > time.end;
        let (side, label) = if right {
            (HPos::Right, format!("{label}\u{a0}"))
        } else {
            (HPos::Left, format!("\u{a0}{label}"))
        };
        let style = ("sans-serif", 16).into_font().color(&MARK).pos(Pos::new(side, VPos::Top));
        let height = top * (0.92 - 0.065 * (i % 4) as f64);
        chart.draw_series([Text::new(label, (*t, height), style)]).map_err(text)?;
    }
    Ok(())
}

type Chart<'a, 'b> = plotters::chart::DualCoordChartContext<
    'a,
    SVGBackend<'b>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
>;

/// The phases of the run, with their names at the top.
fn bands(chart: &mut Chart<'_, '_>, points: &[Point], top: f64, time: &Range<f64>) -> Result<(), String> {
    let end = points.last().map_or(1.0, |point| point.t).max(1.0);
    let length = time.end - time.start;
    let bands: Vec<&[Point]> = points.chunk_by(|a, b| a.stage == b.stage).collect();
    let mut names = Vec::new();
    for (i, band) in bands.iter().enumerate() {
        let Some(first) = band.first() else { continue };
        let until = bands.get(i + 1).and_then(|next| next.first()).map_or(end, |next| next.t);
        let color = match first.stage {
            Stage::Standby => RGBColor(0xee, 0xee, 0xee),
            Stage::Start => RGBColor(0xff, 0xf0, 0xd0),
            Stage::Idle => RGBColor(0xe6, 0xf4, 0xe2),
            Stage::Steps => RGBColor(0xe2, 0xee, 0xfa),
            Stage::Cooling => RGBColor(0xf8, 0xe6, 0xee),
            Stage::Done => RGBColor(0xf4, 0xf4, 0xf4),
            Stage::Failed => RGBColor(0xff, 0xc8, 0xc8),
            Stage::Event => RGBColor(0xfd, 0xfa, 0xe4),
        };
        let area = Rectangle::new([(first.t, 0.0), (until, top)], color.filled());
        // A name that is longer than its band stands a line lower, clear of its neighbour's.
        let narrow = (until - first.t) / length < 0.008 * first.stage.name().len() as f64;
        let height = if narrow { top * 0.93 } else { top };
        let style = ("sans-serif", 15).into_font().color(&INK).pos(Pos::new(HPos::Left, VPos::Top));
        let name = Text::new(format!(" {}", first.stage.name()), (first.t, height), style);
        chart.draw_series([area]).map_err(text)?;
        names.push(name);
    }
    // Over all bands, because a name may be longer than its own.
    chart.draw_series(names).map_err(text)?;
    Ok(())
}

/// The curve of a value, in pieces where it is not known.
fn curves(points: &[Point], value: fn(&Point) -> Option<f64>) -> Vec<Vec<(f64, f64)>> {
    points
        .chunk_by(|a, b| value(a).is_some() == value(b).is_some())
        .map(|piece| {
            piece.iter().filter_map(|point| Some((point.t, value(point)?))).collect::<Vec<(f64, f64)>>()
        })
        .filter(|piece| !piece.is_empty())
        .collect()
}

/// The curve of a value that jumps, in pieces where there is none.
fn steps(points: &[Point], value: impl Fn(&Point) -> Option<f64>) -> Vec<Vec<(f64, f64)>> {
    let mut curves = Vec::new();
    let mut curve: Vec<(f64, f64)> = Vec::new();
    for point in points {
        match value(point) {
            Some(now) => {
                if let Some(&(_, before)) = curve.last()
                    && before != now
                {
                    curve.push((point.t, before));
                }
                curve.push((point.t, now));
            }
            None if !curve.is_empty() => curves.push(core::mem::take(&mut curve)),
            None => {}
        }
    }
    curves.push(curve);
    curves.retain(|curve| !curve.is_empty());
    curves
}
