//! One engine of either kind as a scenario: reports of its ECU, commands, and frames sent. Times are in
//! microseconds; everything is exact to the tick.

use crate::support::frames::{amt as amt_frames, zk as zk_frames};
use bench::by_hand::{Bench, BenchEngine, at_us};
use jetlink::command::{Accepted, Command, Demand, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::amt;
use jetlink::ecu::zk::codec::Rate;
use jetlink::engine::Engine;
use jetlink::engine::config::Supervision;
use jetlink::engine::retained::RetainedState;
use jetlink::event::Event;
use jetlink::limit::{LimitKind, LimitViolation};
use jetlink::line::Line;
use jetlink::telemetry::Telemetry;
use jetlink::units::{Rpm, Throttle};
use sim::any::Protocol;
use sim::control::{self, Switch};
use sim::zk::ZkCommand;

/// Reports of an ECU.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Reports {
    Stopped,
    Standby,
    Starting,
    Running,
    Cooling,
    /// A state without a name.
    Unknown,
}

impl Reports {
    /// The shaft turns.
    const fn turns(self) -> bool {
        !matches!(self, Self::Stopped | Self::Standby)
    }
}

pub const ALL: [Reports; 6] = [
    Reports::Stopped,
    Reports::Standby,
    Reports::Starting,
    Reports::Running,
    Reports::Cooling,
    Reports::Unknown,
];

#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Ecu {
    Amt,
    Zk,
}

pub const BOTH: [Ecu; 2] = [Ecu::Amt, Ecu::Zk];

/// Shaft speed of an engine that turns, above half of idle: 10 000 rpm for the AMT engine.
pub const TURNING: u32 = 12_000;
/// Idle speed reported by the ZK engine, and below, its maximum.
pub const ZK_IDLE: u32 = ZK_IDLE_THOUSANDS as u32 * 1000;
pub const ZK_MAX: u32 = ZK_MAX_THOUSANDS as u32 * 1000;
const ZK_IDLE_THOUSANDS: u8 = 5;
const ZK_MAX_THOUSANDS: u8 = 160;

/// The values of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Values {
    /// AMT: in steps of 500.
    pub rpm: Option<u32>,
    pub egt_celsius: i32,
    /// AMT: the throttle that the ECU obeys, in half percents.
    pub half_percents: u8,
    /// AMT: bits, sent in an error set. ZK: a code.
    pub fault: u8,
}

impl Ecu {
    pub fn config(self) -> EngineConfig {
        match self {
            Self::Amt => EngineConfig::amt("a", 0, Line::new(9600), Some(amt::codec::EngineModel::Olympus)),
            Self::Zk => EngineConfig::zk("z", 0, Line::new(9600), Rate::Hz20),
        }
    }

    pub fn with(self, change: impl FnOnce(&mut Supervision)) -> EngineConfig {
        let mut config = self.config();
        change(&mut config.supervision);
        config
    }

    pub fn frame(self, reports: Reports, values: Values) -> Vec<u8> {
        use amt_frames::{AUTO_STOP, EMERGENCY, RUN};
        let rpm = values.rpm.unwrap_or(if reports.turns() { TURNING } else { 0 });
        match self {
            Self::Amt => {
                let egt = u8::try_from((values.egt_celsius + 50) * 10 / 46).expect("EGT fits");
                if values.fault != 0 {
                    return vec![0xFF, 0x00, values.fault, egt, values.half_percents, 0];
                }
                let (state, switch) = match reports {
                    Reports::Stopped => (amt_frames::NO_CLEARANCE, EMERGENCY),
                    Reports::Standby => (amt_frames::CLEARANCE, AUTO_STOP),
                    Reports::Starting => (amt_frames::STARTING, RUN),
                    Reports::Running => (amt_frames::FULL_OPERATION, RUN),
                    Reports::Cooling => (amt_frames::NO_CLEARANCE, AUTO_STOP),
                    Reports::Unknown => (0b11111, RUN),
                };
                let rpm = u8::try_from(rpm / 500).expect("rpm fits");
                vec![0xFF, state << 3 | switch, rpm, egt, values.half_percents, 0]
            }
            Self::Zk => {
                let (state, switch) = match reports {
                    Reports::Stopped => (0, 0),
                    Reports::Standby => (1, 1),
                    Reports::Starting => (3, 2),
                    Reports::Running => (11, 2),
                    Reports::Cooling => (12, 1),
                    Reports::Unknown => (31, 2),
                };
                let [high, low] = u16::try_from(values.egt_celsius + 50).expect("EGT fits").to_be_bytes();
                let fault = values.fault;
                let rest = [state | (fault & 7) << 5, switch << 5 | high << 2 | fault >> 3, low];
                zk_frames::status(1, rpm, rest).to_vec()
            }
        }
    }
}

