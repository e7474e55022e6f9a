//! The runner: a UART with its faults, one receiver for an AMT and a ZK engine of a group, from the bytes of the receiver to the
//! turbines.

use super::world::{IDLE, RUN, STANDBY, STOP};
use crate::calibration::CalibrationError;
use crate::crsf::Crsf;
use crate::input::Input;
use crate::pilot::{Outcome, Pilot};
use crate::runner;
use crate::sbus::Sbus;
use crate::service::Service;
use crate::settings::EngineSettings;
use bench::rows::{self, simulated};
use embassy_futures::join::{join, join3};
use embassy_futures::select::select;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorKind, ErrorType, Read};
use jetlink::channel::{Channel, Handle};
use jetlink::command::{Command, Demand, Order, Origin};
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::ecu::zk::codec::Rate;
use jetlink::engine::config::Governor;
use jetlink::engine::state::EngineState;
use jetlink::event::LossStage;
use jetlink::line::Line;
use jetlink::line::LineError;
use jetlink::runner::LineErrors;
use jetlink::units::Rpm;
use sim::clock;
use sim::receiver::{crsf, sbus, steps};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::future::poll_fn;
use std::task::{Poll, Waker};
use std::vec::Vec;

/// A UART receiver: its driver keeps unread bytes.
#[derive(Default)]
struct Uart {
    bytes: RefCell<VecDeque<u8>>,
    waker: RefCell<Option<Waker>>,
    errors: LineErrors,
    /// The next read fails.
    fails: Cell<bool>,
    reads: Cell<u32>,
}

impl Uart {
    fn push(&self, byte: u8) {
        self.bytes.borrow_mut().push_back(byte);
        self.wake();
    }

    fn fail(&self) {
        self.fails.set(true);
        self.wake();
    }

    fn wake(&self) {
        if let Some(waker) = self.waker.take() {
            waker.wake();
        }
    }
}

struct Rx<'a>(&'a Uart);

impl ErrorType for Rx<'_> {
    type Error = ErrorKind;
}

impl Read for Rx<'_> {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, ErrorKind> {
        poll_fn(|cx| {
            let mut bytes = self.0.bytes.borrow_mut();
            if !self.0.fails.get() && bytes.is_empty() {
                self.0.waker.replace(Some(cx.waker().clone()));
                return Poll::Pending;
            }
            self.0.reads.set(self.0.reads.get() + 1);
            if self.0.fails.take() {
                return Poll::Ready(Err(ErrorKind::Other));
            }
            let count = bytes.len().min(buffer.len());
            buffer.iter_mut().zip(bytes.drain(..count)).for_each(|(slot, byte)| *slot = byte);
            Poll::Ready(Ok(count))
        })
        .await
    }
}

/// A receiver that sends its frames byte by byte, as its line carries them.
struct Receiver {
    crsf: bool,
    stick: Cell<u16>,
    switch: Cell<u16>,
    /// Channel 6.
    sixth: Cell<u16>,
    /// The transmitter is on.
    on: Cell<bool>,
    /// The UART reports wrong parity for this byte of each frame.
    damages: Cell<Option<usize>>,
}

impl Receiver {
    const fn new(crsf: bool) -> Self {
        Self {
            crsf,
            stick: Cell::new(IDLE),
            switch: Cell::new(STOP),
            sixth: Cell::new(1500),
            on: Cell::new(true),
            damages: Cell::new(None),
        }
    }

    async fn send(&self, uart: &Uart) {
        let (every, byte) = if self.crsf { (7000, 24) } else { (14_000, 120) };
        let mut next = Instant::now();
        loop {
            next += Duration::from_micros(every);
            Timer::at(next).await;
            let mut channels = [992; 16];
            (channels[2], channels[4]) = (steps(self.stick.get()), steps(self.switch.get()));
            channels[5] = steps(self.sixth.get());
            let frame = match (self.crsf, self.on.get()) {
                (true, true) => crsf(channels),
                (true, false) => continue,
                (false, on) => sbus(channels, if on { 0 } else { 0x0C }),
            };
            for (i, &sent) in frame.iter().enumerate() {
                Timer::after(Duration::from_micros(byte)).await;
                // The interrupt counts the fault before its byte can be read.
                if self.damages.get() == Some(i) {
                    uart.errors.count(LineError::Parity);
                }
                uart.push(sent);
            }
        }
    }
}

