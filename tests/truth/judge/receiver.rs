//! The judge's own decoder of a receiver: which frames count, and what stick and switches show. Written from `docs/rc.md` and the
//! public description of SBUS, not from the decoder or the pilot of `jetlink-rc`.

use crate::history::{MS, Position, Radio, RadioRules, SBUS, SECOND};

/// Longest time between two frames of three.
const APART: u64 = 50 * MS;
/// A frame takes this time on the line.
const ON_THE_LINE: u64 = 3 * MS;
/// A longer time without readable frames is a pause.
const PAUSE: u64 = 200 * MS;
/// Positions that are found within this time after a pause are not moves, and have to be held for longer before
/// they count.
const RETURN: u64 = SECOND;
const HELD: u64 = 60 * MS;
const HELD_AFTER_A_PAUSE: u64 = 300 * MS;
/// A throttle that steps by this much, in µs, and back by as much within this time, three times in a row, is not a stick.
const STEP: u16 = 200;
const STEPS_APART: u64 = 100 * MS;
const IN_TURNS: u8 = 3;
/// Time from the last such step for which it counts as silence.
const SILENT: u64 = SECOND;
/// Shortest pulse of a stop that counts because it is held, µs.
const DRIVEN: u16 = 900;
/// Time for which such a stop is held, without a pause and in all.
const HELD_STOP: u64 = 300 * MS;
const HELD_STOP_IN_ALL: u64 = 600 * MS;

/// Channels of a frame, in the numbers of SBUS.
type Channels = [u16; 16];

/// A switch move that was received.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Move {
    pub from: Position,
    /// When the position that it left was first shown and when it counted, when the one that it reached was shown, and when that counted.
    pub left_since: u64,
    pub left_counted: u64,
    pub reached: u64,
    pub at: u64,
}

/// What counts with a frame whose channels can all be read.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Sight {
    /// 0.1 %.
    pub tenths: u32,
    pub position: Position,
    /// The position counts, and so does that of the hand-over switch.
    pub counts: bool,
    /// Since when the position that counts has been shown, and no other that counted.
    pub held: u64,
    pub handed_over: bool,
    /// Since when the stick has been at idle.
    pub idle: Option<u64>,
    /// The received move to the position that counts; `None`: the position was found.
    pub moved: Option<Move>,
    /// The engine has been handed over since that move, by a hand-over channel that counted.
    pub was_handed_over: bool,
    pub stop: Option<HeldStop>,
}

/// Frames with the switch at stop, whether the other channels can be read or not, and no frame with another position between.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct HeldStop {
    /// The first one since a pause, and the last one.
    since: u64,
    last: u64,
    /// Without the pauses, each shorter than 1 s.
    in_all: u64,
}

impl HeldStop {
    /// Whether it has been held for long enough, by this much more or less.
    pub(super) fn counts(&self, more: i64) -> bool {
        let is = |held: u64, needed: u64| held as i64 >= needed as i64 + more;
        is(self.last - self.since, HELD_STOP) || is(self.in_all, HELD_STOP_IN_ALL)
    }
}

/// A frame with values that count.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Shown {
    Sight(Sight),
    /// A channel cannot be read.
    Unreadable(Option<HeldStop>),
}

/// What each frame shows, in the order of time; `None`: its values do not count. `ups`: when a node began.
pub(super) fn read(radio: &Radio, ups: &[u64], idle_band: u32) -> Vec<(u64, Option<Shown>)> {
    let mut ups = ups.iter().copied().peekable();
    let (mut row, mut eyes) = (Row::default(), Eyes::default());
    let frames = radio.frames.iter().map(|(at, frame)| {
        while ups.next_if(|up| up <= at).is_some() {
            (row, eyes) = (Row::default(), Eyes::default());
        }
        let shown = row.frame(*at, frame).map(|channels| eyes.see(*at, &radio.rules, &channels, idle_band));
        (*at, shown)
    });
    frames.collect()
}

/// The good frames so far: a value counts when it is the median of three.
#[derive(Default)]
struct Row {
    /// The line has paused since the node began: from then on a frame can be recognised by its beginning.
    has_paused: bool,
    frames: Vec<Channels>,
    last: Option<u64>,
}

impl Row {
    fn frame(&mut self, at: u64, frame: &[u8; SBUS]) -> Option<Channels> {
        let has_paused = core::mem::replace(&mut self.has_paused, true);
        if !has_paused || frame[0] != 0x0F {
            // Not the beginning of a frame.
            return None;
        }
        let [flags, end] = [frame[23], frame[24]];
        // SBUS 2 ends its frames with one of four numbers.
        let is_good = [0x00, 0x04, 0x14, 0x24, 0x34].contains(&end) && flags < 0x10;
        let (is_lost, is_fail_safe) = (flags & 4 != 0, flags & 8 != 0);
        if !is_good || is_fail_safe {
            self.frames.clear();
            return None;
        }
        let too_fast = self.last.is_some_and(|last| at < last + ON_THE_LINE);
        if is_lost || too_fast {
            return None;
        }
        if self.last.replace(at).is_some_and(|last| at > last + APART) {
            self.frames.clear();
        }
        let bit = |bit: usize| u16::from(frame[1 + bit / 8] >> (bit % 8) & 1);
        let channel = |number: usize| (0..11).map(|each| bit(11 * number + each) << each).sum();
        self.frames.push(std::array::from_fn(channel));
        let [.., first, second, third] = self.frames[..] else { return None };
        self.frames.remove(0);
        let median = |number: usize| {
            let mut three = [first, second, third].map(|channels| channels[number]);
            three.sort_unstable();
            three[1]
        };
        Some(std::array::from_fn(median))
    }
}

