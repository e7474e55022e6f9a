use super::super::engines::engines;
use super::*;
use jetlink::units::{Rpm, Throttle};

fn entries(at: Nanos, bytes: &[u8]) -> Vec<Entry> {
    let length = MILLIS / 10;
    (0..)
        .zip(bytes)
        .map(|(i, &byte)| Entry {
            direction: Direction::ToEcu,
            byte,
            start: at + i * length,
            end: at + (i + 1) * length,
            fate: Fate::Lost,
        })
        .collect()
}

fn audit(index: usize) -> Audit {
    Audit::new(&engines(&[]).unwrap()[index])
}

fn zk(high: u8, low: u8) -> [u8; 4] {
    [0xFF, high, low, sim::zk::crc8(&[high, low])]
}

#[test]
fn an_amt_reply_is_what_was_ordered() {
    let run = Order::Run(Demand::Throttle(Throttle::from_percent(50).unwrap()));
    let (standby, half, idle) =
        ([0xFF, 0x12, 32, 0x12, 32], [0xFF, 0x14, 132, 0x14, 132], [0xFF, 0x14, 32, 0x14, 32]);
    let mut audit = audit(0);
    audit.look(&entries(0, &standby));
    audit.ordered(1000 * MILLIS, run);
    audit.look(&entries(1010 * MILLIS, &standby)); // made before
    audit.look(&entries(1100 * MILLIS, &half));
    audit.look(&entries(1200 * MILLIS, &idle)); // the start throttle
    assert_eq!((audit.frames, audit.not_given), (4, 0));
    audit.look(&entries(1300 * MILLIS, &standby)); // too old
    audit.look(&entries(1400 * MILLIS, &[0xFF, 0x14, 134, 0x14, 134]));
    audit.look(&entries(1500 * MILLIS, &[0xFF, 0x11, 32, 0x11, 32]));
    audit.look(&entries(1600 * MILLIS, &[0xFF, 0x14, 132, 0x14, 133]));
    audit.look(&entries(1700 * MILLIS, &[0xFF, 0x14]));
    audit.look(&entries(1800 * MILLIS, &half));
    assert_eq!((audit.frames, audit.not_given), (9, 5));
    assert_eq!(audit.findings[0].at, 1300 * MILLIS);
    assert!(audit.findings[4].what.starts_with("a part"), "{:?}", audit.findings);
}

#[test]
fn a_command_is_on_the_wire_while_it_is_sent() {
    // 125 ms between the sets of an AMT ECU, 20 ms between the frames of this ZK ECU.
    for (index, period, frame, command) in [
        (0, 125 * MILLIS, [0xFF, 0x14, 132, 0x14, 132].as_slice(), WireCommand::Run(500)),
        (3, 20 * MILLIS, &zk(0x18, 0), WireCommand::Standby),
    ] {
        let mut audit = audit(index);
        assert_eq!(audit.on_wire_now(0), None);
        audit.look(&entries(1000 * MILLIS, frame));
        let end = 1000 * MILLIS + frame.len() as Nanos * MILLIS / 10;
        assert_eq!(audit.on_wire_now(end), Some(command));
        assert_eq!(audit.on_wire_now(end + 3 * period), Some(command));
        assert_eq!(audit.on_wire_now(end + 3 * period + 1), None);
    }
    // Frames that keep the ECU alive, without a command.
    let mut audit = audit(3);
    audit.look(&entries(0, &zk(0x18, 0)));
    audit.look(&entries(100 * MILLIS, &zk(0, 0)));
    assert_eq!(audit.on_wire_now(101 * MILLIS), Some(WireCommand::Nothing));
    assert_eq!(audit.on_wire_now(500 * MILLIS), None);
}

#[test]
fn a_zk_frame_is_what_was_ordered() {
    let mut audit = audit(3); // 50 Hz, version 5, by rpm; its RPM_X is 4
    for (frame, allowed) in [
        (zk(0x00, 0), true),
        (zk(0x20, 8), true),
        (zk(0x20, 7), false),
        (zk(0x18, 0), true),
        (zk(0x18, 1), false),
        (zk(0x14, 0), false),
        (zk(0x60, 2), true),
        (zk(0x60, 0x13), false),
        (zk(0x30, 0), false),
        ([0xFF, 0x18, 0, 0], false),
    ] {
        let before = audit.not_given;
        audit.look(&entries(MILLIS, &frame));
        assert_eq!(audit.not_given == before, allowed, "{frame:02X?}");
    }
    audit.ordered(1000 * MILLIS, Order::Run(Demand::Rpm(Rpm::new(100_000))));
    for (frame, allowed) in [
        (zk(0x60, 0x13), true),
        (zk(0x60, 0x12), false),
        (zk(0x60, 0x17), false),
        (zk(0x79, 0xC4), true),  // 2500
        (zk(0x74, 0xE2), true),  // 1250: idle
        (zk(0x79, 0xC5), false), // 2501
        (zk(0x18, 0), false),
    ] {
        let before = audit.not_given;
        audit.look(&entries(2000 * MILLIS, &frame));
        assert_eq!(audit.not_given == before, allowed, "{frame:02X?}");
    }
}

