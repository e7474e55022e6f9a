//! From power to the first reply.

use crate::support::{engines, first_byte, no_window_missed, on_all_boards, on_each_board};
use emulation::board::{Part, Pin};
use emulation::{Bench, Image, MATEK_H743, Run};
use sim::amt::AmtEcu;
use sim::ecu::{MILLIS, SECOND};
use std::sync::mpsc;

/// Standby, throttle at idle.
const STANDBY: [u8; 5] = [0xFF, 0x12, 0x20, 0x12, 0x20];

#[test]
fn the_first_frame_of_an_amt_ecu_is_answered() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release).engines().until(2 * SECOND).go();
        let left = &engines(&report)[0];
        let wire = report.wire(left.port);
        let first = wire.rx.iter().find(|rx| rx.last).expect("a frame").end;
        let reply = first_byte(&report, left.port, 0);
        assert!(reply > first, "nothing is sent before the first frame of the ECU");
        assert!(
            reply - first < 5 * MILLIS,
            "{} ns from the frame to the end of the first byte",
            reply - first
        );
        assert_eq!(wire.tx[..5].iter().map(|tx| tx.byte).collect::<Vec<_>>(), STANDBY);
        no_window_missed(&report, left);
        // The events of the ECU's first frames, in their order.
        let events: Vec<_> = report.events(left.name).into_iter().map(|(_, event)| event).collect();
        let standby = "standby, from node";
        assert_eq!(
            events,
            [
                "ECU identified the engine as olympus",
                "ECU powered up",
                standby,
                "ECU link up",
                "ECU reports standby"
            ]
        );
    });
}

#[test]
fn the_log_names_the_reset_and_every_port() {
    on_all_boards(|board| {
        let report = Run::new(board, Image::Release).engines().until(SECOND / 2).go();
        assert!(report.logs[0].text.ends_with("last reset: power-on"), "{:?}", report.logs[0]);
        for (number, port) in board.ports.iter().enumerate() {
            let uart = format!("{:?}", port.uart).to_uppercase();
            assert!(
                report.logged(&format!("port {number}, {}, {uart}, ", port.name)),
                "{}",
                report.log_text()
            );
        }
        for engine in engines(&report) {
            let line = format!(
                ": {}, {} baud, 8N{}",
                engine.name,
                engine.line.baud,
                engine.line.bits_per_byte() - 9
            );
            assert!(report.logged(&line), "{line}\n{}", report.log_text());
        }
    });
}

#[test]
fn the_clock_is_right() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release).engines().until(4 * SECOND).go();
        let seconds: Vec<_> = report.lines("left: link").map(|log| log.at).collect();
        assert_eq!(seconds.len(), 3);
        for pair in seconds.windows(2) {
            // The firmware wakes at the tick and then logs: some instructions later, or after those of a MAVLink frame.
            assert!((pair[1] - pair[0]).abs_diff(SECOND) < 200_000, "{seconds:?}");
        }
        // 125 ms by the ECU's own clock, from frame to frame; and the firmware's ticker agrees.
        assert!(report.ecu::<AmtEcu>("SERIAL2").stats.frames.total() >= 27);
    });
}

/// The LED lights as specified, and the firmware drives the required pins.
#[test]
fn led_and_held_pins_are_driven() {
    on_all_boards(|board| {
        let (sender, receiver) = mpsc::channel();
        let look = move |bench: &mut Bench<'_>| {
            // The mode and the level of a pin, and whether it is open drain.
            let mut pin = |port: char, number: u8| {
                let gpio = board.gpio + 0x400 * u64::from(port as u8 - b'A');
                let [mode, kind, output] =
                    [0x00, 0x04, 0x14].map(|at| bench.register(gpio + at).expect("a register"));
                (mode >> (2 * number) & 3, output >> number & 1 == 1, kind >> number & 1 == 1)
            };
            let held: Vec<_> = board.held.iter().map(|&(port, number, _)| pin(port, number)).collect();
            sender.send((pin(board.led.pin.0, board.led.pin.1), held)).expect("the test waits");
        };
        let again = look.clone();
        // One flash of 50 ms each second.
        let run = Run::new(board, Image::Release).engines().at(900 * MILLIS, look);
        run.at(1030 * MILLIS, again).until(1100 * MILLIS).go();
        let (lit, open_drain) = (board.led.lit, board.led.open_drain);
        let held: Vec<_> = board.held.iter().map(|&(_, _, level)| (1, level, false)).collect();
        for level in [!lit, lit] {
            assert_eq!(receiver.recv(), Ok(((1, level, open_drain), held.clone())), "{}", board.name);
        }
    });
}

