//! A ZK ECU, from the ZK-Protocol document V1.2, protocol versions 1 to 6.
//!
//! Up to version 4 it speaks only when spoken to: one status frame for each valid command. From
//! version 5 it sends by itself at its rate, and keeps the engine as it is when the host falls
//! silent (ZK-10).
//!
//! What the document leaves open, and what is done here:
//!
//! - Status IDs go out in turn, the lowest first ([`ZkConfig::ids`] changes that).
//! - Up to version 4 the status rate is reported but does not hold answers back, unless
//!   [`ZkConfig::rate_bounds_answers`] is set. One answer waits at most; further commands that come
//!   before it is out are obeyed without an answer of their own.
//! - Up to version 4 the control signal is lost when nothing valid, ID 0 included, has come for
//!   [`ZkConfig::control_loss`] while the host has the engine switched to run: error 13 and
//!   standby. The next start needs the switch to leave run once; so it does after any failure.
//! - From version 5 that detection is off, as the document says, for the UART. A lost PWM input
//!   that rules a live engine is error 13 in every version.
//! - While ID 6 holds the switch, the last SW of ID 1 is remembered and rules again, also as PWM
//!   hand-over, when ID 6 gives the switch back (SW = 0 and RPM_X = 0). While RPM_X is not 0,
//!   ID 1 is not even remembered, and SW = 0 in ID 6 leaves the switch as it is.
//! - State 2, "ignition (requires minimum throttle)": a start waits there while the throttle is
//!   above 5 %, except in rpm mode. States 6 and 7 (learning the stick) never occur, and 13 (restart)
//!   only with [`ZkTemper::relights`].
//! - A service test lasts [`ZkConfig::service_time`], needs an engine at rest, and ends when the
//!   engine is switched to run.
//! - ID 4 and 5 without ID 3 directly before are not answered ("ECU will not respond").
//! - Rate, ignition voltage and curve survive a loss of power; nothing else of the control does.

mod command;
mod status;
mod temper;

use crate::ecu::{Ecu, LineFault, MILLIS, Nanos, SECOND};
use crate::line::Line;
use crate::log::CommandLog;
use crate::turbine::{Demand, Parameters, Phase, STEP, Switch, Trip, Turbine};

pub use self::command::{
    Action, BadCommand, HEAD, LENGTH, Sw, ZkCommand, crc8, parse_command, reserved_bits,
};
use self::command::{Heard, Receiver};
use self::status::Values;
pub use self::status::{LAST_ID, error, since_version, state};
pub use self::temper::ZkTemper;

/// How often status is sent (ZK-11).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// 20 Hz.
    Hz20,
    /// 50 Hz.
    Hz50,
    /// 100 Hz.
    Hz100,
}

impl Rate {
    /// From one frame to the next.
    pub const fn period(self) -> Nanos {
        match self {
            Self::Hz20 => 50 * MILLIS,
            Self::Hz50 => 20 * MILLIS,
            Self::Hz100 => 10 * MILLIS,
        }
    }

    const fn bits(self) -> u8 {
        match self {
            Self::Hz20 => 0,
            Self::Hz50 => 1,
            Self::Hz100 => 2,
        }
    }
}

/// What comes in on the ECU's PWM input; it rules while the UART says SW = 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pwm {
    /// The switch channel.
    pub switch: Switch,
    /// The throttle channel, 0..=1000.
    pub throttle: u16,
}

