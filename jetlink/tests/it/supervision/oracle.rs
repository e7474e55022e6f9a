//! The judge of one engine: a small model of who commands it, written from what is promised and from its
//! configuration, never from the engine's own code. It sees what the sources said, what the ECU really does, and
//! every frame on the wire. The invariants and their tolerances are in docs/invariants.md.

use super::wire::{Frame, Switch};
use jetlink::command::{Accepted, Command, Demand, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::limit::Action;

/// Two things at the same instant may come in either order.
const TOL: u64 = 1_000;
const SECOND: u64 = 1_000_000;
/// The node may be behind the ECU's truth by so much: a status that comes round every 0.45 s, two that agree, and
/// the sampling of the truth.
const BEHIND: u64 = 1_500_000;
/// The same on a line that has lately been disturbed: a state up to 3 s old is believed.
const BEHIND_FAULTY: u64 = 5_000_000;
/// After a reset it is not certain for so long which sources count as lost: how long they were silent is retained in steps.
const UNCERTAIN: u64 = 8_000_000;
/// Where no engine is known to live, standby comes so long after the fail-safe stage began.
const RUN_OUT: u64 = 10_000_000;
/// From the loss of an ECU's power, or its last byte, until nothing more says run: three expected frames, and a reply.
pub const DARK: u64 = 600_000;
/// What silence that is carried over a reset may lack, beside the time that the node was down: a step in which it is
/// retained, and the interval at which the node looks at the time.
const CARRIED: u64 = 300_000;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Word {
    /// Present, and wants nothing.
    Nothing,
    Standby,
    Run(Demand),
}

#[derive(Clone, Copy, Debug)]
struct Source {
    word: Word,
    heard: u64,
    /// It counts as silent from then on.
    silent_from: u64,
    since: u64,
    was_lost: bool,
    changed: u64,
    /// The word before that.
    before: Word,
    /// When it last said standby, with no other word since.
    standby_at: Option<u64>,
    /// Its own standby permits its own next run to start the engine, given then.
    permitted: Option<u64>,
}

impl Source {
    const fn new(at: u64, word: Word) -> Self {
        Self {
            word,
            heard: at,
            silent_from: at,
            since: at,
            was_lost: false,
            changed: at,
            before: word,
            standby_at: None,
            permitted: None,
        }
    }
}

/// A word that asked for a start, and what stands against it.
#[derive(Clone, Debug)]
struct Attempt {
    at: u64,
    by: Origin,
    against: Option<String>,
}

/// What the ECU really does and says, sampled.
#[derive(Clone, Copy, Debug, Default)]
pub struct Truth {
    pub live: bool,
    pub running: bool,
    /// It says that the engine runs, as the document has it: a ZK ECU also where it learns.
    pub says_running: bool,
    /// With a fault it says an exhaust temperature that nothing but a fire makes.
    pub says_burning: bool,
    /// It says standby, as the document has it.
    pub standby: bool,
    pub faulty: bool,
    pub egt: f64,
    /// It says something else than it does, or has no power.
    pub odd: bool,
    /// Tenths of a percent that it obeys.
    pub obeyed: u16,
    pub obeys_run: bool,
    /// How often it stopped its engine because the node was silent.
    pub gave_up: u64,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kept {
    /// With the demand in force, whose it is, and whether that source was lost, if there is one.
    Whole(Option<(Origin, Demand, bool)>),
    /// Whole, and the node's power was lost: what could start or raise an engine is not believed.
    PowerLost,
    Lost,
}

/// What happened, in the order of time.
#[derive(Clone, Copy, Debug)]
pub enum Input {
    Said(Origin, Command, Result<Accepted, Rejected>),
    Truth(Truth),
    /// The node was reset; it was down for so long.
    Boot {
        kept: Kept,
        down: u64,
    },
    /// The line or the ECU was disturbed, or is no longer.
    Fault,
    /// The line was disturbed.
    LineFault,
    /// The ECU lost its power.
    Dark,
    /// Nothing has come from the ECU for [`DARK`].
    Unheard,
    /// Something comes again.
    Heard,
    /// The node's transmitter hung until now: what lay in its ring comes out late.
    HungUntil(u64),
    /// The ECU is heard again, after it was silent for so long that the link was lost.
    LinkBack,
    /// Another engine of the group was started, as seen on its wire.
    OtherStarted,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    pub frames: u64,
    pub run_frames: u64,
    pub stop_frames: u64,
    pub starts: u64,
    pub silent_frames: u64,
    pub fail_safe_frames: u64,
    pub resets_running: u64,
    pub went_on: u64,
    pub exact_frames: u64,
    pub rpm_frames: u64,
    pub takeovers: u64,
    /// Frames while the demand rises at its set rate.
    pub rising_frames: u64,
    /// Runs of a healthy engine that a standby or stop ended, for a reason.
    pub healthy_ends: u64,
    /// Runs whose ECU lost its power.
    pub dark_runs: u64,
}

#[derive(Debug)]
pub struct Oracle {
    config: EngineConfig,
    amt: bool,
    /// The ECU holds an rpm by itself.
    speed_control: bool,
    idle_rpm: u32,
    max_rpm: u32,
    pub tally: Tally,

    sources: [Option<Source>; 4],
    latched: Option<(Origin, u64)>,
    armed: bool,
    /// Who said "arm" last, and who has to say "disarm" before that counts again.
    arm_commanded: [bool; 4],
    must_disarm: [bool; 4],
    standby_said: Option<u64>,
    /// Words that asked for a start since the last frame with a switch.
    attempts: Vec<Attempt>,

    at: u64,
    wire_run: bool,
    /// After a reset a run may go on.
    may_go_on: bool,
    /// The engine may have reached running in this run.
    reached: bool,
    /// It has.
    ran: bool,
    opened: u64,
    last_frame: u64,
    last_run: u64,
    throttle: u16,
    rpm: u32,
    factor: u8,
    /// The largest demands that a source in control asked for since the last frame.
    peak_throttle: u16,
    peak_rpm: u32,
    /// The same, of the source that certainly was in control.
    ruled_peak: u16,
    /// The same since the last reset, of any source, while it is not certain who is in control.
    uncertain_throttle: u16,
    uncertain_rpm: u32,

    /// What the last source in control asked for last: with a slew the demand may still be on its way there.
    last_asked: u16,
    in_force: Option<Origin>,
    waiting: Option<(Origin, u64)>,
    maybe_close: bool,
    lost: bool,
    settled: u64,
    /// A source in control wanted the engine to run until then: at the latest, with what a reset may hide, and at the
    /// earliest.
    wanted_until: u64,
    wanted_until_least: u64,
    /// What was on the wire when the last source fell silent.
    silent: Option<(u64, u16, u32)>,
    /// The order to run has to be over by then, for this reason.
    over: Option<(u64, String)>,
    /// A reason for standby came then: a source's, in doubt whether it is the one in control, or the last stage of loss.
    standby_reason: Option<u64>,
    /// It rises at its set rate, since then and from there.
    rising: Option<(u64, u16)>,
    /// When what was asked for was last within what it had risen to.
    met_at: Option<u64>,
    /// The last demand on the wire was an rpm.
    rpm_last: bool,
    /// The most that the ECU obeyed lately: in this period of 1.5 s, which began then, and in the one before.
    obeyed: (u64, u16, u16),

    truth: Truth,
    standby_at: u64,
    healthy_at: u64,
    cool_at: u64,
    warm_at: u64,
    live_at: u64,
    live_since: Option<u64>,
    running_since: Option<u64>,
    /// Since when it runs, is said to, and has no fault.
    healthy_since: Option<u64>,
    odd_at: u64,
    fault_at: u64,
    line_fault_at: u64,
    dark_at: Option<u64>,
    unheard: bool,
    hung: (u64, u64),
    other_started: Option<u64>,
    link_back: u64,
    limited: bool,

    booted: u64,
    kept: Option<(Origin, Demand, bool)>,
    /// Highest throttle and rpm on the wire or obeyed before the reset.
    before_reset: (u16, u32),
    guard: bool,
    memory_lost: bool,
    gave_up_before: Option<u64>,
}

const fn slot(origin: Origin) -> usize {
    // Highest first, as in `Origin::SOURCES`.
    4 - origin.priority() as usize
}

impl Oracle {
    pub fn new(config: EngineConfig, speed_control: bool, idle_rpm: u32, max_rpm: u32) -> Self {
        let amt = matches!(config.ecu, jetlink::ecu::EcuConfig::Amt(_));
        Self {
            config,
            amt,
            speed_control,
            idle_rpm,
            max_rpm,
            tally: Tally::default(),
            sources: [None; 4],
            latched: None,
            armed: false,
            arm_commanded: [false; 4],
            must_disarm: [false; 4],
            standby_said: None,
            attempts: Vec::new(),
            at: 0,
            wire_run: false,
            may_go_on: true,
            reached: false,
            ran: false,
            opened: 0,
            last_frame: 0,
            last_run: 0,
            throttle: 0,
            rpm: 0,
            factor: 4,
            peak_throttle: 0,
            peak_rpm: 0,
            ruled_peak: 0,
            uncertain_throttle: 0,
            uncertain_rpm: 0,
            last_asked: 0,
            in_force: None,
            waiting: None,
            maybe_close: false,
            lost: false,
            settled: 0,
            wanted_until: 0,
            wanted_until_least: 0,
            silent: None,
            over: None,
            standby_reason: None,
            rising: None,
            met_at: None,
            rpm_last: false,
            obeyed: (0, 0, 0),
            truth: Truth::default(),
            standby_at: 0,
            healthy_at: 0,
            cool_at: 0,
            warm_at: 0,
            live_at: 0,
            live_since: None,
            running_since: None,
            healthy_since: None,
            odd_at: 0,
            fault_at: 0,
            line_fault_at: 0,
            dark_at: None,
            unheard: false,
            hung: (0, 0),
            other_started: None,
            link_back: 0,
            limited: false,
            booted: 0,
            kept: None,
            before_reset: (0, 0),
            guard: false,
            memory_lost: false,
            gave_up_before: None,
        }
    }

    // -----------------------------------------------------------------------------------------
    // Who is in control, from the documentation of the sources
    // -----------------------------------------------------------------------------------------

    fn age(&self, origin: Origin) -> u64 {
        self.config.supervision.ages.of(origin).as_micros()
    }

    fn longest_age(&self) -> u64 {
        Origin::SOURCES.into_iter().map(|origin| self.age(origin)).max().unwrap_or(0)
    }

    fn each(&self) -> impl Iterator<Item = (Origin, Source)> {
        Origin::SOURCES.into_iter().zip(self.sources).filter_map(|(origin, source)| Some((origin, source?)))
    }

    /// It spoke for so long without a gap; the silence since does not count.
    fn steady(&self, source: &Source) -> bool {
        source.heard >= source.since + self.config.supervision.recover_after.as_micros()
    }

    fn ruler(&self, at: u64) -> Option<(Origin, Source)> {
        self.each().find(|(_, source)| {
            let fresh = at < source.silent_from && source.word != Word::Nothing;
            fresh && (!source.was_lost || self.steady(source))
        })
    }

    /// It is not certain who is in control.
    fn uncertain(&self, at: u64) -> bool {
        at < self.booted + UNCERTAIN
    }

    /// Time goes on: who is in control may change with nothing said.
    fn advance(&mut self, to: u64) {
        let within = self.config.supervision.takeover.within.as_micros();
        loop {
            let waited = self.waiting.map(|(_, since)| since + within);
            let next = self
                .each()
                .map(|(_, source)| source.silent_from)
                .chain(waited)
                .filter(|at| *at > self.at && *at <= to)
                .min();
            let Some(next) = next else { break };
            let ruled = self.ruler(self.at);
            self.pass(next);
            self.ruled_until_now(ruled);
            self.look();
        }
        self.pass(to);
    }

    fn pass(&mut self, to: u64) {
        if let Some((_, Source { word: Word::Run(demand), .. })) = self.ruler(self.at) {
            self.may_have_risen(to, demand);
            self.wanted_until = self.wanted_until.max(to);
            // One that waits to take over does not count yet.
            if !self.uncertain(to) && !self.lost && self.waiting.is_none() {
                self.wanted_until_least = to;
            }
        }
        if self.wire_run && (self.ended_by_loss(to) || self.ended_by_lower(to)) {
            self.standby_reason = Some(to);
        }
        self.at = to;
    }

    fn look(&mut self) {
        let at = self.at;
        let takeover = self.config.supervision.takeover;
        match self.ruler(at) {
            Some((origin, source)) if matches!(source.word, Word::Run(_)) => {
                let Word::Run(demand) = source.word else { return };
                self.peak(demand);
                self.last_asked = self.last_asked.max(self.as_throttle(demand));
                if self.uncertain(at) {
                    self.in_force = None;
                    self.lost = true;
                }
                // Another one may have taken over meanwhile, by being close.
                let certain = self.waiting.is_none() || !self.maybe_close;
                // It was never away, or for a short gap only; away also where another one was about to take over.
                let away = self.lost || self.waiting.is_some();
                if self.in_force == Some(origin) && certain && !(away && source.was_lost) {
                    self.last_asked = self.as_throttle(demand);
                    self.ruled_peak = self.ruled_peak.max(self.last_asked);
                    if away {
                        // The demand was held until now.
                        (self.lost, self.waiting) = (false, None);
                        self.settled = at;
                        self.rise(at);
                    }
                    self.may_have_risen(at, demand);
                    return;
                }
                if self.waiting.is_some_and(|(before, _)| before != origin) && self.maybe_close {
                    self.in_force = None;
                }
                let since = match self.waiting {
                    // It may have taken over by being close; then another one begins to wait anew.
                    Some((before, _))
                        if before != origin && (self.maybe_close || self.in_force.is_none()) =>
                    {
                        at
                    }
                    Some((_, since)) => since,
                    None => at,
                };
                if self.waiting.is_none_or(|(before, _)| before != origin) {
                    self.maybe_close = false;
                }
                self.waiting = Some((origin, since));
                // While the transmitter hangs, what is in force does not show.
                self.maybe_close |= at < self.hung.1;
                self.maybe_close |= match demand {
                    Demand::Throttle(throttle) => {
                        throttle.tenths().abs_diff(self.throttle) <= takeover.throttle_band.tenths() + 20
                    }
                    Demand::Rpm(rpm) => {
                        !self.speed_control || rpm.get().abs_diff(self.rpm) <= takeover.rpm_band.get() + 500
                    }
                };
                self.may_have_risen(at, demand);
                if at >= since + takeover.within.as_micros() {
                    self.tally.takeovers += 1;
                    let certain = self.in_force.replace(origin).is_some() && !self.maybe_close;
                    self.lost = false;
                    self.waiting = None;
                    self.settled = at;
                    self.rise(at);
                    if !certain {
                        // It may have been there before, and have risen.
                        self.rising = None;
                    }
                }
            }
            // Nobody, or a lower one that says standby: the stages of loss go on.
            other => {
                let certain = self.waiting.is_none() || !self.maybe_close;
                if let Some((origin, _)) = other {
                    self.standby_reason = Some(at);
                    let above = self.in_force.is_some_and(|before| origin.priority() >= before.priority());
                    if certain && above && !self.uncertain(at) {
                        self.end(at, || format!("{origin:?} is in control and says standby"));
                    }
                }
                if self.waiting.is_some() && self.maybe_close {
                    self.in_force = None;
                }
                self.lost = true;
                self.waiting = None;
            }
        }
    }

    /// Whoever was in control up to now and no longer is: its demand may have come into force since the last frame, and be
    /// what is held from here on.
    fn ruled_until_now(&mut self, ruled: Option<(Origin, Source)>) {
        if let Some((before, Source { word: Word::Run(demand), .. })) = ruled
            && self.ruler(self.at).is_none_or(|(origin, _)| origin != before)
        {
            self.peak(demand);
        }
    }

    fn peak(&mut self, demand: Demand) {
        self.peak_throttle = self.peak_throttle.max(self.as_throttle(demand));
        if let Demand::Rpm(rpm) = demand
            && self.speed_control
        {
            self.peak_rpm = self.peak_rpm.max(rpm.get());
        }
    }

    /// The demand rises at its set rate from here.
    fn rise(&mut self, at: u64) {
        if !self.uncertain(at) {
            // What was in force may have moved on since the last frame.
            let moved = match self.config.supervision.slew.up {
                Some(up) => {
                    let passed = at.saturating_sub(self.last_frame) + 25_000;
                    self.throttle + u16::try_from(u64::from(up) * passed / SECOND).unwrap_or(1000)
                }
                None => self.throttle.max(self.ruled_peak),
            };
            self.rising = Some((at, self.rising.map_or(moved, |(_, from)| from.max(moved))));
        }
    }

    /// Where the set rate may have got the demand to by now.
    fn risen(&self, at: u64) -> Option<u16> {
        let (since, from) = self.rising?;
        let rate = u64::from(self.config.supervision.rise);
        // 150 ms for what the truth and the frames are sampled at; half a percent for AMT's resolution.
        let risen = u64::from(from) + rate * (at.saturating_sub(since) + 150_000) / SECOND + 6;
        Some(u16::try_from(risen).unwrap_or(u16::MAX))
    }

    /// What is asked for may have been reached: from there on `slew.up` has the say.
    fn may_have_risen(&mut self, at: u64, demand: Demand) {
        let asked = match demand {
            Demand::Throttle(throttle) => throttle.tenths(),
            Demand::Rpm(_) => 0,
        };
        if self.risen(at).is_some_and(|risen| asked <= risen) {
            self.met_at = Some(at);
            if self.reached {
                self.rising = None;
            }
        }
    }

    /// The order to run is over.
    fn end(&mut self, at: u64, why: impl FnOnce() -> String) {
        if self.over.is_none() {
            self.over = Some((at, why()));
        }
    }

    fn is_idle(&self, demand: Demand) -> bool {
        match demand {
            Demand::Throttle(throttle) => throttle <= self.config.supervision.start.idle_band,
            Demand::Rpm(rpm) => rpm.get() <= self.idle_rpm + 10,
        }
    }

    // -----------------------------------------------------------------------------------------
    // What happens
    // -----------------------------------------------------------------------------------------

    pub fn input(&mut self, at: u64, input: Input) -> Result<(), String> {
        self.advance(at);
        match input {
            Input::Said(origin, command, answer) => self.said(at, origin, command, answer)?,
            Input::Truth(truth) => self.truth(at, truth)?,
            Input::Boot { kept, down } => self.boot(at, kept, down),
            Input::Fault => {
                self.fault_at = at;
                self.guard = false;
            }
            Input::LineFault => {
                self.fault_at = at;
                self.line_fault_at = at;
                self.guard = false;
            }
            Input::Dark => {
                if self.wire_run {
                    self.tally.dark_runs += 1;
                    self.dark_at.get_or_insert(at);
                }
            }
            Input::Unheard => self.unheard = true,
            Input::Heard => self.unheard = false,
            Input::HungUntil(until) => self.hung = (self.last_frame, until),
            Input::LinkBack => self.link_back = at,
            Input::OtherStarted => self.other_started = Some(at),
        }
        Ok(())
    }

    fn said(
        &mut self,
        at: u64,
        origin: Origin,
        command: Command,
        answer: Result<Accepted, Rejected>,
    ) -> Result<(), String> {
        match command {
            Command::EmergencyStop => {
                let by = self
                    .latched
                    .map_or(origin, |(by, _)| if by.priority() > origin.priority() { by } else { origin });
                let since = self.latched.map_or(at, |(_, since)| since);
                self.latched = Some((by, since));
                self.guard = false;
                self.armed = false;
                for (must, said) in self.must_disarm.iter_mut().zip(self.arm_commanded) {
                    *must |= said;
                }
                self.use_up_all();
            }
            Command::ReleaseStop => {
                if answer.is_ok()
                    && let Some((by, _)) = self.latched.take()
                {
                    if origin.priority() < by.priority() {
                        return Err(format!("(4) {origin:?} released the emergency stop of {by:?}"));
                    }
                    // An AMT ECU with a fault does not say what its engine does, and no ECU has right after a
                    // reset; standby is no start.
                    let untold = self.amt && self.truth.faulty || at < self.booted + BEHIND;
                    let disturbed = self.truth.odd || at < self.fault_at + BEHIND_FAULTY;
                    let stood = !self.truth.live || untold || disturbed;
                    if !stood && self.live_since.is_some_and(|since| at > since + BEHIND) {
                        return Err("(4) an emergency stop was released while the engine runs".into());
                    }
                    self.use_up_all();
                    self.may_go_on = false;
                }
            }
            Command::Arm => self.arm(origin, answer)?,
            Command::Disarm => {
                self.armed = false;
                self.arm_commanded[slot(origin)] = false;
                self.must_disarm[slot(origin)] = false;
                self.use_up_all();
                if self.wire_run && !self.reached {
                    self.end(at, || format!("{origin:?} disarmed, and the engine has not reached running"));
                    self.standby_reason = Some(at);
                }
            }
            Command::ShutDown => {
                self.guard = false;
                self.standby_said = Some(at);
                if self.latched.is_none() {
                    self.use_up_all();
                    self.standby_reason = Some(at);
                    self.may_go_on = false;
                    self.end(at, || format!("{origin:?} commanded to shut down"));
                }
            }
            Command::Present => {
                let ruled = self.ruler(at);
                self.speak(at, origin, Word::Nothing);
                self.ruled_until_now(ruled);
                self.look();
            }
            Command::Standby => self.standby_word(at, origin, answer)?,
            Command::Run(demand) => self.run_word(at, origin, demand, answer),
            Command::HandOverToPwm | Command::Service(_) => {}
        }
        Ok(())
    }

    fn use_up_all(&mut self) {
        for source in self.sources.iter_mut().flatten() {
            source.permitted = None;
        }
    }

    fn arm(&mut self, origin: Origin, answer: Result<Accepted, Rejected>) -> Result<(), String> {
        self.arm_commanded[slot(origin)] = true;
        if answer.is_ok() {
            if self.latched.is_some() {
                return Err(format!("(4) {origin:?} armed while an emergency stop is latched"));
            }
            if self.must_disarm[slot(origin)] {
                return Err(format!(
                    "(4) {origin:?} armed with a word that it has said since before the stop"
                ));
            }
            self.armed = true;
        }
        self.must_disarm[slot(origin)] |= self.latched.is_some();
        Ok(())
    }

    /// A source speaks.
    fn speak(&mut self, at: u64, origin: Origin, word: Word) {
        let age = self.age(origin);
        let return_within = self.config.supervision.return_within.as_micros();
        let before = self.sources[slot(origin)];
        let mut source = before.unwrap_or(Source::new(at, word));
        if let Some(before) = before {
            // One that is present and wants nothing speaks without a gap.
            let gap_from = if before.word == Word::Nothing { before.heard + age } else { before.silent_from };
            if at >= gap_from {
                // A steady stream with one short gap goes on.
                source.was_lost = !self.steady(&before) || at >= gap_from + return_within;
                source.since = at;
            }
        }
        if source.word != word {
            source.before = source.word;
            source.changed = at;
        }
        source.silent_from = match (word, before) {
            (Word::Nothing, Some(Source { word: Word::Nothing, silent_from, .. })) => silent_from,
            // Wanting nothing counts as silence from then on.
            (Word::Nothing, Some(before)) => before.silent_from.min(at),
            (Word::Nothing, None) => at,
            _ => at + age,
        };
        if word == Word::Nothing {
            source.permitted = None;
        }
        source.standby_at = None;
        source.word = word;
        source.heard = at;
        self.sources[slot(origin)] = Some(source);
    }

    fn standby_word(
        &mut self,
        at: u64,
        origin: Origin,
        answer: Result<Accepted, Rejected>,
    ) -> Result<(), String> {
        self.guard = false;
        self.standby_said = Some(at);
        let ruled = self.ruler(at);
        let before = self.sources[slot(origin)];
        let fresh = before.filter(|before| at < before.silent_from);
        let second = before.and_then(|before| before.standby_at);
        if answer == Ok(Accepted::OneMore) {
            // Two words within the age limit are an order.
            if second.is_some_and(|second| at + TOL <= second + self.age(origin)) {
                return Err(format!("(1) {origin:?} has said standby twice, and that is not enough"));
            }
            if self.wire_run && !self.reached {
                return Err(format!("(1) {origin:?} said standby in a start, and that is not enough"));
            }
            self.speak(at, origin, fresh.map_or(Word::Nothing, |before| before.word));
        } else {
            let healthy = self.wire_run && self.over.is_none() && self.latched.is_none() && self.ran;
            let lately = second.is_some_and(|second| at <= second + self.age(origin).max(RUN_OUT));
            if healthy && self.healthy_since.is_some_and(|since| at > since + 3 * SECOND) && !lately {
                return Err(format!("(5) one word of standby of {origin:?} counts, and the engine runs"));
            }
            let changed = fresh.is_none_or(|before| before.word != Word::Standby);
            if changed {
                self.use_up_all();
            }
            self.speak(at, origin, Word::Standby);
            let permits = matches!(answer, Ok(Accepted::InForce | Accepted::Behind(_)));
            if let Some(source) = &mut self.sources[slot(origin)] {
                source.permitted = permits.then_some(at);
            }
            // It may end what nobody's order is, too.
            self.standby_reason = Some(at);
        }
        if let Some(source) = &mut self.sources[slot(origin)] {
            source.standby_at = Some(at);
        }
        self.ruled_until_now(ruled);
        self.look();
        Ok(())
    }

    fn run_word(&mut self, at: u64, origin: Origin, demand: Demand, answer: Result<Accepted, Rejected>) {
        // A demand that is refused because the ECU cannot do it is not taken over, and the permission is used up.
        if let Err(
            Rejected::NeedsVersion { .. }
            | Rejected::NoSpeedControl
            | Rejected::RpmNotKnown
            | Rejected::AboveMaxRpm { .. },
        ) = answer
        {
            if let Err(Rejected::NeedsVersion { known: None, .. }) = answer {
                // It is there, and its run of before goes on, if it was there all along.
                let (before, ruled) = (self.sources[slot(origin)], self.ruler(at));
                let fresh = before.filter(|before| at < before.silent_from);
                let runs = fresh.map(|before| before.word).filter(|word| matches!(word, Word::Run(_)));
                self.speak(at, origin, runs.unwrap_or(Word::Run(demand)));
                self.ruled_until_now(ruled);
                self.look();
            }
            if let Some(source) = &mut self.sources[slot(origin)] {
                source.permitted = None;
            }
            return;
        }
        let demand = match demand {
            Demand::Rpm(rpm) if self.speed_control => Demand::Rpm(rpm.min(self.max())),
            demand => demand,
        };
        let ruled = self.ruler(at);
        self.speak(at, origin, Word::Run(demand));
        // One that was lost before the reset has to speak for a while first.
        let lost_before = self.kept.is_some_and(|(kept, _, was_lost)| kept == origin && was_lost);
        let back = self.sources[slot(origin)].is_some_and(|source| self.steady(&source));
        if self.uncertain(at) && (!lost_before || back) {
            self.uncertain_throttle = self.uncertain_throttle.max(self.as_throttle(demand));
            if let Demand::Rpm(rpm) = demand {
                self.uncertain_rpm = self.uncertain_rpm.max(rpm.get());
            }
            self.wanted_until = self.wanted_until.max(at + self.age(origin));
        }
        if !self.wire_run || self.over.is_some() {
            let against = self.against_start(at, origin, demand);
            self.attempts.push(Attempt { at, by: origin, against });
        }
        if answer != Ok(Accepted::StartWaits)
            && let Some(source) = &mut self.sources[slot(origin)]
        {
            source.permitted = None;
        }
        self.ruled_until_now(ruled);
        self.look();
    }

    fn max(&self) -> jetlink::units::Rpm {
        jetlink::units::Rpm::new(self.max_rpm)
    }

    /// What stands against a start by this word, of this source.
    fn against_start(&self, at: u64, origin: Origin, demand: Demand) -> Option<String> {
        let rules = self.config.supervision;
        let behind = if at < self.fault_at + BEHIND_FAULTY { BEHIND_FAULTY } else { BEHIND };
        let source = self.sources[slot(origin)]?;
        let open = |what: &str| Some(format!("(2) a start by {origin:?}: {what}"));
        if source.permitted.is_none() {
            return Some(format!("(1) a start by {origin:?}: its own standby was not said, or is used up"));
        }
        match self.ruler(at) {
            Some((ruler, _)) if ruler == origin => {}
            Some((ruler, _)) => return Some(format!("(1) a start by {origin:?}: {ruler:?} is in control")),
            None => return Some(format!("(1) a start by {origin:?}: it is not there yet")),
        }
        if rules.start.arming && !self.armed {
            return open("it is not armed");
        }
        if !self.is_idle(demand) {
            return open("the demand is above idle");
        }
        if at > self.standby_at + behind {
            return open("the ECU does not report standby");
        }
        if at > self.healthy_at + behind {
            return open("the ECU reports a fault");
        }
        if at > self.cool_at + behind {
            return open("the exhaust is too hot");
        }
        if at < self.booted.max(self.link_back) + rules.start.link_stable.as_micros() {
            return open("the link is not up for long enough");
        }
        if self.other_started.is_some_and(|other| at + 1_500_000 < other + rules.start.gap.as_micros()) {
            return open("another engine has just started");
        }
        None
    }

    fn truth(&mut self, at: u64, truth: Truth) -> Result<(), String> {
        self.truth = truth;
        let (since, now, before) = self.obeyed;
        self.obeyed = match at < since + BEHIND {
            true => (since, now.max(truth.obeyed), before),
            false => (at, truth.obeyed, now),
        };
        if truth.live {
            self.live_at = at;
            self.live_since.get_or_insert(at);
        } else {
            self.live_since = None;
        }
        if truth.odd {
            self.odd_at = at;
        }
        // An AMT ECU with a fault does not say that its engine runs.
        if truth.running && !truth.odd && !truth.faulty {
            self.running_since.get_or_insert(at);
        } else {
            self.running_since = None;
        }
        if !self.wire_run {
            self.reached = false;
        }
        // What it reports may be something else than what it does.
        self.ran |= self.wire_run && truth.says_running && !truth.odd && at > self.opened + SECOND;
        let reached = truth.says_running || truth.odd || at < self.odd_at + BEHIND_FAULTY;
        if reached && !core::mem::replace(&mut self.reached, true) {
            // The truth is sampled: it may have been there a little earlier.
            let met = self.met_at.is_some_and(|met| at < met + SECOND / 2);
            self.rising = self.rising.filter(|_| !met);
        }
        let healthy = truth.running && !truth.odd && !truth.faulty && at > self.fault_at + UNCERTAIN;
        if healthy {
            self.healthy_since.get_or_insert(at);
        } else {
            self.healthy_since = None;
        }
        if let Some(before) = self.gave_up_before
            && self.guard
            && at < self.booted + 5 * SECOND
            && truth.gave_up > before
        {
            return Err(
                "(5) after a reset the ECU stopped a running engine, because the node left it alone".into()
            );
        }
        // With a fault an AMT ECU says neither what its engine does nor what it obeys: without memory there is nothing to
        // go on from, and with it a burning exhaust that can be read.
        let untold = self.amt && truth.faulty && !self.wire_run && (self.memory_lost || !truth.says_burning);
        if !truth.live || truth.odd || untold {
            self.guard = false;
        }
        if truth.standby || truth.odd {
            self.standby_at = at;
        }
        if truth.faulty {
            let fail_safe = self.config.supervision.limits.ecu_fault != Action::Report;
            self.limited |= fail_safe;
        } else {
            self.healthy_at = at;
        }
        if truth.egt <= f64::from(self.config.supervision.start.egt_max.tenths()) / 10.0 + 8.0 {
            self.cool_at = at;
        }
        if truth.egt >= f64::from(self.config.supervision.burning_egt.tenths()) / 10.0 - 8.0 {
            self.warm_at = at;
        }
        Ok(())
    }

    fn boot(&mut self, at: u64, kept: Kept, down: u64) {
        let loss = self.config.supervision.loss;
        let silent = at > self.wanted_until_least + loss.hold.as_micros();
        let recent = self.standby_said.is_some_and(|said| at < said + down + 2 * SECOND);
        let run_out = loss.standby_after.map_or(RUN_OUT, |after| after.as_micros().min(RUN_OUT));
        self.guard = self.wire_run
            && self.over.is_none()
            && self.latched.is_none()
            && self.truth.live
            && self.truth.obeys_run
            && !self.truth.odd
            && !self.truth.faulty
            && self.live_since.is_some_and(|since| at > since + 3 * SECOND)
            // A start that a reset cuts short is over.
            && self.running_since.is_some_and(|since| at > since + 3 * SECOND)
            && at > self.fault_at + BEHIND_FAULTY
            && at > self.booted + 5 * SECOND
            && !recent
            && !(silent && loss.standby_after.is_some())
            // Where the stages of loss have run out, an engine in doubt gets standby.
            && at + SECOND < self.wanted_until_least + run_out
            && self.last_frame + down + SECOND > at;
        self.tally.resets_running += u64::from(self.guard);
        self.gave_up_before = (self.guard && down < SECOND / 2).then_some(self.truth.gave_up);
        self.before_reset = (self.throttle.max(self.truth.obeyed), self.rpm);
        // What was in force and had no frame to go out in before the reset, if a source asked for so much.
        match kept {
            Kept::Whole(Some((_, Demand::Throttle(kept), _))) => {
                let asked = self.peak_throttle.max(self.last_asked).max(self.uncertain_throttle);
                self.before_reset.0 = self.before_reset.0.max(kept.tenths().min(asked));
            }
            Kept::Whole(Some((_, Demand::Rpm(kept), _))) => {
                let asked = self.peak_rpm.max(self.uncertain_rpm);
                self.before_reset.1 = self.before_reset.1.max(kept.get().min(asked));
            }
            _ => {}
        }
        self.memory_lost = kept == Kept::Lost;
        self.kept = match kept {
            Kept::Whole(demand) => demand,
            _ => None,
        };
        match kept {
            Kept::Whole(_) => {}
            Kept::PowerLost => self.armed = false,
            Kept::Lost => {
                self.latched = None;
                self.armed = false;
                self.arm_commanded = [false; 4];
                self.must_disarm = [false; 4];
            }
        }
        self.armed &= self.latched.is_none();
        // The silence of all goes on over the reset; it counts from the reset on only where one has just spoken.
        let wanting = self.each().filter(|(_, source)| source.word != Word::Nothing);
        let last_word = wanting.map(|(_, source)| source.heard).max().unwrap_or(0) + down + CARRIED;
        self.wanted_until += down + CARRIED;
        let resumed = self.kept.map(|(origin, demand, was_lost)| {
            let silent_from = (last_word + self.age(origin)).min(at + self.age(origin));
            self.wanted_until = self.wanted_until.max(silent_from);
            (origin, Source { silent_from, was_lost, ..Source::new(at, Word::Run(demand)) })
        });
        self.sources = [None; 4];
        if let Some((origin, source)) = resumed {
            self.sources[slot(origin)] = Some(source);
        }
        self.attempts.clear();
        self.in_force = None;
        self.waiting = None;
        self.lost = true;
        self.over = None;
        self.standby_reason = None;
        self.rising = None;
        self.rpm_last = false;
        self.dark_at = None;
        self.uncertain_throttle = 0;
        self.uncertain_rpm = 0;
        // When an engine was started is not kept.
        self.other_started = None;
        self.booted = at;
        self.wire_run = false;
        self.ran = false;
        self.may_go_on = self.latched.is_none();
        self.settled = at;
        self.look();
    }

    // -----------------------------------------------------------------------------------------
    // The wire
    // -----------------------------------------------------------------------------------------

    /// True if this frame is that of a start, and not one that was ordered some time ago while the transmitter hung.
    pub fn frame(&mut self, at: u64, frame: Frame) -> Result<bool, String> {
        // Sent before the reset, or out of a transmitter that hung.
        if at <= self.booted + TOL || (at >= self.hung.0 && at < self.hung.1) {
            return Ok(false);
        }
        self.advance(at);
        self.tally.frames += 1;
        let hung = self.hung.1 > self.last_frame;
        let starts = self.tally.starts;
        let answer = self.judge(at, frame).map(|_| self.tally.starts > starts && !hung);
        match frame {
            Frame::Full(..) => (self.peak_throttle, self.ruled_peak) = (0, 0),
            Frame::RpmCode(_) => self.peak_rpm = 0,
            // It shows no demand.
            _ => return answer,
        }
        self.last_frame = at;
        if let Some((_, source)) = self.ruler(at)
            && let Word::Run(demand) = source.word
            && (at < source.changed + TOL
                || self.config.supervision.slew.up.is_some()
                || self.rising.is_some())
        {
            // It may have moved towards this until another demand came.
            self.peak(demand);
        }
        answer
    }

    fn judge(&mut self, at: u64, frame: Frame) -> Result<(), String> {
        // A frame and a command at the same instant: the demand before may still be in it.
        if let Some((_, Source { changed, before: Word::Run(demand), .. })) = self.ruler(at)
            && at < changed + TOL
        {
            self.peak(demand);
        }
        let switch = match frame {
            Frame::Bad(raw) => return Err(format!("(0) {raw:02x?} is no control frame")),
            Frame::Full(switch, _) | Frame::Mode(switch, _) => Some(switch),
            Frame::RpmCode(_) | Frame::Other(_) => None,
        };
        if let Some((by, since)) = self.latched
            && at > since + TOL
        {
            self.tally.stop_frames += 1;
            if switch != Some(Switch::Stop) {
                return Err(format!("(4) {by:?} has stopped the engine, and {frame:?} is on the wire"));
            }
        }
        let opens = match switch {
            Some(Switch::Pwm) => return Err("(1) SW 0 hands the engine to the PWM input".into()),
            Some(Switch::Stop | Switch::Standby) => {
                return self.ended(at, frame);
            }
            Some(Switch::Run) => self.run(at)?,
            None => false,
        };
        match frame {
            Frame::Full(_, throttle) => self.throttle_frame(at, throttle, opens)?,
            Frame::Mode(_, factor) if factor != 0 => self.factor = factor,
            Frame::RpmCode(code) => {
                self.tally.rpm_frames += 1;
                self.rpm_frame(at, u32::from(code) * u32::from(self.factor) * 10, opens)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// A stop or standby.
    fn ended(&mut self, at: u64, frame: Frame) -> Result<(), String> {
        if self.guard && at < self.booted + 10 * SECOND && !self.ended_by_loss(at) {
            return Err(format!("(5) {frame:?} after a reset, with an engine that runs"));
        }
        if self.wire_run
            && self.latched.is_none()
            && !self.uncertain(at)
            && at > self.fault_at + UNCERTAIN
            && self.healthy_since.is_some_and(|since| at > since + 3 * SECOND)
        {
            self.tally.healthy_ends += 1;
            let reason =
                self.over.is_some() || self.standby_reason.is_some_and(|since| since + TOL >= self.last_run);
            if !reason {
                return Err(format!("(5) {frame:?} to an engine that runs, and nobody ended its run"));
            }
        }
        self.attempts.retain(|attempt| attempt.at + TOL >= at);
        self.wire_run = false;
        self.may_go_on = false;
        self.reached = false;
        self.ran = false;
        self.guard = false;
        self.limited = false;
        self.over = None;
        self.standby_reason = None;
        self.rising = None;
        self.dark_at = None;
        self.throttle = 0;
        self.rpm = 0;
        self.silent = None;
        Ok(())
    }

    /// The last stage of loss may have come: as configured, or in doubt 10 s into the fail-safe stage.
    fn ended_by_loss(&self, at: u64) -> bool {
        let loss = self.config.supervision.loss;
        let in_doubt = self.uncertain(at) || at < self.fault_at + UNCERTAIN;
        let after = loss.standby_after.map(|after| after.as_micros()).or(in_doubt.then_some(RUN_OUT));
        // After a reset the silence that is carried over is not certain, and after three the hold is left out.
        let hold = if self.uncertain(at) { 0 } else { loss.hold.as_micros() };
        // Silence that is carried over a reset may be counted a little longer than it was.
        let slack = match (self.uncertain(at), self.booted > self.wanted_until_least) {
            (true, _) => SECOND + self.longest_age(),
            (false, true) => SECOND,
            (false, false) => TOL,
        };
        after.is_some_and(|after| at + slack >= self.wanted_until_least + hold + after)
    }

    /// A lower source that says standby may have ended the run.
    fn ended_by_lower(&self, at: u64) -> bool {
        let loss = self.config.supervision.loss;
        let lasted = loss.hold.as_micros() + loss.lower_standby_after.as_micros();
        let lower = |at| matches!(self.ruler(at), Some((_, Source { word: Word::Standby, .. })));
        at + TOL >= self.wanted_until_least + lasted && (lower(at) || lower(self.last_run))
    }

    fn run(&mut self, at: u64) -> Result<bool, String> {
        self.tally.run_frames += 1;
        if !self.wire_run {
            return self.begins(at).map(|()| true);
        }
        if let Some((over, why)) = &self.over
            && at > over + TOL
        {
            // A new start after it.
            if let Ok(()) = self.start_allowed(at) {
                self.tally.starts += 1;
                self.opened_by_start(at);
                return Ok(true);
            }
            return Err(format!("(1) run, and {why}"));
        }
        self.run_goes_on(at)?;
        self.void_permissions(at);
        self.last_run = at;
        Ok(false)
    }

    /// A permission from before a run is used up.
    fn void_permissions(&mut self, at: u64) {
        for source in self.sources.iter_mut().flatten() {
            source.permitted = source.permitted.filter(|given| given + TOL >= at);
        }
    }

    fn run_goes_on(&self, at: u64) -> Result<(), String> {
        let loss = self.config.supervision.loss;
        let fail_safe = self.wanted_until + loss.hold.as_micros();
        if let Some(after) = loss.standby_after
            && at > fail_safe + after.as_micros() + TOL
        {
            return Err("(1) run, and every source is silent for longer than the time to standby".into());
        }
        // Where that is not configured, it takes the silence of all sources.
        let silent =
            loss.standby_after.is_some() || self.each().all(|(_, source)| at > source.silent_from + TOL);
        if !self.reached
            && silent
            && at > fail_safe + loss.standby_after.map_or(RUN_OUT, |after| after.as_micros()) + TOL
        {
            return Err("(1) run to an engine that does not run yet, and every source is silent".into());
        }
        if !self.uncertain(at)
            && let Some((origin, Source { word: Word::Standby, changed, .. })) = self.ruler(at)
            && at > fail_safe.max(changed) + loss.lower_standby_after.as_micros() + TOL
            // It may have come to be in control this very instant.
            && self.ruler(at.saturating_sub(TOL)).is_some_and(|(before, _)| before == origin)
        {
            return Err(format!("(1) run, and {origin:?} says standby, with nobody who wants it to run"));
        }
        // A life that is in doubt, or over.
        if self.unheard {
            return Err("(8) run, and the ECU is not heard".into());
        }
        let disturbed = at < self.fault_at + BEHIND_FAULTY;
        if let Some(dark) = self.dark_at {
            let noisy = self.line_fault_at + 3 * SECOND > dark;
            if at > dark + DARK && !noisy {
                return Err("(8) run, and the ECU has lost its power in this run".into());
            }
        }
        let behind = if disturbed || at < self.odd_at + BEHIND_FAULTY { BEHIND_FAULTY } else { BEHIND };
        let dead = self.ran && !self.truth.live && at > self.live_at.max(self.opened) + behind;
        if dead && !(self.amt && self.truth.faulty) && !self.truth.odd {
            return Err("(8) run, and the engine has stopped in this run".into());
        }
        // Error sets carry no state: the exhaust is the evidence.
        if dead && self.truth.faulty && at > self.warm_at + BEHIND_FAULTY + 5 * SECOND {
            return Err("(8) run, and the exhaust of an engine with faults is cold".into());
        }
        Ok(())
    }

    /// The first run after something else.
    fn begins(&mut self, at: u64) -> Result<(), String> {
        match self.start_allowed(at) {
            Ok(()) => {
                self.tally.starts += 1;
                self.opened_by_start(at);
                Ok(())
            }
            Err(_) if self.may_go_on => self.goes_on(at),
            Err(why) => Err(why),
        }
    }

    fn start_allowed(&self, at: u64) -> Result<(), String> {
        let words = || self.attempts.iter().filter(|attempt| attempt.at <= at + TOL);
        if words().any(|attempt| attempt.against.is_none()) {
            return Ok(());
        }
        let mut all: Vec<String> = words().filter_map(|attempt| attempt.against.clone()).collect();
        all.dedup();
        Err(if all.is_empty() { "(1) run begins, and nobody has said so".into() } else { all.join("; ") })
    }

    fn opened_by_start(&mut self, at: u64) {
        let word = self.attempts.iter().rev().find(|attempt| attempt.against.is_none());
        self.in_force = word.map(|attempt| attempt.by);
        self.attempts.clear();
        self.wire_run = true;
        self.reached = false;
        self.ran = false;
        self.opened = at;
        self.last_run = at;
        self.lost = false;
        self.waiting = None;
        self.settled = at;
        self.limited = false;
        self.silent = None;
        self.over = None;
        self.standby_reason = None;
        self.dark_at = None;
        self.rising = Some((at, 0));
        self.void_permissions(at);
    }

    /// After a reset.
    fn goes_on(&mut self, at: u64) -> Result<(), String> {
        self.tally.went_on += 1;
        // An AMT ECU with a fault does not say what its engine does: a hot exhaust and what was kept are all there is.
        let burns = self.amt && self.truth.faulty && at < self.warm_at + BEHIND_FAULTY;
        let disturbed = self.truth.odd || at < self.fault_at + BEHIND_FAULTY;
        let alive = self.truth.live || at < self.live_at + BEHIND || disturbed || burns;
        if !alive {
            return Err("(1) it went on with an engine that does not run".into());
        }
        if self.kept.is_none() {
            // It is nobody's: the stages of loss begin.
            self.wanted_until = self.wanted_until.max(at);
        }
        self.attempts.clear();
        self.wire_run = true;
        self.reached = true;
        self.opened = at;
        self.last_run = at;
        self.last_asked = self.last_asked.max(self.before_reset.0);
        // What was asked a moment before may have been reached when the engine was confirmed.
        let steady = self.ruler(at).is_none_or(|(_, source)| at > source.changed + SECOND / 2);
        self.rising = steady.then_some((at, self.before_reset.0.max(self.truth.obeyed)));
        Ok(())
    }

    /// The bounds of a demand by (3): the fail-safe value and its ramp in units of a second, with what it falls from.
    fn silent_bound(&mut self, at: u64, safe: u32, from: u32, rate: u32, rpm: bool) -> Option<u32> {
        if at <= self.wanted_until + TOL {
            return None;
        }
        self.tally.silent_frames += 1;
        let passed =
            at.saturating_sub(self.wanted_until + self.config.supervision.loss.hold.as_micros() + TOL);
        let fallen = u64::from(rate) * passed / SECOND;
        // 25 ms of the ramp for a step of it and a frame, and half a percent for AMT's resolution.
        let slack = rate / 40 + if rpm { self.max_rpm / 200 } else { 6 };
        let bound = u64::from(from).saturating_sub(fallen) + u64::from(slack);
        let bound = if fallen >= u64::from(from) { u64::from(safe) } else { bound.max(u64::from(safe)) };
        Some(u32::try_from(bound).unwrap_or(u32::MAX))
    }

    fn silent_base(&mut self, at: u64) -> (u16, u32) {
        if at <= self.wanted_until + TOL {
            self.silent = None;
            return (self.throttle, self.rpm);
        }
        let (throttle, rpm) = (self.throttle.max(self.peak_throttle), self.rpm.max(self.peak_rpm));
        let (_, throttle, rpm) = *self.silent.get_or_insert((at, throttle, rpm));
        (throttle, rpm)
    }

    /// Most of what may have been in force before, where no frame has shown it: after a reset, or where the order was given
    /// up and the ECU's own demand taken over.
    fn unseen(&self, at: u64) -> (u16, u32) {
        if self.uncertain(at) {
            let throttle = self.before_reset.0.max(self.uncertain_throttle).max(self.truth.obeyed);
            return (throttle, self.before_reset.1.max(self.uncertain_rpm));
        }
        let gap = at > self.last_frame + 3 * SECOND;
        (if gap { self.truth.obeyed } else { 0 }, 0)
    }

    fn throttle_frame(&mut self, at: u64, throttle: u16, opens: bool) -> Result<(), String> {
        if !self.wire_run {
            return Ok(());
        }
        let (from, _) = self.silent_base(at);
        let loss = self.config.supervision.loss;
        // (6)
        let asked = self.asked(at);
        let unseen = self.unseen(at).0;
        let before = self.throttle.max(unseen);
        // Until the ECU has told its version after a reset, the governor holds an rpm for it.
        let version_known = at > self.booted + BEHIND_FAULTY && at > self.fault_at + BEHIND_FAULTY;
        let governed = self.config.supervision.governor.filter(|_| !self.speed_control || !version_known);
        let authority = governed.map_or(0, |governor| governor.authority.tenths());
        let sliding = if self.on_its_way(at) && !self.lost { self.last_asked } else { 0 };
        let from = from.max(authority).max(sliding);
        let limit = match self.held(at) {
            // An rpm that is held is still governed.
            true if authority > 0 => 1000,
            true => before
                .max(self.peak_throttle)
                .max(sliding)
                .max(asked.map_or(0, |asked| self.as_throttle(asked))),
            false if version_known => {
                self.peak_throttle.max(asked.map_or(0, |asked| self.as_throttle(asked)))
            }
            false => self.peak_throttle.max(asked.map_or(0, |asked| self.as_throttle(asked))).max(authority),
        };
        // At the fail-safe of a limit a demand of the other kind cannot be compared.
        let limit = match asked {
            Some(Demand::Rpm(_)) if self.limited => limit.max(before),
            _ => limit,
        };
        if throttle > limit && !opens {
            return Err(format!(
                "(6) throttle {throttle}, {:?} asked for {limit} at most (held {}, before {before})",
                self.in_force,
                self.held(at)
            ));
        }
        // (3)
        let from = from.max(unseen);
        let bound =
            self.silent_bound(at, loss.throttle.tenths().into(), from.into(), loss.ramp.into(), false);
        if let Some(bound) = bound {
            self.tally.fail_safe_frames += u64::from(bound <= u32::from(loss.throttle.tenths()));
            if u32::from(throttle) > bound {
                return Err(format!("(3) throttle {throttle} above {bound}, and every source is silent"));
            }
        }
        // (9)
        self.rises(at, throttle, authority > 0)?;
        // (7)
        if let Some(Demand::Throttle(wanted)) = self.exact(at) {
            self.tally.exact_frames += 1;
            if throttle.abs_diff(wanted.tenths()) > 5 {
                return Err(format!("(7) throttle {throttle}, {:?} asks for {wanted:?}", self.in_force));
            }
        }
        self.throttle = throttle;
        Ok(())
    }

    /// After a start, a take-over, a gap or a reset the demand rises at its set rate until it is where it is asked to be.
    fn rises(&mut self, at: u64, throttle: u16, governed: bool) -> Result<(), String> {
        // It stays at idle until the engine has come to run.
        if !self.reached {
            self.rising = Some((at, 0));
        }
        if core::mem::take(&mut self.rpm_last) {
            // Of another kind: it goes on from the throttle that the ECU reports.
            self.rising = self.rising.map(|_| (at, self.obeyed.1.max(self.obeyed.2)));
        }
        let Some(risen) = self.risen(at) else { return Ok(()) };
        // A governor moves at its own rate, and a reduction for another engine ends when it says so.
        if governed || self.config.supervision.when_other_fails.is_some() || self.limited {
            self.rising = None;
            return Ok(());
        }
        self.tally.rising_frames += 1;
        if throttle > risen {
            return Err(format!("(9) throttle {throttle}, and it rises to {risen} at most"));
        }
        Ok(())
    }

    fn rpm_frame(&mut self, at: u64, rpm: u32, opens: bool) -> Result<(), String> {
        if !self.wire_run {
            return Ok(());
        }
        let slack = u32::from(self.factor) * 10;
        let (_, from) = self.silent_base(at);
        let unseen = self.unseen(at).1;
        let before = self.rpm.max(unseen);
        let asked = match self.asked(at) {
            Some(Demand::Rpm(rpm)) => rpm.get(),
            _ => 0,
        };
        // With a slew it may still be on its way to what was asked before.
        let sliding = if self.on_its_way(at) && !self.lost { self.max_rpm } else { 0 };
        let from = from.max(sliding);
        let limit = if self.held(at) { before.max(sliding) } else { 0 }.max(self.peak_rpm).max(asked);
        // In doubt, too, a demand of the other kind cannot be compared.
        let in_doubt = at < self.fault_at + BEHIND_FAULTY;
        let limit = match self.asked(at) {
            Some(Demand::Throttle(_)) if self.limited || in_doubt => limit.max(before),
            _ => limit,
        };
        if rpm > limit + slack && !opens && rpm > self.idle_rpm + slack || rpm > self.max_rpm + slack {
            return Err(format!("(6) {rpm} rpm, {:?} asked for {limit} at most", self.in_force));
        }
        let from = from.max(unseen);
        let rate = self.max_rpm / 1000 * u32::from(self.config.supervision.loss.ramp);
        if let Some(bound) = self.silent_bound(at, self.idle_rpm, from, rate, true)
            && rpm > bound + slack
        {
            return Err(format!("(3) {rpm} rpm above {bound}, and every source is silent"));
        }
        if let Some(Demand::Rpm(wanted)) = self.exact(at) {
            self.tally.exact_frames += 1;
            if rpm.abs_diff(wanted.get()) > slack {
                return Err(format!("(7) {rpm} rpm, {:?} asks for {wanted:?}", self.in_force));
            }
        }
        self.rpm = rpm;
        self.rpm_last = true;
        Ok(())
    }

    /// The demand may still rise to what the last source in control asked last: by a slew or its set rate, or because the
    /// engine has just come to run.
    fn on_its_way(&self, at: u64) -> bool {
        self.config.supervision.slew.up.is_some()
            || self.rising.is_some()
            // It is reduced for as long as another engine has failed.
            || self.config.supervision.when_other_fails.is_some()
            || self.running_since.is_none_or(|since| at < since + BEHIND)
    }

    fn as_throttle(&self, demand: Demand) -> u16 {
        match demand {
            Demand::Throttle(throttle) => throttle.tenths(),
            Demand::Rpm(_) if self.speed_control => 0,
            // The governor's throttle follows the shaft, within its authority.
            Demand::Rpm(_) => {
                self.config.supervision.governor.map_or(0, |governor| governor.authority.tenths())
            }
        }
    }

    /// What the source in control asks for.
    fn asked(&self, at: u64) -> Option<Demand> {
        match self.ruler(at)?.1.word {
            Word::Run(demand) => Some(demand),
            Word::Standby | Word::Nothing => None,
        }
    }

    /// The demand in force may be held: nobody is in control, or another source is about to take over.
    fn held(&self, at: u64) -> bool {
        let sliding = self.config.supervision.slew.down.is_some();
        self.lost || self.waiting.is_some() || self.uncertain(at) || sliding || at < self.settled + TOL
    }

    /// What has to be on the wire exactly, where nothing stands in the way.
    fn exact(&self, at: u64) -> Option<Demand> {
        let (origin, source) = self.ruler(at)?;
        let Word::Run(demand) = source.word else { return None };
        let supervision = &self.config.supervision;
        let slewed = supervision.slew.up.is_some() || supervision.slew.down.is_some();
        let rise = 1000 * SECOND / u64::from(supervision.rise) + SECOND;
        let moving = if slewed { 20 * SECOND } else { rise };
        let clear = self.in_force == Some(origin)
            && !self.lost
            && self.waiting.is_none()
            && at > self.settled + moving
            && at > source.changed + moving
            // After a reset, too, a slew goes on from what was on the wire.
            && at > self.booted + moving + UNCERTAIN
            && at > self.fault_at + BEHIND_FAULTY + moving
            && self.running_since.is_some_and(|since| at > since + moving.max(3 * SECOND))
            && !self.limited
            && self.config.supervision.when_other_fails.is_none();
        let able = matches!(demand, Demand::Throttle(_)) || self.speed_control;
        (clear && able).then_some(demand)
    }
}
