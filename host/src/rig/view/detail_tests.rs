//! The page Why, wires, marks in charts and the end of a script file, drawn into memory as in `tests`.

use super::super::control::{Control, Live, Scripted, Situation, Turn};
use super::super::ending::{EndRequest, EndedBy};
use super::super::message::Message;
use super::super::options::order;
use super::super::play::action::Fault;
use super::super::record::Record;
use super::super::session;
use super::model::Model;
use super::tests::{COLOUR, Cli, buffer, char, pair, text};
use clap::Parser;
use crossterm::event::KeyEvent;
use embassy_time::{Duration, Instant};
use jetlink::event::LossStage;
use std::cell::RefCell;

#[test]
fn why_shows_what_prevents_a_start() {
    // Shut down in flight, and started again while it is hot.
    let keys = [(50.0, char('t')), (52.0, char('s')), (52.1, char('w'))];
    let played = pair(53.0, &keys, "why");
    let screen = text(&buffer(&played.model, COLOUR, 100, 30));
    assert!(screen.contains("✗ EGT") && screen.contains("let it cool in standby, limit 100 °C"), "{screen}");
    assert!(screen.contains("✓ armed"), "{screen}");
    // It still turns.
    assert!(screen.contains("A board's outputs: fuel valve open, starter and ignition on"), "{screen}");
    // The refusal has the same text.
    let event = played.model.events.iter().find(|event| event.text.contains("rejected")).expect("a refusal");
    let reason = event.text.split_once("rejected: ").unwrap().1;
    assert!(screen.contains(reason), "{reason}: {screen}");
}

/// The source of left was silent and is back: its demand rises from idle, and meanwhile is not what is commanded.
#[test]
fn why_says_at_which_rate_a_demand_rises() {
    let keys =
        [(50.0, char('f')), (50.1, char('s')), (54.0, char('s')), (54.1, char('f')), (54.2, char('w'))];
    let (mut rising, mut there) = (0, 0);
    for tenths in 0..25 {
        let end = 54.5 + f64::from(tenths) / 5.0;
        let played = pair(end, &keys, "rises");
        let sample = played.model.samples[0];
        let screen = text(&buffer(&played.model, COLOUR, 100, 30));
        let is_sent = sample
            .input
            .throttle_percent()
            .is_some_and(|percent| sample.wire_text() == format!("{percent:.1} %"));
        let claims = screen.contains("nothing limits it: the commanded demand is sent");
        assert_eq!(claims, is_sent && sample.loss == LossStage::None, "{screen}");
        there += u32::from(claims);
        rising += u32::from(
            screen.contains("it rises at 50.0 % a second until it reaches the commanded demand (RISE)"),
        );
    }
    assert!(rising >= 2 && there >= 2, "{rising}, {there}");
}

/// The other wire still works, and mending one mends no other.
#[test]
fn one_wire_can_be_cut_and_mended_by_key() {
    let menu = (50.0, char('f'));
    let run = |name: &str, keys: &[(f64, KeyEvent)]| {
        let played = pair(53.0, &[&[menu], keys].concat(), name);
        let link = played.model.samples[0].link;
        let faults = played.model.details[0].faults.clone();
        (link == jetlink::report::LinkState::Up, faults, played.script)
    };
    let (up, faults, script) = run("to-node", &[(50.1, char('i'))]);
    assert!(!up && faults == [Fault::CutToNode], "{faults:?}");
    assert!(script.contains("left cut-to-node\n"), "{script}");
    let (up, faults, script) = run("to-ecu", &[(50.1, char('e'))]);
    assert!(up && faults == [Fault::CutToEcu], "{faults:?}");
    assert!(script.contains("left cut-to-ecu\n"), "{script}");
    // Both wires, then one: mending the one leaves both cut.
    let (up, faults, _) = run("both", &[(50.1, char('c')), (50.2, char('i')), (50.3, char('i'))]);
    assert!(!up && faults == [Fault::Cut], "{faults:?}");
    let (up, faults, script) = run("mended", &[(50.1, char('i')), (51.5, char('i'))]);
    assert!(up && faults.is_empty(), "{faults:?}");
    assert!(script.contains("left mend-to-node\n"), "{script}");
}

