//! The boards in the rest of the repository, compared with the table.

use boards::{BOARDS, Before, Board, Clock, Divider, Fram, PulseInputs, Socket, Usb};

const CARGO: &str = include_str!("../../Cargo.toml");
const README: &str = include_str!("../../README.md");
const SIZES: &str = include_str!("../../docs/size.md");
const FAULT_FORM: &str = include_str!("../../.github/ISSUE_TEMPLATE/1-fault.yml");
const DOCS: &str = include_str!("../../docs/boards.md");

/// The rows are there, one below the other.
#[track_caller]
fn has(text: &str, where_: &str, rows: &str) {
    assert!(text.contains(rows), "{where_} does not have what follows from the table in boards/:\n\n{rows}");
}

#[test]
fn each_board_has_its_feature_and_nothing_else_has_one() {
    let features: Vec<(&str, &str)> = CARGO
        .lines()
        .filter_map(|line| line.strip_prefix("board-")?.split_once(" = ["))
        .filter(|(name, _)| *name != "qemu-mps2")
        .collect();
    let mut names: Vec<&str> = features.iter().map(|(name, _)| *name).collect();
    let mut expected = BOARDS.map(|board| board.name);
    names.sort_unstable();
    expected.sort_unstable();
    assert_eq!(names, expected, "the features board-* of Cargo.toml");
    for (name, enables) in features {
        let chip = Board::by_name(name).expect("compared above").chip;
        let family = format!("\"stm32{:?}\"", chip.family).to_lowercase();
        assert!(enables.contains(&family), "board-{name} = [{enables} lacks {family}");
        let embassy = format!("\"embassy-stm32/{}\"", chip.feature);
        assert!(enables.contains(&embassy), "board-{name} = [{enables} lacks {embassy}");
        let fram = Board::by_name(name).expect("compared above").fram.is_some();
        assert_eq!(enables.contains("\"fram\""), fram, "board-{name} = [{enables}: fram");
    }
}

#[test]
fn names_ports_and_pins_are_there_once() {
    for (i, board) in BOARDS.iter().enumerate() {
        assert!(BOARDS[..i].iter().all(|other| other.name != board.name && other.title != board.title));
        let ports: Vec<_> = board.ports.iter().chain([&board.telemetry]).collect();
        let unique = |what: &str, mut all: Vec<&str>| {
            let count = all.len();
            all.sort_unstable();
            all.dedup();
            assert_eq!(all.len(), count, "{}: {what}", board.name);
        };
        let socket = board.socket.iter();
        let names = ports.iter().map(|port| port.name).chain(socket.clone().map(|socket| socket.name));
        unique("names", names.collect());
        let uarts = ports.iter().map(|port| port.uart).chain(socket.clone().map(|socket| socket.uart));
        unique("UARTs", uarts.collect());
        // The one that nothing drives is among them, so nothing else of the table has it.
        let socket = socket.flat_map(|socket| [socket.rx, socket.never_driven.pin, socket.inverter]);
        let pins = ports.iter().flat_map(|port| [port.rx, port.tx]);
        let held: Vec<_> = board.held().map(|hold| hold.pin).collect();
        let outputs = board.outputs.iter().map(|output| output.pin);
        let supply = board.supply.map(|supply| supply.pin);
        let fram = board.fram.iter().flat_map(|fram| fram.pins());
        let driven = [board.led.pin].into_iter().chain(held).chain(outputs);
        let usb = [board.usb.minus, board.usb.plus];
        unique("pins", pins.chain(driven).chain(supply).chain(fram).chain(usb).chain(socket).collect());
        // src/config.rs has at most one digit for them, and for the socket behind them.
        assert!((1..=8).contains(&board.ports.len()), "{}", board.name);
        unique("outputs", board.outputs.iter().map(|output| output.label).collect());
    }
}

/// What a receiver sends must not be taken for an upload.
#[test]
fn a_receiver_is_on_an_ecu_port_where_no_bootloader_listens() {
    for board in BOARDS {
        let port = board.ports.get(usize::from(board.radio)).expect("a port");
        assert!(port.before != Before::Listens, "{}: {}", board.name, port.name);
    }
}

