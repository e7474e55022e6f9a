//! Words, reports, gaps and resets in unusual orders. Each test states the rule that it holds the engine to, as docs/failsafe.md does.

use jetlink::command::{Accepted, Command, Demand, Order, Origin};
use jetlink::ecu::{Service, zk};
use jetlink::engine::Engine;
use jetlink::telemetry::Telemetry;
use jetlink::units::Throttle;

use crate::support::bench::us;
use crate::support::frames::{amt as amt_frames, zk as zk_frames};
use crate::support::scenario::{
    BOTH, EVERY, Ecu, PERIOD, SECOND, Says, Scenario, TURNING, Wire, percent, rpm, run,
};

/// Runs at this throttle under RC; nothing is left from before.
fn flying(ecu: Ecu, whole: u8) -> Scenario {
    let mut scenario = Scenario::started(ecu, percent(whole));
    scenario.values.half_percents = whole * 2;
    let _ = scenario.command(run(whole));
    scenario.pass(2 * EVERY);
    let _ = scenario.command(run(whole));
    scenario.sent();
    scenario.bench.events();
    scenario
}

fn hear(scenario: &mut Scenario, frame: &[u8]) {
    scenario.silent().pass(EVERY);
    scenario.bench.receive(frame);
}

/// Two sources say their words every 0.1 s.
fn both(scenario: &mut Scenario, words: &[(Command, Origin)], micros: u64) {
    let end = scenario.now() + micros;
    while scenario.now() < end {
        for (command, origin) in words {
            let _ = scenario.command_from(*command, *origin);
        }
        let next = (scenario.now() + PERIOD).min(end);
        scenario.to(next);
    }
}

/// A ZK ECU that sends the whole cycle of its IDs.
fn zk_cycle(scenario: &mut Scenario, state: u8, shaft: u32, throttle: u8, micros: u64) {
    scenario.silent();
    let end = scenario.now() + micros;
    let mut n = 0;
    while scenario.now() < end {
        scenario.pass(EVERY);
        let frame = match n % 5 {
            0 | 2 => zk_frames::status(1, shaft, [state, 2 << 5, 76]),
            1 => zk_frames::status(6, shaft, [160, 0, 5 << 2]),
            3 => zk_frames::status(3, shaft, [throttle, 0, 0]),
            _ => zk_frames::status(8, shaft, [5, 0, 0]),
        };
        scenario.bench.receive(&frame);
        n += 1;
    }
}

fn runs_in(sent: &[Wire]) -> Vec<u16> {
    sent.iter().filter_map(|wire| if let Wire::Run(tenths) = wire { Some(*tenths) } else { None }).collect()
}

// --- Losses go on over resets ---------------------------------------------------------------

/// "Losses go on over resets. The record keeps how long the source has been silent": a lower source that speaks must not
/// keep a dead one's demand up.
#[test]
fn reset_loop_with_a_dead_rc_above_a_mavlink_that_streams_standby() {
    for ecu in BOTH {
        let config = ecu.config();
        let mut scenario = flying(ecu, 90);
        both(&mut scenario, &[(run(90), Origin::Rc), (Command::Standby, Origin::Mavlink)], 2 * SECOND);
        // RC is dead from here on. 40 s of resets 1 s apart.
        let mut last = Vec::new();
        for _ in 0..40 {
            scenario = scenario.reset(config);
            scenario.bench.frames();
            both(&mut scenario, &[(Command::Standby, Origin::Mavlink)], SECOND);
            last = runs_in(&scenario.sent());
        }
        assert!(
            last.iter().all(|tenths| *tenths == 0),
            "{ecu:?}: RC dead for 40 s, and the wire says run at {last:?}"
        );
    }
}

/// A slow ramp and short lives: from the third reset on the demand is at the fail-safe throttle, because a ramp that goes on only
/// while the node runs would come to no stated end.
#[test]
fn third_reset_without_a_source_is_at_the_fail_safe_throttle() {
    for ecu in BOTH {
        let config = ecu.with(|supervision| {
            supervision.loss.ramp = 100;
            supervision.loss.throttle = Throttle::from_tenths(100).unwrap();
        });
        let mut scenario = flying(ecu, 90);
        for reset in 1..=5 {
            scenario = scenario.reset(config);
            scenario.bench.frames();
            scenario.says = Some(Says::Running);
            scenario.pass(3 * SECOND / 2);
            let sent = runs_in(&scenario.sent());
            assert!(!sent.is_empty(), "{ecu:?}, reset {reset}");
            if reset >= 3 {
                assert!(sent.iter().all(|tenths| *tenths == 100), "{ecu:?}, reset {reset}: {sent:?}");
            }
        }
    }
}

/// The same with a lower source that asks for 20 %.
#[test]
fn reset_loop_with_a_dead_rc_above_a_mavlink_that_runs_at_20() {
    for ecu in BOTH {
        let config = ecu.config();
        let mut scenario = flying(ecu, 90);
        both(&mut scenario, &[(run(90), Origin::Rc), (run(20), Origin::Mavlink)], 2 * SECOND);
        let mut last = Vec::new();
        for _ in 0..40 {
            scenario = scenario.reset(config);
            scenario.bench.frames();
            both(&mut scenario, &[(run(20), Origin::Mavlink)], SECOND);
            last = runs_in(&scenario.sent());
        }
        assert!(
            last.iter().all(|tenths| *tenths <= 200),
            "{ecu:?}: RC dead for 40 s, and the wire says run at {last:?}"
        );
    }
}

