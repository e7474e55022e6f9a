//! Code shared by all boards with an STM32F427: the names and registers that differ between chip families.

#[cfg(feature = "selftest")]
pub mod facts;
mod transmitter;

pub use self::transmitter::{TransmissionEnd, Transmitter};

use super::first::Step;
use super::state::{ENGINE_EXECUTOR, Oscillator, ResetCause};
use super::wait;
use embassy_stm32::{
    Config,
    interrupt, // the module and the attribute
    interrupt::Interrupt,
    pac::{
        self, DBGMCU, EXTI, FLASH, PWR, RCC,
        rcc::vals::Sw,
        usart::{Usart, regs::Sr},
    },
    peripherals,
    rcc::{AHBPrescaler, APBPrescaler, Hse, Pll, PllMul, PllPDiv, PllPreDiv, PllQDiv, PllSource, Sysclk},
};
use jetlink::line::LineError;

/// The independent watchdog.
pub type Iwdg = peripherals::IWDG;

/// Its registers.
pub const WATCHDOG: pac::iwdg::Iwdg = pac::IWDG;

/// Clock of the core on the internal oscillator, in Hz (RM0090, 6.2.2).
const HSI_HZ: u32 = 16_000_000;

/// Clock of the core on the PLL, in Hz.
const CORE_HZ: u32 = 168_000_000;

/// Clock of the core now, in Hz, at most.
pub fn core_hz() -> u32 {
    if RCC.cfgr().read().sws() == Sw::HSI { HSI_HZ } else { CORE_HZ }
}

/// An interrupt of a peripheral that no board uses (CAN2): it carries the engines' executor.
pub const EXECUTOR_INTERRUPT: Interrupt = Interrupt::CAN2_SCE;

#[interrupt]
unsafe fn CAN2_SCE() {
    // SAFETY: this is the executor's interrupt handler, and the interrupt is off until the executor
    // has started.
    unsafe { ENGINE_EXECUTOR.on_interrupt() }
}

/// The error flags that are set in a UART. Does not clear them: only a subsequent read of the data register
/// does.
pub fn line_errors(uart: Usart) -> [(bool, LineError); 4] {
    errors_of(uart.sr().read())
}

fn errors_of(status: Sr) -> [(bool, LineError); 4] {
    [
        (status.fe(), LineError::Framing),
        (status.ne(), LineError::Noise),
        (status.ore(), LineError::Overrun),
        (status.pe(), LineError::Parity),
    ]
}

/// Takes what a UART without a driver has received, with the errors of it. Writes no status register: a read of it and then of the data register
/// clears the flags (RM0090, 30.6.1).
#[cfg(board_socket)]
pub fn receive(uart: Usart) -> ([(bool, LineError); 4], Option<u8>) {
    let status = uart.sr().read();
    // Without either there is nothing to clear, and a byte that ends just now has to stay.
    let byte = (status.rxne() || status.ore()).then(|| uart.dr().read().dr() as u8);
    (errors_of(status), byte.filter(|_| status.rxne()))
}

/// Has a UART interrupt at each byte that it receives or loses.
#[cfg(board_socket)]
pub fn interrupt_at_each_byte(uart: Usart) {
    uart.cr1().modify(|w| w.set_rxneie(true));
}

/// Its UARTs cannot invert what they receive: the firmware does not build with a receiver that needs it (`INVERTS_RX`).
pub const fn invert_rx(_: &mut embassy_stm32::usart::Config) {}

/// Enables the clocks of GPIO ports A to E, where the boards' TX pins are (AHB1ENR). They start two cycles later (ES0206,
/// "Delay after an RCC peripheral clock enabling"); the read takes longer.
pub const CLOCK_GPIO: [Step; 2] =
    [Step::set(RCC.as_ptr(), 0x30, 0b1_1111), Step::read_back(RCC.as_ptr(), 0x30)];

/// The watchdog pauses while a debug probe has halted the core (DBGMCU_APB1_FZ, DBG_IWDG_STOP).
pub const FREEZE_WATCHDOG_WHILE_HALTED: [Step; 1] = [Step::set(DBGMCU.as_ptr(), 0x08, 1 << 12)];