#[derive(Clone)]
pub struct Scenario {
    pub ecu: Ecu,
    pub bench: Bench<BenchEngine>,
    pub reports: Option<Reports>,
    pub values: Values,
    /// True: no other engine of the group is starting.
    pub others_allow_start: bool,
    next_frame: u64,
}

/// Between two frames of the ECU.
pub const FRAME_PERIOD_US: u64 = 50_000;
/// Between two commands of a source.
pub const COMMAND_PERIOD_US: u64 = 100_000;
pub const SECOND: u64 = 1_000_000;
/// From idle to full at the slowest slew that can be set, 1 % a second.
const RISES_WITHIN_US: u64 = 101 * SECOND;

impl Scenario {
    pub fn new(ecu: Ecu) -> Self {
        Self::with(ecu, ecu.config())
    }

    /// A ZK ECU has introduced itself.
    pub fn with(ecu: Ecu, config: EngineConfig) -> Self {
        let mut scenario = Self::nothing_received(ecu, config);
        scenario.introduce();
        scenario
    }

    pub fn nothing_received(ecu: Ecu, config: EngineConfig) -> Self {
        Self {
            ecu,
            bench: Bench::engine(&config),
            reports: None,
            values: Values { rpm: None, egt_celsius: 26, half_percents: 0, fault: 0 },
            others_allow_start: true,
            next_frame: FRAME_PERIOD_US,
        }
    }

    /// A ZK ECU reports version 5, its rate, its maximum and its idle speed, each twice, with the shaft speed of its
    /// other reports.
    pub fn introduce(&mut self) {
        self.introduce_version(5);
    }

    pub fn introduce_version(&mut self, version: u8) {
        if self.ecu == Ecu::Zk {
            for _ in 0..2 {
                let rpm = self.rpm();
                // The idle speed first: otherwise half of it would be a guess.
                self.bench.receive(&zk_frames::status(8, rpm, [ZK_IDLE_THOUSANDS, 0, 0]));
                self.bench.receive(&zk_frames::status(6, rpm, [ZK_MAX_THOUSANDS, 0, version << 2]));
            }
        }
    }

    /// The shaft speed that the ECU reports.
    fn rpm(&self) -> u32 {
        let turns = self.reports.is_some_and(Reports::turns);
        self.values.rpm.unwrap_or(if turns { TURNING } else { 0 })
    }

    /// The same engine after a reset, with its retained state; its ECU does not notice.
    pub fn after_reset(ecu: Ecu, config: EngineConfig, retained: Option<RetainedState>) -> Self {
        let mut scenario = Self::nothing_received(ecu, config);
        let mut machine = Engine::new(&config);
        machine.restore(retained);
        machine.start(at_us(0));
        *scenario.bench.machine = machine;
        scenario.bench.events();
        scenario.bench.frames();
        scenario.bench.drain();
        scenario
    }

    /// The same node after a reset now, with its retained state; its ECU continues.
    pub fn reset(&self, config: EngineConfig) -> Self {
        let mut scenario = Self::after_reset(self.ecu, config, Some(self.bench.machine.record()));
        (scenario.reports, scenario.values) = (self.reports, self.values);
        scenario.introduce();
        scenario
    }

    /// From now on the ECU reports this, and has reported it four times: enough to end the life of an engine.
    pub fn reports(&mut self, reports: Reports) -> &mut Self {
        self.reports = Some(reports);
        self.pass_us(4 * FRAME_PERIOD_US)
    }

    /// From now on the ECU is silent.
    pub fn silent(&mut self) -> &mut Self {
        self.reports = None;
        self
    }

