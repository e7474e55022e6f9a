//! Starts the board and spawns the tasks.
//!
//! | task | where | what it does |
//! |---|---|---|
//! | `engine`, one for each ECU | interrupt, above the rest | runs the engine over its UART |
//! | `events`, one for each ECU | thread mode | logs events |
//! | `status` | thread mode | logs a line per second for each engine and changes of the board's health, drives LED and buzzer |
//! | `mavlink` | thread mode | MAVLink on the telemetry port: commands, throttle, telemetry, parameters |
//! | `usb`, with the feature `usb` | thread mode | the same on USB |
//! | `radio_control`, with a receiver | thread mode | SBUS or CRSF on an ECU port: starts, throttle, stops |
//! | `radio_socket`, with a receiver on the board's socket for one | thread mode | the same there |
//! | `radio_pulses`, with servo pulses | thread mode | the same by a timer |
//! | `reception`, with a receiver or servo pulses | thread mode | logs a line per second of what was received |
//! | `drive_outputs`, with outputs | interrupt, above the rest | fuel valves, power of starters and ignitions |
//! | `log_outputs`, with outputs | thread mode | logs each change of an output and why |
//! | `played_ecu`, with the feature `play-ecu` | interrupt, above the rest | plays an ECU on the last port |
//! | `supply`, with a divider | thread mode | measures the supply voltage five times a second, logs it once |
//! | `supervisor` | thread mode | feeds the watchdog, and notes that the start has not failed, while every engine's runner works |
//!
//! After a reset a running engine resumes, and any other stays in standby. Engines are commanded by MAVLink, by
//! radio control, by the demonstration (feature `demo`) and by the trial (feature `trial`).
#![expect(clippy::disallowed_methods, reason = "logs, LED and watchdog keep their own time")]

use crate::board::receiver::{SOCKET, of_ecu_port, open_socket};
use crate::board::{self, EcuPort, Executor, Format, Led, Oscillator, PORTS, Watchdog};
use crate::mavlink::{Mavlink, Settings};
use crate::outputs::SHARED;
use crate::radio::Radio;
use crate::wiring::FOR_USE;
use embassy_sync::pubsub::WaitResult;
use embassy_time::{Duration, Ticker, Timer};
use jetlink::channel::Events;
use jetlink::config::{EngineConfig, check_port_is_free, check_ports};
use jetlink::engine::retained::Reset;
use jetlink::event::LossStage;
use jetlink::health::ClockSource;
use jetlink::indication::{Indication, Pattern};
use jetlink::line::Line;
use jetlink::node::{Node, NodePlace};
use jetlink::runner::Runner;
use jetlink::telemetry::Telemetry;
use jetlink::units::Millivolts;
use jetlink::watch::RunnerWatch;
use jetlink_fw::config::{ENGINES, OUTPUTS, RADIO, SUPPLY};
use jetlink_rc::shared::Changes;
use static_cell::{ConstStaticCell, StaticCell};
// The sentences that MAVLink sends are in the image: the log takes the same, and not their formats for defmt beside them.
use defmt::Display2Format as Text;

/// Number of engines of this node.
const N: usize = ENGINES.len();

/// Whether the receiver of radio control is on the board's socket for one, which is the port after those of ECUs.
const ON_SOCKET: bool = match &RADIO {
    Some(radio) => SOCKET.is_some() && radio.protocol.line().is_some() && radio.port as usize == PORTS.len(),
    None => false,
};

/// The port of the receiver of radio control, and how it is opened. One on a port that the board lacks does not build.
const RADIO_PORT: Option<(usize, Format)> = match &RADIO {
    Some(radio) => match radio.protocol.line() {
        Some(line) => {
            assert!(
                ON_SOCKET || (radio.port as usize) < FOR_USE,
                "this board has no such port for the receiver of radio control"
            );
            assert!(
                ON_SOCKET || !radio.inverted || board::INVERTS_RX,
                "the receiver's line is inverted, and this chip's UARTs cannot invert it back: docs/rc.md has the ports that can"
            );
            Some((radio.port as usize, Format::of_radio(line, radio.inverted)))
        }
        None => {
            assert!(board::pulses::OUTPUTS.is_some(), "this board has no inputs for servo pulses");
            None
        }
    },
    None => None,
};

