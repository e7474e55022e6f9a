//! MAVLink on the telemetry port: an autopilot and a ground station at the other end of the wire list parameters, set some, start
//! an engine, give it throttle and stop it.
//!
//! Their frames are built and read here, from the description of MAVLink, not with the firmware's code.

use crate::support::{amt_engines, on_all_boards, on_boards, on_each_board, others_are_well};
use emulation::receiver::{Position, Protocol, Receiver};
use emulation::{Board, Fram, Image, Report, Run};
use sim::amt::{AmtEcu, EngineModel, Ops};
use sim::any::AnyConfig;
use sim::ecu::{Ecu, LineFault, MILLIS, Nanos, SECOND};
use sim::line::Line;
use sim::turbine::Phase;
use sim::zk::ZkEcu;
use std::collections::BTreeMap;

pub const LINE: Line = Line::n1(57_600);
const VEHICLE: u8 = 7;
const AUTOPILOT: (u8, u8) = (VEHICLE, 1);
const GROUND: (u8, u8) = (255, 190);
const NODE: u8 = 25;
/// Component of the engine "left".
const LEFT: u8 = 26;

/// A message: number, checksum seed and length of the payload without extensions.
type Kind = (u32, u8, usize);
const HEARTBEAT: Kind = (0, 50, 9);
const PARAM_REQUEST_READ: Kind = (20, 214, 20);
const PARAM_REQUEST_LIST: Kind = (21, 159, 2);
const PARAM_VALUE: Kind = (22, 220, 25);
const PARAM_SET: Kind = (23, 168, 23);
const SERVO_OUTPUT_RAW: Kind = (36, 222, 21);
const COMMAND_LONG: Kind = (76, 152, 33);
const COMMAND_ACK: Kind = (77, 143, 3);
const EFI_STATUS: Kind = (225, 208, 65);
const NAMED_VALUE_FLOAT: Kind = (251, 170, 18);
const STATUSTEXT: Kind = (253, 83, 51);
/// Messages that the node may send.
const KINDS: [Kind; 7] =
    [HEARTBEAT, PARAM_VALUE, COMMAND_LONG, COMMAND_ACK, EFI_STATUS, NAMED_VALUE_FLOAT, STATUSTEXT];

const START: u16 = 223;
const ACCEPTED: u8 = 0;
const TEMPORARILY_REJECTED: u8 = 1;

/// The checksum of MAVLink (CRC-16/MCRF4XX) over a frame without its first byte, and the seed.
fn checksum(bytes: &[u8], seed: u8) -> u16 {
    bytes.iter().chain([&seed]).fold(0xFFFF, |mut crc: u16, &byte| {
        crc ^= u16::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0x8408 } else { crc >> 1 };
        }
        crc
    })
}

/// A frame of MAVLink 2, without the truncation of zeros that the node applies.
fn frame(from: (u8, u8), (number, seed, length): Kind, payload: &[u8]) -> Vec<u8> {
    assert_eq!(payload.len(), length, "message {number}");
    let number = number.to_le_bytes();
    let mut frame = vec![0xFD, length as u8, 0, 0, 0, from.0, from.1, number[0], number[1], number[2]];
    frame.extend(payload);
    let crc = checksum(&frame[1..], seed);
    frame.extend(crc.to_le_bytes());
    frame
}

fn heartbeat(from: (u8, u8), kind: u8, autopilot: u8, armed: bool) -> Vec<u8> {
    frame(from, HEARTBEAT, &[0, 0, 0, 0, kind, autopilot, u8::from(armed) << 7, 4, 3])
}

fn servos(now: Nanos, pulse: u16) -> Vec<u8> {
    let mut payload = ((now / 1000) as u32).to_le_bytes().to_vec();
    (0..8).for_each(|_| payload.extend(pulse.to_le_bytes()));
    payload.push(0);
    frame(AUTOPILOT, SERVO_OUTPUT_RAW, &payload)
}

fn command(component: u8, number: u16, first: f32) -> Vec<u8> {
    command_of_two(component, number, [first, 0.0])
}

fn command_of_two(component: u8, number: u16, [first, second]: [f32; 2]) -> Vec<u8> {
    let mut payload: Vec<u8> =
        [first, second, 0.0, 0.0, 0.0, 0.0, 0.0].iter().flat_map(|p| p.to_le_bytes()).collect();
    payload.extend(number.to_le_bytes());
    payload.extend([VEHICLE, component, 0]);
    frame(GROUND, COMMAND_LONG, &payload)
}

fn set(component: u8, name: &str, value: f32) -> Vec<u8> {
    let mut payload = value.to_le_bytes().to_vec();
    payload.extend([VEHICLE, component]);
    payload.extend(name.bytes().chain([0; 16]).take(16));
    payload.push(9);
    frame(GROUND, PARAM_SET, &payload)
}

