//! The tables of docs/mavlink.md are made from the table of settings and the table of services.
//! `JETLINK_WRITE=1 cargo test -p jetlink-mavlink docs_have` writes them.

use jetlink::config::EngineConfig;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::Line;
use jetlink::setting::{Effect, OFF, Setting, Unit};
use jetlink::wiring::Wiring;
use jetlink_mavlink::service::parameters::{engine_parameters, node_parameters, wiring_parameters};
use jetlink_mavlink::services;

/// Rows with the rest of their text, and their default in words if it is not the row's own. `turning`: note for settings
/// refused while the engine turns.
fn table(rows: &[(&Setting, &str, Option<String>)], turning: &str) -> String {
    let mut table = String::from("| parameter | default | range | what |\n|---|---|---|---|\n");
    for (row, of, default) in rows {
        let off = if row.may_be_off { ", or -1: off" } else { "" };
        let range = match row.unit {
            Unit::YesNo | Unit::Action => row.unit.symbol().to_string(),
            Unit::Number | Unit::Baud | Unit::StatusRate => format!("{} to {}", row.min, row.max),
            _ => format!("{} to {} {}{off}", row.min, row.max, row.unit.symbol()),
        };
        let default = default.clone().unwrap_or_else(|| {
            if row.default == OFF && row.may_be_off { "off".into() } else { row.default.to_string() }
        });
        let next = match row.effect {
            Effect::AtNextStart => format!(" Takes effect at the next start. Refused while {turning} turns."),
            Effect::UnlessTurning => format!(" Refused while {turning} turns."),
            Effect::AtRest => " Takes effect when the engine is at rest.".into(),
            _ => String::new(),
        };
        table += &format!("| `{}` | {default} | {range} | {}{next}{of} |\n", row.name, row.text);
    }
    table
}

fn parameters() -> String {
    let amt = EngineConfig::amt("amt", 0, Line::new(9600), None);
    let zk = EngineConfig::zk("zk", 1, Line::new(9600), Rate::Hz20);
    let node: Vec<_> = node_parameters().map(|row| (row, "", None)).collect();
    let wiring = wiring_parameters(&Wiring::of(&amt));
    let rows: Vec<_> = wiring.iter().map(|row| (row, "", Some("image".into()))).collect();
    let of_amt: Vec<_> = engine_parameters(&amt).collect();
    let of_zk: Vec<_> = engine_parameters(&zk).collect();
    let has = |rows: &[&Setting], row: &Setting| rows.iter().any(|other| other.name == row.name);
    let mut engine = Vec::new();
    for row in of_amt.iter().chain(of_zk.iter().filter(|row| !has(&of_amt, row))) {
        let of = match (has(&of_amt, row), has(&of_zk, row)) {
            (true, false) => " AMT only.",
            (false, true) => " ZK only.",
            _ => "",
        };
        let other = of_zk.iter().find(|other| other.name == row.name);
        let two = other.filter(|other| other.default != row.default);
        engine.push((*row, of, two.map(|zk| format!("AMT {}, ZK {}", row.default, zk.default))));
    }
    format!(
        "Component of the node, {} parameters:\n\n{}\nAnd for each engine of the image, in its order, {} that say what it is wired to, here for engine 1: \
         `E2_PORT` is that of engine 2. Their defaults are those of the table `ENGINES` in `src/config.rs`:\n\n{}\nComponent of each engine, {} parameters with an AMT ECU and {} with a ZK \
         ECU:\n\n{}",
        node.len(),
        table(&node, "an engine"),
        wiring.len(),
        table(&rows, "an engine"),
        of_amt.len(),
        of_zk.len(),
        table(&engine, "the engine")
    )
}

/// The session with MAVProxy, which lists the parameters of an engine with a ZK ECU.
#[test]
fn recorded_session_has_the_number_of_parameters() {
    let page = include_str!("../../docs/mavlink.md");
    let zk = EngineConfig::zk("right", 1, Line::new(9600), Rate::Hz20);
    let received = format!("\nReceived {} parameters\n", engine_parameters(&zk).count());
    assert!(page.contains(&received), "{received}: record the session again");
}

fn services() -> String {
    let mut table = String::from("| param1 | other parameters | what |\n|---|---|---|\n");
    for row in services::TABLE {
        table += &format!("| {} | {} | {} |\n", row.number, row.params, row.text);
    }
    table
}

#[test]
fn docs_have_the_parameters_and_services() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/mavlink.md");
    for (name, table) in [("parameters", parameters()), ("services", services())] {
        let begin =
            format!("<!-- {name}: made, JETLINK_WRITE=1 cargo test -p jetlink-mavlink docs_have -->\n");
        let end = format!("<!-- {name} end -->\n");
        pages::compare(path, &begin, &end, &table);
    }
}

#[test]
fn names_of_parameters_are_unique_and_fit() {
    let config = EngineConfig::amt("amt", 0, Line::new(9600), None);
    for rows in [node_parameters().collect::<Vec<_>>(), engine_parameters(&config).collect()] {
        for (i, row) in rows.iter().enumerate() {
            assert!(row.name.len() <= 16 && row.name.is_ascii(), "{}", row.name);
            assert!(!rows[..i].iter().any(|other| other.name == row.name), "{} twice", row.name);
            // A 32-bit float represents it exactly.
            assert!(row.min.unsigned_abs().max(row.max.unsigned_abs()) <= 1 << 24, "{}", row.name);
        }
    }
}
