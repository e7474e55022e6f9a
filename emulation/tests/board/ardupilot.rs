//! Images behind a substitute for an ArduPilot bootloader (`emulation::bootloader`): instructions
//! that leave the part as the bootloader leaves it, and jump as it jumps.

use crate::support::{Task, crash, engines, first_byte, hijack, on_each_board, others_are_well, symbol};
use emulation::board::Part;
use emulation::{Board, Bootloader, Image, Jump, Leftover, MATEK_H743, Report, Run, bootloader};
use sim::amt::AmtEcu;
use sim::ecu::{MILLIS, SECOND};
use std::sync::mpsc;

/// Word that lets the bootloader start the application at once after a reset.
const START_AT_ONCE: u32 = bootloader::BOOT_FAST;
/// Register that starts the watchdog.
const START: u64 = 0xCCCC;

#[test]
fn the_image_runs_behind_a_bootloader_as_without_one() {
    on_each_board(|board| {
        let image = Image::Ardupilot;
        let table = symbol(board, image, "__vector_table");
        assert_eq!(Some(table), board.behind_bootloader);
        assert!(symbol(board, image, "__stext") > table && symbol(board, image, "__etext") < board.flash.end);

        let (sender, receiver) = mpsc::channel();
        let look = move |bench: &mut emulation::Bench<'_>| {
            let _ = sender.send((bench.register(board.backup), bench.word(table)));
        };
        let again = look.clone();
        let report = Run::new(board, image)
            .engines()
            .record(board.backup)
            .record(board.watchdog)
            .at(2 * SECOND, look)
            .at(2 * SECOND + MILLIS, |bench| bench.watchdog_runs_out())
            .at(4 * SECOND - 1, again)
            .resets(1)
            .until(4 * SECOND)
            .go();
        for (backup, stack) in receiver.iter().take(2) {
            assert_eq!(backup, Some(START_AT_ONCE));
            assert_eq!(stack, Some(board.ram.end as u32));
        }

        // The word for the bootloader is written before the watchdog starts, at both boots, and again when Embassy has set the clocks.
        let is = |register, value| {
            move |write: &&emulation::Written| write.register == register && write.value == value
        };
        let announced: Vec<_> =
            report.written.iter().filter(is(board.backup, START_AT_ONCE.into())).collect();
        let started: Vec<_> = report.written.iter().filter(is(board.watchdog, START)).collect();
        assert_eq!((announced.len(), started.len()), (4, 2), "{:?}", report.written);
        for (announced, started) in announced.chunks(2).zip(started) {
            assert!(
                announced[0].at < started.at && started.at < announced[1].at,
                "{announced:?} {started:?}"
            );
        }
        assert!(report.logged("last reset: watchdog"), "{}", report.log_text());

        // Otherwise it is the same: the same first bytes at the same time, except that settings are not read here. An H743 without a
        // bootloader reads them for some 13 ms before it opens its ports.
        let plain = Run::new(board, Image::Release).engines().until(2 * SECOND).go();
        for engine in engines(&report) {
            // By frame, each once and in order: the number of repeats depends on when the port opened.
            let frames = |report: &emulation::Report| -> Vec<Vec<u8>> {
                let sent = report.wire(engine.port).frames(engine.protocol()).into_iter();
                let sent = sent.filter(|(frame, _)| frame.end < 1900 * MILLIS);
                let mut frames: Vec<Vec<u8>> = sent.map(|(frame, _)| frame.bytes().to_vec()).collect();
                frames.dedup();
                frames
            };
            assert_eq!(frames(&report), frames(&plain), "{}", engine.name);
            let (here, there) = (first_byte(&report, engine.port, 0), first_byte(&plain, engine.port, 0));
            assert!(here < there + MILLIS && there < here + 20 * MILLIS, "{}: {here} {there}", engine.name);
        }
        assert!(report.ecu::<AmtEcu>("SERIAL2").stats.late == 0);
        others_are_well(&plain, &[]);
    });
}

