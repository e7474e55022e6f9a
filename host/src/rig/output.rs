//! The files that a run writes: all are checked before it begins, and none is changed before all are good.

use super::ending::EndRequest;
use super::waiting;
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::path::{Path, PathBuf};

/// Number of names that are tried for a file without a given name.
const NEW_NAMES: u32 = 1000;

/// A file named on the command line.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// The option that names it, or its folder.
    pub option: &'static str,
    /// Where it is, or is to be.
    pub path: String,
    /// How it is used.
    pub kind: Kind,
}

/// How a file is used.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Kind {
    /// Read, and not to be written.
    Read,
    /// From its beginning, whatever its name.
    Direct,
    /// As a [`Whole`]; its name ends with this.
    Whole(&'static str),
    /// From its beginning, in a folder that may have to be made.
    InFolder,
}

/// Why a file cannot be written.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Problem {
    /// The command line is wrong.
    Option(String),
    /// The file or its folder cannot be written.
    File(String),
}

/// Checks all of them, and changes none.
pub fn check(wanted: &[Wanted]) -> Result<(), Problem> {
    for (i, one) in wanted.iter().enumerate() {
        if one.path.is_empty() {
            let what = if one.kind == Kind::InFolder { "folder" } else { "file" };
            return Err(Problem::Option(format!("{} needs the name of a {what}", one.option)));
        }
        if one.path == "-" && one.kind != Kind::Read {
            let option = one.option;
            return Err(Problem::Option(format!(
                "{option} takes no \"-\": name /dev/stdout, or ./- for a file"
            )));
        }
        let path = Path::new(&one.path);
        if let Some(found) = path.extension().and_then(|ending| ending.to_str())
            && let Kind::Whole(ending) = one.kind
            && !found.eq_ignore_ascii_case(ending)
        {
            return Err(Problem::Option(format!(
                "{} writes {}: name the file {}",
                one.option,
                ending.to_uppercase(),
                path.with_extension(ending).display()
            )));
        }
        // A file in a folder requires that the folder is one.
        let (own, before) = (place(&one.path), wanted.iter().take(i));
        let is_folder = |of: &&Wanted| {
            of.kind != Kind::InFolder && own != place(&of.path) && own.starts_with(place(&of.path))
        };
        if let Some(other) = before.clone().find(is_folder) {
            return Err(Problem::Option(format!(
                "{} would need a folder where {} writes a file, {}",
                one.option, other.option, other.path
            )));
        }
        let same =
            |other: &&Wanted| place(&other.path) == place(&one.path) || is_one_file(&other.path, &one.path);
        if let Some(other) = wanted.iter().take(i).find(same) {
            return Err(Problem::Option(format!(
                "{} and {} name the same file, {}",
                other.option, one.option, one.path
            )));
        }
    }
    for one in wanted.iter().filter(|one| one.kind != Kind::Read && !waiting::is_stdout(&one.path)) {
        if is_of_stdout(&one.path) {
            return Err(Problem::Option(format!(
                "{} and the standard output name the same file, {}: use /dev/stdout, or another file",
                one.option, one.path
            )));
        }
    }
    for one in wanted {
        let found = match one.kind {
            Kind::Read => Ok(()),
            Kind::Direct => can_write(Path::new(&one.path)),
            Kind::Whole(_) => can_write(Path::new(&one.path)).and_then(|()| can_replace(&one.path)),
            // Nothing can be lost in a folder that does not exist yet.
            Kind::InFolder if Path::new(&one.path).parent().is_some_and(is_missing) => Ok(()),
            Kind::InFolder => can_write(Path::new(&one.path)),
        };
        found.map_err(|error| Problem::File(cannot_write(&one.path, &error)))?;
    }
    Ok(())
}

/// Error message for a file that cannot be written.
pub fn cannot_write(path: &str, error: &io::Error) -> String {
    format!("cannot write {path}: {error}")
}

/// Writes a file without a given name: always a new one, even if this name and the following ones exist.
pub fn write_new(folder: &Path, name: &str, ending: &str, text: &str) -> Result<PathBuf, String> {
    let mut path = folder.join(format!("{name}.{ending}"));
    for number in 2..=NEW_NAMES {
        // Neither a file nor a link that is there is opened.
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            Ok(mut file) => {
                let written = file.write_all(text.as_bytes());
                return written
                    .map(|()| path.clone())
                    .map_err(|error| cannot_write(&path.display().to_string(), &error));
            }
            Err(error) if error.kind() == ErrorKind::AlreadyExists && number < NEW_NAMES => {
                path = folder.join(format!("{name}-{number}.{ending}"));
            }
            Err(error) => return Err(cannot_write(&path.display().to_string(), &error)),
        }
    }
    Err(cannot_write(&path.display().to_string(), &ErrorKind::AlreadyExists.into()))
}

/// Whether this is the terminal of this program by another name.
pub fn is_terminal(path: &str) -> bool {
    path == "/dev/tty" || (waiting::is_stderr(path) && io::stderr().is_terminal())
}

/// A path as a word of a shell's command line.
pub fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+,:=@%".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) {
        return text;
    }
    format!("'{}'", text.replace('\'', "'\\''"))
}

