//! A pilot with a transmitter: a stick, a switch and a hand-over switch, the SBUS frames of the receiver, and the node's commands
//! from them.

use crate::history::{MS, PilotCommand, Position, RadioRules, SBUS, SECOND};
use crate::pilots::{Rng, View};
use crate::settings;
use embassy_time::Instant;
use jetlink::channel::Owner;
use jetlink::command::Origin;
use jetlink::config::EngineConfig;
use jetlink_rc::input::Input;
use jetlink_rc::pilot::{Outcome, Pilot};
use jetlink_rc::sbus::Sbus;
use jetlink_rc::service::Service;
use jetlink_rc::settings::EngineSettings;
use sim::receiver::{CHANNELS, sbus, steps};
use sim::turbine::Phase;
use std::collections::VecDeque;

/// Channels and pulses of stick and switches on the transmitter.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// The node's settings for them.
    rules: RadioRules,
    /// Pulses of stop, standby and run.
    positions: [u16; 3],
    /// Pulse between standby and run.
    between: u16,
}

impl Layout {
    /// One of eight.
    pub const fn of(number: u64) -> Self {
        let hand_over = if number & 4 == 0 { RadioRules::USUAL.hand_over } else { 0 };
        let usual = RadioRules { hand_over, ..RadioRules::USUAL };
        match number & 3 {
            0 | 1 => Self { rules: usual, positions: [1000, 1500, 2000], between: 1650 },
            2 => Self {
                rules: RadioRules { throttle: 1, switch: 16, reversed: true, ..usual },
                positions: [1000, 1500, 2000],
                between: 1650,
            },
            _ => Self {
                rules: RadioRules {
                    low: 1000,
                    high: 2000,
                    beyond: 60,
                    switch: 8,
                    switch_reversed: true,
                    stop: 1150,
                    run: 1650,
                    ..usual
                },
                positions: [1900, 1600, 1300],
                between: 1400,
            },
        }
    }

    /// The settings of the node.
    fn settings(&self) -> EngineSettings {
        let rules = self.rules;
        EngineSettings {
            throttle: rules.throttle,
            low: rules.low,
            high: rules.high,
            reversed: rules.reversed,
            beyond: rules.beyond,
            switch: rules.switch,
            switch_stop: rules.stop,
            switch_run: rules.run,
            switch_reversed: rules.switch_reversed,
            hand_over: rules.hand_over,
            ..EngineSettings::DEFAULT
        }
    }

    fn channels(&self, sticks: &Sticks) -> [u16; CHANNELS] {
        let mut channels = [steps(1500); CHANNELS];
        let RadioRules { low, high, reversed, .. } = self.rules;
        let above = (sticks.tenths * u32::from(high - low) / 1000) as u16;
        let throttle = match (sticks.sends, reversed) {
            (Sends::ThrottleBeyond, _) => 2150,
            (_, true) => high - above,
            (_, false) => low + above,
        };
        let [stop, standby, run] = self.positions;
        let switch = match sticks.position {
            _ if sticks.sends == Sends::SwitchBetween => self.between,
            Position::Stop => stop,
            Position::Standby => standby,
            Position::Run => run,
        };
        let hand_over = if sticks.handed_over { 2000 } else { 1000 };
        for (number, pulse) in
            [(self.rules.hand_over, hand_over), (self.rules.throttle, throttle), (self.rules.switch, switch)]
        {
            if let Some(place) = usize::from(number).checked_sub(1) {
                channels[place] = steps(pulse);
            }
        }
        channels
    }
}

/// What the receiver sends.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Sends {
    Good,
    /// Without its transmitter: the last values, flagged as lost and as fail-safe.
    Frozen,
    /// Preset values for a lost transmitter, with the flag "fail-safe" alone: run allowed at idle.
    Presets,
    /// The same values with the flag "frame lost" alone.
    Lost,
    /// Nothing: it is unplugged.
    Nothing,
    /// The throttle's potentiometer is broken.
    ThrottleBeyond,
    /// The switch is between standby and run.
    SwitchBetween,
}

