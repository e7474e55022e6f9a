//! One life, one start: what a report means for a run, who may start, what takes two words, what goes on over a reset. As
//! tables, for both ECUs, to the tick where the rule has a time.

use embassy_time::Duration;
use jetlink::command::{Accepted, Command, Demand, Interlock, Order, Origin, Rejected};
use jetlink::engine::retained::{Reset, RetainedMemory, RetainedState};
use jetlink::event::{End, Event, LossStage};
use jetlink::limit::LimitKind;
use jetlink::limit::{Action, Limit};
use jetlink::line::LineError;
use jetlink::units::{Celsius, Rpm};

use crate::support::bench::{micros, us};
use crate::support::frames::{amt as amt_frames, zk as zk_frames};
use crate::support::scenario::{
    BOTH, EVERY, Ecu, PERIOD, SECOND, Says, Scenario, TURNING, Values, Wire, percent, rpm, run,
};

/// RC's age limit, and for how long a demand is held after it.
const AGE: u64 = 500_000;
const HOLD: u64 = SECOND;
/// An order to run without a living engine ends so long after the fail-safe stage began.
const RUN_OUT: u64 = 10 * SECOND;
/// Below half of the idle speed of either engine.
const SLOW: u32 = 2_000;

/// Three expected frames: 20 Hz, and about eight sets a second.
fn gap(ecu: Ecu) -> u64 {
    match ecu {
        Ecu::Amt => 375_000,
        Ecu::Zk => 150_000,
    }
}

/// A report of a state, as the ECU numbers it, with the switch at run.
fn report(ecu: Ecu, state: u8, rpm: u32) -> Vec<u8> {
    match ecu {
        Ecu::Amt => amt_frames::normal(state, amt_frames::RUN, u8::try_from(rpm / 500).unwrap()).to_vec(),
        Ecu::Zk => zk_frames::status(1, rpm, [state, 2 << 5, 76]).to_vec(),
    }
}

/// The next frame is this one.
fn hear(scenario: &mut Scenario, frame: &[u8]) {
    scenario.silent().pass(EVERY);
    scenario.bench.receive(frame);
}

/// Runs at 50 % under RC; no frame and no event is left from before.
fn flying(ecu: Ecu) -> Scenario {
    let mut scenario = Scenario::started(ecu, percent(50));
    scenario.sent();
    scenario.bench.events();
    scenario
}

fn ends(scenario: &mut Scenario) -> Vec<End> {
    let events = scenario.bench.event_kinds().into_iter();
    events.filter_map(|event| if let Event::RunCancelled(end) = event { Some(end) } else { None }).collect()
}

fn stages(scenario: &mut Scenario) -> Vec<(u64, LossStage)> {
    let events = scenario.bench.events().into_iter();
    events
        .filter_map(|(at, event)| if let Event::SourceLoss(stage) = event { Some((at, stage)) } else { None })
        .collect()
}

// ---------------------------------------------------------------------------------------------
// Lives
// ---------------------------------------------------------------------------------------------

/// What a report means, given twice.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Means {
    /// It fits, or says nothing: the demand goes on.
    GoesOn,
    /// Doubt at once, and no verdict: nothing that could start an engine goes out.
    Doubt,
    /// Doubt that is answered with the order in force, because the shaft turns (AMT).
    Answered,
    /// Doubt, and a living engine at the second.
    Confirms,
    /// Doubt at once, and the end at the second.
    Ends(End),
}

fn check(ecu: Ecu, scenario: &mut Scenario, frame: &[u8], means: Means, name: &str) {
    let demand = Order::Run(percent(50));
    let doubt = Order::Doubt(percent(50));
    let (first, second) = match means {
        Means::GoesOn => (demand, demand),
        Means::Doubt | Means::Answered => (doubt, doubt),
        Means::Confirms => (doubt, demand),
        Means::Ends(_) => (doubt, Order::Standby),
    };
    let answered = matches!(means, Means::GoesOn | Means::Answered | Means::Confirms);
    for (expected, answered) in [(first, answered), (second, answered || second == Order::Standby)] {
        scenario.command(run(50)).unwrap();
        scenario.silent().pass(EVERY);
        scenario.sent();
        scenario.bench.receive(frame);
        assert_eq!(scenario.order(), expected, "{name}");
        // AMT: the reply to this very frame. ZK: the next turn.
        scenario.pass(if ecu == Ecu::Amt { 0 } else { EVERY });
        let wire = if expected == Order::Standby { Wire::Standby } else { Wire::Run(500) };
        let answered = if ecu == Ecu::Amt { answered } else { !matches!(expected, Order::Doubt(_)) };
        let expected = if answered { vec![wire] } else { vec![] };
        assert_eq!(scenario.sent(), expected, "{name}");
    }
    let expected = if let Means::Ends(end) = means { vec![end] } else { vec![] };
    assert_eq!(ends(scenario), expected, "{name}");
}

/// AMT-3: what each state means for an engine that has reached running, with a shaft that turns and one that does not.
#[test]
fn amt_3_reports_of_a_running_engine() {
    use End::{AtRest, StartsAgain};
    use Means::{Answered, Confirms, Doubt, Ends, GoesOn};
    // State, then without a gap (turning, slow), then after one (turning, slow).
    for (state, without, after) in [
        (0b00000, (Ends(AtRest), Ends(AtRest)), (Ends(AtRest), Ends(AtRest))),
        // The exhaust is cold here.
        (0b00001, (Ends(AtRest), Ends(AtRest)), (Ends(AtRest), Ends(AtRest))),
        (0b00010, (GoesOn, Ends(StartsAgain)), (Answered, Ends(StartsAgain))),
        (0b00100, (GoesOn, Doubt), (Answered, Doubt)),
        (0b01000, (GoesOn, Doubt), (Answered, Doubt)),
        (0b01100, (GoesOn, Doubt), (Confirms, Doubt)),
        (0b10000, (GoesOn, Doubt), (Confirms, Doubt)),
        (0b11100, (GoesOn, Doubt), (Confirms, Doubt)),
        (0b11111, (GoesOn, Doubt), (Answered, Doubt)),
    ] {
        reports_mean(Ecu::Amt, state, without, after);
    }
}

/// The same of a ZK ECU: after a gap 13, and 2 to 5 at any shaft speed, end the life; without one 13 does neither.
#[test]
fn zk_reports_of_a_running_engine() {
    use End::{AtRest, StartsAgain};
    use Means::{Confirms, Doubt, Ends, GoesOn};
    for state in 0..32 {
        let (without, after) = match state {
            0 | 1 | 12 | 14..=19 => ((Ends(AtRest), Ends(AtRest)), (Ends(AtRest), Ends(AtRest))),
            2..=5 => ((GoesOn, Ends(StartsAgain)), (Ends(StartsAgain), Ends(StartsAgain))),
            6..=11 => ((GoesOn, Doubt), (Confirms, Doubt)),
            13 => ((GoesOn, GoesOn), (Ends(StartsAgain), Ends(StartsAgain))),
            _ => ((GoesOn, Doubt), (Doubt, Doubt)),
        };
        reports_mean(Ecu::Zk, state, without, after);
    }
}

fn reports_mean(ecu: Ecu, state: u8, without: (Means, Means), after: (Means, Means)) {
    for (rpm, without, after) in [(TURNING, without.0, after.0), (SLOW, without.1, after.1)] {
        let frame = report(ecu, state, rpm);
        let mut scenario = flying(ecu);
        check(ecu, &mut scenario, &frame, without, &format!("{ecu:?} {state:#07b} {rpm} without a gap"));
        let mut scenario = flying(ecu);
        scenario.silent().pass(gap(ecu));
        scenario.bench.events();
        check(ecu, &mut scenario, &frame, after, &format!("{ecu:?} {state:#07b} {rpm} after a gap"));
    }
}

/// AMT: sets without a state are answered as the set before, and after a gap not at all.
#[test]
fn amt_sets_without_a_state_are_answered_as_the_set_before() {
    const GAP: u8 = u8::MAX;
    let table: [(&[u8], bool); 5] = [
        (&[], true),
        (&[0b00000], false),
        (&[0b00000, 0b01000], true),
        (&[GAP], false),
        (&[0b00000, 0b01100, 0b01100], true),
    ];
    for set in [amt_frames::alternate(0x06), [0xFF, 0b0110_1101, 24, 20, 0, 0]] {
        for (before, answered) in table {
            let mut scenario = flying(Ecu::Amt);
            for state in before {
                scenario.command(run(50)).unwrap();
                if *state == GAP {
                    scenario.silent().pass(gap(Ecu::Amt));
                } else {
                    hear(&mut scenario, &report(Ecu::Amt, *state, TURNING));
                }
            }
            scenario.silent().pass(EVERY);
            scenario.sent();
            scenario.bench.receive(&set);
            let expected = if answered { vec![Wire::Run(500)] } else { vec![] };
            assert_eq!(scenario.sent(), expected, "{set:02x?} {before:?}");
        }
    }
}

/// A gap of three expected frames is doubt, to the tick. What comes in time is none.
#[test]
fn three_missing_frames_are_doubt() {
    for ecu in BOTH {
        let mut scenario = flying(ecu);
        hear(&mut scenario, &report(ecu, if ecu == Ecu::Amt { 0b01100 } else { 11 }, TURNING));
        let last = scenario.now();
        scenario.command(run(50)).unwrap();
        scenario.to(last + gap(ecu) - 1);
        assert_eq!(
            (scenario.order(), scenario.telemetry().in_doubt),
            (Order::Run(percent(50)), None),
            "{ecu:?}"
        );
        scenario.to(last + gap(ecu));
        assert_eq!(scenario.order(), Order::Doubt(percent(50)), "{ecu:?}");
        assert_eq!(scenario.telemetry().in_doubt, Some(us(last + gap(ecu))));
        assert!(scenario.bench.events().contains(&(last + gap(ecu), Event::LifeInDoubt)));
        // Two reports confirm it, and the demand is in the reply to the second.
        for in_doubt in [true, false] {
            scenario.command(run(50)).unwrap();
            hear(&mut scenario, &report(ecu, if ecu == Ecu::Amt { 0b01100 } else { 11 }, TURNING));
            assert_eq!(scenario.telemetry().in_doubt.is_some(), in_doubt, "{ecu:?}");
        }
        assert!(scenario.bench.event_kinds().contains(&Event::LifeConfirmed));
    }
}

