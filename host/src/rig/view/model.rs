//! What the screen shows: gathered from the run's messages, changed by keys. It draws nothing and reads no terminal.

use super::super::context::Note;
use super::super::engines::{ALL, Engine};
use super::super::frames::Frames;
use super::super::lines::Rates;
use super::super::message::Message;
use super::super::outcome::Outcomes;
use super::super::passing::Passing;
use super::super::play::action::Wish;
use super::super::record::Record;
use super::super::sample::{Detail, Sample};
use super::super::simulated::parameters;
use super::super::summary;
use super::keys::{Does, FAULTS, KEYS, Key, RELEASE, does};
use crossterm::event::KeyEvent;
use embassy_time::{Duration, Instant};
use ratatui::layout::Rect;
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;

/// Events that are stored to be printed at the end.
const EVENT_CAPACITY: usize = 2000;

/// What is known of an engine before the run.
#[derive(Debug)]
pub struct Subject {
    /// The engine.
    pub engine: Engine,
    /// Shaft speed at full throttle.
    pub max_rpm: f64,
    /// Above this EGT in °C the node reports a limit.
    pub egt_limit: Option<f64>,
}

/// What fills the screen.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Page {
    /// All engines.
    Engines,
    /// Why the selected one does what it does.
    Why,
    /// What is on its wire.
    Wire,
}

/// What lies above it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Popup {
    /// The keys.
    Help,
    /// The faults.
    Faults,
    /// Whether to release the emergency stop.
    Release,
}

/// What a key requests from the rest of the program.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Requested {
    /// Of the run.
    Wish(Option<usize>, Wish),
    /// Pause, speeds.
    Passing(Does),
    /// To end it.
    Quit,
    /// To end it as Ctrl-C does.
    Interrupt,
    /// To give the terminal back for a while.
    Suspend,
    /// The mouse, on or off.
    Mouse(bool),
}

/// An event, as it is shown.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Event {
    /// When.
    pub at: Instant,
    /// Whose.
    pub name: &'static str,
    /// What.
    pub text: String,
}

impl Event {
    /// Where the text of a line begins.
    pub const INDENT: usize = 23;

    /// As a line.
    pub fn line(&self) -> String {
        let seconds = (self.at - Instant::MIN).as_micros() as f64 / 1e6;
        format!("{seconds:>7.1}  {:<12}  {}", self.name, self.text)
    }
}

/// The end of a run that was complete.
#[derive(Clone, Debug)]
pub struct Verdict {
    /// Nothing was wrong.
    pub pass: bool,
    /// What was, or that nothing was.
    pub lines: Vec<String>,
}

/// Contents of the screen.
#[derive(Debug)]
pub struct Model {
    /// The engines.
    pub subjects: Vec<Subject>,
    /// Planned length of the run, if it has an end.
    pub length: Option<Duration>,
    /// Engine time.
    pub at: Instant,
    /// Present samples of all engines; empty before the first sample.
    pub samples: Vec<Sample>,
    /// Details of each.
    pub details: Vec<Detail>,
    /// Frames a second of each.
    pub rates: Rates,
    /// Record of the samples.
    pub record: Record,
    /// Frames on each line.
    pub frames: Vec<Frames>,
    /// Events, the latest last.
    pub events: VecDeque<Event>,
    /// Events that are not stored any more.
    pub dropped: usize,
    /// How the run passes.
    pub passing: Passing,
    /// The selected engine.
    pub selected: usize,
    /// What fills the screen.
    pub page: Page,
    /// What lies above it.
    pub popup: Option<Popup>,
    /// The page of the keys that is shown, counted from 0.
    pub help_page: usize,
    /// The number of pages that the keys take on this screen.
    pub help_pages: Cell<usize>,
    /// The mouse selects engines.
    pub mouse: bool,
    /// A scenario is played: it takes no action but an emergency stop.
    pub scenario: bool,
    /// The keys move a transmitter.
    pub transmitter: bool,
    /// The end.
    pub verdict: Option<Verdict>,
    /// Where each engine was drawn, for the mouse.
    pub places: RefCell<Vec<(Rect, usize)>>,
}

impl Model {
    /// Before a run of these engines.
    pub fn new(engines: &[Engine], length: Option<Duration>, scenario: bool) -> Self {
        let subject = |engine: &Engine| Subject {
            engine: *engine,
            max_rpm: parameters(engine).max_rpm,
            egt_limit: engine
                .config
                .supervision
                .limits
                .over_temperature
                .at
                .map(|limit| f64::from(limit.tenths()) / 10.0),
        };
        Self {
            subjects: engines.iter().map(subject).collect(),
            length,
            at: Instant::MIN,
            samples: Vec::new(),
            details: Vec::new(),
            rates: Rates::default(),
            record: Record::new(engines.len()),
            frames: engines.iter().map(Frames::new).collect(),
            events: VecDeque::new(),
            dropped: 0,
            passing: Passing { speed: 1, auto: false, paused: false },
            selected: 0,
            page: Page::Engines,
            popup: None,
            help_page: 0,
            help_pages: Cell::new(1),
            mouse: false,
            scenario,
            transmitter: false,
            verdict: None,
            places: RefCell::default(),
        }
    }

