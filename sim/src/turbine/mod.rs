//! A plausible single-spool turbine, with the start sequence common to all ECUs.
//!
//! It is a sketch, not a thermodynamic model: first-order lags around a steady state, chosen so
//! that the values and durations that an ECU reports are realistic. It advances in fixed steps of
//! 5 ms, so its behaviour depends only on the commands and their times, not on how often it is read.

mod history;
mod parameters;

use crate::ecu::{MILLIS, Nanos};

pub use self::history::{History, HotFuel};
pub use self::parameters::Parameters;

/// Duration of one step.
pub const STEP: Nanos = 5 * MILLIS;

const DT: f64 = 0.005;
const AMBIENT: f64 = 15.0;

/// Cooling ends, and a start may begin, below this EGT in °C.
pub const COOL_EGT: f64 = 100.0;

/// The curve setting for which [`Parameters::acceleration_s`] is given.
pub const NOMINAL_CURVE: u8 = 30;

/// Command to the turbine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// Fuel off at once, without cooling: a hot turbine stays hot.
    Stop,
    /// Fuel off, and cooling by the starter while it is hot.
    Standby,
    /// Start if it is at rest, keep running if it runs.
    Run,
}

/// Commanded speed. It only applies once the start is complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Demand {
    /// 0..=1000 from idle to maximum rpm; linear in rpm, which is an assumption.
    Throttle(u16),
    /// A speed in rpm, limited to idle..=maximum.
    Rpm(u32),
}

/// Phase of the turbine, between off and running.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Off; it may still be hot and turning.
    Stopped,
    /// Cool and ready.
    Standby,
    /// The starter turns it and the igniter heats; no combustion yet.
    Ignition,
    /// The start fuel burns.
    Preheat,
    /// The pump ramps up to idle.
    FuelRamp,
    /// Idle is held and measured.
    LearningIdle,
    /// It follows the demand.
    Running,
    /// The starter turns it until it is cool.
    Cooling,
}

impl Phase {
    /// Name, for people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Stopped => "stopped",
            Self::Standby => "standby",
            Self::Ignition => "ignition",
            Self::Preheat => "preheat",
            Self::FuelRamp => "fuel ramp",
            Self::LearningIdle => "learning idle",
            Self::Running => "running",
            Self::Cooling => "cooling",
        }
    }

    /// From the first turn of the starter to idle.
    pub const fn is_starting(self) -> bool {
        matches!(self, Self::Ignition | Self::Preheat | Self::FuelRamp | Self::LearningIdle)
    }

    /// Starting or running.
    pub const fn is_live(self) -> bool {
        self.is_starting() || matches!(self, Self::Running)
    }
}

/// Reason why the turbine stopped although it was commanded to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trip {
    /// It flamed out, and the speed fell below idle.
    FlameOut,
    /// The EGT exceeded its limit.
    OverTemperature,
    /// No ignition, although the igniter was on.
    NoLight,
    /// It did not reach idle in time.
    StartTimeout,
}

/// The exhaust gas temperature sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EgtSensor {
    /// It works.
    #[default]
    Good,
    /// Its wire is broken: it reads the top of its range.
    Open,
    /// Its wires are shorted: it reads the bottom of its range.
    Short,
    /// Its wires touch at the plug: it reads the temperature there.
    Cold,
}

/// A turbine, its fuel pump, its starter, and the part of an ECU that controls the start.
#[derive(Clone, Debug)]
pub struct Turbine {
    parameters: Parameters,
    stepped_to: Option<Nanos>,
    switch: Switch,
    demand: Demand,
    curve_up: u8,
    curve_down: u8,

    phase: Phase,
    phase_steps: u32,
    start_steps: u32,
    start_time_s: f64,
    lit: bool,
    trip: Option<Trip>,
    hot_steps: u32,

    rpm: f64,
    egt: f64,
    flow: f64,
    fuel_ml: f64,

    hot_start: bool,
    no_light: bool,
    bench_pump: bool,
    bench_starter: bool,
    starts_hot: bool,
    egt_sensor: EgtSensor,
    history: History,
}

