//! `jetlink rig`: the node, the very code of the firmware, against simulated engines.

mod audit;
mod csv;
mod desk;
mod ending;
mod engines;
mod faults;
mod limiter;
mod lines;
mod node;
mod out;
mod output;
mod pilot;
mod plan;
mod plot;
mod quantity;
mod row;
mod sample;
mod scenario;
mod session;
mod show;
mod simulated;
mod summary;
mod table;

use self::csv::Csv;
use self::ending::{EndRequest, EndedBy};
use self::engines::Engine;
use self::faults::Faults;
use self::lines::Lines;
use self::out::{Out, reader_left};
use self::output::{Problem, Wanted};
use self::plan::Plan;
use self::plot::{Plot, Subject};
use self::scenario::Scenario;
use self::session::{End, Setup};
use self::show::{Screen, Show, ShowError};
use self::table::Table;
use embassy_time::Duration;
use std::io::{self, IsTerminal, Write};
use std::process::ExitCode;
use std::sync::mpsc;

/// Messages that may wait for the screen before the session waits for it.
const MESSAGES: usize = 1000;
/// Between two lines of one engine, in engine time.
const LINES_EVERY: Duration = Duration::from_secs(5);
/// The same with `--fast` on a terminal.
const LINES_EVERY_FAST: Duration = Duration::from_secs(30);

const HELP: &str = "\
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
  commands rejected    refused by an interlock or by the rules of sources. A start that waits for another engine is
                       none, nor is what was commanded while the node still listened after its own start
  unsolicited commands frames on the wire that no order in force allows
  worst cadence error  ZK: the node sends in fixed send slots. An emergency stop, and the frame right behind a change
                       of the control mode, are sent ahead of their slot and do not count

Engines:
  --engine name=left,ecu=amt,engine=olympus,baud=2400
      engine: mercury, pegasus, olympus (default), titan, nike, lynx
      baud: default 2400
  --engine name=centre,ecu=zk,version=4,baud=9600,stop=1,rate=20,mode=throttle
      version: 1 to 5 (default 5); baud: default 9600; stop: 1 (default) or 2; rate: 20 (default), 50, 100 Hz
      mode: throttle (default), split (switch in a command of its own), rpm; the last two from version 4
  Baud rates are 2400, 4800, 9600, 19200, 38400, 57600, 115200. Up to 8 engines. Without --engine there are
  two AMT engines at 2400 baud and two ZK engines, one at 9600 baud with version 4, one at 115200 baud with
  version 5 that is commanded by rpm.

Faults, a list with commas:
  light, heavy          sets of the following
  noise=SHARE           of the bytes arrive with inverted bits (0.02 is 2 %)
  lose=, add=, framing= share of the bytes that are lost, that another one follows, that break their frame
  jitter=TIME, delay=TIME   bytes arrive later, at random by up to, or always by this (3ms)
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
  expected events, and judges by what was on the wires and what the simulated engines did whether they occurred.

