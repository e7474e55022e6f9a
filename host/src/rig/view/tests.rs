//! The screen, drawn into memory: runs from script files in virtual time, keys at engine times, no sleep anywhere.

use super::super::context::{Note, Stage};
use super::super::control::{Control, Live, Request, Scripted, Situation, Turn};
use super::super::ending::EndRequest;
use super::super::message::Message;
use super::super::options::{Args, order};
use super::super::outcome::Outcomes;
use super::super::play::action::Action;
use super::super::play::script;
use super::super::session;
use super::super::tour::Tour;
use super::draw::draw;
use super::model::{Model, Page, Popup, Requested};
use super::picture;
use super::theme::Theme;
use clap::Parser;
use crossterm::event::{KeyCode, KeyEvent, KeyModifiers};
use embassy_time::{Duration, Instant};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::buffer::Buffer;
use ratatui::style::{Color, Modifier};
use std::cell::RefCell;
use std::sync::mpsc::{Sender, channel};

/// As a colour terminal with UTF-8.
pub const COLOUR: Theme = Theme { colours: true, ascii: false };

/// The same without colours.
const PLAIN: Theme = Theme { colours: false, ..COLOUR };

#[derive(Parser)]
pub struct Cli {
    #[command(flatten)]
    pub args: Args,
}

/// Presses keys at engine times, and ends the run.
pub struct Keys<'a> {
    model: &'a RefCell<Model>,
    keys: Vec<(f64, KeyEvent)>,
    next: usize,
    end: f64,
    /// A script file that is played along with the keys, as on a terminal.
    beside: Option<(Sender<Request>, Live)>,
}

impl<'a> Keys<'a> {
    /// Each with its time in seconds.
    pub fn new(model: &'a RefCell<Model>, keys: &[(f64, KeyEvent)], end: f64) -> Self {
        Self { model, keys: keys.to_vec(), next: 0, end, beside: None }
    }

    /// Beside the actions of a script file.
    fn beside(self, actions: Vec<(Instant, Action)>, over: Option<Duration>) -> Self {
        let (sender, requests) = channel();
        let live = Live::new(requests, EndRequest::default(), None);
        Self { beside: Some((sender, live.with_script(Scripted::new(actions, over)))), ..self }
    }
}

impl Control for Keys<'_> {
    fn turn(&mut self, situation: &Situation<'_>) -> Turn {
        let now = (situation.at - Instant::MIN).as_micros() as f64 / 1e6;
        let mut turn = Turn { end: now >= self.end, ..Turn::default() };
        while let Some((at, key)) = self.keys.get(self.next).filter(|(at, _)| *at <= now) {
            let _ = at;
            self.next += 1;
            match self.model.borrow_mut().key(key) {
                Some(Requested::Wish(engine, wish)) => match &self.beside {
                    Some((sender, _)) => sender.send(Request::Wish(engine, wish)).unwrap(),
                    None => turn.wishes.push((engine, wish)),
                },
                Some(Requested::Quit) => turn.end = true,
                _ => {}
            }
        }
        match &mut self.beside {
            // As fast as the machine allows.
            Some((_, live)) => Turn { end: turn.end, pace: None, ..live.turn(situation) },
            None => turn,
        }
    }
}

pub fn press(code: KeyCode) -> KeyEvent {
    KeyEvent::new(code, KeyModifiers::NONE)
}

/// Result of a run on the screen.
pub struct Played {
    pub model: Model,
    pub outcomes: Outcomes,
    /// Every byte on every wire: engine, time in ns, to the node, byte.
    pub bytes: Vec<(usize, u64, bool, u8)>,
    /// As it is saved.
    pub script: String,
}

