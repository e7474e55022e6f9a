//! A demand is not held below what is commanded, nor above it.
//!
//! Each instant at which an engine runs and a source in control commands run is judged, or counted under one of the names below. The
//! rules prescribe what is sent in those of [`STARTS`] to [`OLD`], so that they are no exemption; [`NOISE`] and [`SPEEDS`] are, with their shares.

use super::case::{Case, Rule, seconds};
use super::healthy::FALLS;
use super::prompt::{KEEPS_THE_BEAT, SPEED_IS_OLD};
use crate::history::{Cause, Demanded, MS, PilotCommand, SECOND, Sample, Spans, Switch};
use std::collections::BTreeMap;

/// Time that a governor has to bring its shaft near the commanded speed, with the throttle that it may give.
const GOVERNS: u64 = 8 * SECOND;
/// Share of the commanded speed that is near it.
const NEAR: f64 = 0.9;
/// Resolution of the wire, and noise of a stick, 0.1 %.
const STEP: f64 = 8.0;

/// "Lives": the demand is idle, or the start throttle, until two reports confirm a running engine.
const STARTS: &str = "seconds without two reports of a running engine (not judged)";
/// "Doubt acts at once": a reset of the node is doubt until two reports agree. "Demands move": then the demand rises at a set rate.
const RESETS: &str = "seconds of doubt after a reset, and of the rise after it (not judged)";
/// The same for a gap of three expected frames, and for damaged frames at the expected times after 10 s.
const GAPS: &str = "seconds of doubt in a gap, and of the rise after it (not judged)";
/// "One report that does not fit a living engine puts the life in doubt, already in the reply to that very frame."
const REPORTS: &str =
    "seconds of doubt after a report that does not fit, and of the rise after it (not judged)";
/// "Transmitters", and "Demands move": nothing leaves one that hangs, and then the demand rises from the one that was sent.
const HANGS: &str = "seconds of a transmitter that hangs, and of the rise after it (not judged)";
/// "AMT with error sets only": the exhaust is the evidence, until a fall is seen; then only sets that say running get run.
const FAULTS: &str =
    "seconds of error sets without a burning exhaust, and of the rise after them (not judged)";
/// "A stop is on the wire until its release"; a hand-over has no demand.
const STOPS: &str = "seconds of a stop or a hand-over (not judged)";
/// "Sources" and "Demands move": a source takes over, and its demand rises at a set rate.
const WAITS: &str = "seconds of a take-over, and of the rise after it (not judged)";
/// Finding 11: no ID 7 to an ECU whose version does not know it.
const OLD: &str = "seconds of an rpm that the ECU's version does not know (not judged)";
/// Exemption: frames are lost at random, so that only the node knows whether it has a gap.
const NOISE: &str = "HeldDown: noise, and the rise after it";

/// Exemption: `governor.max_age`. A governor gives idle where no speed has come for that long, as `prompt.rs` demands.
const SPEEDS: &str = "HeldDown: a governor without a speed";

/// A time in which the demand may be low although its source stays in control.
struct Pause {
    name: &'static str,
    spans: Spans,
}

/// The end of a pause.
struct Resumed {
    end: u64,
    name: &'static str,
    /// The demand that was sent then, 0.1 %: it rises from there.
    from: f64,
    /// The demand was judged before it: its source was in control.
    kept: bool,
}

