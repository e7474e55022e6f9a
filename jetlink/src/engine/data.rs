//! What an engine consists of: its link, its sources and its order; and what every part of it uses.

use super::config::{START_TIMEOUT, Supervision};
use super::exhaust::Exhaust;
use super::life::{Finding, Life};
use super::limits::LimitMonitor;
use super::origins::Origins;
use super::retained::{RetainedState, WORDS as RETAINED_WORDS};
use super::run::Run;
use super::sources::Sources;
use crate::command::{Order, Ordered, Origin, Rejected};
use crate::config::{EngineConfig, LinkSettings};
use crate::ecu::EcuConfig;
use crate::ecu::any::AnyLink;
use crate::event::Event;
use crate::line::Line;
use crate::link::Link;
use crate::report::{Phase, Timed, bump};
use crate::units::Millivolts;
use embassy_time::{Duration, Instant};
use heapless::Deque;

/// Consecutive resets without a source after which an engine resumes at the fail-safe stage.
pub(super) const RESETS_TO_FAIL_SAFE: u8 = 3;

/// The order, with the state that ends with it.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "nothing allocates, and one engine has one mode")]
pub(super) enum Mode {
    /// No order is in force until the ECU has reported what its engine does.
    Listen(Finding),
    /// Emergency stop, latched by this source.
    Stop(Origin),
    Standby,
    Run(Run),
    /// Handed over to the ECU's PWM input.
    Pwm {
        life: Life,
        /// Latest time to reach running.
        start_by: Option<Instant>,
    },
}

/// How a run begins.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Beginning {
    /// A start.
    FromStandby,
    /// No order was in force, and the ECU reports a running engine.
    Found {
        /// What its reports show of it.
        life: Life,
        /// Time since the order of a start that is under way.
        started_before: Duration,
        /// Time for which no source has been in control.
        lost_for: Duration,
        /// Time for which a fall of the exhaust is expected yet.
        fall_expected: Duration,
    },
    /// The node was reset with an order in force: in doubt until two reports confirm it.
    Reset(RetainedState),
}

/// A start that waits until another engine of the group has started.
#[derive(Clone, Copy, Debug)]
pub(super) struct StartWait {
    pub origin: Origin,
    pub until: Instant,
}

/// A service command that may have opened the fuel pump.
#[derive(Clone, Copy, Debug)]
pub(super) struct OpenPump {
    pub origin: Origin,
    /// Last command of its source.
    pub last_rx: Instant,
    pub until: Instant,
}

/// Services that move fuel or heat, repeated without a pause. They share one time, so that a stream of them has an end.
#[derive(Clone, Copy, Debug)]
pub(super) struct FuelService {
    pub since: Instant,
    pub last_rx: Instant,
}