/// Bytes of a ZK ECU as the node receives them.
fn zk_status(at: Nanos, head: u8, data: [u8; 5]) -> Vec<Entry> {
    let bytes = [&[head], &data[..]].concat();
    let sealed = [&bytes[..], &[sim::zk::crc8(&bytes)]].concat();
    let arrives = |entry: Entry| Entry { direction: Direction::ToNode, fate: Fate::Delivered, ..entry };
    entries(at, &sealed).into_iter().map(arrives).collect()
}

/// docs/failsafe.md: a pump that is found with a voltage at rest is closed, also where noise has made the voltage.
#[test]
fn a_pump_is_closed_only_after_a_status_that_shows_a_voltage_at_rest() {
    let close = |at| entries(at, &zk(0x20, 13));
    let shown = zk_status(1000 * MILLIS, 0xF2, [0, 0, 0, 56, 55]);
    let none = zk_status(1000 * MILLIS, 0xF2, [0, 0, 0, 56, 0]);
    // As sent, and as damaged, with a CRC that fits.
    let damaged = || none.clone().map_fate(|i| Fate::Flipped(shown[i].byte));
    let flipped = |place: usize, fate: Fate| {
        shown.clone().map_fate(|i| if i == place { fate } else { Fate::Delivered })
    };
    for (status, allowed) in [
        (shown.clone(), true),
        (damaged(), true),
        (shown.clone().map_fate(|_| Fate::Added), true),
        (Vec::new(), false),
        (none.clone(), false),
        // In another status it is the ignition pump's.
        (zk_status(1000 * MILLIS, 0xF5, [0, 0, 0, 56, 55]), false),
        (flipped(5, Fate::Flipped(54)), false),
        (flipped(2, Fate::Lost), false),
        (flipped(2, Fate::Framing(0)), false),
    ] {
        let mut audit = audit(3);
        audit.look(&close(900 * MILLIS));
        assert_eq!(audit.not_given, 1, "before any status");
        audit.look(&status);
        audit.look(&close(1100 * MILLIS));
        audit.look(&close(2100 * MILLIS));
        assert_eq!(audit.not_given == 1, allowed, "{status:?}: {:?}", audit.findings);
        let before = audit.not_given;
        audit.look(&close(9000 * MILLIS));
        audit.look(&entries(9100 * MILLIS, &zk(0x20, 12)));
        assert_eq!(audit.not_given, before + 2, "long after it; and nothing opens a pump");
    }
    // The voltage of a running engine.
    let mut running = audit(3);
    running.see_engine(900 * MILLIS, Phase::Running);
    running.look(&shown);
    running.look(&close(1100 * MILLIS));
    assert_eq!(running.not_given, 1);
    // A run that is ordered after it.
    let mut ordered = audit(3);
    ordered.look(&shown);
    ordered.ordered(1050 * MILLIS, Order::Run(Demand::Rpm(Rpm::new(100_000))));
    ordered.looked_until(1200 * MILLIS);
    ordered.look(&close(1300 * MILLIS));
    assert_eq!(ordered.not_given, 1);
}

#[test]
fn a_run_that_only_the_ecu_has_received_is_misread() {
    let (standby, run) = (zk(0x18, 0), zk(0x1C, 0));
    let mut audit = audit(2);
    audit.look(&entries(1000 * MILLIS, &run).map_fate(|_| Fate::Delivered));
    assert!(!audit.is_misread(1001 * MILLIS), "the node has sent it");
    audit.look(&entries(1100 * MILLIS, &standby).map_fate(|i| match run[i] == standby[i] {
        true => Fate::Delivered,
        false => Fate::Flipped(run[i]),
    }));
    assert!(audit.is_misread(1101 * MILLIS) && !audit.is_misread(1099 * MILLIS));
    assert!(!audit.is_misread(1201 * MILLIS), "whatever was lit later, was not lit by it");
}

trait MapFate {
    /// What became of each byte.
    fn map_fate(self, fate: impl Fn(usize) -> Fate) -> Self;
}

impl MapFate for Vec<Entry> {
    fn map_fate(mut self, fate: impl Fn(usize) -> Fate) -> Self {
        self.iter_mut().enumerate().for_each(|(i, entry)| entry.fate = fate(i));
        self
    }
}

