//! One engine of a world: its configuration, its ECU and its line, its sources and its judge.

use super::super::ecus;
use super::super::oracle::{DARK, Input, Oracle, Truth};
use super::super::reader::Reader;
use core::fmt;
use jetlink::channel::Owner;
use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::event::Event;
use jetlink::units::Throttle;
use sim::any::AnyEcu;
use sim::clock;
use sim::turbine::Phase;
use sim::wire::{Direction, Fate, Plug, WireRx, WireTx};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

pub(super) const MS: u64 = 1_000;
pub(super) const SECOND: u64 = 1_000_000;
/// Longest time from the first bit of a frame to its end.
pub(super) const LONGEST_FRAME: u64 = 30 * MS;

/// Its true state, and its reports.
pub(super) fn truth(ecu: &AnyEcu, odd: bool) -> Truth {
    let turbine = ecu.turbine();
    let truth = Truth {
        live: turbine.phase().is_live(),
        running: turbine.phase() == Phase::Running,
        egt: turbine.egt(),
        odd,
        own_stops: ecu.counts().loss_stops,
        ..Truth::default()
    };
    ecus::ecu(ecu).truth(truth)
}

/// Behaviour of a source for a while.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Program {
    Silent,
    Standby,
    Run(Demand),
    /// Commands and falls silent, over and over, for these times.
    Flap(Demand, u64, u64),
    /// Present, without a command.
    Present,
    /// From any state to a running engine, as documented.
    Fly(Demand),
    /// Anything.
    Nonsense,
}

#[derive(Debug)]
pub(super) struct Source {
    pub(super) origin: Origin,
    pub(super) program: Program,
    pub(super) period: u64,
    pub(super) next: u64,
    pub(super) changes: u64,
    pub(super) on_since: u64,
    pub(super) ready_since: Option<u64>,
}

/// One engine, its ECU, its sources, its judge.
pub(super) struct Rig {
    pub(super) config: EngineConfig,
    /// Its ECU governs the rpm itself.
    pub(super) holds_rpm: bool,
    pub(super) max_rpm: u32,
    pub(super) plug: Plug<AnyEcu>,
    pub(super) halves: (WireRx, WireTx),
    pub(super) reader: Reader,
    pub(super) oracle: Oracle,
    pub(super) sources: [Source; 4],
    pub(super) inputs: VecDeque<(u64, Input)>,
    pub(super) frames: VecDeque<(u64, super::super::wire::Frame)>,
    pub(super) published: Rc<RefCell<Vec<(u64, Event)>>>,
    /// A disturbance of the line, and of the ECU, until then.
    pub(super) line_until: Option<u64>,
    pub(super) hung_from: Option<u64>,
    pub(super) next_line: u64,
    pub(super) ecu_until: Option<u64>,
    pub(super) next_ecu: u64,
    pub(super) next_stop: u64,
    pub(super) next_arm: u64,
    /// Time at which every source falls silent, and until when.
    pub(super) next_silence: u64,
    pub(super) silent_until: u64,
    pub(super) odd_until: u64,
    pub(super) truth: Truth,
    pub(super) trace: VecDeque<(u64, Trace)>,
    /// Time of the last byte from the ECU.
    pub(super) byte_at: u64,
    /// Its silence was noted.
    pub(super) not_received: bool,
}

/// An entry of the log that a failure prints.
#[derive(Clone, Copy, Debug)]
pub(super) enum Trace {
    Input(Input),
    Frame(super::super::wire::Frame),
    Reported(Event),
    Line(&'static str),
    Ecu(&'static str),
}

impl fmt::Display for Trace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(input) => input.fmt(f),
            Self::Frame(frame) => write!(f, "wire: {frame}"),
            Self::Reported(event) => write!(f, "event: {event}"),
            Self::Line(what) => write!(f, "line: {what}"),
            Self::Ecu(what) => write!(f, "ECU: {what}"),
        }
    }
}

/// How long this thread's clock has run.
pub(super) fn now() -> u64 {
    clock::now_ns() / 1000
}

pub(super) fn throttle_tenths(tenths: u64) -> Demand {
    Demand::Throttle(Throttle::from_tenths(tenths as u16).expect("0..=1000"))
}

impl Rig {
    pub(super) fn note(&mut self, what: Trace) {
        self.note_at(now(), what);
    }

