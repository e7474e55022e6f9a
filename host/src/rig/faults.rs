//! Faults of a run and their times: `--faults`.

use super::engines::Engine;
use super::quantity::{duration, share};
use embassy_time::{Duration, Instant};
use sim::wire::Faults as LineFaults;

/// Faults of a run.
#[derive(Clone, PartialEq, Eq, Debug, Default)]
pub struct Faults {
    /// On every line, both ways.
    pub line: LineFaults,
    /// When `line` begins.
    pub from: Duration,
    /// When `line` ends; `None`: some time before the engines are shut down.
    pub until: Option<Duration>,
    /// Lines that are cut for a time.
    pub cuts: Vec<Cut>,
    /// Engines that fail.
    pub failures: Vec<(usize, Failure)>,
}

/// A line that is cut for a time.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Cut {
    /// Whose.
    pub engine: usize,
    /// From when.
    pub at: Duration,
    /// For how long.
    pub length: Duration,
}

/// Failure of an engine.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Failure {
    /// Every start gets too hot.
    HotStart,
    /// No start lights.
    NoLight,
    /// The flame goes out once.
    FlameOut(Duration),
}

impl Failure {
    /// As it is written.
    pub const fn name(self) -> &'static str {
        match self {
            Self::HotStart => "hot-start",
            Self::NoLight => "no-light",
            Self::FlameOut(_) => "flame-out",
        }
    }
}

/// A smaller share would invert less than one bit in a million.
const SMALLEST_NOISE: f64 = 0.000_004;

/// About one byte in a thousand each is damaged, lost, added or breaks its frame.
const LIGHT: &str = "noise=0.001,lose=0.001,add=0.001,framing=0.001,jitter=0.5ms";
/// About one byte in twelve is affected, and some come late.
const HEAVY: &str = "noise=0.03,lose=0.02,add=0.02,framing=0.02,jitter=3ms";

impl Faults {
    /// From the command line.
    pub fn parse(text: &str, engines: &[Engine]) -> Result<Self, String> {
        let mut faults = Self::default();
        faults.read(text, engines)?;
        if faults.until.is_some_and(|until| until <= faults.from) {
            return Err("--faults: `until` has to be later than `from`".to_owned());
        }
        given_once(text)
            .and_then(|()| faults.agree(text, engines))
            .map_err(|what| format!("--faults: {what}"))?;
        Ok(faults)
    }

    /// Checks that they do not contradict one another, and that each can act in some run.
    fn agree(&self, text: &str, engines: &[Engine]) -> Result<(), String> {
        let of_lines = |part: &str| {
            let key = part.split('=').next().unwrap_or_default();
            !matches!(key, "cut" | "hot-start" | "no-light" | "flame-out")
        };
        if !self.on_lines() && text.split(',').any(of_lines) {
            return Err(
                "no share, `jitter` or `delay` is above 0: nothing would go wrong on a line".to_owned()
            );
        }
        let name = |engine: usize| engines.get(engine).map_or("?", Engine::name);
        for (i, &(engine, failure)) in self.failures.iter().enumerate() {
            for &(_, other) in self.failures.iter().take(i).filter(|(of, _)| *of == engine) {
                if failure == other {
                    return Err(format!("{} of {} is given twice", failure.name(), name(engine)));
                }
                // No start succeeds: nothing else can come.
                if !matches!((failure, other), (Failure::FlameOut(_), Failure::FlameOut(_))) {
                    let (a, b) = (other.name(), failure.name());
                    return Err(format!("{a} and {b} of {} contradict each other", name(engine)));
                }
            }
        }
        for (i, cut) in self.cuts.iter().enumerate() {
            if cut.length == Duration::MIN {
                return Err(format!("the cut of {} has no length", name(cut.engine)));
            }
            let overlaps = |other: &&Cut| {
                other.engine == cut.engine
                    && cut.at < other.at + other.length
                    && other.at < cut.at + cut.length
            };
            if self.cuts.iter().take(i).any(|other| overlaps(&other)) {
                return Err(format!("two cuts of {} overlap", name(cut.engine)));
            }
        }
        Ok(())
    }