fn read(component: u8, name: &str) -> Vec<u8> {
    let mut payload = (-1_i16).to_le_bytes().to_vec();
    payload.extend([VEHICLE, component]);
    payload.extend(name.bytes().chain([0; 16]).take(16));
    frame(GROUND, PARAM_REQUEST_READ, &payload)
}

fn list(component: u8) -> Vec<u8> {
    frame(GROUND, PARAM_REQUEST_LIST, &[VEHICLE, component])
}

/// A frame of the node. Its payload is padded with the truncated zeros.
#[derive(Clone, Debug)]
struct Frame {
    at: Nanos,
    sequence: u8,
    system: u8,
    component: u8,
    number: u32,
    payload: Vec<u8>,
}

impl Frame {
    fn float(&self, at: usize) -> f32 {
        f32::from_le_bytes(self.payload[at..at + 4].try_into().expect("four bytes"))
    }

    fn half(&self, at: usize) -> u16 {
        u16::from_le_bytes([self.payload[at], self.payload[at + 1]])
    }

    fn text(&self, at: usize, length: usize) -> String {
        let bytes = self.payload[at..at + length].iter().take_while(|&&byte| byte != 0);
        bytes.map(|&byte| char::from(byte)).collect()
    }
}

/// The autopilot and the ground station.
#[derive(Debug, Default)]
pub struct Client {
    next: Nanos,
    /// Frames of the ground station, and their times.
    script: Vec<(Nanos, Vec<u8>)>,
    armed_from: Option<Nanos>,
    /// Pulse widths from these times on; before, idle.
    throttle: Vec<(Nanos, u16)>,
    /// Time in which only the script is sent.
    quiet: Option<(Nanos, Nanos)>,
    /// Parameters and garbage, as much as the line carries.
    flood: bool,
    drawn: u32,
    received: Vec<u8>,
    /// Bytes that belong to no frame.
    strays: usize,
    /// Frames with a wrong checksum.
    damaged: Vec<(Nanos, u32)>,
    frames: Vec<Frame>,
}

const TICK: Nanos = 50 * MILLIS;

impl Client {
    fn of(&self, component: u8, kind: Kind) -> impl DoubleEndedIterator<Item = &Frame> {
        self.frames.iter().filter(move |frame| frame.component == component && frame.number == kind.0)
    }

    /// The last value of a parameter that the node has sent.
    fn value(&self, component: u8, name: &str) -> Option<f32> {
        let mut values = self.of(component, PARAM_VALUE).rev();
        values.find(|value| value.text(8, 16) == name).map(|value| value.float(0))
    }

    /// The answers to a command from `after` on.
    fn answers(&self, component: u8, after: Nanos) -> Vec<(u16, u8)> {
        let acks = self.of(component, COMMAND_ACK).filter(|ack| ack.at >= after);
        acks.map(|ack| (ack.half(0), ack.payload[2])).collect()
    }

    fn texts(&self) -> Vec<String> {
        let texts = self.frames.iter().filter(|frame| frame.number == STATUSTEXT.0);
        texts.map(|frame| frame.text(1, 50)).collect()
    }

    /// The state of an engine at a time, from its heartbeat.
    fn state(&self, component: u8, at: Nanos) -> u8 {
        let last = self.of(component, HEARTBEAT).take_while(|frame| frame.at <= at).last();
        last.expect("a heartbeat").payload[0]
    }

    fn parse(&mut self, at: Nanos) {
        while let Some(&first) = self.received.first() {
            if first != 0xFD {
                self.strays += 1;
                self.received.remove(0);
                continue;
            }
            let Some(length) = self.received.get(1).map(|&length| usize::from(length)) else { return };
            if self.received.len() < length + 12 {
                return;
            }
            let bytes: Vec<u8> = self.received.drain(..length + 12).collect();
            let number = u32::from_le_bytes([bytes[7], bytes[8], bytes[9], 0]);
            let kind = KINDS.into_iter().find(|kind| kind.0 == number);
            let (_, seed, full) = kind.unwrap_or((number, 0, 0));
            let crc = u16::from_le_bytes([bytes[length + 10], bytes[length + 11]]);
            if checksum(&bytes[1..length + 10], seed) != crc {
                self.damaged.push((at, number));
                continue;
            }
            assert_eq!((bytes[2], bytes[3]), (0, 0), "no flags");
            let mut payload = bytes[10..10 + length].to_vec();
            payload.resize(full.max(length), 0);
            let frame =
                Frame { at, sequence: bytes[4], system: bytes[5], component: bytes[6], number, payload };
            self.frames.push(frame);
        }
    }

    /// Knuth's generator.
    fn draw(&mut self) -> u32 {
        self.drawn = self.drawn.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        self.drawn >> 8
    }
}

impl Ecu for Client {
    fn next_wake(&self) -> Nanos {
        self.next
    }

