//! The boards by their drawings: ports, pins and clocks. Written from the boards' documents, not from the
//! project's table in `boards/`, so that a mistake is not on both sides; a test compares the two.

use crate::fram::Fram;
use core::ops::Range;
use sim::line::Line;

/// A pin and the alternate function that connects it to its UART (datasheet, "alternate functions").
#[derive(Clone, Copy, Debug)]
pub struct Pin {
    /// GPIO port.
    pub port: char,
    /// Pin of that port.
    pub number: u8,
    /// Number of the alternate function.
    pub function: u8,
}

/// A serial port of a board.
#[derive(Clone, Copy, Debug)]
pub struct Port {
    /// The board's name for it, as ArduPilot counts.
    pub name: &'static str,
    /// The UART behind it.
    pub uart: Uart,
    /// Its clock in Hz.
    pub clock: u64,
    /// Receiving pin.
    pub rx: Pin,
    /// Sending pin.
    pub tx: Pin,
    /// TX while the board's bootloader runs.
    pub before: Before,
}

/// State of a port's TX in a bootloader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Before {
    /// Nothing: an input.
    Floats,
    /// Drives it low.
    Low,
    /// The port is its own (SERIAL_ORDER of its hwdef): high when idle.
    Own,
}

/// A status LED.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Led {
    /// GPIO port and number of its pin.
    pub pin: (char, u8),
    /// Level at which it lights.
    pub lit: bool,
    /// The pin drives low only.
    pub open_drain: bool,
}

/// A pin for the output of an engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Output {
    /// GPIO port and number.
    pub pin: (char, u8),
    /// The bootloader drives it low.
    pub low_before: bool,
}

/// Inputs for servo pulses, on channels 1 to 4 of a timer.
#[derive(Clone, Copy, Debug)]
pub struct Inputs {
    /// The timer.
    pub timer: Timer,
    /// Its pins (datasheet, "alternate functions").
    pub pins: [Pin; 4],
}

/// A socket for a receiver of radio control, with an inverter between it and its UART.
#[derive(Clone, Copy, Debug)]
pub struct Socket {
    /// Its port. The UART's TX pin has another use: nothing may drive it.
    pub port: Port,
    /// GPIO port and number of the pin that switches the inverter.
    pub inverter: (char, u8),
    /// Level of that pin which inverts.
    pub inverts_at: bool,
}

/// A timer that catches pulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "ST's names")]
pub enum Timer {
    Tim1,
    Tim4,
}

/// The supply in front of an analogue input of ADC1.
#[derive(Clone, Copy, Debug)]
pub struct Divider {
    /// GPIO port and number of the pin.
    pub pin: (char, u8),
    /// Number of the converter's channel (datasheet, "pin definitions").
    pub channel: u8,
    /// Supply voltage to voltage at the pin.
    pub ratio: u32,
}

/// An F-RAM on SPI2.
#[derive(Clone, Copy, Debug)]
pub struct FramBus {
    /// Clock, data from the chip, data to it.
    pub pins: [Pin; 3],
    /// GPIO port and number of the pin that selects it, low.
    pub select: (char, u8),
    /// The chip.
    pub chip: fn() -> Fram,
}

/// A UART, and the address of its registers; the same on both parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "ST's names")]
pub enum Uart {
    Usart1 = 0x4001_1000,
    Usart2 = 0x4000_4400,
    Usart3 = 0x4000_4800,
    Uart4 = 0x4000_4C00,
    Uart5 = 0x4000_5000,
    Usart6 = 0x4001_1400,
    Uart7 = 0x4000_7800,
    Uart8 = 0x4000_7C00,
}

impl Port {
    /// Where the UART's registers begin.
    pub fn registers(&self) -> u64 {
        self.uart as u64
    }

    /// The time of one byte in ns, if the UART's divider is the best one for this line.
    pub fn byte_ns(&self, line: Line) -> f64 {
        let baud = u64::from(line.baud);
        let divider = (self.clock + baud / 2) / baud;
        (line.bits_per_byte() * divider) as f64 * 1e9 / self.clock as f64
    }
}