impl Case<'_> {
    /// The times in which the demand of the source in control may be low. After each of them it rises at its rate.
    fn pauses(&self) -> Vec<Pause> {
        let h = self.h;
        let (two_states, three_frames) = (self.two_states(), 2 * h.rules.period);
        // "Damaged frames that keep the beat are no gap, for 10 s at most." Of an AMT set at least one byte in ten has to be whole.
        let beats = |from, to| !self.traits().replies_only && h.framing.within(from, to) == to - from;
        let without_beat = |spans: &Spans| {
            let long = spans.at_least(three_frames);
            Spans::from(&long.iter().filter(|(from, to)| !beats(*from, *to)).collect::<Vec<_>>())
        };
        let most = KEEPS_THE_BEAT - 300 * MS;
        let too_long: Vec<_> = h.framing.at_least(most).iter().map(|(from, to)| (from + most, to)).collect();
        // Three expected frames are missing where none is sent, or where no byte of them is whole.
        let silent = self.blind.at_least(three_frames).union(&without_beat(&h.ruined));
        let gaps = silent.union(&Spans::from(&too_long));
        let unfit: Vec<_> = h.unfit.iter().map(|at| (*at, at + MS)).collect();
        let pause = |name, spans| Pause { name, spans };
        vec![
            // "A gap of three expected frames, a reset of the node puts the life in doubt; two agreeing reports confirm or end it."
            pause(RESETS, self.down.longer(h.rules.listen + two_states)),
            pause(GAPS, gaps.longer(two_states)),
            // "Two agreeing reports confirm" it, which another one that does not fit interrupts.
            pause(REPORTS, Spans::from(&unfit).longer(two_states)),
            // What waits in a transmitter that hangs does not reach the ECU.
            pause(HANGS, self.stalled()),
            // "The exhaust is the evidence", until a fall is seen, and "the reply to the first normal sets is not run unless they say running".
            pause(FAULTS, self.unclear_faults()),
            pause(NOISE, without_beat(&h.garbled).longer(two_states)),
        ]
    }

    /// AMT error sets in which the exhaust does not show for certain that the engine burns, and what follows error sets until two sets
    /// report a running engine.
    fn unclear_faults(&self) -> Spans {
        let h = self.h;
        if !self.traits().faults_hide_state {
            return Spans::default();
        }
        let disturbed = self.blind.union(&h.noise).union(&self.down).union(&h.sensor);
        let unclear = h.times(|sample| {
            let at = sample.at;
            let Some((from, to)) = self.faults.last_before(at + 1) else { return false };
            let before = |time: u64| h.sample(sample.at.saturating_sub(time));
            let cold = |sample: &Sample| sample.egt < h.rules.burning + 20.0;
            if at < to {
                let lately = h.samples(at.saturating_sub(3 * SECOND), at);
                return disturbed.touches(from.saturating_sub(SECOND), at)
                    || lately.iter().any(cold)
                    || before(2 * SECOND).is_some_and(|before| before.egt >= sample.egt + FALLS);
            }
            // After faults only a set that reports running is answered.
            h.samples(to, at).iter().all(|sample| sample.hidden)
        });
        unclear.longer(self.two_states())
    }

    /// The times in which a governor may have no speed, and those until two reports have come: its time begins after them.
    fn without_speeds(&self) -> Spans {
        let h = self.h;
        let damaged = h.garbled.union(&h.framing).union(&self.blind);
        let errors = if self.traits().faults_hide_state { self.faults.clone() } else { Spans::default() };
        // The last speed comes a report before, and the next one a report after, or two beside an alternate set.
        let least = SPEED_IS_OLD - 3 * h.rules.period.min(SPEED_IS_OLD / 3);
        damaged.union(&errors).at_least(least).longer(self.two_states())
    }

    /// Whether the last gap of this source was a short one, in a steady stream of a source that was in control: it continues
    /// without a take-over.
    fn came_back(&self, source: usize, at: u64, most: u64) -> bool {
        let h = self.h;
        let Some(commands_for_long) = self.command_log.commands_since(source, at) else { return false };
        let Some((before, PilotCommand::Run(_))) =
            self.command_log.last(source, commands_for_long.saturating_sub(1))
        else {
            return false;
        };
        let short = commands_for_long
            <= before + self.command_log.age(source) + h.rules.return_within.saturating_sub(100 * MS);
        let since = before.saturating_sub(most);
        let steady = self.command_log.commands_since(source, before).is_some_and(|from| from <= since);
        // A standby from a lower source during the stages of loss is not in control.
        let alone = h.commanded(since, at).iter().all(|commanded| {
            commanded.source == source
                && (!commanded.command.is_received() || matches!(commanded.command, PilotCommand::Run(_)))
        });
        let hidden =
            self.blind.union(&h.noise).union(&h.deaf).touches(since, at) || self.down.touches(since, at);
        let runs = self.runs.last_before(at).is_some_and(|(from, _)| from <= since);
        short && steady && alone && runs && !hidden
    }

    /// What is left out at this instant, if the demand of the source in control is not judged then.
    fn left_out(&self, at: u64, pauses: &[Pause]) -> Option<&'static str> {
        if !self.known_to_run(at) {
            return Some(STARTS);
        }
        if let Some(pause) = pauses.iter().find(|pause| pause.spans.contains(at)) {
            return Some(pause.name);
        }
        (self.stopped.touches(at.saturating_sub(SECOND), at + 1) || self.h.pwm.contains(at)).then_some(STOPS)
    }

    /// The times after which no source is in control: a loss of power, which loses the source, and a silence in which the order is given up.
    fn loses_source(&self) -> Spans {
        let h = self.h;
        let lost = h.resets.iter().filter(|reset| reset.cause != Cause::Watchdog);
        let lost = Spans::from(&lost.map(|reset| (reset.down, reset.up + SECOND)).collect::<Vec<_>>());
        if !self.traits().serial_delay {
            return lost;
        }
        let silent = self.down.union(&self.blind).union(&h.noise).longer(self.two_states());
        lost.union(&silent.at_least(self.order_outlasts()))
    }

    /// The demand follows what is commanded, downwards always, upwards unless something limits it.
    pub(super) fn held(&mut self) {
        let h = self.h;
        let rules = &h.rules;
        let exempt =
            self.exemptions().into_iter().fold(Spans::default(), |all, (_, spans)| all.union(&spans));
        let rise = rules.rise.min(rules.slew_up.unwrap_or(rules.rise)).max(1);
        let quick = 1000 * SECOND / u64::from(rise) + 700 * MS;
        let most = rules.takeover + rules.recover_after + quick + 1300 * MS;
        let (pauses, lost, without_speeds) = (self.pauses(), self.loses_source(), self.without_speeds());
        let mut since: Option<(u64, usize, Demanded)> = None;
        // Since when the same source has been in control, with nothing in the way.
        let mut control: Option<(u64, usize)> = None;
        let mut resumed: Option<Resumed> = None;
        let mut established = false;
        let mut left: BTreeMap<&'static str, u64> = BTreeMap::new();
        let (mut reported, mut judged, mut limited, mut speeds) = (0, 0, 0, 0);
        let mut frame = 0;
        let (mut low_since, mut high_since) = (None, None);
        // No demand takes longer to fall.
        let fall = 1000 * SECOND / u64::from(rules.slew_down.unwrap_or(1000).min(rules.ramp).max(1));
        let mut last = 0;
        for sample in &h.samples {
            let at = sample.at;
            let new = h.commanded(last, at);
            let elapsed = at - core::mem::replace(&mut last, at);
            while frame < h.frames.len() && h.frames[frame].at <= at {
                frame += 1;
            }
            let Some((source, demanded)) = self.command_log.run_in_control(at).filter(|_| sample.runs())
            else {
                (since, control, resumed, established) = (None, None, None, false);
                (low_since, high_since) = (None, None);
                continue;
            };
            if exempt.contains(at) {
                (since, control, resumed, established) = (None, None, None, false);
                (low_since, high_since) = (None, None);
                continue;
            }
            let sent = h.frames[..frame]
                .iter()
                .rev()
                .take(16)
                .find_map(|frame| frame.sent.demand().map(|demanded| (frame.at, demanded)));
            let same = |sent: Demanded| core::mem::discriminant(&sent) == core::mem::discriminant(&demanded);
            let fresh = |when: u64| at < when + 4 * rules.period + 200 * MS;
            // No source above it was received lately, which might still be in control.
            let alone = (0..source).all(|higher| {
                self.command_log.last(higher, at).is_none_or(|(when, command)| {
                    at > when + self.command_log.age(higher) + rules.hold || command == PilotCommand::Nothing
                })
            });
            // A source that was lost has to command for a while first.
            let commanding = |source| self.command_log.commands_since(source, at).unwrap_or(at);
            let why = self.left_out(at, &pauses).or_else(|| (!alone).then_some(WAITS));
            let pauses = why.is_some_and(|why| pauses.iter().any(|pause| pause.name == why));
            if why.is_some() && (!pauses || lost.contains(at)) {
                (since, control, resumed, established) = (None, None, None, false);
            } else {
                // Another source has yet to take over.
                established &= since.is_some_and(|(_, before, _)| before == source);
                control = Some(control.filter(|(_, before)| *before == source).unwrap_or((at, source)));
                since = Some(match since {
                    Some((from, before, requested))
                        if source == before
                            && demanded == requested
                            && !new
                                .iter()
                                .any(|each| each.source == source && strays(each.command, demanded)) =>
                    {
                        (from, source, demanded)
                    }
                    _ => (at, source, demanded),
                });
            }
            if let Some(why) = why {
                *left.entry(why).or_default() += elapsed;
                if pauses {
                    let from = sent.filter(|(when, sent)| fresh(*when) && same(*sent));
                    let from = from.map_or(0.0, |(_, sent)| self.share(sent));
                    resumed = Some(Resumed { end: at, name: why, from, kept: established });
                }
                (low_since, high_since) = (None, None);
                continue;
            }
            // A source that has long been in control, without a loss, does not have to wait when it moves its stick.
            let settled = |from: u64, source: usize| {
                control.is_some_and(|(control, _)| from > control.max(commanding(source)) + most)
            };
            let bound = |from: u64, source: usize| {
                if settled(from, source) || self.came_back(source, at, most) { quick } else { most }
            };
            let Some((from, source, demanded)) = since else { continue };
            let begin = from.max(commanding(source));
            let risen = |resumed: &Resumed| {
                let tenths = (self.share(demanded) - resumed.from).max(0.0) as u64;
                resumed.end + tenths * SECOND / u64::from(rise) + 700 * MS
            };
            let rises = resumed.as_ref().filter(|resumed| at <= risen(resumed)).map(|resumed| resumed.name);
            let waits = match &resumed {
                // It resumes with the demand that its source had before.
                Some(Resumed { end, kept: true, .. }) if from <= *end && commanding(source) < *end => false,
                // A source that had not taken over yet may not have come nearer to that.
                Some(Resumed { end, kept: false, .. }) => at <= begin.max(*end) + bound(from, source),
                _ => at <= begin + bound(from, source),
            };
            let waits = waits || at <= begin + quick;
            if waits || rises.is_some() || at < reported {
                if at >= reported {
                    *left.entry(rises.unwrap_or(WAITS)).or_default() += elapsed;
                }
                (low_since, high_since) = (None, None);
                continue;
            }
            established = true;
            let governed = matches!(demanded, Demanded::Rpm(_)) && rules.governor;
            if matches!(demanded, Demanded::Rpm(_)) && h.version(at) < 4 && !governed {
                *left.entry(OLD).or_default() += elapsed;
                (low_since, high_since) = (None, None);
                continue;
            }
            // What shut it down is another matter.
            let switch = h.frames[..frame].iter().rev().take(64).find_map(|frame| frame.sent.switch());
            if matches!(switch, Some(Switch::Stop | Switch::Standby)) {
                *left.entry(STOPS).or_default() += elapsed;
                continue;
            }
            let high = sent.is_some_and(|(when, sent)| {
                fresh(when) && same(sent) && self.share(sent) > self.share(demanded) + STEP
            });
            let fallen = at > begin + bound(from, source) + fall;
            high_since = (high && fallen).then(|| high_since.unwrap_or(at));
            if let (Some(since), Some((_, sent))) = (high_since, sent)
                && at >= since + SECOND
            {
                let text = format!(
                    "source {source} commands run at {demanded} since {}, and {sent} is on the wire",
                    seconds(from)
                );
                self.verdict.finding(Rule::HeldUp, at, text);
                reported = at + 60 * SECOND;
            }
            if self.reduced(at) {
                low_since = None;
                limited += elapsed;
                continue;
            }
            if governed && without_speeds.contains(at) {
                speeds += elapsed;
                low_since = None;
                continue;
            }
            judged += elapsed;
            let low = match sent {
                Some((when, Demanded::Throttle(tenths))) if governed && fresh(when) => {
                    let wanted = self.share(demanded) * rules.max_rpm / 1000.0;
                    tenths + 20 < rules.authority && sample.rpm < NEAR * wanted
                }
                Some((when, sent)) if fresh(when) => {
                    !same(sent) || self.share(sent) + STEP < self.share(demanded)
                }
                // What a hanging transmitter holds back does not count as a lower demand.
                _ => !h.deaf.touches(at.saturating_sub(SECOND), at + 1),
            };
            // A reduction begins before its reason shows.
            low_since = low.then(|| low_since.unwrap_or(at));
            if low_since.is_some_and(|since| at >= since + if governed { GOVERNS } else { SECOND }) {
                let text = format!(
                    "source {source} commands run at {demanded} since {}, and {} is on the wire",
                    seconds(from),
                    sent.map_or("nothing".to_string(), |(_, demanded)| demanded.to_string())
                );
                self.verdict.finding(Rule::HeldDown, at, text);
                reported = at + 60 * SECOND;
            }
        }
        if let Some(time) = left.remove(NOISE) {
            self.verdict.exempt(NOISE, time);
        }
        if speeds > 0 {
            self.verdict.exempt(SPEEDS, speeds);
        }
        for (name, time) in left {
            self.verdict.count(name, time / SECOND);
        }
        self.verdict.count("seconds in which a demand has to be obeyed", judged / SECOND);
        self.verdict.count("seconds in which a limit or another engine may hold it low", limited / SECOND);
    }
}

/// Whether this commands another demand.
fn strays(command: PilotCommand, demanded: Demanded) -> bool {
    matches!(command, PilotCommand::Run(other) if other != demanded)
}
