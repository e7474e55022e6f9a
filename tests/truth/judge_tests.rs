//! The judge can fail: for each rule, a hand-made history that breaks only this rule, and one that keeps it.

mod evidence;
mod flight;
mod hand_over;
mod held;
mod limits;
mod mavlink;
mod power;
mod prompt;
mod reduction;
mod shape;
mod silence;
mod starts;
mod sticks;
mod stops;
mod trips;
mod valve;
mod waiting;

use crate::history::{
    Cause, Commanded, Demanded, Frame, History, MS, Mark, PilotCommand, Reset, Rules, SECOND, Sample, Sent,
    Spans, Switch,
};
use crate::judge::{Rule, Verdict, busy, judge, may_have_failed};
use crate::kind::Kind;
use sim::turbine::Phase;

const AMT: Kind = Kind::Amt;
const ZK5: Kind = Kind::Zk(5);
const IDLE: Sent = Sent::Full(Switch::Run, 0);
const HALF: Sent = Sent::Full(Switch::Run, 500);
const STANDBY: Sent = Sent::Full(Switch::Standby, 0);
const STOP: Sent = Sent::Full(Switch::Stop, 0);
/// When the engine of [`flight`] has reached running, and when its pilot commands half throttle, s.
const RUNS: u64 = 30;
const PILOT: usize = 1;

fn rules(kind: Kind) -> Rules {
    Rules {
        kind,
        period: if kind == AMT { 125 } else { 50 } * MS,
        round: if kind == AMT { 1 } else { 9 },
        ages: [500 * MS, 500 * MS, SECOND, 500 * MS],
        recover_after: SECOND,
        return_within: SECOND,
        takeover: 2 * SECOND,
        hold: SECOND,
        ramp: 500,
        rise: 500,
        slew_up: None,
        slew_down: None,
        fail_safe: 0,
        standby_after: None,
        lower_standby_after: 5 * SECOND,
        listen: SECOND,
        arming: true,
        link_stable: SECOND,
        idle_band: 20,
        egt_max: 100.0,
        start_timeout: 120 * SECOND,
        start_gap: 0,
        start_wait: 0,
        start_throttle: 0,
        governor: false,
        pump_bound: 30 * SECOND,
        gives_up_after: 2 * SECOND,
        serial_delay: 2 * SECOND,
        frame: 50 * MS,
        authority: 1000,
        gives_up_on_empty: false,
        stale: 0,
        boot: 300 * MS,
        idle_rpm: 50_000.0,
        max_rpm: 160_000.0,
        limit_egt: None,
        limit_rpm: None,
        limit_fault: None,
        limit_changes: [None; 4],
        limit_flame: None,
        limit_hot: None,
        limit_low_rpm: None,
        limit_jump: None,
        jump_lowers: false,
        limit_supply: None,
        supply_counts: false,
        burning: 300.0,
        when_other_fails: None,
    }
}

/// Writes a history. Times are in seconds.
struct Story(History);

impl Story {
    fn new(kind: Kind) -> Self {
        Self(History::new(rules(kind)))
    }

    fn streams(mut self, source: usize, from: f64, to: f64, command: PilotCommand) -> Self {
        let mut at = micros(from);
        while at < micros(to) {
            self.0.commanded.push(Commanded { at, source, command });
            at += 100 * MS;
        }
        self
    }

    fn once(self, source: usize, at: f64, command: PilotCommand) -> Self {
        self.streams(source, at, at + 0.001, command)
    }

    fn wire(mut self, from: f64, to: f64, sent: Sent) -> Self {
        let mut at = micros(from);
        while at < micros(to) {
            self.0.frames.push(Frame { at: at + MS, arrived: true, sent });
            at += self.0.rules.period;
        }
        self
    }

    /// A demand that moves at 50 % a second.
    fn ramp(mut self, at: f64, from: u32, to: u32) -> Self {
        let steps = u64::from(from.abs_diff(to)) * MS * 2 / self.0.rules.period;
        for step in 0..=steps {
            let done = (step * self.0.rules.period / MS / 2) as u32;
            let tenths = if to > from { (from + done).min(to) } else { from.saturating_sub(done).max(to) };
            let at = micros(at) + step * self.0.rules.period + MS;
            self.0.frames.push(Frame { at, arrived: true, sent: Sent::Full(Switch::Run, tenths) });
        }
        self
    }

