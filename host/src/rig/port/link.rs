//! One port of the rig: a thread that reads, and one that writes. The simulation waits for neither.

use super::address::Address;
use embassy_time::{Instant, Timer};
use embedded_io_async::ErrorType;
use jetlink_mavlink::frame::Decoder;
use std::convert::Infallible;
use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Pieces that may wait for a blocked writer.
const WAITING: usize = 16;
/// Time between two polls of a port, in the simulation's time.
const TICK: embassy_time::Duration = embassy_time::Duration::from_millis(10);
/// Time between two attempts to connect.
const AGAIN: Duration = Duration::from_millis(500);

/// The writing end of the connection, while there is one.
type Outgoing = Arc<Mutex<Option<Box<dyn Write + Send>>>>;

/// Format of a byte on a serial port.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Format {
    /// 8 data bits, no parity, one stop bit.
    N1,
    /// 8 data bits, even parity, two stop bits.
    E2,
}

/// Why a port was not opened.
#[derive(Debug)]
pub struct OpenError(Address, io::Error);

impl core::fmt::Display for OpenError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "cannot open {}: {}", self.0, self.1)
    }
}

impl core::error::Error for OpenError {}

/// A port.
#[derive(Debug)]
pub struct Link {
    incoming: Receiver<Vec<u8>>,
    outgoing: SyncSender<Vec<u8>>,
}

impl Link {
    /// Opens a port. Problems that show at once are errors; it waits for a peer that is not present yet.
    pub fn open(address: &Address, format: Format) -> Result<Self, OpenError> {
        let (to_simulation, incoming) = channel();
        let (outgoing, to_peer) = sync_channel::<Vec<u8>>(WAITING);
        let writer: Outgoing = Arc::default();
        let reader = Reader { to_simulation, writer: writer.clone() };
        let cannot = |error: io::Error| OpenError(address.clone(), error);
        match address {
            Address::TcpIn(at) => {
                let listener = TcpListener::bind(at).map_err(cannot)?;
                std::thread::spawn(move || {
                    while let Ok((stream, _)) = listener.accept() {
                        reader.serve_tcp(stream);
                    }
                });
            }
            Address::TcpOut(at) => {
                let at = at.clone();
                std::thread::spawn(move || {
                    loop {
                        if let Ok(stream) = TcpStream::connect(&at) {
                            reader.serve_tcp(stream);
                        }
                        std::thread::sleep(AGAIN);
                    }
                });
            }
            Address::UdpIn(at) => {
                let socket = UdpSocket::bind(at).map_err(cannot)?;
                std::thread::spawn(move || reader.answer_udp(socket));
            }
            Address::UdpOut(at) => {
                let socket = UdpSocket::bind("0.0.0.0:0").map_err(cannot)?;
                socket.connect(at).map_err(cannot)?;
                std::thread::spawn(move || reader.serve_udp(socket));
            }
            Address::Serial(device, baud) => {
                let (device, baud) = (device.clone(), *baud);
                serial::open(&device, baud, format).map_err(cannot)?;
                std::thread::spawn(move || {
                    loop {
                        if let Ok(port) = serial::open(&device, baud, format)
                            && let Ok(other) = port.try_clone()
                        {
                            reader.serve(port, other);
                        }
                        std::thread::sleep(AGAIN);
                    }
                });
            }
        }
        std::thread::spawn(move || {
            while let Ok(bytes) = to_peer.recv() {
                let mut writer = writer.lock().unwrap_or_else(PoisonError::into_inner);
                // Without a peer the bytes go nowhere, as on an open wire.
                if let Some(peer) = &mut *writer
                    && peer.write_all(&bytes).and_then(|()| peer.flush()).is_err()
                {
                    *writer = None;
                }
            }
        });
        Ok(Self { incoming, outgoing })
    }

    /// Its receiving half for a node that has just started.
    pub const fn rx(&self) -> Rx<'_> {
        Rx { incoming: &self.incoming, bytes: Vec::new() }
    }

    /// Its two halves for a node that has just started. It sends as fast as a port of this rate, in bytes per second.
    pub fn halves(&self, bytes_per_second: u32) -> (Rx<'_>, Tx<'_>) {
        let tx =
            Tx { outgoing: &self.outgoing, bytes_per_second: bytes_per_second.into(), sent: Instant::MIN };
        (self.rx(), tx)
    }
}

/// Reads from a port, in the simulation's time.
#[derive(Debug)]
pub struct Rx<'a> {
    incoming: &'a Receiver<Vec<u8>>,
    /// Bytes that have arrived and not been read.
    bytes: Vec<u8>,
}

impl ErrorType for Rx<'_> {
    type Error = Infallible;
}

impl embedded_io_async::Read for Rx<'_> {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        while self.bytes.is_empty() {
            match self.incoming.try_recv() {
                Ok(bytes) => self.bytes = bytes,
                Err(_) => Timer::after(TICK).await,
            }
        }
        let count = self.bytes.len().min(buffer.len());
        self.bytes.drain(..count).zip(buffer).for_each(|(byte, slot)| *slot = byte);
        Ok(count)
    }
}

