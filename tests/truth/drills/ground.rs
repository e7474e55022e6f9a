//! Drills of an engine at rest, and in a start.

use super::{
    Condition, Director, IDLE, OPEN_PUMP, Step, beside, fault, first_after_a_loss, once, silent, stream,
    throttle,
};
use crate::acts::Act;
use crate::ecus::Odd;
use crate::faults::Fault;
use crate::history::{Cause, Demanded, MS, PilotCommand, SECOND, START_WAIT_MAX};
use crate::pilots::Rng;
use sim::turbine::EgtSensor;

/// Engines of a node that start together do so at multiples of this time.
const TOGETHER: u64 = 40 * SECOND;
/// Exhaust temperature, in °C, down to which an ECU cools its engine before it reports standby.
const HOT_STANDBY: f64 = sim::turbine::COOL_EGT;

impl Director {
    /// Drills with a ready engine, before its start.
    pub(super) fn at_rest(&self, rng: &mut Rng) -> (&'static str, Vec<Step>) {
        let sends_by_itself = self.rules.kind.sends_unprompted();
        if rng.percent(6) {
            return ("false reports of a running engine after a loss of power", self.false_reports(rng));
        }
        match (rng.below(18), self.traits().services) {
            (10..13, true) if sends_by_itself => ("the pump, and nothing beside it", self.pump_alone(rng)),
            (10..14, _) if self.rules.supply_counts || self.rules.limit_supply.is_some() => {
                ("a start with a low supply", self.low_supply(rng))
            }
            (10..18, _) => ("a start after a loss of power", self.start_after_a_loss_of_power(rng)),
            (0..3, true) if self.rules.egt_max < HOT_STANDBY => {
                ("services into a hot engine", self.hot_services(rng))
            }
            (0..4, true) => ("the pump", self.pump(rng)),
            (4, true) => ("services", self.services(rng)),
            (5, true) if rng.percent(50) => ("PWM without a permission", self.pwm_without(rng)),
            (5, true) => ("PWM", self.pwm(rng)),
            (6, _) => ("another ECU", self.another_ecu(rng)),
            (0..4, false) => ("a start that is refused", self.refused(rng)),
            (4, false) => ("a start that fails", self.fails(rng)),
            (5 | 7, _) => ("a start right after a gap", self.after_a_gap(rng)),
            (8, _) => ("a start that is refused", self.refused(rng)),
            _ => ("stop, arm, release", self.stop_and_release(rng)),
        }
    }

    /// Its own standby again, with an unchanged engine.
    fn again(&self) -> Vec<Step> {
        let others = (0..4).filter(|source| *source != self.main).map(silent);
        let standby = [
            stream(self.main, PilotCommand::Standby),
            Step::Until(Condition::Out, 2 * SECOND),
            Step::Until(Condition::Ready, 60 * SECOND),
            once(self.main, PilotCommand::Arm),
            Step::Wait(1500 * MS),
        ];
        others.chain(standby).collect()
    }

    fn pump(&self, rng: &mut Rng) -> Vec<Step> {
        let mut steps = vec![once(self.main, OPEN_PUMP), Step::Wait(rng.spread(300 * MS, 5 * SECOND))];
        if rng.percent(25) {
            // Longer than it may be held open.
            steps.extend((0..45).flat_map(|_| [once(self.main, OPEN_PUMP), Step::Wait(SECOND)]));
        }
        steps.extend(match rng.below(8) {
            0 => vec![once(self.main, PilotCommand::Stop)],
            1 => vec![once(self.main, PilotCommand::Disarm)],
            2 => vec![silent(self.main), Step::Wait(self.rules.ages[self.main] + 4 * SECOND)],
            3 => vec![
                silent(self.main),
                Step::Reset(rng.pick(&[Cause::Watchdog, Cause::BrownOut]), 50 * MS),
                Step::Wait(4 * SECOND),
            ],
            4 => vec![
                fault(Fault::CutToEcu, rng.spread(60 * MS, 900 * MS)),
                once(self.main, PilotCommand::Disarm),
            ],
            5 => vec![stream(self.main, IDLE)],
            6 => vec![stream(self.main, PilotCommand::Nothing), Step::Wait(4 * SECOND)],
            _ => vec![once(3, PilotCommand::Stop), Step::Wait(400 * MS), once(0, PilotCommand::Stop)],
        });
        steps.extend([Step::Wait(5 * SECOND), once(0, PilotCommand::Release)]);
        [steps, self.again()].concat()
    }

