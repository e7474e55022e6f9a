//! The service with whole engines, in virtual time: the runners of the library and simulated ECUs.
#![allow(clippy::disallowed_methods, reason = "a scenario keeps its own time")]

mod arming;
mod attached;
mod commands;
#[cfg(feature = "signing")]
mod covering;
mod damaged;
mod extras;
mod fram;
mod identity;
mod mutated;
mod packets;
mod parameters;
mod repeats;
#[cfg(feature = "signing")]
mod signing;
mod store;
mod streams;
mod throttle;
mod wiring;
mod world;
