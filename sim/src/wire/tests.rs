//! The wire alone, with an ECU that sends scripted bytes and records received ones.

use super::*;
use crate::ecu::MILLIS;
use core::future::Future;
use embassy_futures::join::join;
use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Timer};
use embedded_io_async::{Error as _, ErrorKind, Read, Write};
use std::collections::VecDeque;

#[derive(Debug, Default)]
struct Scripted {
    script: VecDeque<(Nanos, Vec<u8>)>,
    received: Vec<(Nanos, Result<u8, LineFault>)>,
    powered: Vec<bool>,
}

impl Scripted {
    fn sends(at: Nanos, bytes: &[u8]) -> Self {
        Self { script: [(at, bytes.to_vec())].into(), ..Self::default() }
    }

    fn bytes_received(&self) -> Vec<u8> {
        self.received.iter().filter_map(|(_, byte)| byte.ok()).collect()
    }
}

impl Ecu for Scripted {
    fn next_wake(&self) -> Nanos {
        self.script.front().map_or(Nanos::MAX, |&(at, _)| at)
    }

    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>) {
        while let Some((_, bytes)) = self.script.pop_front_if(|&mut (at, _)| at <= now) {
            tx.extend(bytes);
        }
    }

    fn receive(&mut self, now: Nanos, byte: Result<u8, LineFault>) {
        self.received.push((now, byte));
    }

    fn power(&mut self, _now: Nanos, on: bool) {
        self.powered.push(on);
    }
}

/// Runs the node's side until it ends, for at most 100 s.
fn with<E: Ecu, T>(plug: &Plug<E>, node: impl Future<Output = T>) -> T {
    let both = async {
        match select(node, plug.run()).await {
            Either::First(result) => result,
            Either::Second(never) => match never {},
        }
    };
    clock::run_for(both, Duration::from_secs(100)).expect("the node's side never ended")
}

async fn read_n(rx: &mut WireRx, n: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut buf = [0; 64];
    while bytes.len() < n {
        let got = rx.read(&mut buf).await.unwrap();
        bytes.extend(&buf[..got]);
    }
    bytes
}

/// Bytes that arrive within `ms`.
async fn read_for(rx: &mut WireRx, ms: u64) -> Vec<Result<u8, WireError>> {
    let mut bytes = Vec::new();
    let mut buf = [0; 64];
    let mut end = core::pin::pin!(Timer::after_millis(ms));
    loop {
        match select(rx.read(&mut buf), &mut end).await {
            Either::First(Ok(n)) => bytes.extend(buf[..n].iter().map(|&byte| Ok(byte))),
            Either::First(Err(error)) => bytes.push(Err(error)),
            Either::Second(()) => return bytes,
        }
    }
}

#[test]
fn each_byte_arrives_at_the_first_tick_after_its_stop_bit() {
    clock::reset();
    let (mut rx, _tx, plug) = connect(Scripted::sends(MILLIS, &[1, 2, 3, 4, 5, 6]), Line::n1(2400), 0);
    let times = with(&plug, async {
        let mut times = Vec::new();
        let mut buf = [0; 16];
        for expected in 1..=6 {
            // The reader is woken at every byte: never two at once.
            assert_eq!(rx.read(&mut buf).await, Ok(1));
            assert_eq!(buf[0], expected);
            times.push(clock::now_ns());
        }
        times
    });
    // 1 ms + n * 4.1666.. ms, rounded up to the µs.
    assert_eq!(times, [5_167_000, 9_334_000, 13_500_000, 17_667_000, 21_834_000, 26_000_000]);
}

#[test]
fn write_returns_at_once_and_flush_at_the_last_stop_bit() {
    clock::reset();
    let (_rx, mut tx, plug) = connect(Scripted::default(), Line::n1(9600), 0);
    with(&plug, async {
        Timer::after_millis(3).await;
        tx.write_all(&[0xFF, 0x14, 0x64, 0xD3]).await.unwrap();
        assert_eq!(clock::now_ns(), 3_000_000);
        tx.flush().await.unwrap();
        assert_eq!(clock::now_ns(), 7_167_000); // 40 bits at 9600 baud are 4166.6 µs
    });
    let received = plug.ecu(|ecu| core::mem::take(&mut ecu.received));
    let expected = [(4_041_667, 0xFF), (5_083_333, 0x14), (6_125_000, 0x64), (7_166_667, 0xD3)];
    assert_eq!(received, expected.map(|(at, byte)| (at, Ok(byte))));
}

