//! Compares the emulator's own copy of the boards with the project's table in `boards/`: a mistake in one of them shows.

use boards::Level;
use emulation::board::{Before, Part, Pin};
use emulation::{BOARDS, Image};

#[test]
fn the_command_line_lists_every_image() {
    let names = Image::ALL.map(|image| image.feature().unwrap_or(commands::emu::RELEASE));
    assert_eq!(names, commands::emu::IMAGES);
}

#[test]
fn the_emulators_boards_equal_those_of_the_table() {
    let names = |port: &emulation::board::Port| {
        let pin = |pin: Pin| format!("P{}{}", pin.port, pin.number);
        let name = port.name.to_string();
        (name, format!("{:?}", port.uart).to_uppercase(), pin(port.rx), pin(port.tx), port.before)
    };
    let same = |port: &boards::Port| {
        let before = match port.before {
            boards::Before::Floats => Before::Floats,
            boards::Before::DrivenLow => Before::Low,
            boards::Before::Listens => Before::Own,
        };
        (port.name.to_string(), port.uart.to_string(), port.rx.to_string(), port.tx.to_string(), before)
    };
    assert_eq!(BOARDS.map(|board| board.name), boards::BOARDS.map(|board| board.name));
    for (here, table) in BOARDS.iter().zip(boards::BOARDS) {
        let name = here.name;
        assert_eq!(here.title, table.title);
        let part = match here.part {
            Part::H743 => "STM32H743",
            Part::F427 => "STM32F427",
        };
        assert_eq!(part, table.chip.name, "{name}");
        assert_eq!(here.is_first_of_its_part(), table.is_first_of_its_chip(), "{name}");
        assert_eq!(here.crystal, u64::from(table.clock.mhz()) * 1_000_000, "{name}");
        assert_eq!(here.bypass, matches!(table.clock, boards::Clock::External(_)), "{name}");
        let ports: Vec<_> = here.ports.iter().map(names).collect();
        assert_eq!(ports, table.ports.iter().map(same).collect::<Vec<_>>(), "{name}");
        assert_eq!(names(&here.telemetry), same(&table.telemetry), "{name}");
        assert_eq!(here.radio, table.ports[usize::from(table.radio)].name, "{name}");
        assert_eq!(here.inverts, table.chip.family.inverts(), "{name}");

        let socket = here.socket.map(|socket| {
            let (name, uart, rx, tx, _) = names(&socket.port);
            let inverter = format!("P{}{}", socket.inverter.0, socket.inverter.1);
            (name, uart, rx, tx, inverter, socket.inverts_at)
        });
        let in_table = table.socket.map(|socket| {
            let boards::Socket { name, uart, rx, never_driven, inverter, inverts_at, .. } = socket;
            let [name, uart, rx, tx, inverter] =
                [name, uart, rx, never_driven.pin, inverter].map(str::to_string);
            (name, uart, rx, tx, inverter, inverts_at == Level::High)
        });
        assert_eq!(socket, in_table, "{name}");

        let fram = here.fram.map(|fram| {
            let pins = fram.pins.map(|pin| format!("P{}{}", pin.port, pin.number));
            ("SPI2", pins, format!("P{}{}", fram.select.0, fram.select.1))
        });
        let in_table = table.fram.map(|fram| {
            (fram.spi, [fram.sck, fram.miso, fram.mosi].map(str::to_string), fram.select.to_string())
        });
        assert_eq!(fram, in_table, "{name}");

        let pin = |(port, number, level): (char, u8, bool)| (format!("P{port}{number}"), level);
        let high = |level| level == Level::High;
        let led = (pin((here.led.pin.0, here.led.pin.1, here.led.lit)), here.led.open_drain);
        let in_table = ((table.led.pin.to_string(), high(table.led.lit)), table.led.open_drain);
        assert_eq!(led, in_table, "{name}");
        let outputs: Vec<_> = here
            .outputs
            .iter()
            .map(|output| (format!("P{}{}", output.pin.0, output.pin.1), output.low_before))
            .collect();
        let in_table: Vec<_> =
            table.outputs.iter().map(|output| (output.pin.to_string(), output.low_before)).collect();
        assert_eq!(outputs, in_table, "{name}");
        let inputs = here.inputs.map(|inputs| {
            let pins = inputs.pins.map(|pin| format!("P{}{}", pin.port, pin.number));
            (format!("{:?}", inputs.timer).to_uppercase(), pins)
        });
        let in_table = table.pulses.map(|inputs| (inputs.timer.to_string(), inputs.pins.map(str::to_string)));
        assert_eq!(inputs, in_table, "{name}");
        let divider = here.divider.map(|divider| {
            let (port, number) = divider.pin;
            (format!("P{port}{number}"), 10 * divider.ratio)
        });
        let in_table = table.supply.map(|divider| (divider.pin.to_string(), divider.tenths));
        assert_eq!(divider, in_table, "{name}");
        let mut held: Vec<_> = here.held.iter().map(|&held| pin(held)).collect();
        let mut in_table: Vec<_> =
            table.held().map(|hold| (hold.pin.to_string(), high(hold.level))).collect();
        held.sort_unstable();
        in_table.sort_unstable();
        assert_eq!(held, in_table, "{name}");

        let end = |region: boards::Region| u64::from(region.start) + 1024 * u64::from(region.kib);
        let range = |region: boards::Region| u64::from(region.start)..end(region);
        assert_eq!(here.flash, range(table.chip.flash), "{name}");
        assert_eq!(here.ram, range(table.chip.ram), "{name}");
        assert_eq!(here.above.start, u64::from(table.chip.retained.start), "{name}");
        assert!(here.above.end >= end(table.chip.retained), "{name}");
        let behind_bootloader = table.flash(true).map(|flash| u64::from(flash.start));
        assert_eq!(here.behind_bootloader, behind_bootloader, "{name}");
    }
}