#[test]
fn a_board_without_a_bootloader_has_no_port_of_one() {
    for board in BOARDS.iter().filter(|board| board.bootloader.is_none()) {
        assert!(board.ports.iter().all(|port| port.before == Before::Floats), "{}", board.name);
        assert_eq!(board.flash(true), None);
    }
}

#[test]
fn retained_memory_lies_behind_the_ram() {
    for board in BOARDS {
        let (ram, retained) = (board.chip.ram, board.chip.retained);
        assert_eq!(ram.start + ram.kib * 1024, retained.start, "{}", board.name);
        let flash = board.chip.flash;
        if let Some(behind) = board.flash(true) {
            let end = behind.start + behind.kib * 1024;
            assert!(behind.start > flash.start && end <= flash.start + flash.kib * 1024, "{}", board.name);
        }
    }
}

#[test]
fn the_readme_has_every_board() {
    let mut rows = String::from("| board | chip | ECU ports | MAVLink | build | flash and run |\n");
    rows += "|---|---|---|---|---|---|\n";
    for board in BOARDS {
        let clock = match board.clock {
            Clock::Crystal(mhz) => format!("{mhz} MHz crystal"),
            Clock::External(mhz) => format!("{mhz} MHz from its ST-Link"),
        };
        rows += &format!(
            "| {} | {}, {clock} | {} | {} ({}) | `cargo fw board-{name}` | `cargo flash-{name}` |\n",
            board.title,
            board.chip.name,
            board.ports.len(),
            board.telemetry.uart,
            board.telemetry.label,
            name = board.name
        );
    }
    has(README, "README.md", &rows);
    for board in BOARDS {
        has(README, "README.md", &format!("- {}: {}", board.title, board.led.label));
        for also in board.also {
            has(README, "README.md", also);
        }
    }
}

