//! The tables of docs/rc.md are made from the tables of settings.
//! `JETLINK_WRITE=1 cargo test -p jetlink-rc docs_have` writes them.

use jetlink::setting::{Effect, OFF, Setting, Unit};
use jetlink_rc::settings::{EngineSettings, OutputSettings};

fn table(rows: &[Setting]) -> String {
    let mut table = String::from("| setting | default | range | what |\n|---|---|---|---|\n");
    for row in rows {
        let off = if row.may_be_off { ", or off" } else { "" };
        let range = match row.unit {
            Unit::YesNo | Unit::Action => row.unit.symbol().to_string(),
            Unit::Number => format!("{} to {}", row.min, row.max),
            _ => format!("{} to {} {}{off}", row.min, row.max, row.unit.symbol()),
        };
        let default =
            if row.default == OFF && row.may_be_off { "off".into() } else { row.default.to_string() };
        let next = match row.effect {
            Effect::AtNextStart => " Takes effect at the next start.",
            Effect::UnlessTurning => " Refused while the engine turns.",
            _ => "",
        };
        table += &format!("| `{}` | {default} | {range} | {}{next} |\n", row.name, row.text);
    }
    table
}

#[test]
fn docs_have_the_settings() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/rc.md");
    for (name, rows) in [("engine", EngineSettings::SETTINGS), ("outputs", OutputSettings::SETTINGS)] {
        let begin = format!("<!-- {name}: made, JETLINK_WRITE=1 cargo test -p jetlink-rc docs_have -->\n");
        let end = format!("<!-- {name} end -->\n");
        pages::compare(path, &begin, &end, &table(rows));
    }
}

#[test]
fn names_of_settings_are_unique() {
    let rows: Vec<_> = EngineSettings::SETTINGS.iter().chain(OutputSettings::SETTINGS).collect();
    for (i, row) in rows.iter().enumerate() {
        assert!(!rows[..i].iter().any(|other| other.name == row.name), "{} twice", row.name);
    }
}
