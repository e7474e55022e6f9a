//! One engine: commands from its sources in, one order to its ECU out.
//!
//! The rules here hold for every ECU; `docs/failsafe.md` has them as tables:
//!
//! - An emergency stop is latched until it is released with the engine stopped. It disarms.
//! - A source starts an engine with its own standby, then its own `Run` at idle, armed, with every interlock satisfied at
//!   that instant. The permission is used once, also by a refusal (`commands.rs`).
//! - A run belongs to one life of an engine (`life.rs`). While that life is in doubt, nothing is sent that could start an
//!   engine. When it is over, the order ends.
//! - The highest fresh source is in control. Without one the stages of loss follow: hold, fail-safe throttle, and standby
//!   where configured or where no engine is known to run. A timer detects silence, and a reset does not end it.
//! - The state that the ECU reports takes precedence over what was commanded.

pub mod config;
pub mod retained;
pub mod state;

mod commands;
mod configure;
mod data;
mod deadlines;
mod exhaust;
mod governor;
mod judging;
mod life;
mod limits;
mod lives;
mod origins;
mod pump;
mod ramp;
mod record;
mod reset;
mod run;
mod sending;
mod shaper;
mod sources;
mod steps;
mod supervision;
mod supply;

use self::data::Mode;
use self::run::Run;
use self::state::EngineState;
use crate::command::{Accepted, Command, Origin, Rejected};
use crate::event::{Event, LossStage};
use crate::line::LineError;
use crate::link::{Link, Output, earlier};
use crate::report::{NotSent, Timed, bump};
use crate::telemetry::Telemetry;
use crate::units::{Hectopascals, Millivolts};
use embassy_time::{Duration, Instant};

pub use self::config::Loss;
pub use self::data::Engine;
pub use self::supervision::OBEY_GRACE;

/// Time without a transmission after which the transmitter is reported as failed and has to be opened again.
pub(crate) const TRANSMITTER_FAILED: Duration = Duration::from_secs(1);

impl Engine {
    /// Whether a good frame waits for [`Engine::supervise`].
    pub const fn has_frame_to_supervise(&self) -> bool {
        self.pending_frame.is_some()
    }

