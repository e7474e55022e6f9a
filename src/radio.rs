//! A receiver of radio control on an ECU port, or on the board's socket for one. It is served in thread mode, so that no engine's task waits for it.

use crate::board;
use crate::board::receiver::ReceiverPort;
use core::cell::RefCell;
use defmt::Display2Format as Text;
use embassy_time::Instant;
use embedded_io_async::Read;
use jetlink::command::Origin;
use jetlink::config::EngineConfig;
use jetlink::node::Node;
use jetlink_fw::config::{ENGINES, RADIO};
use jetlink_rc::pilot::{Outcome, Pilot};
use jetlink_rc::reception::Unused;
use jetlink_rc::runner;
use jetlink_rc::settings::EngineSettings;
use static_cell::StaticCell;

/// Number of engines of this node.
const N: usize = ENGINES.len();

/// The receiver and its engines.
pub type Radio = RefCell<jetlink_rc::service::Service<'static, N>>;

/// Sets up radio control of all engines, if there is a receiver.
pub fn build(
    node: &'static Node<N>,
    engines: &[EngineConfig; N],
    settings: &[EngineSettings],
) -> Option<&'static Radio> {
    // Not `map`: without a receiver nothing of it is in the image.
    if RADIO.is_some() { Some(build_radio(node, engines, settings)) } else { None }
}

/// Not inlined: it is built on the stack, and `main` never returns its stack.
#[inline(never)]
fn build_radio(
    node: &'static Node<N>,
    engines: &[EngineConfig; N],
    settings: &[EngineSettings],
) -> &'static Radio {
    static SERVICE: StaticCell<Radio> = StaticCell::new();
    let radio = defmt::unwrap!(RADIO);
    let sources = node.sources(Origin::Rc).into_iter();
    let pilots = sources.zip(engines).zip(settings).map(|((source, config), settings)| {
        // The settings were checked while this was compiled, or when they were read.
        defmt::unwrap!(Pilot::new(defmt::unwrap!(source), config, *settings).ok())
    });
    SERVICE.init_with(|| RefCell::new(jetlink_rc::service::Service::new(radio.protocol.input(), pilots)))
}

/// Serves the port of the receiver.
pub async fn serve(radio: &'static Radio, port: ReceiverPort<impl Read>) -> ! {
    runner::run(radio, port.rx, port.errors, logged()).await
}

/// Serves the board's inputs for servo pulses.
pub async fn serve_pulses(radio: &'static Radio) -> ! {
    board::pulses::begin();
    runner::run_pulses(radio, board::pulses::next, logged()).await
}

/// Logs once a second how much was received, and what each engine rejected of it.
#[expect(clippy::disallowed_methods, reason = "whether the link was reported lately")]
pub fn log(radio: &Radio) {
    let service = radio.borrow();
    let reception = service.input().reception();
    match service.link_quality(Instant::now()) {
        Some(quality) => defmt::info!("radio control: {}; uplink {=u8} %", Text(&reception), quality),
        None => defmt::info!("radio control: {}", Text(&reception)),
    }
    let rests = board::pulses::rests();
    if rests != 0 {
        defmt::info!("radio control: noise on a pulse input, {=u32} times", rests);
    }
    for (pilot, engine) in service.pilots().iter().zip(&ENGINES) {
        let unused = Unused(*pilot.counters());
        if unused.is_any() {
            defmt::info!("{=str}: radio control: {}", engine.name, Text(&unused));
        }
    }
}

/// Logs what comes of frames.
fn logged() -> impl FnMut(Instant, usize, Outcome) {
    let mut received = false;
    move |_, engine, outcome| {
        if !received {
            received = true;
            defmt::info!("radio control: receiving frames");
        }
        // What becomes of a command is in the engine's events.
        let why = match outcome {
            Outcome::NotSteady => "the stick was not at idle or not steady",
            Outcome::SettingsDamaged => "the stored settings are damaged",
            _ => return,
        };
        if let Some(engine) = ENGINES.get(engine) {
            defmt::info!("{=str}: no start, {=str}", engine.name, why);
        }
    }
}
