//! Radio control commands what stick and switches show, as the judge itself decodes the receiver's frames, and all that they
//! show.

use super::case::{Case, Rule};
use super::receiver::{HeldStop, Shown, Sight, read};
use crate::history::{Demanded, MS, PilotCommand, Position, SECOND, Switch};

const RC: usize = 1;
/// Time for which a switch and a stick have to be steady: 0.5 s, by frames that are up to 20 ms apart.
const STEADY: u64 = 500 * MS;
const FRAMES: u64 = 50 * MS;
/// Time after which something certainly counts as steady. The document does not say whether that begins with the frame that shows
/// it or with the one that counts.
const SURELY: u64 = STEADY + FRAMES;

impl Case<'_> {
    pub(super) fn sticks(&mut self) {
        let Some(radio) = &self.h.radio else { return };
        let ups: Vec<u64> = self.h.resets.iter().map(|reset| reset.up).collect();
        let frames = read(radio, &ups, self.h.rules.idle_band);
        let mut wrong = Vec::new();
        let mut commands = self.h.commanded.iter().filter(|each| each.source == RC).peekable();
        let pwm = self.h.commanded.iter().find(|each| each.command == PilotCommand::Pwm);
        let mut last = Last { pwm: pwm.map(|each| each.at), ..Last::default() };
        for (at, shown) in &frames {
            let at = *at;
            // Commands come with frames, and at no other time.
            while let Some(stray) = commands.next_if(|each| each.at < at) {
                wrong.push((stray.at, format!("{}: no frame came", stray.command)));
            }
            let mut given = Vec::new();
            while let Some(each) = commands.next_if(|each| each.at == at) {
                given.push(each.command);
            }
            for command in &given {
                if let Err(why) = self.may(at, shown.as_ref(), *command, &last) {
                    wrong.push((at, format!("{command}: {why}; the frame shows {shown:?}")));
                }
            }
            if let Some(why) = shown.as_ref().and_then(|shown| self.must(at, shown, &given, &last)) {
                wrong.push((at, format!("{why}, and commanded is {given:?}; the frame shows {shown:?}")));
            }
            last.note(at, &given);
        }
        wrong.extend(commands.map(|stray| (stray.at, format!("{}: no frame came", stray.command))));
        self.verdict.count("frames of radio control", frames.len() as u64);
        for (at, text) in wrong.into_iter().take(3) {
            self.verdict.finding(Rule::Sticks, at, text);
        }
    }

    /// The switches on the wire in this time: none, all the same, or several.
    fn switches(&self, from_us: u64, to_us: u64) -> Wire {
        let mut wire = Wire::Nothing;
        for switch in self.h.frames_within(from_us, to_us + 1).iter().filter_map(|frame| frame.sent.switch())
        {
            wire = match wire {
                Wire::Nothing => Wire::All(switch),
                Wire::All(before) if before == switch => wire,
                _ => Wire::Mixed,
            };
        }
        wire
    }

    fn lately(&self) -> u64 {
        3 * self.h.rules.period + 20 * MS
    }

    /// Another source has recently commanded this.
    fn others(&self, at: u64, within: u64, is: impl Fn(PilotCommand) -> bool) -> bool {
        self.h
            .commanded(at.saturating_sub(within), at)
            .iter()
            .any(|each| each.source != RC && is(each.command))
    }

    /// Whether a command is what the frame shows.
    fn may(
        &self,
        at: u64,
        shown: Option<&Shown>,
        command: PilotCommand,
        last: &Last,
    ) -> Result<(), &'static str> {
        // A stop that is held counts, whatever else the frame shows.
        let held_stop = |held: Option<HeldStop>, otherwise| {
            let held = held.is_some_and(|held| held.counts(-(FRAMES as i64)));
            let stop = matches!(command, PilotCommand::Stop | PilotCommand::Disarm);
            if held && stop { Ok(()) } else { Err(otherwise) }
        };
        let sight = match shown {
            None => return Err("the values of this frame do not count"),
            Some(Shown::Unreadable(held)) => return held_stop(*held, "a channel cannot be read"),
            Some(Shown::Sight(sight)) => sight,
        };
        if !sight.counts {
            return held_stop(sight.stop, "the switch has not been there for long enough");
        }
        let released = || {
            let moved = sight.moved.is_some_and(|moved| moved.from == Position::Stop);
            if sight.position != Position::Standby || !moved {
                return Err("the switch has not moved from stop to standby");
            }
            if is_steady(at + FRAMES, sight) { Ok(()) } else { Err("stick and switch are not steady") }
        };
        match command {
            PilotCommand::Stop | PilotCommand::Disarm if sight.position == Position::Stop => Ok(()),
            PilotCommand::Stop | PilotCommand::Disarm => Err("the switch is not at stop"),
            _ if sight.position == Position::Stop => Err("the switch is at stop"),
            PilotCommand::Nothing => Ok(()),
            PilotCommand::Release => released(),
            _ if sight.handed_over => Err("it is handed over"),
            PilotCommand::Arm => released(),
            PilotCommand::Run(Demanded::Throttle(tenths)) => {
                if sight.position != Position::Run {
                    return Err("the switch is not at run");
                }
                if tenths.abs_diff(sight.tenths) > 1 {
                    return Err("the stick is elsewhere");
                }
                if self.would_start(at, last) { starts(sight, at) } else { Ok(()) }
            }
            PilotCommand::Standby => self.may_shut_down(at, sight),
            _ => Err("no position of a switch says that"),
        }
    }

    /// Whether run commands a start: standby is being sent, no other source has just started the engine, and it is not the stream
    /// of a start that waits.
    fn would_start(&self, at: u64, last: &Last) -> bool {
        let streams = last.run.is_some_and(|run| at <= run + 100 * MS);
        let by_another = || self.others(at, SECOND, |command| matches!(command, PilotCommand::Run(_)));
        let standby = || {
            // An order from before a reset is no longer in force.
            let ups = self.h.resets.iter().map(|reset| reset.up).filter(|up| *up <= at);
            let wire = self.switches(at.saturating_sub(self.lately()).max(ups.max().unwrap_or(0)), at);
            matches!(wire, Wire::All(Switch::Standby | Switch::Stop))
        };
        !streams && standby() && !by_another()
    }

    /// Standby for a healthy running engine: the switch was received as it moved there from run.
    fn may_shut_down(&self, at: u64, sight: &Sight) -> Result<(), &'static str> {
        let moved = sight.position == Position::Standby
            && sight.moved.is_some_and(|moved| moved.from == Position::Run);
        if moved || !self.is_healthy(at) {
            return Ok(());
        }
        Err("the engine runs, and the switch has not moved from run to standby")
    }

    /// It runs, is sent run, and only a command could end that.
    fn is_healthy(&self, at: u64) -> bool {
        if !self.runs.contains(at) {
            return false;
        }
        let rules = &self.h.rules;
        let from = at.saturating_sub(5 * SECOND);
        let limits = rules.limit_egt.is_none()
            && rules.limit_rpm.is_none()
            && rules.limit_fault.is_none()
            && rules.limit_changes == [None; 4];
        let quiet = !self.hidden.touches(from, at)
            && !self.blind.touches(from, at)
            && !self.faults.touches(from, at)
            && !self.h.deaf.touches(from, at)
            && !self.h.pwm.touches(from, at)
            && !self.h.sensor.touches(from, at);
        let by_another = || {
            self.others(at, 12 * SECOND, |command| {
                !matches!(command, PilotCommand::Run(_) | PilotCommand::Nothing | PilotCommand::Arm)
            })
        };
        let sent = || self.switches(at.saturating_sub(self.lately()), at) == Wire::All(Switch::Run);
        let runs = self.h.samples(from, at).iter().all(|sample| sample.runs());
        limits && rules.standby_after.is_none() && quiet && runs && !by_another() && sent()
    }

    /// What this frame had to command, and did not.
    fn must(&self, at: u64, shown: &Shown, given: &[PilotCommand], last: &Last) -> Option<String> {
        let has = |wanted: PilotCommand| given.contains(&wanted);
        let held_stop = |held: Option<HeldStop>, text: &str| {
            let held = held.is_some_and(|held| held.counts(FRAMES as i64));
            (held && !has(PilotCommand::Stop)).then(|| text.into())
        };
        let sight = match shown {
            Shown::Unreadable(held) => {
                return held_stop(*held, "the switch is at stop beside a channel that cannot be read");
            }
            Shown::Sight(sight) if !sight.counts => {
                return held_stop(sight.stop, "the switch has been at stop for long enough");
            }
            Shown::Sight(sight) => sight,
        };
        if sight.position == Position::Stop {
            return (!has(PilotCommand::Stop)).then(|| "the switch is at stop".into());
        }
        // A start that was refused because nothing was steady takes one frame.
        let moves = sight.moved.is_some_and(|moved| moved.at == at);
        if given.is_empty() && !moves {
            return Some("the receiver works".into());
        }
        if sight.handed_over {
            return None;
        }
        let wire = self.switches(at.saturating_sub(self.lately()), at);
        let after = self.switches(at, at + self.lately());
        let stays = |switch: Switch| {
            wire == Wire::All(switch)
                && after == Wire::All(switch)
                && self.switches(at.saturating_sub(SECOND), at) == Wire::All(switch)
        };
        match (sight.position, sight.moved) {
            (Position::Run, _) if stays(Switch::Run) && self.runs.contains(at) => {
                let is_right = |command: &PilotCommand| match command {
                    PilotCommand::Run(Demanded::Throttle(tenths)) => tenths.abs_diff(sight.tenths) <= 1,
                    _ => false,
                };
                let pwm = last.pwm.is_some_and(|pwm| pwm <= at);
                (!pwm && !given.iter().any(is_right)).then(|| "the switch is at run".into())
            }
            // The first frames after a move.
            (Position::Run, Some(moved)) if moved.at == at => {
                let steady = moved.from == Position::Standby
                    && moved.reached >= moved.left_counted + SURELY
                    && sight.idle.is_some_and(|idle| moved.reached >= idle + SURELY);
                let starts = given.iter().any(|command| matches!(command, PilotCommand::Run(_)));
                let ready = steady && self.is_in_standby(at);
                (ready && !starts).then(|| "a start by the switch with the stick at idle".into())
            }
            (Position::Standby, Some(moved)) if moved.from == Position::Run && at < moved.at + 250 * MS => {
                let runs = wire == Wire::All(Switch::Run) && self.runs.contains(at);
                let is_late = runs && !sight.was_handed_over && !has(PilotCommand::Standby);
                is_late.then(|| "the switch has moved to standby".into())
            }
            (Position::Standby, Some(moved)) if moved.from == Position::Stop => {
                let steady = at >= moved.at + SURELY && sight.idle.is_some_and(|idle| at >= idle + SURELY);
                let since = |when: Option<u64>| when.is_some_and(|when| when >= moved.at);
                if !steady || sight.was_handed_over {
                    return None;
                }
                // A higher source has just released it, and no frame has been sent since.
                let just = self.h.commanded(at.saturating_sub(self.lately()), at).iter();
                let released =
                    just.clone().any(|each| each.source < RC && each.command == PilotCommand::Release);
                if wire == Wire::All(Switch::Stop)
                    && !since(last.release)
                    && !released
                    && !has(PilotCommand::Release)
                    && self.switches(at.saturating_sub(SECOND), at) == wire
                {
                    return Some("a stop is to be released".into());
                }
                (self.is_in_standby(at) && !since(last.arm) && !has(PilotCommand::Arm))
                    .then(|| "the engine is to be armed".into())
            }
            _ if self.is_in_standby(at) && given.iter().all(|command| *command == PilotCommand::Nothing) => {
                Some("radio control is in control in standby".into())
            }
            _ => None,
        }
    }

    /// Standby is ordered for an engine that is known to be at rest, and stays ordered.
    fn is_in_standby(&self, at: u64) -> bool {
        let from = at.saturating_sub(3 * SECOND);
        let standby = Wire::All(Switch::Standby);
        let after = self.switches(at, at + self.lately());
        self.switches(at.saturating_sub(SECOND), at) == standby
            && (after == standby || after == Wire::Mixed)
            && !self.hidden.touches(from, at + SECOND)
            && !self.blind.touches(from, at + SECOND)
            && !self.down.touches(from, at + SECOND)
            && !self.h.deaf.touches(from, at + SECOND)
            && !self.others(at, SECOND, |command| {
                matches!(command, PilotCommand::Run(_) | PilotCommand::Stop | PilotCommand::Pwm)
            })
    }
}

