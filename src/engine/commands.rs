//! What is commanded: whom it is obeyed from, what keeps an engine from a start, and who may release a stop.

use super::sources::Intent;
use super::state::{EngineState, STATE_MAX_AGE};
use super::{Beginning, Engine, Mode, Run};
use crate::command::{Accepted, Command, Demand, Interlock, Order, Origin, Rejected};
use crate::engine::keep::Record;
use crate::link::Link;
use crate::telemetry::{Event, LinkState};
use crate::units::Rpm;
use embassy_time::{Duration, Instant};

impl Engine {
    pub(super) fn obey(
        &mut self,
        now: Instant,
        command: Command,
        origin: Origin,
        others_allow_start: bool,
    ) -> Result<Accepted, Rejected> {
        match command {
            Command::EmergencyStop => {
                self.stop(now, origin);
                return Ok(Accepted::InForce);
            }
            Command::Arm | Command::Disarm => {
                let armed = command == Command::Arm;
                if core::mem::replace(&mut self.armed, armed) != armed {
                    self.event(Event::Armed(armed, origin));
                }
                return Ok(Accepted::InForce);
            }
            Command::ReleaseStop => return self.release(now, origin),
            Command::Standby => self.sources.heard(now, origin, Intent::Standby),
            // A demand that the ECU cannot do is refused below and changes nothing, not even what its source asked before.
            Command::Run(demand) if self.can(now, demand).is_ok() => {
                self.sources.heard(now, origin, Intent::Run(demand));
            }
            Command::Run(_) => {}
            Command::HandOverToPwm | Command::Service(_) => {}
        }
        if matches!(self.mode, Mode::Stop(_)) {
            return Err(Rejected::StopLatched);
        }
        if matches!(self.mode, Mode::Listen { .. }) {
            let lost = self.link.state() == LinkState::Lost;
            return Err(if lost { Rejected::NoLink } else { Rejected::Listening });
        }
        if let Command::Run(demand) = command {
            self.can(now, demand)?;
        }
        if let Some(ruler) = self.sources.above(now, origin) {
            return match command {
                // Done once: nobody would do it when the other falls silent.
                Command::HandOverToPwm | Command::Service(_) => Err(Rejected::Behind(ruler)),
                _ => Ok(Accepted::Behind(ruler)),
            };
        }
        match command {
            Command::Run(demand) => self.run(now, demand, origin, others_allow_start),
            Command::HandOverToPwm => {
                self.link.order(now, Order::Pwm)?;
                self.mode = Mode::Pwm;
                self.start_allowed = false;
                self.note_order(Order::Pwm, origin);
                Ok(Accepted::InForce)
            }
            Command::Service(service) => {
                if service.needs_stopped_engine() {
                    self.require_stopped()?;
                }
                self.link.service(now, service).map(|()| Accepted::InForce)
            }
            // Standby; the others were dealt with above. Of a source below the one that ruled and was lost it is a
            // take-over: that is for `update`, which gives the other one time to come back.
            _ if matches!(&self.mode, Mode::Run(run) if origin.priority() < run.ruler.priority()) => {
                Ok(Accepted::Held)
            }
            _ => {
                self.standby(now, origin);
                self.start_allowed = true;
                self.failed = false;
                Ok(Accepted::InForce)
            }
        }
    }

    fn release(&mut self, now: Instant, origin: Origin) -> Result<Accepted, Rejected> {
        if let Mode::Listen { kept: Some(Record { order: Order::EmergencyStop, .. }), .. } = self.mode {
            // The stop that was kept comes into force when the engine begins.
            return Err(Rejected::Listening);
        }
        if let Mode::Stop(by) = self.mode {
            if origin.priority() < by.priority() {
                return Err(Rejected::NotYours(by));
            }
            if let Some(Intent::Run(demand)) = self.sources.intent(origin)
                && !self.is_idle(demand)
            {
                return Err(Rejected::Start(Interlock::NotIdle));
            }
            if self.link.state() != LinkState::Up {
                return Err(Rejected::NoLink);
            }
            // Standby is no start, so a phase that the ECU no longer tells does not keep the stop: an AMT error
            // set carries none.
            let told = self.link.report().phase.is_some_and(|phase| phase.age(now) <= STATE_MAX_AGE);
            if told {
                self.require_stopped()?;
            }
            self.standby(now, origin);
        }
        Ok(Accepted::InForce)
    }

