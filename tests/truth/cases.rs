//! Named cases of loss, restart and disagreement, each with the frames that must be sent at each step. The judge of the random
//! worlds judges them, too.

use crate::acts::{Act, Blow};
use crate::faults::Fault;
use crate::history::{Cause, Demanded, Frame, MS, Mark, PilotCommand, SECOND, Sent, Switch};
use crate::settings::Setup;
use crate::worlds::{World, case};
use sim::turbine::Phase;

const RC: usize = 1;
const MAVLINK: usize = 2;
const BENCH: usize = 3;
/// The engine flies at 60 % from [`FLIES`] s on.
const DEMAND: u32 = 600;
const FLIES: u64 = 45;
/// Time of the event, s.
const AT: u64 = 60;

type Acts = Vec<(u64, Act)>;

fn throttle(tenths: u32) -> PilotCommand {
    PilotCommand::Run(Demanded::Throttle(tenths))
}

/// An act at a time in milliseconds.
fn at(millis: u64, act: Act) -> (u64, Act) {
    (millis * MS, act)
}

fn stream(source: usize, command: PilotCommand) -> Act {
    Act::Stream(source, Some(command))
}

/// Standby, start, and the demand, as documented.
fn flight(demand: Demanded) -> Acts {
    vec![
        at(500, Act::Once(RC, PilotCommand::Arm)),
        at(500, stream(RC, PilotCommand::Standby)),
        at(6000, stream(RC, throttle(0))),
        at(FLIES * 1000, stream(RC, PilotCommand::Run(demand))),
    ]
}

fn reset(millis: u64, down: u64, cause: Cause) -> Blow {
    Blow {
        at: millis * MS,
        down: down * MS,
        cause,
        with_ecu: false,
        other_settings: false,
        other_engine: false,
    }
}

/// Result of a case.
struct Seen(World);

impl Seen {
    fn of(setup: Setup, acts: Acts, blows: Vec<Blow>, seconds: u64) -> Self {
        Self(case([(setup, acts)], blows, seconds))
    }

    /// The judge has no findings.
    #[track_caller]
    fn is_good(&self) -> &Self {
        let clean = self.0.engines.iter().all(|engine| engine.verdict.findings.is_empty());
        assert!(clean, "{}", self.0.report(false));
        self
    }

    /// The frames that began in this time.
    fn frames(&self, engine: usize, from_ms: u64, to_ms: u64) -> impl Iterator<Item = &Frame> {
        let all = &self.0.engines[engine].history.frames;
        all.iter().filter(move |frame| (from_ms * MS..to_ms * MS).contains(&frame.at))
    }

    /// In this time only such frames were sent, and at least this number.
    #[track_caller]
    fn only(&self, from_ms: u64, to_ms: u64, least: usize, allowed: impl Fn(Sent) -> bool) -> &Self {
        if let Some(frame) = self.frames(0, from_ms, to_ms).find(|frame| !allowed(frame.sent)) {
            panic!("{} at {} ms\n{}", frame.sent, frame.at / MS, self.0.report(true));
        }
        let count = self.frames(0, from_ms, to_ms).count();
        assert!(count >= least, "{count} frames from {from_ms} ms to {to_ms} ms\n{}", self.0.report(true));
        self
    }

    fn phase(&self, engine: usize, millis: u64) -> Phase {
        self.0.engines[engine].history.sample(millis * MS).map_or(Phase::Stopped, |sample| sample.phase)
    }

    #[track_caller]
    fn phase_is(&self, engine: usize, millis: u64, phase: Phase) -> &Self {
        let seen = self.phase(engine, millis);
        assert_eq!(seen, phase, "engine {engine} at {millis} ms\n{}", self.0.report(true));
        self
    }

    #[track_caller]
    fn ignitions(&self, engine: usize, count: usize) -> &Self {
        let marks = &self.0.engines[engine].history.marks;
        let ignitions = marks.iter().filter(|(_, mark)| *mark == Mark::Ignition).count();
        assert_eq!(ignitions, count, "ignitions\n{}", self.0.report(true));
        self
    }

