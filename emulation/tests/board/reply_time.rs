//! From the last stop bit of an AMT frame to the first start bit of the reply, in the worst case found.

use crate::support::{amt, amt_engines, engines, line_errors_of, on_each_board};
use emulation::{Board, Fate, Image, MATEK_H743, PIXRACER, Report, Run, turnaround};
use sim::amt::AmtEcu;
use sim::any::AnyEcu;
use sim::ecu::{MILLIS, Nanos, SECOND};
use sim::line::Line;

/// Neither protocol's frames.
pub const GARBAGE: [u8; 13] = [0xFF, 0x80, 0xF1, 0x00, 0xFF, 0xFF, 0x13, 0xF0, 0x55, 0x33, 0xFE, 0x81, 0x01];

/// Core rates at which a reply is timed: one instruction a cycle, and for the F427, whose flash has wait states
/// and no cache, a pessimistic one too.
const RATES: [(&Board, u64); 3] =
    [(&MATEK_H743, 400_000_000), (&PIXRACER, 168_000_000), (&PIXRACER, 100_000_000)];

/// Other work of the firmware meanwhile, in the order of the table.
const LOADS: [&str; 3] = ["idle", "all engines, logging", "all ports saturated"];

struct Row {
    board: &'static Board,
    rate: u64,
    load: &'static str,
    core: f64,
    frames: usize,
    ns: Nanos,
    slots: u64,
}

/// An AMT ECU at an odd period, so that its frames coincide with everything else in every way.
fn odd(board: &'static Board, port: &str, period: Nanos) -> AnyEcu {
    amt(board, Image::AllPorts, port, |ecu| ecu.period = period)
}

fn worst(report: &Report, load: &'static str, from: Nanos) -> Row {
    let ports: Vec<_> = amt_engines(report).into_iter().map(|engine| engine.port).collect();
    let wired = ports.into_iter().filter(|port| report.wires().any(|(each, _)| each == *port));
    let all: Vec<_> = wired.flat_map(|port| turnaround::of(report, port)).collect();
    let all: Vec<_> = all.into_iter().filter(|each| each.frame_end > from).collect();
    let worst = all.iter().max_by_key(|each| each.ns).expect("a reply");
    Row {
        board: report.board,
        rate: report.instructions_per_second,
        load,
        core: report.load(),
        frames: all.len(),
        ns: worst.ns,
        slots: worst.slots,
    }
}

/// One engine, nothing else on any port.
fn idle(board: &'static Board, rate: u64) -> Row {
    let report = Run::new(board, Image::AllPorts)
        .instructions_per_second(rate)
        .ecu("SERIAL2", Line::n1(2400), odd(board, "SERIAL2", 61_003_000))
        .tap("SERIAL2")
        .until(12 * SECOND)
        .go();
    worst(&report, LOADS[0], 0)
}

/// Every engine at its normal rate, and frames that end, one a second, a little later each time: from before the
/// burst of log lines that the firmware writes once a second until after it.
fn while_logging(board: &'static Board, rate: u64) -> Row {
    const BOOT: Nanos = 50 * MILLIS;
    const PERIOD: Nanos = SECOND / 16;
    let run = |boot, period, until| {
        let ecu = amt(board, Image::AllPorts, "SERIAL2", |ecu| (ecu.boot, ecu.period) = (boot, period));
        let run = Run::new(board, Image::AllPorts).instructions_per_second(rate).engines();
        run.ecu("SERIAL2", Line::n1(2400), ecu).tap("SERIAL2").until(until).go()
    };
    let trial = run(BOOT, PERIOD, 1_200 * MILLIS);
    let burst = trial.when("left: link") - 60_000;
    let mut frames = trial.wire("SERIAL2").rx.iter().filter(|rx| rx.last);
    let end = frames.find(|rx| rx.end > burst).expect("a frame after the log").end;
    let early = (end - burst) % PERIOD;
    let report = run(BOOT + PERIOD - early, PERIOD + 250, 60 * SECOND);
    // Some frames did end while the firmware was logging.
    let last = engines(&report).last().expect("engines").name;
    let bursts = report.lines("left: link").zip(report.lines(last).filter(|log| log.text.contains(": link")));
    let bursts: Vec<_> = bursts.map(|(first, last)| first.at - 5_000..last.at).collect();
    let ends = report.wire("SERIAL2").rx.iter().filter(|rx| rx.last);
    let hits = ends.filter(|rx| bursts.iter().any(|burst| burst.contains(&rx.end))).count();
    assert!(hits >= 5, "{} at {rate}: {hits} frames ended while the firmware was logging", board.name);
    worst(&report, LOADS[1], SECOND)
}