/// The section of a board in docs/boards.md.
fn section(board: &Board) -> String {
    let mut rows = format!("### {} (`board-{}`)\n\n", board.title, board.name);
    let bootloader = board.bootloader.is_some();
    match board.bootloader {
        Some(bootloader) => {
            let flash = board.flash(true).expect("it has a bootloader");
            rows += &format!(
                "Bootloader: {}, board ID {}; the image behind it starts at {:#010x}.\n\n",
                bootloader.of, bootloader.board_id, flash.start
            );
        }
        None => rows += "It has no bootloader of its own.\n\n",
    }
    rows += "| port | name | UART | TX | RX | where |";
    rows += if bootloader { " TX in the bootloader | ECU connected then |\n" } else { "\n" };
    rows += &format!("{}|\n", "|---".repeat(if bootloader { 8 } else { 6 }));
    let ports = board.ports.iter().enumerate().map(|(i, port)| (i.to_string(), port));
    for (number, port) in ports.chain([("MAVLink".into(), &board.telemetry)]) {
        let (tx, ecu) = match port.before {
            Before::Floats => ("floats", "yes"),
            Before::DrivenLow => ("**low**", "only one that tolerates a 5 s break"),
            Before::Listens => ("high; it listens at RX", "**no**"),
        };
        let ecu = if number == "MAVLink" { "no ECU there" } else { ecu };
        rows += &format!(
            "| {number} | {} | {} | {} | {} | {} |",
            port.name, port.uart, port.tx, port.rx, port.label
        );
        rows += &if bootloader { format!(" {tx} | {ecu} |\n") } else { "\n".into() };
    }
    if let Some(Socket { name, uart, rx, never_driven, .. }) = board.socket {
        let number = board.ports.len();
        rows += &format!("| {number} | {name} | {uart} | none: {} | {rx} |", never_driven.pin);
        rows += " a receiver of radio control, nothing else |";
        rows += if bootloader { " floats | no ECU there |\n" } else { "\n" };
    }
    let radio = board.ports[usize::from(board.radio)];
    let lines = if board.chip.family.inverts() { "SBUS or CRSF" } else { "CRSF, or SBUS behind an inverter" };
    rows += "\nReceiver for radio control: ";
    if let Some(Socket { name, .. }) = board.socket {
        rows += &format!("port {}, {name} (SBUS or CRSF); or ", board.ports.len());
    }
    rows += &format!("port {}, {} ({lines}).", board.radio, radio.label);
    // The engines on ports 0 to 3 in src/config.rs.
    if let Some(engine) = ["left", "right", "centre", "booster"].get(usize::from(board.radio)) {
        rows += &format!(" **The default table of engines has `{engine}` there**");
        rows += if board.ports.len() > 4 { ": give it port 4, or" } else { ", and no port is free:" };
        rows += " remove its row ([how](rc.md#on-a-board)).";
    }
    rows += "\n";
    if let Some(Socket { name, uart, never_driven, inverter, inverts_at, signal, .. }) = board.socket {
        let level = format!("{inverts_at:?}").to_lowercase();
        rows += &format!(
            "\nThe inverter of {name}: {inverter} ({signal}), {level} inverts. It is driven only with a receiver there. "
        );
        rows += &format!("{}, TX of {uart}, is never driven: {}.\n", never_driven.pin, never_driven.why);
    }
    rows += &outputs(board);
    if let Some(PulseInputs { timer, pins, .. }) = board.pulses {
        let pads = pins.map(|pin| board.outputs.iter().find(|output| output.pin == pin).unwrap().label);
        rows += &format!(
            "\nServo pulses, channels 1 to 4 ({timer}), in place of these outputs: {}.\n",
            pads.join(", ")
        );
    }
    if let Some(Divider { pin, tenths, label }) = board.supply {
        let (whole, tenth) = (tenths / 10, tenths % 10);
        rows +=
            &format!("\nSupply voltage for ECUs that report none: {label}, {whole}.{tenth}:1 at {pin}.\n");
    }
    if let Some(fram) = board.fram {
        let Fram { spi, sck, miso, mosi, select } = fram;
        rows += &format!(
            "\nSettings: in its F-RAM, on {spi} (SCK {sck}, MISO {miso}, MOSI {mosi}), selected by {select}.\n"
        );
    }
    let Usb { minus, plus, label } = board.usb;
    rows += &format!("\nUSB, with the feature `usb`: {label} (D- {minus}, D+ {plus}).\n");
    if board.held().next().is_some() {
        rows += "\nDriven from the start:\n\n";
        for hold in board.held() {
            let level = format!("{:?}", hold.level).to_lowercase();
            rows += &format!("- {} {level}: {}\n", hold.pin, hold.why);
        }
    }
    rows
}

/// The outputs of a board in docs/boards.md.
fn outputs(board: &Board) -> String {
    if board.outputs.is_empty() {
        return "\nOutputs for valves and power: none.\n".into();
    }
    let low = board.outputs.iter().filter(|output| output.low_before).count();
    assert!(low == 0 || low == board.outputs.len(), "{}: one sentence describes all", board.name);
    let before = match (board.bootloader, low) {
        (None, _) => "float until the firmware drives them",
        (Some(_), 0) => "float in the bootloader",
        (Some(_), _) => "are driven **low** in the bootloader",
    };
    let list: Vec<_> = board
        .outputs
        .iter()
        .enumerate()
        .map(|(number, output)| format!("{number} {} ({})", output.label, output.pin))
        .collect();
    format!("\nOutputs for valves and power, which {before}: {}.\n", list.join(", "))
}

#[test]
fn the_docs_have_every_port() {
    for board in BOARDS {
        has(DOCS, "docs/boards.md", &section(board));
    }
}

#[test]
fn the_page_of_sizes_and_the_issue_form_have_every_board() {
    for board in BOARDS {
        has(SIZES, "docs/size.md (.ci/size --record)", &format!("\n| {} |", board.name));
        has(FAULT_FORM, ".github/ISSUE_TEMPLATE/1-fault.yml", &format!("\n        - {}\n", board.title));
    }
}