/// The board's microcontroller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// STM32H743.
    H743,
    /// STM32F427.
    F427,
}

/// A board.
#[derive(Debug)]
pub struct Board {
    /// Its name, as in `cargo fw board-<name>`.
    pub name: &'static str,
    /// Its name in the firmware's log.
    pub title: &'static str,
    /// The part.
    pub part: Part,
    /// Frequency of its crystal, or of the clock in its place, in Hz.
    pub crystal: u64,
    /// An external clock replaces the crystal: the oscillator has to be bypassed.
    pub bypass: bool,
    /// Core clock in Hz. One instruction per cycle is the fastest that the part can be.
    pub core_hz: u64,
    /// The ECU ports, in the order of the firmware's table of engines.
    pub ports: &'static [Port],
    /// The port of MAVLink.
    pub telemetry: Port,
    /// Name of the ECU port that a receiver of radio control uses.
    pub radio: &'static str,
    /// Socket for a receiver alone, if it has one.
    pub socket: Option<Socket>,
    /// The UARTs can invert what they receive.
    pub inverts: bool,
    /// Outputs for valves and power, by number.
    pub outputs: &'static [Output],
    /// Inputs for servo pulses, if it has any.
    pub inputs: Option<Inputs>,
    /// Voltage divider of the supply, if the firmware can read it.
    pub divider: Option<Divider>,
    /// Memory of settings, if it is not in the part.
    pub fram: Option<FramBus>,
    /// The status LED.
    pub led: Led,
    /// Pins that the firmware drives from the start on, and their levels.
    pub held: &'static [(char, u8, bool)],
    /// Flash.
    pub flash: Range<u64>,
    /// Offset in it of an application behind ArduPilot's bootloader (FLASH_BOOTLOADER_LOAD_KB of the board's
    /// `hwdef-bl.dat`), if there is one for the board.
    pub behind_bootloader: Option<u64>,
    /// The RAM that the firmware uses.
    pub ram: Range<u64>,
    /// The RAM above it, of which 2 KiB are retained over a reset.
    pub above: Range<u64>,
    /// Registers of GPIO port A; 0x400 for each further one.
    pub gpio: u64,
    /// RCC_CR, which turns oscillators on.
    pub clock_control: u64,
    /// Registers of the independent watchdog.
    pub watchdog: u64,
    /// The first backup register.
    pub backup: u64,
    /// Registers that the part needs written, but the emulator does not have.
    pub not_modelled: Range<u64>,
    /// Offset of a UART's first control register.
    pub control_register: u64,
    /// Offset of the register with received bytes.
    pub receive_register: u64,
    /// Offset of the register for bytes to send.
    pub transmit_register: u64,
}

impl Board {
    /// The port of this name.
    ///
    /// # Panics
    /// If the board has none.
    pub fn port(&self, name: &str) -> &Port {
        let mut all = self.all_ports();
        all.find(|port| port.name == name).unwrap_or_else(|| panic!("{} has no port {name}", self.name))
    }

    /// The ECU ports, that of MAVLink, and that of the socket.
    pub fn all_ports(&self) -> impl Iterator<Item = &Port> {
        let socket = self.socket.iter().map(|socket| &socket.port);
        self.ports.iter().chain([&self.telemetry]).chain(socket)
    }

    /// Whether it is the first board of its part, which runs every image; the others run the release image.
    pub fn is_first_of_its_part(&self) -> bool {
        let first = BOARDS.into_iter().find(|board| board.part == self.part);
        first.is_some_and(|first| first.name == self.name)
    }

    /// The board of this name.
    pub fn by_name(name: &str) -> Option<&'static Board> {
        BOARDS.into_iter().find(|board| board.name == name)
    }
}

const fn pin(port: char, number: u8, function: u8) -> Pin {
    Pin { port, number, function }
}

const fn port(name: &'static str, uart: Uart, clock: u64, rx: Pin, tx: Pin) -> Port {
    Port { name, uart, clock, rx, tx, before: Before::Floats }
}

