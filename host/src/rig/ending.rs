//! Who ends a run before its time: a key, or a signal.

use crate::signals::is_ignored;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Who ended the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndedBy {
    /// The key `q`.
    Key,
    /// Ctrl-C, as a key or as a signal.
    Interrupt,
    /// SIGTERM: `kill`, or a shutdown.
    Terminate,
    /// SIGHUP: the terminal was closed.
    HangUp,
}

impl EndedBy {
    const ALL: [Self; 4] = [Self::Key, Self::Interrupt, Self::Terminate, Self::HangUp];

    /// For people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Key => "a key",
            Self::Interrupt => "Ctrl-C",
            Self::Terminate => "SIGTERM",
            Self::HangUp => "SIGHUP",
        }
    }

    /// The exit status: that of a shell for a signal.
    pub const fn status(self) -> u8 {
        match self {
            Self::Key => 0,
            Self::Interrupt => 130,
            Self::Terminate => 143,
            Self::HangUp => 129,
        }
    }
}

/// The request to end the run, shared by all who may make it.
#[derive(Clone, Debug, Default)]
pub struct EndRequest {
    /// 0 for none, otherwise the place in [`EndedBy::ALL`], counted from 1: a signal handler can store nothing else.
    code: Arc<AtomicUsize>,
}

impl EndRequest {
    /// From here on, signals that end a program request the end of the run, except ignored ones.
    pub fn by_signals() -> Result<Self, String> {
        let request = Self::default();
        for (signal, by) in signals() {
            if is_ignored(signal) {
                continue;
            }
            signal_hook::flag::register_usize(signal, request.code.clone(), code(by))
                .map_err(|error| format!("cannot handle {}: {error}", by.name()))?;
        }
        Ok(request)
    }

    /// Requests the end.
    pub fn request(&self, by: EndedBy) {
        self.code.store(code(by), Ordering::SeqCst);
    }

    /// Who requested the end, if anybody did.
    pub fn requested(&self) -> Option<EndedBy> {
        self.code.load(Ordering::SeqCst).checked_sub(1).and_then(|i| EndedBy::ALL.get(i).copied())
    }
}

fn code(by: EndedBy) -> usize {
    EndedBy::ALL.iter().position(|&other| other == by).map_or(0, |i| i + 1)
}

fn signals() -> Vec<(i32, EndedBy)> {
    use signal_hook::consts;
    vec![
        (consts::SIGINT, EndedBy::Interrupt),
        (consts::SIGTERM, EndedBy::Terminate),
        #[cfg(unix)]
        (consts::SIGHUP, EndedBy::HangUp),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_names_who_made_it() {
        for by in EndedBy::ALL {
            let request = EndRequest::default();
            assert_eq!(request.requested(), None);
            request.clone().request(by);
            assert_eq!(request.requested(), Some(by));
        }
    }
}