    fn read(&mut self, text: &str, engines: &[Engine]) -> Result<(), String> {
        for part in text.split(',') {
            match part {
                "light" => self.read(LIGHT, engines)?,
                "heavy" => self.read(HEAVY, engines)?,
                _ => self.read_one(part, engines).map_err(|what| format!("--faults: {what}"))?,
            }
        }
        Ok(())
    }

    fn read_one(&mut self, part: &str, engines: &[Engine]) -> Result<(), String> {
        let (key, value) = part
            .split_once('=')
            .ok_or_else(|| format!("`{part}` is neither light nor heavy nor of the form key=value"))?;
        let engine = |name: &str| {
            engines
                .iter()
                .position(|engine| engine.name() == name)
                .ok_or_else(|| format!("there is no engine `{name}`"))
        };
        match key {
            // A damaged byte has at least one bit of eight inverted.
            "noise" => {
                let bytes = f64::from(share(value)?) / 1e6;
                let bits = 1.0 - (1.0 - bytes).powf(1.0 / 8.0);
                self.line.flip_per_million = (bits * 1e6).round() as u32;
                if bytes > 0.0 && self.line.flip_per_million == 0 {
                    return Err(format!("noise={value} is below the smallest value, {SMALLEST_NOISE}"));
                }
            }
            "lose" => self.line.lose_per_million = share(value)?,
            "add" => self.line.add_per_million = share(value)?,
            "framing" => self.line.framing_per_million = share(value)?,
            "jitter" => self.line.jitter_ns = nanos("jitter", value)?,
            "delay" => self.line.delay_ns = nanos("delay", value)?,
            "from" => self.from = duration(value)?,
            "until" => self.until = Some(duration(value)?),
            "cut" => {
                let (name, times) = value.split_once('@').ok_or_else(|| cut_form(value))?;
                let (at, length) = times.split_once('+').ok_or_else(|| cut_form(value))?;
                let cut = Cut { engine: engine(name)?, at: duration(at)?, length: duration(length)? };
                self.cuts.push(cut);
            }
            "hot-start" => self.failures.push((engine(value)?, Failure::HotStart)),
            "no-light" => self.failures.push((engine(value)?, Failure::NoLight)),
            "flame-out" => {
                let (name, at) = value.split_once('@').ok_or_else(|| {
                    format!("flame-out=`{value}` is not of the form ENGINE@TIME, for example left@60s")
                })?;
                self.failures.push((engine(name)?, Failure::FlameOut(duration(at)?)));
            }
            _ => {
                return Err(format!(
                    "there is no fault `{key}`: there are light, heavy, noise, lose, add, framing, jitter, delay, \
                     from, until, cut, hot-start, no-light, flame-out"
                ));
            }
        }
        Ok(())
    }

    /// Effect of `heavy` on a line.
    pub fn heavy() -> LineFaults {
        let mut faults = Self::default();
        // The set is good: the tests read it.
        let _ = faults.read(HEAVY, &[]);
        faults.line
    }

    /// Whether anything goes wrong on all lines.
    pub fn on_lines(&self) -> bool {
        self.line != LineFaults::default()
    }

    /// Whether nothing ever goes wrong on this engine's line.
    pub fn line_is_clean(&self, engine: usize) -> bool {
        !self.on_lines() && self.cuts.iter().all(|cut| cut.engine != engine)
    }

    /// When the last fault on this engine's line ends; the start of the run when there is none.
    pub fn line_clean_from(&self, engine: usize) -> Instant {
        let noise = if self.on_lines() { self.until } else { None };
        let cuts = self.cuts.iter().filter(|cut| cut.engine == engine).map(|cut| cut.at + cut.length);
        let end = noise.into_iter().chain(cuts).max().unwrap_or(Duration::MIN);
        Instant::MIN + end
    }
}

/// A fault with a single value is given only once; values of a set may be changed.
fn given_once(text: &str) -> Result<(), String> {
    let mut seen: Vec<&str> = Vec::new();
    for part in text.split(',') {
        let key = match part.split_once('=') {
            Some(("cut" | "hot-start" | "no-light" | "flame-out", _)) => continue,
            Some((key, _)) => key,
            None => "a set of faults",
        };
        if seen.contains(&key) {
            return Err(format!("{key} is given twice"));
        }
        seen.push(key);
    }
    Ok(())
}

