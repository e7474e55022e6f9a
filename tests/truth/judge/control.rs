//! What can be said from the words alone of who commands an engine.

use crate::history::{Ask, Cause, History, Kind, Reset, SECOND, Said, Word};

/// The words of each source by which it is heard, in the order of time.
#[derive(Clone, Debug)]
pub struct Voices {
    words: [Vec<(u64, Word)>; 4],
    ages: [u64; 4],
    /// The words of each source that came after a gap.
    gaps: [Vec<u64>; 4],
    /// When the node began, after each reset.
    ups: Vec<u64>,
    /// When the engine was armed, and was not any more.
    armed: Vec<(u64, bool)>,
    /// The same, where a brown-out does not forget who has to say disarmed first.
    surely_armed: Vec<(u64, bool)>,
}

impl Voices {
    pub fn new(h: &History) -> Self {
        let mut words: [Vec<(u64, Word)>; 4] = Default::default();
        // A speed that the ECU cannot hold, because another one was plugged in, is refused: to the node its source is silent.
        let refused = |said: &Said| {
            let slow = matches!(h.rules.kind, Kind::Zk(_)) && h.version(said.at) < 4 && !h.rules.governor;
            slow && matches!(said.word, Word::Run(Ask::Rpm(_)))
        };
        for said in h.said.iter().filter(|said| !refused(said)) {
            if said.word.is_heard() || said.word == Word::Nothing {
                words[said.source].push((said.at, said.word));
            }
        }
        let mut gaps: [Vec<u64>; 4] = Default::default();
        for (source, words) in words.iter().enumerate() {
            let mut before = None;
            for &(at, _) in words {
                if before.replace(at).is_none_or(|before| at > before + h.rules.ages[source]) {
                    gaps[source].push(at);
                }
            }
        }
        Self {
            words,
            ages: h.rules.ages,
            gaps,
            ups: h.resets.iter().map(|reset| reset.up).collect(),
            armed: armed(h, true),
            surely_armed: armed(h, false),
        }
    }

    /// The words of a source up to an instant.
    pub fn until(&self, source: usize, at: u64) -> &[(u64, Word)] {
        let words = &self.words[source];
        &words[..words.partition_point(|(when, _)| *when <= at)]
    }

    /// The last words of a source that say run or standby.
    pub fn orders(&self, source: usize, at: u64) -> Vec<(u64, Word)> {
        let order = |word: &&(u64, Word)| {
            matches!(word.1, Word::Standby | Word::ShutDown | Word::Run(_) | Word::Stop)
        };
        let mut last: Vec<_> = self.until(source, at).iter().rev().filter(order).take(3).copied().collect();
        last.reverse();
        last
    }

    pub const fn age(&self, source: usize) -> u64 {
        self.ages[source]
    }

    pub fn last(&self, source: usize, at: u64) -> Option<(u64, Word)> {
        self.until(source, at).last().copied()
    }

    /// The last word of a source, if it is not too old.
    pub fn fresh(&self, source: usize, at: u64) -> Option<Word> {
        self.last(source, at).filter(|(when, _)| at <= when + self.age(source)).map(|(_, word)| word)
    }

    /// Since when a source has spoken without a gap beyond its age limit, if it is fresh.
    pub fn speaks_since(&self, source: usize, at: u64) -> Option<u64> {
        self.fresh(source, at)?;
        let gaps = &self.gaps[source];
        gaps[..gaps.partition_point(|after| *after <= at)].last().copied()
    }

    /// The highest source that is fresh and wants something, and what.
    pub fn in_control(&self, at: u64) -> Option<(usize, Word)> {
        (0..4).find_map(|source| {
            self.fresh(source, at).filter(|word| *word != Word::Nothing).map(|word| (source, word))
        })
    }

    /// The source in control, if it says run, and its demand.
    pub fn run_in_control(&self, at: u64) -> Option<(usize, Ask)> {
        match self.in_control(at) {
            Some((source, Word::Run(ask))) => Some((source, ask)),
            _ => None,
        }
    }