    /// The source streams nothing that would close the pump.
    fn pump_alone(&self, rng: &mut Rng) -> Vec<Step> {
        let begins = [silent(self.main), once(self.main, OPEN_PUMP), Step::Wait(rng.between(100, 250) * MS)];
        let mut steps = begins.to_vec();
        steps.extend(match rng.below(16) {
            0 => vec![once(rng.below(4) as usize, PilotCommand::Stop)],
            1 => vec![once(rng.below(4) as usize, PilotCommand::Disarm)],
            2 => vec![Step::Wait(self.rules.ages[self.main] + self.rules.hold + 4 * SECOND)],
            3 | 4 => vec![
                Step::Reset(rng.pick(&[Cause::Watchdog, Cause::BrownOut]), 50 * MS),
                Step::Wait(4 * SECOND),
            ],
            5 => vec![stream(self.main, PilotCommand::Nothing), Step::Wait(self.rules.hold + 4 * SECOND)],
            6 => vec![stream(self.main, IDLE), Step::Wait(3 * SECOND)],
            7 => vec![
                fault(rng.pick(&[Fault::CutToEcu, Fault::Stall]), rng.spread(60 * MS, 900 * MS)),
                once(self.main, PilotCommand::Disarm),
            ],
            // Its source still commands, so that nothing else closes it.
            11 | 12 => vec![
                stream(self.main, OPEN_PUMP),
                Step::Wait(300 * MS),
                once(rng.below(4) as usize, PilotCommand::Disarm),
                Step::Wait(4 * SECOND),
            ],
            // None of the frames that would close it goes out.
            13 | 14 => vec![
                fault(Fault::Stall, rng.between(2000, 5000) * MS),
                Step::Wait(100 * MS),
                once(rng.below(4) as usize, PilotCommand::Disarm),
                Step::Wait(8 * SECOND),
            ],
            // Nothing is received of it, before and after.
            8 => vec![
                fault(Fault::CutToNode, 8 * SECOND),
                Step::Reset(rng.pick(&[Cause::Watchdog, Cause::BrownOut]), 50 * MS),
                Step::Wait(8 * SECOND),
            ],
            // Repeatedly, for longer than it may be held open.
            _ => vec![stream(self.main, OPEN_PUMP), Step::Wait(self.rules.pump_bound + 5 * SECOND)],
        });
        steps.extend([Step::Wait(4 * SECOND), once(0, PilotCommand::Release)]);
        [steps, self.again()].concat()
    }

    /// Its ECU reports standby, and it is too hot for any of them.
    fn hot_services(&self, rng: &mut Rng) -> Vec<Step> {
        let service = PilotCommand::Service(rng.pick(&[1, 2, 3, 4, 5, 12]));
        let again = [once(self.main, service), Step::Wait(200 * MS)].repeat(15);
        let flies = [
            stream(self.main, IDLE),
            Step::Until(Condition::Starts, 4 * SECOND),
            Step::Until(Condition::Ends, 40 * SECOND),
            Step::Wait(4 * SECOND),
            stream(self.main, PilotCommand::Standby),
            Step::Until(Condition::Out, 4 * SECOND),
            Step::Until(Condition::InStandby, 100 * SECOND),
        ];
        [flies.to_vec(), again, vec![Step::Wait(4 * SECOND)], self.again()].concat()
    }

    /// A node without memory, and two reports of a running engine with a shaft at rest: no engine is found by them.
    fn false_reports(&self, rng: &mut Rng) -> Vec<Step> {
        let reports = first_after_a_loss(rng.between(700, 1500) * MS, Odd::RunsAtRest);
        [vec![silent(self.main)], reports, vec![Step::Wait(5 * SECOND)], self.again()].concat()
    }

