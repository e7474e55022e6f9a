//! Turns the table of a board (`boards/`) into typed code: a pin that does not belong to its UART does not build.
//!
//! `build.rs` writes the call of this macro, with the names of the table as tokens.

/// Expands the table of one board.
macro_rules! board {
    (
        name: $name:literal,
        clock: $mhz:literal $mode:ident,
        ports: [$($port:literal $uart:ident $gpio:ident $number:literal $rx_gpio:ident $rx_number:literal,)*],
        telemetry: $telemetry:literal $telemetry_uart:ident,
        inverts: $inverts:literal,
        uarts: [$($each:ident $rx:ident $tx:ident,)*],
        outputs: [$($out:ident $out_gpio:ident $out_number:literal $out_label:literal $out_low:literal,)*],
        pulses: [$($timer:ident $captured:ident $($in:ident $in_gpio:ident $in_number:literal $in_output:literal,)*)?],
        supply: [$($supply:ident $tenths:literal)?],
        fram: [$($spi:ident $sck:ident $miso:ident $mosi:ident $select:ident)?],
        usb: $minus:ident $plus:ident,
        led: $led:ident $lit:ident $drive:ident,
        hold: [$($held:ident $level:ident,)*],
        watchdog: $watchdog:ident,
    ) => {
        use super::port::{EcuPort, Opener, ecu_uarts, open};
        use super::state::{Ready, ResetCause};
        use super::stm32::{Drive, Led, Watchdog};
        use super::first::{self, Step};
        use super::{chip, early, watchdog};
        use embassy_stm32::{gpio::Level, pac::{self, gpio::Gpio}, rcc::{Hse, HseMode}, time::mhz};
        use super::format::Format;

        /// The board's name.
        pub const NAME: &str = $name;

        /// The ECU ports by number, from 0.
        pub const PORTS: [&str; [$($port),*].len()] = [$($port),*];

        /// The port of MAVLink.
        pub const TELEMETRY_PORT: &str = $telemetry;

        /// Whether its UARTs can invert what they receive.
        pub const INVERTS_RX: bool = $inverts;

        /// The outputs for valves and power by number, from 0.
        pub const OUTPUTS: &[&str] = &[$($out_label),*];

        /// Whether the bootloader drives each low.
        pub const OUTPUTS_LOW_BEFORE: &[bool] = &[$($out_low),*];

        /// Their pins.
        pub const OUTPUT_PINS: &[(Gpio, usize)] = &[$((pac::$out_gpio, $out_number)),*];

        /// The inputs for servo pulses.
        $(
            pub mod capture {
                use embassy_stm32::pac::{self, gpio::Gpio, timer::TimGp16};
                use core::cell::Cell;
                use embassy_stm32::{Peri, interrupt, peripherals};
                use embassy_sync::blocking_mutex::{Mutex, raw::CriticalSectionRawMutex};

                pub use embassy_stm32::interrupt::typelevel::$captured as Interrupt;
                pub use peripherals::$timer as Timer;

                /// Its registers.
                // SAFETY: those of a timer with 16 bits are the first of every timer with four channels.
                pub const REGISTERS: TimGp16 = unsafe { TimGp16::from_ptr(pac::$timer.as_ptr()) };

                /// The pins by channel, from channel 1 on.
                pub const PINS: [(Gpio, usize); 4] = [$((pac::$in_gpio, $in_number)),*];

                /// Their numbers as outputs.
                pub const OUTPUTS: [u8; 4] = [$($in_output),*];

                /// The pins.
                ///
                /// # Safety
                /// Nothing else uses them.
                pub unsafe fn steal() -> ($(Peri<'static, peripherals::$in>),*) {
                    // SAFETY: the caller guarantees it.
                    unsafe { ($(peripherals::$in::steal()),*) }
                }

                /// What takes a capture, once the timer runs.
                pub static TAKER: Mutex<CriticalSectionRawMutex, Cell<Option<fn()>>> = Mutex::new(Cell::new(None));

                #[interrupt]
                fn $captured() {
                    if let Some(take) = TAKER.lock(Cell::get) {
                        take();
                    }
                }
            }
        )?

        /// The divider of the supply.
        $(
            pub mod divider {
                pub use embassy_stm32::peripherals::$supply as Pin;

                /// Supply voltage to voltage at the pin, in tenths.
                pub const TENTHS: u32 = $tenths;
            }
        )?

        /// The pins of USB.
        #[cfg(feature = "usb")]
        pub mod usb_pins {
            pub use embassy_stm32::peripherals::{$minus as Minus, $plus as Plus};
        }

        /// The TX pins of `PORTS`, as `init` gives them to the UARTs.
        #[cfg(feature = "selftest")]
        const TX: [(Gpio, usize); PORTS.len()] = [$((pac::$gpio, $number)),*];

        /// What `__pre_init` does for this board: pull-ups on every ECU port, then the watchdog.
        const FIRST_STEPS: &[&[Step]] = &[
            &chip::CLOCK_GPIO,
            $(&early::pull_up(pac::$gpio, $number),)*
            $(&early::pull_up(pac::$rx_gpio, $rx_number),)*
            &chip::FREEZE_WATCHDOG_WHILE_HALTED,
            early::REQUEST_TO_BOOTLOADER,
            &watchdog::START,
        ];

        /// The same as `__pre_init` takes it.
        pub static FIRST: [Step; first::length(FIRST_STEPS)] = first::list(FIRST_STEPS);

        ecu_uarts!($($each),*);

        /// How each port is opened, by the name of its UART.
        #[allow(non_snake_case, reason = "as the chip's manual writes them")]
        mod openers {
            use super::super::port::EcuUart;
            use super::{Irqs, Opener};
            use embassy_stm32::peripherals;
            use embassy_stm32::usart::BufferedUart;

            $(
                pub const $each: Opener = Opener {
                    driver: |tx_buffer, rx_buffer, config| {
                        // SAFETY: the caller guarantees that the port is not open: nothing uses its UART or its pins then.
                        unsafe {
                            let (rx, tx) = (peripherals::$rx::steal(), peripherals::$tx::steal());
                            let uart = peripherals::$each::steal();
                            BufferedUart::new(uart, rx, tx, tx_buffer, rx_buffer, Irqs, config)
                        }
                    },
                    errors: peripherals::$each::errors,
                };
            )*
        }

        $(
            /// The storage in its F-RAM; `None` if its chip is not known, or there is none. Call it once.
            pub fn storage() -> Option<super::fram::Storage> {
                use embassy_stm32::peripherals;
                // SAFETY: called once, and `init` takes all of these: nothing else uses them.
                let device = unsafe {
                    let spi = (peripherals::$sck::steal(), peripherals::$mosi::steal(), peripherals::$miso::steal());
                    super::fram::Device::new(peripherals::$spi::steal(), spi, peripherals::$select::steal())
                };
                super::fram::storage_in(device)
            }
        )?

        /// The format of each open port, the place of its buffers, and what opens it. In a constant, so that the image has the drivers of
        /// these ports alone.
        pub const fn plan(formats: [Option<Format>; PORTS.len()]) -> [Option<(Format, usize, Opener)>; PORTS.len()] {
            let openers: [Opener; PORTS.len()] = [$(openers::$uart),*];
            let mut plan = [None; PORTS.len()];
            // The first place is that of MAVLink.
            let (mut port, mut place) = (0, 1);
            while port < PORTS.len() {
                if let Some(format) = formats[port] {
                    plan[port] = Some((format, place, openers[port]));
                    place += 1;
                }
                port += 1;
            }
            plan
        }

        /// The board, ready for the firmware.
        pub type Board = Ready<EcuPort, Led, Watchdog, { PORTS.len() }>;

        /// Starts the clocks, opens the ports of the plan, and the one of MAVLink. Does `first` before anything else. Call it
        /// once.
        pub fn init(
            plan: [Option<(Format, usize, Opener)>; PORTS.len()],
            telemetry: Format,
            first: impl FnOnce(ResetCause),
        ) -> Board {
            let hse = Hse { freq: mhz($mhz), mode: HseMode::$mode };
            let early = early::begin(matches!(hse.mode, HseMode::Bypass), |cause| {
                first(cause);
                #[cfg(feature = "selftest")]
                super::selftest::look_at_tx(&TX);
            });
            let p = embassy_stm32::init(chip::clocks(early.oscillator, hse));
            early::finish(early);
            $(super::stm32::hold(p.$held, Level::$level);)*
            // Taken permanently: a pin that occurs twice in the table does not build.
            let _taken = ($((p.$each, p.$rx, p.$tx)),*);
            let _outputs = ($(p.$out,)*);
            $(let _supply = p.$supply;)?
            $(let _fram = (p.$spi, p.$sck, p.$miso, p.$mosi, p.$select);)?
            let _usb = (p.$minus, p.$plus);
            let mut opened = [const { None }; PORTS.len()];
            for (port, planned) in opened.iter_mut().zip(plan) {
                let Some((format, place, opener)) = planned else { continue };
                // SAFETY: `init` is called once, and opens each port once, in a place of its own.
                *port = Some(unsafe { open(format, place, opener) });
            }
            Ready {
                reset_cause: early.cause,
                oscillator: early.oscillator,
                ports: opened,
                // SAFETY: as above; it is none of `PORTS`.
                telemetry: unsafe { open(telemetry, 0, openers::$telemetry_uart) },
                led: Led::new(p.$led, Level::$lit, Drive::$drive),
                watchdog: Watchdog::new(p.$watchdog),
            }
        }
    };
}

include!(concat!(env!("OUT_DIR"), "/board.rs"));
