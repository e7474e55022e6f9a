//! A script file: the actions of a played run, one per line, to be replayed with the same bytes on every wire.
//!
//! ```text
//! jetlink rig script, version 0.1.0
//! seed 1
//! engine name=left,ecu=amt,engine=olympus,baud=2400
//! 12.3 left arm
//! 60.0 end
//! ```

use super::super::engines::{DEFAULT, Engine};
use super::action::{Act, Action};
use embassy_time::{Duration, Instant};

const HEAD: &str = "jetlink rig script, version ";

/// Options of a run besides its actions: as on the command line.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Header {
    /// `--seed`.
    pub seed: u64,
    /// `--engine`, each of them; none for the default ones.
    pub engines: Vec<String>,
    /// `--duration`.
    pub duration: Option<String>,
    /// `--standby`.
    pub standby: bool,
    /// `--faults`.
    pub faults: Option<String>,
    /// `--rc`.
    pub rc: Option<String>,
    /// `--valves`.
    pub valves: bool,
    /// The source of the first engine falls silent for a while when all engines run: the rig's demonstration without options.
    pub silence: bool,
}

/// Default seed.
pub const USUAL_SEED: u64 = 1;

impl Default for Header {
    fn default() -> Self {
        Self {
            seed: USUAL_SEED,
            engines: Vec::new(),
            duration: None,
            standby: false,
            faults: None,
            rc: None,
            valves: false,
            silence: false,
        }
    }
}

/// A script file before its actions are read: these need the engines.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Script {
    /// Options of the run.
    pub header: Header,
    /// Time, line number and text of each action.
    actions: Vec<(Duration, usize, String)>,
    /// When the run ends; `None`: by itself.
    pub end: Option<Duration>,
    /// The version of jetlink that wrote it.
    pub version: String,
}

impl Script {
    /// Reads it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
        let version = lines
            .next()
            .and_then(|(_, line)| line.strip_prefix(HEAD))
            .ok_or_else(|| format!("line 1 has to be `{HEAD}{}`", env!("CARGO_PKG_VERSION")))?;
        let mut script =
            Self { header: Header::default(), actions: Vec::new(), end: None, version: version.to_owned() };
        let mut last = Duration::MIN;
        let mut given: Vec<&str> = Vec::new();
        for (number, line) in lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#')) {
            let wrong = |what: &str| format!("line {number}, `{line}`: {what}");
            let (first, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
            let rest = rest.trim_start();
            if script.end.is_some() {
                return Err(wrong("nothing follows `end`"));
            }
            if matches!(first, "seed" | "duration" | "standby" | "faults" | "rc" | "valves" | "silence") {
                if given.contains(&first) {
                    return Err(wrong(&format!("`{first}` is given twice")));
                }
                given.push(first);
            }
            if matches!(first, "standby" | "valves" | "silence") && !rest.is_empty() {
                return Err(wrong(&format!("`{first}` takes no value: without the line it is off")));
            }
            match first {
                "seed" => {
                    script.header.seed = rest.parse().map_err(|_| wrong("the seed is not a whole number"))?;
                }
                "engine" => script.header.engines.push(rest.to_owned()),
                "duration" => script.header.duration = Some(rest.to_owned()),
                "standby" => script.header.standby = true,
                "valves" => script.header.valves = true,
                "silence" => script.header.silence = true,
                "faults" => script.header.faults = Some(rest.to_owned()),
                "rc" => script.header.rc = Some(rest.to_owned()),
                time => {
                    let seconds: f64 =
                        time.parse().map_err(|_| wrong("it does not begin with a time in seconds"))?;
                    if !(0.0..=30.0 * 86_400.0).contains(&seconds) {
                        return Err(wrong("it does not begin with a time in seconds"));
                    }
                    let at = Duration::from_micros((seconds * 1e6).round() as u64);
                    if at < last {
                        return Err(wrong("the actions have to be in the order of time"));
                    }
                    last = at;
                    if rest == "end" {
                        script.end = Some(at);
                    } else {
                        script.actions.push((at, number, rest.to_owned()));
                    }
                }
            }
        }
        if script.header.silence && (script.header.standby || script.header.rc.is_some()) {
            return Err("`silence` needs pilots that fly: it goes with neither `standby` nor `rc`".to_owned());
        }
        Ok(script)
    }

    /// Notice if another version wrote it.
    pub fn of_another_version(&self) -> Option<String> {
        let own = env!("CARGO_PKG_VERSION");
        (self.version != own)
            .then(|| format!("written by version {}, played by {own}: the run may differ", self.version))
    }

    /// Its actions on these engines. The run has to end with them.
    pub fn actions(&self, engines: &[Engine]) -> Result<Vec<(Instant, Action)>, String> {
        let read = |(at, number, text): &(Duration, usize, String)| {
            let action =
                Action::parse(text, engines).map_err(|what| format!("line {number}, `{text}`: {what}"))?;
            Ok((Instant::MIN + *at, action))
        };
        let actions = self.actions.iter().map(read).collect::<Result<Vec<(Instant, Action)>, String>>()?;
        // An engine that was taken from its own script, and not given back, flies on. It cannot be given back while its stop is
        // latched.
        let is_played = |engine: usize| {
            let of_it = actions.iter().map(|(_, action)| action);
            let of_it = of_it.filter(|action| action.engine.is_none_or(|of| of == engine));
            let (mut played, mut latched) = (false, false);
            for action in of_it {
                match action.act {
                    Act::Fault(..) => continue,
                    Act::EmergencyStop => latched = true,
                    Act::Release => latched = false,
                    _ => {}
                }
                played = action.act != Act::Script || latched;
            }
            played
        };
        match engines.iter().enumerate().find(|(engine, _)| is_played(*engine)) {
            Some((_, engine)) if self.end.is_none() => Err(format!(
                "{} is played until the run ends: add `end` with its time, for example `{} end`",
                engine.name(),
                time(actions.last().map_or(Instant::MIN, |(at, _)| *at) + Duration::from_secs(10))
            )),
            _ => Ok(actions),
        }
    }
}