/// Every port busy: AMT ECUs send as fast as their replies allow, ZK ECUs babble at their full line rate.
fn saturated(board: &'static Board, rate: u64) -> Row {
    let mut run = Run::new(board, Image::AllPorts)
        .instructions_per_second(rate)
        .engines()
        .ecu("SERIAL2", Line::n1(2400), odd(board, "SERIAL2", 47_003_000))
        .ecu("SERIAL3", Line::n1(2400), odd(board, "SERIAL3", 48_017_000))
        .tap("SERIAL2")
        .tap("SERIAL3");
    if board.ports.len() > 5 {
        run = run.ecu("SERIAL7", Line::n1(9600), odd(board, "SERIAL7", 12_007_000)).tap("SERIAL7");
    }
    for port in ["SERIAL4", "SERIAL5", "SERIAL6"] {
        run = run.at(1_000 * MILLIS, move |bench| bench.babble(port, Some(&GARBAGE)));
    }
    let report = run.until(10 * SECOND).go();
    for engine in amt_engines(&report) {
        let stats = report.ecu::<AmtEcu>(engine.port).stats;
        // The set-up frame is longer than these periods, so the next frame comes into the reply to it.
        let in_order = stats.late == 0 && stats.none <= 1 && stats.unsolicited <= 1;
        assert!(in_order, "{}: {stats:?}", engine.name);
    }
    worst(&report, LOADS[2], SECOND)
}

#[test]
fn the_worst_reply_of_each_board_is_far_inside_the_window() {
    let rows = std::sync::Mutex::new(Vec::new());
    on_each_board(|board| {
        for (_, rate) in RATES.into_iter().filter(|(each, _)| each.name == board.name) {
            for row in [idle(board, rate), while_logging(board, rate), saturated(board, rate)] {
                rows.lock().expect("no test has failed").push(row);
            }
        }
    });
    let mut rows = rows.into_inner().expect("no test has failed");
    rows.sort_by_key(|row| {
        (row.board.name, u64::MAX - row.rate, LOADS.iter().position(|&load| load == row.load))
    });
    let mut table = String::from(
        "| board | M instructions/s | load | core busy | replies | worst, ns | in instructions |\n",
    );
    table += "|---|---|---|---|---|---|---|\n";
    for row in &rows {
        table += &format!(
            "| {} | {} | {} | {:.1} % | {} | {} | {} |\n",
            row.board.name,
            row.rate / 1_000_000,
            row.load,
            row.core,
            row.frames,
            row.ns,
            row.slots
        );
    }
    println!("{table}");
    let file = emulation::image::folder().join("turnaround.md");
    std::fs::write(&file, table).expect("the table is kept beside the images");
    for row in &rows {
        // Of the window's 30 ms the reply itself takes 20.8 ms at 2400 baud: 9.2 ms are left.
        assert!(row.ns < MILLIS, "{} at {}: {} ns", row.board.name, row.rate, row.ns);
    }
}

/// A byte at 115 200 baud takes 87 µs, and an F427 holds one: the next one overwrites it. So nothing may delay an interrupt
/// for long, log lines included. The line is full, so some byte arrives at the worst moment of each.
#[test]
fn no_byte_waits_long_for_its_interrupt() {
    on_each_board(|board| {
        let mut run = Run::new(board, Image::Release).engines().tap("SERIAL5");
        for second in 1..12 {
            let at = second * SECOND - SECOND / 2 + second * 8000;
            run = run.at(at, |bench| bench.babble("SERIAL5", Some(&[0x55])));
        }
        let report = run.until(12 * SECOND).go();
        let mut reads = report.taps.iter().filter(|tap| !tap.write).peekable();
        let mut waits = Vec::new();
        for rx in report.wire("SERIAL5").rx.iter().filter(|rx| rx.fate == Fate::Received && rx.start > SECOND)
        {
            while reads.next_if(|read| read.at < rx.end).is_some() {}
            let Some(read) = reads.peek() else { break };
            waits.push(read.at - rx.end);
        }
        waits.sort_unstable();
        let [median, longest] = [waits[waits.len() / 2], waits[waits.len() - 1]];
        println!("{}: {} bytes, median {median} ns, longest {longest} ns", board.name, waits.len());
        assert!(waits.len() > 120_000);
        // 15.6 µs on the F427, 6.6 µs on the H743: the lock under which an engine is brought up to date.
        assert!(longest < 20_000, "{longest} ns");
        assert_eq!(line_errors_of(&report, "booster"), (0, 0, 0));
    });
}
