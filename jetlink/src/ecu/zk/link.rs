//! The conversation with a ZK ECU: a command in every send slot, ID 0 when nothing is commanded (ZK-10).
//!
//! Up to version 4 the ECU only answers commands. From version 5 it sends unprompted and keeps its last running state when
//! commands stop, so nothing here relies on the ECU to fail safe.
//!
//! Frame sent in a slot, in order of precedence:
//!
//! 1. an emergency stop, at once between slots, and again in every slot; in between, in every second slot at most, the end
//!    of a service that opened the pump;
//! 2. the command that an unlock was sent for, right after it (ZK-13);
//! 3. in every second slot at most: status rate, service command, atmospheric pressure (`service.rs`);
//! 4. the switch and the demand, in one of three modes (ZK-9, `mode.rs`), or ID 0.

use super::codec::{
    Action, Control, Decoder, Rate, RpmCode, RpmFactor, STATUS_LEN, Status, StatusFrame, Version,
};
use super::config::Config;
use super::mode::{Known, Modes};
use super::service::{Pressure, PumpClosing, RateSetting, ServiceCommand};
use super::status::{DebouncedStatus, observation_of, reported};
use crate::command::{Demand, Order, Rejected};
use crate::ecu::Service as AnyService;
use crate::ecu::vendor::VendorService;
use crate::event::Event;
use crate::line::{Line, LineError, Timing};
use crate::link::{
    Damage, GapDetector, Link, LinkMonitor, LinkRecord, LinkStatus, Observation, Outbox, Output,
    ServiceFrames, Speaks, Transmission, earlier,
};
use crate::report::{NotSent, bump};
use crate::units::{Hectopascals, Rpm, Throttle};
use embassy_time::{Duration, Instant};

/// The conversation with one ZK ECU.
#[derive(Clone, Debug)]
pub struct ZkLink {
    line: Line,
    monitor: LinkMonitor,
    decoder: Decoder,
    damage: Damage,
    status: LinkStatus,
    debounced: DebouncedStatus,
    outbox: Outbox,
    gaps: GapDetector,
    observation: Option<Observation>,
    next_slot: Option<Instant>,
    /// A frame has to be sent before the next slot, as soon as the UART is free.
    out_of_slot: bool,
    /// The last slot was not used for switch and demand.
    extra_last: bool,
    modes: Modes,
    wanted_rate: Rate,
    /// The rate of the settings. A service command may have set another one since.
    configured_rate: Rate,
    rate: RateSetting,
    service: ServiceCommand,
    pump: PumpClosing,
    pressure: Pressure,
}

impl ZkLink {
    /// A link on a line with these settings.
    pub fn new(config: Config, line: Line, timing: Timing) -> Self {
        Self {
            line,
            monitor: LinkMonitor::new(timing),
            decoder: Decoder::new(),
            damage: Damage::default(),
            status: LinkStatus::default(),
            debounced: DebouncedStatus::new(),
            outbox: Outbox::default(),
            gaps: GapDetector::new(STATUS_LEN as u8, line, Rate::Hz20.interval()),
            observation: None,
            next_slot: None,
            out_of_slot: false,
            extra_last: false,
            modes: Modes::new(config.split_switch),
            wanted_rate: config.rate,
            configured_rate: config.rate,
            rate: RateSetting::NotKnown,
            service: ServiceCommand::None,
            pump: PumpClosing::NotKnown,
            pressure: Pressure::NotKnown,
        }
    }

    fn frame(&mut self, now: Instant, frame: &StatusFrame) {
        // A silence that has lasted long enough was a loss, even if this frame is handled before the timer.
        self.check_link(now);
        self.gaps.frame(now);
        if self.monitor.frame(now, &mut self.status) {
            self.outbox.event(Event::LinkUp);
        }
        let status = frame.status();
        self.observation = Some(observation_of(frame, &status, &self.status.report));
        self.debounced.see(now, frame, &status, &mut self.status.report, &mut self.outbox);
        match status {
            Status::Engine { switch, .. } => self.modes.reported(now, reported(switch)),
            Status::Settings { .. } => self.service.confirm(&self.status.report, &mut self.outbox),
            Status::Voltages { .. } => {
                let at_rest = self.status.report.phase.is_some_and(|phase| phase.value.is_stopped());
                let may_be_left_open = at_rest && self.may_have_close_pump();
                self.pump.confirm(self.status.report.pump, may_be_left_open);
            }
            Status::Identity { rate, .. } => {
                self.expect_frames(rate);
                self.rate.compare(now, self.wanted_rate, rate, &mut self.outbox);
            }
            _ => {}
        }
    }

