//! Packets between a port of the service and a USB host that reads or not, closes the port, sleeps or is unplugged.

use crate::dialect::{COMMAND_LONG_DATA, PARAM_REQUEST_READ_DATA, PARAM_VALUE_DATA};
use crate::frame::{Address, Decoder, Frame, encode};
use crate::ids::{CMD_REQUEST_MESSAGE, CMD_SET_MESSAGE_INTERVAL, MESSAGE_HEARTBEAT};
use crate::packets::{Connection, NotConfigured, PACKET, ReadPacket, WritePacket};
use crate::port::PortConfig;
use crate::runner::Runner;
use crate::service::Service;
use crate::settings::NodeSettings;
use crate::signing::SigningState;
use embassy_futures::join::join3;
use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer};
use mavlink_core::MessageData;
use sim::clock;
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::vec::Vec;

const GROUND: Address = Address { system: 255, component: 190 };
const UART: usize = 0;
const USB: usize = 1;

type TestRunner = Runner<'static, 1, 2>;

/// A host with one bulk endpoint each way, and the bytes on the other port.
#[derive(Default)]
struct Host {
    connection: Connection,
    /// It takes packets.
    reads: Cell<bool>,
    /// Packet that waits in the chip until the host takes it.
    waits: RefCell<Option<Vec<u8>>>,
    /// Packets it has taken.
    packets: RefCell<Vec<Vec<u8>>>,
    /// Packets it sends.
    sends: RefCell<VecDeque<Vec<u8>>>,
    uart: RefCell<Vec<u8>>,
}

struct From<'a>(&'a Host);
struct To<'a>(&'a Host);
struct Uart<'a>(&'a Host);

async fn a_moment() {
    Timer::after(Duration::from_micros(250)).await;
}

impl ReadPacket for From<'_> {
    async fn read(&mut self, packet: &mut [u8; PACKET]) -> Result<usize, NotConfigured> {
        loop {
            if let Some(next) = self.0.sends.borrow_mut().pop_front() {
                packet[..next.len()].copy_from_slice(&next);
                return Ok(next.len());
            }
            a_moment().await;
        }
    }
}

impl WritePacket for To<'_> {
    async fn write(&mut self, packet: &[u8]) -> Result<(), NotConfigured> {
        assert!(packet.len() <= PACKET);
        while self.0.waits.borrow().is_some() {
            a_moment().await;
        }
        self.0.waits.replace(Some(packet.into()));
        Ok(())
    }
}

impl embedded_io_async::ErrorType for Uart<'_> {
    type Error = core::convert::Infallible;
}

impl embedded_io_async::Read for Uart<'_> {
    async fn read(&mut self, _: &mut [u8]) -> Result<usize, Self::Error> {
        core::future::pending().await
    }
}

impl embedded_io_async::Write for Uart<'_> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Error> {
        Timer::after(Duration::from_micros(174 * bytes.len() as u64)).await; // 57 600 baud
        self.0.uart.borrow_mut().extend(bytes);
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}

impl Host {
    /// Takes a packet every 0.25 ms, while it reads.
    async fn run(&self) {
        loop {
            a_moment().await;
            if self.reads.get()
                && let Some(packet) = self.waits.take()
            {
                self.packets.borrow_mut().push(packet);
            }
        }
    }

    /// A program opens the port.
    fn open(&self) {
        self.reads.set(true);
        self.connection.set_terminal(true);
    }

    fn close(&self) {
        self.reads.set(false);
        self.connection.set_terminal(false);
    }

    fn send(&self, bytes: &[u8]) {
        self.sends.borrow_mut().extend(bytes.chunks(PACKET).map(<[u8]>::to_vec));
    }

    /// Requests a parameter of the node.
    fn request(&self, index: i16) {
        let message = PARAM_REQUEST_READ_DATA {
            param_index: index,
            target_system: 1,
            target_component: 25,
            ..Default::default()
        };
        self.send(&encode(GROUND, 0, &message));
    }

    fn command(&self, command: u16, message: u32, interval: f32) {
        let message = COMMAND_LONG_DATA {
            param1: message as f32,
            param2: interval,
            command,
            target_system: 1,
            target_component: 25,
            ..Default::default()
        };
        self.send(&encode(GROUND, 0, &message));
    }

