//! Runs the firmware in QEMU, with simulated ECUs on its UARTs: `cargo qemu`, `cargo qemu-test`.
//! `docs/qemu.md` says what can be seen there and what cannot.

#![deny(unsafe_code)]

mod count;
mod ecu;
mod image;
mod log;
mod machine;
mod verdict;

use clap::{Parser, Subcommand};
use jetlink::config::ENGINES;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use crate::ecu::Attached;
use crate::image::Image;
use crate::log::Log;
use crate::machine::{Machine, Pace};

#[derive(Parser)]
#[command(name = "cargo qemu", about = "Runs the firmware in QEMU, with simulated ECUs on its UARTs")]
struct Arguments {
    /// QEMU's program.
    #[arg(long, default_value = "qemu-system-arm", global = true)]
    qemu: String,
    /// The firmware commands its engines by itself, in a fixed cycle.
    #[arg(long)]
    demo: bool,
    /// What QEMU connects the fifth UART with, which is kept for MAVLink, in the words of QEMU's -serial.
    #[arg(long, value_name = "DEVICE", default_value = "null", global = true)]
    telemetry: String,
    #[command(subcommand)]
    mode: Option<Mode>,
}

#[derive(Subcommand)]
enum Mode {
    /// Starts every engine, runs it, shuts it down and ends, with exit status 0 if all went well.
    Test {
        /// The most it may take, in seconds.
        #[arg(long, default_value_t = 180)]
        limit: u64,
    },
    /// Counts instructions: for a received byte, a frame and a reply.
    Count {
        /// How long to listen, in seconds.
        #[arg(long, default_value_t = 20)]
        seconds: u64,
    },
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let result = match arguments.mode {
        None => run(&arguments),
        Some(Mode::Test { limit }) => test(&arguments, Duration::from_secs(limit)),
        Some(Mode::Count { seconds }) => count::count(&arguments, Duration::from_secs(seconds)),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("error: {why}");
            ExitCode::FAILURE
        }
    }
}

/// Runs until somebody ends it.
fn run(arguments: &Arguments) -> Result<(), String> {
    let version = machine::version(&arguments.qemu)?;
    let image =
        Image::build(if arguments.demo { &["board-qemu-mps2", "demo"] } else { &["board-qemu-mps2"] })?;
    println!("QEMU {version}; Ctrl-C ends it");
    let ecus = ENGINES.iter().enumerate().map(|(i, engine)| Attached::new(i, engine, ecu::Turbine::Real));
    let mut machine = Machine::start(arguments, version, &image, ecus.collect(), Pace::Host)?;
    let log = Log::follow(&image, machine.log())?;
    let status = machine.wait(None)?;
    log.finish();
    Err(format!("QEMU ended ({status})"))
}

/// The bounded run.
fn test(arguments: &Arguments, limit: Duration) -> Result<(), String> {
    let version = machine::version(&arguments.qemu)?;
    let image = Image::build(&["trial"])?;
    println!("QEMU {version}");
    let began = Instant::now();
    let ecus = ENGINES.iter().enumerate().map(|(i, engine)| Attached::new(i, engine, ecu::Turbine::Quick));
    let mut machine = Machine::start(arguments, version, &image, ecus.collect(), Pace::Host)?;
    let log = Log::follow(&image, machine.log())?;
    let ended = machine.wait(Some(limit));
    let ecus = machine.stop();
    let log = log.finish();

    println!();
    let mut faults = Vec::new();
    match ended {
        Ok(status) if status.success() => {}
        Ok(status) => faults.push(format!("the firmware: QEMU ended with {status}")),
        Err(why) => faults.push(why),
    }
    faults.extend(verdict::of_log(&log));
    for ecu in &ecus {
        println!("{}", verdict::summary(ecu));
        faults.extend(verdict::of_ecu(ecu));
    }
    let seconds = began.elapsed().as_secs_f64();
    if faults.is_empty() {
        println!("passed in {seconds:.1} s: {} log lines, {} engines", log.lines.len(), ecus.len());
        Ok(())
    } else {
        for fault in &faults {
            println!("- {fault}");
        }
        Err(format!("failed after {seconds:.1} s, for {} reasons", faults.len()))
    }
}
