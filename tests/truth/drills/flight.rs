//! Drills in flight.

use super::{
    Condition, Director, IDLE, Step, beside, fault, goes_dark, once, resets_apart, silent, stream, throttle,
};
use crate::acts::Act;
use crate::ecus::Odd;
use crate::faults::{Fault, NO_FRAME};
use crate::history::{Cause, Demanded, MS, PilotCommand, SECOND};
use crate::pilots::Rng;
use sim::turbine::EgtSensor;

impl Director {
    pub(super) fn in_flight(&self, rng: &mut Rng) -> (&'static str, Vec<Step>) {
        let traits = self.traits();
        if self.in_a_group && rng.percent(40) {
            // The effect shows at the other engines.
            if rng.percent(20) {
                return ("an engine goes out for good", goes_dark(rng.between(10, 25) * SECOND));
            }
            let length = rng.between(4, 14) * SECOND;
            let wire = rng.pick(&[Fault::FlameOut, Fault::FlameOut, Fault::CutToNode]);
            return ("an engine fails", vec![fault(wire, length), Step::Wait(length + 4 * SECOND)]);
        }
        if self.rules.limit_flame.is_some() && rng.percent(15) {
            // It falls for as long as possible before the ECU sees it.
            let full = [stream(self.main, throttle(1000)), Step::Wait(8 * SECOND)];
            return (
                "the flame goes out at full throttle",
                [full, [fault(Fault::FlameOut, MS), Step::Wait(6 * SECOND)]].concat(),
            );
        }
        if self.rules.limit_flame.is_some() && rng.percent(20) {
            return ("a gap while the shaft slows down", self.gap_in_a_fall(rng));
        }
        if self.in_a_group && rng.percent(15) {
            return ("the share is changed", self.shares(rng));
        }
        if self.rules.limit_jump.is_some() && rng.percent(25) {
            let slow = fault(Fault::OddFrame(Odd::SlowShaft), MS);
            return ("a jump of the speed", vec![slow, slow, Step::Wait(12 * SECOND)]);
        }
        if self.rules.governor && matches!(self.stick, Demanded::Rpm(_)) && rng.percent(20) {
            let reset = Step::Reset(Cause::Watchdog, rng.spread(5 * MS, 100 * MS));
            return ("a governor over a reset", vec![Step::Wait(8 * SECOND), reset, Step::Wait(4 * SECOND)]);
        }
        if self.rules.lower_standby_after > 10 * SECOND && !traits.replies_only && rng.percent(10) {
            return ("a lower source's standby in doubt", self.lower_standby_in_doubt(rng));
        }
        if rng.percent(35) {
            return self.combined(rng);
        }
        match rng.below(106) {
            0..12 => ("a gap", self.gap(rng)),
            12..18 => ("damaged frames", self.damage(rng)),
            18..34 => ("silence", self.silence(rng)),
            34..42 => ("resets", self.resets(rng)),
            42..50 => ("another source", self.another_source(rng)),
            50..56 => ("stray words", self.stray_words(rng)),
            56..62 => ("full throttle", self.full_throttle(rng)),
            62..70 if traits.faults_hide_state => ("error sets", self.error_sets(rng)),
            70..74 if traits.faults_hide_state => ("the flame goes out", goes_out()),
            62..65 => (
                "the ECU is off",
                vec![fault(Fault::PowerOff, rng.spread(30 * MS, 3 * SECOND)), Step::Wait(4 * SECOND)],
            ),
            65..68 => ("the flame goes out", goes_out()),
            68..74 => ("the stick", self.sticks(rng)),
            74..82 => ("a stop", self.stop(rng)),
            82..85 if traits.ctf => ("CTF", self.ctf(rng)),
            82..86 if traits.rounds => {
                // Until the time of a start is over, now and then.
                let start = if rng.percent(60) { 40 * SECOND } else { 0 };
                ("the flame goes out for good", goes_dark(start + rng.between(8, 20) * SECOND))
            }
            82..88 => ("odd frames", self.odd_frames(rng)),
            88..92 => ("the transmitter hangs", self.stall(rng)),
            92..95 => ("present", self.present(rng)),
            95..100 => ("standby over a reset", self.standby_over_a_reset(rng)),
            100 | 101 if self.rules.limit_supply.is_some() => {
                let rare = if traits.supply_every > 0 { 3 * SECOND } else { 0 };
                let length = rare + rng.spread(SECOND, 8 * SECOND);
                ("supply low", vec![fault(Fault::LowSupply, length), Step::Wait(length + 5 * SECOND)])
            }
            100..103 => ("a start while hot", self.start_while_hot(rng)),
            103 => ("another ECU in flight", self.another_ecu_in_flight(rng)),
            _ => ("odd frames", self.odd_frames(rng)),
        }
    }

