//! The life of an engine: a run belongs to one life, and this says whether that life goes on, is in doubt, or is over.
//!
//! Doubt acts at once, in the reply to the very frame that raised it; the verdict needs two reports that agree. This is
//! the one place where reports of an engine's state are debounced, for every protocol alike. The table is in
//! `docs/failsafe.md` ("One life, one start").

use super::exhaust::Burning;
use crate::command::Origin;
use crate::event::End;
use crate::link::{Sign, Stage};
use crate::units::Throttle;
use embassy_time::{Duration, Instant};

/// Reports in a row that have to agree before they confirm or end a life.
const AGREEING: u8 = 2;

/// Two throttles agree within this, in tenths of a percent: a running engine's may move.
const AGREED_BAND: u16 = 20;

/// How far an engine has come in this life.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Progress {
    /// A start was ordered, and the ECU has not reported starting: a report at rest still fits.
    Ordered,
    /// The ECU reported starting, this far.
    Starting(Stage),
    /// The ECU reported a running engine.
    Reached,
}

/// Why it is in doubt, and what was reported since.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Doubt {
    since: Instant,
    /// The ECU was not heard for a while, or the node was reset: it may have restarted meanwhile.
    gap: bool,
    /// The ECU sent faults in place of a state.
    faults: bool,
    confirming: u8,
    ending: u8,
}

impl Doubt {
    /// Raised now, with nothing reported since.
    const fn new(now: Instant) -> Self {
        Self { since: now, gap: false, faults: false, confirming: 0, ending: 0 }
    }
}

/// How one frame fits a life.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Fit {
    /// As expected.
    Fits,
    /// Says nothing either way.
    Neither,
    /// A running engine with its shaft turning.
    Confirms,
    /// Does not fit a living engine, and is no verdict.
    Doubtful,
    /// Ends the life, if the next report agrees.
    Ends(End),
}

/// One life of an engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Life {
    progress: Progress,
    /// The last report of a stage, for two that agree.
    candidate: Option<Stage>,
    doubt: Option<Doubt>,
    /// Since when the ECU reports a restart of its own (ZK 13): bounded as a start is.
    restarting: Option<Instant>,
    /// Error sets in a row, with nothing but frames without a state between.
    faulted: u8,
    /// What the last frame was may be answered with the order in force (AMT).
    answers: bool,
}

impl Life {
    /// Begins with a start.
    pub const fn ordered() -> Self {
        Self {
            progress: Progress::Ordered,
            candidate: None,
            doubt: None,
            restarting: None,
            faulted: 0,
            answers: true,
        }
    }

    /// Goes on with a start that is under way.
    pub const fn found_starting(stage: Stage) -> Self {
        Self { progress: Progress::Starting(stage), ..Self::ordered() }
    }

    /// Goes on with an engine that two reports said to be running.
    pub const fn found_running() -> Self {
        Self { progress: Progress::Reached, ..Self::ordered() }
    }

    /// After a reset of the node with an order in force: in doubt until two reports say.
    pub const fn after_reset(now: Instant) -> Self {
        let doubt = Doubt { gap: true, ..Doubt::new(now) };
        Self { doubt: Some(doubt), answers: false, ..Self::found_running() }
    }

    /// The engine has reached running in this life.
    pub fn reached(&self) -> bool {
        self.progress == Progress::Reached
    }

    /// Since when the life is in doubt.
    pub fn in_doubt(&self) -> Option<Instant> {
        self.doubt.map(|doubt| doubt.since)
    }

    /// The ECU was not heard for a while, or the node was reset, and nothing has confirmed the life since.
    pub fn after_gap(&self) -> bool {
        self.doubt.is_some_and(|doubt| doubt.gap)
    }

    /// An ECU that waits for a reply to its frame may have the order in force (AMT).
    pub const fn answers(&self) -> bool {
        self.answers
    }

    /// What was found is what is answered.
    pub const fn answer(&mut self) {
        self.answers = true;
    }

