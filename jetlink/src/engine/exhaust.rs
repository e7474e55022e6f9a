//! Detects combustion by the exhaust temperature, the only evidence while an ECU sends faults instead of a state (AMT-8).

use crate::consecutive::{AGREEING, Consecutive};
use crate::units::Celsius;
use embassy_time::{Duration, Instant};

/// Range of a working thermocouple: −50 °C is a raw 0 in both protocols.
const PLAUSIBLE: (Celsius, Celsius) = (Celsius::from_tenths(-400), Celsius::from_tenths(11_000));
/// Rate of fall without combustion, 15 °C/s in 0.1 °C/s.
const FALL: i32 = 150;
/// Rate of fall that leaves combustion uncertain, 4 °C/s in 0.1 °C/s: one step of the raw value over the interval.
const COOLS: i32 = 40;
/// Consecutive intervals of such a fall that prove it.
const FALLING_FOR: u8 = 3;
/// Interval over which the fall is measured.
const INTERVAL: Duration = Duration::from_secs(1);
/// Fastest plausible changes, in 0.1 °C/s: 150 °C/s down and 500 °C/s up; a hot start rises by 270 °C/s.
const STEP_DOWN: i32 = 1500;
const STEP_UP: i32 = 5000;
/// Shortest time over which a change is measured, because values have steps of 4.6 °C.
const STEP_OVER: Duration = Duration::from_millis(100);
/// Time after a lower demand in which a fall is expected.
pub(super) const FALL_EXPECTED: Duration = Duration::from_secs(5);
/// Longest time for which repeated lower demands excuse a cold exhaust, less the time without one.
const EXCUSED_MAX: Duration = Duration::from_secs(15);

/// Whether there is combustion.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(super) enum Burning {
    /// Two values above the configured temperature, and no fall since.
    Yes,
    /// Two values below it, or a fall of 15 °C/s for 3 s.
    No,
    /// Neither.
    NotKnown,
    /// The sensor failed or jumped: its values are not used.
    NotReadable,
}

/// Whether a fall is expected: the demand was lowered within [`FALL_EXPECTED`].
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Fall {
    NotExpected,
    Expected,
    /// The ECU reports a running engine, so nothing depends on the exhaust, and the fall needs no excuse.
    ExpectedOfRunning,
}

/// The exhaust of one engine.
#[derive(Clone, Copy, Debug)]
pub(super) struct Exhaust {
    /// Temperature above which there is combustion.
    limit: Celsius,
    state: Burning,
    last: Option<(Instant, Celsius)>,
    above: Consecutive,
    below: Consecutive,
    /// Time and value at the beginning of the interval.
    mark: Option<(Instant, Celsius)>,
    falling: Consecutive,
    /// It fell by at least 4 °C/s in the last interval.
    cools: bool,
    /// Time for which lower demands have excused a cold exhaust, and the last time that was looked at.
    excused: Duration,
    seen: Option<Instant>,
    /// The sensor jumped, or gave what none can: a cold value is accepted again only after two hot ones, or a fall of 15 °C/s for 3 s.
    distrusted: bool,
}

impl Exhaust {
    /// Changes the temperature above which there is combustion, for the values received from now on.
    pub const fn configure(&mut self, limit: Celsius) {
        self.limit = limit;
    }

    pub const fn new(limit: Celsius) -> Self {
        Self {
            limit,
            state: Burning::NotKnown,
            last: None,
            above: Consecutive::NONE,
            below: Consecutive::NONE,
            mark: None,
            falling: Consecutive::NONE,
            cools: false,
            excused: Duration::from_ticks(0),
            seen: None,
            distrusted: false,
        }
    }

    pub const fn burning(&self) -> Burning {
        self.state
    }

    /// Whether the sensor has failed, see [`RetainedState`](super::retained::RetainedState).
    pub const fn is_distrusted(&self) -> bool {
        self.distrusted
    }

    /// Distrusts the sensor, as before a reset.
    pub const fn distrust(&mut self) {
        *self = self.unread();
    }

    /// Frames were missing: what burned before may have gone out since, and two values have to show that it burns.
    pub fn gap(&mut self) {
        self.above.reset();
        if self.state == Burning::Yes {
            self.state = Burning::NotKnown;
        }
    }

    /// Whether a working thermocouple can give this value.
    pub fn is_plausible(egt: Celsius) -> bool {
        egt >= PLAUSIBLE.0 && egt <= PLAUSIBLE.1
    }

