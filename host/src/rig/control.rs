//! Control of a run: nothing, a script file, or a person at the keyboard.

use super::context::Stage;
use super::ending::EndRequest;
use super::passing::{Passing, SPEEDS};
use super::play::action::{Action, Wish};
use super::sample::Sample;
use super::tour::Tour;
use embassy_time::{Duration, Instant};
use sim::clock::Pace;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration as WallDuration;

/// Interval at which a paused run checks for its end.
const LOOK_EVERY: WallDuration = WallDuration::from_millis(50);
/// Time from the last action of a script file without an end to the end of the run, if an engine was not given back
/// because its stop was not released.
const AFTER_LAST: Duration = Duration::from_secs(10);

/// Situation as the control sees it.
#[derive(Debug)]
pub struct Situation<'a> {
    /// The engine time.
    pub at: Instant,
    /// All engines.
    pub samples: &'a [Sample],
    /// All pilots are done, and no engine is played.
    pub complete: bool,
    /// An engine is played.
    pub played: bool,
}

/// Actions to take now.
#[derive(Debug, Default)]
pub struct Turn {
    /// Of a script file. They come before those of the keys.
    pub scripted: Vec<Action>,
    /// Of the keys, to these engines (`None`: to all).
    pub wishes: Vec<(Option<usize>, Wish)>,
    /// From now on at this pace.
    pub pace: Option<Pace>,
    /// The new passing of time, if it has changed.
    pub passing: Option<Passing>,
    /// The script file has come to its end: the verdict is shown, and a person decides what comes next.
    pub over: bool,
    /// The run ends.
    pub end: bool,
    /// No engine time passes: another turn follows.
    pub again: bool,
}

/// Steers a run. It is called ten times per second of engine time.
pub trait Control {
    /// Returns the actions to take now. It may wait; then no engine time passes.
    fn turn(&mut self, situation: &Situation<'_>) -> Turn;
}

/// No control: the run takes its course to its end.
#[derive(Clone, Copy, Debug)]
pub struct Unattended;

impl Control for Unattended {
    fn turn(&mut self, situation: &Situation<'_>) -> Turn {
        Turn { end: situation.complete, ..Turn::default() }
    }
}

/// The actions of a script file.
#[derive(Debug)]
pub struct Scripted {
    actions: Vec<(Instant, Action)>,
    next: usize,
    end: Option<Instant>,
}

impl Scripted {
    /// These actions, in the order of time; and the end, if the run has none of its own.
    pub fn new(actions: Vec<(Instant, Action)>, end: Option<Duration>) -> Self {
        Self { actions, next: 0, end: end.map(|end| Instant::MIN + end) }
    }

    fn last_at(&self) -> Instant {
        self.actions.last().map_or(Instant::MIN, |(at, _)| *at)
    }
}

impl Control for Scripted {
    fn turn(&mut self, situation: &Situation<'_>) -> Turn {
        let due = self.actions.iter().skip(self.next).take_while(|(at, _)| *at <= situation.at);
        let scripted: Vec<Action> = due.map(|(_, action)| *action).collect();
        self.next += scripted.len();
        let all_done = self.next == self.actions.len();
        let end = match self.end {
            Some(end) => situation.at >= end,
            None if situation.played => all_done && self.last_at() + AFTER_LAST <= situation.at,
            None => situation.complete && all_done && scripted.is_empty(),
        };
        Turn { scripted, end, over: end && self.end.is_some(), ..Turn::default() }
    }
}

/// What a person requests.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Request {
    /// Of an engine, or of all.
    Wish(Option<usize>, Wish),
    /// Pause, or continue.
    Pause,
    /// Pause, and let 0.1 s pass.
    Step,
    /// The next higher speed.
    Faster,
    /// The next lower one.
    Slower,
    /// The speed that the run chooses itself.
    Auto,
}

/// A person at the keyboard.
#[derive(Debug)]
pub struct Live {
    requests: Receiver<Request>,
    end: EndRequest,
    tour: Option<Tour>,
    passing: Passing,
    shown: Option<Passing>,
    stepping: bool,
    /// Something was done since the run was complete.
    continues: bool,
    /// Its actions are combined with those of the keys.
    script: Option<Scripted>,
    /// The script file has come to its end, and nothing was done since.
    over: bool,
}

impl Live {
    /// With a tour the run chooses its speed itself; without, it is real time.
    pub fn new(requests: Receiver<Request>, end: EndRequest, tour: Option<Tour>) -> Self {
        let passing = Passing { speed: 1, auto: tour.is_some(), paused: false };
        Self {
            requests,
            end,
            tour,
            passing,
            shown: None,
            stepping: false,
            continues: false,
            script: None,
            over: false,
        }
    }

    /// Plays a script file along with the keys. At its end no time passes until a key acts or ends the run.
    pub fn with_script(self, script: Scripted) -> Self {
        Self { script: Some(script), ..self }
    }

