//! The expectations of docs/first-flash.md, measured: what a person should see with a logic analyser and in the log.
//! Each value on the page is compared with what the emulated board does.

mod page;

use crate::crystal::{WITHOUT, stop_crystal};
use crate::supply::drop_supply;
use crate::support::{Led, Task, crash, engines, first_byte, on_each_board};
use emulation::board::{Part, Pin};
use emulation::{Board, Bootloader, Image, Jump, Report, Run, bootloader, turnaround};
use page::{PAGE, Place};
use sim::any::Protocol;
use sim::ecu::{Ecu, LineFault, MILLIS, Nanos, SECOND};
use sim::line::Line;
use std::collections::BTreeMap;
use std::sync::Mutex;

/// Measured values, each with its place on the page.
type Measured = BTreeMap<Place, String>;

/// A time with three digits. A value that rounds to 1000 of a unit is 1 of the next.
fn time(ns: Nanos) -> String {
    let (value, unit) = match ns {
        0..1_000 => (ns as f64, "ns"),
        1_000..999_500 => (ns as f64 / 1e3, "µs"),
        999_500..999_500_000 => (ns as f64 / 1e6, "ms"),
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

/// The bytes of each control frame on a port.
fn sent<'a>(report: &'a Report, port: &str, protocol: Protocol) -> Vec<&'a [emulation::Tx]> {
    report.wire(port).frames(protocol).into_iter().map(|(_, bytes)| bytes).collect()
}

/// The shortest and the longest of some times.
fn span(values: impl IntoIterator<Item = Nanos>) -> String {
    let mut values: Vec<_> = values.into_iter().collect();
    values.sort_unstable();
    let [first, .., last] = values[..] else { panic!("too few: {values:?}") };
    if time(first) == time(last) { time(first) } else { format!("{} to {}", time(first), time(last)) }
}

/// As in the log.
fn quoted(text: &str) -> String {
    format!("`{text}`")
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

    fn receive(&mut self, _: Nanos, _: Result<u8, LineFault>) {}

    fn power(&mut self, _: Nanos, _: bool) {}
}

/// An AMT set of an engine in standby, as docs/first-flash.md has it.
const AMT_SET: [u8; 6] = [0xFF, 0x02, 0x00, 0x0E, 0x00, 0x00];

/// The first and second port (AMT), the third and the fourth (ZK, 9600 and 115 200 baud).
const PORTS: [(&str, u32); 4] =
    [("SERIAL2", 2400), ("SERIAL3", 2400), ("SERIAL4", 9600), ("SERIAL5", 115_200)];

/// The image with a serial adapter on the first port, that sends from then on, and nothing on the others.
fn with_adapter(board: &'static Board, image: Image, from: Nanos) -> Run {
    PORTS.into_iter().fold(Run::new(board, image), |run, (port, baud)| {
        let next = if port == "SERIAL2" { from } else { Nanos::MAX };
        run.ecu(port, Line::n1(baud), Adapter { next, bytes: &AMT_SET })
    })
}

/// The register that enables a UART, and its bits for that.
fn control(board: &Board) -> (u64, u64) {
    match board.part {
        Part::H743 => (0x00, 1 << 3 | 1),
        Part::F427 => (0x0C, 1 << 3 | 1 << 13),
    }
}

/// When the firmware started, and the cause of the reset that it logged.
fn starts(report: &Report) -> Vec<(Nanos, String)> {
    let cause = |text: &str| text.find("last reset: ").map(|at| quoted(&text[at..]));
    report.logs.iter().filter_map(|log| cause(&log.text).map(|cause| (log.at, cause))).collect()
}

/// How often the LED was lit in the second from then on.
fn flashes(report: &Report, board: &Board, from: Nanos) -> String {
    let lit = Led::of(board).lit(report);
    lit.into_iter().filter(|at| (from..from + SECOND).contains(at)).count().to_string()
}

/// The log line with this text, from the text on.
fn logged(report: &Report, text: &str) -> String {
    let line = report.lines(text).next_back();
    let line = line.unwrap_or_else(|| panic!("the firmware never logged \"{text}\":\n{}", report.log_text()));
    quoted(&line.text[line.text.find(text).expect("it has the text")..])
}

