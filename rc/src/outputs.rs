//! Fuel valve, and power of starter and ignition, of one engine: a state machine over its telemetry and its retained state.
//!
//! An output that is not energised is safe: a valve without power is closed, and a starter without power does not turn. *In
//! doubt an output stays as it is*: a healthy engine loses neither fuel nor power because a report is missing.

use crate::settings::OutputSettings;
use embassy_time::{Duration, Instant};
use jetlink::command::{Order, Origin};
use jetlink::engine::OBEY_GRACE;
use jetlink::engine::retained::RetainedState;
use jetlink::report::{LinkState, Phase};
use jetlink::telemetry::Telemetry;
use jetlink::units::Celsius;

/// Fall of the exhaust temperature that shows cooling, in 0.1 °C.
const EGT_FALL: i16 = 200;
/// Exhaust temperature at which an engine is cold.
const COLD: Celsius = Celsius::from_tenths(1000);
/// Exhaust temperature at which nothing burns: while the ECU cools the engine, its starter may turn it at a constant speed.
const COOLED: Celsius = Celsius::from_tenths(2000);
/// Exhaust temperature below which a report is wrong.
const COLDEST: Celsius = Celsius::from_tenths(-400);
/// Time for which an engine has to be reported cold until its starter is no longer needed.
const COLD_FOR: Duration = Duration::from_secs(3);

/// Fuel valve.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Valve {
    /// Not energised: no fuel.
    Closed,
    /// Energised.
    Open,
}

/// Reason for the state of an output.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Why {
    /// As recorded before a reset.
    Retained,
    /// After a reset, no record calls for it.
    NotRecorded,
    /// The firmware failed in repeated starts with the valve open.
    FailedStarts,
    /// An emergency stop is latched.
    StopLatched,
    /// The engine is ordered to run.
    Ordered,
    /// The ECU reports that the engine runs.
    Lives,
    /// A service that moves fuel is permitted.
    Service,
    /// Such a service has ended.
    ServiceOver,
    /// The ECU reports an engine at rest.
    AtRest,
    /// The ECU reports that it does not follow an order of standby.
    NotObeyed,
    /// Standby is ordered, and nothing is received.
    NotReceived,
    /// Standby is ordered, and the engine does not slow down.
    KeepsRunning,
    /// Standby is ordered, and the ECU reports that it cools an engine that is no longer hot.
    Cools,
    /// The engine is armed.
    Armed,
    /// The ECU reports that the engine starts, runs or cools.
    Busy,
    /// The ECU reports an engine that is cold and at rest.
    Cold,
}

impl Why {
    /// The reason, for people.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Retained => "as recorded before the reset",
            Self::NotRecorded => "no record of a running engine",
            Self::FailedStarts => "the firmware failed in repeated starts",
            Self::StopLatched => "emergency stop",
            Self::Ordered => "the engine is ordered to run",
            Self::Lives => "the ECU reports a running engine",
            Self::Service => "a service is permitted",
            Self::ServiceOver => "the service is over",
            Self::AtRest => "the engine is at rest",
            Self::NotObeyed => "the ECU does not obey standby",
            Self::NotReceived => "standby, and the ECU is not received",
            Self::KeepsRunning => "standby, and the engine does not slow down",
            Self::Cools => "the ECU cools the engine",
            Self::Armed => "the engine is armed",
            Self::Busy => "the ECU starts, runs or cools the engine",
            Self::Cold => "the engine is cold and at rest",
        }
    }

    /// Whether it closes the valve of an engine that may still run.
    pub const fn is_alarming(self) -> bool {
        matches!(self, Self::FailedStarts | Self::NotObeyed | Self::NotReceived | Self::KeepsRunning)
    }
}

/// An output that changed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Change {
    /// The fuel valve.
    Valve(Valve, Why),
    /// The power of starter and ignition.
    Power(bool, Why),
}

impl Change {
    /// The output and what it does now, for people.
    pub const fn what(self) -> &'static str {
        match self {
            Self::Valve(Valve::Open, _) => "fuel valve open",
            Self::Valve(Valve::Closed, _) => "fuel valve closed",
            Self::Power(true, _) => "starter and ignition on",
            Self::Power(false, _) => "starter and ignition off",
        }
    }

    /// Why.
    pub const fn why(self) -> Why {
        match self {
            Self::Valve(_, why) | Self::Power(_, why) => why,
        }
    }
}

impl core::fmt::Display for Change {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{}: {}", self.what(), self.why().text())
    }
}

