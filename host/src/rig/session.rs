//! The run itself: the node's runners, the lines with the ECUs, the pilots and the samples, all in one
//! thread on the clock of the simulation.

use super::context::{EngineContext, Notes, Stage, look};
use super::control::{Control, Situation};
use super::disturbances::By;
use super::engines::Engine;
use super::faults::{Failure, Faults};
use super::mavlink::Mavlink;
use super::message::Message;
use super::node::{Node, Reset};
use super::outcome::{End, Outcome, Outcomes};
use super::pilot::Pilot;
use super::plan::{EnginePlan, FlownBy, Plan};
use super::play::action::Fault;
use super::play::player::{NO_FLAME, Player};
use super::radio::Radio;
use super::sample::{Detail, SAMPLE_EVERY, Sample};
use super::scenario::{Scenario, ScenarioContext};
use super::simulated::{ecu, line};
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Ticker, Timer};
use jetlink::channel::Events;
#[cfg(test)]
use jetlink::command::Command;
use jetlink::command::{Order, Ordered, Origin, Rejected};
use jetlink::event::End as LifeEnd;
use jetlink::event::Event;
use jetlink::limit::{LimitKind, LimitViolation};
use jetlink::runner::LineErrors;
use jetlink::telemetry::Telemetry;
use jetlink_rc::outputs::Valve;
use sim::any::AnyEcu;
use sim::clock;
use sim::wire::{Faults as LineFaults, Plug};
use std::cell::{Cell, RefCell};
use std::future::poll_fn;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::Pin;
use std::task::Poll;

/// Time after the last pilot is done, for bytes still on their way.
const AFTERWARDS: Duration = Duration::from_millis(500);

/// Time between two updates of the valves.
const VALVES_EVERY: Duration = Duration::from_millis(20);

/// Everything that is decided before a run.
#[derive(Debug)]
pub struct Setup {
    /// The engines.
    pub engines: Vec<Engine>,
    /// When each is started and shut down.
    pub plan: Plan,
    /// Faults.
    pub faults: Faults,
    /// Scenario, in place of the pilots.
    pub scenario: Option<&'static Scenario>,
    /// Seed for all random numbers.
    pub seed: u64,
    /// As fast as the machine allows, instead of in real time.
    pub fast: bool,
    /// Whether a view shows every detail, including the bytes on the wires.
    pub details: bool,
    /// Ports of MAVLink, in place of the pilots.
    pub mavlink: Option<Mavlink>,
    /// A receiver of radio control, in place of the pilots.
    pub radio: Option<Radio>,
    /// Each engine has a fuel valve that cuts its fuel.
    pub valves: bool,
    /// Multiple of the speed of the wall clock.
    pub speed: u32,
    /// Panic at this engine time: to test the state after a panic.
    pub panic_at: Option<Duration>,
    /// Unsolicited command to the first engine's node: to test the judges.
    #[cfg(test)]
    pub uncommanded: Vec<(Duration, Command)>,
}

impl Setup {
    /// Whether MAVLink or radio control commands, and no pilot flies.
    pub const fn is_commanded(&self) -> bool {
        self.mavlink.is_some() || self.radio.is_some()
    }

    /// The source that would start this engine.
    fn origin(&self, context: &EngineContext<'_>) -> Origin {
        match (&self.mavlink, &self.radio) {
            _ if context.played.get() => Origin::Bench,
            (Some(_), _) => Origin::Mavlink,
            (None, Some(_)) => Origin::Rc,
            (None, None) => Origin::Bench,
        }
    }

    /// Whether a script file of the actions replays the run: nothing comes from outside or from a scenario.
    pub fn plays_again(&self) -> bool {
        self.scenario.is_none()
            && self.mavlink.is_none()
            && self.radio.as_ref().is_none_or(|radio| radio.transmitter().is_some())
    }
}

/// What the pilot of an engine did not reach; `None` as long as it flies.
type Flown = RefCell<Option<Result<(), String>>>;
type Task<'a> = Pin<Box<dyn Future<Output = ()> + 'a>>;

