//! The screen with a cut wire, a stop and an ended run, drawn into memory as in `tests`.

use super::model::Page;
use super::tests::{COLOUR, Played, buffer, char, pair, play, text};
use super::theme::Tone;
use crossterm::event::{KeyCode, KeyEvent};
use jetlink::engine::state::EngineState;

/// The wire to left's ECU is cut by key at this time.
fn cut(at: f64, end: f64, name: &str) -> Played {
    let keys = [(at, char('f')), (at, char('e')), (at, super::tests::press(KeyCode::Esc))];
    pair(end, &keys, name)
}

#[test]
fn a_frame_on_a_cut_wire_is_not_delivered() {
    let screen = |mut played: Played| {
        played.model.page = Page::Wire;
        let buffer = buffer(&played.model, COLOUR, 160, 30);
        let screen = text(&buffer);
        let bar = screen.lines().position(|line| line.contains('[')).expect("a bar") as u16;
        let bad = buffer[(2, bar)].fg == COLOUR.style(Tone::Bad).fg.expect("a colour");
        (screen, bad)
    };
    let (whole, bad) = screen(pair(53.0, &[], "wire-whole"));
    assert!(whole.contains(" ms left") && !whole.contains("not delivered") && !bad, "{whole}");
    let (lost, bad) = screen(cut(50.0, 53.0, "wire-cut"));
    assert!(lost.contains("reply window: not delivered: the wire is cut") && bad, "{lost}");
    assert!(!lost.contains(" ms left") && !lost.contains("damaged on the way"), "{lost}");
    let of_node =
        |part: &str| lost.lines().filter(|line| line.contains("  node  ") && line.contains(part)).count();
    assert!(of_node("") > 5 && of_node("(not delivered: the wire is cut)") == of_node(""), "{lost}");
}

/// The summary and the panel count events that the node cannot know.
#[test]
fn the_panel_counts_windows_that_the_ecu_missed() {
    for (played, any) in [(cut(50.0, 53.0, "missed-cut"), true), (pair(53.0, &[], "missed-whole"), false)] {
        let ecu = &played.outcomes.engines[0].ecu;
        let missed = ecu.late + ecu.unanswered;
        assert_eq!(missed > 10, any, "{missed}");
        let screen = text(&buffer(&played.model, COLOUR, 120, 30));
        // One window may be open between the last sample and the end.
        let shown = [missed, missed.saturating_sub(1)].map(|missed| format!(" {missed} missed"));
        assert!(shown.iter().any(|shown| screen.contains(shown)), "{missed}: {screen}");
    }
}

#[test]
fn the_story_says_what_was_broken_by_hand() {
    let story = |played: &Played| {
        let screen = text(&buffer(&played.model, COLOUR, 80, 24));
        screen.lines().nth(1).expect("a story").to_owned()
    };
    let expected = "left: cut wire to the ECU, set by you; press f to end it";
    assert_eq!(story(&cut(4.0, 8.0, "story-cut")), expected);
    assert_ne!(story(&pair(8.0, &[], "story-whole")), expected);
    let twice = |at: f64| [(at, char('f')), (at, char('e'))];
    let keys: Vec<(f64, KeyEvent)> = [4.0, 5.0].into_iter().flat_map(twice).collect();
    let mended = [keys[0], keys[1], (5.0, char('e'))];
    assert_ne!(story(&pair(8.0, &mended, "story-mended")), expected);
}

/// Its ECU obeys run, and the end of the run does not reach it.
#[test]
fn an_engine_whose_run_is_over_is_not_shown_as_start_requested() {
    let mut requested = 0;
    let mut not_obeying = 0;
    for tenths in 0..12 {
        let at = 3.0 + f64::from(tenths) / 10.0;
        for wait in [0.1, 30.0] {
            let mut played = cut(at, at + wait, "cancelled-run");
            let sample = played.model.samples[0];
            played.model.page = Page::Why;
            let screen = text(&buffer(&played.model, COLOUR, 80, 24));
            let is_run = matches!(sample.order, jetlink::command::Order::Run(_));
            let is_requested = sample.does == EngineState::StartRequested;
            assert_eq!(screen.contains("why: left (start requested)"), is_requested && is_run, "{screen}");
            assert_eq!(screen.contains("why: left (not obeying)"), is_requested && !is_run, "{screen}");
            requested += u32::from(is_requested && is_run);
            not_obeying += u32::from(is_requested && !is_run);
        }
    }
    assert!(requested > 0 && not_obeying > 0, "{requested}, {not_obeying}");
}