    /// Takes one value; `None` where the ECU reports its sensor as faulty.
    pub fn observe(&mut self, now: Instant, egt: Option<Celsius>, fall: Fall) {
        let commanded = self.excuse(now, egt, fall);
        let Some(egt) = egt else {
            // Values from before and after its fault have to fit together, as any two have.
            *self = Self { distrusted: self.distrusted, last: self.last, ..self.unread() };
            return;
        };
        if !Self::is_plausible(egt) {
            *self = self.unread();
            return;
        }
        if let Some((before, value)) = self.last.replace((now, egt)) {
            let change = i32::from(egt.tenths()) - i32::from(value.tenths());
            let millis = now.saturating_duration_since(before).max(STEP_OVER).as_millis();
            let rate = change.saturating_mul(1000) / i32::try_from(millis).unwrap_or(i32::MAX).max(1);
            if !(-STEP_DOWN..=STEP_UP).contains(&rate) {
                *self = Self { last: self.last, ..self.unread() };
                return;
            }
        }
        self.observe_fall(now, egt, commanded);
        let hot = egt > self.limit;
        self.above.count(hot);
        self.below.count(!hot);
        // A sensor that has failed may show a cold exhaust, but not one that cools down without a jump for seconds.
        let falls = self.falling.reached(FALLING_FOR) && !commanded;
        self.distrusted &= !self.above.reached(AGREEING) && !falls;
        if self.distrusted {
            self.state = Burning::NotReadable;
        } else if falls || self.below.reached(AGREEING) && !commanded {
            self.state = Burning::No;
        } else if self.cools || self.below.reached(AGREEING) {
            // A fall leaves combustion uncertain, but does not disprove it yet.
            if self.state == Burning::Yes {
                self.state = Burning::NotKnown;
            }
        } else if self.above.reached(AGREEING) {
            self.state = Burning::Yes;
        }
    }

    fn observe_fall(&mut self, now: Instant, egt: Celsius, commanded: bool) {
        let Some((since, from)) = self.mark else {
            self.mark = Some((now, egt));
            return;
        };
        let elapsed = now.saturating_duration_since(since);
        if elapsed < INTERVAL {
            return;
        }
        let fall = (i32::from(from.tenths()) - i32::from(egt.tenths())).saturating_mul(1000);
        let millis = i32::try_from(elapsed.as_millis()).unwrap_or(i32::MAX).max(1);
        self.cools = fall / millis >= COOLS && !commanded;
        self.falling.count(fall / millis >= FALL && !commanded);
        self.mark = Some((now, egt));
    }

    /// Whether a lower demand excuses a fall. A cold exhaust uses up the excuse by as much time as it needed it, and any other time
    /// in which it is measured brings back as much: a demand that goes up and down does not excuse a cold exhaust forever, and a hot one may
    /// fall with a slow slew for as long as that goes down.
    fn excuse(&mut self, now: Instant, egt: Option<Celsius>, fall: Fall) -> bool {
        let passed = self.seen.replace(now).map_or(0, |seen| now.saturating_duration_since(seen).as_ticks());
        let used = self.excused.as_ticks();
        let used = match egt.filter(|egt| Self::is_plausible(*egt)) {
            Some(egt) if egt <= self.limit && fall == Fall::Expected => used.saturating_add(passed),
            Some(_) => used.saturating_sub(passed),
            None => used,
        };
        self.excused = Duration::from_ticks(used.min(EXCUSED_MAX.as_ticks()));
        fall != Fall::NotExpected && self.excused < EXCUSED_MAX
    }

