//! State shared by the tasks of one engine: its commands, its notes, and the audit of its line.

use super::audit::Audit;
use super::disturbances::{By, Disturbances};
use super::engines::Engine;
use super::limiter::Limiter;
use super::play::action::Fault;
use super::tap::Tap;
use embassy_time::{Duration, Instant};
use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::limit::LimitViolation;
use jetlink::report::LinkState;
use jetlink::telemetry::Telemetry;
use sim::any::AnyEcu;
use sim::clock;
use sim::ecu::{Nanos, SECOND};
use sim::wire::{Direction, Faults as LineFaults, Plug};
use std::cell::{Cell, RefCell};

/// Stage of an engine's pilot.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Stage {
    /// Standby, before a start.
    Standby,
    /// From the command to run until the ECU reports a running engine.
    Start,
    /// Running at idle.
    Idle,
    /// Running, the demand goes in steps.
    Steps,
    /// Standby commanded, until the engine is cool and at rest.
    Cooling,
    /// Everything is done.
    Done,
    /// Something was not reached; the engine is kept in standby.
    Failed,
    /// Its source falls silent in the middle of the run, and comes back.
    SourceLost,
    /// The scenario's own events take place.
    Scenario(&'static str),
    /// It was taken from its script, and is played.
    Played,
    /// It has no script: MAVLink or radio control commands it.
    Commanded,
}

impl Stage {
    /// Name in lower case.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Standby => "standby",
            Self::Start => "start",
            Self::Idle => "idle",
            Self::Steps => "steps",
            Self::Cooling => "cooling",
            Self::Done => "done",
            Self::Failed => "failed",
            Self::SourceLost => "source lost",
            Self::Scenario(name) => name,
            Self::Played => "played",
            Self::Commanded => "commanded",
        }
    }
}

/// The pilot's input.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PilotInput {
    /// Standby.
    Standby,
    /// Run.
    Run(Demand),
}

impl PilotInput {
    /// As a command to the node.
    pub const fn command(self) -> Command {
        match self {
            Self::Standby => Command::Standby,
            Self::Run(demand) => Command::Run(demand),
        }
    }

    /// As the order that the node has to keep on the wire.
    pub const fn order(self) -> Order {
        match self {
            Self::Standby => Order::Standby,
            Self::Run(demand) => Order::Run(demand),
        }
    }

    /// The throttle it commands, in percent.
    pub fn throttle_percent(self) -> Option<f64> {
        match self {
            Self::Run(Demand::Throttle(throttle)) => Some(f64::from(throttle.tenths()) / 10.0),
            _ => None,
        }
    }

    /// The speed it commands, in rpm.
    pub fn rpm(self) -> Option<u32> {
        match self {
            Self::Run(Demand::Rpm(rpm)) => Some(rpm.get()),
            _ => None,
        }
    }
}

impl core::fmt::Display for PilotInput {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Standby => f.write_str("standby"),
            Self::Run(Demand::Throttle(throttle)) => {
                write!(f, "{:.1} %", f64::from(throttle.tenths()) / 10.0)
            }
            Self::Run(Demand::Rpm(rpm)) => write!(f, "{} rpm", rpm.get()),
        }
    }
}

/// Something worth a line.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Note {
    /// When.
    pub at: Instant,
    /// Its engine, by its place in the list of engines; `None`: the whole run.
    pub engine: Option<usize>,
    /// What.
    pub text: String,
}

/// An entry by a task.
#[derive(Debug)]
pub enum Entry {
    /// Something happened.
    Note(Note),
    /// A moment to be found again in the plot.
    Mark {
        /// When.
        at: Instant,
        /// What.
        label: String,
    },
}

/// Where all tasks put their notes.
#[derive(Debug, Default)]
pub struct Notes(RefCell<Vec<Entry>>);

impl Notes {
    /// Adds one.
    pub fn add(&self, engine: Option<usize>, text: impl Into<String>) {
        self.0.borrow_mut().push(Entry::Note(Note { at: Instant::now(), engine, text: text.into() }));
    }

