//! MAVLink on the telemetry port and on USB, and the settings that it changes. It is served in thread mode, so that no engine's task waits for
//! it.
#![cfg_attr(
    feature = "count",
    allow(dead_code, reason = "with `count` it is not served: its instructions would also be counted")
)]

use crate::attached::{self, ANY, Choice, Chosen, With};
use crate::board::engines::IDENTITY;
use crate::board::settings::{BYTES, SETTINGS};
use crate::board::{self, EcuPort, Storage};
use crate::radio::Radio;
use crate::wiring;
use embassy_futures::block_on;
use embassy_futures::select::{Either, select};
use jetlink::command::Origin;
use jetlink::config::EngineConfig;
use jetlink::line::Line;
use jetlink::node::Node;
use jetlink::units::BaudRate;
use jetlink::wiring::WiringError;
use jetlink_fw::config::{ENGINES, MAVLINK, MAVLINK_ENGINES, TELEMETRY};
use jetlink_mavlink::port::PortConfig;
#[cfg(feature = "usb")]
use jetlink_mavlink::record::read_signing;
use jetlink_mavlink::record::{NotUsed, apply_to_engine, apply_to_node, engine_of_attached};
use jetlink_mavlink::retained_settings::{Defaults, fingerprint};
use jetlink_mavlink::service::{EngineParts, ParameterStorage, Request, Service};
use jetlink_mavlink::settings::{EngineSettings, Identity, NodeSettings};
use jetlink_mavlink::signing::SigningState;
use jetlink_mavlink::store::{AtRest, Found, KEYS};
use static_cell::StaticCell;

/// Number of engines of this node.
const N: usize = ENGINES.len();

/// Settings of the node of this image, with the baud rate of its telemetry port.
const NODE: NodeSettings = NodeSettings {
    identity: Identity { telemetry_baud: BaudRate::up_to(TELEMETRY.baud), ..MAVLINK.identity },
    ..MAVLINK
};

/// Settings of this image.
static DEFAULTS: Defaults<'static> = Defaults {
    node: &NODE,
    engines: &ENGINES,
    own: &MAVLINK_ENGINES,
    wiring: &wiring::IMAGE,
    attached: attached::DEFAULTS,
    room: BYTES,
};

/// Ports of the service: the telemetry port, and USB with its feature.
const PORTS: usize = 1 + cfg!(feature = "usb") as usize;

/// Number of the telemetry port.
const TELEMETRY_PORT: usize = 0;

/// Number of USB.
pub const USB_PORT: usize = 1;

/// Runs the service of this node on its ports.
pub type Runner = jetlink_mavlink::runner::Runner<'static, N, PORTS, Chosen>;

/// Most records that are stored, by this image or another one: of the node, of engines and what is attached to each, and of signing, which an
/// image with USB may have stored.
const RECORDS: usize = {
    let own = 1 + N * (1 + ANY as usize) + 1;
    if own > KEYS { own } else { KEYS }
};

/// Where settings are stored.
type Store = jetlink_mavlink::store::Store<'static, Storage, RECORDS>;

/// Whether all engines are known to be at rest: what the store checks before it erases.
static AT_REST: AtRest = AtRest::new();

/// The settings that the node starts with, and where they are stored.
pub struct Settings {
    node: NodeSettings,
    /// Ids and rate of the telemetry port in force: as stored, or in flight as before the reset.
    identity: Identity,
    /// Of each engine, with what is stored.
    pub engines: [EngineConfig; N],
    own: [EngineSettings; N],
    /// What of it does not fit the engine's line.
    not_used: [Option<NotUsed>; N],
    /// What the engines are wired to from the next start on: as it is stored.
    wiring: wiring::All,
    /// What they were wired to before the reset, in flight: that stays.
    in_flight: Option<wiring::All>,
    /// The engine that cannot be wired as it is stored.
    contradiction: Option<WiringError>,
    /// Of radio control and outputs.
    pub attached: attached::Settings,
    /// Key and last time stamp.
    #[cfg(feature = "usb")]
    signing: Option<SigningState>,
    store: Option<&'static mut Store>,
    found: Found,
    /// What is stored is damaged, or nothing is stored, and these are from before the reset.
    retained: bool,
}

