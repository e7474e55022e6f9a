//! Drills of AMT engines whose state, or whose speed, does not show what becomes of them.

use super::{Director, Step, beside, fault, stream, throttle};
use crate::ecus::{self, Odd};
use crate::faults::Fault;
use crate::history::{Cause, MS, SECOND};
use crate::pilots::Rng;
use sim::turbine::EgtSensor;

impl Director {
    /// An ECU that reports a fault in place of a state, so that only the exhaust shows what becomes of its engine: with a thermocouple that
    /// fails, or a flame that goes out, or a stick that moves.
    pub(super) fn exhaust(&self, rng: &mut Rng) -> Vec<Step> {
        let kind = self.rules.kind;
        let fault_of =
            |own: bool| (1..8).find(|fault| ecus::disowns_exhaust(kind, *fault) == own).unwrap_or(1);
        let error = |own, seconds: u64| beside(Fault::Error(fault_of(own)), seconds * SECOND);
        let sensor = |sensor, ms: u64| beside(Fault::Sensor(sensor), ms * MS);
        let broken = rng.pick(&[EgtSensor::Open, EgtSensor::Short]);
        let a_while = Step::Wait(rng.between(1000, 2000) * MS);
        let reset = Step::Reset(Cause::Watchdog, rng.spread(20 * MS, 150 * MS));
        let rest = Step::Wait(6 * SECOND);
        match rng.below(14) {
            // The ECU says itself that it is wrong.
            0 => vec![error(true, 8), a_while, sensor(EgtSensor::Cold, 6000), reset, rest],
            which @ (1 | 4) => {
                let length = self.outlived(rng.between(900, 2500) * MS);
                vec![error(which == 1, 8), a_while, fault(Fault::CutToNode, length), Step::Wait(length), rest]
            }
            2 => vec![error(false, 8), a_while, sensor(EgtSensor::Cold, 2500), rest],
            3 => {
                vec![
                    error(false, 8),
                    a_while,
                    sensor(broken, 700),
                    Step::Wait(700 * MS),
                    sensor(EgtSensor::Cold, 2500),
                    rest,
                ]
            }
            5 => vec![error(false, 8), a_while, reset, rest],
            6 => vec![error(false, 10), sensor(broken, 8000), a_while, reset, rest, rest],
            7 => vec![
                stream(self.main, throttle(200)),
                Step::Wait(4 * SECOND),
                error(false, 15),
                a_while,
                fault(Fault::FlameOut, MS),
                Step::Wait(rng.between(800, 2600) * MS),
                stream(self.main, throttle(1000)),
                rest,
            ],
            8 => {
                let begins = vec![
                    stream(self.main, throttle(1000)),
                    Step::Wait(6 * SECOND),
                    error(false, 50),
                    a_while,
                ];
                let lower = (1..10)
                    .flat_map(|n| [stream(self.main, throttle(1000 - n * 80)), Step::Wait(4 * SECOND)]);
                [begins, vec![fault(Fault::FlameOut, MS)], lower.collect()].concat()
            }
            // A lower demand explains a colder exhaust, over a reset too.
            9 => vec![
                stream(self.main, throttle(1000)),
                Step::Wait(8 * SECOND),
                error(false, 12),
                a_while,
                stream(self.main, throttle(0)),
                Step::Wait(rng.spread(200 * MS, 2 * SECOND)),
                reset,
                rest,
            ],
            // Its faults clear again and again, while it reports another state than running.
            10..13 => {
                (0..6).flat_map(|_| [error(false, 1), Step::Wait(rng.between(2000, 4000) * MS)]).collect()
            }
            _ => vec![error(false, 30), a_while, fault(Fault::FlameOut, MS), Step::Wait(15 * SECOND)],
        }
    }

    /// The first reports after a gap are of a running engine with a shaft at rest: they confirm nothing.
    pub(super) fn slow_behind_a_gap(&self, rng: &mut Rng) -> Vec<Step> {
        let length = self.outlived(rng.between(500, 1500) * MS);
        let slow = fault(Fault::OddFrame(Odd::SlowShaft), MS);
        vec![fault(Fault::CutToNode, length), Step::Wait(length), slow, slow, Step::Wait(3 * SECOND)]
    }
}