    /// The exhaust is unknown: see [`Self::distrusted`].
    const fn unread(&self) -> Self {
        Self {
            distrusted: true,
            state: Burning::NotReadable,
            seen: self.seen,
            excused: self.excused,
            ..Self::new(self.limit)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    fn run(exhaust: &mut Exhaust, from: u64, until: u64, egt: impl Fn(u64) -> i16) {
        for millis in (from..until).step_by(125) {
            exhaust.observe(at(millis), Some(Celsius::from_tenths(egt(millis) * 10)), Fall::NotExpected);
        }
    }

    fn limit() -> Exhaust {
        Exhaust::new(Celsius::from_tenths(3000))
    }

    #[test]
    fn two_values_above_the_limit_burn_and_two_below_do_not() {
        let mut exhaust = limit();
        run(&mut exhaust, 0, 125, |_| 600);
        assert_eq!(exhaust.burning(), Burning::NotKnown);
        run(&mut exhaust, 125, 250, |_| 600);
        assert_eq!(exhaust.burning(), Burning::Yes);
        let mut exhaust = limit();
        run(&mut exhaust, 0, 250, |_| 20);
        assert_eq!(exhaust.burning(), Burning::No);
    }

    #[test]
    fn a_value_at_the_limit_does_not_burn_and_one_above_it_does() {
        for (tenths, burning) in [(3000, Burning::No), (3001, Burning::Yes)] {
            let mut exhaust = limit();
            for millis in [0, 125] {
                exhaust.observe(at(millis), Some(Celsius::from_tenths(tenths)), Fall::NotExpected);
            }
            assert_eq!(exhaust.burning(), burning, "{tenths}");
        }
    }

    #[test]
    fn an_exhaust_that_cooled_while_its_sensor_was_faulty_does_not_burn() {
        // 700 °C before the fault: within 10 s it may be cold, within 1 s it may not.
        for (faulty, burning) in [(10_000, Burning::No), (1000, Burning::NotReadable)] {
            let mut exhaust = limit();
            run(&mut exhaust, 0, 1000, |_| 700);
            for millis in (1000..1000 + faulty).step_by(125) {
                exhaust.observe(at(millis), None, Fall::NotExpected);
                assert_eq!(exhaust.burning(), Burning::NotReadable);
            }
            run(&mut exhaust, 1000 + faulty, 3000 + faulty, |_| 100);
            assert_eq!(exhaust.burning(), burning, "{faulty} ms");
        }
    }

    #[test]
    fn a_demand_that_goes_up_and_down_does_not_excuse_a_cold_exhaust_for_ever() {
        let mut exhaust = limit();
        let mut ended = None;
        for millis in (0..30_000).step_by(125) {
            // Lowered for 5 s, then 0.25 s of nothing.
            let fall = if millis % 5250 < 5000 { Fall::Expected } else { Fall::NotExpected };
            exhaust.observe(at(millis), Some(Celsius::from_tenths(1000)), fall);
            ended = ended.or((exhaust.burning() == Burning::No).then_some(millis));
        }
        assert!(ended.is_some_and(|millis| millis < 17_000), "{ended:?}");
    }

    #[test]
    fn a_fall_uses_up_its_excuse_only_where_the_exhaust_decides() {
        for (fall, burning) in [(Fall::Expected, Burning::No), (Fall::ExpectedOfRunning, Burning::NotKnown)] {
            let mut exhaust = limit();
            for millis in (0..20_000).step_by(125) {
                exhaust.observe(at(millis), Some(Celsius::from_tenths(1000)), fall);
            }
            assert_eq!(exhaust.burning(), burning, "{fall:?}");
        }
    }

    #[test]
    fn a_hot_exhaust_uses_up_nothing_of_its_excuse_and_a_cold_one_all_of_it() {
        for (first, before, then) in
            [(700, Burning::Yes, Burning::Yes), (290, Burning::NotKnown, Burning::No)]
        {
            let mut exhaust = limit();
            let mut lowered = |from: u64, until: u64, fall: i16| {
                for millis in (from..until).step_by(125) {
                    let egt = Celsius::from_tenths(first * 10 - (millis - from) as i16 / 100 * fall);
                    exhaust.observe(at(millis), Some(egt), Fall::Expected);
                }
                exhaust.burning()
            };
            assert_eq!(lowered(0, 15_000, 0), before, "{first} °C");
            assert_eq!(lowered(15_000, 20_000, 20), then, "{first} °C, and a fall of 20 °C/s");
        }
    }

    #[test]
    fn an_exhaust_that_is_not_measured_neither_uses_up_its_excuse_nor_restores_it() {
        let celsius = |celsius: i16| Some(Celsius::from_tenths(celsius * 10));
        // 10 s with this value under lower demands, and then 5.5 s with a cold one.
        for (value, used_up) in [(None, false), (celsius(-50), false), (celsius(290), true)] {
            let mut exhaust = limit();
            for millis in (0..10_000).step_by(125) {
                exhaust.observe(at(millis), value, Fall::Expected);
            }
            for millis in (10_000..15_500).step_by(125) {
                exhaust.observe(at(millis), celsius(290), Fall::Expected);
            }
            assert_eq!(exhaust.excused == EXCUSED_MAX, used_up, "{value:?}");
        }
        // Of 10 s that are used up, 8 s without a measurement bring back nothing, and 8 s that are hot do.
        for (value, used_up) in [(None, true), (celsius(700), false)] {
            let mut exhaust = limit();
            for millis in (0..24_000).step_by(125) {
                let value = if (10_000..18_000).contains(&millis) { value } else { celsius(290) };
                exhaust.observe(at(millis), value, Fall::Expected);
            }
            assert_eq!(exhaust.excused == EXCUSED_MAX, used_up, "{value:?}");
        }
    }

    #[test]
    fn a_sensor_that_failed_is_trusted_after_two_hot_values() {
        let mut exhaust = limit();
        exhaust.observe(at(0), Some(Celsius::from_tenths(-500)), Fall::NotExpected);
        for (millis, burning) in [(125, Burning::NotReadable), (250, Burning::Yes)] {
            exhaust.observe(at(millis), Some(Celsius::from_tenths(6000)), Fall::NotExpected);
            assert_eq!(exhaust.burning(), burning, "{millis} ms");
        }
    }

    /// The flame went out while the sensor was broken, and the exhaust is below the limit when it works again.
    #[test]
    fn an_exhaust_that_falls_behind_a_broken_sensor_does_not_burn() {
        for (degrees_per_s, burning) in [(20, Burning::No), (10, Burning::NotReadable)] {
            let mut exhaust = limit();
            run(&mut exhaust, 0, 1000, |_| 700);
            run(&mut exhaust, 1000, 4000, |_| -50);
            run(&mut exhaust, 4000, 8000, |ms| 290 - (ms as i16 - 4000) / 100 * degrees_per_s / 10);
            assert_eq!(exhaust.burning(), burning, "{degrees_per_s} °C/s");
        }
    }

    #[test]
    fn fall_of_15_degrees_a_second_for_3_s_does_not_burn() {
        let mut exhaust = limit();
        run(&mut exhaust, 0, 5000, |_| 700);
        run(&mut exhaust, 5000, 7000, |ms| 700 - (ms as i16 - 5000) / 50);
        assert_eq!(exhaust.burning(), Burning::NotKnown, "a fall is seen");
        run(&mut exhaust, 7000, 9200, |ms| 700 - (ms as i16 - 5000) / 50);
        assert_eq!(exhaust.burning(), Burning::No);
    }

    #[test]
    fn slower_fall_is_not_certain_until_it_ends() {
        let mut exhaust = limit();
        run(&mut exhaust, 0, 5000, |_| 700);
        run(&mut exhaust, 5000, 12_000, |ms| 700 - (ms as i16 - 5000) / 100);
        assert_eq!(exhaust.burning(), Burning::NotKnown, "10 °C/s");
        run(&mut exhaust, 12_000, 14_200, |_| 630);
        assert_eq!(exhaust.burning(), Burning::Yes, "steady again");
        run(&mut exhaust, 14_200, 25_000, |ms| 630 - (ms as i16 - 14_200) / 500);
        assert_eq!(exhaust.burning(), Burning::Yes, "2 °C/s");
    }

    #[test]
    fn fall_within_5_s_of_a_lower_demand_was_commanded() {
        let mut exhaust = limit();
        run(&mut exhaust, 0, 5000, |_| 700);
        for millis in (5000..9800).step_by(125) {
            let egt = Celsius::from_tenths(7000 - (millis as i16 - 5000) / 5);
            exhaust.observe(at(millis), Some(egt), Fall::Expected);
        }
        assert_eq!(exhaust.burning(), Burning::Yes);
    }

    #[test]
    fn step_or_broken_sensor_is_not_readable() {
        for broken in [Some(Celsius::from_tenths(-500)), Some(Celsius::from_tenths(200)), None] {
            let mut exhaust = limit();
            run(&mut exhaust, 0, 1000, |_| 700);
            exhaust.observe(at(1000), broken, Fall::NotExpected);
            run(&mut exhaust, 1125, 3000, |_| 20);
            assert_eq!(exhaust.burning(), Burning::NotReadable, "{broken:?}");
            run(&mut exhaust, 3000, 3500, |_| 700);
            assert_eq!(exhaust.burning(), Burning::Yes, "{broken:?}");
        }
    }
}