    /// Name of an engine.
    pub fn name(&self, engine: usize) -> &'static str {
        self.subjects.get(engine).map_or("?", |subject| subject.engine.name())
    }

    /// Names of all engines.
    pub fn names(&self) -> Vec<&'static str> {
        self.subjects.iter().map(|subject| subject.engine.name()).collect()
    }

    /// Takes a message of the run.
    pub fn message(&mut self, message: Message) {
        match message {
            Message::Note(note) => self.note(note),
            Message::Samples { at, samples, details } => self.samples(at, samples, details),
            Message::Passing(passing) => self.passing = passing,
            Message::Complete(outcomes) => self.complete(&outcomes),
            // It is noted too.
            Message::Mark { .. } => {}
        }
    }

    pub(super) fn note(&mut self, note: Note) {
        let name = note.engine.map_or(ALL, |engine| self.name(engine));
        self.events.push_back(Event { at: note.at, name, text: note.text });
        if self.events.len() > EVENT_CAPACITY {
            self.events.pop_front();
            self.dropped += 1;
        }
    }

    fn samples(&mut self, at: Instant, samples: Vec<Sample>, details: Vec<Detail>) {
        // It is played on.
        if at > self.at && self.verdict.is_some() {
            self.verdict = None;
        }
        self.at = at;
        self.record.add(at, &samples);
        for (frames, detail) in self.frames.iter_mut().zip(&details) {
            frames.add(&detail.entries);
        }
        self.rates.count(at, &samples);
        self.samples = samples;
        self.details = details;
    }

    fn complete(&mut self, outcomes: &Outcomes) {
        let problems = summary::problems(outcomes);
        let pass = problems.is_empty();
        let lines = if pass { vec![summary::pass(outcomes).to_owned()] } else { problems };
        self.verdict = Some(Verdict { pass, lines });
    }

    /// Takes a key.
    pub fn key(&mut self, event: &KeyEvent) -> Option<Requested> {
        let does = does(event, self.open_keys())?;
        self.act(does, event)
    }

    fn open_keys(&self) -> &'static [Key] {
        match self.popup {
            Some(Popup::Faults) => &FAULTS,
            Some(Popup::Release) => &RELEASE,
            Some(Popup::Help) | None => &[],
        }
    }

    fn act(&mut self, does: Does, event: &KeyEvent) -> Option<Requested> {
        let count = self.subjects.len().max(1);
        if self.scenario && does.is_of_script() {
            let text =
                "a scenario plays by itself: only an emergency stop and its release act on its engines"
                    .to_owned();
            self.note(Note { at: self.at, engine: None, text });
            return None;
        }
        match does {
            Does::Wish(wish) => {
                if self.popup == Some(Popup::Release) {
                    self.popup = None;
                }
                return Some(Requested::Wish(Some(self.selected), wish));
            }
            Does::WishAll(wish) => return Some(Requested::Wish(None, wish)),
            Does::Select => {
                if let crossterm::event::KeyCode::Char(digit) = event.code
                    && let Some(place) = digit.to_digit(10).and_then(|digit| digit.checked_sub(1))
                    && (place as usize) < count
                {
                    self.selected = place as usize;
                }
            }
            Does::Previous => self.selected = (self.selected + count - 1) % count,
            Does::Next => self.selected = (self.selected + 1) % count,
            Does::Faults => self.toggle(Popup::Faults),
            Does::Release => self.toggle(Popup::Release),
            // The next page, and closed after the last one.
            Does::Help => {
                let next = self.help_page + 1;
                if self.popup != Some(Popup::Help) {
                    (self.popup, self.help_page) = (Some(Popup::Help), 0);
                } else if next < self.help_pages.get() {
                    self.help_page = next;
                } else {
                    self.popup = None;
                }
            }
            Does::Why => self.page = if self.page == Page::Why { Page::Engines } else { Page::Why },
            Does::Wire => self.page = if self.page == Page::Wire { Page::Engines } else { Page::Wire },
            Does::Close => {
                if self.popup.take().is_none() {
                    self.page = Page::Engines;
                }
            }
            Does::Pause | Does::Step | Does::Faster | Does::Slower | Does::Auto => {
                return Some(Requested::Passing(does));
            }
            Does::Mouse => {
                self.mouse = !self.mouse;
                return Some(Requested::Mouse(self.mouse));
            }
            Does::Quit => return Some(Requested::Quit),
            Does::Interrupt => return Some(Requested::Interrupt),
            Does::Suspend => return Some(Requested::Suspend),
        }
        None
    }

    fn toggle(&mut self, popup: Popup) {
        self.popup = if self.popup == Some(popup) { None } else { Some(popup) };
    }

    /// A click selects the engine that is drawn there, with the mouse on.
    pub fn click(&mut self, column: u16, row: u16) {
        if !self.mouse {
            return;
        }
        let places = self.places.borrow();
        let hit = places.iter().find(|(place, _)| place.contains((column, row).into()));
        if let Some(&(_, engine)) = hit {
            self.selected = engine;
        }
    }

    /// The keys that do something in this run.
    pub fn keys(&self) -> impl Iterator<Item = &'static Key> {
        KEYS.iter().filter(|key| !self.scenario || !key.does.is_of_script())
    }
}
