//! One engine of a world: its ECU, its pilots, its faults, and the history of all that.

use crate::acts::{Act, Blow};
use crate::drills::Director;
use crate::ecus::{self, Seen};
use crate::faults::{Disturber, Fault, Weather};
use crate::history::{
    ByMavlink, Commanded, History, MS, Mark, PilotCommand, Pin, Radio, SECOND, Sample, Spans,
};
use crate::judge::{Verdict, judge};
use crate::pilots::{Habit, Pilot, Rng, View};
use crate::radio::{Layout, Receiver, Transmitter};
use crate::settings::Setup;
use crate::valve::Valve;
use crate::wire::Reader;
use jetlink::channel::Owner;
use jetlink::command::Origin;
use jetlink::engine::config::Supervision;
use jetlink::engine::retained::RetainedState;
use jetlink::units::Hectopascals;
use sim::any::AnyEcu;
use sim::clock;
use sim::wire::{Plug, Settings, WireRx, WireTx, connect_with};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

/// The source of radio control, and that of MAVLink.
const RC: usize = 1;
const MAVLINK: usize = 2;

/// Interval between samples of the turbines.
pub const LOOK: u64 = 50 * MS;

/// Time for which this thread's clock has run, µs.
pub fn now() -> u64 {
    clock::now_ns() / 1000
}

/// One engine of a world, judged.
pub struct Judged {
    pub name: String,
    pub history: History,
    pub verdict: Verdict,
    pub notes: Vec<(u64, String)>,
}

/// One engine, its ECU, its pilots.
pub struct EngineContext {
    pub setup: Setup,
    pub plug: Plug<AnyEcu>,
    reader: Reader,
    pub history: History,
    pilots: Vec<Pilot>,
    disturber: Disturber,
    notes: Vec<(u64, String)>,
    /// Ignitions and losses of control that are in the history already.
    ignitions: usize,
    given_up: u64,
    pwm_since: Option<u64>,
    next_swap: u64,
    script: Script,
    director: Option<Director>,
    valve: Valve,
    transmitter: Option<Transmitter>,
    /// When its port was opened again.
    pub reopened: Rc<RefCell<Vec<u64>>>,
    /// Until when its autopilot sends no outputs.
    pub outputs_silent_until: u64,
}

/// A case: acts at times, and what the sources repeat.
#[derive(Debug, Default)]
struct Script {
    acts: VecDeque<(u64, Act)>,
    streams: [Option<PilotCommand>; 4],
    next_commands: u64,
}

impl Script {
    fn next(&self) -> u64 {
        let act = self.acts.front().map_or(u64::MAX, |(at, _)| *at);
        let commands = self.streams.iter().any(Option::is_some).then_some(self.next_commands);
        act.min(commands.unwrap_or(u64::MAX))
    }
}

impl EngineContext {
    pub fn random(rng: &mut Rng, setup: Setup, weather: Weather) -> (Self, (WireRx, WireTx)) {
        let mut sources = [0, 1, 2, 3];
        for last in (1..4).rev() {
            sources.swap(last, rng.below(last as u64 + 1) as usize);
        }
        // Two, of which the higher one relieves the lower one now and then.
        let pair = rng.percent(15);
        let count = if pair { 2 } else { rng.pick(&[1, 1, 2, 2, 3]) };
        if pair && sources[1] > sources[0] {
            sources.swap(0, 1);
        }
        let habit = |index: usize, rng: &mut Rng| match index {
            0 => Habit::Flies,
            _ if pair => Habit::Relieves,
            _ => rng.pick(&[Habit::Below, Habit::Restless, Habit::Flies, Habit::Relieves]),
        };
        let pilots = (0..count).map(|index| {
            let habit = habit(index, rng);
            Pilot::new(rng, sources[index], habit, setup.rules.when_other_fails.is_some())
        });
        let pilots = pilots.collect();
        let mut disturber = Disturber::new(rng, weather);
        disturber.signals = rng.percent(15);
        disturber.flames = setup.rules.when_other_fails.is_some();
        let next_swap = rng.wait(3000 * SECOND);
        let seed = rng.next();
        let (mut context, halves) = Self::new(setup, seed, disturber);
        (context.pilots, context.next_swap) = (pilots, next_swap);
        // One in four has radio control: the source is its own then.
        if seed >> 1 & 3 == 0 {
            context.pilots.retain(|pilot| pilot.source != RC);
            let transmitter = Transmitter::new(seed, Layout::of(seed >> 6));
            context.history.radio = Some(Radio { rules: transmitter.rules(), frames: Vec::new() });
            context.transmitter = Some(transmitter);
        }
        (context, halves)
    }

