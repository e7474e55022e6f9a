//! Fuel valves and the power of starters on their pins: start, standby, stop, and every kind of reset.

use crate::mavlink;
use crate::supply::drop_supply;
use crate::support::{Task, crash, hijack_if_spawned, on_each_board, symbol};
use emulation::pins::{Level, Pin};
use emulation::receiver::{Position, Protocol, Receiver};
use emulation::{Bench, Board, Bootloader, Image, Leftover, PIXRACER, Report, Run, engines};
use sim::amt::AmtEcu;
use sim::ecu::{MILLIS, Nanos, SECOND};
use sim::turbine::Phase;
use sim::zk::ZkEcu;

/// Ports of an AMT engine, "left", and of a ZK engine, "booster".
const AMT: &str = "SERIAL2";
const ZK: &str = "SERIAL5";

/// An output of an engine, as the image has it (src/config.rs, feature `outputs`).
#[derive(Clone, Copy, Debug)]
struct Output {
    name: &'static str,
    /// Number on the board.
    number: usize,
    /// Level that energises.
    on: Level,
}

impl Output {
    fn off(self) -> Level {
        if self.on == Level::High { Level::Low } else { Level::High }
    }
}

const LEFT: Output = Output { name: "left, valve", number: 0, on: Level::High };
const BOOSTER: Output = Output { name: "booster, valve", number: 3, on: Level::Low };
/// The Pixracer has no output for the power of "booster".
const POWER: Output = Output { name: "left, power", number: 4, on: Level::High };
const VALVES: [Output; 2] = [LEFT, BOOSTER];

/// Both engines and a receiver, both running at 50 % from 30 s on.
fn flying(board: &'static Board) -> Run {
    flying_with(board, Image::Outputs)
}

fn flying_with(board: &'static Board, image: Image) -> Run {
    Run::new(board, image)
        .quick_engines()
        .only(&[AMT, ZK])
        .radio(Receiver::new(Protocol::Sbus))
        .at(3 * SECOND, |bench| bench.radio().switch = Position::Standby)
        .at(5 * SECOND, |bench| bench.radio().switch = Position::Run)
        .at(26 * SECOND, |bench| bench.radio().stick = 50)
}

fn phases(report: &Report) -> [Phase; 2] {
    [report.ecu::<AmtEcu>(AMT).turbine().phase(), report.ecu::<ZkEcu>(ZK).turbine().phase()]
}

/// A stop of the receiver's switch closes each valve within 10 ms of the end of the second frame after it: from there on, two of three SBUS
/// frames have the new value. CRSF has other frames between those of its channels, so the first one may be enough.
pub fn stop_closes_the_valves_within_10_ms(report: &Report, protocol: Protocol, stop: Nanos) {
    // A frame then on the line still has the previous value.
    let mut ends = report
        .wire(report.image.radio(report.board))
        .rx
        .iter()
        .filter(|rx| rx.last && rx.end > stop + 4 * MILLIS);
    let [first, second] = [(); 2].map(|()| ends.next().expect("frames").end);
    let from = if protocol == Protocol::Crsf { first } else { second };
    valves_close(report, stop..stop + SECOND, from..second + 10 * MILLIS);
}

/// Each valve changes once in a time, and closes in a part of it.
fn valves_close(report: &Report, within: core::ops::Range<Nanos>, closes: core::ops::Range<Nanos>) {
    for valve in VALVES.into_iter().filter(|valve| valve.number < report.board.outputs.len()) {
        let name = format!("{}, {}", report.board.name, valve.name);
        let valve = Output { on: Level::energising(report.board, valve.number == BOOSTER.number), ..valve };
        let closed = Pin::output(report, valve.number).changes(within.clone());
        let [(at, level)] = closed[..] else { panic!("{name}: {closed:?}") };
        println!("{name}: closed {:.2} ms before its limit", (closes.end as f64 - at as f64) / 1e6);
        assert_eq!(level, valve.off(), "{name}");
        assert!(closes.contains(&at), "{name}: {at} ns, not in {closes:?}");
    }
}

