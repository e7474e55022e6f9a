//! What survives a reset, and how an engine goes on after one: it listens first, and what the ECU reports decides.

use super::keep::Record;
use super::{Beginning, Engine, Mode, Run};
use crate::command::{Demand, Order, Origin};
use crate::link::Link;
use crate::telemetry::{Event, LossStage, Phase, ReportedSwitch};
use crate::units::Throttle;
use embassy_time::Instant;

impl Engine {
    /// This survived the reset. Before anything is commanded, so that a command which comes before [`Engine::start`]
    /// does not take its place.
    pub fn keep(&mut self, kept: Option<Record>) {
        self.armed = kept.is_some_and(|kept| kept.armed);
        self.failed = kept.is_some_and(|kept| kept.failed);
        self.mode = Mode::listen(kept);
        self.given_to_keep = kept;
    }

    /// Begins, after a reset of whatever kind. Listens first; `kept` is what survived the reset.
    pub fn start(&mut self, now: Instant, kept: Option<Record>) {
        self.link.start(now);
        if matches!(self.mode, Mode::Stop(_)) {
            return;
        }
        if let Some(kept) = kept {
            (self.armed, self.failed) = (kept.armed, kept.failed);
        }
        match kept {
            // A latched stop does not wait.
            Some(Record { order: Order::EmergencyStop, origin, .. }) => self.stop(now, origin),
            kept => {
                self.mode = Mode::listen(kept);
                self.order(now, Order::Listen, Origin::Node);
            }
        }
    }

    /// What shall survive a reset, if it is not what the last call gave.
    pub fn to_keep(&mut self) -> Option<Record> {
        let record = self.record();
        (self.given_to_keep.replace(record) != Some(record)).then_some(record)
    }

    /// What shall survive a reset.
    pub fn record(&self) -> Record {
        let by = self.ordered.origin;
        let kept = match &self.mode {
            Mode::Listen { kept: Some(kept), .. } => *kept,
            Mode::Listen { kept: None, .. } => Record::new(Order::Listen, by),
            Mode::Stop(by) => Record::new(Order::EmergencyStop, *by),
            Mode::Standby => Record::new(Order::Standby, by),
            Mode::Run(run) => {
                let (limited, loss) = (run.limited, run.stage);
                Record { limited, loss, ..Record::new(self.run_to_keep(run), run.ruler) }
            }
            Mode::Pwm => Record::new(Order::Pwm, by),
        };
        Record { armed: self.armed, failed: self.failed, ..kept }
    }

    fn run_to_keep(&self, run: &Run) -> Order {
        if self.link.shutting_down() {
            // A reset ends the service command, not the shutdown.
            return Order::Standby;
        }
        let ordered = self.ordered.order;
        // Where the source is lost or a limit was passed, what is left of its demand: a reset must not bring the rest
        // back. A demand that has not come to pass, because the engine does not run yet, by a slew, or because another
        // source takes over, is none to jump to.
        let behind = matches!(ordered, Order::Run(now) if now.is_below(run.demand));
        if run.stage != LossStage::None || run.limited || behind { ordered } else { Order::Run(run.demand) }
    }

    /// After a reset: goes on with an engine that runs, and orders standby where none does.
    pub(super) fn listen(&mut self, now: Instant) {
        let Mode::Listen { kept, until, stands } = &mut self.mode else { return };
        let Some(heard) = self.link.heard() else { return };
        let until = *until.get_or_insert(heard + self.config.listen);
        let kept = *kept;
        let phase = self.link.report().phase;
        // One report that it stands, perhaps of a damaged frame, is not enough: a second one has to agree.
        let standing = phase.filter(|phase| !phase.value.is_alive() && phase.value != Phase::Unknown);
        let stands = match standing {
            Some(phase) => *stands.get_or_insert(phase.at) != phase.at,
            None => {
                *stands = None;
                false
            }
        };
        if self.link.report().powered_up.is_some() {
            // An ECU that has just been powered up runs nothing.
            self.standby(now, Origin::Node);
            return;
        }
        // An AMT ECU with a fault sends, and does not say what its engine does. What was kept is all there is.
        let only_faults = self.link.report().faults.is_some_and(|faults| !faults.value.is_empty());
        match phase.map(|phase| phase.value) {
            // A ZK ECU says what it does before it says what it obeys.
            Some(phase) if phase.is_alive() && now < until && !self.knows_enough(now, kept) => {}
            Some(phase) if phase.is_alive() => self.go_on(now, kept),
            // The document has no name for it: whatever was in force stays in force, and if nothing was, standby.
            Some(Phase::Unknown) if kept.is_some_and(|kept| matches!(kept.order, Order::Run(_))) => {
                self.go_on(now, kept);
            }
            Some(_) if standing.is_none() || stands => self.standby(now, Origin::Node),
            Some(_) => {}
            None if (now >= until || only_faults)
                && kept.is_some_and(|kept| matches!(kept.order, Order::Run(_))) =>
            {
                self.go_on(now, kept);
            }
            None if now >= until => self.standby(now, Origin::Node),
            None => {}
        }
    }

    /// Whether the ECU has said what it takes to go on as before.
    fn knows_enough(&self, now: Instant, kept: Option<Record>) -> bool {
        match kept.map(|kept| kept.order) {
            Some(Order::Run(Demand::Rpm(_))) if self.config.governor.is_none() => {
                self.link.speed_control().is_ok()
            }
            Some(Order::Run(demand)) => self.can(now, demand).is_ok(),
            Some(Order::Standby | Order::Pwm) => true,
            _ => self.link.report().throttle.is_some(),
        }
    }

    fn go_on(&mut self, now: Instant, kept: Option<Record>) {
        let report = self.link.report();
        let reported = report.throttle.map_or(Throttle::IDLE, |throttle| throttle.value);
        let Record { order, origin, limited, loss, .. } = match kept {
            Some(kept @ Record { order: Order::Run(_) | Order::Standby | Order::Pwm, .. }) => kept,
            // Nothing was kept: what the ECU obeys is what was commanded. By whom is not known, so it is nobody's, and
            // the stages of loss begin.
            _ => match report.switch.map(|switch| switch.value) {
                Some(ReportedSwitch::Run) | None => {
                    Record::new(Order::Run(Demand::Throttle(reported)), Origin::Node)
                }
                Some(_) => Record::new(Order::Standby, Origin::Node),
            },
        };
        match order {
            Order::Run(demand) => {
                let demand = if self.can(now, demand).is_ok() { demand } else { Demand::Throttle(reported) };
                self.sources.resume(now, origin, demand, loss != LossStage::None);
                self.begin(now, demand, origin, Beginning::GoingOn { limited, loss });
                self.event(Event::WentOn(demand));
                if loss != LossStage::None {
                    self.event(Event::SourceLoss(loss));
                }
            }
            Order::Pwm if self.link.order(now, Order::Pwm).is_ok() => {
                self.mode = Mode::Pwm;
                self.note_order(Order::Pwm, origin);
            }
            _ => self.standby(now, Origin::Node),
        }
    }
}
