//! One engine of a plot: events above, shaft speed and EGT, the throttle in a strip of its own, the switch and the stages
//! of the run below. The lines come first, and then the texts where no line crosses them.

use super::super::audit::WireCommand;
use super::super::chronicle::{Happening, Subject};
use super::super::record::{Band, Point};
use super::font::width;
use super::marks::{Mark, SMALL, marks, unnamed};
use super::palette::Palette;
use super::scale::{Scale, thousands};
use super::svg::{Anchor, Stroke, Svg};

/// Height of such a line.
const LANE: f64 = 17.0;
const CAPTION: f64 = 30.0;
const CURVES: f64 = 180.0;
const STRIP: f64 = 64.0;
const RIBBON: f64 = 18.0;
/// The names of the stages: lines of text, and their height.
const STAGE_LINES: u32 = 2;
const STAGE_LINE: f64 = 16.0;
const STAGE_SIZE: u32 = 14;
const BETWEEN: f64 = 16.0;
/// The whole panel without those lines.
const HEIGHT: f64 =
    CAPTION + CURVES + BETWEEN + STRIP + BETWEEN + RIBBON + STAGE_LINES as f64 * STAGE_LINE + 4.0 + 24.0;
/// In pixels.
const SHORTEST_GAP: f64 = 4.0;
/// Between two places that are tried for a text.
const STEP: f64 = 8.0;
/// Least and greatest distance of a name from where it belongs, if there is no room there.
const LEADER: (f64, f64) = (12.0, 240.0);
/// The middle of a text above its line of writing, in parts of its size.
const MIDDLE: f64 = 0.26;
/// Room above the highest value.
const HEADROOM: f64 = 1.12;

/// The height of a panel with this number of lines of text.
pub fn height(lanes: usize) -> f64 {
    HEIGHT + LANE * lanes as f64
}

/// All that one panel needs.
#[derive(Debug)]
pub struct Panel<'a> {
    /// The engine.
    pub subject: &'a Subject,
    /// Its samples.
    pub points: &'a [Point],
    /// Events of it, or of all engines.
    pub happened: &'a [Happening],
    /// Lines of text for that.
    pub lanes: usize,
    /// The time axis.
    pub time: &'a Scale,
    /// The left and the right end of the time axis.
    pub sides: (f64, f64),
    /// Each point replaces several samples.
    pub bands: bool,
    /// The colours.
    pub palette: Palette,
}

/// A piece of a curve: whether its values are old, and its bands.
type Piece = (bool, Vec<(f64, Band)>);