/// Checks that the output is energised or not for the whole time, except for the beginning of a reset.
fn stays(report: &Report, output: Output, level: Level, within: core::ops::Range<Nanos>) {
    let pin = Pin::output(report, output.number);
    assert_eq!(pin.at(within.start), level, "{}, {} at {}", report.board.name, output.name, within.start);
    let changes = pin.changes(within.start + 1..within.end);
    assert_eq!(changes, [], "{}, {}", report.board.name, output.name);
}

/// From a reset until the output is driven, to this level and no other before.
fn driven_after(report: &Report, output: Output, reset: Nanos, level: Level) -> Nanos {
    let pin = Pin::output(report, output.number);
    let changes = pin.changes(reset..reset + 400 * MILLIS);
    let text = format!("{}, {}: {changes:?}", report.board.name, output.name);
    assert_eq!(changes[0], (reset, Level::Floats), "{text}");
    assert_eq!(changes[1].1, level, "{text}");
    let took = changes[1].0 - reset;
    println!("{}, {}: driven {:.3} ms after the reset", report.board.name, output.name, took as f64 / 1e6);
    assert!(took < 5 * MILLIS, "{text}");
    changes[1].0
}

#[test]
fn valve_opens_for_a_start_and_is_closed_by_a_stop_within_10_ms_and_over_a_reset() {
    on_each_board(|board| {
        const STOP: Nanos = 32 * SECOND;
        const RESET: Nanos = 33 * SECOND;
        let report = flying(board)
            .at(STOP, |bench| bench.radio().switch = Position::Stop)
            .at(RESET, |bench| bench.watchdog_runs_out())
            .resets(1)
            .until(36 * SECOND)
            .go();
        let reset = report.resets[0].0;
        stop_closes_the_valves_within_10_ms(&report, Protocol::Sbus, STOP);
        for (valve, name) in VALVES.into_iter().zip(["left", "booster"]) {
            // De-energised from the first instructions on until the start is ordered, then open until the stop.
            let first = driven_after(&report, Output { name: valve.name, ..valve }, 0, valve.off());
            let start = report.when(&format!("{name}: run, "));
            stays(&report, valve, valve.off(), first..start - 20 * MILLIS);
            stays(&report, valve, valve.on, start + 20 * MILLIS..STOP);
            // The stop is latched: no level but closed after the reset.
            let again = driven_after(&report, valve, reset, valve.off());
            stays(&report, valve, valve.off(), again..report.at);
        }
        // The log reports each change with its reason, and the state once a second.
        for (name, part) in [
            ("left", "fuel valve open: the engine is ordered to run"),
            ("left", "fuel valve closed: emergency stop"),
            ("booster", "fuel valve closed: emergency stop"),
            ("left", "starter and ignition on: the engine is armed"),
        ] {
            let line = format!("{name}: {part}");
            let lines = report.lines(&line).filter(|log| log.at < reset);
            assert_eq!(lines.count(), 1, "{line}");
        }
        assert!(report.lines("; fuel valve open, starter and ignition on").count() > 10);
        assert!(report.lines("; fuel valve closed").any(|log| log.at > reset));
        // The starter cools the turbines, also during the reset.
        let armed = Pin::output(&report, POWER.number).changes(SECOND..STOP);
        assert!(armed.len() == 1 && armed[0].1 == POWER.on, "{armed:?}");
        stays(&report, POWER, POWER.on, armed[0].0..reset);
        let again = driven_after(&report, POWER, reset, POWER.on);
        stays(&report, POWER, POWER.on, again..again + SECOND);
        assert!(phases(&report).iter().all(|phase| *phase != Phase::Running), "{:?}", phases(&report));
    });
}

