//! MAVLink of the rig: the service of the firmware on TCP, UDP and serial ports. It commands the engines in place of the
//! pilots.

use super::engines::{Engine, MOST_ENGINES};
use super::node::{Cause, Node, Reset};
use super::port::{Address, Format, Link, OpenError};
use super::radio::{Radio, Receiver};
use embassy_futures::join::{join, join_array};
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant};
use jetlink::channel::Channel;
use jetlink::command::Origin;
use jetlink_mavlink::port::PortConfig;
use jetlink_mavlink::runner::Runner;
use jetlink_mavlink::service::{EngineParts, Request, Service};
use jetlink_mavlink::settings::{EngineSettings, Identity, NodeSettings};
use jetlink_mavlink::signing::SigningState;
use jetlink_rc::parameters::Parameters;
use std::cell::{Cell, RefCell};
use std::future::pending;

/// Most ports.
pub const MOST_PORTS: usize = 4;
/// Bytes a second of a connection to an autopilot: those of a UART with 57 600 baud, as a board's telemetry port has.
const UART_BAUD: u32 = 57_600;
/// How long a restart by command takes.
const RESTART: Reset = Reset { away: Duration::from_millis(50), cause: Cause::Watchdog };

/// What a port carries. A port that only this computer can reach counts as USB: even with a key, nothing has to be signed there.
fn config(address: &Address) -> PortConfig {
    match address {
        Address::TcpIn(_) | Address::UdpIn(_) if address.is_this_computer() => PortConfig::usb(),
        Address::TcpIn(_) | Address::UdpIn(_) => PortConfig::network(),
        Address::TcpOut(_) | Address::UdpOut(_) => PortConfig::uart(UART_BAUD),
        Address::Serial(_, baud) => PortConfig::uart(*baud),
    }
}

/// The ports, the settings and the key for signing, which continue when the node is reset: a board would store them. They end with
/// the program.
#[derive(Debug)]
pub struct Mavlink {
    links: Vec<Link>,
    ports: Vec<PortConfig>,
    settings: RefCell<NodeSettings>,
    signing: RefCell<SigningState>,
    /// The ids in force ([`Identity::packed`]): a reset in flight changes none.
    identity: Cell<Option<u32>>,
    engines: RefCell<Vec<EngineSettings>>,
}

impl Mavlink {
    /// Opens the ports. The autopilot is on the first one that is not for a ground station.
    pub fn open(addresses: &[Address], engines: &[Engine]) -> Result<Self, OpenError> {
        let links =
            addresses.iter().map(|address| Link::open(address, Format::N1)).collect::<Result<Vec<_>, _>>()?;
        let mut settings = NodeSettings::DEFAULT;
        let autopilot = addresses.iter().position(Address::is_autopilot).map_or(0, |port| port + 1);
        settings.identity.autopilot_port = u8::try_from(autopilot).unwrap_or(0);
        // Without an autopilot there is no throttle but idle.
        let source = if autopilot == 0 { 0 } else { EngineSettings::DEFAULT.source };
        Ok(Self {
            links,
            ports: addresses.iter().map(config).collect(),
            settings: RefCell::new(settings),
            signing: RefCell::new(SigningState::NONE),
            identity: Cell::new(None),
            engines: RefCell::new(vec![EngineSettings { source, ..EngineSettings::DEFAULT }; engines.len()]),
        })
    }

    /// Serves the ports of a node that has just started, until it is reset.
    pub async fn serve(&self, node: &Node<'_>, channels: &[Channel], radio: Option<(&Radio, &Receiver<'_>)>) {
        let mut parts = Vec::new();
        for (i, (channel, settings)) in channels.iter().zip(self.engines.borrow().iter()).enumerate() {
            let owner = channel.owner_in(channels);
            let Ok(source) = owner.source(Origin::Mavlink) else { continue };
            parts.push(EngineParts {
                source,
                setup: owner.setup(),
                config: node.config(i),
                settings: *settings,
            });
        }
        let settings = *self.settings.borrow();
        let signing = self.signing.borrow().clone();
        let outputs = node.shared().map(|shared| (shared, node.output_settings()));
        let attached = Parameters::new(radio.map(|(_, receiver)| receiver), outputs);
        let mut service: Service<'_, MOST_ENGINES, MOST_PORTS, Parameters<'_, '_, MOST_ENGINES>> =
            Service::with(Instant::now(), settings, signing, parts, self.ports.iter().copied(), attached);
        let identity = Identity::at_start(settings.identity, self.identity.get(), node.was_in_flight());
        service.set_identity(Instant::now(), identity);
        let runner = Runner::new(service);
        let time = runner.keep_time(|now, service| {
            self.settings.replace(*service.settings());
            self.identity.set(Some(service.identity().packed()));
            self.signing.replace(service.signing(now));
            for (i, (config, settings)) in service.engine_settings().enumerate() {
                node.configure(i, *config);
                if let Some(stored) = self.engines.borrow_mut().get_mut(i) {
                    *stored = *settings;
                }
                if let Some((radio, settings)) = radio.zip(service.attached().engine_settings(i)) {
                    radio.0.configure(i, settings);
                }
                if let Some(settings) = service.attached().output_settings(i) {
                    node.configure_outputs(i, settings);
                }
            }
        });
        let ports = std::array::from_fn::<_, MOST_PORTS, _>(|port| {
            let runner = &runner;
            async move {
                if let (Some(link), Some(config)) = (self.links.get(port), self.ports.get(port)) {
                    let (rx, tx) = link.halves(config.bytes_per_second);
                    runner.serve(port, rx, tx).await;
                }
            }
        });
        let ports = join(join_array(ports), pending::<()>());
        if let Either::First(Request::Reboot) = select(time, ports).await {
            node.reset(RESTART);
        }
    }
}
