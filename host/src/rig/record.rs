//! The record of a run: what was seen of each engine over time, thinned to bands of least and most where it is long. The
//! charts on the screen and the pictures read it.

use super::audit::WireCommand;
use super::context::Stage;
use super::quantity::seconds;
use super::sample::{SAMPLE_EVERY, Sample};
use embassy_time::Instant;

/// Points of an engine; when there are more, each two become one.
const MOST_POINTS: usize = 8000;

/// Points of the last two minutes, one for each sample.
const RECENT_POINTS: usize = 1210;

/// The least and the most of a value within a time.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Band {
    /// The least.
    pub least: f64,
    /// The most.
    pub most: f64,
}

impl Band {
    /// Of one value.
    pub const fn of(value: f64) -> Self {
        Self { least: value, most: value }
    }

    /// Of both.
    pub const fn with(self, other: Self) -> Self {
        Self { least: self.least.min(other.least), most: self.most.max(other.most) }
    }
}

/// One engine in a short time.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Point {
    /// Its beginning, in seconds.
    pub t: f64,
    /// How far its pilot has come, at the end.
    pub stage: Stage,
    /// Shaft speed; `None`: the ECU has not reported it lately.
    pub rpm: Option<Band>,
    /// EGT in °C; `None` as above.
    pub egt: Option<Band>,
    /// The shaft speed is from before, and no newer one has come.
    pub rpm_old: bool,
    /// The same of the EGT.
    pub egt_old: bool,
    /// Its source is silent.
    pub silent: bool,
    /// The ECU is received.
    pub link: bool,
    /// The ECU reports a fault.
    pub fault: bool,
    /// Throttle that is commanded, in percent.
    pub throttle: Option<Band>,
    /// Shaft speed that is commanded.
    pub demand_rpm: Option<Band>,
    /// Throttle that was sent, in percent.
    pub sent_throttle: Option<Band>,
    /// Shaft speed that was sent.
    pub sent_rpm: Option<Band>,
    /// What was on the wire, at the end.
    pub on_wire: Option<WireCommand>,
}

impl Point {
    /// Of a sample.
    pub fn of(at: Instant, sample: &Sample) -> Self {
        Self {
            t: seconds(at - Instant::MIN),
            stage: sample.stage,
            rpm: sample.rpm.map(|rpm| Band::of(rpm.into())),
            egt: sample.egt.map(Band::of),
            rpm_old: sample.rpm_old.is_some(),
            egt_old: sample.egt_old.is_some(),
            silent: sample.silent,
            link: sample.link == jetlink::report::LinkState::Up,
            fault: sample.faults.is_some_and(|faults| !faults.is_empty()),
            throttle: sample.commanded_percent().map(Band::of),
            demand_rpm: sample.commanded_rpm().map(|rpm| Band::of(rpm.into())),
            sent_throttle: match sample.on_wire {
                Some(WireCommand::Run(tenths)) => Some(Band::of(f64::from(tenths) / 10.0)),
                _ => None,
            },
            sent_rpm: match sample.on_wire {
                Some(WireCommand::RunRpm(rpm)) => Some(Band::of(rpm.into())),
                _ => None,
            },
            on_wire: sample.on_wire,
        }
    }

    /// This one and the next as one. A value that is missing in one of them stays missing: a gap is not drawn over.
    fn with(&self, next: &Self) -> Self {
        let both = |a: Option<Band>, b: Option<Band>| Some(a?.with(b?));
        Self {
            t: self.t,
            rpm: both(self.rpm, next.rpm),
            egt: both(self.egt, next.egt),
            throttle: both(self.throttle, next.throttle),
            demand_rpm: both(self.demand_rpm, next.demand_rpm),
            sent_throttle: both(self.sent_throttle, next.sent_throttle),
            sent_rpm: both(self.sent_rpm, next.sent_rpm),
            rpm_old: self.rpm_old && next.rpm_old,
            egt_old: self.egt_old && next.egt_old,
            silent: self.silent || next.silent,
            link: self.link && next.link,
            fault: self.fault || next.fault,
            ..*next
        }
    }
}

/// What was seen of all engines.
#[derive(Debug, Default)]
pub struct Record {
    engines: Vec<Vec<Point>>,
    /// The last minutes of each, a point for each sample.
    recent: Vec<Vec<Point>>,
    /// Samples that make a point.
    each: u32,
    /// Those of them that the last point has.
    had: u32,
}

