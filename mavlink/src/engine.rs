//! One engine as MAVLink commands it: its switch, its demand source and its arming.
//!
//! Start and throttle are two roles of one source. An accepted start sets the *switch* to run; a stop, a failed start or
//! the end of a run sets it to stopped. The *demand source* carries only a demand: none of its values starts an engine or
//! means standby.

use crate::frame::Address;
use crate::ids::Ack;
use crate::refusal::Refusal;
use crate::settings::{DemandSource, EngineSettings};
use crate::vehicle::{Arming, Vehicle};
use embassy_time::{Duration, Instant};
use heapless::Vec;
use jetlink::channel::{Events, Setup, Source};
use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::Service;
use jetlink::engine::state::EngineState;
use jetlink::telemetry::Telemetry;
use jetlink::units::Throttle;

/// Time in which the same start from the same sender counts as a repeat.
const REPEAT: Duration = Duration::from_secs(5);
/// Longest age of the last heartbeat of the commanding system, where its heartbeats keep the order alive.
pub(crate) const HEARTBEAT_AGE: Duration = Duration::from_secs(5);
/// Time between two commands that keep MAVLink present, waiting or idling.
const REFRESH: Duration = Duration::from_millis(200);
/// Senders whose last start is remembered.
const SENDERS: usize = 4;
/// Commands that are recorded between two reads: a start takes three.
#[cfg(feature = "record")]
pub(crate) const RECORDED: usize = 16;
/// Longest time for which a held demand rises in one step.
const LONGEST_STEP: Duration = Duration::from_millis(100);

/// Position of the switch.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Switch {
    Stopped,
    /// A start waits for another engine.
    Waiting,
    Run,
    /// Found running: the demand source takes over when the vehicle is armed.
    Found,
}

#[derive(Clone, Copy, Debug)]
struct LastStart {
    from: Address,
    /// It was allowed while disarmed.
    while_disarmed: bool,
    at: Instant,
    ack: Ack,
    /// Highest confirmation of its copies, and when the last one was received.
    confirmation: u8,
    last_rx: Instant,
}

impl LastStart {
    /// Whether a start with this confirmation is a copy of it. A confirmation that does not rise is of another start, whose first copies were
    /// lost; but copies may overtake each other.
    fn is_repeated(&self, now: Instant, confirmation: u8) -> bool {
        now < self.at + REPEAT
            || confirmation > self.confirmation
            || confirmation > 0 && now < self.last_rx + REPEAT
    }
}

#[derive(Debug)]
pub(crate) struct Engine<'a> {
    pub source: Source<'a>,
    pub setup: Setup<'a>,
    /// Settings of the supervision, the link and the ECU, as the parameters have them.
    pub config: EngineConfig,
    pub settings: EngineSettings,
    pub events: Option<Events<'a>>,
    switch: Switch,
    /// The last demand of its source.
    demand: Option<(Throttle, Instant)>,
    /// Value to which the demand has risen since it was held at idle, and when.
    held: Option<(Throttle, Instant)>,
    /// System whose heartbeat keeps the order alive. Unknown after a reset: then any system that may command counts.
    ordered_by: Option<u8>,
    /// Source whose demand was in force last.
    run_by: Option<Origin>,
    /// The vehicle's arming was passed on, by this service or before a restart of the node.
    armed: bool,
    /// Its disarming was passed on, since then and since a stop: the library requires it before it lets MAVLink arm again.
    disarmed: bool,
    /// A start allowed while disarmed is in progress, and has armed the engine.
    armed_for_start: bool,
    /// Time of an emergency stop since which the vehicle has not been seen disarmed.
    must_disarm: Option<Instant>,
    /// That stop is latched, and was noted.
    stop_noted: bool,
    /// The last start of each sender.
    last_starts: Vec<LastStart, SENDERS>,
    /// The last stop, of any source.
    stopped_at: Option<Instant>,
    /// It was ordered to run, or its start waited, when that was last looked at.
    was_ordered: bool,
    /// Time of the next command that keeps MAVLink present, waiting or idling.
    refresh_at: Instant,
    /// Who waits for the end of a start, and on which port.
    pub progress: Option<(u8, Address)>,
    /// Time up to which its last start was in progress: disarmed counts towards standby from then on.
    starting_until: Instant,
    /// Commands since they were last taken.
    #[cfg(feature = "record")]
    pub commanded: Vec<Command, RECORDED>,
}

