//! Histories by hand for the judge's rules: what is received through MAVLink.

use super::*;
use crate::history::{Answered, ByMavlink, Received, Word};

const MAVLINK: usize = 2;
const RUN: PilotCommand = PilotCommand::Run(Demanded::Throttle(0));
const START: Word = Word::Start { from: 255, confirmation: 0, while_disarmed: false };
const ARMED: Word = Word::Vehicle { armed: true };
const DISARMED: Word = Word::Vehicle { armed: false };

const fn output(tenths: u32) -> Word {
    Word::Output { tenths: Some(tenths), sure: true }
}

/// Whether the rule is broken by these words and these commands of MAVLink. Times are in seconds.
fn breaks(words: &[(f64, Word)], commands: &[(f64, PilotCommand)]) -> bool {
    breaks_after(&[], words, commands)
}

/// The same after damaged frames.
fn breaks_after(damaged: &[f64], words: &[(f64, Word)], commands: &[(f64, PilotCommand)]) -> bool {
    let damaged = damaged.iter().map(|at| micros(*at)).collect();
    breaks_where(ByMavlink { damaged, ..ByMavlink::default() }, words, commands)
}

/// The same with these settings.
fn breaks_where(settings: ByMavlink, words: &[(f64, Word)], commands: &[(f64, PilotCommand)]) -> bool {
    let received = words.iter().map(|&(at, word)| Received { at: micros(at), word }).collect();
    let starts = words.iter().filter(|(_, word)| matches!(word, Word::Start { .. }));
    let accepted = |at: f64| commands.contains(&(at, PilotCommand::Standby));
    let answers = starts.map(|&(at, _)| Answered { at: micros(at), accepted: accepted(at) }).collect();
    let story = Story::new(ZK5).with(|h| {
        h.mavlink = Some(ByMavlink { has_output: true, received, answers, ..settings });
        h.commanded = commands
            .iter()
            .map(|&(at, command)| Commanded { at: micros(at), source: MAVLINK, command })
            .collect();
        h.end = micros(60.0);
    });
    judge(&story.0).rules().contains(&Rule::ByMavlink)
}

/// An armed vehicle at idle, and a start of it.
const WORDS: [(f64, Word); 4] = [(1.0, ARMED), (2.0, ARMED), (2.9, output(0)), (3.0, START)];
const COMMANDS: [(f64, PilotCommand); 3] =
    [(2.0, PilotCommand::Arm), (3.0, PilotCommand::Standby), (3.0, RUN)];

fn with(words: &[(f64, Word)], commands: &[(f64, PilotCommand)]) -> bool {
    breaks(&[&WORDS[..], words].concat(), &[&COMMANDS[..], commands].concat())
}

#[test]
fn a_start_is_what_somebody_commanded_of_an_armed_vehicle_at_idle() {
    assert!(!breaks(&WORDS, &COMMANDS));
    let other = |place: usize, word: Word| {
        let mut words = WORDS;
        words[place].1 = word;
        words
    };
    assert!(breaks(&other(3, Word::Station), &COMMANDS), "not commanded");
    assert!(breaks(&other(1, DISARMED), &COMMANDS), "one heartbeat is not armed");
    let first = |at: f64| [&[(at, ARMED)], &WORDS[1..]].concat();
    assert!(!breaks(&first(1.8), &COMMANDS) && breaks(&first(1.9), &COMMANDS), "nor is one that comes twice");
    assert!(breaks(&other(2, output(400)), &COMMANDS), "the throttle is up");
    assert!(breaks(&other(2, Word::Station), &COMMANDS), "there is no stream");
    // A frame after the start, among bytes that are read at once (613000062), and one before it.
    let at_once =
        |words: [Word; 2]| breaks(&[&WORDS[..3], &[(3.0, words[0]), (3.0, words[1])]].concat(), &COMMANDS);
    assert!(!at_once([START, output(400)]) && at_once([output(400), START]));
    // The same again is a repeat.
    assert!(with(&[(4.0, START)], &[(4.0, PilotCommand::Standby), (4.0, RUN)]));
    assert!(!with(&[(4.0, START)], &[]));
    // By its number, however late. A number that does not rise is of a new start.
    let late = |first: u8, next: u8, at: f64| {
        let start = |confirmation: u8| Word::Start { from: 255, confirmation, while_disarmed: false };
        let words = [&other(3, start(first))[..], &[(at - 0.1, output(0)), (at, start(next))]].concat();
        breaks(&words, &[&COMMANDS[..], &[(at, PilotCommand::Standby), (at, RUN)]].concat())
    };
    assert!(late(0, 1, 20.0) && late(1, 2, 20.0) && late(1, 1, 7.0));
    assert!(!late(1, 1, 20.0) && !late(0, 0, 20.0) && !late(2, 1, 20.0));
}