    fn bytes(&self) -> usize {
        self.packets.borrow().iter().map(Vec::len).sum()
    }

    /// Whole frames in the taken packets from this one on, and the number of bytes that belong to none.
    fn frames(&self, from: usize) -> (Vec<Frame>, u32) {
        frames(&self.packets.borrow()[from..].concat())
    }

    /// Whether the host passes on everything: the last packet taken is a short one.
    fn is_passed_on(&self) -> bool {
        self.packets.borrow().last().is_none_or(|packet| packet.len() < PACKET)
    }
}

fn frames(mut bytes: &[u8]) -> (Vec<Frame>, u32) {
    let mut decoder = Decoder::new();
    let mut all = Vec::new();
    while let (taken, Some(frame)) = decoder.receive(None, bytes) {
        bytes = &bytes[taken..];
        all.push(frame);
    }
    let counters = decoder.counters();
    (all, counters.skipped + counters.bad_checksums)
}

fn parameters(frames: &[Frame]) -> usize {
    frames.iter().filter(|frame| frame.id == PARAM_VALUE_DATA::ID).count()
}

fn pass_ms(ms: u64) -> Timer {
    Timer::after(Duration::from_millis(ms))
}

/// Runs a scenario with a node without engines, a UART and USB, whose host has configured it.
fn run(scenario: impl AsyncFnOnce(&Host, &TestRunner)) {
    clock::reset();
    let ports = [PortConfig::uart(57_600), PortConfig::usb()];
    let mut settings = NodeSettings::DEFAULT;
    settings.identity.autopilot_port = 0;
    let service = Service::new(Instant::now(), settings, SigningState::NONE, [], ports);
    let (runner, host) = (Runner::new(service), Host::default());
    host.connection.set_configured(true);
    let serve = join3(
        runner.keep_time(|_, _| ()),
        runner.serve(UART, Uart(&host), Uart(&host)),
        runner.serve_packets(USB, &host.connection, From(&host), To(&host)),
    );
    clock::run(select(select(serve, host.run()), async {
        pass_ms(10).await;
        scenario(&host, &runner).await;
    }));
}

#[test]
fn nothing_is_sent_until_a_program_opens_the_port() {
    run(async |host, _| {
        host.reads.set(true);
        pass_ms(5000).await;
        assert_eq!(host.bytes(), 0);
        host.open();
        pass_ms(1100).await;
        let (frames, bad) = host.frames(0);
        assert!(!frames.is_empty() && bad == 0 && host.is_passed_on(), "{frames:?}");
        assert!(frames.iter().all(|frame| frame.id == MESSAGE_HEARTBEAT));
        assert!(frames.len() <= 2, "none of those from before: {}", frames.len());
    });
}

#[test]
fn program_that_sets_no_dtr_is_answered() {
    run(async |host, _| {
        host.reads.set(true);
        host.request(0);
        pass_ms(50).await;
        assert_eq!(parameters(&host.frames(0).0), 1);
    });
}

#[test]
fn full_packet_is_followed_by_another_one_even_an_empty_one() {
    run(async |host, _| {
        host.open();
        let mut empty = 0;
        // Answers of two lengths in all combinations, waiting together.
        for (count, others) in (0..9).flat_map(|count| (0..9).map(move |others| (count, others))) {
            pass_ms(20).await;
            host.packets.borrow_mut().clear();
            host.reads.set(false);
            (0..count).for_each(|index| host.request(index));
            (0..others).for_each(|_| host.command(CMD_REQUEST_MESSAGE, MESSAGE_HEARTBEAT, 0.0));
            pass_ms(20).await;
            host.reads.set(true);
            pass_ms(20).await;
            let (frames, bad) = host.frames(0);
            assert_eq!((parameters(&frames), bad), (count as usize, 0));
            assert!(host.is_passed_on(), "the host waits for more");
            empty += host.packets.borrow().iter().filter(|packet| packet.is_empty()).count();
            for pair in host.packets.borrow().windows(2) {
                assert!(!pair[1].is_empty() || pair[0].len() == PACKET, "an empty one for nothing");
            }
        }
        assert!(empty > 0, "the case did occur");
    });
}

