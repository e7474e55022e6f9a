//! The keys' actions, and the help that names them, drawn into memory as in `tests`.

use super::super::context::Stage;
use super::super::message::Message;
use super::super::options::order;
use super::super::session;
use super::keys::{Key, restart};
use super::model::{Model, Page, Popup, Requested};
use super::tests::{COLOUR, Cli, Keys, Played, buffer, char, pair, press, text};
use clap::Parser;
use crossterm::event::{KeyCode, KeyEvent, KeyEventKind};
use embassy_time::Duration;
use jetlink::engine::state::EngineState;
use std::cell::RefCell;

/// Until a key turns it on, the mouse marks text, as in any terminal.
#[test]
fn the_mouse_selects_engines_when_it_is_on() {
    let mut played = pair(1.0, &[], "mouse");
    let row = text(&buffer(&played.model, COLOUR, 80, 24));
    let row = row.lines().position(|line| line.trim_start().contains("right")).expect("a row") as u16;
    assert!(!played.model.mouse);
    played.model.click(3, row);
    assert_eq!(played.model.selected, 0, "it is off");
    assert_eq!(played.model.key(&char('m')), Some(Requested::Mouse(true)));
    assert!(
        text(&buffer(&played.model, COLOUR, 80, 24))
            .lines()
            .next()
            .is_some_and(|line| line.ends_with("mouse"))
    );
    played.model.click(3, row);
    assert_eq!(played.model.selected, 1);
    played.model.click(3, 0);
    assert_eq!(played.model.selected, 1, "no engine is drawn there");
    assert_eq!(played.model.key(&char('m')), Some(Requested::Mouse(false)));
}

#[test]
fn every_key_is_on_the_help_screen_at_80_by_24() {
    let mut played = pair(1.0, &[], "help");
    played.model.popup = Some(Popup::Help);
    let screen = text(&buffer(&played.model, COLOUR, 80, 24));
    for key in &super::keys::KEYS {
        assert!(screen.contains(key.name) && screen.contains(key.text), "{}: {screen}", key.name);
    }
    assert!(screen.contains("start after an emergency stop: r y, then d a s"), "{screen}");
}

/// What `?` says of a key, and the last line of the screen.
#[test]
fn a_key_that_does_nothing_with_a_transmitter_is_not_offered() {
    for (rc, offered) in [("", true), ("rc sbus\n", false)] {
        let script = format!("jetlink rig script, version 0.1.0\nengine name=left,ecu=zk\n{rc}");
        let mut played = super::tests::play("offered", &format!("{script}1 left noise\n2 end\n"), &[], 2.0);
        played.model.transmitter = !rc.is_empty();
        let footer = |model: &Model| text(&buffer(model, COLOUR, 140, 30)).lines().last().unwrap().to_owned();
        let line = footer(&played.model);
        assert_eq!(line.contains("b script"), offered, "{line}");
        assert!(line.contains("STOP ALL") && line.contains("t standby"), "{line}");
        played.model.popup = Some(Popup::Help);
        let help = text(&buffer(&played.model, COLOUR, 140, 30));
        assert_eq!(help.contains("nothing: there is no script"), !offered, "{help}");
    }
}

/// The keys that the help names for it, after an emergency stop of a cold engine; without any one of them it stays off.
#[test]
fn keys_that_the_help_names_start_an_engine_after_an_emergency_stop() {
    let keys: Vec<&Key> = restart(false).concat();
    assert_eq!(keys.len(), 5);
    let story = |played: &Played| {
        text(&buffer(&played.model, COLOUR, 80, 24)).lines().nth(1).expect("a story").to_owned()
    };
    for left_out in [None, Some(0), Some(1), Some(2), Some(3), Some(4)] {
        let pressed = keys.iter().enumerate().filter(|(i, _)| Some(*i) != left_out);
        let pressed = pressed.map(|(i, key)| (2.0 + 0.5 * i as f64, press(key.codes[0])));
        let pressed: Vec<_> = [(1.0, char(' '))].into_iter().chain(pressed).collect();
        let played = pair(40.0, &pressed, "restart");
        let sample = played.model.samples[0];
        assert_eq!(
            sample.does == EngineState::Running,
            left_out.is_none(),
            "{left_out:?}: {:?}",
            sample.does
        );
    }
    let released: Vec<_> = [(1.0, char(' ')), (2.0, char('r')), (2.5, char('y'))].into();
    let right = |at: f64| [(at, press(KeyCode::Right)), (at, char('r')), (at, char('y'))];
    let released = [&released[..], &right(3.0)].concat();
    let played = pair(5.0, &released, "released");
    // Keys act on the selected engine, which is right here.
    assert_eq!(story(&played), "right is disarmed; d, a and s start it, b restarts its script");
    let mut latched = pair(2.5, &[(1.0, char(' ')), (2.0, char('r')), (2.0, char('y'))], "latched");
    assert_eq!(story(&latched), "right: emergency stop is latched; 2, r and y release it");
    latched.model.selected = 1;
    assert_eq!(story(&latched), "right: emergency stop is latched; r and y release it");
    let played = pair(
        7.0,
        &[&released[..], &[(5.0, press(KeyCode::Left)), (5.5, char('d')), (6.0, char('a'))]].concat(),
        "armed",
    );
    assert_eq!(story(&played), "left is armed, in standby; s starts it, b restarts its script");
}