/// A time in milliseconds or seconds, with its unit: elsewhere a number alone means seconds.
fn nanos(fault: &str, text: &str) -> Result<u64, String> {
    let time = duration(text)?;
    if text.ends_with(|c: char| c.is_ascii_digit()) {
        return Err(format!("{fault}={text} has no unit, write for example {fault}={text}ms"));
    }
    Ok(time.as_micros() * 1000)
}

fn cut_form(value: &str) -> String {
    format!("cut=`{value}` is not of the form ENGINE@TIME+LENGTH, for example left@40s+5s")
}

#[cfg(test)]
mod tests {
    use super::super::engines::engines;
    use super::super::plan::{FlownBy, Plan};
    use super::*;

    #[test]
    fn each_fault_of_a_list_is_read() {
        let engines = engines(&[]).unwrap();
        let text =
            "noise=0.02,lose=0.01,jitter=3ms,delay=2ms,from=30s,until=90s,cut=right@40s+5s,hot-start=left";
        let faults = Faults::parse(text, &engines).unwrap();
        assert_eq!(faults.line.flip_per_million, 2522); // 1 - 0.98^(1/8)
        assert_eq!((faults.line.lose_per_million, faults.line.jitter_ns), (10_000, 3_000_000));
        assert_eq!((faults.from.as_secs(), faults.until), (30, Some(Duration::from_secs(90))));
        assert_eq!(
            faults.cuts,
            [Cut { engine: 1, at: Duration::from_secs(40), length: Duration::from_secs(5) }]
        );
        assert_eq!(faults.failures, [(0, Failure::HotStart)]);
        assert!(!faults.line_is_clean(0));
        let cut = Faults::parse("cut=right@40s+5s", &engines).unwrap();
        assert!(cut.line_is_clean(0) && !cut.line_is_clean(1));
        assert_eq!(cut.line_clean_from(1), Instant::from_secs(45));
    }

    #[test]
    fn noise_that_would_round_to_none_is_refused() {
        let engines = engines(&[]).unwrap();
        let flips = |text: &str| Faults::parse(text, &engines).map(|faults| faults.line.flip_per_million);
        assert_eq!(flips("noise=0.000004"), Ok(1));
        let error = flips("noise=0.000001").unwrap_err();
        assert_eq!(error, "--faults: noise=0.000001 is below the smallest value, 0.000004");
        assert!(flips("lose=0.0000001").unwrap_err().contains("below the smallest one, 0.000001"));
    }

    #[test]
    fn a_fault_that_cannot_act_in_this_run_is_refused() {
        let engines = engines(&[]).unwrap();
        let check = |text: &str, standby| {
            let mut faults = Faults::parse(text, &engines).unwrap();
            let flown_by = if standby { FlownBy::PilotsInStandby } else { FlownBy::Pilots };
            let plan = Plan::new(&engines, None, flown_by, &mut faults).unwrap();
            faults.check(&plan, &engines)
        };
        for text in [
            "flame-out=left@40s,flame-out=left@110s,flame-out=right@60s",
            "cut=left@0s+1000s",
            "cut=left@50s+1s,flame-out=left@60s",
            "cut=left@0s+1s,flame-out=left@60s",
            "cut=right@30s+100s,flame-out=left@60s",
            "cut=centre@80s+20s,flame-out=centre@90s",
            "hot-start=left",
            "hot-start=left,cut=right@0s+1000s",
            "no-light=left,cut=left@20s+1000s",
            "no-light=left,cut=left@0s+60s",
        ] {
            assert_eq!(check(text, false), Ok(()), "{text}");
        }
        for (text, standby, part) in [
            ("flame-out=left@9999s", false, "its flame burns from about"),
            ("flame-out=left@3s", false, "its flame burns from about"),
            ("flame-out=booster@30s", false, "its flame burns from about"),
            ("flame-out=left@40s,flame-out=left@45s", false, "its flame burns again from about 103 s"),
            ("flame-out=left@90s,flame-out=left@60s", false, "its flame burns again from about"),
            ("cut=left@9999s+1s", false, "after the end of the run"),
            // An AMT ECU stops its engine without commands; and no start comes through a cut line.
            (
                "cut=left@30s+100s,flame-out=left@60s",
                false,
                "after the cut at 30 s its flame burns again from about",
            ),
            (
                "cut=left@2s+60s,flame-out=left@40s",
                false,
                "after the cut at 2 s its flame burns again from about",
            ),
            ("hot-start=left", true, "cannot act with --standby"),
            ("no-light=left,cut=left@0s+1000s", false, "no-light of left cannot act: its line is cut until"),
            (
                "cut=left@2s+1000s,hot-start=left",
                false,
                "hot-start of left cannot act: its line is cut until",
            ),
        ] {
            let error = check(text, standby).unwrap_err();
            assert!(error.starts_with("--faults: ") && error.contains(part), "{text}: {error}");
        }
    }

