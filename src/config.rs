//! Which engine sits on which port, and where a receiver of radio control is. Change [`ENGINES`] and [`RADIO`], build, flash.
//!
//! Both are checked while they are compiled (`jetlink::config::check`).

use jetlink::config::{EngineConfig, check, check_port_is_free};
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::Line;
use jetlink_rc::config::RadioConfig;

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

/// Line of the telemetry port, which carries MAVLink.
pub const TELEMETRY: Line = Line::new(57_600);

/// Receiver of radio control, on an ECU port without an engine, and what its channels do for each engine, in the order of
/// [`ENGINES`]: see `docs/rc.md`. For example `Some(RadioConfig::sbus(5, [EngineSettings::DEFAULT; ENGINES.len()]))`.
#[cfg(not(any(feature = "radio-sbus", feature = "radio-crsf")))]
pub const RADIO: Option<RadioConfig<{ ENGINES.len() }>> = None;

/// Test images only (features `radio-sbus` and `radio-crsf`): a receiver on the board's port for it.
#[cfg(any(feature = "radio-sbus", feature = "radio-crsf"))]
pub const RADIO: Option<RadioConfig<{ ENGINES.len() }>> = {
    use jetlink_rc::settings::EngineSettings;
    let engines = [EngineSettings::DEFAULT; ENGINES.len()];
    Some(if cfg!(feature = "radio-crsf") {
        RadioConfig::crsf(radio_port(), engines)
    } else {
        // Where the UARTs do not invert, an inverter is in the line.
        RadioConfig { inverted: cfg!(feature = "stm32h7"), ..RadioConfig::sbus(radio_port(), engines) }
    })
};

/// Port of the board for a receiver (build.rs); without a board, one that no engine has.
#[cfg(any(feature = "radio-sbus", feature = "radio-crsf"))]
const fn radio_port() -> u8 {
    match option_env!("JETLINK_RADIO_PORT") {
        Some(port) => port.as_bytes()[0] - b'0',
        None => 9,
    }
}

const _: () = check(&ENGINES);
const _: () = if let Some(radio) = RADIO {
    radio.check();
    check_port_is_free(&ENGINES, radio.port, "the receiver of radio control");
};