/// Plays the script file with this text, together with these keys.
pub fn play(name: &str, script: &str, keys: &[(f64, KeyEvent)], end: f64) -> Played {
    let path = std::env::temp_dir().join(format!("jetlink-view-{}-{name}", std::process::id()));
    std::fs::write(&path, script).unwrap();
    let args = ["rig", "--fast", "--script", path.to_str().unwrap()];
    let mut order = order(&Cli::parse_from(args).args).unwrap();
    std::fs::remove_file(&path).unwrap();
    order.setup.details = true;
    let model = RefCell::new(Model::new(&order.setup.engines, order.setup.plan.length, false));
    let mut bytes = Vec::new();
    let (actions, over) = order.script.take().unwrap();
    let show = |message: super::super::message::Message| {
        if let super::super::message::Message::Samples { details, .. } = &message {
            for (i, detail) in details.iter().enumerate() {
                let of_entry = |entry: &sim::wire::Entry| {
                    (i, entry.start, entry.direction == sim::wire::Direction::ToNode, entry.byte)
                };
                bytes.extend(detail.entries.iter().map(of_entry));
            }
        }
        model.borrow_mut().message(message);
        true
    };
    let outcomes = if keys.is_empty() && over.is_some() {
        session::run(&order.setup, &mut Scripted::new(actions, over), show)
    } else {
        let control = Keys::new(&model, keys, end);
        let mut control = if actions.is_empty() { control } else { control.beside(actions, over) };
        session::run(&order.setup, &mut control, show)
    };
    let over = Some(Instant::MIN + outcomes.length);
    let script = script::text(&order.header, &order.setup.engines, &outcomes.actions, over);
    Played { model: model.into_inner(), outcomes, bytes, script }
}

/// The screen of this size.
pub fn buffer(model: &Model, theme: Theme, width: u16, height: u16) -> Buffer {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw(model, theme, frame)).unwrap();
    terminal.backend().buffer().clone()
}

/// Its text.
pub fn text(buffer: &Buffer) -> String {
    let area = buffer.area;
    let line = |y| {
        let line: String = (0..area.width).map(|x| buffer[(x, y)].symbol()).collect();
        format!("{}\n", line.trim_end())
    };
    (0..area.height).map(line).collect()
}

/// Text of an event has to be clear to a newcomer.
#[test]
fn each_stage_is_named_for_what_happens() {
    let tour = play("named-stages", &tour(), &[], 140.0);
    let progress = |what: &str| {
        let text = format!("progress: {what}");
        tour.model.events.iter().filter(|event| event.text == text).count()
    };
    assert_eq!((progress("source lost"), progress("event")), (1, 0));
    for scenario in super::super::scenario::ALL {
        assert_eq!(Stage::Scenario(scenario.name).name(), scenario.name);
    }
}

const HEAD: &str = "jetlink rig script, version 0.1.0\n";
const PAIR: &str =
    "engine name=left,ecu=amt,engine=olympus,baud=115200\nengine name=right,ecu=zk,version=5\n";

/// The rig's run without options.
fn tour() -> String {
    format!("{HEAD}silence\n")
}

pub fn pair(end: f64, keys: &[(f64, KeyEvent)], name: &str) -> Played {
    play(name, &format!("{HEAD}{PAIR}"), keys, end)
}

pub fn char(c: char) -> KeyEvent {
    press(KeyCode::Char(c))
}

#[test]
fn the_tour_shows_what_happens_and_why() {
    let mut seen: Vec<String> = Vec::new();
    for end in [40.0, 129.5, 132.0, 135.3, 138.5, 145.0] {
        let played = play("tour", &tour(), &[], end);
        let screen = text(&buffer(&played.model, COLOUR, 80, 24));
        seen.push(screen.lines().nth(1).unwrap().to_owned());
    }
    assert_eq!(
        seen,
        [
            "right starts; centre waits: one start at a time",
            "left's source is silent: its last demand is held for 1 s",
            "left's source is silent: the demand falls to idle; the engine keeps running",
            "left's source commands again: it is in control within 3 s",
            "left's source is back: the demand rises to what it commands",
            "right cools: its starter turns it until the exhaust is below 100 °C",
        ]
    );
}

