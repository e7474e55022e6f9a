//! The turbine alone: it starts, follows, cools and fails as the ECUs expect.

use super::*;
use crate::ecu::SECOND;

const ALL: [Parameters; 5] =
    [Parameters::OLYMPUS, Parameters::TITAN, Parameters::MERCURY, Parameters::PEGASUS, Parameters::ZK_160K];

struct Bench {
    turbine: Turbine,
    now: Nanos,
}

impl Bench {
    fn new(parameters: Parameters) -> Self {
        let mut turbine = Turbine::new(parameters);
        turbine.advance_to(0);
        Self { turbine, now: 0 }
    }

    fn wait_s(&mut self, seconds: f64) -> &mut Turbine {
        self.now += (seconds * 1e9) as Nanos;
        self.turbine.advance_to(self.now);
        &mut self.turbine
    }

    /// Seconds until the turbine is in this phase.
    fn until(&mut self, phase: Phase) -> f64 {
        let from = self.now;
        while self.turbine.phase() != phase {
            assert!(self.now - from < 300 * SECOND, "never {phase:?}, but {:?}", self.turbine.phase());
            self.wait_s(0.005);
        }
        (self.now - from) as f64 / 1e9
    }

    fn running(parameters: Parameters) -> Self {
        let mut bench = Self::new(parameters);
        bench.turbine.set_switch(Switch::Run);
        bench.until(Phase::Running);
        bench.wait_s(5.0);
        bench
    }
}

#[test]
fn a_start_goes_through_its_phases_in_20_to_40_s() {
    for parameters in ALL {
        let mut bench = Bench::new(parameters);
        bench.turbine.set_switch(Switch::Run);
        let mut phases = vec![];
        let mut hottest: f64 = 0.0;
        while bench.turbine.phase() != Phase::Running {
            bench.wait_s(0.005);
            hottest = hottest.max(bench.turbine.egt());
            if phases.last() != Some(&bench.turbine.phase()) {
                phases.push(bench.turbine.phase());
            }
            assert!(bench.now < 60 * SECOND);
        }
        use Phase::*;
        assert_eq!(phases, [Standby, Ignition, Preheat, FuelRamp, LearningIdle, Running]);
        let took = bench.now as f64 / 1e9;
        assert!((20.0..40.0).contains(&took), "{}: {took} s", parameters.name);
        assert!((bench.turbine.start_time() - took).abs() < 0.1);
        assert!(hottest < parameters.egt_limit, "{}: {hottest} °C", parameters.name);
        assert!((bench.turbine.rpm() - parameters.idle_rpm).abs() < 0.02 * parameters.idle_rpm);
    }
}

#[test]
fn idle_and_full_throttle_give_the_figures_of_the_engine() {
    for p in ALL {
        let mut bench = Bench::running(p);
        let idle = bench.wait_s(20.0);
        assert!((idle.rpm() - p.idle_rpm).abs() < 50.0);
        assert!((idle.egt() - p.egt_idle).abs() < 5.0, "{}", idle.egt());
        assert!((idle.thrust() - p.thrust_idle).abs() < 0.1 * p.thrust_idle);
        assert!((idle.pump_voltage() - p.pump_idle_v).abs() < 0.1);

        bench.turbine.set_demand(Demand::Throttle(1000));
        let full = bench.wait_s(20.0);
        assert!((full.rpm() - p.max_rpm).abs() < 50.0, "{}", full.rpm());
        assert!((full.egt() - p.egt_max).abs() < 5.0);
        assert!((full.thrust() - p.thrust_max).abs() < 0.01 * p.thrust_max);
        assert!((full.fuel_flow() - p.flow_max).abs() < 0.01 * p.flow_max);
        assert!((full.pump_voltage() - p.pump_max_v).abs() < 0.05);

        // One minute at full throttle burns one minute's worth.
        let before = full.fuel_total();
        let burnt = bench.wait_s(60.0).fuel_total() - before;
        assert!((burnt - p.flow_max).abs() < 0.01 * p.flow_max);
    }
}

#[test]
fn the_curve_sets_how_fast_it_accelerates() {
    let time_to_full = |curve| {
        let mut bench = Bench::running(Parameters::ZK_160K);
        bench.turbine.set_curves(curve, 30);
        bench.turbine.set_demand(Demand::Throttle(1000));
        let from = bench.now;
        while bench.turbine.rpm() < 155_000.0 {
            bench.wait_s(0.01);
        }
        (bench.now - from) as f64 / 1e9
    };
    let (slow, normal, fast) = (time_to_full(10), time_to_full(30), time_to_full(60));
    assert!((2.0..6.0).contains(&normal), "{normal} s");
    assert!(slow > 2.5 * normal && fast < 0.7 * normal, "{slow} {normal} {fast}");
}

