//! The configuration of the engines of a world, and what the judge knows of it. The ECUs are in `ecus/`.

use crate::ecus;
use crate::history::{Demanded, MS, PilotCommand, Rules, SECOND};
use crate::kind::Traits;
use crate::pilots::Rng;
use embassy_time::Duration;
use jetlink::command::{Command, Demand};
use jetlink::config::EngineConfig;
use jetlink::engine::config::{Governor, Slew, Supervision};
use jetlink::limit::{Action, Limit};
use jetlink::units::{Celsius, Rpm, Throttle};
use sim::any::{AnyConfig, AnyEcu, Protocol};

/// One engine: the node's configuration for it, and its ECU.
#[derive(Clone, Debug)]
pub struct Setup {
    pub config: EngineConfig,
    pub rules: Rules,
    pub line: sim::line::Line,
    ecu: AnyConfig,
}

impl Setup {
    /// For the named cases: default settings, and an AMT ECU that is as harmful as the document allows.
    pub fn amt_case() -> Self {
        Self::case(ecus::amt::case())
    }

    /// The same. A trip clears after this time, µs, and start clearance lasts for 4 s.
    pub fn amt_case_that_clears(after: u64) -> Self {
        let (config, mut ecu) = ecus::amt::case();
        ecus::amt::clears(&mut ecu, after * 1000);
        Self::case((config, ecu))
    }

    /// The same for ZK, of this version.
    pub fn zk_case(version: u8) -> Self {
        Self::case(ecus::zk::case(version))
    }

    fn case((config, ecu): (EngineConfig, AnyConfig)) -> Self {
        Self::of(config, ecu, 2)
    }

    fn of(config: EngineConfig, ecu: AnyConfig, count: usize) -> Self {
        let line = sim::line_of!(config.line);
        let rules = rules(&config, &ecu, count);
        Self { config, rules, line, ecu }
    }

    /// The same for a world of drills: settings that matter are more frequent, and the turbine is small and quick, so that an
    /// hour has many starts.
    pub fn drilled(mut self, rng: &mut Rng, count: usize) -> Self {
        let all = &mut self.config.supervision;
        all.start.egt_max = Celsius::from_tenths(rng.pick(&[700, 1000, 2000, 2000, 2000]));
        all.start.timeout = ms(rng.pick(&[120_000, 120_000, 120_000, 120_000, 6000]));
        all.loss.hold = ms(rng.pick(&[1000, 1000, 300, 8000]));
        all.loss.lower_standby_after = ms(rng.pick(&[5000, 5000, 5000, 25_000]));
        all.loss.ramp = rng.pick(&[500, 500, 100, 2000]);
        all.slew.up = rng.pick(&[None, None, Some(100), Some(500)]);
        all.slew.down = rng.pick(&[None, None, Some(60), Some(200)]);
        all.service_time = ms(rng.pick(&[30_000, 4000]));
        all.burning_egt = Celsius::from_tenths(rng.pick(&[3000, 2000, 4000]));
        if rng.percent(20) {
            all.loss.standby_after = Some(ms(3000));
        }
        let action = rng.pick(&[Action::FailSafe, Action::FailSafe, Action::FailSafe, Action::Standby]);
        let idle = self.ecu.turbine().idle_rpm;
        match rng.below(17) {
            12 => all.limits.implausible.action = action,
            13 => {
                // Above idle: the stick may be up.
                let at = Some(Rpm::new((idle * 1.15) as u32));
                all.limits.low_rpm = Limit { at, action: Action::FailSafe };
            }
            14 => all.limits.supply_low = Limit { at: Some(ecus::config(&self.ecu).low_supply()), action },
            15 => all.start.supply_min = Some(ecus::config(&self.ecu).low_supply()),
            0..3 => {
                let at = Some(Celsius::from_tenths(rng.pick(&[5500, 6200])));
                all.limits.over_temperature = Limit { at, action };
            }
            3 | 6 => {
                all.limits.over_speed = Limit { at: Some(Rpm::new(rng.pick(&[80_000, 100_000]))), action }
            }
            4 | 16 => all.limits.flame_out.action = Action::Standby,
            5 => all.limits.ecu_fault = action,
            _ => {}
        }
        if action == Action::FailSafe && rng.percent(50) {
            all.loss.throttle = throttle(250);
        }
        if count > 1 {
            all.when_other_fails = Some(rng.pick(&[300, 500, 800]));
        }
        if all.governor.is_none() && rng.percent(15) && !ecus::config(&self.ecu).holds_rpm() {
            all.governor =
                Some(Governor { authority: throttle(rng.pick(&[600, 1000])), ..Governor::DEFAULT });
        }
        ecus::quicken(rng, &mut self.config, &mut self.ecu);
        Self::of(self.config, self.ecu, count)
    }

