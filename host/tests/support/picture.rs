//! Judges a picture by its SVG: whether each text can be read.

#[path = "../../src/rig/plot/font.rs"]
mod font;

use roxmltree::{Document, Node};

/// Lines that only help: a text may lie on them.
const GRID: [&str; 2] = ["#dddddd", "#30363d"];
/// A letter's height above the line of writing and below it, in parts of the font's size.
const ASCENT: f64 = 0.75;
const DESCENT: f64 = 0.2;
/// What touches is no overlap.
const SLACK: f64 = 0.7;

#[derive(Clone, Copy, Debug)]
struct Area {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl Area {
    fn meets(self, other: Self) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }

    fn is_within(self, other: Self) -> bool {
        self.left >= other.left
            && self.right <= other.right
            && self.top >= other.top
            && self.bottom <= other.bottom
    }

    fn smaller(self, by: f64) -> Self {
        Self { left: self.left + by, top: self.top + by, right: self.right - by, bottom: self.bottom - by }
    }

    /// Whether a straight line has a part within it.
    fn is_crossed(self, (a, b): ((f64, f64), (f64, f64))) -> bool {
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        for (start, end, least, most) in
            [(a.0, b.0, self.left, self.right), (a.1, b.1, self.top, self.bottom)]
        {
            let step = end - start;
            if step.abs() < 1e-9 {
                if start <= least || start >= most {
                    return false;
                }
            } else {
                let (one, other) = ((least - start) / step, (most - start) / step);
                from = from.max(one.min(other));
                to = to.min(one.max(other));
            }
        }
        from < to
    }
}

fn number(node: &Node<'_, '_>, name: &str) -> f64 {
    node.attribute(name).unwrap_or_else(|| panic!("{name}: {node:?}")).parse().expect("pixels")
}

fn area_of(node: &Node<'_, '_>, text: &str) -> Area {
    let (x, y, size) = (number(node, "x"), number(node, "y"), number(node, "font-size"));
    // White space at the ends is not drawn, a space that does not break is.
    let wide = font::width(text.trim_matches([' ', '\n']), size as u32);
    let left = match node.attribute("text-anchor") {
        Some("end") => x - wide,
        Some("middle") => x - wide / 2.0,
        _ => x,
    };
    Area { left, top: y - ASCENT * size, right: left + wide, bottom: y + DESCENT * size }
}

/// The straight lines of a polyline, or of a path that has only `M` and `L`.
fn straight_lines(node: &Node<'_, '_>) -> Vec<((f64, f64), (f64, f64))> {
    let of = node.attribute("points").or_else(|| node.attribute("d")).unwrap_or_default();
    let numbers: Vec<f64> = of
        .split([' ', ',', 'M', 'L'])
        .filter(|text| !text.is_empty())
        .map(|text| text.parse().unwrap_or_else(|_| panic!("{text}: {node:?}")))
        .collect();
    let points: Vec<(f64, f64)> = numbers.as_chunks().0.iter().map(|&[x, y]| (x, y)).collect();
    points.windows(2).map(|two| (two[0], two[1])).collect()
}

/// What makes a text of this picture hard to read: it runs out of the picture or of a box, another text or a line is in it.
pub fn hard_to_read(svg: &str) -> Vec<String> {
    let xml = Document::parse(svg).expect("well-formed XML");
    let view: Vec<f64> = xml
        .root_element()
        .attribute("viewBox")
        .expect("a view box")
        .split(' ')
        .map(|text| text.parse().expect("pixels"))
        .collect();
    let whole = Area { left: view[0], top: view[1], right: view[0] + view[2], bottom: view[1] + view[3] };
    let named = |kind: &'static str| xml.descendants().filter(move |node| node.has_tag_name(kind));
    let texts: Vec<(&str, Area)> = named("text")
        .filter_map(|node| node.text().map(|text| (text, area_of(&node, text))))
        .filter(|(text, _)| !text.trim().is_empty())
        .collect();
    let boxes: Vec<Area> = named("rect")
        .filter(|node| node.attribute("stroke").is_some())
        .map(|node| {
            let (left, top) = (number(&node, "x"), number(&node, "y"));
            let (right, bottom) = (left + number(&node, "width"), top + number(&node, "height"));
            Area { left, top, right, bottom }
        })
        .collect();
    let stroked = |node: &Node<'_, '_>| node.attribute("stroke").is_some_and(|color| !GRID.contains(&color));
    let lines: Vec<_> = named("polyline")
        .chain(named("path"))
        .filter(stroked)
        .flat_map(|node| straight_lines(&node))
        .collect();

    let mut found = Vec::new();
    for (i, &(text, area)) in texts.iter().enumerate() {
        if !area.is_within(whole) {
            found.push(format!("`{text}` runs out of the picture"));
        }
        if boxes.iter().any(|&frame| area.meets(frame) && !area.is_within(frame.smaller(2.0))) {
            found.push(format!("`{text}` runs out of a box, or into one"));
        }
        for (other, of_other) in &texts[i + 1..] {
            if area.smaller(SLACK).meets(of_other.smaller(SLACK)) {
                found.push(format!("`{text}` and `{other}` overlap"));
            }
        }
        if let Some((from, to)) = lines.iter().find(|&&line| area.smaller(SLACK).is_crossed(line)) {
            found.push(format!("`{text}` is crossed by the line from {from:?} to {to:?}"));
        }
    }
    found
}

