//! The ECUs that belong to the firmware's tables of engines (`src/config.rs`), with their lines. A separate copy,
//! not read from there, so that a difference is found.

use crate::board::{Board, Port};
use crate::image::Image;
use crate::wire::Far;
use sim::amt::EngineModel;
use sim::any::{AnyConfig, Protocol};
use sim::line::Line;
use sim::zk::Rate;

/// One engine.
#[derive(Clone, Debug)]
pub struct Engine {
    /// Its name in the firmware's log.
    pub name: &'static str,
    /// The board's port that it uses.
    pub port: &'static str,
    /// Its line.
    pub line: Line,
    /// The rate that the firmware sets, if the protocol has one. A ZK ECU starts at 20 Hz all the same.
    pub rate: Option<Rate>,
    config: AnyConfig,
}

impl Engine {
    /// Its protocol.
    pub fn protocol(&self) -> Protocol {
        self.config.protocol()
    }

    /// Its ECU.
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
        self.config.clone()
    }
}

fn table() -> [(&'static str, Line, AnyConfig, Option<Rate>); 6] {
    [
        ("left", Line::n1(2400), AnyConfig::amt(EngineModel::Olympus), None),
        ("right", Line::n1(2400), AnyConfig::amt(EngineModel::Titan), None),
        ("centre", Line::n1(9600), AnyConfig::zk(4), Some(Rate::Hz20)),
        ("booster", Line::n1(115_200), AnyConfig::zk(5), Some(Rate::Hz50)),
        ("upper", Line::n2(57_600), AnyConfig::zk(5), Some(Rate::Hz100)),
        ("tail", Line::n1(9600), AnyConfig::amt(EngineModel::Mercury), None),
    ]
}

/// The engines of an image, in the order of the board's ports, without that of a receiver.
pub fn of(board: &'static Board, image: Image) -> Vec<Engine> {
    let count = if image == Image::AllPorts { board.ports.len() } else { 4 };
    let ports =
        board.ports.iter().filter(|port| !image.has_outputs() || port.name != board.radio).take(count);
    let engine = |((name, line, config, rate), port): ((_, _, AnyConfig, _), &Port)| Engine {
        name,
        port: port.name,
        line,
        rate,
        config: config.on(line),
    };
    table().into_iter().zip(ports).map(engine).collect()
}

/// The engine of an image on this port.
///
/// # Panics
/// If there is none.
pub fn on(board: &'static Board, image: Image, port: &str) -> Engine {
    let engine = of(board, image).into_iter().find(|engine| engine.port == port);
    engine.unwrap_or_else(|| panic!("no engine is on {port}"))
}
