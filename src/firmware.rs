//! Starts the board and spawns the tasks.
//!
//! | task | where | what it does |
//! |---|---|---|
//! | `engine`, one for each ECU | interrupt, above the rest | runs the engine over its UART |
//! | `events`, one for each ECU | thread mode | logs what happens |
//! | `status` | thread mode | logs one line a second for each engine, drives the LED |
//! | `supervisor` | thread mode | feeds the watchdog while every engine's runner makes progress |
//!
//! Every engine starts in standby. Nothing here commands an engine, except the demonstration (feature `demo`).

use defmt_rtt as _; // the logger
use embassy_executor::Executor;
use embassy_time::{Duration, Ticker};
use jetlink::{
    config::ENGINES,
    line::Line,
    node::{Handle, Node},
    runner::Runner,
};
use static_cell::StaticCell;

use crate::board::{self, EcuPort, Led, PORTS, Watchdog};

/// How many engines this node runs.
const N: usize = ENGINES.len();

/// The line of each port that has an engine. A table of engines that does not fit the board does not build.
const LINES: [Option<Line>; PORTS.len()] = {
    let mut lines = [None; PORTS.len()];
    let mut i = 0;
    while i < N {
        let port = ENGINES[i].port as usize;
        assert!(
            port < PORTS.len(),
            "an engine is on a port that this board does not have"
        );
        assert!(lines[port].is_none(), "two engines are on one port");
        lines[port] = Some(ENGINES[i].line);
        i += 1;
    }
    lines
};

/// How often the supervisor looks. The watchdog allows for four missed looks; a runner makes progress every 100 ms.
const SUPERVISION: Duration = Duration::from_millis(250);

#[cortex_m_rt::entry]
fn main() -> ! {
    let mut board = board::init(LINES);
    defmt::info!(
        "jetlink {=str} on {=str}, last reset: {}",
        env!("CARGO_PKG_VERSION"),
        board::NAME,
        board::reset_cause()
    );
    log_ports();

    static NODE: StaticCell<Node<N>> = StaticCell::new();
    let node: &'static Node<N> = NODE.init(Node::new(&ENGINES));

    let engines = board::start_engine_executor();
    for (i, config) in ENGINES.iter().enumerate() {
        let port = defmt::unwrap!(board.ports[usize::from(config.port)].take());
        engines.spawn(defmt::unwrap!(engine(node.runner(i), port)));
    }

    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    EXECUTOR.init(Executor::new()).run(|spawner| {
        for (i, config) in ENGINES.iter().enumerate() {
            spawner.spawn(defmt::unwrap!(events(config.name, node.handle(i))));
        }
        spawner.spawn(defmt::unwrap!(status(node, board.led)));
        #[cfg(feature = "demo")]
        spawner.spawn(defmt::unwrap!(demo(node)));
        // Last: from here on a task that stands still means a reset.
        spawner.spawn(defmt::unwrap!(supervisor(node, board.watchdog)));
    })
}

/// Logs what is on each port.
fn log_ports() {
    for (port, name) in PORTS.iter().enumerate() {
        match ENGINES
            .iter()
            .find(|engine| usize::from(engine.port) == port)
        {
            Some(engine) => defmt::info!(
                "port {=usize} ({=str}): {=str}, {}",
                port,
                name,
                engine.name,
                engine.line
            ),
            None => defmt::info!("port {=usize} ({=str}): free", port, name),
        }
    }
    defmt::info!("kept for MAVLink: {=str}", board::TELEMETRY_PORT);
}

#[embassy_executor::task(pool_size = N)]
async fn engine(runner: Runner<'static>, port: EcuPort) {
    runner.run(port.rx, port.tx, port.errors).await
}

#[embassy_executor::task(pool_size = N)]
async fn events(name: &'static str, handle: Handle<'static>) {
    let mut events = handle.events();
    loop {
        defmt::info!("{=str}: {}", name, events.next().await);
    }
}

#[embassy_executor::task]
async fn status(node: &'static Node<N>, mut led: Led) {
    let mut second = Ticker::every(Duration::from_secs(1));
    loop {
        second.next().await;
        for (i, config) in ENGINES.iter().enumerate() {
            defmt::info!("{=str}: {}", config.name, node.handle(i).telemetry());
        }
        led.set(true);
    }
}

#[embassy_executor::task]
async fn supervisor(node: &'static Node<N>, mut watchdog: Watchdog) {
    let progress = || core::array::from_fn::<u32, N, _>(|i| node.handle(i).progress());
    let mut at_last_feed = progress();
    watchdog.start();
    let mut look = Ticker::every(SUPERVISION);
    loop {
        look.next().await;
        let now = progress();
        let mut all_moved = true;
        for (config, (now, before)) in ENGINES.iter().zip(now.iter().zip(&at_last_feed)) {
            if now == before {
                defmt::error!("{=str}: its runner stands still", config.name);
                all_moved = false;
            }
        }
        if all_moved {
            watchdog.feed();
            at_last_feed = now;
        }
    }
}
