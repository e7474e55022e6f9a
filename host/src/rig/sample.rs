//! The state of one engine at one moment, for the table, the lines, the CSV file and the plot.

use super::audit::WireCommand;
use super::context::{EngineContext, PilotInput, Stage};
use super::play::action::Fault;
use embassy_time::{Duration, Instant};
use jetlink::command::{Demand, Order, Origin, Rejected};
use jetlink::config::EngineConfig;
use jetlink::ecu::Faults;
use jetlink::engine::state::EngineState;
use jetlink::event::LossStage;
use jetlink::limit::LimitViolation;
use jetlink::report::{Counters, LinkState, Timed};
use jetlink::telemetry::Telemetry;
use jetlink_rc::outputs::Outputs;
use sim::wire::Entry;

/// Between two samples.
pub const SAMPLE_EVERY: Duration = Duration::from_millis(100);

/// Age beyond which a value does not show the present state.
const FRESH: Duration = Duration::from_secs(2);

/// Longest time between two values of one kind without faults: a ZK ECU at 20 Hz gives its EGT every 0.45 s.
const NEW: Duration = Duration::from_millis(700);

/// Speed, in rpm, below which a stopped engine is not shown as running down.
const AT_REST: u32 = 1000;

/// Whether a value is recent enough to be shown and judged.
pub fn is_fresh<T>(value: &Timed<T>, now: Instant) -> bool {
    value.age(now) <= FRESH
}

/// The source's command, and whether it is silent: a pilot's own input, or, if MAVLink commands, the node's state of it.
fn commanded(context: &EngineContext<'_>, telemetry: &Telemetry) -> (PilotInput, bool) {
    let by_mavlink = context.stage.get() == Stage::Commanded && telemetry.active_source == Origin::Mavlink;
    if !by_mavlink {
        return (context.input.get(), context.silent.get());
    }
    let input = match (telemetry.commanded, telemetry.ordered.order) {
        (Some(demand), Order::Run(_)) | (None, Order::Run(demand)) => PilotInput::Run(demand),
        _ => PilotInput::Standby,
    };
    (input, telemetry.loss != LossStage::None)
}

/// One engine at one moment. Values that the ECU has not reported in the last seconds are `None`.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Sample {
    /// Stage of its pilot.
    pub stage: Stage,
    /// Command of its pilot.
    pub input: PilotInput,
    /// Its pilot commands nothing.
    pub silent: bool,
    /// The node runs: it neither hangs nor restarts. Otherwise all its reports are old.
    pub node_up: bool,
    /// Whether the ECU is received.
    pub link: LinkState,
    /// The engine's state, in plain words.
    pub does: EngineState,
    /// The ECU's own name of its state.
    pub state: Option<&'static str>,
    /// Source whose command is in force.
    pub in_control: Origin,
    /// Source that is about to take over.
    pub waiting: Option<Origin>,
    /// Stage of loss of that source.
    pub loss: LossStage,
    /// A limit has lowered the demand.
    pub limited: bool,
    /// It may be started.
    pub armed: bool,
    /// Order of the node.
    pub order: Order,
    /// Command on the wire; `None`: nothing.
    pub on_wire: Option<WireCommand>,
    /// Shaft speed.
    pub rpm: Option<u32>,
    /// Exhaust gas temperature in °C.
    pub egt: Option<f64>,
    /// When the ECU reported that shaft speed, if a newer report is overdue.
    pub rpm_old: Option<Instant>,
    /// The same of the EGT.
    pub egt_old: Option<Instant>,
    /// Throttle that the ECU obeys, in percent.
    pub throttle: Option<f64>,
    /// Faults reported by the ECU.
    pub faults: Option<Faults>,
    /// Counters of the node.
    pub counters: Counters,
    /// Reply windows without a reply in time, by the ECU's own count.
    pub missed_at_ecu: u64,
    /// Its fuel valve is open, if it has one.
    pub valve_open: Option<bool>,
    /// Its starter and ignition have power, if an output switches that.
    pub power: Option<bool>,
}

impl Sample {
    /// A sample of this engine now. While the node is not up, `telemetry` is the last known one.
    pub fn take(context: &EngineContext<'_>, telemetry: &Telemetry, node_up: bool) -> Self {
        let report = &telemetry.report;
        let at = Instant::now();
        let old = |received: Instant| (!node_up || at > received + NEW).then_some(received);
        let (input, silent) = commanded(context, telemetry);
        Self {
            stage: context.stage.get(),
            input,
            silent,
            node_up,
            link: if node_up { telemetry.link } else { LinkState::Silent },
            does: telemetry.state,
            in_control: telemetry.active_source,
            waiting: telemetry.waiting,
            loss: telemetry.loss,
            limited: telemetry.limited,
            armed: telemetry.armed,
            order: telemetry.ordered.order,
            on_wire: context.audit.borrow().on_wire_now((at - Instant::MIN).as_micros() * 1000),
            state: report.state.filter(|state| is_fresh(state, at)).map(|state| state.value.name),
            rpm: report.rpm.filter(|rpm| is_fresh(rpm, at)).map(|rpm| rpm.value.get()),
            egt: report.egt.filter(|egt| is_fresh(egt, at)).map(|egt| f64::from(egt.value.tenths()) / 10.0),
            rpm_old: report.rpm.and_then(|rpm| old(rpm.at)),
            egt_old: report.egt.and_then(|egt| old(egt.at)),
            throttle: report
                .throttle
                .filter(|throttle| is_fresh(throttle, at))
                .map(|throttle| f64::from(throttle.value.tenths()) / 10.0),
            faults: report.faults.filter(|faults| is_fresh(faults, at)).map(|faults| faults.value),
            counters: telemetry.counters,
            missed_at_ecu: 0,
            valve_open: None,
            power: None,
        }
    }

