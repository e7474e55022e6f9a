//! The ECUs jetlink speaks to. A third protocol is one folder here and one arm in [`AnyLink`],
//! [`EcuConfig`], [`Service`] and [`Faults`].

pub mod amt;
pub mod zk;

use crate::command::{Order, Rejected};
use crate::line::{Line, LineError};
use crate::link::{Link, Output, Sign, Timing};
use crate::telemetry::{Counters, LinkState, NotSent, Report};
use crate::units::Hectopascals;
use embassy_time::Instant;

/// Which ECU is on a port, and how it is spoken to.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum EcuConfig {
    /// AMT serial control.
    Amt(amt::link::Config),
    /// ZK-Protocol.
    Zk(zk::link::Config),
}

/// A service command: done once, in the ECU's own terms.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Service {
    /// Of an AMT ECU.
    Amt(amt::link::Service),
    /// Of a ZK ECU.
    Zk(zk::link::Service),
}

impl Service {
    /// It moves fuel or heats, so the engine has to be cold and at rest, and it is ended after a time.
    pub const fn moves_fuel(self) -> bool {
        match self {
            Self::Amt(_) => false,
            Self::Zk(service) => service.moves_fuel(),
        }
    }

    /// It ends what one that moves fuel began.
    pub const fn closes_pump(self) -> bool {
        matches!(self, Self::Zk(zk::link::Service::Action(zk::codec::Action::ClosePump)))
    }

    /// Whether the ECU has to report a stopped engine first.
    pub const fn needs_stopped_engine(self) -> bool {
        match self {
            Self::Amt(service) => service.needs_stopped_engine(),
            Self::Zk(service) => service.needs_stopped_engine(),
        }
    }
}

/// The faults that an ECU reports.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Faults {
    /// Of an AMT ECU: several at once.
    Amt(amt::codec::ErrorBits),
    /// Of a ZK ECU: one code.
    Zk(zk::codec::ErrorCode),
}

impl Faults {
    /// Whether it reports none.
    pub const fn is_empty(self) -> bool {
        match self {
            Self::Amt(bits) => bits.0 == 0,
            Self::Zk(code) => code.code() == 0,
        }
    }
}

impl Faults {
    /// The number on the wire: AMT a set of bits, ZK a code.
    pub const fn number(self) -> u8 {
        match self {
            Self::Amt(bits) => bits.0,
            Self::Zk(code) => code.code(),
        }
    }
}

impl core::fmt::Display for Faults {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Amt(bits) if bits.0 == 0 => f.write_str("none"),
            Self::Amt(bits) => {
                for (i, name) in bits.names().enumerate() {
                    if i > 0 {
                        f.write_str(", ")?;
                    }
                    f.write_str(name)?;
                }
                Ok(())
            }
            Self::Zk(zk::codec::ErrorCode::Unknown(code)) => write!(f, "unknown error {code}"),
            Self::Zk(code) => f.write_str(code.name()),
        }
    }
}

/// The link of any ECU.
#[derive(Clone, Debug)]
pub enum AnyLink {
    /// AMT.
    Amt(amt::link::AmtLink),
    /// ZK.
    Zk(zk::link::ZkLink),
}

impl AnyLink {
    /// The link that a configuration asks for.
    pub fn new(config: &EcuConfig, line: Line, timing: Timing) -> Self {
        match config {
            EcuConfig::Amt(config) => Self::Amt(amt::link::AmtLink::new(*config, line, timing)),
            EcuConfig::Zk(config) => Self::Zk(zk::link::ZkLink::new(*config, line, timing)),
        }
    }
}

macro_rules! each {
    ($self:ident, $link:ident => $call:expr) => {
        match $self {
            AnyLink::Amt($link) => $call,
            AnyLink::Zk($link) => $call,
        }
    };
}

impl Link for AnyLink {
    fn start(&mut self, now: Instant) {
        each!(self, link => link.start(now));
    }

    fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        each!(self, link => link.receive(now, bytes))
    }

    fn line_error(&mut self, error: LineError) {
        each!(self, link => link.line_error(error));
    }

    fn byte_lost(&mut self, error: LineError) {
        each!(self, link => link.byte_lost(error));
    }

    fn order(&mut self, now: Instant, order: Order) -> Result<(), Rejected> {
        each!(self, link => link.order(now, order))
    }

    fn speed_control(&self) -> Result<(), Rejected> {
        each!(self, link => link.speed_control())
    }

    fn service(&mut self, now: Instant, service: Service) -> Result<(), Rejected> {
        each!(self, link => link.service(now, service))
    }

    fn pressure(&mut self, now: Instant, pressure: Hectopascals) {
        each!(self, link => link.pressure(now, pressure));
    }

    fn sent(&mut self, now: Instant) {
        each!(self, link => link.sent(now));
    }

    fn not_sent(&mut self, now: Instant, why: NotSent) {
        each!(self, link => link.not_sent(now, why));
    }

    fn timeout(&mut self, now: Instant) {
        each!(self, link => link.timeout(now));
    }

    fn poll(&mut self) -> Output {
        each!(self, link => link.poll())
    }

    fn take_sign(&mut self) -> Option<Sign> {
        each!(self, link => link.take_sign())
    }

    fn release(&mut self, released: bool) {
        each!(self, link => link.release(released));
    }

    fn gap_at(&self) -> Option<Instant> {
        each!(self, link => link.gap_at())
    }

    fn answers_frames(&self) -> bool {
        each!(self, link => link.answers_frames())
    }

    fn doubt_ends(&self, since: Instant) -> Option<Instant> {
        each!(self, link => link.doubt_ends(since))
    }

    fn gap(&mut self) {
        each!(self, link => link.gap());
    }

    fn switch_by_id6(&self) -> bool {
        each!(self, link => link.switch_by_id6())
    }

    fn resume_switch_by_id6(&mut self) {
        each!(self, link => link.resume_switch_by_id6());
    }

    fn close_pump(&mut self) {
        each!(self, link => link.close_pump());
    }

    fn service_pending(&self) -> bool {
        each!(self, link => link.service_pending())
    }

    fn closing_pump(&self) -> bool {
        each!(self, link => link.closing_pump())
    }

    fn report(&self) -> &Report {
        each!(self, link => link.report())
    }

    fn state(&self) -> LinkState {
        each!(self, link => link.state())
    }

    fn heard(&self) -> Option<Instant> {
        each!(self, link => link.heard())
    }

    fn up_since(&self) -> Option<Instant> {
        each!(self, link => link.up_since())
    }

    fn shutting_down(&self) -> bool {
        each!(self, link => link.shutting_down())
    }

    fn frames(&self) -> u32 {
        each!(self, link => link.frames())
    }

    fn counters(&self) -> Counters {
        each!(self, link => link.counters())
    }
}