/// Brown-outs that follow one another, all sources silent: "Losses go on over resets", "from the third reset without a
/// source it resumes at the fail-safe stage".
#[test]
fn brown_out_loop_with_all_sources_silent() {
    for ecu in BOTH {
        let config = ecu.config();
        let mut scenario = flying(ecu, 90);
        scenario.says = Some(Says::Running);
        let mut last = Vec::new();
        for _ in 0..30 {
            let kept = scenario.bench.machine.record().without_start();
            let values = scenario.values;
            scenario = Scenario::after_reset(ecu, config, Some(kept));
            scenario.values = values;
            scenario.says = Some(Says::Running);
            scenario.introduce();
            if ecu == Ecu::Zk {
                scenario.bench.receive(&zk_frames::status(3, TURNING, [90, 0, 0]));
            }
            scenario.bench.frames();
            scenario.pass(SECOND);
            last = runs_in(&scenario.sent());
        }
        assert!(
            last.iter().all(|tenths| *tenths == 0),
            "{ecu:?}: nobody has spoken for 30 s, and the wire says run at {last:?}"
        );
    }
}

// --- Lives -----------------------------------------------------------------------------------

/// "Doubt acts at once ... one report that does not fit a living engine puts the life in doubt", "The shaft speed in every
/// ZK status and AMT normal set may raise doubt": an engine whose shaft stands is not told run for ever.
#[test]
fn amt_shaft_at_rest_in_any_other_state_raises_doubt() {
    for state in [0b00100, 0b01000, 0b11111] {
        let mut scenario = flying(Ecu::Amt, 50);
        let end = scenario.now() + 60 * SECOND;
        while scenario.now() < end {
            let _ = scenario.command(run(50));
            hear(&mut scenario, &amt_frames::normal(state, amt_frames::RUN, 0));
        }
        scenario.sent();
        let _ = scenario.command(run(50));
        hear(&mut scenario, &amt_frames::normal(state, amt_frames::RUN, 0));
        assert_eq!(
            scenario.sent(),
            [],
            "{state:#07b}: the shaft stands for 60 s; in doubt since {:?}",
            scenario.telemetry().in_doubt
        );
    }
}

/// "When the fault clears, the reply to the first normal sets is not run unless they say running."
#[test]
fn amt_fault_clears_and_the_sets_do_not_say_running() {
    for state in [0b00001, 0b00010, 0b00100, 0b01000, 0b11111] {
        let mut scenario = flying(Ecu::Amt, 90);
        // The exhaust burns.
        scenario.values.egt = 600;
        scenario.fly(run(90), Origin::Rc, 2 * SECOND);
        scenario.values.fault = 0x08;
        scenario.fly(run(90), Origin::Rc, SECOND);
        scenario.values.fault = 0;
        scenario.sent();
        let _ = scenario.command(run(90));
        // The shaft still coasts, at 15 000 rpm.
        let mut set = amt_frames::normal(state, amt_frames::AUTO_STOP, 30);
        set[3] = 140;
        hear(&mut scenario, &set);
        assert_eq!(scenario.sent(), [], "{state:#07b}");
    }
}

/// "One report that does not fit a living engine puts the life in doubt, already in the reply to that very frame": a
/// flame-out to start clearance while the shaft coasts.
#[test]
fn amt_start_clearance_in_flight_while_the_shaft_coasts() {
    let mut scenario = flying(Ecu::Amt, 90);
    scenario.sent();
    for _ in 0..20 {
        let _ = scenario.command(run(90));
        hear(&mut scenario, &amt_frames::normal(amt_frames::CLEARANCE, amt_frames::AUTO_STOP, 30));
    }
    let sent = scenario.sent();
    assert!(!sent.contains(&Wire::Run(900)), "{} replies of run at 90 %", runs_in(&sent).len());
}

/// "A life that is not confirmed within a stated bound loses permission and order": AMT, whose ECU goes on sending.
#[test]
fn amt_life_in_doubt_has_a_bound() {
    let mut scenario = flying(Ecu::Amt, 90);
    let end = scenario.now() + 600 * SECOND;
    while scenario.now() < end {
        let _ = scenario.command(run(90));
        // Running, and the shaft stands.
        hear(&mut scenario, &amt_frames::normal(amt_frames::FULL_OPERATION, amt_frames::RUN, 0));
    }
    assert!(
        !matches!(scenario.order(), Order::Doubt(_) | Order::Run(_)),
        "after 10 min in doubt: {:?}",
        scenario.order()
    );
}

// --- Starts ------------------------------------------------------------------------------------

/// "Disarm ends a start that has not reached running, in doubt or not": also one that a reset has cut short.
#[test]
fn disarm_after_a_reset_in_a_start() {
    let config = Ecu::Amt.config();
    let mut scenario = Scenario::ready(Ecu::Amt, config);
    scenario.command(run(0)).unwrap();
    scenario.says(Says::Starting);
    scenario.fly(run(0), Origin::Rc, SECOND);
    let mut scenario = scenario.reset(config);
    scenario.silent();
    scenario.command(Command::Disarm).unwrap();
    scenario.bench.frames();
    for _ in 0..20 {
        let _ = scenario.command(Command::Present);
        hear(&mut scenario, &amt_frames::normal(amt_frames::STARTED_UP, amt_frames::RUN, 30));
    }
    let sent = scenario.sent();
    assert_eq!(runs_in(&sent).len(), 0, "disarmed, and the start goes on: {sent:?}");
}

/// "A hand-over ... counts as a start", "ends when its source is lost or no longer in control": the permission of a source
/// that has been lost for 10 min.
#[test]
fn hand_over_by_a_source_that_was_lost() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.fly(Command::Standby, Origin::Rc, 2 * SECOND);
    scenario.pass(600 * SECOND);
    let run_answer = scenario.would_answer(run(0));
    assert_ne!(run_answer, Ok(Accepted::InForce), "a run is not obeyed");
    assert_ne!(scenario.command(Command::HandOverToPwm), Ok(Accepted::InForce), "run: {run_answer:?}");
}

// --- Fuel ---------------------------------------------------------------------------------------

fn action(action: zk::codec::Action) -> Command {
    Command::Service(Service::Zk(zk::config::Service::Action(action)))
}

fn closes(frames: &[Vec<u8>]) -> usize {
    frames.iter().filter(|frame| frame[..] == zk_frames::action(13)).count()
}