/// The same, with a bootloader that drives TX low.
const fn low(port: Port) -> Port {
    Port { before: Before::Low, ..port }
}

/// The same, with a bootloader whose own port it is.
const fn own(port: Port) -> Port {
    Port { before: Before::Own, ..port }
}

const fn led(port: char, number: u8, lit: bool, open_drain: bool) -> Led {
    Led { pin: (port, number), lit, open_drain }
}

const fn output(port: char, number: u8) -> Output {
    Output { pin: (port, number), low_before: false }
}

/// The same, with a bootloader that drives it low.
const fn low_output(port: char, number: u8) -> Output {
    Output { pin: (port, number), low_before: true }
}

const MHZ: u64 = 1_000_000;

/// Channels 1 to 4 of TIM4 of an H743.
const TIM4: Inputs =
    Inputs { timer: Timer::Tim4, pins: [pin('D', 12, 2), pin('D', 13, 2), pin('D', 14, 2), pin('D', 15, 2)] };

/// Channels 1 to 4 of TIM1 of an F427.
const TIM1: Inputs =
    Inputs { timer: Timer::Tim1, pins: [pin('E', 9, 1), pin('E', 11, 1), pin('E', 13, 1), pin('E', 14, 1)] };

/// Values shared by the boards with an H743, as on the Matek.
const H743: Board = Board {
    name: "matek-h743",
    title: "Matek H743-WING",
    part: Part::H743,
    crystal: 8 * MHZ,
    bypass: false,
    core_hz: 400 * MHZ,
    ports: &[
        port("SERIAL2", Uart::Usart1, 100 * MHZ, pin('A', 10, 7), pin('A', 9, 7)),
        port("SERIAL3", Uart::Usart2, 100 * MHZ, pin('D', 6, 7), pin('D', 5, 7)),
        port("SERIAL4", Uart::Usart3, 100 * MHZ, pin('D', 9, 7), pin('D', 8, 7)),
        port("SERIAL5", Uart::Uart8, 100 * MHZ, pin('E', 0, 8), pin('E', 1, 8)),
        port("SERIAL6", Uart::Uart4, 100 * MHZ, pin('B', 8, 8), pin('B', 9, 8)),
        port("SERIAL7", Uart::Usart6, 100 * MHZ, pin('C', 7, 7), pin('C', 6, 7)),
    ],
    telemetry: own(port("SERIAL1", Uart::Uart7, 100 * MHZ, pin('E', 7, 7), pin('E', 8, 7))),
    radio: "SERIAL7",
    socket: None,
    inverts: true,
    // S1 to S12
    outputs: &[
        output('B', 0),
        output('B', 1),
        output('A', 0),
        output('A', 1),
        output('A', 2),
        output('A', 3),
        output('D', 12),
        output('D', 13),
        output('D', 14),
        output('D', 15),
        output('E', 5),
        output('E', 6),
    ],
    inputs: Some(TIM4),
    // ADC123_INP10
    divider: Some(Divider { pin: ('C', 0), channel: 10, ratio: 11 }),
    fram: None,
    led: led('E', 3, false, false),
    held: &[('E', 9, false)], // RTS of SERIAL1
    flash: 0x0800_0000..0x0820_0000,
    behind_bootloader: Some(0x0802_0000),
    ram: 0x2400_0000..0x2407_E000,
    above: 0x2407_E000..0x2408_0000,
    gpio: 0x5802_0000,
    clock_control: 0x5802_4400,
    watchdog: 0x5800_4800,
    backup: 0x5800_4050,
    not_modelled: 0x5100_8108..0x5100_810C, // AXI_TARG7_FN_MOD: an erratum of revision Y
    control_register: 0x00,
    receive_register: 0x24,
    transmit_register: 0x28,
};

/// Matek H743-WING.
pub static MATEK_H743: Board = H743;