/// In seconds of the spectator, by the speeds that the tour chooses.
#[test]
fn the_tour_is_worth_watching() {
    let played = play("watching", &tour(), &[], 230.0);
    let record = &played.model.record;
    let (mut tour, mut watched) = (Tour::default(), 0.0);
    let (mut moves, mut all_run) = (None, None);
    for i in 0..record.points(0).len() {
        let points: Vec<_> = (0..4).map(|engine| record.points(engine)[i]).collect();
        let stages: Vec<Stage> = points.iter().map(|point| point.stage).collect();
        watched += 0.1 / f64::from(tour.speed(&stages));
        if points.iter().any(|point| point.rpm.is_some_and(|rpm| rpm.most > 1000.0)) {
            moves.get_or_insert(watched);
        }
        if !stages.iter().any(|stage| matches!(stage, Stage::Standby | Stage::Start)) {
            all_run.get_or_insert(watched);
        }
        if stages.iter().all(|stage| *stage == Stage::Done) {
            break;
        }
    }
    let (moves, all_run) = (moves.expect("a gauge moves"), all_run.expect("all run"));
    assert!(moves <= 5.0 && all_run <= 30.0 && watched <= 90.0, "{moves} s, {all_run} s, {watched} s");
    let readme = include_str!("../../../../README.md");
    let length = played.model.length.expect("pilots end it").as_secs();
    for number in [
        format!("cooling in about {:.0} s: ×", (watched / 10.0).round() * 10.0),
        format!("plays the same {length} s of engine time"),
    ] {
        assert!(readme.contains(&number), "{number}");
    }
}

#[test]
fn at_80_by_24_there_is_a_row_for_each_of_eight_engines() {
    let engines: String =
        (1..=8).map(|i| format!("engine name=a-name-of-{i:02},ecu=zk,rate=100,baud=115200\n")).collect();
    let played = play("eight", &format!("{HEAD}{engines}standby\n"), &[], 5.0);
    let screen = text(&buffer(&played.model, COLOUR, 80, 24));
    for i in 1..=8 {
        assert!(screen.contains(&format!(" a-name-of-{i:02} ")), "{screen}");
    }
    assert!(screen.lines().all(|line| line.chars().count() <= 80));
    let lines: Vec<&str> = screen.lines().collect();
    assert!(lines[23].starts_with("Space STOP ALL  ? keys  q end  f faults"), "{screen}");
    // Five events below their heading.
    let events = lines.iter().position(|line| *line == "events").unwrap();
    assert!(events == 17 && lines[18..23].iter().all(|line| line.contains("a-name-of-")), "{screen}");
}

/// The work of a second of engine time is counted, whatever else this computer does: docs/rig.md states it.
#[test]
fn eight_engines_at_100_hz_take_little_work() {
    let engines: String =
        (1..=8).map(|i| format!("engine name=e{i},ecu=zk,rate=100,baud=115200\n")).collect();
    let played = play("work", &format!("{HEAD}{engines}standby\nduration 10s\n"), &[], 10.0);
    let (polls, bytes) = (sim::clock::polls(), played.bytes.len() as u64);
    assert!(bytes > 8 * 9 * 100 * 7, "{bytes}");
    assert!(polls < bytes * 3, "{polls} polls for {bytes} bytes");
}

/// Everything that a panel shows, in its longest texts: on each size, whole or elided where nothing is lost.
#[test]
fn long_texts_fit_their_panels() {
    use super::super::audit::WireCommand;
    use super::super::context::PilotInput;
    use jetlink::command::{Demand, Origin};
    use jetlink::ecu::Faults;
    use jetlink::engine::state::EngineState;
    use jetlink::event::LossStage;
    use jetlink::report::{EcuState, LinkState};
    use jetlink::units::Rpm;

    let engines: String = (1..=8)
        .map(|i| {
            let ecu =
                if i % 2 == 0 { "ecu=amt,engine=olympus,baud=115200" } else { "ecu=zk,rate=100,baud=115200" };
            format!("engine name=a-name-of-{i:02},{ecu}\n")
        })
        .collect();
    let mut played = play("long", &format!("{HEAD}{engines}standby\n"), &[], 5.0);
    for sample in &mut played.model.samples {
        sample.does = EngineState::Starting(EcuState { code: 2, name: "ignition-min-throttle" });
        sample.link = LinkState::Up;
        sample.input = PilotInput::Run(Demand::Rpm(Rpm::new(160_000)));
        sample.on_wire = Some(WireCommand::RunRpm(159_960));
        (sample.in_control, sample.loss) = (Origin::Emergency, LossStage::FailSafe);
        (sample.rpm, sample.egt) = (Some(160_010), Some(1100.4));
        sample.counters.crc_failures = 123_456;
        sample.counters.send_slots_missed = 1234;
        sample.counters.replies_missed = 0;
        sample.faults = Some(Faults::Amt(jetlink::ecu::amt::codec::ErrorBits(0xff)));
    }
    for name in ["first", "second"] {
        played.model.note(Note {
            at: played.model.at,
            engine: Some(0),
            text: format!(
                "command from bench rejected: the exhaust is at 312 °C: let it cool in standby, limit 100 °C, {name}"
            ),
        });
    }
    for (width, height, panels) in [(60, 16, 1), (80, 24, 1), (120, 30, 8), (200, 50, 8)] {
        let screen = text(&buffer(&played.model, COLOUR, width, height));
        let has = |what: &str, count: usize| {
            assert!(screen.matches(what).count() >= count, "{width} × {height}: {what}\n{screen}");
        };
        let has_any = |all: &[&str]| {
            let count: usize = all.iter().map(|what| screen.matches(what).count()).sum();
            assert!(count >= panels, "{width} × {height}: {all:?}\n{screen}");
        };
        assert!(screen.lines().all(|line| line.chars().count() <= width.into()), "{screen}");
        // The last event is there to its last word.
        has("second", 1);
        if height < 24 {
            continue;
        }
        has("start: ignition-min-throttle", panels);
        has(if width == 120 { "-01: ZK 5 " } else { "-01: ZK version 5, 115200 baud " }, 1);
        has("source emergency: fail-safe", panels);
        has_any(&["commanded 160000 rpm, sent 159960 rpm", "cmd 160000, sent 159960 rpm"]);
        has_any(&["123456 errors, 1234 missed", "123k err, 1234 missed", "123k err 1234 miss"]);
        has("FAULT: ", panels);
        has(" +", panels);
    }
}

