//! Who commands an engine, as far as the commands alone show it.

use crate::history::{Cause, Commanded, Demanded, Frame, History, MS, PilotCommand, Reset, SECOND, Switch};

/// The commands of each source by which it counts as received, in the order of time.
#[derive(Clone, Debug)]
pub struct CommandLog {
    commands: [Vec<(u64, PilotCommand)>; 4],
    ages: [u64; 4],
    /// The commands of each source that came after a gap.
    gaps: [Vec<u64>; 4],
    /// When the node began, after each reset.
    ups: Vec<u64>,
    /// When the engine was armed, and when it was disarmed.
    armed: Vec<(u64, bool)>,
    /// The same, where a brown-out does not clear which source has to command disarmed first.
    surely_armed: Vec<(u64, bool)>,
}

impl CommandLog {
    pub fn new(h: &History) -> Self {
        let mut commands: [Vec<(u64, PilotCommand)>; 4] = Default::default();
        // A speed that the ECU cannot hold, because another ECU was plugged in, is refused: to the node its source is silent.
        let refused = |commanded: &Commanded| {
            let slow = h.traits().versions && h.version(commanded.at) < 4 && !h.rules.governor;
            slow && commanded.command.is_rpm()
        };
        for commanded in h.commanded.iter().filter(|commanded| !refused(commanded)) {
            if commanded.command.is_received() || commanded.command == PilotCommand::Nothing {
                commands[commanded.source].push((commanded.at, commanded.command));
            }
        }
        let mut gaps: [Vec<u64>; 4] = Default::default();
        for (source, commands) in commands.iter().enumerate() {
            let mut before = None;
            for &(at, _) in commands {
                if before.replace(at).is_none_or(|before| at >= before + h.rules.ages[source]) {
                    gaps[source].push(at);
                }
            }
        }
        Self {
            commands,
            ages: h.rules.ages,
            gaps,
            ups: h.resets.iter().map(|reset| reset.up).collect(),
            armed: armed(h, true),
            surely_armed: armed(h, false),
        }
    }

    /// The commands of a source up to an instant.
    pub fn until(&self, source: usize, at: u64) -> &[(u64, PilotCommand)] {
        let commands = &self.commands[source];
        &commands[..commands.partition_point(|(when, _)| *when <= at)]
    }

    /// The last commands of a source that command run or standby.
    pub fn orders(&self, source: usize, at: u64) -> Vec<(u64, PilotCommand)> {
        let order = |command: &&(u64, PilotCommand)| {
            matches!(
                command.1,
                PilotCommand::Standby | PilotCommand::ShutDown | PilotCommand::Run(_) | PilotCommand::Stop
            )
        };
        let mut last: Vec<_> = self.until(source, at).iter().rev().filter(order).take(3).copied().collect();
        last.reverse();
        last
    }

    pub const fn age(&self, source: usize) -> u64 {
        self.ages[source]
    }

    pub fn last(&self, source: usize, at: u64) -> Option<(u64, PilotCommand)> {
        self.until(source, at).last().copied()
    }

    /// The last command of a source, if it is not too old.
    pub fn fresh(&self, source: usize, at: u64) -> Option<PilotCommand> {
        self.last(source, at).filter(|(when, _)| at < when + self.age(source)).map(|(_, command)| command)
    }

    /// Since when a source has commanded without a gap beyond its timeout, if it is fresh.
    pub fn commands_since(&self, source: usize, at: u64) -> Option<u64> {
        self.fresh(source, at)?;
        let gaps = &self.gaps[source];
        gaps[..gaps.partition_point(|after| *after <= at)].last().copied()
    }

    /// Whether a source has commanded without such a gap since then.
    pub fn commands_throughout(&self, source: usize, since: u64, at: u64) -> bool {
        self.commands_since(source, at).is_some_and(|from| from <= since)
    }

    /// Whether the source in control commands run, and has commanded without a gap since then.
    pub fn runs_throughout(&self, since: u64, at: u64) -> bool {
        self.run_in_control(at).is_some_and(|(source, _)| self.commands_throughout(source, since, at))
    }

    /// The highest source that is fresh and commands, and its command.
    pub fn in_control(&self, at: u64) -> Option<(usize, PilotCommand)> {
        (0..4).find_map(|source| {
            self.fresh(source, at)
                .filter(|command| *command != PilotCommand::Nothing)
                .map(|command| (source, command))
        })
    }

    /// The source in control, if it commands run, and its demand.
    pub fn run_in_control(&self, at: u64) -> Option<(usize, Demanded)> {
        match self.in_control(at) {
            Some((source, PilotCommand::Run(demanded))) => Some((source, demanded)),
            _ => None,
        }
    }

    /// When a source last commanded run with no source above it, before or at an instant.
    pub fn last_run(&self, at: u64) -> Option<u64> {
        let below = |source: usize, when: u64| {
            (0..source).any(|higher| {
                self.fresh(higher, when).is_some_and(|command| command != PilotCommand::Nothing)
            })
        };
        (0..4)
            .filter_map(|source| {
                let run = |command: &&(u64, PilotCommand)| {
                    matches!(command.1, PilotCommand::Run(_)) && !below(source, command.0)
                };
                self.until(source, at).iter().rev().find(run).map(|(when, _)| *when)
            })
            .max()
    }

