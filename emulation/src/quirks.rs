//! Workarounds that the emulator (rigless 0.4.0) needs to run this firmware. All of them are here, none in the firmware.
//!
//! 1. **Timers flag a match that the parts do not flag.** A write of 0 to the counter of a stopped timer, and
//!    a software update (`EGR.UG`), flag every compare channel whose register holds that value too, and after
//!    a reset all of them hold 0. embassy-stm32's time driver does both when it starts and takes the flag of
//!    channel 1 for half an overflow: the clock would begin at 32.8 ms and stumble at every turn. The parts
//!    do not show it: Embassy's log of an STM32F4 begins at 0.000000. So right after a `UG` on a stopped timer
//!    [`TimerFlags`] clears the compare flags, before the next instruction, and before any interrupt is on.
//! 2. **The H743 has no watchdog.** Its clock and its reset flag are there, the peripheral is not.
//!    [`Iwdg`] is the smallest one that bites: start, reload, prescaler, reset at zero (RM0433, chapter 45).
//!    Left out: the write lock and the window. A new prescaler and a new reload value cross over at once (its status reads
//!    0, that is: done), unless a test requests the slowest. The F427's own watchdog model is used as it is.
//! 3. **The H743 has no real-time clock**, so no backup registers. [`Rtc`] holds what is written, over a reset
//!    too, as the backup domain does, and does nothing else. [`BackupDomain`] empties it when `RCC_BDCR.BDRST` is set.
//!    That writes need `PWR_CR1.DBP`, and that `RTCSEL` is written once until then, rigless knows by itself. The
//!    F427's own model is used as it is.
//! 4. **A crystal always starts**, and so does everything else that a start waits for. [`DeadEnable`] lets a crystal, a PLL or
//!    the F427's over-drive be dead: right after each write that turns it on, it is turned off again, before its flag
//!    rises. [`DeadRegulator`] takes the place of the H743's power controller, with a flag that never rises.

use std::collections::HashMap;

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::Width;
use rigless::soc::stm32h743::generated::{iwdg::Register, pwr, rtc};
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

    /// Call it after every write to a register.
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
    /// A new prescaler or reload value takes six periods of the LSI, times the prescaler, to cross over; as long as ST's
    /// HAL allows. What is written meanwhile is ignored.
    pub slow: bool,
    /// The crossings under way, of PR and RLR, and what crosses over.
    crossing: [Option<(EventId, u64)>; 2],
    /// What has crossed over, in PR and RLR.
    crossed: [u64; 2],
}

impl Iwdg {
    const CROSSING: [Register; 2] = [Register::Pr, Register::Rlr];

    fn arm(&mut self, context: &mut DeviceContext<'_>) {
        self.expiry = None;
        if self.started && self.hz != 0 {
            let cycles = (self.load + 1) * divider(self.crossed[0]);
            let at = VirtualNanos(self.from + cycles * 1_000_000_000 / self.hz);
            self.expiry = Some(context.schedule(at));
        }
    }

    /// A value on its way to the watchdog's own clock.
    fn cross(&mut self, which: usize, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let value = registers.get(Self::CROSSING[which]);
        if !self.slow {
            self.crossed[which] = value;
            return;
        }
        if let Some((_, under_way)) = self.crossing[which] {
            registers.set(Self::CROSSING[which], under_way); // what comes now is ignored
            return;
        }
        let slowest = divider(self.crossed[0]).max(divider(registers.get(Register::Pr)));
        let at = context.now().0 + 6 * slowest * 1_000_000_000 / 32_000;
        self.crossing[which] = Some((context.schedule(VirtualNanos(at)), value));
        registers.set(Register::Sr, registers.get(Register::Sr) | 1 << which);
    }
}

/// What a prescaler divides by.
fn divider(prescaler: u64) -> u64 {
    4 << prescaler.min(6)
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
        match register {
            Register::Kr => {
                let now = context.now().0;
                match value {
                    0xCCCC if !self.started => {
                        (self.started, self.from, self.load) = (true, now, 0xFFF);
                        context.request(IWDG_STARTED, Level::High); // the RCC turns its oscillator on
                    }
                    0xAAAA => (self.from, self.load) = (now, self.crossed[1]),
                    _ => {}
                }
            }
            Register::Pr => self.cross(0, registers, context),
            Register::Rlr => self.cross(1, registers, context),
            _ => {}
        }
        self.arm(context);
    }

    fn on_clock(&mut self, hz: u64, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.hz = hz;
        self.arm(context);
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.expiry == Some(event) {
            context.request_reset();
        }
        for which in 0..2 {
            if let Some((crossed, value)) = self.crossing[which]
                && crossed == event
            {
                self.crossing[which] = None;
                self.crossed[which] = value;
                registers.set(Register::Sr, registers.get(Register::Sr) & !(1 << which));
            }
        }
    }

    fn reset(&mut self) {
        *self = Self { slow: self.slow, crossed: [0, 0xFFF], ..Self::default() };
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

    /// Call it after every write to a register.
    pub fn after_write(part: &mut impl Operate, at: VirtualNanos, address: u64, value: u64) {
        if address == Self::BDCR && value & Self::BDRST != 0 {
            for register in 0..32 {
                let _ = part.write(at, Self::BKP0R + 4 * register, Width::W32, 0);
            }
        }
    }
}

/// What never gets ready, until the part is reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stuck {
    /// PLLRDY.
    Pll,
    /// ODRDY of an STM32F427.
    OverDrive,
    /// VOSRDY of an STM32H743.
    VoltageScale,
}

/// An enable bit that does not hold: right after each write that sets it, it is cleared again, before its ready flag rises.
#[derive(Clone, Copy, Debug)]
pub struct DeadEnable {
    /// The register.
    pub register: u64,
    /// The bit.
    pub bit: u64,
}

impl DeadEnable {
    /// HSEON of RCC_CR: a crystal that does not start.
    pub const fn crystal(clock_control: u64) -> Self {
        Self { register: clock_control, bit: 1 << 16 }
    }

    /// What is stuck for such a bit: PLLON, or PLL1ON, of RCC_CR; ODEN of an STM32F427's PWR_CR.
    pub const fn of(stuck: Stuck, clock_control: u64) -> Option<Self> {
        match stuck {
            Stuck::Pll => Some(Self { register: clock_control, bit: 1 << 24 }),
            Stuck::OverDrive => Some(Self { register: 0x4000_7000, bit: 1 << 16 }),
            Stuck::VoltageScale => None,
        }
    }

    /// Call it after every write to a register.
    pub fn after_write(self, part: &mut impl Operate, at: VirtualNanos, address: u64, value: u64) {
        if address == self.register && value & self.bit != 0 {
            let _ = part.write(at, self.register, Width::W32, value & !self.bit);
        }
    }
}

/// The power controller of an STM32H743 whose regulator never reaches another voltage scale: in place of rigless's own.
#[derive(Debug, Default)]
pub struct DeadRegulator;

impl Device for DeadRegulator {
    type Register = pwr::Register;

    fn read(
        &mut self,
        register: pwr::Register,
        registers: &mut RegisterFile,
        _: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        const READY: u64 = 1 << 13; // ACTVOSRDY and VOSRDY
        match register {
            pwr::Register::Csr1 => Some(registers.get(register) | READY),
            pwr::Register::D3cr => Some(registers.get(register) & !READY),
            _ => None,
        }
    }
}