#[test]
fn standby_closes_the_valve_once_the_engine_is_at_rest() {
    on_each_board(|board| {
        const STANDBY: Nanos = 30 * SECOND;
        let (sender, receiver) = std::sync::mpsc::channel();
        let mut run = flying(board);
        // The starter turns it until it is cold: in a few seconds here.
        for engine in engines::of(board, Image::Outputs) {
            if [AMT, ZK].contains(&engine.port) {
                let mut config = engine.quick_config();
                config.turbine_mut().cooling_s = 3.0;
                run = run.ecu(engine.port, engine.line, config.ecu());
            }
        }
        run = run
            .at(28 * SECOND, |bench| bench.radio().stick = 0)
            .at(STANDBY, |bench| bench.radio().switch = Position::Standby);
        // State of the turbines, ten times a second.
        for at in (STANDBY..55 * SECOND).step_by(100 * MILLIS as usize) {
            let sender = sender.clone();
            run = run.at(at, move |bench: &mut Bench<'_>| {
                let rpm = [bench.ecu::<AmtEcu>(AMT).turbine().rpm(), bench.ecu::<ZkEcu>(ZK).turbine().rpm()];
                let _ = sender.send((at, rpm));
            });
        }
        drop(sender);
        let report = run.until(55 * SECOND).go();
        let turns: Vec<_> = receiver.iter().collect();
        for (engine, valve) in VALVES.into_iter().enumerate() {
            let changes = Pin::output(&report, valve.number).changes(STANDBY..report.at);
            assert!(
                matches!(changes[..], [(_, level)] if level == valve.off()),
                "{}: {changes:?}",
                valve.name
            );
            let closed = changes[0].0;
            let rpm = |at: Nanos| turns.iter().rfind(|(each, _)| *each <= at).expect("a look").1[engine];
            println!(
                "{}, {}: closed {:.1} s after standby, at {:.0} rpm",
                board.name,
                valve.name,
                (closed - STANDBY) as f64 / 1e9,
                rpm(closed)
            );
            // It is at rest below 1000 rpm; the last sample was up to 0.1 s before.
            assert!(rpm(STANDBY) > 20_000.0 && rpm(closed) < 1100.0, "{}", valve.name);
        }
    });
}

/// "Left" is a ZK engine on the port that "booster" has in the image. Its record is found there before any setting is read, and its
/// previous port has none.
#[test]
fn valve_of_an_engine_on_another_port_stays_open_in_flight_over_a_reset() {
    on_each_board(|board| {
        const RESET: Nanos = 45 * SECOND;
        let client = mavlink::rewires(&mavlink::CHANGED);
        let (report, complaints) = Run::new(board, Image::Outputs)
            .quick_engines()
            .only(&[ZK])
            .radio(Receiver::new(Protocol::Sbus))
            .ecu(board.telemetry.name, mavlink::LINE, client)
            .at(17 * SECOND, |bench| bench.radio().switch = Position::Standby)
            .at(19 * SECOND, |bench| bench.radio().switch = Position::Run)
            .at(40 * SECOND, |bench| bench.radio().stick = 50)
            .at(RESET, |bench| bench.watchdog_runs_out())
            .resets(2)
            .until(RESET + 6 * SECOND)
            .go_unchecked();
        let texts = format!("{}: {complaints:#?}\n{}", board.name, report.log_text());
        // The audit of the outputs knows only the image's wiring, by which that port is the booster's.
        let by_wiring = ["the valve of left: opens", "the power of booster: off, and run ends"];
        let expected = |complaint: &String| by_wiring.iter().any(|text| complaint.starts_with(text));
        assert!(complaints.iter().all(expected), "{texts}");
        let reset = report.resets[1].0;
        stays(&report, LEFT, LEFT.on, RESET - 3 * SECOND..reset);
        let driven = driven_after(&report, LEFT, reset, LEFT.on);
        stays(&report, LEFT, LEFT.on, driven..report.at);
        stays(&report, BOOSTER, BOOSTER.off(), RESET - 3 * SECOND..reset);
        let closed = driven_after(&report, BOOSTER, reset, BOOSTER.off());
        stays(&report, BOOSTER, BOOSTER.off(), closed..report.at);
        let resumed = report.lines("left: resumed after a reset").filter(|log| log.at > reset).count();
        assert_eq!(resumed, 1, "{texts}");
        assert_eq!(report.ecu::<ZkEcu>(ZK).turbine().phase(), Phase::Running, "{texts}");
    });
}