#[test]
fn host_that_does_not_read_holds_up_nothing_and_is_answered_when_it_reads_again() {
    run(async |host, runner| {
        host.open();
        pass_ms(2000).await;
        host.reads.set(false);
        let (before, uart) = (host.packets.borrow().len(), host.uart.borrow().len());
        for _ in 0..60 {
            host.request(1);
            pass_ms(500).await;
        }
        assert_eq!(host.packets.borrow().len(), before);
        // 30 s of heartbeats on the other port, whole.
        let (frames, bad) = frames(&host.uart.borrow()[uart..]);
        assert!(bad == 0 && (29..=31).contains(&frames.len()), "{} frames", frames.len());
        let counters = runner.port_counters(USB).unwrap();
        assert!(counters.answers_dropped > 20 && counters.received.frames == 60, "{counters:?}");
        host.reads.set(true);
        pass_ms(50).await;
        host.request(2);
        pass_ms(50).await;
        let (frames, bad) = host.frames(before);
        assert_eq!(bad, 0, "whole frames only");
        assert_eq!(frames.last().unwrap().id, PARAM_VALUE_DATA::ID);
    });
}

#[test]
fn new_opening_begins_clean() {
    let ends: [fn(&Host); 4] = [
        Host::close,
        // The host sleeps.
        |host| host.connection.set_suspended(true),
        // The cable is pulled: the bus is idle, then another host resets it.
        |host| {
            host.connection.set_suspended(true);
            host.connection.reset();
            host.connection.set_configured(true);
        },
        |host| host.connection.set_configured(false),
    ];
    for end in ends {
        run(async |host, runner| {
            host.open();
            host.command(CMD_SET_MESSAGE_INTERVAL, 999, 1e6);
            pass_ms(50).await;
            // Half of a frame comes; answers wait, as the host does not read.
            host.reads.set(false);
            for index in 0..20 {
                host.request(index);
            }
            let whole = encode(GROUND, 0, &PARAM_REQUEST_READ_DATA::default());
            host.send(&whole[..whole.len() / 2]);
            pass_ms(50).await;
            let taken = host.packets.borrow().len();
            end(host);
            pass_ms(50).await;
            // What is in the chip already goes out: one packet, as no driver takes it back.
            let in_chip = host.waits.borrow().clone().map_or(0, |packet| packet.len());
            assert!((1..=PACKET).contains(&in_chip));
            host.reads.set(true);
            pass_ms(3000).await;
            assert_eq!(host.packets.borrow().len(), taken + 1, "nothing while it is closed");
            host.connection.set_suspended(false);
            host.connection.set_configured(true);
            host.open();
            host.request(3);
            pass_ms(40).await;
            let (frames, bad) = host.frames(taken + 1);
            assert_eq!((parameters(&frames), bad), (1, 0), "{frames:?}");
            let received = runner.port_counters(USB).unwrap().received;
            assert_eq!((received.bad_checksums, received.skipped), (0, 0), "{received:?}");
        });
    }
}

#[test]
fn list_of_an_earlier_opening_is_not_continued() {
    run(async |host, _| {
        host.open();
        let list = crate::dialect::PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 25 };
        host.send(&encode(GROUND, 0, &list));
        pass_ms(200).await;
        assert!(parameters(&host.frames(0).0) > 1);
        host.close();
        host.open();
        let taken = host.packets.borrow().len();
        pass_ms(1500).await;
        // One may be in the chip.
        assert!(parameters(&host.frames(taken).0) <= 1);
    });
}

#[test]
fn host_that_sends_without_a_pause_leaves_the_others_their_turn() {
    run(async |host, _| {
        host.open();
        pass_ms(500).await;
        let (at, uart) = (Instant::now(), host.uart.borrow().len());
        let garbage = [0x55; PACKET];
        for _ in 0..20_000 {
            host.send(&garbage);
        }
        host.command(CMD_REQUEST_MESSAGE, MESSAGE_HEARTBEAT, 0.0);
        // Everything arrives at once, as it takes no virtual time, yet others run in between.
        while !host.sends.borrow().is_empty() {
            pass_ms(1).await;
            assert!(Instant::now() < at + Duration::from_secs(5), "the flood ends");
        }
        pass_ms(1100).await;
        assert!(host.uart.borrow().len() > uart, "the other port is served");
    });
}