/// How a ZK ECU is set.
#[derive(Clone, Debug, PartialEq)]
pub struct ZkConfig {
    /// Protocol version, 1 to 6; higher ones behave as 6.
    pub version: u8,
    /// What the document leaves open and ECUs may do differently.
    pub temper: ZkTemper,
    /// Its serial line (ZK-12).
    pub line: Line,
    /// Status rate.
    pub rate: Rate,
    /// The turbine behind it.
    pub turbine: Parameters,
    /// It has no sensor of the air pressure and asks the host for it (ZK-14).
    pub esr: bool,
    /// Status IDs in the order in which they go round. IDs without a meaning here are sent with
    /// zeros for data.
    pub ids: Vec<u8>,
    /// From power to the first frame, or until it listens (not printed).
    pub boot: Nanos,
    /// From the end of a command to the answer (not printed).
    pub answer_delay: Nanos,
    /// Whether answers of versions up to 4 keep the distance of the status rate.
    pub rate_bounds_answers: bool,
    /// After so long without a command the control signal is lost, up to version 4 (not printed).
    pub control_loss: Nanos,
    /// How long a service test lasts (not printed).
    pub service_time: Nanos,
    /// Whether a start waits for the throttle to be down.
    pub start_needs_low_throttle: bool,
    /// Ignition pump voltage in steps of 0.02 V.
    pub ignition_voltage: u8,
    /// Acceleration curve, 10..=70.
    pub curve_up: u8,
    /// Deceleration curve.
    pub curve_down: u8,
    /// "Radio" voltage in V.
    pub radio_v: f64,
    /// Supply voltage in V.
    pub supply_v: f64,
    /// Temperature of the ECU in °C.
    pub ecu_temperature: f64,
    /// How many obeyed commands are kept.
    pub log: usize,
}

impl ZkConfig {
    /// An ECU of this version, at 9600 8N1 and 20 Hz.
    pub fn new(version: u8) -> Self {
        Self {
            version,
            temper: ZkTemper::DEFAULT,
            line: Line::n1(9600),
            rate: Rate::Hz20,
            turbine: Parameters::ZK_160K,
            esr: false,
            ids: (1..=10).filter(|&id| since_version(id) <= version).collect(),
            boot: 300 * MILLIS,
            answer_delay: MILLIS / 2,
            rate_bounds_answers: false,
            control_loss: SECOND,
            service_time: 3 * SECOND,
            start_needs_low_throttle: true,
            ignition_voltage: 75,
            curve_up: 30,
            curve_down: 30,
            radio_v: 5.0,
            supply_v: 11.1,
            ecu_temperature: 35.0,
            log: 4096,
        }
    }

    /// The same on another line.
    pub fn on(self, line: Line) -> Self {
        Self { line, ..self }
    }

    /// The same at another rate.
    pub fn at(self, rate: Rate) -> Self {
        Self { rate, ..self }
    }
}

/// Frames that were none, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bad {
    /// Wrong CRC.
    pub crc: u64,
    /// No such command ID.
    pub id: u64,
    /// A value out of its range.
    pub range: u64,
}

impl Bad {
    /// All of them.
    pub const fn total(&self) -> u64 {
        self.crc + self.id + self.range
    }
}

/// Good frames that changed nothing, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ignored {
    /// The ECU's version does not know it. It is not answered either.
    pub version: u64,
    /// ID 4 or 5 without ID 3 directly before. It is not answered either.
    pub locked: u64,
    /// ID 1 in rpm mode, or ID 7 outside of it.
    pub mode: u64,
    /// A service command while the engine was not at rest.
    pub busy: u64,
}

/// The times between accepted commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Intervals {
    /// How many.
    pub count: u64,
    /// The shortest.
    pub min: Option<Nanos>,
    /// The longest.
    pub max: Option<Nanos>,
}

impl Intervals {
    fn add(&mut self, interval: Nanos) {
        self.count += 1;
        self.min = Some(self.min.map_or(interval, |min| min.min(interval)));
        self.max = Some(self.max.map_or(interval, |max| max.max(interval)));
    }
}

/// What a ZK ECU has counted since it was built; a loss of power does not clear it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Status frames sent, by ID.
    pub frames: [u64; 16],
    /// Commands that were obeyed and not answered, because an answer was waiting already.
    pub unanswered: u64,
    /// Good frames with a command that the version knows; all but the ignored ones are obeyed.
    pub accepted: u64,
    /// Good frames that changed nothing.
    pub ignored: Ignored,
    /// Frames that were none.
    pub bad: Bad,
    /// Good frames with reserved bits that were not 0.
    pub reserved_bits: u64,
    /// Good bytes outside of any frame.
    pub stray_bytes: u64,
    /// Good bytes.
    pub bytes_heard: u64,
    /// Broken bytes.
    pub framing_errors: u64,
    /// The times between accepted commands, within one power-up.
    pub intervals: Intervals,
    /// How often the control signal of a live engine was lost.
    pub control_losses: u64,
    /// Pressures received.
    pub pressures: u64,
}