/// RAM as after a power-up: no record.
fn scramble(bench: &mut Bench<'_>, board: &Board) {
    let retained = symbol(board, Image::Outputs, "__sretained")..symbol(board, Image::Outputs, "__eretained");
    for at in retained.step_by(4) {
        bench.set_word(at, 0x9E37_79B9_u32.wrapping_mul(at as u32));
    }
}

#[test]
fn valve_stays_open_in_flight_over_every_reset_with_a_record() {
    on_each_board(|board| {
        let report = flying(board)
            .at(30 * SECOND, |bench| bench.watchdog_runs_out())
            .at(31 * SECOND, move |bench| crash(bench, board, Image::Outputs))
            .at(33 * SECOND, |bench| bench.brown_out())
            .at(37 * SECOND, move |bench| {
                scramble(bench, board);
                bench.press_reset();
            })
            .resets(4)
            .with_errors()
            .until(41 * SECOND)
            .go();
        let causes: Vec<_> =
            report.lines("last reset: ").map(|log| log.text.rsplit_once(": ").expect("a cause").1).collect();
        assert_eq!(causes, ["power-on", "watchdog", "software", "brown-out", "reset pin"]);
        let resets: Vec<Nanos> = report.resets.iter().map(|reset| reset.0).collect();
        for output in VALVES.into_iter().chain([POWER]) {
            // A crash leaves the pin as it is, until the reset.
            stays(&report, output, output.on, 29 * SECOND..resets[0]);
            for (reset, next) in resets[..3].iter().zip(&resets[1..]) {
                let driven = driven_after(&report, output, *reset, output.on);
                stays(&report, output, output.on, driven..*next);
            }
        }
        // Without a record it is closed until the ECU reports that its engine runs.
        for valve in VALVES {
            let closed = driven_after(&report, valve, resets[3], valve.off());
            let changes = Pin::output(&report, valve.number).changes(closed + 1..report.at);
            assert!(matches!(changes[..], [(_, level)] if level == valve.on), "{}: {changes:?}", valve.name);
            println!("{}, {}: open {} ms later", board.name, valve.name, (changes[0].0 - closed) / MILLIS);
            assert!(changes[0].0 - closed < 2 * SECOND, "{}: {changes:?}", valve.name);
        }
        assert_eq!(phases(&report), [Phase::Running; 2]);
    });
}

/// Behind a bootloader that leaves whatever it may leave, the pins are driven before anything else as well. They float while it runs.
#[test]
fn valve_stays_open_in_flight_over_a_reset_behind_a_bootloader() {
    on_each_board(|board| {
        let bootloader = Bootloader { leaves: Leftover::ALL.to_vec(), ..Bootloader::default() };
        let report = flying_with(board, Image::OutputsArdupilot)
            .bootloader(bootloader)
            .at(30 * SECOND, |bench| bench.watchdog_runs_out())
            .at(31_500 * MILLIS, |bench| bench.brown_out())
            .at(33 * SECOND, |bench| {
                let left = bench.ecu::<AmtEcu>(AMT).turbine().phase();
                assert_eq!([left, bench.ecu::<ZkEcu>(ZK).turbine().phase()], [Phase::Running; 2]);
                bench.radio().switch = Position::Stop;
            })
            .at(34 * SECOND, |bench| bench.watchdog_runs_out())
            .resets(3)
            .with_errors()
            .until(36 * SECOND)
            .go();
        let resets: Vec<Nanos> = report.resets.iter().map(|reset| reset.0).collect();
        for output in VALVES.into_iter().chain([POWER]) {
            stays(&report, output, output.on, 29 * SECOND..resets[0]);
            for (reset, next) in [(resets[0], resets[1]), (resets[1], 33 * SECOND)] {
                let driven = driven_after(&report, output, reset, output.on);
                stays(&report, output, output.on, driven..next);
            }
        }
        // The stop is latched.
        for valve in VALVES {
            let closed = driven_after(&report, valve, resets[2], valve.off());
            stays(&report, valve, valve.off(), closed..report.at);
        }
    });
}

