//! Checks of every run, whatever its test is about.
//!
//! - The firmware accessed nothing that the emulator does not model: it would read 0 where the part does not.
//! - No fault, no panic, no error in the log, and only the expected resets.
//! - Every byte took exactly its time at the line's baud rate and stop bits. The emulated UART carries
//!   bytes at any rate, so only this check shows a wrong one.
//! - The pins of every port in use are assigned to their UART, those of an F-RAM to their SPI. The emulated peripherals
//!   ignore this.
//! - TX of the UART behind a board's socket for a receiver is never driven; its inverter is only with a receiver there.
//! - Each fuel valve is closed 10 ms after a stop, also over resets, opens only with a run that is sent, and cuts off no engine that is
//!   ordered to run. Starter and ignition have power from armed until the engine is cold and at rest, also after a stop and over a reset. An
//!   image without outputs drives none of their pins.

use crate::board::{Board, Pin, Socket};
use crate::report::Report;
use crate::wire::{Fate, Tx, Wire};
use crate::{pins, valves};
use rigless::device::ResetCause;

/// What a run expects.
pub(crate) struct Expected {
    pub resets: usize,
    pub errors: bool,
}

/// Everything that is wrong.
pub(crate) fn of(report: &mut Report, expected: &Expected) -> Vec<String> {
    let mut complaints = unmodelled(report);
    complaints.extend(crashes(report, expected));
    for (port, wire) in report.wires() {
        complaints.extend(byte_times(report.board, port, wire));
    }
    complaints.extend(assigned_pins(report));
    complaints.extend(left_alone(report));
    complaints.extend(valves::complaints(report, expected.errors));
    complaints
}

fn unmodelled(report: &Report) -> Vec<String> {
    let session = &report.session;
    let mut complaints: Vec<String> =
        session.unmapped().iter().map(|access| format!("nothing is there: {access}")).collect();
    complaints.extend(session.refused().iter().map(|(at, fault)| format!("refused at {at:#010x}: {fault}")));
    let missing =
        session.unimplemented().iter().filter(|(address, _)| !report.board.not_modelled.contains(address));
    complaints.extend(missing.map(|(_, access)| {
        format!(
            "not modelled: {}.{}, {} reads and {} writes, the first at pc {:#010x}",
            access.instance, access.register, access.reads, access.writes, access.program_counter
        )
    }));
    complaints.extend(session.undefined().values().map(|access| {
        format!(
            "not defined: a register of {}, {} reads and {} writes, the first at pc {:#010x}",
            access.instance, access.reads, access.writes, access.program_counter
        )
    }));
    complaints.extend(
        session
            .unrouted()
            .iter()
            .map(|(instance, line)| format!("not routed: interrupt {line} of {instance}")),
    );
    complaints
}

/// The cause of a reset, for people.
const fn text_of(cause: ResetCause) -> &'static str {
    match cause {
        ResetCause::Core => "the core's own request",
        ResetCause::Model(instance) => instance,
        ResetCause::Pin => "the reset pin",
        ResetCause::PowerOn => "a power-up",
        _ => "another cause",
    }
}

fn crashes(report: &Report, expected: &Expected) -> Vec<String> {
    let mut complaints = Vec::new();
    let resets = expected.resets;
    if report.resets.len() != resets {
        let found: Vec<String> =
            report.resets.iter().map(|(at, cause)| format!("at {at} ns by {}", text_of(*cause))).collect();
        let found = if found.is_empty() { "none".to_owned() } else { found.join(", ") };
        complaints.push(format!("{resets} resets expected, found {found}"));
    }
    complaints.extend(report.faults.iter().map(|at| format!("a hard fault at {at} ns")));
    let hello = format!("on {}, last reset", report.board.title);
    let boots = report.lines(&hello).count();
    if boots != resets + 1 {
        complaints.push(format!("the firmware logged \"{hello}\" {boots} times"));
    }
    if !expected.errors {
        let bad = report.logs.iter().filter(|log| log.level == "error" || log.level == "warn");
        complaints.extend(bad.map(|log| format!("logged at {} ns: {} {}", log.at, log.level, log.text)));
    }
    complaints
}

/// Wire times are whole nanoseconds, and so is every instant in between.
const ROUNDING: f64 = 2.0;

