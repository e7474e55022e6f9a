//! The life of an engine: a run belongs to one life, which continues, is in doubt, or is over.
//!
//! Doubt takes effect at once, in the reply to the frame that raised it. Ending or confirming a life takes two consecutive
//! reports that agree. What people and interlocks see of a state is debounced in
//! `debounce.rs`; here the same reports decide about a life. The table is in
//! `docs/failsafe.md` ("One life, one start").

use super::exhaust::Burning;
use super::retained::RetainedState;
use crate::command::Origin;
use crate::consecutive::{AGREEING, Consecutive};
use crate::event::End;
use crate::link::{Observation, Stage};
use crate::units::Throttle;
use embassy_time::{Duration, Instant};

/// Largest difference between two throttles that agree, in 0.1 %: a running engine's may move.
const AGREEING_BAND: u16 = 20;

/// Progress of an engine in this life.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Progress {
    /// A start was ordered, and the ECU has not reported starting: a report at rest is still expected, of cooling is not.
    Ordered,
    /// The ECU reported this stage of a start.
    Starting(Stage),
    /// The ECU reported a running engine.
    Reached,
}

/// What raised a doubt.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Cause {
    /// A report that does not fit.
    Report,
    /// A reset of the node. Nothing was received meanwhile, but nothing says that the ECU stopped sending either.
    Reset,
    /// Three expected frames were missing: the ECU may have restarted meanwhile.
    Gap,
}

/// A doubt, and the reports since.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Doubt {
    since: Instant,
    /// Its length before the last reset.
    before: Duration,
    cause: Cause,
    /// The ECU sent faults instead of a state.
    faults: bool,
    /// Since then the exhaust of an ECU that sends only faults was that of a burning engine.
    burned: bool,
    /// Sets that were not to be answered (AMT): 1 if the last one with a state was not; consecutive reports of rest or start
    /// clearance, with which no engine runs, are counted.
    withheld: Consecutive,
    confirming: Consecutive,
    ending: Consecutive,
}

impl Doubt {
    /// A doubt that begins now.
    const fn new(now: Instant) -> Self {
        let before = Duration::from_ticks(0);
        Self {
            since: now,
            before,
            cause: Cause::Report,
            faults: false,
            burned: false,
            withheld: Consecutive::NONE,
            confirming: Consecutive::NONE,
            ending: Consecutive::NONE,
        }
    }

    /// A doubt after a reset of the node.
    const fn after_reset(now: Instant) -> Self {
        Self { cause: Cause::Reset, ..Self::new(now) }
    }

    /// Consecutive reports that agree have to begin again.
    const fn contradict(&mut self) {
        self.confirming.reset();
        self.ending.reset();
    }

    /// The ECU may have restarted since the last report that fitted.
    fn after_gap(&self) -> bool {
        self.cause != Cause::Report
    }
}

/// Relation of one frame to a life.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Fit {
    /// As expected.
    Fits,
    /// Neither confirms nor contradicts it.
    Neither,
    /// Reports a running engine with its shaft turning.
    Confirms,
    /// Contradicts it, but does not end it.
    Doubtful,
    /// Ends it, if the next report agrees.
    Ends(End),
}

/// One life of an engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Life {
    progress: Progress,
    /// Last reported stage, waiting for a second report that agrees.
    candidate: Option<Stage>,
    doubt: Option<Doubt>,
    /// Time since which the ECU has reported its own restart (state 13 of ZK). It has the timeout of a start.
    restarting: Option<Instant>,
    /// The last state that the ECU reported is one in which it lights the engine.
    lights: bool,
    /// Error sets since the last frame with a state.
    faulted: Consecutive,
    /// The last frame may be answered with the order in force (AMT).
    answers: bool,
    /// The engine ran in this life. After a reset with a hand-over to PWM in force that may not be known.
    ran: bool,
}

impl Life {
    /// A life that begins with a start.
    pub const fn ordered() -> Self {
        Self {
            progress: Progress::Ordered,
            candidate: None,
            doubt: None,
            restarting: None,
            lights: false,
            faulted: Consecutive::NONE,
            answers: true,
            ran: false,
        }
    }