    /// Adds one that is marked in the plot.
    pub fn mark(&self, label: &str) {
        self.add(None, format!("=== {label}"));
        self.0.borrow_mut().push(Entry::Mark { at: Instant::now(), label: label.to_owned() });
    }

    /// Takes all entries.
    pub fn take(&self) -> Vec<Entry> {
        self.0.take()
    }
}

/// State shared by the tasks of one engine.
#[derive(Debug)]
pub struct EngineContext<'a> {
    /// Its place in the list of engines.
    pub index: usize,
    /// The engine.
    pub engine: &'a Engine,
    /// Stage of its pilot.
    pub stage: Cell<Stage>,
    /// Command of its pilot.
    pub input: Cell<PilotInput>,
    /// Its pilot commands nothing.
    pub silent: Cell<bool>,
    /// It was stopped by hand: its scenario no longer commands it.
    pub stopped: Cell<bool>,
    /// It was taken from its script, and is commanded by hand.
    pub played: Cell<bool>,
    /// When the last fault on its line ends.
    pub clean_from: Instant,
    /// Faults on its line.
    pub disturbances: RefCell<Disturbances>,
    /// Compares the line with the commands.
    pub audit: RefCell<Audit>,
    /// The bytes on the line, for views and files.
    pub tap: RefCell<Tap>,
    /// Number of times that the engine stopped although it was to run.
    pub stops: Cell<u32>,
    /// What the pilot could not reach, once it has given up.
    pub failure: RefCell<Option<String>>,
    /// From the end of the last fault on its line until its link was up.
    pub recovered_after: Cell<Option<Duration>>,
    /// The last violation of each limit that the node has reported, the latest at the end.
    pub violations: RefCell<Vec<LimitViolation>>,
    /// When each source last commanded standby.
    standbys: RefCell<Vec<(Origin, Nanos)>>,
    /// Limits notes that may come in any number.
    limiter: RefCell<Limiter>,
    notes: &'a Notes,
}

impl<'a> EngineContext<'a> {
    /// For one engine.
    pub fn new(index: usize, engine: &'a Engine, clean_from: Instant, notes: &'a Notes) -> Self {
        Self {
            index,
            engine,
            stage: Cell::new(Stage::Standby),
            input: Cell::new(PilotInput::Standby),
            silent: Cell::new(false),
            stopped: Cell::new(false),
            played: Cell::new(false),
            clean_from,
            disturbances: RefCell::default(),
            audit: RefCell::new(Audit::new(engine)),
            tap: RefCell::default(),
            stops: Cell::new(0),
            failure: RefCell::default(),
            recovered_after: Cell::new(None),
            violations: RefCell::default(),
            standbys: RefCell::default(),
            limiter: RefCell::new(Limiter::new()),
            notes,
        }
    }

    /// A fault of the line begins or ends; the state of both wires combines all disturbances.
    pub fn disturb(&self, plug: &Plug<AnyEcu>, by: By, fault: Fault, begins: bool) {
        let mut all = self.disturbances.borrow_mut();
        let cut = [Direction::ToEcu, Direction::ToNode].map(|direction| (direction, all.is_cut(direction)));
        let line = all.line();
        all.set(Instant::now(), by, fault, begins);
        for (direction, before) in cut {
            // A wire joined in the middle of a byte also spoils it.
            if all.is_cut(direction) != before {
                plug.cut_one(direction, !before);
            }
        }
        if all.line() != line {
            plug.set_faults(all.line(), all.line());
        }
    }

    /// Sets the effect of `--faults` on the line from now on.
    pub fn plan_faults(&self, plug: &Plug<AnyEcu>, line: LineFaults) {
        let mut all = self.disturbances.borrow_mut();
        all.plan(Instant::now(), line);
        plug.set_faults(all.line(), all.line());
    }

    /// Takes the recording of the line, for the audit and the tap.
    pub fn take_log(&self, plug: &Plug<AnyEcu>) {
        let log = plug.take_log();
        self.tap.borrow_mut().add(&log);
        self.audit.borrow_mut().look(&log);
    }