/// Also at the end: the engine of this run was stopped.
#[test]
fn the_verdict_names_what_starts_the_selected_engine_again() {
    let verdict = |keys: &[(f64, KeyEvent)]| {
        let mut played = pair(70.0, &[&[(60.0, char(' '))], keys].concat(), "verdict");
        played.model.verdict =
            Some(super::model::Verdict { pass: true, lines: vec!["PASS: all".to_owned()] });
        text(&buffer(&played.model, COLOUR, 80, 24)).lines().nth(1).expect("a story").trim_end().to_owned()
    };
    assert_eq!(verdict(&[]), "PASS; left: emergency stop is latched; r and y release it, q ends");
    let mut keys = vec![(61.0, char('r')), (61.0, char('y'))];
    assert_eq!(verdict(&keys), "PASS; left is disarmed: d, a and s start it; q ends");
    keys.extend([(62.0, char('d')), (62.0, char('a'))]);
    assert_eq!(verdict(&keys), "PASS; press f to break something, s to start an engine again, q to end");
}

/// At the end of its script an engine's source still commands standby, so that its next command may be a start.
#[test]
fn s_starts_an_engine_whose_script_is_done() {
    let done = pair(300.0, &[], "all-done");
    assert!(done.model.samples.iter().all(|sample| sample.stage == Stage::Done));
    let again = pair(340.0, &[(300.0, char('s'))], "again");
    assert_eq!(again.model.samples[0].does, EngineState::Running);
    assert_eq!(again.outcomes.engines[0].commands_rejected, 0);
}

/// If the keys move a transmitter, the help states it.
#[test]
fn the_help_of_a_transmitter_names_stick_and_switch() {
    let mut played = pair(1.0, &[], "transmitter");
    (played.model.popup, played.model.transmitter) = (Some(Popup::Help), true);
    let screen = text(&buffer(&played.model, COLOUR, 80, 24));
    assert!(screen.contains("s      the switch to run allowed"), "{screen}");
    assert!(screen.contains("start after an emergency stop: t, then s"), "{screen}");
    assert!(screen.contains("Up     the stick 5 % up") && !screen.contains("start: run at idle"), "{screen}");
}

/// In a scenario no key acts on an engine but the emergency stop and its release, and none is shown that would.
#[test]
fn a_scenario_shows_no_key_that_would_do_nothing() {
    let mut played = pair(1.0, &[], "scenario");
    (played.model.popup, played.model.scenario) = (Some(Popup::Help), true);
    let screen = text(&buffer(&played.model, COLOUR, 80, 24));
    assert!(screen.contains("pause, or continue"), "{screen}");
    assert!(screen.contains("Space STOP ALL  ? keys  q end  w why  v wire"), "{screen}");
    assert!(!screen.contains("start after an emergency stop"), "{screen}");
    assert!(!screen.contains("break something") && !screen.contains("start: run at idle"), "{screen}");
    // Nor in the line of events, while they fly and at the end.
    let mut played = pair(70.0, &[], "scenario-flies");
    for verdict in [None, Some(super::model::Verdict { pass: true, lines: vec!["PASS: all".to_owned()] })] {
        played.model.verdict = verdict;
        let story = |model: &Model| text(&buffer(model, COLOUR, 80, 24)).lines().nth(1).unwrap().to_owned();
        played.model.scenario = false;
        assert!(story(&played.model).contains("press f"), "{}", story(&played.model));
        played.model.scenario = true;
        assert!(!story(&played.model).contains("press f"), "{}", story(&played.model));
    }
}

/// Space also stops all engines of a scenario. Its expected events are then not judged.
#[test]
fn space_stops_a_scenario_and_it_is_not_judged() {
    let args = ["rig", "--fast", "--scenario", "source-loss"];
    for (keys, stops) in [(vec![], false), (vec![(60.0, char(' '))], true)] {
        let mut order = order(&Cli::parse_from(args).args).unwrap();
        order.setup.details = true;
        let model = RefCell::new(Model::new(&order.setup.engines, order.setup.plan.length, true));
        let show = |message: Message| {
            model.borrow_mut().message(message);
            true
        };
        let mut control = Keys::new(&model, &keys, 200.0);
        let outcomes = session::run(&order.setup, &mut control, show);
        let samples = model.borrow().samples.clone();
        assert!(samples.iter().all(|sample| (sample.wire_text() == "STOP") == stops), "{stops}");
        let problems = super::super::summary::problems(&outcomes);
        assert_eq!(problems, Vec::<String>::new());
        assert_eq!(outcomes.checks.iter().all(|check| check.held), !stops, "{:?}", outcomes.checks);
        let verdict = super::super::summary::pass(&outcomes);
        assert!(verdict.starts_with(if stops { "STOPPED by hand" } else { "PASS: all" }), "{verdict}");
        assert!(!order.setup.plays_again(), "a script file has no scenario");
        // Once for each engine, however often its pilot would command.
        let rejected: u32 = outcomes.engines.iter().map(|outcome| outcome.commands_rejected).sum();
        assert_eq!(rejected, 0);
    }
}

