//! The bytes that the firmware sends on each port in four named runs, as text: `cargo emu-record` writes them, `cargo
//! emu-compare` repeats the runs and compares. After a refactoring every byte has to be the same, in the same order
//! and at the same time.
//!
//! A recording is one text file for each run, one line for each byte: port, end of its last stop bit in µs, byte in hex.
//! Lines that begin with `#` describe the run. The runs touch the firmware only from outside (wires, supply, reset pin,
//! watchdog), so that they do not depend on a name in it.

use crate::board::{Board, MATEK_H743, PIXRACER};
use crate::image::Image;
use crate::run::{Bench, Run};
use sim::ecu::{MILLIS, SECOND};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Largest shift of a byte that counts as the same time, in µs.
pub const MOST_SHIFT: u64 = 100;

/// A run that is recorded.
#[derive(Debug)]
pub struct NamedRun {
    /// Its name, and that of its file.
    pub name: &'static str,
    /// The events of the run.
    pub text: &'static str,
    /// The board.
    pub board: &'static Board,
    /// The image.
    pub image: Image,
    make: fn(Run) -> Run,
}

/// All runs. The demonstration commands the engines: standby 5 s after each start of the firmware, run at idle at 15 s,
/// 20 % at 195 s, 40 % at 210 s, idle at 225 s, standby at 235 s.
pub static RUNS: [NamedRun; 4] = [
    NamedRun {
        name: "flight-matek-h743",
        text: "four engines that start within 5 s each: start, idle, 20 %, 40 %, idle, shutdown",
        board: &MATEK_H743,
        image: Image::Demo,
        make: |run| run.quick_engines().until(255 * SECOND),
    },
    NamedRun {
        name: "flight-pixracer",
        text: "the same with engines that take their usual time to start",
        board: &PIXRACER,
        image: Image::Demo,
        make: |run| run.engines().until(255 * SECOND),
    },
    NamedRun {
        name: "losses-matek-h743",
        text: "dips of the ECUs' power, cut wires, noise, lost bytes and babble, at idle and at 20 %",
        board: &MATEK_H743,
        image: Image::Demo,
        make: losses,
    },
    NamedRun {
        name: "resets-pixracer",
        text: "watchdog and reset pin while engines run, start and lose their power; a transmitter that stops",
        board: &PIXRACER,
        image: Image::Demo,
        make: resets,
    },
];

const LEFT: &str = "SERIAL2";
const RIGHT: &str = "SERIAL3";
const CENTRE: &str = "SERIAL4";
const BOOSTER: &str = "SERIAL5";
const ALL: [&str; 4] = [LEFT, RIGHT, CENTRE, BOOSTER];

fn losses(run: Run) -> Run {
    let noise = |per_million| {
        move |bench: &mut Bench<'_>| {
            bench.noise(LEFT, per_million);
            bench.garble(RIGHT, per_million);
            bench.framing(CENTRE, per_million);
            bench.noise(BOOSTER, per_million);
        }
    };
    let power = |ports: [&'static str; 2], on| {
        move |bench: &mut Bench<'_>| ports.iter().for_each(|port| bench.power(port, on))
    };
    let cut = |ports: [&'static str; 2], cut| {
        move |bench: &mut Bench<'_>| ports.iter().for_each(|port| bench.cut(port, cut))
    };
    let babble = |bytes: Option<&'static [u8]>| {
        move |bench: &mut Bench<'_>| [RIGHT, CENTRE].iter().for_each(|port| bench.babble(port, bytes))
    };
    run.quick_engines()
        .at(60 * SECOND, noise(50_000))
        .at(65 * SECOND, noise(0))
        .at(70 * SECOND, power([LEFT, BOOSTER], false))
        .at(70 * SECOND + 300 * MILLIS, power([LEFT, BOOSTER], true))
        .at(90 * SECOND, cut([RIGHT, CENTRE], true))
        .at(90 * SECOND + 700 * MILLIS, cut([RIGHT, CENTRE], false))
        .at(100 * SECOND, |bench| ALL.iter().for_each(|port| bench.drop_next(port)))
        .at(105 * SECOND, power([LEFT, CENTRE], false))
        .at(110 * SECOND, power([LEFT, CENTRE], true))
        .at(130 * SECOND, babble(Some(&[0x00, 0xFF, 0x55])))
        .at(133 * SECOND, babble(None))
        .at(198 * SECOND, cut([LEFT, BOOSTER], true))
        .at(199 * SECOND, cut([LEFT, BOOSTER], false))
        .at(202 * SECOND, power([RIGHT, CENTRE], false))
        .at(202 * SECOND + 200 * MILLIS, power([RIGHT, CENTRE], true))
        .until(215 * SECOND)
}

