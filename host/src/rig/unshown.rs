//! Why a run could not be shown.

use std::io;

/// What ended the showing of a run.
#[derive(Debug)]
pub enum ShowError {
    /// What lines or rows go to takes nothing.
    Screen(io::Error),
    /// A file takes nothing.
    File(String),
    /// A panic, whose message has been printed.
    Panicked,
}