/// AMT-9: with the ECU's power-up a life is over at once, however far it was, and standby is in the reply to that set.
#[test]
fn amt_9_a_power_up_ends_a_life() {
    let setup = amt_frames::setup("9.35 140617 ");
    for (name, far) in
        [("ordered", None), ("starting", Some(Says::Starting)), ("running", Some(Says::Running))]
    {
        for after_gap in [false, true] {
            let mut scenario = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
            scenario.command(run(0)).unwrap();
            for says in far.into_iter().flat_map(|far| [Says::Starting, far]) {
                scenario.says(says);
            }
            if after_gap && far.is_some() {
                scenario.silent().pass(gap(Ecu::Amt));
            }
            scenario.bench.events();
            scenario.silent().pass(EVERY);
            scenario.sent();
            scenario.bench.receive(&setup);
            assert_eq!((scenario.order(), scenario.sent()), (Order::Standby, vec![Wire::Standby]), "{name}");
            assert_eq!(ends(&mut scenario), [End::PowerUp], "{name}");
            scenario.fly(run(0), Origin::Rc, SECOND);
            assert_eq!(
                scenario.command(run(0)),
                Err(Rejected::StandbyFirst),
                "{name}: nor does it start later"
            );
        }
    }
}

/// Until the first report of starting, rest fits, and a gap ends the start, to the tick. After it a gap is doubt.
#[test]
fn a_gap_ends_a_start_that_has_not_begun() {
    for ecu in BOTH {
        for says in [Says::Standby, Says::Starting] {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            scenario.command(run(0)).unwrap();
            scenario.says(says);
            assert_eq!(scenario.order(), Order::Run(percent(0)), "{ecu:?} {says:?}");
            scenario.bench.events();
            let last = scenario.telemetry().last_rx.unwrap().as_micros();
            scenario.command(run(0)).unwrap();
            scenario.silent().to(last + gap(ecu) - 1);
            assert_eq!(scenario.order(), Order::Run(percent(0)), "{ecu:?} {says:?}");
            scenario.to(last + gap(ecu));
            let (order, end) = match says {
                Says::Standby => (Order::Standby, vec![End::GapInStart]),
                _ => (Order::Doubt(percent(0)), vec![]),
            };
            assert_eq!((scenario.order(), ends(&mut scenario)), (order, end), "{ecu:?} {says:?}");
        }
    }
}

/// In a start rest and an earlier stage than before end it at the second report, and any starting state after a gap; one
/// report does not, and a later stage fits.
#[test]
fn an_earlier_stage_ends_a_start() {
    use End::{AtRest, StartsAgain};
    const GAP: u8 = u8::MAX;
    let table: [(Ecu, &[u8], Option<End>); 15] = [
        // With a shaft below half of idle.
        (Ecu::Amt, &[0b00010, 0b00010, 0b00100, 0b00100, 0b01000, 0b01000], None),
        (Ecu::Amt, &[0b00010, 0b00010, 0b00000, 0b00000], Some(AtRest)),
        (Ecu::Amt, &[0b00010, 0b00010, 0b00001, 0b00001], Some(AtRest)),
        (Ecu::Amt, &[0b00100, 0b00100, 0b00010, 0b00010], Some(StartsAgain)),
        (Ecu::Amt, &[0b01000, 0b01000, 0b00100, 0b00100], Some(StartsAgain)),
        (Ecu::Amt, &[0b00010, 0b00010, 0b00000, 0b01000], None),
        (Ecu::Amt, &[0b00010, 0b00010, GAP, 0b00010, 0b00010], Some(StartsAgain)),
        (Ecu::Zk, &[3, 3, 4, 4, 2, 2, 5, 5], None),
        (Ecu::Zk, &[3, 3, 1, 1], Some(AtRest)),
        (Ecu::Zk, &[3, 3, 12, 12], Some(AtRest)),
        (Ecu::Zk, &[5, 5, 3, 3], Some(StartsAgain)),
        (Ecu::Zk, &[5, 5, 3, 5], None),
        (Ecu::Zk, &[3, 3, GAP, 3, 3], Some(StartsAgain)),
        (Ecu::Zk, &[3, 3, GAP, 5, 5], Some(StartsAgain)),
        (Ecu::Zk, &[3, 3, GAP, 13, 13], Some(StartsAgain)),
    ];
    for (ecu, reports, end) in table {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.command(run(0)).unwrap();
        let name = format!("{ecu:?} {reports:?}");
        for (i, state) in reports.iter().enumerate() {
            assert!(!matches!(scenario.order(), Order::Standby), "{name}: not before the last");
            let _ = scenario.command(run(0));
            if *state == GAP {
                scenario.silent().pass(gap(ecu));
            } else {
                hear(&mut scenario, &report(ecu, *state, SLOW));
            }
            assert!(i > 0 || scenario.order() == Order::Run(percent(0)), "{name}");
        }
        assert_eq!(scenario.order() == Order::Standby, end.is_some(), "{name}");
        assert_eq!(ends(&mut scenario), end.into_iter().collect::<Vec<_>>(), "{name}");
    }
}

/// With a shaft that turns at half of idle an earlier stage is none of a new start, unless there was a gap.
#[test]
fn an_earlier_stage_with_a_shaft_that_turns_ends_nothing() {
    for (ecu, far, earlier) in [(Ecu::Amt, 0b01000, 0b00010), (Ecu::Amt, 0b00100, 0b00010), (Ecu::Zk, 5, 3)] {
        for (rpm, ends) in [(TURNING, false), (SLOW, true)] {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            scenario.command(run(0)).unwrap();
            for state in [far, far, earlier, earlier, earlier] {
                let _ = scenario.command(run(0));
                hear(&mut scenario, &report(ecu, state, rpm));
            }
            assert_eq!(scenario.order() == Order::Standby, ends, "{ecu:?} {far} {earlier} {rpm}");
        }
    }
}

/// A shaft that slows down raises doubt and helps to end a life; alone it neither ends nor confirms one.
#[test]
fn a_shaft_alone_neither_ends_nor_confirms() {
    let shaft = |rpm| zk_frames::status(2, rpm, [0, 0, 0]).to_vec();
    let rest = report(Ecu::Zk, 1, SLOW);
    let mut scenario = flying(Ecu::Zk);
    for _ in 0..20 {
        scenario.command(run(50)).unwrap();
        hear(&mut scenario, &shaft(SLOW));
        assert_eq!(scenario.order(), Order::Doubt(percent(50)), "it ends none alone");
    }
    for _ in 0..20 {
        scenario.command(run(50)).unwrap();
        hear(&mut scenario, &shaft(TURNING));
        assert_eq!(scenario.order(), Order::Doubt(percent(50)), "it confirms none");
    }
    hear(&mut scenario, &rest);
    assert_eq!(scenario.order(), Order::Doubt(percent(50)));
    hear(&mut scenario, &shaft(SLOW));
    assert_eq!((scenario.order(), ends(&mut scenario)), (Order::Standby, vec![End::AtRest]), "it helps");
}

/// An ECU that restarts the engine by itself (ZK 13) has the start's time for it, to the tick.
#[test]
fn zk_13_is_bounded_by_the_time_of_a_start() {
    let config = Ecu::Zk.with(|s| s.start.timeout = Duration::from_secs(20));
    for running_at in [None, Some(19 * SECOND)] {
        let mut scenario = Scenario::started_with(Ecu::Zk, config, percent(50));
        hear(&mut scenario, &report(Ecu::Zk, 13, TURNING));
        let from = scenario.now();
        let mut end = from + 20 * SECOND;
        while scenario.now() < end - EVERY {
            let _ = scenario.command(run(50));
            let back = running_at.is_some_and(|at| scenario.now() >= from + at);
            hear(&mut scenario, &report(Ecu::Zk, if back { 11 } else { 13 }, TURNING));
            end = from + if running_at.is_some() { 40 * SECOND } else { 20 * SECOND };
        }
        scenario.to(end - 1);
        assert_eq!(scenario.order(), Order::Run(percent(50)), "{running_at:?}");
        scenario.bench.events();
        scenario.to(end);
        let expected = if running_at.is_some() { Order::Run(percent(50)) } else { Order::Standby };
        assert_eq!(scenario.order(), expected, "{running_at:?}");
        assert_eq!(scenario.limits(), vec![LimitKind::StartTimeout; usize::from(running_at.is_none())]);
    }
}

/// In doubt a demand goes down, and not up; it rises when the life is confirmed.
#[test]
fn a_demand_does_not_rise_in_doubt() {
    for ecu in BOTH {
        let mut scenario = flying(ecu);
        scenario.silent().fly(run(50), Origin::Rc, gap(ecu));
        scenario.fly(run(80), Origin::Rc, SECOND);
        assert_eq!(scenario.order(), Order::Doubt(percent(50)), "{ecu:?}");
        scenario.fly(run(20), Origin::Rc, PERIOD);
        assert_eq!(scenario.order(), Order::Doubt(percent(20)), "{ecu:?}");
        scenario.fly(run(80), Origin::Rc, PERIOD);
        assert_eq!(scenario.order(), Order::Doubt(percent(20)), "{ecu:?}");
        assert_eq!(scenario.telemetry().commanded, Some(percent(80)));
        scenario.says = Some(Says::Running);
        scenario.fly(run(80), Origin::Rc, 2 * EVERY);
        assert!(scenario.tenths() <= 250, "50 % a second: {}", scenario.tenths());
        scenario.fly(run(80), Origin::Rc, 1_200_000);
        assert_eq!(scenario.wire(), Wire::Run(800), "{ecu:?}");
    }
}

/// ZK-9: in mode 3 the demand goes on in doubt, as ID 7 in turn with ID 0: an ECU that restarted has forgotten ID 6 and
/// ignores ID 7. ID 7 needs a version that is known (ZK-7): with the link that is lost. In mode 1 it is ID 0 alone.
#[test]
fn zk_9_in_doubt_a_speed_goes_out_in_turn_with_id_0() {
    for (demand, by_rpm) in [(rpm(80_000), true), (percent(50), false)] {
        let mut scenario = Scenario::started(Ecu::Zk, demand);
        hear(&mut scenario, &report(Ecu::Zk, 1, 0));
        scenario.bench.frames();
        // Rest and running in turn: heard, and in doubt.
        for i in 0..40 {
            scenario.command(Command::Run(demand)).unwrap();
            hear(&mut scenario, &report(Ecu::Zk, if i % 2 == 0 { 11 } else { 1 }, TURNING));
        }
        assert_eq!(scenario.order(), Order::Doubt(demand));
        let bytes = scenario.bench.bytes();
        assert_eq!(bytes.len(), 40);
        let keep_alives = bytes.iter().filter(|bytes| **bytes == zk_frames::keep_alive()).count();
        assert_eq!(keep_alives, if by_rpm { 20 } else { 40 }, "{bytes:02x?}");
        for pair in bytes.windows(2).filter(|_| by_rpm) {
            assert_eq!(pair.iter().filter(|bytes| bytes[1] >> 4 == 7).count(), 1, "{pair:02x?}");
        }
        scenario.fly(Command::Run(demand), Origin::Rc, SECOND);
        scenario.bench.frames();
        scenario.fly(Command::Run(demand), Origin::Rc, SECOND);
        let bytes = scenario.bench.bytes();
        let keep_alives = bytes.iter().filter(|bytes| **bytes == zk_frames::keep_alive()).count();
        assert_eq!((bytes.len(), keep_alives), (20, if by_rpm { 10 } else { 20 }), "{demand:?}: lost");
    }
}

