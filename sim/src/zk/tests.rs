//! The ZK ECU alone, with a small host written from the same document.

mod temper;

use super::*;
use crate::ecu::{MILLIS, SECOND};
use crate::line::Line;
use crate::turbine::EgtSensor;
use crate::{clock, wire};
use std::collections::VecDeque;

/// A control frame from its two data bytes.
fn frame(high: u8, low: u8) -> [u8; 4] {
    [0xFF, high, low, crc8(&[high, low])]
}

fn control(sw: u8, throttle: u16) -> [u8; 4] {
    frame(0x10 | sw << 2 | (throttle >> 8) as u8, throttle as u8)
}

fn action(number: u8) -> [u8; 4] {
    frame(0x20, number)
}

fn switch(sw: u8, factor: u8) -> [u8; 4] {
    frame(0x60, factor << 2 | sw)
}

fn rpm(code: u16) -> [u8; 4] {
    frame(0x70 | (code >> 8) as u8, code as u8)
}

const EMPTY: [u8; 4] = [0xFF, 0, 0, 0];
const UNLOCK: [u8; 4] = [0xFF, 0x30, 0x00, 0x2D];

struct Bench {
    ecu: ZkEcu,
    now: Nanos,
    /// Sent every 50 ms.
    host: Vec<[u8; 4]>,
    turn: usize,
    next_send: Nanos,
    arriving: VecDeque<(Nanos, u8)>,
    /// Start and bytes of each status frame.
    seen: Vec<(Nanos, [u8; 7])>,
}

impl Bench {
    fn new(config: ZkConfig) -> Self {
        let mut bench = Self {
            ecu: ZkEcu::new(config),
            now: 0,
            host: vec![],
            turn: 0,
            next_send: Nanos::MAX,
            arriving: VecDeque::new(),
            seen: vec![],
        };
        bench.ecu.advance(0, &mut vec![]);
        bench
    }

    fn version(version: u8) -> Self {
        let mut bench = Self::new(ZkConfig::new(version));
        bench.wait_ms(1000);
        bench
    }

    /// Sends these frames in turn from now on, one every 50 ms; nothing when empty.
    fn host(&mut self, frames: &[[u8; 4]]) -> &mut Self {
        self.host = frames.to_vec();
        self.turn = 0;
        self.next_send = if frames.is_empty() { Nanos::MAX } else { self.now };
        self
    }

    /// One frame now.
    fn once(&mut self, bytes: [u8; 4]) -> &mut Self {
        self.send(&bytes);
        self.wait_ms(45)
    }

    fn send(&mut self, bytes: &[u8]) {
        let line = self.ecu.config().line;
        for (n, &byte) in (1..).zip(bytes) {
            self.arriving.push_back((self.now + line.byte_ns(n), byte));
        }
    }

    fn wait_ms(&mut self, ms: u64) -> &mut Self {
        let end = self.now + ms * MILLIS;
        loop {
            let byte_at = self.arriving.front().map_or(Nanos::MAX, |&(at, _)| at);
            let at = byte_at.min(self.next_send).min(self.ecu.next_wake().max(self.now));
            if at > end {
                break;
            }
            self.now = at;
            if at == self.next_send {
                self.next_send += 50 * MILLIS;
                let bytes = self.host[self.turn % self.host.len()];
                self.turn += 1;
                self.send(&bytes);
            } else if at == byte_at {
                let (_, byte) = self.arriving.pop_front().unwrap();
                self.ecu.receive(at, Ok(byte));
            } else {
                self.advance();
            }
        }
        self.now = end;
        self.advance();
        self
    }

    fn advance(&mut self) {
        let mut tx = vec![];
        self.ecu.advance(self.now, &mut tx);
        if !tx.is_empty() {
            assert_eq!(crc8(&tx[..6]), tx[6]);
            self.seen.push((self.now, tx.try_into().unwrap()));
        }
    }

    fn until(&mut self, what: impl Fn(&ZkEcu) -> bool) -> u64 {
        let from = self.now;
        while !what(&self.ecu) {
            self.wait_ms(5);
            assert!(
                self.now - from < 200 * SECOND,
                "it never happens: state {} {:?}",
                self.ecu.state(),
                self.ecu.stats
            );
        }
        (self.now - from) / MILLIS
    }