/// A pump that was opened, and a start: fuel into the engine before the ignition, and ClosePump into the run.
#[test]
fn start_with_an_open_pump() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.command(action(zk::codec::Action::OpenPump)).unwrap();
    scenario.pass(4 * EVERY);
    let frames = scenario.bench.bytes();
    assert!(frames.contains(&zk_frames::action(12).to_vec()), "it is open");
    let answer = scenario.command(run(0));
    scenario.fly(run(0), Origin::Rc, 2 * SECOND);
    let at_start = closes(&scenario.bench.bytes());
    scenario.says(Says::Starting);
    scenario.fly(run(0), Origin::Rc, 10 * SECOND);
    scenario.says(Says::Running);
    scenario.fly(run(50), Origin::Rc, 10 * SECOND);
    scenario.bench.frames();
    scenario.fly(run(50), Origin::Rc, 20 * SECOND);
    let in_run = closes(&scenario.bench.bytes());
    assert!(
        answer != Ok(Accepted::InForce) || at_start > 0 && in_run == 0,
        "{answer:?}; ClosePump at the start {at_start}, to the running engine {in_run}"
    );
}

/// "ClosePump goes out ... until the pump voltage reads zero or ten were sent": a voltage from before the pump was opened
/// reads nothing of it.
#[test]
fn pump_voltage_from_before_the_opening() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    // ID 2: no pump voltage.
    scenario.bench.receive(&zk_frames::status(2, 0, [50, 60, 0]));
    scenario.command(action(zk::codec::Action::OpenPump)).unwrap();
    scenario.pass(3 * EVERY);
    let frames = scenario.bench.bytes();
    assert!(frames.contains(&zk_frames::action(12).to_vec()), "it is open");
    scenario.command(Command::Disarm).unwrap();
    scenario.pass(2 * SECOND);
    assert_eq!(closes(&scenario.bench.bytes()), 10);
}

// --- Sources ------------------------------------------------------------------------------------

/// "A lower source's streamed standby ends a run that another began only when the stages of loss have reached fail-safe and
/// a set time (default 5 s) has passed": after a brown-out, with nothing heard of the ECU for a second.
#[test]
fn mavlink_standby_after_a_brown_out_while_rc_boots() {
    for ecu in BOTH {
        let mut scenario = flying(ecu, 60);
        both(&mut scenario, &[(run(60), Origin::Rc), (Command::Standby, Origin::Mavlink)], 2 * SECOND);
        let kept = scenario.bench.machine.record().without_start();
        assert!(kept.ran);
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), Some(kept));
        // Nothing from the ECU yet; RC's receiver boots for 1.5 s.
        both(&mut scenario, &[(Command::Standby, Origin::Mavlink)], 15 * SECOND / 10);
        assert_ne!(scenario.order(), Order::Standby, "{ecu:?}: 1.5 s after the brown-out");
    }
}

/// "To shut an engine down takes two words within that source's age limit": of the highest source, after a brown-out. The
/// emergency input is lower than nobody.
#[test]
fn emergency_standby_of_an_engine_that_was_found_running() {
    for ecu in BOTH {
        let kept = flying(ecu, 60).bench.machine.record().without_start();
        let mut scenario = Scenario::after_reset(ecu, ecu.config(), Some(kept));
        scenario.values.half_percents = 120;
        scenario.says = Some(Says::Running);
        scenario.introduce();
        if ecu == Ecu::Zk {
            scenario.bench.receive(&zk_frames::status(3, TURNING, [60, 0, 0]));
        }
        scenario.pass(12 * SECOND / 10);
        assert!(matches!(scenario.order(), Order::Run(_)), "{:?}", scenario.order());
        scenario.fly(Command::Standby, Origin::Emergency, SECOND);
        assert_eq!(scenario.order(), Order::Standby, "{ecu:?}: 10 words of standby");
    }
}

/// "A single stray word of a lost stream does not": two, 5 s apart, of a source that was lost.
#[test]
fn two_stray_words_5_s_apart() {
    let mut scenario = flying(Ecu::Zk, 60);
    // The wire from the ECU is cut; the source goes on for 12 s.
    scenario.silent().fly(run(60), Origin::Rc, 12 * SECOND);
    scenario.pass(4 * SECOND);
    let _ = scenario.command(Command::Standby);
    scenario.pass(5 * SECOND);
    let _ = scenario.command(Command::Standby);
    assert_ne!(scenario.order(), Order::Standby);
}

// --- In doubt -----------------------------------------------------------------------------------

/// "in mode 3 the demand as ID 7 in turn with it ... While a source is fresh this goes on".
#[test]
fn rpm_demand_goes_out_for_as_long_as_the_source_is_fresh() {
    let mut scenario = Scenario::started(Ecu::Zk, rpm(100_000));
    let fly = Command::Run(rpm(100_000));
    scenario.fly(fly, Origin::Rc, SECOND);
    // The wire from the ECU is cut, and the pilot lowers the demand.
    scenario.silent();
    for second in 1..=20 {
        scenario.bench.frames();
        scenario.fly(Command::Run(rpm(60_000)), Origin::Rc, SECOND);
        let out = scenario.bench.bytes().iter().filter(|frame| frame[1] >> 4 == 7).count();
        assert!(out > 0, "second {second}: no ID 7; order {:?}", scenario.order());
    }
}

/// "telemetry and an event say that the demand does not reach the engine": for as long as it does not.
#[test]
fn telemetry_says_that_the_demand_does_not_reach_the_engine() {
    let mut scenario = flying(Ecu::Zk, 60);
    scenario.silent().fly(run(30), Origin::Rc, 30 * SECOND);
    let Telemetry { in_doubt, ordered, .. } = scenario.telemetry();
    assert!(in_doubt.is_some(), "30 s without a word of the ECU, the source is fresh: {ordered:?}");
}

