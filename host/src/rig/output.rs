//! The files that a run writes: all of them are checked before it begins, and none is touched before all are good.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// A file that is asked for on the command line.
#[derive(Clone, Copy, Debug)]
pub struct Wanted<'a> {
    /// The option that names it.
    pub option: &'static str,
    /// Where it is to be.
    pub path: &'a str,
    /// What its name ends with, if it has an ending; empty for any.
    pub ending: &'static str,
}

/// Why a file cannot be written.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Problem {
    /// The command line is wrong.
    Option(String),
    /// The file or its folder takes nothing.
    File(String),
}

/// Checks all of them, and changes none.
pub fn check(wanted: &[Wanted<'_>]) -> Result<(), Problem> {
    for (i, one) in wanted.iter().enumerate() {
        let ending = Path::new(one.path).extension().and_then(|ending| ending.to_str());
        if let Some(ending) = ending
            && !one.ending.is_empty()
            && !ending.eq_ignore_ascii_case(one.ending)
        {
            return Err(Problem::Option(format!(
                "{} writes {}: name the file {}",
                one.option,
                one.ending.to_uppercase(),
                Path::new(one.path).with_extension(one.ending).display()
            )));
        }
        let same = |other: &&Wanted<'_>| place(other.path) == place(one.path);
        if let Some(other) = wanted.iter().take(i).find(same) {
            return Err(Problem::Option(format!(
                "{} and {} name the same file, {}",
                other.option, one.option, one.path
            )));
        }
    }
    for one in wanted {
        can_write(one.path).map_err(|error| Problem::File(cannot_write(one.path, &error)))?;
    }
    Ok(())
}

/// That a file takes nothing, for people.
pub fn cannot_write(path: &str, error: &io::Error) -> String {
    format!("cannot write {path}: {error}")
}

/// Whether this is the standard output by another name.
pub fn is_stdout(path: &str) -> bool {
    matches!(path, "/dev/stdout" | "/dev/fd/1" | "/proc/self/fd/1")
}

/// The same for all names of one file.
fn place(path: &str) -> PathBuf {
    let path = Path::new(path);
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let in_folder = || Some(fs::canonicalize(folder).ok()?.join(path.file_name()?));
    fs::canonicalize(path).ok().or_else(in_folder).unwrap_or_else(|| path.to_owned())
}

fn can_write(path: &str) -> io::Result<()> {
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => Err(io::Error::from(ErrorKind::IsADirectory)),
        Ok(found) if found.is_file() => OpenOptions::new().write(true).open(path).map(drop),
        // To open a FIFO waits for its reader.
        Ok(_) => Ok(()),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            OpenOptions::new().write(true).create_new(true).open(path)?;
            fs::remove_file(path)
        }
        Err(error) => Err(error),
    }
}

/// A file that is written as a whole at the end. Until then the one before stays.
#[derive(Debug)]
pub struct Whole {
    path: String,
    /// Beside the target, to be renamed; `None` where the target is no regular file.
    part: Option<PathBuf>,
}

impl Whole {
    /// Reserves the place.
    pub fn create(path: &str) -> Result<Self, String> {
        let is_regular = fs::metadata(path).map_or(true, |found| found.is_file());
        let part = if is_regular { Some(part(path)) } else { None };
        if let Some(part) = &part {
            File::create(part).map_err(|error| cannot_write(path, &error))?;
        }
        Ok(Self { path: path.to_owned(), part })
    }

    /// Writes it.
    pub fn finish(mut self, text: &str) -> Result<(), String> {
        let part = self.part.take();
        let written = match &part {
            // A link stays one: what it points to is replaced.
            Some(part) => {
                let target = fs::canonicalize(&self.path).unwrap_or_else(|_| PathBuf::from(&self.path));
                fs::write(part, text).and_then(|()| fs::rename(part, target))
            }
            None => OpenOptions::new().write(true).open(&self.path).and_then(|mut file| {
                file.write_all(text.as_bytes())?;
                file.flush()
            }),
        };
        if written.is_err()
            && let Some(part) = part
        {
            let _ = fs::remove_file(part); // the error that counts is the first
        }
        written.map_err(|error| cannot_write(&self.path, &error))
    }
}

impl Drop for Whole {
    fn drop(&mut self) {
        if let Some(part) = self.part.take() {
            let _ = fs::remove_file(part); // nothing more can be done about it
        }
    }
}

/// The temporary file beside this one, or beside what a link points to.
fn part(path: &str) -> PathBuf {
    let target = fs::canonicalize(path).unwrap_or_else(|_| PathBuf::from(path));
    let name = target.file_name().unwrap_or_default().to_string_lossy().into_owned();
    target.with_file_name(format!(".{name}.{}.part", std::process::id()))
}