impl Stats {
    /// All status frames sent.
    pub fn frames_sent(&self) -> u64 {
        self.frames.iter().sum()
    }
}

/// Who rules the switch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ruler {
    /// The UART.
    Uart,
    /// The PWM input.
    Pwm,
}

/// A service test, or the pump held open.
#[derive(Clone, Copy, Debug)]
struct Service {
    action: Action,
    until: Nanos,
}

/// What begins anew with each power-up.
#[derive(Clone, Debug)]
struct Session {
    ready_at: Nanos,
    next_tick: Nanos,
    /// From version 5.
    next_status: Nanos,
    /// Up to version 4: the answer that waits.
    answer_at: Option<Nanos>,
    last_status: Option<Nanos>,
    line_free: Nanos,
    turn: usize,
    receiver: Receiver,
    last_command: Option<Nanos>,
    unlocked: bool,

    id1_sw: Sw,
    throttle: u16,
    id6_sw: Sw,
    factor: u8,
    rpm_code: u16,
    /// The switch as the UART last had it, for rpm mode without one.
    held_sw: Sw,

    /// When a command last came that keeps the control signal from counting as lost.
    last_control: Option<Nanos>,
    /// No start before the switch has left run.
    held_off: bool,
    waits_for_throttle: bool,
    /// The start under way is a relight: state 13.
    restarting: bool,
    /// The engine was starting or running when the ECU lost its power: the next start is a relight.
    resumes: bool,
    /// Relights by itself that are left in this run.
    relights_left: u8,
    /// What so many status frames ID 1 still show: state and switch from before the loss of power.
    stale: Option<(u8, LastState)>,
    error: u8,
    service: Option<Service>,
    pressure: Option<u16>,
}

/// What was reported last before power was lost.
#[derive(Clone, Copy, Debug)]
struct LastState {
    state: u8,
    switch: u8,
    live: bool,
}

impl Session {
    fn begin(config: &ZkConfig, now: Nanos, last: Option<LastState>) -> Self {
        let temper = &config.temper;
        let ready_at = now + config.boot;
        Self {
            ready_at,
            next_tick: now + STEP,
            next_status: ready_at,
            answer_at: None,
            last_status: None,
            line_free: now,
            turn: 0,
            receiver: Receiver::default(),
            last_command: None,
            unlocked: false,
            id1_sw: Sw::None,
            throttle: 0,
            id6_sw: Sw::None,
            factor: 0,
            rpm_code: 0,
            held_sw: Sw::None,
            last_control: None,
            held_off: temper.wants_standby_first,
            waits_for_throttle: false,
            restarting: false,
            resumes: temper.relights > 0 && last.is_some_and(|last| last.live),
            relights_left: temper.relights,
            stale: last.map(|last| (temper.last_state_first, last)),
            error: 0,
            service: None,
            pressure: None,
        }
    }

    /// What the status still shows from before the loss of power.
    fn stale(&self) -> Option<LastState> {
        self.stale.filter(|&(frames, _)| frames > 0).map(|(_, last)| last)
    }

    /// The switch as the UART has it, in whichever of the three modes (ZK-9).
    fn sw(&self) -> Sw {
        match (self.id6_sw, self.factor) {
            (Sw::None, 0) => self.id1_sw,
            (Sw::None, _) => self.held_sw,
            (sw, _) => sw,
        }
    }

    fn ruler(&self) -> Ruler {
        if self.sw() == Sw::None { Ruler::Pwm } else { Ruler::Uart }
    }