impl Turbine {
    /// A cold turbine at rest.
    pub fn new(parameters: Parameters) -> Self {
        Self {
            parameters,
            stepped_to: None,
            switch: Switch::Stop,
            demand: Demand::Throttle(0),
            curve_up: NOMINAL_CURVE,
            curve_down: NOMINAL_CURVE,
            phase: Phase::Stopped,
            phase_steps: 0,
            start_steps: 0,
            start_time_s: 0.0,
            lit: false,
            trip: None,
            hot_steps: 0,
            rpm: 0.0,
            egt: AMBIENT,
            flow: 0.0,
            fuel_ml: 0.0,
            hot_start: false,
            no_light: false,
            bench_pump: false,
            bench_starter: false,
            starts_hot: false,
            egt_sensor: EgtSensor::Good,
            history: History::default(),
        }
    }

    /// Sets the command. A trip stays until [`Turbine::clear_trip`].
    pub fn set_switch(&mut self, switch: Switch) {
        self.switch = switch;
    }

    /// Sets the speed.
    pub fn set_demand(&mut self, demand: Demand) {
        self.demand = demand;
    }

    /// Acceleration and deceleration curve, 10..=70; the rates are proportional to them.
    pub fn set_curves(&mut self, up: u8, down: u8) {
        self.curve_up = up.clamp(10, 70);
        self.curve_down = down.clamp(10, 70);
    }

    /// Runs the fuel pump or the starter of a stopped turbine, as service commands do.
    pub fn set_bench(&mut self, pump: bool, starter: bool) {
        self.bench_pump = pump;
        self.bench_starter = starter;
    }

    /// Puts out the flame, if there is one.
    pub fn flame_out(&mut self) {
        self.lit = false;
    }

    /// Sets whether every start from now on is a hot start.
    pub fn hot_start(&mut self, hot: bool) {
        self.hot_start = hot;
    }

    /// Sets whether every start from now on fails to ignite.
    pub fn no_light(&mut self, dark: bool) {
        self.no_light = dark;
    }

    /// Sets whether a start may begin at any exhaust temperature and with a shaft that still turns, rather than only below
    /// [`COOL_EGT`].
    pub fn set_starts_hot(&mut self, hot: bool) {
        self.starts_hot = hot;
    }

    /// Begins a start now, at any temperature and speed, like an ECU that relights automatically.
    pub fn relight(&mut self) {
        self.trip = None;
        self.enter(Phase::Ignition);
        self.history.relights.extend(self.history.ignitions.last());
    }

    /// Sets the state of the exhaust gas temperature sensor.
    pub fn set_egt_sensor(&mut self, sensor: EgtSensor) {
        self.egt_sensor = sensor;
    }

    /// Ignitions, and fuel into a hot engine, since its creation.
    pub fn history(&self) -> &History {
        &self.history
    }

    /// Whether a command to run begins a start now.
    pub fn is_ready_to_start(&self) -> bool {
        match self.phase {
            Phase::Standby => true,
            Phase::Stopped | Phase::Cooling => self.starts_hot,
            _ => false,
        }
    }

    /// Allows the next start after a trip.
    pub fn clear_trip(&mut self) {
        self.trip = None;
    }

    /// Reason for its uncommanded shutdown.
    pub fn trip(&self) -> Option<Trip> {
        self.trip
    }

    /// The figures of this engine.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// Phase between off and running.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// The last command.
    pub fn switch(&self) -> Switch {
        self.switch
    }

    /// Shaft speed in rpm.
    pub fn rpm(&self) -> f64 {
        self.rpm
    }

    /// Exhaust gas temperature in °C.
    pub fn egt(&self) -> f64 {
        self.egt
    }

    /// Exhaust gas temperature in °C as read by its sensor, which may be far outside the range that can be reported.
    pub fn sensed_egt(&self) -> f64 {
        match self.egt_sensor {
            EgtSensor::Good => self.egt,
            EgtSensor::Open => 9999.0,
            EgtSensor::Short => -9999.0,
            EgtSensor::Cold => AMBIENT,
        }
    }

    /// Fuel flow in ml/min.
    pub fn fuel_flow(&self) -> f64 {
        self.flow
    }

    /// Fuel burnt since its creation or since [`Turbine::reset_fuel`], in ml.
    pub fn fuel_total(&self) -> f64 {
        self.fuel_ml
    }

    /// Resets the fuel counter.
    pub fn reset_fuel(&mut self) {
        self.fuel_ml = 0.0;
    }

    /// Voltage of the fuel pump in V, linear in the flow.
    pub fn pump_voltage(&self) -> f64 {
        let p = &self.parameters;
        if self.flow <= 0.0 {
            return 0.0;
        }
        let per_flow = (p.pump_max_v - p.pump_idle_v) / (p.flow_max - p.flow_idle);
        (p.pump_idle_v + (self.flow - p.flow_idle) * per_flow).clamp(0.2, p.pump_max_v)
    }