/// An emergency stop is without cooling, and an AMT ECU has no state for a shaft that turns after it.
#[test]
fn an_engine_that_was_stopped_runs_down() {
    let after = |key: char, name: &str| {
        let played = pair(54.0, &[(50.0, char(key))], name);
        let screen = text(&buffer(&played.model, COLOUR, 80, 24));
        let row = screen.lines().find(|line| line.starts_with("> left")).expect("a row").to_owned();
        let events: Vec<String> = played.model.events.iter().map(|event| event.text.clone()).collect();
        (row, events)
    };
    let (stopped, events) = after(' ', "stopped");
    assert!(stopped.contains("run-down"), "{stopped}");
    assert!(events.iter().any(|event| event == "ECU reports run-down or cooling"), "{events:?}");
    assert!(!events.iter().any(|event| event == "ECU reports cooling"), "{events:?}");
    let (shut_down, _) = after('t', "shut-down");
    assert!(shut_down.contains("cooling"), "{shut_down}");
}

#[test]
fn a_run_is_cancelled_for_what_was_seen() {
    let script = "jetlink rig script, version 0.1.0\nengine name=left,ecu=amt,engine=olympus\nfaults flame-out=left@60s\n";
    let played = play("cancelled", script, &[], 70.0);
    let text = |event: &super::model::Event| event.text.strip_prefix("run cancelled: ").map(str::to_owned);
    let reasons: Vec<String> = played.model.events.iter().filter_map(text).collect();
    assert_eq!(reasons, ["the exhaust is cold or cools"], "{:?}", played.model.events);
    // It is far from cold.
    let egt = played.model.record.points(0).iter().rfind(|point| point.t <= 65.6).expect("a point").egt;
    assert!(egt.is_some_and(|egt| egt.least > 300.0), "{egt:?}");
}

#[test]
fn a_demand_by_key_has_its_unit() {
    let played = pair(51.0, &[(50.0, press_up())], "unit");
    let event = played.model.events.iter().find(|event| event.text.starts_with("played: throttle "));
    let text = &event.expect("an event").text;
    assert!(text.ends_with(" %"), "{text}");
    // In a script file the unit is that of the action.
    assert!(played.script.contains(&format!("left {}\n", &text[8..text.len() - 2])), "{}", played.script);
}

fn press_up() -> KeyEvent {
    super::tests::press(KeyCode::Up)
}

/// Of eight engines those charts are shown that have room.
#[test]
fn no_chart_is_too_low_to_be_read() {
    let engines: String =
        (1..=8).map(|i| format!("engine name=e{i},ecu=zk,rate=100,baud=115200\n")).collect();
    let mut played = play("low-charts", &format!("jetlink rig script, version 0.1.0\n{engines}"), &[], 5.0);
    for (selected, first, other) in [(0, "e1", "e5"), (6, "e5", "e1")] {
        played.model.selected = selected;
        let screen = text(&buffer(&played.model, COLOUR, 200, 50));
        assert!(screen.contains(&format!("{first}: rpm, EGT")), "{screen}");
        assert!(!screen.contains(&format!("{other}: rpm, EGT")), "{screen}");
        let line = |what: &str| screen.lines().position(|line| line.contains(what)).expect("a line");
        assert!(line(" throttle commanded") - line(&format!("{first}: rpm, EGT")) >= 10, "{screen}");
        assert!(line("events") - line(" throttle commanded") >= 6, "{screen}");
    }
}
