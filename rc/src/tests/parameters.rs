//! Settings of radio control and outputs as MAVLink sets them, and what it reports of both.

use super::world::*;
use crate::crsf::Crsf;
use crate::input::Input;
use crate::outputs::{Before, Outputs};
use crate::parameters::{Parameters, apply, rows};
use crate::pilot::Pilot;
use crate::sbus::Sbus;
use crate::service::Service;
use crate::settings::{EngineSettings, OutputSettings};
use crate::shared::Shared;
use crate::wiring::{OutputConfig, OutputPin};
use bench::rows::{self, simulated};
use embassy_futures::select::select;
use embassy_time::{Duration, Instant};
use jetlink::channel::Channel;
use jetlink::command::{Command, Demand, Order, Origin};
use jetlink::engine::retained::RetainedState;
use jetlink::engine::state::EngineState;
use jetlink::runner::LineErrors;
use jetlink::units::{Rpm, Throttle};
use jetlink_mavlink::attached::{self, Attached};
use jetlink_mavlink::refusal::Refusal;
use sim::clock;
use sim::receiver::{crsf_link, sbus, steps};
use std::cell::RefCell;
use std::string::ToString;

static ERRORS: LineErrors = LineErrors::new();
const RUN_AT_IDLE: Order = Order::Run(Demand::Throttle(Throttle::IDLE));

/// All of them are within 16 more than the 40 that an engine has, each value fits a 32-bit float, and the order is fixed.
#[test]
fn tables_are_those_of_what_the_node_has() {
    let names =
        |radio, outputs| rows(radio, outputs).iter().map(|table| table.len()).collect::<std::vec::Vec<_>>();
    let (radio, outputs) = (EngineSettings::ROWS.len(), OutputSettings::ROWS.len());
    assert_eq!([names(false, false), names(false, true)], [std::vec![], std::vec![outputs]]);
    assert_eq!([names(true, false), names(true, true)], [std::vec![radio], std::vec![radio, outputs]]);
    assert!(radio + outputs <= 16);
    for row in rows(true, true).iter().copied().flatten() {
        assert!(row.min.unsigned_abs().max(row.max.unsigned_abs()) <= 1 << 24, "{}", row.name);
    }
}

