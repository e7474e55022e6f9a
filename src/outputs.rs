//! Fuel valves, and power of starters and ignitions, on pins of the board.

use crate::board::{self, ResetCause};
use crate::wiring;
use core::array::from_fn;
use embassy_sync::pubsub::WaitResult;
use embassy_time::{Duration, Instant, Ticker};
use jetlink::node::Node;
use jetlink_fw::config::{BUZZER, ENGINES, OUTPUTS, RADIO};
use jetlink_rc::outputs::{Before, Outputs};
use jetlink_rc::settings::OutputSettings;
use jetlink_rc::shared::{Changes, Shared};
use jetlink_rc::starts::LIVED;
use jetlink_rc::wiring::OutputConfig;

/// Number of engines of this node.
const N: usize = ENGINES.len();

/// Time between two looks at the engines: a valve is closed within 10 ms of what closes it.
const EVERY: Duration = Duration::from_millis(5);

/// Outputs of all engines.
pub type All = [Outputs; N];

/// The outputs for the log and for MAVLink.
pub static SHARED: Shared<N> = Shared::new();

const _: () = if let Some(outputs) = OUTPUTS {
    jetlink_rc::wiring::check_board(&outputs, board::OUTPUTS_LOW_BEFORE);
};

/// Inputs for servo pulses are not outputs.
const _: () = if let (Some(outputs), Some(radio), Some(inputs)) = (OUTPUTS, RADIO, board::pulses::OUTPUTS)
    && radio.uart().is_none()
{
    jetlink_rc::wiring::check_free(&outputs, &inputs, "this output is an input for servo pulses");
};

const _: () = if let Some(buzzer) = BUZZER {
    let alone = OutputConfig::valve(buzzer);
    jetlink_rc::wiring::check_board(&[alone], board::OUTPUTS_LOW_BEFORE);
    if let (Some(radio), Some(inputs)) = (RADIO, board::pulses::OUTPUTS)
        && radio.uart().is_none()
    {
        jetlink_rc::wiring::check_free(&[alone], &inputs, "the buzzer is on an input for servo pulses");
    }
};

/// Makes the buzzer beep, or silent. The first call has to come before any task runs: the mode of a port's pins is one register.
pub fn buzz(beeps: bool) {
    if let Some(pin) = BUZZER {
        board::drive_output(pin.number, beeps != pin.low);
    }
}

/// Drives the pins from the engines' retained state, if there are outputs. Call it before anything else.
pub fn restore(cause: ResetCause) -> Option<All> {
    // Not `map`: without outputs nothing of it is in the image.
    if OUTPUTS.is_some() { Some(restore_all(cause)) } else { None }
}

fn restore_all(cause: ResetCause) -> All {
    let configs = defmt::unwrap!(OUTPUTS);
    let reset = cause.retained();
    let failed = board::starts::begin(cause);
    // Name, port and protocol are what a record is known by. The settings are not read yet.
    let wired = wiring::retained().unwrap_or(wiring::IMAGE);
    let all = from_fn(|engine| {
        let record = wiring::record(engine, &wired, reset);
        let power = wiring::power(engine, &wired);
        Outputs::new(configs[engine].settings, Before { record, power, has_failed: failed.close(engine) })
    });
    drive(&all);
    all
}

/// Takes the settings that are stored.
pub fn configure(all: &mut All, settings: &[OutputSettings]) {
    for (outputs, settings) in all.iter_mut().zip(settings) {
        outputs.configure(*settings);
    }
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
    let configs = defmt::unwrap!(OUTPUTS);
    for (engine, (config, outputs)) in configs.iter().zip(&all).enumerate() {
        SHARED.set(engine, config, outputs, outputs.restored());
        wiring::retain_power(engine, outputs.power());
    }
    let mut ticker = Ticker::every(EVERY);
    loop {
        let mut changes = [[None; 2]; N];
        for ((handle, outputs), changes) in node.handles().iter().zip(&mut all).zip(&mut changes) {
            *changes = outputs.update(&handle.telemetry());
        }
        drive(&all);
        for (engine, ((config, outputs), changes)) in configs.iter().zip(&all).zip(changes).enumerate() {
            SHARED.set(engine, config, outputs, changes.into_iter().flatten());
            if let [_, Some(_)] = changes {
                wiring::retain_power(engine, outputs.power());
            }
        }
        ticker.next().await;
    }
}

/// Call it while every engine's runner works, in thread mode, which takes the commands: a start that gets that far for long enough has
/// not failed. A valve that was closed for failed starts stays closed over further resets, until its engine is at rest.
#[expect(clippy::disallowed_methods, reason = "how long it lived")]
pub fn note_life() {
    if OUTPUTS.is_some() && Instant::now() >= Instant::MIN + LIVED {
        board::starts::has_lived(SHARED.cut());
    }
}

/// Logs each change of an output and why. In thread mode, below the outputs themselves.
pub async fn log(mut changes: Changes<'static>) -> ! {
    loop {
        match changes.next_message().await {
            WaitResult::Message((engine, change)) => {
                if let Some(engine) = ENGINES.get(engine) {
                    defmt::info!("{=str}: {=str}: {=str}", engine.name, change.what(), change.why().text());
                }
            }
            WaitResult::Lagged(lost) => defmt::warn!("outputs: {=u64} changes lost", lost),
        }
    }
}
