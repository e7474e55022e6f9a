//! Moves bytes and time between a service and its ports. Only this file reads the clock, and only this one waits.
//!
//! One task polls all loops of a node. It can have the lowest priority: no engine waits for it.

use crate::attached::{Attached, Nothing};
use crate::packets::{Connection, PACKET, ReadPacket, WritePacket};
use crate::service::{Request, Service};
use crate::store::{AtRest, Flash, NotSaved, Store};
use core::array::from_fn;
use core::cell::{Cell, RefCell};
use core::fmt;
use embassy_futures::join::join;
use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};

/// Bytes that are written at once. The buffer of a UART's driver has to have space for them.
pub const WRITE: usize = 32;
/// Bytes that are read at once.
const READ: usize = 64;
/// Pause after a port error, so that a port that fails at once does not occupy the processor.
const PAUSE: Duration = Duration::from_millis(10);
/// Time between two checks of whether the engines are at rest.
const LOOK: Duration = Duration::from_millis(50);
/// Time from a request to its delivery, in which the answers go out.
const ANSWERED: Duration = Duration::from_millis(200);

/// The service has no port of this number.
struct NoSuchPort;

/// Runs a service on its ports.
pub struct Runner<'a, const N: usize, const P: usize, A: Attached = Nothing> {
    service: RefCell<Service<'a, N, P, A>>,
    /// Something has arrived.
    arrived: Signal<NoopRawMutex, ()>,
    /// Something may have to be stored.
    to_save: Signal<NoopRawMutex, ()>,
    /// Bytes wait for this port.
    waiting: [Signal<NoopRawMutex, ()>; P],
}

impl<const N: usize, const P: usize, A: Attached> fmt::Debug for Runner<'_, N, P, A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Runner").field("service", &self.service).finish_non_exhaustive()
    }
}

impl<'a, const N: usize, const P: usize, A: Attached> Runner<'a, N, P, A> {
    /// For this service.
    pub fn new(service: Service<'a, N, P, A>) -> Self {
        Self {
            service: RefCell::new(service),
            arrived: Signal::new(),
            to_save: Signal::new(),
            waiting: from_fn(|_| Signal::new()),
        }
    }

    /// Counters of a port.
    #[cfg(test)]
    pub(crate) fn port_counters(&self, port: usize) -> Option<crate::port::PortCounters> {
        self.service.borrow().port_counters(port)
    }

