//! An AMT ECU with serial control, from the maker's document of 2014-06-17.
//!
//! It sends about eight sets per second unprompted, and accepts one control message after each of
//! them, within a window that it measures itself (AMT-11). If the host falls silent, the ECU stops
//! the engine: without accepted messages for the serial delay time it shuts down (AMT-12).
//!
//! Points that the document leaves open, and their treatment here:
//!
//! - The serial delay time (address 192) has no printed value: 2 s here.
//! - The start (AMT-14): OPS = run with the stick in the required position gives start clearance,
//!   and the start follows a second later. After any stop that the host did not command, OPS must
//!   leave run once before the next start.
//! - The serial delay stop and the CTF stop are auto stops: the turbine is cooled.
//! - The delay of CTF begins with the first CTF message while the engine is live; another OPS cancels it.
//! - Until the first message is accepted, the switch position is auto stop.
//! - A reply is accepted or rejected as a whole: a late, unsolicited or malformed message is counted
//!   and changes nothing, not even the time since the last accepted one.

mod any;
mod command;
mod telemetry;
mod temper;
mod window;

use crate::ecu::{Counts, Ecu, LineFault, MILLIS, Nanos, SECOND};
use crate::line::Line;
use crate::log::CommandLog;
use crate::turbine::{Demand, Parameters, Phase, STEP, Switch, Trip, Turbine};

pub use self::command::{AmtCommand, BadCommand, HEAD, LENGTH, Ops, parse_command};
use self::command::{Received, Receiver};
pub use self::telemetry::{EngineModel, Status};
use self::telemetry::{Values, Voltages};
pub use self::temper::{AmtTemper, InFlight};
use self::window::{Reply, Window};

/// Bits of Data 2 in an error set (AMT-8).
pub mod error {
    /// Rpm low.
    pub const RPM_LOW: u8 = 1 << 0;
    /// Switch channel not present.
    pub const SWITCH_CHANNEL: u8 = 1 << 1;
    /// Throttle channel not present.
    pub const THROTTLE_CHANNEL: u8 = 1 << 2;
    /// EGT error.
    pub const EGT: u8 = 1 << 3;
    /// Rpm high.
    pub const RPM_HIGH: u8 = 1 << 4;
    /// Supply low.
    pub const SUPPLY_LOW: u8 = 1 << 5;
    /// Supply low for the auto start system.
    pub const START_SUPPLY_LOW: u8 = 1 << 6;
}

/// Normal sets between two alternate ones.
const NORMAL_SETS: u8 = 10;

/// Configuration of an AMT ECU.
#[derive(Clone, Debug, PartialEq)]
pub struct AmtConfig {
    /// The engine that it reports, with its scales.
    pub engine: EngineModel,
    /// Behaviour that the document leaves open and in which ECUs may differ.
    pub temper: AmtTemper,
    /// Data 1 of the alternate set, for ECUs with an old or an unknown number.
    pub engine_id: u8,
    /// The turbine behind it.
    pub turbine: Parameters,
    /// Its serial line (AMT-1).
    pub line: Line,
    /// Interval between the starts of two sets. The default of 125 ms is the document's "average of
    /// 48 bytes per second" at 2400 baud.
    pub period: Nanos,
    /// Time from power-up to the set-up set (not printed).
    pub boot: Nanos,
    /// Time of address 192: the longest time without accepted messages. The document does not print
    /// its value.
    pub serial_delay: Nanos,
    /// The reply window.
    pub reply_window: Nanos,
    /// PWTH, PWTL and PWDIFF of the set-up set.
    pub pulse: [u8; 3],
    /// Text of the set-up set: `X.NN YYMMDD ` or `XX.NN YYMMDD `.
    pub version_text: String,
    /// Lowest stick position for a start, in half percent, because some ECUs require the stick up.
    /// With 0 the stick must be down, at 5 % at most.
    pub start_throttle: u8,
    /// Whether a serial delay stop is reported as missing switch and throttle channels.
    pub loss_is_an_error: bool,
    /// Supply voltage in V, for the alternate set.
    pub battery_v: f64,
    /// Voltage of the external battery in V, for the alternate set.
    pub external_v: f64,
    /// Number of accepted commands to log.
    pub log: usize,
}