impl Panel<'_> {
    /// Draws it from this height down.
    pub fn draw(&self, svg: &mut Svg, top: f64) {
        let lanes = top + CAPTION;
        let curves = lanes + LANE * self.lanes as f64;
        let strip = curves + CURVES + BETWEEN;
        let ribbon = strip + STRIP + BETWEEN;
        let caption = if self.subject.by_rpm {
            format!("{}; demand in rpm", self.subject.caption)
        } else {
            format!("{}; demand: 100 % = {} rpm", self.subject.caption, thousands(self.subject.max_rpm))
        };
        svg.text((20.0, top + 21.0), 19, Anchor::Start, self.palette.ink, &caption);
        let stages = ribbon + RIBBON;
        let (rpm, egt) = self.scales(curves);
        let percent = Scale::new(0.0..100.0, strip + STRIP..strip);

        self.stages(svg, curves, stages + f64::from(STAGE_LINES) * STAGE_LINE + 4.0);
        self.gaps(svg, curves);
        self.axes(svg, curves, &rpm, &egt);
        self.curves(svg, &rpm, &egt);
        self.strip(svg, strip, &percent);
        self.ribbon(svg, ribbon);
        self.happened(svg, lanes, ribbon);
        let fault_sets = self.fault_sets(svg, curves);

        self.stage_names(svg, stages);
        self.limit_name(svg, &egt);
        if self.subject.by_rpm {
            let value = |point: &Point| point.demand_rpm.and_then(level);
            self.levels(svg, &rpm, curves, curves + CURVES, &value, &thousands);
        } else {
            let value = |point: &Point| point.throttle.and_then(level);
            self.levels(svg, &percent, strip, strip + STRIP, &value, &|percent| format!("{percent} %"));
        }
        let without_name = self.gap_names(svg, curves) + self.fault_set_names(svg, curves, &fault_sets);
        if let Some(text) = unnamed(self.happened, self.time, self.sides, without_name) {
            svg.text((self.sides.1, top + 21.0), SMALL, Anchor::End, self.palette.mark, &text);
        }
    }

    fn at(&self, t: f64) -> f64 {
        self.time.at(t).clamp(self.sides.0, self.sides.1)
    }

    /// Runs of neighbouring points with equal keys, with their beginning and end.
    fn runs<K: PartialEq>(&self, of: impl Fn(&Point) -> K) -> Vec<(K, f64, f64)> {
        let mut runs: Vec<(K, f64, f64)> = Vec::new();
        for point in self.points {
            let key = of(point);
            match runs.last_mut() {
                Some((last, _, end)) if *last == key => *end = point.t,
                Some((_, _, end)) => {
                    *end = point.t;
                    runs.push((key, point.t, point.t));
                }
                None => runs.push((key, point.t, point.t)),
            }
        }
        runs
    }

    /// The stages of the run, as grounds.
    fn stages(&self, svg: &mut Svg, top: f64, bottom: f64) {
        for (stage, from, to) in self.runs(|point| point.stage) {
            let (from, to) = (self.at(from), self.at(to));
            svg.rect((from, top), (to - from, bottom - top), self.palette.stage(stage));
        }
    }

    /// Their names at the bottom, where no line is: first those of long stages, each anywhere in its own one. A name that is
    /// longer than its stage begins with it, and one that would run out of the picture ends with it.
    fn stage_names(&self, svg: &mut Svg, top: f64) {
        let mut stages = self.runs(|point| point.stage);
        stages.sort_by(|(_, from, to), (_, from_2, to_2)| (to_2 - from_2).total_cmp(&(to - from)));
        for (stage, from, to) in stages {
            let (from, name) = (self.at(from) + 3.0, stage.name());
            let wide = width(name, STAGE_SIZE);
            let at_end = from + wide > self.sides.1;
            let (first, anchor) = if at_end { (self.sides.1, Anchor::End) } else { (from, Anchor::Start) };
            let places = steps(first, self.at(to) - wide, STEP).flat_map(|x| {
                (1..=STAGE_LINES).map(move |line| (x, top + f64::from(line) * STAGE_LINE - 2.0))
            });
            svg.place(places, STAGE_SIZE, anchor, self.palette.ink, name);
        }
    }

    /// Where nothing is received, if it is long enough to be seen.
    fn silences(&self) -> impl Iterator<Item = (f64, f64)> {
        let silent = self.runs(|point| point.link).into_iter().filter(|(received, ..)| !received);
        silent.map(|(_, from, to)| (self.at(from), self.at(to)))
    }

    fn gaps(&self, svg: &mut Svg, top: f64) {
        for (from, to) in self.silences() {
            svg.rect((from, top), (to - from, CURVES), self.palette.gap);
        }
    }

    /// The name of each gap that is long enough to be seen: in it, or touching it, or else beside it with a leader into it.
    /// Returns how many have none.
    fn gap_names(&self, svg: &mut Svg, top: f64) -> usize {
        let text = "nothing received";
        let wide = width(text, SMALL);
        let bottom = top + CURVES;
        let mut unnamed = 0;
        for (from, to) in self.silences().filter(|(from, to)| to - from > SHORTEST_GAP) {
            let first = (from + 3.0).min(self.sides.1 - wide);
            let is_inside = |x: f64| x > self.sides.0 && x + wide < self.sides.1;
            let beside = [to + 3.0, from - 3.0 - wide].into_iter().filter(|x| is_inside(*x));
            let touching =
                within(first, to - wide, top, bottom).chain(beside.flat_map(|x| within(x, x, top, bottom)));
            if svg.place(touching, SMALL, Anchor::Start, self.palette.ink, text) {
                continue;
            }
            let inside = 4.0_f64.min((to - from) / 2.0);
            let apart = steps(LEADER.0, LEADER.1, STEP).flat_map(|apart| {
                let right = (to + apart, to - inside);
                let left = (from - apart - wide, from + inside);
                [right, left].into_iter().filter(|(x, _)| is_inside(*x)).flat_map(|(x, end)| {
                    within(x, x, top, bottom)
                        .map(move |(x, y)| ((x, y), (end, y - MIDDLE * f64::from(SMALL))))
                })
            });
            if !svg.place_with_leader(apart, SMALL, self.palette.ink, text) {
                unnamed += 1;
            }
        }
        unnamed
    }

    /// The axes of rpm and EGT.
    fn scales(&self, top: f64) -> (Scale, Scale) {
        let highest = |value: &dyn Fn(&Point) -> Option<Band>, least: f64| {
            self.points.iter().filter_map(value).map(|band| band.most).fold(least, f64::max) * HEADROOM
        };
        let most_rpm = highest(&|point| point.rpm, self.subject.max_rpm);
        let most_egt = highest(&|point| point.egt, self.subject.egt_limit.unwrap_or(800.0));
        let places = top + CURVES..top;
        (Scale::new(0.0..most_rpm, places.clone()), Scale::new(0.0..most_egt, places))
    }

    fn axes(&self, svg: &mut Svg, top: f64, rpm: &Scale, egt: &Scale) {
        let (left, right) = self.sides;
        for mark in rpm.marks(4).into_iter().filter(|mark| rpm.at(*mark) > top + 8.0) {
            let y = rpm.at(mark);
            svg.grid((left, y), (right, y), self.palette.grid);
            svg.text((left - 8.0, y + 5.0), 14, Anchor::End, self.palette.rpm, &thousands(mark));
        }
        for mark in egt.marks(4).into_iter().filter(|mark| egt.at(*mark) > top + 8.0) {
            let place = (right + 8.0, egt.at(mark) + 5.0);
            svg.text(place, 14, Anchor::Start, self.palette.egt, &thousands(mark));
        }
        svg.text((left - 8.0, top - 5.0), 14, Anchor::End, self.palette.rpm, "rpm");
        svg.text((right + 76.0, top - 5.0), 14, Anchor::End, self.palette.egt, "EGT in °C");
    }

    fn curves(&self, svg: &mut Svg, rpm: &Scale, egt: &Scale) {
        if let Some(limit) = self.subject.egt_limit {
            let y = egt.at(limit);
            svg.path(&[(self.sides.0, y), (self.sides.1, y)], self.palette.egt, 1.2, Stroke::Dotted);
        }
        self.curve(svg, rpm, self.palette.commanded, 4.0, &|point| (false, point.demand_rpm), true);
        self.curve(svg, rpm, self.palette.sent, 1.8, &|point| (false, point.sent_rpm), true);
        self.curve(svg, egt, self.palette.egt, 1.8, &|point| (point.egt_old, point.egt), false);
        self.curve(svg, rpm, self.palette.rpm, 1.8, &|point| (point.rpm_old, point.rpm), false);
    }

    /// The name of the EGT limit, from the end on, where most engines are cool: below its line or above it.
    fn limit_name(&self, svg: &mut Svg, egt: &Scale) {
        let Some(limit) = self.subject.egt_limit else { return };
        let (text, y) = (format!("EGT limit {limit:.0} °C"), egt.at(limit));
        let wide = width(&text, SMALL);
        let places =
            steps(self.sides.1 - 4.0, self.sides.0 + wide, -STEP).flat_map(|x| [(x, y + 14.0), (x, y - 5.0)]);
        svg.place(places, SMALL, Anchor::End, self.palette.egt, &text);
    }

    /// The throttle, 0 to 100 %.
    fn strip(&self, svg: &mut Svg, top: f64, percent: &Scale) {
        let bottom = top + STRIP;
        for mark in [0.0, 50.0, 100.0] {
            let y = percent.at(mark);
            svg.grid((self.sides.0, y), (self.sides.1, y), self.palette.grid);
        }
        if self.subject.by_rpm {
            let text = "throttle: none, the demand is in rpm";
            svg.text((self.sides.0 + 6.0, bottom - 24.0), 14, Anchor::Start, self.palette.commanded, text);
            return;
        }
        for mark in [0.0, 100.0] {
            let text = format!("{mark:.0} %");
            svg.text((self.sides.0 - 8.0, percent.at(mark) + 5.0), 14, Anchor::End, self.palette.ink, &text);
        }
        svg.text((20.0, top + 34.0), 14, Anchor::Start, self.palette.ink, "throttle");
        self.curve(svg, percent, self.palette.commanded, 4.0, &|point| (false, point.throttle), true);
        self.curve(svg, percent, self.palette.sent, 1.8, &|point| (false, point.sent_throttle), true);
    }

    /// The value at each step of a demand, above its line or below it, where there is room for it. A point that replaces
    /// several samples has no step.
    fn levels(
        &self,
        svg: &mut Svg,
        scale: &Scale,
        top: f64,
        bottom: f64,
        value: &dyn Fn(&Point) -> Option<f64>,
        label: &dyn Fn(f64) -> String,
    ) {
        for (value, from, to) in self.runs(value) {
            let Some(value) = value else { continue };
            let (text, y) = (label(value), scale.at(value));
            let wide = width(&text, SMALL);
            let (first, last) = (self.at(from) + 5.0, self.at(to) - 3.0 - wide);
            if first + wide > self.sides.1 || (self.bands && first > last) {
                continue;
            }
            let heights = [y - 6.0, y + 15.0].into_iter().filter(|y| *y >= top + 10.0 && *y <= bottom - 2.0);
            let places = steps(first, last, STEP / 2.0).flat_map(|x| heights.clone().map(move |y| (x, y)));
            svg.place(places, SMALL, Anchor::Start, self.palette.ink, &text);
        }
    }

    /// A curve in pieces where it is known: a band where points replace several samples, dashed where it is old.
    fn curve(
        &self,
        svg: &mut Svg,
        scale: &Scale,
        color: &str,
        wide: f64,
        value: &dyn Fn(&Point) -> (bool, Option<Band>),
        steps: bool,
    ) {
        let mut pieces: Vec<Piece> = Vec::new();
        let mut joins = false;
        for point in self.points {
            let (old, Some(band)) = value(point) else {
                joins = false;
                continue;
            };
            match pieces.last_mut() {
                Some((was_old, piece)) if joins && *was_old == old => piece.push((point.t, band)),
                last => {
                    // The piece between an old value and a new one is also old: it begins at the previous new value and ends at
                    // the next.
                    let mut before = None;
                    if let Some((was_old, piece)) = last.filter(|_| joins) {
                        if *was_old {
                            piece.push((point.t, band));
                        } else {
                            before = piece.last().copied();
                        }
                    }
                    pieces.push((old, before.into_iter().chain([(point.t, band)]).collect()));
                }
            }
            joins = true;
        }
        for (old, piece) in pieces {
            if self.bands && !old {
                let drawn = |area: Vec<(f64, f64)>| {
                    area.into_iter().map(|(t, value)| (self.at(t), scale.at(value))).collect()
                };
                svg.areas(&areas(&piece, steps).into_iter().map(drawn).collect::<Vec<_>>(), color);
            }
            let middle = |band: Band| f64::midpoint(band.least, band.most);
            let mut line: Vec<(f64, f64)> = Vec::new();
            for (t, band) in piece {
                let (x, y) = (self.at(t), scale.at(if steps { band.most } else { middle(band) }));
                if let Some(&(_, before)) = line.last()
                    && steps
                    && before != y
                {
                    line.push((x, before));
                }
                line.push((x, y));
            }
            let stroke = if old { Stroke::Dashed } else { Stroke::Solid };
            svg.path(&straightened(line), color, wide, stroke);
        }
    }

    /// The command on the wire: stop, standby or run; frames without a command, or nothing.
    fn ribbon(&self, svg: &mut Svg, top: f64) {
        let [stop, standby, run] = self.palette.wire;
        let name = |point: &Point| match point.on_wire {
            None => ("nothing", None),
            Some(WireCommand::Nothing) => ("no command", None),
            Some(WireCommand::Stop) => ("emergency stop", Some(stop)),
            Some(WireCommand::Standby) => ("standby", Some(standby)),
            Some(WireCommand::Run(_) | WireCommand::RunRpm(_)) => ("run", Some(run)),
        };
        for ((name, color), from, to) in self.runs(name) {
            let (from, to) = (self.at(from), self.at(to));
            if let Some(color) = color {
                svg.rect((from, top), (to - from, RIBBON), color);
            }
            let text = format!("on the wire: {name}");
            let text = if to - from > width(&text, SMALL) + 8.0 { text } else { name.to_owned() };
            if to - from > width(&text, SMALL) + 8.0 {
                svg.text((from + 5.0, top + 14.0), SMALL, Anchor::Start, self.palette.ink, &text);
            }
        }
    }

    /// What happened: a line through the panel and its name above, in one of the lines of text.
    fn happened(&self, svg: &mut Svg, lanes: f64, bottom: f64) {
        for Mark { x, text, lane, at_left } in marks(self.happened, self.time, self.sides) {
            // Without room for its name there is only the line, below all names.
            let y = lanes + LANE * lane.unwrap_or(self.lanes) as f64;
            svg.line((x, y + 3.0), (x, bottom), self.palette.mark, 1.0);
            if lane.is_some() {
                let anchor = if at_left { Anchor::End } else { Anchor::Start };
                svg.text((x, y + 13.0), SMALL, anchor, self.palette.mark, &text);
            }
        }
    }

    /// An AMT ECU with a fault sends sets that carry no rpm: from where to where.
    fn fault_sets(&self, svg: &mut Svg, top: f64) -> Vec<(f64, f64)> {
        let runs = self.runs(|point| point.link && point.fault && point.rpm.is_none());
        let runs = runs.into_iter().filter(|(dark, ..)| *dark);
        let sets: Vec<(f64, f64)> = runs.map(|(_, from, to)| (self.at(from), self.at(to))).collect();
        for (from, to) in &sets {
            svg.line((*from, top + CURVES - 4.0), (*to, top + CURVES - 4.0), self.palette.rpm, 3.0);
        }
        sets
    }

    /// Returns how many have none.
    fn fault_set_names(&self, svg: &mut Svg, top: f64, sets: &[(f64, f64)]) -> usize {
        let text = "fault sets: no rpm";
        let wide = width(text, SMALL);
        let mut unnamed = 0;
        for (from, to) in sets.iter().filter(|(from, to)| to - from > SHORTEST_GAP) {
            let first = from.min(self.sides.1 - wide);
            let places = within(first, to - wide, top, top + CURVES - 4.0);
            if !svg.place(places, SMALL, Anchor::Start, self.palette.rpm, text) {
                unnamed += 1;
            }
        }
        unnamed
    }
}

