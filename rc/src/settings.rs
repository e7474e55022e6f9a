//! Settings of radio control: of each engine, and of its outputs.

use jetlink::setting::{Row, Setting, settings};

settings! {
    /// Settings of an engine.
    pub struct EngineSettings, "rc.", UnlessTurning {
        throttle: number "RC_THR_CH" = 3 in 0..=18, "Channel of the throttle. 0: radio control does not command this engine.";
        low: pulse "RC_THR_MIN" = 1100 in 800..=2200, "Pulse width at idle.";
        high: pulse "RC_THR_MAX" = 1900 in 800..=2200, "Pulse width at full throttle, at least 300 µs above idle.";
        reversed: yes_no "RC_THR_REV" = 0 in 0..=1, "The channel is reversed: the shorter pulse is full throttle.";
        beyond: pulse "RC_THR_BEYOND" = 150 in 0..=500, "A throttle beyond an end point by more than this counts as no signal.";
        switch: number "RC_SW_CH" = 5 in 0..=18, "Channel of the arm/stop switch with three positions: stop, standby, run allowed. 0: none; radio control then moves the throttle of a running engine, but neither starts nor stops one.";
        switch_stop: pulse "RC_SW_STOP" = 1300 in 900..=1900, "Longest pulse width of the stop position. Standby begins 100 µs above it.";
        switch_run: pulse "RC_SW_RUN" = 1700 in 1100..=2100, "Shortest pulse width of the run-allowed position, at least 300 µs above RC_SW_STOP. Standby ends 100 µs below it.";
        switch_reversed: yes_no "RC_SW_REV" = 0 in 0..=1, "The switch is reversed: the shorter pulse is run allowed. RC_SW_STOP and RC_SW_RUN then apply to 3000 µs minus the pulse.";
        hand_over: number "RC_HAND_CH" = 0 in 0..=18, "Channel that hands the engine over to the lower source above 1700 µs: radio control is then present and commands nothing, but keeps the stop. 0: none.";
        rpm_low: rpm_or_off "RC_RPM_MIN" = -1 in 0..=16_000_000, "Shaft speed at idle. The stick commands a shaft speed if RC_RPM_MIN and RC_RPM_MAX are both set.";
        rpm_high: rpm_or_off "RC_RPM_MAX" = -1 in 0..=16_000_000, "Shaft speed at full throttle. Off: the stick commands a throttle.";
    }
}

settings! {
    /// Settings of the outputs of an engine. Their pins are part of the wiring ([`crate::wiring`]): they are driven before settings can be
    /// read.
    pub struct OutputSettings, "outputs.", AtNextStart {
        not_obeyed: ms_or_off "OUT_NOT_OBEYED" = 5000 in 1000..=60_000, "The valve closes when the ECU has not followed a standby order for this time, plus the 3 s until that is detected. Off: it stays open.";
    }
}

/// Smallest distance between the end points, in µs.
pub(crate) const SPAN: u16 = 300;

/// Reason for refusing settings.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum SettingsError {
    /// A setting is out of range.
    OutOfRange(&'static Setting),
    /// The end points are too close, or in the wrong order.
    EndPoints,
    /// The positions of the switch are too close, or in the wrong order.
    Positions,
    /// The shaft speeds of the end points are in the wrong order.
    ShaftSpeeds,
    /// Two functions have the same channel.
    SameChannel,
    /// The engine turns, or is ordered to.
    EngineTurns,
}

impl SettingsError {
    /// What is wrong, without the range of a setting.
    pub const fn text(&self) -> &'static str {
        match self {
            Self::OutOfRange(setting) => setting.message,
            Self::EndPoints => "RC_THR_MAX has to be 300 µs above RC_THR_MIN or more",
            Self::Positions => "RC_SW_RUN has to be 300 µs above RC_SW_STOP or more",
            Self::ShaftSpeeds => "RC_RPM_MAX has to be above RC_RPM_MIN",
            Self::SameChannel => "throttle, switch and hand-over need a channel each",
            Self::EngineTurns => "stop the engine first",
        }
    }
}

impl core::fmt::Display for SettingsError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::OutOfRange(setting) => write!(f, "{}: {}", setting.name, setting.message),
            other => f.write_str(other.text()),
        }
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for SettingsError {
    fn format(&self, f: defmt::Formatter<'_>) {
        match self {
            Self::OutOfRange(setting) => defmt::write!(f, "{}: {}", setting.name, setting.message),
            other => defmt::write!(f, "{}", other.text()),
        }
    }
}

impl core::error::Error for SettingsError {}

impl EngineSettings {
    /// The defaults for servo pulses: throttle on channel 1, switch on channel 2.
    pub const PULSES: Self = Self { throttle: 1, switch: 2, ..Self::DEFAULT };

    /// The table without its texts.
    pub const TABLE_ROWS: &'static [Row] = Self::ROWS;

    /// The number of a setting.
    pub fn number(&self, name: &str) -> Option<i32> {
        self.own::<false>(name)
    }

    /// Changes a setting. Check all of them afterwards: [`EngineSettings::check`]. False: no setting has this name, or the number
    /// is out of range.
    pub fn set(&mut self, name: &str, number: i32) -> bool {
        let allowed = Self::ROWS.iter().any(|row| row.name == name && row.allows(number));
        allowed && self.set_own::<false>(name, number)
    }

