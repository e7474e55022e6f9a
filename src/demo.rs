//! Bench only (feature `demo`): commands every engine through a fixed cycle, again and again, to show an ECU's reactions on
//! a bench. It is a source of commands like any other: ten commands a second, which may be refused.

use crate::pilot::Pilot;
use embassy_time::{Duration, Instant, Ticker, Timer};
use jetlink::command::{Command, Demand};
use jetlink::node::Node;
use jetlink::units::Throttle;

/// Interval of commands, 0.1 s; the source's timeout is 0.5 s.
const PERIOD: Duration = Duration::from_millis(100);

/// Time after a reset without commands, 5 s: it shows how running engines resume, and their stages of loss.
const SILENCE: Duration = Duration::from_secs(5);

const fn run_at(percent: u8) -> Command {
    match Throttle::from_percent(percent) {
        Ok(throttle) => Command::Run(Demand::Throttle(throttle)),
        Err(_) => panic!("a throttle of the demonstration is above 100 %"),
    }
}

/// Commands of one cycle, with their durations in s. The throttle is 40 % at most.
const CYCLE: [(Command, u64); 6] = [
    (Command::Standby, 10),
    (run_at(0), 180), // long enough for the starts of all engines, one after the other
    (run_at(20), 15),
    (run_at(40), 15),
    (run_at(0), 10),
    (Command::Standby, 120), // shut down and cool
];

/// Commands all engines of the node, forever.
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
