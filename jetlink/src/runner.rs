//! Moves bytes and time between one engine and one UART. Only this file and [`crate::channel`] read the clock, and only this
//! one waits.

use crate::channel::Channel;
use crate::engine::TRANSMITTER_FAILED;
use crate::line::LineError;
use crate::link::{Output, Transmission};
use crate::report::NotSent;
use core::cell::Cell;
use core::sync::atomic::{AtomicU32, Ordering};
use embassy_futures::select::{Either, Either3, select, select3};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer, with_deadline};
use embedded_io_async::{Error, ErrorKind, Read, Write};

/// Longest interval between two signs of progress of the runner.
const HEARTBEAT: Duration = Duration::from_millis(100);
/// Timeout of a transmission, up to its last stop bit, 40 ms. Five bytes take 20.8 ms at 2400 baud.
const WRITE_LIMIT: Duration = Duration::from_millis(40);
/// Age of a frame from which on it must no longer leave the driver. A transmission at 2400 baud takes a tenth of it.
const OLDEST: Duration = Duration::from_millis(200);
/// Pause after a read error, so that a UART that fails at once does not occupy the processor.
const READ_PAUSE: Duration = Duration::from_millis(1);

/// Line errors of one UART, counted in its interrupt: some drivers do not return them.
#[derive(Debug, Default)]
pub struct LineErrors {
    framing: AtomicU32,
    noise: AtomicU32,
    overrun: AtomicU32,
    parity: AtomicU32,
}

impl LineErrors {
    /// No errors.
    pub const fn new() -> Self {
        Self {
            framing: AtomicU32::new(0),
            noise: AtomicU32::new(0),
            overrun: AtomicU32::new(0),
            parity: AtomicU32::new(0),
        }
    }

    /// Counts one. May be called from an interrupt.
    pub fn count(&self, error: LineError) {
        if let Some(counter) = self.counter(error) {
            // Not every core has atomic read-modify-write.
            critical_section::with(|_| {
                counter.store(counter.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
            });
        }
    }

    fn counter(&self, error: LineError) -> Option<&AtomicU32> {
        match error {
            LineError::Framing => Some(&self.framing),
            LineError::Noise => Some(&self.noise),
            LineError::Overrun => Some(&self.overrun),
            LineError::Parity => Some(&self.parity),
            LineError::Read => None,
        }
    }

    /// Takes the errors counted since the last call.
    pub fn drain(&self, mut each: impl FnMut(LineError)) {
        for error in [LineError::Framing, LineError::Noise, LineError::Overrun, LineError::Parity] {
            let count = self.counter(error).map_or(0, |counter| {
                critical_section::with(|_| {
                    let count = counter.load(Ordering::Relaxed);
                    counter.store(0, Ordering::Relaxed);
                    count
                })
            });
            for _ in 0..count {
                each(error);
            }
        }
    }
}

/// Runs one engine on one UART.
pub struct Runner<'a> {
    channel: &'a Channel,
    /// All engines of the group, this one among them.
    group: &'a [Channel],
    /// Failure of this engine, as last reported to the others.
    failed: Cell<bool>,
    /// Transmission for the writing half. A link hands out one at a time.
    outgoing: Signal<NoopRawMutex, Transmission>,
    /// The engine was started.
    started: Cell<bool>,
    /// The result of a transmission was not reported to the engine yet.
    outstanding: Cell<bool>,
    /// What is read now may have waited in the UART since before the run: its age is not known.
    waited: Cell<bool>,
    /// The engine has changed since the receivers of telemetry were last woken.
    changed: Cell<bool>,
}

impl Channel {
    /// The runner of this engine, for the task that owns the UART. Run it once.
    pub const fn runner(&self) -> Runner<'_> {
        self.runner_in(core::slice::from_ref(self))
    }

    /// The runner of this engine as one of a group.
    pub const fn runner_in<'a>(&'a self, group: &'a [Self]) -> Runner<'a> {
        Runner::new(self, group)
    }
}

impl core::fmt::Debug for Runner<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Runner").field("channel", self.channel).finish_non_exhaustive()
    }
}