const _: () = check_ports(&ENGINES, FOR_USE);
const _: () = if SOCKET.is_some() {
    let user = "the socket for a receiver, which cannot send: give the engine another port";
    check_port_is_free(&ENGINES, PORTS.len() as u8, user);
};

#[cortex_m_rt::entry]
fn main() -> ! {
    board::guard::arm();
    let mut outputs = None;
    let restore = |cause: board::ResetCause| outputs = crate::outputs::restore(cause);
    let board = board::init(restore);
    defmt::info!(
        "jetlink {=str} on {=str}, last reset: {=istr}",
        env!("CARGO_PKG_VERSION"),
        board::NAME,
        board.reset_cause.text()
    );
    if board.oscillator == Oscillator::Internal {
        defmt::error!("crystal not running, using the internal oscillator");
    }
    crate::outputs::buzz(false);

    #[cfg(all(feature = "selftest", feature = "stm32"))]
    {
        board::selftest::measure(board.reset_cause);
        board::selftest::count_cycles();
    }

    let Built { node, mavlink: service, radio, lines, telemetry } =
        build(board.reset_cause.retained(), board.oscillator, &mut outputs);
    // Which port has which format is known only now.
    let telemetry = defmt::unwrap!(board::open(PORTS.len(), Format::of_line(telemetry)));
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
        #[cfg(feature = "count")]
        let _telemetry = (service, telemetry);
        #[cfg(not(feature = "count"))]
        if let Some(service) = service {
            #[cfg(feature = "usb")]
            spawner.spawn(defmt::unwrap!(usb(service.runner, board.oscillator)));
            spawner.spawn(defmt::unwrap!(mavlink(service, telemetry)));
        }
        if RADIO.is_some()
            && let Some(radio) = radio
        {
            spawner.spawn(defmt::unwrap!(reception(radio)));
            match RADIO_PORT {
                Some((_, format)) if ON_SOCKET => {
                    spawner.spawn(defmt::unwrap!(radio_socket(radio, format)));
                }
                Some((port, format)) => {
                    let port = defmt::unwrap!(board::open(port, format));
                    spawner.spawn(defmt::unwrap!(radio_control(radio, port)));
                }
                None => spawner.spawn(defmt::unwrap!(radio_pulses(radio))),
            }
        }
        if SUPPLY {
            spawner.spawn(defmt::unwrap!(supply(node)));
        }
        #[cfg(feature = "demo")]
        spawner.spawn(defmt::unwrap!(demonstration(node)));
        #[cfg(feature = "trial")]
        spawner.spawn(defmt::unwrap!(trial(node)));
        #[cfg(feature = "count")]
        spawner.spawn(defmt::unwrap!(count()));

        let engines = board::start_engine_executor();
        for ((port, line), runner) in lines.into_iter().zip(node.runners()) {
            let port = defmt::unwrap!(board::open(port.into(), Format::of_line(line)));
            engines.spawn(defmt::unwrap!(engine(runner, port)));
        }
        if OUTPUTS.is_some()
            && let Some(outputs) = outputs
        {
            // Subscribe before the outputs are driven, so that what they are after the reset is not missed.
            let changes = defmt::unwrap!(SHARED.changes());
            spawner.spawn(defmt::unwrap!(log_outputs(changes)));
            engines.spawn(defmt::unwrap!(drive_outputs(node, outputs)));
        }
        #[cfg(feature = "play-ecu")]
        {
            let format = Format::of_line(crate::play_ecu::LINE);
            let port = defmt::unwrap!(board::open(PORTS.len() - 1, format));
            engines.spawn(defmt::unwrap!(played_ecu(port)));
        }
        // Last: from here on, an engine whose runner is stuck causes a reset.
        spawner.spawn(defmt::unwrap!(supervisor(node, board.watchdog)));
    })
}

/// Parts of the node, set up by [`build`].
struct Built {
    node: &'static Node<N>,
    mavlink: Option<Mavlink>,
    radio: Option<&'static Radio>,
    /// Port and line of each engine.
    lines: [(u8, Line); N],
    telemetry: Line,
}

