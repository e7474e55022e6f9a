//! SVG as text: the few shapes that a plot needs, and a place for a text where nothing crosses it.

use super::font::width;
use std::fmt::Write;

/// Which side of its place a text is on.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Anchor {
    /// It begins there.
    Start,
    /// It is centred there.
    Middle,
    /// It ends there.
    End,
}

/// How a line is drawn.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Stroke {
    /// In one piece.
    Solid,
    /// For an old value.
    Dashed,
    /// For a limit.
    Dotted,
}

impl Stroke {
    const fn attribute(self) -> &'static str {
        match self {
            Self::Solid => "",
            Self::Dashed => " stroke-dasharray=\"5 4\"",
            Self::Dotted => " stroke-dasharray=\"2 6\"",
        }
    }
}

/// A rectangle that a text takes: left, top, right, bottom.
type Area = [f64; 4];

/// A straight line, from and to.
type Line = ((f64, f64), (f64, f64));

/// A letter's height above the line of writing and below it, in parts of its size.
const ASCENT: f64 = 0.76;
const DESCENT: f64 = 0.24;

/// Least distance of a placed text from those beside it.
const APART: f64 = 4.0;
/// Between a text and its leader, and the dot at the leader's other end.
const LEADER_APART: f64 = 2.0;
const DOT: f64 = 4.0;

/// A picture that is being written.
#[derive(Debug)]
pub struct Svg {
    text: String,
    /// Lines that placed texts avoid.
    lines: Vec<Line>,
    texts: Vec<Area>,
}

/// A coordinate: tenths of a pixel are enough.
fn n(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
}

/// A text between tags.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

impl Svg {
    /// An empty one of this size on this ground.
    pub fn new(width: f64, height: f64, ground: &str) -> Self {
        let (width, height) = (n(width), n(height));
        let mut svg = Self { text: String::new(), lines: Vec::new(), texts: Vec::new() };
        svg.push(&format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"sans-serif\">"
        ));
        svg.push(&format!("<rect width=\"{width}\" height=\"{height}\" fill=\"{ground}\"/>"));
        svg
    }

    fn push(&mut self, element: &str) {
        self.text += element;
        self.text.push('\n');
    }

    /// A filled rectangle.
    pub fn rect(&mut self, (x, y): (f64, f64), (width, height): (f64, f64), fill: &str) {
        if width > 0.0 && height > 0.0 {
            let (x, y, width, height) = (n(x), n(y), n(width), n(height));
            self.push(&format!(
                "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" fill=\"{fill}\"/>"
            ));
        }
    }

    /// A straight line of the grid: a text may lie on it.
    pub fn grid(&mut self, from: (f64, f64), to: (f64, f64), color: &str) {
        self.polyline(&[from, to], color, 1.0, Stroke::Solid);
    }

    /// A straight line.
    pub fn line(&mut self, from: (f64, f64), to: (f64, f64), color: &str, width: f64) {
        self.path(&[from, to], color, width, Stroke::Solid);
    }

    /// A line through these points.
    pub fn path(&mut self, points: &[(f64, f64)], color: &str, width: f64, stroke: Stroke) {
        self.lines.extend(points.iter().copied().zip(points.iter().skip(1).copied()));
        self.polyline(points, color, width, stroke);
    }

    fn polyline(&mut self, points: &[(f64, f64)], color: &str, width: f64, stroke: Stroke) {
        if points.len() < 2 {
            return;
        }
        let points = joined(points);
        self.push(&format!(
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"{}\"{}/>",
            n(width),
            stroke.attribute()
        ));
    }

    /// The areas within these points, seen through.
    pub fn areas(&mut self, areas: &[Vec<(f64, f64)>], fill: &str) {
        if areas.is_empty() {
            return;
        }
        let outlines: String = areas.iter().map(|points| format!("M{}z", joined(points))).collect();
        self.push(&format!("<path d=\"{outlines}\" fill=\"{fill}\" fill-opacity=\"0.35\"/>"));
    }

    /// A text; `size` is in pixels.
    pub fn text(&mut self, (x, y): (f64, f64), size: u32, anchor: Anchor, fill: &str, text: &str) {
        self.texts.push(area((x, y), size, anchor, text));
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let (x, y, text) = (n(x), n(y), escaped(text));
        self.push(&format!(
            "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\" text-anchor=\"{anchor}\" fill=\"{fill}\">{text}</text>"
        ));
    }

    /// A text at the first of these places where no other text and no line is; nowhere if there is none. It keeps clear of
    /// what is drawn before it.
    pub fn place(
        &mut self,
        places: impl IntoIterator<Item = (f64, f64)>,
        size: u32,
        anchor: Anchor,
        fill: &str,
        text: &str,
    ) -> bool {
        let free = places.into_iter().find(|place| self.is_free(area(*place, size, anchor, text)));
        if let Some(place) = free {
            self.text(place, size, anchor, fill, text);
        }
        free.is_some()
    }

    /// The same for a text that is apart from what it names: a leader goes from its nearer end to that point, over lines
    /// and not over texts. The text begins at its place.
    pub fn place_with_leader(
        &mut self,
        places: impl IntoIterator<Item = ((f64, f64), (f64, f64))>,
        size: u32,
        fill: &str,
        text: &str,
    ) -> bool {
        let leader = |place: (f64, f64), end: (f64, f64)| {
            let [left, top, right, bottom] = area(place, size, Anchor::Start, text);
            let from = if end.0 < left { left - LEADER_APART } else { right + LEADER_APART };
            ((from, f64::midpoint(top, bottom)), end)
        };
        let is_free = |(place, end): &((f64, f64), (f64, f64))| {
            let line = leader(*place, *end);
            self.is_free(area(*place, size, Anchor::Start, text))
                && self.texts.iter().all(|other| !crosses(line, *other))
        };
        let free = places.into_iter().find(is_free);
        if let Some((place, end)) = free {
            self.text(place, size, Anchor::Start, fill, text);
            let (from, end) = leader(place, end);
            self.line(from, end, fill, 1.0);
            self.rect((end.0 - DOT / 2.0, end.1 - DOT / 2.0), (DOT, DOT), fill);
        }
        free.is_some()
    }

    fn is_free(&self, area: Area) -> bool {
        let [left, top, right, bottom] = area;
        let around = [left - APART, top, right + APART, bottom];
        self.texts.iter().all(|other| !overlap(around, *other))
            && self.lines.iter().all(|line| !crosses(*line, area))
    }

    /// The whole picture.
    pub fn finish(mut self) -> String {
        self.push("</svg>");
        self.text
    }
}

