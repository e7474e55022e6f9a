//! Matek H743-WING, and what shares its wiring.
//!
//! Pins: ArduPilot, `libraries/AP_HAL_ChibiOS/hwdef/MatekH743/hwdef.dat` and `hwdef-bl.dat`. There is one hwdef for -WING,
//! -SLIM, -MINI and -WLITE; PX4 has a board file for each, and those of -WING, -SLIM and -WLITE give the UARTs the same pins
//! (`boards/matek/h743*/nuttx-config/include/board.h`; that of -MINI was not at hand). The pads bear the number of the UART.

use crate::board::Before::{Floats, Listens};
use crate::board::{
    Board, Bootloader, Clock, Divider, Led, Level, Output, Port, PulseInputs, STM32H743VI, TELEMETRY_RTS,
    Usb, low,
};

pub static BOARD: Board = Board {
    name: "matek-h743",
    title: "Matek H743-WING",
    also: &["Matek H743-SLIM", "Matek H743-MINI", "Matek H743-WLITE"],
    chip: &STM32H743VI,
    clock: Clock::Crystal(8),
    // The last two sectors are its storage.
    bootloader: Some(Bootloader { of: "ArduPilot's", board_id: 1013, load_kib: 128, reserved_kib: 256 }),
    ports: &[
        Port::new("SERIAL2", "USART1", ["PA9", "PA10"], "pads TX1 RX1", Floats),
        Port::new("SERIAL3", "USART2", ["PD5", "PD6"], "pads TX2 RX2 (GPS1)", Floats),
        Port::new("SERIAL4", "USART3", ["PD8", "PD9"], "pads TX3 RX3 (GPS2)", Floats),
        Port::new("SERIAL5", "UART8", ["PE1", "PE0"], "pads TX8 RX8", Floats),
        Port::new("SERIAL6", "UART4", ["PB9", "PB8"], "pads TX4 RX4", Floats),
        Port::new("SERIAL7", "USART6", ["PC6", "PC7"], "pads TX6 RX6 (RC input)", Floats),
    ],
    // CTS is PE10.
    telemetry: Port::new("SERIAL1", "UART7", ["PE8", "PE7"], "pads TX7 RX7 CTS7 RTS7", Listens),
    // ArduPilot gives RX6 to a timer, and to the UART with BRD_ALT_CONFIG 1: no inverter is in between.
    radio: 5,
    socket: None,
    // PWM(1) to PWM(12) in hwdef.dat; hwdef-bl.dat does not mention them.
    outputs: &[
        Output::new("PB0", "pad S1"),
        Output::new("PB1", "pad S2"),
        Output::new("PA0", "pad S3"),
        Output::new("PA1", "pad S4"),
        Output::new("PA2", "pad S5"),
        Output::new("PA3", "pad S6"),
        Output::new("PD12", "pad S7"),
        Output::new("PD13", "pad S8"),
        Output::new("PD14", "pad S9"),
        Output::new("PD15", "pad S10"),
        Output::new("PE5", "pad S11"),
        Output::new("PE6", "pad S12"),
    ],
    // The pads' timer in hwdef.dat.
    pulses: Some(PulseInputs { timer: "TIM4", interrupt: "TIM4", pins: ["PD12", "PD13", "PD14", "PD15"] }),
    // BATT_VOLTAGE_SENS and HAL_BATT_VOLT_SCALE in hwdef.dat.
    supply: Some(Divider { pin: "PC0", tenths: 110, label: "the battery's, pad Vbat" }),
    fram: None,
    usb: Usb::at("the board's socket"),
    led: Led { pin: "PE3", lit: Level::Low, open_drain: false, label: "blue, marked ACT" }, // the green one is PE4
    hold: &[low("PE9", TELEMETRY_RTS)],
};
