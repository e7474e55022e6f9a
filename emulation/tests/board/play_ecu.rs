//! A Nucleo that is its own ECU: the last port crossed with the first.

use emulation::{Image, NUCLEO_H743ZI2, Run};
use sim::ecu::{Ecu, LineFault, MILLIS, Nanos, SECOND};
use sim::line::Line;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

/// Bytes on their way from one port to the other.
type Lane = Arc<Mutex<VecDeque<u8>>>;

/// One end of two crossed wires. A byte is passed on when it is complete, so it arrives one byte time late.
#[derive(Debug)]
struct Crossed {
    to_here: Lane,
    from_here: Lane,
    looked: Nanos,
}

/// How often it looks for bytes.
const LOOK: Nanos = MILLIS / 10;

impl Ecu for Crossed {
    fn next_wake(&self) -> Nanos {
        self.looked + LOOK
    }

    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>) {
        self.looked = now;
        tx.extend(self.to_here.lock().expect("no panic").drain(..));
    }

    fn receive(&mut self, _: Nanos, byte: Result<u8, LineFault>) {
        self.from_here.lock().expect("no panic").push_back(byte.expect("a clean line"));
    }

    fn power(&mut self, _: Nanos, _: bool) {}
}

#[test]
fn the_played_ecu_is_answered_by_the_engine_on_the_crossed_port() {
    let board = &NUCLEO_H743ZI2;
    let (first, last) = (board.ports[0].name, board.ports[5].name);
    let lanes = [Lane::default(), Lane::default()];
    let end = |to: usize| Crossed { to_here: lanes[to].clone(), from_here: lanes[1 - to].clone(), looked: 0 };
    let line = Line::n1(2400);
    let report = Run::new(board, Image::PlayEcu)
        .engines()
        .ecu(first, line, end(0))
        .ecu(last, line, end(1))
        .until(4 * SECOND)
        .go();
    assert!(report.logged("left: ECU link up"), "{}", report.log_text());
    // 8 frames a second; the first ones wait until two agree.
    let line = report.lines("played ECU: ").next_back().expect("a report").text.clone();
    println!("{line}");
    let mut numbers = line.split(|c: char| !c.is_ascii_digit()).filter_map(|word| word.parse::<u64>().ok());
    let (frames, replies) = (numbers.next().expect("frames"), numbers.next().expect("replies"));
    assert!(frames >= 24 && frames - replies <= 2, "{line}");
    // Less one byte time each way, and the polling interval: the rest is the reply itself.
    let began = numbers.nth(1).expect("microseconds");
    assert!((2 * 4167..2 * 4167 + 2 * 100 + 50).contains(&began), "{line}");
}