const AWAY: [Sends; 4] = [Sends::Frozen, Sends::Presets, Sends::Lost, Sends::Nothing];

/// Stick and switches, and the state of the receiver.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Sticks {
    position: Position,
    /// Throttle, 0.1 %.
    tenths: u32,
    handed_over: bool,
    sends: Sends,
}

const fn at(position: Position, tenths: u32) -> Sticks {
    Sticks { position, tenths, handed_over: false, sends: Sends::Good }
}

impl Sticks {
    const fn sends(self, sends: Sends) -> Self {
        Self { sends, ..self }
    }

    const fn handed_over(self) -> Self {
        Self { handed_over: true, ..self }
    }
}

/// Intention of the person.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Program {
    Stopped,
    Standby,
    Start,
    Flight,
}

/// A transmitter and its pilot.
#[derive(Debug)]
pub struct Transmitter {
    /// Its own: nothing else in a world depends on it.
    rng: Rng,
    sticks: Sticks,
    program: Program,
    /// The next moves, each with its duration.
    steps: VecDeque<(Sticks, u64)>,
    until: u64,
    pub next: u64,
    /// Interval between frames of the receiver.
    period: u64,
    /// Damaged frames, per mille.
    noise: u64,
    layout: Layout,
    /// Of the node's receiver; new after each reset.
    armings: u32,
}

/// The node's end of the line.
pub type Receiver<'a> = Service<'a, 1>;

impl Transmitter {
    pub fn new(seed: u64, layout: Layout) -> Self {
        let mut rng = Rng(seed);
        Self {
            sticks: at(Position::Stop, 0),
            program: Program::Stopped,
            steps: VecDeque::new(),
            until: 3 * SECOND,
            next: 0,
            period: rng.pick(&[9, 14, 14, 20]) * MS,
            noise: rng.pick(&[0, 0, 1, 2, 5, 10]),
            layout,
            armings: 0,
            rng,
        }
    }

    pub const fn rules(&self) -> RadioRules {
        self.layout.rules
    }

