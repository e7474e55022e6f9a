//! From power to the first reply.

use crate::support::{engines, first_byte, no_window_missed, on_each_board};
use emulation::{Image, Run};
use sim::amt::AmtEcu;
use sim::ecu::{MILLIS, SECOND};

/// Standby, throttle at idle.
const STANDBY: [u8; 5] = [0xFF, 0x12, 0x20, 0x12, 0x20];

#[test]
fn the_first_frame_of_an_amt_ecu_is_answered() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release).engines().until(2 * SECOND).go();
        let left = engines(&report)[0];
        let wire = report.wire(left.port);
        let first = wire.rx.iter().find(|rx| rx.last).expect("a frame").end;
        let reply = first_byte(&report, left.port, 0);
        assert!(reply > first, "nobody speaks before he is spoken to");
        assert!(
            reply - first < 5 * MILLIS,
            "{} ns from the frame to the end of the first byte",
            reply - first
        );
        assert_eq!(wire.tx[..5].iter().map(|tx| tx.byte).collect::<Vec<_>>(), STANDBY);
        no_window_missed(&report, &left);
        // What the ECU's first frames say, in the order in which they say it.
        let events: Vec<_> = report.events(left.name).into_iter().map(|(_, event)| event).collect();
        let standby = "Ordered(Ordered { order: Standby, origin: Node })";
        assert_eq!(events, ["EngineIdentified(Olympus)", "EcuStarted", standby, "LinkUp", "Phase(Standby)"]);
    });
}

#[test]
fn the_log_names_the_reset_and_every_port() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release).engines().until(SECOND / 2).go();
        assert!(report.logs[0].text.ends_with("last reset: PowerOn"), "{:?}", report.logs[0]);
        for (number, port) in board.ports.iter().enumerate() {
            let uart = format!("{:?}", port.uart).to_uppercase();
            assert!(
                report.logged(&format!("port {number}, {}, {uart}, ", port.name)),
                "{}",
                report.log_text()
            );
        }
        for engine in engines(&report) {
            let stop_bits = engine.line.stop_bits;
            let line =
                format!(": {}, Line {{ baud: {}, stop_bits: {stop_bits:?}", engine.name, engine.line.baud);
            assert!(report.logged(&line), "{line}\n{}", report.log_text());
        }
    });
}

#[test]
fn the_clock_is_right() {
    on_each_board(|board| {
        let report = Run::new(board, Image::Release).engines().until(4 * SECOND).go();
        let seconds: Vec<_> = report.lines("left: link").map(|log| log.at).collect();
        assert_eq!(seconds.len(), 3);
        for pair in seconds.windows(2) {
            // The firmware wakes at the tick and then logs: some instructions more or less.
            assert!((pair[1] - pair[0]).abs_diff(SECOND) < 20_000, "{seconds:?}");
        }
        // 125 ms by the ECU's own clock, from frame to frame; and the firmware's ticker agrees.
        assert!(report.ecu::<AmtEcu>("SERIAL2").stats.frames.total() >= 27);
    });
}