/// On a small screen they are on several pages, each of them complete.
#[test]
fn every_key_is_on_a_page_of_the_help_at_60_by_16() {
    let mut played = pair(1.0, &[], "pages");
    let mut pages = String::new();
    let mut count = 0;
    loop {
        played.model.key(&char('?'));
        let screen = text(&buffer(&played.model, COLOUR, 60, 16));
        if played.model.popup.is_none() {
            break;
        }
        count += 1;
        pages += &screen;
    }
    assert!(count > 1, "{pages}");
    for key in &super::keys::KEYS {
        assert!(pages.contains(key.name) && pages.contains(key.text), "{}: {pages}", key.name);
    }
    assert!(pages.contains("start after an emergency stop: r y, then d a s"), "{pages}");
}

/// Also one that nobody has taken from it.
#[test]
fn b_restarts_the_script() {
    let before = pair(59.9, &[], "not-yet");
    assert_ne!(before.model.samples[0].wire_text(), "standby");
    let again = pair(62.0, &[(60.0, char('b'))], "again");
    assert_eq!(again.model.samples[0].wire_text(), "standby");
    assert_eq!(again.model.samples[0].stage, Stage::Standby);
    assert_eq!(again.model.samples[1].stage, before.model.samples[1].stage);
}

#[test]
fn a_command_takes_the_engine_and_b_gives_it_back() {
    // Left starts at 3 s, and runs 27 s later.
    let up = press(KeyCode::Up);
    let keys = [(40.0, up), (40.1, up), (40.2, press(KeyCode::PageUp)), (60.0, char('b'))];
    let flying = pair(45.0, &keys, "taken");
    let screen = text(&buffer(&flying.model, COLOUR, 80, 24));
    assert!(screen.contains("played by you, armed"), "{screen}");
    let sent = flying.model.samples[0].wire_text();
    assert!(sent.ends_with(" %") && sent != "0.0 %", "{sent}");
    assert!(flying.script.contains("40.0 left throttle "), "{}", flying.script);
    let back = pair(62.0, &keys, "back");
    assert_eq!(back.model.samples[0].wire_text(), "standby");
    assert_ne!(back.model.samples[0].stage, super::super::context::Stage::Played);
    assert_eq!(back.outcomes.engines[0].played.map(|verdict| verdict.missed), Some(0));
}

#[test]
fn space_stops_all_engines_in_menus_too_and_release_takes_two_keys() {
    let space = char(' ');
    let keys = [(50.0, char('f')), (50.5, space), (51.0, press(KeyCode::Esc)), (60.0, char('r'))];
    let stopped = pair(58.0, &keys, "stopped");
    for sample in &stopped.model.samples {
        assert_eq!(sample.wire_text(), "STOP");
        assert_eq!(sample.counters.commands_rejected, 0);
    }
    let screen = text(&buffer(&stopped.model, COLOUR, 80, 24));
    assert!(screen.contains("emergency stop is latched") && screen.contains("bench: STOP"), "{screen}");
    let question = pair(62.0, &keys, "question");
    assert_eq!(question.model.samples[0].wire_text(), "STOP");
    assert!(text(&buffer(&question.model, COLOUR, 80, 24)).contains("release the emergency stop of left?"));
    let keys = [&keys[..], &[(62.0, char('y'))]].concat();
    let released = pair(64.0, &keys, "released");
    assert_eq!(released.model.samples[0].wire_text(), "standby");
    assert_eq!(released.model.samples[1].wire_text(), "STOP");
    let verdicts: Vec<_> = released.outcomes.engines.iter().map(|outcome| outcome.played.unwrap()).collect();
    assert!(verdicts.iter().all(|verdict| verdict.late_stops == 0 && verdict.ignitions == 0), "{verdicts:?}");
    assert!(super::super::summary::problems(&released.outcomes).is_empty());
}

#[test]
fn esc_closes_and_never_ends_and_releases_of_keys_do_not_count() {
    let esc = press(KeyCode::Esc);
    let mut up = char('q');
    up.kind = KeyEventKind::Release;
    let played = pair(3.0, &[(1.0, char('w')), (1.1, char('?')), (1.2, esc), (1.3, up)], "esc");
    assert_eq!((played.model.page, played.model.popup), (Page::Why, None));
    let played = pair(3.0, &[(1.0, char('w')), (1.2, esc), (1.3, esc), (1.4, esc)], "esc-esc");
    assert_eq!(played.model.page, Page::Engines);
    assert!(played.outcomes.length >= Duration::from_secs(3));
    let played = pair(3.0, &[(1.0, char('q'))], "quit");
    assert!(played.outcomes.length < Duration::from_millis(1200));
}