/// A life that nothing confirms loses its order: AMT when no set was replied to for the ECU's serial delay time. ZK goes on with
/// ID 0 for as long as its source is fresh. If the ECU is back, however late, two reports with shaft speed bring the engine
/// back, unless standby or a stop was sent meanwhile.
#[test]
fn an_order_that_nothing_confirms_is_gone_and_the_engine_is_not() {
    for ecu in BOTH {
        for (meanwhile, goes_on) in
            [(None, true), (Some(Command::ShutDown), false), (Some(Command::EmergencyStop), false)]
        {
            let mut scenario = flying(ecu);
            let last = scenario.telemetry().last_rx.unwrap().as_micros();
            let left = last + 4 * SECOND - 1 - scenario.now();
            scenario.silent().fly(run(50), Origin::Rc, left);
            assert_eq!(scenario.order(), Order::Doubt(percent(50)), "{ecu:?}");
            scenario.pass(1);
            let order = if ecu == Ecu::Amt { Order::Listen } else { Order::Doubt(percent(50)) };
            assert_eq!(scenario.order(), order, "{ecu:?}");
            scenario.sent();
            scenario.fly(run(50), Origin::Rc, 60 * SECOND);
            assert_eq!((scenario.order(), scenario.sent()), (order, vec![]), "{ecu:?}");
            if let Some(command) = meanwhile {
                scenario.command(command).unwrap();
            } else {
                scenario.fly(run(40), Origin::Rc, PERIOD);
            }
            if ecu == Ecu::Zk {
                scenario.bench.receive(&zk_frames::status(3, TURNING, [40, 0, 0]));
            }
            scenario.values.half_percents = 80;
            let order = scenario.order();
            scenario.says = Some(Says::Running);
            scenario.fly(run(40), Origin::Rc, EVERY);
            assert_eq!(scenario.order(), order, "{ecu:?}: one report is not enough");
            scenario.fly(run(40), Origin::Rc, EVERY);
            let expected = if goes_on { Order::Run(percent(40)) } else { order };
            assert_eq!(scenario.order(), expected, "{ecu:?} {meanwhile:?}");
        }
    }
}

/// In doubt a source that is fresh goes on, and only its standby or a stop ends the run: they go out blind.
#[test]
fn in_doubt_only_standby_or_a_stop_ends_a_run() {
    for ecu in BOTH {
        for (command, wire) in [
            (Command::Standby, Wire::Standby),
            (Command::ShutDown, Wire::Standby),
            (Command::EmergencyStop, Wire::Stop),
        ] {
            let mut scenario = flying(ecu);
            scenario.silent().fly(run(50), Origin::Rc, 3 * SECOND);
            assert_eq!(scenario.order(), Order::Doubt(percent(50)), "{ecu:?}");
            match command {
                Command::Standby => scenario.shut_down().unwrap(),
                command => scenario.command(command).unwrap(),
            };
            scenario.sent();
            // ZK at the next turn, AMT in the reply to the first set of any kind.
            scenario.pass(EVERY);
            if ecu == Ecu::Amt {
                scenario.bench.receive(&amt_frames::alternate(0x06));
            }
            assert_eq!(scenario.sent().pop(), Some(wire), "{ecu:?} {command:?}");
        }
    }
}

/// Runs at 50 %, and from then on nothing wants anything: when the stages of loss have run out.
fn loses_its_source(ecu: Ecu, standby_after: Option<u64>, present: bool) -> (Scenario, u64) {
    let config = ecu.with(|s| s.loss.standby_after = standby_after.map(micros));
    let scenario = Scenario::started_with(ecu, config, percent(50));
    let silent = scenario.now() + if present { 0 } else { AGE };
    (scenario, silent + HOLD + standby_after.unwrap_or(RUN_OUT))
}

/// An order to run without a living engine ends in standby when the stages of loss have run out: 10 s into the fail-safe
/// stage where standby is set to never. To the tick; a source that wants nothing counts as silent. A living one goes on.
#[test]
fn an_order_without_a_living_engine_ends_when_the_stages_have_run_out() {
    for (ecu, heard, standby_after, present) in [
        (Ecu::Amt, true, None, false),
        (Ecu::Amt, true, Some(3 * SECOND), false),
        (Ecu::Amt, true, None, true),
        (Ecu::Amt, false, Some(2 * SECOND), false),
        (Ecu::Zk, true, Some(3 * SECOND), false),
        (Ecu::Zk, false, Some(3 * SECOND), false),
        (Ecu::Zk, false, Some(3 * SECOND), true),
    ] {
        let name = format!("{ecu:?} {heard} {standby_after:?} {present}");
        let (mut scenario, end) = loses_its_source(ecu, standby_after, present);
        if heard {
            // Said to be running, with a shaft that does not turn: in doubt, and no verdict.
            scenario.values.rpm = Some(SLOW);
        } else {
            scenario.silent();
        }
        if present {
            let left = end - 1 - scenario.now();
            scenario.fly(Command::Present, Origin::Rc, left);
        }
        scenario.to(end - 1);
        // An AMT ECU that gets no reply has given up by then, and so has its order.
        let given_up = ecu == Ecu::Amt && heard;
        let order = if given_up { Order::Listen } else { Order::Doubt(percent(0)) };
        assert_eq!(scenario.order(), order, "{name}");
        scenario.sent();
        scenario.to(end);
        assert_eq!(scenario.order(), Order::Standby, "{name}");
        // ZK blind, AMT in its next reply.
        scenario.pass(EVERY);
        let sent = scenario.sent();
        assert_eq!(sent.is_empty(), ecu == Ecu::Amt && !heard, "{name}");
        assert!(sent.iter().all(|wire| *wire == Wire::Standby), "{name} {sent:?}");
    }
    for ecu in BOTH {
        let mut scenario = flying(ecu);
        scenario.pass(600 * SECOND);
        assert_eq!(scenario.wire(), Wire::Run(0), "{ecu:?}: it lives");
    }
}

/// The count of the stages goes on when the order is given up because nothing confirmed the life.
#[test]
fn giving_an_order_up_does_not_begin_the_stages_anew() {
    for ecu in BOTH {
        for present in [false, true] {
            let (mut scenario, end) = loses_its_source(ecu, None, present);
            scenario.silent();
            if present {
                let left = end - 1 - scenario.now();
                scenario.fly(Command::Present, Origin::Rc, left);
            }
            scenario.to(end - 1);
            let order = if ecu == Ecu::Amt { Order::Listen } else { Order::Doubt(percent(0)) };
            assert_eq!(scenario.order(), order, "{ecu:?} {present}");
            scenario.to(end);
            assert_eq!(scenario.order(), Order::Standby, "{ecu:?} {present}");
        }
    }
}

/// Damaged frames keep the beat for 10 s after the last good one, and an AMT ECU its replies. Then they are a gap, to the
/// tick, and confirm nothing.
#[test]
fn damaged_frames_are_no_gap_for_10_s() {
    for ecu in BOTH {
        let mut scenario = flying(ecu);
        let good = scenario.telemetry().last_rx.unwrap().as_micros();
        let mut frame = report(ecu, if ecu == Ecu::Amt { 0b01100 } else { 11 }, TURNING);
        if ecu == Ecu::Zk {
            frame[4] ^= 1;
        }
        // The last that counts comes 50 ms before the 10 s are over.
        let gap = good + 10 * SECOND - EVERY + gap(ecu);
        scenario.silent();
        for i in 1..=240 {
            let at = good + i * EVERY;
            let demand = percent(50);
            if (at - EVERY..at).contains(&(gap - 1)) {
                scenario.to(gap - 1);
                assert_eq!(scenario.order(), Order::Run(demand), "{ecu:?}");
                scenario.to(gap);
                assert_eq!(scenario.order(), Order::Doubt(demand), "{ecu:?}");
            }
            scenario.to(at);
            scenario.command(run(50)).unwrap();
            scenario.sent();
            if ecu == Ecu::Amt {
                scenario.bench.machine.line_error(LineError::Framing);
            }
            scenario.bench.receive(&frame);
            let expected = if at < gap { Order::Run(demand) } else { Order::Doubt(demand) };
            assert_eq!(scenario.order(), expected, "{ecu:?} {} µs", at - good);
            if ecu == Ecu::Amt {
                let replies = if at < gap { vec![Wire::Run(500)] } else { vec![] };
                assert_eq!(scenario.sent(), replies, "{} µs", at - good);
            }
        }
    }
}

/// Disarm ends a start that has not reached running, in doubt or not, and never an engine that has reached it.
#[test]
fn disarm_ends_a_start_and_no_engine() {
    for ecu in BOTH {
        for (says, ends) in [(Says::Standby, true), (Says::Starting, true), (Says::Running, false)] {
            for in_doubt in [false, true] {
                let mut scenario = Scenario::ready(ecu, ecu.config());
                scenario.command(run(0)).unwrap();
                if says != Says::Standby {
                    scenario.says(Says::Starting);
                }
                scenario.says(says);
                if in_doubt && says != Says::Standby {
                    scenario.silent().fly(run(0), Origin::Rc, SECOND);
                }
                for origin in [Origin::Bench, Origin::Rc] {
                    scenario.command_from(Command::Disarm, origin).unwrap();
                    assert!(!scenario.telemetry().armed);
                    assert_eq!(scenario.order() == Order::Standby, ends, "{ecu:?} {says:?} {in_doubt}");
                }
            }
        }
    }
}

// ---------------------------------------------------------------------------------------------
// A start is a permission, used once
// ---------------------------------------------------------------------------------------------

type Step = fn(&mut Scenario);

