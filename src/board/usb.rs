//! USB: OTG_FS at full speed, with the clock and the supply that it needs. No emulator has one: what is here has run only with registers that
//! do not move.
//!
//! Embassy's driver waits for the supply and the controller without an end, in thread mode, and panics where the controller is not one that it
//! knows: then the watchdog would reset the node, again and again. So everything is looked at here first, with an end to each wait and with
//! all other tasks running meanwhile; and USB stays off where one of them ends.

use super::chip;
use super::state::Oscillator;
use super::table::usb_pins::{Minus, Plus};
use embassy_stm32::interrupt::{self, InterruptExt, Priority};
use embassy_stm32::pac::USB_OTG_FS as REGISTERS;
use embassy_stm32::peripherals::USB_OTG_FS;
use embassy_stm32::usb::{Config, Driver, InterruptHandler};
use embassy_stm32::{bind_interrupts, rcc};
use embassy_time::{Duration, Timer};
use jetlink_usb::careful::Careful;
use static_cell::ConstStaticCell;

bind_interrupts!(struct Irqs {
    OTG_FS => InterruptHandler<USB_OTG_FS>;
});

/// The driver.
pub type UsbDriver = Careful<Driver<'static, USB_OTG_FS>>;

/// Versions of the controller that the driver knows. It panics at another one. An STM32F427 has 0x1200, an STM32H743 0x2300.
const KNOWN: [u32; 8] =
    [0x0000_1000, 0x0000_1100, 0x0000_1200, 0x0000_2000, 0x0000_2100, 0x0000_2300, 0x0000_3000, 0x0000_3100];

/// Time for the supply and for each answer of the controller. To become a device takes it 25 ms at most (RM0433, 57.14.4; RM0090,
/// 34.16.2: FDMOD).
const TIMEOUT_MS: u32 = 100;

/// Why USB is off.
#[derive(Clone, Copy)]
pub enum Off {
    /// There is no clock that is exact enough: on the internal oscillator of an STM32F427.
    Clock,
    /// Its supply does not come.
    Supply,
    /// The driver does not know this version of the controller.
    Unknown(u32),
    /// The controller does not become ready.
    Busy,
}

impl Off {
    /// Logs it.
    pub fn log(self) {
        match self {
            Self::Clock => defmt::error!("USB disabled: clock too inaccurate without the crystal"),
            Self::Supply => defmt::error!("USB disabled: VDD33USB not ready"),
            Self::Unknown(version) => {
                defmt::error!("USB disabled: unknown controller, ID {=u32:#x}", version)
            }
            Self::Busy => defmt::error!("USB disabled: controller not ready"),
        }
    }
}

/// Waits until it is so, and looks every millisecond.
#[expect(clippy::disallowed_methods, reason = "the chip is waited for")]
async fn comes(is_so: impl Fn() -> bool) -> bool {
    for _ in 0..TIMEOUT_MS {
        if is_so() {
            return true;
        }
        Timer::after(Duration::from_millis(1)).await;
    }
    is_so()
}

/// Makes the controller ready for its driver. Call it once.
pub async fn begin(oscillator: Oscillator) -> Result<UsbDriver, Off> {
    if !chip::start_usb_clock(oscillator) {
        return Err(Off::Clock);
    }
    chip::start_usb_supply();
    if !comes(chip::usb_supply_is_ready).await {
        return Err(Off::Supply);
    }
    // Whatever a bootloader has left of it.
    rcc::enable_and_reset::<USB_OTG_FS>();
    let version = REGISTERS.cid().read().0;
    if !KNOWN.contains(&version) {
        rcc::disable::<USB_OTG_FS>();
        return Err(Off::Unknown(version));
    }
    // The driver waits for the same, after another reset.
    let idle = comes(|| REGISTERS.grstctl().read().ahbidl()).await;
    REGISTERS.gusbcfg().modify(|w| {
        w.set_physel(true);
        w.set_fdmod(true);
    });
    if !idle || !comes(|| !REGISTERS.gintsts().read().cmod()).await {
        rcc::disable::<USB_OTG_FS>();
        return Err(Off::Busy);
    }
    // Below all that serves engines: UARTs and timers have P0, the engines' executor has P6.
    interrupt::OTG_FS.set_priority(Priority::P15);

    // For the control pipe and the port.
    static RECEIVED: ConstStaticCell<[u8; 128]> = ConstStaticCell::new([0; 128]);
    // SAFETY: called once; nothing else uses the controller, and the table of the board reserves the pins: `init` takes them and leaves them
    // as they are after a reset.
    let (controller, minus, plus) = unsafe { (USB_OTG_FS::steal(), Minus::steal(), Plus::steal()) };
    let driver = Driver::new_fs(controller, Irqs, plus, minus, RECEIVED.take(), Config::default());
    Ok(Careful::new(driver, || REGISTERS.dsts().read().suspsts()))
}

/// A number that no other chip has.
pub fn serial_number() -> &'static str {
    embassy_stm32::uid::uid_hex()
}
