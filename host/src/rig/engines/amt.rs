//! Engines with an AMT ECU.

use super::description::{Described, Description};
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::EngineModel;
use sim::amt;
use sim::ecu::{MILLIS, Nanos};

/// The simulated ECU, with the engine behind it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Ecu(pub amt::EngineModel);

impl Described for Ecu {
    const HELP: &'static str = "  \
  --engine name=left,ecu=amt,engine=olympus,baud=2400
      engine: mercury, pegasus, olympus (default), titan, nike, lynx
      baud: default 2400
";

    const KEYS: &'static [&'static str] = &["engine"];

    fn read(
        name: &'static str,
        port: u8,
        description: &Description<'_>,
    ) -> Result<(EngineConfig, Self), String> {
        let wanted = description.get("engine").unwrap_or("olympus");
        let Some(simulated) = amt::EngineModel::named(wanted) else {
            let names = amt::EngineModel::ALL.map(amt::EngineModel::name).join(", ");
            return Err(format!("engine=`{wanted}` is not simulated: write one of {names}"));
        };
        let expected = EngineModel::ALL.into_iter().find(|engine| engine.name() == simulated.name());
        let line = description.line(2400)?;
        Ok((EngineConfig::amt(name, port, line, expected), Self(simulated)))
    }

    fn has_speed_control(self) -> bool {
        false
    }

    fn stops_without_commands(self) -> Option<Nanos> {
        Some(amt::AmtConfig::new(self.0).serial_delay)
    }

    /// It has a throttle only.
    fn by_rpm(self) -> bool {
        false
    }

    fn cadence(self) -> Option<Nanos> {
        None
    }

    fn ecu_period(self) -> Nanos {
        125 * MILLIS
    }
}
