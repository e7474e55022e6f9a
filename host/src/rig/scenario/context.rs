//! The context of a scenario: a source for each engine that commands ten times a second, the faults, and the
//! observations to judge by.

use super::super::audit::TransmittedFrame;
use super::super::context::{EngineContext, Notes, PilotInput, Stage, look};
use super::super::disturbances::By;
use super::super::node::Node;
use super::super::outcome::Check;
use super::super::play::action::Fault;
use embassy_time::{Duration, Instant, Ticker, Timer};
use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::engine::state::EngineState;
use jetlink::event::Event;
use jetlink::report::{LinkState, Phase as Reported};
use jetlink::units::{Rpm, Throttle};
use sim::any::AnyEcu;
use sim::clock;
use sim::ecu::Nanos;
use sim::turbine::{Phase, Turbine};
use sim::wire::{Direction, Faults, FramingAs, Plug};
use std::cell::{Cell, RefCell};

/// Between two commands of a source.
const TICK: Duration = Duration::from_millis(100);
/// Time between two checks of an awaited event, and of the simulated engines.
const LOOK: Duration = Duration::from_millis(20);

/// A simulated engine at one moment.
#[derive(Clone, Copy, Debug)]
struct Moment {
    at: Nanos,
    phase: Phase,
    rpm: f64,
}

/// The source of commands of one engine.
#[derive(Debug)]
pub struct CommandSource<'a> {
    context: &'a EngineContext<'a>,
    origin: Cell<Origin>,
    /// The other source beside it, and its input, if any.
    beside: Cell<Option<(Origin, PilotInput)>>,
    answer: Cell<Answer>,
    /// Each answer that differs from the one before.
    answers: RefCell<Vec<(Nanos, Answer)>>,
}

/// The node's answer to a command; `None`: it was away.
type Answer = Option<Result<Accepted, Rejected>>;

impl<'a> CommandSource<'a> {
    fn new(context: &'a EngineContext<'a>) -> Self {
        Self {
            context,
            origin: Cell::new(Origin::Bench),
            beside: Cell::new(None),
            answer: Cell::new(None),
            answers: RefCell::default(),
        }
    }

    /// Run at this throttle, in percent.
    pub fn throttle(&self, percents: u8) {
        self.context.silent.set(false);
        self.context.input.set(PilotInput::Run(percent(percents)));
    }

    /// Run at this speed.
    pub fn rpm(&self, rpm: u32) {
        self.context.silent.set(false);
        self.context.input.set(PilotInput::Run(Demand::Rpm(Rpm::new(rpm))));
    }

    /// From now on it commands as this source.
    pub fn command_as(&self, origin: Origin) {
        self.origin.set(origin);
    }

    /// Another source has this input beside it, from now on; `None`: it is silent.
    pub fn beside(&self, input: Option<(Origin, PilotInput)>) {
        self.beside.set(input);
    }

    /// Standby.
    pub fn standby(&self) {
        self.context.silent.set(false);
        self.context.input.set(PilotInput::Standby);
    }

    /// Is silent from now on.
    pub fn silence(&self) {
        self.context.silent.set(true);
    }

    /// The node's answer to its last command.
    pub fn answer(&self) -> Answer {
        self.answer.get()
    }

    /// The node's answers since then, each that differs from the one before.
    pub fn answers_since(&self, since: Nanos) -> Vec<Answer> {
        let answers = self.answers.borrow();
        answers.iter().filter(|(at, _)| *at >= since).map(|(_, answer)| *answer).collect()
    }

    fn answered(&self, at: Nanos, answer: Answer) {
        if self.answer.replace(answer) != answer {
            self.answers.borrow_mut().push((at, answer));
        }
    }
}

/// All that a scenario needs.
#[derive(Debug)]
pub struct ScenarioContext<'a> {
    node: &'a Node<'a>,
    contexts: &'a [EngineContext<'a>],
    plugs: &'a [Plug<AnyEcu>],
    notes: &'a Notes,
    /// Of the scenario; empty where none is played.
    name: &'static str,
    sources: Vec<CommandSource<'a>>,
    checks: RefCell<Vec<Check>>,
    courses: Vec<RefCell<Vec<Moment>>>,
    events: RefCell<Vec<(Nanos, usize, Event)>>,
}

/// A demand of this throttle, in percent.
pub fn percent(percents: u8) -> Demand {
    Demand::Throttle(Throttle::from_percent(percents).unwrap_or(Throttle::IDLE))
}

