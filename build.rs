//! Links the firmware: gives the linker the memory map of the chosen board and the scripts of
//! cortex-m-rt and defmt. Builds for the host, and of the library alone, need nothing of this.

use std::{env, fs, path::Path};

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=memory");
    println!("cargo:rerun-if-changed=memory.x");
    let for_board = env::var("CARGO_CFG_TARGET_OS").is_ok_and(|os| os == "none");
    if !for_board || env::var_os("CARGO_FEATURE_FIRMWARE").is_none() {
        return;
    }

    // Feature `board-matek-h743` reaches us as CARGO_FEATURE_BOARD_MATEK_H743; its map is
    // memory/matek-h743.x.
    let boards: Vec<String> = env::vars()
        .filter_map(|(name, _)| {
            Some(name.strip_prefix("CARGO_FEATURE_BOARD_")?.to_lowercase().replace('_', "-"))
        })
        .collect();
    let [board] = boards.as_slice() else {
        panic!("the firmware needs exactly one board-* feature, not {boards:?}");
    };

    // memory.x in the package root includes board.x, which the linker finds in the folder added
    // here.
    let out = env::var("OUT_DIR").unwrap();
    // Behind an ArduPilot bootloader the image begins later in the flash.
    let place = if env::var_os("CARGO_FEATURE_ARDUPILOT_BOOTLOADER").is_some() { "-ardupilot" } else { "" };
    let map = format!("memory/{board}{place}.x");
    let read = |file: &str| fs::read_to_string(file).unwrap_or_else(|error| panic!("{file}: {error}"));
    fs::write(Path::new(&out).join("board.x"), read(&map) + &read("memory/kept.x")).unwrap();
    // The chip crate of an STM32 brings the names of its interrupts for cortex-m-rt's script. A board
    // without one fills its vector table by itself and needs no names.
    if env::var_os("CARGO_FEATURE_STM32").is_none() {
        fs::write(Path::new(&out).join("device.x"), "").unwrap();
    }
    println!("cargo:rustc-link-search={out}");
    // --nmagic: no padding of the image to the host's page size.
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
        println!("cargo:rustc-link-arg-examples={argument}");
    }
}
