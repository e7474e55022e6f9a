//! Where the image lies in the part's memory, and how deep its stack gets.

use crate::support::on_each_board;
use emulation::{Board, Image, Run};
use sim::ecu::SECOND;
use std::sync::mpsc;

/// The addresses that the linker has settled.
fn symbol(board: &Board, name: &str) -> u64 {
    let bytes = Image::Release.read(board).expect("an image");
    emulation::image::symbol(&bytes, name).unwrap_or_else(|| panic!("the image has no symbol {name}"))
}

#[test]
fn stack_statics_and_vectors_are_where_they_should_be() {
    on_each_board(|board| {
        let (vectors, reset) = (symbol(board, "__vector_table"), symbol(board, "Reset"));
        assert_eq!(vectors, board.flash.start, "the part boots from there");
        assert_eq!(symbol(board, "_stack_start"), board.ram.end, "the stack has the top of the RAM");
        assert_eq!(symbol(board, "__sdata"), board.ram.start);
        let statics_end = symbol(board, "__euninit");
        assert!(board.ram.contains(&statics_end), "{statics_end:#x}");

        let (sender, receiver) = mpsc::channel();
        Run::new(board, Image::Release)
            .engines()
            .at(10 * SECOND, move |bench| {
                let stack = (statics_end..board.ram.end).step_by(4);
                let deepest = stack.clone().find(|&at| bench.word(at) != Some(0));
                let first_words = [0, 4].map(|offset| bench.word(vectors + offset));
                sender.send((deepest, first_words)).expect("the test waits");
            })
            .until(10 * SECOND + 1)
            .go();
        let (deepest, first_words) = receiver.recv().expect("the run came by");
        assert_eq!(first_words, [Some(board.ram.end as u32), Some(reset as u32 | 1)]);
        let used = board.ram.end - deepest.expect("a stack");
        let free = deepest.expect("a stack") - statics_end;
        let statics = statics_end - board.ram.start;
        println!("{}: {statics} bytes of statics, {used} of stack used, {free} never touched", board.name);
        assert!(used > 100 && used < 64 * 1024, "{used} bytes of stack");
        assert!(free > 64 * 1024, "{free} bytes free");
    });
}
