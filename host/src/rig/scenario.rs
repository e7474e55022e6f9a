//! What can go wrong, played: `--scenario`. Each says what has to happen, and judges by what was on the wires and
//! what the simulated engines did whether it did. The node's own telemetry is only asked what it told.

mod cockpit;
mod known;

pub use self::cockpit::{Check, Cockpit};
use super::audit::{Said, Spoken};
use embassy_time::Duration;
use sim::ecu::{MILLIS, Nanos};
use std::pin::Pin;

/// An AMT engine and a ZK engine whose ECU goes on by itself.
const PAIR: &[&str] =
    &["name=left,ecu=amt,engine=olympus,baud=2400", "name=right,ecu=zk,version=5,baud=9600"];
/// The same with the places changed.
const PAIR_ZK_LEFT: &[&str] =
    &["name=left,ecu=zk,version=5,baud=9600", "name=right,ecu=amt,engine=olympus,baud=2400"];
/// One ZK engine.
const ONE: &[&str] = &["name=left,ecu=zk,version=5,baud=9600"];

/// The longest time from what the node decides to what is on the wire: an AMT ECU is answered every 125 ms, and
/// the answer takes 20.8 ms.
const ON_WIRE: Nanos = 175 * MILLIS;
/// What a node takes to see that an engine stopped: two reports that agree. A ZK ECU at 20 Hz says its state every
/// 0.4 s.
const SEES_STOP: Nanos = 1500 * MILLIS;
/// Between two words of the pilot.
const WORDS: Nanos = 100 * MILLIS;
/// Steps of the wire in the throttle, in tenths of a percent.
const GRAIN: u16 = 10;

type Script<'a> = Pin<Box<dyn Future<Output = Result<(), String>> + 'a>>;

/// What is played.
#[derive(Debug)]
pub struct Scenario {
    /// Its name on the command line.
    pub name: &'static str,
    /// What it is about, in one line.
    pub line: &'static str,
    /// Its engines, as `--engine` describes them.
    pub engines: &'static [&'static str],
    /// What it lasts, roughly, in seconds.
    length: u64,
    /// Frames that an ECU hears cut off or damaged, because the scenario does that.
    pub bad_commands: u64,
    script: for<'a> fn(&'a Cockpit<'a>) -> Script<'a>,
}

impl Scenario {
    /// The one with this name.
    pub fn named(name: &str) -> Result<&'static Self, String> {
        ALL.iter().find(|scenario| scenario.name == name).ok_or_else(|| {
            let names: Vec<&str> = ALL.iter().map(|scenario| scenario.name).collect();
            format!("--scenario: there is no `{name}`: there are {}", names.join(", "))
        })
    }

    /// What it lasts, roughly.
    pub const fn length(&self) -> Duration {
        Duration::from_secs(self.length)
    }

    /// Plays it.
    pub fn script<'a>(&self, cockpit: &'a Cockpit<'a>) -> Script<'a> {
        (self.script)(cockpit)
    }
}

/// All of them.
pub static ALL: &[Scenario] = &[
    Scenario {
        name: "source-loss",
        line: "nobody commands two running engines: hold 1 s, then idle, no shutdown; and the source comes back",
        engines: PAIR,
        length: 90,
        bad_commands: 1,
        script: |c| Box::pin(known::source_loss(c)),
    },
    Scenario {
        name: "hot-start",
        line: "a start gets too hot: the ECU stops it, the node tells it and lets no hot engine start again",
        engines: ONE,
        length: 105,
        bad_commands: 1,
        script: |c| Box::pin(known::hot_start(c)),
    },
    Scenario {
        name: "flame-out",
        line: "the flame of a ZK engine goes out, later that of an AMT engine: told, standby, and no relight",
        engines: PAIR_ZK_LEFT,
        length: 100,
        bad_commands: 1,
        script: |c| Box::pin(known::flame_out(c)),
    },
    Scenario {
        name: "reset-in-flight",
        line: "the watchdog resets the node, then its supply fails: both engines run on through both",
        engines: PAIR,
        length: 95,
        bad_commands: 1,
        script: |c| Box::pin(known::reset_in_flight(c)),
    },
    Scenario {
        name: "engine-lost",
        line: "the line to one of two engines is cut: told, the other left alone, no restart when it is back",
        engines: PAIR,
        length: 90,
        bad_commands: 1,
        script: |c| Box::pin(known::engine_lost(c)),
    },
    Scenario {
        name: "emergency-stop",
        line: "emergency stop while one engine starts and one runs: both stop at once, and stay so until released",
        engines: PAIR,
        length: 70,
        bad_commands: 1,
        script: |c| Box::pin(known::emergency_stop(c)),
    },
];

/// All frames say this, but for those that say nothing of switch and demand, and there are some.
fn all(frames: &[Spoken], said: Said) -> bool {
    frames.iter().any(|frame| frame.said == said)
        && frames.iter().all(|frame| frame.said == said || frame.said == Said::Nothing)
}

fn seconds(nanos: Nanos) -> f64 {
    nanos as f64 / 1e9
}