    /// The same on another port.
    pub fn at_port(&self, port: u8) -> Self {
        Self { config: EngineConfig { port, ..self.config }, ..self.clone() }
    }

    pub fn ecu(&self) -> AnyEcu {
        self.ecu.clone().ecu()
    }

    /// The protocol of the ECU.
    pub const fn protocol(&self) -> Protocol {
        self.ecu.protocol()
    }

    /// Another ECU of this protocol; the number (1 to 6) decides in what it differs.
    pub fn another(&self, number: u8) -> AnyEcu {
        ecus::config(&self.ecu).another(number)
    }

    /// The node's command for a pilot's; `None` where the node has none for it.
    pub fn command(&self, command: PilotCommand) -> Option<Command> {
        let demand = |demanded| match demanded {
            Demanded::Throttle(tenths) => Demand::Throttle(throttle(tenths as u16)),
            Demanded::Rpm(rpm) => Demand::Rpm(Rpm::new(rpm)),
        };
        Some(match command {
            PilotCommand::Standby => Command::Standby,
            PilotCommand::ShutDown => Command::ShutDown,
            PilotCommand::Run(demanded) => Command::Run(demand(demanded)),
            PilotCommand::Stop => Command::EmergencyStop,
            PilotCommand::Release => Command::ReleaseStop,
            PilotCommand::Arm => Command::Arm,
            PilotCommand::Disarm => Command::Disarm,
            PilotCommand::Nothing => Command::Present,
            PilotCommand::Pwm => Command::HandOverToPwm,
            PilotCommand::Service(_) | PilotCommand::Ctf => {
                Command::Service(ecus::config(&self.ecu).service(command)?)
            }
        })
    }

    /// Other settings that somebody has flashed: the same rules, with other values where no rule depends on
    /// them.
    pub fn other_settings(&self) -> EngineConfig {
        let mut config = self.config;
        let supervision = &mut config.supervision;
        supervision.takeover.throttle_band = throttle(100);
        supervision.start.link_stable = supervision.start.link_stable.min(ms(800));
        supervision.limits.flame_out = Limit::report(40);
        supervision.recover_after = supervision.recover_after.min(ms(300));
        supervision.takeover.rpm_band = Rpm::new(10_000);
        supervision.service_time = supervision.service_time.min(ms(10_000));
        ecus::config(&self.ecu).other_settings(&mut config.ecu);
        config
    }

    pub const fn traits(&self) -> &'static Traits {
        self.rules.kind.traits()
    }

    pub fn name(&self) -> String {
        format!("{}\n{:?}", ecus::config(&self.ecu).name(), self.config)
    }
}

/// The settings of the engines of one node.
pub fn setups(rng: &mut Rng, count: usize) -> Vec<Setup> {
    let gap = Duration::from_millis(rng.pick(&[0, 3000, 10_000]));
    // If one of them reduces for another, all of them do.
    let spare = (count > 1 && rng.percent(60)).then(|| rng.pick(&[300, 500, 800]));
    (0..count).map(|port| setup(rng, port as u8, gap, spare, count)).collect()
}