/// One engine: its link, its sources and its order.
#[derive(Clone, Debug)]
pub struct Engine {
    pub(super) link: AnyLink,
    pub(super) line: Line,
    pub(super) ecu: EcuConfig,
    /// Settings of the link that wait until the engine is at rest.
    pub(super) link_settings: Option<LinkSettings>,
    pub(super) config: Supervision,
    pub(super) sources: Sources,
    pub(super) mode: Mode,
    pub(super) ordered: Ordered,
    pub(super) armed: bool,
    /// Sources whose standby permits their next run to start the engine, in the order of [`Origin::ALL`].
    pub(super) permitted: Origins,
    /// Sources that last commanded "arm", and those that have to disarm before their "arm" is accepted again.
    pub(super) arm_commanded: Origins,
    pub(super) must_disarm: Origins,
    pub(super) start_wait: Option<StartWait>,
    /// Time of the last start.
    pub(super) last_start: Option<Instant>,
    /// End of the last gap of three expected frames, or the last power-up that the ECU reported: it may have restarted.
    /// [`Instant::MAX`] while a gap lasts.
    pub(super) last_gap: Option<Instant>,
    pub(super) pump: Option<OpenPump>,
    /// Supply voltage that the board measures.
    pub(super) board_supply: Option<Timed<Millivolts>>,
    pub(super) fuel_service: Option<FuelService>,
    /// The last stage of loss ended the run.
    pub(super) ended_by_loss: bool,
    /// The engine ran, and stopped or fell silent without a command.
    pub(super) failed: bool,
    /// Number of failed engines in the rest of the group.
    pub(super) others_failed: u8,
    pub(super) limits: LimitMonitor,
    pub(super) exhaust: Exhaust,
    /// Consecutive resets without a source, this one included.
    pub(super) resets: u8,
    /// Time of the first failed transmission since the last good one, and whether that was reported.
    pub(super) transmitter: Option<Instant>,
    pub(super) transmitter_failed: bool,
    /// [`Engine::start`] was called. Until then the retained state is left unchanged.
    pub(super) begun: bool,
    /// Time of that call.
    pub(super) started: Instant,
    /// State that survived the reset, until the engine begins.
    pub(super) retained: Option<RetainedState>,
    pub(super) last_retained: [u32; RETAINED_WORDS],
    /// Active source that was last reported.
    pub(super) reported_source: Option<Origin>,
    /// A clamped demand was reported.
    pub(super) clamp_reported: bool,
    /// Time since which the ECU has reported something other than the order.
    pub(super) not_obeyed_since: Option<Instant>,
    /// [`Event::NotObeyed`](crate::event::Event::NotObeyed) was published.
    pub(super) not_obeyed: bool,
    pub(super) commands_rejected: u32,
    /// The last refusal of each source, in the order of [`Origin::ALL`].
    pub(super) last_rejection: [Option<Rejected>; Origin::ALL.len()],
    /// Time of the last update. Deadlines before it have been handled.
    pub(super) at: Instant,
    /// Wake-up time that was last handed out.
    pub(super) wake: Option<Instant>,
    /// Whether the wake-up time and the record have to be computed again. Most bytes are in the middle of a frame and change
    /// neither.
    pub(super) wake_stale: bool,
    pub(super) record_stale: bool,
    /// Time of a frame that [`Engine::supervise`] has not handled yet.
    pub(super) pending_frame: Option<Instant>,
    pub(super) events: Deque<Event, 12>,
    pub(super) events_dropped: u32,
}

impl Engine {
    /// An engine without an order.
    // Not inlined: on the stack of whoever builds a node its fields would be too far away for short instructions.
    #[inline(never)]
    pub fn new(config: &EngineConfig) -> Self {
        Self {
            link: AnyLink::new(&config.ecu, config.line, config.timing),
            line: config.line,
            ecu: config.ecu,
            link_settings: None,
            config: config.supervision,
            sources: Sources::new(&config.supervision),
            mode: Mode::Listen(Finding::new(Instant::MIN, false)),
            ordered: Ordered { order: Order::Listen, origin: Origin::Node },
            armed: false,
            permitted: Origins::NONE,
            arm_commanded: Origins::NONE,
            must_disarm: Origins::NONE,
            start_wait: None,
            last_start: None,
            last_gap: None,
            pump: None,
            board_supply: None,
            fuel_service: None,
            ended_by_loss: false,
            failed: false,
            others_failed: 0,
            limits: LimitMonitor::new(),
            exhaust: Exhaust::new(config.supervision.burning_egt),
            resets: 0,
            transmitter: None,
            transmitter_failed: false,
            begun: false,
            started: Instant::MIN,
            retained: None,
            last_retained: [0; RETAINED_WORDS],
            reported_source: None,
            clamp_reported: false,
            not_obeyed_since: None,
            not_obeyed: false,
            commands_rejected: 0,
            last_rejection: [None; Origin::ALL.len()],
            at: Instant::MIN,
            wake: None,
            wake_stale: true,
            record_stale: true,
            pending_frame: None,
            events: Deque::new(),
            events_dropped: 0,
        }
    }

    pub(super) const fn touch(&mut self) {
        self.wake_stale = true;
        self.record_stale = true;
    }

    pub(super) fn phase(&self) -> Option<Phase> {
        self.link.status().report.phase.map(|phase| phase.value)
    }

    pub(super) fn event(&mut self, event: Event) {
        queue(&mut self.events, &mut self.events_dropped, event);
    }

    /// Longest time for a start: twice the ECU's own figure, where it has one.
    pub(super) fn start_time(&self) -> Duration {
        match self.link.status().report.startup {
            Some(startup) if startup.value.as_ticks() > 0 => {
                let (min, max) = START_TIMEOUT;
                (startup.value * 2).clamp(min, max)
            }
            _ => self.config.start.timeout,
        }
    }
}

/// Queues an event, or counts it as dropped if the queue is full.
#[inline(never)]
pub(super) fn queue(events: &mut Deque<Event, 12>, dropped: &mut u32, event: Event) {
    if events.push_back(event).is_err() {
        bump(dropped);
    }
}