    /// Checks whether the link is up again after the last fault.
    pub fn watch_recovery(&self, telemetry: &Telemetry) {
        let last_rx = telemetry.last_rx.filter(|&last_rx| last_rx >= self.clean_from);
        if let (Some(last_rx), LinkState::Up, None) = (last_rx, telemetry.link, self.recovered_after.get())
            && self.clean_from > Instant::MIN
        {
            self.recovered_after.set(Some(last_rx - self.clean_from));
        }
    }

    /// Reports a command and its answer to the audit.
    pub fn judge(&self, at: Nanos, order: Order, origin: Origin, answer: Result<Accepted, Rejected>) {
        let mut audit = self.audit.borrow_mut();
        if is_unfit(answer) {
            // As if the source had been silent.
            audit.may_be_up_to(at, None);
            return;
        }
        audit.commanded(at);
        if order == Order::Standby {
            self.standby_commanded(at, origin);
        }
        match (answer, order) {
            (Ok(Accepted::InForce), _) => audit.ordered(at, order),
            (Ok(Accepted::Held), Order::Run(demand)) => audit.may_be_up_to(at, Some(demand)),
            // It takes effect when the rules of sources say so: see `standby_of`.
            (Ok(Accepted::Held), _) => {}
            // Refused, behind another source, a start that waits, the first of two commands: nothing changes yet.
            _ => {}
        }
    }

    /// A source has commanded standby, or disarmed an engine that starts: that ends the start.
    pub fn standby_commanded(&self, at: Nanos, origin: Origin) {
        let mut all = self.standbys.borrow_mut();
        all.retain(|(other, _)| *other != origin);
        all.push((origin, at));
    }

    /// The node reports that this source's standby has taken effect: the source has to have commanded it lately.
    pub fn standby_of(&self, at: Nanos, origin: Origin) {
        let wire = self.standbys.borrow().iter().any(|&(other, when)| other == origin && at <= when + SECOND);
        if wire {
            self.audit.borrow_mut().standby_took_effect(at);
        }
    }

    /// Keeps a violated limit.
    pub fn violated(&self, violation: LimitViolation) {
        let mut all = self.violations.borrow_mut();
        all.retain(|other| other.kind != violation.kind);
        all.push(violation);
    }

    /// Notes something about this engine.
    pub fn note(&self, text: impl Into<String>) {
        self.notes.add(Some(self.index), text);
    }

    /// Notes something that may come in any number; excess notes are only counted.
    pub fn note_limited(&self, text: String) {
        self.note_hidden(false);
        if self.limiter.borrow_mut().lets_through(Instant::now()) {
            self.note(text);
        }
    }

    /// Notes the number of hidden notes: when its time is over, or `at_the_end` at once.
    pub fn note_hidden(&self, at_the_end: bool) {
        let mut limiter = self.limiter.borrow_mut();
        if let Some(text) = if at_the_end { limiter.rest() } else { limiter.over(Instant::now()) } {
            self.note(text);
        }
    }
}

/// Whether the ECU cannot follow the demand: such a command changes nothing, not even that the source is silent.
const fn is_unfit(answer: Result<Accepted, Rejected>) -> bool {
    matches!(
        answer,
        Err(Rejected::NoSpeedControl
            | Rejected::RpmNotKnown
            | Rejected::AboveMaxRpm { .. }
            | Rejected::NeedsVersion { known: Some(_), .. })
    )
}

/// Compares the lines with the commands.
pub fn look(contexts: &[EngineContext<'_>], plugs: &[Plug<AnyEcu>]) {
    for (context, plug) in contexts.iter().zip(plugs) {
        context.take_log(plug);
        let mut audit = context.audit.borrow_mut();
        audit.see_engine(clock::now_ns(), plug.ecu(|ecu| ecu.turbine().phase()));
        audit.looked_until(clock::now_ns());
    }
}
