//! `jetlink rig`: the node, with the firmware's own code, against simulated engines.

mod audit;
mod capture;
mod chronicle;
mod conditions;
mod context;
mod control;
mod csv;
mod disturbances;
mod ending;
mod engines;
mod faults;
mod fit;
mod frames;
mod limiter;
mod lines;
mod mavlink;
mod message;
mod node;
mod options;
mod out;
mod outcome;
mod output;
mod passing;
mod pilot;
mod plan;
mod play;
mod plot;
mod port;
mod quantity;
mod radio;
mod record;
mod report;
mod row;
mod sample;
mod scenario;
mod session;
mod show;
mod simulated;
mod size;
mod story;
mod summary;
mod tap;
mod title;
mod tour;
mod unshown;
mod view;
mod waiting;

pub use self::options::Args;

use self::capture::Capture;
use self::chronicle::{Chronicle, Subject};
use self::control::{Control, Live, Scripted, Unattended};
use self::csv::Csv;
use self::ending::{EndRequest, EndedBy};
use self::engines::Engine;
use self::lines::Lines;
use self::options::Order;
use self::out::{Out, Stream, reader_left};
use self::outcome::{End, Outcomes};
use self::output::{Kind, Problem, Wanted};
use self::play::script;
use self::plot::Plot;
use self::report::Report;
use self::show::{Ended, Files, Show, Shown};
use self::title::Title;
use self::tour::Tour;
use self::unshown::ShowError;
use self::view::model::Model;
use self::view::terminal::Screen;
use self::view::theme::Theme;
use embassy_time::{Duration, Instant};
use std::io::{self, IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::mpsc;

/// Messages that may wait for the screen before the session waits for it.
const MESSAGES: usize = 1000;
/// Columns of an output whose width is not known.
const USUAL_WIDTH: usize = size::USUAL.0 as usize;
/// Between two lines of one engine, in engine time.
const LINES_EVERY: Duration = Duration::from_secs(5);
/// The same with `--fast` on a terminal.
const LINES_EVERY_FAST: Duration = Duration::from_secs(30);

/// Runs the rig. Status 0: all is well; 1: something was not reached, missed or could not be written; 2: a
/// wrong option.
pub fn run(args: &Args) -> ExitCode {
    if args.list_scenarios {
        return list_scenarios();
    }
    let mut order = match options::order(args) {
        Ok(order) => order,
        Err(error) => {
            complain(&error);
            return ExitCode::from(2);
        }
    };
    if let Err(problem) = output::check(&wanted(args, &order)) {
        let (error, status) = match problem {
            Problem::Option(error) => (error, 2),
            Problem::File(error) => (error, 1),
        };
        complain(&error);
        return ExitCode::from(status);
    }
    order.notices.iter().for_each(|notice| complain(notice));
    match perform(args, &mut order) {
        Ok(status) => status,
        Err(error) => {
            complain(&error);
            ExitCode::FAILURE
        }
    }
}

/// The files that are to be written, and the script that must not be.
fn wanted(args: &Args, order: &Order) -> Vec<Wanted> {
    let file = |option, path: &Option<String>, kind| path.clone().map(|path| Wanted { option, path, kind });
    let names: Vec<&str> = order.setup.engines.iter().map(Engine::name).collect();
    // Without a name there is no folder.
    let captured = args.capture.iter().flat_map(|folder| match folder.as_str() {
        "" => vec![String::new()],
        folder => Capture::paths(folder, &names),
    });
    file("--script", &args.script, Kind::Read)
        .into_iter()
        .chain(file("--csv", &args.csv, Kind::Direct))
        .chain(file("--plot", &args.plot, Kind::Whole("svg")))
        .chain(file("--report", &args.report, Kind::Whole("html")))
        .chain(file("--save-script", &args.save_script, Kind::Direct))
        .chain(captured.map(|path| Wanted { option: "--capture", path, kind: Kind::InFolder }))
        .collect()
}

fn list_scenarios() -> ExitCode {
    let text: String =
        scenario::ALL.iter().map(|scenario| format!("{:<22}  {}\n", scenario.name, scenario.line)).collect();
    let out = Out { to: Stream::Stdout, ascii: false };
    match out.write(&text) {
        Err(error) if !reader_left(&error) => {
            complain(&out.cannot_write(&error));
            ExitCode::FAILURE
        }
        _ => ExitCode::SUCCESS,
    }
}

fn complain(error: &str) {
    // Nothing can be done if this cannot be written either.
    let _ = writeln!(io::stderr(), "jetlink rig: {error}");
}

/// Where the run is shown.
struct Place {
    out: Out,
    is_terminal: bool,
    /// A screen can be drawn on it.
    takes_screen: bool,
    theme: Theme,
}

impl Place {
    fn of(args: &Args, order: &Order) -> Self {
        let files = wanted(args, order);
        let to_stdout = files.iter().any(|file| waiting::is_stdout(&file.path));
        let is_terminal = !to_stdout && io::stdout().is_terminal();
        let theme = Theme::of(args.ascii, |name| std::env::var(name).ok());
        let to = if to_stdout { Stream::Stderr } else { Stream::Stdout };
        // Rows in the middle of a screen would spoil both.
        let rows_on_terminal = files.iter().any(|file| output::is_terminal(&file.path));
        Self {
            out: Out { to, ascii: args.ascii || is_terminal && theme.ascii },
            is_terminal,
            takes_screen: is_terminal && !is_dumb() && !rows_on_terminal,
            theme,
        }
    }
}

fn subject(engine: &Engine) -> Subject {
    let egt_limit = engine.config.supervision.limits.over_temperature.at;
    Subject {
        name: engine.name(),
        caption: engine.caption(),
        max_rpm: simulated::parameters(engine).max_rpm,
        egt_limit: egt_limit.map(|limit| f64::from(limit.tenths()) / 10.0),
        by_rpm: engine.by_rpm(),
    }
}

/// Opens the files that are written during the run.
fn files(args: &Args, order: &Order, names: &[&'static str], end: &EndRequest) -> Result<Files, String> {
    let title = Title::of(&order.setup, &order.header, args.script.as_deref());
    let subjects = order.setup.engines.iter().map(subject);
    let chronicle =
        (args.plot.is_some() || args.report.is_some()).then(|| Chronicle::new(title, subjects.collect()));
    let plot = args.plot.as_deref().map(|path| Plot::new(path, args.dark, end));
    let capture = args.capture.as_deref().map(|folder| Capture::create(folder, names, end)).transpose()?;
    // Last, as this deletes its previous contents.
    let csv = args.csv.as_deref().map(|path| Csv::create(path, end)).transpose()?;
    Ok(Files { names: names.to_vec(), csv, chronicle, plot, capture })
}

/// The screen or the lines, and who steers the run there.
fn stage(
    args: &Args,
    order: &mut Order,
    names: &[&'static str],
    place: &Place,
    end: &EndRequest,
) -> (Shown, Box<dyn Control>) {
    let script = order.script.take();
    let (requests, wanted_live) = mpsc::channel();
    let screen = (place.takes_screen && !order.setup.fast && !args.plain).then(|| {
        let setup = &order.setup;
        let mut model = Model::new(&setup.engines, setup.plan.length, setup.scenario.is_some());
        model.transmitter = setup.radio.as_ref().is_some_and(|radio| radio.transmitter().is_some());
        Screen::enter(model, place.theme, requests, end.clone())
    });
    match (screen, script) {
        (Some(Ok(screen)), script) => {
            order.setup.details = true;
            let tour = order.header.silence.then(Tour::default);
            let live = Live::new(wanted_live, end.clone(), tour);
            let control = match script {
                Some((actions, over)) => live.with_script(Scripted::new(actions, over)),
                None => live,
            };
            (Shown::Screen(Box::new(screen)), Box::new(control))
        }
        // A terminal that cannot be drawn on can still be written to.
        (Some(Err(_)) | None, script) => {
            let every = if place.takes_screen && order.setup.fast { LINES_EVERY_FAST } else { LINES_EVERY };
            let control: Box<dyn Control> = match script {
                Some((actions, over)) => Box::new(Scripted::new(actions, over)),
                None => Box::new(Unattended),
            };
            let width = place.is_terminal.then(terminal_width);
            (Shown::Lines(Lines::new(place.out, names.to_vec(), every, width)), control)
        }
    }
}

/// The whole run, to its exit status.
fn perform(args: &Args, order: &mut Order) -> Result<ExitCode, String> {
    let end = EndRequest::by_signals()?;
    let names: Vec<&'static str> = order.setup.engines.iter().map(Engine::name).collect();
    let about =
        format!("jetlink {}, seed {}; everything is simulated", env!("CARGO_PKG_VERSION"), order.setup.seed);
    let report = args.report.as_deref().map(|path| Report::new(path, about, &end));
    let files = match (files(args, order, &names, &end), end.requested()) {
        (Ok(files), _) => files,
        // Nothing has run yet: it was ended while waiting for the reader of a FIFO.
        (Err(error), Some(by)) => {
            complain(&error);
            return Ok(ExitCode::from(by.status()));
        }
        (Err(error), None) => return Err(error),
    };
    let place = Place::of(args, order);
    let Place { out, is_terminal, theme, .. } = place;
    // Last of all: from here on the terminal's state may change.
    let (shown, mut control) = stage(args, order, &names, &place, &end);
    let show = Show { shown, files };

    // Whatever happens in the scope, it waits for the screen and the files.
    let (outcomes, shown) = std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::sync_channel(MESSAGES);
        let shower = scope.spawn(move || show.run(&receiver));
        let continues = |message| sender.send(message).is_ok() && end.requested().is_none();
        let outcomes = session::run(&order.setup, &mut *control, continues);
        drop(sender);
        (outcomes, shower.join().unwrap_or_else(|_| Ended::panicked()))
    });

    // A request at the last moment has no effect.
    let ended_by = end
        .requested()
        .filter(|by| outcomes.end == End::Interrupted || (outcomes.is_played() && *by != EndedBy::Key));
    let problems = summary::problems(&outcomes);
    let width = if is_terminal { terminal_width() } else { USUAL_WIDTH };
    let mut text = summary::text(&outcomes, &problems, ended_by, width);
    if is_terminal {
        text = summary::on_screen(&text, width, theme.mark());
    }
    // With the terminal or the reader gone, nobody reads.
    let nobody_reads = end.requested() == Some(EndedBy::HangUp)
        || matches!(&shown.error, Some(ShowError::Screen(error)) if reader_left(error));
    let reported = match (report, shown.chronicle) {
        (Some(report), Some(chronicle)) => report.finish(&chronicle, &outcomes, &problems, ended_by),
        _ => Ok(()),
    };
    let saved = match save_script(args, order, &outcomes, &end) {
        Ok(saved) => {
            if let Some(saved) = saved {
                text += &format!("To play it again: cargo rig --script {} --fast\n", output::quoted(&saved));
            }
            Ok(())
        }
        Err(Unsaved { error, script }) => {
            // What was played by hand cannot be repeated without it.
            if outcomes.is_played() {
                text += &format!("\nThe script file of this run:\n{script}");
            }
            Err(error)
        }
    };
    // Even if something could not be written, the known results are printed, unless nobody can read them.
    let printed = match &shown.error {
        Some(ShowError::Screen(_)) => Ok(()),
        Some(ShowError::File(_) | ShowError::Panicked) | None => {
            out.write(&format!("{}{text}", shown.events))
        }
    };
    let wrong = [
        match shown.error {
            Some(ShowError::Screen(error)) if !nobody_reads => Err(out.cannot_write(&error)),
            Some(ShowError::File(error)) => Err(error),
            Some(ShowError::Panicked) => Err("the screen's thread has panicked".to_owned()),
            Some(ShowError::Screen(_)) | None => Ok(()),
        },
        reported,
        saved,
        printed.or_else(|error| {
            if nobody_reads || reader_left(&error) { Ok(()) } else { Err(out.cannot_write(&error)) }
        }),
    ];
    let wrong: Vec<String> = wrong.into_iter().filter_map(Result::err).collect();
    wrong.iter().for_each(|error| complain(error));
    let by_signal = end.requested().filter(|by| *by != EndedBy::Key && ended_by.is_some());
    Ok(match by_signal {
        _ if !problems.is_empty() || !wrong.is_empty() => ExitCode::FAILURE,
        Some(by) => ExitCode::from(by.status()),
        None => ExitCode::SUCCESS,
    })
}

/// A script file that could not be written.
struct Unsaved {
    /// Why.
    error: String,
    /// Its text.
    script: String,
}

/// Writes the actions to the requested file; without one, and if a key has acted, to a new file.
fn save_script(
    args: &Args,
    order: &Order,
    outcomes: &Outcomes,
    end: &EndRequest,
) -> Result<Option<PathBuf>, Unsaved> {
    // Nothing but an end ends a run without pilots.
    let has_end = outcomes.is_played() || outcomes.end == End::Over || order.setup.is_commanded();
    let over = has_end.then(|| Instant::MIN + outcomes.length);
    let text = script::text(&order.header, &order.setup.engines, &outcomes.actions, over);
    let saved = match &args.save_script {
        Some(path) => match waiting::write(path, &text, end) {
            Ok(()) => Ok(Some(PathBuf::from(path))),
            Err(error) => Err(output::cannot_write(path, &error)),
        },
        None if outcomes.by_key && order.setup.plays_again() => {
            let name = format!("jetlink-rig-{}", std::process::id());
            output::write_new(&std::env::temp_dir(), &name, "txt", &text).map(Some)
        }
        None => Ok(None),
    };
    saved.map_err(|error| Unsaved { error, script: text })
}

/// Columns of the terminal.
fn terminal_width() -> usize {
    size::of_terminal().map_or(USUAL_WIDTH, |(width, _)| width.into())
}

/// Whether the terminal reports that it takes no control sequences, or on Unix what it is.
fn is_dumb() -> bool {
    let term = std::env::var_os("TERM").filter(|term| !term.is_empty());
    term.map_or(cfg!(unix), |term| term == "dumb")
}
