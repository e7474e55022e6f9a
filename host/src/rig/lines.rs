//! Plain lines, for an output that is not a terminal and for runs that are faster than a person reads.

use super::context::Note;
use super::engines::ALL;
use super::out::Out;
use super::quantity::seconds;
use super::row::{heads, row};
use super::sample::Sample;
use embassy_time::{Duration, Instant};
use std::io;

/// Lines between two heads.
const HEAD_EVERY: u32 = 40;

/// Writes notes as they come and, every now and then, one line for each engine.
#[derive(Debug)]
pub struct Lines {
    out: Out,
    names: Vec<&'static str>,
    every: Duration,
    next: Instant,
    /// Frames of each engine at the last lines, and when that was.
    before: Option<(Instant, Vec<u32>)>,
    lines: u32,
}

impl Lines {
    /// For these engines.
    pub fn new(out: Out, names: Vec<&'static str>, every: Duration) -> Self {
        Self { out, names, every, next: Instant::MIN + every, before: None, lines: 0 }
    }

    /// Something happened.
    pub fn note(&self, note: &Note) -> io::Result<()> {
        let name = note.engine.and_then(|i| self.names.get(i)).copied().unwrap_or(ALL);
        self.out.write(&format!("{:>7.1}  {name:<12}  {}\n", seconds(note.at - Instant::MIN), note.text))
    }

    /// A sample of all engines; written if it is time.
    pub fn samples(&mut self, at: Instant, samples: &[Sample]) -> io::Result<()> {
        if at < self.next {
            return Ok(());
        }
        self.next = at + self.every;
        let mut text = String::new();
        if self.lines.is_multiple_of(HEAD_EVERY) {
            text += &format!("{:>7}  {}\n", "s", heads(&self.names));
        }
        let frames: Vec<u32> = samples.iter().map(|sample| sample.counters.frames).collect();
        let rates = frame_rates(&self.before, at, &frames);
        for ((name, sample), rate) in self.names.iter().zip(samples).zip(rates) {
            text +=
                &format!("{:>7.1}  {}\n", seconds(at - Instant::MIN), row(name, &self.names, sample, rate));
            self.lines += 1;
        }
        self.before = Some((at, frames));
        self.out.write(&text)
    }
}

/// Frames a second of each engine since `before`, or since the start.
pub fn frame_rates(before: &Option<(Instant, Vec<u32>)>, at: Instant, frames: &[u32]) -> Vec<f64> {
    let (since, counts) = match before {
        Some((since, counts)) => (*since, counts.as_slice()),
        None => (Instant::MIN, &[][..]),
    };
    let passed = seconds(at - since).max(0.001);
    let counts = counts.iter().copied().chain(std::iter::repeat(0));
    // A count that is lower than before has begun again: all of it is new.
    let came = |(&now, before): (&u32, u32)| now.checked_sub(before).unwrap_or(now);
    frames.iter().zip(counts).map(|pair| f64::from(came(pair)) / passed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counters_that_begin_again_count_from_zero() {
        let at = |seconds| Instant::MIN + Duration::from_secs(seconds);
        let before = Some((at(10), vec![500, 500, 500]));
        let rates = frame_rates(&before, at(15), &[540, 20, 500]);
        assert_eq!(rates, [8.0, 4.0, 0.0]);
        assert_eq!(frame_rates(&None, at(5), &[40]), [8.0]);
    }
}
