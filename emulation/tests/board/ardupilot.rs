//! Images behind an ArduPilot bootloader. In its place are two words at the beginning of the flash, stack and start
//! of the application, which is what its jump amounts to: the part starts there, with its vectors there. The register
//! that says where the vectors are (VTOR) is inside the core, where a test cannot look. But without the application's
//! own vectors no interrupt finds its handler, as the last test here shows.

use crate::support::{engines, first_byte, on_each_board, others_are_well, symbol};
use emulation::{Image, Run};
use sim::amt::AmtEcu;
use sim::ecu::{MILLIS, SECOND};
use std::sync::mpsc;

/// What the bootloader looks for after a reset (RTC_BOOT_FWOK).
const FIRMWARE_OK: u32 = 0xB009_3A26;
/// What starts the watchdog.
const START: u64 = 0xCCCC;

#[test]
fn the_image_runs_behind_a_bootloader_as_without_one() {
    on_each_board(|board| {
        let image = Image::Ardupilot;
        let table = symbol(board, image, "__vector_table");
        assert_eq!(table, board.behind_bootloader);
        assert!(symbol(board, image, "__stext") > table && symbol(board, image, "__etext") < board.flash.end);

        let (sender, receiver) = mpsc::channel();
        let look = move |bench: &mut emulation::Bench<'_>| {
            let words = [table, table + 4, board.flash.start, board.flash.start + 4].map(|at| bench.word(at));
            let _ = sender.send((bench.register(board.backup), words));
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
        for (backup, words) in receiver.iter().take(2) {
            assert_eq!(backup, Some(FIRMWARE_OK));
            assert_eq!(words[0], Some(board.ram.end as u32));
            assert_eq!(words[..2], words[2..]);
        }

        // The bootloader is told before the watchdog runs, at both boots.
        let is = |register, value| {
            move |write: &&emulation::Written| write.register == register && write.value == value
        };
        let told: Vec<_> = report.written.iter().filter(is(board.backup, FIRMWARE_OK.into())).collect();
        let started: Vec<_> = report.written.iter().filter(is(board.watchdog, START)).collect();
        assert_eq!((told.len(), started.len()), (2, 2), "{:?}", report.written);
        for (told, started) in told.iter().zip(started) {
            assert!(told.at <= started.at, "{told:?} {started:?}");
        }
        assert!(report.logged("last reset: Watchdog"), "{}", report.log_text());

        // And otherwise it is the same: the same first bytes at the same time.
        let plain = Run::new(board, Image::Release).engines().until(2 * SECOND).go();
        for engine in engines(&report) {
            let bytes = |report: &emulation::Report| -> Vec<u8> {
                report
                    .wire(engine.port)
                    .tx
                    .iter()
                    .filter(|tx| tx.end < 1900 * MILLIS)
                    .map(|tx| tx.byte)
                    .collect()
            };
            assert_eq!(bytes(&report), bytes(&plain), "{}", engine.name);
            let (here, there) = (first_byte(&report, engine.port, 0), first_byte(&plain, engine.port, 0));
            assert!(here.abs_diff(there) < MILLIS, "{}: {here} {there}", engine.name);
        }
        assert!(report.ecu::<AmtEcu>("SERIAL2").stats.late == 0);
        others_are_well(&plain, &[]);
    });
}

#[test]
fn without_its_own_vectors_it_would_not_run() {
    on_each_board(|board| {
        // The third instruction of the start sets VTOR: str r1, [r0].
        let set = symbol(board, Image::Ardupilot, "Reset") + 4;
        let (sender, receiver) = mpsc::channel();
        let run = || Run::new(board, Image::Ardupilot).engines().until(SECOND);
        let look = move |bench: &mut emulation::Bench<'_>| {
            sender.send(bench.word(set).map(|word| word as u16)).expect("the test waits");
        };
        assert!(run().at(SECOND / 2, look).go_unchecked().1.is_empty());
        assert_eq!(receiver.recv(), Ok(Some(0x6001)));
        let report = run().patch(set, &[0xBF00]).go_unchecked().0;
        let sent: usize = report.wires().map(|(_, wire)| wire.tx.len()).sum();
        assert_eq!(sent, 0, "the first interrupt ends it");
    });
}
