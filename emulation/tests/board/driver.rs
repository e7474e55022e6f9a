//! A fault of Embassy's UART driver on the F427 that the firmware has to work around (docs/boards-upstream.md).

use emulation::{Fate, Image, PIXRACER, Run};
use sim::ecu::{MILLIS, Nanos, SECOND};

const PORT: &str = "SERIAL5";

/// Distance between two ends of bytes after the end of a transmission, in ns: half an instruction.
const STEP: Nanos = 3;

/// As far after the transmission's end as anything is done about it, in ns. No multiple of the step: each sweep meets what the one
/// before left out.
const LAST: Nanos = 1_501;

/// When each transmission of the board ended.
fn ends(report: &emulation::Report) -> Vec<Nanos> {
    let sent: Vec<_> = report.wire(PORT).tx.iter().map(|tx| tx.end).collect();
    let pause = |pair: &[Nanos]| pair[1] - pair[0] > MILLIS;
    sent.windows(2).filter(|pair| pause(pair)).map(|pair| pair[0]).filter(|end| *end > SECOND).collect()
}

/// When the last bit of a transmission is sent, the driver would clear one flag by writing all of them back: a byte that arrives between
/// its read and its write is lost. So bytes end at each moment in which that can be.
#[test]
fn no_byte_is_lost_that_ends_while_a_transmission_ends() {
    let run = || Run::new(&PIXRACER, Image::Release).engines().tap(PORT);
    let until = 36 * SECOND;
    let alone = run().until(until).go();
    let byte = PIXRACER.port(PORT).byte_ns(alone.wire(PORT).line()).round() as Nanos;
    let mut with_bytes = run();
    for (i, end) in ends(&alone).into_iter().enumerate() {
        let start = end + i as Nanos * STEP % LAST - byte;
        with_bytes = with_bytes
            .at(start, |bench| bench.babble(PORT, Some(&[0x55])))
            .at(start + byte / 2, |bench| bench.babble(PORT, None));
    }
    let report = with_bytes.until(until).go();

    let ends = ends(&report);
    let received = report.wire(PORT).rx.iter().filter(|rx| rx.fate == Fate::Received && rx.start > SECOND);
    let mut distances = Vec::new();
    let mut lost = Vec::new();
    for rx in received {
        let Some(end) = ends.iter().rfind(|end| **end <= rx.end) else { continue };
        distances.push(rx.end - end);
        if !report.taps.iter().any(|tap| !tap.write && (rx.end..rx.end + byte / 2).contains(&tap.at)) {
            lost.push(rx.end - end);
        }
    }
    distances.sort_unstable();
    let inside: Vec<_> = distances.into_iter().filter(|distance| *distance < LAST).collect();
    let widest = inside.windows(2).map(|pair| pair[1] - pair[0]).max();
    println!(
        "{} bytes, {:?} to {:?} ns after an end, at most {widest:?} ns apart",
        inside.len(),
        inside.first(),
        inside.last()
    );
    assert!(inside.first() < Some(&100) && inside.last() > Some(&(LAST - 100)) && widest < Some(12));
    assert!(lost.is_empty(), "lost: {lost:?} ns after the end of a transmission");
}