#[test]
fn the_oscillator_is_bypassed_where_a_clock_comes_in_place_of_a_crystal() {
    on_all_boards(|board| {
        let (sender, receiver) = mpsc::channel();
        let look = move |bench: &mut Bench<'_>| {
            sender.send(bench.register(board.clock_control)).expect("the test waits");
        };
        Run::new(board, Image::Release).engines().at(SECOND / 2, look).until(SECOND / 2 + 1).go();
        // HSEBYP, HSERDY, HSEON.
        let control = receiver.recv().expect("the run came by").map(|word| word >> 16 & 7);
        assert_eq!(control, Some(if board.bypass { 0b111 } else { 0b011 }), "{}", board.name);
    });
}

#[test]
fn the_flash_has_its_wait_states_and_its_accelerator() {
    on_each_board(|board| {
        let (sender, receiver) = mpsc::channel();
        let flash = match board.part {
            Part::H743 => 0x5200_2000,
            Part::F427 => 0x4002_3C00,
        };
        let look = move |bench: &mut Bench<'_>| sender.send(bench.register(flash)).expect("the test waits");
        Run::new(board, Image::Release).engines().at(SECOND / 2, look).until(SECOND).go();
        let flash = receiver.recv().expect("the run came by");
        match board.part {
            // Five wait states; PRFTEN, ICEN, DCEN.
            Part::F427 => assert_eq!(flash, Some(0x705)),
            // Two wait states at 200 MHz (WRHIGHFREQ 2). The instruction cache is in the core, where a test cannot see it.
            Part::H743 => assert_eq!(flash.map(|word| word & 0x3F), Some(0x22)),
        }
    });
}

/// Before the RAM is initialised, each TX rests high. Also, how long it stays low when its port is opened: from the
/// alternate function on, until the UART drives it.
#[test]
fn tx_is_pulled_up_first_of_all() {
    on_all_boards(|board| {
        let gpio = |pin: Pin| board.gpio + 0x400 * u64::from(pin.port as u8 - b'A');
        let (control, enabled) = match board.part {
            Part::H743 => (0x00, 1 << 3 | 1),
            Part::F427 => (0x0C, 1 << 3 | 1 << 13),
        };
        let image = if board.is_first_of_its_part() { Image::AllPorts } else { Image::Release };
        let mut run = Run::new(board, image).engines().watch("__pre_init_end").until(SECOND);
        for letter in 0..5 {
            run = run.record(board.gpio + 0x400 * letter).record(board.gpio + 0x400 * letter + 0x0C);
        }
        for port in board.ports {
            run = run.record(port.registers() + control);
        }
        let report = run.go();
        let first = |register: u64, is: &dyn Fn(u64) -> bool| {
            report
                .written
                .iter()
                .find(|write| write.register == register && is(write.value))
                .map(|write| write.at)
        };
        let [(before_ram, _)] = report.passed[..] else { panic!("{}: {:?}", board.name, report.passed) };
        for port in board.ports {
            for pin in [port.rx, port.tx] {
                let field = |word: u64| word >> (2 * pin.number) & 3;
                let pulled = first(gpio(pin) + 0x0C, &|word| field(word) == 1);
                let input = first(gpio(pin), &|word| field(word) == 0);
                assert!(pulled.is_some_and(|at| at < before_ram), "{} {}: {pulled:?}", board.name, port.name);
                assert!(input.is_some_and(|at| at < before_ram), "{} {}: {input:?}", board.name, port.name);
            }
            let field = |word: u64| word >> (2 * port.tx.number) & 3;
            let pulled = first(gpio(port.tx) + 0x0C, &|word| field(word) == 1);
            if !engines(&report).iter().any(|engine| engine.port == port.name) {
                continue; // it stays closed
            }
            let driven = first(gpio(port.tx), &|word| field(word) == 2).expect("an alternate function");
            let open = first(port.registers() + control, &|word| word & enabled == enabled).expect("a UART");
            println!(
                "{} {}: pulled up at {pulled:?} ns, low for {} ns",
                board.name,
                port.name,
                open - driven
            );
            assert!(open > driven && open - driven < 20_000, "{} {}", board.name, port.name);
        }
    });
}

/// ES0392, "Reading from AXI SRAM may lead to data read corruption", on revision Y: READ_ISS_OVERRIDE of AXI_TARG7_FN_MOD. The
/// emulated part is of revision V and reads correctly without it, so the test checks that the write comes before the RAM is
/// initialised.
#[test]
fn an_h743_reads_its_ram_one_at_a_time_from_the_first_instructions_on() {
    const AXI_TARG7_FN_MOD: u64 = 0x5100_8108;
    for image in [Image::Release, Image::Ardupilot] {
        let run = Run::new(&MATEK_H743, image).engines().record(AXI_TARG7_FN_MOD).watch("__pre_init_end");
        let report = run.until(50 * MILLIS).go();
        let [write] = &report.written[..] else { panic!("{image:?}: {:?}", report.written) };
        assert_eq!(write.value, 1, "{image:?}");
        let [(end, _)] = &report.passed[..] else { panic!("{image:?}: {:?}", report.passed) };
        assert!(write.at < *end, "{image:?}: {} {end}", write.at);
    }
}