    fn advance(&mut self, now: Nanos, out: &mut Vec<u8>) {
        while self.next <= now {
            let begun = out.len();
            let at = self.next;
            self.next += TICK;
            let quiet = self.quiet.is_some_and(|(from, to)| (from..to).contains(&at));
            if at.is_multiple_of(SECOND) && !quiet {
                let armed = self.armed_from.is_some_and(|from| at >= from);
                out.extend(heartbeat(AUTOPILOT, 1, 3, armed));
                out.extend(heartbeat(GROUND, 6, 8, false));
            }
            let pulse = self.throttle.iter().rev().find(|&&(from, _)| at >= from);
            if !quiet {
                out.extend(servos(at, pulse.map_or(1100, |&(_, pulse)| pulse)));
            }
            self.script.retain(|(due, bytes)| {
                if *due <= at {
                    out.extend(bytes);
                }
                *due > at
            });
            // Nearly all that the line carries.
            while self.flood && at >= 8 * SECOND && out.len() - begun < 240 {
                match self.draw() % 3 {
                    0 => out.extend((0..self.draw() % 40).map(|i| (i * 37) as u8)),
                    _ => {
                        let value = 900 + self.draw() % 100;
                        out.extend(set(LEFT, "SRC_MAV_TOUT", value as f32));
                    }
                }
            }
        }
    }

    fn receive(&mut self, now: Nanos, byte: Result<u8, LineFault>) {
        self.received.extend(byte.ok());
        self.parse(now);
    }

    fn power(&mut self, _: Nanos, _: bool) {}
}

/// An autopilot and a ground station whose line is full of settings from 8 s on.
pub fn flood() -> Client {
    Client { flood: true, ..Client::default() }
}

/// Nothing was wrong on the wire: no byte outside of frames, none lost, and all of one system.
fn nothing_was_lost(client: &Client) {
    assert_eq!((client.strays, &client.damaged), (0, &Vec::new()), "bytes outside of frames, damaged frames");
    let mut last = BTreeMap::new();
    for frame in &client.frames {
        assert_eq!(frame.system, VEHICLE);
        let expected = last.insert(frame.component, frame.sequence).map(|before: u8| before.wrapping_add(1));
        assert_eq!(expected.unwrap_or(frame.sequence), frame.sequence, "{frame:?}");
    }
}

fn run(board: &'static Board, client: Client, until: Nanos) -> Report {
    let port = board.telemetry.name;
    Run::new(board, Image::Release).quick_engines().ecu(port, LINE, client).until(until).go()
}

#[test]
fn a_ground_station_sets_up_and_flies_an_engine_over_the_telemetry_port() {
    on_each_board(|board| {
        let s = |seconds: f64| (seconds * 1e9) as Nanos;
        let client = Client {
            script: vec![
                (s(8.0), list(0)),
                (s(24.0), set(NODE, "MAV_GCS_2", 9.0)),
                (s(24.2), set(NODE, "MAV_COMP_BASE", 200.0)),
                (s(25.0), command(LEFT, START, 1.0)),
                (s(31.0), command(LEFT, START, 1.0)),
                (s(50.0), command(LEFT, START, 0.0)),
            ],
            armed_from: Some(s(27.0)),
            throttle: vec![(s(40.0), 1500), (s(49.0), 1100)],
            ..Client::default()
        };
        let report = run(board, client, s(54.0));
        let client: &Client = report.ecu(board.telemetry.name);
        let texts = format!("{}: {:#?}", board.name, client.texts());
        nothing_was_lost(client);
        others_are_well(&report, &[]);

        // The node is silent until it knows its vehicle; then each component sends a heartbeat once a second.
        let first = client.frames.first().expect("frames").at;
        assert!((s(5.0)..s(7.5)).contains(&first), "{first}");
        for component in NODE..=NODE + 4 {
            let beats: Vec<_> = client.of(component, HEARTBEAT).collect();
            assert!((45..=50).contains(&beats.len()), "{component}: {}", beats.len());
            // Generic, no autopilot, not armed.
            assert!(beats.iter().all(|beat| beat.payload[4..7] == [0, 8, 1]), "{beats:?}");
        }
        // All parameters, each once. Before that, a board that stores settings has sent its learnt id.
        for component in NODE..=NODE + 4 {
            let values = client.of(component, PARAM_VALUE);
            let listed: Vec<_> = values.filter(|value| (s(8.0)..s(23.9)).contains(&value.at)).collect();
            let count = listed.first().expect("parameters").half(4);
            let indices: Vec<u16> = listed.iter().map(|value| value.half(6)).collect();
            assert_eq!(indices, (0..count).collect::<Vec<_>>(), "{component}");
        }
        // One is set, one refused: the old value is the answer.
        assert_eq!(client.value(NODE, "MAV_GCS_2"), Some(9.0));
        assert_eq!(client.value(NODE, "MAV_COMP_BASE"), Some(25.0));
        assert!(client.texts().iter().any(|text| text.contains("MAV_COMP_BASE not set")), "{texts}");
        // Disarmed: no start, and a text reports it.
        let refused = client.answers(LEFT, s(24.9));
        assert_eq!(refused.first(), Some(&(START, TEMPORARILY_REJECTED)), "{texts}");
        assert!(
            client.texts().iter().any(|text| text.starts_with("left: refused: arm the vehicle")),
            "{texts}"
        );
        assert_eq!(client.state(LEFT, s(30.5)), 3, "standby; {texts}");
        // Armed: it starts, runs at idle, follows the stream, and stops.
        assert_eq!(client.answers(LEFT, s(30.9)), [(START, ACCEPTED), (START, ACCEPTED)], "{texts}");
        assert_eq!(client.state(LEFT, s(39.5)), 7, "running; {texts}");
        let rpm = |at: Nanos| {
            let last = client.of(LEFT, EFI_STATUS).take_while(|frame| frame.at <= at).last();
            last.expect("its telemetry").float(4)
        };
        assert!(rpm(s(48.5)) > rpm(s(39.9)) + 10_000.0, "{} {}", rpm(s(39.9)), rpm(s(48.5)));
        assert_eq!(client.state(LEFT, s(53.9)), 4, "cooling; {texts}");
        // The other engines got no command.
        assert!((LEFT + 1..=LEFT + 3).all(|engine| client.state(engine, s(53.9)) == 3), "{texts}");
    });
}

