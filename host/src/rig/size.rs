//! Size of the terminal.

use std::io;

/// Columns and lines of one that does not report them: serial consoles and `ssh -tt` report 0.
pub const USUAL: (u16, u16) = (80, 24);

/// Columns and lines of the terminal.
pub fn of_terminal() -> io::Result<(u16, u16)> {
    crossterm::terminal::size().map(|(width, height)| match (width, height) {
        (0, _) | (_, 0) => USUAL,
        size => size,
    })
}
