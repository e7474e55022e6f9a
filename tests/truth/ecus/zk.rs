//! ZK ECUs in the worlds.

use super::vendor::{Facts, Odd, Seen, WorldConfig, WorldEcu};
use crate::history::{PilotCommand, Sent};
use crate::kind::Kind;
use crate::pilots::Rng;
use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::{Action, Rate};
use jetlink::ecu::zk::config::{Config, Service as ZkService};
use jetlink::ecu::{EcuConfig, Service};
use jetlink::line::Line;
use jetlink::units::Millivolts;
use sim::any::{AnyConfig, AnyEcu};
use sim::control::{Command, Frame};
use sim::turbine::Switch;
use sim::vendor::VendorConfig as _;
use sim::zk::{ControlledBy, Pwm, ZkCommand, ZkConfig, ZkEcu, ZkTemper};

/// The supply of an ECU, and one below every limit, V.
const SUPPLY: f64 = 11.1;
const LOW_SUPPLY: f64 = 9.0;
/// The limit, mV.
const SUPPLY_LIMIT: u32 = 10_000;

/// For the named cases: an ECU as harmful as the document allows.
pub fn case(version: u8) -> (EngineConfig, AnyConfig) {
    let temper = ZkTemper {
        starts_hot: true,
        services_while_cooling: true,
        valves_pass_fuel: true,
        ..ZkTemper::DEFAULT
    };
    let ecu = ZkConfig { temper, log: 16, ..ZkConfig::new(version) };
    (EngineConfig::zk("zk", 0, Line::new(9600), Rate::Hz20), AnyConfig::Zk(ecu))
}

/// A random one.
pub fn random(rng: &mut Rng, port: u8) -> (EngineConfig, AnyConfig) {
    let rate = rng.pick(&[Rate::Hz20, Rate::Hz20, Rate::Hz20, Rate::Hz50, Rate::Hz100]);
    let bauds: &[u32] = match rate {
        Rate::Hz20 => &[2400, 9600, 9600, 115_200],
        Rate::Hz50 => &[9600, 38_400],
        _ => &[19_200, 115_200],
    };
    let baud = rng.pick(bauds);
    let two = baud > 2400 && rng.percent(20);
    let line = if two { Line::with_two_stop_bits(baud) } else { Line::new(baud) };
    let mut config = EngineConfig::zk("zk", port, line, rate);
    node(&mut config.ecu).split_switch = rng.percent(30);
    let version = rng.pick(&[1, 2, 3, 3, 4, 4, 5, 5, 5, 6]);
    let temper = ZkTemper {
        wants_standby_first: rng.percent(30),
        last_state_first: rng.pick(&[0, 0, 0, 1]),
        starts_hot: rng.percent(35),
        relights: rng.pick(&[0, 0, 1]),
        services_while_cooling: rng.percent(50),
        standby_while_pump_is_open: false,
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
        ..ZkConfig::new(version).on(sim::line_of!(line))
    };
    (config, AnyConfig::Zk(ecu))
}

impl WorldEcu for ZkEcu {
    fn seen(&self) -> Seen {
        let pwm = self.controlled_by() == ControlledBy::Pwm && self.turbine().phase().is_live();
        Seen { fault: self.error() != 0, pwm, hidden: false }
    }

    fn report_fault(&mut self, fault: Option<u8>) {
        self.set_error(fault);
    }

    fn pwm_signal(&mut self, run: Option<bool>) {
        let signal = |run| Pwm { switch: if run { Switch::Run } else { Switch::Standby }, throttle: 0 };
        self.set_pwm(run.map(signal));
    }

    fn wrong_frame(&self, rng: &mut Rng) -> Vec<u8> {
        let mut frame = match rng.below(2) {
            0 => vec![0xF1, 0, 0, rng.below(20) as u8, 0, rng.below(120) as u8],
            _ => vec![0xF6, 0, 0, 160, 25, (rng.between(1, 7) as u8) << 2],
        };
        frame.push(sim::zk::crc8(&frame));
        frame
    }