struct World<'w, 'c> {
    receiver: &'w Receiver,
    uart: &'w Uart,
    service: &'w RefCell<Service<'c, 2>>,
    engines: [Handle<'c>; 2],
    outcomes: &'w RefCell<Vec<(Instant, usize, Outcome)>>,
}

impl World<'_, '_> {
    async fn pass_ms(&self, ms: u64) {
        Timer::after(Duration::from_millis(ms)).await;
    }

    #[track_caller]
    fn until(&self, what: &'static str, seconds: u64, done: impl Fn() -> bool) -> impl Future<Output = ()> {
        let caller = core::panic::Location::caller();
        async move {
            let so = clock::until(Duration::from_secs(seconds), Duration::from_millis(5), done).await;
            assert!(so, "not within {seconds} s: {what} ({caller}), {:?}", self.outcomes.borrow().last());
        }
    }

    fn states(&self) -> [EngineState; 2] {
        self.engines.each_ref().map(|engine| engine.telemetry().state)
    }

    /// Throttle of the orders, in 0.1 %.
    fn ordered(&self) -> [Option<u16>; 2] {
        self.engines.each_ref().map(|engine| match engine.telemetry().ordered.order {
            Order::Run(Demand::Throttle(throttle)) => Some(throttle.tenths()),
            _ => None,
        })
    }