/// The charts mark what happened, and where nothing was received.
#[test]
fn charts_mark_events_and_gaps_and_name_them() {
    let keys = [(50.0, char('f')), (50.1, char('c')), (58.0, char('c')), (58.1, char('f'))];
    let played = pair(62.0, &keys, "marks");
    let screen = text(&buffer(&played.model, COLOUR, 200, 50));
    for name in ["cut -12 s", "link lost -1", "mend -4 s", "bottom line: nothing received"] {
        assert!(screen.contains(name), "{name}: {screen}");
    }
    // The first moment, before the first frame, is no gap, and what happened has its name.
    let stopped = pair(20.0, &[(5.0, char(' '))], "marks-stop");
    let screen = text(&buffer(&stopped.model, COLOUR, 200, 50));
    assert!(screen.contains("emergency-stop -15 s") && !screen.contains("bottom line"), "{screen}");
    let clean = pair(125.0, &[], "no-marks");
    let screen = text(&buffer(&clean.model, COLOUR, 200, 50));
    assert!(!screen.contains("bottom line") && !screen.contains(" more, "), "{screen}");
}

/// However long the run is, the charts have a point for each sample.
#[test]
fn the_last_two_minutes_are_not_thinned() {
    let played = pair(2.0, &[], "long-run");
    let mut record = Record::new(2);
    for i in 0..20_000 {
        record.add(Instant::MIN + Duration::from_millis(i * 100), &played.model.samples);
    }
    let (since, end) = (1999.9 - 120.0, 1999.9);
    assert!(record.samples_a_point() > 1 && record.since(0, since).len() < 700);
    let recent = record.recent(0, since);
    assert!((1200..=1201).contains(&recent.len()), "{}", recent.len());
    assert!(recent.windows(2).all(|two| (two[1].t - two[0].t - 0.1).abs() < 1e-6));
    assert!((recent.last().unwrap().t - end).abs() < 1e-6);
}

/// As a person sees it, but as quick as the machine allows.
struct AtOnce(Live);

impl Control for AtOnce {
    fn turn(&mut self, situation: &Situation<'_>) -> Turn {
        Turn { pace: None, ..self.0.turn(situation) }
    }
}

/// The verdict is there while a person has not decided yet what comes next, and no time passes.
#[test]
fn a_script_file_on_a_terminal_ends_with_the_verdict_on_the_screen() {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/captures/played.txt");
    let mut order = order(&Cli::parse_from(["rig", "--fast", "--script", script]).args).unwrap();
    let model = RefCell::new(Model::new(&order.setup.engines, order.setup.plan.length, false));
    let (actions, over) = order.script.take().unwrap();
    let end = EndRequest::default();
    let (_keys, requests) = std::sync::mpsc::channel();
    let live = Live::new(requests, end.clone(), None).with_script(Scripted::new(actions, over));
    let mut live = AtOnce(live);
    // As `q`, once the verdict is there.
    let show = |message: Message| {
        let is_end = matches!(message, Message::Complete(_));
        model.borrow_mut().message(message);
        if is_end {
            end.request(EndedBy::Key);
        }
        true
    };
    let outcomes = session::run(&order.setup, &mut live, show);
    let model = model.into_inner();
    assert!(model.verdict.as_ref().is_some_and(|verdict| verdict.pass), "{:?}", model.verdict);
    assert_eq!(outcomes.length, Duration::from_secs(65));
    assert!(text(&buffer(&model, COLOUR, 80, 24)).contains("PASS"));
}

#[test]
fn why_shows_the_valve_that_a_stop_has_closed() {
    let played = pair(53.0, &[(50.0, char(' ')), (52.0, char('w'))], "why_stopped");
    let screen = text(&buffer(&played.model, COLOUR, 100, 30));
    assert!(screen.contains("A board's outputs: fuel valve closed, starter and ignition on"), "{screen}");
}

/// With both wires cut no frame is promised.
#[test]
fn why_says_that_the_link_is_not_up() {
    let cut = [(40.0, char('f')), (40.1, char('c')), (40.2, char('f')), (46.0, char('w'))];
    for (keys, down) in [(&cut[..], true), (&cut[3..], false)] {
        let played = pair(47.0, keys, "why_cut");
        let screen = text(&buffer(&played.model, COLOUR, 100, 30));
        assert!(screen.contains("why: left"), "{screen}");
        assert_eq!(screen.contains("the link is not up"), down, "{screen}");
        assert!(!screen.contains("the next frames carry it"), "{screen}");
    }
}