    fn low_supply(&self, rng: &mut Rng) -> Vec<Step> {
        // Until it is reported.
        let rare = if self.traits().supply_every > 0 { 2 * SECOND } else { 0 };
        let length = rare + rng.between(3, 8) * SECOND;
        let steps = vec![
            fault(Fault::LowSupply, length),
            Step::Wait(rare + rng.between(1500, 3000) * MS),
            stream(self.main, IDLE),
            Step::Wait(length + SECOND),
        ];
        [steps, self.again()].concat()
    }

    /// Nothing is left of the arming, or of the retained state of another engine's node.
    fn start_after_a_loss_of_power(&self, rng: &mut Rng) -> Vec<Step> {
        let reset = match rng.below(3) {
            0 => Step::AnotherEngine(50 * MS),
            _ => Step::Reset(rng.pick(&[Cause::BrownOut, Cause::PowerOn]), 50 * MS),
        };
        let steps = vec![
            reset,
            Step::Wait(rng.between(1800, 4000) * MS),
            stream(self.main, IDLE),
            Step::Wait(3 * SECOND),
        ];
        [steps, self.again()].concat()
    }

    fn services(&self, rng: &mut Rng) -> Vec<Step> {
        let number = PilotCommand::Service(rng.pick(&[1, 2, 3, 4, 5, 12]));
        let by = rng.below(4) as usize;
        let steps = match rng.below(4) {
            0 => vec![
                fault(Fault::CutToNode, rng.spread(200 * MS, 2 * SECOND)),
                Step::Wait(rng.spread(20 * MS, 2500 * MS)),
                once(self.main, number),
            ],
            1 => vec![once(by, number)],
            2 => vec![once(self.main, PilotCommand::Disarm), Step::Wait(300 * MS), once(self.main, number)],
            _ => vec![
                once(self.main, number),
                Step::Wait(rng.spread(10 * MS, 200 * MS)),
                stream(self.main, IDLE),
            ],
        };
        [steps, vec![Step::Wait(5 * SECOND)], self.again()].concat()
    }

    fn pwm(&self, rng: &mut Rng) -> Vec<Step> {
        let mut steps = vec![
            beside(Fault::PwmSignal(rng.percent(80)), rng.between(10, 40) * SECOND),
            silent(self.main),
            once(self.main, PilotCommand::Standby),
            once(self.main, PilotCommand::Pwm),
            Step::Wait(rng.spread(300 * MS, 14 * SECOND)),
        ];
        steps.extend(match rng.below(4) {
            0 => vec![
                Step::Until(Condition::Ends, 20 * SECOND),
                Step::Wait(rng.spread(10 * MS, 2 * SECOND)),
                Step::Reset(Cause::Watchdog, 30 * MS),
            ],
            1 => vec![fault(Fault::PowerOff, rng.spread(300 * MS, 3 * SECOND))],
            2 => vec![once(rng.below(4) as usize, PilotCommand::Stop), Step::Wait(SECOND)],
            _ => Vec::new(),
        });
        steps.extend([
            Step::Wait(3 * SECOND),
            stream(self.main, PilotCommand::Standby),
            Step::Wait(3 * SECOND),
        ]);
        [steps, vec![once(0, PilotCommand::Release)], self.again()].concat()
    }