    /// It is at rest, and its engine is not started by the order for the one before, however short the time without power was.
    fn another_ecu_in_flight(&self, rng: &mut Rng) -> Vec<Step> {
        let off = rng.spread(50 * MS, 20 * SECOND);
        let swap = Step::Act(Act::Swap(rng.between(1, 7) as u8, off));
        vec![swap, Step::Wait(off + self.rules.boot + rng.between(3, 8) * SECOND)]
    }

    fn cut(&self, rng: &mut Rng) -> (Fault, u64) {
        let wire = rng.pick(&[Fault::CutToNode, Fault::CutToNode, Fault::CutBoth, Fault::CutToEcu]);
        let patience = self.rules.gives_up_after;
        let length = match rng.below(4) {
            0 => rng.spread(50 * MS, SECOND),
            1 => patience * rng.between(50, 88) / 100,
            2 => rng.spread(SECOND, 8 * SECOND),
            _ => rng.spread(2 * SECOND, 25 * SECOND),
        };
        // The engine survives most of them.
        (wire, if rng.percent(94) { self.outlived(length) } else { length })
    }

    /// A wire is cut, and meanwhile the stick moves, another source appears, or all fall silent.
    fn gap(&self, rng: &mut Rng) -> Vec<Step> {
        let (wire, length) = self.cut(rng);
        let before = length * rng.between(10, 95) / 100;
        let meanwhile = match rng.below(6) {
            0 | 1 => vec![stream(self.main, self.another(rng))],
            2 => vec![silent(self.main)],
            3 => vec![Step::Reset(Cause::Watchdog, rng.spread(5 * MS, 100 * MS))],
            _ => Vec::new(),
        };
        let after = [Step::Wait(length - before + SECOND)];
        [vec![fault(wire, length), Step::Wait(before)], meanwhile, after.to_vec()].concat()
    }

    fn damage(&self, rng: &mut Rng) -> Vec<Step> {
        let patience = self.rules.gives_up_after;
        let (what, length) = match rng.below(8) {
            0..3 => (Fault::Framing(rng.pick(&[100_000, 500_000])), rng.spread(patience, 9500 * MS)),
            3 => (Fault::Damage(true, false), rng.spread(SECOND, 9500 * MS)),
            4 if rng.percent(50) => (Fault::Framing(NO_FRAME), rng.between(12, 18) * SECOND),
            4 => (Fault::Damage(true, false), rng.between(12, 18) * SECOND),
            5 | 6 => (Fault::Babble, self.outlived(rng.spread(400 * MS, 8 * SECOND))),
            _ if rng.percent(8) => (Fault::Damage(rng.percent(50), true), rng.spread(patience, 10 * SECOND)),
            _ => (Fault::Damage(rng.percent(30), true), patience * rng.between(50, 88) / 100),
        };
        vec![fault(what, length.max(MS)), Step::Wait(length + SECOND)]
    }