/// Runs the session. `control` steers it; `show` gets everything to show, and returns whether to continue.
pub fn run(setup: &Setup, control: &mut dyn Control, mut show: impl FnMut(Message) -> bool) -> Outcomes {
    clock::reset();
    clock::set_pace(if setup.fast { clock::Pace::Unlimited } else { clock::Pace::Times(setup.speed) });

    let notes = Notes::default();
    let mut seeds = fastrand::Rng::with_seed(setup.seed);
    let node = Node::new(&setup.engines, setup.valves);
    let context = |(i, engine)| EngineContext::new(i, engine, setup.faults.line_clean_from(i), &notes);
    let contexts: Vec<EngineContext<'_>> = setup.engines.iter().enumerate().map(context).collect();
    let plug = |engine: &Engine| {
        // The node gets its halves when it starts.
        let (_, _, plug) = sim::wire::connect(ecu(engine), line(engine), seeds.u64(..));
        plug.record(true);
        plug
    };
    let plugs: Vec<Plug<AnyEcu>> = setup.engines.iter().map(plug).collect();
    if setup.details {
        contexts.iter().for_each(|context| context.tap.borrow_mut().open());
    }
    let name = setup.scenario.map_or("", |scenario| scenario.name);
    let scenario_context = ScenarioContext::new(&node, &contexts, &plugs, &notes, name);
    let transmitter = setup.radio.as_ref().and_then(Radio::transmitter);
    let player = Player::new(&node, &contexts, &plugs, &notes, transmitter, setup.scenario.is_some());
    let flown: Vec<Flown> = setup.engines.iter().map(|_| RefCell::new(None)).collect();
    let world = World {
        setup,
        node: &node,
        contexts: &contexts,
        plugs: &plugs,
        notes: &notes,
        scenario_context: &scenario_context,
        player: &player,
        flown: &flown,
    };

    let end = RefCell::new(End::Complete);
    let tasks = world.tasks(&mut seeds);
    let until_end = until_done(
        async {
            end.replace(world.watch(control, &mut show).await);
        },
        tasks,
    );
    let run = || wired::run(std::pin::pin!(world.with_node(until_end)));
    // The observations up to a panic still get a summary. Then nothing runs any more.
    if let Err(panic) = catch_unwind(AssertUnwindSafe(run)) {
        let message = panic.downcast_ref::<&str>().map(|&message| message.to_owned());
        let message = message.or_else(|| panic.downcast_ref::<String>().cloned());
        end.replace(End::Panicked(message.unwrap_or_default()));
    }
    look(&contexts, &plugs);
    contexts.iter().for_each(|context| context.note_hidden(true));
    for message in notes.take().into_iter().map(Message::from) {
        show(message);
    }

    world.outcomes(end.into_inner())
}

/// Everything that survives a reset of the node.
struct World<'a> {
    setup: &'a Setup,
    node: &'a Node<'a>,
    contexts: &'a [EngineContext<'a>],
    plugs: &'a [Plug<AnyEcu>],
    notes: &'a Notes,
    scenario_context: &'a ScenarioContext<'a>,
    player: &'a Player<'a>,
    flown: &'a [Flown],
}