fn byte_times(board: &Board, port: &str, wire: &Wire) -> Vec<String> {
    let line = wire.line();
    let byte = board.port(port).byte_ns(line);
    let mut complaints = Vec::new();

    let nominal = line.byte_ns(1) as f64;
    if (byte / nominal - 1.0).abs() > 0.002 {
        complaints.push(format!("{port}: its clock cannot make {} baud", line.baud));
    }
    let wrong = |took: f64| (took - byte).abs() > ROUNDING;
    let received = wire.rx.iter().filter(|rx| rx.fate == Fate::Received);
    if let Some(rx) = received.clone().find(|rx| wrong((rx.end - rx.start) as f64)) {
        let took = rx.end - rx.start;
        complaints
            .push(format!("{port}: the byte received at {} ns took {took} ns, not {byte:.0}", rx.start));
    }
    // Bytes of one frame follow each other without a gap; the next frame may begin at any later time.
    let head = 0xFF;
    let together = |gap: f64| gap < 1.5 * byte;
    let gap = |pair: &[Tx]| (pair[1].end - pair[0].end) as f64;
    // On the telemetry port any byte may come later: the driver gets a frame in pieces.
    let telemetry = port == board.telemetry.name;
    let later = |pair: &[Tx]| (telemetry || pair[1].byte == head) && gap(pair) > byte;
    let frames = wire.tx.windows(2).filter(|pair| together(gap(pair)));
    if let Some(pair) = frames.clone().find(|pair| wrong(gap(pair)) && !later(pair)) {
        let (at, took) = (pair[0].end, gap(pair));
        complaints.push(format!("{port}: the byte sent after {at} ns took {took} ns, not {byte:.0}"));
    }
    if wire.tx.len() > 1 && frames.count() == 0 {
        complaints.push(format!("{port}: no two bytes were sent back to back, so their time is not known"));
    }
    complaints
}

/// TX of the socket's UART is never driven, and its inverter only with a receiver there.
fn left_alone(report: &Report) -> Vec<String> {
    let Some(Socket { port, inverter, .. }) = report.board.socket else { return Vec::new() };
    let inverter = (!report.image.is_on_socket()).then_some(inverter);
    let all = [Some((port.tx.port, port.tx.number)), inverter].into_iter().flatten();
    let taken = all.filter_map(|pin| Some((pin, pins::taken(report, pin)?)));
    taken
        .map(|((name, number), at)| {
            format!("P{name}{number}, which has to be left alone, is driven at {at} ns")
        })
        .collect()
}

fn assigned_pins(report: &mut Report) -> Vec<String> {
    let (board, at) = (report.board, report.at);
    let fram_in_use = report.logged("settings: in an F-RAM");
    let used: Vec<_> = report.wires().map(|(port, _)| port).collect();
    let mut complaints = Vec::new();
    let mut read = |pin: Pin, offset: u64, bits: u64, of: u64| {
        let gpio = board.gpio + 0x400 * u64::from(pin.port as u8 - b'A');
        let word = report.session.board_mut().peek(at, gpio + offset);
        word.map(|word| word >> (bits * of) & ((1 << bits) - 1))
    };
    let ports = board.ports.iter().chain([&board.telemetry]).filter(|port| used.contains(&port.name));
    let ports = ports.flat_map(|port| [(port.name, port.rx), (port.name, port.tx)]);
    let socket = board.socket.map(|socket| (socket.port.name, socket.port.rx));
    let ports = ports.chain(socket.filter(|_| report.image.is_on_socket()));
    let fram = board.fram.filter(|_| fram_in_use);
    let fram = fram.iter().flat_map(|fram| fram.pins).map(|pin| ("F-RAM", pin));
    for (name, pin) in ports.chain(fram) {
        let number = u64::from(pin.number);
        let mode = read(pin, 0x00, 2, number); // MODER: 2 is "alternate function"
        let function = read(pin, 0x20 + 4 * (number / 8), 4, number % 8); // AFRL, AFRH
        if mode != Some(2) || function != Some(pin.function.into()) {
            let number_of =
                |field: Option<u64>| field.map_or("unknown".to_owned(), |field| field.to_string());
            complaints.push(format!(
                "{name}: P{}{} is in mode {} with function {}, not 2 with {}",
                pin.port,
                pin.number,
                number_of(mode),
                number_of(function),
                pin.function
            ));
        }
    }
    complaints
}
