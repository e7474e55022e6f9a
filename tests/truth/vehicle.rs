//! Pilots behind MAVLink: an autopilot, a ground station, a second vehicle, and the lines between them and the node. They send
//! what is documented, and now and then what they should not.

use crate::context::EngineContext;
use crate::frames::{
    Dress, Message, Sender, acks, command_cancel, command_int, command_long, frame, heartbeat, outputs,
};
use crate::history::{Answered, ByMavlink, Commanded, MS, Received, SECOND, Word};
use crate::line::{InFlight, Line, Quality};
use crate::pilots::{Rng, View};
use crate::settings;
use embassy_time::Instant;
use jetlink::channel::Owner;
use jetlink::command::Origin;
use jetlink::config::EngineConfig;
use jetlink_mavlink::port::PortConfig;
use jetlink_mavlink::service::{EngineParts, Service};
use jetlink_mavlink::settings::{EngineSettings, NodeSettings};
use jetlink_mavlink::signing::SigningState;
use sim::turbine::Phase;

/// The source of MAVLink.
pub const MAVLINK: usize = 2;
/// Worlds with these seeds have it.
pub const SEEDS: core::ops::Range<u64> = 600_000_000..700_000_000;

const SYSTEM: u8 = 3;
const AUTOPILOT: Sender = (SYSTEM, 1);
const COMPANION: Sender = (SYSTEM, 191);
const GROUND: Sender = (255, 190);
const STRANGER: Sender = (9, 1);
const NOBODY: Sender = (42, 190);
/// Component of the node; the engines follow it.
const NODE: u8 = 25;
const TO_AUTOPILOT: usize = 0;
const TO_GROUND: usize = 1;

const ENGINE_CONTROL: u16 = 223;
const FLIGHT_TERMINATION: u16 = 185;
const USER_1: u16 = 31010;
const MAGIC: f32 = 21196.0;

/// A frame is late from 0.3 s on, plus or minus this.
const LATE: u64 = 300 * MS;
const LATE_SLACK: u64 = 60 * MS;

/// The meaning of a frame for the engines of the node.
#[derive(Clone, Debug)]
enum Meaning {
    /// Nothing that counts.
    Nothing,
    To(usize, Word),
    All(Word),
    /// Outputs of the autopilot, at its clock: each engine's throttle.
    Outputs(u32, Vec<Option<Option<u32>>>),
}

/// The operator of one engine, and the settings of it.
#[derive(Debug)]
struct Person {
    engine: usize,
    settings: EngineSettings,
    program: Program,
    until: u64,
    tenths: u32,
    next_stick: u64,
    next_slip: u64,
    next_word: u64,
}

#[derive(Clone, Copy, PartialEq, Debug)]
enum Program {
    Rest,
    /// Waits for an engine that may be started; ready since.
    Ready(Option<u64>),
    Start,
    Flight,
    Down,
    /// Stopped by an emergency stop.
    Stopped,
}

#[derive(Debug)]
struct Autopilot {
    /// Off until then.
    off_until: u64,
    booted: u64,
    /// Its clock at its boot: it may wrap soon.
    clock: u32,
    armed: bool,
    next_arming: u64,
    next_boot: u64,
    next_heartbeat: u64,
    next_outputs: u64,
    every: u64,
    /// Until then its outputs are not sent, or have no pulse.
    silent_until: u64,
    dark_until: u64,
    next_trouble: u64,
}

/// What the judge needs to know about the autopilot's frames that reached the node.
#[derive(Clone, Copy, Debug, Default)]
struct OutputFrames {
    /// Smallest delay since the node or the autopilot began.
    quickest: Option<u64>,
    /// Clock of the last frame, and of the boot of the autopilot that it belongs to.
    last: Option<(u32, u64)>,
    /// Frames of a new clock, and when the first one came.
    anew: Option<(u32, u64)>,
}

/// A command that is sent again later.
#[derive(Clone, Debug)]
struct Later {
    at: u64,
    port: usize,
    from: Sender,
    message: Message,
    meaning: Meaning,
}