/// Any refusal uses the permission up: when its reason is gone, the same stream of run starts nothing. Standby does.
#[test]
fn a_refused_start_does_not_happen_later() {
    let table: [(&str, Step, Interlock, Step); 6] = [
        ("fault", |s| s.values.fault = 1, Interlock::Fault, |s| s.values.fault = 0),
        ("hot", |s| s.values.egt = 300, Interlock::TooHot(Celsius::from_tenths(0)), |s| s.values.egt = 26),
        ("egt", |s| s.values.egt = -50, Interlock::EgtUnknown, |s| s.values.egt = 26),
        (
            "cooling",
            |s| s.says = Some(Says::Cooling),
            Interlock::NotStandby,
            |s| s.says = Some(Says::Standby),
        ),
        (
            "limit",
            |s| s.values.rpm = Some(3_000),
            Interlock::Limit(LimitKind::OverSpeed),
            |s| s.values.rpm = None,
        ),
        ("above idle", |_| {}, Interlock::NotIdle, |_| {}),
    ];
    for ecu in BOTH {
        for (name, wrong, interlock, right) in table {
            // A shaft that turns is cooling to an AMT ECU.
            if ecu == Ecu::Amt && name == "limit" {
                continue;
            }
            let config = ecu.with(|s| {
                s.limits.over_speed = Limit { at: Some(Rpm::new(2_500)), action: Action::Standby };
            });
            let mut scenario = Scenario::ready(ecu, config);
            wrong(&mut scenario);
            scenario.pass(4 * EVERY);
            scenario.command(Command::Standby).unwrap();
            let command = if interlock == Interlock::NotIdle { run(50) } else { run(0) };
            let Err(Rejected::Start(why)) = scenario.command(command) else { panic!("{ecu:?} {name}") };
            assert_eq!(core::mem::discriminant(&why), core::mem::discriminant(&interlock), "{ecu:?} {name}");
            right(&mut scenario);
            for _ in 0..50 {
                scenario.pass(PERIOD);
                assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst), "{ecu:?} {name}");
            }
            assert_eq!(scenario.wire(), Wire::Standby);
            scenario.command(Command::Standby).unwrap();
            assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{ecu:?} {name}: the control");
        }
    }
}

/// What uses a permission up, and what does not.
#[test]
fn what_uses_a_permission_up() {
    let table: [(&str, Step, bool); 10] = [
        ("nothing", |_| {}, false),
        (
            "disarm and arm",
            |s| {
                s.command_from(Command::Disarm, Origin::Bench).unwrap();
                s.command(Command::Arm).unwrap();
            },
            true,
        ),
        (
            "present",
            |s| {
                s.command(Command::Present).unwrap();
            },
            true,
        ),
        (
            "shut down",
            |s| {
                s.command_from(Command::ShutDown, Origin::Bench).unwrap();
            },
            true,
        ),
        (
            "stop, release and arm",
            |s| {
                s.command_from(Command::EmergencyStop, Origin::Bench).unwrap();
                s.command_from(Command::ReleaseStop, Origin::Bench).unwrap();
                s.command(Command::Disarm).unwrap();
                s.command(Command::Arm).unwrap();
            },
            true,
        ),
        (
            "another source changes to standby",
            |s| {
                s.command_from(Command::Standby, Origin::Mavlink).unwrap();
            },
            true,
        ),
        (
            "another source repeats standby",
            |s| {
                // It said so before, and goes on.
                s.command_from(Command::Standby, Origin::Mavlink).unwrap();
                s.command(Command::Standby).unwrap();
                s.pass(PERIOD);
                s.command_from(Command::Standby, Origin::Mavlink).unwrap();
            },
            false,
        ),
        (
            "the same source repeats standby",
            |s| {
                s.command(Command::Standby).unwrap();
            },
            false,
        ),
        (
            "a present source above",
            |s| {
                s.command_from(Command::Present, Origin::Emergency).unwrap();
            },
            false,
        ),
        (
            "a release of no stop",
            |s| {
                s.command(Command::ReleaseStop).unwrap();
            },
            false,
        ),
    ];
    for ecu in BOTH {
        for (name, step, used_up) in table {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            step(&mut scenario);
            let answer = scenario.command(run(0));
            assert_eq!(answer == Ok(Accepted::InForce), !used_up, "{ecu:?} {name}: {answer:?}");
            if used_up {
                scenario.fly(run(0), Origin::Rc, 3 * SECOND);
                assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst), "{ecu:?} {name}");
                assert_eq!(scenario.wire(), Wire::Standby);
            }
        }
    }
}

/// One permission is one start: an engine that went out is not started by the stream that started it.
#[test]
fn a_permission_is_used_once() {
    for ecu in BOTH {
        for far in [Says::Starting, Says::Running] {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            scenario.command(run(0)).unwrap();
            scenario.says(Says::Starting).says(far).says(Says::Standby);
            assert_eq!(scenario.order(), Order::Standby, "{ecu:?} {far:?}");
            scenario.fly(run(0), Origin::Rc, 200 * SECOND);
            assert_eq!((scenario.order(), scenario.wire()), (Order::Standby, Wire::Standby));
            scenario.command(Command::Standby).unwrap();
            assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{ecu:?}: the control");
        }
    }
}

/// It is the source's own: standby of one and run of another are no start.
#[test]
fn a_permission_is_one_sources() {
    for ecu in BOTH {
        for says_standby in [true, false] {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            // RC is switched off; MAVLink has streamed below it.
            for _ in 0..30 {
                let command = if says_standby { Command::Standby } else { run(0) };
                let _ = scenario.command_from(command, Origin::Mavlink);
                scenario.pass(PERIOD);
            }
            let expected = if says_standby { Ok(Accepted::InForce) } else { Err(Rejected::StandbyFirst) };
            assert_eq!(scenario.command_from(run(0), Origin::Mavlink), expected, "{ecu:?} {says_standby}");
        }
    }
}

/// Armed, in standby under a steady stream of RC, and its start waits for another engine; until when.
fn start_waits(ecu: Ecu) -> (Scenario, u64) {
    let mut scenario = Scenario::ready(ecu, ecu.config());
    scenario.fly(Command::Standby, Origin::Rc, 2 * SECOND);
    scenario.others_allow_start = false;
    assert_eq!(scenario.command(run(0)), Ok(Accepted::StartWaits));
    let until = scenario.now() + 180 * SECOND;
    assert_eq!(scenario.telemetry().start_waits_until, Some(us(until)), "{ecu:?}");
    scenario.bench.events();
    (scenario, until)
}

/// The wait is over as of now, and the same stream starts nothing when the other engine is done.
fn assert_wait_is_over(scenario: &mut Scenario) {
    assert_eq!(scenario.telemetry().start_waits_until, None);
    let other = Rejected::Start(Interlock::OtherStarting);
    assert!(scenario.bench.event_kinds().contains(&Event::CommandRejected(other, Origin::Rc)));
    scenario.others_allow_start = true;
    scenario.fly(run(0), Origin::Rc, 3 * SECOND);
    assert_eq!((scenario.order(), scenario.wire()), (Order::Standby, Wire::Standby));
}

/// A start that waits for another engine: telemetry shows until when. It goes with its source's next word, and never after
/// that time; to the tick.
#[test]
fn a_start_waits_for_its_time() {
    for ecu in BOTH {
        let (mut scenario, until) = start_waits(ecu);
        let left = until - 1 - scenario.now();
        scenario.fly(run(0), Origin::Rc, left);
        assert_eq!(
            scenario.telemetry().start_waits_until,
            Some(us(until)),
            "{ecu:?}: not anew with each word"
        );
        scenario.others_allow_start = true;
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{ecu:?}");

        let (mut scenario, until) = start_waits(ecu);
        let left = until - scenario.now();
        scenario.fly(run(0), Origin::Rc, left);
        assert_wait_is_over(&mut scenario);
    }
}

/// The wait ends when its source is lost, to the tick, also if that comes back at once.
#[test]
fn a_start_waits_for_as_long_as_its_source_is_fresh() {
    for ecu in BOTH {
        let (mut scenario, until) = start_waits(ecu);
        let last = scenario.now();
        scenario.to(last + AGE - 1);
        assert_eq!(scenario.telemetry().start_waits_until, Some(us(until)), "{ecu:?}");
        scenario.to(last + AGE);
        assert_wait_is_over(&mut scenario);
    }
}

/// And when another source is in control, also for a moment.
#[test]
fn a_start_waits_for_as_long_as_its_source_is_in_control() {
    for ecu in BOTH {
        let (mut scenario, _) = start_waits(ecu);
        let _ = scenario.command_from(run(0), Origin::Emergency);
        assert_wait_is_over(&mut scenario);
    }
}

/// When it goes everything is checked again, and a refusal uses the permission up.
#[test]
fn a_start_that_waited_needs_every_interlock() {
    for ecu in BOTH {
        for (step, why) in [
            ((|s| s.values.egt = 300) as Step, "hot"),
            (|s| s.values.fault = 1, "fault"),
            (|s| s.says = Some(Says::Cooling), "not in standby"),
        ] {
            let (mut scenario, _) = start_waits(ecu);
            step(&mut scenario);
            scenario.pass(2 * EVERY);
            scenario.others_allow_start = true;
            let answer = scenario.command(run(0));
            assert!(matches!(answer, Err(Rejected::Start(_))), "{ecu:?} {why} {answer:?}");
            (scenario.values.egt, scenario.values.fault) = (26, 0);
            scenario.says(Says::Standby);
            scenario.fly(run(0), Origin::Rc, 3 * SECOND);
            assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst), "{ecu:?} {why}");
        }
        // Arming and idle too.
        for command in [Command::Disarm, run(50)] {
            let (mut scenario, _) = start_waits(ecu);
            let _ = scenario.command(command);
            assert_eq!(scenario.telemetry().start_waits_until, None, "{ecu:?} {command:?}");
            scenario.command(Command::Arm).unwrap();
            scenario.others_allow_start = true;
            assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst), "{ecu:?} {command:?}");
        }
    }
}