    /// The source falls silent: for less than its timeout, for a short gap, or up to each of the stages of loss; and something
    /// happens meanwhile.
    fn silence(&self, rng: &mut Rng) -> Vec<Step> {
        let mut steps = Vec::new();
        if rng.percent(50) {
            // Still rising.
            steps.extend([stream(self.main, throttle(rng.pick(&[0, 200]))), Step::Wait(5 * SECOND)]);
            steps.extend([
                stream(self.main, throttle(rng.pick(&[900, 1000]))),
                Step::Wait(rng.between(100, 1500) * MS),
            ]);
        }
        let last = self.rules.standby_after.unwrap_or(10 * SECOND);
        let all = self.to_ramp_end();
        let length = match rng.below(6) {
            0 => self.age() * rng.between(60, 130) / 100,
            1 => self.age() + self.rules.return_within * rng.between(30, 90) / 100,
            2 => self.age() + self.rules.return_within * rng.between(115, 300) / 100,
            3 | 4 => all + rng.between(1000, 4000) * MS,
            _ => all + last + rng.between(3, 8) * SECOND,
        };
        steps.push(silent(self.main));
        let part = length * rng.between(10, 90) / 100;
        let meanwhile = match rng.below(10) {
            // Until after the last stage of loss.
            0 | 7 if !self.traits().replies_only => {
                let wire = rng.pick(&[Fault::CutToNode, Fault::CutBoth]);
                let length = all + last + rng.between(6, 10) * SECOND;
                vec![fault(wire, length), Step::Wait(length)]
            }
            0 => vec![fault(Fault::CutToNode, self.outlived(rng.spread(200 * MS, 8 * SECOND)))],
            1 | 2 => vec![Step::Reset(
                rng.pick(&[Cause::Watchdog, Cause::Watchdog, Cause::BrownOut, Cause::PowerOn]),
                rng.spread(5 * MS, 300 * MS),
            )],
            3 => resets_apart(rng.between(2, 6), 1100 * MS),
            4 => self.lower(rng).map_or(Vec::new(), |lower| vec![stream(lower, self.another(rng))]),
            5 => self.lower(rng).map_or(Vec::new(), |lower| vec![stream(lower, PilotCommand::Standby)]),
            6 => vec![stream(self.main, PilotCommand::Nothing)],
            _ => Vec::new(),
        };
        let begins = if rng.percent(30) { 300 * MS } else { part };
        steps.push(Step::Wait(begins));
        steps.extend(meanwhile);
        steps.push(Step::Wait(length.saturating_sub(begins)));
        if rng.percent(50) {
            // It returns with a higher demand than before.
            steps.extend([stream(self.main, throttle(1000)), Step::Wait(4 * SECOND)]);
        }
        steps
    }

    fn resets(&self, rng: &mut Rng) -> Vec<Step> {
        let patience = self.rules.gives_up_after;
        let mut steps = Vec::new();
        let cause =
            rng.pick(&[Cause::Watchdog, Cause::Watchdog, Cause::Watchdog, Cause::BrownOut, Cause::PowerOn]);
        for _ in 0..rng.pick(&[1, 1, 1, 2, 4]) {
            let down = rng.spread(5 * MS, patience / 4);
            steps.push(match rng.below(10) {
                0 => Step::AnotherEngine(down),
                1 => Step::OtherSettings(down),
                _ => Step::Reset(cause, down),
            });
            steps.push(Step::Wait(rng.spread(300 * MS, 4 * SECOND)));
            if rng.percent(40) {
                steps.push(stream(self.main, self.another(rng)));
            }
        }
        steps
    }

    /// Another source appears, for a while or permanently; then it or the first one falls silent.
    fn another_source(&self, rng: &mut Rng) -> Vec<Step> {
        let lower = self.lower(rng);
        let Some(other) = self.higher(rng).or(lower).filter(|_| rng.percent(70)).or(lower) else {
            return Vec::new();
        };
        let close = match self.stick {
            Demanded::Throttle(tenths) => throttle(tenths.saturating_sub(30)),
            rpm @ Demanded::Rpm(_) => PilotCommand::Run(rpm),
        };
        let wants = if rng.percent(25) { close } else { self.another(rng) };
        let mut steps = vec![stream(other, wants), Step::Wait(rng.spread(200 * MS, 10 * SECOND))];
        match rng.below(4) {
            0 => steps.extend([silent(self.main), Step::Wait(rng.between(4, 10) * SECOND)]),
            1 => steps.push(Step::Reset(Cause::Watchdog, 20 * MS)),
            2 => steps.extend([stream(other, self.another(rng)), Step::Wait(4 * SECOND)]),
            _ => {}
        }
        steps.extend([silent(other), Step::Wait(rng.between(3, 9) * SECOND)]);
        steps
    }