    /// Takes bytes from the ECU; see [`Link::receive`]. Whether the engine still runs is judged before the reply to the frame
    /// is handed out. Everything else is left to [`Engine::supervise`] and takes effect with the next reply.
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        if self.wake.is_some_and(|at| at <= now) {
            self.update(now);
        }
        let taken = self.link.receive(now, bytes);
        if let Some(observation) = self.link.take_observation() {
            self.touch();
            self.pending_frame = Some(now);
            if let Mode::Run(run) = &mut self.mode {
                run.demand.received = run.demand.sent;
            }
            self.judge(now, observation);
        }
        taken
    }

    /// Counts a fault that the UART detected.
    pub fn line_error(&mut self, error: LineError) {
        self.link.line_error(error);
    }

    /// See [`Link::byte_lost`].
    pub fn byte_lost(&mut self, error: LineError) {
        self.link.byte_lost(error);
    }

    /// See [`Link::sent`].
    pub fn sent(&mut self, now: Instant) {
        self.link.sent(now);
        if let Mode::Run(run) = &mut self.mode {
            run.demand.sent = run.demand.handed_out.take().unwrap_or(run.demand.sent);
        }
        self.touch();
        self.transmitter = None;
        if core::mem::take(&mut self.transmitter_failed) {
            self.event(Event::TransmitterWorks);
        }
    }

    /// See [`Link::not_sent`].
    pub fn not_sent(&mut self, now: Instant, why: NotSent) {
        self.link.not_sent(now, why);
        self.touch();
        if let Mode::Run(run) = &mut self.mode {
            run.demand.handed_out = None;
        }
        if why == NotSent::TooLate {
            return;
        }
        // What has not reached the ECU must not jump when the transmitter works again.
        if let Mode::Run(run) = &mut self.mode {
            run.shaper.fall_back(now, run.demand.sent);
        }
        let since = *self.transmitter.get_or_insert(now);
        // A reply carries the order of the moment in which it is handed out, and that may be the next input.
        self.shape(now);
        let failed = now >= since + TRANSMITTER_FAILED;
        if failed && !core::mem::replace(&mut self.transmitter_failed, true) {
            self.event(Event::TransmitterFailed);
        }
    }

    /// See [`Link::timeout`]. The order is updated first, so that a send slot of the link carries it.
    pub fn timeout(&mut self, now: Instant) {
        self.update(now);
        self.link.timeout(now);
        self.update(now);
    }

    /// Handles the frame that [`Engine::receive`] has taken: limits, sources, stages of loss. Call it after draining the
    /// outputs of that input, so that the reply to a frame does not wait for it; then drain again.
    pub fn supervise(&mut self) {
        if let Some(now) = self.pending_frame.take() {
            self.touch();
            self.look(now);
            self.update(now);
        }
    }

    /// See [`Link::compose`].
    pub fn compose(&mut self) {
        self.link.compose();
    }

    /// See [`Link::poll`]. It decides nothing: the inputs and [`Engine::compose`] do.
    pub fn poll(&mut self) -> Output {
        let output = self.link.poll();
        if let (Output::Transmit(transmission), Mode::Run(run)) = (&output, &mut self.mode) {
            run.demand.handed_out = transmission.has_demand().then_some(run.demand.shaped);
        }
        match output {
            Output::Wait(deadline) => match self.events.pop_front() {
                Some(event) => Output::Event(event),
                None => {
                    if core::mem::take(&mut self.wake_stale) {
                        self.wake = earlier(deadline, self.deadline());
                    }
                    Output::Wait(self.wake)
                }
            },
            output => output,
        }
    }

    /// The atmospheric pressure, for an ECU that requests it (ZK-14).
    pub fn pressure(&mut self, now: Instant, pressure: Hectopascals) {
        self.link.pressure(now, pressure);
    }

    /// Takes the supply voltage that the board measures. It is used where the ECU reports none: for the interlock of a start
    /// (`start.supply_min`) and the limit (`limits.supply_low`).
    pub fn board_supply(&mut self, now: Instant, voltage: Millivolts) {
        self.board_supply = Some(Timed::new(voltage, now));
        self.touch();
        self.look(now);
        self.update(now);
    }

    /// Takes a command. The latest command of a source replaces its earlier one, the highest fresh source is in control, and a
    /// stop pre-empts everything. `others_allow_start`: no other engine of the group is starting.
    ///
    /// # Errors
    /// [`Rejected`] with the reason. The order does not change.
    pub fn command(
        &mut self,
        now: Instant,
        command: Command,
        origin: Origin,
        others_allow_start: bool,
    ) -> Result<Accepted, Rejected> {
        self.touch();
        let answer = self.execute(now, command, origin, others_allow_start);
        match answer {
            Ok(_) => {
                self.note_rejection(origin, None);
            }
            Err(why) => {
                bump(&mut self.commands_rejected);
                if self.note_rejection(origin, Some(why)) != Some(why) {
                    self.event(Event::CommandRejected(why, origin));
                }
            }
        }
        self.update(now);
        answer
    }

    /// Whether another engine of the group has to wait with its start.
    pub fn blocks_other_starts(&self, now: Instant) -> bool {
        let starting = match &self.mode {
            Mode::Run(run) => !run.life.reached(),
            Mode::Pwm { life, .. } => !life.reached(),
            _ => false,
        };
        starting || self.last_start.is_some_and(|at| now < at + self.config.start.gap)
    }

    /// Whether the engine ran, and stopped or fell silent without a command.
    pub const fn failed(&self) -> bool {
        self.failed
    }

    /// Counts another engine of the group that failed or has recovered.
    pub fn other_failed(&mut self, now: Instant, failed: bool) {
        self.others_failed =
            if failed { self.others_failed.saturating_add(1) } else { self.others_failed.saturating_sub(1) };
        self.event(Event::OtherFailed(self.others_failed));
        self.update(now);
    }

    /// Whether it is armed, and this source last commanded "arm".
    pub const fn is_armed_by(&self, origin: Origin) -> bool {
        self.armed && self.arm_commanded.contains(origin)
    }

    /// Takes a snapshot.
    pub fn telemetry(&self, now: Instant) -> Telemetry {
        let mut counters = self.link.status().counters;
        counters.commands_rejected = self.commands_rejected;
        counters.events_dropped = counters.events_dropped.wrapping_add(self.events_dropped);
        let run = match &self.mode {
            Mode::Run(run) => Some(run),
            _ => None,
        };
        let active_source = self.active(now).unwrap_or(self.ordered.origin);
        let ended = if self.ended_by_loss { LossStage::Standby } else { LossStage::None };
        Telemetry {
            at: now,
            link: self.link.status().state,
            last_rx: self.link.status().last_rx,
            state: EngineState::of(now, self.link.status().state, &self.link.status().report),
            report: self.link.status().report,
            supply: self.supply(),
            ordered: self.ordered,
            obeyed: !self.not_obeyed,
            active_source,
            source_last_rx: self.sources.last_rx(active_source),
            commanded: run.map(|run| run.demand.commanded),
            waiting: run.and_then(|run| run.waits()).map(|wait| wait.origin),
            loss: run.map_or(ended, |run| run.stage),
            limited: run.is_some_and(|run| run.limited),
            in_doubt: match &self.mode {
                Mode::Run(Run { life, .. }) | Mode::Pwm { life, .. } => life.in_doubt(),
                _ => None,
            },
            start_waits_until: self.start_wait.map(|wait| wait.until),
            transmitter_failed: self.transmitter_failed,
            armed: self.armed,
            stop_latched: matches!(self.mode, Mode::Stop(_)),
            fuel_service: self.pump.is_some(),
            start_by: run.filter(|run| !run.life.reached()).and_then(|run| run.start_by),
            failed: self.failed,
            others_failed: self.others_failed,
            counters,
        }
    }
}
