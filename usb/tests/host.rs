//! The device under a simulated host: found and opened as a serial port, sent requests for what it does not have, left in the middle of a request,
//! suspended. The controller is simulated as Embassy's drivers of the chips behave, their panics and endless waits included.
#![allow(clippy::disallowed_methods, reason = "a scenario keeps its own time")]

use embassy_futures::join::join;
use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer};
use embassy_usb::driver::{
    Bus, ControlPipe, Driver, Endpoint, EndpointAddress, EndpointAllocError, EndpointError, EndpointIn,
    EndpointInfo, EndpointOut, EndpointType, Event, Unsupported,
};
use jetlink_mavlink::frame::{Decoder, Frame};
use jetlink_mavlink::port::PortConfig;
use jetlink_mavlink::runner::Runner;
use jetlink_mavlink::service::Service;
use jetlink_mavlink::settings::NodeSettings;
use jetlink_mavlink::signing::SigningState;
use jetlink_usb::careful::Careful;
use jetlink_usb::device::{LONGEST, Names, serve};
use sim::clock;
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;

/// Endpoints of the chip, as an STM32F427 has them.
const ENDPOINTS: usize = 4;
const SERIAL_NUMBER: &str = "0123456789ABCDEF01234567";
const HEARTBEAT: u32 = 0;

/// How a control transfer ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Outcome {
    Accepted,
    Rejected,
}

/// What the device's controller and the host share.
#[derive(Default)]
struct Cable {
    events: RefCell<VecDeque<Event>>,
    setup: Cell<Option<[u8; 8]>>,
    from_host: RefCell<VecDeque<Vec<u8>>>,
    to_host: RefCell<Vec<u8>>,
    outcome: Cell<Option<Outcome>>,
    /// The chip reports this again and again.
    sticks: Cell<Option<Event>>,
    /// The host does not continue the control transfers that it begins.
    is_away: Cell<bool>,
    address: Cell<u8>,
    enabled: RefCell<Vec<u8>>,
    allocated: Cell<usize>,
    /// Packets to the port, and what it has sent.
    sends: RefCell<VecDeque<Vec<u8>>>,
    taken: RefCell<Vec<Vec<u8>>>,
}

thread_local! {
    static SUSPENDED: Cell<bool> = const { Cell::new(false) };
}

async fn tick() {
    Timer::after(Duration::from_micros(250)).await;
}