    /// A life found in a start that is under way.
    pub const fn found_starting(stage: Stage) -> Self {
        Self { progress: Progress::Starting(stage), ..Self::ordered() }
    }

    /// A life found running, by two reports.
    pub const fn found_running() -> Self {
        Self { progress: Progress::Reached, ran: true, ..Self::ordered() }
    }

    /// A life found with a shaft that turns, in a state that a start and a flight have in common: in doubt until two reports confirm
    /// that it runs.
    pub const fn found_turning(now: Instant) -> Self {
        Self::handed_over(now, false)
    }

    /// A life found after a reset, by the exhaust alone: in doubt until two reports confirm it. `after_faults`: two error sets came. If not,
    /// the one by which it was found counts.
    pub const fn found_burning(now: Instant, after_faults: bool) -> Self {
        let doubt = Doubt { burned: true, faults: after_faults, ..Doubt::after_reset(now) };
        let mut life = Self::doubted(doubt);
        life.faulted.count(!after_faults);
        life
    }

    /// A life after a reset of the node with a hand-over to PWM in force: in doubt until two reports confirm it. `ran`: it reached
    /// running before.
    pub const fn handed_over(now: Instant, ran: bool) -> Self {
        Self { ran, ..Self::doubted(Doubt::after_reset(now)) }
    }

    /// A life after a reset of the node with a run in force: in doubt until two reports confirm it, with what the record has of an earlier doubt.
    pub const fn resumed(now: Instant, record: &RetainedState) -> Self {
        let mut doubt = Doubt { before: record.unconfirmed, ..Doubt::after_reset(now) };
        if record.after_gap {
            doubt.cause = Cause::Gap;
        }
        doubt.faults = record.after_faults;
        if record.exhaust_ignored {
            doubt.withheld = Consecutive::AGREE;
        }
        Self { ran: !record.unproven, ..Self::doubted(doubt) }
    }

    /// A life of a running engine with this doubt.
    const fn doubted(doubt: Doubt) -> Self {
        Self { doubt: Some(doubt), answers: false, ..Self::found_running() }
    }

    /// Whether the engine has reached running in this life.
    pub fn reached(&self) -> bool {
        self.progress == Progress::Reached
    }

    /// Whether the engine ran in this life, as far as is known.
    pub const fn ran(&self) -> bool {
        self.ran
    }

    /// Time since which the life has been in doubt.
    pub fn in_doubt(&self) -> Option<Instant> {
        self.doubt.map(|doubt| doubt.since)
    }

    /// Length of the doubt before the last reset.
    pub fn doubted_before(&self) -> Duration {
        self.doubt.map_or(Duration::from_ticks(0), |doubt| doubt.before)
    }

    /// Whether three expected frames were missing, and nothing has confirmed the life since.
    pub fn missed_frames(&self) -> bool {
        self.doubt.is_some_and(|doubt| doubt.cause == Cause::Gap)
    }

    /// Whether error sets came since the last confirmation.
    pub fn after_faults(&self) -> bool {
        self.doubt.is_some_and(|doubt| doubt.faults)
    }

    /// Whether error sets get no reply, whatever the exhaust: the ECU has reported that its engine does not run.
    pub fn ignores_exhaust(&self) -> bool {
        self.doubt.is_some_and(|doubt| doubt.withheld.reached(AGREEING))
    }

    /// Whether there was a gap in reception or a reset, and nothing has confirmed the life since.
    fn after_gap(&self) -> bool {
        self.doubt.is_some_and(|doubt| doubt.after_gap())
    }

    /// Whether the last frame may be answered with the order in force (AMT).
    pub const fn answers(&self) -> bool {
        self.answers
    }

    /// Allows the answer to the frame with which a running engine was found.
    pub const fn answer(&mut self) {
        self.answers = true;
    }

    /// Whether the ECU reports a running engine and nothing puts that in doubt, or faults only while the exhaust is hot.
    pub fn lives(&self, exhaust: Burning) -> bool {
        let burns = self.only_faults() && !self.after_gap() && exhaust == Burning::Yes;
        self.reached() && (self.doubt.is_none() || burns)
    }

    /// Time since which the ECU has reported its own restart of the engine.
    pub const fn restarting(&self) -> Option<Instant> {
        self.restarting
    }

