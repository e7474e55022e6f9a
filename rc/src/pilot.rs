//! One engine as radio control commands it: its stick, its switch, and what they mean.
//!
//! The switch has three positions. *Stop* is an emergency stop, at every frame. *Standby* releases and arms, if the switch has
//! moved there from stop with the stick at idle. *Run allowed* starts, if the switch has moved there from standby with the
//! stick at idle and steady, and otherwise moves the throttle of an engine that is ordered to run.
//!
//! **Only a received movement is a move:** a position that is found at power-up or after a pause does not start, arm, release
//! or shut down anything. Stop is obeyed as a position; after a pause, once it has been held.
//!
//! Frames come in, commands go out: one at most for each frame, except for a stop or a release. Without frames there are no commands, and
//! the engine's stages of loss begin. Nothing here has a timer.

use crate::alternation::Alternation;
use crate::calibration::{Calibration, CalibrationError};
use crate::channels::Channels;
use crate::count::count;
use crate::position::{Position, Settled, is_on};
use crate::settings::{EngineSettings, SettingsError};
use embassy_time::{Duration, Instant};
use jetlink::channel::Source;
use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::report::LinkState;
use jetlink::telemetry::Telemetry;
use jetlink::units::{Rpm, Throttle};

/// Longest time between two frames that belong together.
const GAP: Duration = Duration::from_millis(200);
/// Time after a gap in which a position has to be held for longer.
const RETURN: Duration = Duration::from_secs(1);
/// Time for which a position has to be held after a gap until it is accepted.
const HOLD_RETURN: Duration = Duration::from_millis(300);
/// The same without a gap, for all positions but stop, which is accepted at once.
const HOLD: Duration = Duration::from_millis(60);
/// Time for which stop has to be received in all, where gaps of less than [`RETURN`] lie between its frames.
const HOLD_IN_ALL: Duration = Duration::from_millis(600);
/// Shortest pulse, in µs, of a throttle, and of a stop beside a throttle that cannot be read: a starting autopilot sends 881 µs on all its
/// outputs.
const DRIVEN: u16 = 900;
/// Distance below its end point, in µs, at which a shorter throttle pulse counts as not driven.
const NOT_DRIVEN: u16 = 10;
/// Time for which stick and switch have been steady before a start, an arming or a release.
const STEADY: Duration = Duration::from_millis(500);

/// Why a frame became no command.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Ignored {
    /// Radio control has no throttle channel for this engine.
    Off,
    /// A channel that the engine needs is silent.
    Silent,
    /// The throttle is too far beyond its end points, or goes up and down faster than a hand moves a stick.
    Throttle,
    /// A switch is between two positions.
    BetweenPositions,
    /// A position has not been held for long enough.
    Settling,
}

/// Result of a frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Outcome {
    /// No command.
    Ignored(Ignored),
    /// This command, and its answer.
    Commanded(Command, Result<Accepted, Rejected>),
    /// The switch moved to run, but the stick was not at idle, or stick or switch were not steady: no start.
    NotSteady,
    /// The switch moved to run, but the stored settings are damaged: no start.
    SettingsDamaged,
}

/// Counters of an engine's radio control. All wrap.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PilotCounters {
    /// Frames that became commands.
    pub commanded: u32,
    /// Frames with a silent channel.
    pub silent: u32,
    /// Frames with a throttle beyond its end points, or one that alternates.
    pub throttle_beyond: u32,
    /// Frames with a switch between two positions, or at one that had not been held.
    pub unclear: u32,
    /// Gaps between frames.
    pub gaps: u32,
    /// Starts that were refused.
    pub starts_refused: u32,
    /// Commands to arm.
    pub armings: u32,
}

/// A frame as this engine reads it.
#[derive(Clone, Copy, Debug)]
struct Reading {
    demand: Demand,
    idle: bool,
    /// `None` without a switch.
    position: Option<Position>,
    handed_over: bool,
}

/// Which parts of a frame are used.
#[derive(Clone, Copy, Debug)]
struct Settling {
    /// Position of the switch before the frame.
    before: Option<Position>,
    /// The position of the switch is used.
    position: bool,
    /// All of the frame is used.
    all: bool,
}

/// Frames with the switch at stop, whether the other channels can be read or not.
#[derive(Clone, Copy, Debug)]
struct HeldStop {
    /// The first one since a gap, and the last one.
    since: Instant,
    last: Instant,
    /// Time of all of them, without the gaps.
    in_all: Duration,
    /// A frame of another sender came after the last one.
    other: bool,
}

