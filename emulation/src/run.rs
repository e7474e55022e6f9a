//! One run of an image: its setup, and its course.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::path::Path;
use std::sync::Arc;

use defmt_decoder::Table;
use rigless::chip::uart::TcpPeer;
use rigless::emulator::{self, AccessKind, Driver, HitKind, Host, Settled, Start, Stop, Watch};
use rigless::mcu::Operate;
use rigless::session::Session;
use rigless::soc::Width;
use rigless::symbols::Symbols;
use rigless::time::VirtualNanos;
use sim::ecu::{Nanos, SECOND};
use sim::line::Line;

use crate::board::{Board, Part, Uart};
use crate::bootloader::Bootloader;
use crate::capture::Capture;
use crate::chip::Rig;
use crate::fram::Fram;
use crate::image::Image;
use crate::log;
use crate::pulses::PulseReceiver;
use crate::quirks::{BackupDomain, DeadEnable, Stuck, TimerFlags};
use crate::receiver::Receiver;
use crate::report::{Report, Tap, Written};
use crate::wire::{Far, Wire};
use crate::{audit, bootloader, engines, image, pins};

/// Number of unexpected resets after which a run is aborted.
const MOST_RESETS: usize = 6;

type Act = Box<dyn FnOnce(&mut Bench<'_>) + Send>;

/// A run, before it runs.
pub struct Run {
    board: &'static Board,
    image: Image,
    instructions_per_second: u64,
    wires: BTreeMap<&'static str, Wire>,
    tcp: Option<(&'static str, TcpPeer)>,
    fram: Option<Fram>,
    pulses: Option<PulseReceiver>,
    /// The receiver's line is inverted.
    inverted: bool,
    acts: Vec<(Nanos, Act)>,
    taps: Vec<&'static str>,
    registers: Vec<u64>,
    labels: Vec<&'static str>,
    until: Nanos,
    live: bool,
    patch: Option<(u64, Vec<u16>)>,
    bootloader: Option<Bootloader>,
    slow_watchdog: bool,
    resets_expected: usize,
    errors_expected: bool,
}

impl Run {
    /// The image on the board, with nothing on its ports.
    pub fn new(board: &'static Board, image: Image) -> Self {
        Self {
            board,
            image,
            instructions_per_second: board.core_hz,
            wires: BTreeMap::new(),
            tcp: None,
            fram: board.fram.map(|fram| (fram.chip)()),
            pulses: None,
            inverted: false,
            acts: Vec::new(),
            taps: Vec::new(),
            registers: Vec::new(),
            labels: Vec::new(),
            until: SECOND,
            live: false,
            patch: None,
            bootloader: None,
            slow_watchdog: false,
            resets_expected: 0,
            errors_expected: false,
        }
    }

    /// The ECU of every engine in the image's table, on its port.
    pub fn engines(mut self) -> Self {
        for engine in engines::of(self.board, self.image) {
            self.wires.insert(engine.port, Wire::new(engine.ecu(), engine.line, 0));
        }
        self
    }

    /// The same, with turbines that are started within 5 s.
    pub fn quick_engines(mut self) -> Self {
        for engine in engines::of(self.board, self.image) {
            self.wires.insert(engine.port, Wire::new(engine.quick_ecu(), engine.line, 0));
        }
        self
    }

    /// Nothing but on these ports.
    pub fn only(mut self, ports: &[&str]) -> Self {
        self.wires.retain(|port, _| ports.contains(port));
        self
    }

    /// This receiver of radio control on the port of the image for it.
    pub fn radio(mut self, receiver: Receiver) -> Self {
        let (port, line) = (self.image.radio(self.board), receiver.line());
        self.inverted = receiver.inverted;
        self.ecu(port, line, receiver)
    }

    /// This receiver of radio control on the board's inputs for servo pulses.
    pub fn pulses(mut self, receiver: PulseReceiver) -> Self {
        self.pulses = Some(receiver);
        self
    }

    /// This ECU on this port, in place of any other.
    pub fn ecu(self, port: &'static str, line: Line, ecu: impl Far) -> Self {
        self.ecu_since(port, line, ecu, 0)
    }

    /// This ECU on this port, switched on this long before the board.
    pub fn ecu_since(mut self, port: &'static str, line: Line, ecu: impl Far, before: Nanos) -> Self {
        self.wires.insert(port, Wire::new(Box::new(ecu), line, before));
        self
    }

    /// A TCP port in place of an ECU.
    pub fn tcp(mut self, port: &'static str, peer: TcpPeer) -> Self {
        self.wires.remove(port);
        self.tcp = Some((port, peer));
        self
    }

    /// This F-RAM on the board, or none.
    pub fn fram(mut self, fram: Option<Fram>) -> Self {
        self.fram = fram;
        self
    }

    /// At `at`, does something with the bench.
    pub fn at(mut self, at: Nanos, act: impl FnOnce(&mut Bench<'_>) + Send + 'static) -> Self {
        self.acts.push((at, Box::new(act)));
        self
    }

    /// Records every access to the data registers of this port's UART.
    pub fn tap(mut self, port: &'static str) -> Self {
        self.taps.push(port);
        self
    }

    /// Records every write to this register.
    pub fn record(mut self, register: u64) -> Self {
        self.registers.push(register);
        self
    }

    /// Records every time that the core passes this label of the image.
    pub fn watch(mut self, label: &'static str) -> Self {
        self.labels.push(label);
        self
    }

    /// Instructions per second of the core; by default one per clock cycle.
    pub fn instructions_per_second(mut self, rate: u64) -> Self {
        self.instructions_per_second = rate;
        self
    }

    /// Ends the run at this time.
    pub fn until(mut self, until: Nanos) -> Self {
        self.until = until;
        self
    }

    /// Expects this number of resets. Any other number fails the run.
    pub fn resets(mut self, count: usize) -> Self {
        self.resets_expected = count;
        self
    }

    /// Allows errors in the firmware's log.
    pub fn with_errors(mut self) -> Self {
        self.errors_expected = true;
        self
    }

    /// Breaks the image on purpose: other instructions at this address of its flash.
    pub fn patch(mut self, address: u64, halfwords: Vec<u16>) -> Self {
        self.patch = Some((address, halfwords));
        self
    }

    /// Makes the watchdog's registers take the longest allowed time to cross over into its own clock.
    pub fn slow_watchdog(mut self) -> Self {
        self.slow_watchdog = true;
        self
    }

    /// Bootloader that starts the image in place of a reset. By default, an image linked behind a bootloader has one
    /// that leaves nothing, and any other has none.
    pub fn bootloader(mut self, bootloader: Bootloader) -> Self {
        self.bootloader = Some(bootloader);
        self
    }

    /// Runs, and panics unless every check of [`audit`] passes.
    ///
    /// # Panics
    /// With every check that fails.
    pub fn go(self) -> Report {
        let (report, complaints) = self.go_unchecked();
        if !complaints.is_empty() {
            for log in report.logs.iter().rev().take(30).rev() {
                println!("{:>14} ns {} {}", log.at, log.level, log.text);
            }
            panic!("{}: {}", report.board.name, complaints.join("\n"));
        }
        report
    }

    /// Runs, and returns the checks that fail.
    pub fn go_unchecked(self) -> (Report, Vec<String>) {
        let expected = audit::Expected { resets: self.resets_expected, errors: self.errors_expected };
        let mut report = self.emulate();
        let complaints = audit::of(&mut report, &expected);
        (report, complaints)
    }

    /// Writes the bytes of each engine's line into files in this folder (`capture.rs`).
    ///
    /// # Errors
    /// If a file cannot be created.
    pub fn capture(mut self, folder: &Path) -> Result<Self, std::io::Error> {
        for engine in engines::of(self.board, self.image) {
            if let Some(wire) = self.wires.get_mut(engine.port) {
                wire.capture(Capture::create(folder, engine.name)?);
            }
        }
        Ok(self)
    }

    /// Runs forever in real time with the log on the terminal.
    pub fn live(self) {
        self.live_until(Nanos::MAX / 4);
    }

    /// Runs until this time in real time with the log on the terminal.
    pub fn live_until(mut self, until: Nanos) {
        self.live = true;
        self.until = until;
        self.wires.values_mut().for_each(Wire::forget);
        self.emulate();
    }

    fn emulate(mut self) -> Report {
        let board = self.board;
        let path = self.image.path(board);
        let mut bytes = self.image.read_or_exit(board);
        if let Some((address, halfwords)) = &self.patch {
            image::patch(&mut bytes, *address, halfwords);
        }
        let table = Table::parse(&bytes).expect("the image's table of log lines");
        let table = Arc::new(table.expect("the image has a table of log lines"));
        let symbols = Symbols::read(&bytes, |value| value & !1).expect("the image's symbols");
        let table_at = self.image.start(board);
        let mut images = Vec::new();
        let bootloader = match self.bootloader.take() {
            None if table_at != board.flash.start => Some(Bootloader::default()),
            other => other,
        };
        if let Some(bootloader) = bootloader {
            let jump = image::vectors(&bytes, table_at);
            // The part starts at the beginning of the flash, at every reset. If the image itself is there, its own
            // first words lead to the code at the end of the flash.
            let mut at = board.flash.start;
            if table_at == at {
                at = board.flash.end - 0x4000;
                let [low, high] =
                    [bootloader::entry(at), bootloader::entry(at) >> 16].map(|half| half as u16);
                image::patch(&mut bytes, table_at + 4, &[low, high]);
            }
            let code = bootloader.assemble(board, at, table_at, jump);
            let stub = rigless::image::Image::new(&path, code, Some(at));
            images.push(stub.expect("a flat image"));
        }
        images.push(rigless::image::Image::new(&path, bytes, None).expect("an ELF file"));

        let mut rig = Rig::new(board, self.instructions_per_second);
        for (port, wire) in core::mem::take(&mut self.wires) {
            rig.attach(board.port(port).uart, wire);
        }
        if let Some(socket) = board.socket {
            rig.attach_inverter(socket, self.inverted, board.gpio);
        }
        if let Some((port, peer)) = self.tcp.take() {
            rig.attach_tcp(board.port(port).uart, peer);
        }
        if let Some(bus) = board.fram {
            rig.attach_fram(bus.select, self.fram.take());
        }
        if let Some(receiver) = self.pulses.take() {
            rig.attach_pulses(receiver, board.inputs.expect("a board with inputs for servo pulses"));
        }
        if self.slow_watchdog {
            rig.slow_watchdog();
        }
        let timers = TimerFlags::new(&rig.chip);
        let mut taps = HashMap::new();
        for name in &self.taps {
            let port = board.port(name);
            taps.insert(port.registers() + board.receive_register, port.name);
            taps.insert(port.registers() + board.transmit_register, port.name);
        }

        let mut session = Session::new(Box::new(rig), 0, VirtualNanos(0)).expect("the board is whole");
        let rtt = symbols.get("_SEGGER_RTT").expect("the image logs over RTT");
        session.watch(Watch::Writes { address: log::write_offset(rtt), length: 4 });
        session.watch(Watch::Instruction(symbols.get("HardFault").expect("a handler of faults")));
        let labels =
            self.labels.iter().map(|&label| (symbols.get(label).expect("a label of the image"), label));
        let labels: HashMap<u64, &str> = labels.collect();
        labels.keys().for_each(|&address| session.watch(Watch::Instruction(address)));

        self.acts.sort_by_key(|act| act.0);
        let hand = Hand {
            board,
            radio: self.image.radio(board),
            until: self.until,
            most_resets: self.resets_expected + MOST_RESETS,
            acts: self.acts.into(),
            timers,
            taps,
            tapped: Vec::new(),
            registers: self.registers,
            written: Vec::new(),
            of_pins: pins::registers(board),
            pins_written: Vec::new(),
            labels,
            passed: Vec::new(),
            rtt,
            chunks: Vec::new(),
            faults: Vec::new(),
            live: self.live.then(|| Live {
                began: std::time::Instant::now(),
                table: table.clone(),
                bytes: Vec::new(),
            }),
        };
        let finished = emulator::run(session, &Start::new(&images), hand).expect("the run");

        let hand = finished.driver;
        let logs = log::decode(&table, &hand.chunks);
        let mut session = finished.session;
        let resets = session.resets().iter().map(|reset| (reset.at.0, reset.cause)).collect();
        let mut wires = BTreeMap::new();
        for port in board.all_ports() {
            if let Some(wire) = session.board_mut().wire(port.uart) {
                wires.insert(port.name, core::mem::replace(wire, Wire::empty()));
            }
        }
        let fram = session.board_mut().fram().cloned();
        let (at, instructions) = finished.stop.map_or((0, 0), |stop| (stop.at.0, stop.instruction_count));
        Report {
            board,
            image: self.image,
            instructions_per_second: self.instructions_per_second,
            session,
            wires,
            fram,
            logs,
            taps: hand.tapped,
            written: hand.written,
            pins_written: hand.pins_written,
            passed: hand.passed,
            resets,
            faults: hand.faults,
            at,
            instructions,
        }
    }
}

/// The bench while a run is paused.
pub struct Bench<'a> {
    now: Nanos,
    instructions: u64,
    board: &'static Board,
    /// Port of the image's receiver.
    radio: &'static str,
    session: &'a mut Session<Rig>,
    host: &'a mut dyn Host,
}

impl Bench<'_> {
    fn uart(&self, port: &str) -> Uart {
        self.board.port(port).uart
    }

    fn wire(&mut self, port: &str) -> &mut Wire {
        let uart = self.uart(port);
        self.session.board_mut().wire(uart).expect("an ECU on this port")
    }

    /// The ECU on a port.
    pub fn ecu<E: Far>(&mut self, port: &str) -> &mut E {
        self.wire(port).ecu_mut()
    }

    /// The receiver of radio control.
    pub fn radio(&mut self) -> &mut Receiver {
        self.ecu(self.radio)
    }

    /// The receiver of radio control with servo pulses.
    pub fn pulses(&mut self) -> &mut PulseReceiver {
        self.session.board_mut().pulses().expect("a receiver with servo pulses")
    }

    /// Sets the voltage in front of the board's divider, in mV.
    pub fn battery(&mut self, millivolts: u32) {
        let divider = self.board.divider.expect("a board with a divider");
        self.session.board_mut().battery(divider, millivolts);
    }

    /// Cuts the wire of a port, both ways, or mends it.
    pub fn cut(&mut self, port: &str, cut: bool) {
        let uart = self.uart(port);
        self.session.board_mut().cut(uart, cut);
    }

    /// Switches an ECU's supply.
    pub fn power(&mut self, port: &str, on: bool) {
        let now = self.now;
        self.wire(port).power(now, on);
    }

    /// An ECU sends these bytes repeatedly without a pause; with `None`, its own again.
    pub fn babble(&mut self, port: &str, bytes: Option<&[u8]>) {
        let now = self.now;
        self.wire(port).babble(now, bytes);
    }

    /// Flips bits of this number of bytes per million on their way to the board, with the UART's noise flag.
    pub fn noise(&mut self, port: &str, per_million: u32) {
        let uart = self.uart(port);
        let errors = self.session.board_mut().errors(uart);
        (errors.seed, errors.noise.name, errors.noise.per_million) = (uart as u64 + 1, "noise", per_million);
    }

    /// Flips bits of this number of bytes per million on their way to the board, and removes their stop bit.
    pub fn framing(&mut self, port: &str, per_million: u32) {
        let uart = self.uart(port);
        let errors = self.session.board_mut().errors(uart);
        (errors.seed, errors.framing.name, errors.framing.per_million) =
            (uart as u64 + 1, "framing", per_million);
    }

    /// Damages this number of bytes per million on their way to the ECU.
    pub fn garble(&mut self, port: &str, per_million: u32) {
        self.wire(port).garble(per_million, 1);
    }

    /// The next byte never reaches the board.
    pub fn drop_next(&mut self, port: &str) {
        let uart = self.uart(port);
        let place = self.session.board_mut().place(uart).expect("an ECU on this port");
        place.drop_next();
    }

    /// Switches the transmitter of a port's UART off while it sends. It works again once the firmware sets the UART up again.
    pub fn stop_transmitter(&mut self, port: &str) {
        // CR1; its bit TE is the same on both parts.
        let control = self.board.port(port).registers() + self.board.control_register;
        let (now, chip) = (VirtualNanos(self.now), &mut self.session.board_mut().chip);
        let enabled = chip.peek(now, control, Width::W32).expect("a UART");
        chip.write(now, control, Width::W32, enabled & !(1 << 3)).expect("a UART");
    }

    /// Changes the level of an output pin behind the firmware's back.
    pub fn set_pin(&mut self, (port, number): (char, u8), high: bool) {
        let register = self.board.gpio + 0x400 * u64::from(port as u8 - b'A') + 0x18; // BSRR
        let bit = 1 << if high { number } else { number + 16 };
        let (now, chip) = (VirtualNanos(self.now), &mut self.session.board_mut().chip);
        chip.write(now, register, Width::W32, bit).expect("a GPIO port");
    }

    /// From here on the crystal does not start. A running one is not stopped.
    pub fn break_crystal(&mut self) {
        self.session.board_mut().dead_crystal = true;
    }

    /// The crystal starts again when it is turned on next.
    pub fn mend_crystal(&mut self) {
        self.session.board_mut().dead_crystal = false;
    }

    /// Makes this never become ready, until the part is reset.
    pub fn jam(&mut self, stuck: Stuck) {
        self.session.board_mut().chip.stuck = Some(stuck);
    }

    /// Sets the supply's voltage, in mV. The emulator does not reset at any voltage.
    pub fn supply(&mut self, millivolts: u32) {
        self.session.board_mut().supply(millivolts);
    }

    /// Presses the reset button.
    pub fn press_reset(&mut self) {
        self.session.reset_by_pin(VirtualNanos(self.now), self.instructions, self.host);
    }

    /// The supply dips: the part is reset, and its RAM stays unchanged.
    pub fn brown_out(&mut self) {
        self.session.board_mut().flag_brown_out();
        self.press_reset();
    }

    /// The supply is switched off and on. The RAM stays unchanged: the test overwrites it.
    pub fn power_on(&mut self) {
        self.session.board_mut().flag_power_on();
        self.press_reset();
    }

    /// The watchdog runs out at once, as if it had not been fed.
    pub fn watchdog_runs_out(&mut self) {
        let (now, base) = (VirtualNanos(self.now), self.board.watchdog);
        // Unlock, shortest prescaler, reload with 0, feed.
        for (register, value) in [(0x00, 0x5555), (0x04, 0), (0x08, 0), (0x00, 0xAAAA)] {
            let chip = &mut self.session.board_mut().chip;
            chip.write(now, base + register, Width::W32, value).expect("the part has a watchdog");
        }
    }

    /// Reads a word of memory.
    pub fn word(&mut self, address: u64) -> Option<u32> {
        self.host.read(address, Width::W32).ok().map(|word| word as u32)
    }

    /// Overwrites a word of memory.
    pub fn set_word(&mut self, address: u64, word: u32) {
        self.host.write(address, Width::W32, word.into()).expect("there is memory");
    }

    /// A register of a peripheral, without the effects of reading it.
    pub fn register(&mut self, address: u64) -> Option<u32> {
        self.session.board_mut().peek(self.now, address).map(|word| word as u32)
    }
}

/// Largest delay for which a run in real time catches up.
const MADE_UP: std::time::Duration = std::time::Duration::from_millis(50);

/// In real time, with the log on the terminal.
struct Live {
    began: std::time::Instant,
    table: Arc<Table>,
    bytes: Vec<u8>,
}

impl Live {
    /// Prints the complete lines.
    fn print(&mut self, at: Nanos, bytes: &[u8]) {
        self.bytes.extend(bytes);
        // Each frame ends with a zero byte; bytes after the last one wait.
        let Some(end) = self.bytes.iter().rposition(|&byte| byte == 0) else { return };
        let complete: Vec<u8> = self.bytes.drain(..=end).collect();
        for log in log::decode(&self.table, &[(at, complete)]) {
            println!("{:>10.3} s {:5} {}", at as f64 / 1e9, log.level, log.text);
        }
    }

    /// Waits until the wall clock has caught up. A run that fell far behind does not catch up: for its peers, which use the wall
    /// clock, the board's clock would run fast, and frames of an autopilot would be late by that time.
    fn pace(&mut self, at: Nanos) {
        let due = self.began + std::time::Duration::from_nanos(at);
        let now = std::time::Instant::now();
        match due.checked_duration_since(now) {
            Some(ahead) => std::thread::sleep(ahead),
            None => self.began += (now - due).saturating_sub(MADE_UP),
        }
    }
}

/// Steers the run: stops it when a far end or the test has something to do, and records what happens.
struct Hand {
    board: &'static Board,
    radio: &'static str,
    until: Nanos,
    most_resets: usize,
    acts: VecDeque<(Nanos, Act)>,
    timers: TimerFlags,
    taps: HashMap<u64, &'static str>,
    tapped: Vec<Tap>,
    registers: Vec<u64>,
    written: Vec<Written>,
    /// The registers of the outputs' pins, which every run records for `valves`.
    of_pins: Vec<u64>,
    pins_written: Vec<Written>,
    labels: HashMap<u64, &'static str>,
    passed: Vec<(Nanos, &'static str)>,
    rtt: u64,
    chunks: Vec<(Nanos, Vec<u8>)>,
    faults: Vec<Nanos>,
    live: Option<Live>,
}

impl Hand {
    fn next(&self, now: Nanos, session: &mut Session<Rig>) -> VirtualNanos {
        let wires = session.board_mut().next(now);
        let act = self.acts.front().map(|act| act.0);
        let pace = self.live.as_ref().map(|_| now + SECOND / 500);
        VirtualNanos([wires, act, pace].into_iter().flatten().fold(self.until, Nanos::min))
    }
}

impl Driver<Rig> for Hand {
    fn on_settled(&mut self, session: &mut Session<Rig>, host: &mut dyn Host, settled: Settled) {
        match settled {
            Settled::Access { access, .. } => {
                let write = access.kind == AccessKind::Write;
                if let Some(&port) = self.taps.get(&access.address) {
                    self.tapped.push(Tap {
                        at: access.virtual_time.0,
                        instructions: access.instruction_count,
                        port,
                        write,
                    });
                }
                if write {
                    let written =
                        Written { at: access.virtual_time.0, register: access.address, value: access.value };
                    if self.registers.contains(&access.address) {
                        self.written.push(written);
                    }
                    if self.of_pins.contains(&access.address) {
                        self.pins_written.push(written);
                    }
                }
                if write {
                    let (at, address, value) = (access.virtual_time, access.address, access.value);
                    let rig = session.board_mut();
                    self.timers.after_write(&mut rig.chip, at, address);
                    if self.board.part == Part::H743 {
                        BackupDomain::after_write(&mut rig.chip, at, address, value);
                    }
                    let control = self.board.clock_control;
                    let crystal = rig.dead_crystal.then(|| DeadEnable::crystal(control));
                    let stuck = rig.chip.stuck.and_then(|stuck| DeadEnable::of(stuck, control));
                    for dead in crystal.into_iter().chain(stuck) {
                        dead.after_write(&mut rig.chip, at, address, value);
                    }
                }
            }
            Settled::Hit(hit) if hit.kind == HitKind::Write => {
                let bytes = log::drain(self.rtt, host);
                match &mut self.live {
                    Some(live) => live.print(hit.at.0, &bytes),
                    None => self.chunks.push((hit.at.0, bytes)),
                }
            }
            Settled::Hit(hit) => match self.labels.get(&hit.address) {
                Some(&label) => self.passed.push((hit.at.0, label)),
                None => self.faults.push(hit.at.0),
            },
            // Bytes received at this stop may make a far end act sooner than announced.
            Settled::Stop(stop) => {
                let next = self.next(stop.at.0.saturating_sub(1), session);
                session.run_until(next);
            }
            _ => {}
        }
    }

    fn on_stop(
        &mut self,
        session: &mut Session<Rig>,
        stop: Stop,
        host: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        let now = stop.at.0;
        session.board_mut().reached(now);
        while self.acts.front().is_some_and(|act| act.0 <= now)
            && let Some((_, act)) = self.acts.pop_front()
        {
            let instructions = stop.instruction_count;
            let (board, radio) = (self.board, self.radio);
            act(&mut Bench { now, instructions, board, radio, session, host });
        }
        if let Some(live) = &mut self.live {
            live.pace(now);
        }
        // A start that fails at once would be tried again a thousand times a second.
        let hopeless = session.resets().len() > self.most_resets;
        (now < self.until && !hopeless).then(|| self.next(now, session))
    }
}
