//! The pilot of one engine: takes it through standby, start, idle, steps, shutdown and cooling, and judges by
//! the ECU's reports whether each was reached.
//!
//! It commands as any source does, through a `Handle`, ten times a second. When an engine stops although it
//! should run, and its line was disturbed, the pilot starts it again by standby and run; on a clean line the
//! run ends for this engine, unless its flame was put out. A start that an interlock refuses is commanded
//! again: another engine of the group may be starting, or the exhaust still be hot.

use super::context::{EngineContext, PilotInput, Stage};
use super::faults::{Failure, Faults};
use super::node::Node;
use super::plan::{EnginePlan, LEAST_RUNNING};
use super::quantity::seconds;
use super::sample::is_fresh;
use embassy_time::{Duration, Instant, Ticker};
use jetlink::command::{Accepted, Command, Demand, Interlock, Order, Origin, Rejected};
use jetlink::event::LossStage;
use jetlink::report::{LinkState, Phase};
use jetlink::telemetry::Telemetry;
use jetlink::units::{Rpm, Throttle};
use std::collections::VecDeque;

/// Between two commands; the timeout of a source is 0.5 s.
const TICK: Duration = Duration::from_millis(100);
/// For the ECU to be received and to report standby.
const READY_WITHIN: Duration = Duration::from_secs(10);
/// For the interlocks to allow a start: engines start one after the other, and some starts fail.
const ALLOWED_WITHIN: Duration = Duration::from_secs(300);
/// For a link to be up after the last fault.
const RECOVER_WITHIN: Duration = Duration::from_secs(3);
/// Idle after the start and before the shutdown.
const IDLE: Duration = Duration::from_secs(5);
/// The shortest step.
const STEP: Duration = Duration::from_secs(10);
/// A speed counts as reached when it has been steady for this number of ticks.
const STEADY_TICKS: usize = 10;
/// EGT, in tenths of a degree, below which an engine is cool.
const COOL: i16 = 1000;
/// Duration of a source's silence in the middle of the run.
const SILENCE: Duration = Duration::from_secs(6);
/// Between the end of a silence and the engine's obedience.
const FOLLOWS_WITHIN: Duration = Duration::from_secs(15);
/// Demands before a silence, in percent: the fall to idle has to be visible.
const BEFORE_SILENCE: [u8; 2] = [80, 60];
/// Slower than this the shaft counts as stopped.
const AT_REST_RPM: u32 = 1000;

/// Why a wait ended early.
#[derive(Clone, Copy, Debug)]
enum Cut {
    /// The time is over.
    TimeUp,
    /// The engine stopped: the node cancelled the run, or the ECU reports faults and no state any more.
    Stopped,
    /// The node refused the command.
    Refused(Rejected),
}

/// The pilot of one engine.
#[derive(Debug)]
pub struct Pilot<'a> {
    context: &'a EngineContext<'a>,
    node: &'a Node<'a>,
    plan: EnginePlan,
    standby_only: bool,
    rng: fastrand::Rng,
    /// When the last fault on the line ends.
    clean_from: Instant,
    /// Number of times that its flame is put out in this run.
    flame_outs: usize,
    /// When its source is to fall silent.
    silent_at: Option<Instant>,
}

impl<'a> Pilot<'a> {
    /// For one engine.
    pub fn new(
        context: &'a EngineContext<'a>,
        node: &'a Node<'a>,
        plan: EnginePlan,
        standby_only: bool,
        faults: &Faults,
        seed: u64,
    ) -> Self {
        let flame_out = |failure: &(usize, Failure)| {
            failure.0 == context.index && matches!(failure.1, Failure::FlameOut(_))
        };
        Self {
            context,
            node,
            plan,
            standby_only,
            rng: fastrand::Rng::with_seed(seed),
            // Faults that never end are not waited for.
            clean_from: context.clean_from.min(plan.shutdown_at),
            silent_at: plan.silent_at,
            flame_outs: faults.failures.iter().filter(|failure| flame_out(failure)).count(),
        }
    }

    /// Flies the whole plan. The error states what was not reached.
    pub async fn fly(&mut self) -> Result<(), String> {
        let result = if self.standby_only { self.stand_by().await } else { self.whole_run().await };
        match &result {
            Ok(()) => self.stage(Stage::Done),
            Err(why) => {
                self.context.note(format!("NOT REACHED: {why}"));
                self.context.failure.replace(Some(why.clone()));
                self.stage(Stage::Failed);
                // Nothing is left running.
                self.context.input.set(PilotInput::Standby);
                let limit = Instant::now() + self.plan.cooling_takes + READY_WITHIN;
                let _ = self
                    .hold_until(limit, |telemetry| {
                        (telemetry.link == LinkState::Lost || is_cool(telemetry)).then_some(())
                    })
                    .await;
            }
        }
        result
    }

