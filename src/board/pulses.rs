//! Servo pulses of a receiver on the four channels of a timer (`boards/` has the boards with one). No emulator shows it.
//!
//! The timer counts µs and catches both edges of each pulse; the level of the pin says which edge it was. Nothing is known of a pulse whose
//! beginning was not seen.

/// The board's outputs that are these inputs instead, if it has any.
#[cfg(not(board_pulses))]
pub const OUTPUTS: Option<[u8; 4]> = None;
/// The board's outputs that are these inputs instead, if it has any.
#[cfg(board_pulses)]
pub const OUTPUTS: Option<[u8; 4]> = Some(super::table::capture::OUTPUTS);

#[cfg(board_pulses)]
pub use self::timer::{begin, next};

/// Without inputs there is nothing to begin.
#[cfg(not(board_pulses))]
pub fn begin() {}

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
    use embassy_time::{Duration, Instant, Timer};
    use jetlink_rc::runner::MeasuredPulse;

    const CHANNELS: [Channel; 4] = [Channel::Ch1, Channel::Ch2, Channel::Ch3, Channel::Ch4];
    /// The counter has 16 bits: what is longer is measured by the clock of the node.
    const COUNTS: Duration = Duration::from_millis(60);
    /// Edges of a channel in this time that are taken. More are noise: its interrupts rest then, as they are above every engine.
    const WINDOW: Duration = Duration::from_millis(20);
    const MOST_EDGES: u8 = 24;

    /// One input.
    #[derive(Clone, Copy)]
    struct Input {
        /// Counter and time at the last rise.
        rise: Option<(u16, Instant)>,
        /// Time between the last two rises, in µs.
        period: Option<u32>,
        /// Edges since then.
        edges: u8,
        since: Instant,
    }

    const NOTHING: Input = Input { rise: None, period: None, edges: 0, since: Instant::MIN };

    static INPUTS: Mutex<CriticalSectionRawMutex, RefCell<[Input; 4]>> =
        Mutex::new(RefCell::new([NOTHING; 4]));
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
            // Shorter than 1 µs is no edge.
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

    /// Waits for the end of a pulse on any of the inputs.
    #[expect(clippy::disallowed_methods, reason = "inputs that rest are tried again")]
    pub async fn next() -> MeasuredPulse {
        loop {
            match select(PULSES.receive(), Timer::after(WINDOW)).await {
                Either::First(pulse) => return pulse,
                // Inputs that rest are tried again.
                Either::Second(()) => critical_section(|| {
                    REGISTERS
                        .dier()
                        .modify(|w| (0..CHANNELS.len()).for_each(|place| w.set_ccie(place, true)));
                }),
            }
        }
    }

    fn critical_section(act: impl FnOnce()) {
        INPUTS.lock(|_| act());
    }

    /// Takes the edges that the timer has caught.
    #[expect(clippy::disallowed_methods, reason = "an edge is stamped where it is caught")]
    fn edges() {
        let flags = REGISTERS.sr().read();
        let now = Instant::now();
        INPUTS.lock(|inputs| {
            for ((place, input), (gpio, pin)) in inputs.borrow_mut().iter_mut().enumerate().zip(PINS) {
                if !flags.ccif(place) {
                    continue;
                }
                // Reading it clears the flag.
                let count = REGISTERS.ccr(place).read().ccr();
                let is_high = gpio.idr().read().idr(pin) == Idr::HIGH;
                if let Some((width, period)) = input.edge(now, count, is_high) {
                    // As many as wait are older than what counts: the rest is dropped.
                    let _ = PULSES.try_send(MeasuredPulse { number: place as u8 + 1, width, period });
                }
                if input.edges > MOST_EDGES {
                    *input = NOTHING;
                    REGISTERS.dier().modify(|w| w.set_ccie(place, false));
                }
            }
        });
    }

    impl Input {
        /// Takes an edge. Returns width and period of a pulse that has ended.
        fn edge(&mut self, now: Instant, count: u16, is_high: bool) -> Option<(u32, u32)> {
            if now.saturating_duration_since(self.since) > WINDOW {
                (self.edges, self.since) = (0, now);
            }
            self.edges = self.edges.saturating_add(1);
            let passed = self.rise.map(|(before, at)| {
                let time = now.saturating_duration_since(at);
                let long = u32::try_from(time.as_micros()).unwrap_or(u32::MAX);
                if time > COUNTS { long } else { u32::from(count.wrapping_sub(before)) }
            });
            if is_high {
                (self.rise, self.period) = (Some((count, now)), passed);
                return None;
            }
            // A pulse ends once.
            Some((passed?, self.period.take()?))
        }
    }
}
