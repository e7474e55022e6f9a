//! Drills: one fault at a time, in an engine that is operated sensibly before and after it. A director takes its engine from
//! standby to a start, through one drill in flight after the other, to a shutdown, and again.

mod combined;
mod exhaust;
mod flight;
mod forgetful;
mod ground;
mod play;

use crate::acts::{Act, Blow};
use crate::ecus::Odd;
use crate::faults::Fault;
use crate::history::{Cause, Demanded, MS, PilotCommand, Rules, SECOND};
use crate::kind::Traits;
use crate::pilots::{Rng, View};
use sim::turbine::Phase;
use std::collections::VecDeque;

/// One step of a drill.
#[derive(Clone, Copy, Debug)]
pub enum Step {
    Act(Act),
    Wait(u64),
    /// Waits for this condition, for this time at most.
    Until(Condition, u64),
    /// The node is reset, by this cause, and is down for this time.
    Reset(Cause, u64),
    /// The same, and it returns as a node for another engine.
    AnotherEngine(u64),
    /// Or with other settings.
    OtherSettings(u64),
    /// Waits until the time is a multiple of this one.
    Next(u64),
}

/// What a drill waits for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Condition {
    /// The shaft is at rest, and it is cool enough for a start.
    Ready,
    Starts,
    /// Its shaft turns as fast as that of a running engine may.
    Turns,
    /// It is in standby.
    InStandby,
    /// It runs, or has gone out.
    Ends,
    Out,
}

impl Condition {
    fn holds(self, view: &View) -> bool {
        match self {
            Self::Ready => {
                let at_rest = matches!(view.phase, Phase::Standby | Phase::Stopped);
                at_rest && view.egt < view.cool - 12.0 && view.rpm < 200.0
            }
            Self::Starts => view.phase.is_starting(),
            Self::Turns => view.phase == Phase::FuelRamp && view.rpm > 16_000.0,
            Self::InStandby => view.phase == Phase::Standby,
            Self::Ends => view.phase == Phase::Running || !view.phase.is_live(),
            Self::Out => !view.phase.is_live(),
        }
    }
}

fn stream(source: usize, command: PilotCommand) -> Step {
    Step::Act(Act::Stream(source, Some(command)))
}

fn silent(source: usize) -> Step {
    Step::Act(Act::Stream(source, None))
}

fn once(source: usize, command: PilotCommand) -> Step {
    Step::Act(Act::Once(source, command))
}

fn fault(fault: Fault, length_us: u64) -> Step {
    Step::Act(Act::Fault(fault, length_us))
}

fn beside(fault: Fault, length_us: u64) -> Step {
    Step::Act(Act::Beside(fault, length_us))
}

fn throttle(tenths: u32) -> PilotCommand {
    PilotCommand::Run(Demanded::Throttle(tenths))
}

/// Resets by the watchdog, one after the other, with this time between them.
fn resets_apart(count: u64, runs: u64) -> Vec<Step> {
    [Step::Reset(Cause::Watchdog, 20 * MS), Step::Wait(runs)].repeat(count as usize)
}

/// The first that a node without memory receives, at the end of a cut of this length: two such reports, which no ECU sent.
fn first_after_a_loss(length: u64, odd: Odd) -> Vec<Step> {
    let report = fault(Fault::OddFrame(odd), MS);
    vec![
        fault(Fault::CutToNode, length),
        Step::Reset(Cause::PowerOn, 20 * MS),
        Step::Wait(length - 80 * MS),
        report,
        report,
    ]
}

/// The flame goes out, and cannot be lit again for this time.
fn goes_dark(lasts: u64) -> Vec<Step> {
    vec![
        fault(Fault::NoLight(true), MS),
        fault(Fault::FlameOut, MS),
        Step::Wait(lasts),
        fault(Fault::NoLight(false), MS),
    ]
}

const OPEN_PUMP: PilotCommand = PilotCommand::Service(12);
const IDLE: PilotCommand = PilotCommand::Run(Demanded::Throttle(0));

/// Takes an engine from drill to drill.
#[derive(Debug)]
pub struct Director {
    rules: Rules,
    /// There are other engines on the node.
    in_a_group: bool,
    /// The source that flies, and what it commands.
    main: usize,
    stick: Demanded,
    /// Flies by shaft speed, where the ECU or a governor holds one.
    by_rpm: bool,
    /// The node opens the port of a transmitter that hangs again.
    pub reopens: bool,
    /// Drills that still follow until the engine is shut down.
    left: u64,
    steps: VecDeque<Step>,
    waits: Option<Condition>,
    until: u64,
    /// Time of its next step.
    pub next: u64,
    /// A reset that is due.
    pub blow: Option<Blow>,
}