CSV columns, a row for each engine every 0.1 s, empty where the ECU has reported nothing for 2 s:
  t_s, engine, phase (of the run), state (as the ECU names it), rpm, egt_c, command (standby or run),
  demand_throttle_pct, demand_rpm, throttle_pct (as the ECU reports it), link, frames (received), sent, missed
  (replies and send slots, by the node's count), decode_errors, rejected (commands, see the summary),
  engine_state (in plain words), rules (the source in control), waiting (the source about to take over), loss (stage
  of the loss of the source), limited (a limit has lowered the demand), armed, order (of the node),
  wire_throttle_pct and wire_rpm (last sent), faults (as the ECU reports them), events (since the row before,
  separated by |)
  The file is flushed every second: `tail -f`, a FIFO and /dev/stdout work. Text goes to the standard error then.

Exit status:
  0  no reply window was missed on a clean line, and every engine reached its targets; with --scenario: all expected
     events occurred
  1  otherwise, or a file could not be written
  2  a wrong option
  A run that is ended early completes its files and prints the summary so far. That is no failure: the status is
  0 after q, 130 after Ctrl-C, 143 after SIGTERM, 129 after SIGHUP, and 1 only if something had gone wrong before.

Time:
  All is simulated in virtual time. Without --fast that is held back to real time. A computer that is too busy
  delays the run and does not change it: the same seed gives the same result, live and with --fast.";

/// Arguments of `jetlink rig`.
#[derive(clap::Args, Debug)]
#[command(after_long_help = HELP, after_help = "--help explains all, --engine and --faults in full.")]
pub struct Args {
    /// An engine and its ECU; repeatable
    #[arg(long = "engine", value_name = "DESCRIPTION")]
    engines: Vec<String>,

    /// As quick as the machine allows, instead of in real time
    #[arg(long)]
    fast: bool,

    /// Length of the run in engine time, for example 300s, 10m or 6h; it is the running phase that changes
    #[arg(long, value_name = "TIME")]
    duration: Option<String>,

    /// Start no engine: stay in standby for --duration (default 10s) and judge the links
    #[arg(long)]
    standby: bool,

    /// All that is random comes from this number
    #[arg(long, value_name = "NUMBER", default_value = "1")]
    seed: String,

    /// What goes wrong, for example heavy or noise=0.02,lose=0.01
    #[arg(long, value_name = "LIST")]
    faults: Option<String>,

    /// Write all samples to this file
    #[arg(long, value_name = "FILE")]
    csv: Option<String>,

    /// Draw rpm, EGT and demand over time into this file
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<String>,

    /// For the test of what a panic leaves behind
    #[arg(long, value_name = "TIME", hide = true)]
    panic_at: Option<String>,

    /// Play something that goes wrong, and judge what happens
    #[arg(long, value_name = "NAME", conflicts_with_all = ["engines", "duration", "standby", "faults"])]
    scenario: Option<String>,

    /// Explain each scenario in a line
    #[arg(long)]
    list_scenarios: bool,
}

/// Runs the rig. Status 0: all is well; 1: something was not reached, missed or could not be written; 2: a
/// wrong option.
pub fn run(args: Args) -> ExitCode {
    if args.list_scenarios {
        return list_scenarios();
    }
    let setup = match setup(&args) {
        Ok(setup) => setup,
        Err(error) => {
            complain(&error);
            return ExitCode::from(2);
        }
    };
    if let Err(problem) = output::check(&wanted(&args)) {
        let (error, status) = match problem {
            Problem::Option(error) => (error, 2),
            Problem::File(error) => (error, 1),
        };
        complain(&error);
        return ExitCode::from(status);
    }
    match perform(&args, &setup) {
        Ok(status) => status,
        Err(error) => {
            complain(&error);
            ExitCode::FAILURE
        }
    }
}

/// The files that are to be written.
fn wanted(args: &Args) -> Vec<Wanted<'_>> {
    let csv = args.csv.as_deref().map(|path| Wanted { option: "--csv", path, ending: "" });
    let plot = args.plot.as_deref().map(|path| Wanted { option: "--plot", path, ending: "svg" });
    csv.into_iter().chain(plot).collect()
}

fn list_scenarios() -> ExitCode {
    let text: String =
        scenario::ALL.iter().map(|scenario| format!("{:<22}  {}\n", scenario.name, scenario.line)).collect();
    match Out::Stdout.write(&text) {
        Err(error) if !reader_left(&error) => {
            complain(&Out::Stdout.cannot_write(&error));
            ExitCode::FAILURE
        }
        _ => ExitCode::SUCCESS,
    }
}

fn complain(error: &str) {
    // Nothing can be done if this cannot be written either.
    let _ = writeln!(io::stderr(), "jetlink rig: {error}");
}

fn setup(args: &Args) -> Result<Setup, String> {
    let scenario = args.scenario.as_deref().map(Scenario::named).transpose()?;
    let described: Vec<String> = match scenario {
        Some(scenario) => scenario.engines.iter().map(|&text| text.to_owned()).collect(),
        None => args.engines.clone(),
    };
    let engines = engines::engines(&described)?;
    let seed = args
        .seed
        .parse()
        .map_err(|_| format!("--seed: `{}` is not a whole number from 0 to {}", args.seed, u64::MAX))?;
    let mut faults = match &args.faults {
        Some(text) => Faults::parse(text, &engines)?,
        None => Faults::default(),
    };
    let duration = args
        .duration
        .as_ref()
        .map(|text| quantity::duration(text).map_err(|error| format!("--duration: {error}")))
        .transpose()?;
    let panic_at = args.panic_at.as_deref().map(quantity::duration).transpose()?;
    let mut plan = Plan::new(&engines, duration, args.standby, &mut faults)?;
    faults.check(&plan, &engines)?;
    if let Some(scenario) = scenario {
        plan.length = scenario.length();
    }
    Ok(Setup { engines, plan, faults, scenario, seed, fast: args.fast, panic_at })
}

