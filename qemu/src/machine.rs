//! QEMU as a child: its arguments, its sockets, its end.

use crate::Arguments;
use crate::ecu::{Attached, Served};
use crate::image::Image;
use std::net::{TcpListener, TcpStream};
use std::process::{Child, ChildStderr, ChildStdout, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// UARTs of the machine; the last is kept for MAVLink.
const UARTS: usize = 5;
/// QEMU connects at once or never.
const CONNECTS_WITHIN: Duration = Duration::from_secs(20);

/// QEMU's version, as far as it matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version(u32, u32);

impl std::fmt::Display for Version {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}.{}", self.0, self.1)
    }
}

/// Asks QEMU for its version.
pub fn version(qemu: &str) -> Result<Version, String> {
    let output = match Command::new(qemu).arg("--version").output() {
        Ok(output) => output,
        Err(why) if why.kind() == std::io::ErrorKind::NotFound => {
            return Err(format!(
                "{qemu} is not installed. Debian, Ubuntu: sudo apt install qemu-system-arm; \
                 Fedora: sudo dnf install qemu-system-arm; macOS: brew install qemu. \
                 If it is somewhere else: cargo qemu --qemu <path>"
            ));
        }
        Err(why) => return Err(format!("{qemu} cannot be started: {why}")),
    };
    let text = String::from_utf8_lossy(&output.stdout);
    parse_version(&text).ok_or_else(|| format!("{qemu} does not say its version"))
}

fn parse_version(text: &str) -> Option<Version> {
    let mut numbers = text.split_once("version ")?.1.split(|c: char| !c.is_ascii_digit());
    Some(Version(numbers.next()?.parse().ok()?, numbers.next()?.parse().ok()?))
}

/// How QEMU's time passes.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// With the host's.
    Host,
    /// With the instructions, each of which is written to QEMU's stderr.
    Counted,
}

impl Pace {
    fn arguments(self, version: Version) -> &'static [&'static str] {
        match self {
            Self::Host => &[],
            // 64 ns for an instruction: about 16 million a second.
            Self::Counted if version < Version(8, 1) => {
                &["-icount", "shift=6", "-singlestep", "-d", "exec,nochain"]
            }
            Self::Counted => {
                &["-icount", "shift=6", "-accel", "tcg,one-insn-per-tb=on", "-d", "exec,nochain"]
            }
        }
    }
}

/// QEMU with the firmware in it and ECUs on its UARTs.
pub struct Machine {
    child: Child,
    began: Instant,
    ecus: Vec<Served>,
}

impl Machine {
    /// Starts QEMU and the ECUs. Their time begins now.
    pub fn start(
        arguments: &Arguments,
        version: Version,
        image: &Image,
        ecus: Vec<Attached>,
        pace: Pace,
    ) -> Result<Self, String> {
        let mut command = Command::new(&arguments.qemu);
        command
            .args(["-machine", "mps2-an500", "-display", "none", "-monitor", "none", "-no-reboot"])
            // The log comes by semihosting, to stdout in every version of QEMU.
            .args(["-chardev", "stdio,id=log,signal=off"])
            .args(["-semihosting-config", "enable=on,target=native,chardev=log"])
            .args(pace.arguments(version))
            .arg("-kernel")
            .arg(&image.path)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(if pace == Pace::Counted { Stdio::piped() } else { Stdio::inherit() });

        let mut listening = Vec::new();
        for uart in 0..UARTS - 1 {
            if let Some(ecu) = ecus.iter().find(|ecu| ecu.port() == uart) {
                let listener = TcpListener::bind("127.0.0.1:0").map_err(|why| format!("no socket: {why}"))?;
                let port = listener.local_addr().map_err(|why| format!("no socket: {why}"))?.port();
                listening.push(listener);
                let socket = format!("socket,id=ecu{uart},host=127.0.0.1,port={port},nodelay=on");
                command.args(["-chardev", &socket, "-serial", &format!("chardev:ecu{uart}")]);
                println!("UART{uart}: {}, on a socket of QEMU's at 127.0.0.1:{port}", ecu.caption());
            } else {
                command.args(["-serial", "null"]);
            }
        }
        command.args(["-serial", &arguments.telemetry]);
        if let Some(ecu) = ecus.iter().find(|ecu| ecu.port() >= UARTS - 1) {
            return Err(format!("{} sits on a port that the board does not have", ecu.caption()));
        }

        let child = command.spawn().map_err(|why| format!("{} cannot be started: {why}", arguments.qemu))?;
        let mut machine = Self { child, began: Instant::now(), ecus: Vec::new() };
        let mut ecus = ecus;
        ecus.sort_by_key(Attached::port);
        for (ecu, listener) in ecus.into_iter().zip(listening) {
            let socket = machine.accept(&listener)?;
            machine.ecus.push(ecu.serve(socket, machine.began)?);
        }
        Ok(machine)
    }

    fn accept(&mut self, listener: &TcpListener) -> Result<TcpStream, String> {
        let problem = |why: std::io::Error| format!("the socket of an ECU: {why}");
        listener.set_nonblocking(true).map_err(problem)?;
        loop {
            match listener.accept() {
                Ok((socket, _)) => {
                    socket.set_nonblocking(false).map_err(problem)?;
                    socket.set_nodelay(true).map_err(problem)?;
                    return Ok(socket);
                }
                Err(why) if why.kind() != std::io::ErrorKind::WouldBlock => return Err(problem(why)),
                Err(_) => {}
            }
            if let Some(status) = self.child.try_wait().map_err(problem)? {
                return Err(format!("QEMU ended before it began ({status}); what it said is above"));
            }
            if self.began.elapsed() > CONNECTS_WITHIN {
                return Err("QEMU does not open its sockets".into());
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// When it began.
    pub fn began(&self) -> Instant {
        self.began
    }

    /// Its stdout, once: the firmware's log.
    pub fn log(&mut self) -> Option<ChildStdout> {
        self.child.stdout.take()
    }

    /// Its stderr, once: the trace of instructions.
    pub fn trace(&mut self) -> Option<ChildStderr> {
        self.child.stderr.take()
    }

    /// Waits for its end.
    pub fn wait(&mut self, limit: Option<Duration>) -> Result<ExitStatus, String> {
        loop {
            if let Some(status) = self.child.try_wait().map_err(|why| format!("QEMU: {why}"))? {
                return Ok(status);
            }
            if limit.is_some_and(|limit| self.began.elapsed() > limit) {
                return Err(format!("no end after {} s", self.began.elapsed().as_secs()));
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Ends it, if it runs, and gives the ECUs back.
    pub fn stop(mut self) -> Vec<Attached> {
        self.end();
        std::mem::take(&mut self.ecus).into_iter().map(Served::finish).collect()
    }

    fn end(&mut self) {
        let _ = self.child.kill(); // it may be gone already
        let _ = self.child.wait();
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        self.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_read() {
        let debian = "QEMU emulator version 7.2.22 (Debian 1:7.2+dfsg-7+deb12u18+b3)\nCopyright";
        assert_eq!(parse_version(debian), Some(Version(7, 2)));
        assert_eq!(parse_version("QEMU emulator version 10.0.50"), Some(Version(10, 0)));
        assert_eq!(parse_version("something else"), None);
        assert!(Version(7, 2) < Version(8, 1) && Version(8, 1) < Version(10, 0));
    }
}
