//! One MAVLink port of the rig: a thread that reads, and one that writes. The simulation waits for neither.

use super::address::Address;
use std::io::{self, Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::sync::mpsc::{Receiver, Sender, SyncSender, TrySendError, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Pieces that may wait for a writer that does not move.
const WAITING: usize = 16;
/// Time between two attempts to connect.
const AGAIN: Duration = Duration::from_millis(500);

/// The writing end of the connection, while there is one.
type Outgoing = Arc<Mutex<Option<Box<dyn Write + Send>>>>;

/// A port.
#[derive(Debug)]
pub struct Link {
    incoming: Receiver<Vec<u8>>,
    outgoing: SyncSender<Vec<u8>>,
    /// What the writer had no place for.
    pending: Option<Vec<u8>>,
}

impl Link {
    /// Opens a port. What can be wrong from the start is an error; a peer that is not there yet is waited for.
    pub fn open(address: &Address) -> Result<Self, String> {
        let (to_simulation, incoming) = channel();
        let (outgoing, to_peer) = sync_channel::<Vec<u8>>(WAITING);
        let writer: Outgoing = Arc::default();
        let reader = Reader { to_simulation, writer: writer.clone() };
        let cannot = |error: io::Error| format!("--mavlink: cannot open {address:?}: {error}");
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
                std::thread::spawn(move || reader.serve_udp(socket, true));
            }
            Address::UdpOut(at) => {
                let socket = UdpSocket::bind("0.0.0.0:0").map_err(cannot)?;
                socket.connect(at).map_err(cannot)?;
                std::thread::spawn(move || reader.serve_udp(socket, false));
            }
            Address::Serial(device, baud) => {
                let (device, baud) = (device.clone(), *baud);
                serial::open(&device, baud).map_err(cannot)?;
                std::thread::spawn(move || {
                    loop {
                        if let Ok(port) = serial::open(&device, baud)
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
        Ok(Self { incoming, outgoing, pending: None })
    }

    /// Bytes that have arrived.
    pub fn receive(&mut self) -> Option<Vec<u8>> {
        self.incoming.try_recv().ok()
    }

    /// Whether there is a place for bytes.
    pub fn is_ready(&mut self) -> bool {
        if let Some(bytes) = self.pending.take() {
            self.send(bytes);
        }
        self.pending.is_none()
    }

    /// Sends bytes.
    pub fn send(&mut self, bytes: Vec<u8>) {
        if let Err(TrySendError::Full(bytes)) = self.outgoing.try_send(bytes) {
            self.pending = Some(bytes);
        }
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

    fn serve_udp(&self, socket: UdpSocket, answers: bool) {
        let mut bytes = [0; 2048];
        if !answers && let Ok(other) = socket.try_clone() {
            self.set_writer(Some(Box::new(Datagrams(other))));
        }
        let mut peer = None;
        loop {
            match socket.recv_from(&mut bytes) {
                Ok((count, from)) => {
                    if answers && peer != Some(from) && socket.connect(from).is_ok() {
                        // From here on only this peer is received, until the rig ends.
                        peer = Some(from);
                        if let Ok(other) = socket.try_clone() {
                            self.set_writer(Some(Box::new(Datagrams(other))));
                        }
                    }
                    if self.to_simulation.send(bytes[..count].to_vec()).is_err() {
                        return;
                    }
                }
                // Nobody listens there at the moment.
                Err(_) => std::thread::sleep(AGAIN),
            }
        }
    }
}

/// Each write is a datagram.
struct Datagrams(UdpSocket);

impl Write for Datagrams {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // A peer that is not there loses it, as a radio does.
        let _ = self.0.send(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(unix)]
mod serial {
    use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
    use std::fs::File;
    use std::io;

    /// Opens a serial port: raw, 8 data bits, no parity.
    pub fn open(device: &str, baud: u32) -> io::Result<File> {
        let file = File::options().read(true).write(true).open(device)?;
        let mut settings = tcgetattr(&file)?;
        settings.make_raw();
        settings.set_speed(baud)?;
        tcsetattr(&file, OptionalActions::Now, &settings)?;
        Ok(file)
    }
}

#[cfg(not(unix))]
mod serial {
    use std::fs::File;
    use std::io;

    pub fn open(_: &str, _: u32) -> io::Result<File> {
        Err(io::Error::new(
            io::ErrorKind::Unsupported,
            "serial ports need Linux or macOS here: use tcpout or udpin",
        ))
    }
}
