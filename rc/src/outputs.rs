//! Fuel valve, and power of starter and ignition, of one engine: a state machine over its telemetry and its retained state.
//!
//! An output that is not energised is safe: a valve without power is closed, and a starter without power does not turn. *In
//! doubt an output stays as it is*: a healthy engine loses neither fuel nor power because a report is missing.

use crate::settings::OutputSettings;
use embassy_time::{Duration, Instant};
use jetlink::command::{Order, Origin};
use jetlink::engine::retained::RetainedState;
use jetlink::report::{LinkState, Phase};
use jetlink::telemetry::Telemetry;
use jetlink::units::Celsius;

/// Exhaust temperature at which an engine is cold.
const COLD: Celsius = Celsius::from_tenths(1000);

/// Fuel valve.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Valve {
    /// Not energised: no fuel.
    Closed,
    /// Energised.
    Open,
}

/// Outputs of one engine.
#[derive(Clone, Copy, Debug)]
pub struct Outputs {
    pub(crate) settings: OutputSettings,
    valve: Valve,
    power: bool,
    /// The valve was opened for a service, in the standby that is still in force.
    for_service: bool,
    /// Time since which an order of standby has not been followed.
    not_followed_since: Option<Instant>,
}

impl Outputs {
    /// The outputs after a reset, from the engine's retained state: [`jetlink::engine::retained::RetainedMemory::load`]. Drive the pins
    /// ([`crate::wiring::OutputConfig::levels`]) before anything else.
    ///
    /// The valve is open only if the record says that the engine runs and that nothing stops it. A start that was under way is
    /// none: the engine ends it.
    pub fn new(settings: OutputSettings, retained: Option<RetainedState>) -> Self {
        let runs = retained.is_some_and(|record| {
            record.ran && !matches!(record.order, Order::EmergencyStop | Order::Standby)
        });
        // An engine that was stopped may be hot.
        let powered =
            retained.is_some_and(|record| record.armed || record.ran || record.order == Order::EmergencyStop);
        Self {
            settings,
            valve: if runs { Valve::Open } else { Valve::Closed },
            power: powered,
            for_service: false,
            not_followed_since: None,
        }
    }

    /// The valve.
    pub const fn valve(&self) -> Valve {
        self.valve
    }

    /// Whether starter and ignition have power.
    pub const fn power(&self) -> bool {
        self.power
    }

    /// Follows the engine. Call it at every snapshot of its telemetry, and ten times a second: a wait has no other clock.
    pub fn update(&mut self, telemetry: &Telemetry) {
        if let Some(valve) = self.decide_valve(telemetry) {
            self.valve = valve;
        }
        let ordered = matches!(telemetry.ordered.order, Order::Run(_) | Order::Doubt(_) | Order::Pwm);
        // Also after a reset that has lost what was armed: the starter cools a hot turbine.
        let busy = matches!(phase(telemetry), Some(Phase::Starting | Phase::Running | Phase::Cooling));
        if telemetry.armed || ordered || busy {
            self.power = true;
        } else if is_cold_and_at_rest(telemetry) {
            self.power = false;
        }
    }

    /// `None`: it stays as it is.
    fn decide_valve(&mut self, telemetry: &Telemetry) -> Option<Valve> {
        let order = telemetry.ordered.order;
        let not_followed = self.not_followed(telemetry);
        self.for_service &= order == Order::Standby;
        if telemetry.stop_latched {
            return Some(Valve::Closed);
        }
        match order {
            Order::EmergencyStop => Some(Valve::Closed),
            // A start that was found after a reset: what was cut meanwhile is not given to a hot engine again.
            Order::Run(_) if telemetry.start_by.is_some() && telemetry.ordered.origin == Origin::Node => None,
            // A run is in force only by a permitted start, or because the engine lives.
            Order::Run(_) | Order::Pwm => Some(Valve::Open),
            // Standby never opens it for an engine: what still turns is being shut down.
            Order::Standby if telemetry.fuel_service => {
                self.for_service = true;
                Some(Valve::Open)
            }
            // The ECU may go on with a service by its own clock.
            Order::Standby if self.for_service && telemetry.shaft_turns() != Some(true) => {
                Some(Valve::Closed)
            }
            Order::Standby if is_at_rest(telemetry) || not_followed => Some(Valve::Closed),
            Order::Listen | Order::Doubt(_) if lives(telemetry) => Some(Valve::Open),
            Order::Standby | Order::Listen | Order::Doubt(_) => None,
        }
    }

    /// Whether standby has not been followed for too long: the ECU reports that it does something else or, where a source has
    /// commanded standby, reports nothing at all.
    fn not_followed(&mut self, telemetry: &Telemetry) -> bool {
        let ordered = telemetry.ordered;
        // The node orders standby in doubt, too: then nothing is concluded from silence, unless nothing came since its start.
        let meant = ordered.origin != Origin::Node || telemetry.last_rx.is_none();
        let not_received = meant && phase(telemetry).is_none();
        let obeyed = telemetry.obeyed || telemetry.link != LinkState::Up;
        if ordered.order != Order::Standby || obeyed && !not_received {
            self.not_followed_since = None;
            return false;
        }
        let since = *self.not_followed_since.get_or_insert(telemetry.at);
        let after: Option<Duration> = self.settings.not_obeyed;
        after.is_some_and(|after| telemetry.at.saturating_duration_since(since) >= after)
    }
}

fn phase(telemetry: &Telemetry) -> Option<Phase> {
    telemetry.current(telemetry.report.phase).filter(|_| telemetry.link == LinkState::Up)
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

fn is_cold_and_at_rest(telemetry: &Telemetry) -> bool {
    let at_rest = matches!(phase(telemetry), Some(Phase::Stopped | Phase::Standby));
    let cold = telemetry.current(telemetry.report.egt).is_some_and(|egt| egt <= COLD);
    at_rest && cold && telemetry.shaft_turns() != Some(true)
}