/// After an emergency stop the engine is disarmed, and whoever said so all along has to say disarm first.
#[test]
fn arming_after_a_stop_needs_a_change() {
    // Who said "arm" before the stop, who while it was latched, who arms after its release.
    for (before, latched, after, answer) in [
        (Origin::Rc, None, Origin::Rc, Err(Rejected::DisarmFirst)),
        (Origin::Rc, None, Origin::Bench, Ok(Accepted::InForce)),
        (Origin::Rc, Some(Origin::Bench), Origin::Bench, Err(Rejected::DisarmFirst)),
        (Origin::Bench, Some(Origin::Rc), Origin::Rc, Err(Rejected::DisarmFirst)),
        (Origin::Bench, None, Origin::Rc, Ok(Accepted::InForce)),
    ] {
        for ecu in BOTH {
            let mut scenario = Scenario::with(ecu, ecu.config());
            scenario.says(Says::Standby).pass(2 * SECOND);
            scenario.command_from(Command::Arm, before).unwrap();
            scenario.command_from(Command::EmergencyStop, Origin::Bench).unwrap();
            assert!(!scenario.telemetry().armed);
            if let Some(origin) = latched {
                assert_eq!(scenario.command_from(Command::Arm, origin), Err(Rejected::StopLatched));
            }
            scenario.command_from(Command::ReleaseStop, Origin::Bench).unwrap();
            assert!(!scenario.telemetry().armed);
            for _ in 0..3 {
                assert_eq!(
                    scenario.command_from(Command::Arm, after),
                    answer,
                    "{ecu:?} {before:?} {latched:?}"
                );
                assert_eq!(scenario.telemetry().armed, answer.is_ok());
            }
            scenario.command_from(Command::Disarm, after).unwrap();
            assert_eq!(scenario.command_from(Command::Arm, after), Ok(Accepted::InForce), "{ecu:?}");
        }
    }
}

// ---------------------------------------------------------------------------------------------
// Sources
// ---------------------------------------------------------------------------------------------

/// Two words of a slow source count within two of its own periods, to the tick, if that is longer than its age limit.
#[test]
fn two_words_of_a_slow_source() {
    for ecu in BOTH {
        for (period, between, counts) in [
            (800_000, 1_600_000, true),
            (800_000, 1_600_001, false),
            (400_000, 1_000_000, true),
            (400_000, 1_000_001, false),
        ] {
            let mut scenario = Scenario::with(ecu, ecu.config());
            scenario.says(Says::Standby).pass(2 * SECOND);
            let fly = |scenario: &mut Scenario, command, times| {
                for _ in 0..times {
                    let _ = scenario.command_from(command, Origin::Mavlink);
                    scenario.pass(period);
                }
            };
            scenario.command(Command::Arm).unwrap();
            fly(&mut scenario, Command::Standby, 4);
            fly(&mut scenario, run(0), 1);
            scenario.says = Some(Says::Starting);
            fly(&mut scenario, run(0), 1);
            scenario.says = Some(Says::Running);
            fly(&mut scenario, run(50), 6);
            assert_eq!(scenario.tenths(), 500, "{ecu:?}");
            let first = scenario.command_from(Command::Standby, Origin::Mavlink);
            assert_eq!(first, Ok(Accepted::OneMore));
            scenario.pass(between);
            assert!(matches!(scenario.order(), Order::Run(_)), "{ecu:?}: a word that stays alone is none");
            let answer = scenario.command_from(Command::Standby, Origin::Mavlink);
            let expected = if counts { Accepted::InForce } else { Accepted::OneMore };
            assert_eq!(answer, Ok(expected), "{ecu:?} {period} {between}");
            assert_eq!(scenario.order() == Order::Standby, counts);
        }
    }
}

/// One explicit order of a person shuts an engine down, whoever is in control, and permits no start. Streams do not bring it
/// back.
#[test]
fn shut_down_is_one_order() {
    for ecu in BOTH {
        for origin in Origin::SOURCES {
            let mut scenario = flying(ecu);
            assert_eq!(scenario.command_from(Command::ShutDown, origin), Ok(Accepted::InForce));
            let ordered = scenario.telemetry().ordered;
            assert_eq!((ordered.order, ordered.origin), (Order::Standby, origin), "{ecu:?}");
            assert!(!scenario.bench.machine.failed());
            scenario.says(Says::Cooling).says(Says::Standby);
            scenario.fly(run(0), origin, 5 * SECOND);
            assert_eq!(
                scenario.command_from(run(0), origin),
                Err(Rejected::StandbyFirst),
                "{ecu:?} {origin:?}"
            );
            scenario.fly(run(0), Origin::Rc, 5 * SECOND);
            assert_eq!(scenario.wire(), Wire::Standby);
        }
        // Not instead of a stop; also of an engine of which nothing is known yet.
        let mut scenario = flying(ecu);
        scenario.command(Command::EmergencyStop).unwrap();
        assert_eq!(scenario.command(Command::ShutDown), Err(Rejected::StopLatched));
        let mut scenario = Scenario::nothing_heard(ecu, ecu.config());
        assert_eq!(scenario.command(Command::ShutDown), Ok(Accepted::InForce));
        scenario.says(Says::Running);
        assert_eq!((scenario.order(), scenario.wire()), (Order::Standby, Wire::Standby), "{ecu:?}");
    }
}

/// A lower source that streams standby ends a run that another began only when the fail-safe stage has lasted its time, to
/// the tick; not when the other comes back before.
#[test]
fn standby_of_a_lower_source_waits() {
    for ecu in BOTH {
        for (after, back_at) in [
            (5 * SECOND, None),
            (2 * SECOND, None),
            (5 * SECOND, Some(1_700_000)),
            (5 * SECOND, Some(4 * SECOND)),
        ] {
            let config = ecu.with(|s| s.loss.lower_standby_after = micros(after));
            let mut scenario = Scenario::started_with(ecu, config, percent(50));
            let last = scenario.now();
            let end = last + AGE + HOLD + after;
            let mut heard = Ok(Accepted::InForce);
            while scenario.now() < end - PERIOD {
                heard = scenario.command_from(Command::Standby, Origin::Mavlink);
                if back_at.is_some_and(|at| scenario.now() >= last + at) {
                    let _ = scenario.command(run(50));
                }
                scenario.pass(PERIOD);
                assert!(matches!(scenario.order(), Order::Run(_)), "{ecu:?} {after} {back_at:?}");
            }
            scenario.to(end - 1);
            assert!(matches!(scenario.order(), Order::Run(_)), "{ecu:?} {after}");
            assert!(heard.is_ok());
            scenario.to(end);
            let ordered = scenario.telemetry().ordered;
            if back_at.is_none() {
                assert_eq!(
                    (ordered.order, ordered.origin),
                    (Order::Standby, Origin::Mavlink),
                    "{ecu:?} {after}"
                );
            } else {
                assert!(matches!(ordered.order, Order::Run(_)), "{ecu:?} {back_at:?}");
            }
        }
    }
}

/// The same source that comes back within the time set goes on without a take-over, at the rate of a rise; to the tick. Only
/// one that was steady before.
#[test]
fn a_short_gap_is_no_loss() {
    for ecu in BOTH {
        for (return_within, late, goes_on) in [
            (SECOND, SECOND - 1, true),
            (SECOND, SECOND, false),
            (0, 0, false),
            (3 * SECOND, 3 * SECOND - 1, true),
        ] {
            let config = ecu.with(|s| s.return_within = micros(return_within));
            let mut scenario = Scenario::started_with(ecu, config, percent(80));
            scenario.fly(run(80), Origin::Rc, SECOND);
            scenario.command(run(80)).unwrap();
            scenario.bench.events();
            let last = scenario.now();
            scenario.to(last + AGE + late);
            let expected = if goes_on { Accepted::InForce } else { Accepted::Held };
            let before = scenario.tenths();
            assert_eq!(scenario.command(run(80)), Ok(expected), "{ecu:?} {return_within} {late}");
            assert_eq!(scenario.tenths(), before, "no jump");
            let stage = scenario.telemetry().loss;
            assert_eq!(stage == LossStage::None, goes_on, "{ecu:?} {stage:?}");
            // At 50 % a second, from there on.
            scenario.fly(run(80), Origin::Rc, 500_000);
            let after = scenario.tenths();
            let expected = if goes_on { 800.min(before + 250) } else { before };
            assert!(after <= expected && (!goes_on || after + 10 >= expected), "{ecu:?} {before} {after}");
            // A second gap soon after the first is none of a steady stream.
            if goes_on {
                scenario.pass(AGE);
                assert_eq!(scenario.command(run(80)), Ok(Accepted::Held), "{ecu:?}");
            }
        }
    }
}

/// A source that is present and wants nothing: not in control, no demand held, never standby. Said by the source in control
/// it is silence from the first such word on.
#[test]
fn present_is_silence_and_no_standby() {
    for ecu in BOTH {
        // In control: the stages of loss begin at once, and repeating it does not begin them anew.
        let mut scenario = flying(ecu);
        let from = scenario.now();
        assert_eq!(scenario.command(Command::Present), Ok(Accepted::InForce));
        assert_eq!((scenario.telemetry().loss, scenario.order()), (LossStage::Hold, Order::Run(percent(50))));
        scenario.fly(Command::Present, Origin::Rc, 100 * SECOND);
        assert_eq!(stages(&mut scenario), [(from, LossStage::Hold), (from + HOLD, LossStage::FailSafe)]);
        assert_eq!(scenario.wire(), Wire::Run(0), "{ecu:?}: never standby");
        // Another takes over from it as from one that is silent, and is not behind it.
        let mut scenario = flying(ecu);
        for _ in 0..40 {
            scenario.command(Command::Present).unwrap();
            let answer = scenario.command_from(run(48), Origin::Bench);
            assert_eq!(answer, Ok(Accepted::InForce), "{ecu:?}");
            scenario.pass(PERIOD);
        }
        assert_eq!((scenario.telemetry().active_source, scenario.wire()), (Origin::Bench, Wire::Run(480)));
        // Below or above the source in control it changes nothing.
        for origin in [Origin::Emergency, Origin::Bench] {
            let mut scenario = flying(ecu);
            for _ in 0..20 {
                scenario.command(run(50)).unwrap();
                let _ = scenario.command_from(Command::Present, origin);
                scenario.pass(PERIOD);
            }
            assert_eq!(
                (scenario.telemetry().active_source, scenario.wire()),
                (Origin::Rc, Wire::Run(500)),
                "{ecu:?}"
            );
            assert_eq!(scenario.bench.event_kinds(), []);
        }
        // It is silence also where nothing is in force yet: standby follows when the stages of loss have run out.
        let mut scenario = Scenario::nothing_heard(ecu, ecu.config());
        assert_eq!(scenario.command(run(0)), Err(Rejected::Listening));
        scenario.pass(PERIOD);
        scenario.fly(Command::Present, Origin::Rc, HOLD + RUN_OUT - 1);
        assert_eq!(scenario.order(), Order::Listen, "{ecu:?}");
        scenario.pass(1);
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}");
        // It is no standby: no start follows it.
        let mut scenario = Scenario::with(ecu, ecu.config());
        scenario.says(Says::Standby).pass(2 * SECOND);
        scenario.command(Command::Arm).unwrap();
        scenario.fly(Command::Present, Origin::Rc, 2 * SECOND);
        scenario.fly(run(0), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.command(run(0)), Err(Rejected::StandbyFirst), "{ecu:?}");
    }
}

