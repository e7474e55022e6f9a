//! Channels of a receiver as pulse widths in µs, whatever the input.

/// Number of channels of a receiver: 16 for sticks and switches, and the two digital ones of SBUS.
pub const CHANNELS: usize = 18;

/// An accepted pulse width, 800 to 2200 µs.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Pulse(u16);

impl Pulse {
    /// Centre of a stick, 1500 µs.
    pub const CENTRE: Self = Self(1500);
    /// A digital channel that is off.
    pub(crate) const OFF: Self = Self(1000);
    /// A digital channel that is on.
    pub(crate) const ON: Self = Self(2000);

    /// From a width in µs; `None` outside 800..=2200.
    pub const fn new(us: u16) -> Option<Self> {
        if us >= 800 && us <= 2200 { Some(Self(us)) } else { None }
    }

    /// Width in µs.
    pub const fn us(self) -> u16 {
        self.0
    }

    /// From the lower 11 bits of an SBUS or CRSF channel: 992 is 1500 µs, and 8 steps are 5 µs. So every number is a pulse of
    /// 880 to 2159 µs.
    pub(crate) const fn of_steps(steps: u16) -> Self {
        let steps = steps & STEPS_MAX;
        // 1500 µs − 992 × 5/8 µs is 880 µs; rounded.
        Self((steps * 5 + 880 * 8 + 4) / 8)
    }
}

/// Highest number of an SBUS or CRSF channel.
const STEPS_MAX: u16 = 0x7FF;
/// Bytes of 16 channels of 11 bits each, lowest bit first.
pub(crate) const PACKED: usize = 22;

/// Unpacks 16 channels, as SBUS and CRSF carry them.
pub(crate) fn unpack(bytes: &[u8; PACKED]) -> [Pulse; 16] {
    let mut pulses = [Pulse::CENTRE; 16];
    let mut bytes = bytes.iter();
    let (mut bits, mut count) = (0_u32, 0);
    for pulse in &mut pulses {
        while count < 11 {
            bits |= u32::from(bytes.next().copied().unwrap_or(0)) << count;
            count += 8;
        }
        *pulse = Pulse::of_steps((bits & u32::from(STEPS_MAX)) as u16);
        (bits, count) = (bits >> 11, count - 11);
    }
    pulses
}

/// Valid values of all channels. A channel without a value is silent.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Channels {
    pulses: [Option<Pulse>; CHANNELS],
}

impl Channels {
    /// From the first channels; all others are silent.
    pub fn new(first: impl IntoIterator<Item = Option<Pulse>>) -> Self {
        let mut pulses = [None; CHANNELS];
        for (place, pulse) in pulses.iter_mut().zip(first) {
            *place = pulse;
        }
        Self { pulses }
    }

    /// A channel by its number, from 1; `None` if it is silent.
    pub fn get(&self, number: u8) -> Option<Pulse> {
        let place = usize::from(number).checked_sub(1)?;
        self.pulses.get(place).copied().flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_the_pulses_of_the_crsf_specification() {
        // 172, 992 and 1811 are 988, 1500 and 2012 µs there.
        let pulses = [0, 172, 191, 992, 1792, 1811, 2047].map(|steps| Pulse::of_steps(steps).us());
        assert_eq!(pulses, [880, 988, 999, 1500, 2000, 2012, 2159]);
    }

    #[test]
    fn only_800_to_2200_us_is_a_pulse() {
        for us in 0..=u16::MAX {
            assert_eq!(Pulse::new(us).map(Pulse::us), (800..=2200).contains(&us).then_some(us));
        }
    }

    #[test]
    fn channels_are_numbered_from_1() {
        let channels = Channels::new([Pulse::new(1000), None, Pulse::new(2000)]);
        let got = [0, 1, 2, 3, 4, 18, 19, 255].map(|number| channels.get(number).map(Pulse::us));
        assert_eq!(got, [None, Some(1000), None, Some(2000), None, None, None, None]);
    }
}