    /// Commands that shut nothing down, and commands that do.
    fn stray_words(&self, rng: &mut Rng) -> Vec<Step> {
        let other = rng.below(4) as usize;
        match rng.below(7) {
            0 => vec![once(self.main, PilotCommand::Standby), Step::Wait(2 * SECOND)],
            1 => {
                let apart = self.age().max(200 * MS) * rng.between(130, 300) / 100;
                vec![
                    silent(self.main),
                    once(self.main, PilotCommand::Standby),
                    Step::Wait(apart),
                    once(self.main, PilotCommand::Standby),
                ]
            }
            2 => vec![once(other, PilotCommand::Standby), Step::Wait(3 * SECOND)],
            3 => vec![once(other, PilotCommand::ShutDown), silent(self.main), Step::Wait(3 * SECOND)],
            4 => vec![once(other, PilotCommand::Disarm), Step::Wait(2 * SECOND)],
            5 => vec![once(other, self.another(rng)), Step::Wait(3 * SECOND)],
            _ => {
                let Some(lower) = self.lower(rng) else { return Vec::new() };
                let waits = self.to_hold_end() + self.rules.lower_standby_after + 3 * SECOND;
                vec![
                    stream(lower, PilotCommand::Standby),
                    Step::Wait(2 * SECOND),
                    silent(self.main),
                    Step::Wait(waits * rng.between(40, 130) / 100),
                ]
            }
        }
    }

    /// A demand at which a limit is exceeded, then a lower one, and a reset.
    fn full_throttle(&self, rng: &mut Rng) -> Vec<Step> {
        let mut steps = vec![stream(self.main, throttle(1000)), Step::Wait(rng.between(8, 14) * SECOND)];
        match rng.below(3) {
            0 => steps.push(Step::Reset(Cause::Watchdog, 20 * MS)),
            // Long enough to show that it is obeyed below the fail-safe throttle, too.
            1 => steps.extend([stream(self.main, throttle(rng.pick(&[0, 200]))), Step::Wait(12 * SECOND)]),
            _ => {}
        }
        steps.extend([Step::Wait(5 * SECOND), stream(self.main, throttle(800)), Step::Wait(5 * SECOND)]);
        steps
    }

    /// An AMT ECU reports a fault in place of a state, and meanwhile the flame goes out, or not.
    fn error_sets(&self, rng: &mut Rng) -> Vec<Step> {
        let length = rng.spread(SECOND, 30 * SECOND);
        let mut steps = vec![
            beside(Fault::Error(rng.between(1, 18) as u8), length),
            Step::Wait(rng.between(300, 2000) * MS),
        ];
        for _ in 0..rng.between(1, 3) {
            steps.extend(match rng.below(8) {
                0 | 1 => vec![fault(Fault::FlameOut, MS)],
                2 => vec![beside(
                    Fault::Sensor(rng.pick(&[EgtSensor::Open, EgtSensor::Short])),
                    rng.spread(SECOND, 10 * SECOND),
                )],
                3 => vec![stream(self.main, throttle(0))],
                4 => vec![stream(self.main, throttle(1000))],
                5 => vec![Step::Reset(rng.pick(&[Cause::Watchdog, Cause::BrownOut]), 20 * MS)],
                6 => vec![fault(Fault::CutToNode, rng.spread(300 * MS, self.rules.gives_up_after * 8 / 10))],
                _ => vec![silent(self.main)],
            });
            steps.push(Step::Wait(rng.spread(300 * MS, 6 * SECOND)));
        }
        steps.push(Step::Wait(length.min(12 * SECOND)));
        steps
    }

