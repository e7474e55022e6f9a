//! The plot: one panel for each engine with speed and demand on the left, EGT on the right and the phases
//! of the run as bands behind them.

use super::audit::Said;
use super::desk::Stage;
use super::output::Whole;
use super::quantity::seconds;
use super::sample::Sample;
use core::ops::Range;
use embassy_time::Instant;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// What is drawn of one engine.
#[derive(Debug)]
pub struct Subject {
    /// What it is.
    pub caption: String,
    /// Shaft speed at full throttle: a demand of 100 % is drawn there.
    pub max_rpm: f64,
    /// It is commanded by rpm.
    pub by_rpm: bool,
}

/// Points of a curve; a longer run keeps every second one, and so on.
const MOST_POINTS: usize = 4000;
const WIDTH: u32 = 1400;
/// What is shown before the first mark, in seconds.
const BEFORE_FIRST_MARK: f64 = 15.0;
const TITLE_HEIGHT: u32 = 80;
const PANEL_HEIGHT: u32 = 330;

const RPM: RGBColor = RGBColor(0x1f, 0x5f, 0xb4);
const DEMAND: RGBColor = RGBColor(0x90, 0x90, 0x90);
/// The same colour, to be read.
const ASKED_INK: RGBColor = RGBColor(0x60, 0x60, 0x60);
const WIRE: RGBColor = RGBColor(0x2c, 0x8c, 0x3c);
const MARK: RGBColor = RGBColor(0x7a, 0x1f, 0x7a);
const EGT: RGBColor = RGBColor(0xc8, 0x3c, 0x1e);
/// Below zero, as a part of the height: what was said of the switch.
const RIBBON: f64 = 0.09;
/// A text beside a line, and its distance from it, as parts of the height.
const LABEL_HEIGHT: f64 = 0.056;
const LEVEL_GAP: f64 = 0.005;
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

impl Point {
    /// What is asked for, as a speed; in standby 0.
    fn asked(&self, max_rpm: f64) -> Option<f64> {
        let asked = self.demand_rpm.or(self.throttle.map(|percent| percent / 100.0 * max_rpm));
        (!self.silent).then(|| asked.unwrap_or(0.0))
    }

    /// What was last on the wire, as a speed; for whatever is no run 0.
    fn wire(&self, max_rpm: f64) -> Option<f64> {
        Some(match self.on_wire? {
            Said::Run(tenths) => f64::from(tenths) / 1000.0 * max_rpm,
            Said::RunRpm(rpm) => f64::from(rpm),
            Said::Stop | Said::Standby | Said::Nothing => 0.0,
        })
    }

    /// The demand of the source in words, where it asks for a run.
    fn asked_label(&self) -> Option<String> {
        let by_throttle = || self.throttle.map(|percent| format!("{percent} %"));
        if self.silent { None } else { self.demand_rpm.map(thousands).or_else(by_throttle) }
    }

    /// The demand on the wire in words, where it is a run at something else than what is asked for.
    fn wire_label(&self, max_rpm: f64) -> Option<String> {
        let label = match self.on_wire? {
            Said::Run(tenths) => format!("{} %", f64::from(tenths) / 10.0),
            Said::RunRpm(rpm) => thousands(f64::from(rpm)),
            Said::Stop | Said::Standby | Said::Nothing => return None,
        };
        // A wire has its own grain.
        let same = |asked: f64| self.wire(max_rpm).is_some_and(|wire| (wire - asked).abs() < 0.01 * max_rpm);
        (!self.asked(max_rpm).is_some_and(same)).then_some(label)
    }
}

/// `108 500`.
fn thousands(value: f64) -> String {
    let digits = format!("{value:.0}");
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push('\u{a0}');
        }
        text.push(digit);
    }
    text
}

/// What is needed to draw, gathered while the run goes on.
#[derive(Debug)]
pub struct Plot {
    file: Whole,
    subjects: Vec<Subject>,
    title: String,
    points: Vec<Vec<Point>>,
    marks: Vec<(f64, String)>,
    every: u32,
    skipped: u32,
}

impl Plot {
    /// For these engines.
    pub fn create(path: &str, subjects: Vec<Subject>, title: String) -> Result<Self, String> {
        let points = vec![Vec::new(); subjects.len()];
        Ok(Self {
            file: Whole::create(path)?,
            subjects,
            title,
            points,
            marks: Vec::new(),
            every: 1,
            skipped: 0,
        })
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
        self.draw(&mut svg).map_err(|error| format!("cannot draw {}: {error}", self.file.path()))?;
        self.file.finish(&svg)
    }

