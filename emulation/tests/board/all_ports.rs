//! Every port at once, for a minute: 3000 send slots of a ZK engine, and 60 bursts of log lines.

use crate::support::{engines, line_errors_of, on_each_board, well};
use emulation::{Image, Run};
use sim::ecu::SECOND;

#[test]
fn the_engines_of_the_release_image_run_for_a_minute_without_an_error() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release).engines().until(60 * SECOND).go();
        for engine in engines(&report) {
            well(&report, &engine);
            assert_eq!(line_errors_of(&report, engine.name), (0, 0, 0));
        }
        assert!(!report.logged("ECU link lost") && !report.logged("not sent"), "{}", report.log_text());
    });
}

#[test]
fn an_engine_on_every_port_runs_for_a_minute_without_an_error() {
    on_each_board(|board| {
        let report = Run::new(board, Image::AllPorts).engines().until(60 * SECOND).go();
        let engines = engines(&report);
        assert_eq!(engines.len(), board.ports.len());
        for engine in &engines {
            well(&report, engine);
            assert_eq!(line_errors_of(&report, engine.name), (0, 0, 0));
        }
        assert!(!report.logged("ECU link lost") && !report.logged("not sent"), "{}", report.log_text());
        println!("{}: {} engines load the core with {:.2} %", board.name, engines.len(), report.load());
    });
}