    /// Changes the rate of the ECU and of the send slots.
    fn want_rate(&mut self, now: Instant, rate: Rate) {
        self.wanted_rate = rate;
        // Until the ECU reports its rate, it may send at any that it was given before.
        self.gaps.expect_no_sooner(rate.interval());
        self.rate = RateSetting::commanding(now);
    }

    fn check_link(&mut self, now: Instant) {
        if self.monitor.timeout(now, &mut self.status) {
            self.outbox.event(Event::LinkLost);
            // State that decides which frames the ECU is sent ends with the link; the rate may differ too.
            self.rate = RateSetting::NotKnown;
            self.debounced.forget(&mut self.status.report);
        }
    }

    /// Interval between frames: that of the slowest of the debounced, the last reported and the requested rate, because an ECU may
    /// answer at either (ZK-10, ZK-11).
    fn expect_frames(&mut self, reported: Option<Rate>) {
        let interval = |rate: Option<Rate>| rate.unwrap_or(Rate::Hz20).interval();
        let reported = interval(reported).max(interval(self.debounced.rate()));
        self.gaps.expect(reported.max(self.wanted_rate.interval()));
    }

    /// The version that two reports agree on, which decides which commands the ECU is sent.
    fn version(&self) -> Option<Version> {
        self.status.report.version.map(|version| version.value)
    }

    /// ZK-7: refuses commands that the ECU does not support; only those of version 1 are allowed while its version is unknown.
    fn require(&self, needed: Version) -> Result<(), Rejected> {
        let known = self.version();
        if needed <= Version::FIRST || Version::knows(known, needed) == Some(true) {
            return Ok(());
        }
        Err(Rejected::NeedsVersion { needed: needed.get(), known: known.map(Version::get) })
    }

    /// Whether the ECU may have the command that opens its pump and the one that closes it (ZK-7). Of one that does not, a pump with a
    /// voltage was not left open by a service. It matters for a pump that is found open only: one that a service opened is closed
    /// whatever version is reported since, because a forged report must not leave it open.
    fn may_have_close_pump(&self) -> bool {
        let needed = Control::Action(Action::ClosePump).min_version();
        Version::knows(self.version(), needed) != Some(false)
    }

    fn fill_slot(&mut self, now: Instant) {
        self.out_of_slot = false;
        let control = self.compose(now);
        let has_demand = matches!(control, Control::Throttle { .. } | Control::Rpm(_));
        self.outbox.put(Transmission::new(control.encode(), None).with_demand(has_demand));
    }

    fn compose(&mut self, now: Instant) -> Control {
        if !self.modes.stops()
            && let Some(control) = self.service.unlocked()
        {
            return control;
        }
        if let Some(control) = self.pump.frame(self.status.report.pump) {
            return control;
        }
        if self.modes.stops() {
            return self.switch_and_demand();
        }
        // The demand never waits for more than one slot.
        if !self.extra_last
            && !self.modes.take_partner_due()
            && let Some(control) = self.extra(now)
        {
            self.extra_last = true;
            return control;
        }
        self.extra_last = false;
        self.switch_and_demand()
    }

    fn switch_and_demand(&mut self) -> Control {
        let known = Known {
            version: self.version(),
            max_rpm: self.status.report.max_rpm.map(|max| max.value),
            at_rest: self.debounced.at_rest(),
        };
        self.modes.frame(&known)
    }