impl AmtConfig {
    /// The usual ECU of this engine, at 2400 8N1.
    pub fn new(engine: EngineModel) -> Self {
        Self {
            engine,
            temper: AmtTemper::DEFAULT,
            engine_id: engine.id(),
            turbine: match engine {
                EngineModel::Mercury => Parameters::MERCURY,
                EngineModel::Pegasus => Parameters::PEGASUS,
                EngineModel::Olympus => Parameters::OLYMPUS,
                // Engines larger than the Olympus, without figures of their own here: the Titan's.
                EngineModel::Titan | EngineModel::Nike | EngineModel::Lynx => Parameters::TITAN,
            },
            line: Line::n1(2400),
            period: 125 * MILLIS,
            boot: 500 * MILLIS,
            serial_delay: 2 * SECOND,
            reply_window: 30 * MILLIS,
            // PWmin = 256 x 0xF8 + 0 - 62464 = 1024, PWmax = 1024 + 62 x 16 = 2016 µs
            pulse: [0xF8, 0x00, 62],
            version_text: version_text(engine.version(), 35, "140617"),
            start_throttle: 0,
            loss_is_an_error: false,
            battery_v: 7.4,
            external_v: 12.0,
            log: 4096,
        }
    }

    /// The same on another line. The period stays the same, because it is not known to change.
    #[must_use]
    pub fn on(self, line: Line) -> Self {
        Self { line, ..self }
    }
}

/// The text of a set-up set: `9.35 140617 ` for version 9, release 35 of June 17, 2014.
pub fn version_text(version: u8, release: u8, date: &str) -> String {
    format!("{version}.{release:02} {date} ")
}

/// Sets sent, by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Frames {
    /// Set-up sets: one for each power-up.
    pub setup: u64,
    /// Normal sets.
    pub normal: u64,
    /// Alternate sets.
    pub alternate: u64,
    /// Error sets.
    pub error: u64,
}

impl Frames {
    /// All of them; each requires one reply.
    pub const fn total(&self) -> u64 {
        self.setup + self.normal + self.alternate + self.error
    }
}

/// Invalid messages, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bad {
    /// The copies differed.
    pub mismatch: u64,
    /// No such OPS.
    pub ops: u64,
    /// THR out of range.
    pub throttle: u64,
    /// A new head before the end.
    pub truncated: u64,
    /// A byte was received with an error.
    pub framing: u64,
}

impl Bad {
    /// The ECU's error counter.
    pub const fn total(&self) -> u64 {
        self.mismatch + self.ops + self.throttle + self.truncated + self.framing
    }
}

/// Counters of an AMT ECU since its creation; a loss of power does not clear them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Sets sent.
    pub frames: Frames,
    /// Well-formed messages, at any time.
    pub valid: u64,
    /// Invalid messages.
    pub bad: Bad,
    /// Good bytes outside of any message.
    pub stray_bytes: u64,
    /// Good bytes.
    pub bytes_received: u64,
    /// Bytes received with an error.
    pub framing_errors: u64,
    /// Replies in time: only these are obeyed.
    pub in_window: u64,
    /// Replies that were completed too late.
    pub late: u64,
    /// Sets without a well-formed reply, counted when the following set has ended.
    pub none: u64,
    /// Second replies to one set, and messages sent during a set.
    pub unsolicited: u64,
    /// The smallest margin of a reply in time.
    pub worst_margin: Option<Nanos>,
    /// Number of times a live engine was stopped for lack of accepted messages.
    pub serial_delay_stops: u64,
    /// Number of times CTF stopped the engine.
    pub ctf_stops: u64,
}

impl Stats {
    /// The counters that every ECU has. All accepted messages are replies in time.
    pub const fn counts(&self) -> Counts {
        Counts {
            frames: self.frames.total(),
            accepted: self.in_window,
            bad: self.bad.total() + self.unsolicited,
            in_window: self.in_window,
            late: self.late,
            unanswered: self.none,
            worst_margin: self.worst_margin,
            loss_stops: self.serial_delay_stops,
            intervals: None,
        }
    }

    /// Faults that a host following the protocol never causes, in sentences.
    pub fn host_faults(&self) -> Vec<&'static str> {
        let found = [
            (self.unsolicited > 0, "it received unsolicited replies"),
            (self.serial_delay_stops + self.ctf_stops > 0, "it stopped its engine without a command"),
        ];
        found.into_iter().filter_map(|(found, text)| found.then_some(text)).collect()
    }
}

