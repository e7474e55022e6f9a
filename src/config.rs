//! Which engine sits on which port, where a receiver of radio control is, and which pins drive fuel valves. Change [`ENGINES`], [`RADIO`]
//! and [`OUTPUTS`], build, flash.
//!
//! They are checked while they are compiled (`jetlink::config::check`).

use jetlink::config::{EngineConfig, check, check_port_is_free};
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::Line;
#[cfg(target_os = "none")]
use jetlink_mavlink::settings::{EngineSettings as MavlinkSettings, NodeSettings, check as check_mavlink};
use jetlink_rc::config::RadioConfig;
use jetlink_rc::wiring::{OutputConfig, OutputPin, check_free, check_outputs};

/// The engines of this aircraft. `port` counts the board's ECU ports from 0: see
/// `docs/boards.md` for their names and pins.
#[cfg(not(any(feature = "all-ports", feature = "radio-sbus")))]
pub const ENGINES: [EngineConfig; 4] = [
    //                name       port  line                    ECU
    EngineConfig::amt("left", 0, Line::new(2400), Some(EngineModel::Olympus)),
    EngineConfig::amt("right", 1, Line::new(2400), Some(EngineModel::Titan)),
    EngineConfig::zk("centre", 2, Line::new(9600), Rate::Hz20),
    EngineConfig::zk("booster", 3, Line::new(115_200), Rate::Hz50),
];

/// Bench and test images only. Feature `all-ports`: an engine on every port of the board, with every kind of line. Feature `radio-sbus`,
/// which every image with a receiver has: the engines above, on the board's first ports without that of the receiver. A Cube Orange has
/// only three of these.
#[cfg(any(feature = "all-ports", feature = "radio-sbus"))]
pub const ENGINES: [EngineConfig; count()] = {
    let mut six = [
        EngineConfig::amt("left", 0, Line::new(2400), Some(EngineModel::Olympus)),
        EngineConfig::amt("right", 1, Line::new(2400), Some(EngineModel::Titan)),
        EngineConfig::zk("centre", 2, Line::new(9600), Rate::Hz20),
        EngineConfig::zk("booster", 3, Line::new(115_200), Rate::Hz50),
        EngineConfig::zk("upper", 4, Line::with_two_stop_bits(57_600), Rate::Hz100),
        EngineConfig::amt("tail", 5, Line::new(9600), Some(EngineModel::Mercury)),
    ];
    let mut after = radio_port() as usize;
    while cfg!(feature = "radio-sbus") && after < six.len() {
        six[after].port += 1;
        after += 1;
    }
    match six.first_chunk() {
        Some(engines) => *engines,
        None => unreachable!(),
    }
};

/// Number of the engines above, from that of the ports of the board (build.rs): six without a board.
#[cfg(any(feature = "all-ports", feature = "radio-sbus"))]
const fn count() -> usize {
    let ports = match option_env!("JETLINK_PORTS") {
        Some(ports) => (ports.as_bytes()[0] - b'0') as usize,
        None => 6,
    };
    let free = ports - cfg!(feature = "radio-sbus") as usize;
    if cfg!(feature = "all-ports") || free < 4 { free } else { 4 }
}

/// Line of the telemetry port, which carries MAVLink.
pub const TELEMETRY: Line = Line::new(57_600);

/// MAVLink settings of the node: defaults of its parameters that begin with `MAV_` (`docs/mavlink.md`). The baud rate is that of [`TELEMETRY`].
#[cfg(target_os = "none")]
pub const MAVLINK: NodeSettings = NodeSettings::DEFAULT;

/// MAVLink settings of each engine, in the order of [`ENGINES`], for example another output of the autopilot for each.
#[cfg(target_os = "none")]
pub const MAVLINK_ENGINES: [MavlinkSettings; ENGINES.len()] = [MavlinkSettings::DEFAULT; ENGINES.len()];

/// Receiver of radio control, on an ECU port without an engine or on the board's socket for one, and what its channels do for each engine, in
/// the order of [`ENGINES`]: see `docs/rc.md`. For example `Some(RadioConfig::sbus(5, [EngineSettings::DEFAULT; ENGINES.len()]))`.
#[cfg(not(any(feature = "radio-sbus", feature = "radio-crsf", feature = "radio-pwm")))]
pub const RADIO: Option<RadioConfig<{ ENGINES.len() }>> = None;