impl<'a> ScenarioContext<'a> {
    /// For these engines.
    pub fn new(
        node: &'a Node<'a>,
        contexts: &'a [EngineContext<'a>],
        plugs: &'a [Plug<AnyEcu>],
        notes: &'a Notes,
        name: &'static str,
    ) -> Self {
        let sources = contexts.iter().map(CommandSource::new).collect();
        let courses = contexts.iter().map(|_| RefCell::default()).collect();
        Self {
            node,
            contexts,
            plugs,
            notes,
            name,
            sources,
            checks: RefCell::default(),
            courses,
            events: RefCell::default(),
        }
    }

    /// Expected events.
    pub fn checks(&self) -> Vec<Check> {
        self.checks.borrow().clone()
    }

    /// The node has reported something.
    pub fn note_event(&self, engine: usize, event: Event) {
        if self.is_played() {
            self.events.borrow_mut().push((clock::now_ns(), engine, event));
        }
    }

    /// Commands this engine forever, and records the simulated engine.
    pub async fn sit(&self, engine: usize) {
        let (Some(source), Some(context)) = (self.sources.get(engine), self.contexts.get(engine)) else {
            return;
        };
        context.audit.borrow_mut().transmitted = Some(Vec::new());
        let mut ticker = Ticker::every(LOOK);
        let mut next = Instant::MIN;
        self.arm();
        loop {
            if Instant::now() >= next {
                next = Instant::now() + TICK;
                let at = clock::now_ns();
                if context.silent.get() || context.stopped.get() {
                    context.audit.borrow_mut().may_be_up_to(at, None);
                } else {
                    let (input, origin) = (context.input.get(), source.origin.get());
                    let answer = self.node.command(engine, input.command(), origin);
                    if let Some(answer) = answer {
                        context.judge(at, input.order(), origin, answer);
                    }
                    source.answered(at, answer);
                }
                if !context.stopped.get()
                    && let Some((origin, input)) = source.beside.get()
                    && let Some(answer) = self.node.command(engine, input.command(), origin)
                {
                    context.judge(at, input.order(), origin, answer);
                }
            }
            if let (Some(plug), Some(course)) = (self.plugs.get(engine), self.courses.get(engine)) {
                let (phase, rpm) = plug.ecu(|ecu| (ecu.turbine().phase(), ecu.turbine().rpm()));
                course.borrow_mut().push(Moment { at: clock::now_ns(), phase, rpm });
            }
            ticker.next().await;
        }
    }

    fn is_played(&self) -> bool {
        self.contexts.iter().any(|context| context.audit.borrow().transmitted.is_some())
    }

    // -----------------------------------------------------------------------------------------
    // What is done
    // -----------------------------------------------------------------------------------------

    /// The node.
    pub fn node(&self) -> &Node<'a> {
        self.node
    }

    /// How many engines there are.
    pub fn count(&self) -> usize {
        self.contexts.len()
    }

    /// An engine's name.
    pub fn name(&self, engine: usize) -> &'static str {
        self.contexts[engine].engine.name()
    }

    /// The source of commands of an engine.
    pub fn source(&self, engine: usize) -> &CommandSource<'a> {
        &self.sources[engine]
    }

    /// Does something to all sources.
    pub fn each(&self, act: impl Fn(&CommandSource<'a>)) {
        self.sources.iter().for_each(act);
    }

    /// Arms all engines.
    pub fn arm(&self) {
        for i in 0..self.count() {
            self.node.command(i, Command::Arm, Origin::Bench);
        }
    }

    /// A command of another source.
    pub fn command(
        &self,
        engine: usize,
        command: Command,
        origin: Origin,
    ) -> Option<Result<Accepted, Rejected>> {
        let at = clock::now_ns();
        let answer = self.node.command(engine, command, origin);
        let order = match command {
            Command::EmergencyStop => Order::EmergencyStop,
            Command::Run(demand) => Order::Run(demand),
            Command::Standby | Command::ReleaseStop => Order::Standby,
            // Nothing else that a scenario commands changes what is ordered.
            _ => return answer,
        };
        if let Some(answer) = answer {
            self.contexts[engine].judge(at, order, origin, answer);
        }
        answer
    }

    /// Looks at a simulated ECU, or does something to it.
    pub fn ecu<T>(&self, engine: usize, act: impl FnOnce(&mut AnyEcu) -> T) -> T {
        self.plugs[engine].ecu(act)
    }

    /// Whether the ECU waits for a reply to each of its frames, and gets nothing else.
    pub fn is_answered(&self, engine: usize) -> bool {
        self.ecu(engine, |ecu| ecu.protocol().has_reply_window())
    }

    /// Cuts a line or joins it.
    pub fn cut(&self, engine: usize, cut: bool) {
        self.contexts[engine].disturb(&self.plugs[engine], By::Scenario, Fault::Cut, cut);
    }

    /// Cuts one of the two wires or joins it.
    pub fn cut_one(&self, engine: usize, direction: Direction, cut: bool) {
        let fault = match direction {
            Direction::ToEcu => Fault::CutToEcu,
            Direction::ToNode => Fault::CutToNode,
        };
        self.contexts[engine].disturb(&self.plugs[engine], By::Scenario, fault, cut);
    }

    /// Switches an ECU's supply.
    pub fn power(&self, engine: usize, on: bool) {
        self.contexts[engine].disturb(&self.plugs[engine], By::Scenario, Fault::Power, !on);
        self.plugs[engine].power(on);
    }

    /// Random faults on an ECU's bytes, and the node's UART's treatment of framing errors.
    pub fn noise(&self, engine: usize, faults: Faults, framing: FramingAs) {
        let noise = faults != Faults::default();
        self.contexts[engine].disturb(&self.plugs[engine], By::Scenario, Fault::Noise, noise);
        self.plugs[engine].framing(framing);
        self.plugs[engine].set_faults(faults, Faults::default());
    }

    /// Another ECU, with the engine behind it, is plugged in.
    pub fn plug_in(&self, engine: usize, ecu: impl Into<AnyEcu>) {
        self.contexts[engine].disturbances.borrow_mut().happens(Instant::now());
        self.plugs[engine].replace_ecu(ecu.into());
    }

    /// The node's configuration of an engine.
    pub fn engine(&self, engine: usize) -> &EngineConfig {
        &self.contexts[engine].engine.config
    }

    /// Waits until an engine that was shut down is cool.
    pub async fn cool(&self, engine: usize) -> Result<(), String> {
        self.sources[engine].standby();
        let what = format!("{} is cool", self.name(engine));
        self.until(300.0, &what, || {
            let turbine = self.turbine(engine);
            turbine.phase() == Phase::Standby && turbine.egt() < 95.0
        })
        .await
    }

    /// Marks this moment in the picture.
    pub fn mark(&self, label: &str) {
        self.notes.mark(label);
    }

    /// How far an engine is.
    pub fn stage(&self, engine: usize, stage: Stage) {
        let context = &self.contexts[engine];
        if context.stage.replace(stage) != stage {
            context.note(format!("progress: {}", stage.name()));
        }
    }

    /// The scenario's own events begin.
    pub fn event(&self) {
        (0..self.count()).for_each(|i| self.stage(i, Stage::Scenario(self.name)));
    }

    /// Lets this number of seconds pass.
    pub async fn sleep(&self, seconds: f64) {
        Timer::after(Duration::from_micros((seconds * 1e6) as u64)).await;
    }

    /// Waits for this.
    pub async fn until(
        &self,
        seconds: f64,
        what: &str,
        mut come: impl FnMut() -> bool,
    ) -> Result<(), String> {
        let limit = Instant::now() + Duration::from_micros((seconds * 1e6) as u64);
        while !come() {
            if Instant::now() >= limit {
                return Err(format!("timed out after {seconds:.0} s waiting for: {what}"));
            }
            Timer::after(LOOK).await;
        }
        Ok(())
    }

    /// Standby, until the ECU reports it.
    pub async fn ready(&self, engine: usize) -> Result<(), String> {
        self.sources[engine].standby();
        let what = format!("{} is ready for a start", self.name(engine));
        self.until(10.0, &what, || {
            let telemetry = self.node.telemetry(engine);
            telemetry.link == LinkState::Up && telemetry.state == EngineState::Standby
        })
        .await?;
        self.sleep(1.5).await;
        Ok(())
    }

    /// Waits for a running engine.
    pub async fn running(&self, engine: usize) -> Result<(), String> {
        self.until(60.0, &format!("{} runs", self.name(engine)), || {
            let phase = self.node.telemetry(engine).report.phase;
            self.runs(engine) && phase.is_some_and(|phase| phase.value == Reported::Running)
        })
        .await
    }

    /// Starts an engine to idle.
    pub async fn start(&self, engine: usize) -> Result<(), String> {
        self.ready(engine).await?;
        self.stage(engine, Stage::Start);
        self.sources[engine].throttle(0);
        self.running(engine).await?;
        self.stage(engine, Stage::Idle);
        Ok(())
    }

    /// Starts all engines, and takes them to this throttle, in percent.
    pub async fn fly(&self, percents: u8) -> Result<(), String> {
        for i in 0..self.count() {
            self.start(i).await?;
        }
        for i in 0..self.count() {
            self.stage(i, Stage::Steps);
            self.sources[i].throttle(percents);
        }
        self.sleep(7.0).await;
        Ok(())
    }

    /// Standby for all, until no engine burns.
    pub async fn shut_down(&self) -> Result<(), String> {
        for i in 0..self.count() {
            self.stage(i, Stage::Cooling);
            self.sources[i].standby();
        }
        self.until(10.0, "all engines are shut down", || {
            (0..self.count()).all(|i| !self.turbine(i).phase().is_live())
        })
        .await?;
        self.sleep(5.0).await;
        (0..self.count()).for_each(|i| self.stage(i, Stage::Done));
        Ok(())
    }

    // -----------------------------------------------------------------------------------------
    // What is judged by
    // -----------------------------------------------------------------------------------------

    /// The time.
    pub fn now(&self) -> Nanos {
        clock::now_ns()
    }

    /// States an expectation.
    pub fn must(&self, held: bool, what: impl Into<String>) {
        let what = what.into();
        if !held {
            self.notes.add(None, format!("THIS DID NOT OCCUR: {what}"));
        }
        self.checks.borrow_mut().push(Check { what, held });
    }

    /// Takes the recordings of the lines.
    pub fn look(&self) {
        look(self.contexts, self.plugs);
    }

    /// Frames sent by the node to an ECU in this time, by their first bits.
    pub fn transmitted(&self, engine: usize, from: Nanos, to: Nanos) -> Vec<TransmittedFrame> {
        let audit = self.contexts[engine].audit.borrow();
        let transmitted = audit.transmitted.as_deref().unwrap_or_default();
        transmitted.iter().filter(|frame| (from..to).contains(&frame.from)).copied().collect()
    }

    /// The simulated turbine.
    pub fn turbine(&self, engine: usize) -> Turbine {
        self.plugs[engine].ecu(|ecu| ecu.turbine().clone())
    }

    /// The simulated engine runs.
    pub fn runs(&self, engine: usize) -> bool {
        self.turbine(engine).phase() == Phase::Running
    }

    /// The phases of the simulated engine in this time.
    pub fn phases(&self, engine: usize, from: Nanos, to: Nanos) -> Vec<Phase> {
        let course = self.courses[engine].borrow();
        course.iter().filter(|moment| (from..to).contains(&moment.at)).map(|moment| moment.phase).collect()
    }

    /// The simulated engine has run without a break since then.
    pub fn ran_from(&self, engine: usize, from: Nanos) -> bool {
        let phases = self.phases(engine, from, self.now());
        !phases.is_empty() && phases.iter().all(|phase| *phase == Phase::Running)
    }

    /// Number of times that the simulated engine was lit, or began to be, in this time.
    pub fn starts(&self, engine: usize, from: Nanos, to: Nanos) -> usize {
        let phases = self.phases(engine, from, to);
        phases.windows(2).filter(|pair| matches!(pair, [a, b] if !a.is_live() && b.is_live())).count()
    }

    /// Its speed since then was within this share of its speed then.
    pub fn speed_stayed(&self, engine: usize, from: Nanos, share: f64) -> bool {
        let course = self.courses[engine].borrow();
        let mut speeds = course.iter().filter(|moment| moment.at >= from).map(|moment| moment.rpm);
        let Some(first) = speeds.next() else { return false };
        speeds.all(|rpm| (rpm - first).abs() <= share * first)
    }

    /// When the node first reported this.
    pub fn when_reported(&self, engine: usize, what: impl Fn(Event) -> bool) -> Option<Nanos> {
        let events = self.events.borrow();
        events.iter().find(|(_, i, event)| *i == engine && what(*event)).map(|(at, ..)| *at)
    }

    /// The node has reported this.
    pub fn reported(&self, engine: usize, what: impl Fn(Event) -> bool) -> bool {
        self.when_reported(engine, what).is_some()
    }

    /// Number of times that the node has reported this since then.
    pub fn events_since(&self, engine: usize, since: Nanos, what: impl Fn(Event) -> bool) -> usize {
        let events = self.events.borrow();
        events.iter().filter(|(at, i, event)| *at >= since && *i == engine && what(*event)).count()
    }

    /// The node's last answer to a source, for people.
    pub fn answer_text(&self, engine: usize) -> String {
        match self.sources[engine].answer() {
            None => "no answer".to_owned(),
            Some(Ok(Accepted::InForce)) => "in force".to_owned(),
            Some(Ok(Accepted::Held)) => "held".to_owned(),
            Some(Ok(Accepted::StartWaits)) => "waits for another engine's start".to_owned(),
            Some(Ok(Accepted::RepeatStandby)) => "one more command".to_owned(),
            Some(Ok(Accepted::Behind(other))) => format!("behind {}", other.name()),
            Some(Ok(_)) => "accepted".to_owned(),
            Some(Err(why)) => why.to_string(),
        }
    }

    /// A time in seconds, or that it never came.
    pub fn or_never(&self, time: Option<Nanos>) -> String {
        time.map_or_else(|| "never".to_owned(), |time| format!("{:.2} s", time as f64 / 1e9))
    }
}
