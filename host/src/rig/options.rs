//! The command line of `jetlink rig`.

use super::engines;
use super::faults::Faults;
use super::mavlink::{MOST_PORTS, Mavlink};
use super::plan::{FlownBy, Plan};
use super::play::action::Action;
use super::play::check::{Played, check};
use super::play::script::{Header, Script, USUAL_SEED};
use super::port::Address;
use super::quantity;
use super::radio::{Choice, Radio, RadioError};
use super::scenario::Scenario;
use super::session::Setup;
use embassy_time::{Duration, Instant};

/// What `--help` says beyond the options, before and after the keys of all protocols.
const HELP: [&str; 2] = ["\
What it does:
  Joins the node to one simulated ECU and turbine for each engine, takes every engine through standby, start,
  idle, steps of throttle or rpm, shutdown and cooling, and judges each by what the ECU reports. On a terminal a
  screen shows it live; otherwise, and with --fast, plain lines do. The summary at the end counts what the node
  and what the ECUs received. Every frame on the wire is compared with what was commanded.

Columns:
  commanded  what the source commands
  sent       the demand that the node last sent to the ECU: it differs from the commanded one while a limit, a lost
             source, another source or an emergency stop (STOP) is in force
  source     the source in control; what holds its demand
  errors     bytes and frames from the ECU that could not be decoded

Summary:
  commands rejected    refused by an interlock or by the rules of sources. Neither a start that waits for another
                       engine nor a command while the node still listened after its own start is counted
  unsolicited commands frames on the wire that no order in force allows
  worst cadence error  ZK: the node sends in fixed send slots. An emergency stop, and the frame right after a change
                       of the control mode, are sent ahead of their slot and do not count

Engines:
", "  \
  Baud rates are 2400, 4800, 9600, 19200, 38400, 57600, 115200. Up to 8 engines. Without --engine there are
  two AMT engines at 2400 baud and two ZK engines, one at 9600 baud with version 4, one at 115200 baud with
  version 5 that is commanded by rpm.

Faults, a comma-separated list:
  light, heavy          sets of the following
  noise=SHARE           of the bytes arrive with inverted bits (0.02 is 2 %)
  lose=, add=, framing= share of the bytes that are lost, that are followed by another, that break their frame
  jitter=TIME, delay=TIME   bytes arrive later, by a random time up to this, or always by this (3ms)
  from=TIME, until=TIME     when the above begin and end (default: from the start until 15 s before the first
                            shutdown, so that recovery is seen and judged)
  cut=ENGINE@TIME+LENGTH    cuts a line (left@40s+5s)
  hot-start=ENGINE, no-light=ENGINE    the starts of an engine fail
  flame-out=ENGINE@TIME     its flame goes out once
  A fault that could not act in this run is refused. On disturbed lines missed windows and decode errors are
  counted and do not fail the run. An AMT ECU may stop its engine then, because it received nothing: that is
  reported, and the engine started again. A link that does not recover fails the run, and so does an unsolicited
  command.

Scenarios:
  --scenario NAME plays one of --list-scenarios with engines of its own, live or with --fast. It has a list of
  expected events, and checks them against the wires and the simulated engines.

CSV columns, a row for each engine every 0.1 s, empty where the ECU has reported nothing for 2 s:
  t_s, engine, phase (of the run), state (as the ECU names it), rpm, egt_c, command (standby or run),
  demand_throttle_pct, demand_rpm, throttle_pct (as the ECU reports it), link, frames (received), sent, missed
  (replies and send slots, by the node's count), decode_errors, rejected (commands, see the summary),
  engine_state (in plain words), in_control (the active source), waiting (the source about to take over), loss (stage
  of the loss of the source), limited (a limit has lowered the demand), armed, order (of the node),
  wire_throttle_pct and wire_rpm (sent; empty while nothing is), fuel_valve and starter_power (with --valves),
  faults (as the ECU reports them), events (since the row before, separated by |)
  The file is flushed every second: `tail -f`, a FIFO and /dev/stdout work. Text goes to the standard error then.

MAVLink:
  --mavlink tcpin:127.0.0.1:5790         a ground station connects here, as to a board's USB
  --mavlink tcpout:127.0.0.1:5762        connects to an autopilot, as a board's telemetry port does (SERIAL1 of a
                                         simulated ArduPlane)
  udpin:HOST:PORT, udpout:HOST:PORT and serial:DEVICE:BAUD are the same over UDP and on a serial port. tcpout, udpout
  and serial are the autopilot's side. The pilots do not fly then: the engines are commanded by MAVLink, and the run
  continues until it is ended or for --duration. Settings stay in memory until then. docs/mavlink.md has the rest.

Radio control:
  --rc sbus, --rc crsf, --rc pwm         the keys move a simulated transmitter: t the switch to standby, s to run
                                         allowed, Space to stop; Up and Down the stick
  --rc sbus=tcpout:127.0.0.1:5763        real frames from outside (SERIAL2 of a simulated ArduPlane as SBUS output);
                                         addresses as for MAVLink but udpout. A serial port gets 8E2 with sbus; an
                                         adapter has to undo the inversion of SBUS
  --rc sbus,throttle=1,switch=6          other channels than 3 for the throttle and 5 for the switch, also behind an
                                         address; pwm has 1 and 2, of four
  --rc sbus,hand=7                       a channel that hands the engines over to the lower source; h moves it
  One receiver for all engines. The pilots do not fly then, and --mavlink beside it is the lower source. docs/rc.md has
  what stick and switch do. --valves gives each engine a fuel valve.

Exit status:
  0  no reply window was missed on a clean line, and every engine reached its targets; with --scenario: all expected
     events occurred
  1  otherwise, or a file could not be written
  2  a wrong option
  A run that is ended early completes its files and prints the summary so far. This is not a failure: the status is
  0 after q, 130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP, and 1 only if something had gone wrong before.

Time:
  Everything is simulated in virtual time. Without --fast it is paced to real time. A busy computer delays the run
  but does not change it: the same seed gives the same result, live and with --fast."];

fn help() -> String {
    HELP.join(&engines::HELP.concat())
}

/// Arguments of `jetlink rig`.
#[derive(clap::Args, Debug)]
#[command(after_long_help = help(), after_help = "--help explains all, --engine and --faults in full.")]
pub struct Args {
    /// An engine and its ECU; repeatable
    #[arg(long = "engine", value_name = "DESCRIPTION")]
    pub engines: Vec<String>,

    /// Run as fast as the machine allows, instead of in real time
    #[arg(long)]
    pub fast: bool,

    /// Length of the run in engine time, for example 300s, 10m or 6h; only the running phase is stretched or shortened
    #[arg(long, value_name = "TIME")]
    pub duration: Option<String>,

    /// Start no engine: stay in standby for --duration (default 10s) and judge the links
    #[arg(long)]
    pub standby: bool,

    /// Seed for all random numbers
    #[arg(long, value_name = "NUMBER", default_value_t = USUAL_SEED.to_string())]
    pub seed: String,

    /// What goes wrong, for example heavy or noise=0.02,lose=0.01
    #[arg(long, value_name = "LIST")]
    pub faults: Option<String>,

    /// Write all samples to this file
    #[arg(long, value_name = "FILE")]
    pub csv: Option<String>,

    /// Draw rpm, EGT and demand over time into this file
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<String>,

    /// Draw the plot for a dark page
    #[arg(long, requires = "plot")]
    pub dark: bool,

    /// Write a page for a browser into this file: curves to zoom into, events and the verdict for each engine
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<String>,

    /// Write the raw bytes of each line, a file for each engine and direction, into this folder
    #[arg(long, value_name = "DIR")]
    pub capture: Option<String>,

    /// Plain lines, even on a terminal
    #[arg(long)]
    pub plain: bool,

    /// Draw with ASCII characters only
    #[arg(long)]
    pub ascii: bool,

    /// Play the actions of this file
    #[arg(long, value_name = "FILE", conflicts_with_all = ["engines", "duration", "standby", "faults", "seed", "scenario"])]
    pub script: Option<String>,

    /// Save what was done by key to this file, for replay with --script
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scenario", "mavlink"])]
    pub save_script: Option<String>,

    /// For the test of what a panic leaves behind
    #[arg(long, value_name = "TIME", hide = true)]
    pub panic_at: Option<String>,

    /// Play a failure scenario and judge what happens
    #[arg(long, value_name = "NAME", conflicts_with_all = ["engines", "duration", "standby", "faults"])]
    pub scenario: Option<String>,

    /// Serve MAVLink here, in place of the pilots; repeatable
    #[arg(long, value_name = "ADDRESS", conflicts_with_all = ["fast", "standby", "script", "scenario"])]
    pub mavlink: Vec<String>,

    /// Radio control in place of the pilots: sbus, crsf or pwm, moved by the keys; sbus=ADDRESS or crsf=ADDRESS, frames from outside
    #[arg(long, value_name = "RECEIVER", conflicts_with_all = ["fast", "standby", "script", "scenario"])]
    pub rc: Option<String>,

    /// Give each engine a fuel valve that cuts its fuel, and a switch for the power of its starter and ignition
    #[arg(long, conflicts_with_all = ["script", "scenario"])]
    pub valves: bool,

    /// For tests: speed factor of engine time
    #[arg(long, value_name = "NUMBER", hide = true, conflicts_with = "fast")]
    pub speed: Option<u32>,

    /// List the scenarios with a line of explanation each
    #[arg(long)]
    pub list_scenarios: bool,
}

/// The actions of a script file, and its end.
pub type Actions = (Vec<(Instant, Action)>, Option<Duration>);

/// What is decided before a run.
#[derive(Debug)]
pub struct Order {
    /// The run.
    pub setup: Setup,
    /// The same in words, for a script file.
    pub header: Header,
    /// The actions of a script file, and its end.
    pub script: Option<Actions>,
    /// What a person should know before the run.
    pub notices: Vec<String>,
}

/// Reads the command line, and the script file that it names.
pub fn order(args: &Args) -> Result<Order, String> {
    let script = match &args.script {
        Some(path) => {
            let text =
                std::fs::read_to_string(path).map_err(|error| format!("cannot read {path}: {error}"))?;
            Some(Script::parse(&text).map_err(|what| format!("{path}: {what}"))?)
        }
        None => None,
    };
    let scenario = args.scenario.as_deref().map(Scenario::named).transpose()?;
    let header = match &script {
        Some(script) => script.header.clone(),
        None => header(args, scenario.is_some())?,
    };
    let described: Vec<String> = match scenario {
        Some(scenario) => scenario.engines.iter().map(|&text| text.to_owned()).collect(),
        None => header.engines.clone(),
    };
    let mut notices = Vec::new();
    let setup = setup(args, &header, scenario, &described)?;
    let script = match (script, &args.script) {
        (Some(script), Some(path)) => {
            if setup.radio.is_some() && script.end.is_none() {
                return Err(RadioError::NoEnd.to_string());
            }
            let actions = script.actions(&setup.engines).map_err(|what| format!("{path}: {what}"))?;
            let played = Played {
                plan: &setup.plan,
                engines: &setup.engines,
                transmitter: setup.radio.is_some(),
                has_end: script.end.is_some(),
            };
            check(&actions, &played).map_err(|what| format!("{path}: {what}"))?;
            let late = script.end.and_then(|end| setup.faults.after(end, &setup.engines));
            if let Some(late) = late {
                // A run that was played by hand may have been ended before its faults: its file plays the same.
                let late = format!("{path}: {late}");
                if actions.is_empty() && setup.radio.is_none() {
                    return Err(late);
                }
                notices.push(late);
            }
            notices.extend(script.of_another_version().map(|what| format!("{path}: {what}")));
            Some((actions, script.end))
        }
        _ => None,
    };
    Ok(Order { setup, header, script, notices })
}

/// The command line in the words of a script file.
fn header(args: &Args, scenario: bool) -> Result<Header, String> {
    let seed = args
        .seed
        .parse()
        .map_err(|_| format!("--seed: `{}` is not a whole number from 0 to {}", args.seed, u64::MAX))?;
    let mut header = Header {
        seed,
        engines: args.engines.clone(),
        duration: args.duration.clone(),
        standby: args.standby,
        faults: args.faults.clone(),
        rc: args.rc.clone(),
        valves: args.valves,
        silence: false,
    };
    // Without options that change the run.
    header.silence = !scenario && args.mavlink.is_empty() && header == Header { seed, ..Header::default() };
    Ok(header)
}

/// Opens the ports of `--mavlink`.
fn mavlink(addresses: &[String], engines: &[engines::Engine]) -> Result<Option<Mavlink>, String> {
    if addresses.len() > MOST_PORTS {
        return Err(format!(
            "--mavlink: {} ports are too many: the rig has up to {MOST_PORTS}",
            addresses.len()
        ));
    }
    let addresses = addresses.iter().map(|text| Address::parse(text)).collect::<Result<Vec<_>, _>>();
    let addresses = addresses.map_err(|error| format!("--mavlink: {error}"))?;
    if addresses.is_empty() {
        return Ok(None);
    }
    Mavlink::open(&addresses, engines).map(Some).map_err(|error| format!("--mavlink: {error}"))
}

/// Opens the receiver of `--rc`, or of a script file.
fn radio(args: &Args, header: &Header) -> Result<Option<Radio>, RadioError> {
    let Some(text) = &header.rc else { return Ok(None) };
    let choice = Choice::parse(text)?;
    if choice.address.is_some() {
        for (given, option) in [(&args.script, "a script file"), (&args.save_script, "--save-script")] {
            if given.is_some() {
                return Err(RadioError::NotWith(option));
            }
        }
    }
    Radio::open(&choice).map(Some)
}

fn setup(
    args: &Args,
    header: &Header,
    scenario: Option<&'static Scenario>,
    described: &[String],
) -> Result<Setup, String> {
    let engines = engines::engines(described)?;
    let mut faults = match &header.faults {
        Some(text) => Faults::parse(text, &engines)?,
        None => Faults::default(),
    };
    let duration = header
        .duration
        .as_ref()
        .map(|text| quantity::duration(text).map_err(|error| format!("--duration: {error}")))
        .transpose()?;
    let panic_at = args.panic_at.as_deref().map(quantity::duration).transpose()?;
    let flown_by = match () {
        () if !args.mavlink.is_empty() || header.rc.is_some() => FlownBy::Outside,
        () if header.standby => FlownBy::PilotsInStandby,
        () => FlownBy::Pilots,
    };
    let mut plan = Plan::new(&engines, duration, flown_by, &mut faults)?;
    faults.check(&plan, &engines)?;
    if let Some(scenario) = scenario {
        plan.length = Some(scenario.length());
    }
    if header.silence {
        plan = plan.with_a_silence();
    }
    let details = args.capture.is_some();
    let mavlink = mavlink(&args.mavlink, &engines)?;
    let radio = radio(args, header).map_err(|error| error.to_string())?;
    Ok(Setup {
        engines,
        plan,
        faults,
        scenario,
        seed: header.seed,
        fast: args.fast,
        details,
        panic_at,
        mavlink,
        radio,
        valves: header.valves,
        speed: args.speed.unwrap_or(1),
        #[cfg(test)]
        uncommanded: Vec::new(),
    })
}
