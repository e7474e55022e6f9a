//! Position of the image in the part's memory, and depth of its stack.

use crate::support::{Task, hijack, on_all_boards, on_each_board, symbol};
use emulation::{Image, Run};
use sim::ecu::{MILLIS, SECOND};
use std::sync::mpsc;

/// Limits of the stack, while the firmware runs and while it starts.
const RUNNING: u64 = 12 * 1024;
const STARTING: u64 = 40 * 1024;
/// Pattern with which the firmware paints its stack, and the painted length.
const PAINTED: u64 = 64 * 1024;
const PAINT: u32 = 0xC5C5_C5C5;

#[test]
fn stack_statics_and_vectors_are_in_their_regions() {
    on_each_board(|board| {
        let symbol = |name| symbol(board, Image::Release, name);
        let (vectors, reset) = (symbol("__vector_table"), symbol("Reset"));
        assert_eq!(vectors, board.flash.start, "the part boots from there");
        assert_eq!(symbol("_stack_start"), board.ram.end, "the stack has the top of the RAM");
        assert_eq!(symbol("__sdata"), board.ram.start);
        let statics_end = symbol("__euninit");
        assert!(board.ram.contains(&statics_end), "{statics_end:#x}");

        let (sender, receiver) = mpsc::channel();
        let report = Run::new(board, Image::Release)
            .engines()
            // Right after the mark of this second: a deeper call may come at any other time.
            .at(10 * SECOND + 50 * MILLIS, move |bench| {
                let first_words = [0, 4].map(|offset| bench.word(vectors + offset));
                assert_eq!(first_words, [Some(board.ram.end as u32), Some(reset as u32 | 1)]);
                let words: Vec<_> =
                    (statics_end..board.ram.end).step_by(4).map(|at| bench.word(at)).collect();
                sender.send(words).expect("the test waits");
            })
            .until(10 * SECOND + 50 * MILLIS + 1)
            .go();
        assert_eq!(report.lines("left: link").count(), 10);
        let words = receiver.recv().expect("the run came by");
        let size = |words: usize| 4 * words as u64;
        // The firmware paints the uppermost 64 KiB, and the memory below is never touched.
        let (below, painted) = words.split_at(words.len() - PAINTED as usize / 4);
        assert!(below.iter().all(|&word| word == Some(0)), "something below the painted stack is used");
        let running =
            size(painted.len() - painted.iter().position(|&word| word != Some(PAINT)).expect("a stack"));
        // The mark that the firmware logs is the one that its memory shows.
        let logged = report.lines("bytes of stack used").next_back().expect("the mark").text.clone();
        let numbers: Vec<u64> = logged.split(' ').filter_map(|word| word.parse().ok()).collect();
        let [marked, starting] = numbers[..] else { panic!("{logged}") };
        let (statics, free) = (statics_end - board.ram.start, size(below.len()));
        println!(
            "{}: {statics} bytes of statics; {starting} of stack used at the start, {running} afterwards; {free} never \
             touched",
            board.name
        );
        assert_eq!(marked, running, "{logged}");
        assert!((100..RUNNING).contains(&running), "{running} bytes of stack");
        assert!((RUNNING..STARTING).contains(&starting), "{starting} bytes of stack at the start");
        assert!(free > 64 * 1024, "{free} bytes free");
    });
}

#[test]
fn retained_memory_has_a_place_of_its_own() {
    on_all_boards(|board| {
        for image in Image::of(board) {
            let symbol = |name| symbol(board, image, name);
            let retained = symbol("__sretained")..symbol("__eretained");
            // 2 KiB from here on. The last 6 KiB of the RAM are unused.
            assert_eq!(retained.start, board.above.start, "{image:?}");
            assert!(
                retained.end > retained.start && retained.end <= retained.start + 2048,
                "{image:?} {retained:x?}"
            );
            assert_eq!((retained.start % 8, retained.end % 8), (0, 0), "{image:?} {retained:x?}");
        }
    });
}

/// The task's code is replaced by one that uses more stack than there is.
#[test]
fn a_stack_that_grows_too_far_ends_the_firmware_before_it_reaches_the_statics() {
    on_each_board(|board| {
        let statics_end = symbol(board, Image::Release, "_stack_end");
        let guard = statics_end.next_multiple_of(16 * 1024);
        let (sender, receiver) = mpsc::channel();
        let report = Run::new(board, Image::Release)
            .engines()
            .at(1500 * MILLIS, move |bench| {
                // The memory below the guard is marked.
                (statics_end..guard).step_by(4).for_each(|at| bench.set_word(at, 0x600D_600D));
                // push {r0-r7, lr}, repeatedly. This code is also below the guard.
                let code = statics_end;
                bench.set_word(code, 0xE7FD_B5FF);
                hijack(bench, board, Image::Release, Task::Supervisor, code);
            })
            .at(2 * SECOND, move |bench| {
                let below: Vec<_> = (statics_end + 4..guard).step_by(4).map(|at| bench.word(at)).collect();
                sender.send(below).expect("the test waits");
            })
            .resets(1)
            .with_errors()
            .until(3 * SECOND)
            .go_unchecked()
            .0;
        let below = receiver.recv().expect("the run came by");
        assert!(
            !below.is_empty() && below.iter().all(|word| *word == Some(0x600D_600D)),
            "{:x?}",
            below.last()
        );
        assert_eq!(report.resets.len(), 1, "{:?}", report.resets);
        assert!(
            report.logged("hard fault at") && report.logged("last reset: software"),
            "{}",
            report.log_text()
        );
        assert!(report.lines("left: ECU link up").next_back().expect("up again").at > report.resets[0].0);
    });
}
