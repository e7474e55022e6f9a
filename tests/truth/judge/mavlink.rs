//! MAVLink: each command was received at the same instant, from a system that may give it, and what was received is obeyed.

use super::case::{Case, Rule, seconds};
use crate::history::{
    Answered, ByMavlink, Cause, Demanded, MS, PilotCommand, Received, SECOND, Sample, Spans, Switch, Word,
};
use sim::turbine::Phase;

const MAVLINK: usize = 2;
/// Time after a damaged frame for which other frames may be found late.
const FOUND_LATE: u64 = 1500 * MS;
/// Longest time after a heartbeat in which another one like it is its copy.
const COPY: u64 = 200 * MS;
/// Interval at which the service checks its engines.
const TICK: u64 = 60 * MS;
/// Time for which the same start of the same sender is a repeat.
const REPEAT: u64 = 5 * SECOND;
/// Time for which a heartbeat keeps an order alive.
const HEARTBEAT: u64 = 5 * SECOND;
/// Time by which the state of vehicle and engine is known.
const KNOWN: u64 = 15 * SECOND;
/// Time by which a held demand has risen to that of the stream, if the stream has no gaps.
const RISEN: u64 = 15 * SECOND;
/// Longest time for which a held demand rises from one frame to the next.
const LONGEST_STEP: u64 = 100 * MS;

/// What is sent to an engine by MAVLink, and what follows from that alone.
struct Words<'a> {
    mavlink: &'a ByMavlink,
    /// When frames may be found later than they arrived.
    late: Spans,
    /// When the vehicle has changed what it shows, since the node began: armed, disarmed, or nothing.
    shown: Vec<(u64, Option<bool>)>,
    /// Starts that are not repeats, of all senders.
    starts: Vec<(u64, bool)>,
    /// Repeats that may be judged anew: what they repeat may not have been found after a damaged frame, or before the node has an id.
    renewed: Vec<(u64, bool)>,
    /// From here on the node has the id of the vehicle, also across resets: it has answered.
    known: u64,
}

/// The last start of a sender.
struct LastStart {
    from: u8,
    at: u64,
    while_disarmed: bool,
    /// Highest of its copies, and when the last one was received.
    confirmation: u8,
    last_rx: u64,
    /// A copy may not have been found.
    is_unsure: bool,
    /// When a copy may have been judged anew.
    anew: Option<u64>,
}

impl LastStart {
    /// Whether a start is a copy of it: within 5 s, or by its number, however late. Copies may overtake each other.
    const fn is_repeated(&self, at: u64, confirmation: u8) -> bool {
        at < self.at + REPEAT
            || confirmation > self.confirmation
            || confirmation > 0 && at < self.last_rx + REPEAT
    }
}

impl<'a> Words<'a> {
    fn new(mavlink: &'a ByMavlink, resets: &[(u64, u64)]) -> Self {
        let late: Vec<_> = mavlink.damaged.iter().map(|at| (*at, at + 2 * FOUND_LATE)).collect();
        let late = Spans::from(&late);
        let mut ups = resets.iter().map(|(_, up)| *up).peekable();
        let (mut shown, mut same, mut counted) = (vec![(0, None)], (false, 0), 0);
        let (mut starts, mut renewed) = (Vec::new(), Vec::new());
        let answered = mavlink.answers.first().map_or(u64::MAX, |answer| answer.at);
        let known = if mavlink.learns { answered } else { 0 };
        let mut last: Vec<LastStart> = Vec::new();
        for Received { at, word } in &mavlink.received {
            while let Some(up) = ups.next_if(|up| up <= at) {
                shown.push((up, None));
                same = (false, 0);
                last.clear();
            }
            match *word {
                Word::Vehicle { armed } if same.1 > 0 && same.0 == armed && *at < counted + COPY => {}
                Word::Vehicle { armed } => {
                    counted = *at;
                    same = if same.0 == armed { (armed, same.1 + 1) } else { (armed, 1) };
                    if same.1 >= 2 && shown.last().is_some_and(|(_, before)| *before != Some(armed)) {
                        shown.push((*at, Some(armed)));
                    }
                }
                Word::Start { from, confirmation, while_disarmed } => {
                    // What looks like a frame of an unknown message is skipped as a whole, with what is in it. A node without an id ignores it.
                    let is_unsure = late.contains(*at) || *at <= known;
                    let new = LastStart {
                        from,
                        at: *at,
                        while_disarmed,
                        confirmation,
                        last_rx: *at,
                        is_unsure,
                        anew: None,
                    };
                    match last.iter_mut().find(|last| last.from == from) {
                        Some(last)
                            if last.while_disarmed == while_disarmed
                                && last.is_repeated(*at, confirmation) =>
                        {
                            if last.is_unsure {
                                last.anew = Some(*at);
                                renewed.push((*at, while_disarmed));
                            }
                            last.confirmation = last.confirmation.max(confirmation);
                            last.last_rx = *at;
                            last.is_unsure |= is_unsure;
                        }
                        // It may repeat what may have been judged anew, or what came before a start that was not found.
                        Some(last)
                            if last.while_disarmed == while_disarmed
                                && (last.anew.is_some_and(|anew| *at < anew + REPEAT)
                                    || confirmation > 0 && last.is_unsure) =>
                        {
                            *last = LastStart { is_unsure: true, ..new };
                            renewed.push((*at, while_disarmed));
                        }
                        Some(last) => {
                            *last = new;
                            starts.push((*at, while_disarmed));
                        }
                        None => {
                            last.push(new);
                            starts.push((*at, while_disarmed));
                        }
                    }
                }
                _ => {}
            }
        }
        Self { mavlink, late, shown, starts, renewed, known }
    }