/// Sets up all engines, MAVLink and radio control with the settings that are stored. Not inlined: the settings are on the stack until
/// all have them, and `main` never returns its stack.
#[inline(never)]
fn build(reset: Reset, oscillator: Oscillator, outputs: &mut Option<crate::outputs::All>) -> Built {
    let mut settings = Settings::new();
    crate::mavlink::load(&mut settings);
    let lines = settings.engines.each_ref().map(|engine| (engine.port, engine.line));
    let telemetry = settings.telemetry();
    log_ports(&settings.engines, telemetry);
    let node = node(&settings.engines, reset);
    node.set_clock(match oscillator {
        Oscillator::Crystal => ClockSource::Crystal,
        Oscillator::Internal => ClockSource::Internal,
    });
    let radio = crate::radio::build(node, &settings.engines, &settings.attached.radio);
    if OUTPUTS.is_some()
        && let Some(outputs) = outputs
    {
        crate::outputs::configure(outputs, &settings.attached.outputs);
    }
    // Not with `count`: its instructions would also be counted.
    let mavlink = (!cfg!(feature = "count")).then(|| crate::mavlink::build(node, &mut settings, radio));
    Built { node, mavlink, radio, lines, telemetry }
}

/// Sets up all engines. Not inlined: a channel is built on the stack, and `main` never returns its stack.
#[inline(never)]
fn node(engines: &[EngineConfig; N], reset: Reset) -> &'static Node<N> {
    static NODE: ConstStaticCell<NodePlace<N>> = ConstStaticCell::new(NodePlace::new());
    match NODE.take().build(engines, Some((&board::engines::RETAINED.0, reset))) {
        Ok(node) => node,
        // The whole sentence takes the texts of all settings into the image.
        Err(error) => defmt::panic!("row {} of the table of engines cannot work", error.row() + 1),
    }
}

/// Logs the use of each port.
fn log_ports(engines: &[EngineConfig; N], telemetry: Line) {
    for (port, name) in PORTS.iter().enumerate() {
        match engines.iter().find(|engine| usize::from(engine.port) == port) {
            Some(engine) => {
                defmt::info!("port {=usize}, {=str}: {=str}, {}", port, name, engine.name, engine.line)
            }
            None if RADIO_PORT.is_some_and(|(radio, _)| radio == port) => {
                defmt::info!("port {=usize}, {=str}: radio control", port, name)
            }
            None => defmt::info!("port {=usize}, {=str}: free", port, name),
        }
    }
    if let Some(name) = SOCKET.filter(|_| ON_SOCKET) {
        defmt::info!("port {=usize}, {=str}: radio control", PORTS.len(), name);
    }
    defmt::info!("MAVLink: {=str}, {}", board::TELEMETRY_PORT, telemetry);
    for (engine, config) in ENGINES.iter().zip(OUTPUTS.iter().flatten()) {
        for (what, pin) in [("fuel valve", config.valve), ("starter and ignition", config.power)] {
            if let Some(pin) = pin
                && let Some(output) = board::OUTPUTS.get(usize::from(pin.number))
            {
                let level = if pin.low { "low" } else { "high" };
                defmt::info!("{=str}: {=str} on {=str}, {=str} energises", engine.name, what, output, level);
            }
        }
    }
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
            WaitResult::Message(event) => defmt::info!("{=str}: {}", name, Text(&event)),
            WaitResult::Lagged(lost) => defmt::warn!("{=str}: {=u64} events lost", name, lost),
        }
    }
}