/// State that only a masked interrupt leaves: without the mask, the bootloader's own handlers would have taken it.
const PENDING: [Leftover; 3] = [Leftover::SysTick, Leftover::PendSv, Leftover::Interrupts];

/// Behind a bootloader that leaves this, every ECU is served, and nothing is reset.
pub fn served(board: &'static Board, image: Image, jump: Jump, leaves: &[Leftover]) {
    let what = format!("{} {image:?}: {jump:?}, {leaves:?}", board.name);
    let bootloader = Bootloader { jump, leaves: leaves.to_vec(), ..Bootloader::default() };
    let run = Run::new(board, image).engines().bootloader(bootloader).until(800 * MILLIS);
    let (report, complaints) = run.go_unchecked();
    let sent: Vec<_> = report.wires().map(|(port, wire)| (port, wire.tx.len())).collect();
    assert!(complaints.is_empty(), "{what}: {complaints:?}; bytes sent: {sent:?}\n{}", report.log_text());
    others_are_well(&report, &[]);
}

#[test]
fn each_state_that_a_bootloader_leaves_is_corrected() {
    on_each_board(|board| {
        for leftover in Leftover::ALL {
            if PENDING.contains(&leftover) {
                served(board, Image::Ardupilot, Jump::New, &[Leftover::Primask, leftover]);
            } else {
                served(board, Image::Ardupilot, Jump::New, &[leftover]);
            }
        }
        served(board, Image::Ardupilot, Jump::New, &[Leftover::Vtor]);
    });
}

/// Contents of `words` core registers some time after a start behind a bootloader that leaves this state. A test cannot read
/// them, so a few instructions in RAM copy them; the first two put their address, `from`, into r0.
fn core_registers(board: &'static Board, leftover: Leftover, from: [u32; 2], words: u8) -> Vec<u32> {
    let (sender, receiver) = mpsc::channel();
    let bootloader = Bootloader { leaves: vec![leftover], ..Bootloader::default() };
    let code = board.ram.start + 0x18000;
    Run::new(board, Image::Ardupilot)
        .engines()
        .bootloader(bootloader)
        .at(300 * MILLIS, move |bench| {
            // adr r1, . + 0x104; movs r2, #words; ldmia r0!, {r3}; stmia r1!, {r3}; subs r2, #1; bne .-6; bx lr
            let copy = [0x2200_A140 | u32::from(words) << 16, 0xC108_C808, 0xD1FB_3A01, 0x0000_4770];
            for (i, word) in from.into_iter().chain(copy).enumerate() {
                bench.set_word(code + 4 * i as u64, word);
            }
            hijack(bench, board, Image::Ardupilot, Task::Supervisor, code);
        })
        .at(599 * MILLIS, move |bench| {
            let copied = (0..u64::from(words)).map(|i| bench.word(code + 0x10C + 4 * i).expect("RAM"));
            sender.send(copied.collect()).expect("the test waits");
        })
        .until(600 * MILLIS)
        .go();
    receiver.recv().expect("the run came by")
}

/// A UART's interrupt below the engines' executor would wait while an engine works.
#[test]
fn priorities_that_a_bootloader_leaves_are_corrected() {
    on_each_board(|board| {
        // movw r0, #0xE400; movt r0, #0xE000: NVIC_IPR.
        let words = core_registers(board, Leftover::Priorities, [0x4000_F24E, 0x0000_F2CE], 60);
        let others: Vec<_> = words.into_iter().flat_map(u32::to_le_bytes).filter(|&byte| byte != 0).collect();
        assert_eq!(others, [0x60], "all but the executor's are the highest");
    });
}