    /// The frame that replaces the demand in one slot, if one is due.
    fn extra(&mut self, now: Instant) -> Option<Control> {
        self.rate
            .frame(now, self.wanted_rate, &mut self.outbox)
            .or_else(|| self.service.frame(now, &mut self.outbox))
            .or_else(|| self.pressure_command(now))
    }

    fn pressure_command(&mut self, now: Instant) -> Option<Control> {
        let control = self.pressure.frame(now, &self.status.report)?;
        self.require(control.min_version()).ok()?;
        self.pressure.taken(now);
        Some(control)
    }

    fn transmission_over(&mut self, now: Instant) {
        self.outbox.done();
        if self.out_of_slot || self.service.unlocks() {
            self.fill_slot(now);
        }
    }
}

impl Speaks for Config {
    type Link = ZkLink;

    fn link(self, line: Line, timing: Timing) -> ZkLink {
        ZkLink::new(self, line, timing)
    }

    fn configure(self, link: &mut ZkLink, now: Instant, _line: Line, timing: Timing) {
        link.monitor.configure(timing);
        link.modes.split_switch(self.split_switch);
        // A rate that a service command has set stays, unless the setting is another one.
        if core::mem::replace(&mut link.configured_rate, self.rate) != self.rate {
            link.want_rate(now, self.rate);
        }
    }
}

impl Link for ZkLink {
    fn start(&mut self, now: Instant) {
        self.monitor.start(now);
        self.next_slot = Some(now);
    }

    fn receive(&mut self, now: Instant, bytes: &[u8]) -> usize {
        // Where no frame was expected, bytes before a pause are the rest of one. With the next bytes one rest in 256 has a right CRC.
        if self.gaps.gap_at().is_none() && self.gaps.broke_off(now) {
            self.decoder.byte_lost();
        }
        let (taken, frame) = self.decoder.feed(bytes);
        self.damage.received(taken, bytes.len());
        self.gaps.bytes(now, taken);
        let decoder = self.decoder.counters();
        let counters = &mut self.status.counters;
        counters.frames = decoder.frames;
        counters.unknown_frames = decoder.unknown_frames;
        counters.crc_failures = decoder.crc_failures;
        counters.bytes_skipped = decoder.bytes_skipped;
        if let Some(frame) = frame {
            // Where noise leaves hardly a frame whole, most of the frames with a right CRC are damaged ones, one in 256 of those,
            // and two of them may agree.
            if self.damage.reaches_back(STATUS_LEN) {
                bump(&mut self.status.counters.damaged_frames);
            } else {
                self.frame(now, &frame);
            }
        }
        taken
    }

    fn line_error(&mut self, error: LineError) {
        // The samples of a bit differed, and most of them decided. A slow edge does that in every frame, so it is left to the CRC.
        if error != LineError::Noise {
            self.damage.line_error();
        }
        self.status.counters.line_error(error);
    }

    fn byte_lost(&mut self, error: LineError) {
        self.damage.byte_lost();
        self.status.counters.line_error(error);
    }

    fn order(&mut self, now: Instant, order: Order) -> Result<(), Rejected> {
        if let Order::Run(Demand::Rpm(rpm)) = order {
            self.speed_control()?;
            // Status ID 6 carries the version and the maximum, so the maximum is known here.
            if let Some(max) = self.status.report.max_rpm
                && rpm > max.value
            {
                return Err(Rejected::AboveMaxRpm { max: max.value });
            }
        }
        self.pump.ordered(now, order);
        let alive = self.status.report.phase.map(|phase| phase.value.is_alive());
        if !self.modes.order(now, order, alive) {
            return Ok(());
        }
        // It needed a stopped engine, and must not be sent later.
        if !self.modes.is_standby() {
            self.service.cancel(&mut self.outbox);
        }
        self.pump.let_order_pass();
        if self.modes.stops() {
            // ZK has no reply window: a stop is sent at once.
            if self.outbox.busy() {
                self.out_of_slot = true;
            } else {
                self.fill_slot(now);
            }
        }
        Ok(())
    }

    fn speed_control(&self) -> Result<(), Rejected> {
        self.require(Control::Rpm(RpmCode::for_target(Rpm::new(0), RpmFactor::OFF)).min_version())
    }