/// What is shown and what counts, and since when.
#[derive(Default)]
struct Eyes {
    /// The last frame that could be read, and the first one since a pause.
    last: Option<u64>,
    since: u64,
    /// What counts; it outlives a pause.
    position: Option<Position>,
    hand_over: Option<bool>,
    /// What is shown, since when.
    shown: Option<(Position, u64)>,
    hand_over_shown: Option<(bool, u64)>,
    /// Since when what counts was shown, and when it counted.
    counted_since: u64,
    counted_at: u64,
    idle: Option<u64>,
    moved: Option<Move>,
    was_handed_over: bool,
    stop: Option<HeldStop>,
    /// The throttle of the last frame, its last step and whether it went up, how many steps alternated, and until when it is no
    /// stick.
    throttle: Option<u16>,
    step: Option<(u64, bool)>,
    steps: u8,
    none_until: u64,
}

impl Eyes {
    /// Whether two senders move the throttle alternately.
    fn goes_to_and_fro(&mut self, at: u64, throttle: u16) -> bool {
        let before = self.throttle.replace(throttle).unwrap_or(throttle);
        if throttle.abs_diff(before) >= STEP {
            let up = throttle > before;
            let back = self.step.is_some_and(|(last, was_up)| up != was_up && at <= last + STEPS_APART);
            self.steps = if back { self.steps.saturating_add(1) } else { 1 };
            self.step = Some((at, up));
            if self.steps >= IN_TURNS {
                self.none_until = at + SILENT;
            }
        }
        at < self.none_until
    }

    fn see(&mut self, at: u64, rules: &RadioRules, channels: &Channels, idle_band: u32) -> Shown {
        // 992 is 1500 µs, and 8 steps are 5 µs.
        let pulse = |number: u8| {
            let steps = i32::from(channels[usize::from(number) - 1]) - 992;
            (1500.0 + f64::from(steps) * 5.0 / 8.0).round() as u16
        };
        let (throttle, switch) = (pulse(rules.throttle), pulse(rules.switch));
        let position = position(rules, switch);
        let hand_over = match rules.hand_over {
            0 => Some(false),
            number => match pulse(number) {
                ..=1300 => Some(false),
                1700.. => Some(true),
                _ => None,
            },
        };
        let driven = throttle >= DRIVEN || throttle + 10 >= rules.low;
        let in_range =
            driven && throttle + rules.beyond >= rules.low && throttle <= rules.high + rules.beyond;
        let in_turns = self.goes_to_and_fro(at, throttle);
        self.see_stop(at, position == Some(Position::Stop) && switch >= DRIVEN);
        let (Some(position), Some(hand_over), true) = (position, hand_over, in_range && !in_turns) else {
            return Shown::Unreadable(self.stop);
        };
        if self.last.replace(at).is_none_or(|last| at > last + PAUSE) {
            self.since = at;
            (self.shown, self.hand_over_shown, self.idle, self.moved) = (None, None, None, None);
            (self.counted_since, self.counted_at) = (at, at);
        }
        let returns = at < self.since + RETURN;
        let hold = if returns { HELD_AFTER_A_PAUSE } else { HELD };
        let share = f64::from(throttle.clamp(rules.low, rules.high) - rules.low)
            / f64::from(rules.high - rules.low)
            * 1000.0;
        let tenths = (if rules.reversed { 1000.0 - share } else { share }).round() as u32;
        self.idle = (tenths <= idle_band).then_some(self.idle.unwrap_or(at));
        let same = self.shown.filter(|(before, _)| *before == position);
        let shown = same.map_or(at, |(_, since)| since);
        self.shown = Some((position, shown));
        let at_once = position == Position::Stop && !returns;
        let mut counts = self.position == Some(position);
        if !counts && (at_once || at >= shown + hold) {
            counts = true;
            let from = self.position.replace(position);
            let left_since = core::mem::replace(&mut self.counted_since, shown);
            let left_counted = core::mem::replace(&mut self.counted_at, at);
            let moved = |from| Move { from, left_since, left_counted, reached: shown, at };
            self.moved = from.filter(|_| !returns).map(moved);
            self.was_handed_over = false;
        }
        let same = self.hand_over_shown.filter(|(before, _)| *before == hand_over);
        let hand_over_shown = same.map_or(at, |(_, since)| since);
        self.hand_over_shown = Some((hand_over, hand_over_shown));
        if at >= hand_over_shown + hold {
            self.hand_over = Some(hand_over);
        }
        let hand_over_counts = self.hand_over == Some(hand_over) || position == Position::Stop;
        self.was_handed_over |= self.hand_over == Some(true);
        Shown::Sight(Sight {
            tenths,
            position,
            held: self.counted_since,
            counts: counts && hand_over_counts,
            handed_over: hand_over,
            idle: self.idle,
            moved: self.moved.filter(|_| self.position == Some(position)),
            was_handed_over: self.was_handed_over,
            stop: self.stop,
        })
    }

    fn see_stop(&mut self, at: u64, at_stop: bool) {
        self.stop = at_stop.then_some(match self.stop {
            Some(stop) if at <= stop.last + PAUSE => {
                HeldStop { last: at, in_all: stop.in_all + (at - stop.last), ..stop }
            }
            Some(stop) if at < stop.last + SECOND => HeldStop { since: at, last: at, ..stop },
            _ => HeldStop { since: at, last: at, in_all: 0 },
        });
    }
}

fn position(rules: &RadioRules, pulse: u16) -> Option<Position> {
    let pulse = if rules.switch_reversed { 3000 - pulse } else { pulse };
    match pulse {
        _ if pulse <= rules.stop => Some(Position::Stop),
        _ if pulse >= rules.run => Some(Position::Run),
        _ if (rules.stop + 100..=rules.run - 100).contains(&pulse) => Some(Position::Standby),
        _ => None,
    }
}
