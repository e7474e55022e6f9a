//! The fuel valve of each engine against what goes out on its wire, at every run. An image without outputs drives none of their pins.
//! Where the valves are is written down again here and not read from the firmware, so that a difference is found.

use crate::engines::{self, Protocol};
use crate::pins::{Level, Pin};
use crate::report::Report;
use crate::wire::Wire;
use sim::any;
use sim::control::{Reader, Switch};
use sim::ecu::{MILLIS, Nanos, SECOND};
use sim::wire::{Direction, Entry, Fate};

/// A stop closes the valve within this time of its first frame.
const CLOSED_WITHIN: Nanos = 10 * MILLIS;
/// A frame that was on its way when a pin changed.
const ON_ITS_WAY: Nanos = 50 * MILLIS;
/// From a reset until the pins are driven.
const DRIVEN_WITHIN: Nanos = 20 * MILLIS;
/// An ECU is received that long after the valve opened for it, at the latest.
const RUN_WITHIN: Nanos = SECOND;

/// A switch that went out on a wire.
#[derive(Clone, Copy, Debug)]
struct Sent {
    start: Nanos,
    end: Nanos,
    switch: Switch,
}

/// Everything that is wrong. `errors`: the firmware fails as its test wants it to, and may close a valve for that.
pub(crate) fn complaints(report: &Report, errors: bool) -> Vec<String> {
    let pins = || (0..report.board.outputs.len()).map(|number| Pin::output(report, number));
    if !report.image.has_outputs() {
        let driven = pins().enumerate().filter_map(|(number, pin)| Some((number, pin.driven()?)));
        return driven
            .map(|(number, at)| format!("output {number} is driven at {at} ns, and there are no outputs"))
            .collect();
    }
    let engines = engines::of(report.board, report.image);
    let last = engines.len() - 1;
    let each = engines.into_iter().zip(pins()).enumerate().flat_map(|(number, (engine, pin))| {
        let energised = if number == last { Level::Low } else { Level::High };
        let sent = report.wires.get(engine.port).map_or(Vec::new(), |wire| switches(wire, engine.protocol));
        let resets: Vec<_> = report.resets.iter().map(|reset| reset.0).collect();
        let wrong = wrong(&pin, energised, &sent, &resets, report.at, errors);
        wrong.into_iter().map(move |text| format!("the valve of {}: {text}", engine.name))
    });
    each.collect()
}

/// The switches that the board sent.
fn switches(wire: &Wire, protocol: Protocol) -> Vec<Sent> {
    let protocol = match protocol {
        Protocol::Amt(_) => any::Protocol::Amt,
        Protocol::Zk(..) => any::Protocol::Zk,
    };
    let byte = wire.line().byte_ns(1);
    let entry = |tx: &crate::wire::Tx| Entry {
        direction: Direction::ToEcu,
        byte: tx.byte,
        start: tx.end - byte,
        end: tx.end,
        fate: Fate::Delivered,
    };
    let entries: Vec<_> = wire.tx.iter().map(entry).collect();
    let mut reader = Reader::new(protocol);
    let frames = reader.read(&entries).filter_map(|frame| {
        Some(Sent { start: frame.start, end: frame.end, switch: frame.command.ok()?.switch()? })
    });
    frames.collect()
}

