//! Turns the table of a board (`boards/`) into typed code: a pin that does not belong to its UART does not build.
//!
//! `build.rs` writes the call of this macro, with the names of the table as tokens.

/// Expands the table of one board.
macro_rules! board {
    (
        name: $name:literal,
        apj_board_id: $apj_board_id:literal,
        clock: $mhz:literal $mode:ident,
        ports: [$($port:literal $uart:ident $rx:ident $tx:ident $gpio:ident $number:literal,)*],
        telemetry: $telemetry:literal,
        led: $led:ident $lit:ident $drive:ident,
        hold: [$($held:ident $level:ident,)*],
        watchdog: $watchdog:ident,
    ) => {
        use super::{
            Board, Led, Watchdog, chip, early,
            port::{ecu_uarts, open},
            stm32::Drive,
        };
        use embassy_stm32::{gpio::Level, pac::{self, gpio::Gpio}, rcc::{Hse, HseMode}, time::mhz};
        use jetlink::line::Line;

        /// The board's name.
        pub const NAME: &str = $name;

        /// What its bootloader calls the board (APJ_BOARD_ID).
        #[cfg(feature = "ardupilot-bootloader")]
        pub const APJ_BOARD_ID: u16 = $apj_board_id;

        /// The ECU ports by number, from 0.
        pub const PORTS: [&str; [$($port),*].len()] = [$($port),*];

        /// Kept free for MAVLink.
        pub const TELEMETRY_PORT: &str = $telemetry;

        /// The TX pins of `PORTS`, as `init` gives them to the UARTs.
        const TX: [(Gpio, usize); PORTS.len()] = [$((pac::$gpio, $number)),*];

        ecu_uarts!($($uart),*);

        /// Starts the clocks and opens the ports that have a line. To be called once.
        pub fn init(lines: [Option<Line>; PORTS.len()]) -> Board {
            let hse = Hse { freq: mhz($mhz), mode: HseMode::$mode };
            let early = early::begin(&TX, matches!(hse.mode, HseMode::Bypass));
            let p = embassy_stm32::init(chip::clocks(early.oscillator, hse));
            early::finish(early);
            $(super::stm32::hold(p.$held, Level::$level);)*
            let mut lines = lines.into_iter();
            Board {
                reset_cause: early.cause,
                oscillator: early.oscillator,
                ports: [$(open(lines.next().flatten(), p.$uart, p.$rx, p.$tx, Irqs)),*],
                led: Led::new(p.$led, Level::$lit, Drive::$drive),
                watchdog: Watchdog::new(p.$watchdog),
            }
        }
    };
}

include!(concat!(env!("OUT_DIR"), "/board.rs"));
