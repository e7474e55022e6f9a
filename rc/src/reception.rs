//! Reception counters of a receiver, for people: the same for every input.

use crate::input::Input;
use crate::pilot::PilotCounters;
use crate::pwm::PWM_CHANNELS;

/// Counts since the start of the node. All wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Reception {
    /// Good frames of channels, or pulses.
    pub good: u32,
    /// Those received while the receiver reported no link: the flag "fail-safe" of SBUS, an uplink quality of 0 % of CRSF.
    pub without_link: u32,
    /// Those with the flag "frame lost" of SBUS.
    pub lost: u32,
    /// Frames with a wrong checksum, end or flag, with a UART fault, or cut short by a pause.
    pub damaged: u32,
    /// Frames that came faster than the line can carry, and pulses of a width or a rate that no receiver sends.
    pub implausible: u32,
}

impl core::ops::Add for Reception {
    type Output = Self;

    /// Adds the counters from before and after a restart of a node.
    fn add(self, other: Self) -> Self {
        Self {
            good: self.good.wrapping_add(other.good),
            without_link: self.without_link.wrapping_add(other.without_link),
            lost: self.lost.wrapping_add(other.lost),
            damaged: self.damaged.wrapping_add(other.damaged),
            implausible: self.implausible.wrapping_add(other.implausible),
        }
    }
}

impl Input {
    /// Counters of all that was received.
    pub fn reception(&self) -> Reception {
        match self {
            Self::Sbus(sbus) => {
                let counters = sbus.counters();
                Reception {
                    good: counters.frames,
                    without_link: counters.fail_safe,
                    lost: counters.frame_lost,
                    damaged: counters.bad_frames.wrapping_add(counters.truncated),
                    implausible: counters.too_fast,
                }
            }
            Self::Crsf(crsf) => {
                let counters = crsf.counters();
                Reception {
                    good: counters.frames,
                    without_link: counters.no_link,
                    lost: 0,
                    damaged: counters.bad_checksums.wrapping_add(counters.truncated),
                    implausible: counters.too_fast,
                }
            }
            Self::Pwm(pwm) => {
                let mut all = Reception::default();
                for counters in (1..=PWM_CHANNELS as u8).filter_map(|number| pwm.counters(number)) {
                    all.good = all.good.wrapping_add(counters.pulses);
                    let bad = counters.bad_widths.wrapping_add(counters.bad_periods);
                    all.implausible = all.implausible.wrapping_add(bad);
                }
                all
            }
        }
    }
}

impl core::fmt::Display for Reception {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { good, without_link, lost, damaged, implausible } = *self;
        write!(
            f,
            "{good} good, {without_link} of them without a link, {lost} lost; {damaged} damaged, {implausible} implausible"
        )
    }
}

/// Valid frames that an engine could not use.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Unused(pub PilotCounters);

impl Unused {
    /// Whether anything was unused.
    pub const fn is_any(&self) -> bool {
        let PilotCounters { silent, throttle_beyond, unclear, gaps, starts_refused, .. } = self.0;
        silent != 0 || throttle_beyond != 0 || unclear != 0 || gaps != 0 || starts_refused != 0
    }
}

impl core::fmt::Display for Unused {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let PilotCounters { silent, throttle_beyond, unclear, gaps, starts_refused, .. } = self.0;
        write!(
            f,
            "not used: {silent} with a silent channel, {throttle_beyond} with an implausible throttle, {unclear} with an \
             unclear switch; gaps: {gaps}, refused starts: {starts_refused}"
        )
    }
}