    /// The last run of a source that had commanded without a gap for this long.
    pub fn in_control_for_sure(&self, source: usize, at: u64, streamed: u64) -> Option<u64> {
        let gaps = &self.gaps[source];
        self.until(source, at).iter().rev().take(4000).find_map(|&(when, command)| {
            // After a reset a source that was lost has to command again.
            let reset = self.ups[..self.ups.partition_point(|up| *up <= when)].last().copied().unwrap_or(0);
            let since = gaps[..gaps.partition_point(|after| *after <= when)].last()?.max(&reset);
            (matches!(command, PilotCommand::Run(_)) && when >= since + streamed).then_some(when)
        })
    }

    pub fn armed(&self, at: u64) -> bool {
        last_of(&self.armed, at)
    }

    /// Armed, whatever the node retained over a brown-out.
    pub fn surely_armed(&self, at: u64) -> bool {
        last_of(&self.surely_armed, at)
    }

    /// Whether it was armed at any time in between.
    pub fn armed_within(&self, from_us: u64, to_us: u64) -> bool {
        self.armed(from_us) || self.armed.iter().any(|(at, armed)| *armed && (from_us..=to_us).contains(at))
    }
}

fn last_of(armed: &[(u64, bool)], at: u64) -> bool {
    armed[..armed.partition_point(|(when, _)| *when <= at)].last().is_some_and(|(_, armed)| *armed)
}

/// An emergency stop disarms. A source that commanded armed before its release has to command disarmed first. A loss of the
/// node's power disarms.
fn armed(h: &History, brown_out_forgets: bool) -> Vec<(u64, bool)> {
    let mut all = vec![(0, !h.rules.arming)];
    if !h.rules.arming {
        return all;
    }
    // The highest source that latched a stop: no lower one releases it.
    let (mut latched, mut commanded_armed, mut blocked) = (None::<usize>, [false; 4], [false; 4]);
    let mut lost = h.resets.iter().filter(|Reset { cause, .. }| *cause != Cause::Watchdog).peekable();
    for commanded in &h.commanded {
        while let Some(reset) = lost.next_if(|reset| reset.down <= commanded.at) {
            all.push((reset.down, false));
            if brown_out_forgets || reset.cause != Cause::BrownOut {
                (commanded_armed, blocked) = ([false; 4], [false; 4]);
            }
            // A latched stop outlives a brown-out that leaves the memory whole.
            latched = latched.filter(|_| reset.cause == Cause::BrownOut);
        }
        match commanded.command {
            PilotCommand::Arm => {
                commanded_armed[commanded.source] = true;
                blocked[commanded.source] |= latched.is_some();
                if !blocked[commanded.source] {
                    all.push((commanded.at, true));
                }
            }
            PilotCommand::Disarm => {
                (commanded_armed[commanded.source], blocked[commanded.source]) = (false, false);
                all.push((commanded.at, false));
            }
            PilotCommand::Stop => {
                latched = Some(latched.map_or(commanded.source, |by| by.min(commanded.source)));
                for (blocked, commanded_armed) in blocked.iter_mut().zip(commanded_armed) {
                    *blocked |= commanded_armed;
                }
                all.push((commanded.at, false));
            }
            PilotCommand::Release if brown_out_forgets || is_released(h, commanded) => {
                latched = latched.filter(|by| commanded.source > *by);
            }
            _ => {}
        }
    }
    // After the last command nobody arms it again.
    all.extend(lost.map(|reset| (reset.down, false)));
    all
}

/// Whether this release certainly took effect: no stop is on the wire after it, and none of any source before the first other order may
/// be the one that did. The first of them may have come while nothing was received of the ECU.
fn is_released(h: &History, release: &Commanded) -> bool {
    let switch = |frame: &Frame| Some((frame.at, frame.sent.switch()?));
    // A node without memory has no stop.
    let forgets = h.resets.iter().find(|reset| reset.cause == Cause::PowerOn && reset.down >= release.at);
    let until = forgets.map_or(u64::MAX, |reset| reset.down).min(release.at + SECOND);
    let from = until.min(release.at + stop_is_late(h));
    let mut frames = h.frames_within(from, until).iter().filter_map(switch);
    frames.next().is_some_and(|(at, switch)| {
        let again = |later: &Commanded| later.command == release.command;
        switch != Switch::Stop && !h.commanded(release.at + 1, at).iter().any(again)
    })
}

/// Time for which the wire may still carry what was decided before a stop or its release: a frame that was being sent, and ZK's next
/// slot; an AMT reply that was handed over.
pub fn stop_is_late(h: &History) -> u64 {
    if h.rules.kind.traits().replies_only { 40 * MS } else { 2 * h.rules.period + 20 * MS }
}

/// When all sources were silent: from the last command to the next, or to the end.
pub fn silences(h: &History, at_least: u64) -> Vec<(u64, u64)> {
    let mut received: Vec<u64> = h
        .commanded
        .iter()
        .filter(|commanded| commanded.command.is_received())
        .map(|commanded| commanded.at)
        .collect();
    received.push(h.end);
    received.windows(2).map(|pair| (pair[0], pair[1])).filter(|(from, to)| to - from > at_least).collect()
}

/// How long the stages of loss take until the fail-safe, from the last command on.
pub fn to_fail_safe(h: &History) -> u64 {
    let rules = &h.rules;
    let age = rules.ages.into_iter().max().unwrap_or_default();
    let rate = rules.ramp.min(rules.slew_down.unwrap_or(rules.ramp)).max(1);
    age + rules.hold + 1000 * SECOND / u64::from(rate)
}