/// "only a source's standby or stop ends it": while a source is fresh, doubt does not end in an order that is gone, so that
/// the pilot's demand is refused.
#[test]
fn source_that_is_fresh_keeps_its_demand_in_doubt() {
    let mut scenario = flying(Ecu::Zk, 60);
    scenario.silent().fly(run(60), Origin::Rc, 30 * SECOND);
    assert_eq!(scenario.order(), Order::Doubt(percent(60)));
}

// --- Demands -------------------------------------------------------------------------------------

/// "After a ... take-over ... the demand rises at a set rate": from an rpm to a throttle, of an ECU that has not given its
/// throttle.
#[test]
fn take_over_from_an_rpm_to_a_throttle() {
    let mut scenario = Scenario::started(Ecu::Zk, rpm(20_000));
    let low = Command::Run(rpm(20_000));
    scenario.fly(low, Origin::Rc, SECOND);
    // RC is lost; MAVLink asks for 100 %.
    scenario.bench.frames();
    let mut first = None;
    for _ in 0..100 {
        scenario.fly(run(100), Origin::Mavlink, PERIOD);
        if let Some(tenths) = runs_in(&scenario.sent()).first() {
            first = Some(*tenths);
            break;
        }
    }
    assert!(first.is_some_and(|tenths| tenths < 200), "the first throttle that went out: {first:?}");
}

/// The same, where the throttle that the ECU gave is minutes old.
#[test]
fn take_over_from_an_rpm_to_a_throttle_with_an_old_report() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.bench.receive(&zk_frames::status(3, 0, [100, 0, 0]));
    scenario.command(run(0)).unwrap();
    for says in [Says::Starting, Says::Running] {
        scenario.says(says);
        scenario.command(Command::Run(rpm(20_000))).unwrap();
    }
    scenario.fly(Command::Run(rpm(20_000)), Origin::Rc, 300 * SECOND);
    scenario.bench.frames();
    let mut first = None;
    for _ in 0..100 {
        scenario.fly(run(100), Origin::Mavlink, PERIOD);
        if let Some(tenths) = runs_in(&scenario.sent()).first() {
            first = Some(*tenths);
            break;
        }
    }
    assert!(first.is_some_and(|tenths| tenths < 200), "the first throttle that went out: {first:?}");
}

// --- PWM -----------------------------------------------------------------------------------------

/// "After a reset with a whole record it becomes ID 0, which leaves PWM in charge, until two reports say at rest".
#[test]
fn hand_over_becomes_id_0_after_a_reset() {
    let config = Ecu::Zk.config();
    let mut scenario = Scenario::ready(Ecu::Zk, config);
    scenario.fly(Command::Standby, Origin::Rc, 2 * SECOND);
    scenario.command(Command::HandOverToPwm).unwrap();
    for says in [Says::Starting, Says::Running] {
        scenario.says(says);
    }
    scenario.pass(2 * SECOND);
    let mut scenario = scenario.reset(config);
    scenario.bench.frames();
    scenario.pass(5 * SECOND);
    let sent = scenario.sent();
    assert!(!sent.contains(&Wire::Pwm), "{} frames of SW 0", sent.len());
}

/// A brown-out under PWM: nobody commanded the engine over the wire, and jetlink takes it and brings it to idle.
#[test]
fn brown_out_under_pwm() {
    let config = Ecu::Zk.config();
    let mut scenario = Scenario::ready(Ecu::Zk, config);
    scenario.fly(Command::Standby, Origin::Rc, 2 * SECOND);
    scenario.command(Command::HandOverToPwm).unwrap();
    for says in [Says::Starting, Says::Running] {
        scenario.says(says);
    }
    let kept = scenario.bench.machine.record().without_start();
    let mut scenario = Scenario::after_reset(Ecu::Zk, config, Some(kept));
    scenario.says = Some(Says::Running);
    scenario.introduce();
    scenario.bench.receive(&zk_frames::status(3, TURNING, [70, 0, 0]));
    scenario.bench.frames();
    scenario.pass(6 * SECOND);
    assert_eq!(runs_in(&scenario.sent()), [] as [u16; 0], "the pilot's PWM is overruled");
}

// --- Gaps by a rate ------------------------------------------------------------------------------

/// A ZK ECU that says 100 Hz and answers at the host's 20 Hz (ZK-10): its frames are no gaps.
#[test]
fn ecu_that_says_100_hz_and_answers_at_20_hz() {
    let mut scenario = flying(Ecu::Zk, 60);
    for _ in 0..2 {
        scenario.bench.receive(&zk_frames::status(6, TURNING, [160, 0, 4 << 2 | 2]));
    }
    scenario.fly(run(60), Origin::Rc, 12 * SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(60)), "a frame every 50 ms, and the engine runs");
}

