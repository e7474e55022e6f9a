//! Turns the table of a board (`boards/`) into typed code: a pin that does not belong to its UART does not build.
//!
//! `build.rs` writes the call of this macro, with the names of the table as tokens.

/// Expands the table of one board.
macro_rules! board {
    (
        name: $name:literal,
        clock: $mhz:literal $mode:ident,
        ports: [$($port:literal $uart:ident $rx:ident $tx:ident $gpio:ident $number:literal $rx_gpio:ident $rx_number:literal,)*],
        telemetry: $telemetry:literal,
        led: $led:ident $lit:ident $drive:ident,
        hold: [$($held:ident $level:ident,)*],
        watchdog: $watchdog:ident,
    ) => {
        use super::port::{EcuPort, ecu_uarts, open};
        use super::state::Ready;
        use super::stm32::{Drive, Led, Watchdog};
        use super::{chip, early};
        use embassy_stm32::{gpio::Level, pac::{self, gpio::Gpio}, rcc::{Hse, HseMode}, time::mhz};
        use jetlink::line::Line;

        /// The board's name.
        pub const NAME: &str = $name;

        /// The ECU ports by number, from 0.
        pub const PORTS: [&str; [$($port),*].len()] = [$($port),*];

        /// Reserved for MAVLink.
        pub const TELEMETRY_PORT: &str = $telemetry;

        /// The TX pins of `PORTS`, as `init` gives them to the UARTs.
        const TX: [(Gpio, usize); PORTS.len()] = [$((pac::$gpio, $number)),*];

        /// Their RX pins.
        const RX: [(Gpio, usize); PORTS.len()] = [$((pac::$rx_gpio, $rx_number)),*];

        ecu_uarts!($($uart),*);

        /// Opens each port, by the name of its UART.
        #[allow(non_snake_case, reason = "as the chip's manual writes them")]
        mod openers {
            use super::{EcuPort, Irqs, Line, open};
            use embassy_stm32::peripherals;

            $(
                /// # Safety
                ///
                /// The port must not be open.
                pub unsafe fn $uart(line: Line) -> EcuPort {
                    // SAFETY: a port that is not open uses neither its UART nor its pins, and nothing else on the board does.
                    unsafe {
                        let (rx, tx) = (peripherals::$rx::steal(), peripherals::$tx::steal());
                        open(line, $uart, peripherals::$uart::steal(), rx, tx, Irqs)
                    }
                }
            )*
        }

        /// The board, ready for the firmware.
        pub type Board = Ready<EcuPort, Led, Watchdog, { PORTS.len() }>;

        /// Starts the clocks and opens the ports that have a line. Call it once.
        pub fn init(lines: [Option<Line>; PORTS.len()]) -> Board {
            let hse = Hse { freq: mhz($mhz), mode: HseMode::$mode };
            let early = early::begin(&TX, &RX, matches!(hse.mode, HseMode::Bypass));
            let p = embassy_stm32::init(chip::clocks(early.oscillator, hse));
            early::finish(early);
            $(super::stm32::hold(p.$held, Level::$level);)*
            // Taken permanently: a pin that occurs twice in the table does not build.
            let _taken = ($((p.$uart, p.$rx, p.$tx)),*);
            let openers: [unsafe fn(Line) -> EcuPort; PORTS.len()] = [$(openers::$uart),*];
            let mut ports = lines.into_iter().zip(openers).map(|(line, opener)| {
                // SAFETY: `init` is called once, and opens each port once.
                line.map(|line| unsafe { opener(line) })
            });
            Ready {
                reset_cause: early.cause,
                oscillator: early.oscillator,
                ports: core::array::from_fn(|_| ports.next().flatten()),
                led: Led::new(p.$led, Level::$lit, Drive::$drive),
                watchdog: Watchdog::new(p.$watchdog),
            }
        }
    };
}

include!(concat!(env!("OUT_DIR"), "/board.rs"));
