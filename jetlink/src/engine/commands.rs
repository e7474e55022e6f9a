//! Commands: which sources are obeyed, what keeps an engine from a start, and who may release a stop.
//!
//! The permission to start belongs to one source and is used once: its own standby, then its own `Run` at idle, with every
//! interlock satisfied at that instant. A refusal uses it up; so does every standby or stop that takes effect, a disarm, and
//! any source's change to standby. Only a start that has to wait for another engine keeps it: it waits for at most 180 s
//! while its source stays in control, and every interlock is checked again when it begins.

use super::data::{Beginning, Engine, FuelService, Mode, OpenPump, StartWait};
use super::life::Life;
use super::origins::Origins;
use super::run::Run;
use super::sources::Intent;
use super::state::{self, EngineState};
use crate::command::{Accepted, Command, Demand, Interlock, Order, Origin, Rejected};
use crate::ecu::Service;
use crate::event::Event;
use crate::link::Link;
use crate::report::LinkState;
use crate::units::{Rpm, Throttle};
use embassy_time::{Duration, Instant};

/// Longest wait of a start for other engines of the group.
const START_WAIT_MAX: Duration = Duration::from_secs(180);
/// Time that all sources get to be received before a stream of standby is obeyed, while it is not known which source was in
/// control.
const LISTEN_TO_SOURCES: Duration = Duration::from_secs(1);

