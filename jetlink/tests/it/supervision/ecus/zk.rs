//! ZK ECUs in the worlds.

use super::super::oracle::Truth;
use super::super::rng::Rng;
use super::super::wire::{Frame, Switch};
use super::vendor::WorldEcu;
use jetlink::config::EngineConfig;
use jetlink::ecu::EcuConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::Line;
use sim::any::AnyConfig;
use sim::control::Command;
use sim::zk::{Sw, ZkCommand, ZkConfig, ZkEcu, state};

pub fn random(rng: &mut Rng, port: u8) -> (EngineConfig, AnyConfig) {
    let baud = rng.pick(&[4800, 9600, 38_400, 115_200]);
    let line = if rng.percent(20) { Line::with_two_stop_bits(baud) } else { Line::new(baud) };
    let rate = if rng.percent(80) { Rate::Hz20 } else { Rate::Hz50 };
    let mut config = EngineConfig::zk("zk", port, line, rate);
    let version = rng.between(3, 6) as u8;
    if let EcuConfig::Zk(zk) = &mut config.ecu {
        zk.split_switch = rng.percent(30);
    }
    (config, AnyConfig::zk(version).with_log(16))
}

pub const fn holds_rpm(config: &ZkConfig) -> bool {
    config.version >= 4
}

impl WorldEcu for ZkEcu {
    fn truth(&self, turbine: Truth) -> Truth {
        let commands = || self.commands.iter().rev().map(|(_, command)| *command);
        let throttle = commands().find_map(|command| match command {
            ZkCommand::Control { throttle, .. } => Some(throttle),
            _ => None,
        });
        let reported = (self.throttle_percent() * 10.0).clamp(0.0, 1000.0) as u16;
        let run = commands().find_map(|command| match command {
            ZkCommand::Control { sw, .. } | ZkCommand::Switch { sw, .. } => Some(sw == Sw::Run),
            _ => None,
        });
        Truth {
            // From 6 to 11 it learns or runs.
            reports_running: (6..=state::RUNNING).contains(&self.state()),
            standby: self.state() == state::STANDBY,
            faulty: self.error() != 0,
            // It reports whole percents.
            obeyed: throttle.unwrap_or(0).max(reported) + 10,
            obeys_run: run == Some(true),
            ..turbine
        }
    }

    fn report_fault(&mut self, fault: u8) {
        self.set_error(Some(fault));
    }

    fn report_state(&mut self, which: usize) {
        let states = [state::STOP, state::STANDBY, state::RUNNING, state::COOLING, 7, 25];
        self.set_state(Some(states[which]));
    }

    fn report_truth(&mut self) {
        self.set_error(None);
        self.set_state(None);
    }
}

pub fn frame(zk: ZkCommand) -> Option<Frame> {
    let command = Command::Zk(zk);
    Some(match (zk, command.switch(), command.throttle_tenths()) {
        (ZkCommand::Switch { factor, .. }, switch, _) => Frame::Mode(switch.unwrap_or(Switch::Pwm), factor),
        (_, Some(switch), Some(tenths)) => Frame::Full(switch, tenths),
        (ZkCommand::Rpm(code), ..) => Frame::RpmCode(code),
        (other, ..) => Frame::Other(other.id()),
    })
}