impl<'a> Runner<'a> {
    const fn new(channel: &'a Channel, group: &'a [Channel]) -> Self {
        Self {
            channel,
            group,
            failed: Cell::new(false),
            outgoing: Signal::new(),
            started: Cell::new(false),
            outstanding: Cell::new(false),
            waited: Cell::new(false),
            changed: Cell::new(true),
        }
    }

    /// Runs forever. `rx` and `tx` are the two halves of a UART with the engine's line settings, for example of an
    /// `embassy_stm32::usart::BufferedUart`; `errors` are the line errors that its interrupt counts, if it does.
    ///
    /// Each half has its own loop, so that a transmission that hangs does not delay reception, and reception does not cut a
    /// transmission short.
    ///
    /// Read errors and failed writes are counted. The reading half has to be cancel safe, as all of Embassy's are: a dropped
    /// read loses no bytes.
    pub async fn run<R: Read, W: Write>(self, rx: R, tx: W, errors: &LineErrors) -> ! {
        self.serve(rx, tx, errors, false).await;
        // It does not give up.
        core::future::pending().await
    }

    /// Runs until a frame was not sent within 0.2 s, or no transmission has succeeded for 1 s, then drops the halves: open the UART
    /// again, which discards the bytes that wait in it, so that no older frame is sent, and call this again. To the engine it is a
    /// failed transmission.
    pub async fn run_until_stuck<R: Read, W: Write>(&self, rx: R, tx: W, errors: &LineErrors) {
        self.serve(rx, tx, errors, true).await;
    }

    #[expect(clippy::disallowed_methods, reason = "the runner is where the clock is read")]
    async fn serve<R: Read, W: Write>(&self, rx: R, tx: W, errors: &LineErrors, gives_up: bool) {
        if !self.started.replace(true) {
            self.channel.begin(Instant::now());
        }
        self.outgoing.reset();
        self.waited.set(true);
        if self.outstanding.take() {
            self.channel.with(|engine| engine.not_sent(Instant::now(), NotSent::TimedOut));
        }
        select(self.receive(rx, errors), self.transmit(tx, gives_up)).await;
    }

    #[expect(clippy::disallowed_methods, reason = "the runner is where the clock is read")]
    async fn receive<R: Read>(&self, mut rx: R, errors: &LineErrors) -> ! {
        let mut buffer = [0; 64];
        loop {
            let deadline = self.drain().await;
            self.publish();
            self.report_failure();
            self.channel.made_progress();
            let heartbeat = Instant::now() + HEARTBEAT;
            let wake = match deadline {
                // At once, if nothing has waited.
                _ if self.waited.get() => Instant::MIN,
                Some(deadline) => deadline.min(heartbeat),
                None => heartbeat,
            };
            let woken = select3(rx.read(&mut buffer), self.channel.wake.wait(), Timer::at(wake)).await;
            errors.drain(|error| self.channel.with(|engine| engine.line_error(error)));
            // A read that does not fill the buffer takes all that has waited.
            let more = matches!(&woken, Either3::First(Ok(count)) if *count == buffer.len());
            if let Either3::First(read) = woken {
                match read {
                    Ok(0) => self.read_failed(LineError::Read).await,
                    Ok(count) => self.feed(buffer.get(..count).unwrap_or_default()).await,
                    Err(error) => self.read_failed(line_error(error.kind())).await,
                }
            }
            self.waited.set(self.waited.get() && more);
            // After every wake, so that a babbling ECU cannot delay a send slot or hide a loss.
            let now = Instant::now();
            if deadline.is_some_and(|deadline| now >= deadline) {
                self.channel.with(|engine| engine.timeout(now));
            }
        }
    }

    #[expect(clippy::disallowed_methods, reason = "the runner is where the clock is read")]
    async fn feed(&self, mut bytes: &[u8]) {
        let now = Instant::now();
        while !bytes.is_empty() {
            let (taken, frame) =
                self.channel.with(|engine| (engine.receive(now, bytes), engine.has_frame_to_supervise()));
            if frame {
                self.changed.set(true);
                self.drain().await;
                self.channel.with(|engine| engine.supervise());
                self.drain().await;
            }
            bytes = bytes.get(taken.max(1)..).unwrap_or_default();
        }
        // A babbling ECU must leave the processor to others.
        yield_now().await;
    }