/// Radio control of one engine.
#[derive(Debug)]
pub struct Pilot<'a> {
    source: Source<'a>,
    idle_band: Throttle,
    settings: EngineSettings,
    switch: Settled<Position>,
    hand_over: Settled<bool>,
    /// The last frame that was read, and the first one since a gap.
    last: Option<Instant>,
    since: Instant,
    /// Time since which the stick has been at idle.
    idle_since: Option<Instant>,
    /// Time since which the switch has been at standby.
    standby_since: Option<Instant>,
    /// The switch moved from stop to standby: a stop is to be released, and the engine to be armed.
    release: bool,
    arm: bool,
    /// The switch moved from run to standby.
    shut_down: bool,
    /// The start of the last move waits for another engine.
    waits: bool,
    alternation: Alternation,
    held_stop: Option<HeldStop>,
    calibration: Option<Calibration>,
    /// The stored settings are damaged, and nobody has confirmed the present ones.
    damaged: bool,
    /// The switch was seen moving to its position.
    moved: bool,
    counters: PilotCounters,
}

impl<'a> Pilot<'a> {
    /// Radio control of the engine of this source, which was claimed with [`jetlink::command::Origin::Rc`].
    ///
    /// # Errors
    /// What is wrong with the settings.
    pub fn new(
        source: Source<'a>,
        config: &EngineConfig,
        settings: EngineSettings,
    ) -> Result<Self, SettingsError> {
        settings.check()?;
        Ok(Self {
            source,
            idle_band: config.supervision.start.idle_band,
            settings,
            switch: Settled::new(),
            hand_over: Settled::new(),
            last: None,
            since: Instant::from_ticks(0),
            idle_since: None,
            standby_since: None,
            release: false,
            arm: false,
            shut_down: false,
            waits: false,
            alternation: Alternation::NEW,
            held_stop: None,
            calibration: None,
            damaged: false,
            moved: false,
            counters: PilotCounters::default(),
        })
    }

    /// The settings.
    pub const fn settings(&self) -> &EngineSettings {
        &self.settings
    }

    /// The counters.
    pub const fn counters(&self) -> &PilotCounters {
        &self.counters
    }

    /// Changes the settings, while the engine is at rest.
    ///
    /// # Errors
    /// What is wrong with them, or that the engine turns.
    pub fn configure(&mut self, settings: EngineSettings) -> Result<(), SettingsError> {
        settings.check()?;
        if self.turns() {
            return Err(SettingsError::EngineTurns);
        }
        self.settings = settings;
        self.forget();
        Ok(())
    }

    /// Sets whether the stored settings are damaged. While they are, the engine is not started, as nobody may have chosen the present
    /// ones.
    pub const fn set_damaged(&mut self, damaged: bool) {
        self.damaged = damaged;
    }

    /// Begins a calibration of the stick. Until it ends, radio control commands nothing but a stop.
    ///
    /// # Errors
    /// The engine turns.
    pub fn begin_calibration(&mut self) -> Result<(), CalibrationError> {
        if self.turns() {
            return Err(CalibrationError::EngineTurns);
        }
        self.calibration = Some(Calibration::default());
        Ok(())
    }

    /// Ends the calibration, and takes the end points seen.
    ///
    /// # Errors
    /// There are no end points, or the engine turns. No setting has changed.
    pub fn end_calibration(&mut self) -> Result<(u16, u16), CalibrationError> {
        let calibration = self.calibration.take().ok_or(CalibrationError::NotBegun)?;
        if self.turns() {
            return Err(CalibrationError::EngineTurns);
        }
        let (low, high) = calibration.ends()?;
        (self.settings.low, self.settings.high) = (low, high);
        self.forget();
        Ok((low, high))
    }

    /// Whether its stick is being calibrated.
    pub(crate) const fn calibrates(&self) -> bool {
        self.calibration.is_some()
    }

    /// Ends a calibration without a result.
    pub(crate) const fn cancel_calibration(&mut self) {
        self.calibration = None;
    }

    /// Whether its engine turns, or is ordered to.
    pub(crate) fn turns(&self) -> bool {
        self.telemetry().turns()
    }

    fn telemetry(&self) -> Telemetry {
        self.source.handle().telemetry()
    }

