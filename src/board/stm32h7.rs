//! Code shared by all boards with an STM32H743: the names and registers that differ between chip families.

#[cfg(feature = "selftest")]
pub mod facts;
// ArduPilot's bootloader for an H7 looks for unreadable words at each start, and erases the whole application where it finds one: behind
// it nothing is stored that a power cut could tear.
#[cfg(all(not(feature = "fram"), not(feature = "ardupilot-bootloader")))]
pub mod storage;

use super::first::Step;
use super::state::{ENGINE_EXECUTOR, Oscillator, ResetCause};
use super::wait;
#[cfg(feature = "usb")]
use embassy_stm32::pac::rcc::vals::Usbsel;
use embassy_stm32::{
    Config,
    interrupt, // the module and the attribute
    interrupt::Interrupt,
    pac::{
        self, DBGMCU, PWR, RCC,
        rcc::vals::{Adcsel, Rtcsel, Sw},
        usart::Usart,
    },
    peripherals,
    rcc::{
        AHBPrescaler, APBPrescaler, Hse, LsConfig, Pll, PllDiv, PllMul, PllPreDiv, PllSource, Sysclk,
        VoltageScale,
    },
};
use jetlink::line::LineError;

/// The independent watchdog.
pub type Iwdg = peripherals::IWDG1;

/// Its registers.
pub const WATCHDOG: pac::iwdg::Iwdg = pac::IWDG1;

/// Clock of the core on the internal oscillator, in Hz (RM0433, 8.5.2).
const HSI_HZ: u32 = 64_000_000;

/// Clock of the core on the PLL, in Hz.
const CORE_HZ: u32 = 400_000_000;

/// Clock of the core now, in Hz, at most.
pub fn core_hz() -> u32 {
    if RCC.cfgr().read().sws() == Sw::HSI { HSI_HZ } else { CORE_HZ }
}

/// An interrupt of a peripheral that no board uses (HDMI-CEC): it carries the engines' executor.
pub const EXECUTOR_INTERRUPT: Interrupt = Interrupt::CEC;

#[interrupt]
unsafe fn CEC() {
    // SAFETY: this is the executor's interrupt handler, and the interrupt is off until the executor
    // has started.
    unsafe { ENGINE_EXECUTOR.on_interrupt() }
}

/// The error flags that are set in a UART. Does not clear them.
pub fn line_errors(uart: Usart) -> [(bool, LineError); 4] {
    let status = uart.isr().read();
    [
        (status.fe(), LineError::Framing),
        (status.ne(), LineError::Noise),
        (status.ore(), LineError::Overrun),
        (status.pe(), LineError::Parity),
    ]
}

/// The sending half of a port.
pub type Transmitter = embassy_stm32::usart::BufferedUartTx<'static>;

/// Nothing: the driver knows when the last bit of a transmission is sent.
pub struct TransmissionEnd;

impl TransmissionEnd {
    /// Of a UART that has sent nothing.
    pub const fn new() -> Self {
        Self
    }

    /// Does nothing.
    pub fn before_driver(&self, _: Usart) {}

    /// Does nothing.
    pub fn after_driver(&self, _: Usart) {}

    /// The sending half, as the driver has it.
    pub fn transmitter(&'static self, driver: Transmitter) -> Transmitter {
        driver
    }
}

/// Inverts what a UART receives (RXINV).
pub const fn invert_rx(uart: &mut embassy_stm32::usart::Config) {
    uart.invert_rx = true;
}

/// Enables the clocks of GPIO ports A to E, where the boards' TX pins are (AHB4ENR). They start two cycles later (RM0433,
/// 8.5.10); the read takes longer.
pub const CLOCK_GPIO: [Step; 2] =
    [Step::set(RCC.as_ptr(), 0xE0, 0b1_1111), Step::read_back(RCC.as_ptr(), 0xE0)];

/// The watchdog pauses while a debug probe has halted the core (DBGMCU_APB4FZ1, WDGLSD1).
pub const FREEZE_WATCHDOG_WHILE_HALTED: [Step; 1] = [Step::set(DBGMCU.as_ptr(), 0x54, 1 << 18)];