/// Every command at every stage in every mode of a random engine: nothing panics. Seeds are fixed.
#[test]
fn nothing_panics() {
    use jetlink::line::LineError;
    let mut state = 0x1234_5678_9ABC_DEF1_u64;
    let mut next = |n: u64| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state % n
    };
    for _ in 0..300 {
        let ecu = if next(2) == 0 { Ecu::Amt } else { Ecu::Zk };
        let config = ecu.with(|config| {
            if next(2) == 0 {
                config.governor = Some(jetlink::engine::config::Governor::DEFAULT);
            }
        });
        let mut scenario = Scenario::with(ecu, config);
        scenario.says(Says::Standby).pass(2 * SECOND);
        for _ in 0..200 {
            let origin = Origin::ALL[next(5) as usize];
            let command = match next(12) {
                0 => Command::Arm,
                1 => Command::Disarm,
                2 => Command::Present,
                3 | 4 => Command::Standby,
                5 => run(0),
                6 => run(next(101) as u8),
                7 => Command::Run(rpm([0, 1, 5000, 160_000, u32::MAX][next(5) as usize])),
                8 => Command::HandOverToPwm,
                9 => action(zk::codec::Action::ALL[next(13) as usize]),
                10 => [Command::EmergencyStop, Command::ReleaseStop][next(2) as usize],
                _ => Command::ShutDown,
            };
            if next(3) > 0 {
                let _ = scenario.command_from(command, origin);
            }
            match next(10) {
                0 => scenario.says = Some(crate::support::scenario::ALL[next(6) as usize]),
                1 => scenario.says = None,
                2 => scenario.introduce_version(next(64) as u8 & 63),
                3 => scenario.values.egt = next(1100) as i32 - 50,
                4 => scenario.values.rpm = Some((next(127) * 500) as u32),
                5 => scenario.bench.act(|engine, _| engine.line_error(LineError::Framing)),
                6 => {
                    let bytes: Vec<u8> = (0..next(20)).map(|_| next(256) as u8).collect();
                    if !bytes.is_empty() {
                        scenario.bench.receive(&bytes);
                    }
                }
                7 => {
                    let record = scenario.bench.machine.record();
                    let record = if next(2) == 0 { record } else { record.without_start() };
                    scenario = Scenario::after_reset(ecu, config, Some(record));
                    scenario.says = Some(crate::support::scenario::ALL[next(6) as usize]);
                }
                _ => {}
            }
            scenario.pass([1, 20_000, 100_000, 500_000, SECOND, 12 * SECOND][next(6) as usize]);
        }
    }
}

// --- Second round --------------------------------------------------------------------------------

/// "A lower source's streamed standby ends a run that another began only when the stages of loss have reached fail-safe and
/// a set time (default 5 s) has passed": an engine that RC handed over to PWM, a minute into its flight.
#[test]
fn mavlink_standby_under_pwm_when_rc_is_only_present() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.fly(Command::Standby, Origin::Rc, 2 * SECOND);
    scenario.command(Command::HandOverToPwm).unwrap();
    for says in [Says::Starting, Says::Running] {
        scenario.says = Some(says);
        scenario.fly(Command::Present, Origin::Rc, 10 * SECOND);
    }
    scenario.fly(Command::Present, Origin::Rc, 60 * SECOND);
    assert_eq!(scenario.order(), Order::Pwm);
    let words = [(Command::Present, Origin::Rc), (Command::Standby, Origin::Mavlink)];
    let from = scenario.now();
    while scenario.order() != Order::Standby && scenario.now() < from + 10 * SECOND {
        both(&mut scenario, &words, PERIOD);
    }
    let after = scenario.now() - from;
    assert!(after > 5 * SECOND, "shut down {} ms after MAVLink began to stream standby", after / 1000);
}

/// "Damaged frames that keep the beat (bursts of a frame's length when due, no break) are no gap, for 10 s at most, on
/// either protocol": at every rate that the line carries (ZK-11).
#[test]
fn damaged_frames_at_the_fastest_rate_of_a_line() {
    use jetlink::config::EngineConfig;
    use jetlink::ecu::zk::codec::Rate;
    use jetlink::line::Line;
    for (baud, rate, code, every) in
        [(2400, Rate::Hz20, 0, 50_000), (4800, Rate::Hz50, 1, 20_000), (9600, Rate::Hz100, 2, 10_000)]
    {
        let config = EngineConfig::zk("z", 0, Line::new(baud), rate);
        let byte = 10_000_000 / u64::from(baud) + 1;
        let mut scenario = Scenario::nothing_heard(Ecu::Zk, config);
        let mut at = every;
        let mut send = |scenario: &mut Scenario, frame: [u8; 7]| {
            for (n, byte_out) in (1..).zip(frame) {
                scenario.bench.rx(at + n * byte, &[byte_out]);
            }
            at += every;
        };
        let info = [zk_frames::status(8, 0, [5, 0, 0]), zk_frames::status(6, 0, [160, 0, 5 << 2 | code])];
        for _ in 0..2 {
            info.iter().for_each(|frame| send(&mut scenario, *frame));
        }
        for _ in 0..400 {
            send(&mut scenario, zk_frames::status(1, 0, [1, 1 << 5, 76]));
        }
        scenario.command(Command::Arm).unwrap();
        scenario.command(Command::Standby).unwrap();
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce), "{rate:?}");
        for state in [3, 11] {
            for _ in 0..10 {
                let _ = scenario.command(run(0));
                send(&mut scenario, zk_frames::status(1, TURNING, [state, 2 << 5, 76]));
            }
        }
        assert_eq!(scenario.telemetry().in_doubt, None, "{rate:?}");
        let mut doubts = 0;
        for _ in 0..2_000_000 / every {
            let _ = scenario.command(run(0));
            let mut frame = zk_frames::status(1, TURNING, [11, 2 << 5, 76]);
            frame[4] ^= 0x55;
            send(&mut scenario, frame);
            doubts += u32::from(scenario.telemetry().in_doubt.is_some());
        }
        assert_eq!(doubts, 0, "{rate:?} at {baud} baud: in doubt at so many frames of 2 s of noise");
    }
}

/// "A healthy engine in flight is not shut down because jetlink is in doubt": after a reset without a record a ZK ECU reports a
/// running engine on a good link, and its throttle (status ID 3) does not come.
#[test]
fn running_zk_engine_that_does_not_give_its_throttle() {
    let mut scenario = Scenario::after_reset(Ecu::Zk, Ecu::Zk.config(), None);
    scenario.says = Some(Says::Running);
    scenario.introduce();
    scenario.pass(30 * SECOND);
    assert_ne!(scenario.order(), Order::Standby, "600 reports of a running engine");
}

/// The same with an AMT ECU, whose throttle differs by half a percent from set to set.
#[test]
fn running_amt_engine_whose_throttle_dithers() {
    let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), None);
    scenario.bench.frames();
    for n in 0..300_u16 {
        scenario.silent().pass(EVERY);
        let mut set = amt_frames::normal(amt_frames::FULL_OPERATION, amt_frames::RUN, 60);
        set[4] = 120 + (n % 2) as u8;
        scenario.bench.receive(&set);
    }
    let sent = scenario.sent();
    assert!(
        sent.iter().any(|wire| matches!(wire, Wire::Run(_))) && !sent.contains(&Wire::Standby),
        "15 s of sets of a running engine: {sent:?}"
    );
}

