//! MAVLink of the rig: the service of the firmware on TCP, UDP and serial ports. It commands the engines in place of the
//! pilots.

mod address;
mod link;

pub use self::address::Address;

use self::link::Link;
use super::engines::Engine;
use super::node::{Cause, Node, Reset};
use embassy_time::{Duration, Instant, Ticker};
use jetlink::channel::Channel;
use jetlink::command::Origin;
use jetlink_mavlink::port::PortConfig;
use jetlink_mavlink::service::{EngineParts, Request, Service};
use jetlink_mavlink::settings::{EngineSettings, NodeSettings};
use jetlink_mavlink::signing::SigningState;
use std::cell::RefCell;

/// Most ports.
pub const MOST_PORTS: usize = 4;
/// Most engines: as many as the rig has.
const MOST_ENGINES: usize = 8;
/// Time between two looks at the ports.
const TICK: Duration = Duration::from_millis(10);
/// How long a restart by command takes.
const RESTART: Reset = Reset { away: Duration::from_millis(50), cause: Cause::Watchdog };

/// The ports, the settings and the key for signing, which go on when the node is reset: a board would store them. They end with
/// the program.
#[derive(Debug)]
pub struct Mavlink {
    links: RefCell<Vec<Link>>,
    ports: Vec<PortConfig>,
    settings: RefCell<NodeSettings>,
    signing: RefCell<SigningState>,
    engines: RefCell<Vec<EngineSettings>>,
}

impl Mavlink {
    /// Opens the ports. The autopilot is on the first one that is not for a ground station.
    pub fn open(addresses: &[Address], engines: &[Engine]) -> Result<Self, String> {
        let links = addresses.iter().map(Link::open).collect::<Result<Vec<_>, _>>()?;
        let mut settings = NodeSettings::DEFAULT;
        let autopilot = addresses.iter().position(Address::is_autopilot).map_or(0, |port| port + 1);
        settings.identity.autopilot_port = u8::try_from(autopilot).unwrap_or(0);
        // Without an autopilot there is no throttle but idle.
        let source = if autopilot == 0 { 0 } else { EngineSettings::DEFAULT.source };
        Ok(Self {
            links: RefCell::new(links),
            ports: addresses.iter().map(Address::config).collect(),
            settings: RefCell::new(settings),
            signing: RefCell::new(SigningState::NONE),
            engines: RefCell::new(vec![EngineSettings { source, ..EngineSettings::DEFAULT }; engines.len()]),
        })
    }

    /// Serves the ports of a node that has just started, until it is reset.
    pub async fn serve(&self, node: &Node<'_>, channels: &[Channel]) {
        let mut parts = Vec::new();
        for (i, (channel, settings)) in channels.iter().zip(self.engines.borrow().iter()).enumerate() {
            let Ok(source) = channel.handle_in(channels).source(Origin::Mavlink) else { continue };
            parts.push(EngineParts { source, config: node.config(i), settings: *settings });
        }
        let settings = *self.settings.borrow();
        let signing = self.signing.borrow().clone();
        let mut service: Service<'_, MOST_ENGINES, MOST_PORTS> =
            Service::new(Instant::now(), settings, signing, parts, self.ports.iter().copied());
        let mut ticker = Ticker::every(TICK);
        loop {
            let now = Instant::now();
            for (port, link) in self.links.borrow_mut().iter_mut().enumerate() {
                while let Some(bytes) = link.receive() {
                    service.receive(now, port, &bytes);
                }
            }
            service.poll(now);
            for (port, (link, config)) in self.links.borrow_mut().iter_mut().zip(&self.ports).enumerate() {
                // As many as the port carries in this time.
                let most = u64::from(config.bytes_per_second) * TICK.as_millis() / 1000;
                let mut bytes = vec![0; most.try_into().unwrap_or(usize::MAX)];
                if service.is_waiting(port) && link.is_ready() {
                    let count = service.transmit(port, &mut bytes);
                    bytes.truncate(count);
                    link.send(bytes);
                }
            }
            self.settings.replace(*service.settings());
            self.signing.replace(service.signing(now));
            for (i, (config, settings)) in service.engine_settings().enumerate() {
                node.configure(i, *config);
                if let Some(kept) = self.engines.borrow_mut().get_mut(i) {
                    *kept = *settings;
                }
            }
            if service.take_request() == Some(Request::Reboot) {
                node.reset(RESTART);
            }
            ticker.next().await;
        }
    }
}
