//! What the sources command.

use super::super::rng::Rng;
use super::rig::{MS, Program, Rig, SECOND, now, throttle_tenths};
use jetlink::channel::Owner;
use jetlink::command::{Command, Demand, Origin, Rejected};
use jetlink::units::Rpm;

impl Rig {
    /// A demand, sometimes a senseless one.
    pub(super) fn demand(&self, rng: &mut Rng) -> Demand {
        let rpm = self.holds_rpm && rng.percent(40) || rng.percent(5);
        if rpm {
            let most = if rng.percent(10) { self.max_rpm * 2 } else { self.max_rpm };
            return Demand::Rpm(Rpm::new(rng.below(most.into()) as u32 / 10 * 10));
        }
        throttle_tenths(if rng.percent(15) { 0 } else { rng.below(1001) })
    }

    pub(super) fn command_all(&mut self, rng: &mut Rng, owner: &Owner<'_>) {
        let now = now();
        if now >= self.next_stop {
            self.next_stop = now + rng.wait(400 * SECOND);
            let origin = rng.pick(&Origin::SOURCES);
            let _ = self.command(owner, origin, Command::EmergencyStop);
            if rng.percent(30) {
                let _ = self.command(owner, origin, Command::ReleaseStop);
            }
        }
        if now >= self.next_arm {
            self.next_arm = now + rng.wait(5 * SECOND);
            let origin = rng.pick(&Origin::SOURCES);
            let command = if rng.percent(90) { Command::Arm } else { Command::Disarm };
            let answer = self.command(owner, origin, command);
            if answer == Err(Rejected::DisarmFirst) && rng.percent(70) {
                let _ = self.command(owner, origin, Command::Disarm);
                let _ = self.command(owner, origin, Command::Arm);
            }
            if rng.percent(50) {
                let origin = rng.pick(&Origin::SOURCES);
                let _ = self.command(owner, origin, Command::ReleaseStop);
            }
        }
        if now >= self.next_silence {
            self.silent_until = now + rng.wait(12 * SECOND);
            self.next_silence = self.silent_until + rng.wait(120 * SECOND);
        }
        for index in 0..self.sources.len() {
            if now >= self.sources[index].changes {
                let program = self.program(rng, index);
                let source = &mut self.sources[index];
                let long = matches!(program, Program::Fly(_)) || program == Program::Run(throttle_tenths(0));
                let mean = if long { 60 } else { 12 };
                source.changes = now + rng.wait(mean * SECOND);
                source.program = program;
                source.period = rng.pick(&[50, 100, 100, 200]) * MS;
                source.next = now + rng.below(100 * MS);
                source.on_since = now;
            }
            if now >= self.sources[index].next {
                if now >= self.silent_until {
                    self.receive(rng, owner, index, now);
                }
                let source = &mut self.sources[index];
                source.next = now + source.period + rng.below(source.period / 5);
            }
        }
    }

    pub(super) fn program(&self, rng: &mut Rng, index: usize) -> Program {
        let demand = self.demand(rng);
        // The higher a source, the more often it is silent.
        let silent = [88, 60, 45, 25][index];
        if rng.percent(silent) {
            return Program::Silent;
        }
        match rng.below(100) {
            0..8 => Program::Run(throttle_tenths(0)),
            8..55 => Program::Fly(demand),
            55..75 => Program::Run(demand),
            75..87 => Program::Flap(demand, rng.between(100, 3000) * MS, rng.between(200, 3000) * MS),
            87..95 => Program::Nonsense,
            95..97 => Program::Present,
            _ => Program::Standby,
        }
    }

    pub(super) fn receive(&mut self, rng: &mut Rng, owner: &Owner<'_>, index: usize, now: u64) {
        let truth = self.truth;
        let source = &mut self.sources[index];
        let command = match source.program {
            Program::Silent => return,
            Program::Standby => Command::Standby,
            Program::Present => Command::Present,
            Program::Run(demand) => Command::Run(demand),
            Program::Flap(demand, on, off) => {
                if (now - source.on_since) % (on + off) >= on {
                    return;
                }
                Command::Run(demand)
            }
            Program::Fly(demand) => {
                if truth.running && rng.percent(2) {
                    // Another throttle now and then.
                    let demand = self.demand(rng);
                    self.sources[index].program = Program::Fly(demand);
                    Command::Run(demand)
                } else if truth.running {
                    Command::Run(demand)
                } else if truth.live || source.ready_since.is_some_and(|since| now > since + 1_500 * MS) {
                    if !truth.live && !truth.standby {
                        source.ready_since = None;
                    }
                    // Not forever, if the engine does not start.
                    if source.ready_since.is_some_and(|since| now > since + 4 * SECOND) && !truth.live {
                        source.ready_since = None;
                    }
                    Command::Run(throttle_tenths(0))
                } else {
                    if truth.standby {
                        source.ready_since.get_or_insert(now);
                    }
                    Command::Standby
                }
            }
            Program::Nonsense => match rng.below(13) {
                0 => Command::ReleaseStop,
                1 => Command::Arm,
                4 => Command::Present,
                5 if rng.percent(5) => Command::ShutDown,
                2 if rng.percent(5) => Command::EmergencyStop,
                3 if rng.percent(20) => Command::Standby,
                _ => {
                    source.period = rng.between(20, 900) * MS;
                    Command::Run(self.demand(rng))
                }
            },
        };
        let origin = self.sources[index].origin;
        let _ = self.command(owner, origin, command);
    }
}