    /// The standby of the source was used, or was taken back, or was used by a hand-over that is over.
    fn pwm_without(&self, rng: &mut Rng) -> Vec<Step> {
        let other = rng.below(4) as usize;
        let standby = once(self.main, PilotCommand::Standby);
        let hand_over = once(self.main, PilotCommand::Pwm);
        let (disarm, arm) = (once(self.main, PilotCommand::Disarm), once(self.main, PilotCommand::Arm));
        let soon = Step::Wait(rng.between(20, 150) * MS);
        let mut steps = vec![beside(Fault::PwmSignal(true), rng.between(5, 15) * SECOND), silent(self.main)];
        steps.extend(match rng.below(6) {
            // A refused hand-over uses it.
            0 => vec![disarm, soon, standby, hand_over, soon, arm, stream(self.main, IDLE)],
            1 => vec![disarm, soon, standby, hand_over, soon, arm, soon, hand_over],
            // So does a refused run.
            2 => vec![standby, soon, once(self.main, throttle(300)), soon, hand_over],
            3 => vec![standby, disarm, arm, soon, hand_over],
            4 => vec![
                once(other, IDLE),
                Step::Wait(50 * MS),
                standby,
                once(other, PilotCommand::Standby),
                soon,
                hand_over,
            ],
            // It ends by a gap before its engine turns.
            _ => vec![
                standby,
                hand_over,
                Step::Wait(rng.between(60, 200) * MS),
                fault(Fault::CutToNode, (6 * self.rules.period).max(200 * MS)),
                Step::Wait((7 * self.rules.period).max(250 * MS)),
                // Until the link is stable again, if the source is not lost by then.
                Step::Wait(if self.age() > 1800 * MS { 1150 * MS } else { 0 }),
                if rng.percent(50) { hand_over } else { once(self.main, IDLE) },
            ],
        });
        steps.extend([
            Step::Wait(4 * SECOND),
            stream(self.main, PilotCommand::Standby),
            Step::Wait(3 * SECOND),
        ]);
        [steps, self.again()].concat()
    }

    fn refused(&self, rng: &mut Rng) -> Vec<Step> {
        let mut steps = match rng.below(4) {
            0 => vec![stream(self.main, throttle(rng.pick(&[50, 300])))],
            1 => vec![once(self.main, PilotCommand::Disarm), Step::Wait(200 * MS), stream(self.main, IDLE)],
            2 => vec![
                beside(Fault::Error(rng.between(1, 18) as u8), rng.between(2, 5) * SECOND),
                Step::Wait(1500 * MS),
                stream(self.main, IDLE),
            ],
            // Its last command was run.
            _ => vec![
                stream(self.main, IDLE),
                Step::Wait(300 * MS),
                once(rng.below(4) as usize, PilotCommand::ShutDown),
            ],
        };
        steps.extend([
            Step::Wait(2 * SECOND),
            once(self.main, PilotCommand::Arm),
            stream(self.main, IDLE),
            Step::Wait(4 * SECOND),
        ]);
        [steps, self.again()].concat()
    }

    fn fails(&self, rng: &mut Rng) -> Vec<Step> {
        let mut steps = match rng.below(3) {
            0 => vec![fault(Fault::HotStarts(true), MS)],
            _ => vec![fault(Fault::NoLight(true), MS)],
        };
        steps.extend([stream(self.main, IDLE), Step::Wait(rng.between(12, 25) * SECOND)]);
        steps.extend([fault(Fault::HotStarts(false), MS), fault(Fault::NoLight(false), MS)]);
        [steps, self.again()].concat()
    }

    fn after_a_gap(&self, rng: &mut Rng) -> Vec<Step> {
        let length = rng.spread(300 * MS, 4 * SECOND);
        let what = rng.pick(&[Fault::CutToNode, Fault::CutBoth, Fault::PowerOff]);
        vec![
            fault(what, length),
            Step::Wait(length + rng.between(100, 900) * MS),
            stream(self.main, IDLE),
            Step::Wait(3 * SECOND),
        ]
    }

    fn stop_and_release(&self, rng: &mut Rng) -> Vec<Step> {
        let by = rng.below(4) as usize;
        let mut steps = vec![once(by, PilotCommand::Stop), Step::Wait(500 * MS)];
        if rng.percent(60) {
            steps.push(Step::Reset(rng.pick(&[Cause::Watchdog, Cause::Watchdog, Cause::BrownOut]), 50 * MS));
            steps.push(Step::Wait(2 * SECOND));
        }
        if rng.percent(60) {
            steps.push(once(self.main, PilotCommand::Arm));
        }
        let releases = if rng.percent(70) { by } else { rng.below(4) as usize };
        steps.extend([once(releases, PilotCommand::Release), Step::Wait(500 * MS)]);
        if rng.percent(60) {
            steps.push(once(self.main, PilotCommand::Arm));
        }
        steps.extend([Step::Wait(1500 * MS), stream(self.main, IDLE), Step::Wait(3 * SECOND)]);
        steps.extend([once(0, PilotCommand::Release), once(0, PilotCommand::Disarm)]);
        [steps, self.again()].concat()
    }