    /// The ECU sends faults in place of a state.
    pub const fn only_faults(&self) -> bool {
        self.faulted >= AGREEING
    }

    /// Since when the ECU restarts the engine by itself.
    pub const fn restarting(&self) -> Option<Instant> {
        self.restarting
    }

    /// Three expected frames did not come.
    pub fn gap(&mut self, now: Instant) -> Option<End> {
        self.candidate = None;
        self.answers = false;
        if self.progress == Progress::Ordered {
            return Some(End::GapInStart);
        }
        let doubt = self.doubt.unwrap_or(Doubt::new(now));
        self.doubt = Some(Doubt { gap: true, confirming: 0, ending: 0, ..doubt });
        None
    }

    /// One frame. Gives what ended the life, if it did.
    pub fn see(&mut self, now: Instant, sign: Sign, exhaust: Burning) -> Option<End> {
        if sign == Sign::PowerUp {
            self.answers = false;
            return Some(End::PowerUp);
        }
        self.count_faults(now, sign, exhaust);
        let fit = self.fit(sign, exhaust);
        let end = match fit {
            Fit::Fits => {
                self.advance(sign);
                None
            }
            Fit::Neither => {
                self.contradict(sign);
                None
            }
            Fit::Confirms => {
                self.confirm();
                None
            }
            Fit::Doubtful => {
                let doubt = self.raise(now);
                doubt.confirming = 0;
                // A shaft that slows down helps to end a life; it ends none alone.
                doubt.ending = if doubt.ending > 0 { doubt.ending + 1 } else { 0 };
                (doubt.ending >= AGREEING).then_some(End::AtRest)
            }
            Fit::Ends(end) => {
                let doubt = self.raise(now);
                doubt.confirming = 0;
                doubt.ending += 1;
                (doubt.ending >= AGREEING).then_some(end)
            }
        };
        self.restarting = match sign {
            Sign::State { stage: Stage::Restart, .. } => self.restarting.or(Some(now)),
            Sign::State { .. } => None,
            _ => self.restarting,
        };
        let end = end.or_else(|| self.fault_end(exhaust));
        self.answers = end.is_none() && self.may_answer(sign, fit, exhaust);
        end
    }

    /// With faults in place of a state the exhaust is the evidence of an engine that runs. A start ends: its ECU could start
    /// the engine anew when the fault clears.
    fn fault_end(&self, exhaust: Burning) -> Option<End> {
        match (self.only_faults(), self.reached()) {
            (false, _) => None,
            (true, false) => Some(End::FaultInStart),
            (true, true) => (exhaust == Burning::No).then_some(End::NotBurning),
        }
    }

