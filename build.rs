//! Prepares the firmware for the chosen board: its part of the table (`boards/`) as typed code, the memory map, and the
//! linker scripts of cortex-m-rt and defmt. Builds for the host, and of the library alone, need nothing of this.

use boards::{Board, Clock, Family, Fram, Hold, LeftAlone, Level, Region, Socket};
use std::fmt::Write;
use std::{env, fs, path::Path};

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=memory");
    println!("cargo:rerun-if-changed=memory.x");
    let for_board = env::var("CARGO_CFG_TARGET_OS").is_ok_and(|os| os == "none");
    if !for_board || env::var_os("CARGO_FEATURE_FIRMWARE").is_none() {
        return;
    }

    // Feature `board-matek-h743` reaches us as CARGO_FEATURE_BOARD_MATEK_H743.
    let chosen: Vec<String> = env::vars()
        .filter_map(|(name, _)| {
            Some(name.strip_prefix("CARGO_FEATURE_BOARD_")?.to_lowercase().replace('_', "-"))
        })
        .collect();
    let [name] = chosen.as_slice() else {
        panic!("the firmware needs exactly one board-* feature, not {chosen:?}");
    };
    println!("cargo:rustc-check-cfg=cfg(board_divider, board_pulses, board_socket)");
    let behind_bootloader = env::var_os("CARGO_FEATURE_ARDUPILOT_BOOTLOADER").is_some();

    // memory.x in the package root includes board.x, which the linker finds in the folder added
    // here.
    let out = env::var("OUT_DIR").unwrap();
    let write = |file: &str, text: &str| fs::write(Path::new(&out).join(file), text).unwrap();
    let read = |file: &str| fs::read_to_string(file).unwrap_or_else(|error| panic!("{file}: {error}"));
    let map = match Board::by_name(name) {
        Some(board) => {
            write("board.rs", &code(board));
            let id = board.bootloader.map_or(0, |bootloader| bootloader.board_id);
            write("apj_board_id.rs", &id.to_string());
            println!("cargo:rustc-env=JETLINK_PORTS={}", board.ports.len());
            println!("cargo:rustc-env=JETLINK_RADIO_PORT={}", board.radio);
            println!("cargo:rustc-env=JETLINK_OUTPUTS={}", free_outputs(board));
            if board.outputs.iter().any(|output| output.low_before) {
                println!("cargo:rustc-env=JETLINK_OUTPUTS_LOW_BEFORE=1");
            }
            if board.pulses.is_some() {
                println!("cargo:rustc-cfg=board_pulses");
            }
            if board.socket.is_some() {
                println!("cargo:rustc-cfg=board_socket");
            }
            // Only the converter of the H7 is read (src/board/supply.rs).
            if board.supply.is_some() && board.chip.family == Family::H7 {
                println!("cargo:rustc-cfg=board_divider");
            }
            let flash = board.flash(behind_bootloader);
            map(board, flash.unwrap_or_else(|| panic!("{} has no bootloader to keep", board.title)))
        }
        // A board without an STM32 has its own files.
        None => read(&format!("memory/{name}.x")),
    };
    write("board.x", &(map + &read("memory/retained.x")));
    // The chip crate of an STM32 brings the names of its interrupts for cortex-m-rt's script. A board
    // without one fills its vector table by itself and needs no names.
    if env::var_os("CARGO_FEATURE_STM32").is_none() {
        write("device.x", "");
    }
    println!("cargo:rustc-link-search={out}");
    // --nmagic: no padding of the image to the host's page size.
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
}

/// Numbers of the outputs of a test image, two digits each: all that are not its inputs for servo pulses.
fn free_outputs(board: &Board) -> String {
    let has_pulses = env::var_os("CARGO_FEATURE_RADIO_PWM").is_some();
    let inputs = board.pulses.filter(|_| has_pulses).map_or([""; 4], |inputs| inputs.pins);
    let outputs = board.outputs.iter().enumerate().filter(|(_, output)| !inputs.contains(&output.pin));
    outputs.map(|(number, _)| format!("{number:02}")).collect()
}

/// The memory map, for the linker.
fn map(board: &Board, flash: Region) -> String {
    let line = |name: &str, Region { start, kib }: Region| {
        format!("  {name:8} : ORIGIN = {start:#010x}, LENGTH = {kib}K\n")
    };
    let lines = [("FLASH", flash), ("RAM", board.chip.ram), ("RETAINED", board.chip.retained)];
    let lines: String = lines.into_iter().map(|(name, region)| line(name, region)).collect();
    format!("/* {}, from the table in boards/. */\nMEMORY\n{{\n{lines}}}\n", board.title)
}