impl<'a> World<'a> {
    /// The tasks that continue when the node is reset.
    fn tasks(&'a self, seeds: &mut fastrand::Rng) -> Vec<Task<'a>> {
        let mut tasks: Vec<Task<'_>> = self.plugs.iter().map(wired::line).collect();
        if let Some(scenario) = self.setup.scenario {
            for i in 0..self.contexts.len() {
                tasks.push(Box::pin(clock::task(self.scenario_context.sit(i))));
            }
            for i in 0..self.contexts.len() {
                tasks.push(Box::pin(clock::task(self.player.stop_until_taken(i))));
            }
            let script = scenario.script(self.scenario_context);
            tasks.push(Box::pin(async move {
                let result = script.await;
                for flown in self.flown {
                    flown.replace(Some(result.clone()));
                }
            }));
        } else if self.setup.is_commanded() {
            for context in self.contexts {
                // An outside source may fall silent at any time.
                if !self.setup.plays_again() {
                    context.audit.borrow_mut().judge_no_orders();
                }
                tasks.push(Box::pin(self.commanded(context)));
            }
        } else {
            for ((context, plan), flown) in self.contexts.iter().zip(&self.setup.plan.engines).zip(self.flown)
            {
                tasks.push(Box::pin(self.piloted(context, *plan, flown, seeds.u64(..))));
            }
        }
        #[cfg(test)]
        tasks.push(Box::pin(clock::task(async {
            for &(at, command) in &self.setup.uncommanded {
                Timer::at(Instant::MIN + at).await;
                let _ = self.node.command(0, command, Origin::Bench);
            }
        })));
        tasks.push(Box::pin(clock::task(disturb(self.setup, self.contexts, self.plugs, self.notes))));
        if self.setup.valves {
            tasks.push(Box::pin(clock::task(drive_valves(self.node, self.contexts, self.plugs))));
        }
        tasks
    }

    /// MAVLink or the transmitter commands the engine, and otherwise only a person at the keyboard.
    async fn commanded(&self, context: &EngineContext<'_>) {
        loop {
            context.stage.set(Stage::Commanded);
            self.player.taken(context.index).await;
            self.player.drive(context.index).await;
        }
    }

    /// A pilot flies the engine, until a person takes it.
    async fn piloted(&self, context: &EngineContext<'_>, plan: EnginePlan, flown: &Flown, seed: u64) {
        let in_standby = self.setup.plan.flown_by == FlownBy::PilotsInStandby;
        loop {
            let mut pilot = Pilot::new(context, self.node, plan, in_standby, &self.setup.faults, seed);
            match select(clock::task(pilot.fly()), self.player.taken(context.index)).await {
                Either::First(result) => {
                    flown.replace(Some(result));
                    select(clock::task(pilot.stay()), self.player.taken(context.index)).await;
                }
                Either::Second(()) => {}
            }
            flown.take();
            context.failure.take();
            self.player.drive(context.index).await;
        }
    }

    /// Shows samples and lets `control` steer, until the run ends.
    async fn watch(&self, control: &mut dyn Control, show: &mut dyn FnMut(Message) -> bool) -> End {
        let mut ticker = Ticker::every(SAMPLE_EVERY);
        let (mut all_done_at, mut shown_complete, mut shown_over) = (None, false, false);
        loop {
            assert!(
                self.setup.panic_at.is_none_or(|at| Instant::now() - Instant::MIN < at),
                "the moment of --panic-at"
            );
            let (samples, details) = self.sample();
            let message = Message::Samples { at: Instant::now(), samples: samples.clone(), details };
            if !self.notes.take().into_iter().map(Message::from).chain([message]).all(&mut *show) {
                return self.ended(shown_complete, shown_over);
            }

            let done = self.flown.iter().all(|flown| flown.borrow().is_some()) && !self.is_played();
            if !done {
                all_done_at = None;
            }
            let complete = self.timed_out()
                || done && {
                    let end = *all_done_at.get_or_insert(Instant::now() + AFTERWARDS);
                    Instant::now() >= end
                };
            if complete && !shown_complete {
                show(Message::Complete(Box::new(self.outcomes(self.ended(true, false)))));
            }
            shown_complete = complete;
            loop {
                let played = self.is_played();
                let turn =
                    control.turn(&Situation { at: Instant::now(), samples: &samples, complete, played });
                if let Some(pace) = turn.pace {
                    clock::set_pace(pace);
                }
                turn.scripted.into_iter().for_each(|action| self.player.act(action.engine, action.act));
                turn.wishes.into_iter().for_each(|(engine, wish)| self.player.wish(engine, wish));
                let passing = turn.passing.map(Message::Passing);
                let continues =
                    self.notes.take().into_iter().map(Message::from).chain(passing).all(&mut *show);
                if turn.end || !continues {
                    return self.ended(complete, turn.over);
                }
                if turn.over && !shown_over {
                    show(Message::Complete(Box::new(self.outcomes(self.ended(complete, true)))));
                }
                shown_over = turn.over;
                if !turn.again {
                    break;
                }
            }
            ticker.next().await;
        }
    }

    /// Samples of each engine to show now; its details only if a view shows them.
    fn sample(&self) -> (Vec<Sample>, Vec<Detail>) {
        look(self.contexts, self.plugs);
        let telemetry: Vec<Telemetry> = (0..self.contexts.len()).map(|i| self.node.telemetry(i)).collect();
        for (context, telemetry) in self.contexts.iter().zip(&telemetry) {
            context.watch_recovery(telemetry);
            context.note_hidden(false);
        }
        self.player.look();
        let samples = self.contexts.iter().zip(&telemetry).map(|(context, telemetry)| {
            let outputs = self.setup.valves.then(|| self.node.outputs(context.index));
            let ecu = self.plugs.get(context.index).map(|plug| plug.ecu(|ecu| ecu.counts()));
            Sample {
                missed_at_ecu: ecu.map_or(0, |ecu| ecu.late + ecu.unanswered),
                valve_open: outputs.map(|outputs| outputs.valve() == Valve::Open),
                power: outputs.map(|outputs| outputs.power()),
                ..Sample::take(context, telemetry, self.node.is_up())
            }
        });
        let samples = samples.collect();
        let details = self.contexts.iter().zip(telemetry).filter(|_| self.setup.details);
        (samples, details.map(|(context, telemetry)| self.detail(context, telemetry)).collect())
    }

    fn detail(&self, context: &EngineContext<'_>, telemetry: Telemetry) -> Detail {
        let engine = context.index;
        let start_demand = self.player.start_demand(engine).filter(|_| self.setup.mavlink.is_none());
        let origin = self.setup.origin(context);
        Detail {
            telemetry,
            config: self.node.config(engine),
            start_demand,
            start_refusals: self.node.start_refusals(engine, start_demand, origin),
            violations: context.violations.borrow().clone(),
            outputs: self.node.outputs(engine),
            entries: context.tap.borrow_mut().take(),
            faults: self.player.faults(engine),
        }
    }

    /// Whether a person has taken an engine.
    fn is_played(&self) -> bool {
        self.contexts.iter().any(|context| context.played.get())
    }

    /// Without pilots, the time ends the run.
    fn timed_out(&self) -> bool {
        self.setup.is_commanded()
            && self.setup.plan.length.is_some_and(|length| Instant::now() >= Instant::MIN + length)
    }

    fn ended(&self, complete: bool, over: bool) -> End {
        match self.setup.is_commanded() {
            false if complete => End::Complete,
            // A played run has no time of its own.
            _ if self.player.is_played() => End::Complete,
            _ if complete || over => End::Over,
            _ => End::Interrupted,
        }
    }

    fn outcomes(&self, end: End) -> Outcomes {
        let engines = self.contexts.iter().zip(self.plugs).zip(self.flown);
        Outcomes {
            engines: engines.map(|((context, plug), flown)| self.outcome(context, plug, flown)).collect(),
            length: Instant::now() - Instant::MIN,
            end,
            checks: self.scenario_context.checks(),
            bad_commands: self.setup.scenario.map_or(0, |scenario| scenario.bad_commands),
            actions: self.player.recorded(),
            by_key: self.player.is_by_key(),
            reception: self.setup.radio.as_ref().map(Radio::reception),
            is_scenario: self.setup.scenario.is_some(),
        }
    }

    fn outcome(&self, context: &EngineContext<'_>, plug: &Plug<AnyEcu>, flown: &Flown) -> Outcome {
        let telemetry = self.node.telemetry(context.index);
        let flown = flown.borrow().clone();
        Outcome {
            has_pilot: !self.setup.is_commanded(),
            name: context.engine.name(),
            has_reply_window: context.engine.ecu.protocol().has_reply_window(),
            // A pilot that has given up still waits for its engine to cool.
            flown: flown.or_else(|| context.failure.borrow().clone().map(Err)),
            played: self.player.verdict(context.index),
            node: telemetry.counters,
            commands_rejected: telemetry.counters.commands_rejected,
            link: telemetry.link,
            ecu: plug.ecu(|ecu| ecu.counts()),
            audit: context.audit.borrow().clone(),
            stops: context.stops.get(),
            recovered_after: context.recovered_after.get(),
            // The script of a scenario judges its lines itself.
            line_was_clean: self.setup.faults.line_is_clean(context.index) && self.setup.scenario.is_none(),
            is_live: plug.ecu(|ecu| ecu.turbine().phase().is_live()),
        }
    }

    /// Runs the node until `until_end` is done, and starts it again whenever it is reset: then its tasks and channels
    /// are dropped, and only its retained memory is left.
    async fn with_node(&self, until_end: impl Future<Output = ()>) {
        let mut until_end = std::pin::pin!(until_end);
        loop {
            let Some(reset) = self.one_life(until_end.as_mut()).await else { return };
            // From here on there is no channel: neither the tasks of that life nor the node holds one.
            look(self.contexts, self.plugs);
            self.node.gone(reset);
            for (context, plug) in self.contexts.iter().zip(self.plugs) {
                let _ = plug.reset_node();
                context.audit.borrow_mut().reset(clock::now_ns());
                context.disturb(plug, By::Node, Fault::Reset, true);
            }
            match select(Timer::after(reset.away), until_end.as_mut()).await {
                Either::First(()) => {}
                Either::Second(()) => return,
            }
            for (context, plug) in self.contexts.iter().zip(self.plugs) {
                context.disturb(plug, By::Node, Fault::Reset, false);
            }
        }
    }

    /// The node from its start to its reset; `None` at the end of the run.
    async fn one_life(&self, until_end: Pin<&mut impl Future<Output = ()>>) -> Option<Reset> {
        let channels = self.node.boot();
        self.notes
            .add(None, "the node has started: it listens to the engines before it obeys run or standby");
        let errors: Vec<LineErrors> = channels.iter().map(|_| LineErrors::new()).collect();
        let receiver = self.setup.radio.as_ref().map(|radio| radio.begin(self.node, &channels));
        let mut tasks: Vec<Task<'_>> = Vec::new();
        for (((channel, context), plug), errors) in
            channels.iter().zip(self.contexts).zip(self.plugs).zip(&errors)
        {
            let (rx, tx) = plug.reset_node();
            // The subscribers first: no command may come before events are received.
            if let Some(events) = channel.handle().events() {
                tasks.push(Box::pin(clock::task(listen(events, context, plug, self.scenario_context))));
            }
            tasks.push(wired::runner(channel.runner_in(&channels), rx, tx, errors));
        }
        let radio = self.setup.radio.as_ref().zip(receiver.as_ref());
        if let Some(mavlink) = &self.setup.mavlink {
            tasks.push(Box::pin(mavlink.serve(self.node, &channels, radio)));
        }
        if let Some((radio, receiver)) = radio {
            tasks.push(Box::pin(radio.serve(receiver, self.contexts)));
        }
        let reset = Cell::new(None);
        let away = async { reset.set(Some(self.node.wanted().await)) };
        match select(until_done(away, tasks), until_end).await {
            Either::First(()) => reset.take(),
            Either::Second(()) => None,
        }
    }
}

/// Follows the outputs, notes their changes, and cuts the fuel of an engine whose valve is closed.
async fn drive_valves(node: &Node<'_>, contexts: &[EngineContext<'_>], plugs: &[Plug<AnyEcu>]) {
    let mut ticker = Ticker::every(VALVES_EVERY);
    loop {
        for (engine, change) in node.take_changes() {
            if let Some(context) = contexts.get(engine) {
                context.note(change.to_string());
            }
        }
        for (i, plug) in plugs.iter().enumerate() {
            if node.outputs(i).valve() == Valve::Closed {
                plug.ecu(|ecu| {
                    let turbine = ecu.turbine_mut();
                    if turbine.thrust() > 0.0 {
                        turbine.flame_out();
                    }
                });
            }
        }
        ticker.next().await;
    }
}