    #[expect(clippy::disallowed_methods, reason = "the runner is where the clock is read")]
    async fn read_failed(&self, error: LineError) {
        self.channel.with(|engine| engine.byte_lost(error));
        Timer::after(READ_PAUSE).await;
    }

    /// Returns if it gives up on a transmitter that is stuck.
    #[expect(clippy::disallowed_methods, reason = "the runner is where the clock is read")]
    async fn transmit<W: Write>(&self, mut tx: W, gives_up: bool) {
        let mut failing_since: Option<Instant> = None;
        // When the frame was written that may still wait in the driver. Nothing waits in a UART that was opened just now, and a driver may
        // never end the flush of one that has sent nothing.
        let mut waits_since: Option<Instant> = None;
        loop {
            let too_old = waits_since.filter(|_| gives_up).map_or(Instant::MAX, |since| since + OLDEST);
            let Either::First(transmission) = select(self.outgoing.wait(), Timer::at(too_old)).await else {
                return;
            };
            let limit = too_old.min(Instant::now() + WRITE_LIMIT);
            let write = async {
                if waits_since.is_some() {
                    // A command behind those bytes would be sent too late.
                    tx.flush().await.map_err(|_| NotSent::Failed)?;
                }
                let now = Instant::now();
                if transmission.start_by.is_some_and(|start_by| now > start_by) {
                    return Err(NotSent::TooLate);
                }
                waits_since = Some(now);
                tx.write_all(transmission.as_bytes()).await.map_err(|_| NotSent::Failed)?;
                // Done when the last stop bit is out.
                tx.flush().await.map_err(|_| NotSent::Failed)
            };
            let result = with_deadline(limit, write).await.unwrap_or(Err(NotSent::TimedOut));
            if result != Err(NotSent::TimedOut) {
                waits_since = None;
            }
            let now = Instant::now();
            self.outstanding.set(false);
            self.channel.with(|engine| match result {
                Ok(()) => engine.sent(now),
                Err(why) => engine.not_sent(now, why),
            });
            // The reading half drains the next output and deadline.
            self.channel.wake.signal(());
            match result {
                Ok(()) => failing_since = None,
                Err(NotSent::TooLate) => {}
                Err(_) if gives_up && now >= *failing_since.get_or_insert(now) + TRANSMITTER_FAILED => return,
                Err(_) => {}
            }
            if result == Err(NotSent::Failed) {
                // A writer that fails at once must not starve the reading half.
                yield_now().await;
            }
        }
    }

    /// Performs the engine's outputs. Returns when to wake it.
    async fn drain(&self) -> Option<Instant> {
        loop {
            let output = self.channel.with(|engine| {
                engine.compose();
                engine.poll()
            });
            match output {
                Output::Transmit(mut transmission) => {
                    if self.waited.get() {
                        // The window of a reply to it may be over.
                        transmission.start_by = transmission.start_by.map(|_| Instant::MIN);
                    }
                    self.outstanding.set(true);
                    self.outgoing.signal(transmission);
                    // Run the writing half at once: a reply is sent before the supervision, and before anything is
                    // published.
                    yield_now().await;
                }
                Output::Event(event) => self.channel.events.immediate_publisher().publish_immediate(event),
                Output::Wait(deadline) => return deadline,
            }
            self.changed.set(true);
        }
    }

    /// Reports a failure of this engine, or its recovery, to the other engines of the group.
    #[expect(clippy::disallowed_methods, reason = "the runner is where the clock is read")]
    fn report_failure(&self) {
        let failed = self.channel.inspect(|engine| engine.failed());
        if self.failed.replace(failed) == failed {
            return;
        }
        let now = Instant::now();
        for other in self.group.iter().filter(|other| !core::ptr::eq(*other, self.channel)) {
            other.with(|engine| engine.other_failed(now, failed));
            other.wake.signal(());
        }
    }

    fn publish(&self) {
        if self.changed.take() {
            self.channel.news.sender().send(());
        }
    }
}

fn line_error(kind: ErrorKind) -> LineError {
    match kind {
        // The closest kind of `embedded-io` for a damaged byte.
        ErrorKind::InvalidData => LineError::Framing,
        _ => LineError::Read,
    }
}