impl Settings {
    /// As in `src/config.rs`, and none are stored.
    #[inline(never)]
    pub fn new() -> Self {
        Self {
            node: NODE,
            identity: NODE.identity,
            engines: ENGINES,
            own: MAVLINK_ENGINES,
            not_used: [None; N],
            wiring: wiring::IMAGE,
            in_flight: wiring::in_flight(),
            contradiction: None,
            attached: attached::Settings::new(),
            #[cfg(feature = "usb")]
            signing: None,
            store: None,
            found: Found::Empty,
            retained: false,
        }
    }

    /// Line of the telemetry port.
    pub const fn telemetry(&self) -> Line {
        Line { baud: self.identity.telemetry_baud.get(), ..TELEMETRY }
    }

    /// Wires the engines, before anything is known of their other settings.
    fn wire(&mut self) {
        let all = self.in_flight.as_ref().unwrap_or(&self.wiring);
        self.contradiction = wiring::wire(&mut self.engines, all).err();
    }

    /// Takes a record. That of the node comes first.
    fn apply(&mut self, key: u8, record: &[u8]) {
        #[cfg(feature = "usb")]
        if let Some(stored) = read_signing(key, record) {
            self.signing = Some(stored);
            return;
        }
        if ANY && let Some(engine) = engine_of_attached(key) {
            return self.attached.apply(engine, record);
        }
        let Some(engine) = usize::from(key).checked_sub(1) else {
            apply_to_node(&mut self.node, &mut self.wiring, record);
            return self.wire();
        };
        let places = (self.engines.get_mut(engine), self.own.get_mut(engine), self.not_used.get_mut(engine));
        if let (Some(config), Some(own), Some(not_used)) = places {
            *not_used = apply_to_engine(config, own, record);
        }
    }

    /// Decides which ids are in force, and has them survive a reset.
    fn identify(&mut self) {
        let stored = self.node.identity;
        self.identity = Identity::at_start(stored, IDENTITY.get(), self.in_flight.is_some());
        let in_force = self.identity.packed();
        IDENTITY.set(in_force);
        if in_force != stored.packed() {
            defmt::warn!("MAVLink: ids and TELEM_BAUD stay as before the reset, in flight");
        }
    }
}

/// Reads the stored settings. Not inlined: reading takes much stack.
#[inline(never)]
pub fn load(settings: &mut Settings) {
    static STORE: StaticCell<Store> = StaticCell::new();
    settings.wire();
    let (store, found) = match board::storage() {
        Ok(storage) => {
            // It waits for nothing: only writes and erases do.
            let apply = &mut |key, record: &[u8]| settings.apply(key, record);
            let (store, found) = block_on(Store::load(storage, &AT_REST, apply));
            (Some(STORE.init(store)), found)
        }
        Err(found) => (None, found),
    };
    let stores = store.is_some();
    // Damaged: what is left of them may not be what anybody has chosen.
    if found == Found::Damaged || !stores {
        *settings = Settings::new();
        settings.wire();
        settings.retained =
            SETTINGS.load(fingerprint(&DEFAULTS), &mut |key, record| settings.apply(key, record));
    }
    match (found, settings.retained) {
        (Found::Whole, _) => defmt::info!("settings: loaded from storage"),
        (Found::Empty, true) => {
            defmt::info!("settings: no storage on this board, using the values retained over the reset")
        }
        (Found::Empty, false) if stores => defmt::info!("settings: none stored, using defaults"),
        (Found::Empty, false) => defmt::info!("settings: no storage on this board, using defaults"),
        (Found::Damaged, true) => {
            defmt::error!("settings: DAMAGED, using the values retained over the reset")
        }
        (Found::Damaged, false) => defmt::error!("settings: DAMAGED, using defaults"),
    }
    if let Some(error) = settings.contradiction {
        let engine = ENGINES[error.row].name;
        defmt::error!("{=str}: wiring as in the image, not as stored: {}", engine, error);
    }
    for (engine, not_used) in ENGINES.iter().zip(&settings.not_used) {
        if let Some(NotUsed { name, .. }) = not_used {
            defmt::error!(
                "{=str}: {=str} as in the image, not as stored: it does not fit the line",
                engine.name,
                name
            );
        }
    }
    settings.identify();
    settings.store = store;
    settings.found = found;
}

/// The service and what it stores with.
pub struct Mavlink {
    /// Runs it.
    pub runner: &'static Runner,
    #[cfg(feature = "usb")]
    node: &'static Node<N>,
    store: Option<&'static mut Store>,
}