    /// Commands standby when all is done, as a source does: another start may follow.
    pub async fn stay(&self) {
        let mut ticker = Ticker::every(TICK);
        loop {
            ticker.next().await;
            let _ = self.command(PilotInput::Standby); // a refusal is an event
        }
    }

    async fn whole_run(&mut self) -> Result<(), String> {
        let mut flame_outs_left = self.flame_outs;
        loop {
            let began = Instant::now();
            self.ready().await?;
            let flown = match self.start().await {
                Ok(()) => self.run().await,
                Err(why) => Err(why),
            };
            let Err(why) = flown else { break };
            if began >= self.clean_from {
                // Nothing disturbs the line: only a flame that was put out is a reason to start again.
                flame_outs_left = flame_outs_left.checked_sub(1).ok_or_else(|| why.clone())?;
            }
            self.context.note(format!("{why}; it will be started again"));
        }
        self.shut_down().await
    }

    /// Standby only, until the time is over.
    async fn stand_by(&mut self) -> Result<(), String> {
        self.ready().await?;
        self.hold(self.clean_from).await;
        self.recovered().await?;
        self.hold(self.plan.shutdown_at).await;
        Ok(())
    }

    /// Standby, until the ECU is received, cool and ready.
    async fn ready(&mut self) -> Result<(), String> {
        self.stage(Stage::Standby);
        self.context.input.set(PilotInput::Standby);
        self.arm();
        let hot = self.telemetry().report.egt.is_some_and(|egt| egt.value.tenths() >= COOL);
        let cooling = if hot { self.plan.cooling_takes } else { Duration::MIN };
        let limit = self.clean_from.max(Instant::now()) + READY_WITHIN + cooling;
        let by_rpm = self.context.engine.by_rpm();
        let reported_speeds = |telemetry: &Telemetry| {
            let report = &telemetry.report;
            report.version.is_some() && report.idle_rpm.is_some() && report.max_rpm.is_some()
        };
        let ready = self
            .hold_until(limit, |telemetry| {
                (telemetry.link == LinkState::Up
                    && is_cool(telemetry)
                    && (!by_rpm || reported_speeds(telemetry)))
                .then_some(())
            })
            .await;
        ready.map_err(|cut| match cut {
            Cut::Refused(why) => format!("standby was refused: {why}"),
            Cut::TimeUp | Cut::Stopped => format!("not ready for a start in time: {}", self.describe()),
        })?;
        // A node needs two reports of the version before it commands a speed.
        self.hold(Instant::now() + TICK * 10).await;
        if !self.standby_only {
            self.hold(self.plan.start_at).await;
        }
        Ok(())
    }

    /// Arms the engine; after an emergency stop a source that has armed it disarms first.
    fn arm(&self) {
        let (engine, bench) = (self.context.index, Origin::Bench);
        let refusals = self.node.start_refusals(engine, None, bench).unwrap_or_default();
        if refusals.contains(&Rejected::DisarmFirst) {
            self.node.command(engine, Command::Disarm, bench);
        }
        self.node.command(engine, Command::Arm, bench);
    }

    async fn start(&mut self) -> Result<(), String> {
        self.stage(Stage::Start);
        let Some(idle) = self.demand(0) else { return Err("the ECU has not reported its speeds".to_owned()) };
        self.context.input.set(PilotInput::Run(idle));
        self.allowed().await?;
        let takes = self.plan.start_takes;
        let started = Instant::now();
        let running = self
            .hold_until(started + takes * 3 / 2 + READY_WITHIN, |telemetry| {
                (phase(telemetry) == Some(Phase::Running)).then_some(())
            })
            .await;
        match running {
            Ok(()) => {
                self.context
                    .note(format!("running {:.1} s after the command", seconds(Instant::now() - started)));
                Ok(())
            }
            Err(Cut::TimeUp) => Err(format!("did not start in time: {}", self.describe())),
            Err(Cut::Stopped) => Err(format!("the start failed: {}", self.describe())),
            Err(Cut::Refused(why)) => Err(format!("the start was refused: {why}")),
        }
    }

