//! Which engine sits on which port. Change [`ENGINES`], build, flash.
//!
//! The table is checked while it is compiled (`jetlink::config::check`).

use jetlink::config::{EngineConfig, check};
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::Line;

/// The engines of this aircraft. `port` counts the board's ECU ports from 0: see
/// `docs/boards.md` for their names and pins.
#[cfg(not(feature = "all-ports"))]
pub const ENGINES: [EngineConfig; 4] = [
    //                name       port  line                    ECU
    EngineConfig::amt("left", 0, Line::new(2400), Some(EngineModel::Olympus)),
    EngineConfig::amt("right", 1, Line::new(2400), Some(EngineModel::Titan)),
    EngineConfig::zk("centre", 2, Line::new(9600), Rate::Hz20),
    EngineConfig::zk("booster", 3, Line::new(115_200), Rate::Hz50),
];

/// Bench only (feature `all-ports`): an engine on every port of the board, with every kind of line.
#[cfg(feature = "all-ports")]
pub const ENGINES: [EngineConfig; ports()] = {
    let six = [
        EngineConfig::amt("left", 0, Line::new(2400), Some(EngineModel::Olympus)),
        EngineConfig::amt("right", 1, Line::new(2400), Some(EngineModel::Titan)),
        EngineConfig::zk("centre", 2, Line::new(9600), Rate::Hz20),
        EngineConfig::zk("booster", 3, Line::new(115_200), Rate::Hz50),
        EngineConfig::zk("upper", 4, Line::with_two_stop_bits(57_600), Rate::Hz100),
        EngineConfig::amt("tail", 5, Line::new(9600), Some(EngineModel::Mercury)),
    ];
    match six.first_chunk() {
        Some(engines) => *engines,
        None => unreachable!(),
    }
};

/// Number of ports of the board (build.rs); without a board, the number of engines above.
#[cfg(feature = "all-ports")]
const fn ports() -> usize {
    match option_env!("JETLINK_PORTS") {
        Some(ports) => (ports.as_bytes()[0] - b'0') as usize,
        None => 6,
    }
}

const _: () = check(&ENGINES);