/// mRo Pixracer.
pub static PIXRACER: Board = Board {
    name: "pixracer",
    title: "mRo Pixracer",
    part: Part::F427,
    crystal: 24 * MHZ,
    bypass: false,
    core_hz: 168 * MHZ,
    ports: &[
        port("SERIAL2", Uart::Usart3, 42 * MHZ, pin('D', 9, 7), pin('D', 8, 7)),
        port("SERIAL3", Uart::Uart4, 42 * MHZ, pin('A', 1, 8), pin('A', 0, 8)),
        port("SERIAL4", Uart::Uart8, 42 * MHZ, pin('E', 0, 8), pin('E', 1, 8)),
        port("SERIAL5", Uart::Usart1, 84 * MHZ, pin('B', 7, 7), pin('B', 6, 7)),
        port("SERIAL6", Uart::Uart7, 42 * MHZ, pin('E', 7, 8), pin('E', 8, 8)),
    ],
    telemetry: own(port("SERIAL1", Uart::Usart2, 42 * MHZ, pin('D', 6, 7), pin('D', 5, 7))),
    radio: "SERIAL6",
    // RC_INPUT by an exclusive or with SBUS_INV; the high level inverts.
    socket: Some(Socket {
        port: port("RC IN", Uart::Usart6, 84 * MHZ, pin('C', 7, 8), pin('C', 6, 8)),
        inverter: ('C', 13),
        inverts_at: true,
    }),
    inverts: false,
    outputs: &[
        output('E', 14),
        output('E', 13),
        output('E', 11),
        output('E', 9),
        output('D', 13),
        output('D', 14),
    ],
    inputs: Some(TIM1),
    divider: None,
    fram: Some(FramBus {
        pins: [pin('B', 10, 5), pin('B', 14, 5), pin('B', 15, 5)],
        select: ('D', 10),
        chip: Fram::fm25v01a,
    }),
    led: led('B', 1, false, true),
    // VDD_PERIPH_EN, UART8_TXINV, 8266_PD, 8266_RST, RTS of SERIAL1, VDD_SENSORS_EN, BARO_CS
    held: &[
        ('C', 5, true),
        ('A', 10, true),
        ('E', 5, false),
        ('E', 6, false),
        ('D', 4, false),
        ('E', 3, true),
        ('D', 7, true),
    ],
    flash: 0x0800_0000..0x0820_0000,
    behind_bootloader: Some(0x0800_4000),
    ram: 0x2000_0000..0x2002_E000,
    above: 0x2002_E000..0x2003_0000,
    gpio: 0x4002_0000,
    clock_control: 0x4002_3800,
    watchdog: 0x4000_3000,
    backup: 0x4000_2850,
    not_modelled: 0x4001_3C00..0x4001_3C18, // EXTI: the line of the voltage detector
    control_register: 0x0C,
    receive_register: 0x04,
    transmit_register: 0x04,
};

/// Pixhawk 6C: sockets TELEM1 to TELEM3, GPS1, GPS2, FMU debug.
pub static PIXHAWK_6C: Board = Board {
    name: "pixhawk-6c",
    title: "Holybro Pixhawk 6C",
    crystal: 16 * MHZ,
    ports: &[
        own(port("SERIAL2", Uart::Uart5, 100 * MHZ, pin('D', 2, 8), pin('C', 12, 8))),
        low(port("SERIAL3", Uart::Usart1, 100 * MHZ, pin('A', 10, 7), pin('B', 6, 7))),
        low(port("SERIAL4", Uart::Uart8, 100 * MHZ, pin('E', 0, 8), pin('E', 1, 8))),
        low(port("SERIAL5", Uart::Usart2, 100 * MHZ, pin('A', 3, 7), pin('D', 5, 7))),
        own(port("SERIAL6", Uart::Usart3, 100 * MHZ, pin('D', 9, 7), pin('D', 8, 7))),
    ],
    telemetry: own(port("SERIAL1", Uart::Uart7, 100 * MHZ, pin('E', 7, 7), pin('E', 8, 7))),
    radio: "SERIAL5",
    // FMU PWM OUT
    outputs: &[
        low_output('A', 8),
        low_output('E', 11),
        low_output('E', 13),
        low_output('E', 14),
        low_output('D', 14),
        low_output('D', 15),
        low_output('A', 0),
        low_output('A', 1),
    ],
    inputs: None,
    divider: None,
    // Its size is unknown: ArduPilot stores 32 KiB or more.
    fram: Some(FramBus {
        pins: [pin('D', 3, 5), pin('C', 2, 5), pin('C', 3, 5)],
        select: ('D', 4),
        chip: Fram::fm25v20a,
    }),
    led: led('D', 11, false, true),
    // nVDD_5V_HIPOWER_EN, nVDD_5V_PERIPH_EN, HEATER_EN, RTS of SERIAL1, VDD_3V3_SENSORS1_EN
    held: &[('C', 10, false), ('E', 2, false), ('B', 9, false), ('E', 9, false), ('B', 2, true)],
    ..H743
};

