//! Edges of servo pulses, caught by a 16-bit timer that counts µs: a pulse is a rising edge and the falling edge after it.
//!
//! A pulse whose beginning was missed is ignored. An input with more edges than servo pulses have is noisy, and rests: its
//! interrupts preempt every engine. Then it is tried again.

use crate::count::count;
use crate::pwm::PWM_CHANNELS;
use crate::runner::MeasuredPulse;
use embassy_time::{Duration, Instant};

/// Longer times are measured by the node's clock: the counter may have wrapped.
const COUNTS: Duration = Duration::from_millis(60);
/// Window in which an input may have [`MOST_EDGES`] edges. An input with more rests for the same time.
const WINDOW: Duration = Duration::from_millis(20);
const MOST_EDGES: u8 = 24;

/// Longest time between two checks of resting inputs.
pub const LOOK_AFTER: Duration = WINDOW;

/// One input.
#[derive(Clone, Copy, Debug)]
struct Input {
    /// Counter and time at the last rise.
    rise: Option<(u16, Instant)>,
    /// Time between the last two rises, in µs.
    period: Option<u32>,
    /// Edges since then.
    edges: u8,
    since: Instant,
    /// Time since which it has rested.
    rests: Option<Instant>,
}

/// Result of an edge.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Caught {
    /// Nothing yet.
    Edge,
    /// A pulse has ended.
    Pulse(MeasuredPulse),
    /// The input has too many edges: catch none of them until [`Edges::rested`] names it.
    Noise,
}

/// Inputs of servo pulses on the channels of one timer.
#[derive(Clone, Copy, Debug)]
pub struct Edges {
    inputs: [Input; PWM_CHANNELS],
    /// Number of times that an input had to rest. Wraps.
    rests: u32,
}

impl Default for Edges {
    fn default() -> Self {
        Self::new()
    }
}

impl Input {
    const NEW: Self = Self { rise: None, period: None, edges: 0, since: Instant::MIN, rests: None };
}

impl Edges {
    /// Inputs without an edge.
    pub const fn new() -> Self {
        Self { inputs: [Input::NEW; PWM_CHANNELS], rests: 0 }
    }

    /// Number of times that an input had to rest.
    pub const fn rests(&self) -> u32 {
        self.rests
    }

    /// Takes an edge of the input at `place`, from 0, caught at the count `at` in µs: a rising edge if the line is now high.
    pub fn edge(&mut self, now: Instant, place: usize, at: u16, is_high: bool) -> Caught {
        // A resting input is read when another one has an edge: which edge it caught is unknown.
        let input = self.inputs.get_mut(place).filter(|input| input.rests.is_none());
        let Some(input) = input else { return Caught::Noise };
        if now.saturating_duration_since(input.since) > WINDOW {
            (input.edges, input.since) = (0, now);
        }
        input.edges = input.edges.saturating_add(1);
        if input.edges > MOST_EDGES {
            *input = Input { rests: Some(now), ..Input::NEW };
            count(&mut self.rests);
            return Caught::Noise;
        }
        let passed = input.rise.map(|(before, since)| {
            let time = now.saturating_duration_since(since);
            let long = u32::try_from(time.as_micros()).unwrap_or(u32::MAX);
            if time > COUNTS { long } else { u32::from(at.wrapping_sub(before)) }
        });
        if is_high {
            (input.rise, input.period) = (Some((at, now)), passed);
            return Caught::Edge;
        }
        // A pulse ends once.
        match (passed, input.period.take(), u8::try_from(place)) {
            (Some(width), Some(period), Ok(place)) => {
                Caught::Pulse(MeasuredPulse { number: place.saturating_add(1), width, period })
            }
            _ => Caught::Edge,
        }
    }

    /// Returns each input that has rested for long enough, once: catch its edges again. Call this at each pulse of any input, and at least
    /// every [`LOOK_AFTER`].
    pub fn rested(&mut self, now: Instant) -> impl Iterator<Item = usize> {
        let over = move |since: Instant| now.saturating_duration_since(since) >= WINDOW;
        let inputs = self.inputs.iter_mut().enumerate();
        inputs.filter_map(move |(place, input)| {
            input.rests.take_if(|since| over(*since))?;
            Some(place)
        })
    }
}