/// Commands come before the runner begins: what RC's run was is in the record, and a lower source's standby does not end it.
#[test]
fn mavlink_standby_before_the_runner_begins() {
    let kept = flying(Ecu::Zk, 60).bench.machine.record();
    let config = Ecu::Zk.config();
    let mut engine = Engine::new(&config);
    engine.keep(Some(kept));
    for n in 1..20 {
        let _ = engine.command(us(n * PERIOD), Command::Standby, Origin::Mavlink, true);
    }
    engine.start(us(2 * SECOND), None);
    let order = engine.telemetry(us(2 * SECOND)).ordered.order;
    assert_ne!(order, Order::Standby, "the record: {kept:?}");
}

/// The reset loops, each ECU alone.
#[test]
fn zk_reset_loop_with_a_dead_rc_above_a_mavlink_that_streams_standby() {
    let config = Ecu::Zk.config();
    let mut scenario = flying(Ecu::Zk, 90);
    both(&mut scenario, &[(run(90), Origin::Rc), (Command::Standby, Origin::Mavlink)], 2 * SECOND);
    let mut last = Vec::new();
    for _ in 0..40 {
        scenario = scenario.reset(config);
        scenario.bench.frames();
        both(&mut scenario, &[(Command::Standby, Origin::Mavlink)], SECOND);
        last = runs_in(&scenario.sent());
    }
    assert!(last.iter().all(|tenths| *tenths == 0), "{last:?}");
}

#[test]
fn zk_brown_out_loop_with_all_sources_silent() {
    let config = Ecu::Zk.config();
    let mut scenario = flying(Ecu::Zk, 90);
    let mut last = Vec::new();
    for _ in 0..30 {
        let kept = scenario.bench.machine.record().without_start();
        scenario = Scenario::after_reset(Ecu::Zk, config, Some(kept));
        scenario.says = Some(Says::Running);
        scenario.introduce();
        scenario.bench.receive(&zk_frames::status(3, TURNING, [90, 0, 0]));
        scenario.bench.frames();
        scenario.pass(SECOND);
        last = runs_in(&scenario.sent());
    }
    assert!(last.iter().all(|tenths| *tenths == 0), "{last:?}");
}

/// "From the third reset without a source it resumes at the fail-safe stage": a lower source that is present and wants nothing is
/// none.
#[test]
fn resets_count_only_without_the_source_in_control() {
    let config = Ecu::Zk.config();
    let mut scenario = flying(Ecu::Zk, 90);
    for _ in 0..4 {
        scenario = scenario.reset(config);
        both(&mut scenario, &[(Command::Present, Origin::Bench)], 3 * PERIOD);
    }
    zk_cycle(&mut scenario, 11, TURNING, 90, SECOND);
    let record = scenario.bench.machine.record();
    assert!(record.resets >= 3 || record.loss >= jetlink::event::LossStage::FailSafe, "{record:?}");
}

/// "A pump that was opened is closed at ... silence of its source"; "a source that wants nothing counts as silent".
#[test]
fn pump_is_closed_when_its_source_wants_nothing() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.command(action(zk::codec::Action::OpenPump)).unwrap();
    scenario.pass(4 * EVERY);
    scenario.bench.frames();
    scenario.fly(Command::Present, Origin::Rc, 5 * SECOND);
    assert!(closes(&scenario.bench.bytes()) > 0, "a source that wants nothing counts as silent");
}

/// "An order to run without a living engine ends: ... or the start's time": over resets, too.
#[test]
fn kept_limit_of_a_start_does_not_restart_with_each_reset() {
    let config = Ecu::Amt.config();
    let mut scenario = Scenario::ready(Ecu::Amt, config);
    scenario.command(run(0)).unwrap();
    scenario.says(Says::Starting);
    // "An order to run without a living engine ends: ... or the start's time": 10 resets, 60 s apart, source fresh.
    let mut orders = Vec::new();
    for _ in 0..10 {
        scenario = scenario.reset(config);
        scenario.says = None;
        scenario.bench.frames();
        let end = scenario.now() + 60 * SECOND;
        while scenario.now() < end {
            let _ = scenario.command(run(0));
            hear(&mut scenario, &amt_frames::normal(amt_frames::STARTING, amt_frames::RUN, 30));
        }
        orders.push(scenario.order());
    }
    assert_eq!(orders.last(), Some(&Order::Standby), "10 min in a start: {orders:?}");
}

/// Exhaust as the evidence: a flame-out under an autothrottle whose demand falls by 3 % every 4 s. "An order to run without a
/// living engine ends".
#[test]
fn flame_out_with_error_sets_and_a_demand_that_dithers() {
    let mut scenario = flying(Ecu::Amt, 75);
    scenario.values.egt = 600;
    scenario.fly(run(75), Origin::Rc, 2 * SECOND);
    scenario.values.fault = 0x01;
    scenario.fly(run(75), Origin::Rc, SECOND);
    for n in 0..40 {
        for (whole, seconds) in [(75, 2), (72, 2)] {
            for _ in 0..10 * seconds {
                // 30 degrees a second, down to 20.
                scenario.values.egt = (scenario.values.egt - 3).max(20);
                scenario.fly(run(whole), Origin::Rc, PERIOD);
            }
        }
        if scenario.order() == Order::Standby {
            return;
        }
        let _ = n;
    }
    scenario.sent();
    scenario.fly(run(75), Origin::Rc, SECOND);
    panic!("the exhaust has had 20 degrees for over 2 min: {:?}", scenario.sent());
}

