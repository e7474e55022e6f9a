//! mRo Pixracer.
//!
//! Pins: ArduPilot, `libraries/AP_HAL_ChibiOS/hwdef/Pixracer/hwdef.dat` and `hwdef-bl.dat`.
//!
//! The LEDs light at a low level, and their pins are open drain: PX4, `boards/px4/fmu-v4/src/led.c` ("Pull Down to switch
//! on") and `board_config.h` (GPIO_OPENDRAIN); Paparazzi, `sw/airborne/boards/px4fmu_4.0.h`; ArduPilot's firmware, which
//! leaves HAL_GPIO_LED_ON at its default, 0. Only its bootloader has HAL_LED_ON 1 (`hwdef-bl.dat`): there the LEDs are on
//! where they should be off.

use crate::board::Before::{Floats, Listens};
use crate::board::{
    Board, Bootloader, Clock, Fram, Led, LeftAlone, Level, Output, Port, PulseInputs, STM32F427VI, Socket,
    TELEMETRY_RTS, Usb, high, low,
};

pub static BOARD: Board = Board {
    name: "pixracer",
    title: "mRo Pixracer",
    also: &[],
    chip: &STM32F427VI,
    clock: Clock::Crystal(24),
    bootloader: Some(Bootloader { of: "ArduPilot's", board_id: 11, load_kib: 16, reserved_kib: 0 }),
    ports: &[
        Port::new("SERIAL2", "USART3", ["PD8", "PD9"], "TELEM2", Floats),
        Port::new("SERIAL3", "UART4", ["PA0", "PA1"], "GPS", Floats),
        Port::new("SERIAL4", "UART8", ["PE1", "PE0"], "FrSky", Floats)
            .inverter(high("PA10", "UART8_TXINV: TX of the FrSky socket is not inverted")),
        Port::new("SERIAL5", "USART1", ["PB6", "PB7"], "WiFi (ESP8266)", Floats),
        Port::new("SERIAL6", "UART7", ["PE8", "PE7"], "debug", Floats),
    ],
    // CTS is PD3.
    telemetry: Port::new("SERIAL1", "USART2", ["PD5", "PD6"], "TELEM1", Listens),
    radio: 4,
    // hwdef.dat has "also USART6_RX for serial RC" at PC7, which ArduPilot itself uses as an input of a timer.
    //
    // The level of PC13 (SBUS_INV), from two independent sources that agree:
    // - PX4, `boards/px4/fmu-v4/src/board_config.h`: the inverter is a 74LVC2G86 (exclusive or), "active high", and
    //   RC_INVERT_INPUT(true), for SBUS, drives it high; low for all else (`src/drivers/rc_input/RCInput.cpp`).
    // - ArduPilot holds it low (hwdef.dat), and decodes inverted SBUS from the pulses at PC7 (`AP_RCProtocol_SBUS.cpp`,
    //   SERIAL_CONFIG_8E2I): low does not invert.
    // An older PX4 has a comment for boards R07, on which the low level inverts; its code and its comment for R12 are as here.
    //
    // PC6 is TX of that UART, and drives a heater high on (PX4, GPIO_HEATER_OUTPUT, "Power down the heater": low). hwdef.dat does
    // not have it, so ArduPilot leaves it a floating input, and so does this firmware: an output that idles high would heat. An older
    // PX4 has it as GPIO_RC_OUT, "serial RC output", to bind receivers.
    //
    // PB0 seems to be at the same socket: PX4 receives PPM there (GPIO_PPM_IN), and both use it to bind a Spektrum receiver. It stays an
    // input, as does PE4, which powers Spektrum receivers (SPEKTRUM_PWR).
    socket: Some(Socket {
        name: "RC IN",
        uart: "USART6",
        rx: "PC7",
        never_driven: LeftAlone { pin: "PC6", why: "it switches a heater" },
        inverter: "PC13",
        inverts_at: Level::High,
        signal: "SBUS_INV",
    }),
    // PWM(1) to PWM(6) in hwdef.dat; hwdef-bl.dat does not mention them.
    outputs: &[
        Output::new("PE14", "servo output 1"),
        Output::new("PE13", "servo output 2"),
        Output::new("PE11", "servo output 3"),
        Output::new("PE9", "servo output 4"),
        Output::new("PD13", "servo output 5"),
        Output::new("PD14", "servo output 6"),
    ],
    // PWM(4) to PWM(1) in hwdef.dat.
    pulses: Some(PulseInputs { timer: "TIM1", interrupt: "TIM1_CC", pins: ["PE9", "PE11", "PE13", "PE14"] }),
    supply: None,
    // SCK was PB13 on beta boards (hwdef.dat).
    fram: Some(Fram { spi: "SPI2", sck: "PB10", miso: "PB14", mosi: "PB15", select: "PD10" }),
    usb: Usb::at("the board's socket"),
    led: Led { pin: "PB1", lit: Level::Low, open_drain: true, label: "green" }, // red is PB11, blue is PB3
    hold: &[
        high("PC5", "VDD_PERIPH_EN: 5 V on the ports' sockets"),
        low("PE5", "8266_PD: a WiFi module is off"),
        low("PE6", "8266_RST: it stays off its port's RX"),
        low("PD4", TELEMETRY_RTS),
        high("PE3", "VDD_SENSORS_EN: supply of the sensors and of the F-RAM"),
        high("PD7", "BARO_CS: the barometer is off the bus of the F-RAM"),
    ],
};
