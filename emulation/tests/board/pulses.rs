//! Servo pulses on the timer of the board: an AMT and a ZK turbine by stick and switch, and wires that break, carry noise, or are plugged
//! in at full throttle.

use crate::mavlink;
use crate::radio::{AMT, Order, ZK, is_half, order_at, orders, phases};
use crate::reply_time::GARBAGE;
use crate::support::{amt, on_each_board};
use emulation::pins::{Level, Pin};
use emulation::receiver::Position;
use emulation::{Board, Image, PulseReceiver, Report, Run, engines, turnaround};
use sim::amt::AmtEcu;
use sim::ecu::{MILLIS, Nanos, SECOND};
use sim::line::Line;
use sim::turbine::Phase;

/// Both engines, at rest, and a receiver.
fn run(board: &'static Board) -> Run {
    Run::new(board, Image::RadioPwm).quick_engines().only(&[AMT, ZK]).pulses(PulseReceiver::new())
}

/// The same with engines that run from 26 s on.
fn flight(board: &'static Board) -> Run {
    run(board)
        .at(3 * SECOND, |bench| bench.pulses().switch = Position::Standby)
        .at(5 * SECOND, |bench| bench.pulses().switch = Position::Run)
        .at(26 * SECOND, |bench| {
            let left = bench.ecu::<AmtEcu>(AMT).turbine().phase();
            assert_eq!(left, Phase::Running);
        })
}

/// Orders of both engines with their names.
fn named(report: &Report) -> impl Iterator<Item = (&'static str, Vec<(Nanos, Order)>)> {
    ["left", "booster"].into_iter().zip(orders(report))
}

/// Orders within this time.
fn within(orders: &[(Nanos, Order)], from: Nanos, to: Nanos) -> impl Iterator<Item = &(Nanos, Order)> {
    orders.iter().filter(move |(at, _)| (from..to).contains(at))
}

#[test]
fn pulses_fly_two_turbines_and_a_receiver_without_them_is_silence_without_a_jump() {
    on_each_board(|board| {
        const STEPS: [u16; 6] = [10, 33, 77, 100, 3, 50];
        const OFF: Nanos = 36 * SECOND;
        const BACK: Nanos = 39_500 * MILLIS;
        const STOP: Nanos = 42 * SECOND;
        let steps = STEPS.into_iter().zip((26..).map(|second| second * SECOND + SECOND / 2));
        let run = steps
            .clone()
            .fold(flight(board), |run, (stick, at)| run.at(at, move |bench| bench.pulses().stick = stick));
        let report = run
            .at(OFF, |bench| bench.pulses().transmitter = false)
            .at(BACK, |bench| bench.pulses().transmitter = true)
            .at(STOP, |bench| bench.pulses().switch = Position::Stop)
            .until(44 * SECOND)
            .go();
        for (name, orders) in named(&report) {
            let which = format!("{}, {name}", board.name);
            let before = within(&orders, 0, 5 * SECOND).all(|(_, order)| !matches!(order, Order::Run(_)));
            assert!(before, "{which}");
            for (stick, at) in steps.clone() {
                let wanted = 10 * stick;
                let order = order_at(&orders, at + 900 * MILLIS);
                // Pulses are measured to 1 µs of 800, and an AMT ECU has steps of 0.5 %.
                let Order::Run(ordered) = order else { panic!("{which}: {order:?}") };
                assert!(ordered.abs_diff(wanted) <= 5, "{which}: {ordered} and not {wanted}");
            }
            let held = within(&orders, OFF, OFF + 1400 * MILLIS).all(|(_, order)| is_half(*order));
            assert!(held, "{which}");
            // The stick is up: it first has to come close to the demand.
            assert_eq!(order_at(&orders, BACK), Order::Run(0), "{which}");
            let idle = within(&orders, BACK, STOP).all(|(_, order)| *order == Order::Run(0));
            assert!(idle, "{which}: {:?}", within(&orders, BACK, STOP).collect::<Vec<_>>());
            let stop = orders.iter().find(|(at, order)| *at > STOP && *order == Order::Stop);
            let (at, _) = stop.expect("stop");
            println!("{which}: stop {:.1} ms after the switch", (at - STOP) as f64 / 1e6);
            assert!(at - STOP < 200 * MILLIS, "{which}: {} ms", (at - STOP) / MILLIS);
            assert!(within(&orders, *at, report.at).all(|(_, order)| *order == Order::Stop), "{which}");
        }
        assert!(phases(&report).iter().all(|phase| *phase != Phase::Running), "{:?}", phases(&report));
    });
}

