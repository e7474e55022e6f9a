//! A source of commands is a capability: only its owner can command in its name.

use jetlink::channel::{Channel, ClaimError};
use jetlink::command::{Accepted, Command, Origin};
use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::Line;
use jetlink::node::Node;

fn config(port: u8) -> EngineConfig {
    EngineConfig::zk("engine", port, Line::new(9600), Rate::Hz20)
}

#[test]
fn source_has_one_owner_until_it_is_dropped() {
    let channel = Channel::new(&config(0), None);
    let (one, other) = (channel.handle(), channel.handle());
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
    let handle = channel.handle();
    assert_eq!(handle.source(Origin::Node).err(), Some(ClaimError::Node));
    assert_eq!(handle.source(Origin::Emergency).err(), Some(ClaimError::Emergency));
    let emergency = handle.emergency_source().unwrap();
    assert_eq!(handle.emergency_source().err(), Some(ClaimError::Taken(Origin::Emergency)));
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
    assert!(node.handles()[0].source(Origin::Mavlink).is_ok());
    assert!(node.handles()[1].source(Origin::Mavlink).is_err());
    drop(right);
    assert!(node.handles()[1].source(Origin::Mavlink).is_ok());
}
