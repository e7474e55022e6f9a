//! Turns a run and its shaped demand into the order of the link, and checks whether the ECU obeys it.

use super::data::{Engine, Mode};
use super::shaper::Shape;
use crate::command::{Demand, Order, Ordered, Origin, Rejected};
use crate::event::{Event, LossStage};
use crate::link::Link;
use crate::report::{Phase, REPORT_MAX_AGE, ReportedSwitch};
use crate::units::Throttle;
use embassy_time::Instant;

/// Largest difference between the reported and the ordered throttle, in 0.1 %.
const OBEY_BAND: u16 = 100;
/// A shaft that is faster than an ordered rpm by more than one part in 20 of it does not follow yet: less is not a flame-out (5 %).
const RPM_BAND: u32 = 20;

impl Engine {
    /// Orders the demand after ramps, slew and limits.
    pub(super) fn shape(&mut self, now: Instant) {
        let idle_rpm = self.link.status().report.idle_rpm.map(|idle| idle.value);
        let known = !self.waits_for_version();
        if let Mode::Run(run) = &mut self.mode
            && known
        {
            run.own_speed_control = self.link.speed_control().is_ok();
        }
        let shape = Shape {
            running: matches!(&self.mode, Mode::Run(run) if run.life.reached()),
            // An engine that its ECU lights again is given no more fuel meanwhile (AMT-14).
            living: self.lives() && !matches!(&self.mode, Mode::Run(run) if run.life.lights()),
            transmits: self.transmitter.is_none(),
            received: matches!(&self.mode, Mode::Run(run) if self.sources.has_commanded(run.active_source)),
            idle_rpm,
            max_rpm: self.link.status().report.max_rpm.map(|max| max.value),
            rpm: self.link.status().report.rpm,
            throttle: self.link.status().report.settled_throttle(now),
            sent: match &self.mode {
                Mode::Run(run) => run.demand.sent,
                _ => Demand::Throttle(Throttle::IDLE),
            },
            in_transit: match &self.mode {
                Mode::Run(run) => run.demand.handed_out,
                _ => None,
            },
            reduced_to: self.config.when_other_fails.filter(|_| self.others_failed > 0),
            governed: !matches!(&self.mode, Mode::Run(run) if run.own_speed_control)
                && self.link.speed_control().is_err(),
        };
        let config = self.config;
        // A hand-over has no demand, but may be in doubt.
        let Mode::Run(run) = &mut self.mode else { return self.express(now) };
        let plan = run.plan();
        let (demand, next) = run.shaper.demand(now, plan, &shape, &config);
        run.next = next;
        run.demand.shaped = demand;
        self.express(now);
    }

    /// Gives the link its order: the demand or, while the life of the engine is in doubt, nothing that could start one.
    pub(super) fn express(&mut self, now: Instant) {
        match &self.mode {
            Mode::Run(run) => {
                let origin = if run.stage == LossStage::None { run.active_source } else { Origin::Node };
                let (doubts, demand) =
                    (run.life.in_doubt().is_some() || run.shaper.waits(), run.demand.shaped);
                let open = !doubts || (self.link.answers_frames() && run.life.answers());
                let start = self.link.release(run.life.reached()).map(Demand::Throttle);
                let sent = if open { self.order_demand(now, demand) } else { self.order_doubt(now, demand) };
                // AMT-14: the demand that ends the start throttle is a lower one.
                if let Mode::Run(run) = &mut self.mode {
                    let goes_out = matches!(sent, Order::Run(_));
                    let from = start.unwrap_or(run.demand.sent);
                    run.lowered.observe(now, start.unwrap_or(demand), goes_out, from);
                }
                self.note_order(if doubts { Order::Doubt(demand) } else { sent }, origin);
            }
            Mode::Pwm { life, start_by } => {
                // After a reset only ID 0 is sent: it leaves the PWM input in control without a second hand-over.
                let resumed = start_by.is_none();
                let order = if resumed || life.in_doubt().is_some() { Order::Listen } else { Order::Pwm };
                self.link.release(life.reached());
                let origin = self.ordered.origin;
                self.order(now, order, origin);
            }
            Mode::Listen(_) | Mode::Stop(_) | Mode::Standby => {}
        }
    }

