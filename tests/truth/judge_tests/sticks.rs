//! Histories by hand for the judge's rules: stick and switch of radio control.

use super::*;
use crate::history::{Position, Radio, RadioRules};
use sim::receiver::{CHANNELS, sbus, steps};

/// From frame to frame.
const PERIOD: u64 = 14 * MS;

/// What a receiver sends: pulses of stick, switch and hand-over switch in µs, and its flags; `None`: nothing.
type Sends = Option<([u16; 3], u8)>;

const fn stick(position: Position, tenths: u16) -> [u16; 3] {
    let switch = match position {
        Position::Stop => 1000,
        Position::Standby => 1500,
        Position::Run => 2000,
    };
    [1100 + tenths * 8 / 10, switch, 1000]
}

const fn good(position: Position, tenths: u16) -> Sends {
    Some((stick(position, tenths), 0))
}

const STOP_AT_IDLE: Sends = good(Position::Stop, 0);
const STANDBY_AT_IDLE: Sends = good(Position::Standby, 0);
const RUN_AT_IDLE: Sends = good(Position::Run, 0);
const RUN_AT_HALF: Sends = good(Position::Run, 500);

/// A pilot with the frames of its receiver, which commands what they show when it counts.
struct Flown {
    story: Story,
    /// From these times on, s.
    sends: Vec<(f64, Sends)>,
    until: f64,
}

/// Stop, standby at 1 s, start at 4 s, half throttle at 31 s.
fn flown(until: f64) -> Flown {
    let story = started(ZK5).wire(31.0, until, HALF).turbine(
        RUNS as f64,
        until + 1.0,
        Phase::Running,
        100_000.0,
        500.0,
    );
    let sends = vec![(0.0, STOP_AT_IDLE), (1.5, STANDBY_AT_IDLE), (4.0, RUN_AT_IDLE), (31.0, RUN_AT_HALF)];
    let story = story.with(|h| {
        h.commanded.clear();
        // The switch is moved at 4 s, and the start is ordered when that counts.
        h.frames.iter_mut().filter(|frame| frame.at < micros(4.095)).for_each(|frame| frame.sent = STANDBY);
    });
    Flown { story, sends, until }
}

impl Flown {
    fn sends(mut self, at: f64, sends: Sends) -> Self {
        self.sends.push((at, sends));
        self.sends.sort_by(|a, b| a.0.total_cmp(&b.0));
        self
    }

    /// From then on another one than there was.
    fn instead(mut self, before: f64, at: f64, sends: Sends) -> Self {
        self.sends.retain(|(when, _)| *when != before);
        self.sends(at, sends)
    }

    /// With what radio control commands at these times, s.
    fn commands(self, commands: &[(f64, f64, PilotCommand)]) -> Story {
        let (mut frames, mut at) = (Vec::new(), 0);
        while at < micros(self.until) {
            let sends = self.sends.iter().rfind(|(when, _)| micros(*when) <= at).expect("from 0 on").1;
            if let Some(([throttle, switch, hand_over], flags)) = sends {
                let mut channels = [steps(1500); CHANNELS];
                (channels[2], channels[4], channels[6]) = (steps(throttle), steps(switch), steps(hand_over));
                frames.push((at, sbus(channels, flags).try_into().expect("a frame")));
            }
            at += PERIOD;
        }
        let mut story = self.story;
        for (from, to, command) in commands {
            for (at, _) in frames.iter().filter(|(at, _)| (micros(*from)..micros(*to)).contains(at)) {
                story.0.commanded.push(Commanded { at: *at, source: PILOT, command: *command });
            }
        }
        story.0.radio = Some(Radio { rules: RadioRules::USUAL, frames });
        story
    }
}

const fn run(tenths: u32) -> PilotCommand {
    PilotCommand::Run(Demanded::Throttle(tenths))
}

/// The commands of [`flown`]; a position counts in the fourth frame and 60 ms later, a stick in the second frame.
const FLIGHT: [(f64, f64, PilotCommand); 7] = [
    (0.345, 1.515, PilotCommand::Stop),
    (1.585, 2.03, PilotCommand::Nothing),
    (2.03, 2.1, PilotCommand::Release),
    (2.1, 2.11, PilotCommand::Arm),
    (2.11, 4.01, PilotCommand::Standby),
    (4.08, 31.02, run(0)),
    (31.02, 40.0, run(500)),
];

