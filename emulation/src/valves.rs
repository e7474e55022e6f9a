//! The fuel valve of each engine, and the power of its starter and ignition, checked against the commands on its wire and its turbine, at
//! every run. An image without outputs drives none of their pins. The outputs' pins are a separate copy here, not read from the firmware, so
//! that a difference is found.

use crate::engines;
use crate::image::Image;
use crate::pins::{Level, Pin};
use crate::report::Report;
use crate::wire::Wire;
use sim::any::Protocol;
use sim::control::Switch;
use sim::ecu::{MILLIS, Nanos, SECOND};

/// A stop closes the valve within this time of its first frame.
const CLOSED_WITHIN: Nanos = 10 * MILLIS;
/// A frame that was on its way when a pin changed.
const ON_ITS_WAY: Nanos = 50 * MILLIS;
/// From a reset until the pins are driven.
const DRIVEN_WITHIN: Nanos = 20 * MILLIS;
/// Longest time after the valve opened for an ECU until that ECU is received.
const RUN_WITHIN: Nanos = SECOND;

/// Shortest time from a reset until a newly commanded stop can be on a wire: a receiver has to hold it for 0.3 s.
const COMMANDED: Nanos = 300 * MILLIS;
/// Time for which an engine has to be reported cold and at rest until its starter loses its power.
const COLD_FOR: Nanos = 2_900 * MILLIS;
/// The same until it has certainly lost it, if the ECU reports.
const OFF_WITHIN: Nanos = 6 * SECOND;

/// A switch sent on a wire.
#[derive(Clone, Copy, Debug)]
struct Sent {
    start: Nanos,
    end: Nanos,
    switch: Switch,
}

/// Everything that is wrong. `errors`: the test makes the firmware fail, which may close a valve.
pub(crate) fn complaints(report: &Report, errors: bool) -> Vec<String> {
    let pins = || (0..report.board.outputs.len()).map(|number| Pin::output(report, number));
    if !report.image.has_outputs() {
        let driven = pins().enumerate().filter_map(|(number, pin)| Some((number, pin.driven()?)));
        return driven
            .map(|(number, at)| format!("output {number} is driven at {at} ns, and there are no outputs"))
            .collect();
    }
    let engines = engines::of(report.board, report.image);
    let outputs = report.image.outputs(report.board);
    let (last, count) = (engines.len() - 1, engines.len());
    let resets: Vec<_> = report.resets.iter().map(|reset| reset.0).collect();
    let commands = first_command(report);
    let mut complaints = Vec::new();
    for (number, engine) in engines.into_iter().enumerate() {
        let energised = Level::energising(report.board, number == last);
        let wire = report.wires.get(engine.port);
        let sent = wire.map_or(Vec::new(), |wire| switches(wire, engine.protocol()));
        if let Some(&valve) = outputs.get(number) {
            let wrong = wrong(&Pin::output(report, valve), energised, &sent, &resets, report.at, errors);
            complaints.extend(wrong.into_iter().map(|text| format!("the valve of {}: {text}", engine.name)));
        }
        if let Some(&power) = outputs.get(count + number) {
            let cold = wire.map_or(Vec::new(), |wire| wire.cold.clone());
            let received = wire.map_or(Vec::new(), reports);
            let known = Known { sent, cold, received, commands, resets: resets.clone(), end: report.at };
            let wrong = wrong_power(&Pin::output(report, power), energised, &known);
            complaints.extend(wrong.into_iter().map(|text| format!("the power of {}: {text}", engine.name)));
        }
    }
    complaints
}

/// End of each burst of an ECU that the board received.
fn reports(wire: &Wire) -> Vec<Nanos> {
    let received = wire.rx.iter().filter(|rx| rx.last && rx.fate == crate::wire::Fate::Received);
    received.map(|rx| rx.end).collect()
}

/// First time at which a source that can arm an engine was received.
fn first_command(report: &Report) -> Option<Nanos> {
    if report.image == Image::RadioPwm {
        return Some(0);
    }
    let ports = [report.image.radio(report.board), report.board.telemetry.name];
    let wires = report.wires().filter(|(port, _)| ports.contains(port));
    wires.filter_map(|(_, wire)| wire.rx.first().map(|rx| rx.end)).min()
}