    /// The last demand on the wire before this instant, within 1 %.
    #[track_caller]
    fn demand_is(&self, engine: usize, millis: u64, tenths: u32) -> &Self {
        let last = self.frames(engine, 0, millis).filter_map(|frame| frame.sent.demand()).last();
        let near = matches!(last, Some(Demanded::Throttle(sent)) if sent.abs_diff(tenths) <= 10);
        let shown = last.map_or("no demand".into(), |sent| sent.to_string());
        assert!(near, "{shown} on the wire at {millis} ms\n{}", self.0.report(true));
        self
    }
}

const fn is_run(sent: Sent) -> bool {
    matches!(sent.switch(), Some(Switch::Run))
}

const fn is_standby(sent: Sent) -> bool {
    matches!(sent.switch(), Some(Switch::Standby))
}

/// Frames that may go to a ZK ECU in doubt.
const fn is_empty(sent: Sent) -> bool {
    matches!(sent, Sent::Nothing | Sent::Rpm(_) | Sent::Other(_))
}

/// The ECUs of the cases, with each kind of demand that they accept.
fn every_ecu() -> Vec<(Setup, Demanded)> {
    let rpm = Demanded::Rpm(120_000);
    vec![
        (Setup::amt_case(), Demanded::Throttle(DEMAND)),
        (Setup::zk_case(3), Demanded::Throttle(DEMAND)),
        (Setup::zk_case(5), Demanded::Throttle(DEMAND)),
        (Setup::zk_case(5), rpm),
    ]
}

#[test]
fn ecu_dips_end_the_run() {
    for (setup, demand) in every_ecu() {
        for dip in [200, 3000, 180_000] {
            let mut acts = flight(demand);
            acts.push(at(AT * 1000, Act::Fault(Fault::PowerOff, dip * MS)));
            let replies_only = setup.traits().replies_only;
            let seen = Seen::of(setup.clone(), acts, vec![], 330);
            seen.is_good().ignitions(0, 1);
            let back = AT * 1000 + dip;
            if !replies_only {
                // From the third missing frame on, nothing that could start an engine.
                seen.only(AT * 1000 + 300, back + 250, 1, |sent| is_empty(sent) || is_standby(sent));
            }
            // The pilot continues with run, and it is not obeyed.
            seen.only(back + 2500, 330_000, 100, |sent| {
                is_standby(sent) || !replies_only && matches!(sent, Sent::Nothing | Sent::Action(_))
            });
        }
    }
}

#[test]
fn an_engine_resumes_over_resets_one_second_apart() {
    for (setup, demand) in every_ecu() {
        let mut blows = vec![reset(AT * 1000, 100, Cause::Watchdog)];
        blows.extend((1..=5).map(|n| reset(AT * 1000 + n * 1050, 50, Cause::Watchdog)));
        let seen = Seen::of(setup, flight(demand), blows, 90);
        seen.is_good().ignitions(0, 1).phase_is(0, 89_000, Phase::Running);
        seen.only(AT * 1000, 90_000, 100, |sent| !is_standby(sent));
        if demand == Demanded::Throttle(DEMAND) {
            seen.demand_is(0, 89_000, DEMAND);
        }
    }
}

#[test]
fn a_loop_of_resets_does_not_keep_a_dead_sources_demand() {
    for (setup, demand) in every_ecu() {
        let mut acts = flight(demand);
        acts.push(at(AT * 1000, Act::Stream(RC, None)));
        let blows = (0..50).map(|n| reset(AT * 1000 + 500 + n * 1050, 50, Cause::Watchdog)).collect();
        let seen = Seen::of(setup, acts, blows, 130);
        seen.is_good().ignitions(0, 1);
        // From the third reset on it is at the fail-safe.
        seen.only(AT * 1000 + 5000, 130_000, 100, |sent| match sent.demand() {
            Some(Demanded::Throttle(tenths)) => tenths == 0,
            Some(Demanded::Rpm(rpm)) => rpm <= 60_000,
            None => true,
        });
    }
}

#[test]
fn a_brown_out_of_the_node_costs_no_engine() {
    for error in [false, true] {
        for (setup, demand) in every_ecu() {
            let mut acts = flight(demand);
            if error {
                // Supply low.
                acts.push(at(AT * 1000 - 5000, Act::Fault(Fault::Error(5), 60 * SECOND)));
            }
            let blows = vec![reset(AT * 1000, 300, Cause::BrownOut)];
            let hidden = error && setup.traits().faults_hide_state;
            let seen = Seen::of(setup, acts, blows, 110);
            seen.is_good().ignitions(0, 1).phase_is(0, 109_000, Phase::Running);
            seen.only(AT * 1000, 110_000, 100, |sent| {
                !is_standby(sent) && sent.switch() != Some(Switch::Stop)
            });
            if demand == Demanded::Throttle(DEMAND) && !hidden {
                seen.demand_is(0, 109_000, DEMAND);
            }
        }
    }
}