#[test]
fn a_full_telemetry_port_costs_no_reply_window() {
    on_each_board(|board| {
        let worst = |flood: bool| {
            let report = run(board, Client { flood, ..Client::default() }, 12 * SECOND);
            others_are_well(&report, &[]);
            let client: &Client = report.ecu(board.telemetry.name);
            nothing_was_lost(client);
            let set = client.of(LEFT, PARAM_VALUE).count();
            let heartbeats = client.of(LEFT, HEARTBEAT).count();
            let stats = report.ecu::<AmtEcu>(report.board.ports[0].name).stats;
            let margin = stats.worst_margin.expect("replies");
            println!(
                "{}: {set} parameters set, worst margin {} us, the core is busy {:.2} %",
                board.name,
                margin / 1000,
                report.load()
            );
            // From 5 s on, with the sixth heartbeat of its vehicle or the seventh: they come every second, exactly.
            assert!((4..=6).contains(&heartbeats), "{heartbeats}");
            (set, margin)
        };
        let ((none, quiet), (set, flooded)) = (worst(false), worst(true));
        assert_eq!(none, 0);
        assert!(set > 300, "{set}");
        assert!(quiet.abs_diff(flooded) < 200_000, "{quiet} ns, {flooded} ns");
    });
}

#[test]
fn a_setting_stays_over_a_restart_by_command() {
    on_each_board(|board| {
        let reboot = command(NODE, 246, 1.0);
        let client = Client {
            script: vec![
                (12 * SECOND, set(LEFT, "LOSS_HOLD", 2345.0)),
                (12 * SECOND + SECOND / 2, set(NODE, "MAV_GCS_2", 9.0)),
                (14 * SECOND, reboot),
                // It learns its vehicle again.
                (23 * SECOND, list(0)),
            ],
            // The time of a byte cut off by a reset is undefined.
            quiet: Some((14 * SECOND, 15 * SECOND)),
            ..Client::default()
        };
        let port = board.telemetry.name;
        let run = Run::new(board, Image::Release).quick_engines().ecu(port, LINE, client);
        let report = run.resets(1).until(38 * SECOND).go();
        let client: &Client = report.ecu(port);
        let texts = format!("{}: {:#?}", board.name, client.texts());
        let set =
            client.of(LEFT, PARAM_VALUE).find(|value| value.text(8, 16) == "LOSS_HOLD").expect("an answer");
        assert!(set.at < 13 * SECOND && set.float(0) == 2345.0, "{texts}");
        assert_eq!(client.answers(NODE, 13 * SECOND).first(), Some(&(246, ACCEPTED)), "{texts}");
        assert!(report.logged("MAVLink: restarting on command"));
        assert_eq!(client.value(LEFT, "LOSS_HOLD"), Some(2345.0), "{texts}");
        assert_eq!(client.value(NODE, "MAV_GCS_2"), Some(9.0), "{texts}");
        assert!(!client.texts().iter().any(|text| text.contains("is not stored")), "{texts}");
    });
}

/// A ground station that commands an emergency stop of all engines.
pub fn stops(at: Nanos) -> Client {
    // `USER_1`, service 1.
    Client { script: vec![(at, command_of_two(NODE, 31010, [1.0, 21196.0]))], ..Client::default() }
}