/// By a ground station on the telemetry port, while stick and switch fly on.
#[test]
fn an_emergency_stop_over_mavlink_closes_the_valve_within_10_ms() {
    on_each_board(|board| {
        const STOP: Nanos = 32 * SECOND;
        let telemetry = board.telemetry.name;
        let report =
            flying(board).ecu(telemetry, mavlink::LINE, mavlink::stops(STOP)).until(34 * SECOND).go();
        let mut ends = report.wire(telemetry).rx.iter().filter(|rx| rx.last && rx.end > STOP);
        let stop = ends.next().expect("a frame").end;
        VALVES.into_iter().for_each(|valve| stays(&report, valve, valve.on, 30 * SECOND..STOP));
        valves_close(&report, STOP..report.at, stop..stop + 10 * MILLIS);
    });
}

/// A kind of reset.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Watchdog,
    Software,
    Pin,
    BrownOut,
    /// Nothing is left of the RAM.
    PowerOn,
}

impl Kind {
    const ALL: [Self; 5] = [Self::Watchdog, Self::Software, Self::Pin, Self::BrownOut, Self::PowerOn];

    /// As in the log.
    const fn cause(self) -> &'static str {
        match self {
            Self::Watchdog => "watchdog",
            Self::Software => "software",
            Self::Pin => "reset pin",
            Self::BrownOut => "brown-out",
            Self::PowerOn => "power-on",
        }
    }

    fn happens(self, bench: &mut Bench<'_>, board: &Board) {
        match self {
            Self::Watchdog => bench.watchdog_runs_out(),
            Self::Software => crash(bench, board, Image::Outputs),
            Self::Pin => bench.press_reset(),
            Self::BrownOut => bench.brown_out(),
            Self::PowerOn => {
                scramble(bench, board);
                bench.power_on();
            }
        }
    }
}

/// State of the engines when the part is reset.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum State {
    /// In standby, not started yet.
    AtRest,
    /// In a start.
    Starting,
    Running,
    /// Running, with a wire that has just been cut.
    InDoubt,
    /// Shut down, hot, and turning.
    Cooling,
    StopLatched,
}