/// Builds the service. Not inlined: it is built on the stack, and `main` never returns its stack.
#[inline(never)]
#[expect(clippy::disallowed_methods, reason = "the service begins now")]
pub fn build(node: &'static Node<N>, settings: &mut Settings, radio: Option<&'static Radio>) -> Mavlink {
    static RUNNER: StaticCell<Runner> = StaticCell::new();
    #[cfg(feature = "usb")]
    let signing = signing(settings.signing.clone());
    #[cfg(not(feature = "usb"))]
    let signing = SigningState::NONE;
    let line = settings.telemetry();
    let store = settings.store.take();
    let Settings { node: of_node, identity, engines, own, not_used, wiring, contradiction, attached, .. } =
        settings;
    let (found, retained) = (settings.found, settings.retained);
    let owners = node.owners().into_iter();
    let engines = owners.zip(engines).zip(own).map(|((owner, config), settings)| EngineParts {
        source: defmt::unwrap!(owner.source(Origin::Mavlink)),
        setup: owner.setup(),
        config: *config,
        settings: *settings,
    });
    node.set_settings_damaged(found == Found::Damaged);
    let ports = [PortConfig::uart(line.baud), PortConfig::usb()].into_iter().take(PORTS);
    let now = embassy_time::Instant::now();
    let runner = RUNNER.init_with(|| {
        let attached = With::<ANY>::attach(radio, attached);
        let mut service = Service::with(now, *of_node, signing, engines, ports, attached);
        service.set_parameter_storage(if store.is_some() {
            ParameterStorage::Stored
        } else {
            ParameterStorage::Lost
        });
        service.set_identity(now, *identity);
        not_used.iter().enumerate().for_each(|(engine, setting)| service.set_not_used(engine, *setting));
        service.set_room(&DEFAULTS);
        service.set_damaged(found == Found::Damaged);
        service.set_wiring(wiring, const { &wiring::IMAGE }, *contradiction);
        if retained && found == Found::Damaged {
            service.set_retained();
        }
        if PORTS > USB_PORT {
            // Until somebody opens it.
            service.set_open(now, USB_PORT, false);
        }
        Runner::new(service)
    });
    Mavlink {
        runner,
        #[cfg(feature = "usb")]
        node,
        store,
    }
}

/// The key and its last time stamp, as a reset leaves them, or as they are stored.
#[cfg(feature = "usb")]
fn signing(stored: Option<SigningState>) -> SigningState {
    let state = SigningState::at_start(board::key::KEY.load(), stored);
    if state.key().is_some() {
        defmt::info!("MAVLink: signing key present");
    }
    state
}

/// Time between two looks at what of signing has to survive a reset.
#[cfg(feature = "usb")]
const RETAIN_EVERY: embassy_time::Duration = embassy_time::Duration::from_millis(100);

/// Serves the telemetry port and stores settings, until a restart is commanded.
pub async fn serve(mavlink: Mavlink, port: EcuPort) {
    let Mavlink { runner, store, .. } = mavlink;
    let mut system = None;
    #[cfg(feature = "usb")]
    let mut retain_at = embassy_time::Instant::MIN;
    // Number of settings that were set when those in RAM were stored last, and the id that was learnt.
    let mut retained = None;
    let fingerprint = fingerprint(&DEFAULTS);
    let time = runner.keep_time(|_now, service| {
        let set = Some((service.counters().parameters_set, service.settings().identity.learnt));
        // Only what is settled: a change that waits for the store may yet be refused.
        if !service.is_damaged() && service.is_saved() && retained != set {
            retained = set;
            if !SETTINGS.store(fingerprint, service.changes(&DEFAULTS)) {
                defmt::info!("settings: RAM has no space to retain all changes over a reset");
            }
        }
        #[cfg(feature = "usb")]
        if _now >= retain_at {
            retain_at = _now + RETAIN_EVERY;
            board::key::KEY.store(&service.signing(_now));
        }
        #[cfg(feature = "usb")]
        mavlink.node.set_settings_damaged(service.has_to_be_confirmed());
        if service.system_id() != system {
            system = service.system_id();
            // Learnt: from now on in force.
            IDENTITY.set(service.identity().packed());
            if let Some(system) = system {
                defmt::info!("MAVLink: the vehicle is system {=u8}", system);
            }
        }
    });
    let save = async {
        match store {
            Some(store) => runner.store_settings(store, &AT_REST).await,
            None => core::future::pending().await,
        }
    };
    let work = select(runner.serve(TELEMETRY_PORT, port.rx, port.tx), save);
    if let Either::First(Request::Reboot) = select(time, work).await {
        board::leave(|| defmt::info!("MAVLink: restarting on command"));
    }
}