    /// How much earlier a frame that is found at this instant may have arrived.
    fn tolerance(&self, at: u64) -> u64 {
        if self.late.contains(at) { FOUND_LATE } else { 0 }
    }

    fn received(&self, from_us: u64, to_us: u64) -> &'a [Received] {
        let received = &self.mavlink.received;
        let first = received.partition_point(|received| received.at < from_us);
        let last = received.partition_point(|received| received.at <= to_us).max(first);
        &received[first..last]
    }

    /// The words that may be found at this instant.
    fn now(&self, at: u64) -> impl Iterator<Item = Word> + 'a {
        self.received(at - self.tolerance(at).min(at), at).iter().map(|received| received.word)
    }

    /// Whether heartbeats of the vehicle certainly had a gap in this time, which is none of what it showed before.
    fn is_silent(&self, from_us: u64, to_us: u64) -> bool {
        let heartbeats = self.received(from_us, to_us).iter();
        let heartbeats = heartbeats.filter(|received| matches!(received.word, Word::Vehicle { .. }));
        let times = heartbeats.map(|received| received.at).chain([to_us]);
        let mut last = from_us;
        times.into_iter().any(|at| at > core::mem::replace(&mut last, at) + HEARTBEAT + FOUND_LATE)
    }

    /// Time for which the frames of the stream let a held demand rise: gaps do not count.
    fn rises_for(&self, from_us: u64, to_us: u64) -> u64 {
        let frames = self.received(from_us, to_us).iter().filter_map(|received| match received.word {
            Word::Output { tenths: Some(_), sure: true } => Some(received.at),
            _ => None,
        });
        let mut last = None;
        frames.map(|at| last.replace(at).map_or(0, |last| (at - last).min(LONGEST_STEP))).sum()
    }

    /// What the vehicle has shown at an instant.
    fn shows(&self, at: u64) -> Option<bool> {
        self.shown[..self.shown.partition_point(|(when, _)| *when <= at)].last().and_then(|(_, shown)| *shown)
    }

    /// When the node has certainly found two heartbeats in a row that show this change: those after a damaged frame may be skipped with
    /// it.
    fn surely_shown(&self, at: u64, shown: bool) -> Option<u64> {
        let heartbeats = self.received(at, u64::MAX).iter();
        let heartbeats = heartbeats.filter_map(|received| match received.word {
            Word::Vehicle { armed } => Some((received.at, armed)),
            _ => None,
        });
        // The one that showed it was the second.
        let first = self.received(0, at - 1).iter().rev();
        let first = first.clone().find(|received| matches!(received.word, Word::Vehicle { .. }));
        let first = first.map(|received| (received.at, shown)).into_iter();
        let equal = first.chain(heartbeats).take_while(|(_, armed)| *armed == shown);
        let mut equal = equal.map(|(when, _)| when).filter(|when| !self.late.contains(*when));
        let first = equal.next()?;
        equal.find(|when| *when >= first + COPY)
    }

    /// Whether it may have shown this in a time.
    fn may_show(&self, from_us: u64, to_us: u64, armed: bool) -> bool {
        self.shows(from_us) == Some(armed)
            || self.shown.iter().any(|(at, shown)| (from_us..=to_us).contains(at) && *shown == Some(armed))
    }

    /// The throttle before each start that is found in this time, or the lowest of them: the last one since then. What comes after a
    /// start, be it at the same instant, is not the throttle at which it was commanded.
    fn throttle_of_start(&self, since: u64, from_us: u64, to_us: u64) -> Option<u32> {
        let mut last = None;
        let mut lowest: Option<u32> = None;
        for received in self.received(since, to_us) {
            match received.word {
                Word::Output { tenths, .. } => last = tenths.or(last),
                Word::Start { .. } if received.at >= from_us => {
                    lowest = last.map_or(lowest, |last| Some(lowest.map_or(last, |low| low.min(last))));
                }
                _ => {}
            }
        }
        lowest
    }
}

