//! The link of any ECU.

use super::amt::link::AmtLink;
use super::zk::link::ZkLink;
use super::{EcuConfig, Service};
use crate::command::{Order, Rejected};
use crate::line::{Line, LineError, Timing};
use crate::link::{Link, LinkStatus, Output, Sign};
use crate::report::NotSent;
use crate::units::Hectopascals;
use embassy_time::Instant;

/// The link of any ECU.
#[derive(Clone, Debug)]
pub enum AnyLink {
    /// AMT.
    Amt(AmtLink),
    /// ZK.
    Zk(ZkLink),
}

impl AnyLink {
    /// The link that a configuration asks for.
    pub fn new(config: &EcuConfig, line: Line, timing: Timing) -> Self {
        match config {
            EcuConfig::Amt(config) => Self::Amt(AmtLink::new(*config, line, timing)),
            EcuConfig::Zk(config) => Self::Zk(ZkLink::new(*config, line, timing)),
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

    fn status(&self) -> &LinkStatus {
        each!(self, link => link.status())
    }
}
