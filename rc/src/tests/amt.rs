//! An AMT engine without speed control, which a node finds during its start after a reset.

use crate::channels::{Channels, Pulse};
use crate::outputs::{Before, Outputs, Valve};
use crate::pilot::{Outcome, Pilot};
use crate::settings::{EngineSettings, OutputSettings};
use bench::rows::{self, simulated};
use embassy_futures::join::join;
use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer};
use jetlink::channel::{Channel, Handle};
use jetlink::command::{Command, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::engine::retained::{Reset, RetainedMemory};
use jetlink::engine::state::EngineState;
use jetlink::line::Line;
use jetlink::runner::LineErrors;
use jetlink::units::Rpm;
use sim::clock;
use sim::wire::{Plug, WireRx, WireTx};
use std::cell::{Cell, RefCell};
use std::vec::Vec;

const ENGINE: EngineConfig = EngineConfig::amt("left", 0, Line::new(2400), Some(EngineModel::Olympus));
const STOP: u16 = 1000;
const STANDBY: u16 = 1500;
const RUN: u16 = 2000;

static ERRORS: LineErrors = LineErrors::new();

/// A node with radio control, its stick at idle, and outputs.
struct World<'a> {
    handle: Handle<'a>,
    switch: Cell<u16>,
    pilot: RefCell<Pilot<'a>>,
    outputs: RefCell<Outputs>,
    outcomes: RefCell<Vec<Outcome>>,
}

impl World<'_> {
    fn state(&self) -> EngineState {
        self.handle.telemetry().state
    }

    fn valve(&self) -> Valve {
        self.outputs.borrow().valve()
    }

    async fn until(&self, what: &str, seconds: u64, done: impl Fn() -> bool) {
        let so = clock::until(Duration::from_secs(seconds), Duration::from_millis(5), done).await;
        assert!(so, "not within {seconds} s: {what}, {:?}", self.handle.telemetry());
    }

    /// Armed, and the switch moved to run.
    async fn command_start(&self) {
        Timer::after_secs(3).await;
        self.switch.set(STANDBY);
        self.until("armed", 60, || self.handle.telemetry().armed).await;
        self.until("standby", 60, || self.state() == EngineState::Standby).await;
        Timer::after_secs(3).await;
        self.switch.set(RUN);
    }

    async fn serve(&self) {
        loop {
            Timer::after_millis(14).await;
            let mut pulses = [Pulse::CENTRE; 16];
            (pulses[2], pulses[4]) = (Pulse::new(1100).unwrap(), Pulse::new(self.switch.get()).unwrap());
            let outcome = self.pilot.borrow_mut().frame(Instant::now(), &Channels::new(pulses.map(Some)));
            self.outcomes.borrow_mut().push(outcome);
            self.outputs.borrow_mut().update(&self.handle.telemetry());
        }
    }
}

async fn life(
    (memory, reset): (&'static RetainedMemory, Reset),
    (rx, tx): (WireRx, WireTx),
    settings: EngineSettings,
    switch: u16,
    scenario: impl AsyncFnOnce(&World<'_>),
) {
    let channel = Channel::new(&ENGINE, Some((memory, reset)));
    let owner = channel.owner();
    let record = memory.load(ENGINE.fingerprint(), reset);
    let world = World {
        handle: owner.handle(),
        switch: Cell::new(switch),
        pilot: RefCell::new(Pilot::new(owner.source(Origin::Rc).unwrap(), &ENGINE, settings).unwrap()),
        outputs: RefCell::new(Outputs::new(OutputSettings::DEFAULT, Before { record, ..Before::default() })),
        outcomes: RefCell::default(),
    };
    let work = join(channel.runner().run(rx, tx, &ERRORS), world.serve());
    select(work, scenario(&world)).await;
}

fn begin(scenario: impl AsyncFnOnce(&Plug<sim::any::AnyEcu>, (WireRx, WireTx))) {
    clock::reset();
    let (rx, tx, plug) = rows::wire(&ENGINE, simulated(&ENGINE).ecu(), 1);
    clock::run(select(plug.run(), scenario(&plug, (rx, tx))));
}

/// The reset closes the valve, and the hot engine continues to turn. Radio control is at run throughout.
#[test]
fn radio_control_that_takes_over_a_start_that_was_found_opens_no_valve_before_the_engine_runs() {
    begin(async |plug, halves| {
        let memory = super::world::memory();
        let settings = EngineSettings::DEFAULT;
        life((memory, Reset::PowerLost), halves, settings, STOP, async |world| {
            world.command_start().await;
            world
                .until("it turns", 60, || {
                    let telemetry = world.handle.telemetry();
                    let rpm = telemetry.report.rpm.is_some_and(|rpm| rpm.value.get() > 20_000);
                    matches!(telemetry.state, EngineState::Starting(_)) && rpm
                })
                .await;
            assert_eq!(world.valve(), Valve::Open);
        })
        .await;
        life((memory, Reset::Warm), plug.reset_node(), settings, RUN, async |world| {
            assert_eq!(world.valve(), Valve::Closed);
            world
                .until("taken over", 10, || {
                    let telemetry = world.handle.telemetry();
                    telemetry.ordered.origin == Origin::Rc && telemetry.start_by.is_some()
                })
                .await;
            world
                .until("open", 60, || {
                    let open = world.valve() == Valve::Open;
                    let telemetry = world.handle.telemetry();
                    assert!(!open || telemetry.state == EngineState::Running, "{telemetry:?}");
                    open
                })
                .await;
        })
        .await;
    });
}

/// A start with the stick at idle would start with a throttle, and the shaft speed commanded next would be refused: the engine would lose its
/// source in mid-start.
#[test]
fn stick_that_commands_a_shaft_speed_starts_no_engine_whose_ecu_has_no_speed_control() {
    let of = |rpm| Some(Rpm::new(rpm));
    let rpm = EngineSettings { rpm_low: of(35_000), rpm_high: of(90_000), ..EngineSettings::DEFAULT };
    for (settings, starts) in [(rpm, false), (EngineSettings::DEFAULT, true)] {
        begin(async |plug, halves| {
            let memory = super::world::memory();
            life((memory, Reset::PowerLost), halves, settings, STOP, async |world| {
                world.command_start().await;
                Timer::after_secs(15).await;
                let refused = world.outcomes.borrow().iter().any(|outcome| {
                    matches!(outcome, Outcome::Commanded(Command::Run(_), Err(Rejected::NoSpeedControl)))
                });
                let is_standby = world.handle.telemetry().ordered.order == Order::Standby;
                assert_eq!((refused, is_standby), (!starts, !starts));
                assert_eq!(world.pilot.borrow().counters().starts_refused, u32::from(!starts));
                assert_eq!(plug.ecu(|ecu| ecu.turbine().history().ignitions.len()), usize::from(starts));
            })
            .await;
        });
    }
}
