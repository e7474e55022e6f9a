//! What the emulator (rigless 0.4.0) needs help with to run this firmware. All of it is here; the firmware
//! does not know.
//!
//! 1. **Timers flag a match that the parts do not flag.** A write of 0 to the counter of a stopped timer, and
//!    a software update (`EGR.UG`), flag every compare channel whose register holds that value too, and after
//!    a reset all of them hold 0. embassy-stm32's time driver does both when it starts and takes the flag of
//!    channel 1 for half an overflow: the clock would begin at 32.8 ms and stumble at every turn. The parts
//!    do not show it: Embassy's log of an STM32F4 begins at 0.000000. So right after a `UG` on a stopped timer
//!    [`TimerFlags`] clears the compare flags, before the next instruction, and before any interrupt is on.
//! 2. **The H743 has no watchdog.** Its clock and its reset flag are there, the peripheral is not.
//!    [`Iwdg`] is the smallest one that bites: start, reload, prescaler, reset at zero (RM0433, chapter 45).
//!    Left out: the time that a new prescaler takes to cross over (its status reads 0, that is: done), the
//!    write lock and the window. The F427's own watchdog model is used as it is.
//! 3. **The H743 has no real-time clock**, so no backup registers. [`Rtc`] holds what is written, over a reset
//!    too, as the backup domain does, and does nothing else. [`BackupDomain`] empties it when `RCC_BDCR.BDRST` is set.
//!    That writes need `PWR_CR1.DBP`, and that `RTCSEL` is written once until then, rigless knows by itself. The
//!    F427's own model is used as it is.
//! 4. **A crystal always starts.** [`Crystal`] lets one be dead: right after each write that turns it on, it is turned
//!    off again, before its flag rises.

use std::collections::HashMap;

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::Width;
use rigless::soc::stm32h743::generated::{iwdg::Register, rtc};
use rigless::soc::stm32h743::peripherals::rcc::IWDG_STARTED;
use rigless::time::{EventId, VirtualNanos};

/// Clears the compare flags that no part would set.
#[derive(Debug)]
pub struct TimerFlags {
    /// From the address of each timer's EGR to the timer.
    timers: HashMap<u64, u64>,
}

impl TimerFlags {
    const CR1: u64 = 0x00;
    const SR: u64 = 0x10;
    const EGR: u64 = 0x14;

    /// For all timers of a part.
    pub fn new(part: &impl Mcu) -> Self {
        let timers = part.bus().peripherals().filter(|peripheral| peripheral.name.starts_with("TIM"));
        Self { timers: timers.map(|timer| (timer.base + Self::EGR, timer.base)).collect() }
    }

    /// To be called after every write to a register.
    pub fn after_write(&self, part: &mut impl Operate, at: VirtualNanos, address: u64) {
        let Some(timer) = self.timers.get(&address) else { return };
        let stopped = part.peek(at, timer + Self::CR1, Width::W32).is_ok_and(|cr1| cr1 & 1 == 0);
        if stopped {
            // Writing 0 clears: CC1IF to CC4IF go, UIF stays.
            let _ = part.write(at, timer + Self::SR, Width::W32, 0xFFFF_FFE1);
        }
    }
}

/// The independent watchdog of an STM32H743.
#[derive(Debug, Default)]
pub struct Iwdg {
    hz: u64,
    started: bool,
    from: u64,
    load: u64,
    expiry: Option<EventId>,
}

impl Iwdg {
    fn arm(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        self.expiry = None;
        if self.started && self.hz != 0 {
            let cycles = (self.load + 1) * (4 << registers.get(Register::Pr).min(6));
            let at = VirtualNanos(self.from + cycles * 1_000_000_000 / self.hz);
            self.expiry = Some(context.schedule(at));
        }
    }
}

impl Device for Iwdg {
    type Register = Register;

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if register == Register::Kr {
            let now = context.now().0;
            match value {
                0xCCCC if !self.started => {
                    (self.started, self.from, self.load) = (true, now, 0xFFF);
                    context.request(IWDG_STARTED, Level::High); // the RCC turns its oscillator on
                }
                0xAAAA => (self.from, self.load) = (now, registers.get(Register::Rlr)),
                _ => {}
            }
        }
        self.arm(registers, context);
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.hz = hz;
        self.arm(registers, context);
    }

    fn on_event(&mut self, event: EventId, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.expiry == Some(event) {
            context.request_reset();
        }
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}

/// The backup registers of an STM32H743.
#[derive(Debug, Default)]
pub struct Rtc;

impl Device for Rtc {
    type Register = rtc::Register;
}

/// Empties the backup registers of an STM32H743 at a reset of the backup domain (RM0433, 8.4.6).
#[derive(Debug)]
pub struct BackupDomain;

impl BackupDomain {
    const BDCR: u64 = 0x5802_4470;
    const BDRST: u64 = 1 << 16;
    const BKP0R: u64 = 0x5800_4050;

    /// To be called after every write to a register.
    pub fn after_write(part: &mut impl Operate, at: VirtualNanos, address: u64, value: u64) {
        if address == Self::BDCR && value & Self::BDRST != 0 {
            for register in 0..32 {
                let _ = part.write(at, Self::BKP0R + 4 * register, Width::W32, 0);
            }
        }
    }
}

/// A crystal that may be dead.
#[derive(Debug)]
pub struct Crystal {
    /// RCC_CR.
    pub control: u64,
    /// It does not start any more.
    pub dead: bool,
}

impl Crystal {
    const HSEON: u64 = 1 << 16;

    /// To be called after every write to a register.
    pub fn after_write(&self, part: &mut impl Operate, at: VirtualNanos, address: u64, value: u64) {
        if self.dead && address == self.control && value & Self::HSEON != 0 {
            let _ = part.write(at, self.control, Width::W32, value & !Self::HSEON);
        }
    }
}
