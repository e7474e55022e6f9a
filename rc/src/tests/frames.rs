//! What the tests of the decoders send and check.

use crate::channels::{Channels, Pulse};
use sim::receiver::steps;

/// Channels that all differ, so that a shift by a bit or a byte is seen, with this throttle in channel 3.
pub fn stick(throttle_us: u16) -> [u16; 16] {
    let mut channels = core::array::from_fn(|i| 200 + 97 * i as u16);
    channels[2] = steps(throttle_us);
    channels
}

/// Pulse width of a channel; 0 if it is silent.
pub fn us(channels: &Channels, number: u8) -> u16 {
    channels.get(number).map_or(0, Pulse::us)
}
