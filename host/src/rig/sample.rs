//! What one engine looks like at one moment, for the table, the lines, the CSV file and the plot.

use super::audit::WireCommand;
use super::context::{EngineContext, PilotInput, Stage};
use super::play::action::Fault;
use embassy_time::{Duration, Instant};
use jetlink::command::{Order, Origin};
use jetlink::ecu::Faults;
use jetlink::engine::state::EngineState;
use jetlink::event::LossStage;
use jetlink::report::{Counters, LinkState, Timed};
use jetlink::telemetry::Telemetry;
use sim::wire::Entry;

/// Between two samples.
pub const SAMPLE_EVERY: Duration = Duration::from_millis(100);

/// An older value is not what the engine does now.
const FRESH: Duration = Duration::from_secs(2);

/// Between two values of one kind, where all goes well: a ZK ECU at 20 Hz gives its EGT every 0.45 s.
const NEW: Duration = Duration::from_millis(700);

/// Whether a value is young enough to be shown and judged by.
pub fn is_fresh<T>(value: &Timed<T>, now: Instant) -> bool {
    value.age(now) <= FRESH
}

/// One engine at one moment. Values that the ECU has not told in the last seconds are `None`.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Sample {
    /// How far its pilot has come.
    pub stage: Stage,
    /// What its pilot commands.
    pub input: PilotInput,
    /// Its pilot says nothing.
    pub silent: bool,
    /// Whether the ECU is heard.
    pub link: LinkState,
    /// What the engine does, in plain words.
    pub does: EngineState,
    /// The ECU's own name of its state.
    pub state: Option<&'static str>,
    /// Whose command is in force.
    pub in_control: Origin,
    /// Who is about to take over.
    pub waiting: Option<Origin>,
    /// How far the loss of that source has gone.
    pub loss: LossStage,
    /// A limit has lowered the demand.
    pub limited: bool,
    /// It may be started.
    pub armed: bool,
    /// What the node orders.
    pub order: Order,
    /// What was last on the wire.
    pub on_wire: Option<WireCommand>,
    /// Shaft speed.
    pub rpm: Option<u32>,
    /// Exhaust gas temperature in °C.
    pub egt: Option<f64>,
    /// The shaft speed is there, and not new any more.
    pub rpm_old: bool,
    /// So is the EGT.
    pub egt_old: bool,
    /// Throttle that the ECU obeys, in percent.
    pub throttle: Option<f64>,
    /// What the ECU reports to be wrong.
    pub faults: Option<Faults>,
    /// What the node has counted.
    pub counters: Counters,
}

impl Sample {
    /// Of this engine, now.
    pub fn take(desk: &EngineContext<'_>, telemetry: &Telemetry) -> Self {
        let report = &telemetry.report;
        let at = telemetry.at;
        Self {
            stage: desk.stage.get(),
            input: desk.input.get(),
            silent: desk.silent.get(),
            link: telemetry.link,
            does: telemetry.state,
            in_control: telemetry.active_source,
            waiting: telemetry.waiting,
            loss: telemetry.loss,
            limited: telemetry.limited,
            armed: telemetry.armed,
            order: telemetry.ordered.order,
            on_wire: desk.audit.borrow().on_wire,
            state: report.state.filter(|state| is_fresh(state, at)).map(|state| state.value.name),
            rpm: report.rpm.filter(|rpm| is_fresh(rpm, at)).map(|rpm| rpm.value.get()),
            egt: report.egt.filter(|egt| is_fresh(egt, at)).map(|egt| f64::from(egt.value.tenths()) / 10.0),
            rpm_old: report.rpm.is_some_and(|rpm| rpm.age(at) > NEW),
            egt_old: report.egt.is_some_and(|egt| egt.age(at) > NEW),
            throttle: report
                .throttle
                .filter(|throttle| is_fresh(throttle, at))
                .map(|throttle| f64::from(throttle.value.tenths()) / 10.0),
            faults: report.faults.filter(|faults| is_fresh(faults, at)).map(|faults| faults.value),
            counters: telemetry.counters,
        }
    }

    /// The throttle that is asked for, in percent.
    pub fn asked_percent(&self) -> Option<f64> {
        self.input.throttle_percent().filter(|_| !self.silent)
    }

    /// The speed that is asked for.
    pub fn asked_rpm(&self) -> Option<u32> {
        self.input.rpm().filter(|_| !self.silent)
    }

    /// What the engine does; while it starts, with the step as the ECU names it.
    pub fn does_text(&self) -> String {
        match self.does {
            EngineState::Starting(step) => format!("start: {}", step.name),
            other => other.name().to_owned(),
        }
    }

    /// What was last on the wire.
    pub fn wire_text(&self) -> String {
        match self.on_wire {
            None | Some(WireCommand::Nothing) => "-".to_owned(),
            Some(WireCommand::Stop) => "STOP".to_owned(),
            Some(WireCommand::Standby) => "standby".to_owned(),
            Some(WireCommand::Run(tenths)) => format!("{:.1} %", f64::from(tenths) / 10.0),
            Some(WireCommand::RunRpm(rpm)) => format!("{rpm} rpm"),
        }
    }

    /// Who rules, how far that source is lost, and what else holds its demand.
    pub fn rules_text(&self) -> String {
        match (self.order, self.loss) {
            (Order::EmergencyStop, _) => format!("{} STOPS", self.in_control.name()),
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

    /// Replies and turns that the node missed by its own count.
    pub const fn missed(&self) -> u32 {
        let counters = &self.counters;
        counters.replies_missed.wrapping_add(counters.replies_late).wrapping_add(counters.send_slots_missed)
    }

    /// What came from the ECU and was no frame.
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

/// What a sample has no room for.
#[derive(Clone, Debug)]
pub struct Detail {
    /// All that the node knows of the engine.
    pub telemetry: Telemetry,
    /// The bytes on its line since the sample before.
    pub entries: Vec<Entry>,
    /// Faults that were set by hand and last.
    pub faults: Vec<Fault>,
}
