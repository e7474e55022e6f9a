//! Servo pulses: which are accepted, and for how long.

use crate::channels::{Channels, Pulse};
use crate::input::Input;
use crate::pwm::Pwm;
use embassy_time::Instant;
use std::vec::Vec;

fn us(channels: &Channels, number: u8) -> Option<u16> {
    channels.get(number).map(Pulse::us)
}

/// Pulses of one channel with this period, in µs.
fn play(pwm: &mut Pwm, from: u64, widths: &[u32], period: u32) -> Vec<Option<u16>> {
    let pulse = |(i, width): (usize, &u32)| {
        let now = Instant::from_micros(from + i as u64 * u64::from(period));
        pwm.pulse(now, 1, *width, period).and_then(|channels| us(&channels, 1))
    };
    widths.iter().enumerate().map(pulse).collect()
}

#[test]
fn every_width_is_accepted_or_silence() {
    for width in (0..3000).chain([65_535, 65_536 + 1500, u32::MAX]) {
        let mut pwm = Pwm::new();
        let counts = play(&mut pwm, 0, &[width; 3], 20_000);
        let accepted = (800..=2200).contains(&width);
        assert_eq!(counts, [None, None, accepted.then_some(width as u16)], "{width} µs");
        let counters = pwm.counters(1).unwrap();
        assert_eq!((counters.pulses, counters.bad_widths), if accepted { (3, 0) } else { (0, 3) });
    }
}

#[test]
fn twenty_to_400_hz_is_accepted() {
    for (period, accepted) in [
        (0, false),
        (2474, false),
        // A receiver whose clock is 1 % fast, and one that is 1 % slow.
        (2475, true),
        (2500, true),
        (20_000, true),
        (50_000, true),
        (50_500, true),
        (50_501, false),
        (u32::MAX, false),
    ] {
        let mut pwm = Pwm::new();
        let counts = play(&mut pwm, 0, &[1500; 5], period.min(60_000));
        let now = Instant::from_secs(10_000);
        if period <= 60_000 {
            assert_eq!(counts.last(), Some(&accepted.then_some(1500)), "{period} µs");
        }
        assert_eq!(pwm.pulse(now, 1, 1500, period), None, "first after a pause, {period} µs");
        let bad = pwm.counters(1).unwrap().bad_periods;
        assert_eq!(bad > 0, !accepted, "{period} µs");
    }
}

#[test]
fn spike_does_not_count_and_a_move_does() {
    let counts = play(&mut Pwm::new(), 0, &[1100, 1100, 1100, 2200, 1100, 1100, 1900, 1900], 20_000);
    assert_eq!(counts[2..], [1100, 1100, 1100, 1100, 1100, 1900].map(Some));
    // A pulse that is not accepted ends the row.
    let counts = play(&mut Pwm::new(), 0, &[1100, 1100, 1100, 700, 1100, 1100, 1100], 20_000);
    assert_eq!(counts, [None, None, Some(1100), None, None, None, Some(1100)]);
}

#[test]
fn channels_are_silent_one_by_one() {
    let mut pwm = Pwm::new();
    let mut last = None;
    for i in 0..20 {
        let now = Instant::from_millis(20 * i);
        if i < 10 {
            pwm.pulse(now, 1, 1100, 20_000);
        }
        last = pwm.pulse(now, 2, 1500, 20_000).or(last);
        let both = last.map(|channels| (us(&channels, 1), us(&channels, 2)));
        match i {
            0..2 => assert_eq!(both, None),
            // The last pulse of the first channel was at 180 ms.
            2..=14 => assert_eq!(both, Some((Some(1100), Some(1500))), "{i}"),
            _ => assert_eq!(both, Some((None, Some(1500))), "{i}"),
        }
    }
}

#[test]
fn channel_that_does_not_exist_is_silence() {
    let mut input = Input::Pwm(Pwm::new());
    for number in [0, 5, u8::MAX] {
        for i in 0..5 {
            assert_eq!(input.pulse(Instant::from_millis(20 * i), number, 1500, 20_000), None);
        }
    }
    assert_eq!(input.receive(Instant::from_millis(1), &[0x0F; 30]), (30, None));
    input.line_error();
    assert!(input.pulse(Instant::from_millis(1), 1, 1500, 20_000).is_none());
}