    /// Whether the ECU last reported that it lights the engine. It may also do so uncommanded, while the engine runs and turns.
    pub const fn lights(&self) -> bool {
        self.lights
    }

    /// Three expected frames are missing.
    pub fn gap(&mut self, now: Instant) -> Option<End> {
        self.candidate = None;
        self.answers = false;
        if self.progress == Progress::Ordered {
            return Some(End::GapInStart);
        }
        let doubt = self.doubt.get_or_insert(Doubt::new(now));
        doubt.cause = Cause::Gap;
        doubt.contradict();
        None
    }

    /// Takes one frame. Returns why the life ended, if it did.
    pub fn observe(&mut self, now: Instant, observation: Observation, exhaust: Burning) -> Option<End> {
        if observation == Observation::PowerUp {
            self.answers = false;
            return Some(End::PowerUp);
        }
        self.count_faults(now, observation, exhaust);
        let fit = self.fit(observation, exhaust);
        let end = match fit {
            Fit::Fits => {
                self.advance(observation);
                None
            }
            Fit::Neither => {
                self.contradict(observation, exhaust);
                None
            }
            Fit::Confirms => {
                self.confirm();
                None
            }
            Fit::Doubtful => {
                let doubt = self.raise(now);
                doubt.confirming.reset();
                // A slowing shaft supports an end that another report has begun; it ends no life alone.
                doubt.ending.count(doubt.ending.reached(1));
                doubt.ending.reached(AGREEING).then_some(End::AtRest)
            }
            Fit::Ends(end) => {
                let doubt = self.raise(now);
                doubt.confirming.reset();
                doubt.ending.count(true);
                doubt.ending.reached(AGREEING).then_some(end)
            }
        };
        self.restarting = match observation {
            Observation::State { stage: Stage::Restart, .. } => self.restarting.or(Some(now)),
            Observation::State { stage: Stage::Ignition | Stage::FuelRamp, .. } => self.restarting,
            Observation::State { .. } => None,
            _ => self.restarting,
        };
        self.lights = match observation {
            Observation::State { stage, .. } => {
                matches!(stage, Stage::Ignition | Stage::FuelRamp | Stage::Starting | Stage::Restart)
            }
            _ => self.lights,
        };
        let end = end.or_else(|| self.fault_end(exhaust));
        self.answers = end.is_none() && self.may_answer(observation, fit, exhaust);
        if let Some(doubt) = &mut self.doubt {
            match observation {
                Observation::State { stage, .. } if stage <= Stage::Clearance => doubt.withheld.count(true),
                Observation::State { .. } => {
                    doubt.withheld.reset();
                    doubt.withheld.count(!self.answers);
                }
                // One report between error sets may be odd.
                Observation::Faulted { .. } if !doubt.withheld.reached(AGREEING) => doubt.withheld.reset(),
                _ => {}
            }
        }
        end
    }

    /// Whether the ECU sends faults instead of a state.
    const fn only_faults(&self) -> bool {
        self.faulted.reached(AGREEING)
    }

    /// With faults instead of a state only the exhaust temperature shows a running engine. A start ends: the ECU could start
    /// the engine again when the fault clears.
    fn fault_end(&self, exhaust: Burning) -> Option<End> {
        match (self.only_faults(), self.reached()) {
            (false, _) => None,
            (true, false) => Some(End::FaultInStart),
            (true, true) => (exhaust == Burning::No).then_some(End::NotBurning),
        }
    }