#[test]
fn each_wire_is_cut_and_mended_while_the_pilot_moves_the_stick_and_shuts_down() {
    for (setup, demand) in every_ecu() {
        for fault in [Fault::CutToNode, Fault::CutToEcu] {
            let mut acts = flight(demand);
            let half = match demand {
                Demanded::Throttle(_) => Demanded::Throttle(300),
                Demanded::Rpm(_) => Demanded::Rpm(80_000),
            };
            acts.extend([
                at(AT * 1000, Act::Fault(fault, 30 * SECOND)),
                at(AT * 1000 + 10_000, stream(RC, PilotCommand::Run(half))),
                at(AT * 1000 + 20_000, stream(RC, PilotCommand::Standby)),
            ]);
            let replies_only = setup.traits().replies_only;
            let seen = Seen::of(setup.clone(), acts, vec![], 130);
            seen.is_good().ignitions(0, 1);
            if !replies_only {
                // Standby is sent blind, and run no longer.
                let quiet = |sent| is_standby(sent) || matches!(sent, Sent::Nothing | Sent::Action(_));
                seen.only(AT * 1000 + 20_500, 130_000, 300, quiet);
            } else {
                seen.only(AT * 1000 + 20_500, 130_000, 50, is_standby);
            }
            let at_rest = matches!(seen.phase(0, 129_000), Phase::Cooling | Phase::Standby | Phase::Stopped);
            assert!(at_rest, "{}", seen.0.report(true));
        }
    }
}

#[test]
fn two_seconds_of_framing_noise_cost_no_engine() {
    for (setup, demand) in every_ecu() {
        // Every byte, or one in six: then most sets are damaged, and nearly all of them keep their header.
        for fault in [Fault::Damage(true, false), Fault::Framing(160_000)] {
            let mut acts = flight(demand);
            acts.push(at(AT * 1000, Act::Fault(fault, 2 * SECOND)));
            let replies_only = setup.traits().replies_only;
            let seen = Seen::of(setup.clone(), acts, vec![], 90);
            seen.is_good().ignitions(0, 1).phase_is(0, 89_000, Phase::Running);
            if replies_only && fault != Fault::Damage(true, false) {
                // Sets whose values cannot be read get the same replies as before.
                seen.only(AT * 1000, AT * 1000 + 2000, 6, is_run);
            }
            if demand == Demanded::Throttle(DEMAND) {
                seen.demand_is(0, 89_000, DEMAND);
            }
        }
    }
}

#[test]
fn a_start_that_waits_ends_when_its_source_is_lost() {
    let second = vec![
        at(500, Act::Once(RC, PilotCommand::Arm)),
        at(500, stream(RC, PilotCommand::Standby)),
        // The other engine is starting.
        at(8000, stream(RC, throttle(0))),
        at(10_000, Act::Stream(RC, None)),
        // It commands again when the other one runs.
        at(50_000, stream(RC, throttle(0))),
    ];
    for setup in [Setup::zk_case(5), Setup::amt_case()] {
        let first = (setup.clone(), flight(Demanded::Throttle(DEMAND)));
        let seen = Seen(case([first, (setup.at_port(1), second.clone())], vec![], 120));
        seen.is_good().ignitions(0, 1).ignitions(1, 0);
        let run = seen.frames(1, 0, 120_000).find(|frame| is_run(frame.sent));
        assert!(run.is_none(), "{run:?}\n{}", seen.0.report(true));
        seen.only(FLIES * 1000, 120_000, 100, |sent| is_run(sent) || matches!(sent, Sent::Action(_)));
    }
}

