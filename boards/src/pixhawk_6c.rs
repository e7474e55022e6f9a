//! Holybro Pixhawk 6C.
//!
//! Pins: ArduPilot, `libraries/AP_HAL_ChibiOS/hwdef/Pixhawk6C/hwdef.dat` and `hwdef-bl.dat`. Many are sold with PX4's
//! bootloader: the same place for the application and the same number (PX4, `boards/px4/fmu-v6c/src/hw_config.h`). It listens
//! on TELEM1 and leaves the other TX pins floating; this table describes ArduPilot's, which is the worse one.

use crate::board::Before::{DrivenLow, Listens};
use crate::board::{
    Board, Bootloader, Clock, Fram, Led, Level, Output, Port, STM32H743VI, TELEMETRY_RTS, Usb, high, low,
};

pub static BOARD: Board = Board {
    name: "pixhawk-6c",
    title: "Holybro Pixhawk 6C",
    also: &[],
    chip: &STM32H743VI,
    clock: Clock::Crystal(16),
    bootloader: Some(Bootloader { of: "ArduPilot's or PX4's", board_id: 56, load_kib: 128, reserved_kib: 0 }),
    // DEFAULTGPIO OUTPUT LOW PULLDOWN in hwdef-bl.dat: what it does not list is driven low.
    ports: &[
        Port::new("SERIAL2", "UART5", ["PC12", "PD2"], "TELEM2", Listens),
        Port::new("SERIAL3", "USART1", ["PB6", "PA10"], "GPS1", DrivenLow),
        Port::new("SERIAL4", "UART8", ["PE1", "PE0"], "GPS2", DrivenLow),
        Port::new("SERIAL5", "USART2", ["PD5", "PA3"], "TELEM3", DrivenLow),
        Port::new("SERIAL6", "USART3", ["PD8", "PD9"], "FMU debug", Listens),
    ],
    // CTS is PE10.
    telemetry: Port::new("SERIAL1", "UART7", ["PE8", "PE7"], "TELEM1", Listens),
    // Its sockets for receivers hang on the IO processor. TELEM3: the bootloader does not listen there.
    radio: 3,
    socket: None,
    // PWM(1) to PWM(8) in hwdef.dat. The other eight outputs of the board hang on its IO processor.
    outputs: &[
        Output::low_before("PA8", "FMU PWM OUT 1"),
        Output::low_before("PE11", "FMU PWM OUT 2"),
        Output::low_before("PE13", "FMU PWM OUT 3"),
        Output::low_before("PE14", "FMU PWM OUT 4"),
        Output::low_before("PD14", "FMU PWM OUT 5"),
        Output::low_before("PD15", "FMU PWM OUT 6"),
        Output::low_before("PA0", "FMU PWM OUT 7"),
        Output::low_before("PA1", "FMU PWM OUT 8"),
    ],
    // The bootloader drives these pins low, against a receiver.
    pulses: None,
    supply: None,
    fram: Some(Fram { spi: "SPI2", sck: "PD3", miso: "PC2", mosi: "PC3", select: "PD4" }),
    usb: Usb::at("the board's socket"),
    led: Led { pin: "PD11", lit: Level::Low, open_drain: true, label: "blue" }, // red is PD10
    hold: &[
        low("PC10", "nVDD_5V_HIPOWER_EN: 5 V on the sockets"),
        low("PE2", "nVDD_5V_PERIPH_EN: 5 V on the sockets"),
        low("PB9", "HEATER_EN: the heater of the IMU is off"),
        low("PE9", TELEMETRY_RTS),
        // Which supply the F-RAM has is not in hwdef.dat. ArduPilot reads it with this one on.
        high("PB2", "VDD_3V3_SENSORS1_EN: supply of the sensors, and maybe of the F-RAM"),
    ],
};
