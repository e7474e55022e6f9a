//! Runs the firmware in QEMU, with simulated ECUs on its UARTs: `cargo qemu`, `cargo qemu-test`.
//! `docs/qemu.md` describes what it shows and what it does not.

#![deny(unsafe_code)]

mod ecu;
mod image;
mod log;
mod machine;
mod verdict;

use clap::Parser;
use commands::qemu::{Arguments, Mode};
use jetlink_fw::config::ENGINES;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use crate::ecu::Attached;
use crate::image::Image;
use crate::log::Log;
use crate::machine::Machine;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let result = match arguments.mode {
        None => run(&arguments),
        Some(Mode::Test { limit }) => test(&arguments, Duration::from_secs(limit)),
        Some(Mode::Count) => count(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("error: {why}");
            ExitCode::FAILURE
        }
    }
}

/// Runs until Ctrl-C.
fn run(arguments: &Arguments) -> Result<(), String> {
    let version = machine::version(&arguments.qemu)?;
    let image = Image::build("board-qemu-mps2", arguments)?;
    println!("{version}; stop with Ctrl-C");
    let ecus = ENGINES.iter().enumerate().map(|(i, engine)| Attached::new(i, engine, ecu::Turbine::Real));
    let mut machine = Machine::start(arguments, &image, ecus.collect(), &[])?;
    let log = Log::follow(&image, machine.log(), |_| true)?;
    let status = machine.wait(None)?;
    log.finish();
    Err(format!("QEMU ended ({status})"))
}

/// Runs the trial and judges it.
fn test(arguments: &Arguments, limit: Duration) -> Result<(), String> {
    let version = machine::version(&arguments.qemu)?;
    let image = Image::build("trial", arguments)?;
    println!("{version}");
    let began = Instant::now();
    let ecus = ENGINES.iter().enumerate().map(|(i, engine)| Attached::new(i, engine, ecu::Turbine::Quick));
    let mut machine = Machine::start(arguments, &image, ecus.collect(), &[machine::ENDS_AT_RESET])?;
    println!("every engine is started, run and shut down: about 50 s; the log is shown if anything fails");
    let log = Log::follow(&image, machine.log(), |_| false)?;
    let ended = machine.wait(Some(limit));
    let ecus = machine.stop();
    let log = log.finish();

    println!();
    let mut faults = Vec::new();
    match ended {
        Ok(status) if status.success() => {}
        Ok(status) => faults.push(format!("the firmware reported a failure: QEMU ended with {status}")),
        Err(why) => faults.push(why),
    }
    faults.extend(verdict::of_log(&log));
    for ecu in &ecus {
        faults.extend(verdict::of_ecu(ecu));
    }
    let seconds = began.elapsed().as_secs_f64();
    println!("{}", verdict::report(&log, &ecus, &faults, seconds));
    if faults.is_empty() {
        Ok(())
    } else {
        Err(format!("FAIL after {seconds:.1} s, reasons: {}", faults.len()))
    }
}

/// Prints the instructions for a received byte, a frame and a reply. It needs no ECU: see the image's `count.rs`.
fn count(arguments: &Arguments) -> Result<(), String> {
    let version = machine::version(&arguments.qemu)?;
    let image = Image::build("count", arguments)?;
    println!("{version}");
    let first = count_once(arguments, &image, |line| line.message.starts_with("count: "))?;
    let second = count_once(arguments, &image, |_| false)?;
    let same = first.lines.len() == second.lines.len()
        && first.lines.iter().zip(&second.lines).all(|(first, second)| first.is_same(second));
    if first.lines.is_empty() || !same {
        return Err("a second run counted something else".into());
    }
    println!("a second run counted the same numbers");
    Ok(())
}

fn count_once(
    arguments: &Arguments,
    image: &Image,
    show: fn(&log::Line) -> bool,
) -> Result<log::Lines, String> {
    let mut machine = Machine::start(arguments, image, Vec::new(), &machine::COUNTING)?;
    let log = Log::follow(image, machine.log(), show)?;
    let status = machine.wait(Some(Duration::from_secs(60)))?;
    let lines = log.finish();
    if !status.success() {
        return Err(format!("QEMU ended with {status}"));
    }
    // A panic resets the firmware, which ends QEMU with status 0.
    match lines.lines.iter().find(|line| line.level == "ERROR") {
        Some(error) => Err(format!("the firmware's log has an error: {}", error.message)),
        None => Ok(lines),
    }
}