/// Writes a word to the first backup register, which survives a reset: RTCAPBEN; DBP; RTCEN; RTC_BKP0R.
///
/// The bootloader resets the backup domain, and the register with it, if the RTC's clock differs from the bootloader's own
/// setting, which is none (ChibiOS; STM32_RTCSEL_NOCLK in stm32h7_mcuconf.h). So no clock is selected, here as in the
/// configuration, and the RTC is enabled without one, as ArduPilot's set_rtc_backup() does.
#[cfg(feature = "ardupilot-bootloader")]
pub const fn write_backup_register(word: u32) -> [Step; 5] {
    [
        Step::set(RCC.as_ptr(), 0xF4, 1 << 16),
        Step::set(PWR.as_ptr(), 0x00, 1 << 8),
        Step::read_back(PWR.as_ptr(), 0x00),
        Step::set(RCC.as_ptr(), 0x70, 1 << 15),
        Step::write(pac::RTC.as_ptr(), 0x50, word),
    ]
}

/// Prepares for `embassy_stm32::init`, which resets the backup domain unless it finds the configuration that it would set, here
/// an RTC that is off.
pub fn before_init() {
    PWR.cr1().modify(|w| w.set_dbp(true));
    if RCC.bdcr().read().rtcsel() == Rtcsel::DISABLE {
        RCC.bdcr().modify(|w| w.set_rtcen(false));
    }
}

