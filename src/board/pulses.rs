//! Servo pulses of a receiver on the four channels of a timer (`boards/` has the boards with one).
//!
//! The timer counts µs and catches both edges of each pulse; the level of the pin says which edge it was. What they are as pulses is in
//! [`jetlink_rc::edges`].

/// The board's outputs that are these inputs instead, if it has any.
#[cfg(not(board_pulses))]
pub const OUTPUTS: Option<[u8; 4]> = None;
/// The board's outputs that are these inputs instead, if it has any.
#[cfg(board_pulses)]
pub const OUTPUTS: Option<[u8; 4]> = Some(super::table::capture::OUTPUTS);

#[cfg(board_pulses)]
pub use self::timer::{begin, next, rests};

/// Without inputs there is nothing to begin.
#[cfg(not(board_pulses))]
pub fn begin() {}

/// Without inputs none has to rest.
#[cfg(not(board_pulses))]
pub const fn rests() -> u32 {
    0
}

/// Without inputs there is no pulse.
#[cfg(not(board_pulses))]
pub async fn next() -> jetlink_rc::runner::MeasuredPulse {
    core::future::pending().await
}

#[cfg(board_pulses)]
mod timer {
    use super::super::table::capture::{self, PINS, REGISTERS};
    use core::cell::RefCell;
    use embassy_futures::select::{Either, select};
    use embassy_stm32::gpio::Pull;
    use embassy_stm32::interrupt::typelevel::Interrupt;
    use embassy_stm32::pac::gpio::vals::Idr;
    use embassy_stm32::time::Hertz;
    use embassy_stm32::timer::Channel;
    use embassy_stm32::timer::input_capture::{CapturePin, Ch1, Ch2, Ch3, Ch4};
    use embassy_stm32::timer::low_level::{FilterValue, InputCaptureMode, InputTISelection, Timer as Driver};
    use embassy_sync::blocking_mutex::{Mutex, raw::CriticalSectionRawMutex};
    use embassy_sync::channel;
    use embassy_time::{Instant, Timer};
    use jetlink_rc::edges::{Caught, Edges, LOOK_AFTER};
    use jetlink_rc::runner::MeasuredPulse;

    const CHANNELS: [Channel; 4] = [Channel::Ch1, Channel::Ch2, Channel::Ch3, Channel::Ch4];

    static EDGES: Mutex<CriticalSectionRawMutex, RefCell<Edges>> = Mutex::new(RefCell::new(Edges::new()));
    static PULSES: channel::Channel<CriticalSectionRawMutex, MeasuredPulse, 8> = channel::Channel::new();

    /// Takes the pins and starts the timer. Call it once.
    pub fn begin() {
        // SAFETY: the table of the board reserves these pins as outputs, and a check keeps outputs off them while they are inputs; nothing
        // else uses the timer. They are pulled down: a broken wire is silent.
        let (mut timer, pins) = unsafe {
            let (one, two, three, four) = capture::steal();
            let pins = (
                CapturePin::<capture::Timer, Ch1>::new(one, Pull::Down),
                CapturePin::<capture::Timer, Ch2>::new(two, Pull::Down),
                CapturePin::<capture::Timer, Ch3>::new(three, Pull::Down),
                CapturePin::<capture::Timer, Ch4>::new(four, Pull::Down),
            );
            (Driver::new(capture::Timer::steal()), pins)
        };
        // They stay as they are: dropped, they would float.
        core::mem::forget(pins);
        timer.set_tick_freq(Hertz(1_000_000));
        timer.generate_update_event();
        for channel in CHANNELS {
            timer.set_input_ti_selection(channel, InputTISelection::Normal);
            // Shorter than 1 µs is not an edge.
            timer.set_input_capture_filter(channel, FilterValue::FDTS_DIV32_N8);
            timer.set_input_capture_mode(channel, InputCaptureMode::BothEdges);
            timer.set_input_capture_prescaler(channel, 0);
            timer.enable_channel(channel, true);
            timer.enable_input_interrupt(channel, true);
        }
        capture::TAKER.lock(|taker| taker.set(Some(edges)));
        timer.start();
        core::mem::forget(timer);
        capture::Interrupt::unpend();
        // SAFETY: its handler is in `table.rs`, and its data is behind a lock.
        unsafe { capture::Interrupt::enable() };
    }

    /// Times that an input had to rest, because there was noise on it.
    pub fn rests() -> u32 {
        EDGES.lock(|edges| edges.borrow().rests())
    }

    /// Waits for the end of a pulse on any of the inputs.
    #[expect(clippy::disallowed_methods, reason = "inputs that rest are tried again")]
    pub async fn next() -> MeasuredPulse {
        loop {
            let pulse = select(PULSES.receive(), Timer::after(LOOK_AFTER)).await;
            EDGES.lock(|edges| edges.borrow_mut().rested(Instant::now()).for_each(catch_again));
            if let Either::First(pulse) = pulse {
                return pulse;
            }
        }
    }

    /// Catches the edges of an input again.
    fn catch_again(place: usize) {
        // Reading it clears the flag of an edge that was caught meanwhile, and is old.
        let _ = REGISTERS.ccr(place).read();
        REGISTERS.dier().modify(|w| w.set_ccie(place, true));
    }

    /// Takes the edges that the timer has caught.
    #[expect(clippy::disallowed_methods, reason = "an edge is stamped where it is caught")]
    fn edges() {
        let flags = REGISTERS.sr().read();
        let now = Instant::now();
        EDGES.lock(|edges| {
            for (place, (gpio, pin)) in PINS.into_iter().enumerate() {
                if !flags.ccif(place) {
                    continue;
                }
                // Reading it clears the flag.
                let count = REGISTERS.ccr(place).read().ccr();
                let is_high = gpio.idr().read().idr(pin) == Idr::HIGH;
                match edges.borrow_mut().edge(now, place, count, is_high) {
                    Caught::Edge => {}
                    // As many as wait are older than what is used: the rest is dropped.
                    Caught::Pulse(pulse) => drop(PULSES.try_send(pulse)),
                    Caught::Noise => REGISTERS.dier().modify(|w| w.set_ccie(place, false)),
                }
            }
        });
    }
}
