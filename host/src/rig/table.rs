//! The live table on a terminal, drawn with plain control sequences on the alternate screen.
//!
//! The terminal is put back as it was when the table is dropped, also by a panic. In raw mode Ctrl-C is a
//! key: it ends the run, and the summary is still printed.

use super::desk::Note;
use super::ending::{EndRequest, EndedBy};
use super::lines::frame_rates;
use super::quantity::seconds;
use super::row::{heads, row};
use super::sample::Sample;
use crossterm::event::{Event, KeyCode, KeyEventKind, KeyModifiers, poll, read};
use crossterm::style::{Attribute, Print, SetAttribute};
use crossterm::terminal::{
    BeginSynchronizedUpdate, Clear, ClearType, EndSynchronizedUpdate, EnterAlternateScreen,
    LeaveAlternateScreen, disable_raw_mode, enable_raw_mode, size,
};
use crossterm::{cursor, execute, queue};
use embassy_time::{Duration, Instant};
use std::collections::VecDeque;
use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Between two pictures.
const DRAW_EVERY: Duration = Duration::from_millis(200);
/// Over which frames a second are counted.
const RATE_SPAN: Duration = Duration::from_secs(2);
/// Notes that are kept for the lower part of the screen.
const NOTES_KEPT: usize = 100;

/// Before a note's text stand its time and a name.
const TEXT_OF_NOTE: usize = 23;

/// The live table.
#[derive(Debug)]
pub struct Table {
    names: Vec<&'static str>,
    length: Duration,
    next: Instant,
    before: Option<(Instant, Vec<u32>)>,
    rates: Vec<f64>,
    notes: VecDeque<String>,
    end: EndRequest,
    screen: AlternateScreen,
}

/// The alternate screen in raw mode, as long as it lives and nothing has panicked.
#[derive(Debug)]
struct AlternateScreen {
    /// A panic has put the terminal back: what is drawn now would cover its message.
    left: Arc<AtomicBool>,
}

impl AlternateScreen {
    fn enter() -> io::Result<Self> {
        enable_raw_mode()?;
        let left = Arc::new(AtomicBool::new(false));
        let screen = Self { left: left.clone() };
        execute!(io::stdout(), EnterAlternateScreen, cursor::Hide)?;
        // A panic, in whatever thread, is to be read on the normal screen.
        let print = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            left.store(true, Ordering::SeqCst);
            restore();
            print(panic);
        }));
        Ok(screen)
    }
}

impl Drop for AlternateScreen {
    fn drop(&mut self) {
        if !self.left.load(Ordering::SeqCst) {
            restore();
        }
    }
}

fn restore() {
    // Nothing can be done if the terminal does not listen any more.
    let _ = execute!(io::stdout(), EndSynchronizedUpdate, LeaveAlternateScreen, cursor::Show);
    let _ = disable_raw_mode();
}

impl Table {
    /// Takes the terminal over.
    pub fn new(names: Vec<&'static str>, length: Duration, end: EndRequest) -> io::Result<Self> {
        Ok(Self {
            rates: vec![0.0; names.len()],
            names,
            length,
            next: Instant::MIN,
            before: None,
            notes: VecDeque::new(),
            end,
            screen: AlternateScreen::enter()?,
        })
    }

    /// Something happened.
    pub fn note(&mut self, note: &Note) {
        let name = note.engine.and_then(|i| self.names.get(i)).copied().unwrap_or("all");
        self.notes.push_front(format!("{:>7.1}  {name:<12}  {}", seconds(note.at - Instant::MIN), note.text));
        self.notes.truncate(NOTES_KEPT);
    }

    /// A sample of all engines; drawn if it is time.
    pub fn samples(&mut self, at: Instant, samples: &[Sample]) -> io::Result<()> {
        if at < self.next {
            return Ok(());
        }
        self.next = at + DRAW_EVERY;
        let frames: Vec<u32> = samples.iter().map(|sample| sample.counters.frames).collect();
        if self.before.as_ref().is_none_or(|(since, _)| at >= *since + RATE_SPAN) {
            self.rates = frame_rates(&self.before, at, &frames);
            self.before = Some((at, frames));
        }
        self.draw(at, samples)?;
        look_at_keys(&self.end);
        Ok(())
    }

    fn draw(&self, at: Instant, samples: &[Sample]) -> io::Result<()> {
        let (width, height) = size()?;
        let passed = seconds(at - Instant::MIN);
        let length = seconds(self.length).max(0.1);
        let done = ((passed / length * 30.0) as usize).min(30);
        let mut lines = vec![
            (
                true,
                format!("jetlink rig   {passed:.1} s of {length:.0} s   [{:<30}]   q: end", "#".repeat(done)),
            ),
            (false, String::new()),
            (true, heads(&self.names)),
        ];
        for ((name, sample), rate) in self.names.iter().zip(samples).zip(&self.rates) {
            lines.push((false, row(name, &self.names, sample, *rate)));
        }
        lines.push((false, String::new()));
        lines.push((true, "what happened, the latest first".to_owned()));
        for note in &self.notes {
            lines.extend(wrapped(note, width.into()).into_iter().map(|line| (false, line)));
        }

        let mut out = io::stdout().lock();
        // Behind the lock: a panic in the other thread says that it leaves, then waits for the lock to do so.
        if self.screen.left.load(Ordering::SeqCst) {
            return Ok(());
        }
        queue!(out, BeginSynchronizedUpdate, cursor::MoveTo(0, 0))?;
        for (y, (bold, line)) in (0..height).zip(lines) {
            let line: String = line.chars().take(width.into()).collect();
            queue!(out, cursor::MoveTo(0, y))?;
            if bold {
                queue!(out, SetAttribute(Attribute::Bold))?;
            }
            queue!(out, Print(line), SetAttribute(Attribute::Reset), Clear(ClearType::UntilNewLine))?;
        }
        queue!(out, EndSynchronizedUpdate)?;
        out.flush()
    }
}

/// A note in lines of this width; what does not fit the first stands below its text.
fn wrapped(note: &str, width: usize) -> Vec<String> {
    let indent = TEXT_OF_NOTE.min(width / 2);
    let mut lines: Vec<String> = Vec::new();
    let mut line = String::new();
    for word in note.split_inclusive(' ') {
        let fits = line.chars().count() + word.trim_end().chars().count() <= width;
        if !fits && line.chars().count() > indent {
            lines.push(core::mem::replace(&mut line, " ".repeat(indent)));
        }
        line += word;
    }
    lines.push(line);
    lines
}

/// Looks at the keys that were pressed. Where none can be read, nobody ends the run by one.
fn look_at_keys(end: &EndRequest) {
    while poll(core::time::Duration::ZERO).unwrap_or(false) {
        let Ok(Event::Key(key)) = read() else { continue };
        let control_c = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
        let by = match key.code {
            _ if key.kind != KeyEventKind::Press => continue,
            _ if control_c => EndedBy::Interrupt,
            KeyCode::Char('q') | KeyCode::Esc => EndedBy::Key,
            _ => continue,
        };
        end.request(by);
        return;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_note_is_read_to_its_end() {
        let note = format!(
            "{:>7.1}  {:<12}  {}",
            87.3, "right", "no other engine counts as failed any more (runs again)"
        );
        assert_eq!(wrapped(&note, 80), [note.as_str()]);
        let below = format!("{}more (runs again)", " ".repeat(23));
        assert_eq!(
            wrapped(&note, 60),
            ["   87.3  right         no other engine counts as failed any ", &below]
        );
        for width in 0..80 {
            let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
            assert_eq!(words(&wrapped(&note, width).join("")), words(&note), "{width}");
        }
    }
}