/// Test images only (features `radio-sbus`, `radio-crsf` and `radio-pwm`): a receiver on the board's port for it, on its socket (feature
/// `radio-socket`), or on its inputs for servo pulses.
#[cfg(any(feature = "radio-sbus", feature = "radio-crsf", feature = "radio-pwm"))]
pub const RADIO: Option<RadioConfig<{ ENGINES.len() }>> = {
    use jetlink_rc::settings::EngineSettings;
    let engines = [EngineSettings::DEFAULT; ENGINES.len()];
    Some(if cfg!(feature = "radio-pwm") {
        RadioConfig::pwm([EngineSettings::PULSES; ENGINES.len()])
    } else if cfg!(feature = "radio-crsf") {
        RadioConfig::crsf(receiver_port(), engines)
    } else {
        // Where neither the UARTs nor the board inverts, an inverter is in the line.
        let inverted = cfg!(any(feature = "stm32h7", feature = "radio-socket"));
        RadioConfig { inverted, ..RadioConfig::sbus(receiver_port(), engines) }
    })
};

/// Port of the receiver: the board's for one, or with the feature `radio-socket` its socket, which has the number behind its ECU ports.
#[cfg(any(feature = "radio-sbus", feature = "radio-crsf", feature = "radio-pwm"))]
const fn receiver_port() -> u8 {
    match option_env!("JETLINK_PORTS") {
        Some(ports) if cfg!(feature = "radio-socket") => ports.as_bytes()[0] - b'0',
        _ => radio_port(),
    }
}

/// Port of the board for a receiver (build.rs); without a board, one that no engine has.
#[cfg(any(feature = "all-ports", feature = "radio-sbus"))]
const fn radio_port() -> u8 {
    match option_env!("JETLINK_RADIO_PORT") {
        Some(port) => port.as_bytes()[0] - b'0',
        None => 9,
    }
}

/// Fuel valve and power of starter and ignition of each engine, in the order of [`ENGINES`], on outputs of the board: see `docs/rc.md`,
/// and `docs/boards.md` for their pins. For example `Some([OutputConfig::valve(OutputPin::high(0)), OutputConfig::NONE, …])`.
#[cfg(not(feature = "outputs"))]
pub const OUTPUTS: Option<[OutputConfig; ENGINES.len()]> = None;

/// Test images only (feature `outputs`): a valve for each engine on the first outputs of the board that are not inputs, power on the next
/// ones, as far as there are any. With the last engine the low level energises, unless the bootloader drives the outputs low.
#[cfg(feature = "outputs")]
pub const OUTPUTS: Option<[OutputConfig; ENGINES.len()]> = {
    let mut engines = [OutputConfig::NONE; ENGINES.len()];
    let mut i = 0;
    while i < ENGINES.len() {
        let low = i == ENGINES.len() - 1 && option_env!("JETLINK_OUTPUTS_LOW_BEFORE").is_none();
        if let Some(number) = output(i) {
            engines[i] = OutputConfig::valve(OutputPin { number, low });
        }
        if let Some(number) = output(ENGINES.len() + i) {
            engines[i] = engines[i].with_power(OutputPin { number, low });
        }
        i += 1;
    }
    Some(engines)
};

/// Number of an output of the board that is not an input (build.rs); without a board there are two for each engine.
#[cfg(feature = "outputs")]
const fn output(place: usize) -> Option<u8> {
    match option_env!("JETLINK_OUTPUTS") {
        Some(outputs) if 2 * place < outputs.len() => {
            let digits = outputs.as_bytes();
            Some((digits[2 * place] - b'0') * 10 + digits[2 * place + 1] - b'0')
        }
        None if place < 2 * ENGINES.len() => Some(place as u8),
        _ => None,
    }
}

/// Whether the board's divider measures the supply voltage (`docs/boards.md` has the boards with one). It is used for engines whose ECU
/// reports none: for the interlock `start.supply_min` and the limit `limits.supply_low`, which are off by default.
pub const SUPPLY: bool = cfg!(feature = "supply");

/// An active buzzer on an output of the board, which beeps as the status LED flashes ([README](../README.md#the-status-led)), but not
/// while all is well. For example `Some(OutputPin::high(11))`.
#[cfg(not(feature = "outputs"))]
pub const BUZZER: Option<OutputPin> = None;

/// Test images only (feature `outputs`): the last output, where one is left.
#[cfg(feature = "outputs")]
pub const BUZZER: Option<OutputPin> = {
    let (mut last, mut place) = (None, 2 * ENGINES.len());
    while let Some(number) = output(place) {
        last = Some(OutputPin::high(number));
        place += 1;
    }
    last
};

const _: () = check(&ENGINES);
#[cfg(target_os = "none")]
const _: () = check_mavlink(&MAVLINK, &MAVLINK_ENGINES);
const _: () = if let Some(outputs) = OUTPUTS {
    check_outputs(&outputs);
    if let Some(buzzer) = BUZZER {
        check_free(&outputs, &[buzzer.number], "this output is the buzzer's");
    }
};
const _: () = if let Some(radio) = RADIO {
    radio.check();
    if let Some(port) = radio.uart() {
        check_port_is_free(&ENGINES, port, "the receiver of radio control");
    }
};
