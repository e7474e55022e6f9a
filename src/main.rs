//! The firmware `jetlink-fw`. Build it for a board: `cargo fw board-matek-h743`.
//!
//! On the host this is a stub, so that builds of the workspace with any set of features go through.
#![cfg_attr(target_os = "none", no_std, no_main)]
#![deny(missing_docs)]

#[cfg(target_os = "none")]
mod attached;
#[cfg(target_os = "none")]
mod board;
#[cfg(all(target_os = "none", feature = "demo"))]
mod demo;
#[cfg(target_os = "none")]
mod firmware;
#[cfg(target_os = "none")]
mod mavlink;
#[cfg(target_os = "none")]
mod outputs;
#[cfg(all(target_os = "none", any(feature = "demo", feature = "trial")))]
mod pilot;
#[cfg(all(target_os = "none", feature = "play-ecu"))]
mod play_ecu;
#[cfg(target_os = "none")]
mod radio;
#[cfg(all(target_os = "none", feature = "trial"))]
mod trial;
#[cfg(all(target_os = "none", feature = "usb"))]
mod usb;
#[cfg(target_os = "none")]
mod wiring;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("This is firmware for a board. Build it with: cargo fw board-matek-h743");
    std::process::exit(1);
}