/// "Left" and "booster" swap ports: "left" is a ZK engine on the fourth port from the next start on.
pub const CHANGED: [(&str, f32); 9] = [
    ("E1_PORT", 3.0),
    ("E4_PORT", 0.0),
    ("E1_PROTO", 2.0),
    ("E1_BAUD", 115_200.0),
    ("E1_ZK_RATE", 50.0),
    ("E4_PROTO", 1.0),
    ("E4_BAUD", 2400.0),
    ("E4_AMT_ENGINE", 3.0),
    ("E4_STOP", 1.0),
];

/// Time of the restart after which it applies.
pub const REWIRED: Nanos = 14 * SECOND;

/// A ground station that sets these parameters of the node and restarts it.
pub fn rewires(settings: &[(&str, f32)]) -> Client {
    let times = (0..).map(|n| 8 * SECOND + n * 200 * MILLIS);
    let mut script: Vec<_> =
        times.zip(settings).map(|(at, (name, value))| (at, set(NODE, name, *value))).collect();
    script.push((REWIRED, command(NODE, 246, 1.0)));
    // The time of a byte cut off by a reset is undefined.
    Client { script, quiet: Some((REWIRED, REWIRED + SECOND)), ..Client::default() }
}

#[test]
fn engines_that_change_ports_and_protocols_are_wired_so_after_a_restart_by_command() {
    on_each_board(|board| {
        let port = board.telemetry.name;
        let (first, fourth) = (board.ports[0].name, board.ports[3].name);
        let mut client = rewires(&CHANGED);
        client.script.push((23 * SECOND, list(NODE)));
        client.script.push((31 * SECOND, command(LEFT, START, 1.0)));
        client.armed_from = Some(27 * SECOND);
        let run = Run::new(board, Image::Release).quick_engines().ecu(port, LINE, client);
        let report = run.resets(1).until(42 * SECOND).go();
        let client: &Client = report.ecu(port);
        let texts = format!("{}: {:#?}\n{}", board.name, client.texts(), report.log_text());
        for (name, value) in CHANGED {
            assert_eq!(client.value(NODE, name), Some(value), "{name}; {texts}");
        }
        let reported = |name: &str| {
            client.texts().iter().any(|text| text.starts_with(&format!("{name} takes effect at")))
        };
        assert!(CHANGED.iter().all(|(name, _)| reported(name)), "{texts}");
        for (place, name, line) in [(0, "booster", "2400 baud, 8N1"), (3, "left", "115200 baud, 8N1")] {
            let text = format!("port {place}, ");
            let used: Vec<_> = report.lines(&text).filter(|log| log.at > REWIRED).collect();
            assert!(
                used.len() == 1 && used[0].text.ends_with(&format!("{name}, {line}")),
                "{used:?}; {texts}"
            );
        }
        // "Left" was started: only the turbine of the ZK ECU runs.
        assert_eq!(client.answers(LEFT, 30 * SECOND), [(START, ACCEPTED)], "{texts}");
        assert_eq!(report.ecu::<ZkEcu>(fourth).turbine().phase(), Phase::Running, "{texts}");
        let amt = report.ecu::<AmtEcu>(first);
        assert_eq!(amt.turbine().phase(), Phase::Standby, "{texts}");
        let last: Vec<_> = amt.commands.iter().filter(|(at, _)| *at > 40 * SECOND).collect();
        assert!(last.len() > 10 && last.iter().all(|(_, each)| each.ops != Ops::Run), "{texts}");
        assert!(client.state(LEFT, 41 * SECOND) == 7 && client.state(LEFT + 3, 41 * SECOND) == 3, "{texts}");
    });
}

#[test]
fn stored_wiring_that_contradicts_itself_leaves_that_of_the_image_and_engines_start() {
    on_each_board(|board| {
        let port = board.telemetry.name;
        let mut client = rewires(&CHANGED[..1]);
        client.script.push((31 * SECOND, command(LEFT, START, 1.0)));
        client.armed_from = Some(27 * SECOND);
        let run = Run::new(board, Image::Release).quick_engines().ecu(port, LINE, client).with_errors();
        let report = run.resets(1).until(42 * SECOND).go();
        let client: &Client = report.ecu(port);
        let texts = format!("{}: {:#?}\n{}", board.name, client.texts(), report.log_text());
        let why = "booster: wiring as in the image, not as stored";
        let whole = format!("{why}: two engines on one port");
        assert_eq!(report.lines(&whole).filter(|log| log.at > REWIRED).count(), 1, "{texts}");
        let errors = report.logs.iter().filter(|log| log.level == "error").count();
        assert_eq!(errors, 1, "{texts}");
        assert!(client.texts().iter().filter(|text| text.starts_with(why)).count() >= 2, "{texts}");
        assert_eq!(client.answers(LEFT, 30 * SECOND), [(START, ACCEPTED)], "{texts}");
        assert_eq!(report.ecu::<AmtEcu>(board.ports[0].name).turbine().phase(), Phase::Running, "{texts}");
    });
}