    /// How one frame fits, given how far the engine has come.
    fn fit(&self, sign: Sign, exhaust: Burning) -> Fit {
        let gap = self.after_gap();
        let (stage, turning) = match sign {
            Sign::State { stage, turning, .. } => (stage, turning),
            Sign::Shaft { turning: false } if self.reached() => return Fit::Doubtful,
            _ => return Fit::Neither,
        };
        let slow = turning != Some(true);
        match (self.progress, stage) {
            (_, Stage::Running) if !slow || turning.is_none() => Fit::Confirms,
            (Progress::Reached, Stage::Running) => Fit::Doubtful,
            (_, Stage::Running) => Fit::Neither,
            (Progress::Ordered, Stage::Rest) => Fit::Fits,
            (_, Stage::Rest) => Fit::Ends(End::AtRest),
            (Progress::Ordered, Stage::Clearance) => Fit::Fits,
            (_, Stage::Clearance) if slow || exhaust == Burning::No => Fit::Ends(End::AtRest),
            // A shaft that coasts beside a cleared start: no engine that runs is reported so, and run would start it.
            (_, Stage::Clearance) => Fit::Doubtful,
            // After a gap any starting state is a start again: of ZK at any shaft speed.
            (_, Stage::Ignition | Stage::FuelRamp | Stage::Restart) if gap => Fit::Ends(End::StartsAgain),
            (_, Stage::Starting) if gap && slow => Fit::Ends(End::StartsAgain),
            (Progress::Starting(_), Stage::StartedUp | Stage::Calibrating) if gap && slow => {
                Fit::Ends(End::StartsAgain)
            }
            (_, Stage::Restart) | (Progress::Ordered | Progress::Starting(_), Stage::Unknown) => Fit::Neither,
            (Progress::Reached, Stage::Ignition | Stage::FuelRamp | Stage::Starting) if slow => {
                Fit::Ends(End::StartsAgain)
            }
            // Idle calibration and "started up" in flight are neither, with a shaft that turns.
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

    /// A report that fits: two that agree move the life on. They also end the doubt that one odd report raised in a start;
    /// after a gap only a running engine does.
    fn advance(&mut self, sign: Sign) {
        let Sign::State { stage, .. } = sign else { return };
        self.contradict(sign);
        let agrees = self.candidate.replace(stage).is_some_and(|before| before > Stage::Clearance);
        if agrees && stage > Stage::Clearance && !self.after_gap() {
            self.doubt = None;
            self.progress = Progress::Starting(stage);
        }
    }

    /// Reports that agree follow one another: one that says something else begins anew.
    fn contradict(&mut self, sign: Sign) {
        if let (Sign::State { .. }, Some(doubt)) = (sign, &mut self.doubt) {
            (doubt.confirming, doubt.ending) = (0, 0);
        }
    }

    fn confirm(&mut self) {
        let agrees = match &mut self.doubt {
            Some(doubt) => {
                doubt.ending = 0;
                doubt.confirming += 1;
                doubt.confirming >= AGREEING
            }
            None => self.candidate == Some(Stage::Running),
        };
        self.candidate = Some(Stage::Running);
        if agrees {
            self.doubt = None;
            self.progress = Progress::Reached;
        }
    }

    fn raise(&mut self, now: Instant) -> &mut Doubt {
        self.candidate = None;
        self.doubt.get_or_insert(Doubt::new(now))
    }

    /// With faults in place of a state nothing but the exhaust says that the engine runs: the next state has to.
    fn count_faults(&mut self, now: Instant, sign: Sign, exhaust: Burning) {
        match sign {
            Sign::Faulted { .. } => {
                self.faulted = self.faulted.saturating_add(1);
                if self.only_faults() && self.reached() {
                    self.raise(now).faults = true;
                }
            }
            Sign::State { .. } => {
                // Until now the exhaust has said so: what is in doubt is in doubt from here on.
                if self.only_faults()
                    && exhaust == Burning::Yes
                    && let Some(doubt) = self.doubt.as_mut().filter(|doubt| !doubt.gap)
                {
                    doubt.since = now;
                }
                self.faulted = 0;
            }
            _ => {}
        }
    }

    /// Whether the frame may be answered with the order in force. In doubt nothing may that could start an engine.
    fn may_answer(&self, sign: Sign, fit: Fit, exhaust: Burning) -> bool {
        let Some(doubt) = self.doubt else { return true };
        match sign {
            Sign::PowerUp | Sign::Shaft { .. } => false,
            // After faults only a report that says running; else it may be the engine's last turns.
            Sign::State { stage, turning, .. } => {
                turning == Some(true)
                    && !matches!(fit, Fit::Ends(_) | Fit::Doubtful)
                    && (!doubt.faults || stage == Stage::Running)
            }
            // Values that cannot be read are no gap: a second of noise must not cost the replies, and so the engine.
            Sign::Damaged => !doubt.gap,
            Sign::Stateless => !doubt.gap && doubt.ending == 0,
            Sign::Faulted { .. } if doubt.gap => exhaust == Burning::Yes,
            Sign::Faulted { .. } => exhaust != Burning::No,
        }
    }
}

/// What is known of an engine of which no order is in force: after a reset without a record, or where a life was not
/// confirmed in time.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Finding {
    /// Since when nothing is in force.
    pub since: Instant,
    /// Since when no source has wanted anything, as far as that began before.
    pub silent_since: Instant,
    /// Silence of all sources from before the last reset, and of the one whose demand was in force.
    pub carried: Duration,
    pub lost_for: Duration,
    /// Whose demand was in force before, if that is known: a lower source's standby waits for its loss.
    pub ruler: Origin,
    /// The record says that the engine ran, and nothing has ended that.
    pub ran: bool,
    /// The record says that it was started so long ago, and had not reached running.
    pub started: Option<Duration>,
    alive: u8,
    ending: u8,
    throttle: Option<Throttle>,
}

/// What was found.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Found {
    /// Not yet anything.
    Nothing,
    /// An engine that runs.
    Running,
    /// An engine at rest, or one that starts.
    NotRunning,
    /// An engine whose ECU reports faults only, with a burning exhaust, and the record says that it ran.
    Burning,
}

