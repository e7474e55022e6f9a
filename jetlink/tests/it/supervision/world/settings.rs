//! How the engines of a world are configured. Their ECUs are in `ecus/`.

use super::super::ecus;
use super::super::oracle::{Oracle, Truth};
use super::super::reader::Reader;
use super::super::rng::Rng;
use super::rig::{MS, Program, Rig, SECOND, Source};
use embassy_time::Duration;
use jetlink::command::Origin;
use jetlink::engine::config::{Governor, Slew, Supervision};
use jetlink::limit::Action;
use jetlink::units::{Celsius, Throttle};
use sim::wire::{Settings, connect_with};
use std::collections::VecDeque;
use std::rc::Rc;

pub(super) fn supervision(rng: &mut Rng) -> Supervision {
    let mut all = Supervision::DEFAULT;
    let ms = Duration::from_millis;
    if rng.percent(60) {
        all.timeouts.emergency = ms(rng.pick(&[200, 500, 2000]));
        all.timeouts.rc = ms(rng.pick(&[200, 500, 1000]));
        all.timeouts.mavlink = ms(rng.pick(&[500, 1000, 3000]));
        all.timeouts.bench = ms(rng.pick(&[300, 500, 1500]));
        all.recover_after = ms(rng.pick(&[100, 500, 1000, 2000]));
        all.return_within = ms(rng.pick(&[0, 300, 1000, 3000]));
        all.rise = rng.pick(&[100, 500, 1000]);
        all.loss.lower_standby_after = ms(rng.pick(&[0, 1000, 5000]));
        all.takeover.within = ms(rng.pick(&[0, 500, 2000, 5000]));
        all.loss.hold = ms(rng.pick(&[0, 300, 1000, 4000]));
        all.loss.throttle = Throttle::from_tenths(rng.pick(&[0, 0, 100, 250])).expect("in range");
        all.loss.ramp = rng.pick(&[100, 250, 500, 2000]);
        all.loss.standby_after = rng.pick(&[None, None, Some(ms(3000)), Some(ms(20_000))]);
        all.start.egt_max = Celsius::from_tenths(rng.pick(&[500, 1000]));
        all.start.arming = rng.percent(85);
    }
    if rng.percent(15) {
        all.slew = Slew { up: Some(rng.pick(&[100, 500])), down: rng.pick(&[None, Some(200), Some(500)]) };
    }
    if rng.percent(15) {
        all.limits.ecu_fault = Action::FailSafe;
    }
    if rng.percent(10) {
        all.when_other_fails = Some(500);
    }
    if rng.percent(10) {
        all.governor = Some(Governor::DEFAULT);
    }
    all
}

pub(super) fn rig(rng: &mut Rng, port: u8, gap: Duration) -> Rig {
    let mut supervision = supervision(rng);
    supervision.start.gap = gap;
    let (mut config, ecu) = ecus::random(rng, port);
    config.supervision = supervision;
    let line = sim::line_of!(config.line);
    let ecu = ecu.on(line);
    let holds_rpm = ecus::holds_rpm(&ecu);
    let (protocol, parameters) = (ecu.protocol(), *ecu.turbine());
    let (rx, tx, plug) = connect_with(ecu.ecu(), Settings::new(line, rng.next()));
    plug.record(true);
    let (idle, max) = (parameters.idle_rpm as u32, parameters.max_rpm as u32);
    let source = |origin| Source {
        origin,
        program: Program::Silent,
        period: 100 * MS,
        next: 0,
        changes: 0,
        on_since: 0,
        ready_since: None,
    };
    Rig {
        config,
        holds_rpm,
        max_rpm: max,
        plug,
        halves: (rx, tx),
        reader: Reader::new(protocol),
        oracle: Oracle::new(config, holds_rpm, idle, max),
        sources: Origin::SOURCES.map(source),
        inputs: VecDeque::new(),
        frames: VecDeque::new(),
        published: Rc::default(),
        line_until: None,
        hung_from: None,
        next_line: rng.wait(60 * SECOND),
        ecu_until: None,
        next_ecu: rng.wait(200 * SECOND),
        next_stop: rng.wait(300 * SECOND),
        next_arm: SECOND,
        next_silence: rng.wait(120 * SECOND),
        silent_until: 0,
        odd_until: 0,
        truth: Truth::default(),
        trace: VecDeque::new(),
        byte_at: 0,
        not_received: false,
    }
}
