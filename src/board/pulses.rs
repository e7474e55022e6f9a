//! Servo pulses of a receiver on four inputs of a timer: pads S7 to S10 of the Matek H743-WING, channels 1 to 4 of TIM4. No emulator shows
//! it.
//!
//! The timer counts µs and catches both edges of each pulse; the level of the pin says which edge it was. Nothing is known of a pulse whose
//! beginning was not seen.

/// The board's outputs that are these inputs instead, if it has any.
#[cfg(not(feature = "board-matek-h743"))]
pub const OUTPUTS: Option<[u8; 4]> = None;
/// The board's outputs that are these inputs instead, if it has any.
#[cfg(feature = "board-matek-h743")]
pub const OUTPUTS: Option<[u8; 4]> = Some([6, 7, 8, 9]);

#[cfg(feature = "board-matek-h743")]
pub use self::timer::{begin, next};

/// Without inputs there is nothing to begin.
#[cfg(not(feature = "board-matek-h743"))]
pub fn begin() {}

/// Without inputs there is no pulse.
#[cfg(not(feature = "board-matek-h743"))]
pub async fn next() -> jetlink_rc::runner::MeasuredPulse {
    core::future::pending().await
}

#[cfg(feature = "board-matek-h743")]
mod timer {
    use core::cell::RefCell;
    use embassy_futures::select::{Either, select};
    use embassy_stm32::gpio::Pull;
    use embassy_stm32::interrupt::typelevel::{Interrupt, TIM4 as TIM4_INTERRUPT};
    use embassy_stm32::pac::gpio::vals::Idr;
    use embassy_stm32::timer::Channel;
    use embassy_stm32::timer::input_capture::{CapturePin, Ch1, Ch2, Ch3, Ch4};
    use embassy_stm32::timer::low_level::{FilterValue, InputCaptureMode, InputTISelection, Timer as Driver};
    use embassy_stm32::{interrupt, pac, peripherals, time::Hertz};
    use embassy_sync::blocking_mutex::{Mutex, raw::CriticalSectionRawMutex};
    use embassy_sync::channel;
    use embassy_time::{Duration, Instant, Timer};
    use jetlink_fw::config::RADIO;
    use jetlink_rc::config::Protocol;
    use jetlink_rc::runner::MeasuredPulse;

    /// Without servo pulses nothing of it is in the image but an empty handler.
    const IS_USED: bool = match &RADIO {
        Some(radio) => matches!(radio.protocol, Protocol::Pwm),
        None => false,
    };

    const CHANNELS: [Channel; 4] = [Channel::Ch1, Channel::Ch2, Channel::Ch3, Channel::Ch4];
    /// Number of the first pin, PD12.
    const FIRST_PIN: usize = 12;
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
            use peripherals::{PD12, PD13, PD14, PD15, TIM4};
            let pins = (
                CapturePin::<TIM4, Ch1>::new(PD12::steal(), Pull::Down),
                CapturePin::<TIM4, Ch2>::new(PD13::steal(), Pull::Down),
                CapturePin::<TIM4, Ch3>::new(PD14::steal(), Pull::Down),
                CapturePin::<TIM4, Ch4>::new(PD15::steal(), Pull::Down),
            );
            (Driver::new(TIM4::steal()), pins)
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
        timer.start();
        core::mem::forget(timer);
        TIM4_INTERRUPT::unpend();
        // SAFETY: its handler is below, and its data is behind a lock.
        unsafe { TIM4_INTERRUPT::enable() };
    }

    /// Waits for the end of a pulse on any of the inputs.
    #[expect(clippy::disallowed_methods, reason = "inputs that rest are tried again")]
    pub async fn next() -> MeasuredPulse {
        loop {
            match select(PULSES.receive(), Timer::after(WINDOW)).await {
                Either::First(pulse) => return pulse,
                // Inputs that rest are tried again.
                Either::Second(()) => critical_section(|| {
                    pac::TIM4
                        .dier()
                        .modify(|w| (0..CHANNELS.len()).for_each(|place| w.set_ccie(place, true)));
                }),
            }
        }
    }

    fn critical_section(act: impl FnOnce()) {
        INPUTS.lock(|_| act());
    }

    #[interrupt]
    fn TIM4() {
        if IS_USED {
            edges();
        }
    }

    /// Takes the edges that the timer has caught.
    #[expect(clippy::disallowed_methods, reason = "an edge is stamped where it is caught")]
    fn edges() {
        let flags = pac::TIM4.sr().read();
        let now = Instant::now();
        INPUTS.lock(|inputs| {
            for (place, input) in
                inputs.borrow_mut().iter_mut().enumerate().filter(|(place, _)| flags.ccif(*place))
            {
                // Reading it clears the flag.
                let count = pac::TIM4.ccr(place).read().ccr();
                let is_high = pac::GPIOD.idr().read().idr(FIRST_PIN + place) == Idr::HIGH;
                if let Some((width, period)) = input.edge(now, count, is_high) {
                    // As many as wait are older than what counts: the rest is dropped.
                    let _ = PULSES.try_send(MeasuredPulse { number: place as u8 + 1, width, period });
                }
                if input.edges > MOST_EDGES {
                    *input = NOTHING;
                    pac::TIM4.dier().modify(|w| w.set_ccie(place, false));
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
