//! Turns the table of a board (`boards/`) into typed code: a pin that does not belong to its UART does not build.
//!
//! `build.rs` writes the call of this macro, with the names of the table as tokens.

/// Expands the table of one board.
macro_rules! board {
    (
        name: $name:literal,
        clock: $mhz:literal $mode:ident,
        ports: [$($port:literal $uart:ident $gpio:ident $number:literal $rx_gpio:ident $rx_number:literal,)*],
        telemetry: $telemetry:literal,
        inverts: $inverts:literal,
        uarts: [$($each:ident $rx:ident $tx:ident,)*],
        outputs: [$($out:ident $out_gpio:ident $out_number:literal $out_label:literal $out_low:literal,)*],
        pulses: [$($timer:ident $captured:ident $($in:ident $in_gpio:ident $in_number:literal $in_output:literal,)*)?],
        socket: [$($socket:literal $socket_uart:ident $socket_rx:ident $left_alone:ident $inverter:ident $inverts_at:ident)?],
        supply: [$($supply:ident $tenths:literal)?],
        fram: [$($spi:ident $sck:ident $miso:ident $mosi:ident $select:ident)?],
        usb: $minus:ident $plus:ident,
        led: $led:ident $lit:ident $drive:ident,
        hold: [$($held:ident $level:ident,)*],
        watchdog: $watchdog:ident,
    ) => {
        use super::port::{EcuPort, Opened, ecu_uarts, open_once};
        use super::state::{Ready, ResetCause};
        use super::stm32::{Drive, Led, Watchdog};
        use super::first::{self, Step};
        use super::{chip, early, watchdog};
        use embassy_stm32::{gpio::Level, pac::{self, gpio::Gpio}, rcc::{Hse, HseMode}, time::mhz};
        use embassy_stm32::usart::BufferedUart;
        use super::format::Format;

        /// The board's name.
        pub const NAME: &str = $name;

        /// The ECU ports by number, from 0.
        pub const PORTS: [&str; [$($port),*].len()] = [$($port),*];

        /// The port of MAVLink. Its number is the one behind those of `PORTS`.
        pub const TELEMETRY_PORT: &str = $telemetry;

        /// Whether its UARTs can have two stop bits.
        pub const TWO_STOP_BITS: bool = true;

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

        /// The socket for a receiver.
        $(
            pub mod socket {
                use embassy_stm32::{Peri, gpio::Level, interrupt, pac::{self, usart::Usart}, peripherals};

                /// Its name.
                pub const NAME: &str = $socket;

                /// The registers of its UART.
                pub const REGISTERS: Usart = pac::$socket_uart;

                /// Level of the inverter's pin at which it inverts.
                pub const INVERTS_AT: Level = Level::$inverts_at;

                /// The UART, its receiving pin, and the pin of the inverter.
                ///
                /// # Safety
                /// Nothing else uses them.
                pub unsafe fn steal() -> (
                    Peri<'static, peripherals::$socket_uart>,
                    Peri<'static, peripherals::$socket_rx>,
                    Peri<'static, peripherals::$inverter>,
                ) {
                    // SAFETY: the caller guarantees it.
                    unsafe {
                        (
                            peripherals::$socket_uart::steal(),
                            peripherals::$socket_rx::steal(),
                            peripherals::$inverter::steal(),
                        )
                    }
                }

                #[interrupt]
                fn $socket_uart() {
                    super::super::socket::on_interrupt(REGISTERS);
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

        /// The driver of a port by its number, and what its interrupt keeps; `None`: there is no such port. The driver has buffers for sending and receiving. In one function: the compiler shares what is the same
        /// for each.
        ///
        /// # Safety
        /// The port is not open.
        #[inline(never)]
        unsafe fn driver(
            port: usize,
            tx_buffer: &'static mut [u8],
            rx_buffer: &'static mut [u8],
            format: Format,
        ) -> Option<Opened> {
            use super::port::EcuUart;
            use embassy_stm32::peripherals;

            let config = super::port::config(format);
            let mut number = 0;
            $(
                if port == number {
                    // SAFETY: the caller guarantees that nothing uses the UART or its pins, and `init` has taken them.
                    let (uart, rx, tx) = unsafe {
                        (peripherals::$each::steal(), peripherals::$rx::steal(), peripherals::$tx::steal())
                    };
                    let opened = BufferedUart::new(uart, rx, tx, tx_buffer, rx_buffer, Irqs, config);
                    return Some((opened, peripherals::$each::state()));
                }
                number += 1;
            )*
            let _ = number;
            None
        }

        $(
            /// The storage in its F-RAM; without it what that means for the settings. Call it once.
            pub fn storage() -> Result<super::fram::Storage, jetlink_mavlink::store::Found> {
                use embassy_stm32::peripherals;
                // SAFETY: called once, and `init` takes all of these: nothing else uses them.
                let device = unsafe {
                    let spi = (peripherals::$sck::steal(), peripherals::$mosi::steal(), peripherals::$miso::steal());
                    super::fram::Device::new(peripherals::$spi::steal(), spi, peripherals::$select::steal())
                };
                super::fram::storage_in(device)
            }
        )?

        /// Opens a port by its number, once, and once the clocks run. The number behind those of `PORTS` is that of MAVLink. `None`: there is
        /// no such port, or it was opened before.
        pub fn open(port: usize, format: Format) -> Option<EcuPort> {
            open_once(driver, port, format)
        }

        /// The board, ready for the firmware.
        pub type Board = Ready<Led, Watchdog>;

        /// Starts the clocks. Does `first` before anything else. Call it once.
        pub fn init(first: impl FnOnce(ResetCause)) -> Board {
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
            // The pin that is left alone is one of them: nothing else of the table can drive it.
            $(let _socket = (p.$socket_uart, p.$socket_rx, p.$left_alone, p.$inverter);)?
            $(let _fram = (p.$spi, p.$sck, p.$miso, p.$mosi, p.$select);)?
            let _usb = (p.$minus, p.$plus);
            Ready {
                reset_cause: early.cause,
                oscillator: early.oscillator,
                led: Led::new(p.$led, Level::$lit, Drive::$drive),
                watchdog: Watchdog::new(p.$watchdog),
            }
        }
    };
}

include!(concat!(env!("OUT_DIR"), "/board.rs"));
