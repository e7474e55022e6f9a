//! A source of commands is a capability: only its owner can command in its name.

use jetlink::channel::{Channel, ClaimError};
use jetlink::command::{Accepted, Command, Demand, Origin, Rejected};
use jetlink::config::{ConfigError, EngineConfig};
use jetlink::ecu::zk::codec::Rate;
use jetlink::engine::retained::{Reset, RetainedMemory};
use jetlink::line::Line;
use jetlink::node::Node;
use jetlink::units::Throttle;

fn config(port: u8) -> EngineConfig {
    EngineConfig::zk("engine", port, Line::new(9600), Rate::Hz20)
}

#[test]
fn source_has_one_owner_until_it_is_dropped() {
    let channel = Channel::new(&config(0), None);
    let (one, other) = (channel.owner(), channel.owner());
    let held = one.source(Origin::Rc).unwrap();
    assert_eq!(held.origin(), Origin::Rc);
    assert_eq!(other.source(Origin::Rc).err(), Some(ClaimError::Taken(Origin::Rc)));
    assert!(other.source(Origin::Bench).is_ok(), "another source is free");
    drop(held);
    assert!(other.source(Origin::Rc).is_ok());
}

#[test]
fn node_and_emergency_cannot_be_claimed_as_ordinary_sources() {
    let channel = Channel::new(&config(0), None);
    let owner = channel.owner();
    assert_eq!(owner.source(Origin::Node).err(), Some(ClaimError::Node));
    assert_eq!(owner.source(Origin::Emergency).err(), Some(ClaimError::Emergency));
    let emergency = owner.emergency_source().unwrap();
    assert_eq!(owner.emergency_source().err(), Some(ClaimError::Taken(Origin::Emergency)));
    assert_eq!(emergency.command(Command::EmergencyStop), Ok(Accepted::InForce));
    assert!(channel.handle().telemetry().stop_latched);
}

#[test]
fn each_engine_has_its_own_sources() {
    let node = Node::new(&[config(0), config(1)], None).unwrap();
    let held = node.sources(Origin::Mavlink);
    assert!(held.iter().all(Result::is_ok));
    for again in node.sources(Origin::Mavlink) {
        assert_eq!(again.err(), Some(ClaimError::Taken(Origin::Mavlink)));
    }
    let [left, right] = held;
    drop(left);
    assert!(node.owners()[0].source(Origin::Mavlink).is_ok());
    assert!(node.owners()[1].source(Origin::Mavlink).is_err());
    drop(right);
    assert!(node.owners()[1].source(Origin::Mavlink).is_ok());
}

/// Commands an emergency stop to both engines, whose ports are 0 and 3, and resets the node. Returns whether each is then
/// latched.
fn stops_after_a_reset(memory: &'static [RetainedMemory]) -> Result<[bool; 2], ConfigError> {
    let engines = [config(0), config(3)];
    let before = Node::new(&engines, Some((memory, Reset::Warm)))?;
    for source in before.sources(Origin::Rc) {
        assert_eq!(source.unwrap().command(Command::EmergencyStop), Ok(Accepted::InForce));
    }
    let after = Node::new(&engines, Some((memory, Reset::Warm)))?;
    Ok(after.handles().map(|handle| handle.telemetry().stop_latched))
}

#[test]
fn engine_whose_port_has_no_retained_memory_makes_no_node() {
    static FEW: [RetainedMemory; 2] = [const { RetainedMemory::new() }; 2];
    static ENOUGH: [RetainedMemory; 4] = [const { RetainedMemory::new() }; 4];
    let refused = stops_after_a_reset(&FEW).unwrap_err();
    assert_eq!(refused, ConfigError::RetainedMemory(1));
    assert_eq!(
        refused.to_string(),
        "row 2 of the table of engines: no retained memory for its port: give the node one for each port, by its number"
    );
    assert_eq!(stops_after_a_reset(&ENOUGH), Ok([true; 2]));
}

#[test]
fn who_receives_the_refusals_of_a_start_may_use_the_engine() {
    let channel = Channel::new(&config(0), None);
    let source = channel.owner().source(Origin::Rc).unwrap();
    let mut refusals = Vec::new();
    source.handle().start_refusals(Demand::Throttle(Throttle::IDLE), Origin::Rc, |why| {
        refusals.push(why);
        assert_eq!(source.command(Command::EmergencyStop), Ok(Accepted::InForce));
    });
    assert_eq!(refusals.first(), Some(&Rejected::Listening), "before the stop of the first one");
    assert!(refusals.len() > 1 && !refusals.contains(&Rejected::StopLatched));
    assert!(channel.handle().telemetry().stop_latched);
}