/// CPACR: the floating-point unit is on. FPCCR: without ASPEN and LSPEN an interrupt would not save the floating-point registers
/// of what it interrupts.
#[test]
fn floating_point_unit_is_on_and_saved_whatever_a_bootloader_leaves() {
    on_each_board(|board| {
        for leftover in [Leftover::Fpu, Leftover::FpuOff] {
            let name = board.name;
            // movw r0, #0xED88; movt r0, #0xE000: CPACR, where bits 20 to 23 let anybody use it.
            let access = core_registers(board, leftover, [0x5088_F64E, 0x0000_F2CE], 1)[0];
            assert_eq!(access >> 20 & 0xF, 0xF, "{name} {leftover:?}: {access:#x}");
            // movw r0, #0xEF34; movt r0, #0xE000: FPCCR, where bit 31 is ASPEN and bit 30 LSPEN.
            let control = core_registers(board, leftover, [0x7034_F64E, 0x0000_F2CE], 1)[0];
            assert_eq!(control >> 30, 0b11, "{name} {leftover:?}: {control:#x}");
        }
    });
}

/// HSEON of an H743 cannot be cleared while PLL1 is on and takes its clock from the crystal (RM0433, 8.7.2). The emulator
/// allows it once the core is on another clock, so the test checks the order of writes: the PLL is turned off first.
#[test]
fn an_h743_stops_the_pll_before_the_crystal() {
    let bootloader = Bootloader { leaves: vec![Leftover::Pll], ..Bootloader::default() };
    let run = Run::new(&MATEK_H743, Image::Ardupilot).engines().bootloader(bootloader);
    let run = run.record(MATEK_H743.clock_control).watch("__pre_init_end");
    let report = run.until(50 * MILLIS).go();
    let start = report.passed[0].0;
    let after: Vec<_> = report.written.iter().filter(|write| write.at > start).collect();
    let off = |bit: u32| after.iter().position(|write| write.value >> bit & 1 == 0).expect("goes off");
    let (crystal, pll) = (off(16), off(24));
    assert!(pll < crystal, "{after:x?}");
}

/// With the cache on, retained memory would stay in it. Cache contents are not modelled, so the test cannot show that it is cleaned first.
#[test]
fn a_data_cache_that_a_bootloader_leaves_is_off() {
    on_each_board(|board| {
        // movw r0, #0xED14; movt r0, #0xE000: CCR, where bit 16 is the data cache and bit 17 the instruction cache.
        let control = core_registers(board, Leftover::DataCache, [0x5014_F64E, 0x0000_F2CE], 1)[0];
        let instruction_cache = u32::from(board.part == Part::H743);
        assert_eq!(control >> 16 & 3, instruction_cache << 1, "{control:#x}");
    });
}

/// The emulator has no cache contents and shows no writes to core registers, so the test checks the order of instructions. A
/// data cache is off before its lines are cleaned and invalidated, each set and way once: with the cache on, a line could come
/// back. An instruction cache is off before it is emptied. All of this ends before the RAM is initialised.
#[test]
fn caches_that_a_bootloader_leaves_are_off_before_they_are_emptied() {
    const LABELS: [&str; 5] = [
        "__pre_init_data_cache_off",
        "__pre_init_data_cache_line",
        "__pre_init_instruction_cache_off",
        "__pre_init_instruction_cache_empty",
        "__pre_init_end",
    ];
    // 16 KiB of four ways and lines of 32 bytes (DS12110, 3.1).
    const LINES: usize = 128 * 4;
    let passed = |leaves: Vec<Leftover>| -> Vec<&str> {
        let bootloader = Bootloader { leaves, ..Bootloader::default() };
        let run = Run::new(&MATEK_H743, Image::Ardupilot).engines().bootloader(bootloader);
        let report = LABELS.into_iter().fold(run, Run::watch).until(50 * MILLIS).go_unchecked().0;
        assert!(report.logged("last reset: power-on"), "{}", report.log_text());
        report.passed.into_iter().map(|(_, label)| label).collect()
    };
    let [data_off, line, instruction_off, empty, end] = LABELS;
    let expected = [vec![data_off], vec![line; LINES], vec![instruction_off, empty, end]].concat();
    let found = passed(vec![Leftover::DataCache]);
    let lines = found.iter().filter(|label| **label == line).count();
    assert!(
        found == expected,
        "{lines} lines; {:?} … {:?}",
        found.first_chunk::<3>(),
        found.last_chunk::<4>()
    );
    // If both are off, nothing is done to them.
    assert_eq!(passed(Vec::new()), [end]);
}

