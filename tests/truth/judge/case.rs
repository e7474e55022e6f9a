//! What the rules share: their names, what they found, and what each derives from a history.

use super::control::CommandLog;
use crate::history::{Demanded, History, MS, Mark, SECOND, Spans};
use crate::kind::Traits;
use sim::turbine::Phase;
use std::collections::BTreeMap;

/// What must hold.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Rule {
    /// Every ignition follows one source's own standby and run while armed, with the interlocks satisfied;
    /// each pair counts once.
    Ignition,
    /// An engine at rest is sent run for a bounded time, and after a restart of its ECU or a lost line only on a new start.
    RunAtRest,
    /// An engine that burns again on the order of an earlier life is not sent run.
    SecondLife,
    /// While it is unknown whether an engine lives, nothing is sent that could start it.
    Doubt,
    /// A start that is commanded as documented begins.
    Granted,
    /// With all sources silent, the demand on the wire is at the fail-safe by a defined instant.
    SilentWire,
    /// With all sources silent, the turbine is at the fail-safe, or stopped, by a defined instant.
    SilentTurbine,
    /// A stop is on the wire at once, and in every frame until its release.
    Stop,
    /// An engine that is sent standby or stop goes out.
    Obeyed,
    /// No fuel flows into a hot engine at rest.
    HotFuel,
    /// A pump that was opened is closed in time.
    Pump,
    /// Services that move fuel or heat are sent to a cold, armed engine in standby, when a pilot commands
    /// them.
    Service,
    /// The demand rises at a limited rate.
    Rate,
    /// An engine that has reached running is not sent standby or stop without a reason.
    ShutDown,
    /// An engine that is sent run is not shut down by its ECU for lack of commands.
    GivenUp,
    /// A demand is not held below what is commanded.
    HeldDown,
    /// Nor above it, nor above what limits it.
    HeldUp,
    /// A limit that is exceeded has its action.
    Limit,
    /// A demand is reduced while another engine has failed, where that is configured.
    Reduction,
    /// A source takes over only when its demand is close, or after its wait.
    TakeOver,
    /// The engine is handed over to the PWM input only when a pilot commands it, and for one life of the
    /// engine.
    Pwm,
    /// Nothing is sent that the ECU's version does not know; stops are.
    Version,
    /// Every frame is one that the document defines.
    Frame,
    /// A latched stop closes the fuel valve at once, and until its release.
    Valve,
    /// No fuel comes through a shut valve: nothing burns behind it, and no start is ordered.
    ShutValve,
    /// The valve shuts off no engine that is ordered to run.
    CutOff,
    /// Starter and ignition have power from arming until the ECU reports a cold engine at rest, and not without a reason.
    Power,
    /// Radio control commands what stick and switch show, and stop at the switch stops.
    Sticks,
    /// What MAVLink commands was received from a system that may command it, and what was received is obeyed.
    ByMavlink,
}

impl Rule {
    pub const ALL: [Self; 29] = [
        Self::Ignition,
        Self::RunAtRest,
        Self::SecondLife,
        Self::Doubt,
        Self::Granted,
        Self::SilentWire,
        Self::SilentTurbine,
        Self::Stop,
        Self::Obeyed,
        Self::HotFuel,
        Self::Pump,
        Self::Service,
        Self::Rate,
        Self::ShutDown,
        Self::GivenUp,
        Self::HeldDown,
        Self::HeldUp,
        Self::Limit,
        Self::Reduction,
        Self::TakeOver,
        Self::Pwm,
        Self::Version,
        Self::Frame,
        Self::Valve,
        Self::ShutValve,
        Self::CutOff,
        Self::Power,
        Self::Sticks,
        Self::ByMavlink,
    ];
}

/// A rule that was broken.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Finding {
    pub rule: Rule,
    pub at: u64,
    pub text: String,
}

/// How long rules applied, and how much of that was exempt, by name, µs.
#[derive(Clone, Default, PartialEq, Eq, Debug)]
pub struct Share {
    pub applied: u64,
    pub exempt: BTreeMap<&'static str, u64>,
}

impl Share {
    pub fn exempt(&mut self, name: &'static str, time_us: u64) {
        *self.exempt.entry(name).or_default() += time_us;
    }

    pub fn add(&mut self, other: &Self) {
        self.applied += other.applied;
        for (name, time) in &other.exempt {
            self.exempt(name, *time);
        }
    }