/// Records a value: the page's section, words of its row, the measurement.
type Note<'a> = dyn FnMut(u8, &'static str, String) + 'a;

/// Section 2: the block of the self-test, line by line.
fn self_test(board: &'static Board, note: &mut Note<'_>) {
    /// How the lines begin.
    const LINES: [&str; 12] = [
        "device",
        "PWR",
        "RCC",
        "the watchdog bit after",
        "LSI",
        "core",
        "retained RAM",
        "TX at the start",
        "flash ACR",
        "option bytes",
        "MPU",
        "stack",
    ];
    let run = with_adapter(board, Image::SelfTest, SECOND).resets(2).with_errors();
    let report = run.until(8 * SECOND).go();
    let lines = report.logs.iter().filter_map(|log| log.text.strip_prefix("selftest: "));
    let block: Vec<_> =
        lines.skip_while(|line| !line.starts_with("begin")).take_while(|line| *line != "end").collect();
    assert_eq!(block.len(), 1 + LINES.len(), "{block:#?}");
    for (line, begins) in block[1..].iter().zip(LINES) {
        let rest = line.strip_prefix(begins).unwrap_or_else(|| panic!("{begins}: {line}"));
        note(2, begins, quoted(rest.trim_start_matches([' ', ',', ':'])));
    }
}

/// Sections 3 to 5: the start, the bytes without anybody on the ports, and the adapter on the first one.
fn start_and_lines(board: &'static Board, note: &mut Note<'_>) {
    let pull = 5 * SECOND;
    let mut run = with_adapter(board, Image::Release, 2 * SECOND)
        .tap("SERIAL2")
        .at(pull, |bench| bench.cut("SERIAL2", true))
        .until(7 * SECOND);
    for letter in 0..5 {
        let port = board.gpio + 0x400 * letter;
        run = run.record(port).record(port + 0x0C).record(port + 0x18);
    }
    let (enable, enabled) = control(board);
    for port in board.ports {
        run = run.record(port.registers() + enable);
    }
    let report = run.go();

    let written = |register: u64, is: &dyn Fn(u64) -> bool| {
        let mut writes = report.written.iter().filter(|write| write.register == register);
        writes.find(|write| is(write.value)).map(|write| write.at).expect("a write")
    };
    let field = |pin: Pin, word: u64| word >> (2 * pin.number) & 3;
    let pulled = board
        .ports
        .iter()
        .map(|port| written(gpio(board, port.tx) + 0x0C, &|word| field(port.tx, word) == 1));
    note(3, "TX floats", time(pulled.max().expect("ports")));
    let low = engines(&report).into_iter().map(|engine| {
        let port = board.port(engine.port);
        let driven = written(gpio(board, port.tx), &|word| field(port.tx, word) == 2);
        written(port.registers() + enable, &|word| word & enabled == enabled) - driven
    });
    note(3, "TX low", span(low));
    let (started, cause) = &starts(&report)[0];
    note(3, "first log line", format!("{}, {cause}", time(*started)));
    let led = Led::of(board);
    let lit = led.lit(&report)[0];
    let dark = led.dark(&report).into_iter().find(|at| *at > lit).expect("it goes out");
    note(3, "first flash", time(lit));
    note(3, "length of a flash", time(dark - lit));
    note(3, "flashes in a second", flashes(&report, board, lit - 100 * MILLIS));
    note(3, "stack", logged(&report, "board: "));

    // A port's bytes back to back, and its commands of four bytes from one to the next.
    for (port, byte_row, rate_row) in [
        ("SERIAL4", "9600 baud (third port): a byte", "9600 baud: from one command"),
        ("SERIAL5", "115 200 baud (fourth port): a byte", "115 200 baud: from one command"),
    ] {
        let commands = sent(&report, port, Protocol::Zk);
        let gaps = commands.iter().flat_map(|command| command.windows(2).map(|two| two[1].end - two[0].end));
        note(4, byte_row, span(gaps));
        let ends: Vec<_> =
            commands.iter().map(|command| command[0].end).filter(|end| *end > SECOND).collect();
        note(4, rate_row, span(ends.windows(2).map(|two| two[1] - two[0])));
    }
    let unsolicited = report.wire("SERIAL2").tx.iter().filter(|tx| tx.end < 2 * SECOND).count();
    note(4, "AMT ports", (unsolicited + report.wire("SERIAL3").tx.len()).to_string());

    let replies = sent(&report, "SERIAL2", Protocol::Amt);
    let text = |reply: &[emulation::Tx]| {
        let bytes: Vec<_> = reply.iter().map(|tx| format!("{:02X}", tx.byte)).collect();
        quoted(&bytes.join(" "))
    };
    let mut texts: Vec<_> = replies.iter().map(|reply| text(reply)).collect();
    texts.dedup();
    note(5, "reply to each set", texts.join(", "));
    let byte = replies[0][1].end - replies[0][0].end;
    note(5, "a byte at 2400 baud", time(byte));
    note(5, "first reply after", time(replies[0][0].end - byte - 2 * SECOND));
    note(5, "to its last stop bit", time(replies[0][4].end - replies[0][0].end + byte));
    let distances = turnaround::of(&report, "SERIAL2");
    note(5, "to the start bit of the reply", span(distances.iter().map(|each| each.ns)));
    note(5, "`left: ECU link up`", time(report.when("left: ECU link up") - 2 * SECOND));
    let received = report.wire("SERIAL2").rx.iter().filter(|rx| rx.end < pull);
    let last = received.map(|rx| rx.end).max().expect("the sets were received");
    let lost = report.lines("left: ECU link lost").find(|log| log.at > last).expect("it is lost").at;
    note(5, "`left: ECU link lost`", time(lost - last));
}