    /// With a director in place of pilots and random faults.
    pub fn drilled(rng: &mut Rng, setup: Setup, in_a_group: bool) -> (Self, (WireRx, WireTx)) {
        let mut director = Director::new(rng, &setup.rules, in_a_group);
        let seed = rng.next();
        // In every second world the port of a transmitter that hangs can be opened again.
        director.reopens = seed & 1 == 0;
        let (mut context, halves) = Self::new(setup, seed, Disturber::idle());
        context.history.reopened = director.reopens.then(Vec::new);
        context.director = Some(director);
        (context, halves)
    }

    /// With nothing but the acts of a case.
    pub fn scripted(setup: Setup, acts: Vec<(u64, Act)>) -> (Self, (WireRx, WireTx)) {
        let (mut context, halves) = Self::new(setup, 1, Disturber::idle());
        context.script.acts = acts.into();
        (context, halves)
    }

    fn new(setup: Setup, seed: u64, disturber: Disturber) -> (Self, (WireRx, WireTx)) {
        let (rx, tx, plug) = connect_with(setup.ecu(), Settings::new(setup.line, seed));
        plug.record(true);
        let context = Self {
            reader: Reader::new(setup.protocol()),
            history: History::new(setup.rules),
            plug,
            pilots: Vec::new(),
            disturber,
            notes: Vec::new(),
            ignitions: 0,
            given_up: 0,
            pwm_since: None,
            next_swap: u64::MAX,
            script: Script::default(),
            director: None,
            valve: Valve::new(),
            transmitter: None,
            reopened: Rc::default(),
            outputs_silent_until: 0,
            setup,
        };
        (context, (rx, tx))
    }

    /// Its pilot begins now, in standby.
    pub fn fly(&mut self, rng: &mut Rng) {
        if let Some(pilot) = self.pilots.first_mut() {
            pilot.fly(rng, now());
        }
    }

    pub fn runs_with_a_fault(&self) -> bool {
        self.history.samples.last().is_some_and(|sample| sample.runs() && sample.fault)
    }

    pub fn is_live(&self) -> bool {
        self.history.samples.last().is_some_and(|sample| sample.phase.is_live())
    }

    /// It is commanded through MAVLink: no other pilot has that source.
    pub fn command_by_mavlink(&mut self, mavlink: ByMavlink) {
        self.pilots.retain(|pilot| pilot.source != MAVLINK);
        self.history.mavlink = Some(mavlink);
    }

    /// Until when no pilot commands anything.
    pub fn silent_until(&self) -> u64 {
        let pilots = self.next_pilot();
        match &self.history.mavlink {
            Some(mavlink) if mavlink.has_output => pilots.min(self.outputs_silent_until),
            _ if self.pilots.is_empty() => 0,
            _ => pilots,
        }
    }

    fn next_pilot(&self) -> u64 {
        self.pilots.iter().map(|pilot| pilot.next).min().unwrap_or(u64::MAX)
    }

    /// Time of the next event here.
    pub fn next(&self) -> u64 {
        self.next_pilot()
            .min(self.disturber.next())
            .min(self.script.next())
            .min(self.director.as_ref().map_or(u64::MAX, |director| director.next))
            .min(self.transmitter.as_ref().map_or(u64::MAX, |transmitter| transmitter.next))
    }

