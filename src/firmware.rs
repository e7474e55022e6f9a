//! Starts the board and spawns the tasks.
//!
//! | task | where | what it does |
//! |---|---|---|
//! | `engine`, one for each ECU | interrupt, above the rest | runs the engine over its UART |
//! | `events`, one for each ECU | thread mode | logs events |
//! | `status` | thread mode | logs a line per second for each engine and changes of the board's health, drives the LED |
//! | `played_ecu`, with the feature `play-ecu` | interrupt, above the rest | plays an ECU on the last port |
//! | `supervisor` | thread mode | feeds the watchdog while every engine's runner works |
//!
//! After a reset a running engine resumes, and any other stays in standby. Nothing here commands an engine, except the
//! demonstration (feature `demo`) and the trial (feature `trial`).
#![expect(clippy::disallowed_methods, reason = "logs, LED and watchdog keep their own time")]

use crate::board::{self, EcuPort, Executor, Led, Oscillator, PORTS, Watchdog};
use embassy_sync::pubsub::WaitResult;
use embassy_time::{Duration, Ticker, Timer};
use jetlink::channel::Events;
use jetlink::config::check_ports;
use jetlink::engine::retained::Reset;
use jetlink::event::LossStage;
use jetlink::health::ClockSource;
use jetlink::line::Line;
use jetlink::node::{Node, NodePlace};
use jetlink::runner::Runner;
use jetlink::telemetry::Telemetry;
use jetlink_fw::config::ENGINES;
use static_cell::{ConstStaticCell, StaticCell};

/// Number of engines of this node.
const N: usize = ENGINES.len();

/// Line of each port that has an engine. An engine on a port that the board lacks does not build.
const LINES: [Option<Line>; PORTS.len()] = {
    // With the feature play-ecu the last port is not for an engine.
    check_ports(&ENGINES, PORTS.len() - cfg!(feature = "play-ecu") as usize);
    let mut lines = [None; PORTS.len()];
    let mut i = 0;
    while i < N {
        lines[ENGINES[i].port as usize] = Some(ENGINES[i].line);
        i += 1;
    }
    #[cfg(feature = "play-ecu")]
    {
        lines[PORTS.len() - 1] = Some(crate::play_ecu::LINE);
    }
    lines
};

/// Interval of the supervisor, 250 ms. A runner shows progress every 100 ms; the watchdog resets after 1 s.
const SUPERVISION: Duration = Duration::from_millis(250);

#[cortex_m_rt::entry]
fn main() -> ! {
    board::guard::arm();
    let mut board = board::init(LINES);
    defmt::info!(
        "jetlink {=str} on {=str}, last reset: {}",
        env!("CARGO_PKG_VERSION"),
        board::NAME,
        board.reset_cause
    );
    if board.oscillator == Oscillator::Internal {
        defmt::error!("the crystal does not run: on the chip's own oscillator");
    }
    log_ports();

    #[cfg(all(feature = "selftest", feature = "stm32"))]
    {
        board::selftest::measure(board.reset_cause);
        board::selftest::count_cycles();
    }

    let node = node(board.reset_cause.retained());
    node.set_clock(match board.oscillator {
        Oscillator::Crystal => ClockSource::Crystal,
        Oscillator::Internal => ClockSource::Internal,
    });
    // Building the node takes much more stack than the rest of the firmware, so the two are measured apart.
    let starting = board::stack::deepest();
    board::stack::paint();
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    EXECUTOR.init(Executor::new()).run(|spawner| {
        for handle in node.handles() {
            // Subscribe before the engines run, so that no event is missed.
            let subscriber = defmt::unwrap!(handle.events());
            spawner.spawn(defmt::unwrap!(events(handle.name(), subscriber)));
        }
        spawner.spawn(defmt::unwrap!(status(node, board.led, starting)));
        #[cfg(all(feature = "selftest", feature = "stm32"))]
        spawner.spawn(defmt::unwrap!(self_test(starting, board.oscillator)));
        #[cfg(feature = "demo")]
        spawner.spawn(defmt::unwrap!(demonstration(node)));
        #[cfg(feature = "trial")]
        spawner.spawn(defmt::unwrap!(trial(node)));
        #[cfg(feature = "count")]
        spawner.spawn(defmt::unwrap!(count()));

        let engines = board::start_engine_executor();
        for (config, runner) in ENGINES.iter().zip(node.runners()) {
            let port = defmt::unwrap!(board.ports[usize::from(config.port)].take());
            engines.spawn(defmt::unwrap!(engine(runner, port)));
        }
        #[cfg(feature = "play-ecu")]
        engines.spawn(defmt::unwrap!(played_ecu(defmt::unwrap!(board.ports[PORTS.len() - 1].take()))));
        // Last: from here on, an engine whose runner is stuck causes a reset.
        spawner.spawn(defmt::unwrap!(supervisor(node, board.watchdog)));
    })
}