    /// Thrust in N: a power of the speed through the two published points.
    pub fn thrust(&self) -> f64 {
        let p = &self.parameters;
        if !self.lit {
            return 0.0;
        }
        let exponent = (p.thrust_max / p.thrust_idle).ln() / (p.max_rpm / p.idle_rpm).ln();
        p.thrust_max * (self.rpm / p.max_rpm).powf(exponent)
    }

    /// Current from the battery in A: electronics, pump, igniter, starter (assumed).
    pub fn current(&self) -> f64 {
        let igniter = if self.phase == Phase::Ignition { 3.0 } else { 0.0 };
        let starter = if self.starter_target() > 0.0 { 6.0 } else { 0.0 };
        0.3 + 0.5 * self.pump_voltage() + igniter + starter
    }

    /// Duration of the last completed start, in s.
    pub fn start_time(&self) -> f64 {
        self.start_time_s
    }

    /// Position of the speed between idle (0) and maximum (1).
    pub fn load(&self) -> f64 {
        self.parameters.load(self.rpm)
    }

    /// Advances it to this time. The first call sets the start of its time.
    pub fn advance_to(&mut self, now: Nanos) {
        let mut at = *self.stepped_to.get_or_insert(now);
        while at + STEP <= now {
            self.stepped_to = Some(at + STEP);
            self.step();
            if self.flow > 0.0 && !self.lit && !self.phase.is_live() && self.is_hot() {
                self.history.add_hot_fuel(at, at + STEP);
            }
            at += STEP;
        }
        self.stepped_to = Some(at);
    }

    fn step(&mut self) {
        self.phase_steps = self.phase_steps.saturating_add(1);
        if self.phase.is_starting() {
            self.start_steps += 1;
        }
        self.sequence();
        self.rotor_and_fire();
    }

    fn enter(&mut self, phase: Phase) {
        self.phase = phase;
        self.phase_steps = 0;
        match phase {
            Phase::Ignition => {
                self.start_steps = 0;
                self.history.ignitions.push(self.stepped_to.unwrap_or(0));
            }
            Phase::Preheat => {
                self.lit = true;
                self.history.light_offs.push(self.stepped_to.unwrap_or(0));
            }
            Phase::Running => self.start_time_s = f64::from(self.start_steps) * DT,
            Phase::Stopped | Phase::Standby | Phase::Cooling => self.lit = false,
            Phase::FuelRamp | Phase::LearningIdle => {}
        }
    }

    fn stop_because(&mut self, trip: Trip) {
        self.trip = Some(trip);
        self.enter(Phase::Cooling);
    }

    fn is_hot(&self) -> bool {
        self.egt >= COOL_EGT
    }

    fn sequence(&mut self) {
        let p = &self.parameters;
        let in_phase_s = f64::from(self.phase_steps) * DT;
        let may_start = self.switch == Switch::Run && self.trip.is_none();

        match self.switch {
            Switch::Stop if self.phase != Phase::Stopped => return self.enter(Phase::Stopped),
            Switch::Standby if self.phase.is_live() => return self.enter(Phase::Cooling),
            _ => {}
        }
        match self.phase {
            Phase::Stopped if self.switch == Switch::Stop => {}
            Phase::Stopped | Phase::Cooling if may_start && self.starts_hot => self.enter(Phase::Ignition),
            Phase::Stopped if self.is_hot() => self.enter(Phase::Cooling),
            Phase::Stopped => self.enter(Phase::Standby),
            Phase::Standby if may_start => self.enter(Phase::Ignition),
            Phase::Standby => {}
            Phase::Cooling if self.is_hot() => {}
            Phase::Cooling => self.enter(Phase::Standby),
            Phase::Ignition => {
                if in_phase_s >= p.ignition_s && self.rpm >= 0.8 * p.light_rpm && !self.no_light {
                    self.enter(Phase::Preheat);
                } else if in_phase_s >= p.ignition_s + 10.0 {
                    self.stop_because(Trip::NoLight);
                }
            }
            Phase::Preheat if in_phase_s >= p.preheat_s => self.enter(Phase::FuelRamp),
            Phase::Preheat => {}
            Phase::FuelRamp if self.rpm >= 0.99 * p.idle_rpm => self.enter(Phase::LearningIdle),
            Phase::FuelRamp if in_phase_s >= 3.0 * p.ramp_s => self.stop_because(Trip::StartTimeout),
            Phase::FuelRamp => {}
            Phase::LearningIdle if in_phase_s >= p.learn_s => self.enter(Phase::Running),
            Phase::LearningIdle => {}
            Phase::Running if !self.lit && self.rpm < 0.8 * p.idle_rpm => self.stop_because(Trip::FlameOut),
            Phase::Running => {}
        }
        if self.phase.is_live() {
            // One second above the limit, so that a single sample does not stop an engine.
            self.hot_steps = if self.egt > self.parameters.egt_limit { self.hot_steps + 1 } else { 0 };
            if f64::from(self.hot_steps) * DT > 1.0 {
                self.hot_steps = 0;
                self.stop_because(Trip::OverTemperature);
            }
        } else {
            self.hot_steps = 0;
        }
    }

