//! A receiver of radio control on its port, SBUS or CRSF: line settings, an AMT and a ZK turbine by stick and switch, and a receiver that is
//! lost, unplugged or plugged in at full throttle.

use crate::mavlink;
use crate::outputs;
use crate::reply_time::GARBAGE;
use crate::support::{amt, on_all_boards, on_boards, on_each_board};
use emulation::board::Part;
use emulation::engines::{self, Engine};
use emulation::receiver::{Position, Protocol, Receiver};
use emulation::{Board, Fate, Image, Report, Run, turnaround};
use sim::amt::{AmtEcu, Ops};
use sim::ecu::{MILLIS, Nanos, SECOND};
use sim::line::Line;
use sim::turbine::Phase;
use sim::zk::{Sw, ZkCommand, ZkEcu};

/// Both protocols, each with an image that also has a valve for each engine.
const BOTH: [(Protocol, Image); 2] = [(Protocol::Sbus, Image::Outputs), (Protocol::Crsf, Image::RadioCrsf)];

/// The same on a board's socket for a receiver.
const ON_SOCKET: [(Protocol, Image); 2] =
    [(Protocol::Sbus, Image::RadioSocket), (Protocol::Crsf, Image::RadioSocketCrsf)];

/// Those that a board has.
fn receivers(board: &Board) -> impl Iterator<Item = (Protocol, Image)> {
    BOTH.into_iter().chain(ON_SOCKET).filter(|which| Image::of(board).any(|image| image == which.1))
}

/// Ports of an AMT engine, "left", and of a ZK engine, "booster", on the first board of each part.
pub const AMT: &str = "SERIAL2";
pub const ZK: &str = "SERIAL5";

/// The last engine of an image with a receiver, a ZK engine: "booster", or on a Cube Orange "centre".
fn zk(board: &'static Board) -> Engine {
    engines::of(board, Image::Outputs).pop().expect("engines")
}

/// Every line at once.
const ALL_FULL: &str = "all lines full";

/// An order that an ECU obeyed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    Stop,
    Standby,
    /// With this demand in 0.1 %.
    Run(u16),
}

/// Orders on both ports, with their times.
pub fn orders(report: &Report) -> [Vec<(Nanos, Order)>; 2] {
    let amt = report.ecu::<AmtEcu>(AMT).commands.iter().map(|(at, command)| {
        let order = match command.ops {
            Ops::EmergencyStop => Order::Stop,
            Ops::AutoStop => Order::Standby,
            Ops::Run => Order::Run(5 * u16::from(command.throttle_half_percent)),
            Ops::Ctf => panic!("{command:?}"),
        };
        (*at, order)
    });
    let zk = report.ecu::<ZkEcu>(zk(report.board).port).commands.iter().filter_map(|(at, command)| {
        let order = match command {
            ZkCommand::Control { sw: Sw::Stop, .. } => Order::Stop,
            ZkCommand::Control { sw: Sw::Standby, .. } => Order::Standby,
            ZkCommand::Control { sw: Sw::Run, throttle } => Order::Run(*throttle),
            _ => return None,
        };
        Some((*at, order))
    });
    [amt.collect(), zk.collect()]
}

/// The last order until then.
pub fn order_at(orders: &[(Nanos, Order)], at: Nanos) -> Order {
    orders.iter().rfind(|(each, _)| *each < at).expect("orders").1
}

pub fn phases(report: &Report) -> [Phase; 2] {
    let zk = report.ecu::<ZkEcu>(zk(report.board).port).turbine().phase();
    [report.ecu::<AmtEcu>(AMT).turbine().phase(), zk]
}

/// Both engines, at rest, and a receiver.
fn run(board: &'static Board, (protocol, image): (Protocol, Image)) -> Run {
    Run::new(board, image).quick_engines().only(&[AMT, zk(board).port]).radio(Receiver::new(protocol))
}

/// 50.0 %, to the resolution of both protocols.
pub fn is_half(order: Order) -> bool {
    matches!(order, Order::Run(495..=505))
}