/// Lowest values reported since an order of standby.
#[derive(Clone, Copy, Debug)]
struct Least {
    rpm: Option<u32>,
    /// Exhaust temperature in 0.1 °C.
    egt: Option<i16>,
    since: Instant,
}

impl Least {
    /// Whether the engine has slowed down since: its shaft by a tenth, or its exhaust by 20 °C.
    fn has_fallen(&self, rpm: Option<u32>, egt: Option<i16>) -> bool {
        let slower = self.rpm.zip(rpm).is_some_and(|(least, rpm)| rpm < least - least / 10);
        slower || self.egt.zip(egt).is_some_and(|(least, egt)| egt < least.saturating_sub(EGT_FALL))
    }
}

/// Outputs of one engine.
#[derive(Clone, Copy, Debug)]
pub struct Outputs {
    pub(crate) settings: OutputSettings,
    valve: Valve,
    power: bool,
    /// The firmware failed in repeated starts: the valve stays closed until the engine is at rest or is started again.
    cut: bool,
    /// A run in force was found, not started here: no standby came before it.
    found: bool,
    /// The valve was opened for a service during the standby that is still in force.
    for_service: bool,
    /// Time since which an order of standby has not been followed.
    not_followed_since: Option<Instant>,
    /// Lowest values of an engine that turns under an order of standby.
    least: Option<Least>,
    /// Time since which all reports have been of an engine that is cold and at rest, with no order to run.
    cold_since: Option<Instant>,
}

/// What is known of an engine from before a reset of the node.
#[derive(Clone, Copy, Debug, Default)]
pub struct Before {
    /// Its record: [`jetlink::engine::retained::RetainedMemory::load`].
    pub record: Option<RetainedState>,
    /// Whether starter and ignition had power ([`Before::power`]); `None`: it is not known.
    pub power: Option<bool>,
    /// The firmware has failed in repeated starts ([`crate::starts`]).
    pub has_failed: bool,
}

impl Before {
    /// The number to retain for the power of an engine with this fingerprint ([`jetlink::config::EngineConfig::fingerprint`]).
    pub const fn number(fingerprint: u32, power: bool) -> u32 {
        if power { fingerprint } else { !fingerprint }
    }

    /// The power of the engine with this fingerprint, from the number that was retained. `None`: it was lost, or is another engine's.
    pub fn power(fingerprint: u32, number: Option<u32>) -> Option<bool> {
        [true, false].into_iter().find(|power| number == Some(Self::number(fingerprint, *power)))
    }
}

impl Outputs {
    /// The outputs after a reset. Drive the pins ([`crate::wiring::OutputConfig::levels`]) before anything else.
    ///
    /// The valve is open only if the record says that the engine runs and that nothing stops it, and the firmware has not failed in
    /// repeated starts. A start in progress does not count: the engine ends it. The power stays as it was: only reports of a cold engine
    /// turn it off; a reset does not. The record of an armed engine turns it on; so does that of one that ran or was stopped, where it is not
    /// known.
    pub fn new(settings: OutputSettings, before: Before) -> Self {
        let Before { record, power, has_failed } = before;
        let runs = record.is_some_and(|record| {
            record.ran && !matches!(record.order, Order::EmergencyStop | Order::Standby)
        });
        let armed = record.is_some_and(|record| record.armed);
        // An engine that was stopped may be hot.
        let needed = record.is_some_and(|record| record.ran || record.order == Order::EmergencyStop);
        Self {
            settings,
            valve: if runs && !has_failed { Valve::Open } else { Valve::Closed },
            power: armed || power.unwrap_or(needed),
            cut: runs && has_failed,
            found: true,
            for_service: false,
            not_followed_since: None,
            least: None,
            cold_since: None,
        }
    }

    /// The outputs after a reset, as changes.
    pub fn restored(&self) -> [Change; 2] {
        let why = |on| if on { Why::Retained } else { Why::NotRecorded };
        let of_valve = if self.cut { Why::FailedStarts } else { why(self.valve == Valve::Open) };
        [Change::Valve(self.valve, of_valve), Change::Power(self.power, why(self.power))]
    }

    /// Whether the valve is closed because the firmware failed in repeated starts, until the engine is at rest or is started again.
    pub const fn is_cut(&self) -> bool {
        self.cut
    }

    /// Takes stored settings, before the first update.
    pub const fn configure(&mut self, settings: OutputSettings) {
        self.settings = settings;
    }

