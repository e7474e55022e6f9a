//! A pilot with a transmitter: a stick and a switch, the SBUS frames of the receiver, and what the node makes of them.

use crate::history::{MS, PilotCommand, Position, SECOND, Sticks};
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

/// Where stick and switch are on the transmitter, and which pulses they give.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// What the node receives of it.
    settings: EngineSettings,
    /// Pulses of stop, standby and run.
    positions: [u16; 3],
}

impl Layout {
    /// One of four.
    pub fn of(number: u64) -> Self {
        let usual = EngineSettings::DEFAULT;
        match number & 3 {
            0 | 1 => Self { settings: usual, positions: [1000, 1500, 2000] },
            2 => Self {
                settings: EngineSettings { throttle: 1, switch: 16, reversed: true, ..usual },
                positions: [1000, 1500, 2000],
            },
            _ => Self {
                settings: EngineSettings {
                    switch: 8,
                    switch_reversed: true,
                    switch_stop: 1150,
                    switch_run: 1650,
                    ..usual
                },
                positions: [1900, 1600, 1300],
            },
        }
    }

    fn channels(&self, sticks: &Sticks) -> [u16; CHANNELS] {
        let mut channels = [steps(1500); CHANNELS];
        let above = (sticks.tenths * 8 / 10) as u16;
        let EngineSettings { throttle, switch, reversed, .. } = self.settings;
        let [stop, standby, run] = self.positions;
        channels[usize::from(throttle) - 1] = steps(if reversed { 1900 - above } else { 1100 + above });
        channels[usize::from(switch) - 1] = steps(match sticks.position {
            Position::Stop => stop,
            Position::Standby => standby,
            Position::Run => run,
        });
        channels
    }
}

/// From frame to frame of a receiver.
pub const FRAME: u64 = 14 * MS;

/// What it does for a while.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Program {
    Stopped,
    Standby,
    Start,
    Flight,
    /// The transmitter is off, and then this goes on.
    Off,
    /// The switch is thrown from stop to run, or the stick is up at the start.
    Careless,
}

/// A transmitter, and who holds it.
#[derive(Debug)]
pub struct Transmitter {
    sticks: Sticks,
    program: Program,
    until: u64,
    next_stick: u64,
    pub next: u64,
    /// Damaged frames, per mille.
    noise: u64,
    layout: Layout,
    /// The last frame was damaged on its way.
    pub is_damaged: bool,
    /// The receiver of the node; anew after each reset.
    armings: u32,
}

/// The node's end of it.
pub type Receiver<'a> = Service<'a, 1>;

impl Transmitter {
    pub const fn new(noise: u64, layout: Layout) -> Self {
        let sticks = Sticks { at: 0, position: Position::Stop, tenths: 0, on: true };
        Self {
            sticks,
            program: Program::Stopped,
            until: 3 * SECOND,
            next_stick: 0,
            next: 0,
            noise,
            layout,
            is_damaged: false,
            armings: 0,
        }
    }

    /// The receiver of a node that begins.
    pub fn receiver<'a>(&mut self, owner: &Owner<'a>, config: &EngineConfig) -> Receiver<'a> {
        let source = owner.source(Origin::Rc).expect("nobody else holds it");
        let pilot = Pilot::new(source, config, self.layout.settings).expect("they are right");
        self.armings = 0;
        Service::new(Input::Sbus(Sbus::new()), [pilot])
    }

    /// What stick and switch are, from now on.
    pub const fn sticks(&self) -> Sticks {
        self.sticks
    }

    /// The person moves on.
    pub fn fly(&mut self, rng: &mut Rng, view: &View) {
        let now = view.now;
        let ready = matches!(view.phase, Phase::Standby | Phase::Stopped) && view.egt < view.cool - 5.0;
        let runs = self.program == Program::Start && view.phase == Phase::Running;
        if self.program == Program::Flight && now >= self.next_stick {
            self.next_stick = now + rng.spread(300 * MS, 40 * SECOND);
            self.sticks.tenths = rng.pick(&[0, 150, 400, 600, 800, 1000]);
        }
        if self.program == Program::Standby && now >= self.until && !ready && rng.percent(95) {
            // Most wait until it is cool.
            self.until = now + SECOND;
        }
        if now < self.until && !runs {
            return;
        }
        self.program = match self.program {
            Program::Stopped if rng.percent(15) => Program::Careless,
            Program::Stopped | Program::Careless => Program::Standby,
            Program::Standby if rng.percent(10) => Program::Careless,
            Program::Standby => Program::Start,
            Program::Start if runs => Program::Flight,
            Program::Start => rng.pick(&[Program::Standby, Program::Stopped]),
            Program::Flight if rng.percent(40) => Program::Off,
            Program::Flight => rng.pick(&[Program::Standby, Program::Standby, Program::Stopped]),
            Program::Off => rng.pick(&[Program::Flight, Program::Flight, Program::Standby, Program::Stopped]),
        };
        self.sticks.on = self.program != Program::Off;
        let (position, tenths, time) = match self.program {
            Program::Stopped => (Position::Stop, 0, rng.spread(300 * MS, 20 * SECOND)),
            Program::Standby => (Position::Standby, 0, rng.spread(2 * SECOND, 20 * SECOND)),
            Program::Start => (Position::Run, 0, 90 * SECOND),
            Program::Flight => (Position::Run, self.sticks.tenths, rng.wait(90 * SECOND)),
            Program::Off => (self.sticks.position, self.sticks.tenths, rng.spread(50 * MS, 30 * SECOND)),
            Program::Careless => (Position::Run, rng.pick(&[0, 300, 1000]), rng.spread(SECOND, 10 * SECOND)),
        };
        (self.sticks.position, self.sticks.tenths) = (position, tenths);
        self.until = now + time;
    }

    /// The next frame goes to the node, if there is one. Gives what was commanded with it.
    pub fn send(
        &mut self,
        rng: &mut Rng,
        now: u64,
        receiver: Option<&mut Receiver<'_>>,
    ) -> Vec<PilotCommand> {
        self.next = now + FRAME;
        self.sticks.at = now;
        let mut frame = sbus(self.layout.channels(&self.sticks), if self.sticks.on { 0 } else { 0x0C });
        self.is_damaged = rng.below(1000) < self.noise;
        if self.is_damaged {
            let at = rng.below(frame.len() as u64) as usize;
            frame[at] ^= 1 << rng.below(8);
        }
        let Some(receiver) = receiver else { return Vec::new() };
        let mut outcomes = Vec::new();
        receiver.receive(Instant::from_micros(now), &frame, false, |_, outcome| outcomes.push(outcome));
        let armings = receiver.pilots().first().map_or(0, |pilot| pilot.counters().armings);
        let armed = core::mem::replace(&mut self.armings, armings) != armings;
        let arm = armed.then_some(PilotCommand::Arm);
        arm.into_iter().chain(outcomes.into_iter().flat_map(commanded)).collect()
    }
}

/// What a frame commanded.
fn commanded(outcome: Outcome) -> Vec<PilotCommand> {
    let Outcome::Commanded(command, _) = outcome else { return Vec::new() };
    let command = settings::commanded(command);
    // A stop disarms.
    let disarm = (command == PilotCommand::Stop).then_some(PilotCommand::Disarm);
    [command].into_iter().chain(disarm).collect()
}
