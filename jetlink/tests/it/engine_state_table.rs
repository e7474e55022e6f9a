//! The states of an engine as protocols and logs have them: numbers that never change, and names.

use jetlink::engine::state::EngineState;
use jetlink::report::EcuState;

const TABLE: [(EngineState, u8, &str); 11] = [
    (EngineState::Offline, 0, "offline"),
    (EngineState::NotKnown, 1, "not known"),
    (EngineState::Stopped, 2, "stopped"),
    (EngineState::Standby, 3, "standby"),
    (EngineState::Cooling, 4, "cooling"),
    (EngineState::StartRequested, 5, "start requested"),
    (EngineState::Starting(EcuState { code: 3, name: "preheat" }), 6, "starting"),
    (EngineState::Running, 7, "running"),
    (EngineState::ShuttingDown, 8, "shutting down"),
    (EngineState::Service, 9, "service"),
    (EngineState::Fault, 10, "fault"),
];

/// A reader of an old log, or another program, has these numbers.
#[test]
fn the_number_of_a_state_never_changes() {
    for (state, number, _) in TABLE {
        assert_eq!(state.number(), number, "{state}");
    }
}

/// A sentence about a state has its name, and of a start the ECU's own state as well.
#[test]
fn each_state_has_a_name() {
    for (state, _, name) in TABLE {
        assert_eq!(state.name(), name);
        let sentence = if state.number() == 6 { "starting (preheat)" } else { name };
        assert_eq!(state.to_string(), sentence);
    }
}