    /// Commands the start until every interlock allows it.
    async fn allowed(&self) -> Result<(), String> {
        let limit = Instant::now() + ALLOWED_WITHIN;
        let mut ticker = Ticker::every(TICK);
        loop {
            if self.context.silent.get() && Instant::now() < limit {
                ticker.next().await;
                continue;
            }
            match self.command(self.context.input.get()) {
                Ok(()) => return Ok(()),
                // It waits, for as long as it is commanded.
                Err(Cut::Refused(Rejected::Start(Interlock::OtherStarting))) if Instant::now() < limit => {
                    ticker.next().await;
                }
                // A refusal has used up the permission: standby once more.
                Err(Cut::Refused(Rejected::Start(_)) | Cut::Stopped) if Instant::now() < limit => {
                    let _ = self.command(PilotInput::Standby);
                    ticker.next().await;
                }
                Err(Cut::Refused(why)) => return Err(format!("the start was refused: {why}")),
                Err(Cut::TimeUp | Cut::Stopped) => {
                    return Err(format!("the start was not commanded in time: {}", self.describe()));
                }
            }
        }
    }

    async fn run(&mut self) -> Result<(), String> {
        // After a second start there may be little left of the time that was planned.
        let shutdown_at = self.plan.shutdown_at.max(Instant::now() + LEAST_RUNNING);
        self.stage(Stage::Idle);
        self.keep_running(Instant::now() + IDLE).await?;
        self.stage(Stage::Steps);
        let mut percent = 0;
        while self.clean_from > Instant::now() || Instant::now() + STEP + IDLE <= shutdown_at {
            let disturbed = self.clean_from > Instant::now();
            if !disturbed {
                self.recovered().await?;
            }
            let before = percent;
            percent = match self.silent_at {
                Some(at) if Instant::now() + STEP * 2 >= at => {
                    BEFORE_SILENCE.into_iter().find(|next| next.abs_diff(before) >= 20).unwrap_or(40)
                }
                _ => self.another(before),
            };
            let mut end = Instant::now() + STEP + Duration::from_millis(self.rng.u64(..3000));
            if Instant::now() + STEP * 2 + IDLE > shutdown_at && self.silent_at.is_none() {
                // The last one.
                end = end.max(shutdown_at - IDLE);
            }
            if disturbed {
                end = end.min(self.clean_from);
            }
            self.step(before, percent, end, !disturbed).await?;
            if self.silent_at.is_some_and(|at| Instant::now() >= at) {
                self.silent_at = None;
                self.fall_silent().await?;
            }
        }
        self.recovered().await?;
        self.step(percent, 0, Instant::now() + IDLE, false).await
    }

    /// Another throttle, far enough from this one to be seen.
    fn another(&mut self, percent: u8) -> u8 {
        loop {
            let next = self.rng.u8(4..=20) * 5;
            if next.abs_diff(percent) >= 20 {
                return next;
            }
        }
    }

    /// One step from idle (0) to full (100), held until `end`.
    async fn step(&mut self, before: u8, percent: u8, end: Instant, strict: bool) -> Result<(), String> {
        let Some(demand) = self.demand(percent) else {
            return Err("the ECU no longer reports its speeds".to_owned());
        };
        self.context.input.set(PilotInput::Run(demand));
        let first = speed(&self.telemetry());
        let mut last = Steady::default();
        let reached = self
            .hold_until(end, |telemetry| {
                let now = speed(telemetry)?;
                let steady = last.is_steady(now);
                let moved =
                    first.is_none_or(|first| if percent > before { now > first } else { now < first });
                (steady && moved && obeyed(telemetry, demand)).then_some(())
            })
            .await;
        match reached {
            Ok(()) => {}
            Err(Cut::TimeUp) if !strict => {
                return Ok(());
            }
            Err(Cut::TimeUp) => {
                return Err(format!(
                    "{} was not reached in time: {}",
                    self.context.input.get(),
                    self.describe()
                ));
            }
            Err(cut) => return Err(self.stopped(cut)),
        }
        self.keep_running(end).await
    }

