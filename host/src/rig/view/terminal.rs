//! The terminal: raw mode, the alternate screen, keys in and pictures out. It is restored when this is dropped, also by a
//! panic, and while the program is suspended.

use super::super::control::Request;
use super::super::ending::{EndRequest, EndedBy};
use super::super::fit::wrapped;
use super::super::message::Message;
use super::super::size;
use super::draw::draw;
use super::keyboard::Keyboard;
use super::keys::Does;
use super::model::{Event as ModelEvent, Model, Requested};
use super::sgr::sixteen_colours;
use super::theme::Theme;
use crossterm::event::{DisableMouseCapture, EnableMouseCapture, Event, MouseButton, MouseEventKind};
use crossterm::terminal::{
    BeginSynchronizedUpdate, Clear, ClearType, EndSynchronizedUpdate, EnterAlternateScreen,
    LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};
use crossterm::{cursor, execute};
use ratatui::backend::CrosstermBackend;
use ratatui::layout::Rect;
use ratatui::{Terminal, TerminalOptions, Viewport};
use std::io::{self, Stdout, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

/// Between two pictures.
const DRAW_EVERY: Duration = Duration::from_millis(66);
/// Interval at which keys are checked while nothing else arrives.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Time within which a signal that ends the program arrives after it was continued in the background.
const END_WITHIN: Duration = Duration::from_millis(400);

/// The alternate screen in raw mode, as long as it lives and nothing has panicked.
#[derive(Debug)]
struct AlternateScreen {
    /// It was given back: to the shell, or by a panic, whose message must not be covered.
    left: Arc<AtomicBool>,
}

impl AlternateScreen {
    fn enter() -> io::Result<Self> {
        let left = Arc::new(AtomicBool::new(false));
        let screen = Self { left: left.clone() };
        take_over()?;
        // A panic in any thread has to be readable on the normal screen.
        let print = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            left.store(true, Ordering::SeqCst);
            give_back();
            print(panic);
        }));
        Ok(screen)
    }
}

impl Drop for AlternateScreen {
    fn drop(&mut self) {
        if !self.left.load(Ordering::SeqCst) {
            give_back();
        }
    }
}

fn take_over() -> io::Result<()> {
    enable_raw_mode()?;
    execute!(io::stdout(), EnterAlternateScreen, cursor::Hide)
}

/// The terminal as ratatui writes to it. When ratatui is dropped and cannot show the cursor, it prints an error, and panics if
/// that fails too, as in a closed window. So writes never fail here, but the output around each picture does.
#[derive(Debug)]
struct Forgiving {
    to: Stdout,
    /// What was written since the last flush.
    pending: Vec<u8>,
}

impl Forgiving {
    fn new() -> Self {
        Self { to: io::stdout(), pending: Vec::new() }
    }
}

impl Write for Forgiving {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.pending.extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let _ = self.to.write_all(&sixteen_colours(&core::mem::take(&mut self.pending)));
        self.to.flush().or(Ok(()))
    }
}

/// The contents of the screen are unknown, so all of it will be drawn. Ratatui's own way to clear it asks the terminal for its
/// cursor, which not every terminal answers.
fn fresh() -> io::Result<Terminal<CrosstermBackend<Forgiving>>> {
    let (width, height) = size::of_terminal()?;
    execute!(io::stdout(), Clear(ClearType::All))?;
    let viewport = Viewport::Fixed(Rect::new(0, 0, width, height));
    Terminal::with_options(CrosstermBackend::new(Forgiving::new()), TerminalOptions { viewport })
}

fn give_back() {
    // A closed terminal cannot be handled.
    let _ = execute!(
        io::stdout(),
        DisableMouseCapture,
        EndSynchronizedUpdate,
        LeaveAlternateScreen,
        cursor::Show
    );
    // The shell has then set its own modes, and stops a program that changes them.
    if in_foreground() {
        let _ = disable_raw_mode();
    }
}

/// Whether the shell has given the terminal to this program. Without job control, nobody else has it.
#[cfg(unix)]
fn in_foreground() -> bool {
    rustix::termios::tcgetpgrp(io::stdout()).map_or(true, |group| group == rustix::process::getpgrp())
}