    /// Started, and running at idle; the host keeps sending `ID 1, run, 0 %`.
    fn running(version: u8) -> Self {
        let mut bench = Self::version(version);
        bench.host(&[control(3, 0)]).until(|ecu| ecu.state() == state::MINIMUM);
        bench
    }

    fn ids(&self) -> Vec<u8> {
        self.seen.iter().map(|(_, bytes)| bytes[0] & 15).collect()
    }

    /// The latest status frame with this ID.
    fn last(&self, id: u8) -> [u8; 7] {
        self.seen.iter().rev().find(|(_, bytes)| bytes[0] == 0xF0 | id).expect("no such status yet").1
    }

    fn error_and_switch(&self) -> (u8, u8) {
        let bytes = self.last(1);
        ((bytes[4] & 3) << 3 | bytes[3] >> 5, bytes[4] >> 5 & 3)
    }
}

#[test]
fn up_to_version_4_it_answers_and_is_silent_otherwise() {
    for version in 1..=4 {
        let mut bench = Bench::version(version);
        bench.wait_ms(60_000);
        assert_eq!(bench.seen, []);
        for _ in 0..3 {
            bench.once(EMPTY);
        }
        assert_eq!(bench.seen.len(), 3);
        bench.wait_ms(60_000);
        assert_eq!(bench.seen.len(), 3);
        assert_eq!(bench.ecu.stats.accepted, 3);
        // 4 bytes at 9600 baud and half a millisecond.
        assert_eq!(bench.seen[0].0, 61 * SECOND + 4_166_667 + MILLIS / 2);
    }
}

#[test]
fn each_version_sends_the_ids_it_knows() {
    for (version, last) in [(1, 6), (2, 7), (3, 8), (4, 8), (5, 9)] {
        let mut bench = Bench::version(version);
        bench.host(&[EMPTY]).wait_ms(5000);
        let mut ids = bench.ids();
        assert_eq!(
            ids[..9.min(last + 1)],
            (1..=9).cycle().filter(|&id| id <= last as u8).take(9.min(last + 1)).collect::<Vec<_>>()
        );
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids, (1..=last as u8).collect::<Vec<_>>());
        assert_eq!(bench.last(6)[5], version << 2);
        assert_eq!(bench.last(6)[3], 160);
    }
}

#[test]
fn version_5_sends_by_itself_at_its_rate() {
    for (rate, hz, number) in [(Rate::Hz20, 20, 7), (Rate::Hz50, 50, 8), (Rate::Hz100, 100, 9)] {
        let mut bench = Bench::new(ZkConfig::new(5).at(rate));
        bench.wait_ms(10_299);
        assert_eq!(bench.seen.len(), 10 * hz);
        assert_eq!(bench.seen[0].0, 300 * MILLIS);
        assert!(bench.seen.windows(2).all(|pair| pair[1].0 - pair[0].0 == rate.period()));

        // Commands are not answered on top of that.
        let before = bench.seen.len();
        bench.host(&[EMPTY]).wait_ms(1000);
        assert_eq!(bench.seen.len() - before, hz);

        // The same by command, from 20 Hz.
        let mut bench = Bench::version(5);
        bench.once(action(number)).wait_ms(1000);
        assert_eq!(bench.ecu.rate(), rate);
        let before = bench.seen.len();
        bench.wait_ms(10_000);
        assert_eq!(bench.seen.len() - before, 10 * hz);
        assert_eq!(bench.last(6)[5], (5 << 2) | (number - 7));
    }
}

#[test]
fn a_rate_the_line_cannot_carry_fills_the_line() {
    let mut bench = Bench::new(ZkConfig::new(5).on(Line::n1(2400)).at(Rate::Hz100));
    bench.wait_ms(10_300);
    // 70 bits at 2400 baud take 29.2 ms; the beat of 10 ms is kept.
    assert!((320..345).contains(&bench.seen.len()), "{}", bench.seen.len());
}

#[test]
fn answers_can_be_bounded_by_the_rate() {
    let mut bench = Bench::new(ZkConfig { rate_bounds_answers: true, ..ZkConfig::new(4) });
    bench.wait_ms(500);
    for _ in 0..100 {
        bench.send(&EMPTY);
        bench.wait_ms(10);
    }
    assert!((19..=21).contains(&bench.seen.len()), "{}", bench.seen.len());
    let stats = bench.ecu.stats;
    assert_eq!((stats.accepted, stats.unanswered), (100, 100 - bench.seen.len() as u64 - 1));
}