    /// The commanded throttle, in percent.
    pub fn commanded_percent(&self) -> Option<f64> {
        self.input.throttle_percent().filter(|_| !self.silent)
    }

    /// The commanded speed, in rpm.
    pub fn commanded_rpm(&self) -> Option<u32> {
        self.input.rpm().filter(|_| !self.silent)
    }

    /// The engine's state; during a start, with the ECU's name of the step. An engine stopped at speed runs down before it is
    /// at rest.
    pub fn does_text(&self) -> String {
        match self.does {
            EngineState::Stopped if self.rpm.is_some_and(|rpm| rpm > AT_REST) => "run-down".to_owned(),
            // An emergency stop is without cooling. An AMT ECU only shows that the shaft turns.
            EngineState::Cooling if self.order == Order::EmergencyStop => "run-down".to_owned(),
            // Its run is cancelled, but it has not followed that.
            EngineState::StartRequested if !matches!(self.order, Order::Run(_)) => "not obeying".to_owned(),
            EngineState::Starting(step) if step.name == self.does.name() => step.name.to_owned(),
            EngineState::Starting(step) => format!("start: {}", step.name),
            other => other.name().to_owned(),
        }
    }

    /// The command on the wire.
    pub fn wire_text(&self) -> String {
        match self.on_wire {
            None | Some(WireCommand::Nothing) => "-".to_owned(),
            Some(WireCommand::Stop) => "STOP".to_owned(),
            Some(WireCommand::Standby) => "standby".to_owned(),
            Some(WireCommand::Run(tenths)) => format!("{:.1} %", f64::from(tenths) / 10.0),
            Some(WireCommand::RunRpm(rpm)) => format!("{rpm} rpm"),
        }
    }

    /// The active source, its stage of loss, and what else holds its demand.
    pub fn in_control_text(&self) -> String {
        match (self.order, self.loss) {
            (Order::EmergencyStop, _) => format!("{}: STOP", self.in_control.name()),
            (_, LossStage::None) => match (self.limited, self.waiting) {
                (true, _) => format!("{}: limited", self.in_control.name()),
                (false, Some(next)) => format!("{}, {} next", self.in_control.name(), next.name()),
                (false, None) => self.in_control.name().to_owned(),
            },
            (_, stage) => format!("{}: {}", self.in_control.name(), loss(stage)),
        }
    }

    /// Name of the link's state.
    pub const fn link_name(&self) -> &'static str {
        match self.link {
            LinkState::Silent => "silent",
            LinkState::Up => "up",
            LinkState::Lost => "lost",
        }
    }

    /// Replies and send slots that the node missed by its own count.
    pub const fn missed(&self) -> u32 {
        let counters = &self.counters;
        counters.replies_missed.wrapping_add(counters.replies_late).wrapping_add(counters.send_slots_missed)
    }

    /// The same, including frames lost on the way to the ECU, which the node does not know of.
    pub fn missed_by_either(&self) -> u64 {
        u64::from(self.missed()).max(self.missed_at_ecu)
    }

    /// Received data from the ECU that was not a frame.
    pub const fn decode_errors(&self) -> u32 {
        decode_errors(&self.counters)
    }
}

/// A stage of loss for people.
pub const fn loss(stage: LossStage) -> &'static str {
    match stage {
        LossStage::None => "none",
        LossStage::Hold => "hold",
        LossStage::FailSafe => "fail-safe",
        LossStage::Standby => "standby",
    }
}

/// Bytes from the ECU that were no frame, frames that were broken, and frames of unknown kinds.
pub const fn decode_errors(counters: &Counters) -> u32 {
    counters
        .crc_failures
        .wrapping_add(counters.truncated)
        .wrapping_add(counters.bytes_skipped)
        .wrapping_add(counters.unknown_frames)
}

/// Details that are not part of a sample.
#[derive(Clone, Debug)]
pub struct Detail {
    /// The node's telemetry of the engine.
    pub telemetry: Telemetry,
    /// Its configuration as it is now.
    pub config: EngineConfig,
    /// Demand of a start; `None` if it comes from outside and is unknown.
    pub start_demand: Option<Demand>,
    /// Reasons why the engine cannot start now; `None` while the node is away.
    pub start_refusals: Option<Vec<Rejected>>,
    /// The last violation of each limit.
    pub violations: Vec<LimitViolation>,
    /// Fuel valve and power, as a board with these outputs would drive them.
    pub outputs: Outputs,
    /// The bytes on its line since the sample before.
    pub entries: Vec<Entry>,
    /// Faults that were set by hand and last.
    pub faults: Vec<Fault>,
}