/// Ignores findings on the wire and the turbine.
fn findings(story: Story) -> Vec<String> {
    let verdict = story.judged();
    verdict.findings.into_iter().filter(|found| found.rule == Rule::Sticks).map(|found| found.text).collect()
}

/// A finding has this text.
#[track_caller]
fn speaks(story: Story, text: &str) {
    let found = findings(story);
    assert!(found.iter().any(|each| each.contains(text)), "{text}: {found:#?}");
}

#[track_caller]
fn is_silent(story: Story) {
    assert_eq!(findings(story), [""; 0]);
}

/// The flight with these commands in place of its own in an interval.
fn but(from: f64, to: f64, commands: &[(f64, f64, PilotCommand)]) -> Vec<(f64, f64, PilotCommand)> {
    let mut all = Vec::new();
    for (first, last, command) in FLIGHT {
        all.push((first, last.min(from), command));
        all.push((first.max(to), last, command));
    }
    all.retain(|(first, last, _)| first < last);
    all.extend(commands);
    all
}

/// From 35 s to 35.28 s every second frame is another receiver's, with its stick at idle: the third step from one to the other is silence,
/// until 1 s after the last one.
#[test]
fn a_throttle_of_two_receivers_in_turns_commands_nothing() {
    let in_turns = || {
        let frame = |flown: Flown, i: u32| {
            let sends = if i.is_multiple_of(2) { RUN_AT_IDLE } else { RUN_AT_HALF };
            flown.sends(35.0 + f64::from(i) * 0.014 - 0.001, sends)
        };
        (0..20).fold(flown(40.0), frame)
    };
    let first = [(35.02, 35.04, run(0)), (35.04, 35.05, run(500))];
    is_silent(in_turns().commands(&but(35.02, 36.27, &first)));
    speaks(in_turns().commands(&but(35.02, 36.0, &first)), "a channel cannot be read");
    let none = in_turns().commands(&but(35.02, 38.0, &first));
    assert!(!findings(none).is_empty(), "afterwards the stick counts again");
}

#[test]
fn commands_of_radio_control_are_those_of_its_sticks() {
    is_silent(flown(40.0).commands(&FLIGHT));
    // Another demand, another position, no frame.
    speaks(
        flown(40.0).instead(31.0, 31.0, good(Position::Run, 520)).commands(&FLIGHT),
        "the stick is elsewhere",
    );
    let standby = flown(40.0).sends(35.0, good(Position::Standby, 500));
    speaks(standby.commands(&but(35.01, 35.08, &[])), "the switch is not at run");
    let stray = flown(40.0).sends(35.0, None).commands(&FLIGHT);
    speaks(stray.streams(PILOT, 35.001, 36.0, run(500)), "no frame came");
    // The stick moves, and nothing follows it; the receiver works, and nothing is commanded.
    speaks(flown(40.0).commands(&but(31.02, 40.0, &[(31.02, 40.0, run(0))])), "the stick is elsewhere");
    speaks(flown(40.0).commands(&but(35.0, 36.0, &[])), "the receiver works");
    let present = [(35.0, 36.0, PilotCommand::Nothing)];
    speaks(flown(40.0).commands(&but(35.0, 36.0, &present)), "the switch is at run");
}

#[test]
fn flagged_frames_do_not_count() {
    for flags in [0x04, 0x08, 0x0C, 0x10] {
        let lost = || flown(40.0).sends(35.0, Some((stick(Position::Run, 500), flags)));
        is_silent(lost().commands(&but(35.0, 40.0, &[])));
        speaks(lost().commands(&FLIGHT), "do not count");
    }
    // After them, the third frame is the first that counts.
    let back = || flown(40.0).sends(35.0, Some((stick(Position::Run, 0), 8))).sends(36.0, RUN_AT_HALF);
    is_silent(back().commands(&but(35.0, 36.03, &[])));
    speaks(back().commands(&but(35.0, 36.02, &[])), "do not count");
}