/// "After it, ... any starting state after a gap counts as starting again."
#[test]
fn amt_start_after_a_gap_says_started_up() {
    for shaft in [0] {
        let mut scenario = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
        scenario.command(run(0)).unwrap();
        for _ in 0..4 {
            let _ = scenario.command(run(0));
            hear(&mut scenario, &amt_frames::normal(amt_frames::STARTED_UP, amt_frames::RUN, shaft));
        }
        scenario.silent().fly(run(0), Origin::Rc, SECOND);
        scenario.sent();
        for _ in 0..20 {
            let _ = scenario.command(run(0));
            hear(&mut scenario, &amt_frames::normal(amt_frames::STARTED_UP, amt_frames::RUN, shaft));
        }
        assert_eq!(scenario.order(), Order::Standby, "shaft {shaft}: {:?}", scenario.sent());
    }
}

/// An AMT start over which the node browns out: not armed, no permission, and the ECU has never said running. AMT-14: until
/// full operation the start throttle.
#[test]
fn brown_out_in_an_amt_start_with_the_stick_up() {
    for state in [amt_frames::CLEARANCE, amt_frames::STARTING, amt_frames::STARTED_UP] {
        let mut scenario = Scenario::ready(Ecu::Amt, Ecu::Amt.config());
        scenario.command(run(0)).unwrap();
        scenario.says(Says::Starting);
        let kept = scenario.bench.machine.record().without_start();
        let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), Some(kept));
        scenario.bench.frames();
        for _ in 0..200 {
            let _ = scenario.command(run(100));
            hear(&mut scenario, &amt_frames::normal(state, amt_frames::RUN, 30));
        }
        let most = runs_in(&scenario.sent()).into_iter().max();
        assert!(
            most.unwrap_or(0) == 0,
            "{state:#07b}: run at {most:?}, armed {}",
            scenario.telemetry().armed
        );
    }
}

/// A status rate that is changed in flight, or on a link that came back: frames at the new rate are no gaps.
#[test]
fn status_rate_is_lowered() {
    let mut scenario = flying(Ecu::Zk, 60);
    for _ in 0..2 {
        scenario.bench.receive(&zk_frames::status(6, TURNING, [160, 0, 5 << 2 | 2]));
    }
    // At 100 Hz until it is told 20 Hz.
    scenario.bench.frames();
    let mut doubt = 0;
    let mut slow = false;
    for n in 0..200 {
        let _ = scenario.command(run(60));
        scenario.silent().pass(if slow { 50_000 } else { 10_000 });
        slow |= scenario.bench.bytes().iter().any(|frame| frame[..] == zk_frames::action(7));
        let frame = match n % 9 {
            8 => zk_frames::status(6, TURNING, [160, 0, 5 << 2 | if slow { 0 } else { 2 }]),
            0 => zk_frames::status(1, TURNING, [11, 2 << 5, 76]),
            _ => zk_frames::status(9, TURNING, [70, 0, 0]),
        };
        scenario.bench.receive(&frame);
        doubt += u32::from(scenario.telemetry().in_doubt.is_some());
    }
    assert_eq!(doubt, 0, "in doubt at so many frames");
}

// --- Third round ---------------------------------------------------------------------------------

/// "No engine starts by itself": a node that begins with nothing in memory, nobody who has ever commanded anything, and an AMT
/// engine in start clearance whose shaft turns at 15 000 rpm, because it coasts, windmills or is cooled.
#[test]
fn cold_boot_beside_an_engine_that_coasts_in_start_clearance() {
    let mut scenario = Scenario::after_reset(Ecu::Amt, Ecu::Amt.config(), None);
    scenario.bench.frames();
    for _ in 0..40 {
        hear(&mut scenario, &amt_frames::normal(amt_frames::CLEARANCE, amt_frames::AUTO_STOP, 30));
    }
    let sent = scenario.sent();
    assert_eq!(runs_in(&sent), [] as [u16; 0], "nobody has ever said anything");
}

/// The same after a gap longer than the serial delay time, in which the ECU has stopped its turbine by itself (AMT-12), as it
/// has to: it coasts in start clearance, and is told run at what its source asks for.
#[test]
fn engine_that_its_ecu_stopped_in_a_gap_of_1_s_coasts_in_start_clearance() {
    stopped_in_a_gap(SECOND);
}

#[test]
fn engine_that_its_ecu_stopped_in_a_gap_of_5_s_coasts_in_start_clearance() {
    stopped_in_a_gap(5 * SECOND);
}

fn stopped_in_a_gap(gap: u64) {
    {
        let mut scenario = flying(Ecu::Amt, 90);
        scenario.silent().fly(run(90), Origin::Rc, gap);
        scenario.sent();
        for n in 0..100 {
            let _ = scenario.command(run(90));
            hear(&mut scenario, &amt_frames::normal(amt_frames::CLEARANCE, amt_frames::AUTO_STOP, 140 - n));
        }
        let sent = runs_in(&scenario.sent());
        let first = sent.first().copied();
        let last = sent.last().copied();
        assert_eq!(sent.len(), 0, "gap {} s: run, first {first:?}, last {last:?}", gap / SECOND);
    }
}

