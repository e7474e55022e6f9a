//! A toy ECU with its engine, written from the document (the head of `toy/src/ecu/toy/mod.rs`) and not from the codec.
//!
//! Points that the document leaves open, and their treatment here:
//!
//! - It sends its first frame when it is powered up.
//! - An engine that starts is reported at rest until it idles.
//! - It cools the engine after every stop but the emergency stop.

mod any;
mod command;

use crate::ecu::{Ecu, LineFault, MILLIS, Nanos, SECOND};
use crate::frame::ControlFrame as _;
use crate::line::Line;
use crate::log::CommandLog;
use crate::turbine::{Parameters, Phase, Switch, Turbine};

pub use self::command::{BadCommand, ToyCommand};

/// Interval between two frames.
const PERIOD: Nanos = 100 * MILLIS;
/// Time without a command after which it stops its engine.
const CONTROL_LOSS: Nanos = SECOND;

/// Configuration of a toy ECU.
#[derive(Clone, Debug, PartialEq)]
pub struct ToyConfig {
    /// Serial number of the engine.
    pub engine: u8,
    /// Its serial line.
    pub line: Line,
    /// The turbine behind it.
    pub turbine: Parameters,
    /// Number of obeyed commands to log.
    pub log: usize,
}

impl ToyConfig {
    /// An ECU of this engine.
    pub fn new(engine: u8) -> Self {
        Self {
            engine,
            line: Line::n1(9600),
            turbine: Parameters { name: "toy", ..Parameters::ZK_160K },
            log: 4096,
        }
    }
}

/// Counters of a toy ECU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Frames sent.
    pub frames: u64,
    /// Bytes that belong to no command, and commands that the document does not have.
    pub bad: u64,
    /// Number of times a live engine was stopped for lack of commands.
    pub loss_stops: u64,
}

/// A toy ECU and its turbine.
#[derive(Debug)]
pub struct ToyEcu {
    config: ToyConfig,
    turbine: Turbine,
    on: bool,
    overheated: bool,
    next_frame: Nanos,
    last_command: Nanos,
    /// The first byte of a command.
    begun: Option<u8>,
    /// Its counters.
    pub stats: Stats,
    /// The commands that it has obeyed.
    pub commands: CommandLog<ToyCommand>,
}

impl ToyEcu {
    /// An ECU without power.
    pub fn new(config: ToyConfig) -> Self {
        Self {
            turbine: Turbine::new(config.turbine),
            on: false,
            overheated: false,
            next_frame: 0,
            last_command: 0,
            begun: None,
            stats: Stats::default(),
            commands: CommandLog::new(config.log),
            config,
        }
    }

    /// Its configuration.
    pub fn config(&self) -> &ToyConfig {
        &self.config
    }

    /// Sets whether it reports an overheated engine.
    pub fn report_overheated(&mut self, overheated: bool) {
        self.overheated = overheated;
    }

    fn obey(&mut self, now: Nanos, command: ToyCommand) {
        self.last_command = now;
        self.commands.push(now, command);
        match command {
            ToyCommand::Nothing | ToyCommand::Prime => {}
            ToyCommand::Standby => self.turbine.set_switch(Switch::Standby),
            ToyCommand::Run => self.turbine.set_switch(Switch::Run),
            ToyCommand::EmergencyStop => self.turbine.set_switch(Switch::Stop),
        }
    }

    fn frame(&self) -> [u8; 3] {
        let running = self.turbine.phase() == Phase::Running;
        let egt = (self.turbine.sensed_egt() / 5.0).clamp(0.0, 255.0) as u8;
        [0xA5, u8::from(running) | u8::from(self.overheated) << 7, egt]
    }
}

impl Ecu for ToyEcu {
    fn next_wake(&self) -> Nanos {
        if self.on { self.next_frame.min(self.last_command + CONTROL_LOSS) } else { Nanos::MAX }
    }

    fn advance(&mut self, now: Nanos, tx: &mut Vec<u8>) {
        self.turbine.advance_to(now);
        if !self.on {
            return;
        }
        if now >= self.last_command + CONTROL_LOSS {
            self.stats.loss_stops += u64::from(self.turbine.phase().is_live());
            self.turbine.set_switch(Switch::Standby);
            self.last_command = now;
        }
        if now >= self.next_frame {
            self.next_frame += PERIOD;
            self.stats.frames += 1;
            tx.extend(self.frame());
        }
    }

    fn receive(&mut self, now: Nanos, byte: Result<u8, LineFault>) {
        self.turbine.advance_to(now);
        let head = ToyCommand::UNIQUE_HEAD;
        let begun = core::mem::replace(&mut self.begun, byte.ok().filter(|byte| Some(*byte) == head));
        let (Some(head), Ok(number)) = (begun, byte) else {
            self.stats.bad += u64::from(self.begun.is_none());
            return;
        };
        match ToyCommand::read(&[head, number]) {
            Ok(command) => self.obey(now, command),
            Err(_) => self.stats.bad += 1,
        }
    }

    fn power(&mut self, now: Nanos, on: bool) {
        self.turbine.advance_to(now);
        if on && !self.on {
            (self.next_frame, self.last_command, self.begun) = (now, now, None);
        }
        if !on {
            self.turbine.set_switch(Switch::Stop);
        }
        self.on = on;
    }
}