#[test]
fn two_stop_bits_take_longer() {
    clock::reset();
    let (_rx, mut tx, plug) = connect(Scripted::default(), Line::n2(9600), 0);
    with(&plug, async {
        tx.write_all(&[0; 4]).await.unwrap();
        tx.flush().await.unwrap();
    });
    assert_eq!(clock::now_ns(), 4_584_000); // 44 bits
}

#[test]
fn a_full_ring_blocks_the_writer_until_a_byte_has_left_it() {
    clock::reset();
    let (_rx, mut tx, plug) = connect(Scripted::default(), Line::n1(9600), 0);
    with(&plug, async {
        assert_eq!(tx.write(&[7; 100]).await, Ok(64));
        // One byte goes to the shifter at once, so one more has room before any was sent.
        assert_eq!(tx.write(&[8; 100]).await, Ok(1));
        assert_eq!(clock::now_ns(), 0);
        assert_eq!(tx.write(&[9; 100]).await, Ok(1));
        assert_eq!(clock::now_ns(), 1_042_000);
        tx.flush().await.unwrap();
    });
    assert_eq!(clock::now_ns(), 68_750_000); // 66 bytes back to back
}

#[test]
fn a_flush_with_nothing_to_send_ends_at_once() {
    clock::reset();
    let (_rx, mut tx, plug) = connect(Scripted::default(), Line::n1(2400), 0);
    with(&plug, async { tx.flush().await.unwrap() });
    assert_eq!(clock::now_ns(), 0);
}

#[test]
fn both_directions_at_once_do_not_disturb_each_other() {
    clock::reset();
    let (mut rx, mut tx, plug) = connect(Scripted::sends(0, b"down"), Line::n1(4800), 0);
    with(&plug, async {
        let up = async {
            tx.write_all(b"up").await.unwrap();
            tx.flush().await.unwrap();
            assert_eq!(clock::now_ns(), 4_167_000);
        };
        let (_, down) = join(up, read_n(&mut rx, 4)).await;
        assert_eq!(down, b"down");
        assert_eq!(clock::now_ns(), 8_334_000);
    });
    assert_eq!(plug.ecu(|ecu| ecu.bytes_received()), b"up");
}

#[test]
fn a_clean_line_changes_nothing_in_100_000_bytes() {
    clock::reset();
    let sent: Vec<u8> = (0..100_000_u32).map(|i| (i * 7 + i / 256) as u8).collect();
    let (mut rx, mut tx, plug) = connect(Scripted::sends(0, &sent), Line::n1(115_200), 3);
    with(&plug, async {
        let (_, received) =
            join(async { tx.write_all(&sent).await.unwrap() }, read_n(&mut rx, sent.len())).await;
        assert!(received == sent);
        tx.flush().await.unwrap();
    });
    assert!(plug.ecu(|ecu| ecu.bytes_received()) == sent);
    // A million bits at 115 200 baud: not 1 µs of error accumulated over 100 000 bytes.
    assert_eq!(clock::now_ns().div_ceil(MILLIS), 8681);
}

/// Sends 10 000 bytes to the node over a line with these faults; returns what arrived, and the record.
fn through(faults: Faults, framing: FramingAs, seed: u64) -> (Vec<Result<u8, WireError>>, Vec<Entry>) {
    clock::reset();
    let sent: Vec<u8> = (0..10_000_u32).map(|i| i as u8).collect();
    let (mut rx, _tx, plug) = connect(Scripted::sends(0, &sent), Line::n1(115_200), seed);
    plug.set_faults(faults, Faults::default());
    plug.framing(framing);
    plug.record(true);
    let received = with(&plug, read_for(&mut rx, 2000));
    let log = plug.take_log();
    let in_order: Vec<u8> = log.iter().filter(|e| e.fate != Fate::Added).map(|e| e.byte).collect();
    assert!(in_order == sent, "the record holds what was sent, not what became of it");
    (received, log)
}

fn count(log: &[Entry], what: impl Fn(Fate) -> bool) -> usize {
    log.iter().filter(|entry| what(entry.fate)).count()
}