    /// Forgets what was seen: a move that began before is ignored.
    const fn forget(&mut self) {
        self.last = None;
        (self.idle_since, self.standby_since) = (None, None);
        (self.release, self.arm, self.shut_down, self.waits) = (false, false, false, false);
        self.moved = false;
    }

    /// Takes the valid values of a frame.
    pub fn frame(&mut self, now: Instant, channels: &Channels) -> Outcome {
        let outcome = self.judge(now, channels);
        let counters = &mut self.counters;
        let counter = match outcome {
            Outcome::Commanded(..) => &mut counters.commanded,
            Outcome::NotSteady | Outcome::SettingsDamaged => &mut counters.starts_refused,
            Outcome::Ignored(Ignored::Silent) => &mut counters.silent,
            Outcome::Ignored(Ignored::Throttle) => &mut counters.throttle_beyond,
            Outcome::Ignored(Ignored::BetweenPositions | Ignored::Settling) => &mut counters.unclear,
            Outcome::Ignored(Ignored::Off) => return outcome,
        };
        count(counter);
        outcome
    }

    fn judge(&mut self, now: Instant, channels: &Channels) -> Outcome {
        let telemetry = self.telemetry();
        let throttle = channels.get(self.settings.throttle);
        let alternates = throttle.is_some_and(|pulse| self.alternation.see(now, pulse.us()));
        if let Some(calibration) = &mut self.calibration {
            if telemetry.turns() {
                self.calibration = None;
            } else if let Some(pulse) = throttle.filter(|pulse| pulse.us() >= DRIVEN && !alternates) {
                calibration.see(pulse);
            }
        }
        let stop_is_held = self.holds_stop(now, channels, alternates);
        let reading = match self.read(channels) {
            Ok(_) if alternates => return self.unless_stop(stop_is_held, Ignored::Throttle),
            Ok(reading) => reading,
            Err(why) => return self.unless_stop(stop_is_held, why),
        };
        let Settling { before, position, all } = self.settle(now, &reading);
        if position {
            self.note_moves(now, before, &reading);
        }
        if !all {
            return self.unless_stop(stop_is_held, Ignored::Settling);
        }
        let command = match reading.position {
            Some(Position::Stop) => return self.stop(),
            _ if self.calibration.is_some() => Command::Present,
            Some(Position::Standby) if telemetry.stop_latched && self.release && self.is_steady(now) => {
                return self.release();
            }
            _ if telemetry.stop_latched || reading.handed_over => Command::Present,
            position => match telemetry.ordered.order {
                Order::Standby => {
                    return self.in_standby(now, before, &reading, &telemetry);
                }
                Order::Run(_) | Order::Doubt(_) | Order::Listen if position != Some(Position::Standby) => {
                    // Without a switch radio control moves the throttle of an engine that runs, and nothing else.
                    if position.is_none() && telemetry.ordered.order == Order::Listen {
                        Command::Present
                    } else {
                        Command::Run(reading.demand)
                    }
                }
                _ if self.shut_down => Command::Standby,
                _ => Command::Present,
            },
        };
        self.command(command)
    }

    fn command(&self, command: Command) -> Outcome {
        Outcome::Commanded(command, self.source.command(command))
    }

    /// A frame that is ignored, unless stop is held: a broken stick, or a link with gaps, must not disable it.
    fn unless_stop(&mut self, stop_is_held: bool, why: Ignored) -> Outcome {
        if stop_is_held { self.stop() } else { Outcome::Ignored(why) }
    }

    /// Whether the switch has been at stop for long enough, whatever the other channels show. If two senders alternate, every second frame is
    /// enough.
    fn holds_stop(&mut self, now: Instant, channels: &Channels, alternates: bool) -> bool {
        let Some(pulse) = channels.get(self.settings.switch).filter(|_| self.settings.throttle != 0) else {
            // A silent switch has no other position.
            return false;
        };
        let at_stop = Position::of(pulse, &self.settings) == Some(Position::Stop) && pulse.us() >= DRIVEN;
        let passed = self.held_stop.map_or(Duration::MAX, |held| now.saturating_duration_since(held.last));
        if !at_stop {
            let held = self.held_stop.filter(|held| alternates && !held.other && passed <= GAP);
            self.held_stop = held.map(|held| HeldStop { other: true, ..held });
            return false;
        }
        let held = match self.held_stop {
            Some(held) if passed <= GAP => HeldStop { in_all: held.in_all + passed, ..held },
            Some(held) if passed < RETURN => HeldStop { since: now, ..held },
            _ => HeldStop { since: now, last: now, in_all: Duration::from_ticks(0), other: false },
        };
        self.held_stop = Some(HeldStop { last: now, other: false, ..held });
        now.saturating_duration_since(held.since) >= HOLD_RETURN || held.in_all >= HOLD_IN_ALL
    }