    /// The source is silent for a while: the demand is held, goes to idle, and comes back with it.
    async fn fall_silent(&self) -> Result<(), String> {
        self.stage(Stage::SourceLost);
        self.context.note("its source falls silent");
        self.context.silent.set(true);
        let silent = self.keep_running(Instant::now() + SILENCE).await;
        self.context.silent.set(false);
        silent?;
        self.context.note(format!("its source commands again after {} s", seconds(SILENCE)));
        let PilotInput::Run(demand) = self.context.input.get() else { return Ok(()) };
        // The throttle is back before the shaft speed: the next step has to begin at the speed of its demand.
        let mut last = Steady::default();
        let follows = self
            .hold_until(Instant::now() + FOLLOWS_WITHIN, |telemetry| {
                let steady = last.is_steady(speed(telemetry)?);
                (steady && telemetry.loss == LossStage::None && obeyed(telemetry, demand)).then_some(())
            })
            .await;
        match follows {
            Ok(()) => self.stage(Stage::Steps),
            Err(Cut::TimeUp) => {
                return Err(format!("it did not follow its source again in time: {}", self.describe()));
            }
            Err(cut) => return Err(self.stopped(cut)),
        }
        Ok(())
    }

    async fn shut_down(&mut self) -> Result<(), String> {
        self.stage(Stage::Cooling);
        self.context.input.set(PilotInput::Standby);
        let limit = Instant::now() + self.plan.cooling_takes * 3 / 2 + READY_WITHIN;
        let mut cool_ticks = 0;
        let cooled = self
            .hold_until(limit, |telemetry| {
                cool_ticks = if is_cool(telemetry) { cool_ticks + 1 } else { 0 };
                (cool_ticks >= STEADY_TICKS).then_some(())
            })
            .await;
        cooled.map_err(|_| format!("not shut down and cool in time: {}", self.describe()))
    }

    /// The link has to be up soon after the last fault on the line.
    async fn recovered(&mut self) -> Result<(), String> {
        if self.clean_from == Instant::MIN {
            return Ok(());
        }
        let limit = self.clean_from.max(Instant::now()) + RECOVER_WITHIN;
        let up = self
            .hold_until(limit, |telemetry| {
                (telemetry.link == LinkState::Up && self.context.recovered_after.get().is_some())
                    .then_some(())
            })
            .await;
        match up {
            Ok(()) => Ok(()),
            Err(Cut::TimeUp) => Err("the link did not come back after the faults had ended".to_owned()),
            Err(cut) => Err(self.stopped(cut)),
        }
    }

    /// Holds the input until then, whatever happens.
    async fn hold(&self, until: Instant) {
        let _ = self.hold_until(until, |_| None::<()>).await;
    }

    async fn keep_running(&self, until: Instant) -> Result<(), String> {
        match self.hold_until(until, |_| None::<()>).await {
            Ok(()) | Err(Cut::TimeUp) => Ok(()),
            Err(cut) => Err(self.stopped(cut)),
        }
    }

    /// Holds the input until this has come, or the time is over, or the engine stops.
    async fn hold_until<T>(
        &self,
        until: Instant,
        mut come: impl FnMut(&Telemetry) -> Option<T>,
    ) -> Result<T, Cut> {
        let input = self.context.input.get();
        let mut ticker = Ticker::every(TICK);
        self.command(input)?;
        loop {
            let telemetry = self.telemetry();
            let cancelled = !matches!(telemetry.ordered.order, Order::Run(_) | Order::Doubt(_));
            if matches!(input, PilotInput::Run(_)) && (cancelled || reports_only_faults(&telemetry)) {
                return Err(Cut::Stopped);
            }
            if let Some(what) = come(&telemetry) {
                return Ok(what);
            }
            if Instant::now() >= until {
                return Err(Cut::TimeUp);
            }
            self.command(input)?;
            ticker.next().await;
        }
    }

    fn command(&self, input: PilotInput) -> Result<(), Cut> {
        // Before the call: the node may act at once.
        let at = sim::clock::now_ns();
        if self.context.silent.get() {
            self.context.audit.borrow_mut().may_be_up_to(at, None);
            return Ok(());
        }
        let Some(answer) = self.node.command(self.context.index, input.command(), Origin::Bench) else {
            return Ok(());
        };
        self.context.judge(at, input.order(), Origin::Bench, answer);
        match answer {
            // After a reset it listens first.
            Ok(Accepted::StartWaits) => Err(Cut::Refused(Rejected::Start(Interlock::OtherStarting))),
            Ok(_) | Err(Rejected::Listening) => Ok(()),
            Err(Rejected::StandbyFirst) => Err(Cut::Stopped),
            Err(why) => Err(Cut::Refused(why)),
        }
    }

    fn telemetry(&self) -> Telemetry {
        self.node.telemetry(self.context.index)
    }

