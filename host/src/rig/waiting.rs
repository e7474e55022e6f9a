//! Opens the files that a run writes. For a FIFO without a reader this waits, until the run ends.

use super::ending::EndRequest;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Time between two checks of whether the run was ended.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// After it was ended: a reader that waits already is there within this time.
const GRACE: Duration = Duration::from_millis(300);
/// After this long the wait is reported.
const QUIET: Duration = Duration::from_secs(1);

/// Opens this file for writing, from its beginning; an output of this program continues at its position.
pub fn create(path: &str, end: &EndRequest) -> io::Result<File> {
    if let Some(own) = own(path) {
        return own;
    }
    if fs::metadata(path).map_or(true, |found| found.is_file()) {
        return File::create(path);
    }
    let (opened, wait) = channel();
    let (name, began) = (path.to_owned(), Instant::now());
    // It cannot be cancelled: without a reader, it ends with the program.
    std::thread::spawn(move || opened.send(File::create(name)));
    let (mut ended, mut reported) = (None, false);
    loop {
        match wait.recv_timeout(LOOK_EVERY) {
            Ok(file) => return file,
            Err(RecvTimeoutError::Disconnected) => return Err(ErrorKind::Other.into()),
            Err(RecvTimeoutError::Timeout) => {}
        }
        if end.requested().is_some() && ended.get_or_insert_with(Instant::now).elapsed() >= GRACE {
            return Err(io::Error::new(
                ErrorKind::Interrupted,
                "the run ended before a reader opened the pipe",
            ));
        }
        if !reported && began.elapsed() >= QUIET {
            reported = true;
            // Nothing can be done if this cannot be written either.
            let _ = writeln!(io::stderr(), "jetlink rig: waiting for a reader of {path}");
        }
    }
}

/// Writes this file as a whole.
pub fn write(path: &str, text: &str, end: &EndRequest) -> io::Result<()> {
    let mut file = create(path, end)?;
    file.write_all(text.as_bytes())?;
    file.flush()
}

/// Whether this is the standard output by another name.
pub fn is_stdout(path: &str) -> bool {
    matches!(path, "/dev/stdout" | "/dev/fd/1" | "/proc/self/fd/1")
}

/// The same of the standard error.
pub fn is_stderr(path: &str) -> bool {
    matches!(path, "/dev/stderr" | "/dev/fd/2" | "/proc/self/fd/2")
}

/// The standard output or error, if this is its name: a regular file that is opened again would lose its contents.
#[cfg(unix)]
pub fn own(path: &str) -> Option<io::Result<File>> {
    use std::os::fd::AsFd;
    let copy = match path {
        path if is_stdout(path) => io::stdout().as_fd().try_clone_to_owned(),
        path if is_stderr(path) => io::stderr().as_fd().try_clone_to_owned(),
        _ => return None,
    };
    Some(copy.map(File::from))
}

#[cfg(not(unix))]
pub const fn own(_: &str) -> Option<io::Result<File>> {
    None
}
