//! The engines of a run: what `--engine` sets for each, for the node and for the simulated ECU.

use jetlink::config::{EngineConfig, validate};
use jetlink::ecu::EcuConfig;
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::Line;
use sim::any::{AnyConfig, Protocol};
use sim::ecu::Nanos;

/// The engines of a run without `--engine`.
const DEFAULT: [&str; 4] = [
    "name=left,ecu=amt,engine=olympus,baud=2400",
    "name=right,ecu=amt,engine=titan,baud=2400",
    "name=centre,ecu=zk,version=4,baud=9600",
    "name=booster,ecu=zk,version=5,baud=115200,rate=50,mode=rpm",
];

/// More would not fit the table on a terminal; a board has fewer ports.
const MOST_ENGINES: usize = 8;
/// Longer names would not fit the table either.
const LONGEST_NAME: usize = 12;

/// One engine: how the node is configured for it, and what hangs on the line.
#[derive(Clone, Copy, Debug)]
pub struct Engine {
    /// What the node gets.
    pub config: EngineConfig,
    /// What is simulated.
    pub ecu: Ecu,
}

impl Engine {
    /// Its name.
    pub fn name(&self) -> &'static str {
        self.config.name
    }

    /// Its name and what it is.
    pub fn caption(&self) -> String {
        format!("{}: {}, {} baud", self.name(), self.ecu.config(), self.config.line.baud)
    }

    /// Whether the pilot commands a speed instead of a throttle.
    pub fn by_rpm(&self) -> bool {
        matches!(self.ecu, Ecu::Zk { mode: Mode::Rpm, .. })
    }

    /// Interval of the node's send slots; `None` where it only replies to frames of its ECU (AMT).
    pub const fn cadence(&self) -> Option<Nanos> {
        let EcuConfig::Zk(config) = self.config.ecu else { return None };
        Some(
            match config.rate {
                Rate::Hz20 => sim::zk::Rate::Hz20,
                Rate::Hz50 => sim::zk::Rate::Hz50,
                Rate::Hz100 => sim::zk::Rate::Hz100,
            }
            .period(),
        )
    }
}

/// The simulated ECU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Ecu {
    /// AMT, with the engine behind it.
    Amt(sim::amt::EngineModel),
    /// ZK.
    Zk {
        /// Protocol version.
        version: u8,
        /// How it is commanded.
        mode: Mode,
    },
}

impl Ecu {
    /// Its configuration in the simulation.
    pub fn config(self) -> AnyConfig {
        match self {
            Self::Amt(engine) => AnyConfig::amt(engine),
            Self::Zk { version, .. } => AnyConfig::zk(version),
        }
    }

    /// Its protocol.
    pub fn protocol(self) -> Protocol {
        self.config().protocol()
    }
}

/// The three control modes of a ZK ECU (ZK-9).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Mode {
    /// 1: switch and throttle in one command.
    Throttle,
    /// 2: the switch in a command of its own.
    Split,
    /// 3: switch and speed.
    Rpm,
}

/// The engines that these descriptions give; the default ones when there are none.
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

/// The keys of a description; `None` where it has none.
#[derive(Debug, Default)]
struct Description<'a> {
    name: Option<&'a str>,
    ecu: Option<&'a str>,
    engine: Option<&'a str>,
    baud: Option<&'a str>,
    stop: Option<&'a str>,
    version: Option<&'a str>,
    rate: Option<&'a str>,
    mode: Option<&'a str>,
}

fn engine(index: usize, text: &str) -> Result<Engine, String> {
    let description = read(text)?;
    let name = match description.name {
        Some(name) => checked_name(name)?,
        None => format!("engine{}", index + 1),
    };
    let build = || -> Result<Engine, String> {
        match description.ecu {
            None | Some("amt") => amt(index, &name, &description),
            Some("zk") => zk(index, &name, &description),
            Some(other) => Err(format!("ecu=`{other}` is not known: write amt or zk")),
        }
    };
    build().map_err(|what| format!("engine `{name}`: {what}"))
}

