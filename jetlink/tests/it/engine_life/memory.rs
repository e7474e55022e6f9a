//! The memory of a record: whether it has an engine in flight, and what repairs and clears it.

use super::*;
use crate::support::memory::{WORDS, words};
use jetlink::ecu::{Service, zk};
use std::sync::atomic::Ordering;

fn memory_of(scenario: &Scenario) -> RetainedMemory {
    let memory = RetainedMemory::new();
    memory.store(&scenario.bench.machine.record(), 1);
    memory
}

/// An engine at rest, or a memory without a record, is not in flight; one that runs, starts or may have an open pump is.
#[test]
fn an_engine_is_in_flight_unless_it_is_at_rest() {
    assert!(!RetainedMemory::new().was_in_flight(), "empty");
    for ecu in BOTH {
        let mut scenario = Scenario::ready(ecu, ecu.config());
        assert!(!memory_of(&scenario).was_in_flight(), "{ecu:?}: standby");
        scenario.command(run(0)).unwrap();
        assert!(memory_of(&scenario).was_in_flight(), "{ecu:?}: it starts");
        assert!(memory_of(&flying(ecu)).was_in_flight(), "{ecu:?}: it runs");
    }
    let mut scenario = Scenario::ready(Ecu::Zk, Ecu::Zk.config());
    let pump = Service::Zk(zk::config::Service::Action(zk::codec::Action::OpenPump));
    scenario.command(Command::Service(pump)).unwrap();
    assert!(memory_of(&scenario).was_in_flight(), "its pump is open");
}

/// A cleared memory restores nothing.
#[test]
fn nothing_is_loaded_after_a_memory_was_cleared() {
    let memory = memory_of(&flying(Ecu::Zk));
    assert!(memory.load(1, Reset::Warm).is_some());
    memory.clear();
    assert_eq!(memory.load(1, Reset::Warm), None);
}

/// Damage to one copy of a record and then to the other one costs nothing, if the first one was repaired in between.
#[test]
fn a_record_survives_damage_to_one_copy_after_a_repair_of_the_other() {
    for (first, repairs) in [(0, true), (WORDS, true), (0, false)] {
        let memory = memory_of(&flying(Ecu::Zk));
        let record = memory.load(1, Reset::Warm);
        let damage = |at: usize| words(&memory)[at].fetch_xor(1 << 7, Ordering::Relaxed);
        damage(first);
        assert_eq!(memory.load(1, Reset::Warm), record, "{first}");
        if repairs {
            memory.repair();
        }
        damage(WORDS - first);
        assert_eq!(memory.load(1, Reset::Warm), record.filter(|_| repairs), "{first}");
    }
}