    fn take(&mut self, request: Request, turn: &mut Turn) {
        let place = SPEEDS.iter().rposition(|&speed| speed <= self.passing.speed).unwrap_or(0);
        let set = |place: usize| SPEEDS.get(place).copied();
        match request {
            Request::Wish(engine, wish) => {
                self.continues = true;
                if core::mem::take(&mut self.over) {
                    self.script = None;
                }
                turn.wishes.push((engine, wish));
            }
            Request::Pause => self.passing.paused = !self.passing.paused,
            Request::Step => (self.passing.paused, self.stepping) = (true, true),
            Request::Faster => {
                self.passing.auto = false;
                self.passing.speed = set(place + 1).unwrap_or(self.passing.speed);
            }
            Request::Slower => {
                self.passing.auto = false;
                self.passing.speed = place.checked_sub(1).and_then(set).unwrap_or(1);
            }
            Request::Auto => self.passing.auto = self.tour.is_some(),
        }
    }
}

impl Control for Live {
    fn turn(&mut self, situation: &Situation<'_>) -> Turn {
        let mut turn = Turn::default();
        self.stepping = false;
        if let Some(script) = &mut self.script {
            let played = script.turn(situation);
            turn.scripted = played.scripted;
            self.over |= played.end && !situation.complete;
        }
        while let Ok(request) = self.requests.try_recv() {
            self.take(request, &mut turn);
        }
        if let Some(tour) = &mut self.tour {
            let stages: Vec<Stage> = situation.samples.iter().map(|sample| sample.stage).collect();
            let speed = tour.speed(&stages);
            if self.passing.auto {
                self.passing.speed = speed;
            }
        }
        let finished = (situation.complete && !self.continues) || self.over;
        turn.over = self.over;
        let paused = (self.passing.paused && !self.stepping) || finished;
        if self.shown != Some(self.passing) {
            self.shown = Some(self.passing);
            turn.passing = Some(self.passing);
            turn.pace = Some(Pace::Times(self.passing.speed));
        }
        if !situation.complete {
            self.continues = false;
        }
        turn.end |= self.end.requested().is_some();
        turn.again = paused;
        // Pending actions and changes come first.
        let is_pending = !turn.scripted.is_empty() || !turn.wishes.is_empty() || turn.passing.is_some();
        if paused && !turn.end && !is_pending {
            match self.requests.recv_timeout(LOOK_EVERY) {
                Ok(request) => {
                    self.take(request, &mut turn);
                    turn.again = !self.stepping;
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => turn.end = true,
            }
        }
        turn
    }
}

#[cfg(test)]
mod tests {
    use super::super::play::action::Act;
    use super::*;
    use std::sync::mpsc::channel;

    fn turn(live: &mut Live, complete: bool) -> Turn {
        live.turn(&Situation { at: Instant::MIN, samples: &[], complete, played: false })
    }

    #[test]
    fn a_pause_lets_no_time_pass_and_wishes_come_through() {
        let (keys, requests) = channel();
        let mut live = Live::new(requests, EndRequest::default(), None);
        assert!(!turn(&mut live, false).again);
        keys.send(Request::Pause).unwrap();
        assert!(turn(&mut live, false).again);
        assert!(turn(&mut live, false).again);
        keys.send(Request::Wish(None, Wish::Act(Act::EmergencyStop))).unwrap();
        let stopped = turn(&mut live, false);
        assert!(stopped.again && stopped.wishes.len() == 1);
        keys.send(Request::Step).unwrap();
        assert!(!turn(&mut live, false).again);
        assert!(turn(&mut live, false).again);
        keys.send(Request::Pause).unwrap();
        turn(&mut live, false);
        assert!(!turn(&mut live, false).again);
    }

    #[test]
    fn a_complete_run_pauses_until_a_key_acts() {
        let (keys, requests) = channel();
        let mut live = Live::new(requests, EndRequest::default(), None);
        turn(&mut live, false);
        assert!(turn(&mut live, true).again);
        keys.send(Request::Wish(Some(0), Wish::Act(Act::Arm))).unwrap();
        let armed = turn(&mut live, true);
        assert!(!armed.again && armed.wishes.len() == 1);
    }

    #[test]
    fn at_the_end_of_a_script_file_no_time_passes_until_a_key_acts() {
        let (keys, requests) = channel();
        let live = Live::new(requests, EndRequest::default(), None);
        let mut live = live.with_script(Scripted::new(Vec::new(), Some(Duration::from_secs(5))));
        let mut at = |seconds: u64| {
            live.turn(&Situation {
                at: Instant::from_secs(seconds),
                samples: &[],
                complete: false,
                played: false,
            })
        };
        at(1);
        let before = at(4);
        assert!(!before.over && !before.again);
        for _ in 0..3 {
            let over = at(5);
            assert!(over.over && over.again && !over.end);
        }
        keys.send(Request::Wish(Some(0), Wish::Act(Act::Arm))).unwrap();
        let armed = at(5);
        assert!(!armed.over && !armed.again && armed.wishes.len() == 1);
        let after = at(6);
        assert!(!after.over && !after.again && !after.end);
    }

    #[test]
    fn speeds_are_stepped_through() {
        let (keys, requests) = channel();
        let mut live = Live::new(requests, EndRequest::default(), None);
        for (request, speed) in [
            (Request::Slower, 1),
            (Request::Faster, 2),
            (Request::Faster, 4),
            (Request::Faster, 10),
            (Request::Faster, 20),
            (Request::Faster, 60),
            (Request::Faster, 60),
            (Request::Slower, 20),
        ] {
            keys.send(request).unwrap();
            turn(&mut live, false);
            assert_eq!(live.passing.speed, speed);
        }
    }
}
