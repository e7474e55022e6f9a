//! The inputs with all kinds of damage to their bytes; the pilot with whole engines, in virtual time; the outputs.
#![allow(clippy::disallowed_methods, reason = "a scenario keeps its own time")]

mod amt;
mod crsf;
mod edges;
mod engine;
mod engine_settings;
mod frames;
mod hand_over;
mod outputs;
#[cfg(feature = "mavlink")]
mod parameters;
mod pwm;
mod runner;
mod sbus;
mod unreadable;
mod world;