#[test]
fn rc_is_lost_for_two_seconds_above_a_source_that_streams_standby() {
    for (setup, demand) in every_ecu() {
        let mut acts = flight(demand);
        acts.extend([
            at(20_000, stream(MAVLINK, PilotCommand::Standby)),
            at(AT * 1000, Act::Stream(RC, None)),
            at(AT * 1000 + 2000, stream(RC, PilotCommand::Run(demand))),
        ]);
        let seen = Seen::of(setup, acts, vec![], 90);
        seen.is_good().ignitions(0, 1).phase_is(0, 89_000, Phase::Running);
        seen.only(AT * 1000, 90_000, 100, |sent| !is_standby(sent));
    }
}

#[test]
fn rc_is_lost_for_two_seconds_above_a_source_that_streams_run() {
    for setup in [Setup::amt_case(), Setup::zk_case(3), Setup::zk_case(5)] {
        let mut acts = flight(Demanded::Throttle(DEMAND));
        acts.extend([
            at(40_000, stream(MAVLINK, throttle(400))),
            at(AT * 1000, Act::Stream(RC, None)),
            at(AT * 1000 + 2000, stream(RC, throttle(DEMAND))),
        ]);
        let seen = Seen::of(setup, acts, vec![], 90);
        seen.is_good().ignitions(0, 1).phase_is(0, 89_000, Phase::Running);
        seen.demand_is(0, 89_000, DEMAND);
        let between = |sent: Sent| !matches!(sent.demand(), Some(Demanded::Throttle(tenths)) if !(390..=610).contains(&tenths));
        seen.only(AT * 1000, 90_000, 100, |sent| {
            is_run(sent) && between(sent) || matches!(sent, Sent::Action(_))
        });
    }
}

#[test]
fn a_flame_out_with_error_sets_is_not_relit_when_the_fault_clears() {
    let setup = Setup::amt_case();
    let mut acts = flight(Demanded::Throttle(DEMAND));
    acts.push(at(AT * 1000, Act::Fault(Fault::FlameOut, MS)));
    // The ECU of the case clears a trip after 60 s, and starts hot on run alone.
    let seen = Seen::of(setup, acts, vec![], 180);
    seen.is_good().ignitions(0, 1);
    seen.only(AT * 1000 + 45_000, 180_000, 100, is_standby);
}

/// The fault clears while run is still in force. The first normal sets, which report rest (10 %) or start clearance (5 %), get no
/// reply; the second one at rest, or the exhaust, ends the life. The control: the engine runs, and its ECU reports faults for 3 s.
#[test]
fn a_flame_out_whose_fault_clears_early_is_not_answered_with_run() {
    let begins = AT * 1000;
    for (tenths, standby_within) in [(100, 500), (50, 3000)] {
        for is_out in [true, false] {
            let fault = if is_out {
                Act::Fault(Fault::FlameOut, MS)
            } else {
                Act::Fault(Fault::Error(5), 3 * SECOND)
            };
            let mut acts = flight(Demanded::Throttle(tenths));
            acts.push(at(begins, fault));
            let seen = Seen::of(Setup::amt_case_that_clears(600 * MS), acts, vec![], 90);
            seen.is_good().ignitions(0, 1);
            if !is_out {
                // Eight sets a second, and each gets its reply.
                seen.only(begins, 90_000, 235, is_run).phase_is(0, 89_000, Phase::Running);
                continue;
            }
            let trips = (begins..90_000).find(|&ms| seen.phase(0, ms) != Phase::Running).expect("a trip");
            let clears = trips + 600;
            // The last reply is to a set that began before the fault cleared.
            seen.only(begins, trips, 5, is_run).only(trips, clears, 3, is_run);
            let standby = seen.frames(0, clears, 90_000).find(|frame| is_standby(frame.sent));
            let standby = standby.map_or(90_000, |frame| frame.at / MS);
            assert!(standby < clears + standby_within, "{standby} ms\n{}", seen.0.report(true));
            assert_eq!(seen.frames(0, clears + 60, standby).count(), 0, "{}", seen.0.report(true));
            seen.only(clears + 60, 90_000, 190, is_standby);
        }
    }
}

