//! The judge of one engine: a small model of who commands it, written from the documentation and its configuration,
//! never from the engine's own code. It sees what the sources commanded, what the ECU really does, and every frame on
//! the wire. The invariants and their tolerances are in docs/invariants.md.

mod frames;
mod inputs;

use super::wire::{Frame, Switch, percent};
use core::fmt;
use jetlink::command::{Accepted, Command, Demand, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::limit::Action;

/// Two things at the same instant may come in either order.
const TOL: u64 = 1_000;
const SECOND: u64 = 1_000_000;
/// Longest lag of the node behind the ECU's true state: a status every 0.45 s, two that agree, and the sampling of
/// the truth.
const BEHIND: u64 = 1_500_000;
/// The same on a recently disturbed line: a state up to 3 s old is used.
const BEHIND_FAULTY: u64 = 5_000_000;
/// Time after a reset in which it is not certain which sources count as lost: how long they were silent is retained in steps.
const UNCERTAIN: u64 = 10_000_000;
/// Time in which a ZK ECU reports its idle speed, with frames lost on the way.
const ROUND: u64 = 2_000_000;
/// Time from the beginning of the fail-safe stage to standby, where no engine is known to live.
const RUN_OUT: u64 = 10_000_000;
/// From the loss of an ECU's power, or its last byte, until run is no longer sent: three expected frames, and a reply.
pub const DARK: u64 = 600_000;
/// Time that silence carried over a reset may lack, besides the node's down time: one retained step, and the
/// interval at which the node reads the time.
const CARRIED: u64 = 300_000;
/// A stream of a lost source is retained in steps, rounded up, up to the longest.
const STEADY_STEP: u64 = 200_000;
const STEADY_MAX: u64 = 6_200_000;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Intent {
    /// Present, without a command.
    Nothing,
    Standby,
    Run(Demand),
}

#[derive(Clone, Copy, Debug)]
struct Source {
    intent: Intent,
    last_rx: u64,
    /// Time from which it counts as silent.
    silent_from: u64,
    since: u64,
    was_lost: bool,
    changed: u64,
    /// The previous command.
    before: Intent,
    /// Time of its last standby, with no other command since.
    standby_at: Option<u64>,
    /// Time of its own standby, which permits its next run to start the engine.
    permitted: Option<u64>,
}

impl Source {
    const fn new(at: u64, intent: Intent) -> Self {
        Self {
            intent,
            last_rx: at,
            silent_from: at,
            since: at,
            was_lost: false,
            changed: at,
            before: intent,
            standby_at: None,
            permitted: None,
        }
    }
}

/// A command for a start, and the obstacles to it.
#[derive(Clone, Debug)]
struct Attempt {
    at: u64,
    by: Origin,
    against: Option<String>,
}

/// What the ECU really does and reports, sampled.
#[derive(Clone, Copy, Debug, Default)]
pub struct Truth {
    pub live: bool,
    pub running: bool,
    /// It reports that the engine runs, as the document defines it: a ZK ECU also while it learns.
    pub reports_running: bool,
    /// With a fault it reports an exhaust temperature that is possible without combustion, from a sensor that it does not report
    /// as faulty.
    pub reports_cold: bool,
    /// It reports standby, as the document defines it.
    pub standby: bool,
    pub faulty: bool,
    /// With a fault it reports neither the state of its engine nor what it obeys.
    pub hides_state: bool,
    pub egt: f64,
    /// Its reports differ from what it does, or it has no power.
    pub odd: bool,
    /// Tenths of a percent that it obeys.
    pub obeyed: u16,
    pub obeys_run: bool,
    /// Number of times that it stopped its engine because the node was silent.
    pub own_stops: u64,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Retained {
    /// With the demand in force, whose it is, and whether that source was lost, if there is one.
    Whole(Option<(Origin, Demand, bool)>),
    /// Intact, but the node's power was lost: state that could start or raise an engine is not used.
    PowerLost,
    Lost,
}

impl fmt::Display for Retained {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole(None) => f.write_str("memory whole, without a run"),
            Self::Whole(Some((origin, demand, lost))) => {
                let lost = if *lost { ", which was lost" } else { "" };
                write!(f, "memory whole: run, {demand}, from {origin}{lost}")
            }
            Self::PowerLost => f.write_str("memory whole, power lost"),
            Self::Lost => f.write_str("memory lost"),
        }
    }
}