/// Polls `first` and all tasks in their order, until `first` is done.
async fn until_done(first: impl Future<Output = ()>, mut tasks: Vec<Task<'_>>) {
    let mut first = std::pin::pin!(first);
    poll_fn(|cx| {
        for task in &mut tasks {
            // Ended tasks are taken out, so none is polled after its end.
            let _ = task.as_mut().poll(cx).map(|()| *task = Box::pin(std::future::pending()));
        }
        match first.as_mut().poll(cx) {
            Poll::Ready(()) => Poll::Ready(()),
            Poll::Pending => Poll::Pending,
        }
    })
    .await;
}

/// Notes the node's events. The audit compares the node's own orders with the simulated engine.
async fn listen(
    mut events: Events<'_>,
    context: &EngineContext<'_>,
    plug: &Plug<AnyEcu>,
    scenario_context: &ScenarioContext<'_>,
) {
    loop {
        let event = match events.next_message().await {
            embassy_sync::pubsub::WaitResult::Message(event) => event,
            embassy_sync::pubsub::WaitResult::Lagged(missed) => {
                let events = if missed == 1 { "event was" } else { "events were" };
                context.note(format!("{missed} {events} missed"));
                continue;
            }
        };
        scenario_context.note_event(context.index, event);
        if let Event::Limit(violation) = event {
            context.violated(violation);
        }
        let by_itself =
            matches!(event, Event::Ordered(Ordered { order: Order::Standby, origin: Origin::Node }));
        if let Event::Ordered(Ordered { order: Order::Standby, origin }) = event {
            context.standby_of(clock::now_ns(), origin);
        }
        let given_up = event == Event::RunCancelled(LifeEnd::Unconfirmed);
        if by_itself || given_up {
            let (now, phase) = (clock::now_ns(), plug.ecu(|ecu| ecu.turbine().phase()));
            context.take_log(plug);
            let mut audit = context.audit.borrow_mut();
            if given_up {
                audit.given_up(now);
            } else {
                audit.cancelled(now, phase);
            }
        }
        let Some(text) = text(event) else { continue };
        if may_be_many(event) {
            context.note_limited(text);
        } else {
            context.note(text);
        }
    }
}