/// A flight by stick and switch. In it the transmitter goes off and comes back with the stick where it was, the receiver is unplugged
/// and plugged in again, and the switch goes to stop.
#[test]
fn stick_and_switch_fly_two_turbines_and_a_lost_receiver_is_silence_without_a_jump() {
    on_all_boards(|board| {
        for which in receivers(board) {
            const OFF: Nanos = 28 * SECOND;
            const BACK: Nanos = 31_500 * MILLIS;
            const AT_IDLE: Nanos = 33_500 * MILLIS;
            const UP: Nanos = 34_500 * MILLIS;
            const UNPLUGGED: Nanos = 36 * SECOND;
            const PLUGGED_IN: Nanos = 39_500 * MILLIS;
            const STOP: Nanos = 41 * SECOND;
            let (radio, zk) = (which.1.radio(board), zk(board));
            let report = run(board, which)
                .at(3 * SECOND, |bench| bench.radio().switch = Position::Standby)
                .at(5 * SECOND, |bench| bench.radio().switch = Position::Run)
                .at(26 * SECOND, |bench| bench.radio().stick = 50)
                .at(OFF, |bench| bench.radio().transmitter = false)
                .at(BACK, |bench| bench.radio().transmitter = true)
                .at(AT_IDLE, |bench| bench.radio().stick = 0)
                .at(UP, |bench| bench.radio().stick = 50)
                .at(UNPLUGGED, move |bench| bench.power(radio, false))
                .at(PLUGGED_IN, move |bench| bench.power(radio, true))
                .at(STOP, move |bench| {
                    let left = bench.ecu::<AmtEcu>(AMT).turbine().phase();
                    let phases = [left, bench.ecu::<ZkEcu>(zk.port).turbine().phase()];
                    assert_eq!(phases, [Phase::Running; 2]);
                    bench.radio().switch = Position::Stop;
                })
                .until(43 * SECOND)
                .go();
            outputs::stop_closes_the_valves_within_10_ms(&report, which.0, STOP);
            let which = format!("{}, {:?} on {radio}", board.name, which.0);
            for (name, orders) in ["left", zk.name].into_iter().zip(orders(&report)) {
                let orders_in = |from, to| orders.iter().filter(move |(at, _)| (from..to).contains(at));
                let before = orders_in(0, 5 * SECOND).all(|(_, order)| !matches!(order, Order::Run(_)));
                assert!(before, "{which}, {name}");
                let running = report.when(&format!("{name}: ECU reports running"));
                println!("{which}, {name}: runs at {:.1} s", running as f64 / 1e9);
                // The source timeout of 0.5 s and the hold of 1 s, then down to idle at 50 % a second.
                assert!(
                    orders_in(OFF, OFF + 1400 * MILLIS).all(|(_, order)| is_half(*order)),
                    "{which}, {name}"
                );
                assert_eq!(order_at(&orders, BACK), Order::Run(0), "{which}, {name}");
                // The stick has to come close to the demand.
                let idle = orders_in(BACK, AT_IDLE).all(|(_, order)| *order == Order::Run(0));
                assert!(idle, "{which}, {name}: {:?}", orders_in(BACK, AT_IDLE).collect::<Vec<_>>());
                assert!(is_half(order_at(&orders, UNPLUGGED)), "{which}, {name}: in control again");
                // Plugged in with the stick up it is silent, or has to come to idle first.
                assert_eq!(order_at(&orders, PLUGGED_IN), Order::Run(0), "{which}, {name}");
                let idle = orders_in(PLUGGED_IN, STOP).all(|(_, order)| *order == Order::Run(0));
                assert!(idle, "{which}, {name}: {:?}", orders_in(PLUGGED_IN, STOP).collect::<Vec<_>>());
                let stop = |(at, order): &&(Nanos, Order)| *at > STOP && *order == Order::Stop;
                let (at, _) = orders.iter().find(stop).expect("stop");
                println!("{which}, {name}: stop {:.1} ms after the switch", (at - STOP) as f64 / 1e6);
                // Two frames have to agree. An AMT ECU receives the command in the next reply, at its eight frames a second.
                assert!(at - STOP < 200 * MILLIS, "{which}, {name}: {} ms", (at - STOP) / MILLIS);
                assert!(orders_in(*at, report.at).all(|(_, order)| *order == Order::Stop), "{which}, {name}");
            }
            assert!(phases(&report).iter().all(|phase| *phase != Phase::Running), "{:?}", phases(&report));
        }
    });
}