#[test]
fn after_an_emergency_stop_a_source_has_to_disarm_before_it_arms() {
    for setup in [Setup::zk_case(5), Setup::amt_case()] {
        for disarms in [false, true] {
            let mut acts = flight(Demanded::Throttle(DEMAND));
            acts.extend([
                at(AT * 1000, Act::Once(RC, PilotCommand::Stop)),
                at(AT * 1000 + 100, stream(RC, throttle(0))),
                at(90_000, Act::Once(RC, PilotCommand::Release)),
                at(91_000, stream(RC, PilotCommand::Standby)),
            ]);
            if disarms {
                acts.push(at(299_000, Act::Once(RC, PilotCommand::Disarm)));
            }
            acts.extend([
                at(300_000, Act::Once(RC, PilotCommand::Arm)),
                at(302_000, stream(RC, throttle(0))),
            ]);
            let seen = Seen::of(setup.clone(), acts, vec![], 320);
            seen.is_good().ignitions(0, 1 + usize::from(disarms));
            seen.only(AT * 1000 + 200, 89_900, 100, |sent| sent.switch() == Some(Switch::Stop));
            seen.only(92_000, 301_900, 100, |sent| is_standby(sent) || matches!(sent, Sent::Action(_)));
        }
    }
}

#[test]
fn another_ecu_is_plugged_in_while_the_link_is_down() {
    let (throttle, off) = (Demanded::Throttle(DEMAND), 10 * SECOND);
    for (setup, new, demand, off) in [
        (Setup::zk_case(5), 3, Demanded::Rpm(120_000), off),
        (Setup::zk_case(5), 3, throttle, off),
        (Setup::zk_case(3), 5, throttle, off),
        // The same engine and another one; for less than a gap, too.
        (Setup::amt_case(), 4, throttle, off),
        (Setup::amt_case(), 1, throttle, off),
        (Setup::amt_case(), 1, throttle, 100 * MS),
    ] {
        let mut acts = flight(demand);
        acts.push(at(AT * 1000, Act::Swap(new, off)));
        let seen = Seen::of(setup, acts, vec![], 120);
        // A command to the first ECU; the engine on the other is never started.
        seen.is_good().ignitions(0, 1);
        seen.only(AT * 1000 + 300, 120_000, 100, |sent| !is_run(sent));
    }
}

#[test]
fn one_of_two_engines_fails_in_flight() {
    for setup in [Setup::zk_case(5), Setup::amt_case()] {
        let mut first = flight(Demanded::Throttle(DEMAND));
        first.push(at(AT * 1000 + 60_000, Act::Fault(Fault::FlameOut, MS)));
        let second: Acts = vec![
            at(500, Act::Once(RC, PilotCommand::Arm)),
            at(500, stream(RC, PilotCommand::Standby)),
            at(50_000, stream(RC, throttle(0))),
            at(100_000, stream(RC, throttle(DEMAND))),
        ];
        let seen = Seen(case([(setup.clone(), first), (setup.at_port(1), second)], vec![], 200));
        seen.is_good().ignitions(0, 1).ignitions(1, 1).phase_is(1, 199_000, Phase::Running);
        seen.demand_is(1, 199_000, DEMAND);
        let shut_down = seen.frames(1, 52_000, 200_000).find(|frame| is_standby(frame.sent));
        assert!(shut_down.is_none(), "{shut_down:?}\n{}", seen.0.report(true));
        seen.only(AT * 1000 + 60_000 + 45_000, 200_000, 50, |sent| !is_run(sent));
    }
}

#[test]
fn a_start_by_one_command_of_a_ground_station_that_is_then_lost() {
    for stream_of in [throttle(0), throttle(300)] {
        for setup in [Setup::zk_case(5), Setup::zk_case(3), Setup::amt_case()] {
            // A source that was silent for longer than its timeout has to be received for a while before its run counts.
            for (apart, ignitions) in [(2000, 0), (500, 1)] {
                let acts = vec![
                    at(500, Act::Once(MAVLINK, PilotCommand::Arm)),
                    at(500, stream(BENCH, stream_of)),
                    at(7000 - apart, Act::Once(MAVLINK, PilotCommand::Standby)),
                    at(7000, Act::Once(MAVLINK, throttle(0))),
                ];
                let seen = Seen::of(setup.clone(), acts, vec![], 200);
                seen.is_good().ignitions(0, ignitions);
                let quiet = |sent| is_standby(sent) || matches!(sent, Sent::Nothing | Sent::Action(_));
                seen.only(1000, if ignitions == 0 { 200_000 } else { 7000 }, 20, quiet);
                let starts = seen.frames(0, 7000, 7500).any(|frame| is_run(frame.sent));
                assert_eq!(starts, ignitions > 0, "{}", seen.0.report(true));
            }
        }
    }
}