#[test]
fn the_documents_first_example_comes_out_of_a_cold_ecu() {
    let mut bench = Bench::version(4);
    bench.once(EMPTY);
    // 15 °C instead of its 26: 65 = 0x41.
    assert_eq!(bench.seen[0].1[..6], [0xF1, 0, 0, 0, 0, 0x41]);
    assert_eq!(UNLOCK[3], crc8(&UNLOCK[1..3]));
}

#[test]
fn a_start_shows_all_its_states_in_order() {
    let mut bench = Bench::version(4);
    bench.host(&[control(2, 0)]).wait_ms(500);
    bench.host(&[control(3, 0)]).wait_ms(40_000);
    bench.host(&[control(3, 500)]).wait_ms(10_000);
    bench.host(&[control(3, 1000)]).wait_ms(10_000);
    bench.host(&[control(2, 0)]).wait_ms(90_000);
    let mut states: Vec<u8> =
        bench.seen.iter().filter(|(_, bytes)| bytes[0] == 0xF1).map(|(_, bytes)| bytes[3] & 31).collect();
    states.dedup();
    assert_eq!(states, [0, 1, 3, 4, 5, 8, 9, 11, 10, 12, 1]);
    assert_eq!(bench.error_and_switch(), (0, 1));
}

#[test]
fn status_follows_the_engine() {
    let mut bench = Bench::running(5);
    bench.host(&[control(3, 1000)]).wait_ms(15_000);
    let rpm = u32::from(bench.last(1)[1]) | u32::from(bench.last(1)[2]) << 8;
    assert!((15_995..=16_000).contains(&rpm), "{rpm}");
    assert_eq!(bench.error_and_switch(), (0, 2));
    assert_eq!(bench.last(2)[5], 24); // 4.8 V in 0.2 V
    assert_eq!(bench.last(3)[3], 100);
    assert_eq!(bench.last(5)[3..6], [75, 30, 30]);
    assert_eq!(bench.last(7)[3], 30); // 0.30 L/min
    assert_eq!(bench.last(8)[3], 50);
    let start = u16::from(bench.last(8)[4] & 15) << 8 | u16::from(bench.last(8)[5]);
    assert!((200..400).contains(&start), "{start}");
    assert_eq!(bench.last(9)[3], 85);
}

#[test]
fn a_start_waits_for_low_throttle() {
    let mut bench = Bench::version(5);
    bench.host(&[control(3, 300)]).wait_ms(5000);
    assert_eq!(bench.ecu.state(), state::IGNITION_WAITS);
    bench.host(&[control(3, 0)]).wait_ms(500);
    assert_eq!(bench.ecu.state(), state::IGNITION);
}

#[test]
fn stop_does_not_cool_and_standby_does() {
    let mut bench = Bench::running(4);
    bench.host(&[control(1, 0)]).wait_ms(200);
    assert_eq!(bench.ecu.state(), state::STOP);
    assert_eq!(bench.error_and_switch(), (0, 0));
    bench.wait_ms(5000);
    assert_eq!(bench.ecu.state(), state::STOP);
    bench.host(&[control(2, 0)]).wait_ms(200);
    assert_eq!(bench.ecu.state(), state::COOLING);
}

#[test]
fn up_to_version_4_silence_is_error_13_and_standby() {
    for version in 1..=4 {
        let mut bench = Bench::running(version);
        bench.host(&[EMPTY]).wait_ms(10_000);
        assert!(bench.ecu.turbine().phase().is_live(), "ID 0 keeps the connection");
        bench.host(&[]).wait_ms(900);
        assert!(bench.ecu.turbine().phase().is_live());
        bench.wait_ms(300);
        assert_eq!(bench.ecu.turbine().phase(), Phase::Cooling);
        assert_eq!((bench.ecu.error(), bench.ecu.stats.control_losses), (error::CONTROL_LOST, 1));

        // The host is back and still commands run: that is no reason to start.
        bench.host(&[control(3, 0)]).wait_ms(120_000);
        assert_eq!(bench.error_and_switch(), (13, 1));
        assert_eq!(bench.ecu.turbine().phase(), Phase::Standby);
        bench.host(&[control(2, 0)]).wait_ms(500);
        assert_eq!(bench.ecu.error(), 0);
        bench.host(&[control(3, 0)]).wait_ms(500);
        assert_eq!(bench.ecu.state(), state::IGNITION);
    }
}

