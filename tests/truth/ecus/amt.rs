//! AMT ECUs in the worlds.

use super::vendor::{Facts, Odd, Seen, WorldConfig, WorldEcu};
use crate::history::{PilotCommand, Sent};
use crate::kind::Kind;
use crate::pilots::Rng;
use embassy_time::Duration;
use jetlink::config::EngineConfig;
use jetlink::ecu::amt::codec::EngineModel;
use jetlink::ecu::amt::config::{Config, Service as AmtService};
use jetlink::ecu::{EcuConfig, Service};
use jetlink::line::Line;
use jetlink::units::{Millivolts, Throttle};
use sim::amt::{AmtCommand, AmtConfig, AmtEcu, AmtTemper, InFlight, Status};
use sim::any::{AnyConfig, AnyEcu};
use sim::control::{Command, Frame};
use sim::turbine::Parameters;

/// The supply of an ECU, and one below every limit, V.
const SUPPLY: f64 = 7.4;
const LOW_SUPPLY: f64 = 6.0;
/// The limit, mV.
const SUPPLY_LIMIT: u32 = 6800;

/// For the named cases: an ECU as harmful as the document allows.
pub fn case() -> (EngineConfig, AnyConfig) {
    let temper = AmtTemper {
        starts_hot: true,
        trips_clear_after: Some(60_000_000_000),
        starts_after_silence: true,
        ..AmtTemper::DEFAULT
    };
    let ecu = AmtConfig {
        temper,
        log: 8,
        serial_delay: 4_000_000_000,
        ..AmtConfig::new(sim::amt::EngineModel::Olympus)
    };
    let config = EngineConfig::amt("amt", 0, Line::new(2400), Some(EngineModel::Olympus));
    (config, AnyConfig::Amt(ecu))
}

/// Its trips clear after this time, ns, and start clearance lasts for 4 s.
pub fn clears(ecu: &mut AnyConfig, after: u64) {
    let AnyConfig::Amt(ecu) = ecu else { return };
    (ecu.temper.trips_clear_after, ecu.temper.clearance) = (Some(after), 4_000_000_000);
}

/// A random one.
pub fn random(rng: &mut Rng, port: u8) -> (EngineConfig, AnyConfig) {
    let line = Line::new(rng.pick(&[2400, 2400, 2400, 9600, 115_200]));
    let engine = rng.pick(&[None, Some(EngineModel::Olympus)]);
    let mut config = EngineConfig::amt("amt", port, line, engine);
    let start_throttle = rng.pick(&[0, 0, 0, 200]);
    let serial_delay = rng.pick(&[2, 4, 4]);
    let amt = node(&mut config.ecu);
    amt.start_throttle = Throttle::from_tenths(start_throttle).expect("0..=1000");
    amt.serial_delay = Duration::from_secs(serial_delay);
    let states = [Status::IdleCalibration, Status::StartedUp, Status::Unnamed(30)];
    let in_flight = InFlight {
        shows: rng.pick(&states),
        every: 20_000_000_000,
        lasts: rng.spread(100, 4000) * 1_000_000,
    };
    let temper = AmtTemper {
        wants_auto_stop_first: rng.percent(30),
        clearance: rng.pick(&[100, 1000, 1000, 4000]) * 1_000_000,
        last_state_first: rng.pick(&[0, 0, 0, 1]),
        starts_hot: rng.percent(35),
        in_flight: rng.percent(20).then_some(in_flight),
        trips_clear_after: rng.percent(25).then(|| rng.spread(500, 60_000) * 1_000_000),
        starts_after_silence: rng.percent(30),
    };
    let ecu = AmtConfig {
        temper,
        log: 8,
        serial_delay: serial_delay * 1_000_000_000,
        boot: rng.pick(&[30, 200, 500, 500, 3000]) * 1_000_000,
        start_throttle: (start_throttle / 5) as u8,
        loss_is_an_error: rng.percent(20),
        ..AmtConfig::new(sim::amt::EngineModel::Olympus).on(sim::line::Line::n1(line.baud))
    };
    (config, AnyConfig::Amt(ecu))
}

impl WorldEcu for AmtEcu {
    fn seen(&self) -> Seen {
        Seen { fault: self.errors() != 0, pwm: false, hidden: self.hides_that_it_runs() }
    }

    fn report_fault(&mut self, fault: Option<u8>) {
        self.set_errors(fault.map_or(0, errors));
    }

    fn lower_supply(&mut self, low: bool) {
        self.set_supply(if low { LOW_SUPPLY } else { SUPPLY });
    }

    fn wrong_frame(&self, rng: &mut Rng) -> Vec<u8> {
        let status = rng.pick(&[0, 1, 2, 12]) << 3;
        vec![0xFF, status | rng.pick(&[1, 2, 4]), rng.below(200) as u8, rng.below(200) as u8, 0, 0]
    }