/// Channel, end points and reverse of the throttle of "left", set over the telemetry port, are stored and count after a reset: the
/// engine follows the stick where it is now. "Booster" has its own settings, the defaults, with a stick that stays at full
/// throttle.
#[test]
fn settings_of_radio_control_are_set_stored_and_used() {
    on_each_board(|board| {
        const RESET: Nanos = 10 * SECOND;
        let (amt, port) = ("SERIAL2", board.telemetry.name);
        let numbers =
            [("RC_THR_CH", 1.0), ("RC_THR_MIN", 1050.0), ("RC_THR_MAX", 1850.0), ("RC_THR_REV", 1.0)];
        let mut script: Vec<_> = (0..)
            .zip(numbers)
            .map(|(n, (name, number))| (8 * SECOND + n * 200 * MILLIS, set(LEFT, name, number)))
            .collect();
        // Channels of throttle and switch are never the same.
        script.push((9 * SECOND, set(LEFT, "RC_SW_CH", 1.0)));
        let client =
            Client { script, quiet: Some((RESET - SECOND / 2, RESET + SECOND)), ..Client::default() };
        // Channel 1 is at idle, which is its longer pulse; channel 3 at full throttle.
        let mut receiver = Receiver::new(Protocol::Sbus);
        (receiver.stick, receiver.others) = (100, vec![(1, 1850)]);
        let report = Run::new(board, Image::Outputs)
            .quick_engines()
            .only(&[amt, "SERIAL5"])
            .radio(receiver)
            .ecu(port, LINE, client)
            .at(RESET, |bench| bench.press_reset())
            .at(RESET + 2 * SECOND, |bench| bench.radio().switch = Position::Standby)
            .at(RESET + 4 * SECOND, |bench| bench.radio().switch = Position::Run)
            .at(RESET + 11 * SECOND, |bench| bench.radio().others = vec![(1, 1650)])
            .resets(1)
            .until(RESET + 13 * SECOND)
            .go();
        let client: &Client = report.ecu(port);
        let texts = format!("{}: {:#?}\n{}", board.name, client.texts(), report.log_text());
        for (name, number) in numbers {
            assert_eq!(client.value(LEFT, name), Some(number), "{name}; {texts}");
        }
        assert_eq!(client.value(LEFT, "RC_SW_CH"), Some(5.0), "{texts}");
        assert!(report.logged("settings: loaded from storage"), "{texts}");
        let commands = &report.ecu::<AmtEcu>(amt).commands;
        let runs = |from: Nanos, to: Nanos| {
            let runs =
                commands.iter().filter(move |(at, each)| (from..to).contains(at) && each.ops == Ops::Run);
            runs.map(|(_, each)| each.throttle_half_percent).collect::<Vec<_>>()
        };
        let idle = runs(0, RESET + 11 * SECOND);
        assert!(!idle.is_empty() && idle.iter().all(|throttle| *throttle == 0), "{idle:?}; {texts}");
        // A quarter of the way from the end of the longer pulse: 25 %. Without the reversal it would be 75 %, with the old end
        // points 31 %.
        assert_eq!(runs(RESET + 11 * SECOND, report.at).last(), Some(&50), "{texts}");
        let booster = report.ecu::<ZkEcu>("SERIAL5").turbine().phase();
        assert_eq!(booster, Phase::Stopped, "its stop is not released with the stick up; {texts}");
    });
}

#[test]
fn every_board_answers_on_its_telemetry_port() {
    on_all_boards(|board| {
        let client = Client { script: vec![(8 * SECOND, list(NODE))], ..Client::default() };
        let report = run(board, client, 10 * SECOND);
        let client: &Client = report.ecu(board.telemetry.name);
        nothing_was_lost(client);
        assert_eq!(client.value(NODE, "MAV_COMP_BASE"), Some(25.0));
    });
}

/// An H743's bootloader erases the whole application if it finds a word torn by a power cut.
#[test]
fn behind_an_ardupilot_bootloader_a_setting_is_stored_in_an_fram_only() {
    on_each_board(|board| {
        let client =
            Client { script: vec![(12 * SECOND, set(LEFT, "LOSS_HOLD", 2345.0))], ..Client::default() };
        let run = Run::new(board, Image::Ardupilot).quick_engines();
        let report = run.ecu(board.telemetry.name, LINE, client).until(14 * SECOND).go();
        let client: &Client = report.ecu(board.telemetry.name);
        let stores = board.fram.is_some();
        let none = report.logged("settings: no storage on this board");
        assert_eq!(none, !stores, "{}: {}", board.name, report.log_text());
        let reported = client.texts().iter().any(|text| text.contains("is not stored"));
        assert_eq!(reported, !stores, "{:?}", client.texts());
    });
}