    /// What is commanded: by the UART, else by the PWM input, else by nobody.
    fn switch(&self, pwm: Option<Pwm>) -> Option<Switch> {
        match self.sw() {
            Sw::None => pwm.map(|pwm| pwm.switch),
            Sw::Stop => Some(Switch::Stop),
            Sw::Standby => Some(Switch::Standby),
            Sw::Run => Some(Switch::Run),
        }
    }

    fn demand(&self, pwm: Option<Pwm>) -> Demand {
        if self.factor != 0 {
            // Target rpm = code x RPM_X x 10
            return Demand::Rpm(u32::from(self.rpm_code) * u32::from(self.factor) * 10);
        }
        Demand::Throttle(match self.ruler() {
            Ruler::Uart => self.throttle,
            Ruler::Pwm => pwm.map_or(0, |pwm| pwm.throttle.min(1000)),
        })
    }
}

/// What survives a loss of power.
#[derive(Clone, Copy, Debug)]
struct Settings {
    rate: Rate,
    ignition_voltage: u8,
    curve_up: u8,
}

#[derive(Clone, Debug)]
enum Power {
    /// It will be switched on by the first call that tells the time.
    Unborn,
    Off,
    On(Box<Session>),
}

/// A ZK ECU and its turbine.
#[derive(Clone, Debug)]
pub struct ZkEcu {
    config: ZkConfig,
    settings: Settings,
    turbine: Turbine,
    power: Power,
    pwm: Option<Pwm>,
    last_state: Option<LastState>,
    thrust_zero: f64,
    forced_error: Option<u8>,
    forced_state: Option<u8>,
    /// What it has counted.
    pub stats: Stats,
    /// The commands it has obeyed.
    pub commands: CommandLog<ZkCommand>,
}

impl ZkEcu {
    /// An ECU that is powered up at the first time it is told.
    pub fn new(config: ZkConfig) -> Self {
        Self {
            settings: Settings {
                rate: config.rate,
                ignition_voltage: config.ignition_voltage,
                curve_up: config.curve_up,
            },
            turbine: {
                let mut turbine = Turbine::new(config.turbine);
                turbine.set_starts_hot(config.temper.starts_hot);
                turbine
            },
            commands: CommandLog::new(config.log),
            config,
            power: Power::Unborn,
            pwm: None,
            last_state: None,
            thrust_zero: 0.0,
            forced_error: None,
            forced_state: None,
            stats: Stats::default(),
        }
    }

