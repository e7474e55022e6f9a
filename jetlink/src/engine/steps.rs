//! The steps from one mode to the next. Only this file changes the mode; the decisions are made in the files that call it.

use super::data::{Beginning, Engine, Mode, RESETS_TO_FAIL_SAFE};
use super::life::{Finding, Life};
use super::origins::Origins;
use super::run::{Carried, Demands, Run};
use super::shaper::{Lowered, Shaper};
use crate::command::{Demand, Order, Origin};
use crate::event::{Event, LossStage};
use crate::link::Link;
use embassy_time::{Duration, Instant};

impl Engine {
    /// Latches an emergency stop. It disarms, and arming again needs a change from disarmed to armed.
    pub(super) fn stop(&mut self, now: Instant, origin: Origin) {
        // The stop belongs to the highest source that commanded it.
        let by = match self.mode {
            Mode::Stop(by) if by.priority() > origin.priority() => by,
            _ => origin,
        };
        self.end();
        self.mode = Mode::Stop(by);
        self.failed = false;
        self.must_disarm.insert_all(self.arm_commanded);
        if core::mem::take(&mut self.armed) {
            self.event(Event::Armed(false, by));
        }
        self.order(now, Order::EmergencyStop, by);
    }

    /// Orders standby.
    #[inline(never)]
    pub(super) fn standby(&mut self, now: Instant, origin: Origin) {
        self.end();
        self.mode = Mode::Standby;
        self.order(now, Order::Standby, origin);
    }

    /// Ends permissions, a waiting start and an open fuel pump: common to stop and standby.
    fn end(&mut self) {
        self.permitted = Origins::NONE;
        self.start_wait = None;
        self.ended_by_loss = false;
        self.link.release(false);
        // A repeated stop is not a new one.
        if matches!(self.mode, Mode::Stop(_)) { self.close_pump() } else { self.close_pump_again() }
    }

    /// Orders a run: a start, or the resumption of a running engine. The next update shapes its demand and sends it.
    pub(super) fn begin(&mut self, now: Instant, demand: Demand, origin: Origin, beginning: Beginning) {
        let life = match beginning {
            Beginning::FromStandby => Life::ordered(),
            Beginning::Found { life, .. } => life,
            Beginning::Reset(ref record) => Life::resumed(now, record),
        };
        let (limited, stage, (silent, all_silent), resumed_low) = match beginning {
            Beginning::Reset(record) => {
                let low = record.resets >= RESETS_TO_FAIL_SAFE;
                let stage = if low { record.loss.max(LossStage::FailSafe) } else { record.loss };
                (record.limited, stage, (record.silent, record.all_silent), low)
            }
            // Another reset continues it.
            Beginning::Found { lost_for, .. } => (false, LossStage::None, (lost_for, lost_for), false),
            _ => (false, LossStage::None, Default::default(), false),
        };
        let fail_safe_at = match stage {
            LossStage::None | LossStage::Hold => None,
            // It began before the reset and does not begin again.
            LossStage::FailSafe | LossStage::Standby => Some(now),
        };
        let fail_safe_at = match beginning {
            // The stages of loss continue from where they were.
            Beginning::Found { lost_for, .. } if lost_for.as_ticks() > 0 => {
                let left = self.config.loss.hold.as_ticks().saturating_sub(lost_for.as_ticks());
                Some(now + Duration::from_ticks(left))
            }
            _ => fail_safe_at,
        };
        let fall_expected = match beginning {
            Beginning::Reset(record) => record.fall_expected,
            Beginning::Found { fall_expected, .. } => fall_expected,
            _ => Duration::from_ticks(0),
        };
        let started = match beginning {
            Beginning::Found { started_before, .. } => started_before,
            _ => Duration::from_ticks(0),
        };
        let source = match &self.mode {
            Mode::Listen(finding) => finding.active_source,
            _ => origin,
        };
        self.mode = Mode::Run(Run {
            began: now,
            life,
            start_by: (!life.reached()).then(|| {
                let left = self.start_time().as_ticks().saturating_sub(started.as_ticks());
                now + Duration::from_ticks(left)
            }),
            active_source: origin,
            demand: Demands::new(demand),
            taking_over: None,
            stream: None,
            fail_safe_at,
            stage,
            carried: Carried { source, started, silent, all_silent },
            resumed: matches!(beginning, Beginning::Reset(_)),
            own_speed_control: self.link.may_hold_rpm(),
            resumed_low,
            limited,
            shaper: Shaper::new(now, demand),
            lowered: if fall_expected.as_ticks() == 0 || self.link.answers_frames() {
                Lowered::new(now, demand, fall_expected)
            } else {
                Lowered::unsent(now, demand, fall_expected)
            },
            next: None,
        });
        self.permitted = Origins::NONE;
        self.start_wait = None;
        self.ended_by_loss = false;
        if matches!(beginning, Beginning::FromStandby) {
            self.last_start = Some(now);
        }
    }

    /// Hands the engine over to the ECU's PWM input. `start_by`: latest time to reach running; none after a reset.
    pub(super) fn hand_over(&mut self, life: Life, start_by: Option<Instant>, origin: Origin) {
        self.mode = Mode::Pwm { life, start_by };
        self.note_order(Order::Pwm, origin);
    }

    /// Ends the order without a stop: until this search has a result, none is in force.
    pub(super) fn listen(&mut self, now: Instant, finding: Finding) {
        self.mode = Mode::Listen(finding);
        self.order(now, Order::Listen, Origin::Node);
    }

    /// Takes over the mode of a record. Nothing is ordered before the link begins.
    pub(super) fn adopt(&mut self, mode: Mode) {
        self.mode = mode;
    }

    /// Permits the next run of this source to start the engine: its standby is in force.
    pub(super) fn permit(&mut self, origin: Origin) {
        if origin != Origin::Node {
            self.permitted.insert(origin);
        }
    }

    /// Uses up the permission of this source, with its start that waits.
    pub(super) fn use_up(&mut self, origin: Origin) {
        self.permitted.remove(origin);
        if self.start_wait.is_some_and(|wait| wait.origin == origin) {
            self.start_wait = None;
        }
    }
}