/// Both in one image: the inputs use four of the outputs, and valves are on the remaining ones: that of "left" on both boards, which the
/// stop closes within 10 ms of the second pulse with it, and over a reset. No output is on an input.
#[test]
fn pulses_open_and_close_a_valve_on_an_output_that_is_not_an_input() {
    on_each_board(|board| {
        const STOP: Nanos = 12 * SECOND;
        const RESET: Nanos = 13 * SECOND;
        let report = run(board)
            .at(3 * SECOND, |bench| bench.pulses().switch = Position::Standby)
            .at(5 * SECOND, |bench| bench.pulses().switch = Position::Run)
            .at(STOP, |bench| bench.pulses().switch = Position::Stop)
            .at(RESET, |bench| bench.watchdog_runs_out())
            .resets(1)
            .until(14 * SECOND)
            .go();
        let free = Image::RadioPwm.outputs(board);
        assert_eq!(free.len(), board.outputs.len() - 4, "{}", board.name);
        let valve = Pin::output(&report, free[0]);
        let reset = report.resets[0].0;
        let changes = valve.changes(SECOND..reset);
        let levels: Vec<Level> = changes.iter().map(|(_, level)| *level).collect();
        assert_eq!(levels, [Level::High, Level::Low], "{}: {changes:?}", board.name);
        let (opened, closed) = (changes[0].0, changes[1].0);
        assert!((5 * SECOND..8 * SECOND).contains(&opened), "{}: {opened}", board.name);
        // The median of three pulses, 20 ms apart, follows the second one.
        println!("{}: closed {:.1} ms after the switch", board.name, (closed - STOP) as f64 / 1e6);
        assert!((STOP..STOP + 60 * MILLIS).contains(&closed), "{}: {closed}", board.name);
        let after = valve.changes(reset + 1..report.at);
        assert!(matches!(after[..], [(_, Level::Low)]), "{}: {after:?}", board.name);
        for number in (0..board.outputs.len()).filter(|number| !free.contains(number)) {
            assert_eq!(Pin::output(&report, number).driven(), None, "{}, output {number}", board.name);
        }
    });
}

/// Full throttle with the switch at run allowed: at power-up, when it is plugged in, and when it is moved from stop past standby.
#[test]
fn pulses_of_full_throttle_start_nothing() {
    on_each_board(|board| {
        let report = run(board)
            .at(0, |bench| {
                let pulses = bench.pulses();
                (pulses.stick, pulses.switch) = (100, Position::Run);
            })
            .at(4 * SECOND, |bench| bench.pulses().wires = [false; 4])
            .at(6 * SECOND, |bench| bench.pulses().wires = [true; 4])
            .at(9 * SECOND, |bench| bench.pulses().switch = Position::Stop)
            .at(10 * SECOND, |bench| bench.pulses().switch = Position::Standby)
            .at(12 * SECOND, |bench| bench.pulses().switch = Position::Run)
            .at(14 * SECOND, |bench| bench.pulses().stick = 0)
            .until(16 * SECOND)
            .go();
        assert!(report.logged("radio control: receiving frames"));
        for (name, orders) in named(&report) {
            let starts = orders.iter().any(|(_, order)| matches!(order, Order::Run(_)));
            assert!(!starts, "{}, {name}", board.name);
            // The stop at 9 s arrived: the switch works.
            assert!(orders.iter().any(|(_, order)| *order == Order::Stop), "{}, {name}", board.name);
        }
    });
}

/// The wire of the throttle, then that of the switch: each one alone is silence for both engines, and neither stops nor moves an
/// engine. A stop counts without the wire of the throttle. Widths and rates that no receiver sends are also silence.
#[test]
fn a_broken_wire_and_pulses_that_no_receiver_sends_are_silence() {
    on_each_board(|board| {
        const THROTTLE: Nanos = 28 * SECOND;
        const SWITCH: Nanos = 37 * SECOND;
        const SLOW: Nanos = 46 * SECOND;
        const STOP: Nanos = 55 * SECOND;
        let back = |run: Run, at: Nanos| {
            // The stick comes close to the demand. A lost source is in control again after 3 s; then the stick goes up.
            run.at(at, |bench| {
                let pulses = bench.pulses();
                (pulses.wires, pulses.period, pulses.stick) = ([true; 4], 20 * MILLIS, 0);
            })
            .at(at + 4 * SECOND, |bench| bench.pulses().stick = 50)
        };
        let run = flight(board)
            .at(26_500 * MILLIS, |bench| bench.pulses().stick = 50)
            .at(THROTTLE, |bench| bench.pulses().wires[0] = false)
            .at(SWITCH, |bench| bench.pulses().wires[1] = false)
            // 10 Hz
            .at(SLOW, |bench| bench.pulses().period = 100 * MILLIS)
            .at(STOP - SECOND, |bench| bench.pulses().wires[0] = false)
            .at(STOP, |bench| bench.pulses().switch = Position::Stop);
        let run = [THROTTLE, SWITCH, SLOW].into_iter().fold(run, |run, at| back(run, at + 3 * SECOND));
        let report = run.until(57 * SECOND).go();
        for (name, orders) in named(&report) {
            let which = format!("{}, {name}", board.name);
            for lost in [THROTTLE, SWITCH, SLOW] {
                let before: Vec<_> = within(&orders, lost - 3 * SECOND, lost).collect();
                assert!(is_half(order_at(&orders, lost)), "{which}: {before:?}\n{}", report.log_text());
                let held = within(&orders, lost, lost + 1400 * MILLIS).all(|(_, order)| is_half(*order));
                assert!(held, "{which}, {lost}");
                assert_eq!(order_at(&orders, lost + 3 * SECOND), Order::Run(0), "{which}, {lost}");
            }
            let stop = orders.iter().find(|(at, order)| *at > STOP && *order == Order::Stop);
            let (at, _) = stop.expect("stop");
            // It is held for 0.3 s beside a throttle that cannot be read.
            assert!((300 * MILLIS..800 * MILLIS).contains(&(at - STOP)), "{which}: {}", at - STOP);
        }
    });
}

