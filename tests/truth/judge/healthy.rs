//! The other way round: an engine that runs, and is told to run, is not shut down, not given up, and not held low.

use super::{Case, Rule, seconds};
use crate::history::{Ask, Cause, MS, Mark, Reset, SECOND, Sample, Spans, Switch, Word};
use sim::turbine::Phase;

/// So long an engine has to run, and be heard, until the node has to know.
const KNOWN: u64 = 3 * SECOND;
/// After a disturbance that is over, until everything goes its way again.
const SETTLES: u64 = 1500 * MS;

impl Case<'_> {
    /// Times in which the rules of this file do not bind, each with its name.
    fn exemptions(&self) -> Vec<(&'static str, Spans)> {
        let h = self.h;
        let patience = h.rules.gives_up_after;
        let cut = h.mute.union(&h.deaf).at_least(patience.saturating_sub(300 * MS)).longer(SETTLES);
        // Up for less than it takes to find out, again and again, is as good as down.
        let down = self.down.longer(4 * h.rules.period + 100 * MS);
        // After a reset an AMT engine is in doubt, and damaged sets are not replied to.
        let silent = if self.is_amt() { down.union(&h.noise) } else { down.clone() };
        // What it costs beside itself: up to a set before it, the one in which it ends, and an AMT set without a state behind it,
        // which is not answered after a gap.
        let costs = if self.is_amt() { 3 * h.rules.period + 50 * MS } else { 300 * MS };
        let silent = silent.at_least(patience.saturating_sub(costs));
        let silent: Vec<_> = silent.iter().filter(|(from, to)| down.touches(*from, *to)).collect();
        let gap = Spans::from(&silent).longer(SETTLES);
        // What is damaged on the way to the ECU for longer than it waits is as good as cut. On the way to the node damage costs
        // a ZK ECU nothing, and an AMT ECU its replies where no set can be told from garbage.
        let damage = if self.is_amt() { h.noise_to_ecu.union(&h.garbled) } else { h.noise_to_ecu.clone() };
        let damage = damage.at_least(patience.saturating_sub(costs)).longer(SETTLES);
        let zk = !self.is_amt();
        // Which ECU it is at that time.
        let of = |spans: Spans, version: core::ops::Range<u8>| {
            let chosen = spans.iter().filter(|(from, _)| version.contains(&h.version(*from)));
            Spans::from(&chosen.collect::<Vec<_>>())
        };
        let mut all = match zk {
            false => vec![
                ("AMT, a wire cut", cut),
                ("AMT, a gap beyond the serial delay", gap),
                ("AMT, damage beyond the serial delay", damage),
            ],
            true => vec![
                ("ZK up to 4, a wire cut", of(cut, 1..5)),
                ("ZK up to 4, a gap beyond the loss time", of(gap, 1..5)),
                ("ZK up to 4, damage beyond the loss time", of(damage, 1..5)),
            ],
        };
        if zk && h.rules.gives_up_on_empty {
            // What is prescribed in doubt is what this ECU does not put up with.
            let doubt =
                self.blind.union(&h.noise).union(&h.deaf).union(&self.down).longer(2 * self.two_states());
            all.push(("ZK up to 4 that gives up on ID 0, in doubt", of(doubt, 1..5)));
        }
        if let Some((egt, true)) = h.rules.limit_egt {
            let over = h.times(|sample| sample.runs() && sample.egt > egt - 5.0);
            // A broken thermocouple reads far above it.
            let over = over.union(&h.sensor);
            all.push(("a limit whose action is standby", over.longer(SETTLES)));
        }
        if let Some((rpm, true)) = h.rules.limit_rpm {
            let over = h.times(|sample| sample.runs() && sample.rpm > rpm - 1500.0);
            all.push(("a limit whose action is standby", over.longer(SETTLES)));
        }
        if h.rules.limit_change == Some(true) {
            // What no turbine does is seen where values are damaged, or a thermocouple breaks.
            all.push(("a limit whose action is standby", h.noise.union(&h.sensor).longer(SETTLES)));
        }
        if h.rules.limit_fault == Some(true) {
            let fault = h.times(|sample| sample.runs() && sample.fault);
            all.push(("a limit whose action is standby", fault.longer(SETTLES)));
        }
        all
    }

    fn exempt_at(&self, from: u64, to: u64) -> bool {
        self.exemptions().iter().any(|(_, spans)| spans.touches(from, to + 1))
    }

    /// How long the rules applied, and how much of it was exempt.
    pub(super) fn shares(&mut self) {
        let voices = &self.voices;
        let applies = self.h.times(|sample| sample.runs() && voices.run_in_control(sample.at).is_some());
        self.verdict.applied = applies.total();
        let mut taken = Spans::default();
        for (name, spans) in self.exemptions() {
            // Each instant counts once.
            let both = taken.union(&spans);
            let time = both.common(&applies) - taken.common(&applies);
            taken = both;
            if time > 0 {
                self.verdict.exempt(name, time);
            }
        }
    }

    /// When the engine began to run, if it runs at this instant and nothing has kept the node from knowing it.
    pub(super) fn known_to_run(&self, at: u64) -> bool {
        let Some((from, to)) = self.runs.last_before(at) else { return false };
        at < to
            && at > from + KNOWN
            && at - from > KNOWN + self.hidden.within(from, at)
            && self.longest_up(from, at) >= self.two_states()
    }

    /// The longest time without a reset: a node that is reset before two reports agree cannot know what it is told.
    pub(super) fn longest_up(&self, from: u64, at: u64) -> u64 {
        let (mut since, mut longest) = (from, 0);
        for (down, up) in self.down.iter().filter(|(down, up)| *up > from && *down < at) {
            longest = longest.max(down.saturating_sub(since));
            since = up;
        }
        longest.max(at.saturating_sub(since))
    }

    pub(super) fn shut_down(&mut self) {
        let h = self.h;
        let mut before = None;
        for frame in &h.frames {
            let Some(switch) = frame.told.switch() else { continue };
            let previous = before.replace(switch);
            let stops = matches!(switch, Switch::Stop | Switch::Standby);
            // What shut it down was said before.
            let began = previous.is_none_or(|previous| matches!(previous, Switch::Run | Switch::Pwm));
            if !stops
                || !began
                || !self.known_to_run(frame.at)
                || h.pwm.touches(frame.at.saturating_sub(SECOND), frame.at)
            {
                continue;
            }
            // What goes out now may have been decided a slot ago, whatever was said since.
            let decided = frame.at.saturating_sub(h.rules.period);
            let mut words = h.said(decided, frame.at).iter().map(|said| said.at);
            let reason = self.reason_to_stop(frame.at)
                || self.reason_to_stop(decided)
                || words.any(|at| self.reason_to_stop(at));
            if reason || self.exempt_at(frame.at, frame.at) {
                continue;
            }
            let who = match self.voices.in_control(frame.at) {
                Some((source, Word::Run(ask))) => format!("source {source} says run at {ask}"),
                Some((source, word)) => format!("source {source} says {word:?}, once"),
                None => "all sources are silent".into(),
            };
            self.verdict.finding(
                Rule::ShutDown,
                frame.at,
                format!("{switch:?} for an engine that runs, and {who}"),
            );
        }
    }

    /// When a source that was in control for sure last said run: it had spoken for a while, with nobody above it.
    fn ruled_for_sure(&self, source: usize, at: u64, spoken: u64) -> Option<u64> {
        let rules = &self.h.rules;
        self.voices.in_control_for_sure(source, at, spoken).filter(|when| {
            // While it waits to take over from a higher one that was lost, the stages of loss of that one go on. One that comes
            // and goes is none to wait for.
            let lost = |above| {
                let last = self.voices.in_control_for_sure(above, *when, rules.recover_after)?;
                Some(last + self.voices.age(above) + rules.takeover)
            };
            let words = self.voices.until(source, *when).iter().rev();
            let runs = words.take_while(|(_, word)| matches!(word, Word::Run(_)));
            let since = runs.last().map_or(*when, |(since, _)| *since);
            // Nor is it before it has taken over, from a lower one either.
            *when >= since + rules.takeover && (0..source).filter_map(lost).all(|lost| *when >= lost)
        })
    }

    /// When a source said that it wants nothing, right after this word: it is silent from then on.
    fn nothing_after(&self, source: usize, word: u64, at: u64) -> Option<u64> {
        let later = self.voices.until(source, at).iter().find(|(when, _)| *when > word);
        later.filter(|(_, word)| *word == Word::Nothing).map(|(when, _)| *when)
    }

    /// Whether a higher source, which says run, keeps this one's standby from taking effect.
    fn holds_against(&self, higher: usize, at: u64, slack: u64) -> bool {
        let rules = &self.h.rules;
        // It was in control for sure at this word.
        // What goes out now was found a slot ago.
        let Some(sure) = self.ruled_for_sure(higher, at, rules.recover_after + rules.takeover + slack) else {
            return false;
        };
        let nothing = self.nothing_after(higher, sure, at);
        let lost = nothing.unwrap_or(u64::MAX).min(sure + self.voices.age(higher));
        // Or another one has taken over since, with a run of its own.
        let took_over = (0..4).filter(|other| *other != higher).any(|other| {
            let words = self.voices.until(other, at).iter().rev();
            let mut words = words.take_while(|(when, _)| when + self.voices.age(other) > lost);
            words.any(|(_, word)| matches!(word, Word::Run(_)))
        });
        at + slack < lost + rules.hold + rules.lower_standby_after && !took_over
    }

    /// Whether a pilot, or the end of the stages of loss, is a reason for standby or stop at this instant.
    fn reason_to_stop(&self, at: u64) -> bool {
        let h = self.h;
        let rules = &h.rules;
        if self.stopped.touches(at.saturating_sub(2 * SECOND), at + 1) {
            return true;
        }
        let recent = h.said(at.saturating_sub(3 * SECOND), at);
        let ctf = h.said(at.saturating_sub(20 * SECOND), at).iter().any(|said| said.word == Word::Ctf);
        if ctf || recent.iter().any(|said| matches!(said.word, Word::Stop | Word::ShutDown | Word::Pwm)) {
            return true;
        }
        let slack = 400 * MS + 2 * rules.period;
        // Two words of one source within its age limit or two of its periods, with nobody above it who says otherwise.
        let asked = (0..4).any(|source| {
            let words = self.voices.orders(source, at);
            let [.., (first, Word::Standby), (second, Word::Standby)] = words[..] else { return false };
            let period = words.len().checked_sub(3).map_or(0, |third| first - words[third].0);
            let near = second - first <= self.voices.age(source).max(2 * period) + MS;
            let fresh = at <= second + self.voices.age(source) + rules.takeover + slack;
            near && fresh && (0..source).all(|higher| !self.holds_against(higher, at, slack))
        });
        asked || self.silent_for_good(at)
    }

    /// Whether nobody says run, and the stages of loss have run out.
    fn silent_for_good(&self, at: u64) -> bool {
        let h = self.h;
        let rules = &h.rules;
        let slack = 400 * MS + 2 * rules.period;
        // One that was lost has to speak for a while before it is in control again.
        let spoken = |source| {
            self.voices
                .speaks_since(source, at)
                .is_some_and(|since| at >= since + rules.recover_after + slack)
        };
        let run = self.voices.run_in_control(at).filter(|(source, _)| spoken(*source));
        if run.is_some() && self.voices.run_in_control(at.saturating_sub(30 * MS)).is_some() {
            return false;
        }
        // A source that speaks now and then is not in control, and the stages go on.
        let sure = |source| self.ruled_for_sure(source, at, rules.recover_after + rules.takeover + slack);
        let sure = (0..4).filter_map(sure).max();
        let last = self.voices.last_run(at).unwrap_or(0);
        let heard = sure.unwrap_or(last).min(last);
        // Silence is retained wherever the memory is.
        let power = |reset: &&Reset| reset.up <= at && reset.cause == Cause::PowerOn;
        let up = h.resets.iter().filter(power).map(|reset| reset.up).max();
        let youngest = rules.ages.into_iter().min().unwrap_or_default();
        let silent_since = match up {
            Some(up) if heard < up => up,
            _ => {
                let said = (0..4)
                    .filter(|source| self.voices.last(*source, heard).is_some_and(|(when, _)| when == heard));
                let nothing = said.filter_map(|source| self.nothing_after(source, heard, at)).min();
                nothing.unwrap_or(u64::MAX).min(heard + youngest)
            }
        };
        // From the third reset without a source on it resumes at the fail-safe.
        let resets: Vec<u64> =
            h.resets.iter().map(|reset| reset.up).filter(|up| (heard..=at).contains(up)).collect();
        if resets.len() >= 3 && rules.standby_after.is_some() {
            return true;
        }
        // A loop that is too short to listen ends in standby after 10 s without a source.
        if resets.last().is_some_and(|up| at < up + 3 * SECOND)
            && at + slack + resets.len() as u64 * 200 * MS >= heard + 10 * SECOND
        {
            return true;
        }
        let hidden = self.blind.union(&h.noise).union(&self.down).touches(silent_since, at);
        let last_stage = match (rules.standby_after, hidden) {
            (Some(after), true) => Some(after.min(10 * SECOND)),
            (None, true) => Some(10 * SECOND),
            (after, false) => after,
        };
        last_stage.is_some_and(|after| at + slack >= silent_since + rules.hold.min(after) + after)
    }

    pub(super) fn given_up(&mut self) {
        let h = self.h;
        for &(at, mark) in h.marks.iter().filter(|(_, mark)| *mark == Mark::GivenUp) {
            let ran = h.sample(at.saturating_sub(200 * MS)).is_some_and(|sample| sample.runs());
            let since = at.saturating_sub(h.rules.gives_up_after + 500 * MS);
            let run = |at| self.voices.run_in_control(at).is_some();
            let exempt = self.exempt_at(since, at);
            // With nothing retained, and error sets only, nobody knows that it ran.
            // After them two sets have to agree before there is a reply.
            let sets = at.saturating_sub(3 * h.rules.period);
            let faults = |up| h.samples(up, sets).iter().all(|sample| sample.fault);
            let power = h.resets.iter().rev().find(|reset| reset.up <= at && reset.cause == Cause::PowerOn);
            let unknown = self.is_amt() && power.is_some_and(|reset| faults(reset.up));
            if mark == Mark::GivenUp
                && !unknown
                && ran
                && run(at)
                && run(since)
                && !exempt
                && self.known_to_run(since)
            {
                // Nothing but a gap within the ECU's patience is allowed to a node.
                let hidden = self.down.within(since, at) + h.noise.within(since, at);
                let text = format!(
                    "the ECU put out a running engine for want of commands ({} ms of the last {} ms disturbed)",
                    hidden / MS,
                    (at - since) / MS
                );
                self.verdict.finding(Rule::GivenUp, at, text);
            }
        }
    }

    /// Whether a limit, or another engine, may hold the demand down at this instant.
    fn reduced(&self, at: u64) -> bool {
        let h = self.h;
        let since = self.runs.last_before(at).map_or(0, |(from, _)| from);
        // The fail-safe of a limit holds until standby.
        let start = since.saturating_sub(60 * SECOND);
        let ran = h.samples(start, at);
        let over = |egt| ran.iter().any(|sample| sample.egt > egt - 10.0) || h.sensor.touches(start, at);
        let limit_egt = matches!(h.rules.limit_egt, Some((egt, false)) if over(egt));
        let limit_rpm = matches!(h.rules.limit_rpm, Some((rpm, false)) if ran.iter().any(|sample| sample.rpm > rpm - 1500.0));
        let limit_fault = h.rules.limit_fault == Some(false) && ran.iter().any(|sample| sample.fault);
        let other =
            h.rules.when_other_fails.is_some() && h.other_failed.touches(at.saturating_sub(8 * SECOND), at);
        let ctf = h.said(since, at).iter().any(|said| said.word == Word::Ctf);
        // A turbine passes it that goes out, or whose values are damaged. It may be lit again in the same life.
        let out = |sample: &Sample| sample.phase == Phase::Running && !sample.lit;
        let limit_change = h.rules.limit_change == Some(false)
            && (h.noise.touches(start, at)
                || h.sensor.touches(start, at)
                || ran.iter().any(out)
                || !self.live.contains(at));
        limit_change || limit_egt || limit_rpm || limit_fault || other || ctf
    }

    /// Whether the last gap of this source was a short one, in a steady stream of a source that was in control: it goes on
    /// without a take-over.
    fn came_back(&self, source: usize, at: u64, most: u64) -> bool {
        let h = self.h;
        let Some(speaks) = self.voices.speaks_since(source, at) else { return false };
        let Some((before, Word::Run(_))) = self.voices.last(source, speaks.saturating_sub(1)) else {
            return false;
        };
        let short =
            speaks <= before + self.voices.age(source) + h.rules.return_within.saturating_sub(100 * MS);
        let since = before.saturating_sub(most);
        let steady = self.voices.speaks_since(source, before).is_some_and(|from| from <= since);
        let alone = h.said(since, at).iter().all(|said| said.source == source);
        let hidden =
            self.blind.union(&h.noise).union(&h.deaf).touches(since, at) || self.down.touches(since, at);
        let runs = self.runs.last_before(at).is_some_and(|(from, _)| from <= since);
        short && steady && alone && runs && !hidden
    }

    pub(super) fn held_down(&mut self) {
        let h = self.h;
        let rules = &h.rules;
        let exempt =
            self.exemptions().into_iter().fold(Spans::default(), |all, (_, spans)| all.union(&spans));
        let rise = rules.rise.min(rules.slew_up.unwrap_or(rules.rise)).max(1);
        let quick = 1000 * SECOND / u64::from(rise) + 700 * MS;
        let most = rules.takeover + rules.recover_after + quick + 1300 * MS;
        // A node that was reset, or did not hear the ECU, has to find out what its engine does.
        let hidden = self.blind.union(&h.noise).longer(self.two_states() + SECOND);
        // With error sets only an AMT engine whose exhaust falls may be any: its demand is not raised.
        let dumb =
            if self.is_amt() { self.faults.longer(self.two_states() + SECOND) } else { Spans::default() };
        let hidden = hidden.union(&dumb);
        let hidden = hidden.union(&self.down.longer(rules.listen + self.two_states() + SECOND));
        let mut since: Option<(u64, usize, Ask)> = None;
        let mut reported = 0;
        let mut frame = 0;
        let mut low_since = None;
        for sample in &h.samples {
            let at = sample.at;
            let run = self.voices.run_in_control(at).filter(|(source, _)| {
                // Nobody above it was heard lately, who may still be the one in control.
                (0..*source).all(|higher| {
                    self.voices.last(higher, at).is_none_or(|(when, word)| {
                        at > when + self.voices.age(higher) + rules.hold || word == Word::Nothing
                    })
                })
            });
            // A source that was lost has to speak for a while first.
            let spoken = |source| self.voices.speaks_since(source, at).unwrap_or(at);
            let steady = run.filter(|_| {
                sample.runs()
                    && self.known_to_run(at)
                    && !hidden.contains(at)
                    && !exempt.contains(at)
                    && !self.stopped.touches(at.saturating_sub(SECOND), at + 1)
                    && !h.pwm.contains(at)
            });
            since = match (steady, since) {
                (None, _) => None,
                (Some((source, ask)), Some((from, before, asked))) if source == before && ask == asked => {
                    Some((from, source, ask))
                }
                (Some((source, ask)), _) => Some((at, source, ask)),
            };
            while frame < h.frames.len() && h.frames[frame].at <= at {
                frame += 1;
            }
            let bound = |source| if self.came_back(source, at, most) { quick } else { most };
            let Some((from, source, ask)) = since
                .filter(|&(from, source, _)| at > from.max(spoken(source)) + quick && at >= reported)
                .filter(|&(from, source, _)| at > from.max(spoken(source)) + bound(source))
            else {
                low_since = None;
                continue;
            };
            let knows_rpm = h.version(at) >= 4 && !rules.governor;
            if matches!(ask, Ask::Rpm(_)) && !knows_rpm || self.reduced(at) {
                low_since = None;
                continue;
            }
            // What shut it down is another matter.
            let switch = h.frames[..frame].iter().rev().take(64).find_map(|frame| frame.told.switch());
            if matches!(switch, Some(Switch::Stop | Switch::Standby)) {
                continue;
            }
            let told = h.frames[..frame]
                .iter()
                .rev()
                .take(16)
                .find_map(|frame| frame.told.demand().map(|ask| (frame.at, ask)));
            let low = match told {
                Some((when, told)) if at < when + 4 * rules.period + 200 * MS => {
                    let same = core::mem::discriminant(&told) == core::mem::discriminant(&ask);
                    !same || self.share(told) + 8.0 < self.share(ask)
                }
                // What a transmitter that stands still keeps back is no lower demand.
                _ => !h.deaf.touches(at.saturating_sub(SECOND), at + 1),
            };
            // A reduction begins before its reason shows.
            low_since = low.then(|| low_since.unwrap_or(at));
            if low_since.is_some_and(|since| at >= since + SECOND) {
                let text = format!(
                    "source {source} says run at {ask} since {}, and {} is on the wire",
                    seconds(from),
                    told.map_or("nothing".to_string(), |(_, ask)| ask.to_string())
                );
                self.verdict.finding(Rule::HeldDown, at, text);
                reported = at + 60 * SECOND;
            }
        }
    }
}