/// Writes a script file.
pub fn text(
    header: &Header,
    engines: &[Engine],
    actions: &[(Instant, Action)],
    end: Option<Instant>,
) -> String {
    let mut text = format!("{HEAD}{}\nseed {}\n", env!("CARGO_PKG_VERSION"), header.seed);
    let described = header.engines.iter().map(String::as_str);
    let usual = DEFAULT.into_iter().filter(|_| header.engines.is_empty());
    for engine in described.chain(usual) {
        text += &format!("engine {engine}\n");
    }
    if header.silence {
        text += "silence\n";
    }
    if let Some(duration) = &header.duration {
        text += &format!("duration {duration}\n");
    }
    if header.standby {
        text += "standby\n";
    }
    if let Some(faults) = &header.faults {
        text += &format!("faults {faults}\n");
    }
    if let Some(rc) = &header.rc {
        text += &format!("rc {rc}\n");
    }
    if header.valves {
        text += "valves\n";
    }
    for (at, action) in actions {
        text += &format!("{} {}\n", time(*at), action.text(engines));
    }
    if let Some(end) = end {
        text += &format!("{} end\n", time(end));
    }
    text
}

/// To the microsecond, without trailing zeros.
fn time(at: Instant) -> String {
    let micros = (at - Instant::MIN).as_micros();
    let text = format!("{}.{:06}", micros / 1_000_000, micros % 1_000_000);
    let text = text.trim_end_matches('0');
    if text.ends_with('.') { format!("{text}0") } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::super::super::engines::engines;
    use super::super::action::Fault;
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let header = Header {
            seed: 7,
            engines: vec!["name=a,ecu=zk".to_owned(), "name=b".to_owned()],
            duration: Some("300s".to_owned()),
            standby: false,
            faults: Some("light".to_owned()),
            rc: Some("sbus".to_owned()),
            valves: true,
            silence: false,
        };
        let engines = engines(&header.engines).unwrap();
        let at = |ms| Instant::MIN + Duration::from_millis(ms);
        let actions = vec![
            (at(1200), Action { engine: Some(1), act: Act::Throttle(455) }),
            (at(1200), Action { engine: None, act: Act::EmergencyStop }),
            (at(9000), Action { engine: Some(0), act: Act::Fault(Fault::Cut, false) }),
        ];
        let text = text(&header, &engines, &actions, Some(at(12_345)));
        assert!(
            text.ends_with("1.2 b throttle 45.5\n1.2 all emergency-stop\n9.0 a mend\n12.345 end\n"),
            "{text}"
        );
        let script = Script::parse(&text).unwrap();
        assert_eq!(script.header, header);
        assert_eq!(script.actions(&engines), Ok(actions));
        assert_eq!(script.end, Some(Duration::from_millis(12_345)));
    }

    #[test]
    fn the_default_engines_and_the_silence_are_written() {
        let header = Header { silence: true, ..Header::default() };
        let written = text(&header, &engines(&[]).unwrap(), &[], None);
        let read = Script::parse(&written).unwrap().header;
        assert_eq!((read.engines, read.silence), (DEFAULT.map(str::to_owned).to_vec(), true));
        for other in ["standby", "rc sbus"] {
            assert!(Script::parse(&format!("{written}{other}\n")).unwrap_err().contains("needs pilots"));
        }
    }

    #[test]
    fn another_version_is_named() {
        let of = |version: &str| Script::parse(&format!("{HEAD}{version}\n")).unwrap().of_another_version();
        assert_eq!(of(env!("CARGO_PKG_VERSION")), None);
        assert!(of("0.0.9").unwrap().starts_with("written by version 0.0.9, played by "));
    }

    /// A file can be written by hand.
    #[test]
    fn any_blanks_separate() {
        let engines = engines(&[]).unwrap();
        let script = format!("{HEAD}0.1.0\nseed  7\n 3.0  left   arm\n4\tleft\tthrottle\t50\n5   end \n");
        let script = Script::parse(&script).unwrap();
        let at = |seconds| Instant::MIN + Duration::from_secs(seconds);
        let left = |act| Action { engine: Some(0), act };
        let expected = vec![(at(3), left(Act::Arm)), (at(4), left(Act::Throttle(500)))];
        assert_eq!(script.actions(&engines), Ok(expected));
        assert_eq!((script.header.seed, script.end), (7, Some(Duration::from_secs(5))));
    }

    #[test]
    fn each_mistake_is_named_with_its_line() {
        let head = format!("{HEAD}0.1.0\n");
        for (text, part) in [
            ("".to_owned(), "line 1 has to be"),
            (format!("{head}soon left arm"), "line 2"),
            (format!("{head}seed x"), "whole number"),
            (format!("{head}2 left arm\n1 left start"), "line 3"),
            (format!("{head}seed 1\nseed 2"), "line 3, `seed 2`: `seed` is given twice"),
            (format!("{head}2 end\n3 left arm"), "nothing follows"),
            (format!("{head}standby no"), "line 2, `standby no`: `standby` takes no value"),
            (format!("{head}valves off"), "`valves` takes no value"),
            (format!("{head}silence 3"), "`silence` takes no value"),
        ] {
            let error = Script::parse(&text).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
        let script = Script::parse(&format!("{head}# a comment\n\n1 tail arm")).unwrap();
        assert!(script.actions(&engines(&[]).unwrap()).unwrap_err().starts_with("line 4, `tail arm`: "));
    }
}