    /// Advances by this number of µs; the ECU sends every 50 ms.
    pub fn pass_us(&mut self, micros: u64) -> &mut Self {
        let end = self.bench.now_us() + micros;
        self.run_to_us(end)
    }

    pub fn run_to_us(&mut self, end: u64) -> &mut Self {
        if let Some(reports) = self.reports {
            self.next_frame = self.next_frame.max(self.bench.now_us() + 1);
            while self.next_frame <= end {
                self.bench.rx_at_us(self.next_frame, &self.ecu.frame(reports, self.values));
                self.next_frame += FRAME_PERIOD_US;
            }
        }
        self.bench.run_to_us(end);
        self
    }

    /// One frame now that differs from the ECU's reports.
    pub fn odd(&mut self, reports: Reports, values: Values) {
        self.bench.receive(&self.ecu.frame(reports, values));
    }

    /// Lets this number of µs pass while a source repeats its command, from now on.
    pub fn fly_us(&mut self, command: Command, origin: Origin, micros: u64) -> &mut Self {
        let end = self.bench.now_us() + micros;
        while self.bench.now_us() < end {
            let _ = self.command_from(command, origin);
            let next = (self.bench.now_us() + COMMAND_PERIOD_US).min(end);
            self.run_to_us(next);
        }
        self
    }

    pub fn command(&mut self, command: Command) -> Result<Accepted, Rejected> {
        self.command_from(command, Origin::Rc)
    }

    pub fn command_from(&mut self, command: Command, origin: Origin) -> Result<Accepted, Rejected> {
        let free = self.others_allow_start;
        let stopped = !matches!(self.order(), Order::Run(_) | Order::Doubt(_));
        let announced = self.start_refusals(command, origin);
        let answer = self.bench.act(|engine, now| engine.command(now, command, origin, free));
        if matches!(command, Command::Run(_)) && stopped {
            match answer {
                Ok(Accepted::InForce) => assert_eq!(announced, []),
                Err(why) => assert_eq!(announced.first(), Some(&why), "of {announced:?}"),
                Ok(_) => {}
            }
        }
        answer
    }

    /// Reasons that the engine announces for refusing a start by this command now.
    pub fn start_refusals(&self, command: Command, origin: Origin) -> Vec<Rejected> {
        let mut announced = Vec::new();
        if let Command::Run(demand) = command {
            let (now, free) = (at_us(self.now_us()), self.others_allow_start);
            self.bench.machine.start_refusals(now, demand, origin, free, |why| announced.push(why));
        }
        announced
    }

    /// Answer that a command would get now.
    pub fn would_answer(&self, command: Command) -> Result<Accepted, Rejected> {
        self.clone().command(command)
    }

    pub fn now_us(&self) -> u64 {
        self.bench.now_us()
    }

    pub fn telemetry(&self) -> Telemetry {
        self.bench.machine.telemetry(at_us(self.bench.now_us()))
    }

    pub fn order(&self) -> Order {
        self.telemetry().ordered.order
    }

    /// The throttle ordered, in tenths of a percent.
    pub fn tenths(&self) -> u16 {
        match self.order() {
            Order::Run(Demand::Throttle(throttle)) => throttle.tenths(),
            other => panic!("a throttle, not {other:?}"),
        }
    }

    /// Armed, in standby and ready for a start by RC.
    pub fn ready(ecu: Ecu, config: EngineConfig) -> Self {
        let mut scenario = Self::with(ecu, config);
        scenario.reports(Reports::Standby).pass_us(2 * SECOND);
        scenario.command(Command::Arm).unwrap();
        scenario.command(Command::Standby).unwrap();
        scenario
    }

    /// The two standby commands that shut down a running engine.
    pub fn shut_down(&mut self) -> Result<Accepted, Rejected> {
        self.shut_down_from(Origin::Rc)
    }

    pub fn shut_down_from(&mut self, origin: Origin) -> Result<Accepted, Rejected> {
        assert_eq!(self.command_from(Command::Standby, origin), Ok(Accepted::RepeatStandby));
        self.pass_us(COMMAND_PERIOD_US);
        self.command_from(Command::Standby, origin)
    }

    /// Runs under RC, with this demand in force as of now.
    pub fn started(ecu: Ecu, demand: Demand) -> Self {
        Self::started_with(ecu, ecu.config(), demand)
    }

