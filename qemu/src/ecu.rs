//! Simulated ECUs on QEMU's sockets.
//!
//! QEMU's UARTs have no baud rate: bytes move as fast as the socket takes them. So this file simulates the line. Each byte to
//! the firmware is sent at the end of its stop bit. Bytes from it are spaced as on the line, and the ECU receives each at the
//! end of its stop bit.

use bench::rows::simulated;
use jetlink::config::EngineConfig;
use sim::any::AnyEcu;
use sim::ecu::{Ecu, LineFault, MILLIS, Nanos};
use sim::line::Line;
use sim::turbine::{Parameters, Phase};
use std::collections::VecDeque;
use std::io::{Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Reply window of AMT ECUs with quick turbines, 90 ms instead of 30 ms. QEMU's time is the host's, and a busy host stops it
/// for longer than the margin of 9 ms.
pub const WIDE_WINDOW: Nanos = 90 * MILLIS;

/// Speed of the turbines.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Turbine {
    /// A start takes 30 s, cooling 60 s.
    Real,
    /// A start and cooling take seconds, and AMT ECUs wait longer for their replies, for a test.
    Quick,
}

/// A simulated ECU on a UART, and its observations.
pub struct Attached {
    /// Row in the table of engines.
    pub engine: EngineConfig,
    /// Simulated ECU.
    pub ecu: AnyEcu,
    line: Line,
    caption: String,
    /// Phases of the turbine, in order.
    pub phases: Vec<Phase>,
    /// Broken frames and bytes outside of frames since the first good one. After power-up an ECU may begin to receive in the
    /// middle of a frame.
    pub odd: u64,
}

impl Attached {
    /// The ECU of a row in the table of engines. ZK ECUs alternate between protocol versions 5 and 4.
    pub fn new(row: usize, engine: &EngineConfig, turbine: Turbine) -> Self {
        let line = sim::line_of!(engine.line);
        let mut config = simulated(engine).with_version(if row.is_multiple_of(2) { 5 } else { 4 });
        if turbine == Turbine::Quick {
            *config.turbine_mut() = quick(*config.turbine());
            config = config.with_reply_window(WIDE_WINDOW);
        }
        let caption = format!("{}, {config}, {} baud", engine.name, line.baud);
        let ecu = config.ecu();
        Self { engine: *engine, ecu, line, caption, phases: Vec::new(), odd: 0 }
    }

    /// Number of its UART.
    pub fn port(&self) -> usize {
        self.engine.port.into()
    }

    /// Its name, kind and baud rate.
    pub fn caption(&self) -> &str {
        &self.caption
    }

    /// Serves a socket until QEMU closes it.
    pub fn serve(self, socket: TcpStream, began: Instant) -> Result<Served, String> {
        let problem = |why: std::io::Error| format!("the socket of an ECU: {why}");
        let reader = socket.try_clone().map_err(problem)?;
        let closer = socket.try_clone().map_err(problem)?;
        let (sender, receiver) = channel();
        std::thread::spawn(move || listen(reader, &sender));
        let thread = std::thread::spawn(move || serve(Wire::new(self), socket, began, &receiver));
        Ok(Served { thread, closer })
    }

    fn receive(&mut self, now: Nanos, byte: u8) {
        let (_, before) = self.ecu.received();
        self.ecu.receive(now, Ok::<u8, LineFault>(byte));
        let (good, after) = self.ecu.received();
        if good > 0 && after > before {
            self.odd += after - before;
            println!(
                "{:>11.6} ECU   {}: received {byte:#04x} outside of a command",
                now as f64 / 1e9,
                self.engine.name
            );
        }
        self.note_phase(now);
    }

    fn note_phase(&mut self, now: Nanos) {
        let phase = self.ecu.phase();
        if self.phases.last() != Some(&phase) {
            self.phases.push(phase);
            println!("{:>11.6} ECU   {}: turbine {}", now as f64 / 1e9, self.engine.name, phase.name());
        }
    }
}

/// The same turbine with a quick start and cooling.
fn quick(turbine: Parameters) -> Parameters {
    Parameters { acceleration_s: 2.0, coast_s: 1.0, cooling_s: 2.0, ..turbine.starting_in(6.0) }
}

/// An ECU served by a thread.
pub struct Served {
    thread: JoinHandle<Attached>,
    closer: TcpStream,
}

impl Served {
    /// Ends the thread and returns the ECU.
    ///
    /// # Panics
    /// If the thread panicked.
    pub fn finish(self) -> Attached {
        let _ = self.closer.shutdown(Shutdown::Both); // QEMU may have closed it already
        self.thread.join().expect("an ECU panicked")
    }
}

/// Stamps each received byte.
fn listen(mut socket: TcpStream, sender: &Sender<(Instant, u8)>) {
    let mut buffer = [0; 64];
    while let Ok(count @ 1..) = socket.read(&mut buffer) {
        let now = Instant::now();
        for byte in &buffer[..count] {
            if sender.send((now, *byte)).is_err() {
                return;
            }
        }
    }
}

