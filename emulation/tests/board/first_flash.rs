//! The expectations of docs/first-flash.md, measured: what a person should find with a logic analyser and the log. Printed
//! as the table of that page, and kept beside the images.

use crate::support::{Led, crash, engines, first_byte, on_each_board};
use emulation::board::{Part, Pin};
use emulation::engines::Protocol;
use emulation::{Board, Bootloader, Image, Jump, Report, Run, bootloader, turnaround};
use sim::ecu::{Ecu, LineFault, MILLIS, Nanos, SECOND};
use sim::line::Line;
use sim::zk::ZkEcu;
use std::collections::BTreeMap;
use std::sync::Mutex;

/// What was found on each board, by the number of its row.
type Table = Mutex<BTreeMap<usize, (String, BTreeMap<&'static str, String>)>>;

/// A time with three digits.
fn time(ns: Nanos) -> String {
    let (value, unit) = match ns {
        0..1_000 => (ns as f64, "ns"),
        1_000..1_000_000 => (ns as f64 / 1e3, "µs"),
        1_000_000..1_000_000_000 => (ns as f64 / 1e6, "ms"),
        _ => (ns as f64 / 1e9, "s"),
    };
    let digits = if value < 10.0 {
        2
    } else if value < 100.0 {
        1
    } else {
        0
    };
    format!("{value:.digits$} {unit}")
}

fn span(values: impl IntoIterator<Item = Nanos>) -> String {
    let mut values: Vec<_> = values.into_iter().collect();
    values.sort_unstable();
    let [first, .., last] = values[..] else { panic!("too few: {values:?}") };
    if time(first) == time(last) { time(first) } else { format!("{} to {}", time(first), time(last)) }
}

fn gpio(board: &Board, pin: Pin) -> u64 {
    board.gpio + 0x400 * u64::from(pin.port as u8 - b'A')
}

/// A serial adapter on the bench, which sends the same bytes over and over; it does not listen.
#[derive(Debug)]
struct Adapter {
    next: Nanos,
    bytes: &'static [u8],
}

impl Ecu for Adapter {
    fn next_wake(&self) -> Nanos {
        self.next
    }

    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>) {
        if now >= self.next {
            self.next = now + SECOND / 8;
            tx.extend(self.bytes);
        }
    }

    fn heard(&mut self, _: Nanos, _: Result<u8, LineFault>) {}

    fn power(&mut self, _: Nanos, _: bool) {}
}

/// An AMT set of an engine in standby, as docs/first-flash.md has it.
const AMT_SET: [u8; 6] = [0xFF, 0x02, 0x00, 0x0E, 0x00, 0x00];
/// Its reply: standby, throttle at idle.
const STANDBY: [u8; 5] = [0xFF, 0x12, 0x20, 0x12, 0x20];

/// A start from power-on, with everything that hangs on it.
fn start(board: &'static Board) -> Report {
    let mut run = Run::new(board, Image::Release).engines().tap("SERIAL2").until(8 * SECOND);
    for letter in 0..5 {
        let port = board.gpio + 0x400 * letter;
        run = run.record(port).record(port + 0x0C).record(port + 0x18);
    }
    for port in board.ports {
        run = run.record(port.registers() + control(board).0);
    }
    run.go()
}

/// The register that enables a UART, and its bits for that.
fn control(board: &Board) -> (u64, u64) {
    match board.part {
        Part::H743 => (0x00, 1 << 3 | 1),
        Part::F427 => (0x0C, 1 << 3 | 1 << 13),
    }
}

/// When the firmware said hello.
fn hellos(report: &Report) -> Vec<(Nanos, &str)> {
    let hello = |log: &'_ emulation::Log| log.at;
    report
        .lines("last reset: ")
        .map(|log| (hello(log), log.text.rsplit(' ').next().expect("a cause")))
        .collect()
}

