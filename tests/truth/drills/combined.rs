//! Drills in flight in which one fault occurs within another.

use super::{Condition, Director, Step, beside, fault, once, resets_apart, silent, stream, throttle};
use crate::ecus::Odd;
use crate::faults::Fault;
use crate::history::{Cause, MS, PilotCommand, SECOND};
use crate::pilots::Rng;
use sim::turbine::EgtSensor;

impl Director {
    pub(super) fn combined(&self, rng: &mut Rng) -> (&'static str, Vec<Step>) {
        if self.traits().faults_hide_state && rng.percent(35) {
            return ("error sets, and the exhaust", self.exhaust(rng));
        }
        if rng.percent(25) {
            return self.forgetful(rng);
        }
        match (rng.below(24), self.traits().replies_only) {
            (0..3, true) | (14, false) => ("the ECU or the flame goes out in a gap", self.out_in_a_gap(rng)),
            (16, true) => ("a slow shaft behind a gap", self.slow_behind_a_gap(rng)),
            (3..5, true) => ("CTF and a reset", self.ctf_and_a_reset(rng)),
            (5..7, true) => ("an order that is given up", self.given_up(rng)),
            (0..4, false) => ("a stop right after a power-on", self.stop_after_a_power_on(rng)),
            (4..7, false) => ("damage to the ECU", self.damage_to_the_ecu(rng)),
            (7..10, _) => ("at rest, a gap, at rest", self.at_rest_around_a_gap(rng)),
            (10..13, _) => ("a cut and a reset in a silence", self.cut_and_reset_in_a_silence(rng)),
            (13..15, _) => ("a lower source's standby, and a reset", self.lower_standby(rng)),
            (15..18, _) => ("resets while a lost source is back", self.resets_of_a_lost_source(rng)),
            (20..24, true) => ("error sets, a gap and a reset", self.gap_and_reset_in_error_sets(rng)),
            (20..24, false) => ("nothing received in a silence", self.unreceived_in_a_silence(rng)),
            _ => ("the transmitter hangs, and a reset", self.stall_and_reset(rng)),
        }
    }

    /// The cut hides the event, and the report of an ECU that is powered up.
    fn out_in_a_gap(&self, rng: &mut Rng) -> Vec<Step> {
        let length = self.outlived(rng.between(900, 6000) * MS);
        let out = match rng.below(3) {
            0 => fault(Fault::FlameOut, MS),
            _ => beside(Fault::PowerOff, rng.spread(30 * MS, 300 * MS)),
        };
        let wire = rng.pick(&[Fault::CutToNode, Fault::CutBoth]);
        vec![
            fault(wire, length),
            Step::Wait(rng.spread(20 * MS, 200 * MS)),
            out,
            Step::Wait(length + 4 * SECOND),
        ]
    }

    fn ctf_and_a_reset(&self, rng: &mut Rng) -> Vec<Step> {
        vec![
            once(self.main, PilotCommand::Ctf),
            Step::Wait(rng.between(150, 600) * MS),
            Step::Reset(Cause::Watchdog, 30 * MS),
            stream(self.main, self.another(rng)),
            Step::Until(Condition::Out, self.rules.gives_up_after + 3 * SECOND),
        ]
    }

    /// The order is given up in a gap, and the engine is then as before, in another state, or has faults.
    fn given_up(&self, rng: &mut Rng) -> Vec<Step> {
        let length = self.outlived(self.rules.serial_delay + rng.between(300, 3000) * MS);
        let before_its_end = rng.between(50, 400) * MS;
        let returns = match rng.below(5) {
            0 => vec![fault(Fault::FlameOut, MS)],
            1 => vec![beside(Fault::PowerOff, rng.spread(30 * MS, 300 * MS))],
            2 => vec![beside(Fault::Error(rng.between(1, 18) as u8), rng.spread(SECOND, 5 * SECOND))],
            3 => vec![silent(self.main)],
            _ => Vec::new(),
        };
        let cut = [fault(Fault::CutToNode, length), Step::Wait(length.saturating_sub(before_its_end))];
        [cut.to_vec(), returns, vec![Step::Wait(before_its_end + 5 * SECOND)]].concat()
    }

    /// The node, or the ECU, has only just begun, and does not know of the other one.
    fn stop_after_a_power_on(&self, rng: &mut Rng) -> Vec<Step> {
        let by = rng.below(4) as usize;
        let off = rng.spread(300 * MS, 2 * SECOND);
        let begins = match rng.below(4) {
            0 => vec![fault(Fault::PowerOff, off), Step::Wait(off + self.rules.boot)],
            1 => vec![Step::Reset(Cause::BrownOut, 30 * MS)],
            _ => vec![Step::Reset(Cause::PowerOn, 30 * MS)],
        };
        let stop = [Step::Wait(rng.spread(5 * MS, 300 * MS)), once(by, PilotCommand::Stop)];
        [begins, stop.to_vec(), vec![Step::Wait(4 * SECOND)]].concat()
    }

