//! Edges of servo pulses, with the counter of a timer, and noise.

use crate::edges::{Caught, Edges, LOOK_AFTER};
use crate::runner::MeasuredPulse;
use embassy_time::{Duration, Instant};
use std::vec::Vec;

/// Takes an edge at a time in µs, handled by its interrupt `late` µs later.
fn edge(edges: &mut Edges, place: usize, us: u64, late: u64, is_high: bool) -> Caught {
    edges.edge(Instant::from_micros(us + late), place, us as u16, is_high)
}

/// Takes a pulse.
fn pulse(edges: &mut Edges, place: usize, us: u64, width: u64) -> Caught {
    assert_eq!(edge(edges, place, us, 3, true), Caught::Edge);
    edge(edges, place, us + width, 3, false)
}

const fn of(number: u8, width: u32, period: u32) -> Caught {
    Caught::Pulse(MeasuredPulse { number, width, period })
}

#[test]
fn pulse_has_its_width_and_its_period_whatever_the_counter_and_the_delay_of_the_interrupt() {
    for width in [800, 1500, 2200] {
        for period in [2500, 20_000, 50_000, 59_900] {
            for start in [0, 65_000, 65_535, 1_000_000_007] {
                let mut edges = Edges::new();
                assert_eq!(pulse(&mut edges, 1, start, width), Caught::Edge, "the first has no period");
                for n in 1..10 {
                    let at = start + n * period;
                    assert_eq!(edge(&mut edges, 1, at, n * 7 % 50, true), Caught::Edge);
                    let ended = edge(&mut edges, 1, at + width, n * 13 % 50, false);
                    assert_eq!(ended, of(2, width as u32, period as u32));
                }
            }
        }
    }
}

/// The counter has wrapped: the clock supplies the rest.
#[test]
fn long_pulses_and_long_pauses_are_long() {
    let mut edges = Edges::new();
    pulse(&mut edges, 0, 0, 1500);
    for long in [65_536, 67_036, 131_072, 10_000_000] {
        let mut pause = edges;
        let Caught::Pulse(MeasuredPulse { width: 1500, period, .. }) = pulse(&mut pause, 0, long, 1500)
        else {
            panic!("{long}")
        };
        assert!(u64::from(period).abs_diff(long) < 100, "{period} and {long}");
        let mut wide = edges;
        let Caught::Pulse(MeasuredPulse { width, period: 20_000, .. }) = pulse(&mut wide, 0, 20_000, long)
        else {
            panic!("{long}")
        };
        assert!(u64::from(width).abs_diff(long) < 100, "{width} and {long}");
    }
}

#[test]
fn pulse_whose_beginning_was_missed_does_not_count_and_each_ends_once() {
    let mut edges = Edges::new();
    assert_eq!(edge(&mut edges, 3, 100, 0, false), Caught::Edge);
    pulse(&mut edges, 3, 1000, 1500);
    assert_eq!(pulse(&mut edges, 3, 21_000, 1500), of(4, 1500, 20_000));
    assert_eq!(edge(&mut edges, 3, 23_000, 0, false), Caught::Edge, "a fall after a fall");
    // Two rises: the fall between them was missed.
    assert_eq!(edge(&mut edges, 3, 41_000, 0, true), Caught::Edge);
    assert_eq!(pulse(&mut edges, 3, 61_000, 1200), of(4, 1200, 20_000));
    assert_eq!(edges.edge(Instant::from_secs(1), 4, 0, true), Caught::Noise, "there are four");
}

/// An input is noisy for a moment, while two others have pulses without a pause: then its pulses are used again.
#[test]
fn input_that_rested_is_tried_again_while_others_have_pulses() {
    let mut edges = Edges::new();
    let (mut rests, mut again) = (false, Vec::new());
    let mut counted = 0;
    for n in 0..50 {
        let start = 1_000_000 + n * 18_000;
        for (place, at) in [(0, start), (1, start + 6000), (2, start + 12_000)] {
            // A burst of edges on the first input, once.
            if place == 0 && n == 10 {
                let caught: Vec<_> =
                    (0..40).map(|i| edge(&mut edges, 0, at + i * 10, 0, i % 2 == 0)).collect();
                rests = caught.contains(&Caught::Noise);
            } else if place == 0 && rests {
                // Its interrupts rest; it is read with those of the others.
                assert_eq!(edge(&mut edges, 0, at, 0, true), Caught::Noise);
            } else if let Caught::Pulse(pulse) = pulse(&mut edges, place, at, 1500) {
                counted += u32::from(pulse.number == 1 && n > 10);
            }
            for place in edges.rested(Instant::from_micros(at + 2000)) {
                assert_eq!(place, 0);
                rests = false;
                again.push(at);
            }
        }
    }
    assert_eq!(again.len(), 1, "once");
    let after = again[0] - (1_000_000 + 10 * 18_000);
    assert!(after >= LOOK_AFTER.as_micros() && after < 30_000, "{after} µs");
    assert!(edges.rests() == 1 && counted >= 35, "{} rests, {counted} pulses", edges.rests());
}

#[test]
fn noise_takes_a_bounded_number_of_interrupts_and_pulses_at_400_hz_are_not_noise() {
    let mut edges = Edges::new();
    for n in 0..1000 {
        assert_ne!(pulse(&mut edges, 0, n * 2500, 2200), Caught::Noise);
    }
    // An edge every 10 µs, for 1 s.
    let (mut edges, mut taken, mut rests) = (Edges::new(), 0, false);
    for n in 0..100_000_u64 {
        let at = n * 10;
        if !rests {
            taken += 1;
            rests = edge(&mut edges, 0, at, 0, n % 2 == 0) == Caught::Noise;
        }
        if edges.rested(Instant::from_micros(at)).next().is_some() {
            rests = false;
        }
    }
    let most = 25 * (Duration::from_secs(1).as_micros() / LOOK_AFTER.as_micros() + 1);
    assert!(taken <= most && taken > most / 2, "{taken} interrupts");
}