#[test]
fn the_expectations_of_the_first_flash() {
    let table = Table::default();
    on_each_board(|board| {
        let row = |number: usize, what: &str, found: String| {
            let mut table = table.lock().expect("no test has failed");
            table
                .entry(number)
                .or_insert_with(|| (what.to_string(), BTreeMap::new()))
                .1
                .insert(board.name, found);
        };
        let report = start(board);
        let led = Led::of(board);
        let written = |register: u64, is: &dyn Fn(u64) -> bool| {
            let mut writes = report.written.iter().filter(|write| write.register == register);
            writes.find(|write| is(write.value)).map(|write| write.at).expect("a write")
        };

        // The start.
        let (enable, enabled) = control(board);
        let wired: Vec<_> =
            board.ports.iter().filter(|port| report.wires().any(|(name, _)| name == port.name)).collect();
        let field = |pin: Pin, word: u64| word >> (2 * pin.number) & 3;
        let pulled = board
            .ports
            .iter()
            .map(|port| written(gpio(board, port.tx) + 0x0C, &|word| field(port.tx, word) == 1));
        let low = wired.iter().map(|port| {
            let driven = written(gpio(board, port.tx), &|word| field(port.tx, word) == 2);
            written(port.registers() + enable, &|word| word & enabled == enabled) - driven
        });
        row(1, "power or reset to all TX pulled up", time(pulled.max().expect("ports")));
        row(2, "TX low while its port is opened", span(low));
        let (hello, cause) = hellos(&report)[0];
        row(3, "power to the first log line", format!("{}, `last reset: {cause}`", time(hello)));
        let (lit, dark) = (led.lit(&report), led.dark(&report));
        row(4, "power to the first flash of the LED", time(lit[0]));
        let off = dark.iter().find(|at| **at > lit[0]).expect("it goes out");
        row(
            5,
            "flashes: length, distance",
            format!("{}, {}", time(off - lit[0]), span(lit[4..].windows(2).map(|two| two[1] - two[0]))),
        );

        // The lines.
        let mut number = 6;
        for engine in engines(&report).into_iter().filter(|engine| engine.name != "right") {
            let wire = report.wire(engine.port);
            let byte = board.port(engine.port).byte_ns(wire.line());
            let gaps = wire
                .tx
                .windows(2)
                .map(|pair| pair[1].end - pair[0].end)
                .filter(|gap| (*gap as f64) < 1.5 * byte);
            let baud = engine.line.baud;
            row(number, &format!("{baud} baud: one byte, TX"), span(gaps.collect::<Vec<_>>()));
            number += 1;
            match engine.protocol {
                Protocol::Amt(_) => {
                    let replies = turnaround::of(&report, engine.port);
                    row(
                        number,
                        "AMT: last stop bit of a frame to the start bit of the reply",
                        span(replies.iter().map(|each| each.ns)),
                    );
                }
                Protocol::Zk(..) => {
                    let intervals = report.ecu::<ZkEcu>(engine.port).stats.intervals;
                    let ends = [intervals.min, intervals.max].map(|end| end.expect("commands"));
                    row(number, &format!("ZK on {baud} baud: command to command"), span(ends));
                }
            }
            number += 1;
        }
        assert!(number <= 12);

        // Nothing on the ports but an adapter on the first, from 2 s on.
        let nobody = || Adapter { next: Nanos::MAX, bytes: &[] };
        let report = Run::new(board, Image::Release)
            .ecu("SERIAL2", Line::n1(2400), Adapter { next: 2 * SECOND, bytes: &AMT_SET })
            .ecu("SERIAL4", Line::n1(9600), nobody())
            .ecu("SERIAL5", Line::n1(115_200), nobody())
            .record(led.register)
            .until(5 * SECOND)
            .go();
        let flashes = led.lit(&report).into_iter().filter(|at| (3 * SECOND..4 * SECOND).contains(at)).count();
        row(13, "no ECU: flashes of the LED in a second", flashes.to_string());
        for port in ["SERIAL4", "SERIAL5"] {
            let sent = &report.wire(port).tx;
            let ends: Vec<_> =
                sent.chunks(4).map(|command| command[0].end).filter(|end| *end > SECOND).collect();
            let baud = report.wire(port).line().baud;
            row(
                if port == "SERIAL4" { 14 } else { 15 },
                &format!("no ECU: command to command, {baud} baud"),
                span(ends.windows(2).map(|two| two[1] - two[0])),
            );
        }
        let replies = &report.wire("SERIAL2").tx;
        assert!(replies.chunks(5).all(|reply| reply.iter().map(|tx| tx.byte).eq(STANDBY)), "{replies:?}");
        row(
            16,
            "sets of an adapter, every 125 ms: first reply after the first set, replies in 3 s",
            format!("{}, {}", time(replies[0].end - 2 * SECOND), replies.len() / 5),
        );
        row(
            17,
            "its reply: from the start bit to the last stop bit",
            time(5 * board.ports[0].byte_ns(Line::n1(2400)) as Nanos),
        );
        row(
            18,
            "`left: ECU link up` after the first set",
            time(report.when("left: ECU link up") - 2 * SECOND),
        );

        // The reset pin, with engines' ECUs connected and none running.
        let at = 3 * SECOND;
        let report = Run::new(board, Image::Release)
            .engines()
            .at(at, |bench| bench.press_reset())
            .resets(1)
            .until(5 * SECOND)
            .go();
        let (hello, cause) = hellos(&report)[1];
        row(20, "reset pin to the first log line", format!("{}, `last reset: {cause}`", time(hello - at)));
        row(
            21,
            "reset pin to the first byte, ZK on 115200 baud",
            time(first_byte(&report, "SERIAL5", at) - at),
        );
        row(
            22,
            "reset pin to the first reply, AMT (the ECU sends every 125 ms)",
            time(first_byte(&report, "SERIAL2", at) - at),
        );

        // A crash, and a task that stands still from 5 s on.
        let report = Run::new(board, Image::Release)
            .engines()
            .at(at, move |bench| crash(bench, board, Image::Release))
            .resets(1)
            .with_errors()
            .until(5 * SECOND)
            .go();
        let (reset, (hello, cause)) = (report.resets[0].0, hellos(&report)[1]);
        row(
            23,
            "a crash: reset to the first log line",
            format!("{}, `last reset: {cause}`", time(hello - reset)),
        );
        let report = Run::new(board, Image::Wedge).engines().resets(1).with_errors().until(8 * SECOND).go();
        let (reset, (hello, cause)) = (report.resets[0].0, hellos(&report)[1]);
        let stuck = report.when("its runner is stuck");
        row(
            24,
            "image `wedge`: `its runner is stuck` to the reset",
            format!("{}, then `last reset: {cause}` after {}", time(reset - stuck), time(hello - reset)),
        );

        // No crystal.
        let report = Run::new(board, Image::Release)
            .engines()
            .record(led.register)
            .at(0, |bench| bench.break_crystal())
            .with_errors()
            .until(4 * SECOND)
            .go();
        let (hello, _) = hellos(&report)[0];
        let flashes = led.lit(&report).into_iter().filter(|at| (3 * SECOND..4 * SECOND).contains(at));
        row(30, "no crystal: power to the first log line", time(hello));
        row(31, "no crystal: flashes of the LED in a second", flashes.count().to_string());

        // The bootloader, which decides as the real one does.
        let wait = bootloader::WAIT_MS * MILLIS;
        let bootloader = Bootloader { jump: Jump::New, leaves: Vec::new(), decides: true };
        let report = Run::new(board, Image::Ardupilot)
            .engines()
            .bootloader(bootloader)
            .at(wait + SECOND, |bench| bench.press_reset())
            .resets(1)
            .until(wait + 2 * SECOND)
            .go();
        let boots = hellos(&report);
        row(40, "behind a bootloader: power to the first log line", time(boots[0].0));
        row(
            41,
            "behind a bootloader: reset pin to the first log line",
            time(boots[1].0 - report.resets[0].0),
        );
    });

    let table = table.into_inner().expect("no test has failed");
    let boards: Vec<&str> = table.values().next().expect("rows").1.keys().copied().collect();
    let mut text = format!("| what | {} |\n|---|{}\n", boards.join(" | "), "---|".repeat(boards.len()));
    for (what, found) in table.values() {
        assert_eq!(found.len(), boards.len(), "{what}: {found:?}");
        let found: Vec<_> = found.values().cloned().collect();
        text += &format!("| {what} | {} |\n", found.join(" | "));
    }
    println!("{text}");
    std::fs::write(emulation::image::folder().join("first-flash.md"), &text)
        .expect("the table is kept beside the images");
    // Each time has its own test; this one is there so that the table can be made at any time.
    assert_eq!(table.len(), 26);
}
