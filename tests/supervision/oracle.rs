//! The judge of one engine: a small model of who commands it, written from what is promised and from its
//! configuration, never from the engine's own code. It sees what the sources said, what the ECU really does, and
//! every frame on the wire. The invariants and their tolerances are in docs/invariants.md.

use crate::wire::{Frame, Switch};
use jetlink::command::{Command, Demand, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::engine::config::Action;

/// Two things at the same instant may come in either order.
const TOL: u64 = 1_000;
const SECOND: u64 = 1_000_000;
/// The node may be behind the ECU's truth by so much: a status that comes round every 0.45 s, two that agree, and
/// the sampling of the truth.
const BEHIND: u64 = 1_500_000;
/// The same on a line that has lately been disturbed: a state up to 3 s old is believed.
const BEHIND_FAULTY: u64 = 5_000_000;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Word {
    Standby,
    Run(Demand),
}

#[derive(Clone, Copy, Debug)]
struct Source {
    word: Word,
    heard: u64,
    since: u64,
    was_lost: bool,
    /// The last demand that would do for a start, and when the word last changed.
    idle_at: Option<u64>,
    changed: u64,
    /// The word before that.
    before: Word,
}

/// What the ECU really does and says, sampled.
#[derive(Clone, Copy, Debug, Default)]
pub struct Truth {
    pub live: bool,
    pub running: bool,
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
    Valid(Option<(Origin, Demand, bool)>),
    Lost,
}

/// What happened, in the order of time.
#[derive(Clone, Copy, Debug)]
pub enum Input {
    Said(Origin, Command, Option<Rejected>),
    Truth(Truth),
    /// The node was reset; it was down for so long.
    Boot {
        kept: Kept,
        down: u64,
    },
    WentOn,
    ListenOver,
    /// The line or the ECU was disturbed, or is no longer.
    Fault,
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
    armed_until: Option<u64>,
    /// Standby that came into force, and that was said at all.
    last_standby: Option<u64>,
    standby_said: Option<u64>,
    closed_at: u64,

    at: u64,
    wire_run: bool,
    opened: u64,
    last_frame: u64,
    throttle: u16,
    rpm: u32,
    factor: u8,
    /// The largest demands that a ruling source asked for since the last frame.
    peak_throttle: u16,
    peak_rpm: u32,

    /// What the last ruling source asked for last: with a slew the demand may still be on its way there.
    last_asked: u16,
    in_force: Option<Origin>,
    waiting: Option<(Origin, u64)>,
    maybe_close: bool,
    lost: bool,
    settled: u64,
    /// What was on the wire when the last source fell silent.
    silent: Option<(u64, u16, u32)>,

    truth: Truth,
    standby_at: u64,
    healthy_at: u64,
    cool_at: u64,
    live_at: u64,
    live_since: Option<u64>,
    running_since: Option<u64>,
    fault_at: u64,
    hung: (u64, u64),
    other_started: Option<u64>,
    link_back: u64,
    limited: bool,

    booted: u64,
    listening: bool,
    /// It ends then; a frame at the same instant is still one of before.
    listen_over: Option<u64>,
    kept: Option<(Origin, Demand, bool)>,
    /// When it went on with the source that ruled before, which had said something while the node listened.
    word_kept: Option<(Origin, u64)>,
    /// Highest throttle on the wire or obeyed before the reset.
    before_reset: (u16, u32),
    resumed_until: u64,
    guard: bool,
    memory_lost: bool,
    gave_up_before: Option<u64>,
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
            armed_until: None,
            last_standby: None,
            standby_said: None,
            closed_at: 0,
            at: 0,
            wire_run: false,
            opened: 0,
            last_frame: 0,
            throttle: 0,
            rpm: 0,
            factor: 4,
            peak_throttle: 0,
            peak_rpm: 0,
            last_asked: 0,
            in_force: None,
            waiting: None,
            maybe_close: false,
            lost: false,
            settled: 0,
            silent: None,
            truth: Truth::default(),
            standby_at: 0,
            healthy_at: 0,
            cool_at: 0,
            live_at: 0,
            live_since: None,
            running_since: None,
            fault_at: 0,
            hung: (0, 0),
            other_started: None,
            link_back: 0,
            limited: false,
            booted: 0,
            listening: true,
            listen_over: None,
            kept: None,
            word_kept: None,
            before_reset: (0, 0),
            resumed_until: 0,
            guard: false,
            memory_lost: false,
            gave_up_before: None,
        }
    }

    // -----------------------------------------------------------------------------------------
    // Who rules, from the documentation of the sources
    // -----------------------------------------------------------------------------------------

    fn age(&self, origin: Origin) -> u64 {
        self.config.supervision.ages.of(origin).as_micros()
    }

    fn each(&self) -> impl Iterator<Item = (Origin, Source)> {
        Origin::SOURCES.into_iter().zip(self.sources).filter_map(|(origin, source)| Some((origin, source?)))
    }

    fn ruler(&self, at: u64) -> Option<(Origin, Source)> {
        let recover = self.config.supervision.recover_after.as_micros();
        self.each().find(|(origin, source)| {
            // It has spoken for so long; the silence since does not count.
            let steady = !source.was_lost || source.heard >= source.since + recover;
            at < source.heard + self.age(*origin) && steady
        })
    }

    /// From when on every source is silent.
    fn silent_from(&self) -> u64 {
        self.each()
            .map(|(origin, source)| source.heard + self.age(origin))
            .max()
            .unwrap_or(0)
            .max(self.resumed_until)
    }

    /// Time goes on: who rules may change with nothing said.
    fn advance(&mut self, to: u64) {
        let recover = self.config.supervision.recover_after.as_micros();
        let within = self.config.supervision.takeover.within.as_micros();
        loop {
            let waited = self.waiting.map(|(_, since)| since + within);
            let next = self
                .each()
                .flat_map(|(origin, source)| [source.heard + self.age(origin), source.since + recover])
                .chain(waited)
                .chain([self.resumed_until])
                .filter(|at| *at > self.at && *at <= to)
                .min();
            let Some(next) = next else { break };
            let ruled = self.ruler(self.at);
            self.at = next;
            self.ruled_until_now(ruled);
            self.look();
        }
        self.at = to;
    }

    fn look(&mut self) {
        let at = self.at;
        if at < self.resumed_until {
            if let Some((_, Source { word: Word::Run(demand), .. })) = self.ruler(at) {
                self.peak(demand);
                self.last_asked = self.last_asked.max(self.as_throttle(demand));
            }
            return;
        }
        let takeover = self.config.supervision.takeover;
        match self.ruler(at) {
            None => {
                self.lost = true;
                self.waiting = None;
            }
            Some((origin, source)) => {
                if let Word::Run(demand) = source.word {
                    self.peak(demand);
                    self.last_asked = self.last_asked.max(self.as_throttle(demand));
                }
                // Another one may have taken over meanwhile, by being close.
                let certain = self.waiting.is_none() || !self.maybe_close;
                if self.in_force == Some(origin) && !self.lost && certain {
                    if let Word::Run(demand) = source.word {
                        self.last_asked = self.as_throttle(demand);
                    }
                    if self.waiting.take().is_some() {
                        // The demand was held until now.
                        self.settled = at;
                    }
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
                if let Word::Run(demand) = source.word {
                    // While the transmitter hangs, what is in force does not show.
                    self.maybe_close |= at < self.hung.1;
                    self.maybe_close |= match demand {
                        Demand::Throttle(throttle) => {
                            throttle.tenths().abs_diff(self.throttle) <= takeover.throttle_band.tenths() + 20
                        }
                        Demand::Rpm(rpm) => {
                            !self.speed_control
                                || rpm.get().abs_diff(self.rpm) <= takeover.rpm_band.get() + 500
                        }
                    };
                }
                if at >= since + takeover.within.as_micros() {
                    self.tally.takeovers += 1;
                    self.in_force = Some(origin);
                    self.lost = false;
                    self.waiting = None;
                    self.settled = at;
                }
            }
        }
    }

    /// Whoever ruled up to now and no longer does: its demand may have come into force since the last frame, and be what
    /// is held from here on.
    fn ruled_until_now(&mut self, ruled: Option<(Origin, Source)>) {
        if let Some((before, Source { word: Word::Run(demand), .. })) = ruled
            && self.ruler(self.at).is_none_or(|(origin, _)| origin != before)
        {
            self.peak(demand);
        }
    }

    fn peak(&mut self, demand: Demand) {
        match demand {
            Demand::Throttle(throttle) => self.peak_throttle = self.peak_throttle.max(throttle.tenths()),
            Demand::Rpm(rpm) if self.speed_control => self.peak_rpm = self.peak_rpm.max(rpm.get()),
            // The governor's throttle follows the shaft, within its authority.
            Demand::Rpm(_) => {
                let authority =
                    self.config.supervision.governor.map_or(0, |governor| governor.authority.tenths());
                self.peak_throttle = self.peak_throttle.max(authority);
            }
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
            Input::Said(origin, command, refused) => self.said(at, origin, command, refused)?,
            Input::Truth(truth) => self.truth(at, truth)?,
            Input::Boot { kept, down } => self.boot(at, kept, down),
            Input::WentOn => {
                self.tally.went_on += 1;
                self.listening = false;
                // An AMT ECU with a fault does not say what its engine does: what was kept is all there is.
                let alive = self.truth.live
                    || self.live_at >= self.booted
                    || self.truth.odd
                    || at < self.fault_at + BEHIND_FAULTY
                    || self.amt && self.truth.faulty && self.kept.is_some();
                if !alive {
                    return Err("(1) it went on with an engine that does not run".into());
                }
                if !self.wire_run {
                    self.opened = at;
                }
                self.wire_run = true;
                let longest = Origin::SOURCES.into_iter().map(|origin| self.age(origin)).max().unwrap_or(0);
                self.resumed_until = at + longest;
                self.in_force = None;
                self.lost = true;
                self.waiting = None;
                self.silent = None;
                self.last_asked = self.before_reset.0;
                let spoke = |origin| self.each().any(|(place, _)| place == origin);
                self.word_kept =
                    self.kept.filter(|(origin, ..)| spoke(*origin)).map(|(origin, ..)| (origin, at));
                // As if the one that ruled had just spoken; one that was lost has to speak for a while.
                if let Some((origin, demand, was_lost)) = self.kept {
                    for (place, slot) in Origin::SOURCES.into_iter().zip(&mut self.sources) {
                        if place == origin {
                            let word = Word::Run(demand);
                            let new = Source {
                                word,
                                heard: at,
                                since: at,
                                was_lost,
                                idle_at: None,
                                before: word,
                                changed: at,
                            };
                            *slot = Some(Source { heard: at, since: at, was_lost, ..slot.unwrap_or(new) });
                        }
                    }
                }
            }
            Input::ListenOver => self.listen_over = Some(at),
            Input::Fault => {
                self.fault_at = at;
                self.guard = false;
            }
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
        refused: Option<Rejected>,
    ) -> Result<(), String> {
        let word = match command {
            Command::EmergencyStop => {
                let by = self
                    .latched
                    .map_or(origin, |(by, _)| if by.priority() > origin.priority() { by } else { origin });
                let since = self.latched.map_or(at, |(_, since)| since);
                self.latched = Some((by, since));
                self.guard = false;
                return Ok(());
            }
            Command::ReleaseStop => {
                if refused.is_none()
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
                    self.closed_at = at;
                }
                return Ok(());
            }
            Command::Arm => {
                self.armed = true;
                return Ok(());
            }
            Command::Disarm => {
                if self.armed {
                    self.armed_until = Some(at);
                }
                self.armed = false;
                return Ok(());
            }
            Command::Standby => {
                self.guard = false;
                self.standby_said = Some(at);
                let behind = self.ruler(at).is_some_and(|(ruler, _)| ruler.priority() > origin.priority());
                if refused.is_none() && !behind {
                    self.last_standby = Some(at);
                }
                Word::Standby
            }
            Command::Run(demand) => {
                // Nothing changes when a demand is refused because the ECU cannot do it.
                if let Some(
                    Rejected::NeedsVersion { .. }
                    | Rejected::NoSpeedControl
                    | Rejected::RpmNotKnown
                    | Rejected::AboveMaxRpm { .. },
                ) = refused
                {
                    return Ok(());
                }
                Word::Run(demand)
            }
            Command::HandOverToPwm | Command::Service(_) | Command::ShutDown | Command::Present => return Ok(()),
        };
        let age = self.age(origin);
        let ruled = self.ruler(at);
        let idle = matches!(word, Word::Run(demand) if self.is_idle(demand));
        for (place, slot) in Origin::SOURCES.into_iter().zip(&mut self.sources) {
            if place != origin {
                continue;
            }
            let gap = slot.is_none_or(|source| at >= source.heard + age);
            let mut source = slot.unwrap_or(Source {
                word,
                heard: at,
                since: at,
                was_lost: false,
                idle_at: None,
                changed: at,
                before: word,
            });
            if gap && slot.is_some() {
                source.since = at;
                source.was_lost = true;
            }
            if source.word != word {
                source.before = source.word;
                source.changed = at;
            }
            if idle {
                source.idle_at = Some(at);
            }
            *slot = Some(Source { word, heard: at, ..source });
        }
        self.ruled_until_now(ruled);
        self.look();
        Ok(())
    }

    fn truth(&mut self, at: u64, truth: Truth) -> Result<(), String> {
        self.truth = truth;
        if self.listening {
            // Nobody commands it: what it obeys is from before the reset.
            self.before_reset.0 = self.before_reset.0.max(truth.obeyed);
        }
        if truth.live {
            self.live_at = at;
            self.live_since.get_or_insert(at);
        } else {
            self.live_since = None;
        }
        // An AMT ECU with a fault does not say that its engine runs.
        if truth.running && !truth.odd && !truth.faulty {
            self.running_since.get_or_insert(at);
        } else {
            self.running_since = None;
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
        // With a fault an AMT ECU says neither what its engine does nor what it obeys, also where that begins only while
        // the node listens; without memory there is nothing to go on from.
        let untold = self.amt && truth.faulty && self.listening && self.memory_lost;
        if !truth.live || truth.odd || untold {
            self.guard = false;
        }
        if truth.standby || truth.odd {
            self.standby_at = at;
        }
        if truth.faulty {
            let fail_safe = self.config.supervision.limits.ecu_fault != Action::None;
            self.limited |= fail_safe;
        } else {
            self.healthy_at = at;
        }
        if truth.egt <= f64::from(self.config.supervision.start.egt_max.tenths()) / 10.0 + 8.0 {
            self.cool_at = at;
        }
        Ok(())
    }

    fn boot(&mut self, at: u64, kept: Kept, down: u64) {
        let loss = self.config.supervision.loss;
        let silent = at > self.silent_from() + loss.hold.as_micros();
        let recent = self.standby_said.is_some_and(|said| at < said + down + 2 * SECOND);
        self.guard = self.wire_run
            && self.latched.is_none()
            && self.truth.live
            && self.truth.obeys_run
            && !self.truth.odd
            && !self.truth.faulty
            && self.live_since.is_some_and(|since| at > since + 3 * SECOND)
            && at > self.fault_at + BEHIND_FAULTY
            && at > self.booted + 5 * SECOND
            && !recent
            && !(silent && loss.standby_after.is_some())
            && self.last_frame + down + SECOND > at;
        self.tally.resets_running += u64::from(self.guard);
        self.gave_up_before = (self.guard && down < SECOND / 2).then_some(self.truth.gave_up);
        self.before_reset = (self.throttle.max(self.truth.obeyed), self.rpm);
        // What was in force and had no frame to go out in before the reset, if a source asked for so much.
        match kept {
            Kept::Valid(Some((_, Demand::Throttle(kept), _))) => {
                let asked = self.peak_throttle.max(self.last_asked);
                self.before_reset.0 = self.before_reset.0.max(kept.tenths().min(asked));
            }
            Kept::Valid(Some((_, Demand::Rpm(kept), _))) => {
                self.before_reset.1 = self.before_reset.1.max(kept.get().min(self.peak_rpm));
            }
            _ => {}
        }
        self.memory_lost = kept == Kept::Lost;
        // Not only by what the node kept: where every source was silent, its source was lost.
        let lost = self.wire_run && !self.listening && at > self.silent_from() + down + SECOND / 10;
        match kept {
            Kept::Valid(demand) => {
                self.kept = demand.map(|(origin, demand, was_lost)| (origin, demand, was_lost || lost));
            }
            Kept::Lost => {
                self.kept = None;
                self.latched = None;
                self.armed = false;
            }
        }
        self.armed_until = self.armed.then_some(at).or(self.armed_until);
        self.sources = [None; 4];
        self.last_standby = None;
        self.in_force = None;
        self.waiting = None;
        self.lost = true;
        self.silent = None;
        self.resumed_until = 0;
        // When an engine was started is not kept.
        self.other_started = None;
        self.booted = at;
        self.listening = true;
        self.listen_over = None;
        self.word_kept = None;
        self.settled = at;
    }

    // -----------------------------------------------------------------------------------------
    // The wire
    // -----------------------------------------------------------------------------------------

    /// True if this frame begins a run, and not one that was ordered some time ago while the transmitter hung.
    pub fn frame(&mut self, at: u64, frame: Frame) -> Result<bool, String> {
        // Sent before the reset, or out of a transmitter that hung.
        if at <= self.booted + TOL || (at >= self.hung.0 && at < self.hung.1) {
            return Ok(false);
        }
        self.advance(at);
        self.end_listening(at);
        self.tally.frames += 1;
        let hung = self.hung.1 > self.last_frame;
        let answer = self.judge(at, frame).map(|opens| opens && !hung);
        self.last_frame = at;
        match frame {
            Frame::Full(..) => self.peak_throttle = 0,
            Frame::RpmCode(_) => self.peak_rpm = 0,
            // It shows no demand.
            _ => return answer,
        }
        if let Some((_, source)) = self.ruler(at)
            && let Word::Run(demand) = source.word
            && (at < source.changed + TOL || self.config.supervision.slew.up.is_some())
        {
            // It may have moved towards this until another demand came.
            self.peak(demand);
        }
        answer
    }

    fn end_listening(&mut self, at: u64) {
        if let Some(over) = self.listen_over.filter(|over| at > over + TOL) {
            if self.listening && self.wire_run && !self.guard {
                self.wire_run = false;
                self.closed_at = over;
            }
            self.listening = false;
            self.listen_over = None;
        }
    }

    fn judge(&mut self, at: u64, frame: Frame) -> Result<bool, String> {
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
                self.ended(at, frame)?;
                return Ok(false);
            }
            Some(Switch::Run) => self.run(at)?,
            None => false,
        };
        if self.listening {
            return match frame {
                Frame::Full(Switch::Run, throttle) if throttle > self.before_reset.0 => {
                    Err(format!("(6) the mirror shows {throttle}, the ECU obeyed {}", self.before_reset.0))
                }
                Frame::Full(..) | Frame::Mode(..) | Frame::Other(_) => Ok(false),
                _ => Err(format!("(1) {frame:?} while the node listens")),
            };
        }
        match frame {
            Frame::Full(_, throttle) => self.throttle_frame(at, throttle, opens)?,
            Frame::Mode(_, factor) if factor != 0 => self.factor = factor,
            Frame::RpmCode(code) => {
                self.tally.rpm_frames += 1;
                self.rpm_frame(at, u32::from(code) * u32::from(self.factor) * 10, opens)?;
            }
            _ => {}
        }
        Ok(opens)
    }

    /// A stop or standby.
    fn ended(&mut self, at: u64, frame: Frame) -> Result<(), String> {
        let asked = at <= self.booted + TOL;
        if self.guard && !asked && at < self.booted + 10 * SECOND {
            let loss = self.config.supervision.loss;
            // A source that was lost before may have been so for the whole of the hold.
            let held = !self.kept.is_some_and(|(_, _, was_lost)| was_lost);
            let hold = if held { loss.hold.as_micros() } else { 0 };
            let by_loss =
                loss.standby_after.is_some_and(|after| at + TOL >= self.booted + hold + after.as_micros());
            if !by_loss {
                return Err(format!("(5) {frame:?} after a reset, with an engine that runs"));
            }
        }
        if self.listening && !self.amt && self.listen_over.is_none() {
            return Err(format!("(5) {frame:?} while the node listens"));
        }
        if self.wire_run {
            self.closed_at = at;
        }
        self.wire_run = false;
        self.guard = false;
        self.limited = false;
        self.throttle = 0;
        self.rpm = 0;
        self.silent = None;
        Ok(())
    }

    fn run(&mut self, at: u64) -> Result<bool, String> {
        self.tally.run_frames += 1;
        if self.listening {
            // AMT says back what the ECU says it obeys.
            let obeyed =
                self.amt && (self.truth.obeys_run || self.wire_run || at < self.fault_at + BEHIND_FAULTY);
            if obeyed {
                return Ok(false);
            }
            return Err("(1) run, while the node listens".into());
        }
        if !self.wire_run {
            return self.starts(at).map(|()| true);
        }
        let rules = &self.config.supervision;
        let silent_from = self.silent_from();
        if let Some(after) = rules.loss.standby_after
            && at > silent_from + rules.loss.hold.as_micros() + after.as_micros() + TOL
            && !self.limited_time(at)
        {
            return Err("(1) run, and every source is silent for longer than the time to standby".into());
        }
        let ruler = self.ruler(at).map(|(origin, _)| origin);
        self.word_kept = self.word_kept.filter(|(origin, _)| ruler == Some(*origin));
        let word_counts = self.word_counts(at);
        if (at > self.resumed_until + TOL || word_counts)
            && let Some((origin, source)) = self.ruler(at)
            && source.word == Word::Standby
            && at > source.changed + TOL
            && (self.standby_counts(origin) || word_counts)
            // It may have come to rule this very instant.
            && self.ruler(at.saturating_sub(TOL)).is_some_and(|(before, _)| before == origin)
        {
            return Err(format!("(1) run, and {origin:?} rules and says standby"));
        }
        Ok(false)
    }

    /// Standby of the source in force, or of one above it, comes at once; of another it takes over first.
    fn standby_counts(&self, origin: Origin) -> bool {
        // While it is not certain who that is, it waits as long as any.
        self.in_force.is_some_and(|before| {
            !self.lost && self.waiting.is_none() && origin.priority() >= before.priority()
        })
    }

    /// After a reset: a word that the ruling source said while the node listened is newer than what was kept.
    fn word_counts(&self, at: u64) -> bool {
        self.word_kept.is_some_and(|(_, from)| at > from + TOL) && at < self.resumed_until
    }

    fn limited_time(&self, at: u64) -> bool {
        at < self.resumed_until
    }

    /// The first run after something else.
    fn starts(&mut self, at: u64) -> Result<(), String> {
        let rules = self.config.supervision;
        let before = self.last_frame;
        let window = before.max(self.booted);
        self.tally.starts += 1;
        let behind = if at < self.fault_at + BEHIND_FAULTY { BEHIND_FAULTY } else { BEHIND };
        let idle = |source: &Source| source.idle_at.is_some_and(|idle| idle + behind >= window);
        let says_run = || {
            self.each().filter(|(origin, source)| {
                let fresh = source.heard + self.age(*origin) + TOL >= window;
                // It may have changed its mind since, when another one had already taken over.
                let said = matches!(source.before, Word::Run(_)) && source.changed >= window;
                (matches!(source.word, Word::Run(_)) || said) && fresh
            })
        };
        let by = says_run().find(|(_, source)| idle(source)).or_else(|| says_run().next());
        let Some((by, source)) = by else {
            return Err("(1) run begins, and no source that is fresh says run".into());
        };
        // Ordered while the transmitter hung: who rules now, and says standby, may still have to take over.
        let hung = self.hung.1 > before;
        if let Some((ruler, ruling)) = self.ruler(at)
            && ruling.word == Word::Standby
            && at > ruling.changed + TOL
            && !(hung && ruling.changed > before)
        {
            return Err(format!("(1) run begins by {by:?}, and {ruler:?} rules and says standby"));
        }
        if self.last_standby.is_none_or(|said| said + TOL < self.closed_at && said + TOL < self.opened) {
            return Err("(1) run begins, and nobody commanded standby since the last one ended".into());
        }
        let open = |what: &str| Err(format!("(2) a start by {by:?}: {what}"));
        if rules.start.arming && !self.armed && self.armed_until.is_none_or(|until| until + TOL < window) {
            return open("it is not armed");
        }
        if !idle(&source) {
            return open("the demand is above idle");
        }
        if window > self.standby_at + behind {
            return open("the ECU does not report standby");
        }
        if window > self.healthy_at + behind {
            return open("the ECU reports a fault");
        }
        if window > self.cool_at + behind {
            return open("the exhaust is too hot");
        }
        if at < self.booted.max(self.link_back) + rules.start.link_stable.as_micros() {
            return open("the link is not up for long enough");
        }
        if self.other_started.is_some_and(|other| at + 1_500_000 < other + rules.start.gap.as_micros()) {
            return open("another engine has just started");
        }
        self.wire_run = true;
        self.opened = at;
        self.in_force = Some(by);
        self.lost = false;
        self.waiting = None;
        self.settled = at;
        self.limited = false;
        self.silent = None;
        Ok(())
    }

    /// The bounds of a demand by (3): the fail-safe value and its ramp in units of a second, with what it falls from.
    fn silent_bound(&mut self, at: u64, safe: u32, from: u32, rate: u32) -> Option<u32> {
        let silent_from = self.silent_from();
        if at <= silent_from + TOL {
            return None;
        }
        self.tally.silent_frames += 1;
        let passed = at.saturating_sub(silent_from + self.config.supervision.loss.hold.as_micros() + TOL);
        let fallen = u64::from(rate) * passed / SECOND;
        // 25 ms of the ramp for a step of it and a frame, and half a percent for AMT's resolution.
        let slack = rate / 40 + if self.speed_control { self.max_rpm / 200 } else { 6 };
        let bound = u64::from(from).saturating_sub(fallen) + u64::from(slack);
        let bound = if fallen >= u64::from(from) { u64::from(safe) } else { bound.max(u64::from(safe)) };
        Some(u32::try_from(bound).unwrap_or(u32::MAX))
    }

    fn silent_base(&mut self, at: u64) -> (u16, u32) {
        if at <= self.silent_from() + TOL {
            self.silent = None;
            return (self.throttle, self.rpm);
        }
        let (throttle, rpm) = (self.throttle.max(self.peak_throttle), self.rpm.max(self.peak_rpm));
        let (_, throttle, rpm) = *self.silent.get_or_insert((at, throttle, rpm));
        (throttle, rpm)
    }

    fn throttle_frame(&mut self, at: u64, throttle: u16, opens: bool) -> Result<(), String> {
        if !self.wire_run {
            return Ok(());
        }
        let (from, _) = self.silent_base(at);
        let loss = self.config.supervision.loss;
        // (6)
        let asked = self.asked(at);
        let at_once =
            matches!(asked, Some(Demand::Throttle(_))) && self.config.supervision.slew.down.is_none();
        let before = if self.word_counts(at) && at_once {
            0
        } else if at < self.resumed_until {
            self.throttle.max(self.before_reset.0)
        } else {
            self.throttle
        };
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
            false => self.peak_throttle.max(asked.map_or(0, |asked| self.as_throttle(asked))),
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
        let from = if self.resumed_recently(at) { from.max(self.before_reset.0) } else { from };
        if let Some(bound) = self.silent_bound_throttle(at, from) {
            self.tally.fail_safe_frames += u64::from(bound <= u32::from(loss.throttle.tenths()));
            if u32::from(throttle) > bound {
                return Err(format!("(3) throttle {throttle} above {bound}, and every source is silent"));
            }
        }
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

    fn silent_bound_throttle(&mut self, at: u64, from: u16) -> Option<u32> {
        let loss = self.config.supervision.loss;
        let kept = self.speed_control;
        self.speed_control = false;
        let bound = self.silent_bound(at, loss.throttle.tenths().into(), from.into(), loss.ramp.into());
        self.speed_control = kept;
        bound
    }

    fn rpm_frame(&mut self, at: u64, rpm: u32, opens: bool) -> Result<(), String> {
        if !self.wire_run {
            return Ok(());
        }
        let slack = u32::from(self.factor) * 10;
        let (_, from) = self.silent_base(at);
        let before = if at < self.resumed_until { self.rpm.max(self.before_reset.1) } else { self.rpm };
        let asked = match self.asked(at) {
            Some(Demand::Rpm(rpm)) => rpm.get(),
            _ => 0,
        };
        // With a slew it may still be on its way to what was asked before.
        let sliding = if self.on_its_way(at) && !self.lost { self.max_rpm } else { 0 };
        let from = from.max(sliding);
        let limit = if self.held(at) { before.max(sliding) } else { 0 }.max(self.peak_rpm).max(asked);
        let limit = match self.asked(at) {
            Some(Demand::Throttle(_)) if self.limited => limit.max(before),
            _ => limit,
        };
        if rpm > limit + slack && !opens && rpm > self.idle_rpm + slack || rpm > self.max_rpm + slack {
            return Err(format!("(6) {rpm} rpm, {:?} asked for {limit} at most", self.in_force));
        }
        let from = if self.resumed_recently(at) { from.max(self.before_reset.1) } else { from };
        let rate = self.max_rpm / 1000 * u32::from(self.config.supervision.loss.ramp);
        if let Some(bound) = self.silent_bound(at, self.idle_rpm, from, rate)
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
        Ok(())
    }

    /// The demand may still rise to what the last ruling source asked last: by a slew, or because the engine has just
    /// come to run.
    fn on_its_way(&self, at: u64) -> bool {
        self.config.supervision.slew.up.is_some()
            // It is reduced for as long as another engine has failed.
            || self.config.supervision.when_other_fails.is_some()
            || self.running_since.is_none_or(|since| at < since + BEHIND)
    }

    fn resumed_recently(&self, at: u64) -> bool {
        at < self.resumed_until + TOL
    }

    fn as_throttle(&self, demand: Demand) -> u16 {
        match demand {
            Demand::Throttle(throttle) => throttle.tenths(),
            Demand::Rpm(_) if self.speed_control => 0,
            Demand::Rpm(_) => {
                self.config.supervision.governor.map_or(0, |governor| governor.authority.tenths())
            }
        }
    }

    /// What the ruling source asks for.
    fn asked(&self, at: u64) -> Option<Demand> {
        match self.ruler(at)?.1.word {
            Word::Run(demand) => Some(demand),
            Word::Standby => None,
        }
    }

    /// The demand in force may be held: nobody rules, or another source is about to take over.
    fn held(&self, at: u64) -> bool {
        let sliding = self.config.supervision.slew.down.is_some();
        self.lost
            || self.waiting.is_some()
            || at < self.resumed_until + TOL
            || sliding
            || at < self.settled + TOL
    }

    /// What has to be on the wire exactly, where nothing stands in the way.
    fn exact(&self, at: u64) -> Option<Demand> {
        let (origin, source) = self.ruler(at)?;
        let Word::Run(demand) = source.word else { return None };
        let slewed = self.config.supervision.slew.up.is_some() || self.config.supervision.slew.down.is_some();
        let moving = if slewed { 20 * SECOND } else { SECOND };
        let clear = self.in_force == Some(origin)
            && !self.lost
            && self.waiting.is_none()
            && at > self.settled + moving
            && at > source.changed + moving
            // After a reset, too, a slew goes on from what was on the wire.
            && at > self.booted + moving.max(8 * SECOND)
            && at > self.fault_at + BEHIND_FAULTY
            && self.running_since.is_some_and(|since| at > since + moving.max(3 * SECOND))
            && !self.limited
            && self.config.supervision.when_other_fails.is_none();
        let able = matches!(demand, Demand::Throttle(_)) || self.speed_control;
        (clear && able).then_some(demand)
    }
}