    /// The valve.
    pub const fn valve(&self) -> Valve {
        self.valve
    }

    /// Whether starter and ignition have power.
    pub const fn power(&self) -> bool {
        self.power
    }

    /// Follows the engine, and returns what changed. Call it at every snapshot of its telemetry, and ten times a second: its timeouts
    /// have no other clock.
    pub fn update(&mut self, telemetry: &Telemetry) -> [Option<Change>; 2] {
        let decided = self.decide_valve(telemetry).filter(|(valve, _)| *valve != self.valve);
        if let Some((valve, _)) = decided {
            self.valve = valve;
        }
        let valve = decided.map(|(valve, why)| Change::Valve(valve, why));
        let decided = self.decide_power(telemetry).filter(|(power, _)| *power != self.power);
        if let Some((power, _)) = decided {
            self.power = power;
        }
        let power = decided.map(|(power, why)| Change::Power(power, why));
        [valve, power]
    }

    /// `None`: it stays as it is.
    fn decide_valve(&mut self, telemetry: &Telemetry) -> Option<(Valve, Why)> {
        let order = telemetry.ordered.order;
        let not_followed = self.not_followed(telemetry);
        self.for_service &= order == Order::Standby;
        match order {
            Order::Listen => self.found = true,
            Order::Standby | Order::EmergencyStop => self.found = false,
            Order::Run(_) | Order::Doubt(_) | Order::Pwm => {}
        }
        let is_started = !self.found && is_started(telemetry);
        // A flame that is out gets no fuel until somebody starts the engine again.
        let stopped = matches!(order, Order::Standby | Order::EmergencyStop);
        self.cut &= !(stopped && is_at_rest(telemetry) || is_started);
        let closed = |why| Some((Valve::Closed, why));
        let open = |why| Some((Valve::Open, why));
        if telemetry.stop_latched {
            return closed(Why::StopLatched);
        }
        if self.cut {
            return closed(Why::FailedStarts);
        }
        match order {
            Order::EmergencyStop => closed(Why::StopLatched),
            // A start found after a reset: a hot engine whose fuel was cut meanwhile gets none again, whoever takes it over.
            Order::Run(_) if telemetry.start_by.is_some() && !is_started => None,
            // A run is in force only after a permitted start, or because the engine lives.
            Order::Run(_) | Order::Pwm => open(Why::Ordered),
            // Standby opens the valve only for a service: an engine that still turns is being shut down.
            Order::Standby if telemetry.fuel_service => {
                self.for_service = true;
                open(Why::Service)
            }
            // The ECU may continue a service on its own clock.
            Order::Standby if self.for_service && telemetry.shaft_turns() != Some(true) => {
                closed(Why::ServiceOver)
            }
            Order::Standby if is_at_rest(telemetry) => closed(Why::AtRest),
            Order::Standby => not_followed.and_then(closed),
            Order::Listen | Order::Doubt(_) if lives(telemetry) => open(Why::Lives),
            Order::Listen | Order::Doubt(_) => None,
        }
    }

    /// Whether standby has not been followed for too long: the ECU reports that it does something else or, where a source has
    /// commanded standby, reports nothing at all. Or the engine does not slow down, whatever the ECU reports.
    fn not_followed(&mut self, telemetry: &Telemetry) -> Option<Why> {
        let reported = self.not_reported(telemetry);
        let turning = self.keeps_running(telemetry);
        reported.or(turning)
    }

    fn not_reported(&mut self, telemetry: &Telemetry) -> Option<Why> {
        let ordered = telemetry.ordered;
        // The node also orders standby in doubt: then silence proves nothing, unless nothing was received since its start.
        let meant = ordered.origin != Origin::Node || telemetry.last_rx.is_none();
        let not_received = meant && phase(telemetry).is_none();
        let obeyed = telemetry.obeyed || telemetry.link != LinkState::Up;
        if ordered.order != Order::Standby || obeyed && !not_received {
            self.not_followed_since = None;
            return None;
        }
        let since = *self.not_followed_since.get_or_insert(telemetry.at);
        let after: Duration = self.settings.not_obeyed?;
        let why = if obeyed { Why::NotReceived } else { Why::NotObeyed };
        (telemetry.at.saturating_duration_since(since) >= after).then_some(why)
    }