/// A run of a board with this F-RAM, and what the ground station sends.
fn with_fram(board: &'static Board, fram: Option<Fram>, script: Vec<(Nanos, Vec<u8>)>) -> Run {
    // The time of a byte cut off by a reset is undefined.
    let quiet = Some((9 * SECOND, 11 * SECOND));
    let client = Client { script, quiet, ..Client::default() };
    Run::new(board, Image::Release).quick_engines().fram(fram).ecu(board.telemetry.name, LINE, client)
}

#[test]
fn a_setting_in_an_fram_stays_over_a_reset_and_without_a_supply() {
    on_boards(
        |board| board.fram.is_some(),
        |board| {
            let chip = (board.fram.expect("filtered").chip)().used().protected();
            let script = vec![
                (8 * SECOND, set(LEFT, "LOSS_HOLD", 2345.0)),
                (17 * SECOND, read(LEFT, "LOSS_HOLD")),
                (18 * SECOND, set(NODE, "MAV_GCS_2", 9.0)),
            ];
            let run = with_fram(board, Some(chip), script).resets(1);
            let report = run.at(9 * SECOND + SECOND / 2, |bench| bench.press_reset()).until(20 * SECOND).go();
            let client: &Client = report.ecu(board.telemetry.name);
            let texts = format!("{}: {:#?}\n{}", board.name, client.texts(), report.log_text());
            assert!(report.logged("settings: none stored, using defaults"), "somebody else's data; {texts}");
            assert!(report.logged("settings: loaded from storage"), "after the reset; {texts}");
            assert_eq!(client.value(LEFT, "LOSS_HOLD"), Some(2345.0), "{texts}");
            let answer = client.of(LEFT, PARAM_VALUE).next_back().expect("an answer");
            assert!(answer.at > 17 * SECOND, "{texts}");
            let starts: Vec<_> = report.lines("settings: in an F-RAM").map(|line| line.at).collect();
            println!("{}: {starts:?} ns, {texts}", board.name);
            let chip = report.fram.clone().expect("it has one");
            assert!(chip.written > 0 && chip.ignored.is_empty(), "{:?}", chip.ignored);

            // All but the chip is new.
            let script = vec![(8 * SECOND, read(LEFT, "LOSS_HOLD")), (8 * SECOND, read(NODE, "MAV_GCS_2"))];
            let report = with_fram(board, Some(chip.powered_up()), script).until(10 * SECOND).go();
            let client: &Client = report.ecu(board.telemetry.name);
            assert!(report.logged("settings: loaded from storage"), "{}", report.log_text());
            assert_eq!(client.value(LEFT, "LOSS_HOLD"), Some(2345.0));
            assert_eq!(client.value(NODE, "MAV_GCS_2"), Some(9.0));
        },
    );
}

/// The F-RAM of a board that ran ArduPilot. No setting is stored, so each start reads it.
#[test]
fn somebody_elses_data_in_an_fram_makes_no_reply_late_and_stays() {
    on_boards(
        |board| board.fram.is_some(),
        |board| {
            let chip = (board.fram.expect("filtered").chip)().used();
            // At different times relative to the AMT ECUs' frames, one every 125 ms.
            const RESETS: [Nanos; 3] = [1500 * MILLIS, 2531 * MILLIS, 3562 * MILLIS];
            let run = Run::new(board, Image::Release).quick_engines().fram(Some(chip.clone()));
            let run = RESETS.into_iter().fold(run, |run, at| run.at(at, |bench| bench.press_reset()));
            let report = run.resets(RESETS.len()).until(5 * SECOND).go();
            let starts = report
                .lines("settings: in an F-RAM")
                .zip(report.lines("settings: none stored, using defaults"));
            let read: Vec<Nanos> = starts.map(|(from, to)| (to.at - from.at) / MILLIS).collect();
            println!("{}: read for {read:?} ms", board.name);
            assert_eq!(read.len(), 1 + RESETS.len(), "{}", report.log_text());
            for engine in amt_engines(&report) {
                let stats = report.ecu::<AmtEcu>(engine.port).stats;
                let text = format!("{} {}: {stats:?}", board.name, engine.name);
                assert_eq!((stats.late, stats.unsolicited), (0, 0), "{text}");
                // A reset may cut off a reply.
                assert_eq!(stats.bad.total(), stats.bad.truncated, "{text}");
                // Only frames that arrive while it starts; all others are answered.
                assert!(stats.none <= 2 * RESETS.len() as u64 && stats.in_window > 20, "{text}");
            }
            assert!(read.iter().all(|&ms| ms < 60), "{read:?}");
            assert!(report.fram.is_some_and(|now| now.written == 0 && now.holds_the_same(&chip)));
        },
    );
}