/// State that is reset by each power-up.
#[derive(Clone, Debug)]
struct Session {
    next_frame: Nanos,
    setup_sent: bool,
    normal_sets: u8,
    next_tick: Nanos,
    window: Window,
    receiver: Receiver,
    /// The last accepted message, and the time at which it was complete.
    accepted: Option<(Nanos, AmtCommand)>,
    clearance_since: Option<Nanos>,
    ctf_since: Option<Nanos>,
    /// No start until OPS has left run.
    locked: bool,
    /// It is locked because no command arrived.
    silenced: bool,
    own_errors: u8,
    /// Time at which the last trip locked it.
    tripped_at: Option<Nanos>,
    /// Number of normal sets that still show the state and switch from before the loss of power.
    stale: Option<(u8, Status, Ops)>,
}

impl Session {
    fn begin(config: &AmtConfig, now: Nanos, last: Option<(Status, Ops)>) -> Self {
        let frames = config.temper.last_state_first;
        Self {
            next_frame: now + config.boot,
            setup_sent: false,
            normal_sets: 0,
            next_tick: now + STEP,
            window: Window::default(),
            receiver: Receiver::default(),
            accepted: None,
            clearance_since: None,
            ctf_since: None,
            locked: config.temper.wants_auto_stop_first,
            silenced: false,
            own_errors: 0,
            tripped_at: None,
            stale: last.map(|(status, ops)| (frames, status, ops)),
        }
    }

    fn ops(&self) -> Ops {
        self.accepted.map_or(Ops::AutoStop, |(_, command)| command.ops)
    }

    fn throttle(&self) -> u8 {
        self.accepted.map_or(0, |(_, command)| command.throttle_half_percent)
    }
}

/// Whether the ECU has power.
#[derive(Clone, Debug)]
enum Power {
    /// The first call that passes the time switches it on.
    Unborn,
    Off,
    On(Box<Session>),
}

/// An AMT ECU and its turbine.
#[derive(Clone, Debug)]
pub struct AmtEcu {
    config: AmtConfig,
    turbine: Turbine,
    power: Power,
    forced_errors: u8,
    last_state: Option<(Status, Ops)>,
    /// Its counters.
    pub stats: Stats,
    /// The messages that it has obeyed.
    pub commands: CommandLog<AmtCommand>,
}

impl AmtEcu {
    /// An ECU that powers up at the first time passed to it.
    pub fn new(config: AmtConfig) -> Self {
        Self {
            turbine: {
                let mut turbine = Turbine::new(config.turbine);
                turbine.set_starts_hot(config.temper.starts_hot);
                turbine
            },
            commands: CommandLog::new(config.log),
            config,
            power: Power::Unborn,
            forced_errors: 0,
            last_state: None,
            stats: Stats::default(),
        }
    }

    /// Its configuration.
    pub fn config(&self) -> &AmtConfig {
        &self.config
    }

    /// The turbine.
    pub fn turbine(&self) -> &Turbine {
        &self.turbine
    }

    /// The turbine, to make it fail.
    pub fn turbine_mut(&mut self) -> &mut Turbine {
        &mut self.turbine
    }

    /// Reports this supply voltage from now on, in V, in its alternate sets.
    pub fn set_supply(&mut self, volts: f64) {
        self.config.battery_v = volts;
    }

    /// Sets errors to be reported in addition to the ECU's own, until changed. See [`error`].
    pub fn set_errors(&mut self, errors: u8) {
        self.forced_errors = errors;
    }

    /// All errors reported now.
    pub fn errors(&self) -> u8 {
        match &self.power {
            Power::On(session) => self.forced_errors | session.own_errors,
            _ => self.forced_errors,
        }
    }

    /// The state that a normal set reports now in bits 7 to 3 of Data 1.
    pub fn status(&self) -> Status {
        let parameters = self.turbine.parameters();
        let phase = self.turbine.phase();
        if let Some(shown) = self.shown_in_flight().filter(|_| phase == Phase::Running) {
            return shown;
        }
        match phase {
            Phase::Ignition | Phase::Preheat => Status::Starting,
            Phase::FuelRamp if self.turbine.rpm() < 0.6 * parameters.idle_rpm => Status::Starting,
            Phase::FuelRamp => Status::StartedUp,
            Phase::LearningIdle => Status::IdleCalibration,
            Phase::Running if self.turbine.rpm() >= 0.99 * parameters.max_rpm => Status::MaximumRpm,
            Phase::Running => Status::FullOperation,
            Phase::Stopped | Phase::Standby | Phase::Cooling => match &self.power {
                Power::On(session) if session.clearance_since.is_some() => Status::StartClearance,
                _ => Status::NoClearance,
            },
        }
    }