#[test]
fn one_frame_says_nothing_alone() {
    let odd = || flown(40.0).sends(35.0, good(Position::Run, 0)).sends(35.01, RUN_AT_HALF);
    is_silent(odd().commands(&FLIGHT));
    speaks(odd().commands(&but(35.0, 35.02, &[(35.0, 35.02, run(0))])), "the stick is elsewhere");
    // Frames that come faster than a line can carry them.
    let fast = |by: f64| {
        flown(40.0).commands(&FLIGHT).with(|h| {
            let frames = &mut h.radio.as_mut().expect("one").frames;
            let place = frames.partition_point(|(at, _)| *at < micros(35.0));
            let (at, frame) = frames[place];
            let at = at + micros(by);
            frames.insert(place + 1, (at, frame));
            h.commanded.push(Commanded { at, source: PILOT, command: run(500) });
        })
    };
    is_silent(fast(0.004));
    speaks(fast(0.001), "do not count");
}

#[test]
fn a_start_is_a_move_of_the_switch_with_the_stick_at_idle() {
    // At run allowed since power-up.
    let found = |commands: &[(f64, f64, PilotCommand)]| {
        flown(40.0).instead(0.0, 0.0, RUN_AT_IDLE).instead(1.5, 1.5, RUN_AT_IDLE).commands(commands)
    };
    let standby = (0.345, 4.08, PilotCommand::Standby);
    is_silent(found(&[standby, (4.08, 40.0, PilotCommand::Standby)]).with(|h| h.frames.clear()));
    speaks(found(&[standby, (4.08, 40.0, run(0))]), "the switch was found at run");
    // Since a reset nothing was sent: no order is in force, and run is commanded to an engine that may be running. Standby sent
    // since makes it a start.
    let after_reset = |sent: &'static [Sent]| {
        let frames = [(6.345, 8.0, run(0))];
        found(&[standby, (4.08, 6.0, PilotCommand::Standby), frames[0]]).with(move |h| {
            h.resets.push(Reset { down: micros(5.97), up: micros(6.0), cause: Cause::PowerOn });
            h.frames.retain(|frame| frame.at < micros(5.97));
            h.frames.iter_mut().for_each(|frame| frame.sent = STANDBY);
            h.frames.extend(sent.iter().map(|sent| Frame { at: micros(6.3), arrived: true, sent: *sent }));
            if let Some(radio) = &mut h.radio {
                radio.frames.retain(|(at, _)| *at < micros(8.0));
            }
            h.rules.period = 200 * MS;
        })
    };
    is_silent(after_reset(&[]));
    speaks(after_reset(&[STANDBY]), "the switch was found at run");
    // The stick came to idle just before.
    let idle = |at: f64| {
        flown(40.0).sends(2.5, good(Position::Standby, 300)).sends(at, STANDBY_AT_IDLE).commands(&FLIGHT)
    };
    is_silent(idle(3.2));
    speaks(idle(3.8), "stick and switch were not steady");
    // Standby was passed.
    let passed = |at: f64| {
        let flown = flown(40.0).sends(1.8, STOP_AT_IDLE).sends(at, STANDBY_AT_IDLE);
        flown.commands(&but(
            1.585,
            4.01,
            &[
                (1.585, 1.81, PilotCommand::Nothing),
                (1.81, at + 0.02, PilotCommand::Stop),
                (3.6, 3.62, PilotCommand::Arm),
                (at + 0.085, 4.01, PilotCommand::Standby),
            ],
        ))
    };
    is_silent(passed(3.0));
    speaks(passed(3.8), "stick and switch were not steady");
    // The same while nothing is received.
    let unseen = flown(40.0).sends(3.2, None).instead(4.0, 3.7, RUN_AT_IDLE);
    speaks(unseen.commands(&but(3.2, 4.06, &[(4.04, 4.05, run(0))])), "the switch was found at run");
    // A move that is a start, but no start is commanded.
    let standby = but(4.08, 31.02, &[(4.08, 31.02, PilotCommand::Standby)]);
    let none = flown(40.0).commands(&standby).with(|h| {
        h.frames.iter_mut().filter(|frame| frame.sent == IDLE).for_each(|frame| frame.sent = STANDBY);
    });
    speaks(none, "a start by the switch");
}