#[test]
fn calibration_of_stick_and_switch_is_refused_while_the_engine_turns() {
    clock::reset();
    let (rx, tx, plug) = rows::wire(&ENGINE, simulated(&ENGINE).ecu(), 1);
    let channel = Channel::new(&ENGINE, None);
    let owner = channel.owner();
    let pilot = Pilot::new(owner.source(Origin::Rc).unwrap(), &ENGINE, EngineSettings::DEFAULT).unwrap();
    let radio = RefCell::new(Service::<'_, 1>::new(Input::Sbus(Sbus::new()), [pilot]));
    let shared = Shared::new();
    let mut parameters = Parameters::new(Some(&radio), Some((&shared, [OutputSettings::DEFAULT])));
    let bench = owner.source(Origin::Bench).unwrap();
    let wait =
        async |seconds| clock::until(Duration::from_secs(seconds), Duration::from_millis(20), || false).await;
    let scenario = async {
        // At rest all of them are set, and the pilot has them.
        wait(15).await;
        for (name, number) in
            [("RC_THR_MIN", 1200), ("RC_THR_REV", 1), ("RC_RPM_MIN", 30_000), ("RC_RPM_MAX", 90_000)]
        {
            assert_eq!(parameters.set(0, name, number), Ok(()), "{name}");
            assert_eq!(parameters.number(0, name), Some(number));
        }
        let low = Some(Rpm::new(30_000));
        let expected = EngineSettings {
            low: 1200,
            reversed: true,
            rpm_low: low,
            rpm_high: Some(Rpm::new(90_000)),
            ..EngineSettings::DEFAULT
        };
        assert_eq!(radio.borrow().pilots()[0].settings(), &expected);
        // A calibration sets the end points seen; an invalid one sets nothing.
        let mut now = Instant::now();
        let mut see = |pulses: [u16; 2]| {
            for pulse in pulses.into_iter().flat_map(|pulse| [pulse; 4]) {
                let mut steps = [steps(1500); 16];
                steps[2] = self::steps(pulse);
                now += Duration::from_millis(14);
                radio.borrow_mut().receive(now, &sbus(steps, 0), false, |_, _| {});
            }
        };
        let not = |why: &str| Refusal::Malformed(std::string::String::from(why).leak());
        assert_eq!(parameters.calibrate(0, false), Err(not("begin a calibration first")));
        for (pulses, done) in [
            ([1400, 1500], Err(not("move the stick from one end to the other and try again"))),
            ([1000, 2000], Ok(())),
        ] {
            assert_eq!(parameters.calibrate(0, true), Ok(()));
            see(pulses);
            assert_eq!(parameters.calibrate(0, false), done);
        }
        assert_eq!(parameters.calibrated().map(|name| parameters.number(0, name)), [Some(1000), Some(2000)]);
        assert_eq!(parameters.calibrate(1, true), Err(Refusal::NoReceiver));
        assert_eq!(parameters.set(0, "RC_THR_MIN", 1200), Ok(()));
        // Settings that contradict each other are refused, with a reason.
        for (name, number, why) in [
            ("RC_THR_MAX", 1400, "RC_THR_MAX has to be 300 µs above RC_THR_MIN or more"),
            ("RC_SW_RUN", 1400, "RC_SW_RUN has to be 300 µs above RC_SW_STOP or more"),
            ("RC_SW_CH", 3, "throttle, switch and hand-over need a channel each"),
            ("RC_RPM_MAX", 20_000, "RC_RPM_MAX has to be above RC_RPM_MIN"),
        ] {
            let before = parameters.number(0, name);
            let refused = parameters.set(0, name, number).unwrap_err();
            assert_eq!((refused.to_string().as_str(), parameters.number(0, name)), (why, before), "{name}");
        }
        assert_eq!(parameters.set(0, "OUT_NOT_OBEYED", 7000), Ok(()));
        assert_eq!(parameters.set(0, "RC_NOTHING", 1), Err(Refusal::UnknownSetting));
        assert_eq!(
            (parameters.set(1, "RC_THR_CH", 1), parameters.number(1, "RC_THR_CH")),
            (Err(Refusal::UnknownSetting), None)
        );
        // It runs: no setting of radio control can be changed.
        bench.command(Command::Arm).unwrap();
        let stream = async |order: Command| loop {
            let _ = bench.command(order);
            wait(0).await;
            clock::until(Duration::from_millis(100), Duration::from_millis(20), || false).await;
        };
        select(stream(Command::Standby), wait(2)).await;
        let running = clock::until(Duration::from_secs(120), Duration::from_millis(20), || {
            owner.handle().telemetry().state == EngineState::Running
        });
        let running = select(stream(Command::Run(Demand::Throttle(Throttle::IDLE))), running).await;
        assert!(matches!(running, embassy_futures::select::Either::Second(true)));
        for begin in [true, false] {
            assert!(parameters.calibrate(0, begin).is_err_and(|why| why == Refusal::Turns || !begin));
        }
        for row in EngineSettings::ROWS {
            let before = parameters.number(0, row.name).unwrap();
            assert_eq!(parameters.set(0, row.name, before), Err(Refusal::Turns), "{}", row.name);
        }
        assert_eq!(parameters.set(0, "OUT_NOT_OBEYED", 8000), Ok(()), "it takes effect at the next start");
        assert_eq!(parameters.number(0, "OUT_NOT_OBEYED"), Some(8000));
    };
    let work = embassy_futures::join::join(plug.run(), channel.runner().run(rx, tx, &ERRORS));
    clock::run(select(work, scenario));
}

#[test]
fn outputs_and_their_changes_reach_mavlink_as_far_as_there_are_pins() {
    let shared: Shared<2> = Shared::new();
    let mut parameters = Parameters::<2>::new(None, Some((&shared, [OutputSettings::DEFAULT; 2])));
    assert!(parameters.has_outputs() && parameters.channels(Instant::from_secs(1)).is_none());
    assert_eq!(parameters.outputs(0), attached::Outputs::default());
    let ran = RetainedState::new(RUN_AT_IDLE, Origin::Rc).with(|state| state.ran = true);
    let outputs = Outputs::new(
        OutputSettings::DEFAULT,
        Before { record: Some(ran), has_failed: false, ..Before::default() },
    );
    let valve = OutputConfig::valve(OutputPin::high(0));
    shared.set(1, &valve, &outputs, outputs.restored());
    assert_eq!(parameters.outputs(1), attached::Outputs { valve: Some(true), power: None });
    let change = parameters.next_change().unwrap();
    assert_eq!((change.engine, change.what, change.alarming), (1, "fuel valve open", false));
    assert_eq!(parameters.next_change(), None, "it has no output for power");
    // More than the queue takes: the last ones stay.
    let cut = Outputs::new(
        OutputSettings::DEFAULT,
        Before { record: Some(ran), has_failed: true, ..Before::default() },
    );
    (0..20).for_each(|_| shared.set(0, &valve.with_power(OutputPin::high(1)), &cut, cut.restored()));
    assert_eq!(parameters.outputs(0), attached::Outputs { valve: Some(false), power: Some(true) });
    let changes: std::vec::Vec<_> = core::iter::from_fn(|| parameters.next_change()).collect();
    assert_eq!(changes.len(), 16);
    assert!(changes.iter().step_by(2).all(|change| change.what == "fuel valve closed" && change.alarming));
}

#[test]
fn channels_are_those_of_the_receiver_while_it_sends() {
    let radio = RefCell::new(Service::<'_, 1>::new(Input::Sbus(Sbus::new()), []));
    let parameters = Parameters::new(Some(&radio), None);
    let at = |ms: u64| Instant::from_millis(10_000 + ms);
    assert_eq!(parameters.channels(at(0)), Some([None; 18]), "nothing is received");
    let mut steps = [992; 16];
    steps[2] = 352;
    for frame in 0..5 {
        radio.borrow_mut().receive(at(14 * frame), &sbus(steps, 0), false, |_, _| {});
    }
    let channels = parameters.channels(at(60)).unwrap();
    assert_eq!((channels[0], channels[2], channels[15]), (Some(1500), Some(1100), Some(1500)));
    assert_eq!(parameters.channels(at(600)), Some([None; 18]));
    assert_eq!(parameters.link_quality(at(60)), None, "SBUS has no figure for it");
}

#[test]
fn link_quality_is_that_of_the_last_second() {
    let radio = RefCell::new(Service::<'_, 1>::new(Input::Crsf(Crsf::new()), []));
    let parameters = Parameters::new(Some(&radio), None);
    let at = |ms: u64| Instant::from_millis(10_000 + ms);
    assert_eq!(parameters.link_quality(at(0)), None);
    for (ms, quality) in [(0, 100), (200, 0), (400, 73)] {
        radio.borrow_mut().receive(at(ms), &crsf_link(quality), false, |_, _| {});
        assert_eq!(parameters.link_quality(at(ms)), Some(quality));
    }
    assert_eq!([1400, 1401].map(|ms| parameters.link_quality(at(ms))), [Some(73), None]);
}

#[test]
fn stored_settings_are_taken_where_they_fit_together() {
    let apply_to = |record: &[u8]| {
        let (mut radio, mut outputs) = (EngineSettings::DEFAULT, OutputSettings::DEFAULT);
        apply(Some(&mut radio), Some(&mut outputs), record);
        (radio, outputs)
    };
    let defaults = (EngineSettings::DEFAULT, OutputSettings::DEFAULT);
    let entry = |name: &str, number: i32| {
        let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(name.as_bytes()) as u16;
        [&crc.to_le_bytes()[..], &number.to_le_bytes()].concat()
    };
    let of = |kind: u8, entries: &[(&str, i32)]| {
        let entries = entries.iter().flat_map(|(name, number)| entry(name, *number));
        [kind].into_iter().chain(entries).collect::<std::vec::Vec<u8>>()
    };
    let good = of(0xFF, &[("RC_THR_CH", 1), ("RC_SW_CH", 2), ("OUT_NOT_OBEYED", 9000), ("GONE", 7)]);
    let radio = EngineSettings { throttle: 1, switch: 2, ..EngineSettings::DEFAULT };
    assert_eq!(apply_to(&good), (radio, OutputSettings { not_obeyed: Some(Duration::from_secs(9)) }));
    // Two functions on one channel; another kind of record; out of range; torn.
    assert_eq!(apply_to(&of(0xFF, &[("RC_THR_CH", 5)])), defaults);
    assert_eq!(apply_to(&of(1, &[("RC_THR_CH", 1)])), defaults);
    assert_eq!(apply_to(&of(0xFF, &[("RC_THR_CH", 19), ("OUT_NOT_OBEYED", 1)])), defaults);
    assert_eq!(apply_to(&good[..4]), defaults);
    // Without a receiver its settings stay unchanged.
    let mut outputs = OutputSettings::DEFAULT;
    apply(None, Some(&mut outputs), &good);
    assert_eq!(outputs.not_obeyed, Some(Duration::from_secs(9)));
}
