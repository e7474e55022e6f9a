//! mRo Pixracer: STM32F427VI, 24 MHz crystal, 168 MHz core.
//!
//! Pins from ArduPilot, `libraries/AP_HAL_ChibiOS/hwdef/Pixracer/hwdef.dat`.

use super::{
    Board, Led, Oscillator, Watchdog, early,
    port::{ecu_uarts, open},
};
use embassy_stm32::{
    Config, Peri,
    gpio::{Level, Output, Pin, Speed},
    pac::{GPIOA, GPIOB, GPIOD, GPIOE, gpio::Gpio},
    rcc::{
        AHBPrescaler, APBPrescaler, Hse, HseMode, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv, PllSource, Sysclk,
    },
    time::Hertz,
};
use jetlink::line::Line;

/// The board's name.
pub const NAME: &str = "mRo Pixracer";

/// What ArduPilot's bootloader calls the board (hwdef-bl.dat, APJ_BOARD_ID).
#[cfg(feature = "ardupilot-bootloader")]
pub const APJ_BOARD_ID: u16 = 11;

/// The ECU ports by number, from 0, in the order of ArduPilot's SERIALn.
pub const PORTS: [&str; 5] = [
    "SERIAL2, USART3, TELEM2",
    "SERIAL3, UART4, GPS",
    "SERIAL4, UART8, FrSky",
    "SERIAL5, USART1, WiFi (ESP8266)",
    "SERIAL6, UART7, debug",
];

/// Kept free for MAVLink: USART2, PD5 TX, PD6 RX, PD3 CTS, PD4 RTS.
pub const TELEMETRY_PORT: &str = "SERIAL1, USART2, TELEM1";

/// The TX pins of `PORTS`, as `init` gives them to the UARTs.
const TX: [(Gpio, usize); PORTS.len()] = [(GPIOD, 8), (GPIOA, 0), (GPIOE, 1), (GPIOB, 6), (GPIOE, 8)];

ecu_uarts!(USART1, USART3, UART4, UART7, UART8);

/// Starts the clocks and opens the ports that have a line. To be called once.
pub fn init(lines: [Option<Line>; PORTS.len()]) -> Board {
    let early = early::begin(&TX, false);
    let p = embassy_stm32::init(clocks(early.oscillator));
    early::finish(early);

    hold(p.PC5, Level::High); // VDD_PERIPH_EN: 5 V on the ports' sockets
    hold(p.PA10, Level::High); // UART8_TXINV: high, TX of the FrSky socket is not inverted
    hold(p.PE5, Level::Low); // 8266_PD: low, a WiFi module is off
    hold(p.PE6, Level::Low); // 8266_RST: low, and stays off its port's RX

    let [serial2, serial3, serial4, serial5, serial6] = lines;
    Board {
        reset_cause: early.cause,
        oscillator: early.oscillator,
        ports: [
            open(serial2, p.USART3, p.PD9, p.PD8, Irqs),
            open(serial3, p.UART4, p.PA1, p.PA0, Irqs),
            open(serial4, p.UART8, p.PE0, p.PE1, Irqs),
            open(serial5, p.USART1, p.PB7, p.PB6, Irqs),
            open(serial6, p.UART7, p.PE7, p.PE8, Irqs),
        ],
        led: Led::new(p.PB1), // green; red is PB11, blue is PB3
        watchdog: Watchdog::new(p.IWDG),
    }
}

/// Drives a pin for good.
fn hold(pin: Peri<'static, impl Pin>, level: Level) {
    core::mem::forget(Output::new(pin, level, Speed::Low)); // dropped, it would let go of the pin
}

/// 336 MHz PLL from the 24 MHz crystal or from the chip's own 16 MHz, 168 MHz core, 42 MHz (APB1) and 84 MHz (APB2) for
/// UARTs.
fn clocks(oscillator: Oscillator) -> Config {
    let mut config = Config::default();
    let (source, prediv) = match oscillator {
        Oscillator::Crystal => {
            config.rcc.hse = Some(Hse { freq: Hertz(24_000_000), mode: HseMode::Oscillator });
            (PllSource::HSE, PllPreDiv::DIV24)
        }
        Oscillator::Internal => (PllSource::HSI, PllPreDiv::DIV16),
    };
    config.rcc.pll_src = source;
    config.rcc.pll = Some(Pll {
        prediv,
        mul: PllMul::MUL336,
        divp: Some(PllPDiv::DIV2),
        divq: Some(PllQDiv::DIV7),
        divr: None,
    });
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV1;
    config.rcc.apb1_pre = APBPrescaler::DIV4;
    config.rcc.apb2_pre = APBPrescaler::DIV2;
    config
}