// ---------------------------------------------------------------------------------------------
// Resets
// ---------------------------------------------------------------------------------------------

fn retained(order: Order) -> RetainedState {
    RetainedState { armed: true, ..RetainedState::new(order, Origin::Rc) }
}

/// What a record leaves after a loss of power, and of another engine: nothing that could start or raise.
#[test]
fn a_record_after_a_loss_of_power_starts_and_raises_nothing() {
    for ecu in BOTH {
        let config = ecu.config();
        let ours = config.fingerprint();
        for (order, ran, left) in [
            (Order::Run(percent(80)), true, Order::Listen),
            (Order::Run(percent(0)), false, Order::Listen),
            (Order::Pwm, true, Order::Pwm),
            (Order::Pwm, false, Order::Listen),
            (Order::Standby, false, Order::Standby),
            (Order::EmergencyStop, false, Order::EmergencyStop),
            (Order::Listen, true, Order::Listen),
        ] {
            let record =
                RetainedState { ran, by_id6: true, pump_open: true, limited: true, ..retained(order) };
            let memory = RetainedMemory::new();
            memory.store(&record, ours);
            assert_eq!(memory.load(ours, Reset::Warm), Some(record), "{order:?}: the control");
            for (fingerprint, reset) in [(ours, Reset::PowerLost), (ours ^ 1, Reset::Warm)] {
                let record = memory.load(fingerprint, reset).expect("a whole record");
                assert_eq!((record.order, record.ran, record.armed), (left, ran, false), "{ecu:?} {order:?}");
                // It goes on as ID 0.
                let left = if left == Order::Pwm { Order::Listen } else { left };
                assert!(record.by_id6 && record.pump_open && !record.limited);
                let mut scenario = Scenario::after_reset(ecu, config, Some(record));
                assert!(!scenario.telemetry().armed);
                assert_eq!(scenario.order(), left, "{ecu:?} {order:?}");
                // An engine at rest stays there, whatever streams.
                scenario.introduce();
                scenario.says(Says::Standby);
                scenario.fly(run(0), Origin::Rc, 5 * SECOND);
                let wire = if left == Order::EmergencyStop { Wire::Stop } else { Wire::Standby };
                assert_eq!(scenario.wire(), wire, "{ecu:?} {order:?}");
            }
        }
    }
}

/// Where nothing is in force two reports decide: which ones mean an engine that runs, and which one that does not.
#[test]
fn what_is_found_where_nothing_is_in_force() {
    let runs = Order::Run(percent(65));
    let table = [
        (Ecu::Amt, 0b01100, TURNING, runs),
        (Ecu::Amt, 0b01100, SLOW, Order::Listen),
        // Any other state with a shaft that turns is answered.
        // A shaft that coasts beside a cleared start says neither.
        (Ecu::Amt, 0b00001, TURNING, Order::Listen),
        // A start goes on as one: no demand before it runs.
        (Ecu::Amt, 0b00010, TURNING, Order::Run(percent(0))),
        (Ecu::Amt, 0b00100, TURNING, runs),
        (Ecu::Amt, 0b01000, TURNING, runs),
        (Ecu::Amt, 0b11111, TURNING, runs),
        (Ecu::Amt, 0b11111, SLOW, Order::Listen),
        (Ecu::Amt, 0b00000, TURNING, Order::Standby),
        (Ecu::Amt, 0b00001, SLOW, Order::Standby),
        (Ecu::Amt, 0b00010, SLOW, Order::Standby),
        (Ecu::Zk, 11, TURNING, runs),
        (Ecu::Zk, 6, TURNING, runs),
        (Ecu::Zk, 11, SLOW, Order::Listen),
        (Ecu::Zk, 31, TURNING, Order::Listen),
        (Ecu::Zk, 1, TURNING, Order::Standby),
        (Ecu::Zk, 3, TURNING, Order::Standby),
        (Ecu::Zk, 13, TURNING, Order::Standby),
    ];
    for (ecu, state, rpm, second) in table {
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), None);
        scenario.values.rpm = Some(rpm);
        scenario.introduce();
        if ecu == Ecu::Zk {
            scenario.bench.receive(&zk_frames::status(3, rpm, [65, 0, 0]));
        }
        let mut frame = report(ecu, state, rpm);
        if ecu == Ecu::Amt {
            frame[4] = 130;
        }
        for expected in [Order::Listen, second] {
            hear(&mut scenario, &frame);
            assert_eq!(scenario.order(), expected, "{ecu:?} {state} {rpm}");
        }
    }
}

/// AMT-8: after a loss of power an ECU with error sets and a burning exhaust is answered run at its own demand, under the
/// stages of loss, where the record says that the engine ran; else not.
#[test]
fn amt_8_after_a_loss_of_power_a_burning_engine_that_ran_goes_on() {
    for (ran, egt, goes_on) in [(true, 500, true), (false, 500, false), (true, 26, false), (true, 299, false)]
    {
        let memory = RetainedMemory::new();
        let config = Ecu::Amt.config();
        memory.store(&RetainedState { ran, ..retained(Order::Run(percent(90))) }, config.fingerprint());
        let record = memory.load(config.fingerprint(), Reset::PowerLost);
        let mut scenario = Scenario::after_reset(Ecu::Amt, config, record);
        scenario.values = Values { egt, fault: 1, half_percents: 120, ..scenario.values };
        scenario.says = Some(Says::Running);
        scenario.pass(EVERY);
        assert_eq!(scenario.sent(), [], "{ran} {egt}: one set is not enough");
        scenario.pass(EVERY);
        assert_eq!(scenario.sent(), if goes_on { vec![Wire::Run(600)] } else { vec![] }, "{ran} {egt}");
        if goes_on {
            assert_eq!(scenario.telemetry().loss, LossStage::Hold);
            scenario.pass(5 * SECOND);
            assert_eq!((scenario.wire(), scenario.telemetry().loss), (Wire::Run(0), LossStage::FailSafe));
        } else {
            scenario.pass(5 * SECOND);
            assert_eq!(scenario.sent(), [], "{ran} {egt}");
        }
    }
}

/// That an engine ran is kept until standby, a stop or the end of its life.
#[test]
fn a_record_says_that_the_engine_ran() {
    let table: [(&str, Step, bool); 6] = [
        ("flying", |_| {}, true),
        (
            "in doubt",
            |s| {
                s.silent().fly(run(50), Origin::Rc, SECOND);
            },
            true,
        ),
        (
            "unconfirmed",
            |s| {
                s.silent().fly(run(50), Origin::Rc, 20 * SECOND);
            },
            true,
        ),
        (
            "standby",
            |s| {
                s.shut_down().unwrap();
            },
            false,
        ),
        (
            "stop",
            |s| {
                s.command(Command::EmergencyStop).unwrap();
            },
            false,
        ),
        (
            "at rest",
            |s| {
                s.says(Says::Cooling);
            },
            false,
        ),
    ];
    for ecu in BOTH {
        for (name, step, ran) in table {
            let mut scenario = flying(ecu);
            step(&mut scenario);
            assert_eq!(scenario.bench.machine.record().ran, ran, "{ecu:?} {name}");
        }
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.command(run(0)).unwrap();
        scenario.says(Says::Starting);
        assert!(!scenario.bench.machine.record().ran, "{ecu:?}: a start is no run");
    }
}

/// Resets in a row without a source are counted; one word ends the row. From the third the engine is resumed at the fail-safe
/// stage.
#[test]
fn resets_without_a_source_are_counted() {
    for ecu in BOTH {
        for speaks_after in [None, Some(1)] {
            let mut scenario = flying(ecu);
            for reset in 1..=3_u8 {
                scenario = scenario.reset(ecu.config());
                assert_eq!(scenario.bench.machine.record().resets, reset, "{ecu:?}");
                scenario.pass(3 * EVERY);
                if speaks_after == Some(reset) {
                    scenario.command(run(50)).unwrap();
                    assert_eq!(scenario.bench.machine.record().resets, 0, "{ecu:?}");
                    scenario = scenario.reset(ecu.config());
                    assert_eq!(scenario.bench.machine.record().resets, 1, "{ecu:?}");
                    break;
                }
            }
            scenario.pass(3 * EVERY);
            let expected = if speaks_after.is_none() { LossStage::FailSafe } else { LossStage::None };
            assert_eq!(scenario.telemetry().loss, expected, "{ecu:?} {speaks_after:?}");
        }
    }
}

/// A reset loop of any period: with a fresh source the engine stays at its demand, without one it comes to idle, and to
/// standby when nothing has been heard for 10 s and more.
#[test]
fn reset_loop_of_any_period_does_not_hold_a_demand() {
    for ecu in BOTH {
        for period in [60_000, 110_000, 150_000, 200_000, 290_000, 500_000, 1_050_000, 2_000_000] {
            let mut scenario = flying(ecu);
            let mut total = 0;
            let mut before = 500;
            while total < 15 * SECOND {
                scenario.pass(period);
                total += period;
                for wire in scenario.sent() {
                    let Wire::Run(tenths) = wire else { continue };
                    // AMT counts in half percents.
                    assert!(tenths <= before + 4, "{ecu:?} {period}: {tenths} after {before}");
                    assert!(total < 5 * SECOND || tenths == 0, "{ecu:?} {period}: {tenths} after {total} µs");
                    before = tenths;
                }
                scenario = scenario.reset(ecu.config());
            }
            assert_eq!(scenario.order(), Order::Standby, "{ecu:?} {period}");
            // The control: the source speaks after each reset, as soon as the engine is confirmed.
            let mut scenario = flying(ecu);
            // What is retained is what has gone out.
            scenario.fly(run(50), Origin::Rc, 4 * EVERY);
            for _ in 0..20 {
                scenario = scenario.reset(ecu.config());
                scenario.fly(run(50), Origin::Rc, period.max(110_000));
                assert_eq!(scenario.order(), Order::Run(percent(50)), "{ecu:?} {period}");
            }
        }
    }
}