/// The resets of a run, each with the state that it meets.
fn reset_in_each(mut run: Run, board: &'static Board, resets: &[(Nanos, State, Kind)], until: Nanos) {
    for &(at, state, kind) in resets {
        if state == State::InDoubt {
            // Three reports are missing at the reset. An AMT ECU shuts down 2 s after its last command.
            for (from, cut) in [(at - 800 * MILLIS, true), (at + 300 * MILLIS, false)] {
                run = run.at(from, move |bench| [AMT, ZK].iter().for_each(|port| bench.cut(port, cut)));
            }
        }
        run = run.at(at, move |bench| {
            let phases =
                [bench.ecu::<AmtEcu>(AMT).turbine().phase(), bench.ecu::<ZkEcu>(ZK).turbine().phase()];
            let which = format!("{}, {state:?}, {kind:?}: {phases:?}", board.name);
            match state {
                State::AtRest => assert_eq!(phases, [Phase::Standby; 2], "{which}"),
                // One engine of a group is started after the other.
                State::Starting => assert!(phases[0].is_starting(), "{which}"),
                State::Running | State::InDoubt => assert_eq!(phases, [Phase::Running; 2], "{which}"),
                State::Cooling | State::StopLatched => {
                    assert!(!phases.iter().any(|phase| phase.is_live()), "{which}");
                }
            }
            kind.happens(bench, board);
        });
    }
    let report = run.resets(resets.len()).with_errors().until(until).go();
    let causes = report.lines("last reset: ").map(|log| log.text.rsplit_once(": ").expect("a cause").1);
    let expected = resets.iter().map(|(_, _, kind)| kind.cause());
    assert_eq!(causes.skip(1).collect::<Vec<_>>(), expected.collect::<Vec<_>>(), "{}", board.name);
    let times = report.resets.iter().map(|reset| reset.0);
    let ends = resets.iter().skip(1).map(|(at, ..)| *at).chain([report.at]);
    for ((reset, end), &(_, state, kind)) in times.zip(ends).zip(resets) {
        let which = format!("{}, {state:?}, {kind:?}", board.name);
        let continues = matches!(state, State::Running | State::InDoubt);
        let recorded = continues && !matches!(kind, Kind::PowerOn);
        for valve in VALVES {
            let level = if recorded { valve.on } else { valve.off() };
            let driven = driven_after(&report, valve, reset, level);
            let changes = Pin::output(&report, valve.number).changes(driven + 1..end.min(reset + SECOND));
            // Without a record it opens once the ECU reports that its engine runs.
            let opens = changes.iter().all(|(_, level)| *level == valve.on) && changes.len() <= 1;
            assert!(
                if continues { opens } else { changes.is_empty() },
                "{which}, {}: {changes:?}",
                valve.name
            );
        }
        // A hot engine keeps its starter's power, also in standby.
        let powered = !matches!(kind, Kind::PowerOn);
        let power = if powered { POWER.on } else { POWER.off() };
        driven_after(&report, POWER, reset, power);
    }
}

/// Every kind of reset in every state: if the engine does not continue, the valve is closed and stays closed; if it does, the valve is driven
/// open before anything else. Only a loss of power that erases the record closes it there, until the ECU is received.
#[test]
fn each_reset_in_each_state_leaves_the_valve_closed_unless_the_engine_continues() {
    on_each_board(|board| {
        // Between two frames of the AMT ECU. Every 2.5 s: an engine that is found is taken over, and its record is whole, until the next.
        let row = |from: Nanos, every: Nanos, state| {
            let times = (0..).map(move |n: Nanos| from + n * every);
            times.zip(Kind::ALL).map(move |(at, kind)| (at, state, kind))
        };
        let running = row(28_060 * MILLIS, 2500 * MILLIS, State::Running);
        let in_doubt = row(42_060 * MILLIS, 3 * SECOND, State::InDoubt);
        let cooling = row(59_060 * MILLIS, 625 * MILLIS, State::Cooling);
        let stopped = row(63_060 * MILLIS, 625 * MILLIS, State::StopLatched);
        let resets: Vec<_> = running.chain(in_doubt).chain(cooling).chain(stopped).collect();
        let run = flying(board)
            .at(58 * SECOND, |bench| bench.radio().switch = Position::Standby)
            .at(62_500 * MILLIS, |bench| bench.radio().switch = Position::Stop);
        reset_in_each(run, board, &resets, 66 * SECOND);
        // At rest and armed, five times; then a start, which a reset ends.
        for kind in Kind::ALL {
            let run = Run::new(board, Image::Outputs)
                .quick_engines()
                .only(&[AMT, ZK])
                .radio(Receiver::new(Protocol::Sbus))
                .at(2 * SECOND, |bench| bench.radio().switch = Position::Standby)
                .at(5 * SECOND, |bench| bench.radio().switch = Position::Stop)
                .at(6500 * MILLIS, |bench| bench.radio().switch = Position::Standby)
                .at(8500 * MILLIS, |bench| bench.radio().switch = Position::Run);
            let resets = [(4060 * MILLIS, State::AtRest, kind), (10_060 * MILLIS, State::Starting, kind)];
            reset_in_each(run, board, &resets, 10_500 * MILLIS);
        }
    });
}