    /// With MAVLink or radio control.
    #[test]
    fn a_fault_that_may_act_in_a_run_flown_from_outside_is_accepted() {
        let engines = engines(&[]).unwrap();
        let check = |text: &str, length: Option<u64>| {
            let mut faults = Faults::parse(text, &engines).unwrap();
            let plan = Plan::new(&engines, length.map(Duration::from_secs), FlownBy::Outside, &mut faults)?;
            faults.check(&plan, &engines).map(|()| faults.until.map(|until| until.as_secs()))
        };
        for (text, until) in [
            ("hot-start=left", None),
            ("no-light=left", None),
            ("flame-out=left@3s", None),
            ("cut=left@40s+5s", None),
            ("heavy", None),
            ("heavy,until=30s", Some(30)),
            ("heavy,from=50s", None),
        ] {
            assert_eq!(check(text, None), Ok(until), "{text}");
            assert_eq!(check(text, Some(60)), Ok(until), "{text}");
        }
        for (text, part) in [
            ("cut=left@60s+5s", "the cut of left at 60 s comes after the end of the run at 60 s"),
            ("flame-out=left@99s", "the flame-out of left at 99 s comes after the end"),
            ("heavy,from=60s", "`from` has to be earlier than --duration"),
        ] {
            assert_eq!(check(text, None).err(), None, "{text}");
            assert!(check(text, Some(60)).unwrap_err().contains(part), "{text}");
        }
    }

    #[test]
    fn presets_can_be_changed() {
        let engines = engines(&[]).unwrap();
        let heavy = Faults::parse("heavy", &engines).unwrap();
        let changed = Faults::parse("heavy,lose=0", &engines).unwrap();
        assert!(heavy.on_lines() && heavy.line.lose_per_million > 0);
        assert_eq!(changed.line.lose_per_million, 0);
        assert_eq!(changed.line.add_per_million, heavy.line.add_per_million);
    }

    #[test]
    fn each_mistake_is_named() {
        let engines = engines(&[]).unwrap();
        for (text, part) in [
            ("", "key=value"),
            ("loud", "`loud`"),
            ("noise=2", "invalid share"),
            ("jitter=soon", "invalid duration"),
            ("jitter=3", "jitter=3 has no unit, write for example jitter=3ms"),
            ("delay=2", "delay=2 has no unit, write for example delay=2ms"),
            ("rain=0.1", "no fault `rain`"),
            ("cut=left", "ENGINE@TIME+LENGTH"),
            ("cut=tail@1s+1s", "no engine `tail`"),
            ("flame-out=left", "ENGINE@TIME"),
            ("hot-start=tail", "no engine `tail`"),
            ("heavy,from=9s,until=8s", "later than"),
            ("from=5s", "nothing would go wrong"),
            ("noise=0", "nothing would go wrong"),
            ("noise=0.1,noise=0.2", "noise is given twice"),
            ("light,heavy", "given twice"),
            ("cut=left@40s+0s", "no length"),
            ("cut=left@40s+9s,cut=left@45s+1s", "overlap"),
            ("hot-start=left,hot-start=left", "given twice"),
            ("hot-start=left,no-light=left", "contradict"),
            ("no-light=left,flame-out=left@60s", "contradict"),
            ("flame-out=left@60s,flame-out=left@60s", "given twice"),
        ] {
            let error = Faults::parse(text, &engines).unwrap_err();
            assert!(error.starts_with("--faults: ") && error.contains(part), "{text}: {error}");
        }
    }
}
