//! What the engines are wired to: as in the table of `src/config.rs`, or as it is stored. Never changed in flight.

use crate::board::engines::{POWER, RETAINED, WIRING};
use crate::board::{PORTS, TWO_STOP_BITS};
use jetlink::config::EngineConfig;
use jetlink::engine::retained::{Reset, RetainedMemory, RetainedState};
use jetlink::wiring::{Ports, Wiring, WiringError, check};
use jetlink_fw::config::{ENGINES, RADIO};
use jetlink_rc::outputs::Before;

/// Number of engines of this node.
const N: usize = ENGINES.len();

/// Ports that an engine or a receiver may be on: with the feature play-ecu, all but the last.
pub const FOR_USE: usize = PORTS.len() - cfg!(feature = "play-ecu") as usize;

/// Those that are left to engines.
const LEFT: Ports = Ports {
    count: FOR_USE as u8,
    taken: match &RADIO {
        Some(radio) => radio.uart(),
        None => None,
    },
    two_stop_bits: TWO_STOP_BITS,
};

/// What each engine is wired to.
pub type All = [Wiring; N];

/// As in the table of engines.
pub const IMAGE: All = {
    let mut all = [Wiring::of(&ENGINES[0]); N];
    let mut engine = 0;
    while engine < N {
        all[engine] = Wiring::of(&ENGINES[engine]);
        engine += 1;
    }
    all
};

/// Wires the engines, whose other settings are those of the table, and has it survive a reset.
///
/// # Errors
/// The first engine that cannot have it. Then all are wired as in the table.
pub fn wire(engines: &mut [EngineConfig; N], all: &All) -> Result<(), WiringError> {
    *engines = ENGINES;
    engines.iter_mut().zip(all).for_each(|(engine, wiring)| wiring.apply(engine));
    let checked = check(engines, LEFT);
    let mut in_force = all;
    if checked.is_err() {
        *engines = ENGINES;
        in_force = &IMAGE;
    }
    for (wiring, word) in in_force.iter().zip(&WIRING) {
        word.set(wiring.packed());
    }
    checked
}

/// What was in force before the reset, if RAM has all of it.
pub fn retained() -> Option<All> {
    let mut all = IMAGE;
    for (wiring, word) in all.iter_mut().zip(&WIRING) {
        *wiring = Wiring::unpacked(word.get()?)?;
    }
    Some(all)
}

/// The record of an engine that was wired in this way.
pub fn record(engine: usize, all: &All, reset: Reset) -> Option<RetainedState> {
    let config = config(engine, all)?;
    RETAINED.0.get(usize::from(config.port))?.load(config.fingerprint(), reset)
}

/// Whether the starter and ignition of an engine that was wired in this way had power; `None`: it is not known.
pub fn power(engine: usize, all: &All) -> Option<bool> {
    Before::power(config(engine, all)?.fingerprint(), POWER.get(engine)?.get())
}

/// Has the power of an engine's starter and ignition survive a reset.
pub fn retain_power(engine: usize, power: bool) {
    let wired = retained().unwrap_or(IMAGE);
    if let (Some(config), Some(word)) = (config(engine, &wired), POWER.get(engine)) {
        word.set(Before::number(config.fingerprint(), power));
    }
}

fn config(engine: usize, all: &All) -> Option<EngineConfig> {
    let mut config = *ENGINES.get(engine)?;
    all.get(engine)?.apply(&mut config);
    Some(config)
}

/// What was in force before the reset, where an engine was not at rest then: it stays, whatever is stored, as the other end of the wire is
/// still the same.
pub fn in_flight() -> Option<All> {
    let flies =
        |wiring: &Wiring| RETAINED.0.get(usize::from(wiring.port)).is_some_and(RetainedMemory::was_in_flight);
    retained().filter(|all| all.iter().any(flies))
}
