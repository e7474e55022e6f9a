//! The engines of a run: what `--engine` sets for each, for the node and for the simulated ECU. A file for each protocol.

mod amt;
mod description;
mod zk;

use self::description::{Described, Description};
use bench::rows::simulated;
use embassy_time::Duration;
use jetlink::config::{EngineConfig, validate};
use sim::any::{AnyConfig, Protocol};
use sim::ecu::Nanos;

/// The engines of a run without `--engine`.
pub const DEFAULT: [&str; 4] = [
    "name=left,ecu=amt,engine=olympus,baud=2400",
    "name=right,ecu=amt,engine=titan,baud=2400",
    "name=centre,ecu=zk,version=4,baud=9600",
    "name=booster,ecu=zk,version=5,baud=115200,rate=50,mode=rpm",
];

/// The protocol of an engine without `ecu=`.
const USUAL: &str = "amt";
/// Every engine, in scripts and events.
pub const ALL: &str = "all";
/// More would not fit the table on a terminal; a board has fewer ports.
pub const MOST_ENGINES: usize = 8;

/// One engine: its configuration in the node, and the device on its line.
#[derive(Clone, Copy, Debug)]
pub struct Engine {
    /// Configuration for the node.
    pub config: EngineConfig,
    /// The simulated ECU.
    pub ecu: Ecu,
}

impl Engine {
    /// Its name.
    pub fn name(&self) -> &'static str {
        self.config.name
    }

    /// Its name and what it is.
    pub fn caption(&self) -> String {
        format!("{}: {}, {} baud", self.name(), self.simulated(), self.config.line.baud)
    }

    /// The configuration of its simulated ECU, on its line.
    pub fn simulated(&self) -> AnyConfig {
        let usual = simulated(&self.config);
        match self.ecu.version() {
            Some(version) => usual.with_version(version),
            None => usual,
        }
    }

    /// Whether the pilot commands a speed instead of a throttle.
    pub fn by_rpm(&self) -> bool {
        self.ecu.by_rpm()
    }

    /// How long without commands its ECU runs it; `None`: forever.
    pub fn stops_without_commands(&self) -> Option<Duration> {
        self.ecu.stops_without_commands().map(Duration::from_nanos)
    }

    /// Whether this speed can be commanded: its ECU has speed control, and the engine reaches it.
    pub fn takes(&self, rpm: u32) -> Result<(), String> {
        let (name, most) = (self.name(), self.simulated().turbine().max_rpm as u32);
        if !self.ecu.has_speed_control() {
            return Err(format!("the ECU of {name} has no speed control: command a throttle"));
        }
        if rpm > most {
            return Err(format!("invalid rpm `{rpm}`, use 0 to {most} for {name}"));
        }
        Ok(())
    }

    /// Interval of the node's send slots; `None` if it only replies to frames of its ECU (AMT).
    pub fn cadence(&self) -> Option<Nanos> {
        self.ecu.cadence()
    }

    /// Interval between two frames of its ECU.
    pub fn ecu_period(&self) -> Nanos {
        self.ecu.ecu_period()
    }
}