    fn turbine(mut self, from: f64, to: f64, phase: Phase, rpm: f64, egt: f64) -> Self {
        let (lit, flow) = match phase {
            Phase::Preheat | Phase::FuelRamp | Phase::LearningIdle | Phase::Running => (true, 100.0),
            _ => (false, 0.0),
        };
        let mut at = micros(from);
        while at < micros(to) {
            self.0.samples.push(Sample { at, phase, lit, rpm, egt, flow, fault: false, hidden: false });
            at += 50 * MS;
        }
        self
    }

    /// Fuel flows although the engine is at rest.
    fn fuel(mut self, from: f64, to: f64) -> Self {
        for sample in
            self.0.samples.iter_mut().filter(|sample| (micros(from)..micros(to)).contains(&sample.at))
        {
            sample.flow = 40.0;
        }
        self
    }

    fn mark(mut self, at: f64, mark: Mark) -> Self {
        self.0.marks.push((micros(at), mark));
        self
    }

    fn with(mut self, change: impl FnOnce(&mut History)) -> Self {
        change(&mut self.0);
        self
    }

    /// Whether this rule has a finding, whatever others have.
    fn finds(self, rule: Rule) -> bool {
        self.judged().rules().contains(&rule)
    }

    /// Whether a finding has this text.
    fn says(self, text: &str) -> bool {
        self.judged().findings.iter().any(|found| found.text.contains(text))
    }

    fn judged(mut self) -> Verdict {
        let h = &mut self.0;
        h.commanded.sort_by_key(|commanded| commanded.at);
        h.frames.sort_by_key(|frame| frame.at);
        h.samples.sort_by_key(|sample| sample.at);
        h.marks.sort_by_key(|(at, _)| *at);
        h.end = h.samples.last().map_or(0, |sample| sample.at);
        judge(h)
    }

    #[track_caller]
    fn breaks(self, rules: &[Rule]) {
        let verdict = self.judged();
        assert_eq!(verdict.rules(), rules, "{:#?}", verdict.findings);
    }

    /// It does not test the wire in doubt, or how soon the turbine obeys.
    #[track_caller]
    fn breaks_beside(self, others: &[Rule], rules: &[Rule]) {
        let verdict = self.judged();
        let found: Vec<Rule> = verdict.rules().into_iter().filter(|rule| !others.contains(rule)).collect();
        assert_eq!(found, rules, "{:#?}", verdict.findings);
    }

    #[track_caller]
    fn passes(self) {
        self.breaks(&[]);
    }
}

/// Nothing of the ECU arrives undamaged from one instant to another.
fn damage(h: &mut History, from_us: u64, to_us: u64) {
    h.noise = Spans::from(&[(from_us, to_us)]);
    h.ruined = h.noise.clone();
}

fn micros(seconds: f64) -> u64 {
    (seconds * SECOND as f64).round() as u64
}

/// Armed and in standby until 4 s, cold.
fn ready(kind: Kind) -> Story {
    Story::new(kind)
        .once(PILOT, 1.5, PilotCommand::Arm)
        .streams(PILOT, 1.0, 4.0, PilotCommand::Standby)
        .wire(1.0, 4.0, STANDBY)
        .turbine(0.0, 5.0, Phase::Standby, 0.0, 15.0)
}

/// Started at 4 s, runs from 30 s on.
fn started(kind: Kind) -> Story {
    ready(kind)
        .streams(PILOT, 4.0, 31.0, PilotCommand::Run(Demanded::Throttle(0)))
        .wire(4.0, 31.0, IDLE)
        .mark(5.0, Mark::Ignition)
        .turbine(5.0, RUNS as f64, Phase::FuelRamp, 20_000.0, 400.0)
}

/// And then at half throttle until this time, s; its pilot continues with it.
fn flight(kind: Kind, until: f64) -> Story {
    started(kind)
        .streams(PILOT, 31.0, until, PilotCommand::Run(Demanded::Throttle(500)))
        .wire(31.0, until, HALF)
        .turbine(RUNS as f64, until, Phase::Running, 100_000.0, 500.0)
}

/// An AMT engine is shut down in flight, and its source commands run.
fn shut_down_uncommanded() -> Story {
    flight(AMT, 40.0)
        .streams(PILOT, 40.0, 41.0, PilotCommand::Run(Demanded::Throttle(500)))
        .turbine(40.0, 40.1, Phase::Running, 60_000.0, 480.0)
        .turbine(40.1, 41.0, Phase::Cooling, 50_000.0, 400.0)
        .wire(40.0, 41.0, STANDBY)
}