    /// Relation of one frame to the life, given its progress.
    fn fit(&self, observation: Observation, exhaust: Burning) -> Fit {
        let gap = self.after_gap();
        let (stage, turning) = match observation {
            Observation::State { stage, turning, .. } => (stage, turning),
            Observation::Shaft { turning: false } if self.reached() => return Fit::Doubtful,
            _ => return Fit::Neither,
        };
        let slow = turning != Some(true);
        match (self.progress, stage) {
            (_, Stage::Running) if !slow || turning.is_none() => Fit::Confirms,
            (Progress::Reached, Stage::Running) => Fit::Doubtful,
            (_, Stage::Running) => Fit::Neither,
            (Progress::Ordered, Stage::Rest) => Fit::Fits,
            // An engine that cools has burned: its start needed standby, which is not cooling.
            (_, Stage::Rest | Stage::Cooling) => Fit::Ends(End::AtRest),
            (Progress::Ordered, Stage::Clearance) => Fit::Fits,
            (_, Stage::Clearance) if slow || exhaust == Burning::No => Fit::Ends(End::AtRest),
            // No running engine is reported as cleared for a start. The shaft coasts, and "run" would start it.
            (_, Stage::Clearance) => Fit::Doubtful,
            // After a gap any starting state means another start; with ZK at any shaft speed.
            (_, Stage::Ignition | Stage::FuelRamp | Stage::Restart) if gap => Fit::Ends(End::StartsAgain),
            (_, Stage::Starting) if gap && slow => Fit::Ends(End::StartsAgain),
            (Progress::Starting(_), Stage::StartedUp | Stage::Calibrating) if gap && slow => {
                Fit::Ends(End::StartsAgain)
            }
            // The ECU has begun the start that was ordered, and begins it again: what it reports at rest then is its end.
            (Progress::Ordered, Stage::Restart) => Fit::Fits,
            (_, Stage::Restart) | (Progress::Ordered | Progress::Starting(_), Stage::Unknown) => Fit::Neither,
            (Progress::Reached, Stage::Ignition | Stage::FuelRamp | Stage::Starting) if slow => {
                Fit::Ends(End::StartsAgain)
            }
            // The ECU may have restarted in less than a gap, and "run" would start its engine while the shaft coasts. In its own restart
            // it lights an engine that is ordered to run.
            (Progress::Reached, Stage::Ignition | Stage::FuelRamp) if self.restarting.is_none() => {
                Fit::Doubtful
            }
            // Idle calibration and "started up" in flight mean nothing while the shaft turns.
            (Progress::Reached, Stage::StartedUp | Stage::Calibrating | Stage::Unknown)
                if turning == Some(false) =>
            {
                Fit::Doubtful
            }
            (Progress::Reached, _) => Fit::Neither,
            (Progress::Starting(before), stage) if stage < before && slow => Fit::Ends(End::StartsAgain),
            (_, _) => Fit::Fits,
        }
    }

    /// Takes a report that fits: two that agree advance the life. They also end the doubt that one odd report raised in a
    /// start; after a gap only a running engine does. From the first report of starting on, rest no longer fits.
    fn advance(&mut self, observation: Observation) {
        let Observation::State { stage, .. } = observation else { return };
        self.contradict(observation, Burning::NotKnown);
        // A restart may be at any stage, and alone is no report of the start.
        let restarts = stage == Stage::Restart;
        let stage = if restarts { Stage::Ignition } else { stage };
        let starts = stage > Stage::Clearance;
        let before = self.candidate.replace(stage);
        let agrees = !self.after_gap() && before.is_some_and(|before| (before > Stage::Clearance) == starts);
        if agrees {
            self.doubt = None;
        }
        if starts && agrees {
            self.progress = Progress::Starting(stage);
        } else if starts && !restarts && self.progress == Progress::Ordered {
            // One report may be odd, and of a later stage than the engine's.
            self.progress = Progress::Starting(Stage::Ignition);
        }
    }

    /// Resets the counts of agreeing reports, which have to be consecutive. Between two reports of an engine at rest, faults beside an
    /// exhaust that burns contradict them.
    const fn contradict(&mut self, observation: Observation, exhaust: Burning) {
        let Some(doubt) = &mut self.doubt else { return };
        match (observation, exhaust) {
            (Observation::State { .. }, _) => doubt.contradict(),
            (Observation::Faulted { .. }, Burning::Yes) => doubt.ending.reset(),
            _ => {}
        }
    }

    fn confirm(&mut self) {
        let agrees = match &mut self.doubt {
            Some(doubt) => {
                doubt.ending.reset();
                doubt.confirming.count(true);
                doubt.confirming.reached(AGREEING)
            }
            None => self.candidate == Some(Stage::Running),
        };
        self.candidate = Some(Stage::Running);
        if agrees {
            self.doubt = None;
            self.progress = Progress::Reached;
            self.ran = true;
        }
    }

