//! CubePilot Cube Orange (not Orange+, which has another chip) on a carrier board with five serial sockets.
//!
//! Pins: ArduPilot, `libraries/AP_HAL_ChibiOS/hwdef/CubeOrange/hwdef.inc` and `hwdef-bl.inc`. Older bootloaders
//! (`hwdef-bl.dat` of 2019) listen on UART7 only, and leave the other TX pins floating.

use crate::board::Before::{Floats, Listens};
use crate::board::{Board, Bootloader, Clock, Led, Level, Port, STM32H743VI, TELEMETRY_RTS, Usb, low};

pub static BOARD: Board = Board {
    name: "cube-orange",
    title: "CubePilot Cube Orange",
    also: &[],
    chip: &STM32H743VI,
    clock: Clock::Crystal(24),
    bootloader: Some(Bootloader { of: "ArduPilot's", board_id: 140, load_kib: 128, reserved_kib: 0 }),
    ports: &[
        Port::new("SERIAL2", "USART3", ["PD8", "PD9"], "TELEM2", Listens),
        Port::new("SERIAL3", "UART4", ["PA0", "PA1"], "GPS1", Floats),
        Port::new("SERIAL4", "UART8", ["PE1", "PE0"], "GPS2", Floats),
        Port::new("SERIAL5", "UART7", ["PE8", "PE7"], "CONS (ADS-B carriers: their receiver)", Listens),
    ],
    // CTS is PD3.
    telemetry: Port::new("SERIAL1", "USART2", ["PD5", "PD6"], "TELEM1", Listens),
    // Its sockets for receivers hang on the IO processor. GPS2: the bootloader does not listen there.
    radio: 2,
    socket: None,
    // PWM(1) to PWM(6) of hwdef.inc are known, but a level shifter that PB4 switches (PWM_VOLT_SEL) lies between them and their
    // sockets. What it puts out while its input floats is not known, and no pull-down at the socket reaches that input.
    outputs: &[],
    pulses: None,
    supply: None,
    // It has one on SPI2, but its supply may be that of the sensors, which is off here.
    fram: None,
    usb: Usb::at("the socket of the cube"),
    led: Led { pin: "PE12", lit: Level::Low, open_drain: true, label: "amber, on the cube" },
    hold: &[
        low("PA8", "nVDD_5V_PERIPH_EN: 5 V on the sockets"),
        low("PE3", "VDD_3V3_SENSORS_EN: the sensors are off"),
        low("PD4", TELEMETRY_RTS),
    ],
};