#[cfg(not(unix))]
const fn in_foreground() -> bool {
    true
}

/// Request to the run; `None`: the key concerns the terminal, or the end.
const fn of_run(requested: Requested) -> Option<Request> {
    Some(match requested {
        Requested::Wish(engine, wish) => Request::Wish(engine, wish),
        Requested::Passing(Does::Pause) => Request::Pause,
        Requested::Passing(Does::Step) => Request::Step,
        Requested::Passing(Does::Faster) => Request::Faster,
        Requested::Passing(Does::Slower) => Request::Slower,
        Requested::Passing(_) => Request::Auto,
        Requested::Quit | Requested::Interrupt | Requested::Mouse(_) | Requested::Suspend => return None,
    })
}

/// The screen of a live run.
#[derive(Debug)]
pub struct Screen {
    model: Model,
    theme: Theme,
    terminal: Terminal<CrosstermBackend<Forgiving>>,
    keyboard: Keyboard,
    /// The terminal is gone.
    gone: bool,
    requests: Sender<Request>,
    end: EndRequest,
    drawn: Option<Instant>,
    screen: AlternateScreen,
    /// Another process suspends it, or continues it.
    stop: Arc<AtomicBool>,
    resumed: Arc<AtomicBool>,
}

impl Screen {
    /// Takes the terminal over.
    pub fn enter(model: Model, theme: Theme, requests: Sender<Request>, end: EndRequest) -> io::Result<Self> {
        let screen = AlternateScreen::enter()?;
        let terminal = fresh()?;
        let (stop, resumed) = (Arc::default(), Arc::default());
        #[cfg(unix)]
        {
            signal_hook::flag::register(signal_hook::consts::SIGTSTP, Arc::clone(&stop))?;
            signal_hook::flag::register(signal_hook::consts::SIGCONT, Arc::clone(&resumed))?;
        }
        let keyboard = Keyboard::listen();
        Ok(Self {
            model,
            theme,
            terminal,
            keyboard,
            gone: false,
            requests,
            end,
            drawn: None,
            screen,
            stop,
            resumed,
        })
    }

    /// Shows what comes until nothing more can come. `store` sees each message first, and `None` where none has come for a while.
    pub fn run<E>(
        &mut self,
        messages: &Receiver<Message>,
        mut store: impl FnMut(Option<&Message>) -> Result<(), E>,
    ) -> Result<io::Result<()>, E> {
        loop {
            match messages.recv_timeout(LOOK_EVERY) {
                Ok(message) => {
                    store(Some(&message))?;
                    self.model.message(message);
                    // Takes all waiting messages before the next picture; if more arrive than can be shown, keys still count.
                    let until = Instant::now() + DRAW_EVERY;
                    while Instant::now() < until
                        && let Ok(message) = messages.try_recv()
                    {
                        store(Some(&message))?;
                        self.model.message(message);
                    }
                }
                Err(RecvTimeoutError::Timeout) => store(None)?,
                Err(RecvTimeoutError::Disconnected) => return Ok(Ok(())),
            }
            if self.gone {
                continue; // what comes until the run has ended goes into the files
            }
            let ticked = self.tick();
            if self.keyboard.is_gone() {
                self.gone = true;
                self.end.request(EndedBy::HangUp);
            } else if let Err(error) = ticked {
                return Ok(Err(error));
            }
        }
    }

    /// What happened, for the normal screen.
    pub fn events(&self) -> String {
        let mut text = String::from("\nEvents\n");
        if self.model.dropped > 0 {
            text += &format!("({} earlier events were dropped)\n", self.model.dropped);
        }
        // The state of a closed terminal is unknown, and nobody reads it.
        let width = size::of_terminal().map_or(usize::MAX, |(width, _)| width.into());
        for event in &self.model.events {
            for line in wrapped(&event.line(), width, ModelEvent::INDENT, self.theme.mark()) {
                text += &line;
                text.push('\n');
            }
        }
        text
    }