    /// The state reported now for a running engine, if it is not full operation.
    fn shown_in_flight(&self) -> Option<Status> {
        let (Power::On(session), Some(in_flight)) = (&self.power, self.config.temper.in_flight) else {
            return None;
        };
        (session.next_tick % in_flight.every.max(1) < in_flight.lasts).then_some(in_flight.shows)
    }

    /// The engine runs but is reported in another state.
    pub fn hides_that_it_runs(&self) -> bool {
        self.turbine.phase() == Phase::Running && self.shown_in_flight().is_some()
    }

    /// Performs control steps and judges replies up to `now`.
    fn catch_up(&mut self, now: Nanos) {
        if matches!(self.power, Power::Unborn) {
            self.power(now, true);
        }
        if let Power::On(session) = &mut self.power {
            while session.next_tick <= now {
                let at = session.next_tick;
                session.next_tick += STEP;
                self.turbine.advance_to(at);
                control(&self.config, session, &mut self.turbine, &mut self.stats, at);
            }
            if session.window.gave_up(now) {
                self.stats.none += 1;
            }
        }
        self.turbine.advance_to(now);
    }

    fn frame(&mut self) -> Vec<u8> {
        let (status, errors) = (self.status(), self.errors());
        let Power::On(session) = &mut self.power else {
            return Vec::new();
        };
        let config = &self.config;
        if !core::mem::replace(&mut session.setup_sent, true) {
            self.stats.frames.setup += 1;
            return telemetry::setup(config.pulse, &config.version_text);
        }
        if session.normal_sets == NORMAL_SETS {
            session.normal_sets = 0;
            self.stats.frames.alternate += 1;
            let voltages = Voltages {
                idle: config.turbine.pump_idle_v,
                maximum: config.turbine.pump_max_v,
                battery: config.battery_v,
                external: config.external_v,
            };
            return telemetry::alternate(config.engine, config.engine_id, voltages).into();
        }
        session.normal_sets += 1;
        let values = Values {
            engine: config.engine,
            rpm: self.turbine.rpm(),
            egt: self.turbine.sensed_egt(),
            throttle_half_percent: session.throttle(),
            pump_v: self.turbine.pump_voltage(),
        };
        if errors != 0 {
            self.stats.frames.error += 1;
            return values.error(errors).into();
        }
        self.stats.frames.normal += 1;
        if let Some((frames, status, ops)) = &mut session.stale
            && *frames > 0
        {
            *frames -= 1;
            return values.normal(*status, ops.code()).into();
        }
        // The three bits of the switch position are the low bits of OPS, including CTF.
        values.normal(status, session.ops().code()).into()
    }
}

/// One step of the ECU's own control.
fn control(config: &AmtConfig, session: &mut Session, turbine: &mut Turbine, stats: &mut Stats, at: Nanos) {
    let live = turbine.phase().is_live();
    let silent = session.accepted.is_none_or(|(when, _)| at >= when + config.serial_delay);

    if live && !session.locked && silent {
        stats.serial_delay_stops += 1;
        (session.locked, session.silenced) = (true, true);
        if config.loss_is_an_error {
            session.own_errors |= error::SWITCH_CHANNEL | error::THROTTLE_CHANNEL;
        }
    }
    if config.temper.starts_after_silence && session.silenced && !live && !silent {
        (session.locked, session.silenced) = (false, false);
        session.own_errors &= !(error::SWITCH_CHANNEL | error::THROTTLE_CHANNEL);
    }
    if live && session.ctf_since.is_some_and(|since| at >= since + config.serial_delay) {
        stats.ctf_stops += 1;
        session.ctf_since = None;
        session.locked = true;
    }
    if let Some(trip) = turbine.trip() {
        session.locked = true;
        session.own_errors |= match trip {
            Trip::OverTemperature => error::EGT,
            Trip::FlameOut | Trip::NoLight | Trip::StartTimeout => error::RPM_LOW,
        };
        let since = *session.tripped_at.get_or_insert(at);
        if config.temper.trips_clear_after.is_some_and(|after| at >= since + after) {
            session.tripped_at = None;
            session.locked = false;
            session.own_errors = 0;
            turbine.clear_trip();
        }
    }

    let throttle = session.throttle();
    let stick = if config.start_throttle == 0 { throttle <= 10 } else { throttle >= config.start_throttle };
    let may_start = !session.locked && !silent && stick && turbine.is_ready_to_start();
    let switch = match session.ops() {
        Ops::EmergencyStop => Switch::Stop,
        Ops::Run if !session.locked && live => Switch::Run,
        Ops::Run if may_start => {
            let since = *session.clearance_since.get_or_insert(at);
            if at >= since + config.temper.clearance { Switch::Run } else { Switch::Standby }
        }
        Ops::Ctf if !session.locked => turbine.switch(),
        Ops::AutoStop | Ops::Run | Ops::Ctf => Switch::Standby,
    };
    if !(session.ops() == Ops::Run && may_start) {
        session.clearance_since = None;
    }
    turbine.set_switch(switch);
    turbine.set_demand(Demand::Throttle(u16::from(throttle) * 5));
}

