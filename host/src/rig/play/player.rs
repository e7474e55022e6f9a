//! Plays: does what keys or a script file ask for, keeps it with its engine time, and speaks for the source of each engine
//! that was taken from its script.

use super::super::context::{EngineContext, Notes, PilotInput, Stage};
use super::super::faults::Faults;
use super::super::node::{Cause, Node, Reset};
use super::super::simulated::counts;
use super::action::{Act, Action, Fault, Wish};
use super::judge::{Judge, Seen, Verdict};
use embassy_time::{Duration, Instant, Ticker};
use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::report::LinkState;
use jetlink::units::{Rpm, Throttle};
use sim::any::AnyEcu;
use sim::clock;
use sim::wire::{Faults as LineFaults, Plug};
use std::cell::{Cell, RefCell};
use std::future::poll_fn;
use std::task::Poll;

/// Between two commands; the source timeout of a bench is 0.5 s.
const TICK: Duration = Duration::from_millis(100);
/// What a watchdog takes to bite, and the node to start.
const RESET: Reset = Reset { away: Duration::from_millis(1050), cause: Cause::Watchdog };
/// The whole way from idle to maximum, in tenths of a percent.
const WHOLE: u32 = 1000;

/// What is known of one engine beyond its desk.
#[derive(Debug, Default)]
struct Hand {
    /// Faults that last.
    faults: RefCell<Vec<Fault>>,
    /// An emergency stop that the node has not taken yet.
    stop: Cell<bool>,
    /// Something was done to it.
    touched: Cell<bool>,
    judge: RefCell<Judge>,
}

/// Plays on all engines.
#[derive(Debug)]
pub struct Player<'a> {
    node: &'a Node<'a>,
    desks: &'a [EngineContext<'a>],
    plugs: &'a [Plug<AnyEcu>],
    notes: &'a Notes,
    hands: Vec<Hand>,
    kept: RefCell<Vec<(Instant, Action)>>,
}

