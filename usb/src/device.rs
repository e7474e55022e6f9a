//! The device: one serial port, and what the host does with it.

use crate::careful::Careful;
use embassy_futures::join::join;
use embassy_usb::class::cdc_acm::{CdcAcmClass, Receiver, Sender, State};
use embassy_usb::control::{OutResponse, Recipient, Request, RequestType};
use embassy_usb::driver::Driver;
use embassy_usb::{Builder, Config, Handler};
use jetlink_mavlink::attached::Attached;
use jetlink_mavlink::packets::{Connection, NotConfigured, PACKET, ReadPacket, WritePacket};
use jetlink_mavlink::runner::Runner;

/// Vendor and product: of pid.codes, for tests. **Not for devices that are sold or given away**: those need a number of their own.
const ID: (u16, u16) = (0x1209, 0x0001);

/// Most current that it takes from the bus, in mA: a board with nothing on its sockets takes less.
const MAX_MILLIAMPERES: u16 = 500;

/// Longest name or number of a device, in bytes.
pub const LONGEST: usize = 30;

/// For the answers to control requests. The longest is a name: two bytes for each of its, and two in front.
const CONTROL: usize = 2 * LONGEST + 4;

/// `SET_CONTROL_LINE_STATE` (PSTN devices, 6.3.12), with DTR in bit 0 of its value.
const SET_CONTROL_LINE_STATE: u8 = 0x22;

/// The interface with the control lines: the first one.
const CONTROL_INTERFACE: u16 = 0;

/// What a computer shows of the device.
#[derive(Clone, Copy, Debug)]
pub struct Names<'a> {
    /// The board, of at most [`LONGEST`] bytes.
    pub product: &'a str,
    /// A number that no other board has, of at most [`LONGEST`] bytes.
    pub serial_number: &'a str,
}

/// Reports to the connection what the host does.
struct ConnectionHandler<'a>(&'a Connection);

impl Handler for ConnectionHandler<'_> {
    fn enabled(&mut self, _: bool) {
        self.0.reset();
    }

    fn reset(&mut self) {
        self.0.reset();
    }

    fn configured(&mut self, configured: bool) {
        self.0.set_configured(configured);
    }

    fn suspended(&mut self, suspended: bool) {
        self.0.set_suspended(suspended);
    }

    fn control_out(&mut self, request: Request, _: &[u8]) -> Option<OutResponse> {
        let Request { request_type, recipient, request: number, value, index, .. } = request;
        if (request_type, recipient, number, index)
            == (RequestType::Class, Recipient::Interface, SET_CONTROL_LINE_STATE, CONTROL_INTERFACE)
        {
            self.0.set_terminal(value & 1 == 1);
        }
        None // the port answers
    }
}

struct FromHost<'d, D: Driver<'d>>(Receiver<'d, D>);

impl<'d, D: Driver<'d>> ReadPacket for FromHost<'d, D> {
    async fn read(&mut self, packet: &mut [u8; PACKET]) -> Result<usize, NotConfigured> {
        self.0.wait_connection().await;
        self.0.read_packet(packet).await.map_err(|_| NotConfigured)
    }
}

struct ToHost<'d, D: Driver<'d>>(Sender<'d, D>);

impl<'d, D: Driver<'d>> WritePacket for ToHost<'d, D> {
    async fn write(&mut self, packet: &[u8]) -> Result<(), NotConfigured> {
        self.0.write_packet(packet).await.map_err(|_| NotConfigured)
    }
}

/// What the device needs for as long as it runs.
pub struct Place<'d> {
    connection: Connection,
    handler: Option<ConnectionHandler<'d>>,
    state: State<'d>,
    configuration: [u8; 96],
    bos: [u8; 16],
    control: [u8; CONTROL],
}

impl Default for Place<'_> {
    fn default() -> Self {
        Self {
            connection: Connection::new(),
            handler: None,
            state: State::new(),
            configuration: [0; _],
            bos: [0; _],
            control: [0; _],
        }
    }
}

impl core::fmt::Debug for Place<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Place").field("connection", &self.connection).finish_non_exhaustive()
    }
}

/// Serves a port of a service, counted from 0, on this controller. It never ends, whatever the host does.
///
/// # Panics
/// If a name is too long, or the controller lacks endpoints.
pub async fn serve<'d, D: Driver<'d>, const N: usize, const P: usize, A: Attached>(
    driver: Careful<D>,
    place: &'d mut Place<'d>,
    names: Names<'d>,
    runner: &Runner<'_, N, P, A>,
    port: usize,
) {
    assert!(names.product.len() <= LONGEST && names.serial_number.len() <= LONGEST, "a name is too long");
    let mut config = Config::new(ID.0, ID.1);
    config.manufacturer = Some("jetlink");
    config.product = Some(names.product);
    config.serial_number = Some(names.serial_number);
    config.max_power = MAX_MILLIAMPERES;
    let Place { connection, handler, state, configuration, bos, control } = place;
    let connection: &'d Connection = connection;
    let mut builder = Builder::new(driver, config, configuration, bos, &mut [], control);
    // Before the port, which answers requests: this only looks at them.
    builder.handler(handler.insert(ConnectionHandler(connection)));
    let class = CdcAcmClass::new(&mut builder, state, PACKET as u16);
    let mut device = builder.build();
    let (sender, receiver) = class.split();
    let pump = runner.serve_packets(port, connection, FromHost(receiver), ToHost(sender));
    join(device.run(), pump).await;
}