/// 800 MHz PLL from the board's clock, a multiple of 8 MHz, or from the internal 64 MHz; 400 MHz core, 200 MHz buses,
/// 100 MHz for UARTs.
pub fn clocks(oscillator: Oscillator, hse: Hse) -> Config {
    let mut config = Config::default();
    let (source, prediv, mul) = match oscillator {
        Oscillator::Crystal => {
            config.rcc.hse = Some(hse);
            (PllSource::HSE, PllPreDiv::from_bits((hse.freq.0 / 8_000_000) as u8), PllMul::MUL100)
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
    config.rcc.ls = LsConfig::off(); // no clock for the RTC: see `write_backup_register`
    config.rcc.sys = Sysclk::PLL1_P;
    config.rcc.ahb_pre = AHBPrescaler::DIV2;
    config.rcc.apb1_pre = APBPrescaler::DIV2;
    config.rcc.apb2_pre = APBPrescaler::DIV2;
    config.rcc.apb3_pre = APBPrescaler::DIV2;
    config.rcc.apb4_pre = APBPrescaler::DIV2;
    config.rcc.voltage_scale = VoltageScale::Scale1;
    #[cfg(feature = "usb")]
    {
        // Embassy turns it on in any case.
        config.rcc.hsi48 = Some(embassy_stm32::rcc::Hsi48Config::new());
        config.rcc.mux.usbsel = Usbsel::HSI48;
    }
    if jetlink_fw::config::SUPPLY {
        // From the internal oscillator: the PLL that the ADC has by default does not run.
        config.rcc.mux.adcsel = Adcsel::PER;
    }
    config
}

/// Gives USB its own oscillator while the PLL that a bootloader may have given it still runs: a clock that does not run cannot be switched
/// away from (RM0433, 8.5.8). HSI48 takes some µs; if it does not start, USB reports that its clock is missing.
#[cfg(feature = "usb")]
fn take_usb_clock() {
    RCC.cr().modify(|w| w.set_hsi48on(true));
    if wait::until(HSI_HZ / 1000, || RCC.cr().read().hsi48rdy()) {
        RCC.d2ccip2r().modify(|w| w.set_usbsel(Usbsel::HSI48));
    }
}

/// Trims HSI48, the clock of USB, by the frames of the host, 1 kHz: with and without a crystal. Returns whether it is exact enough.
///
/// Not by Embassy's `sync_from_usb`: that selects the frames of the other controller, OTG_HS (docs/boards-upstream.md).
#[cfg(feature = "usb")]
pub fn start_usb_clock(_: Oscillator) -> bool {
    embassy_stm32::rcc::enable_and_reset::<peripherals::CRS>();
    // OTG_FS is USB2 here. All else is for 1 kHz after the reset (RM0433, CRS_CFGR). CEN protects it.
    pac::CRS.cfgr().modify(|w| w.set_syncsrc(pac::crs::vals::Syncsrc::from_bits(3)));
    pac::CRS.cr().modify(|w| {
        w.set_autotrimen(true);
        w.set_cen(true);
    });
    true
}

/// Has the supply of USB's transceiver, VDD33USB, detected. Its regulator stays off, as in ArduPilot (`stm32h7_mcuconf.h`, STM32_PWR_CR3):
/// the boards supply 3.3 V.
#[cfg(feature = "usb")]
pub fn start_usb_supply() {
    PWR.cr3().modify(|w| w.set_usb33den(true));
}

/// Whether that supply is there.
#[cfg(feature = "usb")]
pub fn usb_supply_is_ready() -> bool {
    PWR.cr3().read().usb33rdy()
}

/// Switches the core to the internal oscillator, whatever its clock was before, and starts the crystal if requested.
/// Returns whether the crystal runs within 0.1 s.
pub fn start_crystal(bypass: bool, wanted: bool) -> bool {
    RCC.cr().modify(|w| w.set_hsion(true));
    while !RCC.cr().read().hsirdy() {}
    RCC.cfgr().modify(|w| w.set_sw(Sw::HSI));
    while RCC.cfgr().read().sws() != Sw::HSI {}
    #[cfg(feature = "usb")]
    take_usb_clock();
    // HSEON cannot be cleared while PLL1 is on and the crystal is its reference (RM0433, 8.7.2), as behind a bootloader. Neither
    // wait should need its 1 ms: where it does, the crystal is tried as it is.
    RCC.cr().modify(|w| (0..3).for_each(|pll| w.set_pllon(pll, false)));
    wait::until(HSI_HZ / 1000, || (0..3).all(|pll| !RCC.cr().read().pllrdy(pll)));
    RCC.cr().modify(|w| w.set_hseon(false));
    wait::until(HSI_HZ / 1000, || !RCC.cr().read().hserdy());
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

/// Enables the instruction cache, but not the data cache: state to be retained across a reset would be lost in it.
pub fn speed_up() {
    // SAFETY: nothing else in this firmware touches the SCB's cache control; one core, and start-up is its only thread.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    core.SCB.enable_icache();
}

/// Nothing to do: the regulator and the brown-out reset detect a voltage that is too low for the core's clock.
pub fn wait_for_supply(_meanwhile: impl Fn()) {}

/// Nothing to do, see `wait_for_supply`.
pub fn watch_supply() {}

/// Enables the clock security system: a crystal that stops raises the NMI.
pub fn watch_crystal() {
    RCC.cr().modify(|w| w.set_hsecsson(true));
}

/// Clears the NMI of the clock security system, which would otherwise be raised again at once.
pub fn clear_crystal_alarm() {
    RCC.cicr().write(|w| w.set_hsecssc(true));
}

/// Cause of the last reset. Clears the flags, so only the first call after a reset returns it.
pub fn reset_cause() -> ResetCause {
    let flags = RCC.rsr().read();
    RCC.rsr().modify(|w| w.set_rmvf(true));
    // Several flags are set at once (the pin's always, because the chip drives the pin): the most
    // specific comes first.
    match () {
        () if flags.porrstf() => ResetCause::PowerOn,
        () if flags.borrstf() => ResetCause::BrownOut,
        () if flags.iwdg1rstf() => ResetCause::Watchdog,
        () if flags.wwdg1rstf() => ResetCause::WindowWatchdog,
        () if flags.sftrstf() => ResetCause::Software,
        () if flags.lpwrrstf() => ResetCause::LowPower,
        () if flags.pinrstf() => ResetCause::Pin,
        () => ResetCause::Unknown,
    }
}