    fn read(&self, channels: &Channels) -> Result<Reading, Ignored> {
        let settings = &self.settings;
        if settings.throttle == 0 {
            return Err(Ignored::Off);
        }
        let pulse = channels.get(settings.throttle).ok_or(Ignored::Silent)?.us();
        // A calibration is still looking for the end points.
        let below = settings.low.saturating_sub(pulse);
        let above = pulse.saturating_sub(settings.high);
        let driven = pulse >= DRIVEN || below <= NOT_DRIVEN;
        if (below.max(above) > settings.beyond || !driven) && self.calibration.is_none() {
            return Err(Ignored::Throttle);
        }
        let position = match settings.switch {
            0 => None,
            number => {
                let pulse = channels.get(number).ok_or(Ignored::Silent)?;
                Some(Position::of(pulse, settings).ok_or(Ignored::BetweenPositions)?)
            }
        };
        let handed_over = match settings.hand_over {
            0 => false,
            number => {
                let pulse = channels.get(number).ok_or(Ignored::Silent)?;
                is_on(pulse).ok_or(Ignored::BetweenPositions)?
            }
        };
        let share = self.share(pulse);
        let throttle = Throttle::from_tenths(share).map_err(|_| Ignored::Throttle)?;
        let demand = match (settings.rpm_low, settings.rpm_high) {
            (Some(low), Some(high)) => {
                let range = u64::from(high.get().saturating_sub(low.get()));
                let above = u32::try_from(range * u64::from(share) / 1000).unwrap_or(u32::MAX);
                Demand::Rpm(Rpm::new(low.get().saturating_add(above)))
            }
            _ => Demand::Throttle(throttle),
        };
        Ok(Reading { demand, idle: throttle <= self.idle_band, position, handed_over })
    }

    /// Position of the stick in 0.1 %.
    fn share(&self, pulse: u16) -> u16 {
        let EngineSettings { low, high, reversed, .. } = self.settings;
        // `EngineSettings::check` keeps the end points apart.
        let range = u32::from(high.saturating_sub(low)).max(1);
        let above = u32::from(pulse.saturating_sub(low)).min(range);
        let above = if reversed { range - above } else { above };
        u16::try_from((above * 1000 + range / 2) / range).unwrap_or(0)
    }

    /// Debounces the switches, and notes since when the stick has been at idle.
    fn settle(&mut self, now: Instant, reading: &Reading) -> Settling {
        if self.last.is_none_or(|last| now.saturating_duration_since(last) > GAP) {
            if self.last.is_some() {
                count(&mut self.counters.gaps);
            }
            self.forget();
            self.since = now;
            self.switch.interrupt();
            self.hand_over.interrupt();
        }
        self.last = Some(now);
        self.idle_since = if reading.idle { self.idle_since.or(Some(now)) } else { None };
        let returns = now.saturating_duration_since(self.since) < RETURN;
        let hold = if returns { HOLD_RETURN } else { HOLD };
        let before = self.switch.get();
        let position = reading.position.is_none_or(|position| {
            let at_once = position == Position::Stop && !returns;
            let hold = if at_once { Duration::from_ticks(0) } else { hold };
            self.switch.see(now, position, hold)
        });
        let handed_over = self.hand_over.see(now, reading.handed_over, hold);
        // Only the stop is obeyed while it is not clear who has the throttle.
        let stop = reading.position == Some(Position::Stop);
        Settling { before, position, all: position && (handed_over || stop) }
    }