    pub(super) fn note_at(&mut self, at: u64, what: Trace) {
        if self.trace.len() == 160 {
            self.trace.pop_front();
        }
        self.trace.push_back((at, what));
    }

    pub(super) fn input(&mut self, input: Input) {
        if !matches!(input, Input::Truth(_)) {
            self.note(Trace::Input(input));
        }
        self.inputs.push_back((now(), input));
    }

    /// In the order of time.
    pub(super) fn insert(&mut self, at: u64, input: Input) {
        let place = self.inputs.partition_point(|(before, _)| *before <= at);
        self.inputs.insert(place, (at, input));
    }

    pub(super) fn command(
        &mut self,
        owner: &Owner<'_>,
        origin: Origin,
        command: Command,
    ) -> Result<Accepted, Rejected> {
        let mut command = command;
        if let Command::Run(Demand::Rpm(_)) = command {
            // Whether the ECU can do it is not reported then, and decides whether the source counts as received.
            let telemetry = owner.handle().telemetry();
            if telemetry.stop_latched || telemetry.ordered.order == Order::Listen {
                command = Command::Run(throttle_tenths(0));
            }
        }
        let may_start = matches!(command, Command::Run(_)) && !self.truth.running;
        if may_start || command == Command::ReleaseStop && self.truth.live {
            // The state of the ECU at this instant decides.
            self.look_at_ecu();
        }
        let answer = command_as(owner, command, origin);
        self.input(Input::Commanded(origin, command, answer));
        answer
    }

    /// Passes the frames and reports since the last call to the judge, in the order of time. Returns when a
    /// start was sent, if one was.
    pub(super) fn judge(&mut self, all: bool) -> Result<Option<u64>, String> {
        let frames = &mut self.frames;
        let seen = frames.len();
        let log = self.plug.take_log();
        self.reader.read(&log, |at, frame| frames.push_back((at, frame)));
        let lost_after = self.config.timing.lost_after.as_micros();
        for byte in
            log.iter().filter(|byte| byte.direction == Direction::ToNode && byte.fate == Fate::Delivered)
        {
            let at = byte.end / 1000;
            let before = core::mem::replace(&mut self.byte_at, at);
            if at > before + lost_after {
                self.insert(at, Input::LinkBack);
            }
            if at > before + DARK {
                if !core::mem::take(&mut self.not_received) {
                    self.insert(before + DARK, Input::NotReceived);
                }
                self.insert(at, Input::Received);
            }
        }
        if !self.not_received && now() > self.byte_at + DARK + LONGEST_FRAME {
            self.not_received = true;
            self.insert(self.byte_at + DARK, Input::NotReceived);
        }
        for index in seen..self.frames.len() {
            let (at, frame) = self.frames[index];
            self.note_at(at, Trace::Frame(frame));
        }
        let published = self.published.take();
        for (at, event) in published {
            self.note_at(at, Trace::Reported(event));
        }
        let until = if all { u64::MAX } else { now().saturating_sub(LONGEST_FRAME) };
        let mut started = None;
        loop {
            let input = self.inputs.front().map_or(u64::MAX, |(at, _)| *at);
            let frame = self.frames.front().map_or(u64::MAX, |(at, _)| *at);
            if input.min(frame) > until || input.min(frame) == u64::MAX {
                return Ok(started);
            }
            if input <= frame {
                if let Some((at, input)) = self.inputs.pop_front() {
                    self.oracle.input(at, input).map_err(|why| format!("at {at} µs: {why}"))?;
                }
            } else if let Some((at, frame)) = self.frames.pop_front()
                && self.oracle.frame(at, frame).map_err(|why| format!("at {at} µs: {why}"))?
            {
                started = Some(at);
            }
        }
    }

    pub(super) fn look_at_ecu(&mut self) {
        let odd = now() < self.odd_until;
        self.truth = self.plug.ecu(|ecu| truth(ecu, odd));
        let truth = self.truth;
        self.input(Input::Truth(truth));
        if odd {
            self.input(Input::Fault);
        }
    }
}

pub(super) fn command_as(owner: &Owner<'_>, command: Command, origin: Origin) -> Result<Accepted, Rejected> {
    let source = match origin {
        Origin::Emergency => owner.emergency_source(),
        origin => owner.source(origin),
    };
    source.expect("nobody else holds it").command(command)
}
