//! Pilots of an engine: people and devices that know what they see of the turbine, and nothing of the node's state.

use crate::history::{Demanded, MS, PilotCommand, SECOND};
use sim::turbine::Phase;

/// SplitMix64.
#[derive(Debug)]
pub struct Rng(pub u64);

impl Rng {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    pub fn below(&mut self, n: u64) -> u64 {
        self.next() % n.max(1)
    }

    pub fn between(&mut self, low: u64, high: u64) -> u64 {
        low + self.below(high - low)
    }

    /// Short times as often as long ones.
    pub fn spread(&mut self, low: u64, high: u64) -> u64 {
        let part = self.below(1000) as f64 / 1000.0;
        (low as f64 * (high as f64 / low as f64).powf(part)) as u64
    }

    pub fn percent(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }

    pub fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len() as u64) as usize]
    }

    /// Distributed around this mean, never 0.
    pub fn wait(&mut self, mean: u64) -> u64 {
        self.between(mean / 10, mean * 2)
    }
}

/// What a pilot sees of the turbine.
#[derive(Clone, Copy, Debug)]
pub struct View {
    pub now: u64,
    pub phase: Phase,
    pub egt: f64,
    pub rpm: f64,
    /// Below this exhaust temperature it may be started, °C.
    pub cool: f64,
    /// Highest speed, where the ECU takes an rpm demand.
    pub max_rpm: Option<u32>,
}

/// A pilot's activity for a while.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Program {
    Silent,
    /// The same command over and over.
    Stream(PilotCommand),
    /// From any state to a running engine, and down again, as documented.
    Fly(Stage),
    /// Commands and falls silent, repeatedly, for these times.
    Flap(Demanded, u64, u64),
    /// A ground station: one command at a time.
    OneCommand(u8),
    /// Standby, and services.
    Service,
    /// Standby, if it begins at 0, and then a hand-over to the PWM input.
    Pwm(u8),
    /// A stop, and later its release, disarm, arm.
    Stop(u8),
}

#[derive(Clone, Copy, PartialEq, Debug)]
enum Stage {
    /// Standby until it is cool; ready since.
    Standby(Option<u64>),
    /// Run at idle, since.
    Start(u64),
    /// Run with an unchanged stick, until.
    Flight(u64),
    /// Standby, until.
    Down(u64),
}

/// Character of a pilot.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Habit {
    /// Flies.
    Flies,
    /// Repeats one command below another source.
    Below,
    /// Silent for a long time, then the same demand for a while: takes over.
    Relieves,
    /// Anything.
    Restless,
}

#[derive(Debug)]
pub struct Pilot {
    /// Source, 0 is the highest.
    pub source: usize,
    habit: Habit,
    /// Interval between commands.
    period: u64,
    pub next: u64,
    program: Program,
    until: u64,
    stick: Demanded,
    next_stick: u64,
    armed: bool,
    /// Keeps the stick where it is when the engine goes out.
    stubborn: bool,
    /// Seldom moves the stick.
    calm: bool,
    /// Does not wait for a cool engine.
    hasty: bool,
    /// Flies by shaft speed, where the ECU takes one.
    by_rpm: bool,
    /// Standby time of a ready engine before its start.
    patience: u64,
    /// When it commands "arm" again.
    next_arm: u64,
}

impl Pilot {
    pub fn new(rng: &mut Rng, source: usize, habit: Habit, in_a_group: bool) -> Self {
        // Some command at the very instant of a slot.
        let grain = if rng.percent(20) { 50 * MS } else { 1 };
        let first = rng.below(3 * SECOND) / grain * grain;
        Self {
            source,
            habit,
            period: rng.pick(&[20, 50, 100, 100, 200]) * MS,
            next: first,
            program: Program::Silent,
            until: 0,
            stick: Demanded::Throttle(0),
            next_stick: 0,
            armed: false,
            stubborn: rng.percent(if in_a_group { 70 } else { 30 }),
            calm: rng.percent(40),
            hasty: rng.percent(15),
            by_rpm: rng.percent(25),
            patience: rng.pick(&[2, 2, 12]) * SECOND,
            next_arm: 0,
        }
    }

    /// Flies from here on, whatever it does.
    pub fn fly(&mut self, rng: &mut Rng, now: u64) {
        self.program = Program::Fly(Stage::Standby(None));
        self.until = now + rng.between(100, 500) * SECOND;
        self.next = self.next.min(now + self.period);
    }

    fn demand(&self, rng: &mut Rng, view: &View) -> Demanded {
        demand(rng, view, self.by_rpm)
    }

