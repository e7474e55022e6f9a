//! One engine of a plot: what happened above, shaft speed and EGT, the throttle in a strip of its own, the switch below.

use super::super::audit::WireCommand;
use super::super::chronicle::{Happening, Subject};
use super::super::record::{Band, Point};
use super::palette::Palette;
use super::scale::{Scale, thousands};
use super::svg::{Anchor, Stroke, Svg, width};

/// Lines of text for what happened: as many as its names need, within these.
const LANES: (usize, usize) = (4, 8);
/// Height of such a line.
const LANE: f64 = 17.0;
const CAPTION: f64 = 30.0;
const CURVES: f64 = 200.0;
const STRIP: f64 = 64.0;
const RIBBON: f64 = 18.0;
const BETWEEN: f64 = 16.0;
/// The whole panel without those lines.
const HEIGHT: f64 = CAPTION + CURVES + BETWEEN + STRIP + BETWEEN + RIBBON + 24.0;
/// The smallest text.
const SMALL: u32 = 13;
/// In pixels.
const SHORTEST_GAP: f64 = 4.0;
/// Room above the highest value.
const HEADROOM: f64 = 1.08;

/// The height of a panel with this number of lines of text.
pub fn height(lanes: usize) -> f64 {
    HEIGHT + LANE * lanes as f64
}

/// Something that happened, in the picture.
struct Mark {
    x: f64,
    text: String,
    /// Its line of text; `None`: there is no room for its name.
    lane: Option<usize>,
    /// Its name ends at it.
    at_end: bool,
}

/// Places of the marks.
fn marks(happened: &[Happening], time: &Scale, sides: (f64, f64)) -> Vec<Mark> {
    let mut free = [sides.0; LANES.1];
    let seen = happened.iter().filter_map(|happening| {
        let x = time.at(happening.t);
        (x >= sides.0 && x <= sides.1).then_some((x, happening))
    });
    let mark = |(x, happening): (f64, &Happening)| {
        let text = format!("\u{a0}{}", happening.text);
        let wide = width(&text, SMALL) + 6.0;
        let at_end = x + wide > sides.1;
        let from = if at_end { x - wide } else { x };
        let lane = free.iter().position(|free| *free <= from);
        if let Some(free) = lane.and_then(|lane| free.get_mut(lane)) {
            *free = if at_end { x } else { x + wide };
        }
        Mark { x, text, lane, at_end }
    };
    seen.map(mark).collect()
}

/// The lines of text that this takes.
pub fn lanes(happened: &[Happening], time: &Scale, sides: (f64, f64)) -> usize {
    let last = marks(happened, time, sides).iter().filter_map(|mark| mark.lane).max();
    last.map_or(0, |last| last + 1).max(LANES.0)
}

/// That there are lines without a name.
fn unnamed(happened: &[Happening], time: &Scale, sides: (f64, f64)) -> Option<String> {
    let count = marks(happened, time, sides).iter().filter(|mark| mark.lane.is_none()).count();
    (count > 0).then(|| format!("{count} more marked without a name: no room"))
}

/// All that one panel needs.
#[derive(Debug)]
pub struct Panel<'a> {
    /// The engine.
    pub subject: &'a Subject,
    /// What was seen of it.
    pub points: &'a [Point],
    /// What happened to it, or to all.
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