/// Status LED, and a line in the log for each engine, once a second.
#[embassy_executor::task]
async fn status(node: &'static Node<N>, mut led: Led, starting: u32) {
    let mut second = Ticker::every(Duration::from_secs(1));
    let mut logged = 0;
    loop {
        second.next().await;
        let mut shows =
            if node.health().needs_attention() { Indication::Fault } else { Indication::default() };
        for (engine, handle) in node.handles().iter().enumerate() {
            let telemetry = handle.telemetry();
            defmt::info!("{=str}: {}", handle.name(), StatusLine(&telemetry, engine));
            shows = shows.max(telemetry.indication());
        }
        if node.health().clock == ClockSource::Internal {
            defmt::info!("board: no crystal, all baud rates come from the internal oscillator");
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
        let pattern = shows.pattern();
        for _ in 0..pattern.flashes {
            led.set(true);
            crate::outputs::buzz(shows.beeps());
            Timer::after(pattern.lit).await;
            led.set(false);
            crate::outputs::buzz(false);
            Timer::after(Pattern::DARK).await;
        }
    }
}

/// State of an engine in one line. Values that the ECU does not report, or not lately, are left out.
struct StatusLine<'a>(&'a Telemetry, usize);

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
            defmt::write!(f, ", faults {}", Text(&faults));
        }
        if in_doubt.is_some() {
            defmt::write!(f, ", IN DOUBT whether it runs: the demand may be withheld");
        }
        if *transmitter_failed {
            defmt::write!(f, ", TRANSMITTER FAILED: nothing is sent");
        }
        defmt::write!(f, "; order: {}; {} in control", Text(ordered), Text(active_source));
        if *loss != LossStage::None {
            defmt::write!(f, ", source lost: {}", Text(loss));
        }
        if let Some(waiting) = waiting {
            defmt::write!(f, ", {} waits to take over", Text(waiting));
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
        if OUTPUTS.is_some() {
            if let Some(open) = SHARED.valve_is_open(self.1) {
                defmt::write!(f, "; fuel valve {=str}", if open { "open" } else { "closed" });
            }
            if let Some(on) = SHARED.power_is_on(self.1) {
                defmt::write!(f, ", starter and ignition {=str}", if on { "on" } else { "off" });
            }
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

#[cfg(not(feature = "count"))]
#[embassy_executor::task]
async fn mavlink(service: crate::mavlink::Mavlink, port: EcuPort) {
    crate::mavlink::serve(service, port).await
}

#[cfg(feature = "usb")]
#[embassy_executor::task]
async fn usb(runner: &'static crate::mavlink::Runner, oscillator: Oscillator) {
    crate::usb::serve(runner, oscillator).await
}

#[embassy_executor::task]
async fn radio_control(radio: &'static Radio, port: EcuPort) {
    crate::radio::serve(radio, of_ecu_port(port)).await
}

#[embassy_executor::task]
async fn radio_socket(radio: &'static Radio, format: Format) {
    crate::radio::serve(radio, defmt::unwrap!(open_socket(format))).await
}

#[embassy_executor::task]
async fn radio_pulses(radio: &'static Radio) {
    crate::radio::serve_pulses(radio).await
}

/// What came of all that the receiver has sent, in the log once a second.
#[embassy_executor::task]
async fn reception(radio: &'static Radio) {
    let mut second = Ticker::every(Duration::from_secs(1));
    loop {
        second.next().await;
        crate::radio::log(radio);
    }
}

/// The board's supply voltage, for ECUs that report none.
#[embassy_executor::task]
async fn supply(node: &'static Node<N>) {
    const { assert!(!SUPPLY || board::supply::IS_THERE, "this board has no divider that measures its supply") };
    let mut supply = board::supply::Supply::begin();
    let mut ticker = Ticker::every(Duration::from_millis(200));
    // The first one is logged, and one a second.
    for measured in (0..5).cycle() {
        let voltage = Millivolts::new(supply.millivolts());
        node.owners().iter().for_each(|owner| owner.setup().board_supply(voltage));
        if measured == 0 {
            defmt::info!("board: supply {=u32} mV", voltage.get());
        }
        ticker.next().await;
    }
}

#[embassy_executor::task]
async fn drive_outputs(node: &'static Node<N>, outputs: crate::outputs::All) {
    crate::outputs::serve(node, outputs).await
}

#[embassy_executor::task]
async fn log_outputs(changes: Changes<'static>) {
    crate::outputs::log(changes).await
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
    board::selftest::report(board::NAME, starting, oscillator).await
}

#[cfg(feature = "count")]
#[embassy_executor::task]
async fn count() {
    board::count::run().await
}

/// Feeds the watchdog, which resets after 1 s, while every engine's runner works.
#[embassy_executor::task]
async fn supervisor(node: &'static Node<N>, mut watchdog: Watchdog) {
    let mut watch = RunnerWatch::new(node.handles());
    watchdog.start();
    loop {
        let stuck = watch.check().await;
        for name in &stuck {
            defmt::error!("{=str}: its runner is stuck", name);
        }
        if stuck.is_empty() {
            watchdog.feed();
            crate::outputs::note_life();
        }
    }
}