    /// Everything here except the node acts once.
    pub fn act(&mut self, rng: &mut Rng, owner: Option<&Owner<'_>>, receiver: Option<&mut Receiver<'_>>) {
        let at = now();
        if let Some(reopened) = &mut self.history.reopened {
            reopened.append(&mut self.reopened.borrow_mut());
        }
        let starts = self.plug.ecu(|ecu| ecu.turbine().phase().is_starting());
        let seen = self.history.samples.last().is_some_and(|sample| sample.phase.is_starting());
        if at >= self.disturber.next() || starts && !seen {
            // As it was just before something goes wrong.
            self.look();
        }
        let notes = self.disturber.disturb(rng, &self.plug, &mut self.history, at);
        for text in notes {
            self.note(text);
        }
        if at >= self.next_swap {
            self.next_swap = at + rng.wait(3000 * SECOND);
            let number = rng.between(1, 7) as u8;
            let off = rng.spread(50 * MS, 60 * SECOND);
            self.swap(rng, number, off);
        }
        self.direct(rng);
        self.play_script(rng, owner);
        self.commands_now(rng, owner);
        self.transmit(receiver);
        if let Some(owner) = owner {
            self.valve.follow(&mut self.history, at, &owner.handle().telemetry());
        }
    }

    /// The node begins with this engine's record; `has_failed`: its starts have failed for too long. Gives its receiver of radio control.
    pub fn begin<'a>(
        &mut self,
        fingerprint: u32,
        record: Option<RetainedState>,
        has_failed: bool,
        owner: &Owner<'a>,
    ) -> Option<Receiver<'a>> {
        self.valve.begin(&mut self.history, now(), fingerprint, record, has_failed);
        // What was configured in flight is lost at a reset.
        if let (Some(share), [.., _]) = (self.setup.rules.when_other_fails, &self.history.shares[..]) {
            self.history.shares.push((now(), share));
        }
        self.transmitter.as_mut().map(|transmitter| transmitter.receiver(owner, &self.setup.config))
    }

    /// The next frame of radio control, if it is due.
    fn transmit(&mut self, receiver: Option<&mut Receiver<'_>>) {
        let at = now();
        if self.transmitter.as_ref().is_none_or(|transmitter| at < transmitter.next) {
            return;
        }
        let view = self.view();
        let Some(transmitter) = &mut self.transmitter else { return };
        let moved = transmitter.fly(&view);
        let (frame, commands) = transmitter.send(at, receiver);
        if let (Some(radio), Some(frame)) = (&mut self.history.radio, frame) {
            radio.frames.push((at, frame));
        }
        let commands = commands.into_iter().map(|command| Commanded { at, source: RC, command });
        self.history.commanded.extend(commands);
        if let Some(moved) = moved {
            self.note(moved);
        }
    }

    /// Whether its valve is closed because the node's starts have failed for too long.
    pub fn is_cut(&self) -> bool {
        self.valve.is_cut()
    }

    /// Nothing is left of the memory of its outputs.
    pub const fn forget(&mut self) {
        self.valve.forget();
    }

    /// There is no node from here on.
    pub fn release(&mut self) {
        self.valve.release(&mut self.history, now());
    }

    /// Plays the next steps of its drill.
    fn direct(&mut self, rng: &mut Rng) {
        let view = self.view();
        let Some(director) = self.director.as_mut().filter(|director| view.now >= director.next) else {
            return;
        };
        let (acts, notes) = director.play(rng, &view);
        self.script.acts.extend(acts.into_iter().map(|act| (view.now, act)));
        for text in notes {
            self.note(text);
        }
    }

    /// A reset of the node that belongs to its drill.
    pub fn blow(&mut self) -> Option<Blow> {
        self.director.as_mut()?.blow.take()
    }

    fn play_script(&mut self, rng: &mut Rng, owner: Option<&Owner<'_>>) {
        let at = now();
        while let Some((_, act)) = self.script.acts.pop_front_if(|(when, _)| *when <= at) {
            match act {
                Act::Stream(source, command) => {
                    self.script.streams[source] = command;
                    self.script.next_commands = at;
                }
                Act::Once(source, command) => self.send_command(owner, source, command),
                Act::Fault(fault, length) => {
                    self.disturber.begin(rng, &self.plug, &mut self.history, fault, at, at + length);
                    self.note(format!("{fault} for {} ms", length / MS));
                }
                Act::Beside(fault, length) => {
                    self.disturber.begin_beside(rng, &self.plug, fault, at, at + length);
                    self.note(format!("{fault} for {} ms", length / MS));
                }
                Act::Swap(number, off) => self.swap(rng, number, off),
                Act::Share(share) => self.share(owner, share),
            }
        }
        if at >= self.script.next_commands {
            self.script.next_commands = at + 100 * MS;
            for (source, command) in self.script.streams.into_iter().enumerate() {
                if let Some(command) = command {
                    self.send_command(owner, source, command);
                }
            }
        }
    }

    /// The ECU loses its power until then, together with the node.
    pub fn power_off(&mut self, rng: &mut Rng, until: u64) {
        self.disturber.begin(rng, &self.plug, &mut self.history, Fault::PowerOff, now(), until);
    }

    pub fn note(&mut self, text: String) {
        self.notes.push((now(), text));
    }

    /// The turbine and the wire, as they are now.
    pub fn look(&mut self) {
        let at = now();
        self.cut_off(at);
        let record = self.plug.take_log();
        let frames = self.reader.read(&record);
        self.history.frames.extend(frames);
        if self.history.traits().replies_only {
            self.history.sets.extend(self.reader.ends_of_sets(&record));
        }
        let (seen, before) = (self.ignitions, self.given_up);
        let (sample, ignitions, given_up, pwm) = self.plug.ecu(|ecu| {
            let ecu = &*ecu;
            let turbine = ecu.turbine();
            let Seen { fault, pwm, hidden } = ecus::ecu(ecu).seen();
            let given_up = ecu.counts().loss_stops;
            let phase = turbine.phase();
            let lit = turbine.thrust() > 0.0;
            let sample = Sample {
                at,
                phase,
                lit,
                rpm: turbine.rpm(),
                egt: turbine.egt(),
                flow: turbine.fuel_flow(),
                fault,
                hidden,
            };
            // By the turbine's own record: a relight may have ended again before this sample.
            let history = turbine.history();
            let mark = |when| match history.relights.contains(when) {
                true => Mark::Relight,
                false => Mark::Ignition,
            };
            let ignitions: Vec<(u64, Mark)> =
                history.ignitions.iter().skip(seen).map(|when| (when / 1000, mark(when))).collect();
            (sample, ignitions, given_up, pwm)
        });
        self.ignitions += ignitions.len();
        for (when, mark) in ignitions {
            self.history.marks.push((when.min(at), mark));
        }
        if given_up > before {
            self.given_up = given_up;
            self.history.marks.push((at, Mark::GivenUp));
        }
        match (pwm, self.pwm_since) {
            (true, None) => self.pwm_since = Some(at.saturating_sub(LOOK)),
            (false, Some(since)) => {
                self.history.pwm.push(since, at + SECOND);
                self.pwm_since = None;
            }
            _ => {}
        }
        self.history.samples.push(sample);
    }

    /// An engine behind a shut valve goes out.
    fn cut_off(&mut self, at: u64) {
        if self.history.pin.last().is_some_and(|(_, pin)| *pin == Pin::Floats) {
            self.valve.release(&mut self.history, at);
        }
        if self.valve.is_shut() {
            self.plug.ecu(|ecu| {
                let turbine = ecu.turbine_mut();
                if turbine.thrust() > 0.0 {
                    turbine.flame_out();
                }
            });
        }
    }

    /// What a pilot sees.
    pub fn view(&self) -> View {
        let at = now();
        let (phase, egt, rpm) = self.plug.ecu(|ecu| {
            let turbine = ecu.turbine();
            (turbine.phase(), turbine.egt(), turbine.rpm())
        });
        let takes_rpm = self.history.version(at) >= 4;
        let rules = &self.history.rules;
        View {
            now: at,
            phase,
            egt,
            rpm,
            cool: rules.egt_max,
            max_rpm: takes_rpm.then_some(rules.max_rpm as u32),
        }
    }

    /// The pilots' commands of this moment reach the node, if there is one.
    fn commands_now(&mut self, rng: &mut Rng, owner: Option<&Owner<'_>>) {
        let at = now();
        if self.pilots.iter().all(|pilot| pilot.next > at) {
            return;
        }
        let view = self.view();
        if let Some(owner) = owner.filter(|_| rng.percent(1))
            && let Ok(pressure) = Hectopascals::new(rng.between(300, 1100) as u16)
        {
            owner.setup().pressure(pressure);
        }
        for index in 0..self.pilots.len() {
            let commands = self.pilots[index].commands_now(rng, &view);
            let source = self.pilots[index].source;
            for command in commands {
                self.send_command(owner, source, command);
            }
        }
    }

    fn send_command(&mut self, owner: Option<&Owner<'_>>, source: usize, command: PilotCommand) {
        let (Some(owner), Some(to_send)) = (owner, self.setup.command(command)) else {
            return;
        };
        // The answers are not used.
        let claimed = match Origin::SOURCES[source] {
            Origin::Emergency => owner.emergency_source(),
            origin => owner.source(origin),
        };
        let _ = claimed.expect("nobody else holds it").command(to_send);
        self.history.commanded.push(Commanded { at: now(), source, command });
    }

    /// Somebody changes the reduction that applies while another engine has failed.
    fn share(&mut self, owner: Option<&Owner<'_>>, share: u16) {
        let Some(owner) = owner else { return };
        let supervision = Supervision { when_other_fails: Some(share), ..self.setup.config.supervision };
        owner.setup().configure(&supervision).expect("in its range");
        self.history.shares.push((now(), share.into()));
        self.note(format!("the share beside an engine that failed is {} per mille", share));
    }

    /// Another ECU of the same protocol is plugged in, and has no power for this time.
    fn swap(&mut self, rng: &mut Rng, number: u8, off: u64) {
        let at = now();
        let ecu = self.setup.another(number);
        self.look();
        drop(self.plug.replace_ecu(ecu));
        (self.ignitions, self.given_up) = (0, 0);
        self.power_off(rng, at + off);
        let version = if self.history.traits().versions { number } else { 0 };
        self.history.versions.push((at, version));
        self.note(format!("another ECU, number {number}, without power for {} ms", off / MS));
    }

    /// Ends the history.
    pub fn end(&mut self) {
        let at = now();
        self.look();
        self.disturber.finish(&mut self.history, at);
        self.history.sets.extend(self.reader.last_report().filter(|_| self.history.traits().replies_only));
        self.history.alternate = core::mem::take(&mut self.reader.alternate);
        self.valve.end(&mut self.history, at);
        if let Some(since) = self.pwm_since.take() {
            self.history.pwm.push(since, at);
        }
        self.history.end = at;
        // One frame may have been in transmission when the transmitter hung.
        for &stall in &self.history.stalls {
            let first = self.history.frames.partition_point(|frame| frame.at < stall.saturating_sub(MS));
            if self.history.frames.get(first).is_some_and(|frame| frame.at < stall + 5 * MS) {
                self.history.frames.remove(first);
            }
        }
    }

    /// The result, with the times in which other engines of the group may have failed, have certainly failed,
    /// or delay its start, and those of their starts.
    pub fn judged(&mut self, failed: Spans, down: Spans, busy: Spans, starts: Vec<u64>) -> Judged {
        (self.history.other_failed, self.history.other_down) = (failed, down);
        (self.history.other_starts, self.history.other_busy) = (starts, busy);
        let verdict = judge(&self.history);
        Judged {
            name: self.setup.name(),
            history: core::mem::replace(&mut self.history, History::new(self.setup.rules)),
            verdict,
            notes: core::mem::take(&mut self.notes),
        }
    }
}
