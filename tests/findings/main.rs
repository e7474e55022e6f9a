//! A regression test for each finding that led to the rules of `docs/failsafe.md`: whole nodes against simulated ECUs,
//! judged by what went over the wire and by what the turbines did. Beside each thing that must not happen there is one
//! that must.
#![allow(clippy::disallowed_methods, reason = "a scenario keeps its own time")]

mod demands;
mod exhaust;
mod resets;
mod restart;
mod services;
mod small;
mod starts;
mod wire;
mod world;
mod zk_modes;