/// Each engine's source and the reason for holding its demand, besides everything else.
#[test]
fn at_80_columns_the_table_names_the_source() {
    for (keys, end, name, expected) in [
        (vec![], 25.0, "left", "  bench"),
        (vec![(50.0, char('f')), (50.1, char('s'))], 51.0, "left", "  bench: hold"),
        (vec![(50.0, char('f')), (50.1, char('s'))], 53.0, "a-long-name1", "  bench fsafe"),
        (vec![(50.0, char(' '))], 51.0, "a-long-name1", "  bench: STOP"),
    ] {
        let played = play("source", &format!("{HEAD}{}", PAIR.replace("left", name)), &keys, end);
        let screen = text(&buffer(&played.model, COLOUR, 80, 24));
        let lines: Vec<&str> = screen.lines().collect();
        assert!(lines[2].ends_with("  source"), "{screen}");
        assert!(lines[3].contains(&format!("> {name} ")) && lines[3].ends_with(expected), "{screen}");
    }
}

#[test]
fn the_smallest_screen_has_a_panel_with_all_of_its_texts() {
    let played = play("smallest", HEAD, &[], 40.0);
    let screen = text(&buffer(&played.model, COLOUR, 60, 16));
    for what in [
        "left: ",
        "rpm ",
        "cmd 100.0 %, sent 100.0 %",
        "source bench",
        "up 8/s",
        "worst reply margin",
        "events",
    ] {
        assert!(screen.lines().skip(7).any(|line| line.contains(what)), "{what}: {screen}");
    }
    assert!(screen.lines().skip(7).any(|line| line.contains("armed")), "{screen}");
    // A column without room is left out.
    let table: Vec<&str> = screen.lines().skip(2).take(2).collect();
    assert!(table[0].ends_with("  sent") && table[1].ends_with("100.0 %"), "{screen}");
}

/// With names of twelve characters.
#[test]
fn what_happens_fits_80_columns() {
    for (keys, end) in [
        (vec![(50.0, char(' '))], 51.0),
        (vec![(50.0, char('f')), (50.1, char('c'))], 52.0),
        (vec![(50.0, char('f')), (50.1, char('s'))], 53.0),
        (vec![(50.0, char('f')), (50.1, char('x'))], 50.5),
        (vec![(50.0, char('f')), (50.1, char('x'))], 51.4),
        (vec![], 25.0),
        (vec![], 40.0),
        (vec![(50.0, char('t'))], 60.0),
    ] {
        let pair = PAIR.replace("left", "a-long-name1").replace("right", "a-long-name2");
        let played = play("names", &format!("{HEAD}{pair}"), &keys, end);
        let screen = text(&buffer(&played.model, COLOUR, 80, 24));
        let line = screen.lines().nth(1).unwrap();
        assert!(line.chars().count() > 20 && !line.contains('…'), "{end}: {line}");
    }
}

