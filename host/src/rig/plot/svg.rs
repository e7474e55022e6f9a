//! SVG as text: the few shapes that a plot needs.

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
    /// For a value that is not new.
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

/// A picture that is being written.
#[derive(Debug)]
pub struct Svg {
    text: String,
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
        let mut svg = Self { text: String::new() };
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

    /// A straight line.
    pub fn line(&mut self, from: (f64, f64), to: (f64, f64), color: &str, width: f64) {
        self.path(&[from, to], color, width, Stroke::Solid);
    }

    /// A line through these points.
    pub fn path(&mut self, points: &[(f64, f64)], color: &str, width: f64, stroke: Stroke) {
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

/// About the width of a text, in pixels: fonts differ.
pub fn width(text: &str, size: u32) -> f64 {
    0.56 * f64::from(size) * text.chars().count() as f64
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
}
