//! Plain lines, for an output that is not a terminal and for runs faster than a person reads.

use super::context::Note;
use super::engines::ALL;
use super::fit::wrapped;
use super::out::Out;
use super::quantity::seconds;
use super::row::{heads, row};
use super::sample::Sample;
use embassy_time::{Duration, Instant};
use jetlink::report::LinkState;
use std::io;

/// Lines between two heads.
const HEAD_EVERY: u32 = 40;

/// Columns of the time before a row, and before the text of a note.
const TIME: usize = 9;
const INDENT: usize = 23;

/// Between two counts of frames.
const RATE_SPAN: Duration = Duration::from_secs(2);

/// Writes notes as they come and, every now and then, one line for each engine.
#[derive(Debug)]
pub struct Lines {
    out: Out,
    names: Vec<&'static str>,
    every: Duration,
    next: Instant,
    rates: Rates,
    lines: u32,
    /// Columns of the output.
    width: usize,
}

impl Lines {
    /// For these engines. `width`: that of the terminal; without one lines are as long as they are.
    pub fn new(out: Out, names: Vec<&'static str>, every: Duration, width: Option<usize>) -> Self {
        let width = width.unwrap_or(usize::MAX);
        Self { out, names, every, next: Instant::MIN + every, rates: Rates::default(), lines: 0, width }
    }

    /// Something happened.
    pub fn note(&self, note: &Note) -> io::Result<()> {
        let name = note.engine.and_then(|i| self.names.get(i)).copied().unwrap_or(ALL);
        let line = format!("{:>7.1}  {name:<12}  {}", seconds(note.at - Instant::MIN), note.text);
        let lines = wrapped(&line, self.width, INDENT, '…');
        self.out.write(&lines.into_iter().map(|line| line + "\n").collect::<String>())
    }

    /// A sample of all engines; written if it is time.
    pub fn samples(&mut self, at: Instant, samples: &[Sample]) -> io::Result<()> {
        self.rates.count(at, samples);
        if at < self.next {
            return Ok(());
        }
        self.next = at + self.every;
        let (mut text, most) = (String::new(), self.width.saturating_sub(TIME));
        if self.lines.is_multiple_of(HEAD_EVERY) {
            text += &format!("{:>7}  {}\n", "s", heads(&self.names, most));
        }
        for (i, (name, sample)) in self.names.iter().zip(samples).enumerate() {
            let row = row(name, &self.names, sample, self.rates.of(i), most);
            text += &format!("{:>7.1}  {row}\n", seconds(at - Instant::MIN));
            self.lines += 1;
        }
        self.out.write(&text)
    }
}

/// Frames a second of each engine.
#[derive(Debug, Default)]
pub struct Rates {
    /// When they were counted last; and of each engine its count then, if its link was up.
    before: Option<(Instant, Vec<Option<u32>>)>,
    rates: Vec<Option<f64>>,
}

impl Rates {
    /// Counts, if it is time.
    pub fn count(&mut self, at: Instant, samples: &[Sample]) {
        let (since, counts) = match &self.before {
            Some((since, _)) if at < *since + RATE_SPAN => return,
            Some((since, counts)) => (*since, counts.as_slice()),
            None => (at, &[][..]),
        };
        let passed = seconds(at - since);
        let rate = |(sample, before): (&Sample, &Option<u32>)| {
            // A count that is lower than before has begun again: all of it is new.
            let now = sample.counters.frames;
            before.map(|before| f64::from(now.checked_sub(before).unwrap_or(now)) / passed)
        };
        self.rates = samples.iter().zip(counts).map(rate).collect();
        let counts =
            samples.iter().map(|sample| (sample.link == LinkState::Up).then_some(sample.counters.frames));
        self.before = Some((at, counts.collect()));
    }

    /// Of this engine; `None` while its link has not been up for long enough.
    pub fn of(&self, engine: usize) -> Option<f64> {
        self.rates.get(engine).copied().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::super::context::{EngineContext, Notes};
    use super::super::engines::engines;
    use super::super::node::Node;
    use super::*;

    #[test]
    fn a_rate_is_known_when_the_link_was_up_at_both_ends() {
        let engines = engines(&[]).unwrap();
        let (node, notes) = (Node::new(&engines, false), Notes::default());
        let context = EngineContext::new(0, &engines[0], Instant::MIN, &notes);
        let quiet = Sample::take(&context, &node.telemetry(0), true);
        let sample = |link, frames| {
            let mut sample = Sample { link, ..quiet };
            sample.counters.frames = frames;
            sample
        };
        let (up, silent) = (LinkState::Up, LinkState::Silent);
        let at = |seconds| Instant::MIN + Duration::from_secs(seconds);
        let mut rates = Rates::default();
        let mut count = |seconds, samples: [(LinkState, u32); 3]| {
            rates.count(at(seconds), &samples.map(|(link, frames)| sample(link, frames)));
            [0, 1, 2].map(|engine| rates.of(engine))
        };
        assert_eq!(count(0, [(silent, 0), (up, 500), (silent, 0)]), [None; 3]);
        // Too early: as before.
        assert_eq!(count(1, [(up, 8), (up, 540), (silent, 0)]), [None; 3]);
        // The count of the second one has begun again.
        assert_eq!(count(5, [(up, 16), (up, 20), (up, 3)]), [None, Some(4.0), None]);
        assert_eq!(count(10, [(up, 56), (up, 120), (up, 4)]), [Some(8.0), Some(20.0), Some(0.2)]);
    }
}
