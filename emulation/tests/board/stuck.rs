//! A transmitter that stops in the middle of a byte, and works again only after its UART is set up again.

use crate::support::{on_each_board, others_are_well};
use emulation::{Image, Report, Run};
use sim::amt::AmtEcu;
use sim::any::Protocol;
use sim::ecu::{MILLIS, Nanos, SECOND};

const AMT: &str = "SERIAL2";
const ZK: &str = "SERIAL5";

/// When the first byte after 3 s was half sent on a port.
fn in_a_byte(report: &Report, port: &str) -> Nanos {
    let wire = report.wire(port);
    let byte = report.board.port(port).byte_ns(wire.line()) as Nanos;
    let sent = wire.tx.iter().find(|tx| tx.end - byte / 2 > 3 * SECOND).expect("something is sent");
    sent.end - byte / 2
}

#[test]
fn port_with_a_stuck_transmitter_is_reopened_and_serves_its_ecu_again() {
    on_each_board(|board| {
        let run = || Run::new(board, Image::Release).engines();
        let as_usual = run().until(3300 * MILLIS).go();
        let [amt, zk] = [AMT, ZK].map(|port| in_a_byte(&as_usual, port));
        let (report, complaints) = run()
            .at(amt, |bench| bench.stop_transmitter(AMT))
            .at(zk, |bench| bench.stop_transmitter(ZK))
            .with_errors()
            .until(8 * SECOND)
            .go_unchecked();
        // The firmware writes to a transmitter that is off, as this test intends.
        let others: Vec<_> = complaints.iter().filter(|text| !text.starts_with("not defined: ")).collect();
        assert!(others.is_empty(), "{others:#?}");

        let opened: Vec<_> =
            report.lines("transmitter stuck, reopening its port").map(|log| log.at).collect();
        for (port, stopped, engine) in [(AMT, amt, "left"), (ZK, zk, "booster")] {
            let sent: Vec<_> = report.wire(port).tx.iter().map(|tx| tx.end).collect();
            let again = sent.iter().find(|end| **end > stopped).unwrap_or_else(|| {
                panic!("{} {port}: nothing is sent any more\n{}", board.name, report.log_text())
            });
            let pause = again - stopped;
            println!("{} {port}: served again after {:.1} ms", board.name, pause as f64 / 1e6);
            // A frame is 0.2 s old by then; the next is sent at the next set or send slot.
            assert!((200 * MILLIS..600 * MILLIS).contains(&pause), "{} {port}: {pause} ns", board.name);
            // Only because the port was opened in between.
            assert!(opened.iter().any(|at| (stopped..*again).contains(at)), "{opened:?} {stopped} {again}");
            let status = format!("{engine}: link");
            let status = &report.lines(&status).next_back().expect("a status line").text;
            assert!(status.contains("link up") && !status.contains("TRANSMITTER FAILED"), "{status}");
        }
        assert_eq!(opened.len(), 2, "{}", report.log_text());
        // From then on both are served as before.
        let since = 5 * SECOND;
        let replies = report.ecu::<AmtEcu>(AMT).commands.iter().filter(|(at, _)| *at > since).count();
        assert!((23..=24).contains(&replies), "{replies} replies in 3 s");
        let commands = report.wire(ZK).frames(Protocol::Zk);
        let commands = commands.iter().filter(|(_, bytes)| bytes[0].end > since).count();
        assert!((149..=151).contains(&commands), "{commands} commands in 3 s");
        others_are_well(&report, &[AMT, ZK]);
    });
}
