//! Test image only (feature `trial`, `cargo qemu-test`): starts, runs and shuts down every engine once, as a pilot would.
//! Then the program ends, with exit status 0 if the engines reported every step.
//!
//! It only checks the telemetry. `qemu/` checks the simulated ECUs.

use crate::board;
use crate::pilot::Pilot;
use embassy_time::{Duration, Instant, Ticker};
use jetlink::command::{Command, Demand};
use jetlink::event::LossStage;
use jetlink::node::Node;
use jetlink::report::{LinkState, Phase};
use jetlink::telemetry::Telemetry;
use jetlink::units::Throttle;

/// Interval of commands, 0.1 s; the source's timeout is 0.5 s.
const PERIOD: Duration = Duration::from_millis(100);
/// Throttle at which every engine runs, and the shortest time for it.
const THROTTLE: Throttle = match Throttle::from_percent(30) {
    Ok(throttle) => throttle,
    Err(_) => panic!("the trial's throttle is above 100 %"),
};
const AT_THROTTLE: Duration = Duration::from_secs(3);
/// Exhaust temperature of an engine that may be started again, in 0.1 °C.
const COOL: i16 = 1000;

/// One step: a command until all engines report its result.
struct Step {
    name: &'static str,
    command: Command,
    /// Shortest duration.
    hold: Duration,
    /// Timeout.
    limit: Duration,
    done: fn(&Telemetry) -> bool,
}

const STEPS: [Step; 4] = [
    Step {
        name: "every link is up and every engine in standby",
        command: Command::Standby,
        hold: Duration::from_secs(1),
        limit: Duration::from_secs(20),
        done: |engine| engine.link == LinkState::Up && is_in(engine, Phase::Standby),
    },
    Step {
        name: "every engine runs",
        command: Command::Run(Demand::Throttle(Throttle::IDLE)),
        hold: Duration::MIN,
        // One after the other.
        limit: Duration::from_secs(240),
        done: |engine| is_in(engine, Phase::Running),
    },
    Step {
        name: "every engine obeys the throttle",
        command: Command::Run(Demand::Throttle(THROTTLE)),
        hold: AT_THROTTLE,
        limit: Duration::from_secs(20),
        done: |engine| {
            is_in(engine, Phase::Running)
                && engine.report.throttle.is_some_and(|reported| reported.value == THROTTLE)
        },
    },
    Step {
        name: "every engine is shut down, cool and in standby",
        command: Command::Standby,
        hold: Duration::from_secs(1),
        limit: Duration::from_secs(120),
        done: |engine| {
            is_in(engine, Phase::Standby) && engine.report.egt.is_some_and(|egt| egt.value.tenths() < COOL)
        },
    },
];

fn is_in(engine: &Telemetry, phase: Phase) -> bool {
    engine.report.phase.is_some_and(|reported| reported.value == phase)
}

/// Performs the steps and ends the program.
#[expect(clippy::disallowed_methods, reason = "a source of commands keeps its own time")]
pub async fn run<const N: usize>(node: &Node<N>) -> ! {
    let mut tick = Ticker::every(PERIOD);
    let pilot = Pilot::new(node);
    pilot.arm();
    for step in STEPS {
        let began = Instant::now();
        loop {
            pilot.command(step.command);
            tick.next().await;
            let engines = node.handles().map(|handle| handle.telemetry());
            let lost = |engine: &Telemetry| engine.link == LinkState::Lost || engine.loss != LossStage::None;
            if engines.iter().any(lost) {
                fail(node, "a link or the source of commands was lost");
            }
            if began.elapsed() >= step.hold && engines.iter().all(step.done) {
                break;
            }
            if began.elapsed() >= step.limit {
                fail(node, step.name);
            }
        }
        defmt::info!("trial: {=str}", step.name);
    }
    defmt::info!("trial: passed");
    board::exit(0)
}

fn fail<const N: usize>(node: &Node<N>, what: &str) -> ! {
    for handle in node.handles() {
        let engine = handle.telemetry();
        defmt::error!(
            "{=str}: link {}, {}, {=u32} frames received, {=u32} sent, {=u32} replies missed",
            handle.name(),
            engine.link,
            engine.state,
            engine.counters.frames,
            engine.counters.sent,
            engine.counters.replies_missed
        );
    }
    defmt::error!("trial: failed: {=str}", what);
    board::exit(1)
}