#[test]
fn all_states_that_a_bootloader_leaves_are_corrected_together() {
    on_each_board(|board| {
        served(board, Image::Ardupilot, Jump::New, &Leftover::ALL);
        let with_vtor: Vec<_> = Leftover::ALL.into_iter().chain([Leftover::Vtor]).collect();
        served(board, Image::Ardupilot, Jump::New, &with_vtor);
        // The older ones neither mask interrupts nor move the process stack.
        let masks = [Leftover::Primask, Leftover::Basepri, Leftover::Faultmask];
        let old: Vec<_> =
            Leftover::ALL.into_iter().filter(|one| !masks.contains(one) && !PENDING.contains(one)).collect();
        served(board, Image::Ardupilot, Jump::Old, &[Leftover::ProcessStack]);
        served(board, Image::Ardupilot, Jump::Old, &old);
    });
}

/// PX4's bootloader, with which a Pixhawk 6C may be sold, starts the application at the same place.
#[test]
fn image_runs_behind_what_px4s_bootloader_leaves() {
    on_each_board(|board| {
        served(board, Image::Ardupilot, Jump::Old, &Leftover::PX4);
        // A version whose threads run on the main stack.
        let main_stack: Vec<_> =
            Leftover::PX4.into_iter().filter(|one| *one != Leftover::ProcessStack).collect();
        served(board, Image::Ardupilot, Jump::Old, &main_stack);
    });
}

/// ST's own loader starts an image without a reset after `dfu-util …:leave`, with its own vectors.
#[test]
fn a_plain_image_that_a_loader_starts_sets_its_own_vectors() {
    on_each_board(|board| {
        served(board, Image::Release, Jump::New, &[Leftover::Vtor]);
        let everything: Vec<_> = Leftover::ALL.into_iter().chain([Leftover::Vtor]).collect();
        served(board, Image::Release, Jump::New, &everything);
    });
}

/// Time of the firmware's first log line.
fn boots(report: &Report) -> Vec<u64> {
    report.lines("last reset: ").map(|log| log.at).collect()
}

/// With the bootloader's own decision, and the engines' ECUs.
fn deciding(board: &'static Board, image: Image) -> Run {
    let leaves = Leftover::ALL.into_iter().filter(|one| *one != Leftover::Watchdog).collect();
    Run::new(board, image).engines().bootloader(Bootloader { jump: Jump::New, leaves, decides: true })
}

#[test]
fn the_bootloader_waits_only_at_the_first_start() {
    on_each_board(|board| {
        let wait = bootloader::WAIT_MS * MILLIS;
        let resets = [wait + SECOND, wait + 1500 * MILLIS, wait + 2 * SECOND];
        let report = deciding(board, Image::Ardupilot)
            .at(resets[0], |bench| bench.press_reset())
            .at(resets[1], move |bench| crash(bench, board, Image::Ardupilot))
            .at(resets[2], |bench| bench.watchdog_runs_out())
            .resets(3)
            .with_errors()
            .until(wait + 2500 * MILLIS)
            .go();
        let boots = boots(&report);
        println!("{}: boots at {boots:?}, resets {:?}", board.name, report.resets);
        // The control: a start without the word waits.
        assert!((wait..wait + 100 * MILLIS).contains(&boots[0]), "{boots:?}");
        for (boot, (reset, _)) in boots[1..].iter().zip(&report.resets) {
            assert!(boot - reset < 10 * MILLIS, "{boots:?} {:?}", report.resets);
        }
        let causes: Vec<_> =
            report.lines("last reset: ").map(|log| log.text.rsplit_once(": ").expect("a cause").1).collect();
        assert_eq!(causes, ["power-on", "reset pin", "watchdog", "watchdog"]);
        // The crash: within 250 ms, and from there on 0.2 ms at most.
        let logged = report.when("has no handler, resetting");
        assert!(report.resets[1].0 - logged < MILLIS, "{logged} {:?}", report.resets);
    });
}