    fn choose(&mut self, rng: &mut Rng, view: &View) {
        let now = view.now;
        let demanded = self.demand(rng, view);
        self.until = now + rng.wait(60 * SECOND);
        self.program = match (self.habit, rng.below(100)) {
            (Habit::Flies, 0..70) | (Habit::Restless, 0..15) => {
                self.until = now + rng.between(100, 500) * SECOND;
                match view.phase {
                    Phase::Running => Program::Fly(Stage::Flight(now + rng.wait(90 * SECOND))),
                    _ => Program::Fly(Stage::Standby(None)),
                }
            }
            (Habit::Flies, 70..82) | (Habit::Restless, 15..40) => {
                self.until = now + rng.spread(300 * MS, 100 * SECOND);
                Program::Silent
            }
            (Habit::Flies, 82..88) => {
                Program::Flap(demanded, rng.spread(50 * MS, 3 * SECOND), rng.spread(300 * MS, 5 * SECOND))
            }
            (Habit::Flies, 88..92) | (Habit::Restless, 40..46) => Program::Stop(0),
            (Habit::Flies, 92..95) | (Habit::Restless, 46..51) => Program::Service,
            (Habit::Flies, 95..97) | (Habit::Restless, 51..54) => {
                Program::Pwm(if rng.percent(70) { 0 } else { 19 })
            }
            (Habit::Flies, _) => Program::OneCommand(0),
            (Habit::Relieves, 0..50) => {
                self.until = now + rng.between(20, 60) * SECOND;
                Program::Silent
            }
            (Habit::Relieves, _) => {
                self.until = now + rng.between(10, 40) * SECOND;
                Program::Stream(PilotCommand::Run(Demanded::Throttle(rng.pick(&[200, 400, 600, 800]))))
            }
            (Habit::Below, 0..45) => Program::Stream(PilotCommand::Run(if rng.percent(60) {
                Demanded::Throttle(0)
            } else {
                demanded
            })),
            (Habit::Below, 45..75) => Program::Stream(PilotCommand::Standby),
            (Habit::Below, 75..88) => Program::Stream(PilotCommand::Nothing),
            (Habit::Below, _) => Program::Silent,
            (Habit::Restless, 54..64) => Program::OneCommand(0),
            // A transmitter that is on but commands nothing.
            (Habit::Restless, 64..68) => Program::Stream(PilotCommand::Nothing),
            (Habit::Restless, 68..76) => Program::Stream(PilotCommand::Run(if rng.percent(60) {
                Demanded::Throttle(0)
            } else {
                demanded
            })),
            (Habit::Restless, 76..86) => Program::Stream(PilotCommand::Standby),
            (Habit::Restless, 86..94) => {
                // One stray command.
                self.until = now;
                Program::Stream(if rng.percent(50) {
                    PilotCommand::Standby
                } else {
                    PilotCommand::Run(demanded)
                })
            }
            (Habit::Restless, _) => {
                Program::Flap(demanded, rng.spread(50 * MS, 3 * SECOND), rng.spread(300 * MS, 5 * SECOND))
            }
        };
    }

    /// The commands of this pilot now, and when the next ones come.
    pub fn commands_now(&mut self, rng: &mut Rng, view: &View) -> Vec<PilotCommand> {
        let now = view.now;
        if now < self.next {
            return Vec::new();
        }
        let mut commands = Vec::new();
        if now >= self.until {
            self.choose(rng, view);
        }
        self.next = now + self.period;
        // An arming switch that is sent along with the stick.
        if self.armed && now >= self.next_arm && !matches!(self.program, Program::Silent) {
            self.next_arm = now + rng.wait(4 * SECOND);
            commands.push(PilotCommand::Arm);
        }
        let by_rpm = self.by_rpm;
        match &mut self.program {
            Program::Silent => self.next = self.until.max(now + MS),
            Program::Stream(command) => commands.push(*command),
            Program::Flap(demanded, on, off) => {
                commands.push(PilotCommand::Run(*demanded));
                if now % (*on + *off) < *off {
                    self.next = now + *off;
                }
            }
            Program::OneCommand(step) => {
                let command = match *step {
                    0 => PilotCommand::Arm,
                    1 => PilotCommand::Standby,
                    2 => PilotCommand::Run(Demanded::Throttle(0)),
                    3 => PilotCommand::Run(demand(rng, view, by_rpm)),
                    _ if rng.percent(50) => PilotCommand::ShutDown,
                    _ => PilotCommand::Standby,
                };
                *step += 1;
                commands.push(command);
                self.next = now + rng.spread(300 * MS, 20 * SECOND);
                if *step == 5 {
                    self.until = now;
                }
            }
            Program::Service => {
                commands.push(PilotCommand::Standby);
                if rng.percent(3) {
                    commands.push(PilotCommand::Service(rng.pick(&[1, 2, 3, 4, 5, 6, 12, 12, 13, 10])));
                }
                if rng.percent(1) {
                    commands.push(if rng.percent(60) { PilotCommand::Arm } else { PilotCommand::Disarm });
                }
            }
            Program::Pwm(step) => {
                *step += 1;
                commands.push(match *step {
                    1 | 20 => PilotCommand::Arm,
                    2..20 => PilotCommand::Standby,
                    21 => PilotCommand::Pwm,
                    _ => {
                        self.next = self.until.max(now + MS);
                        return commands;
                    }
                });
            }
            Program::Stop(step) => {
                *step += 1;
                let (command, wait) = match *step {
                    1 => (PilotCommand::Stop, rng.spread(100 * MS, 60 * SECOND)),
                    2 => (PilotCommand::Release, rng.spread(10 * MS, 5 * SECOND)),
                    3 => (PilotCommand::Release, rng.spread(10 * MS, 5 * SECOND)),
                    4 => (PilotCommand::Disarm, rng.spread(10 * MS, 5 * SECOND)),
                    _ => (PilotCommand::Arm, 100 * MS),
                };
                self.next = now + wait;
                self.until = u64::MAX;
                // A pilot that does not disarm remains as it was: armed from its own point of view.
                if *step >= 5 || *step == 3 && rng.percent(30) || *step == 1 && rng.percent(5) {
                    self.armed |= *step == 5;
                    self.until = now;
                }
                commands.push(command);
            }
            Program::Fly(_) => self.flight(rng, view, &mut commands),
        }
        commands
    }

