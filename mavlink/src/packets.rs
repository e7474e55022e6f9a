//! A port that carries packets, like the serial port of USB (CDC-ACM): when a program on the host has it open, and how packets
//! come and go.
//!
//! Anything that waits when the port is closed is dropped, and the next opening begins clean: nothing from an earlier one is sent,
//! finished or obeyed ([`Runner::serve_packets`](crate::runner::Runner::serve_packets)).

use core::cell::Cell;
use core::fmt;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;

/// Largest packet of a bulk endpoint at full speed. A shorter one ends a transfer to the host, so a full one has to be followed by
/// another, empty if need be.
pub const PACKET: usize = 64;

/// The host has not configured the port, or no longer does.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct NotConfigured;

impl core::fmt::Display for NotConfigured {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("the host has not configured the port")
    }
}

impl core::error::Error for NotConfigured {}

/// Packets from the host.
pub trait ReadPacket {
    /// Waits for a packet, and returns its length. If the future is dropped before it is ready, it has taken none.
    fn read(&mut self, packet: &mut [u8; PACKET]) -> impl Future<Output = Result<usize, NotConfigured>>;
}

/// Packets to the host.
pub trait WritePacket {
    /// Waits until the previous packet is sent, and hands over this one. If the future is dropped before it is ready, it has sent
    /// nothing of it.
    fn write(&mut self, packet: &[u8]) -> impl Future<Output = Result<(), NotConfigured>>;
}

/// What the host does with the port.
#[derive(Clone, Copy, Debug, Default)]
struct State {
    configured: bool,
    suspended: bool,
    /// A program has the port open and signals it (DTR).
    terminal: bool,
    /// A packet has arrived. Not every program sets DTR.
    received: bool,
    is_open: bool,
    openings: u32,
}

/// Whether a program on the host has the port open. It does no IO: the caller reports what the host does.
#[derive(Default)]
pub struct Connection {
    state: Cell<State>,
    changed: Signal<NoopRawMutex, ()>,
}

impl fmt::Debug for Connection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Connection").field("state", &self.state.get()).finish_non_exhaustive()
    }
}

impl Connection {
    /// A connection without a host.
    pub const fn new() -> Self {
        let state = State {
            configured: false,
            suspended: false,
            terminal: false,
            received: false,
            is_open: false,
            openings: 0,
        };
        Self { state: Cell::new(state), changed: Signal::new() }
    }

    /// The bus was reset or has lost its power: the host starts over.
    pub fn reset(&self) {
        self.set_configured(false);
        self.set_suspended(false);
    }

    /// The host has configured the device, or no longer does. Either way no program has the port open.
    pub fn set_configured(&self, configured: bool) {
        self.change(|state| State { configured, terminal: false, received: false, ..state });
    }

    /// The bus has become idle (the host sleeps or the cable was pulled), or is no longer.
    pub fn set_suspended(&self, suspended: bool) {
        self.change(|state| State { suspended, received: false, ..state });
    }

    /// A program on the host opens the port, or closes it (DTR).
    pub fn set_terminal(&self, terminal: bool) {
        let opens = terminal && !self.state.get().terminal;
        // It may be another program that does not set DTR.
        if opens {
            self.change(|state| State { received: false, ..state });
        }
        self.change(|state| State { terminal, received: state.received && terminal, ..state });
    }

    /// A packet has arrived: a program has the port open, with or without DTR.
    pub fn packet_came(&self) {
        self.change(|state| State { received: true, ..state });
    }

    fn change(&self, change: impl FnOnce(State) -> State) {
        let before = self.state.get();
        let mut state = change(before);
        state.is_open = state.configured && !state.suspended && (state.terminal || state.received);
        if state.is_open && !before.is_open {
            state.openings = state.openings.wrapping_add(1);
        }
        self.state.set(state);
        if state.is_open != before.is_open {
            self.changed.signal(());
        }
    }

    /// Number of the opening; `None`: no program has the port open. No two consecutive ones are equal.
    pub fn opening(&self) -> Option<u32> {
        let state = self.state.get();
        state.is_open.then_some(state.openings)
    }

    /// Waits until the opening differs from this one. For one waiter.
    pub async fn wait_for_another(&self, than: Option<u32>) -> Option<u32> {
        loop {
            let opening = self.opening();
            if opening != than {
                return opening;
            }
            self.changed.wait().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn configured() -> Connection {
        let connection = Connection::new();
        connection.reset();
        connection.set_configured(true);
        connection
    }

    #[test]
    fn port_is_open_while_a_terminal_is_ready_on_a_configured_bus_that_is_awake() {
        let connection = Connection::new();
        connection.set_terminal(true);
        connection.packet_came();
        assert_eq!(connection.opening(), None, "not configured");
        let connection = configured();
        assert_eq!(connection.opening(), None, "nobody has opened it");
        connection.set_terminal(true);
        assert_eq!(connection.opening(), Some(1));
        connection.set_terminal(true); // RTS has changed
        assert_eq!(connection.opening(), Some(1));
        connection.set_terminal(false);
        assert_eq!(connection.opening(), None);
        connection.set_terminal(true);
        assert_eq!(connection.opening(), Some(2));
    }

    #[test]
    fn suspend_reset_and_another_configuration_end_an_opening() {
        let connection = configured();
        connection.set_terminal(true);
        // The program is still there when the host wakes up.
        connection.set_suspended(true);
        assert_eq!(connection.opening(), None);
        connection.set_suspended(false);
        assert_eq!(connection.opening(), Some(2));
        connection.set_configured(true);
        assert_eq!(connection.opening(), None);
        connection.set_terminal(true);
        assert_eq!(connection.opening(), Some(3));
        connection.set_configured(false);
        assert_eq!(connection.opening(), None);
        connection.set_configured(true);
        connection.set_terminal(true);
        assert_eq!(connection.opening(), Some(4));
        // Pulled, and plugged into another computer.
        connection.set_suspended(true);
        connection.reset();
        connection.set_configured(true);
        assert_eq!(connection.opening(), None);
        connection.set_terminal(true);
        assert_eq!(connection.opening(), Some(5));
    }

    #[test]
    fn packet_of_a_program_that_sets_no_dtr_opens_the_port() {
        let connection = configured();
        connection.packet_came();
        connection.packet_came();
        assert_eq!(connection.opening(), Some(1));
        connection.set_suspended(true);
        connection.set_suspended(false);
        assert_eq!(connection.opening(), None, "until it sends again");
        connection.packet_came();
        assert_eq!(connection.opening(), Some(2));
        // Another program opens the port with DTR, and closes it.
        connection.set_terminal(true);
        assert_eq!(connection.opening(), Some(3));
        connection.packet_came();
        connection.set_terminal(false);
        assert_eq!(connection.opening(), None);
        connection.packet_came();
        assert_eq!(connection.opening(), Some(4));
    }
}
