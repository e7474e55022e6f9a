//! Limits virtual time to the wall clock.

use core::time::Duration;
use std::time::Instant;

/// Lead over the wall clock below which a run continues without a sleep: the bytes of a line at 115 200 baud are
/// 87 µs apart, and a sleep takes about as long.
const LEAD: Duration = Duration::from_millis(2);
/// Delay up to which a run catches up. A longer one (a suspended laptop, a stopped process) shifts all that follows.
const CATCHES_UP: Duration = Duration::from_millis(100);

/// Relation between wall clock time and virtual time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pacer {
    /// In µs.
    virtual_time: u64,
    wall: Instant,
    /// Speed of virtual time relative to the wall clock.
    speed: u32,
}

impl Pacer {
    /// From here on, virtual time runs at this multiple of the wall clock.
    pub(super) const fn new(virtual_time: u64, wall: Instant, speed: u32) -> Self {
        Self { virtual_time, wall, speed }
    }

    /// Sleep needed before virtual time may reach `to`, in µs. `now` is the wall clock's time.
    pub(super) fn wait(&mut self, to: u64, now: Instant) -> Duration {
        let due = self.wall + Duration::from_micros(to.saturating_sub(self.virtual_time)) / self.speed;
        if now.saturating_duration_since(due) > CATCHES_UP {
            *self = Self::new(to, now, self.speed);
        }
        let early = due.saturating_duration_since(now);
        if early > LEAD { early } else { Duration::ZERO }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn virtual_time_waits_for_the_wall_clock() {
        let start = Instant::now();
        let mut pacer = Pacer::new(5_000, start, 1);
        assert_eq!(pacer.wait(15_000, start), ms(10));
        assert_eq!(pacer.wait(15_000, start + ms(4)), ms(6));
        assert_eq!(pacer.wait(15_000, start + ms(8)), ms(0), "2 ms ahead is close enough");
        assert_eq!(pacer.wait(15_000, start + ms(10)), ms(0));
    }

    #[test]
    fn a_short_delay_is_made_up_for() {
        let start = Instant::now();
        let mut pacer = Pacer::new(0, start, 1);
        assert_eq!(pacer.wait(1_000_000, start + ms(1100)), ms(0));
        assert_eq!(pacer.wait(1_150_000, start + ms(1100)), ms(50));
    }

    #[test]
    fn a_long_delay_shifts_all_that_follows() {
        let start = Instant::now();
        let mut pacer = Pacer::new(0, start, 1);
        assert_eq!(pacer.wait(1_000_000, start + ms(4000)), ms(0));
        assert_eq!(pacer.wait(1_150_000, start + ms(4000)), ms(150));
    }

    #[test]
    fn ten_times_as_fast_waits_a_tenth() {
        let start = Instant::now();
        let mut pacer = Pacer::new(0, start, 10);
        assert_eq!(pacer.wait(1_000_000, start + ms(20)), ms(80));
        assert_eq!(pacer.wait(2_000_000, start + ms(1000)), ms(0), "too late by more than is made up for");
        assert_eq!(pacer.wait(3_000_000, start + ms(1000)), ms(100));
    }

    /// The wall clock is a number here: each step takes this much processor time, and each sleep lasts longer than requested.
    #[test]
    fn sixty_times_as_fast_is_kept_where_the_work_takes_less_than_all_of_the_time() {
        const STEP: u64 = 87; // µs, a byte at 115 200 baud
        let takes = |work: Duration, late: Duration| {
            let start = Instant::now();
            let (mut pacer, mut now) = (Pacer::new(0, start, 60), start);
            for step in 1..=60_000_000 / STEP {
                let sleep = pacer.wait(step * STEP, now);
                now += work + sleep + if sleep.is_zero() { Duration::ZERO } else { late };
            }
            now - start
        };
        // 60 s of engine time in 1 s: a step has 1.45 µs.
        let second = ms(985)..ms(1015);
        assert!(second.contains(&takes(Duration::from_nanos(100), ms(0))));
        assert!(second.contains(&takes(Duration::from_nanos(1200), ms(1))), "sleeps are made up for");
        // If it takes more, the run is slower, and nothing is left out.
        let slow = takes(Duration::from_nanos(2900), ms(1));
        assert!(slow > ms(1990) && slow < ms(2010), "{slow:?}");
    }
}