fn ms(millis: u64) -> Duration {
    Duration::from_millis(millis)
}

fn throttle(tenths: u16) -> Throttle {
    Throttle::from_tenths(tenths).expect("0..=1000")
}

fn supervision(rng: &mut Rng) -> Supervision {
    let mut all = Supervision::DEFAULT;
    if rng.percent(60) {
        all.timeouts.emergency = ms(rng.pick(&[300, 500, 2000]));
        all.timeouts.rc = ms(rng.pick(&[300, 500, 1000]));
        all.timeouts.mavlink = ms(rng.pick(&[500, 1000, 3000]));
        all.timeouts.bench = ms(rng.pick(&[300, 500, 1500]));
        all.recover_after = ms(rng.pick(&[100, 500, 1000, 2000]));
        all.takeover.within = ms(rng.pick(&[0, 500, 2000, 5000]));
        all.loss.hold = ms(rng.pick(&[0, 300, 1000, 4000]));
        all.loss.throttle = throttle(rng.pick(&[0, 0, 100, 250]));
        all.loss.ramp = rng.pick(&[100, 250, 500, 2000]);
        all.loss.standby_after = rng.pick(&[None, None, Some(ms(3000)), Some(ms(20_000))]);
        all.start.arming = rng.percent(90);
    }
    if rng.percent(20) {
        all.slew = Slew {
            up: rng.pick(&[Some(100), Some(500), None]),
            down: rng.pick(&[None, Some(200), Some(500)]),
        };
    }
    if rng.percent(8) {
        all.limits.ecu_fault = rng.pick(&[Action::FailSafe, Action::FailSafe, Action::Standby]);
    }
    if rng.percent(12) {
        let at = Some(Celsius::from_tenths(rng.pick(&[6200, 6800])));
        all.limits.over_temperature =
            Limit { at, action: rng.pick(&[Action::FailSafe, Action::FailSafe, Action::Standby]) };
    }
    if rng.percent(5) {
        let action = rng.pick(&[Action::FailSafe, Action::FailSafe, Action::Standby]);
        all.limits.over_speed = Limit { at: Some(Rpm::new(rng.pick(&[80_000, 100_000]))), action };
    }
    if rng.percent(6) {
        let action = rng.pick(&[Action::FailSafe, Action::FailSafe, Action::Standby]);
        match rng.below(4) {
            0 => all.limits.hot_start.action = action,
            1 => all.limits.flame_out.action = action,
            2 => all.limits.low_rpm.action = action,
            _ => all.limits.implausible.action = action,
        }
    }
    all
}

fn setup(rng: &mut Rng, port: u8, gap: Duration, spare: Option<u16>, count: usize) -> Setup {
    let mut supervision = supervision(rng);
    supervision.start.gap = gap;
    supervision.when_other_fails = spare;
    let (mut config, ecu) = ecus::random(rng, port);
    if rng.percent(8) && !ecus::config(&ecu).holds_rpm() {
        supervision.governor = Some(Governor::DEFAULT);
    }
    config.supervision = supervision;
    Setup::of(config, ecu, count)
}