/// What is sent in an interval.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Wire {
    Nothing,
    All(Switch),
    Mixed,
}

/// When radio control last commanded each of these, and other values that do not depend on a frame.
#[derive(Default)]
struct Last {
    run: Option<u64>,
    release: Option<u64>,
    arm: Option<u64>,
    /// The first hand-over to the PWM input.
    pwm: Option<u64>,
}

impl Last {
    fn note(&mut self, at: u64, given: &[PilotCommand]) {
        for command in given {
            match command {
                PilotCommand::Run(_) => self.run = Some(at),
                PilotCommand::Release => self.release = Some(at),
                PilotCommand::Arm => self.arm = Some(at),
                _ => {}
            }
        }
    }
}

/// Stick at idle and switch at standby for 0.5 s.
fn is_steady(at: u64, sight: &Sight) -> bool {
    sight.idle.is_some_and(|idle| at >= idle + STEADY) && at >= sight.held + STEADY
}

/// The switch was received as it moved from standby to run, both held for 0.5 s with the stick at idle.
fn starts(sight: &Sight, at: u64) -> Result<(), &'static str> {
    let Some(moved) = sight.moved else { return Err("a start, and the switch was found at run") };
    if at > moved.at + FRAMES || moved.from != Position::Standby {
        return Err("a start, and the switch has not just moved from standby to run");
    }
    let steady = moved.reached + FRAMES >= moved.left_since + STEADY
        && sight.idle.is_some_and(|idle| at + FRAMES >= idle + STEADY);
    if steady { Ok(()) } else { Err("a start, and stick and switch were not steady") }
}