#[test]
fn an_rpm_demand_is_met_and_limited() {
    let mut bench = Bench::running(Parameters::ZK_160K);
    for (wanted, expected) in [(100_000, 100_000.0), (0, 50_000.0), (400_000, 160_000.0)] {
        bench.turbine.set_demand(Demand::Rpm(wanted));
        assert!((bench.wait_s(20.0).rpm() - expected).abs() < 50.0);
    }
}

#[test]
fn standby_cools_and_stop_does_not() {
    for parameters in ALL {
        let mut bench = Bench::running(parameters);
        bench.turbine.set_switch(Switch::Standby);
        bench.wait_s(0.01);
        assert_eq!(bench.turbine.phase(), Phase::Cooling);
        assert_eq!(bench.turbine.fuel_flow(), 0.0);
        let took = bench.until(Phase::Standby);
        assert!((20.0..90.0).contains(&took), "{took} s");
        assert!(bench.turbine.egt() < COOL_EGT);

        let mut bench = Bench::running(parameters);
        bench.turbine.set_switch(Switch::Stop);
        bench.wait_s(0.01);
        assert_eq!(bench.turbine.phase(), Phase::Stopped);
        assert_eq!(bench.turbine.fuel_flow(), 0.0);
        let later = bench.wait_s(60.0);
        assert_eq!(later.rpm(), 0.0);
        assert!(later.egt() > 150.0, "without cooling it stays hot: {}", later.egt());
        // Standby after all: then it is cooled.
        bench.turbine.set_switch(Switch::Standby);
        bench.wait_s(0.01);
        assert_eq!(bench.turbine.phase(), Phase::Cooling);
    }
}

#[test]
fn a_hot_turbine_cools_before_it_starts_again() {
    let mut bench = Bench::running(Parameters::TITAN);
    bench.turbine.set_switch(Switch::Stop);
    bench.wait_s(1.0);
    bench.turbine.set_switch(Switch::Run);
    bench.wait_s(0.01);
    assert_eq!(bench.turbine.phase(), Phase::Cooling);
    bench.until(Phase::Running);
}

#[test]
fn a_flame_out_is_noticed_and_holds_until_it_is_cleared() {
    let mut bench = Bench::running(Parameters::OLYMPUS);
    bench.turbine.set_demand(Demand::Throttle(800));
    bench.wait_s(10.0);
    bench.turbine.flame_out();
    assert_eq!(bench.turbine.trip(), None);
    assert!(bench.until(Phase::Cooling) < 10.0);
    assert_eq!(bench.turbine.trip(), Some(Trip::FlameOut));
    bench.until(Phase::Standby);
    assert_eq!(bench.wait_s(5.0).phase(), Phase::Standby, "still switched to run, and does not start");
    bench.turbine.clear_trip();
    bench.until(Phase::Running);
}

#[test]
fn a_hot_start_is_stopped() {
    for parameters in ALL {
        let mut bench = Bench::new(parameters);
        bench.turbine.hot_start(true);
        bench.turbine.set_switch(Switch::Run);
        bench.until(Phase::FuelRamp);
        bench.until(Phase::Cooling);
        assert_eq!(bench.turbine.trip(), Some(Trip::OverTemperature), "{}", parameters.name);
    }
}

#[test]
fn a_start_that_does_not_light_is_given_up() {
    let mut bench = Bench::new(Parameters::ZK_160K);
    bench.turbine.no_light(true);
    bench.turbine.set_switch(Switch::Run);
    bench.until(Phase::Ignition);
    assert!(bench.until(Phase::Cooling) < 20.0);
    assert_eq!(bench.turbine.trip(), Some(Trip::NoLight));
}

#[test]
fn result_is_independent_of_step_size() {
    let course = |step: Nanos| {
        let mut turbine = Turbine::new(Parameters::OLYMPUS);
        turbine.advance_to(0);
        let mut seen = vec![];
        for (at, switch, throttle) in
            [(0, Switch::Run, 0), (40, Switch::Run, 700), (50, Switch::Standby, 0), (60, Switch::Standby, 0)]
        {
            let mut now = turbine.stepped_to.unwrap();
            while now < at * SECOND {
                now = (now + step).min(at * SECOND);
                turbine.advance_to(now);
            }
            turbine.set_switch(switch);
            turbine.set_demand(Demand::Throttle(throttle));
            seen.push((turbine.rpm(), turbine.egt(), turbine.fuel_total(), turbine.phase()));
        }
        seen
    };
    assert_eq!(course(STEP), course(SECOND));
    assert_eq!(course(1_234_567), course(777 * MILLIS));
}
