//! The cadence: one frame in each send slot.

use super::*;

/// ZK-10: a frame is sent in every slot, ID 0 when nothing is ordered, even if nothing is received. ZK-11: the
/// slots keep the status rate to the tick.
#[test]
fn zk_10_zk_11_a_frame_is_sent_in_every_send_slot() {
    for (rate, every) in [(Rate::Hz20, 50_000), (Rate::Hz50, 20_000), (Rate::Hz100, 10_000)] {
        let mut bench = link(Config { rate, ..Config::DEFAULT }, LINE);
        bench.run_to_us(10_000_000);
        let expected: Vec<_> =
            (0..=10_000_000 / every).map(|slot| (slot * every, zk::keep_alive().to_vec())).collect();
        assert_eq!(bench.frames(), expected, "{rate:?}");
        let counters = bench.machine.status().counters;
        assert_eq!(counters.send_slots_missed, 0);
        assert_eq!(counters.worst_slot_delay.map(|delay| delay.as_micros()), Some(0));
    }
}

/// ZK-10: a late slot is not made up for, and the schedule stays.
#[test]
fn zk_10_a_late_send_slot_causes_no_burst() {
    // Wake-up this late; then the times of the next two slots.
    for (late, next) in [(1, [100_000, 150_000]), (30_000, [100_000, 150_000]), (49_000, [100_000, 150_000])]
    {
        let mut bench = link(Config::DEFAULT, Line::new(115_200));
        bench.run_to_us(40_000);
        bench.frames();
        bench.timeout_at_us(SEND_SLOT_US + late);
        bench.run_to_us(160_000);
        let at: Vec<u64> = bench.frames().into_iter().map(|(at, _)| at).collect();
        assert_eq!(at, [&[SEND_SLOT_US + late][..], &next].concat(), "{late}");
        let worst = bench.machine.status().counters.worst_slot_delay.map(|delay| delay.as_micros());
        assert_eq!(worst, Some(late));
    }
    // After slots that are over altogether: one now, the next within one interval, none in between.
    for late in [50_000, 75_000, 1_000_000, 3_333_333] {
        let mut bench = link(Config::DEFAULT, LINE);
        bench.run_to_us(40_000);
        bench.frames();
        let woken = SEND_SLOT_US + late;
        bench.timeout_at_us(woken);
        bench.run_to_us(woken + 500_000);
        let at: Vec<u64> = bench.frames().into_iter().map(|(at, _)| at).collect();
        assert_eq!(at[0], woken);
        assert!(at[1] > woken && at[1] <= woken + SEND_SLOT_US, "{late}: {at:?}");
        assert!(at[1..].iter().all(|at| at % SEND_SLOT_US == 0), "the beat stays: {late}: {at:?}");
        assert!(at.windows(2).skip(1).all(|pair| pair[1] - pair[0] == SEND_SLOT_US), "{late}: {at:?}");
        assert!((10..=11).contains(&at.len()), "{late}: {at:?}");
        // Of the slots from 50 ms to the one at or before the waking, all but one are over.
        assert_eq!(
            u64::from(bench.machine.status().counters.send_slots_missed),
            late / SEND_SLOT_US,
            "{late}"
        );
    }
}

/// A slot while the UART is still sending is skipped and counted; the next one is used.
#[test]
fn a_send_slot_while_the_uart_is_busy_is_skipped() {
    let mut bench = link(Config::DEFAULT, LINE).by_hand();
    bench.run_to_us(120_000); // the frame of slot 0 hangs
    assert_eq!(bench.frames().len(), 1);
    assert_eq!(bench.machine.status().counters.send_slots_missed, 2);
    bench.not_sent_at_us(125_000, NotSent::TimedOut);
    assert_eq!(bench.frames(), [], "not out of slot");
    bench.run_to_us(150_000);
    assert_eq!(bench.frames(), [(150_000, zk::keep_alive().to_vec())]);
    assert_eq!(bench.machine.status().counters.write_timeouts, 1);
}

/// ZK-12: on the slowest line a frame ends before the next slot.
#[test]
fn zk_12_the_slowest_line_carries_every_send_slot() {
    for line in [Line::new(2400), Line::with_two_stop_bits(2400)] {
        let mut bench = link(Config::DEFAULT, line);
        bench.order_at_us(0, Order::Standby).unwrap();
        bench.run_to_us(10_000_000);
        assert_eq!((bench.frames().len(), bench.machine.status().counters.send_slots_missed), (201, 0));
    }
}