/// Cube Orange: sockets TELEM1, TELEM2, GPS1, GPS2, CONS of the carrier board.
pub static CUBE_ORANGE: Board = Board {
    name: "cube-orange",
    title: "CubePilot Cube Orange",
    crystal: 24 * MHZ,
    ports: &[
        own(port("SERIAL2", Uart::Usart3, 100 * MHZ, pin('D', 9, 7), pin('D', 8, 7))),
        port("SERIAL3", Uart::Uart4, 100 * MHZ, pin('A', 1, 8), pin('A', 0, 8)),
        port("SERIAL4", Uart::Uart8, 100 * MHZ, pin('E', 0, 8), pin('E', 1, 8)),
        own(port("SERIAL5", Uart::Uart7, 100 * MHZ, pin('E', 7, 7), pin('E', 8, 7))),
    ],
    telemetry: own(port("SERIAL1", Uart::Usart2, 100 * MHZ, pin('D', 6, 7), pin('D', 5, 7))),
    radio: "SERIAL4",
    outputs: &[],
    inputs: None,
    divider: None,
    led: led('E', 12, false, true),
    // nVDD_5V_PERIPH_EN, VDD_3V3_SENSORS_EN, RTS of SERIAL1
    held: &[('A', 8, false), ('E', 3, false), ('D', 4, false)],
    ..H743
};

/// Nucleo-H743ZI2: Arduino's numbers, TX first.
pub static NUCLEO_H743ZI2: Board = Board {
    name: "nucleo-h743zi2",
    title: "Nucleo-H743ZI2",
    bypass: true,
    held: &[],
    ports: &[
        port("D1 D0", Uart::Usart1, 100 * MHZ, pin('B', 7, 7), pin('B', 6, 7)),
        port("D53 D52", Uart::Usart2, 100 * MHZ, pin('D', 6, 7), pin('D', 5, 7)),
        port("D45 D46", Uart::Uart4, 100 * MHZ, pin('C', 11, 8), pin('C', 10, 8)),
        port("D47 D48", Uart::Uart5, 100 * MHZ, pin('D', 2, 8), pin('C', 12, 8)),
        port("D16 D21", Uart::Usart6, 100 * MHZ, pin('C', 7, 7), pin('C', 6, 7)),
        port("D42 D41", Uart::Uart7, 100 * MHZ, pin('E', 7, 7), pin('E', 8, 7)),
    ],
    telemetry: port("USB", Uart::Usart3, 100 * MHZ, pin('D', 9, 7), pin('D', 8, 7)),
    radio: "D16 D21",
    // D9, D10, D28, D29, D30, D39, D40, D37
    outputs: &[
        output('D', 15),
        output('D', 14),
        output('D', 13),
        output('D', 12),
        output('D', 11),
        output('E', 12),
        output('E', 10),
        output('E', 15),
    ],
    divider: None,
    led: led('B', 0, true, false),
    behind_bootloader: None,
    ..H743
};

/// All boards. The first of each part runs every image.
pub static BOARDS: [&Board; 5] = [&MATEK_H743, &PIXRACER, &PIXHAWK_6C, &CUBE_ORANGE, &NUCLEO_H743ZI2];