    /// Longer than an ECU of an early version waits, if this is a later one.
    fn damage_to_the_ecu(&self, rng: &mut Rng) -> Vec<Step> {
        let length = self.outlived(rng.spread(900 * MS, 9500 * MS));
        let meanwhile = match rng.below(3) {
            0 => stream(self.main, PilotCommand::Standby),
            1 => once(rng.below(4) as usize, PilotCommand::ShutDown),
            _ => stream(self.main, self.another(rng)),
        };
        vec![
            fault(Fault::Damage(false, true), length),
            Step::Wait(length * rng.between(10, 90) / 100),
            meanwhile,
            Step::Wait(length + SECOND),
        ]
    }

    /// A report of an engine at rest right before a gap, and one right after it, neither sent by the ECU: they are not
    /// consecutive. With an order, or without one after a loss of power.
    fn at_rest_around_a_gap(&self, rng: &mut Rng) -> Vec<Step> {
        let period = self.rules.period;
        let forgets = rng.percent(40);
        // A node that has forgotten the rate of the ECU expects the lowest one.
        let length = match forgets {
            true => period.max(50 * MS) * rng.between(5, 8),
            false => period * rng.between(5, 12),
        };
        let length = self.outlived(length);
        let begins = if forgets { vec![Step::Reset(Cause::PowerOn, 20 * MS)] } else { Vec::new() };
        let steps = vec![
            fault(Fault::OddFrame(Odd::AtRest), MS),
            Step::Wait(period * rng.between(20, if forgets { 60 } else { 110 }) / 100),
            fault(Fault::CutToNode, length),
            Step::Wait(length),
            fault(Fault::OddFrame(Odd::AtRest), MS),
            Step::Wait(3 * SECOND),
        ];
        [begins, steps].concat()
    }

    /// Until all stages of loss are over, and the node has lost the order.
    fn unreceived_in_a_silence(&self, rng: &mut Rng) -> Vec<Step> {
        let rules = &self.rules;
        let age = rules.ages.into_iter().max().unwrap_or_default();
        let stages = rules.listen + age + rules.hold + rules.standby_after.unwrap_or(10 * SECOND);
        let before = rng.between(1, 10) * SECOND;
        let after = stages + rng.between(5, 8) * SECOND;
        vec![
            silent(self.main),
            fault(Fault::CutToNode, before + after),
            Step::Wait(before),
            Step::Reset(rng.pick(&[Cause::BrownOut, Cause::BrownOut, Cause::PowerOn]), 30 * MS),
            Step::Wait(after),
        ]
    }

    /// The exhaust of an AMT engine cannot be read, its ECU reports a fault, and frames are missing before the reset.
    fn gap_and_reset_in_error_sets(&self, rng: &mut Rng) -> Vec<Step> {
        let length = self.outlived(rng.between(900, 2500) * MS);
        let lasts = length + rng.between(4, 7) * SECOND;
        let sensor = Fault::Sensor(rng.pick(&[EgtSensor::Open, EgtSensor::Short]));
        vec![
            beside(Fault::Error(rng.between(1, 18) as u8), lasts),
            beside(sensor, lasts),
            Step::Wait(rng.between(1000, 2000) * MS),
            fault(Fault::CutToNode, length),
            Step::Wait(length * rng.between(65, 95) / 100),
            Step::Reset(Cause::Watchdog, 20 * MS),
            Step::Wait(lasts),
        ]
    }

    fn cut_and_reset_in_a_silence(&self, rng: &mut Rng) -> Vec<Step> {
        let last = self.rules.standby_after.unwrap_or(10 * SECOND);
        let all = self.to_ramp_end();
        let cut = match self.traits().serial_delay {
            true => self.rules.serial_delay + rng.between(300, 2500) * MS,
            false => rng.spread(300 * MS, 6 * SECOND),
        };
        let cut = self.outlived(cut);
        let resets = (0..rng.pick(&[1, 1, 2, 4])).flat_map(|_| {
            let cause = rng.pick(&[Cause::Watchdog, Cause::Watchdog, Cause::BrownOut]);
            [Step::Reset(cause, 30 * MS), Step::Wait(rng.spread(300 * MS, 2 * SECOND))]
        });
        let resets: Vec<Step> = resets.collect();
        if rng.percent(30) {
            let reset = Step::Reset(Cause::Watchdog, 20 * MS);
            return vec![
                silent(self.main),
                Step::Wait(rng.spread(100 * MS, SECOND)),
                reset,
                Step::Wait(rng.between(600, 1500) * MS),
                fault(Fault::CutToNode, cut),
                Step::Wait(cut + all + last + 4 * SECOND),
            ];
        }
        let begins = vec![
            silent(self.main),
            Step::Wait(rng.spread(100 * MS, 3 * SECOND)),
            fault(Fault::CutToNode, cut),
            Step::Wait(cut * rng.between(20, 120) / 100),
        ];
        [begins, resets, vec![Step::Wait(all + last + 4 * SECOND)]].concat()
    }

