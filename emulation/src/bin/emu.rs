//! `cargo emu`, `cargo emu-run`, `cargo emu-record` and `cargo emu-compare`: builds the firmware's images, then runs the
//! tests on them, one of them interactively, or the four runs of a recording.

use clap::Parser;
use commands::emu::Call;
use emulation::image::folder;
use emulation::recording::{Comparison, MOST_SHIFT, NamedRun, RUNS, Recording};
use emulation::{BOARDS, Board, Image, Run};
use rigless::chip::uart::TcpPeer;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

/// The name of an image on the command line: its feature.
fn name(image: Image) -> &'static str {
    image.feature().unwrap_or(commands::emu::RELEASE)
}

fn main() -> ExitCode {
    let result = match Call::parse() {
        Call::Test { filters } => test(&filters),
        Call::Run { board, image, tcp, capture } => run(&board, &image, tcp, capture.as_deref()),
        Call::Record { folder } => record(&folder),
        Call::Compare { folder } => compare(&folder),
        Call::Build => build_all(),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(sentence) => {
            eprintln!("{sentence}");
            ExitCode::FAILURE
        }
    }
}

/// The project's root.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("emulation/ lies in the project")
}

fn cargo() -> Command {
    // Cargo sets this for the programs that it runs.
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

/// Runs a command that reports its own errors.
fn succeed(command: &mut Command, what: &str) -> Result<(), String> {
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(_) => Err(format!("{what} failed.")),
        Err(error) => Err(format!("{what} did not start: {error}.")),
    }
}

/// Builds these images, one after the other, and shows the progress.
fn build_each(images: &[(&Board, Image)]) -> Result<(), String> {
    images.iter().enumerate().try_for_each(|(i, &(board, image))| {
        print!("image {} of {}: ", i + 1, images.len());
        build(board, image)
    })
}

/// Builds one image as users do, with `cargo fw`, and copies it.
fn build(board: &Board, image: Image) -> Result<(), String> {
    let mut features = format!("board-{}", board.name);
    if let Some(feature) = image.feature() {
        features = format!("{features},{feature}");
    }
    println!("cargo fw {features}");
    let mut build = cargo();
    build.current_dir(root()).args(["fw", &features]);
    // A person sees the progress of a first build; a log gets no line for each package.
    if !std::io::stderr().is_terminal() {
        build.arg("--quiet");
    }
    succeed(&mut build, &format!("`cargo fw {features}`"))?;

    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from);
    let built = root().join(target).join("thumbv7em-none-eabihf/release/jetlink-fw");
    let copy = image.path(board);
    let copied = std::fs::create_dir_all(folder()).and_then(|()| std::fs::copy(&built, &copy));
    copied
        .map_err(|error| format!("{} cannot be copied to {}: {error}.", built.display(), copy.display()))?;
    Ok(())
}

fn build_all() -> Result<(), String> {
    let images: Vec<_> =
        BOARDS.into_iter().flat_map(|board| Image::of(board).map(move |image| (board, image))).collect();
    build_each(&images)
}

fn test(filters: &[String]) -> Result<(), String> {
    build_all()?;
    let mut tests = cargo();
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
    tests.arg("test").arg("--manifest-path").arg(manifest).args(["--tests", "--"]).args(filters);
    // Each test runs two boards or more, in a thread each.
    tests.env("RUST_TEST_THREADS", std::env::var("RUST_TEST_THREADS").unwrap_or_else(|_| "2".to_string()));
    succeed(&mut tests, "A test")?;
    if let Ok(table) = std::fs::read_to_string(folder().join("turnaround.md")) {
        println!("From the last stop bit of an AMT frame to the first start bit of the reply:\n\n{table}");
    }
    Ok(())
}

fn run(board: &str, image: &str, tcp: u16, capture: Option<&Path>) -> Result<(), String> {
    let board = Board::by_name(board).ok_or_else(|| format!("There is no board \"{board}\"."))?;
    let image = Image::ALL.into_iter().find(|one| name(*one) == image);
    let image = image.ok_or("There is no such image.")?;
    build(board, image)?;
    let peer = TcpPeer::listen(tcp).map_err(|error| format!("TCP port {tcp} cannot be opened: {error}."))?;
    let mut run = Run::new(board, image).engines();
    if let Some(folder) = capture {
        let written = run.capture(folder);
        run = written.map_err(|error| format!("{} cannot be written: {error}.", folder.display()))?;
    }
    println!("{} with an ECU on:", board.title);
    for engine in emulation::engines::of(board, image) {
        println!("  {}: {}, {}, {} baud", engine.port, engine.name, engine.config(), engine.line.baud);
    }
    println!("{}, the telemetry UART: 127.0.0.1:{tcp}. Ctrl-C ends.\n", board.telemetry.name);
    run.tcp(board.telemetry.name, peer).live();
    Ok(())
}

/// Plays the four runs, two at a time.
fn play() -> Result<Vec<(&'static NamedRun, Recording)>, String> {
    let mut images: Vec<_> = RUNS.iter().map(|run| (run.board, run.image)).collect();
    images.sort_by_key(|(board, _)| board.name);
    images.dedup_by_key(|(board, image)| (board.name, *image));
    build_each(&images)?;
    let mut recordings = Vec::new();
    for pair in RUNS.chunks(2) {
        let played = std::thread::scope(|scope| {
            let threads: Vec<_> = pair.iter().map(|run| scope.spawn(|| run.record())).collect();
            threads.into_iter().map(|thread| thread.join().expect("a run that ends")).collect::<Vec<_>>()
        });
        for (run, recording) in pair.iter().zip(played) {
            let recording = recording?;
            println!("{}: {} bytes", run.name, recording.bytes());
            recordings.push((run, recording));
        }
    }
    Ok(recordings)
}

fn record(folder: &Path) -> Result<(), String> {
    let error = |error: std::io::Error| format!("{} cannot be written: {error}.", folder.display());
    std::fs::create_dir_all(folder).map_err(error)?;
    for (run, recording) in play()? {
        std::fs::write(folder.join(run.file()), run.text_of(&recording)).map_err(error)?;
    }
    Ok(())
}

fn compare(folder: &Path) -> Result<(), String> {
    // Check this before anything takes a minute.
    let mut before = Vec::new();
    for run in &RUNS {
        let path = folder.join(run.file());
        let text = std::fs::read_to_string(&path)
            .map_err(|error| format!("{} cannot be read: {error}.", path.display()))?;
        before.push(Recording::parse(&text).map_err(|error| format!("{}: {error}.", path.display()))?);
    }
    let mut same = true;
    for ((run, now), before) in play()?.iter().zip(&before) {
        let comparison = Comparison::of(before, now);
        same &= comparison.is_same();
        match &comparison.difference {
            Some(difference) => println!("{}: DIFFERENT at {difference}", run.name),
            None => println!("{}: the same {} bytes", run.name, now.bytes()),
        }
        match comparison.shift {
            0 => println!("    at the same times"),
            us @ ..=MOST_SHIFT => println!("    largest shift {us} us, {}", comparison.shifted),
            us => println!("    largest shift {us} us, MORE THAN {MOST_SHIFT} us, {}", comparison.shifted),
        }
    }
    if same { Ok(()) } else { Err("What is sent has changed.".into()) }
}
