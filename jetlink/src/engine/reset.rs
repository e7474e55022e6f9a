//! How an engine resumes after a reset.
//!
//! If the record has a run in force, the run resumes with its life in doubt: nothing is sent that could start an engine
//! until two reports confirm that it runs. Otherwise no order is in force, and the reports of the ECU decide.

use super::data::{Beginning, Engine, Mode, OpenPump, RESETS_TO_FAIL_SAFE};
use super::life::{Finding, Life};
use super::origins::Origins;
use super::record::RESET_TAKES;
use super::retained::RetainedState;
use super::sources::Restored;
use crate::command::{Demand, Order, Origin};
use crate::event::{Event, LossStage};
use crate::link::Link;
use embassy_time::Instant;

impl Engine {
    /// Restores the state that survived a reset. Call it before any command, so that it does not replace what is commanded before
    /// [`Engine::start`]. After that it does nothing.
    pub fn restore(&mut self, retained: Option<RetainedState>) {
        let Some(retained) = retained.filter(|_| !self.begun) else { return };
        (self.armed, self.failed) = (retained.armed, retained.failed);
        self.arm_commanded = Origins::from_bits(retained.arm_commanded);
        self.must_disarm = Origins::from_bits(retained.must_disarm);
        // This reset is counted until a source is received.
        self.resets = retained.resets.saturating_add(1);
        self.last_retained = retained.packed();
        self.retained = Some(retained);
        self.link.restore(retained.link);
        if retained.egt_distrusted {
            self.exhaust.distrust();
        }
        let now = self.at;
        match retained.order {
            Order::EmergencyStop => {
                self.armed = false;
                self.adopt(Mode::Stop(retained.origin));
            }
            Order::Standby => self.adopt(Mode::Standby),
            _ => self.adopt(Mode::Listen(Self::search(now, &retained))),
        }
        if retained.pump_open {
            let origin = Origin::Node;
            self.pump = Some(OpenPump { origin, last_rx: now, until: now });
        }
    }

    /// Begins after any kind of reset, with what [`Engine::restore`] restored. Once: a second runner of the same engine finds it as
    /// the first one left it, and no run comes into doubt.
    pub fn start(&mut self, now: Instant) {
        if self.begun {
            return;
        }
        self.link.start(now);
        self.touch();
        (self.begun, self.started) = (true, now);
        self.at = self.at.max(now);
        let retained = self.retained.take();
        self.close_pump();
        match self.mode {
            // Commanded before the runner began, or restored.
            Mode::Stop(by) => self.order(now, Order::EmergencyStop, by),
            Mode::Standby => self.order(now, Order::Standby, Origin::Node),
            _ => self.resume(now, retained),
        }
    }

    fn resume(&mut self, now: Instant, retained: Option<RetainedState>) {
        let finding = retained.as_ref().map(|retained| Self::search(now, retained));
        self.listen(now, finding.unwrap_or(Finding::new(now, false)));
        let Some(retained) = retained else { return };
        match retained.order {
            Order::Run(demand) if retained.ran => {
                let silent = retained.silent + RESET_TAKES;
                let all_silent = retained.all_silent + RESET_TAKES;
                let low = self.resets >= RESETS_TO_FAIL_SAFE;
                let lost = retained.loss >= LossStage::FailSafe
                    || low && silent >= self.config.timeouts.of(retained.origin);
                // A ramp that only moves between resets might never end. An rpm is at idle in the fail-safe stage.
                let demand = match demand {
                    Demand::Throttle(throttle) if low => {
                        Demand::Throttle(throttle.min(self.config.loss.throttle))
                    }
                    demand => demand,
                };
                let restored = Restored { demand, was_lost: lost, silent, steady: retained.steady };
                self.sources.resume(now, retained.origin, restored);
                let unconfirmed = retained.unconfirmed + RESET_TAKES;
                let resets = self.resets;
                let record = RetainedState { silent, all_silent, unconfirmed, resets, ..retained };
                self.begin(now, demand, retained.origin, Beginning::Reset(record));
                self.update(now);
                if retained.loss != LossStage::None {
                    self.event(Event::SourceLoss(retained.loss));
                }
            }
            Order::Pwm => {
                let life = Life::handed_over(now, retained.ran);
                self.hand_over(life, None, retained.origin);
                self.express(now);
            }
            _ => {}
        }
    }
}
