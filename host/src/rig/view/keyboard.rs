//! What a person does at the terminal, read in a thread of its own: where a terminal goes away in the middle of a read, crossterm
//! reads on forever (0.29, `event/source/unix/mio.rs`), and the screen must not wait for it.

use crossterm::event::{Event, poll, read};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::Duration;

/// How long the thread may outlive its listener.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Keys, clicks and changes of size.
#[derive(Debug)]
pub struct Keyboard {
    /// `None`: nothing has come for a while.
    events: Receiver<Option<Event>>,
    #[cfg(unix)]
    terminal: Option<unix::Input>,
}

impl Keyboard {
    /// Listens from here on, until it is dropped.
    pub fn listen() -> Self {
        let (sender, events) = channel();
        thread::spawn(move || while forward(&sender).is_some() {});
        Self {
            events,
            #[cfg(unix)]
            terminal: unix::Input::of_this_program(),
        }
    }

    /// What has come since the last call.
    pub fn events(&self) -> Vec<Event> {
        self.events.try_iter().flatten().collect()
    }

    /// Whether the terminal is gone: its other end was closed. Nobody can press a key any more.
    pub fn is_gone(&self) -> bool {
        #[cfg(unix)]
        return self.terminal.as_ref().is_some_and(unix::Input::is_hung_up);
        #[cfg(not(unix))]
        false
    }
}

/// Passes on one event, or that none has come. `None` when nobody listens any more, or nothing can be read.
fn forward(to: &Sender<Option<Event>>) -> Option<()> {
    let event = if poll(LOOK_EVERY).ok()? { Some(read().ok()?) } else { None };
    to.send(event).ok()
}

#[cfg(unix)]
mod unix {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    use rustix::fd::{AsFd, BorrowedFd};
    use std::fs::File;
    use std::io::IsTerminal;

    /// The terminal that keys come from, as crossterm finds it.
    #[derive(Debug)]
    pub enum Input {
        Stdin(std::io::Stdin),
        Controlling(File),
    }

    impl Input {
        pub fn of_this_program() -> Option<Self> {
            let stdin = std::io::stdin();
            if stdin.is_terminal() {
                return Some(Self::Stdin(stdin));
            }
            File::open("/dev/tty").ok().map(Self::Controlling)
        }

        fn fd(&self) -> BorrowedFd<'_> {
            match self {
                Self::Stdin(stdin) => stdin.as_fd(),
                Self::Controlling(file) => file.as_fd(),
            }
        }

        pub fn is_hung_up(&self) -> bool {
            // A hang-up is reported whether it is enabled or not.
            let mut fds = [PollFd::from_borrowed_fd(self.fd(), PollFlags::empty())];
            let now = Timespec { tv_sec: 0, tv_nsec: 0 };
            poll(&mut fds, Some(&now)).is_ok()
                && fds
                    .iter()
                    .any(|fd| fd.revents().intersects(PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL))
        }
    }
}