/// A piece of a curve: whether it is old news, and its bands.
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
        if let Some(text) = unnamed(self.happened, self.time, self.sides) {
            svg.text((self.sides.1, top + 21.0), SMALL, Anchor::End, self.palette.mark, &text);
        }
        self.stages(svg, curves, ribbon + RIBBON);
        self.gaps(svg, curves);
        self.curves(svg, curves);
        self.strip(svg, strip);
        self.ribbon(svg, ribbon);
        self.happened(svg, lanes, ribbon);
        self.fault_sets(svg, curves);
    }

    fn at(&self, t: f64) -> f64 {
        self.time.at(t).clamp(self.sides.0, self.sides.1)
    }

    /// Neighbours with the same of something, with their beginning and their end.
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

    /// The stages of the run, with their names at the top.
    fn stages(&self, svg: &mut Svg, top: f64, bottom: f64) {
        let runs = self.runs(|point| point.stage);
        for (stage, from, to) in &runs {
            let (from, to) = (self.at(*from), self.at(*to));
            svg.rect((from, top), (to - from, bottom - top), self.palette.stage(*stage));
        }
        // Over all of them: a name may be longer than its stage, and one that would run out of the picture ends with it.
        let mut free = [self.sides.0; 2];
        for (stage, from, _) in &runs {
            let (from, wide) = (self.at(*from), width(stage.name(), 14) + 6.0);
            let at_end = from + wide > self.sides.1;
            let (x, anchor) = if at_end { (self.sides.1, Anchor::End) } else { (from, Anchor::Start) };
            let line = usize::from(free[0] > from.min(self.sides.1 - wide));
            if let Some(free) = free.get_mut(line) {
                *free = if at_end { self.sides.1 } else { from + wide };
            }
            let y = top + 14.0 + 15.0 * line as f64;
            svg.text((x, y), 14, anchor, self.palette.ink, &format!(" {} ", stage.name()));
        }
    }

    /// Where nothing is received.
    fn gaps(&self, svg: &mut Svg, top: f64) {
        // Beside one that is named another one is not.
        let mut free = self.sides.0;
        for (received, from, to) in self.runs(|point| point.link) {
            let (from, to) = (self.at(from), self.at(to));
            if received {
                continue;
            }
            svg.rect((from, top + 34.0), (to - from, CURVES - 34.0), self.palette.gap);
            // What is too short to be seen is not named either.
            if to - from > SHORTEST_GAP {
                let text = "nothing received";
                let wide = width(text, SMALL) + 3.0;
                let at_end = from + wide > self.sides.1;
                let (x, anchor) = if at_end { (to, Anchor::End) } else { (from + 3.0, Anchor::Start) };
                let first = if at_end { to - wide } else { from };
                if first >= free {
                    svg.text((x, top + CURVES - 6.0), SMALL, anchor, self.palette.ink, text);
                    free = first + wide;
                }
            }
        }
    }

    fn curves(&self, svg: &mut Svg, top: f64) {
        let bottom = top + CURVES;
        let highest = |value: &dyn Fn(&Point) -> Option<Band>, least: f64| {
            self.points.iter().filter_map(value).map(|band| band.most).fold(least, f64::max) * HEADROOM
        };
        // Room for the names of the stages.
        let room = 0.18;
        let most_rpm = highest(&|point| point.rpm, self.subject.max_rpm) * (1.0 + room);
        let most_egt = highest(&|point| point.egt, self.subject.egt_limit.unwrap_or(800.0)) * (1.0 + room);
        let rpm = Scale::new(0.0..most_rpm, bottom..top);
        let egt = Scale::new(0.0..most_egt, bottom..top);
        for mark in rpm.marks(4).into_iter().filter(|mark| rpm.at(*mark) > top + 8.0) {
            let y = rpm.at(mark);
            svg.line((self.sides.0, y), (self.sides.1, y), self.palette.grid, 1.0);
            svg.text((self.sides.0 - 8.0, y + 5.0), 14, Anchor::End, self.palette.rpm, &thousands(mark));
        }
        for mark in egt.marks(4).into_iter().filter(|mark| egt.at(*mark) > top + 8.0) {
            svg.text(
                (self.sides.1 + 8.0, egt.at(mark) + 5.0),
                14,
                Anchor::Start,
                self.palette.egt,
                &thousands(mark),
            );
        }
        svg.text((self.sides.0 - 8.0, top - 5.0), 14, Anchor::End, self.palette.rpm, "rpm");
        svg.text((self.sides.1 + 76.0, top - 5.0), 14, Anchor::End, self.palette.egt, "EGT in °C");
        if let Some(limit) = self.subject.egt_limit {
            let y = egt.at(limit);
            svg.path(&[(self.sides.0, y), (self.sides.1, y)], self.palette.egt, 1.2, Stroke::Dotted);
            // Below it: the names of the stages are above. At the end, where most engines are cool.
            let text = format!("EGT limit {limit:.0} °C");
            let place = (self.sides.1 - 4.0, y + 14.0);
            svg.text(place, SMALL, Anchor::End, self.palette.egt, &text);
        }
        self.curve(svg, &rpm, self.palette.commanded, 4.0, &|point| (false, point.demand_rpm), true);
        self.curve(svg, &rpm, self.palette.sent, 1.8, &|point| (false, point.sent_rpm), true);
        self.curve(svg, &egt, self.palette.egt, 1.8, &|point| (point.egt_old, point.egt), false);
        self.curve(svg, &rpm, self.palette.rpm, 1.8, &|point| (point.rpm_old, point.rpm), false);
        self.levels(
            svg,
            &rpm,
            |point| point.demand_rpm.map(|band| thousands(band.most)),
            |point| point.demand_rpm.map(|band| band.most),
        );
    }

    /// The throttle, 0 to 100 %.
    fn strip(&self, svg: &mut Svg, top: f64) {
        let bottom = top + STRIP;
        let percent = Scale::new(0.0..100.0, bottom..top);
        for mark in [0.0, 50.0, 100.0] {
            let y = percent.at(mark);
            svg.line((self.sides.0, y), (self.sides.1, y), self.palette.grid, 1.0);
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
        self.curve(svg, &percent, self.palette.commanded, 4.0, &|point| (false, point.throttle), true);
        self.curve(svg, &percent, self.palette.sent, 1.8, &|point| (false, point.sent_throttle), true);
        self.levels(
            svg,
            &percent,
            |point| point.throttle.map(|band| format!("{} %", band.most)),
            |point| point.throttle.map(|band| band.most),
        );
    }

    /// The value at each step of a demand, where there is room for it.
    fn levels(
        &self,
        svg: &mut Svg,
        scale: &Scale,
        label: impl Fn(&Point) -> Option<String>,
        value: impl Fn(&Point) -> Option<f64>,
    ) {
        for (text, from, to) in self.runs(label) {
            let Some(text) = text else { continue };
            let first = self.points.iter().find(|point| point.t >= from).and_then(&value);
            let Some(value) = first else { continue };
            let (from, to) = (self.at(from), self.at(to));
            if to - from > width(&text, SMALL) + 8.0 {
                let y = scale.at(value);
                // Above the line, or below it where it is high.
                let y = if value > 70.0 && !self.subject.by_rpm { y + 15.0 } else { y - 5.0 };
                svg.text((from + 5.0, y), SMALL, Anchor::Start, self.palette.ink, &text);
            }
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
                    // What joins an old value to a new one is as old: it begins at the new one before, and ends at the next.
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

    /// What was on the wire: stop, standby or run; frames without a command, or nothing.
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
        for Mark { x, text, lane, at_end } in marks(self.happened, self.time, self.sides) {
            let y = lanes + LANE * lane.unwrap_or(self.lanes.saturating_sub(1)) as f64;
            svg.line((x, y + 3.0), (x, bottom), self.palette.mark, 1.0);
            // Without room there is the line alone.
            if lane.is_some() {
                let anchor = if at_end { Anchor::End } else { Anchor::Start };
                svg.text((x, y + 13.0), SMALL, anchor, self.palette.mark, &text);
            }
        }
    }

    /// An AMT ECU with a fault sends sets that carry no rpm.
    fn fault_sets(&self, svg: &mut Svg, top: f64) {
        for (dark, from, to) in self.runs(|point| point.link && point.fault && point.rpm.is_none()) {
            if !dark {
                continue;
            }
            let (from, to) = (self.at(from), self.at(to));
            svg.line((from, top + CURVES - 4.0), (to, top + CURVES - 4.0), self.palette.rpm, 3.0);
            let text = "fault sets: no rpm";
            let at_end = from + width(text, SMALL) > self.sides.1;
            let (x, anchor) = if at_end { (self.sides.1, Anchor::End) } else { (from, Anchor::Start) };
            svg.text((x, top + CURVES - 9.0), SMALL, anchor, self.palette.rpm, text);
        }
    }
}

/// What a curve's bands cover, where they are more than a line. A step holds until the next point.
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
    let mut kept: Vec<(f64, f64)> = Vec::new();
    for point in line {
        if let [.., a, b] = kept.as_slice() {
            let cross = (b.0 - a.0) * (point.1 - a.1) - (b.1 - a.1) * (point.0 - a.0);
            let on_line = cross.abs() < 0.3
                && (b.0 - a.0) * (point.0 - b.0) >= 0.0
                && (b.1 - a.1) * (point.1 - b.1) >= 0.0;
            if on_line {
                kept.pop();
            }
        }
        kept.push(point);
    }
    kept
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

    #[test]
    fn marks_without_room_for_their_names_are_counted() {
        let of = |count: u32| {
            let happened = |i: u32| Happening {
                t: 50.0 + f64::from(i) / 10.0,
                engine: None,
                text: "limit: exhaust too hot".to_owned(),
            };
            (0..count).map(happened).collect::<Vec<_>>()
        };
        let sides = (100.0, 1220.0);
        let time = Scale::new(0.0..100.0, sides.0..sides.1);
        assert_eq!(unnamed(&of(8), &time, sides), None);
        assert_eq!(unnamed(&of(11), &time, sides).as_deref(), Some("3 more marked without a name: no room"));
    }
}
