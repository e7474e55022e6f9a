//! `jetlink rig`: the node, the very code of the firmware, against simulated engines.

mod audit;
mod desk;
mod engines;
mod faults;
mod lines;
mod pilot;
mod plan;
mod quantity;
mod row;
mod sample;
mod session;
mod show;
mod simulated;
mod summary;

use self::faults::Faults;
use self::lines::Lines;
use self::plan::Plan;
use self::session::Setup;
use self::show::{Screen, Show, lines_every};
use std::io::{self, IsTerminal, Write};
use std::process::ExitCode;
use std::sync::mpsc;

/// Messages that may wait for the screen before the session waits for it.
const MESSAGES: usize = 1000;

/// Arguments of `jetlink rig`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// An engine and its ECU (repeatable); see below
    #[arg(long = "engine", value_name = "DESCRIPTION")]
    engines: Vec<String>,

    /// Virtual time: as quick as the machine allows, and the same output for the same seed
    #[arg(long)]
    fast: bool,

    /// Length of the run in engine time, for example 300s or 10m; stretches or shortens the running phase
    #[arg(long, value_name = "TIME")]
    duration: Option<String>,

    /// Start no engine: stay in standby for --duration (default 10s) and judge the links only
    #[arg(long)]
    standby: bool,

    /// All that is random comes from this number
    #[arg(long, value_name = "NUMBER", default_value = "1")]
    seed: String,

    /// What goes wrong; see below
    #[arg(long, value_name = "LIST")]
    faults: Option<String>,
}

/// Runs the rig. Status 0: all is well; 1: something was not reached, missed or could not be written; 2: a
/// wrong option.
pub fn run(args: Args) -> ExitCode {
    let setup = match setup(&args) {
        Ok(setup) => setup,
        Err(error) => {
            complain(&error);
            return ExitCode::from(2);
        }
    };
    match perform(&setup) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            complain(&error);
            ExitCode::FAILURE
        }
    }
}

fn complain(error: &str) {
    // Nothing can be done if this cannot be written either.
    let _ = writeln!(io::stderr(), "jetlink rig: {error}");
}

fn setup(args: &Args) -> Result<Setup, String> {
    let engines = engines::engines(&args.engines)?;
    let seed = args
        .seed
        .parse()
        .map_err(|_| format!("--seed: `{}` is no whole number from 0 to {}", args.seed, u64::MAX))?;
    let mut faults = match &args.faults {
        Some(text) => Faults::parse(text, &engines)?,
        None => Faults::default(),
    };
    let duration = args
        .duration
        .as_ref()
        .map(|text| quantity::duration(text).map_err(|error| format!("--duration: {error}")))
        .transpose()?;
    let plan = Plan::new(&engines, duration, args.standby, &mut faults)?;
    Ok(Setup { engines, plan, faults, seed, fast: args.fast })
}

/// Whether all went well.
fn perform(setup: &Setup) -> Result<bool, String> {
    let names: Vec<&'static str> = setup.engines.iter().map(engines::Engine::name).collect();
    let on_terminal = io::stdout().is_terminal();
    let screen = Screen::Lines(Lines::new(names, lines_every(setup.fast && on_terminal)));
    let show = Show { screen };

    let (sender, receiver) = mpsc::sync_channel(MESSAGES);
    let shower = std::thread::spawn(move || show.run(&receiver));
    let outcomes = session::run(setup, |message| sender.send(message).is_ok());
    drop(sender);
    let shown = shower.join().map_err(|_| "the screen's thread has panicked".to_owned())?;
    let _show = shown?;

    let problems = summary::problems(&outcomes);
    let text = summary::text(&outcomes, &problems);
    io::stdout()
        .write_all(text.as_bytes())
        .map_err(|error| format!("cannot write to the standard output: {error}"))?;
    Ok(problems.is_empty())
}