    /// The receiver of a node that begins.
    pub fn receiver<'a>(&mut self, owner: &Owner<'a>, config: &EngineConfig) -> Receiver<'a> {
        let source = owner.source(Origin::Rc).expect("nobody else holds it");
        let pilot = Pilot::new(source, config, self.layout.settings()).expect("they are right");
        self.armings = 0;
        Service::new(Input::Sbus(Sbus::new()), [pilot])
    }

    /// The person's next move. Returns stick and switches if they moved, for the log.
    pub fn fly(&mut self, view: &View) -> Option<String> {
        let now = view.now;
        if self.program == Program::Start && view.phase == Phase::Running {
            (self.program, self.until) = (Program::Flight, now);
            self.steps.clear();
        }
        if now < self.until {
            return None;
        }
        if self.steps.is_empty() {
            self.choose(view);
        }
        let (mut sticks, time) = self.steps.pop_front()?;
        sticks.handed_over &= self.layout.rules.hand_over != 0;
        self.until = now + time;
        let moved = core::mem::replace(&mut self.sticks, sticks) != sticks;
        moved.then(|| format!("  stick and switches: {sticks:?}"))
    }

    fn choose(&mut self, view: &View) {
        let ready = matches!(view.phase, Phase::Standby | Phase::Stopped) && view.egt < view.cool - 5.0;
        let rng = &mut self.rng;
        if self.program == Program::Standby && !ready && rng.percent(95) {
            // Most wait until it is cool.
            self.steps.push_back((at(Position::Standby, 0), SECOND));
            return;
        }
        match self.program {
            Program::Stopped | Program::Standby if rng.percent(25) => return self.drill(),
            Program::Flight if rng.percent(50) => return self.drill_in_flight(),
            _ => {}
        }
        self.program = match self.program {
            Program::Stopped => Program::Standby,
            Program::Standby => Program::Start,
            Program::Start => rng.pick(&[Program::Standby, Program::Stopped]),
            Program::Flight => {
                rng.pick(&[Program::Flight, Program::Standby, Program::Standby, Program::Stopped])
            }
        };
        match self.program {
            Program::Stopped => self.step(at(Position::Stop, 0), 300 * MS, 20 * SECOND),
            Program::Standby => self.step(at(Position::Standby, 0), 2 * SECOND, 20 * SECOND),
            Program::Start => self.steps.push_back((at(Position::Run, 0), 90 * SECOND)),
            Program::Flight => {
                for _ in 0..self.rng.between(1, 6) {
                    let tenths = self.rng.pick(&[0, 150, 400, 600, 800, 1000]);
                    self.step(at(Position::Run, tenths), 300 * MS, 40 * SECOND);
                }
            }
        }
    }

    fn step(&mut self, sticks: Sticks, least: u64, most: u64) {
        let time = self.rng.spread(least, most);
        self.steps.push_back((sticks, time));
    }

    /// Mistakes of a person with an engine at rest. None of them starts it.
    fn drill(&mut self) {
        use Position::{Run, Standby, Stop};
        let away = self.rng.pick(&AWAY);
        let drill = self.rng.below(10);
        self.step(at(Standby, 0), SECOND, 5 * SECOND);
        match drill {
            // The stick is up, or was until just now.
            0 => self.step(at(Run, 300), SECOND, 30 * SECOND),
            1 => {
                self.step(at(Standby, 300), SECOND, 3 * SECOND);
                self.step(at(Standby, 0), 50 * MS, 420 * MS);
                self.step(at(Run, 0), SECOND, 10 * SECOND);
            }
            2 => {
                self.step(at(Run, 300), SECOND, 3 * SECOND);
                self.step(at(Run, 0), SECOND, 30 * SECOND);
            }
            // From stop to run, or past standby.
            3 => {
                self.step(at(Stop, 0), 300 * MS, 3 * SECOND);
                self.step(at(Run, 0), SECOND, 30 * SECOND);
            }
            4 => {
                self.step(at(Stop, 0), 300 * MS, 3 * SECOND);
                self.step(at(Standby, 0), 20 * MS, 420 * MS);
                self.step(at(Run, 0), SECOND, 10 * SECOND);
            }
            // Moved while nothing is received.
            5 => {
                self.step(at(Standby, 0).sends(away), 20 * MS, 5 * SECOND);
                self.step(at(Run, 0), SECOND, 20 * SECOND);
            }
            6 => {
                self.step(at(Stop, 0).sends(away), 20 * MS, 5 * SECOND);
                self.step(at(Standby, 0), SECOND, 5 * SECOND);
            }
            7 => {
                self.step(at(Standby, 0).handed_over(), 50 * MS, 3 * SECOND);
                self.step(at(Run, 0).handed_over(), SECOND, 5 * SECOND);
                self.step(at(Run, 0), SECOND, 10 * SECOND);
            }
            8 => {
                self.step(at(Stop, 300), 300 * MS, SECOND);
                self.step(at(Standby, 300), SECOND, 3 * SECOND);
            }
            _ => {
                self.step(at(Standby, 0).sends(Sends::ThrottleBeyond), 20 * MS, SECOND);
                self.step(at(Stop, 0).sends(Sends::ThrottleBeyond), 100 * MS, SECOND);
                self.step(at(Standby, 0).sends(Sends::SwitchBetween), 20 * MS, SECOND);
                self.step(at(Run, 0), SECOND, 10 * SECOND);
            }
        }
        self.program = Program::Stopped;
        self.step(at(Stop, 0), 300 * MS, 3 * SECOND);
    }

    /// What happens in flight.
    fn drill_in_flight(&mut self) {
        use Position::{Run, Standby, Stop};
        let rng = &mut self.rng;
        let away = rng.pick(&AWAY);
        let drill = rng.below(10);
        let back = at(Run, rng.pick(&[self.sticks.tenths, 0, 600, 1000]));
        let here = at(Run, self.sticks.tenths);
        match drill {
            0 | 1 => self.step(here.sends(away), 20 * MS, 30 * SECOND),
            2 => {
                self.step(here.sends(away), 20 * MS, 10 * SECOND);
                self.step(at(Standby, here.tenths), 20 * MS, 10 * SECOND);
            }
            3 => {
                self.step(here.sends(away), 20 * MS, 10 * SECOND);
                self.step(at(Stop, here.tenths), 20 * MS, 2 * SECOND);
                self.program = Program::Stopped;
                return self.step(at(Stop, 0), SECOND, 5 * SECOND);
            }
            4 => {
                self.step(here.handed_over(), 20 * MS, 20 * SECOND);
                if self.rng.percent(20) {
                    self.step(at(Stop, here.tenths).handed_over(), 200 * MS, SECOND);
                    self.program = Program::Stopped;
                    return self.step(at(Stop, 0), SECOND, 5 * SECOND);
                }
            }
            5 => self.step(here.sends(Sends::ThrottleBeyond), 20 * MS, 10 * SECOND),
            6 => self.step(here.sends(Sends::SwitchBetween), 20 * MS, 10 * SECOND),
            // Stop at the end of the range, or beside a loose wire of the throttle; or the same at run.
            7 | 8 => {
                let stops = self.rng.percent(50);
                let seen = at(if stops { Stop } else { Run }, here.tenths);
                let between = if drill == 7 { Sends::Nothing } else { Sends::ThrottleBeyond };
                for _ in 0..12 {
                    self.step(seen, 60 * MS, 290 * MS);
                    self.step(seen.sends(between), 150 * MS, 600 * MS);
                }
                if stops {
                    self.program = Program::Stopped;
                    return self.step(at(Stop, 0), SECOND, 5 * SECOND);
                }
            }
            _ => {
                self.step(at(Standby, here.tenths), 10 * MS, 45 * MS);
                if self.rng.percent(20) {
                    self.step(at(Stop, 0).sends(Sends::ThrottleBeyond), 400 * MS, 2 * SECOND);
                    self.program = Program::Stopped;
                    return self.step(at(Stop, 0), SECOND, 5 * SECOND);
                }
            }
        }
        self.step(back, SECOND, 10 * SECOND);
    }

    /// The next frame goes to the node, if there is one. Returns the frame that reached it, and the commands from it.
    pub fn send(
        &mut self,
        now: u64,
        receiver: Option<&mut Receiver<'_>>,
    ) -> (Option<[u8; SBUS]>, Vec<PilotCommand>) {
        self.next = now + self.period;
        let presets = Sticks { sends: self.sticks.sends, ..at(Position::Run, 0) };
        let (sticks, flags) = match self.sticks.sends {
            Sends::Nothing => return (None, Vec::new()),
            Sends::Good | Sends::ThrottleBeyond | Sends::SwitchBetween => (self.sticks, 0),
            Sends::Frozen => (self.sticks, 0x0C),
            Sends::Presets => (presets, 0x08),
            Sends::Lost => (presets, 0x04),
        };
        let frame = sbus(self.layout.channels(&sticks), flags);
        let mut frame: [u8; SBUS] = frame.try_into().expect("the length of a frame");
        if self.rng.below(1000) < self.noise {
            let at = self.rng.below(SBUS as u64) as usize;
            frame[at] ^= 1 << self.rng.below(8);
        }
        let Some(receiver) = receiver else { return (None, Vec::new()) };
        let mut outcomes = Vec::new();
        receiver.receive(Instant::from_micros(now), &frame, false, |_, outcome| outcomes.push(outcome));
        let armings = receiver.pilots().first().map_or(0, |pilot| pilot.counters().armings);
        let armed = core::mem::replace(&mut self.armings, armings) != armings;
        let arm = armed.then_some(PilotCommand::Arm);
        (Some(frame), arm.into_iter().chain(outcomes.into_iter().flat_map(commanded)).collect())
    }
}

/// The commands of a frame.
fn commanded(outcome: Outcome) -> Vec<PilotCommand> {
    let Outcome::Commanded(command, _) = outcome else { return Vec::new() };
    let command = settings::commanded(command);
    // A stop disarms.
    let disarm = (command == PilotCommand::Stop).then_some(PilotCommand::Disarm);
    [command].into_iter().chain(disarm).collect()
}