    fn odd_frame(&self, odd: Odd) -> Vec<u8> {
        let [low, high, ..] = ((self.turbine().rpm() / 10.0) as u32).to_le_bytes();
        let mut frame = match odd {
            Odd::AtRest => vec![0xF1, 0, 0, 0, 0, 0],
            // The curves; they do not report the engine's state.
            Odd::SlowShaft => vec![0xF5, 0, 0, self.ignition_voltage(), self.curve(), self.curve()],
            // The switch at run, and 120 °C.
            Odd::RunsAtRest => vec![0xF1, 0, 0, sim::zk::state::RUNNING, 2 << 5, 120],
            // Its own state and switch at run, and 1000 °C (bits 10 to 8, and 7 to 0).
            Odd::HotExhaust => vec![0xF1, low, high, self.state(), 4 << 2 | 2 << 5, 26],
            Odd::LaterVersion => {
                let max = self.config().turbine.max_rpm / 1000.0;
                vec![0xF6, low, high, max as u8, 25, 6 << 2]
            }
        };
        frame.push(sim::zk::crc8(&frame));
        frame
    }

    fn lower_supply(&mut self, low: bool) {
        self.set_supply(if low { LOW_SUPPLY } else { SUPPLY });
    }
}

/// The node's settings for it.
fn node(engine: &mut EcuConfig) -> &mut Config {
    match engine {
        EcuConfig::Zk(zk) => zk,
        other => unreachable!("the ECU is of the kind that is configured, {other:?}"),
    }
}

impl WorldConfig for ZkConfig {
    /// It may report standby while its pump is open, and try for long to light its engine again.
    fn for_drills(&mut self, rng: &mut Rng, _: &mut EcuConfig) {
        self.temper.standby_while_pump_is_open = rng.percent(50);
        if rng.percent(25) {
            self.temper.relights = rng.pick(&[6, 200, 200]);
        }
    }

    fn other_settings(&self, engine: &mut EcuConfig) {
        node(engine).split_switch ^= true;
    }

    fn facts(&self, _: EcuConfig) -> Facts {
        Facts {
            kind: Kind::Zk(self.version),
            period: self.rate.period(),
            round: self.ids.len() as u64,
            gives_up_after: self.control_loss,
            serial_delay: self.control_loss,
            frame: self.line.byte_ns(5),
            gives_up_on_empty: !self.temper.empty_keeps_control,
            boot: self.boot,
            start_throttle: 0,
            stale: self.temper.last_state_first.into(),
        }
    }

    fn holds_rpm(&self) -> bool {
        self.version >= 4
    }

    /// The same engine with an ECU of this version.
    fn another(&self, number: u8) -> AnyEcu {
        AnyConfig::Zk(self.clone().with_version(number)).ecu()
    }

    fn low_supply(&self) -> Millivolts {
        Millivolts::new(SUPPLY_LIMIT)
    }

    fn service(&self, command: PilotCommand) -> Option<Service> {
        let PilotCommand::Service(number) = command else { return None };
        Some(Service::Zk(ZkService::Action(action(number)?)))
    }

    fn name(&self) -> String {
        format!("ZK {} at {} baud and {:?}, {:?}", self.version, self.line.baud, self.rate, self.temper)
    }
}

pub fn pilot_command(service: ZkService) -> PilotCommand {
    match service {
        ZkService::Action(action) => PilotCommand::Service(action.code()),
        other => panic!("unexpected service: {other}"),
    }
}

pub fn sent(zk: ZkCommand, frame: &Frame) -> Sent {
    let command = Command::Zk(zk);
    match (zk, command.switch(), command.throttle_tenths()) {
        // In ID 6 a switch of 0 means nothing.
        (ZkCommand::Switch { factor, .. }, switch, _) => Sent::Mode(switch, factor),
        (_, Some(switch), Some(tenths)) => Sent::Full(switch, tenths.into()),
        (ZkCommand::Empty, ..) => Sent::Nothing,
        (ZkCommand::Action(action), ..) => Sent::Action(action.number()),
        // Without a factor a speed means nothing, and the ECU ignores it.
        (other, ..) => frame.rpm().map_or(Sent::Other(other.id()), Sent::Rpm),
    }
}

fn action(number: u8) -> Option<Action> {
    Some(match number {
        1 => Action::Drain,
        2 => Action::TestGlowPlug,
        3 => Action::TestMainValve,
        4 => Action::TestIgnitionValve,
        5 => Action::TestPump,
        6 => Action::TestStarter,
        10 => Action::ResetFuel,
        11 => Action::ZeroThrust,
        12 => Action::OpenPump,
        13 => Action::ClosePump,
        _ => return None,
    })
}