impl Director {
    pub fn new(rng: &mut Rng, rules: &Rules, in_a_group: bool) -> Self {
        Self {
            rules: *rules,
            in_a_group,
            main: rng.below(4) as usize,
            stick: Demanded::Throttle(0),
            by_rpm: rng.percent(30),
            reopens: false,
            left: 0,
            steps: VecDeque::new(),
            waits: None,
            until: 0,
            next: rng.below(SECOND),
            blow: None,
        }
    }

    const fn traits(&self) -> &'static Traits {
        self.rules.kind.traits()
    }

    const fn age(&self) -> u64 {
        self.rules.ages[self.main]
    }

    /// From the last command of the source that flies to the end of the hold.
    const fn to_hold_end(&self) -> u64 {
        self.age() + self.rules.hold
    }

    /// The same, to the end of the ramp.
    fn to_ramp_end(&self) -> u64 {
        self.to_hold_end() + 1000 * SECOND / u64::from(self.rules.ramp)
    }

    fn lower(&self, rng: &mut Rng) -> Option<usize> {
        (self.main < 3).then(|| rng.between(self.main as u64 + 1, 4) as usize)
    }

    fn higher(&self, rng: &mut Rng) -> Option<usize> {
        (self.main > 0).then(|| rng.below(self.main as u64) as usize)
    }

    /// A cut for no longer than the ECU tolerates.
    fn outlived(&self, length_us: u64) -> u64 {
        if self.rules.kind.continues_without_commands() {
            length_us
        } else {
            length_us.min(self.rules.gives_up_after * 85 / 100)
        }
    }

    /// A demand for a while.
    fn demand(&self, rng: &mut Rng, view: &View) -> Demanded {
        match view.max_rpm.or(self.rules.governor.then_some(100_000)) {
            Some(max) if self.by_rpm => {
                Demanded::Rpm((u64::from(max) * rng.between(45, 100) / 100) as u32 / 100 * 100)
            }
            _ => Demanded::Throttle(rng.pick(&[0, 200, 400, 600, 800, 1000])),
        }
    }

    /// A throttle other than the commanded one.
    fn another(&self, rng: &mut Rng) -> PilotCommand {
        let others = [0, 100, 300, 500, 700, 900, 1000];
        throttle(rng.pick(&others))
    }

    fn flies(&self) -> PilotCommand {
        PilotCommand::Run(self.stick)
    }

    /// One source flies, and no other commands anything, until everything has settled.
    fn fly(&self, rng: &mut Rng) -> Vec<Step> {
        let others = (0..4).filter(|source| *source != self.main).map(silent);
        let settles = if rng.percent(40) { rng.between(8, 14) } else { rng.between(3, 6) };
        others.chain([stream(self.main, self.flies()), Step::Wait(settles * SECOND)]).collect()
    }

    /// The same source continues, so that the effect of a drill shows.
    fn recover(&self) -> Vec<Step> {
        let others = (0..4).filter(|source| *source != self.main).map(silent);
        others.chain([stream(self.main, self.flies()), Step::Wait(5 * SECOND)]).collect()
    }

    /// Standby, until it is cool; now and then a stop has to be released.
    fn shut_down(&self, rng: &mut Rng) -> Vec<Step> {
        let others = (0..4).filter(|source| *source != self.main).map(silent);
        let mut steps: Vec<Step> = others.collect();
        steps.push(stream(self.main, PilotCommand::Standby));
        steps.push(Step::Until(Condition::Out, 4 * SECOND));
        // The highest source releases any stop, and the source that flies has to disarm after one.
        steps.push(Step::Wait(700 * MS));
        steps.extend([once(0, PilotCommand::Release), once(self.main, PilotCommand::Disarm)]);
        steps.push(stream(self.main, PilotCommand::Standby));
        steps.push(Step::Until(Condition::Ready, 100 * SECOND));
        steps.push(once(self.main, PilotCommand::Arm));
        steps.push(Step::Wait(rng.pick(&[500, 2000, 6000, 9500]) * MS));
        steps
    }
}