    /// It waits below the source that flies, which is away for a moment: with an order that is given up, or after a reset.
    fn lower_standby(&self, rng: &mut Rng) -> Vec<Step> {
        let Some(lower) = self.lower(rng) else { return Vec::new() };
        let cut = self.outlived(self.rules.serial_delay + rng.between(300, 1500) * MS);
        let gap = vec![
            silent(self.main),
            fault(Fault::CutToNode, cut),
            Step::Wait(cut + rng.between(500, 3000) * MS),
            stream(self.main, self.flies()),
        ];
        let cause = rng.pick(&[Cause::Watchdog, Cause::Watchdog, Cause::BrownOut, Cause::PowerOn]);
        let reset = vec![
            silent(self.main),
            Step::Reset(cause, 20 * MS),
            Step::Wait(rng.between(100, 700) * MS),
            stream(self.main, self.flies()),
        ];
        if self.main < 2 && rng.percent(40) {
            // The lowest one takes the engine over that is found, before the one that flies is received.
            let away = rng.pick(&[50, 150, 300, 400, 1000, 1700, 2500]) * MS;
            return vec![
                stream(3, self.flies()),
                stream(2, PilotCommand::Standby),
                Step::Wait(2 * SECOND),
                silent(self.main),
                Step::Reset(rng.pick(&[Cause::BrownOut, Cause::PowerOn]), 20 * MS),
                Step::Wait(away),
                stream(self.main, self.flies()),
                Step::Wait(4 * SECOND),
            ];
        }
        let both = if self.traits().serial_delay && rng.percent(50) { gap } else { reset };
        let begins = vec![stream(lower, PilotCommand::Standby), Step::Wait(2 * SECOND)];
        [begins, both, vec![Step::Wait(4 * SECOND)]].concat()
    }

    /// In doubt, for longer than all sources may be silent: one below is not.
    pub(super) fn lower_standby_in_doubt(&self, rng: &mut Rng) -> Vec<Step> {
        let Some(lower) = self.lower(rng) else { return Vec::new() };
        let lasts = self.to_ramp_end() + rng.between(13, 20) * SECOND;
        vec![
            stream(lower, PilotCommand::Standby),
            Step::Wait(2 * SECOND),
            silent(self.main),
            fault(Fault::CutToNode, lasts),
            Step::Wait(lasts + 2 * SECOND),
        ]
    }

    /// It was lost, and has to command for a while before it is in control: the node is reset repeatedly before that, or just before it
    /// commands again.
    fn resets_of_a_lost_source(&self, rng: &mut Rng) -> Vec<Step> {
        let last = self.rules.standby_after.unwrap_or(10 * SECOND);
        let runs = rng.between(420, 720) * MS;
        // An AMT engine does not outlive many of them.
        let most = if self.traits().serial_delay { 8 } else { 24 };
        let count = ((last + 4 * SECOND) / (runs + 80 * MS)).min(most);
        let resets = resets_apart(count, runs);
        // Those that standby ends if it does not get back in control take the resets.
        let once = self.rules.standby_after.is_none() && rng.percent(60);
        let lost = rng.spread(300 * MS, if once { 3 * SECOND } else { SECOND });
        let lost = vec![silent(self.main), Step::Wait(self.to_hold_end() + lost)];
        let back = stream(self.main, self.flies());
        let rest = match once {
            // It is received again only after the reset.
            true => vec![
                Step::Reset(Cause::Watchdog, 20 * MS),
                Step::Wait(rng.between(10, 500) * MS),
                back,
                Step::Wait(2 * SECOND),
            ],
            false => [vec![back], resets].concat(),
        };
        [lost, rest, vec![Step::Wait(3 * SECOND)]].concat()
    }

    /// A demand that no frame has carried was never in force.
    fn stall_and_reset(&self, rng: &mut Rng) -> Vec<Step> {
        if rng.percent(50) {
            // The stick moves right before the reset.
            return vec![
                stream(self.main, throttle(rng.pick(&[0, 200]))),
                Step::Wait(4 * SECOND),
                stream(self.main, throttle(1000)),
                Step::Wait(rng.spread(MS, self.rules.period)),
                Step::Reset(Cause::Watchdog, 20 * MS),
                Step::Wait(4 * SECOND),
            ];
        }
        let length = self.rules.gives_up_after * rng.between(50, 75) / 100;
        vec![
            stream(self.main, throttle(rng.pick(&[0, 200]))),
            Step::Wait(4 * SECOND),
            fault(Fault::Stall, length),
            Step::Wait(length / 4),
            stream(self.main, throttle(1000)),
            Step::Wait(length * rng.between(10, 50) / 100),
            Step::Reset(Cause::Watchdog, 20 * MS),
            Step::Wait(4 * SECOND),
        ]
    }
}
