//! Engines with a ZK ECU.

use super::description::{Described, Description};
use jetlink::config::EngineConfig;
use jetlink::ecu::EcuConfig;
use jetlink::ecu::zk::codec::{Control, Rate};
use sim::ecu::Nanos;
use sim::zk;

/// Version from which an ECU takes the modes `Split` and `Rpm` (ZK-9).
const MODES_SINCE: u8 = Control::MODES_SINCE.get();

/// The simulated ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Ecu {
    /// Protocol version.
    pub version: u8,
    /// Rate that the node sets.
    pub rate: zk::Rate,
    /// How it is commanded.
    pub mode: Mode,
}

/// The three control modes of a ZK ECU (ZK-9).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Mode {
    /// 1: switch and throttle in one command.
    Throttle,
    /// 2: the switch in a command of its own.
    Split,
    /// 3: switch and speed.
    Rpm,
}

impl Described for Ecu {
    const HELP: &'static str = "  \
  --engine name=centre,ecu=zk,version=4,baud=9600,stop=1,rate=20,mode=throttle
      version: 1 to 5 (default 5); baud: default 9600; stop: 1 (default) or 2; rate: 20 (default), 50, 100 Hz
      mode: throttle (default), split (switch in a command of its own), rpm; the last two from version 4
";

    const KEYS: &'static [&'static str] = &["version", "rate", "mode"];

    fn read(
        name: &'static str,
        port: u8,
        description: &Description<'_>,
    ) -> Result<(EngineConfig, Self), String> {
        let version = match description.get("version").unwrap_or("5") {
            text if matches!(text, "1" | "2" | "3" | "4" | "5") => text.bytes().next().unwrap_or(b'5') - b'0',
            other => return Err(format!("version=`{other}` is not known: write 1 to 5")),
        };
        let (rate, simulated) = match description.get("rate").unwrap_or("20") {
            "20" => (Rate::Hz20, zk::Rate::Hz20),
            "50" => (Rate::Hz50, zk::Rate::Hz50),
            "100" => (Rate::Hz100, zk::Rate::Hz100),
            other => return Err(format!("rate=`{other}` is not known: write 20, 50 or 100")),
        };
        let wanted = description.get("mode").unwrap_or("throttle");
        let mode = match wanted {
            "throttle" => Mode::Throttle,
            "split" => Mode::Split,
            "rpm" => Mode::Rpm,
            other => return Err(format!("mode=`{other}` is not known: write throttle, split or rpm")),
        };
        if mode != Mode::Throttle && version < MODES_SINCE {
            return Err(format!("mode={wanted} needs version={MODES_SINCE} or higher"));
        }
        let mut config = EngineConfig::zk(name, port, description.line(9600)?, rate);
        if let EcuConfig::Zk(zk) = &mut config.ecu {
            zk.split_switch = mode == Mode::Split;
        }
        Ok((config, Self { version, rate: simulated, mode }))
    }

    fn version(self) -> Option<u8> {
        Some(self.version)
    }

    fn by_rpm(self) -> bool {
        self.mode == Mode::Rpm
    }

    fn has_speed_control(self) -> bool {
        self.version >= MODES_SINCE
    }

    fn stops_without_commands(self) -> Option<Nanos> {
        None
    }

    fn cadence(self) -> Option<Nanos> {
        Some(self.rate.period())
    }

    fn ecu_period(self) -> Nanos {
        self.rate.period()
    }
}