/// One engine for the service: the rights to command it as MAVLink and to set it up, and its settings.
#[derive(Debug)]
pub struct EngineParts<'a> {
    /// Its source, claimed with [`jetlink::command::Origin::Mavlink`].
    pub source: Source<'a>,
    /// The right to change its settings.
    pub setup: Setup<'a>,
    /// Its configuration, which its parameters change.
    pub config: EngineConfig,
    /// Its settings of MAVLink.
    pub settings: EngineSettings,
}

/// The situation outside the engine.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Situation<'a> {
    pub now: Instant,
    pub vehicle: &'a Vehicle,
    /// Systems that may command, with their last heartbeat.
    pub received: &'a [(u8, Instant)],
}

impl Situation<'_> {
    fn is_received(&self, system: u8) -> bool {
        self.received.iter().any(|&(other, at)| other == system && self.now < at + HEARTBEAT_AGE)
    }

    fn anybody_is_received(&self) -> bool {
        self.received.iter().any(|&(_, at)| self.now < at + HEARTBEAT_AGE)
    }
}

impl<'a> Engine<'a> {
    #[inline(never)]
    pub fn new(parts: EngineParts<'a>) -> Self {
        let EngineParts { source, setup, config, settings } = parts;
        let events = source.handle().events();
        let armed = source.has_armed();
        Self {
            source,
            setup,
            config,
            settings,
            events,
            switch: Switch::Stopped,
            demand: None,
            held: None,
            ordered_by: None,
            run_by: None,
            armed,
            armed_for_start: false,
            disarmed: false,
            must_disarm: None,
            stop_noted: false,
            last_starts: Vec::new(),
            stopped_at: None,
            was_ordered: false,
            refresh_at: Instant::MIN,
            progress: None,
            starting_until: Instant::MIN,
            #[cfg(feature = "record")]
            commanded: Vec::new(),
        }
    }

