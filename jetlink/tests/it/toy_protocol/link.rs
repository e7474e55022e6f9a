//! The conversation with a toy ECU: a command in every send slot.

use super::codec::{Control, Decoder, FRAME_LEN, Frame, State};
use super::config::Config;
use crate::support::bench::{Machine, machine};
use embassy_time::{Duration, Instant};
use jetlink::command::{Demand, Order, Rejected};
use jetlink::ecu::Service;
use jetlink::event::Event;
use jetlink::line::{Line, LineError, Timing};
use jetlink::link::{
    Beat, Link, LinkMonitor, LinkStatus, Outbox, Output, Sign, Speaks, Stage, Transmission, earlier,
};
use jetlink::report::{NotSent, Phase, Timed};
use jetlink::units::Hectopascals;

/// Interval between two frames of the ECU.
const FRAMES_EVERY: Duration = Duration::from_millis(100);

/// The conversation with one toy ECU.
#[derive(Clone, Debug)]
pub struct ToyLink {
    config: Config,
    decoder: Decoder,
    status: LinkStatus,
    monitor: LinkMonitor,
    beat: Beat,
    outbox: Outbox,
    order: Order,
    sign: Option<Sign>,
    next_slot: Option<Instant>,
}

machine!(ToyLink, Link, |link, now| Link::start(link, now));

impl ToyLink {
    fn frame(&mut self, now: Instant, frame: Frame) {
        self.beat.frame(now);
        self.status.counters.frames += 1;
        if self.monitor.frame(now, &mut self.status) {
            self.outbox.event(Event::LinkUp);
        }
        let (stage, phase) = match frame.state {
            State::Rest => (Stage::Rest, Phase::Standby),
            State::Running => (Stage::Running, Phase::Running),
            State::Unknown(_) => (Stage::Unknown, Phase::Unknown),
        };
        self.sign = Some(Sign::State { stage, turning: Some(stage == Stage::Running), throttle: None });
        self.status.report.phase = Some(Timed::new(phase, now));
    }
}

impl Speaks for Config {
    type Link = ToyLink;

    fn link(self, line: Line, timing: Timing) -> ToyLink {
        ToyLink {
            config: self,
            decoder: Decoder::default(),
            status: LinkStatus::default(),
            monitor: LinkMonitor::new(timing),
            beat: Beat::new(FRAME_LEN as u8, line, FRAMES_EVERY),
            outbox: Outbox::default(),
            order: Order::Listen,
            sign: None,
            next_slot: None,
        }
    }

    fn configure(self, link: &mut ToyLink, _now: Instant, _line: Line, timing: Timing) {
        link.config = self;
        link.monitor.configure(timing);
    }
}

impl Link for ToyLink {
    fn start(&mut self, now: Instant) {
        self.monitor.start(now);
        self.next_slot = Some(now);
    }
    fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        let (taken, frame) = self.decoder.feed(bytes);
        self.beat.bytes(now, taken);
        if let Some(frame) = frame {
            self.frame(now, frame);
        }
        taken
    }
    fn line_error(&mut self, _error: LineError) {}
    fn order(&mut self, _now: Instant, order: Order) -> Result<(), Rejected> {
        match order {
            Order::Run(Demand::Rpm(_)) => Err(Rejected::NoSpeedControl),
            Order::Pwm => Err(Rejected::NotSupported),
            order => {
                self.order = order;
                Ok(())
            }
        }
    }
    fn speed_control(&self) -> Result<(), Rejected> {
        Err(Rejected::NoSpeedControl)
    }
    fn service(&mut self, _now: Instant, _service: Service) -> Result<(), Rejected> {
        // Its own service commands get here with the line in the library's list.
        Err(Rejected::NotSupported)
    }
    fn pressure(&mut self, _now: Instant, _pressure: Hectopascals) {}
    fn sent(&mut self, _now: Instant) {
        self.outbox.done();
    }
    fn not_sent(&mut self, _now: Instant, why: NotSent) {
        self.outbox.event(Event::NotSent(why));
        self.outbox.done();
    }
    fn timeout(&mut self, now: Instant) {
        if self.monitor.timeout(now, &mut self.status) {
            self.outbox.event(Event::LinkLost);
        }
        let Some(due) = self.next_slot.filter(|due| now >= *due) else { return };
        self.next_slot = Some(due + self.config.send_every);
        let control = match self.order {
            Order::Standby => Control::Standby,
            Order::Run(_) => Control::Run,
            Order::EmergencyStop => Control::EmergencyStop,
            Order::Listen | Order::Doubt(_) | Order::Pwm => Control::Nothing,
        };
        self.outbox.put(Transmission::new(control.encode(), None));
    }
    fn poll(&mut self) -> Output {
        let wait = Output::Wait(earlier(self.next_slot, self.monitor.deadline()));
        self.outbox.poll(&mut self.status).unwrap_or(wait)
    }
    fn take_sign(&mut self) -> Option<Sign> {
        self.sign.take()
    }
    fn release(&mut self, released: bool) {
        self.beat.bridge(released);
    }

    fn gap_at(&self) -> Option<Instant> {
        self.beat.gap_at()
    }
    fn gap(&mut self) {
        self.beat.gap();
    }
    fn answers_frames(&self) -> bool {
        false
    }
    fn reply_timeout(&self) -> Option<Duration> {
        None
    }
    fn status(&self) -> &LinkStatus {
        &self.status
    }
}