    fn tick(&mut self) -> io::Result<()> {
        self.keys()?;
        if self.stop.swap(false, Ordering::SeqCst) {
            self.suspend()?;
        }
        // Stopped and continued by others: the shell may have changed the terminal.
        if self.resumed.swap(false, Ordering::SeqCst) {
            self.resume()?;
        }
        if self.drawn.is_some_and(|drawn| drawn.elapsed() < DRAW_EVERY) {
            return Ok(());
        }
        self.drawn = Some(Instant::now());
        // To the shell, or by a panic in the other thread.
        if self.screen.left.load(Ordering::SeqCst) {
            return Ok(());
        }
        let Self { model, theme, terminal, .. } = self;
        execute!(io::stdout(), BeginSynchronizedUpdate)?;
        terminal.draw(|frame| draw(model, *theme, frame))?;
        execute!(io::stdout(), EndSynchronizedUpdate)
    }

    /// Handles the pressed keys.
    fn keys(&mut self) -> io::Result<()> {
        for event in self.keyboard.events() {
            match event {
                Event::Key(key) => {
                    if let Some(requested) = self.model.key(&key) {
                        self.pass_on(requested)?;
                    }
                }
                Event::Mouse(mouse) if mouse.kind == MouseEventKind::Down(MouseButton::Left) => {
                    self.model.click(mouse.column, mouse.row);
                }
                // Everything drawn before is in the wrong place.
                Event::Resize(..) => self.terminal = fresh()?,
                _ => continue,
            }
            self.drawn = None;
        }
        Ok(())
    }

    fn pass_on(&mut self, requested: Requested) -> io::Result<()> {
        if let Some(request) = of_run(requested) {
            let _ = self.requests.send(request); // a run that has ended takes nothing any more
        }
        match requested {
            Requested::Wish(..) | Requested::Passing(_) => {}
            Requested::Quit => self.end.request(EndedBy::Key),
            Requested::Interrupt => self.end.request(EndedBy::Interrupt),
            Requested::Mouse(true) => execute!(io::stdout(), EnableMouseCapture)?,
            Requested::Mouse(false) => execute!(io::stdout(), DisableMouseCapture)?,
            Requested::Suspend => self.suspend()?,
        }
        Ok(())
    }

    /// Gives the terminal back to the shell until it is wanted again.
    #[cfg(unix)]
    fn suspend(&mut self) -> io::Result<()> {
        give_back();
        self.screen.left.store(true, Ordering::SeqCst);
        self.stop_here()?;
        self.resume()
    }

    #[cfg(not(unix))]
    fn suspend(&mut self) -> io::Result<()> {
        Ok(())
    }

    /// Every thread of the program stops here, the run included.
    #[cfg(unix)]
    fn stop_here(&self) -> io::Result<()> {
        signal_hook::low_level::emulate_default_handler(signal_hook::consts::SIGTSTP)?;
        self.resumed.store(false, Ordering::SeqCst);
        Ok(())
    }

    #[cfg(not(unix))]
    fn stop_here(&self) -> io::Result<()> {
        Ok(())
    }

    fn resume(&mut self) -> io::Result<()> {
        // Continued while the shell has the terminal: that waits for `fg`, or for the end.
        let mut looked = Duration::ZERO;
        while !in_foreground() {
            if self.end.requested().is_some() {
                return Ok(());
            }
            // The signal that ends it comes together with the one that continues it, and another thread may take it.
            if looked < END_WITHIN {
                std::thread::sleep(LOOK_EVERY);
                looked += LOOK_EVERY;
            } else {
                self.stop_here()?;
                looked = Duration::ZERO;
            }
        }
        take_over()?;
        self.screen.left.store(false, Ordering::SeqCst);
        if self.model.mouse {
            execute!(io::stdout(), EnableMouseCapture)?;
        }
        self.drawn = None;
        self.terminal = fresh()?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{char, pair};
    use super::*;

    #[test]
    fn the_keys_of_time_reach_the_run() {
        let mut played = pair(1.0, &[], "passing");
        for (key, request) in [
            ('p', Request::Pause),
            ('.', Request::Step),
            ('+', Request::Faster),
            ('-', Request::Slower),
            ('0', Request::Auto),
        ] {
            assert_eq!(played.model.key(&char(key)).and_then(of_run), Some(request), "{key}");
        }
        for key in ['m', 'q'] {
            assert!(
                played.model.key(&char(key)).is_some_and(|requested| of_run(requested).is_none()),
                "{key}"
            );
        }
    }
}