    fn another_ecu(&self, rng: &mut Rng) -> Vec<Step> {
        let off = rng.spread(300 * MS, 5 * SECOND);
        let swap = Step::Act(Act::Swap(rng.between(1, 7) as u8, off));
        [vec![swap, Step::Wait(off + rng.spread(200 * MS, 6 * SECOND))], self.again()].concat()
    }

    /// At the same instant as the others of the node: all but one have to wait, and something happens meanwhile.
    fn start_together(&self, rng: &mut Rng, runs: Vec<Step>) -> Vec<Step> {
        let begin =
            vec![Step::Next(TOGETHER), stream(self.main, IDLE), Step::Wait(rng.spread(100 * MS, 6 * SECOND))];
        if self.rules.start_gap > START_WAIT_MAX {
            return [begin, vec![Step::Wait(self.rules.start_gap + 10 * SECOND)], runs].concat();
        }
        let other = rng.below(4) as usize;
        let steps = match rng.below(13) {
            0 => vec![once(other, PilotCommand::Disarm)],
            1 => vec![beside(Fault::Error(rng.between(1, 18) as u8), rng.between(8, 20) * SECOND)],
            2 => vec![stream(self.main, throttle(rng.pick(&[50, 400])))],
            3 => vec![silent(self.main), Step::Wait(rng.between(2, 12) * SECOND)],
            4 => vec![once(other, IDLE), once(other, PilotCommand::Standby)],
            5 => vec![fault(Fault::CutToNode, rng.spread(200 * MS, 3 * SECOND))],
            6 => vec![beside(
                Fault::Sensor(rng.pick(&[EgtSensor::Open, EgtSensor::Short])),
                rng.between(8, 20) * SECOND,
            )],
            7 => vec![fault(Fault::Damage(true, false), rng.between(4000, 9500) * MS)],
            8 | 9 => self.higher(rng).map_or(Vec::new(), |higher| {
                // Long enough to be in control.
                let lasts = self.rules.recover_after + self.rules.takeover + SECOND;
                vec![stream(higher, IDLE), Step::Wait(lasts), silent(higher)]
            }),
            _ => Vec::new(),
        };
        [begin, steps, vec![Step::Wait(12 * SECOND)], runs].concat()
    }

    /// A start, and what happens in it.
    pub(super) fn start(&mut self, rng: &mut Rng) -> (&'static str, Vec<Step>) {
        self.stick = Demanded::Throttle(0);
        let runs = vec![Step::Until(Condition::Ends, 40 * SECOND), Step::Wait(2 * SECOND)];
        let begin = vec![
            stream(self.main, IDLE),
            Step::Until(Condition::Starts, 6 * SECOND),
            Step::Wait(rng.spread(300 * MS, 7 * SECOND)),
        ];
        let other = rng.below(4) as usize;
        if self.in_a_group && rng.percent(40) {
            return ("two engines start together", self.start_together(rng, runs));
        }
        if rng.percent(15) {
            let (name, steps) = self.unlucky_start(rng);
            return (name, [steps, runs].concat());
        }
        let (name, steps) = match rng.below(20) {
            0 => ("disarm in a start", vec![once(other, PilotCommand::Disarm), Step::Wait(3 * SECOND)]),
            1 => ("silence in a start", vec![silent(self.main), Step::Wait(rng.between(2, 25) * SECOND)]),
            2 => (
                "a reset in a start",
                vec![
                    Step::Reset(rng.pick(&[Cause::Watchdog, Cause::Watchdog, Cause::BrownOut]), 30 * MS),
                    Step::Wait(SECOND),
                    stream(self.main, throttle(500)),
                ],
            ),
            3 => (
                "a gap in a start",
                vec![fault(
                    rng.pick(&[Fault::CutToNode, Fault::CutBoth, Fault::CutToEcu]),
                    rng.spread(100 * MS, 5 * SECOND),
                )],
            ),
            4 => ("a dip in a start", vec![fault(Fault::PowerOff, rng.spread(50 * MS, 3 * SECOND))]),
            5 | 6 => {
                ("the stick is up in a start", vec![stream(self.main, throttle(rng.pick(&[400, 1000])))])
            }
            7 => ("a person ends a start", vec![once(other, PilotCommand::ShutDown), Step::Wait(3 * SECOND)]),
            8 => (
                "damaged frames in a start",
                vec![fault(Fault::Framing(rng.pick(&[200_000, 500_000])), rng.spread(SECOND, 8 * SECOND))],
            ),
            9 => (
                "a fault in a start",
                vec![beside(Fault::Error(rng.between(1, 18) as u8), rng.spread(500 * MS, 8 * SECOND))],
            ),
            10 => ("the flame goes out in a start", vec![fault(Fault::FlameOut, MS)]),
            11 => ("standby in a start", vec![once(other, PilotCommand::Standby), Step::Wait(SECOND)]),
            _ => ("a start", Vec::new()),
        };
        (name, [begin, steps, runs].concat())
    }

