//! Scenarios of failures: `--scenario`. Each states the expected events, and judges by the wires and the simulated
//! engines whether they occurred. Of the node's own telemetry, it checks only reported events.

mod check;
mod context;
mod faults;
mod known;
mod power;
mod sources;
mod wires;

pub use self::context::ScenarioContext;
use embassy_time::Duration;
use std::pin::Pin;

/// An AMT engine, and a ZK engine whose ECU keeps it running without commands.
const PAIR: &[&str] =
    &["name=left,ecu=amt,engine=olympus,baud=2400", "name=right,ecu=zk,version=5,baud=9600"];
/// The same with the places changed.
const PAIR_ZK_LEFT: &[&str] =
    &["name=left,ecu=zk,version=5,baud=9600", "name=right,ecu=amt,engine=olympus,baud=2400"];
/// One ECU of each kind with unusual behaviour.
const THREE: &[&str] = &[
    "name=amt,ecu=amt,engine=olympus,baud=2400",
    "name=zk3,ecu=zk,version=3,baud=9600",
    "name=zk5,ecu=zk,version=5,baud=9600",
];
/// The same, and a ZK engine that is commanded an rpm.
const FOUR: &[&str] = &[THREE[0], THREE[1], THREE[2], "name=zk5-rpm,ecu=zk,version=5,baud=9600,mode=rpm"];
/// One ZK engine.
const ONE: &[&str] = &["name=left,ecu=zk,version=5,baud=9600"];

type Script<'a> = Pin<Box<dyn Future<Output = Result<(), String>> + 'a>>;

/// What is played.
#[derive(Debug)]
pub struct Scenario {
    /// Its name on the command line.
    pub name: &'static str,
    /// Its subject, in one line.
    pub line: &'static str,
    /// Its engines, as `--engine` describes them.
    pub engines: &'static [&'static str],
    /// What it lasts, roughly, in seconds.
    length: u64,
    /// Number of frames that the scenario cuts off or damages on their way to an ECU.
    pub bad_commands: u64,
    script: for<'a> fn(&'a ScenarioContext<'a>) -> Script<'a>,
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
    pub fn script<'a>(&self, scenario_context: &'a ScenarioContext<'a>) -> Script<'a> {
        (self.script)(scenario_context)
    }
}

/// All of them.
pub static ALL: &[Scenario] = &[
    Scenario {
        name: "source-loss",
        line: "no source commands two running engines: hold 1 s, then idle, no shutdown; and the source comes back",
        engines: PAIR,
        length: 90,
        bad_commands: 1,
        script: |c| Box::pin(known::source_loss(c)),
    },
    Scenario {
        name: "hot-start",
        line: "a start gets too hot: the ECU stops it, the node reports it and lets no hot engine start again",
        engines: ONE,
        length: 105,
        bad_commands: 1,
        script: |c| Box::pin(known::hot_start(c)),
    },
    Scenario {
        name: "flame-out",
        line: "the flame of a ZK engine goes out, later that of an AMT engine: reported, standby, and no relight",
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
        line: "the line to one of two engines is cut: reported, the other left alone, no restart when it is back",
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
    Scenario {
        name: "ecu-power-dip",
        line: "an ECU loses its power in flight for 0.2, 3 and 180 s: standby, and no restart, although run is commanded",
        engines: FOUR,
        length: 640,
        bad_commands: 2,
        script: |c| Box::pin(power::ecu_power_dip(c)),
    },
    Scenario {
        name: "watchdog-loop",
        line: "the watchdog resets the node in flight, then every 1.05 s: the engines run on, a dead source's demand does not",
        engines: PAIR,
        length: 130,
        bad_commands: 40,
        script: |c| Box::pin(power::watchdog_loop(c)),
    },
    Scenario {
        name: "brown-out",
        line: "the node's supply dips in flight, its memory survives: the engines run on, also one that reports faults only",
        engines: &[
            "name=normal,ecu=amt,engine=olympus,baud=2400",
            "name=faulted,ecu=amt,engine=olympus,baud=2400",
            "name=zk,ecu=zk,version=5,baud=9600",
        ],
        length: 100,
        bad_commands: 2,
        script: |c| Box::pin(power::brown_out(c)),
    },
    Scenario {
        name: "one-wire-cut",
        line: "each wire is cut for 30 s while the pilot moves the stick and then shuts the engine down",
        engines: THREE,
        length: 330,
        bad_commands: 4,
        script: |c| Box::pin(wires::one_wire_cut(c)),
    },
    Scenario {
        name: "framing-noise",
        line: "one in six bytes of an ECU breaks its frame for 2 s in flight: no engine is shut down",
        engines: THREE,
        length: 100,
        bad_commands: 1,
        script: |c| Box::pin(wires::framing_noise(c)),
    },
    Scenario {
        name: "waiting-start",
        line: "a start waits for another engine while its source is lost: it does not come later uncommanded",
        engines: PAIR,
        length: 130,
        bad_commands: 1,
        script: |c| Box::pin(sources::waiting_start(c)),
    },
    Scenario {
        name: "rc-over-mavlink",
        line: "RC is lost for 2 s above a MAVLink that streams standby, later run at 40 %: the engines run on",
        engines: PAIR,
        length: 100,
        bad_commands: 1,
        script: |c| Box::pin(sources::rc_over_mavlink(c)),
    },
    Scenario {
        name: "fault-clears",
        line: "a flame-out of an AMT engine that reports faults only, then the fault clears, early or late: no restart",
        engines: &[
            "name=left,ecu=amt,engine=olympus,baud=2400",
            "name=resting,ecu=amt,engine=olympus,baud=2400",
            "name=cleared,ecu=amt,engine=olympus,baud=2400",
        ],
        length: 165,
        bad_commands: 1,
        script: |c| Box::pin(faults::fault_clears(c)),
    },
    Scenario {
        name: "stop-release-arm-start",
        line: "emergency stop, release, arm, start: a source that keeps commanding arm must disarm first",
        engines: PAIR,
        length: 260,
        bad_commands: 1,
        script: |c| Box::pin(sources::stop_release_arm_start(c)),
    },
    Scenario {
        name: "ecu-swapped",
        line: "another ECU is plugged in while the link is down: it gets neither run nor what only the old one knew",
        engines: &["name=left,ecu=zk,version=5,baud=9600", "name=right,ecu=zk,version=5,baud=9600,mode=rpm"],
        length: 110,
        // ID 6 and ID 7 until the version of the new ECU is known.
        bad_commands: 30,
        script: |c| Box::pin(power::ecu_swapped(c)),
    },
    Scenario {
        name: "two-engines-one-fails",
        line: "one of two engines fails in flight: the other still obeys, and nothing is withheld from it",
        engines: PAIR,
        length: 110,
        bad_commands: 1,
        script: |c| Box::pin(faults::two_engines_one_fails(c)),
    },
    Scenario {
        name: "single-command-start",
        line: "a ground station starts an engine with a single command and is lost, beside a source that streams a throttle",
        engines: PAIR,
        length: 90,
        bad_commands: 1,
        script: |c| Box::pin(sources::single_command_start(c)),
    },
];