    fn odd_frame(&self, odd: Odd) -> Vec<u8> {
        // Full operation at its speed with the switch at run, in the unit of the Olympus; AMT-7 for the exhaust.
        let running = Status::FullOperation.bits() | 4;
        let rpm = (self.turbine().rpm() / 500.0).clamp(0.0, 254.0) as u8;
        match odd {
            Odd::AtRest => vec![0xFF, 4, 0, 0, 0, 0],
            Odd::SlowShaft | Odd::RunsAtRest => vec![0xFF, running, 0, 120, 0, 0],
            Odd::HotExhaust => vec![0xFF, running, rpm, 230, 0, 0],
            Odd::LaterVersion => Vec::new(),
        }
    }
}

/// The node's settings for it.
fn node(engine: &mut EcuConfig) -> &mut Config {
    match engine {
        EcuConfig::Amt(amt) => amt,
        other => unreachable!("the ECU is of the kind that is configured, {other:?}"),
    }
}

impl WorldConfig for AmtConfig {
    /// Its faults clear, and in some worlds it waits longer for a reply than the node assumes.
    fn for_drills(&mut self, rng: &mut Rng, engine: &mut EcuConfig) {
        self.temper.trips_clear_after = Some(rng.spread(500, 10_000) * 1_000_000);
        // Such a state is more frequent, and lasts longer: it occurs after an order that was given up.
        if let Some(in_flight) = &mut self.temper.in_flight {
            in_flight.every = 12_000_000_000;
        }
        if self.serial_delay <= 2_000_000_000 && rng.percent(60) {
            // Its fault clears before any set can report it, and its start clearance lasts until it has given up.
            (self.temper.trips_clear_after, self.temper.clearance) = (Some(0), 4_000_000_000);
            self.temper.starts_hot = true;
        } else if rng.percent(40) {
            node(engine).serial_delay = Duration::from_millis(2000);
            self.serial_delay = rng.pick(&[5, 20]) * 1_000_000_000;
        }
    }

    fn other_settings(&self, engine: &mut EcuConfig) {
        node(engine).half_idle = 25;
    }

    fn facts(&self, mut engine: EcuConfig) -> Facts {
        let engine = node(&mut engine);
        Facts {
            kind: Kind::Amt,
            period: self.period,
            round: 1,
            gives_up_after: self.serial_delay,
            serial_delay: engine.serial_delay.as_micros() * 1000,
            frame: self.line.byte_ns(5),
            gives_up_on_empty: false,
            boot: self.boot,
            start_throttle: engine.start_throttle.tenths().into(),
            stale: self.temper.last_state_first.into(),
        }
    }

    fn holds_rpm(&self) -> bool {
        false
    }

    /// The number decides in what it differs: another engine, whose speeds and temperatures have the same scales, a start at any
    /// temperature, and one that needs auto stop first. What the rules assume of an ECU, its times for example, is the same.
    fn another(&self, number: u8) -> AnyEcu {
        let differs = |bit: u8| number >> bit & 1 == 1;
        let temper = AmtTemper {
            starts_hot: self.temper.starts_hot ^ differs(1),
            wants_auto_stop_first: self.temper.wants_auto_stop_first && !differs(2),
            starts_after_silence: self.temper.starts_after_silence ^ differs(2),
            ..self.temper
        };
        let (engine, turbine) = match differs(0) {
            true => (sim::amt::EngineModel::Titan, titan(&self.turbine)),
            false => (self.engine, self.turbine),
        };
        let other = AmtConfig::new(engine);
        let (engine_id, version_text) = (other.engine_id, other.version_text);
        AnyConfig::Amt(Self { engine, engine_id, version_text, turbine, temper, ..self.clone() }).ecu()
    }

    fn low_supply(&self) -> Millivolts {
        Millivolts::new(SUPPLY_LIMIT)
    }

    fn service(&self, command: PilotCommand) -> Option<Service> {
        (command == PilotCommand::Ctf).then_some(Service::Amt(AmtService::Ctf))
    }

    fn name(&self) -> String {
        format!(
            "AMT at {} baud, serial delay {} ms, {:?}",
            self.line.baud,
            self.serial_delay / 1_000_000,
            self.temper
        )
    }
}

/// A Titan whose start and cooling take as long as those of this turbine.
fn titan(turbine: &Parameters) -> Parameters {
    Parameters {
        ignition_s: turbine.ignition_s,
        preheat_s: turbine.preheat_s,
        ramp_s: turbine.ramp_s,
        learn_s: turbine.learn_s,
        cooling_s: turbine.cooling_s,
        ..Parameters::TITAN
    }
}

/// The bit of an error set for one of ZK's error codes.
const fn errors(fault: u8) -> u8 {
    1 << (fault % 7)
}

/// "EGT error".
pub const fn disowns_exhaust(fault: u8) -> bool {
    errors(fault) == sim::amt::error::EGT
}

pub fn pilot_command(service: AmtService) -> PilotCommand {
    match service {
        AmtService::Ctf => PilotCommand::Ctf,
    }
}

pub fn sent(command: AmtCommand, _: &Frame) -> Sent {
    let command = Command::Amt(command);
    match (command.switch(), command.throttle_tenths()) {
        (Some(switch), Some(tenths)) => Sent::Full(switch, tenths.into()),
        _ => Sent::Ctf,
    }
}
