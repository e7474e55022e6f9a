//! The player: carries out the requests of keys or a script file, keeps them with their engine time, and commands as the
//! source of each engine taken from its script. With a transmitter it moves stick and switch instead.

use super::super::context::{EngineContext, Notes, PilotInput, Stage};
use super::super::disturbances::By;
use super::super::node::{Cause, Node, Reset};
use super::super::radio::Transmitter;
use super::action::{Act, Action, Fault, Wish};
use super::judge::{Judge, Seen, Verdict};
use embassy_time::{Duration, Instant, Ticker};
use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::report::LinkState;
use jetlink::units::{Rpm, Throttle};
use sim::any::AnyEcu;
use sim::clock;
use sim::ecu::{MILLIS, Nanos};
use sim::receiver::Position;
use sim::wire::Plug;
use std::cell::{Cell, RefCell};
use std::future::poll_fn;
use std::task::Poll;

/// Between two commands; the source timeout of a bench is 0.5 s.
const TICK: Duration = Duration::from_millis(100);
/// Time for the watchdog to bite and the node to start.
const RESET: Reset = Reset { away: Duration::from_millis(1050), cause: Cause::Watchdog };
/// Time from a move of the switch to the second frame with it, which takes effect.
const STOP_BY_SWITCH: Nanos = 45 * MILLIS;
/// The whole way from idle to maximum, in tenths of a percent.
const WHOLE: u32 = 1000;

/// Without a hand-over channel.
const NO_HAND_OVER: &str = "there is no hand-over switch: --rc sbus,hand=7";

/// Event of a flame-out that cannot act.
pub const NO_FLAME: &str = "no flame burns that could go out";

/// The player's state of one engine, beyond its context.
#[derive(Debug, Default)]
struct Hand {
    /// Faults that last.
    faults: RefCell<Vec<Fault>>,
    /// An emergency stop that the node has not taken yet.
    stop: Cell<bool>,
    /// It should restart its script.
    restart: Cell<bool>,
    /// Something was done to it.
    touched: Cell<bool>,
    judge: RefCell<Judge>,
}

/// Plays on all engines.
#[derive(Debug)]
pub struct Player<'a> {
    node: &'a Node<'a>,
    contexts: &'a [EngineContext<'a>],
    plugs: &'a [Plug<AnyEcu>],
    notes: &'a Notes,
    /// The transmitter, if acts move it instead of commanding engines.
    transmitter: Option<&'a Transmitter>,
    /// A scenario flies until an emergency stop.
    scenario: bool,
    hands: Vec<Hand>,
    recorded: RefCell<Vec<(Instant, Action)>>,
    /// A key has done some of it.
    by_key: Cell<bool>,
}