impl Finding {
    /// Nothing is known.
    pub const fn new(since: Instant, ran: bool) -> Self {
        Self {
            since,
            silent_since: since,
            carried: Duration::from_ticks(0),
            lost_for: Duration::from_ticks(0),
            ruler: Origin::Node,
            ran,
            started: None,
            alive: 0,
            ending: 0,
            throttle: None,
        }
    }

    /// The same, with sources that fell silent earlier.
    pub const fn silent_since(self, silent_since: Instant) -> Self {
        Self { silent_since, ..self }
    }

    /// The same, in a start that began so long ago, and that a reset has cut short.
    pub const fn in_a_start(self, since: Duration) -> Self {
        Self { started: Some(since), ..self }
    }

    /// The same, where this source's demand was in force before.
    pub const fn controlled_by(self, ruler: Origin) -> Self {
        Self { ruler, ..self }
    }

    /// The same, with this silence from before a reset.
    pub const fn carrying(self, carried: Duration, lost_for: Duration) -> Self {
        Self { carried, lost_for, ..self }
    }

    /// The ECU was not heard for a while: what it reported before counts no more.
    pub const fn gap(&mut self) {
        (self.alive, self.ending) = (0, 0);
    }

    /// One frame. `answers`: the ECU waits for replies (AMT), and a set without a named running state counts if its shaft
    /// turns.
    pub fn see(&mut self, sign: Sign, exhaust: Burning, answers: bool) -> Found {
        match sign {
            Sign::PowerUp => Found::NotRunning,
            Sign::State { stage, turning, throttle } => {
                let turning = turning == Some(true);
                let alive = match stage {
                    Stage::Running => turning,
                    Stage::Rest | Stage::Clearance | Stage::Ignition | Stage::FuelRamp | Stage::Restart => {
                        false
                    }
                    _ => answers && turning,
                };
                let ends = match stage {
                    Stage::Rest | Stage::Ignition | Stage::FuelRamp | Stage::Restart => true,
                    Stage::Clearance | Stage::Starting => !turning,
                    _ => false,
                };
                let same = match (self.throttle, throttle) {
                    (Some(a), Some(b)) => a.tenths().abs_diff(b.tenths()) <= AGREED_BAND,
                    (a, b) => a == b,
                };
                self.throttle = throttle;
                self.alive = match alive {
                    true if same => self.alive.saturating_add(1),
                    alive => alive.into(),
                };
                self.ending = if ends { self.ending.saturating_add(1) } else { 0 };
                match (self.alive >= AGREEING, self.ending >= AGREEING) {
                    (true, _) => Found::Running,
                    (_, true) => Found::NotRunning,
                    _ => Found::Nothing,
                }
            }
            Sign::Faulted { .. } if self.ran && exhaust == Burning::Yes => Found::Burning,
            _ => Found::Nothing,
        }
    }
}
