//! The library's runners on simulated lines.
//!
//! Both are generic, so every user compiles them. They take most of the time of a simulation: here they are compiled once, and
//! optimised, so that a program around them needs no optimisation and is built in a third of the time.
#![forbid(unsafe_code)]

use jetlink::runner::{LineErrors, Runner};
use sim::any::AnyEcu;
use sim::clock;
use sim::wire::{Plug, WireRx, WireTx};
use std::pin::Pin;

/// A future that is polled only when it was woken.
pub type Task<'a> = Pin<Box<dyn Future<Output = ()> + 'a>>;

/// Runs an engine on its line, forever.
pub fn runner<'a>(runner: Runner<'a>, rx: WireRx, tx: WireTx, errors: &'a LineErrors) -> Task<'a> {
    Box::pin(clock::task(async move {
        runner.run(rx, tx, errors).await;
    }))
}

/// Moves the bytes of a line, forever.
pub fn line(plug: &Plug<AnyEcu>) -> Task<'_> {
    Box::pin(clock::task(async {
        plug.run().await;
    }))
}

/// Runs a future to completion on this thread's clock, as [`clock::run`] does.
pub fn run(future: Pin<&mut dyn Future<Output = ()>>) {
    clock::run(future);
}