    fn both(&self, what: impl Fn(&Handle<'_>) -> bool) -> bool {
        self.engines.iter().all(what)
    }

    async fn start(&self) {
        self.command_start().await;
        self.until("running", 240, || self.states() == [EngineState::Running; 2]).await;
        self.pass_ms(5000).await;
    }

    /// The second engine's start waits for the first one's.
    async fn start_of_which_one_waits(&self) {
        self.command_start().await;
        self.until("a wait", 2, || self.engines[1].telemetry().start_waits_until.is_some()).await;
        self.pass_ms(1000).await;
    }

    async fn command_start(&self) {
        self.pass_ms(2000).await;
        self.receiver.switch.set(STANDBY);
        self.until("armed", 30, || self.both(|engine| engine.telemetry().armed)).await;
        self.until("standby", 60, || self.states() == [EngineState::Standby; 2]).await;
        self.pass_ms(2000).await;
        self.receiver.switch.set(RUN);
    }
}

/// A node with an AMT and a ZK engine of a group, and one receiver.
fn run(crsf: bool, scenario: impl AsyncFnOnce(&World<'_, '_>)) {
    run_with(crsf, [EngineSettings::DEFAULT; 2], scenario);
}

/// The same with these settings of both engines. The AMT engine has a governor.
fn run_with(crsf: bool, settings: [EngineSettings; 2], scenario: impl AsyncFnOnce(&World<'_, '_>)) {
    clock::reset();
    let mut configs = [
        EngineConfig::amt("left", 0, Line::new(2400), Some(EngineModel::Olympus)),
        EngineConfig::zk("right", 1, Line::new(9600), Rate::Hz20),
    ];
    configs[0].supervision.governor = Some(Governor::DEFAULT);
    let wires = configs.each_ref().map(|config| rows::wire(config, simulated(config).ecu(), 1));
    let channels = configs.each_ref().map(|config| Channel::new(config, None));
    let owners = channels.each_ref().map(|channel| channel.owner_in(&channels));
    let engines = owners.map(|owner| owner.handle());
    let input = if crsf { Input::Crsf(Crsf::new()) } else { Input::Sbus(Sbus::new()) };
    let pilots = owners.iter().zip(&configs).zip(settings).map(|((owner, config), settings)| {
        Pilot::new(owner.source(Origin::Rc).unwrap(), config, settings).unwrap()
    });
    let service = RefCell::new(Service::<2>::new(input, pilots));
    let (uart, receiver) = (Uart::default(), Receiver::new(crsf));
    let outcomes = RefCell::<Vec<(Instant, usize, Outcome)>>::default();
    let [(rx_0, tx_0, plug_0), (rx_1, tx_1, plug_1)] = wires;
    let errors = [LineErrors::new(), LineErrors::new()];
    let nodes = join(
        channels[0].runner_in(&channels).run(rx_0, tx_0, &errors[0]),
        channels[1].runner_in(&channels).run(rx_1, tx_1, &errors[1]),
    );
    let note = |at, engine, outcome| outcomes.borrow_mut().push((at, engine, outcome));
    let radio = join(receiver.send(&uart), runner::run(&service, Rx(&uart), &uart.errors, note));
    let world = World { receiver: &receiver, uart: &uart, service: &service, engines, outcomes: &outcomes };
    let work = join3(join(plug_0.run(), plug_1.run()), nodes, radio);
    clock::run(select(work, scenario(&world)));
}

fn sbus_counters(world: &World<'_, '_>) -> crate::sbus::SbusCounters {
    match world.service.borrow().input() {
        Input::Sbus(sbus) => *sbus.counters(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn one_receiver_starts_throttles_and_stops_two_engines_of_a_group() {
    for crsf in [false, true] {
        run(crsf, async |world| {
            world.start().await;
            assert_eq!(world.ordered(), [Some(0); 2]);
            // The second one waited, and its start needed no further move.
            let waited = |engine| {
                let outcomes = world.outcomes.borrow();
                let waits = |(_, of, outcome): &&(Instant, usize, Outcome)| {
                    *of == engine
                        && matches!(
                            outcome,
                            Outcome::Commanded(_, Ok(jetlink::command::Accepted::StartWaits))
                        )
                };
                outcomes.iter().filter(waits).count()
            };
            assert!(waited(0) == 0 && waited(1) > 100, "{} and {}", waited(0), waited(1));
            for (stick, tenths) in [(1500, 500), (1900, 1000), (1300, 250)] {
                world.receiver.stick.set(stick);
                world.until("the throttle", 15, || world.ordered() == [Some(tenths); 2]).await;
            }
            world.receiver.switch.set(STOP);
            let stop = Instant::now();
            world.until("stop", 1, || world.both(|engine| engine.telemetry().stop_latched)).await;
            assert!(Instant::now() - stop <= Duration::from_millis(if crsf { 25 } else { 45 }));
            assert!(world.both(|engine| !engine.telemetry().armed));
        });
    }
}

#[test]
fn transmitter_off_is_each_stage_of_loss_for_both_engines() {
    for crsf in [false, true] {
        run(crsf, async |world| {
            world.start().await;
            world.receiver.stick.set(1900);
            world.until("full throttle", 15, || world.ordered() == [Some(1000); 2]).await;
            world.receiver.on.set(false);
            let lost = |stage| move |engine: &Handle<'_>| engine.telemetry().loss == stage;
            world.until("the first stage", 1, || world.both(lost(LossStage::Hold))).await;
            assert_eq!(world.ordered(), [Some(1000); 2]);
            world.until("the second stage", 3, || world.both(lost(LossStage::FailSafe))).await;
            world.until("idle", 5, || world.ordered() == [Some(0); 2]).await;
            world.pass_ms(10_000).await;
            assert_eq!(world.states(), [EngineState::Running; 2]);
            world.receiver.on.set(true);
            world.until("full throttle", 15, || world.ordered() == [Some(1000); 2]).await;
        });
    }
}

/// The UART reports wrong parity for one byte of each frame: no frame counts, whichever byte it is. Without the reports all
/// count.
#[test]
fn frame_with_a_fault_of_the_uart_does_not_count() {
    for damaged in [0, 1, 12, 23, 24] {
        run(false, async |world| {
            world.pass_ms(1000).await;
            let before = (sbus_counters(world), world.outcomes.borrow().len());
            world.receiver.damages.set(Some(damaged));
            world.pass_ms(1400).await;
            let now = (sbus_counters(world), world.outcomes.borrow().len());
            let damaged_frames = now.0.line_errors - before.0.line_errors;
            assert!((99..=100).contains(&damaged_frames), "byte {damaged}: {now:?}");
            assert!(now.1 - before.1 <= 2, "byte {damaged}: {} outcomes", now.1 - before.1);
            world.receiver.damages.set(None);
            world.pass_ms(1400).await;
            assert!(world.outcomes.borrow().len() - now.1 >= 2 * 95, "byte {damaged}");
        });
    }
}

/// Counters of a receiver for people: each kind of damage has its own.
#[test]
fn what_was_received_is_counted_for_people() {
    use crate::reception::{Reception, Unused};
    let reception = |input: &Input| input.reception();
    let mut sbus_input = Input::Sbus(Sbus::new());
    let mut at = Instant::from_millis(100);
    let mut send = |input: &mut Input, bytes: &[u8]| {
        at += Duration::from_millis(14);
        input.receive(at, bytes);
    };
    let centred = [992; 16];
    // The first one after a power-up does not count.
    for flags in [0, 0, 0x04, 0x0C] {
        send(&mut sbus_input, &sbus(centred, flags));
    }
    send(&mut sbus_input, &sbus(centred, 0x10));
    send(&mut sbus_input, &sbus(centred, 0)[..20]);
    send(&mut sbus_input, &sbus(centred, 0));
    let counted = reception(&sbus_input);
    assert_eq!(counted, Reception { good: 4, without_link: 1, lost: 1, damaged: 2, implausible: 0 });
    assert_eq!(
        std::format!("{counted}"),
        "4 good, 1 of them without a link, 1 lost; 2 damaged, 0 implausible"
    );

    let mut crsf_input = Input::Crsf(Crsf::new());
    send(&mut crsf_input, &crsf(centred));
    send(&mut crsf_input, &sim::receiver::crsf_link(0));
    send(&mut crsf_input, &crsf(centred));
    let mut damaged = crsf(centred);
    damaged[7] ^= 1;
    send(&mut crsf_input, &damaged);
    let Reception { good, without_link, lost, damaged, implausible } = reception(&crsf_input);
    assert_eq!((good, without_link, lost, implausible), (2, 1, 0, 0));
    assert!(damaged >= 1);

    let mut pulses = Input::Pwm(crate::pwm::Pwm::new());
    for (number, width, period) in [(1, 1500, 20_000), (4, 1500, 20_000), (2, 2201, 20_000), (3, 1500, 2474)]
    {
        pulses.pulse(at, number, width, period);
    }
    assert_eq!(reception(&pulses), Reception { good: 2, implausible: 2, ..Reception::default() });

    let counters = crate::pilot::PilotCounters { commanded: 9, ..Default::default() };
    assert!(!Unused(counters).is_any());
    let counters = crate::pilot::PilotCounters { throttle_beyond: 3, gaps: 1, ..counters };
    assert!(Unused(counters).is_any());
    assert_eq!(
        std::format!("{}", Unused(counters)),
        "not used: 0 with a silent channel, 3 with an implausible throttle, 0 with an unclear switch; gaps: 1, refused starts: 0"
    );
}

#[test]
fn port_that_fails_is_read_again_after_a_pause() {
    run(false, async |world| {
        world.pass_ms(1000).await;
        let (reads, before) = (world.uart.reads.get(), sbus_counters(world));
        world.uart.fail();
        world.pass_ms(5).await;
        assert!(world.uart.reads.get() <= reads + 1, "no read within the pause");
        world.pass_ms(100).await;
        let now = sbus_counters(world);
        assert!(now.line_errors == before.line_errors + 1 && now.frames >= before.frames + 5, "{now:?}");
    });
}

#[test]
fn service_takes_engines_in_their_order() {
    run(false, async |world| {
        world.pass_ms(500).await;
        let outcomes = world.outcomes.borrow();
        let engines: Vec<usize> = outcomes.iter().map(|(_, engine, _)| *engine).collect();
        assert!(engines.len() > 20 && engines.chunks(2).all(|pair| pair == [0, 1]), "{engines:?}");
        let stop = |(.., outcome): &(Instant, usize, Outcome)| {
            matches!(outcome, Outcome::Commanded(Command::EmergencyStop, _))
        };
        assert!(outcomes.iter().any(stop), "{outcomes:?}");
        assert_eq!(world.service.borrow().pilots().len(), 2);
    });
}

/// A fault noticed when the last byte of a frame is read may belong to the first byte of the next one, not read yet.
#[test]
fn fault_damages_the_frame_that_is_read_and_the_next_one() {
    let mut service = Service::<0>::new(Input::Sbus(Sbus::new()), []);
    let frame = sbus([992; 16], 0);
    let mut good = Vec::new();
    for i in 0..8_u64 {
        let now = Instant::from_millis(1000 + 14 * i);
        let (head, last) = frame.split_at(24);
        service.receive(now, head, false, |_, _| ());
        // The last byte of the fourth frame.
        service.receive(now + Duration::from_micros(120), last, i == 3, |_, _| ());
        let Input::Sbus(sbus) = service.input() else { unreachable!() };
        good.push((sbus.counters().frames, sbus.counters().bad_frames));
    }
    assert_eq!(good[1..], [(1, 0), (2, 0), (2, 1), (2, 2), (3, 2), (4, 2), (5, 2)]);
}

/// One engine has a speed control of its own, for the other jetlink governs the speed.
#[test]
fn a_stick_that_commands_a_shaft_speed_starts_and_moves_both_engines() {
    let of = |rpm| Some(Rpm::new(rpm));
    let settings = EngineSettings { rpm_low: of(55_000), rpm_high: of(90_000), ..EngineSettings::DEFAULT };
    run_with(false, [settings; 2], async |world| {
        world.start().await;
        for (stick, rpm) in [(1500, 72_500), (1900, 90_000), (IDLE, 55_000)] {
            world.receiver.stick.set(stick);
            let near = |engine: &Handle<'_>| {
                engine.telemetry().report.rpm.is_some_and(|now| now.value.get().abs_diff(rpm) < 1500)
            };
            world.until("the shaft speed", 40, || world.both(near)).await;
        }
        // A stop clears the speed: it is released like the stop of a throttle.
        world.receiver.stick.set(1900);
        world.pass_ms(5000).await;
        world.receiver.switch.set(STOP);
        world.pass_ms(90_000).await;
        assert!(world.both(|engine| engine.telemetry().stop_latched));
        world.receiver.stick.set(IDLE);
        world.pass_ms(1000).await;
        world.receiver.switch.set(STANDBY);
        world.until("released", 120, || world.both(|engine| engine.telemetry().armed)).await;
    });
}

/// One stick for both engines, a switch for each. The switch of the second stays at standby.
#[test]
fn a_stick_is_not_calibrated_for_one_engine_while_another_one_turns() {
    let second = EngineSettings { switch: 6, ..EngineSettings::DEFAULT };
    run_with(false, [EngineSettings::DEFAULT, second], async |world| {
        world.pass_ms(2000).await;
        let calibrate = |engine, begin| world.service.borrow_mut().calibrate(engine, begin);
        assert_eq!(calibrate(2, true), None);
        assert_eq!(calibrate(1, true), Some(Ok(())), "both are at rest");
        world.receiver.switch.set(STANDBY);
        world.until("armed", 30, || world.engines[0].telemetry().armed).await;
        world.until("standby", 60, || world.states() == [EngineState::Standby; 2]).await;
        world.pass_ms(2000).await;
        world.receiver.switch.set(RUN);
        world.until("running", 240, || world.states()[0] == EngineState::Running).await;
        let turns = Some(Err(CalibrationError::EngineTurns));
        assert_eq!([calibrate(1, false), calibrate(1, true), calibrate(0, true)], [turns; 3]);
        // The calibration in progress has ended: the stick now moves a running engine.
        for stick in [1050, 1950, 1500] {
            world.receiver.stick.set(stick);
            world.pass_ms(500).await;
        }
        world.receiver.switch.set(STOP);
        world.pass_ms(120_000).await;
        assert_eq!(calibrate(1, false), Some(Err(CalibrationError::NotBegun)));
        assert_eq!(calibrate(1, true), Some(Ok(())));
    });
}

/// The second engine waits for the first, and its receiver has a gap: the wait ends, with the switch still at run.
#[test]
fn start_that_waits_ends_at_a_gap_of_the_receiver() {
    for gap in [false, true] {
        run(false, async |world| {
            world.start_of_which_one_waits().await;
            world.receiver.on.set(!gap);
            world.pass_ms(350).await;
            world.receiver.on.set(true);
            world.pass_ms(240_000).await;
            let runs = world.engines[1].telemetry().state == EngineState::Running;
            assert_eq!(runs, !gap, "{:?}", world.states());
        });
    }
}

/// The second engine waits for the first, and is handed over meanwhile: the wait ends, also where it is handed back before the first
/// one runs.
#[test]
fn start_that_waits_ends_at_a_hand_over() {
    let settings = EngineSettings { hand_over: 6, ..EngineSettings::DEFAULT };
    for handed_over_ms in [0, 200, 2000] {
        run_with(false, [settings; 2], async |world| {
            world.receiver.sixth.set(1000);
            world.start_of_which_one_waits().await;
            if handed_over_ms > 0 {
                world.receiver.sixth.set(2000);
                world.pass_ms(handed_over_ms).await;
                world.receiver.sixth.set(1000);
            }
            world.pass_ms(240_000).await;
            let runs = world.states().map(|state| state == EngineState::Running);
            assert_eq!(runs, [true, handed_over_ms == 0], "{handed_over_ms} ms");
        });
    }
}
