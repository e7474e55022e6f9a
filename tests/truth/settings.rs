//! How the engines of a world are configured, and which ECUs they have: every temper that the documents allow.

use crate::history::{Demanded, Kind, MS, PilotCommand, Rules, SECOND};
use crate::pilots::Rng;
use embassy_time::Duration;
use jetlink::command::{Command, Demand};
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::ecu::amt::config::Service as AmtService;
use jetlink::ecu::zk::codec::{Action as ZkAction, Rate};
use jetlink::ecu::zk::config::Service as ZkService;
use jetlink::ecu::{EcuConfig, Service};
use jetlink::engine::config::{Governor, Slew, Supervision};
use jetlink::limit::{Action, Limit};
use jetlink::line::{Line, StopBits};
use jetlink::units::{Celsius, Rpm, Throttle};
use sim::amt::{AmtConfig, AmtTemper, InFlight, Status};
use sim::any::{AnyConfig, AnyEcu, Protocol};
use sim::zk::{ZkConfig, ZkTemper};

/// One engine: how the node is configured for it, and what its ECU is.
#[derive(Clone, Debug)]
pub struct Setup {
    pub config: EngineConfig,
    pub rules: Rules,
    pub line: sim::line::Line,
    ecu: AnyConfig,
}

impl Setup {
    /// For the named cases: default settings, and an AMT ECU that does what harm the document allows.
    pub fn amt_case() -> Self {
        let temper =
            AmtTemper { starts_hot: true, trips_clear_after: Some(60_000_000_000), ..AmtTemper::DEFAULT };
        let ecu = AmtConfig {
            temper,
            log: 8,
            serial_delay: 4_000_000_000,
            ..AmtConfig::new(sim::amt::EngineModel::Olympus)
        };
        let config = EngineConfig::amt("amt", 0, Line::new(2400), Some(EngineModel::Olympus));
        Self::of(config, AnyConfig::Amt(ecu), sim::line::Line::n1(2400), 2)
    }

    /// The same for ZK, of this version.
    pub fn zk_case(version: u8) -> Self {
        let temper = ZkTemper {
            starts_hot: true,
            services_while_cooling: true,
            valves_pass_fuel: true,
            ..ZkTemper::DEFAULT
        };
        let ecu = ZkConfig { temper, log: 16, ..ZkConfig::new(version) };
        Self::of(
            EngineConfig::zk("zk", 0, Line::new(9600), Rate::Hz20),
            AnyConfig::Zk(ecu),
            sim::line::Line::n1(9600),
            2,
        )
    }