/// Writes to a port, in the simulation's time.
#[derive(Debug)]
pub struct Tx<'a> {
    outgoing: &'a SyncSender<Vec<u8>>,
    bytes_per_second: u64,
    /// When the port has sent everything.
    sent: Instant,
}

impl ErrorType for Tx<'_> {
    type Error = Infallible;
}

impl embedded_io_async::Write for Tx<'_> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let mut piece = bytes.to_vec();
        while let Err(TrySendError::Full(again)) = self.outgoing.try_send(piece) {
            piece = again;
            Timer::after(TICK).await;
        }
        let time =
            embassy_time::Duration::from_micros(bytes.len() as u64 * 1_000_000 / self.bytes_per_second);
        self.sent = self.sent.max(Instant::now()) + time;
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        // At most one poll ahead.
        Timer::at(self.sent.checked_sub(TICK).unwrap_or(Instant::MIN)).await;
        Ok(())
    }
}

struct Reader {
    to_simulation: Sender<Vec<u8>>,
    writer: Outgoing,
}

impl Reader {
    fn set_writer(&self, writer: Option<Box<dyn Write + Send>>) {
        *self.writer.lock().unwrap_or_else(PoisonError::into_inner) = writer;
    }

    fn serve_tcp(&self, stream: TcpStream) {
        let _ = stream.set_nodelay(true);
        if let Ok(other) = stream.try_clone() {
            self.serve(stream, other);
        }
    }

    /// Reads until the peer is gone.
    fn serve(&self, mut from: impl Read, to: impl Write + Send + 'static) {
        self.set_writer(Some(Box::new(to)));
        let mut bytes = [0; 2048];
        while let Ok(count @ 1..) = from.read(&mut bytes) {
            if self.to_simulation.send(bytes[..count].to_vec()).is_err() {
                break;
            }
        }
        self.set_writer(None);
    }

    /// To one peer.
    fn serve_udp(&self, socket: UdpSocket) {
        let mut bytes = [0; 2048];
        if let Ok(other) = socket.try_clone() {
            self.set_writer(Some(Box::new(Datagrams(other, None))));
        }
        loop {
            match socket.recv(&mut bytes) {
                Ok(count) if self.to_simulation.send(bytes[..count].to_vec()).is_err() => return,
                Ok(_) => {}
                // Nobody listens there at the moment.
                Err(_) => std::thread::sleep(AGAIN),
            }
        }
    }

    /// With the last peer that sent a frame of MAVLink, or else with the first one.
    fn answer_udp(&self, socket: UdpSocket) {
        let mut bytes = [0; 2048];
        let mut peer = None;
        loop {
            let Ok((count, from)) = socket.recv_from(&mut bytes) else {
                std::thread::sleep(AGAIN);
                continue;
            };
            let datagram = &bytes[..count];
            if peer != Some(from) {
                if peer.is_some() && !has_frame(datagram) {
                    continue;
                }
                peer = Some(from);
                if let Ok(other) = socket.try_clone() {
                    self.set_writer(Some(Box::new(Datagrams(other, peer))));
                }
            }
            if self.to_simulation.send(datagram.to_vec()).is_err() {
                return;
            }
        }
    }
}

fn has_frame(mut bytes: &[u8]) -> bool {
    let mut decoder = Decoder::new();
    while !bytes.is_empty() {
        let (taken, frame) = decoder.receive(None, bytes);
        if frame.is_some() {
            return true;
        }
        if taken == 0 {
            return false;
        }
        bytes = &bytes[taken..];
    }
    false
}

/// Each write is a datagram: to this peer, or to the one that the socket is connected to.
struct Datagrams(UdpSocket, Option<SocketAddr>);

impl Write for Datagrams {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // An absent peer loses it, as with a radio.
        let _ = match self.1 {
            Some(peer) => self.0.send_to(bytes, peer),
            None => self.0.send(bytes),
        };
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(unix)]
mod serial {
    use super::Format;
    use rustix::termios::{ControlModes, InputModes, OptionalActions, tcgetattr, tcsetattr};
    use std::fs::File;
    use std::io;

    /// Opens a serial port: raw, 8 data bits. A byte with wrong parity arrives as 0.
    pub fn open(device: &str, baud: u32, format: Format) -> io::Result<File> {
        let file = File::options().read(true).write(true).open(device)?;
        let mut settings = tcgetattr(&file)?;
        settings.make_raw();
        let even = format == Format::E2;
        settings.control_modes.set(ControlModes::PARENB | ControlModes::CSTOPB, even);
        settings.control_modes.remove(ControlModes::PARODD);
        settings.input_modes.set(InputModes::INPCK, even);
        settings.set_speed(baud)?;
        tcsetattr(&file, OptionalActions::Now, &settings)?;
        Ok(file)
    }
}

#[cfg(not(unix))]
mod serial {
    use super::Format;
    use std::fs::File;
    use std::io;

    pub fn open(_: &str, _: u32, _: Format) -> io::Result<File> {
        Err(io::Error::new(
            io::ErrorKind::Unsupported,
            "serial ports need Linux or macOS here: use tcpout or udpin",
        ))
    }
}