#[test]
fn the_cadence_is_that_of_the_turns() {
    // A frame sent before its slot does not shift the slots.
    let mut ahead = audit(3);
    ahead.look(&entries(0, &zk(0x60, 0x13)));
    ahead.look(&entries(MILLIS / 2, &zk(0x74, 0xE2))); // the speed, right after its switch
    ahead.look(&entries(20 * MILLIS, &zk(0x60, 0x13)));
    ahead.look(&entries(33 * MILLIS, &zk(0x14, 0))); // an emergency stop
    ahead.look(&entries(40 * MILLIS, &zk(0x14, 0)));
    assert_eq!(ahead.worst_cadence_error, Some(0));
    // The slot after it is late.
    ahead.look(&entries(63 * MILLIS, &zk(0x14, 0)));
    assert_eq!(ahead.worst_cadence_error, Some(3 * MILLIS));
    // Nothing else may be early.
    ahead.look(&entries(76 * MILLIS, &zk(0x14, 0)));
    assert_eq!(ahead.worst_cadence_error, Some(7 * MILLIS));
    // A late stop is late.
    let mut late = audit(3);
    late.look(&entries(0, &zk(0, 0)));
    late.look(&entries(29 * MILLIS, &zk(0x14, 0)));
    assert_eq!(late.worst_cadence_error, Some(9 * MILLIS));
}

fn from_ecu(at: Nanos, fate: Fate) -> Vec<Entry> {
    (0..6)
        .map(|i| Entry {
            direction: Direction::ToNode,
            byte: 0,
            start: at + i * MILLIS,
            end: at + (i + 1) * MILLIS,
            fate,
        })
        .collect()
}

/// An AMT engine at 60 %, whose ECU sends every 125 ms from 1 s to 20 s.
fn in_flight() -> Audit {
    let mut audit = audit(0);
    let sixty = Order::Run(Demand::Throttle(Throttle::from_percent(60).unwrap()));
    for n in 0..153 {
        let at = SECOND + n * 125 * MILLIS;
        if n == 10 {
            audit.ordered(at, sixty);
        }
        audit.look(&from_ecu(at, Fate::Delivered));
        let half_percent = if n < 10 { 0x20 } else { 0x20 + 120 };
        let ops = if n < 10 { 0x12 } else { 0x14 };
        audit.look(&entries(at + 10 * MILLIS, &[0xFF, ops, half_percent, ops, half_percent]));
    }
    audit.see_engine(20 * SECOND, Phase::Running);
    assert_eq!(audit.not_given, 0, "{:?}", audit.findings);
    audit
}

fn amt_run(half_percent: u8) -> [u8; 5] {
    [0xFF, 0x14, 0x20 + half_percent, 0x14, 0x20 + half_percent]
}

#[test]
fn a_demand_rises_at_its_rate_and_after_a_gap_only() {
    let full = Order::Run(Demand::Throttle(Throttle::from_percent(100).unwrap()));
    // 125 ms are 6.25 %, and 1.25 % more because a frame was computed before its first bit.
    for (gap, half_percent, allowed) in
        [(true, 134, true), (true, 120, true), (true, 137, false), (true, 118, false), (false, 134, false)]
    {
        let mut audit = in_flight();
        let back = 20 * SECOND + if gap { 375 } else { 125 } * MILLIS;
        let last = amt_run(120);
        if gap {
            // The reply comes late relative to the order.
            audit.look(&from_ecu(back, Fate::Delivered));
            audit.look(&entries(back + 10 * MILLIS, &last));
        }
        audit.ordered(back, full);
        audit.look(&from_ecu(back + 125 * MILLIS, Fate::Delivered));
        audit.look(&entries(back + 135 * MILLIS, &amt_run(half_percent)));
        assert_eq!(audit.not_given == 0, allowed, "{gap}, {half_percent}: {:?}", audit.findings);
    }
}

#[test]
fn a_rise_ends_with_the_commanded_demand() {
    let demand = |percent| Order::Run(Demand::Throttle(Throttle::from_percent(percent).unwrap()));
    let mut audit = in_flight();
    audit.reset(20 * SECOND + 50 * MILLIS);
    audit.look(&from_ecu(20 * SECOND + 125 * MILLIS, Fate::Delivered));
    audit.look(&entries(20 * SECOND + 135 * MILLIS, &amt_run(120)));
    audit.ordered(20 * SECOND + 200 * MILLIS, demand(65));
    for (n, half_percent) in [(2, 126), (3, 130)] {
        audit.look(&from_ecu(20 * SECOND + n * 125 * MILLIS, Fate::Delivered));
        audit.look(&entries(20 * SECOND + n * 125 * MILLIS + 10 * MILLIS, &amt_run(half_percent)));
    }
    assert_eq!(audit.not_given, 0, "{:?}", audit.findings);
    audit.ordered(20 * SECOND + 450 * MILLIS, demand(100));
    audit.look(&entries(20 * SECOND + 510 * MILLIS, &amt_run(136)));
    assert_eq!(audit.not_given, 1);
}