#[test]
fn larger_screens_show_more() {
    let played = pair(5.0, &[], "larger");
    let at = |width, height| text(&buffer(&played.model, COLOUR, width, height));
    let panels = |screen: &str| screen.matches(" baud ").count();
    assert_eq!((panels(&at(80, 24)), panels(&at(120, 30)), panels(&at(200, 50))), (1, 2, 2));
    assert!(
        !at(120, 30).contains(" throttle commanded and sent")
            && at(200, 50).contains(" throttle commanded and sent")
    );
    let small = at(59, 20);
    assert!(small.contains("The keys still work") && !small.contains("left"), "{small}");
    assert!(at(80, 15).contains("the rig needs 60 and 16"));
    assert!(at(60, 16).contains("events"));
}

/// A curve at the value that the upper label names is at the height of that label.
#[test]
fn labels_of_the_charts_are_at_their_values() {
    let mut played = pair(45.0, &[], "labels");
    let screen = text(&buffer(&played.model, COLOUR, 200, 50));
    let words = || screen.split(|c: char| !c.is_ascii_alphanumeric());
    let label: Option<u32> = words().find_map(|word| word.strip_suffix('k')?.parse().ok());
    let top = label.expect("a label in thousands") * 1000;
    // The screen's last two minutes are at that speed.
    let mut samples = played.model.samples.clone();
    for sample in &mut samples {
        (sample.rpm, sample.egt) = (Some(top), None);
    }
    for i in 1..=1300_u64 {
        played.model.message(Message::Samples {
            at: Instant::MIN + Duration::from_millis(45_000 + i * 100),
            samples: samples.clone(),
            details: Vec::new(),
        });
    }
    let screen = text(&buffer(&played.model, COLOUR, 200, 50));
    let name = format!("{}k", top / 1000);
    let line = screen.lines().find(|line| line.contains(&name)).expect("the label");
    let curve = line.chars().filter(|c| ('\u{2801}'..='\u{28ff}').contains(c)).count();
    assert!(curve > 20, "no curve at {name}:\n{screen}");
}

#[test]
fn nothing_is_left_over_when_the_size_changes() {
    let played = pair(5.0, &[], "resized");
    let mut terminal = Terminal::new(TestBackend::new(30, 10)).unwrap();
    for (width, height) in [(30, 10), (120, 30), (80, 24), (200, 50), (120, 30)] {
        terminal.backend_mut().resize(width, height);
        terminal.draw(|frame| draw(&played.model, COLOUR, frame)).unwrap();
        let fresh = buffer(&played.model, COLOUR, width, height);
        assert_eq!(text(terminal.backend().buffer()), text(&fresh), "{width} × {height}");
    }
}

#[test]
fn colours_are_by_state_and_can_be_left_out() {
    let played = pair(60.0, &[], "colours");
    let colours = |theme| {
        let buffer = buffer(&played.model, theme, 120, 30);
        let colours: std::collections::HashSet<Color> = buffer.content.iter().map(|cell| cell.fg).collect();
        colours
    };
    assert!(colours(COLOUR).is_superset(&[Color::Green, Color::Cyan].into()));
    assert_eq!(colours(PLAIN), [Color::Reset].into());
    // The selected engine is still seen.
    let plain = buffer(&played.model, PLAIN, 80, 24);
    let reversed = plain.content.iter().any(|cell| cell.modifier.contains(Modifier::REVERSED));
    assert!(reversed);
}

/// Faults and values that need attention are marked only if there are no colours.
#[test]
fn without_colours_a_mark_shows_what_is_wrong() {
    for (name, key, marks) in [("quiet", '?', 0), ("held", 's', 2), ("stopped", ' ', 2)] {
        let keys = match key {
            's' => vec![(50.0, char('f')), (50.1, char('s')), (50.2, press(KeyCode::Esc))],
            ' ' => vec![(50.0, char(' '))],
            _ => vec![],
        };
        let played = pair(51.5, &keys, name);
        let row = |theme| {
            let screen = text(&buffer(&played.model, theme, 80, 24));
            screen
                .lines()
                .find(|line| line.starts_with("> left"))
                .unwrap_or_else(|| panic!("{screen}"))
                .to_owned()
        };
        assert_eq!(row(PLAIN).matches('!').count(), marks, "{name}: {}", row(PLAIN));
        assert_eq!(row(COLOUR).matches('!').count(), 0, "{name}: {}", row(COLOUR));
    }
}