/// Whether noise, or a source that repeats its command, can bring any number of these, and none of them reports a danger.
const fn may_be_many(event: Event) -> bool {
    matches!(
        event,
        Event::CommandRejected(..)
            | Event::EngineIdentified(_)
            | Event::EngineUnknown
            | Event::VersionKnown(_)
            | Event::RateConfirmed(_)
            | Event::RateNotConfirmed(_)
    )
}

/// The library's sentence of an event; `None`: it is printed elsewhere, or only counted.
fn text(event: Event) -> Option<String> {
    match event {
        // That it listens is printed once, when it starts.
        Event::CommandRejected(Rejected::Listening, _) => None,
        // The fault itself is reported by its name.
        Event::Limit(LimitViolation { kind: LimitKind::EcuFault, .. }) => None,
        // Orders are the pilot's own, what was not sent is counted, and service commands are not given.
        Event::Ordered(Ordered { order, .. }) if order != Order::EmergencyStop => None,
        Event::NotSent(_) | Event::ServiceSent(_) | Event::ServiceConfirmed(_) | Event::ServiceFailed(_) => {
            None
        }
        other => Some(other.to_string()),
    }
}

/// Switches the faults on and off.
async fn disturb(setup: &Setup, contexts: &[EngineContext<'_>], plugs: &[Plug<AnyEcu>], notes: &Notes) {
    enum Change {
        Line(LineFaults),
        Cut(usize, bool),
        Fail(usize, Failure),
    }
    let faults = &setup.faults;
    let mut changes = Vec::new();
    if faults.on_lines() {
        changes.push((faults.from, Change::Line(faults.line)));
        changes.extend(faults.until.map(|until| (until, Change::Line(LineFaults::default()))));
    }
    for cut in &faults.cuts {
        changes.push((cut.at, Change::Cut(cut.engine, true)));
        changes.push((cut.at + cut.length, Change::Cut(cut.engine, false)));
    }
    for &(engine, failure) in &faults.failures {
        let at = if let Failure::FlameOut(at) = failure { at } else { Duration::MIN };
        changes.push((at, Change::Fail(engine, failure)));
    }
    changes.sort_by_key(|&(at, _)| at);
    for (at, change) in changes {
        Timer::at(Instant::MIN + at).await;
        match change {
            Change::Line(line) => {
                for (context, plug) in contexts.iter().zip(plugs) {
                    context.plan_faults(plug, line);
                }
                let on = line != LineFaults::default();
                notes.add(None, if on { "faults on all lines begin" } else { "faults on all lines end" });
            }
            Change::Cut(engine, cut) => {
                if let (Some(context), Some(plug)) = (contexts.get(engine), plugs.get(engine)) {
                    context.disturb(plug, By::Plan, Fault::Cut, cut);
                }
                notes.add(Some(engine), if cut { "the line is cut" } else { "the line is joined again" });
            }
            Change::Fail(engine, failure) => {
                let Some(plug) = plugs.get(engine) else { continue };
                let what = plug.ecu(|ecu| {
                    let turbine = ecu.turbine_mut();
                    match failure {
                        Failure::HotStart => {
                            turbine.hot_start(true);
                            "every start will be hot"
                        }
                        Failure::NoLight => {
                            turbine.no_light(true);
                            "no start will light"
                        }
                        Failure::FlameOut(_) if turbine.thrust() > 0.0 => {
                            turbine.flame_out();
                            "the flame goes out"
                        }
                        Failure::FlameOut(_) => NO_FLAME,
                    }
                });
                notes.add(Some(engine), what);
            }
        }
    }
}