/// Section 6: the reset pin and the watchdog, with the adapter on the first port.
fn resets(board: &'static Board, note: &mut Note<'_>) {
    let at = 3 * SECOND;
    let run = with_adapter(board, Image::Release, SECOND).at(at, |bench| bench.press_reset()).resets(1);
    let report = run.until(4 * SECOND).go();
    let (started, cause) = &starts(&report)[1];
    note(6, "press reset", format!("{}, {cause}", time(started - at)));
    note(6, "first byte on the fourth port", time(first_byte(&report, "SERIAL5", at) - at));
    note(6, "first reply to a set", time(first_byte(&report, "SERIAL2", at) - at));

    let run = with_adapter(board, Image::Wedge, SECOND).resets(1).with_errors().until(7 * SECOND);
    let report = run.go();
    let (reset, (started, cause)) = (report.resets[0].0, &starts(&report)[1]);
    note(6, "a task hangs", time(reset - report.when("left: its runner is stuck")));
    note(6, "first log line after the reset by the watchdog", format!("{}, {cause}", time(started - reset)));
}

/// Section 7: a crystal that is dead at the start and comes back, and one that stops.
fn crystal(board: &'static Board, note: &mut Note<'_>) {
    let reset = 3500 * MILLIS;
    let report = with_adapter(board, Image::Release, SECOND)
        .record(Led::of(board).register)
        .at(0, |bench| bench.break_crystal())
        .at(reset, |bench| {
            bench.mend_crystal();
            bench.press_reset();
        })
        .resets(1)
        .with_errors()
        .until(5 * SECOND)
        .go();
    let boots = starts(&report);
    note(7, "ground it, power on", format!("{}, {}", logged(&report, WITHOUT), time(boots[0].0)));
    note(7, "LED", flashes(&report, board, 2 * SECOND));
    let every = report.lines("board: no crystal").map(|log| log.at).filter(|at| *at < reset);
    let every: Vec<_> = every.collect();
    note(7, "`board: no crystal", span(every.windows(2).map(|two| two[1] - two[0])));
    let commands = sent(&report, "SERIAL5", Protocol::Zk).into_iter();
    let before = commands.filter(|command| command[3].end < reset);
    let gaps = before.flat_map(|command| command.windows(2).map(|two| two[1].end - two[0].end));
    note(7, "a byte at 115 200 baud", span(gaps.collect::<Vec<_>>()));
    let after = report.lines("crystal").filter(|log| log.at > boots[1].0).count();
    note(7, "let it go, press reset", format!("{}, {after}", boots[1].1));

    let stop =
        |bench: &mut emulation::Bench<'_>| stop_crystal(bench, board, Image::Release, Task::Supervisor);
    let run = with_adapter(board, Image::Release, SECOND).at(1500 * MILLIS, stop).resets(1).with_errors();
    let report = run.until(2500 * MILLIS).go();
    assert!(report.logged(WITHOUT), "{}", report.log_text());
    let line = logged(&report, "the crystal has stopped, resetting");
    note(7, "ground it while it runs", format!("{line}, {}", starts(&report)[1].1));
}