    fn service(&mut self, now: Instant, service: AnyService) -> Result<(), Rejected> {
        let AnyService::Zk(service) = service else { return Err(Rejected::NotSupported) };
        let control = service.control();
        if service.needs_stopped_engine() && !self.modes.is_standby() {
            return Err(Rejected::NotStopped);
        }
        self.require(control.min_version())?;
        let rate = Rate::ALL.into_iter().find(|rate| control == Control::Action(rate.action()));
        if let Some(rate) = rate {
            if !rate.fits(self.line) {
                return Err(Rejected::RateTooFast);
            }
            self.want_rate(now, rate);
            return Ok(());
        }
        if self.service.is_pending() {
            return Err(Rejected::Busy);
        }
        if service.moves_fuel() {
            self.pump.may_open();
        }
        self.service = ServiceCommand::waiting(service);
        Ok(())
    }

    fn pressure(&mut self, now: Instant, pressure: Hectopascals) {
        self.pressure.set(now, pressure);
    }

    fn sent(&mut self, now: Instant) {
        bump(&mut self.status.counters.sent);
        self.out_of_slot |= self.modes.sent();
        self.service.sent(now, &mut self.outbox);
        self.pump.sent(now);
        self.transmission_over(now);
    }

    fn not_sent(&mut self, now: Instant, why: NotSent) {
        self.status.counters.not_sent(why);
        self.outbox.event(Event::NotSent(why));
        self.modes.not_sent();
        self.service.not_sent();
        self.pump.not_sent();
        self.transmission_over(now);
    }

    fn timeout(&mut self, now: Instant) {
        self.check_link(now);
        let Some(due) = self.next_slot.filter(|due| now >= *due) else { return };
        let delay = now - due;
        let worst = self.status.counters.worst_slot_delay.get_or_insert(delay);
        *worst = delay.max(*worst);
        // Slots keep their schedule; missed ones are skipped, never made up for in a burst.
        let interval = self.wanted_rate.interval();
        let skipped = delay.as_ticks() / interval.as_ticks();
        self.next_slot = Some(due + Duration::from_ticks(interval.as_ticks() * (skipped + 1)));
        self.status.counters.send_slots_missed =
            self.status.counters.send_slots_missed.wrapping_add(skipped as u32);
        if self.outbox.idle() {
            self.fill_slot(now);
        } else {
            bump(&mut self.status.counters.send_slots_missed);
        }
    }

    fn poll(&mut self) -> Output {
        self.outbox
            .poll(&mut self.status)
            .unwrap_or_else(|| Output::Wait(earlier(self.next_slot, self.monitor.deadline())))
    }

    fn take_observation(&mut self) -> Option<Observation> {
        self.observation.take()
    }

    fn release(&mut self, released: bool) -> Option<Throttle> {
        self.gaps.bridge(released);
        None
    }

    fn gap_at(&self) -> Option<Instant> {
        self.gaps.gap_at()
    }

    fn gap(&mut self) {
        self.gaps.gap();
        // It was meant for the ECU that was received before.
        self.service.cancel(&mut self.outbox);
    }

    fn answers_frames(&self) -> bool {
        false
    }

    fn reply_timeout(&self) -> Option<Duration> {
        // ID 0 commands nothing, and an rpm is sent to an engine that is already in mode 3: both continue.
        None
    }

    fn record(&self) -> LinkRecord {
        self.modes.record()
    }

    fn restore(&mut self, record: LinkRecord) {
        self.modes.restore(record);
    }

    fn may_hold_rpm(&self) -> bool {
        self.modes.given_rpm_x()
    }

    fn close_pump(&mut self) {
        // The command that opens it must not follow.
        self.service.cancel(&mut self.outbox);
        self.pump = PumpClosing::begin();
    }

    fn service_frames(&self) -> ServiceFrames {
        ServiceFrames {
            command: self.service.is_pending(),
            closing_pump: self.pump.is_pending(),
            pump_is_open: self.pump.has_failed(self.status.report.pump),
        }
    }

    fn status(&self) -> &LinkStatus {
        &self.status
    }
}