impl Engine {
    pub(super) fn execute(
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
                self.sources.command(now, origin, Intent::Nothing);
                self.use_up(origin);
                Ok(self.sources.above(now, origin).map_or(Accepted::InForce, Accepted::Behind))
            }
            Command::ShutDown => self.shut_down(now, origin),
            Command::Standby => self.on_standby(now, origin),
            Command::Run(demand) => self.on_run(now, demand, origin, others_allow_start),
            Command::HandOverToPwm => self.on_hand_over(now, origin, others_allow_start),
            Command::Service(service) => self.service(now, service, origin),
        }
    }

    /// Arms the engine. After an emergency stop a source that keeps commanding "arm" has to disarm first.
    fn arm(&mut self, origin: Origin) -> Result<Accepted, Rejected> {
        self.arm_commanded.insert(origin);
        if matches!(self.mode, Mode::Stop(_)) {
            self.must_disarm.insert(origin);
            return Err(Rejected::StopLatched);
        }
        if self.must_disarm.contains(origin) {
            return Err(Rejected::DisarmFirst);
        }
        if !core::mem::replace(&mut self.armed, true) {
            self.event(Event::Armed(true, origin));
        }
        Ok(Accepted::InForce)
    }

    /// Disarms. Ends a start that has not reached running, never a running engine.
    fn disarm(&mut self, now: Instant, origin: Origin) {
        self.arm_commanded.remove(origin);
        self.must_disarm.remove(origin);
        if core::mem::replace(&mut self.armed, false) {
            self.event(Event::Armed(false, origin));
            self.close_pump_again();
        }
        self.permitted = Origins::NONE;
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

    /// Shuts the engine down at once, whatever the streams of other sources command.
    fn shut_down(&mut self, now: Instant, origin: Origin) -> Result<Accepted, Rejected> {
        if matches!(self.mode, Mode::Stop(_)) {
            return Err(Rejected::StopLatched);
        }
        self.sources.forget_runs();
        self.standby(now, origin);
        self.failed = false;
        Ok(Accepted::InForce)
    }

    fn on_standby(&mut self, now: Instant, origin: Origin) -> Result<Accepted, Rejected> {
        // It takes two commands to shut down an engine that runs or may run.
        let needs_two = match &self.mode {
            Mode::Run(Run { life, .. }) | Mode::Pwm { life, .. } => life.reached(),
            Mode::Listen(_) => true,
            Mode::Stop(_) | Mode::Standby => false,
        };
        let outcome = self.sources.standby(now, origin, needs_two);
        if matches!(self.mode, Mode::Stop(_)) {
            return Err(Rejected::StopLatched);
        }
        if !outcome.counts {
            return Ok(Accepted::RepeatStandby);
        }
        if outcome.changed {
            self.permitted = Origins::NONE;
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
            // The source that handed the engine over takes it back.
            Mode::Pwm { .. } if origin == self.ordered.origin => self.standby(now, origin),
            // Any source ends it before the engine runs; afterwards only a higher one.
            Mode::Pwm { life, .. }
                if above.is_none()
                    && (!life.reached()
                        || in_control && origin.priority() > self.ordered.origin.priority()) =>
            {
                self.standby(now, origin);
            }
            // A source that was lost may also end the start, with one command.
            Mode::Run(Run { life, .. }) if above.is_none() && !life.reached() => self.standby(now, origin),
            // Arbitration decides whether it is obeyed, as for every command.
            Mode::Run(_) => self.update(now),
            _ => {}
        }
        if let Some(above) = above {
            self.permit_in_standby(origin);
            return Ok(Accepted::Behind(above));
        }
        // Standby closes the pump, but a service command that was just given is sent once.
        if !self.link.service_frames().command {
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

    /// Whether all sources had time to be received since the node started.
    fn settled(&self, now: Instant) -> bool {
        now >= self.started + LISTEN_TO_SOURCES
    }

    /// Whether a higher source was in control before the order ended. The standby of a lower source is obeyed only when that
    /// source has been lost for as long as it takes to end its run.
    fn run_of_a_higher_one(&self, now: Instant, origin: Origin) -> bool {
        let Mode::Listen(finding) = &self.mode else { return false };
        // Without a known source any but the highest may be the lower one, unless the record has a start: any source may end it.
        let unknown = finding.active_source == Origin::Node && (finding.ran || finding.started.is_none());
        let active_source = if unknown { Origin::SOURCES[0] } else { finding.active_source };
        if active_source.priority() <= origin.priority() {
            return false;
        }
        let lost_at =
            self.sources.silent_from(active_source).map_or(finding.since, |from| from.max(self.started));
        let lost_for = self.in_stages_of_loss(finding.lost_for).as_ticks();
        let after = self.config.loss.hold + self.config.loss.lower_standby_after;
        let left = Duration::from_ticks(after.as_ticks().saturating_sub(lost_for));
        lost_at.checked_add(left).is_none_or(|at| now < at)
    }

    fn permit_in_standby(&mut self, origin: Origin) {
        if matches!(self.mode, Mode::Standby) {
            self.permit(origin);
        }
    }

    fn on_run(
        &mut self,
        now: Instant,
        demand: Demand,
        origin: Origin,
        others_allow_start: bool,
    ) -> Result<Accepted, Rejected> {
        let commanded = demand;
        let demand = self.clamp(demand);
        let can = self.can(now, demand);
        match can {
            Ok(()) => {
                if self.sources.was_deferred(origin)
                    && let Mode::Run(run) = &mut self.mode
                {
                    run.shaper.rise();
                }
                self.sources.command(now, origin, Intent::Run(demand));
            }
            // The ECU has not reported its version yet, or no shaft speed: the source is present, and its run stays.
            Err(Rejected::NeedsVersion { known: None, .. } | Rejected::RpmNotKnown) => {
                self.sources.defer_run(now, origin, demand);
            }
            Err(_) => {}
        }
        let result = match &self.mode {
            Mode::Stop(_) => Err(Rejected::StopLatched),
            Mode::Listen(_) if self.link.status().state == LinkState::Lost => Err(Rejected::NoLink),
            Mode::Listen(_) => Err(Rejected::Listening),
            // A demand that the ECU cannot follow changes nothing, not even the source's previous command.
            _ if can.is_err() => Err(can.err().unwrap_or(Rejected::NotSupported)),
            Mode::Run(_) => {
                // Arbitration decides whose demand is in force.
                self.update(now);
                let in_control = self.sources.in_control(now, origin);
                let in_force = matches!(&self.mode, Mode::Run(run) if run.active_source == origin && run.fail_safe_at.is_none());
                return Ok(match self.sources.above(now, origin) {
                    Some(above) => Accepted::Behind(above),
                    None if in_force && in_control => Accepted::InForce,
                    None => Accepted::Held,
                });
            }
            // Of a stick that is up, the clamped demand may be at idle.
            Mode::Standby | Mode::Pwm { .. } => self.try_start(now, origin, others_allow_start, |engine| {
                engine.interlocks(now, commanded, others_allow_start, Err)
            }),
        };
        match result {
            Ok(Accepted::InForce) => {
                self.begin(now, demand, origin, Beginning::FromStandby);
                self.update(now);
            }
            Ok(Accepted::StartWaits) => {}
            // A refused run must not start the engine later.
            _ => {
                if matches!(result, Err(Rejected::Start(Interlock::PumpOpen))) {
                    self.close_pump_again();
                }
                self.use_up(origin);
            }
        }
        result
    }

    /// Whether a command starts the engine now. `InForce`: it does.
    fn try_start(
        &mut self,
        now: Instant,
        origin: Origin,
        others_allow_start: bool,
        interlocks: impl FnOnce(&Self) -> Result<(), Interlock>,
    ) -> Result<Accepted, Rejected> {
        if let Some(above) = self.sources.above(now, origin) {
            return Ok(Accepted::Behind(above));
        }
        // A source that has just returned is not in control yet: it neither moves nor starts an engine.
        if !self.sources.in_control(now, origin) {
            return Ok(Accepted::Held);
        }
        if !matches!(self.mode, Mode::Standby) {
            return Err(Rejected::StandbyFirst);
        }
        if !self.permitted.contains(origin) {
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
            Err(interlock) => Err(self.refusal(interlock, origin)),
        }
    }

    /// A hand-over to the ECU's PWM input counts as a start.
    fn on_hand_over(
        &mut self,
        now: Instant,
        origin: Origin,
        others_allow_start: bool,
    ) -> Result<Accepted, Rejected> {
        // It does not wait for another engine, and a refusal uses the permission up.
        let result = self.try_hand_over(now, origin, others_allow_start).and_then(|()| self.order_pwm(now));
        if result.is_err() {
            self.use_up(origin);
        }
        result?;
        self.permitted = Origins::NONE;
        self.hand_over(Life::ordered(), Some(now + self.start_time()), origin);
        self.last_start = Some(now);
        Ok(Accepted::InForce)
    }

    /// Whether a command hands the engine over now.
    fn try_hand_over(&self, now: Instant, origin: Origin, others_allow_start: bool) -> Result<(), Rejected> {
        match self.mode {
            Mode::Stop(_) => return Err(Rejected::StopLatched),
            Mode::Listen(_) => return Err(Rejected::Listening),
            Mode::Standby | Mode::Run(_) | Mode::Pwm { .. } => {}
        }
        if let Some(above) = self.sources.above(now, origin) {
            return Err(Rejected::Behind(above));
        }
        // A source that was lost has to stream standby again until it is in control.
        let permitted = self.sources.in_control(now, origin)
            && matches!(self.mode, Mode::Standby)
            && self.permitted.contains(origin);
        if !permitted {
            return Err(Rejected::StandbyFirst);
        }
        let idle = Demand::Throttle(Throttle::IDLE);
        self.interlocks(now, idle, others_allow_start, Err)
            .map_err(|interlock| self.refusal(interlock, origin))
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
            // After a gap it may be another ECU, which may take the command for a different one.
            self.steady_link(now).map_err(Rejected::Start)?;
        }
        if service.closes_pump() && self.pump.is_some() {
            self.close_pump();
            return Ok(Accepted::InForce);
        }
        if !service.moves_fuel() {
            self.link.service(now, service)?;
            return Ok(Accepted::InForce);
        }
        let until = self.fuel_service_ends(now, origin);
        if now >= until {
            return Err(Rejected::ServiceTime);
        }
        self.link.service(now, service)?;
        self.pump = Some(OpenPump { origin, last_rx: now, until });
        Ok(Accepted::InForce)
    }

    /// End of a service that moves fuel or heats: a stream of them has one time, from its first command on. It ends with a
    /// pause that is longer than the source's timeout, but not while the pump is open.
    fn fuel_service_ends(&mut self, now: Instant, origin: Origin) -> Instant {
        let timeout = self.config.timeouts.of(origin);
        let open = self.pump.is_some();
        let since = self.fuel_service.filter(|before| open || now < before.last_rx + timeout);
        let since = since.map_or(now, |before| before.since);
        self.fuel_service = Some(FuelService { since, last_rx: now });
        since + self.config.service_time
    }

    /// Fuel and heat need a cold engine in standby, armed.
    fn require_cold(&self) -> Result<(), Rejected> {
        if !self.armed {
            return Err(Rejected::Start(Interlock::NotArmed));
        }
        let state = EngineState::of(self.at, self.link.status().state, &self.link.status().report);
        // An ECU that reports "stopped" may be one that does not receive our commands.
        if !matches!(self.mode, Mode::Standby) || state != EngineState::Standby {
            return Err(Rejected::Start(Interlock::NotStandby));
        }
        self.cold(self.at).map_err(Rejected::Start)
    }

    /// Clamps a demand to the engine's maximum. Reports it once, until a demand is within it again.
    fn clamp(&mut self, demand: Demand) -> Demand {
        let Demand::Rpm(rpm) = demand else { return demand };
        let own = self
            .link
            .status()
            .report
            .max_rpm
            .map(|max| max.value)
            .filter(|_| self.link.speed_control().is_ok());
        // The governor's maximum does not apply while the ECU has not reported its version.
        let waits = self.waits_for_version();
        let governed = self.config.governor.filter(|_| !waits).map(|governor| governor.max_rpm);
        let max = own.or(governed).filter(|max| rpm > *max);
        let reported = core::mem::replace(&mut self.clamp_reported, max.is_some());
        match max {
            Some(max) => {
                if !reported {
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
        // Releasing to standby starts nothing, so an old phase does not prevent it: an AMT error set carries none.
        if state::current_phase(now, &self.link.status().report).is_some() {
            self.require_stopped()?;
        }
        self.standby(now, origin);
        Ok(Accepted::InForce)
    }

    /// Whether the ECU, or the governor for it, can follow this demand.
    fn can(&self, now: Instant, demand: Demand) -> Result<(), Rejected> {
        let Demand::Rpm(_) = demand else { return Ok(()) };
        match self.link.speed_control() {
            Err(why) => {
                // An ECU that came back has not reported its version yet: an rpm in force stays allowed.
                let in_force =
                    matches!(&self.mode, Mode::Run(run) if run.demand.is_rpm() && run.life.reached());
                if in_force && matches!(why, Rejected::NeedsVersion { known: None, .. }) {
                    return Ok(());
                }
                let Some(governor) = self.config.governor else { return Err(why) };
                // A governor in use handles old speeds itself: they must not cost the source its control.
                let at_work = matches!(&self.mode, Mode::Run(run) if run.demand.is_rpm());
                let known = self.link.status().report.rpm.is_some_and(|rpm| rpm.age(now) <= governor.max_age);
                if at_work || known { Ok(()) } else { Err(Rejected::RpmNotKnown) }
            }
            Ok(()) => Ok(()),
        }
    }

    /// The interlocks of a start, in their order. `unmet` gets each that is not satisfied and returns whether the next is checked.
    fn interlocks(
        &self,
        now: Instant,
        demand: Demand,
        others_allow_start: bool,
        mut unmet: impl FnMut(Interlock) -> Result<(), Interlock>,
    ) -> Result<(), Interlock> {
        let rules = &self.config.start;
        let report = &self.link.status().report;
        if rules.arming && !self.armed {
            unmet(Interlock::NotArmed)?;
        }
        if !self.is_idle(demand) {
            unmet(Interlock::NotIdle)?;
        }
        self.steady_link(now).or_else(&mut unmet)?;
        if self.pump_may_be_open() {
            unmet(Interlock::PumpOpen)?;
        }
        if report.is_faulty() {
            unmet(Interlock::Fault)?;
        }
        if EngineState::of(now, LinkState::Up, report) != EngineState::Standby {
            unmet(Interlock::NotStandby)?;
        }
        self.cold(now).or_else(&mut unmet)?;
        if let (Some(least), Some(supply)) = (rules.supply_min, self.supply().map(|supply| supply.value))
            && supply < least
        {
            unmet(Interlock::SupplyLow(supply))?;
        }
        if let Some((limit, _)) = self.limits.in_force(&self.config.limits) {
            unmet(Interlock::Limit(limit))?;
        }
        if !others_allow_start {
            unmet(Interlock::OtherStarting)?;
        }
        Ok(())
    }

    /// Everything that keeps a `Run` of this source from starting the engine now, in the order in which a refusal names the
    /// first. Nothing changes.
    pub fn start_refusals(
        &self,
        now: Instant,
        demand: Demand,
        origin: Origin,
        others_allow_start: bool,
        mut found: impl FnMut(Rejected),
    ) {
        match &self.mode {
            Mode::Stop(_) => found(Rejected::StopLatched),
            Mode::Listen(_) if self.link.status().state == LinkState::Lost => found(Rejected::NoLink),
            Mode::Listen(_) => found(Rejected::Listening),
            Mode::Standby | Mode::Run(_) | Mode::Pwm { .. } => {}
        }
        if let Err(why) = self.can(now, demand) {
            found(why);
        }
        if let Some(above) = self.sources.above(now, origin) {
            found(Rejected::Behind(above));
        }
        if !matches!(self.mode, Mode::Standby) || !self.permitted.contains(origin) {
            found(Rejected::StandbyFirst);
        }
        // Each is found, so there is no first one.
        let _ = self.interlocks(now, demand, others_allow_start, |interlock| {
            found(self.refusal(interlock, origin));
            Ok(())
        });
    }

    /// What a source has to do about an interlock: one that has to disarm first cannot just arm.
    fn refusal(&self, interlock: Interlock, origin: Origin) -> Rejected {
        match interlock {
            Interlock::NotArmed if self.must_disarm.contains(origin) => Rejected::DisarmFirst,
            interlock => Rejected::Start(interlock),
        }
    }

    /// Whether the ECU has been received without a gap for the configured time.
    fn steady_link(&self, now: Instant) -> Result<(), Interlock> {
        let time = self.config.start.link_stable;
        let stable = self.link.status().up_since.is_some_and(|since| now >= since + time);
        // A gap is decisive before it is a loss of the link.
        let steady = self.last_gap.is_none_or(|gap| gap.checked_add(time).is_some_and(|at| now >= at));
        let receiving = self.link.status().state == LinkState::Up && self.link.gap_at().is_some();
        if stable && steady && receiving { Ok(()) } else { Err(Interlock::Link) }
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

    /// Stores the last refusal of a source and returns the previous one.
    pub(super) fn note_rejection(&mut self, origin: Origin, why: Option<Rejected>) -> Option<Rejected> {
        let last = self.last_rejection.get_mut(usize::from(origin.priority()));
        last.and_then(|last| core::mem::replace(last, why))
    }
}
