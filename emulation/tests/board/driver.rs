//! Extent of a fault in Embassy's UART driver on the F427 that this firmware cannot fix (docs/boards-upstream.md).

use emulation::{Fate, Image, PIXRACER, Run};
use sim::ecu::{MILLIS, Nanos, SECOND};

const PORT: &str = "SERIAL5";

/// Number of received bytes that were not read, when a single byte ends at `end`.
fn unread(end: Nanos, byte: Nanos) -> usize {
    let start = end - byte;
    let report = Run::new(&PIXRACER, Image::Release)
        .engines()
        .tap(PORT)
        .at(start, |bench| bench.babble(PORT, Some(&[0x55])))
        .at(start + byte / 2, |bench| bench.babble(PORT, None))
        .until(end + MILLIS)
        .go();
    let later = start..end + MILLIS;
    let received =
        report.wire(PORT).rx.iter().filter(|rx| rx.fate == Fate::Received && later.contains(&rx.end));
    let read = report.taps.iter().filter(|tap| !tap.write && later.contains(&tap.at));
    let (received, read) = (received.count(), read.count());
    assert!(received == 1 && read <= 2, "{received} {read}");
    // After the byte the line is idle, and the driver reads once more for that.
    2 - read.max(1)
}

/// When the last bit of a transmission is sent, the driver clears one flag by writing all of them back. A byte that
/// arrives between its read and its write is lost.
#[test]
fn a_byte_that_ends_while_the_driver_clears_a_flag_is_lost() {
    let status = PIXRACER.port(PORT).registers();
    let report =
        Run::new(&PIXRACER, Image::Release).engines().record(status).until(SECOND + 100 * MILLIS).go();
    let cleared =
        report.written.iter().map(|write| write.at).find(|at| *at > SECOND).expect("a transmission ends");
    let byte = PIXRACER.port(PORT).byte_ns(report.wire(PORT).line()).round() as Nanos;
    // Before the read, between the two, and after the write. In between lie two instructions, 12 ns.
    let lost = [40, 17, 0].map(|before| unread(cleared - before, byte));
    assert_eq!(lost, [0, 1, 0]);
}