    fn run(
        &mut self,
        now: Instant,
        demand: Demand,
        origin: Origin,
        others_allow_start: bool,
    ) -> Result<Accepted, Rejected> {
        // A source that speaks again after it was lost is not there yet: it neither moves nor starts an engine.
        let rules = self.sources.ruler(now).is_some_and(|(ruler, _)| ruler == origin);
        if matches!(self.mode, Mode::Run(_)) {
            // Whose demand is in force is for `update`.
            self.update(now);
            let in_force =
                matches!(&self.mode, Mode::Run(run) if run.ruler == origin && run.fail_safe_at.is_none());
            return Ok(if rules && in_force { Accepted::InForce } else { Accepted::Held });
        }
        if !rules {
            return Ok(Accepted::Held);
        }
        if !self.start_allowed {
            return Err(Rejected::StandbyFirst);
        }
        self.interlocks(now, demand, others_allow_start).map_err(Rejected::Start)?;
        self.begin(now, demand, origin, Beginning::FromStandby);
        Ok(Accepted::InForce)
    }

    /// Whether the ECU, or the governor for it, can do this.
    pub(super) fn can(&self, now: Instant, demand: Demand) -> Result<(), Rejected> {
        let Demand::Rpm(rpm) = demand else { return Ok(()) };
        match self.link.speed_control() {
            Err(why) => {
                let Some(governor) = self.config.governor else { return Err(why) };
                // At work it deals with old speeds itself: they are no reason to lose the source.
                let at_work = matches!(&self.mode, Mode::Run(Run { demand: Demand::Rpm(_), .. }));
                let known = self.link.report().rpm.is_some_and(|rpm| rpm.age(now) <= governor.max_age);
                if at_work || known { Ok(()) } else { Err(Rejected::RpmNotKnown) }
            }
            Ok(()) => match self.link.report().max_rpm {
                Some(max) if rpm > max.value => Err(Rejected::AboveMaxRpm { max: max.value }),
                _ => Ok(()),
            },
        }
    }

    /// What keeps the engine from a start, the first thing found.
    fn interlocks(&self, now: Instant, demand: Demand, others_allow_start: bool) -> Result<(), Interlock> {
        let rules = &self.config.start;
        let report = self.link.report();
        if rules.arming && !self.armed {
            return Err(Interlock::NotArmed);
        }
        if !self.is_idle(demand) {
            return Err(Interlock::NotIdle);
        }
        let stable = self.link.up_since().is_some_and(|since| now >= since + rules.link_stable);
        if self.link.state() != LinkState::Up || !stable {
            return Err(Interlock::Link);
        }
        if report.faults.is_some_and(|faults| !faults.value.is_empty()) {
            return Err(Interlock::Fault);
        }
        if EngineState::of(now, LinkState::Up, report) != EngineState::Standby {
            return Err(Interlock::NotStandby);
        }
        match report.egt.filter(|egt| egt.age(now) <= rules.link_stable.max(Duration::from_secs(1))) {
            None => return Err(Interlock::EgtUnknown),
            // Cool in two values in a row: AMT frames carry no checksum.
            Some(egt) => {
                let hottest = self.watch.hottest().unwrap_or(egt.value).max(egt.value);
                if hottest > rules.egt_max {
                    return Err(Interlock::TooHot(hottest));
                }
            }
        }
        if let (Some(least), Some(supply)) =
            (rules.supply_min, report.supply.and_then(|supply| supply.value.voltage))
            && supply < least
        {
            return Err(Interlock::SupplyLow(supply));
        }
        if let Some((passed, _)) = self.watch.in_force() {
            return Err(Interlock::Limit(passed.what));
        }
        if !others_allow_start {
            return Err(Interlock::OtherStarting);
        }
        Ok(())
    }

    fn is_idle(&self, demand: Demand) -> bool {
        match demand {
            Demand::Throttle(throttle) => throttle <= self.config.start.idle_band,
            Demand::Rpm(rpm) => {
                let idle = self.link.report().idle_rpm.map_or(Rpm::new(0), |idle| idle.value);
                rpm <= idle
            }
        }
    }

    fn require_stopped(&self) -> Result<(), Rejected> {
        if self.link.state() != LinkState::Up {
            return Err(Rejected::NoLink);
        }
        match self.phase() {
            Some(phase) if phase.is_stopped() => Ok(()),
            _ => Err(Rejected::NotStopped),
        }
    }

    /// Keeps the last refusal of a source, and gives the one before.
    pub(super) fn note_rejection(&mut self, origin: Origin, why: Option<Rejected>) -> Option<Rejected> {
        let slot = Origin::ALL.into_iter().zip(&mut self.last_rejection).find(|(place, _)| *place == origin);
        slot.and_then(|(_, last)| core::mem::replace(last, why))
    }
}