/// The same for all names of one file, also in a folder that is still to be made.
fn place(path: &str) -> PathBuf {
    let path = Path::new(path);
    let in_folder = |folder: &Path| {
        let below = path.strip_prefix(folder).ok()?;
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        Some(fs::canonicalize(folder).ok()?.components().chain(below.components()).collect())
    };
    path.ancestors().find_map(in_folder).unwrap_or_else(|| path.to_owned())
}

/// Whether both are names of one regular file, as hard links are.
#[cfg(unix)]
fn is_one_file(a: &str, b: &str) -> bool {
    use std::os::unix::fs::MetadataExt;
    let of = |path: &str| fs::metadata(path).ok().filter(fs::Metadata::is_file);
    of(a).zip(of(b)).is_some_and(|(a, b)| (a.dev(), a.ino()) == (b.dev(), b.ino()))
}

/// Whether the shell has sent the standard output to this regular file, by its own name.
#[cfg(unix)]
fn is_of_stdout(path: &str) -> bool {
    use std::os::unix::fs::MetadataExt;
    let named = fs::metadata(path).ok().filter(fs::Metadata::is_file);
    let stdout = waiting::own("/dev/stdout").and_then(Result::ok).and_then(|file| file.metadata().ok());
    named.zip(stdout).is_some_and(|(a, b)| (a.dev(), a.ino()) == (b.dev(), b.ino()))
}

#[cfg(not(unix))]
const fn is_of_stdout(_: &str) -> bool {
    false
}

/// Here files can be compared only by their paths.
#[cfg(not(unix))]
const fn is_one_file(_: &str, _: &str) -> bool {
    false
}

fn is_missing(path: &Path) -> bool {
    fs::metadata(path).is_err_and(|error| error.kind() == ErrorKind::NotFound)
}

/// Whether a [`Whole`] can be made here.
fn can_replace(path: &str) -> io::Result<()> {
    if is_regular(path) { can_write(&part(path)) } else { Ok(()) }
}

/// A regular file, or none yet.
fn is_regular(path: &str) -> bool {
    fs::metadata(path).map_or(true, |found| found.is_file())
}

fn can_write(path: &Path) -> io::Result<()> {
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => Err(io::Error::from(ErrorKind::IsADirectory)),
        Ok(found) if found.is_file() => OpenOptions::new().write(true).open(path).map(drop),
        // Opening a FIFO waits for its reader.
        Ok(_) => Ok(()),
        Err(error) if error.kind() == ErrorKind::NotFound => {
            if let Ok(target) = fs::read_link(path) {
                let text = format!("it is a link to {}, which does not exist", target.display());
                return Err(io::Error::new(ErrorKind::NotFound, text));
            }
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
    end: EndRequest,
}

impl Whole {
    /// For this target. `end`: ends the wait for the reader of a FIFO.
    pub fn new(path: &str, end: &EndRequest) -> Self {
        Self { path: path.to_owned(), part: is_regular(path).then(|| part(path)), end: end.clone() }
    }

    /// Writes it.
    pub fn finish(self, text: &str) -> Result<(), String> {
        let written = match &self.part {
            // A link stays a link: its target is replaced.
            Some(part) => {
                let target = fs::canonicalize(&self.path).unwrap_or_else(|_| PathBuf::from(&self.path));
                write_as(part, text, &target).and_then(|()| fs::rename(part, target))
            }
            None => waiting::write(&self.path, text, &self.end),
        };
        if written.is_err()
            && let Some(part) = &self.part
        {
            let _ = fs::remove_file(part); // the first error is the one to report
        }
        written.map_err(|error| cannot_write(&self.path, &error))
    }
}

/// Writes a file with the read permissions of the one that it replaces.
fn write_as(part: &Path, text: &str, target: &Path) -> io::Result<()> {
    let mut file = File::create(part)?;
    if let Ok(before) = fs::metadata(target) {
        file.set_permissions(before.permissions())?;
    }
    file.write_all(text.as_bytes())
}

/// The temporary file beside this one, or beside what a link points to.
fn part(path: &str) -> PathBuf {
    let target = fs::canonicalize(path).unwrap_or_else(|_| PathBuf::from(path));
    let name = target.file_name().unwrap_or_default().to_string_lossy().into_owned();
    target.with_file_name(format!(".{name}.{}.part", std::process::id()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn a_file_with_a_default_name_never_replaces_another() {
        let folder = std::env::temp_dir().join(format!("jetlink-new-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let (target, name) = (folder.join("target"), |name: &str| folder.join(name));
        fs::write(&target, "precious").unwrap();
        std::os::unix::fs::symlink(&target, name("run.txt")).unwrap();
        fs::write(name("run-2.txt"), "played before").unwrap();
        assert_eq!(write_new(&folder, "run", "txt", "played"), Ok(name("run-3.txt")));
        assert_eq!(fs::read_to_string(name("run-3.txt")).unwrap(), "played");
        assert_eq!(fs::read_to_string(&target).unwrap(), "precious");
        assert_eq!(fs::read_to_string(name("run-2.txt")).unwrap(), "played before");
        assert!(write_new(&folder.join("none"), "run", "txt", "played").is_err());
        fs::remove_dir_all(&folder).unwrap();
    }
}