    fn raise(&mut self, now: Instant) -> &mut Doubt {
        self.candidate = None;
        self.doubt.get_or_insert(Doubt::new(now))
    }

    /// Counts error sets. They put a running engine in doubt until the next state confirms it.
    fn count_faults(&mut self, now: Instant, observation: Observation, exhaust: Burning) {
        match observation {
            Observation::Faulted { .. } => {
                self.faulted.count(true);
                if self.only_faults() && self.reached() {
                    let doubt = self.raise(now);
                    doubt.faults = true;
                    doubt.burned |= exhaust == Burning::Yes;
                }
            }
            Observation::State { .. } => {
                // Until now the exhaust confirmed the engine, so the doubt begins here.
                if self.only_faults()
                    && exhaust == Burning::Yes
                    && let Some(doubt) = self.doubt.as_mut().filter(|doubt| !doubt.after_gap())
                {
                    doubt.since = now;
                }
                self.faulted.reset();
            }
            _ => {}
        }
    }

    /// Whether the frame may be answered with the order in force: not if that could start an engine whose life is in doubt.
    fn may_answer(&self, observation: Observation, fit: Fit, exhaust: Burning) -> bool {
        let Some(doubt) = self.doubt else { return true };
        match observation {
            Observation::PowerUp | Observation::Shaft { .. } => false,
            // After faults only a report of running; other states may be the last turns of the shaft.
            Observation::State { stage, turning, .. } => {
                turning == Some(true)
                    && !matches!(fit, Fit::Ends(_) | Fit::Doubtful)
                    && (!doubt.faults || stage == Stage::Running)
            }
            // Damaged values are not a gap: without replies during a second of noise the ECU would stop the engine.
            Observation::Damaged => !doubt.after_gap() && !doubt.withheld.reached(AGREEING),
            // It adds nothing to the last set that had a state.
            Observation::Stateless => !doubt.after_gap() && !doubt.withheld.reached(1),
            // The ECU has reported that its engine does not run, and its exhaust may be hot yet.
            Observation::Faulted { .. } if self.ignores_exhaust() => false,
            Observation::Faulted { .. } => match (doubt.cause, exhaust) {
                (_, Burning::Yes) => true,
                (_, Burning::No) => false,
                // A restarted ECU could start its engine when the fault clears.
                (Cause::Gap, _) => false,
                // Without a sensor nothing will ever decide: the order stays in force under the stages of loss, as before. So it does
                // while an exhaust that burned after the reset falls, until it falls as fast as one without a flame.
                (Cause::Reset, Burning::NotReadable) => true,
                (Cause::Reset, Burning::NotKnown) => doubt.burned,
                (Cause::Report, _) => true,
            },
        }
    }
}

/// Search for a running engine while no order is in force: after a reset without a record, or after a life that was not
/// confirmed in time.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Finding {
    /// Time since which no order has been in force.
    pub since: Instant,
    /// Time since which no source has commanded, where that began earlier.
    pub silent_since: Instant,
    /// Silence before the last reset: of all sources, and of the one whose demand was in force.
    pub carried: Duration,
    pub lost_for: Duration,
    /// Source whose demand was in force, if known: the standby of a lower source waits for its loss.
    pub active_source: Origin,
    /// The engine ran before, according to the record, or runs, according to its ECU.
    pub ran: bool,
    /// The order was given up, because nothing confirmed it in time: what became of the engine since is not known.
    pub given_up: bool,
    /// Error sets came before it: only "running" shows that the engine runs.
    pub after_faults: bool,
    /// Time since an unfinished start, according to the record.
    pub started: Option<Duration>,
    /// Time without a reply before this search, and for which a fall of the exhaust was expected then.
    pub unconfirmed: Duration,
    pub fall_expected: Duration,
    faulted: Consecutive,
    alive: Consecutive,
    ending: Consecutive,
    throttle: Option<Throttle>,
}

/// Result of the search.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Found {
    /// No result yet.
    Nothing,
    /// A running engine.
    Running,
    /// An engine at rest, or in a start.
    NotRunning,
    /// An engine that ran before, with a hot exhaust and an ECU that reports faults only.
    Burning,
}

