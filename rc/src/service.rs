//! One receiver and the engines that it commands.

use crate::calibration::CalibrationError;
use crate::channels::Channels;
use crate::input::Input;
use crate::pilot::{Outcome, Pilot};
use embassy_time::{Duration, Instant};
use heapless::Vec;

/// Time for which the channels of a frame are current.
const FRESH: Duration = Duration::from_millis(500);

/// Time for which link statistics are current.
const LINK_FRESH: Duration = Duration::from_secs(1);

/// An input and up to `N` engines.
#[derive(Debug)]
pub struct Service<'a, const N: usize> {
    input: Input,
    pilots: Vec<Pilot<'a>, N>,
    /// The UART reported a fault with the previous bytes.
    fault_before: bool,
    /// The last valid values.
    last: Option<(Instant, Channels)>,
}

impl<'a, const N: usize> Service<'a, N> {
    /// A service of this input for these engines; engines beyond `N` are left out.
    pub fn new(input: Input, pilots: impl IntoIterator<Item = Pilot<'a>>) -> Self {
        Self { input, pilots: pilots.into_iter().take(N).collect(), fault_before: false, last: None }
    }

    /// The input, with its counters.
    pub const fn input(&self) -> &Input {
        &self.input
    }

    /// The engines, in their order.
    pub fn pilots(&self) -> &[Pilot<'a>] {
        &self.pilots
    }

    /// Begins a calibration of the stick of an engine, by its place, or ends it. `None`: there is no such engine. It is refused while any
    /// engine of the receiver turns, and an engine that begins to turn ends it: several engines may share the stick.
    pub fn calibrate(&mut self, engine: usize, begin: bool) -> Option<Result<(), CalibrationError>> {
        let any_turns = self.any_turns();
        let pilot = self.pilots.get_mut(engine)?;
        Some(match (any_turns, begin) {
            (true, _) => Err(CalibrationError::EngineTurns),
            (false, true) => pilot.begin_calibration(),
            (false, false) => pilot.end_calibration().map(|_| ()),
        })
    }

    fn any_turns(&self) -> bool {
        self.pilots.iter().any(Pilot::turns)
    }

    /// An engine by its place, to configure it.
    pub fn pilot_mut(&mut self, engine: usize) -> Option<&mut Pilot<'a>> {
        self.pilots.get_mut(engine)
    }

    /// The current values; `None`: nothing has been received for 0.5 s.
    pub fn channels(&self, now: Instant) -> Option<&Channels> {
        let (at, channels) = self.last.as_ref()?;
        (now.saturating_duration_since(*at) <= FRESH).then_some(channels)
    }

    /// Share of radio frames that arrive, in percent, as a CRSF receiver reported within the last second.
    pub fn link_quality(&self, now: Instant) -> Option<u8> {
        let Input::Crsf(crsf) = &self.input else { return None };
        let link = crsf.link().filter(|link| now.saturating_duration_since(link.at) <= LINK_FRESH)?;
        Some(link.uplink_quality)
    }

    /// Sets whether the stored settings are damaged. While they are, no engine is started.
    pub fn set_damaged(&mut self, damaged: bool) {
        self.pilots.iter_mut().for_each(|pilot| pilot.set_damaged(damaged));
    }

    /// Takes a pulse of a timer ([`crate::pwm::Pwm::pulse`]).
    pub fn pulse(
        &mut self,
        now: Instant,
        number: u8,
        width: u32,
        period: u32,
        mut outcome: impl FnMut(usize, Outcome),
    ) {
        if let Some(channels) = self.input.pulse(now, number, width, period) {
            self.pass_on(now, channels, &mut outcome);
        }
    }

    fn pass_on(&mut self, now: Instant, channels: Channels, outcome: &mut impl FnMut(usize, Outcome)) {
        self.last = Some((now, channels));
        if self.pilots.iter().any(Pilot::calibrates) && self.any_turns() {
            self.pilots.iter_mut().for_each(Pilot::cancel_calibration);
        }
        for (engine, pilot) in self.pilots.iter_mut().enumerate() {
            let result = pilot.frame(now, &channels);
            outcome(engine, result);
        }
    }

    /// Takes bytes; the last one was received at `now` or before. `fault`: the UART has reported a fault since the last call.
    /// `outcome` gets the outcome of each valid frame, for each engine by its place.
    pub fn receive(
        &mut self,
        now: Instant,
        mut bytes: &[u8],
        fault: bool,
        mut outcome: impl FnMut(usize, Outcome),
    ) {
        // A fault is noticed when bytes are read: it belongs to them, or to a later byte that was not read yet.
        if fault || self.fault_before {
            self.input.line_error();
        }
        self.fault_before = fault;
        while !bytes.is_empty() {
            let (taken, channels) = self.input.receive(now, bytes);
            bytes = bytes.get(taken.max(1)..).unwrap_or_default();
            if let Some(channels) = channels {
                self.pass_on(now, channels, &mut outcome);
            }
        }
    }
}