/// Silence is neither armed nor disarmed.
#[test]
fn a_vehicle_that_shows_disarmed_for_its_time_stops_its_engine_and_a_silent_one_does_not() {
    let breaks = |until: u32, started: f64| {
        let shown = (0..until).map(|second| (4.0 + f64::from(second), DISARMED));
        let start = Word::Start { from: 255, confirmation: 0, while_disarmed: true };
        let start = [(started - 0.1, output(0)), (started, start)];
        let mut words = [&WORDS[..2], &shown.collect::<Vec<_>>(), &start].concat();
        words.sort_by(|(one, _), (other, _)| one.total_cmp(other));
        let mut commands = vec![
            COMMANDS[0],
            (started, PilotCommand::Standby),
            (started, RUN),
            (5.0, PilotCommand::Disarm),
            (25.5, PilotCommand::ShutDown),
        ];
        commands.sort_by(|(one, _), (other, _)| one.total_cmp(other));
        let settings = ByMavlink { standby_after: Some(20 * SECOND), ..ByMavlink::default() };
        breaks_where(settings, &words, &commands)
    };
    assert!(!breaks(22, 3.0), "it has shown disarmed all the time");
    assert!(breaks(4, 3.0), "it is silent");
    assert!(breaks(13, 3.0), "it is silent at the end");
    assert!(!breaks(22, 5.4) && breaks(22, 5.6), "a start while disarmed has its time");
}

/// 600100023: by its header, a damaged frame included the bytes after it, which were skipped with the start in them; the node
/// found only the repeat.
#[test]
fn a_repeat_starts_where_the_start_was_lost_after_a_damaged_frame() {
    let again = Word::Start { from: 255, confirmation: 1, while_disarmed: false };
    let words = [&WORDS[..], &[(4.8, output(0)), (4.8, again)]].concat();
    let commands = [COMMANDS[0], (4.8, PilotCommand::Standby), (4.8, RUN)];
    assert!(!breaks_after(&[2.7], &words, &commands));
    assert!(breaks(&words, &commands), "nothing was damaged");
    assert!(breaks_after(&[3.2], &words, &commands), "what is damaged later hides nothing");
}

#[test]
fn a_demand_is_that_of_a_frame_and_disarmed_is_idle() {
    let half = PilotCommand::Run(Demanded::Throttle(500));
    assert!(!with(&[(5.0, output(500))], &[(5.0, half)]));
    assert!(with(&[(5.0, output(400))], &[(5.0, half)]), "more than the stream has");
    assert!(with(&[(4.9, output(500))], &[(5.0, half)]), "no frame came");
    let disarmed = [(4.0, DISARMED), (4.5, DISARMED), (5.0, output(500))];
    let disarm = (4.5, PilotCommand::Disarm);
    assert!(with(&disarmed, &[disarm, (5.0, half)]));
    assert!(!with(&disarmed, &[disarm, (5.0, RUN)]));
    assert!(with(&disarmed, &[(5.0, RUN)]), "the engine stays armed");
    // After a damaged frame a heartbeat may be skipped, and then the vehicle is armed again (613000205). Two that are found count.
    let behind = |damaged: &[f64], next: Word| {
        let shown = [(4.0, DISARMED), (4.5, DISARMED), (7.2, next), (7.7, next)];
        breaks_after(damaged, &[&WORDS[..], &shown].concat(), &COMMANDS)
    };
    assert!(behind(&[], ARMED) && !behind(&[4.1], ARMED) && !behind(&[3.9], ARMED));
    assert!(behind(&[4.1], DISARMED));
    // A frame before the heartbeat that disarms, among bytes that are read at once (600000005).
    let at_once = [(4.0, DISARMED), (4.5, output(500)), (4.5, DISARMED), (4.6, output(500))];
    assert!(!with(&at_once, &[(4.5, half), disarm]));
    assert!(with(&at_once, &[(4.5, half), disarm, (4.6, half)]));
}