    /// An ECU may echo the switch that is sent to it and keep its engine running.
    fn keeps_running(&mut self, telemetry: &Telemetry) -> Option<Why> {
        let up = telemetry.link == LinkState::Up;
        let rpm = telemetry.current(telemetry.report.rpm).filter(|_| up).map(|rpm| rpm.get());
        let egt = telemetry.current(telemetry.report.egt).filter(|_| up).map(Celsius::tenths);
        let turns = telemetry.shaft_turns().filter(|_| up);
        // Without a shaft speed the exhaust decides.
        let may_run = turns.unwrap_or(egt.is_some_and(|egt| egt > COLD.tenths()));
        // An order of the node itself, in doubt, proves nothing about an ECU that does not report its state.
        let meant = telemetry.ordered.origin != Origin::Node || phase(telemetry).is_some();
        if telemetry.ordered.order != Order::Standby || !may_run || !meant {
            self.least = None;
            return None;
        }
        let now = Least { rpm, egt, since: telemetry.at };
        let least = self.least.get_or_insert(now);
        if least.has_fallen(rpm, egt) {
            *least = now;
        }
        // Values that were not reported before.
        least.rpm = least.rpm.or(rpm);
        least.egt = least.egt.or(egt);
        let since = least.since;
        let after = OBEY_GRACE.checked_add(self.settings.not_obeyed?)?;
        let cools = phase(telemetry) == Some(Phase::Cooling)
            && egt.is_some_and(|egt| (COLDEST.tenths()..=COOLED.tenths()).contains(&egt));
        let why = if cools { Why::Cools } else { Why::KeepsRunning };
        (telemetry.at.saturating_duration_since(since) >= after).then_some(why)
    }

    /// `None`: it stays as it is.
    fn decide_power(&mut self, telemetry: &Telemetry) -> Option<(bool, Why)> {
        let ordered = matches!(telemetry.ordered.order, Order::Run(_) | Order::Doubt(_) | Order::Pwm);
        let cold = self.has_been_cold(telemetry, ordered);
        // Also after a reset that has lost the arming: the starter cools a hot turbine.
        let busy = matches!(phase(telemetry), Some(Phase::Starting | Phase::Running | Phase::Cooling));
        match () {
            () if telemetry.armed => Some((true, Why::Armed)),
            () if ordered => Some((true, Why::Ordered)),
            () if busy => Some((true, Why::Busy)),
            () if cold => Some((false, Why::Cold)),
            () => None,
        }
    }

    /// Whether the ECU has reported an engine that is cold and at rest for long enough: once off, nothing restores the power of a hot
    /// one. An order to run restarts this time: a start may end before the ECU has reported it.
    fn has_been_cold(&mut self, telemetry: &Telemetry, ordered: bool) -> bool {
        let Some(at) = cold_and_at_rest(telemetry).filter(|_| !ordered) else {
            self.cold_since = None;
            return false;
        };
        // Counted by reports: a single one is not enough, however long it stays current.
        at.saturating_duration_since(*self.cold_since.get_or_insert(telemetry.at)) >= COLD_FOR
    }
}

fn phase(telemetry: &Telemetry) -> Option<Phase> {
    telemetry.current(telemetry.report.phase).filter(|_| telemetry.link == LinkState::Up)
}

/// Whether a start commanded by a source is in progress: the node itself starts none. It may have been found.
fn is_started(telemetry: &Telemetry) -> bool {
    let runs = matches!(telemetry.ordered.order, Order::Run(_));
    runs && telemetry.start_by.is_some() && telemetry.ordered.origin != Origin::Node
}

/// The ECU reports an engine at rest that does not turn.
fn is_at_rest(telemetry: &Telemetry) -> bool {
    let at_rest = matches!(phase(telemetry), Some(Phase::Stopped | Phase::Standby | Phase::Cooling));
    at_rest && telemetry.shaft_turns() != Some(true)
}

/// The ECU reports an engine that runs and turns.
fn lives(telemetry: &Telemetry) -> bool {
    phase(telemetry) == Some(Phase::Running) && telemetry.shaft_turns() != Some(false)
}

/// Time of the report of the exhaust temperature, if the ECU reports an engine that is cold and at rest.
fn cold_and_at_rest(telemetry: &Telemetry) -> Option<Instant> {
    let at_rest = matches!(phase(telemetry), Some(Phase::Stopped | Phase::Standby));
    let egt = telemetry.report.egt.filter(|_| at_rest && telemetry.shaft_turns() != Some(true))?;
    telemetry.current(Some(egt)).filter(|egt| (COLDEST..=COLD).contains(egt)).map(|_| egt.at)
}
