//! A description of an engine on the command line: `name=left,ecu=amt,engine=olympus,baud=2400`.

use jetlink::config::EngineConfig;
use jetlink::line::Line;
use sim::ecu::Nanos;

/// Longer names would not fit the table on a terminal.
const LONGEST_NAME: usize = 12;

/// Keys that every protocol takes.
pub const COMMON: [&str; 4] = ["name", "ecu", "baud", "stop"];

/// The keys of a description with their values.
#[derive(Debug)]
pub struct Description<'a>(Vec<(&'a str, &'a str)>);

impl<'a> Description<'a> {
    /// Reads it. `keys`: all keys besides the common ones.
    pub fn read(text: &'a str, keys: &[&str]) -> Result<Self, String> {
        let mut all = Self(Vec::new());
        for part in text.split(',') {
            let Some((key, value)) = part.split_once('=') else {
                return Err(format!("`{part}` in engine `{text}` is not of the form key=value"));
            };
            if !COMMON.iter().chain(keys).any(|known| *known == key) {
                let known = [&COMMON[..], keys].concat().join(", ");
                return Err(format!("an engine has no key `{key}`: there are {known}"));
            }
            if all.get(key).is_some() {
                return Err(format!("`{key}` is given twice in engine `{text}`"));
            }
            all.0.push((key, value));
        }
        Ok(all)
    }

    /// The value of a key, if it is given.
    pub fn get(&self, key: &str) -> Option<&'a str> {
        self.0.iter().find(|(known, _)| *known == key).map(|(_, value)| *value)
    }

    /// The name, if one is given.
    pub fn name(&self) -> Result<Option<&'a str>, String> {
        let Some(name) = self.get("name") else { return Ok(None) };
        let plain = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
        if name.is_empty() || name.len() > LONGEST_NAME || !plain {
            return Err(format!(
                "`{name}` is not a valid engine name: use 1 to {LONGEST_NAME} letters, digits, `-` or `_`"
            ));
        }
        Ok(Some(name))
    }

    /// The line. Without a baud rate it has this one.
    pub fn line(&self, usual_baud: u32) -> Result<Line, String> {
        let baud = match self.get("baud") {
            None => usual_baud,
            Some(text) => text.parse().map_err(|_| format!("baud=`{text}` is not a number"))?,
        };
        match self.get("stop").unwrap_or("1") {
            "1" => Ok(Line::new(baud)),
            "2" => Ok(Line::with_two_stop_bits(baud)),
            other => Err(format!("stop=`{other}` is not known: write 1 or 2")),
        }
    }
}

/// A simulated ECU of one protocol, as the command line describes it.
pub trait Described: Copy {
    /// An engine with all keys, and their values, for the help: lines indented by two and six spaces.
    const HELP: &'static str;

    /// Keys of its own.
    const KEYS: &'static [&'static str];

    /// Reads its keys: the node's configuration, and the simulated ECU.
    fn read(
        name: &'static str,
        port: u8,
        description: &Description<'_>,
    ) -> Result<(EngineConfig, Self), String>;

    /// Version of the protocol, if it has versions.
    fn version(self) -> Option<u8> {
        None
    }

    /// Whether the pilot commands a speed instead of a throttle.
    fn by_rpm(self) -> bool;

    /// Whether its ECU follows a speed.
    fn has_speed_control(self) -> bool;

    /// How long without commands it runs an engine; `None`: forever.
    fn stops_without_commands(self) -> Option<Nanos>;

    /// Interval of the node's send slots; `None` if it only replies to frames of its ECU.
    fn cadence(self) -> Option<Nanos>;

    /// Interval between two frames of the ECU.
    fn ecu_period(self) -> Nanos;
}
