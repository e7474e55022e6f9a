//! ST Nucleo-H743ZI2 (MB1364): no autopilot, but the cheapest board to try the firmware on.
//!
//! Clock, LED and USART3: Zephyr, `boards/st/nucleo_h743zi/nucleo_h743zi.dts`; the bypass also in ArduPilot's
//! `hwdef/NucleoH743/hwdef.dat`. Arduino's numbers of the pins: Mbed OS, `TARGET_NUCLEO_H743ZI2/PinNames.h`. The ports keep
//! off the pins of Ethernet (PA1, PA2, PA7, PB13, PC1, PC4, PC5) and of the LEDs (PB0, PE1, PB14).

use crate::board::Before::Floats;
use crate::board::{Board, Clock, Led, Level, Output, Port, PulseInputs, STM32H743ZI, Usb};

pub static BOARD: Board = Board {
    name: "nucleo-h743zi2",
    title: "Nucleo-H743ZI2",
    also: &[],
    chip: &STM32H743ZI,
    clock: Clock::External(8), // the ST-Link's MCO: it stops when the ST-Link has no power
    bootloader: None,
    ports: &[
        Port::new("D1 D0", "USART1", ["PB6", "PB7"], "TX on D1, RX on D0", Floats),
        Port::new("D53 D52", "USART2", ["PD5", "PD6"], "TX on D53, RX on D52", Floats),
        Port::new("D45 D46", "UART4", ["PC10", "PC11"], "TX on D45, RX on D46", Floats),
        Port::new("D47 D48", "UART5", ["PC12", "PD2"], "TX on D47, RX on D48", Floats),
        Port::new("D16 D21", "USART6", ["PC6", "PC7"], "TX on D16, RX on D21", Floats),
        Port::new("D42 D41", "UART7", ["PE8", "PE7"], "TX on D42, RX on D41", Floats),
    ],
    telemetry: Port::new("USB", "USART3", ["PD8", "PD9"], "the ST-Link's virtual COM port", Floats),
    radio: 4,
    socket: None,
    outputs: &[
        Output::new("PD15", "D9"),
        Output::new("PD14", "D10"),
        Output::new("PD13", "D28"),
        Output::new("PD12", "D29"),
        Output::new("PD11", "D30"),
        Output::new("PE12", "D39"),
        Output::new("PE10", "D40"),
        Output::new("PE15", "D37"),
    ],
    pulses: Some(PulseInputs { timer: "TIM4", interrupt: "TIM4", pins: ["PD12", "PD13", "PD14", "PD15"] }),
    supply: None,
    fram: None,
    usb: Usb::at("CN13, not the socket of the ST-Link"),
    led: Led { pin: "PB0", lit: Level::High, open_drain: false, label: "green, LD1" },
    hold: &[],
};