fn joined(points: &[(f64, f64)]) -> String {
    let mut text = String::new();
    for (x, y) in points {
        // A string takes everything.
        let _ = write!(text, "{},{} ", n(*x), n(*y));
    }
    text.truncate(text.trim_end().len());
    text
}

/// Area of a text.
fn area((x, y): (f64, f64), size: u32, anchor: Anchor, text: &str) -> Area {
    let wide = width(text.trim_matches(' '), size);
    let left = match anchor {
        Anchor::Start => x,
        Anchor::Middle => x - wide / 2.0,
        Anchor::End => x - wide,
    };
    let size = f64::from(size);
    [left, y - ASCENT * size, left + wide, y + DESCENT * size]
}

fn overlap(a: Area, b: Area) -> bool {
    let ([left, top, right, bottom], [other_left, other_top, other_right, other_bottom]) = (a, b);
    left < other_right && other_left < right && top < other_bottom && other_top < bottom
}

/// Whether a part of the line is in the area.
fn crosses((a, b): Line, [left, top, right, bottom]: Area) -> bool {
    // The part of the way that lies between two bounds.
    let part = |start: f64, end: f64, least: f64, most: f64| {
        let step = end - start;
        if step == 0.0 {
            let all = start > least && start < most;
            if all { (0.0, 1.0) } else { (1.0, 0.0) }
        } else {
            let (one, other) = ((least - start) / step, (most - start) / step);
            (one.min(other), one.max(other))
        }
    };
    let (x, y) = (part(a.0, b.0, left, right), part(a.1, b.1, top, bottom));
    x.0.max(y.0).max(0.0) < x.1.min(y.1).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_xml() {
        let mut svg = Svg::new(100.0, 50.5, "#fff");
        svg.text((1.0, 2.0), 12, Anchor::End, "#000", "a < b & c");
        svg.path(&[(0.0, 0.04), (1.25, 2.0)], "red", 1.5, Stroke::Dashed);
        let text = svg.finish();
        let xml = roxmltree::Document::parse(&text).expect("well-formed XML");
        assert!(xml.descendants().any(|node| node.text() == Some("a < b & c")));
        assert!(text.contains("points=\"0,0 1.2,2\"") && text.contains("stroke-dasharray"), "{text}");
    }

    #[test]
    fn a_text_is_placed_where_nothing_crosses_it() {
        let mut svg = Svg::new(100.0, 100.0, "#fff");
        svg.grid((0.0, 30.0), (100.0, 30.0), "#ddd");
        svg.line((10.0, 0.0), (10.0, 45.0), "red", 1.0);
        svg.path(&[(0.0, 90.0), (50.0, 50.0)], "red", 1.0, Stroke::Solid);
        let mut place = |places: &[(f64, f64)]| svg.place(places.to_vec(), 10, Anchor::Start, "#000", "text");
        // Beside the line; on the grid; where that text is; below the other line.
        assert!(!place(&[(5.0, 35.0), (15.0, 85.0)]));
        assert!(place(&[(5.0, 35.0), (15.0, 35.0)]));
        assert!(!place(&[(15.0, 35.0), (30.0, 35.0), (15.0, 42.0)]));
        assert!(place(&[(40.0, 80.0)]));
        let text = svg.finish();
        assert_eq!(text.matches("<text").count(), 2);
        assert!(text.contains("x=\"15\" y=\"35\"") && text.contains("x=\"40\" y=\"80\""), "{text}");
    }
}