    /// Notes moves of the switch, and since when it has been at standby.
    fn note_moves(&mut self, now: Instant, before: Option<Position>, reading: &Reading) {
        let moved = before.filter(|before| Some(*before) != reading.position);
        // A position from before a gap does not begin a move.
        let in_sight = now.saturating_duration_since(self.since) >= RETURN;
        if moved.is_some() {
            self.moved = in_sight;
        }
        match (moved.filter(|_| in_sight), reading.position) {
            (Some(Position::Stop), Some(Position::Standby)) => (self.release, self.arm) = (true, true),
            (Some(Position::Run), Some(Position::Standby)) => self.shut_down = true,
            _ => {}
        }
        match reading.position {
            Some(Position::Standby) => self.standby_since = self.standby_since.or(Some(now)),
            // The move to run is judged in `in_standby`.
            Some(Position::Run) if before == Some(Position::Standby) => self.shut_down = false,
            _ => {
                self.standby_since = None;
                self.shut_down = false;
            }
        }
        if reading.position != Some(Position::Standby) {
            (self.release, self.arm) = (false, false);
        }
        // A hand-over that has not settled does not discard an order of the switch.
        if self.hand_over.get() == Some(true) {
            (self.shut_down, self.waits, self.arm) = (false, false, false);
        }
    }

    /// Whether the stick has been at idle, and the switch at standby, for long enough.
    fn is_steady(&self, now: Instant) -> bool {
        let steady = |since: Option<Instant>| {
            since.is_some_and(|since| now.saturating_duration_since(since) >= STEADY)
        };
        steady(self.idle_since) && steady(self.standby_since)
    }

    /// The switch is at stop: the stop latches, and a later arming begins from disarmed.
    fn stop(&mut self) -> Outcome {
        self.waits = false;
        let outcome = self.command(Command::EmergencyStop);
        // It is never refused.
        let _ = self.source.command(Command::Disarm);
        outcome
    }

    fn release(&mut self) -> Outcome {
        let outcome = self.command(Command::ReleaseStop);
        if let Outcome::Commanded(_, Ok(_)) = outcome {
            self.release = false;
        }
        outcome
    }

    /// Whether the ECU, or the governor, can follow this demand once the engine runs.
    fn is_followed(&self, demand: Demand) -> bool {
        let mut follows = true;
        self.source.handle().start_refusals(demand, Origin::Rc, |why| {
            follows &= !matches!(
                why,
                Rejected::NoSpeedControl | Rejected::NeedsVersion { .. } | Rejected::RpmNotKnown
            );
        });
        follows
    }

    /// The engine is ordered to standby.
    fn in_standby(
        &mut self,
        now: Instant,
        before: Option<Position>,
        reading: &Reading,
        telemetry: &Telemetry,
    ) -> Outcome {
        self.shut_down = false;
        let Reading { demand, idle, position, .. } = *reading;
        match position {
            None => return self.command(Command::Present),
            Some(Position::Run) => {
                // A position from before a gap does not begin a move.
                let in_sight = now.saturating_duration_since(self.since) >= RETURN;
                let moved = before == Some(Position::Standby) && in_sight;
                let steady = moved && self.is_steady(now);
                self.standby_since = None;
                self.waits &= telemetry.start_waits_until.is_some();
                if moved && !steady {
                    return Outcome::NotSteady;
                }
                if self.damaged && (steady || self.waits) {
                    self.waits = false;
                    return Outcome::SettingsDamaged;
                }
                if steady || self.waits {
                    // A stick at idle starts at idle throttle, whatever shaft speed it commands: not every engine's idle speed is
                    // known. But that speed is commanded next: if the engine cannot follow it, the start is refused for it.
                    let start = if idle && self.is_followed(demand) {
                        Demand::Throttle(Throttle::IDLE)
                    } else {
                        demand
                    };
                    let outcome = self.command(Command::Run(start));
                    self.waits = matches!(outcome, Outcome::Commanded(_, Ok(Accepted::StartWaits)));
                    if steady && matches!(outcome, Outcome::Commanded(_, Err(_))) {
                        count(&mut self.counters.starts_refused);
                    }
                    return outcome;
                }
            }
            Some(Position::Standby) if self.arm && self.is_steady(now) => {
                self.arm = false;
                count(&mut self.counters.armings);
                // Refused only while a stop is latched.
                let _ = self.source.command(Command::Arm);
            }
            _ => {}
        }
        // The node itself has ordered standby, in doubt, and does not know the state of the engine, which may be healthy. A position that was
        // found, or run, adds nothing: the order stays the node's own. Nothing can be started meanwhile.
        let in_doubt = telemetry.ordered.origin == Origin::Node && telemetry.link != LinkState::Up;
        let commanded = position == Some(Position::Standby) && self.moved;
        self.command(if in_doubt && !commanded { Command::Present } else { Command::Standby })
    }
}
