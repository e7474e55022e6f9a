//! The title of a run's pictures: a description of the run.

use super::engines::Engine;
use super::plan::FlownBy;
use super::play::script::Header;
use super::session::Setup;
use std::path::Path;

/// A title, completed while the run passes.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Title {
    text: String,
    /// Seed of all random events; for a scenario, its name.
    seed: Option<u64>,
    /// A key has acted, and nothing before says that the run is played.
    by_hand: Option<bool>,
}

impl Title {
    /// Of a run before it begins. `script`: the path of the script file that is played.
    pub fn of(setup: &Setup, header: &Header, script: Option<&str>) -> Self {
        if let Some(scenario) = setup.scenario {
            let text = format!("{}: {}", scenario.name, scenario.line);
            return Self { text, seed: None, by_hand: Some(false) };
        }
        let engines = &setup.engines;
        let (count, one) = match engines.len() {
            1 => ("One", true),
            2 => ("Two", false),
            3 => ("Three", false),
            4 => ("Four", false),
            5 => ("Five", false),
            6 => ("Six", false),
            7 => ("Seven", false),
            _ => ("Eight", false),
        };
        let mut text = format!("{count} simulated engine{}", if one { "" } else { "s" });
        let radio = header.rc.as_ref().map(|rc| format!("radio control ({rc})"));
        let mavlink = setup.mavlink.as_ref().map(|_| "MAVLink".to_owned());
        let outside: Vec<String> = radio.into_iter().chain(mavlink).collect();
        text += &match setup.plan.flown_by {
            FlownBy::Outside => format!(", commanded by {}", outside.join(" and ")),
            FlownBy::PilotsInStandby => " in standby".to_owned(),
            FlownBy::Pilots if script.is_some() => String::new(),
            FlownBy::Pilots if header.silence => String::new(),
            FlownBy::Pilots if one => ": start, flight and cooling".to_owned(),
            FlownBy::Pilots => ": starts, flight and cooling".to_owned(),
        };
        if let Some(path) = script {
            let name = Path::new(path).file_name().unwrap_or_default().to_string_lossy();
            text += &format!(", played from {name}");
        }
        if header.silence {
            let first = engines.first().map_or("?", Engine::name);
            text += &format!("; the source of {first} falls silent for 6 s");
        }
        if let Some(faults) = &header.faults {
            text += &format!("; faults: {}", faults.split(',').collect::<Vec<_>>().join(", "));
        }
        Self { text, seed: Some(setup.seed), by_hand: script.is_none().then_some(false) }
    }

    /// A key has acted.
    pub fn played(&mut self) {
        self.by_hand = self.by_hand.map(|_| true);
    }
}

impl core::fmt::Display for Title {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(&self.text)?;
        if self.by_hand == Some(true) {
            f.write_str("; played by hand")?;
        }
        self.seed.map_or(Ok(()), |seed| write!(f, " (seed {seed})"))
    }
}

#[cfg(test)]
mod tests {
    use super::super::options::{Args, order};
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        args: Args,
    }

    #[test]
    fn a_title_says_what_is_seen() {
        let one = "name=left,ecu=zk";
        for (args, expected) in [
            (
                &[][..],
                "Four simulated engines; the source of left falls silent for 6 s; played by hand (seed 1)",
            ),
            (
                &["--engine", one, "--seed", "7"],
                "One simulated engine: start, flight and cooling; played by hand (seed 7)",
            ),
            (
                &["--faults", "heavy,cut=left@40s+5s"],
                "Four simulated engines: starts, flight and cooling; faults: heavy, cut=left@40s+5s; \
                 played by hand (seed 1)",
            ),
            (&["--standby", "--engine", one], "One simulated engine in standby; played by hand (seed 1)"),
            (
                &["--rc", "crsf"],
                "Four simulated engines, commanded by radio control (crsf); played by hand (seed 1)",
            ),
        ] {
            let order = order(&Cli::parse_from([&["rig"], args].concat()).args).unwrap();
            let mut title = Title::of(&order.setup, &order.header, None);
            assert!(!title.to_string().contains("by hand"), "{title}");
            title.played();
            assert_eq!(title.to_string(), expected);
        }
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/captures/played.txt");
        let order = order(&Cli::parse_from(["rig", "--script", script]).args).unwrap();
        let mut title = Title::of(&order.setup, &order.header, Some(script));
        title.played();
        assert_eq!(title.to_string(), "One simulated engine, played from played.txt (seed 1)");
    }
}