/// Noise on an input beside those in use, at 50 000 edges a second, while every line is full: its input rests, the others work, every reply
/// is in its window, and a stop closes the valve within 10 ms of the second pulse with it.
#[test]
fn noise_on_an_input_beside_full_lines_delays_no_reply_no_stick_and_no_valve() {
    on_each_board(|board| {
        const NOISE: Nanos = 28 * SECOND;
        const STOP: Nanos = 32 * SECOND;
        let line = Line::n1(2400);
        let titan = amt(board, Image::RadioPwm, "SERIAL3", |ecu| ecu.period = 48_017_000);
        let centre = engines::on(board, Image::RadioPwm, "SERIAL4");
        // Engines on the other ports would start first.
        let others = ["SERIAL3", "SERIAL4"];
        let report = flight(board)
            .tap(AMT)
            .ecu("SERIAL3", line, titan)
            .ecu("SERIAL4", centre.line, centre.config().ecu())
            .ecu(board.telemetry.name, mavlink::LINE, mavlink::flood())
            .at(MILLIS, move |bench| others.into_iter().for_each(|port| bench.power(port, false)))
            .at(NOISE, move |bench| {
                bench.pulses().noise = Some(20_000);
                others.into_iter().for_each(|port| bench.power(port, true));
                bench.babble("SERIAL4", Some(&GARBAGE));
            })
            .at(30 * SECOND, |bench| bench.pulses().stick = 50)
            .at(STOP, |bench| bench.pulses().switch = Position::Stop)
            .until(33 * SECOND)
            .go();
        for (name, orders) in named(&report) {
            assert!(is_half(order_at(&orders, STOP)), "{}, {name}", board.name);
            let stop = orders.iter().any(|(at, order)| *at > STOP && *order == Order::Stop);
            assert!(stop, "{}, {name}", board.name);
        }
        let valve = Pin::output(&report, Image::RadioPwm.outputs(board)[0]);
        let changes = valve.changes(NOISE..report.at);
        let [(closed, Level::Low)] = changes[..] else { panic!("{}: {changes:?}", board.name) };
        // Frames are 20 ms apart. The switch is on channel 2, whose second pulse has ended by then.
        let second = STOP + 45 * MILLIS;
        println!("{}: closed {:.1} ms after the switch", board.name, (closed - STOP) as f64 / 1e6);
        assert!((STOP..second + 10 * MILLIS).contains(&closed), "{}: {closed}", board.name);
        // The log shows it, and that the other pulses are good.
        let rests: Vec<Nanos> =
            report.lines("radio control: noise on a pulse input, ").map(|line| line.at).collect();
        assert!(rests.len() > 2 && rests[0] > NOISE, "{}", report.log_text());
        let received =
            report.lines("radio control: ").any(|line| line.text.contains(" good, 0 of them without a link"));
        assert!(received, "{}", report.log_text());
        let stats = report.ecu::<AmtEcu>(AMT).stats;
        assert!(stats.late == 0 && stats.none <= 1 && stats.unsolicited <= 1, "{}: {stats:?}", board.name);
        let all = turnaround::of(&report, AMT);
        for (what, from, to) in [
            ("pulses", SECOND, 8 * SECOND),
            ("pulses, the telemetry line full", 8 * SECOND, NOISE),
            ("pulses and noise, all lines full", NOISE, report.at),
        ] {
            let those = all.iter().filter(|each| (from..to).contains(&each.frame_end));
            let worst = those.map(|each| each.ns).max().expect("a reply");
            println!("| {} | {what} | {worst} ns | load {:.1} % |", board.name, report.load());
            assert!(worst < MILLIS, "{}, {what}: {worst} ns", board.name);
        }
    });
}