/// The whole run, to its exit status.
fn perform(args: &Args, setup: &Setup) -> Result<ExitCode, String> {
    let end = EndRequest::by_signals()?;
    let names: Vec<&'static str> = setup.engines.iter().map(Engine::name).collect();
    let csv = args.csv.as_deref().map(Csv::create).transpose()?;
    let title = match setup.scenario {
        Some(scenario) => format!("{}: {}", scenario.name, scenario.line),
        None => format!("jetlink rig, seed {}", setup.seed),
    };
    let subjects = setup.engines.iter().map(|engine| Subject {
        caption: engine.caption(),
        max_rpm: simulated::parameters(engine).max_rpm,
        by_rpm: engine.by_rpm(),
    });
    let plot = args.plot.as_deref().map(|path| Plot::create(path, subjects.collect(), title)).transpose()?;
    // The last of all: from here on the terminal may not be as it was.
    let out =
        if wanted(args).iter().any(|file| output::is_stdout(file.path)) { Out::Stderr } else { Out::Stdout };
    let on_terminal = out == Out::Stdout && io::stdout().is_terminal() && !is_dumb();
    let table =
        (on_terminal && !setup.fast).then(|| Table::new(names.clone(), setup.plan.length, end.clone()));
    let screen = match table {
        Some(Ok(table)) => Screen::Table(Box::new(table)),
        // A terminal that cannot be drawn on can still be written to.
        Some(Err(_)) | None => {
            let every = if on_terminal && setup.fast { LINES_EVERY_FAST } else { LINES_EVERY };
            Screen::Lines(Lines::new(out, names.clone(), every))
        }
    };
    let show = Show { names, screen, csv, plot };

    // Whatever happens in the scope, it waits for the screen and the files.
    let (outcomes, shown) = std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::sync_channel(MESSAGES);
        let shower = scope.spawn(move || show.run(&receiver));
        let go_on = |message| sender.send(message).is_ok() && end.requested().is_none();
        let outcomes = session::run(setup, go_on);
        drop(sender);
        (outcomes, shower.join().unwrap_or(Err(ShowError::Panicked)))
    });

    // A request in the last moment ends nothing any more.
    let ended_by = end.requested().filter(|_| outcomes.end == End::Interrupted);
    let problems = summary::problems(&outcomes);
    let text = summary::text(&outcomes, &problems, ended_by);
    // With the terminal or the reader gone, nobody reads.
    let nobody_reads = ended_by == Some(EndedBy::HangUp)
        || matches!(&shown, Err(ShowError::Screen(error)) if reader_left(error));
    let printed = match &shown {
        Err(ShowError::Screen(_) | ShowError::File(_)) => Ok(()),
        Ok(()) | Err(ShowError::Panicked) => out.write(&text),
    };
    match shown {
        Err(ShowError::File(error)) => return Err(error),
        Err(ShowError::Screen(error)) if !nobody_reads => return Err(out.cannot_write(&error)),
        Err(ShowError::Panicked) => return Err("the screen's thread has panicked".to_owned()),
        Ok(()) | Err(ShowError::Screen(_)) => {}
    }
    printed.or_else(|error| {
        if nobody_reads || reader_left(&error) { Ok(()) } else { Err(out.cannot_write(&error)) }
    })?;
    Ok(match ended_by {
        _ if !problems.is_empty() => ExitCode::FAILURE,
        Some(by) => ExitCode::from(by.status()),
        None => ExitCode::SUCCESS,
    })
}

/// Whether the terminal says of itself that it takes no control sequences.
fn is_dumb() -> bool {
    std::env::var_os("TERM").is_some_and(|term| term == "dumb")
}