#[test]
fn a_stop_that_is_received_is_commanded_and_no_other() {
    let stop = (5.0, PilotCommand::ShutDown);
    assert!(!with(&[(5.0, Word::Stop)], &[stop]));
    assert!(with(&[(5.0, Word::Stop)], &[]), "ignored");
    // One after a damaged frame may be skipped with it (600000143).
    let behind =
        |damaged: &[f64]| breaks_after(damaged, &[&WORDS[..], &[(5.0, Word::Stop)]].concat(), &COMMANDS);
    assert_eq!([&[4.97][..], &[], &[5.1]].map(behind), [false, true, true]);
    assert!(with(&[], &[stop]), "not commanded");
    assert!(with(&[(5.0, Word::Stop), (6.0, output(0))], &[stop, (6.0, RUN)]), "nobody has started it since");
    assert!(!with(&[(5.0, Word::EmergencyStop)], &[(5.0, PilotCommand::Stop)]));
    assert!(with(&[(5.0, Word::EmergencyStop)], &[stop]), "less than an emergency stop");
}

/// 613000155: until the node has learnt the id of its vehicle, it does not know which system it is.
#[test]
fn a_stop_that_names_another_system_counts_where_the_node_has_no_id() {
    let breaks = |learns: bool, words: &[(f64, Word)]| {
        let stops = [&COMMANDS[..], &[(5.0, PilotCommand::ShutDown)]].concat();
        let commands = if words.contains(&WORDS[3]) { &stops[..] } else { &stops[3..] };
        breaks_where(ByMavlink { learns, ..ByMavlink::default() }, words, commands)
    };
    let elsewhere = (5.0, Word::StopElsewhere);
    assert!(!breaks(true, &[elsewhere]) && breaks(false, &[elsewhere]));
    assert!(breaks(true, &[(5.0, Word::Station)]), "not commanded");
    // The node has answered the start, so it has an id.
    let answered = [&WORDS[..], &[elsewhere]].concat();
    assert!(breaks(true, &answered));
    // It need not be obeyed.
    assert!(!breaks_where(ByMavlink { learns: true, ..ByMavlink::default() }, &[elsewhere], &[]));
}

/// 640000033: a demand that was held at idle while the vehicle was disarmed does not rise in a gap of the stream.
#[test]
fn a_demand_follows_the_stream_once_it_had_the_frames_to_rise() {
    let finds = |dark_from: f64, dark_to: f64| {
        let mut received = vec![(1.0, ARMED), (2.0, ARMED), (2.9, output(0)), (3.0, START)];
        let mut commands = vec![(2.0, PilotCommand::Arm), (3.0, PilotCommand::Standby), (3.0, RUN)];
        for frame in 31..600 {
            let at = f64::from(frame) / 10.0;
            if (dark_from..dark_to).contains(&at) {
                continue;
            }
            let step = (frame - 399).clamp(0, 20) as u32;
            received.push((at, output(if step > 0 { 1000 } else { 0 })));
            commands.push((at, PilotCommand::Run(Demanded::Throttle(50 * step))));
        }
        let story = Story::new(ZK5).wire(0.0, 60.0, Sent::Full(Switch::Run, 0));
        let story = story.turbine(0.0, 60.0, Phase::Running, 36_000.0, 500.0).with(|h| {
            let received = received.iter().map(|&(at, word)| Received { at: micros(at), word }).collect();
            let answers = vec![Answered { at: micros(3.0), accepted: true }];
            h.mavlink = Some(ByMavlink { has_output: true, received, answers, ..ByMavlink::default() });
            let commands = commands.iter();
            h.commanded = commands
                .map(|&(at, command)| Commanded { at: micros(at), source: MAVLINK, command })
                .collect();
        });
        story.finds(Rule::ByMavlink)
    };
    assert!(!finds(10.0, 39.9), "it has not risen yet");
    assert!(finds(60.0, 60.0) && finds(10.0, 30.0), "it had the frames to rise");
}
