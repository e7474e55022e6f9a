//! Bench only (feature `demo`): commands every engine through one fixed cycle after another, so that somebody
//! at a bench sees an engine controller react. It is a source of commands like any other: it speaks ten times
//! a second, and what it asks can be refused.

use crate::pilot::Pilot;
use embassy_time::{Duration, Instant, Ticker, Timer};
use jetlink::command::{Command, Demand};
use jetlink::node::Node;
use jetlink::units::Throttle;

/// Between two commands; well within the 0.5 s for which a source may be silent.
const PERIOD: Duration = Duration::from_millis(100);

/// So long after a reset nothing is commanded: one sees engines that ran go on, and what becomes of them without a
/// source.
const SILENCE: Duration = Duration::from_secs(5);

const fn run_at(percent: u8) -> Command {
    match Throttle::from_percent(percent) {
        Ok(throttle) => Command::Run(Demand::Throttle(throttle)),
        Err(_) => panic!("a throttle of the demonstration is above 100 %"),
    }
}

/// One cycle: what is commanded, and for how many seconds. Never more than 40 % of throttle.
const CYCLE: [(Command, u64); 6] = [
    (Command::Standby, 10),
    (run_at(0), 180), // long enough for the starts of all engines, one after the other
    (run_at(20), 15),
    (run_at(40), 15),
    (run_at(0), 10),
    (Command::Standby, 120), // shut down and cool
];

/// Commands all engines of the node, for ever.
#[expect(clippy::disallowed_methods, reason = "a source of commands keeps its own time")]
pub async fn demonstrate<const N: usize>(node: &Node<N>) -> ! {
    Timer::after(SILENCE).await;
    let pilot = Pilot::new(node);
    let mut tick = Ticker::every(PERIOD);
    loop {
        pilot.arm();
        for (command, seconds) in CYCLE {
            defmt::info!("demonstration: {}", command);
            let end = Instant::now() + Duration::from_secs(seconds);
            while Instant::now() < end {
                pilot.command(command);
                tick.next().await;
            }
        }
    }
}