    /// Does what is due, until the node has to do something itself. `after` comes after each step, for what has to be retained.
    #[expect(clippy::disallowed_methods, reason = "the runner is where the clock is read, and what waits")]
    pub async fn keep_time(&self, mut after: impl FnMut(Instant, &Service<'a, N, P, A>)) -> Request {
        let mut request = None;
        loop {
            let now = Instant::now();
            let next = {
                let mut service = self.service.borrow_mut();
                let next = service.poll(now);
                for (port, waiting) in self.waiting.iter().enumerate() {
                    if service.is_waiting(port) {
                        waiting.signal(());
                    }
                }
                // Key and time stamp are also stored while no frame is received.
                if cfg!(feature = "signing") && !service.is_saved() {
                    self.to_save.signal(());
                }
                after(now, &service);
                request = service.request(now).map(|new| request.unwrap_or((new, now + ANSWERED)));
                next
            };
            // A save in progress is not interrupted.
            if let Some((request, _)) = request.filter(|&(_, due)| now >= due)
                && self.service.borrow().is_saved()
            {
                return request;
            }
            select(Timer::at(next), self.arrived.wait()).await;
        }
    }

    /// Serves a port, counted from 0, with its two halves.
    pub async fn serve(&self, port: usize, rx: impl Read, tx: impl Write) {
        join(self.read(port, rx), self.write(port, tx)).await;
    }

    /// Serves a port of packets, counted from 0. It is open while a program on the host has it open; anything that waits when that
    /// ends is dropped. A host that does not read takes nothing, and delays nothing else.
    #[expect(clippy::disallowed_methods, reason = "the runner is where the clock is read, and what waits")]
    pub async fn serve_packets(
        &self,
        port: usize,
        connection: &Connection,
        mut rx: impl ReadPacket,
        mut tx: impl WritePacket,
    ) {
        let followed = Cell::new(None);
        let set_open = |is_open| self.service.borrow_mut().set_open(Instant::now(), port, is_open);
        // Before each packet, as the host may have closed and opened the port since the last one.
        let follow = || {
            let opening = connection.opening();
            if followed.replace(opening) != opening {
                set_open(opening.is_some());
                self.arrived.signal(());
            }
            opening
        };
        set_open(false);
        let read = async {
            let mut packet = [0; PACKET];
            loop {
                match rx.read(&mut packet).await {
                    Ok(count) => {
                        connection.packet_came();
                        follow();
                        self.take(port, packet.get(..count).unwrap_or_default());
                        // A host that sends without a pause must not block other tasks.
                        yield_now().await;
                    }
                    Err(_) => Timer::after(PAUSE).await,
                }
            }
        };
        let write = async {
            loop {
                let opening = follow();
                let ends = connection.wait_for_another(opening);
                if opening.is_none() {
                    ends.await;
                    continue;
                }
                // A packet that the host does not take is dropped with the opening.
                if let Either::Second(NoSuchPort) = select(ends, self.write_packets(port, &mut tx)).await {
                    return;
                }
            }
        };
        join(read, write).await;
    }

    /// Stores settings. The store checks `at_rest` before it erases. This has to run from the start on, and must not be
    /// dropped during a save.
    #[expect(clippy::disallowed_methods, reason = "the runner is where the clock is read, and what waits")]
    pub async fn store_settings<F: Flash, const KEYS: usize>(
        &self,
        store: &mut Store<'_, F, KEYS>,
        at_rest: &AtRest,
    ) {
        let watch = async {
            loop {
                at_rest.set(self.service.borrow().is_at_rest());
                Timer::after(LOOK).await;
            }
        };
        let save = async {
            // Only one save is in the code, as its state is large. Saves left in a rewrite: one for each record, the
            // first record last, and once more, which erases the previous records.
            let mut left = 0_usize;
            let mut rewrite = false;
            // Whether a setting waits for the result of the whole rewrite.
            let mut requested = false;
            loop {
                rewrite |= self.service.borrow_mut().take_rewrite();
                let begins = core::mem::take(&mut rewrite);
                let place =
                    if begins { None } else { left.checked_sub(1).map(|last| last.saturating_sub(1)) };
                let result = if begins {
                    left = self.service.borrow().places() + 2;
                    store.begin_rewrite().await.map_err(|_| NotSaved::Failed)
                } else {
                    if left == 2 {
                        store.end_rewrite();
                    }
                    let next = match place {
                        Some(place) => self.service.borrow().record(place),
                        None => self.service.borrow_mut().next_save(),
                    };
                    // By reference: moved out, the record would have a second place in the state.
                    match &next {
                        Some((key, record)) => store.save(*key, record).await,
                        None if place.is_some() => Ok(()),
                        None => {
                            self.to_save.wait().await;
                            continue;
                        }
                    }
                };
                if place.is_none() && !begins {
                    requested = true;
                    if result == Err(NotSaved::Failed) && self.service.borrow().may_rewrite(store.keys()) {
                        rewrite = true;
                        continue;
                    }
                }
                left = if result.is_ok() { left.saturating_sub(1) } else { 0 };
                if left == 0 {
                    let mut service = self.service.borrow_mut();
                    if core::mem::take(&mut requested) {
                        service.saved(Instant::now(), result);
                    }
                    #[cfg(feature = "signing")]
                    service.rewritten(Instant::now(), result);
                    self.arrived.signal(());
                }
            }
        };
        select(watch, save).await;
    }

    #[expect(clippy::disallowed_methods, reason = "the runner is where the clock is read")]
    fn take(&self, port: usize, bytes: &[u8]) {
        self.service.borrow_mut().receive(Instant::now(), port, bytes);
        self.arrived.signal(());
        self.to_save.signal(());
    }

    #[expect(clippy::disallowed_methods, reason = "the runner is what waits")]
    async fn write_packets(&self, port: usize, tx: &mut impl WritePacket) -> NoSuchPort {
        let mut packet = [0; PACKET];
        let mut was_full = false;
        loop {
            let count = self.service.borrow_mut().transmit(port, &mut packet);
            if count == 0 && !was_full {
                match self.waiting.get(port) {
                    Some(waiting) => waiting.wait().await,
                    None => return NoSuchPort,
                }
                continue;
            }
            // An empty packet after a full one: the host passes on what it has.
            match tx.write(packet.get(..count).unwrap_or_default()).await {
                Ok(()) => was_full = count == PACKET,
                Err(_) => {
                    was_full = false;
                    Timer::after(PAUSE).await;
                }
            }
        }
    }

    #[expect(clippy::disallowed_methods, reason = "the runner is where the clock is read, and what waits")]
    async fn read(&self, port: usize, mut rx: impl Read) {
        let mut bytes = [0; READ];
        loop {
            match rx.read(&mut bytes).await {
                Ok(count @ 1..) => {
                    self.take(port, bytes.get(..count).unwrap_or_default());
                }
                // Line errors damage a frame, which its checksum shows.
                Ok(0) | Err(_) => Timer::after(PAUSE).await,
            }
        }
    }

    #[expect(clippy::disallowed_methods, reason = "the runner is what waits")]
    async fn write(&self, port: usize, mut tx: impl Write) {
        let mut bytes = [0; WRITE];
        loop {
            let count = self.service.borrow_mut().transmit(port, &mut bytes);
            if count == 0 {
                match self.waiting.get(port) {
                    Some(waiting) => waiting.wait().await,
                    None => return,
                }
                continue;
            }
            let bytes = bytes.get(..count).unwrap_or_default();
            // Bytes that a failing port does not accept are lost, as on an open wire.
            if tx.write_all(bytes).await.is_err() || tx.flush().await.is_err() {
                Timer::after(PAUSE).await;
            }
        }
    }
}