/// The value of a band that is no more than a line.
fn level(band: Band) -> Option<f64> {
    (band.least == band.most).then_some(band.most)
}

/// From the first to the last; the first one in any case.
fn steps(first: f64, last: f64, step: f64) -> impl Iterator<Item = f64> {
    let count = ((last - first) / step).max(0.0) as u32;
    (0..=count).map(move |i| first + f64::from(i) * step)
}

/// Places for a text, from the bottom up, in each line from the left to the right.
fn within(first: f64, last: f64, top: f64, bottom: f64) -> impl Iterator<Item = (f64, f64)> {
    steps(bottom - 6.0, top + f64::from(SMALL), -STEP)
        .flat_map(move |y| steps(first, last, STEP).map(move |x| (x, y)))
}

/// Areas of a curve's bands, where they are more than a line. A step holds until the next point.
fn areas(piece: &[(f64, Band)], steps: bool) -> Vec<Vec<(f64, f64)>> {
    if !steps {
        let upper = piece.iter().map(|(t, band)| (*t, band.most));
        let lower = piece.iter().rev().map(|(t, band)| (*t, band.least));
        return vec![upper.chain(lower).collect()];
    }
    let each = piece.iter().zip(piece.iter().skip(1)).filter(|((_, band), _)| band.most > band.least);
    let area = |(&(from, band), &(to, _)): (&(f64, Band), &(f64, Band))| {
        vec![(from, band.most), (to, band.most), (to, band.least), (from, band.least)]
    };
    each.map(area).collect()
}

/// The same line without the points between two that lie on a straight line with them.
fn straightened(line: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let mut straight: Vec<(f64, f64)> = Vec::new();
    for point in line {
        if let [.., a, b] = straight.as_slice() {
            let cross = (b.0 - a.0) * (point.1 - a.1) - (b.1 - a.1) * (point.0 - a.0);
            let on_line = cross.abs() < 0.3
                && (b.0 - a.0) * (point.0 - b.0) >= 0.0
                && (b.1 - a.1) * (point.1 - b.1) >= 0.0;
            if on_line {
                straight.pop();
            }
        }
        straight.push(point);
    }
    straight
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_demand_is_a_band_where_points_replace_samples() {
        let band = |least, most| Band { least, most };
        let piece = [(0.0, band(20.0, 60.0)), (3.2, band(60.0, 60.0)), (6.4, band(60.0, 60.0))];
        assert_eq!(areas(&piece, true), [[(0.0, 60.0), (3.2, 60.0), (3.2, 20.0), (0.0, 20.0)]]);
        assert_eq!(areas(&piece, false).len(), 1);
    }
}
