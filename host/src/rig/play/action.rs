//! Actions in a run, and their form in a script file: an engine's name, or `all`, and words.

use super::super::engines::{ALL, Engine};

/// An action on an engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Act {
    /// Arm it.
    Arm,
    /// Disarm it.
    Disarm,
    /// Command run at idle.
    Start,
    /// Command standby.
    Standby,
    /// Command this throttle, in tenths of a percent.
    Throttle(u16),
    /// Command this shaft speed.
    Rpm(u32),
    /// Stop it at once; latched.
    EmergencyStop,
    /// Release the emergency stop.
    Release,
    /// Standby, then the engine's own script from its start.
    Script,
    /// The hand-over switch of a transmitter gives its engines to the lower source (true), or takes them back.
    HandOver(bool),
    /// A fault begins (true) or ends.
    Fault(Fault, bool),
}

/// A fault that lasts until it is ended, or, of those that happen once, takes its course.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Fault {
    /// Both wires of the line are cut.
    Cut,
    /// The wire from the node to the ECU is cut.
    CutToEcu,
    /// The wire from the ECU to the node is cut.
    CutToNode,
    /// About one byte in twelve is damaged on the line.
    Noise,
    /// The ECU has no power.
    Power,
    /// The source is silent.
    Silence,
    /// The flame goes out, once.
    FlameOut,
    /// The watchdog resets the node, once. It concerns all engines.
    Reset,
}

impl Fault {
    /// All of them, in the order of the menu.
    pub const ALL: [Self; 8] = [
        Self::Cut,
        Self::CutToEcu,
        Self::CutToNode,
        Self::Noise,
        Self::FlameOut,
        Self::Power,
        Self::Reset,
        Self::Silence,
    ];

    /// Whether it happens once and cannot be ended.
    pub const fn is_once(self) -> bool {
        matches!(self, Self::FlameOut | Self::Reset)
    }

    /// Its name, for people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cut => "cut line",
            Self::CutToEcu => "cut wire to the ECU",
            Self::CutToNode => "cut wire to the node",
            Self::Noise => "noise",
            Self::Power => "ECU without power",
            Self::Silence => "silent source",
            Self::FlameOut => "flame-out",
            Self::Reset => "node reset",
        }
    }

    /// How its beginning and its end are written.
    const fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Cut => ("cut", "mend"),
            Self::CutToEcu => ("cut-to-ecu", "mend-to-ecu"),
            Self::CutToNode => ("cut-to-node", "mend-to-node"),
            Self::Noise => ("noise", "quiet"),
            Self::Power => ("power-off", "power-on"),
            Self::Silence => ("silent", "speak"),
            Self::FlameOut => ("flame-out", ""),
            Self::Reset => ("node-reset", ""),
        }
    }
}

/// The acts that are a word alone.
const WORDS: [(&str, Act); 10] = [
    ("arm", Act::Arm),
    ("disarm", Act::Disarm),
    ("start", Act::Start),
    ("standby", Act::Standby),
    ("emergency-stop", Act::EmergencyStop),
    ("release", Act::Release),
    ("script", Act::Script),
    ("hand-over", Act::HandOver(true)),
    ("take-back", Act::HandOver(false)),
    ("flame-out", Act::Fault(Fault::FlameOut, true)),
];

impl Act {
    /// As in a script file.
    pub fn text(self) -> String {
        match self {
            Self::Throttle(tenths) => format!("throttle {}.{}", tenths / 10, tenths % 10),
            Self::Rpm(rpm) => format!("rpm {rpm}"),
            Self::Fault(fault, true) => fault.words().0.to_owned(),
            Self::Fault(fault, false) => fault.words().1.to_owned(),
            other => WORDS.iter().find(|(_, act)| *act == other).map_or("", |(word, _)| word).to_owned(),
        }
    }

    /// For people.
    pub fn in_words(self) -> String {
        match self {
            Self::Throttle(_) => format!("{} %", self.text()),
            Self::Rpm(rpm) => format!("{rpm} rpm"),
            other => other.text(),
        }
    }