/// A value that is not there has no mark, and a mark takes no letter from a text without one.
#[test]
fn a_mark_only_follows_a_value_that_is_there() {
    let cut = [(50.0, char('f')), (50.1, char('c'))];
    for (end, theme, value) in [(51.5, PLAIN, "?"), (55.0, PLAIN, " -  "), (55.0, COLOUR, " -  ")] {
        let played = pair(end, &cut, "marks");
        let screen = text(&buffer(&played.model, theme, 80, 24));
        let row = |name: &str| screen.lines().find(|line| line.starts_with(name)).expect("a row");
        assert!(row("> left").contains(value) && !screen.contains("-?"), "{screen}");
        assert!(row("  right").contains(" up 20/s"), "{screen}");
    }
}

/// The last frame on a lost line is not shown as present.
#[test]
fn the_reply_window_of_a_silent_ecu_is_empty() {
    let keys = [(50.0, char('v')), (50.1, char('f')), (50.2, char('c')), (50.3, press(KeyCode::Esc))];
    for (end, expected) in [(50.1, " ms left"), (53.0, "reply window: nothing received for 2.")] {
        let played = pair(end, &keys, "silent-window");
        let screen = text(&buffer(&played.model, COLOUR, 120, 30));
        assert!(screen.contains(expected), "{screen}");
        let bar = screen.lines().find(|line| line.contains('[')).expect("a bar");
        assert_eq!(bar.contains('█'), end < 51.0, "{screen}");
    }
}

/// A word that says less, in place of the beginning of one that says more.
#[test]
fn a_start_is_named_where_its_step_has_no_room() {
    let played = pair(10.0, &[], "starting");
    let screen = text(&buffer(&played.model, COLOUR, 80, 24));
    let row = screen.lines().find(|line| line.starts_with("> left")).expect("a row");
    assert!(row.contains("starting") && !row.contains('…'), "{row}");
}

/// It takes a while until there are enough frames to count.
#[test]
fn no_rate_of_frames_is_shown_before_it_is_known() {
    let mut seen = Vec::new();
    for tenths in 1..80 {
        let played = pair(f64::from(tenths) / 10.0, &[], "rates");
        let screen = text(&buffer(&played.model, COLOUR, 80, 24));
        let heads = screen.lines().find(|line| line.starts_with("  engine")).expect("heads");
        let row = screen.lines().find(|line| line.starts_with("> left")).expect("a row");
        let link: String = row.chars().skip(heads.find("link").unwrap_or_default()).take(7).collect();
        let link = link.trim().to_owned();
        if link.starts_with("up") && seen.last() != Some(&link) {
            seen.push(link);
        }
    }
    assert_eq!(seen, ["up", "up 8/s"]);
}

/// From the time when newer ones were due until they are no longer shown.
#[test]
fn values_that_are_not_new_are_grey() {
    let cut = [(50.0, char('f')), (50.1, char('c'))];
    for (end, old) in [(50.0, false), (51.5, true)] {
        let played = pair(end, &cut, "old");
        let value = played.model.samples[0].rpm.expect("a value").to_string();
        assert_eq!(played.model.samples[0].rpm_old.is_some(), old);
        for (width, height, places) in [(80, 24, 2), (120, 30, 1)] {
            let buffer = buffer(&played.model, COLOUR, width, height);
            let screen = text(&buffer);
            let mut found = 0;
            for (y, line) in screen.lines().enumerate() {
                let Some(at) = line.find(&value) else { continue };
                let x = line[..at].chars().count() as u16;
                let grey = buffer[(x, y as u16)].fg == Color::DarkGray;
                assert_eq!(grey, old, "{value} at {end} s, {width} × {height}:\n{screen}");
                // A terminal without colours may have no grey either.
                let plain = text(&self::buffer(&played.model, PLAIN, width, height));
                let behind =
                    plain.lines().nth(y).and_then(|line| line.split_once(&value)).expect("the value").1;
                assert_eq!(behind.starts_with('?'), old, "{plain}");
                found += 1;
            }
            assert_eq!(found, places, "{value} at {end} s:\n{screen}");
        }
    }
}