impl Finding {
    /// A search without a record.
    pub const fn new(since: Instant, ran: bool) -> Self {
        Self {
            since,
            silent_since: since,
            carried: Duration::from_ticks(0),
            lost_for: Duration::from_ticks(0),
            active_source: Origin::Node,
            ran,
            given_up: false,
            after_faults: false,
            started: None,
            unconfirmed: Duration::from_ticks(0),
            fall_expected: Duration::from_ticks(0),
            faulted: Consecutive::NONE,
            alive: Consecutive::NONE,
            ending: Consecutive::NONE,
            throttle: None,
        }
    }

    /// Adds that error sets came before.
    pub const fn after_faults(self, after_faults: bool) -> Self {
        Self { after_faults, ..self }
    }

    /// Whether the engine flew until this search began.
    pub const fn flew(&self) -> bool {
        self.ran && !self.given_up
    }

    /// Adds a start that was ordered this long ago and interrupted by a reset.
    pub const fn in_a_start(self, since: Duration) -> Self {
        Self { started: Some(since), ..self }
    }

    /// Adds the source whose demand was in force.
    pub const fn controlled_by(self, active_source: Origin) -> Self {
        Self { active_source, ..self }
    }

    /// Time without a reply, that before this search included.
    pub fn unconfirmed_at(&self, now: Instant) -> Duration {
        self.unconfirmed + now.saturating_duration_since(self.since)
    }

    /// Time for which a fall of the exhaust is expected yet.
    pub fn fall_expected_at(&self, now: Instant) -> Duration {
        let passed = now.saturating_duration_since(self.since);
        Duration::from_ticks(self.fall_expected.as_ticks().saturating_sub(passed.as_ticks()))
    }

    /// Adds silence from before a reset.
    pub const fn carrying(self, carried: Duration, lost_for: Duration) -> Self {
        Self { carried, lost_for, ..self }
    }

    /// Discards earlier reports, after a gap in reception.
    pub const fn gap(&mut self) {
        self.alive.reset();
        self.ending.reset();
    }

    /// Takes one frame. `answers`: the ECU waits for replies (AMT), and a set with an unnamed state counts as running if its
    /// shaft turns.
    pub fn observe(&mut self, observation: Observation, exhaust: Burning, answers: bool) -> Found {
        match observation {
            Observation::Faulted { .. } => self.faulted.count(true),
            Observation::State { .. } => self.faulted.reset(),
            _ => {}
        }
        self.after_faults |= self.faulted.reached(AGREEING);
        match observation {
            Observation::PowerUp => Found::NotRunning,
            Observation::State { stage, turning, throttle } => {
                let turning = turning == Some(true);
                let alive = match stage {
                    Stage::Running => turning,
                    stage if stage <= Stage::FuelRamp => false,
                    Stage::Restart => false,
                    // The engine flew: its ECU starts it again by itself, on an order that was given up.
                    Stage::Starting if self.given_up => false,
                    _ => answers && turning && !self.after_faults,
                };
                let ends = match stage {
                    Stage::Clearance | Stage::Starting => !turning,
                    stage => stage <= Stage::FuelRamp || stage == Stage::Restart,
                };
                let same = match (self.throttle, throttle) {
                    (Some(a), Some(b)) => a.tenths().abs_diff(b.tenths()) <= AGREEING_BAND,
                    (a, b) => a == b,
                };
                self.throttle = throttle;
                if alive {
                    self.alive.count_with_last(same);
                } else {
                    self.alive.reset();
                }
                self.ending.count(ends);
                match (self.alive.reached(AGREEING), self.ending.reached(AGREEING)) {
                    (true, _) => Found::Running,
                    (_, true) => Found::NotRunning,
                    _ => Found::Nothing,
                }
            }
            Observation::Faulted { .. } if self.flew() && exhaust == Burning::Yes => Found::Burning,
            // As without a reset, a start ends, unless the engine may burn: the ECU could start it again when the fault clears.
            Observation::Faulted { .. } if self.started.is_some() => {
                self.ending.count(exhaust == Burning::No);
                if self.ending.reached(AGREEING) { Found::NotRunning } else { Found::Nothing }
            }
            _ => Found::Nothing,
        }
    }
}