/// Writes a word to the first backup register, which survives a reset: PWREN; DBP; RTC_BKP0R. DBP takes effect some cycles of
/// the bus later (ES0206, "Possible delay in backup domain protection disabling/enabling after programming the DBP bit"); the
/// read of PWR_CR is what ST's HAL does about it (`HAL_PWR_EnableBkUpAccess` in stm32f4xx_hal_pwr.c).
#[cfg(feature = "ardupilot-bootloader")]
pub const fn write_backup_register(word: u32) -> [Step; 5] {
    [
        Step::set(RCC.as_ptr(), 0x40, 1 << 28),
        Step::read_back(RCC.as_ptr(), 0x40),
        Step::set(PWR.as_ptr(), 0x00, 1 << 8),
        Step::read_back(PWR.as_ptr(), 0x00),
        Step::write(pac::RTC.as_ptr(), 0x50, word),
    ]
}

/// Prepares for `embassy_stm32::init`: nothing to do here. ArduPilot's bootloader and this firmware both clock the RTC from the
/// LSI, so neither resets the backup domain.
pub fn before_init() {}

/// 336 MHz PLL from the board's clock, a multiple of 1 MHz, or from the internal 16 MHz; 168 MHz core, 42 MHz (APB1) and
/// 84 MHz (APB2) for UARTs.
pub fn clocks(oscillator: Oscillator, hse: Hse) -> Config {
    let mut config = Config::default();
    let (source, prediv) = match oscillator {
        Oscillator::Crystal => {
            config.rcc.hse = Some(hse);
            (PllSource::HSE, PllPreDiv::from_bits((hse.freq.0 / 1_000_000) as u8))
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
    // No LSI for an RTC: Embassy waits for it without a timeout, and the watchdog, which also runs on it, would not fire.
    // ArduPilot's bootloader waits for it itself, and both have to select it (`before_init`).
    #[cfg(not(feature = "ardupilot-bootloader"))]
    {
        config.rcc.ls = embassy_stm32::rcc::LsConfig::off();
    }
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV1;
    config.rcc.apb1_pre = APBPrescaler::DIV4;
    config.rcc.apb2_pre = APBPrescaler::DIV2;
    config
}

/// USB runs on the PLL (48 MHz, see [`clocks`]). Returns whether that is exact enough: from the crystal. The internal oscillator is off by
/// up to 1 % at 25 °C and by more elsewhere (DS9405, table 41), and USB takes 0.25 %.
#[cfg(feature = "usb")]
pub fn start_usb_clock(oscillator: Oscillator) -> bool {
    oscillator == Oscillator::Crystal
}

/// Nothing to do: its transceiver has the supply of the chip.
#[cfg(feature = "usb")]
pub fn start_usb_supply() {}

/// See `start_usb_supply`.
#[cfg(feature = "usb")]
pub fn usb_supply_is_ready() -> bool {
    true
}

/// Switches the core to the internal oscillator, whatever its clock was before, and starts the crystal if requested.
/// Returns whether the crystal runs within 0.1 s.
pub fn start_crystal(bypass: bool, wanted: bool) -> bool {
    RCC.cr().modify(|w| w.set_hsion(true));
    while !RCC.cr().read().hsirdy() {}
    RCC.cfgr().modify(|w| w.set_sw(Sw::HSI));
    while RCC.cfgr().read().sws() != Sw::HSI {}
    RCC.cr().modify(|w| {
        w.set_pllon(false);
        w.set_csson(false);
        w.set_hseon(false);
    });
    while RCC.cr().read().hserdy() {}
    if !wanted {
        return false;
    }
    RCC.cr().modify(|w| w.set_hsebyp(bypass));
    RCC.cr().modify(|w| w.set_hseon(true));
    let runs = wait::until(HSI_HZ / 10, || RCC.cr().read().hserdy());
    if !runs {
        RCC.cr().modify(|w| w.set_hseon(false));
    }
    runs
}

/// Enables the flash accelerator: prefetch and both caches. Embassy's `init` disables all of them when it writes the flash's
/// wait states (`rcc/f247.rs` of embassy-stm32 0.6.0).
pub fn speed_up() {
    // The caches hold old content, and may only be reset while they are off (RM0090, 3.9.1).
    FLASH.acr().modify(|w| {
        w.set_icrst(true);
        w.set_dcrst(true);
    });
    FLASH.acr().modify(|w| {
        w.set_icrst(false);
        w.set_dcrst(false);
    });
    FLASH.acr().modify(|w| {
        w.set_prften(true);
        w.set_icen(true);
        w.set_dcen(true);
    });
}

/// Enables the voltage detector: 2.84 V falling, 2.93 V rising, typical (DS9405, table 22, PLS 5). With its five wait states
/// the flash supports 168 MHz from 2.7 V on (RM0090, 3.5.1), and unless option bytes set a higher level, the chip only resets at
/// 1.7 V: in between, it could read wrong instructions from the flash.
fn detect_low_supply() {
    RCC.apb1enr().modify(|w| w.set_pwren(true));
    PWR.cr1().modify(|w| {
        w.set_pls(5);
        w.set_pvde(true);
    });
}

/// Waits until the supply is high enough, without a timeout.
pub fn wait_for_supply(meanwhile: impl Fn()) {
    // A start without a reset leaves the EXTI line as it was: enabled, with its request pending.
    EXTI.imr(0).modify(|w| w.set_line(DETECTOR_LINE, false));
    detect_low_supply();
    cortex_m::asm::delay(HSI_HZ / DETECTOR_SETTLES); // at the internal oscillator's clock
    while PWR.csr1().read().pvdo() {
        meanwhile();
        cortex_m::asm::delay(HSI_HZ / 100);
    }
}

/// From here on, a falling supply raises an interrupt. Call this after `embassy_stm32::init`, which resets the detector.
pub fn watch_supply() {
    detect_low_supply();
    cortex_m::asm::delay(CORE_HZ / DETECTOR_SETTLES);
    EXTI.rtsr(0).modify(|w| w.set_line(DETECTOR_LINE, true));
    // Anything detected until now, including while it settled, is checked below.
    EXTI.pr(0).write(|w| w.set_line(DETECTOR_LINE, true));
    EXTI.imr(0).modify(|w| w.set_line(DETECTOR_LINE, true));
    // SAFETY: no critical section relies on masks of single interrupts, and the handler exists (`alarms.rs`).
    unsafe { cortex_m::peripheral::NVIC::unmask(Interrupt::PVD) };
    if PWR.csr1().read().pvdo() {
        cortex_m::peripheral::NVIC::pend(Interrupt::PVD); // it fell before the line could detect it
    }
}

/// Settling time of the detector, 0.1 ms, as a fraction of 1 s.
const DETECTOR_SETTLES: u32 = 10_000;

/// The detector's line of the EXTI (RM0090, 12.2.5).
const DETECTOR_LINE: usize = 16;

/// Enables the clock security system: a crystal that stops raises the NMI.
pub fn watch_crystal() {
    RCC.cr().modify(|w| w.set_csson(true));
}

/// Clears the NMI of the clock security system, which would otherwise be raised again at once.
pub fn clear_crystal_alarm() {
    RCC.cir().modify(|w| w.set_cssc(true));
}

/// Cause of the last reset. Clears the flags, so only the first call after a reset returns it.
pub fn reset_cause() -> ResetCause {
    let flags = RCC.csr().read();
    RCC.csr().modify(|w| w.set_rmvf(true));
    // Several flags are set at once (the pin's always, because the chip drives the pin): the most
    // specific comes first.
    match () {
        () if flags.porrstf() => ResetCause::PowerOn,
        () if flags.borrstf() => ResetCause::BrownOut,
        () if flags.wdgrstf() => ResetCause::Watchdog,
        () if flags.wwdgrstf() => ResetCause::WindowWatchdog,
        () if flags.sftrstf() => ResetCause::Software,
        () if flags.lpwrrstf() => ResetCause::LowPower,
        () if flags.padrstf() => ResetCause::Pin,
        () => ResetCause::Unknown,
    }
}