    pub fn per_mille(&self) -> f64 {
        self.exempt.values().sum::<u64>() as f64 * 1000.0 / self.applied.max(1) as f64
    }
}

/// What the judge found in one history.
#[derive(Clone, Default, PartialEq, Eq, Debug)]
pub struct Verdict {
    pub findings: Vec<Finding>,
    /// The rules for a healthy engine.
    pub healthy: Share,
    /// The rule for an engine at rest that is sent run.
    pub at_rest: Share,
    /// How often each situation occurred that a rule covers.
    pub seen: BTreeMap<&'static str, u64>,
}

impl Verdict {
    pub fn finding(&mut self, rule: Rule, at: u64, text: impl Into<String>) {
        self.findings.push(Finding { rule, at, text: text.into() });
    }

    pub fn count(&mut self, what: &'static str, by: u64) {
        *self.seen.entry(what).or_default() += by;
    }

    pub fn exempt(&mut self, name: &'static str, time_us: u64) {
        self.healthy.exempt(name, time_us);
    }

    /// The rules that were broken, each once.
    pub fn rules(&self) -> Vec<Rule> {
        Rule::ALL.into_iter().filter(|rule| self.findings.iter().any(|found| found.rule == *rule)).collect()
    }
}

/// A history, and what the rules derive from it.
pub struct Case<'a> {
    pub h: &'a History,
    pub command_log: CommandLog,
    /// The turbine is between the ignition and its end.
    pub live: Spans,
    /// The turbine runs, and burns.
    pub runs: Spans,
    /// The ECU reports a fault.
    pub faults: Spans,
    pub down: Spans,
    /// The ECU sends nothing that could be received: no power, booting, or no wire.
    pub blind: Spans,
    /// No state of the engine reaches the node.
    pub hidden: Spans,
    /// Times in which a stop cannot be released.
    pub stopped: Spans,
    /// The frames with a demand above the fail-safe.
    pub high: Vec<u64>,
    pub verdict: Verdict,
}

impl<'a> Case<'a> {
    pub fn new(h: &'a History) -> Self {
        // Up to version 4 a ZK ECU that receives nothing sends nothing.
        let dumb: Vec<(u64, u64)> =
            h.deaf.iter().filter(|(from, _)| (1..5).contains(&h.version(*from))).collect();
        let boots = Spans::from(&[(0, h.rules.boot)]).union(&Spans::from(&dumb));
        let blind = h.unpowered.longer(h.rules.boot).union(&h.mute).union(&boots);
        let (down, faults) = (h.down(), h.times(|sample| sample.fault));
        // In error sets an AMT ECU reports no state.
        let dumb = if h.traits().faults_hide_state { faults.clone() } else { Spans::default() };
        // A node that restarts needs two reports; in a loop of resets it may never get them.
        let learns = down.longer(two_states(h));
        let silent = blind.union(&h.noise).union(&learns).union(&dumb);
        Self {
            command_log: CommandLog::new(h),
            live: live(h),
            runs: h.times(|sample| sample.runs()),
            hidden: silent.union(&h.times(|sample| sample.hidden)),
            faults,
            down,
            blind,
            stopped: Spans::default(),
            high: h
                .frames
                .iter()
                .filter(|frame| frame.sent.demand().is_some_and(|demanded| is_above_fail_safe(h, demanded)))
                .map(|frame| frame.at)
                .collect(),
            verdict: Verdict::default(),
            h,
        }
    }