    fn flight(&mut self, rng: &mut Rng, view: &View, commands: &mut Vec<PilotCommand>) {
        let now = view.now;
        let Program::Fly(stage) = &mut self.program else { return };
        if !core::mem::replace(&mut self.armed, true) {
            if rng.percent(60) {
                commands.extend([PilotCommand::Release, PilotCommand::Disarm]);
            }
            commands.push(PilotCommand::Arm);
            self.next_arm = now + rng.wait(4 * SECOND);
        }
        if rng.percent(1) && rng.percent(2) {
            commands.push(PilotCommand::Disarm);
            self.next_arm = now + rng.wait(4 * SECOND);
        }
        match *stage {
            Stage::Standby(since) => {
                commands.push(PilotCommand::Standby);
                let ready =
                    matches!(view.phase, Phase::Standby | Phase::Stopped) && view.egt < view.cool - 5.0;
                let ready = ready || self.hasty && !view.phase.is_live();
                // Some do not wait.
                let since =
                    since.filter(|_| ready).or((ready || rng.percent(1) && rng.percent(10)).then_some(now));
                *stage = match since {
                    Some(since) if now > since + self.patience => {
                        if self.period < 200 * MS && rng.percent(50) {
                            commands.pop();
                        }
                        Stage::Start(now)
                    }
                    since => Stage::Standby(since),
                };
            }
            Stage::Start(since) => {
                let up = rng.percent(1) && rng.percent(10);
                commands.push(PilotCommand::Run(if up { self.stick } else { Demanded::Throttle(0) }));
                // A person ends it, in addition to the stream.
                if rng.below(200 * SECOND) < self.period {
                    commands.push(PilotCommand::ShutDown);
                }
                if rng.below(300 * SECOND) < self.period {
                    self.next = now + rng.spread(300 * MS, 40 * SECOND);
                }
                if view.phase == Phase::Running && now > since + 5 * SECOND {
                    *stage = Stage::Flight(now + rng.wait(90 * SECOND));
                } else if now > since + 90 * SECOND || !view.phase.is_live() && now > since + 8 * SECOND {
                    // It did not start: again from the beginning, or not.
                    self.armed = rng.percent(40);
                    *stage = if self.stubborn && rng.percent(90) {
                        Stage::Start(now)
                    } else {
                        Stage::Standby(None)
                    };
                }
            }
            Stage::Flight(until) => {
                if now >= self.next_stick {
                    let least = if self.calm { 10 * SECOND } else { 300 * MS };
                    self.next_stick = now + rng.spread(least, 60 * SECOND);
                    self.stick = demand(rng, view, self.by_rpm);
                }
                commands.push(PilotCommand::Run(self.stick));
                // A link that is lost for a while, mostly for as long as a person takes to notice.
                if rng.below(60 * SECOND) < self.period {
                    let most = if rng.percent(20) { 200 } else { 20 };
                    self.next = now + rng.spread(100 * MS, most * SECOND);
                    return;
                }
                if rng.percent(1) && rng.percent(3) {
                    commands.push(PilotCommand::Ctf);
                }
                let out = view.phase != Phase::Running && !self.stubborn && rng.percent(2);
                if now >= until || out {
                    *stage = Stage::Down(now + rng.wait(20 * SECOND));
                }
            }
            Stage::Down(until) => {
                commands.push(PilotCommand::Standby);
                if now >= until {
                    self.until = now;
                }
            }
        }
    }
}

/// A demand, at times one that makes no sense.
fn demand(rng: &mut Rng, view: &View, by_rpm: bool) -> Demanded {
    if let Some(max) = view.max_rpm
        && rng.percent(if by_rpm { 100 } else { 40 })
    {
        let most = if rng.percent(10) { u64::from(max) * 101 / 100 } else { max.into() };
        let rpm = rng.between(u64::from(max) / 4, most) as u32;
        return Demanded::Rpm(rpm / 100 * 100);
    }
    Demanded::Throttle(rng.pick(&[0, 200, 400, 600, 800, 1000, 1000]).min(rng.below(400) as u32 + 600))
}