/// Serves a socket in the host's time.
fn serve(mut wire: Wire, mut socket: TcpStream, began: Instant, bytes: &Receiver<(Instant, u8)>) -> Attached {
    let nanos = |at: Instant| at.duration_since(began).as_nanos().try_into().unwrap_or(Nanos::MAX);
    loop {
        let now = nanos(Instant::now());
        wire.advance(now);
        while let Some(byte) = wire.ended(now) {
            if socket.write_all(&[byte]).is_err() {
                return wire.attached;
            }
        }
        let wait = wire.next().saturating_sub(nanos(Instant::now()));
        match bytes.recv_timeout(Duration::from_nanos(wait)) {
            Ok((at, byte)) => wire.arrived(nanos(at), byte),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return wire.attached,
        }
        while let Ok((at, byte)) = bytes.try_recv() {
            wire.arrived(nanos(at), byte);
        }
    }
}

/// The two directions between the firmware and an ECU.
struct Wire {
    attached: Attached,
    /// Bytes, each with the end of its stop bit.
    to_firmware: VecDeque<(Nanos, u8)>,
    from_firmware: VecDeque<(Nanos, u8)>,
    /// Time at which the line from the firmware is free again.
    free: Nanos,
    /// Last time given to the ECU.
    ecu_time: Nanos,
}

impl Wire {
    /// An idle line.
    fn new(attached: Attached) -> Self {
        let (to_firmware, from_firmware) = (VecDeque::new(), VecDeque::new());
        Self { attached, to_firmware, from_firmware, free: 0, ecu_time: 0 }
    }

    /// Time of the next event.
    fn next(&mut self) -> Nanos {
        let queues = [self.to_firmware.front(), self.from_firmware.front()];
        let first = queues.into_iter().flatten().map(|(at, _)| *at).min().unwrap_or(Nanos::MAX);
        first.min(self.attached.ecu.next_wake())
    }

    /// A byte left the firmware: it starts on the line as soon as the line is free.
    fn arrived(&mut self, at: Nanos, byte: u8) {
        self.free = self.free.max(at) + self.attached.line.byte_ns(1);
        self.from_firmware.push_back((self.free, byte));
    }

    /// Gives the ECU the completed bytes and the time, and queues its frames.
    fn advance(&mut self, now: Nanos) {
        while let Some((end, byte)) = self.from_firmware.pop_front_if(|(end, _)| *end <= now) {
            self.ecu_time = self.ecu_time.max(end);
            self.attached.receive(self.ecu_time, byte);
        }
        if self.attached.ecu.next_wake() > now {
            return;
        }
        self.ecu_time = self.ecu_time.max(now);
        let mut frame = Vec::new();
        self.attached.ecu.advance(self.ecu_time, &mut frame);
        self.attached.note_phase(self.ecu_time);
        for (count, byte) in (1..).zip(&frame) {
            self.to_firmware.push_back((self.ecu_time + self.attached.line.byte_ns(count), *byte));
        }
    }

    /// Takes the next byte whose stop bit has ended at the firmware.
    fn ended(&mut self, now: Nanos) -> Option<u8> {
        self.to_firmware.pop_front_if(|(end, _)| *end <= now).map(|(_, byte)| byte)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use jetlink_fw::config::ENGINES;

    /// The wire of an AMT ECU at 2400 baud, which sends 500 ms after power-up.
    fn wire() -> Wire {
        Wire::new(Attached::new(0, &ENGINES[0], Turbine::Real))
    }

    #[test]
    fn bytes_to_the_firmware_take_their_time() {
        let mut wire = wire();
        wire.advance(0);
        wire.advance(500 * MILLIS);
        let byte = wire.attached.line.byte_ns(1);
        assert_eq!(wire.ended(500 * MILLIS + byte - 1), None);
        assert_eq!(wire.ended(500 * MILLIS + byte), Some(0xFF));
        assert_eq!(wire.ended(500 * MILLIS + byte), None);
    }

    #[test]
    fn bytes_from_the_firmware_are_spaced_as_on_the_line() {
        let mut wire = wire();
        wire.advance(0);
        for byte in [0xFF, 0x12, 0x12, 0x00, 0x00] {
            wire.arrived(100 * MILLIS, byte);
        }
        let ends: Vec<Nanos> = wire.from_firmware.iter().map(|(end, _)| *end).collect();
        let byte = wire.attached.line.byte_ns(1);
        assert_eq!(ends, [1, 2, 3, 4, 5].map(|count| 100 * MILLIS + count * byte));
        // A pause leaves the line idle.
        wire.arrived(300 * MILLIS, 0xFF);
        assert_eq!(wire.from_firmware.back(), Some(&(300 * MILLIS + byte, 0xFF)));
    }
}
