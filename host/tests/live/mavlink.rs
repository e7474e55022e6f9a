//! `jetlink rig --mavlink` over a reset of its node, which on a terminal is a key.

use super::frame::frame;
use super::port::free_port;
use super::terminal::Terminal;
use super::wait_until;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// The engine's component, and states in the lowest byte of its `custom_mode`.
const ENGINE: u8 = 26;
const STANDBY: u8 = 3;
const RUNNING: u8 = 7;

/// A ground station.
struct Station {
    stream: TcpStream,
    bytes: Vec<u8>,
    /// Sequence number of the engine's last frame. It rises by one, and begins at 0 when the node starts.
    sequence: Option<u8>,
    starts: u32,
}

impl Station {
    fn connect(port: u16) -> Self {
        let mut stream = None;
        wait_until("the port is open", || {
            stream = TcpStream::connect(("127.0.0.1", port)).ok();
            stream.is_some()
        });
        let stream = stream.expect("connected");
        stream.set_read_timeout(Some(Duration::from_millis(50))).expect("a timeout");
        Self { stream, bytes: Vec::new(), sequence: None, starts: 0 }
    }

    fn sends(&mut self, bytes: &[u8]) {
        self.stream.write_all(bytes).expect("it is sent");
    }

    /// Whose system id heartbeats of the engine have, and its state, of those that have just arrived, since the node's last start.
    fn heartbeats(&mut self) -> Vec<(u8, u8)> {
        let mut buffer = [0; 4096];
        match self.stream.read(&mut buffer) {
            Ok(count) => self.bytes.extend(&buffer[..count]),
            Err(error) => {
                assert!(matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut), "{error}")
            }
        }
        let mut all = Vec::new();
        while let Some(&[0xFD, length, _, _, sequence, system, component, id, ..]) =
            self.bytes.first_chunk::<12>()
        {
            let length = usize::from(length) + 12;
            if self.bytes.len() < length {
                break;
            }
            if component == ENGINE {
                if sequence == 0 && self.sequence != Some(255) {
                    self.starts += 1;
                    all.clear();
                }
                self.sequence = Some(sequence);
                if id == 0 {
                    all.push((system, self.bytes[10]));
                }
            }
            self.bytes.drain(..length);
        }
        all
    }
}

/// A rig whose node has id 1, and 9 from its next start on; with an engine that runs, or not. After a reset by key it has this id.
fn id_after_a_reset(runs: bool) -> u8 {
    let port = free_port();
    let address = format!("tcpin:127.0.0.1:{port}");
    let arguments = ["--engine", "name=left", "--mavlink", &address];
    let mut terminal = Terminal::start(&arguments);
    terminal.is_live();
    // Faster: × 10.
    terminal.types(b"+++");
    let mut station = Station::connect(port);
    wait_until("heartbeats with id 1", || station.heartbeats().iter().any(|(system, _)| *system == 1));
    let mut set = 9_f32.to_le_bytes().to_vec();
    set.extend([1, 25]);
    set.extend(b"MAV_SYSID\0\0\0\0\0\0\0");
    set.push(9);
    station.sends(&frame(23, 168, &set));
    if runs {
        // Start, also if disarmed: DO_ENGINE_CONTROL. Without a throttle stream the station's heartbeats maintain it.
        let mut start = [1_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0].map(f32::to_le_bytes).concat();
        start.extend(223_u16.to_le_bytes());
        start.extend([1, ENGINE, 0]);
        wait_until("it runs", || {
            station.sends(&frame(0, 50, &[0, 0, 0, 0, 6, 8, 0, 4, 3]));
            let heartbeats = station.heartbeats();
            if heartbeats.last().is_some_and(|(_, state)| *state == STANDBY) {
                station.sends(&frame(76, 152, &start));
            }
            heartbeats.contains(&(1, RUNNING))
        });
    }
    terminal.types(b"fx");
    let starts = station.starts;
    let mut last = None;
    wait_until("it has started again", || {
        last = station.heartbeats().last().copied().filter(|_| station.starts > starts);
        last.is_some()
    });
    last.expect("a heartbeat").0
}

#[test]
fn a_reset_in_flight_changes_no_id_and_one_at_rest_does() {
    assert_eq!(id_after_a_reset(true), 1);
    assert_eq!(id_after_a_reset(false), 9);
}
