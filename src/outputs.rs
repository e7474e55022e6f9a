//! Fuel valves, and power of starters and ignitions, on pins of the board.

use crate::board;
use core::array::from_fn;
use embassy_time::{Duration, Ticker};
use jetlink::engine::retained::Reset;
use jetlink::node::Node;
use jetlink_fw::config::{ENGINES, OUTPUTS};
use jetlink_rc::outputs::Outputs;

/// Number of engines of this node.
const N: usize = ENGINES.len();

/// Time between two looks at the engines: a valve is closed within 10 ms of what closes it.
const EVERY: Duration = Duration::from_millis(5);

/// Outputs of all engines.
pub type All = [Outputs; N];

const _: () = if let Some(outputs) = OUTPUTS {
    jetlink_rc::wiring::check_board(&outputs, board::OUTPUTS_LOW_BEFORE);
};

/// Drives the pins from the engines' retained state, if there are outputs. Call it before anything else.
pub fn restore(reset: Reset) -> Option<All> {
    // Not `map`: without outputs nothing of it is in the image.
    if OUTPUTS.is_some() { Some(restore_all(reset)) } else { None }
}

fn restore_all(reset: Reset) -> All {
    let configs = defmt::unwrap!(OUTPUTS);
    let all = from_fn(|engine| {
        // Name, port and protocol are what a record is known by, and none of them is a parameter.
        let config = ENGINES.get(engine);
        let memory = config.and_then(|config| board::engines::RETAINED.0.get(usize::from(config.port)));
        let record = memory.zip(config).and_then(|(memory, config)| memory.load(config.fingerprint(), reset));
        Outputs::new(configs[engine].settings, record)
    });
    drive(&all);
    all
}

/// Drives all pins.
fn drive(all: &All) {
    for (config, outputs) in OUTPUTS.iter().flatten().zip(all) {
        for level in config.levels(outputs) {
            board::drive_output(level.number, level.high);
        }
    }
}

/// Follows the engines. In their executor: nothing in thread mode delays a valve.
#[expect(clippy::disallowed_methods, reason = "outputs keep their own time")]
pub async fn serve(node: &'static Node<N>, mut all: All) -> ! {
    let mut ticker = Ticker::every(EVERY);
    loop {
        for (handle, outputs) in node.handles().iter().zip(&mut all) {
            outputs.update(&handle.telemetry());
        }
        drive(&all);
        ticker.next().await;
    }
}