    /// Checks each setting, and that they fit together.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub const fn check(&self) -> Result<(), SettingsError> {
        if let Err(row) = self.check_own()
            && (row as usize) < Self::SETTINGS.len()
        {
            return Err(SettingsError::OutOfRange(&Self::SETTINGS[row as usize]));
        }
        if self.high < self.low.saturating_add(SPAN) {
            return Err(SettingsError::EndPoints);
        }
        if self.switch_run < self.switch_stop.saturating_add(SPAN) {
            return Err(SettingsError::Positions);
        }
        match (self.rpm_low, self.rpm_high) {
            (Some(low), Some(high)) if low.get() >= high.get() => return Err(SettingsError::ShaftSpeeds),
            // With only one of them, the stick commands a throttle: parameters are set one at a time.
            _ => {}
        }
        let [throttle, switch, hand_over] = self.channels();
        if same(throttle, switch) || same(throttle, hand_over) || same(switch, hand_over) {
            return Err(SettingsError::SameChannel);
        }
        Ok(())
    }

    /// The channels of its functions: throttle, switch, hand-over. 0: none.
    const fn channels(&self) -> [u8; 3] {
        [self.throttle, self.switch, self.hand_over]
    }

    /// The highest channel that it uses.
    pub(crate) const fn highest_channel(&self) -> u8 {
        let [throttle, switch, hand_over] = self.channels();
        let highest = if throttle > switch { throttle } else { switch };
        if highest > hand_over { highest } else { hand_over }
    }
}

/// Whether two functions have the same channel. 0: no channel.
const fn same(a: u8, b: u8) -> bool {
    a != 0 && a == b
}

impl OutputSettings {
    /// The number of a setting.
    pub fn number(&self, name: &str) -> Option<i32> {
        self.own::<false>(name)
    }

    /// Changes a setting from the next start of the node on. False: no setting has this name, or the number is out of range.
    pub fn set(&mut self, name: &str, number: i32) -> bool {
        let allowed = Self::ROWS.iter().any(|row| row.name == name && row.allows(number));
        allowed && self.set_own::<false>(name, number)
    }

    /// Checks each setting.
    ///
    /// # Errors
    /// The first setting that is out of range.
    pub const fn check(&self) -> Result<(), SettingsError> {
        if let Err(row) = self.check_own()
            && (row as usize) < Self::SETTINGS.len()
        {
            return Err(SettingsError::OutOfRange(&Self::SETTINGS[row as usize]));
        }
        Ok(())
    }
}

const _: () =
    assert!(EngineSettings::DEFAULT.check_own().is_ok() && OutputSettings::DEFAULT.check_own().is_ok());

#[cfg(test)]
mod tests {
    use super::*;
    use jetlink::units::Rpm;

    #[test]
    fn defaults_are_right_and_every_wrong_whole_is_refused() {
        let good = EngineSettings::DEFAULT;
        assert_eq!(good.check(), Ok(()));
        let rpm = |low, high| EngineSettings { rpm_low: low, rpm_high: high, ..good };
        let of = |rpm| Some(Rpm::new(rpm));
        assert_eq!(rpm(of(35_000), of(110_000)).check(), Ok(()));
        for (settings, wrong) in [
            (EngineSettings { low: 1601, ..good }, SettingsError::EndPoints),
            (EngineSettings { low: 1900, high: 1100, ..good }, SettingsError::EndPoints),
            (EngineSettings { switch_stop: 1401, ..good }, SettingsError::Positions),
            (EngineSettings { switch_stop: 1700, switch_run: 1300, ..good }, SettingsError::Positions),
            (rpm(of(35_000), of(35_000)), SettingsError::ShaftSpeeds),
            (EngineSettings { switch: 3, ..good }, SettingsError::SameChannel),
            (EngineSettings { hand_over: 5, ..good }, SettingsError::SameChannel),
        ] {
            assert_eq!(settings.check(), Err(wrong));
        }
        // Parameters are set one at a time.
        assert_eq!([rpm(of(35_000), None), rpm(None, of(35_000))].map(|half| half.check()), [Ok(()); 2]);
        let outside = EngineSettings { switch: 19, ..good }.check();
        assert!(
            matches!(outside, Err(SettingsError::OutOfRange(row)) if row.name == "RC_SW_CH"),
            "{outside:?}"
        );
        let none = EngineSettings { throttle: 0, switch: 0, hand_over: 0, ..good };
        assert_eq!(none.check(), Ok(()));
    }

    #[test]
    fn every_setting_has_its_number() {
        let mut settings = EngineSettings::DEFAULT;
        for row in EngineSettings::SETTINGS {
            assert_eq!(settings.number(row.name), Some(row.default), "{}", row.name);
            assert!(settings.set(row.name, row.max) && !settings.set(row.name, row.max + 1), "{}", row.name);
            assert_eq!(settings.number(row.name), Some(row.max), "{}", row.name);
        }
        let mut outputs = OutputSettings::DEFAULT;
        for row in OutputSettings::SETTINGS {
            assert_eq!(outputs.number(row.name), Some(row.default), "{}", row.name);
            assert!(outputs.set(row.name, row.max) && !outputs.set(row.name, row.max + 1), "{}", row.name);
            assert_eq!((outputs.number(row.name), outputs.check()), (Some(row.max), Ok(())), "{}", row.name);
        }
        assert!(!settings.set("RC_NOTHING", 0) && settings.number("RC_NOTHING").is_none());
    }
}