/// RAM has it over a reset.
#[test]
fn without_a_known_fram_a_text_says_that_a_setting_is_not_stored() {
    let unknown = [0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0x7F, 0xC2, 0x2A, 0x08];
    on_boards(
        |board| board.fram.is_some(),
        |board| {
            for fram in [None, Some(Fram::fm25v01a().with_id(unknown))] {
                let is_there = fram.is_some();
                let script = vec![
                    (8 * SECOND, set(LEFT, "LOSS_HOLD", 2345.0)),
                    (17 * SECOND, read(LEFT, "LOSS_HOLD")),
                ];
                let run = with_fram(board, fram, script).with_errors().resets(1);
                let report =
                    run.at(9 * SECOND + SECOND / 2, |bench| bench.press_reset()).until(18 * SECOND).go();
                let client: &Client = report.ecu(board.telemetry.name);
                let texts = format!("{}: {:#?}\n{}", board.name, client.texts(), report.log_text());
                assert!(report.logged("settings: unknown F-RAM"), "{texts}");
                assert_eq!(report.logged("7f, 7f, 7f, 7f, 7f, 7f, c2, 2a, 08"), is_there, "{texts}");
                assert!(
                    client.texts().iter().any(|text| text.contains("LOSS_HOLD is not stored")),
                    "{texts}"
                );
                let values: Vec<_> =
                    client.of(LEFT, PARAM_VALUE).map(|it| (it.at > 17 * SECOND, it.float(0))).collect();
                assert_eq!(values, [(false, 2345.0), (true, 2345.0)], "{texts}");
                assert!(
                    report.logged(
                        "settings: no storage on this board, using the values retained over the reset"
                    ),
                    "{texts}"
                );
                let vehicle = report.lines("MAVLink: the vehicle is system").next_back().map(|line| line.at);
                assert!(vehicle.is_some_and(|at| at < 11 * SECOND), "the id is known at once; {texts}");
                // An unknown chip is not written.
                assert_eq!(
                    report.fram.map(|fram| (fram.written, fram.ignored.len())),
                    is_there.then_some((0, 0))
                );
            }
        },
    );
}

/// An ECU whose voltages have no known scale (AMT-6): the divider's measurement is reported, and counts for a start.
#[test]
fn the_supply_that_the_board_measures_counts_where_the_ecu_reports_none() {
    on_boards(
        |board| board.divider.is_some(),
        |board| {
            const CHARGED: Nanos = 14 * SECOND;
            let port = board.ports[0].name;
            let line = Line::n1(2400);
            let client = Client {
                script: vec![
                    (8 * SECOND, set(NODE, "MAV_EFI_ENGINE", 255.0)),
                    (8 * SECOND, set(LEFT, "START_SUPPLY", 11_000.0)),
                    (12 * SECOND, command(LEFT, START, 1.0)),
                    // The same start is refused for 5 s.
                    (18 * SECOND, command(LEFT, START, 1.0)),
                ],
                armed_from: Some(9 * SECOND),
                ..Client::default()
            };
            let report = Run::new(board, Image::Supply)
                .quick_engines()
                .ecu(port, line, AnyConfig::amt(EngineModel::Nike).on(line).ecu())
                .ecu(board.telemetry.name, LINE, client)
                .at(0, |bench| bench.battery(10_500))
                .at(CHARGED, |bench| bench.battery(12_600))
                .until(20 * SECOND)
                .go();
            others_are_well(&report, &[]);
            let client: &Client = report.ecu(board.telemetry.name);
            let texts = format!("{:#?}\n{}", client.texts(), report.log_text());
            let volts = |component: u8, at: Nanos| {
                let last = client.of(component, EFI_STATUS).take_while(|frame| frame.at <= at).last();
                last.unwrap_or_else(|| panic!("its telemetry; {texts}")).float(65)
            };
            // To 0.01 V: the divider's steps are 0.6 mV.
            assert!((volts(LEFT, CHARGED) - 10.5).abs() < 0.012, "{}; {texts}", volts(LEFT, CHARGED));
            assert!((volts(LEFT, report.at) - 12.6).abs() < 0.012, "{}; {texts}", volts(LEFT, report.at));
            // Another ECU reports its own, which does not change.
            assert_eq!(volts(LEFT + 1, CHARGED), volts(LEFT + 1, report.at), "{texts}");
            let answers = client.answers(LEFT, 11 * SECOND);
            assert_eq!(answers, [(START, TEMPORARILY_REJECTED), (START, ACCEPTED)], "{texts}");
            let refused = client.texts().iter().any(|text| text.contains("the supply voltage is 10"));
            assert!(refused, "{texts}");
            let measured: Vec<_> = report.lines("board: supply").map(|line| (line.at, &line.text)).collect();
            println!("{:?}, {} lines", measured.first(), measured.len());
            assert!((19..=21).contains(&measured.len()), "{texts}");
        },
    );
}