/// A hand-over to PWM is resumed as ID 0, which leaves PWM in charge, until two reports say at rest: then standby. After a loss
/// of power, too: it can only preserve.
#[test]
fn zk_8_a_hand_over_after_a_reset() {
    let config = Ecu::Zk.config();
    for reset in [Reset::Warm, Reset::PowerLost] {
        let mut before = Scenario::ready(Ecu::Zk, config);
        before.command(Command::HandOverToPwm).unwrap();
        before.says(Says::Starting).says(Says::Running);
        let memory = RetainedMemory::new();
        memory.store(&before.bench.machine.record(), config.fingerprint());
        let mut scenario = Scenario::after_reset(Ecu::Zk, config, memory.load(config.fingerprint(), reset));
        scenario.says = Some(Says::Unknown);
        scenario.introduce();
        scenario.pass(9 * SECOND);
        assert_eq!(scenario.sent(), [], "{reset:?}");
        scenario.pass(51 * SECOND);
        // Nobody commands, and nothing ends it but the engine.
        assert_eq!(scenario.sent(), [], "{reset:?}: ID 0 only");
        scenario.says(Says::Running).pass(60 * SECOND);
        assert_eq!(scenario.sent(), [], "{reset:?}: it runs, and is not handed over anew");
        scenario.silent();
        {
            hear(&mut scenario, &report(Ecu::Zk, 1, 0));
            assert_ne!(scenario.order(), Order::Standby);
            hear(&mut scenario, &report(Ecu::Zk, 1, 0));
            assert_eq!(scenario.order(), Order::Standby);
        }
    }
}

// ---------------------------------------------------------------------------------------------
// AMT with error sets only: the exhaust is the evidence
// ---------------------------------------------------------------------------------------------

/// The exhaust at a time in µs, in °C.
type Egt = fn(u64) -> i32;

/// What becomes of the run.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Run {
    /// It is answered with the demand.
    GoesOn,
    /// The life is over.
    Over,
}

/// Flies with error sets; the exhaust is at `egt` of the time in µs since they began.
fn with_faults(micros: u64, fault: u8, demand: Command, egt: impl Fn(u64) -> i32) -> Scenario {
    let mut scenario = flying(Ecu::Amt);
    // It warms up as an exhaust does.
    for i in 1..=40 {
        scenario.values.egt = 26 + (egt(0) - 26) * i / 40;
        let _ = scenario.command(run(50));
        scenario.pass(EVERY);
    }
    scenario.values.fault = fault;
    scenario.command(demand).unwrap();
    let from = scenario.now();
    while scenario.now() < from + micros {
        scenario.values.egt = egt(scenario.now() - from);
        let _ = scenario.command(demand);
        scenario.pass(EVERY);
    }
    scenario
}

#[test]
fn amt_8_an_exhaust_that_does_not_burn_ends_a_life() {
    use Run::{GoesOn, Over};
    let table: [(&str, u64, u8, Egt, Run); 12] = [
        ("burns", 30 * SECOND, 1, |_| 500, GoesOn),
        ("just above the limit", 30 * SECOND, 1, |_| 310, GoesOn),
        ("just below it", 200_000, 1, |_| 295, Over),
        ("cold", 200_000, 1, |_| 26, Over),
        ("falls by 20 °C a second, 2.5 s", 2_500_000, 1, |t| 700 - (t / 50_000) as i32, GoesOn),
        ("falls by 20 °C a second, 5 s", 5 * SECOND, 1, |t| 700 - (t / 50_000) as i32, Over),
        ("falls by 10 °C a second", 15 * SECOND, 1, |t| 700 - (t / 100_000) as i32, GoesOn),
        ("sensor faulty, cold", 30 * SECOND, 1 << 3, |_| 26, GoesOn),
        ("sensor open", 30 * SECOND, 1, |t| if t > 0 { -50 } else { 500 }, GoesOn),
        ("sensor shorted", 30 * SECOND, 1, |t| if t > 0 { 1_110 } else { 500 }, GoesOn),
        ("step down", 30 * SECOND, 1, |t| if t > SECOND { 26 } else { 500 }, GoesOn),
        ("one odd set", 30 * SECOND, 1, |t| if t / EVERY == 20 { 26 } else { 500 }, GoesOn),
    ];
    for (name, time, fault, egt, becomes) in table {
        let mut scenario = with_faults(time, fault, run(50), egt);
        let (order, wire) = match becomes {
            GoesOn => (Order::Doubt(percent(50)), Wire::Run(500)),
            Over => (Order::Standby, Wire::Standby),
        };
        assert_eq!(scenario.order(), order, "{name}");
        scenario.command(run(50)).ok();
        assert_eq!(scenario.wire(), wire, "{name}");
        let end = if becomes == Over { vec![End::NotBurning] } else { vec![] };
        assert_eq!(ends(&mut scenario), end, "{name}");
    }
}

/// A fall within 5 s after a lower demand is what was asked for; after that it is not.
#[test]
fn amt_8_a_fall_after_a_lower_demand_was_asked_for() {
    let fall = |t: u64| 700 - (t / 50_000) as i32;
    for (demand, time, over) in [
        (run(20), 4_900_000, false),
        (run(20), 9 * SECOND, true),
        // The control: the same fall at the same demand.
        (run(50), 4_900_000, true),
    ] {
        let mut scenario = with_faults(time, 1, demand, fall);
        let expected = if over { vec![End::NotBurning] } else { vec![] };
        assert_eq!(ends(&mut scenario), expected, "{demand:?} {time}");
    }
}

/// Where the exhaust is not known the order goes on under the stages of loss, and ends in standby when they have run out, to
/// the tick. Where it burns it goes on at the fail-safe throttle.
#[test]
fn amt_8_without_a_source_only_a_burning_engine_goes_on() {
    // The hottest that an AMT ECU can say is about 1120 °C: a thermocouple that is broken.
    let table: [(u8, Egt, bool); 3] = [(1, |_| 500, true), (1 << 3, |_| 500, false), (1, |_| 1_110, false)];
    for (fault, egt, burns) in table {
        let mut scenario = with_faults(2 * SECOND, fault, run(50), egt);
        scenario.command(run(50)).unwrap();
        let last = scenario.now();
        scenario.to(last + AGE + HOLD + RUN_OUT - 1);
        assert_eq!(scenario.order(), Order::Doubt(percent(0)), "{fault}");
        scenario.pass(1);
        let expected = if burns { Order::Doubt(percent(0)) } else { Order::Standby };
        assert_eq!(scenario.order(), expected, "{fault}");
    }
}

/// One odd error set is no fault, also after an earlier one: a cold exhaust ends no life then.
#[test]
fn amt_8_one_odd_error_set_ends_no_life() {
    for odd in [1, 2] {
        let mut scenario = with_faults(2 * SECOND, 1, run(50), |_| 500);
        scenario.values.fault = 0;
        // The fault clears, and the exhaust is below what burns: an engine at low power.
        for i in 1..=100 {
            scenario.values.egt = 500 - 21 * i / 10;
            scenario.command(run(50)).unwrap();
            scenario.pass(EVERY);
        }
        scenario.fly(run(50), Origin::Rc, 2 * SECOND);
        assert_eq!(scenario.order(), Order::Run(percent(50)));
        scenario.values.fault = 1;
        for _ in 0..odd {
            scenario.command(run(50)).unwrap();
            scenario.pass(EVERY);
        }
        assert_eq!(scenario.order() == Order::Standby, odd == 2, "{odd}");
    }
}

/// When the fault clears, the reply to the first normal sets is run only where they say running, with a shaft that turns.
#[test]
fn amt_8_after_a_fault_run_is_said_to_a_running_engine_only() {
    for (state, rpm, answered) in [
        (0b01100, TURNING, true),
        (0b00100, TURNING, false),
        (0b01000, TURNING, false),
        (0b11111, TURNING, false),
        (0b01100, SLOW, false),
        (0b00000, TURNING, false),
        (0b00001, 0, false),
        (0b00001, TURNING, false),
        (0b00010, SLOW, false),
        (0b00010, TURNING, false),
    ] {
        // Its sensor is broken, so that the exhaust says nothing.
        let mut scenario = with_faults(2 * SECOND, 1 << 3, run(50), |_| 500);
        scenario.silent().pass(EVERY);
        scenario.command(run(50)).unwrap();
        scenario.sent();
        scenario.bench.receive(&report(Ecu::Amt, state, rpm));
        let expected = if answered { vec![Wire::Run(500)] } else { vec![] };
        assert_eq!(scenario.sent(), expected, "{state:#07b} {rpm}");
    }
}

/// Whose life is in doubt has reached running all the same: its demand shows, and the others of its group may start.
#[test]
fn an_engine_in_doubt_keeps_no_other_from_a_start() {
    for ecu in BOTH {
        let mut scenario = flying(ecu);
        assert!(matches!(scenario.telemetry().commanded, Some(Demand::Throttle(_))));
        scenario.silent().fly(run(50), Origin::Rc, 3 * SECOND);
        assert_eq!(scenario.telemetry().commanded, Some(percent(50)), "{ecu:?}");
        assert!(!scenario.bench.machine.blocks_other_starts(us(scenario.now() + 20 * SECOND)));
    }
}

/// One odd report of a start moves it on no more than one odd report ends it: the reports at rest around it still fit.
#[test]
fn one_odd_report_of_starting_begins_nothing() {
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.command(run(0)).unwrap();
        scenario.says(Says::Standby);
        let values = scenario.values;
        for _ in 0..3 {
            scenario.odd(Says::Starting, values);
            scenario.fly(run(0), Origin::Rc, 4 * EVERY);
        }
        assert_eq!((scenario.order(), ends(&mut scenario)), (Order::Run(percent(0)), vec![]), "{ecu:?}");
        // Two that agree do, and rest ends it then.
        scenario.says(Says::Starting).says(Says::Standby);
        assert_eq!((scenario.order(), ends(&mut scenario)), (Order::Standby, vec![End::AtRest]), "{ecu:?}");
    }
}

/// Every end says something of its own.
#[test]
fn ends_have_names() {
    let ends = [
        End::PowerUp,
        End::AtRest,
        End::StartsAgain,
        End::GapInStart,
        End::NotBurning,
        End::FaultInStart,
        End::Unconfirmed,
    ];
    let names: std::collections::BTreeSet<_> = ends.map(End::name).into_iter().collect();
    assert_eq!(names.len(), ends.len());
    assert!(names.iter().all(|name| name.len() > 10));
}

/// A source whose rpm waits for the ECU's version is there: its run goes on, and the stages of loss do not begin.
#[test]
fn a_source_whose_rpm_waits_for_the_version_is_heard() {
    let config = Ecu::Zk.config();
    let mut scenario = Scenario::started_with(Ecu::Zk, config, percent(50));
    // The line is cut for long enough that the version is forgotten, and comes back without it.
    scenario.silent().fly(run(50), Origin::Rc, 2 * SECOND);
    scenario.says(Says::Running).fly(run(50), Origin::Rc, SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(50)));
    let waits = Rejected::NeedsVersion { needed: 4, known: None };
    assert_eq!(scenario.command(Command::Run(rpm(100_000))), Err(waits));
    scenario.bench.events();
    scenario.fly(Command::Run(rpm(100_000)), Origin::Rc, 5 * SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(50)), "its throttle stays");
    assert_eq!(stages(&mut scenario), []);
}

