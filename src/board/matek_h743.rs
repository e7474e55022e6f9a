//! Matek H743-WING: STM32H743VI, 8 MHz crystal, 400 MHz core.
//!
//! Pins from ArduPilot, `libraries/AP_HAL_ChibiOS/hwdef/MatekH743/hwdef.dat`. The board's pads bear
//! the number of the UART: TX1 and RX1 are USART1.

use super::{
    Board, Led, Oscillator, Watchdog, early,
    port::{ecu_uarts, open},
};
use embassy_stm32::{
    Config,
    pac::{GPIOA, GPIOB, GPIOC, GPIOD, GPIOE, gpio::Gpio},
    rcc::{
        AHBPrescaler, APBPrescaler, Hse, HseMode, LsConfig, Pll, PllDiv, PllMul, PllPreDiv, PllSource,
        Sysclk, VoltageScale,
    },
    time::Hertz,
};
use jetlink::line::Line;

/// The board's name.
pub const NAME: &str = "Matek H743-WING";

/// What ArduPilot's bootloader calls the board (hwdef-bl.dat, APJ_BOARD_ID).
#[cfg(feature = "ardupilot-bootloader")]
pub const APJ_BOARD_ID: u16 = 1013;

/// The ECU ports by number, from 0, in the order of ArduPilot's SERIALn.
pub const PORTS: [&str; 6] = [
    "SERIAL2, USART1, pads TX1 RX1",
    "SERIAL3, USART2, pads TX2 RX2 (GPS1)",
    "SERIAL4, USART3, pads TX3 RX3 (GPS2)",
    "SERIAL5, UART8, pads TX8 RX8",
    "SERIAL6, UART4, pads TX4 RX4",
    "SERIAL7, USART6, pads TX6 RX6 (RC input)",
];

/// Kept free for MAVLink: UART7, PE7 RX, PE8 TX, PE10 CTS, PE9 RTS.
pub const TELEMETRY_PORT: &str = "SERIAL1, UART7, pads TX7 RX7 CTS7 RTS7";

/// The TX pins of `PORTS`, as `init` gives them to the UARTs.
const TX: [(Gpio, usize); PORTS.len()] =
    [(GPIOA, 9), (GPIOD, 5), (GPIOD, 8), (GPIOE, 1), (GPIOB, 9), (GPIOC, 6)];

ecu_uarts!(USART1, USART2, USART3, UART4, USART6, UART8);

/// Starts the clocks and opens the ports that have a line. To be called once.
pub fn init(lines: [Option<Line>; PORTS.len()]) -> Board {
    let early = early::begin(&TX, false);
    let p = embassy_stm32::init(clocks(early.oscillator));
    early::finish(early);
    let [serial2, serial3, serial4, serial5, serial6, serial7] = lines;
    Board {
        reset_cause: early.cause,
        oscillator: early.oscillator,
        ports: [
            open(serial2, p.USART1, p.PA10, p.PA9, Irqs),
            open(serial3, p.USART2, p.PD6, p.PD5, Irqs),
            open(serial4, p.USART3, p.PD9, p.PD8, Irqs),
            open(serial5, p.UART8, p.PE0, p.PE1, Irqs),
            open(serial6, p.UART4, p.PB8, p.PB9, Irqs),
            open(serial7, p.USART6, p.PC7, p.PC6, Irqs),
        ],
        led: Led::new(p.PE3), // LED0, blue, marked ACT; LED1, green, is PE4
        watchdog: Watchdog::new(p.IWDG1),
    }
}

/// 800 MHz PLL from the 8 MHz crystal or from the chip's own 64 MHz, 400 MHz core, 200 MHz buses, 100 MHz for UARTs.
fn clocks(oscillator: Oscillator) -> Config {
    let mut config = Config::default();
    let (source, prediv, mul) = match oscillator {
        Oscillator::Crystal => {
            config.rcc.hse = Some(Hse { freq: Hertz(8_000_000), mode: HseMode::Oscillator });
            (PllSource::HSE, PllPreDiv::DIV1, PllMul::MUL100)
        }
        Oscillator::Internal => (PllSource::HSI, PllPreDiv::DIV4, PllMul::MUL50),
    };
    config.rcc.pll1 = Some(Pll {
        source,
        prediv,
        mul,
        fracn: None,
        divp: Some(PllDiv::DIV2),
        divq: Some(PllDiv::DIV8),
        divr: None,
    });
    config.rcc.ls = LsConfig::off(); // no clock for the RTC: see `write_backup_register` in stm32h7.rs
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV2;
    config.rcc.apb1_pre = APBPrescaler::DIV2;
    config.rcc.apb2_pre = APBPrescaler::DIV2;
    config.rcc.apb3_pre = APBPrescaler::DIV2;
    config.rcc.apb4_pre = APBPrescaler::DIV2;
    config.rcc.voltage_scale = VoltageScale::Scale1;
    config
}