    fn sticks(&self, rng: &mut Rng) -> Vec<Step> {
        if let Demanded::Rpm(_) = self.stick
            && rng.percent(60)
        {
            // Beyond the highest speed: of the ECU, or of the governor.
            let most = if self.rules.governor { 110_000.0 } else { self.rules.max_rpm };
            let beyond = Demanded::Rpm((most * 1.01) as u32);
            return vec![
                stream(self.main, PilotCommand::Run(beyond)),
                Step::Wait(rng.between(8, 14) * SECOND),
            ];
        }
        let moves = (0..rng.between(2, 7)).flat_map(|_| {
            let up = rng.pick(&[0, 200, 500, 1000]);
            [stream(self.main, throttle(up)), Step::Wait(rng.spread(300 * MS, 6 * SECOND))]
        });
        moves.collect()
    }

    /// A stop, what must not release it, and a release.
    fn stop(&self, rng: &mut Rng) -> Vec<Step> {
        let mut steps = Vec::new();
        match rng.below(4) {
            0 => steps.push(fault(Fault::CutToEcu, self.outlived(rng.between(3000, 5000) * MS))),
            1 => steps.push(fault(Fault::CutToNode, self.outlived(rng.between(3000, 6000) * MS))),
            _ => {}
        }
        let by = rng.below(4) as usize;
        steps.extend([Step::Wait(rng.spread(20 * MS, 2500 * MS)), once(by, PilotCommand::Stop)]);
        for _ in 0..rng.between(1, 4) {
            steps.push(Step::Wait(rng.spread(100 * MS, 3 * SECOND)));
            steps.extend(match rng.below(6) {
                0 => vec![once(3, PilotCommand::Release)],
                1 => vec![once(by, PilotCommand::Release)],
                // Its stick is up.
                2 => vec![once(by, throttle(500)), once(by, PilotCommand::Release)],
                3 => vec![stream(self.main, PilotCommand::Standby)],
                4 => vec![
                    Step::Reset(rng.pick(&[Cause::Watchdog, Cause::BrownOut]), 50 * MS),
                    once(self.main, PilotCommand::Arm),
                ],
                _ => vec![stream(self.main, IDLE)],
            });
        }
        steps.push(Step::Wait(2 * SECOND));
        steps
    }

    fn ctf(&self, rng: &mut Rng) -> Vec<Step> {
        vec![
            once(self.main, PilotCommand::Ctf),
            Step::Wait(500 * MS),
            stream(self.main, self.another(rng)),
            Step::Until(Condition::Out, self.rules.gives_up_after + 3 * SECOND),
        ]
    }

    /// Reports of an engine at rest, with true ones between them: they are not consecutive. Or reports that are not enough to end
    /// a life.
    fn odd_frames(&self, rng: &mut Rng) -> Vec<Step> {
        let odd = |odd| fault(Fault::OddFrame(odd), MS);
        match rng.below(10) {
            0 | 1 => {
                let frames = (0..rng.between(1, 4)).flat_map(|_| [odd(Odd::SlowShaft), Step::Wait(30 * MS)]);
                return frames.chain([Step::Wait(3 * SECOND)]).collect();
            }
            // Two consecutive ones: an implausible change.
            2 | 3 => return vec![odd(Odd::SlowShaft), odd(Odd::SlowShaft), Step::Wait(8 * SECOND)],
            4 => return vec![odd(Odd::HotExhaust), Step::Wait(5 * SECOND)],
            // Where two of them shut the engine down.
            6 | 7 if matches!(self.rules.limit_egt, Some((_, true))) => {
                return vec![odd(Odd::HotExhaust), Step::Wait(5 * SECOND)];
            }
            5 if self.traits().versions => {
                let frames =
                    (0..rng.between(2, 4)).flat_map(|_| [odd(Odd::LaterVersion), Step::Wait(30 * MS)]);
                return frames.chain([Step::Wait(5 * SECOND)]).collect();
            }
            _ => {}
        }
        // At most one frame in ten has the state.
        let apart = self.rules.period * if self.traits().rounds { 100 } else { 22 } / 10;
        (0..rng.between(1, 6))
            .flat_map(|_| [fault(Fault::OddFrame(Odd::AtRest), MS), Step::Wait(apart)])
            .collect()
    }