impl<'a> Player<'a> {
    /// For these engines.
    pub fn new(
        node: &'a Node<'a>,
        contexts: &'a [EngineContext<'a>],
        plugs: &'a [Plug<AnyEcu>],
        notes: &'a Notes,
        transmitter: Option<&'a Transmitter>,
        scenario: bool,
    ) -> Self {
        let hands = contexts.iter().map(|_| Hand::default()).collect();
        Self {
            node,
            contexts,
            plugs,
            notes,
            transmitter,
            scenario,
            hands,
            recorded: RefCell::default(),
            by_key: Cell::new(false),
        }
    }

    /// Everything that was done, with its engine time.
    pub fn recorded(&self) -> Vec<(Instant, Action)> {
        self.recorded.borrow().clone()
    }

    /// Whether anything was done.
    pub fn is_played(&self) -> bool {
        !self.recorded.borrow().is_empty()
    }

    /// Whether a key has done any of it.
    pub const fn is_by_key(&self) -> bool {
        self.by_key.get()
    }

    /// Verdict on an engine that was played.
    pub fn verdict(&self, engine: usize) -> Option<Verdict> {
        let hand = self.hands.get(engine)?;
        hand.touched.get().then(|| hand.judge.borrow().verdict())
    }

    /// Faults that were set on this engine by hand and last.
    pub fn faults(&self, engine: usize) -> Vec<Fault> {
        self.hands.get(engine).map(|hand| hand.faults.borrow().clone()).unwrap_or_default()
    }

    /// Carries out the request of a key. `None`: for all engines.
    pub fn wish(&self, engine: Option<usize>, wish: Wish) {
        let before = self.recorded.borrow().len();
        self.carry_out(engine, wish);
        if self.recorded.borrow().len() > before {
            self.by_key.set(true);
        }
    }

    fn carry_out(&self, engine: Option<usize>, wish: Wish) {
        if let (Some(transmitter), Wish::Step(by)) = (self.transmitter, wish) {
            let stick = i32::from(transmitter.stick.get()) + i32::from(by);
            self.act(None, Act::Throttle(stick.clamp(0, WHOLE as i32) as u16));
            return;
        }
        if wish == Wish::HandOver {
            let over = self.transmitter.is_some_and(|transmitter| !transmitter.hands_over.get());
            self.act(None, Act::HandOver(over));
            return;
        }
        match (engine, wish) {
            (_, Wish::Toggle(Fault::Reset)) => self.act(None, Act::Fault(Fault::Reset, true)),
            (_, Wish::Act(act)) => self.act(engine, act),
            (Some(engine), _) => {
                if let Some(act) = self.resolved(engine, wish) {
                    self.act(Some(engine), act);
                }
            }
            (None, _) => (0..self.contexts.len()).for_each(|engine| self.carry_out(Some(engine), wish)),
        }
    }

    /// Does this, and records it. A fault that changes nothing is only noted: a script file with it is refused.
    pub fn act(&self, engine: Option<usize>, act: Act) {
        let concerned = engine.map_or(0..self.contexts.len(), |engine| engine..engine + 1);
        if let Act::Fault(fault, begins) = act
            && concerned.clone().all(|engine| self.cannot(engine, fault, begins).is_some())
        {
            concerned.for_each(|engine| self.act_on(engine, act));
            return;
        }
        self.recorded.borrow_mut().push((Instant::now(), Action { engine, act }));
        if act == Act::Fault(Fault::Reset, true) {
            self.notes.add(None, "played: the watchdog resets the node");
            self.hands.iter().for_each(|hand| {
                hand.touched.set(true);
            });
            self.node.reset(RESET);
            return;
        }
        if self.transmitter.is_some_and(|transmitter| self.moves(transmitter, act)) {
            return;
        }
        concerned.for_each(|engine| self.act_on(engine, act));
    }

    /// Moves the transmitter, which commands all engines. False: the act is not one of a transmitter.
    fn moves(&self, transmitter: &Transmitter, act: Act) -> bool {
        let to = |position: Position| {
            transmitter.switch.set(position);
            if position != Position::Stop {
                let now = clock::now_ns();
                self.hands.iter().for_each(|hand| hand.judge.borrow_mut().stop_ends(now, STOP_BY_SWITCH));
            }
            format!("the switch to {}", position.name())
        };
        let text = match act {
            Act::Arm | Act::Standby | Act::Release => to(Position::Standby),
            Act::Start => to(Position::Run),
            Act::Disarm | Act::EmergencyStop => {
                if transmitter.is_steady() {
                    for (context, hand) in self.contexts.iter().zip(&self.hands) {
                        let now = clock::now_ns();
                        hand.judge.borrow_mut().stop(now, STOP_BY_SWITCH, &context.audit.borrow());
                    }
                }
                to(Position::Stop)
            }
            Act::Throttle(tenths) => {
                transmitter.stick.set(tenths);
                format!("the stick to {}.{} %", tenths / 10, tenths % 10)
            }
            Act::HandOver(_) if !transmitter.has_hand_over() => NO_HAND_OVER.to_owned(),
            Act::HandOver(over) => {
                transmitter.hands_over.set(over);
                (if over { "handed over to the lower source" } else { "taken back" }).to_owned()
            }
            Act::Rpm(_) | Act::Script => format!("the transmitter has no `{}`", act.text()),
            Act::Fault(Fault::Silence, begins) => {
                transmitter.turn(!begins);
                for (context, hand) in self.contexts.iter().zip(&self.hands) {
                    context.silent.set(begins);
                    let mut faults = hand.faults.borrow_mut();
                    faults.retain(|&other| other != Fault::Silence);
                    faults.extend(begins.then_some(Fault::Silence));
                }
                format!("the transmitter {}", if begins { "off" } else { "on" })
            }
            Act::Fault(..) => return false,
        };
        self.notes.add(None, format!("played: {text}"));
        self.hands.iter().for_each(|hand| hand.touched.set(true));
        true
    }

    /// The act that a key means now.
    fn resolved(&self, engine: usize, wish: Wish) -> Option<Act> {
        let context = self.contexts.get(engine)?;
        match wish {
            Wish::Act(act) => Some(act),
            Wish::HandOver => None,
            Wish::Toggle(fault) => {
                let lasts = self.faults(engine).contains(&fault);
                if let Some(why) = self.cannot(engine, fault, fault.is_once() || !lasts) {
                    context.note(format!("played: {why}"));
                    return None;
                }
                Some(Act::Fault(fault, fault.is_once() || !lasts))
            }
            Wish::Step(by) => {
                let step = |from: u32, least: u32, most: u32| {
                    let by = i64::from(most - least) * i64::from(by) / i64::from(WHOLE);
                    (i64::from(from) + by).clamp(least.into(), most.into()) as u32
                };
                match context.input.get() {
                    PilotInput::Run(Demand::Throttle(now)) => {
                        Some(Act::Throttle(step(now.tenths().into(), 0, WHOLE) as u16))
                    }
                    PilotInput::Run(Demand::Rpm(now)) => {
                        let (least, most) = self.speeds(engine)?;
                        Some(Act::Rpm(step(now.get(), least, most.max(least))))
                    }
                    PilotInput::Standby => {
                        context.note("played: there is no demand in standby: start the engine first");
                        None
                    }
                }
            }
        }
    }

    /// Idle and maximum rpm, as the ECU reports them.
    fn speeds(&self, engine: usize) -> Option<(u32, u32)> {
        let report = self.node.telemetry(engine).report;
        Some((report.idle_rpm?.value.get(), report.max_rpm?.value.get()))
    }

    fn act_on(&self, engine: usize, act: Act) {
        let (Some(context), Some(hand)) = (self.contexts.get(engine), self.hands.get(engine)) else { return };
        context.note(format!("played: {}", act.in_words()));
        if let Act::Fault(fault, begins) = act
            && let Some(why) = self.cannot(engine, fault, begins)
        {
            context.note(why);
            return;
        }
        hand.touched.set(true);
        if act.takes_engine() && !self.scenario && !context.played.replace(true) {
            context.stage.set(Stage::Played);
        }
        match act {
            Act::Arm => self.command(engine, Command::Arm),
            Act::Disarm => {
                // It ends a start, whether the ECU follows it or not, but not a run.
                if !context.audit.borrow().is_known_to_run() {
                    context.standby_commanded(clock::now_ns(), Origin::Bench);
                }
                self.command(engine, Command::Disarm);
            }
            Act::Start => match self.idle(engine) {
                Some(idle) => context.input.set(PilotInput::Run(idle)),
                None => context.note("the ECU has not reported its speeds"),
            },
            Act::Standby => context.input.set(PilotInput::Standby),
            Act::Throttle(tenths) => {
                self.demand(context, Throttle::from_tenths(tenths).ok().map(Demand::Throttle))
            }
            Act::Rpm(rpm) => self.demand(context, Some(Demand::Rpm(Rpm::new(rpm)))),
            Act::EmergencyStop => {
                context.input.set(PilotInput::Standby);
                if self.scenario {
                    context.stopped.set(true);
                }
                hand.stop.set(true);
                hand.judge.borrow_mut().stop(clock::now_ns(), 0, &context.audit.borrow());
            }
            Act::Release => {
                hand.stop.set(false);
                // Only a latched stop becomes standby by it.
                if self.node.telemetry(engine).stop_latched {
                    let answer = self.order(engine, Command::ReleaseStop, Order::Standby);
                    if matches!(answer, Some(Ok(_))) {
                        hand.judge.borrow_mut().stop_released(clock::now_ns());
                    }
                } else {
                    self.command(engine, Command::ReleaseStop);
                }
            }
            Act::Script if hand.stop.get() || self.node.telemetry(engine).stop_latched => {
                let name = context.engine.name();
                context.note(format!("{name} stays played: {}", Rejected::StopLatched));
            }
            Act::Script => {
                context.input.set(PilotInput::Standby);
                context.played.set(false);
                hand.restart.set(true);
            }
            Act::HandOver(_) => context.note(NO_HAND_OVER),
            Act::Fault(fault, begins) => self.fault(engine, fault, begins),
        }
        if context.played.get() {
            self.command_again(engine);
        } else {
            self.stop_again(engine);
        }
    }

    /// Repeats a pending emergency stop. Returns whether there was one.
    fn stop_again(&self, engine: usize) -> bool {
        let Some(hand) = self.hands.get(engine).filter(|hand| hand.stop.get()) else { return false };
        let answer = self.order(engine, Command::EmergencyStop, Order::EmergencyStop);
        hand.stop.set(!matches!(answer, Some(Ok(_))));
        true
    }

    /// Commands the emergency stop of an engine of a scenario until the node has taken it.
    pub async fn stop_until_taken(&self, engine: usize) {
        let mut ticker = Ticker::every(TICK);
        loop {
            self.stop_again(engine);
            ticker.next().await;
        }
    }

    /// Changes the demand of an engine that is commanded to run.
    fn demand(&self, context: &EngineContext<'_>, demand: Option<Demand>) {
        match (context.input.get(), demand) {
            (PilotInput::Run(_), Some(demand)) => context.input.set(PilotInput::Run(demand)),
            _ => context.note("there is no demand in standby: start the engine first"),
        }
    }

    /// The demand of a run that would start this engine now.
    pub fn start_demand(&self, engine: usize) -> Option<Demand> {
        if let Some(transmitter) = self.transmitter {
            return Throttle::from_tenths(transmitter.stick.get()).ok().map(Demand::Throttle);
        }
        match self.contexts.get(engine)?.input.get() {
            PilotInput::Run(demand) => Some(demand),
            PilotInput::Standby => self.idle(engine),
        }
    }

    fn idle(&self, engine: usize) -> Option<Demand> {
        if self.contexts.get(engine)?.engine.by_rpm() {
            return Some(Demand::Rpm(Rpm::new(self.speeds(engine)?.0)));
        }
        Some(Demand::Throttle(Throttle::IDLE))
    }

    /// Why a fault cannot act now.
    fn cannot(&self, engine: usize, fault: Fault, begins: bool) -> Option<&'static str> {
        let burns =
            || self.plugs.get(engine).is_some_and(|plug| plug.ecu(|ecu| ecu.turbine().thrust() > 0.0));
        let lasts = self.faults(engine).contains(&fault);
        match fault {
            Fault::FlameOut if !burns() => Some(NO_FLAME),
            _ if fault.is_once() => None,
            _ if begins && lasts => Some("that lasts already"),
            _ if !begins && !lasts => Some("nothing of that kind lasts"),
            _ => None,
        }
    }

    fn fault(&self, engine: usize, fault: Fault, begins: bool) {
        let (Some(context), Some(plug), Some(hand)) =
            (self.contexts.get(engine), self.plugs.get(engine), self.hands.get(engine))
        else {
            return;
        };
        match fault {
            // Of the line.
            Fault::Cut | Fault::CutToEcu | Fault::CutToNode | Fault::Noise => {}
            Fault::Power => plug.power(!begins),
            Fault::Silence => context.silent.set(begins),
            Fault::FlameOut => plug.ecu(|ecu| ecu.turbine_mut().flame_out()),
            Fault::Reset => {}
        }
        if fault.is_once() {
            context.disturbances.borrow_mut().happens(Instant::now());
            return;
        }
        let mut faults = hand.faults.borrow_mut();
        faults.retain(|&other| other != fault);
        if begins {
            faults.push(fault);
        }
        // A silent source does not excuse a missed window.
        if fault != Fault::Silence {
            context.disturb(plug, By::Hand, fault, begins);
        }
    }

    /// Commands as the source of an engine that was taken from its script, until it is given back.
    pub async fn drive(&self, engine: usize) {
        let Some(context) = self.contexts.get(engine) else { return };
        let mut ticker = Ticker::every(TICK);
        while context.played.get() {
            self.command_again(engine);
            ticker.next().await;
        }
        // The next step restarts without this.
        if let Some(hand) = self.hands.get(engine) {
            hand.restart.set(false);
        }
    }

    /// Waits until this engine is taken from its script, or should restart it.
    pub async fn taken(&self, engine: usize) {
        // Whoever takes it shares a task with whoever waits.
        poll_fn(|_| match (self.contexts.get(engine), self.hands.get(engine)) {
            (Some(context), Some(hand)) if context.played.get() || hand.restart.take() => Poll::Ready(()),
            _ => Poll::Pending,
        })
        .await;
    }

    /// One command of the source.
    fn command_again(&self, engine: usize) {
        let Some(context) = self.contexts.get(engine) else { return };
        if self.stop_again(engine) {
            return;
        }
        if context.silent.get() {
            context.audit.borrow_mut().may_be_up_to(clock::now_ns(), None);
            return;
        }
        let input = context.input.get();
        if input == PilotInput::Standby && self.node.telemetry(engine).stop_latched {
            // A stream of standby would be refused ten times a second, and no key has requested it.
            self.command(engine, Command::Present);
            return;
        }
        let answer = self.order(engine, input.command(), input.order());
        let refused = matches!(
            answer,
            Some(Err(Rejected::Start(_)
                | Rejected::DisarmFirst
                | Rejected::StandbyFirst
                | Rejected::StopLatched))
        );
        if refused && matches!(input, PilotInput::Run(_)) {
            // The event gives the reason. Another attempt takes another key.
            context.input.set(PilotInput::Standby);
        }
    }

    /// An order to the node, and to the audit.
    fn order(&self, engine: usize, command: Command, order: Order) -> Option<Result<Accepted, Rejected>> {
        let at = clock::now_ns();
        let answer = self.node.command(engine, command, Origin::Bench)?;
        if let Some(context) = self.contexts.get(engine) {
            context.judge(at, order, Origin::Bench, answer);
        }
        Some(answer)
    }

    /// A command that orders nothing.
    fn command(&self, engine: usize, command: Command) {
        let _ = self.node.command(engine, command, Origin::Bench); // a refusal is an event
    }

    /// Whether something may start this engine. Not every source of a scenario is its pilot, until it is stopped.
    fn commands_run(&self, context: &EngineContext<'_>) -> bool {
        if self.scenario { !context.stopped.get() } else { matches!(context.input.get(), PilotInput::Run(_)) }
    }

    /// Checks all engines, ten times a second.
    pub fn look(&self) {
        for (i, ((context, plug), hand)) in self.contexts.iter().zip(self.plugs).zip(&self.hands).enumerate()
        {
            if self.transmitter.is_some_and(|transmitter| !transmitter.is_on()) {
                context.audit.borrow_mut().may_be_up_to(clock::now_ns(), None);
            }
            if self.transmitter.is_some_and(|transmitter| transmitter.hands_over.get())
                && let PilotInput::Run(demand) = context.input.get()
            {
                // Down to idle, or to the lower source's command.
                context.audit.borrow_mut().may_be_up_to(clock::now_ns(), Some(demand));
            }
            let (counts, ignitions) =
                plug.ecu(|ecu| (ecu.counts(), ecu.turbine().history().ignitions.clone()));
            hand.judge.borrow_mut().look(&Seen {
                at: Instant::now(),
                commands_run: self.commands_run(context),
                explained: context.disturbances.borrow().explain(Instant::now()),
                link_up: self.node.telemetry(i).link == LinkState::Up,
                counts,
                ignitions: &ignitions,
                audit: &context.audit.borrow(),
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_documentation_has_what_a_stop_by_switch_is_allowed() {
        let allowed = format!("The judge allows a stop {} ms more", STOP_BY_SWITCH / MILLIS);
        assert!(include_str!("../../../../docs/rig.md").contains(&allowed), "{allowed}");
    }
}