/// The firmware crashes within 0.8 s of each start, again and again. The valve stays open for less than 10 s of it; a start that lives for a
/// second restarts the count; 10 s in a row close it, also when the crashes are over, because the engine is not at rest.
#[test]
fn valve_of_a_firmware_that_fails_at_each_start_is_closed_after_ten_seconds_of_it() {
    on_each_board(|board| {
        const EVERY: Nanos = 700 * MILLIS;
        const FEW: u64 = 12;
        const MANY: u64 = 18;
        const FIRST: Nanos = 27 * SECOND;
        const AGAIN: Nanos = FIRST + FEW * EVERY + 2 * SECOND;
        const OVER: Nanos = AGAIN + MANY * EVERY;
        let times = (0..FEW).map(|n| FIRST + n * EVERY).chain((0..MANY).map(|n| AGAIN + n * EVERY));
        let mut run = flying(board);
        for at in times {
            run = run.at(at, move |bench| crash(bench, board, Image::Outputs));
        }
        let crashes = (FEW + MANY) as usize;
        let report = run.resets(crashes).with_errors().until(OVER + 2 * SECOND).go();
        let resets: Vec<Nanos> = report.resets.iter().map(|reset| reset.0).collect();
        // Time of failed starts in a row before each reset: one that has lived for a second does not count, and ends the series.
        let mut rows = vec![0];
        for pair in resets.windows(2) {
            let lived = pair[1] - pair[0];
            assert!(lived.abs_diff(SECOND) > 100 * MILLIS, "nearly a second: {lived}");
            rows.push(if lived < SECOND { rows[rows.len() - 1] + lived } else { 0 });
        }
        assert!(rows[FEW as usize - 1] > 7 * SECOND && rows[FEW as usize] == 0, "{rows:?}");
        assert!(rows[..crashes - 2].iter().any(|row| *row > 10 * SECOND), "{rows:?}");
        let ends = resets[1..].iter().copied().chain([report.at]);
        for ((reset, row), end) in resets.iter().zip(&rows).zip(ends) {
            if row.abs_diff(10 * SECOND) < 150 * MILLIS {
                // Each start takes some additional milliseconds, so this one may be either.
                continue;
            }
            for valve in VALVES {
                let level = if *row < 10 * SECOND { valve.on } else { valve.off() };
                let driven = driven_after(&report, valve, *reset, level);
                stays(&report, valve, level, driven..end);
            }
            // The starter cools the turbine.
            let driven = driven_after(&report, POWER, *reset, POWER.on);
            stays(&report, POWER, POWER.on, driven..end);
        }
        let closed = rows.iter().filter(|row| **row > 10 * SECOND).count();
        println!("{}: closed for the last {closed} of {crashes} starts", board.name);
        // The log reports the reason, from the first start that finds it closed.
        let first = report.when("left: fuel valve closed: the firmware failed in repeated starts");
        assert!(first > AGAIN + 9 * SECOND, "{first}");
        // Run is ordered throughout.
        assert_eq!(phases(&report), [Phase::Running; 2]);
    });
}