/// Sets up all engines. Not inlined: a channel is built on the stack, and `main` never returns its stack.
#[inline(never)]
fn node(reset: Reset) -> &'static Node<N> {
    static NODE: ConstStaticCell<NodePlace<N>> = ConstStaticCell::new(NodePlace::new());
    defmt::unwrap!(NODE.take().build(&ENGINES, Some((&board::engines::RETAINED.0, reset))))
}

/// Logs the use of each port.
fn log_ports() {
    for (port, name) in PORTS.iter().enumerate() {
        match ENGINES.iter().find(|engine| usize::from(engine.port) == port) {
            Some(engine) => {
                defmt::info!("port {=usize}, {=str}: {=str}, {}", port, name, engine.name, engine.line)
            }
            None => defmt::info!("port {=usize}, {=str}: free", port, name),
        }
    }
    defmt::info!("reserved for MAVLink: {=str}", board::TELEMETRY_PORT);
}

#[embassy_executor::task(pool_size = N)]
async fn engine(runner: Runner<'static>, port: EcuPort) {
    let run = port.serve(runner);
    #[cfg(feature = "wedge")]
    let run = wedged(run);
    run.await
}

/// Test image only (feature `wedge`): the first engine's task hangs after 5 s, with its UART open.
#[cfg(feature = "wedge")]
async fn wedged<R: Future>(run: R) -> R::Output {
    use core::sync::atomic::{AtomicBool, Ordering};
    static TAKEN: AtomicBool = AtomicBool::new(false);
    let mut run = core::pin::pin!(run);
    if !TAKEN.swap(true, Ordering::Relaxed) {
        embassy_futures::select::select(run.as_mut(), Timer::after_secs(5)).await;
        core::future::pending::<()>().await;
    }
    run.await
}

#[embassy_executor::task(pool_size = N)]
async fn events(name: &'static str, mut events: Events<'static>) {
    loop {
        match events.next_message().await {
            WaitResult::Message(event) => defmt::info!("{=str}: {}", name, event),
            WaitResult::Lagged(lost) => defmt::warn!("{=str}: {=u64} events lost", name, lost),
        }
    }
}

/// Status LED: one flash a second, five when an engine or the board needs attention.
#[embassy_executor::task]
async fn status(node: &'static Node<N>, mut led: Led, starting: u32) {
    let mut second = Ticker::every(Duration::from_secs(1));
    let mut logged = 0;
    loop {
        second.next().await;
        let mut flashes = if node.health().needs_attention() { 5 } else { 1 };
        for handle in node.handles() {
            let telemetry = handle.telemetry();
            defmt::info!("{=str}: {}", handle.name(), StatusLine(&telemetry));
            if telemetry.needs_attention() {
                flashes = 5;
            }
        }
        if node.health().clock == ClockSource::Internal {
            defmt::info!("board: no crystal, all baud rates come from the chip's own oscillator");
        }
        let deepest = board::stack::deepest();
        if deepest > logged {
            logged = deepest;
            defmt::info!(
                "board: {=u32} bytes of stack used since the start, {=u32} bytes during it",
                deepest,
                starting
            );
        }
        for _ in 0..flashes {
            led.set(true);
            Timer::after_millis(50).await;
            led.set(false);
            Timer::after_millis(100).await;
        }
    }
}