    pub const fn traits(&self) -> &'static Traits {
        self.h.traits()
    }

    pub const fn gap(&self) -> u64 {
        gap(self.h)
    }

    /// The gap of a silence that begins then. A frame that no ECU sent may report the slowest rate, which applies until the ECU reports its
    /// own again.
    pub fn gap_from(&self, from_us: u64) -> u64 {
        const SLOWEST: u64 = 50 * MS;
        let before = from_us.saturating_sub(SECOND)..from_us + self.gap();
        let forged = self.traits().rounds && self.h.forged.iter().any(|at| before.contains(at));
        if forged { self.gap().max(gap_at(SLOWEST)) } else { self.gap() }
    }

    /// The silences that are gaps.
    pub fn gaps(&self) -> Spans {
        let gaps = self.blind.iter().filter(|(from, to)| to - from >= self.gap_from(*from));
        Spans::from(&gaps.collect::<Vec<_>>())
    }

    /// A silence of the node after which an AMT ECU's order is certainly still in force.
    pub const fn order_outlasts(&self) -> u64 {
        self.h.rules.serial_delay.saturating_sub(500 * MS)
    }

    pub fn two_states(&self) -> u64 {
        two_states(self.h)
    }

    /// The longest time until the next report of the engine's state.
    pub fn one_state(&self) -> u64 {
        let rules = &self.h.rules;
        // AMT sends a set without a state now and then. A frame was decided a slot before it began.
        let reports = 1 + rules.stale;
        if !self.traits().rounds {
            (reports + 1) * rules.period + 150 * MS
        } else {
            reports * self.h.rounds().1 * rules.period + 2 * rules.period + 150 * MS
        }
    }

    /// Each instant at which the node had to start over with the engine: its ECU was powered up, or the line came back after
    /// a gap.
    pub fn starts_of_life(&self) -> Vec<u64> {
        // AMT reports it at each power-up; on ZK an outage that is shorter than a gap cannot be detected.
        let powered = self.h.unpowered.iter().filter(|_| self.traits().reports_power_up).map(|(_, to)| to);
        let mut all: Vec<u64> = powered.collect();
        all.extend(self.blind.at_least(self.gap()).iter().map(|(_, to)| to));
        all.sort_unstable();
        all
    }

    pub fn is_idle(&self, demanded: Demanded) -> bool {
        self.h.rules.is_idle(demanded)
    }

    /// Time in which two values arrive that are both from it.
    pub fn two_values(&self) -> u64 {
        let rules = &self.h.rules;
        if self.traits().rounds {
            2 * self.h.rounds().1 * rules.period + 200 * MS
        } else {
            // A set without values arrives now and then.
            4 * rules.period + 50 * MS
        }
    }

    /// The same for two reports of the supply.
    pub fn two_supplies(&self) -> u64 {
        match self.traits().supply_every {
            0 => self.two_values(),
            every => 2 * every * self.h.rules.period + 300 * MS,
        }
    }

    /// The times in which nothing leaves the node, because its transmitter hangs.
    pub fn stalled(&self) -> Spans {
        // A reset frees it, too.
        let opened = |to| self.h.reopened.iter().flatten().any(|up| *up == to);
        let freed = |to| opened(to) || self.h.resets.iter().any(|reset| reset.up == to);
        let stalled = self.h.deaf.iter().filter(|(_, to)| self.h.stalls.contains(to) || freed(*to));
        Spans::from(&stalled.collect::<Vec<_>>())
    }
}

/// A silence of the ECU that a node must detect: three expected frames, the slot after them, and what is being sent.
pub const fn gap(h: &History) -> u64 {
    gap_at(h.rules.period)
}

const fn gap_at(period: u64) -> u64 {
    4 * period + period / 2 + 20 * MS
}

/// The longest time in which the engine's state is reported twice.
pub fn two_states(h: &History) -> u64 {
    let rules = &h.rules;
    let reports = 2 + rules.stale;
    if h.traits().rounds {
        reports * h.rounds().1 * rules.period + 400 * MS
    } else {
        (reports + 2) * rules.period + 300 * MS
    }
}

/// A start whose engine has not come to its idle speed yet.
pub const fn spins_up(phase: Phase) -> bool {
    matches!(phase, Phase::Ignition | Phase::Preheat | Phase::FuelRamp)
}

/// Above the fail-safe, by more than the resolution of the wire.
pub fn is_above_fail_safe(h: &History, demanded: Demanded) -> bool {
    match demanded {
        Demanded::Throttle(tenths) => tenths > h.rules.fail_safe + 8,
        Demanded::Rpm(rpm) => f64::from(rpm) > h.rules.idle_rpm + 0.006 * h.rules.max_rpm,
    }
}

/// When the turbine was between an ignition and its end. One that ended before the next sample counts, too.
fn live(h: &History) -> Spans {
    let begins = h.marks.iter().filter(|(_, mark)| matches!(mark, Mark::Ignition | Mark::Relight));
    let begins: Vec<(u64, u64)> = begins.map(|(at, _)| (*at, at + 60 * MS)).collect();
    h.times(|sample| sample.phase.is_live()).union(&Spans::from(&begins))
}

/// Seconds, for a reader.
pub fn seconds(at: u64) -> String {
    format!("{}.{:03} s", at / SECOND, at % SECOND / MS)
}