/// The table of the board as a call of the macro `board!` (src/board/table.rs), where names become types.
fn code(board: &Board) -> String {
    let (mhz, mode) = match board.clock {
        Clock::Crystal(mhz) => (mhz, "Oscillator"),
        Clock::External(mhz) => (mhz, "Bypass"),
    };
    // What `clocks` in src/board/stm32h7.rs and stm32f4.rs can make their PLL from.
    let step = match board.chip.family {
        Family::F4 => 1,
        Family::H7 => 8,
    };
    assert!(mhz % step == 0, "{}: {mhz} MHz is not a multiple of {step} MHz", board.title);
    let mut code = String::from("board! {\n");
    let mut line = |text: String| writeln!(code, "    {text}").unwrap();
    line(format!("name: {:?},", board.title));
    line(format!("clock: {mhz} {mode},"));
    line("ports: [".into());
    for port in board.ports {
        let [(gpio, number), (rx_gpio, rx_number)] = [port.tx, port.rx].map(|pin| {
            let (gpio, number) = place(pin);
            assert!(gpio <= "GPIOE".into(), "{pin}: only GPIO A to E have their clock early (`clock_gpio`)");
            (gpio, number)
        });
        line(format!("    {:?} {} {gpio} {number} {rx_gpio} {rx_number},", title(port), port.uart));
    }
    line("],".into());
    line(format!("telemetry: {:?},", title(&board.telemetry)));
    line(format!("inverts: {},", board.chip.family.inverts()));
    let uarts = board.ports.iter().chain([&board.telemetry]);
    let uarts = uarts.map(|port| format!("{} {} {},", port.uart, port.rx, port.tx));
    line(format!("uarts: [{}],", uarts.collect::<Vec<_>>().join(" ")));
    let outputs = board.outputs.iter().map(|output| {
        let (gpio, number) = place(output.pin);
        assert!(
            gpio <= "GPIOE".into(),
            "{}: only GPIO A to E have their clock early (`clock_gpio`)",
            output.pin
        );
        format!("{} {gpio} {number} {:?} {},", output.pin, output.label, output.low_before)
    });
    line(format!("outputs: [{}],", outputs.collect::<Vec<_>>().join(" ")));
    let pulses = board.pulses.map(|inputs| {
        let pins = inputs.pins.map(|pin| {
            let output = board.outputs.iter().position(|output| output.pin == pin);
            let output = output.unwrap_or_else(|| panic!("{pin}: servo pulses come in at outputs"));
            let (gpio, number) = place(pin);
            format!("{pin} {gpio} {number} {output},")
        });
        format!("{} {} {}", inputs.timer, inputs.interrupt, pins.join(" "))
    });
    line(format!("pulses: [{}],", pulses.unwrap_or_default()));
    let socket = board.socket.map(|socket| {
        // src/board/receiver.rs takes what it receives, and only stm32f4.rs has what that needs.
        assert!(board.chip.family == Family::F4, "{}: a socket for receivers is for an F4", board.title);
        let Socket { name, uart, rx, never_driven: LeftAlone { pin, .. }, inverter, inverts_at, .. } = socket;
        let title = format!("{name}, {uart}, for a receiver");
        format!("{title:?} {uart} {rx} {pin} {inverter} {}", level(inverts_at))
    });
    line(format!("socket: [{}],", socket.unwrap_or_default()));
    let supply = board.supply.map(|supply| format!("{} {}", supply.pin, supply.tenths));
    line(format!("supply: [{}],", supply.unwrap_or_default()));
    let fram = board.fram.map(|fram| {
        let Fram { spi, sck, miso, mosi, select } = fram;
        format!("{spi} {sck} {miso} {mosi} {select}")
    });
    line(format!("fram: [{}],", fram.unwrap_or_default()));
    line(format!("usb: {} {},", board.usb.minus, board.usb.plus));
    let mode = if board.led.open_drain { "OpenDrain" } else { "PushPull" };
    line(format!("led: {} {} {mode},", board.led.pin, level(board.led.lit)));
    let held = board.held().map(|Hold { pin, level: at, .. }| format!("{pin} {},", level(at)));
    line(format!("hold: [{}],", held.collect::<Vec<_>>().join(" ")));
    line(format!(
        "watchdog: {},",
        match board.chip.family {
            Family::F4 => "IWDG",
            Family::H7 => "IWDG1",
        }
    ));
    code + "}\n"
}

/// A port in the log.
fn title(port: &boards::Port) -> String {
    format!("{}, {}, {}", port.name, port.uart, port.label)
}

/// `PA9` as `GPIOA` and `9`.
fn place(pin: &str) -> (String, u8) {
    let port = pin.strip_prefix('P').and_then(|pin| pin.split_at_checked(1));
    let place = port.and_then(|(port, number)| Some((format!("GPIO{port}"), number.parse().ok()?)));
    place.unwrap_or_else(|| panic!("{pin} is not the name of a pin, such as PA9"))
}

fn level(level: Level) -> &'static str {
    match level {
        Level::Low => "Low",
        Level::High => "High",
    }
}