fn read(text: &str) -> Result<Description<'_>, String> {
    let mut description = Description::default();
    for part in text.split(',') {
        let Some((key, value)) = part.split_once('=') else {
            return Err(format!("`{part}` in engine `{text}` is not of the form key=value"));
        };
        let slot = match key {
            "name" => &mut description.name,
            "ecu" => &mut description.ecu,
            "engine" => &mut description.engine,
            "baud" => &mut description.baud,
            "stop" => &mut description.stop,
            "version" => &mut description.version,
            "rate" => &mut description.rate,
            "mode" => &mut description.mode,
            _ => {
                return Err(format!(
                    "an engine has no key `{key}`: there are name, ecu, engine, baud, stop, version, rate, mode"
                ));
            }
        };
        if slot.replace(value).is_some() {
            return Err(format!("`{key}` is given twice in engine `{text}`"));
        }
    }
    Ok(description)
}

fn checked_name(name: &str) -> Result<String, String> {
    let plain = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
    if name.is_empty() || name.len() > LONGEST_NAME || !plain {
        return Err(format!(
            "`{name}` is not a valid engine name: use 1 to {LONGEST_NAME} letters, digits, `-` or `_`"
        ));
    }
    Ok(name.to_owned())
}

fn amt(index: usize, name: &str, description: &Description<'_>) -> Result<Engine, String> {
    for (key, value) in
        [("version", description.version), ("rate", description.rate), ("mode", description.mode)]
    {
        if value.is_some() {
            return Err(format!("`{key}` is for ecu=zk only"));
        }
    }
    let wanted = description.engine.unwrap_or("olympus");
    let Some(simulated) = sim::amt::EngineModel::named(wanted) else {
        let names = sim::amt::EngineModel::ALL.map(sim::amt::EngineModel::name).join(", ");
        return Err(format!("engine=`{wanted}` is not simulated: write one of {names}"));
    };
    let expected = EngineModel::ALL.into_iter().find(|engine| engine.name() == simulated.name());
    let line = line(description, 2400)?;
    let config = EngineConfig::amt(leaked(name), port(index), line, expected);
    Ok(Engine { config, ecu: Ecu::Amt(simulated) })
}

fn zk(index: usize, name: &str, description: &Description<'_>) -> Result<Engine, String> {
    if description.engine.is_some() {
        return Err("`engine` is for ecu=amt only: there is one simulated engine with a ZK ECU".to_owned());
    }
    let version = match description.version.unwrap_or("5") {
        text if matches!(text, "1" | "2" | "3" | "4" | "5") => text.bytes().next().unwrap_or(b'5') - b'0',
        other => return Err(format!("version=`{other}` is not known: write 1 to 5")),
    };
    let rate = match description.rate.unwrap_or("20") {
        "20" => Rate::Hz20,
        "50" => Rate::Hz50,
        "100" => Rate::Hz100,
        other => return Err(format!("rate=`{other}` is not known: write 20, 50 or 100")),
    };
    let mode = match description.mode.unwrap_or("throttle") {
        "throttle" => Mode::Throttle,
        "split" => Mode::Split,
        "rpm" => Mode::Rpm,
        other => return Err(format!("mode=`{other}` is not known: write throttle, split or rpm")),
    };
    if mode != Mode::Throttle && version < 4 {
        return Err(format!("mode={} needs version=4 or higher", description.mode.unwrap_or_default()));
    }
    let mut config = EngineConfig::zk(leaked(name), port(index), line(description, 9600)?, rate);
    if let EcuConfig::Zk(zk) = &mut config.ecu {
        zk.split_switch = mode == Mode::Split;
    }
    Ok(Engine { config, ecu: Ecu::Zk { version, mode } })
}

fn line(description: &Description<'_>, usual_baud: u32) -> Result<Line, String> {
    let baud = match description.baud {
        None => usual_baud,
        Some(text) => text.parse().map_err(|_| format!("baud=`{text}` is not a number"))?,
    };
    match description.stop.unwrap_or("1") {
        "1" => Ok(Line::new(baud)),
        "2" => Ok(Line::with_two_stop_bits(baud)),
        other => Err(format!("stop=`{other}` is not known: write 1 or 2")),
    }
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
        assert_eq!(engine.ecu, Ecu::Zk { version: 5, mode: Mode::Throttle });
        assert_eq!(engine.config.line, Line::new(9600));
        assert_eq!(one("name=x").unwrap().ecu, Ecu::Amt(sim::amt::EngineModel::Olympus));
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