#[test]
fn stop_is_released_and_the_engine_armed_by_a_steady_move_to_standby() {
    let stopped_until = |until: f64| {
        move |h: &mut History| {
            let stopped = h.frames.iter_mut().filter(|frame| frame.at < micros(until));
            stopped.for_each(|frame| frame.sent = STOP);
        }
    };
    // The stick is up until 2.8 s.
    let up = |commands: &[(f64, f64, PilotCommand)]| {
        let flown = flown(40.0).instead(1.5, 1.5, good(Position::Standby, 300));
        flown.sends(2.8, STANDBY_AT_IDLE).commands(commands).with(stopped_until(3.4))
    };
    let late = [
        (1.585, 3.33, PilotCommand::Nothing),
        (3.33, 3.41, PilotCommand::Release),
        (3.41, 3.42, PilotCommand::Arm),
        (3.42, 4.01, PilotCommand::Standby),
    ];
    is_silent(up(&but(1.585, 4.01, &late)));
    speaks(up(&FLIGHT), "not steady");
    // Neither released nor armed, although all is steady.
    let latched = but(2.03, 31.02, &[(2.03, 4.01, PilotCommand::Nothing)]);
    let latched = || flown(40.0).commands(&latched);
    speaks(latched().with(stopped_until(30.0)), "a stop is to be released");
    // A higher source has just released it, and the frame that shows that is yet to come; a lower one does not, nor does a release
    // without an effect.
    let finds_it = |by: usize, until: f64| {
        let standby = but(2.03, 31.02, &[(2.03, 4.01, PilotCommand::Standby)]);
        let story = flown(40.0).commands(&standby).with(stopped_until(until)).with(|h| {
            h.commanded.push(Commanded { at: micros(2.04), source: by, command: PilotCommand::Release });
        });
        findings(story).iter().any(|text| text.contains("a stop is to be released"))
    };
    assert!(!finds_it(0, 2.2));
    assert!(finds_it(3, 2.2));
    assert!(finds_it(0, 30.0));
    let unarmed = but(2.1, 4.01, &[(2.1, 4.01, PilotCommand::Standby)]);
    speaks(flown(40.0).commands(&unarmed), "the engine is to be armed");
    // A standby position that is found.
    let found = flown(40.0).instead(0.0, 0.0, STANDBY_AT_IDLE);
    let present = [(0.345, 1.585, PilotCommand::Nothing)];
    speaks(found.commands(&but(0.0, 1.585, &present)), "has not moved from stop to standby");
}

#[test]
fn a_switch_at_stop_stops() {
    let story = |stop: f64, sends: Sends| {
        let commands = but(39.01, 40.0, &[(stop, 40.0, PilotCommand::Stop)]);
        flown(40.0).sends(39.0, sends).commands(&commands)
    };
    let stop = good(Position::Stop, 500);
    is_silent(story(39.01, stop));
    speaks(story(39.2, stop), "the switch is at stop");
    // Beside a throttle that cannot be read, once it has been held.
    let beyond = Some(([2150, 1000, 1000], 0));
    is_silent(story(39.32, beyond));
    speaks(story(39.01, beyond), "a channel cannot be read");
    speaks(story(39.6, beyond), "the switch is at stop beside a channel");
    // An autopilot that starts gives 881 µs everywhere.
    let low = Some(([881, 881, 881], 0));
    is_silent(story(40.0, low));
    speaks(story(39.32, low), "a channel cannot be read");
}

/// At the end of its range a receiver gives bursts of frames: stop counts once it has been held for 0.6 s in all. So it does where the
/// throttle can be read in every second burst only.
#[test]
fn a_switch_at_stop_in_bursts_stops() {
    let story = |between: Option<[u16; 3]>, stop: (f64, f64)| {
        let (stop_from, stop_to) = stop;
        let mut flown = flown(40.0).sends(35.0, between.map(|pulses| (pulses, 0)));
        for burst in 0..4 {
            let at = 35.4 + 0.65 * f64::from(burst);
            let between = between.map(|pulses| (pulses, 0));
            flown = flown.sends(at, good(Position::Stop, 500)).sends(at + 0.25, between);
        }
        flown.sends(37.6, None).commands(&but(35.01, 40.0, &[(stop_from, stop_to, PilotCommand::Stop)]))
    };
    is_silent(story(None, (37.37, 37.6)));
    speaks(story(None, (37.6, 37.6)), "at stop for long enough");
    speaks(story(None, (36.1, 36.2)), "has not been there for long enough");
    let loose = Some([2150, 1000, 1000]);
    is_silent(story(loose, (35.34, 37.6)));
    speaks(story(loose, (35.34, 35.4)), "the switch is at stop beside a channel");
    speaks(story(loose, (35.1, 35.4)), "a channel cannot be read");
    // With run in every second burst it does not.
    let mut flown = flown(40.0).sends(35.0, None);
    let mut commands = Vec::new();
    for burst in 0..8 {
        let at = 35.4 + 0.56 * f64::from(burst);
        let position = if burst % 2 == 0 { Position::Stop } else { Position::Run };
        flown = flown.sends(at, good(position, 500)).sends(at + 0.25, None);
        if position == Position::Run {
            commands.push((at + 0.028, at + 0.25, run(500)));
        }
    }
    is_silent(flown.commands(&but(35.01, 40.0, &commands)));
}