#[test]
fn ascii_screens_have_no_other_characters() {
    let mut played = pair(60.0, &[], "ascii");
    let ascii = Theme { colours: true, ascii: true };
    for (page, popup) in [
        (Page::Engines, None),
        (Page::Why, None),
        (Page::Wire, None),
        (Page::Engines, Some(Popup::Help)),
        (Page::Engines, Some(Popup::Faults)),
    ] {
        (played.model.page, played.model.popup) = (page, popup);
        for (width, height) in [(80, 24), (120, 30), (200, 50)] {
            let screen = text(&buffer(&played.model, ascii, width, height));
            assert!(screen.is_ascii(), "{page:?} {popup:?}: {screen}");
        }
    }
}

/// Engines that MAVLink or radio control commands have no script, and the line above says who commands.
#[test]
fn engines_without_pilots_have_no_script() {
    let mut played = pair(45.0, &[], "commanded");
    for sample in &mut played.model.samples {
        sample.stage = Stage::Commanded;
    }
    played.model.length = None;
    let screen = text(&buffer(&played.model, COLOUR, 80, 24));
    assert!(
        screen.starts_with("jetlink rig   45.0 s  ×1\nleft runs, commanded by bench; press f"),
        "{screen}"
    );
    assert!(screen.contains("│no script, armed"), "{screen}");
}

/// No text of the smallest screen ends in the middle: what happens, why, and the reply window.
#[test]
fn texts_of_the_smallest_screen_are_whole() {
    let mut played = play("whole", HEAD, &[], 120.0);
    let screen = text(&buffer(&played.model, COLOUR, 60, 16));
    assert_eq!(screen.lines().nth(1), Some("all engines run: steps of throttle and rpm"), "{screen}");
    played.model.page = Page::Wire;
    let screen = text(&buffer(&played.model, COLOUR, 60, 16));
    assert!(screen.contains("30 ms, 9.167 ms left"), "{screen}");
    played.model.page = Page::Why;
    let screen = text(&buffer(&played.model, COLOUR, 60, 16));
    assert!(screen.contains("Demand: commanded") && screen.contains("nothing limits it"), "{screen}");
    // So is the summary after it: two engines side by side.
    let summary = super::super::summary::text(&played.outcomes, &[], None, 60);
    let (table, _) = summary.split_once("\n\n").expect("a table");
    assert!(table.lines().all(|line| line.chars().count() <= 60) && table.contains("booster"), "{table}");
}

#[test]
fn a_fault_shows_what_the_node_does_about_it() {
    let cut = [(50.0, char('f')), (50.1, char('c')), (50.2, press(KeyCode::Esc))];
    let played = pair(52.0, &cut, "cut");
    let screen = text(&buffer(&played.model, COLOUR, 80, 24));
    assert!(screen.contains("left: nothing is received from its ECU"), "{screen}");
    assert!(screen.contains("ECU link lost") && screen.contains("set by you: cut line"), "{screen}");
    // No window missed is held against it, and the other engine is left alone.
    assert_eq!(super::super::summary::problems(&played.outcomes), Vec::<String>::new());
    assert!(played.outcomes.engines[1].played.is_none());
    let noise = [(50.0, char('f')), (50.1, char('n'))];
    let mut played = pair(53.0, &noise, "noise");
    played.model.page = Page::Wire;
    played.model.popup = None;
    let screen = text(&buffer(&played.model, COLOUR, 100, 40));
    assert!(screen.contains("SKIPPED: no frame"), "{screen}");
    assert!(screen.contains("(damaged on the way)"), "{screen}");
}

#[test]
fn the_wire_has_the_reply_in_its_window() {
    let mut played = play("wire", HEAD, &[], 60.0);
    played.model.page = Page::Wire;
    let screen = text(&buffer(&played.model, COLOUR, 100, 30));
    assert!(screen.contains("reply window: 0.000 to 20.833 ms of 30 ms, 9.167 ms left"), "{screen}");
    assert!(screen.contains("[███") && screen.contains("FF 14 "), "{screen}");
    // At 80 columns the text of a frame continues in the next line.
    let screen = text(&buffer(&played.model, COLOUR, 80, 24));
    assert!(!screen.contains('…') && screen.contains(" °C"), "{screen}");
}