fn resets(run: Run) -> Run {
    run.quick_engines()
        .at(57 * SECOND, |bench| bench.watchdog_runs_out())
        .at(58 * SECOND, |bench| bench.press_reset())
        // In the middle of a start.
        .at(90 * SECOND, |bench| bench.watchdog_runs_out())
        .at(91 * SECOND, |bench| bench.stop_transmitter(BOOSTER))
        // The supply of everything dips for a short time.
        .at(112 * SECOND, |bench| {
            ALL.iter().for_each(|port| bench.power(port, false));
            bench.press_reset();
        })
        .at(112 * SECOND + 100 * MILLIS, |bench| ALL.iter().for_each(|port| bench.power(port, true)))
        .at(135 * SECOND, |bench| bench.stop_transmitter(LEFT))
        .at(140 * SECOND, |bench| bench.press_reset())
        .resets(5)
        .until(150 * SECOND)
}

/// A byte that was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sent {
    /// End of its last stop bit, in µs.
    pub us: u64,
    /// The byte.
    pub byte: u8,
}

/// Bytes sent on each port, in the order of time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recording(BTreeMap<String, Vec<Sent>>);

impl NamedRun {
    /// Runs it and returns the bytes sent.
    ///
    /// # Errors
    /// Everything that [`audit`](crate::audit) finds.
    pub fn record(&self) -> Result<Recording, String> {
        let run = (self.make)(Run::new(self.board, self.image));
        let (report, complaints) = run.with_errors().go_unchecked();
        if !complaints.is_empty() {
            return Err(format!("{}: {}\n{}", self.name, complaints.join("\n"), report.log_text()));
        }
        let sent = report.wires().map(|(port, wire)| {
            let bytes = wire.tx.iter().map(|tx| Sent { us: tx.end / 1000, byte: tx.byte });
            (port.to_owned(), bytes.collect())
        });
        Ok(Recording(sent.collect()))
    }

    /// The file of its recording.
    pub fn file(&self) -> String {
        format!("{}.txt", self.name)
    }

    /// The text of a recording of it.
    pub fn text_of(&self, recording: &Recording) -> String {
        format!(
            "# {}: {}, {} image. {}\n{}",
            self.name,
            self.board.name,
            self.image.feature().unwrap_or("release"),
            self.text,
            recording.text()
        )
    }
}

impl Recording {
    /// From the bytes sent on each port.
    pub fn new<'a>(ports: impl IntoIterator<Item = (&'a str, Vec<Sent>)>) -> Self {
        Self(ports.into_iter().map(|(port, sent)| (port.to_owned(), sent)).collect())
    }

    /// Number of bytes on all ports.
    pub fn bytes(&self) -> usize {
        self.0.values().map(Vec::len).sum()
    }

    /// As text, without a heading.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (port, sent) in &self.0 {
            for Sent { us, byte } in sent {
                let _ = writeln!(text, "{port} {us} {byte:02x}"); // a String takes all
            }
        }
        text
    }

    /// From its text.
    ///
    /// # Errors
    /// The first line that does not belong to a recording.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut recording = Self::default();
        let lines = text.lines().enumerate().filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        for (number, line) in lines {
            let sent = || {
                let (rest, byte) = line.rsplit_once(' ')?;
                let (port, us) = rest.rsplit_once(' ')?;
                let byte = u8::from_str_radix(byte, 16).ok()?;
                Some((port, Sent { us: us.parse().ok()?, byte }))
            };
            let (port, sent) = sent()
                .ok_or_else(|| format!("line {}: \"{line}\" is not port, time and byte", number + 1))?;
            recording.0.entry(port.to_owned()).or_default().push(sent);
        }
        Ok(recording)
    }
}

/// How two recordings of one run differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Comparison {
    /// Where the bytes or their order first differ, if they do.
    pub difference: Option<String>,
    /// Largest shift of a byte up to there, in µs.
    pub shift: u64,
    /// Where that was.
    pub shifted: String,
}