#[test]
fn an_engine_that_is_handed_over_is_commanded_nothing_but_a_stop() {
    const HANDED_OVER: Sends = Some(([1500, 2000, 2000], 0));
    let handed_over = |commands: &[(f64, f64, PilotCommand)]| {
        flown(40.0).sends(35.0, HANDED_OVER).commands(&but(35.01, 40.0, commands))
    };
    is_silent(handed_over(&[(35.08, 40.0, PilotCommand::Nothing)]));
    speaks(handed_over(&[(35.08, 40.0, run(500))]), "it is handed over");
    speaks(handed_over(&[]), "the receiver works");
    let stop = |from: f64| {
        let commands = [(35.08, 38.02, PilotCommand::Nothing), (from, 40.0, PilotCommand::Stop)];
        let stop = flown(40.0).sends(35.0, HANDED_OVER).sends(38.0, Some(([1500, 1000, 2000], 0)));
        stop.commands(&but(35.01, 40.0, &commands))
    };
    is_silent(stop(38.02));
    speaks(stop(38.3), "the switch is at stop");
}

#[test]
fn a_position_that_is_found_shuts_nothing_down() {
    let found = |back: Sends, command: PilotCommand, from: f64| {
        let commands = but(35.0, 40.0, &[(from, 40.0, command)]);
        flown(40.0).sends(35.0, None).sends(36.0, back).commands(&commands)
    };
    let standby = good(Position::Standby, 500);
    is_silent(found(standby, PilotCommand::Nothing, 36.34));
    speaks(found(standby, PilotCommand::Standby, 36.34), "has not moved from run to standby");
    // Stop counts once it has been held; run, where the switch was before, at once.
    let stop = good(Position::Stop, 500);
    is_silent(found(stop, PilotCommand::Stop, 36.34));
    speaks(found(stop, PilotCommand::Stop, 36.03), "long enough");
    is_silent(found(RUN_AT_HALF, run(500), 36.03));
    // If the move is received it does, at the first frame that counts.
    let moved = |from: f64| {
        let commands = [(35.08, from, PilotCommand::Nothing), (from, 40.0, PilotCommand::Standby)];
        let moved = flown(40.0).sends(35.0, standby).commands(&but(35.01, 40.0, &commands));
        moved.with(|h| {
            let later = h.frames.iter_mut().filter(|frame| frame.at > micros(35.2));
            later.for_each(|frame| frame.sent = STANDBY);
        })
    };
    is_silent(moved(35.08));
    speaks(moved(35.15), "has moved to standby");
}

/// With the switch at run and the stick up, which starts nothing. Between the hand-over by another source and its end, radio control is
/// present.
#[test]
fn in_standby_radio_control_commands_it_but_beside_a_hand_over() {
    let is_found = |hands_over: bool| {
        let standby =
            [(2.11, 2.6), (2.69, 3.3), (3.35, 4.01)].map(|(from, to)| (from, to, PilotCommand::Standby));
        let commands = [&FLIGHT[..4], &standby, &[(3.3, 3.35, PilotCommand::Nothing)]].concat();
        let story = flown(40.0).sends(2.6, good(Position::Run, 500)).commands(&commands).with(|h| {
            if hands_over {
                h.commanded.push(Commanded { at: micros(3.29), source: 0, command: PilotCommand::Pwm });
            }
        });
        findings(story).iter().any(|text| text.contains("radio control is in control in standby"))
    };
    assert!(is_found(false));
    assert!(!is_found(true));
}
