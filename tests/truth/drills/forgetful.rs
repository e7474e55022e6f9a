//! Drills in flight of a node that is reset, and receives little before it has to act.

use super::{Director, Step, fault, first_after_a_loss, once, resets_apart, silent, stream, throttle};
use crate::ecus::Odd;
use crate::faults::{Fault, NO_FRAME};
use crate::history::{Cause, Demanded, MS, PilotCommand, SECOND};
use crate::pilots::Rng;

impl Director {
    pub(super) fn forgetful(&self, rng: &mut Rng) -> (&'static str, Vec<Step>) {
        match (rng.below(6), self.traits().replies_only) {
            (0, true) => ("a slow shaft after a loss of power", self.slow_after_a_loss(rng)),
            (0, false) => ("standby after a reset, unheard", self.unheard_standby(rng)),
            (1, true) => ("damaged sets behind a gap", self.damage_behind_a_gap(rng)),
            (1, false) => ("a reset loop", self.loops(rng)),
            (2, _) => ("resets in quick succession", self.quick_resets(rng)),
            (3, _) => ("a doubt long after the last stage", self.late_doubt(rng)),
            (4, _) => ("a slow source shuts down", self.slow_source(rng)),
            _ => ("a reset while a source waits", self.waits_over_a_reset(rng)),
        }
    }

    /// Two reports of a running engine with a shaft at rest: no engine is found by them.
    fn slow_after_a_loss(&self, rng: &mut Rng) -> Vec<Step> {
        let length = self.outlived(rng.between(700, 1200) * MS);
        [first_after_a_loss(length, Odd::SlowShaft), vec![Step::Wait(3 * SECOND)]].concat()
    }

    /// The node is reset, and nothing is received of the ECU since: standby has to reach it in whichever way it takes a switch.
    fn unheard_standby(&self, rng: &mut Rng) -> Vec<Step> {
        let cause = rng.pick(&[Cause::Watchdog, Cause::BrownOut]);
        let ends = if rng.percent(70) {
            stream(self.main, PilotCommand::Standby)
        } else {
            once(self.main, PilotCommand::Stop)
        };
        vec![
            fault(Fault::CutToNode, 18 * SECOND),
            Step::Reset(cause, 20 * MS),
            Step::Wait(rng.spread(300 * MS, 2 * SECOND)),
            ends,
            Step::Wait(15 * SECOND),
        ]
    }

    fn damage_behind_a_gap(&self, rng: &mut Rng) -> Vec<Step> {
        let length = rng.between(500, 900) * MS;
        let damaged = self.rules.gives_up_after.saturating_sub(length) * 6 / 10;
        vec![
            fault(Fault::CutToNode, length),
            Step::Wait(length),
            fault(Fault::Framing(NO_FRAME), damaged.min(2 * SECOND)),
            Step::Wait(4 * SECOND),
        ]
    }

    /// Too short to find anything out, and all sources are silent.
    fn loops(&self, rng: &mut Rng) -> Vec<Step> {
        let runs = rng.spread(20 * MS, 200 * MS);
        let count = 14 * SECOND / (runs + 100 * MS);
        let begins = vec![stream(self.main, throttle(1000)), Step::Wait(4 * SECOND), silent(self.main)];
        [begins, resets_apart(count, runs)].concat()
    }

    /// The third of them without a source, and those after it, bring the fail-safe at once.
    fn quick_resets(&self, rng: &mut Rng) -> Vec<Step> {
        let runs = rng.between(150, 350) * MS;
        let resets = resets_apart(rng.between(4, 5), runs);
        let begins = vec![stream(self.main, throttle(1000)), Step::Wait(6 * SECOND), silent(self.main)];
        [begins, resets, vec![Step::Wait(3 * SECOND)]].concat()
    }

    /// At the fail-safe throttle for a while, with all sources silent: a doubt has time to be confirmed.
    fn late_doubt(&self, rng: &mut Rng) -> Vec<Step> {
        let stages = self.to_ramp_end();
        let doubt = match rng.below(3) {
            0 => fault(Fault::OddFrame(Odd::AtRest), MS),
            1 => fault(Fault::CutToNode, (4 * self.rules.period).max(200 * MS)),
            _ => Step::Reset(Cause::Watchdog, 20 * MS),
        };
        vec![
            silent(self.main),
            Step::Wait(stages + rng.between(11, 14) * SECOND),
            doubt,
            Step::Wait(4 * SECOND),
        ]
    }

    /// Two of its standbys, further apart than its timeout, are within two of its own periods.
    fn slow_source(&self, rng: &mut Rng) -> Vec<Step> {
        let period = self.age() * rng.between(75, 90) / 100;
        let flies = [once(self.main, self.flies()), Step::Wait(period)].repeat(6);
        let standby = once(self.main, PilotCommand::Standby);
        let ends = [standby, Step::Wait(2 * period - 20 * MS), standby, Step::Wait(3 * SECOND)];
        [vec![silent(self.main)], flies, ends.to_vec()].concat()
    }

    /// A higher source has to wait until it takes over: it is in control after a reset.
    fn waits_over_a_reset(&self, rng: &mut Rng) -> Vec<Step> {
        let (Some(higher), Demanded::Throttle(_)) = (self.higher(rng), self.stick) else {
            return Vec::new();
        };
        vec![
            stream(self.main, throttle(800)),
            Step::Wait(4 * SECOND),
            stream(higher, throttle(200)),
            Step::Wait(rng.between(200, 1200) * MS),
            Step::Reset(Cause::Watchdog, 20 * MS),
            Step::Wait(5 * SECOND),
            silent(higher),
            Step::Wait(4 * SECOND),
        ]
    }
}