impl<'a> Player<'a> {
    /// For these engines.
    pub fn new(
        node: &'a Node<'a>,
        desks: &'a [EngineContext<'a>],
        plugs: &'a [Plug<AnyEcu>],
        notes: &'a Notes,
    ) -> Self {
        let hands = desks.iter().map(|_| Hand::default()).collect();
        Self { node, desks, plugs, notes, hands, kept: RefCell::default() }
    }

    /// Everything that was done, with its engine time.
    pub fn kept(&self) -> Vec<(Instant, Action)> {
        self.kept.borrow().clone()
    }

    /// Whether anything was done.
    pub fn is_played(&self) -> bool {
        !self.kept.borrow().is_empty()
    }

    /// What was found of an engine that something was done to.
    pub fn verdict(&self, engine: usize) -> Option<Verdict> {
        let hand = self.hands.get(engine)?;
        hand.touched.get().then(|| hand.judge.borrow().verdict())
    }

    /// Whether a fault of the line, the ECU or the node was set on this engine by hand.
    pub fn faults(&self, engine: usize) -> Vec<Fault> {
        self.hands.get(engine).map(|hand| hand.faults.borrow().clone()).unwrap_or_default()
    }

    /// Does what is wished for. `None`: for all engines.
    pub fn wish(&self, engine: Option<usize>, wish: Wish) {
        match (engine, wish) {
            (_, Wish::Toggle(Fault::Reset)) => self.act(None, Act::Fault(Fault::Reset, true)),
            (_, Wish::Act(act)) => self.act(engine, act),
            (Some(engine), _) => {
                if let Some(act) = self.resolved(engine, wish) {
                    self.act(Some(engine), act);
                }
            }
            (None, _) => (0..self.desks.len()).for_each(|engine| self.wish(Some(engine), wish)),
        }
    }

    /// Does this, and keeps it.
    pub fn act(&self, engine: Option<usize>, act: Act) {
        self.kept.borrow_mut().push((Instant::now(), Action { engine, act }));
        if act == Act::Fault(Fault::Reset, true) {
            self.notes.add(None, "played: the watchdog resets the node");
            self.hands.iter().for_each(|hand| {
                hand.touched.set(true);
                hand.judge.borrow_mut().fault(Instant::now(), true);
                hand.judge.borrow_mut().fault(Instant::now(), false);
            });
            self.node.reset(RESET);
            return;
        }
        match engine {
            Some(engine) => self.act_on(engine, act),
            None => (0..self.desks.len()).for_each(|engine| self.act_on(engine, act)),
        }
    }

    /// The act that a key means now.
    fn resolved(&self, engine: usize, wish: Wish) -> Option<Act> {
        let desk = self.desks.get(engine)?;
        match wish {
            Wish::Act(act) => Some(act),
            Wish::Toggle(fault) => {
                let lasts = self.faults(engine).contains(&fault);
                Some(Act::Fault(fault, fault.is_once() || !lasts))
            }
            Wish::Step(by) => {
                let step = |from: u32, least: u32, most: u32| {
                    let by = i64::from(most - least) * i64::from(by) / i64::from(WHOLE);
                    (i64::from(from) + by).clamp(least.into(), most.into()) as u32
                };
                match desk.input.get() {
                    PilotInput::Run(Demand::Throttle(now)) => {
                        Some(Act::Throttle(step(now.tenths().into(), 0, WHOLE) as u16))
                    }
                    PilotInput::Run(Demand::Rpm(now)) => {
                        let (least, most) = self.speeds(engine)?;
                        Some(Act::Rpm(step(now.get(), least, most.max(least))))
                    }
                    PilotInput::Standby => {
                        desk.note("played: there is no demand in standby: start the engine first");
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
        let (Some(desk), Some(hand)) = (self.desks.get(engine), self.hands.get(engine)) else { return };
        hand.touched.set(true);
        desk.note(format!("played: {}", act.text()));
        if act.takes_engine() && !desk.played.replace(true) {
            desk.stage.set(Stage::Played);
        }
        match act {
            Act::Arm => self.tell(engine, Command::Arm),
            Act::Disarm => self.tell(engine, Command::Disarm),
            Act::Start => match self.idle(engine) {
                Some(idle) => desk.input.set(PilotInput::Run(idle)),
                None => desk.note("the ECU has not reported its speeds"),
            },
            Act::Standby => desk.input.set(PilotInput::Standby),
            Act::Throttle(tenths) => {
                self.demand(desk, Throttle::from_tenths(tenths).ok().map(Demand::Throttle))
            }
            Act::Rpm(rpm) => self.demand(desk, Some(Demand::Rpm(Rpm::new(rpm)))),
            Act::EmergencyStop => {
                desk.input.set(PilotInput::Standby);
                hand.stop.set(true);
                hand.judge.borrow_mut().stop(clock::now_ns(), &desk.audit.borrow());
            }
            Act::Release => {
                hand.stop.set(false);
                self.order(engine, Command::ReleaseStop, Order::Standby);
            }
            Act::Script => {
                desk.input.set(PilotInput::Standby);
                desk.played.set(false);
            }
            Act::Fault(fault, begins) => self.fault(engine, fault, begins),
        }
        if desk.played.get() {
            self.speak(engine);
        }
    }

    /// Changes the demand of an engine that is commanded to run.
    fn demand(&self, desk: &EngineContext<'_>, demand: Option<Demand>) {
        match (desk.input.get(), demand) {
            (PilotInput::Run(_), Some(demand)) => desk.input.set(PilotInput::Run(demand)),
            _ => desk.note("there is no demand in standby: start the engine first"),
        }
    }

    fn idle(&self, engine: usize) -> Option<Demand> {
        if self.desks.get(engine)?.engine.by_rpm() {
            return Some(Demand::Rpm(Rpm::new(self.speeds(engine)?.0)));
        }
        Some(Demand::Throttle(Throttle::IDLE))
    }

    fn fault(&self, engine: usize, fault: Fault, begins: bool) {
        let (Some(desk), Some(plug), Some(hand)) =
            (self.desks.get(engine), self.plugs.get(engine), self.hands.get(engine))
        else {
            return;
        };
        match fault {
            Fault::Cut => plug.cut(begins),
            Fault::Noise => {
                let line = if begins { Faults::heavy() } else { LineFaults::default() };
                plug.set_faults(line, line);
            }
            Fault::Power => plug.power(!begins),
            Fault::Silence => desk.silent.set(begins),
            Fault::FlameOut => plug.ecu(|ecu| ecu.turbine_mut().flame_out()),
            Fault::Reset => {}
        }
        let mut faults = hand.faults.borrow_mut();
        faults.retain(|&other| other != fault);
        if fault.is_once() {
            hand.judge.borrow_mut().fault(Instant::now(), true);
            hand.judge.borrow_mut().fault(Instant::now(), false);
        } else {
            if begins {
                faults.push(fault);
            }
            // A silent source is no reason to miss a window.
            if fault != Fault::Silence {
                hand.judge.borrow_mut().fault(Instant::now(), begins);
            }
        }
    }

    /// Speaks for the source of an engine that was taken from its script, until it is given back.
    pub async fn drive(&self, engine: usize) {
        let Some(desk) = self.desks.get(engine) else { return };
        let mut ticker = Ticker::every(TICK);
        while desk.played.get() {
            self.speak(engine);
            ticker.next().await;
        }
    }

    /// Until this engine is taken from its script.
    pub async fn taken(&self, engine: usize) {
        // Whoever takes it shares a task with whoever waits.
        poll_fn(|_| match self.desks.get(engine) {
            Some(desk) if desk.played.get() => Poll::Ready(()),
            _ => Poll::Pending,
        })
        .await;
    }

    /// One word of the source.
    fn speak(&self, engine: usize) {
        let (Some(desk), Some(hand)) = (self.desks.get(engine), self.hands.get(engine)) else { return };
        if hand.stop.get() {
            let answer = self.order(engine, Command::EmergencyStop, Order::EmergencyStop);
            hand.stop.set(!matches!(answer, Some(Ok(_))));
            return;
        }
        if desk.silent.get() {
            desk.audit.borrow_mut().may_be_up_to(clock::now_ns(), 0);
            return;
        }
        let input = desk.input.get();
        let answer = self.order(engine, input.command(), input.order());
        let refused =
            matches!(answer, Some(Err(Rejected::Start(_) | Rejected::StandbyFirst | Rejected::StopLatched)));
        if refused && matches!(input, PilotInput::Run(_)) {
            // The event says why. To ask again takes another key.
            desk.input.set(PilotInput::Standby);
        }
    }

    /// An order to the node, and to the audit.
    fn order(&self, engine: usize, command: Command, order: Order) -> Option<Result<Accepted, Rejected>> {
        let at = clock::now_ns();
        let answer = self.node.command(engine, command, Origin::Bench)?;
        if let Some(desk) = self.desks.get(engine) {
            desk.judge(at, order, Origin::Bench, answer);
        }
        Some(answer)
    }

    /// A command that orders nothing.
    fn tell(&self, engine: usize, command: Command) {
        let _ = self.node.command(engine, command, Origin::Bench); // a refusal is an event
    }

    /// Looks at all engines, ten times a second.
    pub fn look(&self) {
        for (i, ((desk, plug), hand)) in self.desks.iter().zip(self.plugs).zip(&self.hands).enumerate() {
            let (counts, ignitions) =
                plug.ecu(|ecu| (counts(ecu), ecu.turbine().history().ignitions.clone()));
            hand.judge.borrow_mut().look(&Seen {
                at: Instant::now(),
                commands_run: matches!(desk.input.get(), PilotInput::Run(_)),
                link_up: self.node.telemetry(i).link == LinkState::Up,
                counts,
                ignitions: &ignitions,
                audit: &desk.audit.borrow(),
            });
        }
    }
}
