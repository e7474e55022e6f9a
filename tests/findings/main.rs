//! A regression test for each finding that led to the rules of `docs/failsafe.md`: whole nodes against simulated ECUs,
//! judged by the frames on the wire and by the turbines. Beside each behaviour that is forbidden, a required one is
//! tested.
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