    fn order_demand(&mut self, now: Instant, demand: Demand) -> Order {
        let Err(why) = self.link.order(now, Order::Run(demand)) else { return Order::Run(demand) };
        // An ECU that came back has not reported its version yet: it keeps its rpm until it has.
        if self.waits_for_version() && matches!(&self.mode, Mode::Run(run) if run.life.reached()) {
            return self.order_doubt(now, demand);
        }
        let instead = match why {
            // The maximum may have changed since the demand was clamped.
            Rejected::AboveMaxRpm { max } => Demand::Rpm(max),
            // The ECU's version has no speed control. No link rejects a throttle.
            _ => Demand::Throttle(Throttle::IDLE),
        };
        if let Mode::Run(run) = &mut self.mode {
            run.shaper.replace(now, instead);
            run.demand.shaped = instead;
        }
        let _ = self.link.order(now, Order::Run(instead));
        Order::Run(instead)
    }

    /// Whether the ECU has not reported its version yet, so that it is not known whether it controls an rpm itself.
    pub(super) fn waits_for_version(&self) -> bool {
        matches!(self.link.speed_control(), Err(Rejected::NeedsVersion { known: None, .. }))
    }

    fn order_doubt(&mut self, now: Instant, demand: Demand) -> Order {
        let order = Order::Doubt(demand);
        // No link rejects it.
        let _ = self.link.order(now, order);
        order
    }

    /// Whether the ECU's recent reports match the order. Old reports count as a match.
    pub(super) fn obeys(&self, now: Instant) -> bool {
        let report = &self.link.status().report;
        let switch = report.switch.filter(|switch| switch.age(now) <= REPORT_MAX_AGE);
        let at_rest = self.phase().is_some_and(Phase::is_stopped);
        let switch_obeys = switch.is_none_or(|switch| match (self.ordered.order, switch.value) {
            (Order::Listen | Order::Doubt(_) | Order::Pwm, _) | (_, ReportedSwitch::Unknown(_)) => true,
            // The ECU may end there by itself.
            (Order::EmergencyStop | Order::Standby, _) if at_rest => true,
            (Order::EmergencyStop, switch) => switch == ReportedSwitch::Stop,
            (Order::Standby, switch) => switch != ReportedSwitch::Run,
            (Order::Run(_), switch) => switch == ReportedSwitch::Run,
        });
        let throttle_obeys = self
            .throttles(now)
            .is_none_or(|(ordered, reported)| ordered.tenths().abs_diff(reported.tenths()) <= OBEY_BAND);
        switch_obeys && throttle_obeys
    }

    /// Whether a running ECU reports more than it is ordered: a higher throttle or, where it controls the speed itself, a faster shaft.
    pub(super) fn reports_more(&self, now: Instant) -> bool {
        if let Order::Run(Demand::Rpm(ordered)) = self.ordered.order {
            let report = &self.link.status().report;
            let reported = report.rpm.filter(|rpm| rpm.age(now) <= REPORT_MAX_AGE);
            // It turns no slower than at idle.
            let ordered = report.idle_rpm.map_or(ordered, |idle| ordered.max(idle.value));
            return self.phase() == Some(Phase::Running)
                && reported.is_some_and(|rpm| {
                    rpm.value.get() > ordered.get().saturating_add(ordered.get() / RPM_BAND)
                });
        }
        self.throttles(now)
            .is_some_and(|(ordered, reported)| reported.tenths() > ordered.tenths().saturating_add(OBEY_BAND))
    }

    /// The ordered and the reported throttle of a running engine.
    fn throttles(&self, now: Instant) -> Option<(Throttle, Throttle)> {
        let status = self.link.status();
        let reported = status.report.throttle.filter(|throttle| throttle.age(now) <= REPORT_MAX_AGE)?;
        match self.ordered.order {
            Order::Run(Demand::Throttle(ordered))
                if self.phase() == Some(Phase::Running) && !status.shutting_down =>
            {
                Some((ordered, reported.value))
            }
            _ => None,
        }
    }

    /// Orders a hand-over to the ECU's PWM input.
    ///
    /// # Errors
    /// The ECU's version has none.
    pub(super) fn order_pwm(&mut self, now: Instant) -> Result<(), Rejected> {
        self.link.order(now, Order::Pwm)
    }

    /// Gives an order that no link rejects.
    pub(super) fn order(&mut self, now: Instant, order: Order, origin: Origin) {
        if self.link.order(now, order).is_ok() {
            self.note_order(order, origin);
        }
    }

    /// Stores the order. Reports a change of its kind or origin, not each new throttle.
    pub(super) fn note_order(&mut self, order: Order, origin: Origin) {
        let before = self.ordered;
        self.ordered = Ordered { order, origin };
        let same_kind = core::mem::discriminant(&before.order) == core::mem::discriminant(&order);
        if !same_kind || before.origin != origin {
            self.event(Event::Ordered(self.ordered));
        }
    }
}