/// What happened, in the order of time.
#[derive(Clone, Copy, Debug)]
pub enum Input {
    Commanded(Origin, Command, Result<Accepted, Rejected>),
    Truth(Truth),
    /// The node was reset; `down` is how long, in µs.
    Boot {
        retained: Retained,
        down: u64,
    },
    /// The line or the ECU was disturbed, or is no longer.
    Fault,
    /// The line was disturbed.
    LineFault,
    /// The ECU lost its power.
    Dark,
    /// Nothing was received from the ECU for [`DARK`].
    NotReceived,
    /// Something is received again.
    Received,
    /// The node's transmitter hung until now: bytes in its ring are sent late.
    HungUntil(u64),
    /// The ECU is received again, after a silence in which the link was lost.
    LinkBack,
    /// Another engine of the group was started then, as seen on its wire.
    OtherStarted(u64),
}

impl fmt::Display for Input {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Commanded(origin, command, Ok(accepted)) => {
                write!(f, "{origin} commands {command}: {accepted}")
            }
            Self::Commanded(origin, command, Err(rejected)) => {
                write!(f, "{origin} commands {command}, rejected: {rejected}")
            }
            Self::Truth(truth) => write!(f, "the ECU is sampled: {:.0} °C", truth.egt),
            Self::Boot { retained, down } => write!(f, "the node begins after {down} µs, {retained}"),
            Self::Fault => f.write_str("the line or the ECU is disturbed"),
            Self::LineFault => f.write_str("the line is disturbed"),
            Self::Dark => f.write_str("the ECU loses its power"),
            Self::NotReceived => f.write_str("nothing is received from the ECU"),
            Self::Received => f.write_str("the ECU is received again"),
            Self::HungUntil(until) => write!(f, "the node's transmitter hung until {until} µs"),
            Self::LinkBack => f.write_str("the ECU is received again after a lost link"),
            Self::OtherStarted(at) => write!(f, "another engine of the group was started at {at} µs"),
        }
    }
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
    pub resumed_runs: u64,
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
    /// The ECU governs the rpm itself.
    speed_control: bool,
    idle_rpm: u32,
    max_rpm: u32,
    pub tally: Tally,

    sources: [Option<Source>; 4],
    latched: Option<(Origin, u64)>,
    armed: bool,
    /// Sources whose last command on arming was "arm", and those that have to command "disarm" before it is accepted again.
    arm_commanded: [bool; 4],
    must_disarm: [bool; 4],
    standby_commanded: Option<u64>,
    /// Last standby of a source that is in force.
    standby_in_force: Option<u64>,
    /// Commands to start since the last frame with a switch.
    attempts: Vec<Attempt>,

    at: u64,
    wire_run: bool,
    /// After a reset a run may resume.
    may_continue: bool,
    /// The engine may have reached running in this run.
    reached: bool,
    /// It has reached running.
    ran: bool,
    opened: u64,
    last_frame: u64,
    last_run: u64,
    throttle: u16,
    rpm: u32,
    factor: u8,
    /// The largest demands that a source in control commanded since the last frame.
    peak_throttle: u16,
    peak_rpm: u32,
    /// The same, of the source that certainly was in control.
    control_peak: u16,
    /// The same since the last reset, of any source, while it is not certain who is in control.
    uncertain_throttle: u16,
    uncertain_rpm: u32,

    /// What the last source in control commanded last: with a slew the demand may still be on its way there.
    last_wanted: u16,
    /// The last demand of a source that certainly was in control: the demand in force is between the last frame and this one.
    control_demand: Option<Demand>,
    in_force: Option<Origin>,
    /// Since when the source in force has commanded without a gap.
    stream: u64,
    waiting: Option<(Origin, u64)>,
    /// Since when the source that waited to take over has been in a gap.
    interrupted: Option<u64>,
    maybe_close: bool,
    lost: bool,
    settled: u64,
    /// Time until which a source in control wanted the engine to run: at the latest, including what a reset may hide,
    /// and at the earliest.
    wanted_until: u64,
    wanted_until_least: u64,
    /// Demand on the wire when the last source fell silent.
    silent: Option<(u64, u16, u32)>,
    /// Time by which the order to run has to end, and the reason.
    over: Option<(u64, String)>,
    /// Time of a reason for standby: a source that may or may not be in control, or the last stage of loss.
    standby_reason: Option<u64>,
    /// The lower source whose standby may have ended the run, and when. The next frame may come when that source is silent.
    lower_standby: Option<(Origin, u64)>,
    /// It rises at its set rate, since this time and from this value.
    rising: Option<(u64, u16)>,
    /// When the commanded demand was last within the risen value.
    met_at: Option<u64>,
    /// The last demand on the wire was an rpm.
    rpm_last: bool,
    /// Start of the present period of 1.5 s, and the highest throttle that the ECU obeyed in it and in the previous one.
    obeyed: (u64, u16, u16),

    truth: Truth,
    standby_at: u64,
    healthy_at: u64,
    cool_at: u64,
    warm_at: u64,
    live_at: u64,
    live_since: Option<u64>,
    running_since: Option<u64>,
    /// Time since which it has run, been reported as running, and had no fault.
    healthy_since: Option<u64>,
    odd_at: u64,
    fault_at: u64,
    line_fault_at: u64,
    dark_at: Option<u64>,
    not_received: bool,
    hung: (u64, u64),
    other_started: Option<u64>,
    link_back: u64,
    limited: bool,

    booted: u64,
    retained: Option<(Origin, Demand, bool)>,
    /// Highest throttle and rpm on the wire or obeyed before the reset.
    before_reset: (u16, u32),
    guard: bool,
    memory_lost: bool,
    /// For how long the source in control had been received without a gap when the node was reset.
    steady_before: u64,
    gave_up_before: Option<u64>,
}