#[test]
fn a_run_is_cancelled_only_where_the_engine_has_stopped_or_fell_silent_in_its_start() {
    let now = 20 * SECOND + 100 * MILLIS;
    for (phase, allowed) in
        [(Phase::Running, false), (Phase::FuelRamp, false), (Phase::Cooling, true), (Phase::Stopped, true)]
    {
        let mut audit = in_flight();
        audit.commanded(now);
        audit.cancelled(now, phase);
        assert_eq!(audit.not_given == 0, allowed, "{phase:?}: {:?}", audit.findings);
    }
    for (phase, commanded_at, allowed) in [
        (Phase::FuelRamp, now, true),
        (Phase::Running, now, false),
        // No source has commanded for long.
        (Phase::Running, now - 10 * SECOND, true),
    ] {
        let mut audit = in_flight();
        audit.commanded(commanded_at);
        audit.cancelled(now + 2 * SECOND, phase);
        assert_eq!(audit.not_given == 0, allowed, "{phase:?}: {:?}", audit.findings);
    }
    // An engine that stopped a moment ago and is lit again.
    let mut relit = in_flight();
    relit.see_engine(now, Phase::Cooling);
    relit.cancelled(now + SECOND, Phase::Ignition);
    assert_eq!(relit.not_given, 0, "{:?}", relit.findings);
    let mut later = in_flight();
    later.commanded(now);
    later.see_engine(now - 4 * SECOND, Phase::Cooling);
    later.cancelled(now, Phase::Ignition);
    assert_eq!(later.not_given, 1);
}

#[test]
fn an_engine_is_known_to_run_when_its_ecu_has_reported_it() {
    let mut audit = in_flight();
    assert!(!audit.is_known_to_run());
    for (ms, phase, known) in [
        (100, Phase::Running, false),
        // Nothing is received meanwhile.
        (3200, Phase::Running, false),
        (4200, Phase::FuelRamp, false),
    ] {
        audit.see_engine(20 * SECOND + ms * MILLIS, phase);
        assert_eq!(audit.is_known_to_run(), known, "{ms} ms, {phase:?}");
    }
    for eighth in 0..40 {
        let at = 25 * SECOND + eighth * 125 * MILLIS;
        audit.look(&from_ecu(at, Fate::Delivered));
        audit.see_engine(at + 10 * MILLIS, Phase::Running);
    }
    assert!(audit.is_known_to_run());
    // A gap does not change that; a stop does.
    audit.see_engine(40 * SECOND, Phase::Running);
    assert!(audit.is_known_to_run());
    audit.see_engine(41 * SECOND, Phase::Cooling);
    assert!(!audit.is_known_to_run());
}

#[test]
fn an_order_is_given_up_only_where_the_ecu_fell_silent() {
    let mut received = in_flight();
    received.given_up(20 * SECOND + 50 * MILLIS);
    assert_eq!(received.not_given, 1);
    let mut silent = in_flight();
    silent.given_up(24 * SECOND);
    assert_eq!(silent.not_given, 0);
    // Nothing reports it at rest: the node must not order standby.
    silent.look(&entries(24 * SECOND + 100 * MILLIS, &[0xFF, 0x12, 0x20, 0x12, 0x20]));
    assert_eq!(silent.not_given, 1);
}

#[test]
fn damaged_sets_without_a_checksum_count_as_a_gap_and_damaged_frames_with_one_do_not() {
    for (engine, gap) in [(0, true), (2, false)] {
        let mut audit = audit(engine);
        audit.look(&from_ecu(SECOND, Fate::Delivered));
        audit.look(&from_ecu(SECOND + 40 * MILLIS, Fate::Delivered));
        audit.received.gap = None;
        audit.look(&from_ecu(SECOND + 80 * MILLIS, Fate::Flipped(1)));
        audit.received.find_gap(SECOND + 120 * MILLIS);
        assert_eq!(audit.received.gap.is_some(), gap);
        audit.received.find_gap(SECOND + 120 * MILLIS + 3 * 125 * MILLIS);
        assert!(audit.received.gap.is_some());
    }
}

#[test]
fn orders_are_forgotten_when_they_no_longer_matter() {
    let mut audit = audit(0);
    for i in 0..10_000_u16 {
        let at = u64::from(i) * 100 * MILLIS;
        let throttle = Throttle::from_tenths(i % 1000).unwrap();
        audit.ordered(at, Order::Run(Demand::Throttle(throttle)));
        audit.looked_until(at);
    }
    assert!(audit.orders.len() < 10);
}