fn wrong(
    pin: &Pin,
    energised: Level,
    sent: &[Sent],
    resets: &[Nanos],
    end: Nanos,
    errors: bool,
) -> Vec<String> {
    let mut wrong = Vec::new();
    let changes = pin.changes(0..end);
    let opens = || changes.iter().filter(|(_, level)| *level == energised).map(|(at, _)| *at);
    // A stop closes it, and nothing opens it until another order goes out, a reset neither.
    let stops = |i: usize| sent[i].switch == Switch::Stop;
    for first in (0..sent.len()).filter(|&i| stops(i) && (i == 0 || !stops(i - 1))) {
        let closed = sent[first].end + CLOSED_WITHIN;
        let until = sent[first..].iter().find(|sent| sent.switch != Switch::Stop).map_or(end, |it| it.start);
        let again = opens().find(|at| (closed..until.saturating_sub(ON_ITS_WAY)).contains(at));
        if closed < until && pin.at(closed) == energised {
            wrong.push(format!("open {CLOSED_WITHIN} ns after the stop that ends at {} ns", sent[first].end));
        } else if let Some(at) = again {
            wrong.push(format!("opens at {at} ns, and stop is sent since {} ns", sent[first].end));
        }
    }
    // It opens with a run that goes out, and after a reset where it was open before.
    for at in opens() {
        let reset = resets.iter().rev().find(|reset| (**reset..**reset + DRIVEN_WITHIN).contains(&at));
        let restored = reset.is_some_and(|reset| pin.at(reset - 1) == energised);
        // What was composed before may still go out.
        let before = |sent: &Sent| sent.switch != Switch::Run && sent.start < at + ON_ITS_WAY;
        let next = sent.iter().find(|sent| sent.end + ON_ITS_WAY > at && !before(sent));
        let runs = next.is_some_and(|next| next.switch == Switch::Run && next.start < at + RUN_WITHIN);
        if !restored && !runs && at + RUN_WITHIN < end {
            wrong.push(format!("opens at {at} ns, and no run goes out"));
        }
    }
    // It cuts no engine that is ordered to run.
    for pair in changes.windows(2) {
        let [(_, before), (at, level)] = [pair[0], pair[1]];
        if before != energised || level == Level::Floats || errors {
            continue;
        }
        let last = sent.iter().rev().find(|sent| sent.start < at.saturating_sub(ON_ITS_WAY));
        let next = sent.iter().find(|sent| sent.start > at + ON_ITS_WAY);
        if [last, next].iter().all(|sent| sent.is_some_and(|sent| sent.switch == Switch::Run)) {
            wrong.push(format!("closes at {at} ns, and run is sent before and after"));
        }
    }
    wrong
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPEN: Level = Level::High;
    const SHUT: Level = Level::Low;
    const END: Nanos = 20 * SECOND;

    /// A switch each 0.1 s, from a second on.
    fn sent(orders: &[(u64, Switch)]) -> Vec<Sent> {
        sent_every(100 * MILLIS, orders)
    }

    fn sent_every(period: Nanos, orders: &[(u64, Switch)]) -> Vec<Sent> {
        let mut sent = Vec::new();
        for (i, &(from, switch)) in orders.iter().enumerate() {
            let until = orders.get(i + 1).map_or(END, |next| next.0 * SECOND);
            let starts = (from * SECOND..until).step_by(period as usize);
            sent.extend(starts.map(|start| Sent { start, end: start + MILLIS, switch }));
        }
        sent
    }

    /// What is found with these levels, in ms, where stop follows on a flight that begins at 2 s.
    fn found(levels: &[(u64, Level)], resets: &[u64], errors: bool) -> String {
        let sent = sent(&[(1, Switch::Standby), (2, Switch::Run), (10, Switch::Stop)]);
        let resets: Vec<_> = resets.iter().map(|at| at * MILLIS).collect();
        let levels = levels.iter().map(|&(at, level)| (at * MILLIS, level));
        let pin = Pin::from_levels([(0, Level::Floats), (1, SHUT)].into_iter().chain(levels).collect());
        wrong(&pin, OPEN, &sent, &resets, END, errors).join("\n")
    }

    #[test]
    fn a_valve_that_opens_with_run_and_closes_with_stop_is_right() {
        assert_eq!(found(&[(1_999, OPEN), (10_005, SHUT)], &[], false), "");
        assert_eq!(
            found(&[(1_999, OPEN), (5_000, Level::Floats), (5_003, OPEN), (10_005, SHUT)], &[5_000], false),
            ""
        );
    }

    /// 50 times a second: one to two frames are on their way.
    #[test]
    fn a_valve_that_opens_before_the_first_run_of_a_fast_wire_is_right() {
        let sent = sent_every(20 * MILLIS, &[(1, Switch::Standby), (2, Switch::Run)]);
        let opens = |ms| Pin::from_levels(vec![(0, Level::Floats), (1, SHUT), (ms * MILLIS, OPEN)]);
        for (ms, right) in [(1_920, false), (1_955, true), (1_999, true), (2_100, true)] {
            assert_eq!(wrong(&opens(ms), OPEN, &sent, &[], END, false).is_empty(), right, "{ms} ms");
        }
    }

    #[test]
    fn a_stop_that_leaves_it_open_is_found() {
        assert!(found(&[(1_999, OPEN), (10_015, SHUT)], &[], false).contains("after the stop"));
        assert!(found(&[(1_999, OPEN)], &[], false).contains("after the stop"));
        let again = [(1_999, OPEN), (10_005, SHUT), (12_000, Level::Floats), (12_003, OPEN)];
        assert!(found(&again, &[12_000], false).contains("and stop is sent since"));
    }

    #[test]
    fn one_that_opens_without_a_run_is_found() {
        assert!(found(&[(500, OPEN), (10_005, SHUT)], &[], false).contains("no run goes out"));
        // A reset opens none that was closed.
        let reset = [(1_200, Level::Floats), (1_203, OPEN), (10_005, SHUT)];
        assert!(found(&reset, &[1_200], false).contains("no run goes out"));
    }

    #[test]
    fn one_that_cuts_an_engine_is_found() {
        let cut = [(1_999, OPEN), (6_000, SHUT)];
        assert!(found(&cut, &[], false).contains("run is sent before and after"));
        assert_eq!(found(&cut, &[], true), "");
    }
}
