//! AMT ECUs in the worlds.

use super::super::oracle::Truth;
use super::super::rng::Rng;
use super::super::wire::Frame;
use super::vendor::WorldEcu;
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::line::Line;
use sim::amt::{AmtCommand, AmtConfig, AmtEcu, Ops};
use sim::any::AnyConfig;
use sim::control::Command;

pub fn random(rng: &mut Rng, port: u8) -> (EngineConfig, AnyConfig) {
    let engine = rng.pick(&[None, Some(EngineModel::Olympus)]);
    let line = Line::new(rng.pick(&[2400, 2400, 9600, 115_200]));
    let ecu = AnyConfig::amt(sim::amt::EngineModel::Olympus).with_log(8);
    (EngineConfig::amt("amt", port, line, engine), ecu)
}

pub const fn holds_rpm(_: &AmtConfig) -> bool {
    false
}

impl WorldEcu for AmtEcu {
    fn truth(&self, turbine: Truth) -> Truth {
        let last = self.commands.last().map(|(_, command)| *command);
        Truth {
            reports_running: turbine.running,
            // Its document has no state for cooling: only the stopped shaft shows standby.
            standby: !turbine.live && self.turbine().rpm() < 1000.0,
            faulty: self.errors() != 0,
            hides_state: self.errors() != 0,
            // Bit 3: it reports its sensor as faulty. 300 °C is the default, and one step of EGT is 4.6 °C.
            reports_cold: self.errors() & 1 << 3 == 0 && turbine.egt <= 310.0,
            obeyed: last.map_or(0, |command| u16::from(command.throttle_half_percent) * 5),
            obeys_run: last.is_some_and(|command| command.ops == Ops::Run),
            ..turbine
        }
    }

    fn report_fault(&mut self, fault: u8) {
        self.set_errors(1 << (fault % 7));
    }

    fn report_truth(&mut self) {
        self.set_errors(0);
    }
}

/// `None`: CTF, which is never commanded here.
pub fn frame(command: AmtCommand) -> Option<Frame> {
    let command = Command::Amt(command);
    Some(Frame::Full(command.switch()?, command.throttle_tenths()?))
}
