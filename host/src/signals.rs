//! The signals that end a program.

use std::io;

/// Whether the parent process has the signal ignored, as `nohup` does. Known on Linux only.
pub fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    u32::try_from(signal - 1).is_ok_and(|bit| ignored.checked_shr(bit).is_some_and(|mask| mask & 1 == 1))
}

/// Ignores the first Ctrl-C if standard input is a pipe: the same key ends the writer, and its output still has to be read.
/// The second one ends the program.
#[cfg(unix)]
pub fn read_pipe_to_its_end() -> io::Result<()> {
    use signal_hook::consts::SIGINT;
    use std::fs::File;
    use std::os::fd::AsFd;
    use std::os::unix::fs::FileTypeExt;
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;
    let stdin = File::from(io::stdin().as_fd().try_clone_to_owned()?);
    let is_pipe = stdin.metadata()?.file_type().is_fifo();
    if is_pipe && !is_ignored(SIGINT) {
        let interrupted = Arc::new(AtomicBool::new(false));
        // In this order: the first one finds the flag not set yet.
        signal_hook::flag::register_conditional_default(SIGINT, Arc::clone(&interrupted))?;
        signal_hook::flag::register(SIGINT, interrupted)?;
    }
    Ok(())
}

#[cfg(not(unix))]
pub const fn read_pipe_to_its_end() -> io::Result<()> {
    Ok(())
}