/// Colours of the ground where nothing is received, and the height of the curves, which no other rectangle of them has.
const GAPS: [&str; 2] = ["#c9c9c9", "#3d444d"];
const CURVES: f64 = 180.0;
/// The heights that the grounds of stages have, and nothing else.
const STAGES: core::ops::Range<f64> = 300.0..340.0;
const STAGE_NAMES: [&str; 10] =
    ["standby", "start", "idle", "steps", "cooling", "done", "failed", "source lost", "played", "commanded"];

/// Whether this is the name of a stage: one of every run, or of what a scenario is about.
fn is_stage(text: &str) -> bool {
    STAGE_NAMES.contains(&text) || SCENARIOS.lines().any(|line| line.trim() == format!("name: \"{text}\","))
}

const SCENARIOS: &str = include_str!("../../src/rig/scenario.rs");
/// A gap that is no wider need not be named.
const SHORTEST_GAP: f64 = 4.1;
/// Where the time axis of a plot ends, and the size of the texts above it.
const RIGHT: f64 = 1220.0;
const SMALL: &str = "13";

/// What is named falsely in the plot of a run: a name that does not touch its gap and has no leader into it, a gap without a
/// name where the picture does not say that one is missing, a long stage without its name, a text beyond the time axis.
pub fn false_names(svg: &str) -> Vec<String> {
    let xml = Document::parse(svg).expect("well-formed XML");
    let named = |kind: &'static str| xml.descendants().filter(move |node| node.has_tag_name(kind));
    let grounds: Vec<(&str, Area)> = named("rect")
        .filter(|node| node.attribute("x").is_some())
        .map(|node| {
            let (left, top) = (number(&node, "x"), number(&node, "y"));
            let (right, bottom) = (left + number(&node, "width"), top + number(&node, "height"));
            (node.attribute("fill").unwrap_or_default(), Area { left, top, right, bottom })
        })
        .collect();
    let height = |area: &Area| area.bottom - area.top;
    let is_gap = |fill: &&str, area: &Area| GAPS.contains(fill) && (height(area) - CURVES).abs() < 0.2;
    let gaps: Vec<Area> =
        grounds.iter().filter(|(fill, area)| is_gap(fill, area)).map(|(_, area)| *area).collect();
    let texts: Vec<(&str, &str, Area)> = named("text")
        .filter_map(|node| Some((node.text()?, node.attribute("font-size")?, area_of(&node, node.text()?))))
        .collect();
    let lines: Vec<_> = named("polyline").flat_map(|node| straight_lines(&node)).collect();
    // A leader begins beside the name, and ends in what it names.
    let leads = |name: Area, gap: Area| {
        lines.iter().any(|&(from, to)| {
            let at = |(x, y), area: Area| Area { left: x, right: x, top: y, bottom: y }.is_within(area);
            at(from, name.smaller(-4.0)) && at(to, gap.smaller(-0.1))
        })
    };

    let mut found = Vec::new();
    let mut without = vec![true; gaps.len()];
    for &(text, _, name) in texts.iter().filter(|(text, ..)| *text == "nothing received") {
        let named = gaps.iter().position(|gap| name.smaller(-4.0).meets(*gap));
        match named.or_else(|| gaps.iter().position(|&gap| leads(name, gap))) {
            Some(gap) => without[gap] = false,
            None => found.push(format!("`{text}` at x = {:.0} is at no gap", name.left)),
        }
    }
    let says_so = texts.iter().any(|(text, ..)| text.contains("more marked without a name"));
    for (gap, _) in gaps.iter().zip(without).filter(|(_, without)| *without && !says_so) {
        if gap.right - gap.left > SHORTEST_GAP {
            found.push(format!("the gap at x = {:.0} has no name", gap.left));
        }
    }
    for (_, ground) in grounds.iter().filter(|(_, area)| STAGES.contains(&height(area))) {
        let is_name =
            |(text, _, area): &(&str, &str, Area)| is_stage(text) && area.is_within(ground.smaller(-1.0));
        if ground.right - ground.left > 120.0 && !texts.iter().any(is_name) {
            found.push(format!("the stage from x = {:.0} to {:.0} has no name", ground.left, ground.right));
        }
    }
    for (text, ..) in texts.iter().filter(|(_, size, area)| *size == SMALL && area.right > RIGHT + 0.5) {
        found.push(format!("`{text}` runs out of the plot"));
    }
    found
}