/// How far a value is from the range between two others, in either order.
fn outside(value: u32, a: u32, b: u32) -> u32 {
    a.min(b).saturating_sub(value).max(value.saturating_sub(a.max(b)))
}

const fn slot(origin: Origin) -> usize {
    // Highest first, as in `Origin::SOURCES`.
    4 - origin.priority() as usize
}

impl Oracle {
    pub fn new(config: EngineConfig, speed_control: bool, idle_rpm: u32, max_rpm: u32) -> Self {
        Self {
            config,
            speed_control,
            idle_rpm,
            max_rpm,
            tally: Tally::default(),
            sources: [None; 4],
            latched: None,
            armed: false,
            arm_commanded: [false; 4],
            must_disarm: [false; 4],
            standby_commanded: None,
            standby_in_force: None,
            attempts: Vec::new(),
            at: 0,
            wire_run: false,
            may_continue: true,
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
            control_peak: 0,
            uncertain_throttle: 0,
            uncertain_rpm: 0,
            last_wanted: 0,
            control_demand: None,
            in_force: None,
            stream: 0,
            waiting: None,
            interrupted: None,
            maybe_close: false,
            lost: false,
            settled: 0,
            wanted_until: 0,
            wanted_until_least: 0,
            silent: None,
            over: None,
            standby_reason: None,
            lower_standby: None,
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
            not_received: false,
            hung: (0, 0),
            other_started: None,
            link_back: 0,
            limited: false,
            booted: 0,
            retained: None,
            before_reset: (0, 0),
            guard: false,
            memory_lost: false,
            steady_before: 0,
            gave_up_before: None,
        }
    }

    // -----------------------------------------------------------------------------------------
    // Who is in control, from the documentation of the sources
    // -----------------------------------------------------------------------------------------

    fn age(&self, origin: Origin) -> u64 {
        self.config.supervision.timeouts.of(origin).as_micros()
    }

    fn longest_age(&self) -> u64 {
        Origin::SOURCES.into_iter().map(|origin| self.age(origin)).max().unwrap_or(0)
    }

    fn each(&self) -> impl Iterator<Item = (Origin, Source)> {
        Origin::SOURCES.into_iter().zip(self.sources).filter_map(|(origin, source)| Some((origin, source?)))
    }

    /// It commanded without a gap for long enough; the silence since does not count.
    fn steady(&self, source: &Source) -> bool {
        source.last_rx >= source.since + self.config.supervision.recover_after.as_micros()
    }

    /// With the time for which it was received right before the last reset.
    fn perhaps_steady(&self, source: &Source) -> bool {
        let since = source.since.saturating_sub(self.steady_before);
        source.last_rx >= since + self.config.supervision.recover_after.as_micros()
    }

    fn active_source(&self, at: u64) -> Option<(Origin, Source)> {
        self.fresh(at).find(|(_, source)| !source.was_lost || self.steady(source))
    }

    /// The source that is in control where the time right before the last reset counts as received.
    fn perhaps_active(&self, at: u64) -> Option<(Origin, Source)> {
        self.fresh(at).find(|(_, source)| !source.was_lost || self.perhaps_steady(source))
    }

    fn fresh(&self, at: u64) -> impl Iterator<Item = (Origin, Source)> {
        self.each().filter(move |(_, source)| at < source.silent_from && source.intent != Intent::Nothing)
    }

    /// It is not certain who is in control.
    fn uncertain(&self, at: u64) -> bool {
        at < self.booted + UNCERTAIN
    }

