//! The status LED shows the states of the engines, as README's table has them, and the buzzer beeps with it.

use crate::support::{Led, on_each_board};
use emulation::pins::{Level, Pin};
use emulation::receiver::{Position, Protocol, Receiver};
use emulation::{Image, Run};
use sim::ecu::{MILLIS, Nanos, SECOND};

#[test]
fn armed_running_source_lost_stop_latched_and_fault_are_shown() {
    on_each_board(|board| {
        let led = Led::of(board);
        let report = Run::new(board, Image::Outputs)
            .quick_engines()
            .radio(Receiver::new(Protocol::Sbus))
            .record(led.register)
            .at(5 * SECOND, |bench| bench.radio().switch = Position::Standby)
            .at(9 * SECOND, |bench| bench.radio().switch = Position::Run)
            .at(60 * SECOND, |bench| bench.radio().transmitter = false)
            .at(64 * SECOND, |bench| bench.radio().transmitter = true)
            .at(70 * SECOND, |bench| bench.radio().switch = Position::Stop)
            .at(76 * SECOND, |bench| bench.cut("SERIAL2", true))
            .until(81 * SECOND)
            .go();
        let (lit, dark) = (led.lit(&report), led.dark(&report));
        // The image has the buzzer on the last output, if one is free (src/config.rs).
        let buzzer = (board.outputs.len() > 8).then(|| Pin::output(&report, board.outputs.len() - 1));
        // The flashes of the second from then on, in ms.
        let flashes = |second: Nanos| {
            let within = second * SECOND - 100 * MILLIS..(second + 1) * SECOND - 100 * MILLIS;
            let lit = lit.iter().filter(|at| within.contains(at));
            let length = |at: &Nanos| dark.iter().find(|dark| *dark > at).expect("it goes out") - at;
            lit.map(|at| (length(at) + MILLIS / 2) / MILLIS).collect::<Vec<_>>()
        };
        for (second, shows, beeps) in [
            (7, [50; 2].as_slice(), true), // armed
            (11, &[50; 3], false),         // ordered to run
            (58, &[50; 3], false),         // running
            (62, &[300], true),            // source lost
            (68, &[50; 3], false),         // back
            (73, &[300; 2], true),         // stop latched
            (79, &[50; 5], true),          // fault: a link is lost
        ] {
            assert_eq!(flashes(second), shows, "{}, second {second}\n{}", board.name, report.log_text());
            let Some(buzzer) = &buzzer else { continue };
            let within = second * SECOND - 100 * MILLIS..(second + 1) * SECOND - 100 * MILLIS;
            let changes = buzzer.changes(within);
            let beeped: Vec<Nanos> = changes
                .iter()
                .zip(changes.iter().skip(1))
                .filter(|((_, level), _)| *level == Level::High)
                .map(|((on, _), (off, _))| (off - on + MILLIS / 2) / MILLIS)
                .collect();
            assert_eq!(beeped, if beeps { shows } else { &[] }, "{}, second {second}", board.name);
        }
    });
}