    /// How it was set; the host may have changed some of it since.
    pub fn config(&self) -> &ZkConfig {
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

    /// What comes in on the PWM input; `None` is no signal.
    pub fn set_pwm(&mut self, pwm: Option<Pwm>) {
        self.pwm = pwm;
    }

    /// Reports this error whatever the ECU's own one is.
    pub fn set_error(&mut self, error: Option<u8>) {
        self.forced_error = error;
    }

    /// Reports this state whatever the ECU's own one is.
    pub fn set_state(&mut self, state: Option<u8>) {
        self.forced_state = state;
    }

    fn session(&self) -> Option<&Session> {
        match &self.power {
            Power::On(session) => Some(session),
            Power::Unborn | Power::Off => None,
        }
    }

    /// Who rules the switch now.
    pub fn ruler(&self) -> Ruler {
        self.session().map_or(Ruler::Pwm, Session::ruler)
    }

    /// The status rate now.
    pub fn rate(&self) -> Rate {
        self.settings.rate
    }

    /// The acceleration curve now.
    pub fn curve(&self) -> u8 {
        self.settings.curve_up
    }

    /// The ignition pump voltage now, in steps of 0.02 V.
    pub fn ignition_voltage(&self) -> u8 {
        self.settings.ignition_voltage
    }

    /// The pressure in hPa that the host sent last.
    pub fn pressure(&self) -> Option<u16> {
        self.session().and_then(|session| session.pressure)
    }

    /// The throttle that it tells, in percent: in rpm mode the load that it is to reach.
    pub fn throttle_percent(&self) -> f64 {
        self.session().map_or(0.0, |session| self.throttle_of(session))
    }

    /// The error that is reported now; see [`error`].
    pub fn error(&self) -> u8 {
        self.forced_error.unwrap_or_else(|| self.session().map_or(0, |session| session.error))
    }

    /// The engine state that is reported now; see [`state`].
    pub fn state(&self) -> u8 {
        if let Some(state) = self.forced_state {
            return state;
        }
        let Some(session) = self.session() else {
            return state::STOP;
        };
        if let Some(last) = session.stale() {
            return last.state;
        }
        if let Some(service) = session.service {
            return match service.action {
                Action::DrainOil => state::EXHAUST_AIR,
                Action::TestGlowPlug => state::TEST_GLOW_PLUG,
                Action::TestMainValve => state::TEST_MAIN_VALVE,
                Action::TestIgnitionValve => state::TEST_IGNITION_VALVE,
                Action::TestStarter => state::TEST_STARTER,
                _ => state::TEST_PUMP,
            };
        }
        match self.turbine.phase() {
            phase if session.restarting && phase.is_starting() => state::RESTART,
            Phase::Stopped => state::STOP,
            Phase::Standby if session.waits_for_throttle => state::IGNITION_WAITS,
            Phase::Standby => state::STANDBY,
            Phase::Ignition => state::IGNITION,
            Phase::Preheat => state::PREHEAT,
            Phase::FuelRamp => state::FUEL_RAMP,
            Phase::LearningIdle => state::LEARNING_IDLE,
            Phase::Cooling => state::COOLING,
            Phase::Running if self.turbine.pump_voltage() >= 0.995 * self.config.turbine.pump_max_v => {
                state::PUMP_LIMIT
            }
            Phase::Running => match session.demand(self.pwm) {
                Demand::Throttle(0) => state::MINIMUM,
                Demand::Rpm(rpm) if f64::from(rpm) <= self.config.turbine.idle_rpm => state::MINIMUM,
                _ => state::RUNNING,
            },
        }
    }

    /// The switch that is reported now.
    fn switch_status(&self, session: &Session) -> u8 {
        if let Some(last) = session.stale() {
            return last.switch;
        }
        match session.switch(self.pwm) {
            Some(Switch::Run) if !session.held_off => 2,
            Some(Switch::Run | Switch::Standby) => 1,
            // After a loss of the input it cools: that is standby.
            None if session.held_off => 1,
            Some(Switch::Stop) | None => 0,
        }
    }

    fn throttle_of(&self, session: &Session) -> f64 {
        match session.demand(self.pwm) {
            Demand::Throttle(permille) => f64::from(permille) / 10.0,
            Demand::Rpm(rpm) => self.config.turbine.load(f64::from(rpm)) * 100.0,
        }
    }

    fn values(&self, session: &Session) -> Values {
        let (config, turbine) = (&self.config, &self.turbine);
        let by_rpm = session.factor != 0;
        Values {
            version: config.version,
            rpm: turbine.rpm(),
            state: self.state(),
            error: self.error(),
            egt: turbine.sensed_egt(),
            switch: self.switch_status(session),
            radio_v: config.radio_v,
            supply_v: config.supply_v,
            pump_v: turbine.pump_voltage(),
            throttle_percent: self.throttle_of(session),
            pressure_pa: match session.pressure {
                Some(hectopascal) => f64::from(hectopascal) * 100.0,
                None if config.esr => 0.0,
                None => 101_325.0,
            },
            current_a: turbine.current(),
            thrust_kg: ((turbine.thrust() - self.thrust_zero) / 9.81).max(0.0),
            ignition_voltage: self.settings.ignition_voltage,
            curve_up: self.settings.curve_up,
            curve_down: config.curve_down,
            max_rpm: config.turbine.max_rpm,
            max_pump_v: config.turbine.pump_max_v,
            rate: self.settings.rate.bits(),
            flow_l_min: turbine.fuel_flow() / 1000.0,
            total_l: turbine.fuel_total() / 1000.0,
            idle_rpm: config.turbine.idle_rpm,
            wants_pressure: config.esr,
            closed_loop: by_rpm && turbine.phase() == Phase::Running,
            start_time_s: turbine.start_time(),
            ecu_temperature: config.ecu_temperature,
        }
    }

    fn sends_by_itself(&self) -> bool {
        self.config.version >= 5
    }

    /// Control steps up to `now`.
    fn catch_up(&mut self, now: Nanos) {
        if matches!(self.power, Power::Unborn) {
            self.power(now, true);
        }
        if let Power::On(session) = &mut self.power {
            while session.next_tick <= now {
                let at = session.next_tick;
                session.next_tick += STEP;
                self.turbine.advance_to(at);
                control(&self.config, session, &mut self.turbine, &mut self.stats, self.pwm, at);
            }
        }
        self.turbine.advance_to(now);
    }

    /// When the next frame is to go out.
    fn next_frame(&self) -> Nanos {
        let Some(session) = self.session() else {
            return Nanos::MAX;
        };
        let due = if self.sends_by_itself() { Some(session.next_status) } else { session.answer_at };
        due.map_or(Nanos::MAX, |due| due.max(session.line_free))
    }

    /// Up to version 4: one status for what was just accepted.
    fn answer(&mut self, now: Nanos) {
        if self.sends_by_itself() {
            return;
        }
        let period = self.settings.rate.period();
        let Power::On(session) = &mut self.power else { return };
        if session.answer_at.is_some() {
            self.stats.unanswered += 1;
            return;
        }
        let mut at = now + self.config.answer_delay;
        if let Some(last) = session.last_status.filter(|_| self.config.rate_bounds_answers) {
            at = at.max(last + period);
        }
        session.answer_at = Some(at);
    }

    fn frame(&mut self, bytes: [u8; 4], now: Nanos) {
        let command = match parse_command(&bytes) {
            Ok(command) => command,
            Err(BadCommand::Crc | BadCommand::Head) => return self.stats.bad.crc += 1,
            Err(BadCommand::Id(_)) => return self.stats.bad.id += 1,
            Err(BadCommand::Range(_)) => return self.stats.bad.range += 1,
        };
        self.stats.reserved_bits += u64::from(reserved_bits(&bytes) != 0);
        let Power::On(session) = &mut self.power else { return };

        let unlocked = core::mem::replace(&mut session.unlocked, command == ZkCommand::Unlock);
        if command.since_version() > self.config.version {
            self.stats.ignored.version += 1;
            return;
        }
        self.stats.accepted += 1;
        if command != ZkCommand::Empty || self.config.temper.empty_keeps_control {
            session.last_control = Some(now);
        }
        if let Some(last) = session.last_command.replace(now) {
            self.stats.intervals.add(now - last);
        }
        if matches!(command, ZkCommand::IgnitionVoltage(_) | ZkCommand::AccelerationCurve(_)) && !unlocked {
            self.stats.ignored.locked += 1;
            return;
        }
        match self.obey(command, now) {
            Ok(()) => self.commands.push(now, command),
            Err(Refused::Mode) => self.stats.ignored.mode += 1,
            Err(Refused::Busy) => self.stats.ignored.busy += 1,
        }
        self.answer(now);
    }

    fn obey(&mut self, command: ZkCommand, now: Nanos) -> Result<(), Refused> {
        let Power::On(session) = &mut self.power else { return Ok(()) };
        match command {
            ZkCommand::Empty | ZkCommand::Unlock => {}
            ZkCommand::Control { .. } if session.factor != 0 => return Err(Refused::Mode),
            ZkCommand::Control { sw, throttle } => {
                session.id1_sw = sw;
                session.throttle = throttle;
            }
            ZkCommand::Action(action) => return self.action(action, now),
            ZkCommand::IgnitionVoltage(value) => self.settings.ignition_voltage = value,
            ZkCommand::AccelerationCurve(value) => self.settings.curve_up = value,
            ZkCommand::Switch { sw, factor } => {
                session.id6_sw = sw;
                if factor == 0 {
                    session.rpm_code = 0;
                }
                session.factor = factor;
            }
            ZkCommand::Rpm(_) if session.factor == 0 => return Err(Refused::Mode),
            ZkCommand::Rpm(code) => session.rpm_code = code,
            ZkCommand::Pressure(hectopascal) => {
                session.pressure = Some(hectopascal);
                self.stats.pressures += 1;
            }
        }
        let Power::On(session) = &mut self.power else { return Ok(()) };
        let switch = session.switch(self.pwm);
        session.held_sw = session.sw();
        // A stop does not wait for the next control step.
        if switch == Some(Switch::Stop) {
            self.turbine.set_switch(Switch::Stop);
        }
        self.turbine.set_curves(self.settings.curve_up, self.config.curve_down);
        Ok(())
    }

    fn action(&mut self, action: Action, now: Nanos) -> Result<(), Refused> {
        let Power::On(session) = &mut self.power else { return Ok(()) };
        match action {
            Action::Rate20 => self.settings.rate = Rate::Hz20,
            Action::Rate50 => self.settings.rate = Rate::Hz50,
            Action::Rate100 => self.settings.rate = Rate::Hz100,
            Action::ResetFuel => self.turbine.reset_fuel(),
            Action::ZeroThrust => self.thrust_zero = self.turbine.thrust(),
            Action::ClosePump => {
                session.service.take_if(|service| service.action == Action::OpenPump);
            }
            Action::DrainOil
            | Action::TestGlowPlug
            | Action::TestMainValve
            | Action::TestIgnitionValve
            | Action::TestPump
            | Action::TestStarter
            | Action::OpenPump => {
                let at_rest = match self.turbine.phase() {
                    Phase::Stopped | Phase::Standby => true,
                    Phase::Cooling => self.config.temper.services_while_cooling,
                    _ => false,
                };
                if !at_rest || session.switch(self.pwm) == Some(Switch::Run) {
                    return Err(Refused::Busy);
                }
                let until =
                    if action == Action::OpenPump { Nanos::MAX } else { now + self.config.service_time };
                session.service = Some(Service { action, until });
            }
        }
        Ok(())
    }
}

enum Refused {
    Mode,
    Busy,
}

/// One step of the ECU's own control.
fn control(
    config: &ZkConfig,
    session: &mut Session,
    turbine: &mut Turbine,
    stats: &mut Stats,
    pwm: Option<Pwm>,
    at: Nanos,
) {
    let live = turbine.phase().is_live();
    let switch = session.switch(pwm);
    let lost = match session.ruler() {
        Ruler::Pwm => pwm.is_none() && live,
        Ruler::Uart => {
            let silent = session.last_control.is_none_or(|last| at >= last + config.control_loss);
            config.version < 5 && switch == Some(Switch::Run) && silent
        }
    };
    if lost && !session.held_off {
        stats.control_losses += 1;
        session.held_off = true;
        session.error = error::CONTROL_LOST;
    } else if turbine.trip() == Some(Trip::FlameOut)
        && switch == Some(Switch::Run)
        && !session.held_off
        && session.relights_left > 0
    {
        session.relights_left -= 1;
        session.restarting = true;
        turbine.relight();
    } else if let Some(trip) = turbine.trip().filter(|_| !session.held_off) {
        session.held_off = true;
        session.error = match trip {
            Trip::FlameOut => error::RPM_LOW,
            Trip::OverTemperature => error::EGT_HIGH,
            Trip::NoLight => error::EGT_LOW,
            Trip::StartTimeout => error::TIME_OUT,
        };
    } else if matches!(switch, Some(Switch::Stop | Switch::Standby)) {
        session.held_off = false;
        session.error = 0;
        session.resumes = false;
        session.relights_left = config.temper.relights;
        turbine.clear_trip();
    }
    if turbine.phase().is_starting() {
        session.restarting |= core::mem::take(&mut session.resumes);
    } else {
        session.restarting = false;
    }

    let live = turbine.phase().is_live();
    let demand = session.demand(pwm);
    let high_throttle = matches!(demand, Demand::Throttle(51..));
    let wants_start = switch == Some(Switch::Run) && !session.held_off && !live;
    session.waits_for_throttle = wants_start && high_throttle && config.start_needs_low_throttle;
    turbine.set_switch(match switch {
        _ if session.held_off => Switch::Standby,
        Some(Switch::Run) if session.waits_for_throttle => Switch::Standby,
        Some(switch) => switch,
        None => Switch::Stop,
    });
    turbine.set_demand(demand);

    if switch == Some(Switch::Run) || live {
        session.service = None;
    }
    session.service.take_if(|service| at >= service.until);
    let (pump, starter) = match session.service.map(|service| service.action) {
        Some(Action::TestPump | Action::OpenPump | Action::DrainOil) => (true, false),
        Some(Action::TestMainValve | Action::TestIgnitionValve) => (config.temper.valves_pass_fuel, false),
        Some(Action::TestStarter) => (false, true),
        _ => (false, false),
    };
    turbine.set_bench(pump, starter);
}

impl Ecu for ZkEcu {
    fn next_wake(&self) -> Nanos {
        match &self.power {
            Power::Unborn => 0,
            // Nothing but a frame is visible from outside; the steps in between are caught up on.
            Power::Off | Power::On(_) => self.next_frame(),
        }
    }

    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>) {
        self.catch_up(now);
        if now < self.next_frame() {
            return;
        }
        let period = self.settings.rate.period();
        let Some(session) = self.session() else { return };
        let turn = session.turn;
        let id = self.config.ids.get(turn % self.config.ids.len().max(1)).copied().unwrap_or(1);
        let bytes = self.values(session).frame(id);
        self.stats.frames[usize::from(id & 15)] += 1;
        tx.extend(bytes);
        if let Power::On(session) = &mut self.power {
            session.turn += 1;
            session.answer_at = None;
            session.last_status = Some(now);
            if id == 1
                && let Some((frames, _)) = &mut session.stale
            {
                *frames = frames.saturating_sub(1);
            }
            session.line_free = now + self.config.line.byte_ns(7);
            // A late call does not shift the beat, and what was missed altogether is not sent.
            if let Some(late) = now.checked_sub(session.next_status) {
                session.next_status += (late / period + 1) * period;
            }
        }
    }