#[test]
fn from_version_5_silence_changes_nothing() {
    let mut bench = Bench::running(5);
    bench.host(&[control(3, 700)]).wait_ms(10_000);
    let rpm = bench.ecu.turbine().rpm();
    bench.host(&[]).wait_ms(600_000);
    assert_eq!((bench.ecu.state(), bench.ecu.error()), (state::RUNNING, 0));
    assert!((bench.ecu.turbine().rpm() - rpm).abs() < 100.0);
}

#[test]
fn id_1_controls_switch_and_throttle_in_mode_1() {
    let mut bench = Bench::running(4);
    bench.host(&[control(3, 600)]).wait_ms(10_000);
    assert!((bench.ecu.turbine().rpm() - 116_000.0).abs() < 100.0);
}

#[test]
fn id_6_controls_the_switch_and_id_1_the_throttle_in_mode_2() {
    let mut bench = Bench::version(4);
    // SW 0 in ID 1 would be the PWM hand-over; here it has no meaning.
    bench.host(&[switch(3, 0), control(0, 0)]).until(|ecu| ecu.state() == state::MINIMUM);
    assert_eq!(bench.ecu.controlled_by(), ControlledBy::Uart);
    bench.host(&[switch(3, 0), control(1, 400)]).wait_ms(10_000);
    assert!((bench.ecu.turbine().rpm() - 94_000.0).abs() < 100.0, "SW 1 in ID 1 has no meaning either");
    bench.host(&[switch(2, 0), control(3, 400)]).wait_ms(200);
    assert_eq!(bench.ecu.state(), state::COOLING);
}

#[test]
fn id_6_and_7_control_mode_3_and_id_1_is_ignored() {
    let mut bench = Bench::version(4);
    bench.host(&[switch(3, 4), rpm(2500)]).until(|ecu| ecu.turbine().phase() == Phase::Running);
    bench.wait_ms(10_000);
    assert!((bench.ecu.turbine().rpm() - 100_000.0).abs() < 100.0);
    assert_eq!(bench.last(8)[4] >> 4 & 1, 1, "closed loop");
    bench.once(control(1, 0)).wait_ms(5000);
    assert!((bench.ecu.turbine().rpm() - 100_000.0).abs() < 100.0);
    assert_eq!(bench.ecu.stats.ignored.mode, 1);
    // Without its own switch, ID 6 leaves the switch unchanged.
    bench.host(&[switch(0, 3), rpm(2500)]).wait_ms(10_000);
    assert!((bench.ecu.turbine().rpm() - 75_000.0).abs() < 100.0);
    bench.host(&[switch(2, 4), rpm(2500)]).wait_ms(200);
    assert_eq!(bench.ecu.state(), state::COOLING);
}

#[test]
fn id_7_without_a_factor_has_no_meaning() {
    let mut bench = Bench::running(4);
    bench.once(rpm(3000)).wait_ms(5000);
    assert!((bench.ecu.turbine().rpm() - 50_000.0).abs() < 100.0);
    assert_eq!(bench.ecu.stats.ignored.mode, 1);
}

#[test]
fn sw_0_hands_the_engine_to_the_pwm_input() {
    let mut bench = Bench::running(4);
    bench.ecu.set_pwm(Some(Pwm { switch: Switch::Run, throttle: 500 }));
    bench.wait_ms(5000);
    assert!(
        (bench.ecu.turbine().rpm() - 50_000.0).abs() < 100.0,
        "the UART is in control, the PWM input is ignored"
    );
    bench.host(&[control(0, 0)]).wait_ms(10_000);
    assert_eq!(bench.ecu.controlled_by(), ControlledBy::Pwm);
    assert!((bench.ecu.turbine().rpm() - 105_000.0).abs() < 100.0);
    // The host may fall silent: it is not in control.
    bench.host(&[]).wait_ms(10_000);
    assert_eq!((bench.ecu.state(), bench.ecu.error()), (state::RUNNING, 0));
    bench.ecu.set_pwm(None);
    bench.wait_ms(100);
    assert_eq!((bench.ecu.state(), bench.ecu.error()), (state::COOLING, error::CONTROL_LOST));
}

#[test]
fn sw_0_with_nothing_on_the_input_stops_a_running_engine() {
    for version in [4, 5] {
        let mut bench = Bench::running(version);
        bench.host(&[control(0, 0)]).wait_ms(300);
        assert_eq!((bench.ecu.state(), bench.ecu.error()), (state::COOLING, error::CONTROL_LOST));
    }
}

