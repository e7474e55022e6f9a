//! Embassy's time driver. The board's microsecond counter is the clock, and SysTick interrupts for
//! the next timer: SysTick alone would lose time at every new alarm, or interrupt thousands of times
//! a second.

use super::hardware::{CLOCK_HZ, Register};
use core::cell::RefCell;
use core::task::Waker;
use cortex_m_rt::exception;
use embassy_sync::blocking_mutex::{Mutex, raw::CriticalSectionRawMutex};
use embassy_time_driver::{Driver, TICK_HZ};
use embassy_time_queue_utils::Queue;

const COUNTER: Register = Register::at(0x4002_8018);
const PRESCALE: Register = Register::at(0x4002_801C);

const SYST_CSR: Register = Register::at(0xE000_E010);
const SYST_RVR: Register = Register::at(0xE000_E014);
const SYST_CVR: Register = Register::at(0xE000_E018);
/// Core clock, interrupt, enable.
const SYST_ON: u32 = 0b111;
/// SysTick counts 24 bits: 0.67 s.
const SYST_MAX: u64 = 0x00FF_FFFF;

const CYCLES_PER_TICK: u32 = CLOCK_HZ / TICK_HZ as u32;

struct Clock(Mutex<CriticalSectionRawMutex, RefCell<State>>);

struct State {
    /// The counter at the last read, and the number of wraps until then (one every 71 minutes).
    counter: u32,
    wraps: u32,
    timers: Queue,
}

embassy_time_driver::time_driver_impl!(static CLOCK: Clock = Clock(Mutex::new(RefCell::new(State {
    counter: 0,
    wraps: 0,
    timers: Queue::new(),
}))));

/// Starts the clock at 0.
pub fn start() {
    PRESCALE.write(CYCLES_PER_TICK - 1);
    COUNTER.write(0);
    CLOCK.ring();
}

impl Driver for Clock {
    fn now(&self) -> u64 {
        self.with(State::now)
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        self.with(|state| {
            if state.timers.schedule_wake(at, waker) {
                state.set_alarm();
            }
        });
    }
}

impl Clock {
    fn with<T>(&self, act: impl FnOnce(&mut State) -> T) -> T {
        self.0.lock(|state| act(&mut state.borrow_mut()))
    }

    /// Wakes all timers that are due.
    fn ring(&self) {
        self.with(State::set_alarm);
    }
}

impl State {
    fn now(&mut self) -> u64 {
        // SysTick interrupts at least every 0.67 s, so no wrap is missed.
        let counter = COUNTER.read();
        if counter < self.counter {
            self.wraps += 1;
        }
        self.counter = counter;
        u64::from(self.wraps) << 32 | u64::from(counter)
    }

    /// Wakes all timers that are due and sets SysTick for the next one.
    fn set_alarm(&mut self) {
        let now = self.now();
        let next = self.timers.next_expiration(now);
        // One tick more: the counter may be about to advance.
        let cycles = (next - now).saturating_add(1).saturating_mul(CYCLES_PER_TICK.into());
        SYST_CSR.write(0);
        SYST_RVR.write(cycles.min(SYST_MAX) as u32);
        SYST_CVR.write(0); // any write: count from RVR
        SYST_CSR.write(SYST_ON);
    }
}

#[exception]
fn SysTick() {
    CLOCK.ring();
}
