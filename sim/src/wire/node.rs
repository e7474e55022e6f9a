//! The node's UART: the two halves that the code under test reads and writes.

use core::cell::RefCell;
use core::future::poll_fn;
use core::task::{Context, Poll, Waker};
use std::collections::VecDeque;
use std::rc::Rc;

use embedded_io_async::{ErrorKind, ErrorType, Read, ReadReady, Write};

use super::faults::FramingAs;
use super::lane::Arrival;
use crate::clock;
use crate::ecu::Nanos;

/// An error that the node's receiver reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WireError {
    /// A byte without a stop bit.
    Framing,
    /// Bytes were lost because they were not read in time.
    Overrun,
}

impl core::fmt::Display for WireError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Framing => "framing error",
            Self::Overrun => "overrun",
        })
    }
}

impl core::error::Error for WireError {}

impl embedded_io_async::Error for WireError {
    fn kind(&self) -> ErrorKind {
        match self {
            Self::Framing => ErrorKind::InvalidData,
            Self::Overrun => ErrorKind::OutOfMemory,
        }
    }
}

/// Action of the UART's interrupt at each framing error.
pub(super) struct FramingHandler(pub(super) Box<dyn Fn()>);

impl core::fmt::Debug for FramingHandler {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("FramingHandler")
    }
}

/// State shared by the two halves and the plug.
#[derive(Debug)]
pub(super) struct Port {
    /// Bytes of the transmit ring, each with the time at which it was written.
    pub(super) tx: VecDeque<(u8, Nanos)>,
    tx_ring: usize,
    /// A byte has left the ring and is still being sent.
    pub(super) shifting: bool,
    pub(super) stalled: bool,
    rx: VecDeque<Result<u8, WireError>>,
    rx_ring: usize,
    pub(super) framing: FramingAs,
    pub(super) framing_handler: Option<FramingHandler>,
    pub(super) overruns: u64,
    reader: Option<Waker>,
    writer: Option<Waker>,
    runner: Option<Waker>,
}

impl Port {
    pub(super) fn new(tx_ring: usize, rx_ring: usize) -> Self {
        Self {
            tx: VecDeque::with_capacity(tx_ring),
            tx_ring: tx_ring.max(1),
            shifting: false,
            stalled: false,
            rx: VecDeque::with_capacity(rx_ring),
            rx_ring: rx_ring.max(1),
            framing: FramingAs::default(),
            framing_handler: None,
            overruns: 0,
            reader: None,
            writer: None,
            runner: None,
        }
    }

    pub(super) fn receive(&mut self, arrival: Arrival) {
        if let (Arrival::Framing(_), FramingAs::Data, Some(handler)) =
            (&arrival, self.framing, &self.framing_handler)
        {
            (handler.0)();
        }
        let received = match (arrival, self.framing) {
            (Arrival::Good(byte), _) | (Arrival::Framing(byte), FramingAs::Data) => Ok(byte),
            (Arrival::Framing(_), FramingAs::Error) => Err(WireError::Framing),
        };
        if self.rx.len() < self.rx_ring {
            self.rx.push_back(received);
        } else {
            self.overruns += 1;
            if self.framing == FramingAs::Error {
                // RingBufferedUartRx restarts with an empty ring; BufferedUart reports nothing.
                self.rx.clear();
                self.rx.push_back(Err(WireError::Overrun));
            }
        }
        if let Some(reader) = &self.reader {
            reader.wake_by_ref();
        }
    }

    /// Empties both rings, as a reset of the chip does.
    pub(super) fn reset(&mut self) {
        self.tx.clear();
        self.rx.clear();
        self.stalled = false;
        self.reader = None;
        self.writer = None;
    }

    pub(super) fn wake_writer(&self) {
        if let Some(writer) = &self.writer {
            writer.wake_by_ref();
        }
    }

    pub(super) fn wake_runner(&self) {
        if let Some(runner) = &self.runner {
            runner.wake_by_ref();
        }
    }

    pub(super) fn set_runner(&mut self, cx: &Context<'_>) {
        register(&mut self.runner, cx);
    }
}

fn register(slot: &mut Option<Waker>, cx: &Context<'_>) {
    match slot {
        Some(waker) => waker.clone_from(cx.waker()),
        None => *slot = Some(cx.waker().clone()),
    }
}

/// The node's receiver. A dropped read loses no bytes.
#[derive(Debug)]
pub struct WireRx {
    port: Rc<RefCell<Port>>,
}

impl WireRx {
    pub(super) fn new(port: Rc<RefCell<Port>>) -> Self {
        Self { port }
    }
}

impl ErrorType for WireRx {
    type Error = WireError;
}

impl Read for WireRx {
    async fn read(&mut self, buf: &mut [u8]) -> Result<usize, WireError> {
        if buf.is_empty() {
            return Ok(0);
        }
        poll_fn(|cx| {
            let mut port = self.port.borrow_mut();
            match port.rx.front() {
                None => {
                    register(&mut port.reader, cx);
                    return Poll::Pending;
                }
                Some(&Err(error)) => {
                    port.rx.pop_front();
                    return Poll::Ready(Err(error));
                }
                Some(Ok(_)) => {}
            }
            // The good bytes before the first error.
            let mut n = 0;
            while n < buf.len()
                && let Some(&Ok(byte)) = port.rx.front()
            {
                buf[n] = byte;
                n += 1;
                port.rx.pop_front();
            }
            port.reader = None;
            Poll::Ready(Ok(n))
        })
        .await
    }
}

impl ReadReady for WireRx {
    fn read_ready(&mut self) -> Result<bool, WireError> {
        Ok(!self.port.borrow().rx.is_empty())
    }
}

/// The node's transmitter. A dropped write has written nothing.
#[derive(Debug)]
pub struct WireTx {
    port: Rc<RefCell<Port>>,
}

impl WireTx {
    pub(super) fn new(port: Rc<RefCell<Port>>) -> Self {
        Self { port }
    }
}

impl ErrorType for WireTx {
    type Error = WireError;
}

impl Write for WireTx {
    async fn write(&mut self, buf: &[u8]) -> Result<usize, WireError> {
        if buf.is_empty() {
            return Ok(0);
        }
        poll_fn(|cx| {
            let mut port = self.port.borrow_mut();
            let space = port.tx_ring - port.tx.len();
            if space == 0 {
                register(&mut port.writer, cx);
                return Poll::Pending;
            }
            let n = space.min(buf.len());
            let now = clock::now_ns();
            port.tx.extend(buf[..n].iter().map(|&byte| (byte, now)));
            port.writer = None;
            port.wake_runner();
            Poll::Ready(Ok(n))
        })
        .await
    }

    async fn flush(&mut self) -> Result<(), WireError> {
        poll_fn(|cx| {
            let mut port = self.port.borrow_mut();
            if port.stalled || port.shifting || !port.tx.is_empty() {
                register(&mut port.writer, cx);
                return Poll::Pending;
            }
            port.writer = None;
            Poll::Ready(Ok(()))
        })
        .await
    }
}