// ---------------------------------------------------------------------------------------------
// Faults in a start
// ---------------------------------------------------------------------------------------------

/// Two error sets end a start, whatever the exhaust says: its ECU could start the engine again when the fault clears. One odd
/// set ends nothing.
#[test]
fn amt_8_two_error_sets_end_a_start() {
    for says in [Says::Standby, Says::Starting] {
        for (sets, fault, egt, over) in
            [(1, 1, 26, false), (2, 1, 26, true), (2, 1 << 3, 26, true), (2, 1, 500, true)]
        {
            let mut scenario = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
            assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce));
            scenario.says(says);
            for i in 1..=20 {
                scenario.values.egt = 26 + (egt - 26) * i / 20;
                scenario.fly(run(0), Origin::Rc, EVERY);
            }
            scenario.bench.events();
            scenario.values.fault = fault;
            scenario.fly(run(0), Origin::Rc, sets * EVERY);
            let expected = if over { vec![End::FaultInStart] } else { vec![] };
            assert_eq!(ends(&mut scenario), expected, "{says:?} {sets} sets, fault {fault}, {egt} °C");
            // It stays so when the fault clears.
            scenario.values.fault = 0;
            scenario.fly(run(0), Origin::Rc, 2 * SECOND);
            assert_eq!(
                scenario.order() == Order::Standby,
                over,
                "{says:?} {sets} sets, fault {fault}, {egt} °C"
            );
        }
    }
}

/// A start that a reset has cut short goes on as a start: the demand waits for running, its time is bounded, and two error sets
/// end it. One that had reached running before the reset is an engine in flight.
#[test]
fn amt_a_start_that_a_reset_cut_short_goes_on_as_a_start() {
    for (reached, faults) in [(false, false), (false, true), (true, true)] {
        let config = Ecu::Amt.config();
        let mut scenario = Scenario::ready(Ecu::Amt, config);
        scenario.command(run(0)).unwrap();
        scenario.says(Says::Starting);
        if reached {
            scenario.says(Says::Running).fly(run(20), Origin::Rc, 2 * SECOND);
        }
        let mut scenario = scenario.reset(config);
        scenario.values.egt = 500;
        scenario.says(Says::Unknown).fly(run(20), Origin::Rc, SECOND);
        let order = if reached { Order::Doubt(percent(20)) } else { Order::Run(percent(0)) };
        assert_eq!(scenario.order(), order, "{reached}");
        if faults {
            scenario.values.fault = 1;
            scenario.fly(run(20), Origin::Rc, 2 * EVERY);
        } else {
            // The time of a start.
            scenario.fly(run(20), Origin::Rc, 116 * SECOND);
            assert_eq!(scenario.order(), order);
            scenario.fly(run(20), Origin::Rc, 4 * SECOND);
        }
        assert_eq!(scenario.order() == Order::Standby, !reached, "{reached} {faults}");
    }
}

/// A start is ended by one word of its source, also where that has been silent for longer than its age limit.
#[test]
fn one_word_of_a_source_that_was_lost_ends_a_start() {
    for ecu in BOTH {
        for (says, origin, ended) in [
            (Says::Standby, Origin::Rc, true),
            (Says::Starting, Origin::Rc, true),
            (Says::Running, Origin::Rc, false),
            (Says::Starting, Origin::Mavlink, true),
        ] {
            let mut scenario = Scenario::ready(ecu, ecu.config());
            scenario.command(run(0)).unwrap();
            scenario.says(says).pass(2 * AGE);
            let _ = scenario.command_from(Command::Standby, origin);
            assert_eq!(scenario.order() == Order::Standby, ended, "{ecu:?} {says:?} {origin:?}");
        }
        // Below a source that is there it changes nothing.
        let mut scenario = Scenario::ready(ecu, ecu.config());
        scenario.command(run(0)).unwrap();
        scenario.says(Says::Starting);
        assert_eq!(
            scenario.command_from(Command::Standby, Origin::Mavlink),
            Ok(Accepted::Behind(Origin::Rc))
        );
        assert_eq!(scenario.order(), Order::Run(percent(0)), "{ecu:?}");
    }
}

/// With error sets only a demand rises while the exhaust burns, and not while it cools, however slowly.
#[test]
fn amt_8_a_demand_does_not_rise_while_the_exhaust_cools() {
    let table: [(Egt, u16); 3] =
        [(|_| 500, 800), (|t| 500 - (t / 200_000) as i32, 500), (|t| 500 + (t / 200_000) as i32, 800)];
    for (egt, tenths) in table {
        let mut scenario = with_faults(10 * SECOND, 1, run(50), egt);
        let from = scenario.now();
        while scenario.now() < from + 10 * SECOND {
            scenario.values.egt = egt(10 * SECOND + scenario.now() - from);
            let _ = scenario.command(run(80));
            scenario.pass(EVERY);
        }
        assert_eq!(scenario.wire(), Wire::Run(tenths));
    }
}

/// A shaft that coasts beside a cleared start is no verdict; with an exhaust that does not burn it is, in two sets, before the
/// ECU can start the engine again.
#[test]
fn amt_start_clearance_with_a_cold_exhaust_ends_a_life() {
    for (egt, ended) in [(500, false), (26, true)] {
        let mut scenario = flying(Ecu::Amt);
        for i in 1..=40 {
            scenario.values.egt = 26 + (egt - 26) * i / 40;
            let _ = scenario.command(run(50));
            scenario.pass(EVERY);
        }
        for _ in 0..2 {
            scenario.command(run(50)).unwrap();
            let mut frame = report(Ecu::Amt, 0b00001, TURNING);
            frame[3] = u8::try_from((egt + 50) * 10 / 46).unwrap();
            hear(&mut scenario, &frame);
        }
        assert_eq!(scenario.order() == Order::Standby, ended, "{egt} °C");
        assert_eq!(ends(&mut scenario), if ended { vec![End::AtRest] } else { vec![] });
    }
}

// ---------------------------------------------------------------------------------------------
// Orders that were given up
// ---------------------------------------------------------------------------------------------

/// Flies at 80 % under RC, which speaks for so long after the ECU fell silent. Gives when it spoke last.
fn given_up(ecu: Ecu, rc_for: u64, lower: Option<Command>) -> (Scenario, u64) {
    let mut scenario = Scenario::started(ecu, percent(80));
    scenario.silent();
    let end = scenario.now() + rc_for;
    while scenario.now() < end {
        scenario.command(run(80)).ok();
        if let Some(command) = lower {
            scenario.command_from(command, Origin::Mavlink).ok();
        }
        scenario.pass(PERIOD);
    }
    (scenario, end - PERIOD)
}

/// When the order is given up in doubt, the run was still RC's: a lower source's stream of standby waits for the loss of RC
/// and its time, as it does while the order is in force. RC's own counts at once.
#[test]
fn standby_of_a_lower_source_waits_where_the_order_was_given_up() {
    for ecu in [Ecu::Amt] {
        let (mut scenario, last) = given_up(ecu, 11 * SECOND, Some(Command::Standby));
        assert_eq!(scenario.order(), Order::Listen, "{ecu:?}");
        // Default: 5 s after the fail-safe stage began.
        let due = last + AGE + HOLD + 5 * SECOND;
        while scenario.now() < due - PERIOD {
            scenario.fly(Command::Standby, Origin::Mavlink, PERIOD);
            assert_eq!(scenario.order(), Order::Listen, "{ecu:?} {} µs before", due - scenario.now());
        }
        scenario.fly(Command::Standby, Origin::Mavlink, 2 * PERIOD);
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}");

        let (mut scenario, _) = given_up(ecu, 11 * SECOND, None);
        scenario.fly(Command::Standby, Origin::Rc, 2 * PERIOD);
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}: RC's own");
    }
}

/// An engine that comes back after its order was given up goes on where the stages of loss are by then. With its source
/// there it goes on at what the ECU reports.
#[test]
fn an_engine_that_comes_back_is_where_its_loss_would_have_taken_it() {
    // RC is lost at 0.5 s, the hold ends at 1.5 s, and 80 % have fallen by 3.1 s.
    for (later, expected) in [(SECOND, 80), (2_500_000, 30), (4 * SECOND, 0)] {
        let (mut scenario, last) = given_up(Ecu::Amt, 5 * SECOND, None);
        assert_eq!(scenario.order(), Order::Listen);
        scenario.to(last + later - 2 * EVERY);
        scenario.values.half_percents = 160;
        scenario.says = Some(Says::Running);
        while !matches!(scenario.order(), Order::Run(_)) {
            scenario.pass(EVERY);
        }
        let tenths = scenario.tenths();
        assert!(tenths.abs_diff(expected * 10) <= 30, "{tenths} after {later} µs");
    }
    let (mut scenario, _) = given_up(Ecu::Amt, 9 * SECOND, None);
    scenario.values.half_percents = 160;
    scenario.says = Some(Says::Running);
    scenario.fly(run(80), Origin::Rc, 4 * EVERY);
    assert_eq!(scenario.tenths(), 800, "RC is there");
}

// ---------------------------------------------------------------------------------------------
// After a reset
// ---------------------------------------------------------------------------------------------

/// What a record holds of a demand is what went out of it. The first word of its source after a reset is no move of the stick.
#[test]
fn the_first_word_after_a_reset_rises() {
    for ecu in BOTH {
        let config = ecu.config();
        let mut scenario = Scenario::started(ecu, percent(10));
        scenario.fly(run(10), Origin::Rc, SECOND);
        let mut scenario = scenario.reset(config);
        scenario.values.half_percents = 20;
        scenario.says(Says::Running);
        assert_eq!(scenario.order(), Order::Run(percent(10)), "{ecu:?}");
        scenario.command(run(80)).unwrap();
        let from = scenario.now();
        while scenario.order() != Order::Run(percent(80)) {
            let most = 100 + (scenario.now() - from) / 2_000 + 10;
            assert!(u64::from(scenario.tenths()) <= most, "{ecu:?}: {} of {most}", scenario.tenths());
            scenario.fly(run(80), Origin::Rc, EVERY);
        }
        assert!(scenario.now() >= from + 1_300_000, "{ecu:?}");
        // The stick is moved: no slew is set.
        scenario.command(run(100)).unwrap();
        assert_eq!(scenario.tenths(), 1000, "{ecu:?}");
    }
}
