//! A toy protocol outside of the library, by docs/porting.md ("A new ECU protocol, in one folder"): codec, settings, services,
//! faults, link, a simulated ECU and the tests of each. What is missing is the line in the library's list, and with it the
//! runner between link and ECU.
//!
//! The protocol's document: 9600 baud, 8N1, frames of two bytes.
//!
//! - ECU to host, every 100 ms: 0xA5, then the state: 0 at rest, 1 running; bit 7 is set while the engine is overheated.
//! - Host to ECU: 0x5A, then 0 for nothing, 1 for standby, 2 for run, 3 for an emergency stop, 4 to prime the fuel line.
//! - An ECU without a command for 1 s stops its engine.

mod codec;
mod config;
mod ecu;
mod link;

use crate::support::bench::Bench;
use codec::{Control, Decoder, Faults, Frame, State};
use config::{Config, Mistake, Service};
use ecu::ToyEcu;
use embassy_time::Duration;
use jetlink::command::{Demand, Order, Rejected};
use jetlink::ecu::vendor::{VendorFaults, VendorService};
use jetlink::event::Event;
use jetlink::line::Line;
use jetlink::link::{Link, Sign, Speaks, Stage};
use jetlink::report::{LinkState, Phase};
use jetlink::setting::Effect;
use jetlink::units::Throttle;
use link::ToyLink;
use sim::ecu::Ecu;

const LINE: Line = Line::new(9600);
const RUN: Order = Order::Run(Demand::Throttle(Throttle::IDLE));

fn bench() -> Bench<ToyLink> {
    Bench::new(Config::DEFAULT.link(LINE, Config::TIMING), LINE)
}

/// The document's numbers, in any chunks; numbers without a name stay known.
#[test]
fn toy_codec_has_the_numbers_of_the_document() {
    let frame = |state, overheated| Frame { state, faults: Faults { overheated } };
    for (byte, expected) in [
        (0x00, frame(State::Rest, false)),
        (0x01, frame(State::Running, false)),
        (0x81, frame(State::Running, true)),
        (0x7F, frame(State::Unknown(0x7F), false)),
    ] {
        assert_eq!(Decoder::default().feed(&[0x00, 0xA5, byte, 0xA5]), (3, Some(expected)));
        let mut decoder = Decoder::default();
        assert_eq!(decoder.feed(&[0xA5]), (1, None));
        assert_eq!(decoder.feed(&[byte]), (1, Some(expected)));
    }
    let controls = [Control::Nothing, Control::Standby, Control::Run, Control::EmergencyStop, Control::Prime];
    assert_eq!(controls.map(Control::encode), [[0x5A, 0], [0x5A, 1], [0x5A, 2], [0x5A, 3], [0x5A, 4]]);
    assert_eq!(
        (Faults { overheated: true }.number(), Faults { overheated: true }.to_string()),
        (1, "overheated".into())
    );
}

/// The table of settings has what a parameter needs, and refuses what the line cannot carry.
#[test]
fn toy_settings_have_range_default_and_effect() {
    let [row] = Config::SETTINGS else { panic!("one row") };
    assert_eq!((row.name, row.field, row.default), ("TOY_SEND_EVERY", "ecu.send_every", 100));
    assert_eq!((Config::ROWS[0].name, Config::ROWS[0].effect), (row.name, Effect::AtRest));
    let mut config = Config::DEFAULT;
    assert!(config.set_own("TOY_SEND_EVERY", 20) && config.own("TOY_SEND_EVERY") == Some(20));
    assert_eq!(config.check(LINE), Ok(()));
    assert_eq!(config.check(Line::new(600)), Err(Mistake::LineTooSlow));
    config.send_every = Duration::from_millis(19);
    let mistake = config.check(LINE).unwrap_err();
    assert_eq!((mistake, mistake.message()), (Mistake::Setting, "ecu.send_every: 20 to 500 ms"));
    assert!(
        Service::Prime.moves_fuel() && Service::Prime.needs_stopped_engine() && !Service::Prime.closes_pump()
    );
    assert_eq!(Service::Prime.to_string(), "prime");
}