struct Chip(&'static Cable);
struct ChipBus(&'static Cable);
struct ChipPipe(&'static Cable);
struct ChipEndpoint(&'static Cable, EndpointInfo);

impl Chip {
    fn endpoint(
        &mut self,
        ep_type: EndpointType,
        max_packet_size: u16,
        input: bool,
    ) -> Result<ChipEndpoint, EndpointAllocError> {
        let count = self.0.allocated.get() + 1;
        self.0.allocated.set(count);
        if count >= ENDPOINTS {
            return Err(EndpointAllocError);
        }
        let addr = EndpointAddress::from(count as u8 | if input { 0x80 } else { 0 });
        Ok(ChipEndpoint(self.0, EndpointInfo { addr, ep_type, max_packet_size, interval_ms: 0 }))
    }
}

impl<'d> Driver<'d> for Chip {
    type EndpointOut = ChipEndpoint;
    type EndpointIn = ChipEndpoint;
    type ControlPipe = ChipPipe;
    type Bus = ChipBus;

    fn alloc_endpoint_out(
        &mut self,
        kind: EndpointType,
        _: Option<EndpointAddress>,
        size: u16,
        _: u8,
    ) -> Result<ChipEndpoint, EndpointAllocError> {
        self.endpoint(kind, size, false)
    }

    fn alloc_endpoint_in(
        &mut self,
        kind: EndpointType,
        _: Option<EndpointAddress>,
        size: u16,
        _: u8,
    ) -> Result<ChipEndpoint, EndpointAllocError> {
        self.endpoint(kind, size, true)
    }

    fn start(self, _: u16) -> (ChipBus, ChipPipe) {
        (ChipBus(self.0), ChipPipe(self.0))
    }
}

impl Bus for ChipBus {
    async fn enable(&mut self) {}

    async fn disable(&mut self) {}

    async fn poll(&mut self) -> Event {
        loop {
            if let Some(event) = self.0.sticks.get() {
                return event; // at once
            }
            if let Some(event) = self.0.events.borrow_mut().pop_front() {
                if event == Event::Reset {
                    self.0.enabled.borrow_mut().clear();
                }
                return event;
            }
            tick().await;
        }
    }

    fn endpoint_set_enabled(&mut self, address: EndpointAddress, enabled: bool) {
        self.0.enabled.borrow_mut().retain(|&other| other != u8::from(address));
        if enabled {
            self.0.enabled.borrow_mut().push(address.into());
        }
    }

    fn endpoint_set_stalled(&mut self, address: EndpointAddress, _: bool) {
        assert!(address.index() < ENDPOINTS, "out of range");
    }

    fn endpoint_is_stalled(&mut self, address: EndpointAddress) -> bool {
        assert!(address.index() < ENDPOINTS, "out of range");
        false
    }

    async fn remote_wakeup(&mut self) -> Result<(), Unsupported> {
        Err(Unsupported)
    }
}

impl ChipPipe {
    async fn step(&self) {
        tick().await;
        if self.0.is_away.get() {
            // No reset of the bus ends this, as the bus is not looked at meanwhile.
            core::future::pending::<()>().await;
        }
    }
}

impl ControlPipe for ChipPipe {
    fn max_packet_size(&self) -> usize {
        64
    }

    async fn setup(&mut self) -> [u8; 8] {
        loop {
            if let Some(setup) = self.0.setup.take() {
                return setup;
            }
            tick().await;
        }
    }

    async fn data_out(&mut self, buffer: &mut [u8], _: bool, _: bool) -> Result<usize, EndpointError> {
        self.step().await;
        let data = self.0.from_host.borrow_mut().pop_front().unwrap_or_default();
        buffer[..data.len()].copy_from_slice(&data);
        Ok(data.len())
    }

    async fn data_in(&mut self, data: &[u8], _: bool, last: bool) -> Result<(), EndpointError> {
        self.step().await;
        self.0.to_host.borrow_mut().extend(data);
        if last {
            self.0.outcome.set(Some(Outcome::Accepted));
        }
        Ok(())
    }

    async fn accept(&mut self) {
        self.step().await;
        self.0.outcome.set(Some(Outcome::Accepted));
    }

    async fn reject(&mut self) {
        self.0.outcome.set(Some(Outcome::Rejected));
    }

    async fn accept_set_address(&mut self, address: u8) {
        self.0.address.set(address);
        self.accept().await;
    }
}

impl ChipEndpoint {
    fn is_enabled(&self) -> bool {
        self.0.enabled.borrow().contains(&self.1.addr.into())
    }
}

impl Endpoint for ChipEndpoint {
    fn info(&self) -> &EndpointInfo {
        &self.1
    }

    async fn wait_enabled(&mut self) {
        while !self.is_enabled() {
            tick().await;
        }
    }
}

impl EndpointOut for ChipEndpoint {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, EndpointError> {
        loop {
            if !self.is_enabled() {
                return Err(EndpointError::Disabled);
            }
            if let Some(packet) = self.0.sends.borrow_mut().pop_front() {
                buffer[..packet.len()].copy_from_slice(&packet);
                return Ok(packet.len());
            }
            tick().await;
        }
    }
}

impl EndpointIn for ChipEndpoint {
    async fn write(&mut self, packet: &[u8]) -> Result<(), EndpointError> {
        tick().await;
        if !self.is_enabled() {
            return Err(EndpointError::Disabled);
        }
        assert!(packet.len() <= usize::from(self.1.max_packet_size));
        self.0.taken.borrow_mut().push(packet.into());
        Ok(())
    }
}

/// The host.
struct Host(&'static Cable);

impl Host {
    async fn pass_ms(&self, ms: u64) {
        Timer::after(Duration::from_millis(ms)).await;
    }

    /// A control transfer: how it ended within 0.1 s, and what came.
    async fn control(&self, setup: [u8; 8], data: &[u8]) -> (Option<Outcome>, Vec<u8>) {
        self.0.outcome.set(None);
        self.0.to_host.borrow_mut().clear();
        *self.0.from_host.borrow_mut() = data.chunks(64).map(<[u8]>::to_vec).collect();
        self.0.setup.set(Some(setup));
        let end = Instant::now() + Duration::from_millis(100);
        while self.0.outcome.get().is_none() && Instant::now() < end {
            tick().await;
        }
        (self.0.outcome.get(), self.0.to_host.borrow().clone())
    }

    async fn descriptor(&self, kind: u8, index: u8) -> Vec<u8> {
        let (outcome, data) = self.control([0x80, 6, index, kind, 0, 0, 0xFF, 0], &[]).await;
        assert_eq!(outcome, Some(Outcome::Accepted), "descriptor {kind} {index}");
        data
    }

    async fn string(&self, index: u8) -> String {
        let data = self.descriptor(3, index).await;
        assert_eq!((usize::from(data[0]), data[1]), (data.len(), 3));
        let units: Vec<u16> =
            data[2..].chunks(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
        String::from_utf16(&units).unwrap()
    }

    /// Resets the bus and sets the device up.
    async fn find(&self) {
        self.0.events.borrow_mut().push_back(Event::Reset);
        self.pass_ms(5).await;
        assert_eq!(self.control([0, 5, 7, 0, 0, 0, 0, 0], &[]).await.0, Some(Outcome::Accepted), "address");
        assert_eq!(self.0.address.get(), 7);
        assert_eq!(self.configure(1).await, Some(Outcome::Accepted));
    }

    async fn configure(&self, configuration: u8) -> Option<Outcome> {
        self.control([0, 9, configuration, 0, 0, 0, 0, 0], &[]).await.0
    }

    /// DTR.
    async fn terminal(&self, ready: bool) {
        let line = self.control([0x21, 0x22, u8::from(ready), 0, 0, 0, 0, 0], &[]).await;
        assert_eq!(line.0, Some(Outcome::Accepted));
    }

    /// Heartbeats that come within 2.5 s.
    async fn heartbeats(&self) -> usize {
        self.0.taken.borrow_mut().clear();
        self.pass_ms(2500).await;
        let bytes = self.0.taken.borrow().concat();
        let (mut decoder, mut rest, mut frames) = (Decoder::new(), &bytes[..], Vec::<Frame>::new());
        while let (count, Some(frame)) = decoder.receive(None, rest) {
            rest = &rest[count..];
            frames.push(frame);
        }
        assert_eq!((decoder.counters().bad_checksums, decoder.counters().skipped), (0, 0));
        frames.iter().filter(|frame| frame.id == HEARTBEAT).count()
    }
}

fn run(scenario: impl AsyncFnOnce(&Host)) {
    clock::reset();
    SUSPENDED.set(false);
    let cable: &Cable = Box::leak(Box::default());
    cable.events.borrow_mut().push_back(Event::PowerDetected);
    let mut settings = NodeSettings::DEFAULT;
    settings.identity.autopilot_port = 0;
    let ports = [PortConfig::usb()];
    let service: Service<'_, 1, 1> = Service::new(Instant::now(), settings, SigningState::NONE, [], ports);
    let runner = Runner::new(service);
    // As long as names may be.
    let product = "A board with a rather long nam";
    assert_eq!(product.len(), LONGEST);
    let device = serve(
        Careful::new(Chip(cable), || SUSPENDED.get()),
        Box::leak(Box::default()),
        Names { product, serial_number: SERIAL_NUMBER },
        &runner,
        0,
    );
    let node = join(runner.keep_time(|_, _| ()), device);
    clock::run(select(node, async {
        let host = Host(cable);
        host.pass_ms(10).await;
        scenario(&host).await;
    }));
}

#[test]
fn host_finds_a_serial_port_and_a_program_that_opens_it_gets_heartbeats() {
    run(async |host| {
        host.0.events.borrow_mut().push_back(Event::Reset);
        let device = host.descriptor(1, 0).await;
        assert_eq!((device.len(), device[1], device[7]), (18, 1, 64));
        assert_eq!(host.string(1).await, "jetlink");
        assert_eq!(host.string(2).await.len(), LONGEST);
        assert_eq!(host.string(3).await, SERIAL_NUMBER);
        let configuration = host.descriptor(2, 0).await;
        assert_eq!(usize::from(configuration[2]), configuration.len(), "all of it");
        // Interfaces by class and subclass: communication with an abstract control model, and its data.
        let (mut classes, mut at) = (Vec::new(), 0);
        while at < configuration.len() {
            if configuration[at + 1] == 4 {
                classes.push((configuration[at + 5], configuration[at + 6]));
            }
            at += usize::from(configuration[at]);
        }
        assert_eq!(classes, [(0x02, 0x02), (0x0A, 0x00)]);
        host.find().await;
        let coding = [0x00, 0xC2, 0x01, 0, 0, 0, 8]; // 115 200, 8N1: there is no UART behind it
        assert_eq!(host.control([0x21, 0x20, 0, 0, 0, 0, 7, 0], &coding).await.0, Some(Outcome::Accepted));
        assert_eq!(host.control([0xA1, 0x21, 0, 0, 0, 0, 7, 0], &[]).await.1, coding);
        assert_eq!(host.heartbeats().await, 0, "no program has opened it");
        host.terminal(true).await;
        assert!(host.heartbeats().await >= 2);
        host.terminal(false).await;
        assert_eq!(host.heartbeats().await, 0);
        host.terminal(true).await;
        assert!(host.heartbeats().await >= 2);
        assert_eq!(host.configure(0).await, Some(Outcome::Accepted));
        assert_eq!(host.heartbeats().await, 0);
    });
}

#[test]
fn suspend_closes_the_port_and_a_wake_opens_it() {
    run(async |host| {
        host.find().await;
        host.terminal(true).await;
        assert!(host.heartbeats().await >= 2);
        SUSPENDED.set(true);
        host.0.events.borrow_mut().push_back(Event::Suspend);
        host.pass_ms(10).await;
        assert_eq!(host.heartbeats().await, 0);
        SUSPENDED.set(false);
        host.0.events.borrow_mut().push_back(Event::Resume);
        host.pass_ms(10).await;
        assert!(host.heartbeats().await >= 2);
        // Pulled, and plugged in elsewhere.
        SUSPENDED.set(true);
        host.0.events.borrow_mut().push_back(Event::Suspend);
        host.pass_ms(3000).await;
        SUSPENDED.set(false);
        host.find().await;
        assert_eq!(host.heartbeats().await, 0);
        host.terminal(true).await;
        assert!(host.heartbeats().await >= 2);
    });
}

#[test]
fn suspend_from_before_a_reset_is_ignored() {
    run(async |host| {
        host.0.events.borrow_mut().extend([Event::Suspend, Event::Reset, Event::Suspend]);
        host.pass_ms(10).await;
        // Without a reset: that would end it.
        assert_eq!(host.configure(1).await, Some(Outcome::Accepted));
        host.terminal(true).await;
        assert!(host.heartbeats().await >= 2);
    });
}

/// A chip that is broken, or an emulator that has no controller.
#[test]
fn event_that_never_ends_leaves_others_their_turn() {
    for event in [Event::Suspend, Event::Resume, Event::Reset, Event::PowerDetected] {
        run(async |host| {
            host.0.sticks.set(Some(event));
            host.pass_ms(3000).await;
            host.0.sticks.set(None);
            host.find().await;
            host.terminal(true).await;
            assert!(host.heartbeats().await >= 2, "{event:?}");
        });
    }
}

/// `GET_STATUS`, `CLEAR_FEATURE` and `SET_FEATURE` of endpoints: the chip has 0 to 3.
#[test]
fn request_about_any_endpoint_leaves_the_device_running() {
    run(async |host| {
        host.find().await;
        for address in 0..=u8::MAX {
            for (request_type, request, length) in [(0x82, 0, 2), (0x02, 1, 0), (0x02, 3, 0)] {
                if address & 0x7F == 0 && request == 3 {
                    continue; // halts the control pipe itself
                }
                let setup = [request_type, request, 0, 0, address, 0, length, 0];
                assert!(host.control(setup, &[]).await.0.is_some(), "{setup:02x?}");
            }
        }
        host.terminal(true).await;
        assert!(host.heartbeats().await >= 2);
    });
}

#[test]
#[should_panic(expected = "out of range")]
fn controller_alone_panics_by_such_a_request() {
    ChipBus(Box::leak(Box::default())).endpoint_set_stalled(EndpointAddress::from(0x84), true);
}

/// Every request there is, with every kind of recipient: answered or rejected, and then everything continues.
#[test]
fn any_request_leaves_the_device_running() {
    run(async |host| {
        host.find().await;
        fastrand::seed(1);
        for _ in 0..3000 {
            let mut setup: [u8; 8] = core::array::from_fn(|_| fastrand::u8(..));
            // Small numbers are what has a meaning.
            for byte in setup.iter_mut().skip(1) {
                *byte &= if fastrand::bool() { 0x07 } else { 0xFF };
            }
            if fastrand::bool() {
                setup[0] &= 0x83;
            }
            host.control(setup, &[0x5A; 64][..usize::from(setup[6] & 63)]).await;
        }
        host.find().await;
        host.terminal(true).await;
        assert!(host.heartbeats().await >= 2);
    });
}

#[test]
fn host_that_leaves_in_the_middle_of_a_request_finds_the_device_again() {
    run(async |host| {
        for setup in
            [[0x80, 6, 0, 2, 0, 0, 0xFF, 0], [0x21, 0x20, 0, 0, 0, 0, 7, 0], [0, 9, 1, 0, 0, 0, 0, 0]]
        {
            host.0.is_away.set(true);
            assert_eq!(host.control(setup, &[0; 7]).await.0, None, "{setup:02x?}");
            // Another host, or the same one.
            host.0.is_away.set(false);
            host.pass_ms(2500).await;
            host.find().await;
            host.terminal(true).await;
            assert!(host.heartbeats().await >= 2);
        }
    });
}