    fn draw(&self, svg: &mut String) -> Result<(), String> {
        let panels = u32::try_from(self.subjects.len()).unwrap_or(1);
        let size = (WIDTH, TITLE_HEIGHT + PANEL_HEIGHT * panels);
        let root = SVGBackend::with_string(svg, size).into_drawing_area();
        root.fill(&WHITE).map_err(text)?;
        let (head, body) = root.split_vertically(TITLE_HEIGHT);
        self.head(&head)?;
        let end = self.points.iter().flatten().map(|point| point.t).fold(1.0, f64::max);
        // A scenario's way to its first event is not what it is about.
        let begin = self.marks.first().map_or(0.0, |(t, _)| (t - BEFORE_FIRST_MARK).max(0.0));
        let time = begin..end;
        for ((area, subject), points) in
            body.split_evenly((self.subjects.len(), 1)).iter().zip(&self.subjects).zip(&self.points)
        {
            let first = points.partition_point(|point| point.t < begin);
            panel(area, subject, points.get(first..).unwrap_or_default(), &self.marks, time.clone())?;
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
    subject: &Subject,
    points: &[Point],
    marks: &[(f64, String)],
    time: Range<f64>,
) -> Result<(), String> {
    // The labels of the marks stand above the curves.
    let headroom = if marks.is_empty() { 1.2 } else { 1.6 };
    let highest = |value: &dyn Fn(&Point) -> Option<f64>, least: f64| {
        points.iter().filter_map(value).fold(least, f64::max) * headroom
    };
    let asked = |point: &Point| point.asked(subject.max_rpm);
    let wire = |point: &Point| point.wire(subject.max_rpm);
    // Engines whose scale is not known report no rpm (AMT-5): the axis is there all the same.
    let top_rpm = highest(&|point| point.rpm, 1000.0).max(highest(&asked, 0.0));
    let top_egt = highest(&|point| point.egt, 100.0);
    let caption = if subject.by_rpm {
        format!("{}; demand in rpm", subject.caption)
    } else {
        format!("{}; demand: 100 % = {} rpm", subject.caption, thousands(subject.max_rpm))
    };

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
        .y_desc("rpm")
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
    levels(&mut chart, points, subject.max_rpm, (top_rpm, top_egt), &time)?;
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

/// The value at each step of the demand, where there is room for it.
fn levels(
    chart: &mut Chart<'_, '_>,
    points: &[Point],
    max_rpm: f64,
    top: (f64, f64),
    time: &Range<f64>,
) -> Result<(), String> {
    type Height = fn(&Point, f64) -> Option<f64>;
    let asked: Vec<Option<String>> = points.iter().map(Point::asked_label).collect();
    let wire: Vec<Option<String>> = points.iter().map(|point| point.wire_label(max_rpm)).collect();
    for (labels, height, color) in
        [(&asked, Point::asked as Height, ASKED_INK), (&wire, Point::wire as Height, WIRE)]
    {
        let mut from = 0;
        for piece in labels.chunk_by(|a, b| a == b) {
            let first = points.get(from);
            from += piece.len();
            let until = points.get(from).or(points.last()).map_or(0.0, |point| point.t);
            let (Some(Some(text)), Some(first)) = (piece.first(), first) else { continue };
            let Some(height) = height(first, max_rpm) else { continue };
            let label = Label {
                text,
                x: first.t,
                low: height + LEVEL_GAP * top.0,
                side: HPos::Left,
                size: 15,
                color,
            };
            if first.t + label.width(time) <= until {
                label.beside_curves(points, until, top, time).draw(chart, top.0, time)?;
            }
        }
    }
    Ok(())
}

/// A text beside a line.
#[derive(Clone, Copy)]
struct Label<'a> {
    text: &'a str,
    x: f64,
    /// Its lower edge.
    low: f64,
    side: HPos,
    size: u32,
    color: RGBColor,
}

impl Label<'_> {
    /// About, in seconds: fonts differ.
    fn width(&self, time: &Range<f64>) -> f64 {
        0.00034 * f64::from(self.size) * (time.end - time.start) * (self.text.chars().count() + 1) as f64
    }

    /// Where it hides no curve, before `until`: above its level, or below it; where it is if there is no such place.
    fn beside_curves(self, points: &[Point], until: f64, top: (f64, f64), time: &Range<f64>) -> Self {
        let width = self.width(time);
        let below = self.low - (LABEL_HEIGHT + 2.0 * LEVEL_GAP) * top.0;
        let places = (0..20).map(|i| self.x + f64::from(i) * width / 2.0).take_while(|x| x + width <= until);
        places
            .flat_map(|x| [(x, self.low), (x, below)])
            .filter(|&(_, low)| low >= 0.0)
            .find(|&(x, low)| {
                let height = low / top.0..low / top.0 + LABEL_HEIGHT;
                let hides =
                    |value: Option<f64>, top: f64| value.is_some_and(|value| height.contains(&(value / top)));
                let from = points.partition_point(|point| point.t < x);
                let under = points.iter().skip(from).take_while(|point| point.t <= x + width);
                !under.into_iter().any(|point| hides(point.rpm, top.0) || hides(point.egt, top.1))
            })
            .map_or(self, |(x, low)| Self { x, low, ..self })
    }

    /// On a white ground: lines behind it do not cross it out.
    fn draw(&self, chart: &mut Chart<'_, '_>, top: f64, time: &Range<f64>) -> Result<(), String> {
        let (left, label) = match self.side {
            HPos::Right => (self.x - self.width(time), format!("{}\u{a0}", self.text)),
            HPos::Left | HPos::Center => (self.x, format!("\u{a0}{}", self.text)),
        };
        let ground = [(left, self.low), (left + self.width(time), self.low + LABEL_HEIGHT * top)];
        chart.draw_series([Rectangle::new(ground, WHITE.mix(0.8).filled())]).map_err(text)?;
        let style = ("sans-serif", self.size).into_font().color(&self.color);
        let style = style.pos(Pos::new(self.side, VPos::Center));
        let at = (self.x, self.low + LABEL_HEIGHT / 2.0 * top);
        chart.draw_series([Text::new(label, at, style)]).map_err(text)?;
        Ok(())
    }
}

/// A line at each marked moment, with its name beside it; the names stand below each other, and a line ends at the
/// top of its own.
fn draw_marks(
    chart: &mut Chart<'_, '_>,
    marks: &[(f64, String)],
    top: f64,
    time: &Range<f64>,
) -> Result<(), String> {
    let height = |i: usize| top * (0.92 - 0.065 * (i % 4) as f64);
    for (i, (t, _)) in marks.iter().enumerate() {
        let line = PathElement::new(vec![(*t, 0.0), (*t, height(i))], MARK.stroke_width(2));
        chart.draw_series([line]).map_err(text)?;
    }
    for (i, (t, label)) in marks.iter().enumerate() {
        let low = height(i) - LABEL_HEIGHT * top;
        let mut label = Label { text: label, x: *t, low, side: HPos::Left, size: 16, color: MARK };
        if t + label.width(time) > time.end {
            label.side = HPos::Right;
        }
        label.draw(chart, top, time)?;
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
    let mut lower = false;
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
            Stage::Played => RGBColor(0xee, 0xe6, 0xfa),
        };
        let area = Rectangle::new([(first.t, 0.0), (until, top)], color.filled());
        // A name that is longer than its band stands a line lower, clear of its neighbour's.
        let room = 0.008 * length * first.stage.name().len() as f64;
        lower = until - first.t < room && !lower;
        let height = if lower { top * 0.93 } else { top };
        // And one that would run out of the picture ends with it.
        let (side, x) =
            if first.t + room > time.end { (HPos::Right, time.end) } else { (HPos::Left, first.t) };
        let style = ("sans-serif", 15).into_font().color(&INK).pos(Pos::new(side, VPos::Top));
        let name = Text::new(format!(" {} ", first.stage.name()), (x, height), style);
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

#[cfg(test)]
mod tests {
    use super::*;

    fn points(rpm: impl Fn(f64) -> f64) -> Vec<Point> {
        let point = |i| {
            let t = f64::from(i) / 10.0;
            Point {
                t,
                stage: Stage::Steps,
                rpm: Some(rpm(t)),
                egt: None,
                silent: false,
                throttle: Some(60.0),
                demand_rpm: None,
                on_wire: Some(Said::Run(600)),
            }
        };
        (0..=1000).map(point).collect()
    }

    #[test]
    fn full_demand_is_at_the_engines_highest_speed() {
        let mut point = points(|_| 50_000.0)[0];
        assert_eq!((point.asked(160_000.0), point.wire(160_000.0)), (Some(96_000.0), Some(96_000.0)));
        assert_eq!((point.asked_label().as_deref(), point.wire_label(160_000.0)), (Some("60 %"), None));
        point.on_wire = Some(Said::Run(405));
        assert_eq!(point.wire_label(160_000.0).as_deref(), Some("40.5 %"));
        point.on_wire = Some(Said::Stop);
        assert_eq!((point.wire(160_000.0), point.wire_label(160_000.0)), (Some(0.0), None));
        point.silent = true;
        assert_eq!((point.asked(160_000.0), point.asked_label()), (None, None));
    }

    #[test]
    fn digits_stand_in_threes() {
        for (value, text) in
            [(0.0, "0"), (950.4, "950"), (96_000.0, "96\u{a0}000"), (1e6, "1\u{a0}000\u{a0}000")]
        {
            assert_eq!(thousands(value), text);
        }
    }

    #[test]
    fn a_value_hides_no_curve() {
        let (top, time) = ((100.0, 100.0), 0.0..100.0);
        let label = Label { text: "60 %", x: 10.0, low: 60.5, side: HPos::Left, size: 15, color: WIRE };
        let place = |rpm: &dyn Fn(f64) -> f64| {
            let label = label.beside_curves(&points(rpm), 90.0, top, &time);
            (label.x, label.low < 60.0)
        };
        assert_eq!(place(&|_| 80.0), (10.0, false));
        assert_eq!(place(&|_| 62.0), (10.0, true));
        // Above and below at once, for a while.
        let (x, _) = place(&|t| {
            if t > 20.0 {
                80.0
            } else if ((t * 10.0) as u32).is_multiple_of(2) {
                57.0
            } else {
                63.0
            }
        });
        assert!(x > 20.0 && x < 23.0, "{x}");
    }
}