    fn starter_target(&self) -> f64 {
        let p = &self.parameters;
        match self.phase {
            Phase::Ignition => p.light_rpm,
            Phase::Preheat => 1.6 * p.light_rpm,
            Phase::Cooling => p.cooling_rpm,
            Phase::Stopped | Phase::Standby if self.bench_starter => p.cooling_rpm,
            _ => 0.0,
        }
    }

    fn rotor_and_fire(&mut self) {
        let p = &self.parameters;
        let in_phase_s = f64::from(self.phase_steps) * DT;
        let span = p.max_rpm - p.idle_rpm;

        // Acceleration beyond the steady state, as a fraction of the nominal rate.
        let mut excess = 0.0;
        let rate = if self.lit && matches!(self.phase, Phase::LearningIdle | Phase::Running) {
            let target = match (self.phase, self.demand) {
                (Phase::Running, Demand::Throttle(permille)) => {
                    p.idle_rpm + span * f64::from(permille.min(1000)) / 1000.0
                }
                (Phase::Running, Demand::Rpm(rpm)) => f64::from(rpm).clamp(p.idle_rpm, p.max_rpm),
                _ => p.idle_rpm,
            };
            // A small turbine accelerates slowly near idle and quickly near its maximum.
            let nominal = span / p.acceleration_s * (0.45 + 1.2 * p.load(self.rpm));
            let up = nominal * f64::from(self.curve_up) / f64::from(NOMINAL_CURVE);
            let down = -1.3 * nominal * f64::from(self.curve_down) / f64::from(NOMINAL_CURVE);
            let rate = ((target - self.rpm) / 0.25).clamp(down, up);
            excess = rate / nominal;
            rate
        } else if self.lit && self.phase == Phase::FuelRamp {
            (p.idle_rpm - 1.6 * p.light_rpm) / p.ramp_s
        } else {
            let coast = -self.rpm / p.coast_s - 150.0;
            let starter = self.starter_target();
            if self.rpm < starter { (starter - self.rpm) / 1.2 } else { coast }
        };
        self.rpm = (self.rpm + rate * DT).max(0.0);

        let load = p.load(self.rpm);
        let (egt, egt_lag) = match self.phase {
            _ if !self.lit => (AMBIENT, if self.rpm > 1000.0 { p.cooling_s } else { 6.0 * p.cooling_s }),
            Phase::Preheat => (0.6 * p.egt_idle, 2.5),
            // A start is hottest halfway up, with much fuel and little air.
            Phase::FuelRamp if self.hot_start => (p.egt_limit + 150.0, 2.0),
            Phase::FuelRamp => (1.15 * p.egt_idle, 3.0),
            _ => {
                let steady = p.egt_idle + (p.egt_max - p.egt_idle) * load * load
                    - 30.0 * (core::f64::consts::PI * load).sin();
                ((steady + 80.0 * excess).min(p.egt_limit - 20.0), 1.2)
            }
        };
        self.egt += (egt - self.egt) * DT / egt_lag;

        self.flow = match self.phase {
            Phase::Stopped | Phase::Standby | Phase::Cooling if self.bench_pump => 0.5 * p.flow_idle,
            Phase::Preheat => 0.25 * p.flow_idle,
            Phase::FuelRamp => p.flow_idle * (0.3 + 0.6 * in_phase_s / p.ramp_s).min(0.9),
            Phase::LearningIdle | Phase::Running => {
                let steady = p.flow_idle + (p.flow_max - p.flow_idle) * (0.4 * load + 0.6 * load * load);
                (steady * (1.0 + 0.15 * excess)).clamp(0.5 * p.flow_idle, p.flow_max)
            }
            _ => 0.0,
        };
        self.fuel_ml += self.flow * DT / 60.0;
    }
}

#[cfg(test)]
mod tests;