impl Case<'_> {
    pub(super) fn mavlink(&mut self) {
        let h = self.h;
        let Some(mavlink) = &h.mavlink else { return };
        let resets: Vec<_> = h.resets.iter().map(|reset| (reset.down, reset.up)).collect();
        let words = Words::new(mavlink, &resets);
        let mut wrong = self.not_received(&words);
        wrong.extend(self.not_obeyed(&words));
        wrong.extend(self.not_followed(&words));
        wrong.extend(self.not_started(&words));
        for (at, text) in wrong.into_iter().take(5) {
            self.verdict.finding(Rule::ByMavlink, at, text);
        }
        self.verdict.count("messages of MAVLink", mavlink.received.len() as u64);
        self.verdict.count("starts of MAVLink", words.starts.len() as u64);
    }

    /// When the current run of the node began.
    fn up(&self, at: u64) -> u64 {
        self.h.resets.iter().map(|reset| reset.up).take_while(|up| *up <= at).last().unwrap_or(0)
    }

    /// Unsolicited commands.
    fn not_received(&self, words: &Words<'_>) -> Vec<(u64, String)> {
        let h = self.h;
        let mut wrong = Vec::new();
        let own: Vec<_> = h.commanded.iter().filter(|it| it.source == MAVLINK).collect();
        // The last order of a person, and when.
        let mut stopped: Option<u64> = None;
        let mut started: Option<u64> = None;
        for (i, commanded) in own.iter().enumerate() {
            let (at, up) = (commanded.at, self.up(commanded.at));
            let earliest = at - words.tolerance(at).min(at);
            let any = |is: fn(Word) -> bool| words.now(at).any(is);
            let begins = i > 0 && own[i - 1].at == at && own[i - 1].command == PilotCommand::Standby;
            let begun = |(when, _): &&(u64, bool)| (earliest..=at).contains(when);
            let start = words.starts.iter().rev().find(begun);
            let start = start.or_else(|| words.renewed.iter().rev().find(begun));
            let why = match commanded.command {
                PilotCommand::Run(Demanded::Throttle(0)) if begins => {
                    (stopped, started) = (None, Some(at));
                    None
                }
                PilotCommand::Run(Demanded::Throttle(tenths)) if !begins => {
                    self.unexplained_run(words, at, tenths, stopped.filter(|stopped| *stopped >= up))
                }
                PilotCommand::Standby => match start {
                    None => Some("an unsolicited start".to_string()),
                    Some((_, while_disarmed)) => self.unexplained_start(words, at, earliest, *while_disarmed),
                },
                PilotCommand::ShutDown => {
                    stopped = Some(at);
                    let long = words.mavlink.standby_after.is_some_and(|after| {
                        let since = at.saturating_sub(after);
                        !words.may_show(since + TICK, at, true)
                            && words.shows(at) == Some(false)
                            && !words.is_silent(since, at)
                            && started.is_none_or(|started| started < since)
                    });
                    let unnamed = at < words.known && any(|word| word == Word::StopElsewhere);
                    let received = any(|word| word == Word::Stop) || unnamed;
                    (!received && !long).then(|| "an unsolicited stop".into())
                }
                PilotCommand::Stop => {
                    stopped = Some(at);
                    let received = any(|word| word == Word::EmergencyStop);
                    (!received).then(|| "an unsolicited emergency stop".into())
                }
                PilotCommand::Release => {
                    let received = any(|word| word == Word::Release);
                    (!received).then(|| "an unsolicited release".into())
                }
                PilotCommand::Service(number) => {
                    let received = words.now(at).any(|word| word == Word::Service(number));
                    (!received).then(|| "an unsolicited service".into())
                }
                PilotCommand::Ctf => {
                    let received = any(|word| word == Word::Ctf);
                    (!received).then(|| "unsolicited CTF".into())
                }
                PilotCommand::Arm => {
                    let shown = words.may_show(earliest.saturating_sub(TICK), at, true);
                    (!shown && start.is_none()).then(|| "armed, and the vehicle does not show it".into())
                }
                PilotCommand::Disarm => {
                    let stop = h.commanded(up.max(at.saturating_sub(SECOND)), at).iter();
                    let mut stop = stop.filter(|it| it.command == PilotCommand::Stop);
                    // A latched stop that outlived a reset disarms, too.
                    let begun = at < up + 2 * SECOND;
                    let shown = words.shows(at) == Some(true) && words.shows(earliest) == Some(true);
                    (shown && stop.next().is_none() && !begun)
                        .then(|| "disarmed, and the vehicle shows armed".into())
                }
                PilotCommand::Nothing => None,
                _ => Some("no command of MAVLink".into()),
            };
            if let Some(why) = why {
                wrong.push((at, format!("{}: {why}", commanded.command)));
            }
        }
        wrong
    }

    /// Why a command to a running engine cannot come from the stream.
    fn unexplained_run(
        &self,
        words: &Words<'_>,
        at: u64,
        tenths: u32,
        stopped: Option<u64>,
    ) -> Option<String> {
        let earliest = at - words.tolerance(at).min(at);
        if let Some(stopped) = stopped {
            return Some(format!("stopped at {}, and nobody has started it since", seconds(stopped)));
        }
        if !words.mavlink.has_output {
            let alive = words
                .received(at.saturating_sub(HEARTBEAT + TICK), at)
                .iter()
                .any(|received| matches!(received.word, Word::Station | Word::Vehicle { .. }));
            return (tenths > 0 || !alive).then(|| "its demand has no source, or nobody is there".into());
        }
        let most = words.now(at).filter_map(|word| match word {
            Word::Output { tenths, .. } => tenths,
            _ => None,
        });
        let disarmed = words.shows(at) == Some(false) || words.may_show(earliest, at, false);
        let Some(most) = most.max() else {
            // Disarmed is idle without a stream, too.
            return (tenths > 0 || !disarmed).then(|| "no frame of the stream came".into());
        };
        if tenths > most {
            return Some(format!("the stream has {}", Demanded::Throttle(most)));
        }
        // A frame may precede the heartbeat among the bytes that are read at one instant.
        let disarmed =
            words.shows(earliest.saturating_sub(1)) == Some(false) && words.shows(at) == Some(false);
        (tenths > 0 && disarmed && !words.may_show(earliest, at, true))
            .then(|| "the vehicle is disarmed".into())
    }

    /// Why a start that was received must not be passed on.
    fn unexplained_start(
        &self,
        words: &Words<'_>,
        at: u64,
        earliest: u64,
        while_disarmed: bool,
    ) -> Option<String> {
        let rules = &self.h.rules;
        if !while_disarmed && !words.may_show(earliest, at, true) {
            return Some("a start, and the vehicle is disarmed".into());
        }
        if !words.mavlink.has_output {
            let alive = words.received(at.saturating_sub(HEARTBEAT), at).iter();
            let alive =
                alive.clone().any(|received| matches!(received.word, Word::Station | Word::Vehicle { .. }));
            return (!alive).then(|| "a start, and nobody is there".into());
        }
        match words.throttle_of_start(earliest.saturating_sub(rules.ages[MAVLINK]), earliest, at) {
            None => Some("a start, and no stream".into()),
            Some(tenths) if tenths > rules.idle_band && !words.mavlink.relight => {
                // Several may be found at once.
                (words.tolerance(at) == 0).then(|| format!("a start, with {}", Demanded::Throttle(tenths)))
            }
            Some(_) => None,
        }
    }

    /// Whether a command of MAVLink follows a word in time.
    fn commands(&self, words: &Words<'_>, at: u64, is: impl Fn(PilotCommand) -> bool) -> bool {
        let late = words.late.touches(at, at + 1);
        let by = at + if late { FOUND_LATE } else { 0 };
        self.h.commanded(at, by).iter().any(|it| it.source == MAVLINK && is(it.command))
    }

    /// Orders from a person, and from a disarmed vehicle, take effect at once.
    fn not_obeyed(&self, words: &Words<'_>) -> Vec<(u64, String)> {
        let h = self.h;
        let mut wrong = Vec::new();
        let cut = |at: u64| h.resets.iter().any(|reset| (at..at + FOUND_LATE).contains(&reset.down));
        for Received { at, word } in
            words.mavlink.received.iter().filter(|received| received.at > words.known && !cut(received.at))
        {
            let (wanted, what) = match word {
                Word::Stop => (PilotCommand::ShutDown, "a stop"),
                Word::EmergencyStop => (PilotCommand::Stop, "an emergency stop"),
                Word::Release => (PilotCommand::Release, "a release"),
                _ => continue,
            };
            // By its header, a damaged frame may include the bytes after it, which are skipped.
            if !words.late.contains(*at) && !self.commands(words, *at, |command| command == wanted) {
                wrong.push((*at, format!("{what} was commanded, and nothing comes of it")));
            }
        }
        for pair in words.shown.windows(2) {
            let (at, shown) = pair[1];
            let disarms = pair[0].1 == Some(true) && shown == Some(false);
            let Some(sure) = words.surely_shown(at, false).filter(|_| disarms) else { continue };
            let reset = h.resets.iter().any(|reset| (at..sure + FOUND_LATE).contains(&reset.down));
            let mut commands = h.commanded(at, sure).iter().filter(|it| it.source == MAVLINK);
            if pair[0].0 > words.known && !reset && !commands.any(|it| it.command == PilotCommand::Disarm) {
                wrong.push((at, "the vehicle was disarmed, and its engine is not".into()));
            }
        }
        wrong
    }

    /// The demand of an engine that only MAVLink commands is that of every frame of the stream.
    fn not_followed(&mut self, words: &Words<'_>) -> Vec<(u64, String)> {
        let h = self.h;
        let mut wrong = Vec::new();
        let mut frames = 0;
        for Received { at, word } in &words.mavlink.received {
            let (at, Word::Output { tenths: Some(tenths), sure: true }) = (*at, *word) else { continue };
            let lately = h.commanded(at.saturating_sub(RISEN + 5 * SECOND), at);
            let flies = lately.iter().rev().find(|it| it.source == MAVLINK && it.at < at);
            let flies =
                flies.is_some_and(|it| matches!(it.command, PilotCommand::Run(_)) && it.at + SECOND > at);
            let alone = lately.iter().all(|it| {
                it.source == MAVLINK && matches!(it.command, PilotCommand::Run(_) | PilotCommand::Arm)
                    || it.command == PilotCommand::Nothing
            });
            let wire = h.frames_within(at.saturating_sub(SECOND), at + SECOND).iter();
            let mut switches = wire.filter_map(|frame| frame.sent.switch());
            let runs = switches.all(|switch| switch == Switch::Run)
                && h.samples(at.saturating_sub(RISEN), at + SECOND)
                    .iter()
                    .all(|sample| sample.runs() && !sample.fault);
            let trouble = self.blind.union(&h.noise).union(&self.down);
            if !flies
                || !alone
                || !runs
                || words.tolerance(at) > 0
                || at < self.up(at) + KNOWN + RISEN
                || trouble.touches(at.saturating_sub(RISEN), at + SECOND)
            {
                continue;
            }
            frames += 1;
            let now = h.commanded(at, at).iter().rev().find(|it| it.source == MAVLINK);
            let since = at.saturating_sub(RISEN);
            let rise = words.rises_for(since, at) * u64::from(h.rules.rise) / SECOND;
            let held = words.may_show(since, at, false) || words.shows(at) != Some(true) || rise < 1000;
            let text = match now.map(|it| it.command) {
                Some(PilotCommand::Run(Demanded::Throttle(now))) if now.abs_diff(tenths) <= 1 || held => {
                    continue;
                }
                Some(command) => format!("{command}"),
                None => "nothing".into(),
            };
            let stream = Demanded::Throttle(tenths);
            wrong.push((at, format!("{text} is commanded, and the stream has {stream}")));
            if wrong.len() > 3 {
                break;
            }
        }
        self.verdict.count("frames of a stream that had to be followed", frames);
        wrong
    }

    /// A start that is received as documented begins, and its answer is true.
    fn not_started(&mut self, words: &Words<'_>) -> Vec<(u64, String)> {
        let h = self.h;
        let rules = &h.rules;
        let mut wrong = Vec::new();
        let mut had_to_begin = 0;
        let begun = |at: u64| {
            h.commanded(at, at).windows(2).any(|pair| {
                let own = pair.iter().all(|it| it.source == MAVLINK);
                own && pair[0].command == PilotCommand::Standby
                    && matches!(pair[1].command, PilotCommand::Run(_))
            })
        };
        for Answered { at, .. } in words.mavlink.answers.iter().filter(|answer| answer.accepted) {
            let says = |word: Word| matches!(word, Word::Start { .. } | Word::Stop);
            if !words.now(*at).any(says) && words.tolerance(*at) == 0 {
                wrong.push((*at, "an unsolicited command is accepted".into()));
            }
        }
        let mut before: Option<u64> = None;
        for (at, while_disarmed) in words.starts.iter().copied() {
            let previous = before.replace(at);
            if words.late.touches(at.saturating_sub(FOUND_LATE), at + 1) {
                continue;
            }
            let answers = words.mavlink.answers.iter().filter(|answer| answer.at == at);
            let accepted = answers.clone().any(|answer| answer.accepted);
            let known = at > self.up(at) + KNOWN;
            if answers.count() == 0 && at > words.known {
                wrong.push((at, "a start is not answered".into()));
            }
            if accepted && !begun(at) {
                wrong.push((at, "a start is accepted, and is not begun".into()));
            }
            let since = at.saturating_sub(6 * SECOND);
            let wire: Vec<_> = h.frames_within(at.saturating_sub(3 * SECOND), at).iter().collect();
            let standby = wire.iter().filter_map(|frame| frame.sent.switch()).collect::<Vec<_>>();
            let standby = standby.len() > 2 && standby.iter().all(|switch| *switch == Switch::Standby);
            let quiet = h.commanded(since, at.saturating_sub(1)).iter().all(|it| {
                let stopped =
                    matches!(it.command, PilotCommand::Nothing | PilotCommand::Arm | PilotCommand::Standby);
                it.source == MAVLINK && stopped
            });
            // After an emergency stop its release, and then the vehicle has to be shown disarmed.
            let last = |command: PilotCommand| {
                h.commanded(0, at).iter().rev().find(|it| it.command == command).map(|it| it.at)
            };
            let stops = last(PilotCommand::Stop).is_some_and(|stop| {
                let released = last(PilotCommand::Release).filter(|released| *released > stop + SECOND);
                released.is_none_or(|released| {
                    let disarmed = |(when, armed): &(u64, Option<bool>)| {
                        *when > released + SECOND && *when < at && *armed == Some(false)
                    };
                    !words.shown.iter().any(disarmed)
                })
            }) || h.resets.iter().any(|reset| reset.cause == Cause::BrownOut);
            let cold = |sample: &Sample| {
                sample.phase == Phase::Standby && !sample.fault && sample.egt < rules.egt_max - 15.0
            };
            let cold = h.samples(since, at).iter().all(cold);
            let armed = words.shows(since) == Some(true) && !words.may_show(since, at, false);
            let idle =
                !words.mavlink.has_output
                    || words.received(at.saturating_sub(300 * MS), at).iter().any(|received| {
                        matches!(received.word, Word::Output { tenths: Some(_), sure: true })
                    }) && words.received(since, at).iter().all(|received| match received.word {
                        Word::Output { tenths, .. } => tenths.is_some_and(|tenths| tenths <= rules.idle_band),
                        _ => true,
                    });
            let present = words
                .received(at.saturating_sub(4 * SECOND), at)
                .iter()
                .any(|received| received.word == Word::Station);
            let alone = rules.start_wait == 0 && previous.is_none_or(|previous| at > previous + 30 * SECOND);
            if !(standby && cold && quiet && armed && idle && present && known && alone)
                || stops
                || while_disarmed
            {
                continue;
            }
            had_to_begin += 1;
            if !begun(at) && !h.commanded(at, at).iter().any(|it| it.command == PilotCommand::Standby) {
                wrong.push((at, "a start is commanded as documented, and is not begun".into()));
            }
        }
        self.verdict.count("starts of MAVLink that had to begin", had_to_begin);
        wrong
    }
}
