//! The figures of the engines, and where they come from.

/// Kerosene, g per ml: the makers print g/min, the ECUs report volumes.
const DENSITY: f64 = 0.8;

/// The figures of one engine.
///
/// **Published**: for Mercury, Pegasus and Olympus the speeds (at rated thrust and at idle), both
/// thrusts, the normal and the maximum EGT and the fuel consumption are those of AMT Netherlands'
/// table, as quoted with its source at <http://barnardmicrosystems.com/UAV/engines/turbine.html>.
/// The 160 000 rpm of [`Parameters::ZK_160K`] are those of the second status example in the
/// ZK-Protocol document.
///
/// **Commonly given but not checked against the maker's sheet**: all figures of
/// [`Parameters::TITAN`] in these same fields.
///
/// **Assumed**: everything else, that is all other figures of the ZK engine, the EGT and flow at
/// idle, the pump voltages, and all times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Name of the engine.
    pub name: &'static str,
    /// Speed at idle, rpm.
    pub idle_rpm: f64,
    /// Speed at full throttle, rpm.
    pub max_rpm: f64,
    /// Thrust at idle, N.
    pub thrust_idle: f64,
    /// Thrust at full throttle, N.
    pub thrust_max: f64,
    /// EGT at idle, °C.
    pub egt_idle: f64,
    /// Normal EGT at full throttle, °C.
    pub egt_max: f64,
    /// EGT above which the ECU stops the engine, °C.
    pub egt_limit: f64,
    /// Fuel flow at idle, ml/min.
    pub flow_idle: f64,
    /// Fuel flow at full throttle, ml/min.
    pub flow_max: f64,
    /// Pump voltage at idle, V.
    pub pump_idle_v: f64,
    /// Pump voltage at full throttle, V.
    pub pump_max_v: f64,
    /// Speed at which the start fuel is lit, rpm.
    pub light_rpm: f64,
    /// Speed of the starter while cooling, rpm.
    pub cooling_rpm: f64,
    /// Time from the first turn to the flame, s.
    pub ignition_s: f64,
    /// Time from the flame to the ramp, s.
    pub preheat_s: f64,
    /// Duration of the ramp to idle, s.
    pub ramp_s: f64,
    /// Time at idle before the throttle is obeyed, s.
    pub learn_s: f64,
    /// Time from idle to full throttle at the nominal curve, s (approximate).
    pub acceleration_s: f64,
    /// Time constant of the rotor without combustion, s.
    pub coast_s: f64,
    /// Time constant of the EGT while air flows, s.
    pub cooling_s: f64,
}

impl Parameters {
    /// AMT Olympus: 230 N at 108 500 rpm.
    pub const OLYMPUS: Self = Self {
        name: "Olympus",
        idle_rpm: 36_000.0,
        max_rpm: 108_500.0,
        thrust_idle: 8.0,
        thrust_max: 230.0,
        egt_idle: 520.0,
        egt_max: 700.0,
        egt_limit: 750.0,
        flow_idle: 140.0,
        flow_max: 640.0 / DENSITY,
        pump_idle_v: 1.3,
        pump_max_v: 6.2,
        light_rpm: 6_000.0,
        cooling_rpm: 4_000.0,
        ignition_s: 4.0,
        preheat_s: 5.0,
        ramp_s: 14.0,
        learn_s: 3.0,
        acceleration_s: 4.0,
        coast_s: 4.0,
        cooling_s: 25.0,
    };

    /// AMT Titan: 392 N at 96 000 rpm.
    pub const TITAN: Self = Self {
        name: "Titan",
        idle_rpm: 30_000.0,
        max_rpm: 96_000.0,
        thrust_idle: 12.0,
        thrust_max: 392.0,
        egt_idle: 540.0,
        egt_max: 750.0,
        egt_limit: 870.0,
        flow_idle: 220.0,
        flow_max: 980.0 / DENSITY,
        pump_idle_v: 1.4,
        pump_max_v: 7.0,
        light_rpm: 5_000.0,
        cooling_rpm: 3_500.0,
        ramp_s: 18.0,
        acceleration_s: 5.0,
        coast_s: 5.0,
        cooling_s: 30.0,
        ..Self::OLYMPUS
    };

    /// AMT Mercury: 88 N at 151 200 rpm.
    pub const MERCURY: Self = Self {
        name: "Mercury",
        idle_rpm: 47_600.0,
        max_rpm: 151_200.0,
        thrust_idle: 4.0,
        thrust_max: 88.0,
        egt_idle: 500.0,
        egt_max: 650.0,
        egt_limit: 750.0,
        flow_idle: 80.0,
        flow_max: 290.0 / DENSITY,
        pump_idle_v: 1.0,
        pump_max_v: 4.5,
        light_rpm: 8_000.0,
        cooling_rpm: 5_000.0,
        ramp_s: 12.0,
        acceleration_s: 3.5,
        coast_s: 3.0,
        cooling_s: 20.0,
        ..Self::OLYMPUS
    };

    /// AMT Pegasus: 167 N at 119 500 rpm.
    pub const PEGASUS: Self = Self {
        name: "Pegasus",
        idle_rpm: 37_000.0,
        max_rpm: 119_500.0,
        thrust_idle: 6.0,
        thrust_max: 167.0,
        egt_idle: 480.0,
        egt_max: 600.0,
        egt_limit: 675.0,
        flow_idle: 110.0,
        flow_max: 450.0 / DENSITY,
        pump_idle_v: 1.1,
        pump_max_v: 5.0,
        ..Self::OLYMPUS
    };

    /// A small engine with a ZK ECU: 160 000 rpm at most.
    pub const ZK_160K: Self = Self {
        name: "ZK 160k",
        idle_rpm: 50_000.0,
        max_rpm: 160_000.0,
        thrust_idle: 3.5,
        thrust_max: 80.0,
        egt_idle: 480.0,
        egt_max: 680.0,
        egt_limit: 800.0,
        flow_idle: 75.0,
        flow_max: 300.0,
        pump_idle_v: 0.9,
        pump_max_v: 4.8,
        light_rpm: 8_000.0,
        cooling_rpm: 5_000.0,
        ignition_s: 3.5,
        preheat_s: 4.0,
        ramp_s: 12.0,
        learn_s: 2.5,
        acceleration_s: 3.0,
        coast_s: 3.0,
        cooling_s: 20.0,
    };

    /// The same turbine with a start of this duration: for tests, which need not wait for a real one.
    #[must_use]
    pub fn starting_in(self, seconds: f64) -> Self {
        Self {
            ignition_s: 0.15 * seconds,
            preheat_s: 0.2 * seconds,
            ramp_s: 0.5 * seconds,
            learn_s: 0.15 * seconds,
            ..self
        }
    }

    /// Position of a speed between idle (0) and maximum (1).
    pub fn load(&self, rpm: f64) -> f64 {
        ((rpm - self.idle_rpm) / (self.max_rpm - self.idle_rpm)).clamp(0.0, 1.0)
    }
}
