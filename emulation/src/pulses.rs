//! A receiver of radio control with a wire for each channel: servo pulses, one channel after the other, as receivers send them.

use sim::ecu::{MILLIS, Nanos};
use sim::receiver::{Position, throttle_us};
use std::collections::VecDeque;

/// Channels with a wire.
pub const CHANNELS: usize = 4;
/// Time between the beginnings of two pulses of a frame.
const APART: Nanos = 2_500_000;
const MICRO: Nanos = 1000;

/// An edge on a wire: when, on which, from 0, and whether it rises.
type Edge = (Nanos, usize, bool);

/// A receiver, which has power with the board. Throttle is on channel 1, the switch on channel 2.
#[derive(Debug)]
pub struct PulseReceiver {
    /// Beginning of the next frame.
    next: Nanos,
    edges: VecDeque<Edge>,
    /// Throttle in percent.
    pub stick: u16,
    /// Switch.
    pub switch: Position,
    /// The transmitter is on; without it there are no pulses.
    pub transmitter: bool,
    /// Time between two frames.
    pub period: Nanos,
    /// Width in µs of the pulses on channel 3.
    pub third: u16,
    /// Whether the wire of each channel is connected. Otherwise the board's pull-down makes the line low.
    pub wires: [bool; CHANNELS],
    /// Interval of edges on the wire of channel 4, in place of pulses.
    pub noise: Option<Nanos>,
}

impl Default for PulseReceiver {
    fn default() -> Self {
        Self::new()
    }
}

impl PulseReceiver {
    /// The stick at idle, the switch at stop, the transmitter on, 50 frames a second.
    pub const fn new() -> Self {
        Self {
            next: 0,
            edges: VecDeque::new(),
            stick: 0,
            switch: Position::Stop,
            transmitter: true,
            period: 20 * MILLIS,
            third: 1500,
            wires: [true; CHANNELS],
            noise: None,
        }
    }

    /// Time of the next edge.
    pub(crate) fn next(&self) -> Nanos {
        self.edges.front().map_or(self.next, |edge| edge.0)
    }

    /// The changes of level on the wires until now.
    pub(crate) fn advance(&mut self, now: Nanos) -> Vec<(usize, bool)> {
        let mut levels = Vec::new();
        while self.next() <= now {
            match self.edges.pop_front() {
                Some((_, wire, high)) => levels.push((wire, high && self.wires[wire])),
                None => self.frame(),
            }
        }
        levels
    }

    fn frame(&mut self) {
        let begin = self.next;
        self.next += self.period;
        if !self.transmitter {
            return;
        }
        let widths = [throttle_us(self.stick * 10), self.switch.pulse_us(), self.third, 1500];
        let pulses = if self.noise.is_some() { CHANNELS - 1 } else { CHANNELS };
        for (wire, width) in widths.into_iter().enumerate().take(pulses) {
            let rise = begin + wire as Nanos * APART;
            self.edges.extend([(rise, wire, true), (rise + Nanos::from(width) * MICRO, wire, false)]);
        }
        if let Some(every) = self.noise {
            let noise = (begin..self.next).step_by(every as usize).enumerate();
            self.edges.extend(noise.map(|(i, at)| (at, CHANNELS - 1, i % 2 == 0)));
            self.edges.make_contiguous().sort_by_key(|edge| edge.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pulses_have_the_widths_of_stick_and_switch_and_end_without_the_transmitter() {
        let mut receiver = PulseReceiver::new();
        (receiver.stick, receiver.switch) = (50, Position::Run);
        let mut rises = [0; CHANNELS];
        let mut widths = Vec::new();
        let mut play = |receiver: &mut PulseReceiver, frames: usize| {
            let end = receiver.next + frames as Nanos * 20 * MILLIS;
            while receiver.next() < end {
                let at = receiver.next();
                for (wire, high) in receiver.advance(at) {
                    match high {
                        true => rises[wire] = at,
                        false => widths.push((wire, (at - rises[wire]) / MICRO)),
                    }
                }
            }
            std::mem::take(&mut widths)
        };
        assert_eq!(play(&mut receiver, 1), [(0, 1500), (1, 2000), (2, 1500), (3, 1500)]);
        receiver.transmitter = false;
        assert_eq!(play(&mut receiver, 3), []);
    }
}