    /// Percent of the way from idle to full, as this engine is commanded.
    fn demand(&self, percent: u8) -> Option<Demand> {
        if !self.context.engine.by_rpm() {
            return Throttle::from_percent(percent).ok().map(Demand::Throttle);
        }
        let report = self.telemetry().report;
        let (idle, max) = (report.idle_rpm?.value.get(), report.max_rpm?.value.get());
        let rpm = idle + max.checked_sub(idle)? / 100 * u32::from(percent);
        Some(Demand::Rpm(Rpm::new(rpm)))
    }

    fn stage(&self, stage: Stage) {
        if self.context.stage.replace(stage) != stage {
            self.context.note(format!("progress: {}", stage.name()));
        }
    }

    fn stopped(&self, cut: Cut) -> String {
        match cut {
            Cut::Refused(why) => format!("a command was refused: {why}"),
            Cut::Stopped | Cut::TimeUp => {
                self.context.stops.set(self.context.stops.get() + 1);
                format!("uncommanded shutdown: {}", self.describe())
            }
        }
    }

    /// What the ECU reports, for people.
    fn describe(&self) -> String {
        let telemetry = self.telemetry();
        let report = &telemetry.report;
        if telemetry.last_rx.is_none() {
            return "nothing was ever received from the ECU".to_owned();
        }
        if telemetry.link != LinkState::Up {
            return "nothing is received from the ECU".to_owned();
        }
        let now = telemetry.at;
        let mut text = match report.state.filter(|state| is_fresh(state, now)) {
            Some(state) => format!("the ECU reports state {} ({})", state.value.code, state.value.name),
            None => "the ECU reports no state".to_owned(),
        };
        if let Some(speed) = report.rpm.filter(|speed| is_fresh(speed, now)) {
            text += &format!(", {} rpm", speed.value.get());
        }
        if let Some(egt) = report.egt {
            text += &format!(", EGT {:.0} °C", f64::from(egt.value.tenths()) / 10.0);
        }
        if let Some(faults) = report.faults
            && !faults.value.is_empty()
        {
            text += &format!(", fault: {}", faults.value);
        }
        text
    }
}

/// Whether the speeds of the last ticks are one speed.
#[derive(Debug, Default)]
struct Steady(VecDeque<u32>);

impl Steady {
    fn is_steady(&mut self, now: u32) -> bool {
        self.0.push_back(now);
        if self.0.len() <= STEADY_TICKS {
            return false;
        }
        self.0.pop_front();
        let (Some(min), Some(max)) = (self.0.iter().min(), self.0.iter().max()) else { return false };
        // Twice the coarsest step of an AMT ECU's rpm.
        max - min <= (max / 64).max(1000)
    }
}

fn phase(telemetry: &Telemetry) -> Option<Phase> {
    telemetry.report.phase.map(|phase| phase.value)
}

/// An AMT ECU sends error sets, which carry no state, in place of normal sets (AMT-8).
fn reports_only_faults(telemetry: &Telemetry) -> bool {
    let report = &telemetry.report;
    let stale = report.phase.is_some_and(|phase| !is_fresh(&phase, telemetry.at));
    let faulty =
        report.faults.is_some_and(|faults| is_fresh(&faults, telemetry.at) && !faults.value.is_empty());
    stale && faulty
}

/// In standby, below 100 °C, and the shaft at rest.
fn is_cool(telemetry: &Telemetry) -> bool {
    let report = &telemetry.report;
    matches!(phase(telemetry), Some(Phase::Standby | Phase::Stopped))
        && report.egt.is_some_and(|egt| egt.value.tenths() < COOL)
        && speed(telemetry).is_some_and(|speed| speed < AT_REST_RPM)
}

/// Shaft speed; where the engine's scale is open, in steps as large as an Olympus has (AMT-5).
fn speed(telemetry: &Telemetry) -> Option<u32> {
    let report = &telemetry.report;
    match (report.rpm, report.rpm_raw) {
        (Some(rpm), _) => Some(rpm.value.get()),
        (None, Some(raw)) => Some(u32::from(raw.value) * 500),
        (None, None) => None,
    }
}

/// The ECU shows what was demanded.
fn obeyed(telemetry: &Telemetry, demand: Demand) -> bool {
    let report = &telemetry.report;
    match demand {
        // ZK ECUs report whole percents.
        Demand::Throttle(throttle) => {
            report.throttle.is_some_and(|shown| shown.value.tenths().abs_diff(throttle.tenths()) <= 10)
        }
        Demand::Rpm(rpm) => {
            report.rpm.is_some_and(|shown| shown.value.get().abs_diff(rpm.get()) <= rpm.get() / 64)
        }
    }
}