#[derive(Debug)]
pub struct Vehicle {
    rng: Rng,
    learns: bool,
    /// What the node has stored of it.
    learnt: u8,
    /// A second vehicle is present; where the id is learnt, it comes and goes, from then until then.
    company: bool,
    company_until: u64,
    next_company: u64,
    /// Outputs 17 to 32 are used.
    high: bool,
    people: Vec<Person>,
    autopilot: Autopilot,
    output_frames: OutputFrames,
    ground_off_until: u64,
    next_ground: u64,
    next_ground_off: u64,
    next_stranger: u64,
    lines: [Line<Meaning>; 2],
    later: Vec<Later>,
    sequence: u8,
    poll_at: u64,
}

/// The node's end of it.
pub type Receiver<'a, const N: usize> = Service<'a, N, 2>;

impl Vehicle {
    /// For all engines of a world, or one of them.
    pub fn random<'a>(seed: u64, contexts: impl ExactSizeIterator<Item = &'a mut EngineContext>) -> Self {
        let mut rng = Rng(seed ^ 0x6D61_766C_696E_6B00);
        let all = contexts.len() == 1 || rng.percent(60);
        let only = rng.below(contexts.len() as u64) as usize;
        let (learns, high) = (rng.percent(20), rng.percent(20));
        let mut people = Vec::new();
        for (engine, context) in contexts.enumerate().filter(|(engine, _)| all || *engine == only) {
            let place = people.len() as u8;
            let settings = EngineSettings {
                source: u8::from(rng.percent(85)),
                output: if high { 17 } else { 3 } + place,
                relight: rng.percent(10),
                disarmed_standby: rng
                    .percent(15)
                    .then(|| embassy_time::Duration::from_secs(rng.between(1, 60))),
                ..EngineSettings::DEFAULT
            };
            let id = if learns { "learnt" } else { "set" };
            context.note(format!("MAVLink, {id} id: {settings:?}"));
            context.command_by_mavlink(ByMavlink {
                has_output: settings.source == 1,
                relight: settings.relight,
                standby_after: settings.disarmed_standby.map(|time| time.as_micros()),
                learns,
                ..ByMavlink::default()
            });
            people.push(Person {
                engine,
                settings,
                program: Program::Rest,
                until: rng.wait(10 * SECOND),
                tenths: 0,
                next_stick: 0,
                next_slip: rng.wait(100 * SECOND),
                next_word: 0,
            });
        }
        let good = Quality { lost: 0, damaged: 0, twice: 0, held: 0 };
        let bad = Quality { lost: 50, damaged: 10, twice: 20, held: 2 };
        let fair = Quality { lost: 5, damaged: 1, twice: 2, held: 1 };
        let mut line = || Line::new(rng.pick(&[good, fair, fair, bad]));
        let lines = [line(), line()];
        let autopilot = Autopilot {
            off_until: 0,
            booted: 0,
            clock: 0,
            armed: rng.percent(50),
            next_arming: rng.wait(60 * SECOND),
            next_boot: rng.wait(600 * SECOND),
            next_heartbeat: rng.below(SECOND),
            next_outputs: 0,
            every: rng.pick(&[20, 25, 25, 50, 100, 200]) * MS,
            silent_until: 0,
            dark_until: 0,
            next_trouble: rng.wait(150 * SECOND),
        };
        Self {
            learns,
            learnt: 0,
            company: rng.percent(50),
            company_until: if learns { rng.wait(30 * SECOND) } else { u64::MAX },
            next_company: if learns { rng.wait(300 * SECOND) } else { u64::MAX },
            high,
            people,
            autopilot,
            output_frames: OutputFrames::default(),
            ground_off_until: 0,
            next_ground: rng.below(SECOND),
            next_ground_off: rng.wait(300 * SECOND),
            next_stranger: 0,
            lines,
            later: Vec::new(),
            sequence: 0,
            poll_at: 0,
            rng,
        }
    }

    /// The node begins. Returns its end of the line.
    pub fn begin<'a, const N: usize>(
        &mut self,
        now: u64,
        owners: &[Owner<'a>],
        configs: &[EngineConfig],
    ) -> Receiver<'a, N> {
        let mut node = NodeSettings::DEFAULT;
        node.identity.system = if self.learns { 0 } else { SYSTEM };
        node.identity.learnt = self.learnt;
        let parts: Vec<_> = self
            .people
            .iter()
            .map(|person| EngineParts {
                source: owners[person.engine].source(Origin::Mavlink).expect("nobody else holds it"),
                setup: owners[person.engine].setup(),
                config: configs[person.engine],
                settings: person.settings,
            })
            .collect();
        (self.output_frames, self.poll_at) = (OutputFrames::default(), now);
        let ports = [PortConfig::uart(57_600), PortConfig::usb()];
        Service::new(Instant::from_micros(now), node, SigningState::NONE, parts, ports)
    }

    /// Time of its next event.
    pub fn next(&self) -> u64 {
        let autopilot = &self.autopilot;
        let plane = autopilot.next_heartbeat.min(autopilot.next_outputs).max(autopilot.off_until);
        let plane = plane.min(autopilot.next_boot).min(autopilot.next_arming).min(autopilot.next_trouble);
        let lines = self.lines.iter().map(Line::next).min().unwrap_or(u64::MAX);
        let later = self.later.iter().map(|later| later.at).min().unwrap_or(u64::MAX);
        let stranger = if self.company { self.next_stranger } else { u64::MAX };
        let people = self.people.iter().map(|person| person.next_word).min().unwrap_or(u64::MAX);
        [plane, lines, later, self.next_ground, stranger, people, self.poll_at]
            .into_iter()
            .min()
            .unwrap_or(u64::MAX)
    }

    /// Until when the autopilot sends nothing of its outputs.
    fn silent_until(&self) -> u64 {
        self.autopilot.off_until.max(self.autopilot.silent_until).max(self.autopilot.dark_until)
    }

    /// All of them act once.
    pub fn act<const N: usize>(
        &mut self,
        now: u64,
        contexts: &mut [EngineContext],
        mut service: Option<&mut Receiver<'_, N>>,
    ) {
        self.fly(now, contexts);
        self.stand_by(now, contexts);
        self.pass_by(now);
        for place in 0..self.people.len() {
            let view = contexts[self.people[place].engine].view();
            self.look_after(now, place, &view, contexts);
        }
        while let Some(at) = self.later.iter().position(|later| later.at <= now) {
            let Later { port, from, message, meaning, .. } = self.later.swap_remove(at);
            self.send(now, port, from, &message, meaning);
        }
        for port in [TO_AUTOPILOT, TO_GROUND] {
            while let Some(frame) = self.lines[port].arrived(now) {
                if let Some(service) = service.as_deref_mut() {
                    self.deliver(now, port, frame, contexts, service);
                }
            }
        }
        match service {
            Some(service) if now >= self.poll_at => {
                self.poll_at = service.poll(Instant::from_micros(now)).as_micros().max(now + MS);
                self.collect(now, contexts, service);
                self.learnt = service.settings().identity.learnt;
            }
            Some(_) => {}
            None => self.poll_at = u64::MAX,
        }
        let silent = self.silent_until();
        for person in self.people.iter().filter(|person| person.settings.source == 1) {
            contexts[person.engine].outputs_silent_until = silent;
        }
    }

    fn send(&mut self, now: u64, port: usize, from: Sender, message: &Message, meaning: Meaning) {
        self.sequence = self.sequence.wrapping_add(1);
        let dress = if self.rng.percent(15) { Dress::V1 } else { Dress::V2 };
        // Version 1 has no outputs above 8, and no target of an answer.
        let dress = if matches!(meaning, Meaning::Outputs(..)) { Dress::V2 } else { dress };
        let bytes = frame(dress, from, self.sequence, message);
        self.lines[port].send(&mut self.rng, now, bytes, meaning);
    }

    /// The autopilot.
    fn fly(&mut self, now: u64, contexts: &mut [EngineContext]) {
        let rng = &mut self.rng;
        let plane = &mut self.autopilot;
        let mut notes = Vec::new();
        if now >= plane.next_boot {
            plane.off_until = now + rng.spread(200 * MS, 40 * SECOND);
            // Now and then it boots repeatedly.
            let again =
                if rng.percent(25) { rng.spread(SECOND, 10 * SECOND) } else { rng.wait(600 * SECOND) };
            plane.next_boot = plane.off_until + again;
            plane.booted = plane.off_until;
            plane.clock = if rng.percent(20) { u32::MAX - 20_000_000 } else { 0 };
            // In flight it may come back armed.
            plane.armed &= rng.percent(20);
            (plane.next_heartbeat, plane.next_outputs) =
                (plane.booted + rng.spread(MS, 3 * SECOND), plane.booted + rng.spread(MS, 5 * SECOND));
            self.lines[TO_AUTOPILOT].clear();
            notes.push(format!("the autopilot is off for {} ms", (plane.off_until - now) / MS));
        }
        if now < plane.off_until {
            notes
                .into_iter()
                .for_each(|note: String| contexts.iter_mut().for_each(|it| it.note(note.clone())));
            return;
        }
        if now >= plane.next_arming {
            plane.armed ^= true;
            plane.next_arming =
                now + if plane.armed { rng.wait(250 * SECOND) } else { rng.spread(200 * MS, 60 * SECOND) };
            notes.push(format!("the vehicle is {}", if plane.armed { "armed" } else { "disarmed" }));
        }
        if now >= plane.next_trouble {
            plane.next_trouble = now + rng.wait(150 * SECOND);
            let until = now + rng.spread(100 * MS, 60 * SECOND);
            match rng.below(3) {
                0 => plane.dark_until = until,
                1 => plane.silent_until = until,
                _ => plane.every = rng.pick(&[25, 50, 100, 200, 350]) * MS,
            }
            let (silent, dark) = (plane.silent_until.max(now), plane.dark_until.max(now));
            let text = format!(
                "outputs: none for {} ms, no pulse for {} ms",
                (silent - now) / MS,
                (dark - now) / MS
            );
            notes.push(text);
        }
        notes.into_iter().for_each(|note: String| contexts.iter_mut().for_each(|it| it.note(note.clone())));
        if now >= plane.next_heartbeat {
            plane.next_heartbeat = now + 950 * MS + rng.below(100 * MS);
            let armed = plane.armed;
            let message = heartbeat(1, 3, if armed { 0x81 } else { 0x51 }, 0);
            self.send(now, TO_AUTOPILOT, AUTOPILOT, &message, Meaning::All(Word::Vehicle { armed }));
        }
        let plane = &mut self.autopilot;
        if now < plane.next_outputs {
            return;
        }
        plane.next_outputs = now + plane.every;
        if now < plane.silent_until {
            return;
        }
        let clock = plane.clock.wrapping_add((now - plane.booted) as u32);
        let odd = [0, 700, 2300, u16::MAX][self.rng.below(4) as usize];
        let dark = now < plane.dark_until;
        let mut pulses = [odd; 16];
        let first = if self.high { 17 } else { 1 };
        for person in self.people.iter().filter(|_| !dark) {
            let pulse = 1100 + person.tenths as u16 * 8 / 10;
            // Nothing is below idle, or above full throttle.
            let beyond = [0, 250][usize::from(self.rng.percent(10))];
            let pulse = match person.tenths {
                0 => pulse - beyond,
                1000 => pulse + beyond,
                _ => pulse,
            };
            pulses[usize::from(person.settings.output - first)] = pulse;
        }
        let throttles = self
            .people
            .iter()
            .map(|person| (person.settings.source == 1).then_some((!dark).then_some(person.tenths)));
        let meaning = Meaning::Outputs(clock, throttles.collect());
        self.send(now, TO_AUTOPILOT, AUTOPILOT, &outputs(clock, u8::from(self.high), &pulses), meaning);
        if self.rng.percent(5) {
            // The other half of its outputs.
            let message = outputs(clock, u8::from(!self.high), &[1900; 16]);
            self.send(now, TO_AUTOPILOT, AUTOPILOT, &message, Meaning::Nothing);
        }
    }

    /// The ground station.
    fn stand_by(&mut self, now: u64, contexts: &mut [EngineContext]) {
        if now >= self.next_ground_off {
            self.ground_off_until = now + self.rng.spread(SECOND, 60 * SECOND);
            self.next_ground_off = self.ground_off_until + self.rng.wait(300 * SECOND);
            contexts.iter_mut().for_each(|it| it.note("the ground station is off".into()));
        }
        if now >= self.next_ground {
            self.next_ground = now + 950 * MS + self.rng.below(100 * MS);
            if now >= self.ground_off_until {
                self.send(now, TO_GROUND, GROUND, &heartbeat(6, 8, 0, 0), Meaning::All(Word::Station));
            }
        }
    }

    /// A second vehicle, whose frames reach the autopilot's port.
    fn pass_by(&mut self, now: u64) {
        if !self.company || now < self.next_stranger {
            return;
        }
        if self.learns {
            if now >= self.next_company {
                self.company_until = now + self.rng.spread(SECOND, 60 * SECOND);
                self.next_company = self.company_until + self.rng.wait(300 * SECOND);
            }
            // Alone, it would be learnt in place of ours.
            let ours = now > self.autopilot.booted + 5 * SECOND || self.autopilot.booted == 0;
            if now >= self.company_until || now < self.autopilot.off_until || !ours {
                self.next_stranger = now + SECOND;
                return;
            }
        }
        self.next_stranger = now + self.rng.spread(50 * MS, 2 * SECOND);
        let armed = !self.autopilot.armed;
        let message = match self.rng.below(10) {
            0..4 => heartbeat(1, 3, if armed { 0x81 } else { 0x51 }, 0),
            4..9 => outputs(now as u32, u8::from(self.high), &[1900; 16]),
            _ => {
                let place = self.rng.below(self.people.len() as u64) as u8;
                let what = self.rng.pick(&[0.0, 1.0]);
                command_long(
                    (SYSTEM, NODE + 1 + place),
                    ENGINE_CONTROL,
                    0,
                    [what, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
                )
            }
        };
        self.send(now, TO_AUTOPILOT, STRANGER, &message, Meaning::Nothing);
    }

    /// The operator of an engine: one command at a time.
    fn look_after(&mut self, now: u64, place: usize, view: &View, contexts: &mut [EngineContext]) {
        if now < self.people[place].next_word {
            return;
        }
        let engine = self.people[place].engine;
        let rng = &mut self.rng;
        let person = &mut self.people[place];
        person.next_word = now + 200 * MS;
        let rest = matches!(view.phase, Phase::Standby | Phase::Stopped);
        let ready = rest && view.egt < view.cool - 5.0;
        if now >= person.next_stick {
            person.next_stick = now + rng.spread(200 * MS, 40 * SECOND);
            let flies = person.program == Program::Flight || rng.percent(5);
            person.tenths = if flies { rng.pick(&[0, 150, 400, 600, 800, 1000]) } else { 0 };
        }
        if now >= person.next_slip {
            person.next_slip = now + rng.wait(100 * SECOND);
            self.slip(now, place, contexts);
            return;
        }
        if let Program::Ready(since) = person.program {
            person.tenths = if rng.percent(2) { 400 } else { 0 };
            let since = since.filter(|_| ready).or(ready.then_some(now));
            person.program = Program::Ready(since);
            if since.is_none_or(|since| now < since + 3 * SECOND) && now < person.until {
                return;
            }
        } else if now < person.until && !(person.program == Program::Start && view.phase == Phase::Running) {
            if person.program == Program::Start && rng.percent(1) && rng.percent(40) {
                self.stop(now, place, contexts);
                self.people[place].program = Program::Down;
                self.people[place].until = now + self.rng.wait(20 * SECOND);
            }
            return;
        }
        let (program, time) = match person.program {
            Program::Rest => (Program::Ready(None), rng.wait(200 * SECOND)),
            Program::Ready(_) => {
                let disarmed = !self.autopilot.armed && rng.percent(50) || rng.percent(5);
                self.start(now, place, disarmed, contexts);
                (Program::Start, 90 * SECOND)
            }
            Program::Start if view.phase == Phase::Running => {
                person.next_stick = now + rng.spread(200 * MS, 10 * SECOND);
                (Program::Flight, rng.wait(120 * SECOND))
            }
            Program::Start => (Program::Down, rng.wait(10 * SECOND)),
            Program::Flight => {
                if self.rng.percent(12) {
                    let word = Meaning::To(place, Word::EmergencyStop);
                    let (number, first) =
                        self.rng.pick(&[(USER_1, 1.0), (USER_1, 1.0), (FLIGHT_TERMINATION, 1.0)]);
                    let second = if number == USER_1 { MAGIC } else { 0.0 };
                    let all = self.rng.percent(20);
                    let word = if all { Meaning::All(Word::EmergencyStop) } else { word };
                    let to = if all { NODE } else { NODE + 1 + place as u8 };
                    contexts[engine].note(format!("ground station: emergency stop, command {number}"));
                    self.command(now, to, number, [first, second, 0.0, 0.0, 0.0, 0.0, 0.0], word);
                    (Program::Stopped, self.rng.spread(300 * MS, 30 * SECOND))
                } else if self.rng.percent(85) {
                    self.stop(now, place, contexts);
                    (Program::Down, self.rng.wait(30 * SECOND))
                } else {
                    // Nobody stops it: the command is repeated, without effect.
                    self.start(now, place, false, contexts);
                    (Program::Flight, self.rng.wait(60 * SECOND))
                }
            }
            Program::Stopped => {
                contexts[engine].note("ground station: release".into());
                let params = [2.0, MAGIC, 0.0, 0.0, 0.0, 0.0, 0.0];
                let meaning = Meaning::To(place, Word::Release);
                self.command(now, NODE + 1 + place as u8, USER_1, params, meaning);
                (
                    if self.rng.percent(60) { Program::Down } else { Program::Stopped },
                    self.rng.wait(10 * SECOND),
                )
            }
            Program::Down => (Program::Rest, self.rng.spread(300 * MS, 60 * SECOND)),
        };
        self.people[place].program = program;
        self.people[place].until = now + time;
    }

    /// Sends a command of an authorized person, mostly from the ground station, and repeats it if it seems to be lost.
    fn command(&mut self, now: u64, to: u8, number: u16, params: [f32; 7], meaning: Meaning) {
        let companion = self.rng.percent(8);
        let (port, from) = if companion { (TO_AUTOPILOT, COMPANION) } else { (TO_GROUND, GROUND) };
        let to = (SYSTEM, to);
        let meaning = match meaning {
            Meaning::To(place, Word::Start { confirmation, while_disarmed, .. }) => {
                Meaning::To(place, Word::Start { from: from.1, confirmation, while_disarmed })
            }
            other => other,
        };
        let [a, b, c, d, ..] = params;
        let int = self.rng.percent(20);
        let message = match int {
            true => command_int(to, number, [a, b, c, d]),
            false => command_long(to, number, 0, params),
        };
        self.later.push(Later { at: now, port, from, message, meaning: meaning.clone() });
        let mut at = now;
        for confirmation in 1..=if self.rng.percent(25) { self.rng.between(1, 4) as u8 } else { 0 } {
            at += self.rng.spread(50 * MS, 3 * SECOND);
            let confirmation = if int { 0 } else { confirmation };
            let message = match int {
                true => command_int(to, number, [a, b, c, d]),
                false => command_long(to, number, confirmation, params),
            };
            let meaning = match &meaning {
                Meaning::To(place, Word::Start { from, while_disarmed, .. }) => {
                    let (from, while_disarmed) = (*from, *while_disarmed);
                    Meaning::To(*place, Word::Start { from, confirmation, while_disarmed })
                }
                other => other.clone(),
            };
            self.later.push(Later { at, port, from, message, meaning });
        }
    }

    fn start(&mut self, now: u64, place: usize, while_disarmed: bool, contexts: &mut [EngineContext]) {
        let person = &self.people[place];
        let how = if while_disarmed { ", disarmed or not" } else { "" };
        contexts[person.engine].note(format!("ground station: start{how}"));
        let params = [1.0, 0.0, 0.0, f32::from(u8::from(while_disarmed)), 0.0, 0.0, 0.0];
        let meaning = Meaning::To(place, Word::Start { from: 0, confirmation: 0, while_disarmed });
        self.command(now, NODE + 1 + place as u8, ENGINE_CONTROL, params, meaning);
    }

    fn stop(&mut self, now: u64, place: usize, contexts: &mut [EngineContext]) {
        contexts[self.people[place].engine].note("ground station: stop".into());
        let to = NODE + 1 + place as u8;
        let meaning = Meaning::To(place, Word::Stop);
        match self.rng.below(3) {
            0 => self.command(now, to, ENGINE_CONTROL, [0.0; 7], meaning),
            1 => self.command(now, to, USER_1, [3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], meaning),
            _ => {
                let message = command_cancel((SYSTEM, to), ENGINE_CONTROL);
                self.later.push(Later { at: now, port: TO_GROUND, from: GROUND, message, meaning });
            }
        }
    }

    /// Something that must not affect an engine, or an unexpected command.
    fn slip(&mut self, now: u64, place: usize, contexts: &mut [EngineContext]) {
        let engine = self.people[place].engine;
        let own = (SYSTEM, NODE + 1 + place as u8);
        let start = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        let stop = [0.0; 7];
        let rng = &mut self.rng;
        let from_ground = |to, number, params| (TO_GROUND, GROUND, to, number, params);
        let what = rng.pick(&[start, start, stop]);
        let (port, from, to, number, params) = match rng.below(8) {
            // From an unauthorized sender.
            0 => (TO_GROUND, NOBODY, own, ENGINE_CONTROL, what),
            1 => (TO_AUTOPILOT, STRANGER, own, ENGINE_CONTROL, what),
            // Not to us, or to all.
            2 => from_ground((rng.pick(&[0, 7, 255]), own.1), ENGINE_CONTROL, what),
            3 => from_ground((SYSTEM, rng.pick(&[0, 1, NODE, NODE + 17, 190])), ENGINE_CONTROL, what),
            // Malformed.
            4 => {
                let mut params = what;
                match rng.below(5) {
                    0 => params[0] = rng.pick(&[2.0, -1.0, 0.5, f32::NAN, f32::INFINITY]),
                    1 => params[1] = rng.pick(&[2.0, f32::NAN]),
                    2 => params[2] = rng.pick(&[1.0, 10.0, f32::NAN]),
                    3 => params[3] = rng.pick(&[2.0, 3.0, 0.25]),
                    _ => params[0] = f32::MAX,
                }
                from_ground(own, ENGINE_CONTROL, params)
            }
            // Without its parameter, or with a service that does not exist.
            5 => {
                let first = rng.pick(&[1.0, 2.0, 4.0, 99.0]);
                from_ground(own, USER_1, [first, rng.pick(&[0.0, 21_195.0]), 0.0, 0.0, 0.0, 0.0, 0.0])
            }
            6 => from_ground(own, FLIGHT_TERMINATION, [rng.pick(&[0.0, 2.0]), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            _ => {
                self.word_out_of_turn(now, place, contexts);
                return;
            }
        };
        let stops_elsewhere = from == GROUND && to.0 != SYSTEM && params == stop;
        // Of a stop only the first parameter counts.
        let stops = (from, to, number) == (GROUND, own, ENGINE_CONTROL) && params[0] == 0.0;
        let (meaning, counts) = if stops_elsewhere {
            (Meaning::To(place, Word::StopElsewhere), "where the node has no id")
        } else if stops {
            (Meaning::To(place, Word::Stop), "as a stop")
        } else {
            (Meaning::Nothing, "for nothing")
        };
        contexts[engine]
            .note(format!("{from:?} to {to:?}: command {number} {params:?}, which counts {counts}"));
        self.later.push(Later { at: now, port, from, message: command_long(to, number, 0, params), meaning });
    }

    /// Something well formed, at any time.
    fn word_out_of_turn(&mut self, now: u64, place: usize, contexts: &mut [EngineContext]) {
        let engine = self.people[place].engine;
        let to = NODE + 1 + place as u8;
        match self.rng.below(6) {
            0 => self.start(now, place, true, contexts),
            1 => self.start(now, place, false, contexts),
            2 => self.stop(now, place, contexts),
            3 => {
                let meaning = Meaning::To(place, Word::Release);
                self.command(now, to, USER_1, [2.0, MAGIC, 0.0, 0.0, 0.0, 0.0, 0.0], meaning);
            }
            _ => {
                let (params, word) = if contexts[engine].history.traits().ctf {
                    ([10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], Word::Ctf)
                } else {
                    let number = self.rng.pick(&[1, 2, 3, 4, 5, 6, 10, 12, 13]);
                    ([20.0, f32::from(number), 0.0, 0.0, 0.0, 0.0, 0.0], Word::Service(number))
                };
                contexts[engine].note(format!("ground station: {word:?}"));
                self.command(now, to, USER_1, params, Meaning::To(place, word));
            }
        }
    }

    /// A frame arrives at the node.
    fn deliver<const N: usize>(
        &mut self,
        now: u64,
        port: usize,
        frame: InFlight<Meaning>,
        contexts: &mut [EngineContext],
        service: &mut Receiver<'_, N>,
    ) {
        let InFlight { sent, bytes, meaning, copy, .. } = frame;
        let mut say = |engine: usize, word: Word| {
            if let Some(mavlink) = &mut contexts[engine].history.mavlink {
                mavlink.received.push(Received { at: now, word });
            }
        };
        match meaning {
            None => {
                for person in &self.people {
                    let context = &mut contexts[person.engine];
                    if let Some(mavlink) = &mut context.history.mavlink {
                        mavlink.damaged.push(now);
                    }
                    let from = ["the autopilot", "the ground station"][port];
                    context.note(format!("a damaged frame from {from}: {bytes:02X?}"));
                }
            }
            Some(Meaning::Nothing) => {}
            Some(Meaning::To(place, word)) => say(self.people[place].engine, word),
            Some(Meaning::All(word)) => self.people.iter().for_each(|person| say(person.engine, word)),
            // A repeated frame has not advanced.
            Some(Meaning::Outputs(..)) if copy => {}
            Some(Meaning::Outputs(clock, throttles)) => {
                if let Some(sure) = self.output_frames.counts(now, sent, clock, self.autopilot.booted) {
                    for (person, tenths) in self.people.iter().zip(throttles) {
                        if let Some(tenths) = tenths {
                            say(person.engine, Word::Output { tenths, sure });
                        }
                    }
                }
            }
        }
        service.receive(Instant::from_micros(now), port, &bytes);
        self.collect(now, contexts, service);
    }

    /// Records the commands and the answers.
    fn collect<const N: usize>(
        &mut self,
        now: u64,
        contexts: &mut [EngineContext],
        service: &mut Receiver<'_, N>,
    ) {
        for (place, person) in self.people.iter().enumerate() {
            let commands = service.take_commands(place).map(settings::commanded);
            let commanded = commands.map(|command| Commanded { at: now, source: MAVLINK, command });
            contexts[person.engine].history.commanded.extend(commanded);
        }
        for port in [TO_AUTOPILOT, TO_GROUND] {
            let mut sent = Vec::new();
            let mut bytes = [0; 256];
            while let count @ 1.. = service.transmit(port, &mut bytes) {
                sent.extend_from_slice(&bytes[..count]);
            }
            for ack in acks(&sent).into_iter().filter(|ack| ack.command == ENGINE_CONTROL) {
                let place = usize::from(ack.component).checked_sub(usize::from(NODE) + 1);
                let person = place.and_then(|place| self.people.get(place));
                if let Some(mavlink) =
                    person.and_then(|person| contexts[person.engine].history.mavlink.as_mut())
                {
                    mavlink.answers.push(Answered { at: now, accepted: ack.result == 0 });
                }
            }
        }
    }
}

impl OutputFrames {
    /// Whether a frame of outputs may count, and whether it certainly does.
    fn counts(&mut self, now: u64, sent: u64, clock: u32, booted: u64) -> Option<bool> {
        let delay = now - sent;
        let last = self.last.replace((clock, booted));
        if let Some((before, of)) = last
            && of != booted
        {
            // A clock that has gone back has to be seen three times.
            let back = clock.wrapping_sub(before).cast_signed() <= 0;
            (self.anew, self.quickest) = (Some((u32::from(!back) * 3, now)), None);
        }
        let quickest = self.quickest.map_or(delay, |quickest| quickest.min(delay));
        self.quickest = Some(quickest);
        let Some((frames, since)) = &mut self.anew else {
            return (delay <= quickest + LATE + LATE_SLACK).then_some(delay + LATE_SLACK < quickest + LATE);
        };
        *frames += 1;
        if *frames < 3 {
            return None;
        }
        let sure = now >= *since + 3 * SECOND;
        if sure {
            self.anew = None;
        }
        Some(sure && delay + LATE_SLACK < quickest + LATE)
    }
}