#[test]
fn settings_need_the_unlock_directly_before() {
    let mut bench = Bench::version(3);
    bench.once(frame(0x40, 100)).once(frame(0x50, 60));
    assert_eq!((bench.ecu.ignition_voltage(), bench.ecu.curve()), (75, 30));
    assert_eq!(bench.ecu.stats.ignored.locked, 2);
    assert_eq!(bench.seen.len(), 0, "not answered");

    bench.once(UNLOCK).once(frame(0x40, 100));
    assert_eq!(bench.ecu.ignition_voltage(), 100);
    bench.once(frame(0x50, 60));
    assert_eq!(bench.ecu.curve(), 30, "one unlock, one setting");
    bench.once(UNLOCK).once(EMPTY).once(frame(0x50, 60));
    assert_eq!(bench.ecu.curve(), 30, "something in between");
    bench.once(UNLOCK).once(frame(0x50, 60));
    assert_eq!(bench.ecu.curve(), 60);
    bench.once(UNLOCK).once(frame(0x50, 71)).once(UNLOCK).once(frame(0x50, 9));
    assert_eq!((bench.ecu.curve(), bench.ecu.stats.bad.range), (60, 2));
    bench.host(&[EMPTY]).wait_ms(1000);
    assert_eq!(bench.last(5)[3..6], [100, 60, 30]);
}

#[test]
fn settings_survive_a_loss_of_power_and_the_control_does_not() {
    let mut bench = Bench::running(5);
    bench.host(&[]).once(UNLOCK).once(frame(0x50, 60)).once(action(8));
    let now = bench.now;
    bench.ecu.power(now, false);
    let before = bench.seen.len();
    bench.wait_ms(1000);
    assert_eq!(bench.seen.len(), before);
    assert_eq!(bench.ecu.turbine().fuel_flow(), 0.0);
    let now = bench.now;
    bench.ecu.power(now, true);
    bench.wait_ms(1000);
    assert_eq!((bench.ecu.curve(), bench.ecu.rate()), (60, Rate::Hz50));
    assert_eq!(
        (bench.ecu.state(), bench.ecu.error(), bench.ecu.controlled_by()),
        (state::STOP, 0, ControlledBy::Pwm)
    );
}

#[test]
fn service_tests_run_for_a_while_and_only_at_rest() {
    for (number, shown) in [(1, 19), (2, 14), (3, 15), (4, 16), (5, 17), (6, 18)] {
        let mut bench = Bench::version(1);
        bench.once(action(number)).wait_ms(1000);
        assert_eq!(bench.ecu.state(), shown);
        assert_eq!(bench.ecu.turbine().rpm() > 1000.0, number == 6);
        assert_eq!(bench.ecu.turbine().pump_voltage() > 0.0, matches!(number, 1 | 5));
        bench.wait_ms(2500);
        assert_eq!(bench.ecu.state(), state::STOP);

        let mut bench = Bench::running(1);
        bench.once(action(number)).wait_ms(100);
        assert_eq!(bench.ecu.state(), state::MINIMUM);
        assert_eq!(bench.ecu.stats.ignored.busy, 1);
    }
}

#[test]
fn the_pump_stays_open_until_it_is_closed() {
    let mut bench = Bench::version(5);
    bench.once(action(12)).wait_ms(60_000);
    assert_eq!(bench.ecu.state(), state::TEST_PUMP);
    assert!(bench.ecu.turbine().fuel_total() > 10.0);
    bench.once(action(13)).wait_ms(100);
    assert_eq!(bench.ecu.state(), state::STOP);
    bench.once(action(12)).wait_ms(100);
    bench.host(&[control(3, 0)]).wait_ms(1000);
    assert_eq!(bench.ecu.state(), state::IGNITION, "a start ends it");
}

#[test]
fn fuel_and_thrust_are_set_to_zero() {
    let mut bench = Bench::running(2);
    bench.wait_ms(10_000);
    assert!(bench.ecu.turbine().fuel_total() > 10.0);
    bench.once(action(10)).wait_ms(100);
    assert!(bench.ecu.turbine().fuel_total() < 1.0);
    bench.host(&[control(3, 1000)]).wait_ms(10_000);
    assert_eq!(bench.last(4)[5], 82); // 80 N are 8.2 kg
    bench.once(action(11)).wait_ms(1000);
    assert_eq!(bench.last(4)[5], 0);
}

