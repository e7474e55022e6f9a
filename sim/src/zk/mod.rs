//! A ZK ECU, from the ZK-Protocol document V1.2, protocol versions 1 to 6.
//!
//! Up to version 4 it only answers: one status frame for each valid command. From version 5 it sends
//! unprompted at its rate, and keeps the engine running unchanged when the host falls silent
//! (ZK-10).
//!
//! Points that the document leaves open, and their treatment here:
//!
//! - Status IDs are sent in turn, the lowest first ([`ZkConfig::ids`] changes that).
//! - Up to version 4 the status rate is reported but does not delay answers, unless
//!   [`ZkConfig::rate_bounds_answers`] is set. At most one answer waits; further commands received
//!   before it is sent are obeyed without their own answer.
//! - Up to version 4 the control signal is lost when no valid frame, including ID 0, was received for
//!   [`ZkConfig::control_loss`] while the host has the engine switched to run: error 13 and standby.
//!   As after any failure, the switch has to leave run once before the next start.
//! - From version 5 that detection is off for the UART, as the document says. The loss of a PWM input
//!   that controls a live engine is error 13 in every version.
//! - While ID 6 controls the switch, the last SW of ID 1 is stored and applies again, also as PWM
//!   hand-over, when ID 6 releases the switch (SW = 0 and RPM_X = 0). While RPM_X is not 0, ID 1 is
//!   not stored either, and SW = 0 in ID 6 leaves the switch unchanged.
//! - State 2, "ignition (requires minimum throttle)": a start waits there while the throttle is
//!   above 5 %, except in rpm mode. States 6 and 7 (learning the stick) never occur, and 13 (restart)
//!   only with [`ZkTemper::relights`].
//! - A service test lasts [`ZkConfig::service_time`], needs an engine at rest, and ends when the
//!   engine is switched to run.
//! - ID 4 and 5 without ID 3 directly before are not answered ("ECU will not respond").
//! - Rate, ignition voltage and curve survive a loss of power; nothing else of the control does.

mod any;
mod command;
mod config;
mod session;
mod stats;
mod status;
mod temper;

use crate::ecu::{Ecu, LineFault, Nanos};
use crate::log::CommandLog;
use crate::turbine::{Demand, Phase, STEP, Switch, Trip, Turbine};

use self::command::Received;
pub use self::command::{
    Action, BadCommand, HEAD, LENGTH, Sw, ZkCommand, crc8, parse_command, reserved_bits,
};
pub use self::config::{Pwm, Rate, ZkConfig};
pub use self::session::ControlledBy;
use self::session::{LastState, Service, Session};
pub use self::stats::{Bad, Ignored, Intervals, Stats};
use self::status::Values;
pub use self::status::{LAST_ID, error, since_version, state};
pub use self::temper::ZkTemper;

/// Settings that survive a loss of power.
#[derive(Clone, Copy, Debug)]
struct Settings {
    rate: Rate,
    ignition_voltage: u8,
    curve_up: u8,
}

#[derive(Clone, Debug)]
enum Power {
    /// The first call that passes the time switches it on.
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
    /// Its counters.
    pub stats: Stats,
    /// The commands that it has obeyed.
    pub commands: CommandLog<ZkCommand>,
}

impl ZkEcu {
    /// An ECU that powers up at the first time passed to it.
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

    /// Its initial configuration; the host may have changed some of it since.
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

    /// Sets the signal at the PWM input; `None` is no signal.
    pub fn set_pwm(&mut self, pwm: Option<Pwm>) {
        self.pwm = pwm;
    }

    /// Reports this supply voltage from now on, in V.
    pub fn set_supply(&mut self, volts: f64) {
        self.config.supply_v = volts;
    }

    /// Reports this error instead of the ECU's own.
    pub fn set_error(&mut self, error: Option<u8>) {
        self.forced_error = error;
    }

    /// Reports this state instead of the ECU's own.
    pub fn set_state(&mut self, state: Option<u8>) {
        self.forced_state = state;
    }

    fn session(&self) -> Option<&Session> {
        match &self.power {
            Power::On(session) => Some(session),
            Power::Unborn | Power::Off => None,
        }
    }

    /// The input that controls the switch now.
    pub fn controlled_by(&self) -> ControlledBy {
        self.session().map_or(ControlledBy::Pwm, Session::controlled_by)
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

    /// The last pressure from the host, in hPa.
    pub fn pressure(&self) -> Option<u16> {
        self.session().and_then(|session| session.pressure)
    }

    /// The reported throttle, in percent; in rpm mode, the target load.
    pub fn throttle_percent(&self) -> f64 {
        self.session().map_or(0.0, |session| self.throttle_of(session))
    }

    /// The error reported now; see [`error`].
    pub fn error(&self) -> u8 {
        self.forced_error.unwrap_or_else(|| self.session().map_or(0, |session| session.error))
    }

    /// The engine state reported now; see [`state`].
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
        let hides_pump = self.config.temper.standby_while_pump_is_open;
        if let Some(service) = &session.service
            && !(hides_pump && service.action == Action::OpenPump)
        {
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

    /// The switch reported now.
    fn switch_status(&self, session: &Session) -> u8 {
        if let Some(last) = session.stale() {
            return last.switch;
        }
        match session.switch(self.pwm) {
            Some(Switch::Run) if !session.held_off => 2,
            Some(Switch::Run | Switch::Standby) => 1,
            // After a loss of the input the engine cools: this is standby.
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

    /// Performs control steps up to `now`.
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

    /// Time of the next frame.
    fn next_frame(&self) -> Nanos {
        let Some(session) = self.session() else {
            return Nanos::MAX;
        };
        let due = if self.sends_by_itself() { Some(session.next_status) } else { session.answer_at };
        due.map_or(Nanos::MAX, |due| due.max(session.line_free))
    }

    /// Up to version 4: one status frame for the command that was just accepted.
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
        // A stop takes effect without waiting for the next control step.
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
    let lost = match session.controlled_by() {
        ControlledBy::Pwm => pwm.is_none() && live,
        ControlledBy::Uart => {
            let silent = session.last_control.is_none_or(|last| at >= last + config.control_loss);
            config.version < 5 && switch == Some(Switch::Run) && silent
        }
    };
    if lost && !session.held_off {
        stats.control_losses += 1;
        session.held_off = true;
        session.error = error::CONTROL_LOST;
    } else if (turbine.trip() == Some(Trip::FlameOut)
        || session.restarting && turbine.trip() == Some(Trip::NoLight))
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
            // Only frames are visible from outside; the steps in between are made up later.
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
            // A late call does not shift the schedule, and frames that were missed entirely are not sent.
            if let Some(late) = now.checked_sub(session.next_status) {
                session.next_status += (late / period + 1) * period;
            }
        }
    }

    fn receive(&mut self, now: Nanos, byte: Result<u8, LineFault>) {
        self.catch_up(now);
        let Power::On(session) = &mut self.power else { return };
        if now < session.ready_at {
            return;
        }
        match byte {
            Ok(_) => self.stats.bytes_received += 1,
            Err(_) => self.stats.framing_errors += 1,
        }
        match session.receiver.receive(byte) {
            Received::Part => {}
            Received::Stray => self.stats.stray_bytes += 1,
            Received::WrongCrc => self.stats.bad.crc += 1,
            Received::Frame(bytes) => self.frame(bytes, now),
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
