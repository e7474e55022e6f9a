//! A toy protocol outside of the library, by docs/porting.md ("A new ECU protocol, in one folder"), as far as that goes
//! without the line in the library's list: codec, settings, services, faults, link, and a timing table of the link.
//!
//! Two bytes each way. ECU to host: 0xA5, then 0 at rest or 1 running. Host to ECU, every 100 ms: 0x5A, then 0 for nothing, 1
//! for standby, 2 for run, 3 for an emergency stop.

use crate::support::bench::Bench;
use embassy_time::{Duration, Instant};
use jetlink::command::{Demand, Order, Rejected};
use jetlink::ecu::Service;
use jetlink::ecu::vendor::{VendorFaults, VendorService};
use jetlink::event::Event;
use jetlink::line::{Line, LineError, Timing};
use jetlink::link::{
    Beat, Link, LinkMonitor, LinkStatus, Outbox, Output, Sign, Speaks, Stage, Transmission, earlier,
};
use jetlink::report::{LinkState, NotSent, Phase, Timed};
use jetlink::units::{Hectopascals, Throttle};

const SEND_EVERY: Duration = Duration::from_millis(100);
const TIMING: Timing = Timing { up_after: 1, lost_after: Duration::from_millis(500) };

#[derive(Clone, Copy)]
struct Config;

#[derive(Clone, Copy)]
struct NoService;

impl VendorService for NoService {
    fn needs_stopped_engine(self) -> bool {
        true
    }
}

#[derive(Clone, Copy)]
struct NoFaults;

impl core::fmt::Display for NoFaults {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("none")
    }
}

impl VendorFaults for NoFaults {
    fn number(self) -> u8 {
        0
    }
}

impl Speaks for Config {
    type Link = ToyLink;

    fn link(self, line: Line, timing: Timing) -> ToyLink {
        ToyLink {
            status: LinkStatus::default(),
            monitor: LinkMonitor::new(timing),
            beat: Beat::new(2, line, SEND_EVERY),
            outbox: Outbox::default(),
            order: Order::Listen,
            head: false,
            sign: None,
            next_slot: None,
        }
    }
}

#[derive(Clone, Debug)]
pub struct ToyLink {
    status: LinkStatus,
    monitor: LinkMonitor,
    beat: Beat,
    outbox: Outbox,
    order: Order,
    head: bool,
    sign: Option<Sign>,
    next_slot: Option<Instant>,
}

impl ToyLink {
    fn frame(&mut self, now: Instant, running: bool) {
        self.beat.frame(now);
        self.status.counters.frames += 1;
        if self.monitor.frame(now, &mut self.status) {
            self.outbox.event(Event::LinkUp);
        }
        let stage = if running { Stage::Running } else { Stage::Rest };
        self.sign = Some(Sign::State { stage, turning: Some(running), throttle: None });
        let phase = if running { Phase::Running } else { Phase::Standby };
        self.status.report.phase = Some(Timed::new(phase, now));
    }
}

impl Link for ToyLink {
    fn start(&mut self, now: Instant) {
        self.monitor.start(now);
        self.next_slot = Some(now);
    }
    fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        for (taken, byte) in (1..).zip(bytes) {
            let head = core::mem::replace(&mut self.head, *byte == 0xA5);
            if head && *byte <= 1 {
                self.beat.bytes(now, taken);
                self.frame(now, *byte == 1);
                return taken;
            }
        }
        self.beat.bytes(now, bytes.len());
        bytes.len()
    }
    fn line_error(&mut self, _error: LineError) {}
    fn order(&mut self, _now: Instant, order: Order) -> Result<(), Rejected> {
        match order {
            Order::Run(Demand::Rpm(_)) => Err(Rejected::NoSpeedControl),
            Order::Pwm => Err(Rejected::NotSupported),
            order => {
                self.order = order;
                Ok(())
            }
        }
    }
    fn speed_control(&self) -> Result<(), Rejected> {
        Err(Rejected::NoSpeedControl)
    }
    fn service(&mut self, _now: Instant, _service: Service) -> Result<(), Rejected> {
        Err(Rejected::NotSupported)
    }
    fn pressure(&mut self, _now: Instant, _pressure: Hectopascals) {}
    fn sent(&mut self, _now: Instant) {
        self.outbox.done();
    }
    fn not_sent(&mut self, _now: Instant, why: NotSent) {
        self.outbox.event(Event::NotSent(why));
        self.outbox.done();
    }
    fn timeout(&mut self, now: Instant) {
        if self.monitor.timeout(now, &mut self.status) {
            self.outbox.event(Event::LinkLost);
        }
        let Some(due) = self.next_slot.filter(|due| now >= *due) else { return };
        self.next_slot = Some(due + SEND_EVERY);
        let code = match self.order {
            Order::Standby => 1,
            Order::Run(_) => 2,
            Order::EmergencyStop => 3,
            Order::Listen | Order::Doubt(_) | Order::Pwm => 0,
        };
        self.outbox.put(Transmission::new([0x5A, code], None));
    }
    fn poll(&mut self) -> Output {
        let wait = Output::Wait(earlier(self.next_slot, self.monitor.deadline()));
        self.outbox.poll(&mut self.status).unwrap_or(wait)
    }
    fn take_sign(&mut self) -> Option<Sign> {
        self.sign.take()
    }
    fn gap_at(&self) -> Option<Instant> {
        self.beat.gap_at()
    }
    fn gap(&mut self) {
        self.beat.gap();
    }
    fn answers_frames(&self) -> bool {
        false
    }
    fn doubt_ends(&self, _since: Instant) -> Option<Instant> {
        None
    }
    fn status(&self) -> &LinkStatus {
        &self.status
    }
}

#[test]
fn toy_link_keeps_its_timing_table() {
    let line = Line::new(9600);
    let mut bench = Bench::new(Config.link(line, TIMING), line);
    bench.run_to_us(150_000);
    assert_eq!(bench.frames(), [(0, vec![0x5A, 0]), (100_000, vec![0x5A, 0])], "nothing is ordered");
    bench.rx_at_us(160_000, &[0, 0xA5, 1]);
    let status = bench.machine.status();
    assert_eq!((status.state, status.report.phase.unwrap().value), (LinkState::Up, Phase::Running));
    let sign = Sign::State { stage: Stage::Running, turning: Some(true), throttle: None };
    assert_eq!(bench.machine.take_sign(), Some(sign));
    let run = Order::Run(Demand::Throttle(Throttle::IDLE));
    for (order, code) in [(run, 2), (Order::Doubt(Demand::Throttle(Throttle::IDLE)), 0), (Order::Standby, 1)]
    {
        bench.order(bench.now_us(), order).unwrap();
        bench.run_to_us(bench.now_us() + 100_000);
        assert_eq!(bench.bytes(), [[0x5A, code]], "{order:?}");
    }
    assert_eq!(bench.order(bench.now_us(), Order::Pwm), Err(Rejected::NotSupported));
    bench.events();
    bench.run_to_us(659_999);
    assert_eq!(bench.events(), []);
    bench.run_to_us(660_000);
    assert_eq!(bench.events(), [(660_000, Event::LinkLost)]);
    assert!(NoService.needs_stopped_engine() && !NoService.moves_fuel() && NoFaults.number() == 0);
}