/// Full throttle with the switch at run allowed: at power-up, when it is plugged in, and when it is moved from stop past standby.
#[test]
fn a_receiver_plugged_in_at_full_throttle_starts_nothing() {
    on_each_board(|board| {
        for which in receivers(board) {
            let radio = which.1.radio(board);
            let report = run(board, which)
                .at(0, |bench| {
                    let radio = bench.radio();
                    (radio.stick, radio.switch) = (100, Position::Run);
                })
                .at(4 * SECOND, move |bench| bench.power(radio, false))
                .at(6 * SECOND, move |bench| bench.power(radio, true))
                .at(9 * SECOND, |bench| bench.radio().switch = Position::Stop)
                .at(10 * SECOND, |bench| bench.radio().switch = Position::Standby)
                .at(12 * SECOND, |bench| bench.radio().switch = Position::Run)
                // The stick comes to idle afterwards.
                .at(14 * SECOND, |bench| bench.radio().stick = 0)
                .until(16 * SECOND)
                .go();
            assert!(report.logged("radio control: receiving frames"));
            for orders in orders(&report) {
                assert!(orders.iter().all(|(_, order)| !matches!(order, Order::Run(_))), "{}", board.name);
                // The stop at 9 s arrived: the switch works.
                assert!(orders.iter().any(|(_, order)| *order == Order::Stop), "{}", board.name);
            }
        }
    });
}

/// The emulated UART carries words whatever the parity and level, so the test checks the registers. The byte times are checked at
/// every run, with parity and both stop bits.
#[test]
fn the_port_of_a_receiver_has_its_line_settings() {
    on_all_boards(|board| {
        for which in receivers(board) {
            let port = *board.port(which.1.radio(board));
            let socket = board.socket.filter(|_| which.1.is_on_socket());
            let is_sbus = which.0 == Protocol::Sbus;
            let report = run(board, which).until(SECOND).at(SECOND / 2, move |bench| {
                let control = port.registers() + board.control_register;
                let [cr1, cr2] = [0, 4].map(|offset| bench.register(control + offset).expect("a UART"));
                // PCE, PS and M or M0; STOP (RM0090, 30.6; RM0433, 48.8).
                assert_eq!(cr1 >> 9 & 0b1011, if is_sbus { 0b1010 } else { 0 }, "{}: {cr1:#x}", board.name);
                assert_eq!(cr2 >> 12 & 0b11, if is_sbus { 0b10 } else { 0 }, "{}: {cr2:#x}", board.name);
                // RE and TE: a socket only receives.
                assert_eq!(
                    cr1 >> 2 & 0b11,
                    if socket.is_some() { 0b01 } else { 0b11 },
                    "{}: {cr1:#x}",
                    board.name
                );
                if let Some(socket) = socket {
                    let (port, number) = socket.inverter;
                    let levels = bench.register(board.gpio + 0x400 * u64::from(port as u8 - b'A') + 0x14);
                    let inverts = (levels.expect("GPIO") >> number & 1 == 1) == socket.inverts_at;
                    assert_eq!(inverts, is_sbus, "{}", board.name);
                }
                // RXINV; PUPDR of RX: down where the idle level is low.
                let inverted = is_sbus && board.inverts;
                assert_eq!(board.inverts, board.part == Part::H743);
                if board.inverts {
                    assert_eq!(cr2 >> 16 & 0b11, if inverted { 1 } else { 0 }, "{}: {cr2:#x}", board.name);
                }
                let gpio = board.gpio + 0x400 * u64::from(port.rx.port as u8 - b'A');
                let pulls = bench.register(gpio + 0x0C).expect("GPIO");
                let pull = pulls >> (2 * port.rx.number) & 0b11;
                assert_eq!(pull, if inverted { 0b10 } else { 0b01 }, "{}: {pulls:#x}", board.name);
            });
            let report = report.go();
            let wire = report.wire(which.1.radio(board));
            assert!(!wire.rx.is_empty() && wire.tx.is_empty(), "{}", board.name);
            assert!(report.logged("radio control: receiving frames"), "{}, {which:?}", board.name);
        }
    });
}