/// The voltage detector resets within a second of each start, for more than 10 s: the firmware has not failed, and the engine keeps its
/// fuel.
#[test]
fn supply_that_chatters_closes_no_valve() {
    const EVERY: Nanos = 700 * MILLIS;
    const FIRST: Nanos = 27 * SECOND;
    const TIMES: u64 = 18;
    let mut run = flying(&PIXRACER);
    for at in (0..TIMES).map(|n| FIRST + n * EVERY) {
        run = run.at(at, |bench| drop_supply(bench, Image::Outputs));
        run = run.at(at + 50 * MILLIS, |bench| bench.supply(3300));
    }
    let report = run.resets(TIMES as usize).with_errors().until(FIRST + TIMES * EVERY + 2 * SECOND).go();
    let resets: Vec<Nanos> = report.resets.iter().map(|reset| reset.0).collect();
    let ends = resets[1..].iter().copied().chain([report.at]);
    for (reset, end) in resets.iter().zip(ends) {
        for output in VALVES.into_iter().chain([POWER]) {
            let driven = driven_after(&report, output, *reset, output.on);
            stays(&report, output, output.on, driven..end);
        }
    }
    assert_eq!(phases(&report), [Phase::Running; 2]);
}

/// Thread mode, which takes stops, hangs within 0.3 s of each start, while the tasks in interrupts keep working: the watchdog
/// bites 1 s after the start.
#[test]
fn valve_of_a_firmware_whose_thread_mode_hangs_at_each_start_is_closed_after_ten_seconds_of_it() {
    on_each_board(|board| {
        const FIRST: Nanos = 27 * SECOND;
        const OVER: Nanos = FIRST + 12_600 * MILLIS;
        const HANGS: usize = 13;
        // `wfi`, and back to it, in place of a handler that nothing calls here.
        let sleep = symbol(board, Image::Outputs, "DefaultHandler");
        let mut run = flying(board).patch(sleep, vec![0xBF30, 0xE7FD]);
        for at in (FIRST..OVER).step_by(100 * MILLIS as usize) {
            run = run.at(at, move |bench| {
                hijack_if_spawned(bench, board, Image::Outputs, Task::Supervisor, sleep);
            });
        }
        let report = run.resets(HANGS).with_errors().until(OVER + 3 * SECOND).go();
        let resets: Vec<Nanos> = report.resets.iter().map(|reset| reset.0).collect();
        for pair in resets.windows(2) {
            assert!((SECOND..1100 * MILLIS).contains(&(pair[1] - pair[0])), "{resets:?}");
        }
        let ends = resets[1..].iter().copied().chain([report.at]);
        for ((hangs, reset), end) in (1..).zip(&resets).zip(ends) {
            for valve in VALVES {
                let level = if hangs < 10 { valve.on } else { valve.off() };
                let driven = driven_after(&report, valve, *reset, level);
                stays(&report, valve, level, driven..end);
            }
            let driven = driven_after(&report, POWER, *reset, POWER.on);
            stays(&report, POWER, POWER.on, driven..end);
        }
    });
}

/// ZK from version 5 runs on without its wire: only the valve stops it. While run is ordered, nothing closes it.
#[test]
fn valve_closes_when_an_ordered_standby_is_not_obeyed_and_never_while_run_is_ordered() {
    on_each_board(|board| {
        const CUT: Nanos = 30 * SECOND;
        const STANDBY: Nanos = 38 * SECOND;
        let report = flying(board)
            .at(CUT, |bench| bench.cut(ZK, true))
            .at(STANDBY, |bench| bench.radio().switch = Position::Standby)
            .until(46 * SECOND)
            .go();
        stays(&report, BOOSTER, BOOSTER.on, CUT..STANDBY);
        let changes = Pin::output(&report, BOOSTER.number).changes(STANDBY..report.at);
        assert!(matches!(changes[..], [(_, level)] if level == BOOSTER.off()), "{changes:?}");
        let took = changes[0].0 - STANDBY;
        println!("{}: closed {:.1} s after standby", board.name, took as f64 / 1e9);
        assert!((5000 * MILLIS..5400 * MILLIS).contains(&took), "{took}");
        assert_eq!(report.ecu::<ZkEcu>(ZK).turbine().phase(), Phase::Running, "it does not receive it");
    });
}