impl Record {
    /// Of this number of engines.
    pub fn new(engines: usize) -> Self {
        Self { engines: vec![Vec::new(); engines], recent: vec![Vec::new(); engines], each: 1, had: 0 }
    }

    /// A sample of all engines.
    pub fn add(&mut self, at: Instant, samples: &[Sample]) {
        let begins = self.had == 0;
        self.had = (self.had + 1) % self.each;
        for (points, sample) in self.engines.iter_mut().zip(samples) {
            add(points, at, sample, begins);
        }
        for (points, sample) in self.recent.iter_mut().zip(samples) {
            if points.len() >= 2 * RECENT_POINTS {
                points.drain(..RECENT_POINTS);
            }
            add(points, at, sample, true);
        }
        if self.had == 0 && self.engines.iter().any(|points| points.len() >= MOST_POINTS) {
            for points in &mut self.engines {
                *points = thinned(points, MOST_POINTS / 2);
            }
            self.each *= 2;
        }
    }

    /// The points of an engine.
    pub fn points(&self, engine: usize) -> &[Point] {
        self.engines.get(engine).map_or(&[], Vec::as_slice)
    }

    /// How many samples make one point: more than one where a long run was thinned.
    pub const fn samples_a_point(&self) -> u32 {
        self.each
    }

    /// Those since this time, in seconds.
    pub fn since(&self, engine: usize, t: f64) -> &[Point] {
        since(self.points(engine), t)
    }

    /// The same in the last two minutes, a point for each sample however long the run is.
    pub fn recent(&self, engine: usize, t: f64) -> &[Point] {
        since(self.recent.get(engine).map_or(&[], Vec::as_slice), t)
    }
}

fn since(points: &[Point], t: f64) -> &[Point] {
    points.get(points.partition_point(|point| point.t < t)..).unwrap_or_default()
}

/// Adds a sample, as a point of its own or to the last one.
fn add(points: &mut Vec<Point>, at: Instant, sample: &Sample, begins: bool) {
    let point = Point::of(at, sample);
    match points.last_mut() {
        Some(last) if !begins => *last = last.with(&point),
        _ => points.push(point),
    }
    // That nothing newer came is known later than it was so.
    let old = |received: Instant| seconds(received + SAMPLE_EVERY - Instant::MIN);
    let (rpm_from, egt_from) = (sample.rpm_old.map(old), sample.egt_old.map(old));
    for point in points.iter_mut().rev() {
        let (rpm, egt) = [rpm_from, egt_from].map(|from| from.is_some_and(|from| point.t >= from)).into();
        if !rpm && !egt {
            break;
        }
        point.rpm_old |= rpm;
        point.egt_old |= egt;
    }
}

/// At most this number of these points, each with the least and the most of those that it replaces.
pub fn thinned(points: &[Point], most: usize) -> Vec<Point> {
    let each = points.len().div_ceil(most.max(1)).max(1);
    let one = |points: &[Point]| {
        let (first, rest) = points.split_first()?;
        Some(rest.iter().fold(*first, |one, next| one.with(next)))
    };
    points.chunks(each).filter_map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(i: u32) -> Point {
        Point {
            t: f64::from(i) / 10.0,
            stage: Stage::Steps,
            rpm: Some(Band::of(f64::from(i % 100))),
            egt: (i != 7).then_some(Band::of(500.0)),
            rpm_old: false,
            egt_old: false,
            silent: false,
            link: true,
            fault: false,
            throttle: Some(Band::of(60.0)),
            demand_rpm: None,
            sent_throttle: Some(Band::of(60.0)),
            sent_rpm: None,
            on_wire: Some(WireCommand::Run(600)),
        }
    }

    #[test]
    fn thinning_keeps_the_extremes_and_the_gaps() {
        let points: Vec<Point> = (0..1000).map(point).collect();
        let thin = thinned(&points, 10);
        assert_eq!(thin.len(), 10);
        assert!(thin.iter().all(|point| point.rpm == Some(Band { least: 0.0, most: 99.0 })));
        assert_eq!((thin[0].egt, thin[1].egt), (None, Some(Band::of(500.0))));
        assert_eq!(thinned(&points, 2000), points);
    }
}
