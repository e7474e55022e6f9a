//! What is commanded: whom it is obeyed from, what keeps an engine from a start, and who may release a stop.
//!
//! A start is a permission that is used once. It belongs to one source: its own standby, then its own `Run` at idle, with
//! every interlock true at that instant. A refusal uses it up, and so does every standby or stop that takes effect, a
//! disarm, and any source's change to standby. Only a start that waits for another engine is not refused: it waits, for a
//! bounded time, while its source stays in control, and everything is checked again when it goes.

use super::exhaust::Exhaust;
use super::life::Life;
use super::run::Run;
use super::sources::Intent;
use super::state::{EngineState, STATE_MAX_AGE};
use super::{Beginning, Engine, Mode, OpenPump, StartWait, slot};
use crate::command::{Accepted, Command, Demand, Interlock, Order, Origin, Rejected};
use crate::ecu::Service;
use crate::event::Event;
use crate::link::Link;
use crate::report::LinkState;
use crate::units::{Rpm, Throttle};
use embassy_time::{Duration, Instant};

/// A start waits no longer than this for other engines of the group.
const START_WAIT_MAX: Duration = Duration::from_secs(180);

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
                Ok(Accepted::InForce)
            }
            Command::ReleaseStop => self.release(now, origin),
            Command::Arm => self.arm(origin),
            Command::Disarm => {
                self.disarm(now, origin);
                Ok(Accepted::InForce)
            }
            Command::Present => {
                self.sources.heard(now, origin, Intent::Nothing);
                self.use_up(origin);
                Ok(self.sources.above(now, origin).map_or(Accepted::InForce, Accepted::Behind))
            }
            Command::ShutDown => self.shut_down(now, origin),
            Command::Standby => self.standby_word(now, origin),
            Command::Run(demand) => self.run_word(now, demand, origin, others_allow_start),
            Command::HandOverToPwm => self.hand_over(now, origin, others_allow_start),
            Command::Service(service) => self.service(now, service, origin),
        }
    }

    /// Arming counts as a change only: after an emergency stop a source that has said it all along has to disarm first.
    fn arm(&mut self, origin: Origin) -> Result<Accepted, Rejected> {
        if let Some(said) = slot(&mut self.arm_commanded, origin) {
            *said = true;
        }
        if matches!(self.mode, Mode::Stop(_)) {
            if let Some(must) = slot(&mut self.must_disarm, origin) {
                *must = true;
            }
            return Err(Rejected::StopLatched);
        }
        if slot(&mut self.must_disarm, origin).is_some_and(|must| *must) {
            return Err(Rejected::DisarmFirst);
        }
        if !core::mem::replace(&mut self.armed, true) {
            self.event(Event::Armed(true, origin));
        }
        Ok(Accepted::InForce)
    }

    /// Ends a start that has not reached running, and never an engine that has.
    fn disarm(&mut self, now: Instant, origin: Origin) {
        for table in [&mut self.arm_commanded, &mut self.must_disarm] {
            if let Some(flag) = slot(table, origin) {
                *flag = false;
            }
        }
        if core::mem::replace(&mut self.armed, false) {
            self.event(Event::Armed(false, origin));
        }
        self.permitted = [false; Origin::ALL.len()];
        self.start_wait = None;
        self.close_pump();
        let starting = match &self.mode {
            Mode::Run(Run { life, .. }) | Mode::Pwm { life, .. } => !life.reached(),
            Mode::Listen(finding) => finding.started.is_some(),
            _ => false,
        };
        if starting {
            self.sources.forget_runs();
            self.standby(now, origin);
        }
    }

    /// The explicit order of a person: at once, whatever streams say.
    fn shut_down(&mut self, now: Instant, origin: Origin) -> Result<Accepted, Rejected> {
        if matches!(self.mode, Mode::Stop(_)) {
            return Err(Rejected::StopLatched);
        }
        self.sources.forget_runs();
        self.standby(now, origin);
        self.failed = false;
        Ok(Accepted::InForce)
    }

    fn standby_word(&mut self, now: Instant, origin: Origin) -> Result<Accepted, Rejected> {
        // An engine that runs, or may run, is shut down by two words.
        let two_words = match &self.mode {
            Mode::Run(Run { life, .. }) | Mode::Pwm { life, .. } => life.reached(),
            Mode::Listen(_) => true,
            Mode::Stop(_) | Mode::Standby => false,
        };
        let word = self.sources.standby(now, origin, two_words);
        if matches!(self.mode, Mode::Stop(_)) {
            return Err(Rejected::StopLatched);
        }
        if !word.counts {
            return Ok(Accepted::OneMore);
        }
        if word.changed {
            self.permitted = [false; Origin::ALL.len()];
            self.start_wait = None;
        }
        let above = self.sources.above(now, origin);
        let in_control = self.sources.in_control(now, origin);
        match &self.mode {
            Mode::Listen(_) if above.is_none() => {
                if !self.begun || !self.settled(now) || self.run_of_a_higher_one(now, origin) {
                    return Ok(Accepted::Held);
                }
                self.standby(now, origin);
            }
            // Whoever handed it over takes it back.
            Mode::Pwm { .. } if origin == self.ordered.origin => self.standby(now, origin),
            // Where nothing runs yet, one word of whoever it is ends it; then whoever is above it.
            Mode::Pwm { life, .. }
                if above.is_none()
                    && (!life.reached()
                        || in_control && origin.priority() > self.ordered.origin.priority()) =>
            {
                self.standby(now, origin);
            }
            // One that was lost may end the start, too: it takes no second word.
            Mode::Run(Run { life, .. }) if above.is_none() && !life.reached() => self.standby(now, origin),
            // Of whom it is obeyed, and when, is found for all sources alike.
            Mode::Run(_) => self.update(now),
            _ => {}
        }
        if let Some(above) = above {
            self.permit_in_standby(origin);
            return Ok(Accepted::Behind(above));
        }
        // Whoever wants fuel to flow does not say standby; but what was just commanded goes out once.
        if !self.link.service_pending() {
            self.close_pump();
        }
        if !matches!(self.mode, Mode::Standby) {
            return Ok(Accepted::Held);
        }
        self.permit_in_standby(origin);
        self.failed = false;
        self.ended_by_loss = false;
        self.order(now, Order::Standby, origin);
        Ok(Accepted::InForce)
    }

    /// Nothing is in force, but it is known whose demand was: a lower source's standby counts when that one has been lost for
    /// as long as it takes to end its run.
    fn run_of_a_higher_one(&self, now: Instant, origin: Origin) -> bool {
        let Mode::Listen(finding) = &self.mode else { return false };
        // Of an engine that is known to have run, and not for whom, every source may be the lower one; but not the highest.
        let unknown = finding.ran && finding.ruler == Origin::Node;
        let ruler = if unknown { Origin::SOURCES[0] } else { finding.ruler };
        if ruler.priority() <= origin.priority() {
            return false;
        }
        let lost_at = self.sources.silent_from(ruler).unwrap_or(finding.since);
        let after = self.config.loss.hold + self.config.loss.lower_standby_after;
        let left = Duration::from_ticks(after.as_ticks().saturating_sub(finding.lost_for.as_ticks()));
        lost_at.checked_add(left).is_none_or(|at| now < at)
    }

    fn permit_in_standby(&mut self, origin: Origin) {
        if matches!(self.mode, Mode::Standby) {
            self.permit(origin);
        }
    }

    pub(super) fn use_up(&mut self, origin: Origin) {
        if let Some(permitted) = slot(&mut self.permitted, origin) {
            *permitted = false;
        }
        if self.start_wait.is_some_and(|wait| wait.origin == origin) {
            self.start_wait = None;
        }
    }

    fn run_word(
        &mut self,
        now: Instant,
        demand: Demand,
        origin: Origin,
        others_allow_start: bool,
    ) -> Result<Accepted, Rejected> {
        let demand = self.clamp(demand);
        let can = self.can(now, demand);
        match can {
            Ok(()) => self.sources.heard(now, origin, Intent::Run(demand)),
            // The ECU has not given its version yet: no reason to lose the source, which wants the engine to run.
            Err(Rejected::NeedsVersion { known: None, .. }) => self.sources.stays(now, origin, demand),
            Err(_) => {}
        }
        let result = match &self.mode {
            Mode::Stop(_) => Err(Rejected::StopLatched),
            Mode::Listen(_) if self.link.status().state == LinkState::Lost => Err(Rejected::NoLink),
            Mode::Listen(_) => Err(Rejected::Listening),
            // A demand that the ECU cannot do changes nothing, not even what its source commanded before.
            _ if can.is_err() => Err(can.err().unwrap_or(Rejected::NotSupported)),
            Mode::Run(_) => {
                // Whose demand is in force is for `update`.
                self.update(now);
                let in_control = self.sources.in_control(now, origin);
                let in_force =
                    matches!(&self.mode, Mode::Run(run) if run.ruler == origin && run.fail_safe_at.is_none());
                return Ok(match self.sources.above(now, origin) {
                    Some(above) => Accepted::Behind(above),
                    None if in_force && in_control => Accepted::InForce,
                    None => Accepted::Held,
                });
            }
            Mode::Standby | Mode::Pwm { .. } => self.start_word(now, origin, others_allow_start, |engine| {
                engine.interlocks(now, demand, others_allow_start)
            }),
        };
        match result {
            Ok(Accepted::InForce) => self.begin(now, demand, origin, Beginning::FromStandby),
            Ok(Accepted::StartWaits) => {}
            // Whatever kept it from the start: its next run does not start the engine later.
            _ => {
                if matches!(result, Err(Rejected::Start(Interlock::PumpOpen))) {
                    self.close_pump();
                }
                self.use_up(origin);
            }
        }
        result
    }

    /// Whether a source's word starts the engine now. `InForce`: it does.
    fn start_word(
        &mut self,
        now: Instant,
        origin: Origin,
        others_allow_start: bool,
        interlocks: impl FnOnce(&Self) -> Result<(), Interlock>,
    ) -> Result<Accepted, Rejected> {
        if let Some(above) = self.sources.above(now, origin) {
            return Ok(Accepted::Behind(above));
        }
        // A source that speaks again after it was lost is not there yet: it neither moves nor starts an engine.
        if !self.sources.in_control(now, origin) {
            return Ok(Accepted::Held);
        }
        if !matches!(self.mode, Mode::Standby) {
            return Err(Rejected::StandbyFirst);
        }
        if !slot(&mut self.permitted, origin).is_some_and(|permitted| *permitted) {
            return Err(Rejected::StandbyFirst);
        }
        match interlocks(self) {
            Ok(()) => Ok(Accepted::InForce),
            Err(Interlock::OtherStarting) if !others_allow_start => {
                if self.start_wait.is_none() {
                    self.start_wait = Some(StartWait { origin, until: now + START_WAIT_MAX });
                }
                Ok(Accepted::StartWaits)
            }
            Err(interlock) => Err(Rejected::Start(interlock)),
        }
    }

    /// A hand-over to the ECU's PWM input counts as a start.
    fn hand_over(
        &mut self,
        now: Instant,
        origin: Origin,
        others_allow_start: bool,
    ) -> Result<Accepted, Rejected> {
        if matches!(self.mode, Mode::Stop(_)) {
            return Err(Rejected::StopLatched);
        }
        if matches!(self.mode, Mode::Listen(_)) {
            return Err(Rejected::Listening);
        }
        if let Some(above) = self.sources.above(now, origin) {
            return Err(Rejected::Behind(above));
        }
        let idle = Demand::Throttle(Throttle::IDLE);
        // A source that was lost has to say standby again, for a while.
        let permitted = self.sources.in_control(now, origin)
            && matches!(self.mode, Mode::Standby)
            && slot(&mut self.permitted, origin).is_some_and(|permitted| *permitted);
        let result = if permitted {
            self.interlocks(now, idle, others_allow_start).map_err(Rejected::Start)
        } else {
            Err(Rejected::StandbyFirst)
        };
        let result = result.and_then(|()| self.link.order(now, Order::Pwm));
        self.permitted = [false; Origin::ALL.len()];
        result?;
        self.mode = Mode::Pwm { life: Life::ordered(), start_by: Some(now + self.start_time()) };
        self.last_start = Some(now);
        self.note_order(Order::Pwm, origin);
        Ok(Accepted::InForce)
    }

    fn service(&mut self, now: Instant, service: Service, origin: Origin) -> Result<Accepted, Rejected> {
        if matches!(self.mode, Mode::Stop(_)) {
            return Err(Rejected::StopLatched);
        }
        if matches!(self.mode, Mode::Listen(_)) {
            let lost = self.link.status().state == LinkState::Lost;
            return Err(if lost { Rejected::NoLink } else { Rejected::Listening });
        }
        if let Some(above) = self.sources.above(now, origin) {
            return Err(Rejected::Behind(above));
        }
        if service.needs_stopped_engine() {
            self.require_stopped()?;
        }
        if service.moves_fuel() {
            self.require_cold()?;
            // It may be another ECU that comes back, which may know the command as another one.
            self.steady_link(now).map_err(Rejected::Start)?;
        }
        if service.closes_pump() && self.pump.is_some() {
            self.close_pump();
            return Ok(Accepted::InForce);
        }
        self.link.service(now, service)?;
        if service.moves_fuel() {
            self.pump = Some(OpenPump { origin, heard: now, until: now + self.config.service_time });
        }
        Ok(Accepted::InForce)
    }

    /// Fuel and heat need a cold engine in standby, armed.
    fn require_cold(&self) -> Result<(), Rejected> {
        if !self.armed {
            return Err(Rejected::Start(Interlock::NotArmed));
        }
        let state = EngineState::of(self.at, self.link.status().state, &self.link.status().report);
        // At its stop it may be an ECU that does not hear us.
        if !matches!(self.mode, Mode::Standby) || state != EngineState::Standby {
            return Err(Rejected::Start(Interlock::NotStandby));
        }
        self.cold(self.at).map_err(Rejected::Start)
    }

    /// A demand beyond the engine's maximum becomes the maximum. Reported once, until one within it comes.
    fn clamp(&mut self, demand: Demand) -> Demand {
        let Demand::Rpm(rpm) = demand else { return demand };
        let own = self
            .link
            .status()
            .report
            .max_rpm
            .map(|max| max.value)
            .filter(|_| self.link.speed_control().is_ok());
        // A governor's maximum is none of an ECU that has not given its version yet.
        let waits = self.waits_for_version();
        let governed = self.config.governor.filter(|_| !waits).map(|governor| governor.max_rpm);
        let max = own.or(governed).filter(|max| rpm > *max);
        let told = core::mem::replace(&mut self.clamp_reported, max.is_some());
        match max {
            Some(max) => {
                if !told {
                    self.event(Event::Clamped(max));
                }
                Demand::Rpm(max)
            }
            None => demand,
        }
    }

    fn release(&mut self, now: Instant, origin: Origin) -> Result<Accepted, Rejected> {
        let Mode::Stop(by) = self.mode else { return Ok(Accepted::InForce) };
        if origin.priority() < by.priority() {
            return Err(Rejected::NotYours(by));
        }
        if let Some(Intent::Run(demand)) = self.sources.intent(origin)
            && !self.is_idle(demand)
        {
            return Err(Rejected::Start(Interlock::NotIdle));
        }
        if self.link.status().state != LinkState::Up {
            return Err(Rejected::NoLink);
        }
        // Standby is no start, so a phase that the ECU no longer reports does not keep the stop: an AMT error set
        // carries none.
        let reported = self.link.status().report.phase.is_some_and(|phase| phase.age(now) <= STATE_MAX_AGE);
        if reported {
            self.require_stopped()?;
        }
        self.standby(now, origin);
        Ok(Accepted::InForce)
    }

    /// Whether the ECU, or the governor for it, can do this.
    pub(super) fn can(&self, now: Instant, demand: Demand) -> Result<(), Rejected> {
        let Demand::Rpm(_) = demand else { return Ok(()) };
        match self.link.speed_control() {
            Err(why) => {
                // An ECU that came back has not given its version yet: the demand that is in force stays one.
                let in_force = matches!(&self.mode, Mode::Run(Run { demand: Demand::Rpm(_), life, .. }) if life.reached());
                if in_force && matches!(why, Rejected::NeedsVersion { known: None, .. }) {
                    return Ok(());
                }
                let Some(governor) = self.config.governor else { return Err(why) };
                // At work it deals with old speeds itself: they are no reason to lose the source.
                let at_work = matches!(&self.mode, Mode::Run(Run { demand: Demand::Rpm(_), .. }));
                let known = self.link.status().report.rpm.is_some_and(|rpm| rpm.age(now) <= governor.max_age);
                if at_work || known { Ok(()) } else { Err(Rejected::RpmNotKnown) }
            }
            Ok(()) => Ok(()),
        }
    }

    /// What keeps the engine from a start, the first thing found.
    fn interlocks(&self, now: Instant, demand: Demand, others_allow_start: bool) -> Result<(), Interlock> {
        let rules = &self.config.start;
        let report = &self.link.status().report;
        if rules.arming && !self.armed {
            return Err(Interlock::NotArmed);
        }
        if !self.is_idle(demand) {
            return Err(Interlock::NotIdle);
        }
        self.steady_link(now)?;
        if self.pump.is_some() || self.link.closing_pump() {
            return Err(Interlock::PumpOpen);
        }
        if report.faults.is_some_and(|faults| !faults.value.is_empty()) {
            return Err(Interlock::Fault);
        }
        if EngineState::of(now, LinkState::Up, report) != EngineState::Standby {
            return Err(Interlock::NotStandby);
        }
        self.cold(now)?;
        if let (Some(least), Some(supply)) =
            (rules.supply_min, report.supply.and_then(|supply| supply.value.voltage))
            && supply < least
        {
            return Err(Interlock::SupplyLow(supply));
        }
        if let Some((passed, _)) = self.limits.in_force() {
            return Err(Interlock::Limit(passed.what));
        }
        if !others_allow_start {
            return Err(Interlock::OtherStarting);
        }
        Ok(())
    }

    /// Whether the ECU has been heard for a while without a gap.
    fn steady_link(&self, now: Instant) -> Result<(), Interlock> {
        let time = self.config.start.link_stable;
        let stable = self.link.status().up_since.is_some_and(|since| now >= since + time);
        // A gap that has begun is not yet a loss.
        let steady = self.last_gap.is_none_or(|gap| now >= gap + time);
        let heard = self.link.status().state == LinkState::Up && self.link.gap_at().is_some();
        if stable && steady && heard { Ok(()) } else { Err(Interlock::Link) }
    }

    /// Whether the exhaust is known to be cool, in two values in a row: AMT frames carry no checksum.
    fn cold(&self, now: Instant) -> Result<(), Interlock> {
        let rules = &self.config.start;
        let max_age = rules.link_stable.max(Duration::from_secs(1));
        let egt = self.link.status().report.egt.filter(|egt| egt.age(now) <= max_age);
        // A thermocouple that is broken says −50 °C, which is not cool.
        let Some(egt) = egt.filter(|egt| Exhaust::is_plausible(egt.value)) else {
            return Err(Interlock::EgtUnknown);
        };
        let hottest = self.limits.hottest().unwrap_or(egt.value).max(egt.value);
        if hottest > rules.egt_max { Err(Interlock::TooHot(hottest)) } else { Ok(()) }
    }

    fn is_idle(&self, demand: Demand) -> bool {
        match demand {
            Demand::Throttle(throttle) => throttle <= self.config.start.idle_band,
            Demand::Rpm(rpm) => {
                let idle = self.link.status().report.idle_rpm.map_or(Rpm::new(0), |idle| idle.value);
                rpm <= idle
            }
        }
    }

    fn require_stopped(&self) -> Result<(), Rejected> {
        if self.link.status().state != LinkState::Up {
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