impl Ecu for AmtEcu {
    fn next_wake(&self) -> Nanos {
        match &self.power {
            Power::Unborn => 0,
            Power::Off => Nanos::MAX,
            Power::On(session) => session.next_frame,
        }
    }

    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>) {
        self.catch_up(now);
        let Power::On(session) = &self.power else { return };
        if now < session.next_frame {
            return;
        }
        let bytes = self.frame();
        let end = now + self.config.line.byte_ns(bytes.len() as u64);
        tx.extend(bytes);
        if let Power::On(session) = &mut self.power {
            session.window.sent(now, end);
            // A late call does not shift the schedule, and sets that were missed entirely are not sent.
            let period = self.config.period.max(1);
            session.next_frame += ((now - session.next_frame) / period + 1) * period;
            session.next_frame = session.next_frame.max(end);
        }
    }

    fn receive(&mut self, now: Nanos, byte: Result<u8, LineFault>) {
        self.catch_up(now);
        let Power::On(session) = &mut self.power else { return };
        let stats = &mut self.stats;
        match byte {
            Ok(_) => stats.bytes_received += 1,
            Err(_) => stats.framing_errors += 1,
        }
        let start = now.saturating_sub(self.config.line.byte_ns(1));
        let (start, command) = match session.receiver.receive(start, byte) {
            Received::Part => return,
            Received::Stray => return stats.stray_bytes += 1,
            Received::Broken { in_message } => return stats.bad.framing += u64::from(in_message),
            Received::Truncated => return stats.bad.truncated += 1,
            Received::Message { start, command } => (start, command),
        };
        let command = match command {
            Ok(command) => command,
            Err(BadCommand::Mismatch) => return stats.bad.mismatch += 1,
            Err(BadCommand::Ops(_)) => return stats.bad.ops += 1,
            Err(BadCommand::Throttle(_)) => return stats.bad.throttle += 1,
            Err(BadCommand::Truncated | BadCommand::Shape) => return stats.bad.truncated += 1,
        };
        stats.valid += 1;
        match session.window.classify(start, now, self.config.reply_window) {
            Reply::Late => return stats.late += 1,
            Reply::Unsolicited => return stats.unsolicited += 1,
            Reply::InWindow { margin } => {
                stats.in_window += 1;
                stats.worst_margin = Some(stats.worst_margin.map_or(margin, |worst| worst.min(margin)));
            }
        }

        session.accepted = Some((now, command));
        self.commands.push(now, command);
        match command.ops {
            Ops::Ctf => {
                if self.turbine.phase().is_live() {
                    session.ctf_since.get_or_insert(now);
                }
            }
            Ops::Run => session.ctf_since = None,
            Ops::EmergencyStop | Ops::AutoStop => {
                session.ctf_since = None;
                (session.locked, session.silenced) = (false, false);
                session.own_errors = 0;
                session.tripped_at = None;
                self.turbine.clear_trip();
                // "Emergency" takes effect without waiting for the next control step.
                let stop = command.ops == Ops::EmergencyStop;
                self.turbine.set_switch(if stop { Switch::Stop } else { Switch::Standby });
            }
        }
    }

    fn power(&mut self, now: Nanos, on: bool) {
        match (&self.power, on) {
            (Power::On(_), true) | (Power::Off, false) => {}
            (_, true) => {
                self.turbine.advance_to(now);
                self.turbine.clear_trip();
                self.power = Power::On(Box::new(Session::begin(&self.config, now, self.last_state)));
            }
            (_, false) => {
                if matches!(self.power, Power::On(_)) {
                    self.catch_up(now);
                }
                let status = self.status();
                self.last_state = match &self.power {
                    Power::On(session) => Some((status, session.ops())),
                    _ => None,
                };
                // The valves close without current.
                self.turbine.set_switch(Switch::Stop);
                self.power = Power::Off;
            }
        }
    }
}

#[cfg(test)]
mod tests;
