//! Edges of servo pulses, as a timer catches them that counts µs in 16 bits: a pulse is a rise and the fall behind it.
//!
//! Nothing is known of a pulse whose beginning was not seen. An input with more edges than pulses have is noise, and rests: the
//! interrupts of its edges are above every engine. Then it is tried again.

use crate::count::count;
use crate::pwm::PWM_CHANNELS;
use crate::runner::MeasuredPulse;
use embassy_time::{Duration, Instant};

/// What is longer is measured by the clock of the node: the counter may have come round.
const COUNTS: Duration = Duration::from_millis(60);
/// Edges of an input in this time that are taken, and the time for which one with more rests.
const WINDOW: Duration = Duration::from_millis(20);
const MOST_EDGES: u8 = 24;

/// Longest time between two looks at inputs that rest.
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
    /// It has rested since then.
    rests: Option<Instant>,
}

/// What came of an edge.
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
    /// Times that an input had to rest. It wraps.
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

    /// Times that an input had to rest.
    pub const fn rests(&self) -> u32 {
        self.rests
    }

    /// Takes an edge of an input, by its place from 0, that was caught at this count in µs: a rise if the line is high now.
    pub fn edge(&mut self, now: Instant, place: usize, at: u16, is_high: bool) -> Caught {
        // One that rests is looked at with an edge of another: which edge it caught is not known.
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

    /// The places of inputs that have rested for long enough, once: catch their edges again. Look at every pulse, of whatever input, and at
    /// least as often as [`LOOK_AFTER`].
    pub fn rested(&mut self, now: Instant) -> impl Iterator<Item = usize> {
        let over = move |since: Instant| now.saturating_duration_since(since) >= WINDOW;
        let inputs = self.inputs.iter_mut().enumerate();
        inputs.filter_map(move |(place, input)| {
            input.rests.take_if(|since| over(*since))?;
            Some(place)
        })
    }
}
