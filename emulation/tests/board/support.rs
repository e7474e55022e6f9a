//! Helpers and checks that several tests share.

use emulation::engines::{self, Engine};
use emulation::{BOARDS, Bench, Board, Image, Report};
use sim::amt::{AmtConfig, AmtEcu};
use sim::any::{AnyConfig, AnyEcu, Protocol};
use sim::ecu::{MILLIS, Nanos};
use sim::zk::ZkEcu;

/// Runs a test on the first board of each part at once.
pub fn on_each_board(test: impl Fn(&'static Board) + Sync) {
    on(|board| board.is_first_of_its_part(), test);
}

/// Runs a test on the boards whose part is tested in full on another board.
pub fn on_the_other_boards(test: impl Fn(&'static Board) + Sync) {
    on(|board| !board.is_first_of_its_part(), test);
}

/// Runs a test on every board at once.
pub fn on_all_boards(test: impl Fn(&'static Board) + Sync) {
    on(|_| true, test);
}

/// Runs a test on these boards at once.
pub fn on_boards(wanted: impl Fn(&Board) -> bool, test: impl Fn(&'static Board) + Sync) {
    on(wanted, test);
}

fn on(wanted: impl Fn(&Board) -> bool, test: impl Fn(&'static Board) + Sync) {
    let boards: Vec<_> = BOARDS.into_iter().filter(|board| wanted(board)).collect();
    std::thread::scope(|scope| {
        let start = |board: &'static Board| {
            let test = &test;
            std::thread::Builder::new()
                .name(board.name.to_string())
                .spawn_scoped(scope, move || test(board))
                .expect("a thread")
        };
        let runs: Vec<_> = boards.iter().map(|board| start(board)).collect();
        for (run, board) in runs.into_iter().zip(boards) {
            if run.join().is_err() {
                panic!("failed on {}", board.name);
            }
        }
    });
}

/// The address of a symbol.
pub fn symbol(board: &Board, image: Image, name: &str) -> u64 {
    let bytes = image.read(board).expect("an image");
    emulation::image::symbol(&bytes, name).unwrap_or_else(|| panic!("the image has no symbol {name}"))
}

/// The engines of an image, each with its port.
pub fn engines(report: &Report) -> Vec<Engine> {
    engines::of(report.board, report.image)
}

/// The AMT ECU of the engine on this port, with these changes.
pub fn amt(board: &'static Board, image: Image, port: &str, change: impl FnOnce(&mut AmtConfig)) -> AnyEcu {
    let mut config = engines::on(board, image, port).config().try_into().expect("an AMT ECU");
    change(&mut config);
    AnyConfig::from(config).ecu()
}

/// The AMT ECU of an engine got one reply to each of its frames, in time, and nothing else.
pub fn no_window_missed(report: &Report, engine: &Engine) {
    let stats = report.ecu::<AmtEcu>(engine.port).stats;
    let text = format!("{} {}: {stats:?}", report.board.name, engine.name);
    assert_eq!((stats.late, stats.none, stats.unsolicited), (0, 0, 0), "{text}");
    assert_eq!((stats.bad.total(), stats.stray_bytes, stats.framing_errors), (0, 0, 0), "{text}");
    // The last frame may still wait for its reply.
    let unanswered = stats.frames.total() - stats.in_window;
    assert!(stats.in_window > 0 && unanswered <= 1, "{text}");
}

/// The ZK ECU of an engine got a good command at every period of the rate that the firmware has set.
pub fn no_slot_missed(report: &Report, engine: &Engine) {
    let rate = engine.rate.unwrap_or_else(|| panic!("{} is no ZK engine", engine.name));
    let ecu = report.ecu::<ZkEcu>(engine.port);
    let stats = ecu.stats;
    let text = format!("{} {}: {stats:?}", report.board.name, engine.name);
    assert_eq!((stats.bad.total(), stats.stray_bytes, stats.framing_errors), (0, 0, 0), "{text}");
    // Until its first status each ECU gets commands at the same rate, and while it boots it does not listen.
    let expected = (report.at - ecu.config().boot) / rate.period();
    assert!(stats.accepted.abs_diff(expected) <= 2, "{text}: {expected} expected");
    let (shortest, longest) = (stats.intervals.min.unwrap_or(0), stats.intervals.max.unwrap_or(0));
    let slip = MILLIS / 2;
    assert!(shortest + slip >= rate.period() && longest <= rate.period() + slip, "{text}");
}

/// The AMT engines of an image.
pub fn amt_engines(report: &Report) -> Vec<Engine> {
    let all = engines(report);
    all.into_iter().filter(|engine| engine.protocol() == Protocol::Amt).collect()
}

/// Every engine but those on these ports was served without a fault.
pub fn others_are_well(report: &Report, but: &[&str]) {
    for engine in engines(report) {
        if !but.contains(&engine.port) {
            well(report, &engine);
        }
    }
}

/// An engine's line was served without a fault.
pub fn well(report: &Report, engine: &Engine) {
    match engine.protocol() {
        Protocol::Amt => no_window_missed(report, engine),
        Protocol::Zk => no_slot_missed(report, engine),
    }
}

/// When the board sent the first byte on a port, from `after` on.
pub fn first_byte(report: &Report, port: &str, after: Nanos) -> Nanos {
    let mut bytes = report.wire(port).tx.iter();
    bytes.find(|tx| tx.end >= after).unwrap_or_else(|| panic!("nothing was sent on {port}")).end
}

/// The line errors in the firmware's last status line of an engine, as (framing, noise, overrun).
pub fn line_errors_of(report: &Report, engine: &str) -> (u32, u32, u32) {
    let name = format!("{engine}: link");
    let line = report.lines(&name).next_back().expect("a status line");
    let Some((_, counts)) = line.text.split_once(" in control").and_then(|(_, rest)| rest.split_once("; "))
    else {
        return (0, 0, 0);
    };
    let mut numbers = counts.split(|c: char| !c.is_ascii_digit()).filter_map(|word| word.parse().ok());
    let mut next = || numbers.next().expect("three counts");
    (next(), next(), next())
}

/// Makes the supervisor's task, which runs every 250 ms, jump to the handler of unexpected interrupts: the firmware logs it
/// and resets.
pub fn crash(bench: &mut Bench<'_>, board: &Board, image: Image) {
    let handler = symbol(board, image, "DefaultHandler");
    hijack(bench, board, image, Task::Supervisor, handler);
}

/// A task of the firmware.
#[derive(Clone, Copy, Debug)]
pub enum Task {
    /// In thread mode, every 250 ms.
    Supervisor,
    /// In the interrupt of the engines' executor, at every byte of the first engine.
    Engine,
}

/// When this task runs next, it does what is at this address instead.
pub fn hijack(bench: &mut Bench<'_>, board: &Board, image: Image, task: Task, code: u64) {
    assert!(hijack_if_spawned(bench, board, image, task, code), "a task's code");
}

/// The same, if the task may not be spawned yet. Returns whether it is.
pub fn hijack_if_spawned(bench: &mut Bench<'_>, board: &Board, image: Image, task: Task, code: u64) -> bool {
    let elf = image.read(board).expect("an image");
    let name = match task {
        Task::Supervisor => "10supervisor4POOL",
        Task::Engine => "6engine4POOL",
    };
    let task = emulation::image::symbol_ending(&elf, name).expect("a task");
    // The task's header contains one code address: that of its poll function.
    let is_code =
        |word: &Option<u32>| word.is_some_and(|word| word & 1 == 1 && board.flash.contains(&word.into()));
    let header = (task..task + 64).step_by(4);
    let at = header.into_iter().find(|&at| is_code(&bench.word(at)));
    at.is_some_and(|at| {
        bench.set_word(at, code as u32 | 1);
        true
    })
}

/// The status LED of a board.
#[derive(Clone, Copy, Debug)]
pub struct Led {
    /// BSRR of its GPIO port: the lower half puts pins high, the upper half low.
    pub register: u64,
    pin: u8,
    lit: bool,
}

impl Led {
    /// The LED of this board.
    pub fn of(board: &Board) -> Self {
        let emulation::board::Led { pin: (port, pin), lit, .. } = board.led;
        Self { register: board.gpio + 0x400 * u64::from(port as u8 - b'A') + 0x18, pin, lit }
    }

    /// When it was lit, in a run that recorded its register.
    pub fn lit(&self, report: &Report) -> Vec<Nanos> {
        self.writes(report, self.lit)
    }

    /// When it was put out.
    pub fn dark(&self, report: &Report) -> Vec<Nanos> {
        self.writes(report, !self.lit)
    }

    fn writes(&self, report: &Report, high: bool) -> Vec<Nanos> {
        let bit = self.pin + if high { 0 } else { 16 };
        let writes = report.written.iter().filter(|write| write.register == self.register);
        writes.filter(|write| write.value >> bit & 1 == 1).map(|write| write.at).collect()
    }
}
