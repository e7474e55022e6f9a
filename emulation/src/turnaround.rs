//! How long a reply takes: from the last stop bit of an AMT frame to the first start bit of the reply.

use crate::report::Report;
use crate::wire::Fate;
use sim::ecu::{MILLIS, Nanos};

/// One frame and its reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Turnaround {
    /// End of the frame's last stop bit.
    pub frame_end: Nanos,
    /// From there to the start bit of the reply.
    pub ns: Nanos,
    /// The same in instructions: the number that the core can execute in this time, for any purpose.
    pub slots: u64,
    /// Instructions from the read of the frame's last byte to the write of the reply's first.
    pub instructions: u64,
}

/// Every frame on a tapped port that got a reply, in the order of time.
pub fn of(report: &Report, port: &str) -> Vec<Turnaround> {
    let wire = report.wire(port);
    let byte = report.board.port(port).byte_ns(wire.line()).round() as Nanos;
    let taps: Vec<_> = report.taps.iter().filter(|tap| tap.port == port).collect();
    let mut replies = wire.tx.iter().peekable();
    let mut turnarounds = Vec::new();
    for frame in wire.rx.iter().filter(|rx| rx.last && rx.fate == Fate::Received) {
        while replies.next_if(|tx| tx.end < frame.end + byte).is_some() {}
        let Some(first) = replies.peek() else { break };
        let ns = first.end - byte - frame.end;
        if ns > 30 * MILLIS {
            continue; // nothing in the window: not a reply to this frame
        }
        let from = taps.partition_point(|tap| tap.at < frame.end);
        let read = taps[from..].iter().find(|tap| !tap.write);
        let write = taps[from..].iter().find(|tap| tap.write);
        let instructions = match (read, write) {
            (Some(read), Some(write)) => write.instructions.saturating_sub(read.instructions),
            _ => 0,
        };
        let slots = (u128::from(ns) * u128::from(report.instructions_per_second) / 1_000_000_000) as u64;
        turnarounds.push(Turnaround { frame_end: frame.end, ns, slots, instructions });
    }
    turnarounds
}