    fn heard(&mut self, now: Nanos, byte: Result<u8, LineFault>) {
        self.catch_up(now);
        let Power::On(session) = &mut self.power else { return };
        if now < session.ready_at {
            return;
        }
        match byte {
            Ok(_) => self.stats.bytes_heard += 1,
            Err(_) => self.stats.framing_errors += 1,
        }
        match session.receiver.hear(byte) {
            Heard::Part => {}
            Heard::Stray => self.stats.stray_bytes += 1,
            Heard::WrongCrc => self.stats.bad.crc += 1,
            Heard::Frame(bytes) => self.frame(bytes, now),
        }
    }

    fn power(&mut self, now: Nanos, on: bool) {
        match (&self.power, on) {
            (Power::On(_), true) | (Power::Off, false) => {}
            (_, true) => {
                self.turbine.advance_to(now);
                self.turbine.clear_trip();
                self.turbine.set_curves(self.settings.curve_up, self.config.curve_down);
                self.power = Power::On(Box::new(Session::begin(&self.config, now, self.last_state)));
            }
            (_, false) => {
                if matches!(self.power, Power::On(_)) {
                    self.catch_up(now);
                }
                self.last_state = self.session().map(|session| LastState {
                    state: self.state(),
                    switch: self.switch_status(session),
                    live: self.turbine.phase().is_live(),
                });
                // The valves close without current.
                self.turbine.set_switch(Switch::Stop);
                self.turbine.set_bench(false, false);
                self.power = Power::Off;
            }
        }
    }
}

#[cfg(test)]
mod tests;
