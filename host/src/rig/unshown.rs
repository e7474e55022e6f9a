//! Why a run could not be shown.

use std::io;

/// What ended the showing of a run.
#[derive(Debug)]
pub enum ShowError {
    /// The output of lines or rows cannot be written.
    Screen(io::Error),
    /// A file cannot be written.
    File(String),
    /// A panic, whose message has been printed.
    Panicked,
}