#[test]
fn what_a_version_does_not_know_it_ignores_and_does_not_answer() {
    for (version, frames) in [
        (1, &[action(10), action(11), switch(3, 0), rpm(100), frame(0x83, 0xF5), action(12), action(13)][..]),
        (2, &[switch(3, 0), rpm(100), frame(0x83, 0xF5), action(12), action(13)]),
        (3, &[switch(3, 0), rpm(100), frame(0x83, 0xF5), action(12), action(13)]),
        (4, &[action(12), action(13)]),
        (5, &[]),
    ] {
        let mut bench = Bench::version(version);
        let before = bench.seen.len();
        for &bytes in frames {
            bench.once(bytes);
        }
        let stats = bench.ecu.stats;
        assert_eq!((stats.ignored.version, stats.accepted), (frames.len() as u64, 0));
        assert_eq!(bench.seen.len(), before);
        assert!(!bench.ecu.turbine().phase().is_live());
    }
}

#[test]
fn a_pressure_is_requested_and_taken() {
    let mut bench = Bench::new(ZkConfig { esr: true, ..ZkConfig::new(4) });
    bench.wait_ms(500);
    bench.host(&[EMPTY]).wait_ms(1000);
    assert_eq!(bench.last(8)[4] >> 5 & 1, 1);
    assert_eq!(bench.last(3)[4..6], [0, 0]);
    bench.host(&[frame(0x83, 0xF5)]).wait_ms(1000);
    assert_eq!(bench.ecu.pressure(), Some(1013));
    assert!(bench.ecu.stats.pressures > 10);
    assert_eq!(u16::from_le_bytes([bench.last(3)[4], bench.last(3)[5]]), 50_650);

    let mut bench = Bench::version(4);
    bench.host(&[EMPTY]).wait_ms(1000);
    assert_eq!(bench.last(8)[4] >> 5 & 1, 0);
}

#[test]
fn bad_frames_are_counted_by_reason_and_change_nothing() {
    let mut bench = Bench::version(4);
    bench.once([0xFF, 0x1C, 0x00, 0x00]); // CRC
    bench.once(control(3, 1001)).once(action(0)).once(switch(3, 7)); // range
    bench.once(frame(0x90, 0)).once(frame(0xF0, 0)); // ID
    bench.send(&[1, 2, 3]);
    bench.wait_ms(50);
    bench.once(frame(0x0F, 0xFF)); // reserved bits: taken all the same
    let stats = bench.ecu.stats;
    assert_eq!(stats.bad, Bad { crc: 1, range: 3, id: 2 });
    assert_eq!((stats.stray_bytes, stats.reserved_bits, stats.accepted), (3, 1, 1));
    assert_eq!(bench.ecu.commands.commands(), [ZkCommand::Empty]);
    assert_eq!(bench.ecu.state(), state::STOP);
    bench.ecu.receive(bench.now, Err(LineFault::Framing));
    assert_eq!(bench.ecu.stats.framing_errors, 1);
}

#[test]
fn the_times_between_commands_are_measured() {
    let mut bench = Bench::version(4);
    bench.host(&[EMPTY]).wait_ms(1000);
    let now = bench.now;
    bench.host(&[]).wait_ms(300);
    bench.host(&[EMPTY]).wait_ms(20);
    let intervals = bench.ecu.stats.intervals;
    assert_eq!(intervals.count, bench.ecu.stats.accepted - 1);
    assert_eq!(intervals.min, Some(50 * MILLIS));
    // The 21st frame is sent at the very end of the second, then nothing for 300 ms.
    assert_eq!(intervals.max, Some(300 * MILLIS));
    assert_eq!(now, 2 * SECOND);
}

#[test]
fn failures_show_as_errors_until_the_switch_leaves_run() {
    for (code, fail) in [
        (error::RPM_LOW, (|turbine: &mut Turbine| turbine.flame_out()) as fn(&mut Turbine)),
        (error::EGT_LOW, |turbine| turbine.no_light(true)),
        (error::EGT_HIGH, |turbine| turbine.hot_start(true)),
    ] {
        let mut bench = Bench::version(5);
        fail(bench.ecu.turbine_mut());
        bench.host(&[control(3, 0)]).until(|ecu| ecu.turbine().phase() == Phase::Running || ecu.error() != 0);
        fail(bench.ecu.turbine_mut());
        bench.until(|ecu| ecu.error() != 0);
        bench.wait_ms(1000);
        assert_eq!(bench.error_and_switch(), (code, 1));
        assert!(!bench.ecu.turbine().phase().is_live());
        bench.host(&[control(2, 0)]).wait_ms(1000);
        assert_eq!(bench.error_and_switch(), (0, 1));
    }
}

