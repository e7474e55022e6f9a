//! A driver, but careful: what a host asks for causes no panic, and what it leaves unfinished comes to an end. `embassy-usb` 0.6 and
//! `embassy-usb-synopsys-otg` 0.3 alone are not so (`docs/boards-upstream.md`), and a panic resets the node.
//!
//! | what the host does | without this | with it |
//! |---|---|---|
//! | it asks about an endpoint that the chip lacks, or halts it | the driver panics | the answer is that the endpoint is not halted |
//! | it goes away in the middle of a control transfer | the device waits for the rest forever, and sees no reset of the bus | it waits for [`UNFINISHED`] |
//! | it resets the bus after a suspend, and both are seen at once, the suspend last | the device takes itself for suspended, and answers no request | it looks whether the bus is suspended now |
//!
//! And a controller that reports the same again and again gets no more than one look each [`PAUSE`]: otherwise no other task of the executor
//! would have its turn, the one that feeds the watchdog neither.

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};
use embassy_usb::driver::{
    Bus, ControlPipe, Driver, EndpointAddress, EndpointAllocError, EndpointError, EndpointType, Event,
    Unsupported,
};

/// Time that a host has for each step of a control transfer. It has to give up after 5 s itself (USB 2.0, 9.2.6.1).
pub const UNFINISHED: Duration = Duration::from_secs(2);

/// Time between two events of the bus. A host takes 10 ms and more for each (USB 2.0, 7.1.7).
pub const PAUSE: Duration = Duration::from_millis(1);

/// Highest number of an endpoint that a host may ask about. Each chip has these (an STM32F427: 0 to 3), and the device uses no other.
const HIGHEST: usize = 3;

/// The driver.
#[derive(Debug)]
pub struct Careful<D> {
    driver: D,
    is_suspended: fn() -> bool,
}

impl<D> Careful<D> {
    /// Of this driver. `is_suspended` looks whether the bus is suspended now.
    pub const fn new(driver: D, is_suspended: fn() -> bool) -> Self {
        Self { driver, is_suspended }
    }
}

impl<'d, D: Driver<'d>> Driver<'d> for Careful<D> {
    type EndpointOut = D::EndpointOut;
    type EndpointIn = D::EndpointIn;
    type ControlPipe = CarefulPipe<D::ControlPipe>;
    type Bus = CarefulBus<D::Bus>;

    fn alloc_endpoint_out(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        max_packet_size: u16,
        interval_ms: u8,
    ) -> Result<Self::EndpointOut, EndpointAllocError> {
        self.driver.alloc_endpoint_out(kind, address, max_packet_size, interval_ms)
    }

    fn alloc_endpoint_in(
        &mut self,
        kind: EndpointType,
        address: Option<EndpointAddress>,
        max_packet_size: u16,
        interval_ms: u8,
    ) -> Result<Self::EndpointIn, EndpointAllocError> {
        self.driver.alloc_endpoint_in(kind, address, max_packet_size, interval_ms)
    }

    fn start(self, control_max_packet_size: u16) -> (Self::Bus, Self::ControlPipe) {
        let (bus, pipe) = self.driver.start(control_max_packet_size);
        (CarefulBus { bus, is_suspended: self.is_suspended, next: Instant::MIN }, CarefulPipe(pipe))
    }
}

/// Its bus.
#[derive(Debug)]
pub struct CarefulBus<B> {
    bus: B,
    is_suspended: fn() -> bool,
    /// It is polled again at this time, or later.
    next: Instant,
}

impl<B: Bus> Bus for CarefulBus<B> {
    async fn enable(&mut self) {
        self.bus.enable().await;
    }

    async fn disable(&mut self) {
        self.bus.disable().await;
    }

    #[expect(clippy::disallowed_methods, reason = "a controller is polled with a pause")]
    async fn poll(&mut self) -> Event {
        loop {
            Timer::at(self.next).await;
            let event = self.bus.poll().await;
            self.next = Instant::now() + PAUSE;
            match event {
                Event::Suspend if !(self.is_suspended)() => {}
                event => return event,
            }
        }
    }

    fn endpoint_set_enabled(&mut self, address: EndpointAddress, enabled: bool) {
        self.bus.endpoint_set_enabled(address, enabled);
    }

    fn endpoint_set_stalled(&mut self, address: EndpointAddress, stalled: bool) {
        if address.index() <= HIGHEST {
            self.bus.endpoint_set_stalled(address, stalled);
        }
    }

    fn endpoint_is_stalled(&mut self, address: EndpointAddress) -> bool {
        address.index() <= HIGHEST && self.bus.endpoint_is_stalled(address)
    }

    fn force_reset(&mut self) -> Result<(), Unsupported> {
        self.bus.force_reset()
    }

    async fn remote_wakeup(&mut self) -> Result<(), Unsupported> {
        self.bus.remote_wakeup().await
    }
}

/// Its control pipe.
#[derive(Debug)]
pub struct CarefulPipe<P>(P);

#[expect(clippy::disallowed_methods, reason = "a wait for a host has to end")]
async fn or_give_up<T>(step: impl Future<Output = T>, given_up: T) -> T {
    match select(step, Timer::after(UNFINISHED)).await {
        Either::First(result) => result,
        Either::Second(()) => given_up,
    }
}

impl<P: ControlPipe> ControlPipe for CarefulPipe<P> {
    fn max_packet_size(&self) -> usize {
        self.0.max_packet_size()
    }

    async fn setup(&mut self) -> [u8; 8] {
        self.0.setup().await
    }

    async fn data_out(&mut self, buffer: &mut [u8], first: bool, last: bool) -> Result<usize, EndpointError> {
        or_give_up(self.0.data_out(buffer, first, last), Err(EndpointError::Disabled)).await
    }

    async fn data_in(&mut self, data: &[u8], first: bool, last: bool) -> Result<(), EndpointError> {
        or_give_up(self.0.data_in(data, first, last), Err(EndpointError::Disabled)).await
    }

    async fn accept(&mut self) {
        or_give_up(self.0.accept(), ()).await;
    }

    async fn reject(&mut self) {
        or_give_up(self.0.reject(), ()).await;
    }

    async fn accept_set_address(&mut self, address: u8) {
        or_give_up(self.0.accept_set_address(address), ()).await;
    }
}