    /// Time passes: the source in control may change without a command.
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
            let active_before = self.active_source(self.at);
            self.pass(next);
            self.in_control_until_now(active_before);
            self.look();
        }
        self.pass(to);
    }

    fn pass(&mut self, to: u64) {
        if let Some((_, Source { intent: Intent::Run(demand), .. })) = self.perhaps_active(self.at) {
            self.may_have_risen(to, demand);
        }
        if let Some((_, Source { intent: Intent::Run(demand), .. })) = self.active_source(self.at) {
            self.may_have_risen(to, demand);
            self.wanted_until = self.wanted_until.max(to);
            // From here on it falls from its risen value, also one between two frames.
            self.silent = None;
            // A source that waits to take over does not count yet.
            if !self.uncertain(to) && !self.lost && self.waiting.is_none() {
                self.wanted_until_least = to;
            }
        }
        if self.wire_run {
            let lower = self.ended_by_lower(to);
            self.lower_standby = lower.map(|origin| (origin, to)).or(self.lower_standby);
            if self.ended_by_loss(to) || lower.is_some() {
                self.standby_reason = Some(to);
            }
        }
        self.at = to;
    }

    fn look(&mut self) {
        let at = self.at;
        let takeover = self.config.supervision.takeover;
        match self.active_source(at) {
            Some((origin, source)) if matches!(source.intent, Intent::Run(_)) => {
                let Intent::Run(demand) = source.intent else { return };
                self.peak(demand);
                self.last_wanted = self.last_wanted.max(self.as_throttle(demand));
                if self.uncertain(at) {
                    self.in_force = None;
                    self.lost = true;
                }
                // Another one may have taken over meanwhile, by being close.
                let certain = self.waiting.is_none() || !self.maybe_close;
                // It was never away, or only for a short gap; it also counts as away if another one was about to take over. A loss
                // before the other one came does not count.
                let away = self.lost || self.waiting.is_some();
                let itself = source.was_lost && self.stream != source.since;
                if self.in_force == Some(origin) && certain && !(away && itself) {
                    self.stream = source.since;
                    self.last_wanted = self.as_throttle(demand);
                    self.control_demand = Some(demand);
                    self.control_peak = self.control_peak.max(self.last_wanted);
                    if away {
                        // The demand was held until now.
                        self.interrupt(at);
                        self.lost = false;
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
                    // It may have taken over by being close; then another one starts its own wait.
                    Some((before, _))
                        if before != origin && (self.maybe_close || self.in_force.is_none()) =>
                    {
                        at
                    }
                    Some((_, since)) => since,
                    None => at,
                };
                if self.waiting.is_none_or(|(before, _)| before != origin) {
                    // A wait continues over a short gap, so it may end sooner than this judge has seen it begin.
                    self.maybe_close =
                        self.interrupted.is_some_and(|gap| at <= gap + takeover.within.as_micros());
                }
                self.waiting = Some((origin, since));
                // While the transmitter hangs, no frame shows the demand in force.
                self.maybe_close |= at < self.hung.1;
                // A lost demand has fallen since the last frame, by this part of its range in 0.1 %.
                let ramp = if self.lost { u64::from(self.config.supervision.loss.ramp) } else { 0 };
                let fallen =
                    u32::try_from(ramp * at.saturating_sub(self.last_frame) / SECOND).unwrap_or(1000);
                self.maybe_close |= match demand {
                    Demand::Throttle(throttle) => {
                        let active_before = match self.control_demand {
                            Some(Demand::Throttle(active_before)) => active_before.tenths(),
                            _ => self.throttle,
                        };
                        let low = u32::from(self.throttle).saturating_sub(fallen).min(active_before.into());
                        let high = self.throttle.max(active_before);
                        let from = outside(throttle.tenths().into(), low, high.into());
                        from <= u32::from(takeover.throttle_band.tenths()) + 20
                    }
                    Demand::Rpm(rpm) => {
                        let active_before = match self.control_demand {
                            Some(Demand::Rpm(active_before)) => active_before.get(),
                            _ => self.rpm,
                        };
                        let low = self.rpm.saturating_sub(self.max_rpm / 1000 * fallen).min(active_before);
                        let from = outside(rpm.get(), low, self.rpm.max(active_before));
                        !self.speed_control || from <= takeover.rpm_band.get() + 500
                    }
                };
                self.may_have_risen(at, demand);
                if at >= since + takeover.within.as_micros() {
                    self.tally.takeovers += 1;
                    let certain = self.in_force.replace(origin).is_some() && !self.maybe_close;
                    // No frame has shown it yet: the next source may be close to it.
                    self.control_demand = Some(demand);
                    self.stream = source.since;
                    self.lost = false;
                    (self.waiting, self.interrupted) = (None, None);
                    self.settled = at;
                    self.rise(at);
                    if !certain {
                        // It may have been there before, and have risen.
                        self.rising = None;
                    }
                }
            }
            // None, or a lower one that commands standby: the stages of loss continue.
            other => {
                let certain = self.waiting.is_none() || !self.maybe_close;
                if let Some((origin, _)) = other {
                    self.standby_reason = Some(at);
                    let above = self.in_force.is_some_and(|before| origin.priority() >= before.priority());
                    if certain && above && !self.uncertain(at) {
                        self.end(at, || format!("{origin} is in control and commands standby"));
                    }
                }
                if self.waiting.is_some() && self.maybe_close {
                    self.in_force = None;
                }
                self.lost = true;
                self.interrupt(at);
            }
        }
    }

    /// The source that waits to take over is in a gap.
    fn interrupt(&mut self, at: u64) {
        if self.waiting.take().is_some() {
            self.interrupted = Some(at);
        }
    }

    /// The source that was in control up to now and no longer is: its demand may have come into force since the last frame, and is
    /// then held from here on.
    fn in_control_until_now(&mut self, active_before: Option<(Origin, Source)>) {
        if let Some((before, Source { intent: Intent::Run(demand), .. })) = active_before
            && self.active_source(self.at).is_none_or(|(origin, _)| origin != before)
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
            // The demand in force may have moved since the last frame.
            let moved = match self.config.supervision.slew.up {
                Some(up) => {
                    let passed = at.saturating_sub(self.last_frame) + 25_000;
                    self.throttle + u16::try_from(u64::from(up) * passed / SECOND).unwrap_or(1000)
                }
                None => self.throttle.max(self.control_peak),
            };
            self.rising = Some((at, self.rising.map_or(moved, |(_, from)| from.max(moved))));
        }
    }

    /// The value that the demand may have reached by now at its set rate.
    fn risen(&self, at: u64) -> Option<u16> {
        let (since, from) = self.rising?;
        let rate = u64::from(self.config.supervision.rise);
        // 150 ms for the sampling of truth and frames; 0.5 % for AMT's resolution.
        let risen = u64::from(from) + rate * (at.saturating_sub(since) + 150_000) / SECOND + 6;
        Some(u16::try_from(risen).unwrap_or(u16::MAX))
    }

    /// The commanded demand may have been reached: from there on `slew.up` applies.
    fn may_have_risen(&mut self, at: u64, demand: Demand) {
        let wanted = match demand {
            Demand::Throttle(throttle) => throttle.tenths(),
            Demand::Rpm(_) => 0,
        };
        if self.risen(at).is_some_and(|risen| wanted <= risen) {
            self.met_at = Some(at);
            if self.reached {
                self.rising = None;
            }
        }
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

    /// The last stage of loss may have come: as configured, or in doubt 10 s into the fail-safe stage.
    fn ended_by_loss(&self, at: u64) -> bool {
        let loss = self.config.supervision.loss;
        let in_doubt = self.uncertain(at) || at < self.fault_at + UNCERTAIN;
        let after = loss.standby_after.map(|after| after.as_micros()).or(in_doubt.then_some(RUN_OUT));
        // After a reset the silence that is carried over is not certain, and after three the hold is left out.
        let hold = if self.uncertain(at) { 0 } else { loss.hold.as_micros() };
        // Silence carried over a reset may be counted as slightly longer than it was.
        let slack = match (self.uncertain(at), self.booted > self.wanted_until_least) {
            (true, _) => SECOND + self.longest_age(),
            (false, true) => SECOND,
            (false, false) => TOL,
        };
        after.is_some_and(|after| at + slack >= self.wanted_until_least + hold + after)
    }

    /// The lower source that commands standby and may have ended the run.
    fn ended_by_lower(&self, at: u64) -> Option<Origin> {
        let loss = self.config.supervision.loss;
        let lasted = loss.hold.as_micros() + loss.lower_standby_after.as_micros();
        let lower = |at| {
            let standby = |(_, source): &(Origin, Source)| source.intent == Intent::Standby;
            self.active_source(at).filter(standby).map(|(origin, _)| origin)
        };
        if at + TOL < self.wanted_until_least + lasted {
            return None;
        }
        lower(at).or_else(|| lower(self.last_run))
    }

    /// The lower source whose standby may have ended the run since the last frame with it, and that has commanded nothing else since.
    fn ended_by_lower_since_last_run(&self) -> Option<Origin> {
        let (origin, since) = self.lower_standby?;
        let is_standby = self.sources[slot(origin)]?.intent == Intent::Standby;
        (is_standby && since + TOL >= self.last_run).then_some(origin)
    }

    /// The order to run has ended.
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
}
