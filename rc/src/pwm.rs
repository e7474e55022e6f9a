//! Servo pulses, up to four channels, each measured by a timer: the width of the pulse, and the time since the previous pulse.
//!
//! 800 to 2200 µs and 20 to 400 Hz, within 1 %, are accepted. All else is silence: a receiver that is off, a loose wire, a servo tester
//! between two pulses.

use crate::channels::{Channels, Pulse};
use crate::confirm::Confirm;
use crate::count::count;
use embassy_time::{Duration, Instant};

/// Number of pulse channels.
pub const PWM_CHANNELS: usize = 4;

/// Accepted periods, in µs: 400 to 20 Hz, and 1 % for the clock of the receiver.
const PERIODS: core::ops::RangeInclusive<u32> = 2475..=50_500;
/// Longest time between two pulses of a row. Their period is measured; this ends a row when the timer has missed a pulse.
const MOST: Duration = Duration::from_millis(75);
/// Time for which a channel keeps its value after its last pulse.
const FRESH: Duration = Duration::from_millis(100);
/// Shortest time between two pulses. The period is measured, so no other limit of the rate is needed.
const LEAST: Duration = Duration::from_micros(2000);

/// Counters of the pulses of one channel. All wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PwmCounters {
    /// Accepted pulses.
    pub pulses: u32,
    /// Pulses that are too short or too long.
    pub bad_widths: u32,
    /// Pulses that come too fast or too slowly.
    pub bad_periods: u32,
}

#[derive(Clone, Debug)]
struct Channel {
    confirm: Confirm<1>,
    /// The valid value, and since when.
    value: Option<(Pulse, Instant)>,
    counters: PwmCounters,
}

/// An input of servo pulses.
#[derive(Clone, Debug)]
pub struct Pwm {
    channels: [Channel; PWM_CHANNELS],
}

impl Default for Pwm {
    fn default() -> Self {
        Self::new()
    }
}

impl Pwm {
    /// An input that has received nothing.
    pub const fn new() -> Self {
        const CHANNEL: Channel = Channel {
            confirm: Confirm::new(LEAST, MOST),
            value: None,
            counters: PwmCounters { pulses: 0, bad_widths: 0, bad_periods: 0 },
        };
        Self { channels: [CHANNEL; PWM_CHANNELS] }
    }

    /// Counters of a channel, from 1.
    pub fn counters(&self, number: u8) -> Option<&PwmCounters> {
        let place = usize::from(number).checked_sub(1)?;
        self.channels.get(place).map(|channel| &channel.counters)
    }

    /// Takes a pulse of a channel, from 1, that has just ended: its width and the time since the previous pulse, both in
    /// µs. Returns all valid channels, if this one is valid.
    pub fn pulse(&mut self, now: Instant, number: u8, width: u32, period: u32) -> Option<Channels> {
        let place = usize::from(number).checked_sub(1)?;
        let channel = self.channels.get_mut(place)?;
        let pulse = u16::try_from(width).ok().and_then(Pulse::new);
        let Some(pulse) = pulse.filter(|_| PERIODS.contains(&period)) else {
            let counters = &mut channel.counters;
            count(if pulse.is_none() { &mut counters.bad_widths } else { &mut counters.bad_periods });
            channel.confirm.end();
            return None;
        };
        count(&mut channel.counters.pulses);
        let [pulse] = channel.confirm.frame(now, [pulse]).ok()?;
        channel.value = Some((pulse, now));
        let value = |channel: &Channel| {
            channel
                .value
                .filter(|(_, at)| now.saturating_duration_since(*at) <= FRESH)
                .map(|(pulse, _)| pulse)
        };
        Some(Channels::new(self.channels.each_ref().map(value)))
    }
}