#[test]
fn unknown_numbers_can_be_reported() {
    let mut bench = Bench::new(ZkConfig { ids: vec![1, 10], ..ZkConfig::new(5) });
    bench.ecu.set_error(Some(29));
    bench.ecu.set_state(Some(25));
    bench.wait_ms(1000);
    assert_eq!((bench.last(1)[3] & 31, bench.error_and_switch().0), (25, 29));
    assert_eq!(bench.last(10)[0], 0xFA);
}

#[test]
fn how_often_it_is_called_changes_nothing() {
    let course = |version, every: Nanos| {
        let mut bench = Bench::new(ZkConfig::new(version));
        bench.host(&[control(3, 0)]);
        for _ in 0..40 * SECOND / every {
            bench.wait_ms(every / MILLIS);
        }
        (bench.seen, bench.ecu.stats, bench.ecu.turbine().rpm())
    };
    for version in [4, 5] {
        assert!(course(version, 5 * MILLIS) == course(version, 4 * SECOND));
    }
}

#[test]
fn nothing_that_a_host_sends_upsets_it() {
    for version in 1..=6 {
        let mut rng = fastrand::Rng::with_seed(u64::from(version));
        let mut bench = Bench::version(version);
        for _ in 0..5000 {
            let mut bytes = frame(rng.u8(..), rng.u8(..));
            if rng.u8(..) < 32 {
                bytes[rng.usize(..4)] = rng.u8(..);
            }
            bench.send(&bytes[..if rng.u8(..) < 16 { rng.usize(..4) } else { 4 }]);
            bench.wait_ms(rng.u64(5..300));
            let now = bench.now;
            match rng.u8(..) {
                0 => bench.ecu.power(now, false),
                4..20 => bench.ecu.power(now, true),
                1 => bench.ecu.receive(now, Err(LineFault::Noise)),
                2 => bench.ecu.set_pwm(Some(Pwm { switch: Switch::Run, throttle: rng.u16(..) })),
                3 => bench.ecu.set_pwm(None),
                _ => {}
            }
            let turbine = bench.ecu.turbine();
            assert!((0.0..=165_000.0).contains(&turbine.rpm()) && (0.0..=900.0).contains(&turbine.egt()));
        }
        let stats = bench.ecu.stats;
        assert!(stats.accepted > 500 && stats.bad.total() > 500 && stats.frames_sent() > 500, "{stats:?}");
    }
}

#[test]
fn over_the_wire_it_starts_and_runs() {
    use embassy_futures::join::join;
    use embassy_futures::select::select;
    use embassy_time::{Duration, Ticker};
    use embedded_io_async::{Read, Write};

    clock::reset();
    let (mut rx, mut tx, plug) =
        wire::connect(ZkEcu::new(ZkConfig::new(5).at(Rate::Hz100)), Line::n1(9600), 1);
    let sends = async {
        let mut ticker = Ticker::every(Duration::from_millis(20));
        loop {
            ticker.next().await;
            tx.write_all(&control(3, 0)).await.unwrap();
        }
    };
    let mut bytes = 0_u64;
    let reads = async {
        let mut buf = [0; 64];
        loop {
            bytes += rx.read(&mut buf).await.unwrap() as u64;
        }
    };
    let real = std::time::Instant::now();
    clock::run_for(select(join(sends, reads), plug.run()), Duration::from_secs(300));
    let took = real.elapsed();
    plug.ecu(|ecu| {
        assert_eq!(ecu.state(), state::MINIMUM);
        assert_eq!(ecu.stats.bad.total(), 0);
        assert_eq!(ecu.stats.intervals.min, Some(20 * MILLIS));
        assert_eq!(ecu.stats.intervals.max, Some(20 * MILLIS));
        assert!(bytes / 7 + 1 >= ecu.stats.frames_sent());
    });
    assert!(took.as_secs_f64() < 3.0, "300 s took {took:?}");
    println!("{:.0} times real time", 300.0 / took.as_secs_f64());
}