    pub fn name(&self) -> &'static str {
        self.source.handle().name()
    }

    /// Commands the engine.
    fn command(&mut self, command: Command) -> Result<Accepted, Rejected> {
        // Commands that nobody takes are lost.
        #[cfg(feature = "record")]
        let _ = self.commanded.push(command);
        self.source.command(command)
    }

    pub fn telemetry(&self) -> Telemetry {
        self.source.handle().telemetry()
    }

    /// Result of the start that somebody waits for; `None`: it has not ended.
    pub fn start_ended(&self) -> Option<Ack> {
        match (self.switch, self.telemetry().state) {
            (Switch::Stopped, _) if self.stopped_at >= Some(self.starting_until) => Some(Ack::Cancelled),
            (Switch::Stopped, _) => Some(Ack::Failed),
            (_, EngineState::Running) => Some(Ack::Accepted),
            _ => None,
        }
    }

    /// Whether its switch is at run.
    pub fn is_at_run(&self) -> bool {
        self.switch != Switch::Stopped
    }

    /// Changes its settings. What its demand source has sent so far may be that of another source now.
    pub fn configure(&mut self, settings: EngineSettings) {
        self.settings = settings;
        self.forget_demand();
    }

    /// Forgets the last demand: no start is judged by it.
    pub const fn forget_demand(&mut self) {
        self.demand = None;
    }

    /// Takes a demand of its demand source. Each is passed on at once, so that the engine sees how old it is.
    pub fn take_demand(&mut self, situation: Situation<'_>, throttle: Throttle) -> Option<Refusal> {
        self.demand = Some((throttle, situation.now));
        if matches!(self.switch, Switch::Run | Switch::Waiting) {
            self.pass_on(situation, throttle)
        } else {
            None
        }
    }

    /// Passes a demand on: idle while the vehicle is disarmed. During a start the engine itself stays at idle, and then rises at its rate.
    /// While a start waits, a demand above idle ends it there, unless it is a relight: that begins at idle, whatever the stream has.
    fn pass_on(&mut self, situation: Situation<'_>, throttle: Throttle) -> Option<Refusal> {
        let held = match situation.vehicle.arming() {
            Arming::Disarmed => Some(Throttle::IDLE),
            // It may have been held at idle since before the restart, or it may be flying: the demand in force stays, and does
            // not rise.
            Arming::Unknown if situation.vehicle.may_show_disarmed(situation.now) => {
                Some(self.held.map_or_else(|| self.ordered_throttle(), |(held, _)| held))
            }
            _ => None,
        };
        let relights = self.switch == Switch::Waiting && self.settings.relight;
        let held = if relights { Some(Throttle::IDLE) } else { held };
        let throttle = self.hold(situation.now, throttle, held);
        self.refresh_at = situation.now + REFRESH;
        match self.command(Command::Run(Demand::Throttle(throttle))) {
            Ok(Accepted::InForce) if self.switch == Switch::Waiting => {
                self.switch = Switch::Run;
                None
            }
            // The run has ended, and a stream does not start one.
            Err(Rejected::StandbyFirst | Rejected::StopLatched) => {
                self.switch = Switch::Stopped;
                None
            }
            Err(why) if self.switch == Switch::Waiting => {
                self.switch = Switch::Stopped;
                Some(why.into())
            }
            _ => None,
        }
    }

    /// The throttle that the engine is ordered to; idle without one.
    fn ordered_throttle(&self) -> Throttle {
        match self.telemetry().ordered.order {
            Order::Run(Demand::Throttle(throttle)) | Order::Doubt(Demand::Throttle(throttle)) => throttle,
            _ => Throttle::IDLE,
        }
    }

    /// Limits the demand to this while it is held; then it rises at the engine's rate to the demand of its source.
    fn hold(&mut self, now: Instant, throttle: Throttle, held: Option<Throttle>) -> Throttle {
        if let Some(most) = held {
            self.held = Some((most, now));
            return throttle.min(most);
        }
        let Some((from, at)) = self.held else { return throttle };
        // The demand does not rise during a gap in the stream.
        let elapsed = now.saturating_duration_since(at).min(LONGEST_STEP).as_micros();
        let rise = elapsed * u64::from(self.config.supervision.rise) / 1_000_000;
        let most = u16::try_from(rise).unwrap_or(u16::MAX).saturating_add(from.tenths());
        if throttle.tenths() <= most {
            self.held = None;
            return throttle;
        }
        // Below the demand, so it is a valid throttle. A rise of less than 0.1 % waits for the next frame.
        let raised = Throttle::from_tenths(most).unwrap_or(from);
        if raised > from {
            self.held = Some((raised, now));
        }
        raised
    }

    /// Starts the engine: standby and run of this source in one step, judged once.
    pub fn start(
        &mut self,
        situation: Situation<'_>,
        from: Address,
        confirmation: u8,
        while_disarmed: bool,
    ) -> Result<(), (Ack, Option<Refusal>)> {
        let now = situation.now;
        // Another source may have stopped the engine since the last update.
        self.follow(situation, &self.telemetry());
        let refused = |why: Refusal| Err((why.ack(), Some(why)));
        // It was sent before the stop, and its first copy was lost.
        if confirmation > 0 && self.stopped_at.is_some_and(|at| now < at + REPEAT) {
            return refused(Refusal::Stopped);
        }
        let mut last = self.last_starts.iter_mut();
        let last = last.find(|last| last.from == from && last.while_disarmed == while_disarmed);
        if let Some(last) = last.filter(|last| last.is_repeated(now, confirmation)) {
            last.confirmation = last.confirmation.max(confirmation);
            last.last_rx = now;
            return match last.ack {
                _ if self.stopped_at.is_some_and(|at| at >= last.at) => refused(Refusal::Stopped),
                Ack::Accepted if self.switch != Switch::Stopped => Err((Ack::Accepted, None)),
                Ack::Accepted => refused(Refusal::HasEnded),
                ack => Err((ack, Some(Refusal::Repeated))),
            };
        }
        // It may be a copy of a start from before the stop, of which another one has taken the place here.
        if self.last_starts.iter().any(|last| self.stopped_at >= Some(last.at) && now < last.at + REPEAT) {
            return refused(Refusal::Stopped);
        }
        let answer = self.try_start(situation, from, while_disarmed);
        let ack = match answer {
            Ok(()) => Ack::Accepted,
            Err(why) => why.ack(),
        };
        self.note_start(LastStart { from, while_disarmed, at: now, ack, confirmation, last_rx: now });
        answer.map_err(|why| (ack, Some(why)))
    }

    fn note_start(&mut self, start: LastStart) {
        if let Some(last) = self.last_starts.iter_mut().find(|last| last.from == start.from) {
            *last = start;
        } else if let Err(start) = self.last_starts.push(start)
            && let Some(oldest) = self.last_starts.iter_mut().min_by_key(|last| last.at)
        {
            *oldest = start;
        }
    }

    fn try_start(
        &mut self,
        situation: Situation<'_>,
        from: Address,
        while_disarmed: bool,
    ) -> Result<(), Refusal> {
        if self.switch != Switch::Stopped {
            return Err(Refusal::AlreadyRuns);
        }
        if self.settings.demand_source() == DemandSource::None {
            if !situation.is_received(from.system) {
                return Err(Refusal::NoHeartbeat);
            }
        } else {
            let timeout = self.config.supervision.timeouts.mavlink;
            match self.demand {
                Some((throttle, at)) if situation.now < at + timeout => {
                    if throttle > self.config.supervision.start.idle_band && !self.settings.relight {
                        return Err(Refusal::NotIdle);
                    }
                }
                _ => return Err(Refusal::NoDemand),
            }
        }
        let armed = situation.vehicle.arming() == Arming::Armed;
        if armed && self.must_disarm.is_some() {
            return Err(Refusal::ArmedBeforeStop);
        }
        if !armed && !while_disarmed {
            return Err(Refusal::NotArmed);
        }
        // Nobody else commands in between: the start is judged by the order in force now.
        let mut armed_here = false;
        let answer = critical_section::with(|_| {
            let telemetry = self.telemetry();
            match telemetry.ordered.order {
                Order::Standby => {}
                Order::EmergencyStop => return Err(Rejected::StopLatched.into()),
                Order::Listen => return Err(Rejected::Listening.into()),
                Order::Run(_) | Order::Doubt(_) | Order::Pwm => return Err(Refusal::AlreadyRuns),
            }
            // An engine armed by another source stays armed by that source.
            if armed || !telemetry.armed {
                if !armed {
                    self.disarm_beside_others();
                    armed_here = true;
                }
                self.command(Command::Arm)?;
            }
            match self.command(Command::Standby)? {
                Accepted::InForce => {}
                Accepted::Behind(active) => return Err(Rejected::Behind(active).into()),
                _ => return Err(Refusal::NotInControl),
            }
            match self.command(Command::Run(Demand::Throttle(Throttle::IDLE)))? {
                Accepted::InForce => Ok(Switch::Run),
                Accepted::StartWaits => Ok(Switch::Waiting),
                Accepted::Behind(active) => Err(Rejected::Behind(active).into()),
                _ => Err(Refusal::NotInControl),
            }
        });
        match answer {
            Ok(switch) => {
                self.switch = switch;
                self.ordered_by = Some(from.system);
                self.refresh_at = situation.now + REFRESH;
                self.starting_until = situation.now;
                self.disarmed = false;
                self.armed |= armed;
                self.armed_for_start = armed_here;
                Ok(())
            }
            Err(why) => {
                if armed_here {
                    self.disarm();
                }
                Err(why)
            }
        }
    }

    /// Shuts the engine down at once, with cooling.
    pub fn stop(&mut self, now: Instant) -> Result<(), Refusal> {
        self.switch = Switch::Stopped;
        self.stopped_at = Some(now);
        match self.command(Command::ShutDown) {
            // A latched emergency stop includes this.
            Ok(_) | Err(Rejected::StopLatched) => Ok(()),
            Err(why) => Err(why.into()),
        }
    }

    /// Stops the engine at once, without cooling. Latched.
    pub fn emergency_stop(&mut self, now: Instant) {
        self.switch = Switch::Stopped;
        // It is never refused.
        let _ = self.command(Command::EmergencyStop);
        self.note_emergency_stop(now);
    }

    /// The library has disarmed the engine, and retains over resets that MAVLink has to disarm before it arms.
    fn note_emergency_stop(&mut self, now: Instant) {
        (self.armed, self.armed_for_start, self.disarmed) = (false, false, false);
        (self.must_disarm, self.stop_noted, self.stopped_at) = (Some(now), true, Some(now));
    }

    /// Releases an emergency stop.
    pub fn release(&mut self) -> Result<(), Refusal> {
        self.command(Command::ReleaseStop)?;
        Ok(())
    }

    /// Passes a service command on.
    pub fn service(&mut self, service: Service) -> Result<(), Refusal> {
        self.command(Command::Service(service))?;
        Ok(())
    }

    fn disarm(&mut self) {
        (self.armed, self.armed_for_start, self.disarmed) = (false, false, true);
        // It is never refused.
        let _ = self.command(Command::Disarm);
    }

    /// Disarms if no source has armed the engine: otherwise it would act against that source.
    fn disarm_beside_others(&mut self) {
        if !self.disarmed && !self.telemetry().armed {
            self.disarm();
        }
    }

    /// The vehicle was armed and now reports disarmed: a start in progress ends, however it was allowed.
    pub fn vehicle_disarmed(&mut self) {
        self.disarm();
    }

    /// Acts without a command: arms, takes over an engine found running, keeps an order alive or MAVLink present. Call it
    /// ten times a second or more often. Returns why a waiting start was refused.
    pub fn update(&mut self, situation: Situation<'_>) -> Option<Refusal> {
        let telemetry = self.telemetry();
        self.follow(situation, &telemetry);
        self.arm(situation, &telemetry);
        // Not against a higher source that flies the engine, and not one that was found and is left alone.
        let is_ours = telemetry.active_source.priority() <= Origin::Mavlink.priority();
        if is_ours && self.switch == Switch::Run {
            if telemetry.start_by.is_some() {
                self.starting_until = situation.now;
            }
            let disarmed = situation.vehicle.disarmed_for(situation.now, self.starting_until);
            let standby = self.settings.disarmed_standby.zip(disarmed);
            if standby.is_some_and(|(after, disarmed)| disarmed >= after) {
                // Never refused but in an emergency stop.
                let _ = self.stop(situation.now);
            }
        }
        if self.idles_disarmed(situation, &telemetry) {
            return self.pass_on(situation, Throttle::IDLE);
        }
        if situation.now < self.refresh_at {
            return None;
        }
        match self.switch {
            // Present, but without a command: when the start comes, this source has been received without a gap.
            Switch::Stopped if telemetry.ordered.order == Order::Listen => None,
            Switch::Stopped => {
                self.refresh_at = situation.now + REFRESH;
                let _ = self.command(Command::Present);
                None
            }
            Switch::Found => None,
            Switch::Waiting | Switch::Run => {
                let alive = self.settings.demand_source() == DemandSource::None
                    && self.ordered_by.map_or_else(
                        || situation.anybody_is_received(),
                        |system| situation.is_received(system),
                    );
                if alive { self.pass_on(situation, Throttle::IDLE) } else { None }
            }
        }
    }

    /// Whether idle has to be passed on without the stream, until it is in force: a vehicle that is received and disarmed holds its engine
    /// at idle, not at the throttle of a lost source.
    fn idles_disarmed(&self, situation: Situation<'_>, telemetry: &Telemetry) -> bool {
        let vehicle = situation.vehicle;
        self.switch == Switch::Run
            && vehicle.arming() == Arming::Disarmed
            && vehicle.is_received(situation.now)
            && telemetry.active_source == Origin::Mavlink
            && situation.now >= self.refresh_at
            && self.ordered_throttle() > Throttle::IDLE
    }

    /// Sets the switch to match the engine's order.
    fn follow(&mut self, situation: Situation<'_>, telemetry: &Telemetry) {
        let runs = matches!(telemetry.ordered.order, Order::Run(_) | Order::Doubt(_));
        // Any source may have commanded it.
        if telemetry.stop_latched && !self.stop_noted {
            self.note_emergency_stop(situation.now);
        }
        self.stop_noted &= telemetry.stop_latched;
        let is_ordered = matches!(telemetry.ordered.order, Order::Run(_) | Order::Doubt(_) | Order::Pwm)
            || telemetry.start_waits_until.is_some();
        let has_ended = core::mem::replace(&mut self.was_ordered, is_ordered)
            && telemetry.ordered.order == Order::Standby;
        // What MAVLink stops is noted there; what the node ends is not a stop.
        if has_ended && !is_ordered && !matches!(telemetry.ordered.origin, Origin::Node | Origin::Mavlink) {
            self.stopped_at = Some(situation.now);
        }
        match telemetry.ordered.order {
            Order::Run(_) | Order::Doubt(_) if telemetry.active_source != Origin::Node => {
                self.run_by = Some(telemetry.active_source);
            }
            // Its order was given up. It may be found running again.
            Order::Run(_) | Order::Doubt(_) | Order::Listen => {}
            _ => self.run_by = None,
        }
        match self.switch {
            Switch::Run | Switch::Found if !runs => self.switch = Switch::Stopped,
            // The library has given up the wait.
            Switch::Waiting if telemetry.start_waits_until.is_none() => {
                self.switch = if runs { Switch::Run } else { Switch::Stopped };
            }
            Switch::Stopped if runs => match telemetry.active_source {
                // Ours from before a reset.
                Origin::Mavlink => self.switch = Switch::Run,
                Origin::Node if self.run_by.is_none_or(|origin| origin == Origin::Mavlink) => {
                    self.switch = Switch::Found;
                }
                _ => {}
            },
            _ => {}
        }
        if self.switch == Switch::Found && situation.vehicle.arming() == Arming::Armed {
            self.switch = Switch::Run;
        }
    }

    fn start_is_over(&self, telemetry: &Telemetry) -> bool {
        telemetry.start_by.is_none() && self.switch != Switch::Waiting
    }

    /// Passes the vehicle's arming on. Not inlined: the image is smaller.
    #[inline(never)]
    fn arm(&mut self, situation: Situation<'_>, telemetry: &Telemetry) {
        let vehicle = situation.vehicle;
        if self.armed_for_start && self.start_is_over(telemetry) {
            self.armed_for_start = false;
            if vehicle.arming() != Arming::Armed {
                self.disarm();
            }
        }
        match vehicle.arming() {
            Arming::Armed => {
                self.disarmed = false;
                if !self.armed && self.must_disarm.is_none() && !telemetry.stop_latched {
                    self.armed = self.command(Command::Arm).is_ok();
                }
            }
            Arming::Disarmed => {
                // It has to report that after the stop.
                if self.must_disarm.is_some_and(|stop| vehicle.last_shown() > Some(stop)) {
                    self.must_disarm = None;
                }
                if self.armed {
                    self.disarm();
                }
                critical_section::with(|_| self.disarm_beside_others());
            }
            Arming::Unknown => {}
        }
    }

    /// Whether its ECU reports it at rest, and nothing is ordered. An engine that is not received may be turning.
    pub fn is_known_at_rest(&self) -> bool {
        self.telemetry().state.is_stopped() && !self.turns()
    }

    /// Whether it turns or is ordered to, or its start waits.
    pub fn turns(&self) -> bool {
        self.telemetry().turns() || self.is_at_run()
    }
}
