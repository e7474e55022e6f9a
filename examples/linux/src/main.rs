//! One engine on a serial port of a computer: shows what its ECU reports, and keeps it in standby.
//!
//! `cargo run -- /dev/ttyUSB0` for a ZK ECU at 9600 baud. A computer may stall for longer than the 9 ms that an AMT reply
//! has to begin in, so this is for a bench without fuel: an engine belongs to a board.

use embedded_io_adapters::tokio_1::FromTokio;
use jetlink::channel::{Channel, Source};
use jetlink::command::{Command, Origin};
use jetlink::config::{EngineConfig, check};
use jetlink::ecu::zk::codec::Rate;
use jetlink::line::Line;
use jetlink::runner::LineErrors;
use std::process::ExitCode;
use std::time::Duration;
use tokio_serial::SerialPortBuilderExt;

const ENGINE: EngineConfig = EngineConfig::zk("engine", 0, Line::new(9600), Rate::Hz20);
const _: () = check(&[ENGINE]);

#[tokio::main(flavor = "current_thread")]
async fn main() -> ExitCode {
    let Err(error) = run().await else { return ExitCode::SUCCESS };
    eprintln!("{error}");
    ExitCode::FAILURE
}

async fn run() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("name the serial port, for example /dev/ttyUSB0")?;
    let port = tokio_serial::new(path, ENGINE.line.baud).open_native_async()?;
    let (rx, tx) = tokio::io::split(port);

    // Nothing here survives the end of the program, so there is nothing to retain.
    let channel = Channel::new(&ENGINE, None);
    let source = channel.owner().source(Origin::Bench)?;
    let errors = LineErrors::new();
    let runner = channel.runner().run(FromTokio::new(rx), FromTokio::new(tx), &errors);
    tokio::select! {
        _ = runner => unreachable!("a runner never ends"),
        () = pilot(source) => Ok(()),
    }
}

async fn pilot(source: Source<'_>) {
    loop {
        for _ in 0..10 {
            if let Err(why) = source.command(Command::Standby) {
                eprintln!("standby was refused: {why}");
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        let telemetry = source.handle().telemetry();
        let rpm = telemetry.current(telemetry.report.rpm).map(|rpm| rpm.get());
        let egt = telemetry.current(telemetry.report.egt).map(|egt| egt.tenths() / 10);
        let known = |value: Option<i64>| value.map_or("?".to_string(), |value| value.to_string());
        let (rpm, egt) = (known(rpm.map(i64::from)), known(egt.map(i64::from)));
        println!("link {}, {}, {rpm} rpm, {egt} °C", telemetry.link, telemetry.state);
    }
}