    pub fn started_with(ecu: Ecu, config: EngineConfig, demand: Demand) -> Self {
        let mut scenario = Self::risen(ecu, config, demand);
        if ecu == Ecu::Zk {
            // The demand is known to have reached the ECU when it is received again.
            scenario.pass_us(FRAME_PERIOD_US);
            scenario.command(Command::Run(demand)).unwrap();
        }
        scenario.bench.frames();
        scenario.bench.events();
        scenario
    }

    /// The same, before a frame has carried that demand.
    pub fn risen(ecu: Ecu, config: EngineConfig, demand: Demand) -> Self {
        let mut scenario = Self::ready(ecu, config);
        assert_eq!(scenario.command(run(0)), Ok(Accepted::InForce));
        for reports in [Reports::Starting, Reports::Running] {
            scenario.reports(reports);
            scenario.command(Command::Run(demand)).unwrap();
        }
        // It rises at a rate.
        let latest = scenario.now_us() + RISES_WITHIN_US;
        while scenario.order() != Order::Run(demand) {
            assert!(scenario.now_us() < latest, "{:?}", scenario.order());
            scenario.pass_us(COMMAND_PERIOD_US);
            scenario.command(Command::Run(demand)).unwrap();
        }
        scenario
    }

    /// The frame that the ECU is sent now.
    pub fn wire(&mut self) -> Wire {
        self.bench.frames();
        self.pass_us(4 * FRAME_PERIOD_US);
        self.sent().pop().expect("something goes out")
    }

    /// Frames sent to the ECU since the last call, without ID 0 and others that carry no switch or demand.
    pub fn sent(&mut self) -> Vec<Wire> {
        let ecu = self.ecu;
        self.bench.bytes().into_iter().filter_map(|bytes| Wire::read(ecu, &bytes)).collect()
    }

    /// The limits that were violated since the last call; other events are dropped.
    pub fn limits(&mut self) -> Vec<LimitKind> {
        self.violations().into_iter().map(|violation| violation.kind).collect()
    }

    pub fn violations(&mut self) -> Vec<LimitViolation> {
        self.violations_at().into_iter().map(|(_, violation)| violation).collect()
    }

    /// The same with the times of their events, in us.
    pub fn violations_at(&mut self) -> Vec<(u64, LimitViolation)> {
        self.bench
            .events()
            .into_iter()
            .filter_map(
                |(at, event)| if let Event::Limit(violation) = event { Some((at, violation)) } else { None },
            )
            .collect()
    }
}

#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Wire {
    Stop,
    Standby,
    /// Tenths of a percent.
    Run(u16),
    Ctf,
    Pwm,
    RpmControl,
}

impl Wire {
    fn read(ecu: Ecu, bytes: &[u8]) -> Option<Self> {
        let protocol = match ecu {
            Ecu::Amt => Protocol::Amt,
            Ecu::Zk => Protocol::Zk,
        };
        let command = control::Command::read(protocol, bytes).expect("a good frame");
        match command {
            control::Command::Zk(ZkCommand::Switch { factor: 1.., .. } | ZkCommand::Rpm(_)) => {
                Some(Self::RpmControl)
            }
            // ID 0, a rate, the switch alone.
            control::Command::Zk(zk) if !matches!(zk, ZkCommand::Control { .. }) => None,
            _ => Some(match command.switch() {
                None => Self::Ctf,
                Some(Switch::Pwm) => Self::Pwm,
                Some(Switch::Stop) => Self::Stop,
                Some(Switch::Standby) => Self::Standby,
                Some(Switch::Run) => Self::Run(command.throttle_tenths().expect("it comes with run")),
            }),
        }
    }
}

pub fn percent(percent: u8) -> Demand {
    Demand::Throttle(Throttle::from_percent(percent).unwrap())
}

pub fn tenths(tenths: u16) -> Demand {
    Demand::Throttle(Throttle::from_tenths(tenths).unwrap())
}

/// Run, in percent.
pub fn run(percents: u8) -> Command {
    Command::Run(percent(percents))
}

pub fn rpm(rpm: u32) -> Demand {
    Demand::Rpm(Rpm::new(rpm))
}