/// Nothing is due that the engine does not ask to be woken for: one that is woken when it asks does the same as one that is
/// looked at every 5 ms.
#[test]
fn nothing_comes_late() {
    let mut state = 0x0DDB_1A5E_5BAD_5EED_u64;
    let mut next = move |n: u64| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state % n
    };
    let mut wrong = Vec::new();
    for round in 0..150 {
        let ecu = if next(2) == 0 { Ecu::Amt } else { Ecu::Zk };
        let standby_after = next(3) == 0;
        let config = ecu.with(|config| {
            if standby_after {
                config.loss.standby_after = Some(embassy_time::Duration::from_secs(3));
            }
            config.slew.down = [None, Some(300)][next(2) as usize];
        });
        let mut scenario = Scenario::started_with(ecu, config, percent(60));
        let mut log = Vec::new();
        for _ in 0..60 {
            let origin = Origin::SOURCES[next(4) as usize];
            let command = match next(9) {
                0 => Command::Present,
                1 => Command::Standby,
                2 => run(0),
                3 | 4 => run(next(101) as u8),
                5 => Command::Arm,
                6 => Command::Run(rpm(next(100_000) as u32)),
                7 if next(4) == 0 => Command::Disarm,
                _ => Command::Standby,
            };
            match next(8) {
                0 => scenario.says = None,
                1 => scenario.says = Some(Says::Running),
                2 => scenario.says = Some(Says::Starting),
                3 => scenario.says = Some(crate::support::scenario::ALL[next(6) as usize]),
                _ => {}
            }
            let words = next(4);
            for _ in 0..words {
                let _ = scenario.command_from(command, origin);
                scenario.pass(next(300) * 1000);
            }
            let mut often = scenario.clone();
            let time = next(6_000) * 1000;
            let end = scenario.now() + time;
            log.push(format!(
                "{} {origin:?} {command:?} x{words} says {:?} for {time}",
                scenario.now(),
                scenario.says
            ));
            scenario.to(end);
            while often.now() < end {
                let at = (often.now() + 5000).min(end);
                often.to(at);
                often.bench.act(|engine, now| engine.timeout(now));
            }
            let of = |scenario: &Scenario| {
                let telemetry = scenario.telemetry();
                let order = core::mem::discriminant(&telemetry.ordered.order);
                (
                    order,
                    telemetry.loss,
                    telemetry.active_source,
                    telemetry.waiting,
                    telemetry.in_doubt,
                    telemetry.start_waits_until,
                )
            };
            if of(&scenario) != of(&often) {
                wrong.push(format!(
                    "round {round}: {:?} / {:?}\n{:?}\n{:?}\n{}",
                    of(&scenario),
                    of(&often),
                    scenario.order(),
                    often.order(),
                    log[log.len().saturating_sub(3)..].join("\n")
                ));
                break;
            }
            let (a, b) = (scenario.order(), often.order());
            if let (Order::Run(Demand::Throttle(a)), Order::Run(Demand::Throttle(b))) = (a, b)
                && a.tenths().abs_diff(b.tenths()) > 30
            {
                wrong.push(format!(
                    "round {round}: {a:?} / {b:?}\n{}",
                    log[log.len().saturating_sub(3)..].join("\n")
                ));
                break;
            }
        }
    }
    assert!(wrong.is_empty(), "{} differ:\n{}", wrong.len(), wrong[..wrong.len().min(4)].join("\n\n"));
}

/// "A healthy engine in flight is not shut down because jetlink is in doubt", "Doubt acts at once, the verdict needs agreement": all
/// sources have been silent for a minute, the engine idles at the fail-safe throttle, where `standby_after` is never.
fn idles_at_the_fail_safe(ecu: Ecu) -> Scenario {
    let mut scenario = flying(ecu, 60);
    scenario.says = Some(Says::Running);
    scenario.pass(60 * SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(0)), "{ecu:?}");
    scenario
}

#[test]
fn one_odd_amt_set_at_the_fail_safe_stage() {
    let mut scenario = idles_at_the_fail_safe(Ecu::Amt);
    // AMT frames have no checksum: one set with a flipped bit.
    scenario.bench.receive(&amt_frames::normal(amt_frames::NO_CLEARANCE, amt_frames::RUN, 24));
    scenario.pass(2 * SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(0)));
}

#[test]
fn gap_of_three_zk_frames_at_the_fail_safe_stage() {
    let mut scenario = idles_at_the_fail_safe(Ecu::Zk);
    scenario.silent().pass(160_000);
    scenario.says = Some(Says::Running);
    scenario.pass(2 * SECOND);
    assert_eq!(scenario.order(), Order::Run(percent(0)));
}

#[test]
fn watchdog_reset_at_the_fail_safe_stage() {
    for ecu in BOTH {
        let mut scenario = idles_at_the_fail_safe(ecu).reset(ecu.config());
        scenario.pass(2 * SECOND);
        assert_eq!(scenario.order(), Order::Run(percent(0)), "{ecu:?}");
    }
}

/// "Doubt begins with a gap": a rate that one report says makes none.
#[test]
fn status_6_with_a_false_rate_raises_no_doubt() {
    // One status ID 6 with a good CRC and another rate: "two agreeing reports" for what decides about a gap.
    let mut scenario = flying(Ecu::Zk, 60);
    scenario.bench.receive(&zk_frames::status(6, TURNING, [160, 0, 5 << 2 | 2]));
    scenario.command(run(60)).unwrap();
    scenario.pass(3 * EVERY);
    assert_eq!(scenario.telemetry().in_doubt, None);
}

/// "Damaged frames that keep the beat ... are no gap, for 10 s at most": in rpm mode, too, the demand goes out meanwhile, or
/// telemetry says that it does not.
#[test]
fn rpm_demand_goes_out_through_2_s_of_damaged_frames() {
    let mut scenario = Scenario::started(Ecu::Zk, rpm(100_000));
    scenario.fly(Command::Run(rpm(100_000)), Origin::Rc, SECOND);
    scenario.silent();
    let mut late = 0;
    for n in 0..40 {
        if n == 20 {
            scenario.bench.frames();
        }
        let _ = scenario.command(Command::Run(rpm(60_000)));
        scenario.pass(EVERY);
        let mut frame = zk_frames::status(1, TURNING, [11, 2 << 5, 76]);
        frame[4] ^= 0x55;
        scenario.bench.receive(&frame);
        late += u32::from(n >= 20 && scenario.telemetry().in_doubt.is_none());
    }
    let out = scenario.bench.bytes().iter().filter(|frame| frame[1] >> 4 == 7).count();
    assert!(
        out > 0 || late == 0,
        "no ID 7 in the second second, not in doubt at {late} of 20 frames: {:?}",
        scenario.order()
    );
}
