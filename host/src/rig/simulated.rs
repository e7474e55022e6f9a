//! The simulated ECU of an engine, its line and its turbine.

use super::engines::Engine;
use sim::any::AnyEcu;
use sim::line::Line;
use sim::turbine::Parameters;

/// Obeyed commands that an ECU stores; the rig looks at the line instead.
const LOG_CAPACITY: usize = 0;

/// The ECU of this engine, not yet under power.
pub fn ecu(engine: &Engine) -> AnyEcu {
    engine.simulated().with_log(LOG_CAPACITY).ecu()
}

/// The line of this engine, in the terms of the simulation.
pub fn line(engine: &Engine) -> Line {
    sim::line_of!(engine.config.line)
}

/// The figures of this engine's turbine.
pub fn parameters(engine: &Engine) -> Parameters {
    *engine.simulated().turbine()
}