    fn of(config: EngineConfig, ecu: AnyConfig, line: sim::line::Line, count: usize) -> Self {
        let rules = rules(&config, &ecu, count);
        Self { config, rules, line, ecu }
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

    /// Another one of the kind: the same engine on a ZK ECU of this version.
    pub fn another(&self, version: u8) -> AnyEcu {
        match &self.ecu {
            AnyConfig::Amt(_) => self.ecu(),
            AnyConfig::Zk(config) => {
                let fresh = ZkConfig::new(version);
                AnyConfig::Zk(ZkConfig { version, ids: fresh.ids, ..config.clone() }).ecu()
            }
        }
    }
    /// Other settings that somebody has flashed: the same rules, other numbers that a rule does not bind.
    pub fn other_settings(&self) -> EngineConfig {
        let mut config = self.config;
        let supervision = &mut config.supervision;
        supervision.takeover.throttle_band = throttle(100);
        supervision.start.link_stable = supervision.start.link_stable.min(ms(800));
        supervision.limits.flame_out = Limit::report(40);
        supervision.recover_after = supervision.recover_after.min(ms(300));
        config
    }

    pub fn is_amt(&self) -> bool {
        self.rules.kind == Kind::Amt
    }

    pub fn name(&self) -> String {
        let what = match &self.ecu {
            AnyConfig::Amt(ecu) => format!(
                "AMT at {} baud, serial delay {} ms, {:?}",
                ecu.line.baud,
                ecu.serial_delay / 1_000_000,
                ecu.temper
            ),
            AnyConfig::Zk(ecu) => {
                format!("ZK {} at {} baud and {:?}, {:?}", ecu.version, ecu.line.baud, ecu.rate, ecu.temper)
            }
        };
        format!("{what}\n{:?}", self.config)
    }
}

/// The settings of the engines of one node.
pub fn setups(rng: &mut Rng, count: usize) -> Vec<Setup> {
    let gap = Duration::from_millis(rng.pick(&[0, 3000, 10_000]));
    // They spare each other: then all of them do.
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
        all.limits.ecu_fault = rng.pick(&[Action::FailSafe, Action::Standby]);
    }
    if rng.percent(12) {
        let at = Some(Celsius::from_tenths(rng.pick(&[6200, 6800])));
        all.limits.over_temperature = Limit { at, action: rng.pick(&[Action::FailSafe, Action::Standby]) };
    }
    if rng.percent(5) {
        let action = rng.pick(&[Action::FailSafe, Action::Standby]);
        all.limits.over_speed = Limit { at: Some(Rpm::new(rng.pick(&[80_000, 100_000]))), action };
    }
    if rng.percent(6) {
        let action = rng.pick(&[Action::FailSafe, Action::Standby]);
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
    let amt = rng.percent(45);
    let (mut config, ecu) = if amt { amt_setup(rng, port) } else { zk_setup(rng, port) };
    if rng.percent(8) && (amt || matches!(&ecu, AnyConfig::Zk(ecu) if ecu.version < 4)) {
        supervision.governor = Some(Governor::DEFAULT);
    }
    config.supervision = supervision;
    let line = match config.line.stop_bits {
        StopBits::One => sim::line::Line::n1(config.line.baud),
        StopBits::Two => sim::line::Line::n2(config.line.baud),
    };
    Setup::of(config, ecu, line, count)
}

fn amt_setup(rng: &mut Rng, port: u8) -> (EngineConfig, AnyConfig) {
    let line = Line::new(rng.pick(&[2400, 2400, 2400, 9600, 115_200]));
    let engine = rng.pick(&[None, Some(EngineModel::Olympus)]);
    let mut config = EngineConfig::amt("amt", port, line, engine);
    let start_throttle = rng.pick(&[0, 0, 0, 200]);
    let serial_delay = rng.pick(&[2, 4, 4]);
    if let EcuConfig::Amt(amt) = &mut config.ecu {
        amt.start_throttle = throttle(start_throttle);
        amt.serial_delay = Duration::from_secs(serial_delay);
    }
    let states = [Status::IdleCalibration, Status::StartedUp, Status::Unnamed(30)];
    let in_flight = InFlight {
        shows: rng.pick(&states),
        every: 20_000_000_000,
        lasts: rng.spread(100, 4000) * 1_000_000,
    };
    let temper = AmtTemper {
        wants_auto_stop_first: rng.percent(30),
        clearance: rng.pick(&[100, 1000, 1000, 4000]) * 1_000_000,
        last_state_first: rng.pick(&[0, 0, 0, 1]),
        starts_hot: rng.percent(35),
        in_flight: rng.percent(20).then_some(in_flight),
        trips_clear_after: rng.percent(25).then(|| rng.spread(500, 60_000) * 1_000_000),
    };
    let ecu = AmtConfig {
        temper,
        log: 8,
        serial_delay: serial_delay * 1_000_000_000,
        boot: rng.pick(&[30, 200, 500, 500, 3000]) * 1_000_000,
        start_throttle: (start_throttle / 5) as u8,
        loss_is_an_error: rng.percent(20),
        ..AmtConfig::new(sim::amt::EngineModel::Olympus).on(sim::line::Line::n1(line.baud))
    };
    (config, AnyConfig::Amt(ecu))
}

fn zk_setup(rng: &mut Rng, port: u8) -> (EngineConfig, AnyConfig) {
    let rate = rng.pick(&[Rate::Hz20, Rate::Hz20, Rate::Hz20, Rate::Hz50, Rate::Hz100]);
    let bauds: &[u32] = match rate {
        Rate::Hz20 => &[2400, 9600, 9600, 115_200],
        Rate::Hz50 => &[9600, 38_400],
        _ => &[19_200, 115_200],
    };
    let baud = rng.pick(bauds);
    let two = baud > 2400 && rng.percent(20);
    let (line, sim_line) = match two {
        true => (Line::with_two_stop_bits(baud), sim::line::Line::n2(baud)),
        false => (Line::new(baud), sim::line::Line::n1(baud)),
    };
    let mut config = EngineConfig::zk("zk", port, line, rate);
    if let EcuConfig::Zk(zk) = &mut config.ecu {
        zk.split_switch = rng.percent(30);
    }
    let version = rng.pick(&[1, 2, 3, 3, 4, 4, 5, 5, 5, 6]);
    let temper = ZkTemper {
        wants_standby_first: rng.percent(30),
        last_state_first: rng.pick(&[0, 0, 0, 1]),
        starts_hot: rng.percent(35),
        relights: rng.pick(&[0, 0, 1]),
        services_while_cooling: rng.percent(50),
        valves_pass_fuel: rng.percent(50),
        empty_keeps_control: rng.percent(75),
    };
    let ecu = ZkConfig {
        temper,
        log: 16,
        esr: rng.percent(10),
        boot: rng.pick(&[30, 30, 300, 300, 3000]) * 1_000_000,
        rate: match rate {
            Rate::Hz20 => sim::zk::Rate::Hz20,
            Rate::Hz50 => sim::zk::Rate::Hz50,
            _ => sim::zk::Rate::Hz100,
        },
        ..ZkConfig::new(version).on(sim_line)
    };
    (config, AnyConfig::Zk(ecu))
}

/// What the judge may know of the settings.
fn rules(config: &EngineConfig, ecu: &AnyConfig, count: usize) -> Rules {
    let all = &config.supervision;
    let micros = |time: Duration| time.as_micros();
    let (kind, period, round, gives_up_after, boot, turbine, start_throttle) = match (ecu, &config.ecu) {
        (AnyConfig::Amt(ecu), EcuConfig::Amt(amt)) => {
            let tenths = u32::from(amt.start_throttle.tenths());
            (Kind::Amt, ecu.period, 1, ecu.serial_delay, ecu.boot, ecu.turbine, tenths)
        }
        (AnyConfig::Zk(ecu), _) => {
            let round = ecu.ids.len() as u64;
            (Kind::Zk(ecu.version), ecu.rate.period(), round, ecu.control_loss, ecu.boot, ecu.turbine, 0)
        }
        (AnyConfig::Amt(_), EcuConfig::Zk(_)) => unreachable!("the ECU is of the kind that is configured"),
    };
    let limit = |action: Action| match action {
        Action::Report => None,
        Action::FailSafe => Some(false),
        Action::Standby => Some(true),
    };
    let over = &all.limits.over_temperature;
    let others = count as u64 - 1;
    Rules {
        kind,
        period: period / 1000,
        round,
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
        start_wait: others * (micros(all.start.gap) + 120 * SECOND),
        start_throttle,
        governor: all.governor.is_some(),
        pump_bound: micros(all.service_time),
        gives_up_after: gives_up_after / 1000,
        gives_up_on_empty: matches!(ecu, AnyConfig::Zk(ecu) if !ecu.temper.empty_keeps_control),
        stale: match ecu {
            AnyConfig::Amt(ecu) => ecu.temper.last_state_first.into(),
            AnyConfig::Zk(ecu) => ecu.temper.last_state_first.into(),
        },
        boot: boot / 1000 + 2 * MS,
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
        limit_change: [
            all.limits.hot_start.action,
            all.limits.flame_out.action,
            all.limits.low_rpm.action,
            all.limits.implausible.action,
        ]
        .into_iter()
        .find_map(limit),
        when_other_fails: all.when_other_fails.map(u32::from),
    }
}

/// The node's command for a pilot's; `None` where the node has none for it.
pub fn command(command: PilotCommand, amt: bool) -> Option<Command> {
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
        PilotCommand::Service(_) if amt => return None,
        PilotCommand::Service(number) => Command::Service(Service::Zk(ZkService::Action(action(number)?))),
        PilotCommand::Ctf if amt => Command::Service(Service::Amt(AmtService::Ctf)),
        PilotCommand::Ctf => return None,
    })
}

/// What a command of radio control or of MAVLink is to the judge.
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
        Command::Service(Service::Zk(ZkService::Action(action))) => PilotCommand::Service(action.code()),
        Command::Service(Service::Amt(AmtService::Ctf)) => PilotCommand::Ctf,
        other => panic!("nobody commands {other:?}"),
    }
}

fn action(number: u8) -> Option<ZkAction> {
    Some(match number {
        1 => ZkAction::Drain,
        2 => ZkAction::TestGlowPlug,
        3 => ZkAction::TestMainValve,
        4 => ZkAction::TestIgnitionValve,
        5 => ZkAction::TestPump,
        6 => ZkAction::TestStarter,
        10 => ZkAction::ResetFuel,
        11 => ZkAction::ZeroThrust,
        12 => ZkAction::OpenPump,
        13 => ZkAction::ClosePump,
        _ => return None,
    })
}