#[test]
fn toy_link_keeps_its_timing_table() {
    let mut bench = bench();
    bench.run_to_us(150_000);
    assert_eq!(bench.frames(), [(0, vec![0x5A, 0]), (100_000, vec![0x5A, 0])], "nothing is ordered");
    bench.rx_at_us(160_000, &[0, 0xA5, 1]);
    assert_ne!(bench.machine.status().state, LinkState::Up, "one frame");
    bench.rx_at_us(260_000, &[0xA5, 1]);
    let status = bench.machine.status();
    assert_eq!((status.state, status.report.phase.unwrap().value), (LinkState::Up, Phase::Running));
    let sign = Sign::State { stage: Stage::Running, turning: Some(true), throttle: None };
    assert_eq!(bench.machine.take_sign(), Some(sign));
    bench.frames();
    for (order, code) in [(RUN, 2), (Order::Doubt(Demand::Throttle(Throttle::IDLE)), 0), (Order::Standby, 1)]
    {
        bench.order(bench.now_us(), order).unwrap();
        bench.run_to_us(bench.now_us() + 100_000);
        assert_eq!(bench.bytes(), [[0x5A, code]], "{order:?}");
    }
    assert_eq!(bench.order(bench.now_us(), Order::Pwm), Err(Rejected::NotSupported));
    bench.events();
    bench.run_to_us(759_999);
    assert_eq!(bench.events(), []);
    bench.run_to_us(760_000);
    assert_eq!(bench.events(), [(760_000, Event::LinkLost)]);
}

/// New settings of a link that is in use count from the next send slot and the next frame on.
#[test]
fn toy_link_takes_new_settings() {
    let mut bench = bench();
    bench.run_to_us(50_000);
    let config = Config { send_every: Duration::from_millis(20) };
    bench.act(|link, now| config.configure(link, now, LINE, Config::TIMING));
    bench.run_to_us(150_000);
    let at: Vec<u64> = bench.frames().into_iter().map(|(at, _)| at).collect();
    assert_eq!(at, [0, 100_000, 120_000, 140_000]);
}

/// Link and simulated ECU, with the time that bytes take on the line.
#[test]
fn toy_link_runs_a_simulated_ecu() {
    let mut bench = bench();
    let mut ecu = ToyEcu::default();
    ecu.power(0, true);
    let byte_us = LINE.time_of(1).as_micros();
    // Bytes on their way, with the time at which each is complete.
    let (mut to_ecu, mut to_node) = (Vec::<(u64, u8)>::new(), Vec::<(u64, u8)>::new());
    let mut running = [false; 3];
    for millis in 0..4000 {
        let now = millis * 1000;
        let order = match millis {
            0..1000 => Order::Standby,
            1000..2000 => RUN,
            _ => Order::EmergencyStop,
        };
        if millis % 1000 == 0 {
            bench.order(now, order).unwrap();
        }
        bench.run_to_us(now);
        for (from, bytes) in bench.frames() {
            to_ecu.extend((1..).zip(bytes).map(|(place, byte)| (from + place * byte_us, byte)));
        }
        for (at, byte) in to_ecu.extract_if(.., |(at, _)| *at <= now) {
            ecu.receive(at * 1000, Ok(byte));
        }
        let mut sent = Vec::new();
        ecu.advance(now * 1000, &mut sent);
        to_node.extend((1..).zip(sent).map(|(place, byte)| (now + place * byte_us, byte)));
        for (_, byte) in to_node.extract_if(.., |(at, _)| *at <= now) {
            bench.receive(&[byte]);
        }
        if let Some(seen) = running.get_mut(millis as usize / 1000)
            && millis % 1000 == 900
        {
            *seen = bench.machine.status().report.phase.unwrap().value == Phase::Running;
            assert_eq!(*seen, ecu.running);
        }
    }
    assert_eq!(running, [false, true, false]);
    assert_eq!(bench.machine.status().state, LinkState::Up);
    ecu.commands.dedup();
    assert_eq!(ecu.commands, [0, 1, 2, 3], "the first slot is before the first order");
}