macro_rules! ecus {
    ($($(#[$doc:meta])* $name:ident $module:ident($config:ty, $ecu:ty, $command:ty);)+) => {
        /// The simulated ECU.
        #[derive(Clone, Copy, PartialEq, Eq, Debug)]
        pub enum Ecu {
            $($(#[$doc])* $name($module::Ecu),)+
        }

        impl Ecu {
            /// Its protocol.
            pub fn protocol(self) -> Protocol {
                match self {
                    $(Self::$name(_) => Protocol::$name,)+
                }
            }

            fn version(self) -> Option<u8> {
                match self {
                    $(Self::$name(ecu) => ecu.version(),)+
                }
            }

            fn by_rpm(self) -> bool {
                match self {
                    $(Self::$name(ecu) => ecu.by_rpm(),)+
                }
            }

            fn stops_without_commands(self) -> Option<Nanos> {
                match self {
                    $(Self::$name(ecu) => ecu.stops_without_commands(),)+
                }
            }

            fn has_speed_control(self) -> bool {
                match self {
                    $(Self::$name(ecu) => ecu.has_speed_control(),)+
                }
            }

            fn cadence(self) -> Option<Nanos> {
                match self {
                    $(Self::$name(ecu) => ecu.cadence(),)+
                }
            }

            fn ecu_period(self) -> Nanos {
                match self {
                    $(Self::$name(ecu) => ecu.ecu_period(),)+
                }
            }

            /// Reads the keys of this value of `ecu=`.
            fn read(
                ecu: &str,
                name: &'static str,
                port: u8,
                description: &Description<'_>,
            ) -> Result<(EngineConfig, Self), String> {
                match ecu {
                    $(stringify!($module) => {
                        $module::Ecu::read(name, port, description).map(|(config, ecu)| (config, Self::$name(ecu)))
                    })+
                    other => {
                        let known = PROTOCOLS.map(|(name, _)| name).join(" or ");
                        Err(format!("ecu=`{other}` is not known: write {known}"))
                    }
                }
            }
        }

        /// The protocols, each with the keys of its own.
        const PROTOCOLS: [(&str, &[&str]); [$(stringify!($module)),+].len()] =
            [$((stringify!($module), $module::Ecu::KEYS)),+];

        /// The keys of each in words, for the help.
        pub const HELP: &[&str] = &[$($module::Ecu::HELP),+];
    };
}
sim::protocols!(ecus);

/// The engines of these descriptions; without any, the default ones.
pub fn engines(descriptions: &[String]) -> Result<Vec<Engine>, String> {
    let engines = if descriptions.is_empty() {
        DEFAULT.iter().enumerate().map(|(i, text)| engine(i, text)).collect::<Result<Vec<_>, _>>()?
    } else {
        descriptions.iter().enumerate().map(|(i, text)| engine(i, text)).collect::<Result<Vec<_>, _>>()?
    };
    if engines.len() > MOST_ENGINES {
        return Err(format!("{} engines are too many: the rig runs up to {MOST_ENGINES}", engines.len()));
    }
    for (i, engine) in engines.iter().enumerate() {
        if engine.name() == ALL {
            return Err(format!(
                "an engine cannot have the name `{ALL}`: in scripts and events it means every engine"
            ));
        }
        if engines.iter().take(i).any(|other| other.name() == engine.name()) {
            return Err(format!("two engines have the name `{}`", engine.name()));
        }
    }
    let configs: Vec<EngineConfig> = engines.iter().map(|engine| engine.config).collect();
    validate(&configs).map_err(|error| {
        let name = engines.get(error.row()).map_or("?", Engine::name);
        format!("engine `{name}`: {}", error.message())
    })?;
    Ok(engines)
}

fn engine(index: usize, text: &str) -> Result<Engine, String> {
    let keys: Vec<&str> = PROTOCOLS.iter().flat_map(|(_, keys)| *keys).copied().collect();
    let description = Description::read(text, &keys)?;
    let name = match description.name()? {
        Some(name) => name.to_owned(),
        None => format!("engine{}", index + 1),
    };
    let build = || -> Result<Engine, String> {
        let ecu = description.get("ecu").unwrap_or(USUAL);
        if let Some((other, key)) = foreign(ecu, &description) {
            return Err(format!("`{key}` is for ecu={other} only"));
        }
        let (config, ecu) = Ecu::read(ecu, leaked(&name), port(index), &description)?;
        Ok(Engine { config, ecu })
    };
    build().map_err(|what| format!("engine `{name}`: {what}"))
}

/// A key that belongs to another protocol, with that protocol.
fn foreign(ecu: &str, description: &Description<'_>) -> Option<(&'static str, &'static str)> {
    let (_, own) = PROTOCOLS.into_iter().find(|(name, _)| *name == ecu)?;
    let others = PROTOCOLS.into_iter().filter(|(name, _)| *name != ecu);
    let mut keys = others.flat_map(|(name, keys)| keys.iter().map(move |key| (name, *key)));
    keys.find(|(_, key)| !own.contains(key) && description.get(key).is_some())
}

/// Every engine of the rig has a port of its own.
fn port(index: usize) -> u8 {
    u8::try_from(index).unwrap_or(u8::MAX)
}

/// Names live as long as the program, as they do in the firmware; there are a handful.
fn leaked(name: &str) -> &'static str {
    Box::leak(name.to_owned().into_boxed_str())
}

#[cfg(test)]
mod tests {
    use super::*;
    use jetlink::line::Line;

    fn one(text: &str) -> Result<Engine, String> {
        engines(&[text.to_owned()]).map(|engines| engines[0])
    }

    #[test]
    fn the_default_engines_are_valid() {
        let engines = engines(&[]).unwrap();
        let names: Vec<&str> = engines.iter().map(Engine::name).collect();
        assert_eq!(names, ["left", "right", "centre", "booster"]);
        assert!(engines[3].by_rpm() && !engines[2].by_rpm());
    }

    #[test]
    fn omitted_keys_have_defaults() {
        let engine = one("ecu=zk").unwrap();
        assert_eq!(engine.name(), "engine1");
        assert_eq!(
            engine.ecu,
            Ecu::Zk(zk::Ecu { version: 5, rate: sim::zk::Rate::Hz20, mode: zk::Mode::Throttle })
        );
        assert_eq!(engine.config.line, Line::new(9600));
        assert_eq!(one("name=x").unwrap().ecu, Ecu::Amt(amt::Ecu(sim::amt::EngineModel::Olympus)));
    }

    #[test]
    fn each_mistake_is_named() {
        for (text, part) in [
            ("", "key=value"),
            ("name", "key=value"),
            ("colour=red", "no key `colour`"),
            ("name=a,name=b", "twice"),
            ("name=", "not a valid engine name"),
            ("name=ü", "not a valid engine name"),
            ("name=a,ecu=jetcat", "engine `a`: ecu=`jetcat`"),
            ("name=a,engine=orion", "not simulated"),
            ("name=a,rate=20", "`rate` is for ecu=zk only"),
            ("name=a,ecu=zk,engine=titan", "`engine` is for ecu=amt only"),
            ("name=a,ecu=zk,version=0", "version=`0`"),
            ("name=a,ecu=zk,rate=30", "rate=`30`"),
            ("name=a,ecu=zk,mode=jump", "mode=`jump`"),
            ("name=a,ecu=zk,version=3,mode=rpm", "needs version=4"),
            ("name=all", "every engine"),
            ("name=a,baud=fast", "baud=`fast`"),
            ("name=a,baud=1234", "engine `a`: invalid baud rate"),
            ("name=a,stop=3", "stop=`3`"),
            ("name=a,stop=2", "engine `a`: invalid stop bits"),
            ("name=a,ecu=zk,baud=2400,rate=50", "engine `a`: the line is too slow"),
        ] {
            let error = one(text).unwrap_err();
            assert!(error.contains(part) && !error.contains('\n'), "{text}: {error}");
        }
        let twice = ["name=a".to_owned(), "name=a".to_owned()];
        assert!(engines(&twice).unwrap_err().contains("two engines"));
        assert!(engines(&vec!["ecu=zk".to_owned(); 9]).unwrap_err().contains("too many"));
    }
}