/// The switches that the board sent.
fn switches(wire: &Wire, protocol: Protocol) -> Vec<Sent> {
    let frames = wire.frames(protocol).into_iter().filter_map(|(frame, _)| {
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
    // A stop closes it, and nothing, not even a reset, opens it until another order is sent.
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
    // It opens with a run that is sent, and after a reset if it was open before.
    for at in opens() {
        let reset = resets.iter().rev().find(|reset| (**reset..**reset + DRIVEN_WITHIN).contains(&at));
        let restored = reset.is_some_and(|reset| pin.at(reset - 1) == energised);
        // A frame composed before may still be sent.
        let before = |sent: &Sent| sent.switch != Switch::Run && sent.start < at + ON_ITS_WAY;
        let next = sent.iter().find(|sent| sent.end + ON_ITS_WAY > at && !before(sent));
        let runs = next.is_some_and(|next| next.switch == Switch::Run && next.start < at + RUN_WITHIN);
        if !restored && !runs && at + RUN_WITHIN < end {
            wrong.push(format!("opens at {at} ns, and no run goes out"));
        }
    }
    // It cuts off no engine that is ordered to run.
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

/// Facts about an engine whose starter and ignition are checked for power.
#[derive(Clone, Debug)]
struct Known {
    sent: Vec<Sent>,
    /// Since when it has been cold and at rest, or has not.
    cold: Vec<(Nanos, bool)>,
    /// When its ECU was received.
    received: Vec<Nanos>,
    /// First time at which a source that can arm it was received.
    commands: Option<Nanos>,
    resets: Vec<Nanos>,
    end: Nanos,
}

impl Known {
    /// Whether it is cold and at rest all the time.
    fn is_cold(&self, from: Nanos, to: Nanos) -> bool {
        let first = self.cold.iter().rfind(|(at, _)| *at <= from).is_some_and(|(_, cold)| *cold);
        first && self.cold.iter().all(|(at, cold)| *cold || !(from..to).contains(at))
    }

    /// Whether it is not, at least for a moment.
    fn is_busy(&self, from: Nanos, to: Nanos) -> bool {
        self.cold.iter().rfind(|(at, _)| *at <= to).is_some_and(|(since, cold)| !*cold || *since > from)
    }

    /// Whether its ECU is received all the time.
    fn is_received(&self, from: Nanos, to: Nanos) -> bool {
        let within = self.received.iter().copied().filter(|at| (from..to).contains(at));
        let mut last = from;
        within.chain([to]).all(|at| at - core::mem::replace(&mut last, at) < SECOND)
    }

    /// Whether a stop was sent last before a reset, and is sent after it before anybody can have commanded one.
    fn keeps_stop(&self, reset: Nanos) -> bool {
        let before = self.sent.iter().rev().find(|sent| sent.end < reset);
        let after =
            self.sent.iter().find(|sent| sent.start >= reset).filter(|it| it.start < reset + COMMANDED);
        [before, after].into_iter().all(|sent| sent.is_some_and(|sent| sent.switch == Switch::Stop))
    }

    fn reset_at(&self, at: Nanos) -> Option<Nanos> {
        self.resets.iter().rev().find(|reset| (**reset..**reset + DRIVEN_WITHIN).contains(&at)).copied()
    }
}

fn wrong_power(pin: &Pin, energised: Level, known: &Known) -> Vec<String> {
    let mut wrong = Vec::new();
    let Known { sent, resets, end, .. } = known;
    let is_off = |at| ![energised, Level::Floats].contains(&pin.at(at));
    // It is on when run is sent.
    let unpowered = |sent: &&Sent| {
        let at = sent.end + CLOSED_WITHIN;
        sent.switch == Switch::Run && at < *end && known.reset_at(at).is_none() && is_off(at)
    };
    if let Some(sent) = sent.iter().find(unpowered) {
        wrong.push(format!("off, and run ends at {} ns", sent.end));
    }
    let changes = pin.changes(0..*end);
    for (i, &(at, level)) in changes.iter().enumerate() {
        let before = i.checked_sub(1).map_or(Level::Floats, |i| changes[i].1);
        if level == Level::Floats {
            continue;
        }
        if level != energised && before == energised {
            // By the reports of a cold engine: from three seconds ago on, up to the last that may be under way.
            let (from, to) = (at.saturating_sub(COLD_FOR), at.saturating_sub(SECOND));
            if !known.is_cold(from, to) {
                wrong.push(format!("off at {at} ns, and its engine was not cold and at rest for 3 s"));
            }
        }
        let reset = known.reset_at(at);
        let stopped = reset.is_some_and(|reset| known.keeps_stop(reset));
        // What was on stays on: a stop that is still latched shows that the memory is whole.
        let was_on = reset.is_some_and(|reset| pin.at(reset - 1) == energised);
        if level != energised && stopped && was_on {
            wrong.push(format!("off at {at} ns after a reset, and a stop is latched"));
        }
        if level == energised && before != energised {
            let restored = was_on || stopped;
            let runs = sent.iter().any(|sent| {
                sent.switch == Switch::Run && sent.end + RUN_WITHIN > at && sent.start < at + RUN_WITHIN
            });
            let armed = known.commands.is_some_and(|first| first < at);
            let busy = known.is_busy(at.saturating_sub(RUN_WITHIN), at);
            if !restored && !runs && !armed && !busy && at + RUN_WITHIN < *end {
                wrong.push(format!("on at {at} ns, and nobody can have armed its engine"));
            }
        }
    }
    // A stop disarms: a cold engine then has no power.
    let mut since = None;
    for sent in sent {
        let stop = sent.switch == Switch::Stop;
        since = if stop { since.or(Some(sent.start)) } else { None };
        let at = sent.start;
        let begun = since.unwrap_or(at).max(resets.iter().rfind(|reset| **reset <= at).copied().unwrap_or(0));
        let from = at.saturating_sub(OFF_WITHIN);
        let known_cold = known.is_cold(from, at) && known.is_received(from, at);
        if stop && begun < from && known_cold && pin.at(at) == energised {
            wrong.push(format!("on at {at} ns, and its engine is stopped, cold and at rest since {from} ns"));
            break;
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

    /// Findings with these levels, in ms, when a stop ends a flight that begins at 2 s.
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

    /// 50 frames a second: one or two are on their way.
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
        // A reset does not open a closed valve.
        let reset = [(1_200, Level::Floats), (1_203, OPEN), (10_005, SHUT)];
        assert!(found(&reset, &[1_200], false).contains("no run goes out"));
    }

    #[test]
    fn one_that_cuts_an_engine_is_found() {
        let cut = [(1_999, OPEN), (6_000, SHUT)];
        assert!(found(&cut, &[], false).contains("run is sent before and after"));
        assert_eq!(found(&cut, &[], true), "");
    }

    /// Findings about a starter with these levels, in ms: its engine is armed, flies from 2 s on and is stopped at 10 s; it is cold until 3
    /// s, and from the given second on.
    fn power(levels: &[(u64, Level)], cold: u64, resets: &[u64]) -> String {
        let known = Known {
            sent: sent(&[(1, Switch::Standby), (2, Switch::Run), (10, Switch::Stop)]),
            cold: vec![(0, true), (3 * SECOND, false), (cold * SECOND, true)],
            received: (0..200).map(|n| n * SECOND / 10).collect(),
            commands: Some(SECOND),
            resets: resets.iter().map(|at| at * MILLIS).collect(),
            end: END,
        };
        let levels = levels.iter().map(|&(at, level)| (at * MILLIS, level));
        let pin = Pin::from_levels([(0, Level::Floats), (1, SHUT)].into_iter().chain(levels).collect());
        wrong_power(&pin, OPEN, &known).join("\n")
    }

    const ARMED: (u64, Level) = (1_500, OPEN);

    #[test]
    fn power_from_armed_until_the_engine_is_cold_is_right_also_after_a_stop_and_over_a_reset() {
        assert_eq!(power(&[ARMED, (15_100, SHUT)], 12, &[]), "");
        assert_eq!(power(&[ARMED], 16, &[]), "");
        let reset = [ARMED, (11_000, Level::Floats), (11_003, OPEN), (15_100, SHUT)];
        assert_eq!(power(&reset, 12, &[11_000]), "");
        // A reset leaves it as it was; where that is not known, a latched stop switches it on.
        for after in [SHUT, OPEN] {
            let latched = [ARMED, (15_100, SHUT), (17_000, Level::Floats), (17_003, after)];
            assert_eq!(power(&latched, 12, &[17_000]), "");
        }
    }

    #[test]
    fn power_that_ends_before_its_engine_is_cold_is_found() {
        assert!(power(&[ARMED, (9_000, SHUT)], 12, &[]).contains("not cold and at rest for 3 s"));
        assert!(power(&[ARMED, (10_005, SHUT)], 12, &[]).contains("not cold and at rest for 3 s"));
        assert!(power(&[ARMED, (13_000, SHUT)], 12, &[]).contains("not cold and at rest for 3 s"));
        let reset = [ARMED, (11_000, Level::Floats), (11_003, SHUT)];
        assert!(power(&reset, 12, &[11_000]).contains("a stop is latched"));
    }

    #[test]
    fn power_that_does_not_end_or_is_missing_in_a_start_is_found() {
        assert!(power(&[ARMED], 12, &[]).contains("stopped, cold and at rest since"));
        assert!(power(&[(2_500, OPEN), (15_100, SHUT)], 12, &[]).contains("run ends at"));
        assert!(power(&[(500, OPEN), (15_100, SHUT)], 12, &[]).contains("nobody can have armed"));
    }
}