    /// A change of the reduction while another engine has failed, which may be now.
    fn shares(&self, rng: &mut Rng) -> Vec<Step> {
        let changes = (0..rng.between(1, 4)).flat_map(|_| {
            [Step::Act(Act::Share(rng.pick(&[300, 500, 800]))), Step::Wait(rng.between(2, 7) * SECOND)]
        });
        changes.collect()
    }

    /// Standby, and run again as soon as the engine is out; or a service.
    fn start_while_hot(&self, rng: &mut Rng) -> Vec<Step> {
        let next = match !self.traits().services || rng.percent(50) {
            true => stream(self.main, IDLE),
            false => once(self.main, PilotCommand::Service(rng.pick(&[1, 2, 3, 4, 5, 12]))),
        };
        vec![
            stream(self.main, PilotCommand::Standby),
            Step::Until(Condition::Out, 4 * SECOND),
            match rng.percent(50) {
                true => Step::Wait(rng.spread(SECOND, 10 * SECOND)),
                // It may still be too hot.
                false => Step::Until(Condition::InStandby, 100 * SECOND),
            },
            next,
            Step::Wait(3 * SECOND),
            stream(self.main, PilotCommand::Standby),
            Step::Wait(SECOND),
        ]
    }

    fn stall(&self, rng: &mut Rng) -> Vec<Step> {
        // One that costs an engine is a cut.
        let outlived = self.rules.gives_up_after.saturating_sub(450 * MS);
        let longest =
            if self.rules.kind.continues_without_commands() { 6 * SECOND } else { outlived.min(6 * SECOND) };
        let longest = if self.reopens { longest } else { longest.min(self.rules.gives_up_after * 8 / 10) };
        let length = rng.spread(200 * MS, longest);
        vec![
            stream(self.main, throttle(rng.pick(&[0, 200]))),
            Step::Wait(4 * SECOND),
            fault(Fault::Stall, length),
            Step::Wait(length / 2),
            stream(self.main, throttle(1000)),
            Step::Wait(length / 2 + 2 * SECOND),
        ]
    }

    /// The source is present but commands nothing.
    fn present(&self, rng: &mut Rng) -> Vec<Step> {
        let lasts = self.to_ramp_end() + 3 * SECOND;
        vec![stream(self.main, PilotCommand::Nothing), Step::Wait(lasts * rng.between(20, 110) / 100)]
    }

    /// Standby, but the engine keeps running because the wire to its ECU is cut: the node is reset, and must not send run to
    /// the engine that it finds.
    fn standby_over_a_reset(&self, rng: &mut Rng) -> Vec<Step> {
        let length = self.outlived(rng.between(3000, 6000) * MS);
        vec![
            fault(Fault::CutToEcu, length),
            Step::Wait(300 * MS),
            stream(self.main, PilotCommand::Standby),
            Step::Wait(700 * MS),
            silent(self.main),
            Step::Reset(rng.pick(&[Cause::Watchdog, Cause::BrownOut]), 30 * MS),
            Step::Wait(length),
        ]
    }

    /// The shaft slows down, because the stick was lowered, where nothing is received.
    fn gap_in_a_fall(&self, rng: &mut Rng) -> Vec<Step> {
        let length = self.outlived(rng.between(2500, 3800) * MS);
        vec![
            stream(self.main, throttle(1000)),
            Step::Wait(8 * SECOND),
            stream(self.main, throttle(0)),
            Step::Wait(rng.between(1500, 2800) * MS),
            fault(rng.pick(&[Fault::CutToNode, Fault::Damage(true, false)]), length),
            Step::Wait(length + 6 * SECOND),
        ]
    }
}

fn goes_out() -> Vec<Step> {
    vec![fault(Fault::FlameOut, MS), Step::Wait(6 * SECOND)]
}