impl Comparison {
    /// Compares the earlier recording with the present one.
    pub fn of(before: &Recording, now: &Recording) -> Self {
        let mut result = Self { difference: None, shift: 0, shifted: String::new() };
        let mut first = u64::MAX;
        let mut ports: Vec<&String> = before.0.keys().chain(now.0.keys()).collect();
        ports.sort_unstable();
        ports.dedup();
        for port in ports {
            let [before, now] =
                [before, now].map(|recording| recording.0.get(port).map_or(&[][..], Vec::as_slice));
            let same = before.iter().zip(now).take_while(|(before, now)| before.byte == now.byte).count();
            for (before, now) in before.iter().zip(now).take(same) {
                let shift = before.us.abs_diff(now.us);
                if shift > result.shift {
                    result.shift = shift;
                    result.shifted = format!("{port}: {before} became {now}");
                }
            }
            let pair = (before.get(same), now.get(same));
            let at = pair.0.into_iter().chain(pair.1).map(|sent| sent.us).min();
            if let Some(at) = at
                && at < first
            {
                first = at;
                let show = |sent: Option<&Sent>| sent.map_or("nothing more".to_owned(), Sent::to_string);
                result.difference =
                    Some(format!("{port}, byte {same}: {} became {}", show(pair.0), show(pair.1)));
            }
        }
        result
    }

    /// Whether the two are the same.
    pub fn is_same(&self) -> bool {
        self.difference.is_none() && self.shift <= MOST_SHIFT
    }
}

impl core::fmt::Display for Sent {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:02x} at {} us", self.byte, self.us)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recording(bytes: &[(u64, u8)]) -> Recording {
        let sent =
            |bytes: &[(u64, u8)]| bytes.iter().map(|&(us, byte)| Sent { us, byte }).collect::<Vec<_>>();
        Recording::new([("D1 D0", sent(bytes)), ("SERIAL3", sent(&[(7, 0xFF)]))])
    }

    const BYTES: [(u64, u8); 3] = [(1000, 0xFF), (2000, 0x12), (3000, 0x20)];

    #[test]
    fn a_recording_is_the_same_after_it_was_written_and_read() {
        let all = recording(&BYTES);
        assert_eq!(Recording::parse(&format!("# heading\n{}", all.text())), Ok(all.clone()));
        assert_eq!(
            Comparison::of(&all, &all),
            Comparison { difference: None, shift: 0, shifted: String::new() }
        );
        assert!(Recording::parse("SERIAL2 12").is_err() && Recording::parse("SERIAL2 12 1000").is_err());
    }

    #[test]
    fn a_shift_of_100_us_is_the_same_and_one_more_is_not() {
        let mut later = BYTES;
        later[1].0 += MOST_SHIFT;
        let comparison = Comparison::of(&recording(&BYTES), &recording(&later));
        assert!(comparison.is_same() && comparison.shift == MOST_SHIFT, "{comparison:?}");
        later[1].0 += 1;
        let comparison = Comparison::of(&recording(&later), &recording(&BYTES));
        assert!(!comparison.is_same() && comparison.difference.is_none(), "{comparison:?}");
        assert_eq!(comparison.shifted, "D1 D0: 12 at 2101 us became 12 at 2000 us");
    }

    #[test]
    fn another_byte_one_less_one_more_and_another_order_are_differences() {
        let difference = |now: &[(u64, u8)]| {
            let comparison = Comparison::of(&recording(&BYTES), &recording(now));
            assert!(!comparison.is_same(), "{comparison:?}");
            comparison.difference.expect("a difference")
        };
        let mut other = BYTES;
        other[1].1 ^= 1;
        assert_eq!(difference(&other), "D1 D0, byte 1: 12 at 2000 us became 13 at 2000 us");
        assert_eq!(difference(&BYTES[..2]), "D1 D0, byte 2: 20 at 3000 us became nothing more");
        assert_eq!(
            difference(&[BYTES[0], BYTES[1], BYTES[2], (4000, 1)]),
            "D1 D0, byte 3: nothing more became 01 at 4000 us"
        );
        assert_eq!(
            difference(&[BYTES[0], BYTES[2], BYTES[1]]),
            "D1 D0, byte 1: 12 at 2000 us became 20 at 3000 us"
        );
        assert_eq!(difference(&[]), "D1 D0, byte 0: ff at 1000 us became nothing more");
    }
}