#[test]
fn a_played_run_is_a_file_that_gives_the_same_bytes() {
    let keys = [
        (20.0, char('t')),
        (24.0, char('s')),
        (55.0, press(KeyCode::Up)),
        (58.0, press(KeyCode::Tab)),
        (60.0, press(KeyCode::PageUp)),
        (61.0, char('f')),
        (62.0, char('n')),
        (66.0, char('n')),
        (67.0, char('x')),
        (70.0, char('s')),
        (76.0, char('s')),
        (80.0, char(' ')),
    ];
    let played = pair(85.0, &keys, "keys");
    assert!(played.bytes.len() > 10_000);
    is_the_same_again(&played);
}

/// Replays the file of a played run.
fn is_the_same_again(played: &Played) {
    let again = play("again", &played.script, &[], f64::INFINITY);
    assert_eq!(again.script, played.script);
    let first = again.bytes.iter().zip(&played.bytes).position(|(again, played)| again != played);
    let around = |bytes: &[(usize, u64, bool, u8)]| {
        let at = first.unwrap_or_default();
        bytes[at.saturating_sub(3)..(at + 3).min(bytes.len())].to_vec()
    };
    assert_eq!(first, None, "{:?} {:?} {}", around(&again.bytes), around(&played.bytes), played.script);
    assert_eq!(again.bytes.len(), played.bytes.len());
    assert_eq!(again.outcomes.length, played.outcomes.length);
}

/// A fault that lasts already, or that has ended, changes nothing: it is not recorded.
#[test]
fn a_run_played_by_keys_beside_a_script_is_a_file_that_gives_the_same_bytes() {
    let documented = include_str!("../../../../docs/captures/played.txt").to_owned();
    let faults = "silent speak s cut mend c cut-to-ecu mend-to-ecu e noise quiet n power-off power-on p";
    let faults: Vec<&str> = faults.split(' ').collect();
    let mut cases = vec![
        (documented.clone(), 's', "45.0 left silent", "51.0 left speak"),
        (
            format!("{HEAD}{PAIR}rc sbus\n4 right silent\n6 right speak\n9 end\n"),
            's',
            "4.0",
            "6.0 right speak",
        ),
    ];
    for fault in faults.chunks(3) {
        let (begin, end) = (fault[0], fault[1]);
        for name in ["left", "all"] {
            let script = format!("{HEAD}{PAIR}4 {name} {begin}\n6 {name} {end}\n9 end\n");
            cases.push((script, fault[2].chars().next().unwrap(), "4.0 left", "6.0 left"));
        }
    }
    for (script, key, begins, ends) in cases {
        let (begin, end): (f64, f64) = if script == documented { (45.0, 65.0) } else { (4.0, 9.0) };
        // Before the script begins the fault, and while the script's fault lasts.
        for (at, dropped) in [(1.1, begins), (begin + 1.0, ends)] {
            let keys = [(at - 0.1, char('f')), (at, char(key))];
            let played = play("beside", &script, &keys, end);
            assert!(played.outcomes.by_key, "{at}: {script}");

            assert!(!played.script.contains(dropped), "{at}: {}", played.script);
            is_the_same_again(&played);
        }
    }
}

/// Writes them with `JETLINK_WRITE_PICTURES=1 cargo test --package host pictures_and_texts`.
#[test]
fn pictures_and_texts_of_the_documentation_are_what_the_screen_shows() {
    let docs = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/screens");
    let write = std::env::var_os("JETLINK_WRITE_PICTURES").is_some();
    // The source of left has fallen silent.
    let mut played = play("picture", &tour(), &[], 131.2);
    played.model.passing.auto = true;
    for (width, height) in [(80, 24), (200, 50)] {
        let buffer = buffer(&played.model, COLOUR, width, height);
        let name = format!("rig-{width}x{height}");
        for (name, content) in [
            (format!("{name}.txt"), text(&buffer)),
            (format!("{name}.svg"), picture::svg(&buffer, false)),
            (format!("{name}-dark.svg"), picture::svg(&buffer, true)),
        ] {
            assert!(content.len() < 150_000, "{name} has {} bytes", content.len());
            let path = docs.join(&name);
            if write {
                std::fs::write(&path, &content).unwrap();
            }
            let committed = std::fs::read_to_string(&path).unwrap_or_default();
            assert!(committed == content, "docs/screens/{name} is not what the screen shows");
            if name.ends_with(".svg") {
                roxmltree::Document::parse(&content).expect("well-formed XML");
            }
        }
    }
}
