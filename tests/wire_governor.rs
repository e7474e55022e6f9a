//! Speed control by throttle, over the wire, on simulated engines. The speed is measured at the turbine, not in the
//! telemetry.
#![allow(clippy::disallowed_methods, reason = "a scenario keeps its own time")]

use bench::rows::simulated_as;
use bench::wired::{Bench, LONG, rpm};
use embassy_time::{Duration, Instant, Timer};
use jetlink::command::Origin;
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::engine::config::Governor;
use jetlink::line::Line;
use sim::amt::AmtEcu;

const ENGINES: [(EngineModel, u32); 2] = [(EngineModel::Olympus, 108_500), (EngineModel::Titan, 96_000)];

fn bench(engine: EngineModel, baud: u32, governor: Governor) -> Bench<AmtEcu> {
    let mut config = EngineConfig::amt("amt", 0, Line::new(baud), Some(engine));
    config.supervision.governor = Some(governor);
    Bench::new(&config, AmtEcu::new(simulated_as(&config)), 1)
}

fn true_rpm(bench: &Bench<AmtEcu>) -> f64 {
    bench.plug.ecu(|ecu| ecu.turbine().rpm())
}

#[derive(Debug, Default)]
struct Figures {
    /// Time until the speed stays within 1.5 % of the target, in s.
    settled: f64,
    /// Overshoot, in percent of the step.
    overshoot: f64,
    /// Deviation from the target at the end, in percent of the target.
    rest: f64,
}

/// Commands a speed for a time, and measures the response.
async fn step(bench: &Bench<AmtEcu>, target: u32, time: Duration) -> Figures {
    let from = true_rpm(bench);
    let target_rpm = f64::from(target);
    let way = target_rpm - from;
    let begin = Instant::now();
    let mut figures = Figures::default();
    let mut next = begin;
    while begin.elapsed() < time {
        if Instant::now() >= next {
            bench.command(rpm(target), Origin::Bench).expect("the governor takes it");
            next += Duration::from_millis(100);
        }
        Timer::after(Duration::from_millis(10)).await;
        let now = true_rpm(bench);
        let passed = begin.elapsed().as_micros() as f64 / 1e6;
        figures.overshoot = figures.overshoot.max((now - target_rpm) * way.signum() / way.abs() * 100.0);
        let off = (now - target_rpm).abs() / target_rpm * 100.0;
        if off > 1.5 {
            figures.settled = passed;
        }
        if passed > time.as_secs() as f64 - 5.0 {
            figures.rest = figures.rest.max(off);
        }
    }
    figures
}

/// Steps between 40 % and 90 % of the maximum, up and down, large and small, on a slow line and a quick one, at several
/// phases between the source's period of 100 ms and the ECU's of 125 ms.
#[test]
fn it_holds_a_speed_without_overshoot() {
    let (mut slowest, mut highest, mut rest) = (0.0f64, 0.0f64, 0.0f64);
    for (engine, max) in ENGINES {
        for (baud, phase) in
            [2400, 9600].into_iter().flat_map(|baud| [0, 31, 62, 93].map(|phase| (baud, phase)))
        {
            let bench = bench(engine, baud, Governor::DEFAULT);
            bench.play(LONG, async {
                bench.start().await;
                Timer::after(Duration::from_millis(phase)).await;
                let mut before = 40;
                step(&bench, max / 100 * before, Duration::from_secs(30)).await;
                for percent in [90, 40, 65, 90, 65, 40, 50, 60, 70, 80, 90, 80, 70, 60, 50, 40] {
                    let figures = step(&bench, max / 100 * percent, Duration::from_secs(25)).await;
                    println!("{engine:?} {baud} {phase} ms: {before} % to {percent} %: {figures:.2?}");
                    slowest = slowest.max(figures.settled);
                    highest = highest.max(figures.overshoot);
                    rest = rest.max(figures.rest);
                    before = percent;
                }
            });
        }
    }
    println!("settled within {slowest:.2} s, overshoot {highest:.2} %, then within {rest:.2} %");
    // The shaft speed is known in steps of 500 rpm: 4.6 % of the smallest step.
    assert!(highest <= 3.1, "overshoot {highest:.2} %");
    assert!(slowest <= 15.0, "settled within {slowest:.2} s");
    assert!(rest <= 1.5, "strays by {rest:.2} %");
}
