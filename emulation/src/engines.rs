//! The ECUs that belong to the firmware's tables of engines (`src/config.rs`), with their lines. A separate copy,
//! not read from there, so that a difference is found.

use crate::board::Board;
use crate::image::Image;
use crate::wire::Far;
use sim::amt;
use sim::any::AnyConfig;
use sim::line::Line;
use sim::zk::Rate;

/// The protocol of an ECU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// AMT.
    Amt(amt::EngineModel),
    /// ZK, with the rate that the firmware sets and the version of the protocol.
    Zk(Rate, u8),
}

/// One engine.
#[derive(Clone, Copy, Debug)]
pub struct Engine {
    /// Its name in the firmware's log.
    pub name: &'static str,
    /// The board's port that it uses.
    pub port: &'static str,
    /// Its line.
    pub line: Line,
    /// Its protocol.
    pub protocol: Protocol,
}

impl Engine {
    /// Its ECU. A ZK ECU starts at 20 Hz, whatever rate the firmware sets.
    pub fn ecu(&self) -> Box<dyn Far> {
        Box::new(self.config().ecu())
    }

    /// The same, with a turbine that starts within 5 s, so that engines run soon.
    pub fn quick_ecu(&self) -> Box<dyn Far> {
        Box::new(self.quick_config().ecu())
    }

    /// The configuration of that one.
    pub fn quick_config(&self) -> AnyConfig {
        let mut config = self.config();
        let turbine = config.turbine_mut();
        *turbine = turbine.starting_in(3.5);
        config
    }

    /// The configuration of its simulated ECU.
    pub fn config(&self) -> AnyConfig {
        match self.protocol {
            Protocol::Amt(engine) => AnyConfig::amt(engine),
            Protocol::Zk(_, version) => AnyConfig::zk(version),
        }
        .on(self.line)
    }
}

const ENGINES: [(&str, Line, Protocol); 6] = [
    ("left", Line::n1(2400), Protocol::Amt(amt::EngineModel::Olympus)),
    ("right", Line::n1(2400), Protocol::Amt(amt::EngineModel::Titan)),
    ("centre", Line::n1(9600), Protocol::Zk(Rate::Hz20, 4)),
    ("booster", Line::n1(115_200), Protocol::Zk(Rate::Hz50, 5)),
    ("upper", Line::n2(57_600), Protocol::Zk(Rate::Hz100, 5)),
    ("tail", Line::n1(9600), Protocol::Amt(amt::EngineModel::Mercury)),
];

/// The engines of an image, in the order of the board's ports, without that of a receiver.
pub fn of(board: &'static Board, image: Image) -> Vec<Engine> {
    let count = if image == Image::AllPorts { board.ports.len() } else { 4 };
    let ports =
        board.ports.iter().filter(|port| !image.has_outputs() || port.name != board.radio).take(count);
    ENGINES
        .iter()
        .zip(ports)
        .map(|(&(name, line, protocol), port)| Engine { name, port: port.name, line, protocol })
        .collect()
}