/// What the judge may know about the settings.
fn rules(config: &EngineConfig, ecu: &AnyConfig, count: usize) -> Rules {
    let all = &config.supervision;
    let micros = |time: Duration| time.as_micros();
    let (facts, turbine) = (ecus::config(ecu).facts(config.ecu), ecu.turbine());
    let limit = |action: Action| match action {
        Action::Report => None,
        Action::FailSafe => Some(false),
        Action::Standby => Some(true),
    };
    let over = &all.limits.over_temperature;
    let others = count as u64 - 1;
    Rules {
        kind: facts.kind,
        period: facts.period / 1000,
        round: facts.round,
        ages: [all.timeouts.emergency, all.timeouts.rc, all.timeouts.mavlink, all.timeouts.bench].map(micros),
        recover_after: micros(all.recover_after),
        return_within: micros(all.return_within),
        takeover: micros(all.takeover.within),
        hold: micros(all.loss.hold),
        ramp: all.loss.ramp.into(),
        rise: all.rise.into(),
        slew_up: all.slew.up.map(u32::from),
        slew_down: all.slew.down.map(u32::from),
        fail_safe: all.loss.throttle.tenths().into(),
        standby_after: all.loss.standby_after.map(micros),
        lower_standby_after: micros(all.loss.lower_standby_after),
        listen: SECOND,
        arming: all.start.arming,
        link_stable: micros(all.start.link_stable).min(800 * MS),
        idle_band: all.start.idle_band.tenths().into(),
        egt_max: f64::from(all.start.egt_max.tenths()) / 10.0,
        start_timeout: micros(all.start.timeout),
        start_gap: micros(all.start.gap),
        start_wait: others * (micros(all.start.gap) + 120 * SECOND),
        start_throttle: facts.start_throttle,
        governor: all.governor.is_some(),
        pump_bound: micros(all.service_time),
        gives_up_after: facts.gives_up_after / 1000,
        serial_delay: facts.serial_delay / 1000,
        frame: facts.frame / 1000,
        authority: all.governor.map_or(1000, |governor| governor.authority.tenths().into()),
        gives_up_on_empty: facts.gives_up_on_empty,
        stale: facts.stale,
        boot: facts.boot / 1000 + 2 * MS,
        idle_rpm: turbine.idle_rpm,
        max_rpm: turbine.max_rpm,
        limit_egt: over
            .at
            .zip(limit(over.action))
            .map(|(at, standby)| (f64::from(at.tenths()) / 10.0, standby)),
        limit_rpm: all
            .limits
            .over_speed
            .at
            .zip(limit(all.limits.over_speed.action))
            .map(|(at, standby)| (f64::from(at.get()), standby)),
        limit_fault: limit(all.limits.ecu_fault),
        limit_changes: [
            all.limits.hot_start.action,
            all.limits.flame_out.action,
            all.limits.low_rpm.action,
            all.limits.implausible.action,
        ]
        .map(limit),
        limit_flame: limit(all.limits.flame_out.action),
        limit_hot: limit(all.limits.hot_start.action),
        limit_low_rpm: (all.limits.low_rpm.at)
            .zip(limit(all.limits.low_rpm.action))
            .map(|(at, standby)| (f64::from(at.get()), standby)),
        limit_jump: limit(all.limits.implausible.action),
        jump_lowers: [all.limits.flame_out.action, all.limits.low_rpm.action]
            .into_iter()
            .any(|action| limit(action) == Some(false)),
        limit_supply: all.limits.supply_low.at.and(limit(all.limits.supply_low.action)),
        supply_counts: all.start.supply_min.is_some(),
        burning: f64::from(all.burning_egt.tenths()) / 10.0,
        when_other_fails: all.when_other_fails.map(u32::from),
    }
}

/// A command of radio control or MAVLink in the judge's terms.
pub fn commanded(command: Command) -> PilotCommand {
    match command {
        Command::Standby => PilotCommand::Standby,
        Command::Run(Demand::Throttle(throttle)) => {
            PilotCommand::Run(Demanded::Throttle(throttle.tenths().into()))
        }
        Command::Run(Demand::Rpm(rpm)) => PilotCommand::Run(Demanded::Rpm(rpm.get())),
        Command::EmergencyStop => PilotCommand::Stop,
        Command::ReleaseStop => PilotCommand::Release,
        Command::Arm => PilotCommand::Arm,
        Command::Disarm => PilotCommand::Disarm,
        Command::Present => PilotCommand::Nothing,
        Command::ShutDown => PilotCommand::ShutDown,
        Command::Service(service) => ecus::pilot_command(service),
        other => panic!("unexpected command: {other:?}"),
    }
}