    /// When a source last said run with nobody above it, before or at an instant.
    pub fn last_run(&self, at: u64) -> Option<u64> {
        let below = |source: usize, when: u64| {
            (0..source).any(|higher| self.fresh(higher, when).is_some_and(|word| word != Word::Nothing))
        };
        (0..4)
            .filter_map(|source| {
                let run = |word: &&(u64, Word)| matches!(word.1, Word::Run(_)) && !below(source, word.0);
                self.until(source, at).iter().rev().find(run).map(|(when, _)| *when)
            })
            .max()
    }

    /// The last run of a source that had spoken without a gap for so long.
    pub fn in_control_for_sure(&self, source: usize, at: u64, for_so_long: u64) -> Option<u64> {
        let gaps = &self.gaps[source];
        self.until(source, at).iter().rev().take(4000).find_map(|&(when, word)| {
            // After a reset a source that was lost has to speak anew.
            let reset = self.ups[..self.ups.partition_point(|up| *up <= when)].last().copied().unwrap_or(0);
            let since = gaps[..gaps.partition_point(|after| *after <= when)].last()?.max(&reset);
            (matches!(word, Word::Run(_)) && when >= since + for_so_long).then_some(when)
        })
    }

    pub fn armed(&self, at: u64) -> bool {
        last_of(&self.armed, at)
    }

    /// Armed, whatever the node has kept over a brown-out.
    pub fn surely_armed(&self, at: u64) -> bool {
        last_of(&self.surely_armed, at)
    }

    /// Whether it was armed at any time in between.
    pub fn armed_within(&self, from: u64, to: u64) -> bool {
        self.armed(from) || self.armed.iter().any(|(at, armed)| *armed && (from..=to).contains(at))
    }
}

fn last_of(armed: &[(u64, bool)], at: u64) -> bool {
    armed[..armed.partition_point(|(when, _)| *when <= at)].last().is_some_and(|(_, armed)| *armed)
}

/// An emergency stop disarms. Who said armed before its release has to say disarmed first. A loss of the node's power
/// disarms.
fn armed(h: &History, brown_out_forgets: bool) -> Vec<(u64, bool)> {
    let mut all = vec![(0, !h.rules.arming)];
    if !h.rules.arming {
        return all;
    }
    let (mut latched, mut said_armed, mut blocked) = (false, [false; 4], [false; 4]);
    let mut lost = h.resets.iter().filter(|Reset { cause, .. }| *cause != Cause::Watchdog).peekable();
    for said in &h.said {
        while let Some(reset) = lost.next_if(|reset| reset.down <= said.at) {
            all.push((reset.down, false));
            if brown_out_forgets || reset.cause != Cause::BrownOut {
                (said_armed, blocked) = ([false; 4], [false; 4]);
            }
            // A latched stop outlives a brown-out that leaves the memory whole.
            latched &= reset.cause == Cause::BrownOut;
        }
        match said.word {
            Word::Arm => {
                said_armed[said.source] = true;
                blocked[said.source] |= latched;
                if !blocked[said.source] {
                    all.push((said.at, true));
                }
            }
            Word::Disarm => {
                (said_armed[said.source], blocked[said.source]) = (false, false);
                all.push((said.at, false));
            }
            Word::Stop => {
                latched = true;
                for (blocked, said_armed) in blocked.iter_mut().zip(said_armed) {
                    *blocked |= said_armed;
                }
                all.push((said.at, false));
            }
            Word::Release => latched = false,
            _ => {}
        }
    }
    all
}

/// When all sources were silent: from the last word to the next, or to the end.
pub fn silences(h: &History, at_least: u64) -> Vec<(u64, u64)> {
    let mut heard: Vec<u64> = h.said.iter().filter(|said| said.word.is_heard()).map(|said| said.at).collect();
    heard.push(h.end);
    heard.windows(2).map(|pair| (pair[0], pair[1])).filter(|(from, to)| to - from > at_least).collect()
}

/// How long the stages of loss take until the fail-safe, from the last word on.
pub fn to_fail_safe(h: &History) -> u64 {
    let rules = &h.rules;
    let age = rules.ages.into_iter().max().unwrap_or_default();
    let rate = rules.ramp.min(rules.slew_down.unwrap_or(rules.ramp)).max(1);
    age + rules.hold + 1000 * SECOND / u64::from(rate)
}