/// State of an engine in one line. Values that the ECU does not report, or not lately, are left out.
struct StatusLine<'a>(&'a Telemetry);

impl defmt::Format for StatusLine<'_> {
    fn format(&self, f: defmt::Formatter) {
        let Telemetry { link, state, report, ordered, active_source, waiting, loss, .. } = self.0;
        let Telemetry { limited, obeyed, stop_latched, in_doubt, transmitter_failed, counters, .. } = self.0;
        defmt::write!(f, "link {}, {}", link, state);
        if let Some(rpm) = self.0.current(report.rpm) {
            defmt::write!(f, ", {=u32} rpm", rpm.get());
        }
        if let Some(egt) = self.0.current(report.egt) {
            defmt::write!(f, ", {=i16} °C", egt.tenths() / 10);
        }
        if let Some(throttle) = self.0.current(report.throttle) {
            defmt::write!(f, ", throttle {=u16} %", throttle.tenths() / 10);
        }
        if let Some(faults) = self.0.current(report.faults)
            && !faults.is_empty()
        {
            defmt::write!(f, ", faults {}", faults);
        }
        if in_doubt.is_some() {
            defmt::write!(f, ", IN DOUBT whether it runs: the demand is withheld");
        }
        if *transmitter_failed {
            defmt::write!(f, ", TRANSMITTER FAILED: nothing is sent");
        }
        defmt::write!(f, "; order: {}; {} in control", ordered, active_source);
        if *loss != LossStage::None {
            defmt::write!(f, ", source lost: {}", loss);
        }
        if let Some(waiting) = waiting {
            defmt::write!(f, ", {} waits to take over", waiting);
        }
        if *limited {
            defmt::write!(f, ", limited to the fail-safe throttle");
        }
        if !obeyed {
            defmt::write!(f, ", NOT OBEYED by the ECU");
        }
        if *stop_latched {
            defmt::write!(f, ", emergency stop latched");
        }
        let on_the_line = [counters.framing_errors, counters.noise_errors, counters.overruns];
        if on_the_line != [0; 3] {
            let [framing, noise, overruns] = on_the_line;
            defmt::write!(
                f,
                "; {=u32} framing, {=u32} noise, {=u32} overrun errors",
                framing,
                noise,
                overruns
            );
        }
    }
}

#[cfg(feature = "play-ecu")]
#[embassy_executor::task]
async fn played_ecu(port: EcuPort) {
    crate::play_ecu::play(port).await
}

#[cfg(feature = "demo")]
#[embassy_executor::task]
async fn demonstration(node: &'static Node<N>) {
    crate::demo::demonstrate(node).await
}

#[cfg(feature = "trial")]
#[embassy_executor::task]
async fn trial(node: &'static Node<N>) {
    crate::trial::run(node).await
}

#[cfg(all(feature = "selftest", feature = "stm32"))]
#[embassy_executor::task]
async fn self_test(starting: u32, oscillator: Oscillator) {
    board::selftest::report(starting, oscillator).await
}

#[cfg(feature = "count")]
#[embassy_executor::task]
async fn count() {
    board::count::run().await
}

#[embassy_executor::task]
async fn supervisor(node: &'static Node<N>, mut watchdog: Watchdog) {
    let mut at_last_feed = node.handles().map(|handle| handle.progress());
    watchdog.start();
    loop {
        // Not a ticker: after a stall it would catch up, and report runners as stuck that had no time to progress.
        Timer::after(SUPERVISION).await;
        let mut all_progressed = true;
        for (handle, before) in node.handles().iter().zip(at_last_feed) {
            if handle.progress() == before {
                defmt::error!("{=str}: its runner is stuck", handle.name());
                all_progressed = false;
            }
        }
        if all_progressed {
            watchdog.feed();
            at_last_feed = node.handles().map(|handle| handle.progress());
        }
    }
}