    /// As a start, it gets no demand before it runs, and a disarm ends it.
    fn reset_late_in_a_start(&self, rng: &mut Rng) -> Vec<Step> {
        let meanwhile = match rng.percent(50) {
            true => stream(self.main, throttle(800)),
            false => once(rng.below(4) as usize, PilotCommand::Disarm),
        };
        vec![
            stream(self.main, IDLE),
            Step::Until(Condition::Starts, 6 * SECOND),
            Step::Until(Condition::Turns, 14 * SECOND),
            Step::Reset(Cause::Watchdog, 20 * MS),
            Step::Wait(200 * MS),
            meanwhile,
            Step::Wait(6 * SECOND),
        ]
    }

    /// The node learns too late, or not at all, what becomes of a start.
    fn unlucky_start(&self, rng: &mut Rng) -> (&'static str, Vec<Step>) {
        let begin = stream(self.main, IDLE);
        if self.traits().replies_only && rng.percent(40) {
            return ("a reset late in a start", self.reset_late_in_a_start(rng));
        }
        match rng.below(4) {
            0 => {
                let short = rng.between(20, 120) * MS;
                let dips = (0..4).flat_map(|_| {
                    [
                        Step::Until(Condition::Starts, 6 * SECOND),
                        Step::Wait(rng.spread(20 * MS, 700 * MS)),
                        fault(Fault::PowerOff, short),
                        Step::Wait(short + 50 * MS),
                    ]
                });
                ("a dip at each ignition", [vec![begin], dips.collect()].concat())
            }
            1 => (
                // Cooling is the first that it reports.
                "the flame goes out in a start behind damage",
                vec![
                    Step::Wait(SECOND),
                    fault(Fault::Damage(true, false), rng.between(2000, 2900) * MS),
                    begin,
                    Step::Until(Condition::Starts, 2500 * MS),
                    Step::Wait(rng.between(100, 1500) * MS),
                    fault(Fault::FlameOut, MS),
                    Step::Wait(4 * SECOND),
                ],
            ),
            2 => (
                "silence in a start that does not light",
                vec![
                    fault(Fault::NoLight(true), MS),
                    begin,
                    Step::Wait(SECOND),
                    if rng.percent(50) {
                        silent(self.main)
                    } else {
                        stream(self.main, PilotCommand::Nothing)
                    },
                    Step::Wait(rng.between(12, 25) * SECOND),
                    fault(Fault::NoLight(false), MS),
                ],
            ),
            // Its last run is forgotten, and its standby is a change: it takes the other source's permission.
            _ => {
                let other = rng.below(4) as usize;
                let steps = vec![
                    begin,
                    Step::Wait(rng.between(2, 6) * SECOND),
                    stream(self.main, throttle(100)),
                    Step::Wait(300 * MS),
                    silent(self.main),
                    once(other, PilotCommand::ShutDown),
                    once(other, PilotCommand::Standby),
                    Step::Wait(rng.between(10, 60) * MS),
                    once(self.main, PilotCommand::Standby),
                    Step::Until(Condition::Out, 4 * SECOND),
                    Step::Until(Condition::Ready, 60 * SECOND),
                    Step::Wait(SECOND),
                    stream(other, IDLE),
                    Step::Wait(4 * SECOND),
                    silent(other),
                ];
                ("another source starts without a standby since", [steps, self.again()].concat())
            }
        }
    }
}
