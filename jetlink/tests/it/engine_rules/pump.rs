//! A pump that was opened is closed.

use super::*;

fn closes(frames: &[Vec<u8>]) -> usize {
    frames.iter().filter(|frame| frame[..] == zk_frames::action(13)).count()
}

/// A pump that was opened, and a start: fuel into the engine before the ignition, and ClosePump into the run.
#[test]
fn a_start_closes_an_open_pump_before_the_engine_runs() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.command(action(zk::codec::Action::OpenPump)).unwrap();
    scenario.pass_us(4 * FRAME_PERIOD_US);
    let frames = scenario.bench.bytes();
    assert!(frames.contains(&zk_frames::action(12).to_vec()), "it is open");
    let answer = scenario.command(run(0));
    scenario.fly_us(run(0), Origin::Rc, 2 * SECOND);
    let at_start = closes(&scenario.bench.bytes());
    scenario.says(Says::Starting);
    scenario.fly_us(run(0), Origin::Rc, 10 * SECOND);
    scenario.says(Says::Running);
    scenario.fly_us(run(50), Origin::Rc, 10 * SECOND);
    scenario.bench.frames();
    scenario.fly_us(run(50), Origin::Rc, 20 * SECOND);
    let in_run = closes(&scenario.bench.bytes());
    assert!(
        answer != Ok(Accepted::InForce) || at_start > 0 && in_run == 0,
        "{answer:?}; ClosePump at the start {at_start}, to the running engine {in_run}"
    );
}

/// "ClosePump goes out ... until the pump voltage reads zero or ten were sent": a voltage from before the pump was opened
/// reads nothing of it.
#[test]
fn a_pump_voltage_from_before_the_opening_confirms_no_closing() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    // ID 2: no pump voltage.
    scenario.bench.receive(&zk_frames::status(2, 0, [50, 60, 0]));
    scenario.command(action(zk::codec::Action::OpenPump)).unwrap();
    scenario.pass_us(3 * FRAME_PERIOD_US);
    let frames = scenario.bench.bytes();
    assert!(frames.contains(&zk_frames::action(12).to_vec()), "it is open");
    scenario.command(Command::Disarm).unwrap();
    scenario.pass_us(2 * SECOND);
    assert_eq!(closes(&scenario.bench.bytes()), 10);
}

/// "A pump that was opened is closed at ... silence of its source"; "a source that wants nothing counts as silent".
#[test]
fn a_pump_is_closed_when_its_source_wants_nothing() {
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    scenario.command(action(zk::codec::Action::OpenPump)).unwrap();
    scenario.pass_us(4 * FRAME_PERIOD_US);
    scenario.bench.frames();
    scenario.fly_us(Command::Present, Origin::Rc, 5 * SECOND);
    assert!(closes(&scenario.bench.bytes()) > 0, "a source that wants nothing counts as silent");
}