/// Section 8: a falling supply of an F427. The H743 does not monitor it.
fn supply(board: &'static Board, note: &mut Note<'_>) {
    if board.part == Part::F427 {
        let report = with_adapter(board, Image::Release, SECOND)
            .at(1500 * MILLIS, |bench| drop_supply(bench, Image::Release))
            .at(2 * SECOND, |bench| bench.supply(2900))
            .at(2500 * MILLIS, |bench| bench.supply(2960))
            .resets(1)
            .with_errors()
            .until(3 * SECOND)
            .go();
        let (started, cause) = &starts(&report)[1];
        assert!(*started > 2500 * MILLIS, "it waits for 2.93 V: {started}");
        note(8, "lower it slowly", format!("{}, then {cause}", logged(&report, "the supply is below")));
    }
}

/// Section 9: behind a bootloader that decides and jumps like the real one.
fn behind_a_bootloader(board: &'static Board, note: &mut Note<'_>) {
    let wait = bootloader::WAIT_MS * MILLIS;
    let decides = || Bootloader { jump: Jump::New, leaves: Vec::new(), decides: true };
    let report = with_adapter(board, Image::Ardupilot, wait)
        .bootloader(decides())
        .at(wait + SECOND, |bench| bench.press_reset())
        .at(wait + 1500 * MILLIS, move |bench| crash(bench, board, Image::Ardupilot))
        .at(wait + 2 * SECOND, |bench| bench.watchdog_runs_out())
        .resets(3)
        .with_errors()
        .until(wait + 2500 * MILLIS)
        .go();
    let boots = starts(&report);
    let after = |nth: usize| {
        let (started, cause) = &boots[nth];
        format!("{}, {cause}", time(started - report.resets[nth - 1].0))
    };
    note(9, "power on | first log line", time(boots[0].0));
    note(9, "press reset", after(1));
    note(9, "a crash", after(2));
    note(9, "the watchdog", after(3));

    let stop =
        |bench: &mut emulation::Bench<'_>| stop_crystal(bench, board, Image::Ardupilot, Task::Supervisor);
    let run = with_adapter(board, Image::Ardupilot, SECOND).record(Led::of(board).register);
    // The firmware starts twice without a reset, which the checks of every run do not expect.
    let (report, _) = run.at(1500 * MILLIS, stop).with_errors().until(4500 * MILLIS).go_unchecked();
    assert!(report.resets.is_empty() && report.logged(WITHOUT), "{}", report.log_text());
    let cause = starts(&report)[1].1.clone();
    let lit = flashes(&report, board, 3 * SECOND);
    note(9, "grounded while it runs", format!("{cause}, {lit}"));
}

#[test]
fn the_page_of_the_first_flash_has_the_values_of_the_emulated_boards() {
    let measured = Mutex::new(Measured::new());
    on_each_board(|board| {
        let chip = match board.part {
            Part::H743 => "H743",
            Part::F427 => "F427",
        };
        let mut note = |section: u8, row: &'static str, found: String| {
            let before = measured.lock().expect("no test has failed").insert((section, row, chip), found);
            assert_eq!(before, None, "{section}: {row}");
        };
        for part in [self_test, start_and_lines, resets, crystal, supply, behind_a_bootloader] {
            part(board, &mut note);
        }
    });
    let measured = measured.into_inner().expect("no test has failed");
    let renewed = emulation::image::folder().join("first-flash.md");
    std::fs::write(&renewed, page::renewed(PAGE, &measured)).expect("the page is kept beside the images");
    let complaints = page::complaints(PAGE, &measured);
    assert!(
        complaints.is_empty(),
        "docs/first-flash.md:\n{}\n{} has the page with what was measured",
        complaints.join("\n"),
        renewed.display()
    );
}
