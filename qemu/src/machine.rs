//! QEMU as a child process: arguments, sockets, exit.

use crate::ecu::{Attached, Served};
use crate::image::Image;
use commands::qemu::Arguments;
use std::net::{TcpListener, TcpStream};
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Number of UARTs of the machine; the last is the port of MAVLink.
const UARTS: usize = 5;
/// Timeout for QEMU to connect to the sockets.
const CONNECTS_WITHIN: Duration = Duration::from_secs(20);

/// Returns the first line of QEMU's version text.
pub fn version(qemu: &str) -> Result<String, String> {
    let output = match Command::new(qemu).arg("--version").output() {
        Ok(output) => output,
        Err(why) if why.kind() == std::io::ErrorKind::NotFound => {
            return Err(format!(
                "{qemu} is not installed. Debian, Ubuntu: sudo apt install qemu-system-arm; \
                 Fedora: sudo dnf install qemu-system-arm; macOS: brew install qemu. \
                 If it is somewhere else: cargo qemu --qemu <path>"
            ));
        }
        Err(why) => return Err(format!("cannot start {qemu}: {why}")),
    };
    let text = String::from_utf8_lossy(&output.stdout);
    Ok(text.lines().next().unwrap_or_default().into())
}

/// Makes QEMU exit at a reset by the firmware.
pub const ENDS_AT_RESET: &str = "-no-reboot";
/// Makes time pass with the instructions, 128 ns each, and jump to the next timer while the processor sleeps.
pub const COUNTING: [&str; 3] = ["-icount", "shift=7,sleep=off", ENDS_AT_RESET];

/// QEMU with the firmware, and simulated ECUs on its UARTs.
pub struct Machine {
    child: Child,
    began: Instant,
    ecus: Vec<Served>,
}

impl Machine {
    /// Starts QEMU, with further arguments, and the ECUs. Their time begins now.
    pub fn start(
        arguments: &Arguments,
        image: &Image,
        ecus: Vec<Attached>,
        more: &[&str],
    ) -> Result<Self, String> {
        if let Some(ecu) = ecus.iter().find(|ecu| ecu.port() >= UARTS - 1) {
            return Err(format!("{} is on a port that the board does not have", ecu.caption()));
        }
        let mut command = Command::new(&arguments.qemu);
        command
            .args(["-machine", "mps2-an500", "-display", "none", "-monitor", "none"])
            // The log is sent by semihosting, which every version of QEMU can write to stdout.
            .args(["-chardev", "stdio,id=log,signal=off"])
            .args(["-semihosting-config", "enable=on,target=native,chardev=log"])
            .args(more)
            .arg("-kernel")
            .arg(&image.path)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::inherit());

        let mut sockets = Vec::new();
        let mut serials = [const { None }; UARTS - 1];
        for (i, ecu) in ecus.iter().enumerate() {
            let (listener, port) = socket()?;
            sockets.push(listener);
            let chardev = format!("socket,id=ecu{i},host=127.0.0.1,port={port},nodelay=on");
            command.args(["-chardev", &chardev]);
            serials[ecu.port()] = Some(format!("chardev:ecu{i}"));
            println!("UART{}: {}, over 127.0.0.1:{port}", ecu.port(), ecu.caption());
        }
        for serial in &serials {
            command.args(["-serial", serial.as_deref().unwrap_or("null")]);
        }
        command.args(["-serial", &arguments.telemetry]);

        let child = command.spawn().map_err(|why| format!("cannot start {}: {why}", arguments.qemu))?;
        let mut machine = Self { child, began: Instant::now(), ecus: Vec::new() };
        for (ecu, socket) in ecus.into_iter().zip(sockets) {
            let socket = machine.accept(&socket)?;
            machine.ecus.push(ecu.serve(socket, machine.began)?);
        }
        Ok(machine)
    }

    fn accept(&mut self, listener: &TcpListener) -> Result<TcpStream, String> {
        let problem = |why: std::io::Error| format!("socket of an ECU: {why}");
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
                return Err(format!("QEMU ended before it connected ({status}); see its output above"));
            }
            if self.began.elapsed() > CONNECTS_WITHIN {
                return Err("timeout: QEMU does not connect to its sockets".into());
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Takes QEMU's stdout, which carries the firmware's log.
    pub fn log(&mut self) -> Option<ChildStdout> {
        self.child.stdout.take()
    }

    /// Waits for QEMU to exit.
    pub fn wait(&mut self, limit: Option<Duration>) -> Result<ExitStatus, String> {
        loop {
            if let Some(status) = self.child.try_wait().map_err(|why| format!("QEMU: {why}"))? {
                return Ok(status);
            }
            if limit.is_some_and(|limit| self.began.elapsed() > limit) {
                return Err(format!("timeout: QEMU still runs after {} s", self.began.elapsed().as_secs()));
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Ends QEMU if it runs, and returns the ECUs.
    pub fn stop(mut self) -> Vec<Attached> {
        self.end();
        std::mem::take(&mut self.ecus).into_iter().map(Served::finish).collect()
    }

    fn end(&mut self) {
        let _ = self.child.kill(); // it may have exited already
        let _ = self.child.wait();
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        self.end();
    }
}

/// Opens a socket for QEMU to connect to. Returns it with its port.
fn socket() -> Result<(TcpListener, u16), String> {
    let problem = |why: std::io::Error| format!("cannot open a socket: {why}");
    let listener = TcpListener::bind("127.0.0.1:0").map_err(problem)?;
    let port = listener.local_addr().map_err(problem)?.port();
    Ok((listener, port))
}