#[test]
fn lost_bytes_are_lost() {
    let (received, log) =
        through(Faults { lose_per_million: 50_000, ..Faults::default() }, FramingAs::Error, 1);
    let lost = count(&log, |fate| fate == Fate::Lost);
    assert!((400..600).contains(&lost), "{lost}");
    assert_eq!(received.len(), 10_000 - lost);
    assert_eq!(count(&log, |fate| fate == Fate::Delivered), received.len());
}

#[test]
fn added_bytes_are_added() {
    let (received, log) =
        through(Faults { add_per_million: 50_000, ..Faults::default() }, FramingAs::Error, 1);
    let added = count(&log, |fate| fate == Fate::Added);
    assert!((400..600).contains(&added), "{added}");
    assert_eq!(received.len(), 10_000 + added);
}

#[test]
fn flipped_bits_change_bytes() {
    let (received, log) =
        through(Faults { flip_per_million: 10_000, ..Faults::default() }, FramingAs::Error, 1);
    assert_eq!(received.len(), 10_000);
    let flipped = count(&log, |fate| matches!(fate, Fate::Flipped(_)));
    assert!((650..900).contains(&flipped), "{flipped}"); // 1 - 0.99^8 = 7.7 %
    for (entry, received) in log.iter().zip(&received) {
        match entry.fate {
            Fate::Delivered => assert_eq!(*received, Ok(entry.byte)),
            Fate::Flipped(value) => {
                assert_eq!(*received, Ok(value));
                assert_ne!(value, entry.byte);
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn framing_errors_are_errors_or_wrong_data() {
    let faults = Faults { framing_per_million: 50_000, ..Faults::default() };
    let (received, log) = through(faults, FramingAs::Error, 1);
    let broken = count(&log, |fate| matches!(fate, Fate::Framing(_)));
    assert!((400..600).contains(&broken), "{broken}");
    assert_eq!(received.iter().filter(|byte| **byte == Err(WireError::Framing)).count(), broken);
    assert_eq!(received.len(), 10_000);
    assert_eq!(WireError::Framing.kind(), ErrorKind::InvalidData);

    let (received, log) = through(faults, FramingAs::Data, 1);
    for (entry, received) in log.iter().zip(&received) {
        match entry.fate {
            Fate::Framing(value) => assert_eq!(*received, Ok(value)),
            _ => assert_eq!(*received, Ok(entry.byte)),
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_faults() {
    assert!(through(Faults::NOISY, FramingAs::Error, 5) == through(Faults::NOISY, FramingAs::Error, 5));
    assert!(through(Faults::NOISY, FramingAs::Error, 5) != through(Faults::NOISY, FramingAs::Error, 6));
}

#[test]
fn delay_and_jitter_shift_arrivals_and_keep_the_order() {
    clock::reset();
    let (mut rx, _tx, plug) = connect(Scripted::sends(0, &[1, 2]), Line::n1(9600), 0);
    plug.set_faults(Faults { delay_ns: 5 * MILLIS, ..Faults::default() }, Faults::default());
    with(&plug, async {
        read_n(&mut rx, 1).await;
        assert_eq!(clock::now_ns(), 6_042_000);
        read_n(&mut rx, 1).await;
        assert_eq!(clock::now_ns(), 7_084_000);
    });

    let (received, _) = through(Faults { jitter_ns: 50 * MILLIS, ..Faults::default() }, FramingAs::Error, 4);
    assert!(received.iter().enumerate().all(|(i, byte)| *byte == Ok(i as u8)));
}

#[test]
fn faults_towards_the_ecu_reach_the_ecu_only() {
    clock::reset();
    let (mut rx, mut tx, plug) = connect(Scripted::sends(0, &[1, 2, 3]), Line::n1(9600), 0);
    plug.set_faults(Faults::default(), Faults { framing_per_million: 1_000_000, ..Faults::default() });
    with(&plug, async {
        tx.write_all(&[4, 5]).await.unwrap();
        assert_eq!(read_n(&mut rx, 3).await, [1, 2, 3]);
    });
    let received = plug.ecu(|ecu| ecu.received.clone());
    assert_eq!(received, [(1_041_667, Err(LineFault::Framing)), (2_083_333, Err(LineFault::Framing))]);
}

#[test]
fn a_cut_loses_both_ways_and_the_byte_under_way() {
    clock::reset();
    let (mut rx, mut tx, plug) = connect(Scripted::sends(0, &[1, 2, 3, 4, 5, 6]), Line::n1(9600), 0);
    let received = with(&plug, async {
        tx.write_all(&[1, 2, 3, 4, 5, 6]).await.unwrap();
        let cutter = async {
            Timer::after_micros(1500).await; // in the middle of the second byte
            plug.cut(true);
            Timer::after_micros(2000).await; // in the middle of the fourth
            plug.cut(false);
        };
        let (_, received) = join(cutter, read_for(&mut rx, 50)).await;
        // The UART itself noticed nothing.
        tx.flush().await.unwrap();
        received
    });
    assert_eq!(received, [Ok(1), Ok(5), Ok(6)]);
    assert_eq!(plug.ecu(|ecu| ecu.bytes_received()), [1, 5, 6]);
}

#[test]
fn one_wire_is_cut_and_the_other_is_not() {
    for (direction, to_node, to_ecu) in
        [(Direction::ToNode, vec![], vec![1, 2, 3]), (Direction::ToEcu, vec![Ok(1), Ok(2), Ok(3)], vec![])]
    {
        clock::reset();
        let (mut rx, mut tx, plug) = connect(Scripted::sends(0, &[1, 2, 3]), Line::n1(9600), 0);
        plug.cut_one(direction, true);
        let received = with(&plug, async {
            tx.write_all(&[1, 2, 3]).await.unwrap();
            read_for(&mut rx, 50).await
        });
        assert_eq!(received, to_node);
        assert_eq!(plug.ecu(|ecu| ecu.bytes_received()), to_ecu);
    }
}

#[test]
fn another_ecu_is_plugged_in_and_sends_from_then_on() {
    clock::reset();
    let (mut rx, _tx, plug) = connect(Scripted::sends(0, &[1, 2, 3, 4]), Line::n1(9600), 0);
    let received = with(&plug, async {
        let change = async {
            Timer::after_micros(1500).await; // in the middle of the second byte
            let next = Scripted::sends(clock::now_ns() + 5_000_000, &[7, 8]);
            let before = plug.replace_ecu(next);
            assert!(before.next_wake() > clock::now_ns());
        };
        join(change, read_for(&mut rx, 50)).await.1
    });
    assert_eq!(received, [Ok(1), Ok(7), Ok(8)]);
}

#[test]
fn a_stalled_transmitter_holds_writes_and_flushes_until_it_continues() {
    clock::reset();
    let (_rx, mut tx, plug) = connect(Scripted::default(), Line::n1(9600), 0);
    with(&plug, async {
        tx.write_all(&[1, 2, 3]).await.unwrap();
        Timer::after_micros(500).await;
        plug.stall_tx(true);
        assert!(matches!(select(tx.flush(), Timer::after_secs(1)).await, Either::Second(())));
        assert_eq!(plug.ecu(|ecu| ecu.bytes_received()), [1], "the byte in the shifter goes out");
        // The ring takes only as much as it has room for.
        let full = async { while tx.write(&[9; 100]).await.is_ok() {} };
        assert!(matches!(select(full, Timer::after_secs(1)).await, Either::Second(())));
        assert_eq!(plug.ecu(|ecu| ecu.bytes_received()), [1]);
        plug.stall_tx(false);
        tx.flush().await.unwrap();
    });
    let received = plug.ecu(|ecu| ecu.bytes_received());
    assert_eq!(received[..3], [1, 2, 3]);
    assert!(received.len() > 3 && received[3..].iter().all(|byte| *byte == 9), "{received:?}");
}

#[test]
fn echo_gives_the_node_its_own_bytes() {
    clock::reset();
    let (mut rx, mut tx, plug) = connect(Scripted::default(), Line::n1(9600), 0);
    plug.echo(true);
    with(&plug, async {
        tx.write_all(&[5, 6]).await.unwrap();
        assert_eq!(read_n(&mut rx, 2).await, [5, 6]);
        assert_eq!(clock::now_ns(), 2_084_000);
        plug.echo(false);
        tx.write_all(&[7]).await.unwrap();
        assert_eq!(read_for(&mut rx, 100).await, []);
    });
    assert_eq!(plug.ecu(|ecu| ecu.bytes_received()), [5, 6, 7]);
}

#[test]
fn babble_fills_the_line_without_a_pause() {
    clock::reset();
    let (mut rx, mut tx, plug) = connect(Scripted::sends(10 * MILLIS, b"frame"), Line::n1(9600), 0);
    with(&plug, async {
        plug.babble(Some(Babble::Repeat(vec![0xFF, 0x0C])));
        let received = read_for(&mut rx, 1001).await;
        assert_eq!(received.len(), 960);
        assert!(received.iter().zip([0xFF, 0x0C].iter().cycle()).all(|(a, b)| *a == Ok(*b)));
        tx.write_all(&[1]).await.unwrap();
        plug.babble(Some(Babble::Random));
        assert_eq!(read_for(&mut rx, 100).await.len(), 96);
        plug.babble(None);
        assert!(read_for(&mut rx, 100).await.len() <= 1, "only the byte under way");
    });
    assert_eq!(plug.ecu(|ecu| ecu.bytes_received()), [1]);
}

#[test]
fn ends_that_are_set_differently_understand_nothing() {
    clock::reset();
    let ecu = Scripted::sends(0, &[1, 2, 3]);
    let (mut rx, mut tx, plug) = connect_mismatched(ecu, Line::n1(9600), Line::n1(4800), 0);
    plug.framing(FramingAs::Error);
    let received = with(&plug, async {
        tx.write_all(&[1, 2]).await.unwrap();
        read_for(&mut rx, 50).await
    });
    assert_eq!(received, [Err(WireError::Framing); 3]);
    assert_eq!(plug.ecu(|ecu| ecu.received.len()), 2);
    assert_eq!(plug.ecu(|ecu| ecu.bytes_received()), []);
}

#[test]
fn a_reader_that_sleeps_loses_bytes_as_on_hardware() {
    clock::reset();
    let (mut rx, _tx, plug) = connect(Scripted::sends(0, &[1; 300]), Line::n1(115_200), 0);
    with(&plug, async {
        Timer::after_millis(100).await;
        assert_eq!(read_for(&mut rx, 10).await.len(), 256);
    });
    assert_eq!(plug.overruns(), 44);
}

#[test]
fn losing_power_ends_the_frame() {
    clock::reset();
    let (mut rx, _tx, plug) = connect(Scripted::sends(0, &[1, 2, 3, 4]), Line::n1(9600), 0);
    let received = with(&plug, async {
        Timer::after_micros(1500).await;
        plug.power(false);
        read_for(&mut rx, 50).await
    });
    assert_eq!(received, [Ok(1)]);
    assert_eq!(plug.ecu(|ecu| ecu.powered.clone()), [false]);
}

#[test]
fn injected_bytes_take_their_time() {
    clock::reset();
    let (mut rx, _tx, plug) = connect(Scripted::default(), Line::n1(9600), 0);
    with(&plug, async {
        plug.inject_to_node(&[1, 2]);
        plug.inject_to_ecu(&[3]);
        assert_eq!(read_n(&mut rx, 2).await, [1, 2]);
    });
    assert_eq!(clock::now_ns(), 2_084_000);
    assert_eq!(plug.ecu(|ecu| ecu.bytes_received()), [3]);
}

#[test]
fn in_real_time_bytes_take_their_time() {
    clock::reset();
    clock::set_pace(clock::Pace::RealTime);
    let (mut rx, mut tx, plug) =
        connect(Scripted::sends(10 * MILLIS, &[1, 2, 3, 4, 5, 6]), Line::n1(2400), 0);
    let real = std::time::Instant::now();
    let node = async {
        tx.write_all(&[7; 5]).await.unwrap();
        assert_eq!(read_n(&mut rx, 6).await, [1, 2, 3, 4, 5, 6]);
    };
    assert!(clock::run_for(select(node, plug.run()), Duration::from_secs(20)).is_some());
    assert!(real.elapsed().as_millis() >= 33, "10 ms and six bytes of 4.17 ms, at most 2 ms ahead");
    let received = plug.ecu(|ecu| ecu.received.clone());
    // However late the host was scheduled, bytes follow each other as on a line.
    assert!(received.windows(2).all(|pair| (4_166_666..=4_166_667).contains(&(pair[1].0 - pair[0].0))));
    assert_eq!(received.len(), 5);
}
