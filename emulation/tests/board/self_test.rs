//! The self-test's report, compared with the emulated part. The part has exact oscillators, no wait states and no levels on
//! its pins, so a real board may differ.

use crate::support::on_each_board;
use emulation::board::Part;
use emulation::{Board, Image, Report, Run};
use sim::ecu::{MILLIS, SECOND};

/// The lines of the first block, without "selftest: ".
fn block(report: &Report) -> Vec<&str> {
    let lines = report.logs.iter().filter_map(|log| log.text.strip_prefix("selftest: "));
    let mut block: Vec<&str> = lines.skip_while(|line| !line.starts_with("begin")).collect();
    let end = block.iter().position(|line| *line == "end").expect("the block ends");
    block.truncate(end);
    block
}

fn run(board: &'static Board) -> Run {
    Run::new(board, Image::SelfTest).engines().resets(2).with_errors()
}

#[test]
fn the_report_has_the_values_of_the_part() {
    on_each_board(|board| {
        let report = run(board).until(8 * SECOND).go();
        let block = block(&report);
        println!("{}:\n{}", board.name, block.join("\n"));
        let has = |text: &str| assert!(block.iter().any(|line| line.contains(text)), "{text}: {block:#?}");
        assert!(block.len() < 16, "{block:#?}");
        has(&format!("on {}", board.title));
        // The LSI of both parts is 32 kHz, and the emulator's oscillators have no error. The counts go to a microsecond.
        let number = |before: &str, nth: usize| -> i64 {
            let line = block
                .iter()
                .find(|line| line.starts_with(before))
                .unwrap_or_else(|| panic!("{before}: {block:#?}"));
            line.split(' ').filter_map(|word| word.parse().ok()).nth(nth).expect("a number")
        };
        let core = board.core_hz as i64 / 1000;
        assert!((number("core", 0) - core).abs() <= core / 10_000, "{block:#?}");
        assert!((number("LSI", 0) - 32_000).abs() <= 1 && number("LSI", 1).abs() <= 10, "{block:#?}");
        has("retained RAM survived the 2 resets of this test and 0 more; it began after a loss of power");
        has(&format!("TX at the start, pulled up: {0} of {0} high", board.ports.len()));
        match board.part {
            Part::H743 => {
                has("device 0x450, revision 0x2003");
                has("2 wait states, WRHIGHFREQ 2");
                has("instruction cache true, data cache false");
            }
            Part::F427 => {
                has("device 0x419, revision 0x2003");
                has("5 wait states, prefetch true, instruction cache true, data cache true");
            }
        }
        has(&format!("vectors at {:#010x}", board.flash.start));
        has("bytes deep since the start");
        // Both rounds end in the watchdog, half a second each, and the third start stays.
        let causes: Vec<_> = report.resets.iter().map(|(_, cause)| format!("{cause:?}")).collect();
        assert_eq!(causes, ["Model(\"IWDG\")", "Model(\"IWDG\")"]);
        assert!((500 * MILLIS..600 * MILLIS).contains(&report.resets[0].0), "{:?}", report.resets);
        assert_eq!(report.lines("using the internal oscillator").count(), 1, "{}", report.log_text());
    });
}

#[test]
fn the_report_names_a_missing_crystal() {
    on_each_board(|board| {
        let report = run(board).at(0, |bench| bench.break_crystal()).until(8 * SECOND).go();
        let block = block(&report);
        assert!(block.contains(&"no crystal; LSI 32000 Hz against the HSI"), "{block:#?}");
    });
}

#[test]
fn a_later_reset_is_counted_and_begins_no_new_round() {
    on_each_board(|board| {
        let report = run(board).at(2 * SECOND, |bench| bench.press_reset()).resets(3).until(8 * SECOND).go();
        let block = block(&report);
        let counted = "retained RAM survived the 2 resets of this test and 1 more";
        assert!(block.iter().any(|line| line.contains(counted)), "{block:#?}");
        assert_eq!(report.lines("selftest: round").count(), 2);
    });
}