/// A line that the inverter of the socket turns the wrong way brings nothing: neither an image for SBUS with a receiver that is not inverted, nor one
/// for CRSF with an inverted one, nor an image whose receiver is elsewhere; and one that is right stops where the pin of the inverter changes.
#[test]
fn a_socket_receives_only_while_its_inverter_fits_the_line() {
    on_boards(
        |board| board.socket.is_some(),
        |board| {
            // A frame that begins right after a change is on its way when the run gets to it.
            const SETTLES: Nanos = 10 * MILLIS;
            let socket = board.socket.expect("a socket");
            let received = |report: &Report, from: Nanos, to: Nanos| {
                let bytes = report.wire(socket.port.name).rx.iter();
                bytes.filter(|rx| rx.fate == Fate::Received && (from..to).contains(&rx.start)).count()
            };
            for (protocol, image) in ON_SOCKET {
                for wrong in [true, false] {
                    let mut receiver = Receiver::new(protocol);
                    receiver.inverted ^= wrong;
                    let run = Run::new(board, image).quick_engines().only(&[AMT, zk(board).port]);
                    let report = run
                        .radio(receiver)
                        .at(2 * SECOND, move |bench| {
                            bench.set_pin(socket.inverter, (protocol == Protocol::Crsf) == socket.inverts_at);
                        })
                        .at(3 * SECOND, move |bench| {
                            bench.set_pin(socket.inverter, (protocol == Protocol::Sbus) == socket.inverts_at);
                        })
                        .until(4 * SECOND)
                        .go();
                    let [before, meanwhile, after] = [(0, 2), (2, 3), (3, 4)]
                        .map(|(from, to)| received(&report, from * SECOND + SETTLES, to * SECOND) > 0);
                    let text = format!("{}, {protocol:?}, wrong: {wrong}", board.name);
                    assert_eq!([before, meanwhile, after], [!wrong, wrong, !wrong], "{text}");
                }
            }
            // The receiver is on an ECU port in this one.
            let receiver = Receiver::new(Protocol::Sbus);
            let run = Run::new(board, Image::Outputs).quick_engines().only(&[AMT, zk(board).port]);
            let report = run.ecu(socket.port.name, receiver.line(), receiver).until(SECOND).go();
            assert_eq!(received(&report, 0, SECOND), 0);
            assert!(!report.logged("receiving frames"));
        },
    );
}

/// How long a reply takes beside a receiver: with none, at its usual pace, with a line that is full, and with every other line full,
/// too: the telemetry port's, where settings are written, and those of all other ECUs.
#[test]
fn the_worst_reply_beside_a_busy_receiver_is_far_inside_the_window() {
    on_each_board(|board| {
        let without = [(BOTH[0], "no receiver")];
        let with = receivers(board)
            .flat_map(|which| ["usual pace", "line full", ALL_FULL].map(|load| (which, load)));
        for ((protocol, image), load) in without.into_iter().chain(with) {
            let receiver = Receiver::new(protocol);
            let frame = receiver.frame();
            let line = Line::n1(2400);
            // An odd period, so that the frames coincide with everything else in every way.
            let olympus = amt(board, image, AMT, |ecu| ecu.period = 61_003_000);
            let mut run = Run::new(board, image).engines().ecu(AMT, line, olympus).tap(AMT);
            if load != "no receiver" {
                run = run.radio(receiver);
            }
            if [ALL_FULL, "line full"].contains(&load) {
                run = run.at(SECOND, move |bench| bench.babble(image.radio(board), Some(&frame)));
            }
            let mut until = 8 * SECOND;
            if load == ALL_FULL {
                let titan = amt(board, image, "SERIAL3", |ecu| ecu.period = 48_017_000);
                run = run
                    .ecu("SERIAL3", line, titan)
                    .ecu(board.telemetry.name, mavlink::LINE, mavlink::flood())
                    .at(SECOND, |bench| {
                        bench.babble("SERIAL4", Some(&GARBAGE));
                        bench.babble(ZK, Some(&GARBAGE));
                    });
                // The flood of settings begins after 8 s.
                until = 14 * SECOND;
            }
            let report = run.until(until).go();
            let stats = report.ecu::<AmtEcu>(AMT).stats;
            // The set-up frame is longer than this period, so the next frame comes into the reply to it.
            let in_order = stats.late == 0 && stats.none <= 1 && stats.unsolicited <= 1;
            assert!(in_order, "{stats:?}");
            let all = turnaround::of(&report, AMT);
            let worst = all.iter().filter(|each| each.frame_end > SECOND).max_by_key(|each| each.ns);
            let worst = worst.expect("a reply");
            println!(
                "| {} | {} | {protocol:?} on {}, {load} | {:.1} % | {} | {} | {} |",
                board.name,
                report.instructions_per_second / 1_000_000,
                image.radio(board),
                report.load(),
                all.len(),
                worst.ns,
                worst.slots
            );
            assert!(worst.ns < MILLIS, "{}, {load}: {} ns", board.name, worst.ns);
        }
    });
}