    /// Parses a line of a script file.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut words = text.split_whitespace();
        let unknown = || format!("`{text}` is not a valid action");
        let act = match words.next() {
            Some("throttle") => {
                let percent: f64 = words.next().and_then(|word| word.parse().ok()).ok_or_else(unknown)?;
                if !(0.0..=100.0).contains(&percent) {
                    return Err(format!("invalid throttle `{percent}`, use 0 to 100"));
                }
                Self::Throttle((percent * 10.0).round() as u16)
            }
            Some("rpm") => Self::Rpm(words.next().and_then(|word| word.parse().ok()).ok_or_else(unknown)?),
            Some(word) => {
                let fault = Fault::ALL.into_iter().find_map(|fault| {
                    let (begin, end) = fault.words();
                    if word == begin {
                        Some(Self::Fault(fault, true))
                    } else {
                        (word == end && !end.is_empty()).then_some(Self::Fault(fault, false))
                    }
                });
                let act = WORDS.iter().find(|(known, _)| *known == word).map(|(_, act)| *act);
                fault.or(act).ok_or_else(unknown)?
            }
            None => return Err(unknown()),
        };
        if words.next().is_some() { Err(unknown()) } else { Ok(act) }
    }

    /// Whether it takes the engine from its script. A fault does not, nor does a transmitter, which leaves no script.
    pub const fn takes_engine(self) -> bool {
        !matches!(self, Self::Fault(..) | Self::Script | Self::HandOver(_))
    }
}

/// Something done to one engine, or to all.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Action {
    /// Its place in the list of engines; `None`: all.
    pub engine: Option<usize>,
    /// What.
    pub act: Act,
}

impl Action {
    /// As in a script file.
    pub fn text(self, engines: &[Engine]) -> String {
        let name = self.engine.and_then(|i| engines.get(i)).map_or(ALL, Engine::name);
        format!("{name} {}", self.act.text())
    }

    /// Parses a line of a script file.
    pub fn parse(text: &str, engines: &[Engine]) -> Result<Self, String> {
        let (name, act) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        let engine = match name {
            ALL => None,
            name => {
                let place = engines.iter().position(|engine| engine.name() == name);
                Some(place.ok_or_else(|| format!("there is no engine `{name}`"))?)
            }
        };
        let act = Act::parse(act.trim())?;
        if let Act::Rpm(rpm) = act {
            let of = |place: usize| engine.is_none_or(|engine| engine == place);
            let mut all = engines.iter().enumerate().filter(|(place, _)| of(*place));
            all.try_for_each(|(_, engine)| engine.takes(rpm))?;
        }
        Ok(Self { engine, act })
    }
}

/// What a key requests: the player makes an [`Act`] of it that does the same whenever it is played again.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Wish {
    /// This.
    Act(Act),
    /// Changes the commanded demand by this much, in tenths of a percent of the range from idle to maximum.
    Step(i16),
    /// The hand-over switch of the transmitter, to its other position.
    HandOver,
    /// This fault begins if it is not present, and otherwise ends.
    Toggle(Fault),
}

#[cfg(test)]
mod tests {
    use super::super::super::engines::engines;
    use super::*;

    #[test]
    fn every_action_is_read_as_it_is_written() {
        let engines = engines(&[]).unwrap();
        let faults = Fault::ALL.into_iter().flat_map(|fault| [(fault, true), (fault, false)]);
        let faults = faults.filter(|(fault, begins)| *begins || !fault.is_once());
        let acts = faults.map(|(fault, begins)| Act::Fault(fault, begins));
        let acts = acts.chain(WORDS.map(|(_, act)| act)).chain([Act::Throttle(455), Act::Rpm(80_000)]);
        for act in acts {
            for engine in [None, Some(2)] {
                if engine.is_none() && matches!(act, Act::Rpm(_)) {
                    continue; // not every engine takes one
                }
                let action = Action { engine, act };
                assert_eq!(Action::parse(&action.text(&engines), &engines), Ok(action));
            }
        }
        assert_eq!(Action { engine: Some(0), act: Act::Throttle(455) }.text(&engines), "left throttle 45.5");
    }

    #[test]
    fn each_mistake_is_named() {
        let engines = engines(&[]).unwrap();
        for (text, part) in [
            ("", "no engine ``"),
            ("left", "not a valid action"),
            ("tail arm", "no engine `tail`"),
            ("left jump", "`jump` is not a valid action"),
            ("left throttle", "not a valid action"),
            ("left throttle 101", "invalid throttle"),
            ("left arm now", "not a valid action"),
            ("left rpm 60000", "the ECU of left has no speed control"),
            ("all rpm 60000", "the ECU of left has no speed control"),
            ("booster rpm 999999", "invalid rpm `999999`, use 0 to "),
        ] {
            let error = Action::parse(text, &engines).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
